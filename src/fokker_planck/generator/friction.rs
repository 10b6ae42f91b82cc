//! Friction that depends on the state: what it does beside the friction that keeps the weights.
//!
//! The weights are a Gibbs law of temperature T, which the friction k = pi h/T keeps: friction and diffusion of that rate
//! are -S^T (pi h w) S g. Of c(q, v) the rest is a drift of its own, d/dv[(c - k) v w g], a mass flux e = -(c - k) v w
//! along v that carries g. It is added to the stationary mass flux, whose divergence is no longer 0: with central
//! differences the pairs carry e dg/dv, and a rate on the diagonal adds g de/dv such that every column sums to 0 still.
//! Central differences do not damp what a drift carries that is far stronger than diffusion: cells beyond a Peclet number of
//! [`PECLET`], at speeds that hardly occur, exchange as much more with their neighbours along v as brings them back to it.

use super::super::difference::central;
use super::super::flux::{Drift, MassFlux};
use super::Generator;
use crate::gaussian::maxwell;
use crate::oscillator::Oscillator;

/// Peclet number of a cell, speed of the drift times width over diffusion, beyond which diffusion is added. Without, and at 12,
/// modes at the edge of the domain join the null vector under strong friction (in contact at zeta = 2, Hunt and Crossley's at
/// zeta = 0.5, h = 0.2); at 4 the addition is seen in the fourth digit of a law, at 8 in the fifth.
const PECLET: f64 = 8.0;

impl Generator {
    /// Adds the drift of a friction other than that of the weights.
    pub(super) fn add_friction(&mut self, oscillator: &Oscillator) {
        let reference = oscillator.reference_friction();
        let temperature = oscillator.temperature();
        let nv = self.mesh.v.len();
        let half = self.drift.half_width();
        let excess = |q: f64, v: f64| (reference - oscillator.friction_at(q, v)) * v;
        let axes = (&self.mesh.q, &self.mesh.v);
        let columns = || self.active.iter().cloned().enumerate();
        let noise = oscillator.noise();
        match &mut self.flux {
            MassFlux::Faces { v: flux, .. } => {
                for (i, column) in columns() {
                    let q = axes.0.centres()[i];
                    for j in column.start + 1..column.end {
                        let v = axes.1.edges()[j];
                        let weight = self.weights.q[i] * maxwell(v, temperature);
                        flux[i * (nv + 1) + j] += excess(q, v) * weight;
                    }
                }
            }
            MassFlux::Centres { v: flux, .. } => {
                let c = central(half);
                let mut extra = vec![0.0; nv];
                for (i, column) in columns() {
                    let q = axes.0.centres()[i];
                    extra.fill(0.0);
                    // A pair with a cell beyond the column must carry nothing.
                    let inner = column.start + half..column.end.saturating_sub(half);
                    for (j, extra) in extra.iter_mut().enumerate() {
                        if inner.contains(&j) && !self.weights.is_boundary(i, j) {
                            let weight = self.weights.at(i, j) / axes.1.slopes()[j];
                            *extra = excess(q, axes.1.centres()[j]) * weight;
                        }
                    }
                    for j in column.start..column.end.saturating_sub(1) {
                        let width = 0.5 * (axes.1.slopes()[j] + axes.1.slopes()[j + 1]);
                        let speed = excess(q, axes.1.edges()[j + 1]).abs();
                        let more = speed * width / PECLET - noise;
                        if more > 0.0 {
                            let weights = [j, j + 1].map(|j| self.weights.at(i, j));
                            let rate = more * (weights[0] * weights[1]).sqrt() / (width * width);
                            let here = i * nv + j;
                            self.relaxed.push((here, here + 1, rate));
                            self.relaxed.push((here + 1, here, rate));
                        }
                    }
                    for j in column {
                        flux[i * nv + j] += extra[j];
                        let at = |k: Option<usize>| k.and_then(|k| extra.get(k)).copied();
                        let change = (1..).zip(c).map(|(l, c)| {
                            let above = at(Some(j + l)).unwrap_or(-extra[j]);
                            let below = at(j.checked_sub(l)).unwrap_or(-extra[j]);
                            c * (above - below)
                        });
                        let divergence: f64 = change.sum();
                        if divergence != 0.0 {
                            self.open.push((i * nv + j, -divergence));
                        }
                    }
                }
            }
        }
        self.relaxed.sort_by_key(|(cell, ..)| *cell);
        self.gathers = self.drift != Drift::Upwind;
    }
}
