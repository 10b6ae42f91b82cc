//! The first loss of contact from any start: survival, density, mean time and exponential rate.
//!
//! One run of the backward equation (`absorbed`) answers every start; from the stationary law it
//! carries the density too, by detailed balance with reversed velocity, so that the rate of losses so rare
//! that no path shows one keeps its digits. Under a drive or an envelope its adjoint is run (`driven`).
//!
//! Orders seen (Hertz, zeta = 0.005, h = 3.2e-3): in space, at a step of 0.5, from 28 x 40, 42 x 60 and
//! 63 x 90 nodes, the survival from rest errs by 1.7e-3, 4.5e-5 and 6.1e-6, order 8.9 and 4.9: the jump at
//! (q_loss, 0) costs about one of the six orders of the interpolation on meshes that resolve it. In the
//! step: where noise turns a motion back within it, order 3/2 (zeta = 1.38, h = 0.11, |q| > 0.98, 160 x 220 nodes: as steps
//! of 0.16 are halved four times, the mean time changes by 1.23, 0.459, 0.169, 0.0615), and all numbers but the
//! density are extrapolated in orders 3/2 and 2 from runs with one, twice and four times the step. Error estimates come from these and from a
//! coarser mesh; whichever is larger is refined.

use super::bound::{self, Bound};
use super::flying::Flying;
use super::layout::{Asked, Layout};
use super::limit::{Runs, largest_since, never_rises};
use super::mesh::Fineness;
use super::region::{Barrier, Region};
use super::run::{Problem, Run};
use crate::error::{Result, positive};
use crate::estimate::{Estimate, Origin, Shortfall};
use crate::fokker_planck::adaptive::{self, Next, Question, Stop};
use crate::fokker_planck::budget::{Cost, Limits};
use crate::fokker_planck::forcing::Forcing;
use crate::fokker_planck::settings::{Method, Settings};
use crate::fokker_planck::solved::Settled;
use crate::initial::Initial;
use crate::oscillator::{Oscillator, Side, Target};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// The first loss of contact: going down through q_loss.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstLoss {
    /// Times, from 0 to the last one asked for, equally spaced.
    pub times: Vec<f64>,
    /// P(no loss of contact up to t). A start below the loss point is lost at t = 0; the stationary start
    /// is taken given contact.
    pub survival: Vec<Estimate>,
    /// P(a loss of contact up to t) = 1 - S, with an error of its own: it may be far below the rounding of S.
    pub lost: Vec<Estimate>,
    /// Density -dS/dt of the first loss, that of the shortest step, with its error; the tolerance is asked of the survival, the mean time and the
    /// rate alone.
    pub density: Vec<Estimate>,
    /// Mean time to the first loss, by Pontryagin's equation; NaN under a drive or an envelope, as the next two.
    pub mean_time: Estimate,
    /// Rate at which the survival falls in the end: S ~ exp(-rate t).
    pub rate: Estimate,
    /// That rate over the rate of losses in the stationary law given contact: the share of losses that
    /// come after the motion has forgotten the one before.
    pub rate_over_rice: Estimate,
    /// How it was computed.
    pub method: Method,
    /// What was not reached of the tolerance.
    pub shortfall: Option<Shortfall>,
}

impl FirstLoss {
    /// Whether it is a bound, for which there is no mesh.
    pub(crate) fn is_bound(&self) -> bool {
        self.method.unknowns == 0
    }

    /// Whether a number of another round is farther away than both errors say.
    fn contradicts(&self, other: &Self) -> bool {
        let pairs = self.survival.iter().zip(&other.survival);
        let lasting = [
            (&self.mean_time, &other.mean_time),
            (&self.rate, &other.rate),
        ];
        pairs
            .chain(lasting)
            .any(|(a, b)| (a.value - b.value).abs() > a.error + b.error)
    }

