//! What a computation will take, from the sizes of its mesh alone: for plans.

use super::choice::{self, Cost, Factors, Settings, TimeScheme, Way};
use super::flow_map::HELD;
use super::flux::Drift;
use super::generator::Generator;
use super::opening;
use super::propagator::CHUNK;
use super::refinement;
use super::transient::SETTLED;
use crate::error::Result;
use crate::initial::Initial;
use crate::oscillator::Oscillator;

/// A computation to be costed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Task<'a> {
    /// The transient through these times, ascending.
    Transient(&'a [f64]),
    /// The steady state.
    Steady,
    /// The slowest decay rates.
    DecayRates,
    /// A spectrum.
    Spectrum,
}

/// The cost of a task and what it would be done with. Lays out the mesh and takes no step on it: seconds
/// are those of all threads, within a factor of about three.
///
/// # Errors
/// Those of the mesh: a scene it cannot hold, cells that do not fit the memory.
pub fn cost(
    oscillator: &Oscillator,
    initial: &Initial,
    task: Task,
    settings: &Settings,
) -> Result<(Cost, String)> {
    let times = match task {
        Task::Transient(times) => times,
        Task::Spectrum => return Ok(super::spectrum::cost(settings)),
        Task::DecayRates => return Ok(super::modes::cost(settings)),
        Task::Steady => return steady_cost(oscillator, settings),
    };
    // The box that the transient will choose.
    let settings = &Settings {
        neglected: Some(refinement::neglected(oscillator, initial, settings)?),
        ..settings.clone()
    };
    let (drift, way, reason) = choice::way(oscillator, initial, times, settings)?;
    let size = |finer: f64| {
        let way = (drift, way);
        run(oscillator, initial, times, way, settings, (finer, 1.0))
    };
    let [first, last] = choice::guesses(way, oscillator, initial, times, settings)?;
    let (first, fine) = match way {
        Way::FlowMap => (first, size(first)?),
        Way::Volumes(_) => choice::finer_until_held(settings, first, size)?,
    };
    // The coarse run that measures the error takes half of the fine one, and where the steps may have a part in
    // it another one tells.
    let seconds = 1.8 * fine.seconds;
    let mut cost = Cost {
        seconds: on_threads(fine.cells, seconds),
        ..fine
    };
    if last > first {
        let refined = size(last)?;
        cost = Cost {
            seconds: on_threads(refined.cells, seconds + refined.seconds),
            ..refined
        };
    }
    Ok((cost, format!("{}; {reason}", way.name(drift))))
}

/// Seconds a cell of one core: to trace a flow map and find its stencils, for a pass of the motion and the
/// noise, and for the numbers of an output time.
const MAP_SECONDS: f64 = 0.3e-6;
const PASS_SECONDS: f64 = 20e-9;
const LOOK_SECONDS: f64 = 60e-9;

/// Seconds of one core on all threads: those of small meshes are not shared, and of two threads 1.75 times as
/// much came as of one.
fn on_threads([nq, nv]: [usize; 2], seconds: f64) -> f64 {
    const SHARED: usize = 7000;
    const GAIN: f64 = 0.8;
    if nq * nv < SHARED {
        seconds
    } else {
        seconds / (rayon::current_num_threads() as f64).powf(GAIN)
    }
}

/// The time at which a run has come so close to the stationary law that it stops, at the latest: from a distance of 2
/// and the deviations between the initial condition and the law, by the slowest rate there may be. That is zeta, of
/// the means under weak friction; 1/(2 zeta), of q under strong friction; and where contact can be lost 1/(8 zeta T),
/// where the continuous spectrum begins.
fn settled(oscillator: &Oscillator, initial: &Initial, settings: &Settings) -> f64 {
    if !oscillator.contact().is_confining() {
        return f64::INFINITY;
    }
    let (zeta, temperature) = (oscillator.zeta(), oscillator.temperature());
    let away = match initial {
        Initial::Stationary => return 0.0,
        Initial::Rest => 0.0,
        Initial::Gaussian {
            mean: [q, v],
            deviation: [sq, sv],
        } => (oscillator.energy(*q, *v) + sq * sq + sv * sv) / temperature,
    };
    let mut slowest = (1.0 / zeta).max(2.0 * zeta);
    if oscillator.contact().loss_point().is_some() {
        slowest = slowest.max(8.0 * zeta * temperature);
    }
    ((2.0 + away.max(0.0).sqrt()) / (SETTLED * settings.tolerance)).ln() * slowest
}

/// Stages of a Chebyshev series beyond its rate, which each output time asks for anew: those that bring its
/// tail to the tolerance.
const STAGES_BESIDE: f64 = 12.0;

