//! Splittings of (4,2) and (6,2): the exact motion, and friction with noise between.

use super::friction::Friction;
use super::kernel::Group;
use crate::monte_carlo::events::{PATIENCE, Watch};
use crate::monte_carlo::hamiltonian::Flow;
use crate::monte_carlo::law::Law;
use crate::monte_carlo::noise::LANES;
use crate::oscillator::Oscillator;

/// Ornstein-Uhlenbeck steps at most.
const MOST: usize = 3;

/// [`Scheme::Splitting42`] and [`Scheme::Splitting62`] with `stages` Ornstein-Uhlenbeck steps. The
/// motions that end one step and begin the next are made at once.
#[derive(Debug, Clone, Copy)]
pub(in crate::monte_carlo) struct Splitting {
    pub(super) stages: usize,
    pub(super) first: Flow,
    pub(super) inner: Flow,
    pub(super) joint: Flow,
    /// The Ornstein-Uhlenbeck steps.
    pub(super) friction: [Friction; MOST],
}

impl Splitting {
    pub(super) fn new(
        oscillator: &Oscillator,
        step: f64,
        frequency: f64,
        motions: [f64; 3],
        stages: &[f64],
    ) -> Self {
        let [first, inner, joint] = motions.map(|c| Flow::new(c * step, frequency));
        let weights = std::array::from_fn(|k| stages.get(k).copied().unwrap_or(0.0));
        Self {
            stages: stages.len(),
            first,
            inner,
            joint,
            friction: weights.map(|w: f64| Friction::new(oscillator, w * step)),
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
        if steps == 0 {
            return;
        }
        let (mut q, mut v, mut force) = (group.q, group.v, [0.0; LANES]);
        for lane in 0..LANES {
            force[lane] = law.force(q[lane]);
        }
        // Before time 0 paths are run in to the stationary law.
        let push = group.push.clone().filter(|_| now >= 0.0);
        let mut streams = group.streams.clone();
        let (mut normal, mut spare) = ([0.0; LANES], [0.0; LANES]);
        let (mut now, mut have_spare) = (now, false);
        let mut flow = self.first;
        for step in 0..steps {
            if step % PATIENCE == PATIENCE - 1 && watch.late() {
                break;
            }
            for stage in 0..self.stages {
                flow.advance(law, (&mut q, &mut v, &mut force), now, watch); // H
                now += flow.time();
                if have_spare {
                    normal = spare;
                } else {
                    streams.normals(&mut normal, &mut spare);
                }
                have_spare = !have_spare;
                let friction = self.friction[stage];
                if let Some(push) = &push {
                    // Time stands still within it.
                    let (drive, noise) = (push.force(now), push.factor(now).sqrt());
                    for lane in 0..LANES {
                        let factor = law.friction(q[lane]);
                        let (decay, spread) = friction.at::<L>(factor);
                        let shift = drive * friction.impulse::<L>(factor);
                        v[lane] = decay * v[lane] + noise * spread * normal[lane] + shift; // O with the drive
                    }
                } else {
                    for lane in 0..LANES {
                        let (decay, spread) = friction.at::<L>(law.friction(q[lane]));
                        v[lane] = decay * v[lane] + spread * normal[lane]; // O
                    }
                }
                flow = if stage + 1 < self.stages {
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
