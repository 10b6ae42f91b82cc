//! A moment against time as courses have shown it, and where it may pass a level: an extremum between two times counts as much as
//! a value at one.

use crate::estimate::{Estimate, Origin};
use crate::roots::bisect;

/// A moment against time, and a level.
pub(super) struct Curve {
    level: Estimate,
    courses: Vec<Course>,
}

/// What one course shows: values at ascending times, and the parts of time that they stand close enough in.
struct Course {
    times: Vec<f64>,
    values: Vec<Estimate>,
    parts: Vec<[f64; 2]>,
}

/// The curve at one time: the interpolated value, an error of those about it, how far it may be off between them, and the lowest
/// and the highest it can be by the slopes about it.
#[derive(Clone, Copy)]
struct Place {
    value: f64,
    error: f64,
    unsure: f64,
    within: [f64; 2],
    /// Between the times that show it.
    spacing: f64,
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

/// The part of time that a whole course shows.
pub(super) const ALWAYS: [f64; 2] = [0.0, f64::INFINITY];
/// Pieces of an interval between two times that are looked at.
const PIECES: u32 = 64;
/// So many times are put where there was one, of a stretch whose curve is not known between the times.
const OF_SPACING: f64 = 4.0;
/// Part of their errors that values are taken to have left, at the least.
const FINEST: f64 = 0.02;
/// Times beyond both ends of a stretch, for the interpolation.
const BEYOND: f64 = 2.0;
/// Times about a stretch at least.
const FINE: f64 = 5.0;

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
            unsure: self.unsure.max(next.unsure),
            ..higher
        };
    }

    /// Times about it for values that err so many times as much, some beyond both ends, no more than `most`: no nearer to each
    /// other than the interpolation needs, of order 4, since steps that end sooner bring no value nearer.
    fn window(&self, end: f64, most: f64, finer: f64) -> Vec<f64> {
        let parts = if self.by_value() > 0.5 {
            let unsure = self.unsure / (finer.max(FINEST) * self.error);
            (4.0 * unsure).powf(0.25).clamp(1.0, OF_SPACING)
        } else {
            OF_SPACING
        };
        let apart = self.spacing / parts;
        // Values may err by twice what they are said to: half of the stretch more.
        let beyond = (BEYOND * apart).max(0.5 * (self.to - self.from));
        let (from, to) = ((self.from - beyond).max(0.0), (self.to + beyond).min(end));
        let count = ((to - from) / apart).ceil();
        evenly(from, to, count.clamp(FINE, most.max(FINE)))
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
        let share = first.by_value();
        (share > 0.5).then(|| aim / (share * crossing.error()))
    }

    /// What is not known of the values where it may have passed first.
    pub(super) fn error(&self) -> Option<f64> {
        self.stretches.first().map(|it| it.error)
    }

    /// Times that show more of every stretch with values that err so many times as much, of very many of the first, no more than
    /// `most`, and the parts that they look at.
    pub(super) fn closer(&self, end: f64, most: f64, finer: f64) -> (Vec<f64>, Vec<[f64; 2]>) {
        let mut times: Vec<f64> = Vec::new();
        let mut parts: Vec<[f64; 2]> = Vec::new();
        let stretches = self.stretches.iter().take((most / FINE) as usize);
        let each = most / stretches.len() as f64;
        for window in stretches.map(|it| it.window(end, each, finer)) {
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

impl Course {
    fn covers(&self, t: f64) -> bool {
        let after = self.parts.partition_point(|it| it[1] < t);
        let ends = (self.times.first(), self.times.last());
        let (Some(first), Some(last)) = ends else {
            return false;
        };
        (*first..=*last).contains(&t) && self.parts.get(after).is_some_and(|it| it[0] <= t)
    }

    fn at(&self, t: f64) -> Place {
        let last = self.times.len() - 1;
        let k = self.times.partition_point(|it| *it <= t);
        let k = k.saturating_sub(1).min(last.saturating_sub(1));
        let [a, b] = [k, (k + 1).min(last)].map(|i| self.values[i]);
        let (value, unsure) = self.between(k, t);
        let bend = self.bend(k);
        let highest = a.value.max(b.value) + bend;
        Place {
            value,
            error: a.error.max(b.error),
            unsure,
            within: [a.value.min(b.value) - bend, highest],
            spacing: self.times[(k + 1).min(last)] - self.times[k],
        }
    }

    /// The most by which the curve may leave its values at times k and k + 1 between them: a peak is no steeper than what lies
    /// beside it.
    fn bend(&self, k: usize) -> f64 {
        let last = self.times.len() - 1;
        let beside = k.saturating_sub(1)..(k + 2).min(last);
        let width = |i: usize| self.times[i + 1] - self.times[i];
        let slope = |i: usize| (self.values[i + 1].value - self.values[i].value).abs() / width(i);
        let steepest = beside.map(slope).fold(0.0, f64::max);
        if k < last { width(k) * steepest } else { 0.0 }
    }

    /// The cubic through the four times about interval `k`, and how far it is from those one time before and after, at an end of the
    /// course one and two times further in: a parabola would tell nothing at a peak, where the third derivative vanishes.
    fn between(&self, k: usize, t: f64) -> (f64, f64) {
        let last = self.times.len() - 1;
        let from = k.saturating_sub(1).min(last.saturating_sub(3));
        let cubic = self.lagrange(from..=(from + 3).min(last), t);
        let further = match from {
            0 => Some(2),
            _ if from + 3 == last => from.checked_sub(2),
            _ => None,
        };
        let beside = [from.checked_sub(1), Some(from + 1), further];
        let whole = beside.into_iter().flatten().filter(|it| it + 3 <= last);
        let others = whole.map(|it| self.lagrange(it..=it + 3, t));
        let apart = others.map(|it| (cubic - it).abs()).reduce(f64::max);
        let fewer = || (cubic - self.lagrange(0..=last.min(3).saturating_sub(1), t)).abs();
        (cubic, apart.unwrap_or_else(fewer))
    }

    fn lagrange(&self, nodes: std::ops::RangeInclusive<usize>, t: f64) -> f64 {
        let value = |i: usize| {
            let others = nodes.clone().filter(|j| *j != i);
            let weight: f64 = others
                .map(|j| (t - self.times[j]) / (self.times[i] - self.times[j]))
                .product();
            weight * self.values[i].value
        };
        nodes.clone().map(value).sum()
    }
}

impl Curve {
    /// Nothing yet of a moment about a level.
    pub(super) fn about(level: Estimate) -> Self {
        Self {
            level,
            courses: Vec::new(),
        }
    }

    /// Puts the level where it is known to lie more exactly.
    pub(super) fn lies(&mut self, level: Estimate) {
        self.level = level;
    }

    /// Takes what a course shows in these parts.
    pub(super) fn take(&mut self, times: &[f64], values: Vec<Estimate>, parts: Vec<[f64; 2]>) {
        self.courses.push(Course {
            times: times.to_vec(),
            values,
            parts,
        });
    }

    /// The value at the first time of all.
    pub(super) fn first(&self) -> Option<Estimate> {
        let first = *self.courses.first()?.times.first()?;
        self.at(first)
            .map(|it| Estimate::new(it.value, it.error, Origin::Time))
    }

    /// The last time and the value there.
    pub(super) fn last(&self) -> Option<(f64, Estimate)> {
        let ends = self.courses.iter().filter_map(|it| it.times.last());
        let end = ends.copied().reduce(f64::max)?;
        let place = self.at(end)?;
        Some((end, Estimate::new(place.value, place.error, Origin::Time)))
    }

    /// What is not known of the last height over the level.
    pub(super) fn error(&self) -> f64 {
        self.level.error + self.last().map_or(0.0, |it| it.1.error)
    }

    /// Whether the very first time has the level, to its error and to the tolerance.
    pub(super) fn at_once(&self, tolerance: f64) -> bool {
        let has = |it: Estimate| {
            let error = it.error + self.level.error;
            (it.value - self.level.value).abs() <= error.min(tolerance * self.level.value.abs())
        };
        let begins = |it: &Course| it.times.first() == Some(&0.0);
        self.courses.first().is_some_and(begins) && self.first().is_some_and(has)
    }

    /// Whether all of the last quarter is within so much of a value, or within its error.
    pub(super) fn stays(&self, value: f64, within: f64) -> bool {
        let end = self.last().map_or(0.0, |it| it.0);
        let times = self.times();
        let quarter = times.iter().filter(|t| **t >= 0.75 * end);
        let mut places = quarter.filter_map(|t| self.at(*t));
        places.all(|it| (it.value - value).abs() <= within.max(it.error + self.level.error))
    }

    /// The times of all courses, each in its parts.
    fn times(&self) -> Vec<f64> {
        let of = |it: &'_ Course| {
            let times = it.times.iter().filter(|t| it.covers(**t));
            times.copied().collect::<Vec<f64>>()
        };
        let mut times: Vec<f64> = self.courses.iter().flat_map(of).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        times
    }

    /// What the course shows that knows most of it.
    fn at(&self, t: f64) -> Option<Place> {
        let covering = self.courses.iter().filter(|it| it.covers(t));
        let places = covering.map(|it| it.at(t));
        places.min_by(|a, b| (a.error + a.unsure).total_cmp(&(b.error + b.unsure)))
    }

    /// Where it may pass, and where it first certainly has.
    pub(super) fn passage(&self) -> Passage {
        let mut seen = Passage::default();
        // A level that is not known is as if the values were not.
        let error = |it: &Place| it.error + self.level.error;
        // Turned so that it rises through 0 where it first reaches the level.
        let below = self.first().is_none_or(|it| it.value < self.level.value);
        let sign = if below { 1.0 } else { -1.0 };
        let over = |value: f64| sign * (value - self.level.value);
        // Where even a peak between the times stays away nothing is looked at more closely.
        let near = |it: &Place| {
            it.within.map(over).into_iter().fold(f64::MIN, f64::max) + error(it) >= 0.0
        };
        let possible = |it: &Place| near(it) && over(it.value) + it.unsure + error(it) >= 0.0;
        let certain = |it: &Place| over(it.value) - it.unsure - error(it) >= 0.0;
        let above = |it: &Place| over(it.value) >= 0.0;
        // Where a piece turns so.
        let turns = |[before, at]: [f64; 2], so: &dyn Fn(&Place) -> bool| {
            bisect(before, at, |t| self.at(t).is_some_and(|it| so(&it)))
        };
        let (mut t, mut open) = (None, false);
        for ends in self.times().windows(2) {
            let middle = 0.5 * (ends[0] + ends[1]);
            if !self.at(middle).is_some_and(|it| near(&it)) {
                open = false;
                continue;
            }
            let place = |j: u32| match j {
                PIECES => ends[1],
                _ => ends[0] + (ends[1] - ends[0]) * f64::from(j) / f64::from(PIECES),
            };
            for j in 0..=PIECES {
                let piece = [place(j.saturating_sub(1)), place(j)];
                let Some(here) = self.at(piece[1]).filter(possible) else {
                    open = false;
                    continue;
                };
                if t.is_none() && above(&here) {
                    t = Some(turns(piece, &above));
                }
                let stretch = Stretch {
                    from: if open {
                        piece[0]
                    } else {
                        turns(piece, &possible)
                    },
                    to: piece[1],
                    spacing: here.spacing,
                    top: over(here.value),
                    error: error(&here),
                    unsure: here.unsure,
                };
                match seen.stretches.last_mut().filter(|_| open) {
                    Some(it) => it.extend(stretch),
                    None => seen.stretches.push(stretch),
                }
                open = true;
                if certain(&here)
                    && let Some(t) = t
                {
                    let low = seen.stretches[0].from.min(t);
                    let high = turns(piece, &certain).max(t);
                    seen.crossing = Some(Crossing { t, low, high });
                    return seen;
                }
            }
        }
        seen
    }
}

/// Equally spaced times from one to another, both among them.
pub(super) fn evenly(from: f64, to: f64, count: f64) -> Vec<f64> {
    let at = |k: u32| from + (to - from) * f64::from(k) / count;
    (0..=count as u32).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(times: &[f64], error: f64, off: f64) -> Vec<Estimate> {
        let value = |t: &f64| Estimate::new(1.0 - (-t).exp() + off, error, Origin::Space);
        times.iter().map(value).collect()
    }

    /// 1 - e^{-t} reaches 1/2 at ln 2, known as well as the values are over the slope there, however far apart the times lie.
    #[test]
    fn a_crossing_is_known_as_well_as_the_values() {
        for spacing in [0.02, 0.1] {
            let mut curve = Curve::about(Estimate::closed_form(0.5));
            let times = evenly(0.0, 4.0, 4.0 / spacing);
            curve.take(&times, values(&times, 1e-4, 0.0), vec![ALWAYS]);
            let crossing = curve.passage().crossing.unwrap();
            println!("{crossing:?}");
            assert!((crossing.t - 2f64.ln()).abs() < 1e-5);
            assert!((crossing.error() / 2e-4 - 1.0).abs() < 0.05);
        }
    }

    /// -cos 2(t + s) from t = 0 on, at the ends of courses: between values without error it errs by no more than is said.
    #[test]
    fn what_lies_between_the_times_is_within_its_error_at_the_ends_too() {
        for k in 0..200 {
            let shift = 0.0157 * f64::from(k);
            let of = |t: f64| -(2.0 * (t + shift)).cos();
            for times in [evenly(0.0, 4.0, 10.0), evenly(0.0, 2.0, FINE)] {
                let exact = |t: &f64| Estimate::new(of(*t), 0.0, Origin::Space);
                let values = times.iter().map(exact).collect();
                let (course, last) = (times.clone(), times[times.len() - 1]);
                let course = Course {
                    times: course,
                    values,
                    parts: vec![ALWAYS],
                };
                for j in 0..100 {
                    let t = 0.01 * f64::from(j) * last;
                    let place = course.at(t);
                    let off = (place.value - of(t)).abs();
                    assert!(
                        off <= place.unsure + 1e-3,
                        "{times:?} {shift} {t}: {off} {}",
                        place.unsure
                    );
                }
            }
        }
    }

    #[test]
    fn a_course_that_errs_more_takes_nothing_from_one_before() {
        let mut curve = Curve::about(Estimate::closed_form(0.5));
        let times = evenly(0.0, 4.0, 100.0);
        curve.take(&times, values(&times, 1e-4, 0.0), vec![ALWAYS]);
        let before = curve.passage().crossing;
        let about = evenly(0.5, 0.9, 8.0);
        curve.take(&about, values(&about, 0.1, 0.03), vec![[0.5, 0.9]]);
        assert_eq!(curve.passage().crossing, before);
        // One that errs less is believed where it looks, and not beyond.
        curve.take(&about, values(&about, 1e-6, 0.0), vec![[0.5, 0.9]]);
        let finer = curve.passage().crossing.unwrap();
        assert!(finer.error() < 0.05 * before.unwrap().error());
        assert_eq!(curve.last().unwrap().1.error, 1e-4);
    }
}
