//! Spectra from arrays, by Welch's method from records.
//!
//! Every density here is one-sided and per circular frequency: its integral over omega from 0 is the
//! variance, S = (2/pi) integral_0^infinity R(t) cos(omega t) dt. With white excitation of level h the
//! linear oscillator has [`linear`]. With a rig, see [`per_hertz`].

use crate::error::{Error, Result, positive};
use crate::estimate::{Estimate, Origin, skewed_variance};
use crate::oscillator::Oscillator;
use crate::rig::Rig;
use num_complex::Complex;
use rustfft::{Fft, FftPlanner};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

type C = Complex<f64>;

/// Bins to either side over which the relative scatter of records is pooled: it varies slowly, and from
/// 80 records alone it would be known to 8 % only.
const POOLED: usize = 8;

/// S(omega) = 2h/((1 - omega^2)^2 + (2 zeta omega)^2): displacement and force of the linearised contact,
/// G(q) = q.
pub fn linear(oscillator: &Oscillator, omega: f64) -> f64 {
    let stiff = 1.0 - omega * omega;
    let damped = 2.0 * oscillator.zeta() * omega;
    2.0 * oscillator.h() / (stiff * stiff + damped * damped)
}

/// What a dimensionless one-sided density of the force becomes per hertz: N^2/Hz, S(f) = F_s^2
/// S(omega)/f_0, so that the integral over f is the variance in N^2.
pub fn per_hertz(rig: &Rig) -> f64 {
    rig.newtons(1.0).powi(2) / rig.frequency()
}

/// The same for the displacement: micrometres^2/Hz.
pub fn displacement_per_hertz(rig: &Rig) -> f64 {
    rig.micrometres().powi(2) / rig.frequency()
}

/// Welch's method (IEEE Trans. Audio Electroacoust. 15, 70, 1967): segments of a record, overlapping,
/// each under Hann's window, their squared Fourier coefficients averaged. Records must have the mean
/// taken off, the exact one if it is known: none is taken off here, so that the expectation is linear in
/// the correlation function.
///
/// ```text
/// G_k = step/(pi sum w^2) |sum_n w_n x_n e^{-2 pi i k n/M}|^2,   w_n = sin^2(pi n/M),   omega_k = 2 pi k/(M step)
/// ```
///
/// One-sided per circular frequency. For any record, the sum over all k = 0 to M - 1 times pi/(M step)
/// is sum w^2 x^2/sum w^2 (Parseval).
///
/// ```
/// let record: Vec<f64> = (0..512).map(|n| (0.25 * n as f64).sin()).collect();
/// let welch = vibroimpact::spectrum::Welch::new(256, 128, 1.0)?;
/// let variance = welch.record(&record).density.iter().sum::<f64>() * welch.spacing();
/// assert!((variance - 0.5).abs() < 0.01);
/// # Ok::<(), vibroimpact::Error>(())
/// ```
#[derive(Clone)]
pub struct Welch {
    step: f64,
    hop: usize,
    window: Vec<f64>,
    transform: Arc<dyn Fft<f64>>,
}

impl std::fmt::Debug for Welch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut it = f.debug_struct("Welch");
        it.field("step", &self.step)
            .field("hop", &self.hop)
            .field("samples", &self.window.len())
            .finish_non_exhaustive()
    }
}

/// Squared Fourier coefficients of one record, averaged over its segments.
#[derive(Debug, Clone, PartialEq)]
pub struct Periodogram {
    /// S at the frequencies of [`Welch::omega`].
    pub density: Vec<f64>,
    /// Segments of the record.
    pub segments: usize,
}

impl Welch {
    /// Segments of `samples` samples `step` apart, each beginning `hop` samples after the one before.
    ///
    /// # Errors
    /// [`Error::Invalid`] for fewer than 8 samples, an odd number of them, a hop of 0 or more than a
    /// segment, or a step that is not positive.
    pub fn new(samples: usize, hop: usize, step: f64) -> Result<Self> {
        positive("step", step)?;
        if samples < 8 || samples % 2 == 1 {
            return Err(Error::invalid("samples", samples, "an even number from 8"));
        }
        if hop == 0 || hop > samples {
            return Err(Error::invalid("hop", hop, format!("1 to {samples}")));
        }
        let window = (0..samples).map(|n| (PI * n as f64 / samples as f64).sin().powi(2));
        Ok(Self {
            step,
            hop,
            window: window.collect(),
            transform: FftPlanner::new().plan_fft_forward(samples),
        })
    }

    /// Time between two samples.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Samples of a record that holds this many segments.
    pub fn record_length(&self, segments: usize) -> usize {
        self.window.len() + segments.saturating_sub(1) * self.hop
    }

