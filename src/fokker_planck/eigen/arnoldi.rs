//! Eigenvalues nearest a shift: Arnoldi on the inverse.

use crate::error::{Deadline, Result};
use crate::fokker_planck::hermite::{Factored, Hierarchy};
use crate::fokker_planck::krylov::{Krylov, Ritz, dot};
use crate::sparse::eigen;
use num_complex::Complex;

type C = Complex<f64>;

/// Residual of a Ritz value, relative to it, beyond which it is not converged. An eigenvalue that is close to others
/// may have converged and be known badly all the same.
const CONVERGED: f64 = 1e-3;

/// A shift in place of 0, and how often a residual counts, where friction depends on the displacement.
const ASIDE: f64 = 1e-6;

const SKEWED: f64 = 4.0;

/// What is nearer to 0 is a mode, however little else is known of it: small vibrations go at 1.
const NEAR_ZERO: f64 = 1e-6;

/// Arnoldi's process for (shift - L)^{-1}.
pub(super) struct Arnoldi<'a> {
    inverse: Factored<'a>,
    full: &'a Hierarchy,
    shift: C,
    space: Krylov<C>,
}

impl<'a> Arnoldi<'a> {
    pub(super) fn new(full: &'a Hierarchy, shift: C, late: &Deadline) -> Result<Self> {
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
    pub(super) fn extend(&mut self, steps: usize, late: &Deadline) -> Result<bool> {
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
    pub(super) fn modes(&self) -> Result<Vec<Ritz>> {
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
            let mut error = algebraic(self.full, value, &vector);
            let mut value = value;
            if value.norm() < NEAR_ZERO && !self.full.is_local() {
                // The shift at 0 knows it best; others would tell it once more.
                if self.shift != C::default() {
                    continue;
                }
                let Some(slow) = self.slow(error, vector) else {
                    continue;
                };
                if slow.error < error {
                    Ritz { value, error } = slow;
                }
            } else if error > value.norm() {
                continue;
            }
            let nothing = error.max(1e-9 * value.norm());
            // No mode of the operator grows; of its projection, where friction depends on the displacement, some may.
            let grows = self.full.is_local() && value.re >= 0.0;
            if value.im < -nothing || grows {
                continue;
            }
            // A real eigenvalue of a real matrix has no imaginary part beyond its error.
            let im = if value.im <= nothing { 0.0 } else { value.im };
            let value = C::new(value.re, im);
            modes.push(Ritz { value, error });
        }
        Ok(modes)
    }

    /// A real eigenvalue next to 0, as between two wells, from what friction takes of its mode: transport is antisymmetric and
    /// friction -2 zeta n, so that lambda |x|^2 = -2 zeta sum n |x_n|^2. No term cancels another, while L x is a difference that
    /// rounding hides. `error`, of an eigenvalue of L, over the distance to other ones, is in x, and counts twice beside what
    /// moves in x. None for the law itself, if rounding brought it back.
    fn slow(&self, error: f64, mut x: Vec<C>) -> Option<Ritz> {
        let norm = |x: &[C]| x.iter().map(C::norm_sqr).sum::<f64>();
        let whole = norm(&x);
        self.full.drop_constant(&mut x);
        let left = norm(&x);
        let [taken, moving] = self.full.taken(&x).map(|it| it / left);
        let apart = self.full.relaxation() * moving.sqrt();
        (left > 0.5 * whole).then(|| Ritz {
            value: C::new(-taken, 0.0),
            error: 2.0 * taken * error / apart.max(f64::MIN_POSITIVE),
        })
    }
}

/// |L x - lambda x| |x| / |J x . x|, J the reversal of v, and rounding. Where friction depends on the displacement J x is
/// the left vector in part only, and both count [`SKEWED`] times, and by what tilted functions add.
fn algebraic(full: &Hierarchy, value: C, x: &[C]) -> f64 {
    let image = full.apply(x).into_iter();
    let residual: f64 = image.zip(x).map(|(y, x)| (y - value * x).norm_sqr()).sum();
    let norm: f64 = x.iter().map(C::norm_sqr).sum();
    let (even, odd) = x.split_at(full.even());
    let square = |x: &[C]| x.iter().map(|x| x * x).sum::<C>();
    let skewed = if full.is_local() {
        SKEWED * full.skew()
    } else {
        1.0
    };
    skewed * ((residual * norm).sqrt() / (square(even) - square(odd)).norm() + full.rounding())
}
