//! The start-up phase of a run whose initial condition no mesh of the plane resolves: a local grid in its own frame,
//! until the density is wide enough to be handed over.

use super::output::Output;
use super::propagator::Propagator;
use super::recipe::{FirstGrid, Rung};
use crate::error::{Error, Result};
use crate::fokker_planck::budget::timing;
use crate::fokker_planck::convergence::{UNKNOWN, left};
use crate::fokker_planck::density::{Density, Snapshot, entropy_apart};
use crate::fokker_planck::domain::Domain;
use crate::fokker_planck::layout::{self, Cells};
use crate::fokker_planck::mesh::{Axis, Mesh};
use crate::fokker_planck::moving_frame::local_grid::{Fineness, LocalGrid};
use crate::fokker_planck::policy::{
    EARLY, GIVEN_CELLS, INITIAL_CELLS, LOCAL_BORDER, LOCAL_CELL, LOCAL_DEFECT, LOCAL_REACH,
    LOCAL_STEP, LOCAL_STEP_DAMPING, LOCAL_STEP_FRICTION, REFINED,
};
use crate::fokker_planck::solved::{Column, Law, Settled};
use crate::gaussian::maxwell;
use crate::initial::Initial;
use crate::matrix;
use crate::oscillator::Oscillator;
use ndarray::{Array1, Array2};
use std::cell::RefCell;

/// The start-up phase: a local grid, before a mesh takes over.
pub(super) struct StartUp<'a> {
    oscillator: &'a Oscillator,
    /// The stationary law, where it is not exp(-H/T)/Z.
    law: Option<&'a Settled>,
    rung: &'a Rung,
    grid: LocalGrid,
    /// The cells there would be without regard to the initial condition; None for a law that leaves every domain,
    /// which stays in the frame for good.
    goal: Option<Mesh>,
    /// Widths of cells below which no mesh is refined for the initial condition alone.
    finest: [f64; 2],
}

/// A solved law at points that come displacement by displacement.
struct Columns<'a> {
    law: &'a Law,
    column: RefCell<Column<'a>>,
}

impl<'a> Columns<'a> {
    fn of(law: &'a Law) -> Self {
        let column = RefCell::new(law.column(f64::NAN));
        Self { law, column }
    }

    fn density(&self, q: f64, v: f64) -> f64 {
        let mut column = self.column.borrow_mut();
        if column.q() != q {
            *column = self.law.column(q);
        }
        column.density(v)
    }
}

/// What rounding leaves of a local grid's moments, the motion being known to 1e-12: 3e-10 of themselves for
/// the linear law, whose covariance is known.
const ROUNDING: f64 = 1e-9;

/// Cells, reach and step of a local grid for a tolerance. Measured for the Hertz law from rest and from
/// displaced points, zeta = 0.005: cells of 0.4 deviations and steps of 0.6 give moments to 1e-6. Under strong
/// damping [`LOCAL_STEP_DAMPING`] bounds the step. Steps and zeta are in units of the fastest small vibrations.
fn fineness(oscillator: &Oscillator, rung: &Rung) -> Fineness {
    let tolerance = rung.tolerance;
    let fastest = oscillator.contact().fastest();
    let zeta = oscillator.zeta() / fastest;
    let relative = tolerance / 1e-3;
    // What a step leaves is known from the differences of rungs alone: each has steps of its own. Output times may cut them
    // shorter, which steps of order 2 show: two more in every interval from rung to rung.
    let (weak, beside, more) = if oscillator.is_viscous() {
        (LOCAL_STEP.get() * relative.powf(1.0 / 6.0), 1.5, 0)
    } else {
        let more = (2.0 * Rung::of_tolerance(tolerance)).max(0.0).ceil() as u64;
        (LOCAL_STEP_FRICTION.get() * relative.cbrt(), 1.0, more)
    };
    let strong = (LOCAL_STEP_DAMPING.get() * tolerance / zeta.powi(3)).powf(0.25);
    // A drive asks no more of these steps than of those on a mesh, which are of lower order.
    let driven = match rung.acting() {
        Some(_) => rung.flow_map().step,
        None => f64::INFINITY,
    };
    Fineness {
        cell: LOCAL_CELL.get() * relative.powf(0.125).clamp(0.4, 1.6),
        reach: LOCAL_REACH.get() + (-2.0 * rung.neglected.ln()).sqrt(),
        border: LOCAL_BORDER.get() * tolerance,
        step: (weak.min(strong).min(1.0) / fastest).min(driven),
        beside,
        more,
    }
}

