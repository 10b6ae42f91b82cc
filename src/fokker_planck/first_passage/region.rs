//! Where a motion survives: beyond a level, or between two, in coordinates in which it is lost downwards.
//!
//! A passage upwards is one downwards in x = -q, and so is everything that the motion needs of the oscillator.

use crate::damping::Damping;
use crate::error::Result;
use crate::first_step;
use crate::fokker_planck::solved::Law;
use crate::fokker_planck::trajectory::Motion;
use crate::initial::Initial;
use crate::oscillator::{DisplacementLaw, Oscillator, Side, Target};

/// Levels at which a motion is absorbed, in x = sign q.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Barrier {
    /// 1, or -1 for a passage upwards.
    sign: f64,
    /// Absorbed going down through it.
    pub(crate) low: f64,
    /// Absorbed going up through it, if there is one.
    pub(crate) high: Option<f64>,
}

impl Barrier {
    /// Those of a target that motions survive in `range` of.
    pub(super) fn of(target: Target, [low, high]: [f64; 2]) -> Self {
        match target {
            Target::Level(_, Side::Above) => Self {
                sign: -1.0,
                low: -high,
                high: None,
            },
            _ => Self {
                sign: 1.0,
                low,
                high: Some(high).filter(|it| it.is_finite()),
            },
        }
    }

    /// Whether a motion at q has passed none of them.
    fn holds(&self, q: f64) -> bool {
        let x = self.sign * q;
        x > self.low && self.high.is_none_or(|high| x < high)
    }

    /// What moves up to these levels: friction in contact alone is viscous where there is no flight.
    pub(super) fn inside(&self, oscillator: &Oscillator) -> Result<Oscillator> {
        let loss = oscillator.contact().loss_point();
        let in_contact = loss.is_none_or(|loss| self.sign > 0.0 && self.low >= loss);
        let it = oscillator.clone();
        match oscillator.damping() {
            Damping::Contact if in_contact => it.with_damping(Damping::Viscous),
            _ => Ok(it),
        }
    }
}

/// An oscillator as seen from where its motion survives.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Region<'a> {
    pub(crate) oscillator: &'a Oscillator,
    pub(crate) barrier: Barrier,
}

impl<'a> Region<'a> {
    pub(crate) fn new(oscillator: &'a Oscillator, barrier: Barrier) -> Self {
        Self {
            oscillator,
            barrier,
        }
    }

    /// The same seen from the upper level, which is then the lower one.
    pub(crate) fn mirrored(self, high: f64) -> Self {
        let barrier = Barrier {
            sign: -self.barrier.sign,
            low: -high,
            high: None,
        };
        Self { barrier, ..self }
    }

    /// Whether what leaves is known by detailed balance: one level that the force pulls away from, and exp(-H/T)/Z.
    pub(crate) fn balances(&self) -> bool {
        let Barrier { low, high, .. } = self.barrier;
        high.is_none() && self.force(low) < 0.0 && self.oscillator.is_viscous()
    }

    /// Whether it has all q below its level.
    pub(super) fn is_open_below(&self) -> bool {
        self.barrier.sign < 0.0 && self.barrier.high.is_none()
    }

    /// Displacement at x.
    pub(crate) fn q(&self, x: f64) -> f64 {
        self.barrier.sign * x
    }

    /// Minus the acceleration at x.
    pub(crate) fn force(&self, x: f64) -> f64 {
        self.barrier.sign * self.oscillator.contact().force(self.q(x))
    }

    /// What noise decides of within a first step: [`first_step::undecided`].
    pub(super) fn undecided(&self, initial: &Initial, step: f64) -> f64 {
        let Barrier { low, high, .. } = self.barrier;
        let range = self.range(low, high.unwrap_or(f64::INFINITY));
        first_step::undecided(initial, self.oscillator, range, step)
    }

    /// What pushes q by so much pushes x by this.
    pub(crate) fn seen_force(&self, push: f64) -> f64 {
        self.barrier.sign * push
    }

    /// U at x.
    pub(crate) fn potential(&self, x: f64) -> f64 {
        self.oscillator.contact().potential(self.q(x))
    }

    /// The same above the lowest.
    pub(crate) fn height(&self, x: f64) -> f64 {
        let lowest = self.oscillator.contact().lowest_potential();
        self.potential(x) - lowest.unwrap_or(0.0)
    }

