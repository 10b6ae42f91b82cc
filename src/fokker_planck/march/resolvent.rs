//! The resolvent x = (I - a L)^-1 b, real or complex a: what every implicit scheme is made of. By sparse
//! LU of L itself, or by a Krylov method preconditioned with the LU of its five-point upwind neighbour.

use super::krylov::{Gmres, Number};
use crate::error::Result;
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::generator::Generator;
use crate::sparse::{Lu, shift};
use sprs::CsMat;
use std::sync::Arc;

/// How the linear systems of an implicit scheme are solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Solver {
    /// Sparse LU of the matrix itself.
    Direct,
    /// GMRES on the matrix-free generator, preconditioned by the LU of the five-point upwind operator.
    Krylov,
}

/// Factorisations kept per resolvent: the step in use and the one before it.
const KEPT: usize = 2;

/// The generator as the resolvents need it, shared between them.
pub(super) struct System {
    pub(super) generator: Generator,
    /// Cell of each unknown.
    pub(super) cells: Vec<usize>,
    /// The stationary law on the unknowns, with sum 1; none where probability leaves the box.
    pub(super) stationary: Option<Vec<f64>>,
    /// A bound on |L|.
    pub(super) rate: f64,
    /// What is factored: L, or its five-point neighbour.
    matrix: CsMat<f64>,
    solver: Solver,
}

impl System {
    pub(super) fn new(generator: &Generator, solver: Solver) -> Arc<Self> {
        let nv = generator.mesh().v.len();
        let cells: Vec<usize> = (0..generator.mesh().q.len())
            .flat_map(|i| generator.active(i).map(move |j| i * nv + j))
            .collect();
        let weights = generator.weights();
        let stationary = generator.is_closed().then(|| {
            let w = |cell: &usize| weights.at(cell / nv, cell % nv);
            let sum: f64 = cells.iter().map(w).sum();
            cells.iter().map(|cell| w(cell) / sum).collect()
        });
        let solver = if generator.drift() == Drift::Upwind {
            Solver::Direct
        } else {
            solver
        };
        let matrix = match solver {
            Solver::Direct => generator.matrix(),
            Solver::Krylov => generator.five_point(),
        };
        Arc::new(Self {
            generator: generator.clone(),
            cells,
            stationary,
            rate: {
                let (transport, diffusion) = generator.rates();
                transport + diffusion
            },
            matrix,
            solver,
        })
    }

    /// The unknowns out of the cells.
    pub(super) fn gather(&self, cells: &[f64], unknowns: &mut [f64]) {
        for (x, cell) in unknowns.iter_mut().zip(&self.cells) {
            *x = cells[*cell];
        }
    }

    /// The unknowns back into the cells.
    pub(super) fn scatter(&self, unknowns: &[f64], cells: &mut [f64]) {
        for (x, cell) in unknowns.iter().zip(&self.cells) {
            cells[*cell] = *x;
        }
    }
}

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
