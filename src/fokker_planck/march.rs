//! Steps in time: implicit with one sparse LU, explicit without a matrix.

use super::density::Density;
use super::generator::Generator;
use crate::error::Result;
use crate::sparse::Lu;
use sprs::CsMat;

/// Backward Euler, (I - dt L) P' = P. First order; with upwind drift positive for any step. The matrix
/// is analysed once and factored when the step changes.
pub struct BackwardEuler {
    matrix: CsMat<f64>,
    /// Cell of each unknown.
    cells: Vec<usize>,
    factored: Option<(f64, Lu<f64>)>,
    unknowns: Vec<f64>,
}

impl BackwardEuler {
    /// The scheme for a generator.
    pub fn new(generator: &Generator) -> Self {
        let number = generator.numbering();
        let mut cells = vec![0; generator.unknowns()];
        for (cell, unknown) in number.iter().enumerate().filter(|(_, u)| **u != usize::MAX) {
            cells[*unknown] = cell;
        }
        let unknowns = vec![0.0; cells.len()];
        Self {
            matrix: generator.matrix(),
            cells,
            factored: None,
            unknowns,
        }
    }

    /// The generator as a matrix on the unknowns.
    pub fn matrix(&self) -> &CsMat<f64> {
        &self.matrix
    }

    /// One step of `dt`; returns the backward error of the solve.
    ///
    /// # Errors
    /// [`crate::Error::Linear`] if the matrix cannot be factored or the solution is none.
    pub fn step(&mut self, density: &mut Density, dt: f64) -> Result<f64> {
        let lu = match &mut self.factored {
            Some((step, lu)) => {
                if *step != dt {
                    lu.refactor(shifted(&self.matrix, dt))?;
                    *step = dt;
                }
                lu
            }
            empty => &mut empty.insert((dt, Lu::factor(shifted(&self.matrix, dt))?)).1,
        };
        for (x, cell) in self.unknowns.iter_mut().zip(&self.cells) {
            *x = density.cells()[*cell];
        }
        let error = lu.solve(&mut self.unknowns)?;
        for (x, cell) in self.unknowns.iter().zip(&self.cells) {
            density.cells_mut()[*cell] = *x;
        }
        Ok(error)
    }
}

/// I - dt L. The diagonal of L is never structurally empty: every unknown exchanges with another.
fn shifted(matrix: &CsMat<f64>, dt: f64) -> CsMat<f64> {
    let mut shifted = matrix.map(|a| -dt * a);
    for (column, mut entries) in shifted.outer_iterator_mut().enumerate() {
        if let Some(diagonal) = entries.get_mut(column) {
            *diagonal += 1.0;
        }
    }
    shifted
}

/// The classical Runge-Kutta scheme of order 4 on the matrix-free generator. Its step is bound by the
/// transport and by the diffusion across a cell.
pub struct RungeKutta4 {
    generator: Generator,
    longest: f64,
    g: Vec<f64>,
    stage: Vec<f64>,
    rate: Vec<f64>,
    sum: Vec<f64>,
}

impl RungeKutta4 {
    /// The scheme for a generator; its longest stable step from row sums of the symmetrised generator.
    /// The stability region holds the half disc of radius 2.6 in the left half plane.
    pub fn new(generator: &Generator) -> Self {
        let (transport, diffusion) = generator.rates();
        let n = generator.mesh().len();
        let empty = || vec![0.0; n];
        Self {
            generator: generator.clone(),
            longest: 2.6 / (transport + diffusion),
            g: empty(),
            stage: empty(),
            rate: empty(),
            sum: empty(),
        }
    }

    /// Longest stable step.
    pub fn longest_step(&self) -> f64 {
        self.longest
    }

    /// Advances by `duration` in equal steps of at most `step` and of at most the longest stable one;
    /// returns how many.
    pub fn advance(&mut self, density: &mut Density, duration: f64, step: f64) -> u64 {
        let steps = (duration / step.min(self.longest)).ceil().max(1.0);
        let dt = duration / steps;
        let inverse = self.generator.inverse_weights();
        for ((g, p), inverse) in self.g.iter_mut().zip(density.cells()).zip(inverse) {
            *g = p * inverse;
        }
        for _ in 0..steps as u64 {
            self.step(dt);
        }
        let [nq, nv] = self.generator.mesh().cells();
        for i in 0..nq {
            for j in self.generator.active(i) {
                let cell = i * nv + j;
                density.cells_mut()[cell] = self.g[cell] * self.generator.weights().at(i, j);
            }
        }
        steps as u64
    }

    /// One step on g.
    fn step(&mut self, dt: f64) {
        let Self {
            generator,
            g,
            stage,
            rate,
            sum,
            ..
        } = self;
        let inverse = generator.inverse_weights();
        generator.apply(g, rate);
        // k1: stage at dt/2, weight 1/6. k2: dt/2, 1/3. k3: dt, 1/3. k4: 1/6.
        pulp::Arch::new().dispatch(|| {
            for (((s, x), (g, r)), w) in sum
                .iter_mut()
                .zip(&mut *stage)
                .zip(g.iter().zip(&*rate))
                .zip(inverse)
            {
                let k = r * w;
                *s = g + dt / 6.0 * k;
                *x = g + dt / 2.0 * k;
            }
        });
        for (ahead, weight) in [(dt / 2.0, dt / 3.0), (dt, dt / 3.0)] {
            generator.apply(stage, rate);
            pulp::Arch::new().dispatch(|| {
                for (((s, x), (g, r)), w) in sum
                    .iter_mut()
                    .zip(&mut *stage)
                    .zip(g.iter().zip(&*rate))
                    .zip(inverse)
                {
                    let k = r * w;
                    *s += weight * k;
                    *x = g + ahead * k;
                }
            });
        }
        generator.apply(stage, rate);
        pulp::Arch::new().dispatch(|| {
            for ((g, s), (r, w)) in g.iter_mut().zip(&*sum).zip(rate.iter().zip(inverse)) {
                *g = s + dt / 6.0 * (r * w);
            }
        });
    }
}
