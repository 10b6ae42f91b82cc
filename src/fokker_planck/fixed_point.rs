//! The fixed point of a linear map that keeps the mass, by GMRES, and the eigenvalues of the map as a by-product.
//!
//! x = P x with a given mass: x = x_0 + d, (I - P) d = P x_0 - x_0, and both sides have no mass, where I - P is regular.
//! Arnoldi's vectors are orthonormal in the L2 norm against the inverse weights, in which a Fokker-Planck map contracts
//! (Saad and Schultz, SIAM J. Sci. Stat. Comput. 7, 856, 1986); the Ritz values of I - P are 1 less the eigenvalues
//! of P.

use super::krylov::{Krylov, Ritz};
use crate::error::{Error, Result};
use crate::matrix::grid;
use crate::sparse::{DenseLu, eigen, eigenvalues};
use num_complex::Complex;

/// A fixed point.
pub(super) struct Fixed {
    /// P x - x in the norm, which bounds its L1 norm where the weights sum to 1.
    pub(super) residual: f64,
    /// The modulus of the largest eigenvalue but 1.
    pub(super) slowest: f64,
    pub(super) modes: Modes,
    /// Times the map was applied.
    pub(super) maps: usize,
}

/// What is known of the modes of the map beside its fixed point.
#[derive(Default)]
pub(super) struct Modes {
    /// The largest eigenvalues but 1, the largest first, of modes that the cells resolve; of a complex pair the one with the
    /// positive imaginary part.
    pub(super) eigenvalues: Vec<Ritz>,
    /// What the start has of the eigenvector of the first of them beside the fixed point, where that is real.
    pub(super) slow: Option<Vec<f64>>,
}

/// How much more slowly than all else the slowest mode fades where it is the passage from one orbit to another.
const SLOWER: f64 = 10.0;

/// What begins about an orbit is a law of its own once all else has fallen by e so many times.
const SETTLED: f64 = 2.0;

impl Fixed {
    /// Where the slowest mode is real and stands apart from the others: what is left of it once they have faded.
    pub(super) fn settled(&self) -> Option<f64> {
        let [slowest, next, ..] = &self.modes.eigenvalues[..] else {
            return None;
        };
        let slow = slowest.value.re.ln();
        let fast = (next.value.norm() + next.error).ln();
        let apart = slowest.value.im == 0.0 && slow < 0.0 && SLOWER * slow > fast;
        apart.then(|| (-SETTLED * slow / fast).exp())
    }
}

/// What is sought.
#[derive(Debug, Clone, Copy)]
pub(super) struct Goal {
    /// Error of the fixed point in L1: its residual over 1 less the largest eigenvalue.
    pub(super) error: f64,
    /// Error of that eigenvalue, relative to it.
    pub(super) eigenvalue: f64,
    /// Vectors that may be held.
    pub(super) vectors: usize,
}

/// Eigenvalues reported.
const EIGENVALUES: usize = 4;

/// Restarts before giving up.
const RESTARTS: usize = 12;

/// Vectors between two looks at the eigenvalues, which begin at a residual of so much of the error sought.
const LOOK: usize = 4;
const FIRST_LOOK: f64 = 0.05;

/// Vectors spent on an eigenvalue once the fixed point is there.
const BEYOND: usize = 48;

/// Roughness beyond which a vector is a wave of the mesh's, not of the motion's: next to that of a wave of two cells, 4.
const OF_A_WAVE: f64 = 3.7;

/// What rounding leaves of a residual.
const ROUNDING: f64 = 1e-13;

