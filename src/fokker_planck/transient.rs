//! The transient: from a start through the output times, on two meshes, with an error on every number.

use super::choice::{self, Method, Settings, TimeScheme};
use super::density::{Density, Snapshot};
use super::domain::Domain;
use super::flux::Drift;
use super::generator::Generator;
use super::mesh::Mesh;
use super::observables::Observables;
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
    time: TimeScheme,
    settings: &'a Settings,
    started: Instant,
}

/// Solves (17) from `initial` through `times` (ascending); densities are kept at `density_times`, a
/// part of them. `progress` is told the part done, 0 to 1.
///
/// The error of each number is its difference to a second run on a mesh three quarters as fine (which
/// for a converging scheme exceeds the error of the finer one), plus the neglected probability times its
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
    let (drift, why_drift) = choice::drift(settings)?;
    let (time, why_time) = if let Some(time) = settings.time {
        (time, "the scene asks for this scheme in time".to_string())
    } else {
        let (mesh, _) = choice::mesh(oscillator, initial, until, drift, settings, 1.0)?;
        let generator = Generator::new(oscillator, &mesh, drift)?;
        choice::time_scheme(oscillator, &generator, settings, until)
    };
    let reason = format!("{why_drift}; {why_time}");
    let task = Task {
        oscillator,
        initial,
        times,
        density_times,
        drift,
        time,
        settings,
        started,
    };
    if drift == Drift::Upwind {
        return upwind(&task, reason, progress);
    }
    // Work grows with the third power of the refinement: the coarse run takes 0.3 of the whole.
    let coarse = task.run(0.75, times, &|part| progress(0.3 * part))?;
    let fine = task.run(1.0, times, &|part| progress(0.3 + 0.7 * part))?;
    let errors = |k: usize, i: usize, value: f64, other: f64| {
        let _ = (k, i);
        (value - other).abs()
    };
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
    let coarse = task.run(0.5, task.times, &|part| progress(0.15 * part))?;
    let mut fine = task.run(1.0, &times, &|part| progress(0.15 + 0.85 * part))?;
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
    /// One run on a mesh `finer` times as fine as the chosen one.
    fn run(&self, finer: f64, times: &[f64], progress: &dyn Fn(f64)) -> Result<Run> {
        let until = times.last().copied().unwrap_or(0.0);
        let (mesh, domain) = choice::mesh(
            self.oscillator,
            self.initial,
            until,
            self.drift,
            self.settings,
            finer,
        )?;
        let generator = Generator::new(self.oscillator, &mesh, self.drift)?;
        let observables =
            Observables::new(self.oscillator, &mesh, self.drift, generator.weights())?;
        let mut density = Density::start(&generator, self.initial)?;
        let mut march = choice::march(self.oscillator, &generator, self.time, self.settings, until);
        let confining = self.oscillator.contact().is_confining();
        let close = 1e-2 * self.settings.tolerance;
        let mut run = Run {
            outputs: Vec::with_capacity(times.len()),
            steps: 0,
            step: 0.0,
            mesh,
            domain,
            unknowns: generator.unknowns(),
            settled: None,
        };
        // Short steps are not all looked at.
        let every = if self.time == TimeScheme::Imex { 16 } else { 1 };
        let (mut now, mut steps) = (0.0, 0_u64);
        for &t in times {
            if now < t && run.settled.is_none() {
                let mut watch = |done: f64, density: &Density| {
                    steps += 1;
                    if steps % every > 0 {
                        return Ok(true);
                    }
                    progress((now + done) / until);
                    let seconds = self.started.elapsed().as_secs_f64();
                    if seconds > self.settings.max_seconds {
                        let come = now + done;
                        return Err(Error::Limit {
                            key: "accuracy.max_seconds",
                            limit: format!("{}", self.settings.max_seconds),
                            what: format!("the transient had come to t = {come:.3} of {until}"),
                        });
                    }
                    if confining && density.distance(generator.weights(), &generator) < close {
                        run.settled = Some(now + done);
                    }
                    Ok(run.settled.is_none())
                };
                march.advance(&mut density, t - now, &mut watch)?;
                now = t;
            }
            run.outputs
                .push(self.observe(t, &generator, &observables, &density));
        }
        run.steps = march.steps();
        run.step = march.longest();
        if run.outputs.iter().any(|o| !o.mass.is_finite()) {
            return Err(Error::Mesh {
                what: format!(
                    "the density grew without bound with steps of {:.2e}",
                    run.step
                ),
                help: "a smaller method.step".into(),
            });
        }
        Ok(run)
    }

    fn observe(
        &self,
        t: f64,
        generator: &Generator,
        observables: &Observables,
        density: &Density,
    ) -> Output {
        let inverse = generator.inverse_weights();
        let g: Vec<f64> = density
            .cells()
            .iter()
            .zip(inverse)
            .map(|(p, w)| p * w)
            .collect();
        let wanted = self.density_times.contains(&t);
        Output {
            t,
            moments: observables.raw(&g).moments(observables.contact()),
            mass: density.mass(),
            lowest: density.lowest(),
            negative: density.negative_mass(),
            entropy: density.relative_entropy(generator.weights(), generator),
            distance: density.distance(generator.weights(), generator),
            snapshot: wanted.then(|| density.snapshot(t)),
        }
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
        let mut moments = Vec::new();
        let mut unmet: Option<(f64, &str, f64)> = None;
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
                let tail = (100.0 * outside + 10.0 * settled) * scale[i];
                let error = difference(k, i, number.value, other.value) + tail;
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
                name: format!("finite volumes, {:?}, {}", self.drift, self.time.name()),
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
