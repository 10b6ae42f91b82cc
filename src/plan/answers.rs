//! What each recipe answers, put among the results.

use super::Plan;
use super::joins::{reached, welch};
use super::recipes::Recipe;
use super::stage::Part;
use crate::budget::Limits;
use crate::error::{Error, Result};
use crate::estimate::Estimate;
use crate::fokker_planck::{self, StationaryState, flight_law, impact_law};
use crate::initial::Initial;
use crate::moments::Moment;
use crate::monte_carlo::{FirstLosses, Records, Series};
use crate::oscillator::Oscillator;
use crate::results::in_unit::InUnit;
use crate::results::{Numbers, Results, SpectrumNumbers};
use crate::scene::SpectrumRequest;
use crate::stationary::Stationary;

/// A stage of a plan that is run, within its limits; `progress` is told the part done, 0 to 1.
pub(super) struct Running<'a> {
    pub(super) plan: &'a Plan,
    pub(super) part: Part,
    pub(super) limits: Limits,
    pub(super) progress: &'a (dyn Fn(f64) + Sync),
}

impl Running<'_> {
    /// Solves, or samples, and puts the answer among the results in the unit of time of the scene.
    pub(super) fn answer(&self, recipe: &Recipe, results: &mut Results) -> Result<()> {
        let (limits, progress, stage) = (&self.limits, self.progress, self.part.name());
        let (problem, clock) = (self.problem(), &self.plan.clock);
        let oscillator = problem.0;
        match recipe {
            Recipe::ClosedForm => self.closed_form(results)?,
            Recipe::Stationary(recipe) => self.solved_law(recipe, results)?,
            Recipe::Transient(recipe) => self.transient(recipe, results)?,
            Recipe::Reach(recipe, quantity, law) => {
                let stationary = |part: f64| self.level(*quantity, law.as_ref(), part);
                let it = recipe.solve(problem, &stationary, limits, progress)?;
                results.warn(&it.warnings);
                results.fall_short(stage, it.shortfall.as_ref());
                results.reach = Some(it.in_unit(clock));
            }
            Recipe::Periodic(recipe) => {
                let it = recipe.solve(oscillator, limits, progress)?;
                results.warn(&it.warnings);
                results.fall_short(stage, it.shortfall.as_ref());
                results.periodic = Some(it.in_unit(clock));
            }
            Recipe::Response(recipe) => {
                // Its frequencies are circular ones, whatever the unit of times.
                let it = recipe.solve(oscillator, limits, progress)?;
                results.warn(&it.warnings);
                results.fall_short(stage, it.shortfall.as_ref());
                results.response = Some(it);
            }
            Recipe::Steady(recipe) => {
                let it = recipe.solve(oscillator, limits, progress)?;
                results.warn(&it.warnings);
                results.fall_short(stage, it.shortfall.as_ref());
                results.steady = Some(it.in_unit(clock));
            }
            Recipe::DecayRates(recipe) => {
                let it = recipe.solve(oscillator, limits, progress)?;
                results.fall_short(stage, it.shortfall.as_ref());
                results.decay_rates = Some(it.in_unit(clock));
            }
            Recipe::Spectrum(recipe, asked) => {
                let mut omegas = welch(asked.until)?.omega();
                omegas.retain(|omega| *omega <= asked.until * (1.0 + 1e-9));
                let it = recipe.solve(oscillator, asked.quantity, &omegas, limits, progress)?;
                results.fall_short(stage, it.shortfall.as_ref());
                // Sampling has the frequencies of its segments alone.
                let it = match self.plan.scene.monte_carlo {
                    Some(_) => it,
                    None => it.filled(),
                };
                results.spectrum = Some(SpectrumNumbers::of(oscillator, it));
            }
            Recipe::FirstPassage(recipe) => {
                let it = recipe.solve(oscillator, problem.1, limits, progress)?;
                results.fall_short(stage, it.shortfall.as_ref());
                let begins = it.survival.first().map_or(1.0, |it| it.value);
                if begins < 0.5 {
                    results.warn(&[format!(
                        "{stage}: {:.0} % of the initial condition lies beyond what is to be passed, and counts as passed at t = 0; \
                         the rate is that of motions which begin before it",
                        100.0 * (1.0 - begins)
                    )]);
                }
                let answer = match self.part {
                    Part::FirstLoss => &mut results.first_loss,
                    _ => &mut results.first_passage,
                };
                *answer = Some(it.in_unit(clock));
            }
            Recipe::FirstLosses(recipe) => self.first_losses(recipe, results)?,
            Recipe::Series(recipe, asked) => self.series((recipe, asked), results)?,
            Recipe::Ensemble(recipe) => {
                let it = recipe.run(problem, limits.clone(), progress)?;
                results.warn(&it.warnings);
                results.fall_short(stage, it.shortfall.as_ref());
                results.monte_carlo = Some(it.in_unit(clock));
            }
            Recipe::Records(recipe) => self.records(recipe, results)?,
        }
        Ok(())
    }

    fn problem(&self) -> (&Oscillator, &Initial) {
        let scene = &self.plan.scene;
        (&scene.oscillator, &scene.initial)
    }

    fn closed_form(&self, results: &mut Results) -> Result<()> {
        let (plan, clock) = (self.plan, &self.plan.clock);
        let oscillator = self.problem().0;
        let law = Stationary::of(oscillator)?;
        if self.part != Part::Crossings {
            let asked = plan.scene.outputs.moments.as_deref();
            let numbers = Numbers::stationary(&law).asked(asked);
            results.stationary = Some(numbers.in_unit(clock));
        } else if let Some(window) = plan.scene.crossings_window() {
            results.crossings = Some(Numbers::crossings(&law, window).in_unit(clock));
            if plan.knows_flights() {
                let flights = flight_law(oscillator)?;
                let shortfall = flights.shortfall(plan.settings.tolerance);
                results.fall_short(self.part.name(), shortfall.as_ref());
                results.flights = Some(flights.in_unit(clock));
                results.impacts = Some(impact_law(oscillator)?.in_unit(clock));
            }
        }
        Ok(())
    }

    fn solved_law(&self, recipe: &StationaryState, results: &mut Results) -> Result<()> {
        let (scene, clock) = (&self.plan.scene, &self.plan.clock);
        if results.solved.is_none() {
            let it = recipe.solve(&scene.oscillator, &self.limits, self.progress)?;
            results.fall_short(self.part.name(), it.shortfall.as_ref());
            results.solved = Some(it);
        }
        let Some(law) = &results.solved else {
            return Ok(());
        };
        if self.part != Part::Crossings {
            let numbers = Numbers::solved(law).asked(scene.outputs.moments.as_deref());
            results.stationary = Some(numbers.in_unit(clock));
        } else if let Some(window) = scene.crossings_window() {
            results.crossings = Some(Numbers::flux(law, window).in_unit(clock));
        }
        Ok(())
    }

    fn transient(&self, recipe: &fokker_planck::Recipe, results: &mut Results) -> Result<()> {
        let outputs = &self.plan.scene.outputs;
        let density_at = outputs.density_at.list();
        // Who asks for densities alone gets the numbers of these times.
        let moments_at = if outputs.moments_at.is_empty() {
            density_at.clone()
        } else {
            outputs.moments_at.list()
        };
        let times = (&self.plan.times()[..], &density_at[..]);
        let mut it = recipe.solve(self.problem(), times, &self.limits, self.progress)?;
        it.keep_times(&moments_at);
        results.warn(&it.warnings);
        results.fall_short(self.part.name(), it.shortfall.as_ref());
        results.transient = Some(it.in_unit(&self.plan.clock));
        Ok(())
    }

    /// The stationary value of a moment, by the closed form or by the law that is solved for, to this part of its tolerance.
    fn level(
        &self,
        quantity: Moment,
        law: Option<&StationaryState>,
        part: f64,
    ) -> Result<Estimate> {
        let oscillator = self.problem().0;
        let Some(law) = law else {
            return reached(quantity, &Stationary::of(oscillator)?.moments());
        };
        let it = law.finer(part).solve(oscillator, &self.limits, &|_| {})?;
        // What is not known from 0 is no 0.
        reached(quantity, &it.moments).map_err(|error| match &it.shortfall {
            Some(why) => Error::linear("the stationary level", why.to_string()),
            None => error,
        })
    }

    fn first_losses(&self, recipe: &FirstLosses, results: &mut Results) -> Result<()> {
        let clock = &self.plan.clock;
        let (solved, answer) = match self.part {
            Part::FirstLossPaths => (&results.first_loss, &mut results.first_loss_paths),
            _ => (&results.first_passage, &mut results.first_passage_paths),
        };
        // Paths alone are seen at even times.
        let times: Vec<f64> = match solved {
            Some(it) => it.times.iter().map(|t| clock.dimensionless(*t)).collect(),
            None => (0..=16)
                .map(|k| f64::from(k) / 16.0 * recipe.until)
                .collect(),
        };
        let limits = self.limits.clone();
        let it = recipe.run(self.problem(), &times, limits, self.progress)?;
        let warnings = it.warnings.clone();
        *answer = Some(it.in_unit(clock));
        results.warn(&warnings);
        Ok(())
    }

    /// The spectrum by sampling, beside that of the resolvent.
    fn series(
        &self,
        (recipe, asked): (&Series, &SpectrumRequest),
        results: &mut Results,
    ) -> Result<()> {
        let Some(it) = &mut results.spectrum else {
            return Ok(());
        };
        let oscillator = self.problem().0;
        let (welch, limits) = (welch(asked.until)?, self.limits.clone());
        let averages = it.sample(oscillator, &welch, recipe, limits, self.progress)?;
        it.put_in(&self.plan.clock);
        results.warn(&recipe.warnings(oscillator, averages));
        Ok(())
    }

    fn records(&self, recipe: &Records, results: &mut Results) -> Result<()> {
        let it = recipe.run(self.problem().0, self.limits.clone(), self.progress)?;
        results.warn(&it.warnings);
        let losses = it.crossings.as_ref().map(|it| it.losses);
        if self.plan.scene.outputs.crossings.is_some() && losses == Some(0) {
            results.warn(&[format!(
                "the records saw no loss of contact in a time of {:.1e}: its rate is known without sampling alone",
                it.duration
            )]);
        }
        results.records = Some(it.in_unit(&self.plan.clock));
        Ok(())
    }
}
