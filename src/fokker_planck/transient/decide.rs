//! What a transient is computed with: the settings of the scene, and the method, scheme, domain, cells and step
//! where they leave it open.

use super::cost;
use super::recipe::{self, FirstGrid, Recipe, Rung, Scheme};
use crate::error::{Error, Result, positive};
use crate::fokker_planck::budget::{self, Cost, Factors, timing};
use crate::fokker_planck::domain::Domain;
use crate::fokker_planck::flow_map::FlowMap;
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::forcing::Forcing;
use crate::fokker_planck::generator::Generator;
use crate::fokker_planck::layout::{self, Cells, Layout};
use crate::fokker_planck::mesh::{Axis, Mesh};
use crate::fokker_planck::settings::{Settings, TimeScheme, TransientMethod};
use crate::format::num;
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use std::sync::Arc;

/// Damping ratio up to which the flow map is taken: its errors are known that far ([`flow_map::Settings::to`]), and its
/// steps are longer than those of the cells.
///
/// [`flow_map::Settings::to`]: crate::fokker_planck::flow_map::Settings::to
const KNOWN: f64 = 2.0;

/// Rungs tried for cells of the program's own choice that an advection scheme cannot carry.
pub(super) const STEEPER_TRIES: usize = 8;

/// The rung expected for a tolerance.
fn expected(tolerance: f64) -> f64 {
    (2.5 + 1.5 * (1e-2 / tolerance).log10())
        .round()
        .clamp(2.0, 9.0)
}

/// Cells of the scene, on the coarsest of three rungs, that a deviation of the initial condition is to span: on fewer a
/// moving local grid carries it first.
const HELD: f64 = 1.0;

/// Refuses friction too strong for the one solver that knows a drive.
fn check_friction(oscillator: &Oscillator) -> Result<()> {
    let zeta = oscillator.zeta();
    if zeta <= KNOWN {
        return Ok(());
    }
    let accepted = format!("at most {KNOWN} with [excitation]; [monte_carlo] takes any");
    Err(Error::invalid("oscillator.zeta", num(zeta), accepted))
}

/// What is asked of a transient.
#[derive(Clone, Copy)]
struct Question<'a> {
    oscillator: &'a Oscillator,
    initial: &'a Initial,
    times: &'a [f64],
    settings: &'a Settings,
    forcing: Option<&'a Arc<Forcing>>,
    /// The period of a law that lasts.
    period: Option<f64>,
}

impl Recipe {
    /// The recipe for a transient through `times`, ascending. Lays out the mesh and takes no step on it.
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
        let question = Question {
            oscillator,
            initial,
            times,
            settings,
            forcing: forcing.as_ref(),
            period: None,
        };
        question.recipe()
    }

    /// The recipe for the law that lasts under the drive of the settings, and the times of so many equal phases of its period.
    ///
    /// # Errors
    /// As [`Recipe::of`]; [`Error::Invalid`] without a drive or a phase.
    pub(crate) fn lasting(
        oscillator: &Oscillator,
        phases: usize,
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
        let forcing = Forcing::lasting(oscillator, &settings.excitation)?.map(Arc::new);
        let phase = |k: usize| drive.period() * k as f64 / phases as f64;
        let times: Vec<f64> = (0..phases).map(phase).collect();
        let question = Question {
            oscillator,
            initial: &Initial::Stationary,
            times: &times,
            settings,
            forcing: forcing.as_ref(),
            period: Some(drive.period()),
        };
        Ok((question.recipe()?, times))
    }
}

