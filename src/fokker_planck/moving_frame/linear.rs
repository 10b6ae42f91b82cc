//! How a point begins to spread: the linear oscillator about it.

use super::frame::Frame;
use crate::excitation::Excitation;
use crate::noise_free;
use crate::oscillator::Oscillator;
use crate::quadrature::kronrod;

/// The Gaussian a short time t after the point (q, v) at time `begin`, by quadrature: its mean is the motion without noise,
/// without an excitation that of the linear oscillator under -G at 0.
pub(super) fn spread(
    oscillator: &Oscillator,
    excitation: Option<&Excitation>,
    point: [f64; 2],
    [begin, t]: [f64; 2],
) -> Frame {
    let linear = Linear::of(oscillator, point[0]);
    let drive = -oscillator.contact().force(0.0);
    let (mut mean, mut covariance) = ([0.0; 2], [[0.0; 2]; 2]);
    for (z, w) in kronrod() {
        let s = 0.5 * t * (1.0 + z);
        let (x, w) = (linear.kick(s), 0.5 * t * w);
        let factor = excitation.map_or(1.0, |it| it.factor(begin + t - s));
        for i in 0..2 {
            mean[i] += w * drive * x[i];
            for j in 0..2 {
                covariance[i][j] += 2.0 * oscillator.noise() * factor * w * x[i] * x[j];
            }
        }
    }
    if let Some(excitation) = excitation {
        mean = noise_free::motion(oscillator, excitation, point, [begin, begin + t]);
    }
    Frame::of(mean, covariance)
}

/// q'' + c q' + k q = sqrt(2 pi h) noise, c = 2 zeta and k = G' at a point.
struct Linear {
    zeta: f64,
    stiffness: f64,
}

impl Linear {
    fn of(oscillator: &Oscillator, q: f64) -> Self {
        Self {
            zeta: 0.5 * oscillator.friction(q),
            stiffness: oscillator.contact().stiffness(q),
        }
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
}
