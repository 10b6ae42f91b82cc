//! A step of a local grid: the undamped motion, and friction with noise, by the composition of order (6,2).
//!
//! In time (6,2), H(c1) O(5/18) H(c2) O(8/18) H(c2) O(5/18) H(c1). Its error zeta^2 tau^2 comes from
//! [O, [O, H]], which is 4 zeta^2 H: friction stretches the two halves of H, v d/dq and G d/dv, by inverse
//! factors, and the terms of friction with noise cancel. So the step only runs the motion at a slightly
//! wrong rate, and durations of H times
//!
//! ```text
//! (sinh x / x) / (2 c1 cosh x + 2 c2 cosh(4x/9)),   x = zeta tau
//! ```
//!
//! take it away.

use super::super::frame::Frame;
use super::LocalGrid;
use crate::fokker_planck::interpolation::{MARGIN, reflected};
use crate::fokker_planck::ornstein_uhlenbeck::{Kick, around, average};
use crate::fokker_planck::trajectory::Motion;
use crate::matrix::grid;

/// Nodes of the three-point Gauss rule are at c1, 1/2, 1 - c1; c2 = 1/2 - c1.
const C1: f64 = 0.112_701_665_379_258_3;
const C2: f64 = 0.5 - C1;
const WEIGHTS: [f64; 3] = [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0];

/// Deviations beyond which a square is widened no more: twice what a Gaussian needs at 1e-5, four times the
/// cells.
const FARTHEST: f64 = 18.0;

/// Gauss-Hermite frame of a standard normal.
const STANDARD: Frame = Frame {
    mean: [0.0; 2],
    lower: [1.0, 0.0, 1.0],
};

impl LocalGrid {
    /// One step of `tau`.
    pub(crate) fn advance(&mut self, tau: f64) {
        // A rate that changes from place to place does not run the motion at one wrong rate.
        let x = if self.oscillator.is_viscous() {
            self.oscillator.zeta() * tau
        } else {
            0.0
        };
        let stretched = if x > 1e-4 {
            x.sinh() / x
        } else {
            1.0 + x * x / 6.0
        };
        let rate = tau * stretched / (2.0 * C1 * x.cosh() + 2.0 * C2 * (4.0 / 9.0 * x).cosh());
        let (start, lead) = (self.time, rate / tau - 1.0);
        let ahead = |t: f64| self.forcing.as_ref().map_or(0.0, |it| it.ahead(t, lead));
        let [first, last] = [start, start + tau].map(ahead);
        if self.forcing.is_some() {
            self.frame.mean[1] -= first;
        }
        for ((gap, weight), node) in [C1, C2, C2]
            .into_iter()
            .zip(WEIGHTS)
            .zip([C1, 0.5, 1.0 - C1])
        {
            self.carry(gap * rate);
            self.spread(start + node * tau, weight * tau, lead);
        }
        self.carry(C1 * rate);
        if self.forcing.is_some() {
            self.frame.mean[1] += last;
        }
        self.time += tau;
        self.steps += 1;
    }

    /// H over `duration`.
    fn carry(&mut self, duration: f64) {
        if self.fineness.reach < FARTHEST && self.border() > self.fineness.border {
            self.widen();
        }
        let motion = Motion::new(self.oscillator.contact());
        let law = self.law();
        let target = self.frame.image(&law, |points| {
            let mut images = [[0.0; 2]; 9];
            motion.after(points, &[duration], &mut images);
            images
        });
        let centres = self.axis.centres();
        for (point, xi) in self.points.iter_mut().zip(grid(centres, centres)) {
            *point = target.at(xi);
        }
        motion.before(&self.points, &[duration], &mut self.origins);
        let ratio = target.area() / self.frame.area();
        self.spline
            .sample(&self.frame, ratio, &self.origins, &mut self.values);
        self.frame = target;
        // What interpolation did to the mass.
        let cell = self.fineness.cell;
        let mass = self.values.iter().sum::<f64>() * cell * cell;
        self.defect += (mass - 1.0).abs();
        for p in &mut self.values {
            *p /= mass;
        }
        self.interpolate();
    }

