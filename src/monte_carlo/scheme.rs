//! One step: how (q, v) advances under noise, friction and contact force.

mod exponential_heun;
mod friction;
mod kernel;
mod splitting;
mod step;

pub(super) use kernel::{Group, cubic};

use super::events::Watch;
use super::law::Law;
use crate::oscillator::Oscillator;
use exponential_heun::ExponentialHeun;
use kernel::kernel_steps;
use splitting::Splitting;
use std::fmt;
use step::{Baoab, CentralDifference, EulerMaruyama};

/// How one step is made. The weak order is that of E\[f(q, v)\] at a fixed time for smooth f.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Scheme {
    /// With white noise [`Scheme::Splitting42`], under strong friction (zeta above twice the highest
    /// frequency) [`Scheme::ExponentialHeun`]; with a sum of cosines [`Scheme::CentralDifference`].
    #[default]
    Auto,
    /// Central differences in time for q'' and q', as in the paper, section 5.2; with white noise this is
    /// the scheme of Bruenger, Brooks and Karplus, Chem. Phys. Lett. 105:495 (1984).
    ///
    /// Weak order 2 in q. The velocity at a whole step knows half of that step's noise: in v there is a
    /// term of order zeta step. Bias for G = q: Var q is T/(1 - step^2/4), Var v is T/(1 + zeta step); the
    /// phase leads by step^2/24 a unit of time.
    CentralDifference,
    /// Kick B, drift A, exact Ornstein-Uhlenbeck step O, drift A, kick B.
    ///
    /// Weak order 2. Bias for G = q: Var q exact, Var v is T (1 - step^2/4); the phase leads by step^2/24
    /// a unit of time. Leimkuhler & Matthews, AMRX 2013(1), 34-56.
    Baoab,
    /// H(c1) O(1/2) H(c2) O(1/2) H(c1) with c1 = 1/2 - sqrt 3/6 and c2 = sqrt 3/3: the undamped motion H,
    /// crossings of the loss point located, between exact Ornstein-Uhlenbeck steps O.
    ///
    /// Weak error O(zeta step^4 + zeta^2 step^2). Both parts preserve the stationary law, so it has no
    /// bias at any step. McLachlan, BIT 35:258 (1995); Laskar and Robutel, Celest. Mech. Dyn. Astron.
    /// 80:39 (2001).
    Splitting42,
    /// H(c1) O(5/18) H(c2) O(8/18) H(c2) O(5/18) H(c1) with c1 = 1/2 - sqrt 15/10 and c2 = sqrt 15/10.
    ///
    /// Weak error O(zeta step^6 + zeta^2 step^2), otherwise as [`Scheme::Splitting42`].
    Splitting62,
    /// Euler and Maruyama: v and q from the old state. The warning example.
    ///
    /// Weak order 1. Its damping is 2 zeta - step: a weakly damped oscillator gains energy without
    /// bound once step > 2 zeta, and before that its stationary variances are 1/(1 - step/(2 zeta))
    /// times too large.
    EulerMaruyama,
    /// Friction and noise of q and v together exactly, the force held straight between its values at
    /// both ends (predicted, then corrected): for strong friction, where its step is bound by the slow
    /// drift, not by 1/zeta.
    ///
    /// Weak order 2. Bias for G = q: Var v is too small by at most 1/(4 zeta^2) of itself, Var q by some
    /// (step/(2 zeta))^2. Crossings of the loss point are not located. After Cox and Matthews, J. Comput.
    /// Phys. 176:430 (2002), scheme ETD2RK.
    ExponentialHeun,
}

impl Scheme {
    /// Every one.
    #[cfg(feature = "toml")]
    pub(crate) const ALL: [Self; 7] = [
        Self::Auto,
        Self::CentralDifference,
        Self::Baoab,
        Self::Splitting42,
        Self::Splitting62,
        Self::EulerMaruyama,
        Self::ExponentialHeun,
    ];

    /// The name used in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::CentralDifference => "central_difference",
            Self::Baoab => "baoab",
            Self::Splitting42 => "splitting_4_2",
            Self::Splitting62 => "splitting_6_2",
            Self::EulerMaruyama => "euler_maruyama",
            Self::ExponentialHeun => "exponential_heun",
        }
    }

    /// Whether losses and returns of contact are located within a step.
    pub fn locates_crossings(self) -> bool {
        self != Self::ExponentialHeun
    }
}

impl fmt::Display for Scheme {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What a scheme computes once for every step of the same length.
#[derive(Debug, Clone, Copy)]
pub(super) enum Coefficients {
    CentralDifference(CentralDifference),
    Baoab(Baoab),
    Splitting(Splitting),
    EulerMaruyama(EulerMaruyama),
    ExponentialHeun(ExponentialHeun),
}

impl Coefficients {
    /// The coefficients of `scheme` for `step`; `frequency` is the highest of the scene.
    pub(super) fn new(scheme: Scheme, oscillator: &Oscillator, step: f64, frequency: f64) -> Self {
        let splitting = |motions, weights: &[f64]| {
            let it = Splitting::new(oscillator, step, frequency, motions, weights);
            Self::Splitting(it)
        };
        match scheme {
            Scheme::CentralDifference => {
                Self::CentralDifference(CentralDifference::new(oscillator, step))
            }
            Scheme::Baoab => Self::Baoab(Baoab::new(oscillator, step)),
            Scheme::Auto | Scheme::Splitting42 => {
                let c = 3f64.sqrt() / 6.0;
                splitting([0.5 - c, 2.0 * c, 2.0 * (0.5 - c)], &[0.5, 0.5])
            }
            Scheme::Splitting62 => {
                let c = 15f64.sqrt() / 10.0;
                let motions = [0.5 - c, c, 2.0 * (0.5 - c)];
                let weights = [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0];
                splitting(motions, &weights)
            }
            Scheme::EulerMaruyama => Self::EulerMaruyama(EulerMaruyama::new(oscillator, step)),
            Scheme::ExponentialHeun => {
                Self::ExponentialHeun(ExponentialHeun::new(oscillator, step))
            }
        }
    }

    /// Advances `group` by `steps` steps; `now` is the time at the beginning, told to `watch`.
    #[inline(always)]
    pub(super) fn advance<L: Law, W: Watch>(
        &self,
        law: L,
        group: &mut Group,
        steps: u64,
        now: f64,
        watch: &mut W,
    ) {
        match self {
            Self::CentralDifference(kernel) => {
                kernel_steps(law, *kernel, group, steps, now, watch);
            }
            Self::Baoab(kernel) => kernel_steps(law, *kernel, group, steps, now, watch),
            Self::Splitting(splitting) => splitting.advance(law, group, steps, now, watch),
            Self::EulerMaruyama(kernel) => kernel_steps(law, *kernel, group, steps, now, watch),
            Self::ExponentialHeun(heun) => heun.advance(law, group, steps, watch),
        }
    }
}

#[cfg(test)]
#[path = "scheme/scheme_tests.rs"]
mod tests;
