//! Sparse LU, and what little is dense: the only module that uses faer. Sparse matrices are sprs matrices in
//! compressed-column form.
//!
//! faer answers a numerically singular, NaN or infinite matrix with `Ok` and numbers that are not a
//! solution; this module checks the values before, and the residual after, so that none gets through.

use crate::error::{Error, Result};
use crate::matrix::COLUMNS;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::solvers::{PartialPivLu, Qr, ShapeCore, Solve, SolveLstsq};
use faer::sparse::linalg::lu::{
    LuRef, LuSymbolicParams, NumericLu, SymbolicLu, factorize_symbolic_lu,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::traits::ComplexField;
use faer::{Conj, Mat, MatMut, Par, Spec};
use ndarray::{Array2, Axis};
use num_complex::Complex;
use rayon::prelude::*;
use sprs::CsMat;
use std::ops::{AddAssign, Mul, SubAssign};

/// `f64` or `Complex<f64>`: what a factored matrix can hold.
pub trait Scalar:
    ComplexField + Copy + Default + AddAssign + SubAssign + Mul<Output = Self>
{
    /// |Re| + |Im|; NaN if either is.
    fn size(self) -> f64;
}

/// Adds to the diagonal of a matrix that holds all of it.
pub(crate) fn shift<T: AddAssign + Copy>(matrix: &mut CsMat<T>, by: T) {
    for (column, mut entries) in matrix.outer_iterator_mut().enumerate() {
        if let Some(diagonal) = entries.get_mut(column) {
            *diagonal += by;
        }
    }
}

impl Scalar for f64 {
    fn size(self) -> f64 {
        self.abs()
    }
}

impl Scalar for Complex<f64> {
    fn size(self) -> f64 {
        self.re.abs() + self.im.abs()
    }
}

/// A factored sparse matrix A, P A Q = L U (faer, COLAMD ordering, partial pivoting). The pattern is
/// analysed once; `refactor` takes new values on the same pattern.
pub struct Lu<T: Scalar> {
    matrix: CsMat<T>,
    columns: Vec<usize>,
    /// Largest column sum of |A|.
    norm: f64,
    symbolic: SymbolicLu<usize>,
    numeric: NumericLu<usize, T>,
    memory: MemBuffer,
    residual: Vec<T>,
}

impl<T: Scalar> Lu<T> {
    /// Largest backward error accepted of a solution, relative to |A| |x| + |b|. A stable
    /// factorisation reaches about 1e-14; a singular matrix is many orders away.
    const ACCEPTED: f64 = 1e-9;

    /// Factors a square compressed-column matrix.
    ///
    /// # Errors
    /// [`Error::Linear`] for a matrix that is not square, not compressed by columns, not finite or
    /// structurally singular. A numerically singular one shows in the first [`Lu::solve`].
    pub fn factor(matrix: CsMat<T>) -> Result<Self> {
        if !matrix.is_csc() || matrix.rows() != matrix.cols() || matrix.rows() == 0 {
            let (m, n) = matrix.shape();
            let what = format!("a {m} x {n} matrix, expected square, by columns");
            return Err(Error::linear("sparse LU", what));
        }
        let norm = norm(&matrix)?;
        let columns = matrix.proper_indptr().to_vec();
        let symbolic = pattern(&matrix, &columns);
        let symbolic = factorize_symbolic_lu(symbolic, LuSymbolicParams::default())
            .map_err(|e| Error::linear("sparse LU", format!("{e:?}")))?;
        let memory = MemBuffer::new(
            symbolic
                .factorize_numeric_lu_scratch::<T>(Par::Seq, Spec::default())
                .or(symbolic.solve_in_place_scratch::<T>(1, Par::Seq)),
        );
        let residual = vec![T::default(); matrix.rows()];
        let numeric = NumericLu::new();
        let mut lu = Self {
            matrix,
            columns,
            norm,
            symbolic,
            numeric,
            memory,
            residual,
        };
        lu.factor_values()?;
        Ok(lu)
    }

    /// Factors new values on the pattern of the first matrix; no symbolic work is repeated.
    ///
    /// # Errors
    /// [`Error::Linear`] for another pattern or values that are not finite.
    pub(crate) fn refactor(&mut self, matrix: CsMat<T>) -> Result<()> {
        if matrix.indptr() != self.matrix.indptr() || matrix.indices() != self.matrix.indices() {
            let what = "another sparsity pattern than the first matrix".to_string();
            return Err(Error::linear("sparse LU", what));
        }
        self.norm = norm(&matrix)?;
        self.matrix = matrix;
        self.factor_values()
    }

    fn factor_values(&mut self) -> Result<()> {
        let a = SparseColMatRef::new(pattern(&self.matrix, &self.columns), self.matrix.data());
        let memory = MemStack::new(&mut self.memory);
        match self.symbolic.factorize_numeric_lu(
            &mut self.numeric,
            a,
            Par::Seq,
            memory,
            Spec::default(),
        ) {
            Ok(_) => Ok(()),
            Err(e) => Err(Error::linear("sparse LU", format!("{e:?}"))),
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.matrix.rows()
    }

    /// Overwrites the right-hand side with the solution of A x = b and returns its backward error
    /// |b - A x|_1/(|A|_1 |x|_1 + |b|_1).
    ///
    /// # Errors
    /// [`Error::Linear`] if the solution is not finite or its backward error above 1e-9.
    pub fn solve(&mut self, x: &mut [T]) -> Result<f64> {
        let n = self.len();
        if x.len() != n {
            let what = format!("a right-hand side of length {}, expected {n}", x.len());
            return Err(Error::linear("sparse LU", what));
        }
        self.residual.copy_from_slice(x);
        let given: f64 = x.iter().map(|b| b.size()).sum();
        let lu = LuRef::new_unchecked(&self.symbolic, &self.numeric);
        let memory = MemStack::new(&mut self.memory);
        let columns = MatMut::from_column_major_slice_mut(x, n, 1);
        lu.solve_in_place_with_conj(Conj::No, columns, Par::Seq, memory);
        subtract_product(&self.matrix, x, &mut self.residual);
        let left: f64 = self.residual.iter().map(|r| r.size()).sum();
        let solution: f64 = x.iter().map(|s| s.size()).sum();
        let scale = self.norm * solution + given;
        let error = if scale > 0.0 { left / scale } else { 0.0 };
        if error.is_finite() && error <= Self::ACCEPTED && solution.is_finite() {
            Ok(error)
        } else {
            let what = format!("singular matrix or lost digits: backward error {error:.1e}");
            Err(Error::linear("sparse LU", what))
        }
    }
}

/// A matrix as faer has it, if it is square and every entry of it is finite.
fn dense<T: Copy>(who: &'static str, matrix: &Array2<T>, finite: fn(&T) -> bool) -> Result<Mat<T>> {
    let (m, n) = matrix.dim();
    if m != n || !matrix.iter().all(finite) {
        let what = format!("a {m} x {n} matrix, expected square and finite");
        return Err(Error::linear(who, what));
    }
    Ok(Mat::from_fn(n, n, |i, j| matrix[[i, j]]))
}

/// Eigenvalues, and their right eigenvectors as unit columns.
pub(crate) type Eigenpairs = (Vec<Complex<f64>>, Array2<Complex<f64>>);

/// All eigenvalues and right eigenvectors (unit columns) of a small dense matrix.
///
/// # Errors
/// [`Error::Linear`] for a matrix that is not square or finite, or if the QR iteration fails.
pub fn eigen(matrix: &Array2<Complex<f64>>) -> Result<Eigenpairs> {
    let n = matrix.nrows();
    let dense = dense("dense eigenvalues", matrix, |x| x.is_finite())?;
    let evd = dense
        .eigen()
        .map_err(|e| Error::linear("dense eigenvalues", format!("{e:?}")))?;
    let values = (0..n).map(|k| evd.S()[k]).collect();
    let mut vectors = Array2::from_shape_fn((n, n), |(i, j)| evd.U()[(i, j)]);
    for mut column in vectors.columns_mut() {
        let norm = column.iter().map(Complex::norm_sqr).sum::<f64>().sqrt();
        column.mapv_inplace(|x| x / norm);
    }
    Ok((values, vectors))
}

/// All eigenvalues of a small dense real matrix.
///
/// # Errors
/// [`Error::Linear`] for a matrix that is not square or finite, or if the QR iteration fails.
pub(crate) fn eigenvalues(matrix: &Array2<f64>) -> Result<Vec<Complex<f64>>> {
    let dense = dense("dense eigenvalues", matrix, |x| x.is_finite())?;
    dense
        .eigenvalues()
        .map_err(|e| Error::linear("dense eigenvalues", format!("{e:?}")))
}

/// A root F of the products of long rows, F^T F = X X^T, by QR: it knows a combination of rows to their rounding, however small that
/// is, and their products to the root of it.
pub(crate) fn root(rows: &Array2<f64>) -> Array2<f64> {
    let m = rows.nrows();
    let parts: Vec<_> = rows.axis_chunks_iter(Axis(1), COLUMNS).collect();
    let parts: Vec<Mat<f64>> = parts
        .par_iter()
        .map(|part| Qr::new(Mat::from_fn(part.ncols(), m, |i, j| part[[j, i]]).as_ref()))
        .map(|qr| qr.thin_R().to_owned())
        .collect();
    let heights = parts.iter().map(Mat::nrows);
    let mut all = Mat::zeros(heights.sum(), m);
    let mut from = 0;
    for part in &parts {
        let mut to = all.as_mut().subrows_mut(from, part.nrows());
        to.copy_from(part);
        from += part.nrows();
    }
    let qr = Qr::new(all.as_ref());
    let root = qr.thin_R();
    Array2::from_shape_fn((root.nrows(), m), |at| root[at])
}

/// The x that leaves least of b - A x, by QR; at least as many rows as columns.
///
/// # Errors
/// [`Error::Linear`] for a matrix that is not finite.
pub(crate) fn least_squares(matrix: &Array2<f64>, b: &[f64]) -> Result<Vec<f64>> {
    let (m, n) = matrix.dim();
    if !matrix.iter().all(|x| x.is_finite()) {
        let what = format!("a {m} x {n} matrix, expected finite");
        return Err(Error::linear("least squares", what));
    }
    let dense = Mat::from_fn(m, n, |i, j| matrix[[i, j]]);
    let right = Mat::from_fn(m, 1, |i, _| b[i]);
    let x = dense.qr().solve_lstsq(right);
    Ok((0..n).map(|k| x[(k, 0)]).collect())
}

/// LU of a dense complex matrix by partial pivoting: one factorisation, any number of right-hand sides.
pub(crate) struct DenseLu(PartialPivLu<Complex<f64>>);

impl DenseLu {
    /// Factors a square matrix. One thread: whoever has many matrices shares them out.
    ///
    /// # Errors
    /// [`Error::Linear`] for a matrix that is not square or not finite. A singular one shows in the solution.
    pub(crate) fn factor(matrix: &Array2<Complex<f64>>) -> Result<Self> {
        let dense = dense("dense LU", matrix, |x| x.is_finite())?;
        Ok(Self(dense.partial_piv_lu()))
    }

    /// Overwrites the columns in `x`, one after the other, with the solutions.
    ///
    /// # Errors
    /// [`Error::Linear`] for a length that is not a number of columns, or a solution that is not finite.
    pub(crate) fn solve(&self, x: &mut [Complex<f64>]) -> Result<()> {
        let n = self.0.nrows();
        if !x.len().is_multiple_of(n) {
            let what = format!("right-hand sides of {} for a matrix of {n}", x.len());
            return Err(Error::linear("dense LU", what));
        }
        let columns = MatMut::from_column_major_slice_mut(x, n, x.len() / n);
        self.0.solve_in_place(columns);
        if x.iter().all(|x| x.is_finite()) {
            Ok(())
        } else {
            Err(Error::linear("dense LU", "a singular matrix"))
        }
    }
}

/// Largest column sum of |A|.
///
/// # Errors
/// [`Error::Linear`] if any entry is not finite.
pub(crate) fn norm<T: Scalar>(matrix: &CsMat<T>) -> Result<f64> {
    let mut largest: f64 = 0.0;
    for (column, entries) in matrix.outer_iterator().enumerate() {
        let sum: f64 = entries.iter().map(|(_, a)| a.size()).sum();
        if !sum.is_finite() {
            let what = format!("column {column} holds an entry that is not finite");
            return Err(Error::linear("sparse LU", what));
        }
        largest = largest.max(sum);
    }
    Ok(largest)
}

/// faer's view of the pattern; `columns` holds the column pointers.
fn pattern<'a, T>(
    matrix: &'a CsMat<T>,
    columns: &'a [usize],
) -> SymbolicSparseColMatRef<'a, usize> {
    let (m, n) = matrix.shape();
    SymbolicSparseColMatRef::new_checked(m, n, columns, None, matrix.indices())
}

