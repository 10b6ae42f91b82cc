//! map.svg: numbers over the axes of a map: curves over one, contours over two, small multiples over three.

use super::canvas::{
    Area, BLUE, CENTRED, Colour, Drawn, FAINT, GREY, Hang, INK, LEVELS, Mark, Panel, Points, TITLE,
    VERMILION, legend, line, picture, range, rectangle, superscript, ticks, write,
};
use super::contours::{self, between, level_line, locate};
use crate::error::Result;
use crate::format::{bare, rounded};
use crate::report::File;

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

/// A number over the axes, the last running fastest; NaN where there is none.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Field {
    /// Its words, with its unit.
    pub(crate) label: String,
    /// The numbers.
    pub(crate) values: Vec<f64>,
    /// Their errors.
    pub(crate) errors: Vec<f64>,
    /// A level to be marked.
    pub(crate) level: Option<f64>,
}

/// A scale that spans this factor is logarithmic.
const DECADES: f64 = 100.0;

/// A logarithmic scale of colours or heights ends so many decades below its top.
const DEEPEST: f64 = 12.0;

/// Colours of contours at most.
const MOST: usize = 9;

impl Ruler {
    fn place(&self, x: f64) -> f64 {
        if self.log { x.log10() } else { x }
    }

    fn places(&self) -> Vec<f64> {
        self.values.iter().map(|x| self.place(*x)).collect()
    }

    fn range(&self) -> Option<(f64, f64)> {
        let share = if self.words.is_some() { 0.1 } else { 0.0 };
        range(self.places(), share)
    }

    /// Numbers along it, and lines between them.
    fn marks(&self, range: (f64, f64), room: f64) -> Vec<(f64, String)> {
        if let Some(words) = &self.words {
            return self.places().into_iter().zip(words.clone()).collect();
        }
        marks(range, self.log, (room / 60.0).clamp(2.0, 8.0) as usize)
    }

    /// What a point of it is called.
    fn called(&self, k: usize) -> String {
        match &self.words {
            Some(words) => words[k].clone(),
            None => bare(self.values[k]),
        }
    }
}

/// About `count` round numbers of a scale as they are written; of a logarithmic one its powers of ten, or 1, 2 and 5 of
/// each where these are few.
fn marks((low, high): (f64, f64), log: bool, count: usize) -> Vec<(f64, String)> {
    if !log {
        return ticks((low, high), count);
    }
    let margin = 1e-9 * (high - low);
    let within = |x: f64| x >= low - margin && x <= high + margin;
    let powers = || low.floor() as i64..=high.ceil() as i64;
    let decades: Vec<i64> = powers().filter(|k| within(*k as f64)).collect();
    if decades.len() > 2 {
        let each = decades.len().div_ceil(count.max(2)) as i64;
        let shown = decades.into_iter().filter(|k| k.rem_euclid(each) == 0);
        return shown
            .map(|k| (k as f64, format!("10{}", superscript(k))))
            .collect();
    }
    let some = digits((low, high), &[1.0, 2.0, 5.0]);
    if some.len() > 2 {
        return some;
    }
    digits((low, high), &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])
}

/// The numbers of a logarithmic scale that begin with one of some digits.
fn digits((low, high): (f64, f64), first: &[f64]) -> Vec<(f64, String)> {
    let margin = 1e-9 * (high - low);
    let powers = low.floor() as i64..=high.ceil() as i64;
    let parts = powers.flat_map(|k| first.iter().map(move |m| (k, *m)));
    let all = parts.map(|(k, m)| {
        let x = rounded(m * 10f64.powi(k as i32), 3);
        let text = if (-3..4).contains(&k) {
            bare(x)
        } else if m == 1.0 {
            format!("10{}", superscript(k))
        } else {
            format!("{m}\u{b7}10{}", superscript(k))
        };
        (x.log10(), text)
    });
    all.filter(|(x, _)| *x >= low - margin && *x <= high + margin)
        .collect()
}