    /// Distance of two frequencies.
    pub fn spacing(&self) -> f64 {
        TAU / (self.window.len() as f64 * self.step)
    }

    /// The frequencies, 0 to pi/step.
    pub fn omega(&self) -> Vec<f64> {
        let spacing = self.spacing();
        (0..=self.window.len() / 2)
            .map(|k| k as f64 * spacing)
            .collect()
    }

    fn power(&self) -> f64 {
        self.window.iter().map(|w| w * w).sum()
    }

    /// Equivalent noise bandwidth M sum w^2/(sum w)^2 in bins: 1.5.
    pub fn noise_bandwidth(&self) -> f64 {
        let sum: f64 = self.window.iter().sum();
        self.window.len() as f64 * self.power() / (sum * sum)
    }

    /// The RMS magnitude of the paper's figures from a one-sided density: the deviation within the
    /// bandwidth of a bin, sqrt(S 1.5 d omega), which for a sine of amplitude a, at its bin, is a/sqrt 2.
    pub fn magnitude(&self, density: f64) -> f64 {
        (density * self.noise_bandwidth() * self.spacing()).sqrt()
    }

    /// The average over the segments of a record.
    pub fn record(&self, record: &[f64]) -> Periodogram {
        let m = self.window.len();
        let mut density = vec![0.0; m / 2 + 1];
        let mut scratch = vec![C::default(); self.transform.get_inplace_scratch_len()];
        let mut terms = vec![C::default(); m];
        let segments = (record.len() + self.hop).saturating_sub(m) / self.hop;
        for k in 0..segments {
            let segment = &record[k * self.hop..k * self.hop + m];
            for ((term, x), w) in terms.iter_mut().zip(segment).zip(&self.window) {
                *term = C::new(x * w, 0.0);
            }
            self.transform
                .process_with_scratch(&mut terms, &mut scratch);
            for (g, term) in density.iter_mut().zip(&terms) {
                *g += term.norm_sqr();
            }
        }
        let scale = self.step / (PI * self.power() * segments.max(1) as f64);
        for g in &mut density {
            *g *= scale;
        }
        Periodogram { density, segments }
    }

    /// The average over independent records of equal length, with its standard error: from the scatter
    /// of the records and their skewness; its share of the value is pooled over the nearest 17 bins, unless that of the bin is larger.
    pub fn average(&self, records: &[Periodogram]) -> Vec<Estimate> {
        let n = records.len() as f64;
        let bins = self.window.len() / 2 + 1;
        let mut mean = vec![0.0; bins];
        for record in records {
            for (mean, g) in mean.iter_mut().zip(&record.density) {
                *mean += g / n;
            }
        }
        let scatter: Vec<f64> = (0..bins)
            .map(|k| {
                let deviations = records
                    .iter()
                    .map(|record| (record.density[k] / mean[k] - 1.0) / n);
                skewed_variance(deviations) * n / (n - 1.0)
            })
            .collect();
        let pooled = |k: usize| {
            let near = &scatter[k.saturating_sub(POOLED)..(k + POOLED + 1).min(bins)];
            (near.iter().sum::<f64>() / near.len() as f64).sqrt()
        };
        let estimate = |(k, mean): (usize, &f64)| {
            let share = pooled(k).max(scatter[k].sqrt());
            Estimate::new(*mean, mean * share, Origin::Sampling)
        };
        mean.iter().enumerate().map(estimate).collect()
    }

    /// The expectation of the estimate for a process with this correlation at 0, step, 2 step, ...: the
    /// spectrum seen through window and sampling, aliases included. Lags beyond those given count as 0.
    pub fn expectation(&self, correlation: &[f64]) -> Vec<f64> {
        let m = self.window.len();
        let mut planner = FftPlanner::new();
        // sum_n w_n w_{n+l} by a transform twice as long.
        let mut terms = vec![C::default(); 2 * m];
        for (term, w) in terms.iter_mut().zip(&self.window) {
            term.re = *w;
        }
        planner.plan_fft_forward(2 * m).process(&mut terms);
        for term in &mut terms {
            *term = C::new(term.norm_sqr() / (2 * m) as f64, 0.0);
        }
        planner.plan_fft_inverse(2 * m).process(&mut terms);
        let mut folded = vec![C::default(); m];
        for (l, r) in correlation.iter().enumerate().take(m) {
            let value = r * terms[l].re;
            folded[l].re += value;
            if l > 0 {
                folded[m - l].re += value;
            }
        }
        self.transform.process(&mut folded);
        let scale = self.step / (PI * self.power());
        folded[..=m / 2]
            .iter()
            .map(|term| scale * term.re)
            .collect()
    }
}
