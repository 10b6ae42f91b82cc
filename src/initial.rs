//! Where the motion starts.

use crate::error::{Result, finite, positive};

/// The law of (q, v) at t = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Initial {
    /// Independent Gaussians in q and v.
    Gaussian {
        /// Mean of q and of v.
        mean: [f64; 2],
        /// Standard deviation of q and of v.
        deviation: [f64; 2],
    },
    /// q = v = 0 exactly; the noise is switched on at t = 0.
    Rest,
    /// The stationary law (21).
    Stationary,
}

impl Initial {
    /// A Gaussian start.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for a mean that is not finite or a deviation that is not positive.
    pub fn gaussian(mean: [f64; 2], deviation: [f64; 2]) -> Result<Self> {
        let it = Self::Gaussian { mean, deviation };
        it.check()?;
        Ok(it)
    }

    /// Refuses a mean that is not finite and a deviation that is not positive.
    pub(crate) fn check(&self) -> Result<()> {
        if let Self::Gaussian { mean, deviation } = self {
            for k in 0..2 {
                finite(&format!("initial.mean[{k}]"), mean[k])?;
                positive(&format!("initial.deviation[{k}]"), deviation[k])?;
            }
        }
        Ok(())
    }

    /// Mean and deviation of q and of v, 0 of a point; None for the stationary law.
    pub(crate) fn mean_and_deviation(&self) -> Option<[[f64; 2]; 2]> {
        match *self {
            Self::Gaussian { mean, deviation } => Some([mean, deviation]),
            Self::Rest => Some([[0.0; 2]; 2]),
            Self::Stationary => None,
        }
    }

    /// The name used in scenes.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Gaussian { .. } => "gaussian",
            Self::Rest => "rest",
            Self::Stationary => "stationary",
        }
    }
}