/// Grid, numbers and words of both axes; words are left out where they are empty.
fn axes(area: &Area<'_>, panel: &Panel, x: (&Ruler, &str), y: (&Ruler, &str)) -> Drawn {
    for (x, text) in x.0.marks(panel.x, panel.width) {
        let (px, _) = panel.at(x, panel.y.0);
        line(area, &[(px, panel.top), (px, panel.bottom())], FAINT, 0.75)?;
        line(
            area,
            &[(px, panel.bottom()), (px, panel.bottom() + 4.0)],
            INK,
            1.0,
        )?;
        write(area, &text, (px, panel.bottom() + 13.0), CENTRED)?;
    }
    for (y, text) in y.0.marks(panel.y, panel.height * 1.4) {
        let (_, py) = panel.at(panel.x.0, y);
        line(area, &[(panel.left, py), (panel.right(), py)], FAINT, 0.75)?;
        line(area, &[(panel.left - 4.0, py), (panel.left, py)], INK, 1.0)?;
        write(
            area,
            &text,
            (panel.left - 7.0, py),
            (13.0, Hang::Right, INK),
        )?;
    }
    panel.labels(area, x.1, y.1)
}

/// A number as it is drawn: its magnitude's logarithm where it spans decades.
struct Scale {
    log: bool,
    /// Of the numbers, or of their logarithms.
    range: (f64, f64),
    /// The numbers are below zero, and their magnitude is drawn.
    negative: bool,
}

impl Scale {
    fn of(field: &Field) -> Option<Self> {
        let there = || field.values.iter().copied().filter(|it| it.is_finite());
        let magnitudes = || there().map(f64::abs).filter(|it| *it > 0.0);
        let (low, high) = range(magnitudes(), 0.0)?;
        let one_sided = there().all(|it| it >= 0.0) || there().all(|it| it <= 0.0);
        // A zero has no logarithm: it is one that is too small to be told.
        let log = one_sided && high / low.max(f64::MIN_POSITIVE) > DECADES;
        let range = if log {
            let top = magnitudes().fold(0.0, f64::max).log10();
            let bottom = magnitudes().fold(f64::INFINITY, f64::min).log10();
            // Below the largest error of a number that is less than its error nothing is told apart.
            let pairs = field.values.iter().zip(&field.errors);
            let unknown = pairs.filter(|(x, error)| x.abs() < **error);
            let unknown = unknown.map(|(_, error)| *error).fold(0.0, f64::max).log10();
            (bottom.max(top - DEEPEST).max(unknown.min(top - 1.0)), top)
        } else {
            range(there(), 0.0)?
        };
        let negative = log && there().any(|it| it < 0.0);
        Some(Self {
            log,
            range,
            negative,
        })
    }

    /// Where a number stands; below the range what has no logarithm.
    fn place(&self, x: f64) -> f64 {
        match (self.log, x.is_nan()) {
            (true, false) => x.abs().log10().max(self.range.0 - 1.0),
            _ => x,
        }
    }

    fn title(&self, field: &Field) -> String {
        if self.negative {
            format!("|{}|", field.label)
        } else {
            field.label.clone()
        }
    }

