//! First passage to contact loss by the backward equation, and the law of the flights.

pub(crate) mod absorbed;
mod bound;
mod cut;
mod driven;
pub(crate) mod first_loss;
pub(crate) mod flight;
mod flying;
pub(crate) mod impact;
mod layout;
mod limit;
pub(crate) mod mesh;
pub(crate) mod pontryagin;
mod region;
mod run;
mod start;
