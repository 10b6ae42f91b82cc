//! The generator applied to a density without a matrix, vectorised along v, columns shared among threads.

use super::super::difference::{central, staggered};
use super::super::flux::MassFlux;
use super::Generator;
use crate::matrix::vectorise;
use rayon::prelude::*;
use std::ops::Range;

/// Cells from which on the work of a stage is worth sharing between threads, and cells that one takes at a
/// time: at some 7 ns each, six and two hundredths of a millisecond, where a fork takes a few microseconds.
const SHARED: usize = 8000;
const SHARE: usize = 3000;

impl Generator {
    /// Columns that a thread takes at a time: all, where they are too few to be shared.
    pub(crate) fn share(&self) -> usize {
        let [nq, nv] = self.mesh.cells();
        if nq * nv < SHARED || rayon::current_num_threads() == 1 {
            nq
        } else {
            SHARE.div_ceil(nv)
        }
    }

    /// `rate = d(w g)/dt` for every cell, row-major; 0 where there is no unknown.
    pub fn apply(&self, g: &[f64], rate: &mut [f64]) {
        self.in_shares(rate, |columns, rate| self.apply_to(columns, g, rate));
    }

    /// [`Generator::apply`] for some columns, whose cells `rate` holds.
    pub(crate) fn apply_to(&self, columns: Range<usize>, g: &[f64], rate: &mut [f64]) {
        self.part::<true, true>(columns, g, rate);
    }

    /// The part of [`Generator::apply`] that couples cells along q: transport, with the exchange among
    /// boundary cells and what leaves through open edges.
    pub(crate) fn apply_transport(&self, g: &[f64], rate: &mut [f64]) {
        self.in_shares(rate, |columns, rate| self.transport_to(columns, g, rate));
    }

    /// [`Generator::apply_transport`] for some columns, whose cells `rate` holds.
    pub(crate) fn transport_to(&self, columns: Range<usize>, g: &[f64], rate: &mut [f64]) {
        self.part::<true, false>(columns, g, rate);
    }

    /// The part of [`Generator::apply`] that couples cells along v alone: friction and diffusion.
    pub(crate) fn apply_diffusion(&self, g: &[f64], rate: &mut [f64]) {
        self.in_shares(rate, |columns, rate| {
            rate.fill(0.0);
            self.part::<false, true>(columns, g, rate);
        });
    }

    fn part<const TRANSPORT: bool, const DIFFUSION: bool>(
        &self,
        columns: Range<usize>,
        g: &[f64],
        rate: &mut [f64],
    ) {
        vectorise!({
            if TRANSPORT {
                self.transport(&columns, g, rate);
            }
            if DIFFUSION {
                self.diffusion(&columns, g, rate);
            }
        });
    }

    /// Calls `work` for all columns, a share at a time, each with its cells of `rate`.
    fn in_shares(&self, rate: &mut [f64], work: impl Fn(Range<usize>, &mut [f64]) + Sync) {
        let [nq, nv] = self.mesh.cells();
        let share = self.share();
        if share == nq {
            return work(0..nq, rate);
        }
        let shares = rate.par_chunks_mut(share * nv).enumerate();
        shares.for_each(|(k, rate)| {
            let first = k * share;
            work(first..first + rate.len() / nv, rate);
        });
    }

    #[inline(always)]
    fn transport(&self, columns: &Range<usize>, g: &[f64], rate: &mut [f64]) {
        match &self.flux {
            MassFlux::Faces { q, v } => self.upwind(columns, q, v, g, rate),
            MassFlux::Centres { q, v } => {
                match self.drift.half_width() {
                    1 => self.central::<1>(columns, q, v, g, rate),
                    2 => self.central::<2>(columns, q, v, g, rate),
                    3 => self.central::<3>(columns, q, v, g, rate),
                    _ => self.central::<4>(columns, q, v, g, rate),
                }
                self.relax(columns, g, rate);
                let nv = self.mesh.v.len();
                for &(cell, rate_of_g) in of_columns(&self.open, columns, nv, |it| it.0) {
                    rate[cell - columns.start * nv] += rate_of_g * g[cell];
                }
            }
        }
    }

