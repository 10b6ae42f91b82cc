//! What a sample may be asked: how many paths, how long records, by which scheme, under which noise.

use super::scheme::Scheme;
use crate::budget::Limits;
use crate::excitation::Excitation;
use std::f64::consts::PI;

/// Size, seed, scheme and noise of a sample, and its limits.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampling {
    /// Number of paths of an ensemble, at least 2.
    pub paths: u64,
    /// Time observed in long records, dimensionless, all together.
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
            max_seconds: f64::INFINITY,
            max_memory: u64::MAX,
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

impl Noise {
    /// A warning where a sum of M cosines adds more than a twentieth to the kurtosis of the stationary response: the
    /// resonance, of width zeta at w = 1, holds few of them. Of M independent terms with amplitudes |H(w)|, w uniform up
    /// to the band B, and random phases it adds about (3/2) E|H|^4/(E|H|^2)^2/M = 3 B/(4 pi zeta M).
    pub(super) fn warning(self, zeta: f64) -> Option<String> {
        let Self::Cosines { count, band } = self else {
            return None;
        };
        let excess = 0.75 * band / (PI * zeta * f64::from(count));
        (excess > 0.05).then(|| {
            format!(
                "few of the {count} cosines up to {band} fall into the resonance, of width zeta = {zeta}: the \
                 response is not Gaussian, its kurtosis about {excess:.2} above that under white noise; \
                 {:.0} cosines would do",
                (15.0 * band / (PI * zeta)).ceil()
            )
        })
    }
}
