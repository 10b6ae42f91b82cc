//! The first loss of contact from any start: survival, density, mean time and exponential rate.
//!
//! One run of the backward equation (`absorbed`) answers every start; from the stationary law it
//! carries the density too, by detailed balance with reversed velocity, so that the rate of losses so rare
//! that no path shows one keeps its digits.
//!
//! Orders seen (Hertz, zeta = 0.005, h = 3.2e-3): in space, at a step of 0.5, from 28 x 40, 42 x 60 and
//! 63 x 90 nodes, the survival from rest errs by 1.7e-3, 4.5e-5 and 6.1e-6, order 8.9 and 4.9: the jump at
//! (q_loss, 0) costs about one of the six orders of the interpolation on meshes that resolve it. In the
//! step, on one mesh of 118 x 168, the rate changes by 5.6e-7 from 1 to 0.5 and by 4e-8 from 0.5 to 0.25;
//! splitting is of second order, and the density of the stationary start of first order in
//! the step near grazing losses. Under strong friction (zeta = 5, h = 0.4) the rate changes by 8.4e-2, 2.9e-2 and
//! 1.1e-2 as steps of 0.125 are halved: order 1.5. Error estimates come from the differences from twice the step and
//! from a coarser mesh; whichever is larger is refined.

use super::absorbed::{Absorbed, Fineness, POINTS, Start};
use super::pontryagin::{dot, long_run};
use crate::error::{Error, Result, positive};
use crate::estimate::{Estimate, Origin, Shortfall};
use crate::fokker_planck::adaptive::{self, Next, Question, Stop};
use crate::fokker_planck::budget::{Cost, Limits, timing};
use crate::fokker_planck::settings::{Method, Settings};
use crate::fokker_planck::trajectory::Motion;
use crate::initial::Initial;
use crate::oscillator::Oscillator;

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
    /// Density -dS/dt of the first loss, with its error; the tolerance is asked of the survival, the mean time and the
    /// rate alone.
    pub density: Vec<Estimate>,
    /// Mean time to the first loss, by Pontryagin's equation.
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

/// Most output times after t = 0.
const OUTPUTS: f64 = 200.0;
/// Rounds that may bring nothing before the refinement ends: the first meshes may be too coarse to show an error.
const STALLS: usize = 2;
/// Of the differences from the coarse mesh and from twice the step, what the fine run errs: what orders 3 and 1.5 would
/// leave. Seen: 5 and 2, and in the step 1.5 under strong friction.
const SHARES: [f64; 2] = [0.5, 0.55];
/// An error part of mesh or step beyond this, over the tolerance, is refined even where the other is larger.
const ALONE: f64 = 0.5;
/// Nodes of the coarse run over those of the fine one.
const COARSE: f64 = 0.7;

/// Steps, meshes and times of a task.
#[derive(Debug, Clone, PartialEq)]
struct Layout {
    times: Vec<f64>,
    /// Steps between times of the fine run, even.
    every: usize,
    step: f64,
    nodes: [usize; 2],
    level: f64,
    /// Time over which the motion forgets.
    memory: f64,
}

