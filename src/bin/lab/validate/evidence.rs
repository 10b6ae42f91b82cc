//! Numbers that no scene gives: what the paper's own procedure would have printed, and how well the
//! sampled densities fit.

use super::cosines::{Draws, Procedure, statistics};
use super::damping;
use super::item::{Paper, Row};
use super::roots;
use super::run::Run;
use super::spectra::Spectra;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;
use vibroimpact::contact::ContactLaw;
use vibroimpact::error::{Error, Result};
use vibroimpact::estimate::{Estimate, Origin};
use vibroimpact::moments::{Moment, Moments};
use vibroimpact::monte_carlo::{self, Noise, Sampling, Scheme};
use vibroimpact::oscillator::Oscillator;
use vibroimpact::rig::Rig;
use vibroimpact::stationary::Stationary;

/// Answers names of the label `computed`: a kind, a point, which of its numbers, then `KEY=VALUE` words.
pub struct Evidence<'a> {
    folder: &'a Path,
    runs: &'a [Run],
    draws: RefCell<BTreeMap<String, Draws>>,
    spectra: &'a Spectra,
}

struct Kind {
    name: &'static str,
    /// Its numbers; none where what follows the point is read elsewhere.
    which: &'static [&'static str],
    /// Its keys, `h` always among them; none where the rest is not made of keys.
    keys: &'static [&'static str],
}

const STATISTICS: [&str; 3] = ["mean", "std", "skewness"];

const KINDS: [Kind; 11] = [
    kind("damping", &[], &[]),
    kind("density", &["worst", "chi_square"], &[]),
    kind("chi-square", &["of"], &[]),
    kind(
        "draws",
        &STATISTICS,
        &["h", "zeta", "count", "band", "draws"],
    ),
    kind("rest-records", &STATISTICS, &["h", "zeta", "periods"]),
    kind("restarts", &STATISTICS, &["h", "zeta", "periods"]),
    kind(
        "records",
        &STATISTICS,
        &["h", "zeta", "steps", "band", "count", "duration"],
    ),
    kind(
        "spectrum",
        &[
            "peak",
            "second-peak",
            "third-peak",
            "second-ratio",
            "third-ratio",
            "half-power",
            "zero",
        ],
        &["h", "zeta", "law"],
    ),
    kind("of-q", &["std", "skewness"], &["h", "zeta"]),
    kind("surplus", &["skewness"], &["h", "zeta", "surplus"]),
    kind("flight", &["at-share"], &["h", "share"]),
];

const fn kind(
    name: &'static str,
    which: &'static [&'static str],
    keys: &'static [&'static str],
) -> Kind {
    Kind { name, which, keys }
}

/// The length of the paper's Monte Carlo in periods: 400 records of 250, section 5.2.
const PERIODS: f64 = 1e5;
/// Our records from rest over the paper's.
const MORE: f64 = 16.0;
/// Steps of such a record in a period: they add (2 pi/100)^2/8 = 0.05 % to a deviation.
const STEPS: u32 = 100;

/// A name of the label `computed`, read.
struct Asked<'a> {
    kind: &'static Kind,
    which: &'a str,
    rest: &'a str,
    keys: Keys,
}

impl<'a> Asked<'a> {
    /// Reads a name; `at` says where it stands.
    fn parse(path: &'a str, at: &str) -> Result<Self> {
        let (head, rest) = path.split_once(' ').unwrap_or((path, ""));
        let (name, which) = head.split_once('.').unwrap_or((head, ""));
        let kind = KINDS.iter().find(|it| it.name == name).ok_or_else(|| {
            let names: Vec<&str> = KINDS.iter().map(|it| it.name).collect();
            let accepted = format!("computed: {}", names.join(", "));
            Error::invalid(at, name, accepted)
        })?;
        if !kind.which.is_empty() && !kind.which.contains(&which) {
            let accepted = format!("{name}.{}", kind.which.join(&format!(", {name}.")));
            return Err(Error::invalid(at, head, accepted));
        }
        let keys = if kind.keys.is_empty() {
            Keys::none()
        } else {
            Keys::parse(kind, rest, at)?
        };
        Ok(Self {
            kind,
            which,
            rest,
            keys,
        })
    }

