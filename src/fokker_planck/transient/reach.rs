//! The first time at which a moment of the transient reaches a level: a course over the relaxation of the oscillator
//! that finds the crossing, then finer times and a finer tolerance about it until its error is within the tolerance.

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
use crate::roots::bisect;
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
const MOST: usize = 20_000;
/// Courses about the crossing, each with finer times or a finer tolerance.
const PASSES: usize = 5;
/// Times of a course about the crossing.
const FINE: f64 = 16.0;
/// The part of the tolerance that a finer course aims at: the slope is not known any better.
const AIM: f64 = 0.4;
/// The finest tolerance that a course is given.
const FINEST: f64 = 1e-10;
/// Relaxations after which a course has shown what it will, if it has come to rest.
const LONG: f64 = 3.0;
/// Of the way from the stationary value to the level, within which a course has come to rest.
const NEAR: f64 = 0.1;
/// Of the cost of the first course, what those about the crossing add.
const AGAIN: f64 = 1.0;

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
        let spacing = SPACING / oscillator.contact().fastest();
        // Hops between wells are slower than any of these.
        let long = match oscillator.contact().barrier() {
            None => LONG * relaxation,
            Some(_) => f64::INFINITY,
        };
        let times = course(length(left), spacing);
        // And what is left then is within the tolerance.
        let longest = length(left.min(1.0) * settings.tolerance);
        let lengths = 1 + (longest / length(left)).log2().ceil() as usize;
        let settings = Settings {
            moments: Some(vec![moment]),
            ..settings.clone()
        };
        let first = Recipe::of(oscillator, initial, &times, &settings)?;
        let cost = Cost {
            seconds: first.cost.seconds * (1.0 + AGAIN),
            ..first.cost
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

    /// Finds the time; what the `stationary` value may be off is in its error.
    pub(crate) fn solve(
        &self,
        problem: (&Oscillator, &Initial),
        stationary: Estimate,
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Reached> {
        let (mut times, mut settings) = (self.times.clone(), self.settings.clone());
        let mut best: Option<(Crossing, Transient)> = None;
        let mut reason = "its courses bring it no nearer".to_owned();
        let (mut lengths, mut stalls, mut side) = (1, 0, None);
        // It crosses between these, whatever was seen in between.
        let mut bracket = [0.0_f64; 2];
        let stiff = problem.0.contact().stiffness(0.0) > 0.0;
        let courses = self.lengths + PASSES;
        for pass in 0..courses {
            let from = pass as f64 / courses as f64;
            let part = |x: f64| progress(from + x / courses as f64);
            let it = if pass == 0 {
                self.first.solve(problem, (&times, &[]), limits, &part)
            } else {
                Recipe::of(problem.0, problem.1, &times, &settings)
                    .and_then(|recipe| recipe.solve(problem, (&times, &[]), limits, &part))
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
            let seen = self.look(&it, stationary, (stiff, &mut side));
            let here = matches!(seen, Seen::Crossing(it) if it.begins_below);
            if let (false, Some((before, _))) = (here, &mut best) {
                // Not where the last course had it, which then errs by more than it knew.
                before.widen(bracket);
                times = evenly(bracket[0], bracket[1], FINE);
                reason = "a finer course did not find it again".into();
                continue;
            }
            let crossing = match seen {
                Seen::Crossing(crossing) => crossing,
                Seen::AtOnce => {
                    let words = "the initial condition has that fraction already";
                    let t = Some(Estimate::closed_form(0.0));
                    return Ok(self.answer(t, it, words));
                }
                Seen::NotYet(_) if lengths < self.lengths => {
                    lengths += 1;
                    times = course(2.0 * times.last().copied().unwrap_or(1.0), self.spacing);
                    continue;
                }
                Seen::Blurred(finer, _) if settings.tolerance * finer > FINEST && pass < PASSES => {
                    settings.tolerance = tightened(settings.tolerance, finer);
                    continue;
                }
                Seen::Never(words) => return Ok(self.answer(None, it, &words)),
                // It may come yet.
                Seen::NotYet(words) | Seen::Blurred(_, words) => {
                    return Ok(Reached {
                        t: None,
                        method: it.method,
                        shortfall: self.shortfall(&words, f64::NAN),
                        warnings: Vec::new(),
                    });
                }
            };
            // Where no value is certain, the end of the longest course.
            let end = times.last().map_or(bracket[1], |t| bracket[1].max(*t));
            bracket = [
                crossing.below.unwrap_or(bracket[0]),
                crossing.above.unwrap_or(end),
            ];
            let tolerance = self.settings.tolerance * crossing.t;
            let error = crossing.error();
            let before = best.as_ref().map_or(f64::INFINITY, |(it, _)| it.error());
            // Two courses in which nothing is gained: the cells of the scene, say.
            stalls += usize::from(error > 0.8 * before);
            if error < before {
                best = Some((crossing, it));
            }
            if error <= tolerance || stalls == 2 || pass + 1 == courses {
                break;
            }
            times = crossing.window();
            if crossing.by_value > crossing.by_time {
                let finer = AIM * tolerance / crossing.by_value;
                settings.tolerance = tightened(settings.tolerance, finer);
            }
        }
        progress(1.0);
        let Some((crossing, it)) = best else {
            return Err(limits.out_of_time("reach: no course had ended".into()));
        };
        let ratio = crossing.error() / (self.settings.tolerance * crossing.t);
        let by_value = crossing.by_value > crossing.by_time;
        let origin = [Origin::Time, Origin::Space][usize::from(by_value)];
        Ok(Reached {
            t: Some(Estimate::new(crossing.t, crossing.error(), origin)),
            method: it.method,
            shortfall: self.shortfall(&reason, ratio),
            // Those of a course that had another tolerance say nothing of this number.
            warnings: Vec::new(),
        })
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
            // What a course does not know it cannot deny.
            shortfall: it.shortfall,
            warnings: vec![format!("reach: {}: {why}", self.moment.name())],
        }
    }

    /// What a course shows.
    fn look(&self, it: &Transient, stationary: Estimate, side: (bool, &mut Option<f64>)) -> Seen {
        let level = stationary.scaled(self.fraction);
        let Some(curve) = Curve::of(self.moment, level, it, side) else {
            return Seen::Never("it does not exist at every time".into());
        };
        if curve.at_once(self.settings.tolerance) {
            return Seen::AtOnce;
        }
        if let Some(crossing) = curve.crossing() {
            return Seen::Crossing(crossing);
        }
        let value = |it: Option<&Estimate>| it.map_or(f64::NAN, |it| it.value);
        let words = format!(
            "from {} at first to {} at t = {} it does not pass {}",
            brief(value(curve.values.first())),
            brief(value(curve.values.last())),
            brief(it.times.last().copied().unwrap_or(0.0)),
            brief(level.value)
        );
        let apart = (level.value - stationary.value).abs();
        let error = curve.values.last().map_or(0.0, |it| it.error);
        if !curve.rests(stationary, self.long) {
            return Seen::NotYet(words);
        }
        if apart <= error {
            let words = format!("the stationary value is not told from it: {words}");
            return Seen::Blurred(AIM * apart / error, words);
        }
        match curve.unsure() {
            Some(finer) => Seen::Blurred(
                AIM * finer,
                format!("the error hides whether it is passed: {words}"),
            ),
            None => Seen::Never(words),
        }
    }
}

/// The tolerance of a course that is to err so many times as much, none much finer than the one before.
fn tightened(tolerance: f64, finer: f64) -> f64 {
    (tolerance * finer.clamp(0.02, 0.7)).max(FINEST)
}

/// Times from 0 on, so far apart.
fn course(to: f64, spacing: f64) -> Vec<f64> {
    let count = (to / spacing).ceil();
    evenly(0.0, to, count.clamp(8.0, MOST as f64 - 1.0))
}

/// Equally spaced times from one to another, both among them.
fn evenly(from: f64, to: f64, count: f64) -> Vec<f64> {
    let at = |k: u32| from + (to - from) * f64::from(k) / count;
    (0..=count as u32).map(at).collect()
}

/// What a course shows.
enum Seen {
    Crossing(Crossing),
    AtOnce,
    /// Nothing yet, in words.
    NotYet(String),
    /// Nothing, and it will stay so.
    Never(String),
    /// Nothing that the stationary value could be told from: an error so many times as large might.
    Blurred(f64, String),
}

/// A moment against time, turned so that it rises through 0 where it first reaches the level.
struct Curve<'a> {
    times: &'a [f64],
    values: Vec<Estimate>,
    level: f64,
    sign: f64,
}