/// What a start-up phase will take.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bill {
    /// Seconds on one core.
    pub(super) seconds: f64,
    /// Steps.
    pub(super) steps: f64,
    /// When a mesh takes over.
    pub(super) until: f64,
    /// Cells along either side, where no mesh takes over.
    pub(super) alone: Option<usize>,
}

/// What the start-up phase of a run will take on one core, if it has one. The density is as wide as a mesh needs once
/// the noise has added that variance.
pub(super) fn cost(
    rung: &Rung,
    oscillator: &Oscillator,
    initial: &Initial,
    until: f64,
) -> Option<Bill> {
    if !rung.starts_on_moving_grid() {
        return None;
    }
    let fineness = fineness(oscillator, rung);
    let widths = layout::deviations(oscillator);
    let wide = INITIAL_CELLS.get() * widths[0].max(widths[1]) / REFINED.get();
    let left = 1.0 - (wide * wide / oscillator.temperature()).min(1.0);
    let mut wide = -left.ln() / (2.0 * oscillator.zeta());
    if let (FirstGrid::Falling(most), Initial::Gaussian { mean, deviation }) =
        (rung.first_grid, *initial)
    {
        // Under strong friction velocities fall at once, and displacements at the rate 1/(2 zeta).
        let at_rest = [deviation[0], oscillator.temperature().sqrt()];
        let beyond = rung.amplitude(oscillator, [mean[0], 0.0], at_rest) / most;
        wide = wide.max(2.0 * oscillator.zeta() * beyond.max(1.1).ln());
    }
    let side = 2.0 * (fineness.reach / fineness.cell).ceil();
    let alone = rung.first_grid == FirstGrid::MovingForGood || wide >= until;
    let time = if alone { until } else { wide };
    let steps = time / fineness.step;
    Some(Bill {
        seconds: timing::FRAME_NODE * side * side * (steps + timing::FRAME_STEPS),
        steps,
        until: time,
        alone: alone.then_some(side as usize),
    })
}

impl<'a> StartUp<'a> {
    /// The start-up phase of a run, if it has one.
    pub(super) fn of(
        rung: &'a Rung,
        oscillator: &'a Oscillator,
        initial: &Initial,
        law: Option<&'a Settled>,
    ) -> Result<Option<Self>> {
        if !rung.starts_on_moving_grid() {
            return Ok(None);
        }
        let later = (rung.tolerance / 1e-3).cbrt();
        let early = EARLY.get() * later / (1.0 + oscillator.zeta());
        let fineness = fineness(oscillator, rung);
        let forced = (oscillator, rung.acting().cloned());
        let grid = LocalGrid::new(forced, initial, early, fineness)?;
        let goal = (rung.first_grid != FirstGrid::MovingForGood)
            .then(|| rung.mesh(oscillator))
            .transpose()?;
        let finest = match rung.layout.cells {
            Cells::Widths(widths) => widths.map(|width| width / REFINED.get()),
            Cells::Given(_) => [0.0; 2],
        };
        Ok(Some(Self {
            oscillator,
            law,
            rung,
            grid,
            goal,
            finest,
        }))
    }

    /// The local grid.
    pub(super) fn grid(&self) -> &LocalGrid {
        &self.grid
    }

    /// Probability that the local grid has lost so far; a point has lost nothing.
    pub(super) fn loss(&self) -> f64 {
        if self.grid.is_point() {
            0.0
        } else {
            ROUNDING + self.grid.defect()
        }
    }

