//! The resolvent x = (I - a L)^-1 b, real or complex a: what every implicit scheme is made of. By sparse
//! LU of L itself, or by a Krylov method preconditioned with the LU of its five-point upwind neighbour.

use super::gmres::Gmres;
use super::system::{Solver, System};
use crate::error::Result;
use crate::fokker_planck::krylov::Number;
use crate::sparse::{Lu, shift};
use sprs::CsMat;
use std::sync::Arc;

/// Factorisations kept per resolvent: the step in use and the one before it.
const KEPT: usize = 2;

/// Solves (I - a L) x = b for one a after another, keeping the last factorisations.
pub(super) struct Resolvent<T: Number> {
    system: Arc<System>,
    /// Most recently used last.
    factored: Vec<(T, Lu<T>)>,
    gmres: Option<Gmres<T>>,
}

impl<T: Number> Resolvent<T> {
    pub(super) fn new(system: &Arc<System>) -> Self {
        let gmres = (system.solver == Solver::Krylov).then(|| Gmres::new(system));
        Self {
            system: Arc::clone(system),
            factored: Vec::new(),
            gmres,
        }
    }

    /// Overwrites b with x. An iterative solution leaves a residual of at most `allowed` in the L1 norm,
    /// and no error in the mass.
    pub(super) fn solve(&mut self, a: T, b: &mut [T], allowed: f64) -> Result<()> {
        (self.system.late)()?;
        if let Some(k) = self.factored.iter().position(|(shift, _)| *shift == a) {
            let used = self.factored.remove(k);
            self.factored.push(used);
        } else if self.factored.len() < KEPT {
            let lu = Lu::factor(shifted(&self.system.matrix, a))?;
            self.factored.push((a, lu));
        } else {
            let (_, mut lu) = self.factored.remove(0);
            lu.refactor(shifted(&self.system.matrix, a))?;
            self.factored.push((a, lu));
        }
        let Some((_, lu)) = self.factored.last_mut() else {
            return Ok(());
        };
        match &mut self.gmres {
            None => lu.solve(b).map(|_| ()),
            Some(gmres) => gmres.solve(&self.system, lu, a, b, allowed),
        }
    }
}

/// I - a L. The diagonal of L is never structurally empty: every unknown exchanges with another.
fn shifted<T: Number>(matrix: &CsMat<f64>, a: T) -> CsMat<T> {
    let mut shifted = matrix.map(|entry| -(a * T::real(*entry)));
    shift(&mut shifted, T::real(1.0));
    shifted
}
