//! A one-sided spectrum with its errors.

use super::reduced::Reduced;
use crate::estimate::{Estimate, Shortfall};
use crate::oscillator::Quantity;
use std::f64::consts::FRAC_2_PI;

/// A spectrum's normalisation is the larger of its value and this part of its peak.
pub(super) const FLOOR: f64 = 1e-6;

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
    /// Mean of the quantity, where damping leaves no closed form of it.
    pub(crate) mean: Option<f64>,
    /// Functions of q and of v.
    pub functions: [usize; 2],
    /// Frequencies solved for.
    pub solves: usize,
    /// Dimension of the reduced model.
    pub dimension: usize,
    /// What the tolerance asked for and was not reached.
    pub shortfall: Option<Shortfall>,
    pub(super) model: Reduced,
}

impl Spectrum {
    /// The autocorrelation function of the quantity, its mean taken off, at 0, `step`, 2 `step`, ...
    pub fn correlation(&self, step: f64, count: usize) -> Vec<f64> {
        self.model.correlation(step, count)
    }

    /// The density at any frequency within the range of `omega`, from the model of all of them.
    pub fn at(&self, omega: f64) -> f64 {
        FRAC_2_PI * self.model.at(omega).value
    }

    /// The largest error over the normalisation, and the frequency where it is.
    pub(crate) fn worst(&self) -> (f64, f64) {
        let peak = self.density.iter().map(|it| it.value).fold(0.0, f64::max);
        let relative = |it: &Estimate| it.error / it.value.abs().max(FLOOR * peak);
        let errors = self.omega.iter().zip(&self.density);
        errors
            .map(|(w, it)| (relative(it), *w))
            .fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a })
    }
}
