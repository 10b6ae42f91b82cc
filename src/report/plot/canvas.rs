//! What every picture is drawn with: colours, text, panels with their axes, legends.

use crate::error::Error;
use crate::error::Result;
use crate::estimate::Estimate;
use crate::monte_carlo::Histogram;
use crate::report::File;
use crate::results::centres;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::path::PathBuf;

pub(super) const BLUE: RGBColor = RGBColor(0, 114, 178);
pub(super) const VERMILION: RGBColor = RGBColor(213, 94, 0);
pub(super) const GREEN: RGBColor = RGBColor(0, 158, 115);
pub(super) const INK: RGBColor = RGBColor(25, 25, 25);
pub(super) const GREY: RGBColor = RGBColor(120, 120, 120);
/// Under a curve, for what it should coincide with.
pub(super) const HALO: RGBColor = RGBColor(190, 190, 190);
pub(super) const FAINT: RGBColor = RGBColor(228, 228, 228);

/// Levels of a density as fractions of its peak, and their colours, light to dark (ColorBrewer YlGnBu,
/// safe for colour-blind eyes and in grey).
pub(super) const LEVELS: [(f64, RGBColor); 9] = [
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
pub(super) const FINE: f64 = 4.0;
pub(super) type Colour = RGBColor;
pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub(super) type Drawn = std::result::Result<(), Box<dyn std::error::Error>>;
pub(super) type Points = Vec<(f64, f64)>;

/// A picture of that size in pixels.
pub(super) fn picture(
    name: impl Into<String>,
    size: (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Drawn,
) -> Result<File> {
    let name = name.into();
    let mut svg = String::new();
    let units = |pixels: u32| pixels * FINE as u32;
    let drawn = (|| {
        let area = SVGBackend::with_string(&mut svg, (units(size.0), units(size.1)));
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
    let drawn = format!("width=\"{}\" height=\"{}\"", units(size.0), units(size.1));
    let shown = format!("width=\"{}\" height=\"{}\"", size.0, size.1);
    Ok(File::text(name, svg.replacen(&drawn, &shown, 1)))
}

/// A place in drawing units.
fn fine((x, y): (f64, f64)) -> (i32, i32) {
    ((x * FINE) as i32, (y * FINE) as i32)
}

/// Where a text hangs on its point.
#[derive(Clone, Copy)]
pub(super) enum Hang {
    Left,
    Middle,
    Right,
}

/// Size in pixels, where it hangs, colour.
pub(super) type Font = (f64, Hang, Colour);

pub(super) const TITLE: Font = (15.0, Hang::Left, INK);
pub(super) const WORDS: Font = (13.0, Hang::Left, INK);
pub(super) const CENTRED: Font = (13.0, Hang::Middle, INK);
/// Of Monte Carlo, or of the Dirac mass.
pub(super) const NOTE: Font = (13.0, Hang::Left, VERMILION);

/// A line of text, its vertical middle at `y`; places in pixels.
pub(super) fn write(area: &Area<'_>, text: &str, at: (f64, f64), font: Font) -> Drawn {
    styled(area, text, at, font, FontTransform::None)
}

fn styled(
    area: &Area<'_>,
    text: &str,
    at: (f64, f64),
    (size, hang, colour): Font,
    turn: FontTransform,
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
    area.draw_text(text, &style, fine(at))?;
    Ok(())
}

pub(super) fn line(area: &Area<'_>, points: &[(f64, f64)], colour: RGBColor, width: f64) -> Drawn {
    let points: Vec<(i32, i32)> = points.iter().copied().map(fine).collect();
    let style = colour.stroke_width((width * FINE) as u32);
    area.draw(&PathElement::new(points, style))?;
    Ok(())
}

/// A filled rectangle between two corners, with a thin edge where one is given.
pub(super) fn rectangle(
    area: &Area<'_>,
    corners: [(f64, f64); 2],
    colour: RGBColor,
    edge: Option<RGBColor>,
) -> Drawn {
    let corners = corners.map(fine);
    area.draw(&Rectangle::new(corners, colour.filled()))?;
    if let Some(edge) = edge {
        area.draw(&Rectangle::new(corners, edge.stroke_width(2)))?;
    }
    Ok(())
}

/// A dashed line through points in pixels.
pub(super) fn dashed(
    area: &Area<'_>,
    points: &[(f64, f64)],
    colour: RGBColor,
    width: f64,
) -> Drawn {
    const DASH: f64 = 5.0;
    const GAP: f64 = 4.0;
    // How far into dash and gap the pen is, and the dash so far.
    let (mut s, mut dash) = (0.0, Vec::new());
    for ends in points.windows(2) {
        let (from, to) = (ends[0], ends[1]);
        let length = (to.0 - from.0).hypot(to.1 - from.1);
        if !length.is_finite() {
            continue;
        }
        let at = |part: f64| {
            (
                from.0 + (to.0 - from.0) * part,
                from.1 + (to.1 - from.1) * part,
            )
        };
        let mut gone = 0.0;
        while gone < length {
            let drawn = s < DASH;
            let step = (if drawn { DASH } else { DASH + GAP } - s).min(length - gone);
            if drawn && dash.is_empty() {
                dash.push(at(gone / length));
            }
            gone += step;
            s += step;
            if drawn {
                dash.push(at((gone / length).min(1.0)));
            }
            if s >= DASH && !dash.is_empty() {
                line(area, &dash, colour, width)?;
                dash.clear();
            }
            if s >= DASH + GAP {
                s = 0.0;
            }
        }
    }
    if dash.len() > 1 {
        line(area, &dash, colour, width)?;
    }
    Ok(())
}

/// A range that holds every finite number, widened by a share of it; None without two different ones.
pub(super) fn range(numbers: impl IntoIterator<Item = f64>, share: f64) -> Option<(f64, f64)> {
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
pub(super) struct Panel {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) x: (f64, f64),
    pub(super) y: (f64, f64),
    /// y is a decimal logarithm.
    pub(super) log: bool,
}

impl Panel {
    /// Linear axes at [left, top, width, height].
    pub(super) fn new(place: [f64; 4], x: (f64, f64), y: (f64, f64)) -> Self {
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
    pub(super) fn logarithmic(self, log: bool) -> Self {
        Self { log, ..self }
    }

    pub(super) fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let part = |x: f64, (low, high): (f64, f64)| (x - low) / (high - low);
        (
            self.left + self.width * part(x, self.x),
            self.top + self.height * (1.0 - part(y, self.y)),
        )
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    pub(super) fn right(&self) -> f64 {
        self.left + self.width
    }

    pub(super) fn y_ticks(&self) -> Vec<(f64, String)> {
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
    pub(super) fn axes(&self, area: &Area<'_>, x_label: &str, y_label: &str) -> Drawn {
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
                write(area, &text, (px, self.bottom() + 13.0), CENTRED)?;
            }
        }
        for (y, text) in self.y_ticks() {
            let (_, py) = self.at(self.x.0, y);
            line(area, &[(self.left, py), (self.right(), py)], FAINT, 0.75)?;
            if !y_label.is_empty() {
                line(area, &[(self.left - 4.0, py), (self.left, py)], INK, 1.0)?;
                write(area, &text, (self.left - 7.0, py), (13.0, Hang::Right, INK))?;
            }
        }
        self.labels(area, x_label, y_label)
    }

    /// Words below and left of it.
    pub(super) fn labels(&self, area: &Area<'_>, x_label: &str, y_label: &str) -> Drawn {
        let middle = self.left + 0.5 * self.width;
        write(
            area,
            x_label,
            (middle, self.bottom() + 32.0),
            (15.5, Hang::Middle, INK),
        )?;
        let at = (self.left - 64.0, self.top + 0.5 * self.height);
        styled(
            area,
            y_label,
            at,
            (15.5, Hang::Middle, INK),
            FontTransform::Rotate270,
        )
    }

    pub(super) fn frame(&self, area: &Area<'_>) -> Drawn {
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
    pub(super) fn clip(&self, a: (f64, f64), b: (f64, f64)) -> Option<((f64, f64), (f64, f64))> {
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

    pub(super) fn curve(
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

    /// The band between two curves over the same abscissae.
    pub(super) fn band(
        &self,
        area: &Area<'_>,
        points: &[(f64, f64, f64)],
        colour: RGBColor,
    ) -> Drawn {
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
        let within = x >= self.x.0 && x <= self.x.1 && y >= self.y.0 && y <= self.y.1;
        if within {
            let (at, radius) = (fine(self.at(x, y)), (radius * FINE) as i32);
            area.draw(&Circle::new(at, radius, colour.filled()))?;
        }
        Ok(())
    }

    pub(super) fn circle(&self, area: &Area<'_>, (x, y): (f64, f64), colour: RGBColor) -> Drawn {
        let within = x >= self.x.0 && x <= self.x.1 && y >= self.y.0 && y <= self.y.1;
        if within {
            let at = fine(self.at(x, y));
            let style = colour.stroke_width(FINE as u32);
            area.draw(&Circle::new(at, (2.5 * FINE) as i32, style))?;
        }
        Ok(())
    }

    pub(super) fn mark(
        &self,
        area: &Area<'_>,
        (x, y): (f64, f64),
        colour: RGBColor,
        it: Shape,
    ) -> Drawn {
        let within = x >= self.x.0 && x <= self.x.1 && y >= self.y.0 && y <= self.y.1;
        if within {
            shape(area, self.at(x, y), colour, it)?;
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
    pub(super) fn point(&self, area: &Area<'_>, x: f64, y: Estimate, colour: RGBColor) -> Drawn {
        let bar = [(x, y.value - y.error), (x, y.value + y.error)];
        self.curve(area, &bar, colour, 1.25)?;
        self.dot(area, (x, y.value), colour, 1.75)
    }

    /// A dashed curve.
    pub(super) fn dashes(
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
    pub(super) fn level(&self, area: &Area<'_>, y: f64, colour: RGBColor) -> Drawn {
        if y > self.y.0 && y < self.y.1 {
            dashed(
                area,
                &[self.at(self.x.0, y), self.at(self.x.1, y)],
                colour,
                1.25,
            )?;
        }
        Ok(())
    }
}

/// About `count` round numbers within a range, as they are written.
pub(super) fn ticks((low, high): (f64, f64), count: usize) -> Vec<(f64, String)> {
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

pub(super) fn superscript(k: i64) -> String {
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

/// A text with its powers of ten as they are printed: "h = 4.5e-5" as h = 4.5 times 10 to the -5.
pub(super) fn typeset(text: &str) -> String {
    let word = |word: &str| -> String {
        let start = word.rfind('=').map_or(0, |at| at + 1);
        let (name, rest) = word.split_at(start);
        let (number, comma) = rest.split_at(rest.trim_end_matches(',').len());
        let parts = number.split_once('e');
        let parts = parts.and_then(|(m, e)| Some((m, m.parse::<f64>().ok()?, e.parse().ok()?)));
        let name = match name {
            "=" => name.to_owned(),
            _ => name.replace('=', " = "),
        };
        let Some((digits, mantissa, power)) = parts else {
            return name + rest;
        };
        let power = superscript(power);
        if mantissa == 1.0 {
            format!("{name}10{power}{comma}")
        } else {
            format!("{name}{digits}\u{b7}10{power}{comma}")
        }
    };
    text.split(' ').map(word).collect::<Vec<_>>().join(" ")
}

/// A mark at a place in pixels.
fn shape(area: &Area<'_>, (x, y): (f64, f64), colour: RGBColor, it: Shape) -> Drawn {
    const R: f64 = 3.5;
    let corners = |points: &[(f64, f64)]| -> Vec<(i32, i32)> {
        points
            .iter()
            .map(|(a, b)| fine((x + R * a, y + R * b)))
            .collect()
    };
    let (centre, radius) = (fine((x, y)), (R * FINE) as i32);
    let square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    match it {
        Shape::Disc => area.draw(&Circle::new(centre, radius, colour.filled()))?,
        Shape::Ring => {
            area.draw(&Circle::new(centre, radius, WHITE.filled()))?;
            area.draw(&Circle::new(
                centre,
                radius,
                colour.stroke_width(FINE as u32),
            ))?;
        }
        Shape::Square => area.draw(&Polygon::new(corners(&square), colour.filled()))?,
        Shape::Frame => {
            area.draw(&Polygon::new(corners(&square), WHITE.filled()))?;
            let around = [&square[..], &square[..1]].concat();
            area.draw(&PathElement::new(
                corners(&around),
                colour.stroke_width(FINE as u32),
            ))?;
        }
        Shape::Triangle => {
            let points = [(0.0, -1.3), (1.2, 0.9), (-1.2, 0.9)];
            area.draw(&Polygon::new(corners(&points), colour.filled()))?;
        }
        Shape::Cross => {
            for arm in [[(-1.0, -1.0), (1.0, 1.0)], [(-1.0, 1.0), (1.0, -1.0)]] {
                let style = colour.stroke_width((1.5 * FINE) as u32);
                area.draw(&PathElement::new(corners(&arm), style))?;
            }
        }
    }
    Ok(())
}

/// A line with its words, for a legend; `x`, `y` in pixels.
pub(super) fn legend(
    area: &Area<'_>,
    at: (f64, f64),
    colour: RGBColor,
    mark: Mark,
    words: &str,
) -> Drawn {
    let (x, y) = at;
    match mark {
        Mark::Line => line(area, &[(x, y), (x + 22.0, y)], colour, 2.0)?,
        Mark::Halo => line(area, &[(x, y), (x + 22.0, y)], colour, 5.0)?,
        Mark::Dashes => dashed(area, &[(x, y), (x + 23.0, y)], colour, 1.25)?,
        Mark::Dot => {
            let centre = fine((x + 11.0, y));
            area.draw(&Circle::new(centre, (3.0 * FINE) as i32, colour.filled()))?;
        }
        Mark::Circle => {
            let (centre, style) = (fine((x + 11.0, y)), colour.stroke_width(FINE as u32));
            area.draw(&Circle::new(centre, (2.5 * FINE) as i32, style))?;
        }
        Mark::Shape(it) => {
            line(area, &[(x, y), (x + 22.0, y)], colour, 1.25)?;
            shape(area, (x + 11.0, y), colour, it)?;
        }
        Mark::Band => {
            let corners = [(x, y - 6.0), (x + 22.0, y + 6.0)].map(fine);
            area.draw(&Rectangle::new(corners, colour.mix(0.22).filled()))?;
        }
    }
    write(area, words, (x + 29.0, y), WORDS)
}

/// The mark of a point.
#[derive(Clone, Copy)]
pub(super) enum Shape {
    Disc,
    Ring,
    Square,
    Frame,
    Triangle,
    Cross,
}

#[derive(Clone, Copy)]
pub(super) enum Mark {
    Shape(Shape),
    Line,
    Halo,
    Dashes,
    Dot,
    Circle,
    Band,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_ten_are_printed_as_such() {
        assert_eq!(typeset("h=1e-6"), "h = 10\u{207b}\u{2076}");
        assert_eq!(typeset("h=0.3"), "h = 0.3");
        let two = "h = 4.5\u{b7}10\u{207b}\u{2075}, P = 0.0005";
        assert_eq!(typeset("h=4.5e-5, P = 0.0005"), two);
        for plain in ["the time", "h = 0.3", "e", "1e", "none"] {
            assert_eq!(typeset(plain), plain);
        }
    }

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
        let panel = Panel::new([0.0, 0.0, 10.0, 10.0], (0.0, 10.0), (0.0, 10.0));
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
