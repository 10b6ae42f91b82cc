//! What a transient will take, from the sizes of its mesh alone.

use super::propagator::{self, CHUNK};
use super::recipe::{RUNGS, Recipe, Rung, Scheme};
use super::start_up;
use crate::contact::ContactLaw;
use crate::error::Result;
use crate::fokker_planck::budget::{self, Cost, Factors, timing};
use crate::fokker_planck::flow_map::Settings;
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::generator::Generator;
use crate::fokker_planck::policy::{LADDER_RATIO, REFINED, SETTLED};
use crate::fokker_planck::settings::TimeScheme;
use crate::fokker_planck::solved::Settled;
use crate::initial::Initial;
use crate::oscillator::Oscillator;

/// The cost of a recipe. Lays out the mesh and takes no step on it: seconds are those of all threads, within a factor
/// of three for four in five (lab precision --calibrate).
///
/// # Errors
/// Those of the mesh: a scene it cannot hold, cells that do not fit the memory.
pub(super) fn foreseen(
    recipe: &Recipe,
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    max_memory: u64,
) -> Result<Cost> {
    let until = times.last().copied().unwrap_or(0.0);
    let rung = |r| recipe.rung(oscillator, initial, until, r);
    let cost = |rung: &Rung| run(rung, oscillator, initial, times, max_memory);
    let first = (RUNGS - 1) as f64;
    // Half of the rungs are enough for a local grid under constant friction, and for what begins and stays in a known law.
    let expected = rung(recipe.expected)?;
    let alone = oscillator.is_viscous()
        && start_up::cost(&expected, oscillator, initial, until)
            .is_some_and(|it| it.alone.is_some());
    let stays = *initial == Initial::Stationary
        && recipe.period.is_none()
        && recipe.forcing.is_none()
        && recipe.layout.drift != Drift::Upwind;
    let given = recipe.layout.is_given();
    let end = if (alone || stays) && !given {
        first.max(0.5 * recipe.expected)
    } else {
        recipe.expected
    };
    let finer = |k: usize| cost(&rung(end + k as f64)?);
    let last = recipe.layout.carried(finer)?;
    let shared = |seconds| {
        last.cells
            .map_or(seconds, |it| budget::on_threads(it, seconds))
    };
    // The first rungs, and others after them one by one.
    let shown = if given { end } else { first };
    let fall = LADDER_RATIO.get().powi(-3);
    let longest = last.seconds * fall.powf((end - shown).max(0.0));
    let sum = longest * (1.0 - fall.powi(RUNGS as i32)) / (1.0 - fall);
    let after = shared((last.seconds - longest) / (1.0 - fall));
    let seconds = after
        + if recipe.step.is_some() {
            // One of them with half the step too.
            shared(sum + cost(&rung(shown)?.halved())?.seconds)
        } else {
            // Side by side.
            shared(longest).max(sum / rayon::current_num_threads() as f64)
        };
    // The stationary law that distances are taken to, at the two resolutions that most take.
    let (bytes, operations) = if recipe.asks_for_law(oscillator, initial) {
        Settled::work()
    } else {
        (0, 0.0)
    };
    Ok(Cost {
        memory: last.memory.max(bytes),
        seconds: timing::TRANSIENT + seconds + timing::OPERATION * operations,
        ..last
    })
}

/// The time at which a run has come so close to the stationary law that it stops, at the latest: from a distance of 2
/// and the deviations between the initial condition and the law, by the slowest rate there may be. That is zeta, of
/// the means under weak friction; 1/(2 zeta), of q under strong friction; and where contact can be lost 1/(8 zeta T),
/// where the continuous spectrum begins.
fn settled(oscillator: &Oscillator, initial: &Initial, tolerance: f64) -> f64 {
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
    let slowest = (1.0 / zeta).max(2.0 * zeta);
    let slowest = slowest.max(oscillator.flight_relaxation());
    ((2.0 + away.max(0.0).sqrt()) / (SETTLED.get() * tolerance)).ln() * slowest
}

/// Stages of a Chebyshev series beyond its rate, which each output time asks for anew: those that bring its
/// tail to the tolerance.
const STAGES_BESIDE: f64 = 12.0;

/// Periods that the fixed point of a law that lasts takes: 52 to 56 for the Hertz law at zeta = 0.005, as many more
/// as a deviation lives.
const PERIODS: f64 = 60.0;

/// To build a map, a cell.
fn map_seconds(rung: &Rung, oscillator: &Oscillator) -> f64 {
    let traced = match oscillator.contact() {
        ContactLaw::Custom(_) => timing::TRACED_MAP,
        _ => timing::MAP,
    };
    if rung.forcing.is_some() || !oscillator.is_viscous() {
        traced + timing::SCALED_MAP
    } else {
        traced
    }
}

