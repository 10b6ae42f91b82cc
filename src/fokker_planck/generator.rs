//! The generator L of dP/dt = L P on a mesh: transport of g = P/w along the stationary mass flux, and
//! friction with diffusion, pi h d/dv(p_s dg/dv). Matrix-free, and assembled by columns.
//!
//! Upwind: a flux M through a face carries g of the cell it comes from; with Scharfetter-Gummel
//! diffusion L is an M-matrix with zero column sums. Central, with D the antisymmetric difference
//! matrix of the order:
//!
//! ```text
//! w dg/dt = -1/2 [D_q(a g) + a D_q g + D_v(b g) + b D_v g] - S^T (pi h p_s) S g
//! ```
//!
//! The bracket is antisymmetric in g and the last term symmetric and dissipative, so mass, g = 1 and
//! the decay of sum w g^2 hold exactly at every order (summation by parts; Morinishi et al., J. Comput.
//! Phys. 143, 90, 1998).

use super::difference::{central, staggered};
use super::flux::{Drift, MassFlux, Measure, Weights, maxwell};
use super::mesh::Mesh;
use crate::error::{Error, Result};
use crate::oscillator::Oscillator;
use crate::quadrature;
use sprs::{CsMat, TriMat};
use std::ops::Range;

/// The generator on a mesh.
#[derive(Debug, Clone)]
pub struct Generator {
    mesh: Mesh,
    drift: Drift,
    flux: MassFlux,
    weights: Weights,
    /// The cells of each q-column that a streamline reaches; the others (the rim) hold no unknowns.
    active: Vec<Range<usize>>,
    /// 1/w of active cells, 0 of the others.
    inverse: Vec<f64>,
    /// pi h times the Maxwell density over dv/deta on the nv + 1 v-faces.
    conductance: Vec<f64>,
    /// w/(w of the Maxwell measure) per v cell: friction and diffusion act on P over the latter.
    tilt: Vec<f64>,
    /// Cells at an open edge with the rate of g that balances their missing neighbours.
    open: Vec<(usize, f64)>,
}

impl Generator {
    /// The generator of `oscillator` on `mesh`.
    ///
    /// # Errors
    /// [`Error::Mesh`] if the mesh cannot hold the stationary law, or no streamline fits it.
    pub fn new(oscillator: &Oscillator, mesh: &Mesh, drift: Drift) -> Result<Self> {
        let measure = Measure::of(oscillator)?;
        let flux = MassFlux::new(&measure, oscillator, mesh, drift);
        Self::with_flux(oscillator, mesh, drift, flux)
    }

