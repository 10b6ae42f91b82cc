//! Numbers that no scene gives: what the paper's own procedure would have printed, and how well the
//! sampled densities fit.

use super::cosines::{Draws, Procedure};
use super::damping;
use super::folder::Run;
use super::spectra::Spectra;
use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use crate::estimate::{Estimate, Origin};
use crate::initial::Initial;
use crate::moments::Moments;
use crate::monte_carlo::{self, EnsembleSettings, Noise, RecordSettings, Scheme};
use crate::oscillator::Oscillator;
use crate::rig::Rig;
use crate::stationary::Stationary;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

/// Answers names of the label `computed`: a kind, then `KEY=VALUE` words.
pub struct Evidence<'a> {
    folder: &'a Path,
    runs: &'a [Run],
    draws: RefCell<BTreeMap<String, Draws>>,
    restarts: RefCell<BTreeMap<String, [f64; 3]>>,
    spectra: &'a Spectra,
}

const STATISTICS: [&str; 3] = ["mean", "std", "skewness"];

/// "A number of spectrum up to 400", section 5.2.
const RECORDS: f64 = 400.0;

impl<'a> Evidence<'a> {
    /// For one folder and its runs.
    pub fn new(folder: &'a Path, runs: &'a [Run], spectra: &'a Spectra) -> Self {
        Self {
            folder,
            runs,
            draws: RefCell::default(),
            restarts: RefCell::default(),
            spectra,
        }
    }

    /// The number of that name:
    ///
    /// - `damping.*`: see [`damping`];
    /// - `draws.mean|std|skewness KEYS`: by the paper's procedure (31)-(33) with one draw of cosines for
    ///   the whole record; the error is the spread between draws;
    /// - `records.std|skewness KEYS`: by central differences with `steps` a period, under Gaussian noise up
    ///   to `band`, or with `count` cosines up to it, drawn anew for each of many records;
    /// - `of-q.std|skewness KEYS`: of the displacement, closed form;
    /// - `flight.at-share KEYS`: mean flight in milliseconds on the paper's rig, where the share of the time
    ///   out of contact is `share`;
    /// - `surplus.skewness KEYS`: of N, with so much more probability at the force of flight than is due;
    /// - `restarts.std|skewness KEYS`: over records that begin at rest, their beginnings not left out;
    /// - `rest-records.std|skewness KEYS`: the mean over such records of the number of each record; the error
    ///   is that of the mean of 400 records;
    /// - `spectrum.* KEYS`: see [`super::spectra`];
    /// - `density.worst LABEL`: the largest distance between the sampled and the closed p_N over the bins,
    ///   in standard errors, and `density.chi_square LABEL`: the mean of its squares.
    ///
    /// # Errors
    /// [`Error::Invalid`] for any other name.
    pub fn number(&self, path: &str) -> Result<Estimate> {
        let (kind, keys) = path.split_once(' ').unwrap_or((path, ""));
        if let Some(which) = kind.strip_prefix("damping.") {
            return damping::number(self.folder, which);
        }
        let unknown = || {
            Error::invalid(
                "computed",
                path,
                "a kind of number of src/validation/evidence.rs",
            )
        };
        if let Some(which) = kind.strip_prefix("density.") {
            let run = self.runs.iter().find(|run| run.label == keys);
            let [worst, chi_square] = run
                .map(density_distance)
                .transpose()?
                .flatten()
                .ok_or_else(unknown)?;
            return match which {
                "worst" => Ok(worst),
                "chi_square" => Ok(chi_square),
                _ => Err(unknown()),
            };
        }
        let keys = Keys::parse(keys).ok_or_else(unknown)?;
        if let Some(which) = kind.strip_prefix("draws.") {
            let draws = self.draws(path, &keys)?;
            let k = ["mean", "std", "skewness"]
                .iter()
                .position(|it| *it == which);
            return Ok(draws.spread(k.ok_or_else(unknown)?));
        }
        if let Some(which) = kind.strip_prefix("rest-records.") {
            let k = STATISTICS.iter().position(|it| *it == which);
            let it = self
                .rest_records(path, &keys)?
                .spread(k.ok_or_else(unknown)?);
            return Ok(Estimate::new(
                it.value,
                it.error / RECORDS.sqrt(),
                Origin::Sampling,
            ));
        }
        if let Some(which) = kind.strip_prefix("spectrum.") {
            let oscillator = keys.oscillator()?;
            return self.spectra.number(&oscillator, which)?.ok_or_else(unknown);
        }
        if let Some(which) = kind.strip_prefix("records.") {
            let found = keys.records()?.get(&format!("{which}_force"));
            return found.ok_or_else(unknown);
        }
        match kind {
            "of-q.std" => {
                let variance = Stationary::of(&keys.oscillator()?)?.var_q();
                let std = variance.value.sqrt();
                return Ok(variance.mapped(std, 0.5 / std));
            }
            "flight.at-share" => return flight_at(&keys),
            "of-q.skewness" => return Ok(skewness_q(&Stationary::of(&keys.oscillator()?)?)),
            "surplus.skewness" => {
                let law = Stationary::of(&keys.oscillator()?)?;
                return Ok(skewness_with(&law, keys.get("surplus", 0.0)));
            }
            _ => {}
        }
        if let Some(which) = kind.strip_prefix("restarts.") {
            let k = ["mean", "std", "skewness"]
                .iter()
                .position(|it| *it == which);
            let value = self.restarts(&keys)?[k.ok_or_else(unknown)?];
            return Ok(Estimate::new(
                value,
                RESTARTS_ERROR * value.abs(),
                Origin::Sampling,
            ));
        }
        Err(unknown())
    }

