//! Charts of curves, side by side, with linear or logarithmic axes: for surveys and the paper.

use super::marks::circle;
use plotters::prelude::{Color, Rectangle};
use vibroimpact::error::Result;
use vibroimpact::report::File;
use vibroimpact::report::plot::{
    Area, BLUE, Colour, Drawn, GREEN, GREY, INK, Mark, Panel, SUBTITLE, VERMILION, WORDS, fine,
    legend, picture, superscript, write,
};

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
    /// The area within its points, which run along the upper edge and back along the lower, at the same x.
    Band,
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
/// [`vibroimpact::Error::Io`] for a picture that cannot be drawn.
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
            let left = 92.0 + across * (k % columns) as f64;
            let top = 64.0 + down * (k / columns) as f64;
            let panel = Panel::new([left, top, width, height], chart.x, chart.y);
            let panel = panel.logarithmic(chart.log);
            let letter = (b'a' + (k % 26) as u8) as char;
            let title = format!("({letter}) {}", typeset(&chart.title));
            write(area, &title, (left, top - 13.0), SUBTITLE)?;
            panel.axes(area, &chart.x_label, &chart.y_label)?;
            for curve in &chart.curves {
                let colour = curve.ink.colour();
                match curve.stroke {
                    Stroke::Line => panel.curve(area, &curve.points, colour, 1.25)?,
                    Stroke::Thick => panel.curve(area, &curve.points, colour, 3.5)?,
                    Stroke::Dashes => panel.dashes(area, &curve.points, colour, 1.25)?,
                    Stroke::Band => {
                        let (upper, lower) = curve.points.split_at(curve.points.len() / 2);
                        let pairs = upper.iter().zip(lower.iter().rev());
                        let points: Vec<_> = pairs.map(|(a, b)| (a.0, b.1, a.1)).collect();
                        panel.band(area, &points, colour)?;
                    }
                    Stroke::Circles => {
                        for (x, y) in curve.points.iter().filter(|it| panel.shows(it.0, it.1)) {
                            circle(area, panel.at(*x, *y), colour)?;
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
            key(area, (x, 18.0), curve)?;
            // An advance of the font is about 0.56 of its size.
            x += 52.0 + 7.6 * curve.words.chars().count() as f64;
        }
        Ok(())
    })
}

/// The mark of a curve with its words.
fn key(area: &Area<'_>, (x, y): (f64, f64), curve: &Curve) -> Drawn {
    let colour = curve.ink.colour();
    let mark = match curve.stroke {
        Stroke::Line => Mark::Line,
        Stroke::Thick => Mark::Halo,
        Stroke::Dashes => Mark::Dashes,
        Stroke::Circles => {
            circle(area, (x + 11.0, y), colour)?;
            return write(area, &curve.words, (x + 29.0, y), WORDS);
        }
        Stroke::Band => {
            let corners = [(x, y - 6.0), (x + 22.0, y + 6.0)].map(fine);
            area.draw(&Rectangle::new(corners, colour.mix(0.22).filled()))?;
            return write(area, &curve.words, (x + 29.0, y), WORDS);
        }
    };
    legend(area, (x, y), colour, mark, &curve.words)
}

impl Ink {
    fn colour(self) -> Colour {
        match self {
            Self::Black => INK,
            Self::Blue => BLUE,
            Self::Vermilion => VERMILION,
            Self::Green => GREEN,
            Self::Grey => GREY,
        }
    }
}

/// A text with its powers of ten as they are printed: "h = 4.5e-5" as h = 4.5 times 10 to the -5.
fn typeset(text: &str) -> String {
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
}
