//! The Fokker-Planck equation (17) in the frame of a narrow density, by Hermite functions in both directions:
//! what an initial condition of which no fixed basis resolves much becomes while it stays near a Gaussian. Used to make
//! reference solutions.
//!
//! q = m_q + a xi, v = m_v + b xi + c eta, and P(xi, eta) = phi(xi) phi(eta) sum_jk C_jk h_j(xi) h_k(eta), h the
//! normalised Hermite polynomials. With G = g_0 + g_1 a xi + R(xi), D = pi h,
//!
//! ```text
//! m_q' = m_v,  m_v' = -2 zeta m_v - g_0 + F,  a' = b,  b' = -2 zeta b - g_1 a + c^2/a,
//! c'/c = -2 zeta - b/a + k - s,  k = D/c^2
//! P_t = -(c/a) (eta d_xi - xi d_eta) P + d_eta((k - s) eta + R/c) P + k d_eta^2 P
//! ```
//!
//! g_0, g_1 and s are such that mean and covariance of the density are those of the frame (statistical
//! linearisation). The force enters by quadrature, nothing is expanded in it. Noise and drive F may change with time; damping
//! is viscous.

use std::f64::consts::TAU;
use vibroimpact::contact::ContactLaw;
use vibroimpact::excitation::Excitation;
use vibroimpact::initial::Initial;
use vibroimpact::moments::{Moments, RawMoments};
use vibroimpact::oscillator::Oscillator;

pub(crate) struct Moving {
    contact: ContactLaw,
    zeta: f64,
    diffusion: f64,
    excitation: Excitation,
    /// Hermite functions in either direction.
    n: usize,
    /// Nodes of the trapezoidal rule with the Gaussian in their weights, and h_j there, nodes by n.
    nodes: Vec<f64>,
    weights: Vec<f64>,
    basis: Vec<f64>,
    /// m_q, m_v, a, b, c, then C by rows of j.
    state: Vec<f64>,
    time: f64,
}

/// When a point at rest is taken for the Gaussian that white noise alone makes of it: damping and stiffness have
/// then changed it by a part of this.
const EARLY: f64 = 1e-6;

impl Moving {
    pub(crate) fn new(
        oscillator: &Oscillator,
        excitation: &Excitation,
        initial: &Initial,
        n: usize,
    ) -> Self {
        let force = excitation.drive.map_or(0.0, |it| it.force(0.0));
        let diffusion = oscillator.noise();
        let mut state = vec![0.0; 5 + n * n];
        state[5] = 1.0;
        let time = match *initial {
            Initial::Gaussian { mean, deviation } => {
                state[..5].copy_from_slice(&[mean[0], mean[1], deviation[0], 0.0, deviation[1]]);
                0.0
            }
            _ => {
                let t = EARLY;
                let diffusion = diffusion * factor(excitation, 0.0);
                let a = (2.0 / 3.0 * diffusion * t.powi(3)).sqrt();
                state[0] = 0.5 * force * t * t;
                state[1] = force * t;
                state[2] = a;
                state[3] = diffusion * t * t / a;
                state[4] = (0.5 * diffusion * t).sqrt();
                t
            }
        };
        let (reach, step) = (11.0, 0.8 / n as f64);
        let count = (reach / step) as i32;
        let nodes: Vec<f64> = (-count..=count).map(|k| step * f64::from(k)).collect();
        let normal = |x: f64| step * (-0.5 * x * x).exp() / TAU.sqrt();
        let weights = nodes.iter().map(|x| normal(*x)).collect();
        let mut basis = Vec::with_capacity(nodes.len() * n);
        for x in &nodes {
            let (mut before, mut now) = (0.0, 1.0);
            for j in 0..n {
                basis.push(now);
                let j = j as f64;
                let next = (x * now - j.sqrt() * before) / (j + 1.0).sqrt();
                (before, now) = (now, next);
            }
        }
        Self {
            contact: oscillator.contact().clone(),
            zeta: oscillator.zeta(),
            diffusion,
            excitation: excitation.clone(),
            n,
            nodes,
            weights,
            basis,
            state,
            time,
        }
    }

    /// Comes to time t.
    pub(crate) fn advance(&mut self, t: f64) {
        let envelope = self.excitation.envelope.as_ref();
        let bends = envelope.map_or(Vec::new(), |it| it.times().to_vec());
        while self.time < t {
            let [a, c] = [self.state[2], self.state[4]];
            let diffusion = self.diffusion * factor(&self.excitation, self.time);
            let fastest = self.n as f64 * (diffusion / (c * c) + c / a) + 10.0;
            let later = |bend: &f64| *bend > self.time * (1.0 + 1e-12);
            let end = bends.iter().copied().filter(later).fold(t, f64::min);
            let step = (0.5 / fastest).min(end - self.time);
            if !(step > 1e-15 * t && self.state[5].is_finite()) {
                self.state.fill(f64::NAN);
                return;
            }
            let shifted = |by: f64, rate: &[f64]| -> Vec<f64> {
                let pairs = self.state.iter().zip(rate);
                pairs.map(|(x, r)| x + by * r).collect()
            };
            let half = self.time + 0.5 * step;
            let k1 = self.rate(self.time, &self.state);
            let k2 = self.rate(half, &shifted(0.5 * step, &k1));
            let k3 = self.rate(half, &shifted(0.5 * step, &k2));
            let k4 = self.rate(self.time + step, &shifted(step, &k3));
            for (i, x) in self.state.iter_mut().enumerate() {
                *x += step / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
            }
            self.time = if step == end - self.time {
                end
            } else {
                self.time + step
            };
        }
    }