    /// Statistics of each of 1600 records that begin at rest, under white noise.
    fn rest_records(&self, path: &str, keys: &Keys) -> Result<Draws> {
        let address = path.split_once(' ').map_or("", |it| it.1);
        let address = format!("rest {address}");
        if let Some(it) = self.draws.borrow().get(&address) {
            return Ok(it.clone());
        }
        let procedure = Procedure {
            count: 0,
            before: 0,
            periods: keys.get("periods", 250.0) as u32,
            ..Procedure::default()
        };
        let it = procedure.draws(&keys.oscillator()?, 1600);
        self.draws.borrow_mut().insert(address, it.clone());
        Ok(it)
    }

    fn draws(&self, path: &str, keys: &Keys) -> Result<Draws> {
        let address = path.split_once(' ').map_or("", |it| it.1).to_owned();
        if let Some(it) = self.draws.borrow().get(&address) {
            return Ok(it.clone());
        }
        let procedure = Procedure {
            count: keys.get("count", 1000.0) as usize,
            band: keys.get("band", 4.0),
            ..Procedure::default()
        };
        let it = procedure.draws(&keys.oscillator()?, keys.get("draws", 24.0) as u64);
        self.draws.borrow_mut().insert(address, it.clone());
        Ok(it)
    }

    /// Mean, deviation and skewness of N over records of `periods` periods that begin at rest.
    fn restarts(&self, keys: &Keys) -> Result<[f64; 3]> {
        let oscillator = keys.oscillator()?;
        let address = format!("{:?}", keys.0);
        if let Some(it) = self.restarts.borrow().get(&address) {
            return Ok(*it);
        }
        let length = TAU * keys.get("periods", 250.0);
        let times: Vec<f64> = (1..=INSTANTS)
            .map(|k| length * (f64::from(k) - 0.5) / f64::from(INSTANTS))
            .collect();
        let settings = EnsembleSettings {
            paths: 20_000,
            ..EnsembleSettings::default()
        };
        let sample = monte_carlo::run(&oscillator, &Initial::Rest, &times, &settings, &|_| ())?;
        let mut raw = [0.0; 3];
        for it in &sample.moments {
            let (mean, std) = (it.mean_force.value, it.std_force.value);
            let third = it.skewness_force.value * std.powi(3);
            raw[0] += mean;
            raw[1] += std * std + mean * mean;
            raw[2] += third + 3.0 * mean * std * std + mean.powi(3);
        }
        let [m1, m2, m3] = raw.map(|sum| sum / f64::from(INSTANTS));
        let variance = m2 - m1 * m1;
        let third = m3 - 3.0 * m1 * m2 + 2.0 * m1.powi(3);
        let it = [m1, variance.sqrt(), third / variance.powf(1.5)];
        self.restarts.borrow_mut().insert(address, it);
        Ok(it)
    }
}

/// Moments over a record that begins at rest are means over this many instants: a midpoint rule whose
/// error, of the second order in their distance over 1/(2 zeta), is far below that of sampling.
const INSTANTS: u32 = 400;

/// Relative standard error of the paper's 10^5 periods, which is what a restart is compared with: the
/// energy keeps its memory for 1/(2 zeta), so a record of length L is worth zeta L samples of it.
const RESTARTS_ERROR: f64 = 0.009;

/// `KEY=VALUE` words.
struct Keys(BTreeMap<String, f64>);

impl Keys {
    fn parse(text: &str) -> Option<Self> {
        let pair = |word: &str| {
            let (key, value) = word.split_once('=')?;
            Some((key.to_owned(), value.parse().ok()?))
        };
        text.split_whitespace()
            .map(pair)
            .collect::<Option<_>>()
            .map(Self)
    }

    fn get(&self, key: &str, otherwise: f64) -> f64 {
        self.0.get(key).copied().unwrap_or(otherwise)
    }

