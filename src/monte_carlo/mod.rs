//! Monte Carlo: ensembles of independent paths, streamed statistics, standard errors on every number.
//!
//! Path k of a seed is the same path in an ensemble of 10 or of 10^6, on 1 or on 64 threads, and the
//! results have the same bits: paths advance in fixed blocks, and the blocks are added in their order.
//! Memory does not depend on the number of paths.

mod law;
mod noise;
mod scheme;
mod statistics;

pub use scheme::Scheme;

use crate::error::{Error, Result, positive};
use crate::initial::Initial;
use crate::moments::Moments;
use crate::oscillator::{DisplacementSampler, Oscillator};
use law::{Law, WithLaw};
use noise::{LANES, Purpose, Streams};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;
use scheme::{Coefficients, Group};
use statistics::{Frames, Sums};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Paths per block: the unit in which sums are added.
const BLOCK: u64 = 256;

/// Most tasks an ensemble is cut into; bounds the memory and never depends on the threads.
const TASKS: u64 = 128;

/// Size, seed and scheme of an ensemble.
#[derive(Debug, Clone, PartialEq)]
pub struct EnsembleSettings {
    /// Number of paths, at least 2.
    pub paths: u64,
    /// Seed; with a path's number it fixes the path.
    pub seed: u64,
    /// How one step is made.
    pub scheme: Scheme,
    /// Longest step; None chooses one. Each interval between output times is cut into equal steps.
    pub step: Option<f64>,
}

impl Default for EnsembleSettings {
    fn default() -> Self {
        Self {
            paths: 100_000,
            seed: 1,
            scheme: Scheme::Auto,
            step: None,
        }
    }
}

/// Moments of an ensemble at the times asked for, and how they were made.
#[derive(Debug, Clone, PartialEq)]
pub struct EnsembleResult {
    /// The output times.
    pub times: Vec<f64>,
    /// Moments at each time; every error is one standard error.
    pub moments: Vec<Moments>,
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
    pub warnings: Vec<String>,
}

