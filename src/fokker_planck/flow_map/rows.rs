//! Rows of the mesh: their friction, and the cells that hold unknowns.

use crate::contact::ContactLaw;
use crate::fokker_planck::mesh::Mesh;
use crate::oscillator::Oscillator;
use std::ops::Range;

/// The rates of friction that matrices are made for: on either side of the loss of contact what c is there if it jumps,
/// else the reference rate on both. What c is more or less than these is continuous, and is left to the maps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rates {
    loss: f64,
    flight: f64,
    contact: f64,
    /// Whether c is more or less than these anywhere.
    pub(super) vary: bool,
}

impl Rates {
    pub(super) fn of(oscillator: &Oscillator, mesh: &Mesh) -> Self {
        /// A jump over c that is one, and how close to the loss of contact it shows.
        const JUMP: f64 = 1e-3;
        const BESIDE: f64 = 1e-9;
        let everywhere = oscillator.reference_friction();
        let mut it = Self {
            loss: oscillator
                .contact()
                .loss_point()
                .unwrap_or(f64::NEG_INFINITY),
            flight: everywhere,
            contact: everywhere,
            vary: false,
        };
        if it.loss.is_finite() {
            let [below, above] = [-BESIDE, BESIDE].map(|x| oscillator.friction(it.loss + x));
            if (above - below).abs() > JUMP * above.max(below).max(oscillator.zeta()) {
                (it.flight, it.contact) = (below, above);
            }
        }
        let beyond = |q: &f64| (oscillator.friction(*q) - it.at(*q)).abs();
        let rounding = 1e-12 * oscillator.zeta();
        it.vary = mesh.q.centres().iter().any(|q| beyond(q) > rounding);
        it
    }

    /// That at a displacement.
    pub(super) fn at(&self, q: f64) -> f64 {
        if q < self.loss {
            self.flight
        } else {
            self.contact
        }
    }

    /// Rows of one rate.
    pub(super) fn blocks(&self, mesh: &Mesh) -> Vec<(Range<usize>, f64)> {
        let (all, lost) = (
            mesh.q.len(),
            mesh.q.centres().partition_point(|q| *q < self.loss),
        );
        let blocks = if self.flight == self.contact {
            [0..0, 0..all]
        } else {
            [0..lost, lost..all]
        };
        let both = blocks.into_iter().zip([self.flight, self.contact]);
        both.filter(|(rows, _)| !rows.is_empty()).collect()
    }
}

/// Per q row the cells on orbits that stay within the outermost centres; at least the two slowest.
pub(super) fn active(contact: &ContactLaw, mesh: &Mesh, stationary: bool) -> Vec<Range<usize>> {
    let (q, v) = (mesh.q.centres(), mesh.v.centres());
    let [nq, nv] = mesh.cells();
    if !stationary {
        return vec![0..nv; nq];
    }
    let fastest = v[0].abs().min(v[nv - 1].abs());
    let level = contact
        .potential(q[0])
        .min(contact.potential(q[nq - 1]))
        .min(0.5 * fastest * fastest);
    q.iter()
        .map(|q| {
            let reach = (2.0 * (level - contact.potential(*q))).max(0.0).sqrt();
            let first = v.partition_point(|v| *v < -reach);
            let last = v.partition_point(|v| *v <= reach);
            let middle = v.partition_point(|v| *v < 0.0).clamp(1, nv - 1);
            first.min(middle - 1)..last.max(middle + 1)
        })
        .collect()
}
