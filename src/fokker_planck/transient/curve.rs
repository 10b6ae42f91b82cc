//! A moment against time as courses have shown it, and where it may pass a level: an extremum between two times counts as much as
//! a value at one.

use crate::estimate::Estimate;
use crate::roots::bisect;

/// A moment against time, turned so that it rises through 0 where it first reaches the level.
pub(super) struct Curve {
    level: Estimate,
    sign: f64,
    times: Vec<f64>,
    values: Vec<Estimate>,
}

/// A stretch of time in which the curve may pass the level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stretch {
    from: f64,
    to: f64,
    /// Between the times that show it.
    spacing: f64,
    /// The highest place, over the level, and what is not known of it: errors of the values, and what lies between the times.
    top: f64,
    error: f64,
    unsure: f64,
}

/// What a curve shows of its passage.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Passage {
    /// Where it may have passed; where it certainly has, that is the last.
    pub(super) stretches: Vec<Stretch>,
    pub(super) crossing: Option<Crossing>,
}

/// Where a curve crosses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Crossing {
    pub(super) t: f64,
    /// Before `low` it cannot have crossed, after `high` it must have.
    low: f64,
    high: f64,
}

/// Pieces of an interval between two times that are looked at.
const PIECES: u32 = 64;
/// So many times in a stretch that is looked at more closely, and in the time between two that show it.
const OF_STRETCH: f64 = 8.0;
const OF_SPACING: f64 = 4.0;
/// Times about a stretch at least.
const FINE: f64 = 16.0;

impl Crossing {
    pub(super) fn error(&self) -> f64 {
        // Never less than the rounding of the times themselves.
        let wider = (self.t - self.low).max(self.high - self.t);
        wider.max(1e-13 * self.t)
    }

    /// Whether the time of another lies within its error.
    pub(super) fn holds(&self, other: &Self) -> bool {
        (self.low..=self.high).contains(&other.t)
    }
}

impl Stretch {
    /// The share that errors of the values have in what is not known.
    fn by_value(&self) -> f64 {
        self.error / (self.error + self.unsure).max(f64::MIN_POSITIVE)
    }

    /// Goes on with what lies next.
    fn extend(&mut self, next: Self) {
        let higher = if next.top > self.top { next } else { *self };
        *self = Self {
            from: self.from,
            to: next.to,
            spacing: self.spacing.min(next.spacing),
            ..higher
        };
    }

    /// Times about it, some beyond both ends for the interpolation, no more than `most`.
    fn window(&self, end: f64, most: f64) -> Vec<f64> {
        let width = (self.to - self.from).max(1e-9 * self.to);
        let (from, to) = (
            (self.from - 0.5 * width).max(0.0),
            (self.to + 0.5 * width).min(end),
        );
        let parts = if self.by_value() > 0.5 {
            1.0
        } else {
            OF_SPACING
        };
        let apart = (self.spacing / parts).min(width / OF_STRETCH);
        evenly(
            from,
            to,
            ((to - from) / apart).ceil().clamp(FINE, most.max(FINE)),
        )
    }
}

impl Passage {
    /// How many times less the errors of the values must be for a time within `aim`, or to tell whether it passes at all; None where
    /// finer times do as well.
    pub(super) fn finer(&self, aim: f64) -> Option<f64> {
        let Some(crossing) = &self.crossing else {
            let by_value = self.stretches.iter().filter(|it| it.by_value() > 0.5);
            return by_value.map(|it| it.top.abs() / it.error).reduce(f64::min);
        };
        let first = self.stretches.first()?;
        let (spread, share) = (crossing.error(), first.by_value());
        let piece = first.spacing / f64::from(PIECES);
        (share * spread > (1.0 - share) * spread + piece).then(|| aim / (share * spread))
    }

    /// What is not known of the values where it may have passed first.
    pub(super) fn error(&self) -> Option<f64> {
        self.stretches.first().map(|it| it.error)
    }

    /// Times that show more of every stretch, of very many of the first, no more than `most`, and the parts that they look at.
    pub(super) fn closer(&self, end: f64, most: f64) -> (Vec<f64>, Vec<[f64; 2]>) {
        let mut times: Vec<f64> = Vec::new();
        let mut parts: Vec<[f64; 2]> = Vec::new();
        let stretches = self.stretches.iter().take((most / FINE) as usize);
        let each = most / stretches.len() as f64;
        for window in stretches.map(|it| it.window(end, each)) {
            let (first, last) = (window[0], window[window.len() - 1]);
            match parts.last_mut().filter(|it| first <= it[1]) {
                Some(part) => part[1] = part[1].max(last),
                None => parts.push([first, last]),
            }
            let now = times.last().copied().unwrap_or(-1.0);
            times.extend(window.into_iter().filter(|t| *t > now));
        }
        (times, parts)
    }
}

impl Curve {
    /// Nothing yet of a moment about a level.
    pub(super) fn about(level: Estimate) -> Self {
        Self {
            level,
            sign: 1.0,
            times: Vec::new(),
            values: Vec::new(),
        }
    }

    /// Puts the level where it is known to lie more exactly.
    pub(super) fn lies(&mut self, level: Estimate) {
        self.level = level;
    }

