//! What a computation will take, from the sizes of its mesh alone: for plans.

use super::choice::{self, Cost, Settings, TimeScheme};
use super::flux::Drift;
use super::mesh::Mesh;
use crate::error::Result;
use crate::initial::Initial;
use crate::oscillator::Oscillator;

/// A computation to be costed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Task {
    /// The transient to a time.
    Transient {
        /// The last time.
        until: f64,
    },
    /// The steady state.
    Steady,
    /// The slowest decay rates.
    DecayRates,
}

/// The cost of a task and what it would be done with. Lays out the mesh, computes nothing on it: steps
/// are those of the stability limit of a uniform mesh, seconds those of one core, within a factor of
/// about three.
///
/// # Errors
/// Those of the mesh: a scene it cannot hold, cells that do not fit the memory.
pub fn cost(
    oscillator: &Oscillator,
    initial: &Initial,
    task: Task,
    settings: &Settings,
) -> Result<(Cost, String)> {
    let (drift, time, reason) = choice::schemes(settings)?;
    let (start, until, drift, matrix) = match task {
        Task::Transient { until } => (initial, until, drift, time == TimeScheme::BackwardEuler),
        Task::Steady => (
            &Initial::Stationary,
            0.0,
            settings.drift.unwrap_or(Drift::Upwind),
            true,
        ),
        Task::DecayRates => (
            &Initial::Stationary,
            0.0,
            settings.drift.unwrap_or(Drift::Order8),
            true,
        ),
    };
    let (mesh, _) = choice::mesh(oscillator, start, until, drift, settings, 1.0)?;
    let cells = mesh.cells();
    let memory = choice::memory(cells, drift, matrix);
    let n = cells[0] as f64 * cells[1] as f64;
    let steps = match task {
        Task::Transient { .. } => until / step(oscillator, &mesh, time, settings),
        // The march to the steady state; three shifts on two meshes.
        Task::Steady => 200.0,
        Task::DecayRates => 6.0,
    };
    // 50 ns per cell and step without a matrix, and the coarse run besides; 2 us per cell and factorisation, 0.1 us per cell and
    // solve with the one of five points, ten times that with a wide one.
    let wide = if drift == Drift::Upwind { 1.0 } else { 10.0 };
    let seconds = match (task, matrix) {
        (Task::Transient { .. }, false) => n * steps * 50e-9 * 1.4,
        (Task::DecayRates, _) => n * steps * 2e-6 * wide,
        _ => n * wide * (2e-6 + 0.1e-6 * steps),
    };
    let words = match task {
        Task::Transient { .. } => format!("{} in time, {reason}", time.name()),
        Task::Steady => "null vector by sparse LU, and a march".into(),
        Task::DecayRates => "shift and invert on two meshes".into(),
    };
    let cost = Cost {
        cells,
        steps: steps.ceil() as u64,
        memory,
        seconds,
    };
    Ok((cost, format!("finite volumes, {drift:?}; {words}")))
}

/// About the step that a run would take.
fn step(oscillator: &Oscillator, mesh: &Mesh, time: TimeScheme, settings: &Settings) -> f64 {
    let narrowest = |edges: &[f64]| {
        let widths = edges.windows(2).map(|pair| pair[1] - pair[0]);
        widths.fold(f64::INFINITY, f64::min)
    };
    let (dq, dv) = (narrowest(mesh.q.edges()), narrowest(mesh.v.edges()));
    let [q_lo, q_hi, v_lo, v_hi] = mesh.domain();
    let fastest = v_hi.max(-v_lo);
    if time == TimeScheme::BackwardEuler {
        return settings.step.unwrap_or(3.0 * dq / fastest);
    }
    let contact = oscillator.contact();
    let force = contact.force(q_hi).abs().max(contact.force(q_lo).abs());
    // The largest speed and the largest force are never in the same corner of the energy level.
    let transport = 5.2 * (fastest / dq).max(force / dv);
    let stable = 2.6 / (transport + 6.0 * oscillator.noise() / (dv * dv));
    settings.step.map_or(stable, |step| step.min(stable))
}
