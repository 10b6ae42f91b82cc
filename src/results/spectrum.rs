//! The spectrum: from the resolvent, by Welch's method, and of the linear oscillator.

use crate::budget::Limits;
use crate::error::Result;
use crate::estimate::{Estimate, Origin};
use crate::fokker_planck::{Peak, Spectrum};
use crate::monte_carlo::Series;
use crate::oscillator::Oscillator;
use crate::spectrum::{Welch, linear};

/// A one-sided spectrum per circular frequency: its integral over omega is the variance.
#[derive(Debug, Clone)]
pub struct SpectrumNumbers {
    /// From the resolvent of the Fokker-Planck operator, at the frequencies of Welch's method.
    pub solved: Spectrum,
    /// Of the linearised contact, G(q) = q.
    pub linear: Vec<f64>,
    /// Peaks of the solved spectrum, the highest first.
    pub peaks: Vec<Peak>,
    /// Density of the highest peak beyond 1.5 times the frequency of the highest of all, over its.
    pub harmonic_ratio: Option<Estimate>,
    /// By sampling.
    pub sampled: Option<SampledSpectrum>,
}

/// A spectrum by Welch's method, and what it had to be expected to be.
#[derive(Debug, Clone)]
pub struct SampledSpectrum {
    /// The estimate, with the standard error of one at its expectation: that of the estimate itself follows its fluctuations, and
    /// low values would seem too sure.
    pub density: Vec<Estimate>,
    /// Its expectation: the solved spectrum seen through window and sampling.
    pub expectation: Vec<f64>,
    /// RMS magnitude, sqrt(S 1.5 d omega), as in the paper's figures.
    pub magnitude: Vec<f64>,
    /// Segments averaged.
    pub averages: usize,
    /// Time between samples.
    pub spacing: f64,
}

impl SpectrumNumbers {
    pub(crate) fn of(oscillator: &Oscillator, solved: Spectrum) -> Self {
        Self {
            linear: solved
                .omega
                .iter()
                .map(|w| linear(oscillator, *w))
                .collect(),
            peaks: solved.peaks(),
            harmonic_ratio: solved.harmonic_ratio(),
            sampled: None,
            solved,
        }
    }

    /// The same by sampling, and the number of averages. The mean taken off the records is that of the stationary law.
    pub(crate) fn sample(
        &mut self,
        oscillator: &Oscillator,
        welch: &Welch,
        recipe: &Series,
        limits: Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<usize> {
        let (contact, law) = (oscillator.contact(), oscillator.displacement_law()?);
        let asked = recipe.asked;
        let exact = || law.expect(|q| asked.quantity.of(contact, q)).value;
        let mean = self.solved.mean.unwrap_or_else(exact);
        let visit = |record: &[f64]| {
            let record: Vec<f64> = record.iter().map(|x| x - mean).collect();
            welch.record(&record)
        };
        let records = recipe.run(oscillator, &visit, limits, progress)?;
        let averages = records.iter().map(|it| it.segments).sum();
        let samples = welch.record_length(1);
        let correlation = self.solved.correlation(asked.spacing, samples);
        let mut density = welch.average(&records);
        let mut expectation = welch.expectation(&correlation);
        density.truncate(self.solved.omega.len());
        expectation.truncate(self.solved.omega.len());
        for (it, expected) in density.iter_mut().zip(&expectation) {
            *it = Estimate::new(it.value, expected * share(it), Origin::Sampling);
        }
        self.sampled = Some(SampledSpectrum {
            magnitude: density.iter().map(|it| welch.magnitude(it.value)).collect(),
            density,
            expectation,
            averages,
            spacing: asked.spacing,
        });
        Ok(averages)
    }

    /// Expectation and estimate at every frequency that noise of this band drives: the expectation is that of white noise.
    pub(crate) fn pairs(&self, band: f64) -> impl Iterator<Item = (Estimate, Estimate)> + '_ {
        let omega = &self.solved.omega;
        let bin = omega.get(1).map_or(0.0, |next| next - omega[0]);
        let driven = omega.partition_point(|it| it + BLURRED * bin < band);
        let sampled = self.sampled.as_ref();
        let values = sampled.into_iter().flat_map(|it| {
            let both = it.expectation.iter().zip(&it.density);
            both.zip(&self.solved.density)
        });
        values.take(driven).map(|((expected, got), exact)| {
            let expected = Estimate::new(*expected, expected * share(exact), Origin::Space);
            (expected, *got)
        })
    }
}

/// Bins below the end of the band that a Hann window blurs.
const BLURRED: f64 = 3.0;

/// An error over its value.
fn share(it: &Estimate) -> f64 {
    it.error / it.value.abs().max(f64::MIN_POSITIVE)
}