/// A x.
pub(crate) fn product<T: Copy + Default + AddAssign + Mul<f64, Output = T>>(
    matrix: &CsMat<f64>,
    x: &[T],
) -> Vec<T> {
    let mut y = vec![T::default(); x.len()];
    for (column, x) in matrix.outer_iterator().zip(x) {
        for (row, a) in column.iter() {
            y[row] += *x * *a;
        }
    }
    y
}

/// `y -= A x`.
pub(crate) fn subtract_product<T: Scalar>(matrix: &CsMat<T>, x: &[T], y: &mut [T]) {
    for (column, entries) in matrix.outer_iterator().enumerate() {
        for (row, &a) in entries.iter() {
            y[row] -= a * x[column];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sprs::TriMat;

    fn matrix<T: Scalar>(n: usize, entries: &[(usize, usize, T)]) -> CsMat<T> {
        let mut triplets = TriMat::new((n, n));
        for &(i, j, a) in entries {
            triplets.add_triplet(i, j, a);
        }
        triplets.to_csc()
    }

    #[test]
    fn a_solution_solves_the_system() {
        let a = matrix(
            3,
            &[
                (0, 0, 4.0),
                (0, 2, 1.0),
                (1, 1, 2.0),
                (2, 0, -1.0),
                (2, 2, 3.0),
            ],
        );
        let mut lu = Lu::factor(a).unwrap();
        let mut x = [7.0, 4.0, 8.0]; // of x = (1, 2, 3)
        assert!(lu.solve(&mut x).unwrap() < 1e-15);
        assert!((x[0] - 1.0).abs() + (x[1] - 2.0).abs() + (x[2] - 3.0).abs() < 1e-14);
    }

    #[test]
    fn a_complex_system_is_solved_by_the_same_code() {
        let i = Complex::new(0.0, 1.0);
        let one = Complex::new(1.0, 0.0);
        let mut lu = Lu::factor(matrix(2, &[(0, 0, i), (0, 1, one), (1, 1, one + i)])).unwrap();
        let mut x = [i + one, one + i];
        lu.solve(&mut x).unwrap();
        assert!(
            (x[1] - one).norm() < 1e-15 && (x[0] - one).norm() < 1e-15,
            "{x:?}"
        );
    }

    #[test]
    fn eigenvalues_of_a_rotation_are_a_conjugate_pair() {
        let (c, s) = (Complex::new(0.6, 0.0), Complex::new(0.8, 0.0));
        let matrix = Array2::from_shape_vec((2, 2), vec![c, -s, s, c]).unwrap();
        let (values, vectors) = eigen(&matrix).unwrap();
        for (k, value) in values.iter().enumerate() {
            assert!((value.re - 0.6).abs() < 1e-14 && (value.im.abs() - 0.8).abs() < 1e-14);
            let image = matrix.dot(&vectors.column(k));
            let left = &image - &vectors.column(k).mapv(|x| x * value);
            assert!(left.iter().all(|x| x.norm() < 1e-14));
        }
        assert!(eigen(&Array2::from_elem((2, 2), Complex::new(f64::NAN, 0.0))).is_err());
    }

    #[test]
    fn a_root_of_long_rows_knows_a_combination_that_is_far_below_them() {
        let golden = |k: usize| (k as f64 * 0.618_033_988_749_894_9).fract() - 0.5;
        let long = 2 * COLUMNS + 100;
        let mut rows = Array2::from_shape_fn((3, long), |(i, j)| golden(i * long + j * j));
        // The third is the sum of the others but for 1e-12 of another one, whose square is far below rounding.
        let small: Vec<f64> = (0..long).map(|j| 1e-12 * golden(7 * j * j)).collect();
        for (j, small) in small.iter().enumerate() {
            rows[[2, j]] = rows[[0, j]] + rows[[1, j]] + small;
        }
        let root = root(&rows);
        let products = root.t().dot(&root) - rows.dot(&rows.t());
        assert!(products.iter().all(|x| x.abs() < 1e-10));
        let left = &root.column(2) - &root.column(0) - root.column(1);
        let size = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
        let (got, exact) = (size(&left.to_vec()), size(&small));
        assert!((got / exact - 1.0).abs() < 1e-2, "{got:e} {exact:e}");
    }

    #[test]
    fn what_is_not_a_solution_is_refused() {
        let good = [(0, 0, 1.0), (0, 1, 1.0), (1, 0, 1.0), (1, 1, 2.0)];
        let with = |k: usize, value: f64| {
            let mut entries = good;
            entries[k].2 = value;
            matrix(2, &entries)
        };
        // Numerically singular: faer answers Ok.
        let singular = Lu::factor(with(3, 1.0)).and_then(|mut lu| lu.solve(&mut [1.0, 2.0]));
        assert!(singular.is_err());
        for value in [f64::NAN, f64::INFINITY] {
            let message = Lu::factor(with(2, value)).err().unwrap().to_string();
            assert!(message.contains("not finite"), "{message}");
        }
        // Structurally singular.
        assert!(Lu::factor(matrix(2, &[(0, 0, 1.0), (1, 0, 1.0)])).is_err());
        let mut lu = Lu::factor(with(3, 3.0)).unwrap();
        assert!(lu.solve(&mut [1.0]).is_err());
        assert!(lu.solve(&mut [f64::NAN, 0.0]).is_err());
        assert!(lu.refactor(matrix(2, &[(0, 0, 1.0), (1, 1, 1.0)])).is_err());
        lu.refactor(with(3, 5.0)).unwrap();
        let mut x = [2.0, 6.0];
        lu.solve(&mut x).unwrap();
        assert!((x[0] - 1.0).abs() < 1e-15 && (x[1] - 1.0).abs() < 1e-15);
    }
}
