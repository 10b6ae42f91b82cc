//! The first loss of contact: how long contact survives.

use super::events::{Deaf, Watch};
use super::few::{at_least, student};
use super::law::{self, Law, WithLaw};
use super::noise::LANES;
use super::paths::Paths;
use super::progress::{Progress, Timed};
use super::scheme::{Coefficients, Group, cubic};
use super::statistics::proportion;
use super::walk::{self, TASKS, Walk};
use super::{Sampling, Scheme};
use crate::budget::{Cost, Limits};
use crate::error::Result;
use crate::estimate::{Estimate, Origin, Warning, name_at};
use crate::first_step;
use crate::format::brief;
use crate::initial::Initial;
use crate::matrix::vectorise;
use crate::oscillator::{Oscillator, Side, Target};
use crate::roots::bisect;
use rayon::prelude::*;

/// Steps between two looks at whether all paths of a group have been lost.
const PIECE: u64 = 64;

/// Halvings of the step at most for what noise decides on within the first one, beside the standard error.
const HALVINGS: u32 = 8;

/// More output times than a first passage has.
const OUTPUTS: u64 = 1000;

/// Survival of contact in an ensemble; one standard error on every number.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstLossResult {
    /// The times asked for.
    pub times: Vec<f64>,
    /// P(no loss of contact up to t) at each time.
    pub survival: Vec<Estimate>,
    /// Mean density of the first loss between the time before (0 for the first) and this one.
    pub density: Vec<Estimate>,
    /// Mean time up to the first loss or the last of the times, whichever comes first: less than
    /// [`FirstLoss::mean_time`](crate::fokker_planck::FirstLoss::mean_time), which waits for it.
    pub mean_time: Estimate,
    /// Longest step.
    pub step: f64,
    /// The scheme used.
    pub scheme: Scheme,
    /// Paths times steps.
    pub path_steps: u64,
    /// What a reader of the numbers should know.
    pub warnings: Vec<Warning>,
}

impl FirstLossResult {
    /// Mean time up to the first loss, once every path has been lost; up to the last time it is another number. That few paths have
    /// all been lost may be chance: its error holds what others would add, no more of them than a constant rate leaves.
    pub fn mean_time_of_all(&self) -> Option<Estimate> {
        let left = self.survival.last().filter(|it| it.value == 0.0)?;
        let Estimate { value, error, .. } = self.mean_time;
        let end = self.times.last()?;
        let others = left.error.min((-end / value).exp());
        let error = error.hypot(others * (end + value));
        Some(Estimate::new(value, error, Origin::Sampling))
    }
}

