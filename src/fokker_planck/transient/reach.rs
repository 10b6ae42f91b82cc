//! The first time at which a moment of the transient reaches a level: a course over the relaxation of the oscillator
//! that finds the crossing, then finer times and a finer tolerance about it until its error is within the tolerance.

use super::curve::{ALWAYS, Crossing, Curve, Passage, evenly};
use super::recipe::Recipe;
use super::report::Transient;
use crate::error::{Error, Result};
use crate::estimate::{Estimate, Origin, Shortfall};
use crate::fokker_planck::adaptive::Stop;
use crate::fokker_planck::budget::{Cost, Limits};
use crate::fokker_planck::settings::{Method, Settings};
use crate::format::brief;
use crate::initial::Initial;
use crate::moments::Moment;
use crate::oscillator::Oscillator;
use std::f64::consts::TAU;

/// The answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Reached {
    /// The first time at which the moment has the level; None where it never does.
    pub t: Option<Estimate>,
    /// What the last course was computed with.
    pub method: Method,
    /// What was not reached of the tolerance, relative to the time itself.
    pub shortfall: Option<Shortfall>,
    /// What the reader should know.
    pub warnings: Vec<String>,
}

/// How it will be found.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Reach {
    moment: Moment,
    /// The level over the stationary value that the moment tends to.
    fraction: f64,
    settings: Settings,
    /// Between two times of the first course.
    spacing: f64,
    /// Length of a course that is judged by where it has come to.
    long: f64,
    times: Vec<f64>,
    /// Courses of twice the length each, before the level is given up.
    lengths: usize,
    first: Recipe,
    /// What it will take.
    pub(crate) cost: Cost,
}

/// Between two times of the first course, times the frequency of the fastest small motion: eight in a period of v^2, twice as
/// fast as the motion.
const SPACING: f64 = 0.4;
/// Times of a course; with more, those of a very weakly damped oscillator lie farther apart.
const MOST: f64 = 20_000.0;
/// Courses about the crossing, each with finer times or a finer tolerance.
const PASSES: usize = 5;
/// The finest tolerance of the first course, which only has to find the crossing: most of its times lie beyond that.
const FIRST: f64 = 0.03;
/// The part of the tolerance that a finer course aims at: the slope is not known any better.
const AIM: f64 = 0.6;
/// The part of what may be off that the level is allowed.
const OF_LEVEL: f64 = 0.25;
/// The finest tolerance that a course is given.
const FINEST: f64 = 1e-10;
/// Relaxations after which a course has shown what it will, if it has come to rest.
const LONG: f64 = 3.0;
/// Of the way from the stationary value to the level, within which a course has come to rest.
const NEAR: f64 = 0.1;
/// Of the cost of a course as long as the first, what those about the crossing take.
const AGAIN: f64 = 0.5;

impl Reach {
    /// The recipe for the time at which `moment` is `fraction` of its stationary value.
    pub(crate) fn of(
        (oscillator, initial): (&Oscillator, &Initial),
        moment: Moment,
        fraction: f64,
        settings: &Settings,
    ) -> Result<Self> {
        let relaxation = oscillator.correlation_time().max(TAU);
        let relaxation = relaxation.max(oscillator.flight_relaxation());
        // A relaxation towards the stationary value has come so far after this many of them, and some more.
        let length = |to: f64| relaxation * (1.3 * to.recip().ln().clamp(0.0, 30.0) + 0.6);
        let left = (1.0 - fraction).abs();
        let spacing = SPACING / fastest(oscillator, initial);
        // Hops between wells are slower than any of these.
        let long = match oscillator.contact().barrier() {
            None => LONG * relaxation,
            Some(_) => f64::INFINITY,
        };
        let times = course(length(left), spacing);
        // And what is left then is within the tolerance, all of the last quarter.
        let longest = length(left.min(1.0) * settings.tolerance);
        let lengths = 2 + (longest / length(left)).log2().ceil() as usize;
        let settings = Settings {
            moments: Some(vec![moment]),
            ..settings.clone()
        };
        let first = Recipe::of(oscillator, initial, &times, &rough(&settings))?;
        let fine = Recipe::of(oscillator, initial, &times, &settings)?.cost;
        let cost = Cost {
            seconds: first.cost.seconds + AGAIN * fine.seconds,
            ..fine
        };
        Ok(Self {
            moment,
            fraction,
            settings,
            spacing,
            long,
            times,
            lengths,
            first,
            cost,
        })
    }

    /// The method, for people.
    pub(crate) fn words(&self) -> String {
        let until = self.times.last().copied().unwrap_or(0.0);
        let (name, reason) = (self.first.name(), &self.first.reason);
        format!("{name}, in courses first to t = {until:.0}, then about the crossing; {reason}")
    }

