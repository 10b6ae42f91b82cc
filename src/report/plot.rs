//! Pictures as SVG, one function a picture. Every picture is drawn from panels: axes that know their
//! range, in a finer unit than a pixel so that curves stay smooth.
//!
//! Colours are Okabe and Ito's: blue for the Fokker-Planck equation, vermilion for Monte Carlo, black for
//! the closed form.

use super::File;
use super::data::time_name;
use crate::error::{Error, Result};
use crate::estimate::Estimate;
use crate::fokker_planck::Snapshot;
use crate::moments::Moments;
use crate::monte_carlo::Histogram;
use crate::oscillator::Quantity;
use crate::results::{Results, centres, widths};
use crate::spectrum::{displacement_per_hertz, per_hertz};
use crate::stationary::Stationary;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::path::PathBuf;

const BLUE: RGBColor = RGBColor(0, 114, 178);
const VERMILION: RGBColor = RGBColor(213, 94, 0);
const GREEN: RGBColor = RGBColor(0, 158, 115);
const INK: RGBColor = RGBColor(25, 25, 25);
const GREY: RGBColor = RGBColor(120, 120, 120);
/// Under a curve, for what it should coincide with.
const HALO: RGBColor = RGBColor(190, 190, 190);
const FAINT: RGBColor = RGBColor(228, 228, 228);

/// Levels of a density as fractions of its peak, and their colours, light to dark (ColorBrewer YlGnBu,
/// safe for colour-blind eyes and in grey).
const LEVELS: [(f64, RGBColor); 9] = [
    (0.01, RGBColor(255, 255, 217)),
    (0.03, RGBColor(237, 248, 177)),
    (0.1, RGBColor(199, 233, 180)),
    (0.2, RGBColor(127, 205, 187)),
    (0.35, RGBColor(65, 182, 196)),
    (0.5, RGBColor(29, 145, 192)),
    (0.65, RGBColor(34, 94, 168)),
    (0.8, RGBColor(37, 52, 148)),
    (0.95, RGBColor(8, 29, 88)),
];

/// Drawing units in a pixel.
const FINE: f64 = 4.0;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = std::result::Result<(), Box<dyn std::error::Error>>;
type Points = Vec<(f64, f64)>;

/// A picture of that size in pixels.
fn picture(
    name: impl Into<String>,
    size: (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Drawn,
) -> Result<File> {
    let name = name.into();
    let mut svg = String::new();
    let fine = |pixels: u32| pixels * FINE as u32;
    let drawn = (|| {
        let area = SVGBackend::with_string(&mut svg, (fine(size.0), fine(size.1)));
        let area = area.into_drawing_area();
        area.fill(&WHITE)?;
        draw(&area)?;
        area.present()?;
        Ok(())
    })();
    if let Err(error) = drawn {
        let error: Box<dyn std::error::Error> = error;
        return Err(Error::Io {
            path: PathBuf::from(name),
            source: std::io::Error::other(error.to_string()),
        });
    }
    let drawn = format!("width=\"{}\" height=\"{}\"", fine(size.0), fine(size.1));
    let shown = format!("width=\"{}\" height=\"{}\"", size.0, size.1);
    Ok(File::text(name, svg.replacen(&drawn, &shown, 1)))
}

/// Where a text hangs on its point.
#[derive(Clone, Copy)]
enum Hang {
    Left,
    Middle,
    Right,
}

/// A line of text, its vertical middle at `y`; sizes and places in pixels.
fn write(
    area: &Area<'_>,
    text: &str,
    at: (f64, f64),
    size: f64,
    hang: Hang,
    colour: RGBColor,
) -> Drawn {
    styled(area, text, at, (size, hang, colour, FontTransform::None))
}

fn styled(
    area: &Area<'_>,
    text: &str,
    (x, y): (f64, f64),
    (size, hang, colour, turn): (f64, Hang, RGBColor, FontTransform),
) -> Drawn {
    let hang = match hang {
        Hang::Left => HPos::Left,
        Hang::Middle => HPos::Center,
        Hang::Right => HPos::Right,
    };
    // The backend divides font sizes by 1.24.
    let font = (
        "DejaVu Sans, Verdana, Arial, sans-serif",
        size * FINE * 1.24,
    );
    let style = TextStyle::from(font.into_font().transform(turn))
        .color(&colour)
        .pos(Pos::new(hang, VPos::Center));
    area.draw_text(text, &style, ((x * FINE) as i32, (y * FINE) as i32))?;
    Ok(())
}

fn line(area: &Area<'_>, points: &[(f64, f64)], colour: RGBColor, width: f64) -> Drawn {
    let points: Vec<(i32, i32)> = points
        .iter()
        .map(|(x, y)| ((x * FINE) as i32, (y * FINE) as i32))
        .collect();
    let style = colour.stroke_width((width * FINE) as u32);
    area.draw(&PathElement::new(points, style))?;
    Ok(())
}

fn dashed(
    area: &Area<'_>,
    from: (f64, f64),
    to: (f64, f64),
    colour: RGBColor,
    width: f64,
) -> Drawn {
    let length = (to.0 - from.0).hypot(to.1 - from.1);
    let (dash, gap) = (5.0, 4.0);
    let at = |s: f64| {
        let part = (s / length).min(1.0);
        (
            from.0 + (to.0 - from.0) * part,
            from.1 + (to.1 - from.1) * part,
        )
    };
    let mut s = 0.0;
    while s < length && length.is_finite() {
        line(area, &[at(s), at(s + dash)], colour, width)?;
        s += dash + gap;
    }
    Ok(())
}

/// A range that holds every finite number, widened by a share of it; None without two different ones.
fn range(numbers: impl IntoIterator<Item = f64>, share: f64) -> Option<(f64, f64)> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for x in numbers {
        if x.is_finite() {
            (low, high) = (low.min(x), high.max(x));
        }
    }
    if low > high {
        return None;
    }
    // Numbers that differ by rounding alone make a flat curve, not a noisy one.
    let size = low.abs().max(high.abs());
    let least = if size > 0.0 { 1e-9 * size } else { 0.5 };
    let margin = (share * (high - low)).max(least);
    let out = (low - margin, high + margin);
    (out.0.is_finite() && out.1.is_finite()).then_some(out)
}

/// Axes: a rectangle in pixels and what it shows.
#[derive(Debug, Clone)]
struct Panel {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    x: (f64, f64),
    y: (f64, f64),
    /// y is a decimal logarithm.
    log: bool,
}

