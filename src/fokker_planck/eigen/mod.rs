//! Eigenvectors of the Fokker-Planck operator: the stationary density and the slowest rates of decay.

mod arnoldi;
mod decay_rates;
mod search;
mod stationary;
mod steady;

pub(crate) use decay_rates::Eigenvalues;
pub use decay_rates::{DecayRate, DecayRates};
pub use search::decay_rates;
pub(crate) use stationary::StationaryState;
pub use stationary::{SolvedLaw, stationary_law};
pub(crate) use steady::SteadyState;
pub use steady::{Steady, steady};
