//! What a scene's numbers are held against.

use super::against::Against;
use super::extreme::Extreme;
use vibroimpact::contact::ContactLaw;
use vibroimpact::error::{Error, Result};
use vibroimpact::estimate::{Estimate, Warning, name_at};
use vibroimpact::fokker_planck::DecayRate;
use vibroimpact::gaussian::Gaussian;
use vibroimpact::moments::Moments;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::plan::{Part, Plan};
use vibroimpact::results::Results;
use vibroimpact::scales::Scales;
use vibroimpact::scene::Scene;
use vibroimpact::stationary::Stationary;

/// Standard errors within which a sampled number counts as within its error estimate: one in two million lies
/// outside, and the seeds are fixed.
pub(super) const SIGMAS: f64 = 5.0;

/// A number beside what it should be.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Check {
    /// Stage of the plan that answers.
    pub(super) stage: &'static str,
    /// Name and time, as warnings write them.
    pub(super) name: String,
    pub(super) value: f64,
    /// Its error estimate; one standard error if `sampled`.
    pub(super) estimate: f64,
    pub(super) sampled: bool,
    pub(super) reference: f64,
    pub(super) reference_error: f64,
    pub(super) scale: f64,
    pub(super) tolerance: f64,
}

/// Every number of the scene that its yardstick knows.
pub(super) fn checks(extreme: &Extreme, scene: &Scene, results: &Results) -> Result<Vec<Check>> {
    let oscillator = &scene.oscillator;
    let comparison = Comparison {
        scales: Scales::of(oscillator),
        tolerance: scene.accuracy.tolerance,
    };
    match &extreme.against {
        Against::Gaussian => {
            let start = Gaussian::of(oscillator, &scene.initial)?;
            let at = |t: f64| Ok(gaussian_moments(oscillator, &start.after(oscillator, t)?));
            comparison.both(results, &at)
        }
        Against::Flight => {
            let free = Oscillator::new(ContactLaw::Free, oscillator.zeta(), oscillator.h())?;
            let start = Gaussian::of(&free, &scene.initial)?;
            let at = |t: f64| {
                let mut it = gaussian_moments(&free, &start.after(&free, t)?);
                // U of the contact in flight is -q and a constant.
                let loss = oscillator.contact().loss_point().unwrap_or(0.0);
                it.mean_energy.value += oscillator.contact().potential(loss) + loss;
                it.contact_loss_probability = Some(Estimate::closed_form(1.0));
                Ok(it)
            };
            comparison.both(results, &at)
        }
        Against::Stationary => {
            let law = Stationary::of(oscillator)?;
            let mut all = comparison.both(results, &|_| Ok(law.moments()))?;
            if let Some(it) = &results.records {
                comparison.moments(&mut all, None, &it.moments, &law.moments(), Part::Records);
            }
            Ok(all)
        }
        Against::Start => {
            let start = Gaussian::of(oscillator, &scene.initial)?;
            let at = |_: f64| Ok(start_moments(&start));
            comparison.both(results, &at)
        }
        Against::Paths => Ok(comparison.paths(results)),
        Against::Other(overrides) => {
            let other = extreme.scene(overrides);
            let other = other.map_err(|it| Error::invalid("the yardstick", it, "a scene"))?;
            Ok(comparison.other(results, &Plan::of(&other)?.run_quietly()?))
        }
        Against::EnergyLaw => Ok(comparison.energy_law(oscillator, results)),
        Against::FlightTail => Ok(flight_tail(oscillator, results)),
        Against::LinearRates => Ok(linear_rates(scene, results)),
        Against::Steady => Ok(comparison.steady(results)),
        Against::Refusal => Ok(Vec::new()),
    }
}

struct Comparison {
    scales: Scales,
    tolerance: f64,
}

impl Comparison {
    /// Transient and ensemble against closed forms at their times.
    fn both(&self, results: &Results, at: &dyn Fn(f64) -> Result<Moments>) -> Result<Vec<Check>> {
        let mut all = Vec::new();
        if let Some(it) = &results.transient {
            for (t, moments) in it.times.iter().zip(&it.moments) {
                self.moments(&mut all, Some(*t), moments, &at(*t)?, Part::Transient);
            }
        }
        if let Some(it) = &results.monte_carlo {
            for (t, moments) in it.times.iter().zip(&it.moments) {
                self.moments(&mut all, Some(*t), moments, &at(*t)?, Part::MonteCarlo);
            }
        }
        Ok(all)
    }

