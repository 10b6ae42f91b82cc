//! How a transient will be computed: every decision once, as a value, and the ladder of runs that it is.

use crate::error::Result;
use crate::fokker_planck::budget::{Cost, Factors};
use crate::fokker_planck::domain::Domain;
use crate::fokker_planck::flow_map;
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::forcing::Forcing;
use crate::fokker_planck::layout::{Cells, Layout, times};
use crate::fokker_planck::mesh::Mesh;
use crate::fokker_planck::policy::{
    COARSEST, FALLING, FIRST_CELLS, LADDER_RATIO, OUTSIDE, OUTSIDE_FALL, SPLITTING,
};
use crate::fokker_planck::settings::TimeScheme;
use crate::initial::Initial;
use crate::moments::Moment;
use crate::oscillator::Oscillator;
use std::sync::Arc;

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
    /// A moving local grid for good: the density leaves every domain and stays near a Gaussian.
    MovingForGood,
}

/// Method, schemes, cells, foreseen cost and the reason of a transient, for the whole ladder of its runs.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Recipe {
    /// What carries the density.
    pub(crate) scheme: Scheme,
    /// What holds the initial condition.
    pub(crate) first_grid: FirstGrid,
    /// What there is beside stationary noise.
    pub(crate) forcing: Option<Arc<Forcing>>,
    /// The period of the drive, where the law that lasts is asked for and not the transient.
    pub(crate) period: Option<f64>,
    /// Of its phases every so many is asked for itself, the others for harmonics and the mean of P(loss).
    pub(crate) each: usize,
    /// The domain and cells of the rung at which the tolerance is expected, and the stencil. Cells that the scene
    /// leaves open are one a deviation here.
    pub(crate) layout: Layout,
    /// Probability that every domain may leave out, where it does not follow the rung.
    pub(crate) neglected: Option<f64>,
    /// The rung at which the tolerance is expected; with cells of the scene theirs, the last.
    pub(crate) expected: f64,
    /// The rung whose domain the layout has, less the one expected: cells of the scene may be few for an initial condition, and the
    /// domain is that of the stationary law on them.
    pub(crate) ahead: f64,
    /// The scene's longest step.
    pub(crate) step: Option<f64>,
    /// The moments asked for; None for all of them.
    pub(crate) moments: Option<Vec<Moment>>,
    /// Error aimed at, relative to the normalisation of each number.
    pub(crate) tolerance: f64,
    /// What it will take.
    pub(crate) cost: Cost,
    /// Why so.
    pub(crate) reason: String,
    /// What takes over where the mesh does not hold the scene: on cells of the scene with a moving local grid before it or without
    /// one, else finite volumes for a flow map.
    pub(crate) otherwise: Option<Box<Recipe>>,
}

/// One run of a recipe: cells, steps and domain at once, all of them finer from rung to rung.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rung {
    /// What carries the density.
    pub(crate) scheme: Scheme,
    /// What holds the initial condition.
    pub(crate) first_grid: FirstGrid,
    /// What there is beside stationary noise.
    pub(crate) forcing: Option<Arc<Forcing>>,
    /// The period of a law that lasts.
    pub(crate) period: Option<f64>,
    /// Domain, cells and stencil.
    pub(crate) layout: Layout,
    /// Probability that the domain was asked to leave out at most.
    pub(crate) neglected: f64,
    /// The longest step of a flow map, or that of the scene.
    pub(crate) step: Option<f64>,
    /// Error that the parts which know theirs aim at.
    pub(crate) tolerance: f64,
    /// Cells per deviation of the stationary law.
    pub(crate) per_deviation: f64,
    /// Whether the steps are the program's choice.
    pub(crate) automatic: bool,
}

/// Rungs that show an error: one difference may pass through zero, two say how it falls.
pub(super) const RUNGS: usize = 3;

impl Rung {
    /// What a kernel that knows its error aims at on rung `r`: order 3, as the rest at worst.
    pub(crate) fn tolerance(r: f64) -> f64 {
        COARSEST.get() * LADDER_RATIO.get().powf(-3.0 * r)
    }

