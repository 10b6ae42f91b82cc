//! The Fokker-Planck operator in Hermite functions of v and spectral elements of q, and its resolvent.

mod factored;
mod operator;

pub(super) use factored::Factored;
pub(super) use operator::{DEGREE, Hierarchy, Resolution};
