//! The steady state: the null vector of the generator, by sparse LU and by time integration.

use crate::error::{Error, Result};
use crate::estimate::{Estimate, Origin, Shortfall};
use crate::fokker_planck::adaptive::{self, Next, Question, Stop, judged};
use crate::fokker_planck::budget::{self, Cost, Factors, Limits, timing};
use crate::fokker_planck::density::{Density, Snapshot};
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::generator::Generator;
use crate::fokker_planck::hermite::Settled;
use crate::fokker_planck::integrators::BackwardEuler;
use crate::fokker_planck::layout::{self, Cells, Layout};
use crate::fokker_planck::observables::Observables;
use crate::fokker_planck::policy::LADDER_RATIO;
use crate::fokker_planck::settings::{Method, Settings};
use crate::initial::Initial;
use crate::moments::{Moment, Moments};
use crate::oscillator::Oscillator;
use crate::scales::Scales;
use crate::sparse::{Lu, shift};
use sprs::CsMat;

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
/// [`Error::NoStationaryLaw`] for a contact without one; otherwise those of [`null_vector`].
pub fn steady(oscillator: &Oscillator, settings: &Settings) -> Result<Steady> {
    let limits = Limits::from_now(settings.max_seconds, settings.max_memory);
    SteadyState::of(oscillator, settings)?.solve(oscillator, &limits, &|_| {})
}

impl SteadyState {
    /// The recipe for an oscillator with a stationary law.
    ///
    /// # Errors
    /// [`Error::NoStationaryLaw`] for a contact without one; those of the mesh.
    pub(crate) fn of(oscillator: &Oscillator, settings: &Settings) -> Result<Self> {
        const SOLVES: f64 = 60.0;
        oscillator
            .damping()
            .depends_on_displacement("the steady state")?;
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
        let wide = if drift == Drift::Upwind {
            1.0
        } else {
            timing::WIDE
        };
        Ok(Self {
            layout,
            tolerance: settings.tolerance,
            asked: settings.moments.clone(),
            integrates: oscillator.is_viscous(),
            cost: Cost {
                cells,
                steps: SOLVES as u64,
                memory: budget::memory(cells, drift, Factors::Real),
                seconds: 2.0 * n * wide * (timing::LU + SOLVES * timing::SOLVE),
            },
        })
    }

    /// Method and reason.
    pub(crate) fn words(&self) -> String {
        format!(
            "finite volumes, {}; null vector by sparse LU{}",
            self.layout.drift.name(),
            if self.integrates {
                ", and time integration"
            } else {
                ""
            }
        )
    }

    /// As [`steady`], by a recipe made before for the same oscillator.
    ///
    /// # Errors
    /// Those of [`steady`].
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
        adaptive::pursue(task, limits, progress)
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

    fn name(&self) -> String {
        NAME.into()
    }

    fn ratio(&self) -> Option<f64> {
        self.found.as_ref().map(|it| it.1)
    }