    /// The rung that aims at a tolerance.
    pub(super) fn of_tolerance(tolerance: f64) -> f64 {
        (COARSEST.get() / tolerance).ln() / (3.0 * LADDER_RATIO.get().ln())
    }

    /// Probability that the domain of rung `r` leaves out: ten times as much of a variance is lost with it, and a long
    /// flight's tail falls more slowly than the probability beyond it.
    pub(crate) fn neglected(r: f64) -> f64 {
        OUTSIDE.get() * OUTSIDE_FALL.get().powf(-r)
    }

    /// How g is carried across faces.
    pub(crate) fn drift(&self) -> Drift {
        self.layout.drift
    }

    /// The oscillator whose stationary law densities are taken against.
    pub(crate) fn reference<'a>(&'a self, oscillator: &'a Oscillator) -> &'a Oscillator {
        let forcing = self.forcing.as_ref();
        forcing.map_or(oscillator, |it| it.reference())
    }

    /// What acts beside stationary noise.
    pub(crate) fn acting(&self) -> Option<&Arc<Forcing>> {
        self.forcing.as_ref().filter(|it| it.acts())
    }

    /// The same with half the step of the scene, to tell what that does.
    pub(crate) fn halved(self) -> Self {
        Self {
            step: self.step.map(|step| 0.5 * step),
            ..self
        }
    }

    /// The mesh.
    pub(crate) fn mesh(&self, oscillator: &Oscillator) -> Result<Mesh> {
        self.layout.mesh(oscillator, 1.0)
    }

    /// Whether a moving local grid comes first.
    pub(crate) fn starts_on_moving_grid(&self) -> bool {
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
        let domain = self.layout.domain;
        let law = domain.enlarged(oscillator, 1.0 / (FALLING.get().powi(2)));
        law.amplitude(oscillator, mean, deviation)
    }

    /// The bends of the envelope between two times, and the later time.
    pub(crate) fn stops(&self, from: f64, to: f64) -> Vec<f64> {
        let bends = self.forcing.iter();
        let bends = bends.flat_map(|it| it.excitation().bends(from, to));
        bends.chain([to]).collect()
    }

    /// The steps of the flow map.
    pub(crate) fn flow_map(&self) -> flow_map::Settings {
        let automatic = flow_map::Settings::default();
        let step = self.step.unwrap_or(automatic.step);
        flow_map::Settings { step, ..automatic }
    }
}

impl Recipe {
    /// Whether cells and steps are the program's choice.
    pub(super) fn is_free(&self) -> bool {
        !self.layout.is_given() && self.step.is_none()
    }

    /// Whether it is forced in time, so that no law is stationary.
    pub(super) fn acts(&self) -> bool {
        self.forcing.as_ref().is_some_and(|it| it.acts())
    }

    /// Whether it asks for a law that has no closed form: it begins in it, or there are distances to it.
    pub(super) fn asks_for_law(&self, oscillator: &Oscillator, initial: &Initial) -> bool {
        let solved_for = !oscillator.damping().has_closed_form();
        solved_for && self.period.is_none() && (!self.acts() || *initial == Initial::Stationary)
    }

    /// The rung of the first run: of cells that the scene gives, the last is theirs.
    pub(super) fn first_rung(&self) -> f64 {
        if self.layout.is_given() {
            self.expected - (RUNGS - 1) as f64
        } else {
            0.0
        }
    }

    /// Cells per deviation of the stationary law on rung `r`.
    fn per_deviation(r: f64) -> f64 {
        FIRST_CELLS.get() * LADDER_RATIO.get().powf(r)
    }

    /// Probability that the domain of rung `r` leaves out.
    pub(super) fn left_out(&self, r: f64) -> f64 {
        self.neglected
            .unwrap_or_else(|| Rung::neglected(r + self.ahead))
    }