/// Where a curve crosses.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Crossing {
    t: f64,
    /// Before `low` it cannot have crossed, after `high` it must have.
    low: f64,
    high: f64,
    /// Of the error, what that of the moment makes, and what lies between the times.
    by_value: f64,
    by_time: f64,
    /// The last time before it with a value that is certainly below, and the first after it with one certainly above.
    below: Option<f64>,
    above: Option<f64>,
    /// Whether the first time is one below.
    begins_below: bool,
}

impl Crossing {
    /// Anywhere between these.
    fn widen(&mut self, [below, above]: [f64; 2]) {
        self.low = self.low.min(below);
        self.high = self.high.max(above);
        self.by_time = self.error();
    }

    fn error(&self) -> f64 {
        // Never less than the rounding of the times themselves.
        let wider = (self.t - self.low).max(self.high - self.t);
        wider.max(1e-13 * self.t)
    }

    /// Times about it, some beyond its error at both ends for the interpolation.
    fn window(&self) -> Vec<f64> {
        let reach = self.error().max(1e-9 * self.t);
        let from = (self.t - 2.0 * reach).max(0.0);
        evenly(from, self.t + 2.0 * reach, FINE)
    }
}

impl<'a> Curve<'a> {
    /// None where the moment does not exist at some time; `stiff` is whether the contact at rest is. `side` remembers from
    /// which side the first course began: a course about the crossing does not see it.
    fn of(
        moment: Moment,
        level: Estimate,
        it: &'a Transient,
        (stiff, side): (bool, &mut Option<f64>),
    ) -> Option<Self> {
        // A level that is not known is as if the values were not.
        let values = it.moments.iter().map(|at| {
            let value = at.get(moment)?;
            let error = value.error + level.error;
            Some(Estimate::new(value.value, error, value.origin))
        });
        let mut values = values.collect::<Option<Vec<Estimate>>>()?;
        let level = level.value;
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
        if values.iter().any(|it| !it.value.is_finite()) {
            return None;
        }
        let below = values.first()?.value < level;
        let sign = *side.get_or_insert(if below { 1.0 } else { -1.0 });
        Some(Self {
            times: &it.times,
            values,
            level,
            sign,
        })
    }

