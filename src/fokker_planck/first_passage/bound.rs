//! First passages that next to never happen: bounded by those of the stationary law, where no mesh tells them.
//!
//! Whatever part of an initial condition p0 has energies below E has no more density than max p0 over the stationary law at E,
//! times the stationary law; so it passes no more often than that times nu t, nu being Rice's rate of the passages of exp(-H/T)/Z.
//! The part above E is counted as passed.

use super::region::{Barrier, Region};
use crate::error::Result;
use crate::fokker_planck::domain::start_outside;
use crate::gaussian::{lower, normal};
use crate::initial::Initial;
use crate::oscillator::DisplacementLaw;
use std::f64::consts::TAU;

/// Least density of the stationary law at a level by which passages are known from detailed balance: below it lines that count
/// underflow.
pub(super) const SEEN: f64 = 1e-280;
/// What may pass unseen: half the rounding of a survival near 1.
const UNSEEN: f64 = 1e-16;
/// ln of that over what passes of the energies below E.
const LITTLE: f64 = 5.0;
/// Deviation of a motion at rest, in those of the stationary law: it passes less often than one that is not quite.
const OF_REST: f64 = 0.1;

/// What answers.
pub(super) const BY: &str = "bounded by the passages of the stationary law";

/// Passages at the most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bound {
    /// P(passed up to the last time).
    pub(super) lost: f64,
    /// Rate in the end.
    pub(super) rate: f64,
}

impl Bound {
    /// Where the stationary law of viscous friction hardly reaches the levels, and no more than the rounding of a survival
    /// passes up to the time `until`.
    pub(super) fn of(region: &Region<'_>, initial: &Initial, until: f64) -> Result<Option<Self>> {
        let it = region.oscillator;
        if !it.is_viscous() {
            return Ok(None);
        }
        let law = it.displacement_law()?;
        let Barrier { low, high, .. } = region.barrier;
        let ln = |x: f64| law.ln_density(region.q(x));
        let crossed = ln(low).max(high.map_or(f64::NEG_INFINITY, ln));
        if crossed > SEEN.ln() {
            return Ok(None);
        }
        let both = if high.is_some() { 2.0 } else { 1.0 };
        let deviation = it.temperature().sqrt();
        let rice = crossed + (both * deviation * normal(0.0)).ln();
        let [from, to] = region.range(low, high.unwrap_or(f64::INFINITY));
        let rate = (rice - law.ln_between(from, to).value).exp() + f64::MIN_POSITIVE;
        let rest = Initial::Gaussian {
            mean: [0.0; 2],
            deviation: [OF_REST * deviation; 2],
        };
        let gaussian = |it: &Initial| from_a_gaussian(region, &law, it, rice + until.ln());
        let lost = match initial {
            Initial::Stationary => rate * until,
            Initial::Rest => gaussian(&rest),
            Initial::Gaussian { .. } => gaussian(initial),
        };
        // NaN bounds nothing.
        Ok((lost < UNSEEN && rate < UNSEEN).then_some(Self { lost, rate }))
    }
}

/// P(passed) from a Gaussian at the most, if the stationary law passes so often up to then.
fn from_a_gaussian(
    region: &Region<'_>,
    law: &DisplacementLaw,
    initial: &Initial,
    ln_passages: f64,
) -> f64 {
    let Initial::Gaussian { mean, deviation } = region.seen(initial) else {
        return f64::NAN;
    };
    let (it, t) = (region.oscillator, region.oscillator.temperature());
    let Some(bottom) = it.contact().equilibrium() else {
        return f64::NAN;
    };
    // ln of the largest density, over that of the stationary law where it is largest.
    let above =
        -(TAU * deviation[0] * deviation[1]).ln() - law.ln_density(bottom) + 0.5 * (TAU * t).ln();
    let energy = t * (UNSEEN.ln() - LITTLE - above - ln_passages);
    if energy.is_nan() || energy <= 0.0 {
        return f64::NAN;
    }
    let Barrier { low, high, .. } = region.barrier;
    let below = |x: f64| lower((x - mean[0]) / deviation[0]);
    let beyond = below(low) + high.map_or(0.0, |high| below(2.0 * mean[0] - high));
    // Its quadrature ends nine deviations away.
    let outside = start_outside(it, initial, energy) + 2.0 * lower(-9.0);
    beyond + outside + (-LITTLE).exp() * UNSEEN
}

#[cfg(test)]
mod tests {
    use super::Bound;
    use crate::contact::ContactLaw;
    use crate::fokker_planck::first_passage::region::{Barrier, Region};
    use crate::initial::Initial;
    use crate::oscillator::{Oscillator, Side, Target};

    const GAUSSIAN: Initial = Initial::Gaussian {
        mean: [0.1, 0.0],
        deviation: [0.02, 0.03],
    };

    /// Of a linear oscillator with T = 1e-4, beyond `level` deviations.
    fn bound(initial: &Initial, (level, side): (f64, Side), until: f64) -> Option<Bound> {
        let h = 2.0 * 0.05 * 1e-4 / std::f64::consts::PI;
        let oscillator = Oscillator::new(ContactLaw::Linear, 0.05, h).unwrap();
        let target = Target::Level(1e-2 * level, side);
        let barrier = Barrier::of(target, target.range(&oscillator, initial).unwrap());
        Bound::of(&Region::new(&oscillator, barrier), initial, until).unwrap()
    }

    #[test]
    fn it_is_rice_s_rate_and_more_from_elsewhere() {
        let at = (37.0, Side::Above);
        let it = bound(&Initial::Stationary, at, 10.0).unwrap();
        let rice = (-0.5f64 * 37.0 * 37.0).exp() / std::f64::consts::TAU;
        assert!((it.rate / rice - 1.0).abs() < 1e-9, "{it:?} {rice:e}");
        assert!((it.lost / (10.0 * rice) - 1.0).abs() < 1e-9, "{it:?}");
        let either = bound(&Initial::Stationary, (37.0, Side::Either), 10.0).unwrap();
        assert!((either.rate / rice - 2.0).abs() < 1e-9, "{either:?}");
        for initial in [Initial::Rest, GAUSSIAN] {
            let from = bound(&initial, at, 10.0).unwrap();
            assert!(from.lost > it.lost && from.lost < 1e-16, "{from:?}");
        }
    }

    #[test]
    fn what_may_pass_is_left_to_the_mesh() {
        // A level that is seen; and one that the initial condition reaches at once, or a motion from it.
        let at = |initial: &Initial, level: f64, side| bound(initial, (level, side), 10.0);
        assert!(at(&Initial::Stationary, 30.0, Side::Above).is_none());
        assert!(at(&GAUSSIAN, 37.0, Side::Above).is_some());
        let far = |mean: [f64; 2]| Initial::Gaussian {
            mean,
            deviation: [0.02, 0.03],
        };
        for mean in [[0.25, 0.0], [0.0, 0.2], [-0.3, 0.0]] {
            assert!(at(&far(mean), 37.0, Side::Above).is_none(), "{mean:?}");
        }
        assert!(at(&far([0.5, 0.0]), -37.0, Side::Above).is_none());
    }
}