impl Layout {
    /// The layout of the first run.
    fn of(oscillator: &Oscillator, initial: &Initial, asked: &Asked) -> Self {
        let Asked {
            loss,
            until,
            tolerance,
            ..
        } = *asked;
        let t = oscillator.temperature();
        let contact = oscillator.contact();
        let rise = contact.potential(loss) - contact.lowest_potential().unwrap_or(0.0);
        // One hundredth of the tolerance above the edge, and a start with its Gaussian.
        let mut level = (100.0 / tolerance).ln().clamp(8.0, 30.0) + 2.0;
        if let Initial::Gaussian { mean, deviation } = initial {
            let far = |k: usize, sign: f64| mean[k] + sign * 5.0 * deviation[k];
            for (a, b) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
                let energy = oscillator.energy(far(0, a).max(loss), far(1, b));
                level = level.max((energy - rise) / t);
            }
        }
        let speed = (2.0 * (rise + level * t)).sqrt();
        // A motion must not come back to the loss point within a step: a quarter of the fastest bounce.
        let bounce = bounce(oscillator, loss, speed);
        // Noise gathered at the middle of a step errs by 2 pi h step^3/24 in the variance of q where the
        // law varies on the scale T of U: half the tolerance of T^2.
        let zeta = oscillator.zeta();
        let noisy = (6.0 * tolerance * t / zeta).cbrt();
        let damped = (12.0 * tolerance / zeta).sqrt();
        let automatic = 0.5f64.min(noisy).min(damped).min(0.25 * bounce);
        let longest = asked.step.unwrap_or(automatic);
        // The coarse step is twice the fine one and still ends on every time.
        let outputs = (until / (2.0 * longest)).floor().clamp(8.0, OUTPUTS);
        let gap = until / outputs;
        let every = 2 * (gap / (2.0 * longest)).ceil().max(1.0) as usize;
        let step = gap / every as f64;
        let memory = oscillator.memory();
        let nodes = match asked.cells {
            Some(cells) => cells.map(|n| n.max(16)),
            None => {
                // The interpolation of order 6 errs once a step.
                let part = (2.0 * step * tolerance / 1e-3).powf(1.0 / 6.0);
                nodes(oscillator, rise, speed, step, part)
            }
        };
        Self {
            times: (0..=outputs as usize).map(|k| k as f64 * gap).collect(),
            every,
            step,
            nodes,
            level,
            memory,
        }
    }

    /// The next layout, for what the mesh and the step err, over the tolerance: whatever errs most is made finer, and
    /// the other too where it errs by more than [`ALONE`].
    fn finer(&self, [mesh, step]: [f64; 2]) -> Self {
        let mut it = self.clone();
        let mut wanted = mesh / ALONE;
        if step > mesh || step > ALONE {
            it.every *= 2;
            it.step *= 0.5;
            // Twice as many interpolations, of what a kick smooths over half the root of the distance.
            wanted *= 2.0 * 2f64.sqrt().powi(POINTS as i32);
        }
        if mesh > step || wanted > 1.0 {
            let times = wanted.powf(1.0 / POINTS as f64).clamp(1.0 / COARSE, 2.0);
            it.nodes = it.nodes.map(|n| (n as f64 * times).ceil() as usize);
        }
        it
    }

    /// The mesh and the step of a run: the fine one, on a coarser mesh, of twice the step.
    fn runs(&self) -> [Fineness; 3] {
        let Self {
            nodes, step, level, ..
        } = *self;
        let coarse = nodes.map(|n| ((n as f64 * COARSE) as usize).max(12));
        let of = |nodes, step| Fineness { nodes, step, level };
        [of(nodes, step), of(coarse, step), of(nodes, 2.0 * step)]
    }

    /// Krylov vectors a tenth of the memory apart, and a quarter of a period at the least: closer ones span
    /// too little of an oscillation to tell it from the slowest mode.
    fn stride(&self, step: f64) -> usize {
        let apart = (0.1 * self.memory).max(1.5);
        (apart / step).ceil().clamp(1.0, 1e6) as usize
    }

    fn steps(&self) -> f64 {
        (self.every * (self.times.len() - 1)) as f64
    }

    /// Quadrature points of a row: 3.2 a deviation of the noise.
    fn points(&self, oscillator: &Oscillator) -> f64 {
        let t = oscillator.temperature();
        let spread = (t * -(-4.0 * oscillator.zeta() * self.step).exp_m1()).sqrt();
        3.2 * 2.0 * (2.0 * (1.0 + self.level * t)).sqrt() / spread
    }

    /// A stencil of 112 bytes a point; a kernel of 46 points a node; Krylov vectors.
    fn memory_bytes(&self, oscillator: &Oscillator) -> f64 {
        let [nq, nv] = self.nodes.map(|n| n as f64);
        nq * (self.points(oscillator) * 112.0 + nv * 46.0 * 8.0) + 40.0 * 8.0 * nq * nv
    }

    /// What the fine run takes, and those that measure its error.
    fn cost(&self, oscillator: &Oscillator) -> Cost {
        let [nq, nv] = self.nodes.map(|n| n as f64);
        let (points, steps) = (self.points(oscillator), self.all_steps());
        Cost {
            cells: self.nodes,
            steps: steps as u64,
            memory: self.memory_bytes(oscillator) as u64,
            // The runs that measure the error take as long again.
            seconds: 2.0
                * nq
                * (points * (timing::ABSORBED_MAP + timing::ABSORBED_POINT * steps)
                    + nv * timing::ABSORBED_NODE * steps),
        }
    }

    /// Steps of a fine run, with those of the long run.
    fn all_steps(&self) -> f64 {
        self.steps().min(10.0 * self.memory / self.step)
            + 1.2 * 18.0 * self.stride(self.step) as f64
    }
}