impl Panel {
    fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let part = |x: f64, (low, high): (f64, f64)| (x - low) / (high - low);
        (
            self.left + self.width * part(x, self.x),
            self.top + self.height * (1.0 - part(y, self.y)),
        )
    }

    fn bottom(&self) -> f64 {
        self.top + self.height
    }

    fn right(&self) -> f64 {
        self.left + self.width
    }

    fn y_ticks(&self) -> Vec<(f64, String)> {
        if !self.log {
            return ticks(self.y, (self.height / 42.0).clamp(2.0, 6.0) as usize);
        }
        let (low, high) = (self.y.0.ceil() as i64, self.y.1.floor() as i64);
        let most = (self.height / 26.0).max(2.0) as i64;
        let each = (high - low).div_euclid(most) + 1;
        (low..=high)
            .filter(|k| k.rem_euclid(each) == 0)
            .map(|k| (k as f64, format!("10{}", superscript(k))))
            .collect()
    }

    /// Grid, frame, numbers and labels. An empty label leaves that axis without numbers.
    fn axes(&self, area: &Area<'_>, x_label: &str, y_label: &str) -> Drawn {
        let count = (self.width / 60.0).clamp(2.0, 8.0) as usize;
        for (x, text) in ticks(self.x, count) {
            let (px, _) = self.at(x, self.y.0);
            line(area, &[(px, self.top), (px, self.bottom())], FAINT, 0.75)?;
            if !x_label.is_empty() {
                line(
                    area,
                    &[(px, self.bottom()), (px, self.bottom() + 4.0)],
                    INK,
                    1.0,
                )?;
                write(
                    area,
                    &text,
                    (px, self.bottom() + 13.0),
                    13.0,
                    Hang::Middle,
                    INK,
                )?;
            }
        }
        for (y, text) in self.y_ticks() {
            let (_, py) = self.at(self.x.0, y);
            line(area, &[(self.left, py), (self.right(), py)], FAINT, 0.75)?;
            if !y_label.is_empty() {
                line(area, &[(self.left - 4.0, py), (self.left, py)], INK, 1.0)?;
                write(area, &text, (self.left - 7.0, py), 13.0, Hang::Right, INK)?;
            }
        }
        let middle = self.left + 0.5 * self.width;
        write(
            area,
            x_label,
            (middle, self.bottom() + 32.0),
            15.5,
            Hang::Middle,
            INK,
        )?;
        let at = (self.left - 64.0, self.top + 0.5 * self.height);
        styled(
            area,
            y_label,
            at,
            (15.5, Hang::Middle, INK, FontTransform::Rotate270),
        )
    }

    fn frame(&self, area: &Area<'_>) -> Drawn {
        let (l, t, r, b) = (self.left, self.top, self.right(), self.bottom());
        line(area, &[(l, t), (r, t), (r, b), (l, b), (l, t)], INK, 1.0)
    }

    /// The pieces of a curve that lie within the panel, in pixels.
    fn clipped(&self, points: &[(f64, f64)]) -> Vec<Points> {
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

    fn curve(&self, area: &Area<'_>, points: &[(f64, f64)], colour: RGBColor, width: f64) -> Drawn {
        for piece in self.clipped(points) {
            line(area, &piece, colour, width)?;
        }
        Ok(())
    }

    /// The band between two curves over the same abscissae.
    fn band(&self, area: &Area<'_>, points: &[(f64, f64, f64)], colour: RGBColor) -> Drawn {
        let inside = |y: f64| y.clamp(self.y.0, self.y.1);
        let finite = points
            .iter()
            .filter(|(x, low, high)| (x + low + high).is_finite());
        let (mut upper, mut lower) = (Vec::new(), Vec::new());
        for (x, low, high) in finite {
            upper.push(self.at(*x, inside(*high)));
            lower.push(self.at(*x, inside(*low)));
        }
        upper.extend(lower.into_iter().rev());
        let corners: Vec<(i32, i32)> = upper
            .iter()
            .map(|(x, y)| ((x * FINE) as i32, (y * FINE) as i32))
            .collect();
        if corners.len() > 3 {
            area.draw(&Polygon::new(corners, colour.mix(0.22).filled()))?;
        }
        Ok(())
    }

    fn dot(&self, area: &Area<'_>, (x, y): (f64, f64), colour: RGBColor, radius: f64) -> Drawn {
        let within = x >= self.x.0 && x <= self.x.1 && y >= self.y.0 && y <= self.y.1;
        if within {
            let (px, py) = self.at(x, y);
            let (px, py) = ((px * FINE) as i32, (py * FINE) as i32);
            area.draw(&Circle::new(
                (px, py),
                (radius * FINE) as i32,
                colour.filled(),
            ))?;
        }
        Ok(())
    }

    fn circle(&self, area: &Area<'_>, (x, y): (f64, f64), colour: RGBColor) -> Drawn {
        let within = x >= self.x.0 && x <= self.x.1 && y >= self.y.0 && y <= self.y.1;
        if within {
            let (px, py) = self.at(x, y);
            let at = ((px * FINE) as i32, (py * FINE) as i32);
            let style = colour.stroke_width(FINE as u32);
            area.draw(&Circle::new(at, (2.5 * FINE) as i32, style))?;
        }
        Ok(())
    }

    /// A histogram as dots in the middle of its bins, with a band of 95 %.
    fn histogram(&self, area: &Area<'_>, it: &Histogram) -> Drawn {
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
    fn point(&self, area: &Area<'_>, x: f64, y: Estimate, colour: RGBColor) -> Drawn {
        let bar = [(x, y.value - y.error), (x, y.value + y.error)];
        self.curve(area, &bar, colour, 1.25)?;
        self.dot(area, (x, y.value), colour, 1.75)
    }

    /// A dashed line at one height.
    fn level(&self, area: &Area<'_>, y: f64, colour: RGBColor) -> Drawn {
        if y > self.y.0 && y < self.y.1 {
            dashed(
                area,
                self.at(self.x.0, y),
                self.at(self.x.1, y),
                colour,
                1.25,
            )?;
        }
        Ok(())
    }
}

/// About `count` round numbers within a range, as they are written.
fn ticks((low, high): (f64, f64), count: usize) -> Vec<(f64, String)> {
    let raw = (high - low) / count.max(1) as f64;
    let power = 10f64.powf(raw.log10().floor());
    let wide_enough = |step: &f64| *step >= raw * 0.75;
    let steps = [1.0, 2.0, 5.0, 10.0].map(|m| m * power);
    // One tick tells no scale: at least two.
    let step = steps
        .into_iter()
        .find(wide_enough)
        .filter(|step| 2.0 * step <= high - low)
        .or_else(|| steps.into_iter().rev().find(|step| !wide_enough(step)))
        .unwrap_or(raw);
    let size = low.abs().max(high.abs());
    let first = (low / step).ceil();
    // Beyond this the numbers would differ in digits that a double does not hold.
    if !(step.is_finite() && step > 0.0 && first.abs() < 1e12) {
        return Vec::new();
    }
    let plain = (1e-3..1e5).contains(&size);
    let scale = if plain {
        1.0
    } else {
        10f64.powf(size.log10().floor())
    };
    let digits = (-(step / scale).log10().floor()).clamp(0.0, 9.0) as usize;
    (0..=2 * count + 2)
        .map(|k| (first + k as f64) * step)
        .take_while(|x| *x <= high + 1e-9 * step)
        .map(|x| {
            // Rounding leaves -0.
            let x = if x.abs() < 1e-9 * step { 0.0 } else { x };
            let number = format!("{:.digits$}", x / scale);
            let text = if plain || x == 0.0 {
                number
            } else {
                format!("{number}e{}", scale.log10().round())
            };
            (x, text.replace('-', "\u{2212}"))
        })
        .collect()
}

fn superscript(k: i64) -> String {
    k.to_string()
        .chars()
        .map(|c| match c {
            '-' => '\u{207b}',
            '1' => '\u{b9}',
            '2' => '\u{b2}',
            '3' => '\u{b3}',
            digit => char::from_u32(0x2070 + digit.to_digit(10).unwrap_or(0)).unwrap_or(digit),
        })
        .collect()
}

/// A line with its words, for a legend; `x`, `y` in pixels.
fn legend(area: &Area<'_>, at: (f64, f64), colour: RGBColor, mark: Mark, words: &str) -> Drawn {
    let (x, y) = at;
    match mark {
        Mark::Line => line(area, &[(x, y), (x + 22.0, y)], colour, 2.0)?,
        Mark::Halo => line(area, &[(x, y), (x + 22.0, y)], colour, 5.0)?,
        Mark::Dashes => dashed(area, (x, y), (x + 23.0, y), colour, 1.25)?,
        Mark::Dot => {
            let centre = (((x + 11.0) * FINE) as i32, (y * FINE) as i32);
            area.draw(&Circle::new(centre, (3.0 * FINE) as i32, colour.filled()))?;
        }
    }
    write(area, words, (x + 29.0, y), 13.0, Hang::Left, INK)
}

#[derive(Clone, Copy)]
enum Mark {
    Line,
    Halo,
    Dashes,
    Dot,
}

/// A snapshot with its marginals, ready to be drawn.
struct Sheet<'a> {
    snapshot: &'a Snapshot,
    q: Vec<f64>,
    v: Vec<f64>,
    p_q: Vec<f64>,
    p_v: Vec<f64>,
    peak: f64,
}