/// The cost of one run for the law that lasts.
fn lasting(
    rung: &Rung,
    oscillator: &Oscillator,
    period: f64,
    times: &[f64],
    max_memory: u64,
) -> Result<Cost> {
    let cells = rung.layout.count(oscillator, 1.0)?;
    let n = cells[0] as f64 * cells[1] as f64;
    let mut map = rung.flow_map();
    // Beside the vectors.
    let vectors = n * 8.0 * PERIODS;
    map.memory = max_memory.saturating_sub(vectors as u64);
    let [steps, passes, maps] = map.size(&[period], CHUNK);
    let [phase_steps, phase_passes, phase_maps] = map.size(times, CHUNK);
    let [each, rest] = Settings::bytes();
    let held = map.held(n) as f64;
    let entries = timing::FORCED_ENTRY * cells[1] as f64 / cells[0] as f64;
    let passing = timing::PASS * (PERIODS * passes + phase_passes);
    let building =
        map_seconds(rung, oscillator) * (maps + phase_maps) + entries * (passes + phase_passes);
    // Vectors, their products, and the numbers at each phase.
    let beside = timing::STAGE * PERIODS * PERIODS / 4.0 + timing::LOOK * times.len() as f64;
    Ok(Cost {
        cells: Some(cells),
        steps: (PERIODS * steps + phase_steps).ceil() as u64,
        memory: (n * (held * each + rest) + vectors) as u64,
        seconds: n * (passing + building + beside),
    })
}

/// The cost of one run.
pub(super) fn run(
    rung: &Rung,
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    max_memory: u64,
) -> Result<Cost> {
    if let Some(period) = rung.period {
        return lasting(rung, oscillator, period, times, max_memory);
    }
    let until = times.last().copied().unwrap_or(0.0);
    let start_up = start_up::cost(rung, oscillator, initial, until);
    if let Some((bill, side)) = start_up
        .as_ref()
        .and_then(|it| it.alone.map(|side| (it, side)))
    {
        // The local grid's own frame, the same whatever the mesh would be.
        let cells = [side; 2];
        return Ok(Cost {
            cells: Some(cells),
            steps: bill.steps.ceil() as u64,
            memory: budget::memory(cells, rung.drift(), Factors::None),
            seconds: bill.seconds,
        });
    }
    // What is left of the run for the mesh.
    let from = start_up.as_ref().map_or(0.0, |it| it.until);
    // However soon the run settles, it looks after whole chunks and at output times only.
    let chunk = match rung.scheme {
        Scheme::FlowMap => CHUNK * rung.flow_map().step,
        Scheme::Volumes(_) => 0.0,
    };
    let settled = settled(oscillator, initial, rung.tolerance);
    let end = match rung.acting() {
        None => {
            let next = times.iter().copied().find(|t| *t > settled);
            (settled + chunk).min(next.unwrap_or(until))
        }
        Some(_) => until,
    };
    let mut times: Vec<f64> = times.iter().filter(|t| **t > from).copied().collect();
    let looks = times.len() as f64;
    times.retain(|t| *t <= end);
    times.push(end.max(from));
    for t in &mut times {
        *t -= from;
    }
    let until = end.max(from) - from;
    // Behind a local grid half way to the finest mesh, which the memory has to hold.
    let finer = start_up.as_ref().map_or(1.0, |_| REFINED.get().sqrt());
    let cells = rung.layout.count_within(oscillator, finer, max_memory)?;
    let n = cells[0] as f64 * cells[1] as f64;
    let mut bytes = budget::memory(cells, rung.drift(), rung.scheme.factors()) as f64;
    let (steps, seconds) = match rung.scheme {
        Scheme::FlowMap => {
            let mut map = rung.flow_map();
            map.memory = max_memory;
            let [steps, passes, maps] = map.size(&times, CHUNK);
            let [each, rest] = Settings::bytes();
            let held = map.held(n * finer * finer) as f64;
            bytes = n * (maps.min(held) * each + rest);
            let mut pass = timing::PASS;
            if rung.acting().is_some() {
                // A matrix of its own for every node.
                let side = cells[1] as f64;
                bytes += 8.0 * side * side * passes.min(CHUNK);
                pass += timing::FORCED_ENTRY * side / cells[0] as f64;
            }
            (
                steps,
                n * (map_seconds(rung, oscillator) * maps + pass * passes),
            )
        }
        Scheme::Volumes(time) => {
            let generator = Generator::new(oscillator, &rung.mesh(oscillator)?, rung.drift())?;
            let (transport, diffusion) = generator.radii();
            match time {
                TimeScheme::BackwardEuler => {
                    let step = propagator::step_of(rung, oscillator, generator.mesh(), until);
                    let steps = until / step;
                    (steps, n * (timing::LU + timing::SOLVE * steps))
                }
                TimeScheme::Implicit => {
                    // Under strong friction steps follow the slow relaxation of q, forty to 2 zeta.
                    let pace = (20.0 / oscillator.zeta()).min(1.0);
                    let steps = 100.0 + pace * until;
                    // Ten factorisations.
                    let stages = 10.0 * timing::RADAU_LU_STAGES + timing::RADAU_STAGES * steps;
                    (steps, n * stages * timing::STAGE)
                }
                TimeScheme::Imex => {
                    let steps = until * transport / 3.8;
                    (steps, n * steps * timing::IMEX_STAGES * timing::STAGE)
                }
                TimeScheme::Explicit => {
                    let stages = 1.2 * (transport + 0.5 * diffusion) * until
                        + STAGES_BESIDE * times.len() as f64;
                    (stages, n * stages * timing::STAGE)
                }
            }
        }
    };
    Ok(Cost {
        cells: Some(cells),
        steps: steps.ceil() as u64,
        memory: (bytes * finer * finer) as u64,
        seconds: seconds + n * timing::LOOK * looks + start_up.map_or(0.0, |it| it.seconds),
    })
}
