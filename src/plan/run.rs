//! A plan is run: stage after stage, each within the time that is left.

use super::Plan;
use super::joins::{reached, welch};
use super::recipes::Recipe;
use super::stage::{Part, Stage};
use super::watch::{Nobody, Watch};
use crate::budget::{Limits, StopFlag};
use crate::error::{Error, Result};
use crate::estimate::{Shortfall, Warning};
use crate::fokker_planck;
use crate::format::{num, seconds};
use crate::results::in_unit::InUnit;
use crate::results::{Numbers, Results, SpectrumNumbers, peak_memory};
use crate::scene::Scene;
use crate::stationary::Stationary;
use std::time::Instant;

/// Seconds kept for the stages still to come, over those foreseen of them, which are within three of what it takes;
/// at least a tenth of what is left, by which a stage may overrun its own limit, and at most half.
const RESERVED: f64 = 3.0;

/// A stage may begin after the limit of time if it is foreseen to end, RESERVED times, within so many times the limit.
const OVERRUN: f64 = 1.3;

impl Plan {
    /// Seconds of those left that are kept for the stages after this one.
    fn reserved(&self, part: Part, left: f64) -> f64 {
        let later = self.stages.iter().skip_while(|it| it.part != part).skip(1);
        let later = later.filter(|it| it.refusal.is_none());
        let seconds: Vec<f64> = later.map(|it| it.cost.seconds).collect();
        if seconds.is_empty() || left <= 0.0 {
            return 0.0;
        }
        (RESERVED * seconds.iter().sum::<f64>()).clamp(0.1 * left, 0.5 * left)
    }

    /// Seconds that a stage may take after those spent.
    fn share(&self, part: Part, spent: f64) -> f64 {
        let most = self.settings.max_seconds;
        let own = self.stages.iter().find(|it| it.part == part);
        let least = RESERVED * own.map_or(0.0, |it| it.cost.seconds);
        let mut left = most - spent;
        if spent + least <= OVERRUN * most {
            left = left.max(least);
        }
        left - self.reserved(part, left)
    }

    /// Whether there is what a stage adds to, or stands on.
    fn has_base(&self, part: Part, results: &Results) -> bool {
        match part {
            Part::Crossings => {
                let solved = results.solved.is_some() || !self.has(Part::Stationary);
                self.scene.oscillator.is_viscous() || solved
            }
            Part::Series => results.spectrum.is_some(),
            _ => true,
        }
    }