impl<'a> Sheet<'a> {
    /// None for a density that is nowhere positive or not on a mesh.
    fn of(snapshot: &'a Snapshot) -> Option<Self> {
        let (q, v) = (snapshot.q.to_vec(), snapshot.v.to_vec());
        let fits = snapshot.p.dim() == (q.len(), v.len()) && q.len() > 1 && v.len() > 1;
        let peak = snapshot
            .p
            .iter()
            .copied()
            .filter(|p| p.is_finite())
            .fold(0.0, f64::max);
        if !fits || peak <= 0.0 {
            return None;
        }
        let (dq, dv) = (widths(&q), widths(&v));
        let sum =
            |p: ndarray::ArrayView1<'_, f64>, w: &[f64]| p.iter().zip(w).map(|(p, w)| p * w).sum();
        let p_q = snapshot
            .p
            .rows()
            .into_iter()
            .map(|row| sum(row, &dv))
            .collect();
        let p_v = snapshot
            .p
            .columns()
            .into_iter()
            .map(|column| sum(column, &dq))
            .collect();
        Some(Self {
            snapshot,
            q,
            v,
            p_q,
            p_v,
            peak,
        })
    }

    /// The part of the plane where there is anything to see.
    fn window(&self) -> ((f64, f64), (f64, f64)) {
        let seen = |p: &[f64], x: &[f64]| {
            let most = p.iter().copied().fold(0.0, f64::max);
            let there = p
                .iter()
                .zip(x)
                .filter(|(p, _)| **p > 1e-3 * most)
                .map(|(_, x)| *x);
            range(there, 0.08).unwrap_or((x[0], x[x.len() - 1]))
        };
        (seen(&self.p_q, &self.q), seen(&self.p_v, &self.v))
    }

    /// p(q, v) between the cell centres, bilinear; 0 outside.
    fn density(&self, q: (usize, f64), v: (usize, f64)) -> f64 {
        let p = |i: usize, j: usize| self.snapshot.p[[i, j]];
        let ((i, a), (j, b)) = (q, v);
        (1.0 - a) * ((1.0 - b) * p(i, j) + b * p(i, j + 1))
            + a * ((1.0 - b) * p(i + 1, j) + b * p(i + 1, j + 1))
    }

    /// Filled levels as runs of equal level, row by row. Each level is laid over the one below and each
    /// run reaches into the row beneath it, so that no seams show at any magnification.
    fn fill(&self, area: &Area<'_>, panel: &Panel) -> Drawn {
        /// Pixels.
        const ROW: f64 = 1.0;
        let rows = (panel.height / ROW).ceil() as usize;
        let columns = panel.width.ceil() as usize;
        let place = |low: f64, high: f64, part: f64| low + (high - low) * part;
        let across: Vec<Option<(usize, f64)>> = (0..=columns)
            .map(|k| {
                locate(
                    &self.q,
                    place(panel.x.0, panel.x.1, k as f64 / columns as f64),
                )
            })
            .collect();
        let mut runs: Vec<Vec<(f64, f64, f64)>> = vec![Vec::new(); LEVELS.len()];
        for row in 0..rows {
            let part = (row as f64 + 0.5) / rows as f64;
            let Some(v) = locate(&self.v, place(panel.y.1, panel.y.0, part)) else {
                continue;
            };
            let values: Vec<f64> = across
                .iter()
                .map(|q| q.map_or(0.0, |q| self.density(q, v)) / self.peak)
                .collect();
            for ((level, _), runs) in LEVELS.iter().zip(&mut runs) {
                let mut start = None;
                for (k, pair) in values.windows(2).enumerate() {
                    let (a, b) = (pair[0], pair[1]);
                    let cross = k as f64 + (level - a) / (b - a);
                    if k == 0 && a >= *level {
                        start = Some(0.0);
                    }
                    if a < *level && b >= *level {
                        start = Some(cross);
                    }
                    if a >= *level && b < *level {
                        runs.push((row as f64 * ROW, start.take().unwrap_or(0.0), cross));
                    }
                }
                if let Some(start) = start {
                    runs.push((row as f64 * ROW, start, columns as f64));
                }
            }
        }
        for ((_, colour), runs) in LEVELS.iter().zip(runs) {
            for (y, from, to) in runs {
                let bottom = (panel.top + y + ROW + 0.75).min(panel.bottom());
                let corner = |x: f64, y: f64| ((x * FINE) as i32, (y * FINE) as i32);
                let shape = [
                    corner(panel.left + from, panel.top + y),
                    corner((panel.left + to).min(panel.right()), bottom),
                ];
                area.draw(&Rectangle::new(shape, colour.filled()))?;
            }
        }
        Ok(())
    }
}

/// The cell-centre interval that holds `x`, and how far along it `x` is.
fn locate(centres: &[f64], x: f64) -> Option<(usize, f64)> {
    let k = centres.partition_point(|it| *it <= x);
    if k == 0 || k >= centres.len() {
        return None;
    }
    let (a, b) = (centres[k - 1], centres[k]);
    Some((k - 1, (x - a) / (b - a)))
}

/// The key to the levels.
fn key(area: &Area<'_>, (x, y): (f64, f64)) -> Drawn {
    write(area, "p / peak", (x, y), 12.5, Hang::Left, INK)?;
    for (k, (level, colour)) in LEVELS.iter().rev().enumerate() {
        let top = y + 10.0 + 11.0 * k as f64;
        let corner = |x: f64, y: f64| ((x * FINE) as i32, (y * FINE) as i32);
        let shape = [corner(x, top), corner(x + 20.0, top + 11.0)];
        area.draw(&Rectangle::new(shape, colour.filled()))?;
        area.draw(&Rectangle::new(shape, GREY.stroke_width(2)))?;
        write(
            area,
            &format!("{level}"),
            (x + 27.0, top + 5.5),
            11.5,
            Hang::Left,
            INK,
        )?;
    }
    Ok(())
}

/// One density with its marginals against the closed form.
fn density_picture(
    name: String,
    title: &str,
    snapshot: &Snapshot,
    results: &Results,
) -> Result<Option<File>> {
    let Some(sheet) = Sheet::of(snapshot) else {
        return Ok(None);
    };
    let law = Stationary::of(&results.scene.oscillator).ok();
    let (x, y) = sheet.window();
    let main = Panel {
        left: 92.0,
        top: 156.0,
        width: 430.0,
        height: 330.0,
        x,
        y,
        log: false,
    };
    let curve = |xs: &[f64], ps: &[f64]| {
        xs.iter()
            .copied()
            .zip(ps.iter().copied())
            .collect::<Points>()
    };
    let fine =
        |(low, high): (f64, f64)| (0..=300).map(move |k| low + (high - low) * f64::from(k) / 300.0);
    let (by_q, by_v) = (curve(&sheet.q, &sheet.p_q), curve(&sheet.v, &sheet.p_v));
    let exact = |f: &dyn Fn(&Stationary, f64) -> f64, x: (f64, f64)| -> Points {
        law.iter()
            .flat_map(|law| fine(x).map(move |x| (x, f(law, x))))
            .collect()
    };
    let (exact_q, exact_v) = (
        exact(&Stationary::density_q, x),
        exact(&Stationary::density_v, y),
    );
    let top = |a: &Points, b: &Points| {
        let most = a
            .iter()
            .chain(b)
            .map(|(_, p)| *p)
            .filter(|p| p.is_finite())
            .fold(0.0, f64::max);
        (0.0, 1.08 * most.max(1e-300))
    };
    let above = Panel {
        top: 44.0,
        height: 104.0,
        y: top(&by_q, &exact_q),
        ..main.clone()
    };
    let beside = Panel {
        left: 544.0,
        width: 104.0,
        x: top(&by_v, &exact_v),
        ..main.clone()
    };
    let file = picture(name, (730, 546), |area| {
        write(area, title, (main.left, 22.0), 15.0, Hang::Left, INK)?;
        above.axes(area, "", "p(q)")?;
        above.curve(area, &exact_q, HALO, 5.0)?;
        above.curve(area, &by_q, BLUE, 1.5)?;
        above.frame(area)?;
        beside.axes(area, "p(q\u{307})", "")?;
        let turned = |points: &Points| points.iter().map(|(v, p)| (*p, *v)).collect::<Points>();
        beside.curve(area, &turned(&exact_v), HALO, 5.0)?;
        beside.curve(area, &turned(&by_v), BLUE, 1.5)?;
        beside.frame(area)?;
        main.axes(area, "q", "q\u{307}")?;
        sheet.fill(area, &main)?;
        loss_line(area, &main, results, true)?;
        loss_line(area, &above, results, false)?;
        main.frame(area)?;
        key(area, (666.0, 168.0))?;
        legend(area, (554.0, 62.0), BLUE, Mark::Line, "on the mesh")?;
        if law.is_some() {
            legend(area, (554.0, 84.0), HALO, Mark::Halo, "stationary law")?;
        }
        Ok(())
    })?;
    Ok(Some(file))
}

