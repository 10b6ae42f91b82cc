//! The mean time to the first loss by Pontryagin's equation L m = -1, and the slowest mode of the absorbed
//! motion, from one Krylov space of the survival over a few steps.
//!
//! With P the survival over a step tau, the sums X = sum_n P^n u of the survivals solve (I - P) X = u, and
//! with B = P^k so that B forgets part of the start, (I - B) X = u + P u + ... + P^(k-1) u. GMRES (Saad and
//! Schultz, SIAM J. Sci. Stat. Comput. 7, 1986, 856) solves it, and the Ritz values of its space hold the
//! slowest mode (Arnoldi). The space grows until it holds that: one begun anew forgets all but the mode, and takes four times
//! as many vectors (power law of exponent 2 with a gap of 1.03, zeta = 0.0187, T = 0.0019: 207 for 43).

use super::absorbed::Absorbed;
use crate::error::{Deadline, Error, Result};
use crate::fokker_planck::krylov::Krylov;
use crate::matrix::{dot, norm};
use crate::sparse;
use num_complex::Complex;

/// Vectors that a space grows by between two looks at what it holds.
const GROWTH: usize = 4;
/// Vectors of one that corrects the sum.
const CORRECTING: usize = 16;
/// At so many a space is given up for one that begins with the modes found.
pub(super) const FULL: usize = 40;
/// Spaces built one after another, at the most.
const CYCLES: usize = 12;
/// Of a factor of a step.
const ROUNDING: f64 = 8.0 * f64::EPSILON;
/// What the long run of an absorbed motion is.
#[derive(Debug, Clone)]
pub(crate) struct LongRun {
    /// X = sum over n of all survivals; None where losses are so rare that it is the slowest mode alone; NaN where what is lost of
    /// that is rounding.
    pub(crate) sum: Option<Vec<f64>>,
    /// The slowest mode, and the exponent by which it falls in a step; 0 where that is rounding.
    pub(crate) mode: Vec<f64>,
    pub(crate) exponent: f64,
    /// Relative errors of the sum and of 1 - factor that the iteration leaves.
    pub(crate) residuals: [f64; 2],
    /// Steps taken.
    pub(crate) steps: u64,
}

impl LongRun {
    /// One that is a mode alone, of which so much is lost in a step.
    fn of_rare(mode: Vec<f64>, lost: f64, error: f64, steps: u64) -> Self {
        Self {
            sum: None,
            mode,
            exponent: -(-lost).ln_1p(),
            residuals: [0.0, error],
            steps,
        }
    }

    /// One of which nothing is told.
    fn of_rounding(mode: Vec<f64>, steps: u64) -> Self {
        Self {
            sum: Some(vec![f64::NAN; mode.len()]),
            mode,
            exponent: 0.0,
            residuals: [0.0; 2],
            steps,
        }
    }
}

