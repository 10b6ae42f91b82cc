//! The damping ratio that fits the measurements best.
//!
//! `measured.csv` of the folder lists `h,what,value`; the model is the closed form with zeta as its one
//! unknown, and the sum of squares of ln(model/measured) is made least. Nothing is known of the errors of the
//! measurements but the scatter of the residuals: a fit has one standard error from it, and a bootstrap over
//! the levels says what their disagreement leaves open.

use super::roots;
use crate::rows::{Row, rows};
use std::f64::consts::LN_10;
use std::fs;
use std::path::Path;
use vibroimpact::contact::ContactLaw;
use vibroimpact::error::{Error, Result};
use vibroimpact::estimate::{Estimate, Origin};
use vibroimpact::oscillator::Oscillator;
use vibroimpact::rig::Rig;
use vibroimpact::stationary::Stationary;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    h: f64,
    what: What,
    value: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum What {
    /// Deviation of N, Tables 1 and 2.
    Std,
    /// Share of the time out of contact, Table 3.
    Lost,
    /// Losses in 20 s.
    Losses,
    /// Mean flight in milliseconds.
    Flight,
}

/// Observation time of Table 3 in seconds.
const WINDOW: f64 = 20.0;

impl What {
    fn parse(text: &str) -> Option<Self> {
        Some(match text {
            "std" => Self::Std,
            "lost" => Self::Lost,
            "losses" => Self::Losses,
            "flight_ms" => Self::Flight,
            _ => return None,
        })
    }
}

fn measured(folder: &Path) -> Result<Vec<Measured>> {
    let path = folder.join("measured.csv");
    let shown = path.display().to_string();
    let text = fs::read_to_string(&path)
        .map_err(|error| Error::invalid(&shown, error, "a list of measurements"))?;
    let measured = |row: Row<'_>| {
        let above_zero = |field: usize| {
            let number: f64 = row.get(field)?;
            let good = number.is_finite() && number > 0.0;
            good.then_some(number)
                .ok_or_else(|| row.wrong("numbers above 0"))
        };
        let what = row.fields.get(1).and_then(|it| What::parse(it));
        Ok(Measured {
            h: above_zero(0)?,
            what: what.ok_or_else(|| row.wrong("h,std|lost|losses|flight_ms,value"))?,
            value: above_zero(2)?,
        })
    };
    rows(&shown, &text, ',').map(measured).collect()
}

/// ln(model/measured), with the error of the model.
fn residual(it: &Measured, rig: &Rig, zeta: f64) -> Result<Estimate> {
    let law = Stationary::of(&Oscillator::new(ContactLaw::Hertz, zeta, it.h)?)?;
    let none = || Error::invalid("damping", it.value, "a contact that can be lost");
    let model = match it.what {
        What::Std => law.std_force(),
        What::Lost => law.contact_loss_probability().ok_or_else(none)?,
        What::Losses => law.losses_in(rig.time(WINDOW)).ok_or_else(none)?,
        What::Flight => law
            .mean_flight()
            .ok_or_else(none)?
            .scaled(1e3 * rig.seconds(1.0)),
    };
    Ok(model.mapped((model.value / it.value).ln(), 1.0 / model.value))
}

/// Damping ratios that are searched, as ln zeta, and in how many intervals: a tenth of a decade each.
const LOWEST: f64 = -7.0 * LN_10;
const HIGHEST: f64 = -LN_10;
const INTERVALS: u32 = 60;

/// Sum of the squares of ln(model/measured) at ln zeta.
fn sum_of_squares(list: &[Measured], rig: &Rig, ln_zeta: f64) -> Result<f64> {
    let residuals = list.iter().map(|it| residual(it, rig, ln_zeta.exp()));
    residuals.map(|r| r.map(|r| r.value * r.value)).sum()
}

/// Slope of ln(model/measured) over ln zeta.
fn slope(it: &Measured, rig: &Rig, ln_zeta: f64) -> Result<f64> {
    let [above, below] = [1e-3, -1e-3].map(|step| residual(it, rig, (ln_zeta + step).exp()));
    Ok((above?.value - below?.value) / 2e-3)
}

