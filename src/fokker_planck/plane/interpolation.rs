//! Interpolation by cardinal B-splines of degree 7 on a uniform mesh coordinate: order 8.
//!
//! f(x) = sum_k c_k B(x - k), the c_k from the values by a banded solve (Unser, IEEE Signal Process. Mag.
//! 16(6), 22, 1999). The support is that of the polynomial through as
//! many points, the error constant |B_n|/n! instead of (n-1)!!^2/(2^n n!): 1/1300 of it.
//! Values continue beyond the first and the last node by reflection there, so a constant stays one.

use crate::error::{Deadline, Result};
use crate::matrix::vectorise;

/// Order of accuracy, and number of points of the stencil.
pub(crate) const POINTS: usize = 8;

/// Coefficients beyond either end of the nodes.
pub(crate) const MARGIN: usize = POINTS / 2 - 1;

/// The weights of a stencil as polynomials of the place between two nodes.
#[derive(Debug, Clone)]
pub(crate) struct Spline {
    /// `table[p][r]`: coefficient of f^p in the weight of point r.
    table: [[f64; POINTS]; POINTS],
}

impl Spline {
    pub(crate) fn new() -> Self {
        // N[r] as a polynomial of f, raised degree by degree (de Boor).
        let mut basis = [[0.0; POINTS]; POINTS];
        basis[0][0] = 1.0;
        for p in 1..POINTS {
            let mut saved = [0.0; POINTS];
            for (r, entry) in basis[..p].iter_mut().enumerate() {
                let over = entry.map(|x| x / p as f64);
                // (r + 1 - f) over and (f + p - r - 1) over.
                let times = |constant: f64, slope: f64| -> [f64; POINTS] {
                    std::array::from_fn(|k| {
                        constant * over[k] + if k > 0 { slope * over[k - 1] } else { 0.0 }
                    })
                };
                let right = times((r + 1) as f64, -1.0);
                *entry = std::array::from_fn(|k| saved[k] + right[k]);
                saved = times((p - r - 1) as f64, 1.0);
            }
            basis[p] = saved;
        }
        let table = std::array::from_fn(|p| std::array::from_fn(|r| basis[r][p]));
        Self { table }
    }

    /// Weights of the points floor(x) - margin, ... for x = floor(x) + f.
    #[inline(always)]
    pub(crate) fn weights(&self, f: f64) -> [f64; POINTS] {
        let mut sum = self.table[POINTS - 1];
        for row in self.table[..POINTS - 1].iter().rev() {
            for r in 0..POINTS {
                sum[r] = sum[r].mul_add(f, row[r]);
            }
        }
        sum
    }

    /// First coefficient (counted from the first padded one) and place in between, for x clamped to the
    /// nodes 0..n.
    #[inline(always)]
    pub(crate) fn place(x: f64, n: usize) -> (usize, f64) {
        let x = x.clamp(0.0, (n - 1) as f64);
        let floor = x.floor().min((n - 2) as f64);
        (floor as usize, x - floor)
    }
}

/// From values at n nodes to spline coefficients: the banded interpolation matrix B(i - k), reflected
/// at both ends, as triangular factors. It is totally positive, so elimination needs no pivots.
#[derive(Debug, Clone)]
pub(crate) struct Filter {
    /// Per node the three multipliers below the diagonal, nearest first.
    lower: Vec<[f64; 3]>,
    /// Per node 1/pivot, and the three entries right of it over the pivot, nearest first.
    upper: Vec<[f64; 4]>,
}

/// Columns filtered together.
pub(crate) const PANEL: usize = 8;

impl Filter {
    pub(crate) fn new(n: usize) -> Self {
        const REACH: usize = MARGIN;
        // B at the integers: the weights of a stencil at a node.
        let at_node = Spline::new().weights(0.0);
        // Row i of the matrix from column i - 3; seven entries.
        let mut rows = vec![[0.0; 2 * REACH + 1]; n];
        for (i, row) in rows.iter_mut().enumerate() {
            for (r, b) in at_node[..=2 * MARGIN].iter().enumerate() {
                let column = reflected(i + r, n);
                row[column + REACH - i] += b;
            }
        }
        let (mut lower, mut upper) = (vec![[0.0; 3]; n], vec![[0.0; 4]; n]);
        for i in 0..n {
            let pivot = 1.0 / rows[i][REACH];
            upper[i] = std::array::from_fn(|k| {
                if k == 0 {
                    pivot
                } else {
                    rows[i][REACH + k] * pivot
                }
            });
            for below in 1..=REACH.min(n - 1 - i) {
                let factor = rows[i + below][REACH - below] * pivot;
                lower[i + below][below - 1] = factor;
                for k in 1..=REACH {
                    rows[i + below][REACH - below + k] -= factor * rows[i][REACH + k];
                }
            }
        }
        Self { lower, upper }
    }

