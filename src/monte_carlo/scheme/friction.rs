//! Friction with noise over a time: the exact Ornstein-Uhlenbeck step.

use crate::damping::mean_decay;
use crate::oscillator::Oscillator;

/// exp(-2 zeta time) and sqrt(T (1 - exp(-4 zeta time))): the exact Ornstein-Uhlenbeck step of v.
pub(super) fn ornstein_uhlenbeck(oscillator: &Oscillator, time: f64) -> (f64, f64) {
    let exponent = -2.0 * oscillator.zeta() * time;
    let variance = oscillator.temperature() * -(2.0 * exponent).exp_m1();
    (exponent.exp(), variance.sqrt())
}

/// The exact Ornstein-Uhlenbeck step of v where the rate depends on the displacement, which it leaves alone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Local {
    time: f64,
    /// 2 zeta times the time.
    exponent: f64,
    /// Variance that noise alone adds, 2 pi h times the time.
    variance: f64,
}

impl Local {
    pub(super) fn new(oscillator: &Oscillator, time: f64) -> Self {
        Self {
            time,
            exponent: 2.0 * oscillator.zeta() * time,
            variance: 2.0 * oscillator.noise() * time,
        }
    }

    /// Decay and spread where c/(2 zeta) is `friction`; in free flight noise alone.
    #[inline(always)]
    pub(super) fn at(self, friction: f64) -> (f64, f64) {
        let x = friction * self.exponent;
        let spread = (self.variance * mean_decay(2.0 * x)).sqrt();
        ((-x).exp(), spread)
    }

    /// What a force of 1 does to v where c/(2 zeta) is `friction`.
    #[inline(always)]
    pub(super) fn impulse(self, friction: f64) -> f64 {
        self.time * mean_decay(friction * self.exponent)
    }
}
