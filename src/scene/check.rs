//! What can be said against a scene without computing.

use super::outputs::{Outputs, PassageRequest, ReachRequest, ResponseRequest, names};
use super::times::Times;
use super::{MonteCarlo, Noise, Scene};
use crate::clock::TimeUnit;
use crate::error::{Error, Result, positive};
use crate::excitation::Drive;
use crate::fokker_planck::DecayRates;
use crate::format::num;
use crate::initial::Initial;
use crate::moments::Moment;
use crate::monte_carlo::{MOST_COSINES, Scheme};
use crate::oscillator::Target;
use std::fmt::Display;

/// Refuses a value that does not hold to what is accepted.
fn require(holds: bool, key: &str, value: impl Display, accepted: impl Into<String>) -> Result<()> {
    if holds {
        return Ok(());
    }
    Err(Error::invalid(key, value, accepted))
}

impl Scene {
    /// Everything that can be said against the scene without computing.
    ///
    /// # Errors
    /// [`Error::Invalid`] or [`Error::NoStationaryLaw`], naming the key.
    pub fn check(&self) -> Result<()> {
        self.check_title()?;
        self.check_initial()?;
        self.check_outputs()?;
        self.check_excitation()?;
        self.check_monte_carlo()?;
        self.settings().check()
    }

    fn check_title(&self) -> Result<()> {
        let printable = !self.title.chars().any(char::is_control);
        let holds = printable && self.title.chars().count() <= 200;
        let shown: String = self.title.chars().take(60).collect();
        let accepted = "one line of at most 200 characters";
        require(holds, "title", format!("{shown:?}"), accepted)
    }

    fn check_initial(&self) -> Result<()> {
        if self.initial == Initial::Stationary && !self.oscillator.contact().is_confining() {
            return Err(self.no_law("initial.kind", "\"stationary\""));
        }
        self.initial.check()?;
        let Initial::Gaussian { mean, deviation } = self.initial else {
            return Ok(());
        };
        for (key, of) in [("initial.mean", mean), ("initial.deviation", deviation)] {
            let [q, v] = of;
            let energies = [q, -q].map(|q| self.oscillator.energy(q, v));
            let holds = energies.iter().all(|it| it.is_finite());
            let value = format!("[{}, {}]", num(q), num(v));
            require(
                holds,
                key,
                value,
                "an energy that a double holds, below 1e308",
            )?;
        }
        Ok(())
    }

    fn no_law(&self, key: &str, value: &str) -> Error {
        let contact = self.oscillator.contact().name();
        let accepted = format!(
            "nothing that needs a stationary law: the contact law \"{contact}\" never confines the \
             motion and has none"
        );
        Error::invalid(key, value, accepted)
    }

    fn check_outputs(&self) -> Result<()> {
        let outputs = &self.outputs;
        let defined = outputs.time_unit != Some(TimeUnit::Second) || self.rig.is_some();
        let accepted = "\"dimensionless\" or \"period\"; \"s\" needs a [rig]";
        require(defined, "outputs.time_unit", "\"s\"", accepted)?;
        let asked = Outputs {
            time_unit: None,
            moments: None,
            ..outputs.clone()
        };
        let any = asked != Outputs::nothing() || self.monte_carlo.is_some();
        let accepted = "at least one output: stationary, moments_at, density_at, steady, \
                        decay_rates, spectrum, first_loss, first_passage, crossings, reach, \
                        periodic or response";
        require(any, "outputs", "nothing", accepted)?;
        if !self.oscillator.contact().is_confining() {
            for (key, asked) in [
                ("outputs.stationary", outputs.stationary),
                ("outputs.steady", outputs.steady),
            ] {
                if asked {
                    return Err(self.no_law(key, "true"));
                }
            }
            if outputs.decay_rates > 0 {
                let count = outputs.decay_rates.to_string();
                return Err(self.no_law("outputs.decay_rates", &count));
            }
        }
        outputs.moments_at.check("outputs.moments_at")?;
        let (lost, contact) = ([Moment::ContactLossProbability], self.oscillator.contact());
        let can = contact.loss_point().is_some() || outputs.moments.as_deref() != Some(&lost);
        let accepted = format!("another moment: \"{}\" cannot lose contact", contact.name());
        require(can, "outputs.moments", names(&lost).join(", "), accepted)?;
        let asked = outputs.moments.as_deref().unwrap_or_default();
        let repeated = asked
            .iter()
            .enumerate()
            .find(|(k, it)| asked[..*k].contains(it));
        let repeated = repeated.map(|(_, it)| it.name());
        let value = repeated.unwrap_or_default();
        require(
            repeated.is_none(),
            "outputs.moments",
            value,
            "each moment once",
        )?;
        outputs.density_at.check("outputs.density_at")?;
        let point =
            self.initial == Initial::Rest && outputs.density_at.list().first() == Some(&0.0);
        let accepted = "times after 0: at rest all probability is in one point";
        require(!point, "outputs.density_at[0]", 0, accepted)?;
        DecayRates::check(outputs.decay_rates)?;
        if let Some(spectrum) = outputs.spectrum {
            let key = "outputs.spectrum.until";
            if !self.oscillator.contact().is_confining() {
                let value = format!("{{ until = {} }}", num(spectrum.until));
                return Err(self.no_law("outputs.spectrum", &value));
            }
            // Beyond, every sample of Monte Carlo would be a step far below any time of the motion.
            let holds = (1e-3..=100.0).contains(&spectrum.until);
            let accepted = "a circular frequency from 1e-3 to 100; the contact resonates at 1";
            require(holds, key, num(spectrum.until), accepted)?;
        }
        if let Some(until) = outputs.first_loss {
            self.check_lost("first_loss", "until", until)?;
            self.check_white("outputs.first_loss")?;
        }
        if let Some(passage) = outputs.first_passage {
            self.check_first_passage(passage)?;
        }
        if let Some(window) = outputs.crossings {
            self.check_lost("crossings", "window", window)?;
        }
        if let Some(reach) = outputs.reach {
            self.check_reach(reach)?;
        }
        Ok(())
    }

