//! Filled contours of numbers over two axes, with a line at a chosen level.

use super::ruler::{Ruler, axes};
use super::scale::{Scale, colours};
use crate::format::bare;
use crate::report::plot::canvas::{
    Area, Colour, Drawn, FAINT, GREY, Picture, SMALL, SUBTITLE, TITLE, VERMILION, line, picture,
    rectangle, write,
};
use crate::report::plot::contours::{self, level_line};
use crate::report::plot::panel::Panel;

/// One panel of contours.
pub(super) struct Sheet<'a> {
    pub(super) title: String,
    pub(super) values: &'a [f64],
    pub(super) errors: &'a [f64],
    pub(super) level: Option<f64>,
}

/// Filled contours, a panel a sheet; one scale for all of them, or one each.
pub(super) fn plane(
    (x, y): (&Ruler, &Ruler),
    sheets: &[Sheet<'_>],
    scales: &[Scale],
    heading: &str,
) -> Picture {
    let (range_x, range_y) = (x.range()?, y.range().filter(|_| !sheets.is_empty())?);
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
    Some(picture("map.svg", size, |area| {
        write(area, heading, (92.0, 20.0), TITLE)?;
        for (k, sheet) in sheets.iter().enumerate() {
            let left = 92.0 + across * (k % columns) as f64;
            let top = top + down * (k / columns) as f64;
            let panel = Panel::new([left, top, width, height], range_x, range_y);
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
            write(area, &sheet.title, above, SUBTITLE)?;
            if !shared || k == columns - 1 {
                key(area, (panel.right() + 16.0, panel.top), scale, sheet)?;
            }
        }
        Ok(())
    }))
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
        let levels = scale.levels();
        let below = [f64::NEG_INFINITY].into_iter();
        let levels: Vec<(f64, Colour)> = below
            .chain(levels.iter().map(|it| it.0))
            .zip(colours(levels.len()))
            .collect();
        let down = y.values.len();
        for (xs, columns) in x.strips() {
            for (ys, rows) in y.strips() {
                let place = |i: usize, j: usize| columns[i] * down + rows[j];
                let grid = (&xs[..], &ys[..]);
                let height = |i, j| scale.place(self.values[place(i, j)]);
                contours::fill(area, panel, &levels, grid, height, f64::NAN)?;
                let Some(level) = self.level else {
                    continue;
                };
                // Where the level may lie: on one line with the level itself unless errors are large.
                for (sign, width) in [(-1.0, 0.75), (1.0, 0.75), (0.0, 2.0)] {
                    let moved = |i, j| {
                        let k = place(i, j);
                        let error = Some(self.errors[k]).filter(|it| it.is_finite());
                        scale.place(self.values[k] + sign * error.unwrap_or(0.0))
                    };
                    let style = (VERMILION, width);
                    level_line(area, panel, grid, moved, scale.place(level), style)?;
                }
            }
        }
        Ok(())
    }
}

/// The key to the colours, the line and the holes.
fn key(area: &Area<'_>, (x, y): (f64, f64), scale: &Scale, sheet: &Sheet<'_>) -> Drawn {
    const STEP: f64 = 17.0;
    let levels = scale.levels();
    let colours = colours(levels.len());
    for (k, colour) in colours.iter().rev().enumerate() {
        let top = y + STEP * k as f64;
        let corners = [(x, top), (x + 18.0, top + STEP)];
        rectangle(area, corners, *colour, Some(GREY))?;
    }
    for (k, (_, text)) in levels.iter().rev().enumerate() {
        let at = (x + 24.0, y + STEP * (k + 1) as f64);
        write(area, text, at, SMALL)?;
    }
    let mut at = y + STEP * colours.len() as f64 + 16.0;
    if let Some(level) = sheet.level {
        line(area, &[(x, at), (x + 18.0, at)], VERMILION, 2.0)?;
        let sides = [f64::ge, f64::le].map(|side| sheet.values.iter().any(|it| side(it, &level)));
        let nowhere = if sides == [true; 2] { "" } else { ", nowhere" };
        let words = bare(level) + nowhere;
        write(area, &words, (x + 24.0, at), SMALL)?;
        at += STEP;
    }
    if sheet.values.iter().any(|it| it.is_nan()) {
        let corners = [(x, at - 6.0), (x + 18.0, at + 6.0)];
        rectangle(area, corners, FAINT, Some(GREY))?;
        write(area, "none", (x + 24.0, at), SMALL)?;
    }
    Ok(())
}
