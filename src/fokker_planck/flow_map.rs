//! Transport by the exact flow, noise by the exact Ornstein-Uhlenbeck step: the fastest accurate
//! transient of a weakly damped oscillator.
//!
//! The ratio g = p/p_s is carried unchanged along the undamped motion, g <- g o Phi_{-tau}, and averaged
//! along v by friction with noise, a Gaussian average in closed form. Both keep g = 1. Between them a
//! near-integrable splitting (McLachlan, BIT 35, 258, 1995; Laskar and Robutel, Celest. Mech. Dyn.
//! Astron. 80, 39, 2001): Gauss quadrature of the noise along the motion, error O(zeta tau^n + zeta^2
//! tau^2), so a step spans a good part of a period. There is no bound on the step from the mesh. The second
//! term only runs the motion at a wrong rate: it is given the right one (splitting.rs), and of zeta^2 tau^2
//! remains zeta^2 tau^4, zeta^2 tau^3 from the ends of an interval of even steps.
//!
//! Seen from the moving point, noise adds up along the orbit; the splittings of Gauss type are a
//! composite rule for that integral. The even one is the trapezoidal rule, one pass of the motion a
//! step, whose only error of note comes from the ends of the interval and is corrected there.
//!
//! In space g is a spline of degree 7 through its values at the cell centres. One pass over the mesh
//! carries g along the motion; the matrix that then averages it along v also turns the result into the
//! spline coefficients of the next pass.
//!
//! - Edge: departure points outside the domain take the value of g at the nearest centre, as does the
//!   average along v; g = 1 stays. Orbits that do not close inside the domain hold no unknowns: along each
//!   row p continues beyond them as the stationary law under the weakest noise falls off, g as a constant where it is taken against
//!   that law. For a contact without a stationary law, where g is the density p itself, nothing comes in from outside and what
//!   leaves is lost.
//! - Mass: interpolation keeps it to its own error. A constant is added to g that keeps it exactly;
//!   constants pass unchanged through every part of a step, so one addition at the end is the same as
//!   one in every step. The raw defect is reported: a free measure of the interpolation error.
//! - Loss of contact: g bends there, its second derivative along q by a jump of the stiffness (bilinear) or
//!   without bound (Hertz), and where orbits graze it no expansion holds. Each pass leaves an error of order 3
//!   there, which adds up over the passes: fewer, longer steps are not only cheaper but more accurate.
//! - Short steps: where a pass moves most points by less than a fifth of a cell the shortest waves along
//!   q are not damped, and hundreds of such passes let them grow ([`FlowMap::shortest_step`]).
//! - Sign: no linear scheme of this order is positive. The negative mass is reported.

mod interval;
mod noise_free;
mod pass;
mod rows;
mod schedule;
mod settings;
mod splitting;
mod tracing;

pub use settings::Settings;
pub(in crate::fokker_planck) use settings::longest_step;
pub use splitting::Splitting;

use super::density::Density;
use super::flux::{Drift, Measure, Weights};
use super::forcing::Forcing;
use super::interpolation::{Filter, MARGIN, PANEL, Spline};
use super::mesh::Mesh;
use crate::error::{Deadline, Error, Result, positive};
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use interval::{Leg, Noise, Schedule};
use pass::{Blocks, Buffers, Map};
use rows::{Rates, Rows};
use std::ops::Range;
use std::sync::Arc;

/// What propagation did so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Progress {
    /// Steps taken.
    pub steps: usize,
    /// Passes of the undamped motion over the mesh.
    pub passes: usize,
    /// Change of the mass by interpolation, before its correction: the sum of the absolute values over
    /// the intervals. For a contact without a stationary law, the mass that left the domain.
    pub defect: f64,
    /// Largest part that friction lacked of itself at the end of an interval, on the average over the density, where cells are
    /// too coarse for its strength.
    pub lacking: f64,
}

/// The propagator of an oscillator on a mesh.
#[derive(Debug, Clone)]
pub struct FlowMap {
    oscillator: Oscillator,
    rates: Rates,
    /// Whether g is taken against a stationary law, or against area.
    stationary: bool,
    /// 1/T of the law that g is taken against; 0 for area.
    beta: f64,
    /// What there is beside stationary noise.
    forcing: Option<Arc<Forcing>>,
    /// The time.
    now: f64,
    mesh: Mesh,
    weights: Weights,
    settings: Settings,
    spline: Spline,
    rows: Rows,
    /// Values to coefficients along v, without noise.
    open: Blocks,
    /// Flow maps by what they do.
    maps: Vec<(Leg, Map)>,
    /// Matrices by what they do, each for some rows.
    matrices: Vec<(Noise, Blocks)>,
    schedule: Schedule,
    progress: Progress,
    buffers: Buffers,
}

