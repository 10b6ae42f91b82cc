//! A plan: what a scene needs computed, and nothing else. Data that can be printed, costed and tested
//! before anything runs.

mod run;
mod stage;
mod watch;

pub use stage::{Cost, Part, Stage};
pub use watch::Watch;

pub use crate::budget::StopFlag;
use crate::clock::Clock;
use crate::error::{Error, Result};
use crate::estimate::Estimate;
use crate::fokker_planck::{
    self, Eigenvalues, FirstPassage, Periodic, PeriodicLaw, Reach, Recipe, Resolvent,
    ResponseCurve, Settings, StationaryState, SteadyState,
};
use crate::format::{brief, num};
#[doc(hidden)]
pub use crate::format::{bytes, seconds};
use crate::moments::{Moment, Moments};
use crate::monte_carlo::{self, Ensemble, FirstLosses, Records, Samples, Sampling, Series};
use crate::scene::{self, MonteCarlo, ReachRequest, Scene, SpectrumRequest};
use crate::spectrum::Welch;
use crate::stationary::Stationary;
use std::f64::consts::PI;
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
    recipes: Recipes,
    stages: Vec<Stage>,
    /// Seconds that it took to make, which a run counts as its own: many cells of a scene take some.
    planning: f64,
}

/// How each question will be answered: decided once, printed and executed.
#[derive(Debug, Clone, Default)]
struct Recipes {
    stationary: Option<StationaryState>,
    transient: Option<Recipe>,
    periodic: Option<PeriodicLaw>,
    response: Option<ResponseCurve>,
    steady: Option<SteadyState>,
    eigenvalues: Option<Eigenvalues>,
    spectrum: Option<Resolvent>,
    first_passage: Option<FirstPassage>,
    reach: Option<Reach>,
    level: Option<StationaryState>,
    passage: Option<FirstPassage>,
    ensemble: Option<Ensemble>,
    series: Option<Series>,
    first_losses: Option<FirstLosses>,
    passages: Option<FirstLosses>,
    records: Option<Records>,
}

/// Samples of a segment of Welch's method, averages and segments a record: the first two are the
/// paper's; records of five segments share few samples and are many enough for a standard error.
const WELCH_SAMPLES: usize = 2048;
const WELCH_AVERAGES: usize = 400;
const WELCH_SEGMENTS: usize = 5;

/// Keys of a scene under which times stand.
const TIMES: [&str; 9] = [
    "outputs.moments_at",
    "outputs.density_at",
    "outputs.first_loss",
    "outputs.first_passage",
    "outputs.crossings",
    "excitation.envelope",
    "monte_carlo.step",
    "monte_carlo.duration",
    "method.step",
];

/// Share of the tolerance that is left to the stationary value of what is reached.
const LEVEL: f64 = 0.05;

/// Steps beyond which a scene is taken for a slip of the pen.
const MOST_STEPS: u64 = 10_000_000_000;

