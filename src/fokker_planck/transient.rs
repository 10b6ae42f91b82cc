//! The transient: from a start through the output times, on two meshes, with an error on every number.

use super::choice::{self, Method, Settings, TimeScheme, Way};
use super::density::{Density, Snapshot};
use super::domain::Domain;
use super::flux::Drift;
use super::mesh::Mesh;
use super::observables::Observables;
use super::opening::Opening;
use super::propagator::Propagator;
use crate::error::{Error, Result};
use crate::estimate::{Estimate, Origin};
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
    /// Total probability; the error is what the box leaves out.
    pub mass: Vec<Estimate>,
    /// Lowest value of the density: negative where the scheme undershoots.
    pub lowest_density: Vec<Estimate>,
    /// Relative entropy to the stationary law; None where there is none.
    pub relative_entropy: Vec<Option<Estimate>>,
    /// L1 distance to the stationary law; None where there is none.
    pub distance: Vec<Option<Estimate>>,
    /// Densities at the times that asked for one.
    pub densities: Vec<Snapshot>,
    /// What it was computed with.
    pub method: Method,
    /// What the reader should know.
    pub warnings: Vec<String>,
}

/// One run on one mesh, at one time.
struct Output {
    t: f64,
    moments: Moments,
    mass: f64,
    lowest: f64,
    negative: f64,
    /// What the negative cells weigh in each number.
    undershoot: [f64; 11],
    entropy: f64,
    distance: f64,
    snapshot: Option<Snapshot>,
    /// What a narrow start has cost so far, in probability.
    opening: f64,
    /// Whether a packet in its own frame said it, not a density in the box.
    framed: bool,
}

/// One run on one mesh.
struct Run {
    outputs: Vec<Output>,
    steps: u64,
    step: f64,
    mesh: Mesh,
    domain: Domain,
    unknowns: usize,
    /// Time at which the density was within the tolerance of (21), if it came to that.
    settled: Option<f64>,
}

/// How a run is to be done.
#[derive(Clone, Copy)]
struct Task<'a> {
    oscillator: &'a Oscillator,
    initial: &'a Initial,
    times: &'a [f64],
    density_times: &'a [f64],
    drift: Drift,
    way: Way,
    settings: &'a Settings,
    started: Instant,
}

/// The coarse run: three quarters of the cells in either direction, and steps half as long again where
/// the steps make the error.
const COARSE: (f64, f64) = (0.75, 1.5);

/// Error of the fine run over its difference to the coarse one, where a kink of the force leaves order
/// 1.4: 1/((4/3)^1.4 - 1). A smooth law converges faster and stays far below.
const KINKED: f64 = 2.0;

/// Negative mass beyond which nothing is left of a density.
const NO_DENSITY: f64 = 0.5;

