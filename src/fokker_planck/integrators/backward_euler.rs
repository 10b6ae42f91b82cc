//! Backward Euler.

use super::Integrator;
use super::resolvent::Resolvent;
use super::system::{Late, Solver, System, never};
use crate::error::Result;
use crate::fokker_planck::density::Density;
use crate::fokker_planck::generator::Generator;
use std::sync::Arc;

/// Backward Euler, (I - dt L) P' = P. First order; with upwind drift positive for any step, since I - dt L
/// is then an M-matrix (Gao and Liu, Commun. Comput. Phys. 34, 132, 2023). The matrix is analysed once
/// and factored when the step changes.
pub struct BackwardEuler {
    system: Arc<System>,
    resolvent: Resolvent<f64>,
    unknowns: Vec<f64>,
}

impl BackwardEuler {
    /// The scheme for a generator.
    pub fn new(generator: &Generator) -> Self {
        Self::watched(generator, never())
    }

    /// The same, ended by `late`.
    pub(crate) fn watched(generator: &Generator, late: Late) -> Self {
        let system = System::new(generator, Solver::Direct, late);
        Self {
            resolvent: Resolvent::new(&system),
            unknowns: vec![0.0; system.cells.len()],
            system,
        }
    }

    /// One step of `dt`.
    ///
    /// # Errors
    /// [`crate::Error::Linear`] if the matrix cannot be factored or the solution is none.
    pub fn step(&mut self, density: &mut Density, dt: f64) -> Result<()> {
        self.advance(density.cells_mut(), dt, 0.0)
    }
}

impl Integrator for BackwardEuler {
    fn order(&self) -> u32 {
        1
    }

    fn advance(&mut self, cells: &mut [f64], dt: f64, allowed: f64) -> Result<()> {
        self.system.gather(cells, &mut self.unknowns);
        self.resolvent.solve(dt, &mut self.unknowns, allowed)?;
        self.system.scatter(&self.unknowns, cells);
        Ok(())
    }
}
