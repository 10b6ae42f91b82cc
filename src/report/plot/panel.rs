//! Panels: axes that know their range, and what is drawn in them.

use super::canvas::{
    Area, CENTRED, Drawn, FAINT, FINE, Hang, INK, Points, TITLE, VERMILION, dashed, fine, line,
    styled, write,
};
use super::ticks::{marks, ticks};
use crate::estimate::Estimate;
use crate::monte_carlo::Histogram;
use crate::results::centres;
use plotters::prelude::*;

/// A range that holds every finite number, widened by a share of it; None without two different ones.
pub fn range(numbers: impl IntoIterator<Item = f64>, share: f64) -> Option<(f64, f64)> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for x in numbers {
        if x.is_finite() {
            (low, high) = (low.min(x), high.max(x));
        }
    }
    if low > high {
        return None;
    }
    // Numbers that hardly differ make a flat curve: beside an axis there is room for some four digits.
    let (size, width) = (low.abs().max(high.abs()), high - low);
    let least = if size > 0.0 { 1e-3 * size } else { 1.0 };
    let margin = (share * width).max(0.5 * (least - width)).max(1e-9 * size);
    let out = (low - margin, high + margin);
    (out.0.is_finite() && out.1.is_finite()).then_some(out)
}

/// The highest finite number above 0; 0 without one.
pub(super) fn highest(numbers: impl IntoIterator<Item = f64>) -> f64 {
    let finite = numbers.into_iter().filter(|x| x.is_finite());
    finite.fold(0.0, f64::max)
}

/// Values against x, and the band of their errors.
pub(super) fn with_band(
    x: &[f64],
    curve: impl IntoIterator<Item = Estimate>,
) -> (Points, Vec<(f64, f64, f64)>) {
    let both = x.iter().zip(curve);
    both.map(|(x, y)| ((*x, y.value), (*x, y.value - y.error, y.value + y.error)))
        .unzip()
}

/// The place of the k-th of four panels.
pub(super) fn place(k: usize) -> [f64; 4] {
    let (column, row) = ((k % 2) as f64, (k / 2) as f64);
    [92.0 + 478.0 * column, 44.0 + 298.0 * row, 374.0, 236.0]
}

/// Width of a digit below an axis, in pixels.
const DIGIT: f64 = 7.5;

/// Length of the longest number, in pixels.
fn longest(marks: &[(f64, String)]) -> f64 {
    let digits = marks.iter().map(|it| it.1.chars().count()).max();
    DIGIT * digits.unwrap_or(0) as f64
}

/// How far apart marks are; infinitely far where there is one.
fn step(marks: &[(f64, String)]) -> f64 {
    let pairs = marks.windows(2).map(|pair| pair[1].0 - pair[0].0);
    pairs.fold(f64::INFINITY, f64::min)
}

/// Axes: a rectangle in pixels and what it shows.
#[derive(Debug, Clone)]
pub struct Panel {
    pub left: f64,
    pub top: f64,
    pub width: f64,
    pub height: f64,
    pub x: (f64, f64),
    pub y: (f64, f64),
    /// y is a decimal logarithm.
    pub log: bool,
}

impl Panel {
    /// Linear axes at [left, top, width, height].
    pub fn new(place: [f64; 4], x: (f64, f64), y: (f64, f64)) -> Self {
        let [left, top, width, height] = place;
        Self {
            left,
            top,
            width,
            height,
            x,
            y,
            log: false,
        }
    }

    /// The same with decimal logarithms for y, if so.
    #[must_use]
    pub fn logarithmic(self, log: bool) -> Self {
        Self { log, ..self }
    }

