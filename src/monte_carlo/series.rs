//! Sampled records of the stationary motion, handed on one by one: for spectra.

use super::events::{Deaf, PATIENCE, Watch};
use super::law::{self, Law, WithLaw};
use super::noise::LANES;
use super::paths::Paths;
use super::progress::{Progress, Timed};
use super::scheme::{Coefficients, Group};
use super::walk::{Walk, not_run_in, run_in};
use super::{Noise, Sampling};
use crate::budget::{Cost, Limits};
use crate::error::{Error, Result, positive};
use crate::estimate::Warning;
use crate::initial::Initial;
use crate::matrix::vectorise;
use crate::oscillator::{Oscillator, Quantity};
use rayon::prelude::*;

/// The first path of a series: far from those of ensembles and records, so that they are independent.
const FIRST: u64 = 1 << 40;

/// What is sampled, and how often.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Samples {
    /// What is sampled.
    pub quantity: Quantity,
    /// Time between two samples; a whole number of steps makes it.
    pub spacing: f64,
    /// Samples of a record.
    pub samples: usize,
    /// Records, rounded up to whole groups of 16.
    pub records: u64,
}

/// Records of the stationary motion: each starts in the exact stationary law, or is run in where the
/// noise is band-limited or damping leaves no closed form. `visit` sees every record once, from any thread; what it returns comes back in
/// the order of the records. Record k of a seed is the same record whatever the threads.
///
/// # Errors
/// [`Error::Invalid`] for a spacing or step that is not positive, no samples or records, more steps than
/// can be counted, or a noise that does not suit the scheme; [`Error::NoStationaryLaw`] for a contact that does not
/// confine; [`Error::Limit`] where `max_seconds` are over.
pub fn series<T: Send>(
    oscillator: &Oscillator,
    asked: Samples,
    settings: &Sampling,
    visit: &(dyn Fn(&[f64]) -> T + Sync),
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<T>> {
    Series::of(oscillator, asked, settings)?.run(oscillator, visit, settings.limits(), progress)
}

/// How sampled records will be drawn.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Series {
    pub(crate) walk: Walk,
    /// The records rounded up.
    pub(crate) asked: Samples,
    /// Steps between two samples.
    steps: u64,
    /// Samples thrown away at the beginning of each: none where the start is the stationary law.
    burn_in: u64,
    /// What they will take.
    pub(crate) cost: Cost,
}

impl Series {
    pub(crate) fn of(oscillator: &Oscillator, asked: Samples, settings: &Sampling) -> Result<Self> {
        let spacing = positive("spacing", asked.spacing)?;
        let mut walk = Walk::of(oscillator, &Initial::Stationary, settings)?;
        if asked.samples == 0 || asked.records == 0 {
            let given = format!("{} records of {}", asked.records, asked.samples);
            return Err(Error::invalid("samples", given, "at least one of one"));
        }
        let steps = (spacing / walk.step).ceil().max(1.0);
        walk.step = spacing / steps;
        // Band-limited noise has a stationary law of its own, reached within a few correlation times; so has damping
        // that is not viscous.
        let burn_in = match walk.noise {
            Noise::White => (run_in(oscillator, &Initial::Stationary) / spacing).ceil(),
            _ => (10.0 * oscillator.correlation_time() / spacing).ceil(),
        };
        let records = asked.records.next_multiple_of(LANES as u64);
        let each = (asked.samples as f64 + burn_in) * steps;
        let all = records as f64 * each;
        if all.is_nan() || all > 1e15 {
            let accepted = "at most 1e15 steps of all records of a spectrum";
            return Err(match settings.step {
                Some(step) => Error::invalid("monte_carlo.step", format!("{step:?}"), accepted),
                None => Error::invalid("monte_carlo.duration", format!("{all:e} steps"), accepted),
            });
        }
        let threads = rayon::current_num_threads() as u64;
        Ok(Self {
            asked: Samples { records, ..asked },
            steps: steps as u64,
            burn_in: burn_in as u64,
            cost: Cost {
                steps: each as u64,
                memory: threads * ((LANES * asked.samples * 8) as u64 + walk.bytes()),
                seconds: walk.seconds(oscillator, all),
                ..Cost::default()
            },
            walk,
        })
    }

