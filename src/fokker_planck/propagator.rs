//! What carries a density forward in time: finite volumes with a scheme in time, or the flow map. Both on
//! the same meshes, weights and densities, so that one can be held against the other cell by cell.

use super::density::Density;
use super::flow_map::{self, FlowMap};
use super::flux::Weights;
use super::generator::Generator;
use super::march::March;
use super::mesh::Mesh;
use crate::error::Result;
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use std::ops::Range;

/// A density's way forward.
pub(super) enum Propagator {
    /// Finite volumes, and the scheme in time that drives them.
    Volumes {
        /// The generator.
        generator: Box<Generator>,
        /// The scheme with its choice of steps.
        march: March,
    },
    /// Exact transport and exact noise in turn.
    FlowMap {
        /// The flow map.
        map: Box<FlowMap>,
        /// The shortest interval worth keeping: three passes of [`FlowMap::shortest_step`].
        shortest: f64,
        /// Where a density less than `shortest` older than the present one came from.
        anchor: Option<Anchor>,
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
    ) -> Result<Self> {
        Ok(Self::FlowMap {
            map: Box::new(FlowMap::new(oscillator, mesh, settings)?),
            shortest: 3.0 * FlowMap::shortest_step(oscillator, mesh),
            anchor: None,
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
    pub(super) fn start(&self, initial: &Initial) -> Result<Density> {
        match self {
            Self::Volumes { generator, .. } => Density::start(generator, initial),
            Self::FlowMap { map, .. } => map.start(initial),
        }
    }

    /// The density with p(q, v) at the centres of cells that hold unknowns.
    pub(super) fn sampled(&self, p: &dyn Fn(&[[f64; 2]]) -> Vec<f64>) -> Density {
        let (mesh, columns) = match self {
            Self::Volumes { generator, .. } => (generator.mesh(), generator.columns()),
            Self::FlowMap { map, .. } => (map.mesh(), map.columns()),
        };
        Density::sampled(mesh, columns, p)
    }

    /// g = P/w, row-major.
    pub(super) fn ratio(&self, density: &Density) -> Vec<f64> {
        match self {
            Self::Volumes { generator, .. } => density.ratio(generator),
            Self::FlowMap { map, .. } => map.ratio(density),
        }
    }

    /// Carries the density forward by `duration`. `watch` is told how far it has come and what the
    /// density is; it ends the march early by answering false.
    pub(super) fn advance(
        &mut self,
        density: &mut Density,
        duration: f64,
        watch: &mut dyn FnMut(f64, &Density) -> Result<bool>,
    ) -> Result<()> {
        match self {
            Self::Volumes { march, .. } => march.advance(density, duration, watch).map(|_| ()),
            Self::FlowMap {
                map,
                shortest,
                anchor,
            } => {
                let (before, since) = match anchor.take() {
                    Some(Anchor { density, since }) => (density, since),
                    None => (density.clone(), 0.0),
                };
                let total = since + duration;
                density.cells_mut().copy_from_slice(before.cells());
                let steps = (WORK / map.mesh().len() as f64).clamp(8.0, CHUNK);
                let chunks = (total / (steps * map.settings().step)).ceil().max(1.0);
                for k in 1..=chunks as u64 {
                    map.advance(density, total / chunks)?;
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
            Self::Volumes { march, .. } => march.steps(),
            Self::FlowMap { map, .. } => map.progress().steps as u64,
        }
    }

    /// What the steps of finite volumes have left of their errors, in the L1 norm, as far as they are estimated.
    pub(super) fn step_error(&self) -> f64 {
        match self {
            Self::Volumes { march, .. } => march.error(),
            Self::FlowMap { .. } => 0.0,
        }
    }

    /// The longest step taken, or allowed.
    pub(super) fn step(&self) -> f64 {
        match self {
            Self::Volumes { march, .. } => march.longest(),
            Self::FlowMap { map, .. } => map.settings().step,
        }
    }
}