    /// Every moment that exists on both sides; those the reference does not know are NaN there.
    fn moments(
        &self,
        all: &mut Vec<Check>,
        t: Option<f64>,
        moments: &Moments,
        reference: &Moments,
        part: Part,
    ) {
        let sampled = matches!(part, Part::MonteCarlo | Part::Records);
        let scales = self.scales.each(reference);
        let pairs = moments.named().into_iter().zip(reference.named());
        for (((name, value), (_, reference)), scale) in pairs.zip(scales) {
            let (Some(value), Some(reference)) = (value, reference) else {
                continue;
            };
            if !reference.value.is_finite() {
                continue;
            }
            let stage = part.name();
            let name = if sampled {
                format!("{stage}.{name}")
            } else {
                name.to_string()
            };
            all.push(Check {
                stage,
                name: t.map_or(name.clone(), |t| name_at(&name, t)),
                value: value.value,
                estimate: value.error,
                sampled,
                reference: reference.value,
                // Rounding of the closed form, which adds terms of the size of the scale.
                reference_error: reference.error + 1e-12 * (scale + reference.value.abs()),
                scale,
                tolerance: self.tolerance,
            });
        }
    }

    /// The law that lasts against paths that have run for long, at the times of its phases.
    fn lasting(&self, results: &Results) -> Vec<Check> {
        let mut all = Vec::new();
        let (Some(law), Some(paths)) = (&results.periodic, &results.monte_carlo) else {
            return all;
        };
        let Some(drive) = results.scene.excitation.drive else {
            return all;
        };
        let n = law.phase.len() as f64;
        for (t, sampled) in paths.times.iter().zip(&paths.moments) {
            let turns = t / drive.period();
            let k = n * (turns - turns.floor());
            if (k - k.round()).abs() < 1e-6 {
                let moments = law.moments[k.round() as usize % law.phase.len()];
                let reference = bounded(*sampled);
                self.moments(&mut all, Some(*t), &moments, &reference, Part::Periodic);
            }
        }
        all
    }

    fn paths(&self, results: &Results) -> Vec<Check> {
        let mut all = self.lasting(results);
        let (Some(mesh), Some(paths)) = (&results.transient, &results.monte_carlo) else {
            return all;
        };
        for (k, t) in mesh.times.iter().enumerate() {
            if let Some(j) = paths.times.iter().position(|it| it == t) {
                let (moments, reference) = (&mesh.moments[k], bounded(paths.moments[j]));
                self.moments(&mut all, Some(*t), moments, &reference, Part::Transient);
            }
        }
        all
    }

    fn other(&self, results: &Results, other: &Results) -> Vec<Check> {
        let mut all = Vec::new();
        if let (Some(a), Some(b)) = (&results.monte_carlo, &other.monte_carlo) {
            for ((t, a), b) in a.times.iter().zip(&a.moments).zip(&b.moments) {
                self.moments(&mut all, Some(*t), a, &bounded(*b), Part::MonteCarlo);
            }
        }
        if let (Some(a), Some(b)) = (&results.transient, &other.transient) {
            for ((t, a), b) in a.times.iter().zip(&a.moments).zip(&b.moments) {
                self.moments(&mut all, Some(*t), a, b, Part::Transient);
            }
        }
        all
    }

    /// E\[H\] gained over the whole time against the integral of pi h - 2 zeta E\[v^2\] by Simpson's
    /// rule, whose error is taken from the same on every second point.
    fn energy_law(&self, oscillator: &Oscillator, results: &Results) -> Vec<Check> {
        let Some(it) = &results.transient else {
            return Vec::new();
        };
        let second = |m: &Moments| m.var_v.value + m.mean_v.value.powi(2);
        let n = it.times.len().saturating_sub(1) / 4 * 4;
        if n < 4 {
            return Vec::new();
        }
        let (first, last) = (&it.moments[0], &it.moments[n]);
        let time = it.times[n] - it.times[0];
        let rate = |k: usize| oscillator.noise() - 2.0 * oscillator.zeta() * second(&it.moments[k]);
        let simpson = |stride: usize| -> f64 {
            let m = n / stride;
            let weight = |k: usize| match k {
                k if k == 0 || k == m => 1.0,
                k if k % 2 == 1 => 4.0,
                _ => 2.0,
            };
            let sum: f64 = (0..=m).map(|k| weight(k) * rate(k * stride)).sum();
            sum * time / (3.0 * m as f64)
        };
        let gained = simpson(1);
        let quadrature = (gained - simpson(2)).abs();
        let energies = first.mean_energy.error + last.mean_energy.error;
        let speed = it
            .moments
            .iter()
            .map(|m| m.var_v.error + 2.0 * m.mean_v.value.abs() * m.mean_v.error);
        let speeds = 2.0 * oscillator.zeta() * time * speed.fold(0.0, f64::max);
        vec![Check {
            stage: Part::Transient.name(),
            name: "E[H] gained".into(),
            value: last.mean_energy.value - first.mean_energy.value,
            estimate: energies,
            sampled: false,
            reference: gained,
            reference_error: speeds + quadrature,
            scale: oscillator.temperature(),
            tolerance: 2.0 * self.tolerance,
        }]
    }

