//! What is wrong with a scene, and where.

use std::fmt;
use std::ops::Range;

/// What is wrong with a scene, and where: a [`miette::Diagnostic`] with the line and what is accepted.
#[derive(Debug)]
pub struct SceneError(pub(super) Box<Wrong>);

#[derive(Debug)]
pub(super) struct Wrong {
    pub(super) message: String,
    pub(super) label: String,
    pub(super) help: Option<String>,
    pub(super) source: miette::NamedSource<String>,
    pub(super) span: Option<Range<usize>>,
    /// The key and the value that the message is about.
    pub(super) key: Option<String>,
    pub(super) value: Option<String>,
}

impl SceneError {
    /// The same, about a key and what stands under it.
    pub(super) fn about(mut self, key: impl Into<String>, value: Option<String>) -> Self {
        self.0.key = Some(key.into());
        self.0.value = value;
        self
    }

    /// The same with something more after its message.
    pub(crate) fn with_note(mut self, note: &str) -> Self {
        self.0.message.push_str(note);
        self
    }

    /// The key of the scene that is wrong; None where no single one is.
    pub fn key(&self) -> Option<&str> {
        self.0.key.as_deref()
    }

    /// Its value; None where it is missing.
    pub fn value(&self) -> Option<&str> {
        self.0.value.as_deref()
    }

    /// What would have been accepted.
    pub fn accepted(&self) -> Option<&str> {
        let help = self.0.help.as_deref()?;
        let after = help
            .strip_prefix("accepted")
            .and_then(|it| it.split_once(": "));
        Some(after.map_or(help, |(_, accepted)| accepted))
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.message)
    }
}

impl std::error::Error for SceneError {}

impl miette::Diagnostic for SceneError {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        let help = self.0.help.as_ref()?;
        Some(Box::new(help))
    }

    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        self.0
            .span
            .as_ref()
            .map(|_| &self.0.source as &dyn miette::SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = miette::LabeledSpan> + '_>> {
        let span = self.0.span.clone()?;
        let label = miette::LabeledSpan::new_with_span(Some(self.0.label.clone()), span);
        Some(Box::new(std::iter::once(label)))
    }
}