    /// The number's place in [`STATISTICS`].
    fn statistic(&self) -> usize {
        let found = STATISTICS.iter().position(|it| *it == self.which);
        found.unwrap_or(0)
    }
}

/// Whether a name of the label `computed` can be read; `at` says where it stands.
pub fn check(path: &str, at: &str) -> Result<()> {
    Asked::parse(path, at).map(|_| ())
}

impl<'a> Evidence<'a> {
    pub fn new(folder: &'a Path, runs: &'a [Run], spectra: &'a Spectra) -> Self {
        Self {
            folder,
            runs,
            draws: RefCell::default(),
            spectra,
        }
    }

    /// The number of that name; `above` are the rows of the folder that stand before it:
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
    /// - `rest-records.mean|std|skewness KEYS`: over records of `periods` periods that begin at rest, the mean
    ///   of the number of each record; `restarts.*`: the number of all records together. The error is that of
    ///   the paper's 1e5 periods and ours of 16 times as many;
    /// - `spectrum.* KEYS`: see [`super::spectra`]; `law` is `hertz` or `bilinear`;
    /// - `density.worst LABEL`: the largest distance between the sampled and the closed p_N over the bins,
    ///   in standard errors, and `density.chi_square LABEL`: the mean of its squares;
    /// - `chi-square.of KIND`: over those rows, the sum of squares of (ours - paper) over one standard error.
    pub fn number(&self, path: &str, above: &[Row]) -> Result<Estimate> {
        let asked = Asked::parse(path, "computed")?;
        let (which, keys) = (asked.which, &asked.keys);
        let unknown = || {
            let accepted = "a number that exists: see src/bin/lab/validate/evidence.rs";
            Error::invalid("computed", path, accepted)
        };
        match asked.kind.name {
            "damping" => damping::number(self.folder, which),
            "density" => {
                let run = self.runs.iter().find(|run| run.label == asked.rest);
                let found = run.map(density_distance).transpose()?.flatten();
                let [worst, chi_square] = found.ok_or_else(unknown)?;
                Ok(if which == "worst" { worst } else { chi_square })
            }
            "chi-square" => chi_square(above, asked.rest).ok_or_else(unknown),
            "draws" => Ok(self.draws(&asked)?.spread(asked.statistic())),
            "rest-records" => {
                let it = self.rest_records(&asked)?;
                let spread = it.spread(asked.statistic());
                Ok(of_the_paper(spread, 1.0, keys))
            }
            "restarts" => {
                let it = self.rest_records(&asked)?;
                let records = it.raw.len() as f64;
                Ok(of_the_paper(it.pooled(asked.statistic()), records, keys))
            }
            "records" => {
                let moment = Moment::named(&format!("{which}_force"));
                let moment = moment.ok_or_else(unknown)?;
                keys.records()?.get(moment).ok_or_else(unknown)
            }
            "spectrum" => {
                let oscillator = keys.oscillator()?;
                self.spectra.number(&oscillator, which)?.ok_or_else(unknown)
            }
            "flight" => flight_at(keys),
            other => {
                let law = Stationary::of(&keys.oscillator()?)?;
                match (other, which) {
                    ("of-q", "std") => {
                        let variance = law.var_q();
                        let std = variance.value.sqrt();
                        Ok(variance.mapped(std, 0.5 / std))
                    }
                    ("of-q", _) => Ok(skewness_q(&law)),
                    _ => Ok(skewness_with(&law, keys.get("surplus", 0.0))),
                }
            }
        }
    }

    /// Records that begin at rest, under white noise, [`MORE`] times as many as the paper's.
    fn rest_records(&self, asked: &Asked<'_>) -> Result<Draws> {
        let periods = asked.keys.get("periods", 250.0);
        let procedure = Procedure {
            count: 0,
            before: 0,
            steps: STEPS,
            periods: periods as u32,
            ..Procedure::default()
        };
        let records = (MORE * PERIODS / periods) as u64;
        self.kept(format!("rest {}", asked.rest), &procedure, asked, records)
    }

    fn draws(&self, asked: &Asked<'_>) -> Result<Draws> {
        let procedure = Procedure {
            count: asked.keys.get("count", 1000.0) as usize,
            band: asked.keys.get("band", 4.0),
            ..Procedure::default()
        };
        let draws = asked.keys.get("draws", 24.0) as u64;
        self.kept(asked.rest.to_owned(), &procedure, asked, draws)
    }

