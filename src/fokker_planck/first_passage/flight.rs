//! The law of the time of flight in stationary motion: from a loss of contact to the return.
//!
//! Let a be the force that pulls back, D = pi h, gamma = 2 zeta. A loss has the velocity -w with the density
//! (w/T) exp(-w^2/2T), and the flight is w' = -gamma w - a + sqrt(2D) xi, x' = w, x(0) = 0, until x = 0
//! again with velocity -c. Two closed forms meet:
//! - Without friction and force the joint law of (t, c) is McKean's (J. Math. Kyoto Univ. 2, 1963, 227). By
//!   Girsanov's theorem the drift multiplies it by
//!   exp[(a (c + w) - gamma (c^2 - w^2)/2 - a^2 t/2)/(2D) + gamma t/2] E exp[-gamma^2/(4D) int w^2 dt]:
//!   the integral of w vanishes, as the flight begins and ends at x = 0. The last expectation is that of
//!   the bridge, to first order; its error is that of the second.
//! - The rate of all returns of the unbounded flight, by Rice's formula, counts the later returns too. Those
//!   after a first have a share of about exp(-3 a^2 t/(16 D)): the cost of a flight of length t that ends
//!   slowly.

use crate::damping::mean_decay;
use crate::error::{Error, Result};
use crate::estimate::{Estimate, Origin, Shortfall};
use crate::fokker_planck::adaptive::Stop;
use crate::gaussian::{lower, normal};
use crate::oscillator::Oscillator;
use crate::quadrature;
use rayon::prelude::*;
use std::f64::consts::{PI, SQRT_2, TAU};

/// The density of the time of flight.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightLaw {
    /// Times of flight, equally spaced, the first half a spacing from 0.
    pub times: Vec<f64>,
    /// Density at each.
    pub density: Vec<Estimate>,
}

impl FlightLaw {
    /// What is missing to the tolerance, relative to the largest density.
    pub(crate) fn shortfall(&self, tolerance: f64) -> Option<Shortfall> {
        let most = |f: &dyn Fn(&Estimate) -> f64| self.density.iter().map(f).fold(0.0, f64::max);
        let ratio = most(&|it| it.error) / (tolerance * most(&|it| it.value));
        // A closed form: there is nothing to refine.
        let stop = Stop {
            reason: "its closed form expands in the friction".into(),
            free: false,
        };
        stop.shortfall("crossings.flight_density".into(), ratio, tolerance)
    }
}

/// The fastest loss that is looked at: 4.7 deviations of the velocity, a share of 2e-5 is faster.
pub(super) fn fastest(oscillator: &Oscillator) -> f64 {
    4.7 * oscillator.temperature().sqrt()
}

/// The middles of so many equal parts of what lies between 0 and `last`.
pub(super) fn centres(last: f64, count: usize) -> Vec<f64> {
    let gap = last / count as f64;
    (0..count).map(|k| (k as f64 + 0.5) * gap).collect()
}

/// Points of the curve.
const POINTS: usize = 240;

/// The time of flight of stationary losses: its density, up to the flight of a loss of 4.7 deviations of
/// the velocity (a share of 2e-5 is longer).
///
/// # Errors
/// [`Error::Invalid`] for a contact law that cannot lose contact, or for damping that is not viscous.
pub fn flight_law(oscillator: &Oscillator) -> Result<FlightLaw> {
    let flight = Flight::of(oscillator.with_closed_form()?)?;
    let times = centres(2.0 * fastest(oscillator) / flight.pull, POINTS);
    Ok(FlightLaw {
        density: times.par_iter().map(|t| flight.density(*t)).collect(),
        times,
    })
}

/// Flights of an oscillator.
#[derive(Debug, Clone, Copy)]
pub struct Flight {
    temperature: f64,
    noise: f64,
    friction: f64,
    pull: f64,
}

impl Flight {
    /// The flights after the losses of the stationary motion.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a contact law that cannot lose contact.
    pub fn of(oscillator: &Oscillator) -> Result<Self> {
        let contact = oscillator.contact();
        let loss = contact.loss_for("the time of flight")?;
        if contact.back_wall().is_some() {
            let accepted = "a law without a second wall, for a closed form of the time of flight";
            let name = contact.name();
            return Err(Error::invalid("oscillator.contact", name, accepted));
        }
        Ok(Self {
            temperature: oscillator.temperature(),
            noise: oscillator.noise(),
            friction: 2.0 * oscillator.zeta(),
            pull: -contact.force(loss - 1.0),
        })
    }