/// What a neglected probability weighs in: the scale, or the number where it is larger, as a kurtosis
/// far above 3 is.
pub(super) fn shape(scale: f64, value: f64) -> f64 {
    scale.max(value.abs())
}

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
/// The error of each number is twice its difference to a second run on a mesh three quarters as fine
/// (which covers the error of the finer one down to order 1.4, what a kink of the force leaves), plus the neglected probability times its
/// scale. For upwind drift, where no two affordable meshes converge, the error adds the change over the
/// time t/(1 + c) to t by which its relaxation is ahead.
///
/// # Errors
/// [`Error::Invalid`] and [`Error::Mesh`] for a start or mesh that cannot work, [`Error::Limit`] when
/// `max_seconds` is reached.
pub fn transient(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    density_times: &[f64],
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Transient> {
    let started = Instant::now();
    let until = times.last().copied().unwrap_or(0.0);
    let (drift, way, reason) = choice::way(oscillator, initial, until, settings)?;
    let task = Task {
        oscillator,
        initial,
        times,
        density_times,
        drift,
        way,
        settings,
        started,
    };
    if drift == Drift::Upwind {
        return upwind(&task, reason, progress);
    }
    // Work grows with the third power of the refinement: the coarse run takes 0.3 of the whole.
    let coarse = task.run(COARSE, times, &|part| progress(0.3 * part))?;
    // The fine run takes 1.5 times as long at least: no use in beginning what cannot end.
    let seconds = started.elapsed().as_secs_f64();
    if 2.5 * seconds > settings.max_seconds {
        return Err(Error::Limit {
            key: "accuracy.max_seconds",
            limit: format!("{}", settings.max_seconds),
            what: format!(
                "the run on three quarters of the cells took {seconds:.1} s, and the fine one would take \
                 {:.0} s or more; fewer method.cells would do",
                1.5 * seconds
            ),
        });
    }
    let fine = task.run((1.0, 1.0), times, &|part| progress(0.3 + 0.7 * part))?;
    let errors = |_: usize, _: usize, value: f64, other: f64| KINKED * (value - other).abs();
    Ok(task.report(fine, &coarse, &errors, reason, Vec::new()))
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
    let errors = |k: usize, i: usize, value: f64, other: f64| {
        let t = task.times[k];
        let window = all
            .iter()
            .filter(|(s, _)| *s >= t / (1.0 + excess) * (1.0 - 1e-12) && *s <= t);
        let change = window
            .filter_map(|(_, m)| m.named()[i].1)
            .map(|earlier| (earlier.value - value).abs())
            .fold(0.0, f64::max);
        // First order: the error of the fine run is as large as its difference to either. Where numbers
        // diffuse more than physics the phase of the motion is lost too: from crest to trough.
        let phase = if excess > 1.0 { 2.0 } else { 1.0 };
        phase * (change + KINKED * (value - other).abs())
    };
    let warning = format!(
        "upwind drift relaxes the energy 1 + c = {:.2} times too fast on this mesh (c = {excess:.3}: \
         numerical over physical diffusion); its error bars say so. Use drift = 8 for an answer",
        1.0 + excess
    );
    Ok(task.report(fine, &coarse, &errors, reason, vec![warning]))
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

impl Task<'_> {
    /// One run on a mesh `finer` times as fine as the chosen one, with steps `longer` times as long.
    fn run(
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
        let mut outputs = Vec::with_capacity(times.len());
        let opening = Opening::of(oscillator, initial, times, drift, settings, (finer, longer))?;
        let opening = match opening {
            None => None,
            Some(mut opening) => {
                let mut watch = |come: f64| {
                    progress(come / until);
                    in_time(come)
                };
                for &t in times {
                    if !opening.advance(t, &mut watch)? {
                        break;
                    }
                    outputs.push(self.look(t, &opening)?);
                }
                if outputs.len() == times.len() {
                    return opened(outputs, &opening);
                }
                Some(opening)
            }
        };
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
        let close = 1e-2 * settings.tolerance;
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
            None => (0.0, 0.0, 0),
            Some(it) => (
                it.packet().time(),
                handed + it.packet().defect(),
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
        })
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
        let moments = observables.raw(&g).moments(observables.contact());
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
            opening: 0.0,
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
            opening: opening.packet().defect(),
            framed: true,
        })
    }

    /// What the boxes leave out or let go.
    fn outside(&self, fine: &Run, coarse: &Run) -> f64 {
        let outside = fine.domain.neglected.max(coarse.domain.neglected);
        if self.oscillator.contact().is_confining() {
            return outside;
        }
        // Open edges let go what comes to them, again and again.
        let all = fine.outputs.iter().chain(&coarse.outputs);
        all.map(|o| (1.0 - o.mass).abs()).fold(outside, f64::max)
    }

    /// Joins two runs: the fine one's numbers, with the errors that `difference` says (of number i at
    /// time k, from the fine and the coarse value) and what the box leaves out.
    fn report(
        &self,
        fine: Run,
        coarse: &Run,
        difference: &dyn Fn(usize, usize, f64, f64) -> f64,
        reason: String,
        mut warnings: Vec<String>,
    ) -> Transient {
        let scales = Scales::of(self.oscillator);
        let confining = self.oscillator.contact().is_confining();
        let outside = self.outside(&fine, coarse);
        let weight = fine.domain.tail_weight(self.oscillator.temperature());
        let mut moments = Vec::new();
        let mut unmet: Option<(f64, &str, f64)> = None;
        // The steps of both runs may err alike.
        let timed = match self.way {
            Way::Volumes(TimeScheme::BackwardEuler) => 0.0,
            // Intervals shorter than a step or two are cut into the same steps by both.
            Way::FlowMap => choice::flow_map_settings(self.oscillator, self.settings, 1.0)
                .map_or(0.0, |it| it.splitting_error(self.oscillator)),
            Way::Volumes(_) => choice::TIME_SHARE * self.settings.tolerance,
        };
        for (k, (here, other_run)) in fine.outputs.iter().zip(&coarse.outputs).enumerate() {
            let (mut now, scale) = (here.moments, scales.each(&here.moments));
            let names = now.named().map(|(name, _)| name);
            let others = other_run.moments.named();
            for (i, number) in now.each_mut().into_iter().enumerate() {
                let (Some(number), Some(other)) = (number, others[i].1) else {
                    continue;
                };
                // A settled run stays within its distance of (21); tails weigh ten scales.
                let settled = fine.settled.is_some_and(|s| here.t >= s);
                let settled = if settled { here.distance } else { 0.0 };
                let boxed = if here.framed { 0.0 } else { weight * outside };
                let tail = (boxed + 10.0 * settled) * shape(scale[i], number.value);
                let shared = timed + here.opening;
                let error = difference(k, i, number.value, other.value)
                    + tail
                    + shared * scale[i]
                    + here.undershoot[i].max(other_run.undershoot[i]);
                *number = Estimate::new(number.value, error, Origin::Space);
                let ratio = error / (self.settings.tolerance * scale[i]);
                if ratio > unmet.map_or(1.0, |u| u.0) {
                    unmet = Some((ratio, names[i], here.t));
                }
            }
            moments.push(now);
        }
        if let Some((ratio, name, t)) = unmet {
            warnings.push(format!(
                "the tolerance {:e} is not met: the error of {name} at t = {t} is {ratio:.1} times too \
                 large; more cells would help",
                self.settings.tolerance
            ));
        }
        if let Some(t) = fine.settled {
            warnings.push(format!(
                "at t = {t:.1} the density was within {:.0e} of the stationary law in L1: the march \
                 stopped there, and later times repeat it",
                1e-2 * self.settings.tolerance
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
                .map(|o| Estimate::new(o.mass, outside, Origin::Domain))
                .collect(),
            lowest_density: pairs()
                .map(|(a, b)| Estimate::new(a.lowest, (a.lowest - b.lowest).abs(), Origin::Space))
                .collect(),
            relative_entropy: both(|o| o.entropy),
            distance: both(|o| o.distance),
            method: Method {
                name: self.way.name(self.drift),
                reason,
                cells: fine.mesh.cells(),
                unknowns: fine.unknowns,
                domain: fine.mesh.domain(),
                step: fine.step,
                steps: fine.steps + coarse.steps,
                neglected: outside,
            },
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
fn opened(outputs: Vec<Output>, opening: &Opening) -> Result<Run> {
    let mesh = opening.own_mesh()?;
    Ok(Run {
        outputs,
        steps: opening.packet().steps(),
        step: opening.packet().step(),
        unknowns: mesh.len(),
        mesh,
        domain: opening.domain(),
        settled: None,
    })
}
