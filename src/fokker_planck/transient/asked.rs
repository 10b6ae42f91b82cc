//! What is asked of a transient, and where: its domain, its cells, and what holds the initial condition at first.

use super::recipe::{self, FirstGrid, Rung};
use crate::error::{Error, Result};
use crate::fokker_planck::budget::{self, Factors};
use crate::fokker_planck::domain::Domain;
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::forcing::Forcing;
use crate::fokker_planck::layout::{self, Cells, Layout};
use crate::fokker_planck::mesh::Mesh;
use crate::fokker_planck::policy::{FALLING, INITIAL_CELLS, LADDER_RATIO, REFINED};
use crate::fokker_planck::settings::{Settings, TimeScheme, TransientMethod};
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use std::sync::Arc;

/// Damping ratio up to which the flow map is taken. At zeta = 3 it takes a tenth of what finite volumes take to 1e-2 and as
/// much to 1e-5, at zeta = 5 a quarter to 1e-2 and 1.3 times as much to 1e-4, at zeta = 30 it has no answer.
pub(super) const KNOWN: f64 = 5.0;

/// What is asked of a transient.
#[derive(Clone, Copy)]
pub(super) struct Asked<'a> {
    pub(super) oscillator: &'a Oscillator,
    pub(super) initial: &'a Initial,
    pub(super) times: &'a [f64],
    pub(super) settings: &'a Settings,
    pub(super) forcing: Option<&'a Arc<Forcing>>,
    /// The period of a law that lasts.
    pub(super) period: Option<f64>,
    /// Of the times every so many is asked for itself, the others for the harmonics of a period.
    pub(super) each: usize,
}

