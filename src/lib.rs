//! Random vibration of a preloaded Hertzian contact that now and then loses contact.

pub mod contact;
pub mod error;
pub mod estimate;
pub mod fokker_planck;
pub mod gaussian;
pub mod initial;
pub mod moments;
pub mod oscillator;
pub mod quadrature;
pub mod rig;
pub mod scales;
pub mod sparse;
pub mod stationary;

pub use error::{Error, Result};
