//! From a tolerance to an answer, the same for every question: a run, a finer one, an error estimate from their
//! difference, and so on until that is within the tolerance, there is nothing finer, or a limit says stop.

use super::budget::{Cost, Limits};
use crate::error::{Error, Result};
use crate::estimate::{Estimate, Lack, Origin, Shortfall};
use crate::format::{bytes, seconds as in_words};
use crate::moments::{Moment, Moments};
use std::time::Instant;

/// A question that is answered by runs, each finer than the one before. What a run does between two looks at
/// [`Limits::in_time`] is short.
pub(super) trait Question: Sized {
    /// Numbers with their error estimates.
    type Answer;

    /// The largest error estimate over the tolerance; None before there is an answer.
    fn ratio(&self) -> Option<f64>;

    /// What to do next, while that is above 1.
    fn next(&mut self) -> Result<Next>;

    /// Does what [`Question::next`] said last.
    ///
    /// # Errors
    /// Those of the run; [`Error::Limit`] where it is out of time.
    fn run(&mut self, progress: &(dyn Fn(f64) + Sync)) -> Result<()>;

    /// The answer, if there is one, and what stopped it.
    fn answer(self, stop: Stop) -> Option<Self::Answer>;
}

/// What a question asks for next.
pub(super) enum Next {
    /// A run that takes `now`; the tolerance will not be reached without one that takes `then`.
    Run { now: Cost, then: Option<Cost> },
    /// Nothing, and why.
    Stop(String),
}

impl Next {
    /// A run after which the tolerance may be reached.
    pub(super) fn run(now: Cost) -> Self {
        Self::Run { now, then: None }
    }

    /// Nothing, and why.
    pub(super) fn stop(reason: impl Into<String>) -> Self {
        Self::Stop(reason.into())
    }

    /// One resolution more, of `most`: three are needed for an answer, and the last may be `given` by the scene.
    pub(super) fn of_three(
        done: usize,
        most: usize,
        given: bool,
        work: impl Fn(usize) -> Cost,
    ) -> Self {
        if done >= 3 && given {
            return Self::stop("its cells are those of the scene");
        }
        if done >= most {
            return Self::stop(format!("{done} resolutions did not settle it"));
        }
        Self::Run {
            now: work(done),
            then: (done < 2).then(|| work(2)),
        }
    }
}

/// Writes the errors into moments, and says the largest over `tolerance` times its scale, and whose that is.
pub(super) fn judged(
    moments: &mut Moments,
    origin: Origin,
    (scales, tolerance): (&[f64], f64),
    error: impl Fn(usize, f64) -> f64,
) -> (f64, &'static str) {
    let mut worst = (0.0, Moment::ALL[0].name());
    for (k, number) in moments.each_mut().into_iter().enumerate() {
        if let Some(number) = number {
            let error = error(k, number.value);
            *number = Estimate::new(number.value, error, origin);
            let ratio = error / (scales[k] * tolerance);
            if ratio > worst.0 || ratio.is_nan() {
                worst = (ratio, Moment::ALL[k].name());
            }
        }
    }
    worst
}

/// Why nothing finer was run, and whether the program was free to run it. Empty where the tolerance is reached.
#[derive(Debug, Default)]
pub(super) struct Stop {
    pub(super) reason: String,
    pub(super) free: bool,
}

impl Stop {
    /// What is missing of a tolerance: the error of `number` is `ratio` times too large.
    pub(super) fn shortfall(self, number: String, ratio: f64, tolerance: f64) -> Option<Shortfall> {
        // NaN is no error estimate.
        (ratio.is_nan() || ratio > 1.0).then_some(Shortfall {
            lack: Lack::Accuracy {
                number,
                ratio,
                tolerance,
            },
            free: self.free,
            reason: self.reason,
        })
    }
}

/// A first run foreseen to take so many times what is left is not begun: what is foreseen is within ten of what it
/// takes, but for a few. Later ones are measured by the run before.
const MAX_FORESEEN_OVERRUN: f64 = 10.0;

