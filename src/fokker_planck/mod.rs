//! PLACEHOLDER of the deterministic answers, with the shape of the real module and a made-up density:
//! the stationary law mixed with the moving start. To be replaced whole.

use crate::error::Result;
use crate::estimate::{Estimate, Origin};
use crate::initial::Initial;
use crate::moments::{Moments, RawMoments};
use crate::oscillator::Oscillator;
use ndarray::{Array1, Array2};

/// Interpolation of g on the faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drift {
    /// First order, positive.
    Upwind,
    /// Second order.
    Order2,
    /// Fourth order.
    Order4,
    /// Sixth order.
    Order6,
    /// Eighth order.
    Order8,
}

/// How time is stepped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeScheme {
    /// First order, positive.
    BackwardEuler,
    /// Explicit Runge-Kutta.
    Explicit,
}

/// What the caller fixes; None is an automatic choice.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Drift.
    pub drift: Option<Drift>,
    /// Time scheme.
    pub time: Option<TimeScheme>,
    /// Cells in q and v.
    pub cells: Option<[usize; 2]>,
    /// Step.
    pub step: Option<f64>,
    /// Tolerance.
    pub tolerance: f64,
    /// Bytes.
    pub max_memory: u64,
    /// Seconds.
    pub max_seconds: f64,
}

/// What was done.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Method {
    /// Name.
    pub name: String,
    /// Why it was chosen.
    pub reason: String,
    /// Cells in q and v.
    pub cells: [usize; 2],
    /// Unknowns.
    pub unknowns: usize,
    /// q from, q to, v from, v to.
    pub domain: [f64; 4],
    /// Step.
    pub step: f64,
    /// Steps.
    pub steps: u64,
}

/// A density at one time.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// Time.
    pub t: f64,
    /// Cell centres in q.
    pub q: Array1<f64>,
    /// Cell centres in v.
    pub v: Array1<f64>,
    /// p\[q, v\].
    pub p: Array2<f64>,
}

/// The transient.
#[derive(Debug, Clone)]
pub struct Transient {
    /// Output times.
    pub times: Vec<f64>,
    /// Moments at them.
    pub moments: Vec<Moments>,
    /// Mass.
    pub mass: Vec<Estimate>,
    /// Lowest density.
    pub lowest_density: Vec<Estimate>,
    /// Relative entropy to (21).
    pub relative_entropy: Vec<Option<Estimate>>,
    /// L1 distance to (21).
    pub distance: Vec<Option<Estimate>>,
    /// Densities.
    pub densities: Vec<Snapshot>,
    /// Method.
    pub method: Method,
    /// Warnings.
    pub warnings: Vec<String>,
}

/// The steady state.
#[derive(Debug, Clone)]
pub struct Steady {
    /// L1 distance to (21).
    pub l1_error: Estimate,
    /// Residual.
    pub residual: f64,
    /// Its density.
    pub density: Snapshot,
    /// Marching: (t, L1).
    pub approach: Vec<(f64, f64)>,
    /// Method.
    pub method: Method,
    /// Warnings.
    pub warnings: Vec<String>,
}

/// An eigenvalue of L.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecayRate {
    /// Real part.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
    /// Error.
    pub error: f64,
}

/// What a stage will cost, from sizes alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// Method.
    pub method: String,
    /// Why.
    pub reason: String,
    /// Cells in q and v.
    pub cells: [usize; 2],
    /// Steps.
    pub steps: u64,
    /// Bytes.
    pub memory_bytes: u64,
    /// Seconds.
    pub seconds: f64,
}

/// A stage to be costed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Task {
    /// The transient to a time.
    Transient {
        /// Last time.
        until: f64,
    },
    /// L p = 0.
    Steady,
    /// The slowest eigenvalues.
    DecayRates {
        /// How many.
        count: usize,
    },
}

