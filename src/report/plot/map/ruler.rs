//! An axis of a map: where its points stand, what is written along it.

use crate::format::bare;
use crate::report::plot::canvas::{Area, Drawn};
use crate::report::plot::panel::{Panel, range};
use crate::report::plot::ticks::marks;

/// Half the width of the column of a word, the distance of two being 1.
const COLUMN: f64 = 0.4;

/// An axis as it is drawn.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Ruler {
    /// Its words.
    pub(crate) label: String,
    /// Where its points are.
    pub(crate) values: Vec<f64>,
    /// Whether its distances are ratios.
    pub(crate) log: bool,
    /// What its points are called, where they are no numbers.
    pub(crate) words: Option<Vec<String>>,
}

impl Ruler {
    fn place(&self, x: f64) -> f64 {
        if self.log { x.log10() } else { x }
    }

    pub(super) fn places(&self) -> Vec<f64> {
        self.values.iter().map(|x| self.place(*x)).collect()
    }

    /// What is filled as one: the places of all points and which these are, or a column about each word. Between two words
    /// there is nothing.
    pub(super) fn strips(&self) -> Vec<(Vec<f64>, Vec<usize>)> {
        let places = self.places();
        if self.words.is_none() {
            let all = (0..places.len()).collect();
            return vec![(places, all)];
        }
        let columns = places.into_iter().enumerate();
        let column = |(k, x)| (vec![x - COLUMN, x + COLUMN], vec![k, k]);
        columns.map(column).collect()
    }

    pub(super) fn range(&self) -> Option<(f64, f64)> {
        let (low, high) = range(self.places(), 0.0)?;
        let room = if self.words.is_some() { 0.5 } else { 0.0 };
        Some((low - room, high + room))
    }

    /// Numbers along it, and lines between them.
    pub(super) fn marks(&self, range: (f64, f64), room: f64) -> Vec<(f64, String)> {
        if let Some(words) = &self.words {
            return self.places().into_iter().zip(words.clone()).collect();
        }
        marks(range, self.log, (room / 60.0).clamp(2.0, 8.0) as usize)
    }

    /// What a point of it is called.
    pub(super) fn called(&self, k: usize) -> String {
        match &self.words {
            Some(words) => words[k].clone(),
            None => bare(self.values[k]),
        }
    }
}

/// Grid, numbers and words of both axes; words are left out where they are empty.
pub(super) fn axes(area: &Area<'_>, panel: &Panel, x: (&Ruler, &str), y: (&Ruler, &str)) -> Drawn {
    let marks = [
        x.0.marks(panel.x, panel.width),
        y.0.marks(panel.y, panel.height * 1.4),
    ];
    panel.grid(area, marks, [true; 2])?;
    panel.labels(area, x.1, y.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_logarithmic_scale_is_marked_at_powers_of_ten_or_at_1_2_and_5() {
        let texts = |range, log| {
            let all = marks(range, log, 5);
            all.into_iter().map(|it| it.1).collect::<Vec<_>>()
        };
        assert_eq!(texts((-3.0, -1.0), true).len(), 3);
        assert_eq!(texts((-2.0, -1.0), true), ["0.01", "0.02", "0.05", "0.1"]);
        assert_eq!(texts((-12.0, 0.0), true).len(), 5);
        assert_eq!(texts((0.0, 1.0), false).len(), 6);
    }
}
