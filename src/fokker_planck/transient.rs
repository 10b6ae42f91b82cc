//! The transient: from a start through the output times, on two meshes, with an error on every number.

use super::bars::{self, Bars};
use super::choice::{self, Method, Settings, TimeScheme, TransientMethod, Way};
use super::cost;
use super::density::{Density, Snapshot};
use super::domain::Domain;
use super::flow_map;
use super::flux::Drift;
use super::mesh::Mesh;
use super::observables::Observables;
use super::opening::{Loss, Opening};
use super::propagator::Propagator;
use super::refinement;
use crate::error::{Error, Result};
use crate::estimate::{Estimate, Origin, Shortfall};
use crate::initial::Initial;
use crate::moments::Moments;
use crate::oscillator::Oscillator;
use crate::scales::Scales;
use std::time::Instant;

/// The answer of a transient solve, one entry per output time.
#[derive(Debug, Clone, PartialEq)]
pub struct Transient {
    /// The output times, ascending.
    pub times: Vec<f64>,
    /// Moments with their errors.
    pub moments: Vec<Moments>,
    /// Total probability; the error is what the box leaves out, and at least what is missing to 1.
    pub mass: Vec<Estimate>,
    /// Lowest value of the density: negative where the scheme undershoots.
    pub lowest_density: Vec<Estimate>,
    /// Integral of the negative part of the density, >= 0: 0 for a scheme that keeps the sign. The error is
    /// the difference of the two runs.
    pub negative_mass: Vec<Estimate>,
    /// Relative entropy to the stationary law; None where there is none.
    pub relative_entropy: Vec<Option<Estimate>>,
    /// L1 distance to the stationary law; None where there is none.
    pub distance: Vec<Option<Estimate>>,
    /// Densities at the times that asked for one.
    pub densities: Vec<Snapshot>,
    /// What it was computed with.
    pub method: Method,
    /// What the tolerance asked for and was not reached.
    pub shortfall: Option<Shortfall>,
    /// What the reader should know.
    pub warnings: Vec<String>,
}

/// One run on one mesh, at one time.
pub(super) struct Output {
    pub(super) t: f64,
    pub(super) moments: Moments,
    mass: f64,
    lowest: f64,
    negative: f64,
    /// What the negative cells weigh in each number.
    pub(super) undershoot: [f64; 11],
    entropy: f64,
    pub(super) distance: f64,
    snapshot: Option<Snapshot>,
    /// Steps up to here on the mesh, those of a packet not counted.
    pub(super) steps: u64,
    /// What these steps have left of their errors in the L1 norm, as far as they are estimated.
    pub(super) step_error: f64,
    /// What a narrow start has cost so far.
    pub(super) opening: Loss,
    /// Whether a packet in its own frame said it, not a density in the box.
    pub(super) framed: bool,
}

/// One run on one mesh.
pub(super) struct Run {
    pub(super) outputs: Vec<Output>,
    pub(super) steps: u64,
    step: f64,
    pub(super) mesh: Mesh,
    pub(super) domain: Domain,
    unknowns: usize,
    /// Time at which the density was within the tolerance of (21), if it came to that.
    pub(super) settled: Option<f64>,
    /// Seconds it took.
    pub(super) seconds: f64,
}

/// How a run is to be done.
#[derive(Clone, Copy)]
pub(super) struct Task<'a> {
    pub(super) oscillator: &'a Oscillator,
    pub(super) initial: &'a Initial,
    pub(super) times: &'a [f64],
    pub(super) density_times: &'a [f64],
    pub(super) drift: Drift,
    pub(super) way: Way,
    pub(super) settings: &'a Settings,
    pub(super) started: Instant,
}

/// Distance to the stationary law at which a run stops, over the tolerance.
pub(super) const SETTLED: f64 = 1e-2;

/// Negative mass beyond which nothing is left of a density.
const NO_DENSITY: f64 = 1.0;

