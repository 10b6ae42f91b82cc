//! The Fokker-Planck operator in Hermite functions of v and spectral elements of q, and its resolvent.

mod basis;
mod condensed;
mod factored;
mod friction;
mod local;
mod nested;
mod operator;

pub(super) use basis::DEGREE;
pub(super) use factored::Factored;
pub(super) use friction::{Adjoint, Column, Kept, REACH, SAFETY, Settled, work};
pub(super) use operator::{Hierarchy, Resolution};
