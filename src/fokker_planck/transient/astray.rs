//! What the steps of a flow map do to motions without noise. Runs with as many steps share it, and the error constants of the
//! splitting know nothing of motions faster than small ones, nor of energies far above those of the law.

use super::error_estimate::{TAIL, Table};
use super::output::Output;
use crate::fokker_planck::flow_map::Settings;
use crate::initial::Initial;
use crate::moments::{Moment, Moments, RawMoments};
use crate::oscillator::Oscillator;

/// The rule of Gauss and Hermite with five points for a standard normal law.
const RULE: [(f64, f64); 5] = [
    (-2.856_970_013_872_806, 0.011_257_411_327_720_69),
    (-1.355_626_179_974_266, 0.222_075_922_005_612_6),
    (0.0, 0.533_333_333_333_333_3),
    (1.355_626_179_974_266, 0.222_075_922_005_612_6),
    (2.856_970_013_872_806, 0.011_257_411_327_720_69),
];

/// Steps that motions are followed for; by then the law has spread over their phases, and what they have lost too much or too
/// little of their energy is held.
const FOLLOWED: f64 = 64.0;

/// What the steps have done to each number at each output, from those that the initial condition is carried by and twice as many.
/// Zeros where that is the stationary law or a point at rest.
pub(super) fn astray(
    (oscillator, initial): (&Oscillator, &Initial),
    steps: &Settings,
    outputs: &[Output],
    scales: &Table,
) -> Table {
    let mut table = vec![[0.0; 11]; outputs.len()];
    let Initial::Gaussian { mean, deviation } = initial else {
        return table;
    };
    let grid = RULE.iter().flat_map(|a| RULE.iter().map(move |b| (a, b)));
    let (mut states, weights): (Vec<[f64; 2]>, Vec<f64>) = grid
        .map(|((x, a), (y, b))| {
            let start = [mean[0] + x * deviation[0], mean[1] + y * deviation[1]];
            (start, a * b)
        })
        .unzip();
    let mut finer = states.clone();
    let (mut now, mut done, mut last) = (0.0, 0.0, [0.0; 11]);
    for ((row, it), scale) in table.iter_mut().zip(outputs).zip(scales) {
        let interval = it.t - now;
        if interval > 0.0 {
            done += steps.steps(interval);
            if done > FOLLOWED {
                // In parts of the normalisation.
                *row = std::array::from_fn(|i| last[i] * scale[i]);
                continue;
            }
            now = it.t;
            steps.carry(oscillator, &mut states, (interval, 1.0));
            steps.carry(oscillator, &mut finer, (interval, 2.0));
        }
        let [coarse, fine] = [&states, &finer].map(|it| moments(oscillator, it, &weights));
        *row = differences([&coarse, &fine], &it.moments);
        for (i, last) in last.iter_mut().enumerate() {
            let here = if row[i] == 0.0 {
                0.0
            } else {
                row[i] / scale[i]
            };
            *last = f64::max(*last, here);
        }
    }
    table
}

/// The moments of states with weights.
fn moments(oscillator: &Oscillator, states: &[[f64; 2]], weights: &[f64]) -> Moments {
    let contact = oscillator.contact();
    let mut raw = RawMoments::default();
    for ([q, v], w) in states.iter().zip(weights) {
        let force = contact.force(*q);
        raw.mass += w;
        raw.q += w * q;
        raw.qq += w * q * q;
        raw.v += w * v;
        raw.vv += w * v * v;
        raw.qv += w * q * v;
        for (n, of) in (1..).zip(&mut raw.force) {
            *of += w * force.powi(n);
        }
        raw.potential += w * contact.potential(*q);
    }
    raw.moments(contact)
}

/// How the moments of two ensembles differ. A few points have no shape and no tail: what these change by is as the deviation of
/// the force and the mean displacement of the law change, which noise is in too.
fn differences([a, b]: [&Moments; 2], law: &Moments) -> [f64; 11] {
    let value = |it: &Moments, of: Moment| it.get(of).map_or(0.0, |it| it.value);
    let change = |of: Moment| (value(a, of) - value(b, of)).abs();
    let over = |change: f64, size: f64| if change == 0.0 { 0.0 } else { change / size };
    let wider = over(change(Moment::StdForce), law.std_force.value);
    let moved = over(change(Moment::MeanQ), law.var_q.value.sqrt());
    std::array::from_fn(|i| match Moment::ALL[i] {
        Moment::SkewnessForce | Moment::KurtosisForce => TAIL[i] * wider,
        Moment::ContactLossProbability => TAIL[i] * moved,
        of => change(of),
    })
}
