//! map.svg: numbers over the axes of a map: curves over one, contours over two, small multiples over three.

mod field;
mod plane;
mod ruler;
mod scale;

pub(crate) use field::Field;
pub(crate) use ruler::Ruler;

use crate::report::plot::canvas::{
    BLUE, Picture, Points, SUBTITLE, VERMILION, line, picture, write,
};
use crate::report::plot::legend::{Mark, legend};
use crate::report::plot::panel::{Panel, range};
use plane::{Sheet, plane};
use ruler::axes;
use scale::Scale;

/// The picture of a map; None where there is nothing to be drawn, or more than three axes of several points. With three,
/// the first number at up to a dozen points of the last axis.
pub(crate) fn map(rulers: &[Ruler], fields: &[Field]) -> Picture {
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
        _ => None,
    }
}

/// Curves with their error bands, a panel a number.
fn curves(x: &Ruler, fields: &[Field]) -> Picture {
    let drawn: Vec<(&Field, Scale)> = fields
        .iter()
        .filter_map(|it| Some((it, Scale::of(it)?)))
        .collect();
    let range_x = x.range().filter(|_| !drawn.is_empty())?;
    let columns = drawn.len().min(2);
    let rows = drawn.len().div_ceil(columns);
    let size = (
        (478.0 * columns as f64 + 10.0) as u32,
        (318.0 * rows as f64 + 34.0) as u32,
    );
    Some(picture("map.svg", size, |area| {
        for (k, (field, scale)) in drawn.iter().enumerate() {
            let heights = field.values.iter().map(|it| scale.place(*it));
            let points: Points = x.places().into_iter().zip(heights).collect();
            let Some(y) = range([scale.range.0, scale.range.1], 0.06) else {
                continue;
            };
            let left = 92.0 + 478.0 * (k % columns) as f64;
            let top = 58.0 + 318.0 * (k / columns) as f64;
            let panel = Panel::new([left, top, 364.0, 232.0], range_x, y);
            let above = (panel.left, panel.top - 14.0);
            write(area, &scale.title(field), above, SUBTITLE)?;
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
            if x.words.is_some() {
                for (x, low, high) in &band {
                    let ends = [*low, *high].map(|y| panel.at(*x, y));
                    line(area, &ends, BLUE, 1.0)?;
                }
            } else {
                panel.band(area, &band, BLUE)?;
                panel.curve(area, &points, BLUE, 1.5)?;
            }
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
        let words = "value, band: its error";
        legend(area, (92.0, 18.0), BLUE, Mark::Line, words)
    }))
}

/// The first number over the first two axes, at up to a dozen points of the third.
fn multiples([x, y, z]: [&Ruler; 3], fields: &[Field]) -> Picture {
    let (field, scale) = fields.iter().find_map(|it| Some((it, Scale::of(it)?)))?;
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
        assert!(map(&[x], &[nothing]).is_none());
    }
}
