//! The resolvent of an upper Hessenberg matrix, by Hyman's method.

use crate::matrix::vectorise;
use ndarray::Array2;

/// Frequencies that are solved for together.
pub(super) const TOGETHER: usize = 16;

/// Numbers of those, real and imaginary parts.
type Lanes = [[f64; TOGETHER]; 2];

/// A number that is grown so large is made smaller, with all that it follows from: what is below 1 then is rounding, and would
/// be slow as a subnormal number.
const LARGE: f64 = 1e100;

/// (i omega - H)^{-1} e_1 `size` at up to [`TOGETHER`] frequencies: real parts, and below each the imaginary one. Each number follows
/// from those after it by one row, the last one first, and the first row says how large they all are (Hyman's method: Wilkinson,
/// The Algebraic Eigenvalue Problem, 1965, chapter 7). Every row holds to the rounding of its own terms.
pub(super) fn solutions(matrix: &Array2<f64>, size: f64, omegas: &[f64]) -> Array2<f64> {
    let (m, count) = (matrix.nrows(), omegas.len());
    let mut x = vec![Lanes::default(); m];
    if let (Some(last), Some(omega)) = (x.last_mut(), omegas.last()) {
        last[0] = [1.0; TOGETHER];
        let omegas = std::array::from_fn(|k| *omegas.get(k).unwrap_or(omega));
        let matrix = matrix.as_standard_layout();
        vectorise!(upwards(
            matrix.as_slice().unwrap_or_default(),
            size,
            &omegas,
            &mut x
        ));
    }
    Array2::from_shape_fn((2 * count, m), |(row, j)| x[j][row % 2][row / 2])
}

#[inline(always)]
fn upwards(matrix: &[f64], size: f64, omegas: &[f64; TOGETHER], x: &mut [Lanes]) {
    let m = x.len();
    // What is smaller is rounding, and may be this.
    let least = f64::EPSILON * matrix.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    for (k, row) in matrix.chunks_exact(m).enumerate().rev() {
        let [re, im] = x[k];
        let mut left = Lanes::default();
        for n in 0..TOGETHER {
            (left[0][n], left[1][n]) = (-omegas[n] * im[n], omegas[n] * re[n]);
        }
        let left = less(left, &row[k..], &x[k..]);
        if k > 0 {
            let h = row[k - 1];
            let over = 1.0 / h.abs().max(least).copysign(h);
            for (x, left) in x[k - 1].iter_mut().flatten().zip(left.iter().flatten()) {
                *x = over * left;
            }
            shrink(&mut x[k - 1..]);
        } else {
            for n in 0..TOGETHER {
                let (a, b) = (left[0][n], left[1][n]);
                let over = size / (a * a + b * b);
                for x in &mut *x {
                    let [re, im] = [x[0][n], x[1][n]];
                    (x[0][n], x[1][n]) = ((re * a + im * b) * over, (im * a - re * b) * over);
                }
            }
        }
    }
}

/// Takes off them what a row has of numbers.
#[inline(always)]
fn less(mut left: Lanes, row: &[f64], x: &[Lanes]) -> Lanes {
    for (h, x) in row.iter().zip(x) {
        for (left, x) in left.iter_mut().zip(x) {
            for (left, x) in left.iter_mut().zip(x) {
                *left -= h * x;
            }
        }
    }
    left
}

/// Keeps what is grown from overflow.
#[inline(always)]
fn shrink(x: &mut [Lanes]) {
    let large = x[0]
        .iter()
        .flatten()
        .fold(0.0, |most: f64, x| most.max(x.abs()))
        > LARGE;
    for n in (0..TOGETHER).filter(|_| large) {
        if x[0].iter().any(|part| part[n].abs() > LARGE) {
            for part in x.iter_mut().flatten() {
                part[n] = if part[n].abs() < 1.0 {
                    0.0
                } else {
                    part[n] / LARGE
                };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{TOGETHER, solutions};
    use ndarray::Array2;

    /// A matrix whose numbers have no structure, its lower diagonal multiplied by `below`.
    fn matrix(m: usize, below: f64) -> Array2<f64> {
        let golden = |n: usize| (n as f64 * 0.618_033_988_749_894_9).fract() - 0.5;
        Array2::from_shape_fn((m, m), |(i, j)| match i.checked_sub(j) {
            None => golden(m * i + j),
            Some(0) => golden(m * i + j) - 2.0,
            Some(1) => below * (1.0 + golden(m * i + j)),
            Some(_) => 0.0,
        })
    }

    #[test]
    fn every_row_holds_to_rounding_however_small_or_large_its_numbers() {
        for (m, below) in [
            (1, 1.0),
            (2, 1.0),
            (40, 1.0),
            (60, 1e-8),
            (50, 1e12),
            (30, 0.0),
        ] {
            let omegas: Vec<f64> = (0..TOGETHER - 3).map(|k| 0.3 * k as f64).collect();
            let matrix = matrix(m, below);
            let most = matrix.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let x = solutions(&matrix, 3.0, &omegas);
            for (k, omega) in omegas.iter().enumerate() {
                let [re, im] = [x.row(2 * k), x.row(2 * k + 1)];
                let mut left = [
                    &im * -*omega - matrix.dot(&re),
                    &re * *omega - matrix.dot(&im),
                ];
                left[0][0] -= 3.0;
                let largest = re
                    .iter()
                    .chain(im)
                    .fold(0.0, |most: f64, x| most.max(x.abs()));
                let error = left
                    .iter()
                    .flatten()
                    .fold(0.0, |most: f64, x| most.max(x.abs()));
                let scale = 3.0 + (most + omega) * largest * m as f64;
                assert!(
                    error < 1e-15 * scale,
                    "{m} {below:e} {omega}: {error:e} of {scale:e}"
                );
            }
        }
    }
}