    fn rate(&self, time: f64, state: &[f64]) -> Vec<f64> {
        let n = self.n;
        let [mq, mv, a, b, c] = [state[0], state[1], state[2], state[3], state[4]];
        let p = &state[5..];
        let at = |j: usize, k: usize| p[j * n + k];
        let nodes = || {
            self.nodes
                .iter()
                .zip(&self.weights)
                .zip(self.basis.chunks_exact(n))
        };
        // E G and E G xi.
        let (mut g0, mut g1) = (0.0, 0.0);
        for ((x, w), h) in nodes() {
            let density: f64 = (0..n).map(|j| at(j, 0) * h[j]).sum();
            let force = self.contact.force(mq + a * x) * w * density;
            g0 += force;
            g1 += force * x;
        }
        let mut matrix = vec![0.0; n * n];
        for ((x, w), h) in nodes() {
            let rest = w * (self.contact.force(mq + a * x) - g0 - g1 * x);
            for j in 0..n {
                let scaled = rest * h[j];
                for (m, h) in matrix[j * n..=j * n + j].iter_mut().zip(h) {
                    *m += scaled * h;
                }
            }
        }
        let r = |i: usize, j: usize| matrix[i.max(j) * n + i.min(j)];
        let s = (0..n).map(|j| r(0, j) * at(j, 1)).sum::<f64>() / c;
        let k = self.diffusion * factor(&self.excitation, time) / (c * c);
        let force = self.excitation.drive.map_or(0.0, |it| it.force(time));
        let friction = 2.0 * self.zeta;
        let mut out = vec![0.0; state.len()];
        out[0] = mv;
        out[1] = -friction * mv - g0 + force;
        out[2] = b;
        out[3] = -friction * b - g1 + c * c / a;
        out[4] = c * (-friction - b / a + k - s);
        let turn = c / a;
        for i in 0..n {
            for l in 0..n {
                let (x, y) = (i as f64, l as f64);
                let mut sum = (s - k) * y * at(i, l);
                if l > 0 && i + 1 < n {
                    sum -= turn * ((x + 1.0) * y).sqrt() * at(i + 1, l - 1);
                }
                if i > 0 && l + 1 < n {
                    sum += turn * (x * (y + 1.0)).sqrt() * at(i - 1, l + 1);
                }
                if l > 1 {
                    sum += s * (y * (y - 1.0)).sqrt() * at(i, l - 2);
                }
                if l > 0 {
                    let forced: f64 = (0..n).map(|j| r(i, j) * at(j, l - 1)).sum();
                    sum -= y.sqrt() * forced / c;
                }
                out[5 + i * n + l] = sum;
            }
        }
        out
    }

    /// The moments, taken about the mean of the frame.
    pub(crate) fn moments(&self) -> Moments {
        let n = self.n;
        let [mq, mv, a, b, c] = [0, 1, 2, 3, 4].map(|k| self.state[k]);
        let at = |j: usize, k: usize| self.state[5 + j * n + k];
        let (x, y) = (at(1, 0), at(0, 1));
        let root = 2f64.sqrt();
        let (xx, yy, xy) = (1.0 + root * at(2, 0), 1.0 + root * at(0, 2), at(1, 1));
        let mut raw = RawMoments {
            q: a * x,
            qq: a * a * xx,
            v: b * x + c * y,
            vv: b * b * xx + 2.0 * b * c * xy + c * c * yy,
            qv: a * b * xx + a * c * xy,
            ..RawMoments::default()
        };
        let (n0, u0) = (self.contact.force(mq), self.contact.potential(mq));
        for ((x, w), h) in self
            .nodes
            .iter()
            .zip(&self.weights)
            .zip(self.basis.chunks_exact(n))
        {
            let p = w * (0..n).map(|j| at(j, 0) * h[j]).sum::<f64>();
            let q = mq + a * x;
            raw.mass += p;
            let mut power = p;
            for sum in &mut raw.force {
                power *= self.contact.force(q) - n0;
                *sum += power;
            }
            raw.potential += p * (self.contact.potential(q) - u0);
            raw.lost += if self.contact.is_lost(q) { p } else { 0.0 };
        }
        let mut moments = raw.moments(&self.contact);
        moments.mean_energy.value += u0 + mv * moments.mean_v.value + 0.5 * mv * mv;
        moments.mean_q.value += mq;
        moments.mean_v.value += mv;
        moments.mean_force.value += n0;
        moments
    }
}

/// The factor of the envelope on the noise.
fn factor(excitation: &Excitation, t: f64) -> f64 {
    let envelope = excitation.envelope.as_ref();
    envelope.map_or(1.0, |it| it.factor(t))
}