/// Overwrites `x`, a row of cells for each weight along the first direction, with the fixed point of its mass.
///
/// # Errors
/// Those of the map; [`Error::Linear`] where no restart brings the residual down.
pub(super) fn solve(
    x: &mut [f64],
    [first, second]: [&[f64]; 2],
    goal: Goal,
    map: &mut dyn FnMut(&mut [f64]) -> Result<()>,
) -> Result<Fixed> {
    let weights: Vec<f64> = grid(first, second).map(|[a, b]| a * b).collect();
    let weights = &weights[..];
    let inverse = weights.iter().map(|w| if *w > 0.0 { 1.0 / w } else { 0.0 });
    let inverse: Vec<f64> = inverse.collect();
    let cells = (&inverse[..], second.len());
    let mut fixed = Fixed {
        residual: f64::INFINITY,
        slowest: 0.0,
        modes: Modes::default(),
        maps: 0,
    };
    let mut target = f64::INFINITY;
    for restart in 0..RESTARTS {
        let mut residual = x.to_vec();
        map(&mut residual)?;
        fixed.maps += 1;
        for (r, x) in residual.iter_mut().zip(&*x) {
            *r -= x;
        }
        without_mass(&mut residual, weights);
        let size = dot(&residual, &residual, &inverse).sqrt();
        let stalled = size > 0.5 * fixed.residual;
        fixed.residual = size;
        // Of what is the fixed point from the first nothing more is known.
        if size <= f64::MIN_POSITIVE || (restart > 0 && (size <= 2.0 * target || stalled)) {
            break;
        }
        // What the space before knew of the start was not all.
        fixed.modes.slow = None;
        let mut space = Krylov::of(residual.iter().map(|r| r / size).collect());
        target = f64::INFINITY;
        // A space that begins near the fixed point shows little of what the one before knew.
        let (mut there, before) = (None, fixed.slowest);
        loop {
            let last = step(&mut space, (weights, &inverse), map)?;
            fixed.maps += 1;
            let columns = space.size();
            let full = last || columns >= goal.vectors;
            let (_, left) = space.least_squares(size);
            if left <= FIRST_LOOK * goal.error && columns.is_multiple_of(LOOK) || full {
                fixed.slowest = slowest(&space)?.max(before);
                target = (0.5 * goal.error * (1.0 - fixed.slowest)).max(ROUNDING);
            }
            if left <= target && target.is_finite() {
                let since = columns - *there.get_or_insert(columns);
                if since > BEYOND || !fixed.modes.eigenvalues.is_empty() && restart > 0 {
                    break;
                }
                if since.is_multiple_of(2 * LOOK) {
                    let seen = fixed.modes.eigenvalues.first().copied();
                    fixed.modes = ritz(&space, size, cells)?;
                    let first = fixed.modes.eigenvalues.first();
                    // Seen twice: one that the start has little of comes up late, above others that are there.
                    let found = |it: &Ritz| {
                        let close = goal.eigenvalue * it.value.norm();
                        let same = seen.is_some_and(|seen| (seen.value - it.value).norm() <= close);
                        same && it.error <= close
                    };
                    if first.is_none_or(found) {
                        break;
                    }
                }
            }
            if full {
                break;
            }
        }
        // Of a space that begins near the fixed point those before are better.
        if fixed.modes.eigenvalues.is_empty() || restart == 0 {
            fixed.modes = ritz(&space, size, cells)?;
        }
        let (solution, left) = space.least_squares(size);
        for (x, d) in x.iter_mut().zip(space.combined(&solution)) {
            *x += d;
        }
        fixed.residual = left;
    }
    if fixed.residual > 1e-3 || !fixed.residual.is_finite() {
        let what = format!(
            "after {} periods it still changes by {:.1e} in one",
            fixed.maps, fixed.residual
        );
        return Err(Error::linear("the periodic law", what));
    }
    Ok(fixed)
}

/// Takes away the mass of `x` and no more: the projection in the norm. What rounding leaves of it would grow from vector to
/// vector, into the fixed point itself.
fn without_mass(x: &mut [f64], weights: &[f64]) {
    let mass = x.iter().sum::<f64>() / weights.iter().sum::<f64>();
    for (x, w) in x.iter_mut().zip(weights) {
        *x -= mass * w;
    }
}

fn dot(a: &[f64], b: &[f64], inverse: &[f64]) -> f64 {
    let all = a.iter().zip(b).zip(inverse);
    all.map(|((a, b), w)| a * b * w).sum()
}

/// One vector more of Arnoldi's process for I - P; true where there is none.
fn step(
    space: &mut Krylov<f64>,
    (weights, inverse): (&[f64], &[f64]),
    map: &mut dyn FnMut(&mut [f64]) -> Result<()>,
) -> Result<bool> {
    let Some(last) = space.last() else {
        return Ok(true);
    };
    let mut w = last.to_vec();
    map(&mut w)?;
    for (w, v) in w.iter_mut().zip(last) {
        *w = v - *w;
    }
    let clean = |x: &mut [f64]| without_mass(x, weights);
    space.push(w, 2, |a, b| dot(a, b, inverse), clean);
    Ok(space.last().is_none())
}

/// The modulus of the largest Ritz value of P, at most 1.
fn slowest(space: &Krylov<f64>) -> Result<f64> {
    let values = eigenvalues(&space.hessenberg())?;
    let apart = values.iter().map(|it| (1.0 - it).norm());
    Ok(apart.fold(0.0, f64::max).min(1.0))
}