    /// As [`Generator::new`] with a mass flux of one's own: for tests of what depends on it.
    ///
    /// # Errors
    /// As [`Generator::new`].
    pub fn with_flux(
        oscillator: &Oscillator,
        mesh: &Mesh,
        drift: Drift,
        flux: MassFlux,
    ) -> Result<Self> {
        let t = oscillator.temperature();
        let measure = Measure::of(oscillator)?;
        let weights = Weights::new(&measure, mesh, t, drift)?;
        let [nq, nv] = mesh.cells();
        let active = active(&flux, drift, nq, nv);
        let unknowns: usize = active.iter().map(Range::len).sum();
        if unknowns < 2 {
            return Err(Error::Mesh {
                what: format!("no streamline fits {nq} x {nv} cells"),
                help: "more cells".into(),
            });
        }
        let mut inverse = vec![0.0; nq * nv];
        for (i, range) in active.iter().enumerate() {
            for j in range.clone() {
                inverse[i * nv + j] = 1.0 / weights.at(i, j);
            }
        }
        if !inverse.iter().all(|x| x.is_finite()) {
            return Err(Error::Mesh {
                what: "the stationary law underflows inside the box".into(),
                help: "a start nearer to the stationary law, or a higher tolerance".into(),
            });
        }
        let conductance = conductance(oscillator, mesh, drift);
        let tilt = weights
            .v
            .iter()
            .zip(&weights.maxwell)
            .map(|(v, m)| v / m)
            .collect();
        let mut it = Self {
            mesh: mesh.clone(),
            drift,
            flux,
            weights,
            active,
            inverse,
            conductance,
            tilt,
            open: Vec::new(),
        };
        if matches!(measure, Measure::Liouville) {
            it.open_edges();
        }
        Ok(it)
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// How g is carried.
    pub fn drift(&self) -> Drift {
        self.drift
    }

    /// w of cell (i, j).
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// The cells of q-column i that hold unknowns.
    pub fn active(&self, i: usize) -> Range<usize> {
        self.active[i].clone()
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.active.iter().map(Range::len).sum()
    }

    /// 1/w of every cell, row-major; 0 where there is no unknown.
    pub fn inverse_weights(&self) -> &[f64] {
        &self.inverse
    }

    /// `rate = d(w g)/dt` for every cell, row-major; 0 where there is no unknown.
    pub fn apply(&self, g: &[f64], rate: &mut [f64]) {
        pulp::Arch::new().dispatch(|| self.apply_inlined(g, rate));
    }

    #[inline(always)]
    fn apply_inlined(&self, g: &[f64], rate: &mut [f64]) {
        rate.fill(0.0);
        match &self.flux {
            MassFlux::Faces { q, v } => self.upwind(q, v, g, rate),
            MassFlux::Centres { q, v } => {
                self.central(q, v, g, rate);
                for &(cell, rate_of_g) in &self.open {
                    rate[cell] += rate_of_g * g[cell];
                }
            }
        }
        self.diffuse(g, rate);
    }

    #[inline(always)]
    fn upwind(&self, flux_q: &[f64], flux_v: &[f64], g: &[f64], rate: &mut [f64]) {
        let [nq, nv] = self.mesh.cells();
        for i in 0..nq {
            let (row, faces) = (i * nv, i * (nv + 1));
            for j in 0..nv {
                let here = g[row + j];
                let left = if i > 0 { g[row - nv + j] } else { 0.0 };
                let right = if i + 1 < nq { g[row + nv + j] } else { 0.0 };
                let below = if j > 0 { g[row + j - 1] } else { 0.0 };
                let above = if j + 1 < nv { g[row + j + 1] } else { 0.0 };
                let carried = |m: f64, from: f64, to: f64| m.max(0.0) * from + m.min(0.0) * to;
                rate[row + j] = carried(flux_q[row + j], left, here)
                    - carried(flux_q[row + nv + j], here, right)
                    + carried(flux_v[faces + j], below, here)
                    - carried(flux_v[faces + j + 1], here, above);
            }
        }
    }

    /// Every pair of cells (n, m) a distance l apart exchanges c_l (a_n + a_m)/2 (g_m - g_n), with the
    /// same sign on both: exactly 0 for g = 1.
    #[inline(always)]
    fn central(&self, a: &[f64], b: &[f64], g: &[f64], rate: &mut [f64]) {
        let [nq, nv] = self.mesh.cells();
        let c = central(self.drift.half_width());
        for i in 0..nq {
            let row = i * nv..(i + 1) * nv;
            for (l, c) in (1..).zip(c) {
                let factor = 0.5 * c;
                let (gi, out) = (&g[row.clone()], &mut rate[row.clone()]);
                let ai = &a[row.clone()];
                if i + l < nq {
                    let other = (i + l) * nv..(i + l + 1) * nv;
                    pairs(out, factor, ai, &a[other.clone()], gi, &g[other]);
                }
                if i >= l {
                    let other = (i - l) * nv..(i - l + 1) * nv;
                    pairs(out, -factor, ai, &a[other.clone()], gi, &g[other]);
                }
                if l < nv {
                    let bi = &b[row.clone()];
                    let cut = nv - l;
                    pairs(
                        &mut out[..cut],
                        factor,
                        &bi[..cut],
                        &bi[l..],
                        &gi[..cut],
                        &gi[l..],
                    );
                    pairs(
                        &mut out[l..],
                        -factor,
                        &bi[l..],
                        &bi[..cut],
                        &gi[l..],
                        &gi[..cut],
                    );
                }
            }
        }
    }

    /// Half-width of the diffusion stencil on face j of a column: the order of the scheme, falling
    /// towards the ends of the column so that every interior face conducts.
    #[inline(always)]
    fn reach(&self, column: &Range<usize>, j: usize) -> usize {
        (j - column.start)
            .min(column.end - j)
            .min(self.drift.half_width())
    }

    #[inline(always)]
    fn diffuse(&self, g: &[f64], rate: &mut [f64]) {
        let nv = self.mesh.v.len();
        let half = self.drift.half_width();
        let full = staggered(half);
        for (i, column) in self.active.iter().enumerate() {
            let row = i * nv;
            let (g, rate) = (&g[row..row + nv], &mut rate[row..row + nv]);
            let scale = self.weights.q[i];
            // Faces with room for the full stencil; none in a column shorter than it.
            let mut inner = column.start + half..(column.end + 1).saturating_sub(half);
            if inner.is_empty() {
                inner = column.end..column.end;
            }
            let mut face = |j: usize, s: &[f64]| {
                let k = self.conductance[j] * scale;
                let slope: f64 = s
                    .iter()
                    .enumerate()
                    .map(|(l, s)| {
                        s * (g[j + l] * self.tilt[j + l] - g[j - 1 - l] * self.tilt[j - 1 - l])
                    })
                    .sum();
                let flux = k * slope;
                for (l, s) in s.iter().enumerate() {
                    rate[j + l] -= s * flux;
                    rate[j - 1 - l] += s * flux;
                }
            };
            for j in column.start + 1..inner.start {
                face(j, staggered(self.reach(column, j)));
            }
            for j in inner.clone() {
                face(j, full);
            }
            for j in inner.end..column.end {
                face(j, staggered(self.reach(column, j)));
            }
        }
    }

    /// At an open edge the pairs with missing neighbours leave a row sum. Outflow (positive) takes its
    /// probability along; inflow carries none: only the negative part is given back.
    fn open_edges(&mut self) {
        let MassFlux::Centres { q: a, v: b } = &self.flux else {
            return;
        };
        let [nq, nv] = self.mesh.cells();
        let c = central(self.drift.half_width());
        for i in 0..nq {
            for j in 0..nv {
                let here = i * nv + j;
                let mut sum = 0.0;
                for (l, c) in (1..).zip(c) {
                    let mut add = |inside: bool, sign: f64, flux: &[f64], there: usize| {
                        if inside {
                            sum -= sign * 0.5 * c * (flux[here] + flux[there]);
                        }
                    };
                    add(i + l < nq, 1.0, a, here + l * nv);
                    add(i >= l, -1.0, a, here.wrapping_sub(l * nv));
                    add(j + l < nv, 1.0, b, here + l);
                    add(j >= l, -1.0, b, here.wrapping_sub(l));
                }
                if sum < 0.0 {
                    self.open.push((here, sum));
                }
            }
        }
    }

    /// A bound on the spectral radius of the transport and of the friction and diffusion, each the
    /// largest row sum of the symmetrised matrix |w^-1/2 K w^-1/2|: (transport, diffusion), 1/time.
    pub fn rates(&self) -> (f64, f64) {
        let mut sums = [vec![0.0; self.mesh.len()], vec![0.0; self.mesh.len()]];
        self.entries(|part, n, m, value| {
            let scale = (self.inverse[n] * self.inverse[m]).sqrt();
            sums[part as usize][n] += value.abs() * scale;
        });
        let largest = |sums: &[f64]| sums.iter().copied().fold(0.0, f64::max);
        (largest(&sums[0]), largest(&sums[1]))
    }

    /// L of dP/dt = L P on the unknowns, by columns. Column sums are zero to rounding (up to what
    /// leaves through open edges).
    pub fn matrix(&self) -> CsMat<f64> {
        let n = self.unknowns();
        let number = self.numbering();
        let mut triplets = TriMat::with_capacity((n, n), n * (4 * self.drift.half_width() + 5));
        self.entries(|_, row, column, value| {
            triplets.add_triplet(number[row], number[column], value * self.inverse[column]);
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
    fn entries(&self, mut add: impl FnMut(Part, usize, usize, f64)) {
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
                        add(
                            Part::Diffusion,
                            row + n,
                            row + m,
                            -k * sn * sm * self.tilt[m],
                        );
                    }
                }
            }
        }
    }
}

