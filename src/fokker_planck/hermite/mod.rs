//! The Fokker-Planck operator in Hermite functions of v and spectral elements of q, and its resolvent.

mod adjoint;
mod basis;
mod condensed;
mod factored;
mod friction;
mod local;
mod nested;
mod operator;
mod resolution;
mod weights;

pub(super) use adjoint::Adjoint;
pub(super) use factored::Factored;
pub(super) use friction::{Column, Kept, heavy, lost_digits, work};
pub(super) use operator::Hierarchy;
pub(super) use resolution::Resolution;
