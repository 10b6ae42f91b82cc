//! Arnoldi's process: an orthonormal basis of span(r, A r, A^2 r, ...), A in it, and the least-squares problem of GMRES
//! (Saad and Schultz, SIAM J. Sci. Stat. Comput. 7, 856, 1986).

use crate::sparse::Scalar;
use ndarray::Array2;
use num_complex::{Complex, ComplexFloat};

/// f64 or Complex<f64>.
pub(super) trait Number: Scalar + ComplexFloat<Real = f64> + Send + Sync {
    /// Of its parts; a real number takes the first.
    fn of(parts: [f64; 2]) -> Self;

    /// Parts that are not always 0.
    const PARTS: usize;

    /// A real number.
    fn real(x: f64) -> Self {
        Self::of([x, 0.0])
    }
}

impl Number for f64 {
    fn of([x, _]: [f64; 2]) -> Self {
        x
    }

    const PARTS: usize = 1;
}

impl Number for Complex<f64> {
    fn of([re, im]: [f64; 2]) -> Self {
        Self::new(re, im)
    }

    const PARTS: usize = 2;
}

/// Part of an image beyond which what is left of it is no rounding.
const NEW: f64 = 1e-13;

/// A basis, and the Hessenberg matrix H of A V = V H.
pub(super) struct Krylov<T> {
    basis: Vec<Vec<T>>,
    /// Columns of H, one for each image, each longer than the one before.
    columns: Vec<Vec<T>>,
}

/// The scalar product of two vectors.
pub(super) fn dot<T: Number>(a: &[T], b: &[T]) -> T {
    let products = a.iter().zip(b).map(|(a, b)| a.conj() * *b);
    products.fold(T::default(), |sum, x| sum + x)
}

impl<T: Number> Krylov<T> {
    /// From a first vector of length 1.
    pub(super) fn of(first: Vec<T>) -> Self {
        Self {
            basis: vec![first],
            columns: Vec::new(),
        }
    }

    /// Images so far.
    pub(super) fn size(&self) -> usize {
        self.columns.len()
    }

    /// The vector whose image is next; None where the space is invariant.
    pub(super) fn last(&self) -> Option<&[T]> {
        self.basis.get(self.size()).map(|it| &it[..])
    }

    /// Takes the image of the last vector. It is made orthogonal `times` times, twice being enough (Parlett), each followed by
    /// `clean`.
    pub(super) fn push(
        &mut self,
        mut image: Vec<T>,
        times: usize,
        dot: impl Fn(&[T], &[T]) -> T,
        clean: impl Fn(&mut [T]),
    ) {
        let size = |x: &[T]| dot(x, x).re().sqrt();
        let before = size(&image);
        let mut column = vec![T::default(); self.basis.len() + 1];
        for _ in 0..times {
            for (h, v) in column.iter_mut().zip(&self.basis) {
                let part = dot(v, &image);
                *h += part;
                for (x, v) in image.iter_mut().zip(v) {
                    *x -= part * *v;
                }
            }
            clean(&mut image);
        }
        let left = size(&image);
        column[self.basis.len()] = T::real(left);
        self.columns.push(column);
        if left > NEW * before {
            let over = T::real(1.0 / left);
            for x in &mut image {
                *x *= over;
            }
            self.basis.push(image);
        }
    }

    /// H without its last row.
    pub(super) fn hessenberg(&self) -> Array2<T> {
        let m = self.size();
        let entry = |(i, j): (usize, usize)| self.columns[j].get(i).copied().unwrap_or_default();
        Array2::from_shape_fn((m, m), entry)
    }

    /// Its last entry.
    pub(super) fn rest(&self) -> f64 {
        let last = self.columns.last().and_then(|column| column.last());
        last.map_or(0.0, |it| it.re())
    }

    /// The y that leaves least of |size e_1 - H y|, and what it leaves, by Givens rotations.
    pub(super) fn least_squares(&self, size: f64) -> (Vec<T>, f64) {
        let m = self.size();
        let mut columns = self.columns.clone();
        let mut right = vec![T::default(); m + 1];
        right[0] = T::real(size);
        for k in 0..m {
            let (top, below) = (columns[k][k], columns[k][k + 1].re());
            let (length, radius) = (top.abs(), top.abs().hypot(below));
            let (c, s) = if length > 0.0 {
                let s = top * T::real(below / (length * radius));
                (T::real(length / radius), s)
            } else {
                (T::default(), T::real(1.0))
            };
            for column in columns[k..].iter_mut().chain([&mut right]) {
                let (x, y) = (column[k], column[k + 1]);
                column[k] = c * x + s * y;
                column[k + 1] = c * y - s.conj() * x;
            }
        }
        let left = right[m].abs();
        for k in (0..m).rev() {
            let known = (k + 1..m).fold(T::default(), |sum, j| sum + columns[j][k] * right[j]);
            right[k] = (right[k] - known) / columns[k][k];
        }
        right.truncate(m);
        (right, left)
    }

    /// The sum of the basis vectors times these parts.
    pub(super) fn combined<'a>(&self, parts: impl IntoIterator<Item = &'a T>) -> Vec<T>
    where
        T: 'a,
    {
        let mut sum = vec![T::default(); self.basis[0].len()];
        for (part, v) in parts.into_iter().zip(&self.basis) {
            for (x, v) in sum.iter_mut().zip(v) {
                *x += *part * *v;
            }
        }
        sum
    }
}
