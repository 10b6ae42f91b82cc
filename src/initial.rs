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
        for k in 0..2 {
            finite("initial.mean", mean[k])?;
            positive("initial.deviation", deviation[k])?;
        }
        Ok(Self::Gaussian { mean, deviation })
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
