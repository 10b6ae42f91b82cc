//! Moments and probabilities of a density on a mesh, to the order of the scheme.
//!
//! Every number is a bilinear form in g = P/w, E[f(q) h(v)] = sum_ij g_ij f_i h_j. The factors f_i hold
//! the integral of f p_q against the interpolation polynomial of g in q, cell by cell, so a kink or
//! jump of f at the loss point (a cell edge) costs no accuracy, and g = 1 gives the closed form. Along
//! v everything is smooth and decays at both ends: the midpoint sum converges faster than any order.

use super::difference::lagrange;
use super::flux::{Drift, Measure, Weights};
use super::mesh::Mesh;
use crate::contact::ContactLaw;
use crate::error::Result;
use crate::gaussian::{gaussian_mass, maxwell};
use crate::moments::RawMoments;
use crate::oscillator::Oscillator;
use crate::quadrature::kronrod;

/// Points of the interpolation of g along q.
const POINTS: usize = 8;

/// The functions of q whose expectation is taken: 1, q, q^2, N, N^2, N^3, N^4, U, lost.
const FUNCTIONS: usize = 9;

/// The factors of every observable on one mesh.
#[derive(Debug, Clone)]
pub struct Observables {
    contact: ContactLaw,
    /// Per function, per q cell.
    along_q: [Vec<f64>; FUNCTIONS],
    /// 1, v, v^2 per v cell.
    along_v: [Vec<f64>; 3],
}

impl Observables {
    /// The observables of a scheme on a mesh.
    ///
    /// # Errors
    /// Those of [`Measure::of`].
    pub fn new(
        oscillator: &Oscillator,
        mesh: &Mesh,
        drift: Drift,
        weights: &Weights,
    ) -> Result<Self> {
        let measure = Measure::of(oscillator)?;
        let contact = oscillator.contact().clone();
        let kinks = contact.kinks().into_iter();
        let kinks: Vec<f64> = kinks.map(|q| mesh.q.locate(q)).collect();
        let functions = |q: f64, lost: bool| -> [f64; FUNCTIONS] {
            let n = contact.force(q);
            let (n2, lost) = (n * n, f64::from(u8::from(lost)));
            [
                1.0,
                q,
                q * q,
                n,
                n2,
                n2 * n,
                n2 * n2,
                contact.potential(q),
                lost,
            ]
        };
        let nq = mesh.q.len();
        let points = POINTS.min(nq);
        let mut along_q: [Vec<f64>; FUNCTIONS] = std::array::from_fn(|_| vec![0.0; nq]);
        let mut basis = vec![0.0; points];
        for i in 0..nq {
            let first = i.saturating_sub(points / 2).min(nq - points);
            // In contact the force may have a half-integer power at a kink, on an edge to rounding or inside of the cell.
            let flown = contact.is_lost(mesh.q.centres()[i]);
            let near = kinks.iter().map(|kink| kink - i as f64);
            let reach = if flown { -1e-6 } else { 1e-6 };
            let near = near.filter(|xi| *xi > -reach && *xi < 1.0 + reach);
            let splits: Vec<f64> = near.map(|xi| xi.clamp(0.0, 1.0)).collect();
            for (xi, weight, middle) in nodes(i as f64, &splits) {
                let (q, slope) = mesh.q.at(xi);
                // On either side of a kink as its panel is.
                let lost = contact.is_lost(if splits.is_empty() {
                    q
                } else {
                    mesh.q.at(middle).0
                });
                let density = measure.density_q(q) * slope * weight;
                if drift == Drift::Upwind {
                    basis.fill(0.0);
                    basis[i - first] = 1.0;
                } else {
                    lagrange(first as f64 + 0.5, xi, &mut basis);
                }
                for (row, f) in along_q.iter_mut().zip(functions(q, lost)) {
                    for (k, b) in basis.iter().enumerate() {
                        row[first + k] += f * density * b;
                    }
                }
            }
        }
        Ok(Self {
            contact,
            along_q,
            along_v: along_v(oscillator, mesh, drift, &measure, weights),
        })
    }

    /// The raw expectations of the density with this g, row-major.
    pub fn raw(&self, g: &[f64]) -> RawMoments {
        let nv = self.along_v[0].len();
        let mut raw = RawMoments::default();
        for (i, row) in g.chunks_exact(nv).enumerate() {
            let [one, v, vv] = &self.along_v;
            let dot = |h: &[f64]| row.iter().zip(h).map(|(g, h)| g * h).sum::<f64>();
            let (mass, first, second) = (dot(one), dot(v), dot(vv));
            let [f1, q, qq, n1, n2, n3, n4, potential, lost] = &self.along_q;
            raw.mass += f1[i] * mass;
            raw.q += q[i] * mass;
            raw.qq += qq[i] * mass;
            raw.v += f1[i] * first;
            raw.vv += f1[i] * second;
            raw.qv += q[i] * first;
            for (sum, n) in raw.force.iter_mut().zip([n1, n2, n3, n4]) {
                *sum += n[i] * mass;
            }
            raw.potential += potential[i] * mass;
            raw.lost += lost[i] * mass;
        }
        raw
    }

    /// The contact law.
    pub fn contact(&self) -> &ContactLaw {
        &self.contact
    }
}

/// Quadrature nodes (xi, weight, middle of the panel) of the cell [xi, xi + 1], graded towards `splits` in [0, 1].
fn nodes(xi: f64, splits: &[f64]) -> Vec<(f64, f64, f64)> {
    let mut panels = vec![0.0, 1.0];
    for split in splits {
        let powers = (0..=12).rev().map(|k| 0.25f64.powi(k));
        let inside = |x: &f64| *x > 0.0 && *x < 1.0;
        panels.push(*split);
        panels.extend(powers.flat_map(|x| [split - x, split + x]).filter(inside));
    }
    panels.sort_by(f64::total_cmp);
    panels.dedup();
    let panel = |w: &[f64]| {
        let (a, half) = (xi + w[0], 0.5 * (w[1] - w[0]));
        kronrod().map(move |(x, weight)| (a + half * (1.0 + x), half * weight, a + half))
    };
    panels.windows(2).flat_map(panel).collect()
}

/// 1, v and v^2 per v cell, times the measure.
fn along_v(
    oscillator: &Oscillator,
    mesh: &Mesh,
    drift: Drift,
    measure: &Measure,
    weights: &Weights,
) -> [Vec<f64>; 3] {
    if drift != Drift::Upwind {
        let power = |n: i32| -> Vec<f64> {
            let cells = mesh.v.centres().iter().zip(&weights.v);
            cells.map(|(v, w)| v.powi(n) * w).collect()
        };
        return [power(0), power(1), power(2)];
    }
    let t = oscillator.temperature();
    let cell = |a: f64, b: f64| match measure {
        Measure::Gibbs(_) => {
            let (low, high) = (maxwell(a, t), maxwell(b, t));
            let mass = gaussian_mass(0.0, t.sqrt(), a, b);
            [mass, t * (low - high), t * (mass + a * low - b * high)]
        }
        Measure::Liouville => [b - a, 0.5 * (b * b - a * a), (b.powi(3) - a.powi(3)) / 3.0],
    };
    let cells = mesh.v.edges().windows(2).map(|w| cell(w[0], w[1]));
    let cells: Vec<[f64; 3]> = cells.collect();
    std::array::from_fn(|n| cells.iter().map(|c| c[n]).collect())
}