    /// Whether the very first time has the level, to its error and to the tolerance.
    fn at_once(&self, tolerance: f64) -> bool {
        let has = |it: &Estimate| {
            (it.value - self.level).abs() <= it.error.min(tolerance * self.level.abs())
        };
        self.times.first() == Some(&0.0) && self.values.first().is_some_and(has)
    }

    /// Whether the last value is the stationary one within its error, or, of a course that is `long` enough for what is left of a
    /// deviation to grow no more, all of its last quarter within [`NEAR`] of the way from it to the level.
    fn rests(&self, stationary: Estimate, long: f64) -> bool {
        let (Some(last), Some(end)) = (self.values.last(), self.times.last()) else {
            return false;
        };
        let apart = |it: &Estimate| (it.value - stationary.value).abs();
        let near = NEAR * (self.level - stationary.value).abs();
        let quarter = self.times.iter().zip(&self.values);
        let mut quarter = quarter.filter(|(t, _)| **t >= 0.75 * end);
        apart(last) <= last.error || *end >= long && quarter.all(|(_, it)| apart(it) <= near)
    }

    /// How many times less an error must be for a value after the first to tell whether it passes the level.
    fn unsure(&self) -> Option<f64> {
        let mut all = 1..self.values.len();
        let unsure = all.find(|k| self.over(*k).abs() <= self.values[*k].error);
        unsure.map(|k| self.over(k).abs() / self.values[k].error)
    }

