//! Spectra of the stationary motion without sampling noise, from the resolvent of the generator.
//!
//! ```text
//! G(omega) = (2/pi) Re <X - E X, (i omega - L)^{-1} (X - E X)>,   X = N or q,   integral_0^infinity G d omega = Var X
//! ```
//!
//! One-sided, per circular frequency. At zero the spectrum of the force is the excitation's, G = 2h.
//! There is no time step, so nothing aliases; the answer is as good in the valleys, many decades below
//! the peak, as on it. The operator is that of [`super::hermite`], the frequencies come all from one
//! small model ([`super::reduced`]).

use super::choice::Settings;
use super::hermite::{Hierarchy, Resolution};
use super::reduced::{Answer, Reduced};
use crate::error::{Error, Result, finite};
use crate::estimate::{Estimate, Origin};
use crate::oscillator::{Oscillator, Quantity};
use std::f64::consts::FRAC_2_PI;
use std::time::Instant;

/// A spectrum's natural scale is the larger of its value and this part of its peak.
pub const FLOOR: f64 = 1e-6;

/// Share of the tolerance left to the reduced model.
const MODEL: f64 = 0.02;

/// Frequencies solved for at most on one mesh.
const SOLVES: usize = 160;

/// Growth of the resolution from one round to the next.
const FINER: f64 = 1.4;

/// Unknowns in q beyond which blocks no longer fit a reasonable time.
const WIDEST: usize = 1200;

/// A one-sided spectrum with its errors.
#[derive(Debug, Clone)]
pub struct Spectrum {
    /// What it is of.
    pub quantity: Quantity,
    /// Circular frequencies.
    pub omega: Vec<f64>,
    /// G at each of them: the integral over omega is the variance. The error is the change from the
    /// next coarser operator and the error of the reduced model.
    pub density: Vec<Estimate>,
    /// Variance of the quantity on the operator used.
    pub variance: f64,
    /// Functions of q and of v.
    pub functions: [usize; 2],
    /// Frequencies solved for, and the dimension of the model they make.
    pub solves: usize,
    /// Dimension of the reduced model.
    pub dimension: usize,
    /// Whether every error is within the tolerance, relative to the natural scale.
    pub reached: bool,
    model: Reduced,
}

impl Spectrum {
    /// The autocorrelation function of the quantity, its mean taken off, at 0, `step`, 2 `step`, ...
    pub fn correlation(&self, step: f64, count: usize) -> Vec<f64> {
        self.model.correlation(step, count)
    }

    /// The largest error over the natural scale, and the frequency where it is.
    pub fn worst(&self) -> (f64, f64) {
        let peak = self.density.iter().map(|it| it.value).fold(0.0, f64::max);
        let relative = |it: &Estimate| it.error / it.value.abs().max(FLOOR * peak);
        let errors = self.omega.iter().zip(&self.density);
        errors
            .map(|(w, it)| (relative(it), *w))
            .fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a })
    }
}

