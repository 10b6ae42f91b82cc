//! What the steps of a flow map do to motions without noise. Runs with as many steps share it, and the error constants of the
//! splitting know nothing of motions faster than small ones, nor of energies far above those of the law.

use super::output::{Output, TAIL};
use crate::fokker_planck::flow_map::Settings;
use crate::initial::Initial;
use crate::moments::{Moment, Moments, PerMoment, RawMoments};
use crate::oscillator::Oscillator;

/// The rule of Gauss and Hermite with five points for a standard normal law.
const RULE: [(f64, f64); 5] = [
    (-2.856_970_013_872_806, 0.011_257_411_327_720_69),
    (-1.355_626_179_974_266, 0.222_075_922_005_612_6),
    (0.0, 0.533_333_333_333_333_3),
    (1.355_626_179_974_266, 0.222_075_922_005_612_6),
    (2.856_970_013_872_806, 0.011_257_411_327_720_69),
];

/// Steps that motions are followed for: later friction has taken of their energy what is beyond that of the law, or a law that
/// wide has spread over their phases.
const FOLLOWED: f64 = 64.0;

/// What the steps have done to each number at each output, from those that the initial condition is carried by and twice as many:
/// zeros of the probability of loss, of which a few points tell nothing, after [`FOLLOWED`] steps, and where it begins in the
/// stationary law or at rest. What is carried for less than `shortest` is carried once more from before, as densities are.
pub(super) fn astray(
    (oscillator, initial): (&Oscillator, &Initial),
    (steps, shortest): (&Settings, f64),
    outputs: &[Output],
) -> Vec<PerMoment<f64>> {
    let mut table = vec![[0.0; 11]; outputs.len()];
    let Initial::Gaussian { mean, deviation } = initial else {
        return table;
    };
    let grid = RULE.iter().flat_map(|a| RULE.iter().map(move |b| (a, b)));
    let (states, weights): (Vec<[f64; 2]>, Vec<f64>) = grid
        .map(|((x, a), (y, b))| {
            let start = [mean[0] + x * deviation[0], mean[1] + y * deviation[1]];
            (start, a * b)
        })
        .unzip();
    let mut from = [states.clone(), states];
    let (mut since, mut done) = (0.0, 0.0);
    for (row, it) in table.iter_mut().zip(outputs) {
        let interval = it.t - since;
        let mut both = from.clone();
        if interval > 0.0 {
            done += steps.steps(interval);
            if done > FOLLOWED {
                break;
            }
            for (states, finer) in both.iter_mut().zip([1.0, 2.0]) {
                steps.carry(oscillator, states, (interval, finer));
            }
        }
        let [coarse, fine] = both.each_ref().map(|it| moments(oscillator, it, &weights));
        *row = differences([&coarse, &fine], &it.moments);
        if interval >= shortest {
            (from, since) = (both, it.t);
        }
    }
    table
}

/// The moments of states with weights.
fn moments(oscillator: &Oscillator, states: &[[f64; 2]], weights: &[f64]) -> Moments {
    let contact = oscillator.contact();
    let mut raw = RawMoments::default();
    for ([q, v], w) in states.iter().zip(weights) {
        raw.add(contact, *q, [*w, w * v, w * v * v]);
    }
    raw.moments(contact)
}

/// How the moments of two ensembles differ. A few points have no shape: what it changes by is as the deviation of the force does,
/// over that of the law, which noise is in too.
fn differences([a, b]: [&Moments; 2], law: &Moments) -> PerMoment<f64> {
    let value = |it: &Moments, of: Moment| it.get(of).map_or(0.0, |it| it.value);
    let change = |of: Moment| (value(a, of) - value(b, of)).abs();
    let (wider, std) = (change(Moment::StdForce), law.std_force.value);
    let wider = if std > 0.0 { wider / std } else { 0.0 };
    std::array::from_fn(|i| match Moment::ALL[i] {
        Moment::SkewnessForce | Moment::KurtosisForce => TAIL[i] * wider,
        Moment::ContactLossProbability => 0.0,
        of => change(of),
    })
}
