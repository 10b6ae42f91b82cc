//! The generator applied to a density without a matrix, vectorised along v.

use super::super::difference::{central, staggered};
use super::super::flux::MassFlux;
use super::Generator;
use std::ops::Range;

impl Generator {
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
    pub(super) fn transport(&self, g: &[f64], rate: &mut [f64]) {
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
    pub(super) fn relax(&self, g: &[f64], rate: &mut [f64]) {
        for &(n, m, k) in &self.relaxed {
            let flux = k * (g[m] - g[n]);
            rate[n] += flux;
            rate[m] -= flux;
        }
    }

    #[inline(always)]
    pub(super) fn diffusion(&self, g: &[f64], rate: &mut [f64]) {
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
    pub(super) fn reach(&self, column: &Range<usize>, j: usize) -> usize {
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
}

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
