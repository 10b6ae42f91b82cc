//! The mean time to the first loss by Pontryagin's equation L m = -1, and the slowest mode of the absorbed
//! motion, from one Krylov space of the survival over a few steps.
//!
//! With P the survival over a step tau, the sums X = sum_n P^n u of the survivals solve (I - P) X = u, and
//! with B = P^k so that B forgets part of the start, (I - B) X = u + P u + ... + P^(k-1) u. GMRES (Saad and
//! Schultz, SIAM J. Sci. Stat. Comput. 7, 1986, 856) solves it, and the Ritz values of its space hold the
//! slowest mode (Arnoldi).

use super::absorbed::Absorbed;
use crate::error::Result;
use crate::matrix::{dot, norm};
use crate::sparse;
use ndarray::Array2;
use num_complex::Complex;

/// Vectors of the space.
const VECTORS: usize = 16;
/// Spaces built one after another, at the most.
const CYCLES: usize = 12;
/// What the long run of an absorbed motion is.
#[derive(Debug, Clone)]
pub(crate) struct LongRun {
    /// X = sum over n of the survivals; None where losses are so rare that it is the slowest mode alone.
    pub(crate) sum: Option<Vec<f64>>,
    /// The slowest mode, and its factor over a step.
    pub(crate) mode: Vec<f64>,
    pub(crate) factor: f64,
    /// Relative errors of the sum and of 1 - factor that the iteration leaves.
    pub(crate) residuals: [f64; 2],
    /// Steps taken.
    pub(crate) steps: u64,
}

/// `stride` steps a Krylov vector; ends at the relative errors `enough`; `rare` says of a mode whether the
/// sum can be told from it at all; `late` stops it.
///
/// (I - B) all but annihilates the slowest mode phi where losses are rare, and GMRES does not see it: what is left is
/// projected on it by its left eigenvector, which detailed balance gives, p_s(q, v) phi(q, -v). Where the law is not
/// exp(-H/T)/Z that vector is near enough for the projection to shrink the rest from cycle to cycle.
pub(crate) fn long_run(
    absorbed: &Absorbed,
    (stationary, nv): (&[f64], usize),
    stride: usize,
    enough: f64,
    rare: &dyn Fn(&[f64]) -> bool,
    late: &dyn Fn() -> Result<()>,
) -> Result<LongRun> {
    let n = absorbed.len();
    let mut scratch = vec![0.0; n];
    let mut steps = 0;
    let mut several = |field: &[f64], sum: Option<&mut [f64]>| -> Result<Vec<f64>> {
        late()?;
        let mut field = field.to_vec();
        let mut sum = sum;
        for _ in 0..stride {
            if let Some(sum) = sum.as_deref_mut() {
                for (s, u) in sum.iter_mut().zip(&field) {
                    *s += u;
                }
            }
            absorbed.advance(&mut field, &mut scratch);
        }
        steps += stride as u64;
        Ok(field)
    };
    // Survival after the first step, and the sum of the first `stride`.
    let survival: Vec<f64> = absorbed
        .lost_first()
        .iter()
        .map(|lost| 1.0 - lost)
        .collect();
    let mut given = vec![0.0; n];
    several(&survival, Some(&mut given))?;
    let size = norm(&given);
    // The part of a field along the slowest mode.
    let along = |mode: &[f64], field: &[f64]| -> f64 {
        let rows = mode
            .chunks_exact(nv)
            .zip(stationary.chunks_exact(nv))
            .zip(field.chunks_exact(nv));
        let row = |((mode, weights), field): ((&[f64], &[f64]), &[f64])| -> f64 {
            let reversed = mode.iter().rev().zip(weights).zip(field);
            reversed.map(|((m, w), x)| m * w * x).sum()
        };
        rows.map(row).sum()
    };

    let mut sum = vec![0.0; n];
    let mut left = given.clone();
    let mut mode = given.clone();
    let (mut factor, mut unlike) = (1.0f64, f64::INFINITY);
    let mut residuals = [1.0, 1.0];
    for cycle in 0..CYCLES {
        // The mode first, as far as half the spaces bring it, then the sum.
        let solving = residuals[1] <= enough || cycle >= CYCLES / 2;
        let from = if solving { &left } else { &mode };
        let space = Space::of(from, &mut |field| several(field, None))?;
        if !solving {
            let (vector, value, residual) = space.slowest()?;
            if residual < unlike {
                (mode, factor, unlike) = (vector, value, residual);
            }
        }
        if unlike <= enough && rare(&mode) {
            return Ok(LongRun {
                sum: None,
                mode,
                factor: factor.powf(1.0 / stride as f64),
                residuals: [0.0, unlike],
                steps,
            });
        }
        // Rounding is the least that is told of a factor.
        let lost = (1.0 - factor).max(f64::EPSILON);
        residuals[1] = unlike / lost;
        // The first space is that of both.
        if solving || cycle == 0 {
            space.correct(&mut sum);
            // Once along the slowest mode; what is left along it then is an error of the sum, magnified by 1/lost.
            for projecting in [true, false] {
                let image = several(&sum, None)?;
                for (k, r) in left.iter_mut().enumerate() {
                    *r = given[k] - sum[k] + image[k];
                }
                let part = along(&mode, &left) / lost;
                if projecting {
                    let part = part / along(&mode, &mode);
                    sum.iter_mut().zip(&mode).for_each(|(x, m)| *x += part * m);
                } else {
                    residuals[0] = (part / along(&mode, &sum)).abs() + norm(&left) / size;
                }
            }
        }
        if residuals.iter().all(|it| *it <= enough) {
            break;
        }
    }
    Ok(LongRun {
        sum: Some(sum),
        mode,
        factor: factor.max(0.0).powf(1.0 / stride as f64),
        residuals,
        steps,
    })
}

