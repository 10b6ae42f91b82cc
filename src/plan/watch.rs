//! Who is told about a run as it goes.

use super::stage::Part;
use crate::budget::StopFlag;
use crate::error::Result;
use crate::results::Results;

/// Told about a run as it goes; every method may be left as it is.
pub trait Watch: Sync {
    /// A part begins.
    fn begins(&self, _part: Part) {}

    /// A part is done to this fraction.
    fn progress(&self, _part: Part, _fraction: f64) {}

    /// A part has ended; `results` hold it and all before it.
    ///
    /// # Errors
    /// Whatever is returned ends the run.
    fn ends(&self, _part: Part, _results: &Results) -> Result<()> {
        Ok(())
    }

    /// The flag that ends the run once it is raised, where the run looks at the clock: mostly within milliseconds. What
    /// nothing can stop half way, as a factorisation or a step on a large mesh, ends first.
    fn stop(&self) -> StopFlag {
        StopFlag::default()
    }
}

/// Nobody.
pub(super) struct Nobody;

impl Watch for Nobody {}
