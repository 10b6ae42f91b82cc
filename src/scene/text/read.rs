//! A scene, section by section.

use super::document::{Document, Read, Value};
use super::section::Section;
use crate::clock::TIME_UNITS;
use crate::contact::{ContactLaw, LAWS, Parameters};
use crate::damping::Damping;
use crate::error::{Error, positive};
use crate::excitation::{Drive, Envelope, Excitation};
use crate::fokker_planck::{TimeScheme, TransientMethod};
use crate::initial::Initial;
use crate::moments::Moment;
use crate::monte_carlo::{MOST_COSINES, Scheme};
use crate::oscillator::{Oscillator, Quantity, Side};
use crate::rig::Rig;
use crate::scene::{
    Accuracy, MethodChoice, MonteCarlo, Noise, Outputs, PassageRequest, ReachRequest,
    ResponseRequest, Scene, SpectrumRequest,
};
use std::path::Path;

/// Phases of a periodic law unless the scene says otherwise.
const PHASES: u64 = 32;

impl Document {
    pub(super) fn scene(&self) -> Read<Scene> {
        let root = Section {
            document: self,
            path: String::new(),
            table: Some(&self.root),
        };
        root.known(&[
            "title",
            "oscillator",
            "rig",
            "excitation",
            "initial",
            "outputs",
            "monte_carlo",
            "accuracy",
            "method",
        ])?;
        let rig = self.rig(&root)?;
        let mut scene = Scene::new(self.oscillator(&root, rig.as_ref())?);
        // Without a title the file's name stands in.
        let stem = Path::new(&self.sources[0].0).file_stem();
        let stem = stem.map(|it| it.to_string_lossy().replace(char::is_control, ""));
        scene.title = match root.text("title")? {
            Some(title) => title.to_owned(),
            None => stem.unwrap_or_default().chars().take(100).collect(),
        };
        scene.rig = rig;
        scene.force_psd = root.section("oscillator")?.number("force_psd")?;
        scene.excitation = self.excitation(&root)?;
        scene.initial = Self::initial(&root)?;
        if let Some(outputs) = Self::outputs(&root)? {
            scene.outputs = outputs;
        }
        scene.monte_carlo = Self::monte_carlo(&root)?;
        let confines = scene.oscillator.contact().is_confining();
        let (records, clock) = (scene.wants_records() && confines, scene.clock());
        if let Some(it) = scene.monte_carlo.as_mut().filter(|_| records) {
            let duration = clock.time(MonteCarlo::DURATION);
            it.duration.get_or_insert(duration);
        }
        if !root.has("outputs") && scene.outputs.stationary && !confines {
            let at = self.find("oscillator.contact").map(|node| &node.at);
            let message =
                "a scene without [outputs] asks for the stationary law, and this has none";
            let help = "accepted: [outputs] with moments_at or density_at";
            let wrong = self.wrong(message, "never confines the motion", Some(help), at);
            let law = self.find("oscillator.contact").map(|it| it.value.shown());
            return Err(wrong.about("oscillator.contact", law));
        }
        scene.accuracy = Self::accuracy(&root)?;
        scene.method = Self::method(&root)?;
        Ok(scene)
    }

    fn rig(&self, root: &Section<'_>) -> Read<Option<Rig>> {
        let keys = &["static_load", "frequency", "static_compression"];
        let Some(rig) = root.optional("rig", keys)? else {
            return Ok(None);
        };
        let need = |key, accepted| rig.required(rig.number(key)?, key, accepted);
        let it = Rig::new(
            need("static_load", "a load > 0 in newtons, as 110")?,
            need("frequency", "a frequency > 0 in hertz, as 232")?,
            need("static_compression", "a compression > 0 in metres, as 7e-6")?,
        );
        it.map(Some).map_err(|error| self.explain(&error))
    }

