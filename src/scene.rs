//! A scene: what is to be computed, as a plain value.
//!
//! ```
//! use vibroimpact::contact::ContactLaw;
//! use vibroimpact::oscillator::Oscillator;
//! use vibroimpact::plan::Plan;
//! use vibroimpact::scene::Scene;
//!
//! let scene = Scene::new(Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3)?);
//! let results = Plan::of(&scene)?.run_quietly()?;
//! let stationary = results.stationary.unwrap();
//! let loss = stationary.get("contact_loss_probability").unwrap();
//! assert!((loss.value - 0.0724556).abs() < 1e-7);
//! # Ok::<(), vibroimpact::Error>(())
//! ```
//!
//! A file in TOML is one way to get one: see [`text::SceneText`].

#[cfg(feature = "toml")]
pub mod text;

use crate::clock::{Clock, TimeUnit};
#[cfg(feature = "toml")]
use crate::damping::Damping;
use crate::error::{Error, Result, finite, positive};
use crate::excitation::{Drive, Excitation};
use crate::fokker_planck::{Drift, TimeScheme, TransientMethod};
use crate::format::{brief, num, rounded};
use crate::initial::Initial;
use crate::moments::Moment;
use crate::monte_carlo::{MOST_COSINES, Scheme};
use crate::oscillator::Oscillator;
pub(crate) use crate::oscillator::{Quantity, Side};
use crate::rig::Rig;
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::fmt::Write;

/// What is to be computed. Every field has the meaning of the scene file's key of the same name.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// A line of text; it names the output folder.
    pub title: String,
    /// Contact law, damping and noise.
    pub oscillator: Oscillator,
    /// The one-sided density of the excitation on the rig in N^2/Hz, where the input level was given by it; it is written
    /// in place of h as long as it stands for the level of the oscillator.
    pub force_psd: Option<f64>,
    /// The rig, if results are wanted in newtons, micrometres, hertz and seconds too.
    pub rig: Option<Rig>,
    /// What shakes the oscillator beside stationary noise.
    pub excitation: Excitation,
    /// Where the motion starts.
    pub initial: Initial,
    /// What is asked for; nothing else is computed.
    pub outputs: Outputs,
    /// The same by sampling.
    pub monte_carlo: Option<MonteCarlo>,
    /// How accurate, and within what time and memory.
    pub accuracy: Accuracy,
    /// Choices that are otherwise made automatically.
    pub method: MethodChoice,
}

/// What is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Outputs {
    /// The closed form (21)-(30).
    pub stationary: bool,
    /// Transient moments at these times.
    pub moments_at: Times,
    /// Only these of the moments, in the results and for the tolerance; None for all of them.
    pub moments: Option<Vec<Moment>>,
    /// p(q, v) at these times.
    pub density_at: Times,
    /// L p = 0 on the mesh.
    pub steady: bool,
    /// How many of the slowest eigenvalues of L.
    pub decay_rates: usize,
    /// One-sided spectrum.
    pub spectrum: Option<SpectrumRequest>,
    /// Survival until the first loss of contact, up to this time.
    pub first_loss: Option<f64>,
    /// Survival until the first passage of a level of q.
    pub first_passage: Option<PassageRequest>,
    /// Losses of contact in a window of this length: in the unit of time, and without one in seconds with a rig, else in
    /// dimensionless time.
    pub crossings: Option<f64>,
    /// The first time at which a moment of the transient is a fraction of its stationary value.
    pub reach: Option<ReachRequest>,
    /// The unit of every time of the scene and of its results; None is dimensionless time.
    pub time_unit: Option<TimeUnit>,
    /// The periodic law under the drive, at so many phases.
    pub periodic: Option<usize>,
    /// The periodic law over the frequency of the drive.
    pub response: Option<ResponseRequest>,
}

impl Default for Outputs {
    /// The stationary law alone.
    fn default() -> Self {
        Self {
            stationary: true,
            ..Self::nothing()
        }
    }
}

/// The names of some moments.
fn names(moments: &[Moment]) -> Vec<&'static str> {
    moments.iter().map(|it| it.name()).collect()
}

impl Outputs {
    /// Nothing at all, to start from.
    pub fn nothing() -> Self {
        Self {
            stationary: false,
            moments_at: Times::none(),
            moments: None,
            density_at: Times::none(),
            steady: false,
            decay_rates: 0,
            spectrum: None,
            first_loss: None,
            first_passage: None,
            crossings: None,
            reach: None,
            time_unit: None,
            periodic: None,
            response: None,
        }
    }

