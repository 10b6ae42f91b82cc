//! The stationary law of a friction that depends on the displacement, at resolutions that agree.

use super::friction::{Kept, heavy, work};
use super::operator::Resolution;
use crate::error::{Error, Result};
use crate::fokker_planck::convergence::{UNKNOWN, left, left_of};
use crate::fokker_planck::policy::SETTLED_LAW_SHARE;
use crate::oscillator::Oscillator;

/// A stationary law at two resolutions, of which the finer is believed: what distances are taken to.
#[derive(Debug, Clone)]
pub(in crate::fokker_planck) struct Settled {
    pub(in crate::fokker_planck) law: Kept,
    pub(in crate::fokker_planck) coarser: Kept,
    /// What it may be off, in L1.
    pub(in crate::fokker_planck) error: f64,
    /// That over the distance of the two: what a difference of them leaves.
    pub(in crate::fokker_planck) left: f64,
}

/// The coarsest resolution of such a law, and how many there are at most: the last has
/// as many functions as ten seconds solve for.
const FIRST: Resolution = Resolution {
    elements: 4,
    pairs: 10,
    level: 18.0,
};
const MOST: usize = 6;

/// Two laws are no farther apart in L1: where they seem to be, rounding spoils this resolution and finer ones.
const FARTHEST: f64 = 2.0;

impl Settled {
    /// Bytes and operations of the two resolutions that most laws take.
    pub(in crate::fokker_planck) fn work() -> (u64, f64) {
        let [first, second] = [FIRST, FIRST.refined(1)].map(work);
        (second.0, first.1 + second.1)
    }

    /// The law to an L1 error of its share of a tolerance, or as near as resolutions get before rounding spoils a finer one.
    ///
    /// # Errors
    /// Those of [`Kept::new`].
    pub(in crate::fokker_planck) fn within(
        oscillator: &Oscillator,
        tolerance: f64,
        late: &dyn Fn() -> Result<()>,
    ) -> Result<Self> {
        let mut resolution = FIRST;
        let mut coarser = Kept::new(oscillator, resolution, late)?;
        let mut best: Option<Self> = None;
        let mut before = None;
        for _ in 1..MOST {
            resolution = resolution.refined(1);
            let law = match Kept::new(oscillator, resolution, late) {
                Err(Error::Linear { .. } | Error::Unresolved { .. }) if best.is_some() => break,
                law => law?,
            };
            let change = law.distance(&coarser);
            if change > FARTHEST && best.is_some() {
                break;
            }
            let error = before.map_or(left(UNKNOWN) * change, |it| left_of([it, change]))
                + left(UNKNOWN) * law.rounding;
            before = Some(change);
            let coarser = std::mem::replace(&mut coarser, law.clone());
            let known = best.as_ref().map_or(f64::INFINITY, |it: &Self| it.error);
            if error < known && change <= FARTHEST {
                best = Some(Self {
                    law,
                    coarser,
                    error,
                    left: error / change.max(f64::MIN_POSITIVE),
                });
            }
            if error <= SETTLED_LAW_SHARE.get() * tolerance {
                break;
            }
        }
        best.ok_or_else(|| heavy(oscillator, "and no two resolutions agree"))
    }
}
