//! One run of a transient: one recipe on one mesh, through the output times.

use super::cost;
use super::output::Output;
use super::propagator::{self, Propagator};
use super::recipe::{Recipe, Rung, Scheme};
use super::start_up::StartUp;
use crate::error::{Error, Result};
use crate::fokker_planck::budget::{self, Cost, Limits};
use crate::fokker_planck::convergence::{UNKNOWN, left};
use crate::fokker_planck::density::Density;
use crate::fokker_planck::domain::Domain;
use crate::fokker_planck::integrators::Late;
use crate::fokker_planck::krylov::Ritz;
use crate::fokker_planck::layout;
use crate::fokker_planck::mesh::Mesh;
use crate::fokker_planck::observables::Observables;
use crate::fokker_planck::policy::SETTLED;
use crate::fokker_planck::settings::TimeScheme;
use crate::fokker_planck::solved::{Law, Settled};
use crate::initial::Initial;
use crate::moments::{Moments, PerMoment};
use crate::oscillator::Oscillator;
use std::sync::Arc;

/// One run on one mesh.
#[derive(Clone)]
pub(super) struct Run {
    pub(super) outputs: Vec<Output>,
    pub(super) steps: u64,
    pub(super) step: f64,
    pub(super) mesh: Mesh,
    pub(super) domain: Domain,
    pub(super) unknowns: usize,
    /// Time from which on the density is the stationary law, within a small part of the tolerance, if it came to that.
    pub(super) settled: Option<f64>,
    /// What friction lacked of itself on cells too coarse for it, on the average over the density.
    pub(super) lacking: f64,
    /// Of the law that lasts under a drive.
    pub(super) over_a_period: Option<OverAPeriod>,
}

/// What the map over one period says beside its fixed point.
#[derive(Debug, Clone)]
pub(super) struct OverAPeriod {
    /// Its largest eigenvalues but 1.
    pub(super) multipliers: Vec<Ritz>,
    /// Change of the law over a period, in L1.
    pub(super) residual: f64,
    /// The two laws that it is made of where noise seldom passes from one orbit to the other.
    pub(super) metastable: Option<[Side; 2]>,
}

/// What noise makes of one of two orbits, for as long as it leaves a motion there.
#[derive(Debug, Clone)]
pub(super) struct Side {
    /// Its part of the law that lasts.
    pub(super) probability: f64,
    /// Its moments at the output times.
    pub(super) moments: Vec<Moments>,
}

/// A transient to be computed, and how.
#[derive(Clone, Copy)]
pub(super) struct Task<'a> {
    pub(super) oscillator: &'a Oscillator,
    pub(super) initial: &'a Initial,
    pub(super) times: &'a [f64],
    pub(super) density_times: &'a [f64],
    pub(super) recipe: &'a Recipe,
    pub(super) limits: &'a Limits,
    /// The stationary law, where it is not the one that g is taken against.
    pub(super) law: Option<&'a Settled>,
    /// What a law that it begins in may have done, over the normalisations.
    pub(super) begun: Option<&'a [PerMoment<f64>]>,
}

impl Task<'_> {
    pub(super) fn until(&self) -> f64 {
        self.times.last().copied().unwrap_or(0.0)
    }

    /// The run of rung `r`.
    pub(super) fn rung(&self, r: f64) -> Result<Rung> {
        self.recipe
            .rung(self.oscillator, self.initial, self.until(), r)
    }

    /// What a run through `times` is foreseen to take.
    pub(super) fn work(&self, rung: &Rung, times: &[f64]) -> Result<Cost> {
        let memory = self.limits.memory;
        cost::run(rung, self.oscillator, self.initial, times, memory)
    }

    /// Whether there is a stationary law, and it is known.
    pub(super) fn knows_law(&self) -> bool {
        self.oscillator.contact().is_confining()
            && (self.oscillator.is_viscous() || self.law.is_some())
    }
}

