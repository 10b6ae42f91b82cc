//! Ensembles: moments of independent paths at given times.

use super::events::Deaf;
use super::histogram::{Bins, Counts, Histogram};
use super::law::{self, Law, WithLaw};
use super::noise::LANES;
use super::paths::{Paths, highest_frequency};
use super::scheme::{self, Coefficients, Group};
use super::statistics::{FEW, Frames, Sums, unknown};
use super::{EnsembleSettings, Noise, Progress, Scheme, check_bins, scheme_and_step};
use crate::error::{Error, Result};
use crate::estimate::Warning;
use crate::initial::Initial;
use crate::moments::Moments;
use crate::oscillator::Oscillator;
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// A band that ends below twice the resonance distorts what the contact does.
const RESONANCE: f64 = 2.0;

/// Paths per block: the unit in which sums are added.
pub(super) const BLOCK: u64 = 256;

/// Most tasks an ensemble is cut into; bounds the memory and never depends on the threads.
pub(super) const TASKS: u64 = 128;

/// Moments of an ensemble at the times asked for, and how they were made.
#[derive(Debug, Clone, PartialEq)]
pub struct EnsembleResult {
    /// The output times.
    pub times: Vec<f64>,
    /// Moments at each time; every error is one standard error.
    pub moments: Vec<Moments>,
    /// Densities at each time; empty unless [`EnsembleSettings::bins`] asks for them.
    pub densities: Vec<Densities>,
    /// Number of paths.
    pub paths: u64,
    /// Steps of one path.
    pub steps: u64,
    /// Longest step.
    pub step: f64,
    /// The scheme used, never [`Scheme::Auto`].
    pub scheme: Scheme,
    /// Paths times steps.
    pub path_steps: u64,
    /// What a reader of the numbers should know.
    pub warnings: Vec<Warning>,
}

/// Densities of an ensemble at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Densities {
    /// Density of q.
    pub displacement: Histogram,
    /// Density of v.
    pub velocity: Histogram,
    /// Density of N in contact, the Dirac mass of flight beside it.
    pub force: Histogram,
}

