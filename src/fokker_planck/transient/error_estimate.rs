//! Error estimates of a transient: what its mesh, its steps, the truncation of its domain and its roundings may
//! have done to each number, kept apart until they are added.

use super::propagator;
use super::recipe::Scheme;
use super::run::{Output, Run, Task};
use crate::contact::ContactLaw;
use crate::estimate::{Estimate, Origin};
use crate::fokker_planck::flow_map;
use crate::fokker_planck::settings::TimeScheme;
use crate::moments::{Moment, Moments};
use crate::scales::Scales;

/// One value per number of [`Moments::named`] and output time.
pub(super) type Table = Vec<[f64; 11]>;

/// Error estimates of every number at every output time.
pub(super) struct Errors {
    /// What the mesh may have done, and with `joint` the steps as well.
    pub(super) space: Table,
    /// What the steps may have done.
    pub(super) time: Table,
    /// Whether `space` comes from two runs that differ in their steps too.
    pub(super) joint: bool,
    /// What the steps of both runs may have done alike, in natural scales.
    pub(super) alike: Vec<f64>,
    /// What the truncated domain leaves out, in natural scales.
    outside: Table,
    /// What negative cells weigh, in either run.
    undershoot: Table,
    /// What a narrow start has cost, in natural scales.
    opening: Table,
    /// Natural scales.
    scales: Table,
    /// L1 distance to the stationary law at each time from which the march was not continued, else 0.
    settled: Vec<f64>,
    /// Relative rounding of a whole run.
    rounding: f64,
}

/// Convergence of this order is believed without being seen: two thirds of what a kink of the force leaves,
/// about 3 (tests/convergence.rs).
const BELIEVED: f64 = 2.0;

/// The same for a flow map over a jump of the stiffness, as at the loss of contact of the bilinear law: two meshes
/// showed it to err up to 1.9 times what the order above makes of their difference.
const BELIEVED_AT_A_JUMP: f64 = 1.2;

/// The order of convergence that is believed of a scheme without being seen.
pub(super) fn believed(scheme: Scheme, contact: &ContactLaw) -> f64 {
    let jump = contact.loss_point().map_or(0.0, |q| contact.stiffness(q));
    if scheme == Scheme::FlowMap && jump > 1e-3 * contact.stiffness(0.0) {
        BELIEVED_AT_A_JUMP
    } else {
        BELIEVED
    }
}

/// The error of the finer of two runs over their difference, one `ratio` times as fine as the other, for
/// convergence of an order. Faster convergence leaves a smaller error.
pub(super) fn beyond(ratio: f64, order: f64) -> f64 {
    1.0 / (ratio.powf(order) - 1.0).max(0.0)
}

/// Negative cells of a mesh 1.2 times as fine that weigh less than this are on their way to nothing, with
/// order 2.4 or more.
const CONVERGING: f64 = 0.62;

/// A difference that passes through zero, on its way from one output to the next or beside those of the
/// other numbers, is not taken for less than this part of its neighbours'.
const NEIGHBOURS: f64 = 0.5;
const OTHERS: f64 = 0.3;

/// What is believed of a packet's difference: its cells and steps move with a density that stays smooth in its
/// frame, and converge with order 4 at least where 2 is believed of a mesh: 1/(1 + 1.2^2) of what is left.
const FRAMED: f64 = 0.41;

