//! How each question of a scene will be answered.

use crate::fokker_planck::{
    self, Eigenvalues, FirstPassage, PeriodicLaw, Reach, Resolvent, ResponseCurve, StationaryState,
    SteadyState,
};
use crate::moments::Moment;
use crate::monte_carlo::{Ensemble, FirstLosses, Records, Series};
use crate::scene::SpectrumRequest;

/// How a stage will be computed: decided once, printed and executed.
#[derive(Debug, Clone)]
pub(super) enum Recipe {
    ClosedForm,
    Stationary(StationaryState),
    Transient(fokker_planck::Recipe),
    /// With the moment, and the law of its stationary value where no closed form has it.
    Reach(Reach, Moment, Option<StationaryState>),
    Periodic(PeriodicLaw),
    Response(ResponseCurve),
    Steady(SteadyState),
    DecayRates(Eigenvalues),
    Spectrum(Resolvent, SpectrumRequest),
    /// Of a loss of contact or of a level.
    FirstPassage(FirstPassage),
    Ensemble(Ensemble),
    Series(Series, SpectrumRequest),
    /// The same by paths.
    FirstLosses(FirstLosses),
    Records(Records),
}
