//! A number of a run beside what it is known to be.

use super::references::Reference;
use std::cmp::Ordering::{Equal, Less};
use vibroimpact::moments::Moment;

/// A reference solution judges error estimates of a tolerance if it is ten times as good.
const TEN: f64 = 10.0;

/// What a reference solution may be off by, over its stated uncertainty: that is the difference of two resolutions, and
/// of starts that both hold badly it is too small (probabilities of -2.1e-4 ± 0.9e-4 and -4.1e-4 ± 3e-4
/// that are 0).
pub(super) const DOUBT: f64 = 3.0;

/// A number beside its reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judged {
    pub reference: Reference,
    pub value: f64,
    pub estimate: f64,
    pub scale: f64,
}

impl Judged {
    pub fn error(&self) -> f64 {
        (self.value - self.reference.value).abs()
    }

    /// What its reference may be off by.
    pub fn doubt(&self) -> f64 {
        DOUBT * self.reference.uncertainty
    }

    /// Whether its reference is good enough to judge error estimates of this tolerance.
    pub fn counts(&self, tolerance: f64) -> bool {
        TEN * self.doubt() <= tolerance * self.scale
    }

    /// Whether the error is above its estimate, whatever the reference may be off by.
    pub fn too_small(&self) -> bool {
        !within(self.error(), self.estimate + self.doubt())
    }

    /// Whether the error estimate is above the tolerance.
    pub fn beyond(&self, tolerance: f64) -> bool {
        // An estimate of the tolerance itself is within it, last digit or not.
        !within(self.estimate, (1.0 + 1e-9) * tolerance * self.scale)
    }

    /// Whether the error is above its estimate, the reference solution taken for exact.
    pub fn too_small_bare(&self) -> bool {
        !within(self.error(), self.estimate)
    }

    /// Error estimate over true error, where the reference can tell the error.
    pub fn ratio(&self) -> Option<f64> {
        (self.error() > self.doubt()).then(|| self.estimate / self.error())
    }

    pub fn name(&self) -> &'static str {
        Moment::ALL[self.reference.index].name()
    }
}

/// a <= b; what is no number is within nothing.
fn within(a: f64, b: f64) -> bool {
    matches!(a.partial_cmp(&b), Some(Less | Equal))
}
