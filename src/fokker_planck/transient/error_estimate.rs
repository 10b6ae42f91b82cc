//! Error estimates of a transient: what its mesh, its steps, the truncation of its domain and its roundings may
//! have done to each number, kept apart until they are added.

use super::astray::astray;
use super::output::{Output, TAIL};
use super::propagator::shortest;
use super::recipe::{Rung, Scheme};
use super::run::{Run, Task};
use crate::estimate::{Estimate, Origin};
use crate::excitation::Drive;
use crate::fokker_planck::flow_map;
use crate::fokker_planck::policy::{AS_MANY, CARRIED, FLOOR, LADDER_RATIO, LEFT, SAFETY, UNSEEN};
use crate::moments::{Moment, Moments, PerMoment};
use crate::scales::Scales;
use std::iter::repeat_n;

/// One value per number of [`Moments::named`] and output time.
pub(super) type Table = Vec<PerMoment<f64>>;

/// Error estimates of every number at every output time.
pub(super) struct Errors {
    /// What mesh, steps and truncated domain may have done, and no less than steps do to motions without noise.
    pub(super) space: Table,
    /// What the steps of the scene may have done.
    time: Table,
    /// What negative cells weigh.
    undershoot: Table,
    /// What lost probability and a stationary initial condition that is solved for have done, over the normalisation.
    lost: Table,
    /// What all rungs err alike at each time, over the normalisation.
    shared: Vec<f64>,
    /// Normalisations.
    scales: Table,
    /// L1 distance to the stationary law at each time from which the integration was not continued, else 0.
    settled: Vec<f64>,
    /// Relative rounding of a whole run.
    rounding: f64,
}

/// Moments that the motion turns into each other, N being a function of q; and the shape of the law of N.
const FAMILIES: [&[Moment]; 3] = [
    &[Moment::MeanQ, Moment::MeanV, Moment::MeanForce],
    &[
        Moment::VarQ,
        Moment::VarV,
        Moment::CovQv,
        Moment::MeanEnergy,
    ],
    &[Moment::SkewnessForce, Moment::KurtosisForce],
];

/// The differences of a run to the one before; a number that only the finer one knows differs by anything.
fn plain(fine: &Run, coarse: &Run) -> Table {
    let rows = fine.outputs.iter().zip(&coarse.outputs);
    let row = |(a, b): (&Output, &Output)| {
        let (x, y) = (a.moments.named(), b.moments.named());
        std::array::from_fn(|i| match (x[i].1, y[i].1) {
            (Some(x), Some(y)) if y.value.is_nan() && !x.value.is_nan() => f64::INFINITY,
            (Some(x), Some(y)) => (x.value - y.value).abs(),
            _ => 0.0,
        })
    };
    rows.map(row).collect()
}

/// The largest relative difference of each number about every output time under a drive: what is wrong at one phase comes to
/// every other. About are those within the same half of a period as it and in the two beside it.
fn about(drive: &Drive, run: &Run, plain: &Table, scales: &Table) -> Table {
    let half = |it: &Output| (2.0 * it.t / drive.period()).floor();
    let mut rows = plain.iter().zip(scales);
    let mut halves: Vec<(usize, PerMoment<f64>)> = Vec::new();
    for outputs in run.outputs.chunk_by(|a, b| half(a) == half(b)) {
        let mut largest = [0.0_f64; 11];
        for (row, scale) in rows.by_ref().take(outputs.len()) {
            for (largest, (x, scale)) in largest.iter_mut().zip(row.iter().zip(scale)) {
                let x = Some(x / scale).filter(|x| x.is_finite());
                *largest = x.map_or(*largest, |x| x.max(*largest));
            }
        }
        halves.push((outputs.len(), largest));
    }
    let largest = |k: usize| {
        let beside = &halves[k.saturating_sub(1)..(k + 2).min(halves.len())];
        std::array::from_fn(|i| beside.iter().map(|it| it.1[i]).fold(0.0, f64::max))
    };
    let each = halves.iter().enumerate();
    each.flat_map(|(k, (count, _))| repeat_n(largest(k), *count))
        .collect()
}