/// Negative mass, or mass that moves against too little friction, beyond which nothing is left of a density.
const NO_DENSITY: f64 = 0.1;

/// The change of every number if the negative cells were positive: where a density undershoots, two
/// meshes may agree on what is wrong.
fn undershoot(moments: &Moments, g: &[f64], observables: &Observables) -> [f64; 11] {
    if g.iter().all(|g| *g >= 0.0) {
        return [0.0; 11];
    }
    let positive: Vec<f64> = g.iter().map(|g| g.abs()).collect();
    let without = observables.raw(&positive).moments(observables.contact());
    let change = |k: usize| -> Option<f64> {
        let change = (without.named()[k].1?.value - moments.named()[k].1?.value).abs();
        change.is_finite().then_some(change)
    };
    std::array::from_fn(|k| change(k).unwrap_or(0.0))
}

/// What negative cells weigh beyond those of the law that a run began in, as far as noise has not filled them up.
fn beyond(output: &Output, (negative, weights): &(f64, [f64; 11])) -> [f64; 11] {
    let left = if output.negative < *negative {
        output.negative / negative
    } else {
        1.0
    };
    std::array::from_fn(|k| (output.undershoot[k] - left * weights[k]).max(0.0))
}

/// Refuses outputs that are no densities.
pub(super) fn believable(
    outputs: &[Output],
    step: f64,
    domain: &Domain,
    temperature: f64,
    mesh: &Mesh,
) -> Result<()> {
    if let Some(o) = outputs.iter().find(|o| !o.mass.is_finite()) {
        let t = o.t;
        let what = format!("the density grew without bound with steps of {step:.2e} up to t = {t}");
        let help = "a smaller method.step, or more method.cells";
        return Err(Error::mesh(what, help));
    }
    match outputs.iter().find(|o| o.negative > NO_DENSITY) {
        Some(o) => Err(lost(o, domain, temperature, mesh)),
        None => Ok(()),
    }
}

impl Run {
    /// Whether friction lacked so much of itself that its numbers are none.
    pub(super) fn is_none(&self) -> bool {
        self.lacking > NO_DENSITY
    }
}

/// A run whose density is none.
fn lost(o: &Output, domain: &Domain, temperature: f64, mesh: &Mesh) -> Error {
    let [nq, nv] = mesh.cells();
    let levels = domain.highest() / temperature;
    let what = format!(
        "at t = {} the density on {nq} x {nv} cells is negative by {:.1e} in all: between the initial condition and \
         the stationary law lie energies up to {levels:.0} T, and p over the stationary law spans \
         e^{levels:.0}",
        o.t, o.negative
    );
    let help = "an initial condition nearer to the stationary law, more method.cells, transient = \"finite_volume\", or \
                [monte_carlo] alone";
    Error::mesh(what, help)
}

