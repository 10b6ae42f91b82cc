//! The Radau IIA scheme of order 5 for a linear equation.

use super::Integrator;
use super::resolvent::Resolvent;
use super::system::{Late, Solver, System, never};
use crate::error::Result;
use crate::fokker_planck::generator::Generator;
use num_complex::Complex;
use std::sync::Arc;

type C = Complex<f64>;

/// Radau IIA with three stages: order 5, L-stable, so that what a long step cannot resolve is damped and
/// rough starts need no low-order steps (Hairer and Wanner, Solving Ordinary Differential Equations II,
/// IV.5). For dP/dt = L P a step multiplies with the Padé approximant
///
/// ```text
/// R(z) = (1 + 2z/5 + z^2/20)/(1 - 3z/5 + 3z^2/20 - z^3/60),   e^z - R(z) = -z^6/7200 + ...
/// ```
///
/// of z = dt L, which partial fractions make one real and one complex solve, independent of each other.
pub struct Radau {
    system: Arc<System>,
    real: Resolvent<f64>,
    complex: Resolvent<C>,
    start: Vec<f64>,
    x: Vec<f64>,
    y: Vec<C>,
}

/// The denominator of R.
const DENOMINATOR: [f64; 4] = [1.0, -3.0 / 5.0, 3.0 / 20.0, -1.0 / 60.0];

/// Its real root.
const REAL: f64 = 3.637_834_252_744_496;

/// One of its complex roots.
const COMPLEX: C = C::new(2.681_082_873_627_752, 3.050_430_199_247_410_5);

/// Error of a step over z^6.
const ERROR: f64 = 1.0 / 7200.0;

impl Radau {
    /// The scheme for a generator, its systems solved by `solver`.
    pub fn new(generator: &Generator, solver: Solver) -> Self {
        Self::watched(generator, solver, never())
    }

    /// The same, ended by `late`.
    pub(crate) fn watched(generator: &Generator, solver: Solver, late: Late) -> Self {
        let system = System::new(generator, solver, late);
        let n = system.cells.len();
        Self {
            real: Resolvent::new(&system),
            complex: Resolvent::new(&system),
            system,
            start: vec![0.0; n],
            x: vec![0.0; n],
            y: vec![C::default(); n],
        }
    }

    /// Replaces the start by N(dt L)/D(dt L) of it, N a polynomial of degree 3 at most:
    /// N/D = N_3/D_3 + sum_k N(z_k)/(1 - z/z_k)/prod_{i != k} (1 - z_k/z_i).
    fn fraction(&mut self, numerator: [f64; 4], dt: f64, allowed: f64) -> Result<()> {
        self.x.copy_from_slice(&self.start);
        for (y, p) in self.y.iter_mut().zip(&self.start) {
            *y = C::new(*p, 0.0);
        }
        let Self {
            real,
            complex,
            x,
            y,
            ..
        } = self;
        let (first, second) = rayon::join(
            || real.solve(dt / REAL, x, allowed),
            || complex.solve(dt / COMPLEX, y, allowed),
        );
        first.and(second)?;
        let at = |z: C| {
            numerator
                .iter()
                .rev()
                .fold(C::default(), |sum, c| sum * z + c)
        };
        let (one, real) = (C::new(1.0, 0.0), C::new(REAL, 0.0));
        let constant = numerator[3] / DENOMINATOR[3];
        let of_real = (at(real) / ((one - real / COMPLEX) * (one - real / COMPLEX.conj()))).re;
        let of_complex =
            2.0 * at(COMPLEX) / ((one - COMPLEX / real) * (one - COMPLEX / COMPLEX.conj()));
        for ((p, x), y) in self.start.iter_mut().zip(&self.x).zip(&self.y) {
            *p = constant * *p + of_real * x + (of_complex * y).re;
        }
        Ok(())
    }
}

impl Integrator for Radau {
    fn order(&self) -> u32 {
        5
    }

    fn algebraic_part(&self) -> f64 {
        0.1
    }

    fn advance(&mut self, cells: &mut [f64], dt: f64, allowed: f64) -> Result<()> {
        self.system.gather(cells, &mut self.start);
        // The coefficients of the two solutions weigh what they leave up to five times.
        let allowed = 0.2 * self.algebraic_part() * allowed;
        self.fraction([1.0, 2.0 / 5.0, 1.0 / 20.0, 0.0], dt, allowed)?;
        self.system.scatter(&self.start, cells);
        Ok(())
    }

    /// z^6/(7200 D(z)^2) P: the leading term of the error, filtered where a step does not resolve it,
    /// with the factorisations of the step itself.
    fn error(&mut self, before: &[f64], _after: &[f64], dt: f64, error: &mut [f64]) -> Result<()> {
        self.system.gather(before, &mut self.start);
        for _ in 0..2 {
            self.fraction([0.0, 0.0, 0.0, 1.0], dt, 1e-9)?;
        }
        self.start.iter_mut().for_each(|x| *x *= ERROR);
        self.system.scatter(&self.start, error);
        Ok(())
    }
}