    /// The outputs that need a law that does not change, as keys with what stands under them.
    fn stationary_questions(&self) -> impl Iterator<Item = (&'static str, String)> {
        let until = |until: f64| format!("{{ until = {} }}", num(until));
        [
            ("outputs.steady", self.steady.then(|| "true".to_owned())),
            (
                "outputs.decay_rates",
                (self.decay_rates > 0).then(|| self.decay_rates.to_string()),
            ),
            ("outputs.spectrum", self.spectrum.map(|it| until(it.until))),
            ("outputs.first_loss", self.first_loss.map(until)),
            (
                "outputs.first_passage",
                self.first_passage.map(|it| until(it.until)),
            ),
            (
                "outputs.crossings",
                self.crossings
                    .map(|window| format!("{{ window = {} }}", num(window))),
            ),
            (
                "outputs.reach",
                self.reach
                    .map(|it| format!("{{ quantity = {:?} }}", it.quantity.name())),
            ),
        ]
        .into_iter()
        .filter_map(|(key, value)| Some((key, value?)))
    }
}

/// Output times.
#[derive(Debug, Clone, PartialEq)]
pub enum Times {
    /// These times, ascending.
    List(Vec<f64>),
    /// `every`, 2 `every`, ... up to `until`.
    Every {
        /// The distance between times, and the first.
        every: f64,
        /// No time is later.
        until: f64,
    },
}

impl Times {
    /// More times than this are refused: a results file is meant to be read.
    pub(crate) const MOST: usize = 20_000;
    /// The latest time accepted.
    pub(crate) const LATEST: f64 = 1e9;

    pub(crate) fn none() -> Self {
        Self::List(Vec::new())
    }

    pub(crate) fn is_empty(&self) -> bool {
        matches!(self, Self::List(times) if times.is_empty())
    }

    /// The times.
    pub fn list(&self) -> Vec<f64> {
        match self {
            Self::List(times) => times.clone(),
            Self::Every { every, until } => {
                let count = (until / every * (1.0 + 1e-12)).floor().max(0.0);
                (1..=count.min(Self::MOST as f64) as u32)
                    .map(|k| rounded(f64::from(k) * every, 13))
                    .collect()
            }
        }
    }

    /// The last time; 0 without one.
    pub(crate) fn last(&self) -> f64 {
        self.list().last().copied().unwrap_or(0.0)
    }

    fn check(&self, key: &str) -> Result<()> {
        let most = || format!("at most {} times", Self::MOST);
        match self {
            Self::Every { every, until } => {
                let part = |name: &str| format!("{key}.{name}");
                positive(&part("every"), *every)?;
                positive(&part("until"), *until)?;
                if *until > Self::LATEST {
                    let accepted = format!("a time up to {:e}", Self::LATEST);
                    return Err(Error::invalid(part("until"), num(*until), accepted));
                }
                if *until < *every {
                    let accepted = format!("a time of at least {key}.every = {}", num(*every));
                    return Err(Error::invalid(part("until"), num(*until), accepted));
                }
                if until / every > Self::MOST as f64 {
                    return Err(Error::invalid(part("every"), num(*every), most()));
                }
            }
            Self::List(times) => {
                if times.len() > Self::MOST {
                    let count = format!("a list of {} times", times.len());
                    return Err(Error::invalid(key, count, most()));
                }
                for (k, t) in times.iter().enumerate() {
                    let item = || format!("{key}[{k}]");
                    if !(*t >= 0.0 && *t <= Self::LATEST) {
                        let accepted = format!("a time from 0 to {:e}", Self::LATEST);
                        return Err(Error::invalid(item(), num(*t), accepted));
                    }
                    if k > 0 && *t <= times[k - 1] {
                        let accepted = format!(
                            "ascending times without repeats; the one before is {}",
                            num(times[k - 1])
                        );
                        return Err(Error::invalid(item(), num(*t), accepted));
                    }
                }
            }
        }
        Ok(())
    }

    /// The same in dimensionless time.
    fn dimensionless(&self, clock: &Clock) -> Self {
        let times = self.list();
        Self::List(times.iter().map(|t| clock.dimensionless(*t)).collect())
    }

    fn tree(&self) -> Value {
        match self {
            Self::List(times) => json!(times),
            Self::Every { every, until } => json!({ "every": every, "until": until }),
        }
    }
}

/// A one-sided spectrum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectrumRequest {
    /// Up to this circular frequency.
    pub until: f64,
    /// Of the force or of the displacement.
    pub quantity: Quantity,
}

/// The first time at which a moment reaches a part of its stationary value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReachRequest {
    /// The moment.
    pub quantity: Moment,
    /// The part.
    pub fraction: f64,
}

/// A response curve: the periodic law at equally spaced frequencies of the drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResponseRequest {
    /// The lowest circular frequency.
    pub from: f64,
    /// The highest.
    pub to: f64,
    /// How many, both ends included.
    pub points: usize,
}

impl ResponseRequest {
    /// Most points accepted.
    const MOST: usize = 500;

    /// The frequencies.
    pub fn frequencies(&self) -> Vec<f64> {
        let step = (self.to - self.from) / (self.points.max(2) - 1) as f64;
        let at = |k: usize| rounded(self.from + step * k as f64, 13);
        (0..self.points).map(at).collect()
    }
}