/// The spectrum of `quantity` in the stationary motion at the ascending circular frequencies `omegas`.
///
/// The operator is refined until the change is within `settings.tolerance` of the natural scale, the
/// larger of the value and 1e-6 of the peak; `settings.cells` fixes the finest one, as functions of q and
/// of v. `progress` is called with the fraction done.
///
/// # Errors
/// [`Error::NoStationaryLaw`] for a contact that does not confine; [`Error::Invalid`] for no
/// frequencies, or frequencies that are negative, not finite or not ascending; [`Error::Limit`] beyond
/// `settings.max_seconds`.
pub fn spectrum(
    oscillator: &Oscillator,
    quantity: Quantity,
    omegas: &[f64],
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Spectrum> {
    oscillator.displacement_law()?;
    check(omegas)?;
    let began = Instant::now();
    let tolerance = settings.tolerance;
    let solve = |resolution: Resolution, share: f64| -> Result<(Reduced, Vec<Answer>)> {
        let full = Hierarchy::new(oscillator, quantity, resolution)?;
        let go_on = |solved: usize| {
            progress(share * (solved as f64 / 60.0).min(1.0));
            if began.elapsed().as_secs_f64() > settings.max_seconds {
                return Err(Error::Limit {
                    key: "accuracy.max_seconds",
                    limit: settings.max_seconds.to_string(),
                    what: format!("{solved} frequencies of the spectrum were solved"),
                });
            }
            Ok(())
        };
        let model = Reduced::new(&full, omegas, MODEL * tolerance, FLOOR, SOLVES, &go_on)?;
        let answers = omegas.iter().map(|w| model.at(*w)).collect();
        Ok((model, answers))
    };
    let mut resolution = first(settings);
    let (_, mut coarse) = solve(resolution, 0.2)?;
    loop {
        resolution = finer(resolution);
        let (model, fine) = solve(resolution, 0.9)?;
        let density = estimates(omegas, &coarse, &fine);
        let mut it = Spectrum {
            quantity,
            omega: omegas.to_vec(),
            density,
            variance: model.variance,
            functions: [resolution.across(), 2 * resolution.pairs],
            solves: model.solved.len(),
            dimension: model.dimension(),
            reached: true,
            model,
        };
        it.reached = it.worst().0 <= tolerance;
        let next = finer(resolution);
        let fits = next.memory() * 2 < settings.max_memory && next.across() <= WIDEST;
        // The next round takes as many solves, each of them longer.
        let spent = began.elapsed().as_secs_f64();
        let longer = next.operations() / resolution.operations();
        let in_time = spent * (1.0 + longer) < settings.max_seconds;
        if it.reached || settings.cells.is_some() || !fits || !in_time {
            progress(1.0);
            return Ok(it);
        }
        coarse = fine;
    }
}

fn check(omegas: &[f64]) -> Result<()> {
    if omegas.is_empty() {
        return Err(Error::invalid(
            "omegas",
            "an empty list",
            "at least one frequency",
        ));
    }
    for (k, omega) in omegas.iter().enumerate() {
        let name = format!("omegas[{k}]");
        finite(&name, *omega)?;
        if *omega < 0.0 || (k > 0 && *omega <= omegas[k - 1]) {
            let accepted = "ascending frequencies, none negative";
            return Err(Error::invalid(name, omega, accepted));
        }
    }
    Ok(())
}

/// The coarse operator of the first comparison.
fn first(settings: &Settings) -> Resolution {
    // Beyond 23 T lies 1e-10 of the probability of energies; a function there changes no spectrum by
    // more than that times the square of its size, about 1e3.
    let level = 23.0;
    match settings.cells {
        Some([q, v]) => Resolution {
            elements: ((q as f64 / super::hermite::DEGREE as f64 / FINER).round() as usize).max(2),
            pairs: ((v as f64 / 2.0 / FINER).round() as usize).max(2),
            level,
        },
        None => Resolution {
            elements: 6,
            pairs: 24,
            level,
        },
    }
}

fn finer(it: Resolution) -> Resolution {
    Resolution {
        elements: (it.elements as f64 * FINER).round() as usize,
        pairs: (it.pairs as f64 * FINER).round() as usize,
        level: it.level + 1.5,
    }
}

/// The fine answers; their error is the largest relative change nearby, since a difference of two curves
/// crosses zero where they are no better than elsewhere.
fn estimates(omegas: &[f64], coarse: &[Answer], fine: &[Answer]) -> Vec<Estimate> {
    let change: Vec<f64> = coarse
        .iter()
        .zip(fine)
        .map(|(a, b)| (a.value - b.value).abs() / b.value.abs().max(f64::MIN_POSITIVE))
        .collect();
    let mut first = 0;
    let nearby = |k: usize| {
        while omegas[k] - omegas[first] > 0.1 {
            first += 1;
        }
        let last = omegas.partition_point(|w| *w <= omegas[k] + 0.1);
        change[first..last].iter().fold(0.0f64, |a, b| a.max(*b))
    };
    let changes: Vec<f64> = (0..omegas.len()).map(nearby).collect();
    fine.iter()
        .zip(&changes)
        .map(|(it, change)| {
            let value = FRAC_2_PI * it.value;
            let error = FRAC_2_PI * it.error + value.abs() * change;
            Estimate::new(value, error, Origin::Space)
        })
        .collect()
}
