//! Additive Runge-Kutta: transport explicit, friction and diffusion implicit.

use super::Integrator;
use super::banded::{Banded, LANES, Lanes};
use crate::error::Result;
use crate::fokker_planck::generator::Generator;
use rayon::prelude::*;

/// ARK4(3)6L\[2\]SA of Kennedy and Carpenter, Appl. Numer. Math. 44, 139, 2003: order 4, six stages, its
/// implicit part L-stable. Transport across cells is explicit, and friction and diffusion along v are
/// implicit, one banded solve per q-column and stage: the step is bound by the transport alone. On the
/// imaginary axis the explicit part is stable up to 4.0, with any diffusion beside it (computed).
pub struct Additive {
    generator: Generator,
    longest: f64,
    /// Factors for the steps last used, the latest last.
    factors: Vec<(f64, Banded)>,
    g: Vec<f64>,
    stage: Vec<f64>,
    rate: Vec<f64>,
    transport: [Vec<f64>; STAGES],
    diffusion: [Vec<f64>; STAGES],
    /// A row of lanes per v cell for every share of columns.
    work: Vec<Lanes>,
}

const STAGES: usize = 6;

/// Factorisations kept: for a step, its half, and the same before.
const KEPT: usize = 4;

/// The diagonal of the implicit part.
const GAMMA: f64 = 1.0 / 4.0;

