//! What a run says at one time.

use crate::fokker_planck::density::Snapshot;
use crate::moments::Moments;

/// What a change of the density by its L1 norm weighs in each number, over its normalisation: more in what weighs the
/// tails. For the mass that a local grid lost, what a settled run leaves out, and a shape under another deviation. Chosen, not measured one by one; the
/// error estimates that they make are held against reference solutions by the calibration.
pub(super) const TAIL: [f64; 11] = [1.0, 2.0, 1.0, 2.0, 2.0, 1.0, 2.0, 5.0, 10.0, 2.0, 1.0];

/// One run at one time.
#[derive(Clone, Default)]
pub(super) struct Output {
    pub(super) t: f64,
    pub(super) moments: Moments,
    pub(super) mass: f64,
    pub(super) lowest: f64,
    pub(super) negative: f64,
    /// What the negative cells weigh in each number.
    pub(super) undershoot: [f64; 11],
    pub(super) entropy: f64,
    pub(super) distance: f64,
    /// What a stationary law that is solved for may be off in both.
    pub(super) doubt: [f64; 2],
    pub(super) snapshot: Option<Snapshot>,
    /// Steps up to here on the mesh, those of a local grid not counted.
    pub(super) steps: u64,
    /// What they are known to have left, in the L1 norm: embedded estimates of schemes of finite volumes.
    pub(super) step_error: f64,
    /// Probability that the local grid of a concentrated initial condition has lost so far, that a periodic law leaves open, or
    /// that moves against too little friction on coarse cells; and rounding.
    pub(super) lost: f64,
    /// Whether a local grid in its own frame said it, not a density in the truncated domain.
    pub(super) framed: bool,
}