/// The change of every number if the negative cells were positive: where a density undershoots, two
/// meshes may agree on what is wrong.
fn undershoot(moments: &Moments, g: &[f64], observables: &Observables) -> [f64; 11] {
    if g.iter().all(|g| *g >= 0.0) {
        return [0.0; 11];
    }
    let positive: Vec<f64> = g.iter().map(|g| g.abs()).collect();
    let without = observables.raw(&positive).moments(observables.contact());
    let change = |k: usize| -> Option<f64> {
        let change = (without.named()[k].1?.value - moments.named()[k].1?.value).abs();
        change.is_finite().then_some(change)
    };
    std::array::from_fn(|k| change(k).unwrap_or(0.0))
}

/// Refuses outputs that are no densities.
fn believable(
    outputs: &[Output],
    step: f64,
    domain: &Domain,
    temperature: f64,
    mesh: &Mesh,
) -> Result<()> {
    if let Some(o) = outputs.iter().find(|o| !o.mass.is_finite()) {
        return Err(Error::Mesh {
            what: format!(
                "the density grew without bound with steps of {step:.2e} up to t = {}",
                o.t
            ),
            help: "a smaller method.step, or more method.cells".into(),
        });
    }
    match outputs.iter().find(|o| o.negative > NO_DENSITY) {
        Some(o) => Err(lost(o, domain, temperature, mesh)),
        None => Ok(()),
    }
}

/// A run whose density is none.
fn lost(o: &Output, domain: &Domain, temperature: f64, mesh: &Mesh) -> Error {
    let [nq, nv] = mesh.cells();
    let levels = 0.5 * domain.v[1].powi(2) / temperature;
    Error::Mesh {
        what: format!(
            "at t = {} the density on {nq} x {nv} cells is negative by {:.1e} in all: between the start and \
             the stationary law lie energies up to {levels:.0} T, and p over the stationary law spans \
             e^{levels:.0}",
            o.t, o.negative
        ),
        help: "a start nearer to the stationary law, more method.cells, transient = \"finite_volume\", or \
               [monte_carlo] alone"
            .into(),
    }
}

