//! A plan: what a scene needs computed, and nothing else. Data that can be printed, costed and tested
//! before anything runs.

use crate::budget::Limits;
pub use crate::budget::StopFlag;
use crate::clock::Clock;
use crate::error::{Error, Result};
use crate::estimate::{Estimate, Warning};
use crate::fokker_planck::{
    self, Eigenvalues, FirstPassage, PeriodicLaw, Reach, Recipe, Resolvent, ResponseCurve,
    Settings, StationaryState, SteadyState,
};
use crate::format::{brief, num};
pub use crate::format::{bytes, seconds};
use crate::moments::{Moment, Moments};
use crate::monte_carlo::{self, Ensemble, FirstLosses, Records, Samples, Sampling, Series};
use crate::results::in_unit::InUnit;
use crate::results::{Numbers, Results, SpectrumNumbers, peak_memory};
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

/// One part of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage {
    /// Which part.
    pub part: Part,
    /// The outputs that need it, as keys of the scene.
    pub needed_by: Vec<&'static str>,
    /// What it will cost.
    pub cost: Cost,
}

/// The parts a plan can have, in the order they run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The closed form (21)-(30), or the null vector where damping leaves none.
    Stationary,
    /// Losses of contact in a window, by Rice's formula.
    Crossings,
    /// The first loss of contact, by the backward equation.
    FirstLoss,
    /// The first passage of a level, by the backward equation.
    FirstPassage,
    /// The transient of the Fokker-Planck equation.
    Transient,
    /// When a moment of it reaches a level.
    Reach,
    /// The law that lasts under a drive.
    Periodic,
    /// The same over the frequency of the drive.
    Response,
    /// Its steady state on the mesh.
    Steady,
    /// The slowest eigenvalues of L.
    DecayRates,
    /// The spectrum from the resolvent of L.
    Spectrum,
    /// The ensemble of paths.
    MonteCarlo,
    /// Sampled records for the spectrum by Welch's method.
    Series,
    /// The first losses of an ensemble of paths.
    FirstLossPaths,
    /// The first passages of a level by an ensemble of paths.
    FirstPassagePaths,
    /// Long records of the stationary motion.
    Records,
}

impl Part {
    /// The name in tables and in results.json.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stationary => "stationary",
            Self::Crossings => "crossings",
            Self::FirstLoss => "first_loss",
            Self::FirstPassage => "first_passage",
            Self::FirstPassagePaths => "first_passage_paths",
            Self::Transient => "transient",
            Self::Reach => "reach",
            Self::Periodic => "periodic",
            Self::Response => "response",
            Self::Steady => "steady",
            Self::DecayRates => "decay_rates",
            Self::Spectrum => "spectrum",
            Self::MonteCarlo => "monte_carlo",
            Self::Series => "welch",
            Self::FirstLossPaths => "first_loss_paths",
            Self::Records => "records",
        }
    }
}

/// The expected cost of a stage.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// How it will be computed, and why so.
    pub method: String,
    /// Cells in q and v; None without a mesh.
    pub cells: Option<[usize; 2]>,
    /// Time steps, of each path or record for Monte Carlo.
    pub steps: u64,
    /// Bytes.
    pub memory_bytes: u64,
    /// Seconds on this machine, roughly.
    pub seconds: f64,
}

impl Cost {
    fn on_mesh(it: fokker_planck::Cost, method: String) -> Self {
        Self {
            method,
            cells: Some(it.cells),
            steps: it.steps,
            memory_bytes: it.memory,
            seconds: it.seconds,
        }
    }

    fn of_sample(it: monte_carlo::Cost, method: String) -> Self {
        Self {
            method,
            cells: None,
            steps: it.steps,
            memory_bytes: it.memory,
            seconds: it.seconds,
        }
    }
}

/// Told about a run as it goes; every method may be left as it is.
pub trait Watch: Sync {
    /// A part begins.
    fn begins(&self, _part: Part) {}

    /// A part is done to this fraction.
    fn progress(&self, _part: Part, _fraction: f64) {}

    /// A part has ended; `results` hold it and all before it.
    ///
    /// # Errors
    /// Whatever is returned ends the run.
    fn ends(&self, _part: Part, _results: &Results) -> Result<()> {
        Ok(())
    }

