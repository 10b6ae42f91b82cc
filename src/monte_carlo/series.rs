//! Sampled records of the stationary motion, handed on one by one: for spectra.

use super::events::Deaf;
use super::law::{self, Law, WithLaw};
use super::noise::LANES;
use super::paths::{Paths, highest_frequency};
use super::scheme::{Coefficients, Group};
use super::{Noise, Progress, Scheme, choose};
use crate::error::{Error, Result, positive};
use crate::initial::Initial;
use crate::oscillator::{Oscillator, Quantity};
use rayon::prelude::*;

/// The first path of a series: far from those of ensembles and records, so that they are independent.
const FIRST: u64 = 1 << 40;

/// What is sampled, how often and by which scheme.
#[derive(Debug, Clone, PartialEq)]
pub struct SeriesSettings {
    /// What is sampled.
    pub quantity: Quantity,
    /// Time between two samples.
    pub spacing: f64,
    /// Samples of a record.
    pub samples: usize,
    /// Records, rounded up to whole groups of 16.
    pub records: u64,
    /// Seed; with a record's number it fixes the record.
    pub seed: u64,
    /// How one step is made.
    pub scheme: Scheme,
    /// Longest step; None chooses one. A whole number of steps makes a spacing.
    pub step: Option<f64>,
    /// The excitation.
    pub noise: Noise,
    /// Seconds after which the series gives up with [`Error::Limit`].
    pub max_seconds: f64,
}

/// How a series is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeriesSize {
    /// The scheme, never [`Scheme::Auto`].
    pub scheme: Scheme,
    /// The step.
    pub step: f64,
    /// Steps between two samples.
    pub steps: u64,
    /// Records.
    pub records: u64,
    /// Samples thrown away at the beginning of each: none where the start is the stationary law.
    pub burn_in: u64,
    /// Steps of all records.
    pub path_steps: u64,
    /// Bytes, roughly.
    pub memory: u64,
}

/// The size of the series that [`series`] would make.
///
/// # Errors
/// [`Error::Invalid`] for a spacing or step that is not positive, no samples or records, more steps than
/// can be counted, or a noise that does not suit the scheme.
pub fn series_size(oscillator: &Oscillator, settings: &SeriesSettings) -> Result<SeriesSize> {
    let spacing = positive("spacing", settings.spacing)?;
    let frequency = highest_frequency(oscillator, &Initial::Stationary);
    let (scheme, longest) = choose(
        (settings.scheme, settings.step),
        settings.noise,
        oscillator,
        frequency,
    )?;
    if settings.samples == 0 || settings.records == 0 {
        let given = format!("{} records of {}", settings.records, settings.samples);
        return Err(Error::invalid("samples", given, "at least one of one"));
    }
    let steps = (spacing / longest).ceil().max(1.0);
    // Band-limited noise has a stationary law of its own, reached within a few memories.
    let memory = oscillator.memory();
    let burn_in = match settings.noise {
        Noise::White => 0.0,
        _ => (10.0 * memory / spacing).ceil(),
    };
    let records = settings.records.next_multiple_of(LANES as u64);
    let all = records as f64 * (settings.samples as f64 + burn_in) * steps;
    if all.is_nan() || all > 1e15 {
        let accepted = "at most 1e15 steps of all records of a spectrum";
        return Err(match settings.step {
            Some(step) => Error::invalid("monte_carlo.step", format!("{step:?}"), accepted),
            None => Error::invalid("monte_carlo.duration", format!("{all:e} steps"), accepted),
        });
    }
    let threads = rayon::current_num_threads() as u64;
    Ok(SeriesSize {
        scheme,
        step: spacing / steps,
        steps: steps as u64,
        records,
        burn_in: burn_in as u64,
        path_steps: all as u64,
        memory: threads * (LANES * settings.samples * 8) as u64,
    })
}

/// Records of the stationary motion: each starts in the exact stationary law, or is run in where the
/// noise is band-limited. `visit` sees every record once, from any thread; what it returns comes back in
/// the order of the records. Record k of a seed is the same record whatever the threads.
///
/// # Errors
/// Those of [`series_size`]; [`Error::NoStationaryLaw`] for a contact that does not confine;
/// [`Error::Limit`] where `max_seconds` are over.
pub fn series<T: Send>(
    oscillator: &Oscillator,
    settings: &SeriesSettings,
    visit: &(dyn Fn(&[f64]) -> T + Sync),
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<T>> {
    let size = series_size(oscillator, settings)?;
    let frequency = highest_frequency(oscillator, &Initial::Stationary);
    let paths = Paths::new(
        oscillator,
        &Initial::Stationary,
        settings.seed,
        settings.noise,
        size.scheme,
        size.step,
    )?;
    let groups = size.records / LANES as u64;
    let progress = &Progress::new(groups, progress).within(settings.max_seconds);
    let run = Run {
        settings,
        size,
        paths: &paths,
        coefficients: Coefficients::new(size.scheme, oscillator, size.step, frequency),
        visit,
        progress,
    };
    let all = law::dispatch(oscillator.contact(), run);
    progress.in_time()?;
    progress.finish();
    Ok(all)
}

struct Run<'a, T> {
    settings: &'a SeriesSettings,
    size: SeriesSize,
    paths: &'a Paths,
    coefficients: Coefficients,
    visit: &'a (dyn Fn(&[f64]) -> T + Sync),
    progress: &'a Progress<'a>,
}

impl<T: Send> WithLaw for Run<'_, T> {
    type Output = Vec<T>;

    fn with<L: Law>(self, law: L) -> Vec<T> {
        let groups = 0..self.size.records / LANES as u64;
        let all: Vec<Vec<T>> = groups
            .into_par_iter()
            .map(|number| self.group(law, number))
            .collect();
        all.into_iter().flatten().collect()
    }
}

impl<T> Run<'_, T> {
    fn group<L: Law>(&self, law: L, number: u64) -> Vec<T> {
        if self.progress.late() {
            return Vec::new();
        }
        let samples = self.settings.samples;
        let mut group = self.paths.group(FIRST + number * LANES as u64);
        let mut records = vec![vec![0.0; samples]; LANES];
        pulp::Arch::new().dispatch(Sample {
            law,
            coefficients: &self.coefficients,
            size: self.size,
            quantity: self.settings.quantity,
            group: &mut group,
            records: &mut records,
        });
        self.progress.add(1);
        records.iter().map(|record| (self.visit)(record)).collect()
    }
}

/// The records of one group.
struct Sample<'a, L> {
    law: L,
    coefficients: &'a Coefficients,
    size: SeriesSize,
    quantity: Quantity,
    group: &'a mut Group,
    records: &'a mut [Vec<f64>],
}

impl<L: Law> pulp::WithSimd for Sample<'_, L> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let samples = self.records.first().map_or(0, Vec::len) as u64;
        let spacing = self.size.step * self.size.steps as f64;
        for k in 0..self.size.burn_in + samples {
            let now = k as f64 * spacing;
            self.coefficients
                .advance(self.law, self.group, self.size.steps, now, &mut Deaf);
            if k < self.size.burn_in {
                continue;
            }
            let place = (k - self.size.burn_in) as usize;
            for (record, q) in self.records.iter_mut().zip(&self.group.q) {
                record[place] = match self.quantity {
                    Quantity::Force => self.law.force(*q),
                    Quantity::Displacement => *q,
                };
            }
        }
    }
}
