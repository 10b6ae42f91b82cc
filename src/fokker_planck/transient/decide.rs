//! What a transient is computed with: the settings of the scene, and the method, scheme and step where they leave it open.

use super::asked::{Asked, KNOWN};
use super::cost;
use super::recipe::{FirstGrid, RUNGS, Recipe, Scheme};
use super::time_scheme::time_scheme;
use crate::error::{Error, Result};
use crate::excitation::Excitation;
use crate::fokker_planck::budget::Cost;
use crate::fokker_planck::domain::{Domain, start_outside};
use crate::fokker_planck::flow_map::FlowMap;
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::forcing::Forcing;
use crate::fokker_planck::generator::Generator;
use crate::fokker_planck::layout::{Cells, FEWER, Layout, STEEPER_TRIES};
use crate::fokker_planck::policy::{FIRST_CELLS, LADDER_RATIO, SPANNED};
use crate::fokker_planck::settings::{Settings, TimeScheme, TransientMethod};
use crate::format::num;
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use std::sync::Arc;

/// Refuses friction too strong for the one solver that knows a drive.
fn check_friction(oscillator: &Oscillator) -> Result<()> {
    let zeta = oscillator.zeta();
    if zeta <= KNOWN {
        return Ok(());
    }
    let accepted = format!("at most {KNOWN} with [excitation]; [monte_carlo] takes any");
    Err(Error::invalid("oscillator.zeta", num(zeta), accepted))
}

impl Recipe {
    /// The recipe for a transient through `times`, ascending. Lays out the mesh and takes no step on it; under a drive that throws
    /// motions coarse runs tell how far the mesh reaches.
    ///
    /// # Errors
    /// [`Error::Invalid`] for settings that exclude each other or cells that do not fit the memory; those of the
    /// domain and of the mesh.
    pub(crate) fn of(
        oscillator: &Oscillator,
        initial: &Initial,
        times: &[f64],
        settings: &Settings,
    ) -> Result<Self> {
        if !settings.excitation.is_plain() {
            check_friction(oscillator)?;
        }
        let until = times.last().copied().unwrap_or(0.0);
        let forcing = Forcing::of(oscillator, initial, &settings.excitation, until)?;
        let forcing = forcing.map(Arc::new);
        let asked = Asked {
            oscillator,
            initial,
            times,
            settings,
            forcing: forcing.as_ref(),
            period: None,
            each: 1,
        };
        asked.recipe()
    }

    /// The recipe for the law that lasts under the drive of the settings, and the times of so many equal phases of its period, with
    /// others between them: `each`-th are asked for.
    ///
    /// # Errors
    /// As [`Recipe::of`]; [`Error::Invalid`] without a drive or a phase.
    pub(crate) fn lasting(
        oscillator: &Oscillator,
        (phases, each): (usize, usize),
        settings: &Settings,
    ) -> Result<(Self, Vec<f64>)> {
        if phases == 0 {
            let accepted = "at least one phase";
            return Err(Error::invalid("outputs.periodic.phases", phases, accepted));
        }
        let Some(drive) = settings.excitation.drive else {
            let accepted = "a drive: without one the law that lasts is the stationary one";
            return Err(Error::invalid("excitation.drive", "none", accepted));
        };
        check_friction(oscillator)?;
        // The phase of the drive moves the origin of time, and has no say in what is found.
        let settings = &Settings {
            excitation: Excitation {
                drive: Some(drive.undelayed()),
                envelope: settings.excitation.envelope.clone(),
            },
            ..settings.clone()
        };
        let forcing = Forcing::lasting(oscillator, &settings.excitation)?.map(Arc::new);
        let count = phases * each;
        let phase = |k: usize| drive.delay() + drive.period() * k as f64 / count as f64;
        let times: Vec<f64> = (0..count).map(phase).collect();
        // Those between have no say in mesh and steps.
        let asked_for: Vec<f64> = times.iter().step_by(each).copied().collect();
        let asked = Asked {
            oscillator,
            initial: &Initial::Stationary,
            times: &asked_for,
            settings,
            forcing: forcing.as_ref(),
            period: Some(drive.period()),
            each,
        };
        Ok((asked.recipe()?, times))
    }
}

