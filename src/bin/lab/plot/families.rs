//! Error against cost, one row of panels a family of methods: small multiples that can be read without colour.

use super::marks::{Shape, shape};
use vibroimpact::error::Result;
use vibroimpact::report::File;
use vibroimpact::report::plot::{
    Area, BLUE, CENTRED, Colour, Drawn, FAINT, GREEN, HALO, Hang, INK, Mark, Panel, Points,
    VERMILION, WORDS, legend, line, picture, range, superscript, write,
};

/// Methods of one kind.
#[derive(Debug, Clone)]
pub struct Family {
    /// What they have in common.
    pub name: String,
    /// The methods; at most six are told apart.
    pub methods: Vec<Traced>,
}

/// One method at several levels.
#[derive(Debug, Clone)]
pub struct Traced {
    /// Its name in the legend.
    pub name: String,
    /// Cost and error in each column, coarse to fine; both positive, others are left out.
    pub points: [Vec<(f64, f64)>; 2],
}

/// Colour and mark of the methods of a family, in their order.
const MARKS: [(Colour, Shape); 6] = [
    (BLUE, Shape::Disc),
    (VERMILION, Shape::Ring),
    (GREEN, Shape::Square),
    (INK, Shape::Triangle),
    (BLUE, Shape::Frame),
    (VERMILION, Shape::Cross),
];

/// A row of two panels a family, on the same axes in each column, with the least error for the cost of all families behind.
///
/// # Errors
/// [`vibroimpact::Error::Io`] for a picture that cannot be drawn.
pub fn families(
    name: impl Into<String>,
    title: &str,
    (x_label, y_labels): (&str, [&str; 2]),
    all: &[Family],
) -> Result<File> {
    let (width, height, words) = (430.0, 176.0, 240.0);
    let size = (
        (90.0 + 2.0 * (width + 80.0) + words) as u32,
        (84.0 + height * all.len() as f64 + 30.0) as u32,
    );
    let ranges = [0, 1].map(|k| {
        let points = || {
            all.iter()
                .flat_map(|it| &it.methods)
                .flat_map(move |it| logs(&it.points[k]))
        };
        let along = |f: fn(&(f64, f64)) -> f64| range(points().map(|it| f(&it)), 0.05);
        along(|it| it.0)
            .zip(along(|it| it.1))
            .map(|ranges| (ranges, front(points().collect())))
    });
    picture(name, size, |area| {
        write(area, title, (30.0, 22.0), (16.0, Hang::Left, INK))?;
        for (row, family) in all.iter().enumerate() {
            let top = 64.0 + height * row as f64;
            for (k, ranges) in ranges.iter().enumerate() {
                let Some(((x, y), front)) = ranges else {
                    continue;
                };
                let left = 92.0 + (width + 80.0) * k as f64;
                let place = [left, top, width, height - 26.0];
                let panel = Panel::new(place, *x, *y).logarithmic(true);
                let last = row + 1 == all.len();
                // The label stands above the column: panels are lower than it is long.
                log_axes(area, &panel, (x_label, " "), last)?;
                if row == 0 {
                    write(area, y_labels[k], (left, top - 14.0), WORDS)?;
                }
                panel.curve(area, front, HALO, 5.0)?;
                for (method, (colour, mark)) in family.methods.iter().zip(MARKS) {
                    let points = logs(&method.points[k]);
                    panel.curve(area, &points, colour, 1.25)?;
                    for (x, y) in points {
                        shape(area, panel.at(x, y), colour, mark)?;
                    }
                }
                panel.frame(area)?;
            }
            let left = 92.0 + 2.0 * (width + 80.0) - 50.0;
            let font = (14.0, Hang::Left, INK);
            write(area, &family.name, (left, top + 10.0), font)?;
            for (k, (method, (colour, mark))) in family.methods.iter().zip(MARKS).enumerate() {
                let (x, y) = (left, top + 31.0 + 19.0 * k as f64);
                line(area, &[(x, y), (x + 22.0, y)], colour, 1.25)?;
                shape(area, (x + 11.0, y), colour, mark)?;
                write(area, &method.name, (x + 29.0, y), WORDS)?;
            }
        }
        let at = (f64::from(size.0) - 330.0, 22.0);
        let words = "least error for the cost, all methods";
        legend(area, at, HALO, Mark::Halo, words)
    })
}

/// Decimal logarithms of what is positive.
fn logs(points: &[(f64, f64)]) -> Points {
    let positive = points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0);
    positive.map(|(x, y)| (x.log10(), y.log10())).collect()
}

/// The points that no other beats in both cost and error.
fn front(mut points: Points) -> Points {
    points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut least = f64::INFINITY;
    points.retain(|(_, y)| {
        let better = *y < least;
        least = least.min(*y);
        better
    });
    points
}

/// Axes whose both numbers are decimal logarithms; those of x only where asked for.
fn log_axes(
    area: &Area<'_>,
    panel: &Panel,
    (x_label, y_label): (&str, &str),
    numbers: bool,
) -> Drawn {
    let bare = Panel {
        x: (0.0, 0.0),
        ..panel.clone()
    };
    // Without a range of x the panel draws no grid along it.
    bare.axes(area, if numbers { x_label } else { "" }, y_label)?;
    let (low, high) = (panel.x.0.ceil() as i64, panel.x.1.floor() as i64);
    for k in low..=high {
        let (px, _) = panel.at(k as f64, panel.y.0);
        line(area, &[(px, panel.top), (px, panel.bottom())], FAINT, 0.75)?;
        if numbers {
            let text = format!("10{}", superscript(k));
            write(area, &text, (px, panel.bottom() + 13.0), CENTRED)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_keeps_what_nothing_beats() {
        let points = vec![(2.0, 1.0), (1.0, 3.0), (1.5, 4.0), (3.0, 1.0), (4.0, 0.5)];
        assert_eq!(front(points), [(1.0, 3.0), (2.0, 1.0), (4.0, 0.5)]);
    }
}
