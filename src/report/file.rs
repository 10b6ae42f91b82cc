//! What is written: a name and its bytes.

/// The file that holds every number of a run.
pub(super) const RESULTS: &str = "results.json";

/// A file before it is written.
#[derive(Debug, Clone)]
pub struct File {
    /// Its name in the output folder.
    pub name: String,
    /// All of it.
    pub bytes: Vec<u8>,
}

impl File {
    /// A file of text.
    pub fn text(name: impl Into<String>, text: impl Into<Vec<u8>>) -> Self {
        Self {
            name: name.into(),
            bytes: text.into(),
        }
    }
}
