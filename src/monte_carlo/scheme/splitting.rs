//! Splittings of (4,2) and (6,2): the exact motion, and friction with noise between.

use super::friction::{Local, ornstein_uhlenbeck};
use super::kernel::Group;
use crate::excitation::Excitation;
use crate::monte_carlo::events::{PATIENCE, Watch};
use crate::monte_carlo::hamiltonian::Flow;
use crate::monte_carlo::law::Law;
use crate::monte_carlo::noise::LANES;
use crate::oscillator::Oscillator;

/// [`Scheme::Splitting42`] and [`Scheme::Splitting62`] with `STAGES` Ornstein-Uhlenbeck steps. The
/// motions that end one step and begin the next are made at once.
#[derive(Debug, Clone, Copy)]
pub(in crate::monte_carlo) struct Splitting<const STAGES: usize> {
    pub(super) first: Flow,
    pub(super) inner: Flow,
    pub(super) joint: Flow,
    /// Decay and spread of each Ornstein-Uhlenbeck step.
    pub(super) friction: [(f64, f64); STAGES],
    /// What a force of 1 does to v in each of them.
    pub(super) impulse: [f64; STAGES],
    /// The same where the rate depends on the displacement.
    pub(super) local: [Local; STAGES],
}

/// What each Ornstein-Uhlenbeck step of a splitting adds beside stationary noise, time frozen within it.
trait Push {
    /// Whether there is anything.
    const PUSHES: bool;
    /// The force and the factor on the spread of the noise.
    fn at(&self, t: f64) -> (f64, f64);
}

/// Nothing.
struct Still;

impl Push for Still {
    const PUSHES: bool = false;
    #[inline(always)]
    fn at(&self, _: f64) -> (f64, f64) {
        (0.0, 1.0)
    }
}

impl Push for Excitation {
    const PUSHES: bool = true;
    #[inline(always)]
    fn at(&self, t: f64) -> (f64, f64) {
        (self.force(t), self.factor(t).sqrt())
    }
}

impl<const STAGES: usize> Splitting<STAGES> {
    pub(super) fn new(
        oscillator: &Oscillator,
        step: f64,
        frequency: f64,
        motions: [f64; 3],
        weights: [f64; STAGES],
    ) -> Self {
        let [first, inner, joint] = motions.map(|c| Flow::new(c * step, frequency));
        Self {
            first,
            inner,
            joint,
            friction: weights.map(|w| ornstein_uhlenbeck(oscillator, w * step)),
            impulse: weights.map(|w| {
                let friction = 2.0 * oscillator.zeta();
                -(-friction * w * step).exp_m1() / friction
            }),
            local: weights.map(|w| Local::new(oscillator, w * step)),
        }
    }

    #[inline(always)]
    pub(super) fn advance<L: Law, W: Watch>(
        self,
        law: L,
        group: &mut Group,
        steps: u64,
        now: f64,
        watch: &mut W,
    ) {
        match group.push.clone() {
            None => self.pushed(law, group, (steps, now), &Still, watch),
            Some(it) => self.pushed(law, group, (steps, now), &*it, watch),
        }
    }

    #[inline(always)]
    fn pushed<L: Law, P: Push, W: Watch>(
        self,
        law: L,
        group: &mut Group,
        (steps, now): (u64, f64),
        push: &P,
        watch: &mut W,
    ) {
        if steps == 0 {
            return;
        }
        let (mut q, mut v, mut force) = (group.q, group.v, [0.0; LANES]);
        for lane in 0..LANES {
            force[lane] = law.force(q[lane]);
        }
        let mut streams = group.streams.clone();
        let (mut normal, mut spare) = ([0.0; LANES], [0.0; LANES]);
        let (mut now, mut have_spare) = (now, false);
        let mut flow = self.first;
        for step in 0..steps {
            if step % PATIENCE == PATIENCE - 1 && watch.late() {
                break;
            }
            for (stage, (decay, spread)) in self.friction.into_iter().enumerate() {
                flow.advance(law, (&mut q, &mut v, &mut force), now, watch); // H
                now += flow.time();
                if have_spare {
                    normal = spare;
                } else {
                    streams.normals(&mut normal, &mut spare);
                }
                have_spare = !have_spare;
                if !L::VISCOUS {
                    for lane in 0..LANES {
                        let (decay, spread) = self.local[stage].at(law.friction(q[lane]));
                        v[lane] = decay * v[lane] + spread * normal[lane];
                    }
                } else if P::PUSHES {
                    let (force, factor) = push.at(now);
                    let (shift, spread) = (force * self.impulse[stage], factor * spread);
                    for lane in 0..LANES {
                        v[lane] = decay * v[lane] + spread * normal[lane] + shift; // O with the drive
                    }
                } else {
                    for lane in 0..LANES {
                        v[lane] = decay * v[lane] + spread * normal[lane]; // O
                    }
                }
                flow = if stage + 1 < STAGES {
                    self.inner
                } else if step + 1 < steps {
                    self.joint
                } else {
                    self.first
                };
            }
        }
        self.first
            .advance(law, (&mut q, &mut v, &mut force), now, watch); // H
        (group.q, group.v, group.streams) = (q, v, streams);
    }
}