    /// Levels between colours, with their words; the first colour lies below the first level.
    fn levels(&self) -> Vec<(f64, String)> {
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
fn colours(levels: usize) -> Vec<Colour> {
    let last = LEVELS.len() - 1;
    let at = |k: usize| LEVELS[(k * last + levels / 2) / levels.max(1)].1;
    (0..=levels).map(|k| at(k.min(levels))).collect()
}

/// The picture of a map; None where there is nothing to be drawn, or more than three axes of several points. With three,
/// the first number at up to a dozen points of the last axis.
///
/// # Errors
/// [`crate::Error::Io`] for a picture that cannot be drawn.
pub(crate) fn map(rulers: &[Ruler], fields: &[Field]) -> Result<Option<File>> {
    match rulers {
        [x] => curves(x, fields),
        [x, y] => {
            let sheets = fields.iter().filter_map(|it| Some((it, Scale::of(it)?)));
            let sheets: Vec<Sheet<'_>> = sheets
                .map(|(field, scale)| Sheet {
                    title: scale.title(field),
                    values: &field.values,
                    errors: &field.errors,
                    level: field.level,
                })
                .collect();
            let scales: Vec<Scale> = fields.iter().filter_map(Scale::of).collect();
            plane((x, y), &sheets, &scales, "")
        }
        [x, y, z] => multiples([x, y, z], fields),
        _ => Ok(None),
    }
}

/// Curves with their error bands, a panel a number.
fn curves(x: &Ruler, fields: &[Field]) -> Result<Option<File>> {
    let drawn: Vec<(&Field, Scale)> = fields
        .iter()
        .filter_map(|it| Some((it, Scale::of(it)?)))
        .collect();
    let (Some(range_x), false) = (x.range(), drawn.is_empty()) else {
        return Ok(None);
    };
    let columns = drawn.len().min(2);
    let rows = drawn.len().div_ceil(columns);
    let size = (
        (478.0 * columns as f64 + 10.0) as u32,
        (318.0 * rows as f64 + 34.0) as u32,
    );
    picture("map.svg", size, |area| {
        for (k, (field, scale)) in drawn.iter().enumerate() {
            let heights = field.values.iter().map(|it| scale.place(*it));
            let points: Points = x.places().into_iter().zip(heights).collect();
            let Some(y) = range([scale.range.0, scale.range.1], 0.06) else {
                continue;
            };
            let place = [
                92.0 + 478.0 * (k % columns) as f64,
                58.0 + 318.0 * (k / columns) as f64,
                364.0,
                232.0,
            ];
            let panel = Panel::new(place, range_x, y);
            let above = (panel.left, panel.top - 14.0);
            write(area, &scale.title(field), above, (13.5, Hang::Left, INK))?;
            let height = Ruler {
                label: String::new(),
                values: Vec::new(),
                log: scale.log,
                words: None,
            };
            axes(area, &panel, (x, &x.label), (&height, ""))?;
            let band: Vec<(f64, f64, f64)> = field
                .values
                .iter()
                .zip(&field.errors)
                .zip(&points)
                .map(|((y, error), (x, _))| {
                    let error = if error.is_finite() { *error } else { 0.0 };
                    // A band that reaches zero has no end on a logarithmic scale.
                    let ends = [y - error, y + error].map(|it| {
                        if scale.log && it * y <= 0.0 {
                            panel.y.0
                        } else {
                            scale.place(it)
                        }
                    });
                    (*x, ends[0].min(ends[1]), ends[0].max(ends[1]))
                })
                .collect();
            panel.band(area, &band, BLUE)?;
            panel.curve(area, &points, BLUE, 1.5)?;
            if points.len() <= 60 {
                for point in &points {
                    panel.dot(area, *point, BLUE, 2.0)?;
                }
            }
            if let Some(level) = field.level {
                panel.level(area, scale.place(level), VERMILION)?;
            }
            panel.frame(area)?;
        }
        legend(
            area,
            (92.0, 18.0),
            BLUE,
            Mark::Line,
            "value, band: its error",
        )
    })
    .map(Some)
}

/// One panel of contours.
struct Sheet<'a> {
    title: String,
    values: &'a [f64],
    errors: &'a [f64],
    level: Option<f64>,
}

/// Filled contours, a panel a sheet; one scale for all of them, or one each.
fn plane(
    (x, y): (&Ruler, &Ruler),
    sheets: &[Sheet<'_>],
    scales: &[Scale],
    heading: &str,
) -> Result<Option<File>> {
    let (Some(range_x), Some(range_y), false) = (x.range(), y.range(), sheets.is_empty()) else {
        return Ok(None);
    };
    let shared = scales.len() == 1 && sheets.len() > 1;
    let columns = sheets.len().min(if shared { 3 } else { 2 });
    let rows = sheets.len().div_ceil(columns);
    let (width, height) = if shared {
        (236.0, 190.0)
    } else {
        (330.0, 250.0)
    };
    let (key_each, key_last) = if shared { (0.0, 96.0) } else { (96.0, 0.0) };
    let (across, down) = (width + 92.0 + key_each, height + 84.0);
    let top = if heading.is_empty() { 40.0 } else { 66.0 };
    let size = (
        (across * columns as f64 + key_last + 12.0) as u32,
        (top + down * rows as f64 - 18.0) as u32,
    );
    picture("map.svg", size, |area| {
        write(area, heading, (92.0, 20.0), TITLE)?;
        for (k, sheet) in sheets.iter().enumerate() {
            let place = [
                92.0 + across * (k % columns) as f64,
                top + down * (k / columns) as f64,
                width,
                height,
            ];
            let panel = Panel::new(place, range_x, range_y);
            let scale = if shared { &scales[0] } else { &scales[k] };
            let first_of_row = k % columns == 0;
            let lowest = k + columns >= sheets.len();
            let x_label = if shared && !lowest { "" } else { &x.label };
            let y_label = if shared && !first_of_row {
                ""
            } else {
                &y.label
            };
            axes(area, &panel, (x, x_label), (y, y_label))?;
            sheet.draw(area, &panel, (x, y), scale)?;
            panel.frame(area)?;
            let above = (panel.left, panel.top - 13.0);
            write(area, &sheet.title, above, (13.5, Hang::Left, INK))?;
            if !shared || k == columns - 1 {
                key(area, (panel.right() + 16.0, panel.top), scale, sheet)?;
            }
        }
        Ok(())
    })
    .map(Some)
}

impl Sheet<'_> {
    fn draw(
        &self,
        area: &Area<'_>,
        panel: &Panel,
        (x, y): (&Ruler, &Ruler),
        scale: &Scale,
    ) -> Drawn {
        let corners = [(panel.left, panel.top), (panel.right(), panel.bottom())];
        rectangle(area, corners, FAINT, None)?;
        let (xs, ys) = (x.places(), y.places());
        let number = |i: usize, j: usize| self.values[i * ys.len() + j];
        let place = |(low, high): (f64, f64), part: f64| low + (high - low) * part;
        let levels = scale.levels();
        let below = [f64::NEG_INFINITY].into_iter();
        let levels: Vec<(f64, Colour)> = below
            .chain(levels.iter().map(|it| it.0))
            .zip(colours(levels.len()))
            .collect();
        contours::fill(area, panel, &levels, |from_top, columns| {
            let j = locate(&ys, place((panel.y.1, panel.y.0), from_top))?;
            let at = |k: usize| {
                let i = locate(&xs, place(panel.x, k as f64 / columns as f64));
                i.map_or(f64::NAN, |i| {
                    between(|i, j| scale.place(number(i, j)), (i, j))
                })
            };
            Some((0..=columns).map(at).collect())
        })?;
        let Some(level) = self.level else {
            return Ok(());
        };
        let error = |i: usize, j: usize| {
            let error = self.errors[i * ys.len() + j];
            if error.is_finite() { error } else { 0.0 }
        };
        // Where the level may lie: on one line with the level itself unless errors are large.
        for sign in [-1.0, 1.0] {
            let moved = |i: usize, j: usize| scale.place(number(i, j) + sign * error(i, j));
            let grid = (&xs[..], &ys[..]);
            level_line(
                area,
                panel,
                grid,
                moved,
                scale.place(level),
                (VERMILION, 0.75),
            )?;
        }
        let exact = |i: usize, j: usize| scale.place(number(i, j));
        let grid = (&xs[..], &ys[..]);
        level_line(
            area,
            panel,
            grid,
            exact,
            scale.place(level),
            (VERMILION, 2.0),
        )
    }
}

/// The key to the colours, the line and the holes.
fn key(area: &Area<'_>, (x, y): (f64, f64), scale: &Scale, sheet: &Sheet<'_>) -> Drawn {
    const STEP: f64 = 17.0;
    let levels = scale.levels();
    let colours = colours(levels.len());
    for (k, colour) in colours.iter().rev().enumerate() {
        let top = y + STEP * k as f64;
        rectangle(
            area,
            [(x, top), (x + 18.0, top + STEP)],
            *colour,
            Some(GREY),
        )?;
    }
    for (k, (_, text)) in levels.iter().rev().enumerate() {
        let at = (x + 24.0, y + STEP * (k + 1) as f64);
        write(area, text, at, (11.5, Hang::Left, INK))?;
    }
    let mut at = y + STEP * colours.len() as f64 + 16.0;
    if let Some(level) = sheet.level {
        line(area, &[(x, at), (x + 18.0, at)], VERMILION, 2.0)?;
        write(area, &bare(level), (x + 24.0, at), (11.5, Hang::Left, INK))?;
        at += STEP;
    }
    if sheet.values.iter().any(|it| it.is_nan()) {
        rectangle(
            area,
            [(x, at - 6.0), (x + 18.0, at + 6.0)],
            FAINT,
            Some(GREY),
        )?;
        write(area, "none", (x + 24.0, at), (11.5, Hang::Left, INK))?;
    }
    Ok(())
}

/// The first number over the first two axes, at up to a dozen points of the third.
fn multiples([x, y, z]: [&Ruler; 3], fields: &[Field]) -> Result<Option<File>> {
    let Some((field, scale)) = fields.iter().find_map(|it| Some((it, Scale::of(it)?))) else {
        return Ok(None);
    };
    let depth = z.values.len();
    let shown = depth.min(12);
    let slice = |numbers: &[f64], k: usize| -> Vec<f64> {
        numbers.iter().skip(k).step_by(depth).copied().collect()
    };
    let picked = (0..shown).map(|k| k * (depth - 1) / (shown - 1).max(1));
    let slices: Vec<(usize, Vec<f64>, Vec<f64>)> = picked
        .map(|k| (k, slice(&field.values, k), slice(&field.errors, k)))
        .collect();
    let sheets: Vec<Sheet<'_>> = slices
        .iter()
        .map(|(k, values, errors)| Sheet {
            title: format!("{} = {}", z.label, z.called(*k)),
            values,
            errors,
            level: field.level,
        })
        .collect();
    let heading = scale.title(field);
    plane((x, y), &sheets, &[scale], &heading)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ruler(label: &str, values: &[f64], log: bool) -> Ruler {
        Ruler {
            label: label.into(),
            values: values.to_vec(),
            log,
            words: None,
        }
    }

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

    #[test]
    fn every_number_of_axes_has_its_picture_and_holes_stay_empty() {
        let (x, y) = (
            ruler("h", &[1e-3, 1e-2, 1e-1], true),
            ruler("z", &[1.0, 2.0], false),
        );
        let field = |n: usize| Field {
            label: "P".into(),
            values: (0..n)
                .map(|k| if k == 1 { f64::NAN } else { 1e-3 * k as f64 })
                .collect(),
            errors: vec![1e-4; n],
            level: Some(2e-3),
        };
        let t = ruler("t", &[1.0, 5.0], false);
        for (rulers, n) in [
            (vec![x.clone()], 3),
            (vec![x.clone(), y.clone()], 6),
            (vec![x.clone(), y.clone(), t], 12),
        ] {
            let file = map(&rulers, &[field(n)]).unwrap().unwrap();
            let text = String::from_utf8(file.bytes).unwrap();
            assert!(text.starts_with("<svg") && !text.contains("NaN"));
        }
        let nothing = Field {
            values: vec![f64::NAN; 3],
            ..field(3)
        };
        assert!(map(&[x], &[nothing]).unwrap().is_none());
    }
}