/// Differences none of which is far below those of the moments that the motion turns into it nor, under a drive, below those of
/// other phases.
fn pooled(task: &Task, run: &Run, plain: &Table, scales: &Table) -> Table {
    let mut table = plain.clone();
    let forcing = task.recipe.forcing.as_ref();
    if let Some(drive) = forcing.and_then(|it| it.excitation().drive) {
        let about = about(&drive, run, plain, scales);
        for ((row, about), scale) in table.iter_mut().zip(&about).zip(scales) {
            for ((x, about), scale) in row.iter_mut().zip(about).zip(scale) {
                *x = x.max(CARRIED.get() * about * scale);
            }
        }
    }
    for ((row, plain), scale) in table.iter_mut().zip(plain).zip(scales) {
        for family in FAMILIES {
            let largest = family
                .iter()
                .map(|it| plain[*it as usize] / scale[*it as usize]);
            let largest = largest.fold(0.0, f64::max);
            for it in family {
                let i = *it as usize;
                row[i] = row[i].max(CARRIED.get() * largest * scale[i]);
            }
        }
    }
    table
}

/// The differences of a run to another, none far below those of its neighbours.
pub(super) fn difference(task: &Task, [run, other]: [&Run; 2], scales: &Table) -> Table {
    pooled(task, run, &plain(run, other), scales)
}

/// How far a mean may still go after a run has settled, over its L1 distance to the stationary law then: from one
/// crest of the slowest oscillation to the next trough, 2/sqrt(2/pi) of it for a Gaussian.
const SWING: f64 = 2.506_628_274_631_000_5;