    /// Finds the time; `stationary` is the value that the moment tends to, with so many times the error that a plan asks of it.
    /// What it may be off is in the error of the time.
    pub(crate) fn solve(
        &self,
        problem: (&Oscillator, &Initial),
        stationary: &dyn Fn(f64) -> Result<Estimate>,
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Reached> {
        let mut limit = Limit::of(stationary)?;
        let (mut times, mut settings) = (self.times.clone(), rough(&self.settings));
        let mut parts = vec![ALWAYS];
        let mut curve = Curve::about(limit.value.scaled(self.fraction));
        let mut best: Option<(Crossing, Method)> = None;
        let mut reason = "its courses bring it no nearer".to_owned();
        let (mut lengths, mut stalls) = (1, 0);
        let stiff = problem.0.contact().stiffness(0.0) > 0.0;
        let courses = self.lengths + PASSES;
        for pass in 0..courses {
            let from = pass as f64 / courses as f64;
            let part = |x: f64| progress(from + x / courses as f64);
            let it = if pass == 0 {
                self.first.course(problem, &times, limits, &part)
            } else {
                Recipe::of(problem.0, problem.1, &times, &settings)
                    .and_then(|recipe| recipe.course(problem, &times, limits, &part))
            };
            let it = match (it, &best) {
                (Ok(it), _) => it,
                // An answer is not lost to a finer course that fails.
                (Err(error), Some(_)) if !matches!(error, Error::Stopped { .. }) => {
                    reason = format!("a finer course ended early: {error}");
                    break;
                }
                (Err(error), _) => return Err(error),
            };
            let Some(values) = values(self.moment, &it, stiff) else {
                return Ok(self.answer(None, it, "it does not exist at every time"));
            };
            let largest = values.iter().map(|it| it.error).fold(0.0, f64::max);
            curve.take(&it.times, values, std::mem::take(&mut parts));
            if curve.at_once(self.settings.tolerance) {
                let words = "the initial condition has that fraction already";
                return Ok(self.answer(Some(Estimate::closed_form(0.0)), it, words));
            }
            let seen = curve.passage();
            let end = curve.last().map_or(0.0, |it| it.0);
            let finer = if let Some(crossing) = seen.crossing {
                let tolerance = self.settings.tolerance * crossing.t;
                let error = crossing.error();
                let before = best.as_ref().map_or(f64::INFINITY, |(it, _)| it.error());
                // Two courses in which nothing is gained: the cells of the scene, say.
                stalls += usize::from(error > 0.8 * before);
                if error < before || best.as_ref().is_some_and(|(it, _)| !it.holds(&crossing)) {
                    best = Some((crossing, it.method));
                }
                if error <= tolerance || stalls == 2 || pass + 1 == courses {
                    break;
                }
                seen.finer(AIM * tolerance)
            } else if !self.rests(&curve, limit.value) && lengths < self.lengths {
                lengths += 1;
                times = course(2.0 * end, self.spacing);
                parts = vec![[end, f64::INFINITY]];
                continue;
            } else {
                match self.not_passed(&curve, &seen, limit.value) {
                    NotPassed::Never(words) => return Ok(self.answer(None, it, &words)),
                    NotPassed::Perhaps(finer, _)
                        if settings.tolerance * finer > FINEST && pass < PASSES =>
                    {
                        (finer < 1.0).then_some(finer)
                    }
                    // It may come yet.
                    NotPassed::Perhaps(_, words) => {
                        return Ok(Reached {
                            t: None,
                            method: it.method,
                            shortfall: self.shortfall(&words, f64::NAN),
                            warnings: Vec::new(),
                        });
                    }
                }
            };
            (times, parts) = if seen.stretches.is_empty() {
                (course(end, self.spacing), vec![ALWAYS])
            } else {
                seen.closer(end, MOST, finer.unwrap_or(1.0))
            };
            if let Some(finer) = finer {
                let error = seen.error().unwrap_or(curve.error());
                // What the times that matter have come to, where a course did better there than it was asked to.
                let come = (it.worst * error / largest).min(settings.tolerance);
                settings.tolerance = tightened(come, finer);
                match limit.within(OF_LEVEL * finer * error / self.fraction) {
                    Ok(()) => curve.lies(limit.value.scaled(self.fraction)),
                    Err(error @ Error::Stopped { .. }) => return Err(error),
                    Err(error) => reason = format!("its level is known no better: {error}"),
                }
            }
        }
        progress(1.0);
        let Some((crossing, method)) = best else {
            return Err(limits.out_of_time("reach: no course had ended".into()));
        };
        let ratio = crossing.error() / (self.settings.tolerance * crossing.t);
        Ok(Reached {
            t: Some(Estimate::new(crossing.t, crossing.error(), Origin::Time)),
            method,
            shortfall: self.shortfall(&reason, ratio),
            // Those of a course that had another tolerance say nothing of this number.
            warnings: Vec::new(),
        })
    }

    /// Whether all of the last quarter is the stationary value within its error, or, of a course that is long enough for what is left
    /// of a deviation to grow no more, within [`NEAR`] of the way from it to the level.
    fn rests(&self, curve: &Curve, stationary: Estimate) -> bool {
        let long = curve.last().is_some_and(|(end, _)| end >= self.long);
        let near = NEAR * ((self.fraction - 1.0) * stationary.value).abs();
        curve.stays(stationary.value, if long { near } else { 0.0 })
    }

    /// What a curve says that certainly passes nowhere.
    fn not_passed(&self, curve: &Curve, seen: &Passage, stationary: Estimate) -> NotPassed {
        let level = self.fraction * stationary.value;
        let (end, last) = curve.last().unwrap_or((0.0, stationary));
        let words = format!(
            "from {} at first to {} at t = {} it does not pass {}",
            brief(curve.first().map_or(f64::NAN, |it| it.value)),
            brief(last.value),
            brief(end),
            brief(level)
        );
        let apart = (level - stationary.value).abs();
        if !self.rests(curve, stationary) {
            return NotPassed::Perhaps(0.0, words);
        }
        if seen.stretches.is_empty() {
            return NotPassed::Never(words);
        }
        let error = curve.error();
        if apart <= error {
            let words = format!("the stationary value is not told from it: {words}");
            return NotPassed::Perhaps(AIM * apart / error, words);
        }
        let finer = seen.finer(0.0).map_or(1.0, |it| AIM * it);
        let words = format!("what is not known of it hides whether it is passed: {words}");
        NotPassed::Perhaps(finer, words)
    }

    /// What is missing of the tolerance, and why.
    fn shortfall(&self, reason: &str, ratio: f64) -> Option<Shortfall> {
        let stop = Stop {
            reason: reason.into(),
            free: self.first.is_free(),
        };
        stop.shortfall("reach.t".into(), ratio, self.settings.tolerance)
    }

    fn answer(&self, t: Option<Estimate>, it: Transient, why: &str) -> Reached {
        Reached {
            t,
            method: it.method,
            // The errors of the course are in the answer.
            shortfall: None,
            warnings: vec![format!("reach: {}: {why}", self.moment.name())],
        }
    }
}

/// The largest frequency of small motions about an equilibrium or where the motion that begins at the mean turns, 1 at least.
fn fastest(oscillator: &Oscillator, initial: &Initial) -> f64 {
    let contact = oscillator.contact();
    let turns = match initial {
        Initial::Gaussian { mean: [q, v], .. } => {
            let lowest = contact.lowest_potential().unwrap_or(0.0);
            contact.turning_points(oscillator.energy(*q, *v) - lowest)
        }
        _ => None,
    };
    let stiffness = turns.map(|(a, b)| contact.stiffness(a).max(contact.stiffness(b)));
    contact
        .fastest()
        .max(stiffness.unwrap_or(1.0).max(1.0).sqrt())
}

/// The settings of the first course.
fn rough(settings: &Settings) -> Settings {
    let tolerance = settings.tolerance.max(FIRST);
    Settings {
        tolerance,
        ..settings.clone()
    }
}

/// The tolerance of a course that is to err so many times as much as one that came to this, none much finer than that.
fn tightened(tolerance: f64, finer: f64) -> f64 {
    (tolerance * finer.clamp(0.02, 0.7)).max(FINEST)
}

/// Times from 0 on, so far apart.
fn course(to: f64, spacing: f64) -> Vec<f64> {
    let count = (to / spacing).ceil();
    evenly(0.0, to, count.clamp(8.0, MOST - 1.0))
}

/// The value that the moment tends to.
struct Limit<'a> {
    of: &'a dyn Fn(f64) -> Result<Estimate>,
    /// Of the error that a plan asks of it.
    part: f64,
    value: Estimate,
}

