//! The transient Fokker-Planck equation (17) by finite volumes: transient, steady state, slow modes.

mod absorbed;
pub mod choice;
pub mod cost;
pub mod density;
pub mod difference;
pub mod domain;
pub mod first_loss;
pub mod flight;
pub mod flow_map;
pub mod flux;
pub mod generator;
pub mod interpolation;
pub mod march;
pub mod mesh;
pub mod modes;
pub mod observables;
mod ornstein_uhlenbeck;
mod pontryagin;
mod propagator;
mod radius;
pub mod steady;
pub mod trajectory;
pub mod transient;

pub use choice::{Cost, Method, Settings, TimeScheme, TransientMethod};
pub use cost::{Task, cost};
pub use density::Snapshot;
pub use first_loss::{FirstLoss, first_loss, first_loss_cost};
pub use flight::{FlightLaw, flight_law};
pub use flux::Drift;
pub use modes::{DecayRate, decay_rates};
pub use steady::{Steady, steady};
pub use transient::{Transient, transient};
