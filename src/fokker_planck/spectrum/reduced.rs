//! A small model of the resolvent of the generator, good at all frequencies at once: rational Krylov.
//!
//! The states (i omega_k - L)^{-1} b at a few frequencies, orthonormalised, span a space on which L is
//! projected (Galerkin, so the model is as dissipative as L). With c the model's solution and r its
//! residual, the spectrum follows from
//!
//! ```text
//! b.x = b.V c + (J V c).r + (J e).r,   x = (i omega - L)^{-1} b,  e = x - V c
//! ```
//!
//! v -> -v, J, turns L into its transpose, so J V c solves the adjoint equation too: the second term
//! doubles the digits, and the third bounds what is left by |r|^2 |(i omega - L)^{-1}|.
//!
//! Where friction depends on the displacement the transpose is another operator, and what is watched, times the law
//! solved for, another state l. The space then holds the states (i omega_k - L^T)^{-1} l too, so that
//! l.V c has those digits by itself, and the bound is |r| |r'| |(i omega - L)^{-1}| with the residual r' of the
//! transposed equation.

mod builder;
mod hessenberg;
mod hyman;

use crate::error::Result;
use crate::fokker_planck::hermite::{Adjoint, Hierarchy};
use crate::matrix::exponential;
use crate::sparse::{DenseLu, eigen};
use ndarray::{Array1, Array2, Axis, Slice};
use num_complex::Complex;
use rayon::prelude::*;

type C = Complex<f64>;

/// States of a frequency: (i omega - L)^{-1} b, (i omega - L)^{-2} b, ... A solve takes a small part of the factorisation.
pub(super) const POWERS: usize = 3;

/// The projected generator.
#[derive(Debug, Clone)]
pub(super) struct Reduced {
    right: Side,
    end: End,
    /// b.b, or l.b: the variance.
    pub(super) variance: f64,
    apart: Apart,
    /// Frequencies solved for.
    pub(super) solved: Vec<f64>,
}

/// L or its transpose on a basis that begins with the state it is asked for.
#[derive(Debug, Clone)]
struct Side {
    /// Upper Hessenberg.
    matrix: Array2<f64>,
    /// Size of the state.
    size: f64,
    /// F, F^T F = R^T R of the residuals R = L V - V H.
    root: Array2<f64>,
    /// What rounding makes of L times a state of length 1. A residual that is no larger says nothing of the space.
    rounding: f64,
}

/// How far i omega is from what L has for eigenvalues: the inverse of the largest that a resolvent makes of a residual.
#[derive(Debug, Clone, Copy)]
struct Apart {
    /// The smallest rate of decay of what does not turn: a hop between two wells is far from the frequencies within them.
    real: f64,
    /// That of what turns, taken to turn with any frequency; or the inverse of the largest resolvent seen.
    turning: f64,
}

/// What a solution is multiplied with.
#[derive(Debug, Clone)]
enum End {
    /// b, and what v -> -v makes of the solution, (J V)^T R.
    Mirrored { dual: Array2<f64> },
    /// l on the basis, the transposed equation on a basis of its own, and its modes, all of which decay, each with its part of the
    /// variance.
    Own {
        state: Array1<f64>,
        left: Side,
        modes: Vec<[C; 2]>,
    },
}

/// L and the states a spectrum is made of, Re l.(i omega - L)^{-1} b; l is b but for a friction that depends on the
/// displacement.
pub(super) struct Form {
    pub(super) full: Hierarchy,
    pub(super) adjoint: Option<Adjoint>,
}

/// Re b.(i omega - L)^{-1} b with a bound on its error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Answer {
    pub(super) value: f64,
    pub(super) error: f64,
}

impl Reduced {
    pub(super) fn dimension(&self) -> usize {
        self.right.matrix.nrows()
    }

    pub(super) fn at(&self, omega: f64) -> Answer {
        self.part(&[omega])[0]
    }

    /// The answers at many frequencies, on all threads.
    pub(super) fn all(&self, omegas: &[f64]) -> Vec<Answer> {
        let parts = omegas.par_chunks(hyman::TOGETHER);
        parts.flat_map_iter(|part| self.part(part)).collect()
    }

