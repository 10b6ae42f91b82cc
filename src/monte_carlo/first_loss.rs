//! The first loss of contact: how long contact survives.

use super::ensemble::{BLOCK, TASKS, equal_steps};
use super::events::Watch;
use super::law::{self, Law, WithLaw};
use super::noise::LANES;
use super::paths::{Paths, highest_frequency};
use super::scheme::{self, Coefficients};
use super::statistics::proportion;
use super::{EnsembleSettings, Noise, Progress, Scheme, resolve};
use crate::error::{Error, Result, positive};
use crate::estimate::{Estimate, Origin};
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use rayon::prelude::*;
use std::ops::Range;

/// Survival of contact in an ensemble; one standard error on every number.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstLossResult {
    /// The times asked for.
    pub times: Vec<f64>,
    /// P(no loss of contact up to t) at each time.
    pub survival: Vec<Estimate>,
    /// Mean density of the first loss between the time before (0 for the first) and this one.
    pub density: Vec<Estimate>,
    /// Mean time in contact up to the first loss or the last time, whichever comes first.
    pub mean_time: Estimate,
    /// Longest step.
    pub step: f64,
    /// The scheme used.
    pub scheme: Scheme,
    /// Paths times steps.
    pub path_steps: u64,
}

/// When contact is first lost, up to the last of `times` (ascending), located between steps. A
/// stationary start is taken given contact; any other start below the loss point is lost at t = 0.
///
/// The driven velocity is followed as the scheme sees it: within an undamped motion of the splitting,
/// short excursions are found, however short.
///
/// # Errors
/// As [`super::run`]; [`Error::Invalid`] for a law that cannot lose contact and for a scheme that does not
/// locate crossings; [`Error::Limit`] where `max_seconds` are over.
pub fn first_loss(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &EnsembleSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<FirstLossResult> {
    let plan = Plan::new(oscillator, initial, times, settings)?;
    let path_steps = plan.steps.saturating_mul(settings.paths);
    let progress = &Progress::new(settings.paths, progress).within(settings.max_seconds);
    let run = Survive {
        plan: &plan,
        progress,
    };
    let sums = law::dispatch(oscillator.contact(), run);
    progress.in_time()?;
    progress.finish();
    let n = settings.paths as f64;
    let (mut gone, mut start) = (0.0, 0.0);
    let (mut survival, mut density) = (Vec::new(), Vec::new());
    for (time, lost) in times.iter().zip(&sums.lost) {
        gone += lost;
        survival.push(proportion(n - gone, n));
        let length = time - start;
        density.push(if length > 0.0 {
            proportion(*lost, n).scaled(1.0 / length)
        } else {
            Estimate::new(f64::NAN, f64::NAN, Origin::Sampling)
        });
        start = *time;
    }
    let mean = sums.time / n;
    let variance = (sums.time_square / n - mean * mean).max(0.0);
    Ok(FirstLossResult {
        times: times.to_vec(),
        survival,
        density,
        mean_time: Estimate::new(mean, (variance / (n - 1.0)).sqrt(), Origin::Sampling),
        step: plan.step,
        scheme: plan.scheme,
        path_steps,
    })
}

/// The scheme and the longest step that [`first_loss`] would use.
///
/// # Errors
/// [`Error::Invalid`] for a step that is not positive, noise that is not white, or a scheme that does not
/// locate losses of contact.
pub fn first_loss_scheme_and_step(
    oscillator: &Oscillator,
    initial: &Initial,
    settings: &EnsembleSettings,
) -> Result<(Scheme, f64)> {
    if settings.noise != Noise::White {
        let accepted = "\"white\", for first_loss";
        return Err(Error::invalid(
            "monte_carlo.noise",
            "band-limited",
            accepted,
        ));
    }
    let frequency = highest_frequency(oscillator, initial);
    let scheme = match settings.scheme {
        // Located at any damping.
        Scheme::Auto => Scheme::Splitting42,
        scheme => resolve(scheme, settings.noise, oscillator.zeta(), frequency)?,
    };
    if !scheme.locates_crossings() {
        let accepted = "a scheme that locates the loss of contact, as \"splitting_4_2\"";
        return Err(Error::invalid(
            "monte_carlo.scheme",
            format!("\"{scheme}\""),
            accepted,
        ));
    }
    let step = match settings.step {
        Some(step) => positive("monte_carlo.step", step)?,
        None => scheme::automatic_step(scheme, oscillator, frequency),
    };
    Ok((scheme, step))
}

struct Plan<'a> {
    paths: Paths,
    count: u64,
    times: &'a [f64],
    end: f64,
    steps: u64,
    step: f64,
    scheme: Scheme,
    coefficients: Coefficients,
}

