//! The steady state: the null vector of the generator, by sparse LU and by time integration.

use crate::error::{Deadline, Error, Result};
use crate::estimate::{Estimate, Origin, Shortfall};
use crate::fokker_planck::adaptive::{self, Next, Question, Stop, judged};
use crate::fokker_planck::budget::{self, Cost, Factors, Limits, timing};
use crate::fokker_planck::density::{Density, Snapshot};
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::generator::Generator;
use crate::fokker_planck::integrators::BackwardEuler;
use crate::fokker_planck::layout::{self, Cells, Layout};
use crate::fokker_planck::null_vector::null_vector;
use crate::fokker_planck::observables::Observables;
use crate::fokker_planck::policy::LADDER_RATIO;
use crate::fokker_planck::settings::{Method, Settings};
use crate::fokker_planck::solved::Settled;
use crate::initial::Initial;
use crate::moments::{Moment, Moments};
use crate::oscillator::Oscillator;
use crate::scales::Scales;

/// The steady state on a mesh, found twice.
#[derive(Debug, Clone, PartialEq)]
pub struct Steady {
    /// L1 distance of the null vector of the generator to the cell masses of (21) on the same cells; its
    /// error is the domain-truncation error. Under other than viscous damping to the law solved for in Hermite
    /// functions, from which finite volumes differ by their own error; what that law may be off is in the error too.
    pub l1_error: Estimate,
    /// |L P|_1/|L|_1 of the null vector.
    pub residual: f64,
    /// Moments of the null vector; their error is that of the truncated domain, with the weight of the tails, and the
    /// distance above.
    pub moments: Moments,
    /// The null vector as a density.
    pub density: Snapshot,
    /// Time and L1 distance to (21) of a time integration by backward Euler from one cell at equilibrium; none under
    /// other than viscous damping.
    pub approach: Vec<(f64, f64)>,
    /// What it was computed with.
    pub method: Method,
    /// What the tolerance asked for and was not reached.
    pub shortfall: Option<Shortfall>,
    /// What the reader should know.
    pub warnings: Vec<String>,
}

/// How the steady state will be computed: the mesh, and its foreseen cost.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SteadyState {
    layout: Layout,
    tolerance: f64,
    /// The moments asked for; None for all of them.
    asked: Option<Vec<Moment>>,
    /// Whether a time integration is compared with it.
    integrates: bool,
    /// What it will take.
    pub(crate) cost: Cost,
}

/// Solves L P = 0 on a mesh by sparse LU and by time integration, and compares both with (21).
///
/// # Errors
/// [`Error::NoStationaryLaw`](crate::Error::NoStationaryLaw) for a contact without one; otherwise those of [`null_vector`].
pub fn steady(oscillator: &Oscillator, settings: &Settings) -> Result<Steady> {
    settings.check()?;
    SteadyState::of(oscillator, settings)?.solve(oscillator, &settings.limits(), &|_| {})
}

impl SteadyState {
    /// The recipe for an oscillator with a stationary law.
    pub(crate) fn of(oscillator: &Oscillator, settings: &Settings) -> Result<Self> {
        const SOLVES: f64 = 60.0;
        let damping = oscillator.damping();
        damping.depends_on_displacement("the steady state")?;
        // Exact in any drift where the weights are the stationary law.
        let automatic = if oscillator.is_viscous() {
            Drift::Upwind
        } else {
            Drift::Order6
        };
        let drift = settings.drift.unwrap_or(automatic);
        // The law of q refuses a contact that has none, in its own words.
        oscillator.displacement_law()?;
        let domain = layout::truncated(oscillator, &Initial::Stationary, settings)?;
        let widths = layout::thermal_widths(oscillator, settings.tolerance);
        let layout = Layout {
            domain,
            cells: Cells::of(settings, widths),
            drift,
            focused: false,
        };
        let cells = layout.count_within(oscillator, 1.0, settings.max_memory)?;
        let n = cells[0] as f64 * cells[1] as f64;
        let wide = budget::widening(drift);
        Ok(Self {
            layout,
            tolerance: settings.tolerance,
            asked: settings.moments.clone(),
            integrates: oscillator.is_viscous(),
            cost: Cost {
                cells: Some(cells),
                steps: SOLVES as u64,
                memory: budget::memory(cells, drift, Factors::Real),
                seconds: 2.0 * n * wide * (timing::LU + SOLVES * timing::SOLVE),
            },
        })
    }

