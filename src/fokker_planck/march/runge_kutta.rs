//! The classical Runge-Kutta scheme.

use super::Integrator;
use crate::error::Result;
use crate::fokker_planck::density::Density;
use crate::fokker_planck::generator::Generator;

/// The classical Runge-Kutta scheme of order 4 on the matrix-free generator: the textbook, to check the
/// others against. Its step is bound by the transport and by the diffusion across a cell.
pub struct RungeKutta4 {
    generator: Generator,
    longest: f64,
    g: Vec<f64>,
    stage: Vec<f64>,
    rate: Vec<f64>,
    sum: Vec<f64>,
}

impl RungeKutta4 {
    /// The scheme for a generator. The stability region holds the half disc of radius 2.6 in the left
    /// half plane.
    pub fn new(generator: &Generator) -> Self {
        let (transport, diffusion) = generator.radii();
        let n = generator.mesh().len();
        let empty = || vec![0.0; n];
        Self {
            generator: generator.clone(),
            longest: 2.6 / transport.hypot(diffusion),
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

    /// Advances by `duration` in equal steps of at most `step` and of at most a third of the longest
    /// stable one, where the error in time is far below that in space; returns how many.
    pub fn advance(&mut self, density: &mut Density, duration: f64, step: f64) -> u64 {
        let steps = (duration / step.min(self.longest / 3.0)).ceil().max(1.0);
        self.load(density.cells());
        for _ in 0..steps as u64 {
            self.step(duration / steps);
        }
        self.store(density.cells_mut());
        steps as u64
    }

    fn load(&mut self, cells: &[f64]) {
        let inverse = self.generator.inverse_weights();
        for ((g, p), inverse) in self.g.iter_mut().zip(cells).zip(inverse) {
            *g = p * inverse;
        }
    }

    fn store(&self, cells: &mut [f64]) {
        self.generator.weigh(&self.g, cells);
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

impl Integrator for RungeKutta4 {
    fn order(&self) -> u32 {
        4
    }

    fn longest_step(&self) -> f64 {
        self.longest
    }

    fn march(&mut self, cells: &mut [f64], dt: f64, _allowed: f64) -> Result<()> {
        self.load(cells);
        self.step(dt);
        self.store(cells);
        Ok(())
    }
}