/// `factor` times the differences of two runs, none far below those of its neighbours: the times within
/// a quarter of a period for the same number, the other numbers at the same time.
pub(super) fn differences(a: &Run, b: &Run, factor: f64, scales: &Scales) -> Table {
    const QUARTER: f64 = 1.6;
    let plain: Table = a
        .outputs
        .iter()
        .zip(&b.outputs)
        .map(|(a, b)| {
            let (x, y) = (a.moments.named(), b.moments.named());
            let factor = if a.framed && b.framed {
                FRAMED * factor
            } else {
                factor
            };
            std::array::from_fn(|i| match (x[i].1, y[i].1) {
                (Some(x), Some(y)) => factor * (x.value - y.value).abs(),
                _ => 0.0,
            })
        })
        .collect();
    let near = |k: usize, l: usize| (a.outputs[k].t - a.outputs[l].t).abs() <= QUARTER;
    let mut table = plain.clone();
    for (k, row) in table.iter_mut().enumerate() {
        let scale = scales.each(&a.outputs[k].moments);
        let before = (0..k).rev().take_while(|l| near(k, *l));
        let after = (k + 1..plain.len()).take_while(|l| near(k, *l));
        for l in before.chain(after) {
            let weights = likeness(&a.outputs[l].moments, &a.outputs[k].moments);
            for ((x, neighbour), weight) in row.iter_mut().zip(&plain[l]).zip(weights) {
                *x = x.max(NEIGHBOURS * weight * neighbour);
            }
        }
        // Kurtosis and skewness of a narrow force may err far more than anything else: the median speaks
        // for the density.
        let mut sorted: Vec<f64> = plain[k].iter().zip(scale).map(|(x, s)| x / s).collect();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted[sorted.len() / 2];
        for (x, s) in row.iter_mut().zip(scale) {
            *x = x.max(OTHERS * middle * s);
        }
    }
    table
}

/// What an error of each number at one time means for that at another: shapes err as the third and fourth
/// power of a deviation that may be far smaller there.
fn likeness(there: &Moments, here: &Moments) -> [f64; 11] {
    let ratio = (there.std_force.value / here.std_force.value).min(1.0);
    // Without a deviation there is no shape, and nothing to scale.
    let ratio = if ratio.is_finite() { ratio } else { 1.0 };
    let mut weights = [1.0; 11];
    weights[Moment::SkewnessForce as usize] = ratio.powi(3);
    weights[Moment::KurtosisForce as usize] = ratio.powi(4);
    weights
}

/// What the truncated domain leaves out of each number at one time, in natural scales: `outside` is that of the
/// stationary law, whose tails no start within the box outweighs. A number far above its scale, as a
/// kurtosis may be, moves with itself.
fn boxed(it: &Output, scale: &[f64; 11], outside: [f64; 11]) -> [f64; 11] {
    if it.framed {
        return [0.0; 11];
    }
    let named = it.moments.named();
    std::array::from_fn(|i| {
        let size = named[i]
            .1
            .map_or(0.0, |number| number.value.abs() / scale[i]);
        outside[i] * size.max(1.0)
    })
}

/// What a change of the density by its L1 norm weighs in each number, in natural scales: more in what weighs the
/// tails. For what a packet's mass lost and what a settled run leaves out. Chosen, not measured one by one; the
/// bars that they make are held against truths by the calibration.
pub(super) const TAIL: [f64; 11] = [1.0, 2.0, 1.0, 2.0, 2.0, 1.0, 2.0, 5.0, 10.0, 2.0, 1.0];

/// How far a mean may still go after a run has settled, over its L1 distance to the stationary law then: from one
/// crest of the slowest oscillation to the next trough, 2/sqrt(2/pi) of it for a Gaussian.
const SWING: f64 = 2.5;

/// What a narrow start has cost each number, in natural scales. A packet errs in proportion to its own
/// size: a deviation, and with it a mean, by so much of its deviation, a variance of its variance.
fn opened(it: &Output, scale: &[f64; 11]) -> [f64; 11] {
    let cost = TAIL.map(|weight| it.opening.spread + weight * it.opening.tail);
    if !it.framed {
        return cost;
    }
    let m = &it.moments;
    let energy = 0.5 * (m.var_v.value + m.var_q.value);
    let [q, v, n] = [m.var_q.value, m.var_v.value, m.std_force.value.powi(2)].map(f64::sqrt);
    let speed = m.mean_v.value.abs() * v + m.mean_force.value.abs() * q;
    let own = [
        q,
        q * q,
        v,
        v * v,
        q * v,
        n,
        n,
        1.0,
        1.0,
        energy + speed,
        1.0,
    ];
    std::array::from_fn(|i| {
        if own[i] < scale[i] {
            cost[i] * own[i] / scale[i]
        } else if scale[i] > 0.0 {
            cost[i]
        } else {
            0.0
        }
    })
}