    /// Where next to nothing passes; the density is the mean one of a unit of time, or of all of it.
    fn bounded(times: &[f64], bound: Bound) -> Self {
        let known = |value, error| Estimate::new(value, error, Origin::ClosedForm);
        let each = |value, error| vec![known(value, error); times.len()];
        let until = times.last().copied().unwrap_or(1.0);
        let density = bound.lost / until.min(1.0);
        Self {
            times: times.to_vec(),
            survival: each(1.0, bound.lost),
            lost: each(0.0, bound.lost),
            density: each(0.0, density),
            mean_time: known(f64::NAN, f64::NAN),
            rate: known(0.0, bound.rate),
            rate_over_rice: known(f64::NAN, f64::NAN),
            method: Method {
                name: bound::BY.into(),
                reason: "no mesh tells what passes so seldom".into(),
                cells: [0; 2],
                unknowns: 0,
                domain: [0.0; 4],
                step: 0.0,
                steps: 0,
                neglected: 0.0,
            },
            shortfall: None,
        }
    }
}

/// All rounds over the first, in the time that they take, at zeta = 1 and a tolerance of 1e-3: the more, the tighter it is (1.0, 2.4 and
/// 5.4 at 1e-2, 1e-3 and 1e-4, medians of 25 random scenes of zeta 0.005 to 3), and the stronger the friction, though no two scenes are
/// alike. Levels higher than [`RARE`] temperatures are passed so seldom that the first is enough.
const ROUNDS: f64 = 5.0;
const RARE: f64 = 100.0;
/// Rounding of the sums over a mesh.
const ROUNDING: f64 = 1e-13;
/// Rounds that may bring nothing before the refinement ends: the first meshes may be too coarse to show an error.
const STALLS: usize = 2;

/// What is solved.
fn equation(driven: bool) -> &'static str {
    if driven {
        "adjoint of the backward equation"
    } else {
        "backward equation"
    }
}

/// How a first passage will be computed: nodes, steps and times of the first run, and its foreseen cost.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FirstPassage {
    asked: Asked,
    /// As it moves up to the levels.
    inside: Oscillator,
    layout: Layout,
    forcing: Option<Arc<Forcing>>,
    /// Where next to nothing passes.
    bound: Option<Bound>,
    /// What it will take.
    pub(crate) cost: Cost,
}

impl FirstPassage {
    /// The recipe from `initial`, up to the time `until`.
    pub(crate) fn of(
        oscillator: &Oscillator,
        initial: &Initial,
        (target, until): (Target, f64),
        settings: &Settings,
    ) -> Result<Self> {
        positive(&format!("{}.until", target.key()), until)?;
        let barrier = Barrier::of(target, target.range(oscillator, initial)?);
        let name = match target {
            Target::Loss => "the first loss of contact",
            Target::Level(..) => "the first passage of the level",
        };
        oscillator
            .damping()
            .depends_on_displacement("a first passage")?;
        let asked = Asked {
            name,
            barrier,
            reference: (!oscillator.is_viscous()).then(|| oscillator.temperature()),
            until,
            tolerance: settings.tolerance,
            step: settings.step,
            cells: settings.cells,
        };
        if !oscillator.contact().is_confining() {
            oscillator.displacement_law()?;
        }
        let inside = barrier.inside(oscillator)?;
        let forcing = Forcing::of(&inside, initial, &settings.excitation, until)?;
        let layout = Layout::of(&inside, initial, &asked, forcing.as_ref());
        // A stationary law without a closed form is not known to pass as seldom, unless all that it lacks is beyond what is next to
        // never passed.
        let solved_for = !inside.is_viscous() && *initial == Initial::Stationary;
        let region = Region::new(&inside, barrier);
        let bound = match forcing {
            None if asked.is_free() && !solved_for => Bound::of(&region, initial, until)?,
            _ => None,
        };
        let mut cost = match bound {
            Some(_) => Cost::default(),
            None => layout.cost(&inside),
        };
        if asked.is_free() {
            let rare = forcing.is_none() && region.rise() > RARE * inside.temperature();
            let tighter = (1e-3 / settings.tolerance).powf(0.37);
            let rounds = ROUNDS * oscillator.zeta().powf(0.2) * tighter;
            cost.seconds *= if rare { 1.0 } else { rounds.max(1.0) };
        }
        Ok(Self {
            asked,
            inside,
            layout,
            forcing: forcing.map(Arc::new),
            bound,
            cost,
        })
    }

