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

/// An eigenvalue found in a space, without what the matrix itself is off by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ritz {
    pub(super) value: Complex<f64>,
    /// By how much it may be off the matrix's: the residual over the condition of the eigenvalue.
    pub(super) error: f64,
}

/// Part of an image beyond which what is left of it is no rounding.
const NEW: f64 = 1e-13;

/// A basis, and the matrix H of A V = V H: Hessenberg's, or with as many diagonals below the main one as there were first
/// vectors.
pub(super) struct Krylov<T> {
    basis: Vec<Vec<T>>,
    /// Columns of H, one for each image, up to the last component that is not 0.
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

    /// From the span of several.
    pub(super) fn spanned_by(first: Vec<Vec<T>>, dot: impl Fn(&[T], &[T]) -> T) -> Self {
        let (basis, columns) = (Vec::new(), Vec::new());
        let mut space = Self { basis, columns };
        for vector in first {
            space.split(vector, 2, &dot, |_| ());
        }
        space
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
        image: Vec<T>,
        times: usize,
        dot: impl Fn(&[T], &[T]) -> T,
        clean: impl Fn(&mut [T]),
    ) {
        let column = self.split(image, times, &dot, clean);
        self.columns.push(column);
    }

    /// The components of a vector; what is left of it beside the basis joins it, if that is no rounding.
    fn split(
        &mut self,
        mut vector: Vec<T>,
        times: usize,
        dot: &impl Fn(&[T], &[T]) -> T,
        clean: impl Fn(&mut [T]),
    ) -> Vec<T> {
        let size = |x: &[T]| dot(x, x).re().sqrt();
        let before = size(&vector);
        let mut components = vec![T::default(); self.basis.len() + 1];
        for _ in 0..times {
            for (h, v) in components.iter_mut().zip(&self.basis) {
                let part = dot(v, &vector);
                *h += part;
                for (x, v) in vector.iter_mut().zip(v) {
                    *x -= part * *v;
                }
            }
            clean(&mut vector);
        }
        let left = size(&vector);
        if left > NEW * before {
            components[self.basis.len()] = T::real(left);
            let over = T::real(1.0 / left);
            for x in &mut vector {
                *x *= over;
            }
            self.basis.push(vector);
        }
        components
    }

    /// The vectors.
    pub(super) fn basis(&self) -> &[Vec<T>] {
        &self.basis
    }

    /// H without what its images have beyond the vectors that they are of.
    pub(super) fn hessenberg(&self) -> Array2<T> {
        self.rows(self.size())
    }

    /// The first rows of H.
    pub(super) fn rows(&self, count: usize) -> Array2<T> {
        let entry = |(i, j): (usize, usize)| self.columns[j].get(i).copied().unwrap_or_default();
        Array2::from_shape_fn((count, self.size()), entry)
    }

    /// Its last entry.
    pub(super) fn rest(&self) -> f64 {
        let last = self.columns.last().and_then(|column| column.last());
        last.map_or(0.0, |it| it.re())
    }

    /// From one first vector: the y that leaves least of |size e_1 - H y|, and what it leaves, by Givens rotations.
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