    /// The same at the higher of the levels.
    pub(crate) fn rise(&self) -> f64 {
        let low = self.height(self.barrier.low);
        self.barrier
            .high
            .map_or(low, |high| low.max(self.height(high)))
    }

    /// Walls where flight begins and ends.
    fn walls(&self) -> impl Iterator<Item = f64> {
        let ends = self.oscillator.contact().flight().into_iter().flatten();
        ends.filter(|q| q.is_finite())
    }

    /// The rate of friction above a wall less that below it.
    fn jump(&self, wall: f64) -> f64 {
        /// How close to a wall it shows.
        const BESIDE: f64 = 1e-9;
        let it = self.oscillator;
        it.friction(wall + BESIDE) - it.friction(wall - BESIDE)
    }

    /// Where the force or its slope jumps.
    pub(super) fn kinks(&self) -> impl Iterator<Item = f64> {
        let kinks = self.oscillator.contact().kinks().into_iter();
        kinks.map(|q| self.barrier.sign * q)
    }

    /// Rate of friction about (x, v) in steps of this length. Where it jumps, at a wall, it is the mean over the motion through x
    /// with velocity v, half a step before and after: at x alone it would jump from node to node, and no mesh would be fine
    /// enough.
    pub(super) fn friction_about(&self, x: f64, v: f64, step: f64) -> f64 {
        let q = self.q(x);
        let rate = self.oscillator.friction(q);
        if self.oscillator.is_viscous() {
            return rate;
        }
        let parts = self.walls().map(|wall| {
            let r = (q - wall) / (0.5 * step * v.abs());
            if r.abs() >= 1.0 || r.is_nan() {
                return 0.0;
            }
            // What is on the other side.
            let other = 0.5 * (1.0 - r.abs());
            self.jump(wall) * if r < 0.0 { other } else { -other }
        });
        rate + parts.sum::<f64>()
    }

    /// p_q of the reference law at x.
    pub(crate) fn density(&self, law: &DisplacementLaw, x: f64) -> f64 {
        law.density(self.q(x))
    }

    /// Where the motion that survives may rest, and between: the q of its minima of U and of the maxima among them.
    pub(crate) fn equilibria(&self) -> impl Iterator<Item = f64> {
        let all = self.oscillator.contact().equilibria().into_iter();
        let barrier = self.barrier;
        all.filter(move |q| barrier.holds(*q))
    }

    /// A law that is solved for, at one x and many velocities.
    pub(crate) fn along(&self, law: &Law, x: f64, velocities: &[f64]) -> Vec<f64> {
        let seen: Vec<f64> = velocities.iter().map(|v| self.barrier.sign * v).collect();
        law.along(self.q(x), &seen)
    }

    /// The higher turning point of an energy above the lowest.
    pub(crate) fn turning_point(&self, rise: f64) -> Option<f64> {
        let (left, right) = self.oscillator.contact().turning_points(rise)?;
        Some(if self.barrier.sign > 0.0 {
            right
        } else {
            -left
        })
    }

    /// Where starts (x, v) are after a time.
    pub(crate) fn after(&self, starts: &[[f64; 2]], times: &[f64], ends: &mut [[f64; 2]]) {
        let motion = Motion::new(self.oscillator.contact());
        if self.barrier.sign > 0.0 {
            return motion.after(starts, times, ends);
        }
        let starts: Vec<[f64; 2]> = starts.iter().map(|[x, v]| [-x, -v]).collect();
        motion.after(&starts, times, ends);
        for [x, v] in &mut ends[..starts.len() * times.len()] {
            (*x, *v) = (-*x, -*v);
        }
    }

    /// Where each start is after a time.
    pub(super) fn ends(&self, starts: &[[f64; 2]], time: f64) -> Vec<[f64; 2]> {
        let mut ends = vec![[0.0; 2]; starts.len()];
        self.after(starts, &[time], &mut ends);
        ends
    }

    /// A range of x as one of q.
    pub(crate) fn range(&self, low: f64, high: f64) -> [f64; 2] {
        let (a, b) = (self.q(low), self.q(high));
        [a.min(b), a.max(b)]
    }

    /// An initial condition, its mean in x.
    pub(crate) fn seen(&self, initial: &Initial) -> Initial {
        match *initial {
            Initial::Gaussian { mean, deviation } => Initial::Gaussian {
                mean: mean.map(|it| self.barrier.sign * it),
                deviation,
            },
            other => other,
        }
    }
}