/// Widest cell in thermal deviations: the midpoint sum of a Gaussian is then off by
/// 2 exp(-2 pi^2/2^2) = 1 %, and no density of interest is narrower.
const WIDEST: f64 = 2.0;
/// Cells from which on the work of a stage is worth sharing between threads.
const SHARED: usize = 6000;

impl FlowMap {
    /// The propagator of `oscillator` on `mesh`.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a step that is not positive; [`Error::Mesh`] for fewer than eight cells in a
    /// direction, or a domain where the stationary law underflows.
    pub fn new(oscillator: &Oscillator, mesh: &Mesh, settings: Settings) -> Result<Self> {
        Self::forced(oscillator, mesh, settings, None)
    }

    /// The propagator under a drive or an envelope too, from time 0 on; g is then taken against the law of
    /// [`Forcing::reference`].
    pub(super) fn forced(
        oscillator: &Oscillator,
        mesh: &Mesh,
        settings: Settings,
        forcing: Option<Arc<Forcing>>,
    ) -> Result<Self> {
        positive("method.step", settings.step)?;
        let [nq, nv] = mesh.cells();
        if nq.min(nv) < 8 {
            let what = format!("{nq} x {nv} cells, and the stencil needs 8 in each direction");
            return Err(Error::mesh(what, "more cells"));
        }
        let reference = forcing.as_ref().map_or(oscillator, |it| it.reference());
        let measure = Measure::of(reference)?;
        let damping = oscillator.damping();
        damping.depends_on_displacement("the flow map")?;
        let width = mesh.v.at(0.5 * nv as f64).1 / oscillator.temperature().sqrt();
        if matches!(measure, Measure::Gibbs(_)) && width > WIDEST {
            let what = format!("a cell of the {nv} along v is {width:.1} thermal deviations wide");
            let help = format!("about {:.0} cells along v", (nv as f64 * width).ceil());
            return Err(Error::mesh(what, help));
        }
        let weights = Weights::new(&measure, mesh, reference.temperature(), Drift::Order8)?;
        let weights = weights.without_boundary();
        let stationary = matches!(measure, Measure::Gibbs(_));
        let beta = if stationary {
            1.0 / reference.temperature()
        } else {
            0.0
        };
        let rows = Rows::of(oscillator, mesh, stationary);
        let stride = (nv + 2 * MARGIN).next_multiple_of(PANEL);
        Ok(Self {
            oscillator: oscillator.clone(),
            rates: Rates::of(oscillator, mesh),
            stationary,
            beta,
            forcing,
            now: 0.0,
            mesh: mesh.clone(),
            weights,
            settings,
            spline: Spline::new(),
            rows,
            open: Vec::new(),
            maps: Vec::new(),
            matrices: Vec::new(),
            schedule: Schedule::default(),
            progress: Progress::default(),
            buffers: Buffers {
                filter: Filter::new(nq),
                values: vec![0.0; nq * nv],
                panels: vec![0.0; nq * stride],
                coefficients: vec![0.0; (nq + 2 * MARGIN) * stride],
                stride,
            },
        })
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The measure of the cells that g is taken against.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// The cells of each q-column on orbits that close inside the domain: those that hold unknowns.
    pub fn columns(&self) -> &[Range<usize>] {
        &self.rows.active
    }

    pub(crate) fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Shortest step that lets no grid noise grow: a point at the thermal speed crosses a quarter of a cell.
    /// Measured at zeta = 1e-3 and 0.005 to t = 150, on 60 x 44 and 90 x 66 cells: waves as short as the mesh
    /// stay as they are from 0.26 cells on, grow by a third at 0.17, and thirtyfold at 0.1.
    pub fn shortest_step(oscillator: &Oscillator, mesh: &Mesh) -> f64 {
        if !oscillator.contact().is_confining() {
            return 0.0;
        }
        0.25 * mesh.q.usual_width(0.0) / oscillator.temperature().sqrt()
    }

    /// Whether there is anything beside stationary noise.
    pub(super) fn is_forced(&self) -> bool {
        self.forcing.is_some()
    }

    /// Sets the time, which an excitation goes by.
    pub(super) fn set_time(&mut self, t: f64) {
        self.now = t;
    }

    /// The time.
    pub(super) fn time(&self) -> f64 {
        self.now
    }

    /// Steps, mass defect and negative mass so far.
    pub fn progress(&self) -> Progress {
        self.progress
    }

    /// A start at the cell centres.
    ///
    /// # Errors
    /// As [`Density::start`].
    pub fn start(&self, initial: &Initial) -> Result<Density> {
        Density::everywhere(&self.mesh, &self.weights, initial)
    }

    /// g = P/w of a density on this mesh, row-major.
    pub fn ratio(&self, density: &Density) -> Vec<f64> {
        let mut g = density.cells().to_vec();
        self.weights.each(&mut g, |g, w| *g /= w);
        g
    }

    /// Propagates a density on this mesh over `duration`, in equal steps of at most [`Settings::step`].
    /// Flow maps and matrices are built for the first interval that needs a step length, and kept.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a duration that is negative or not finite, or a density on another mesh.
    pub fn advance(&mut self, density: &mut Density, duration: f64) -> Result<()> {
        self.advance_watched(density, duration, &|| Ok(()))
    }

    /// The same, ended by `late`, which is asked before each group of rows that is traced and before each pass.
    pub(super) fn advance_watched(
        &mut self,
        density: &mut Density,
        duration: f64,
        late: &Deadline,
    ) -> Result<()> {
        if !(duration.is_finite() && duration >= 0.0) {
            let accepted = "a finite duration, not negative";
            return Err(Error::invalid("outputs.moments_at", duration, accepted));
        }
        if density.cells().len() != self.mesh.len() {
            let [nq, nv] = self.mesh.cells();
            let given = format!("{} cells", density.cells().len());
            let accepted = format!("one on {nq} x {nv} cells");
            return Err(Error::invalid("the density", given, accepted));
        }
        // Over such a time noise spreads by less than a rounding of v, and motion by less than one of q.
        if duration < 1e-20 {
            return Ok(());
        }
        self.prepare(duration, late)?;
        let excess = self.excess([self.now, self.now + duration]);
        self.rows.fall(&self.mesh, excess);
        self.buffers.values.copy_from_slice(density.cells());
        self.weights.each(&mut self.buffers.values, |g, w| *g /= w);
        let before = self.mass();
        if self.shared() {
            // Inside the pool for good: its queues are then the only ones used.
            rayon::scope(|_| self.run(true, late))?;
        } else {
            self.run(false, late)?;
        }
        self.balance(before);
        self.now += duration;
        density.cells_mut().copy_from_slice(&self.buffers.values);
        self.weights.each(density.cells_mut(), |g, w| *g *= w);
        let lacking = self.lacking(density.cells());
        self.progress.lacking = self.progress.lacking.max(lacking);
        Ok(())
    }

    /// By how much 1/T of p is more than that of the law which g is taken against: at the edge p falls as under the weakest noise
    /// between two times.
    fn excess(&self, between: [f64; 2]) -> f64 {
        // Where flights without friction make p fall more slowly than under noise alone, g stays.
        let follows = |it: &Arc<Forcing>| it.throws() && it.tail().is_some();
        if !self.stationary || self.forcing.as_ref().is_some_and(follows) {
            return 0.0;
        }
        let alone = || self.oscillator.temperature();
        let coldest = self
            .forcing
            .as_ref()
            .map_or_else(alone, |it| it.coldest(between));
        (1.0 / coldest.max(f64::MIN_POSITIVE) - self.beta).max(0.0)
    }

    /// Whether threads share the work of a stage.
    fn shared(&self) -> bool {
        self.mesh.len() >= SHARED && rayon::current_num_threads() > 1
    }

    /// The scheduled interval; from values to values.
    fn run(&mut self, share: bool, late: &Deadline) -> Result<()> {
        let nv = self.mesh.v.len();
        let (buffers, schedule) = (&mut self.buffers, &self.schedule);
        let rows = &self.rows;
        buffers.average(nv, &self.open, share);
        for &(map, matrix) in &schedule.parts {
            late()?;
            buffers.carry(nv, &self.maps[map].1, rows, share);
            buffers.average(nv, &self.matrices[matrix].1, share);
        }
        buffers.carry(nv, &self.maps[schedule.last].1, rows, share);
        self.progress.steps += schedule.steps;
        self.progress.passes += schedule.parts.len() + 1;
        Ok(())
    }

    /// Sum of w f(g).
    fn sum(&self, f: impl Fn(f64) -> f64) -> f64 {
        let nv = self.mesh.v.len();
        let rows = self.buffers.values.chunks_exact(nv).zip(&self.weights.q);
        let row =
            |g: &[f64]| -> f64 { g.iter().zip(&self.weights.v).map(|(g, w)| f(*g) * w).sum() };
        rows.map(|(g, wq)| wq * row(g)).sum()
    }

    fn mass(&self) -> f64 {
        self.sum(|g| g)
    }

    /// Restores the mass.
    fn balance(&mut self, before: f64) {
        let defect = self.mass() - before;
        self.progress.defect += defect.abs();
        if self.stationary {
            let constant = defect / self.sum(|_| 1.0);
            for g in &mut self.buffers.values {
                *g -= constant;
            }
        }
    }
}

#[cfg(test)]
#[path = "flow_map/flow_map_tests.rs"]
mod tests;