#[rustfmt::skip]
const EXPLICIT: [[f64; STAGES]; STAGES] = [
    [0.0; STAGES],
    [1.0 / 2.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [13_861.0 / 62_500.0, 6_889.0 / 62_500.0, 0.0, 0.0, 0.0, 0.0],
    [-116_923_316_275.0 / 2_393_684_061_468.0, -2_731_218_467_317.0 / 15_368_042_101_831.0,
     9_408_046_702_089.0 / 11_113_171_139_209.0, 0.0, 0.0, 0.0],
    [-451_086_348_788.0 / 2_902_428_689_909.0, -2_682_348_792_572.0 / 7_519_795_681_897.0,
     12_662_868_775_082.0 / 11_960_479_115_383.0, 3_355_817_975_965.0 / 11_060_851_509_271.0, 0.0, 0.0],
    [647_845_179_188.0 / 3_216_320_057_751.0, 73_281_519_250.0 / 8_382_639_484_533.0,
     552_539_513_391.0 / 3_454_668_386_233.0, 3_354_512_671_639.0 / 8_306_763_924_573.0,
     4_040.0 / 17_871.0, 0.0],
];

#[rustfmt::skip]
const IMPLICIT: [[f64; STAGES]; STAGES] = [
    [0.0; STAGES],
    [1.0 / 4.0, GAMMA, 0.0, 0.0, 0.0, 0.0],
    [8_611.0 / 62_500.0, -1_743.0 / 31_250.0, GAMMA, 0.0, 0.0, 0.0],
    [5_012_029.0 / 34_652_500.0, -654_441.0 / 2_922_500.0, 174_375.0 / 388_108.0, GAMMA, 0.0, 0.0],
    [15_267_082_809.0 / 155_376_265_600.0, -71_443_401.0 / 120_774_400.0,
     730_878_875.0 / 902_184_768.0, 2_285_395.0 / 8_070_912.0, GAMMA, 0.0],
    WEIGHTS,
];

/// Of both parts; the last row of the implicit one.
#[rustfmt::skip]
const WEIGHTS: [f64; STAGES] = [
    82_889.0 / 524_892.0, 0.0, 15_625.0 / 83_664.0, 69_875.0 / 102_672.0, -2_260.0 / 8_211.0, GAMMA,
];

impl Additive {
    /// The scheme for a generator.
    pub fn new(generator: &Generator) -> Self {
        let (transport, _) = generator.radii();
        let n = generator.mesh().len();
        let empty = || vec![0.0; n];
        Self {
            longest: 3.8 / transport,
            factors: Vec::new(),
            g: empty(),
            stage: empty(),
            rate: empty(),
            transport: std::array::from_fn(|_| empty()),
            diffusion: std::array::from_fn(|_| empty()),
            work: vec![
                [0.0; LANES];
                generator.mesh().v.len() * generator.mesh().q.len().div_ceil(LANES)
            ],
            generator: generator.clone(),
        }
    }

    /// Makes the factors for `dt` the latest.
    fn prepare(&mut self, dt: f64) -> Result<()> {
        let factors = match self.factors.iter().position(|(step, _)| *step == dt) {
            Some(k) => self.factors.remove(k),
            None => (dt, Banded::new(&self.generator, GAMMA * dt)?),
        };
        if self.factors.len() == KEPT {
            self.factors.remove(0);
        }
        self.factors.push(factors);
        Ok(())
    }

    /// One step on g: each stage is the sum of those before with the implicit solve, column by column, and
    /// then the transport between them.
    fn step(&mut self, dt: f64) {
        let Self {
            generator,
            factors,
            g,
            stage,
            rate,
            transport,
            diffusion,
            work,
            ..
        } = self;
        let Some((_, banded)) = factors.last() else {
            return;
        };
        let inverse = generator.inverse_weights();
        let [nq, nv] = generator.mesh().cells();
        // Whole blocks of the solver.
        let size = generator.share().next_multiple_of(LANES).min(nq) * nv;
        generator.apply_diffusion(g, rate);
        let cells = diffusion[0].par_chunks_mut(size).zip(rate.par_chunks(size));
        let cells = cells.zip(inverse.par_chunks(size));
        cells.for_each(|((diffusion, rate), inverse)| times(diffusion, rate, inverse));
        stage.copy_from_slice(g);
        for i in 0..STAGES {
            if i > 0 {
                let (before, now) = diffusion.split_at_mut(i);
                let (before, transport) = (&*before, &*transport);
                stage
                    .par_chunks_mut(size)
                    .zip(now[0].par_chunks_mut(size))
                    .zip(work.par_chunks_mut(nv))
                    .enumerate()
                    .for_each(|(k, ((stage, now), work))| {
                        let cells = k * size..k * size + stage.len();
                        stage.copy_from_slice(&g[cells.clone()]);
                        for j in 0..i {
                            add(
                                stage,
                                dt * EXPLICIT[i][j],
                                &transport[j][cells.clone()],
                                dt * IMPLICIT[i][j],
                                &before[j][cells.clone()],
                            );
                        }
                        // U = rhs + GAMMA dt B U gives B U without applying B.
                        now.copy_from_slice(stage);
                        banded.solve(&(cells.start / nv..cells.end / nv), stage, work);
                        let per_step = 1.0 / (GAMMA * dt);
                        for (now, stage) in now.iter_mut().zip(&*stage) {
                            *now = (stage - *now) * per_step;
                        }
                    });
            }
            let stage = &*stage;
            transport[i]
                .par_chunks_mut(size)
                .zip(rate.par_chunks_mut(size))
                .zip(inverse.par_chunks(size))
                .enumerate()
                .for_each(|(k, ((transport, rate), inverse))| {
                    let cells = k * size..k * size + rate.len();
                    generator.transport_to(cells.start / nv..cells.end / nv, stage, rate);
                    times(transport, rate, inverse);
                });
        }
        g.par_chunks_mut(size).enumerate().for_each(|(k, g)| {
            let cells = k * size..k * size + g.len();
            for (j, weight) in WEIGHTS.iter().enumerate() {
                let (transport, diffusion) =
                    (&transport[j][cells.clone()], &diffusion[j][cells.clone()]);
                add(g, dt * weight, transport, dt * weight, diffusion);
            }
        });
    }
}

/// `x = a b`.
fn times(x: &mut [f64], a: &[f64], b: &[f64]) {
    for ((x, a), b) in x.iter_mut().zip(a).zip(b) {
        *x = a * b;
    }
}

/// `x += a y + b z`.
fn add(x: &mut [f64], a: f64, y: &[f64], b: f64, z: &[f64]) {
    for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
        *x += a * y + b * z;
    }
}

impl Integrator for Additive {
    fn order(&self) -> u32 {
        4
    }

    fn longest_step(&self) -> f64 {
        self.longest
    }

    fn advance(&mut self, cells: &mut [f64], dt: f64, _allowed: f64) -> Result<()> {
        self.prepare(dt)?;
        self.generator.ratio(cells, &mut self.g);
        // Inside the pool for good: its queues are then the only ones used.
        rayon::scope(|_| self.step(dt));
        self.generator.weigh(&self.g, cells);
        Ok(())
    }
}