impl<'a> Limit<'a> {
    fn of(of: &'a dyn Fn(f64) -> Result<Estimate>) -> Result<Self> {
        let (part, value) = (1.0, of(1.0)?);
        Ok(Self { of, part, value })
    }

    /// Finds it anew if it is known less exactly: no course makes a level known any better.
    fn within(&mut self, error: f64) -> Result<()> {
        if self.value.error > error {
            self.part *= error / self.value.error;
            self.value = (self.of)(self.part)?;
        }
        Ok(())
    }
}

/// What a curve says that certainly passes nowhere.
enum NotPassed {
    Never(String),
    /// Values that err so many times as much, or finer times, might tell; 0 where it has not come to rest.
    Perhaps(f64, String),
}

/// A moment at the times of a course; None where it does not exist at some time. `stiff` is whether the contact at rest is.
fn values(moment: Moment, it: &Transient, stiff: bool) -> Option<Vec<Estimate>> {
    let values = it.moments.iter().map(|at| at.get(moment));
    let mut values = values.collect::<Option<Vec<Estimate>>>()?;
    // A force without a width has no skewness and no kurtosis. That of a point that begins to spread is a Gaussian's where
    // the contact is stiff, else that of one that has hardly begun.
    if let [first, next, ..] = &mut values[..]
        && first.value.is_nan()
        && it.times.first() == Some(&0.0)
    {
        let value = match moment {
            _ if !stiff => next.value,
            Moment::KurtosisForce => 3.0,
            _ => 0.0,
        };
        *first = Estimate { value, ..*next };
    }
    for it in values.iter_mut().filter(|it| it.error.is_nan()) {
        it.error = f64::INFINITY;
    }
    values
        .iter()
        .all(|it| it.value.is_finite())
        .then_some(values)
}