    fn steady(&self, results: &Results) -> Vec<Check> {
        let Some(it) = &results.steady else {
            return Vec::new();
        };
        let mut all = Vec::new();
        if let Ok(law) = Stationary::of(&results.scene.oscillator) {
            self.moments(&mut all, None, &it.moments, &law.moments(), Part::Steady);
        }
        all.push(Check {
            stage: Part::Steady.name(),
            name: "L1 error".into(),
            value: it.l1_error.value,
            estimate: it.l1_error.error,
            sampled: false,
            reference: 0.0,
            // The number is itself an error, and may be as large as the tolerance.
            reference_error: self.tolerance,
            scale: 1.0,
            tolerance: self.tolerance,
        });
        all
    }
}

/// Sampled moments with errors that bound them.
fn bounded(mut moments: Moments) -> Moments {
    for number in moments.each_mut().into_iter().flatten() {
        number.error *= SIGMAS;
    }
    moments
}

fn estimate(value: f64) -> Estimate {
    Estimate::closed_form(value)
}

/// Moments of a Gaussian law under G = q or G = -1.
fn gaussian_moments(oscillator: &Oscillator, law: &Gaussian) -> Moments {
    let mut it = start_moments(law);
    let [[cqq, _], [_, cvv]] = law.covariance;
    let [q, v] = law.mean;
    let kinetic = 0.5 * (cvv + v * v);
    if *oscillator.contact() == ContactLaw::Linear {
        it.mean_force = estimate(q);
        it.std_force = estimate(cqq.sqrt());
        it.skewness_force = estimate(0.0);
        it.kurtosis_force = estimate(3.0);
        it.mean_energy = estimate(kinetic + 0.5 * (cqq + q * q));
    } else {
        it.mean_force = estimate(-1.0);
        it.std_force = estimate(0.0);
        it.mean_energy = estimate(kinetic - q);
    }
    it
}

/// The moments of q and v of a Gaussian law; those that need a contact are NaN.
fn start_moments(law: &Gaussian) -> Moments {
    let [[cqq, cqv], [_, cvv]] = law.covariance;
    let unknown = Estimate {
        value: f64::NAN,
        ..Estimate::default()
    };
    Moments {
        mean_q: estimate(law.mean[0]),
        var_q: estimate(cqq),
        mean_v: estimate(law.mean[1]),
        var_v: estimate(cvv),
        cov_qv: estimate(cqv),
        mean_force: unknown,
        std_force: unknown,
        skewness_force: unknown,
        kurtosis_force: unknown,
        mean_energy: unknown,
        contact_loss_probability: None,
        left_out: 0,
    }
}

