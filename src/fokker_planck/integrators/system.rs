//! The linear system of an implicit step: the generator, its unknowns, and what is factored of it.

use crate::error::Result;
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::generator::Generator;
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

/// Asked before every piece of a long solve; its error ends the solve.
pub(crate) type Late = Arc<dyn Fn() -> Result<()> + Send + Sync>;

/// Nobody waits.
pub(crate) fn never() -> Late {
    Arc::new(|| Ok(()))
}

/// L of a law over its rate below which it is 0 but for rounding.
const NULL: f64 = 1e-11;

/// The generator as the resolvents need it, shared between them.
pub(super) struct System {
    pub(super) generator: Generator,
    /// Cell of each unknown.
    pub(super) cells: Vec<usize>,
    /// The weights of the unknowns, with sum 1; none where probability leaves the domain.
    pub(super) weights: Option<Vec<f64>>,
    /// Whether they are the stationary law, L of them 0: friction that acts in contact alone has another.
    pub(super) are_stationary: bool,
    /// A bound on |L|.
    pub(super) rate: f64,
    /// What is factored: L, or its five-point neighbour.
    pub(super) matrix: CsMat<f64>,
    pub(super) solver: Solver,
    pub(super) late: Late,
}

impl System {
    pub(super) fn new(generator: &Generator, solver: Solver, late: Late) -> Arc<Self> {
        let nv = generator.mesh().v.len();
        let cells: Vec<usize> = (0..generator.mesh().q.len())
            .flat_map(|i| generator.active(i).map(move |j| i * nv + j))
            .collect();
        let weights = generator.weights();
        let w = |cell: &usize| weights.at(cell / nv, cell % nv);
        let sum: f64 = cells.iter().map(w).sum();
        let (transport, diffusion) = generator.rates();
        let rate = transport + diffusion;
        let mut change = vec![0.0; generator.mesh().len()];
        generator.apply(&vec![1.0; change.len()], &mut change);
        let change: f64 = cells.iter().map(|cell| change[*cell].abs()).sum();
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
            weights: generator
                .is_closed()
                .then(|| cells.iter().map(|cell| w(cell) / sum).collect()),
            cells,
            are_stationary: change <= NULL * rate * sum,
            rate,
            matrix,
            solver,
            late,
        })
    }

    pub(super) fn gather(&self, cells: &[f64], unknowns: &mut [f64]) {
        for (x, cell) in unknowns.iter_mut().zip(&self.cells) {
            *x = cells[*cell];
        }
    }

    pub(super) fn scatter(&self, unknowns: &[f64], cells: &mut [f64]) {
        for (x, cell) in unknowns.iter().zip(&self.cells) {
            cells[*cell] = *x;
        }
    }
}
