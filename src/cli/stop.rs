//! How a command ends.

use crate::error::Error;
use crate::map::MapError;
use crate::scene::text::SceneError;

/// How a command ends: its exit status, 0, or 3 for a tolerance not reached; or why it ends early.
pub type Outcome = std::result::Result<u8, Stop>;

/// Why the program ends early: what to print, and the exit status.
pub struct Stop {
    pub(super) report: miette::Report,
    pub(super) status: u8,
}

impl Stop {
    /// A message, its help if there is any, and the exit status.
    pub fn new(status: u8, message: impl Into<String>, help: &str) -> Self {
        let it = miette::MietteDiagnostic::new(message);
        let it = if help.is_empty() {
            it
        } else {
            it.with_help(help)
        };
        Self {
            report: it.into(),
            status,
        }
    }

    /// A scene that is wrong.
    pub(super) fn scene(error: SceneError) -> Self {
        Self {
            report: miette::Report::new(error),
            status: 2,
        }
    }

    /// An error at its place in a scene.
    pub(super) fn explained(error: &Error, at: SceneError) -> Self {
        Self {
            report: miette::Report::new(at),
            status: status(error),
        }
    }
}

impl From<Error> for Stop {
    fn from(error: Error) -> Self {
        let status = status(&error);
        match error {
            Error::Invalid {
                key,
                value,
                accepted,
            } => {
                let message = format!("{key} = {value} is not accepted");
                Self::new(status, message, &format!("accepted: {accepted}"))
            }
            other => Self::new(status, other.to_string(), ""),
        }
    }
}

impl From<MapError> for Stop {
    fn from(error: MapError) -> Self {
        match error {
            MapError::Scene(error) => Self::scene(error),
            MapError::Other(error) => error.into(),
        }
    }
}

/// 2 for what the user can mend in scene or command line, 3 for a limit or a tolerance not reached, 1 for the rest.
fn status(error: &Error) -> u8 {
    match error {
        error if error.is_refusal() => 2,
        // An equation that was not solved reached no tolerance.
        error if error.is_unanswered() => 3,
        _ => 1,
    }
}