impl Question<'_> {
    fn until(&self) -> f64 {
        self.times.last().copied().unwrap_or(0.0)
    }

    fn recipe(&self) -> Result<Recipe> {
        if let Some(step) = self.settings.step {
            positive("method.step", step)?;
        }
        self.check_forcing()?;
        let (layout, first_grid) = self.laid_out()?;
        let draft = Recipe {
            scheme: Scheme::FlowMap,
            first_grid,
            forcing: self.forcing.cloned(),
            period: self.period,
            expected: self.last_rung(&layout)?,
            layout,
            neglected: self.settings.neglected,
            step: self.settings.step,
            moments: self.settings.moments.clone(),
            tolerance: self.settings.tolerance,
            cost: Cost {
                cells: [0; 2],
                steps: 0,
                memory: 0,
                seconds: 0.0,
            },
            reason: String::new(),
            otherwise: None,
        };
        if first_grid == FirstGrid::MovingForGood {
            let reason =
                "in a law that leaves every domain a small mesh moves with the density for good";
            return self.costed(draft, reason.into());
        }
        let asked = self.settings.drift.is_some() || self.settings.time.is_some();
        let zeta = self.oscillator.zeta();
        let reason = match self.settings.method {
            Some(TransientMethod::FlowMap) if asked => {
                let accepted =
                    "\"finite_volume\" with method.drift or method.time: the flow map has neither";
                return Err(Error::invalid("method.transient", "\"flow_map\"", accepted));
            }
            Some(TransientMethod::FlowMap) => "the scene asks for it".to_string(),
            None if !asked && zeta <= KNOWN => {
                format!("zeta = {zeta} <= {KNOWN}: the exact motion takes long steps")
            }
            Some(TransientMethod::FiniteVolume) | None => return self.by_volumes(draft),
        };
        self.check_step(&draft)?;
        let otherwise = self.otherwise(&draft)?;
        let recipe = self.costed(draft, reason)?;
        Ok(Recipe {
            otherwise: otherwise.map(Box::new),
            ..recipe
        })
    }

    /// What takes over from a flow map that does not hold the scene: a moving local grid first, on cells of the scene; finite
    /// volumes where the method is free.
    fn otherwise(&self, draft: &Recipe) -> Result<Option<Recipe>> {
        let gaussian = matches!(self.initial, Initial::Gaussian { .. });
        if draft.layout.is_given() && draft.first_grid == FirstGrid::Mesh && gaussian {
            let first_grid = FirstGrid::Moving;
            let neglected = self.settings.neglected;
            let neglected = neglected.unwrap_or_else(|| Rung::neglected(draft.expected));
            let (oscillator, initial) = (self.oscillator, self.initial);
            if !oscillator.contact().is_confining() {
                return Ok(None);
            }
            let domain = recipe::domain(
                (oscillator, self.forcing.map(|it| &**it)),
                initial,
                self.until(),
                first_grid,
                neglected,
            )?;
            return Ok(Some(Recipe {
                first_grid,
                layout: Layout {
                    domain,
                    ..draft.layout
                },
                reason: "a small mesh moves with the initial condition at first".into(),
                ..draft.clone()
            }));
        }
        let free =
            self.settings.method.is_none() && self.forcing.is_none() && self.period.is_none();
        Ok(free.then(|| Recipe {
            scheme: Scheme::Volumes(TimeScheme::Imex),
            reason: "finite volumes of order 8, steps bound by transport".into(),
            ..draft.clone()
        }))
    }

    /// Refuses a step of the scene that is too short for the flow map on the last mesh.
    fn check_step(&self, draft: &Recipe) -> Result<()> {
        let Some(step) = draft.step else {
            return Ok(());
        };
        let rung = draft.rung(self.oscillator, self.initial, self.until(), draft.expected)?;
        let reference = self.forcing.map_or(self.oscillator, |it| it.reference());
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
            None => time_scheme(
                self.oscillator,
                &generator,
                self.settings.tolerance,
                self.until(),
            ),
        };
        let recipe = Recipe {
            scheme: Scheme::Volumes(time),
            ..draft
        };
        self.costed(recipe, format!("{why_drift}; {why_time}"))
    }

    /// The rung at which the tolerance is expected, or that of the scene's cells.
    fn last_rung(&self, layout: &Layout) -> Result<f64> {
        let Cells::Given(cells) = layout.cells else {
            return Ok(expected(self.settings.tolerance));
        };
        let open = Layout {
            cells: Cells::Widths(self.widths()),
            ..*layout
        };
        let single = open.count(self.oscillator, 1.0)?;
        let margin = 2 * layout.drift.margin();
        let inner = |n: usize| n.saturating_sub(margin).max(1) as f64;
        let each = cells.into_iter().zip(single);
        let finer = each.map(|(n, single)| inner(n) / inner(single));
        let finer = finer.fold(f64::INFINITY, f64::min);
        Ok(((finer / recipe::FIRST).ln() / recipe::RATIO.ln()).clamp(0.0, 10.0))
    }

    /// The recipe with its foreseen cost.
    fn costed(&self, mut recipe: Recipe, mut reason: String) -> Result<Recipe> {
        reason += match recipe.first_grid {
            FirstGrid::Moving => {
                "; the initial condition is too narrow for a mesh, so a small mesh moves with it at first"
            }
            FirstGrid::Falling(_) => {
                "; the initial condition lies far beyond the stationary law, so a small mesh moves with it until \
                 friction has brought it in"
            }
            FirstGrid::Mesh | FirstGrid::MovingForGood => "",
        };
        recipe.reason = reason;
        recipe.cost = cost::foreseen(
            &recipe,
            self.oscillator,
            self.initial,
            self.times,
            self.settings.max_memory,
        )?;
        Ok(recipe)
    }

    /// How g is carried across faces: finite volumes of order 8, unless the scene asks for something else.
    fn drift(&self) -> Drift {
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
    fn deviations(&self) -> [f64; 2] {
        let Some(forcing) = self.forcing else {
            return layout::deviations(self.oscillator);
        };
        layout::deviations(forcing.noise()).map(|it| it * forcing.narrowing())
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
            return Err(Error::invalid(
                "method.transient",
                "\"finite_volume\"",
                accepted,
            ));
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

    /// Widths of cells in q and v, one a deviation of the stationary law or [`recipe::START`] of one of the initial condition.
    fn widths(&self) -> [f64; 2] {
        let thermal = self.deviations();
        match *self.initial {
            Initial::Gaussian { deviation, .. } => {
                [0, 1].map(|k| thermal[k].min(deviation[k] / recipe::START))
            }
            _ => thermal,
        }
    }

    /// Domain and cells of the rung expected, and what holds the initial condition.
    fn laid_out(&self) -> Result<(Layout, FirstGrid)> {
        let Self {
            oscillator,
            initial,
            settings,
            ..
        } = *self;
        let drift = self.drift();
        let neglected = settings
            .neglected
            .unwrap_or_else(|| Rung::neglected(expected(settings.tolerance)));
        let forcing = self.forcing.map(|it| &**it);
        let thermal = self.deviations();
        let laid_out = |domain: Domain, widths: [f64; 2]| Layout {
            domain,
            cells: Cells::of(settings, widths),
            drift,
        };
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
                // Exact cell masses hold any initial condition.
                Initial::Gaussian { .. } if settings.cells.is_some() && drift == Drift::Upwind => {
                    true
                }
                Initial::Gaussian { mean, deviation } if settings.cells.is_some() => {
                    let domain = recipe::domain(
                        (oscillator, forcing),
                        initial,
                        self.until(),
                        FirstGrid::Mesh,
                        neglected,
                    )?;
                    self.is_held(&laid_out(domain, thermal), mean, deviation)?
                }
                Initial::Gaussian { .. } => {
                    let narrow = |(thermal, width): (f64, f64)| width * recipe::REFINED < thermal;
                    !thermal.into_iter().zip(self.widths()).any(narrow)
                }
            };
            if fits {
                FirstGrid::Mesh
            } else {
                FirstGrid::Moving
            }
        };
        let until = self.until();
        let domain = recipe::domain((oscillator, forcing), initial, until, first_grid, neglected)?;
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
        let centre = law.expect(|q| q).value;
        let spread = law.expect(|q| (q - centre).powi(2)).value.sqrt();
        let own = [spread, oscillator.temperature().sqrt()];
        let own = domain.amplitude(oscillator, [centre, 0.0], own).max(1.0);
        let most = recipe::BEYOND * own;
        let beyond = domain.amplitude(oscillator, mean, deviation) > most;
        Ok(beyond.then_some(FirstGrid::Falling(most)))
    }

    /// Whether cells of the scene hold a Gaussian, in the coarse run too.
    fn is_held(&self, layout: &Layout, mean: [f64; 2], deviation: [f64; 2]) -> Result<bool> {
        let mesh = layout.mesh(self.oscillator, 1.0 / recipe::RATIO.powi(2))?;
        let width = |axis: &Axis, x: f64| axis.at(axis.locate(x)).1;
        let widths = [width(&mesh.q, mean[0]), width(&mesh.v, mean[1])];
        let narrow = |(d, w): (f64, f64)| d < HELD * w;
        Ok(!deviation.into_iter().zip(widths).any(narrow))
    }

    /// Whether a run never leaves its moving local grid, and has no other mesh: a law that leaves every domain keeps
    /// a density near a Gaussian for good. A Gaussian initial condition may ask for a domain instead.
    fn stays_on_moving_grid(&self) -> bool {
        let it = self.settings;
        let asked =
            it.method.is_some() || it.drift.is_some() || it.time.is_some() || it.cells.is_some();
        match self.initial {
            Initial::Rest => true,
            Initial::Gaussian { .. } => !asked,
            Initial::Stationary => false,
        }
    }

    /// The generator on the mesh expected, or on the first finer one on which the advection scheme carries the stationary
    /// law, if cells are the program's choice.
    fn carried(&self, draft: &Recipe) -> Result<Generator> {
        let on = |k: usize| {
            let rung = draft.rung(
                self.oscillator,
                self.initial,
                self.until(),
                draft.expected + k as f64,
            )?;
            let limit = self.settings.max_memory;
            let mesh = rung
                .layout
                .mesh_within(self.oscillator, 1.0, Factors::None, limit)?;
            Generator::new(self.oscillator, &mesh, rung.drift())
        };
        let mut found = on(0);
        for k in 1..STEEPER_TRIES {
            if draft.layout.is_given() || !matches!(found, Err(Error::Mesh { .. })) {
                break;
            }
            found = on(k);
        }
        found
    }
}