/// From the survivals after some steps and the sum of those before: the later, the nearer to the slowest mode, and the sooner a space
/// holds it. `stride` steps a Krylov vector; ends at the relative errors `enough`; `rare` tells of a mode what is lost of it in
/// a step by detailed balance, if that is next to nothing; `late` stops it.
///
/// (I - B) all but annihilates the slowest mode phi where losses are rare, and GMRES does not see it: what is left is
/// projected on it by its left eigenvector, which detailed balance gives, p_s(q, v) phi(q, -v). Where the law is not
/// exp(-H/T)/Z that vector is near enough for the projection to shrink the rest from cycle to cycle. Each of several
/// `wells` holds a mode that is nearly as slow; no power of B tells them apart, so that the space begins with as many
/// vectors, of different means in each well.
pub(crate) fn long_run(
    absorbed: &Absorbed,
    (survival, before): (&[f64], &[f64]),
    (stationary, nv): (&[f64], usize),
    wells: usize,
    (stride, enough): (usize, f64),
    rare: &dyn Fn(&[f64]) -> Option<f64>,
    late: &Deadline,
) -> Result<LongRun> {
    let n = absorbed.len();
    let mut scratch = vec![0.0; n];
    let mut steps = 0;
    let mut several = |field: &[f64], sum: Option<&mut [f64]>| -> Result<Vec<f64>> {
        late()?;
        let mut field = field.to_vec();
        let mut sum = sum;
        for _ in 0..stride {
            if let Some(sum) = sum.as_deref_mut() {
                for (s, u) in sum.iter_mut().zip(&field) {
                    *s += u;
                }
            }
            absorbed.advance(&mut field, &mut scratch);
        }
        steps += stride as u64;
        Ok(field)
    };
    // The sum of the first `stride`.
    let mut given = vec![0.0; n];
    several(survival, Some(&mut given))?;
    let size = norm(&given);
    let balance = Balance { stationary, nv };
    let mut sum = vec![0.0; n];
    let mut left = given.clone();
    let begun = |power: i32| Mode {
        shape: (0..n)
            .map(|k| given[k] * (k as f64 / n as f64).powi(power))
            .collect(),
        factor: 1.0,
        residual: f64::INFINITY,
    };
    let mut modes: Vec<Mode> = (0..wells as i32).map(begun).collect();
    let mut residuals = [1.0, 1.0];
    // No further space brings the mode nearer, as where the slowest is a pair that goes round.
    let mut stuck = false;
    let least = ROUNDING * stride as f64;
    for cycle in 0..CYCLES {
        // The modes first, as far as half the spaces bring them, then the sum.
        let solving = residuals[1] <= enough || stuck || cycle >= CYCLES / 2;
        let from = if solving {
            vec![left.clone()]
        } else {
            modes.iter().map(|it| it.shape.clone()).collect()
        };
        let mut space = Space::of(from)?;
        let mut apply = |field: &[f64]| several(field, None);
        if solving {
            space.grow(CORRECTING, &mut apply)?;
        } else if let Some(lost) = space.find(&mut modes, (enough, least), rare, &mut apply)? {
            let Mode {
                shape, residual, ..
            } = modes.swap_remove(0);
            return Ok(LongRun::of_rare(shape, lost, residual, steps));
        }
        stuck |= cycle > 0 && !solving && modes[0].error() >= residuals[1];
        residuals[1] = modes[0].error();
        if modes[0].is_rounding(least) {
            // Of several wells the next mode must be told from it.
            let apart = modes.get(1).map_or(1.0, Mode::lost);
            let Mode {
                shape, residual, ..
            } = modes.swap_remove(0);
            let lost = rare(&shape).filter(|lost| *lost > 0.0 && residual < enough * apart);
            return Ok(match lost {
                Some(lost) => LongRun::of_rare(shape, lost, residual / apart, steps),
                None => LongRun::of_rounding(shape, steps),
            });
        }
        let last = residuals[0];
        // The first space is that of both.
        if solving || cycle == 0 {
            space.correct(&left, &mut sum)?;
            // Once along the slow modes; what is left along them then is an error of the sum, magnified by 1/lost.
            for projecting in [true, false] {
                left = open_of(&given, &sum, &several(&sum, None)?)?;
                let open = balance.project(&modes, &left, projecting.then_some(&mut sum));
                residuals[0] = open / balance.length(&modes[0].shape, &sum) + norm(&left) / size;
            }
        }
        // What rounding leaves of a sum along a mode of which so little is lost no further space takes away.
        let stalled = 0.5 * last..ROUNDING / modes[0].lost();
        let rounded = solving && stalled.contains(&residuals[0]);
        if (residuals[0] <= enough || rounded) && (residuals[1] <= enough || stuck) {
            break;
        }
    }
    let mut exponent = modes[0].exponent(least)? / stride as f64;
    let shape = modes.swap_remove(0).shape;
    sum.iter_mut()
        .zip(before)
        .for_each(|(x, before)| *x += before);
    // Detailed balance keeps the digits of what is next to nothing, which a mesh of many losses does not have.
    if let Some(lost) = rare(&shape).filter(|lost| *lost > 0.0) {
        let of_mesh = exponent;
        exponent = -(-lost).ln_1p();
        let part = balance.along(&shape, &sum) / balance.along(&shape, &shape);
        let more = part * (of_mesh / exponent - 1.0);
        sum.iter_mut().zip(&shape).for_each(|(x, m)| *x += more * m);
    }
    Ok(LongRun {
        sum: Some(sum),
        mode: shape,
        exponent,
        residuals,
        steps,
    })
}

