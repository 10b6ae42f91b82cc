//! The damping ratio that fits the measurements best.
//!
//! `measured.csv` of the folder lists `h,what,value`; the model is the closed form with zeta as its one
//! unknown, and the sum of squares of ln(model/measured) is made least. The uncertainty is one standard
//! error from the scatter of the residuals, the only thing known of the errors of the measurements.

use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use crate::estimate::{Estimate, Origin};
use crate::oscillator::Oscillator;
use crate::rig::Rig;
use crate::stationary::Stationary;
use std::fs;
use std::path::Path;

/// A measured number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    h: f64,
    what: What,
    value: f64,
}

/// What was measured.
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

/// The list of measurements in a folder.
///
/// # Errors
/// [`Error::Invalid`] for a list that is missing or a line that is not a measurement.
pub fn measured(folder: &Path) -> Result<Vec<Measured>> {
    let path = folder.join("measured.csv");
    let shown = path.display().to_string();
    let text = fs::read_to_string(&path)
        .map_err(|error| Error::invalid(&shown, error, "a list of measurements"))?;
    let line = |line: &str| {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        let [h, what, value] = fields[..] else {
            return None;
        };
        Some(Measured {
            h: h.parse().ok().filter(|h: &f64| h.is_finite() && *h > 0.0)?,
            what: What::parse(what)?,
            value: value
                .parse()
                .ok()
                .filter(|x: &f64| x.is_finite() && *x > 0.0)?,
        })
    };
    text.lines()
        .skip(1)
        .map(|text| {
            let accepted = "h,std|lost|losses|flight_ms,value";
            line(text).ok_or_else(|| Error::invalid(&shown, text, accepted))
        })
        .collect()
}

/// ln(model/measured).
fn residual(it: &Measured, rig: &Rig, zeta: f64) -> Result<f64> {
    let law = Stationary::of(&Oscillator::new(ContactLaw::Hertz, zeta, it.h)?)?;
    let none = || Error::invalid("damping", it.value, "a contact that can be lost");
    let model = match it.what {
        What::Std => law.std_force().value,
        What::Lost => law.contact_loss_probability().ok_or_else(none)?.value,
        What::Losses => law.losses_in(rig.time(WINDOW)).ok_or_else(none)?.value,
        What::Flight => rig.seconds(law.mean_flight().ok_or_else(none)?.value) * 1e3,
    };
    Ok((model / it.value).ln())
}