    /// Method and reason.
    pub(crate) fn words(&self) -> String {
        let integrates = if self.integrates {
            ", and time integration"
        } else {
            ""
        };
        let drift = self.layout.drift.name();
        format!("finite volumes, {drift}; null vector by sparse LU{integrates}")
    }

    /// As [`steady`], by a recipe made before for the same oscillator.
    pub(crate) fn solve(
        &self,
        oscillator: &Oscillator,
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Steady> {
        let task = Task {
            recipe: self,
            oscillator,
            limits: limits.clone(),
            found: None,
        };
        let free = !self.layout.is_given();
        adaptive::pursue(task, (NAME, free), limits, progress)
    }
}

/// The question in messages.
const NAME: &str = "the steady state";

/// The steady state of one mesh, which is exact but for rounding and the truncated domain.
struct Task<'a> {
    recipe: &'a SteadyState,
    oscillator: &'a Oscillator,
    limits: Limits,
    /// The answer with its largest error over the tolerance, and whose that is.
    found: Option<(Steady, f64, &'static str)>,
}

impl Question for Task<'_> {
    type Answer = Steady;

    fn ratio(&self) -> Option<f64> {
        self.found.as_ref().map(|it| it.1)
    }

    fn next(&mut self) -> Result<Next> {
        if self.found.is_some() {
            let why = "what the truncated domain leaves out, or the rounding of the null vector, is larger";
            return Ok(Next::stop(why));
        }
        Ok(Next::run(self.recipe.cost))
    }

