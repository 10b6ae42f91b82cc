//! Monte Carlo: independent paths, streamed statistics, standard errors on every number.
//!
//! [`run`] answers for an ensemble at given times, [`records`] for stationary statistics and for losses
//! of contact from long records.
//!
//! Path k of a seed is the same path in an ensemble of 10 or of 10^6, on 1 or on 64 threads, and the
//! results have the same bits: paths advance in fixed blocks, and the blocks are added in their order.
//! Memory does not depend on the number of paths.

mod agreement;
mod batch;
mod ensemble;
mod events;
mod hamiltonian;
mod histogram;
mod law;
mod noise;
mod paths;
mod records;
mod scheme;
mod statistics;

pub use agreement::{Agreement, agreement, expected_worst};
pub use ensemble::{Densities, EnsembleResult, run};
pub use events::Crossings;
pub use histogram::Histogram;
pub use records::{RecordResult, RecordSettings, records};
pub use scheme::Scheme;

use crate::error::{Error, Result, positive};
use std::sync::atomic::{AtomicU64, Ordering};

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
        }
    }
}

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
}

/// The scheme meant, if it suits the noise.
fn resolve(scheme: Scheme, noise: Noise) -> Result<Scheme> {
    let Noise::Cosines { count, band } = noise else {
        return Ok(match scheme {
            Scheme::Auto => Scheme::Splitting42,
            scheme => scheme,
        });
    };
    positive("monte_carlo.noise.band", band)?;
    if count == 0 {
        return Err(Error::invalid(
            "monte_carlo.noise.cosines",
            count,
            "at least 1",
        ));
    }
    if !matches!(scheme, Scheme::Auto | Scheme::CentralDifference) {
        let accepted = "\"central_difference\" or \"auto\" with a sum of cosines";
        return Err(Error::invalid(
            "monte_carlo.scheme",
            format!("\"{scheme}\""),
            accepted,
        ));
    }
    Ok(Scheme::CentralDifference)
}

/// Reports a fraction from any thread, a few hundred times in all.
struct Progress<'a> {
    total: u64,
    done: AtomicU64,
    report: &'a (dyn Fn(f64) + Sync),
}

impl<'a> Progress<'a> {
    fn new(total: u64, report: &'a (dyn Fn(f64) + Sync)) -> Self {
        Self {
            total: total.max(1),
            done: AtomicU64::new(0),
            report,
        }
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
