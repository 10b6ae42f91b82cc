//! How a transient will be computed: every decision once, as a value.

use crate::error::Result;
use crate::fokker_planck::budget::{Cost, Factors};
use crate::fokker_planck::domain::Domain;
use crate::fokker_planck::flow_map;
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::layout::Layout;
use crate::fokker_planck::mesh::Mesh;
use crate::fokker_planck::settings::TimeScheme;
use crate::initial::Initial;
use crate::oscillator::Oscillator;

/// What carries a density forward.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scheme {
    /// Finite volumes with a scheme in time.
    Volumes(TimeScheme),
    /// The flow map.
    FlowMap,
}

impl Scheme {
    /// What a run factors of the generator.
    pub(crate) fn factors(self) -> Factors {
        match self {
            Self::FlowMap => Factors::None,
            Self::Volumes(time) => Factors::of(time),
        }
    }
}

/// What holds the initial condition.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum FirstGrid {
    /// The mesh.
    Mesh,
    /// A moving local grid first, until the density is wide enough for the mesh.
    Moving,
    /// A moving local grid first, until strong friction has brought the density in from far beyond the stationary law:
    /// finite volumes carry p/p_s, which spans e^(v^2/2T) and more there. A mesh takes over below this amplitude.
    Falling(f64),
    /// A moving local grid for good: the density leaves every domain and keeps its shape.
    MovingForGood,
}

/// Method, schemes, domain, first cells, steps, foreseen cost and the reason of a transient.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Recipe {
    /// What carries the density.
    pub(crate) scheme: Scheme,
    /// What holds the initial condition.
    pub(crate) first_grid: FirstGrid,
    /// Domain, cells and stencil.
    pub(crate) layout: Layout,
    /// Probability that the domain was asked to leave out at most.
    pub(crate) neglected: f64,
    /// Cells of the first fine run, and those expected of the last, over those of the layout in each direction.
    pub(crate) finer: [f64; 2],
    /// The scene's longest step.
    pub(crate) step: Option<f64>,
    /// Whether the steps of a flow map follow its cells: its shortest useful steps, a quarter of a cell, are then
    /// too long for the tolerance. At zeta = 1e3 the error was 3.3 times the difference that cells 1/0.82 times as
    /// wide made.
    pub(crate) limited_by_mesh: bool,
    /// Error aimed at, relative to the natural scale of each number.
    pub(crate) tolerance: f64,
    /// What it will take.
    pub(crate) cost: Cost,
    /// Why so.
    pub(crate) reason: String,
    /// Finite volumes, for a flow map that cannot reach the tolerance or would need longer for it.
    pub(crate) otherwise: Option<Box<Recipe>>,
}

impl Recipe {
    /// The method, for people.
    pub(crate) fn name(&self) -> String {
        match self.scheme {
            Scheme::Volumes(time) => {
                format!("finite volumes, {}, {}", self.drift().name(), time.name())
            }
            Scheme::FlowMap => "flow map, order 8".into(),
        }
    }

    /// How g is carried across faces.
    pub(crate) fn drift(&self) -> Drift {
        self.layout.drift
    }

    /// Whether cells and steps are left to the program.
    pub(crate) fn free(&self) -> [bool; 2] {
        [!self.layout.is_given(), self.step.is_none()]
    }

    /// Whether a moving local grid comes first.
    pub(crate) fn opens_on_moving_grid(&self) -> bool {
        self.first_grid != FirstGrid::Mesh
    }

    /// The amplitude of a density over that of the edge of the domain that the stationary law needs, for a recipe that
    /// waits until it is small.
    pub(crate) fn amplitude(
        &self,
        oscillator: &Oscillator,
        mean: [f64; 2],
        deviation: [f64; 2],
    ) -> f64 {
        let law = self
            .layout
            .domain
            .enlarged(oscillator, 1.0 / (ROOM * BEYOND));
        law.amplitude(oscillator, mean, deviation)
    }

    /// A mesh `finer` times as fine as laid out.
    ///
    /// # Errors
    /// Those of [`Layout::mesh`].
    pub(crate) fn mesh(&self, oscillator: &Oscillator, finer: f64) -> Result<Mesh> {
        self.layout.mesh(oscillator, finer)
    }

    /// The same recipe in a domain that leaves out at most so much.
    ///
    /// # Errors
    /// Those of [`domain`].
    pub(crate) fn widened(
        &self,
        oscillator: &Oscillator,
        initial: &Initial,
        until: f64,
        neglected: f64,
    ) -> Result<Self> {
        let domain = domain(oscillator, initial, until, self.first_grid, neglected)?;
        Ok(Self {
            layout: Layout {
                domain,
                ..self.layout
            },
            neglected,
            ..self.clone()
        })
    }

    /// Whether the error of the steps is known without a run with longer ones: that of a Chebyshev series is
    /// chosen, implicit ones add up their estimates. A moving local grid does neither, nor a step of the scene.
    pub(crate) fn knows_its_steps(&self) -> bool {
        match self.scheme {
            Scheme::FlowMap | Scheme::Volumes(TimeScheme::BackwardEuler) => false,
            Scheme::Volumes(_) => self.step.is_none() && !self.opens_on_moving_grid(),
        }
    }

    /// The steps of the flow map, `longer` times as long as the tolerance asks.
    ///
    /// # Errors
    /// Those of [`flow_map::Settings::to`].
    pub(crate) fn flow_map(
        &self,
        oscillator: &Oscillator,
        longer: f64,
    ) -> Result<flow_map::Settings> {
        flow_map_settings(oscillator, self.tolerance, self.step, longer)
    }
}

/// Amplitude of a density over that of the stationary law up to which finite volumes hold it under strong friction. At
/// 2 a mesh takes over earlier, and has three times the cells.
pub(super) const BEYOND: f64 = 1.25;

/// Amplitude of the domain over that of what it takes over. With 1 the tails cut off then were 7e-5 of a variance.
const ROOM: f64 = 1.2;

/// The truncated domain of a run until `until`.
///
/// # Errors
/// Those of [`Domain::closed`] and [`Domain::swept`].
pub(crate) fn domain(
    oscillator: &Oscillator,
    initial: &Initial,
    until: f64,
    first_grid: FirstGrid,
    neglected: f64,
) -> Result<Domain> {
    if !oscillator.contact().is_confining() {
        return Domain::swept(oscillator, initial, until, neglected);
    }
    if first_grid == FirstGrid::Mesh {
        return Domain::closed(oscillator, initial, neglected);
    }
    let law = Domain::closed(oscillator, &Initial::Rest, neglected)?;
    Ok(match first_grid {
        FirstGrid::Falling(_) => law.enlarged(oscillator, ROOM * BEYOND),
        _ => law.raised(oscillator, initial, until),
    })
}

/// The steps of the flow map for a tolerance and the scene's step, `longer` times as long.
///
/// # Errors
/// Those of [`flow_map::Settings::to`].
pub(crate) fn flow_map_settings(
    oscillator: &Oscillator,
    tolerance: f64,
    step: Option<f64>,
    longer: f64,
) -> Result<flow_map::Settings> {
    // The splitting gets a fourteenth of the tolerance: two runs see little of it, and it has a part of its own in
    // the error estimate.
    let automatic = flow_map::Settings::to(0.07 * tolerance, oscillator)?;
    // Beyond the longest useful step the error is not known, and two runs would not show it.
    let asked = step.unwrap_or(automatic.step);
    let step = longer * asked.min(flow_map::Settings::LONGEST);
    Ok(flow_map::Settings { step, ..automatic })
}