/// Root of the sum over the levels of the square of the sum of a level's `parts`, times L/(L - 1) of L levels:
/// the numbers of one level share its errors (Liang and Zeger, Biometrika 73, 1986, 13). In a list of one level
/// each number counts for itself.
fn scatter_of_levels(list: &[Measured], parts: &[f64]) -> f64 {
    let mut sums: Vec<(f64, f64)> = Vec::new();
    for (it, part) in list.iter().zip(parts) {
        match sums.iter_mut().find(|(h, _)| *h == it.h) {
            Some((_, sum)) => *sum += part,
            None => sums.push((it.h, *part)),
        }
    }
    if sums.len() < 2 {
        sums = parts.iter().map(|part| (0.0, *part)).collect();
    }
    let n = sums.len() as f64;
    let square: f64 = sums.iter().map(|(_, sum)| sum * sum).sum();
    (n / (n - 1.0) * square).sqrt()
}

/// The damping ratio that fits `list` best, with its standard error from the scatter between the levels. The
/// losses of contact are not monotone in the damping ratio, so that the sum of squares may have several minima:
/// the lowest is taken.
pub fn fit(list: &[Measured], rig: &Rig) -> Result<Estimate> {
    if list.len() < 2 {
        let accepted = "two measurements or more";
        return Err(Error::invalid("damping", list.len(), accepted));
    }
    let sum = |ln_zeta: f64| sum_of_squares(list, rig, ln_zeta);
    let best = roots::least(&sum, LOWEST, HIGHEST, INTERVALS)?;
    let zeta = best.exp();
    let (mut parts, mut squares) = (Vec::new(), 0.0);
    for it in list {
        let slope = slope(it, rig, best)?;
        parts.push(slope * residual(it, rig, zeta)?.value);
        squares += slope * slope;
    }
    let error = zeta * scatter_of_levels(list, &parts) / squares;
    Ok(Estimate::new(zeta, error, Origin::Sampling))
}

/// Every damping ratio between 1e-7 and 0.1 at which the model gives one measured number, ascending.
pub fn ratios(it: &Measured, rig: &Rig) -> Result<Vec<Estimate>> {
    let value = |ln_zeta: f64| Ok(residual(it, rig, ln_zeta.exp())?.value);
    let found = roots::all(&value, LOWEST, HIGHEST, INTERVALS)?;
    let ratio = |ln_zeta: &f64| {
        let zeta = ln_zeta.exp();
        let error = residual(it, rig, zeta)?.error / slope(it, rig, *ln_zeta)?.abs();
        let rounding = 1e-14 * ln_zeta.abs();
        let error = zeta * (error + rounding);
        Ok(Estimate::new(zeta, error, Origin::Quadrature))
    };
    found.iter().map(ratio).collect()
}

/// The one damping ratio at which the model gives a measured number.
fn only_ratio(it: &Measured, rig: &Rig) -> Result<Estimate> {
    let found = ratios(it, rig)?;
    match found[..] {
        [one] => Ok(one),
        _ => {
            let accepted = format!(
                "a number that one damping ratio gives; {} give it: ask for root-1-H-of-WHAT, root-2-H-of-WHAT",
                found.len()
            );
            Err(Error::invalid("computed: damping", it.value, accepted))
        }
    }
}

/// The largest that the model can make a number at any damping ratio, and that ratio.
fn most(it: &Measured, rig: &Rig) -> Result<[Estimate; 2]> {
    let falling = |ln_zeta: f64| Ok(-residual(it, rig, ln_zeta.exp())?.value);
    let ln_zeta = roots::least(&falling, LOWEST, HIGHEST, INTERVALS)?;
    let top = residual(it, rig, ln_zeta.exp())?;
    // A golden section tells places apart by values that differ by more than their errors.
    let place = 10.0 * (top.error + f64::EPSILON).sqrt();
    Ok([
        top.mapped(it.value * top.value.exp(), it.value * top.value.exp()),
        Estimate::new(ln_zeta.exp(), ln_zeta.exp() * place, Origin::Quadrature),
    ])
}

/// Geometric mean of the ratios that each number alone asks for, with its standard error from the
/// scatter between the levels. Each counts the same, while in [`fit`] the numbers that change fastest with zeta decide.
fn mean_of_each(list: &[Measured], rig: &Rig) -> Result<Estimate> {
    let each = list.iter().map(|it| Ok(only_ratio(it, rig)?.value.ln()));
    let each: Vec<f64> = each.collect::<Result<_>>()?;
    let n = each.len() as f64;
    let mean = each.iter().sum::<f64>() / n;
    let parts: Vec<f64> = each.iter().map(|it| (it - mean) / n).collect();
    let error = mean.exp() * scatter_of_levels(list, &parts);
    Ok(Estimate::new(mean.exp(), error, Origin::Sampling))
}

