//! A plan is run: stage after stage, each within the time that is left.

use super::Plan;
use super::answers::Running;
use super::recipes::Recipe;
use super::stage::{Part, Stage};
use super::watch::{Nobody, Watch};
use crate::budget::{Limits, StopFlag};
use crate::error::{Error, Result};
use crate::estimate::{Shortfall, Warning};
use crate::format::{num, seconds};
use crate::results::in_unit::InUnit;
use crate::results::{Results, peak_memory};
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
            results.run.wall_seconds = spent();
            let begin = Instant::now();
            let told = (results.run.warnings.len(), results.shortfalls.len());
            let computed = self.compute((stage, recipe.as_ref()), results, (watch, &stop));
            // What is known already is an answer, and is kept as one.
            if stop.raised() && computed.is_err() {
                let what = format!("the {} stage had not ended", part.name());
                return Err(Error::Stopped { what });
            }
            match computed {
                Ok(()) => {}
                Err(error) if error.is_unanswered() => {
                    results.run.warnings.truncate(told.0);
                    results.shortfalls.truncate(told.1);
                    let shortfall = Shortfall::unanswered(&error);
                    results.fall_short(part.name(), Some(&shortfall));
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

    /// Computes a stage within its share of the time.
    fn compute(
        &self,
        (stage, recipe): (&Stage, Option<&Recipe>),
        results: &mut Results,
        (watch, stop): (&dyn Watch, &StopFlag),
    ) -> Result<()> {
        if let Some(refusal) = &stage.refusal {
            return Err(refusal.unanswered());
        }
        let (part, limit) = (stage.part, self.scene.accuracy.max_seconds);
        let spent = results.run.wall_seconds;
        // What little is left to do is done: a stage before it may have overrun its part of the time.
        let late = spent > limit && spent + RESERVED * stage.cost.seconds > OVERRUN * limit;
        let Some(recipe) = recipe.filter(|_| !late) else {
            let what = format!("the {} stage had not begun", part.name());
            return Err(Error::limit("accuracy.max_seconds", num(limit), what));
        };
        watch.begins(part);
        let share = self.share(part, spent);
        let limits = Limits::from_now(share, self.settings.max_memory);
        let running = Running {
            plan: self,
            part,
            limits: limits.share_of(self.settings.max_seconds, stop.clone()),
            progress: &|fraction| watch.progress(part, fraction),
        };
        // A stage knows only its share of the time.
        running
            .answer(recipe, results)
            .map_err(|error| match self.as_typed(error) {
                Error::Limit {
                    key: key @ "accuracy.max_seconds",
                    limit: most,
                    what,
                } if share < 0.95 * limit => {
                    let share = seconds(share);
                    Error::limit(key, most, format!("{what}; other stages leave it {share}"))
                }
                other => other,
            })
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
