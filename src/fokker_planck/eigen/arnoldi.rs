//! Eigenvalues nearest a shift: Arnoldi on the inverse.

use crate::error::Result;
use crate::fokker_planck::hermite::{Factored, Hierarchy};
use crate::sparse::eigen;
use ndarray::Array2;
use num_complex::Complex;

type C = Complex<f64>;

/// Rounding of the operator, relative to its largest entries: orthonormal functions under a p_q that falls by many
/// powers of ten (measured at T = 26, where equal eigenvalues of three resolutions differ by it).
const ROUNDING: f64 = 2e-13;

/// Residual of a Ritz value, relative to it, beyond which it is not converged. An eigenvalue that is close to others
/// may have converged and be known badly all the same.
const CONVERGED: f64 = 1e-3;

/// A shift in place of 0, and how often a residual counts, where friction depends on the displacement.
const ASIDE: f64 = 1e-6;

const SKEWED: f64 = 4.0;

/// An eigenvalue at one resolution, with its algebraic error.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mode {
    pub(super) value: C,
    pub(super) error: f64,
}

/// Arnoldi's process for (shift - L)^{-1}.
pub(super) struct Arnoldi<'a> {
    inverse: Factored<'a>,
    full: &'a Hierarchy,
    shift: C,
    basis: Vec<Vec<C>>,
    /// Columns of the Hessenberg matrix, one for each solve.
    columns: Vec<Vec<C>>,
}

impl<'a> Arnoldi<'a> {
    pub(super) fn new(
        full: &'a Hierarchy,
        shift: C,
        late: &dyn Fn() -> Result<()>,
    ) -> Result<Self> {
        // A fixed, structureless start: the golden-ratio sequence overlaps with every mode. The constant, the
        // eigenvector of 0, is left out.
        let golden = |k: usize| (k as f64 * 0.618_033_988_749_894_9).fract() - 0.5;
        let mut first: Vec<C> = (0..full.len()).map(|k| C::new(golden(k), 0.0)).collect();
        full.drop_constant(&mut first);
        normalise(&mut first);
        // At 0 the constant, which is left out of everything, would make the matrix singular.
        let shift = if full.is_local() && shift == C::default() {
            C::new(ASIDE, 0.0)
        } else {
            shift
        };
        Ok(Self {
            inverse: Factored::new(full, shift, late)?,
            full,
            shift,
            basis: vec![first],
            columns: Vec::new(),
        })
    }

    pub(super) fn size(&self) -> usize {
        self.columns.len()
    }

    /// Adds at most `steps` vectors; whether the space can still grow.
    pub(super) fn extend(&mut self, steps: usize, late: &dyn Fn() -> Result<()>) -> Result<bool> {
        for _ in 0..steps {
            late()?;
            if self.basis.len() == self.size() || self.size() + 2 > self.full.len() {
                return Ok(false);
            }
            let mut next = self.inverse.refined(&self.basis[self.size()])?;
            let mut column = vec![C::default(); self.basis.len() + 1];
            // Gram-Schmidt twice is enough (Parlett).
            for _ in 0..2 {
                for (overlap, vector) in column.iter_mut().zip(&self.basis) {
                    let part: C = vector.iter().zip(&next).map(|(b, x)| b.conj() * x).sum();
                    *overlap += part;
                    let both = next.iter_mut().zip(vector);
                    both.for_each(|(x, b)| *x -= part * b);
                }
            }
            let norm = normalise(&mut next);
            column[self.basis.len()] = C::new(norm, 0.0);
            self.columns.push(column);
            if norm > 1e-13 {
                self.basis.push(next);
            }
        }
        Ok(true)
    }

    /// The converged eigenvalues, those of the upper half plane.
    pub(super) fn modes(&self) -> Result<Vec<Mode>> {
        let size = self.size();
        let entry = |(i, j): (usize, usize)| self.columns[j].get(i).copied().unwrap_or_default();
        let (values, vectors) = eigen(&Array2::from_shape_fn((size, size), entry))?;
        let last = entry((size, size - 1)).norm();
        let mut modes = Vec::new();
        for (theta, part) in values.iter().zip(vectors.columns()) {
            let value = self.shift - theta.inv();
            // The residual over theta: no vector is built for what has not converged.
            let rough = part[size - 1].norm() * last / theta.norm();
            if !value.is_finite() || rough > CONVERGED {
                continue;
            }
            let mut vector = vec![C::default(); self.full.len()];
            for (b, s) in self.basis.iter().zip(part) {
                vector.iter_mut().zip(b).for_each(|(x, b)| *x += b * s);
            }
            let error = algebraic(self.full, value, &vector);
            let nothing = error.max(1e-9 * value.norm());
            // No mode of the operator grows; of its projection, where friction depends on the displacement, some may.
            let grows = self.full.is_local() && value.re >= 0.0;
            if error > value.norm() || value.im < -nothing || grows {
                continue;
            }
            // A real eigenvalue of a real matrix has no imaginary part beyond its error.
            let im = if value.im <= nothing { 0.0 } else { value.im };
            let value = C::new(value.re, im);
            modes.push(Mode { value, error });
        }
        Ok(modes)
    }
}

/// |L x - lambda x| |x| / |J x . x|, J the reversal of v, and rounding. Where friction depends on the displacement J x is
/// the left vector in part only, and the residual counts [`SKEWED`] times.
pub(super) fn algebraic(full: &Hierarchy, value: C, x: &[C]) -> f64 {
    let image = full.apply(x).into_iter();
    let residual: f64 = image.zip(x).map(|(y, x)| (y - value * x).norm_sqr()).sum();
    let norm: f64 = x.iter().map(C::norm_sqr).sum();
    let (even, odd) = x.split_at(full.even());
    let square = |x: &[C]| x.iter().map(|x| x * x).sum::<C>();
    let skewed = if full.is_local() { SKEWED } else { 1.0 };
    skewed * (residual * norm).sqrt() / (square(even) - square(odd)).norm() + ROUNDING * full.size()
}

pub(super) fn normalise(x: &mut [C]) -> f64 {
    let norm = x.iter().map(C::norm_sqr).sum::<f64>().sqrt();
    if norm > 0.0 {
        for x in x.iter_mut() {
            *x /= norm;
        }
    }
    norm
}
