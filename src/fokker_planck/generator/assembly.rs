//! The generator as a matrix: entries, the five-point operator, the bands of friction and diffusion.

use super::super::difference::{central, staggered};
use super::super::flux::MassFlux;
use super::{BANDS, Generator};
use sprs::{CsMat, TriMat};

/// Which process an entry belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Transport = 0,
    Diffusion = 1,
}

impl Generator {
    /// S^T k S of one q-column over its factor of the weights, which friction and diffusion are -1/w_m
    /// times: symmetric, per active cell its diagonal and the entries left of it, nearest first.
    pub(crate) fn diffusion_bands(&self, i: usize) -> Vec<[f64; BANDS]> {
        let column = &self.active[i];
        let mut bands = vec![[0.0; BANDS]; column.len()];
        for j in column.start + 1..column.end {
            let s = staggered(self.reach(column, j));
            let entry = |l: usize| if l < s.len() { s[l] } else { -s[l - s.len()] };
            let cell = |l: usize| {
                if l < s.len() {
                    j + l
                } else {
                    j - 1 - (l - s.len())
                }
            };
            for (m, n) in (0..2 * s.len()).flat_map(|m| (0..2 * s.len()).map(move |n| (m, n))) {
                if cell(n) <= cell(m) {
                    bands[cell(m) - column.start][cell(m) - cell(n)] +=
                        self.conductance[j] * entry(m) * entry(n);
                }
            }
        }
        bands
    }

    /// A five-point neighbour of L on the same unknowns, by columns: the mass flux between neighbours
    /// upwind, friction and diffusion of order 2. No scheme of its own, since its flux is not free of
    /// divergence; its LU preconditions that of a wide stencil.
    pub(crate) fn five_point(&self) -> CsMat<f64> {
        let MassFlux::Centres { q: a, v: b } = &self.flux else {
            return self.matrix();
        };
        let [nq, nv] = self.mesh.cells();
        let (n, number) = (self.unknowns(), self.numbering());
        let mut triplets = TriMat::with_capacity((n, n), 9 * n);
        let mut add = |row: usize, column: usize, value: f64| {
            triplets.add_triplet(number[row], number[column], value * self.inverse[column]);
        };
        for i in 0..nq {
            for j in self.active(i) {
                let here = i * nv + j;
                add(here, here, 0.0);
                let neighbours = [(i + 1 < nq, nv, a), (j + 1 < nv, 1, b)];
                for (_, ahead, flux) in neighbours.into_iter().filter(|(exists, ..)| *exists) {
                    let there = here + ahead;
                    if self.inverse[there] == 0.0 {
                        continue;
                    }
                    let flux = 0.5 * (flux[here] + flux[there]);
                    let (from, to) = if flux > 0.0 {
                        (here, there)
                    } else {
                        (there, here)
                    };
                    add(to, from, flux.abs());
                    add(from, from, -flux.abs());
                    if ahead == 1 {
                        let k = self.conductance[j + 1] * self.weights.q[i];
                        for (cell, v) in [(here, j), (there, j + 1)] {
                            add(cell, cell, -k * self.tilt[v]);
                            add(here + there - cell, cell, k * self.tilt[v]);
                        }
                    }
                }
            }
        }
        for &(n, m, k) in &self.relaxed {
            add(n, m, k);
            add(n, n, -k);
        }
        triplets.to_csc()
    }

    /// L of dP/dt = L P on the unknowns, by columns. Column sums are zero to rounding (up to what
    /// leaves through open edges).
    pub fn matrix(&self) -> CsMat<f64> {
        self.assemble(|_, column| self.inverse[column])
    }

    /// The symmetrised generator w^{-1/2} L w^{1/2} on the unknowns, by columns: same eigenvalues, the
    /// transport antisymmetric for the central schemes, friction and diffusion symmetric. Its transpose
    /// is itself with v reversed.
    pub fn symmetrised(&self) -> CsMat<f64> {
        self.assemble(|row, column| (self.inverse[row] * self.inverse[column]).sqrt())
    }

