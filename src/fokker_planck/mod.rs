//! The Fokker-Planck equation (17), by flow maps, finite volumes and Hermite functions: transient, steady state, slow modes, spectra,
//! first passages, and what a drive makes of them.
//!
//! ```
//! use vibroimpact::fokker_planck::{Settings, spectrum, transient};
//! use vibroimpact::{contact::ContactLaw, initial::Initial, oscillator::*, spectrum::linear};
//!
//! let oscillator = Oscillator::new(ContactLaw::Linear, 0.05, 0.02)?;
//! let start = Initial::gaussian([1.0, 0.0], [0.4, 0.4])?;
//! let settings = Settings::default();
//! let course = transient(&oscillator, &start, &[0.5], &[], &settings, &|_done| ())?;
//! let mean = course.moments[0].mean_q; // free decay from 1
//! assert!((mean.value - 0.8796).abs() < 1e-3);
//! let seen = spectrum(&oscillator, Quantity::Displacement, &[0.9], &settings, &|_done| ())?;
//! assert!((seen.density[0].value / linear(&oscillator, 0.9) - 1.0).abs() < 1e-3);
//! # Ok::<(), vibroimpact::Error>(())
//! ```

mod adaptive;
#[doc(hidden)]
pub mod budget;
mod convergence;
mod density;
mod eigen;
mod excess;
mod first_passage;
mod fixed_point;
pub mod flow_map;
mod flux;
mod forcing;
mod generator;
mod hermite;
mod integrators;
mod krylov;
mod layout;
mod moving_frame;
mod null_vector;
mod observables;
mod ornstein_uhlenbeck;
mod periodic;
mod plane;
#[doc(hidden)]
pub mod policy;
mod radius;
mod settings;
mod solved;
mod spectrum;
mod tail;
mod trajectory;
pub mod transient;

pub use budget::Cost;
pub use density::{Density, Snapshot};
pub use eigen::{DecayRate, DecayRates, SolvedLaw, Steady, decay_rates, stationary_law, steady};
pub(crate) use eigen::{Eigenvalues, StationaryState, SteadyState};
pub(crate) use first_passage::first_loss::FirstPassage;
pub use first_passage::first_loss::{FirstLoss, first_loss, first_passage};
pub use first_passage::flight::{Flight, FlightLaw, flight_law};
pub use first_passage::impact::{ImpactLaw, impact_law};
pub use flux::Drift;
#[doc(hidden)]
pub use flux::{MassFlux, Measure};
pub use generator::Generator;
pub use integrators::{
    Additive, BackwardEuler, Chebyshev, Integrator, Radau, Solver, TimeIntegration,
};
#[doc(hidden)]
pub use null_vector::null_vector;
pub use observables::Observables;
pub use periodic::{Harmonic, MetastableLaw, Periodic, Response, Sweep, periodic, response};
pub(crate) use periodic::{PeriodicLaw, ResponseCurve};
#[doc(hidden)]
pub use plane::difference;
pub(crate) use plane::{domain, interpolation, mesh};
pub use plane::{domain::Domain, mesh::Axis, mesh::Mesh};
pub use settings::{Method, Settings, TimeScheme, TransientMethod};
pub(crate) use spectrum::Resolvent;
pub use spectrum::{Peak, Spectrum, spectrum};
pub use transient::{Multiplier, Reached, Transient, transient};
pub(crate) use transient::{Reach, Recipe};
#[doc(hidden)]
pub use transient::{transient_cost, uncertified, uncertified_periodic};
