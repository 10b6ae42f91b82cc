//! What a scene may fix of the Fokker-Planck solver.

use super::flux::Drift;
use crate::budget::Limits;
use crate::error::{Error, Result, positive};
use crate::excitation::Excitation;
use crate::format::num;
use crate::moments::Moment;

/// Scheme in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeScheme {
    /// Backward Euler with one sparse LU: first order, positive with upwind drift.
    BackwardEuler,
    /// Radau IIA of order 5: steps bound by accuracy alone, each a real and a complex sparse solve.
    Implicit,
    /// Additive Runge-Kutta of order 4, friction and diffusion implicit: steps bound by transport.
    Imex,
    /// Chebyshev series of the exponential, matrix-free: stages bound by transport and diffusion.
    Explicit,
}

impl TimeScheme {
    /// Every one.
    #[cfg(feature = "toml")]
    pub(crate) const ALL: [Self; 4] = [
        Self::BackwardEuler,
        Self::Implicit,
        Self::Imex,
        Self::Explicit,
    ];

    /// The name used in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::BackwardEuler => "backward_euler",
            Self::Implicit => "implicit",
            Self::Imex => "imex",
            Self::Explicit => "explicit",
        }
    }
}

/// How a density is carried forward.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransientMethod {
    /// Finite volumes with a scheme in time.
    FiniteVolume,
    /// The flow map: exact transport and exact noise in turn.
    FlowMap,
}

impl TransientMethod {
    /// Both, by their names in scenes.
    pub(crate) const NAMED: [(&str, Self); 2] = [
        ("finite_volume", Self::FiniteVolume),
        ("flow_map", Self::FlowMap),
    ];
}

/// What a scene says about the Fokker-Planck solver; None is an automatic choice.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// What shakes the oscillator beside stationary noise: in transients, periodic laws and first passages.
    pub excitation: Excitation,
    /// Finite volumes or flow map.
    pub method: Option<TransientMethod>,
    /// How g is carried across faces.
    pub drift: Option<Drift>,
    /// Scheme in time.
    pub time: Option<TimeScheme>,
    /// Cells in q and v.
    pub cells: Option<[usize; 2]>,
    /// Longest step in time; a stability limit may shorten it.
    pub step: Option<f64>,
    /// The moments that the error is aimed at; None for all of them.
    pub moments: Option<Vec<Moment>>,
    /// Error aimed at, relative to the normalisation of each number.
    pub tolerance: f64,
    /// Probability that the truncated domain may leave out; None for as little as the tolerance needs.
    pub neglected: Option<f64>,
    /// Bytes that may be used.
    pub max_memory: u64,
    /// Seconds after which a run stops with an error.
    pub max_seconds: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            excitation: Excitation::default(),
            method: None,
            drift: None,
            time: None,
            cells: None,
            step: None,
            moments: None,
            tolerance: 1e-3,
            neglected: None,
            max_memory: 8_000_000_000,
            max_seconds: 600.0,
        }
    }
}

/// Cells along an axis at most.
const MOST_CELLS: usize = 1_000_000_000;

impl Settings {
    /// Refuses what no solver takes.
    ///
    /// # Errors
    /// [`Error::Invalid`], naming the key of the scene.
    pub(crate) fn check(&self) -> Result<()> {
        let share = |key: &str, it: f64| {
            let accepted = "a number between 0 and 1";
            let holds = it > 0.0 && it < 1.0;
            let refused = || Error::invalid(key, num(it), accepted);
            holds.then_some(()).ok_or_else(refused)
        };
        share("accuracy.tolerance", self.tolerance)?;
        positive("accuracy.max_seconds", self.max_seconds)?;
        if self.max_memory == 0 {
            let accepted = "a size above 0, as \"8 GB\"";
            return Err(Error::invalid("accuracy.max_memory", 0, accepted));
        }
        for (k, cells) in self.cells.into_iter().flatten().enumerate() {
            if !(4..=MOST_CELLS).contains(&cells) {
                let accepted = format!("a whole number from 4 to {:e}", MOST_CELLS as f64);
                return Err(Error::invalid(
                    format!("method.cells[{k}]"),
                    cells,
                    accepted,
                ));
            }
        }
        if let Some(step) = self.step {
            positive("method.step", step)?;
        }
        if self.moments.as_ref().is_some_and(Vec::is_empty) {
            let all = Moment::ALL.map(Moment::name).join(", ");
            let accepted = format!("at least one of {all}");
            return Err(Error::invalid("outputs.moments", "[]", accepted));
        }
        self.neglected.map_or(Ok(()), |it| share("neglected", it))
    }

    /// Its seconds, from now on, and bytes.
    pub(super) fn limits(&self) -> Limits {
        Limits::from_now(self.max_seconds, self.max_memory)
    }
}

/// What a result was computed with.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Method {
    /// Name, scheme in space and in time.
    pub name: String,
    /// Why it was chosen.
    pub reason: String,
    /// Cells in q and v.
    pub cells: [usize; 2],
    /// Cells that hold unknowns.
    pub unknowns: usize,
    /// q_lo, q_hi, v_lo, v_hi.
    pub domain: [f64; 4],
    /// Longest step taken; 0 where there is no time.
    pub step: f64,
    /// Steps taken, of all runs together.
    pub steps: u64,
    /// Probability left outside the truncated domain by the stationary law or by the initial condition.
    #[serde(skip)]
    pub neglected: f64,
}
