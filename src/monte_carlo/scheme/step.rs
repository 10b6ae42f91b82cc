//! Schemes of one kernel: central differences, BAOAB, Euler and Maruyama.

use super::friction::Friction;
use super::kernel::Kernel;
use crate::monte_carlo::law::Law;
use crate::oscillator::Oscillator;

/// [`Scheme::CentralDifference`]: (q+ - 2q + q-)/step^2 + 2 zeta (q+ - q-)/(2 step) + G(q) = f, written
/// with v = (q+ - q-)/(2 step). White noise is f = sqrt(2 pi h/step) times a normal.
#[derive(Debug, Clone, Copy)]
pub(in crate::monte_carlo) struct CentralDifference {
    step: f64,
    half: f64,
    friction: f64,
    spread: f64,
}

impl CentralDifference {
    pub(super) fn new(oscillator: &Oscillator, step: f64) -> Self {
        Self {
            step,
            half: 0.5 * step,
            friction: oscillator.zeta() * step,
            spread: 0.5 * (2.0 * oscillator.noise() * step).sqrt(),
        }
    }
}

impl Kernel for CentralDifference {
    #[inline(always)]
    fn duration(self) -> f64 {
        self.step
    }

    #[inline(always)]
    fn kick<L: Law>(self, law: L, q: f64, excitation: f64) -> f64 {
        self.spread * excitation - self.half * law.force(q)
    }

    #[inline(always)]
    fn step<L: Law>(
        self,
        law: L,
        (q, v, kick): (f64, f64, f64),
        excitation: f64,
    ) -> (f64, f64, f64) {
        let friction = self.friction * law.friction(q);
        let middle = v - friction * v + kick; // (q+ - q)/step
        let q = q + self.step * middle;
        let kick = self.kick(law, q, excitation);
        let friction = self.friction * law.friction(q);
        (q, (middle + kick) / (1.0 + friction), kick)
    }

    /// Half a step of f, where a standard normal stands for spread.
    fn cosines(self) -> Option<f64> {
        Some(self.half / self.spread)
    }
}

#[derive(Debug, Clone, Copy)]
pub(in crate::monte_carlo) struct Baoab {
    step: f64,
    half: f64,
    friction: Friction,
}

impl Baoab {
    pub(super) fn new(oscillator: &Oscillator, step: f64) -> Self {
        Self {
            step,
            half: 0.5 * step,
            friction: Friction::new(oscillator, step),
        }
    }
}

impl Kernel for Baoab {
    #[inline(always)]
    fn duration(self) -> f64 {
        self.step
    }

    #[inline(always)]
    fn kick<L: Law>(self, law: L, q: f64, _: f64) -> f64 {
        -self.half * law.force(q)
    }

    #[inline(always)]
    fn step<L: Law>(self, law: L, (q, v, kick): (f64, f64, f64), normal: f64) -> (f64, f64, f64) {
        let v = v + kick; // B
        let q = q + self.half * v; // A
        let (decay, spread) = self.friction.at::<L>(law.friction(q));
        let v = decay * v + spread * normal; // O
        let q = q + self.half * v; // A
        let kick = self.kick(law, q, 0.0);
        (q, v + kick, kick) // B
    }
}

#[derive(Debug, Clone, Copy)]
pub(in crate::monte_carlo) struct EulerMaruyama {
    step: f64,
    friction: f64,
    spread: f64,
}

impl EulerMaruyama {
    pub(super) fn new(oscillator: &Oscillator, step: f64) -> Self {
        Self {
            step,
            friction: 2.0 * oscillator.zeta() * step,
            spread: (2.0 * oscillator.noise() * step).sqrt(),
        }
    }
}

impl Kernel for EulerMaruyama {
    #[inline(always)]
    fn duration(self) -> f64 {
        self.step
    }

    #[inline(always)]
    fn kick<L: Law>(self, _: L, _: f64, _: f64) -> f64 {
        0.0
    }

    #[inline(always)]
    fn step<L: Law>(self, law: L, (q, v, _): (f64, f64, f64), normal: f64) -> (f64, f64, f64) {
        let friction = self.friction * law.friction(q);
        let force = law.force(q) * self.step + friction * v;
        (q + self.step * v, v - force + self.spread * normal, 0.0)
    }
}