/// Nodes so that the mesh of v follows the noise of a step: half its deviation (times `part`) at the turning
/// points, where contact is lost, which errs by a few 1e-4 at a step of 0.5. In sqrt(q - q_loss) survival is
/// smoother: 0.7 as many.
fn nodes(oscillator: &Oscillator, rise: f64, speed: f64, step: f64, part: f64) -> [usize; 2] {
    let t = oscillator.temperature();
    let spread = (t * -(-4.0 * oscillator.zeta() * step).exp_m1()).sqrt();
    let grade = (2.0 * rise / 3.0).max(t).sqrt();
    let v = 2.0 * (speed / grade).asinh() * grade / (0.5 * part * spread);
    // More do not fit a run of seconds; the error then says so.
    let v = v.clamp(60.0, 600.0);
    [(0.7 * v) as usize, v as usize]
}

/// Time from the loss point back to it at this speed.
fn bounce(oscillator: &Oscillator, loss: f64, speed: f64) -> f64 {
    // Contact is never softer than the preload: the time is found from below.
    let times: Vec<f64> = (-60..=20).map(|k| (0.1 * f64::from(k)).exp()).collect();
    let mut ends = vec![[0.0; 2]; times.len()];
    Motion::new(oscillator.contact()).after(&[[loss, speed]], &times, &mut ends);
    let back = ends.iter().position(|end| end[0] <= loss);
    back.map_or(1.0, |k| times[k.saturating_sub(1)])
}

/// The numbers of one mesh and step.
#[derive(Debug, Clone, Default)]
struct Run {
    survival: Vec<f64>,
    lost: Vec<f64>,
    /// What a survival continued in closed form may be off.
    drift: Vec<f64>,
    density: Vec<f64>,
    /// What the order of differentiation changes in the density, or its continuation.
    wobble: Vec<f64>,
    mean_time: f64,
    rate: f64,
    over_rice: f64,
    /// Relative error of mean time and rate beyond mesh and step.
    residuals: [f64; 2],
    steps: u64,
}

/// Losses up to each step.
struct March {
    gone: Vec<f64>,
    /// The same by detailed balance.
    left: Vec<f64>,
    /// Of what enters, in stationary motion.
    entered: Vec<f64>,
    /// The constant hazard a step of what survives after the last step, and its relative error; None where
    /// the march went on to the end.
    hazard: Option<(f64, f64)>,
}

impl March {
    /// What the hazard a step may be off, if losses go on at `rate` a step.
    fn doubt(&self, rate: f64, rare: bool) -> f64 {
        match self.hazard {
            // Losses so rare drown, but for detailed balance, in the rounding of a mesh.
            Some((_, doubt)) if rare => doubt * rate,
            Some((hazard, doubt)) => doubt * hazard + (hazard - rate).abs(),
            None => 0.0,
        }
    }
}