/// A tolerance that is out of reach is pursued for this part of the time: what is known better is worth something too.
const OUT_OF_REACH: f64 = 0.1;

/// The part of what is left to do that a run is shown to take if nothing is known to follow it.
const LAST: f64 = 0.9;

/// Runs until the tolerance is reached, or says why not. An answer once there is not lost to a later run that fails.
/// `what` is asked is named where time or memory do not suffice for a first answer; `free` says whether cells and steps are the
/// program's own, so that a tolerance missed is its fault.
///
/// # Errors
/// [`Error::Limit`] for limits that do not suffice for a first answer; those of the runs before it.
pub(super) fn pursue<Q: Question>(
    mut question: Q,
    (what, free): (&str, bool),
    limits: &Limits,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Q::Answer> {
    let (mut pace, mut done) = (None, 0.0);
    let given = limits.left();
    let stop = loop {
        let ratio = question.ratio();
        if ratio.is_some_and(|ratio| ratio <= 1.0) {
            break Stop::default();
        }
        // An answer is not lost to what comes after it.
        let kept = |reason: String, free, error| match ratio {
            Some(_) => Ok(Stop { reason, free }),
            None => Err(error),
        };
        // A limit may be raised.
        let ended = |error: Error| {
            let free = free || matches!(error, Error::Limit { .. });
            kept(format!("a finer run ended early: {error}"), free, error)
        };
        let (now, then) = match question.next() {
            Ok(Next::Run { now, then }) => (now, then),
            Ok(Next::Stop(reason)) => break Stop { reason, free },
            Err(error) => break ended(error)?,
        };
        let (name, end) = match ratio {
            Some(_) => ("the next refinement", "reaching the tolerance"),
            None => (what, "a first answer"),
        };
        let ends = limits.left() - now.seconds * pace.unwrap_or(1.0);
        let early = ends > (1.0 - OUT_OF_REACH) * given;
        let end = then
            .filter(|_| ratio.is_none() || !early)
            .map(|then| (then, end));
        let mut over = [(now, name)].into_iter().chain(end);
        let over = over.find_map(|(work, name)| excess(work, name, pace, limits));
        if let Some((excess, error)) = over {
            break kept(excess, true, error)?;
        }
        let part = then.map_or(LAST, |then| now.seconds / (now.seconds + then.seconds));
        let end = done + part * (1.0 - done);
        let clock = Instant::now();
        if let Err(error) = question.run(&|x| progress(done + x * (end - done))) {
            break ended(error)?;
        }
        pace = Some(clock.elapsed().as_secs_f64() / now.seconds);
        done = end;
    };
    progress(1.0);
    let answer = question.answer(stop);
    answer.ok_or_else(|| limits.out_of_time(format!("{what} had not ended")))
}

/// What the limits do not allow of a run, in words and as an error; `pace` is what the last one took over what was
/// foreseen of it.
fn excess(work: Cost, name: &str, pace: Option<f64>, limits: &Limits) -> Option<(String, Error)> {
    let (seconds, left) = (work.seconds * pace.unwrap_or(1.0), limits.left().max(0.0));
    if work.memory > limits.memory {
        let what = format!("{name} would need about {}", bytes(work.memory));
        let (key, limit) = ("accuracy.max_memory", bytes(limits.memory));
        let reason = format!("{what}, and {key} = {limit}");
        Some((reason, Error::limit(key, limit, what)))
    } else if seconds > pace.map_or(MAX_FORESEEN_OVERRUN * left, |_| left) {
        let would = in_words(seconds);
        let left = if left > 0.0 {
            format!("{} are left", in_words(left))
        } else {
            "nothing is left".into()
        };
        let what = format!("{name} would take about {would}, and {left}");
        let error = limits.out_of_time(what.clone());
        Some((format!("{what} of accuracy.max_seconds"), error))
    } else {
        None
    }
}
