//! A transient from its recipe.

use super::begun::begun;
use super::ladder;
use super::law;
use super::recipe::Recipe;
use super::report::Transient;
use super::run::Task;
use super::upwind;
use crate::error::{Error, Result, ascending};
use crate::fokker_planck::budget::{Cost, Limits};
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::settings::Settings;
use crate::initial::Initial;
use crate::moments::Moments;
use crate::oscillator::Oscillator;

/// Solves (17) from `initial` through `times` (ascending); densities are kept at `density_times`, a
/// part of them. `progress` is told the part done, 0 to 1.
///
/// A ladder of runs, each finer in cells, steps and domain than the one before, ends with the first whose error
/// estimates are all within the tolerance, or at a limit; what was not reached is in `shortfall`. The estimates come from
/// the differences of the last three rungs, of which no order of convergence is believed. For upwind
/// drift, where no two affordable meshes converge, the error adds the change over
/// the time t/(1 + c) to t by which its relaxation is ahead, and nothing is refined.
///
/// Mass has the normalisation 1; relative entropy and distance to the stationary law come with the
/// difference of the two runs. These and the lowest density, a diagnostic, are not bound by the
/// tolerance: they say how good the density is, not what it says.
///
/// # Errors
/// [`Error::Invalid`] and [`Error::Mesh`] for an initial condition or cells of the scene that cannot work,
/// [`Error::Unresolved`] for one that no mesh of the program's choice resolves, [`Error::Limit`] when
/// `max_seconds` is reached before there is any answer.
///
/// [`Error::Invalid`]: crate::Error::Invalid
/// [`Error::Mesh`]: crate::Error::Mesh
/// [`Error::Unresolved`]: crate::Error::Unresolved
/// [`Error::Limit`]: crate::Error::Limit
pub fn transient(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    density_times: &[f64],
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Transient> {
    settings.check()?;
    initial.check()?;
    ascending("outputs.moments_at", "times", times)?;
    if times.is_empty() {
        let accepted = "at least one time";
        return Err(Error::invalid("outputs.moments_at", "[]", accepted));
    }
    if let Some(t) = density_times.iter().find(|t| !times.contains(t)) {
        let accepted = "times of the moments too";
        return Err(Error::invalid("outputs.density_at", t, accepted));
    }
    let recipe = Recipe::of(oscillator, initial, times, settings)?;
    let (question, times) = ((oscillator, initial), (times, density_times));
    recipe.solve(question, times, &settings.limits(), progress)
}

/// The moments of one run with the cells, the step and the domain that `settings` fix or leave to the first guess, without
/// error estimates: what an answer costs without them (benches/tolerance.rs).
///
/// # Errors
/// Those of [`transient`].
pub fn uncertified(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &Settings,
) -> Result<Vec<Moments>> {
    let recipe = Recipe::of(oscillator, initial, times, settings)?;
    single(&recipe, (oscillator, initial), times, settings)
}

/// The same of the law that lasts under the drive of `settings`, at so many phases; as there its multipliers are found too.
///
/// # Errors
/// Those of [`crate::fokker_planck::periodic()`].
pub fn uncertified_periodic(
    oscillator: &Oscillator,
    phases: usize,
    settings: &Settings,
) -> Result<Vec<Moments>> {
    let (recipe, times) = Recipe::lasting(oscillator, (phases, 1), settings)?;
    let question = (oscillator, &Initial::Stationary);
    single(&recipe, question, &times, settings)
}

/// The rung of a recipe at which its tolerance is expected.
fn single(
    recipe: &Recipe,
    question: (&Oscillator, &Initial),
    times: &[f64],
    settings: &Settings,
) -> Result<Vec<Moments>> {
    let limits = settings.limits();
    let task = recipe.task(question, (times, &[]), &limits);
    let run = task.once(&task.rung(recipe.expected)?, times, &|_| ())?;
    Ok(run.outputs.iter().map(|it| it.moments).collect())
}

/// What [`transient`] will take.
///
/// # Errors
/// Those of [`transient`] that are known beforehand.
pub fn transient_cost(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &Settings,
) -> Result<(Cost, String)> {
    let recipe = Recipe::of(oscillator, initial, times, settings)?;
    Ok((recipe.cost, recipe.words()))
}

impl Recipe {
    /// Method and reason.
    pub(crate) fn words(&self) -> String {
        format!("{}; {}", self.name(), self.reason)
    }

    /// As [`transient`], by a recipe made before for the same question.
    pub(crate) fn solve(
        &self,
        question: (&Oscillator, &Initial),
        times: (&[f64], &[f64]),
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Transient> {
        let late = limits.late("the stationary law");
        let task = self.task(question, times, limits);
        let law = law::law(&task, &late)?;
        let task = Task {
            law: law.as_ref(),
            ..task
        };
        let begun = begun(&task)?;
        let task = Task {
            begun: begun.as_deref(),
            ..task
        };
        self.climb(&task, progress)
    }

    /// The same for the moments alone: a stationary law without a closed form is not solved for.
    pub(crate) fn course(
        &self,
        question: (&Oscillator, &Initial),
        times: &[f64],
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Transient> {
        if *question.1 == Initial::Stationary {
            return self.solve(question, (times, &[]), limits, progress);
        }
        self.climb(&self.task(question, (times, &[]), limits), progress)
    }

    /// What is to be computed, without a law or what it has done.
    fn task<'a>(
        &'a self,
        (oscillator, initial): (&'a Oscillator, &'a Initial),
        (times, density_times): (&'a [f64], &'a [f64]),
        limits: &'a Limits,
    ) -> Task<'a> {
        Task {
            oscillator,
            initial,
            times,
            density_times,
            recipe: self,
            limits,
            law: None,
            begun: None,
        }
    }

    fn climb(&self, task: &Task, progress: &(dyn Fn(f64) + Sync)) -> Result<Transient> {
        if self.layout.drift == Drift::Upwind {
            return upwind::refined(*task, progress);
        }
        ladder::climbed(task, progress)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::ContactLaw;
    use crate::fokker_planck::domain::tests::CLOSED;
    use crate::oscillator::displacement_law::tests::NORMALISED;

    #[test]
    fn a_transient_normalises_the_stationary_law_once_and_closes_each_domain_once() {
        let wide = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
        let narrow = Initial::gaussian([0.5, 0.2], [0.05, 0.05]).unwrap();
        for (zeta, initial) in [
            (0.005, wide),
            (0.05, narrow),
            (3.0, wide),
            (0.05, Initial::Rest),
        ] {
            let oscillator = Oscillator::new(ContactLaw::Hertz, zeta, 0.4 * zeta).unwrap();
            let settings = Settings::default();
            // Rungs are run on any thread, and the counters are those of one.
            let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
            let (it, laws, domains) = one.unwrap().install(|| {
                NORMALISED.set(0);
                CLOSED.take();
                let it = transient(&oscillator, &initial, &[0.5, 2.0], &[], &settings, &|_| ());
                (it.unwrap(), NORMALISED.get(), CLOSED.take())
            });
            println!(
                "zeta = {zeta}, {}: {laws} laws, {} domains",
                it.method.name,
                domains.len()
            );
            assert_eq!(laws, 1);
            for (k, domain) in domains.iter().enumerate() {
                assert!(!domains[..k].contains(domain), "{domain:?} twice");
            }
        }
    }
}
