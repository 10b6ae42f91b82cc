//! The two passes of a step: g carried along the motion, and averaged along v.

use super::super::interpolation::{self, Filter, MARGIN, PANEL, POINTS};
use super::rows::Rows;
use crate::error::{Deadline, Result};
use crate::matrix::vectorised;
use rayon::prelude::*;
use std::ops::Range;

/// Weights per cell: along q and along v.
pub(super) const STENCIL: usize = 2 * POINTS;

/// Working space of a step.
#[derive(Debug, Clone)]
pub(super) struct Buffers {
    /// Values to coefficients along q.
    pub(super) filter: Filter,
    /// g, nq x nv.
    pub(super) values: Vec<f64>,
    /// Spline coefficients by groups of eight columns, nq x 8 each.
    pub(super) panels: Vec<f64>,
    /// Spline coefficients with their margins, (nq + 2 margin) x stride.
    pub(super) coefficients: Vec<f64>,
    pub(super) stride: usize,
}

/// Where each active cell takes its value from, after one part of H.
#[derive(Debug, Clone)]
pub(super) struct Map {
    /// First coefficient of the stencil.
    pub(super) places: Vec<u32>,
    /// Weights along q, then along v, per cell.
    pub(super) weights: Vec<f64>,
}

/// A matrix from nv values to coefficients, by groups of eight rows, transposed: nv x 8 each.
#[derive(Debug, Clone)]
pub(super) struct Matrix {
    pub(super) panels: Vec<f64>,
    /// Per group the values that count: beyond them all entries are below rounding.
    pub(super) ranges: Vec<Range<usize>>,
}

/// Matrices along v, each for some rows.
pub(super) type Blocks = Vec<(Range<usize>, Matrix)>;

/// Entries of a matrix that count for nothing, over the largest one.
const NEGLIGIBLE: f64 = 1e-20;

impl Buffers {
    /// values <- the spline, at the departure points.
    pub(super) fn carry(
        &mut self,
        nv: usize,
        map: &Map,
        Rows {
            active,
            offsets,
            beyond,
            ..
        }: &Rows,
        share: bool,
    ) {
        /// Rows per task.
        const ROWS: usize = 4;
        let (coefficients, stride) = (&self.coefficients[..], self.stride);
        let rows = |(group, values): (usize, &mut [f64])| {
            vectorised(
                #[inline(always)]
                move || {
                    for (i, row) in (group * ROWS..).zip(values.chunks_exact_mut(nv)) {
                        let (range, cells) = (active[i].clone(), offsets[i]..offsets[i + 1]);
                        let places = &map.places[cells.clone()];
                        let weights = &map.weights[cells.start * STENCIL..cells.end * STENCIL];
                        let out = &mut row[range.clone()];
                        gather(places, weights, coefficients, stride, out);
                        let (first, last) = (row[range.start], row[range.end - 1]);
                        let beyond = &beyond[i * nv..(i + 1) * nv];
                        for (x, share) in row[..range.start].iter_mut().zip(beyond) {
                            *x = first * share;
                        }
                        for (x, share) in row[range.end..].iter_mut().zip(&beyond[range.end..]) {
                            *x = last * share;
                        }
                    }
                },
            );
        };
        if share {
            let groups = self.values.par_chunks_mut(ROWS * nv);
            groups.enumerate().for_each(rows);
        } else {
            self.values.chunks_mut(ROWS * nv).enumerate().for_each(rows);
        }
    }

    /// coefficients <- those of the values, averaged along v by the matrices, each for some rows.
    pub(super) fn average(&mut self, nv: usize, matrices: &[(Range<usize>, Matrix)], share: bool) {
        let (values, nq, filter) = (&self.values[..], self.values.len() / nv, &self.filter);
        let panel = |(number, panel): (usize, &mut [f64])| {
            vectorised(
                #[inline(always)]
                move || {
                    for (rows, matrix) in matrices {
                        let size = nv * PANEL;
                        let values = &values[rows.start * nv..rows.end * nv];
                        let panel = &mut panel[rows.start * PANEL..rows.end * PANEL];
                        let entries = &matrix.panels[number * size..(number + 1) * size];
                        product(values, nv, entries, matrix.ranges[number].clone(), panel);
                    }
                    filter.apply(panel);
                },
            );
        };
        if share {
            let panels = self.panels.par_chunks_mut(nq * PANEL);
            panels.enumerate().for_each(panel);
        } else {
            let panels = self.panels.chunks_mut(nq * PANEL);
            panels.enumerate().for_each(panel);
        }
        let panels = &self.panels[..];
        let row = |(k, row): (usize, &mut [f64])| {
            let i = interpolation::reflected(k, nq);
            for (p, out) in row.chunks_exact_mut(PANEL).enumerate() {
                let from = (p * nq + i) * PANEL;
                out.copy_from_slice(&panels[from..from + PANEL]);
            }
        };
        if share {
            let rows = self.coefficients.par_chunks_mut(self.stride);
            rows.enumerate().with_min_len(16).for_each(row);
        } else {
            let rows = self.coefficients.chunks_mut(self.stride);
            rows.enumerate().for_each(row);
        }
    }
}

