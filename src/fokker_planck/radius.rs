//! The largest eigenvalue of a symmetric or antisymmetric operator, by Lanczos' method: what an explicit
//! step must be shorter than, without a matrix.

use crate::matrix::norm;
use crate::roots::bisect;

/// Lanczos vectors. For n unknowns and k vectors the expected relative error of the largest eigenvalue from a
/// random start is below 0.103 (ln(n (k - 1)^4)/(k - 1))^2, 4 % at n = 1e4 (Kuczynski and Wozniakowski, SIAM J.
/// Matrix Anal. Appl. 13, 1094, 1992); on operators as here it is below [`SAFETY`] (tests below).
const VECTORS: usize = 40;

/// The estimate comes from below: so much on top.
const SAFETY: f64 = 1.02;

/// What an operator does to the inner product.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A^T = A.
    Symmetric,
    /// A^T = -A.
    Antisymmetric,
}

/// The largest |eigenvalue| of `apply` on vectors of length `n`, with a margin of 2 %.
pub(super) fn largest(n: usize, kind: Kind, mut apply: impl FnMut(&[f64], &mut [f64])) -> f64 {
    let sign = if kind == Kind::Symmetric { 1.0 } else { -1.0 };
    // A fixed start with every frequency in it: the same bound in every run.
    let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        seed as f64 / u64::MAX as f64 - 0.5
    };
    let mut now: Vec<f64> = (0..n).map(|_| random()).collect();
    let (mut last, mut next) = (vec![0.0; n], vec![0.0; n]);
    let (mut diagonal, mut beside) = (Vec::new(), Vec::new());
    // Where an unknown has no cell the operator answers 0: one application takes it out.
    apply(&now, &mut next);
    std::mem::swap(&mut now, &mut next);
    let mut size = norm(&now);
    let mut beta = 0.0;
    for _ in 0..VECTORS {
        if size <= f64::MIN_POSITIVE {
            break;
        }
        for x in &mut now {
            *x /= size;
        }
        if !diagonal.is_empty() {
            beside.push(size);
            beta = size;
        }
        apply(&now, &mut next);
        let alpha = if kind == Kind::Symmetric {
            now.iter().zip(&next).map(|(a, b)| a * b).sum()
        } else {
            0.0
        };
        diagonal.push(alpha);
        for ((next, now), last) in next.iter_mut().zip(&now).zip(&last) {
            *next -= alpha * now + sign * beta * last;
        }
        size = norm(&next);
        std::mem::swap(&mut last, &mut now);
        std::mem::swap(&mut now, &mut next);
    }
    SAFETY * tridiagonal(&diagonal, &beside)
}

/// The largest |eigenvalue| of a symmetric tridiagonal matrix, by bisection with Sturm's sequence. For
/// an antisymmetric one with a zero diagonal it is that of the symmetric one with the same entries.
fn tridiagonal(diagonal: &[f64], beside: &[f64]) -> f64 {
    let largest = |sign: f64| {
        let bound = |k: usize| {
            let left = if k > 0 { beside[k - 1] } else { 0.0 };
            diagonal[k].abs() + left + beside.get(k).copied().unwrap_or(0.0)
        };
        let reach = (0..diagonal.len()).map(bound).fold(0.0, f64::max);
        bisect(0.0, reach, |x| {
            // An eigenvalue lies above if a pivot of (x - T) is negative.
            let mut pivot = 1.0;
            (0..diagonal.len()).all(|k| {
                let square = if k > 0 { beside[k - 1].powi(2) } else { 0.0 };
                pivot = x - sign * diagonal[k] - square / pivot;
                pivot >= 0.0
            })
        })
    };
    largest(1.0).max(largest(-1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn the_largest_eigenvalue_of_a_difference_operator_is_found_with_its_margin() {
        let n = 3000;
        let second = |x: &[f64], y: &mut [f64]| {
            for k in 0..n {
                let at = |k: Option<usize>| k.and_then(|k| x.get(k)).copied().unwrap_or(0.0);
                y[k] = at(k.checked_sub(1)) - 2.0 * x[k] + at(Some(k + 1));
            }
        };
        let found = largest(n, Kind::Symmetric, second);
        let exact = 2.0 + 2.0 * (PI / (n as f64 + 1.0)).cos();
        println!("symmetric: {found:.4} of {exact:.4}");
        assert!(found > exact && found < 1.03 * exact);
        let first = |x: &[f64], y: &mut [f64]| {
            for (k, y) in y.iter_mut().enumerate() {
                let at = |k: Option<usize>| k.and_then(|k| x.get(k)).copied().unwrap_or(0.0);
                *y = at(Some(k + 1)) - at(k.checked_sub(1));
            }
        };
        let found = largest(n, Kind::Antisymmetric, first);
        println!("antisymmetric: {found:.4} of 2");
        assert!(found > 2.0 && found < 2.06);
    }
}