    /// Method and reason.
    pub(crate) fn words(&self) -> String {
        if self.bound.is_some() {
            return bound::BY.into();
        }
        let step = format!("{:.3}", self.layout.step);
        format!(
            "{} along the exact motion, absorbed at its first passage; step {}",
            equation(self.forcing.is_some()),
            step.trim_end_matches('0')
        )
    }

    /// As [`first_loss`], by a recipe made before for the same question.
    pub(crate) fn solve(
        &self,
        oscillator: &Oscillator,
        initial: &Initial,
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<FirstLoss> {
        if let Some(bound) = self.bound {
            return Ok(FirstLoss::bounded(&self.layout.times, bound));
        }
        // A stationary start without a closed form is solved for.
        let law = if *initial == Initial::Stationary && !oscillator.is_viscous() {
            let late = limits.late("the stationary law");
            Some(Settled::within(
                oscillator,
                self.asked.tolerance,
                &late,
                limits.memory,
            )?)
        } else {
            None
        };
        let task = Task {
            problem: Problem {
                oscillator: &self.inside,
                initial,
                asked: self.asked,
                forcing: self.forcing.as_deref(),
                limits: limits.clone(),
                law,
            },
            layout: self.layout.clone(),
            runs: Vec::new(),
            best: None,
            last: f64::NAN,
            stalls: 0,
        };
        let asked = (self.asked.name, self.asked.is_free());
        adaptive::pursue(task, asked, limits, progress)
    }
}

/// The error estimate that is farthest above the tolerance, over it.
#[derive(Default)]
struct Worst {
    ratio: f64,
    number: String,
    /// Why no mesh tells the rate, and its error over the tolerance: it drowns in the rounding of a step, and the mean time with
    /// it, or flights are what it errs by.
    untold: Option<(&'static str, f64)>,
    /// The largest part of any that comes from the mesh, and that from the step, over the tolerance.
    parts: [f64; 2],
    /// What a law that is solved for errs in it, over the tolerance.
    of_law: f64,
}

impl Worst {
    /// An estimate over the tolerance, and what it is of.
    fn note(&mut self, ratio: f64, name: impl Fn() -> String) {
        if ratio > self.ratio || ratio.is_nan() {
            (self.ratio, self.number) = (ratio, name());
        }
    }

    /// Whether what the law of the start is off is above the tolerance, and most of it.
    fn is_of_law(&self) -> bool {
        self.of_law > (2.0 * self.parts.iter().sum::<f64>()).max(1.0)
    }

