//! Arnoldi's process: an orthonormal basis of span(r, A r, A^2 r, ...), for one r or several, A in it, and the least-squares
//! problem of GMRES (Saad and Schultz, SIAM J. Sci. Stat. Comput. 7, 856, 1986).

use crate::sparse::Scalar;
use ndarray::{Array2, ArrayView1};
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

/// A basis, and the matrix H of A V = V H, which has as many diagonals below the main one as there are first vectors.
#[derive(Default)]
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

    /// Takes one more first vector, of any length, if it is not in the span of those before.
    pub(super) fn begin(&mut self, vector: Vec<T>, dot: impl Fn(&[T], &[T]) -> T) {
        self.orthonormal(vector, 2, dot, |_| ());
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
        let column = self.orthonormal(image, times, dot, clean);
        self.columns.push(column);
    }

    /// Appends what a vector has beside the basis, at length 1; the parts of the vector.
    fn orthonormal(
        &mut self,
        mut image: Vec<T>,
        times: usize,
        dot: impl Fn(&[T], &[T]) -> T,
        clean: impl Fn(&mut [T]),
    ) -> Vec<T> {
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
        if left > NEW * before {
            let over = T::real(1.0 / left);
            for x in &mut image {
                *x *= over;
            }
            self.basis.push(image);
        }
        column
    }

    /// So many rows of H; [`Krylov::size`] for A in the basis, without what leads out of it.
    pub(super) fn hessenberg(&self, rows: usize) -> Array2<T> {
        let entry = |(i, j): (usize, usize)| self.columns[j].get(i).copied().unwrap_or_default();
        Array2::from_shape_fn((rows, self.size()), entry)
    }

    /// |A V y - theta V y| for an eigenvalue theta of A in the basis and its eigenvector y: what leads out of the basis.
    pub(super) fn residual(&self, y: &ArrayView1<Complex<f64>>) -> f64 {
        let row = |i: usize| -> Complex<f64> {
            let entry = |column: &Vec<T>| column.get(i).copied().unwrap_or_default();
            let row = self.columns.iter().map(entry).zip(y);
            row.map(|(h, y)| Complex::new(h.re(), h.im()) * y).sum()
        };
        let outside = (self.size()..self.basis.len()).map(|i| row(i).norm_sqr());
        outside.sum::<f64>().sqrt()
    }

    /// The parts of a vector along the basis.
    pub(super) fn parts(&self, x: &[T], dot: impl Fn(&[T], &[T]) -> T) -> Vec<T> {
        self.basis.iter().map(|v| dot(v, x)).collect()
    }

    /// The y that leaves least of |size e_1 - H y|, and what it leaves, by Givens rotations; of one first vector.
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
