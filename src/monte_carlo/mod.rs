//! Monte Carlo: independent paths, streamed statistics, standard errors on every number.
//!
//! - [`run`]: an ensemble, its moments and densities at given times;
//! - [`records`]: long records, stationary statistics and losses of contact;
//! - [`series`]: sampled records, for spectra;
//! - [`first_loss`]: how long contact survives.
//!
//! ```
//! use vibroimpact::contact::ContactLaw;
//! use vibroimpact::initial::Initial;
//! use vibroimpact::monte_carlo::{EnsembleSettings, run};
//! use vibroimpact::oscillator::Oscillator;
//!
//! let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3)?;
//! let settings = EnsembleSettings {
//!     paths: 10_000,
//!     ..EnsembleSettings::default()
//! };
//! let sample = run(&oscillator, &Initial::Rest, &[1.0], &settings, &|_done| ())?;
//! let energy = sample.moments[0].mean_energy;
//! assert!((energy.value - 0.00623).abs() < 4.0 * energy.error);
//! # Ok::<(), vibroimpact::Error>(())
//! ```
//!
//! Path k of a seed is the same path in an ensemble of 10 or of 10^6, on 1 or on 64 threads, and the
//! results have the same bits: paths advance in fixed blocks, and the blocks are added in their order.
//! Memory does not depend on the number of paths.

// The hot loops must be inlined into code compiled for the vectors of the machine, and they index lanes.
#![allow(clippy::inline_always, clippy::needless_range_loop)]

mod batch;
mod ensemble;
mod events;
mod first_loss;
mod hamiltonian;
mod histogram;
mod law;
mod noise;
mod paths;
mod records;
mod scheme;
mod series;
mod signal;
mod statistics;

pub use ensemble::{Densities, EnsembleResult, companion, run, run_with_bias};
pub use events::Crossings;
pub use first_loss::{FirstLossResult, first_loss, first_loss_scheme_and_step};
pub use histogram::Histogram;
pub use records::{RecordResult, RecordSettings, RecordSize, record_size, records};
pub use scheme::Scheme;
pub use series::{SeriesSettings, SeriesSize, series, series_size};

use crate::error::{Error, Result, positive};
use crate::estimate::name_at;
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

/// Size, seed and scheme of an ensemble.
#[derive(Debug, Clone, PartialEq)]
pub struct EnsembleSettings {
    /// Number of paths, at least 2.
    pub paths: u64,
    /// Seed; with a path's number it fixes the path.
    pub seed: u64,
    /// How one step is made.
    pub scheme: Scheme,
    /// Longest step; None chooses one. Each interval between output times is cut into equal steps.
    pub step: Option<f64>,
    /// The excitation.
    pub noise: Noise,
    /// Bins of the densities at every output time; 0 for none.
    pub bins: usize,
    /// Seconds after which the run gives up with [`Error::Limit`].
    pub max_seconds: f64,
}

impl Default for EnsembleSettings {
    fn default() -> Self {
        Self {
            paths: 100_000,
            seed: 1,
            scheme: Scheme::Auto,
            step: None,
            noise: Noise::White,
            bins: 0,
            max_seconds: f64::INFINITY,
        }
    }
}

/// The names of all moments at these times, as a warning that their errors are not known lists them.
fn unknown(prefix: &str, times: &[Option<f64>]) -> Vec<String> {
    let names = crate::moments::Moments::default().named().map(|it| it.0);
    let at = |t: &Option<f64>| {
        names.map(|name| {
            let name = format!("{prefix}.{name}");
            t.map_or(name.clone(), |t| name_at(&name, t))
        })
    };
    times.iter().flat_map(at).collect()
}

/// Most cosines of a noise: the cost of a step is in proportion to them.
pub const MOST_COSINES: u32 = 10_000;

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
    /// Gaussian noise of the same spectrum, synthesised by fast Fourier transform: for [`records`], in
    /// [`Scheme::CentralDifference`] alone, at a tenth of the cost of 400 cosines and without their
    /// finite number.
    Band {
        /// Highest circular frequency w_max, at most pi/step.
        band: f64,
    },
}

/// The scheme and the longest step that [`run`] would use.
///
/// # Errors
/// [`Error::Invalid`] for a step that is not positive, or a scheme that does not suit the noise.
pub fn scheme_and_step(
    oscillator: &Oscillator,
    initial: &Initial,
    settings: &EnsembleSettings,
) -> Result<(Scheme, f64)> {
    let frequency = paths::highest_frequency(oscillator, initial);
    let EnsembleSettings {
        scheme,
        noise,
        step,
        ..
    } = *settings;
    choose((scheme, step), noise, oscillator, frequency)
}

/// The scheme meant and its longest step, that of the settings or its own; `frequency` is the highest of
/// the scene.
fn choose(
    (scheme, step): (Scheme, Option<f64>),
    noise: Noise,
    oscillator: &Oscillator,
    frequency: f64,
) -> Result<(Scheme, f64)> {
    let scheme = resolve(scheme, noise, oscillator.zeta(), frequency)?;
    let step = match step {
        Some(step) => positive("monte_carlo.step", step)?,
        None => scheme::automatic_step(scheme, oscillator, frequency),
    };
    Ok((scheme, step))
}