/// A first passage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassageRequest {
    /// The level of q.
    pub level: f64,
    /// Below it, above it, or either of it and its negative.
    pub side: Side,
    /// Up to this time.
    pub until: f64,
}

/// The ensemble of paths.
#[derive(Debug, Clone, PartialEq)]
pub struct MonteCarlo {
    /// Number of paths.
    pub paths: u64,
    /// Seed; path k draws from stream k of it.
    pub seed: u64,
    /// One step of a path.
    pub scheme: Scheme,
    /// White, or a sum of cosines.
    pub noise: Noise,
    /// Time step; None is an automatic choice.
    pub step: Option<f64>,
    /// Length of long records, dimensionless, all together, and of those of Welch's method; None is
    /// the paper's 1e5 periods for the former, and 400 averages for the latter if there are no others.
    pub duration: Option<f64>,
}

impl MonteCarlo {
    /// Length of long records unless the scene says otherwise: the paper's 1e5 periods.
    pub(crate) const DURATION: f64 = TAU * 1e5;
}

impl Default for MonteCarlo {
    fn default() -> Self {
        Self {
            paths: 100_000,
            seed: 1,
            scheme: Scheme::default(),
            noise: Noise::White,
            step: None,
            duration: None,
        }
    }
}

/// The excitation of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Noise {
    /// White noise, (10).
    White,
    /// A sum of cosines, (31)-(33).
    Cosines {
        /// How many.
        cosines: u64,
        /// Their highest circular frequency.
        band: f64,
    },
}

/// How accurate, and within what time and memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accuracy {
    /// For every deterministic number, relative to its natural scale.
    pub tolerance: f64,
    /// Seconds after which a run stops with a reason.
    pub max_seconds: f64,
    /// Bytes beyond which nothing is begun.
    pub max_memory: u64,
}

impl Default for Accuracy {
    fn default() -> Self {
        Self {
            tolerance: 1e-3,
            max_seconds: 600.0,
            max_memory: 8_000_000_000,
        }
    }
}

/// Choices that are otherwise made automatically.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MethodChoice {
    /// Finite volumes or the flow map.
    pub transient: Option<TransientMethod>,
    /// Interpolation on the faces.
    pub drift: Option<Drift>,
    /// Time scheme.
    pub time: Option<TimeScheme>,
    /// Cells in q and in v.
    pub cells: Option<[usize; 2]>,
    /// Time step.
    pub step: Option<f64>,
}

impl Scene {
    /// The stationary law of `oscillator`, and nothing else.
    pub fn new(oscillator: Oscillator) -> Self {
        Self {
            title: "untitled".into(),
            oscillator,
            force_psd: None,
            rig: None,
            excitation: Excitation::default(),
            initial: Initial::Rest,
            outputs: Outputs::default(),
            monte_carlo: None,
            accuracy: Accuracy::default(),
            method: MethodChoice::default(),
        }
    }

    /// Whether moments of an ensemble of paths are asked for.
    pub(crate) fn wants_paths(&self) -> bool {
        self.monte_carlo.is_some() && !self.outputs.moments_at.is_empty()
    }

    /// Whether long records are asked for: by Monte Carlo without times, for crossings, or by their
    /// duration. First losses and spectra have samples of their own.
    pub(crate) fn wants_records(&self) -> bool {
        if !self.excitation.is_plain() {
            return false;
        }
        let asked = |it: &MonteCarlo| it.duration.is_some() || self.outputs.crossings.is_some();
        let it = self.monte_carlo.as_ref();
        let outputs = &self.outputs;
        let others = outputs.first_loss.is_some()
            || outputs.first_passage.is_some()
            || outputs.spectrum.is_some();
        let stationary = outputs.moments_at.is_empty() && (outputs.stationary || !others);
        it.is_some_and(|it| asked(it) || stationary)
    }

    /// The unit of times; seconds that no rig defines are refused by [`Scene::check`].
    pub fn clock(&self) -> Clock {
        let unit = self.outputs.time_unit.unwrap_or_default();
        Clock::new(unit, self.rig.as_ref()).unwrap_or_default()
    }

    /// The same scene with every time dimensionless.
    pub(crate) fn dimensionless(&self) -> Self {
        let clock = self.clock();
        if clock.is_dimensionless() {
            return self.clone();
        }
        let mut it = self.clone();
        let window = self.crossings_window();
        let outputs = &mut it.outputs;
        outputs.time_unit = Some(TimeUnit::Dimensionless);
        outputs.moments_at = outputs.moments_at.dimensionless(&clock);
        outputs.density_at = outputs.density_at.dimensionless(&clock);
        outputs.crossings = window;
        let envelope = it.excitation.envelope.as_ref();
        it.excitation.envelope = envelope.map(|it| it.retimed(|t| clock.dimensionless(t)));
        let sampling = it.monte_carlo.as_mut();
        let sampling = sampling.map(|it| [&mut it.step, &mut it.duration]);
        if let Some(passage) = &mut outputs.first_passage {
            passage.until = clock.dimensionless(passage.until);
        }
        let times = [&mut outputs.first_loss, &mut it.method.step];
        for time in times.into_iter().chain(sampling.into_iter().flatten()) {
            *time = time.map(|time| clock.dimensionless(time));
        }
        it
    }

