//! What carries a density forward in time: finite volumes with a scheme in time, or the flow map. Both on
//! the same meshes, weights and densities, so that one can be held against the other cell by cell.

use super::recipe::{Rung, Scheme};
use crate::error::Result;
use crate::fokker_planck::budget::DIRECT;
use crate::fokker_planck::density::Density;
use crate::fokker_planck::flow_map::{self, FlowMap};
use crate::fokker_planck::flux::{Drift, Weights};
use crate::fokker_planck::forcing::Forcing;
use crate::fokker_planck::generator::Generator;
use crate::fokker_planck::integrators::{
    Additive, BackwardEuler, Chebyshev, Integrator, Late, Radau, Solver, Step, TimeIntegration,
    never,
};
use crate::fokker_planck::mesh::{Axis, Mesh};
use crate::fokker_planck::policy::{SERIES_SHARE, SHARE};
use crate::fokker_planck::settings::TimeScheme;
use crate::gaussian::maxwell;
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use std::ops::Range;
use std::sync::Arc;

/// Advances a density in time.
pub(super) enum Propagator {
    /// Finite volumes, and the scheme in time that drives them.
    Volumes {
        /// The generator.
        generator: Box<Generator>,
        /// The scheme with its choice of steps.
        integration: TimeIntegration,
    },
    /// Exact transport and exact noise in turn.
    FlowMap {
        /// The flow map.
        map: Box<FlowMap>,
        /// See [`shortest`].
        shortest: f64,
        /// Where a density less than `shortest` older than the present one came from.
        anchor: Option<Anchor>,
        /// Asked within a chunk of steps.
        late: Late,
    },
}

/// A density from which the next outputs are propagated afresh, while they are close: each then has a few
/// passes behind it whatever their number, and no grid noise of short passes adds up.
pub(super) struct Anchor {
    density: Density,
    /// Time from it to the present.
    since: f64,
}

/// Steps of the flow map between two looks at the clock and at the stationary law: its ends cost two
/// passes an interval.
pub(super) const CHUNK: f64 = 64.0;

/// Cells times steps between two looks, where a mesh is so large that `CHUNK` steps take long: some
/// seconds.
const WORK: f64 = 3e7;

impl Propagator {
    /// The flow map of `oscillator` on `mesh`.
    pub(super) fn flow_map(
        oscillator: &Oscillator,
        mesh: &Mesh,
        settings: flow_map::Settings,
        forcing: Option<Arc<Forcing>>,
        late: Late,
    ) -> Result<Self> {
        let reference = forcing.as_ref().map_or(oscillator, |it| it.reference());
        let shortest = shortest(reference, mesh);
        Ok(Self::FlowMap {
            map: Box::new(FlowMap::forced(oscillator, mesh, settings, forcing)?),
            shortest,
            anchor: None,
            late,
        })
    }

    /// The measure that g is taken against.
    pub(super) fn weights(&self) -> &Weights {
        match self {
            Self::Volumes { generator, .. } => generator.weights(),
            Self::FlowMap { map, .. } => map.weights(),
        }
    }

    /// The cells of each q-column that hold unknowns.
    pub(super) fn columns(&self) -> &[Range<usize>] {
        match self {
            Self::Volumes { generator, .. } => generator.columns(),
            Self::FlowMap { map, .. } => map.columns(),
        }
    }

    /// Number of unknowns.
    pub(super) fn unknowns(&self) -> usize {
        self.columns().iter().map(Range::len).sum()
    }

    /// The density of a start.
    pub(super) fn start(&self, oscillator: &Oscillator, initial: &Initial) -> Result<Density> {
        match self {
            Self::Volumes { generator, .. } => Density::start(generator, initial),
            Self::FlowMap { map, .. } if map.is_forced() && *initial == Initial::Stationary => {
                self.stationary(oscillator, [0.0; 2])
            }
            Self::FlowMap { map, .. } => map.start(initial),
        }
    }

    /// The stationary law of the undriven oscillator, where densities are taken against another one, moved by so much.
    pub(super) fn stationary(&self, oscillator: &Oscillator, by: [f64; 2]) -> Result<Density> {
        let (law, temperature) = (oscillator.displacement_law()?, oscillator.temperature());
        let p = |[q, v]: &[f64; 2]| law.density(*q - by[0]) * maxwell(*v - by[1], temperature);
        let mut density = self.sampled(&|points| points.iter().map(p).collect());
        density.normalise();
        Ok(density)
    }

    /// Sets the time, which an excitation goes by.
    pub(super) fn set_time(&mut self, t: f64) {
        if let Self::FlowMap { map, anchor, .. } = self {
            map.set_time(t);
            *anchor = None;
        }
    }