    /// What mesh and steps err, in units of `allowed`.
    fn add(&mut self, errors: [f64; 2], allowed: f64) {
        for (part, error) in self.parts.iter_mut().zip(errors) {
            *part = part.max(error / allowed);
        }
    }
}

struct Task<'a> {
    problem: Problem<'a>,
    /// The next run.
    layout: Layout,
    /// What the last round has run.
    runs: Vec<(Fineness, Run)>,
    best: Option<(FirstLoss, Worst)>,
    /// What the last round that was known missed the tolerance by.
    last: f64,
    /// Rounds that were no nearer than the one before.
    stalls: usize,
}

/// The first loss of contact from `initial`, up to the time `until` and in the long run. Errors from two
/// meshes and three steps.
///
/// # Errors
/// [`Error::Invalid`](crate::Error::Invalid) for a contact law that cannot lose contact, or a time, tolerance or step that is not
/// positive; [`Error::NoStationaryLaw`](crate::Error::NoStationaryLaw) for a law that does not confine; [`Error::Limit`](crate::Error::Limit) when `max_seconds`
/// is reached.
pub fn first_loss(
    oscillator: &Oscillator,
    initial: &Initial,
    until: f64,
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<FirstLoss> {
    solved(
        oscillator,
        initial,
        (Target::Loss, until),
        settings,
        progress,
    )
}

/// The first passage of `level` from `initial`: below it, above it, or of either of it and its negative. Otherwise as
/// [`first_loss`].
///
/// # Errors
/// [`Error::Invalid`](crate::Error::Invalid) for a level that is not finite, that rest has passed, or of `either` and not
/// positive, or for a time, tolerance or step that is not; [`Error::NoStationaryLaw`](crate::Error::NoStationaryLaw) for a law that does not confine;
/// [`Error::Limit`](crate::Error::Limit) when `max_seconds` is reached.
pub fn first_passage(
    oscillator: &Oscillator,
    initial: &Initial,
    (level, side, until): (f64, Side, f64),
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<FirstLoss> {
    let target = Target::Level(level, side);
    solved(oscillator, initial, (target, until), settings, progress)
}

fn solved(
    oscillator: &Oscillator,
    initial: &Initial,
    asked: (Target, f64),
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<FirstLoss> {
    settings.check()?;
    initial.check()?;
    let recipe = FirstPassage::of(oscillator, initial, asked, settings)?;
    recipe.solve(oscillator, initial, &settings.limits(), progress)
}

impl Question for Task<'_> {
    type Answer = FirstLoss;

    fn ratio(&self) -> Option<f64> {
        Some(self.best.as_ref()?.1.ratio)
    }

    fn next(&mut self) -> Result<Next> {
        if let Some((_, worst)) = &self.best {
            if !self.problem.asked.is_free() {
                let text = "its step or its cells are those of the scene";
                return Ok(Next::stop(text));
            }
            if worst.is_of_law() {
                let text = "the stationary law that it begins with is not known better";
                return Ok(Next::stop(text));
            }
            if self.stalls == STALLS {
                let text = "finer meshes and steps bring it no nearer";
                return Ok(Next::stop(text));
            }
        }
        Ok(Next::run(self.layout.cost(self.problem.oscillator)))
    }

    /// A fine run, and its error from one on a coarser mesh and from two of twice and four times the step. The next is finer in
    /// whatever errs most.
    fn run(&mut self, progress: &(dyn Fn(f64) + Sync)) -> Result<()> {
        let layout = self.layout.clone();
        let mut runs = Vec::new();
        for (k, fineness) in layout.runs().into_iter().enumerate() {
            let before = self.runs.iter().find(|it| it.0 == fineness);
            let (from, part) = [(0.0, 0.45), (0.45, 0.25), (0.7, 0.2), (0.9, 0.1)][k];
            let run = match before {
                Some((_, run)) => run.clone(),
                None => self
                    .problem
                    .once(&layout, &fineness, &|done| progress(from + part * done))?,
            };
            runs.push((fineness, run));
        }
        let found = self.report(&layout, [0, 1, 2, 3].map(|k| &runs[k].1));
        self.runs = runs;
        self.layout = layout.finer(found.1.parts);
        // NaN is no error estimate.
        let ratio = found.1.ratio;
        let better = |than: f64| than.is_nan() || ratio < than;
        // The best so far may have been so by chance: a round is held against the one before.
        if !better(self.last) {
            self.stalls += 1;
        }
        if !ratio.is_nan() {
            self.last = ratio;
        }
        let replaces =
            |(best, worst): &(FirstLoss, Worst)| better(worst.ratio) || found.0.contradicts(best);
        if self.best.as_ref().is_none_or(replaces) {
            self.best = Some(found);
        }
        Ok(())
    }

    fn answer(self, stop: Stop) -> Option<FirstLoss> {
        let (best, worst) = self.best?;
        let tolerance = self.problem.asked.tolerance;
        let rate = |(reason, ratio): (&str, f64)| {
            let (reason, free) = (reason.into(), false);
            Stop { reason, free }.shortfall("rate".into(), ratio, tolerance)
        };
        let untold = worst.untold.and_then(rate);
        let shortfall = stop
            .shortfall(worst.number, worst.ratio, tolerance)
            .or(untold);
        Some(FirstLoss { shortfall, ..best })
    }
}

impl Task<'_> {
    /// The numbers of a round with their errors, and the largest of these over the tolerance.
    fn report(&self, layout: &Layout, runs: [&Run; 4]) -> (FirstLoss, Worst) {
        let steps = runs.iter().map(|it| it.steps).sum();
        let runs = Runs::new(runs, layout.resolves());
        let (fine, tolerance) = (runs.fine, self.problem.asked.tolerance);
        let [survival, lost, mut density] = self.curves(layout, &runs);
        let begun = self.begun(layout, fine);
        let mut worst = Worst::default();
        let mut number = |of: &dyn Fn(&Run) -> f64, beyond: f64, judged: bool| {
            let (value, parts) = runs.exponential(of);
            if judged {
                worst.add(parts, tolerance * value.abs());
            }
            let error = parts[0] + parts[1] + (beyond + layout.outside) * value.abs();
            // What one of the runs does not tell is not known.
            let value = if error.is_nan() { error } else { value };
            Estimate::new(value, error, Origin::Space)
        };
        // Of an initial condition beyond the level nothing is left to be known relative to itself.
        let lasts = !layout.driven && fine.survival.first().is_some_and(|s| *s > 1e-9);
        // The mean time is that of what begins inside.
        let inside = fine
            .survival
            .first()
            .map_or(1.0, |s| s.max(f64::MIN_POSITIVE));
        let of_begun = 2.0 * begun / inside;
        let of_mean = fine.residuals[0] + of_begun;
        let mut mean_time = number(&|run| run.mean_time, of_mean, lasts);
        let mut rate = number(&|run| run.rate, fine.residuals[1], !layout.driven);
        let mut rate_over_rice = number(&|run| run.over_rice, fine.residuals[1], false);
        // The larger of both: the difference of either may pass through zero.
        let relative = [&mean_time, &rate].map(|it| it.error / it.value.abs());
        if lasts && relative.iter().all(|it| it.is_finite()) {
            let larger = relative[0].max(relative[1]);
            for it in [&mut mean_time, &mut rate, &mut rate_over_rice] {
                it.error = larger * it.value.abs();
            }
            // Late losses go on at that rate.
            for it in &mut density {
                it.error = it.error.max(larger * it.value.abs());
            }
        }
        let drowned = (!layout.driven && rate.value.is_nan())
            .then_some("what is lost so seldom drowns in rounding");
        let region = self.problem.region();
        let flying = Flying::of(&region, self.problem.initial, layout.level);
        let mut untold = drowned;
        if let Some(flying) = flying.filter(|_| !layout.driven && drowned.is_none()) {
            let seen = rate.value;
            (rate, untold) = flying.bound(rate);
            rate_over_rice = rate.scaled(rate_over_rice.value / seen);
        }
        for (t, it) in layout.times.iter().zip(&survival) {
            worst.note(it.error / tolerance, || format!("survival at t = {t}"));
        }
        worst.add([0.0, self.undecided(layout)], tolerance);
        if self.problem.law.is_some() {
            let most = if lasts { of_begun } else { begun };
            worst.of_law = most / tolerance;
        }
        for k in 0..layout.times.len() {
            worst.add(runs.errors(|run| run.survival[k]), tolerance);
        }
        let relative = |it: &Estimate| it.error / (tolerance * it.value.abs());
        if lasts && drowned.is_none() {
            worst.note(relative(&mean_time), || "mean_time".into());
        }
        if let Some(why) = untold {
            worst.untold = Some((why, relative(&rate)));
            // What mesh and steps err may be what it is not known for.
            worst.note(worst.parts.iter().sum(), || "rate".into());
        } else if !layout.driven {
            worst.note(relative(&rate), || "rate".into());
        }
        let it = FirstLoss {
            times: layout.times.clone(),
            survival,
            lost,
            density,
            mean_time,
            rate,
            rate_over_rice,
            method: self.method(layout, steps),
            shortfall: None,
        };
        (it, worst)
    }

    /// What of an initial condition is beyond the mesh or undecided within a step, or what one that is solved for may be off, given
    /// that nothing is lost at 0.
    fn begun(&self, layout: &Layout, fine: &Run) -> f64 {
        let law = self.problem.law.as_ref();
        let narrow = layout.unseen + self.undecided(layout);
        law.map_or(narrow, |law| law.error / fine.total)
    }

    /// What of it noise decides on within a step.
    fn undecided(&self, layout: &Layout) -> f64 {
        let Problem { initial, .. } = self.problem;
        self.problem.region().undecided(initial, layout.step)
    }

    /// Survival, losses and their density.
    fn curves(&self, layout: &Layout, runs: &Runs<'_>) -> [Vec<Estimate>; 3] {
        let (fine, times) = (runs.fine, &layout.times[..]);
        // What the edge of the mesh leaves out of the losses, and of the initial condition.
        let (outside, begun) = (layout.outside, self.begun(layout, fine));
        // Of an initial condition that is beyond the level in part, losses are a difference from 1.
        let at_once = fine.lost.first().is_some_and(|lost| *lost != 0.0);
        let rounding = if at_once { ROUNDING } else { 0.0 };
        let largest = fine.density.iter().fold(0.0f64, |a, b| a.max(*b));
        let forgets = layout.correlation_time;
        let mut curves = [Vec::new(), Vec::new(), Vec::new()];
        for k in 0..times.len() {
            // Noise brings anything anywhere at once: what is not seen has underflowed.
            let underflow = f64::MIN_POSITIVE * f64::from(times[k] > 0.0);
            // Beyond the edge all is lost, whatever the mesh says.
            let survival =
                largest_since(times, (k, forgets), |l| runs.error(|run| run.survival[l]))
                    + fine.drift[k]
                    + outside * (1.0 - fine.survival[k])
                    + begun
                    + ROUNDING * fine.survival[k]
                    + 4e-16;
            let lost = largest_since(times, (k, forgets), |l| runs.error(|run| run.lost[l]))
                + fine.drift[k]
                + (outside + 1e-12) * fine.lost[k]
                + begun
                + rounding
                + underflow;
            let density = largest_since(times, (k, FRAC_PI_2), |l| {
                runs.error_of_fine(|run| run.density[l])
            }) + fine.wobble[k]
                + outside * fine.density[k].abs()
                + begun * largest
                + underflow;
            let values = [
                runs.value(|run| run.survival[k]).clamp(0.0, 1.0),
                runs.value(|run| run.lost[k]).clamp(0.0, 1.0),
                fine.density[k],
            ];
            for ((curve, value), error) in
                curves.iter_mut().zip(values).zip([survival, lost, density])
            {
                curve.push(Estimate::new(value, error, Origin::Space));
            }
        }
        let [survival, lost, _] = &mut curves;
        never_rises(survival.iter_mut().collect());
        never_rises(lost.iter_mut().rev().collect());
        curves
    }

    fn method(&self, layout: &Layout, steps: u64) -> Method {
        let [nq, nv] = layout.nodes;
        Method {
            name: format!(
                "{} along the exact motion, order 6",
                equation(layout.driven)
            ),
            reason: "absorbed at the first passage of each motion".into(),
            cells: layout.nodes,
            unknowns: nq * nv,
            domain: self.domain(layout),
            step: layout.step,
            steps,
            neglected: layout.outside,
        }
    }

    fn domain(&self, layout: &Layout) -> [f64; 4] {
        let region = Region::new(self.problem.oscillator, self.problem.asked.barrier);
        let Barrier { low, high, .. } = self.problem.asked.barrier;
        let top = region.rise() + layout.level * self.problem.oscillator.temperature();
        let right = high.or(region.turning_point(top)).unwrap_or(low);
        let speed = (2.0 * top).sqrt();
        let [left, right] = region.range(low, right);
        [left, right, -speed, speed]
    }
}