/// The displacement at which contact is lost.
fn loss_line(area: &Area<'_>, panel: &Panel, results: &Results, words: bool) -> Drawn {
    if let Some(loss) = results.contact().loss_point()
        && loss > panel.x.0
        && loss < panel.x.1
    {
        dashed(
            area,
            panel.at(loss, panel.y.0),
            panel.at(loss, panel.y.1),
            GREY,
            1.0,
        )?;
        let (x, _) = panel.at(loss, panel.y.0);
        if words && x > panel.left + 70.0 {
            write(
                area,
                "contact lost",
                (x - 5.0, panel.top + 11.0),
                11.5,
                Hang::Right,
                GREY,
            )?;
        }
    }
    Ok(())
}

/// `density_<t>.svg` for every density asked for, and snapshots.svg with up to nine of them on one sheet.
///
/// # Errors
/// [`Error::Io`] for a picture that cannot be drawn.
pub fn densities(results: &Results) -> Result<Vec<File>> {
    let Some(it) = &results.transient else {
        return Ok(Vec::new());
    };
    let mut files = Vec::new();
    for snapshot in &it.densities {
        let name = format!("density_{}.svg", time_name(snapshot.t));
        let title = format!("p(q, q\u{307}) at \u{3c4} = {}", time_name(snapshot.t));
        files.extend(density_picture(name, &title, snapshot, results)?);
    }
    files.extend(snapshots(results, &it.densities)?);
    Ok(files)
}

/// Several densities on one sheet, on the same axes, each to its own peak.
fn snapshots(results: &Results, all: &[Snapshot]) -> Result<Option<File>> {
    let each = all.len().div_ceil(9).max(1);
    let mut sheets: Vec<Sheet<'_>> = all
        .iter()
        .rev()
        .step_by(each)
        .filter_map(Sheet::of)
        .collect();
    sheets.reverse();
    if sheets.len() < 2 {
        return Ok(None);
    }
    let (mut ends_q, mut ends_v) = (Vec::new(), Vec::new());
    for (q, v) in sheets.iter().map(Sheet::window) {
        ends_q.extend([q.0, q.1]);
        ends_v.extend([v.0, v.1]);
    }
    let (Some(x), Some(y)) = (range(ends_q, 0.0), range(ends_v, 0.0)) else {
        return Ok(None);
    };
    let columns = if sheets.len() == 4 {
        2
    } else {
        sheets.len().min(3)
    };
    let rows = sheets.len().div_ceil(columns);
    let (width, height) = (236.0, 190.0);
    let size = (
        (86.0 + columns as f64 * (width + 18.0) + 74.0) as u32,
        (36.0 + rows as f64 * (height + 26.0) + 40.0) as u32,
    );
    picture("snapshots.svg", size, |area| {
        write(area, "p(q, q\u{307})", (86.0, 18.0), 15.0, Hang::Left, INK)?;
        for (k, sheet) in sheets.iter().enumerate() {
            let (row, column) = (k / columns, k % columns);
            let panel = Panel {
                left: 86.0 + column as f64 * (width + 18.0),
                top: 52.0 + row as f64 * (height + 26.0),
                width,
                height,
                x,
                y,
                log: false,
            };
            let lowest = k + columns >= sheets.len();
            let (q, v) = (
                if lowest { "q" } else { "" },
                if column == 0 { "q\u{307}" } else { "" },
            );
            panel.axes(area, q, v)?;
            sheet.fill(area, &panel)?;
            loss_line(area, &panel, results, false)?;
            panel.frame(area)?;
            let title = format!("\u{3c4} = {}", time_name(sheet.snapshot.t));
            let middle = panel.left + 0.5 * width;
            write(
                area,
                &title,
                (middle, panel.top - 10.0),
                13.0,
                Hang::Middle,
                INK,
            )?;
        }
        key(area, (86.0 + columns as f64 * (width + 18.0), 62.0))
    })
    .map(Some)
}

/// steady.svg: the steady state on the mesh.
///
/// # Errors
/// [`Error::Io`] for a picture that cannot be drawn.
pub fn steady(results: &Results) -> Result<Option<File>> {
    let Some(it) = &results.steady else {
        return Ok(None);
    };
    let title = format!(
        "Stationary p(q, q\u{307}) on {} \u{d7} {} cells, L\u{b9} distance to the closed form {:.0e}",
        it.method.cells[0], it.method.cells[1], it.l1_error.value
    );
    density_picture("steady.svg".into(), &title, &it.density, results)
}

/// What force.svg shows.
struct ForceCurves {
    /// (N, p_N) of the closed form, and of the mesh.
    exact: Points,
    meshed: Points,
    /// What the mesh's points are.
    words: String,
    /// Histogram of long records.
    sampled: Option<Histogram>,
    /// The Dirac mass and the force of flight it stands at, if that is within the picture.
    dirac: Option<(Estimate, f64)>,
    /// Largest density away from the singularity just above the force of flight.
    most: f64,
}

impl ForceCurves {
    fn of(results: &Results) -> Option<Self> {
        let law = Stationary::of(&results.scene.oscillator).ok()?;
        let contact = results.contact();
        let t = results.scene.oscillator.temperature();
        let (low, high) = contact.turning_points(14.0 * t)?;
        let loss = contact.loss_point();
        let from = loss.map_or(low, |loss| loss.max(low));
        // Squares crowd the points where the density is steep, near the loss of contact.
        let exact: Points = (1..=600)
            .map(|k| from + (high - from) * (f64::from(k) / 600.0).powi(2))
            .map(|q| (contact.force(q), law.density_force(contact.force(q))))
            .filter(|(_, p)| p.is_finite())
            .collect();
        let (snapshot, words) = match (&results.steady, &results.transient) {
            (Some(it), _) => (Some(&it.density), "steady state on the mesh".to_owned()),
            (None, Some(it)) => {
                let last = it.densities.last();
                let t = last.map_or(String::new(), |it| time_name(it.t));
                (last, format!("on the mesh, \u{3c4} = {t}"))
            }
            _ => (None, String::new()),
        };
        let sheet = snapshot.and_then(Sheet::of);
        let meshed = sheet
            .iter()
            .flat_map(|sheet| sheet.q.iter().zip(&sheet.p_q))
            .filter(|(q, _)| loss.is_none_or(|loss| **q > loss))
            .map(|(q, p)| (contact.force(*q), p / contact.stiffness(*q)))
            .collect();
        let flight = loss
            .filter(|loss| *loss >= low)
            .map(|loss| contact.force(loss));
        let usual = exact
            .iter()
            .filter(|(n, _)| flight.is_none_or(|flight| *n > flight + 0.04));
        let most = usual.map(|(_, p)| *p).fold(0.0, f64::max);
        Some(Self {
            dirac: law.contact_loss_probability().zip(flight),
            exact,
            meshed,
            words,
            sampled: results.records.as_ref().map(|it| it.force.clone()),
            most,
        })
    }