    /// Scheme, step and reason.
    pub(crate) fn words(&self) -> String {
        self.walk.words()
    }

    /// A warning that a spectrum of so many averages is not known, if the bias of the step, in the variance or by
    /// the shift of a peak of width zeta, may exceed its standard error.
    pub(crate) fn warnings(&self, oscillator: &Oscillator, averages: usize) -> Vec<Warning> {
        let bias = self.walk.bias(oscillator) + self.walk.lead() / oscillator.zeta();
        let names = || vec!["welch.spectrum".into()];
        let step = self.walk.warning(bias, 2.0 * averages as f64, names);
        let wells = not_run_in(oscillator, &Initial::Stationary, names);
        step.into_iter().chain(wells).collect()
    }

    /// The records, as [`series`] hands them on.
    pub(crate) fn run<T: Send>(
        &self,
        oscillator: &Oscillator,
        visit: &(dyn Fn(&[f64]) -> T + Sync),
        limits: Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Vec<T>> {
        limits.holds("the records of a spectrum", self.cost.memory)?;
        let groups = self.asked.records / LANES as u64;
        let progress = &Progress::new(groups, limits, progress);
        let run = Run {
            recipe: self,
            paths: &Paths::new(oscillator, &Initial::Stationary, &self.walk)?,
            coefficients: self.walk.coefficients(oscillator, self.walk.step),
            visit,
            progress,
        };
        let all = law::dispatch(oscillator, run);
        progress.finish()?;
        Ok(all)
    }
}

struct Run<'a, T> {
    recipe: &'a Series,
    paths: &'a Paths,
    coefficients: Coefficients,
    visit: &'a (dyn Fn(&[f64]) -> T + Sync),
    progress: &'a Progress<'a>,
}

impl<T: Send> WithLaw for Run<'_, T> {
    type Output = Vec<T>;

    fn with<L: Law>(self, law: L) -> Vec<T> {
        let groups = 0..self.recipe.asked.records / LANES as u64;
        let all = groups.into_par_iter().map(|number| self.group(law, number));
        let all: Vec<Vec<T>> = all.collect();
        all.into_iter().flatten().collect()
    }
}

impl<T> Run<'_, T> {
    fn group<L: Law>(&self, law: L, number: u64) -> Vec<T> {
        if self.progress.late() {
            return Vec::new();
        }
        let mut records = vec![vec![0.0; self.recipe.asked.samples]; LANES];
        let mut group = self.paths.group(FIRST + number * LANES as u64);
        vectorise!(self.sample(law, &mut group, &mut records));
        if self.progress.late() {
            return Vec::new();
        }
        self.progress.add(1);
        records.iter().map(|record| (self.visit)(record)).collect()
    }

    /// The records of one group.
    #[inline(always)]
    fn sample<L: Law>(&self, law: L, group: &mut Group, records: &mut [Vec<f64>]) {
        let Series {
            asked,
            steps,
            burn_in,
            walk,
            ..
        } = self.recipe;
        let spacing = walk.step * *steps as f64;
        let mut watch = Timed {
            watch: &mut Deaf,
            progress: self.progress,
        };
        let patience = (PATIENCE / steps).max(1);
        for k in 0..burn_in + asked.samples as u64 {
            if k % patience == patience - 1 && watch.late() {
                break;
            }
            let now = k as f64 * spacing;
            self.coefficients
                .advance(law, group, *steps, now, &mut watch);
            let Some(place) = k.checked_sub(*burn_in) else {
                continue;
            };
            for (record, q) in records.iter_mut().zip(&group.q) {
                record[place as usize] = match asked.quantity {
                    Quantity::Force => law.force(*q),
                    Quantity::Displacement => *q,
                };
            }
        }
    }
}