    /// The window of [`Outputs::crossings`] as a dimensionless time.
    pub(crate) fn crossings_window(&self) -> Option<f64> {
        let window = self.outputs.crossings?;
        Some(match (self.outputs.time_unit, &self.rig) {
            (None, Some(rig)) => rig.time(window),
            _ => self.clock().dimensionless(window),
        })
    }

    /// The same in seconds on a rig.
    pub(crate) fn window_seconds(&self, rig: &Rig) -> Option<f64> {
        let window = self.outputs.crossings?;
        Some(match self.outputs.time_unit {
            None => window,
            Some(_) => self.clock().seconds(rig) * window,
        })
    }

    /// What is accepted and yet hardly meant: units of a rig, a damping in per cent, an initial condition of nothing.
    pub(crate) fn doubts(&self) -> Vec<String> {
        let mut doubts = Vec::new();
        let outputs = &self.outputs;
        if let Some(rig) = &self.rig {
            let (z, mass) = (rig.static_compression(), rig.mass());
            if z > 1e-3 {
                doubts.push(format!(
                    "rig.static_compression = {} is in metres, {} mm; 3.5 um would be 3.5e-6",
                    brief(z),
                    brief(rounded(z * 1e3, 4))
                ));
            }
            if !(1e-6..=1e5).contains(&mass) {
                doubts.push(format!(
                    "the moving mass that follows from [rig], (3/2) F_s/(z_s Omega^2), is {} kg",
                    brief(rounded(mass, 3))
                ));
            }
            let zeta = self.oscillator.zeta();
            if zeta > 0.2 {
                doubts.push(format!(
                    "oscillator.zeta = {} is {} %; 0.8 % would be 0.008",
                    brief(zeta),
                    brief(rounded(100.0 * zeta, 4))
                ));
            }
            let last = outputs.moments_at.last().max(outputs.density_at.last());
            if outputs.time_unit.is_none() && last > 0.0 && last < TAU {
                doubts.push(format!(
                    "times are in units of 1/Omega: the last, {}, is {} ms; outputs.time_unit = \"s\" makes them seconds",
                    brief(last),
                    brief(rounded(rig.seconds(last) * 1e3, 3))
                ));
            }
        }
        if self.initial != Initial::Rest && !self.begins_somewhere() {
            doubts.push(
                "initial: nothing that is asked for depends on the initial condition".to_owned(),
            );
        }
        doubts
    }

    /// Whether anything asked for depends on the initial condition.
    fn begins_somewhere(&self) -> bool {
        let it = &self.outputs;
        !it.moments_at.is_empty()
            || !it.density_at.is_empty()
            || it.first_loss.is_some()
            || it.first_passage.is_some()
            || it.reach.is_some()
    }

    /// Everything that can be said against the scene without computing.
    ///
    /// # Errors
    /// [`Error::Invalid`] or [`Error::NoStationaryLaw`], naming the key.
    pub fn check(&self) -> Result<()> {
        self.check_title()?;
        self.check_initial()?;
        self.check_outputs()?;
        self.check_excitation()?;
        self.check_damping()?;
        self.check_monte_carlo()?;
        self.check_accuracy()
    }

    fn check_title(&self) -> Result<()> {
        let printable = !self.title.chars().any(char::is_control);
        if printable && self.title.chars().count() <= 200 {
            Ok(())
        } else {
            let shown: String = self.title.chars().take(60).collect();
            let accepted = "one line of at most 200 characters";
            Err(Error::invalid("title", format!("{shown:?}"), accepted))
        }
    }