    #[allow(clippy::too_many_lines)] // One arm a recipe.
    fn compute(
        &self,
        (part, recipe): (Part, &Recipe),
        results: &mut Results,
        seconds: f64,
        (progress, stop): (&(dyn Fn(f64) + Sync), &StopFlag),
    ) -> Result<()> {
        let Scene {
            oscillator,
            initial,
            outputs,
            ..
        } = &self.scene;
        let (settings, clock) = (&self.settings, &self.clock);
        let limits = Limits::from_now(seconds, settings.max_memory);
        let limits = limits.share_of(settings.max_seconds, stop.clone());
        let window = self.scene.crossings_window();
        match recipe {
            Recipe::Stationary(recipe) => {
                if results.solved.is_none() {
                    let it = recipe.solve(oscillator, &limits, progress)?;
                    results.fall_short(part.name(), it.shortfall.as_ref(), true);
                    results.solved = Some(it);
                }
                if let Some(law) = &results.solved {
                    match (part, window) {
                        (Part::Crossings, Some(time)) => {
                            results.crossings = Some(Numbers::flux(law, time).in_unit(clock));
                        }
                        (Part::Crossings, None) => {}
                        _ => {
                            let numbers = Numbers::solved(law).asked(outputs.moments.as_deref());
                            results.stationary = Some(numbers.in_unit(clock));
                        }
                    }
                }
            }
            Recipe::ClosedForm => {
                let law = Stationary::of(oscillator)?;
                match (part, window) {
                    (Part::Crossings, Some(time)) => {
                        results.crossings = Some(Numbers::crossings(&law, time).in_unit(clock));
                        if self.knows_flights() {
                            let flights = fokker_planck::flight_law(oscillator)?;
                            let shortfall = flights.shortfall(settings.tolerance);
                            results.fall_short(part.name(), shortfall.as_ref(), true);
                            results.flights = Some(flights.in_unit(clock));
                            let impacts = fokker_planck::impact_law(oscillator)?;
                            results.impacts = Some(impacts.in_unit(clock));
                        }
                    }
                    (Part::Crossings, None) => {}
                    _ => {
                        let numbers = Numbers::stationary(&law).asked(outputs.moments.as_deref());
                        results.stationary = Some(numbers.in_unit(clock));
                    }
                }
            }
            Recipe::FirstPassage(recipe) => {
                let it = recipe.solve(oscillator, initial, &limits, progress)?;
                results.fall_short(part.name(), it.shortfall.as_ref(), true);
                let answer = match part {
                    Part::FirstLoss => &mut results.first_loss,
                    _ => &mut results.first_passage,
                };
                *answer = Some(it.in_unit(clock));
            }
            Recipe::FirstLosses(recipe) => {
                let (solved, answer) = match part {
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
                let it = recipe.run((oscillator, initial), &times, limits, progress)?;
                results.run.warnings.extend(it.warnings.iter().cloned());
                *answer = Some(it.in_unit(clock));
            }
            Recipe::Transient(recipe) => {
                let density_at = outputs.density_at.list();
                // Who asks for densities alone gets the numbers of these times.
                let moments_at = if outputs.moments_at.is_empty() {
                    density_at.clone()
                } else {
                    outputs.moments_at.list()
                };
                let (problem, times) = ((oscillator, initial), self.times());
                let mut it = recipe.solve(problem, (&times, &density_at), &limits, progress)?;
                keep_times(&mut it, &moments_at);
                results.warn(&it.warnings);
                results.fall_short(part.name(), it.shortfall.as_ref(), false);
                results.transient = Some(it.in_unit(clock));
            }
            Recipe::Reach(recipe, quantity, level) => {
                let stationary = match level {
                    Some(law) => {
                        let it = law.solve(oscillator, &limits, &|_| {})?;
                        // What is not known from 0 is no 0.
                        reached(*quantity, &it.moments).map_err(|error| match &it.shortfall {
                            Some(why) => Error::linear("the stationary level", why.to_string()),
                            None => error,
                        })?
                    }
                    None => reached(*quantity, &Stationary::of(oscillator)?.moments())?,
                };
                let it = recipe.solve((oscillator, initial), stationary, &limits, progress)?;
                results.warn(&it.warnings);
                results.fall_short(part.name(), it.shortfall.as_ref(), true);
                results.reach = Some(it.in_unit(clock));
            }
            Recipe::Periodic(recipe) => {
                let it = recipe.solve(oscillator, &limits, progress)?;
                results.warn(&it.warnings);
                results.fall_short(part.name(), it.shortfall.as_ref(), false);
                results.periodic = Some(it.in_unit(clock));
            }
            Recipe::Response(recipe) => {
                // Its frequencies are circular ones, whatever the unit of times.
                let it = recipe.solve(oscillator, &limits, progress)?;
                results.warn(&it.warnings);
                results.fall_short(part.name(), it.shortfall.as_ref(), false);
                results.response = Some(it);
            }
            Recipe::Steady(recipe) => {
                let it = recipe.solve(oscillator, &limits, progress)?;
                results.warn(&it.warnings);
                results.fall_short(part.name(), it.shortfall.as_ref(), true);
                results.steady = Some(it.in_unit(clock));
            }
            Recipe::DecayRates(recipe) => {
                let it = recipe.solve(oscillator, &limits, progress)?;
                results.fall_short(part.name(), it.shortfall.as_ref(), true);
                results.decay_rates = Some(it.in_unit(clock));
            }
            Recipe::Spectrum(recipe, asked) => {
                let mut omegas = welch(asked.until)?.omega();
                omegas.retain(|omega| *omega <= asked.until * (1.0 + 1e-9));
                let it = recipe.solve(oscillator, asked.quantity, &omegas, &limits, progress)?;
                results.fall_short(part.name(), it.shortfall.as_ref(), true);
                // Sampling has the frequencies of its segments alone.
                let it = match self.scene.monte_carlo {
                    Some(_) => it,
                    None => it.filled(),
                };
                results.spectrum = Some(SpectrumNumbers::of(oscillator, it));
            }
            Recipe::Series(recipe, asked) => {
                if let Some(it) = &mut results.spectrum {
                    let averages =
                        it.sample(oscillator, &welch(asked.until)?, recipe, limits, progress)?;
                    it.put_in(clock);
                    let warning = recipe.warnings(oscillator, averages);
                    results.run.warnings.extend(warning);
                }
            }
            Recipe::Ensemble(recipe) => {
                let it = recipe.run((oscillator, initial), limits, progress)?;
                results.run.warnings.extend(it.warnings.iter().cloned());
                results.fall_short(part.name(), it.shortfall.as_ref(), false);
                results.monte_carlo = Some(it.in_unit(clock));
            }
            Recipe::Records(recipe) => {
                let it = recipe.run(oscillator, limits, progress)?;
                results.run.warnings.extend(it.warnings.iter().cloned());
                let losses = it.crossings.as_ref().map(|it| it.losses);
                if outputs.crossings.is_some() && losses == Some(0) {
                    let warning = format!(
                        "the records saw no loss of contact in a time of {:.1e}: its rate is known \
                         without sampling alone",
                        it.duration
                    );
                    results.run.warnings.push(warning.into());
                }
                results.records = Some(it.in_unit(clock));
            }
        }
        Ok(())
    }

    /// Run every stage; `watch` is told as it goes. A stage that finds no answer within the limits is a shortfall of the
    /// results, and the others are run.
    ///
    /// # Errors
    /// The first error of a stage that no stage answered beside, or that is none of its limits; that of `watch`, or
    /// [`Error::Stopped`]. Results of the stages before it have been shown to `watch`.
    pub fn run(&self, watch: &dyn Watch) -> Result<Results> {
        let mut results = Results::empty(&self.given);
        self.run_on(&mut results, watch)?;
        Ok(results)
    }

    /// The same into `results`, which after an error hold the stages that have ended.
    pub(crate) fn run_on(&self, results: &mut Results, watch: &dyn Watch) -> Result<()> {
        let start = Instant::now();
        let spent = || self.planning + start.elapsed().as_secs_f64();
        let ran = self.run_stages(results, watch, &spent);
        results.run.wall_seconds = spent();
        results.run.peak_memory_bytes = peak_memory();
        ran
    }

    /// The same; `spent` are the seconds until now, those of planning among them.
    fn run_stages(
        &self,
        results: &mut Results,
        watch: &dyn Watch,
        spent: &dyn Fn() -> f64,
    ) -> Result<()> {
        results.warn(&self.given.doubts());
        let stop = watch.stop();
        let mut unanswered = None;
        for (k, (stage, recipe)) in self.stages.iter().zip(&self.recipes).enumerate() {
            let part = stage.part;
            if !self.has_base(part, results) {
                let text = format!("{}: not run: what it adds to has no answer", part.name());
                results.run.warnings.push(text.into());
                continue;
            }
            let limit = self.scene.accuracy.max_seconds;
            results.run.wall_seconds = spent();
            // What little is left to do is done: a stage before it may have overrun its part of the time.
            let end = results.run.wall_seconds + RESERVED * stage.cost.seconds;
            let late = results.run.wall_seconds > limit && end > OVERRUN * limit;
            let share = self.share(part, results.run.wall_seconds);
            let begin = Instant::now();
            let told = (results.run.warnings.len(), results.shortfalls.len());
            let progress = |fraction| watch.progress(part, fraction);
            let computed = match (&stage.refusal, recipe) {
                // As it was typed already; it speaks of no time.
                (Some(refusal), _) => Err(refusal.unanswered()),
                (None, Some(recipe)) if !late => {
                    watch.begins(part);
                    self.compute((part, recipe), results, share, (&progress, &stop))
                }
                _ => {
                    let what = format!("the {} stage had not begun", part.name());
                    Err(Error::limit("accuracy.max_seconds", num(limit), what))
                }
            };
            // What is known already is an answer, and is kept as one.
            if stop.raised() && computed.is_err() {
                let what = format!("the {} stage had not ended", part.name());
                return Err(Error::Stopped { what });
            }
            // A stage knows only its share of the time.
            let computed = computed.map_err(|error| match self.as_typed(error) {
                Error::Limit {
                    key: key @ "accuracy.max_seconds",
                    limit: most,
                    what,
                } if !late && share < 0.95 * limit => {
                    let share = seconds(share);
                    Error::limit(key, most, format!("{what}; other stages leave it {share}"))
                }
                other => other,
            });
            match computed {
                Ok(()) => {}
                Err(error) if error.is_unanswered() => {
                    results.run.warnings.truncate(told.0);
                    results.shortfalls.truncate(told.1);
                    let shortfall = Shortfall::unanswered(&error, self.scene.accuracy.tolerance);
                    results.fall_short(part.name(), Some(&shortfall), true);
                    results.run.wall_seconds = spent();
                    unanswered = unanswered.or(Some(error));
                    continue;
                }
                Err(error) => return Err(error),
            }
            // Messages speak of dimensionless times.
            for mut warning in results.run.warnings.split_off(told.0) {
                warning.put_in(&self.clock);
                results.run.warn(warning);
            }
            let shortfalls = results.shortfalls.iter_mut().skip(told.1);
            shortfalls.for_each(|(_, it)| it.put_in(&self.clock));
            if part.is_sampled() {
                results.agreement = results.agree();
                let paths = self.scene.monte_carlo.as_ref().map_or(0, |it| it.paths);
                let doubt = results.agreement.and_then(|it| it.doubt(paths));
                if let Some(doubt) = doubt {
                    results.run.warn(doubt.into());
                }
            }
            let took = begin.elapsed().as_secs_f64();
            results.run.stages.push((part.name(), took));
            results.run.wall_seconds = spent();
            results.run.peak_memory_bytes = peak_memory();
            let told = results.run.warnings.len();
            let open = unfinished(&self.stages[k + 1..]);
            results.run.warnings.extend(open);
            watch.ends(part, results)?;
            results.run.warnings.truncate(told);
            if stop.raised() {
                let what = format!("the {} stage ended early", part.name());
                return Err(Error::Stopped { what });
            }
        }
        match unanswered {
            Some(error) if results.run.stages.is_empty() => Err(error),
            _ => Ok(()),
        }
    }

    /// What is left to do after these results, as the warning that they then carry.
    pub(crate) fn left_after(&self, results: &Results) -> Option<Warning> {
        let stages = &results.run.stages;
        let ended = |it: &&Stage| stages.iter().any(|(name, _)| *name == it.part.name());
        unfinished(self.stages.iter().filter(|it| !ended(it)))
    }

    /// Run every stage, telling nobody.
    ///
    /// # Errors
    /// The first error of a stage.
    pub fn run_quietly(&self) -> Result<Results> {
        self.run(&Nobody)
    }
}

/// What results say while stages are still to come.
fn unfinished<'a>(open: impl IntoIterator<Item = &'a Stage>) -> Option<Warning> {
    let open = open.into_iter().filter(|it| it.refusal.is_none());
    let open: Vec<&str> = open.map(|it| it.part.name()).collect();
    let text = format!("unfinished: {} had not ended yet", open.join(", "));
    (!open.is_empty()).then(|| text.into())
}

/// Leave the numbers of these times only.
fn keep_times(it: &mut fokker_planck::Transient, times: &[f64]) {
    fn keep<T>(items: &mut Vec<T>, kept: &[bool]) {
        let mut kept = kept.iter();
        items.retain(|_| kept.next().copied().unwrap_or(true));
    }
    let kept: Vec<bool> = it.times.iter().map(|t| times.contains(t)).collect();
    keep(&mut it.times, &kept);
    keep(&mut it.moments, &kept);
    keep(&mut it.mass, &kept);
    keep(&mut it.lowest_density, &kept);
    keep(&mut it.negative_mass, &kept);
    keep(&mut it.relative_entropy, &kept);
    keep(&mut it.distance, &kept);
}
