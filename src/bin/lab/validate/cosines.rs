//! The paper's own procedure, section 5.2: central differences driven by one sum of cosines (31)-(33),
//! drawn once and kept for the whole record.
//!
//! [`vibroimpact::monte_carlo`] draws new cosines for every path, so that its means are those of the model.
//! Here a record is one draw, as in the paper, and the spread between draws is what is asked for.

use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;
use std::f64::consts::TAU;
use vibroimpact::estimate::{Estimate, Origin};
use vibroimpact::oscillator::Oscillator;

/// Sums run in as many lanes, so that they are the same on every machine and fast.
const LANES: usize = 8;

/// How a record is made.
#[derive(Debug, Clone, PartialEq)]
pub struct Procedure {
    /// Number M of cosines; 0 for white noise in their place.
    pub count: usize,
    /// Highest circular frequency.
    pub band: f64,
    /// Steps in a period 2 pi.
    pub steps: u32,
    /// Length of the record in periods.
    pub periods: u32,
    /// Periods left out before it.
    pub before: u32,
}

impl Default for Procedure {
    /// A thousand cosines up to four times the linearised frequency, 25 steps a period: the step adds
    /// (2 pi/25)^2/8 = 0.8 % to a deviation. 2000 periods are longer than the beat of neighbouring
    /// cosines, so that a longer record of the same draw says the same.
    fn default() -> Self {
        Self {
            count: 1000,
            band: 4.0,
            steps: 25,
            periods: 2000,
            before: 150,
        }
    }
}

/// The means of N, N^2 and N^3 over each of several draws.
#[derive(Debug, Clone, PartialEq)]
pub struct Draws {
    pub raw: Vec<[f64; 3]>,
}

/// Mean, deviation and skewness from the means of N, N^2 and N^3.
pub fn statistics([m1, m2, m3]: [f64; 3]) -> [f64; 3] {
    let variance = m2 - m1 * m1;
    let third = m3 - 3.0 * m1 * m2 + 2.0 * m1.powi(3);
    [m1, variance.sqrt(), third / variance.powf(1.5)]
}

impl Draws {
    /// The k-th number (mean, deviation, skewness) of each draw: its mean over the draws, with the spread
    /// between draws as its error.
    pub fn spread(&self, k: usize) -> Estimate {
        let n = self.raw.len() as f64;
        let each: Vec<f64> = self.raw.iter().map(|raw| statistics(*raw)[k]).collect();
        let mean = each.iter().sum::<f64>() / n;
        let square = each.iter().map(|it| (it - mean).powi(2));
        let deviation = (square.sum::<f64>() / (n - 1.0)).sqrt();
        Estimate::new(mean, deviation, Origin::Sampling)
    }

    /// The k-th number of all draws together, with its standard error by the jackknife (Quenouille, Biometrika
    /// 43, 1956, 353).
    pub fn pooled(&self, k: usize) -> Estimate {
        let n = self.raw.len() as f64;
        let total = [0, 1, 2].map(|m| self.raw.iter().map(|it| it[m]).sum::<f64>());
        let all = statistics(total.map(|sum| sum / n))[k];
        let without = |raw: &[f64; 3]| {
            let rest = [0, 1, 2].map(|m| (total[m] - raw[m]) / (n - 1.0));
            statistics(rest)[k]
        };
        let left: Vec<f64> = self.raw.iter().map(without).collect();
        let mean = left.iter().sum::<f64>() / n;
        let square = left.iter().map(|it| (it - mean).powi(2)).sum::<f64>();
        Estimate::new(all, ((n - 1.0) / n * square).sqrt(), Origin::Sampling)
    }
}

/// f of one draw, step by step.
enum Excitation {
    Cosines(Cosines),
    /// Independent normals of this deviation, so that their density is h up to the highest frequency.
    White(Xoshiro256PlusPlus, f64),
}

impl Excitation {
    fn next(&mut self) -> f64 {
        match self {
            Self::Cosines(it) => it.next(),
            Self::White(rng, deviation) => {
                let normal: f64 = StandardNormal.sample(rng);
                *deviation * normal
            }
        }
    }
}

struct Cosines {
    cos: Vec<[f64; LANES]>,
    sin: Vec<[f64; LANES]>,
    turn: Vec<[[f64; LANES]; 2]>,
    amplitude: f64,
}

impl Cosines {
    fn new(procedure: &Procedure, level: f64, rng: &mut impl Rng) -> Self {
        let groups = procedure.count.div_ceil(LANES);
        let step = TAU / f64::from(procedure.steps);
        let (mut cos, mut sin) = (vec![[0.0; LANES]; groups], vec![[0.0; LANES]; groups]);
        let mut turn = vec![[[0.0; LANES]; 2]; groups];
        for k in 0..procedure.count {
            let (group, lane) = (k / LANES, k % LANES);
            let frequency = procedure.band * (1.0 - rng.random::<f64>());
            let phase = TAU * rng.random::<f64>();
            (sin[group][lane], cos[group][lane]) = phase.sin_cos();
            let (s, c) = (frequency * step).sin_cos();
            (turn[group][0][lane], turn[group][1][lane]) = (c, s);
        }
        // Two-sided density h up to the band, as in `monte_carlo`.
        let amplitude = 2.0 * (level * procedure.band / procedure.count as f64).sqrt();
        Self {
            cos,
            sin,
            turn,
            amplitude,
        }
    }

