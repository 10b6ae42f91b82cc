//! What a transient is computed with: the settings of the scene, and the method, scheme, domain, cells and step
//! where they leave it open.

use super::cost;
use super::recipe::{self, FirstGrid, Recipe, Scheme};
use crate::error::{Error, Result, positive};
use crate::fokker_planck::budget::{self, Cost, Factors, timing};
use crate::fokker_planck::density::Density;
use crate::fokker_planck::domain::Domain;
use crate::fokker_planck::flow_map::FlowMap;
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::generator::Generator;
use crate::fokker_planck::layout::{self, COARSE, Cells, Layout};
use crate::fokker_planck::mesh::{Axis, Mesh};
use crate::fokker_planck::settings::{Settings, TimeScheme, TransientMethod};
use crate::initial::Initial;
use crate::oscillator::Oscillator;

/// Damping ratio up to which the flow map is taken for all its steps may be. Up to the second, where its
/// errors are known ([`flow_map::Settings::to`]), it is taken if the steps that they ask for are not too short
/// for the cells.
///
/// [`flow_map::Settings::to`]: crate::fokker_planck::flow_map::Settings::to
const WEAK: f64 = 0.2;
const KNOWN: f64 = 2.0;

/// The largest error estimate of a flow map over the loss of contact on five cells per thermal deviation, of order 3 in
/// their number (T = 0.63, zeta = 0.005, a start of half the width of the law at q = 1): as much once, and ten
/// times as much where so many outputs are asked for that some see the moments that are hard.
const KINK: f64 = 1.4e-3;
const OUTPUTS: f64 = 20.0;
/// Probability of flight and damping ratio from which on, and up to which, that is so.
const IN_FLIGHT: f64 = 0.01;
const UNDAMPED: f64 = 0.05;
/// The part of the tolerance aimed at; how many times finer the first cells are made for it at most; and from
/// how many times on finite volumes, which keep the loss of contact on a face, take over.
const KINK_SHARE: f64 = 0.6;
const FINEST: f64 = 3.0;
const TOO_FINE: f64 = 6.0;

/// How many times finer than for the stationary law a mesh may be for the sake of its initial condition: beyond, a
/// moving local grid carries it until it is wide enough. That takes 5 ms per unit of time at a tolerance of 1e-3, and
/// refining 1.5 times in both directions doubles the work.
const REFINED: f64 = 1.5;

/// The refinements tried for cells of the program's own choice that an advection scheme cannot carry.
const STEEPER: f64 = 1.25;
const STEEPER_TRIES: usize = 8;

