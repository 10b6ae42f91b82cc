//! What a legend says of a curve.

use super::canvas::{Area, Colour, Drawn, FINE, WORDS, dashed, fine, line, write};
use plotters::prelude::*;

/// A line with its words, for a legend; `x`, `y` in pixels.
pub fn legend(area: &Area<'_>, at: (f64, f64), colour: Colour, mark: Mark, words: &str) -> Drawn {
    let (x, y) = at;
    match mark {
        Mark::Line => line(area, &[(x, y), (x + 22.0, y)], colour, 2.0)?,
        Mark::Halo => line(area, &[(x, y), (x + 22.0, y)], colour, 5.0)?,
        Mark::Dashes => dashed(area, &[(x, y), (x + 23.0, y)], colour, 1.25)?,
        Mark::Dot => {
            let centre = fine((x + 11.0, y));
            area.draw(&Circle::new(centre, (3.0 * FINE) as i32, colour.filled()))?;
        }
    }
    write(area, words, (x + 29.0, y), WORDS)
}

/// Marks with their words, one below the other.
pub(super) fn legends<'a>(
    area: &Area<'_>,
    (x, y): (f64, f64),
    entries: impl IntoIterator<Item = (Colour, Mark, &'a str)>,
) -> Drawn {
    for (k, (colour, mark, words)) in entries.into_iter().enumerate() {
        legend(area, (x, y + 19.0 * k as f64), colour, mark, words)?;
    }
    Ok(())
}

/// What stands before the words.
#[derive(Clone, Copy)]
pub enum Mark {
    /// A line.
    Line,
    /// A thick line.
    Halo,
    /// A dashed line.
    Dashes,
    /// A filled circle.
    Dot,
}
