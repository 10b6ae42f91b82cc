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
//!
//! The rim, the few cells beyond the last streamline that a wide stencil still touches, sees no transport
//! of its own and would carry slow modes of the box. There g is relaxed to its neighbours: symmetric and
//! dissipative too, and without weight in any answer (the rim holds less than the neglected probability).

#![allow(
    clippy::inline_always,
    reason = "the loops must be compiled inside the dispatch to be vectorised"
)]

use super::difference::{central, staggered};
use super::flux::{Drift, MassFlux, Measure, Weights, maxwell};
use super::mesh::Mesh;
use super::radius::{Kind, largest};
use crate::error::{Error, Result};
use crate::oscillator::Oscillator;
use crate::quadrature;
use sprs::{CsMat, TriMat};
use std::ops::Range;

/// Rate of the exchange between neighbours in the rim: a few times the oscillator's own frequency, so
/// that a rim up to eight cells wide relaxes faster than any slow mode, and far below the stiffest rate.
const RIM_RATE: f64 = 4.0;

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
    /// Pairs of neighbours in the rim with their exchange coefficient.
    relaxed: Vec<(usize, usize, f64)>,
    /// Cells at an open edge with the rate of g that balances their missing neighbours.
    open: Vec<(usize, f64)>,
    /// Cells at an open edge with the rate at which g leaves through it.
    leaving: Vec<(usize, f64)>,
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
        if drift != Drift::Upwind {
            check_tail(mesh, &weights, &active, drift)?;
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
            relaxed: Vec::new(),
            open: Vec::new(),
            leaving: Vec::new(),
        };
        match measure {
            Measure::Liouville => it.open_edges(),
            Measure::Gibbs(_) if drift != Drift::Upwind => it.relax_rim(),
            Measure::Gibbs(_) => {}
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

    /// The weights of the cells.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// The cells of q-column i that hold unknowns.
    pub fn active(&self, i: usize) -> Range<usize> {
        self.active[i].clone()
    }

    /// [`Generator::active`] of every q-column.
    pub fn columns(&self) -> &[Range<usize>] {
        &self.active
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.active.iter().map(Range::len).sum()
    }

    /// 1/w of every cell, row-major; 0 where there is no unknown.
    pub fn inverse_weights(&self) -> &[f64] {
        &self.inverse
    }

    /// w over the weight of the Maxwell measure per v cell: friction and diffusion act on g times it.
    pub fn tilt(&self) -> &[f64] {
        &self.tilt
    }

    /// Whether no probability leaves: the weights are then the stationary law.
    pub fn is_closed(&self) -> bool {
        self.open.is_empty() && self.leaving.is_empty()
    }

    /// `cells = w g` where there are unknowns; the others are left alone.
    pub fn weigh(&self, g: &[f64], cells: &mut [f64]) {
        let nv = self.mesh.v.len();
        for (i, column) in self.active.iter().enumerate() {
            for j in column.clone() {
                cells[i * nv + j] = g[i * nv + j] * self.weights.at(i, j);
            }
        }
    }

    /// `rate = d(w g)/dt` for every cell, row-major; 0 where there is no unknown.
    pub fn apply(&self, g: &[f64], rate: &mut [f64]) {
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || {
                self.transport(g, rate);
                self.diffusion(g, rate);
            },
        );
    }

    /// The part of [`Generator::apply`] that couples cells along q: transport, with the exchange in the
    /// rim and what leaves through open edges.
    pub fn apply_transport(&self, g: &[f64], rate: &mut [f64]) {
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || self.transport(g, rate),
        );
    }

    /// The part of [`Generator::apply`] that couples cells along v alone: friction and diffusion.
    pub fn apply_diffusion(&self, g: &[f64], rate: &mut [f64]) {
        rate.fill(0.0);
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || self.diffusion(g, rate),
        );
    }

    #[inline(always)]
    fn transport(&self, g: &[f64], rate: &mut [f64]) {
        match &self.flux {
            MassFlux::Faces { q, v } => self.upwind(q, v, g, rate),
            MassFlux::Centres { q, v } => {
                match self.drift.half_width() {
                    1 => self.central::<1>(q, v, g, rate),
                    2 => self.central::<2>(q, v, g, rate),
                    3 => self.central::<3>(q, v, g, rate),
                    _ => self.central::<4>(q, v, g, rate),
                }
                self.relax(g, rate);
                for &(cell, rate_of_g) in &self.open {
                    rate[cell] += rate_of_g * g[cell];
                }
            }
        }
    }

    #[inline(always)]
    fn relax(&self, g: &[f64], rate: &mut [f64]) {
        for &(n, m, k) in &self.relaxed {
            let flux = k * (g[m] - g[n]);
            rate[n] += flux;
            rate[m] -= flux;
        }
    }

    #[inline(always)]
    fn diffusion(&self, g: &[f64], rate: &mut [f64]) {
        match self.drift.half_width() {
            1 => self.diffuse::<1>(g, rate),
            2 => self.diffuse::<2>(g, rate),
            3 => self.diffuse::<3>(g, rate),
            _ => self.diffuse::<4>(g, rate),
        }
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
    /// same sign on both: exactly 0 for g = 1. One pass over the memory, all neighbours at once.
    #[inline(always)]
    fn central<const K: usize>(&self, a: &[f64], b: &[f64], g: &[f64], rate: &mut [f64]) {
        let [nq, nv] = self.mesh.cells();
        let mut halves = [0.0; K];
        for (half, c) in halves.iter_mut().zip(central(K)) {
            *half = 0.5 * c;
        }
        for (i, column) in self.active.iter().enumerate() {
            let out = &mut rate[i * nv..(i + 1) * nv];
            out[..column.start].fill(0.0);
            out[column.end..].fill(0.0);
            let row = |i: usize| i * nv..(i + 1) * nv;
            // A missing neighbour stands in as the cell itself: they exchange exactly nothing.
            let right = |l: usize| row(if i + l < nq { i + l } else { i });
            let left = |l: usize| row(if i >= l { i - l } else { i });
            let here = Row {
                g: &g[row(i)],
                a: &a[row(i)],
                b: &b[row(i)],
                g_right: std::array::from_fn(|l| &g[right(l + 1)]),
                a_right: std::array::from_fn(|l| &a[right(l + 1)]),
                g_left: std::array::from_fn(|l| &g[left(l + 1)]),
                a_left: std::array::from_fn(|l| &a[left(l + 1)]),
            };
            let low = column.start.max(K).min(column.end);
            let high = column.end.min(nv.saturating_sub(K)).max(low);
            for j in (column.start..low).chain(high..column.end) {
                out[j] = here.end(&halves, j);
            }
            let mut j = low;
            while j + LANES <= high {
                let value = here.exchange::<LANES>(&halves, j);
                out[j..j + LANES].copy_from_slice(&value);
                j += LANES;
            }
            for (j, out) in (j..high).zip(&mut out[j..high]) {
                [*out] = here.exchange::<1>(&halves, j);
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

    /// The faces of a column with room for the full stencil; none in a column shorter than it.
    #[inline(always)]
    fn inner_faces(&self, column: &Range<usize>) -> Range<usize> {
        let half = self.drift.half_width();
        let inner = column.start + half..(column.end + 1).saturating_sub(half);
        if inner.is_empty() {
            column.end..column.end
        } else {
            inner
        }
    }

    /// Adds -S^T (k S g), k the conductance of the faces. A tile of faces stays in the nearest cache.
    #[inline(always)]
    fn diffuse<const K: usize>(&self, g: &[f64], rate: &mut [f64]) {
        const TILE: usize = 64;
        /// A tile with the neighbours of its faces, for the widest stencil.
        const HELD: usize = TILE + 2 * 8;
        let nv = self.mesh.v.len();
        let mut stencil = [0.0; K];
        stencil.copy_from_slice(staggered(K));
        let (mut tilted, mut flux) = ([0.0; HELD], [0.0; HELD]);
        for (i, column) in self.active.iter().enumerate() {
            let row = i * nv;
            let (g, rate) = (&g[row..row + nv], &mut rate[row..row + nv]);
            let scale = self.weights.q[i];
            let inner = self.inner_faces(column);
            for j in
                (column.start + 1..inner.start).chain(inner.end.max(column.start + 1)..column.end)
            {
                let s = staggered(self.reach(column, j));
                let slope: f64 = s
                    .iter()
                    .enumerate()
                    .map(|(l, s)| {
                        s * (g[j + l] * self.tilt[j + l] - g[j - 1 - l] * self.tilt[j - 1 - l])
                    })
                    .sum();
                let flux = self.conductance[j] * scale * slope;
                for (l, s) in s.iter().enumerate() {
                    rate[j + l] -= s * flux;
                    rate[j - 1 - l] += s * flux;
                }
            }
            // Inner faces reach cells column.start..column.end; tiles of those cells, gathered.
            let mut first = if inner.is_empty() {
                column.end
            } else {
                column.start
            };
            while first < column.end {
                let cells = first..(first + TILE).min(column.end);
                // Held face p is face cells.start - (K - 1) + p, if it is an inner one.
                let low = inner
                    .start
                    .max((cells.start + 1).saturating_sub(K))
                    .min(inner.end);
                let high = inner.end.min(cells.end + K).max(low);
                let offset = low + K - 1 - cells.start;
                let n = high - low;
                flux[..offset].fill(0.0);
                flux[offset + n..cells.len() + 2 * K - 1].fill(0.0);
                let seen = low - K..high + K - 1;
                for ((r, g), tilt) in tilted
                    .iter_mut()
                    .zip(&g[seen.clone()])
                    .zip(&self.tilt[seen])
                {
                    *r = g * tilt;
                }
                let k = &self.conductance[low..high];
                let mut p = 0;
                while p + LANES <= n {
                    let slope = difference::<K, LANES>(&stencil, &tilted[p..p + LANES + 2 * K - 1]);
                    for x in 0..LANES {
                        flux[offset + p + x] = k[p + x] * scale * slope[x];
                    }
                    p += LANES;
                }
                for p in p..n {
                    let [slope] = difference::<K, 1>(&stencil, &tilted[p..p + 2 * K]);
                    flux[offset + p] = k[p] * scale * slope;
                }
                let out = &mut rate[cells.clone()];
                let mut p = 0;
                while p + LANES <= out.len() {
                    let sum = difference::<K, LANES>(&stencil, &flux[p..p + LANES + 2 * K - 1]);
                    for (out, sum) in out[p..p + LANES].iter_mut().zip(sum) {
                        *out += sum;
                    }
                    p += LANES;
                }
                for p in p..out.len() {
                    let [sum] = difference::<K, 1>(&stencil, &flux[p..p + 2 * K]);
                    out[p] += sum;
                }
                first = cells.end;
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
                } else if sum > 0.0 {
                    self.leaving.push((here, sum));
                }
            }
        }
    }

    /// Whether each unknown lies in the rim, beyond the last streamline.
    pub fn rim(&self) -> Vec<bool> {
        let column = |i: usize| self.active(i).map(move |j| self.weights.in_rim(i, j));
        (0..self.mesh.q.len()).flat_map(column).collect()
    }

    /// Couples each rim cell to its neighbours at the rate [`RIM_RATE`].
    fn relax_rim(&mut self) {
        let [nq, nv] = self.mesh.cells();
        let (rim, number) = (self.rim(), self.numbering());
        for i in 0..nq {
            for j in self.active(i) {
                let here = i * nv + j;
                let right = (i + 1 < nq).then_some(here + nv);
                let above = (j + 1 < nv).then_some(here + 1);
                for there in [right, above].into_iter().flatten() {
                    let other = number[there];
                    if other != usize::MAX && (rim[number[here]] || rim[other]) {
                        let smaller = 1.0 / self.inverse[here].max(self.inverse[there]);
                        self.relaxed.push((here, there, RIM_RATE * smaller));
                    }
                }
            }
        }
    }

    /// The spectral radius of the antisymmetric part of the generator, which is transport, and of its
    /// symmetric part, which is all that dissipates, by Lanczos' method with a margin of 2 %, 1/time.
    /// The numerical range in the inner product of the weights lies in the box \[-second, 0\] +
    /// i \[-first, first\]. For upwind drift, whose transport dissipates, from the
    /// bounds of [`Generator::rates`].
    pub fn radii(&self) -> (f64, f64) {
        let MassFlux::Centres { .. } = self.flux else {
            let (transport, diffusion) = self.rates();
            return (transport, transport + diffusion);
        };
        let root: Vec<f64> = self.inverse.iter().map(|x| x.sqrt()).collect();
        let mut g = vec![0.0; root.len()];
        let mut radius = |kind: Kind, part: &dyn Fn(&[f64], &mut [f64])| {
            largest(root.len(), kind, |x, y| {
                for ((g, x), root) in g.iter_mut().zip(x).zip(&root) {
                    *g = x * root;
                }
                part(&g, y);
                for (y, root) in y.iter_mut().zip(&root) {
                    *y *= root;
                }
            })
        };
        let transport = radius(Kind::Antisymmetric, &|g, rate| {
            self.apply_transport(g, rate);
            for &(n, m, k) in &self.relaxed {
                let flux = k * (g[m] - g[n]);
                rate[n] -= flux;
                rate[m] += flux;
            }
            for &(cell, rate_of_g) in &self.leaving {
                rate[cell] += rate_of_g * g[cell];
            }
        });
        let diffusion = radius(Kind::Symmetric, &|g, rate| {
            self.apply_diffusion(g, rate);
            self.relax(g, rate);
        });
        let leaving = self
            .leaving
            .iter()
            .map(|(cell, rate)| rate * self.inverse[*cell]);
        (transport, diffusion + leaving.fold(0.0, f64::max))
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

    /// S^T k S of one q-column over its factor of the weights, which friction and diffusion are -1/w_m
    /// times: symmetric, per active cell its diagonal and the entries left of it, nearest first.
    pub fn diffusion_bands(&self, i: usize) -> Vec<[f64; BANDS]> {
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
    pub fn five_point(&self) -> CsMat<f64> {
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
            for (row, column, value) in [(n, m, k), (n, n, -k), (m, n, k), (m, m, -k)] {
                add(row, column, value);
            }
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
                for &(n, m, k) in &self.relaxed {
                    for (row, column, value) in [(n, m, k), (n, n, -k), (m, n, k), (m, m, -k)] {
                        add(Part::Diffusion, row, column, value);
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

/// Diagonal and subdiagonals of friction and diffusion in a column, at the highest order.
pub const BANDS: usize = 8;

/// Cells worked on at once: one vector register of doubles, or two.
const LANES: usize = 8;

/// One q-column with its K neighbours on either side.
struct Row<'a, const K: usize> {
    g: &'a [f64],
    a: &'a [f64],
    b: &'a [f64],
    g_right: [&'a [f64]; K],
    a_right: [&'a [f64]; K],
    g_left: [&'a [f64]; K],
    a_left: [&'a [f64]; K],
}

impl<const K: usize> Row<'_, K> {
    /// What N cells from j on receive; all neighbours along v must exist.
    #[inline(always)]
    fn exchange<const N: usize>(&self, halves: &[f64; K], j: usize) -> [f64; N] {
        let load = |x: &[f64], at: usize| -> [f64; N] {
            let x = &x[at..at + N];
            std::array::from_fn(|k| x[k])
        };
        let (g, a, b) = (load(self.g, j), load(self.a, j), load(self.b, j));
        let mut sum = [0.0; N];
        for (l, c) in halves.iter().enumerate() {
            let right = (load(self.a_right[l], j), load(self.g_right[l], j));
            let left = (load(self.a_left[l], j), load(self.g_left[l], j));
            let above = (load(self.b, j + l + 1), load(self.g, j + l + 1));
            let below = (load(self.b, j - l - 1), load(self.g, j - l - 1));
            for k in 0..N {
                let along_q = (a[k] + left.0[k]) * (left.1[k] - g[k])
                    - (a[k] + right.0[k]) * (right.1[k] - g[k]);
                let along_v = (b[k] + below.0[k]) * (below.1[k] - g[k])
                    - (b[k] + above.0[k]) * (above.1[k] - g[k]);
                sum[k] += c * (along_q + along_v);
            }
        }
        sum
    }

    /// What cell j near an end of the row receives.
    fn end(&self, halves: &[f64; K], j: usize) -> f64 {
        let (g, a, b) = (self.g[j], self.a[j], self.b[j]);
        let mut sum = 0.0;
        for (l, c) in halves.iter().enumerate() {
            sum += c * (a + self.a_left[l][j]) * (self.g_left[l][j] - g);
            sum -= c * (a + self.a_right[l][j]) * (self.g_right[l][j] - g);
            if j > l {
                sum += c * (b + self.b[j - l - 1]) * (self.g[j - l - 1] - g);
            }
            if j + l + 1 < self.g.len() {
                sum -= c * (b + self.b[j + l + 1]) * (self.g[j + l + 1] - g);
            }
        }
        sum
    }
}

/// sum_l s_l (x[k + K + l] - x[k + K - 1 - l]) for k in 0..N.
#[inline(always)]
fn difference<const K: usize, const N: usize>(s: &[f64; K], x: &[f64]) -> [f64; N] {
    let load = |at: usize| -> [f64; N] {
        let x = &x[at..at + N];
        std::array::from_fn(|k| x[k])
    };
    let mut sum = [0.0; N];
    for (l, s) in s.iter().enumerate() {
        let (high, low) = (load(K + l), load(K - 1 - l));
        for k in 0..N {
            sum[k] += s * (high[k] - low[k]);
        }
    }
    sum
}

/// Refuses a mesh on which p_s falls by more than a factor e^{3.5} from one cell to the next anywhere
/// within the streamlines. A wide stencil reaches over several such cells: it keeps its stability, but
/// neither its order nor a useful step (a hundredth of the transport's at e^6 a cell, measured).
fn check_tail(mesh: &Mesh, weights: &Weights, active: &[Range<usize>], drift: Drift) -> Result<()> {
    /// Largest change of ln p_s per cell.
    const STEEPEST: f64 = 3.5;
    let [nq, nv] = mesh.cells();
    let density = |i: usize, j: usize| {
        (weights.q[i] * weights.v[j] / (mesh.q.slopes()[i] * mesh.v.slopes()[j])).ln()
    };
    let mut steepest = [0.0f64; 2];
    for (i, column) in active.iter().enumerate() {
        for j in column.clone().filter(|j| !weights.in_rim(i, *j)) {
            if i + 1 < nq && !weights.in_rim(i + 1, j) {
                steepest[0] = steepest[0].max((density(i + 1, j) - density(i, j)).abs());
            }
            if j + 1 < nv && !weights.in_rim(i, j + 1) {
                steepest[1] = steepest[1].max((density(i, j + 1) - density(i, j)).abs());
            }
        }
    }
    if steepest.iter().all(|s| *s <= STEEPEST) {
        return Ok(());
    }
    let needed = |n: usize, s: f64| (n as f64 * (1.1 * s / STEEPEST).max(1.0)).ceil();
    Err(Error::Mesh {
        what: format!(
            "with method.cells = [{nq}, {nv}], ln p_s falls by up to {:.1} per cell along q and {:.1} along \
             v, and drift of order {} carries {STEEPEST}",
            steepest[0],
            steepest[1],
            drift.order()
        ),
        help: format!(
            "about [{}, {}] cells, or a higher tolerance",
            needed(nq, steepest[0]),
            needed(nv, steepest[1])
        ),
    })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::ContactLaw;
    use crate::fokker_planck::mesh::Axis;

    #[test]
    fn the_matrix_free_generator_is_its_matrix_at_every_order() {
        for contact in [ContactLaw::Hertz, ContactLaw::Linear, ContactLaw::Free] {
            let it = Oscillator::new(contact, 0.05, 0.02).unwrap();
            let mesh = Mesh {
                q: Axis::uniform(-4.0, 3.5, 61).unwrap(),
                v: Axis::uniform(-3.0, 3.0, 75).unwrap(),
            };
            for drift in Drift::ALL {
                let generator = Generator::new(&it, &mesh, drift).unwrap();
                let g: Vec<f64> = (0..mesh.len())
                    .map(|k| ((k * 7919) % 1009) as f64)
                    .collect();
                let (mut whole, mut parts) = (vec![0.0; g.len()], vec![0.0; g.len()]);
                let mut other = parts.clone();
                generator.apply(&g, &mut whole);
                generator.apply_transport(&g, &mut parts);
                generator.apply_diffusion(&g, &mut other);
                let number = generator.numbering();
                let mut product = vec![0.0; generator.unknowns()];
                let matrix = generator.matrix();
                for (cell, column) in number.iter().enumerate().filter(|(_, n)| **n != usize::MAX) {
                    let p = g[cell] / generator.inverse_weights()[cell];
                    for (row, value) in matrix.outer_view(*column).unwrap().iter() {
                        product[row] += value * p;
                    }
                }
                let (mut worst, mut size): (f64, f64) = (0.0, 0.0);
                for (cell, n) in number.iter().enumerate() {
                    let exact = if *n == usize::MAX { 0.0 } else { product[*n] };
                    worst = worst.max((whole[cell] - exact).abs());
                    worst = worst.max((parts[cell] + other[cell] - exact).abs());
                    size = size.max(exact.abs());
                }
                println!(
                    "{} {drift:?}: {worst:.1e} of {size:.1e}",
                    it.contact().name()
                );
                assert!(worst < 1e-12 * size);
            }
        }
    }
}
