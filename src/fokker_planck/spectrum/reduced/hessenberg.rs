//! Upper Hessenberg form by reflections.

use ndarray::{Array1, Array2, Axis, Slice};

/// Householder reduction to upper Hessenberg form that leaves the first vector alone; the same change of
/// basis for the other matrices and vectors.
pub(super) fn hessenberg(
    matrix: &mut Array2<f64>,
    others: &mut [&mut Array2<f64>],
    vectors: &mut [&mut Array1<f64>],
) {
    let m = matrix.nrows();
    for k in 0..m.saturating_sub(2) {
        let below = Slice::from(k + 1..);
        let mut u = matrix.column(k).slice_axis(Axis(0), below).to_owned();
        let size = u.dot(&u).sqrt();
        u[0] += size.copysign(u[0]);
        if u.dot(&u) == 0.0 {
            continue;
        }
        reflect(matrix, &u, below);
        for other in others.iter_mut() {
            reflect(other, &u, below);
        }
        for vector in vectors.iter_mut() {
            let mut part = vector.slice_axis_mut(Axis(0), below);
            let along = u.dot(&part) * (2.0 / u.dot(&u));
            part.scaled_add(-along, &u);
        }
        matrix
            .slice_axis_mut(Axis(0), Slice::from(k + 2..))
            .column_mut(k)
            .fill(0.0);
    }
}

/// Reflects rows and columns of a matrix.
pub(super) fn reflect(a: &mut Array2<f64>, u: &Array1<f64>, part: Slice) {
    let norm = u.dot(u);
    let mut rows = a.slice_axis_mut(Axis(0), part);
    let along = u.dot(&rows) * (2.0 / norm);
    for (mut row, u) in rows.rows_mut().into_iter().zip(u) {
        row.scaled_add(-u, &along);
    }
    let mut columns = a.slice_axis_mut(Axis(1), part);
    let along = columns.dot(u) * (2.0 / norm);
    for (mut row, a) in columns.rows_mut().into_iter().zip(&along) {
        row.scaled_add(-a, u);
    }
}
