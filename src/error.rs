//! What can go wrong, named so that the user can mend it.

use std::path::{Path, PathBuf};

/// Every failure of the library. No variant is a bug of the caller's program logic: each names
/// the quantity, the value it had and what would have been accepted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value outside its range.
    #[error("{key} = {value} is not accepted: {accepted}")]
    Invalid {
        /// The key of the scene, or the name of the argument.
        key: String,
        /// The value as given.
        value: String,
        /// What would have been accepted.
        accepted: String,
    },
    /// A question about the stationary law of an oscillator that has none.
    #[error("{what} needs a stationary law, and the contact law \"{contact}\" has none: {why}")]
    NoStationaryLaw {
        /// What was asked for.
        what: String,
        /// The contact law.
        contact: String,
        /// Why there is none.
        why: String,
    },
    /// A mesh that cannot hold the scene.
    #[error("the mesh cannot hold the scene: {what}; {help}")]
    Mesh {
        /// What does not fit.
        what: String,
        /// What would help.
        help: String,
    },
    /// No mesh of the program's own choice that resolves the scene.
    #[error("no mesh within the limits resolves the scene: {what}; [monte_carlo] needs none")]
    Unresolved {
        /// What the last one lacked.
        what: String,
    },
    /// A matrix that cannot be factored or a solution that is not one.
    #[error("{stage}: {what}")]
    Linear {
        /// Where it happened.
        stage: &'static str,
        /// What was found.
        what: String,
    },
    /// A limit of the scene was reached before the answer.
    #[error("{key} = {limit} does not suffice: {what}")]
    Limit {
        /// The key that holds the limit.
        key: &'static str,
        /// The limit.
        limit: String,
        /// What would have been needed.
        what: String,
    },
    /// The caller wanted the end of the run before the answer.
    #[error("stopped: {what}")]
    Stopped {
        /// How far it had come.
        what: String,
    },
    /// Two answers to one question that are not the same.
    #[error("point {point} differs in {a} and {b}: {what}", a = files[0], b = files[1])]
    Disagree {
        /// The question.
        point: String,
        /// Where the answers stand.
        files: [String; 2],
        /// In what they differ.
        what: String,
    },
    /// A file or folder that cannot be read or written.
    #[error("{path} cannot be read or written: {source}", path = path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system answered.
        source: std::io::Error,
    },
}

/// Result with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// What a long calculation calls now and then: an error once its time is over.
pub(crate) type Deadline<'a> = dyn Fn() -> Result<()> + Sync + 'a;

impl Error {
    /// [`Error::Invalid`] from anything that prints.
    pub fn invalid(
        key: impl Into<String>,
        value: impl std::fmt::Display,
        accepted: impl Into<String>,
    ) -> Self {
        Self::Invalid {
            key: key.into(),
            value: value.to_string(),
            accepted: accepted.into(),
        }
    }

    /// [`Error::Io`] about a file or folder, from what the system answered.
    pub(crate) fn io(path: &Path) -> impl Fn(std::io::Error) -> Self + '_ {
        move |source| Self::Io {
            path: path.to_owned(),
            source,
        }
    }

    /// [`Error::Io`] about a file that cannot be made.
    pub(crate) fn unmade(name: &str, why: impl std::fmt::Display) -> Self {
        Self::io(Path::new(name))(std::io::Error::other(why.to_string()))
    }

    /// [`Error::Linear`] from where it happened and what was found.
    pub(crate) fn linear(stage: &'static str, what: impl Into<String>) -> Self {
        Self::Linear {
            stage,
            what: what.into(),
        }
    }

    /// [`Error::Limit`] from the key that holds it and what would have been needed.
    pub(crate) fn limit(
        key: &'static str,
        limit: impl Into<String>,
        what: impl Into<String>,
    ) -> Self {
        Self::Limit {
            key,
            limit: limit.into(),
            what: what.into(),
        }
    }

    /// [`Error::Mesh`] from what does not fit and what would help.
    pub(crate) fn mesh(what: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Mesh {
            what: what.into(),
            help: help.into(),
        }
    }

    /// Whether scene or argument are wrong, and not the computation: the user can mend it.
    pub fn is_refusal(&self) -> bool {
        matches!(
            self,
            Self::Invalid { .. } | Self::NoStationaryLaw { .. } | Self::Mesh { .. }
        )
    }

    /// Whether the computation found no answer within its limits: other questions may have one.
    pub(crate) fn is_unanswered(&self) -> bool {
        matches!(
            self,
            Self::Limit { .. } | Self::Unresolved { .. } | Self::Linear { .. }
        )
    }
}

/// `value` if it is finite and positive, else an error that names `key`.
pub(crate) fn positive(key: &str, value: f64) -> Result<f64> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(Error::invalid(key, value, "a finite number > 0"))
    }
}

/// Refuses times, or whatever else is meant by the word, that are negative, not finite or not ascending, by `key`.
pub(crate) fn ascending(key: &str, what: &str, all: &[f64]) -> Result<()> {
    let mut before = 0.0;
    for &it in all {
        if !(it.is_finite() && it >= before) {
            return Err(Error::invalid(
                key,
                it,
                format!("ascending finite {what} >= 0"),
            ));
        }
        before = it;
    }
    Ok(())
}

/// `value` if it is finite, else an error that names `key`.
pub(crate) fn finite(key: &str, value: f64) -> Result<f64> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Error::invalid(key, value, "a finite number"))
    }
}