    /// Records of a procedure, or those made before under that address.
    fn kept(
        &self,
        address: String,
        procedure: &Procedure,
        asked: &Asked<'_>,
        records: u64,
    ) -> Result<Draws> {
        if let Some(it) = self.draws.borrow().get(&address) {
            return Ok(it.clone());
        }
        let it = procedure.draws(&asked.keys.oscillator()?, records);
        self.draws.borrow_mut().insert(address, it.clone());
        Ok(it)
    }
}

/// One standard error of the difference between the paper's number, of 1e5 periods, and ours, of [`MORE`] times
/// as many: from the error of `it` in as many records as `records`.
fn of_the_paper(it: Estimate, records: f64, keys: &Keys) -> Estimate {
    let of_one = it.error * records.sqrt();
    let papers = PERIODS / keys.get("periods", 250.0);
    let error = of_one * ((1.0 + 1.0 / MORE) / papers).sqrt();
    Estimate::new(it.value, error, Origin::Sampling)
}

/// Sum over the rows above whose path begins with `kind.` of (ours - paper)^2/s^2, with s^2 the variance of
/// the paper's sample and of ours and that of rounding to the printed digits, a third of half a unit squared.
/// Rows of one level come from the same sample; their correlation is left out. The error is that of our own
/// sampling and of the standard errors.
fn chi_square(above: &[Row], kind: &str) -> Option<Estimate> {
    /// What a variance from the 300 batches of a long realisation is good to, sqrt(2/300) and a little.
    const OF_VARIANCE: f64 = 0.1;
    let prefix = format!("{kind}.");
    let (mut sum, mut spread, mut count) = (0.0, 0.0, 0);
    for row in above
        .iter()
        .filter(|row| row.item.name.path.starts_with(&prefix))
    {
        let Some(Paper::Number(paper, half)) = row.item.paper else {
            continue;
        };
        let own = match row.ours.origin {
            Origin::Sampling => row.ours.error,
            _ => 0.0,
        };
        let variance = own.powi(2) + row.sampled.unwrap_or(0.0).powi(2) + half.powi(2) / 3.0;
        let z = (row.ours.value - paper) / variance.sqrt();
        sum += z * z;
        // Of `own`, which holds the paper's scatter too, this part is ours.
        let ours = own.powi(2) / (1.0 + MORE);
        spread += 4.0 * z * z * ours / variance + (OF_VARIANCE * z * z).powi(2);
        count += 1;
    }
    (count > 0).then(|| Estimate::new(sum, spread.sqrt(), Origin::Sampling))
}

/// `KEY=VALUE` words.
#[derive(Debug, Clone)]
struct Keys {
    numbers: BTreeMap<String, f64>,
    law: ContactLaw,
}

impl Keys {
    /// The laws that `law` names.
    const LAWS: [ContactLaw; 2] = [ContactLaw::Hertz, ContactLaw::Bilinear];

    fn none() -> Self {
        Self {
            numbers: BTreeMap::new(),
            law: ContactLaw::Hertz,
        }
    }

    fn parse(kind: &Kind, text: &str, at: &str) -> Result<Self> {
        let mut keys = Self::none();
        for word in text.split_whitespace() {
            let (key, value) = word.split_once('=').unwrap_or((word, ""));
            if !kind.keys.contains(&key) {
                let accepted = format!("a key of {}: {}", kind.name, kind.keys.join(", "));
                return Err(Error::invalid(at, key, accepted));
            }
            if key == "law" {
                let law = Self::LAWS.into_iter().find(|law| law.name() == value);
                let accepted = "law=hertz or law=bilinear";
                keys.law = law.ok_or_else(|| Error::invalid(at, word, accepted))?;
                continue;
            }
            let number = value.parse().ok();
            let number = number.filter(|x: &f64| x.is_finite() && *x > 0.0);
            let accepted = format!("{key}= and a number above 0");
            let number = number.ok_or_else(|| Error::invalid(at, word, accepted))?;
            keys.numbers.insert(key.to_owned(), number);
        }
        if keys.numbers.contains_key("h") {
            Ok(keys)
        } else {
            Err(Error::invalid(at, text, "h=LEVEL among the keys"))
        }
    }

