//! The scale on which a number over the axes is drawn, and its colours.

use super::field::Field;
use crate::report::plot::canvas::{Colour, LEVELS};
use crate::report::plot::panel::range;
use crate::report::plot::ticks::{digits, marks};

/// A scale that spans this factor is logarithmic.
const DECADES: f64 = 100.0;

/// A logarithmic scale of colours or heights ends so many decades below its top.
const DEEPEST: f64 = 12.0;

/// Colours of contours at most.
const MOST: usize = 9;

/// A number as it is drawn: its magnitude's logarithm where it spans decades.
pub(super) struct Scale {
    pub(super) log: bool,
    /// Of the numbers, or of their logarithms.
    pub(super) range: (f64, f64),
    /// The numbers are below zero, and their magnitude is drawn.
    negative: bool,
}

impl Scale {
    pub(super) fn of(field: &Field) -> Option<Self> {
        let there = || field.values.iter().copied().filter(|it| it.is_finite());
        let magnitudes = || there().map(f64::abs).filter(|it| *it > 0.0);
        let (low, high) = range(magnitudes(), 0.0)?;
        // Numbers that are less than their error are not told apart, nor on which side of 0 they lie.
        let pairs = || field.values.iter().copied().zip(&field.errors);
        let told =
            |(x, error): &(f64, &f64)| x.abs() > 0.0 && (error.is_nan() || x.abs() >= **error);
        let known = || pairs().filter(told).map(|(x, _)| x);
        let negative = known().any(|it| it < 0.0);
        let one_sided = !(negative && known().any(|it| it > 0.0));
        // A zero has no logarithm: it is one that is too small to be told.
        let log = one_sided && high / low.max(f64::MIN_POSITIVE) > DECADES;
        let range = if log {
            let top = magnitudes().fold(0.0, f64::max).log10();
            let bottom = known().fold(top, |low, x| low.min(x.abs().log10()));
            (bottom.max(top - DEEPEST).min(top - 1.0), top)
        } else {
            range(there(), 0.0)?
        };
        Some(Self {
            log,
            range,
            negative: log && negative,
        })
    }

    /// Where a number stands; below the range what has no logarithm.
    pub(super) fn place(&self, x: f64) -> f64 {
        match (self.log, x.is_nan()) {
            (true, false) => {
                let magnitude = if self.negative { -x } else { x };
                magnitude.max(0.0).log10().max(self.range.0 - 1.0)
            }
            _ => x,
        }
    }

    pub(super) fn title(&self, field: &Field) -> String {
        if self.negative {
            match field.label.split_once(" [") {
                Some((name, unit)) => format!("|{name}| [{unit}"),
                None => format!("|{}|", field.label),
            }
        } else {
            field.label.clone()
        }
    }

    /// Levels between colours, with their words; the first colour lies below the first level.
    pub(super) fn levels(&self) -> Vec<(f64, String)> {
        let within = |mut all: Vec<(f64, String)>| {
            all.retain(|(x, _)| *x > self.range.0 && *x < self.range.1);
            all
        };
        // The finest division that the colours can tell apart.
        let divisions: [&[f64]; 3] = [&[1.0, 2.0, 5.0], &[1.0, 3.0], &[1.0]];
        let fine = divisions.into_iter().filter(|_| self.log);
        let mut fine = fine.map(|it| within(digits(self.range, it)));
        let fine = fine.find(|it| (3..MOST).contains(&it.len()));
        let mut all = fine.unwrap_or_else(|| within(marks(self.range, self.log, MOST - 2)));
        all.truncate(MOST - 1);
        all
    }
}

/// The colours of so many levels and what lies below the first.
pub(super) fn colours(levels: usize) -> Vec<Colour> {
    let last = LEVELS.len() - 1;
    let at = |k: usize| LEVELS[(k * last + levels / 2) / levels.max(1)].1;
    (0..=levels).map(|k| at(k.min(levels))).collect()
}