impl<'a> Plan<'a> {
    fn new(
        oscillator: &Oscillator,
        initial: &Initial,
        times: &'a [f64],
        settings: &EnsembleSettings,
    ) -> Result<Self> {
        let contact = oscillator.contact();
        let Some(loss) = contact.loss_point() else {
            let accepted = "a law that can lose contact, for first_loss";
            return Err(Error::invalid(
                "oscillator.contact",
                contact.name(),
                accepted,
            ));
        };
        if settings.paths < 2 {
            let accepted = "at least 2, so that there is a standard error";
            return Err(Error::invalid(
                "monte_carlo.paths",
                settings.paths,
                accepted,
            ));
        }
        let mut end = 0.0;
        for &time in times {
            if !(time.is_finite() && time >= end) {
                let accepted = "ascending finite times >= 0";
                return Err(Error::invalid("outputs.first_loss", time, accepted));
            }
            end = time;
        }
        let (scheme, step) = first_loss_scheme_and_step(oscillator, initial, settings)?;
        let (steps, step) = equal_steps(end, step)?;
        let paths = Paths::new(
            oscillator,
            initial,
            settings.seed,
            settings.noise,
            scheme,
            step,
        )?;
        Ok(Self {
            paths: paths.given_above(loss),
            count: settings.paths,
            times,
            end,
            steps,
            step,
            scheme,
            coefficients: Coefficients::new(
                scheme,
                oscillator,
                step,
                highest_frequency(oscillator, initial),
            ),
        })
    }
}

/// First losses in the intervals that end at the times asked for, and time in contact.
struct LossSums {
    lost: Vec<f64>,
    time: f64,
    time_square: f64,
}

impl LossSums {
    fn new(plan: &Plan) -> Self {
        Self {
            lost: vec![0.0; plan.times.len()],
            time: 0.0,
            time_square: 0.0,
        }
    }

    fn push(&mut self, plan: &Plan, first: f64) {
        let interval = plan.times.partition_point(|time| *time < first);
        if let Some(lost) = self.lost.get_mut(interval) {
            *lost += 1.0;
        }
        let time = first.min(plan.end);
        self.time += time;
        self.time_square += time * time;
    }

    fn add(&mut self, more: &Self) {
        for (a, b) in self.lost.iter_mut().zip(&more.lost) {
            *a += b;
        }
        self.time += more.time;
        self.time_square += more.time_square;
    }
}

/// Notes the first loss of each lane.
struct First([f64; LANES]);

impl Watch for First {
    fn cross(&mut self, lane: usize, lost: bool, time: f64, _: f64) {
        if lost {
            self.0[lane] = self.0[lane].min(time);
        }
    }
}

/// The ensemble, to be run once the contact law is known.
struct Survive<'a, 'b> {
    plan: &'a Plan<'b>,
    progress: &'a Progress<'a>,
}

impl WithLaw for Survive<'_, '_> {
    type Output = LossSums;

    fn with<L: Law>(self, law: L) -> LossSums {
        let plan = self.plan;
        let per_task = plan.count.div_ceil(BLOCK).div_ceil(TASKS) * BLOCK;
        let tasks: Vec<Range<u64>> = (0..plan.count.div_ceil(per_task))
            .map(|task| task * per_task..((task + 1) * per_task).min(plan.count))
            .collect();
        let parts: Vec<LossSums> = tasks
            .into_par_iter()
            .map(|paths| {
                let mut sums = LossSums::new(plan);
                for first in paths.clone().step_by(LANES) {
                    if self.progress.late() {
                        break;
                    }
                    let lanes = (LANES as u64).min(paths.end - first);
                    let times = pulp::Arch::new().dispatch(Group { law, plan, first });
                    for time in &times[..lanes as usize] {
                        sums.push(plan, *time);
                    }
                    self.progress.add(lanes);
                }
                sums
            })
            .collect();
        let mut total = LossSums::new(plan);
        for part in &parts {
            total.add(part);
        }
        total
    }
}

