//! The transient Fokker-Planck equation (17) on a mesh.

pub mod density;
pub mod difference;
pub mod domain;
pub mod flux;
pub mod generator;
pub mod mesh;
pub mod observables;
pub mod trajectory;