    pub fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let part = |x: f64, (low, high): (f64, f64)| (x - low) / (high - low);
        (
            self.left + self.width * part(x, self.x),
            self.top + self.height * (1.0 - part(y, self.y)),
        )
    }

    /// Words above it.
    pub(super) fn title(&self, area: &Area<'_>, words: &str) -> Drawn {
        write(area, words, (self.left, self.top - 22.0), TITLE)
    }

    /// Whether a point lies within the axes.
    pub fn shows(&self, x: f64, y: f64) -> bool {
        x >= self.x.0 && x <= self.x.1 && y >= self.y.0 && y <= self.y.1
    }

    pub fn bottom(&self) -> f64 {
        self.top + self.height
    }

    pub fn right(&self) -> f64 {
        self.left + self.width
    }

    /// As many as there is room for.
    fn x_ticks(&self) -> Vec<(f64, String)> {
        let most = (self.width / 60.0).clamp(2.0, 8.0) as usize;
        let fit = |marks: &Vec<(f64, String)>| {
            let room = self.width * step(marks) / (self.x.1 - self.x.0);
            room > longest(marks) + DIGIT
        };
        let mut fewer = (1..=most).rev().map(|count| ticks(self.x, count));
        fewer.find(fit).unwrap_or_else(|| ticks(self.x, 1))
    }

    fn y_ticks(&self) -> Vec<(f64, String)> {
        let count = if self.log {
            (self.height / 26.0).max(2.0)
        } else {
            (self.height / 42.0).clamp(2.0, 6.0)
        };
        marks(self.y, self.log, count as usize)
    }

    /// Grid, frame, numbers and labels. An empty label leaves that axis without numbers.
    pub fn axes(&self, area: &Area<'_>, x_label: &str, y_label: &str) -> Drawn {
        let marks = [self.x_ticks(), self.y_ticks()];
        self.grid(area, marks, [x_label, y_label].map(|it| !it.is_empty()))?;
        self.labels(area, x_label, y_label)
    }

    /// Lines at the marks of x and of y, and what is written there where it has numbers.
    pub(super) fn grid(
        &self,
        area: &Area<'_>,
        [x, y]: [Vec<(f64, String)>; 2],
        numbers: [bool; 2],
    ) -> Drawn {
        for (x, text) in x {
            let (px, _) = self.at(x, self.y.0);
            line(area, &[(px, self.top), (px, self.bottom())], FAINT, 0.75)?;
            if numbers[0] {
                let bottom = self.bottom();
                line(area, &[(px, bottom), (px, bottom + 4.0)], INK, 1.0)?;
                write(area, &text, (px, bottom + 13.0), CENTRED)?;
            }
        }
        for (y, text) in y {
            let (_, py) = self.at(self.x.0, y);
            line(area, &[(self.left, py), (self.right(), py)], FAINT, 0.75)?;
            if numbers[1] {
                line(area, &[(self.left - 4.0, py), (self.left, py)], INK, 1.0)?;
                write(area, &text, (self.left - 7.0, py), (13.0, Hang::Right, INK))?;
            }
        }
        Ok(())
    }

    /// Words below and left of it.
    pub(super) fn labels(&self, area: &Area<'_>, x_label: &str, y_label: &str) -> Drawn {
        let middle = self.left + 0.5 * self.width;
        let font = (15.5, Hang::Middle, INK);
        write(area, x_label, (middle, self.bottom() + 32.0), font)?;
        let beside = (longest(&self.y_ticks()) + 21.0).max(64.0);
        let at = (self.left - beside, self.top + 0.5 * self.height);
        styled(area, y_label, at, font, FontTransform::Rotate270)
    }

    pub fn frame(&self, area: &Area<'_>) -> Drawn {
        let (l, t, r, b) = (self.left, self.top, self.right(), self.bottom());
        line(area, &[(l, t), (r, t), (r, b), (l, b), (l, t)], INK, 1.0)
    }

    /// The pieces of a curve that lie within the panel, in pixels.
    pub(super) fn clipped(&self, points: &[(f64, f64)]) -> Vec<Points> {
        let mut pieces: Vec<Points> = Vec::new();
        let mut open = false;
        for pair in points.windows(2) {
            let Some((a, b)) = self.clip(pair[0], pair[1]) else {
                open = false;
                continue;
            };
            let (a, b) = (self.at(a.0, a.1), self.at(b.0, b.1));
            match pieces
                .last_mut()
                .filter(|piece| open && piece.last() == Some(&a))
            {
                Some(piece) => piece.push(b),
                None => pieces.push(vec![a, b]),
            }
            open = true;
        }
        pieces
    }

    /// The part of a segment within the panel (Liang and Barsky).
    fn clip(&self, a: (f64, f64), b: (f64, f64)) -> Option<((f64, f64), (f64, f64))> {
        if ![a.0, a.1, b.0, b.1].iter().all(|x| x.is_finite()) {
            return None;
        }
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for (p, q) in [
            (-dx, a.0 - self.x.0),
            (dx, self.x.1 - a.0),
            (-dy, a.1 - self.y.0),
            (dy, self.y.1 - a.1),
        ] {
            if p == 0.0 && q < 0.0 {
                return None;
            }
            if p < 0.0 {
                from = from.max(q / p);
            } else if p > 0.0 {
                to = to.min(q / p);
            }
        }
        // The ends themselves stay as they are, so that pieces join.
        let start = if from == 0.0 {
            a
        } else {
            (a.0 + from * dx, a.1 + from * dy)
        };
        let end = if to == 1.0 {
            b
        } else {
            (a.0 + to * dx, a.1 + to * dy)
        };
        (from <= to).then_some((start, end))
    }

    pub fn curve(
        &self,
        area: &Area<'_>,
        points: &[(f64, f64)],
        colour: RGBColor,
        width: f64,
    ) -> Drawn {
        for piece in self.clipped(points) {
            line(area, &piece, colour, width)?;
        }
        Ok(())
    }

    /// The band between two curves over the same abscissae; to the frame where one is infinite.
    pub fn band(&self, area: &Area<'_>, points: &[(f64, f64, f64)], colour: RGBColor) -> Drawn {
        let inside = |y: f64| y.clamp(self.y.0, self.y.1);
        let known =
            |(x, low, high): &&(f64, f64, f64)| ![x, low, high].iter().any(|it| it.is_nan());
        let (mut upper, mut lower) = (Vec::new(), Vec::new());
        for (x, low, high) in points.iter().filter(known) {
            upper.push(self.at(*x, inside(*high)));
            lower.push(self.at(*x, inside(*low)));
        }
        upper.extend(lower.into_iter().rev());
        let corners: Vec<(i32, i32)> = upper.into_iter().map(fine).collect();
        if corners.len() > 3 {
            area.draw(&Polygon::new(corners, colour.mix(0.22).filled()))?;
        }
        Ok(())
    }

    pub(super) fn dot(
        &self,
        area: &Area<'_>,
        (x, y): (f64, f64),
        colour: RGBColor,
        radius: f64,
    ) -> Drawn {
        if self.shows(x, y) {
            let (at, radius) = (fine(self.at(x, y)), (radius * FINE) as i32);
            area.draw(&Circle::new(at, radius, colour.filled()))?;
        }
        Ok(())
    }

    /// A histogram as dots in the middle of its bins, with a band of 95 %.
    pub(super) fn histogram(&self, area: &Area<'_>, it: &Histogram) -> Drawn {
        let height = |p: f64| match (self.log, p > 0.0) {
            (false, _) => p,
            (true, true) => p.log10(),
            (true, false) => f64::NEG_INFINITY,
        };
        let all: Vec<(f64, Estimate)> = centres(it).zip(it.density.iter().copied()).collect();
        let seen = || {
            all.iter()
                .filter(|(x, p)| *x >= self.x.0 && *x <= self.x.1 && p.value > 0.0)
        };
        let band: Vec<(f64, f64, f64)> = seen()
            .map(|(x, p)| {
                let [low, high] = [-1.96, 1.96].map(|z| height(p.value + z * p.error));
                (*x, low.max(self.y.0), high)
            })
            .collect();
        self.band(area, &band, VERMILION)?;
        for (x, p) in seen() {
            self.dot(area, (*x, height(p.value)), VERMILION, 1.75)?;
        }
        Ok(())
    }

    /// A point with its error bar.
    pub fn point(&self, area: &Area<'_>, x: f64, y: Estimate, colour: RGBColor) -> Drawn {
        let bar = [(x, y.value - y.error), (x, y.value + y.error)];
        self.curve(area, &bar, colour, 1.25)?;
        self.dot(area, (x, y.value), colour, 1.75)
    }

    /// A dashed curve.
    pub fn dashes(
        &self,
        area: &Area<'_>,
        points: &[(f64, f64)],
        colour: RGBColor,
        width: f64,
    ) -> Drawn {
        for piece in self.clipped(points) {
            dashed(area, &piece, colour, width)?;
        }
        Ok(())
    }

    /// A dashed line at one height.
    pub fn level(&self, area: &Area<'_>, y: f64, colour: RGBColor) -> Drawn {
        if y > self.y.0 && y < self.y.1 {
            let ends = [self.x.0, self.x.1].map(|x| self.at(x, y));
            dashed(area, &ends, colour, 1.25)?;
        }
        Ok(())
    }
}