impl Asked<'_> {
    fn recipe(&self) -> Result<Recipe> {
        self.decided().map_err(|error| match error {
            Error::Mesh { what, help } if help == FEWER => {
                let help = self.fewer_cells_with().into();
                Error::Mesh { what, help }
            }
            other => other,
        })
    }

    /// What asks for fewer cells: in the excitation, where those would do without it, or in the initial condition.
    fn fewer_cells_with(&self) -> &'static str {
        let excitation = &self.settings.excitation;
        let at_rest = Self {
            forcing: None,
            ..*self
        };
        if excitation.is_plain() || at_rest.decided().is_err() {
            return match self.initial {
                Initial::Gaussian { .. } => {
                    "an initial.mean nearer to rest, or a smaller initial.deviation"
                }
                _ => FEWER,
            };
        }
        match (excitation.drive, &excitation.envelope) {
            (None, _) => "an excitation.envelope that leaves more noise",
            (_, None) => "a smaller amplitude in excitation.drive",
            _ => {
                "an excitation.envelope that leaves more noise, or a smaller amplitude in excitation.drive"
            }
        }
    }

    fn decided(&self) -> Result<Recipe> {
        self.check_forcing()?;
        let (layout, first_grid) = self.laid_out()?;
        let hot = self.hot(&layout, first_grid)?;
        let forcing = hot.as_ref().or(self.forcing);
        Asked { forcing, ..*self }.by_layout(layout, first_grid)
    }

    fn by_layout(&self, layout: Layout, first_grid: FirstGrid) -> Result<Recipe> {
        let expected = self.rung_of(&layout, self.widths())?;
        let draft = Recipe {
            scheme: Scheme::FlowMap,
            first_grid,
            forcing: self.forcing.cloned(),
            period: self.period,
            each: self.each,
            expected,
            ahead: self.rung_of_domain()? - expected,
            layout,
            neglected: self.settings.neglected,
            step: self.settings.step,
            moments: self.settings.moments.clone(),
            tolerance: self.settings.tolerance,
            cost: Cost::default(),
            reason: String::new(),
            otherwise: None,
        };
        if first_grid == FirstGrid::MovingForGood {
            let reason =
                "in a law that leaves every domain a small mesh moves with the density for good";
            return self.costed(draft, reason.into());
        }
        if !self.takes_flow_map() {
            return self.by_volumes(draft);
        }
        let draft = self.followed(draft)?;
        if self.names_volumes() {
            let accepted =
                "\"finite_volume\" with method.drift or method.time: the flow map has neither";
            return Err(Error::invalid("method.transient", "\"flow_map\"", accepted));
        }
        let reason = match self.settings.method {
            Some(_) => "the scene asks for it".to_string(),
            None => {
                let zeta = self.oscillator.zeta();
                format!("zeta = {zeta} <= {KNOWN}: the exact motion takes long steps")
            }
        };
        self.check_step(&draft)?;
        let otherwise = self.otherwise(&draft)?;
        let recipe = self.costed(draft, reason)?;
        Ok(Recipe {
            otherwise: otherwise.map(Box::new),
            ..recipe
        })
    }

    /// A hotter law to take p against, for a flow map of an initial condition of which the domain holds energies that p over
    /// the law it is taken against does not span. The tails of that law itself ask for no other.
    fn hot(&self, layout: &Layout, first_grid: FirstGrid) -> Result<Option<Arc<Forcing>>> {
        if let Some(forcing) = self.forcing.filter(|it| it.throws()) {
            return Ok(Some(Arc::new(forcing.spanning(layout.domain.highest())?)));
        }
        let meshed = self.takes_flow_map() && first_grid != FirstGrid::MovingForGood;
        if !(meshed && self.period.is_none() && self.is_far(layout.domain.neglected)) {
            return Ok(None);
        }
        self.hotter(&layout.domain)
    }

    /// The energies above the lowest potential that p over the law it is taken against spans.
    fn spanned(&self) -> f64 {
        let reference = self.forcing.map_or(self.oscillator, |it| it.reference());
        SPANNED.get() * reference.temperature()
    }

    /// Whether more of the initial condition than is neglected lies beyond.
    fn is_far(&self, neglected: f64) -> bool {
        start_outside(self.oscillator, self.initial, self.spanned()) > neglected
    }

    /// The law that holds the energies of a domain to what p may span; None where that which p is taken against does.
    fn hotter(&self, domain: &Domain) -> Result<Option<Arc<Forcing>>> {
        let highest = domain.highest();
        if !self.oscillator.contact().is_confining() || highest <= self.spanned() {
            return Ok(None);
        }
        let forcing = match self.forcing {
            Some(forcing) => forcing.spanning(highest)?,
            None => Forcing::none(self.oscillator, self.initial)?.spanning(highest)?,
        };
        Ok(Some(Arc::new(forcing)))
    }

    /// What takes over where cells of the scene do not hold its initial condition: the same after a moving local grid, or
    /// without one.
    fn other_grid(&self, draft: &Recipe) -> Result<Option<Recipe>> {
        let gaussian = matches!(self.initial, Initial::Gaussian { .. });
        let (first_grid, reason) = match draft.first_grid {
            FirstGrid::Mesh => {
                let reason = "a small mesh moves with the initial condition at first";
                (FirstGrid::Moving, reason)
            }
            FirstGrid::Moving => (FirstGrid::Mesh, "its cells hold the initial condition"),
            FirstGrid::Falling(_) | FirstGrid::MovingForGood => return Ok(None),
        };
        let confined = self.oscillator.contact().is_confining();
        if !(draft.layout.is_given() && gaussian && confined) {
            return Ok(None);
        }
        let domain = self.domain(
            (first_grid, draft.layout.focused),
            draft.left_out(draft.expected),
        )?;
        Ok(Some(Recipe {
            first_grid,
            layout: Layout {
                domain,
                ..draft.layout
            },
            reason: reason.into(),
            ..draft.clone()
        }))
    }

    /// What takes over from a flow map that does not hold the scene: on cells of the scene the other first grid, else one against a
    /// hotter law, since what is neglected of the initial condition may still be more than its cells hold, and finite volumes where
    /// the method is free.
    fn otherwise(&self, draft: &Recipe) -> Result<Option<Recipe>> {
        let other = self.other_grid(draft)?;
        let free = self.settings.method.is_none() && self.period.is_none();
        if other.is_some() || !free {
            return Ok(other);
        }
        // The farthest that cells were tried for.
        let farthest = draft.left_out((STEEPER_TRIES - 1) as f64);
        let hotter = if self.is_far(farthest) {
            let grid = (draft.first_grid, draft.layout.focused);
            self.hotter(&self.domain(grid, farthest)?)?
        } else {
            None
        };
        let hotter = hotter.map(|it| {
            let forcing = Some(&it);
            Asked { forcing, ..*self }.by_layout(draft.layout, draft.first_grid)
        });
        let hotter = hotter.transpose()?;
        if self.forcing.is_some() {
            return Ok(hotter);
        }
        let volumes = self.volumes_after(draft)?;
        Ok(Some(match hotter {
            Some(hotter) => Recipe {
                otherwise: Some(Box::new(volumes)),
                ..hotter
            },
            None => volumes,
        }))
    }

    /// Finite volumes on the cells of a flow map.
    fn volumes_after(&self, draft: &Recipe) -> Result<Recipe> {
        let neglected = draft.left_out(draft.expected);
        let domain = match self.oscillator.holds_back(draft.layout.domain.q) {
            [false, false] => draft.layout.domain,
            _ => self.domain((draft.first_grid, false), neglected)?,
        };
        Ok(Recipe {
            scheme: Scheme::Volumes(TimeScheme::Imex),
            layout: Layout {
                domain,
                focused: false,
                ..draft.layout
            },
            reason: "finite volumes of order 8, steps bound by transport".into(),
            ..draft.clone()
        })
    }

    /// Refuses a step of the scene that is too short for the flow map on the last mesh.
    fn check_step(&self, draft: &Recipe) -> Result<()> {
        let Some(step) = draft.step else {
            return Ok(());
        };
        let rung = draft.rung(self.oscillator, self.initial, self.until(), draft.expected)?;
        let reference = rung.reference(self.oscillator);
        let shortest = FlowMap::shortest_step(reference, &rung.mesh(self.oscillator)?);
        if step >= shortest {
            return Ok(());
        }
        let accepted = format!(
            "at least {shortest:.2e} for the flow map on this mesh: shorter steps let grid noise grow"
        );
        Err(Error::invalid("method.step", num(step), accepted))
    }

    fn by_volumes(&self, draft: Recipe) -> Result<Recipe> {
        let generator = self.carried(&draft)?;
        let drift = generator.drift();
        let why_drift = match self.settings.drift {
            Some(_) => "the scene asks for this drift",
            None if drift == Drift::Upwind => "backward Euler is positive with upwind drift only",
            None => "order 8: fewest cells for a smooth density",
        };
        let (time, why_time) = match self.settings.time {
            Some(time) => (time, "the scene asks for this scheme in time".to_string()),
            None => {
                let tolerance = self.settings.tolerance;
                time_scheme(self.oscillator, &generator, tolerance, self.until())
            }
        };
        let recipe = Recipe {
            scheme: Scheme::Volumes(time),
            ..draft
        };
        let otherwise = self.other_grid(&recipe)?;
        let recipe = self.costed(recipe, format!("{why_drift}; {why_time}"))?;
        Ok(Recipe {
            otherwise: otherwise.map(Box::new),
            ..recipe
        })
    }

    /// The rung that has as many cells as the scene gives, or the first with two below it, or else the one at which the tolerance is
    /// expected; on rung 0 and up cells are fractions of these widths.
    pub(super) fn rung_of(&self, layout: &Layout, widths: [f64; 2]) -> Result<f64> {
        let Cells::Given(cells) = layout.cells else {
            return Ok(self.expected());
        };
        let open = Layout {
            cells: Cells::Widths(widths),
            ..*layout
        };
        let single = open.count(self.oscillator, 1.0)?;
        let margin = 2 * layout.drift.margin();
        let inner = |n: usize| n.saturating_sub(margin).max(1) as f64;
        let each = cells.into_iter().zip(single);
        let finer = each.map(|(n, single)| inner(n) / inner(single));
        let finer = finer.fold(f64::INFINITY, f64::min);
        Ok(((finer / FIRST_CELLS.get()).ln() / LADDER_RATIO.get().ln())
            .clamp((RUNGS - 1) as f64, 10.0))
    }

    /// The recipe with its foreseen cost.
    fn costed(&self, mut recipe: Recipe, mut reason: String) -> Result<Recipe> {
        reason.push_str(match recipe.first_grid {
            FirstGrid::Moving => {
                "; the initial condition is too narrow for a mesh, so a small mesh moves with it at first"
            }
            FirstGrid::Falling(_) => {
                "; the initial condition lies far beyond the stationary law, so a small mesh moves with it until \
                 friction has brought it in"
            }
            FirstGrid::Mesh | FirstGrid::MovingForGood => "",
        });
        let hot = recipe.forcing.as_ref().filter(|it| !it.acts());
        if let Some(reference) = hot.map(|it| it.reference().temperature()) {
            let times = reference / self.oscillator.temperature();
            reason = format!(
                "{reason}; the initial condition lies so far above the stationary law that p is taken against one {times:.1} \
                 times as hot"
            );
        }
        recipe.reason = reason;
        let (initial, times, memory) = (self.initial, self.times, self.settings.max_memory);
        recipe.cost = cost::foreseen(&recipe, self.oscillator, initial, times, memory)?;
        Ok(recipe)
    }

    /// Refuses what no solver does under a drive or an envelope.
    fn check_forcing(&self) -> Result<()> {
        if self.forcing.is_none() && self.period.is_none() {
            return Ok(());
        }
        let it = self.settings;
        if let Some(TransientMethod::FiniteVolume) = it.method {
            let accepted =
                "\"flow_map\" or \"auto\" with [excitation]: finite volumes know no force in time";
            let value = "\"finite_volume\"";
            return Err(Error::invalid("method.transient", value, accepted));
        }
        for (key, asked) in [
            ("method.drift", it.drift.is_some()),
            ("method.time", it.time.is_some()),
        ] {
            if asked {
                let accepted =
                    "\"auto\" with [excitation]: the flow map, which is taken then, has neither";
                return Err(Error::invalid(key, "a scheme of finite volumes", accepted));
            }
        }
        if !self.oscillator.contact().is_confining() && !self.stays_on_moving_grid() {
            let accepted = "\"auto\" and no method.cells with [excitation] and a contact law that never confines";
            return Err(Error::invalid("method.transient", "\"flow_map\"", accepted));
        }
        Ok(())
    }

    /// The generator on the mesh expected, or on the first finer one on which the advection scheme carries the stationary
    /// law, if cells are the program's choice.
    fn carried(&self, draft: &Recipe) -> Result<Generator> {
        let on = |k: usize| {
            let r = draft.expected + k as f64;
            let rung = draft.rung(self.oscillator, self.initial, self.until(), r)?;
            let limit = self.settings.max_memory;
            rung.layout.count_within(self.oscillator, 1.0, limit)?;
            let mesh = rung.layout.mesh(self.oscillator, 1.0)?;
            Generator::new(self.oscillator, &mesh, rung.drift())
        };
        draft.layout.carried(on)
    }
}