    fn draw(&self, area: &Area<'_>, panel: &Panel) -> Drawn {
        panel.axes(area, "N", "p(N)")?;
        let scaled = |points: &Points| -> Points {
            let height = |p: f64| if panel.log { p.max(1e-300).log10() } else { p };
            points.iter().map(|(n, p)| (*n, height(*p))).collect()
        };
        // Dots at least four pixels apart.
        let mut last = f64::NEG_INFINITY;
        for (n, p) in scaled(&self.meshed) {
            let (px, _) = panel.at(n, p);
            if px - last >= 4.0 {
                panel.dot(area, (n, p), BLUE, 2.5)?;
                last = px;
            }
        }
        if let Some(it) = &self.sampled {
            panel.histogram(area, it)?;
        }
        panel.curve(area, &scaled(&self.exact), INK, 1.5)?;
        if let Some((mass, flight)) = self.dirac {
            let (x, _) = panel.at(flight, panel.y.0);
            let tip = panel.top + 12.0;
            line(area, &[(x, panel.bottom()), (x, tip)], VERMILION, 2.5)?;
            let head = [(x - 4.5, tip + 9.0), (x, tip), (x + 4.5, tip + 9.0)];
            line(area, &head, VERMILION, 2.5)?;
            let words = format!("Dirac mass P(N = {flight}) = {}", probability(mass));
            let words = words.replace('-', "\u{2212}");
            write(
                area,
                &words,
                (x + 11.0, tip + 4.0),
                13.0,
                Hang::Left,
                VERMILION,
            )?;
            let sampled = self.sampled.as_ref().and_then(|it| it.dirac);
            if let Some(mass) = sampled.filter(|it| it.value.is_finite()) {
                let words = format!("records: {} \u{b1} {:.0e}", probability(mass), mass.error);
                let words = words.replace("e-", "e\u{2212}");
                let at = (x + 11.0, tip + 22.0);
                write(area, &words, at, 13.0, Hang::Left, VERMILION)?;
            }
        }
        panel.frame(area)
    }
}

/// force.svg: p_N on a linear and a logarithmic scale, the Dirac mass drawn and stated.
///
/// # Errors
/// [`Error::Io`] for a picture that cannot be drawn.
pub fn force(results: &Results) -> Result<Option<File>> {
    let Some(curves) = ForceCurves::of(results).filter(|it| it.most > 0.0) else {
        return Ok(None);
    };
    let seen = curves.exact.iter().filter(|(_, p)| *p > 1e-5 * curves.most);
    let ends = seen
        .map(|(n, _)| *n)
        .chain(curves.dirac.map(|(_, flight)| flight));
    let Some(x) = range(ends, 0.05) else {
        return Ok(None);
    };
    let linear = Panel {
        left: 92.0,
        top: 44.0,
        width: 390.0,
        height: 320.0,
        x,
        y: (0.0, 1.3 * curves.most),
        log: false,
    };
    let top = curves.most.log10();
    let logarithmic = Panel {
        left: 578.0,
        y: (top - 5.0, top + 0.8),
        log: true,
        ..linear.clone()
    };
    let far = results
        .stationary
        .as_ref()
        .and_then(|it| it.get("log10_contact_loss_probability"));
    picture("force.svg", (990, 420), |area| {
        let title = "Force: stationary density p(N)";
        write(area, title, (linear.left, 22.0), 15.0, Hang::Left, INK)?;
        curves.draw(area, &linear)?;
        curves.draw(area, &logarithmic)?;
        if let Some(far) = far.filter(|_| curves.dirac.is_none()) {
            let words = format!(
                "Dirac mass, left of this picture: log\u{2081}\u{2080} P = {:.1}",
                far.value
            );
            let words = words.replace('-', "\u{2212}");
            let at = (logarithmic.left, 24.0);
            write(area, &words, at, 13.0, Hang::Left, VERMILION)?;
        }
        let right = linear.right() - 226.0;
        let mut legends = vec![(INK, Mark::Line, "closed form")];
        if !curves.meshed.is_empty() {
            legends.push((BLUE, Mark::Dot, &curves.words));
        }
        if curves.sampled.is_some() {
            legends.push((VERMILION, Mark::Dot, "long records, band: 95 %"));
        }
        // Below what is said of the Dirac mass.
        let top = match (curves.dirac, &curves.sampled) {
            (None, _) => 62.0,
            (Some(_), None) => 82.0,
            (Some(_), Some(_)) => 101.0,
        };
        for (k, (colour, mark, words)) in legends.into_iter().enumerate() {
            legend(area, (right, top + 19.0 * k as f64), colour, mark, words)?;
        }
        Ok(())
    })
    .map(Some)
}

/// survival.svg: survival until the first loss of contact, and its density on a logarithmic scale, from
/// the backward equation and from paths.
///
/// # Errors
/// [`Error::Io`] for a picture that cannot be drawn.
pub fn survival(results: &Results) -> Result<Option<File>> {
    let Some(it) = &results.first_loss else {
        return Ok(None);
    };
    let paths = results.first_loss_paths.as_ref();
    let until = it.times[it.times.len() - 1];
    let points = |curve: &[Estimate], log: bool| -> Points {
        let height = |p: f64| if log { p.max(1e-300).log10() } else { p };
        let values = curve.iter().map(|p| height(p.value));
        it.times.iter().copied().zip(values).collect()
    };
    let linear = points(&it.survival, false);
    let logarithmic = points(&it.density, true);
    // Whatever is on the way to the peak, six decades at the most.
    let top = logarithmic
        .iter()
        .map(|(_, y)| *y)
        .fold(f64::NEG_INFINITY, f64::max);
    let bottom = logarithmic
        .iter()
        .map(|(_, y)| *y)
        .fold(f64::INFINITY, f64::min);
    let (Some(y), true) = (range(linear.iter().map(|(_, s)| *s), 0.08), top > -299.0) else {
        return Ok(None);
    };
    let left = Panel {
        left: 92.0,
        top: 44.0,
        width: 390.0,
        height: 320.0,
        x: (0.0, until),
        y,
        log: false,
    };
    let right = Panel {
        left: 578.0,
        y: (bottom.max(top - 6.0) - 0.4, top + 0.4),
        log: true,
        ..left.clone()
    };
    picture("survival.svg", (990, 420), |area| {
        let title = "First loss of contact: survival, and density of its time";
        write(area, title, (left.left, 22.0), 15.0, Hang::Left, INK)?;
        left.axes(area, "\u{3c4}", "survival")?;
        right.axes(area, "\u{3c4}", "density")?;
        left.curve(area, &linear, BLUE, 1.5)?;
        right.curve(area, &logarithmic, BLUE, 1.5)?;
        if let Some(paths) = paths {
            // Dots apart enough to be told from each other.
            let each = paths.times.len().div_ceil(40);
            for (k, t) in paths.times.iter().enumerate().skip(each).step_by(each) {
                let s = paths.survival[k];
                if s.value >= left.y.0 && s.value <= left.y.1 {
                    left.dot(area, (*t, s.value), VERMILION, 2.0)?;
                }
                // A mean since the time before stands in the middle.
                let middle = 0.5 * (t + paths.times[k - 1]);
                let y = paths.density[k].value.max(1e-300).log10();
                if y >= right.y.0 && y <= right.y.1 {
                    right.dot(area, (middle, y), VERMILION, 2.0)?;
                }
            }
        }
        left.frame(area)?;
        right.frame(area)?;
        let x = left.right() - 172.0;
        legend(area, (x, 62.0), BLUE, Mark::Line, "backward equation")?;
        if paths.is_some() {
            legend(area, (x, 81.0), VERMILION, Mark::Dot, "paths")?;
        }
        Ok(())
    })
    .map(Some)
}