    #[inline(always)]
    pub(super) fn relax(&self, columns: &Range<usize>, g: &[f64], rate: &mut [f64]) {
        let nv = self.mesh.v.len();
        for &(n, m, k) in of_columns(&self.relaxed, columns, nv, |it| it.0) {
            rate[n - columns.start * nv] += k * (g[m] - g[n]);
        }
    }

    #[inline(always)]
    fn diffusion(&self, columns: &Range<usize>, g: &[f64], rate: &mut [f64]) {
        match self.drift.half_width() {
            1 => self.diffuse::<1>(columns, g, rate),
            2 => self.diffuse::<2>(columns, g, rate),
            3 => self.diffuse::<3>(columns, g, rate),
            _ => self.diffuse::<4>(columns, g, rate),
        }
    }

    #[inline(always)]
    fn upwind(
        &self,
        columns: &Range<usize>,
        flux_q: &[f64],
        flux_v: &[f64],
        g: &[f64],
        rate: &mut [f64],
    ) {
        let [nq, nv] = self.mesh.cells();
        for (i, rate) in columns.clone().zip(rate.chunks_exact_mut(nv)) {
            let (row, faces) = (i * nv, i * (nv + 1));
            for j in 0..nv {
                let here = g[row + j];
                let left = if i > 0 { g[row - nv + j] } else { 0.0 };
                let right = if i + 1 < nq { g[row + nv + j] } else { 0.0 };
                let below = if j > 0 { g[row + j - 1] } else { 0.0 };
                let above = if j + 1 < nv { g[row + j + 1] } else { 0.0 };
                let carried = |m: f64, from: f64, to: f64| m.max(0.0) * from + m.min(0.0) * to;
                rate[j] = carried(flux_q[row + j], left, here)
                    - carried(flux_q[row + nv + j], here, right)
                    + carried(flux_v[faces + j], below, here)
                    - carried(flux_v[faces + j + 1], here, above);
            }
        }
    }

    /// Every pair of cells (n, m) a distance l apart exchanges c_l (a_n + a_m)/2 (g_m - g_n), with the
    /// same sign on both: exactly 0 for g = 1. One pass over the memory, all neighbours at once.
    #[inline(always)]
    fn central<const K: usize>(
        &self,
        columns: &Range<usize>,
        a: &[f64],
        b: &[f64],
        g: &[f64],
        rate: &mut [f64],
    ) {
        let [nq, nv] = self.mesh.cells();
        let mut halves = [0.0; K];
        for (half, c) in halves.iter_mut().zip(central(K)) {
            *half = 0.5 * c;
        }
        for (i, out) in columns.clone().zip(rate.chunks_exact_mut(nv)) {
            let column = &self.active[i];
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
            if low < high {
                here.exchange(&halves, low..high, &mut out[low..high]);
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
    fn diffuse<const K: usize>(&self, columns: &Range<usize>, g: &[f64], rate: &mut [f64]) {
        let nv = self.mesh.v.len();
        let mut stencil = [0.0; K];
        stencil.copy_from_slice(staggered(K));
        let (mut tilted, mut flux) = ([0.0; HELD], [0.0; HELD]);
        for (i, rate) in columns.clone().zip(rate.chunks_exact_mut(nv)) {
            let (column, row) = (&self.active[i], i * nv);
            let g = &g[row..row + nv];
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
                while p < n {
                    // The last lanes overlap with those before.
                    let from = p.min(n.saturating_sub(LANES));
                    let slope = difference(&stencil, &tilted, from);
                    for x in 0..LANES.min(n) {
                        flux[offset + from + x] = k[from + x] * scale * slope[x];
                    }
                    p = from + LANES;
                }
                let out = &mut rate[cells.clone()];
                let mut p = 0;
                while p < out.len() {
                    let from = p.min(out.len().saturating_sub(LANES));
                    let sum = difference(&stencil, &flux, from);
                    for (out, sum) in out[p..].iter_mut().zip(&sum[p - from..]) {
                        *out += sum;
                    }
                    p = from + LANES;
                }
                first = cells.end;
            }
        }
    }
}

/// Those of a list, ordered by their cells, that lie in some columns of nv cells.
fn of_columns<'a, T>(
    list: &'a [T],
    columns: &Range<usize>,
    nv: usize,
    cell: impl Fn(&T) -> usize,
) -> &'a [T] {
    let place = |column: usize| list.partition_point(|it| cell(it) < column * nv);
    &list[place(columns.start)..place(columns.end)]
}