/// Sizes of a stage without computing it.
///
/// # Errors
/// None in the placeholder.
pub fn cost(_: &Oscillator, _: &Initial, task: Task, settings: &Settings) -> Result<Cost> {
    let cells = settings.cells.unwrap_or([160, 100]);
    let n = cells[0] as f64 * cells[1] as f64;
    let step = settings.step.unwrap_or(0.1);
    let (steps, fill) = match task {
        Task::Transient { until } => ((until / step).ceil() as u64, 400.0),
        Task::Steady => (1, 400.0),
        Task::DecayRates { count } => (20 * count as u64, 800.0),
    };
    Ok(Cost {
        method: "placeholder".into(),
        reason: "nothing else is built".into(),
        cells,
        steps,
        memory_bytes: (fill * n) as u64,
        seconds: 1e-7 * n * steps as f64 * 0.1 + 1e-6 * n,
    })
}

fn mesh(oscillator: &Oscillator, settings: &Settings) -> (Array1<f64>, Array1<f64>) {
    let [nq, nv] = settings.cells.unwrap_or([160, 100]);
    let t = oscillator.temperature();
    let (lo, hi) = oscillator
        .contact()
        .turning_points(16.0 * t)
        .unwrap_or((-200.0, 20.0));
    let top = (32.0 * t).sqrt();
    let centres = |lo: f64, hi: f64, n: usize| {
        Array1::from_shape_fn(n, |k| lo + (hi - lo) * (k as f64 + 0.5) / n as f64)
    };
    (centres(lo, hi, nq), centres(-top, top, nv))
}

fn density(oscillator: &Oscillator, initial: &Initial, t: f64, settings: &Settings) -> Snapshot {
    let (q, v) = mesh(oscillator, settings);
    let law = oscillator.displacement_law().ok();
    let temperature = oscillator.temperature();
    let (mean, deviation) = match *initial {
        Initial::Gaussian { mean, deviation } => (mean, deviation),
        _ => ([0.0; 2], [0.3; 2]),
    };
    let stay = (-2.0 * oscillator.zeta() * t).exp();
    let (sin, cos) = t.sin_cos();
    let centre = [mean[0] * cos + mean[1] * sin, mean[1] * cos - mean[0] * sin];
    let bump = |x: f64, m: f64, s: f64| {
        (-0.5 * ((x - m) / s).powi(2)).exp() / (s * std::f64::consts::TAU.sqrt())
    };
    let mut p = Array2::from_shape_fn((q.len(), v.len()), |(i, j)| {
        let start = bump(q[i], centre[0], deviation[0]) * bump(v[j], centre[1], deviation[1]);
        stay * start
            + (1.0 - stay)
                * law.as_ref().map_or(0.0, |law| {
                    law.density(q[i]) * bump(v[j], 0.0, temperature.sqrt())
                })
    });
    if t.is_infinite()
        && let Some(law) = &law
    {
        p = Array2::from_shape_fn((q.len(), v.len()), |(i, j)| {
            law.density(q[i]) * bump(v[j], 0.0, temperature.sqrt())
        });
    }
    Snapshot { t, q, v, p }
}

fn measured(snapshot: &Snapshot, oscillator: &Oscillator) -> Moments {
    let contact = oscillator.contact();
    let cell = (snapshot.q[1] - snapshot.q[0]) * (snapshot.v[1] - snapshot.v[0]);
    let mut raw = RawMoments::default();
    for ((i, j), p) in snapshot.p.indexed_iter() {
        let (q, v, w) = (snapshot.q[i], snapshot.v[j], p * cell);
        raw.mass += w;
        raw.q += w * q;
        raw.qq += w * q * q;
        raw.v += w * v;
        raw.vv += w * v * v;
        raw.qv += w * q * v;
        for n in 0..4 {
            raw.force[n] += w * contact.force(q).powi(n as i32 + 1);
        }
        raw.potential += w * contact.potential(q);
        raw.lost += w * f64::from(u8::from(contact.loss_point().is_some_and(|loss| q < loss)));
    }
    let mut moments = raw.moments(contact);
    let blur = |x: &mut Estimate| {
        x.error = 2e-3;
        x.origin = Origin::Space;
    };
    for x in [
        &mut moments.mean_q,
        &mut moments.var_q,
        &mut moments.mean_v,
        &mut moments.var_v,
        &mut moments.cov_qv,
        &mut moments.mean_force,
        &mut moments.std_force,
        &mut moments.skewness_force,
        &mut moments.kurtosis_force,
        &mut moments.mean_energy,
    ] {
        blur(x);
    }
    if let Some(x) = &mut moments.contact_loss_probability {
        blur(x);
    }
    moments
}

