//! The classical Runge-Kutta scheme of order 4 on the matrix-free generator: the textbook, as a reference for the
//! schemes of the library.

use vibroimpact::fokker_planck::{Density, Generator};

/// Its step is bound by the transport and by the diffusion across a cell.
pub(crate) struct RungeKutta4 {
    generator: Generator,
    longest: f64,
    /// The rates, the sum of the stages and the stage of a step.
    buffers: [Vec<f64>; 3],
}

impl RungeKutta4 {
    /// The scheme for a generator. The stability region holds the half disc of radius 2.6 in the left
    /// half plane.
    pub(crate) fn new(generator: &Generator) -> Self {
        let (transport, diffusion) = generator.radii();
        Self {
            generator: generator.clone(),
            longest: 2.6 / transport.hypot(diffusion),
            buffers: Default::default(),
        }
    }

    /// Longest stable step.
    pub(crate) fn longest_step(&self) -> f64 {
        self.longest
    }

    /// Advances by `duration` in equal steps of at most `step` and of at most a third of the longest
    /// stable one, where the error in time is far below that in space; returns how many.
    pub(crate) fn advance(&mut self, density: &mut Density, duration: f64, step: f64) -> u64 {
        let steps = (duration / step.min(self.longest / 3.0)).ceil().max(1.0);
        let inverse = self.generator.inverse_weights();
        let cells = density.cells().iter();
        let mut g: Vec<f64> = cells.zip(inverse).map(|(p, w)| p * w).collect();
        for _ in 0..steps as u64 {
            self.step(&mut g, duration / steps);
        }
        self.generator.weigh(&g, density.cells_mut());
        steps as u64
    }

    /// One step on g.
    fn step(&mut self, g: &mut [f64], dt: f64) {
        let inverse = self.generator.inverse_weights();
        let [rate, sum, stage] = &mut self.buffers;
        rate.resize(g.len(), 0.0);
        for start in [&mut *sum, &mut *stage] {
            start.clear();
            start.extend_from_slice(g);
        }
        for (weight, ahead) in [(1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0)] {
            self.generator.apply(stage, rate);
            let cells = sum.iter_mut().zip(&mut *stage).zip(&*g).zip(&*rate);
            for ((((sum, stage), g), rate), w) in cells.zip(inverse) {
                let k = rate * w;
                *sum += dt * weight / 6.0 * k;
                *stage = g + dt * ahead * k;
            }
        }
        g.copy_from_slice(sum);
    }
}