    fn run(&mut self, progress: &(dyn Fn(f64) + Sync)) -> Result<()> {
        let Self {
            recipe,
            oscillator,
            ref limits,
            ..
        } = *self;
        let Layout { domain, drift, .. } = recipe.layout;
        let (mesh, generator) = recipe.layout.carried(|k| {
            let finer = LADDER_RATIO.get().powi(k as i32);
            let cells = recipe.layout.count(oscillator, finer)?;
            limits.holds(NAME, budget::memory(cells, drift, Factors::Real))?;
            let mesh = recipe.layout.mesh(oscillator, finer)?;
            let generator = Generator::new(oscillator, &mesh, drift)?;
            Ok((mesh, generator))
        })?;
        let seconds = budget::factoring(mesh.cells(), drift, Factors::Real);
        // Nothing stops a factorisation half way.
        let late = || limits.room_for(seconds, || format!("a factorisation for {NAME}"));
        late()?;
        let (null, residual) = null_vector(&generator)?;
        progress(0.5);
        // The law that is solved for has an error of its own.
        let (exact, solved) = if oscillator.is_viscous() {
            (Density::start(&generator, &Initial::Stationary)?, 0.0)
        } else {
            let it = Settled::within(oscillator, recipe.tolerance, &late, limits.memory)?;
            let sampled = |points: &[[f64; 2]]| it.law.densities(points);
            let density = Density::sampled(&mesh, generator.columns(), &sampled);
            (density, it.error)
        };
        let mass = exact.mass();
        let distance = |density: &Density| -> f64 {
            let cells = density.cells().iter().zip(exact.cells());
            cells.map(|(p, w)| (p - w / mass).abs()).sum()
        };
        let l1 = distance(&null);
        let outside = domain.neglected.max((1.0 - mass).abs());
        let mut density = Density::at_equilibrium(&generator, oscillator);
        let relaxation = 0.5 / oscillator.zeta();
        // Of a wide stencil each step would be a factorisation of seconds.
        let (mut approach, mut warnings) = (Vec::new(), Vec::new());
        if oscillator.is_viscous() {
            match integrate(&generator, &mut density, relaxation, &distance, &late) {
                // The null vector is the answer, whether there is time for this or not.
                Err(error @ Error::Limit { .. }) => warnings.push(format!(
                    "no time integration towards the steady state: {error}"
                )),
                other => approach = other?,
            }
        }
        let integrated = approach.last().map_or(0.0, |last| last.1);
        if oscillator.is_viscous() && (l1 > 1e-9 || integrated > 1e-9) {
            warnings.push(format!(
                "the steady state on the mesh differs from the closed form by {l1:.1e} (null vector) and \
                 {integrated:.1e} (time integration): rounding, on a mesh with very different rates"
            ));
        }
        let observables = Observables::new(oscillator, &mesh, drift, generator.weights())?;
        let mut moments = observables
            .raw(&null.ratio(&generator))
            .moments(oscillator.contact());
        // Without a closed form the reference is wider than the law.
        let scales = if oscillator.is_viscous() {
            Scales::of(oscillator)
        } else {
            Scales::of_law(&moments)
        };
        let scales = scales.each(&moments);
        moments.keep(recipe.asked.as_deref());
        let weights = domain.tail_weights(oscillator);
        // A kurtosis far above 3 weighs the tail by its own size.
        let error = |k: usize, value: f64| {
            (weights[k] * outside + l1 + solved) * scales[k].max(value.abs())
        };
        let goal = (&scales[..], recipe.tolerance);
        let worst = judged(&mut moments, Origin::Domain, goal, error);
        let answer = Steady {
            moments,
            shortfall: None,
            l1_error: Estimate::new(l1, outside + solved, Origin::Domain),
            residual,
            density: null.snapshot(f64::INFINITY),
            method: Method {
                name: format!("finite volumes, {}, null vector by sparse LU", drift.name()),
                reason: "one factorisation gives the steady state".into(),
                cells: mesh.cells(),
                unknowns: generator.unknowns(),
                domain: mesh.domain(),
                step: 0.0,
                steps: (approach.len() as u64).saturating_sub(1),
                neglected: outside,
            },
            approach,
            warnings,
        };
        self.found = Some((answer, worst.0, worst.1));
        Ok(())
    }

    fn answer(self, stop: Stop) -> Option<Steady> {
        let (answer, ratio, name) = self.found?;
        let number = format!("{name} in the steady state");
        Some(Steady {
            shortfall: stop.shortfall(number, ratio, self.recipe.tolerance),
            ..answer
        })
    }
}

/// Distance to the stationary law at which the time integration ends.
const ARRIVED: f64 = 1e-11;

/// Integrates `density` by backward Euler to the steady state until its `distance` to it is below [`ARRIVED`] or stops
/// falling, and returns time and distance after every step. `late` is asked before each.
///
/// The step starts at a thousandth of the relaxation time 1/(2 zeta) and doubles every five steps up
/// to 1000 of them, so that both the approach and its end are seen.
fn integrate(
    generator: &Generator,
    density: &mut Density,
    relaxation: f64,
    distance: &dyn Fn(&Density) -> f64,
    late: &Deadline,
) -> Result<Vec<(f64, f64)>> {
    let mut euler = BackwardEuler::new(generator);
    let mut approach = vec![(0.0, distance(density))];
    let (mut t, mut dt) = (0.0, 1e-3 * relaxation);
    for k in 1..=200 {
        late()?;
        euler.step(density, dt)?;
        t += dt;
        let now = distance(density);
        let before = approach.last().map_or(f64::INFINITY, |last| last.1);
        approach.push((t, now));
        let longest = dt >= 1e3 * relaxation;
        if now < ARRIVED || (longest && now > 0.5 * before) {
            break;
        }
        if k % 5 == 0 && !longest {
            dt *= 2.0;
        }
    }
    Ok(approach)
}
