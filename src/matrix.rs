//! Vectors, products of long rows, and the exponential of a small dense matrix.

use ndarray::linalg::general_mat_mul;
use ndarray::{Array2, ArrayRef2, Axis};
use rayon::prelude::*;

/// Columns of long rows that one thread takes at a time; the same for any number of threads.
pub(crate) const COLUMNS: usize = 4096;

/// Work compiled for the vectors of the CPU that it runs on. The closure must be `#[inline(always)]`; it is called as `FnMut`,
/// since as `FnOnce` it has a shim about it, which stays outside the dispatch.
pub(crate) fn vectorised<R>(work: impl FnMut() -> R) -> R {
    struct Work<F>(F);
    impl<R, F: FnMut() -> R> pulp::WithSimd for Work<F> {
        type Output = R;

        #[inline(always)]
        fn with_simd<S: pulp::Simd>(mut self, _: S) -> R {
            (self.0)()
        }
    }
    pulp::Arch::new().dispatch(Work(work))
}

/// [`vectorised`] of an expression, as a closure that is inlined.
macro_rules! vectorise {
    ($work:expr) => {
        $crate::matrix::vectorised(
            #[inline(always)]
            || $work,
        )
    };
}
pub(crate) use vectorise;

/// Every pair of places along two axes, the second running fastest.
pub(crate) fn grid<'a>(x: &'a [f64], y: &'a [f64]) -> impl Iterator<Item = [f64; 2]> + 'a {
    let row = move |x: &'a f64| y.iter().map(move |y| [*x, *y]);
    x.iter().flat_map(row)
}

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
    // By halves, as a vector adds its lanes.
    let [a, b, c, d, e, f, g, h] = sums;
    sum + (((a + e) + (c + g)) + ((b + f) + (d + h)))
}

/// |x|.
pub(crate) fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

/// A B^T of long rows, on all threads.
pub(crate) fn overlaps(a: &ArrayRef2<f64>, b: &ArrayRef2<f64>) -> Array2<f64> {
    let [left, right] = [a, b].map(|of| of.axis_chunks_iter(Axis(1), COLUMNS).collect::<Vec<_>>());
    let both = left.par_iter().zip(&right);
    let parts: Vec<Array2<f64>> = both.map(|(a, b)| a.dot(&b.t())).collect();
    let mut sum = Array2::zeros((a.nrows(), b.nrows()));
    for part in parts {
        sum += &part;
    }
    sum
}

/// X <- X - A B, X and B of long rows, on all threads.
fn take_off(x: &mut Array2<f64>, a: &Array2<f64>, b: &Array2<f64>) {
    let into: Vec<_> = x.axis_chunks_iter_mut(Axis(1), COLUMNS).collect();
    let from: Vec<_> = b.axis_chunks_iter(Axis(1), COLUMNS).collect();
    into.into_par_iter()
        .zip(from)
        .for_each(|(mut x, b)| general_mat_mul(-1.0, a, &b, 1.0, &mut x));
}

/// Takes off rows what they have of orthonormal ones, and answers with how much.
pub(crate) fn project(x: &mut Array2<f64>, basis: &Array2<f64>) -> Array2<f64> {
    let held = overlaps(x, basis);
    take_off(x, &held, basis);
    held
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