impl Plan {
    /// The plan of a scene. Computes nothing but sizes.
    ///
    /// # Errors
    /// Whatever [`Scene::check`] finds, and sizes beyond the memory the scene allows.
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
            settings: Settings {
                excitation: scene.excitation.clone(),
                method: scene.method.transient,
                drift: scene.method.drift,
                time: scene.method.time,
                cells: scene.method.cells,
                step: scene.method.step,
                moments: scene.outputs.moments.clone(),
                tolerance: scene.accuracy.tolerance,
                neglected: None,
                max_memory: scene.accuracy.max_memory,
                max_seconds: scene.accuracy.max_seconds,
            },
            recipes: Recipes::default(),
            stages: Vec::new(),
            planning: 0.0,
        };
        // A time that is short in its unit may be too long in dimensionless time.
        scene.check().map_err(|error| plan.as_typed(error))?;
        for (part, keys) in asked(scene) {
            let keys = keys.into_iter().filter(|(_, asked)| *asked);
            let needed_by: Vec<&'static str> = keys.map(|(key, _)| key).collect();
            if needed_by.is_empty() {
                continue;
            }
            let cost = plan.cost(part).and_then(|cost| {
                plan.check_cost(part, &cost)?;
                Ok(cost)
            });
            let cost = cost.map_err(|error| plan.as_typed(error))?;
            plan.stages.push(Stage {
                part,
                needed_by,
                cost,
            });
        }
        plan.planning = start.elapsed().as_secs_f64();
        Ok(plan)
    }

    /// A stage that takes finer cells than the scene's for its error is refused by the scene's own; times as the scene
    /// has them.
    fn as_typed(&self, error: Error) -> Error {
        let clock = &self.clock;
        match (error, self.scene.method.cells) {
            (Error::Invalid { key, accepted, .. }, Some([q, v])) if key == "method.cells" => {
                Error::invalid(key, format!("[{q}, {v}]"), accepted)
            }
            (error, _) if clock.is_dimensionless() => error,
            (
                Error::Invalid {
                    key,
                    value,
                    accepted,
                },
                _,
            ) if TIMES.iter().any(|it| key.starts_with(it)) => {
                let value = match value.parse() {
                    Ok(tau) => num(clock.time(tau)),
                    Err(_) => value,
                };
                let accepted = format!(
                    "{accepted} (in dimensionless time, of which outputs.time_unit = \"{}\" is {})",
                    clock.unit().name(),
                    brief(clock.dimensionless(1.0))
                );
                Error::invalid(key, value, accepted)
            }
            (Error::Limit { key, limit, what }, _) => Error::Limit {
                key,
                limit,
                what: clock.retold(&what),
            },
            (error, _) => error,
        }
    }

    /// The scene, its times in its own unit.
    #[expect(clippy::misnamed_getters)] // what is computed has dimensionless times
    pub fn scene(&self) -> &Scene {
        &self.given
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

    /// What the scene says of sampling.
    fn sampling(&self) -> Sampling {
        let it = self.scene.monte_carlo.clone().unwrap_or_default();
        Sampling {
            paths: it.paths,
            duration: it.duration.unwrap_or(MonteCarlo::DURATION),
            seed: it.seed,
            scheme: it.scheme,
            step: it.step,
            excitation: self.scene.excitation.clone(),
            noise: match it.noise {
                scene::Noise::White => monte_carlo::Noise::White,
                scene::Noise::Cosines { cosines, band } => monte_carlo::Noise::Cosines {
                    count: cosines.try_into().unwrap_or(u32::MAX),
                    band,
                },
            },
            ..Sampling::default()
        }
    }

    // ---- the joins to the numerics: sizes here, calls in `compute` ----

    fn cost(&mut self, part: Part) -> Result<Cost> {
        let Scene {
            oscillator,
            initial,
            ..
        } = &self.scene;
        let (it, method) = match part {
            Part::Stationary | Part::Crossings if !oscillator.is_viscous() => {
                let recipe = StationaryState::of(oscillator, &self.settings)?;
                let mut cost = Cost::on_mesh(recipe.cost, StationaryState::WORDS.into());
                // What one stage has solved for serves the other.
                if self.recipes.stationary.replace(recipe).is_some() {
                    (cost.seconds, cost.steps) = (0.0, 0);
                }
                return Ok(cost);
            }
            Part::Stationary | Part::Crossings => {
                return Ok(Cost {
                    method: "closed form by adaptive quadrature".into(),
                    cells: None,
                    steps: 0,
                    memory_bytes: 1 << 16,
                    seconds: 1e-3,
                });
            }
            Part::MonteCarlo | Part::FirstLossPaths | Part::FirstPassagePaths | Part::Records => {
                return self.sample_cost(part);
            }
            Part::FirstPassage => {
                let passage = self.passage()?;
                let recipe = FirstPassage::of_level(oscillator, initial, passage, &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.passage = Some(recipe);
                cost
            }
            Part::FirstLoss => {
                let until = self.scene.outputs.first_loss.unwrap_or(0.0);
                let recipe = FirstPassage::of(oscillator, initial, until, &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.first_passage = Some(recipe);
                cost
            }
            Part::Series => return self.series_cost(),
            Part::Spectrum => {
                let until = self.scene.outputs.spectrum.map_or(0.0, |it| it.until);
                let recipe = Resolvent::of(oscillator, until, &self.settings);
                let cost = (recipe.cost, Resolvent::METHOD.to_string());
                self.recipes.spectrum = Some(recipe);
                cost
            }
            Part::Transient => {
                let recipe = Recipe::of(oscillator, initial, &self.times(), &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.transient = Some(recipe);
                cost
            }
            Part::Reach => self.reach_cost()?,
            Part::Periodic => {
                let phases = self.scene.outputs.periodic.unwrap_or(0);
                let recipe = PeriodicLaw::of(oscillator, (phases, Periodic::MAPS), &self.settings)?;
                let cost = (recipe.cost(), recipe.words());
                self.recipes.periodic = Some(recipe);
                cost
            }
            Part::Response => {
                let asked = self.scene.outputs.response;
                let frequencies = asked.map_or(Vec::new(), |it| it.frequencies());
                let recipe = ResponseCurve::of(oscillator, &frequencies, &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.response = Some(recipe);
                cost
            }
            Part::Steady => {
                let recipe = SteadyState::of(oscillator, &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.steady = Some(recipe);
                cost
            }
            Part::DecayRates => {
                let count = self.scene.outputs.decay_rates;
                let recipe = Eigenvalues::of(oscillator, count, &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.eigenvalues = Some(recipe);
                cost
            }
        };
        Ok(Cost::on_mesh(it, method))
    }

    /// The cost of the first time at a level, and of the stationary value that it is a fraction of.
    fn reach_cost(&mut self) -> Result<(fokker_planck::Cost, String)> {
        let ReachRequest { quantity, fraction } = self.reach()?;
        let Scene {
            oscillator,
            initial,
            ..
        } = &self.scene;
        let recipe = Reach::of((oscillator, initial), quantity, fraction, &self.settings)?;
        let mut cost = (recipe.cost, recipe.words());
        if oscillator.is_viscous() {
            reached(quantity, &Stationary::of(oscillator)?.moments())?;
        } else {
            // The law is solved for anew, as exactly as a level must be known.
            let settings = Settings {
                tolerance: LEVEL * self.settings.tolerance,
                cells: None,
                ..self.settings.clone()
            };
            let law = StationaryState::of(oscillator, &settings)?;
            cost.0.seconds += law.cost.seconds;
            self.recipes.level = Some(law);
        }
        self.recipes.reach = Some(recipe);
        Ok(cost)
    }

    /// The cost of paths.
    fn sample_cost(&mut self, part: Part) -> Result<Cost> {
        let Scene {
            oscillator,
            initial,
            outputs,
            ..
        } = &self.scene;
        let sampling = self.sampling();
        let (cost, method) = match part {
            Part::MonteCarlo => {
                let times = outputs.moments_at.list();
                let recipe = Ensemble::of(oscillator, initial, &times, &sampling)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.ensemble = Some(recipe);
                cost
            }
            Part::FirstLossPaths => {
                let until = outputs.first_loss.unwrap_or(0.0);
                let recipe = FirstLosses::of(oscillator, initial, until, &sampling)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.first_losses = Some(recipe);
                cost
            }
            Part::FirstPassagePaths => {
                let recipe =
                    FirstLosses::of_level(oscillator, initial, self.passage()?, &sampling)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.passages = Some(recipe);
                cost
            }
            _ => {
                let recipe = Records::of(oscillator, &sampling)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.records = Some(recipe);
                cost
            }
        };
        Ok(Cost::of_sample(cost, method))
    }

    /// What `outputs.reach` asks for.
    fn reach(&self) -> Result<ReachRequest> {
        let asked = self.scene.outputs.reach;
        asked.ok_or_else(|| Error::invalid("outputs.reach", "nothing", "a moment"))
    }

    /// Level, side and time of the first passage asked for.
    fn passage(&self) -> Result<(f64, scene::Side, f64)> {
        let asked = self.scene.outputs.first_passage;
        let it =
            asked.ok_or_else(|| Error::invalid("outputs.first_passage", "nothing", "a level"))?;
        Ok((it.level, it.side, it.until))
    }

    /// Welch's method as in the paper, section 5.3.2, and the records it needs.
    fn welch(&self) -> Result<(Welch, Samples)> {
        let request = self.scene.outputs.spectrum.unwrap_or(SpectrumRequest {
            until: 4.0,
            quantity: scene::Quantity::Force,
        });
        // Nyquist's frequency is twice the highest asked for: what aliases into the range lies beyond
        // three times that frequency.
        let spacing = 0.5 * PI / request.until;
        let welch = Welch::new(WELCH_SAMPLES, WELCH_SAMPLES / 2, spacing)?;
        let samples = welch.record_length(WELCH_SEGMENTS);
        let asked = self.scene.monte_carlo.as_ref().and_then(|it| it.duration);
        let wanted = self.scene.wants_records();
        let duration = asked.or(wanted.then_some(MonteCarlo::DURATION));
        // As long as the long records, if there are any.
        let records = duration.map_or((WELCH_AVERAGES / WELCH_SEGMENTS) as f64, |duration| {
            (duration / (samples as f64 * spacing)).ceil().max(32.0)
        });
        let asked = Samples {
            quantity: request.quantity,
            spacing,
            samples,
            records: records as u64,
        };
        Ok((welch, asked))
    }

    fn series_cost(&mut self) -> Result<Cost> {
        let (_, asked) = self.welch()?;
        let recipe = Series::of(&self.scene.oscillator, asked, &self.sampling())?;
        let records = recipe.asked.records;
        let method = format!(
            "Welch: {records} records of {WELCH_SEGMENTS} segments of {WELCH_SAMPLES} samples, {}",
            recipe.words()
        );
        let mut cost = Cost::of_sample(recipe.cost, method);
        // The periodograms.
        cost.memory_bytes += 8 * records * WELCH_SAMPLES as u64 / 2;
        self.recipes.series = Some(recipe);
        Ok(cost)
    }

    // ---- end of the joins ----

    fn check_cost(&self, part: Part, cost: &Cost) -> Result<()> {
        if cost.steps > MOST_STEPS {
            let sampling = self.scene.monte_carlo.as_ref();
            let (key, step) = match part {
                Part::MonteCarlo
                | Part::FirstLossPaths
                | Part::FirstPassagePaths
                | Part::Series
                | Part::Records => ("monte_carlo.step", sampling.and_then(|it| it.step)),
                _ => ("method.step", self.scene.method.step),
            };
            let outputs = &self.scene.outputs;
            let otherwise = match (part, sampling.and_then(|it| it.duration)) {
                (Part::Records | Part::Series, Some(duration)) => {
                    ("monte_carlo.duration", duration)
                }
                (Part::Series | Part::Spectrum, _) => (
                    "outputs.spectrum.until",
                    outputs.spectrum.map_or(0.0, |it| it.until),
                ),
                (Part::FirstLoss | Part::FirstLossPaths, _) => (
                    "outputs.first_loss.until",
                    outputs.first_loss.unwrap_or_default(),
                ),
                (Part::FirstPassage | Part::FirstPassagePaths, _) => (
                    "outputs.first_passage.until",
                    outputs.first_passage.map_or(0.0, |it| it.until),
                ),
                _ if outputs.density_at.last() > outputs.moments_at.last() => {
                    ("outputs.density_at", outputs.density_at.last())
                }
                _ => ("outputs.moments_at", outputs.moments_at.last()),
            };
            let (key, value) = step.map_or(otherwise, |step| (key, step));
            let accepted = format!(
                "at most {MOST_STEPS:.0e} steps, and this takes {:.1e}",
                cost.steps as f64
            );
            return Err(Error::invalid(key, num(value), accepted));
        }
        let limit = self.scene.accuracy.max_memory;
        if cost.memory_bytes > limit {
            let need = format!(
                "the {} stage would need {}; accuracy.max_memory = {}",
                part.name(),
                bytes(cost.memory_bytes),
                bytes(limit)
            );
            return Err(match self.scene.method.cells {
                Some([q, v]) if cost.cells.is_some() => {
                    Error::invalid("method.cells", format!("[{q}, {v}]"), need)
                }
                _ => Error::Limit {
                    key: "accuracy.max_memory",
                    limit: bytes(limit),
                    what: format!(
                        "the {} stage would need {}",
                        part.name(),
                        bytes(cost.memory_bytes)
                    ),
                },
            });
        }
        if let (Part::Transient, Some([q, v])) = (part, cost.cells) {
            let count = self.scene.outputs.density_at.list().len();
            let size = 8.0 * q as f64 * v as f64 * count as f64;
            if size > limit as f64 {
                let accepted = format!(
                    "densities that fit accuracy.max_memory = {}; these take {}",
                    bytes(limit),
                    bytes(size as u64)
                );
                return Err(Error::invalid(
                    "outputs.density_at",
                    format!("{count} times"),
                    accepted,
                ));
            }
        }
        Ok(())
    }
}

/// The keys that ask for each part, and whether they do.
fn asked(scene: &Scene) -> [(Part, Vec<(&'static str, bool)>); 16] {
    let it = &scene.outputs;
    let crossings = ("outputs.crossings", it.crossings.is_some());
    let first_loss = ("outputs.first_loss", it.first_loss.is_some());
    let passage = ("outputs.first_passage", it.first_passage.is_some());
    let spectrum = ("outputs.spectrum", it.spectrum.is_some());
    let moments = ("outputs.moments_at", !it.moments_at.is_empty());
    let densities = ("outputs.density_at", !it.density_at.is_empty());
    let (sampled, paths, records) = (
        scene.monte_carlo.is_some(),
        scene.wants_paths(),
        scene.wants_records(),
    );
    let by_sampling = |(key, asked): (&'static str, bool)| vec![(key, asked && sampled)];
    [
        (
            Part::Stationary,
            vec![("outputs.stationary", it.stationary)],
        ),
        (Part::Crossings, vec![crossings]),
        (Part::FirstLoss, vec![first_loss]),
        (Part::FirstPassage, vec![passage]),
        (Part::Transient, vec![moments, densities]),
        (Part::Reach, vec![("outputs.reach", it.reach.is_some())]),
        (
            Part::Periodic,
            vec![("outputs.periodic", it.periodic.is_some())],
        ),
        (
            Part::Response,
            vec![("outputs.response", it.response.is_some())],
        ),
        (Part::Steady, vec![("outputs.steady", it.steady)]),
        (
            Part::DecayRates,
            vec![("outputs.decay_rates", it.decay_rates > 0)],
        ),
        (Part::Spectrum, vec![spectrum]),
        (Part::Series, by_sampling(spectrum)),
        (Part::MonteCarlo, vec![("monte_carlo", paths)]),
        (Part::FirstLossPaths, by_sampling(first_loss)),
        (Part::FirstPassagePaths, by_sampling(passage)),
        (
            Part::Records,
            vec![
                ("monte_carlo", records && !paths),
                (crossings.0, records && crossings.1),
                ("monte_carlo.duration", records && paths && !crossings.1),
            ],
        ),
    ]
}

/// The stationary value that a fraction of is reached.
fn reached(quantity: Moment, law: &Moments) -> Result<Estimate> {
    let stationary = law.get(quantity).filter(|it| it.value.abs() > it.error);
    let name = quantity.name();
    stationary.ok_or_else(|| {
        let accepted = format!("a moment whose stationary value is not 0; that of {name} is");
        Error::invalid("outputs.reach.quantity", format!("{name:?}"), accepted)
    })
}

#[cfg(test)]
mod recipe_tests;