/// Steps after the last one asked for.
const ENDS: usize = 3;

/// What is asked, and what the scene fixes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Asked {
    /// The loss point.
    loss: f64,
    until: f64,
    tolerance: f64,
    step: Option<f64>,
    cells: Option<[usize; 2]>,
}

/// How a first passage will be computed: nodes, steps and times of the first run, and its foreseen cost.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FirstPassage {
    asked: Asked,
    layout: Layout,
    /// What it will take.
    pub(crate) cost: Cost,
}

impl FirstPassage {
    /// The recipe for the first loss of contact from `initial`, up to the time `until`.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a contact law that cannot lose contact, or a time, tolerance or step that is not
    /// positive; [`Error::NoStationaryLaw`] for a law that does not confine.
    pub(crate) fn of(
        oscillator: &Oscillator,
        initial: &Initial,
        until: f64,
        settings: &Settings,
    ) -> Result<Self> {
        positive("outputs.first_loss.until", until)?;
        positive("accuracy.tolerance", settings.tolerance)?;
        if let Some(step) = settings.step {
            positive("method.step", step)?;
        }
        let asked = Asked {
            loss: loss_point(oscillator)?,
            until,
            tolerance: settings.tolerance,
            step: settings.step,
            cells: settings.cells,
        };
        if !oscillator.contact().is_confining() {
            oscillator.displacement_law()?;
        }
        let layout = Layout::of(oscillator, initial, &asked);
        let cost = layout.cost(oscillator);
        Ok(Self {
            asked,
            layout,
            cost,
        })
    }

    /// Method and reason.
    pub(crate) fn words(&self) -> String {
        let step = format!("{:.3}", self.layout.step);
        format!(
            "backward equation along the exact motion, absorbed at the loss point; step {}",
            step.trim_end_matches('0')
        )
    }

    /// As [`first_loss`], by a recipe made before for the same question.
    ///
    /// # Errors
    /// [`Error::Limit`] when time or memory do not suffice for a first answer.
    pub(crate) fn solve(
        &self,
        oscillator: &Oscillator,
        initial: &Initial,
        limits: Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<FirstLoss> {
        let task = Task {
            oscillator,
            initial,
            asked: self.asked,
            limits,
            layout: self.layout.clone(),
            runs: Vec::new(),
            best: None,
            stalls: 0,
        };
        adaptive::pursue(task, &limits, progress)
    }
}

/// The question in messages.
const NAME: &str = "the first loss of contact";

/// The error estimate that is farthest above the tolerance, over it.
struct Worst {
    ratio: f64,
    number: String,
    /// The largest part of any that comes from the mesh, and that from the step, over the tolerance.
    parts: [f64; 2],
}

struct Task<'a> {
    oscillator: &'a Oscillator,
    initial: &'a Initial,
    asked: Asked,
    limits: Limits,
    /// The next run.
    layout: Layout,
    /// What the last round has run.
    runs: Vec<(Fineness, Run)>,
    best: Option<(FirstLoss, Worst)>,
    /// Rounds that brought nothing.
    stalls: usize,
}