    fn mesh(&self) -> &Mesh {
        match self {
            Self::Volumes { generator, .. } => generator.mesh(),
            Self::FlowMap { map, .. } => map.mesh(),
        }
    }

    /// The law that densities are taken against.
    pub(super) fn reference(&self) -> Density {
        Density::weighed(self.mesh(), self.columns(), self.weights())
    }

    /// The density with p(q, v) at the centres of cells that hold unknowns.
    pub(super) fn sampled(&self, p: &dyn Fn(&[[f64; 2]]) -> Vec<f64>) -> Density {
        Density::sampled(self.mesh(), self.columns(), p)
    }

    /// g = P/w, row-major.
    pub(super) fn ratio(&self, density: &Density) -> Vec<f64> {
        match self {
            Self::Volumes { generator, .. } => density.ratio(generator),
            Self::FlowMap { map, .. } => map.ratio(density),
        }
    }

    /// Carries the density forward by `duration`. `watch` is told how far it has come and what the
    /// density is; it ends the integration early by answering false.
    pub(super) fn advance(
        &mut self,
        density: &mut Density,
        duration: f64,
        watch: &mut dyn FnMut(f64, &Density) -> Result<bool>,
    ) -> Result<()> {
        match self {
            Self::Volumes { integration, .. } => {
                integration.advance(density, duration, watch).map(|_| ())
            }
            Self::FlowMap {
                map,
                shortest,
                anchor,
                late,
            } => {
                let (before, since) = match anchor.take() {
                    Some(Anchor { density, since }) => (density, since),
                    None => (density.clone(), 0.0),
                };
                let total = since + duration;
                density.cells_mut().copy_from_slice(before.cells());
                if since > 0.0 {
                    let now = map.time();
                    map.set_time(now - since);
                }
                let steps = (WORK / map.mesh().len() as f64).clamp(8.0, CHUNK);
                let chunks = (total / (steps * map.settings().step)).ceil().max(1.0);
                for k in 1..=chunks as u64 {
                    map.advance_watched(density, total / chunks, &**late)?;
                    if !watch(total * k as f64 / chunks - since, density)? {
                        break;
                    }
                }
                if total < *shortest {
                    *anchor = Some(Anchor {
                        density: before,
                        since: total,
                    });
                }
                Ok(())
            }
        }
    }

    /// Steps taken so far.
    pub(super) fn steps(&self) -> u64 {
        match self {
            Self::Volumes { integration, .. } => integration.steps(),
            Self::FlowMap { map, .. } => map.progress().steps as u64,
        }
    }

    /// The error that the steps so far have left, in the L1 norm, where their scheme estimates it.
    pub(super) fn step_error(&self) -> f64 {
        match self {
            Self::Volumes { integration, .. } => integration.error(),
            Self::FlowMap { .. } => 0.0,
        }
    }

    /// Largest part that friction lacked of itself so far on cells too coarse for it.
    pub(super) fn lacking(&self) -> f64 {
        match self {
            Self::Volumes { .. } => 0.0,
            Self::FlowMap { map, .. } => map.progress().lacking,
        }
    }

    /// The longest step taken, or allowed.
    pub(super) fn step(&self) -> f64 {
        match self {
            Self::Volumes { integration, .. } => integration.longest(),
            Self::FlowMap { map, .. } => map.settings().step,
        }
    }
}

/// The shortest interval of a flow map worth keeping: three passes of [`FlowMap::shortest_step`].
pub(super) fn shortest(reference: &Oscillator, mesh: &Mesh) -> f64 {
    3.0 * FlowMap::shortest_step(reference, mesh)
}

/// The propagator of a rung on a mesh.
///
/// # Errors
/// Those of the generator and of the flow map.
pub(super) fn build(
    rung: &Rung,
    oscillator: &Oscillator,
    mesh: &Mesh,
    until: f64,
    (max_memory, late): (u64, Late),
) -> Result<Propagator> {
    match rung.scheme {
        Scheme::FlowMap => {
            let mut settings = rung.flow_map();
            settings.memory = max_memory;
            let reference = rung.reference(oscillator);
            // Shorter steps let grid noise grow.
            settings.step = settings.step.max(FlowMap::shortest_step(reference, mesh));
            Propagator::flow_map(oscillator, mesh, settings, rung.forcing.clone(), late)
        }
        Scheme::Volumes(time) => {
            let generator = Generator::new(oscillator, mesh, rung.drift())?;
            let share = match time {
                TimeScheme::Explicit => SERIES_SHARE.get(),
                _ => SHARE.get(),
            };
            let tolerance = share * rung.tolerance;
            let step = match (time, rung.step) {
                (TimeScheme::BackwardEuler, _) => Some(step_of(rung, oscillator, mesh, until)),
                (_, step) => step,
            };
            let integration = watched(oscillator, &generator, time, tolerance, (step, until), late);
            Ok(Propagator::Volumes {
                generator: Box::new(generator),
                integration,
            })
        }
    }
}