    /// The force that pulls back.
    pub(super) fn pull(&self) -> f64 {
        self.pull
    }

    /// Density of the time of flight, by the better of the two closed forms.
    pub fn density(&self, t: f64) -> Estimate {
        let later = self.later(t);
        // Both errors are estimates: that of first returns grows with friction, that of all returns falls.
        if later < 1e-9 {
            let all = self.returns(t);
            return Estimate::new(all.value, all.error + later * all.value, Origin::Quadrature);
        }
        let first = self.first_returns(t);
        let all = self.returns(t);
        // Where its error is a good part of it, the expansion in the friction has no say.
        if later * first.value < first.error {
            Estimate::new(all.value, all.error + later * all.value, Origin::Quadrature)
        } else {
            first
        }
    }

    /// Rate of all returns, first or later, a time t after the loss.
    pub fn returns(&self, t: f64) -> Estimate {
        self.returning(t, |mean, spread| {
            let z = mean / spread;
            spread * (normal(z) + z * lower(z))
        })
    }

    /// The integral over returns, first or later, a time t after the loss, of a function of the mean speed and its spread.
    fn returning(&self, t: f64, of_speed: impl Fn(f64, f64) -> f64) -> Estimate {
        let free = Free::of(self, t);
        let rate = |w: f64| {
            let (x, mean) = free.at(w);
            let there = (-0.5 * x * x / free.var_x).exp() / (TAU * free.var_x).sqrt();
            self.rayleigh(w) * of_speed(mean, free.spread) * there
        };
        quadrature::integrate(rate, &around(free.centre, free.width), 1e-10)
    }

    /// What later returns add to a density of first ones, over it, at most.
    fn later(&self, t: f64) -> f64 {
        10.0 * (-3.0 * self.pull.powi(2) * t / (16.0 * self.noise)).exp()
    }

    /// Density of the first return, by McKean's law and Girsanov's theorem.
    pub fn first_returns(&self, t: f64) -> Estimate {
        // Velocities in units of sqrt(2D).
        let pull = self.pull / self.unit();
        let breaks = around(0.5 * pull * t, 0.6 * t.sqrt());
        let total = |doubt: bool, relative: f64| {
            let outer = |w: f64| {
                quadrature::integrate(|c| self.mckean(t, [w, c], doubt), &breaks, 0.1 * relative)
                    .value
            };
            quadrature::integrate(outer, &breaks, relative)
        };
        expanded(&total)
    }

    /// The unit of velocities, sqrt(2D).
    fn unit(&self) -> f64 {
        (2.0 * self.noise).sqrt()
    }

    /// Density of a loss with the speed w and a first return with the speed c, in units of sqrt(2D), after a time t; with
    /// `doubt` what its expansion in the friction leaves out.
    fn mckean(&self, t: f64, [w, c]: [f64; 2], doubt: bool) -> f64 {
        let unit = self.unit();
        let (pull, friction) = (self.pull / unit, self.friction);
        let half = 0.5 * friction * friction;
        let spread = t * t / 15.0;
        // Mean of the bridge: w - (c + w) u + 3 (c - w) u (1 - u), squared and integrated.
        let (s, d) = (c + w, 3.0 * (c - w));
        let square = t
            * (w * w - w * s + s * s / 3.0 + d * d / 30.0 + 2.0 * w * d / 6.0 - 2.0 * s * d / 12.0);
        let bridge = half * (square + spread);
        let second = half * half * 4.0 * square * spread + half * spread;
        let exponent = -2.0 * (c * c - c * w + w * w) / t + pull * (c + w)
            - 0.5 * friction * (c * c - w * w)
            + 0.5 * friction * t
            - 0.5 * pull * pull * t
            - bridge;
        let start = w * unit * unit / self.temperature
            * (-0.5 * w * w * unit * unit / self.temperature).exp();
        let root = (6.0 * c * w / t).sqrt();
        let mckean = 3.0 * c / (PI * SQRT_2 * t * t) * (2.0f64 / 3.0).sqrt() * libm::erf(root);
        start * mckean * exponent.exp() * if doubt { second } else { 1.0 }
    }

    /// Joint density of the time of flight t and of the speed c at the return, by the better of the two closed forms.
    /// Their marginals are [`Flight::density`] and the law of Rayleigh: returns are losses seen backwards in time.
    pub fn joint(&self, t: f64, c: f64) -> Estimate {
        let later = self.later(t);
        let all = self.returns_at(t, c);
        // What later returns there are has any speed.
        let all = Estimate::new(
            all.value,
            all.error + later * self.rayleigh(c) / t,
            Origin::Quadrature,
        );
        if later < 1e-9 {
            return all;
        }
        let unit = self.unit();
        let breaks = around(0.5 * self.pull / unit * t, 0.6 * t.sqrt());
        let total = |doubt: bool, relative: f64| {
            let it = |w: f64| self.mckean(t, [w, c / unit], doubt) / unit;
            quadrature::integrate(it, &breaks, relative)
        };
        let first = expanded(&total);
        if all.error < first.error { all } else { first }
    }