/// flights.svg: the density of the time from a loss of contact to the return, from long records, and what
/// it would be without noise and friction in flight, and the law of the first return where it is solved.
///
/// # Errors
/// [`Error::Io`] for a picture that cannot be drawn.
pub fn flights(results: &Results) -> Result<Option<File>> {
    let seen = results.sampled_crossings().zip(results.sampled_flights());
    let law = results.flights.as_ref();
    if seen.is_none() && law.is_none() {
        return Ok(None);
    }
    let contact = results.contact();
    let Some(fall) = contact.loss_point().map(|loss| -contact.force(loss)) else {
        return Ok(None);
    };
    // The speed of a loss has the Rayleigh law of scale sqrt(T), and a free flight lasts 2 v/fall.
    let scale = 2.0 * results.scene.oscillator.temperature().sqrt() / fall;
    let free = |t: f64| t / (scale * scale) * (-0.5 * (t / scale).powi(2)).exp();
    let end = 4.5 * scale;
    let ballistic: Points = (0..=300)
        .map(|k| end * f64::from(k) / 300.0)
        .map(|t| (t, free(t)))
        .collect();
    let sampled = seen.iter().flat_map(|(_, it)| centres(it).zip(&it.density));
    let tops = sampled.filter(|(t, _)| *t <= end);
    let tops = tops.map(|(_, p)| p.value + 1.96 * p.error);
    let noisy: Points = law.map_or(Vec::new(), |it| {
        let density = it.density.iter().map(|p| p.value);
        it.times.iter().copied().zip(density).collect()
    });
    let shown = noisy.iter().filter(|(t, _)| *t <= end).map(|it| it.1);
    let most = tops.chain(shown).chain([free(scale)]).fold(0.0, f64::max);
    if !(most.is_finite() && end.is_finite()) {
        return Ok(None);
    }
    let panel = Panel {
        left: 92.0,
        top: 44.0,
        width: 470.0,
        height: 320.0,
        x: (0.0, end),
        y: (0.0, 1.12 * most),
        log: false,
    };
    picture("flights.svg", (590, 420), |area| {
        let title = match &seen {
            Some(((seen, _), _)) => {
                format!("Time of flight: density, {} losses of contact", seen.losses)
            }
            None => "Time of flight: density".into(),
        };
        write(area, &title, (panel.left, 22.0), 15.0, Hang::Left, INK)?;
        panel.axes(area, "time from loss to return, \u{3c4}", "density")?;
        if let Some((_, it)) = &seen {
            panel.histogram(area, it)?;
        }
        panel.curve(area, &noisy, BLUE, 1.5)?;
        for pair in panel.clipped(&ballistic).concat().windows(2).step_by(2) {
            line(area, pair, INK, 1.25)?;
        }
        panel.frame(area)?;
        let x = panel.right() - 232.0;
        legend(
            area,
            (x, 62.0),
            BLUE,
            Mark::Line,
            "first return, closed form",
        )?;
        let words = "no noise, no friction in flight";
        legend(area, (x, 81.0), INK, Mark::Dashes, words)?;
        if seen.is_some() {
            let words = "long records, band: 95 %";
            legend(area, (x, 100.0), VERMILION, Mark::Dot, words)?;
        }
        Ok(())
    })
    .map(Some)
}

/// spectrum.svg: the one-sided spectrum, logarithmic, against omega or hertz; from the resolvent, by
/// Welch's method with its 95 % band, and of the linear oscillator.
///
/// # Errors
/// [`Error::Io`] for a picture that cannot be drawn.
pub fn spectrum(results: &Results) -> Result<Option<File>> {
    let Some(it) = results
        .spectrum
        .as_ref()
        .filter(|it| it.solved.omega.len() > 1)
    else {
        return Ok(None);
    };
    let force = it.solved.quantity == Quantity::Force;
    let (scale, hertz, x_label, y_label) = match &results.scene.rig {
        None if force => (1.0, 1.0, "\u{3c9}", "spectrum of the force"),
        None => (1.0, 1.0, "\u{3c9}", "spectrum of the displacement"),
        Some(rig) if force => (
            per_hertz(rig),
            rig.hertz(1.0),
            "frequency, Hz",
            "force, N\u{b2}/Hz",
        ),
        Some(rig) => (
            displacement_per_hertz(rig),
            rig.hertz(1.0),
            "frequency, Hz",
            "displacement, \u{b5}m\u{b2}/Hz",
        ),
    };
    let log = |g: f64| (g * scale).log10();
    let x: Vec<f64> = it.solved.omega.iter().map(|w| w * hertz).collect();
    let curve = |values: &mut dyn Iterator<Item = f64>| -> Points {
        x.iter().copied().zip(values.map(log)).collect()
    };
    let solved = curve(&mut it.solved.density.iter().map(|it| it.value));
    let linear = curve(&mut it.linear.iter().copied());
    let heights = solved.iter().chain(&linear).map(|(_, y)| *y);
    let Some((low, high)) = range(heights, 0.06) else {
        return Ok(None);
    };
    let panel = Panel {
        left: 92.0,
        top: 44.0,
        width: 640.0,
        height: 360.0,
        x: (0.0, x[x.len() - 1]),
        y: (low, high),
        log: true,
    };
    picture("spectrum.svg", (760, 462), |area| {
        let title = format!(
            "One-sided spectrum, {} contact, h = {}",
            results.contact().name(),
            results.scene.oscillator.h()
        );
        write(area, &title, (panel.left, 22.0), 15.0, Hang::Left, INK)?;
        panel.axes(area, x_label, y_label)?;
        panel.curve(area, &linear, GREY, 1.0)?;
        let x_legend = panel.right() - 282.0;
        let mut y_legend = 62.0;
        let mut entry = |colour, mark, words: &str| {
            let drawn = legend(area, (x_legend, y_legend), colour, mark, words);
            y_legend += 19.0;
            drawn
        };
        if let Some(sampled) = &it.sampled {
            let bands = x.iter().zip(&sampled.density);
            let bands: Vec<(f64, f64, f64)> = bands
                .map(|(x, g)| {
                    let reach = 1.96 * g.error;
                    (*x, log(g.value - reach), log(g.value + reach))
                })
                .collect();
            panel.band(area, &bands, VERMILION)?;
            let welch = curve(&mut sampled.density.iter().map(|it| it.value));
            panel.curve(area, &welch, VERMILION, 0.75)?;
        }
        panel.curve(area, &solved, BLUE, 1.5)?;
        panel.frame(area)?;
        entry(BLUE, Mark::Line, "Fokker-Planck")?;
        if let Some(sampled) = &it.sampled {
            let words = format!("Monte Carlo, {} averages, 95 %", sampled.averages);
            entry(VERMILION, Mark::Line, &words)?;
        }
        entry(GREY, Mark::Line, "linear oscillator")
    })
    .map(Some)
}

fn probability(mass: Estimate) -> String {
    if mass.value == 0.0 {
        "0 (underflows)".into()
    } else if mass.value < 1e-3 {
        format!("{:.3e}", mass.value)
    } else {
        format!("{:.4}", mass.value)
    }
}

/// moments.svg: moments against time with error bands, and Monte Carlo points.
///
/// # Errors
/// [`Error::Io`] for a picture that cannot be drawn.
pub fn moments(results: &Results) -> Result<Option<File>> {
    let Some(it) = results.transient.as_ref().filter(|it| it.times.len() > 1) else {
        return Ok(None);
    };
    let loses = it
        .moments
        .iter()
        .any(|it| it.contact_loss_probability.is_some());
    let names = [
        ("mean_q", "E[q]"),
        ("var_v", "Var q\u{307}"),
        ("std_force", "\u{3c3}(N)"),
        if loses {
            ("contact_loss_probability", "P(contact lost)")
        } else {
            ("var_q", "Var q")
        },
    ];
    let Some(x) = range(it.times.iter().copied().chain([0.0]), 0.0) else {
        return Ok(None);
    };
    picture("moments.svg", (958, 640), |area| {
        for (k, (name, label)) in names.into_iter().enumerate() {
            let series = |times: &[f64], moments: &[Moments]| -> Vec<(f64, Estimate)> {
                let points = times.iter().zip(moments);
                points
                    .filter_map(|(t, it)| Some((*t, it.get(name)?)))
                    .collect()
            };
            let mesh = series(&it.times, &it.moments);
            let paths = results.monte_carlo.as_ref();
            let paths = paths.map_or(Vec::new(), |it| series(&it.times, &it.moments));
            let level = results
                .stationary
                .as_ref()
                .and_then(|it| it.get(name))
                .map(|it| it.value);
            let Some(y) = heights(&[&mesh, &paths], level) else {
                continue;
            };
            let panel = Panel {
                left: 92.0 + 478.0 * (k % 2) as f64,
                top: 44.0 + 298.0 * (k / 2) as f64,
                width: 374.0,
                height: 236.0,
                x,
                y,
                log: false,
            };
            panel.axes(area, "\u{3c4}", label)?;
            if let Some(level) = level {
                panel.level(area, level, INK)?;
            }
            let band: Vec<(f64, f64, f64)> = mesh
                .iter()
                .map(|(t, y)| (*t, y.value - y.error, y.value + y.error))
                .collect();
            panel.band(area, &band, BLUE)?;
            let curve: Points = mesh.iter().map(|(t, y)| (*t, y.value)).collect();
            panel.curve(area, &curve, BLUE, 1.5)?;
            for (t, y) in thinned(&paths) {
                panel.point(area, t, y, VERMILION)?;
            }
            panel.frame(area)?;
        }
        legend(
            area,
            (92.0, 20.0),
            BLUE,
            Mark::Line,
            "Fokker-Planck, band: its error",
        )?;
        if results.monte_carlo.is_some() {
            let words = "Monte Carlo, bar: one standard error";
            legend(area, (330.0, 20.0), VERMILION, Mark::Dot, words)?;
        }
        if results.stationary.is_some() {
            legend(
                area,
                (640.0, 20.0),
                INK,
                Mark::Dashes,
                "stationary, closed form",
            )?;
        }
        Ok(())
    })
    .map(Some)
}

