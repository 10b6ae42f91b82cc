//! The transient Fokker-Planck equation (17) by finite volumes: transient, steady state, slow modes.

mod bars;
pub mod choice;
pub mod cost;
pub mod density;
pub mod difference;
pub mod domain;
pub mod flow_map;
pub mod flux;
mod frame;
pub mod generator;
mod hermite;
pub mod interpolation;
pub mod march;
pub mod mesh;
pub mod modes;
pub mod observables;
mod opening;
mod ornstein_uhlenbeck;
mod packet;
mod propagator;
mod radius;
mod refinement;
mod reduced;
pub mod spectrum;
pub mod steady;
pub mod trajectory;
pub mod transient;

pub use choice::{Cost, Method, Settings, TimeScheme, TransientMethod};
pub use cost::{Task, cost};
pub use density::Snapshot;
pub use flux::Drift;
pub use modes::{DecayRate, decay_rates};
pub use spectrum::{Peak, Spectrum, spectrum};
pub use steady::{Steady, steady};
pub use transient::{Transient, transient};
