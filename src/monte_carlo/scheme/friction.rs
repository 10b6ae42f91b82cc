//! Friction with noise over a time: the exact Ornstein-Uhlenbeck step.

use crate::damping::mean_decay;
use crate::monte_carlo::law::Law;
use crate::oscillator::Oscillator;

/// The exact Ornstein-Uhlenbeck step of v over a time, which leaves q alone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Friction {
    time: f64,
    /// 2 zeta times the time.
    exponent: f64,
    /// Variance that noise alone adds, 2 pi h times the time.
    variance: f64,
    /// exp(-2 zeta time) and sqrt(T (1 - exp(-4 zeta time))): decay and spread under viscous damping.
    pub(super) viscous: (f64, f64),
    /// What a force of 1 then does to v.
    impulse: f64,
}

impl Friction {
    pub(super) fn new(oscillator: &Oscillator, time: f64) -> Self {
        let exponent = 2.0 * oscillator.zeta() * time;
        let variance = oscillator.temperature() * -(-2.0 * exponent).exp_m1();
        Self {
            time,
            exponent,
            variance: 2.0 * oscillator.noise() * time,
            viscous: ((-exponent).exp(), variance.sqrt()),
            impulse: time * mean_decay(exponent),
        }
    }

    /// Decay and spread where c/(2 zeta) is `factor`; in free flight noise alone.
    #[inline(always)]
    pub(super) fn at<L: Law>(self, factor: f64) -> (f64, f64) {
        if L::VISCOUS {
            return self.viscous;
        }
        let x = factor * self.exponent;
        let spread = (self.variance * mean_decay(2.0 * x)).sqrt();
        ((-x).exp(), spread)
    }

    /// What a force of 1 does to v where c/(2 zeta) is `factor`.
    #[inline(always)]
    pub(super) fn impulse<L: Law>(self, factor: f64) -> f64 {
        if L::VISCOUS {
            return self.impulse;
        }
        self.time * mean_decay(factor * self.exponent)
    }
}
