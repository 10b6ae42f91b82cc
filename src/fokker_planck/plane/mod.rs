//! The plane of q and v: truncated domain, mesh, stencils and splines on it.

pub mod difference;
pub(crate) mod domain;
pub(crate) mod interpolation;
pub(crate) mod mesh;
