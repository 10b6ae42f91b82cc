//! The transient Fokker-Planck equation (17) on a mesh.

pub mod density;
pub mod difference;
pub mod domain;
pub mod flow_map;
pub mod flux;
pub mod generator;
pub mod interpolation;
pub mod mesh;
pub mod observables;
mod ornstein_uhlenbeck;
pub mod trajectory;
