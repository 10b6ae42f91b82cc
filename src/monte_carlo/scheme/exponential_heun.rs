//! Friction and noise exactly, the force held straight over a step: for strong friction, and for band-limited noise between its
//! samples.

use super::kernel::Group;
use crate::monte_carlo::events::{PATIENCE, Watch};
use crate::monte_carlo::law::Law;
use crate::monte_carlo::noise::LANES;
use crate::oscillator::Oscillator;

/// [`Scheme::ExponentialHeun`]. With c = 2 zeta, d = exp(-c step) and a force g = -G held constant, v goes
/// to d v + f1 g and q to q + f1 v + f2 g, f1 = (1 - d)/c, f2 = (step - f1)/c; a force that rises as
/// t/step adds f2/step and f3 = (step^2/2 - f2)/(c step) times its rise.
#[derive(Debug, Clone, Copy)]
pub(in crate::monte_carlo) struct ExponentialHeun {
    pub(super) decay: f64,
    pub(super) f1: f64,
    f2: f64,
    f2_per_step: f64,
    f3: f64,
    /// Noise of v; noise of q along it and across it.
    pub(super) spread: f64,
    pub(super) along: f64,
    pub(super) across: f64,
}

impl ExponentialHeun {
    pub(super) fn new(oscillator: &Oscillator, step: f64) -> Self {
        let (c, temperature) = (2.0 * oscillator.zeta(), oscillator.temperature());
        let x = c * step;
        // x - (1 - e^-x), then x^2/2 - that, then the variance of q, free of cancellation for small x.
        let rise = if x < 0.1 {
            x * x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x / 720.0))))
        } else {
            x + (-x).exp_m1()
        };
        let second = if x < 0.1 {
            x.powi(3)
                * (1.0 / 6.0
                    - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x * (1.0 / 720.0 - x / 5040.0))))
        } else {
            0.5 * x * x - rise
        };
        let once = -(-x).exp_m1();
        // Given the noise of v, the variance of q is (2 T/c^2)(x - 2 tanh(x/2)).
        let rest = if x < 0.1 {
            x.powi(3) * (1.0 / 12.0 - x * x * (1.0 / 120.0 - x * x * (17.0 / 20160.0)))
        } else {
            x - 2.0 * (0.5 * x).tanh()
        };
        Self {
            decay: (-x).exp(),
            f1: once / c,
            f2: rise / (c * c),
            f2_per_step: rise / (c * x),
            f3: second / (c * c * x),
            spread: (temperature * -(-2.0 * x).exp_m1()).sqrt(),
            along: temperature.sqrt() * once * once / (c * (-(-2.0 * x).exp_m1()).sqrt()),
            across: (2.0 * temperature * rest).sqrt() / c,
        }
    }

    #[inline(always)]
    pub(super) fn advance<L: Law, W: Watch>(
        self,
        law: L,
        group: &mut Group,
        steps: u64,
        watch: &W,
    ) {
        let (mut q, mut v) = (group.q, group.v);
        let mut streams = group.streams.clone();
        let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
        for k in 0..steps {
            if k % PATIENCE == PATIENCE - 1 && watch.late() {
                break;
            }
            streams.normals(&mut first, &mut second);
            for lane in 0..LANES {
                let force = -law.force(q[lane]);
                let drawn = self.along * first[lane] + self.across * second[lane];
                let predicted = q[lane] + self.f1 * v[lane] + self.f2 * force + drawn;
                let rise = -law.force(predicted) - force;
                q[lane] = predicted + self.f3 * rise;
                v[lane] = self.decay * v[lane]
                    + self.f1 * force
                    + self.f2_per_step * rise
                    + self.spread * first[lane];
            }
        }
        (group.q, group.v, group.streams) = (q, v, streams);
    }
}
