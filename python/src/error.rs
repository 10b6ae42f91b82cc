//! Errors of the library as exceptions of the package.

use miette::{GraphicalReportHandler, GraphicalTheme};
use pyo3::prelude::*;
use vibroimpact::Error;
use vibroimpact::scene::text::{SceneError, SceneText};

/// A class of the package's `_errors`.
#[derive(Clone, Copy)]
enum Class {
    /// A scene or an argument that is wrong: a `ValueError` too.
    Scene,
    /// A limit of the scene reached before the answer.
    Limit,
    Other,
}

impl Class {
    fn of(error: &Error) -> Self {
        match error {
            error if error.is_refusal() => Self::Scene,
            Error::Limit { .. } | Error::Unresolved { .. } => Self::Limit,
            _ => Self::Other,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Scene => "SceneError",
            Self::Limit => "LimitError",
            Self::Other => "VibroimpactError",
        }
    }

    fn raise(self, py: Python<'_>, message: String, about: [Option<&str>; 3]) -> PyErr {
        let made = py.import("vibroimpact._errors").and_then(|module| {
            let [key, value, accepted] = about;
            module
                .getattr(self.name())?
                .call1((message, key, value, accepted))
        });
        made.map_or_else(|error| error, PyErr::from_value)
    }
}

/// A scene that is wrong.
pub(crate) fn scene(py: Python<'_>, error: &SceneError) -> PyErr {
    raise(py, error, Class::Scene)
}

/// An error of a scene's plan or run, shown in the line of the scene that caused it.
pub(crate) fn of_scene(py: Python<'_>, text: &SceneText, error: &Error) -> PyErr {
    match error {
        Error::Io { .. } => of(py, error),
        // An argument of ours, and no key of the scene.
        Error::Invalid { key, .. } if key.starts_with("--") => of(py, error),
        _ => raise(py, &text.explain(error), Class::of(error)),
    }
}

/// An error that no scene stands behind. Options of the command line become arguments.
pub(crate) fn of(py: Python<'_>, error: &Error) -> PyErr {
    let argument = |it: &str| it.replace("--force", "force=True").replace("--", "");
    match error {
        Error::Invalid {
            key,
            value,
            accepted,
        } => {
            let (key, accepted) = (argument(key), argument(accepted));
            let message = format!("{key} = {value} is not accepted\naccepted: {accepted}");
            Class::Scene.raise(py, message, [Some(&key), Some(value), Some(&accepted)])
        }
        other => Class::of(other).raise(py, other.to_string(), [None; 3]),
    }
}

/// Longest line of a scene that is shown: numbers of an array may make it thousands.
const LONGEST: usize = 400;

/// With the line of the scene below the message.
fn raise(py: Python<'_>, error: &SceneError, class: Class) -> PyErr {
    let mut shown = String::new();
    let handler = GraphicalReportHandler::new_themed(GraphicalTheme::unicode_nocolor());
    let rendered = handler.with_width(100_000).render_report(&mut shown, error);
    let short = shown.lines().all(|line| line.chars().count() <= LONGEST);
    let about = [error.key(), error.value(), error.accepted()];
    let message = match (rendered, about) {
        (Ok(()), _) if short => shown
            // A key of the command line's is a call of Python's.
            .replace("\u{256d}\u{2500}[--set:", "\u{256d}\u{2500}[replace:")
            .trim()
            .trim_start_matches(['×', ' '])
            .to_owned(),
        (_, [.., Some(accepted)]) => format!("{error}\naccepted: {accepted}"),
        _ => error.to_string(),
    };
    class.raise(py, message, about)
}