impl Task<'_> {
    /// One run of a recipe.
    pub(super) fn run(&self, rung: &Rung, times: &[f64], progress: &dyn Fn(f64)) -> Result<Run> {
        let Self {
            oscillator,
            initial,
            limits,
            ..
        } = *self;
        let until = times.last().copied().unwrap_or(0.0);
        let in_time = |come: f64| {
            limits.in_time(|| format!("the transient had come to t = {come:.3} of {until}"))
        };
        let phase = StartUp::of(rung, oscillator, initial, self.law)?;
        let (phase, mut outputs) = self.start_up(phase, times, &mut |come| {
            progress(come / until);
            in_time(come)
        })?;
        if let Some(phase) = phase.as_ref().filter(|_| outputs.len() == times.len()) {
            return started_up(outputs, phase);
        }
        let mesh = self.mesh(rung, phase.as_ref())?;
        let clock = limits.clone();
        let late = move || clock.in_time(|| format!("the transient had not come to t = {until}"));
        let late: Late = Arc::new(late);
        let mut propagator =
            propagator::build(rung, oscillator, &mesh, until, (limits.memory, late))?;
        let reference = rung.reference(oscillator);
        let observables = Observables::new(reference, &mesh, rung.drift(), propagator.weights())?;
        let laws = self.laws(rung, &propagator)?;
        let (mut density, handed) = match (&phase, self.law) {
            (None, Some(_)) if *initial == Initial::Stationary => (laws[0].clone(), 0.0),
            (None, _) => (propagator.start(oscillator, initial)?, 0.0),
            (Some(phase), _) => phase.density(&propagator),
        };
        // What is forced comes to no stationary law.
        let settles = self.knows_law() && rung.acting().is_none();
        let close = SETTLED.get() * rung.tolerance;
        let mut settled = None;
        // Short steps are not all looked at.
        let every = match rung.scheme {
            Scheme::Volumes(TimeScheme::Imex) => 16,
            _ => 1,
        };
        let columns = propagator.columns().to_vec();
        let (mut now, lost, before) = phase.as_ref().map_or_else(Default::default, |it| {
            let grid = it.grid();
            (grid.time(), it.loss() + handed, grid.steps())
        });
        let solved = self.solved_for(&propagator, &observables, &density);
        propagator.set_time(now);
        let mut looks = 0_u64;
        for &t in &times[outputs.len()..] {
            // No step goes across a bend of the envelope.
            for stop in rung.stops(now, t) {
                if now >= stop || settled.is_some() {
                    break;
                }
                let mut watch = |done: f64, density: &Density| {
                    looks += 1;
                    if !looks.is_multiple_of(every) {
                        return Ok(true);
                    }
                    progress((now + done) / until);
                    in_time(now + done)?;
                    if settles && density.distance_to(&laws[0], &columns) < close {
                        settled = Some(now + done);
                    }
                    Ok(settled.is_none())
                };
                propagator.advance(&mut density, stop - now, &mut watch)?;
                now = stop;
            }
            let output = self.observe(t, &propagator, &observables, (&density, &laws));
            outputs.push(Output {
                steps: propagator.steps(),
                step_error: propagator.step_error(),
                undershoot: beyond(&output, &solved),
                lost: lost + propagator.lacking(),
                ..output
            });
        }
        let domain = phase.as_ref().map_or(rung.layout.domain, StartUp::domain);
        let (step, temperature) = (propagator.step(), oscillator.temperature());
        believable(&outputs, step, &domain, temperature, &mesh)?;
        Ok(Run {
            outputs,
            steps: before + propagator.steps(),
            step: propagator.step(),
            mesh,
            domain,
            unknowns: propagator.unknowns(),
            settled,
            lacking: propagator.lacking(),
            over_a_period: None,
        })
    }

    /// The law on the mesh that distances are taken to, and where it is solved for a coarser one, for what it may be off.
    fn laws(&self, rung: &Rung, propagator: &Propagator) -> Result<Vec<Density>> {
        if let Some(it) = self.law {
            let laws = [&it.law, &it.coarser].into_iter();
            let sampled = |law: &Law| propagator.sampled(&|points| law.densities(points));
            return Ok(laws.map(sampled).collect());
        }
        if rung.forcing.is_none() || rung.acting().is_some() || !self.knows_law() {
            return Ok(vec![propagator.reference()]);
        }
        Ok(vec![propagator.stationary(self.oscillator, [0.0; 2])?])
    }

    /// The mesh of a run, if it fits.
    pub(super) fn mesh(&self, rung: &Rung, start_up: Option<&StartUp<'_>>) -> Result<Mesh> {
        let mesh = match start_up {
            None => rung.mesh(self.oscillator)?,
            Some(start_up) => start_up.mesh()?,
        };
        self.check_memory(rung, mesh.cells())?;
        Ok(mesh)
    }

    /// The negative mass of a stationary initial condition that is solved for, and what its cells weigh: they are in its own
    /// error.
    fn solved_for(
        &self,
        propagator: &Propagator,
        observables: &Observables,
        density: &Density,
    ) -> (f64, [f64; 11]) {
        if self.begun.is_none() {
            return (0.0, [0.0; 11]);
        }
        let g = propagator.ratio(density);
        let moments = observables.raw(&g).moments(observables.contact());
        let weights = undershoot(&moments, &g, observables);
        (density.negative_mass(), weights)
    }

    /// Whether a run on so many cells fits.
    fn check_memory(&self, rung: &Rung, cells: [usize; 2]) -> Result<()> {
        let limits = self.limits;
        let given = rung.layout.is_given();
        let needed = match rung.scheme {
            Scheme::FlowMap => budget::flow_map_memory(cells),
            Scheme::Volumes(_) => budget::memory(cells, rung.drift(), rung.scheme.factors()),
        };
        budget::check_memory(needed, cells, given, limits.memory)?;
        let whole = budget::factoring(cells, rung.drift(), rung.scheme.factors());
        limits.room_for(whole, || format!("a mesh of {cells:?} cells"))
    }

    /// Carries a local grid, if there is one, through the times that it reaches before a mesh takes over.
    fn start_up<'b>(
        &self,
        mut start_up: Option<StartUp<'b>>,
        times: &[f64],
        watch: &mut dyn FnMut(f64) -> Result<()>,
    ) -> Result<(Option<StartUp<'b>>, Vec<Output>)> {
        let mut outputs = Vec::with_capacity(times.len());
        if let Some(start_up) = &mut start_up {
            for &t in times {
                if !start_up.advance(t, watch)? {
                    break;
                }
                outputs.push(self.look(t, start_up)?);
            }
        }
        Ok((start_up, outputs))
    }

    /// Leaves out what has no meaning or was not asked for.
    fn keep(&self, moments: &mut Moments) {
        moments.drop_standardised_in_flight(layout::neglected(self.recipe.tolerance));
        moments.keep(self.recipe.moments.as_deref());
    }

    pub(super) fn observe(
        &self,
        t: f64,
        propagator: &Propagator,
        observables: &Observables,
        (density, laws): (&Density, &[Density]),
    ) -> Output {
        let columns = propagator.columns();
        let wanted = self.density_times.contains(&t);
        let g = propagator.ratio(density);
        let mut moments = observables.raw(&g).moments(observables.contact());
        self.keep(&mut moments);
        Output {
            t,
            moments,
            undershoot: undershoot(&moments, &g, observables),
            mass: density.mass(),
            lowest: density.lowest(),
            negative: density.negative_mass(),
            entropy: density.entropy_to(&laws[0], columns),
            distance: density.distance_to(&laws[0], columns),
            doubt: match (laws, self.law) {
                ([law, coarser], Some(it)) => {
                    let apart = density.entropy_between(law, coarser);
                    [left(UNKNOWN) * apart, it.error]
                }
                _ => [0.0; 2],
            },
            snapshot: wanted.then(|| density.snapshot(t)),
            ..Output::default()
        }
    }

    /// What a local grid says at time t.
    fn look(&self, t: f64, start_up: &StartUp) -> Result<Output> {
        let mut output = start_up.look(t);
        self.keep(&mut output.moments);
        if self.density_times.contains(&t) {
            output.snapshot = Some(start_up.snapshot(t)?);
        }
        Ok(output)
    }
}

/// A run that never left the frame of its local grid.
fn started_up(outputs: Vec<Output>, start_up: &StartUp) -> Result<Run> {
    let mesh = start_up.own_mesh()?;
    Ok(Run {
        outputs,
        steps: start_up.grid().steps(),
        step: start_up.grid().step(),
        unknowns: mesh.len(),
        mesh,
        domain: start_up.domain(),
        settled: None,
        lacking: 0.0,
        over_a_period: None,
    })
}