/// What lost probability has done to each number, over the normalisation. A local grid errs in proportion
/// to its own size: a deviation, and with it a mean, by so much of its deviation, a variance of its variance.
fn of_lost(it: &Output, scale: &[f64; 11]) -> [f64; 11] {
    let cost = [it.lost; 11];
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
/// Where they fall with order 1 the difference of the runs holds what they do; where they stand, both may agree on
/// what is wrong.
fn standing(fine: f64, coarse: f64) -> f64 {
    if fine < coarse / LADDER_RATIO.get() {
        0.0
    } else {
        fine.max(coarse)
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

/// Error estimate over a difference of runs on a rung: the fewer the cells, the more the next order adds to the leading one. A
/// leading error of low order is more than a difference.
fn safety(rung: &Rung) -> f64 {
    let falls = LADDER_RATIO.get().powi(rung.drift().order() as i32);
    SAFETY.get() * (1.0 / (falls - 1.0)).max(1.0) * (1.0 + 1.0 / rung.per_deviation)
}

/// What the differences of three runs, `stride` rungs apart, say of the error of the finest. No order is believed: runs
/// nearer to each other differ by less of their errors.
fn of_differences(
    task: &Task,
    (rung, stride): (&Rung, f64),
    fine: &Run,
    [now, before]: [&Table; 2],
    scales: &Table,
) -> Table {
    let [mut now, before] = [now, before].map(|table| pooled(task, fine, table, scales));
    let factor = safety(rung) / stride;
    for (now, before) in now.iter_mut().flatten().zip(before.iter().flatten()) {
        let before = if before.is_finite() { *before } else { 0.0 };
        *now = factor * now.max(CARRIED.get() * before);
    }
    now
}

/// L1 error of a law that is solved for, below which its deviations are those that errors are held against.
const KNOWN: f64 = 0.1;

/// The normalisation of every number of a run: by the stationary law that was solved for, if one was and its size is known.
pub(super) fn scales(task: &Task, run: &Run) -> Table {
    let contact = task.oscillator.contact();
    let solved = task.law.filter(|it| it.error < KNOWN);
    let solved = solved.map(|it| it.law.raw().moments(contact));
    let scales = solved.map_or_else(|| Scales::of(task.oscillator), |law| Scales::of_law(&law));
    let rows = run.outputs.iter();
    rows.map(|it| scales.each(&it.moments)).collect()
}

impl Errors {
    /// Those of the finest of three runs, `stride` rungs apart.
    pub(super) fn of(
        task: &Task,
        (rung, stride): (&Rung, f64),
        [coarsest, coarse, fine]: [&Run; 3],
    ) -> Self {
        let scales = scales(task, fine);
        let (now, before) = (plain(fine, coarse), plain(coarse, coarsest));
        let space = of_differences(task, (rung, stride), fine, [&now, &before], &scales);
        let mut errors = Self::beside(task, space, scales, [coarse, fine]);
        let splitting = match rung.scheme {
            Scheme::FlowMap => {
                let mut steps = rung.flow_map();
                if let Some(period) = rung.period {
                    steps.step = period / steps.steps(period);
                }
                // Over the deviation of the law that p is taken against, which is not that of the normalisation.
                let reference = rung.reference(task.oscillator).temperature();
                let wider = (reference / task.oscillator.kinetic_temperature()).sqrt();
                let own = wider * steps.splitting_error(task.oscillator);
                let forced = rung.forcing.as_ref();
                let forced =
                    forced.map_or(0.0, |it| it.splitting_error(steps.step) + it.uneven() * own);
                own + forced
            }
            Scheme::Volumes(_) => 0.0,
        };
        // Under viscous damping, from a mesh on and not from a local grid, by steps that no scene has given: those are halved.
        let on_mesh = fine.outputs.last().is_some_and(|it| it.steps == fine.steps);
        let viscous = task.oscillator.is_viscous() && rung.acting().is_none();
        if viscous && rung.automatic && on_mesh && matches!(rung.scheme, Scheme::FlowMap) {
            let steps = flow_map::Settings {
                step: fine.step,
                ..rung.flow_map()
            };
            let shortest = shortest(rung.reference(task.oscillator), &fine.mesh);
            let question = (task.oscillator, task.initial);
            let astray = astray(question, (&steps, shortest), &fine.outputs);
            let both = errors.space.iter_mut().zip(astray);
            for (space, own) in both.flat_map(|(space, own)| space.iter_mut().zip(own)) {
                *space = space.max(LEFT.get() * own);
            }
        }
        let pairs = fine.outputs.iter().zip(&coarse.outputs);
        errors.shared = pairs
            .map(|(a, b)| {
                // exp(-H/T)/Z suffers no splitting error: what there is fades with the distance to it.
                let fading = match rung.forcing {
                    None if task.oscillator.is_viscous() => {
                        a.distance * (1.0 + 4.0 * task.oscillator.zeta() * a.t)
                    }
                    _ => 1.0,
                };
                // The intervals of an envelope are short: steps that fill them differ by chance.
                let uneven = rung.forcing.as_ref().is_some_and(|it| it.uneven() > 0.0);
                let near = uneven || (a.steps as f64) < AS_MANY.get() * b.steps as f64;
                let alike = rung.automatic && a.steps > 0 && near;
                let unseen = if alike {
                    UNSEEN.get() * (splitting * fading.min(1.0) + a.step_error)
                } else {
                    0.0
                };
                FLOOR.get() * rung.tolerance + unseen
            })
            .collect();
        errors
    }

    /// Those of a fine run from its difference to a coarse one, `factor` times.
    pub(super) fn between(task: &Task, run: &Run, coarse: &Run, factor: f64) -> Self {
        let scales = scales(task, run);
        let mut space = difference(task, [run, coarse], &scales);
        for x in space.iter_mut().flatten() {
            *x *= factor;
        }
        Self::beside(task, space, scales, [coarse, run])
    }

    /// What there is beside the error in space of a run, from it and a coarser one.
    fn beside(task: &Task, space: Table, scales: Table, [coarse, run]: [&Run; 2]) -> Self {
        let outputs = || run.outputs.iter();
        let undershoot = |(a, b): (&Output, &Output)| {
            std::array::from_fn(|i| standing(a.undershoot[i], b.undershoot[i]))
        };
        let lost = |(k, (it, scale)): (usize, (&Output, &[f64; 11]))| {
            let lost = of_lost(it, scale);
            match task.begun {
                Some(begun) => std::array::from_fn(|i| lost[i] + begun[k][i]),
                None => lost,
            }
        };
        let settled = |it: &Output| match run.settled {
            Some(since) if it.t >= since => it.distance + it.doubt[1],
            _ => 0.0,
        };
        Self {
            space,
            time: vec![[0.0; 11]; run.outputs.len()],
            shared: vec![0.0; run.outputs.len()],
            undershoot: outputs().zip(&coarse.outputs).map(undershoot).collect(),
            lost: outputs().zip(&scales).enumerate().map(lost).collect(),
            settled: outputs().map(settled).collect(),
            scales,
            rounding: f64::EPSILON * (run.steps as f64 + 10.0),
        }
    }

    /// The normalisation of every number.
    pub(super) fn scales(&self) -> &Table {
        &self.scales
    }

    /// The largest part that all rungs err alike, over the normalisation.
    pub(super) fn alike(&self) -> f64 {
        self.shared.iter().copied().fold(0.0, f64::max)
    }

    /// The largest part of the steps of the scene, over the normalisation.
    pub(super) fn steps(&self) -> f64 {
        let parts = self.time.iter().zip(&self.scales);
        let parts = parts.flat_map(|(row, scale)| row.iter().zip(scale));
        let parts = parts.map(|(x, scale)| if *x == 0.0 { 0.0 } else { x / scale });
        parts.fold(0.0, f64::max)
    }

    /// Adds what steps of the scene do, from two runs on the mesh of a rung, one with half of them: of order 2 or more, and of
    /// order 1 where an output time cuts few of them.
    pub(super) fn with_steps(
        mut self,
        (task, rung): (&Task, &Rung),
        [run, halved]: [&Run; 2],
    ) -> Self {
        self.time = difference(task, [run, halved], &self.scales);
        for x in self.time.iter_mut().flatten() {
            *x *= safety(rung);
        }
        self
    }

    /// What three runs share of the error of number i at time k, over its normalisation.
    fn shared(&self, k: usize, i: usize) -> f64 {
        SWING * TAIL[i] * self.settled[k] + self.lost[k][i] + self.shared[k]
    }

    /// Parts of the error of number i at time k: space, time, rounding.
    fn parts(&self, k: usize, i: usize, value: f64) -> [(f64, Origin); 3] {
        let scale = self.scales[k][i];
        let shared = self.shared(k, i);
        [
            (self.space[k][i] + self.undershoot[k][i], Origin::Space),
            (self.time[k][i] + shared * scale, Origin::Time),
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

    /// The largest error over the normalisation, with its time and number.
    pub(super) fn worst(&self, run: &Run) -> (f64, usize, usize) {
        let mut worst = (0.0, 0, 0);
        for (k, scale) in self.scales.iter().enumerate() {
            for (i, scale) in scale.iter().enumerate() {
                let error = match run.outputs[k].moments.get(Moment::ALL[i]) {
                    None => 0.0,
                    // A force without a width has no skewness and no kurtosis.
                    Some(it) if it.value.is_nan() && Moment::ALL[i].is_standardised() => 0.0,
                    Some(it) => self.parts(k, i, it.value).iter().map(|it| it.0).sum(),
                };
                // A number that is 0 without error has no scale where the scale is its value.
                let here = if error == 0.0 { 0.0 } else { error / scale };
                if here > worst.0 || here.is_nan() {
                    worst = (here, k, i);
                }
            }
        }
        worst
    }
}
