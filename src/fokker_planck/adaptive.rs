//! From a tolerance to an answer, the same for every question: a run, a finer one, an error estimate from their
//! difference, and so on until that is within the tolerance, there is nothing finer, or a limit says stop.

use super::budget::{Limits, Work};
use crate::error::{Error, Result};
use crate::estimate::Shortfall;
use std::time::Instant;

/// A question that is answered by runs, each finer than the one before. What a run does between two looks at
/// [`Limits::in_time`] is short.
pub(super) trait Question {
    /// What it is called where time or memory do not suffice for a first answer.
    fn name(&self) -> String;

    /// The largest error estimate over the tolerance; None before there is an answer.
    fn ratio(&self) -> Option<f64>;

    /// What to do next, while that is above 1.
    ///
    /// # Errors
    /// Those of the layout of a finer run.
    fn next(&mut self) -> Result<Next>;

    /// Does what [`Question::next`] said last.
    ///
    /// # Errors
    /// Those of the run; [`Error::Limit`] where it is out of time.
    fn run(&mut self, progress: &(dyn Fn(f64) + Sync)) -> Result<()>;
}

/// What a question asks for next.
pub(super) enum Next {
    /// A run that takes `now`; the tolerance will not be reached without one that takes `then`.
    Run { now: Work, then: Option<Work> },
    /// Nothing.
    Stop(Stop),
}

/// Why nothing finer was run, and whether the program was free to run it. Empty where the tolerance is reached.
#[derive(Debug, Default)]
pub(super) struct Stop {
    pub(super) reason: String,
    pub(super) free: bool,
}

impl Stop {
    pub(super) fn new(reason: impl Into<String>, free: bool) -> Self {
        let reason = reason.into();
        Self { reason, free }
    }

    /// What is missing of a tolerance: the error of `number` is `ratio` times too large.
    pub(super) fn shortfall(self, number: String, ratio: f64, tolerance: f64) -> Option<Shortfall> {
        // NaN is no error estimate.
        (ratio.is_nan() || ratio > 1.0).then_some(Shortfall {
            number,
            ratio,
            tolerance,
            free: self.free,
            reason: self.reason,
        })
    }
}

/// A first run foreseen to take so many times what is left is not begun: what is foreseen is within three of what it
/// takes, but for a few. Later ones are measured by the run before.
const MAX_FORESEEN_OVERRUN: f64 = 10.0;

/// The part of what is left to do that a run is shown to take if nothing is known to follow it.
const LAST: f64 = 0.9;

/// Runs until the tolerance is reached, or says why not. An answer once there is not lost to a later run that fails.
///
/// # Errors
/// [`Error::Limit`] for limits that do not suffice for a first answer; those of the runs before it.
pub(super) fn pursue(
    question: &mut impl Question,
    limits: &Limits,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Stop> {
    let (mut pace, mut done) = (None, 0.0);
    loop {
        let ratio = question.ratio();
        if ratio.is_some_and(|ratio| ratio <= 1.0) {
            progress(1.0);
            return Ok(Stop::default());
        }
        let (now, then) = match question.next() {
            Ok(Next::Run { now, then }) => (now, then),
            Ok(Next::Stop(stop)) => return Ok(stop),
            Err(error) if ratio.is_some() => return Ok(Stop::new(ended_early(&error), true)),
            Err(error) => return Err(error),
        };
        let name = || match ratio {
            Some(_) => "the next refinement".to_owned(),
            None => question.name(),
        };
        let reaching = then.map(|then| (then, "reaching the tolerance".to_owned()));
        for (work, name) in [(now, name())].into_iter().chain(reaching) {
            match (affordable(work, &name, pace, limits), ratio) {
                (Ok(()), _) => {}
                (Err(Error::Limit { what, .. }), Some(_)) => return Ok(Stop::new(what, true)),
                (Err(error), _) => return Err(error),
            }
        }
        let part = then.map_or(LAST, |then| now.seconds / (now.seconds + then.seconds));
        let end = done + part * (1.0 - done);
        let clock = Instant::now();
        match question.run(&|x| progress(done + x * (end - done))) {
            Err(error) if ratio.is_some() => return Ok(Stop::new(ended_early(&error), true)),
            it => it?,
        }
        pace = Some(clock.elapsed().as_secs_f64() / now.seconds);
        done = end;
    }
}

fn ended_early(error: &Error) -> String {
    format!("a finer run ended early: {error}")
}

/// Refuses work that the limits do not allow; `pace` is what the last run took over what was foreseen of it.
fn affordable(work: Work, name: &str, pace: Option<f64>, limits: &Limits) -> Result<()> {
    if work.memory > limits.memory {
        let [needed, limit] = [work.memory, limits.memory].map(|it| it as f64);
        return Err(Error::Limit {
            key: "accuracy.max_memory",
            limit: format!("{:.3} GB", 1e-9 * limit),
            what: format!(
                "{name} would need about {needed:.1e} bytes, and accuracy.max_memory = {limit:.1e}"
            ),
        });
    }
    let (seconds, left) = (work.seconds * pace.unwrap_or(1.0), limits.left().max(0.0));
    let most = pace.map_or(MAX_FORESEEN_OVERRUN * left, |_| left);
    if seconds > most {
        return Err(limits.out_of_time(format!(
            "{name} would take about {seconds:.1e} s, and {left:.1e} s are left of accuracy.max_seconds"
        )));
    }
    Ok(())
}
