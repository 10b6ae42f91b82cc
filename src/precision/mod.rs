//! How good the answers are, measured: error bars against stored truths.

pub mod calibration;
mod clock;
pub mod truths;