    fn oscillator(&self, root: &Section<'_>, rig: Option<&Rig>) -> Read<Oscillator> {
        let section = root.section("oscillator")?;
        section.known(&["contact", "damping", "zeta", "h", "force_psd"])?;
        if section.table.is_none() {
            let help = "accepted: [oscillator] with zeta and h, as zeta = 0.005 and h = 2e-3";
            let wrong = self.wrong("[oscillator] is missing", "", Some(help), None);
            return Err(wrong.about("oscillator", None));
        }
        let contact = self.contact(&section)?;
        let zeta = section.number("zeta")?;
        let zeta = section.required(zeta, "zeta", "a damping ratio > 0, as 0.005")?;
        let (h, psd) = (section.number("h")?, section.number("force_psd")?);
        let h = match (h, psd, rig) {
            (Some(_), Some(_), _) => {
                let message = "both oscillator.h and oscillator.force_psd are given";
                return Err(section.refuse("force_psd", message, "accepted: one of them"));
            }
            (Some(h), None, _) => h,
            (None, Some(psd), Some(rig)) => {
                let psd = positive("oscillator.force_psd", psd);
                rig.level_from_force_psd(psd.map_err(|error| self.explain(&error))?)
            }
            (None, Some(_), None) => {
                let message = "oscillator.force_psd is in N^2/Hz and needs a [rig]";
                let help = "accepted: h, or force_psd with [rig] static_load, frequency and static_compression";
                return Err(section.refuse("force_psd", message, help));
            }
            (None, None, _) => section.required(
                None,
                "h",
                "an input level > 0, as 2e-3; or force_psd in N^2/Hz, with [rig]",
            )?,
        };
        let dampings = [Damping::Viscous, Damping::Contact, Damping::HuntCrossley];
        let dampings = dampings.map(|it| (it.name(), it));
        let damping = section.choice("damping", &dampings)?.unwrap_or_default();
        Oscillator::new(contact, zeta, h)
            .and_then(|it| it.with_damping(damping))
            .map_err(|error| self.explain(&error))
    }

    fn excitation(&self, root: &Section<'_>) -> Read<Excitation> {
        let section = root.section("excitation")?;
        section.known(&["drive", "envelope"])?;
        let mut it = Excitation::default();
        if let Some(drive) = section.optional("drive", &["amplitude", "frequency", "phase"])? {
            let number = |key: &str, what: &str| drive.required(drive.number(key)?, key, what);
            let read = Drive::new(
                number("amplitude", "an amplitude >= 0 in static loads, as 0.02")?,
                number("frequency", "a circular frequency, as 0.95")?,
                drive.number("phase")?.unwrap_or(0.0),
            );
            it.drive = Some(read.map_err(|error| self.explain(&error))?);
        }
        if let Some(envelope) = section.optional("envelope", &["times", "factors"])? {
            let list = |key: &str, what: &str| envelope.required(envelope.numbers(key)?, key, what);
            let read = Envelope::new(
                list("times", "ascending times, as [0, 50, 100]")?,
                list("factors", "a factor on h for each time, as [0, 1, 1]")?,
            );
            it.envelope = Some(read.map_err(|error| self.explain(&error))?);
        }
        Ok(it)
    }

    /// A word, or a table with the name of a law and its keys.
    fn contact(&self, oscillator: &Section<'_>) -> Read<ContactLaw> {
        let words = ContactLaw::words().map(|word| (word, ContactLaw::named(word)));
        if !matches!(oscillator.value("contact"), Some(Value::Table(_))) {
            let others = "a table as { law = \"power\", exponent = 1.2 }";
            let named = oscillator.choice_or("contact", &words, others)?;
            return Ok(named.flatten().unwrap_or(ContactLaw::Hertz));
        }
        let section = oscillator.section("contact")?;
        let laws: Vec<(&str, usize)> = LAWS.iter().map(|it| it.name).zip(0..).collect();
        let law = section.choice("law", &laws)?;
        let names: Vec<String> = LAWS.iter().map(|it| format!("\"{}\"", it.name)).collect();
        let kind = &LAWS[section.required(law, "law", &names.join(", "))?];
        section.known(&[&["law"], kind.keys].concat())?;
        let folder = Path::new(&self.sources[0].0).parent();
        let mut given = Parameters::new().from_folder(folder.unwrap_or(Path::new("")));
        let keys = section.table.into_iter().flatten();
        for (key, node) in keys.filter(|(key, _)| *key != "law") {
            given = given.with(key, section.parameter(key, node)?);
        }
        ContactLaw::given(kind.name, &given).map_err(|error| match &error {
            Error::Invalid { key, accepted, .. } if self.at(key).is_none() => {
                let message = format!("{key} is missing");
                let help = format!("accepted: {accepted}");
                let at = self.find("oscillator.contact").map(|node| &node.key);
                self.wrong(&message, "in this table", Some(&help), at)
                    .about(key, None)
            }
            _ => self.explain(&error),
        })
    }

