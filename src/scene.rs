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
//! A file in TOML gives one: see [`text::SceneText`].

mod check;
mod doubts;
mod outputs;
pub(crate) mod resolved;
#[cfg(feature = "toml")]
pub mod text;
mod times;

pub use outputs::{Outputs, PassageRequest, ReachRequest, ResponseRequest, SpectrumRequest};
pub use times::Times;

use crate::clock::{Clock, TimeUnit};
use crate::excitation::Excitation;
use crate::fokker_planck::{Drift, Settings, TimeScheme, TransientMethod};
use crate::initial::Initial;
use crate::monte_carlo::Scheme;
use crate::oscillator::Oscillator;
use crate::rig::Rig;
use std::f64::consts::TAU;

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
    /// Length of long realisations, dimensionless, all together, and of those of Welch's method; None is
    /// the paper's 1e5 periods for the former, and 400 averages for the latter if there are no others.
    pub duration: Option<f64>,
}

impl MonteCarlo {
    /// Length of long realisations unless the scene says otherwise: the paper's 1e5 periods.
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
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Accuracy {
    /// For every deterministic number, relative to its normalisation.
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

    /// Whether long realisations are asked for: by Monte Carlo without times, for crossings, or by their
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

    /// The rig with the lengths of this contact.
    pub fn rig(&self) -> Option<Rig> {
        let contact = self.oscillator.contact();
        self.rig.map(|rig| rig.with_contact(contact))
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

    /// What it says about the Fokker-Planck solvers.
    pub(crate) fn settings(&self) -> Settings {
        Settings {
            excitation: self.excitation.clone(),
            method: self.method.transient,
            drift: self.method.drift,
            time: self.method.time,
            cells: self.method.cells,
            step: self.method.step,
            moments: self.outputs.moments.clone(),
            tolerance: self.accuracy.tolerance,
            neglected: None,
            max_memory: self.accuracy.max_memory,
            max_seconds: self.accuracy.max_seconds,
        }
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