/// Moments at `times` (ascending, may begin with 0) of an ensemble that starts from `initial`. A step whose
/// bias may exceed a standard error is warned of; [`run_with_bias`] puts that bias into the errors.
///
/// `progress` is called, from any thread, with the fraction of the work done, 0 to 1.
///
/// # Errors
/// [`Error::Invalid`] for fewer than 2 paths, a step that is not positive, a noise that does not suit
/// the scheme, times that are negative, not finite or not ascending; [`Error::NoStationaryLaw`] for a
/// stationary start that does not exist; [`Error::Limit`] for more steps than can be counted, and where
/// `max_seconds` are over.
pub fn run(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &EnsembleSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<EnsembleResult> {
    let mut it = sample(oscillator, initial, times, settings, progress)?;
    let frequency = highest_frequency(oscillator, initial);
    let step = (it.scheme, it.step);
    let warning = scheme::bias_warning(step, oscillator, frequency, settings.paths as f64);
    let moved: Vec<Option<f64>> = times
        .iter()
        .filter(|t| **t > 0.0)
        .map(|t| Some(*t))
        .collect();
    it.warnings.extend(warning.map(|text| Warning {
        text,
        unknown: unknown("monte_carlo", &moved),
    }));
    Ok(it)
}

/// The ensemble that shows the bias of the scheme and step of `settings`: as many paths by the program's own choice
/// of both, the step at most half as long where the scheme is the same. None where that bias, in a variance or
/// through the phase of the motion, is below one standard error.
///
/// # Errors
/// Those of [`run`] for scheme, step and times.
pub fn companion(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &EnsembleSettings,
) -> Result<Option<EnsembleSettings>> {
    let frequency = highest_frequency(oscillator, initial);
    let (scheme, step) = scheme_and_step(oscillator, initial, settings)?;
    let (mut now, mut longest) = (0.0, 0.0);
    for time in times {
        let (count, length) = equal_steps(time - now, step)?;
        longest = f64::max(longest, if count > 0 { length } else { 0.0 });
        now = *time;
    }
    let bias = scheme::bias(scheme, oscillator, longest, frequency)
        + scheme::phase_lead((scheme, longest), oscillator, initial, frequency, now);
    if bias <= (2.0 / settings.paths as f64).sqrt() {
        return Ok(None);
    }
    let own = EnsembleSettings {
        scheme: Scheme::Auto,
        step: None,
        bins: 0,
        ..settings.clone()
    };
    let (own_scheme, own_step) = scheme_and_step(oscillator, initial, &own)?;
    let most = if own_scheme == scheme {
        0.5 * longest
    } else {
        own_step
    };
    Ok(Some(EnsembleSettings {
        step: Some(own_step.min(most)),
        ..own
    }))
}

/// The error of a scheme of order 2 over the difference that half the step makes.
const HALVED: f64 = 4.0 / 3.0;

/// [`run`], and where the bias of the step may exceed a standard error the ensemble of [`companion`] beside it: the
/// error of every number is then one standard error and the difference that the companion makes.
///
/// # Errors
/// As [`run`].
pub fn run_with_bias(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &EnsembleSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<EnsembleResult> {
    let Some(mut other) = companion(oscillator, initial, times, settings)? else {
        return sample(oscillator, initial, times, settings, progress);
    };
    let start = Instant::now();
    let half = |part: f64| progress(0.5 * part);
    let mut it = sample(oscillator, initial, times, settings, &half)?;
    other.max_seconds -= start.elapsed().as_secs_f64();
    let half = |part: f64| progress(0.5 + 0.5 * part);
    let beside = sample(oscillator, initial, times, &other, &half)?;
    for (moments, beside) in it.moments.iter_mut().zip(&beside.moments) {
        for (number, (_, beside)) in moments.each_mut().into_iter().zip(beside.named()) {
            if let (Some(number), Some(beside)) = (number, beside) {
                let difference = (number.value - beside.value).abs();
                number.error = number.error.max(beside.error) + HALVED * difference;
            }
        }
    }
    let warning = format!(
        "the step {:.3e} is long for the scheme {}: to the standard error of every sampled number is added what {} \
         with steps of {:.3e} makes different; shorten monte_carlo.step or leave scheme and step out to have them \
         chosen",
        it.step, it.scheme, beside.scheme, beside.step
    );
    it.warnings.push(warning.into());
    Ok(it)
}

/// One ensemble, the bias of its step left to the caller.
fn sample(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &EnsembleSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<EnsembleResult> {
    let plan = Plan::new(oscillator, initial, times, settings)?;
    let progress = &Progress::new(plan.path_steps, progress).within(settings.max_seconds);
    let ensemble = Ensemble {
        plan: &plan,
        progress,
    };
    let Sampled {
        frames,
        sums,
        counts,
    } = law::dispatch(oscillator.contact(), ensemble);
    progress.in_time()?;
    let lossy = oscillator.contact().loss_point().is_some();
    let densities = counts
        .iter()
        .map(|counts| counts.densities(lossy))
        .collect();
    let moments: Vec<Moments> = frames
        .iter()
        .zip(&sums)
        .map(|(frames, sums)| sums.moments(oscillator.contact(), frames))
        .collect();
    let mut warnings: Vec<Warning> = Vec::new();
    if settings.paths < FEW {
        let text = format!(
            "standard errors from {} paths are themselves known to {:.0} % at best; more monte_carlo.paths \
             would help",
            settings.paths,
            100.0 / (2.0 * (settings.paths - 1) as f64).sqrt()
        );
        warnings.push(text.into());
    }
    if let Noise::Cosines { band, .. } = settings.noise
        && band < RESONANCE
    {
        let text = format!(
            "the band of the noise ends at {band}, below {RESONANCE}: the response near the resonance at 1 \
             is not that to white noise"
        );
        warnings.push(text.into());
    }
    let cosines = settings.noise.warning(oscillator.zeta());
    warnings.extend(cosines.map(Warning::from));
    let finite = |m: &Moments| m.mean_energy.value.is_finite();
    if let Some(k) = moments.iter().position(|m| !finite(m)) {
        let from: Vec<Option<f64>> = times[k..].iter().map(|t| Some(*t)).collect();
        warnings.push(Warning {
            text: format!(
                "the ensemble is not finite from t = {} on, and none of its numbers is known from there: the step {} \
                 is too long for the scheme {}; leave monte_carlo.step out to have one chosen",
                times[k], plan.step, plan.scheme
            ),
            unknown: unknown("monte_carlo", &from),
        });
    }
    Ok(EnsembleResult {
        times: times.to_vec(),
        moments,
        densities,
        paths: settings.paths,
        steps: plan.intervals.iter().map(|interval| interval.steps).sum(),
        step: plan.longest,
        scheme: plan.scheme,
        path_steps: plan.path_steps,
        warnings,
    })
}

/// The steps from one output time to the next.
#[derive(Debug, Clone, Copy)]
struct Interval {
    start: f64,
    steps: u64,
    coefficients: Coefficients,
}

/// Everything fixed before the first step.
struct Plan {
    count: u64,
    paths: Paths,
    intervals: Vec<Interval>,
    scheme: Scheme,
    /// The step asked for or chosen, and the longest one made.
    step: f64,
    longest: f64,
    path_steps: u64,
    bins: usize,
}

impl Plan {
    fn new(
        oscillator: &Oscillator,
        initial: &Initial,
        times: &[f64],
        settings: &EnsembleSettings,
    ) -> Result<Self> {
        if settings.paths < 2 {
            return Err(Error::invalid(
                "monte_carlo.paths",
                settings.paths,
                "at least 2, so that there is a standard error",
            ));
        }
        let frequency = highest_frequency(oscillator, initial);
        if matches!(settings.noise, Noise::Band { .. }) {
            let accepted = "for long records; for an ensemble \"white\" or { cosines, band }";
            return Err(Error::invalid("monte_carlo.noise", "{ band }", accepted));
        }
        let (scheme, step) = scheme_and_step(oscillator, initial, settings)?;
        let mut intervals = Vec::with_capacity(times.len());
        let (mut now, mut steps, mut longest) = (0.0, 0, 0.0);
        for &time in times {
            if !(time.is_finite() && time >= now) {
                let accepted = "ascending finite times >= 0";
                return Err(Error::invalid("outputs.moments_at", time, accepted));
            }
            let (count, length) = equal_steps(time - now, step)?;
            if count > 0 {
                longest = f64::max(longest, length);
            }
            intervals.push(Interval {
                start: now,
                steps: count,
                coefficients: Coefficients::new(scheme, oscillator, length, frequency),
            });
            steps += count;
            now = time;
        }
        let noise = settings.noise;
        Ok(Self {
            count: settings.paths,
            paths: Paths::new(oscillator, initial, settings.seed, noise, scheme, step)?,
            intervals,
            scheme,
            step,
            longest,
            path_steps: steps.saturating_mul(settings.paths),
            bins: check_bins(settings.bins, 0)?,
        })
    }
}

/// The number of equal steps, none longer than `step`, that span `time`, and their length.
pub(super) fn equal_steps(time: f64, step: f64) -> Result<(u64, f64)> {
    // A whole number of steps stays one where the quotient is rounded up.
    let count = (time / step * (1.0 - 1e-12)).ceil();
    if count > 1e15 {
        return Err(Error::Limit {
            key: "monte_carlo.step",
            limit: step.to_string(),
            what: format!("{count:e} steps over a time of {time}"),
        });
    }
    let length = if count > 0.0 { time / count } else { step };
    Ok((count as u64, length))
}

/// The ensemble, to be run once the contact law is known.
struct Ensemble<'a> {
    plan: &'a Plan,
    progress: &'a Progress<'a>,
}

/// What comes out of the paths, one of each per output time.
struct Sampled {
    frames: Vec<Frames>,
    sums: Vec<Sums>,
    /// Empty unless densities are asked for.
    counts: Vec<DensityCounts>,
}

/// Counts for the densities of q, v and N.
#[derive(Debug, Clone)]
struct DensityCounts {
    bins: [Bins; 3],
    counts: [Counts; 3],
}

impl DensityCounts {
    fn new(bins: [Bins; 3]) -> Self {
        Self {
            bins,
            counts: bins.map(Counts::new),
        }
    }

    fn hit<L: Law>(&mut self, law: L, q: &[f64], v: &[f64]) {
        for (&q, &v) in q.iter().zip(v) {
            let force = if q < law.loss() {
                self.bins[2].dirac()
            } else {
                self.bins[2].slot(law.force(q))
            };
            let slots = [self.bins[0].slot(q), self.bins[1].slot(v), force];
            for (counts, slot) in self.counts.iter_mut().zip(slots) {
                counts.hit(slot);
            }
        }
    }

    fn add(&mut self, more: &Self) {
        for (mine, theirs) in self.counts.iter_mut().zip(&more.counts) {
            mine.add(theirs);
        }
    }

    fn densities(&self, lossy: bool) -> Densities {
        let [q, v, force] = &self.counts;
        Densities {
            displacement: q.histogram(self.bins[0], false),
            velocity: v.histogram(self.bins[1], false),
            force: force.histogram(self.bins[2], lossy),
        }
    }
}

impl WithLaw for Ensemble<'_> {
    type Output = Sampled;

    fn with<L: Law>(self, law: L) -> Sampled {
        let plan = self.plan;
        // The first block gives the frames in which every block sums; it is run twice.
        let mut frames = Vec::new();
        self.block(law, 0, |_, q, v| frames.push(Frames::of(law, q, v)));
        let count = if plan.bins == 0 { 0 } else { frames.len() };
        let empty = || -> Vec<DensityCounts> {
            let bins = frames[..count]
                .iter()
                .map(|frames| frames.bins(law, plan.bins));
            bins.map(DensityCounts::new).collect()
        };
        let blocks = plan.count.div_ceil(BLOCK);
        let per_task = blocks.div_ceil(TASKS);
        let tasks: Vec<Range<u64>> = (0..blocks.div_ceil(per_task))
            .map(|task| task * per_task..((task + 1) * per_task).min(blocks))
            .collect();
        let parts: Vec<(Vec<Sums>, Vec<DensityCounts>)> = tasks
            .into_par_iter()
            .map(|blocks| {
                let mut sums = vec![Sums::default(); plan.intervals.len()];
                let mut counts = empty();
                for block in blocks {
                    if self.progress.late() {
                        break;
                    }
                    self.block(law, block, |k, q, v| {
                        let sum = Sum {
                            law,
                            frames: &frames[k],
                            q,
                            v,
                        };
                        sums[k].add(&pulp::Arch::new().dispatch(sum));
                        if let Some(counts) = counts.get_mut(k) {
                            counts.hit(law, q, v);
                        }
                    });
                }
                (sums, counts)
            })
            .collect();
        let mut sums = vec![Sums::default(); plan.intervals.len()];
        let mut counts = empty();
        for (more_sums, more_counts) in &parts {
            for (sum, more) in sums.iter_mut().zip(more_sums) {
                sum.add(more);
            }
            for (count, more) in counts.iter_mut().zip(more_counts) {
                count.add(more);
            }
        }
        self.progress.finish();
        Sampled {
            frames,
            sums,
            counts,
        }
    }
}

impl Ensemble<'_> {
    /// Runs one block and shows its states (q, v) at every output time.
    fn block<L: Law>(&self, law: L, block: u64, mut show: impl FnMut(usize, &[f64], &[f64])) {
        let first = block * BLOCK;
        let paths = BLOCK.min(self.plan.count - first);
        let mut groups: Vec<Group> = (first..first + paths)
            .step_by(LANES)
            .map(|first| self.plan.paths.group(first))
            .collect();
        let (mut q, mut v) = (Vec::new(), Vec::new());
        let arch = pulp::Arch::new();
        for (k, interval) in self.plan.intervals.iter().enumerate() {
            arch.dispatch(Advance {
                law,
                interval,
                groups: &mut groups,
            });
            q.clear();
            v.clear();
            for group in &groups {
                q.extend_from_slice(&group.q);
                v.extend_from_slice(&group.v);
            }
            show(k, &q[..paths as usize], &v[..paths as usize]);
            self.progress.add(interval.steps * paths);
        }
    }
}

/// One interval of one block, compiled for the widest vectors of the machine it runs on.
struct Advance<'a, L> {
    law: L,
    interval: &'a Interval,
    groups: &'a mut [Group],
}

impl<L: Law> pulp::WithSimd for Advance<'_, L> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Interval {
            start,
            steps,
            coefficients,
        } = self.interval;
        for group in self.groups {
            coefficients.advance(self.law, group, *steps, *start, &mut Deaf);
        }
    }
}

/// The sums over some states, compiled likewise.
struct Sum<'a, L> {
    law: L,
    frames: &'a Frames,
    q: &'a [f64],
    v: &'a [f64],
}

impl<L: Law> pulp::WithSimd for Sum<'_, L> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Sums {
        Sums::of(self.law, self.frames, self.q, self.v)
    }
}

#[cfg(test)]
#[path = "ensemble_tests.rs"]
mod tests;
