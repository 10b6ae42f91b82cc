//! Every root and the least value of a function of one number, found on a grid; it may fail, as a stationary
//! law of a damping ratio may.

use vibroimpact::roots::{Function, golden};
use vibroimpact::{Error, Result};

/// Every root of `f` in [low, high], ascending: `points` equal intervals are searched for a change of sign.
/// Two roots within one interval are not seen.
pub(super) fn all(f: Function<'_>, low: f64, high: f64, points: u32) -> Result<Vec<f64>> {
    let grid = grid(f, low, high, points)?;
    let mut roots = Vec::new();
    for ends in grid.windows(2) {
        let [(_, below), (_, above)] = [ends[0], ends[1]];
        if (below < 0.0) != (above < 0.0) {
            roots.push(bracketed(f, ends[0], ends[1])?);
        }
    }
    Ok(roots)
}

/// The place of the least value of `f` in [low, high]: the lowest of `points` equal intervals' ends, then a
/// golden section between its neighbours, to 1e-8.
///
/// # Errors
/// [`Error::Invalid`] where the least value lies at an end; those of `f`.
pub(super) fn least(f: Function<'_>, low: f64, high: f64, points: u32) -> Result<f64> {
    let grid = grid(f, low, high, points)?;
    let lowest = (0..grid.len()).min_by(|a, b| grid[*a].1.total_cmp(&grid[*b].1));
    let lowest = lowest.filter(|k| *k > 0 && k + 1 < grid.len());
    let accepted = "a function whose least value lies between the ends";
    let k =
        lowest.ok_or_else(|| Error::invalid("minimum", format!("{low} to {high}"), accepted))?;
    golden(f, grid[k - 1].0, grid[k + 1].0, 1e-8)
}

/// `points` intervals' ends with their values.
fn grid(f: Function<'_>, low: f64, high: f64, points: u32) -> Result<Vec<(f64, f64)>> {
    let place = |k: u32| low + (high - low) * f64::from(k) / f64::from(points);
    (0..=points).map(|k| Ok((place(k), f(place(k))?))).collect()
}

/// The root between two places with values of opposite sign: the Illinois variant of the false position
/// (Dowell and Jarratt, BIT 11, 1971, 168), every fourth time a bisection.
fn bracketed(f: Function<'_>, mut low: (f64, f64), mut high: (f64, f64)) -> Result<f64> {
    for round in 0..200 {
        if high.0 - low.0 <= 4.0 * f64::EPSILON * high.0.abs() {
            break;
        }
        let part = low.1 / (low.1 - high.1);
        let halve = round % 4 == 3 || !(part > 0.0 && part < 1.0);
        let x = low.0 + (high.0 - low.0) * if halve { 0.5 } else { part };
        let y = f(x)?;
        if (y < 0.0) == (low.1 < 0.0) {
            low = (x, y);
            high.1 *= 0.5;
        } else {
            high = (x, y);
            low.1 *= 0.5;
        }
    }
    Ok(0.5 * (low.0 + high.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_root_and_the_lowest_of_two_minima_are_found() {
        let cubic = |x: f64| Ok((x + 1.0) * (x - 0.3) * (x - 2.0));
        let roots = all(&cubic, -3.0, 3.0, 16).unwrap();
        println!("{roots:?}");
        assert_eq!(roots.len(), 3);
        for (root, exact) in roots.iter().zip([-1.0, 0.3, 2.0]) {
            assert!((root - exact).abs() < 1e-13);
        }
        // Minima near -1 and 1; the tilt makes the left one the lower.
        let wells = |x: f64| Ok((x * x - 1.0).powi(2) + 0.1 * x);
        let place = least(&wells, -2.0, 2.0, 16).unwrap();
        assert!((place + 1.0122).abs() < 1e-4, "{place}");
        assert!(least(&|x| Ok(x), -2.0, 2.0, 16).is_err());
        assert!(all(&|x| Ok(x * x + 1.0), -1.0, 1.0, 8).unwrap().is_empty());
    }
}