/// Ritz values of P with their errors, the largest first, and what a start, its residual of this `size`, has of the Ritz vector
/// of that one, where it is real.
fn ritz(space: &Krylov<f64>, size: f64, cells: (&[f64], usize)) -> Result<Modes> {
    let m = space.size();
    let (values, vectors) = eigen(&space.hessenberg().mapv(Complex::from))?;
    let left = DenseLu::factor(&vectors.t().to_owned())?;
    let over = space.rest();
    let (solution, _) = space.least_squares(size);
    let mut found = Vec::new();
    for (k, value) in values.iter().enumerate() {
        let mut value = 1.0 - value;
        // What rounding makes of a real one.
        if value.im.abs() <= ROUNDING {
            value.im = 0.0;
        }
        if value.im < 0.0 {
            continue;
        }
        // A row of the inverse of the eigenvectors: how much a residual may move the eigenvalue.
        let mut row = vec![Complex::from(0.0); m];
        row[k] = Complex::from(1.0);
        let condition = match left.solve(&mut row) {
            Ok(()) => row.iter().map(Complex::norm_sqr).sum::<f64>().sqrt(),
            Err(_) => f64::INFINITY,
        };
        let error = over * vectors[[m - 1, k]].norm() * condition;
        let part: Complex<f64> = row.iter().zip(&solution).map(|(a, y)| a * y).sum();
        found.push((Ritz { value, error }, k, part));
    }
    found.sort_by(|(a, ..), (b, ..)| b.value.norm().total_cmp(&a.value.norm()));
    let parts = [|z: &Complex<f64>| z.re, |z: &Complex<f64>| z.im];
    let mut own = Vec::new();
    for one in found {
        let column = vectors.column(one.1);
        let mode = parts.map(|part| space.combined(&column.iter().map(part).collect::<Vec<f64>>()));
        if roughness(&mode, cells) <= OF_A_WAVE {
            own.push(one);
        }
        if own.len() == EIGENVALUES {
            break;
        }
    }
    let real = own.first().filter(|(it, ..)| it.value.im == 0.0);
    let slow = real.map(|(_, k, part)| {
        let column: Vec<f64> = vectors.column(*k).iter().map(|z| -(z * part).re).collect();
        space.combined(&column)
    });
    Ok(Modes {
        eigenvalues: own.into_iter().map(|it| it.0).collect(),
        slow,
    })
}

/// The mean square of what neighbours differ by in a mode over its weights, over that of the mode, along the direction where it
/// is larger: 4 for a wave of two cells, 1 for one of six.
fn roughness(mode: &[Vec<f64>; 2], (inverse, row): (&[f64], usize)) -> f64 {
    let ratio = |k: usize| [mode[0][k] * inverse[k], mode[1][k] * inverse[k]];
    let square = |[a, b]: [f64; 2]| a * a + b * b;
    let along = |next: usize| {
        let (mut between, mut within) = (0.0, 0.0);
        for k in 0..inverse.len().saturating_sub(next) {
            let other = k + next;
            if inverse[k] == 0.0 || inverse[other] == 0.0 || next == 1 && other.is_multiple_of(row)
            {
                continue;
            }
            let ([a, b], [c, d]) = (ratio(k), ratio(other));
            let weight = 1.0 / inverse[k].max(inverse[other]);
            between += weight * square([a - c, b - d]);
            within += 0.5 * weight * (square([a, b]) + square([c, d]));
        }
        if within > 0.0 { between / within } else { 0.0 }
    };
    along(1).max(along(row))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stationary_law_of_a_markov_chain_and_its_eigenvalues_are_found() {
        // A walk on n places that stays, or goes one up or down: eigenvalues 0.6 + 0.4 cos(pi k/n), mirrored at the ends.
        let n = 40;
        let mut map = |x: &mut [f64]| {
            let old = x.to_vec();
            for (k, x) in x.iter_mut().enumerate() {
                let (below, above) = (old[k.saturating_sub(1)], old[(k + 1).min(n - 1)]);
                *x = 0.6 * old[k] + 0.2 * (below + above);
            }
            Ok(())
        };
        let mut x: Vec<f64> = (0..n).map(|k| f64::from(u8::from(k == 3))).collect();
        let weights = vec![1.0 / n as f64; n];
        let goal = Goal {
            error: 1e-9,
            eigenvalue: 1e-9,
            vectors: 60,
        };
        let fixed = solve(&mut x, [&weights, &[1.0]], goal, &mut map).unwrap();
        let worst = x
            .iter()
            .map(|x| (x * n as f64 - 1.0).abs())
            .fold(0.0, f64::max);
        println!(
            "{} maps, residual {:.1e}, off by {worst:.1e}",
            fixed.maps, fixed.residual
        );
        assert!(worst < 4e-8 && fixed.residual <= 1e-9);
        for (k, ritz) in (1..).zip(&fixed.modes.eigenvalues) {
            let exact = 0.6 + 0.4 * (std::f64::consts::PI * f64::from(k) / n as f64).cos();
            let off = (ritz.value - exact).norm();
            println!(
                "{:.10} against {exact:.10}, said {:.1e}",
                ritz.value.re, ritz.error
            );
            assert!(off <= ritz.error + 1e-12, "{k}");
        }
        assert!(fixed.modes.eigenvalues[0].error < 1e-8);
    }
}