/// out_p = sum over the points around each place, weights along q and along v per cell.
#[inline(always)]
fn gather(places: &[u32], weights: &[f64], coefficients: &[f64], stride: usize, out: &mut [f64]) {
    let cells = places.iter().zip(weights.chunks_exact(STENCIL)).zip(out);
    for ((place, weights), out) in cells {
        let (along_q, along_v) = weights.split_at(POINTS);
        let from = &coefficients[*place as usize..];
        let mut sum = [0.0f64; POINTS];
        for (r, w) in along_q.iter().enumerate() {
            let row = &from[r * stride..r * stride + POINTS];
            for l in 0..POINTS {
                sum[l] = w.mul_add(row[l], sum[l]);
            }
        }
        let mut pairs = [0.0f64; 4];
        for l in 0..POINTS {
            pairs[l % 4] = sum[l].mul_add(along_v[l], pairs[l % 4]);
        }
        *out = (pairs[0] + pairs[2]) + (pairs[1] + pairs[3]);
    }
}

/// panel (rows x 8) = values (rows x n) times matrix (n x 8), within `range` of n.
#[inline(always)]
fn product(values: &[f64], n: usize, matrix: &[f64], range: Range<usize>, panel: &mut [f64]) {
    const ROWS: usize = 4;
    let matrix = &matrix[range.start * PANEL..range.end * PANEL];
    let mut blocks = values.chunks_exact(ROWS * n);
    let mut outs = panel.chunks_exact_mut(ROWS * PANEL);
    for (block, out) in blocks.by_ref().zip(outs.by_ref()) {
        let mut sum = [[0.0f64; PANEL]; ROWS];
        let rows: [&[f64]; ROWS] =
            std::array::from_fn(|r| &block[r * n + range.start..r * n + range.end]);
        for (k, m) in matrix.chunks_exact(PANEL).enumerate() {
            for r in 0..ROWS {
                let g = rows[r][k];
                for c in 0..PANEL {
                    sum[r][c] = g.mul_add(m[c], sum[r][c]);
                }
            }
        }
        for (out, sum) in out.chunks_exact_mut(PANEL).zip(&sum) {
            out.copy_from_slice(sum);
        }
    }
    let rest = blocks.remainder().chunks_exact(n);
    for (row, out) in rest.zip(outs.into_remainder().chunks_exact_mut(PANEL)) {
        let mut sum = [0.0f64; PANEL];
        for (g, m) in row[range.clone()].iter().zip(matrix.chunks_exact(PANEL)) {
            for c in 0..PANEL {
                sum[c] = g.mul_add(m[c], sum[c]);
            }
        }
        out.copy_from_slice(&sum);
    }
}

impl Matrix {
    /// Coefficients of the averaged values, of values; without `average` those of the values themselves.
    pub(super) fn new(
        (n, stride): (usize, usize),
        average: Option<&[f64]>,
        late: &Deadline,
    ) -> Result<Self> {
        let width = n + 2 * MARGIN;
        // From values to coefficients.
        let filter = interpolation::coefficients(n, None, late)?;
        let dense = match average {
            None => filter,
            Some(average) => {
                // Values to averaged values, then to coefficients.
                let mut averaged = vec![0.0; n * n];
                for (row, out) in average
                    .chunks_exact(width)
                    .zip(averaged.chunks_exact_mut(n))
                {
                    late()?;
                    for (x, filter) in row.iter().zip(filter.chunks_exact(n)) {
                        if *x != 0.0 {
                            for (out, f) in out.iter_mut().zip(filter) {
                                *out += x * f;
                            }
                        }
                    }
                }
                interpolation::coefficients(n, Some(&averaged), late)?
            }
        };
        let mut panels = vec![0.0; stride * n];
        for (k, row) in dense.chunks_exact(n).enumerate() {
            let panel = &mut panels[k / PANEL * PANEL * n..];
            for (j, x) in row.iter().enumerate() {
                panel[j * PANEL + k % PANEL] = *x;
            }
        }
        let ranges = panels
            .chunks_exact(PANEL * n)
            .map(|panel| {
                let peak = panel.iter().fold(0.0f64, |a, x| a.max(x.abs()));
                let counts = |row: &[f64]| row.iter().any(|x| x.abs() > NEGLIGIBLE * peak);
                let first = panel.chunks_exact(PANEL).position(counts).unwrap_or(0);
                let last = panel.chunks_exact(PANEL).rposition(counts).unwrap_or(0);
                first..last + 1
            })
            .collect();
        Ok(Self { panels, ranges })
    }
}