    fn next(&mut self) -> Result<Next> {
        if self.found.is_some() {
            let why = "what the truncated domain leaves out, or the rounding of the null vector, is larger";
            let free = !self.recipe.layout.is_given();
            return Ok(Next::Stop(Stop::new(why, free)));
        }
        Ok(Next::Run {
            now: self.recipe.cost.into(),
            then: None,
        })
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
            let it = Settled::within(oscillator, recipe.tolerance, &late)?;
            let sampled = |points: &[[f64; 2]]| it.law.densities(points);
            let density = Density::sampled(&mesh, generator.columns(), &sampled);
            (density, it.error)
        };
        let mass = exact.mass();
        let distance = |density: &Density| -> f64 {
            density
                .cells()
                .iter()
                .zip(exact.cells())
                .map(|(p, w)| (p - w / mass).abs())
                .sum()
        };
        let l1 = distance(&null);
        let outside = domain.neglected.max((1.0 - mass).abs());
        let mut density = Density::at_equilibrium(&generator, oscillator);
        let relaxation = 0.5 / oscillator.zeta();
        // Of a wide stencil each step would be a factorisation of seconds.
        let approach = if oscillator.is_viscous() {
            integrate(&generator, &mut density, relaxation, &distance, &late)?
        } else {
            Vec::new()
        };
        let mut warnings = Vec::new();
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
        moments.keep(recipe.asked.as_deref());
        let scales = Scales::of(oscillator).each(&moments);
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

/// The null vector of `generator`, positive with mass 1, and its residual |L P|_1/|L|_1.
///
/// Inverse iteration with the shift 1e-10 |L|_1: one LU, a convergence factor below 1e-3 even for
/// decay rates of 1e-7 |L|_1, and a backward error of a few roundings.
///
/// # Errors
/// [`Error::Mesh`] if some cells never exchange probability with the others, so that the null vector
/// would not be unique; [`Error::Linear`] if the iteration does not settle.
pub fn null_vector(generator: &Generator) -> Result<(Density, f64)> {
    let matrix = generator.matrix();
    check_connected(&matrix)?;
    let n = matrix.cols();
    let norm = matrix
        .outer_iterator()
        .map(|column| column.iter().map(|(_, a)| a.abs()).sum::<f64>())
        .fold(0.0, f64::max);
    let mut shifted = matrix.map(|a| -a);
    shift(&mut shifted, 1e-10 * norm);
    let mut lu = Lu::factor(shifted)?;
    let mut x = vec![1.0 / n as f64; n];
    let mut change = f64::INFINITY;
    // The start is the uniform density: nothing of (21) goes in.
    for _ in 0..40 {
        let before = x.clone();
        lu.solve(&mut x)?;
        let mass: f64 = x.iter().sum();
        for p in &mut x {
            *p /= mass;
        }
        let now = x.iter().zip(&before).map(|(a, b)| (a - b).abs()).sum();
        // Settled when rounding no longer lets the change fall.
        if now < 1e-13 || (now < 1e-9 && now > 0.5 * change) {
            change = now;
            break;
        }
        change = now;
    }
    if change > 1e-9 || change.is_nan() {
        let what = format!("inverse iteration still changes by {change:.1e} after 40 solves");
        return Err(Error::linear("steady state", what));
    }
    let mut image = vec![0.0; n];
    for (column, entries) in matrix.outer_iterator().enumerate() {
        for (row, a) in entries.iter() {
            image[row] += a * x[column];
        }
    }
    let residual = image.iter().map(|r| r.abs()).sum::<f64>() / norm;
    let mut density = Density::from_fn(generator, |_, _| 0.0);
    let number = generator.numbering();
    for (p, unknown) in density.cells_mut().iter_mut().zip(&number) {
        if *unknown != usize::MAX {
            *p = x[*unknown];
        }
    }
    Ok((density, residual))
}

/// Distance to the stationary law at which the time integration ends.
const ARRIVED: f64 = 1e-11;

/// Integrates `density` by backward Euler to the steady state until its `distance` to it is below [`ARRIVED`] or stops
/// falling, and returns time and distance after every step. `late` is asked before each.
///
/// The step starts at a thousandth of the relaxation time 1/(2 zeta) and doubles every five steps up
/// to 1000 of them, so that both the approach and its end are seen.
///
/// # Errors
/// Those of [`BackwardEuler::step`] and of `late`.
fn integrate(
    generator: &Generator,
    density: &mut Density,
    relaxation: f64,
    distance: &dyn Fn(&Density) -> f64,
    late: &dyn Fn() -> Result<()>,
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

/// Whether every unknown can be reached from every other, by the entries of the generator.
fn check_connected(matrix: &CsMat<f64>) -> Result<()> {
    let reached = |matrix: &CsMat<f64>| {
        let mut seen = vec![false; matrix.cols()];
        let mut queue = vec![0];
        seen[0] = true;
        let mut count = 1;
        while let Some(column) = queue.pop() {
            let Some(entries) = matrix.outer_view(column) else {
                continue;
            };
            for (row, a) in entries.iter() {
                if *a != 0.0 && !seen[row] {
                    seen[row] = true;
                    count += 1;
                    queue.push(row);
                }
            }
        }
        count
    };
    let n = matrix.cols();
    let forward = reached(matrix);
    // The transpose of a matrix by columns is one by rows: turn it back into columns.
    let backward = reached(&matrix.transpose_view().to_csc());
    if forward == n && backward == n {
        return Ok(());
    }
    Err(Error::Mesh {
        what: format!(
            "only {} of {n} cells exchange probability",
            forward.min(backward)
        ),
        help: "more cells: the streamlines of this mesh fall into separate parts".into(),
    })
}