    /// Comes to time t, or to where a mesh takes over, and says whether it came to t. `watch` is told the
    /// time.
    pub(super) fn advance(
        &mut self,
        t: f64,
        watch: &mut dyn FnMut(f64) -> Result<()>,
    ) -> Result<bool> {
        let left = t - self.grid.time();
        if left <= 0.0 {
            return Ok(true);
        }
        self.grid.leave_point(left);
        if t - self.grid.time() <= 0.0 {
            return Ok(true);
        }
        for stop in self.rung.stops(self.grid.time(), t) {
            let left = stop - self.grid.time();
            let steps = self.grid.divide(left);
            for _ in 0..steps {
                if self.is_wide() {
                    return Ok(false);
                }
                self.grid.advance(left / steps as f64);
                if !self.grid.defect().is_finite() {
                    let what = format!(
                        "by t = {:.3e} doubles do not tell the points of the density apart",
                        self.grid.time()
                    );
                    return Err(Error::Unresolved { what });
                }
                watch(self.grid.time())?;
            }
            self.grid.arrive(stop);
        }
        Ok(true)
    }

    /// Whether a mesh can take over, or has to.
    fn is_wide(&self) -> bool {
        let Some(mesh) = &self.goal else {
            return false;
        };
        let enough = INITIAL_CELLS.get() * self.rung.per_deviation;
        let (enough, widths) = if self.rung.layout.is_given() {
            // The scene's own cells, the widest near the density: no finer rung tells what too few of them do.
            (enough.max(GIVEN_CELLS.get()), self.widest(mesh))
        } else {
            (enough, self.finest)
        };
        let pairs = self.narrowest().into_iter().zip(widths);
        let wide = pairs
            .into_iter()
            .all(|(deviation, width)| deviation >= enough * width);
        if let FirstGrid::Falling(most) = self.rung.first_grid {
            return self.is_unresolved() || (wide && self.amplitude() <= most);
        }
        wide || self.is_unresolved()
    }

    /// The amplitude of the density over that of the edge of the domain that the stationary law needs.
    fn amplitude(&self) -> f64 {
        let frame = self.grid.frame();
        self.rung
            .amplitude(self.oscillator, frame.mean, frame.deviation())
    }

    /// Whether the local grid no longer resolves the density: it does not fit its frame.
    fn is_unresolved(&self) -> bool {
        self.grid.defect() > LOCAL_DEFECT.get() * self.rung.tolerance
    }

    /// How narrow the density is in q and in v, at this phase of the motion or a later one: where the
    /// motion turns it before friction stops it, what is narrow in one is soon narrow in the other.
    fn narrowest(&self) -> [f64; 2] {
        let frame = self.grid.frame();
        if self.oscillator.zeta() < 1.0 {
            [frame.narrowest(); 2]
        } else {
            frame.conditional()
        }
    }

    /// The widest cells of a mesh within three deviations.
    fn widest(&self, mesh: &Mesh) -> [f64; 2] {
        let frame = self.grid.frame();
        let near = |axis: &Axis, mean: f64, deviation: f64| {
            let width = |k: f64| axis.at(axis.locate(mean + k * deviation)).1;
            [-3.0, 0.0, 3.0].map(width).into_iter().fold(0.0, f64::max)
        };
        let [q, v] = frame.deviation();
        [
            near(&mesh.q, frame.mean[0], q),
            near(&mesh.v, frame.mean[1], v),
        ]
    }

    /// The mesh that takes over.
    ///
    /// # Errors
    /// [`Error::Mesh`] if the cells of the scene are too wide for a density that does not stay near a Gaussian.
    pub(super) fn mesh(&self) -> Result<Mesh> {
        let Some(mesh) = &self.goal else {
            return self.own_mesh();
        };
        let narrowest = self.narrowest();
        if self.rung.layout.is_given() {
            let widest = self.widest(mesh);
            for ((deviation, width), name) in narrowest.iter().zip(widest).zip(["q", "v"]) {
                if *deviation < Density::NARROWEST * width {
                    let (t, cells) = (self.grid.time(), deviation / width);
                    let what = format!(
                        "at t = {t:.2} the density is {cells:.2} cells wide in {name} and no longer \
                         fits a moving frame; {} cells are needed",
                        Density::NARROWEST
                    );
                    let help = "more method.cells, none at all, or a wider initial.deviation";
                    return Err(Error::mesh(what, help));
                }
            }
            return Ok(mesh.clone());
        }
        let start =
            narrowest.map(|deviation| deviation / (INITIAL_CELLS.get() * self.rung.per_deviation));
        let mut layout = self.rung.layout.narrowed(start);
        if let FirstGrid::Falling(most) = self.rung.first_grid {
            // Resolution was lost before it was in.
            let more = (self.amplitude() / most).max(1.0);
            layout.domain = layout.domain.enlarged(self.oscillator, more);
        }
        layout.mesh(self.oscillator, 1.0)
    }