/// What no survival does, and one on cells much coarser than what noise does in a step may.
fn grows() -> Error {
    Error::linear("survival", "it grows on this mesh")
}

/// What a sum leaves of (I - B) X = `given`, its `image` being B X.
fn open_of(given: &[f64], sum: &[f64], image: &[f64]) -> Result<Vec<f64>> {
    let parts = given.iter().zip(sum).zip(image);
    let left: Vec<f64> = parts.map(|((given, x), image)| given - x + image).collect();
    if norm(&left).is_finite() {
        Ok(left)
    } else {
        Err(grows())
    }
}

/// What detailed balance says of parts along modes.
struct Balance<'a> {
    /// Weights of the stationary law on the nodes, and how many there are of v.
    stationary: &'a [f64],
    nv: usize,
}

impl Balance<'_> {
    /// The sum of p_s(q, v) mode(q, -v) field(q, v).
    fn along(&self, mode: &[f64], field: &[f64]) -> f64 {
        let rows = mode
            .chunks_exact(self.nv)
            .zip(self.stationary.chunks_exact(self.nv))
            .zip(field.chunks_exact(self.nv));
        let row = |((mode, weights), field): ((&[f64], &[f64]), &[f64])| -> f64 {
            let reversed = mode.iter().rev().zip(weights).zip(field);
            reversed.map(|((m, w), x)| m * w * x).sum()
        };
        rows.map(row).sum()
    }

    /// How large a field is along a mode.
    fn length(&self, mode: &[f64], field: &[f64]) -> f64 {
        (self.along(mode, field) / self.along(mode, mode).sqrt()).abs()
    }

    /// How large the sum is along the slow modes that (I - B) takes to what is left, which it adds to one.
    fn project(&self, modes: &[Mode], left: &[f64], mut sum: Option<&mut Vec<f64>>) -> f64 {
        let mut open = 0.0;
        for (k, mode) in modes.iter().enumerate() {
            // Further ones that are not known are not slow.
            if k > 0 && mode.error() > 0.1 {
                continue;
            }
            let own = self.along(&mode.shape, &mode.shape);
            let part = self.along(&mode.shape, left) / mode.lost() / own;
            for (x, m) in sum
                .iter_mut()
                .flat_map(|sum| sum.iter_mut())
                .zip(&mode.shape)
            {
                *x += part * m;
            }
            open += part.abs() * own.abs().sqrt();
        }
        open
    }
}

/// A Ritz vector of B, made real.
struct Mode {
    shape: Vec<f64>,
    factor: f64,
    /// |B phi - factor phi| of |phi| = 1.
    residual: f64,
}

impl Mode {
    /// What is lost of it over a stride; rounding is the least that is told of a factor.
    fn lost(&self) -> f64 {
        (1.0 - self.factor).max(f64::EPSILON)
    }

    /// What that may be off, relative to it.
    fn error(&self) -> f64 {
        self.residual / self.lost()
    }

    /// -ln factor.
    ///
    /// # Errors
    /// [`Error::Linear`] for a mode that grows, by more than is `least` told of a factor.
    fn exponent(&self, least: f64) -> Result<f64> {
        if self.factor - 1.0 > self.residual.max(least) {
            return Err(grows());
        }
        Ok(-self.factor.max(0.0).ln())
    }

    /// Whether it is known to rounding, `least`, and no more than that is lost of it.
    fn is_rounding(&self, least: f64) -> bool {
        self.residual.max((1.0 - self.factor).abs()) < least
    }
}

/// The span of some vectors and of powers of B times them.
struct Space(Krylov<f64>);

