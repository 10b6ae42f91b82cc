//! What a sample may be asked: how many paths, how long realisations, by which scheme, under which noise.

use super::scheme::Scheme;
use crate::budget::Limits;
use crate::estimate::Warning;
use crate::excitation::Excitation;
use crate::moments::Moment;
use std::f64::consts::{FRAC_PI_2, PI};

/// Size, seed, scheme and noise of a sample, and its limits.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampling {
    /// Number of paths of an ensemble, at least 2.
    pub paths: u64,
    /// Time observed in long realisations, dimensionless, all together.
    pub duration: f64,
    /// Seed; with the number of a path or record it fixes that.
    pub seed: u64,
    /// How one step is made.
    pub scheme: Scheme,
    /// Longest step; None chooses one. Each interval between output times or samples is cut into equal steps.
    pub step: Option<f64>,
    /// The random excitation.
    pub noise: Noise,
    /// What there is beside stationary noise: of an ensemble by a splitting alone.
    pub excitation: Excitation,
    /// The moments of an ensemble that are asked for; None for all of them.
    pub moments: Option<Vec<Moment>>,
    /// Seconds after which a sample gives up with [`crate::Error::Limit`].
    pub max_seconds: f64,
    /// Bytes that no sample may exceed.
    pub max_memory: u64,
}

impl Default for Sampling {
    fn default() -> Self {
        Self {
            paths: 100_000,
            duration: 1e6,
            seed: 1,
            scheme: Scheme::Auto,
            step: None,
            noise: Noise::White,
            excitation: Excitation::default(),
            moments: None,
            max_seconds: f64::INFINITY,
            max_memory: 8_000_000_000,
        }
    }
}

impl Sampling {
    pub(super) fn limits(&self) -> Limits {
        Limits::from_now(self.max_seconds, self.max_memory)
    }
}

/// Most cosines of a noise: the cost of a step is in proportion to them.
pub(crate) const MOST_COSINES: u32 = 10_000;

/// The random excitation f of (9).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Noise {
    /// White, of two-sided density h at every frequency, (10), (11).
    #[default]
    White,
    /// The sum of cosines of (31)-(33), with frequencies uniform in ]0, `band`] and phases uniform:
    /// density h up to `band`. For [`Scheme::CentralDifference`] alone.
    Cosines {
        /// Number M of cosines.
        count: u32,
        /// Highest circular frequency w_max.
        band: f64,
    },
    /// Gaussian noise of the same spectrum, synthesised by fast Fourier transform: for [`records`](super::records()), in
    /// [`Scheme::CentralDifference`] alone, at a tenth of the cost of 400 cosines and without their
    /// finite number.
    Band {
        /// Highest circular frequency w_max, at most pi/step.
        band: f64,
    },
}

/// A band that ends below twice the resonance distorts what the contact does.
const RESONANCE: f64 = 2.0;
/// Part of the variance of v that a band may cut off unsaid, and kurtosis that few cosines may add.
const CUT: f64 = 0.02;
const EXCESS: f64 = 0.05;

impl Noise {
    /// The highest circular frequency; None for white noise.
    pub(super) fn band(self) -> Option<f64> {
        match self {
            Self::White => None,
            Self::Cosines { band, .. } | Self::Band { band } => Some(band),
        }
    }

    /// How the response is not that to white noise. A band up to B cuts (2/pi) atan(2 zeta/B) off the variance of v, the integral of
    /// w^2 |H|^2 beyond B >> 1. The resonance, of width zeta at w = 1, holds few of M cosines: of M independent terms with
    /// amplitudes |H(w)|, w uniform up to B, and random phases the kurtosis is higher by about (3/2) E|H|^4/(E|H|^2)^2/M =
    /// 3 B/(4 pi zeta M).
    pub(super) fn warnings(self, zeta: f64) -> Vec<Warning> {
        let Some(band) = self.band() else {
            return Vec::new();
        };
        let cut = (2.0 * zeta / band).atan() / FRAC_PI_2;
        let mut all = Vec::new();
        if band < RESONANCE {
            all.push(format!(
                "the band of the noise ends at {band}, below {RESONANCE}: the response near the resonance at 1 is not that to \
                 white noise"
            ));
        } else if cut > CUT {
            all.push(format!(
                "the band of the noise ends at {band}, and with zeta = {zeta} about {:.0} % of the variance of v under white noise \
                 lies beyond: paths and closed form are of different excitations",
                100.0 * cut
            ));
        }
        if let Self::Cosines { count, .. } = self {
            let excess = 0.75 * band / (PI * zeta * f64::from(count));
            if excess > EXCESS {
                all.push(format!(
                    "few of the {count} cosines up to {band} fall into the resonance, of width zeta = {zeta}: the \
                     response is not Gaussian, its kurtosis about {excess:.2} above that under white noise; \
                     {:.0} cosines would do",
                    (15.0 * band / (PI * zeta)).ceil()
                ));
            }
        }
        all.into_iter().map(Warning::from).collect()
    }
}