/// The numerical diffusion of upwind drift against the physical one: energy relaxes 1 + c times too
/// fast, c = 0.4 (dq + dv)/(2 zeta sigma) for cells dq, dv at equilibrium, sigma = sqrt(T).
pub(super) fn upwind_excess(oscillator: &Oscillator, mesh: &Mesh) -> f64 {
    let width = |axis: &Axis, x: f64| axis.at(axis.locate(x)).1;
    let cells = width(&mesh.q, 0.0) + width(&mesh.v, 0.0);
    0.4 * cells / (2.0 * oscillator.zeta() * oscillator.temperature().sqrt())
}

/// Time over which errors add up before the oscillator forgets them.
fn horizon(oscillator: &Oscillator, until: f64) -> f64 {
    until.min(0.5 / oscillator.zeta() + 2.0 * oscillator.zeta())
}

/// The step of backward Euler: first order in time beside first order in space, one cell a step at a
/// third of the fastest speed.
pub(super) fn euler_step(mesh: &Mesh, asked: Option<f64>) -> f64 {
    let width = mesh.q.at(mesh.q.locate(0.0)).1;
    let automatic = 3.0 * width / mesh.v.edges()[mesh.v.len()].abs().max(f64::MIN_POSITIVE);
    asked.unwrap_or(automatic)
}

/// The step of backward Euler on a rung. It damps small motions by dt/2 beside zeta: with a drift of higher order the
/// density may err by that, in the L1 norm, times what the oscillator remembers.
pub(super) fn step_of(rung: &Rung, oscillator: &Oscillator, mesh: &Mesh, until: f64) -> f64 {
    let step = euler_step(mesh, rung.step);
    if rung.step.is_some() || rung.drift() == Drift::Upwind {
        return step;
    }
    let remembered = horizon(oscillator, until) + 2.0 * oscillator.zeta();
    step.min(2.0 * rung.tolerance / remembered)
}

/// The scheme with its choice of steps for a run until `until`, such that the error in time stays below
/// `tolerance` in the L1 norm; a tenth to a half of it is measured where accuracy bounds many
/// steps, a hundredth of it in a few implicit ones, and less where stability bounds them (tests/time.rs).
pub fn time_integration(
    oscillator: &Oscillator,
    generator: &Generator,
    time: TimeScheme,
    tolerance: f64,
    longest: Option<f64>,
    until: f64,
) -> TimeIntegration {
    let until = (longest, until);
    watched(oscillator, generator, time, tolerance, until, never())
}

/// The same, ended by `late`.
fn watched(
    oscillator: &Oscillator,
    generator: &Generator,
    time: TimeScheme,
    tolerance: f64,
    (longest, until): (Option<f64>, f64),
    late: Late,
) -> TimeIntegration {
    let choice = if time == TimeScheme::BackwardEuler {
        Step::Fixed(euler_step(generator.mesh(), longest))
    } else {
        // Steps longer than the correlation time of the motion resolve nothing, and the systems of implicit ones grow
        // hard to solve.
        let longest = longest.unwrap_or_else(|| oscillator.correlation_time());
        // Two runs that begin with the same steps would not see what these do.
        let shorter = (tolerance / 1e-3).cbrt().clamp(0.1, 1.0);
        Step::Error {
            total: tolerance,
            horizon: horizon(oscillator, until),
            first: longest.min(shorter * 0.1 / (1.0 + 2.0 * oscillator.zeta())),
            longest,
        }
    };
    let scheme: Box<dyn Integrator> = match time {
        TimeScheme::BackwardEuler => Box::new(BackwardEuler::watched(generator, late)),
        TimeScheme::Implicit => Box::new(Radau::watched(generator, solver(generator), late)),
        TimeScheme::Imex => Box::new(Additive::new(generator)),
        TimeScheme::Explicit => Box::new(Chebyshev::new(generator)),
    };
    TimeIntegration::new(scheme, choice)
}

/// How the systems of an implicit scheme are solved.
fn solver(generator: &Generator) -> Solver {
    if generator.unknowns() < DIRECT {
        Solver::Direct
    } else {
        Solver::Krylov
    }
}
