//! Spectra of the stationary motion without sampling noise, from the resolvent of the generator.
//!
//! ```text
//! S(omega) = (2/pi) Re <X - E X, (i omega - L)^{-1} (X - E X)>,   X = N or q,   integral_0^infinity S d omega = Var X
//! ```
//!
//! One-sided, per circular frequency. At zero the spectrum of the force is the excitation's, S = 2h.
//! There is no time step, so nothing aliases; the answer is as good in the valleys, many decades below
//! the peak, as on it. The operator is that of `hermite`, the frequencies come all from one
//! small model (`reduced`).

mod curve;
mod peaks;
mod reduced;
mod resolvent;

pub use curve::Spectrum;
pub use peaks::Peak;
pub(crate) use resolvent::Resolvent;
pub use resolvent::spectrum;
