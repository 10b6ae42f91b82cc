//! Explicit steps of any order, in Chebyshev form.

use super::Integrator;
use crate::error::Result;
use crate::fokker_planck::generator::Generator;
use crate::matrix::vectorise;
use rayon::prelude::*;

/// An explicit Runge-Kutta scheme of many stages for a linear equation whose spectrum lies along the
/// imaginary axis: the polynomial of L that a step multiplies with is the Chebyshev series of e^{dt z}
/// (Tal-Ezer and Kosloff, J. Chem. Phys. 81, 3967, 1984). With F the largest frequency of the transport,
/// s half the largest rate of diffusion, and A = (L + s)/F,
///
/// ```text
/// e^{dt L} = e^{-s dt} [J_0(F dt) + 2 sum_k J_k(F dt) phi_k(A)],   phi_{k+1} = 2 A phi_k + phi_{k-1}
/// ```
///
/// with J_k the Bessel functions: about F dt + s dt stages for a long step, after which the terms fall
/// faster than any power. The terms themselves say when to stop. The constant term is set so that the polynomial is 1 at L = 0: mass and g = 1 are kept.
pub struct Chebyshev {
    generator: Generator,
    /// F.
    frequency: f64,
    /// s.
    shift: f64,
    /// The step that `coefficients` belong to.
    dt: f64,
    coefficients: Vec<f64>,
    /// rho: what each phi may grow by.
    growth: f64,
    /// Sum of the |coefficients| from each on, times the growth between.
    tails: Vec<f64>,
    start: Vec<f64>,
    now: Vec<f64>,
    last: Vec<f64>,
    rate: Vec<f64>,
    sum: Vec<f64>,
}

/// F dt + s dt of the longest step: a fifth of the stages are then beyond it at an error of 1e-8.
const REACH: f64 = 60.0;

/// Error where none is asked for, relative to a mass of 1.
const SMALLEST: f64 = 1e-14;

impl Chebyshev {
    /// The scheme for a generator.
    pub fn new(generator: &Generator) -> Self {
        let (transport, diffusion) = generator.radii();
        let n = generator.mesh().len();
        let empty = || vec![0.0; n];
        Self {
            frequency: transport.max(0.1 * diffusion),
            shift: 0.5 * diffusion,
            // No step yet.
            dt: f64::NAN,
            coefficients: Vec::new(),
            growth: 1.0,
            tails: Vec::new(),
            start: empty(),
            now: empty(),
            last: empty(),
            rate: empty(),
            sum: empty(),
            generator: generator.clone(),
        }
    }

    /// The coefficients of a step, until they are below rounding.
    fn prepare(&mut self, dt: f64) {
        if dt == self.dt {
            return;
        }
        self.dt = dt;
        let (reach, damping) = (self.frequency * dt, (-self.shift * dt).exp());
        // |phi_k| grows as rho^k at the slow end of the spectrum, and no faster elsewhere in a tall domain.
        let slope = self.shift / self.frequency;
        self.growth = slope + slope.hypot(1.0);
        self.coefficients.clear();
        let mut growth = 1.0;
        for k in 0..10_000 {
            let twice = if k == 0 { 1.0 } else { 2.0 };
            let c = twice * damping * libm::jn(k, reach);
            self.coefficients.push(c);
            // The terms peak before k = F dt + s dt, and fall faster than any power from there.
            if f64::from(k) > reach + self.shift * dt && c.abs() * growth < 1e-17 {
                break;
            }
            growth *= self.growth;
        }
        self.tails.clear();
        self.tails.resize(self.coefficients.len() + 1, 0.0);
        for k in (0..self.coefficients.len()).rev() {
            self.tails[k] = self.growth * self.tails[k + 1] + self.coefficients[k].abs();
        }
    }

    /// L1 norm of w g.
    fn norm(generator: &Generator, g: &[f64]) -> f64 {
        let inverse = generator.inverse_weights().iter();
        let cells = g.iter().zip(inverse).filter(|(_, inverse)| **inverse > 0.0);
        cells.map(|(g, inverse)| (g / inverse).abs()).sum()
    }

    /// One step from `start` to `sum`.
    fn step(&mut self, allowed: f64) {
        let Self {
            generator,
            coefficients,
            tails,
            start,
            now,
            last,
            rate,
            sum,
            ..
        } = self;
        let inverse = generator.inverse_weights();
        let nv = generator.mesh().v.len();
        let chunk = generator.share() * nv;
        let (shift, scale) = (self.shift, 1.0 / self.frequency);
        last.copy_from_slice(start);
        for (sum, g) in sum.iter_mut().zip(&*start) {
            *sum = coefficients[0] * g;
        }
        // The polynomial at L = 0 goes along.
        let at_zero = shift * scale;
        let (mut one, mut one_before) = (1.0, 0.0);
        let mut total = coefficients[0];
        let mut size = 1.0;
        for k in 1..coefficients.len() {
            let source: &[f64] = if k == 1 { start } else { now };
            let (factor, c) = (if k == 1 { scale } else { 2.0 * scale }, coefficients[k]);
            // phi_k from phi_{k-1} in `source` and phi_{k-2} in `last`, which it replaces.
            let before = if k == 1 { 0.0 } else { 1.0 };
            last.par_chunks_mut(chunk)
                .zip(sum.par_chunks_mut(chunk))
                .zip(rate.par_chunks_mut(chunk))
                .enumerate()
                .for_each(|(k, ((last, sum), rate))| {
                    let cells = k * chunk..k * chunk + last.len();
                    generator.apply_to(cells.start / nv..cells.end / nv, source, rate);
                    let (source, inverse) = (&source[cells.clone()], &inverse[cells]);
                    vectorise!({
                        let states = last.iter_mut().zip(sum.iter_mut()).zip(source);
                        for (((last, sum), g), (rate, w)) in states.zip(rate.iter().zip(inverse)) {
                            *last = factor.mul_add(rate.mul_add(*w, shift * g), before * *last);
                            *sum = c.mul_add(*last, *sum);
                        }
                    });
                });
            if k == 1 {
                now.copy_from_slice(start);
            }
            std::mem::swap(now, last);
            let next = if k == 1 {
                at_zero
            } else {
                2.0 * at_zero * one + one_before
            };
            (one_before, one) = (one, next);
            total += c * one;
            size *= self.growth;
            let rest = self.growth * tails[k + 1];
            if rest * size <= 10.0 * allowed {
                size = Self::norm(generator, now);
                if rest * size <= allowed {
                    break;
                }
            }
        }
        let rest = 1.0 - total;
        for (sum, g) in sum.iter_mut().zip(&*start) {
            *sum += rest * g;
        }
    }
}

impl Integrator for Chebyshev {
    /// The error is chosen, not the step.
    fn order(&self) -> u32 {
        8
    }

    fn chooses_accuracy(&self) -> bool {
        true
    }

    fn longest_step(&self) -> f64 {
        REACH / (self.frequency + self.shift)
    }

    fn advance(&mut self, cells: &mut [f64], dt: f64, allowed: f64) -> Result<()> {
        self.prepare(dt);
        self.generator.ratio(cells, &mut self.start);
        // Inside the pool for good: its queues are then the only ones used.
        rayon::scope(|_| self.step(allowed.max(SMALLEST)));
        self.generator.weigh(&self.sum, cells);
        Ok(())
    }
}
