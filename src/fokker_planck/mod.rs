//! The transient Fokker-Planck equation (17) by finite volumes: transient, steady state, slow modes.

pub mod choice;
pub mod density;
pub mod difference;
pub mod domain;
pub mod flux;
pub mod generator;
pub mod march;
pub mod mesh;
pub mod modes;
pub mod observables;
mod radius;
pub mod steady;
pub mod transient;

pub use choice::{Cost, Method, Settings, TimeScheme};
pub use density::Snapshot;
pub use flux::Drift;
pub use modes::{DecayRate, decay_rates};
pub use steady::{Steady, steady};
pub use transient::{Transient, transient};
