//! One step: how (q, v) advances under noise, friction and contact force.

use super::law::Law;
use super::noise::{LANES, Lanes, Streams};
use crate::error::{Error, Result};
use crate::oscillator::Oscillator;
use std::fmt;
use std::str::FromStr;

/// How one step is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Scheme {
    /// Chosen from the oscillator.
    #[default]
    Auto,
    /// Kick, drift, exact Ornstein-Uhlenbeck step, drift, kick. Weak order 2; for G = q the stationary
    /// law of q is exact at any step and Var v is T (1 - step^2/4); the phase lags by step^2/24.
    /// Leimkuhler & Matthews, AMRX 2013(1), 34-56.
    Baoab,
}

impl Scheme {
    /// Every scheme that can be asked for by name.
    pub const ALL: [Self; 2] = [Self::Auto, Self::Baoab];

    /// The name used in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Baoab => "baoab",
        }
    }
}

impl fmt::Display for Scheme {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// From the name used in scenes.
impl FromStr for Scheme {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let known = Self::ALL.iter().find(|scheme| scheme.name() == name);
        known.copied().ok_or_else(|| {
            let names: Vec<_> = Self::ALL
                .iter()
                .map(|s| format!("\"{}\"", s.name()))
                .collect();
            Error::invalid(
                "monte_carlo.scheme",
                format!("\"{name}\""),
                names.join(", "),
            )
        })
    }
}

/// The paths that advance together.
#[derive(Debug, Clone)]
pub(super) struct Group {
    pub(super) q: Lanes,
    pub(super) v: Lanes,
    pub(super) streams: Streams,
}

/// What a scheme computes once for every step of the same length.
#[derive(Debug, Clone, Copy)]
pub(super) enum Coefficients {
    Baoab(Baoab),
}

impl Coefficients {
    /// The coefficients of `scheme` for `step`.
    pub(super) fn new(scheme: Scheme, oscillator: &Oscillator, step: f64) -> Self {
        match scheme {
            Scheme::Auto | Scheme::Baoab => Self::Baoab(Baoab::new(oscillator, step)),
        }
    }

    /// Advances `group` by `steps` steps.
    #[inline(always)]
    pub(super) fn advance<L: Law>(&self, law: L, group: &mut Group, steps: u64) {
        match self {
            Self::Baoab(kernel) => advance(law, *kernel, group, steps),
        }
    }
}

/// A scheme of one normal a step: what it does before the first step of an interval, in each step,
/// and after the last.
trait Kernel: Copy {
    fn before<L: Law>(self, law: L, q: f64, v: f64) -> f64;
    fn step<L: Law>(self, law: L, q: f64, v: f64, normal: f64) -> (f64, f64);
    fn after<L: Law>(self, law: L, q: f64, v: f64) -> f64;
}

#[inline(always)]
fn advance<L: Law, K: Kernel>(law: L, kernel: K, group: &mut Group, steps: u64) {
    let (mut q, mut v) = (group.q, group.v);
    let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        v[lane] = kernel.before(law, q[lane], v[lane]);
    }
    for _ in 0..steps / 2 {
        group.streams.normals(&mut first, &mut second);
        for lane in 0..LANES {
            let (q1, v1) = kernel.step(law, q[lane], v[lane], first[lane]);
            (q[lane], v[lane]) = kernel.step(law, q1, v1, second[lane]);
        }
    }
    if steps % 2 == 1 {
        group.streams.normals(&mut first, &mut second);
        for lane in 0..LANES {
            (q[lane], v[lane]) = kernel.step(law, q[lane], v[lane], first[lane]);
        }
    }
    for lane in 0..LANES {
        v[lane] = kernel.after(law, q[lane], v[lane]);
    }
    (group.q, group.v) = (q, v);
}

/// [`Scheme::Baoab`]. The kicks that end one step and begin the next are made at once.
#[derive(Debug, Clone, Copy)]
pub(super) struct Baoab {
    step: f64,
    half: f64,
    /// exp(-2 zeta step) and sqrt(T (1 - exp(-4 zeta step))).
    decay: f64,
    spread: f64,
}

impl Baoab {
    fn new(oscillator: &Oscillator, step: f64) -> Self {
        let exponent = -2.0 * oscillator.zeta() * step;
        Self {
            step,
            half: 0.5 * step,
            decay: exponent.exp(),
            spread: (oscillator.temperature() * -(2.0 * exponent).exp_m1()).sqrt(),
        }
    }
}

impl Kernel for Baoab {
    #[inline(always)]
    fn before<L: Law>(self, law: L, q: f64, v: f64) -> f64 {
        v - self.half * law.force(q) // B
    }

    #[inline(always)]
    fn step<L: Law>(self, law: L, q: f64, v: f64, normal: f64) -> (f64, f64) {
        let q = q + self.half * v; // A
        let v = self.decay * v + self.spread * normal; // O
        let q = q + self.half * v; // A
        (q, v - self.step * law.force(q)) // B B
    }

    #[inline(always)]
    fn after<L: Law>(self, law: L, q: f64, v: f64) -> f64 {
        v + self.half * law.force(q) // takes back half of the last B B
    }
}

/// The longest step with which `scheme` is trusted: see the docs of the module.
pub(super) fn automatic_step(_scheme: Scheme, oscillator: &Oscillator, frequency: f64) -> f64 {
    0.05 / frequency.max(oscillator.zeta()).max(1.0)
}