    fn initial(root: &Section<'_>) -> Read<Initial> {
        let section = root.section("initial")?;
        section.known(&["kind", "mean", "deviation"])?;
        let kinds = &[("gaussian", 0), ("rest", 1), ("stationary", 2)];
        let (mean, deviation) = (section.pair("mean")?, section.pair("deviation")?);
        let kind = section.choice("kind", kinds)?;
        let deviations = "two standard deviations > 0, of q and of v, as [0.3, 0.3]";
        // A mean or deviation without a kind can only mean a Gaussian.
        let implied = i32::from(mean.is_none() && deviation.is_none());
        match kind.unwrap_or(implied) {
            0 => Ok(Initial::Gaussian {
                mean: mean.unwrap_or([0.0; 2]),
                deviation: section.required(deviation, "deviation", deviations)?,
            }),
            other => {
                for key in ["mean", "deviation"] {
                    if section.has(key) {
                        let message = format!("initial.{key} belongs to kind = \"gaussian\" only");
                        return Err(section.refuse(key, &message, "accepted: leave it out"));
                    }
                }
                let kinds = [Initial::Rest, Initial::Stationary];
                Ok(kinds[usize::from(other == 2)])
            }
        }
    }

    fn outputs(root: &Section<'_>) -> Read<Option<Outputs>> {
        let keys = &[
            "stationary",
            "moments_at",
            "moments",
            "density_at",
            "steady",
            "decay_rates",
            "spectrum",
            "first_loss",
            "first_passage",
            "crossings",
            "reach",
            "time_unit",
            "periodic",
            "response",
        ];
        let Some(section) = root.optional("outputs", keys)? else {
            return Ok(None);
        };
        let mut it = Outputs {
            stationary: section.flag("stationary")?.unwrap_or(false),
            moments_at: section.times("moments_at")?,
            moments: section.moments("moments")?,
            density_at: section.times("density_at")?,
            steady: section.flag("steady")?.unwrap_or(false),
            decay_rates: section.whole("decay_rates", 0..=100)?.unwrap_or(0) as usize,
            reach: Self::reach(&section)?,
            time_unit: section.choice("time_unit", TIME_UNITS)?,
            ..Outputs::nothing()
        };
        if let Some(spectrum) = section.optional("spectrum", &["until", "quantity"])? {
            let until = spectrum.number("until")?;
            let quantities = [Quantity::Force, Quantity::Displacement].map(|it| (it.name(), it));
            let quantity = spectrum.choice("quantity", &quantities)?;
            it.spectrum = Some(SpectrumRequest {
                until: spectrum.required(until, "until", "a circular frequency > 0")?,
                quantity: quantity.unwrap_or_default(),
            });
        }
        if let Some(passage) = section.optional("first_passage", &["level", "side", "until"])? {
            let (level, until) = (passage.number("level")?, passage.number("until")?);
            let sides = [Side::Below, Side::Above, Side::Either].map(|it| (it.name(), it));
            let side = passage.choice("side", &sides)?;
            it.first_passage = Some(PassageRequest {
                level: passage.required(level, "level", "a displacement, as 3.0")?,
                side: passage.required(side, "side", "\"above\", \"below\" or \"either\"")?,
                until: passage.required(until, "until", "a time > 0")?,
            });
        }
        for (name, key, target) in [
            ("first_loss", "until", &mut it.first_loss),
            ("crossings", "window", &mut it.crossings),
        ] {
            if let Some(inner) = section.optional(name, &[key])? {
                *target = Some(inner.required(inner.number(key)?, key, "a time > 0")?);
            }
        }
        if let Some(periodic) = section.optional("periodic", &["phases"])? {
            let phases = periodic.whole("phases", 4..=1000)?;
            it.periodic = Some(phases.unwrap_or(PHASES) as usize);
        }
        if let Some(response) = section.optional("response", &["from", "to", "points"])? {
            let number = |key: &str| {
                response.required(response.number(key)?, key, "a circular frequency > 0")
            };
            let points = response.whole("points", 2..=ResponseRequest::MOST as u64)?;
            it.response = Some(ResponseRequest {
                from: number("from")?,
                to: number("to")?,
                points: response.required(points, "points", "how many frequencies, as 61")?
                    as usize,
            });
        }
        Ok(Some(it))
    }