/// When contact is first lost, up to the last of `times` (ascending), located between steps. A
/// stationary start is taken given contact; any other start below the loss point is lost at t = 0.
///
/// The driven velocity is followed as the scheme sees it: within an undamped motion of the splitting,
/// short excursions are found, however short.
///
/// # Errors
/// As [`super::run`]; [`crate::Error::Invalid`] for a law that cannot lose contact and for a scheme that does not
/// locate crossings; [`crate::Error::Limit`] where `max_seconds` are over.
pub fn first_loss(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<FirstLossResult> {
    let until = times.last().copied().unwrap_or(0.0);
    let recipe = FirstLosses::of(oscillator, initial, (Target::Loss, until), settings)?;
    recipe.run((oscillator, initial), times, settings.limits(), progress)
}

/// When a level of q is first passed: below, above, or either of it and its negative, otherwise as [`first_loss`].
/// Between steps a path is the cubic through both ends.
///
/// # Errors
/// As [`first_loss`].
pub fn first_passage(
    oscillator: &Oscillator,
    initial: &Initial,
    (level, side): (f64, Side),
    times: &[f64],
    settings: &Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<FirstLossResult> {
    let until = times.last().copied().unwrap_or(0.0);
    let target = Target::Level(level, side);
    let recipe = FirstLosses::of(oscillator, initial, (target, until), settings)?;
    recipe.run((oscillator, initial), times, settings.limits(), progress)
}

/// How first losses will be drawn.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FirstLosses {
    pub(crate) walk: Walk,
    pub(crate) paths: u64,
    /// The last time.
    pub(crate) until: f64,
    target: Target,
    /// Where paths survive.
    range: [f64; 2],
    /// Time before 0 in which paths come from the reference law to the stationary one.
    run_in: f64,
    /// What the step may cost, relative to a variance.
    bias: f64,
    /// On how many of the passages noise decides within the first step.
    undecided: f64,
    /// What they will take.
    pub(crate) cost: Cost,
}

impl FirstLosses {
    /// The recipe of first passages up to the time `until`.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for a step that is not positive, noise that is not white, a law that cannot lose contact, or a
    /// scheme that does not locate crossings.
    pub(crate) fn of(
        oscillator: &Oscillator,
        initial: &Initial,
        (target, until): (Target, f64),
        settings: &Sampling,
    ) -> Result<Self> {
        let range = target.range(oscillator, initial)?;
        walk::check_ensemble(settings.paths, &[until], target.key())?;
        let mut walk = Walk::locating(oscillator, initial, settings)?;
        let undecided = |step| first_step::undecided(initial, oscillator, range, step);
        if settings.step.is_none() {
            let (first, error) = (walk.step, walk::deviation(settings.paths as f64));
            walk.step = first_step::halved(first, undecided, (error, HALVINGS));
            if walk.step < first {
                walk.reason += ", shorter where the noise of a step decides on the first passage";
            }
        }
        let (steps, step) = walk::equal_steps(until, walk.step)?;
        walk.step = step;
        let run_in = walk::run_in(oscillator, initial);
        let (before, _) = walk::equal_steps(run_in, step)?;
        let steps = steps + before;
        let threads = rayon::current_num_threads() as u64;
        Ok(Self {
            paths: settings.paths,
            until,
            target,
            range,
            run_in,
            bias: walk.bias_on_the_way(oscillator, initial, until),
            undecided: undecided(step),
            cost: Cost {
                steps,
                memory: threads * walk.bytes() + TASKS * 8 * OUTPUTS,
                seconds: walk.seconds(oscillator, steps as f64 * settings.paths as f64),
                ..Cost::default()
            },
            walk,
        })
    }

    /// Size, scheme, step and reason.
    pub(crate) fn words(&self) -> String {
        format!("{} paths, {}", self.paths, self.walk.words())
    }

    /// The first losses between `times`, up to that of the recipe.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for times that do not ascend, [`crate::Error::NoStationaryLaw`], [`crate::Error::Limit`].
    pub(crate) fn run(
        &self,
        (oscillator, initial): (&Oscillator, &Initial),
        times: &[f64],
        limits: Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<FirstLossResult> {
        limits.holds("the paths", self.cost.memory)?;
        walk::check_ensemble(self.paths, times, self.target.key())?;
        let end = times.last().copied().unwrap_or(0.0);
        let (steps, step) = walk::equal_steps(end, self.walk.step)?;
        let progress = &Progress::new(self.paths, limits, progress);
        let (before, length) = walk::equal_steps(self.run_in, self.walk.step)?;
        let paths = Paths::new(oscillator, initial, &self.walk)?;
        let run = Survive {
            paths: if before > 0 {
                paths
            } else {
                paths.given_within(self.range)
            },
            run_in: (before > 0)
                .then(|| (before, length, self.walk.coefficients(oscillator, length))),
            range: (self.target != Target::Loss).then_some(self.range),
            count: self.paths,
            times,
            end,
            steps,
            step,
            coefficients: self.walk.coefficients(oscillator, step),
            progress,
        };
        let sums = law::dispatch(oscillator, &run);
        progress.finish()?;
        // Of those run in the ones that are in contact, or within the levels.
        let n = sums.count;
        let (mut gone, mut start) = (0.0, 0.0);
        let (mut survival, mut density) = (Vec::new(), Vec::new());
        for (time, lost) in times.iter().zip(&sums.lost) {
            gone += lost;
            survival.push(proportion(n - gone, n));
            let length = time - start;
            density.push(if length > 0.0 {
                proportion(*lost, n).scaled(1.0 / length)
            } else {
                Estimate::new(f64::NAN, f64::NAN, Origin::Sampling)
            });
            start = *time;
        }
        let mean = sums.time / n;
        let variance = (sums.time_square / n - mean * mean).max(0.0);
        let error = if gone == 0.0 {
            // No scatter is seen, and some may be lost all the same.
            end * proportion(n, n).error
        } else {
            // The times of few may lie near each other by chance: no less than those of a constant rate scatter.
            let usual = if gone == n { mean * mean } else { 0.0 };
            student(n) * (at_least(variance, usual, n) / (n - 1.0)).sqrt()
        };
        let names = || {
            let stage = match self.target {
                Target::Loss => "first_loss_paths",
                Target::Level(..) => "first_passage_paths",
            };
            let at = |t: &f64| {
                ["survival", "density"].map(|name| name_at(&format!("{stage}.{name}"), *t))
            };
            let mut names: Vec<String> = times.iter().flat_map(at).collect();
            names.push(format!("{stage}.mean_time"));
            names
        };
        Ok(FirstLossResult {
            times: times.to_vec(),
            survival,
            density,
            mean_time: Estimate::new(mean, error, Origin::Sampling),
            step,
            scheme: self.walk.scheme,
            path_steps: (steps + before).saturating_mul(self.paths),
            warnings: (self.walk.warning(self.bias, n, names).into_iter())
                .chain(self.blind(n, names))
                .chain(nobody(n, names))
                .chain(walk::not_run_in(oscillator, initial, names))
                .collect(),
        })
    }

    /// A warning that the numbers `unknown` of so many paths are not known if the first step sees too little of the noise.
    fn blind(&self, samples: f64, unknown: impl FnOnce() -> Vec<String>) -> Option<Warning> {
        (self.undecided > walk::deviation(samples)).then(|| Warning {
            text: format!(
                "noise decides on up to {:.0} % of the passages within first steps of {}, which do not see it: shorten \
                 monte_carlo.step",
                100.0 * self.undecided,
                brief(self.walk.step)
            ),
            unknown: unknown(),
        })
    }
}

/// A warning that there is nothing to count.
fn nobody(samples: f64, unknown: impl FnOnce() -> Vec<String>) -> Option<Warning> {
    (samples == 0.0).then(|| Warning {
        text: "no path had its start within the range after the run-in: more monte_carlo.paths"
            .into(),
        unknown: unknown(),
    })
}

/// The ensemble, to be run once the contact law is known.
struct Survive<'a> {
    paths: Paths,
    /// Steps before 0, their length, and how they are made.
    run_in: Option<(u64, f64, Coefficients)>,
    /// Levels other than the loss of contact.
    range: Option<[f64; 2]>,
    count: u64,
    times: &'a [f64],
    end: f64,
    steps: u64,
    step: f64,
    coefficients: Coefficients,
    progress: &'a Progress<'a>,
}

/// First losses in the intervals that end at the times asked for, and time in contact.
struct LossSums {
    /// Paths that began where nothing was lost yet, or whose beginning is given.
    count: f64,
    lost: Vec<f64>,
    time: f64,
    time_square: f64,
}

impl LossSums {
    fn new(run: &Survive) -> Self {
        Self {
            count: 0.0,
            lost: vec![0.0; run.times.len()],
            time: 0.0,
            time_square: 0.0,
        }
    }

    /// Adds a path by its first loss; one before all time is none of the sample.
    fn push(&mut self, run: &Survive, first: f64) {
        if first == f64::NEG_INFINITY {
            return;
        }
        self.count += 1.0;
        let interval = run.times.partition_point(|time| *time < first);
        if let Some(lost) = self.lost.get_mut(interval) {
            *lost += 1.0;
        }
        let time = first.min(run.end);
        self.time += time;
        self.time_square += time * time;
    }

    fn add(&mut self, more: &Self) {
        self.count += more.count;
        for (a, b) in self.lost.iter_mut().zip(&more.lost) {
            *a += b;
        }
        self.time += more.time;
        self.time_square += more.time_square;
    }
}

/// Notes the first loss of each lane.
struct First([f64; LANES]);

impl Watch for First {
    fn cross(&mut self, lane: usize, lost: bool, time: f64, _: f64) {
        if lost {
            self.0[lane] = self.0[lane].min(time);
        }
    }
}

/// Notes when each lane first leaves a range.
struct Out {
    first: [f64; LANES],
    range: [f64; 2],
}

impl Watch for Out {
    const LISTENS: bool = false;
    const FOLLOWS: bool = true;

    fn cross(&mut self, _: usize, _: bool, _: f64, _: f64) {}

    #[inline(always)]
    fn moved(&mut self, lane: usize, time: f64, step: f64, ends: [[f64; 2]; 2]) {
        // Far from either level a substep cannot reach it: the fastest end and the preload bound how far it goes.
        let [[q0, v0], [q1, v1]] = ends;
        let reach = step * (v0.abs().max(v1.abs()) + step);
        let far = |q: f64| q - reach > self.range[0] && q + reach < self.range[1];
        if !(far(q0) && far(q1)) {
            let passed = [(self.range[0], 1.0), (self.range[1], -1.0)]
                .into_iter()
                .filter(|(level, _)| level.is_finite())
                .filter_map(|(level, sign)| {
                    let beyond = ends.map(|[q, v]| [sign * (q - level), sign * v]);
                    passage(beyond, step)
                })
                .fold(f64::INFINITY, f64::min);
            self.first[lane] = self.first[lane].min(time + passed);
        }
    }
}

/// When the cubic with these values and slopes at the ends of a step first falls below 0, if it does: at an end of the
/// step, or between where it turns.
fn passage([[x0, v0], [x1, v1]]: [[f64; 2]; 2], step: f64) -> Option<f64> {
    if x0 < 0.0 {
        return Some(0.0);
    }
    let at = |s: f64| cubic([x0, v0, x1, v1], step, s);
    let end = if x1 < 0.0 {
        1.0
    } else if v0 < 0.0 && v1 > 0.0 {
        let lowest = bisect(0.0, 1.0, |s| at(s).1 >= 0.0);
        if at(lowest).0 >= 0.0 {
            return None;
        }
        lowest
    } else {
        return None;
    };
    Some(step * bisect(0.0, end, |s| at(s).0 < 0.0))
}

impl WithLaw for &Survive<'_> {
    type Output = LossSums;

    fn with<L: Law>(self, law: L) -> LossSums {
        let parts: Vec<LossSums> = walk::tasks(self.count)
            .into_par_iter()
            .map(|paths| {
                let mut sums = LossSums::new(self);
                for first in paths.clone().step_by(LANES) {
                    let lanes = (LANES as u64).min(paths.end - first);
                    let times = vectorise!(self.first_losses(law, first));
                    if self.progress.late() {
                        break;
                    }
                    for time in &times[..lanes as usize] {
                        sums.push(self, *time);
                    }
                    self.progress.add(lanes);
                }
                sums
            })
            .collect();
        let mut total = LossSums::new(self);
        for part in &parts {
            total.add(part);
        }
        total
    }
}

