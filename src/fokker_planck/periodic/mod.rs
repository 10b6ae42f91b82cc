//! The law that lasts under a harmonic drive: its moments over the phase, harmonics, Floquet multipliers, and the response
//! curve over the frequency.

mod harmonics;
mod law;
mod response;

pub use harmonics::Harmonic;
pub(crate) use law::PeriodicLaw;
pub use law::{MetastableLaw, Periodic, periodic};
pub(crate) use response::ResponseCurve;
pub use response::{Response, Sweep, response};
