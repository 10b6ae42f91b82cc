//! What a machine takes for a piece of work, and the limits a scene sets.

use crate::error::{Error, Result};
use crate::format::{bytes as shown, num, seconds as shown_seconds};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Every timing of a machine that a decision or a forecast hangs on, in seconds of one core (measured:
/// benches/summary.rs, `lab precision`). Forecasts of transients are within a factor of three for four in five.
pub(crate) mod timing {
    /// A stage of the explicit scheme, a cell, order 8.
    pub(crate) const STAGE: f64 = 8e-9;
    /// A step of IMEX, a cell, in stages.
    pub(crate) const IMEX_STAGES: f64 = 18.0;
    /// A step of Radau IIA and a factorisation, a cell, in stages.
    pub(crate) const RADAU_STAGES: f64 = 250.0;
    /// A factorisation for Radau IIA, a cell, in stages.
    pub(crate) const RADAU_LU_STAGES: f64 = 800.0;
    /// Sparse LU of a five-point stencil, a cell; of a wide stencil or complex numbers [`WIDE`] times that.
    pub(crate) const LU: f64 = 2e-6;
    /// A solve with the LU of a five-point stencil, a cell.
    pub(crate) const SOLVE: f64 = 0.1e-6;
    /// An LU or a solve with a wide stencil over one with a stencil of five points.
    pub(crate) const WIDE: f64 = 10.0;
    /// To trace a flow map and find its stencils, a cell: the motion of a law that is built in.
    pub(crate) const MAP: f64 = 0.04e-6;
    /// The same, of any other law.
    pub(crate) const TRACED_MAP: f64 = 0.7e-6;
    /// What a drive, or friction that is not constant, adds.
    pub(crate) const SCALED_MAP: f64 = 0.4e-6;
    /// A pass of the exact motion and the exact noise, a cell.
    pub(crate) const PASS: f64 = 20e-9;
    /// An entry of a matrix of friction, noise and drive along v.
    pub(crate) const FORCED_ENTRY: f64 = 20e-9;
    /// What a transient takes however small its meshes are.
    pub(crate) const TRANSIENT: f64 = 2e-3;
    /// The numbers of an output time, a cell.
    pub(crate) const LOOK: f64 = 60e-9;
    /// A step of a moving local grid, a node.
    pub(crate) const FRAME_NODE: f64 = 0.45e-6;
    /// What it takes beside, in steps.
    pub(crate) const FRAME_STEPS: f64 = 12.0;
    /// A step of the backward equation, a quadrature point.
    pub(crate) const ABSORBED_POINT: f64 = 11e-9;
    /// The same, a node.
    pub(crate) const ABSORBED_NODE: f64 = 6e-9;
    /// A node in a step of the backward equation under a drive, its kernel made for it.
    pub(crate) const DRIVEN_NODE: f64 = 0.2e-6;
    /// To follow the motions of a quadrature point of the backward equation: its own, and those of the start on its row.
    pub(crate) const ABSORBED_MAP: f64 = 2.2e-6;
    /// The same, of a law that is not built in, a piece of its force.
    pub(crate) const TRACED_ABSORBED_MAP: f64 = 3.5e-6;
    /// An operation of a dense complex matrix product.
    pub(crate) const OPERATION: f64 = 1.0 / 2e10;
    /// The same of a factorisation by elements, or of a product of few rows, in those.
    pub(crate) const NESTED: f64 = 5.0;
    /// The model of a spectrum at one resolution, beside the products of its states.
    pub(crate) const MODEL: f64 = 0.015;
    /// The closed form of the stationary law.
    pub(crate) const CLOSED_FORM: f64 = 2e-4;
    /// That of the law of the flights, which has a quadrature in each of its points.
    pub(crate) const FLIGHTS: f64 = 0.12;
    /// A step of a path: Euler and Maruyama, BAOAB, central differences.
    pub(crate) const KICK: f64 = 6e-9;
    /// The same: exponential Heun.
    pub(crate) const HEUN: f64 = 20e-9;
    /// The same: splitting (4, 2).
    pub(crate) const SPLITTING_4_2: f64 = 25e-9;
    /// The same: splitting (6, 2).
    pub(crate) const SPLITTING_6_2: f64 = 40e-9;
    /// What a law that is not built in adds to a step, in steps.
    pub(crate) const TRACED_STEP: f64 = 5.0;
    /// What friction that is not constant adds to it.
    pub(crate) const LOCAL_STEP: f64 = 1.0;
    /// A path at an output time.
    pub(crate) const SAMPLE: f64 = 20e-9;
    /// A cosine of the noise, a step of a path.
    pub(crate) const COSINE: f64 = 1.3e-9;
    /// Cells below which a mesh is not shared among threads.
    pub(crate) const SHARED: usize = 7000;
    /// n threads are as fast as n^GAIN: two came to 1.75.
    pub(crate) const GAIN: f64 = 0.8;
}

/// What a computation will take, as far as can be said without doing it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Cost {
    /// Cells in q and v; None without a mesh.
    pub cells: Option<[usize; 2]>,
    /// Steps of the fine run, or of each path or record.
    pub steps: u64,
    /// Bytes.
    pub memory: u64,
    /// Seconds on this machine, roughly.
    pub seconds: f64,
}