    /// Density of the speed at a loss, and at a return: c/T exp(-c^2/2T).
    pub fn rayleigh(&self, c: f64) -> f64 {
        c / self.temperature * (-0.5 * c * c / self.temperature).exp()
    }

    /// Rate of all returns, first or later, with the speed c a time t after the loss.
    fn returns_at(&self, t: f64, c: f64) -> Estimate {
        self.returning(t, |mean, spread| c * normal((c - mean) / spread) / spread)
    }
}

/// The unbounded flight after a time: Gaussian in x and its velocity, given the speed w of the loss.
#[derive(Debug, Clone, Copy)]
struct Free {
    /// t times the mean of exp(-gamma s), and pull times the integral of that.
    once: f64,
    fallen: f64,
    /// exp(-gamma t).
    left: f64,
    pulled: f64,
    var_x: f64,
    /// Regression of the velocity on x, and what it leaves of its deviation.
    slope: f64,
    spread: f64,
    /// The speed w that comes back to x = 0, and its width.
    centre: f64,
    width: f64,
}

impl Free {
    fn of(flight: &Flight, t: f64) -> Self {
        let g = flight.friction * t;
        let once = t * mean_decay(g);
        let twice = t * t * two_less(g);
        let var_w = 2.0 * flight.noise * t * mean_decay(2.0 * g);
        let cov = flight.noise * once * once;
        let var_x = 2.0 * flight.noise * t.powi(3) * third(g);
        let slope = cov / var_x;
        Self {
            once,
            fallen: flight.pull * twice,
            left: (-g).exp(),
            pulled: flight.pull * once,
            var_x,
            slope,
            spread: (var_w - cov * slope).max(0.0).sqrt(),
            centre: flight.pull * twice / once,
            width: var_x.sqrt() / once,
        }
    }

    /// Mean of x, and of the speed of the return given that x = 0, after a loss with the speed w.
    fn at(&self, w: f64) -> (f64, f64) {
        let x = w * self.once - self.fallen;
        (x, -(w * self.left - self.pulled - self.slope * x))
    }
}

/// The integral of an expansion in the friction, with that of what it leaves out as its error: to 1e-8, or to a hundredth of
/// that error.
fn expanded(total: &dyn Fn(bool, f64) -> Estimate) -> Estimate {
    const ROUGH: f64 = 1e-3;
    let (rough, second) = (total(false, ROUGH), total(true, ROUGH).value);
    let relative = (0.01 * second / rough.value).max(1e-8);
    let value = if relative < ROUGH {
        total(false, relative)
    } else {
        rough
    };
    Estimate::new(value.value, 2.0 * value.error + second, Origin::Quadrature)
}

/// Breaks about a peak on the positive axis.
fn around(centre: f64, width: f64) -> Vec<f64> {
    let mut breaks: Vec<f64> = [-9.0, -5.0, -2.5, 0.0, 2.5, 5.0, 9.0]
        .iter()
        .map(|k| (centre + k * width).max(0.0))
        .collect();
    breaks.dedup();
    breaks
}

/// (g - 1 + e^-g)/g^2.
fn two_less(g: f64) -> f64 {
    if g < 0.05 {
        0.5 - g / 6.0 + g * g / 24.0 - g.powi(3) / 120.0 + g.powi(4) / 720.0
    } else {
        (g + (-g).exp_m1()) / (g * g)
    }
}

/// (2g - 3 + 4 e^-g - e^-2g)/(2 g^3): 1/3 at 0.
fn third(g: f64) -> f64 {
    if g < 0.1 {
        // sum over k >= 3 of (-g)^(k-3) (2^k - 4)/(2 k!).
        let (mut sum, mut factor, mut power) = (0.0, 1.0 / 6.0, 8.0);
        for k in 3..16 {
            sum += factor * (power - 4.0) * 0.5;
            factor *= -g / f64::from(k + 1);
            power *= 2.0;
        }
        sum
    } else {
        (2.0 * g - 3.0 + 4.0 * (-g).exp() - (-2.0 * g).exp()) / (2.0 * g.powi(3))
    }
}
