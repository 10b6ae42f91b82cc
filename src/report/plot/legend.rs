//! Marks, and what a legend says of them.

use super::canvas::{Area, Drawn, FINE, WORDS, dashed, fine, line, write};
use plotters::prelude::*;

/// A mark at a place in pixels.
pub(super) fn shape(area: &Area<'_>, (x, y): (f64, f64), colour: RGBColor, it: Shape) -> Drawn {
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
