//! A plan: what a scene needs computed, and nothing else. Data that can be printed, costed and tested
//! before anything runs.

mod answers;
mod joins;
mod limits;
mod recipes;
mod run;
mod stage;
mod watch;

pub use stage::{Part, Refusal, Stage};
pub use watch::Watch;

pub use crate::budget::{Cost, StopFlag};
use crate::clock::Clock;
use crate::error::{Error, Result};
use crate::fokker_planck::Settings;
#[doc(hidden)]
pub use crate::format::{bytes, seconds};
use crate::scene::Scene;
use recipes::Recipe;
use std::time::Instant;

/// The stages of a scene: optional parts, each there only because an output needs it.
///
/// ```
/// use vibroimpact::{contact::ContactLaw, oscillator::Oscillator, plan::{Part, Plan}, scene::Scene};
/// let mut scene = Scene::new(Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3)?);
/// scene.outputs.decay_rates = 4;
/// let plan = Plan::of(&scene)?; // computes nothing yet
/// assert!(plan.has(Part::DecayRates) && !plan.has(Part::Transient));
/// # Ok::<(), vibroimpact::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Plan {
    /// The scene as it was given.
    given: Scene,
    /// The same with every time dimensionless: what is computed.
    scene: Scene,
    clock: Clock,
    settings: Settings,
    stages: Vec<Stage>,
    /// One a stage; None for one that is refused before it is known.
    recipes: Vec<Option<Recipe>>,
    /// Threads that its times are foreseen on.
    threads: usize,
    /// Seconds that it took to make, which a run counts as its own: many cells of a scene take some.
    planning: f64,
}

impl Plan {
    /// The plan of a scene. Computes nothing but sizes.
    ///
    /// # Errors
    /// Whatever [`Scene::check`] finds, cells of the scene that do not fit its memory, and stages none of which fits.
    pub fn of(scene: &Scene) -> Result<Self> {
        scene.check()?;
        let start = Instant::now();
        let given = scene;
        let scene = &given.dimensionless();
        let clock = given.clock();
        let mut plan = Self {
            given: given.clone(),
            scene: scene.clone(),
            clock,
            settings: scene.settings(),
            stages: Vec::new(),
            recipes: Vec::new(),
            threads: rayon::current_num_threads(),
            planning: 0.0,
        };
        // A time that is short in its unit may be too long in dimensionless time.
        scene.check().map_err(|error| plan.as_typed(error))?;
        for part in Part::ALL {
            let needed_by = needed_by(part, scene);
            if needed_by.is_empty() {
                continue;
            }
            let (method, cost, recipe, checked) = match plan.foresee(part) {
                Ok((method, cost, recipe)) => {
                    let checked = plan.check_cost(part, &cost);
                    (clock.retold(&method), cost, Some(recipe), checked)
                }
                Err(error) => (String::new(), Cost::default(), None, Err(error)),
            };
            let refusal = match checked.map_err(|error| plan.as_typed(error)) {
                Ok(()) => None,
                // The cells of a scene are its own mistake, and that of every stage.
                Err(error @ Error::Mesh { .. }) if scene.method.cells.is_some() => {
                    return Err(error);
                }
                Err(error) => Some(Refusal::of(error)?),
            };
            plan.stages.push(Stage {
                part,
                needed_by,
                method,
                cost,
                refusal,
            });
            plan.recipes.push(recipe);
        }
        let mut refusals = plan.stages.iter().map(|it| it.refusal.clone());
        if let Some(Some(first)) = refusals.next()
            && refusals.all(|it| it.is_some())
        {
            return Err(first.error());
        }
        plan.planning = start.elapsed().as_secs_f64();
        Ok(plan)
    }

    /// The scene, its times in its own unit.
    #[expect(clippy::misnamed_getters)] // what is computed has dimensionless times
    pub fn scene(&self) -> &Scene {
        &self.given
    }

    /// Threads that its times are foreseen on: those that it was made on.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// The stages in the order they run.
    pub fn stages(&self) -> &[Stage] {
        &self.stages
    }

    /// Whether the plan has this part.
    pub fn has(&self, part: Part) -> bool {
        self.stages.iter().any(|stage| stage.part == part)
    }

    /// The times of moments and densities: one run passes through both.
    fn times(&self) -> Vec<f64> {
        let outputs = &self.scene.outputs;
        let mut times = [outputs.moments_at.list(), outputs.density_at.list()].concat();
        times.sort_by(f64::total_cmp);
        times.dedup();
        times
    }
}

/// The keys that ask for a part.
fn needed_by(part: Part, scene: &Scene) -> Vec<&'static str> {
    let it = &scene.outputs;
    let sampled = scene.monte_carlo.is_some();
    let (paths, records) = (scene.wants_paths(), scene.wants_records());
    let crossings = ("outputs.crossings", it.crossings.is_some());
    let first_loss = ("outputs.first_loss", it.first_loss.is_some());
    let passage = ("outputs.first_passage", it.first_passage.is_some());
    let spectrum = ("outputs.spectrum", it.spectrum.is_some());
    let by_sampling = |(key, asked): (&'static str, bool)| vec![(key, asked && sampled)];
    let keys = match part {
        Part::Stationary => vec![("outputs.stationary", it.stationary)],
        Part::Crossings => vec![crossings],
        Part::FirstLoss => vec![first_loss],
        Part::FirstPassage => vec![passage],
        Part::Transient => vec![
            ("outputs.moments_at", !it.moments_at.is_empty()),
            ("outputs.density_at", !it.density_at.is_empty()),
        ],
        Part::Reach => vec![("outputs.reach", it.reach.is_some())],
        Part::Periodic => vec![("outputs.periodic", it.periodic.is_some())],
        Part::Response => vec![("outputs.response", it.response.is_some())],
        Part::Steady => vec![("outputs.steady", it.steady)],
        Part::DecayRates => vec![("outputs.decay_rates", it.decay_rates > 0)],
        Part::Spectrum => vec![spectrum],
        Part::Series => by_sampling(spectrum),
        Part::MonteCarlo => vec![("monte_carlo", paths)],
        Part::FirstLossPaths => by_sampling(first_loss),
        Part::FirstPassagePaths => by_sampling(passage),
        Part::Records => vec![
            ("monte_carlo", records && !paths),
            (crossings.0, records && crossings.1),
            ("monte_carlo.duration", records && paths && !crossings.1),
        ],
    };
    let asked = keys.into_iter().filter(|(_, asked)| *asked);
    asked.map(|(key, _)| key).collect()
}
