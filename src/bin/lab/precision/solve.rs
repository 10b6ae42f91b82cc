//! One run of one method, from nothing to its numbers.

use super::case::Case;
use super::method::{Level, Method};
use vibroimpact::error::Result;
use vibroimpact::fokker_planck::budget::{self, Factors};
use vibroimpact::fokker_planck::flow_map::{self, FlowMap};
use vibroimpact::fokker_planck::{
    Density, Drift, Generator, Mesh, Observables, Settings, TimeScheme, transient,
};
use vibroimpact::moments::Moments;
use vibroimpact::monte_carlo::{self, Sampling, Scheme};

#[derive(Debug, Clone)]
pub(super) struct Answer {
    pub(super) moments: Moments,
    /// None for paths.
    pub(super) density: Option<Density>,
    pub(super) unknowns: usize,
    pub(super) steps: u64,
    /// Estimated bytes of all arrays.
    pub(super) memory: u64,
}

impl Answer {
    /// Cells in q and v.
    pub(super) fn cells(&self) -> [usize; 2] {
        self.density.as_ref().map_or([0; 2], |it| it.mesh().cells())
    }
}

/// Part of the error aimed at that the start and the stationary law may leave outside the truncated domain.
/// It does not bound the error of the truncated domain: of the linear case, at order 8 and 1e-6, 5e-8 outside
/// make an L1 error of 2.4e-6, 1e-10 one of 1.6e-7.
const DOMAIN_SHARE: f64 = 0.05;

/// Part of it that the steps may make.
const STEPS: f64 = 0.3;

pub(super) fn mesh(case: &Case, drift: Drift, level: &Level) -> Result<Mesh> {
    let settings = Settings {
        neglected: Some((DOMAIN_SHARE * level.tolerance).min(5e-4)),
        ..Settings::default()
    };
    case.mesh(drift, &settings, level.finer)
}

/// Runs a method; paths take the seed.
pub(super) fn solve(case: &Case, method: Method, level: &Level, seed: u64) -> Result<Answer> {
    match method {
        Method::Volumes { drift, time } => volumes(case, drift, time, level),
        Method::FlowMap { splitting } => {
            let oscillator = &case.oscillator;
            let mesh = mesh(case, Drift::Order8, level)?;
            // Shorter steps let grid noise grow.
            let shortest = FlowMap::shortest_step(oscillator, &mesh);
            let step = flow_map::Settings::to(STEPS * level.tolerance, oscillator)?.step;
            let step = step.max(shortest);
            let settings = flow_map::Settings {
                splitting,
                step,
                ..flow_map::Settings::default()
            };
            let mut map = FlowMap::new(oscillator, &mesh, settings)?;
            let mut density = map.start(&case.initial)?;
            map.advance(&mut density, case.until)?;
            let observables = Observables::new(oscillator, &mesh, Drift::Order8, map.weights())?;
            Ok(Answer {
                moments: observables
                    .raw(&map.ratio(&density))
                    .moments(oscillator.contact()),
                unknowns: map.columns().iter().map(std::ops::Range::len).sum(),
                steps: map.progress().steps as u64,
                memory: budget::flow_map_memory(mesh.cells()),
                density: Some(density),
            })
        }
        Method::Paths(scheme) => paths(case, scheme, level.paths, seed),
    }
}

fn volumes(case: &Case, drift: Drift, time: TimeScheme, level: &Level) -> Result<Answer> {
    let (mesh, oscillator) = (&mesh(case, drift, level)?, &case.oscillator);
    let generator = Generator::new(oscillator, mesh, drift)?;
    let tolerance = STEPS * level.tolerance;
    let mut integration =
        transient::time_integration(oscillator, &generator, time, tolerance, None, case.until);
    let mut density = Density::start(&generator, &case.initial)?;
    integration.advance(&mut density, case.until, &mut |_, _| Ok(true))?;
    let observables = Observables::new(oscillator, mesh, drift, generator.weights())?;
    Ok(Answer {
        moments: observables
            .raw(&density.ratio(&generator))
            .moments(oscillator.contact()),
        unknowns: generator.unknowns(),
        steps: integration.steps(),
        memory: budget::memory(mesh.cells(), drift, Factors::of(time)),
        density: Some(density),
    })
}

fn paths(case: &Case, scheme: Scheme, paths: u64, seed: u64) -> Result<Answer> {
    let settings = Sampling {
        paths,
        seed,
        scheme,
        ..Sampling::default()
    };
    let (oscillator, times) = (&case.oscillator, [case.until]);
    let it = monte_carlo::run(oscillator, &case.initial, &times, &settings, &|_| ())?;
    Ok(Answer {
        moments: it.moments[0],
        density: None,
        unknowns: 0,
        steps: it.steps,
        // Sums and noise of one task a thread.
        memory: rayon::current_num_threads() as u64 * 1_000_000,
    })
}
