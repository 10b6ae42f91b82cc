//! Rows of the mesh: their friction, and the cells that hold unknowns.

use crate::fokker_planck::mesh::Mesh;
use crate::oscillator::Oscillator;
use std::ops::Range;

/// The rates of friction that matrices are made for: on either side of a wall what c is there if it jumps, else the
/// reference rate. What c is more or less than these is continuous, and is left to the maps.
#[derive(Debug, Clone)]
pub(super) struct Rates {
    /// The walls at which c jumps, ascending.
    jumps: Vec<f64>,
    /// Between them, one more than jumps.
    between: Vec<f64>,
    /// Whether c is more or less than these anywhere.
    pub(super) vary: bool,
}

impl Rates {
    pub(super) fn of(oscillator: &Oscillator, mesh: &Mesh) -> Self {
        /// A jump over c that is one, and how close to the wall it shows.
        const JUMP: f64 = 1e-3;
        const BESIDE: f64 = 1e-9;
        let mut it = Self {
            jumps: Vec::new(),
            between: vec![oscillator.reference_friction()],
            vary: false,
        };
        let walls = oscillator.contact().flight().into_iter().flatten();
        for wall in walls.filter(|q| q.is_finite()) {
            let [below, above] = [-BESIDE, BESIDE].map(|x| oscillator.friction(wall + x));
            if (above - below).abs() > JUMP * above.max(below).max(oscillator.zeta()) {
                it.between[it.jumps.len()] = below;
                it.jumps.push(wall);
                it.between.push(above);
            }
        }
        let beyond = |q: &f64| (oscillator.friction(*q) - it.at(*q)).abs();
        let rounding = 1e-12 * oscillator.zeta();
        it.vary = mesh.q.centres().iter().any(|q| beyond(q) > rounding);
        it
    }

    /// That at a displacement.
    pub(super) fn at(&self, q: f64) -> f64 {
        self.between[self.jumps.partition_point(|jump| *jump <= q)]
    }

    /// Rows of one rate.
    pub(super) fn blocks(&self, mesh: &Mesh) -> Vec<(Range<usize>, f64)> {
        let centres = mesh.q.centres();
        let row = |jump: &f64| centres.partition_point(|q| q < jump);
        let ends = self.jumps.iter().map(row).chain([centres.len()]);
        let rows = ends.scan(0, |from, to| Some(std::mem::replace(from, to)..to));
        let both = rows.zip(self.between.iter().copied());
        both.filter(|(rows, _)| !rows.is_empty()).collect()
    }
}

/// The cells of each q row on orbits that close inside the domain, and how g continues beyond them.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// Per row the cells that hold unknowns.
    pub(super) active: Vec<Range<usize>>,
    /// Their number in the rows before.
    pub(super) offsets: Vec<usize>,
    /// g of the other cells over that of the nearest one that holds an unknown: p falls off as the stationary law under the
    /// weakest noise. Where g is taken against a hotter law, a constant would let what lies there grow by e^{2 zeta t}.
    pub(super) beyond: Vec<f64>,
    excess: f64,
}

impl Rows {
    /// Those of a mesh, g a constant beyond them.
    pub(super) fn of(oscillator: &Oscillator, mesh: &Mesh, stationary: bool) -> Self {
        let active = active(oscillator, mesh, stationary);
        let mut offsets = vec![0];
        for range in &active {
            offsets.push(offsets[offsets.len() - 1] + range.len());
        }
        Self {
            active,
            offsets,
            beyond: vec![1.0; mesh.len()],
            excess: 0.0,
        }
    }

    /// Makes p fall off beyond them by so much more in 1/T than the law which g is taken against.
    pub(super) fn fall(&mut self, mesh: &Mesh, excess: f64) {
        if excess == self.excess {
            return;
        }
        self.excess = excess;
        let v = mesh.v.centres();
        for (row, range) in self.beyond.chunks_exact_mut(v.len()).zip(&self.active) {
            for (j, share) in row.iter_mut().enumerate() {
                let edge = v[j.clamp(range.start, range.end - 1)];
                *share = (-0.5 * excess * (v[j] * v[j] - edge * edge)).exp();
            }
        }
    }
}

/// Per q row the cells on orbits that stay within the outermost centres, but for those that friction keeps them from; at least
/// the two slowest.
fn active(oscillator: &Oscillator, mesh: &Mesh, stationary: bool) -> Vec<Range<usize>> {
    let contact = oscillator.contact();
    let (q, v) = (mesh.q.centres(), mesh.v.centres());
    let [nq, nv] = mesh.cells();
    if !stationary {
        return vec![0..nv; nq];
    }
    let fastest = v[0].abs().min(v[nv - 1].abs());
    let ends = [q[0], q[nq - 1]];
    let closed = ends.into_iter().zip(oscillator.holds_back(ends));
    let closed = closed.filter(|(_, held)| !held);
    let levels = closed.map(|(q, _)| contact.potential(q));
    let level = levels.fold(0.5 * fastest * fastest, f64::min);
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