    /// The flag that ends the run once it is raised, where the run looks at the clock: mostly within milliseconds. What
    /// nothing can stop half way, as a factorisation or a step on a large mesh, ends first.
    fn stop(&self) -> StopFlag {
        StopFlag::default()
    }
}

struct Nobody;
impl Watch for Nobody {}

/// Samples of a segment of Welch's method, averages and segments a record: the first two are the
/// paper's; records of five segments share few samples and are many enough for a standard error.
const WELCH_SAMPLES: usize = 2048;
const WELCH_AVERAGES: usize = 400;
const WELCH_SEGMENTS: usize = 5;

/// Seconds kept for the stages still to come, over those foreseen of them, which are within three of what it takes;
/// at least a tenth of what is left, by which a stage may overrun its own limit, and at most half.
const RESERVED: f64 = 3.0;

/// A stage may begin after the limit of time if it is foreseen to end, RESERVED times, within so many times the limit.
const OVERRUN: f64 = 1.3;

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
                let recipe = PeriodicLaw::of(oscillator, phases, &self.settings, true)?;
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

    /// Seconds of those left that are kept for the stages after this one.
    fn reserved(&self, part: Part, left: f64) -> f64 {
        let later = self.stages.iter().skip_while(|it| it.part != part).skip(1);
        let seconds: Vec<f64> = later.map(|it| it.cost.seconds).collect();
        if seconds.is_empty() || left <= 0.0 {
            return 0.0;
        }
        (RESERVED * seconds.iter().sum::<f64>()).clamp(0.1 * left, 0.5 * left)
    }

    #[allow(clippy::too_many_lines)] // One arm a part.
    fn compute(
        &self,
        part: Part,
        results: &mut Results,
        (progress, stop): (&(dyn Fn(f64) + Sync), &StopFlag),
    ) -> Result<()> {
        let Scene {
            oscillator,
            initial,
            outputs,
            ..
        } = &self.scene;
        let mut settings = self.settings.clone();
        let own = self.stages.iter().find(|it| it.part == part);
        let least = RESERVED * own.map_or(0.0, |it| it.cost.seconds);
        let mut left = settings.max_seconds - results.run.wall_seconds;
        if results.run.wall_seconds + least <= OVERRUN * settings.max_seconds {
            left = left.max(least);
        }
        settings.max_seconds = left - self.reserved(part, left);
        let limits = Limits::from_now(settings.max_seconds, settings.max_memory);
        let limits = limits.until(stop.clone());
        match part {
            Part::Stationary | Part::Crossings if !oscillator.is_viscous() => {
                if results.solved.is_none()
                    && let Some(recipe) = &self.recipes.stationary
                {
                    let it = recipe.solve(oscillator, &limits, progress)?;
                    results.fall_short(part.name(), it.shortfall.as_ref(), true);
                    results.solved = Some(it);
                }
                if let Some(law) = &results.solved {
                    match (part, self.scene.crossings_window()) {
                        (Part::Crossings, Some(time)) => {
                            results.crossings = Some(Numbers::flux(law, time));
                        }
                        (Part::Crossings, None) => {}
                        _ => results.stationary = Some(Numbers::solved(law)),
                    }
                }
            }
            Part::Stationary => {
                let law = Stationary::of(oscillator)?;
                results.stationary = Some(Numbers::stationary(&law));
            }
            Part::Crossings => {
                if let Some(time) = self.scene.crossings_window() {
                    let law = Stationary::of(oscillator)?;
                    results.crossings = Some(Numbers::crossings(&law, time));
                    // Between two walls it is sampled alone.
                    if oscillator.contact().back_wall().is_none() {
                        let flights = fokker_planck::flight_law(oscillator)?;
                        let shortfall = flights.shortfall(settings.tolerance);
                        results.fall_short(part.name(), shortfall.as_ref(), true);
                        results.flights = Some(flights);
                        results.impacts = Some(fokker_planck::impact_law(oscillator)?);
                    }
                }
            }
            Part::FirstLoss => {
                if let Some(recipe) = &self.recipes.first_passage {
                    let it = recipe.solve(oscillator, initial, &limits, progress)?;
                    results.fall_short(part.name(), it.shortfall.as_ref(), true);
                    results.first_loss = Some(it);
                }
            }
            Part::FirstLossPaths => {
                if let (Some(recipe), Some(it)) = (&self.recipes.first_losses, &results.first_loss)
                {
                    let problem = (oscillator, initial);
                    let times = it.times.iter().map(|t| self.clock.dimensionless(*t));
                    let times: Vec<f64> = times.collect();
                    let it = recipe.run(problem, &times, limits, progress)?;
                    results.run.warnings.extend(it.warnings.iter().cloned());
                    results.first_loss_paths = Some(it);
                    results.agreement = results.agree();
                }
            }
            Part::FirstPassage => {
                if let Some(recipe) = &self.recipes.passage {
                    let it = recipe.solve(oscillator, initial, &limits, progress)?;
                    results.fall_short(part.name(), it.shortfall.as_ref(), true);
                    results.first_passage = Some(it);
                }
            }
            Part::FirstPassagePaths => {
                if let (Some(recipe), Some(it)) = (&self.recipes.passages, &results.first_passage) {
                    let problem = (oscillator, initial);
                    let it = recipe.run(problem, &it.times, limits, progress)?;
                    results.run.warnings.extend(it.warnings.iter().cloned());
                    results.first_passage_paths = Some(it);
                    results.agreement = results.agree();
                }
            }
            Part::Transient => {
                let density_at = outputs.density_at.list();
                // Who asks for densities alone gets the numbers of these times.
                let moments_at = if outputs.moments_at.is_empty() {
                    density_at.clone()
                } else {
                    outputs.moments_at.list()
                };
                let Some(recipe) = &self.recipes.transient else {
                    return Ok(());
                };
                let (problem, times) = ((oscillator, initial), self.times());
                let mut it = recipe.solve(problem, (&times, &density_at), &limits, progress)?;
                keep_times(&mut it, &moments_at);
                let warnings = it.warnings.iter().cloned();
                results.run.warnings.extend(warnings.map(Warning::from));
                results.fall_short(part.name(), it.shortfall.as_ref(), false);
                results.transient = Some(it);
            }
            Part::Reach => {
                if let Some(recipe) = &self.recipes.reach {
                    let law = match &self.recipes.level {
                        Some(law) => law.solve(oscillator, &limits, &|_| {})?.moments,
                        None => Stationary::of(oscillator)?.moments(),
                    };
                    let stationary = reached(self.reach()?.quantity, &law)?;
                    let problem = (oscillator, initial);
                    let it = recipe.solve(problem, stationary, &limits, progress)?;
                    let warnings = it.warnings.iter().cloned();
                    results.run.warnings.extend(warnings.map(Warning::from));
                    results.fall_short(part.name(), it.shortfall.as_ref(), true);
                    results.reach = Some(it);
                }
            }
            Part::Periodic => {
                if let Some(recipe) = &self.recipes.periodic {
                    let it = recipe.solve(oscillator, &limits, progress)?;
                    let warnings = it.warnings.iter().cloned();
                    results.run.warnings.extend(warnings.map(Warning::from));
                    results.fall_short(part.name(), it.shortfall.as_ref(), false);
                    results.periodic = Some(it);
                }
            }
            Part::Response => {
                if let Some(recipe) = &self.recipes.response {
                    let it = recipe.solve(oscillator, &limits, progress)?;
                    let warnings = it.warnings.iter().cloned();
                    results.run.warnings.extend(warnings.map(Warning::from));
                    results.fall_short(part.name(), it.shortfall.as_ref(), false);
                    results.response = Some(it);
                }
            }
            Part::Steady => {
                let Some(recipe) = &self.recipes.steady else {
                    return Ok(());
                };
                let it = recipe.solve(oscillator, &limits, progress)?;
                let warnings = it.warnings.iter().cloned();
                results.run.warnings.extend(warnings.map(Warning::from));
                results.fall_short(part.name(), it.shortfall.as_ref(), true);
                results.steady = Some(it);
            }
            Part::DecayRates => {
                let Some(recipe) = &self.recipes.eigenvalues else {
                    return Ok(());
                };
                let it = recipe.solve(oscillator, &limits, progress)?;
                results.fall_short(part.name(), it.shortfall.as_ref(), true);
                results.decay_rates = Some(it);
            }
            Part::Spectrum => self.compute_spectrum(&limits, results, progress)?,
            Part::Series => {
                if let (Some(recipe), Some(mut it)) =
                    (&self.recipes.series, results.spectrum.take())
                {
                    let (welch, _) = self.welch()?;
                    let averages = it.sample(oscillator, &welch, recipe, limits, progress)?;
                    results.spectrum = Some(it);
                    let warning = recipe.warning(oscillator, averages);
                    results.run.warnings.extend(warning);
                    results.agreement = results.agree();
                }
            }
            Part::MonteCarlo => {
                if let Some(recipe) = &self.recipes.ensemble {
                    let mut it = recipe.run((oscillator, initial), limits, progress)?;
                    for moments in &mut it.moments {
                        moments.keep(outputs.moments.as_deref());
                    }
                    results.run.warnings.extend(it.warnings.iter().cloned());
                    results.monte_carlo = Some(it);
                    results.agreement = results.agree();
                }
            }
            Part::Records => {
                if let Some(recipe) = &self.recipes.records {
                    let it = recipe.run(oscillator, limits, progress)?;
                    results.run.warnings.extend(it.warnings.iter().cloned());
                    let losses = it.crossings.as_ref().map(|it| it.losses);
                    if outputs.crossings.is_some() && losses == Some(0) {
                        let warning = format!(
                            "the records saw no loss of contact in a time of {:.1e}: its rate is known \
                             from the closed form alone",
                            it.duration
                        );
                        results.run.warnings.push(warning.into());
                    }
                    results.records = Some(it);
                    results.agreement = results.agree();
                }
            }
        }
        Ok(())
    }

    /// What a stage has answered, in the scene's unit of time; `told` warnings and shortfalls were there before it.
    fn put_in_unit(&self, part: Part, results: &mut Results, told: (usize, usize)) {
        let clock = &self.clock;
        if clock.is_dimensionless() {
            return;
        }
        match part {
            Part::Stationary => results.stationary.put_in(clock),
            Part::Crossings => {
                results.crossings.put_in(clock);
                results.flights.put_in(clock);
                results.impacts.put_in(clock);
            }
            Part::FirstLoss => results.first_loss.put_in(clock),
            Part::FirstPassage => results.first_passage.put_in(clock),
            Part::FirstPassagePaths => results.first_passage_paths.put_in(clock),
            Part::Transient => results.transient.put_in(clock),
            Part::Reach => results.reach.put_in(clock),
            Part::Periodic => results.periodic.put_in(clock),
            Part::Steady => results.steady.put_in(clock),
            Part::DecayRates => results.decay_rates.put_in(clock),
            // The solved spectrum holds no time, and a response curve circular frequencies.
            Part::Spectrum | Part::Response => {}
            Part::Series => results.spectrum.put_in(clock),
            Part::MonteCarlo => results.monte_carlo.put_in(clock),
            Part::FirstLossPaths => results.first_loss_paths.put_in(clock),
            Part::Records => results.records.put_in(clock),
        }
        let (warnings, shortfalls) = told;
        let warnings = results.run.warnings.iter_mut().skip(warnings);
        warnings.for_each(|it| it.put_in(clock));
        let shortfalls = results.shortfalls.iter_mut().skip(shortfalls);
        shortfalls.for_each(|(_, it)| it.put_in(clock));
        if results.agreement.is_some() {
            results.agreement = results.agree();
        }
    }

    fn compute_spectrum(
        &self,
        limits: &Limits,
        results: &mut Results,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<()> {
        let oscillator = &self.scene.oscillator;
        let (welch, asked) = self.welch()?;
        let until = self.scene.outputs.spectrum.map_or(0.0, |it| it.until);
        let mut omegas = welch.omega();
        omegas.retain(|omega| *omega <= until * (1.0 + 1e-9));
        let Some(recipe) = &self.recipes.spectrum else {
            return Ok(());
        };
        let it = recipe.solve(oscillator, asked.quantity, &omegas, limits, progress)?;
        results.fall_short(Part::Spectrum.name(), it.shortfall.as_ref(), true);
        results.spectrum = Some(SpectrumNumbers::of(oscillator, it));
        Ok(())
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

    /// Run every stage; `watch` is told as it goes.
    ///
    /// # Errors
    /// The first error of a stage or of `watch`, or [`Error::Stopped`]. Results of the stages before it have been shown
    /// to `watch`.
    pub fn run(&self, watch: &dyn Watch) -> Result<Results> {
        let mut results = Results::empty(&self.given);
        self.run_on(&mut results, watch)?;
        Ok(results)
    }

    /// The same into `results`, which after an error hold the stages that have ended.
    ///
    /// # Errors
    /// Those of [`Plan::run`].
    pub(crate) fn run_on(&self, results: &mut Results, watch: &dyn Watch) -> Result<()> {
        let start = Instant::now();
        let spent = || self.planning + start.elapsed().as_secs_f64();
        let doubts = self.given.doubts();
        results
            .run
            .warnings
            .extend(doubts.into_iter().map(Warning::from));
        let stop = watch.stop();
        for (k, stage) in self.stages.iter().enumerate() {
            let limit = self.scene.accuracy.max_seconds;
            results.run.wall_seconds = spent();
            // What little is left to do is done: a stage before it may have overrun its part of the time.
            let end = results.run.wall_seconds + RESERVED * stage.cost.seconds;
            if results.run.wall_seconds > limit && end > OVERRUN * limit {
                return Err(Error::Limit {
                    key: "accuracy.max_seconds",
                    limit: num(limit),
                    what: format!("the {} stage had not begun", stage.part.name()),
                });
            }
            let part = stage.part;
            watch.begins(part);
            let begin = Instant::now();
            let told = (results.run.warnings.len(), results.shortfalls.len());
            let progress = |fraction| watch.progress(part, fraction);
            let computed = self.compute(part, results, (&progress, &stop));
            if stop.raised() {
                let what = format!("the {} stage had not ended", part.name());
                return Err(Error::Stopped { what });
            }
            // A stage knows only what the stages before it left of the time.
            let computed = computed.map_err(|error| self.as_typed(error));
            computed.map_err(|error| match error {
                Error::Limit {
                    key: key @ "accuracy.max_seconds",
                    what,
                    ..
                } => Error::Limit {
                    key,
                    limit: num(limit),
                    what,
                },
                other => other,
            })?;
            self.put_in_unit(part, results, told);
            results
                .run
                .stages
                .push((part.name(), begin.elapsed().as_secs_f64()));
            results.run.wall_seconds = spent();
            results.run.peak_memory_bytes = peak_memory();
            let open: Vec<&str> = self.stages[k + 1..]
                .iter()
                .map(|it| it.part.name())
                .collect();
            if open.is_empty() {
                watch.ends(part, results)?;
            } else {
                results.run.warnings.push(unfinished(&open));
                watch.ends(part, results)?;
                results.run.warnings.pop();
            }
        }
        Ok(())
    }

    /// What is left to do after these results, as the warning that they then carry.
    pub(crate) fn left_after(&self, results: &Results) -> Option<Warning> {
        let ended = |it: &Stage| {
            results
                .run
                .stages
                .iter()
                .any(|(name, _)| *name == it.part.name())
        };
        let open = self.stages.iter().filter(|it| !ended(it));
        let open: Vec<&str> = open.map(|it| it.part.name()).collect();
        (!open.is_empty()).then(|| unfinished(&open))
    }

    /// Run every stage, telling nobody.
    ///
    /// # Errors
    /// The first error of a stage.
    pub fn run_quietly(&self) -> Result<Results> {
        self.run(&Nobody)
    }
}

/// What results say while stages are still to come.
fn unfinished(open: &[&str]) -> Warning {
    Warning::from(format!("unfinished: {} had not ended yet", open.join(", ")))
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

/// Leave the numbers of these times only.
fn keep_times(it: &mut fokker_planck::Transient, times: &[f64]) {
    fn keep<T>(items: &mut Vec<T>, kept: &[bool]) {
        let mut kept = kept.iter();
        items.retain(|_| kept.next().copied().unwrap_or(true));
    }
    let kept: Vec<bool> = it.times.iter().map(|t| times.contains(t)).collect();
    keep(&mut it.times, &kept);
    keep(&mut it.moments, &kept);
    keep(&mut it.mass, &kept);
    keep(&mut it.lowest_density, &kept);
    keep(&mut it.negative_mass, &kept);
    keep(&mut it.relative_entropy, &kept);
    keep(&mut it.distance, &kept);
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
mod tests {
    use super::*;
    use crate::contact::ContactLaw;
    use crate::initial::Initial;
    use crate::oscillator::Oscillator;
    use crate::scene::text::{SceneText, built_in};
    use crate::scene::{MonteCarlo, Outputs, Times};

    fn scene() -> Scene {
        Scene::new(Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap())
    }

    #[test]
    fn a_stationary_scene_builds_no_mesh_and_draws_no_path() {
        let plan = Plan::of(&scene()).unwrap();
        assert_eq!(plan.stages().len(), 1);
        assert!(plan.has(Part::Stationary) && plan.stages()[0].cost.cells.is_none());
        let results = plan.run_quietly().unwrap();
        assert!(results.transient.is_none() && results.monte_carlo.is_none());
        assert!(results.run.wall_seconds < 1.0);
    }

    #[test]
    fn every_stage_is_there_only_for_an_output_that_asks() {
        let mut scene = scene();
        scene.initial = Initial::gaussian([0.0; 2], [0.3; 2]).unwrap();
        scene.outputs = Outputs {
            moments_at: Times::List(vec![1.0]),
            ..Outputs::nothing()
        };
        let plan = Plan::of(&scene).unwrap();
        assert_eq!(plan.stages().len(), 1);
        assert_eq!(plan.stages()[0].needed_by, ["outputs.moments_at"]);
        scene.outputs.density_at = Times::List(vec![2.0]);
        scene.monte_carlo = Some(MonteCarlo::default());
        let plan = Plan::of(&scene).unwrap();
        assert_eq!(
            plan.stages()[0].needed_by,
            ["outputs.moments_at", "outputs.density_at"]
        );
        assert!(plan.has(Part::MonteCarlo) && !plan.has(Part::Stationary));
    }

    #[test]
    fn every_built_in_transient_has_its_recipe() {
        use crate::fokker_planck::transient::FirstGrid::{self, Mesh, Moving, MovingForGood};
        const MAP: &str = "flow map, order 8";
        let recipes: [(&str, &str, FirstGrid, [usize; 2], u64); 12] = [
            ("default", MAP, Moving, [186, 122], 981),
            ("paper-level 3e-6 0.01", MAP, Mesh, [102, 102], 80),
            ("paper-level 8e-5 0.05", MAP, Mesh, [106, 106], 80),
            ("paper-level 5e-4 0.15", MAP, Mesh, [102, 90], 80),
            ("paper-level 1.2e-3 0.25", MAP, Mesh, [114, 84], 80),
            ("paper-level 2e-3 0.3", MAP, Mesh, [142, 90], 80),
            ("paper-level 3.2e-3 0.4", MAP, Mesh, [158, 88], 80),
            ("bilinear", MAP, Mesh, [146, 92], 80),
            ("displaced", MAP, Mesh, [109, 70], 160),
            ("dropped", MAP, Moving, [188, 122], 66),
            (
                "overdamped",
                "finite volumes, order 8, imex",
                Mesh,
                [124, 84],
                100,
            ),
            ("free-fall", MAP, MovingForGood, [38, 38], 4),
        ];
        let mut others = Vec::new();
        for (name, method, grid, cells, steps) in recipes {
            let words: Vec<&str> = name.split(' ').collect();
            let set = match words[1..] {
                [h, s] => vec![
                    format!("oscillator.h={h}"),
                    format!("initial.deviation=[{s}, {s}]"),
                ],
                _ => vec![],
            };
            let text = SceneText::parse(name, built_in(words[0]).unwrap(), &set).unwrap();
            let recipe = Plan::of(text.scene()).unwrap().recipes.transient.unwrap();
            let found = (
                recipe.name(),
                recipe.first_grid,
                recipe.cost.cells,
                recipe.cost.steps,
            );
            println!("{name}: {found:?}; {}", recipe.reason);
            if found != (method.to_string(), grid, cells, steps) {
                others.push(name);
            }
        }
        assert!(others.is_empty(), "{others:?}");
    }

    #[test]
    #[expect(clippy::approx_constant)] // pi/8, printed to four digits
    fn every_built_in_sample_has_its_recipe() {
        use crate::monte_carlo::Scheme::{self, ExponentialHeun, Splitting42};
        // Scheme, step, paths or records, steps of each.
        type Found = (Part, Scheme, f64, u64, u64);
        let recipes: [(&str, &[Found]); 11] = [
            (
                "default",
                &[(Part::MonteCarlo, Splitting42, 0.5, 100_000, 1000)],
            ),
            (
                "bilinear",
                &[(Part::MonteCarlo, Splitting42, 1.0, 20_000, 40)],
            ),
            (
                "displaced",
                &[(Part::MonteCarlo, Splitting42, 0.25, 50_000, 160)],
            ),
            (
                "dropped",
                &[(Part::MonteCarlo, Splitting42, 0.7143, 100_000, 82)],
            ),
            (
                "overdamped",
                &[(Part::MonteCarlo, ExponentialHeun, 0.03333, 20_000, 120)],
            ),
            (
                "free-fall",
                &[(Part::MonteCarlo, Splitting42, 0.25, 20_000, 8)],
            ),
            (
                "extreme",
                &[(Part::MonteCarlo, Splitting42, 0.5, 20_000, 40)],
            ),
            (
                "first-loss",
                &[
                    (Part::FirstLossPaths, Splitting42, 0.8197, 100_000, 244),
                    (Part::Records, Splitting42, 0.8217, 240, 5072),
                ],
            ),
            (
                "records",
                &[(Part::Records, Splitting42, 0.7942, 144, 5496)],
            ),
            (
                "spectrum",
                &[
                    (Part::Series, Splitting42, 0.3927, 272, 6144),
                    (Part::Records, Splitting42, 0.7942, 144, 5496),
                ],
            ),
            (
                "table-3",
                &[(Part::Records, Splitting42, 0.8031, 144, 5434)],
            ),
        ];
        for (name, expected) in recipes {
            let text = SceneText::parse(name, built_in(name).unwrap(), &[]).unwrap();
            let plan = Plan::of(text.scene()).unwrap();
            let mut found = Vec::new();
            let mut put = |part, (scheme, step): (Scheme, f64), count, steps| {
                let step: f64 = format!("{step:.3e}").parse().unwrap();
                found.push((part, scheme, step, count, steps));
            };
            if let Some(it) = &plan.recipes.ensemble {
                assert!(it.companion.is_none());
                put(
                    Part::MonteCarlo,
                    (it.walk.scheme, it.walk.step),
                    it.paths,
                    it.cost.steps,
                );
            }
            if let Some(it) = &plan.recipes.series {
                put(
                    Part::Series,
                    (it.walk.scheme, it.walk.step),
                    it.asked.records,
                    it.cost.steps,
                );
            }
            if let Some(it) = &plan.recipes.first_losses {
                put(
                    Part::FirstLossPaths,
                    (it.walk.scheme, it.walk.step),
                    it.paths,
                    it.cost.steps,
                );
            }
            if let Some(it) = &plan.recipes.records {
                put(
                    Part::Records,
                    (it.walk.scheme, it.walk.step),
                    it.records(),
                    it.cost.steps,
                );
            }
            println!("{name}: {found:?}");
            assert_eq!(found, expected, "{name}");
        }
    }

    #[test]
    fn every_question_of_the_default_scene_has_its_recipe() {
        let text = SceneText::parse("default", built_in("default").unwrap(), &[]).unwrap();
        let mut scene = text.scene().clone();
        scene.outputs.steady = true;
        scene.outputs.spectrum = Some(crate::scene::SpectrumRequest {
            until: 4.0,
            quantity: crate::scene::Quantity::Force,
        });
        scene.outputs.first_loss = Some(200.0);
        let plan = Plan::of(&scene).unwrap();
        let found: Vec<_> = plan
            .stages()
            .iter()
            .filter_map(|it| Some((it.part.name(), it.cost.cells?, it.cost.steps)))
            .collect();
        println!("{found:?}");
        let expected = [
            ("first_loss", [67, 96], 832),
            ("transient", [186, 122], 981),
            ("steady", [115, 68], 60),
            ("decay_rates", [89, 96], 15),
            ("spectrum", [153, 152], 21),
        ];
        assert_eq!(found, expected);
        let rates = plan.recipes.eigenvalues.unwrap();
        println!("{rates:?}");
        assert!(
            rates.words().contains("9 shifts up to 2.00i"),
            "{}",
            rates.words()
        );
        assert!(rates.words().contains("a real rate must be among them"));
    }

    #[test]
    fn a_mesh_beyond_the_memory_is_refused_before_anything_is_built() {
        let mut scene = scene();
        scene.outputs.steady = true;
        scene.method.cells = Some([1_000_000_000, 1_000_000_000]);
        let message = Plan::of(&scene).unwrap_err().to_string();
        assert!(
            message.contains("method.cells") && message.contains("max_memory"),
            "{message}"
        );
        scene.method.cells = None;
        scene.accuracy.max_memory = 1000;
        let message = Plan::of(&scene).unwrap_err().to_string();
        assert!(
            message.contains("accuracy.max_memory = 1.0 kB"),
            "{message}"
        );
    }
}