/// The range of values, widened by their errors, but by no more than as much again: a band that is
/// wider than the motion is cut.
fn heights(curves: &[&[(f64, Estimate)]], level: Option<f64>) -> Option<(f64, f64)> {
    let all = || curves.iter().copied().flatten().map(|(_, y)| y);
    let errors = || all().map(|y| y.error).filter(|error| error.is_finite());
    let widest = errors().fold(0.0, f64::max);
    let first = all().map(|y| y.value).next()?;
    if widest > 0.0 && all().map(|y| y.value).chain(level).all(|y| y == first) {
        return range([first - widest, first + widest], 0.08);
    }
    let (low, high) = range(all().map(|y| y.value).chain(level), 0.0)?;
    let room = high - low;
    let ends = all().flat_map(|y| [y.value - y.error, y.value + y.error]);
    let ends = ends.map(|y| y.clamp(low - room, high + room));
    range(ends.chain(level), 0.08)
}

/// At most 120 points, the last among them.
fn thinned(points: &[(f64, Estimate)]) -> impl Iterator<Item = (f64, Estimate)> + '_ {
    let each = points.len().div_ceil(120).max(1);
    points.iter().rev().step_by(each).copied()
}

/// approach.svg: the distance to the stationary law against time, with the slowest decay rate's line,
/// and the marching to the steady state beside it.
///
/// # Errors
/// [`Error::Io`] for a picture that cannot be drawn.
pub fn approach(results: &Results) -> Result<Option<File>> {
    let log = |points: &mut dyn Iterator<Item = (f64, f64)>| -> Points {
        points
            .filter(|(_, y)| *y > 0.0 && y.is_finite())
            .map(|(t, y)| (t, y.log10()))
            .collect()
    };
    let (mut distance, mut entropy) = (Points::new(), Points::new());
    if let Some(it) = &results.transient {
        let curve = |numbers: &[Option<Estimate>]| {
            let pairs = it.times.iter().zip(numbers);
            log(&mut pairs.filter_map(|(t, y)| Some((*t, y.as_ref()?.value))))
        };
        (distance, entropy) = (curve(&it.distance), curve(&it.relative_entropy));
    }
    let marched = results
        .steady
        .as_ref()
        .map(|it| log(&mut it.approach.iter().copied()));
    let marched = marched.unwrap_or_default();
    let panel = |left: f64, curves: [&Points; 2]| {
        let all = || curves.into_iter().flatten();
        let x = range(all().map(|(t, _)| *t).chain([0.0]), 0.0)?;
        let (low, high) = range(all().map(|(_, y)| *y), 0.05)?;
        // Sixteen decades down there is only rounding.
        let y = (low.floor().max(high.ceil() - 17.0), high.ceil());
        let enough = curves.iter().any(|curve| curve.len() > 1) && y.1 > y.0;
        enough.then_some(Panel {
            left,
            top: 44.0,
            width: 374.0,
            height: 320.0,
            x,
            y,
            log: true,
        })
    };
    let first = panel(92.0, [&distance, &entropy]);
    let left = if first.is_some() { 570.0 } else { 92.0 };
    let second = panel(left, [&marched, &Points::new()]);
    let Some(last) = second.as_ref().or(first.as_ref()) else {
        return Ok(None);
    };
    let size = ((last.right() + 28.0) as u32, 420);
    let slowest = results.decay_rates.as_ref().and_then(|rates| rates.first());
    picture("approach.svg", size, |area| {
        if let Some(panel) = &first {
            write(
                area,
                "Approach to the stationary law",
                (panel.left, 22.0),
                15.0,
                Hang::Left,
                INK,
            )?;
            panel.axes(area, "\u{3c4}", "distance to (21)")?;
            panel.curve(area, &distance, BLUE, 2.0)?;
            panel.curve(area, &entropy, VERMILION, 2.0)?;
            let (x, y) = (panel.right() - 246.0, panel.top + 16.0);
            let mut legends = vec![(BLUE, Mark::Line, "L\u{b9} distance".to_owned())];
            if !entropy.is_empty() {
                legends.push((VERMILION, Mark::Line, "relative entropy".into()));
            }
            if let Some((rate, (t, end))) = slowest.zip(distance.get(distance.len() * 2 / 3)) {
                let slope = rate.re / std::f64::consts::LN_10;
                let at = |x: f64| (x, end + slope * (x - t));
                if let Some((a, b)) = panel.clip(at(panel.x.0), at(panel.x.1)) {
                    dashed(area, panel.at(a.0, a.1), panel.at(b.0, b.1), GREEN, 1.5)?;
                    let words = format!("slowest mode, rate {:.6}", rate.re);
                    legends.push((GREEN, Mark::Dashes, words.replace('-', "\u{2212}")));
                }
            }
            panel.frame(area)?;
            for (k, (colour, mark, words)) in legends.into_iter().enumerate() {
                legend(area, (x, y + 18.0 * k as f64), colour, mark, &words)?;
            }
        }
        if let Some(panel) = &second {
            write(
                area,
                "Marching to the steady state",
                (panel.left, 22.0),
                15.0,
                Hang::Left,
                INK,
            )?;
            panel.axes(area, "\u{3c4}", "L\u{b9} distance to (21)")?;
            panel.curve(area, &marched, BLUE, 2.0)?;
            panel.frame(area)?;
        }
        Ok(())
    })
    .map(Some)
}

/// A colour of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// Closed forms.
    Black,
    /// The Fokker-Planck equation.
    Blue,
    /// Monte Carlo.
    Vermilion,
    /// Anything else.
    Green,
    /// What is compared with.
    Grey,
}

/// How a curve is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// A line.
    Line,
    /// A thick line.
    Thick,
    /// A dashed line.
    Dashes,
    /// Open circles.
    Circles,
}

/// A curve of a [`Chart`].
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Its words in the legend; none for an empty text.
    pub words: String,
    /// Its colour.
    pub ink: Ink,
    /// How it is drawn.
    pub stroke: Stroke,
    /// Its points; y as a decimal logarithm where the chart is logarithmic.
    pub points: Vec<(f64, f64)>,
}

impl Curve {
    /// A curve from its parts.
    pub fn new(words: &str, ink: Ink, stroke: Stroke, points: Vec<(f64, f64)>) -> Self {
        Self {
            words: words.to_owned(),
            ink,
            stroke,
            points,
        }
    }
}

/// Axes with curves.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Above it.
    pub title: String,
    /// Below it.
    pub x_label: String,
    /// Left of it.
    pub y_label: String,
    /// Range of x.
    pub x: (f64, f64),
    /// Range of y; decimal logarithms where `log`.
    pub y: (f64, f64),
    /// Whether y is a decimal logarithm.
    pub log: bool,
    /// Its curves.
    pub curves: Vec<Curve>,
}

