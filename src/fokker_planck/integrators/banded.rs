//! The implicit part of a split step: (I - a B) g' = g with B friction and diffusion, which couples the
//! cells of one q-column only. One symmetric banded factorisation per column, eight columns side by side.

use crate::error::{Error, Result};
use crate::fokker_planck::generator::{BANDS, Generator};
use crate::matrix::vectorise;
use std::ops::Range;

/// Columns worked on at once.
pub(super) const LANES: usize = 8;

/// One row of a block: its entries for all lanes.
pub(super) type Lanes = [f64; LANES];

/// L D L^T of w/tilt + a S^T k S for every q-column, w over its factor of the column, where
/// B = -S^T k S/w on r = g tilt.
pub(super) struct Banded {
    blocks: Vec<Block>,
    /// 1/tilt per v cell.
    out: Vec<f64>,
    nv: usize,
}

struct Block {
    /// Cells along v that any of the columns holds.
    rows: Range<usize>,
    /// Per row: 1/D, then the entries of L left of the diagonal, nearest first.
    factors: Vec<[Lanes; BANDS]>,
    /// Per row: w over its factor of the column; 0 where there is no unknown.
    weights: Vec<Lanes>,
}

impl Banded {
    pub(super) fn new(generator: &Generator, a: f64) -> Result<Self> {
        let [nq, nv] = generator.mesh().cells();
        let weights = generator.weights();
        let tilt = generator.tilt();
        let mut blocks = Vec::new();
        for first in (0..nq).step_by(LANES) {
            let columns = LANES.min(nq - first);
            let ranges = (first..first + columns).map(|i| generator.active(i));
            let rows = ranges.filter(|range| !range.is_empty());
            let rows = rows.reduce(|a, b| a.start.min(b.start)..a.end.max(b.end));
            let rows = rows.unwrap_or(0..0);
            // A cell without an unknown stays as it is.
            let mut identity = [[0.0; LANES]; BANDS];
            identity[0] = [1.0; LANES];
            let mut factors = vec![identity; rows.len()];
            let mut held = vec![[0.0; LANES]; rows.len()];
            for lane in 0..columns {
                let column = generator.active(first + lane);
                let mut matrix = generator.diffusion_bands(first + lane);
                for (bands, j) in matrix.iter_mut().zip(column.clone()) {
                    let w = weights.at(first + lane, j) / weights.q[first + lane];
                    held[j - rows.start][lane] = w;
                    for entry in bands.iter_mut() {
                        *entry *= a;
                    }
                    bands[0] += w / tilt[j];
                }
                factor(&mut matrix);
                for (bands, row) in matrix.iter().zip(column.start - rows.start..) {
                    for (entry, to) in bands.iter().zip(&mut factors[row]) {
                        to[lane] = *entry;
                    }
                }
            }
            let finite = |bands: &[Lanes; BANDS]| bands.iter().flatten().all(|x| x.is_finite());
            if !factors.iter().all(finite) {
                let what = format!("not positive definite with a step of {a:e}");
                return Err(Error::linear("banded factorisation", what));
            }
            blocks.push(Block {
                rows,
                factors,
                weights: held,
            });
        }
        Ok(Self {
            out: tilt.iter().map(|t| 1.0 / t).collect(),
            blocks,
            nv,
        })
    }

    /// Replaces g on some columns, from the first of a block to the last of one, by the solution; `work` is
    /// one row of lanes per v cell.
    pub(super) fn solve(&self, columns: &Range<usize>, g: &mut [f64], work: &mut [Lanes]) {
        let blocks = &self.blocks[columns.start / LANES..columns.end.div_ceil(LANES)];
        vectorise!({
            for (block, g) in blocks.iter().zip(g.chunks_mut(LANES * self.nv)) {
                self.solve_block(block, g, work);
            }
        });
    }

    #[inline(always)]
    fn solve_block(&self, block: &Block, g: &mut [f64], work: &mut [Lanes]) {
        let n = block.rows.len();
        let work = &mut work[..n];
        let out = &self.out[block.rows.clone()];
        work.fill([0.0; LANES]);
        for (lane, column) in g.chunks_exact(self.nv).enumerate() {
            let cells = column[block.rows.clone()].iter().zip(&block.weights);
            for (row, (g, w)) in work.iter_mut().zip(cells) {
                row[lane] = g * w[lane];
            }
        }
        // L y = b, then D^-1.
        let mut held = [[0.0; LANES]; BANDS - 1];
        for (row, factors) in work.iter_mut().zip(&block.factors) {
            let mut sum = *row;
            for (entry, before) in factors[1..].iter().zip(&held) {
                for k in 0..LANES {
                    sum[k] = (-entry[k]).mul_add(before[k], sum[k]);
                }
            }
            held.copy_within(0..BANDS - 2, 1);
            held[0] = sum;
            for k in 0..LANES {
                row[k] = sum[k] * factors[0][k];
            }
        }
        // L^T x = y: each solved row is taken from those that see it. `owed` is the part still to be
        // taken from the rows below.
        let mut owed = [[0.0; LANES]; BANDS - 1];
        for (row, factors) in work.iter_mut().zip(&block.factors).rev() {
            for k in 0..LANES {
                row[k] -= owed[0][k];
            }
            owed.copy_within(1..BANDS - 1, 0);
            owed[BANDS - 2] = [0.0; LANES];
            for (owed, entry) in owed.iter_mut().zip(&factors[1..]) {
                for k in 0..LANES {
                    owed[k] = entry[k].mul_add(row[k], owed[k]);
                }
            }
        }
        for (lane, column) in g.chunks_exact_mut(self.nv).enumerate() {
            for ((row, g), out) in work.iter().zip(&mut column[block.rows.clone()]).zip(out) {
                *g = row[lane] * out;
            }
        }
    }
}

/// L D L^T in place; the diagonal is left as 1/D.
fn factor(matrix: &mut [[f64; BANDS]]) {
    for j in 0..matrix.len() {
        let mut row = matrix[j];
        // row[m] is the entry (j, j - m); from the far end towards the diagonal.
        for m in (1..BANDS.min(j + 1)).rev() {
            let mut sum = row[m];
            for far in m + 1..BANDS.min(j + 1) {
                // Sum over k = j - far of L_jk D_k L_{j-m,k}; row[far] still holds L_jk D_k.
                sum -= row[far] * matrix[j - m][far - m];
            }
            row[m] = sum;
        }
        for m in 1..BANDS.min(j + 1) {
            let scaled = row[m] * matrix[j - m][0];
            row[0] -= scaled * row[m];
            row[m] = scaled;
        }
        row[0] = 1.0 / row[0];
        matrix[j] = row;
    }
}
