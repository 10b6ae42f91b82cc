//! How a point begins to spread: the linear oscillator about it.

use super::frame::Frame;
use crate::fokker_planck::forcing::Forcing;
use crate::noise_free;
use crate::oscillator::Oscillator;
use crate::quadrature::kronrod;
use std::sync::Arc;

/// q'' + c q' + k q = -G(0) + sqrt(2 pi h) noise, c = 2 zeta and k = G' at the point: the oscillator about q = 0.
#[derive(Debug, Clone)]
pub(super) struct Linear {
    zeta: f64,
    stiffness: f64,
    drive: f64,
    noise: f64,
    /// The oscillator with what there is beside stationary noise.
    pub(super) forced: Option<(Oscillator, Arc<Forcing>)>,
}

impl Linear {
    pub(super) fn of(oscillator: &Oscillator) -> Self {
        Self {
            zeta: 0.5 * oscillator.friction(0.0),
            stiffness: oscillator.contact().stiffness(0.0),
            drive: -oscillator.contact().force(0.0),
            noise: oscillator.noise(),
            forced: None,
        }
    }

    /// Takes the friction and the stiffness of a point elsewhere.
    pub(super) fn moved(&mut self, oscillator: &Oscillator, q: f64) {
        self.zeta = 0.5 * oscillator.friction(q);
        self.stiffness = oscillator.contact().stiffness(q);
    }

    /// The Gaussian a short time t after the point (q, v) at time `begin`: its mean is the motion without noise.
    pub(super) fn forced_after(&self, point: [f64; 2], begin: f64, t: f64) -> Frame {
        let Some((oscillator, forcing)) = &self.forced else {
            return self.after(t);
        };
        let excitation = forcing.excitation();
        let mean = noise_free::motion(oscillator, excitation, point, [begin, begin + t]);
        let mut covariance = [[0.0; 2]; 2];
        for (z, w) in kronrod() {
            let s = 0.5 * t * (1.0 + z);
            let x = self.kick(s);
            let noise = self.noise * excitation.factor(begin + t - s);
            for i in 0..2 {
                for j in 0..2 {
                    covariance[i][j] += t * w * noise * x[i] * x[j];
                }
            }
        }
        Frame::of(mean, covariance)
    }

    /// (q, v) a time s after a kick of v from 0 to 1.
    fn kick(&self, s: f64) -> [f64; 2] {
        let squared = self.zeta * self.zeta - self.stiffness;
        let w = squared.abs().sqrt();
        let (sine, cosine) = if w * s < 1e-6 {
            (s, 1.0)
        } else if squared > 0.0 {
            ((w * s).sinh() / w, (w * s).cosh())
        } else {
            ((w * s).sin() / w, (w * s).cos())
        };
        let decay = (-self.zeta * s).exp();
        [decay * sine, decay * (cosine - self.zeta * sine)]
    }

    /// The Gaussian a short time t after q = v = 0: integrals of the kick and its products, by quadrature.
    pub(super) fn after(&self, t: f64) -> Frame {
        let (mut mean, mut covariance) = ([0.0; 2], [[0.0; 2]; 2]);
        for (z, w) in kronrod() {
            let x = self.kick(0.5 * t * (1.0 + z));
            let w = 0.5 * t * w;
            for i in 0..2 {
                mean[i] += w * self.drive * x[i];
                for j in 0..2 {
                    covariance[i][j] += 2.0 * self.noise * w * x[i] * x[j];
                }
            }
        }
        Frame::of(mean, covariance)
    }
}
