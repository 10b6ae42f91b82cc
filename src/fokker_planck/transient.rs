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
    let fine = task.run((1.0, 1.0), times, &|part| progress(0.3 + 0.7 * part))?;
    let errors = |_: usize, _: usize, value: f64, other: f64| KINKED * (value - other).abs();
    Ok(task.report(fine, &coarse, &errors, reason, Vec::new()))
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
    let excess = choice::upwind_excess(task.oscillator, &mesh);
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
    let coarse = task.run((0.5, 1.0), task.times, &|part| progress(0.15 * part))?;
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
        change + (value - other).abs()
    };
    let warning = format!(
        "upwind drift relaxes the energy 1 + c = {:.2} times too fast on this mesh (c = {excess:.3}: \
         numerical over physical diffusion); its error bars say so. Use drift = 8 for an answer",
        1.0 + excess
    );
    Ok(task.report(fine, &coarse, &errors, reason, vec![warning]))
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
        let opening = Opening::of(oscillator, initial, times, drift, settings, (finer, longer))?;
        let (opening, mut outputs) = self.open(opening, times, &mut |come| {
            progress(come / until);
            in_time(come)
        })?;
        if let Some(opening) = opening.as_ref().filter(|_| outputs.len() == times.len()) {
            return opened(outputs, opening);
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
            Some(it) => (it.packet().time(), handed + it.cost(), it.packet().steps()),
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
        if outputs.iter().any(|o| !o.mass.is_finite()) {
            return Err(Error::Mesh {
                what: format!("the density grew without bound with steps of {step:.2e}"),
                help: "a smaller method.step".into(),
            });
        }
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
        Output {
            t,
            moments: observables
                .raw(&propagator.ratio(density))
                .moments(observables.contact()),
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
            entropy: look.entropy,
            distance: look.distance,
            snapshot: wanted.then(|| opening.snapshot()).transpose()?,
            opening: opening.cost(),
            framed: true,
        })
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
        let outside = fine.domain.neglected.max(coarse.domain.neglected);
        let weight = fine.domain.tail_weight(self.oscillator.temperature());
        let mut moments = Vec::new();
        let mut unmet: Option<(f64, &str, f64)> = None;
        // The steps of both runs may err alike.
        let timed = match self.way {
            Way::Volumes(TimeScheme::BackwardEuler) | Way::FlowMap => 0.0,
            Way::Volumes(_) => choice::TIME_SHARE * self.settings.tolerance,
        };
        for (k, (here, other)) in fine.outputs.iter().zip(&coarse.outputs).enumerate() {
            let (mut now, scale) = (here.moments, scales.each(&here.moments));
            let names = now.named().map(|(name, _)| name);
            let others = other.moments.named();
            for (i, number) in now.each_mut().into_iter().enumerate() {
                let (Some(number), Some(other)) = (number, others[i].1) else {
                    continue;
                };
                // A settled run stays within its distance of (21); tails weigh ten scales.
                let settled = fine.settled.map_or(0.0, |_| here.distance);
                let boxed = if here.framed { 0.0 } else { weight * outside };
                let tail = (boxed + 10.0 * settled) * scale[i];
                let shared = timed + here.opening;
                let error = difference(k, i, number.value, other.value) + tail + shared * scale[i];
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