/// Charts side by side in so many columns, the legend of the one with most curves on top.
///
/// # Errors
/// [`Error::Io`] for a picture that cannot be drawn.
pub fn charts(name: &str, columns: usize, charts: &[Chart]) -> Result<File> {
    let columns = columns.clamp(1, charts.len().max(1));
    let rows = charts.len().div_ceil(columns);
    let (width, height) = if columns == 1 {
        (800.0, 140.0)
    } else {
        (290.0, 250.0)
    };
    let (across, down) = (width + 106.0, height + 88.0);
    let size = (
        (across * columns as f64 + 16.0) as u32,
        (down * rows as f64 + 34.0) as u32,
    );
    picture(name, size, |area| {
        for (k, chart) in charts.iter().enumerate() {
            let panel = Panel {
                left: 92.0 + across * (k % columns) as f64,
                top: 64.0 + down * (k / columns) as f64,
                width,
                height,
                x: chart.x,
                y: chart.y,
                log: chart.log,
            };
            let letter = (b'a' + (k % 26) as u8) as char;
            let title = format!("({letter}) {}", chart.title);
            write(
                area,
                &title,
                (panel.left, panel.top - 13.0),
                13.5,
                Hang::Left,
                INK,
            )?;
            panel.axes(area, &chart.x_label, &chart.y_label)?;
            for curve in &chart.curves {
                let colour = curve.ink.colour();
                match curve.stroke {
                    Stroke::Line => panel.curve(area, &curve.points, colour, 1.25)?,
                    Stroke::Thick => panel.curve(area, &curve.points, colour, 3.5)?,
                    Stroke::Dashes => {
                        for piece in panel.clipped(&curve.points) {
                            for ends in piece.windows(2) {
                                dashed(area, ends[0], ends[1], colour, 1.25)?;
                            }
                        }
                    }
                    Stroke::Circles => {
                        for point in &curve.points {
                            panel.circle(area, *point, colour)?;
                        }
                    }
                }
            }
            panel.frame(area)?;
        }
        let fullest = charts.iter().max_by_key(|chart| chart.curves.len());
        let named = fullest.into_iter().flat_map(|chart| &chart.curves);
        let mut x = 92.0;
        for curve in named.filter(|curve| !curve.words.is_empty()) {
            let mark = match curve.stroke {
                Stroke::Line => Mark::Line,
                Stroke::Thick => Mark::Halo,
                Stroke::Dashes => Mark::Dashes,
                Stroke::Circles => Mark::Dot,
            };
            legend(area, (x, 18.0), curve.ink.colour(), mark, &curve.words)?;
            // An advance of the font is about 0.56 of its size.
            x += 52.0 + 7.6 * curve.words.chars().count() as f64;
        }
        Ok(())
    })
}

impl Ink {
    fn colour(self) -> RGBColor {
        match self {
            Self::Black => INK,
            Self::Blue => BLUE,
            Self::Vermilion => VERMILION,
            Self::Green => GREEN,
            Self::Grey => GREY,
        }
    }
}

/// A chart with logarithmic axes.
#[derive(Debug, Clone)]
pub struct LogChart {
    /// Label of the abscissa.
    pub x: String,
    /// Label of the ordinate.
    pub y: String,
    /// What it shows.
    pub curves: Vec<LogCurve>,
}

/// A curve of a [`LogChart`], with its marks.
#[derive(Debug, Clone)]
pub struct LogCurve {
    /// Its name in the legend; curves of one name have one colour in all charts of a picture.
    pub name: String,
    /// Points, both coordinates positive; others are left out.
    pub points: Vec<(f64, f64)>,
    /// Whether its marks are joined by thin lines.
    pub dashed: bool,
}

/// Okabe and Ito's colours and some between them, for many curves.
const MANY: [RGBColor; 12] = [
    BLUE,
    VERMILION,
    GREEN,
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    INK,
    RGBColor(140, 86, 75),
    RGBColor(148, 103, 189),
    RGBColor(150, 150, 30),
    RGBColor(0, 90, 70),
    GREY,
];

/// Charts with logarithmic axes under one title, two in a row, one legend for all.
///
/// # Errors
/// [`Error::Io`] for a picture that cannot be drawn.
pub fn log_log(name: impl Into<String>, title: &str, charts: &[LogChart]) -> Result<File> {
    let mut names: Vec<&str> = Vec::new();
    for curve in charts.iter().flat_map(|chart| &chart.curves) {
        if !names.contains(&curve.name.as_str()) {
            names.push(&curve.name);
        }
    }
    let (width, height) = (640.0, 400.0);
    let columns = charts.len().clamp(1, 2);
    let below = 20.0 + height * charts.len().div_ceil(columns) as f64;
    let rows = names.len().div_ceil(5);
    let size = (
        (width * columns as f64 + 30.0) as u32,
        (below + 22.0 * rows as f64) as u32,
    );
    let logs = |curve: &LogCurve| -> Points {
        let positive = curve.points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0);
        positive.map(|(x, y)| (x.log10(), y.log10())).collect()
    };
    picture(name, size, |area| {
        write(area, title, (30.0, 20.0), 16.0, Hang::Left, INK)?;
        for (k, chart) in charts.iter().enumerate() {
            let all: Points = chart.curves.iter().flat_map(logs).collect();
            let (Some(x), Some(y)) = (
                range(all.iter().map(|p| p.0), 0.05),
                range(all.iter().map(|p| p.1), 0.05),
            ) else {
                continue;
            };
            let panel = Panel {
                left: 92.0 + width * (k % columns) as f64,
                top: 40.0 + height * (k / columns) as f64,
                width: width - 110.0,
                height: height - 80.0,
                x,
                y,
                log: true,
            };
            log_axes(area, &panel, &chart.x, &chart.y)?;
            for curve in &chart.curves {
                let place = names.iter().position(|it| *it == curve.name).unwrap_or(0);
                let colour = MANY[place % MANY.len()];
                let points = logs(curve);
                let thick = if curve.dashed { 0.75 } else { 1.75 };
                panel.curve(area, &points, colour, thick)?;
                for point in points {
                    panel.dot(area, point, colour, 2.75)?;
                }
            }
            panel.frame(area)?;
        }
        for (k, words) in names.iter().enumerate() {
            let step = f64::from(size.0) / 5.2;
            let at = (
                30.0 + step * (k % 5) as f64,
                below - 5.0 + 22.0 * (k / 5) as f64,
            );
            legend(area, at, MANY[k % MANY.len()], Mark::Line, words)?;
        }
        Ok(())
    })
}

/// Axes whose both numbers are decimal logarithms.
fn log_axes(area: &Area<'_>, panel: &Panel, x_label: &str, y_label: &str) -> Drawn {
    let bare = Panel {
        x: (0.0, 0.0),
        ..panel.clone()
    };
    // Without a range of x the panel draws no grid along it.
    bare.axes(area, x_label, y_label)?;
    let (low, high) = (panel.x.0.ceil() as i64, panel.x.1.floor() as i64);
    for k in low..=high {
        let (px, _) = panel.at(k as f64, panel.y.0);
        line(area, &[(px, panel.top), (px, panel.bottom())], FAINT, 0.75)?;
        let text = format!("10{}", superscript(k));
        write(
            area,
            &text,
            (px, panel.bottom() + 13.0),
            13.0,
            Hang::Middle,
            INK,
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_within_the_range() {
        let texts = |range| {
            ticks(range, 5)
                .into_iter()
                .map(|it| it.1)
                .collect::<Vec<_>>()
        };
        assert_eq!(
            texts((0.0, 1.0)),
            ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]
        );
        assert_eq!(
            texts((-2.1, 2.1)),
            ["\u{2212}2", "\u{2212}1", "0", "1", "2"]
        );
        assert!(ticks((-0.048, 0.048), 3).len() > 1);
        assert!(ticks((1e300, 1e301), 5).len() < 13);
        assert!(ticks((1.0, 1.0), 5).is_empty() && ticks((f64::NAN, 1.0), 5).is_empty());
    }

    #[test]
    fn a_curve_is_cut_where_it_leaves_its_panel() {
        let panel = Panel {
            left: 0.0,
            top: 0.0,
            width: 10.0,
            height: 10.0,
            x: (0.0, 10.0),
            y: (0.0, 10.0),
            log: false,
        };
        let zigzag = [
            (0.0, 5.0),
            (2.0, 5.0),
            (4.0, 25.0),
            (6.0, 5.0),
            (8.0, f64::NAN),
            (9.0, 1.0),
        ];
        let pieces = panel.clipped(&zigzag);
        assert_eq!(pieces.len(), 2, "{pieces:?}");
        assert!(
            pieces
                .iter()
                .flatten()
                .all(|(_, y)| (0.0..=10.0).contains(y))
        );
    }
}