impl Noise {
    /// What a sum of M cosines adds to the kurtosis of the stationary response, about: the resonance, of
    /// width zeta at w = 1, holds few of them. Of M independent terms with amplitudes |H(w)|, w uniform up
    /// to the band B, and random phases it is (3/2) E|H|^4/(E|H|^2)^2/M = 3 B/(4 pi zeta M).
    fn excess_kurtosis(self, zeta: f64) -> f64 {
        match self {
            Self::Cosines { count, band } => {
                0.75 * band / (std::f64::consts::PI * zeta * f64::from(count))
            }
            Self::White | Self::Band { .. } => 0.0,
        }
    }

    /// A warning where that is more than a twentieth.
    fn warning(self, zeta: f64) -> Option<String> {
        let excess = self.excess_kurtosis(zeta);
        let enough = |band: f64| 15.0 * band / (std::f64::consts::PI * zeta);
        match self {
            Self::Cosines { count, band } if excess > 0.05 => Some(format!(
                "few of the {count} cosines up to {band} fall into the resonance, of width zeta = {zeta}: the \
                 response is not Gaussian, its kurtosis about {excess:.2} above that under white noise; \
                 {:.0} cosines would do",
                enough(band).ceil()
            )),
            _ => None,
        }
    }
}

/// The scheme meant, if it suits the noise; `frequency` is the highest of the scene.
fn resolve(scheme: Scheme, noise: Noise, zeta: f64, frequency: f64) -> Result<Scheme> {
    let (count, band) = match noise {
        Noise::White => {
            return Ok(match scheme {
                Scheme::Auto if zeta > 2.0 * frequency.max(1.0) => Scheme::ExponentialHeun,
                Scheme::Auto => Scheme::Splitting42,
                scheme => scheme,
            });
        }
        Noise::Cosines { count, band } => (count, band),
        Noise::Band { band } => (1, band),
    };
    positive("monte_carlo.noise.band", band)?;
    if !(1..=MOST_COSINES).contains(&count) {
        let accepted = format!("1 to {MOST_COSINES}");
        return Err(Error::invalid("monte_carlo.noise.cosines", count, accepted));
    }
    if !matches!(scheme, Scheme::Auto | Scheme::CentralDifference) {
        let accepted = "\"central_difference\" or \"auto\" with band-limited noise";
        return Err(Error::invalid(
            "monte_carlo.scheme",
            format!("\"{scheme}\""),
            accepted,
        ));
    }
    Ok(Scheme::CentralDifference)
}

/// Bins per histogram that fit in memory at every output time.
fn check_bins(bins: usize, least: usize) -> Result<usize> {
    if (least..=10_000).contains(&bins) {
        return Ok(bins);
    }
    Err(Error::invalid(
        "monte_carlo.bins",
        bins,
        format!("{least} to 10000"),
    ))
}

/// Reports a fraction from any thread, a few hundred times in all, and watches the clock.
struct Progress<'a> {
    total: u64,
    done: AtomicU64,
    start: Instant,
    max_seconds: f64,
    late: AtomicBool,
    report: &'a (dyn Fn(f64) + Sync),
}

impl<'a> Progress<'a> {
    fn new(total: u64, report: &'a (dyn Fn(f64) + Sync)) -> Self {
        Self {
            total: total.max(1),
            done: AtomicU64::new(0),
            start: Instant::now(),
            max_seconds: f64::INFINITY,
            late: AtomicBool::new(false),
            report,
        }
    }

    /// The same with a limit of time.
    fn within(mut self, max_seconds: f64) -> Self {
        self.max_seconds = max_seconds;
        self
    }

    /// Whether the limit of time is behind; whoever asks stops.
    fn late(&self) -> bool {
        let late = self.start.elapsed().as_secs_f64() > self.max_seconds;
        if late {
            self.late.store(true, Ordering::Relaxed);
        }
        late
    }

    /// An error if anybody stopped early.
    fn in_time(&self) -> Result<()> {
        if !self.late.load(Ordering::Relaxed) {
            return Ok(());
        }
        let done = self.done.load(Ordering::Relaxed) as f64 / self.total as f64;
        Err(Error::Limit {
            key: "accuracy.max_seconds",
            limit: self.max_seconds.to_string(),
            what: format!("{:.0} % of the paths were done", 100.0 * done),
        })
    }

    fn add(&self, work: u64) {
        let before = self.done.fetch_add(work, Ordering::Relaxed);
        let fraction = |done: u64| (done as f64 / self.total as f64).min(1.0);
        let (before, now) = (fraction(before), fraction(before.saturating_add(work)));
        if (before * 200.0).floor() < (now * 200.0).floor() {
            (self.report)(now);
        }
    }

    fn finish(&self) {
        (self.report)(1.0);
    }
}