/// Solves (17) from `initial` through `times` (ascending); densities are kept at `density_times`, a
/// part of them. `progress` is told the part done, 0 to 1.
///
/// The error of each number comes from its difference to a second run with a coarser mesh, and with longer steps
/// where these do not know their own error, taken so large that it covers convergence of order 2, two thirds of
/// what a kink of the force leaves; plus what the steps know of their error, what the box leaves out, and
/// rounding. Where cells or steps are left to the program they are refined until every error is within the
/// tolerance or a limit says stop; what was not reached is in `shortfall`. For upwind drift, where no two affordable meshes converge, the error adds the change over
/// the time t/(1 + c) to t by which its relaxation is ahead, and nothing is refined.
///
/// Mass has the natural scale 1; relative entropy and distance to the stationary law come with the
/// difference of the two runs. These and the lowest density, a diagnostic, are not bound by the
/// tolerance: they say how good the density is, not what it says.
///
/// # Errors
/// [`Error::Invalid`] and [`Error::Mesh`] for a start or mesh that cannot work, [`Error::Limit`] when
/// `max_seconds` is reached before there is any answer.
pub fn transient(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    density_times: &[f64],
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Transient> {
    let started = Instant::now();
    let (drift, way, reason) = choice::way(oscillator, initial, times, settings)?;
    // Chosen before anything runs: the tails of the stationary law are known.
    let boxed = Settings {
        neglected: Some(refinement::neglected(oscillator, initial, settings)?),
        ..settings.clone()
    };
    let task = Task {
        oscillator,
        initial,
        times,
        density_times,
        drift,
        way,
        settings: &boxed,
        started,
    };
    if drift == Drift::Upwind {
        return upwind(&task, reason, progress);
    }
    refinement::refined(&task, reason, progress)
}

/// How far ahead the relaxation of upwind drift with backward Euler is: c of the energy, of diffusion
/// along q, |v| dq/2 beside T/(2 zeta) where friction rules, and of steps dt, which damp an oscillation by
/// dt/2 beside zeta.
fn ahead(task: &Task, mesh: &Mesh) -> f64 {
    let (zeta, sigma) = (task.oscillator.zeta(), task.oscillator.temperature().sqrt());
    let width = mesh.q.at(mesh.q.locate(0.0)).1;
    let automatic = choice::euler_step_on(mesh);
    let step = task.settings.step.unwrap_or(automatic);
    choice::upwind_excess(task.oscillator, mesh)
        + 0.8 * zeta * width / sigma
        + 0.5 * step.min(longest_interval(task.times)) / zeta
}

/// Upwind: the honest error names how far ahead its relaxation is.
fn upwind(task: &Task, reason: String, progress: &(dyn Fn(f64) + Sync)) -> Result<Transient> {
    let settings = task.settings;
    let until = task.times.last().copied().unwrap_or(0.0);
    let (mesh, _) = choice::mesh(
        task.oscillator,
        task.initial,
        until,
        task.drift,
        settings,
        1.0,
    )?;
    let excess = ahead(task, &mesh);
    // Between t/(1 + c) and t, eight times to look for the largest change.
    let mut times: Vec<f64> = task.times.to_vec();
    let ahead = |t: f64| {
        (0..8).map(move |k| {
            let slowest = t / (1.0 + excess);
            slowest + (t - slowest) * f64::from(k) / 8.0
        })
    };
    times.extend(task.times.iter().flat_map(|t| ahead(*t)));
    times.sort_by(f64::total_cmp);
    times.dedup();
    // Half the cells; where the scene gives the step, half of that too, or both would err alike.
    let mut halved = settings.clone();
    halved.step = settings
        .step
        .map(|step| 0.5 * step.min(longest_interval(task.times)));
    let halved = Task {
        settings: &halved,
        ..*task
    };
    let coarse = halved.run((0.5, 1.0), task.times, &|part| progress(0.15 * part))?;
    let mut fine = task.run((1.0, 1.0), &times, &|part| progress(0.15 + 0.85 * part))?;
    let all: Vec<(f64, Moments)> = fine.outputs.iter().map(|o| (o.t, o.moments)).collect();
    fine.outputs.retain(|o| task.times.contains(&o.t));
    // First order: the fine run errs as much as it differs from one on half the cells; twice, to be safe.
    let mut bars = task.bars(&fine, &coarse, 2.0);
    // Where numbers diffuse more than physics the phase of the motion is lost too: from crest to trough.
    let phase = if excess > 1.0 { 2.0 } else { 1.0 };
    for ((t, errors), now) in task.times.iter().zip(&mut bars.space).zip(&fine.outputs) {
        let window = all
            .iter()
            .filter(|(s, _)| *s >= t / (1.0 + excess) * (1.0 - 1e-12) && s <= t);
        let mut change = [0.0_f64; 11];
        for (_, earlier) in window {
            let pairs = earlier.named().into_iter().zip(now.moments.named());
            for (change, ((_, earlier), (_, now))) in change.iter_mut().zip(pairs) {
                if let (Some(earlier), Some(now)) = (earlier, now) {
                    *change = change.max((earlier.value - now.value).abs());
                }
            }
        }
        for (error, change) in errors.iter_mut().zip(change) {
            *error = phase * (*error + change);
        }
    }
    let warning = format!(
        "upwind drift relaxes the energy 1 + c = {:.2} times too fast on this mesh (c = {excess:.3}: \
         numerical over physical diffusion); its error bars say so. Use drift = 8 for an answer",
        1.0 + excess
    );
    let why = "upwind drift is of first order, and no affordable mesh would do".to_string();
    let free = settings.cells.is_none();
    Ok(task.report(fine, &coarse, &bars, reason, (why, free), vec![warning]))
}

/// The longest time without an output, from 0 on.
fn longest_interval(times: &[f64]) -> f64 {
    let before = std::iter::once(&0.0).chain(times);
    let longest = times
        .iter()
        .zip(before)
        .map(|(b, a)| b - a)
        .fold(0.0, f64::max);
    if longest > 0.0 { longest } else { 1.0 }
}

/// What the steps may have done over what they say of it (tests/time.rs).
const DOUBT: f64 = 2.0;

/// What an error of the steps in the L1 norm does to a number in its natural scale, beside what two runs with
/// different steps show of it: with 0.08 means of one scene of the calibration erred 1.8 times their bars.
const IN_MOMENTS: f64 = 0.2;

impl Task<'_> {
    /// One run on a mesh `finer` times as fine as the chosen one, with steps `longer` times as long.
    pub(super) fn run(
        &self,
        (finer, longer): (f64, f64),
        times: &[f64],
        progress: &dyn Fn(f64),
    ) -> Result<Run> {
        let Self {
            oscillator,
            initial,
            settings,
            drift,
            ..
        } = *self;
        let began = Instant::now();
        let until = times.last().copied().unwrap_or(0.0);
        let in_time = |come: f64| {
            if self.started.elapsed().as_secs_f64() > settings.max_seconds {
                return Err(Error::Limit {
                    key: "accuracy.max_seconds",
                    limit: format!("{}", settings.max_seconds),
                    what: format!("the transient had come to t = {come:.3} of {until}"),
                });
            }
            Ok(())
        };
        let opening = Opening::of(oscillator, initial, times, drift, settings, (finer, longer))?;
        let (opening, mut outputs) = self.open(opening, times, &mut |come| {
            progress(come / until);
            in_time(come)
        })?;
        if let Some(opening) = opening.as_ref().filter(|_| outputs.len() == times.len()) {
            return opened(outputs, opening, began);
        }
        let (mesh, domain) = match &opening {
            None => choice::mesh(oscillator, initial, until, drift, settings, finer)?,
            Some(opening) => opening.mesh()?,
        };
        let mut propagator =
            choice::propagator(oscillator, &mesh, drift, self.way, settings, until, longer)?;
        let observables = Observables::new(oscillator, &mesh, drift, propagator.weights())?;
        let (mut density, handed) = match &opening {
            None => (propagator.start(initial)?, 0.0),
            Some(opening) => opening.density(&propagator),
        };
        let confining = oscillator.contact().is_confining();
        let close = SETTLED * settings.tolerance;
        let mut settled = None;
        // Short steps are not all looked at.
        let every = if self.way == Way::Volumes(TimeScheme::Imex) {
            16
        } else {
            1
        };
        let weights = propagator.weights().clone();
        let columns = propagator.columns().to_vec();
        let (mut now, spent, opened) = match &opening {
            None => (0.0, Loss::default(), 0),
            Some(it) => (
                it.packet().time(),
                it.loss().and(handed),
                it.packet().steps(),
            ),
        };
        let mut looks = 0_u64;
        for &t in &times[outputs.len()..] {
            if now < t && settled.is_none() {
                let mut watch = |done: f64, density: &Density| {
                    looks += 1;
                    if !looks.is_multiple_of(every) {
                        return Ok(true);
                    }
                    progress((now + done) / until);
                    in_time(now + done)?;
                    if confining && density.distance(&weights, &columns) < close {
                        settled = Some(now + done);
                    }
                    Ok(settled.is_none())
                };
                propagator.advance(&mut density, t - now, &mut watch)?;
                now = t;
            }
            outputs.push(Output {
                steps: propagator.steps(),
                step_error: propagator.step_error(),
                opening: spent,
                ..self.observe(t, &propagator, &observables, &density)
            });
        }
        let step = propagator.step();
        believable(&outputs, step, &domain, oscillator.temperature(), &mesh)?;
        Ok(Run {
            outputs,
            steps: opened + propagator.steps(),
            step,
            mesh,
            domain,
            unknowns: propagator.unknowns(),
            settled,
            seconds: began.elapsed().as_secs_f64(),
        })
    }

    /// Carries a packet, if there is one, through the times that it reaches before a mesh takes over.
    fn open<'b>(
        &self,
        mut opening: Option<Opening<'b>>,
        times: &[f64],
        watch: &mut dyn FnMut(f64) -> Result<()>,
    ) -> Result<(Option<Opening<'b>>, Vec<Output>)> {
        let mut outputs = Vec::with_capacity(times.len());
        if let Some(opening) = &mut opening {
            for &t in times {
                if !opening.advance(t, watch)? {
                    break;
                }
                outputs.push(self.look(t, opening)?);
            }
        }
        Ok((opening, outputs))
    }

    fn observe(
        &self,
        t: f64,
        propagator: &Propagator,
        observables: &Observables,
        density: &Density,
    ) -> Output {
        let (weights, columns) = (propagator.weights(), propagator.columns());
        let wanted = self.density_times.contains(&t);
        let g = propagator.ratio(density);
        let mut moments = observables.raw(&g).moments(observables.contact());
        moments.drop_shape_of_flight(choice::neglected(self.settings.tolerance));
        Output {
            t,
            moments,
            undershoot: undershoot(&moments, &g, observables),
            mass: density.mass(),
            lowest: density.lowest(),
            negative: density.negative_mass(),
            entropy: density.relative_entropy(weights, columns),
            distance: density.distance(weights, columns),
            snapshot: wanted.then(|| density.snapshot(t)),
            steps: 0,
            step_error: 0.0,
            opening: Loss::default(),
            framed: false,
        }
    }

    /// What a packet says at time t.
    fn look(&self, t: f64, opening: &Opening) -> Result<Output> {
        let look = opening.look();
        let wanted = self.density_times.contains(&t);
        Ok(Output {
            t,
            moments: look.moments,
            mass: 1.0,
            lowest: look.lowest,
            negative: look.negative,
            undershoot: [0.0; 11],
            entropy: look.entropy,
            distance: look.distance,
            snapshot: wanted.then(|| opening.snapshot()).transpose()?,
            steps: 0,
            step_error: 0.0,
            opening: opening.loss(),
            framed: true,
        })
    }

    /// The same task by finite volumes, with the reason for their scheme.
    pub(super) fn volumes(&self) -> Result<(Self, String)> {
        let settings = Settings {
            method: Some(TransientMethod::FiniteVolume),
            ..self.settings.clone()
        };
        let (drift, way, reason) =
            choice::way(self.oscillator, self.initial, self.times, &settings)?;
        Ok((
            Self {
                drift,
                way,
                ..*self
            },
            reason,
        ))
    }

    /// Whether the error of the steps is known without a run with longer ones: that of a Chebyshev series is
    /// chosen, implicit ones add up their estimates. A packet does neither, nor a step of the scene.
    pub(super) fn knows_its_steps(&self) -> bool {
        let narrow = choice::is_narrow(self.oscillator, self.initial, self.drift, self.settings);
        match self.way {
            Way::FlowMap | Way::Volumes(TimeScheme::BackwardEuler) => false,
            Way::Volumes(_) => self.settings.step.is_none() && matches!(narrow, Ok(false)),
        }
    }

    /// Its method, for people.
    pub(super) fn name(&self) -> String {
        self.way.name(self.drift)
    }

    /// Seconds on one core and bytes foreseen of a run.
    pub(super) fn work(&self, finer: f64, longer: f64) -> Result<(f64, f64)> {
        let size = cost::run(
            self.oscillator,
            self.initial,
            self.times,
            (self.drift, self.way),
            self.settings,
            (finer, longer),
        )?;
        Ok((size.seconds, size.memory as f64))
    }

    /// The bars of a fine run from its difference to a coarse one, `factor` times.
    pub(super) fn bars(&self, fine: &Run, coarse: &Run, factor: f64) -> Bars {
        let scales = Scales::of(self.oscillator);
        let outside = self.outside(fine, coarse);
        let weights = fine.domain.tail_weights(self.oscillator);
        let mut bars = Bars::of(
            fine,
            coarse,
            &scales,
            weights.map(|weight| weight * outside),
        );
        bars.space = bars::differences(fine, coarse, factor, &scales);
        bars.joint = true;
        bars.alike = self.alike(fine);
        bars
    }

    /// What the steps of both runs may have done alike by each output, in natural scales.
    fn alike(&self, fine: &Run) -> Vec<f64> {
        let outputs = fine.outputs.iter();
        match self.way {
            Way::Volumes(TimeScheme::Explicit) => outputs
                .map(|_| choice::SERIES_SHARE * self.settings.tolerance)
                .collect(),
            // Steps that choose themselves by the same estimate.
            Way::Volumes(_) => {
                let part = if self.knows_its_steps() {
                    DOUBT
                } else {
                    IN_MOMENTS
                };
                outputs.map(|it| part * it.step_error).collect()
            }
            // Two runs show little of what the steps of a flow map do: short intervals are cut alike or by other
            // rules, and the errors of either pass through zero between them.
            Way::FlowMap => {
                let settings = choice::flow_map_settings(self.oscillator, self.settings, 1.0);
                let splitting = settings.map_or(0.0, |it| {
                    // A mesh may ask for longer steps than the tolerance does.
                    let step = fine.step;
                    flow_map::Settings { step, ..it }.splitting_error(self.oscillator)
                });
                let rate = 4.0 * self.oscillator.zeta();
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
    fn outside(&self, fine: &Run, coarse: &Run) -> f64 {
        let outside = fine.domain.neglected.max(coarse.domain.neglected);
        if self.oscillator.contact().is_confining() {
            return outside;
        }
        // Open edges let go what comes to them, again and again.
        let outputs = fine.outputs.iter().chain(&coarse.outputs);
        let gone = outputs.map(|o| (1.0 - o.mass).abs()).fold(0.0, f64::max);
        outside.max(gone)
    }

    /// Joins two runs: the fine one's numbers with their bars. `why` says why there was no further
    /// refinement, and whether there was the freedom to refine.
    pub(super) fn report(
        &self,
        fine: Run,
        coarse: &Run,
        bars: &Bars,
        reason: String,
        (why, free): (String, bool),
        mut warnings: Vec<String>,
    ) -> Transient {
        let confining = self.oscillator.contact().is_confining();
        let outside = self.outside(&fine, coarse);
        let mut moments: Vec<Moments> = fine.outputs.iter().map(|it| it.moments).collect();
        for (k, moments) in moments.iter_mut().enumerate() {
            bars.write(k, moments);
        }
        let (worst, k, i) = bars.worst(&fine);
        let tolerance = self.settings.tolerance;
        let shortfall = (worst > tolerance || worst.is_nan()).then(|| Shortfall {
            number: format!("{} at t = {}", moments[k].named()[i].0, fine.outputs[k].t),
            ratio: worst / tolerance,
            tolerance,
            free,
            reason: why,
        });
        warnings.extend(shortfall.iter().map(Shortfall::to_string));
        if let Some(t) = fine.settled {
            warnings.push(format!(
                "at t = {t:.1} the density was within {:.0e} of the stationary law in L1: the march \
                 stopped there, and later times repeat it",
                SETTLED * self.settings.tolerance
            ));
        }
        let pairs = || fine.outputs.iter().zip(&coarse.outputs);
        let both = |f: fn(&Output) -> f64| -> Vec<Option<Estimate>> {
            pairs()
                .map(|(a, b)| {
                    let error = (f(a) - f(b)).abs() + outside;
                    confining.then(|| Estimate::new(f(a), error, Origin::Space))
                })
                .collect()
        };
        let negative = fine.outputs.iter().map(|o| o.negative).fold(0.0, f64::max);
        if negative > self.settings.tolerance {
            warnings.push(format!(
                "the density is negative somewhere: up to {negative:.1e} in all"
            ));
        }
        Transient {
            times: fine.outputs.iter().map(|o| o.t).collect(),
            moments,
            mass: fine
                .outputs
                .iter()
                // All there is has probability 1.
                .map(|o| {
                    let error = outside.max((1.0 - o.mass).abs());
                    Estimate::new(o.mass, error, Origin::Domain)
                })
                .collect(),
            lowest_density: pairs()
                .map(|(a, b)| Estimate::new(a.lowest, (a.lowest - b.lowest).abs(), Origin::Space))
                .collect(),
            negative_mass: pairs()
                .map(|(a, b)| {
                    let error = (a.negative - b.negative).abs();
                    Estimate::new(a.negative, error, Origin::Space)
                })
                .collect(),
            relative_entropy: both(|o| o.entropy),
            distance: both(|o| o.distance),
            method: Method {
                name: self.name(),
                reason,
                cells: fine.mesh.cells(),
                unknowns: fine.unknowns,
                domain: fine.mesh.domain(),
                step: fine.step,
                steps: fine.steps + coarse.steps,
                neglected: outside,
            },
            shortfall,
            densities: fine
                .outputs
                .into_iter()
                .filter_map(|o| o.snapshot)
                .collect(),
            warnings,
        }
    }
}

/// A run that never left the frame of its packet.
fn opened(outputs: Vec<Output>, opening: &Opening, began: Instant) -> Result<Run> {
    let mesh = opening.own_mesh()?;
    Ok(Run {
        outputs,
        steps: opening.packet().steps(),
        step: opening.packet().step(),
        unknowns: mesh.len(),
        mesh,
        domain: opening.domain(),
        settled: None,
        seconds: began.elapsed().as_secs_f64(),
    })
}