    /// O over `duration`, time frozen at `t`, in steps with this `lead`. Where friction depends on the displacement, that at
    /// the mean between what it is more elsewhere.
    fn spread(&mut self, t: f64, duration: f64, lead: f64) {
        let oscillator = &self.oscillator;
        let rate = oscillator.friction(self.frame.mean[0]);
        let kick = match &self.forcing {
            Some(it) => it.kick(rate, [t, duration], lead, 0.0),
            None => Kick::new(rate, duration, (oscillator.noise(), 0.0), 0.0),
        };
        if oscillator.is_viscous() {
            return self.spread_by(kick);
        }
        let places = self.axis.centres().iter();
        let places = places.map(|xi| self.frame.at([*xi, 0.0])[0]);
        let more = places.map(|q| around(oscillator.friction(q), rate, duration).into());
        let (before, after): (Vec<f64>, Vec<f64>) = more.unzip();
        self.slow(&before);
        self.spread_by(kick);
        self.slow(&after);
    }

    /// Velocities over e^x, x of each displacement.
    fn slow(&mut self, factors: &[f64]) {
        let n = self.axis.len();
        let centres = self.axis.centres();
        if factors.iter().all(|x| x.abs() < 1e-13) {
            return;
        }
        for ((i, x), xi) in factors.iter().enumerate().zip(centres) {
            let row = i * n..(i + 1) * n;
            for (point, eta) in self.origins[row.clone()].iter_mut().zip(centres) {
                let [q, v] = self.frame.at([*xi, *eta]);
                *point = [q, v * x.exp()];
            }
            let (points, values) = (&self.origins[row.clone()], &mut self.values[row]);
            self.spline.sample(&self.frame, x.exp(), points, values);
        }
        self.interpolate();
    }

    /// O at one rate.
    fn spread_by(&mut self, kick: Kick) {
        let n = self.axis.len();
        let (a, variance) = (kick.decay, kick.variance);
        let [qq, vq, vv] = self.frame.lower;
        let widened = (a * a * vv * vv + variance).sqrt();
        self.frame.mean[1] = a * self.frame.mean[1] + kick.shift;
        self.frame.lower = [qq, a * vq, widened];
        if variance == 0.0 {
            // The frame contracts, and P in it stays.
            return;
        }
        // rho = a L_vv/L_vv' = e^{-rate}.
        let rate = 0.5 * (variance / (a * a * vv * vv)).ln_1p();
        let matrix = average(&self.axis, rate, 1.0, false);
        let width = n + 2 * MARGIN;
        // Coefficients along xi_2 of values along xi_1.
        self.spline.along(true, &self.values, &mut self.other);
        let mut padded = vec![0.0; width];
        for (row, out) in self
            .other
            .chunks_exact(n)
            .zip(self.values.chunks_exact_mut(n))
        {
            for (k, x) in padded.iter_mut().enumerate() {
                *x = row[reflected(k, n)];
            }
            for (y, weights) in out.iter_mut().zip(matrix.chunks_exact(width)) {
                *y = weights.iter().zip(&padded).map(|(w, x)| w * x).sum();
            }
        }
        self.interpolate();
    }

    /// Mean and triangular factor of P in xi.
    fn law(&self) -> Frame {
        let centres = self.axis.centres();
        let mut sums = [0.0; 6];
        for (row, x) in self.values.chunks_exact(centres.len()).zip(centres) {
            for (p, y) in row.iter().zip(centres) {
                for (sum, f) in sums.iter_mut().zip([1.0, *x, *y, x * x, x * y, y * y]) {
                    *sum += p * f;
                }
            }
        }
        let [m, x, y, xx, xy, yy] = sums;
        let (x, y) = (x / m, y / m);
        let covariance = xy / m - x * y;
        let spread = [[xx / m - x * x, covariance], [covariance, yy / m - y * y]];
        let law = Frame::of([x, y], spread);
        // A density that the grid does not resolve has no frame; the mass defect says so.
        if law.lower.iter().all(|l| l.is_finite()) && law.area() > 0.1 {
            law
        } else {
            STANDARD
        }
    }
}