    /// Moments of long records by the paper's scheme.
    fn records(&self) -> Result<Moments> {
        let noise = match (self.0.get("band"), self.0.get("count")) {
            (None, _) => Noise::White,
            (Some(band), None) => Noise::Band { band: *band },
            (Some(band), Some(count)) => Noise::Cosines {
                count: *count as u32,
                band: *band,
            },
        };
        let settings = RecordSettings {
            duration: self.get("duration", 2e6),
            scheme: Scheme::CentralDifference,
            step: Some(TAU / self.get("steps", 50.0)),
            noise,
            ..RecordSettings::default()
        };
        Ok(monte_carlo::records(&self.oscillator()?, &settings, &|_| ())?.moments)
    }

    fn oscillator(&self) -> Result<Oscillator> {
        Oscillator::new(
            ContactLaw::Hertz,
            self.get("zeta", 0.005),
            self.get("h", f64::NAN),
        )
    }
}

/// Mean flight in milliseconds at the damping that gives a share of the time out of contact. Share and
/// flight both depend on T alone, so this is free of damping and level.
fn flight_at(keys: &Keys) -> Result<Estimate> {
    let rig = Rig::new(110.0, 232.0, 7e-6)?;
    let share = keys.get("share", 0.0);
    let law = |zeta: f64| {
        let it = Oscillator::new(ContactLaw::Hertz, zeta, keys.get("h", f64::NAN))?;
        Stationary::of(&it)
    };
    let (mut low, mut high) = (1e-5, 1.0);
    while high / low > 1.0 + 1e-12 {
        let middle = f64::sqrt(low * high);
        let lost = law(middle)?.contact_loss_probability();
        if lost.is_some_and(|it| it.value > share) {
            low = middle;
        } else {
            high = middle;
        }
    }
    let flight = law(low)?.mean_flight();
    let none = || Error::invalid("computed", "flight.at-share", "a contact that can be lost");
    let flight = flight.ok_or_else(none)?;
    Ok(flight.scaled(1e3 * rig.seconds(1.0)))
}

/// Skewness of q.
fn skewness_q(law: &Stationary) -> Estimate {
    let mean = law.mean_q().value;
    let third = law.displacement_law().expect(|q| (q - mean).powi(3));
    let std = law.var_q().value.sqrt();
    third.scaled(std.powi(-3))
}

/// Skewness of N from moments (30) in which the Dirac mass at N = -1 is too large by `surplus`.
fn skewness_with(law: &Stationary, surplus: f64) -> Estimate {
    let [m1, m2, m3] = [1, 2, 3].map(|n| {
        let sign = if n % 2 == 1 { -1.0 } else { 1.0 };
        law.moment_force(n).value + sign * surplus
    });
    let variance = m2 - m1 * m1;
    let third = m3 - 3.0 * m1 * m2 + 2.0 * m1.powi(3);
    Estimate::new(third / variance.powf(1.5), 1e-9, Origin::Quadrature)
}

/// Largest |sampled - closed| of p_N over the bins in standard errors, and the mean square. Closed form
/// over a bin: its probability from the distribution, so the singularity (29) does no harm.
fn density_distance(run: &Run) -> Result<Option<[Estimate; 2]>> {
    /// Bins with fewer counts than this many standard errors are not Gaussian.
    const FEW: f64 = 10.0;
    let Some(records) = &run.results.records else {
        return Ok(None);
    };
    let law = Stationary::of(&run.results.scene.oscillator)?;
    let it = &records.force;
    let (mut worst, mut sum, mut bins) = (0.0f64, 0.0, 0u32);
    for (ends, p) in it.edges.windows(2).zip(&it.density) {
        if !(p.error > 0.0 && p.value > FEW * p.error) {
            continue;
        }
        let inside = law.distribution_force(ends[1]) - law.distribution_force(ends[0]);
        // The jump of the distribution at the force of flight is the Dirac mass, which is apart.
        let jump = law.contact_loss_probability().map_or(0.0, |it| it.value);
        let flight = run
            .results
            .contact()
            .loss_point()
            .map(|q| run.results.contact().force(q));
        let holds = flight.is_some_and(|n| ends[0] < n && n <= ends[1]);
        let exact = (inside - if holds { jump } else { 0.0 }) / (ends[1] - ends[0]);
        let z = (p.value - exact) / p.error;
        (worst, sum, bins) = (worst.max(z.abs()), sum + z * z, bins + 1);
    }
    let count = f64::from(bins.max(1));
    // The largest of n normals scatters by about a half, the mean of n squares by sqrt(2/n).
    Ok(Some([
        Estimate::new(worst, 0.5, Origin::Sampling),
        Estimate::new(sum / count, (2.0 / count).sqrt(), Origin::Sampling),
    ]))
}