fn method(snapshot: &Snapshot, step: f64, until: f64) -> Method {
    let (q, v) = (&snapshot.q, &snapshot.v);
    Method {
        name: "placeholder".into(),
        reason: "nothing else is built".into(),
        cells: [q.len(), v.len()],
        unknowns: q.len() * v.len(),
        domain: [q[0], q[q.len() - 1], v[0], v[v.len() - 1]],
        step,
        steps: (until / step).ceil() as u64,
    }
}

/// The transient.
///
/// # Errors
/// None in the placeholder.
pub fn transient(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    density_times: &[f64],
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Transient> {
    let end = density(oscillator, initial, f64::INFINITY, settings);
    let cell = (end.q[1] - end.q[0]) * (end.v[1] - end.v[0]);
    let until = times
        .iter()
        .chain(density_times)
        .copied()
        .fold(0.0, f64::max);
    let mut it = Transient {
        times: times.to_vec(),
        moments: vec![],
        mass: vec![],
        lowest_density: vec![],
        relative_entropy: vec![],
        distance: vec![],
        densities: vec![],
        method: method(&end, settings.step.unwrap_or(0.1), until),
        warnings: vec!["placeholder: these densities are made up".into()],
    };
    for (k, t) in times.iter().enumerate() {
        let now = density(oscillator, initial, *t, settings);
        it.moments.push(measured(&now, oscillator));
        let space = |x: f64| Estimate::new(x, 1e-9, Origin::Space);
        it.mass.push(space(now.p.sum() * cell));
        it.lowest_density
            .push(space(now.p.iter().copied().fold(f64::MAX, f64::min)));
        let pairs = || {
            now.p
                .iter()
                .zip(&end.p)
                .filter(|(p, s)| **p > 0.0 && **s > 0.0)
        };
        let entropy: f64 = pairs().map(|(p, s)| p * (p / s).ln() * cell).sum();
        let distance: f64 = pairs().map(|(p, s)| (p - s).abs() * cell).sum();
        it.relative_entropy.push(Some(space(entropy)));
        it.distance.push(Some(space(distance)));
        progress(k as f64 / times.len() as f64);
    }
    it.densities = density_times
        .iter()
        .map(|t| density(oscillator, initial, *t, settings))
        .collect();
    Ok(it)
}

/// The steady state.
///
/// # Errors
/// None in the placeholder.
pub fn steady(oscillator: &Oscillator, settings: &Settings) -> Result<Steady> {
    let density = density(oscillator, &Initial::Stationary, f64::INFINITY, settings);
    Ok(Steady {
        l1_error: Estimate::new(1e-12, 1e-12, Origin::Space),
        residual: 1e-13,
        approach: (0..60)
            .map(|k| {
                let t = 50.0 * f64::from(k);
                (t, (-2.0 * oscillator.zeta() * t).exp())
            })
            .collect(),
        method: method(&density, 1.0, 1.0),
        density,
        warnings: vec![],
    })
}

/// The slowest decay rates.
///
/// # Errors
/// None in the placeholder.
pub fn decay_rates(oscillator: &Oscillator, count: usize, _: &Settings) -> Result<Vec<DecayRate>> {
    Ok((1..=count)
        .map(|k| DecayRate {
            re: -1.7 * oscillator.zeta() * k as f64,
            im: 0.0,
            error: 1e-6,
        })
        .collect())
}
