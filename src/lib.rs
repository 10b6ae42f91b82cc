//! Random vibration of a preloaded Hertzian contact that now and then loses contact.

pub mod contact;
pub mod error;
pub mod estimate;
pub mod fokker_planck;
pub mod initial;
pub mod json;
pub mod moments;
pub mod monte_carlo;
pub mod oscillator;
pub mod plan;
pub mod quadrature;
pub mod report;
pub mod results;
pub mod rig;
pub mod scene;
pub mod stationary;

pub use error::{Error, Result};