    fn check_reach(&self, reach: ReachRequest) -> Result<()> {
        let ReachRequest { quantity, fraction } = reach;
        let (key, name) = ("outputs.reach.quantity", quantity.name());
        if !self.oscillator.contact().is_confining() {
            return Err(self.no_law("outputs.reach", &format!("{{ quantity = \"{name}\" }}")));
        }
        positive("outputs.reach.fraction", fraction)?;
        let accepted = "a number > 0 other than 1, which is reached in the limit alone";
        require(fraction != 1.0, "outputs.reach.fraction", 1, accepted)?;
        let zero = matches!(quantity, Moment::MeanV | Moment::CovQv | Moment::MeanForce);
        let accepted = format!("a moment whose stationary value is not 0; that of {name} is");
        require(!zero, key, format!("{name:?}"), accepted)?;
        let contact = self.oscillator.contact();
        let exists = quantity != Moment::ContactLossProbability || contact.loss_point().is_some();
        let accepted = format!("a moment that the contact law \"{}\" has", contact.name());
        require(exists, key, format!("{name:?}"), accepted)?;
        let begins = self.initial != Initial::Stationary;
        let accepted = "\"gaussian\" or \"rest\" with outputs.reach: the stationary law is there from the start";
        require(begins, "initial.kind", "\"stationary\"", accepted)
    }

    /// Refuses paths under noise whose past counts.
    fn check_white(&self, output: &str) -> Result<()> {
        let sampled = self.monte_carlo.as_ref();
        let white = sampled.is_none_or(|it| it.noise == Noise::White);
        let accepted = format!("\"white\", with {output}");
        require(white, "monte_carlo.noise", "a sum of cosines", accepted)
    }

    fn check_first_passage(&self, it: PassageRequest) -> Result<()> {
        let key = "outputs.first_passage.until";
        positive(key, it.until)?;
        let accepted = format!("a time up to {:e}", Times::LATEST);
        require(it.until <= Times::LATEST, key, num(it.until), accepted)?;
        if !self.oscillator.contact().is_confining() {
            let value = format!("{{ level = {} }}", num(it.level));
            return Err(self.no_law("outputs.first_passage", &value));
        }
        Target::Level(it.level, it.side).range(&self.oscillator, &self.initial)?;
        self.check_white("outputs.first_passage")
    }

    /// An output about losses of contact, with a time under `key`.
    fn check_lost(&self, output: &str, key: &str, time: f64) -> Result<()> {
        let output = format!("outputs.{output}");
        let full = format!("{output}.{key}");
        positive(&full, time)?;
        let noun = if key == "until" { "time" } else { key };
        let accepted = format!("a {noun} up to {:e}", Times::LATEST);
        require(time <= Times::LATEST, &full, num(time), accepted)?;
        let contact = self.oscillator.contact();
        let value = format!("{{ {key} = {} }}", num(time));
        if !contact.is_confining() {
            return Err(self.no_law(&output, &value));
        }
        if contact.loss_point().is_none() {
            let accepted = format!(
                "a contact that can be lost, as \"hertz\" or \"bilinear\": this {} holds on for ever",
                contact.described()
            );
            return Err(Error::invalid(output, value, accepted));
        }
        Ok(())
    }