/// The cost of one run on a mesh `finer` times as fine as the first guess, with steps `longer` times as
/// long.
pub(super) fn run(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    (drift, way): (Drift, Way),
    settings: &Settings,
    (finer, longer): (f64, f64),
) -> Result<Cost> {
    let until = times.last().copied().unwrap_or(0.0);
    let opening = opening::cost(oscillator, initial, until, drift, settings)?;
    if let Some((bill, side)) = opening
        .as_ref()
        .and_then(|it| it.alone.map(|side| (it, side)))
    {
        // The packet's own frame, the same whatever the mesh would be.
        let cells = [(side as f64 * finer) as usize; 2];
        return Ok(Cost {
            cells,
            steps: bill.steps.ceil() as u64,
            memory: choice::memory(cells, drift, Factors::None),
            seconds: bill.seconds * finer.powi(2) / longer,
        });
    }
    // What is left of the run for the mesh.
    let from = opening.as_ref().map_or(0.0, |it| it.until);
    // However soon the run settles, it looks after whole chunks only.
    let chunk = match way {
        Way::FlowMap => CHUNK * choice::flow_map_settings(oscillator, settings, longer)?.step,
        Way::Volumes(_) => 0.0,
    };
    let end = (settled(oscillator, initial, settings) + chunk).min(until);
    let mut times: Vec<f64> = times.iter().filter(|t| **t > from).copied().collect();
    let looks = times.len() as f64;
    times.retain(|t| *t <= end);
    times.push(end.max(from));
    for t in &mut times {
        *t -= from;
    }
    let until = end.max(from) - from;
    let finer = finer * opening.as_ref().map_or(1.0, |_| opening::REFINED);
    let (mesh, _) = choice::mesh(oscillator, initial, until, drift, settings, finer)?;
    let cells = mesh.cells();
    let n = cells[0] as f64 * cells[1] as f64;
    let factors = match way {
        Way::FlowMap => Factors::None,
        Way::Volumes(time) => Factors::of(time),
    };
    let mut bytes = choice::memory(cells, drift, factors) as f64;
    let (steps, seconds) = match way {
        Way::FlowMap => {
            let map = choice::flow_map_settings(oscillator, settings, longer)?;
            let [steps, passes, maps] = map.size(&times, CHUNK);
            let [each, rest] = map.bytes();
            bytes = n * (maps.min(HELD) * each + rest);
            (steps, n * (MAP_SECONDS * maps + PASS_SECONDS * passes))
        }
        Way::Volumes(time) => {
            let generator = Generator::new(oscillator, &mesh, drift)?;
            let (transport, diffusion) = generator.radii();
            // A cell: a stage takes 8 ns, an IMEX step 140; the LU of five points 2 us to make and 0.1 us to
            // solve with, that of a wide stencil 50 and 3, about as much as GMRES with that of five points.
            match time {
                TimeScheme::BackwardEuler => {
                    let steps = until / (longer * choice::euler_step(&generator, settings));
                    (steps, n * (2e-6 + 0.1e-6 * steps))
                }
                TimeScheme::Implicit => {
                    // Under strong friction steps follow the slow relaxation of q, forty to 2 zeta.
                    let pace = (20.0 / oscillator.zeta()).min(1.0);
                    let steps = (100.0 + pace * until) / longer;
                    (steps, n * (50e-6 + 3e-6 * steps))
                }
                TimeScheme::Imex => {
                    let steps = until * transport / 3.8;
                    (steps, n * steps * 140e-9)
                }
                TimeScheme::Explicit => {
                    let stages = 1.2 * (transport + 0.5 * diffusion) * until
                        + STAGES_BESIDE * times.len() as f64;
                    (stages, n * stages * 8e-9)
                }
            }
        }
    };
    Ok(Cost {
        cells,
        steps: steps.ceil() as u64,
        memory: bytes as u64,
        seconds: seconds + n * LOOK_SECONDS * looks + opening.map_or(0.0, |it| it.seconds),
    })
}

fn steady_cost(oscillator: &Oscillator, settings: &Settings) -> Result<(Cost, String)> {
    let drift = settings.drift.unwrap_or(Drift::Upwind);
    let (mesh, _) = choice::mesh(oscillator, &Initial::Stationary, 0.0, drift, settings, 1.0)?;
    let cells = mesh.cells();
    let n = cells[0] as f64 * cells[1] as f64;
    // A factorisation takes 2 us a cell with the stencil of five points, ten times that with a wide one;
    // a solve a twentieth of it.
    let wide = if drift == Drift::Upwind { 1.0 } else { 10.0 };
    let cost = Cost {
        cells,
        steps: 60,
        memory: choice::memory(cells, drift, Factors::Real),
        seconds: 2.0 * n * wide * (2e-6 + 60.0 * 0.1e-6),
    };
    let words = "null vector by sparse LU, and a march";
    Ok((cost, format!("finite volumes, {}; {words}", drift.name())))
}
