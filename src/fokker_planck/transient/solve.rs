//! A transient from its recipe.

use super::begun::begun;
use super::error_estimate::Errors;
use super::ladder;
use super::law;
use super::propagator;
use super::recipe::{Recipe, Rung};
use super::report::Transient;
use super::run::{Run, Task};
use crate::error::{Error, Result, ascending};
use crate::fokker_planck::adaptive::{self, Next, Question, Stop};
use crate::fokker_planck::budget::{Cost, Limits};
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::mesh::Mesh;
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
    let (recipe, times) = Recipe::lasting(oscillator, phases, settings)?;
    let question = (oscillator, &Initial::Stationary);
    single(&recipe, question, &times, settings)
}

/// The rung of a recipe at which its tolerance is expected.
fn single(
    recipe: &Recipe,
    (oscillator, initial): (&Oscillator, &Initial),
    times: &[f64],
    settings: &Settings,
) -> Result<Vec<Moments>> {
    let task = Task {
        oscillator,
        initial,
        times,
        density_times: &[],
        recipe,
        limits: &settings.limits(),
        law: None,
        begun: None,
    };
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
        (oscillator, initial): (&Oscillator, &Initial),
        (times, density_times): (&[f64], &[f64]),
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Transient> {
        let late = || limits.in_time(|| "the stationary law was not found".into());
        let task = Task {
            oscillator,
            initial,
            times,
            density_times,
            recipe: self,
            limits,
            law: None,
            begun: None,
        };
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
        if self.layout.drift == Drift::Upwind {
            let asked = (&self.name()[..], self.is_free());
            return adaptive::pursue(Upwind::new(task)?, asked, limits, progress);
        }
        ladder::climbed(&task, progress)
    }
}

/// How far ahead the relaxation of upwind drift with backward Euler is: c of the energy, of diffusion
/// along q, |v| dq/2 beside T/(2 zeta) where friction rules, and of steps dt, which damp an oscillation by
/// dt/2 beside zeta.
fn ahead(task: &Task, mesh: &Mesh) -> f64 {
    let (zeta, sigma) = (task.oscillator.zeta(), task.oscillator.temperature().sqrt());
    let width = mesh.q.at(mesh.q.locate(0.0)).1;
    let step = propagator::euler_step(mesh, task.recipe.step);
    propagator::upwind_excess(task.oscillator, mesh)
        + 0.8 * zeta * width / sigma
        + 0.5 * step.min(longest_interval(task.times)) / zeta
}

/// Upwind drift: a run on half the cells and one on all of them, and an error estimate that holds how far ahead its
/// relaxation is.
struct Upwind<'a> {
    task: Task<'a>,
    fine_rung: Rung,
    /// Half the cells take half the step of the scene, or both runs would err alike.
    halved: Rung,
    excess: f64,
    /// Output times with eight before each: from t/(1 + c) to t, to look for the largest change.
    times: Vec<f64>,
    coarse: Option<Run>,
    fine: Option<(Run, Errors)>,
}

impl<'a> Upwind<'a> {
    fn new(task: Task<'a>) -> Result<Self> {
        let recipe = task.recipe;
        let fine_rung = task.rung(recipe.expected)?;
        let excess = ahead(&task, &fine_rung.mesh(task.oscillator)?);
        let mut times: Vec<f64> = task.times.to_vec();
        times.extend(task.times.iter().flat_map(|t| {
            (0..8).map(move |k| {
                let slowest = t / (1.0 + excess);
                slowest + (t - slowest) * f64::from(k) / 8.0
            })
        }));
        times.sort_by(f64::total_cmp);
        times.dedup();
        let longest = longest_interval(task.times);
        let halved = Rung {
            step: recipe.step.map(|step| 0.5 * step.min(longest)),
            layout: fine_rung.layout.refined(0.5),
            ..fine_rung.clone()
        };
        Ok(Self {
            task,
            fine_rung,
            halved,
            excess,
            times,
            coarse: None,
            fine: None,
        })
    }

    /// The error estimates of the fine run, whose extra outputs they take away.
    fn errors(&self, fine: &mut Run, coarse: &Run) -> Errors {
        let excess = self.excess;
        let all: Vec<(f64, Moments)> = fine.outputs.iter().map(|o| (o.t, o.moments)).collect();
        fine.outputs.retain(|o| self.task.times.contains(&o.t));
        // First order: the fine run errs as much as it differs from one on half the cells; twice, to be safe.
        let mut errors = Errors::between(&self.task, fine, coarse, 2.0);
        // Where numbers diffuse more than physics the phase of the motion is lost too: from crest to trough.
        let phase = if excess > 1.0 { 2.0 } else { 1.0 };
        let outputs = self.task.times.iter().zip(&mut errors.space);
        for ((t, space), now) in outputs.zip(&fine.outputs) {
            let window = all
                .iter()
                .filter(|(s, _)| *s >= t / (1.0 + excess) * (1.0 - 1e-12) && s <= t);
            let mut change = [0.0_f64; 11];
            for (_, earlier) in window {
                let pairs = earlier.named().into_iter().zip(now.moments.named());
                for (change, ((_, earlier), (_, now))) in change.iter_mut().zip(pairs) {
                    if let (Some(earlier), Some(now)) = (earlier, now) {
                        *change = change.max((earlier.value - now.value).abs());
                    }
                }
            }
            for (error, change) in space.iter_mut().zip(change) {
                *error = phase * (*error + change);
            }
        }
        errors
    }
}

impl Question for Upwind<'_> {
    type Answer = Transient;

    fn ratio(&self) -> Option<f64> {
        let (run, errors) = self.fine.as_ref()?;
        Some(errors.worst(run).0 / self.task.recipe.tolerance)
    }

    fn next(&mut self) -> Result<Next> {
        if self.fine.is_some() {
            let why = "upwind drift is of first order, and no affordable mesh would do";
            return Ok(Next::stop(why));
        }
        let fine = self.task.work(&self.fine_rung, &self.times)?;
        if self.coarse.is_some() {
            return Ok(Next::run(fine));
        }
        let now = self.task.work(&self.halved, &self.times)?;
        Ok(Next::Run {
            now,
            then: Some(fine),
        })
    }

    fn run(&mut self, progress: &(dyn Fn(f64) + Sync)) -> Result<()> {
        let Some(coarse) = &self.coarse else {
            let coarse = self.task.run(&self.halved, self.task.times, progress)?;
            self.coarse = Some(coarse);
            return Ok(());
        };
        let mut fine = self.task.run(&self.fine_rung, &self.times, progress)?;
        let errors = self.errors(&mut fine, coarse);
        self.fine = Some((fine, errors));
        Ok(())
    }

    fn answer(self, stop: Stop) -> Option<Transient> {
        let (coarse, (fine, errors)) = self.coarse.zip(self.fine)?;
        let excess = self.excess;
        let warning = format!(
            "upwind drift relaxes the energy 1 + c = {:.2} times too fast on this mesh (c = {excess:.3}: \
             numerical over physical diffusion); its error estimates say so. Use drift = 8 for an answer",
            1.0 + excess
        );
        let report = self
            .task
            .report(fine, &coarse, &errors, stop, vec![warning]);
        Some(report)
    }
}

/// The longest time without an output, from 0 on.
fn longest_interval(times: &[f64]) -> f64 {
    let before = std::iter::once(&0.0).chain(times);
    let intervals = times.iter().zip(before).map(|(b, a)| b - a);
    let longest = intervals.fold(0.0, f64::max);
    if longest > 0.0 { longest } else { 1.0 }
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