/// Moments at `times` (ascending, may begin with 0) of an ensemble that starts from `initial`.
///
/// `progress` is called, from any thread, with the fraction of the work done, 0 to 1.
///
/// # Errors
/// [`Error::Invalid`] for fewer than 2 paths, a step that is not positive, times that are negative,
/// not finite or not ascending; [`Error::NoStationaryLaw`] for a stationary start that does not exist;
/// [`Error::Limit`] for more steps than can be counted.
pub fn run(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &EnsembleSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<EnsembleResult> {
    let plan = EnsemblePlan::new(oscillator, initial, times, settings)?;
    let (frames, sums) = law::dispatch(
        oscillator.contact(),
        RunEnsemble {
            plan: &plan,
            progress: &Progress::new(plan.path_steps, progress),
        },
    );
    let moments: Vec<Moments> = frames
        .iter()
        .zip(&sums)
        .map(|(frames, sums)| sums.moments(oscillator.contact(), frames))
        .collect();
    let mut warnings = Vec::new();
    if let Some(k) = moments
        .iter()
        .position(|m| !m.mean_energy.value.is_finite())
    {
        warnings.push(format!(
            "the ensemble is not finite from t = {} on: the step {} is too long for the scheme {}; \
             leave monte_carlo.step out to have one chosen",
            times[k],
            plan.step,
            plan.scheme.name()
        ));
    }
    Ok(EnsembleResult {
        times: times.to_vec(),
        moments,
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
    steps: u64,
    coefficients: Coefficients,
}

/// Everything fixed before the first step.
struct EnsemblePlan {
    paths: u64,
    seed: u64,
    start: Start,
    intervals: Vec<Interval>,
    scheme: Scheme,
    /// The step asked for or chosen, and the longest one made.
    step: f64,
    longest: f64,
    path_steps: u64,
    /// Below it contact is lost; minus infinity without a loss point.
    loss: f64,
}

impl EnsemblePlan {
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
        let scheme = match settings.scheme {
            Scheme::Auto => Scheme::Baoab,
            scheme => scheme,
        };
        let step = match settings.step {
            Some(step) => positive("monte_carlo.step", step)?,
            None => {
                scheme::automatic_step(scheme, oscillator, highest_frequency(oscillator, initial))
            }
        };
        let mut intervals = Vec::with_capacity(times.len());
        let (mut now, mut steps, mut longest) = (0.0, 0, 0.0);
        for &time in times {
            if !(time.is_finite() && time >= now) {
                return Err(Error::invalid(
                    "outputs.moments_at",
                    time,
                    "ascending finite times >= 0",
                ));
            }
            let count = ((time - now) / step).ceil();
            if count > 1e15 {
                return Err(Error::Limit {
                    key: "monte_carlo.step",
                    limit: step.to_string(),
                    what: format!("{count:e} steps from t = {now} to {time}"),
                });
            }
            let length = if count > 0.0 {
                (time - now) / count
            } else {
                step
            };
            if count > 0.0 {
                longest = f64::max(longest, length);
            }
            intervals.push(Interval {
                steps: count as u64,
                coefficients: Coefficients::new(scheme, oscillator, length),
            });
            steps += count as u64;
            now = time;
        }
        Ok(Self {
            paths: settings.paths,
            seed: settings.seed,
            start: Start::new(oscillator, initial)?,
            intervals,
            scheme,
            step,
            longest,
            path_steps: steps.saturating_mul(settings.paths),
            loss: oscillator
                .contact()
                .loss_point()
                .unwrap_or(f64::NEG_INFINITY),
        })
    }

    /// The groups of a block, at their starts.
    fn groups(&self, block: u64) -> Vec<Group> {
        let first = block * BLOCK;
        let paths = BLOCK.min(self.paths - first);
        (0..paths.div_ceil(LANES as u64))
            .map(|group| {
                let first = first + group * LANES as u64;
                let mut it = Group {
                    q: [0.0; LANES],
                    v: [0.0; LANES],
                    streams: Streams::new(self.seed, first),
                };
                for lane in 0..LANES {
                    (it.q[lane], it.v[lane]) = self.start.of(self.seed, first + lane as u64);
                }
                it
            })
            .collect()
    }
}

/// The highest frequency a path meets: the root of the stiffness at the outer turning point of an
/// energy few paths exceed.
fn highest_frequency(oscillator: &Oscillator, initial: &Initial) -> f64 {
    let contact = oscillator.contact();
    let mut rise = 5.0 * oscillator.temperature();
    let mut outer: f64 = 0.0;
    if let Initial::Gaussian { mean, deviation } = initial {
        let (q, v) = (
            mean[0].abs() + 2.0 * deviation[0],
            mean[1].abs() + 2.0 * deviation[1],
        );
        let lowest = contact.lowest_potential().unwrap_or(0.0);
        let level = contact.potential(q).max(contact.potential(-q)) - lowest;
        rise = rise.max(0.5 * v * v + level.max(0.0));
        outer = q;
    }
    if let Some((_, right)) = contact.turning_points(rise) {
        outer = outer.max(right);
    }
    let stiffness = [0.0, 0.5 * outer, outer].map(|q| contact.stiffness(q));
    stiffness.into_iter().fold(0.0, f64::max).sqrt()
}

/// Draws the start of a path from the path's own stream.
struct Start {
    initial: Initial,
    sampler: Option<DisplacementSampler>,
}

impl Start {
    fn new(oscillator: &Oscillator, initial: &Initial) -> Result<Self> {
        let sampler = match initial {
            Initial::Stationary => Some(oscillator.displacement_law()?.sampler()),
            _ => None,
        };
        Ok(Self {
            initial: *initial,
            sampler,
        })
    }

    fn of(&self, seed: u64, path: u64) -> (f64, f64) {
        let mut rng = Xoshiro256PlusPlus::from_seed(noise::seed_bytes(seed, path, Purpose::Start));
        match (self.initial, &self.sampler) {
            (Initial::Gaussian { mean, deviation }, _) => {
                let [q, v] = [0, 1].map(|k| {
                    let normal: f64 = StandardNormal.sample(&mut rng);
                    mean[k] + deviation[k] * normal
                });
                (q, v)
            }
            (_, Some(sampler)) => sampler.sample_state(&mut rng),
            _ => (0.0, 0.0),
        }
    }
}

/// Reports a fraction from any thread, a few hundred times in all.
struct Progress<'a> {
    total: u64,
    done: AtomicU64,
    report: &'a (dyn Fn(f64) + Sync),
}

impl<'a> Progress<'a> {
    fn new(total: u64, report: &'a (dyn Fn(f64) + Sync)) -> Self {
        Self {
            total: total.max(1),
            done: AtomicU64::new(0),
            report,
        }
    }

    fn add(&self, work: u64) {
        let before = self.done.fetch_add(work, Ordering::Relaxed);
        let fraction = |done: u64| (done as f64 / self.total as f64).min(1.0);
        let (before, now) = (fraction(before), fraction(before + work));
        if (before * 200.0).floor() < (now * 200.0).floor() {
            (self.report)(now);
        }
    }
}

/// The ensemble, once the contact law is known.
struct RunEnsemble<'a> {
    plan: &'a EnsemblePlan,
    progress: &'a Progress<'a>,
}

impl WithLaw for RunEnsemble<'_> {
    type Output = (Vec<Frames>, Vec<Sums>);

    fn with<L: Law>(self, law: L) -> Self::Output {
        let plan = self.plan;
        // The first block gives the frames in which every block sums; it is run twice.
        let mut frames = Vec::new();
        self.block(law, 0, |_, q, v| frames.push(Frames::of(law, q, v)));
        let blocks = plan.paths.div_ceil(BLOCK);
        let per_task = blocks.div_ceil(TASKS);
        let tasks: Vec<Range<u64>> = (0..blocks.div_ceil(per_task))
            .map(|task| task * per_task..((task + 1) * per_task).min(blocks))
            .collect();
        let parts: Vec<Vec<Sums>> = tasks
            .into_par_iter()
            .map(|blocks| {
                let mut sums = vec![Sums::default(); plan.intervals.len()];
                for block in blocks {
                    self.block(law, block, |k, q, v| {
                        sums[k].add(&Sums::of(law, plan.loss, &frames[k], q, v));
                    });
                }
                sums
            })
            .collect();
        let mut total = vec![Sums::default(); plan.intervals.len()];
        for part in &parts {
            for (sum, more) in total.iter_mut().zip(part) {
                sum.add(more);
            }
        }
        (self.progress.report)(1.0);
        (frames, total)
    }
}

impl RunEnsemble<'_> {
    /// Runs one block and shows its states (q, v) at every output time.
    fn block<L: Law>(&self, law: L, block: u64, mut show: impl FnMut(usize, &[f64], &[f64])) {
        let mut groups = self.plan.groups(block);
        let paths = BLOCK.min(self.plan.paths - block * BLOCK) as usize;
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
            show(k, &q[..paths], &v[..paths]);
            self.progress.add(interval.steps * paths as u64);
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
        for group in self.groups {
            self.interval
                .coefficients
                .advance(self.law, group, self.interval.steps);
        }
    }
}

#[cfg(test)]
mod tests;