/// What negative cells weigh in the error of a number, from what they weigh in a fine and in a coarse run.
/// Where they converge the difference of the runs holds what they do; where they stand, both may agree on
/// what is wrong.
fn standing(fine: f64, coarse: f64) -> f64 {
    if fine < CONVERGING * coarse {
        0.0
    } else {
        fine.max(coarse)
    }
}

/// What the steps may have done over what they say of it (tests/time.rs).
const DOUBT: f64 = 2.0;

/// What an error of the steps in the L1 norm does to a number in its natural scale, beside what two runs with
/// different steps show of it: with 0.08 means of one scene of the calibration erred 1.8 times their error estimates.
const IN_MOMENTS: f64 = 0.2;

/// What the steps of both runs may have done alike by each output, in natural scales.
fn alike(task: &Task, fine: &Run) -> Vec<f64> {
    let outputs = fine.outputs.iter();
    match task.recipe.scheme {
        Scheme::Volumes(TimeScheme::Explicit) => outputs
            .map(|_| propagator::SERIES_SHARE * task.recipe.tolerance)
            .collect(),
        // Steps that choose themselves by the same estimate.
        Scheme::Volumes(_) => {
            let part = if task.recipe.knows_its_steps() {
                DOUBT
            } else {
                IN_MOMENTS
            };
            outputs.map(|it| part * it.step_error).collect()
        }
        // Two runs show little of what the steps of a flow map do: short intervals are cut alike or by other
        // rules, and the errors of either pass through zero between them.
        Scheme::FlowMap => {
            let settings = task.recipe.flow_map(task.oscillator, 1.0);
            let splitting = settings.map_or(0.0, |it| {
                // A mesh may ask for longer steps than the tolerance does.
                let step = fine.step;
                flow_map::Settings { step, ..it }.splitting_error(task.oscillator)
            });
            let rate = 4.0 * task.oscillator.zeta();
            // The stationary law suffers no splitting error: what there is fades with the distance to it,
            // its rates being off by a part of themselves.
            let left = |it: &Output| {
                let fading = it.distance * (1.0 + rate * it.t);
                IN_MOMENTS * splitting * fading.min(1.0)
            };
            outputs
                .map(|it| if it.steps > 0 { left(it) } else { 0.0 })
                .collect()
        }
    }
}

/// The probability that two runs leave out.
pub(super) fn outside(task: &Task, fine: &Run, coarse: &Run) -> f64 {
    let outside = fine.domain.neglected.max(coarse.domain.neglected);
    if task.oscillator.contact().is_confining() {
        return outside;
    }
    // Open edges let go what comes to them, again and again.
    let outputs = fine.outputs.iter().chain(&coarse.outputs);
    let gone = outputs.map(|o| (1.0 - o.mass).abs()).fold(0.0, f64::max);
    outside.max(gone)
}

impl Errors {
    /// Those of a fine run from its difference to a coarse one, `factor` times.
    pub(super) fn between(task: &Task, run: &Run, coarse: &Run, factor: f64) -> Self {
        let natural = Scales::of(task.oscillator);
        let left_out = outside(task, run, coarse);
        let weights = run.domain.tail_weights(task.oscillator);
        // What the truncated domain leaves out, in natural scales of the stationary law.
        let outside = weights.map(|weight| weight * left_out);
        let none = vec![[0.0; 11]; run.outputs.len()];
        let scales: Table = run
            .outputs
            .iter()
            .map(|it| natural.each(&it.moments))
            .collect();
        Self {
            space: differences(run, coarse, factor, &natural),
            time: none,
            joint: true,
            alike: alike(task, run),
            outside: run
                .outputs
                .iter()
                .zip(&scales)
                .map(|(it, scale)| boxed(it, scale, outside))
                .collect(),
            undershoot: run
                .outputs
                .iter()
                .zip(&coarse.outputs)
                .map(|(a, b)| std::array::from_fn(|i| standing(a.undershoot[i], b.undershoot[i])))
                .collect(),
            opening: run
                .outputs
                .iter()
                .zip(&scales)
                .map(|(it, scale)| opened(it, scale))
                .collect(),
            settled: run
                .outputs
                .iter()
                .map(|it| match run.settled {
                    Some(since) if it.t >= since => it.distance,
                    _ => 0.0,
                })
                .collect(),
            scales,
            rounding: f64::EPSILON * (run.steps as f64 + 10.0),
        }
    }

