//! PLACEHOLDER of the ensemble, with the shape of the real module. To be replaced whole.

use crate::error::Result;
use crate::estimate::{Estimate, Origin};
use crate::initial::Initial;
use crate::moments::{Moments, RawMoments};
use crate::oscillator::Oscillator;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;

/// One step of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scheme {
    /// Chosen for the scene.
    #[default]
    Auto,
    /// Weak order 2.
    Baoab,
}

/// What the caller fixes.
#[derive(Debug, Clone, PartialEq)]
pub struct EnsembleSettings {
    /// Paths.
    pub paths: u64,
    /// Seed.
    pub seed: u64,
    /// Scheme.
    pub scheme: Scheme,
    /// Step.
    pub step: Option<f64>,
}

/// What came out.
#[derive(Debug, Clone)]
pub struct EnsembleResult {
    /// Times.
    pub times: Vec<f64>,
    /// Moments.
    pub moments: Vec<Moments>,
    /// Step.
    pub step: f64,
    /// Steps a path.
    pub steps: u64,
    /// Scheme.
    pub scheme: String,
    /// Paths times steps.
    pub path_steps: u64,
    /// Warnings.
    pub warnings: Vec<String>,
}

/// The step that will be used.
pub fn step(_: &Oscillator, settings: &EnsembleSettings) -> f64 {
    settings.step.unwrap_or(0.1)
}

/// Moments of an ensemble of paths.
///
/// # Errors
/// None in the placeholder.
pub fn run(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &EnsembleSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<EnsembleResult> {
    const CHUNK: u64 = 1000;
    let dt = step(oscillator, settings);
    let contact = oscillator.contact();
    let sampler = match initial {
        Initial::Stationary => Some(oscillator.displacement_law()?.sampler()),
        _ => None,
    };
    let chunks = settings.paths.div_ceil(CHUNK);
    let sums: Vec<Vec<RawMoments>> = (0..chunks)
        .into_par_iter()
        .map(|chunk| {
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(settings.seed ^ (chunk << 20));
            let mut sum = vec![RawMoments::default(); times.len()];
            for _ in 0..CHUNK.min(settings.paths - chunk * CHUNK) {
                let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
                let (mut q, mut v) = match *initial {
                    Initial::Gaussian { mean, deviation } => (
                        mean[0] + deviation[0] * normal(),
                        mean[1] + deviation[1] * normal(),
                    ),
                    _ => (0.0, 0.0),
                };
                if let Some(sampler) = &sampler {
                    (q, v) = sampler.sample_state(&mut rng);
                }
                let mut t = 0.0;
                for (raw, end) in sum.iter_mut().zip(times) {
                    let n = ((end - t) / dt).ceil().max(0.0);
                    let dt = if n > 0.0 { (end - t) / n } else { 0.0 };
                    let decay = (-2.0 * oscillator.zeta() * dt).exp();
                    let kick = (oscillator.temperature() * (1.0 - decay * decay)).sqrt();
                    for _ in 0..n as u64 {
                        v -= 0.5 * dt * contact.force(q);
                        q += 0.5 * dt * v;
                        let z: f64 = StandardNormal.sample(&mut rng);
                        v = decay * v + kick * z;
                        q += 0.5 * dt * v;
                        v -= 0.5 * dt * contact.force(q);
                    }
                    t = *end;
                    raw.mass += 1.0;
                    raw.q += q;
                    raw.qq += q * q;
                    raw.v += v;
                    raw.vv += v * v;
                    raw.qv += q * v;
                    let force = contact.force(q);
                    for k in 0..4 {
                        raw.force[k] += force.powi(k as i32 + 1);
                    }
                    raw.potential += contact.potential(q);
                    let lost = contact.loss_point().is_some_and(|loss| q < loss);
                    raw.lost += f64::from(u8::from(lost));
                }
            }
            progress(chunk as f64 / chunks as f64);
            sum
        })
        .collect();
    let moments = (0..times.len())
        .map(|k| {
            let mut all = RawMoments::default();
            for sum in &sums {
                let one = &sum[k];
                all.mass += one.mass;
                all.q += one.q;
                all.qq += one.qq;
                all.v += one.v;
                all.vv += one.vv;
                all.qv += one.qv;
                for n in 0..4 {
                    all.force[n] += one.force[n];
                }
                all.potential += one.potential;
                all.lost += one.lost;
            }
            let root = (settings.paths as f64).sqrt();
            let mut m = all.moments(contact);
            let error = |x: &mut Estimate, s: f64| {
                *x = Estimate::new(x.value, s / root, Origin::Sampling);
            };
            let (vq, vv) = (m.var_q.value, m.var_v.value);
            error(&mut m.mean_q, vq.sqrt());
            error(&mut m.var_q, 1.5 * vq);
            error(&mut m.mean_v, vv.sqrt());
            error(&mut m.var_v, 1.5 * vv);
            error(&mut m.cov_qv, (vq * vv).sqrt());
            let std = m.std_force.value;
            error(&mut m.mean_force, std);
            error(&mut m.std_force, 0.8 * std);
            error(&mut m.skewness_force, 2.5);
            error(&mut m.kurtosis_force, 8.0);
            let energy = m.mean_energy.value;
            error(&mut m.mean_energy, energy);
            if let Some(p) = &mut m.contact_loss_probability {
                let s = (p.value * (1.0 - p.value)).sqrt();
                error(p, s);
            }
            m
        })
        .collect();
    let steps = (times.last().copied().unwrap_or(0.0) / dt).ceil() as u64;
    Ok(EnsembleResult {
        times: times.to_vec(),
        moments,
        step: dt,
        steps,
        scheme: "placeholder".into(),
        path_steps: steps * settings.paths,
        warnings: vec![],
    })
}