impl Asked<'_> {
    pub(super) fn until(&self) -> f64 {
        self.times.last().copied().unwrap_or(0.0)
    }

    /// Whether the scene asks for a scheme of finite volumes.
    pub(super) fn names_volumes(&self) -> bool {
        self.settings.drift.is_some() || self.settings.time.is_some()
    }

    /// Whether the flow map computes it, where a mesh holds the density; else finite volumes do.
    pub(super) fn takes_flow_map(&self) -> bool {
        match self.settings.method {
            Some(method) => method == TransientMethod::FlowMap,
            None => !self.names_volumes() && self.oscillator.zeta() <= KNOWN,
        }
    }

    /// How g is carried across faces: finite volumes of order 8, unless the scene asks for something else.
    pub(super) fn drift(&self) -> Drift {
        match (
            self.settings.method,
            self.settings.drift,
            self.settings.time,
        ) {
            (Some(TransientMethod::FlowMap), ..) => Drift::Order8,
            (_, Some(drift), _) => drift,
            (_, None, Some(TimeScheme::BackwardEuler)) => Drift::Upwind,
            _ => Drift::Order8,
        }
    }

    /// Deviations of the law in q and v where it is narrowest.
    pub(super) fn deviations(&self) -> [f64; 2] {
        let Some(forcing) = self.forcing else {
            return layout::deviations(self.oscillator);
        };
        layout::deviations(forcing.noise()).map(|it| it * forcing.narrowing())
    }

    /// Widths of cells in q and v, one a deviation of the stationary law or one over [`INITIAL_CELLS`] of the initial condition.
    pub(super) fn widths(&self) -> [f64; 2] {
        let thermal = self.deviations();
        match *self.initial {
            Initial::Gaussian { deviation, .. } => {
                [0, 1].map(|k| thermal[k].min(deviation[k] / INITIAL_CELLS.get()))
            }
            _ => thermal,
        }
    }

    /// Domain and cells of the rung expected, and what holds the initial condition.
    pub(super) fn laid_out(&self) -> Result<(Layout, FirstGrid)> {
        let Self {
            oscillator,
            initial,
            settings,
            ..
        } = *self;
        let drift = self.drift();
        let neglected = self.neglected()?;
        let (thermal, flow_map) = (self.deviations(), self.takes_flow_map());
        let laid_out = |domain: Domain, widths: [f64; 2]| Layout {
            domain,
            cells: Cells::of(settings, widths),
            drift,
            focused: flow_map,
        };
        if let Some([q, v]) = settings.cells {
            // On the coarsest of three rungs two are within.
            let least = 2 * drift.margin() + 4;
            if q.min(v) < least {
                let accepted = format!("at least {least} each for {}", drift.name());
                let cells = format!("[{q}, {v}]");
                return Err(Error::invalid("method.cells", cells, accepted));
            }
        }
        if let Some(cells) = settings.cells {
            let factors = settings.time.map_or(Factors::None, Factors::of);
            let needed = budget::memory(cells, drift, factors);
            budget::check_memory(needed, cells, true, settings.max_memory)?;
        }
        let first_grid = if !oscillator.contact().is_confining() {
            if self.stays_on_moving_grid() {
                FirstGrid::MovingForGood
            } else {
                FirstGrid::Mesh
            }
        } else if let Some(grid) = self.falling(neglected)? {
            grid
        } else {
            let fits = match *initial {
                Initial::Stationary => true,
                Initial::Rest => false,
                // If they do not hold it, the other is taken: see `Recipe::otherwise`. Steps of order 2, which output times cut to
                // the same length on all rungs, show what they err on a local grid alone.
                Initial::Gaussian { .. } if settings.cells.is_some() => {
                    oscillator.is_viscous() || !flow_map
                }
                Initial::Gaussian { .. } => {
                    // The law that p is taken against is hotter than the stationary one where friction is not constant.
                    let colder = oscillator.viscous_temperature() / oscillator.temperature();
                    let law = thermal.map(|it| it * colder.sqrt().min(1.0));
                    let narrow = |(law, width): (f64, f64)| width * REFINED.get() < law;
                    !law.into_iter().zip(self.widths()).any(narrow)
                }
            };
            if fits {
                FirstGrid::Mesh
            } else {
                FirstGrid::Moving
            }
        };
        let domain = self.domain((first_grid, flow_map), neglected)?;
        Ok(match first_grid {
            FirstGrid::Mesh => (laid_out(domain, self.widths()), first_grid),
            FirstGrid::MovingForGood => {
                let layout = Layout {
                    drift: Drift::Order8,
                    ..laid_out(domain, thermal)
                };
                (layout, first_grid)
            }
            _ => (laid_out(domain, thermal), first_grid),
        })
    }

    /// The rung expected for the tolerance: the median over the scenes of the calibration, which need two more or fewer each.
    /// What the flow map splits of friction that is not constant falls slowest, and a law narrower than the one that p is taken
    /// against asks for cells as much finer.
    pub(super) fn expected(&self) -> f64 {
        let it = self.oscillator;
        let splits = !it.damping().has_closed_form() && self.takes_flow_map();
        let decade = if splits { 2.7 } else { 1.5 };
        let narrower = 0.5 * (it.temperature() / it.kinetic_temperature()).ln();
        let narrower = (narrower / LADDER_RATIO.get().ln()).max(0.0);
        (2.2 + decade * (1e-2 / self.settings.tolerance).log10() + narrower)
            .round()
            .clamp(2.0, 10.0)
    }

    /// The domain of a first grid, under a flow map or under finite volumes.
    pub(super) fn domain(&self, first: (FirstGrid, bool), neglected: f64) -> Result<Domain> {
        let forced = (self.oscillator, self.forcing.map(|it| &**it));
        recipe::domain(forced, self.initial, self.until(), first, neglected)
    }

    /// Probability that the domain leaves out.
    fn neglected(&self) -> Result<f64> {
        match self.settings.neglected {
            Some(neglected) => Ok(neglected),
            None => Ok(Rung::neglected(self.rung_of_domain()?)),
        }
    }

    /// The rung whose domain is taken: the one expected, or that of the cells of the scene.
    pub(super) fn rung_of_domain(&self) -> Result<f64> {
        let (settings, expected) = (self.settings, self.expected());
        if settings.cells.is_none() {
            return Ok(expected);
        }
        let first = (FirstGrid::Mesh, self.takes_flow_map());
        let layout = Layout {
            domain: self.domain(first, Rung::neglected(expected))?,
            cells: Cells::of(settings, self.deviations()),
            drift: self.drift(),
            focused: self.takes_flow_map(),
        };
        // A narrow initial condition has a local grid of its own, if these cells do not hold it.
        self.rung_of(&layout, self.deviations())
    }

    /// A moving local grid for an initial condition that strong friction brings in from far beyond the stationary law.
    fn falling(&self, neglected: f64) -> Result<Option<FirstGrid>> {
        let Initial::Gaussian { mean, deviation } = *self.initial else {
            return Ok(None);
        };
        let oscillator = self.oscillator;
        if oscillator.zeta() <= KNOWN || self.settings.cells.is_some() {
            return Ok(None);
        }
        let domain = Domain::closed(oscillator, &Initial::Rest, neglected)?;
        // The law's own amplitude, taken for a Gaussian: far above 1 where flights are long.
        let law = oscillator.displacement_law()?;
        let [centre, spread] = law.spread(|q| q);
        let own = [spread, oscillator.temperature().sqrt()];
        let own = domain.amplitude(oscillator, [centre, 0.0], own).max(1.0);
        let most = FALLING.get() * own;
        let beyond = domain.amplitude(oscillator, mean, deviation) > most;
        Ok(beyond.then_some(FirstGrid::Falling(most)))
    }

    /// Whether a run never leaves its moving local grid, and has no other mesh: a law that leaves every domain keeps
    /// a density near a Gaussian for good. A Gaussian initial condition may ask for a domain instead.
    pub(super) fn stays_on_moving_grid(&self) -> bool {
        let it = self.settings;
        let asked = it.method.is_some() || self.names_volumes() || it.cells.is_some();
        match self.initial {
            Initial::Rest => true,
            Initial::Gaussian { .. } => !asked,
            Initial::Stationary => false,
        }
    }
}

/// The mesh of a run until `until`, `finer` times as fine as the settings ask for; for an initial condition that starts
/// on a moving local grid, the mesh that takes over without regard to how narrow it is.
///
/// # Errors
/// Those of the domain and of the axes; [`Error::Mesh`](crate::Error::Mesh) and [`Error::Invalid`](crate::Error::Invalid) for cells beyond what can be
/// meant or held.
pub fn mesh(
    oscillator: &Oscillator,
    initial: &Initial,
    until: f64,
    drift: Drift,
    settings: &Settings,
    finer: f64,
) -> Result<Mesh> {
    let settings = &Settings {
        drift: Some(drift),
        ..settings.clone()
    };
    let asked = Asked {
        oscillator,
        initial,
        times: &[until],
        settings,
        forcing: None,
        period: None,
        each: 1,
    };
    let layout = asked.laid_out()?.0;
    let finer = finer
        * if layout.is_given() {
            1.0
        } else {
            layout::cells_per_deviation(settings.tolerance)
        };
    layout.mesh(oscillator, finer)
}