    /// Height over the level.
    fn over(&self, k: usize) -> f64 {
        self.sign * (self.values[k].value - self.level)
    }

    /// The cubic through the four times about interval `k`, and how far it is from the parabola through three.
    fn between(&self, k: usize, t: f64) -> (f64, f64) {
        let last = self.times.len() - 1;
        let from = k.saturating_sub(1).min(last.saturating_sub(3));
        let to = (from + 3).min(last);
        let cubic = self.lagrange(from..=to, t);
        let parabola = self.lagrange(from..=to.min(from + 2), t);
        // The parabola that reaches over the interval.
        let other = self.lagrange((from + 1).min(to)..=to, t);
        let near = if k > from + 1 { other } else { parabola };
        (cubic, (cubic - near).abs())
    }

    fn lagrange(&self, nodes: std::ops::RangeInclusive<usize>, t: f64) -> f64 {
        let value = |i: usize| {
            let others = nodes.clone().filter(|j| *j != i);
            let weight: f64 = others
                .map(|j| (t - self.times[j]) / (self.times[i] - self.times[j]))
                .product();
            weight * self.over(i)
        };
        nodes.clone().map(value).sum()
    }

    /// The first crossing, between what is possible and what is certain; None where none is certain.
    fn crossing(&self) -> Option<Crossing> {
        let last = self.times.len() - 1;
        if last == 0 {
            return None;
        }
        let (mut low, mut t) = (None, None);
        let mut by = (0.0_f64, 0.0_f64);
        for k in 0..last {
            let error = self.values[k].error.max(self.values[k + 1].error);
            let width = self.times[k + 1] - self.times[k];
            // Where even a peak between the times stays away nothing is looked at more closely.
            let top = self.over(k).max(self.over(k + 1));
            let bend = (self.over(k) - self.over(k + 1)).abs();
            if top + error + bend < 0.0 {
                continue;
            }
            let pieces = 64;
            for j in 0..=pieces {
                let at = self.times[k] + width * f64::from(j) / f64::from(pieces);
                let (height, unsure) = self.between(k, at);
                if low.is_none() && height + error + unsure >= 0.0 {
                    low = Some(at);
                }
                if t.is_none() && height >= 0.0 {
                    t = Some(self.root(k, at - width / f64::from(pieces), at));
                    by = (error, unsure);
                }
                if height - error - unsure >= 0.0
                    && let (Some(low), Some(t)) = (low, t)
                {
                    // The pieces are a resolution too.
                    let piece = width / f64::from(pieces);
                    let (low, high) = (low.min(t), at.max(t));
                    let spread = (t - low).max(high - t);
                    let share = by.0 / (by.0 + by.1).max(f64::MIN_POSITIVE);
                    // Nearer than a few pieces it is they that are seen.
                    let by_time = (1.0 - share) * spread + piece;
                    let certain =
                        |i: &usize, sign: f64| sign * self.over(*i) > self.values[*i].error;
                    let below = (0..=k).rev().find(|i| certain(i, -1.0));
                    let above = (k + 1..=last).find(|i| certain(i, 1.0));
                    return Some(Crossing {
                        t,
                        low: (low - piece).max(0.0),
                        high: high + piece,
                        by_value: share * spread,
                        by_time,
                        below: below.map(|i| self.times[i]),
                        above: above.map(|i| self.times[i]),
                        begins_below: self.times[0] == 0.0 || certain(&0, -1.0),
                    });
                }
            }
        }
        None
    }

    /// Where the interpolant crosses between two places, by bisection.
    fn root(&self, k: usize, low: f64, high: f64) -> f64 {
        if self.between(k, low).0 >= 0.0 {
            return high;
        }
        bisect(low, high, |t| self.between(k, t).0 >= 0.0)
    }
}