/// Cells of a column whose faces are worked out together: they stay in the nearest cache.
const TILE: usize = 64;

/// A tile with the neighbours of its faces, for the widest stencil.
const HELD: usize = TILE + 2 * 8;

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

impl<'a, const K: usize> Row<'a, K> {
    /// What some cells receive; all their neighbours along v must exist.
    #[inline(always)]
    fn exchange(&self, halves: &[f64; K], cells: Range<usize>, out: &mut [f64]) {
        let whole = cells.len() / LANES;
        // Slices of one length, so that it is checked once.
        let lanes = |x: &'a [f64], from: usize| -> &'a [[f64; LANES]] {
            &x[from..from + whole * LANES].as_chunks().0[..whole]
        };
        let from = cells.start;
        let (g, a, b) = (
            lanes(self.g, from),
            lanes(self.a, from),
            lanes(self.b, from),
        );
        let g_right: [_; K] = std::array::from_fn(|l| lanes(self.g_right[l], from));
        let a_right: [_; K] = std::array::from_fn(|l| lanes(self.a_right[l], from));
        let g_left: [_; K] = std::array::from_fn(|l| lanes(self.g_left[l], from));
        let a_left: [_; K] = std::array::from_fn(|l| lanes(self.a_left[l], from));
        let g_above: [_; K] = std::array::from_fn(|l| lanes(self.g, from + l + 1));
        let b_above: [_; K] = std::array::from_fn(|l| lanes(self.b, from + l + 1));
        let g_below: [_; K] = std::array::from_fn(|l| lanes(self.g, from - l - 1));
        let b_below: [_; K] = std::array::from_fn(|l| lanes(self.b, from - l - 1));
        let (full, rest) = out.as_chunks_mut::<LANES>();
        for (c, out) in full.iter_mut().enumerate() {
            let (g, a, b) = (&g[c], &a[c], &b[c]);
            let mut sum = [0.0; LANES];
            for l in 0..K {
                let along_q = pair(
                    g,
                    a,
                    (&g_left[l][c], &a_left[l][c]),
                    (&g_right[l][c], &a_right[l][c]),
                );
                let along_v = pair(
                    g,
                    b,
                    (&g_below[l][c], &b_below[l][c]),
                    (&g_above[l][c], &b_above[l][c]),
                );
                for k in 0..LANES {
                    sum[k] = halves[l].mul_add(along_q[k] + along_v[k], sum[k]);
                }
            }
            *out = sum;
        }
        for (j, out) in (cells.end - rest.len()..).zip(rest) {
            *out = self.end(halves, j);
        }
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

/// (a + a_-)(g_- - g) - (a + a_+)(g_+ - g), of neighbours (g, a) on either side.
#[inline(always)]
fn pair(
    g: &[f64; LANES],
    a: &[f64; LANES],
    before: (&[f64; LANES], &[f64; LANES]),
    after: (&[f64; LANES], &[f64; LANES]),
) -> [f64; LANES] {
    std::array::from_fn(|k| {
        let gone = (a[k] + after.1[k]) * (after.0[k] - g[k]);
        (a[k] + before.1[k]).mul_add(before.0[k] - g[k], -gone)
    })
}

/// sum_l s_l (x[k + K + l] - x[k + K - 1 - l]) for [`LANES`] k from `from` on.
#[inline(always)]
fn difference<const K: usize>(s: &[f64; K], x: &[f64; HELD], from: usize) -> [f64; LANES] {
    let load = |at: usize| -> [f64; LANES] {
        let x = &x[at..at + LANES];
        std::array::from_fn(|k| x[k])
    };
    let mut sum = [0.0; LANES];
    for (l, s) in s.iter().enumerate() {
        let (high, low) = (load(from + K + l), load(from + K - 1 - l));
        for k in 0..LANES {
            sum[k] = s.mul_add(high[k] - low[k], sum[k]);
        }
    }
    sum
}