    fn reach(outputs: &Section<'_>) -> Read<Option<ReachRequest>> {
        let Some(section) = outputs.optional("reach", &["quantity", "fraction"])? else {
            return Ok(None);
        };
        let moments = Moment::ALL.map(|it| (it.name(), it));
        let quantity = section.choice("quantity", &moments)?;
        let fraction = section.number("fraction")?;
        let moment = "the name of a moment, as \"mean_energy\"";
        Ok(Some(ReachRequest {
            quantity: section.required(quantity, "quantity", moment)?,
            fraction: section.required(fraction, "fraction", "a number > 0, as 0.9")?,
        }))
    }

    fn monte_carlo(root: &Section<'_>) -> Read<Option<MonteCarlo>> {
        let keys = &["paths", "seed", "scheme", "noise", "step", "duration"];
        let Some(section) = root.optional("monte_carlo", keys)? else {
            return Ok(None);
        };
        let default = MonteCarlo::default();
        let mut noise = Noise::White;
        if let Some(Value::Table(_)) = section.value("noise") {
            let cosines = section.section("noise")?;
            cosines.known(&["cosines", "band"])?;
            let count = cosines.whole("cosines", 1..=u64::from(MOST_COSINES))?;
            noise = Noise::Cosines {
                cosines: cosines.required(count, "cosines", "how many cosines, as 400")?,
                band: cosines.required(cosines.number("band")?, "band", "a frequency > 0")?,
            };
        } else {
            let other = "a table as { cosines = 400, band = 6 }";
            section.choice_or("noise", &[("white", ())], other)?;
        }
        let schemes = Scheme::ALL.map(|it| (it.name(), it));
        let paths = section.whole("paths", 2..=1_000_000_000_000)?;
        Ok(Some(MonteCarlo {
            paths: paths.unwrap_or(default.paths),
            seed: section.whole("seed", 0..=u64::MAX)?.unwrap_or(default.seed),
            scheme: section.choice("scheme", &schemes)?.unwrap_or_default(),
            noise,
            step: section.number("step")?,
            duration: section.number("duration")?,
        }))
    }

    fn accuracy(root: &Section<'_>) -> Read<Accuracy> {
        let section = root.section("accuracy")?;
        section.known(&["tolerance", "max_seconds", "max_memory"])?;
        let default = Accuracy::default();
        let seconds = section.number("max_seconds")?;
        Ok(Accuracy {
            tolerance: section.number("tolerance")?.unwrap_or(default.tolerance),
            max_seconds: seconds.unwrap_or(default.max_seconds),
            max_memory: section.bytes("max_memory")?.unwrap_or(default.max_memory),
        })
    }

    fn method(root: &Section<'_>) -> Read<MethodChoice> {
        let section = root.section("method")?;
        section.known(&["transient", "drift", "time", "cells", "step"])?;
        let cells = match section.value("cells") {
            None => None,
            Some(Value::List(items)) if items.len() == 2 => {
                let cells = |k: usize| -> Read<usize> {
                    let key = format!("cells[{k}]");
                    Ok(section.whole_of(&items[k], &key, 4..=u64::MAX)? as usize)
                };
                Some([cells(0)?, cells(1)?])
            }
            Some(_) => {
                let accepted = "two whole numbers, in q and in v, as [160, 100]";
                return Err(section.type_error("cells", accepted));
            }
        };
        let times = TimeScheme::ALL.map(|it| (it.name(), it));
        Ok(MethodChoice {
            transient: section.auto("transient", &TransientMethod::NAMED)?,
            drift: section.drift()?,
            time: section.auto("time", &times)?,
            cells,
            step: section.number("step")?,
        })
    }
}
