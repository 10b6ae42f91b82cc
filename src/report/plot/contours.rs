//! A number over a plane: filled levels, and lines of one level.

use super::canvas::{Area, Colour, Drawn, rectangle};
#[cfg(feature = "cli")]
use super::canvas::{Points, line};
use super::panel::Panel;

/// Fills a panel with the colours of levels, light to dark, row of pixels by row: numbers over a grid, bilinear between
/// its places, `outside` left and right of it. What is no number stays as it is. Each level is laid over the one below
/// and each run reaches into the row beneath it, so that no seams show at any magnification.
pub(super) fn fill(
    area: &Area<'_>,
    panel: &Panel,
    levels: &[(f64, Colour)],
    (x, y): (&[f64], &[f64]),
    values: impl Fn(usize, usize) -> f64,
    outside: f64,
) -> Drawn {
    /// Pixels.
    const ROW: f64 = 1.0;
    let rows = (panel.height / ROW).ceil() as usize;
    let columns = panel.width.ceil() as usize;
    let place = |(low, high): (f64, f64), part: f64| low + (high - low) * part;
    let mut runs: Vec<Vec<(f64, f64, f64)>> = vec![Vec::new(); levels.len()];
    for row in 0..rows {
        let part = (row as f64 + 0.5) / rows as f64;
        let Some(j) = locate(y, place((panel.y.1, panel.y.0), part)) else {
            continue;
        };
        let at = |k: usize| {
            let i = locate(x, place(panel.x, k as f64 / columns as f64));
            i.map_or(outside, |i| between(&values, (i, j)))
        };
        let values: Vec<f64> = (0..=columns).map(at).collect();
        for ((level, _), runs) in levels.iter().zip(&mut runs) {
            for (from, to) in above(&values, *level) {
                runs.push((row as f64 * ROW, from, to));
            }
        }
    }
    for ((_, colour), runs) in levels.iter().zip(runs) {
        for (y, from, to) in runs {
            let bottom = (panel.top + y + ROW + 0.75).min(panel.bottom());
            let corners = [
                (panel.left + from, panel.top + y),
                ((panel.left + to).min(panel.right()), bottom),
            ];
            rectangle(area, corners, *colour, None)?;
        }
    }
    Ok(())
}

/// Where numbers at 0, 1, 2, ... are at least a level, linear in between; what is no number is not.
fn above(values: &[f64], level: f64) -> Vec<(f64, f64)> {
    let (mut runs, mut start) = (Vec::new(), None);
    let is = |it: f64| it >= level;
    for (k, pair) in values.windows(2).enumerate() {
        let (a, b) = (pair[0], pair[1]);
        let cross = match (a.is_nan(), b.is_nan()) {
            (true, _) => k as f64 + 1.0,
            (_, true) => k as f64,
            _ => k as f64 + (level - a) / (b - a),
        };
        if k == 0 && is(a) {
            start = Some(0.0);
        }
        if !is(a) && is(b) {
            start = Some(cross);
        }
        if is(a) && !is(b) {
            runs.push((start.take().unwrap_or(0.0), cross));
        }
    }
    runs.extend(start.map(|start| (start, (values.len() - 1) as f64)));
    runs
}

/// The cell that holds `x` in ascending or descending `at`, and how far along it `x` is.
fn locate(at: &[f64], x: f64) -> Option<(usize, f64)> {
    let rising = at.first() <= at.last();
    let k = at.partition_point(|it| if rising { *it <= x } else { *it >= x });
    let k = if k == at.len() && at.last() == Some(&x) {
        k - 1
    } else {
        k
    };
    if k == 0 || k >= at.len() {
        return None;
    }
    let (a, b) = (at[k - 1], at[k]);
    Some((k - 1, (x - a) / (b - a)))
}

