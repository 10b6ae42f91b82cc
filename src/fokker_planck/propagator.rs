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
    FlowMap(Box<FlowMap>),
}

/// Steps of the flow map between two looks at the clock and at the stationary law: its ends cost two
/// passes an interval.
pub(super) const CHUNK: f64 = 64.0;

impl Propagator {
    /// The flow map of `oscillator` on `mesh`.
    pub(super) fn flow_map(
        oscillator: &Oscillator,
        mesh: &Mesh,
        settings: flow_map::Settings,
    ) -> Result<Self> {
        Ok(Self::FlowMap(Box::new(FlowMap::new(
            oscillator, mesh, settings,
        )?)))
    }

    /// The measure that g is taken against.
    pub(super) fn weights(&self) -> &Weights {
        match self {
            Self::Volumes { generator, .. } => generator.weights(),
            Self::FlowMap(map) => map.weights(),
        }
    }

    /// The cells of each q-column that hold unknowns.
    pub(super) fn columns(&self) -> &[Range<usize>] {
        match self {
            Self::Volumes { generator, .. } => generator.columns(),
            Self::FlowMap(map) => map.columns(),
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
            Self::FlowMap(map) => map.start(initial),
        }
    }

    /// g = P/w, row-major.
    pub(super) fn ratio(&self, density: &Density) -> Vec<f64> {
        match self {
            Self::Volumes { generator, .. } => density.ratio(generator),
            Self::FlowMap(map) => map.ratio(density),
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
            Self::FlowMap(map) => {
                let chunks = (duration / (CHUNK * map.settings().step)).ceil().max(1.0);
                for k in 1..=chunks as u64 {
                    map.advance(density, duration / chunks)?;
                    if !watch(duration * k as f64 / chunks, density)? {
                        break;
                    }
                }
                Ok(())
            }
        }
    }

    /// Steps taken so far.
    pub(super) fn steps(&self) -> u64 {
        match self {
            Self::Volumes { march, .. } => march.steps(),
            Self::FlowMap(map) => map.progress().steps as u64,
        }
    }

    /// The longest step taken, or allowed.
    pub(super) fn step(&self) -> f64 {
        match self {
            Self::Volumes { march, .. } => march.longest(),
            Self::FlowMap(map) => map.settings().step,
        }
    }
}
