//! Random vibration of a preloaded Hertzian contact that now and then loses contact.

pub mod contact;
pub mod error;
pub mod estimate;
pub mod initial;
pub mod moments;
pub mod monte_carlo;
pub mod oscillator;
pub mod quadrature;
pub mod rig;
pub mod stationary;

pub use error::{Error, Result};