/// Between the corners of a cell, bilinear: `values` by place along x and y.
fn between(
    values: impl Fn(usize, usize) -> f64,
    ((i, a), (j, b)): ((usize, f64), (usize, f64)),
) -> f64 {
    // A corner without weight may be no number.
    let part = |weight: f64, i: usize, j: usize| {
        if weight == 0.0 {
            0.0
        } else {
            weight * values(i, j)
        }
    };
    part((1.0 - a) * (1.0 - b), i, j)
        + part((1.0 - a) * b, i, j + 1)
        + part(a * (1.0 - b), i + 1, j)
        + part(a * b, i + 1, j + 1)
}

/// Places that cut each cell in parts, with the cell and how far along it they are.
#[cfg(feature = "cli")]
fn cut(at: &[f64]) -> Vec<(f64, (usize, f64))> {
    const PARTS: usize = 8;
    let cells = at.windows(2).enumerate();
    let parts = cells.flat_map(|(k, ends)| {
        let (low, high) = (ends[0], ends[1]);
        (usize::from(k > 0)..=PARTS).map(move |part| {
            let part = part as f64 / PARTS as f64;
            (low + (high - low) * part, (k, part))
        })
    });
    parts.collect()
}

/// Draws the line on which a number over a grid has a level, where [`fill`] has it: bilinear in each cell, which is cut in
/// parts along whose edges it is linear (marching squares).
#[cfg(feature = "cli")]
pub(super) fn level_line(
    area: &Area<'_>,
    panel: &Panel,
    (x, y): (&[f64], &[f64]),
    values: impl Fn(usize, usize) -> f64,
    level: f64,
    (colour, width): (Colour, f64),
) -> Drawn {
    let [x, y] = [x, y].map(cut);
    for i in 1..x.len() {
        for j in 1..y.len() {
            let corners = [(i - 1, j - 1), (i, j - 1), (i, j), (i - 1, j)];
            let numbers = corners.map(|(i, j)| between(&values, (x[i].1, y[j].1)) - level);
            if numbers.iter().any(|it| it.is_nan()) {
                continue;
            }
            let mut cuts = Points::new();
            for k in 0..4 {
                let (a, b) = (numbers[k], numbers[(k + 1) % 4]);
                if (a < 0.0) == (b < 0.0) {
                    continue;
                }
                let part = a / (a - b);
                let ((i, j), (k, l)) = (corners[k], corners[(k + 1) % 4]);
                let along = |a: f64, b: f64| a + part * (b - a);
                cuts.push((along(x[i].0, x[k].0), along(y[j].0, y[l].0)));
            }
            // A saddle: the side of its middle decides which corners belong together.
            if cuts.len() == 4 && (numbers.iter().sum::<f64>() < 0.0) == (numbers[0] < 0.0) {
                cuts.rotate_left(1);
            }
            for ends in cuts.chunks_exact(2) {
                let ends: Points = ends.iter().map(|(x, y)| panel.at(*x, *y)).collect();
                line(area, &ends, colour, width)?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_begins_and_ends_where_the_level_is_crossed() {
        assert_eq!(above(&[0.0, 1.0, 2.0, 1.0, 0.0], 1.5), [(1.5, 2.5)]);
        assert_eq!(above(&[3.0, 1.0, 1.0, 3.0], 2.0), [(0.0, 0.5), (2.5, 3.0)]);
        let hole = [2.0, f64::NAN, 2.0, 2.0];
        assert_eq!(above(&hole, f64::NEG_INFINITY), [(0.0, 0.0), (2.0, 3.0)]);
        assert!(above(&[0.0, 1.0], 2.0).is_empty());
    }

    #[test]
    fn a_cell_is_found_on_rising_and_on_falling_axes() {
        assert_eq!(locate(&[0.0, 1.0, 3.0], 2.0), Some((1, 0.5)));
        assert_eq!(locate(&[3.0, 1.0, 0.0], 2.0), Some((0, 0.5)));
        assert_eq!(locate(&[0.0, 1.0, 3.0], 3.0), Some((1, 1.0)));
        assert_eq!(locate(&[0.0, 1.0, 3.0], 3.1), None);
        let plane = |i: usize, j: usize| i as f64 + 10.0 * j as f64;
        assert_eq!(between(plane, ((1, 0.5), (2, 0.25))), 1.5 + 22.5);
    }
}
