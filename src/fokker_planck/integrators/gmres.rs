//! GMRES for (I - a L) x = b, preconditioned from the right (Saad and Schultz, SIAM J. Sci. Stat. Comput.
//! 7, 856, 1986).

use super::system::System;
use crate::error::{Error, Result};
use crate::fokker_planck::krylov::{Krylov, Number, dot};
use crate::sparse::Lu;

/// Vectors before a restart.
const VECTORS: usize = 39;

/// Restarts before giving up.
const RESTARTS: usize = 25;

/// The work space of one solver.
pub(super) struct Gmres<T: Number> {
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
            work: vec![T::default(); n],
            residual: vec![T::default(); n],
            g: vec![0.0; cells],
            rate: vec![0.0; cells],
        }
    }

    /// (I - a L) work, matrix-free.
    fn applied(&mut self, system: &System, a: T) -> Vec<T> {
        let inverse = system.generator.inverse_weights();
        let mut product = self.work.clone();
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
        product
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
            let image = self.applied(system, a);
            for ((r, b), y) in self.residual.iter_mut().zip(&*b).zip(image) {
                *r = *b - y;
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

    /// At most [`VECTORS`] steps from the residual, until it has fallen by `factor` in the Euclidean norm;
    /// adds the correction to x.
    fn cycle(
        &mut self,
        system: &System,
        lu: &mut Lu<T>,
        a: T,
        x: &mut [T],
        factor: f64,
    ) -> Result<()> {
        let beta = dot(&self.residual, &self.residual).re().sqrt();
        let over = T::real(1.0 / beta);
        let mut space = Krylov::of(self.residual.iter().map(|r| *r * over).collect());
        let mut solution = Vec::new();
        while let Some(last) = space.last().filter(|_| space.size() < VECTORS) {
            (system.late)()?;
            self.work.copy_from_slice(last);
            lu.solve(&mut self.work)?;
            space.push(self.applied(system, a), 1, dot, |_| ());
            let (y, left) = space.least_squares(beta);
            solution = y;
            if left <= 0.5 * factor * beta {
                break;
            }
        }
        self.work = space.combined(&solution);
        lu.solve(&mut self.work)?;
        for (x, w) in x.iter_mut().zip(&self.work) {
            *x += *w;
        }
        Ok(())
    }
}