/// The mesh of a run until `until`, `finer` times as fine as the settings ask for; for an initial condition that starts
/// on a moving local grid, the mesh that takes over without regard to how narrow it is.
///
/// # Errors
/// Those of the domain and of the axes; [`Error::Mesh`] and [`Error::Invalid`] for cells beyond what can be
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
    let question = Question {
        oscillator,
        initial,
        times: &[until],
        settings,
        forcing: None,
        period: None,
    };
    let layout = question.laid_out()?.0;
    let finer = finer
        * if layout.is_given() {
            1.0
        } else {
            layout::cells_per_deviation(settings.tolerance)
        };
    layout.mesh(oscillator, finer)
}

/// The scheme in time that costs least on this mesh, with the reason. Costs are counted in stages of the
/// explicit scheme; the measurements are those of tests/time.rs.
pub fn time_scheme(
    oscillator: &Oscillator,
    generator: &Generator,
    tolerance: f64,
    until: f64,
) -> (TimeScheme, String) {
    if generator.drift() == Drift::Upwind {
        let reason = "backward Euler keeps upwind drift positive";
        return (TimeScheme::BackwardEuler, reason.into());
    }
    let (transport, diffusion) = generator.radii();
    // 1.2 stages per unit of F dt + s dt at the longest step, up to twice that in a tall domain.
    let tall = 1.0 + (0.1 * diffusion / transport).min(1.0);
    let explicit = 1.2 * (transport + 0.5 * diffusion * tall) * until;
    // Bound by transport, and while the initial condition is smoothed by accuracy: 15 steps per unit of time at
    // 1e-5, order 4.
    let accuracy = 15.0 * (1e-5 / tolerance).powf(0.25);
    let bound = transport / 3.8;
    let imex =
        timing::IMEX_STAGES * (until * bound + until.min(5.0) * (accuracy - bound).max(0.0) + 50.0);
    // About 60 steps and ten factorisations until the
    // step is that of the slow motion: 0.1 of its time 1 or 2 zeta at 1e-5, order 5.
    let finer = (1e-5 / tolerance).powf(0.2);
    let slow = 0.1 * (2.0 * oscillator.zeta()).max(1.0) / finer;
    let implicit =
        timing::RADAU_STAGES * (60.0 * finer + until / slow) + 10.0 * timing::RADAU_LU_STAGES;
    let costs = [
        (TimeScheme::Explicit, explicit),
        (TimeScheme::Imex, imex),
        (TimeScheme::Implicit, implicit),
    ];
    let (best, _) = costs.iter().fold(
        costs[0],
        |best, other| if other.1 < best.1 { *other } else { best },
    );
    let reason = format!(
        "{}: transport at a rate of {transport:.0}, friction and diffusion of {diffusion:.0} and steps of \
         {slow:.1e} for accuracy cost about {explicit:.1e} stages explicit, {imex:.1e} imex, \
         {implicit:.1e} implicit",
        best.name()
    );
    (best, reason)
}