    fn assemble(&self, scale: impl Fn(usize, usize) -> f64) -> CsMat<f64> {
        let n = self.unknowns();
        let number = self.numbering();
        let mut triplets = TriMat::with_capacity((n, n), n * (4 * self.drift.half_width() + 5));
        self.entries(|_, row, column, value| {
            triplets.add_triplet(number[row], number[column], value * scale(row, column));
        });
        triplets.to_csc()
    }

    /// The number of each cell among the unknowns, `usize::MAX` where there is none.
    pub fn numbering(&self) -> Vec<usize> {
        let nv = self.mesh.v.len();
        let mut number = vec![usize::MAX; self.mesh.len()];
        let mut next = 0;
        for (i, column) in self.active.iter().enumerate() {
            for j in column.clone() {
                number[i * nv + j] = next;
                next += 1;
            }
        }
        number
    }

    /// Every entry (part, row, column, value) of d(w g)/dt = K g; entries of one place may come in
    /// several pieces.
    pub(super) fn entries(&self, mut add: impl FnMut(Part, usize, usize, f64)) {
        let [nq, nv] = self.mesh.cells();
        let inside = |cell: usize| self.inverse[cell] > 0.0;
        match &self.flux {
            MassFlux::Faces { q, v } => {
                // What leaves one cell enters the other: a flux cannot lose probability.
                let mut cross = |below: Option<usize>, above: Option<usize>, flux: f64| {
                    let (from, to) = if flux > 0.0 {
                        (below, above)
                    } else {
                        (above, below)
                    };
                    if let Some(from) = from.filter(|cell| inside(*cell)) {
                        add(Part::Transport, from, from, -flux.abs());
                        if let Some(to) = to {
                            add(Part::Transport, to, from, flux.abs());
                        }
                    }
                };
                for i in 0..=nq {
                    for j in 0..nv {
                        let flux = q[i * nv + j];
                        if flux != 0.0 {
                            let below = (i > 0).then(|| (i - 1) * nv + j);
                            cross(below, (i < nq).then(|| i * nv + j), flux);
                        }
                    }
                }
                for i in 0..nq {
                    for j in 0..=nv {
                        let flux = v[i * (nv + 1) + j];
                        if flux != 0.0 {
                            let below = (j > 0).then(|| i * nv + j - 1);
                            cross(below, (j < nv).then(|| i * nv + j), flux);
                        }
                    }
                }
            }
            MassFlux::Centres { q: a, v: b } => {
                let c = central(self.drift.half_width());
                for i in 0..nq {
                    for j in 0..nv {
                        let here = i * nv + j;
                        for (l, c) in (1..).zip(c) {
                            let mut pair = |exists: bool, flux: &[f64], there: usize| {
                                let value = if exists {
                                    0.5 * c * (flux[here] + flux[there])
                                } else {
                                    0.0
                                };
                                if value != 0.0 {
                                    // -value (g_there - g_here) on both.
                                    add(Part::Transport, here, there, -value);
                                    add(Part::Transport, here, here, value);
                                    add(Part::Transport, there, there, -value);
                                    add(Part::Transport, there, here, value);
                                }
                            };
                            pair(i + l < nq, a, here + l * nv);
                            pair(j + l < nv, b, here + l);
                        }
                    }
                }
                for &(n, m, k) in &self.relaxed {
                    add(Part::Diffusion, n, m, k);
                    add(Part::Diffusion, n, n, -k);
                }
                for &(cell, rate) in &self.open {
                    add(Part::Transport, cell, cell, rate);
                }
            }
        }
        for (i, column) in self.active.iter().enumerate() {
            let row = i * nv;
            for j in column.start + 1..column.end {
                let s = staggered(self.reach(column, j));
                let k = self.conductance[j] * self.weights.q[i];
                // The face sees the cells below with -s and those above with +s.
                let stencil = || {
                    let pairs = s.iter().enumerate();
                    pairs.flat_map(|(l, s)| [(j + l, *s), (j - 1 - l, -s)])
                };
                for (m, sm) in stencil() {
                    for (n, sn) in stencil() {
                        let rate = -k * sn * sm * self.tilt[m];
                        add(Part::Diffusion, row + n, row + m, rate);
                    }
                }
            }
        }
    }
}
