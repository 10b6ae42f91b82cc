//! Eigenvalues nearest a shift: Arnoldi on the inverse.

use crate::error::Result;
use crate::fokker_planck::hermite::{Factored, Hierarchy};
use crate::fokker_planck::krylov::{Krylov, dot};
use crate::sparse::eigen;
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

/// What is known to be nearer to 0 is a mode, however little else is known of it: small vibrations go at 1.
const NEAR_ZERO: f64 = 1e-6;

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
    space: Krylov<C>,
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
        let size = dot(&first, &first).re.sqrt();
        for x in &mut first {
            *x /= size;
        }
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
            space: Krylov::of(first),
        })
    }

    pub(super) fn size(&self) -> usize {
        self.space.size()
    }

    /// Adds at most `steps` vectors; whether the space can still grow.
    pub(super) fn extend(&mut self, steps: usize, late: &dyn Fn() -> Result<()>) -> Result<bool> {
        for _ in 0..steps {
            late()?;
            let Some(last) = self
                .space
                .last()
                .filter(|_| self.size() + 2 <= self.full.len())
            else {
                return Ok(false);
            };
            let image = self.inverse.refined(last)?;
            self.space.push(image, 2, dot, |_| ());
        }
        Ok(true)
    }

    /// The converged eigenvalues, those of the upper half plane.
    pub(super) fn modes(&self) -> Result<Vec<Mode>> {
        let size = self.size();
        let (values, vectors) = eigen(&self.space.hessenberg())?;
        let last = self.space.rest();
        let mut modes = Vec::new();
        for (theta, part) in values.iter().zip(vectors.columns()) {
            let value = self.shift - theta.inv();
            // The residual over theta: no vector is built for what has not converged.
            let rough = part[size - 1].norm() * last / theta.norm();
            if !value.is_finite() || rough > CONVERGED {
                continue;
            }
            let vector = self.space.combined(part);
            let error = algebraic(self.full, value, &vector);
            let nothing = error.max(1e-9 * value.norm());
            // No mode of the operator grows; of its projection, where friction depends on the displacement, some may.
            let grows = self.full.is_local() && value.re >= 0.0;
            let lost = error > value.norm() && !self.near_zero(value, error, &vector);
            if lost || value.im < -nothing || grows {
                continue;
            }
            // A real eigenvalue of a real matrix has no imaginary part beyond its error.
            let im = if value.im <= nothing { 0.0 } else { value.im };
            let value = C::new(value.re, im);
            modes.push(Mode { value, error });
        }
        Ok(modes)
    }

    /// Whether a mode is nearer to 0 than rounding tells, and not the law itself that rounding brought back: between two wells it
    /// may be the slowest of all.
    fn near_zero(&self, value: C, error: f64, vector: &[C]) -> bool {
        let norm = |x: &[C]| x.iter().map(C::norm_sqr).sum::<f64>();
        let mut rest = vector.to_vec();
        self.full.drop_constant(&mut rest);
        value.norm().max(error) < NEAR_ZERO && norm(&rest) > 0.5 * norm(vector)
    }
}

/// |L x - lambda x| |x| / |J x . x|, J the reversal of v, and rounding. Where friction depends on the displacement J x is
/// the left vector in part only, and the residual counts [`SKEWED`] times.
fn algebraic(full: &Hierarchy, value: C, x: &[C]) -> f64 {
    let image = full.apply(x).into_iter();
    let residual: f64 = image.zip(x).map(|(y, x)| (y - value * x).norm_sqr()).sum();
    let norm: f64 = x.iter().map(C::norm_sqr).sum();
    let (even, odd) = x.split_at(full.even());
    let square = |x: &[C]| x.iter().map(|x| x * x).sum::<C>();
    let skewed = if full.is_local() { SKEWED } else { 1.0 };
    skewed * (residual * norm).sqrt() / (square(even) - square(odd)).norm() + ROUNDING * full.size()
}
