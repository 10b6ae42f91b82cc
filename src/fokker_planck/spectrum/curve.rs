//! A one-sided spectrum with its errors.

use super::reduced::Reduced;
use crate::estimate::{Estimate, Shortfall};
use crate::oscillator::Quantity;
use std::f64::consts::FRAC_2_PI;

/// A spectrum's normalisation is the larger of its value and this part of its peak.
pub(super) const FLOOR: f64 = 1e-6;

/// The part of the variance that the trapezoid over an interval of a filled spectrum may lack.
const LACKING: f64 = 1e-5;

/// The narrowest interval of it that is halved, over its frequency: rounding.
const NARROWEST: f64 = 1e-9;

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

    /// The same spectrum at more frequencies: intervals are halved until trapezoids over them hold the variance.
    /// The error of a new one is in proportion to those beside it, each over its own normalisation.
    pub(crate) fn filled(mut self) -> Self {
        let floor = self.floor();
        let known: Vec<(f64, Estimate)> =
            self.omega.drain(..).zip(self.density.drain(..)).collect();
        // Pairs still to be looked at, the lowest last.
        let mut ends: Vec<(f64, Estimate)> = known.into_iter().rev().collect();
        while let Some(low) = ends.pop() {
            while let Some(high) = ends.last().copied() {
                let (width, omega) = (high.0 - low.0, 0.5 * (low.0 + high.0));
                let mean = 0.5 * (low.1.value + high.1.value);
                let value = self.at(omega);
                let lacking = 2.0 / 3.0 * width * (value - mean).abs();
                if !(lacking > LACKING * self.variance && width > NARROWEST * omega) {
                    break;
                }
                let relative = [low, high].map(|(_, it)| it.error / it.value.abs().max(floor));
                let error = value.abs().max(floor) * relative[0].max(relative[1]);
                ends.push((omega, Estimate::new(value, error, low.1.origin)));
            }
            self.omega.push(low.0);
            self.density.push(low.1);
        }
        self
    }

    /// The least normalisation of a value.
    fn floor(&self) -> f64 {
        FLOOR * self.density.iter().map(|it| it.value).fold(0.0, f64::max)
    }

    /// What trapezoids over the frequencies hold, over the variance.
    pub(crate) fn held(&self) -> f64 {
        let both = self.omega.windows(2).zip(self.density.windows(2));
        let areas = both.map(|(w, g)| 0.5 * (w[1] - w[0]) * (g[0].value + g[1].value));
        areas.sum::<f64>() / self.variance
    }

    /// The largest error over the normalisation, and the frequency where it is.
    pub(crate) fn worst(&self) -> (f64, f64) {
        let floor = self.floor();
        let relative = |it: &Estimate| it.error / it.value.abs().max(floor);
        let errors = self.omega.iter().zip(&self.density);
        errors
            .map(|(w, it)| (relative(it), *w))
            .fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a })
    }
}
