//! Error estimates of the decay rates against stored references: thirty oscillators, three laws, damping ratios from
//! 1e-3 to 5, temperatures from 1e-4 to 94.
//!
//! The references are exact for G = q, else rates at a resolution far beyond what the tolerances ask, with their own
//! estimates (`cargo test --release --bin lab write_references -- --ignored` writes them).

use super::calibration::TOLERANCES;
use crate::rows::{Row, rows};
use rayon::prelude::*;
use std::fmt;
use vibroimpact::contact::ContactLaw;
use vibroimpact::error::Result;
use vibroimpact::fokker_planck::{DecayRate, Settings, decay_rates};
use vibroimpact::oscillator::Oscillator;

/// Scene, real part, imaginary part and error of each known eigenvalue.
const REFERENCES: &str = include_str!("../../../../validation/precision/decay_rates.csv");

/// Rates asked of each oscillator.
const COUNT: usize = 4;

/// The share of rates that may err more than their estimates, and by how much at most.
pub const MOST_OUTSIDE: f64 = 0.02;
pub const FARTHEST: f64 = 2.0;

/// The thirty oscillators.
pub fn scenes() -> Result<Vec<Oscillator>> {
    let hertz = [
        (0.005, 2e-3),
        (0.005, 3.2e-3),
        (0.005, 3e-6),
        (0.005, 8e-5),
        (0.005, 5e-4),
        (0.005, 1.2e-3),
        (0.008, 1.14e-3),
        (0.005, 0.3),
        (0.9, 0.36),
    ];
    let bilinear = [(0.005, 2e-3), (0.005, 8e-5)];
    let mut all: Vec<(ContactLaw, f64, f64)> = Vec::new();
    all.extend(hertz.map(|(zeta, h)| (ContactLaw::Hertz, zeta, h)));
    all.extend(bilinear.map(|(zeta, h)| (ContactLaw::Bilinear, zeta, h)));
    // Damping and temperature by a sequence of low discrepancy in the plane (powers of the plastic number).
    for k in 1..20 {
        let part = |x: f64| (f64::from(k) * x).fract();
        let zeta = 1e-3 * 5e3f64.powf(part(0.754_877_666_246_693));
        let temperature = 1e-4 * 3e5f64.powf(part(0.569_840_290_998_053));
        let law = match k % 5 {
            0 => ContactLaw::Linear,
            1 => ContactLaw::Bilinear,
            _ => ContactLaw::Hertz,
        };
        let h = 2.0 * zeta * temperature / std::f64::consts::PI;
        all.push((law, zeta, h));
    }
    let oscillators = all.into_iter();
    oscillators
        .map(|(law, zeta, h)| Oscillator::new(law, zeta, h))
        .collect()
}

/// A rate beside what is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct JudgedRate {
    pub scene: usize,
    pub tolerance: f64,
    pub rate: DecayRate,
    /// Its distance from the nearest reference, less that one's own error.
    pub error: f64,
    /// Whether its estimate is above the tolerance, and nothing says so.
    pub unsaid: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Rates {
    pub judged: Vec<JudgedRate>,
}

impl Rates {
    /// Runs one scene of `each` at all tolerances of the calibration. Where the loosest run is as fine as the tightest,
    /// those between are too and are left out.
    pub fn calibrate(each: usize) -> Result<Self> {
        let references = references()?;
        let of = |(scene, oscillator): (usize, &Oscillator)| {
            let mut judged = Vec::new();
            let solve = |tolerance: f64| {
                let settings = Settings {
                    tolerance,
                    ..Settings::default()
                };
                decay_rates(oscillator, COUNT, &settings).map(|it| (tolerance, it))
            };
            let [loosest, between @ .., tightest] = TOLERANCES;
            let mut runs = vec![solve(loosest)?, solve(tightest)?];
            if runs[0].1.functions != runs[1].1.functions {
                for tolerance in between {
                    runs.push(solve(tolerance)?);
                }
            }
            let known: Vec<_> = references.iter().filter(|it| it.0 == scene).collect();
            for (tolerance, it) in runs {
                for rate in &it.rates {
                    let away = |known: &&(usize, DecayRate)| {
                        let known = known.1;
                        let distance = (rate.re - known.re).hypot(rate.im - known.im);
                        (distance - known.error).max(0.0)
                    };
                    let above = rate.error > tolerance * rate.re.hypot(rate.im);
                    judged.push(JudgedRate {
                        scene,
                        tolerance,
                        rate: *rate,
                        error: known.iter().map(away).fold(f64::INFINITY, f64::min),
                        unsaid: above && it.shortfall.is_none(),
                    });
                }
            }
            Ok(judged)
        };
        let scenes = scenes()?;
        let some: Vec<_> = scenes.iter().enumerate().step_by(each).collect();
        let judged: Result<Vec<_>> = some.into_par_iter().map(of).collect();
        Ok(Self {
            judged: judged?.concat(),
        })
    }

    /// Those that err more than their estimates.
    pub fn outside(&self) -> impl Iterator<Item = &JudgedRate> {
        self.judged.iter().filter(|it| it.error > it.rate.error)
    }

    /// The largest error over its estimate.
    pub fn worst(&self) -> f64 {
        let ratios = self.judged.iter().map(|it| it.error / it.rate.error);
        ratios.fold(0.0, f64::max)
    }

    /// What of the goals is missed, in words.
    pub fn missed(&self) -> Vec<String> {
        let mut missed = Vec::new();
        let share = self.outside().count() as f64 / self.judged.len() as f64;
        if share > MOST_OUTSIDE {
            missed.push(format!("{:.1} % of decay rates outside", 100.0 * share));
        }
        if self.worst() > FARTHEST {
            missed.push(format!("a decay rate by {:.1} times", self.worst()));
        }
        if self.judged.iter().any(|it| it.unsaid) {
            missed.push("the estimate of a decay rate above its tolerance, unsaid".into());
        }
        missed
    }
}

impl fmt::Display for Rates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "decay rates: {} of {} err more than their estimates; the largest error is {:.2} of its estimate",
            self.outside().count(),
            self.judged.len(),
            self.worst()
        )
    }
}

fn references() -> Result<Vec<(usize, DecayRate)>> {
    let read = |row: Row<'_>| {
        let rate = DecayRate {
            re: row.get(1)?,
            im: row.get(2)?,
            error: row.get(3)?,
        };
        Ok((row.get(0)?, rate))
    };
    let table = rows("validation/precision/decay_rates.csv", REFERENCES, ',');
    table.map(read).collect()
}