/// The quantile of [`fit`] over all resamples of the levels with replacement (the bootstrap; Efron, Ann.
/// Statist. 7, 1979, 1), every measurement of a level taken or left together. Nothing is drawn: of n levels
/// all n^n resamples are counted.
pub fn bootstrap(list: &[Measured], rig: &Rig, quantile: f64) -> Result<Estimate> {
    /// Intervals of ln zeta in which the sums of squares are tabulated.
    const TABLE: u32 = 600;
    let mut levels: Vec<f64> = list.iter().map(|it| it.h).collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let of_level = |h: &f64| -> Vec<Measured> {
        let all = list.iter().filter(|it| it.h == *h);
        all.copied().collect()
    };
    let place = |k: u32| LOWEST + (HIGHEST - LOWEST) * f64::from(k) / f64::from(TABLE);
    let tables: Vec<Vec<f64>> = levels
        .iter()
        .map(|h| {
            let level = of_level(h);
            (0..=TABLE)
                .map(|k| sum_of_squares(&level, rig, place(k)))
                .collect()
        })
        .collect::<Result<_>>()?;
    let best = |times: &[u32]| -> f64 {
        let sum = |k: u32| -> f64 {
            let rows = times.iter().zip(&tables);
            rows.map(|(n, table)| f64::from(*n) * table[k as usize])
                .sum()
        };
        let k = (1..TABLE).min_by(|a, b| sum(*a).total_cmp(&sum(*b)));
        let k = k.unwrap_or(1);
        // The parabola through the lowest entry and its neighbours.
        let (below, here, above) = (sum(k - 1), sum(k), sum(k + 1));
        let bend = below - 2.0 * here + above;
        let shift = if bend > 0.0 {
            0.5 * (below - above) / bend
        } else {
            0.0
        };
        place(k) + shift * (HIGHEST - LOWEST) / f64::from(TABLE)
    };
    let mut resamples: Vec<(f64, f64, Vec<u32>)> = multisets(levels.len())
        .into_iter()
        .map(|times| (best(&times), arrangements(&times), times))
        .collect();
    resamples.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = resamples.iter().map(|it| it.1).sum();
    let mut seen = 0.0;
    let found = resamples.iter().find(|it| {
        seen += it.1;
        seen >= quantile * total
    });
    let Some((tabulated, _, times)) = found else {
        let accepted = "a share between 0 and 1";
        return Err(Error::invalid("bootstrap", quantile, accepted));
    };
    let mut resample = Vec::new();
    for (h, n) in levels.iter().zip(times) {
        for _ in 0..*n {
            resample.extend(of_level(h));
        }
    }
    let exact = fit(&resample, rig)?.value;
    // What the table may be off by, here and for its neighbours in the order.
    let error = (exact - tabulated.exp()).abs() + 1e-7 * exact;
    Ok(Estimate::new(exact, error, Origin::Quadrature))
}

/// How often each of n things is drawn, for every unordered draw of n with replacement.
fn multisets(n: usize) -> Vec<Vec<u32>> {
    fn extend(left: u32, places: usize, begun: &mut Vec<u32>, all: &mut Vec<Vec<u32>>) {
        if places == 1 {
            all.push(begun.iter().copied().chain([left]).collect());
            return;
        }
        for times in 0..=left {
            begun.push(times);
            extend(left - times, places - 1, begun, all);
            begun.pop();
        }
    }
    let mut all = Vec::new();
    if n > 0 {
        extend(n as u32, n, &mut Vec::new(), &mut all);
    }
    all
}

/// In how many orders that draw comes: n! over the product of the factorials.
fn arrangements(times: &[u32]) -> f64 {
    let factorial = |n: u32| (1..=n).map(f64::from).product::<f64>();
    factorial(times.iter().sum()) / times.iter().map(|n| factorial(*n)).product::<f64>()
}

/// The root mean square of ln(model/measured) at a damping ratio.
fn scatter(list: &[Measured], rig: &Rig, zeta: f64) -> Result<Estimate> {
    let sum = sum_of_squares(list, rig, zeta.ln())?;
    let value = (sum / list.len() as f64).sqrt();
    Ok(Estimate::new(value, 1e-6, Origin::Quadrature))
}