    /// Takes `factor` times what two runs differ by for what the mesh may have done.
    pub(super) fn scale_space(&mut self, factor: f64) {
        for x in self.space.iter_mut().flatten() {
            *x *= factor;
        }
    }

    /// What two runs share of the error of number i at time k, in natural scales.
    fn shared(&self, k: usize, i: usize) -> f64 {
        SWING * TAIL[i] * self.settled[k] + self.opening[k][i] + self.alike[k]
    }

    /// Parts of the error of number i at time k: space, time, domain, rounding.
    fn parts(&self, k: usize, i: usize, value: f64) -> [(f64, Origin); 4] {
        let scale = self.scales[k][i];
        let shared = self.shared(k, i);
        [
            (self.space[k][i] + self.undershoot[k][i], Origin::Space),
            (self.time[k][i] + shared * scale, Origin::Time),
            (self.outside[k][i] * scale, Origin::Domain),
            (self.rounding * (scale + value.abs()), Origin::Rounding),
        ]
    }

    /// Writes the errors into the numbers of time k; the origin is that of the largest part.
    pub(super) fn write(&self, k: usize, moments: &mut Moments) {
        for (i, number) in moments.each_mut().into_iter().enumerate() {
            if let Some(number) = number {
                let parts = self.parts(k, i, number.value);
                let total = parts.iter().map(|part| part.0).sum();
                let largest = parts.iter().max_by(|a, b| a.0.total_cmp(&b.0));
                let origin = largest.map_or(Origin::Space, |part| part.1);
                *number = Estimate::new(number.value, total, origin);
            }
        }
    }

    /// The largest of `part` over the natural scale, with number and time.
    fn largest(&self, part: impl Fn(usize, usize) -> f64) -> (f64, usize, usize) {
        let mut worst = (0.0, 0, 0);
        for (k, scale) in self.scales.iter().enumerate() {
            for (i, scale) in scale.iter().enumerate() {
                // A number that is 0 without error has no scale where the scale is its value.
                let here = match part(k, i) {
                    0.0 => 0.0,
                    part => part / scale,
                };
                if here > worst.0 || here.is_nan() {
                    worst = (here, k, i);
                }
            }
        }
        worst
    }

    /// The largest error over the natural scale, with its time and number.
    pub(super) fn worst(&self, run: &Run) -> (f64, usize, usize) {
        self.largest(|k, i| match run.outputs[k].moments.get(Moment::ALL[i]) {
            None => 0.0,
            // A force without a width has no shape.
            Some(it) if it.value.is_nan() && Moment::ALL[i].is_shape() => 0.0,
            Some(it) => self.parts(k, i, it.value).iter().map(|it| it.0).sum(),
        })
    }

    /// The largest part of the mesh over the natural scale, negative cells included.
    pub(super) fn worst_space(&self) -> f64 {
        self.largest(|k, i| self.space[k][i] + self.undershoot[k][i])
            .0
    }

    /// The largest part that neither mesh nor steps are known to change, over the natural scale.
    pub(super) fn worst_fixed(&self) -> f64 {
        self.largest(|k, i| {
            (self.outside[k][i] + self.shared(k, i) + self.rounding) * self.scales[k][i]
        })
        .0
    }

    /// The largest part of the steps over the natural scale.
    pub(super) fn worst_time(&self) -> f64 {
        self.largest(|k, i| self.time[k][i]).0
    }

    /// The largest part of the truncated domain, over the natural scale.
    pub(super) fn worst_outside(&self) -> f64 {
        self.outside.iter().flatten().copied().fold(0.0, f64::max)
    }
}