    /// The local grid's own cells on the axes of q and v, for a run that never leaves it.
    pub(super) fn own_mesh(&self) -> Result<Mesh> {
        let frame = self.grid.frame();
        let reach = self.grid.reach();
        let axis = |mean: f64, deviation: f64| {
            let [low, high] = [-reach, reach].map(|reach| mean + reach * deviation);
            Axis::uniform(low, high, self.grid.cells())
        };
        // A point, which has none, lies within any.
        let [q, v] = frame.deviation().map(|it| if it > 0.0 { it } else { 1.0 });
        Ok(Mesh {
            q: axis(frame.mean[0], q)?,
            v: axis(frame.mean[1], v)?,
        })
    }

    /// The truncated domain, where there is one.
    pub(super) fn domain(&self) -> Domain {
        match self.goal {
            Some(_) => self.rung.layout.domain,
            None => Domain {
                q: [0.0; 2],
                v: [0.0; 2],
                neglected: self.rung.neglected,
            },
        }
    }

    /// The density on the mesh of a propagator, scaled to probability 1, with what that changed.
    pub(super) fn density(&self, propagator: &Propagator) -> (Density, f64) {
        let mut density = propagator.sampled(&|points| self.grid.density(points));
        let mass = density.normalise();
        (density, (mass - 1.0).abs())
    }

    /// What it says at time t.
    pub(super) fn look(&self, t: f64) -> Output {
        let grid = &self.grid;
        let law = self.oscillator.displacement_law().ok();
        let temperature = self.oscillator.temperature();
        let solved = self.law.map(|it| [&it.law, &it.coarser].map(Columns::of));
        let stationary = |[q, v]: [f64; 2]| {
            if let Some([solved, _]) = &solved {
                return solved.density(q, v);
            }
            law.as_ref()
                .map_or(0.0, |law| law.density(q) * maxwell(v, temperature))
        };
        let output = Output {
            t,
            moments: grid.moments(),
            mass: 1.0,
            lost: self.loss(),
            framed: true,
            ..Output::default()
        };
        if grid.is_point() {
            return Output {
                entropy: f64::INFINITY,
                distance: 2.0,
                ..output
            };
        }
        Output {
            lowest: grid.lowest(),
            negative: grid.sum(|_, p| (-p).max(0.0)),
            entropy: grid.sum(|x, p| {
                let reference = stationary(x);
                if p > 0.0 && reference > 0.0 {
                    p * (p / reference).ln()
                } else {
                    0.0
                }
            }),
            distance: grid.distance_to(stationary),
            doubt: solved
                .as_ref()
                .zip(self.law)
                .map_or([0.0; 2], |(both, law)| {
                    let apart = grid.sum(|[q, v], p| {
                        entropy_apart(p, both.each_ref().map(|it| it.density(q, v)))
                    });
                    [left(UNKNOWN) * apart, law.error]
                }),
            ..output
        }
    }

    /// The density at time t on equal cells about its mean.
    ///
    /// # Errors
    /// [`Error::Invalid`] while it is a point.
    pub(super) fn snapshot(&self, t: f64) -> Result<Snapshot> {
        if self.grid.is_point() {
            let accepted = "times after 0: at rest all probability is in one point";
            return Err(Error::invalid("outputs.density_at", 0, accepted));
        }
        let mesh = self.own_mesh()?;
        let (q, v) = (mesh.q.centres(), mesh.v.centres());
        let points: Vec<[f64; 2]> = matrix::grid(q, v).collect();
        let p = self.grid.density(&points);
        Ok(Snapshot {
            t,
            q: Array1::from_vec(q.to_vec()),
            v: Array1::from_vec(v.to_vec()),
            p: Array2::from_shape_fn((q.len(), v.len()), |(i, j)| p[i * v.len() + j]),
        })
    }
}