impl Survive<'_> {
    /// The first losses of [`LANES`] paths; infinite where there is none.
    #[inline(always)]
    fn first_losses<L: Law>(&self, law: L, first: u64) -> [f64; LANES] {
        let mut group = self.paths.group(first);
        // What is run in is of the sample only where nothing is lost at 0.
        let at_once = match &self.run_in {
            // Under viscous damping nothing is run in, and no code is made for it.
            Some((steps, length, coefficients)) if !L::VISCOUS => {
                let start = -(*steps as f64);
                let pieces = (start, *steps, *length, coefficients);
                self.in_pieces(law, &mut group, pieces, Deaf, |_| false);
                f64::NEG_INFINITY
            }
            _ => 0.0,
        };
        let beyond = |q: f64| match self.range {
            Some([below, above]) => q < below || q > above,
            None => q < law.loss(),
        };
        let gone = std::array::from_fn(|lane| {
            if beyond(group.q[lane]) {
                at_once
            } else {
                f64::INFINITY
            }
        });
        let pieces = (0.0, self.steps, self.step, &self.coefficients);
        let all = |times: &[f64; LANES]| !times.contains(&f64::INFINITY);
        match self.range {
            Some(range) => {
                let watch = Out { first: gone, range };
                self.in_pieces(law, &mut group, pieces, watch, |it| all(&it.first))
                    .first
            }
            None => {
                self.in_pieces(law, &mut group, pieces, First(gone), |it| all(&it.0))
                    .0
            }
        }
    }

    /// Steps of a length from the step `start` on under a watch, in pieces, so that a group whose paths are `all` gone can
    /// stop.
    #[inline(always)]
    fn in_pieces<L: Law, W: Watch>(
        &self,
        law: L,
        group: &mut Group,
        (start, steps, length, coefficients): (f64, u64, f64, &Coefficients),
        mut watch: W,
        all: impl Fn(&W) -> bool,
    ) -> W {
        let mut timed = Timed {
            watch: &mut watch,
            progress: self.progress,
        };
        let mut done = 0;
        while done < steps && !all(timed.watch) && !timed.late() {
            let piece = PIECE.min(steps - done);
            let now = (start + done as f64) * length;
            coefficients.advance(law, group, piece, now, &mut timed);
            done += piece;
        }
        watch
    }
}