    /// The answers at some frequencies: their bilinear forms are matrix products.
    fn part(&self, omegas: &[f64]) -> Vec<Answer> {
        let c = self.right.solutions(omegas);
        let residuals = self.right.residuals(&c);
        match &self.end {
            End::Mirrored { dual } => {
                let dual = c.dot(&dual.t());
                let size = self.right.size;
                let answer = |k: usize| {
                    let (re, im) = (c.row(2 * k), c.row(2 * k + 1));
                    let correction = re.dot(&dual.row(2 * k)) - im.dot(&dual.row(2 * k + 1));
                    Answer {
                        value: size * c[[2 * k, 0]] + correction,
                        error: residuals[k] / self.apart.from(omegas[k])
                            + 1e-13 * size * c[[2 * k, 0]].hypot(c[[2 * k + 1, 0]]),
                    }
                };
                (0..omegas.len()).map(answer).collect()
            }
            End::Own { state, left, .. } => {
                let others = left.residuals(&left.solutions(omegas));
                let answer = |k: usize| {
                    let (re, im) = (c.row(2 * k), c.row(2 * k + 1));
                    let product = residuals[k] * others[k];
                    let size = (re.dot(&re) + im.dot(&im)).sqrt();
                    Answer {
                        value: state.dot(&re),
                        error: product.sqrt() / self.apart.from(omegas[k])
                            + 1e-14 * left.size * size,
                    }
                };
                (0..omegas.len()).map(answer).collect()
            }
        }
    }

    /// The correlation function l.e^{L t} b at the times 0, step, 2 step, ...
    pub(super) fn correlation(&self, step: f64, count: usize) -> Vec<f64> {
        if let End::Own { modes, .. } = &self.end {
            let value = |k: usize| -> f64 {
                let t = step * k as f64;
                modes
                    .iter()
                    .map(|[rate, part]| (part * (rate * t).exp()).re)
                    .sum()
            };
            return (0..count).map(value).collect();
        }
        let over = exponential(&self.right.matrix, step);
        let mut x = Array1::<f64>::zeros(self.dimension());
        x[0] = self.variance;
        let mut values = Vec::with_capacity(count);
        for _ in 0..count {
            values.push(x[0]);
            x = over.dot(&x);
        }
        values
    }

    /// The same with its modes. Where v -> -v does not turn L into its transpose a projection may have modes that grow. What one
    /// holds of a spectrum, Re a/(i omega - r), a mode of the rate -r* that holds -a* holds too, and that one decays.
    fn with_modes(mut self) -> Result<Self> {
        let Side { matrix, size, .. } = &self.right;
        if let End::Own { state, modes, .. } = &mut self.end {
            let (rates, vectors) = eigen(&matrix.mapv(C::from))?;
            let mut parts = vec![C::default(); rates.len()];
            parts[0] = C::from(*size);
            DenseLu::factor(&vectors)?.solve(&mut parts)?;
            let all = rates.into_iter().zip(vectors.columns()).zip(parts);
            *modes = all
                .map(|((rate, vector), part)| {
                    let seen: C = vector.iter().zip(&*state).map(|(x, l)| x * l).sum();
                    let mode = [rate, seen * part];
                    if rate.re < 0.0 {
                        mode
                    } else {
                        mode.map(|x| -x.conj())
                    }
                })
                .collect();
        }
        Ok(self)
    }
}

impl Apart {
    /// Of the rates of a model.
    fn of(rates: &[C]) -> Self {
        let smallest = |turns: bool| {
            let those = rates.iter().filter(|it| (it.im != 0.0) == turns);
            those.map(|it| -it.re).fold(f64::INFINITY, f64::min)
        };
        Self {
            real: smallest(false).max(f64::MIN_POSITIVE),
            turning: smallest(true).max(f64::MIN_POSITIVE),
        }
    }

    fn from(self, omega: f64) -> f64 {
        self.real.hypot(omega).min(self.turning)
    }
}

impl Side {
    /// The solutions at some frequencies: real parts, and below each the imaginary one.
    fn solutions(&self, omegas: &[f64]) -> Array2<f64> {
        hyman::solutions(&self.matrix, self.size, omegas)
    }

    /// The squares of their residuals, beyond rounding: where a slow rate stretches a solution, that is all there is of them, and other
    /// resolutions tell what it does.
    fn residuals(&self, c: &Array2<f64>) -> Vec<f64> {
        let left = c.dot(&self.root.t());
        let square = |of: &Array2<f64>, k: usize| -> f64 {
            let rows = of.slice_axis(Axis(0), Slice::from(2 * k..2 * k + 2));
            rows.iter().map(|x| x * x).sum()
        };
        let rounding = self.rounding * self.rounding;
        let residual = |k: usize| (square(&left, k) - rounding * square(c, k)).max(0.0);
        (0..c.nrows() / 2).map(residual).collect()
    }
}

impl Form {
    /// The operators, each with the state it is asked for.
    fn sides(&self) -> Vec<(&Hierarchy, Vec<f64>)> {
        let beside = self.adjoint.iter();
        let beside = beside.map(|it| (&it.operator, it.start.clone()));
        std::iter::once((&self.full, self.full.start()))
            .chain(beside)
            .collect()
    }
}