    /// The run of rung `r`.
    pub(crate) fn rung(
        &self,
        oscillator: &Oscillator,
        initial: &Initial,
        until: f64,
        r: f64,
    ) -> Result<Rung> {
        let tolerance = Rung::tolerance(r);
        let neglected = self.left_out(r);
        let domain = if r == self.expected {
            self.layout.domain
        } else {
            let (who, grid) = (
                (oscillator, self.forcing.as_deref()),
                (self.first_grid, self.layout.focused),
            );
            domain(who, initial, until, grid, neglected)?
        };
        let cells = match self.layout.cells {
            Cells::Given(cells) => {
                // So many times as wide as those of the scene, whatever the domains.
                let finer = LADDER_RATIO.get().powf(r - self.expected);
                let shares = domain.over(&self.layout.domain);
                let count = |k: usize| times(self.layout.drift, cells[k], finer * shares[k]);
                Cells::Given([0, 1].map(|k| count(k).min(cells[k])))
            }
            Cells::Widths(widths) => {
                Cells::Widths(widths.map(|width| width / Self::per_deviation(r)))
            }
        };
        let step = match (self.scheme, self.step) {
            // Beyond the longest useful step the error is not known, and two runs would not show it.
            (Scheme::FlowMap, Some(step)) => Some(step.min(flow_map::longest_step(oscillator))),
            (Scheme::Volumes(_), Some(step)) => Some(step),
            (Scheme::FlowMap, None) => {
                let aim = SPLITTING.get() * tolerance;
                let driven = self.forcing.as_ref();
                let driven = driven.map_or(f64::INFINITY, |it| it.longest_step(aim));
                // Friction that is not constant splits to order 2 alone; its error falls as that of the rest.
                let frozen = if oscillator.is_viscous() {
                    f64::INFINITY
                } else {
                    flow_map::longest_step(oscillator) * (tolerance / COARSEST.get()).sqrt()
                };
                let step = flow_map::Settings::to(aim, oscillator)?.step;
                Some(step.min(driven).min(frozen))
            }
            (Scheme::Volumes(_), None) => None,
        };
        Ok(Rung {
            scheme: self.scheme,
            first_grid: self.first_grid,
            forcing: self.forcing.clone(),
            period: self.period,
            layout: Layout {
                domain,
                cells,
                ..self.layout
            },
            neglected,
            step,
            tolerance,
            per_deviation: Self::per_deviation(r),
            automatic: self.step.is_none(),
        })
    }

    /// The method, for people.
    pub(crate) fn name(&self) -> String {
        match self.scheme {
            Scheme::Volumes(time) => {
                let drift = self.layout.drift.name();
                format!("finite volumes, {drift}, {}", time.name())
            }
            Scheme::FlowMap => "flow map, order 8".into(),
        }
    }
}

/// The truncated domain of a run until `until`: under a forcing that of its strongest noise, and farther by as much as the
/// drive swings. A flow map needs no more of it than motions come to against friction; finite volumes need streamlines that close.
pub(crate) fn domain(
    (oscillator, forcing): (&Oscillator, Option<&Forcing>),
    initial: &Initial,
    until: f64,
    (first_grid, flow_map): (FirstGrid, bool),
    neglected: f64,
) -> Result<Domain> {
    let noise = forcing.map_or(oscillator, |it| it.noise());
    let domain = unforced(noise, initial, until, first_grid, neglected)?;
    if !oscillator.contact().is_confining() {
        return Ok(domain);
    }
    let drive = forcing.map_or([0.0; 2], |it| [it.excitation().push(), it.swing()]);
    let measured = forcing.and_then(Forcing::tail);
    let measured = measured.map_or(0.0, |it| it.domain(neglected));
    let reach = measured.max(domain.v[1] + drive[1]);
    let domain = if reach > domain.v[1] {
        domain.enlarged(noise, reach / domain.v[1])
    } else {
        domain
    };
    if flow_map {
        domain.held_back(noise, initial, neglected, drive)
    } else {
        Ok(domain)
    }
}

fn unforced(
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
        let domain = Domain::closed(oscillator, initial, neglected)?;
        return domain.reached(oscillator, initial, until, neglected);
    }
    let law = Domain::closed(oscillator, &Initial::Rest, neglected)?;
    if let FirstGrid::Falling(_) = first_grid {
        return Ok(law.enlarged(oscillator, FALLING.get().powi(2)));
    }
    let raised = law.raised(oscillator, initial, until);
    if raised.v[1] > law.v[1] {
        return Ok(raised);
    }
    law.reached(oscillator, initial, until, neglected)
}
