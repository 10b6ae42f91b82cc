//! GMRES for (I - a L) x = b, preconditioned from the right (Saad and Schultz, SIAM J. Sci. Stat. Comput.
//! 7, 856, 1986).

use super::system::System;
use crate::error::{Error, Result};
use crate::sparse::{Lu, Scalar};
use num_complex::{Complex, ComplexFloat};
use std::ops::{Neg, Sub};

/// Vectors before a restart.
const VECTORS: usize = 40;

/// Restarts before giving up.
const RESTARTS: usize = 25;

/// f64 or Complex<f64>.
pub(super) trait Number:
    Scalar + ComplexFloat<Real = f64> + Neg<Output = Self> + Sub<Output = Self> + Send + Sync
{
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

/// The work space of one solver.
pub(super) struct Gmres<T: Number> {
    basis: Vec<Vec<T>>,
    work: Vec<T>,
    residual: Vec<T>,
    /// g and its rate on the cells.
    g: Vec<f64>,
    rate: Vec<f64>,
}

impl<T: Number> Gmres<T> {
    pub(super) fn new(system: &System) -> Self {
        let (n, cells) = (system.cells.len(), system.generator.mesh().len());
        Self {
            basis: vec![vec![T::default(); n]; VECTORS + 1],
            work: vec![T::default(); n],
            residual: vec![T::default(); n],
            g: vec![0.0; cells],
            rate: vec![0.0; cells],
        }
    }

    /// The last basis vector = (I - a L) work, matrix-free.
    fn apply(&mut self, system: &System, a: T) {
        let inverse = system.generator.inverse_weights();
        let product = &mut self.basis[VECTORS];
        product.copy_from_slice(&self.work);
        for part in 0..T::PARTS {
            for (x, cell) in self.work.iter().zip(&system.cells) {
                self.g[*cell] = [x.re(), x.im()][part] * inverse[*cell];
            }
            system.generator.apply(&self.g, &mut self.rate);
            for (y, cell) in product.iter_mut().zip(&system.cells) {
                let mut parts = [0.0; 2];
                parts[part] = self.rate[*cell];
                *y -= a * T::of(parts);
            }
        }
    }

    /// Overwrites b with x, so that the L1 norm of the residual is at most `allowed`, or 1e-13 of that
    /// of b. Where the weights are in the null space of L their part of b is solved exactly; the mass is everywhere.
    pub(super) fn solve(
        &mut self,
        system: &System,
        lu: &mut Lu<T>,
        a: T,
        b: &mut [T],
        allowed: f64,
    ) -> Result<()> {
        let size = |x: &[T]| -> f64 { x.iter().map(|x| x.size()).sum() };
        // A residual is known to the rounding of a L x, which a stiff L makes larger than 1e-13.
        let rounding = 1e-13f64.max(4.0 * f64::EPSILON * system.rate * a.abs());
        let target = allowed.max(rounding * size(b));
        let share = |x: &[T]| x.iter().fold(T::default(), |sum, x| sum + *x);
        let mass = share(b);
        if let Some(weights) = system.weights.as_ref().filter(|_| system.are_stationary) {
            // (I - a L) p_s = p_s.
            for (b, p) in b.iter_mut().zip(weights) {
                *b -= mass * T::real(*p);
            }
        }
        let mut x = vec![T::default(); b.len()];
        self.residual.copy_from_slice(b);
        let mut left = size(&self.residual);
        for _ in 0..RESTARTS {
            if left <= target {
                break;
            }
            self.cycle(system, lu, a, &mut x, target / left)?;
            self.work.copy_from_slice(&x);
            self.apply(system, a);
            for ((r, b), y) in self.residual.iter_mut().zip(&*b).zip(&self.basis[VECTORS]) {
                *r = *b - *y;
            }
            left = size(&self.residual);
        }
        if left.is_nan() || left > target {
            let what = format!("a residual of {left:.1e} was left, above {target:.1e}");
            return Err(Error::linear("GMRES", what));
        }
        if let Some(weights) = &system.weights {
            let kept = mass - share(&x);
            for (x, p) in x.iter_mut().zip(weights) {
                *x += kept * T::real(*p);
            }
        }
        b.copy_from_slice(&x);
        Ok(())
    }

    /// At most VECTORS - 1 steps from the residual, until it has fallen by `factor` in the Euclidean norm;
    /// adds the correction to x.
    fn cycle(
        &mut self,
        system: &System,
        lu: &mut Lu<T>,
        a: T,
        x: &mut [T],
        factor: f64,
    ) -> Result<()> {
        let dot = |x: &[T], y: &[T]| {
            x.iter()
                .zip(y)
                .fold(T::default(), |sum, (x, y)| sum + x.conj() * *y)
        };
        let beta = dot(&self.residual, &self.residual).re().sqrt();
        for (v, r) in self.basis[0].iter_mut().zip(&self.residual) {
            *v = *r * T::real(1.0 / beta);
        }
        // Columns of the Hessenberg matrix, rotated to triangular form as they come.
        let mut columns: Vec<Vec<T>> = Vec::new();
        let mut rotations: Vec<(f64, T)> = Vec::new();
        let mut right = vec![T::real(beta)];
        for k in 0..VECTORS - 1 {
            (system.late)()?;
            self.work.copy_from_slice(&self.basis[k]);
            lu.solve(&mut self.work)?;
            self.apply(system, a);
            let mut w = std::mem::take(&mut self.basis[VECTORS]);
            let mut column = Vec::with_capacity(k + 2);
            for v in &self.basis[..=k] {
                let h = dot(v, &w);
                for (w, v) in w.iter_mut().zip(v) {
                    *w -= h * *v;
                }
                column.push(h);
            }
            let length = dot(&w, &w).re().sqrt();
            for (i, (c, s)) in rotations.iter().enumerate() {
                let (x, y) = (column[i], column[i + 1]);
                column[i] = T::real(*c) * x + *s * y;
                column[i + 1] = T::real(*c) * y - s.conj() * x;
            }
            let top = column[k];
            let hypotenuse = top.abs().hypot(length);
            let (c, s) = if top.abs() > 0.0 {
                (
                    top.abs() / hypotenuse,
                    top * T::real(length / (top.abs() * hypotenuse)),
                )
            } else {
                (0.0, T::real(1.0))
            };
            column[k] = T::real(c) * top + s * T::real(length);
            let next = -(s.conj() * right[k]);
            right[k] *= T::real(c);
            right.push(next);
            rotations.push((c, s));
            columns.push(column);
            let done = next.abs() <= 0.5 * factor * beta || length <= 1e-300;
            if length > 1e-300 {
                for (v, w) in self.basis[k + 1].iter_mut().zip(&w) {
                    *v = *w * T::real(1.0 / length);
                }
            }
            self.basis[VECTORS] = w;
            if done {
                break;
            }
        }
        // Back substitution, then x += M^-1 V y.
        let m = columns.len();
        let mut y = vec![T::default(); m];
        for i in (0..m).rev() {
            let mut sum = right[i];
            for k in i + 1..m {
                sum -= columns[k][i] * y[k];
            }
            y[i] = sum / columns[i][i];
        }
        self.work.fill(T::default());
        for (v, y) in self.basis.iter().zip(&y) {
            for (w, v) in self.work.iter_mut().zip(v) {
                *w += *v * *y;
            }
        }
        lu.solve(&mut self.work)?;
        for (x, w) in x.iter_mut().zip(&self.work) {
            *x += *w;
        }
        Ok(())
    }
}
