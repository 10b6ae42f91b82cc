//! A local grid that moves with a narrow density.

pub(crate) mod frame;
mod interpolant;
mod linear;
pub(crate) mod local_grid;