/// What [`number`] takes.
const ACCEPTED: &str = "std, losses, all, each, all-but-6e-4, bootstrap-low, bootstrap-high, scatter-at-0.003, \
                        scatter-at-0.005, scatter-at-best, row-H, one-H-of-WHAT, root-K-H-of-WHAT, most-H-of-WHAT or \
                        at-most-H-of-WHAT, with WHAT std, lost, losses or flight_ms";

/// `std` (Tables 1 and 2), `losses` (Table 3), `all`, `all-but-6e-4`, by least squares; `bootstrap-low` and
/// `bootstrap-high`, between which 95 % of the fits to all numbers of resampled levels lie; `each`, the mean
/// of the ratios of every deviation and share; `row-H`, the same for one level; `one-H-of-WHAT`, the ratio
/// that gives a single number, `root-K-H-of-WHAT`, the K-th of several; `most-H-of-WHAT`, the largest that
/// the model can make it, `at-most-H-of-WHAT`, the ratio where it does; `scatter-at-ZETA`, the root mean
/// square of ln(model/measured).
pub fn number(folder: &Path, which: &str) -> Result<Estimate> {
    let all = measured(folder)?;
    let rig = Rig::new(110.0, 232.0, 7e-6)?;
    let pick = |keep: &dyn Fn(&Measured) -> bool| -> Vec<Measured> {
        all.iter().filter(|it| keep(it)).copied().collect()
    };
    let unknown = || Error::invalid("computed: damping", which, ACCEPTED);
    let single = |text: &str| -> Result<Measured> {
        let (h, what) = text.split_once("-of-").ok_or_else(unknown)?;
        let h: f64 = h.parse().map_err(|_| unknown())?;
        let what = What::parse(what).ok_or_else(unknown)?;
        let found = all.iter().find(|it| it.h == h && it.what == what);
        found.copied().ok_or_else(unknown)
    };
    match which {
        "std" => return fit(&pick(&|it| it.what == What::Std), &rig),
        "losses" => return fit(&pick(&|it| it.what != What::Std), &rig),
        "all" => return fit(&all, &rig),
        "each" => {
            let list = pick(&|it| matches!(it.what, What::Std | What::Lost));
            return mean_of_each(&list, &rig);
        }
        "all-but-6e-4" => return fit(&pick(&|it| it.h != 6e-4), &rig),
        "bootstrap-low" => return bootstrap(&all, &rig, 0.025),
        "bootstrap-high" => return bootstrap(&all, &rig, 0.975),
        "scatter-at-0.003" => return scatter(&all, &rig, 0.003),
        "scatter-at-0.005" => return scatter(&all, &rig, 0.005),
        "scatter-at-best" => return scatter(&all, &rig, fit(&all, &rig)?.value),
        _ => {}
    }
    if let Some(row) = which.strip_prefix("row-") {
        let h: f64 = row.parse().map_err(|_| unknown())?;
        let list = pick(&|it| it.h == h && matches!(it.what, What::Std | What::Lost));
        if list.is_empty() {
            return Err(unknown());
        }
        return mean_of_each(&list, &rig);
    }
    if let Some(one) = which.strip_prefix("one-") {
        return only_ratio(&single(one)?, &rig);
    }
    if let Some(root) = which.strip_prefix("root-") {
        let (k, one) = root.split_once('-').ok_or_else(unknown)?;
        let k: usize = k.parse().map_err(|_| unknown())?;
        let found = ratios(&single(one)?, &rig)?;
        let place = k.checked_sub(1).and_then(|k| found.get(k).copied());
        return place.ok_or_else(unknown);
    }
    if let Some(one) = which.strip_prefix("most-") {
        return Ok(most(&single(one)?, &rig)?[0]);
    }
    if let Some(one) = which.strip_prefix("at-most-") {
        return Ok(most(&single(one)?, &rig)?[1]);
    }
    Err(unknown())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measurements_made_of_a_damping_ratio_give_it_back() {
        let rig = Rig::new(110.0, 232.0, 7e-6).unwrap();
        let made = |noise: [f64; 3]| -> Vec<Measured> {
            [
                (3e-4, What::Std),
                (1.7e-3, What::Lost),
                (2.5e-3, What::Losses),
            ]
            .into_iter()
            .zip(noise)
            .map(|((h, what), noise)| {
                let one = Measured {
                    h,
                    what,
                    value: 1.0,
                };
                let model = residual(&one, &rig, 0.0037).unwrap().value.exp();
                let value = model * (1.0 + noise);
                Measured { value, ..one }
            })
            .collect()
        };
        let exact = fit(&made([0.0; 3]), &rig).unwrap();
        assert!(
            (exact.value - 0.0037).abs() < 1e-9 && exact.error < 1e-9,
            "{exact}"
        );
        let noisy = fit(&made([0.1, -0.1, 0.1]), &rig).unwrap();
        println!("{noisy}");
        assert!((noisy.value - 0.0037).abs() < 2.0 * noisy.error && noisy.error > 1e-4);
    }

    fn losses(value: f64) -> Measured {
        let (h, what) = (2.5e-3, What::Losses);
        Measured { h, what, value }
    }

    #[test]
    fn numbers_of_one_level_count_once() {
        let of = |h: f64| Measured {
            h,
            what: What::Std,
            value: 1.0,
        };
        // The mean of four: as two of two when they come from two levels.
        let parts = [0.25, 0.25, -0.25, -0.25];
        let two = scatter_of_levels(&[of(1.0), of(1.0), of(2.0), of(2.0)], &parts);
        let four = scatter_of_levels(&[of(1.0), of(2.0), of(3.0), of(4.0)], &parts);
        assert!((two - 1.0).abs() < 1e-15 && (four - (1.0f64 / 3.0).sqrt()).abs() < 1e-15);
        let one = scatter_of_levels(&[of(1.0), of(1.0), of(1.0), of(1.0)], &parts);
        assert_eq!(one, four);
    }

    #[test]
    fn the_2227_losses_have_two_damping_ratios_and_3000_have_none() {
        let rig = Rig::new(110.0, 232.0, 7e-6).unwrap();
        let found = ratios(&losses(2227.0), &rig).unwrap();
        let [top, place] = most(&losses(2227.0), &rig).unwrap();
        println!("{found:?}, at most {top} at {place}");
        assert_eq!(found.len(), 2);
        assert!((found[0].value - 2.93e-4).abs() < 5e-7, "{}", found[0]);
        assert!((found[1].value - 2.68e-3).abs() < 5e-6, "{}", found[1]);
        assert!((top.value - 2725.0).abs() < 0.5, "{top}");
        assert!((place.value - 1.03e-3).abs() < 5e-6, "{place}");
        for it in &found {
            assert!(it.error < 1e-9 * it.value, "{it}");
        }
        assert!(ratios(&losses(3000.0), &rig).unwrap().is_empty());
        let message = only_ratio(&losses(2227.0), &rig).unwrap_err().to_string();
        assert!(message.contains("root-1"), "{message}");
    }

    #[test]
    fn a_bootstrap_of_levels_that_agree_is_narrow_and_one_level_that_does_not_widens_it() {
        let rig = Rig::new(110.0, 232.0, 7e-6).unwrap();
        let made = |odd: f64| -> Vec<Measured> {
            [(3e-4, 0.0037), (1e-3, odd), (2.5e-3, 0.0037)]
                .into_iter()
                .map(|(h, zeta)| {
                    let what = What::Std;
                    let one = Measured {
                        h,
                        what,
                        value: 1.0,
                    };
                    let value = residual(&one, &rig, zeta).unwrap().value.exp();
                    Measured { value, ..one }
                })
                .collect()
        };
        let ends = |list: &[Measured]| {
            [0.025, 0.975].map(|share| bootstrap(list, &rig, share).unwrap().value)
        };
        let [low, high] = ends(&made(0.0037));
        assert!((low - 0.0037).abs() < 1e-9 && (high - 0.0037).abs() < 1e-9);
        // One resample of 27 holds the odd level alone.
        let [low, high] = ends(&made(0.002));
        println!("{low} to {high}");
        assert!((low - 0.002).abs() < 1e-8 && (high - 0.0037).abs() < 1e-8);
        let all = multisets(3);
        assert_eq!(all.len(), 10);
        assert_eq!(all.iter().map(|it| arrangements(it)).sum::<f64>(), 27.0);
    }
}
