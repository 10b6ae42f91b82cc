//! Laws that stay Gaussian: under G = q and under G = -1 the mean and covariance obey linear
//! equations, so the transient is known in closed form at any time.

use crate::contact::ContactLaw;
use crate::error::{Error, Result, ascending};
use crate::initial::Initial;
use crate::matrix::exponential;
use crate::oscillator::Oscillator;
use ndarray::{Array1, Array2};
use std::f64::consts::{SQRT_2, TAU};

/// Standard normal density.
pub(crate) fn normal(x: f64) -> f64 {
    (-0.5 * x * x).exp() / TAU.sqrt()
}

/// Standard normal distribution function, relative accuracy kept in the lower tail.
pub(crate) fn lower(x: f64) -> f64 {
    0.5 * libm::erfc(-x / SQRT_2)
}

/// Gaussian density of variance T.
pub fn maxwell(v: f64, temperature: f64) -> f64 {
    (-0.5 * v * v / temperature).exp() / (TAU * temperature).sqrt()
}

/// P(a < v < b) of a Gaussian with this mean and deviation, accurate relative to itself in both tails.
pub(crate) fn gaussian_mass(mean: f64, deviation: f64, a: f64, b: f64) -> f64 {
    let (x, y) = (
        (a - mean) / (deviation * SQRT_2),
        (b - mean) / (deviation * SQRT_2),
    );
    if x > 0.0 {
        0.5 * (libm::erfc(x) - libm::erfc(y))
    } else if y < 0.0 {
        0.5 * (libm::erfc(-y) - libm::erfc(-x))
    } else {
        0.5 * (libm::erf(y) - libm::erf(x))
    }
}

/// A Gaussian law of (q, v).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaussian {
    /// Mean of (q, v).
    pub mean: [f64; 2],
    /// Covariance of (q, v).
    pub covariance: [[f64; 2]; 2],
}

impl Gaussian {
    /// The law of an initial condition: a point for [`Initial::Rest`].
    ///
    /// # Errors
    /// [`Error::NoStationaryLaw`] for the stationary one, unless the law is linear; [`Error::Invalid`] for one under damping that
    /// is not viscous.
    pub fn of(oscillator: &Oscillator, initial: &Initial) -> Result<Self> {
        if let Some([mean, [sq, sv]]) = initial.mean_and_deviation() {
            Ok(Self {
                mean,
                covariance: [[sq * sq, 0.0], [0.0, sv * sv]],
            })
        } else if *oscillator.contact() == ContactLaw::Linear {
            let t = oscillator.with_closed_form()?.temperature();
            Ok(Self {
                mean: [0.0; 2],
                covariance: [[t, 0.0], [0.0, t]],
            })
        } else {
            Err(Error::NoStationaryLaw {
                what: "a Gaussian stationary initial condition".into(),
                contact: oscillator.contact().name().into(),
                why: "its stationary law, if there is one, is not Gaussian".into(),
            })
        }
    }

    /// The law a time `t` later under G = q or G = -1, exact to rounding: with x = (q, v),
    /// m' = A m + b and C' = A C + C A^T + diag(0, 2 pi h), solved by one matrix exponential.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a contact or a damping law under which a Gaussian does not stay one, and for a time that is negative or
    /// not finite.
    pub fn after(&self, oscillator: &Oscillator, t: f64) -> Result<Self> {
        oscillator.with_closed_form()?;
        ascending("t", "times", &[t])?;
        let (stiffness, drive) = match oscillator.contact() {
            ContactLaw::Linear => (1.0, 0.0),
            ContactLaw::Free => (0.0, 1.0),
            other => {
                let accepted = "\"linear\" or \"free\", under which a Gaussian stays Gaussian";
                return Err(Error::invalid("oscillator.contact", other.name(), accepted));
            }
        };
        let friction = 2.0 * oscillator.zeta();
        // Unknowns: mean q, mean v, C_qq, C_qv, C_vv, 1.
        let mut a = Array2::zeros((6, 6));
        a[[0, 1]] = 1.0;
        a[[1, 0]] = -stiffness;
        a[[1, 1]] = -friction;
        a[[1, 5]] = drive;
        a[[2, 3]] = 2.0;
        a[[3, 4]] = 1.0;
        a[[3, 3]] = -friction;
        a[[3, 2]] = -stiffness;
        a[[4, 3]] = -2.0 * stiffness;
        a[[4, 4]] = -2.0 * friction;
        a[[4, 5]] = 2.0 * oscillator.noise();
        let e = exponential(&a, t);
        let [[cqq, cqv], [_, cvv]] = self.covariance;
        let x = vec![self.mean[0], self.mean[1], cqq, cqv, cvv, 1.0];
        let y = e.dot(&Array1::from_vec(x));
        Ok(Self {
            mean: [y[0], y[1]],
            covariance: [[y[2], y[3]], [y[3], y[4]]],
        })
    }

    /// The density at (q, v).
    pub fn density(&self, q: f64, v: f64) -> f64 {
        let [[a, b], [_, c]] = self.covariance;
        let determinant = a * c - b * b;
        let (x, y) = (q - self.mean[0], v - self.mean[1]);
        let form = (c * x * x - 2.0 * b * x * y + a * y * y) / determinant;
        (-0.5 * form).exp() / (TAU * determinant.sqrt())
    }
}