    fn next(&mut self) -> f64 {
        let mut sum = [0.0; LANES];
        for ((cos, sin), turn) in self.cos.iter_mut().zip(&mut self.sin).zip(&self.turn) {
            for lane in 0..LANES {
                let (c, s) = (cos[lane], sin[lane]);
                sum[lane] += c;
                cos[lane] = c * turn[0][lane] - s * turn[1][lane];
                sin[lane] = s * turn[0][lane] + c * turn[1][lane];
            }
        }
        self.amplitude * sum.iter().sum::<f64>()
    }
}

impl Procedure {
    /// N at every step from rest on, given to `see` with the number of the step.
    fn record(
        &self,
        oscillator: &Oscillator,
        seed: u64,
        periods: u32,
        mut see: impl FnMut(u32, f64),
    ) {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let step = TAU / f64::from(self.steps);
        let mut excitation = if self.count == 0 {
            Excitation::White(rng, (TAU * oscillator.h() / step).sqrt())
        } else {
            Excitation::Cosines(Cosines::new(self, oscillator.h(), &mut rng))
        };
        let damping = oscillator.zeta() * step;
        let (mut before, mut q) = (0.0, 0.0);
        for k in 0..periods * self.steps {
            let force = oscillator.contact().force(q);
            see(k, force);
            // (q+ - 2 q + q-)/step^2 + 2 zeta (q+ - q-)/(2 step) + N = f
            let push = step * step * (excitation.next() - force);
            let after = (push + 2.0 * q - (1.0 - damping) * before) / (1.0 + damping);
            (before, q) = (q, after);
        }
    }

    /// Moments of N in as many draws; the k-th draw has seed k, whatever the level.
    pub fn draws(&self, oscillator: &Oscillator, draws: u64) -> Draws {
        let one = |seed: u64| {
            let mut sums = [0.0; 4];
            let first = self.before * self.steps;
            self.record(oscillator, seed, self.before + self.periods, |k, n| {
                if k >= first {
                    for (sum, power) in sums.iter_mut().zip([1.0, n, n * n, n * n * n]) {
                        *sum += power;
                    }
                }
            });
            [1, 2, 3].map(|k| sums[k] / sums[0])
        };
        let raw = (1..=draws.max(2)).into_par_iter().map(one).collect();
        Draws { raw }
    }

    /// Time and N over the last `shown` periods of a record, one draw.
    pub fn trace(&self, oscillator: &Oscillator, seed: u64, shown: u32) -> Vec<(f64, f64)> {
        let first = self.before * self.steps;
        let step = TAU / f64::from(self.steps);
        let mut trace = Vec::new();
        self.record(oscillator, seed, self.before + shown, |k, n| {
            if k >= first {
                trace.push((f64::from(k - first) * step, n));
            }
        });
        trace
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vibroimpact::contact::ContactLaw;

    /// A linear oscillator under cosines: every line of the response is known, sum A^2/2 |H(w_k)|^2.
    #[test]
    fn one_draw_has_the_variance_of_its_own_lines() {
        let oscillator = Oscillator::new(ContactLaw::Linear, 0.05, 1e-2).unwrap();
        let procedure = Procedure {
            count: 64,
            steps: 100,
            periods: 4000,
            ..Procedure::default()
        };
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let amplitude = 2.0 * (1e-2f64 * 4.0 / 64.0).sqrt();
        let mut exact = 0.0;
        for _ in 0..64 {
            let w = 4.0 * (1.0 - rng.random::<f64>());
            let _phase: f64 = rng.random();
            exact += 0.5 * amplitude.powi(2) / ((1.0 - w * w).powi(2) + (0.1 * w).powi(2));
        }
        let seen = statistics(procedure.draws(&oscillator, 2).raw[0])[1].powi(2);
        println!("{seen} against {exact}");
        assert!((seen / exact - 1.0).abs() < 5e-3);
    }

    #[test]
    fn the_jackknife_of_a_mean_is_its_standard_error() {
        let raw: Vec<[f64; 3]> = (0..50).map(|k| [f64::from(k % 7), 20.0, 100.0]).collect();
        let it = Draws { raw };
        let (each, all) = (it.spread(0), it.pooled(0));
        assert!((each.value - all.value).abs() < 1e-13);
        assert!((each.error / 50f64.sqrt() / all.error - 1.0).abs() < 1e-12);
    }
}