    fn check_initial(&self) -> Result<()> {
        match self.initial {
            Initial::Gaussian { mean, deviation } => {
                for k in 0..2 {
                    finite(&format!("initial.mean[{k}]"), mean[k])?;
                    positive(&format!("initial.deviation[{k}]"), deviation[k])?;
                }
            }
            Initial::Stationary if !self.oscillator.contact().is_confining() => {
                return Err(self.no_law("initial.kind", "\"stationary\""));
            }
            _ => {}
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
        let asked = Outputs {
            time_unit: None,
            ..outputs.clone()
        };
        if asked == Outputs::nothing() && self.monte_carlo.is_none() {
            let accepted = "at least one output: stationary, moments_at, density_at, steady, \
                            decay_rates, spectrum, first_loss, first_passage, crossings, reach, \
                            periodic or response";
            return Err(Error::invalid("outputs", "nothing", accepted));
        }
        if outputs.time_unit == Some(TimeUnit::Second) && self.rig.is_none() {
            let accepted = "\"dimensionless\" or \"period\"; \"s\" needs a [rig]";
            return Err(Error::invalid("outputs.time_unit", "\"s\"", accepted));
        }
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
        if outputs.moments.as_ref().is_some_and(Vec::is_empty) {
            let accepted = format!("at least one of {}", names(&Moment::ALL).join(", "));
            return Err(Error::invalid("outputs.moments", "[]", accepted));
        }
        outputs.density_at.check("outputs.density_at")?;
        if outputs.decay_rates > 100 {
            return Err(Error::invalid(
                "outputs.decay_rates",
                outputs.decay_rates,
                "a whole number from 0 to 100",
            ));
        }
        if let Some(spectrum) = outputs.spectrum {
            let key = "outputs.spectrum.until";
            positive(key, spectrum.until)?;
            if !self.oscillator.contact().is_confining() {
                let value = format!("{{ until = {} }}", num(spectrum.until));
                return Err(self.no_law("outputs.spectrum", &value));
            }
            // Beyond, every sample of Monte Carlo would be a step far below any time of the motion.
            if !(1e-3..=100.0).contains(&spectrum.until) {
                let accepted = "a circular frequency from 1e-3 to 100; the contact resonates at 1";
                return Err(Error::invalid(key, num(spectrum.until), accepted));
            }
        }
        if let Some(until) = outputs.first_loss {
            self.check_first_loss(until)?;
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
        if fraction == 1.0 {
            let accepted = "a number > 0 other than 1, which is reached in the limit alone";
            return Err(Error::invalid("outputs.reach.fraction", 1, accepted));
        }
        if matches!(quantity, Moment::MeanV | Moment::CovQv | Moment::MeanForce) {
            let accepted = format!("a moment whose stationary value is not 0; that of {name} is");
            return Err(Error::invalid(key, format!("{name:?}"), accepted));
        }
        if quantity == Moment::ContactLossProbability
            && self.oscillator.contact().loss_point().is_none()
        {
            let law = self.oscillator.contact().name();
            let accepted = format!("a moment that the contact law \"{law}\" has");
            return Err(Error::invalid(key, format!("{name:?}"), accepted));
        }
        if self.initial == Initial::Stationary {
            let accepted = "\"gaussian\" or \"rest\" with outputs.reach: the stationary law is there from the start";
            return Err(Error::invalid("initial.kind", "\"stationary\"", accepted));
        }
        Ok(())
    }

    /// Refuses what no solver has but for viscous damping.
    fn check_damping(&self) -> Result<()> {
        if self.oscillator.is_viscous() || self.excitation.is_plain() {
            return Ok(());
        }
        let damping = self.oscillator.damping().name();
        let key = format!("excitation with oscillator.damping = \"{damping}\"");
        let instead = "\"viscous\" damping under a drive or an envelope";
        Err(Error::not_available(key, instead))
    }

    fn check_first_loss(&self, until: f64) -> Result<()> {
        self.check_lost("first_loss", "until", until)?;
        self.check_white("outputs.first_loss")
    }

    /// Refuses paths of a first passage under noise whose past counts.
    fn check_white(&self, output: &str) -> Result<()> {
        let sampled = self.monte_carlo.as_ref();
        if sampled.is_some_and(|it| it.noise != Noise::White) {
            let accepted = format!("\"white\", with {output}");
            let key = "monte_carlo.noise";
            return Err(Error::invalid(key, "a sum of cosines", accepted));
        }
        Ok(())
    }

    fn check_first_passage(&self, it: PassageRequest) -> Result<()> {
        finite("outputs.first_passage.level", it.level)?;
        let key = "outputs.first_passage.until";
        positive(key, it.until)?;
        if it.until > Times::LATEST {
            let accepted = format!("a time up to {:e}", Times::LATEST);
            return Err(Error::invalid(key, num(it.until), accepted));
        }
        if !self.oscillator.contact().is_confining() {
            let value = format!("{{ level = {} }}", num(it.level));
            return Err(self.no_law("outputs.first_passage", &value));
        }
        self.check_white("outputs.first_passage")
    }

    /// An output about losses of contact, with a time under `key`.
    fn check_lost(&self, output: &str, key: &str, time: f64) -> Result<()> {
        let output = format!("outputs.{output}");
        let full = format!("{output}.{key}");
        positive(&full, time)?;
        if time > Times::LATEST {
            let noun = if key == "until" { "time" } else { key };
            let accepted = format!("a {noun} up to {:e}", Times::LATEST);
            return Err(Error::invalid(full, num(time), accepted));
        }
        let contact = self.oscillator.contact();
        let value = format!("{{ {key} = {} }}", num(time));
        if !contact.is_confining() {
            return Err(self.no_law(&output, &value));
        }
        if contact.loss_point().is_none() {
            let law = contact.name();
            let accepted = if key == "until" {
                format!("a contact law that can lose contact; \"{law}\" never does")
            } else {
                format!(
                    "only for a contact law that can be lost, as \"hertz\" or \"bilinear\": \"{law}\" holds \
                     on for ever"
                )
            };
            return Err(Error::invalid(output, value, accepted));
        }
        Ok(())
    }

    /// What a drive or an envelope rules out, and what needs a drive.
    fn check_excitation(&self) -> Result<()> {
        let (outputs, excitation) = (&self.outputs, &self.excitation);
        if !excitation.is_plain()
            && let Some((key, value)) = outputs
                .stationary_questions()
                .find(|(key, _)| !["outputs.first_loss", "outputs.first_passage"].contains(key))
        {
            let accepted = "nothing that needs a law at rest, with [excitation]: moments_at, density_at, first_loss, \
                            first_passage, periodic and response know it; stationary is the law without it";
            return Err(Error::invalid(key, value, accepted));
        }
        let phases = outputs
            .periodic
            .map(|phases| ("outputs.periodic", format!("{{ phases = {phases} }}")));
        let response = outputs.response.map(|it| {
            let points = format!("{{ from = {}, to = {}, .. }}", num(it.from), num(it.to));
            ("outputs.response", points)
        });
        for (key, value) in phases.into_iter().chain(response) {
            if excitation.drive.is_none() {
                let accepted = "with [excitation] drive = { amplitude, frequency, phase } only: without a drive \
                                the law that lasts is the stationary one";
                return Err(Error::invalid(key, value, accepted));
            }
            if excitation.envelope.is_some() {
                let accepted =
                    "without excitation.envelope: under noise that changes no law is periodic";
                return Err(Error::invalid(key, value, accepted));
            }
            if !self.oscillator.contact().is_confining() {
                return Err(self.no_law(key, &value));
            }
        }
        if let Some(phases) = outputs.periodic
            && !(4..=1000).contains(&phases)
        {
            let accepted = "a whole number from 4 to 1000";
            return Err(Error::invalid("outputs.periodic.phases", phases, accepted));
        }
        if let Some(it) = outputs.response {
            let [low, high] = Drive::FREQUENCIES;
            for (key, value, least) in [
                ("outputs.response.from", it.from, low),
                ("outputs.response.to", it.to, it.from),
            ] {
                if !(value >= least && value <= high && (key.ends_with("from") || value > least)) {
                    let accepted =
                        format!("a circular frequency above {} and up to {high}", num(least));
                    return Err(Error::invalid(key, num(value), accepted));
                }
            }
            if !(2..=ResponseRequest::MOST).contains(&it.points) {
                let accepted = format!("a whole number from 2 to {}", ResponseRequest::MOST);
                return Err(Error::invalid(
                    "outputs.response.points",
                    it.points,
                    accepted,
                ));
            }
        }
        Ok(())
    }

    fn check_monte_carlo(&self) -> Result<()> {
        let Some(it) = &self.monte_carlo else {
            return Ok(());
        };
        if !(2..=1_000_000_000_000).contains(&it.paths) {
            let accepted = "a whole number from 2 to 1e12";
            return Err(Error::invalid("monte_carlo.paths", it.paths, accepted));
        }
        if let Noise::Cosines { cosines, band } = it.noise {
            if !(1..=u64::from(MOST_COSINES)).contains(&cosines) {
                let accepted = format!("a whole number from 1 to {MOST_COSINES}");
                return Err(Error::invalid(
                    "monte_carlo.noise.cosines",
                    cosines,
                    accepted,
                ));
            }
            positive("monte_carlo.noise.band", band)?;
        }
        if let Some(step) = it.step {
            positive("monte_carlo.step", step)?;
        }
        if let Some(duration) = it.duration {
            positive("monte_carlo.duration", duration)?;
        }
        if !self.excitation.is_plain() {
            if it.noise != Noise::White {
                let accepted = "\"white\", with [excitation]";
                let key = "monte_carlo.noise";
                return Err(Error::invalid(key, "a sum of cosines", accepted));
            }
            let splitting = [Scheme::Auto, Scheme::Splitting42, Scheme::Splitting62];
            if !splitting.contains(&it.scheme) {
                let accepted =
                    "\"auto\", \"splitting_4_2\" or \"splitting_6_2\", with [excitation]";
                let given = format!("\"{}\"", it.scheme);
                return Err(Error::invalid("monte_carlo.scheme", given, accepted));
            }
            if let Some(duration) = it.duration {
                let accepted = "without [excitation]: under it no long record is stationary";
                return Err(Error::invalid(
                    "monte_carlo.duration",
                    num(duration),
                    accepted,
                ));
            }
            let first = self.outputs.first_loss.is_some() || self.outputs.first_passage.is_some();
            if self.outputs.moments_at.is_empty() && !first {
                let accepted = "at least one time: [monte_carlo] without moments_at is for stationary records, and \
                                under [excitation] there are none";
                return Err(Error::invalid("outputs.moments_at", "[]", accepted));
            }
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

    fn check_accuracy(&self) -> Result<()> {
        let Accuracy {
            tolerance,
            max_seconds,
            max_memory,
        } = self.accuracy;
        if !(tolerance > 0.0 && tolerance < 1.0) {
            let accepted = "a number between 0 and 1";
            return Err(Error::invalid(
                "accuracy.tolerance",
                num(tolerance),
                accepted,
            ));
        }
        positive("accuracy.max_seconds", max_seconds)?;
        if max_memory == 0 {
            let accepted = "a size above 0, as \"8 GB\"";
            return Err(Error::invalid("accuracy.max_memory", max_memory, accepted));
        }
        if let Some(cells) = self.method.cells {
            for (k, cells) in cells.into_iter().enumerate() {
                if cells < 4 {
                    let key = format!("method.cells[{k}]");
                    return Err(Error::invalid(key, cells, "a whole number of at least 4"));
                }
            }
        }
        if let Some(step) = self.method.step {
            positive("method.step", step)?;
        }
        Ok(())
    }

    /// The scene with every default filled in, section by section: in results.json, and as TOML by
    /// [`Scene::to_toml`].
    pub fn resolved(&self) -> Value {
        let mut initial = json!({ "kind": self.initial.name() });
        if let Initial::Gaussian { mean, deviation } = self.initial {
            initial["mean"] = json!(mean);
            initial["deviation"] = json!(deviation);
        }
        let monte_carlo = self.monte_carlo.as_ref().map(|it| {
            let records = self.wants_records();
            let records = records.then(|| self.clock().time(MonteCarlo::DURATION));
            let noise = match it.noise {
                Noise::White => json!("white"),
                Noise::Cosines { cosines, band } => json!({ "cosines": cosines, "band": band }),
            };
            given(json!({
                "paths": it.paths,
                "seed": it.seed,
                "scheme": name_of(SCHEMES, Some(it.scheme)),
                "noise": noise,
                "step": it.step,
                "duration": it.duration.or(records),
            }))
        });
        let rig = self.rig.map(|rig| {
            json!({
                "static_load": rig.static_load(),
                "frequency": rig.frequency(),
                "static_compression": rig.static_compression(),
            })
        });
        let level = self.rig.zip(self.force_psd);
        let level =
            level.filter(|(rig, psd)| rig.level_from_force_psd(*psd) == self.oscillator.h());
        let level = level.map_or(("h", self.oscillator.h()), |(_, psd)| ("force_psd", psd));
        let excitation = (self.excitation != Excitation::default()).then(|| {
            let drive = self.excitation.drive.map(|it| {
                json!({
                    "amplitude": it.amplitude(),
                    "frequency": it.frequency(),
                    "phase": it.phase(),
                })
            });
            let envelope = self.excitation.envelope.as_ref();
            let envelope =
                envelope.map(|it| json!({ "times": it.times(), "factors": it.factors() }));
            given(json!({ "drive": drive, "envelope": envelope }))
        });
        let outputs = &self.outputs;
        let response = outputs
            .response
            .map(|it| json!({ "from": it.from, "to": it.to, "points": it.points }));
        let spectrum = outputs.spectrum;
        let spectrum =
            spectrum.map(|it| json!({ "until": it.until, "quantity": it.quantity.name() }));
        given(json!({
            "title": self.title,
            "oscillator": {
                "contact": self.oscillator.contact().tree(),
                "damping": self.oscillator.damping().name(),
                "zeta": self.oscillator.zeta(),
                level.0: level.1,
            },
            "rig": rig,
            "excitation": excitation,
            "initial": initial,
            "outputs": given(json!({
                "stationary": outputs.stationary,
                "moments_at": outputs.moments_at.tree(),
                "moments": outputs.moments.as_ref().map(|all| names(all)),
                "density_at": outputs.density_at.tree(),
                "steady": outputs.steady,
                "decay_rates": outputs.decay_rates,
                "spectrum": spectrum,
                "first_loss": outputs.first_loss.map(|until| json!({ "until": until })),
                "first_passage": outputs.first_passage.map(|it| {
                    json!({ "level": it.level, "side": it.side.name(), "until": it.until })
                }),
                "crossings": outputs.crossings.map(|window| json!({ "window": window })),
                "reach": outputs.reach.map(|it| json!({ "quantity": it.quantity.name(), "fraction": it.fraction })),
                "time_unit": outputs.time_unit.map(TimeUnit::name),
                "periodic": outputs.periodic.map(|phases| json!({ "phases": phases })),
                "response": response,
            })),
            "monte_carlo": monte_carlo,
            "accuracy": {
                "tolerance": self.accuracy.tolerance,
                "max_seconds": self.accuracy.max_seconds,
                "max_memory": self.accuracy.max_memory,
            },
            "method": given(json!({
                "transient": name_of(TRANSIENT, self.method.transient),
                "drift": name_of(DRIFT, self.method.drift),
                "time": name_of(TIME, self.method.time),
                "cells": self.method.cells,
                "step": self.method.step,
            })),
        }))
    }

    /// The resolved scene as a scene file: the same run again.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        for (key, value) in self.resolved().as_object().into_iter().flatten() {
            if let Value::Object(pairs) = value {
                let _ = writeln!(text, "\n[{key}]");
                for (key, value) in pairs {
                    let _ = writeln!(text, "{key} = {}", toml_value(value));
                }
            } else {
                let _ = writeln!(text, "{key} = {}", toml_value(value));
            }
        }
        text
    }

    /// A folder name made from the title: letters, digits, '.', '_' and '-' stay, everything else
    /// becomes '-'.
    pub fn folder(&self) -> String {
        let mut name = String::new();
        for c in self.title.chars() {
            if c.is_alphanumeric() || matches!(c, '.' | '_') {
                name.push(c);
            } else if !name.ends_with('-') {
                name.push('-');
            }
        }
        // Neither hidden, nor "..", nor longer than a file system takes (255 bytes).
        let name = name.trim_matches(['-', '.']);
        let short: String = name.chars().take(60).collect();
        if short.is_empty() {
            "untitled".into()
        } else {
            short
        }
    }
}

/// A value as TOML writes it.
pub(crate) fn toml_value(value: &Value) -> String {
    match value {
        Value::Object(pairs) => {
            let pairs = pairs.iter();
            let pairs: Vec<String> = pairs
                .map(|(key, value)| format!("{key} = {}", toml_value(value)))
                .collect();
            format!("{{ {} }}", pairs.join(", "))
        }
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(toml_value).collect();
            format!("[{}]", items.join(", "))
        }
        // Text and numbers read the same in both.
        other => other.to_string(),
    }
}

/// Without the keys that have no value.
fn given(mut it: Value) -> Value {
    if let Some(pairs) = it.as_object_mut() {
        pairs.retain(|_, value| !value.is_null());
    }
    it
}

/// Names of [`Scheme`] in scenes.
const SCHEMES: &[(&str, Scheme)] = &[
    ("auto", Scheme::Auto),
    ("central_difference", Scheme::CentralDifference),
    ("baoab", Scheme::Baoab),
    ("splitting_4_2", Scheme::Splitting42),
    ("splitting_6_2", Scheme::Splitting62),
    ("euler_maruyama", Scheme::EulerMaruyama),
    ("exponential_heun", Scheme::ExponentialHeun),
];

/// Names of [`TransientMethod`] in scenes.
const TRANSIENT: &[(&str, TransientMethod)] = &[
    ("finite_volume", TransientMethod::FiniteVolume),
    ("flow_map", TransientMethod::FlowMap),
];

/// Names of [`TimeScheme`] in scenes.
const TIME: &[(&str, TimeScheme)] = &[
    ("backward_euler", TimeScheme::BackwardEuler),
    ("implicit", TimeScheme::Implicit),
    ("imex", TimeScheme::Imex),
    ("explicit", TimeScheme::Explicit),
];

/// Names of [`Drift`] in scenes: a word, or the order as a number.
const DRIFT: &[(&str, Drift)] = &[
    ("upwind", Drift::Upwind),
    ("2", Drift::Order2),
    ("4", Drift::Order4),
    ("6", Drift::Order6),
    ("8", Drift::Order8),
];

fn name_of<T: PartialEq>(names: &[(&'static str, T)], value: Option<T>) -> Value {
    let name = value.and_then(|value| names.iter().find(|(_, it)| *it == value));
    let name = name.map_or("auto", |(name, _)| *name);
    name.parse::<u64>()
        .map_or(json!(name), |order| json!(order))
}

/// The damping laws a scene file can name.
#[cfg(feature = "toml")]
const DAMPINGS: &[(&str, Damping)] = &[
    ("viscous", Damping::Viscous),
    ("contact", Damping::Contact),
    ("hunt_crossley", Damping::HuntCrossley),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_know_every_scheme_by_the_name_it_gives_itself() {
        for (name, it) in SCHEMES {
            assert_eq!(*name, it.name());
        }
        for (name, it) in TIME {
            assert_eq!(*name, it.name());
        }
        for it in Drift::ALL {
            let name = match it {
                Drift::Upwind => "upwind".to_string(),
                _ => it.order().to_string(),
            };
            assert!(DRIFT.contains(&(name.as_str(), it)), "{it:?}");
        }
    }
}
