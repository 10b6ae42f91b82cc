//! What every scheme in time can do.

use crate::error::Result;

/// A scheme in time. The state is the probability per cell, row-major, 0 where there is no unknown.
pub trait Integrator: Send {
    /// Order p of the global error, dt^p.
    fn order(&self) -> u32;

    /// Longest stable step; infinite where the scheme has none.
    fn longest_step(&self) -> f64 {
        f64::INFINITY
    }

    /// Whether it keeps to the `allowed` error of [`Integrator::advance`] with any step.
    fn chooses_accuracy(&self) -> bool {
        false
    }

    /// Part of the `allowed` error of [`Integrator::advance`] that an iterative solver may add to a step.
    fn algebraic_part(&self) -> f64 {
        0.0
    }

    /// Replaces the state by that a time `dt` later. A scheme that can choose its accuracy adds an error
    /// of at most `allowed`, in the L1 norm; the others leave it to the choice of `dt`.
    ///
    /// # Errors
    /// [`crate::Error::Linear`] where a linear system cannot be solved.
    fn advance(&mut self, cells: &mut [f64], dt: f64, allowed: f64) -> Result<()>;

    /// Overwrites `error` with the error of the step of `dt` that led from `before` to `after`; unless a
    /// scheme knows better, from two steps of half the length.
    ///
    /// # Errors
    /// As [`Integrator::advance`].
    fn error(&mut self, before: &[f64], after: &[f64], dt: f64, error: &mut [f64]) -> Result<()> {
        error.copy_from_slice(before);
        for _ in 0..2 {
            self.advance(error, 0.5 * dt, 0.0)?;
        }
        let gained = f64::from(self.order()).exp2();
        for (error, after) in error.iter_mut().zip(after) {
            *error = (*error - after) * gained / (gained - 1.0);
        }
        Ok(())
    }
}