/// The first loss of contact from `initial`, up to the time `until` and in the long run. Errors from two
/// meshes and two steps.
///
/// # Errors
/// [`Error::Invalid`] for a contact law that cannot lose contact, or a time, tolerance or step that is not
/// positive; [`Error::NoStationaryLaw`] for a law that does not confine; [`Error::Limit`] when `max_seconds`
/// is reached.
pub fn first_loss(
    oscillator: &Oscillator,
    initial: &Initial,
    until: f64,
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<FirstLoss> {
    let recipe = FirstPassage::of(oscillator, initial, until, settings)?;
    let limits = Limits::from_now(settings.max_seconds, settings.max_memory);
    recipe.solve(oscillator, initial, limits, progress)
}

fn loss_point(oscillator: &Oscillator) -> Result<f64> {
    let contact = oscillator.contact();
    contact.loss_point().ok_or_else(|| {
        let accepted = "a law that can lose contact, for first_loss";
        Error::invalid("oscillator.contact", contact.name(), accepted)
    })
}

impl Question for Task<'_> {
    type Answer = FirstLoss;

    fn name(&self) -> String {
        NAME.into()
    }

    fn ratio(&self) -> Option<f64> {
        Some(self.best.as_ref()?.1.ratio)
    }

    fn next(&mut self) -> Result<Next> {
        if self.best.is_some() {
            if self.asked.step.is_some() || self.asked.cells.is_some() {
                let text = "its step or its cells are those of the scene";
                return Ok(Next::Stop(Stop::new(text, false)));
            }
            if self.stalls == STALLS {
                let text = "finer meshes and steps bring it no nearer";
                return Ok(Next::Stop(Stop::new(text, true)));
            }
        }
        Ok(Next::Run {
            now: self.layout.cost(self.oscillator).into(),
            then: None,
        })
    }

    /// A fine run, and its error from one on a coarser mesh and one of twice the step. The next is finer in whatever
    /// errs most.
    fn run(&mut self, progress: &(dyn Fn(f64) + Sync)) -> Result<()> {
        let layout = self.layout.clone();
        let mut runs = Vec::new();
        for (k, fineness) in layout.runs().into_iter().enumerate() {
            let before = self.runs.iter().find(|it| it.0 == fineness);
            let (from, part) = [(0.0, 0.5), (0.5, 0.25), (0.75, 0.25)][k];
            let run = match before {
                Some((_, run)) => run.clone(),
                None => self.once(&layout, &fineness, &|done| progress(from + part * done))?,
            };
            runs.push((fineness, run));
        }
        let found = self.report(&layout, &runs[0].1, [&runs[1].1, &runs[2].1]);
        self.runs = runs;
        self.layout = layout.finer(found.1.parts);
        match &self.best {
            Some((_, best)) if best.ratio <= found.1.ratio => self.stalls += 1,
            _ => self.best = Some(found),
        }
        Ok(())
    }

    fn answer(self, stop: Stop) -> Option<FirstLoss> {
        let (best, worst) = self.best?;
        Some(FirstLoss {
            shortfall: stop.shortfall(worst.number, worst.ratio, self.asked.tolerance),
            ..best
        })
    }
}

