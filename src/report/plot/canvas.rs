//! What every picture is drawn with: colours, text, panels with their axes, legends.

use crate::error::{Error, Result};
use crate::report::File;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

pub const BLUE: RGBColor = RGBColor(0, 114, 178);
pub const VERMILION: RGBColor = RGBColor(213, 94, 0);
pub const GREEN: RGBColor = RGBColor(0, 158, 115);
pub const INK: RGBColor = RGBColor(25, 25, 25);
pub const GREY: RGBColor = RGBColor(120, 120, 120);
/// Under a curve, for what it should coincide with.
pub const HALO: RGBColor = RGBColor(190, 190, 190);
pub const FAINT: RGBColor = RGBColor(228, 228, 228);

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
pub const FINE: f64 = 4.0;
pub type Colour = RGBColor;
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub type Drawn = std::result::Result<(), Box<dyn std::error::Error>>;
pub type Points = Vec<(f64, f64)>;

/// A picture; None where there is nothing to be drawn.
pub(crate) type Picture = Option<Result<File>>;

/// A picture of that size in pixels.
pub fn picture(
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
        return Err(Error::unmade(&name, error));
    }
    let drawn = format!("width=\"{}\" height=\"{}\"", units(size.0), units(size.1));
    let shown = format!("width=\"{}\" height=\"{}\"", size.0, size.1);
    Ok(File::text(name, svg.replacen(&drawn, &shown, 1)))
}

/// A place in drawing units.
pub fn fine((x, y): (f64, f64)) -> (i32, i32) {
    ((x * FINE) as i32, (y * FINE) as i32)
}

/// Where a text hangs on its point.
#[derive(Clone, Copy)]
pub enum Hang {
    Left,
    Middle,
    Right,
}

/// Size in pixels, where it hangs, colour.
pub type Font = (f64, Hang, Colour);

pub(super) const TITLE: Font = (15.0, Hang::Left, INK);
/// Of one of several panels.
pub const SUBTITLE: Font = (13.5, Hang::Left, INK);
pub(super) const SMALL: Font = (11.5, Hang::Left, INK);
pub const WORDS: Font = (13.0, Hang::Left, INK);
pub const CENTRED: Font = (13.0, Hang::Middle, INK);
/// Of Monte Carlo, or of the Dirac mass.
pub(super) const NOTE: Font = (13.0, Hang::Left, VERMILION);

/// A line of text, its vertical middle at `y`; places in pixels.
pub fn write(area: &Area<'_>, text: &str, at: (f64, f64), font: Font) -> Drawn {
    styled(area, text, at, font, FontTransform::None)
}

pub(super) fn styled(
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

pub fn line(area: &Area<'_>, points: &[(f64, f64)], colour: RGBColor, width: f64) -> Drawn {
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
