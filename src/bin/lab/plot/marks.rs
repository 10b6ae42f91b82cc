//! Marks of points that can be told apart without colour.

use plotters::prelude::{Circle, Color, PathElement, Polygon, WHITE};
use vibroimpact::report::plot::{Area, Colour, Drawn, FINE, fine};

/// The mark of a point.
#[derive(Clone, Copy)]
pub enum Shape {
    Disc,
    Ring,
    Square,
    Frame,
    Triangle,
    Cross,
}

/// A mark at a place in pixels.
pub fn shape(area: &Area<'_>, (x, y): (f64, f64), colour: Colour, it: Shape) -> Drawn {
    const R: f64 = 3.5;
    let corners = |points: &[(f64, f64)]| -> Vec<(i32, i32)> {
        points
            .iter()
            .map(|(a, b)| fine((x + R * a, y + R * b)))
            .collect()
    };
    let (centre, radius) = (fine((x, y)), (R * FINE) as i32);
    let edge = colour.stroke_width(FINE as u32);
    let square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    match it {
        Shape::Disc => area.draw(&Circle::new(centre, radius, colour.filled()))?,
        Shape::Ring => {
            area.draw(&Circle::new(centre, radius, WHITE.filled()))?;
            area.draw(&Circle::new(centre, radius, edge))?;
        }
        Shape::Square => area.draw(&Polygon::new(corners(&square), colour.filled()))?,
        Shape::Frame => {
            area.draw(&Polygon::new(corners(&square), WHITE.filled()))?;
            let around = [&square[..], &square[..1]].concat();
            area.draw(&PathElement::new(corners(&around), edge))?;
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

/// A small open circle at a place in pixels.
pub fn circle(area: &Area<'_>, at: (f64, f64), colour: Colour) -> Drawn {
    let style = colour.stroke_width(FINE as u32);
    area.draw(&Circle::new(fine(at), (2.5 * FINE) as i32, style))?;
    Ok(())
}
