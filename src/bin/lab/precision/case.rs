//! The cases: where closed forms are known, where the contact is lost, where it is stiff, and the paper's
//! lowest and highest level.

use std::f64::consts::PI;
use vibroimpact::contact::ContactLaw;
use vibroimpact::error::Result;
use vibroimpact::fokker_planck::{Drift, Mesh, Settings, transient};
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::Oscillator;

/// An oscillator, a start and a time.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Its name in files.
    pub name: &'static str,
    /// What it is, for tables.
    pub title: &'static str,
    pub oscillator: Oscillator,
    pub initial: Initial,
    /// The time at which errors are taken.
    pub until: f64,
}

impl Case {
    fn new(
        name: &'static str,
        title: &'static str,
        (contact, zeta, h): (ContactLaw, f64, f64),
        (mean, deviation): ([f64; 2], [f64; 2]),
        until: f64,
    ) -> Result<Self> {
        Ok(Self {
            name,
            title,
            oscillator: Oscillator::new(contact, zeta, h)?,
            initial: Initial::gaussian(mean, deviation)?,
            until,
        })
    }

    /// The mesh of a transient of the case, `finer` than by itself.
    ///
    /// # Errors
    /// Those of [`transient::mesh`].
    pub fn mesh(&self, drift: Drift, settings: &Settings, finer: f64) -> Result<Mesh> {
        let (oscillator, initial) = (&self.oscillator, &self.initial);
        transient::mesh(oscillator, initial, self.until, drift, settings, finer)
    }

    /// Whether friction is faster than the motion.
    pub fn is_stiff(&self) -> bool {
        self.oscillator.zeta() > 1.0
    }

    /// Whether the density is known in closed form.
    pub fn is_closed_form(&self) -> bool {
        let contact = self.oscillator.contact();
        matches!(contact, ContactLaw::Linear | ContactLaw::Free)
    }
}

pub fn cases() -> Result<Vec<Case>> {
    Ok(vec![
        Case::new(
            "contact",
            "Hertz, h = 2e-3, zeta = 0.005, t = 20",
            (ContactLaw::Hertz, 0.005, 2e-3),
            ([1.0, 0.0], [0.4; 2]),
            20.0,
        )?,
        // What hand-written programs are held against: from near rest, half a correlation time long.
        Case::new(
            "half-memory",
            "Hertz, h = 2e-3, zeta = 0.005, from (0, 0) with deviation 0.3, t = 50",
            (ContactLaw::Hertz, 0.005, 2e-3),
            ([0.0, 0.0], [0.3; 2]),
            50.0,
        )?,
        // T = 0.25.
        Case::new(
            "linear",
            "G = q, zeta = 0.05, T = 0.25, t = 4 pi",
            (ContactLaw::Linear, 0.05, 0.025 / PI),
            ([1.0, 0.0], [0.3; 2]),
            4.0 * PI,
        )?,
        Case::new(
            "flight",
            "G = -1, zeta = 0.05, h = 0.01, t = 3",
            (ContactLaw::Free, 0.05, 0.01),
            ([0.0, -1.0], [0.4; 2]),
            3.0,
        )?,
        // T = 0.63.
        Case::new(
            "overdamped",
            "Hertz, zeta = 5, h = 2, t = 5",
            (ContactLaw::Hertz, 5.0, 2.0),
            ([1.0, 0.0], [0.4; 2]),
            5.0,
        )?,
        // T = 3.1e-4, a start of the same shape as in "contact".
        Case::new(
            "quiet",
            "Hertz, h = 1e-6, zeta = 0.005, t = 20",
            (ContactLaw::Hertz, 0.005, 1e-6),
            ([0.02, 0.0], [0.009; 2]),
            20.0,
        )?,
        // T = 94.
        Case::new(
            "loud",
            "Hertz, h = 0.3, zeta = 0.005, t = 20",
            (ContactLaw::Hertz, 0.005, 0.3),
            ([0.0, 0.0], [6.0; 2]),
            20.0,
        )?,
    ])
}