    /// What a drive or an envelope rules out, and what needs a drive.
    fn check_excitation(&self) -> Result<()> {
        let (outputs, excitation) = (&self.outputs, &self.excitation);
        if !excitation.is_plain()
            && let Some((key, value)) = outputs.stationary_questions().next()
        {
            let accepted = "nothing that needs a law at rest, with [excitation]: moments_at, density_at, first_loss, \
                            first_passage, periodic and response know it; stationary is the law without it";
            return Err(Error::invalid(key, value, accepted));
        }
        let phases = outputs.periodic.map(|it| format!("{{ phases = {it} }}"));
        let phases = phases.map(|phases| ("outputs.periodic", phases));
        let response = outputs.response.map(|it| {
            let points = format!("{{ from = {}, to = {}, .. }}", num(it.from), num(it.to));
            ("outputs.response", points)
        });
        for (key, value) in phases.into_iter().chain(response) {
            let accepted = "with [excitation] drive = { amplitude, frequency, phase } only: without a drive \
                            the law that lasts is the stationary one";
            require(excitation.drive.is_some(), key, &value, accepted)?;
            let accepted =
                "without excitation.envelope: under noise that changes no law is periodic";
            require(excitation.envelope.is_none(), key, &value, accepted)?;
            if !self.oscillator.contact().is_confining() {
                return Err(self.no_law(key, &value));
            }
        }
        if let Some(phases) = outputs.periodic {
            let accepted = "a whole number from 4 to 1000";
            let holds = (4..=1000).contains(&phases);
            require(holds, "outputs.periodic.phases", phases, accepted)?;
        }
        if let Some(it) = outputs.response {
            let [low, high] = Drive::FREQUENCIES;
            for (key, value, least) in [
                ("outputs.response.from", it.from, low),
                ("outputs.response.to", it.to, it.from),
            ] {
                let above = value > least || (key.ends_with("from") && value == least);
                let accepted =
                    format!("a circular frequency above {} and up to {high}", num(least));
                require(above && value <= high, key, num(value), accepted)?;
            }
            let holds = (2..=ResponseRequest::MOST).contains(&it.points);
            let accepted = format!("a whole number from 2 to {}", ResponseRequest::MOST);
            require(holds, "outputs.response.points", it.points, accepted)?;
        }
        Ok(())
    }

    fn check_monte_carlo(&self) -> Result<()> {
        let Some(it) = &self.monte_carlo else {
            return Ok(());
        };
        let holds = (2..=1_000_000_000_000).contains(&it.paths);
        let accepted = "a whole number from 2 to 1e12";
        require(holds, "monte_carlo.paths", it.paths, accepted)?;
        if let Noise::Cosines { cosines, band } = it.noise {
            let holds = (1..=u64::from(MOST_COSINES)).contains(&cosines);
            let accepted = format!("a whole number from 1 to {MOST_COSINES}");
            require(holds, "monte_carlo.noise.cosines", cosines, accepted)?;
            positive("monte_carlo.noise.band", band)?;
        }
        if let Some(step) = it.step {
            positive("monte_carlo.step", step)?;
            let longest = it.duration.unwrap_or(MonteCarlo::DURATION);
            let accepted = format!("a number > 0, at most {}", num(longest));
            require(step <= longest, "monte_carlo.step", num(step), accepted)?;
        }
        if let Some(duration) = it.duration {
            positive("monte_carlo.duration", duration)?;
        }
        if !self.excitation.is_plain() {
            self.check_white("[excitation]")?;
            let splitting = [Scheme::Auto, Scheme::Splitting42, Scheme::Splitting62];
            let holds = splitting.contains(&it.scheme);
            let accepted = "\"auto\", \"splitting_4_2\" or \"splitting_6_2\", with [excitation]";
            let given = format!("\"{}\"", it.scheme);
            require(holds, "monte_carlo.scheme", given, accepted)?;
            let duration = it.duration.map_or(String::new(), num);
            let accepted = "without [excitation]: under it no long realisation is stationary";
            let none = it.duration.is_none();
            require(none, "monte_carlo.duration", duration, accepted)?;
            let first = self.outputs.first_loss.is_some() || self.outputs.first_passage.is_some();
            let asked = first || !self.outputs.moments_at.is_empty();
            let accepted = "at least one time: [monte_carlo] without moments_at is for stationary records, and \
                            under [excitation] there are none";
            require(asked, "outputs.moments_at", "[]", accepted)?;
        }
        if self.wants_records() && !self.oscillator.contact().is_confining() {
            if let Some(duration) = it.duration {
                return Err(self.no_law("monte_carlo.duration", &num(duration)));
            }
            let accepted = format!(
                "at least one time: [monte_carlo] without moments_at is for stationary records, and the \
                 contact law \"{}\" never confines the motion",
                self.oscillator.contact().name()
            );
            return Err(Error::invalid("outputs.moments_at", "[]", accepted));
        }
        Ok(())
    }
}