/// An orthonormal basis of span(r, B r, B^2 r, ...) and B in it: B V = V H + the last row.
struct Space {
    basis: Vec<Vec<f64>>,
    /// (m + 1) by m.
    hessenberg: Array2<f64>,
    /// |r|.
    size: f64,
}

impl Space {
    fn of(from: &[f64], apply: &mut dyn FnMut(&[f64]) -> Result<Vec<f64>>) -> Result<Self> {
        let size = norm(from);
        let mut basis = vec![from.iter().map(|x| x / size).collect::<Vec<f64>>()];
        let mut rows = Vec::new();
        for m in 0..VECTORS {
            let mut next = apply(&basis[m])?;
            let mut column = vec![0.0; m + 2];
            // Twice is enough (Giraud et al., Numer. Math. 101, 2005, 87).
            for _ in 0..2 {
                for (k, vector) in basis.iter().enumerate() {
                    let part = dot(vector, &next);
                    column[k] += part;
                    for (x, v) in next.iter_mut().zip(vector) {
                        *x -= part * v;
                    }
                }
            }
            let left = norm(&next);
            column[m + 1] = left;
            rows.push(column);
            // The space is invariant.
            if left < 1e-13 {
                break;
            }
            basis.push(next.iter().map(|x| x / left).collect());
        }
        let m = rows.len();
        let mut hessenberg = Array2::zeros((m + 1, m));
        for (k, column) in rows.iter().enumerate() {
            for (i, x) in column.iter().enumerate() {
                hessenberg[[i, k]] = *x;
            }
        }
        Ok(Self {
            basis,
            hessenberg,
            size,
        })
    }

    /// The Ritz vector of the largest real Ritz value, that value, and its residual.
    fn slowest(&self) -> Result<(Vec<f64>, f64, f64)> {
        let m = self.hessenberg.ncols();
        let square = Array2::from_shape_fn((m, m), |(i, k)| Complex::from(self.hessenberg[[i, k]]));
        let (values, vectors) = sparse::eigen(&square)?;
        // The slowest mode of an absorbed motion is real and positive (Krein and Rutman).
        let largest = |a: &usize, b: &usize| values[*a].re.total_cmp(&values[*b].re);
        let k = (0..m).max_by(largest).unwrap_or(0);
        let column = vectors.column(k);
        // Made real: divided by the phase of its largest component.
        let top = (0..m)
            .max_by(|a, b| column[*a].norm().total_cmp(&column[*b].norm()))
            .unwrap_or(0);
        let phase = column[top] / column[top].norm();
        let mut vector = vec![0.0; self.basis[0].len()];
        for (basis, weight) in self.basis.iter().zip(column.iter()) {
            let weight = (weight / phase).re;
            for (x, b) in vector.iter_mut().zip(basis) {
                *x += weight * b;
            }
        }
        let residual = self.hessenberg[[m, m - 1]] * column[m - 1].norm();
        Ok((vector, values[k].re, residual))
    }

    /// Adds the V y that leaves least of r - (I - B) V y: a Hessenberg least-squares problem, by rotations.
    fn correct(&self, sum: &mut [f64]) {
        let m = self.hessenberg.ncols();
        let mut a = self.hessenberg.mapv(|x| -x);
        for k in 0..m {
            a[[k, k]] += 1.0;
        }
        let mut right = vec![0.0; m + 1];
        right[0] = self.size;
        for k in 0..m {
            let length = a[[k, k]].hypot(a[[k + 1, k]]);
            let (c, s) = (a[[k, k]] / length, a[[k + 1, k]] / length);
            for j in k..m {
                let (x, y) = (a[[k, j]], a[[k + 1, j]]);
                a[[k, j]] = c * x + s * y;
                a[[k + 1, j]] = c * y - s * x;
            }
            let (x, y) = (right[k], right[k + 1]);
            right[k] = c * x + s * y;
            right[k + 1] = c * y - s * x;
        }
        for k in (0..m).rev() {
            let known: f64 = (k + 1..m).map(|j| a[[k, j]] * right[j]).sum();
            right[k] = (right[k] - known) / a[[k, k]];
        }
        for (basis, y) in self.basis.iter().zip(&right[..m]) {
            for (x, b) in sum.iter_mut().zip(basis) {
                *x += y * b;
            }
        }
    }
}