    fn get(&self, key: &str, otherwise: f64) -> f64 {
        self.numbers.get(key).copied().unwrap_or(otherwise)
    }

    /// Moments of long realisations by the paper's scheme.
    fn records(&self) -> Result<Moments> {
        let noise = match (self.numbers.get("band"), self.numbers.get("count")) {
            (None, _) => Noise::White,
            (Some(band), None) => Noise::Band { band: *band },
            (Some(band), Some(count)) => Noise::Cosines {
                count: *count as u32,
                band: *band,
            },
        };
        let settings = Sampling {
            duration: self.get("duration", 2e6),
            scheme: Scheme::CentralDifference,
            step: Some(TAU / self.get("steps", 50.0)),
            noise,
            ..Sampling::default()
        };
        Ok(monte_carlo::records(&self.oscillator()?, &settings, &|_| ())?.moments)
    }

    fn oscillator(&self) -> Result<Oscillator> {
        let zeta = self.get("zeta", 0.005);
        Oscillator::new(self.law.clone(), zeta, self.get("h", f64::NAN))
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
    let none = || Error::invalid("computed", "flight.at-share", "a contact that can be lost");
    let lost = |ln_zeta: f64| {
        let lost = law(ln_zeta.exp())?.contact_loss_probability();
        Ok((lost.ok_or_else(none)?.value / share).ln())
    };
    let accepted = "a share that one damping ratio between 1e-5 and 1 gives";
    let [ln_zeta] = roots::all(&lost, 1e-5f64.ln(), 0.0, 40)?[..] else {
        return Err(Error::invalid("computed: flight.at-share", share, accepted));
    };
    let flight = law(ln_zeta.exp())?.mean_flight().ok_or_else(none)?;
    Ok(flight.scaled(1e3 * rig.seconds(1.0)))
}

fn skewness_q(law: &Stationary) -> Estimate {
    let mean = law.mean_q().value;
    let third = law.displacement_law().expect(|q| (q - mean).powi(3));
    let std = law.var_q().value.sqrt();
    third.scaled(std.powi(-3))
}

/// Skewness of N from moments (30) in which the Dirac mass at N = -1 is too large by `surplus`.
fn skewness_with(law: &Stationary, surplus: f64) -> Estimate {
    let raw = [1, 2, 3].map(|n| {
        let sign = if n % 2 == 1 { -1.0 } else { 1.0 };
        law.moment_force(n).value + sign * surplus
    });
    Estimate::new(statistics(raw)[2], 1e-9, Origin::Quadrature)
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
        let contact = run.results.scene.oscillator.contact();
        let flight = contact.loss_point().map(|q| contact.force(q));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_key_kind_or_number_is_refused_with_its_place_and_what_is_accepted() {
        let at = "figure-13/paper.csv line 6";
        for (path, wrong, accepted) in [
            (
                "spectrum.peak h=8e-5 bilinear=1",
                "bilinear",
                "h, zeta, law",
            ),
            (
                "spectrum.peak h=8e-5 law=cubic",
                "law=cubic",
                "law=bilinear",
            ),
            ("spectrum.top h=8e-5", "spectrum.top", "spectrum.peak"),
            ("spectra.peak h=8e-5", "spectra", "spectrum"),
            ("restarts.std h=2e-3 period=250", "period", "periods"),
            (
                "restarts.std h=2e-3 periods=many",
                "periods=many",
                "a number above 0",
            ),
            ("of-q.std zeta=0.005", "zeta=0.005", "h=LEVEL"),
        ] {
            let message = check(path, at).unwrap_err().to_string();
            println!("{message}");
            for part in [at, wrong, accepted] {
                assert!(message.contains(part), "{path}: {message}");
            }
        }
        check("spectrum.peak h=8e-5 zeta=0.005 law=bilinear", at).unwrap();
    }

    #[test]
    fn the_key_law_chooses_the_contact() {
        let of = |path| {
            Asked::parse(path, "a test")
                .unwrap()
                .keys
                .oscillator()
                .unwrap()
        };
        assert_eq!(of("spectrum.peak h=1e-3").contact().name(), "hertz");
        let bilinear = of("spectrum.peak h=1e-3 law=bilinear");
        assert_eq!(bilinear.contact().name(), "bilinear");
    }
}