/// The damping ratio that fits `list` best, and its standard error from the scatter; for one number, the
/// ratio that gives it, without error.
///
/// # Errors
/// Those of the oscillator.
pub fn fit(list: &[Measured], rig: &Rig) -> Result<Estimate> {
    let sum = |ln_zeta: f64| -> Result<f64> {
        let squares = list.iter().map(|it| residual(it, rig, ln_zeta.exp()));
        squares.map(|r| r.map(|r| r * r)).sum()
    };
    // Every residual falls as zeta grows, so the sum has one minimum; golden section to rounding.
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    let (mut low, mut high) = (1e-4f64.ln(), 0.1f64.ln());
    let mut inner = [high - golden * (high - low), low + golden * (high - low)];
    let mut at = [sum(inner[0])?, sum(inner[1])?];
    while high - low > 1e-8 {
        if at[0] < at[1] {
            high = inner[1];
            inner = [high - golden * (high - low), inner[0]];
            at = [sum(inner[0])?, at[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + golden * (high - low)];
            at = [at[1], sum(inner[1])?];
        }
    }
    let best = 0.5 * (low + high);
    let mut slopes = 0.0;
    for it in list {
        let slope =
            residual(it, rig, (best + 1e-3).exp())? - residual(it, rig, (best - 1e-3).exp())?;
        slopes += (slope / 2e-3).powi(2);
    }
    let zeta = best.exp();
    if list.len() < 2 {
        return Ok(Estimate::new(zeta, 1e-7 * zeta, Origin::Quadrature));
    }
    let scatter = sum(best)? / (list.len() - 1) as f64;
    Ok(Estimate::new(
        zeta,
        zeta * (scatter / slopes).sqrt(),
        Origin::Sampling,
    ))
}

/// Geometric mean of the ratios that each number alone asks for, with its standard error from their
/// scatter. Each counts the same, while in [`fit`] the numbers that change fastest with zeta decide.
fn mean_of_each(list: &[Measured], rig: &Rig) -> Result<Estimate> {
    let each: Vec<f64> = list
        .iter()
        .map(|it| Ok(fit(std::slice::from_ref(it), rig)?.value.ln()))
        .collect::<Result<_>>()?;
    let n = each.len() as f64;
    let mean = each.iter().sum::<f64>() / n;
    let square = each.iter().map(|it| (it - mean).powi(2)).sum::<f64>();
    let error = mean.exp() * (square / (n * (n - 1.0).max(1.0))).sqrt();
    Ok(Estimate::new(mean.exp(), error, Origin::Sampling))
}

/// The root mean square of ln(model/measured) at a damping ratio.
fn scatter(list: &[Measured], rig: &Rig, zeta: f64) -> Result<Estimate> {
    let squares = list.iter().map(|it| residual(it, rig, zeta));
    let sum: f64 = squares.map(|r| r.map(|r| r * r)).sum::<Result<f64>>()?;
    let value = (sum / list.len() as f64).sqrt();
    Ok(Estimate::new(value, 1e-6, Origin::Quadrature))
}

/// `std` (Tables 1 and 2), `losses` (Table 3), `all`, `all-but-6e-4`, by least squares; `each`, the mean
/// of the ratios of every deviation and share; `row-H`, the same for one level; `one-H-of-WHAT` from a
/// single number; `scatter-at-ZETA`, the root mean square of ln(model/measured).
///
/// # Errors
/// [`Error::Invalid`] for any other name, and those of [`measured`].
pub fn number(folder: &Path, which: &str) -> Result<Estimate> {
    let all = measured(folder)?;
    let rig = Rig::new(110.0, 232.0, 7e-6)?;
    let pick = |keep: &dyn Fn(&Measured) -> bool| -> Vec<Measured> {
        all.iter().filter(|it| keep(it)).copied().collect()
    };
    let unknown = || Error::invalid("computed: damping", which, "std, losses, all, ...");
    match which {
        "std" => fit(&pick(&|it| it.what == What::Std), &rig),
        "losses" => fit(&pick(&|it| it.what != What::Std), &rig),
        "all" => fit(&all, &rig),
        "each" => mean_of_each(&pick(&|it| matches!(it.what, What::Std | What::Lost)), &rig),
        "all-but-6e-4" => fit(&pick(&|it| it.h != 6e-4), &rig),
        "scatter-at-0.003" => scatter(&all, &rig, 0.003),
        "scatter-at-0.005" => scatter(&all, &rig, 0.005),
        "scatter-at-best" => scatter(&all, &rig, fit(&all, &rig)?.value),
        row if row.starts_with("row-") => {
            let h: f64 = row[4..].parse().map_err(|_| unknown())?;
            let list = pick(&|it| it.h == h && matches!(it.what, What::Std | What::Lost));
            if list.is_empty() {
                return Err(unknown());
            }
            mean_of_each(&list, &rig)
        }
        one => {
            let (h, what) = one
                .strip_prefix("one-")
                .and_then(|rest| rest.split_once("-of-"))
                .ok_or_else(unknown)?;
            let h: f64 = h.parse().map_err(|_| unknown())?;
            let what = What::parse(what).ok_or_else(unknown)?;
            let list = pick(&|it| it.h == h && it.what == what);
            if list.is_empty() {
                return Err(unknown());
            }
            fit(&list, &rig)
        }
    }
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
                let value = residual(&one, &rig, 0.0037).unwrap().exp() * (1.0 + noise);
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
}