    /// Takes what a course shows in these parts instead of what was known there.
    pub(super) fn take(&mut self, times: &[f64], values: &[Estimate], parts: &[[f64; 2]]) {
        if self.times.is_empty() {
            let below = values.first().is_none_or(|it| it.value < self.level.value);
            self.sign = if below { 1.0 } else { -1.0 };
        }
        let within = |t: f64| parts.iter().any(|it| (it[0]..=it[1]).contains(&t));
        let known = self.times.drain(..).zip(self.values.drain(..));
        let mut all: Vec<(f64, Estimate)> = known.filter(|it| !within(it.0)).collect();
        let new = times.iter().copied().zip(values.iter().copied());
        all.extend(new.filter(|it| within(it.0)));
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        (self.times, self.values) = all.into_iter().unzip();
    }

    pub(super) fn first(&self) -> Option<Estimate> {
        self.values.first().copied()
    }

    /// The last time and the value there.
    pub(super) fn last(&self) -> Option<(f64, Estimate)> {
        let last = self.times.last().zip(self.values.last());
        last.map(|(t, value)| (*t, *value))
    }

    /// What is not known of the last height over the level.
    pub(super) fn error(&self) -> f64 {
        self.level.error + self.values.last().map_or(0.0, |it| it.error)
    }

    /// Whether the very first time has the level, to its error and to the tolerance.
    pub(super) fn at_once(&self, tolerance: f64) -> bool {
        let has = |it: &Estimate| {
            let error = it.error + self.level.error;
            (it.value - self.level.value).abs() <= error.min(tolerance * self.level.value.abs())
        };
        self.times.first() == Some(&0.0) && self.values.first().is_some_and(has)
    }

    /// Whether all of the last quarter is within so much of a value, or within its error.
    pub(super) fn stays(&self, value: f64, within: f64) -> bool {
        let end = self.times.last().copied().unwrap_or(0.0);
        let all = self.times.iter().zip(&self.values);
        let mut quarter = all.filter(|(t, _)| **t >= 0.75 * end);
        quarter.all(|(_, it)| (it.value - value).abs() <= within.max(it.error + self.level.error))
    }

    /// Height over the level.
    fn over(&self, k: usize) -> f64 {
        self.sign * (self.values[k].value - self.level.value)
    }

    /// The most by which the curve may rise between times k and k + 1 over its values there: a peak is no steeper than what lies
    /// beside it.
    fn bend(&self, k: usize) -> f64 {
        let last = self.times.len() - 1;
        let beside = k.saturating_sub(1)..(k + 2).min(last);
        let width = |i: usize| self.times[i + 1] - self.times[i];
        let slope = |i: usize| (self.over(i + 1) - self.over(i)).abs() / width(i);
        width(k) * beside.map(slope).fold(0.0, f64::max)
    }

    /// The cubic through the four times about interval `k`, and how far it is from those one time before and after: a parabola would
    /// tell nothing at a peak, where the third derivative vanishes.
    fn between(&self, k: usize, t: f64) -> (f64, f64) {
        let last = self.times.len() - 1;
        let from = k.saturating_sub(1).min(last.saturating_sub(3));
        let cubic = self.lagrange(from..=(from + 3).min(last), t);
        let beside = [from.checked_sub(1), Some(from + 1)].into_iter().flatten();
        let whole = beside.filter(|it| it + 3 <= last);
        let others = whole.map(|it| self.lagrange(it..=it + 3, t));
        let apart = others.map(|it| (cubic - it).abs()).reduce(f64::max);
        let fewer = || (cubic - self.lagrange(0..=last.min(2), t)).abs();
        (cubic, apart.unwrap_or_else(fewer))
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

    /// Where it may pass, and where it first certainly has.
    pub(super) fn passage(&self) -> Passage {
        let mut seen = Passage::default();
        let (mut t, mut open) = (None, false);
        for k in 0..self.times.len().saturating_sub(1) {
            // A level that is not known is as if the values were not.
            let error = self.level.error + self.values[k].error.max(self.values[k + 1].error);
            let width = self.times[k + 1] - self.times[k];
            let piece = width / f64::from(PIECES);
            // Where even a peak between the times stays away nothing is looked at more closely.
            if self.over(k).max(self.over(k + 1)) + error + self.bend(k) < 0.0 {
                open = false;
                continue;
            }
            for j in 0..=PIECES {
                let at = self.times[k] + piece * f64::from(j);
                let (height, unsure) = self.between(k, at);
                if height + error + unsure < 0.0 {
                    open = false;
                    continue;
                }
                if t.is_none() && height >= 0.0 {
                    t = Some(self.root(k, (at - piece).max(0.0), at));
                }
                // The pieces are a resolution too.
                let (from, to) = ((at - piece).max(0.0), at + piece);
                let here = Stretch {
                    from,
                    to,
                    spacing: width,
                    top: height,
                    error,
                    unsure,
                };
                match seen.stretches.last_mut().filter(|_| open) {
                    Some(it) => it.extend(here),
                    None => seen.stretches.push(here),
                }
                open = true;
                if height - error - unsure >= 0.0
                    && let Some(t) = t
                {
                    let low = seen.stretches[0].from.min(t);
                    let high = to.max(t);
                    seen.crossing = Some(Crossing { t, low, high });
                    return seen;
                }
            }
        }
        seen
    }

    /// Where the interpolant crosses between two places, by bisection.
    fn root(&self, k: usize, low: f64, high: f64) -> f64 {
        if self.between(k, low).0 >= 0.0 {
            return high;
        }
        bisect(low, high, |t| self.between(k, t).0 >= 0.0)
    }
}

/// Equally spaced times from one to another, both among them.
pub(super) fn evenly(from: f64, to: f64, count: f64) -> Vec<f64> {
    let at = |k: u32| from + (to - from) * f64::from(k) / count;
    (0..=count as u32).map(at).collect()
}
