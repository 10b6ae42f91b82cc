//! Vectors, and the exponential of a small dense matrix.

use ndarray::Array2;

/// The scalar product of what two vectors have in common, in eight sums: vectors of the caller's instructions.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 8;
    let both = a.len().min(b.len());
    let (whole, rest) = a[..both].as_chunks::<LANES>();
    let (other, last) = b[..both].as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (a, b) in whole.iter().zip(other) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    let mut sum = 0.0;
    for (a, b) in rest.iter().zip(last) {
        sum += a * b;
    }
    for part in sums {
        sum += part;
    }
    sum
}

/// |x|.
pub(crate) fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

/// e^{A t}: Taylor's series of degree 18 where |A t| < 1/2, to rounding, and squaring.
pub(crate) fn exponential(matrix: &Array2<f64>, t: f64) -> Array2<f64> {
    let m = matrix.nrows();
    let norm = matrix
        .columns()
        .into_iter()
        .map(|column| column.iter().map(|x| x.abs()).sum::<f64>())
        .fold(0.0, f64::max);
    let halvings = (2.0 * norm * t.abs()).log2().ceil().max(0.0) as i32;
    let scaled = matrix * (t * 0.5f64.powi(halvings));
    let mut sum = Array2::<f64>::eye(m);
    for n in (1..=18).rev() {
        sum = Array2::eye(m) + scaled.dot(&sum) / f64::from(n);
    }
    for _ in 0..halvings {
        sum = sum.dot(&sum);
    }
    sum
}
