//! The transient: from an initial condition through the output times, on finer and finer meshes until each number is within its
//! tolerance.

mod asked;
mod astray;
mod begun;
mod cost;
mod curve;
mod decide;
mod error_estimate;
mod floquet;
mod followed;
mod ladder;
mod lasting;
mod law;
mod output;
mod propagator;
mod reach;
mod recipe;
mod report;
mod run;
mod solve;
mod start_up;
mod time_scheme;
mod upwind;

#[doc(hidden)]
pub use asked::mesh;
pub(crate) use floquet::Metastable;
pub use floquet::Multiplier;
#[doc(hidden)]
pub use propagator::time_integration;
pub(crate) use reach::Reach;
pub use reach::Reached;
pub(crate) use recipe::Recipe;
pub use report::Transient;
pub use solve::transient;
#[doc(hidden)]
pub use solve::{transient_cost, uncertified, uncertified_periodic};
#[doc(hidden)]
pub use time_scheme::time_scheme;