/// Out of contact U = -q - 3/5, so the tail is T e^{-9/(10 T)}; the normaliser of a smooth, decaying
/// integrand by the trapezoidal rule. For T far below 1, where the tail counts for nothing in it.
fn flight_tail(oscillator: &Oscillator, results: &Results) -> Vec<Check> {
    let t = oscillator.temperature();
    let width = t.sqrt();
    let points = 4000;
    let z: f64 = (-points..=points)
        .map(|k| width * 12.0 * f64::from(k) / f64::from(points))
        .map(|q| (-oscillator.contact().potential(q) / t).exp())
        .sum();
    let z = z * width * 12.0 / f64::from(points);
    let exact = ((t / z).ln() - 0.9 / t) / std::f64::consts::LN_10;
    let Some(it) = results.stationary.as_ref() else {
        return Vec::new();
    };
    let number = it.get("log10_contact_loss_probability");
    let plain = it.get("contact_loss_probability");
    let check = |name: &str, number: Estimate, reference: f64| Check {
        stage: Part::Stationary.name(),
        name: name.into(),
        value: number.value,
        estimate: number.error,
        sampled: false,
        reference,
        reference_error: 1e-13 * reference.abs(),
        // Doubles end there: what underflows is known no better.
        scale: reference.abs().max(f64::MIN_POSITIVE / 1e-6),
        tolerance: 1e-6,
    };
    let mut all = Vec::new();
    all.extend(number.map(|it| check("log10 P(loss)", it, exact)));
    // Beyond a relative error of 1e-13 of the exponent the probability itself is less well known.
    let linear = 10f64.powf(exact);
    all.extend(plain.map(|it| Check {
        reference_error: linear * 1e-13 * exact.abs() * std::f64::consts::LN_10 + f64::from_bits(4),
        ..check("P(loss)", it, linear)
    }));
    all
}

/// Eigenvalues of G = q with 0 < m + n < 30, a complex pair once (im > 0), slowest first.
pub fn exact_rates(zeta: f64) -> Vec<[f64; 2]> {
    let mut all = Vec::new();
    for m in 0..30 {
        for n in 0..30 - m {
            let (sum, difference) = (f64::from(m + n), f64::from(m - n));
            if m + n == 0 {
                continue;
            }
            if zeta < 1.0 {
                if m >= n {
                    all.push([-zeta * sum, (1.0 - zeta * zeta).sqrt() * difference]);
                }
            } else {
                // zeta - root without cancellation.
                let fast = zeta + (zeta * zeta - 1.0).sqrt();
                all.push([-f64::from(m) / fast - fast * f64::from(n), 0.0]);
            }
        }
    }
    all.sort_by(|a, b| b[0].total_cmp(&a[0]));
    all
}

/// Every rate printed against the nearest exact one, each of them once; every exact one slower than the last printed,
/// and the slowest real one, against the nearest printed. Fewer than asked for are a number that does not exist,
/// unless a warning says so.
fn linear_rates(scene: &Scene, results: &Results) -> Vec<Check> {
    let Some(rates) = results.decay_rates.as_ref().map(|it| &it.rates) else {
        return Vec::new();
    };
    let exact = exact_rates(scene.oscillator.zeta());
    let away = |exact: &[f64; 2], rate: &DecayRate| (exact[0] - rate.re).hypot(exact[1] - rate.im);
    let check = |name: String, value: f64, estimate: f64, scale: f64| Check {
        stage: Part::DecayRates.name(),
        name,
        value,
        estimate,
        sampled: false,
        reference: 0.0,
        reference_error: 1e-12,
        scale,
        tolerance: scene.accuracy.tolerance,
    };
    let size = |rate: &DecayRate| rate.re.hypot(rate.im);
    let mut all = Vec::new();
    // An exact rate that is there twice, at critical damping, may be printed twice.
    let mut free = exact.clone();
    for (k, rate) in rates.iter().enumerate() {
        let nearest =
            (0..free.len()).min_by(|a, b| away(&free[*a], rate).total_cmp(&away(&free[*b], rate)));
        let error = nearest.map_or(f64::NAN, |k| away(&free.remove(k), rate));
        let name = format!("decay rate {}", k + 1);
        all.push(check(name, error, rate.error, size(rate)));
    }
    let last = rates.last().map_or(0.0, |it| it.re + it.error);
    let slower = exact.iter().filter(|it| it[0] > last + 1e-12);
    let real = exact.iter().find(|it| it[1] == 0.0);
    for it in slower.chain(real) {
        let nearest = rates
            .iter()
            .min_by(|a, b| away(it, a).total_cmp(&away(it, b)));
        if let Some(rate) = nearest {
            let name = format!("exact rate {:.4e} {:+.4e} i", it[0], it[1]);
            all.push(check(name, away(it, rate), rate.error, size(rate)));
        }
    }
    let said = |it: &Warning| it.text.contains(Part::DecayRates.name());
    if rates.len() < scene.outputs.decay_rates && !results.run.warnings.iter().any(said) {
        let name = format!("decay rate {}", rates.len() + 1);
        all.push(check(name, f64::NAN, f64::NAN, 1.0));
    }
    all
}