/// A flag that ends a run from any thread: who holds a clone of it raises it, and the run ends where it would look at
/// the clock next, with [`Error::Stopped`].
#[derive(Debug, Clone, Default)]
pub struct StopFlag(Arc<AtomicBool>);

impl StopFlag {
    /// Ends the run that looks at this flag.
    pub fn raise(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// The flag itself, for what raises it from a signal.
    #[cfg(feature = "cli")]
    pub(crate) fn shared(&self) -> Arc<AtomicBool> {
        self.0.clone()
    }

    /// Whether it was raised.
    pub fn raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// The limits of a scene, when its work began, and whether somebody wants it to end.
#[derive(Debug, Clone)]
pub(crate) struct Limits {
    began: Instant,
    stop: StopFlag,
    /// Seconds allowed.
    pub(crate) seconds: f64,
    /// What the scene allows, of which these may be a share.
    told: f64,
    /// Bytes allowed.
    pub(crate) memory: u64,
}

impl Limits {
    /// So many seconds from now on, and bytes.
    pub(crate) fn from_now(seconds: f64, memory: u64) -> Self {
        Self {
            began: Instant::now(),
            stop: StopFlag::default(),
            seconds,
            told: seconds,
            memory,
        }
    }

    /// The same as a share of so many seconds, which errors name, and over as soon as `stop` is raised.
    pub(crate) fn share_of(self, told: f64, stop: StopFlag) -> Self {
        Self { stop, told, ..self }
    }

    /// The same with a part of the time that is left.
    pub(crate) fn part(&self, share: f64) -> Self {
        let seconds = self.spent() + share * (self.seconds - self.spent());
        Self {
            seconds,
            ..self.clone()
        }
    }

    /// Seconds since the work began.
    pub(crate) fn spent(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// Seconds left; negative beyond the limit, and where somebody wants the end.
    pub(crate) fn left(&self) -> f64 {
        if self.stop.raised() {
            return f64::NEG_INFINITY;
        }
        self.seconds - self.spent()
    }

    /// The error of a computation that is out of time: `what` says how far it came.
    pub(crate) fn out_of_time(&self, what: String) -> Error {
        if self.stop.raised() {
            return Error::Stopped { what };
        }
        Error::limit("accuracy.max_seconds", num(self.told), what)
    }

    /// Refuses a piece of work of so many seconds that nothing can stop half way.
    pub(crate) fn room_for(&self, seconds: f64, what: impl FnOnce() -> String) -> Result<()> {
        let left = self.left();
        if seconds <= left {
            return Ok(());
        }
        let (what, time) = (what(), shown_seconds(seconds));
        Err(self.out_of_time(if left > 0.0 {
            let left = shown_seconds(left);
            format!("{what} would take {time} at one go, and {left} are left")
        } else {
            format!("{what} had not begun")
        }))
    }

    /// Refuses a computation that would need more bytes than allowed.
    pub(crate) fn holds(&self, name: &str, bytes: u64) -> Result<()> {
        if bytes <= self.memory {
            return Ok(());
        }
        let (limit, need) = (shown(self.memory), shown(bytes));
        let what = format!("{name} would need {need}");
        Err(Error::limit("accuracy.max_memory", limit, what))
    }

    /// Stops a computation that is out of time.
    pub(crate) fn in_time(&self, what: impl FnOnce() -> String) -> Result<()> {
        if self.left() < 0.0 {
            return Err(self.out_of_time(what()));
        }
        Ok(())
    }

    /// The same as a question that long work asks now and then.
    pub(crate) fn late(
        &self,
        name: &'static str,
    ) -> impl Fn() -> Result<()> + Clone + Send + Sync + use<> {
        let limits = self.clone();
        move || limits.in_time(|| format!("{name} had not ended"))
    }
}