impl Space {
    fn of(from: Vec<Vec<f64>>) -> Result<Self> {
        let space = Krylov::spanned_by(from, dot);
        if space.basis().is_empty() {
            return Err(Error::linear("survival", "nothing is left"));
        }
        Ok(Self(space))
    }

    /// By so many images, if there are as many.
    fn grow(
        &mut self,
        count: usize,
        apply: &mut dyn FnMut(&[f64]) -> Result<Vec<f64>>,
    ) -> Result<()> {
        for _ in 0..count {
            let Some(last) = self.0.last() else {
                break;
            };
            let image = apply(last)?;
            self.0.push(image, 2, dot, |_| ());
        }
        Ok(())
    }

    /// Grows it until it holds the slowest mode to `enough` or to rounding, `least`, or is full; what is lost of that in a step where
    /// it is next to nothing: in a single well so rare a loss forgets the start long before, and the sum is the slowest mode.
    fn find(
        &mut self,
        modes: &mut Vec<Mode>,
        (enough, least): (f64, f64),
        rare: &dyn Fn(&[f64]) -> Option<f64>,
        apply: &mut dyn FnMut(&[f64]) -> Result<Vec<f64>>,
    ) -> Result<Option<f64>> {
        loop {
            self.grow(GROWTH.max(modes.len()), apply)?;
            let found = self.slowest(modes.len())?;
            if found[0].residual < modes[0].residual {
                *modes = found;
            }
            let Mode {
                shape, residual, ..
            } = &modes[0];
            if modes.len() == 1 && *residual <= enough {
                let lost = rare(shape);
                if lost.is_some() {
                    return Ok(lost);
                }
            }
            let full = self.0.size() >= FULL.min(self.0.basis().len());
            if full || modes[0].error() <= enough || modes[0].is_rounding(least) {
                return Ok(None);
            }
        }
    }

    /// The Ritz vectors of the largest Ritz values, the slowest first.
    fn slowest(&self, count: usize) -> Result<Vec<Mode>> {
        let (m, whole) = (self.0.size(), self.0.rows(self.0.basis().len()));
        let (values, vectors) = sparse::eigen(&self.0.hessenberg().mapv(Complex::from))?;
        // The slowest mode of an absorbed motion is real and positive (Krein and Rutman).
        let mut order: Vec<usize> = (0..m).collect();
        order.sort_by(|a, b| values[*b].re.total_cmp(&values[*a].re));
        let mode = |k: &usize| {
            let column = vectors.column(*k);
            // Made real: divided by the phase of its largest component.
            let top = column
                .iter()
                .max_by(|a, b| a.norm().total_cmp(&b.norm()))
                .copied()
                .unwrap_or_default();
            let phase = top / top.norm();
            let weights: Vec<f64> = column.iter().map(|x| (x / phase).re).collect();
            let outside = whole.rows().into_iter().skip(m);
            let outside = outside.map(|row| row.iter().zip(&column).map(|(h, y)| *h * y).sum());
            let residual = outside.map(|x: Complex<f64>| x.norm_sqr()).sum::<f64>();
            Mode {
                shape: self.0.combined(&weights),
                factor: values[*k].re,
                residual: residual.sqrt() + values[*k].im.abs(),
            }
        };
        Ok(order.iter().take(count).map(mode).collect())
    }

    /// Adds the V y that leaves least of r - (I - B) V y, r in the span that the space began with.
    fn correct(&self, r: &[f64], sum: &mut [f64]) -> Result<()> {
        let basis = self.0.basis();
        let mut matrix = self.0.rows(basis.len()).mapv(|x| -x);
        matrix.diag_mut().mapv_inplace(|x| x + 1.0);
        let right: Vec<f64> = basis.iter().map(|it| dot(it, r)).collect();
        let more = self.0.combined(&sparse::least_squares(&matrix, &right)?);
        sum.iter_mut().zip(&more).for_each(|(x, y)| *x += y);
        Ok(())
    }
}