/// The first losses of [`LANES`] paths; infinite where there is none.
struct Group<'a, 'b, L> {
    law: L,
    plan: &'a Plan<'b>,
    first: u64,
}

impl<L: Law> pulp::WithSimd for Group<'_, '_, L> {
    type Output = [f64; LANES];

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> [f64; LANES] {
        let mut group = self.plan.paths.group(self.first);
        let mut first = First([f64::INFINITY; LANES]);
        for lane in 0..LANES {
            if group.q[lane] < self.law.loss() {
                first.0[lane] = 0.0;
            }
        }
        // In pieces, so that a group whose paths have all been lost can stop.
        let (mut done, piece) = (0, 64);
        while done < self.plan.steps && first.0.iter().any(|time| time.is_infinite()) {
            let steps = piece.min(self.plan.steps - done);
            let now = done as f64 * self.plan.step;
            let coefficients = &self.plan.coefficients;
            coefficients.advance(self.law, &mut group, steps, now, &mut first);
            done += steps;
        }
        first.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::ContactLaw;

    fn quiet(_: f64) {}

    #[test]
    fn contact_survives_at_first_as_rice_s_rate_says() {
        // Given contact, the first losses come at the rate nu/P(contact); they thin out as the paths
        // without losses are the calm ones.
        let it = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
        let settings = EnsembleSettings {
            paths: 200_000,
            ..EnsembleSettings::default()
        };
        let times = [0.25, 0.5, 5.0, 50.0, 200.0];
        let got = first_loss(&it, &Initial::Stationary, &times, &settings, &quiet).unwrap();
        let rate = 0.036_466_36 / (1.0 - 0.072_455_6);
        for (time, survival) in times.iter().zip(&got.survival) {
            println!("survival to {time}: {survival}");
        }
        println!(
            "density {} {}, rate of losses {rate:.6}; mean time {}",
            got.density[0], got.density[1], got.mean_time
        );
        let z = (got.density[0].value - rate) / got.density[0].error;
        assert!(z.abs() < 4.0, "{z}");
        assert!(got.survival.windows(2).all(|s| s[1].value <= s[0].value));
        // The mean time is the integral of the survival: bracketed by its step functions.
        let (mut low, mut high, mut before, mut start) = (0.0, 0.0, 1.0, 0.0);
        for (time, s) in times.iter().zip(&got.survival) {
            low += s.value * (time - start);
            high += before * (time - start);
            (before, start) = (s.value, *time);
        }
        assert!(got.mean_time.value > low && got.mean_time.value < high);
    }

    #[test]
    fn the_same_survivors_with_any_scheme_that_locates_the_loss() {
        let it = Oscillator::new(ContactLaw::Hertz, 0.05, 2e-2).unwrap();
        let survival = |scheme, step, paths| {
            let settings = EnsembleSettings {
                paths,
                scheme,
                step,
                ..EnsembleSettings::default()
            };
            let got = first_loss(&it, &Initial::Rest, &[10.0, 20.0], &settings, &quiet).unwrap();
            [got.survival[0], got.survival[1]]
        };
        let split = survival(Scheme::Splitting42, None, 100_000);
        let fine = survival(Scheme::Baoab, Some(0.01), 30_000);
        for (a, b) in split.iter().zip(&fine) {
            let z = (a.value - b.value) / a.error.hypot(b.error);
            println!("splitting {a}, BAOAB {b}, {z:.2} standard errors");
            assert!(z.abs() < 4.0);
        }
    }

    #[test]
    fn a_law_without_loss_and_a_blind_scheme_are_refused() {
        let linear = Oscillator::new(ContactLaw::Linear, 0.05, 2e-2).unwrap();
        let hertz = Oscillator::new(ContactLaw::Hertz, 0.05, 2e-2).unwrap();
        let blind = EnsembleSettings {
            scheme: Scheme::ExponentialHeun,
            ..EnsembleSettings::default()
        };
        for (it, settings, key) in [
            (&linear, EnsembleSettings::default(), "oscillator.contact"),
            (&hertz, blind, "monte_carlo.scheme"),
        ] {
            let error = first_loss(it, &Initial::Rest, &[1.0], &settings, &quiet).unwrap_err();
            assert!(error.to_string().contains(key), "{error}");
        }
    }
}
