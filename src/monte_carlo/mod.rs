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
mod bins;
mod choice;
mod ensemble;
mod events;
mod first_loss;
mod hamiltonian;
mod histogram;
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

pub use choice::scheme_and_step;
pub use ensemble::{Densities, EnsembleResult, companion, run, run_with_bias};
pub use events::Crossings;
pub use first_loss::{FirstLossResult, first_loss, first_loss_scheme_and_step};
pub use histogram::Histogram;
pub use records::{RecordResult, RecordSettings, RecordSize, record_size, records};
pub use scheme::Scheme;
pub use series::{SeriesSettings, SeriesSize, series, series_size};
pub use settings::{EnsembleSettings, MOST_COSINES, Noise};

use choice::{choose, resolve};
use progress::Progress;
use settings::check_bins;
