//! Exact sampling of the stationary law of q.

use crate::oscillator::DisplacementLaw;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

/// Draws displacements from p_q.
#[derive(Debug, Clone)]
pub(super) struct DisplacementSampler {
    law: DisplacementLaw,
    envelope: Envelope,
}

/// What is drawn from, to be rejected by the ratio of the densities.
#[derive(Debug, Clone)]
enum Envelope {
    /// One well, log-concave: a flat top and two exponential tails, tangent to U/T where it is one above its minimum
    /// (Devroye, Non-Uniform Random Variate Generation, 1986, section VII.2).
    Tangents {
        low: f64,
        high: f64,
        slope_left: f64,
        slope_right: f64,
    },
    /// Any other: steps over panels on which the density is monotone, out to e^-80.
    Steps {
        /// The ends of the panels.
        ends: Vec<f64>,
        /// (U - U_min)/T where it is least on each, and the mass of the steps up to its right end.
        lowest: Vec<f64>,
        sums: Vec<f64>,
    },
}

/// Points at which a force is looked at.
const SAMPLES: usize = 2000;

/// Steps of equal width next to the ends of the law's own panels.
const STEPS: usize = 600;

impl DisplacementSampler {
    /// The sampler of a law.
    pub(super) fn of(law: &DisplacementLaw) -> Self {
        let contact = law.contact();
        let envelope = if is_convex(law) {
            let t = law.temperature();
            let (left, right) = contact.turning_points(t).unwrap_or((0.0, 0.0));
            let slope_left = -contact.force(left) / t;
            let slope_right = contact.force(right) / t;
            Envelope::Tangents {
                low: left + 1.0 / slope_left,
                high: right - 1.0 / slope_right,
                slope_left,
                slope_right,
            }
        } else {
            steps(law)
        };
        Self {
            law: law.clone(),
            envelope,
        }
    }

    /// One displacement from the stationary law.
    pub(super) fn sample(&self, rng: &mut impl Rng) -> f64 {
        match &self.envelope {
            Envelope::Tangents {
                low,
                high,
                slope_left,
                slope_right,
            } => {
                let (left, right) = (1.0 / slope_left, 1.0 / slope_right);
                let flat = high - low;
                loop {
                    let place = rng.random::<f64>() * (left + flat + right);
                    // 1 - u is never 0, so the logarithm is finite.
                    let tail = -(1.0 - rng.random::<f64>()).ln();
                    let (q, envelope) = if place < left {
                        (low - tail * left, tail)
                    } else if place < left + flat {
                        (low + (place - left), 0.0)
                    } else {
                        (high + tail * right, tail)
                    };
                    if rng.random::<f64>() <= (envelope - self.law.level(q)).exp() {
                        return q;
                    }
                }
            }
            Envelope::Steps { ends, lowest, sums } => {
                let all = sums.last().copied().unwrap_or(0.0);
                loop {
                    let place = rng.random::<f64>() * all;
                    let k = sums
                        .partition_point(|sum| *sum <= place)
                        .min(lowest.len() - 1);
                    let q = ends[k] + rng.random::<f64>() * (ends[k + 1] - ends[k]);
                    if rng.random::<f64>() <= (lowest[k] - self.law.level(q)).exp() {
                        return q;
                    }
                }
            }
        }
    }

    /// One state (q, v) from the stationary law (21).
    pub(super) fn sample_state(&self, rng: &mut impl Rng) -> (f64, f64) {
        let normal: f64 = StandardNormal.sample(rng);
        (self.sample(rng), normal * self.law.temperature().sqrt())
    }
}

/// Whether the force falls nowhere, on a sample of points: U is then above its tangents.
fn is_convex(law: &DisplacementLaw) -> bool {
    let ends = law.panels();
    let (low, high) = (ends[0], ends[ends.len() - 1]);
    let at = |k: usize| low + (high - low) * k as f64 / SAMPLES as f64;
    let forces: Vec<f64> = (0..=SAMPLES).map(|k| law.contact().force(at(k))).collect();
    forces.windows(2).all(|pair| pair[1] >= pair[0])
}

/// Steps above the density: U is monotone between its extrema, which are among the ends.
fn steps(law: &DisplacementLaw) -> Envelope {
    let mut ends = law.panels().to_vec();
    let (low, high) = (ends[0], ends[ends.len() - 1]);
    ends.extend((1..STEPS).map(|k| low + (high - low) * k as f64 / STEPS as f64));
    ends.sort_by(f64::total_cmp);
    ends.dedup();
    let lowest: Vec<f64> = ends
        .windows(2)
        .map(|w| law.level(w[0]).min(law.level(w[1])))
        .collect();
    let mut sum = 0.0;
    let masses = ends.windows(2).zip(&lowest).map(|(w, level)| {
        sum += (w[1] - w[0]) * (-level).exp();
        sum
    });
    let sums = masses.collect();
    Envelope::Steps { ends, lowest, sums }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::{ContactLaw, Parameter, Parameters};
    use crate::oscillator::Oscillator;
    use rand::SeedableRng;
    use rand_xoshiro::Xoshiro256PlusPlus;

    #[test]
    fn the_sampler_follows_the_displacement_law() {
        let wells =
            Parameters::new().with("coefficients", Parameter::Numbers(vec![-1.0, 0.2, 1.0]));
        let wells = ContactLaw::given("polynomial", &wells).unwrap();
        // One well, with a force that falls between q = 0.37 and 0.89.
        let dent = Parameters::new().with("coefficients", Parameter::Numbers(vec![1.0, -1.9, 1.0]));
        let dent = ContactLaw::given("polynomial", &dent).unwrap();
        for (h, contact) in [
            (2e-3, ContactLaw::Hertz),
            (0.3, ContactLaw::Hertz),
            (2e-3, ContactLaw::Bilinear),
            (3e-4, wells.clone()),
            (5e-5, wells),
            (1.27e-4, dent),
        ] {
            let law = Oscillator::new(contact, 0.005, h)
                .unwrap()
                .displacement_law()
                .unwrap();
            let (sampler, n) = (DisplacementSampler::of(&law), 200_000);
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
            let draws: Vec<f64> = (0..n).map(|_| sampler.sample(&mut rng)).collect();
            // Kolmogorov-Smirnov distance on a grid of points; 1 % point 1.63/sqrt(n).
            let (low, high) = law
                .contact()
                .turning_points(40.0 * law.temperature())
                .unwrap();
            for k in 1..40 {
                let q = low + (high - low) * f64::from(k) / 40.0;
                let exact = law.ln_tail_below(q).value.exp();
                let got = draws.iter().filter(|x| **x < q).count() as f64 / f64::from(n);
                assert!(
                    (got - exact).abs() < 1.63 / f64::from(n).sqrt(),
                    "{q}: {got} {exact}"
                );
            }
        }
    }
}