impl Task<'_> {
    /// The start as weights, and what its survival is divided by.
    fn start(&self, absorbed: &Absorbed, stationary: &Start) -> (Start, f64) {
        match *self.initial {
            Initial::Rest => (absorbed.point(self.oscillator, [0.0, 0.0]), 1.0),
            Initial::Stationary => (stationary.clone(), stationary.total),
            Initial::Gaussian { mean, deviation } => {
                let density = |q: f64| {
                    let x = (q - mean[0]) / deviation[0];
                    (-0.5 * x * x).exp() / (std::f64::consts::TAU.sqrt() * deviation[0])
                };
                let lines = absorbed.displacements(self.oscillator, deviation[0], density);
                let it = absorbed.lines(self.oscillator, &lines, mean[1], deviation[1]);
                (it, 1.0)
            }
        }
    }

    fn once(&self, layout: &Layout, fineness: &Fineness, progress: &dyn Fn(f64)) -> Result<Run> {
        let it = self.oscillator;
        let late = self.limits.late(NAME);
        let absorbed = Absorbed::new(it, self.asked.loss, fineness, &late)?;
        let law = it.displacement_law()?;
        let deviation = it.temperature().sqrt();
        let lines = absorbed.displacements(it, 0.5 * deviation, |q| law.density(q));
        let stationary = absorbed.lines(it, &lines, 0.0, deviation);
        let (start, total) = self.start(&absorbed, &stationary);
        let balanced = *self.initial == Initial::Stationary;
        let outflow = absorbed.outflow(it, &lines);
        let entering = absorbed.entering(it, law.density(self.asked.loss));
        let balance = balanced.then_some([&outflow, &entering]);
        let step = fineness.step;
        let every = (layout.every as f64 * layout.step / step).round() as usize;
        let march = self.march(
            &absorbed,
            &start,
            balance,
            every * (layout.times.len() - 1),
            (0.5 * layout.memory / step).ceil() as usize,
            &|part| progress(0.4 * part),
        )?;
        let stride = layout.stride(step);
        let enough = 1e-3 * self.asked.tolerance.min(1e-3);
        // Losses a step of a mode, by detailed balance; small numbers keep their digits.
        let per_step = |mode: &[f64]| {
            let held = dot(&stationary.weights, mode);
            dot(&outflow.weights, mode) / held
        };
        // So rare that a start is forgotten long before: the mean time is the slowest mode's, but for a share
        // that its error holds.
        let rare = |mode: &[f64]| {
            let forgotten = per_step(mode) * layout.memory / step;
            forgotten < 0.3 * self.asked.tolerance
        };
        let long = long_run(&absorbed, stride, enough, &rare, &late)?;
        progress(1.0);
        let held = dot(&stationary.weights, &long.mode);
        let rate = -(-per_step(&long.mode)).ln_1p() / step;
        let rice = law.density(self.asked.loss) * deviation / std::f64::consts::TAU.sqrt();
        let inside = start.total / total;
        let last = march.gone.len() - 1;
        let doubt = march.doubt(rate * step, long.sum.is_none());
        let count = layout.times.len();
        let mut run = Run::default();
        for k in 0..count {
            let n = k * every;
            // Beyond the march the survival falls at the rate of its end.
            let (at, beyond) = if n + ENDS <= last || march.hazard.is_none() {
                (n, 0.0)
            } else {
                (last - ENDS, (n + ENDS - last) as f64)
            };
            let fallen = (-rate * step * beyond).exp();
            // Where next to nothing is lost, the sum of what leaves keeps its digits.
            let gone = match march.left.get(at) {
                Some(left) if balanced && *left < 1e-6 * total => *left,
                _ => march.gone[at],
            };
            let held = (inside - gone / total).clamp(0.0, 1.0);
            let survival = held * fallen;
            run.survival.push(survival);
            let later = held * -(-rate * step * beyond).exp_m1();
            run.lost.push((1.0 - inside) + gone / total + later);
            run.drift.push(survival * doubt * beyond);
            let (density, wobble) = if balanced {
                ((entering.total - march.entered[at]) / total, 0.0)
            } else {
                let slope = |half| derivative(&march.gone, at, half) / (step * total);
                let density: f64 = slope(3);
                (density, (slope(2) - density).abs())
            };
            // Detailed balance has the rate at the end to more digits than the losses of a step.
            let density = match beyond {
                0.0 => density,
                _ => rate * survival,
            };
            run.density.push(density);
            let drift = if beyond > 0.0 {
                density.abs() * doubt * (1.0 / (rate * step) + beyond)
            } else {
                0.0
            };
            run.wobble.push(wobble * fallen + drift);
        }

        let (mean_time, direct) = match &long.sum {
            Some(sum) => {
                let sum = dot(&start.weights, sum);
                // Trapezes with the first correction of Euler and Maclaurin.
                let mean =
                    step * (0.5 * inside + sum / total) - step * step / 12.0 * run.density[0];
                (mean, -long.factor.ln() / step)
            }
            None => {
                let seen = dot(&start.weights, &long.mode) / total;
                (seen * stationary.total / (held * rate), rate)
            }
        };
        let forgets = if long.sum.is_none() {
            rate * layout.memory
        } else {
            0.0
        };
        run.mean_time = mean_time;
        run.rate = rate;
        run.over_rice = rate * stationary.total / rice;
        run.residuals = [
            long.residuals[0] / (rate * stride as f64 * step) + forgets,
            (direct / rate - 1.0).abs(),
        ];
        run.steps = last as u64 + long.steps;
        Ok(run)
    }

    /// Losses step by step, until they are constant in what survives. The stationary law loses in each step
    /// what leaves it of those that have survived (`balance`: outflow and what enters), by detailed
    /// balance: no small part of a small number.
    fn march(
        &self,
        absorbed: &Absorbed,
        start: &Start,
        balance: Option<[&Start; 2]>,
        count: usize,
        window: usize,
        progress: &dyn Fn(f64),
    ) -> Result<March> {
        let first = |it: &Start| it.lost + dot(&it.weights, absorbed.lost_first());
        // Summed from the losses in each step, so that small parts keep their digits.
        let mut leaving = balance.map_or(0.0, |[outflow, _]| outflow.total - first(outflow));
        let mut march = March {
            gone: vec![0.0, first(start)],
            left: vec![0.0, balance.map_or(0.0, |[it, _]| it.total)],
            entered: vec![0.0, balance.map_or(0.0, |[_, it]| first(it))],
            hazard: None,
        };
        let late = self.limits.late(NAME);
        let mut losses = absorbed.lost_second();
        let mut scratch = vec![0.0; losses.len()];
        let mut hazards = [f64::INFINITY; 3];
        // As many steps more as the differences at the end want.
        while march.gone.len() <= count + ENDS {
            let n = march.gone.len();
            march
                .gone
                .push(march.gone[n - 1] + dot(&start.weights, &losses));
            if let Some([outflow, entering]) = balance {
                march.left.push(march.left[n - 1] + leaving);
                leaving -= dot(&outflow.weights, &losses);
                let entered = march.entered[n - 1] + dot(&entering.weights, &losses);
                march.entered.push(entered);
            }
            absorbed.advance(&mut losses, &mut scratch);
            late()?;
            if n.is_multiple_of(16) {
                progress(n as f64 / count as f64);
            }
            if n.is_multiple_of(window) {
                let before = march.gone[n - window];
                let part = (march.gone[n] - before) / (start.total - before);
                hazards = [hazards[1], hazards[2], -(-part).ln_1p() / window as f64];
                let [a, b, c] = hazards;
                let (change, earlier) = ((c - b).abs(), (b - a).abs());
                // What is left of a change that shrinks geometrically, at the pace of energy or slower.
                let pace = (change / earlier).max((-0.5f64).exp());
                let doubt = change / (1.0 - pace) / c;
                if pace < 0.9 && doubt < 1e-2 * self.asked.tolerance {
                    march.hazard = Some((c, doubt));
                    break;
                }
            }
        }
        progress(1.0);
        Ok(march)
    }

    /// The fine run with its errors, and the largest of them over the tolerance.
    fn report(&self, layout: &Layout, fine: &Run, others: [&Run; 2]) -> (FirstLoss, Worst) {
        let tolerance = self.asked.tolerance;
        // What the edge of the mesh leaves out of the losses.
        let outside = (-layout.level).exp() * (1.0 + layout.level);
        let gaps = |f: &dyn Fn(&Run) -> f64| -> f64 {
            let each = others.iter().zip(SHARES);
            each.map(|(other, share)| share * (f(fine) - f(other)).abs())
                .sum()
        };
        let mut worst = (0.0, "", None);
        let mut note = |ratio: f64, name, t| {
            if ratio > worst.0 || ratio.is_nan() {
                worst = (ratio, name, t);
            }
        };
        let mut parts = [0.0f64; 2];
        let mut part = |f: &dyn Fn(&Run) -> f64, scale: f64| {
            for ((part, other), share) in parts.iter_mut().zip(others).zip(SHARES) {
                *part = part.max(share * (f(fine) - f(other)).abs() / (tolerance * scale));
            }
        };
        let (mut survival, mut lost, mut density) = (Vec::new(), Vec::new(), Vec::new());
        for (k, t) in layout.times.iter().enumerate() {
            // Beyond the edge all is lost, whatever the mesh says.
            let error = gaps(&|run| run.survival[k])
                + fine.drift[k]
                + outside * (1.0 - fine.survival[k])
                + 4e-16;
            note(error / tolerance, "survival", Some(*t));
            part(&|run| run.survival[k], 1.0);
            survival.push(Estimate::new(fine.survival[k], error, Origin::Space));
            let error = gaps(&|run| run.lost[k]) + fine.drift[k] + (outside + 1e-12) * fine.lost[k];
            lost.push(Estimate::new(fine.lost[k], error, Origin::Space));
            // Near grazing losses the density is of first order in the step.
            let error = 2.0 * gaps(&|run| run.density[k])
                + fine.wobble[k]
                + outside * fine.density[k].abs();
            density.push(Estimate::new(fine.density[k], error, Origin::Space));
        }
        part(&|run| run.mean_time, fine.mean_time);
        part(&|run| run.rate, fine.rate);
        let number = |f: &dyn Fn(&Run) -> f64, residual: f64| {
            let error = gaps(f) + (residual + outside) * f(fine);
            Estimate::new(f(fine), error, Origin::Space)
        };
        let mean_time = number(&|run| run.mean_time, fine.residuals[0]);
        let rate = number(&|run| run.rate, fine.residuals[1]);
        let rate_over_rice = number(&|run| run.over_rice, fine.residuals[1]);
        note(
            mean_time.error / (tolerance * mean_time.value),
            "mean_time",
            None,
        );
        note(rate.error / (tolerance * rate.value), "rate", None);
        let at = worst.2.map_or(String::new(), |t| format!(" at t = {t}"));
        let number = format!("first_loss.{}{at}", worst.1);
        let worst = Worst {
            ratio: worst.0,
            number,
            parts,
        };
        let [nq, nv] = layout.nodes;
        let it = FirstLoss {
            times: layout.times.clone(),
            survival,
            lost,
            density,
            mean_time,
            rate,
            rate_over_rice,
            method: Method {
                name: "backward equation along the exact motion, order 6".into(),
                reason: "absorbed where each motion loses contact".into(),
                cells: layout.nodes,
                unknowns: nq * nv,
                domain: self.domain(layout),
                step: layout.step,
                steps: fine.steps + others.iter().map(|other| other.steps).sum::<u64>(),
                neglected: outside,
            },
            shortfall: None,
        };
        (it, worst)
    }

    fn domain(&self, layout: &Layout) -> [f64; 4] {
        let contact = self.oscillator.contact();
        let rise = contact.potential(self.asked.loss) - contact.lowest_potential().unwrap_or(0.0);
        let top = rise + layout.level * self.oscillator.temperature();
        let right = contact
            .turning_points(top)
            .map_or(self.asked.loss, |ends| ends.1);
        let speed = (2.0 * top).sqrt();
        [self.asked.loss, right, -speed, speed]
    }
}

/// Slope at point k of values a unit apart, by the polynomial through 2 half + 1 of them, central where
/// they are there: order 2 half.
fn derivative(values: &[f64], k: usize, half: usize) -> f64 {
    let points = (2 * half + 1).min(values.len());
    let first = k.saturating_sub(half).min(values.len() - points);
    let z = (k - first) as f64;
    let mut slope = 0.0;
    for a in 0..points {
        // Derivative of the Lagrange polynomial of node a at node z.
        let mut weight = 0.0;
        for b in 0..points {
            if b == a {
                continue;
            }
            let mut product = 1.0 / (a as f64 - b as f64);
            for c in 0..points {
                if c != a && c != b {
                    product *= (z - c as f64) / (a as f64 - c as f64);
                }
            }
            weight += product;
        }
        slope += weight * values[first + a];
    }
    slope
}