/// What is asked of a transient.
#[derive(Clone, Copy)]
struct Question<'a> {
    oscillator: &'a Oscillator,
    initial: &'a Initial,
    times: &'a [f64],
    settings: &'a Settings,
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
        let question = Question {
            oscillator,
            initial,
            times,
            settings,
        };
        question.recipe()
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
        let (layout, first_grid, neglected) = self.laid_out()?;
        let draft = Recipe {
            scheme: Scheme::FlowMap,
            first_grid,
            layout,
            neglected,
            finer: [1.0; 2],
            step: self.settings.step,
            limited_by_mesh: false,
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
                "in a law that leaves every box a small mesh moves with the density for good";
            return self.by_flow_map(draft, reason.into());
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
            None if asked => return self.by_volumes(draft, ""),
            None if zeta <= KNOWN && self.finer_at_kink(&draft)? > TOO_FINE => {
                let beside = "the loss of contact would take a flow map more than six times the cells along \
                              either axis; ";
                return self.by_volumes(draft, beside);
            }
            None if zeta <= WEAK => {
                format!(
                    "zeta = {zeta} <= {WEAK}: weak damping lets the exact motion take long steps"
                )
            }
            None if zeta <= KNOWN && !self.is_limited_by_mesh(&draft)? => {
                let step = draft.flow_map(self.oscillator, 1.0)?.step;
                format!(
                    "zeta = {zeta} <= {KNOWN}: the exact motion takes steps of {step:.2}, and the cells allow them"
                )
            }
            Some(TransientMethod::FiniteVolume) | None => return self.by_volumes(draft, ""),
        };
        let mut recipe = self.by_flow_map(draft.clone(), reason)?;
        if self.settings.method.is_none() {
            // One on finer cells than the density asks for would not be worth the change.
            let volumes = self.by_volumes(draft, "").ok();
            let volumes = volumes.filter(|it| it.layout == recipe.layout);
            recipe.otherwise = volumes.map(Box::new);
        }
        Ok(recipe)
    }

    fn by_flow_map(&self, draft: Recipe, reason: String) -> Result<Recipe> {
        let needed = self.finer_at_kink(&draft)?;
        let recipe = Recipe {
            finer: [needed.min(FINEST), needed.min(TOO_FINE)],
            // A mesh that cannot be made says so in the first run.
            limited_by_mesh: self.is_limited_by_mesh(&draft).unwrap_or(false),
            ..draft
        };
        self.costed(recipe, reason)
    }

    fn by_volumes(&self, draft: Recipe, beside: &str) -> Result<Recipe> {
        let (generator, layout) = self.carried(&draft)?;
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
        // Where finite volumes were taken because of the loss of contact, moments are hard for them too.
        let hard = self.finer_at_kink(&draft)? > TOO_FINE;
        let recipe = Recipe {
            scheme: Scheme::Volumes(time),
            layout,
            finer: [1.0, if hard { 2.0 } else { 1.0 }],
            ..draft
        };
        self.costed(recipe, format!("{beside}{why_drift}; {why_time}"))
    }

    /// The recipe with its foreseen cost.
    fn costed(&self, mut recipe: Recipe, mut reason: String) -> Result<Recipe> {
        reason += match recipe.first_grid {
            FirstGrid::Moving => {
                "; the start is too narrow for a mesh, so a small mesh moves with it at first"
            }
            FirstGrid::Falling(_) => {
                "; the start lies far beyond the stationary law, so a small mesh moves with it until friction has \
                 brought it in"
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

    /// Domain and cells, what holds the initial condition, and the probability that the domain may leave out.
    fn laid_out(&self) -> Result<(Layout, FirstGrid, f64)> {
        let Self {
            oscillator,
            initial,
            settings,
            ..
        } = *self;
        let (drift, tolerance) = (self.drift(), settings.tolerance);
        let thermal = layout::thermal_widths(oscillator, tolerance);
        let laid_out = |domain: Domain| Layout {
            domain,
            cells: Cells::of(settings, thermal),
            drift,
        };
        if let Some(cells) = settings.cells {
            let factors = settings.time.map_or(Factors::None, Factors::of);
            let needed = budget::memory(cells, drift, factors);
            budget::check_memory(needed, cells, true, settings.max_memory)?;
        }
        // Cells as narrow as the initial condition asks for.
        let held = |domain: Domain| match *initial {
            Initial::Gaussian { deviation, .. } => {
                laid_out(domain).narrowed(layout::start_widths(deviation, tolerance))
            }
            _ => laid_out(domain),
        };
        if !oscillator.contact().is_confining() {
            let neglected = settings
                .neglected
                .unwrap_or_else(|| layout::neglected(tolerance));
            let domain = Domain::swept(oscillator, initial, self.until(), neglected)?;
            if !self.stays_on_moving_grid() {
                return Ok((held(domain), FirstGrid::Mesh, neglected));
            }
            let layout = Layout {
                drift: Drift::Order8,
                ..laid_out(domain)
            };
            return Ok((layout, FirstGrid::MovingForGood, neglected));
        }
        let (neglected, domain) = layout::truncated(oscillator, initial, settings)?;
        let fits = match *initial {
            Initial::Stationary => true,
            Initial::Rest => false,
            // Exact cell masses hold any initial condition.
            Initial::Gaussian { .. } if settings.cells.is_some() && drift == Drift::Upwind => true,
            Initial::Gaussian { mean, deviation } if settings.cells.is_some() => {
                self.is_held(&laid_out(domain), mean, deviation)?
            }
            Initial::Gaussian { deviation, .. } => {
                let start = layout::start_widths(deviation, tolerance);
                let narrow = |(thermal, start): (f64, f64)| start * REFINED < thermal;
                !thermal.into_iter().zip(start).any(narrow)
            }
        };
        let grid = match self.falling(neglected)? {
            Some(grid) => grid,
            None if fits => return Ok((held(domain), FirstGrid::Mesh, neglected)),
            None => FirstGrid::Moving,
        };
        let domain = match initial {
            Initial::Gaussian { .. } => {
                recipe::domain(oscillator, initial, self.until(), grid, neglected)?
            }
            _ => domain,
        };
        Ok((laid_out(domain), grid, neglected))
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
        // Refused in the user's own numbers.
        layout.mesh(self.oscillator, 1.0)?;
        let mesh = layout.mesh(self.oscillator, COARSE)?;
        let width = |axis: &Axis, x: f64| axis.at(axis.locate(x)).1;
        let widths = [width(&mesh.q, mean[0]), width(&mesh.v, mean[1])];
        let narrow = |(d, w): (f64, f64)| d < 1.2 * Density::NARROWEST * w;
        Ok(!deviation.into_iter().zip(widths).any(narrow))
    }

    /// Whether a run never leaves its moving local grid, and has no other mesh: a law that leaves every domain keeps
    /// the shape of a density for good. A Gaussian initial condition may ask for a domain instead.
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

    /// Whether the steps that a tolerance asks of the flow map are too short for the cells, and follow them.
    fn is_limited_by_mesh(&self, draft: &Recipe) -> Result<bool> {
        let zeta = self.oscillator.zeta();
        if zeta <= WEAK {
            return Ok(false);
        }
        let mesh = draft.mesh(self.oscillator, 1.0)?;
        let step = draft.flow_map(self.oscillator, 1.0)?.step;
        Ok(zeta > KNOWN || step < FlowMap::shortest_step(self.oscillator, &mesh))
    }

    /// How many times finer the cells of a flow map should be because of the loss of contact.
    fn finer_at_kink(&self, draft: &Recipe) -> Result<f64> {
        let (oscillator, tolerance) = (self.oscillator, self.settings.tolerance);
        let contact = oscillator.contact();
        let (Some(loss), Initial::Gaussian { mean, deviation }) =
            (contact.loss_point(), self.initial)
        else {
            return Ok(1.0);
        };
        if draft.layout.is_given() || !contact.is_confining() || draft.opens_on_moving_grid() {
            return Ok(1.0);
        }
        let law = oscillator.displacement_law()?;
        let start = 0.5 * libm::erfc((mean[0] - loss) / (deviation[0] * std::f64::consts::SQRT_2));
        let flight = law.ln_tail_below(loss).value.exp().max(start);
        let seen = 1.0 + 9.0 * (self.times.len() as f64 / OUTPUTS).min(1.0);
        let weight = seen * (flight / IN_FLIGHT).min(1.0) * (UNDAMPED / oscillator.zeta()).min(1.0);
        let cells = layout::cells_per_deviation(tolerance) / 5.0;
        let needed = (weight * KINK / (KINK_SHARE * tolerance)).cbrt() / cells;
        Ok(needed.max(1.0))
    }

    /// The generator on the first mesh, and the layout: with finer cells, if they are the program's choice and the
    /// advection scheme does not carry the stationary law on those chosen.
    fn carried(&self, draft: &Recipe) -> Result<(Generator, Layout)> {
        let on = |layout: &Layout, finer: f64| {
            let limit = self.settings.max_memory;
            let mesh = layout.mesh_within(self.oscillator, finer, Factors::None, limit)?;
            Generator::new(self.oscillator, &mesh, layout.drift)
        };
        let mut layout = draft.layout;
        let mut found = on(&layout, 1.0);
        for _ in 0..STEEPER_TRIES {
            if layout.is_given() || !matches!(found, Err(Error::Mesh { .. })) {
                break;
            }
            layout = layout.refined(STEEPER);
            // The coarse run has to carry it too.
            found = on(&layout, COARSE).and_then(|_| on(&layout, 1.0));
        }
        Ok((found?, layout))
    }
}

/// The mesh of a run until `until`, `finer` times as fine as the settings ask for; for an initial condition that opens
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
    };
    question.laid_out()?.0.mesh(oscillator, finer)
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
    // 1.2 stages per unit of F dt + s dt at the longest step, up to twice that in a tall box.
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
