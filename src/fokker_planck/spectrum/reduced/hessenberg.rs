//! Upper Hessenberg form by reflections.

use crate::matrix::{dot, norm, vectorise};
use ndarray::{Array2, Axis, Slice};

/// Householder reduction to upper Hessenberg form that leaves the first vector alone; the same change of basis for the matrices of
/// `both` sides and, on the right alone, for those of which every row stands for such a vector.
pub(super) fn hessenberg(
    matrix: &mut Array2<f64>,
    both: &mut [&mut Array2<f64>],
    right: &mut [&mut Array2<f64>],
) {
    let m = matrix.nrows();
    for k in 0..m.saturating_sub(2) {
        let below = Slice::from(k + 1..);
        let mut u = matrix.column(k).slice_axis(Axis(0), below).to_vec();
        u[0] += norm(&u).copysign(u[0]);
        if norm(&u) == 0.0 {
            continue;
        }
        reflect(matrix, &u);
        for other in both.iter_mut() {
            reflect(other, &u);
        }
        for other in right.iter_mut() {
            reflect_columns(other, &u);
        }
        matrix
            .slice_axis_mut(Axis(0), Slice::from(k + 2..))
            .column_mut(k)
            .fill(0.0);
    }
}

/// Reflects the last rows and columns of a matrix, as many as `u` has numbers.
pub(super) fn reflect(matrix: &mut Array2<f64>, u: &[f64]) {
    let m = matrix.ncols();
    let a = by_rows(matrix);
    vectorise!({
        let over = 2.0 / dot(u, u);
        let mut along = vec![0.0; m];
        let rows = &mut a[(m - u.len()) * m..];
        for (row, u) in rows.chunks_exact(m).zip(u) {
            add(&mut along, over * u, row);
        }
        for (row, u) in rows.chunks_exact_mut(m).zip(u) {
            add(row, -u, &along);
        }
    });
    reflect_columns(matrix, u);
}

/// Reflects the last columns alone.
pub(super) fn reflect_columns(matrix: &mut Array2<f64>, u: &[f64]) {
    let m = matrix.ncols();
    let a = by_rows(matrix);
    vectorise!({
        let over = 2.0 / dot(u, u);
        for row in a.chunks_exact_mut(m) {
            let part = &mut row[m - u.len()..];
            add(part, -over * dot(part, u), u);
        }
    });
}

/// The numbers of a matrix, row by row in memory.
fn by_rows(matrix: &mut Array2<f64>) -> &mut [f64] {
    if !matrix.is_standard_layout() {
        *matrix = matrix.as_standard_layout().into_owned();
    }
    matrix.as_slice_mut().unwrap_or_default()
}

#[inline(always)]
fn add(to: &mut [f64], times: f64, what: &[f64]) {
    for (to, x) in to.iter_mut().zip(what) {
        *to += times * x;
    }
}

#[cfg(test)]
mod tests {
    use super::hessenberg;
    use ndarray::Array2;

    #[test]
    fn the_form_is_the_matrix_reflected_about_the_first_unit_vector() {
        for m in [1, 2, 3, 40] {
            let golden = |n: usize| (n as f64 * 0.618_033_988_749_894_9).fract() - 0.5;
            let whole = Array2::from_shape_fn((m, m), |(i, j)| golden(m * i + j * j + 1));
            let (mut form, mut both, mut turn) = (whole.clone(), whole.clone(), Array2::eye(m));
            hessenberg(&mut form, &mut [&mut both], &mut [&mut turn]);
            let wrong = [
                turn.t().dot(&turn) - Array2::<f64>::eye(m),
                turn.t().dot(&whole).dot(&turn) - &form,
                both - &form,
            ];
            assert!(wrong.iter().flatten().all(|x| x.abs() < 1e-12), "{m}");
            assert!(
                form.indexed_iter()
                    .all(|((i, j), x)| i <= j + 1 || *x == 0.0)
            );
            assert_eq!(turn[[0, 0]], 1.0);
        }
    }
}
