//! Monte Carlo: independent paths, streamed statistics, standard errors on every number.
//!
//! - [`run`]: an ensemble and its moments at given times;
//! - [`records`]: long realisations, stationary statistics and losses of contact;
//! - [`series`]: sampled records, for spectra;
//! - [`first_loss`]: how long contact survives.
//!
//! ```
//! use vibroimpact::contact::ContactLaw;
//! use vibroimpact::initial::Initial;
//! use vibroimpact::monte_carlo::{Sampling, run};
//! use vibroimpact::oscillator::Oscillator;
//!
//! let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3)?;
//! let settings = Sampling {
//!     paths: 10_000,
//!     ..Sampling::default()
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

// The hot loops index lanes.
#![allow(clippy::needless_range_loop)]

mod batch;
mod displacement;
mod ensemble;
mod events;
mod few;
mod first_loss;
mod hamiltonian;
mod histogram;
mod influence;
mod law;
mod noise;
mod paths;
mod progress;
mod records;
mod scheme;
mod series;
mod settings;
mod signal;
mod statistics;
mod walk;

pub(crate) use ensemble::Ensemble;
pub use ensemble::{EnsembleResult, run};
pub use events::{Crossings, Impacts};
pub(crate) use first_loss::FirstLosses;
pub use first_loss::{FirstLossResult, first_loss, first_passage};
pub use histogram::Histogram;
pub(crate) use records::Records;
pub use records::{RecordResult, records};
pub use scheme::Scheme;
pub(crate) use series::Series;
pub use series::{Samples, series};
pub(crate) use settings::MOST_COSINES;
pub use settings::{Noise, Sampling};