/// Which process an entry belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Transport = 0,
    Diffusion = 1,
}

/// `out -= factor (a + a') (g' - g)`, elementwise.
#[inline(always)]
fn pairs(out: &mut [f64], factor: f64, a: &[f64], a_there: &[f64], g: &[f64], g_there: &[f64]) {
    let n = out.len();
    let (a, a_there, g, g_there) = (&a[..n], &a_there[..n], &g[..n], &g_there[..n]);
    for j in 0..n {
        out[j] -= factor * (a[j] + a_there[j]) * (g_there[j] - g[j]);
    }
}

/// The contiguous range of cells per column that exchange anything with a neighbour.
fn active(flux: &MassFlux, drift: Drift, nq: usize, nv: usize) -> Vec<Range<usize>> {
    let mut touched = vec![false; nq * nv];
    match flux {
        MassFlux::Faces { q, v } => {
            for i in 0..nq {
                for j in 0..nv {
                    touched[i * nv + j] = q[i * nv + j] != 0.0
                        || q[(i + 1) * nv + j] != 0.0
                        || v[i * (nv + 1) + j] != 0.0
                        || v[i * (nv + 1) + j + 1] != 0.0;
                }
            }
        }
        MassFlux::Centres { q: a, v: b } => {
            for i in 0..nq {
                for j in 0..nv {
                    let here = i * nv + j;
                    for l in 1..=drift.half_width() {
                        if i + l < nq && a[here] + a[here + l * nv] != 0.0 {
                            touched[here] = true;
                            touched[here + l * nv] = true;
                        }
                        if j + l < nv && b[here] + b[here + l] != 0.0 {
                            touched[here] = true;
                            touched[here + l] = true;
                        }
                    }
                }
            }
        }
    }
    let column = |row: &[bool]| {
        let first = row.iter().position(|t| *t);
        let last = row.iter().rposition(|t| *t);
        first
            .zip(last)
            .map_or(0..0, |(first, last)| first..last + 1)
    };
    touched.chunks(nv).map(column).collect()
}

/// pi h p_v over the width, on the v-faces. Upwind: the Scharfetter-Gummel weight 1/integral of 1/p_v
/// between the centres (Chang and Cooper 1970); central: p_v/(dv/deta) at the face.
fn conductance(oscillator: &Oscillator, mesh: &Mesh, drift: Drift) -> Vec<f64> {
    let (t, noise) = (oscillator.temperature(), oscillator.noise());
    let n = mesh.v.len();
    let face = |j: usize| {
        let (v, slope) = mesh.v.at(j as f64);
        if j == 0 || j == n {
            return 0.0;
        }
        if drift != Drift::Upwind {
            return noise * maxwell(v, t) / slope;
        }
        let (low, high) = (mesh.v.centres()[j - 1], mesh.v.centres()[j]);
        let inverse = |x: f64| (0.5 * (x * x - v * v) / t).exp();
        noise * maxwell(v, t) / quadrature::integrate(inverse, &[low, v, high], 1e-12).value
    };
    (0..=n).map(face).collect()
}
