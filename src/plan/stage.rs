//! One stage of a plan: which question it answers, for which outputs, and what it will cost.

use crate::budget::Cost;
use crate::error::{Error, Result};

/// One part of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage {
    /// Which part.
    pub part: Part,
    /// The outputs that need it, as keys of the scene.
    pub needed_by: Vec<&'static str>,
    /// How it will be computed, and why so.
    pub method: String,
    /// What it will cost; nothing if it was refused before that is known.
    pub cost: Cost,
    /// Why it will not be run; the others are.
    pub refusal: Option<Refusal>,
}

/// Why a stage cannot be run, where others may.
#[derive(Debug, Clone, PartialEq)]
pub enum Refusal {
    /// A limit of the scene that it cannot keep.
    Limit {
        /// The key that holds the limit.
        key: &'static str,
        /// The limit.
        limit: String,
        /// What would have been needed.
        what: String,
    },
    /// No mesh of the program's own choice holds it.
    Mesh {
        /// What does not fit.
        what: String,
        /// What would help.
        help: String,
    },
}

impl Refusal {
    /// Of an error that leaves other stages; any other is given back.
    pub(super) fn of(error: Error) -> Result<Self> {
        match error {
            Error::Limit { key, limit, what } => Ok(Self::Limit { key, limit, what }),
            Error::Mesh { what, help } => Ok(Self::Mesh { what, help }),
            error => Err(error),
        }
    }

    /// As the error of a plan that has no other stage.
    pub fn error(&self) -> Error {
        match self {
            Self::Limit { key, limit, what } => Error::limit(key, limit, what),
            Self::Mesh { what, help } => Error::mesh(what, help),
        }
    }

    /// As that of the stage, beside others that have an answer.
    pub fn unanswered(&self) -> Error {
        match self {
            Self::Limit { .. } => self.error(),
            Self::Mesh { what, help } => Error::Unresolved {
                what: format!("{what}; {help}"),
            },
        }
    }
}

impl Stage {
    /// Seconds that it is foreseen to take.
    pub fn seconds(&self) -> f64 {
        self.refusal.as_ref().map_or(self.cost.seconds, |_| 0.0)
    }

    /// Bytes that it is foreseen to hold.
    pub fn memory_bytes(&self) -> u64 {
        self.refusal.as_ref().map_or(self.cost.memory, |_| 0)
    }
}

/// The parts a plan can have, what is sampled beside what it is held against.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// The closed form (21)-(30), or the null vector where damping leaves none.
    Stationary,
    /// Losses of contact in a window, by Rice's formula.
    Crossings,
    /// The first loss of contact, by the backward equation.
    FirstLoss,
    /// The first losses of an ensemble of paths.
    FirstLossPaths,
    /// The first passage of a level, by the backward equation.
    FirstPassage,
    /// The first passages of a level by an ensemble of paths.
    FirstPassagePaths,
    /// The transient of the Fokker-Planck equation.
    Transient,
    /// When a moment of it reaches a level.
    Reach,
    /// The law that lasts under a drive.
    Periodic,
    /// The same over the frequency of the drive.
    Response,
    /// Its steady state on the mesh.
    Steady,
    /// The slowest eigenvalues of L.
    DecayRates,
    /// The spectrum from the resolvent of L.
    Spectrum,
    /// The ensemble of paths.
    MonteCarlo,
    /// Sampled records for the spectrum by Welch's method.
    Series,
    /// Long realisations of the stationary motion.
    Records,
}

impl Part {
    /// All of them, in the order they run.
    pub(crate) const ALL: [Self; 16] = [
        Self::Stationary,
        Self::Crossings,
        Self::FirstLoss,
        Self::FirstPassage,
        Self::Transient,
        Self::Reach,
        Self::Periodic,
        Self::Response,
        Self::Steady,
        Self::DecayRates,
        Self::Spectrum,
        Self::Series,
        Self::MonteCarlo,
        Self::FirstLossPaths,
        Self::FirstPassagePaths,
        Self::Records,
    ];

    /// The name in tables and in results.json.
    pub fn name(self) -> &'static str {
        self.names()[0]
    }

    /// What it is called in a sentence.
    pub(crate) fn words(self) -> &'static str {
        self.names()[1]
    }

    fn names(self) -> [&'static str; 2] {
        match self {
            Self::Stationary => ["stationary", "closed form"],
            Self::Crossings => ["crossings", "crossings"],
            Self::FirstLoss => ["first_loss", "first loss"],
            Self::FirstLossPaths => ["first_loss_paths", "paths of the first loss"],
            Self::FirstPassage => ["first_passage", "first passage"],
            Self::FirstPassagePaths => ["first_passage_paths", "paths of the first passage"],
            Self::Transient => ["transient", "transient"],
            Self::Reach => ["reach", "time to a fraction"],
            Self::Periodic => ["periodic", "periodic law"],
            Self::Response => ["response", "response curve"],
            Self::Steady => ["steady", "steady state"],
            Self::DecayRates => ["decay_rates", "decay rates"],
            Self::Spectrum => ["spectrum", "spectrum"],
            Self::MonteCarlo => ["monte_carlo", "paths"],
            Self::Series => ["welch", "Welch's spectrum"],
            Self::Records => ["records", "long realisations"],
        }
    }

    /// Whether it draws paths or records.
    pub(super) fn is_sampled(self) -> bool {
        matches!(
            self,
            Self::MonteCarlo
                | Self::FirstLossPaths
                | Self::FirstPassagePaths
                | Self::Series
                | Self::Records
        )
    }
}
