//! How each question of a scene will be answered.

use crate::fokker_planck::{
    Eigenvalues, FirstPassage, PeriodicLaw, Reach, Recipe, Resolvent, ResponseCurve,
    StationaryState, SteadyState,
};
use crate::monte_carlo::{Ensemble, FirstLosses, Records, Series};

/// How each question will be answered: decided once, printed and executed.
#[derive(Debug, Clone, Default)]
pub(super) struct Recipes {
    pub(super) stationary: Option<StationaryState>,
    pub(super) transient: Option<Recipe>,
    pub(super) periodic: Option<PeriodicLaw>,
    pub(super) response: Option<ResponseCurve>,
    pub(super) steady: Option<SteadyState>,
    pub(super) eigenvalues: Option<Eigenvalues>,
    pub(super) spectrum: Option<Resolvent>,
    pub(super) first_passage: Option<FirstPassage>,
    pub(super) reach: Option<Reach>,
    pub(super) level: Option<StationaryState>,
    pub(super) passage: Option<FirstPassage>,
    pub(super) ensemble: Option<Ensemble>,
    pub(super) series: Option<Series>,
    pub(super) first_losses: Option<FirstLosses>,
    pub(super) passages: Option<FirstLosses>,
    pub(super) records: Option<Records>,
}
