//! What a local grid tells: its density, sums over it and moments.

use super::LocalGrid;
use crate::fokker_planck::excess::Pair;
use crate::matrix::grid;
use crate::moments::{Moments, RawMoments};
use crate::quadrature::kronrod;

impl LocalGrid {
    /// p at points (q, v); 0 outside the square.
    pub(crate) fn density(&self, points: &[[f64; 2]]) -> Vec<f64> {
        let mut values = vec![0.0; points.len()];
        let scale = 1.0 / self.frame.area();
        self.spline.sample(&self.frame, scale, points, &mut values);
        values
    }

    /// p at the centres of its mesh with their (q, v) and the area of a cell.
    pub(crate) fn sum(&self, f: impl Fn([f64; 2], f64) -> f64) -> f64 {
        let centres = self.axis.centres();
        let area = self.frame.area();
        let cell = self.fineness.cell * self.fineness.cell * area;
        let nodes = grid(centres, centres).zip(&self.values);
        let all = nodes.map(|(xi, p)| f(self.frame.at(xi), p / area));
        all.sum::<f64>() * cell
    }

    /// What it is in L1 from a law p_s: both integrals are 1, so it is twice the positive part of p - p_s, which lies in the square.
    pub(crate) fn distance_to(&self, law: impl Fn([f64; 2]) -> f64) -> f64 {
        let (n, centres) = (self.axis.len(), self.axis.centres());
        let area = self.frame.area();
        let law = grid(centres, centres).map(|xi| area * law(self.frame.at(xi)));
        let law: Vec<f64> = law.collect();
        let pair = Pair::new(&self.values, &law, n);
        let inside = Pair::AROUND..n - Pair::AROUND;
        let row = |i: usize| pair.excess(i * n + inside.start..i * n + inside.end);
        let over: f64 = inside.clone().map(row).sum();
        2.0 * over * self.fineness.cell * self.fineness.cell
    }

    /// Moments, taken about the mean so that those of a narrow density keep their digits. Functions of q are
    /// integrated against the spline of the marginal of xi_1, the loss of contact between two panels.
    pub(crate) fn moments(&self) -> Moments {
        let n = self.axis.len();
        let (cell, [qq, vq, vv]) = (self.fineness.cell, self.frame.lower);
        let centres = self.axis.centres();
        let mut raw = RawMoments::default();
        let mut marginal = vec![0.0; n];
        for ((row, x), total) in self.values.chunks_exact(n).zip(centres).zip(&mut marginal) {
            for (p, y) in row.iter().zip(centres) {
                let (dq, dv) = (qq * x, vq * x + vv * y);
                let p = p * cell * cell;
                *total += p / cell;
                raw.q += p * dq;
                raw.qq += p * dq * dq;
                raw.v += p * dv;
                raw.vv += p * dv * dv;
                raw.qv += p * dq * dv;
            }
        }
        let ([q0, v0], contact) = (self.frame.mean, self.oscillator.contact());
        let (n0, u0) = (contact.force(q0), contact.potential(q0));
        self.along(&marginal, |q, p, lost| {
            raw.mass += p;
            let force = contact.force(q) - n0;
            let mut power = p;
            for sum in &mut raw.force {
                power *= force;
                *sum += power;
            }
            raw.potential += p * (contact.potential(q) - u0);
            raw.lost += if lost { p } else { 0.0 };
        });
        let mut moments = raw.moments(contact);
        // H = v^2/2 + U, from the centred ones.
        moments.mean_energy.value += u0 + v0 * moments.mean_v.value + 0.5 * v0 * v0;
        moments.mean_q.value += q0;
        moments.mean_v.value += v0;
        moments.mean_force.value += n0;
        moments
    }

    /// Calls `f` with (q, weight, whether contact is lost) over a rule for the spline of a marginal.
    fn along(&self, marginal: &[f64], mut f: impl FnMut(f64, f64, bool)) {
        let centres = self.axis.centres();
        let curve = self.spline.curve(marginal);
        let density = |x: f64| curve(self.axis.locate(x) - 0.5);
        let place = |q: f64| (q - self.frame.mean[0]) / self.frame.lower[0];
        let contact = self.oscillator.contact();
        let kinks: Vec<f64> = contact.kinks().into_iter().map(place).collect();
        let flight = contact.flight().map(|ends| ends.map(place));
        let mut panel = |a: f64, b: f64, towards: Option<f64>| {
            let middle = 0.5 * (a + b);
            let lost = flight.is_some_and(|[low, high]| middle >= low && middle < high);
            for (z, w) in kronrod() {
                // x - l = (other - l) u^2 takes the half-integer power of the force to an integer one.
                let (x, w) = match towards {
                    Some(l) => {
                        let (u, far) = (0.5 + 0.5 * z, if l == a { b } else { a });
                        (l + (far - l) * u * u, w * u * (far - l).abs())
                    }
                    None => (0.5 * (a + b) + 0.5 * (b - a) * z, w * 0.5 * (b - a)),
                };
                let q = self.frame.mean[0] + self.frame.lower[0] * x;
                f(q, w * density(x), lost);
            }
        };
        for pair in centres.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let mut ends = vec![a];
            ends.extend(kinks.iter().copied().filter(|l| *l > a && *l < b));
            ends.push(b);
            for ends in ends.windows(2) {
                // A kink at either end: this panel begins or ends at the power.
                let towards = kinks.iter().copied().find(|l| ends.contains(l));
                panel(ends[0], ends[1], towards);
            }
        }
    }

    /// Smallest value of p at the centres.
    pub(crate) fn lowest(&self) -> f64 {
        self.values.iter().copied().fold(f64::INFINITY, f64::min) / self.frame.area()
    }
}