    /// Turns rows of eight columns into coefficients along the rows' index, in place.
    #[inline(always)]
    pub(crate) fn apply(&self, panel: &mut [f64]) {
        let (rows, _) = panel.as_chunks_mut::<PANEL>();
        let (mut one, mut two, mut three) = ([0.0f64; PANEL], [0.0f64; PANEL], [0.0f64; PANEL]);
        for (row, [a, b, c]) in rows.iter_mut().zip(&self.lower) {
            let mut here = *row;
            for l in 0..PANEL {
                here[l] = (-c).mul_add(three[l], here[l]);
                here[l] = (-b).mul_add(two[l], here[l]);
                here[l] = (-a).mul_add(one[l], here[l]);
            }
            *row = here;
            (three, two, one) = (two, one, here);
        }
        (one, two, three) = ([0.0; PANEL], [0.0; PANEL], [0.0; PANEL]);
        for (row, [scale, a, b, c]) in rows.iter_mut().zip(&self.upper).rev() {
            let mut here = *row;
            for l in 0..PANEL {
                here[l] *= scale;
                here[l] = (-c).mul_add(three[l], here[l]);
                here[l] = (-b).mul_add(two[l], here[l]);
                here[l] = (-a).mul_add(one[l], here[l]);
            }
            *row = here;
            (three, two, one) = (two, one, here);
        }
    }
}

impl Filter {
    fn apply_vectorised(&self, panel: &mut [f64]) {
        vectorise!(self.apply(panel));
    }
}

/// Row `k` (counted from the margin before the first) of rows reflected at the first and last of `n`.
pub(crate) fn reflected(k: usize, n: usize) -> usize {
    let distance = k.abs_diff(MARGIN);
    if distance < n {
        distance
    } else {
        2 * (n - 1) - distance
    }
}

/// The matrix from n values to their n + 2 margin coefficients, row-major (n + 2 margin) x n, times a
/// matrix of n rows (the identity without one); ended by `late`, which is asked before each panel.
pub(crate) fn coefficients(n: usize, times: Option<&[f64]>, late: &Deadline) -> Result<Vec<f64>> {
    let filter = Filter::new(n);
    let mut panel = vec![0.0; n * PANEL];
    let mut matrix = vec![0.0; (n + 2 * MARGIN) * n];
    for first in (0..n).step_by(PANEL) {
        late()?;
        let width = PANEL.min(n - first);
        for (i, row) in panel.chunks_exact_mut(PANEL).enumerate() {
            for (c, x) in row[..width].iter_mut().enumerate() {
                let column = first + c;
                *x = times.map_or(f64::from(u8::from(i == column)), |m| m[i * n + column]);
            }
        }
        filter.apply_vectorised(&mut panel);
        for (k, out) in matrix.chunks_exact_mut(n).enumerate() {
            let row = reflected(k, n) * PANEL;
            out[first..first + width].copy_from_slice(&panel[row..row + width]);
        }
    }
    Ok(matrix)
}

/// Coefficients of the splines through an n x n array, along its rows or down its columns, in the same
/// places: without the reflected ones.
pub(crate) fn filter(
    filter: &Filter,
    values: &[f64],
    n: usize,
    along_rows: bool,
    coefficients: &mut [f64],
) {
    let (line, step) = if along_rows { (n, 1) } else { (1, n) };
    let mut panel = vec![0.0; n * PANEL];
    for first in (0..n).step_by(PANEL) {
        let lines = PANEL.min(n - first);
        for c in 0..lines {
            for k in 0..n {
                panel[k * PANEL + c] = values[(first + c) * line + k * step];
            }
        }
        filter.apply_vectorised(&mut panel);
        for c in 0..lines {
            for k in 0..n {
                coefficients[(first + c) * line + k * step] = panel[k * PANEL + c];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The spline through `f` at n nodes of [0, 1], at x.
    fn through(n: usize, f: impl Fn(f64) -> f64, x: f64) -> f64 {
        let values: Vec<f64> = (0..n).map(|k| f(k as f64 / (n - 1) as f64)).collect();
        let matrix = coefficients(n, None, &|| Ok(())).unwrap();
        let spline = Spline::new();
        let (first, place) = Spline::place(x * (n - 1) as f64, n);
        let weights = spline.weights(place);
        (0..POINTS)
            .map(|r| {
                let row = &matrix[(first + r) * n..(first + r + 1) * n];
                weights[r] * row.iter().zip(&values).map(|(a, b)| a * b).sum::<f64>()
            })
            .sum()
    }

    #[test]
    fn the_spline_goes_through_its_values_and_keeps_a_constant() {
        for n in [8, 11, 40] {
            let f = |x: f64| (7.0 * x).sin() + x;
            for k in 0..n {
                let x = k as f64 / (n - 1) as f64;
                let error = (through(n, f, x) - f(x)).abs();
                assert!(error < 1e-13, "{n} at node {k}: {error:e}");
            }
            for x in [-0.1, 0.0, 0.013, 0.5, 0.77, 1.0, 1.2] {
                assert!((through(n, |_| 1.0, x) - 1.0).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn the_spline_is_of_order_eight() {
        // Even about both ends, as the reflection takes it.
        let f = |x: f64| (3.0 * std::f64::consts::PI * x).cos();
        let worst = |n: usize| {
            (0..=1000)
                .map(|k| {
                    let x = f64::from(k) / 1000.0;
                    (through(n, f, x) - f(x)).abs()
                })
                .fold(0.0, f64::max)
        };
        let (coarse, fine) = (worst(25), worst(49));
        let rate = (coarse / fine).log2();
        println!("{coarse:.2e}, {fine:.2e}, order {rate:.2}");
        assert!((rate - POINTS as f64).abs() < 0.3);
        // |B_8|/8! (k dx)^8 times at most 2 at the middle of a cell.
        let reach = 3.0 * std::f64::consts::PI / 48.0;
        assert!(fine < 2.2 / 1_209_600.0 * reach.powi(POINTS as i32));
    }
}
