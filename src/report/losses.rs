//! First losses and flights as files.

use super::File;
use super::csv::Csv;
use super::data::histogram;
use super::npz::{archive, arrays, vector, with_errors};
use crate::error::Result;
use crate::estimate::Estimate;
use crate::fokker_planck::{FirstLoss, FlightLaw};
use crate::monte_carlo::FirstLossResult;
use crate::results::Results;

/// Table and arrays of that name: survival, its complement and density of a first loss or a first passage, beside the
/// paths.
pub(super) fn survival(
    results: &Results,
    name: &str,
    (it, paths): (&FirstLoss, Option<&FirstLossResult>),
) -> Result<Vec<File>> {
    let curves: [(&str, &[Estimate]); 3] = [
        ("survival", &it.survival),
        ("lost", &it.lost),
        ("density", &it.density),
    ];
    let mut table = Csv::of(results).plain("t", "1/W", it.times.iter().copied());
    for ((name, curve), unit) in curves.into_iter().zip(["1", "1", "W"]) {
        table = table.curve(name, "error", unit, curve);
    }
    if let Some(paths) = paths {
        let mean = "mean density of paths since the time before";
        table = table
            .curve("survival of paths", "standard error", "1", &paths.survival)
            .curve(mean, "standard error", "W", &paths.density);
    }
    let mut numbers = vec![("mean_time", it.mean_time), ("rate", it.rate)];
    numbers.retain(|it| !it.1.value.is_nan());
    let npz = format!("{name}.npz");
    let arrays = arrays(&npz, results, &it.times, &curves, &numbers)?;
    Ok(vec![table.file(&format!("{name}.csv")), arrays])
}

/// flight_law.csv and flight_law.npz: the density of the time of flight.
pub(super) fn flights(results: &Results, it: &FlightLaw) -> Result<Vec<File>> {
    let table = Csv::of(results)
        .plain("flight time", "1/W", it.times.iter().copied())
        .curve("density", "error", "W", &it.density);
    let curves: [(&str, &[Estimate]); 1] = [("density", &it.density)];
    let arrays = arrays("flight_law.npz", results, &it.times, &curves, &[])?;
    Ok(vec![table.file("flight_law.csv"), arrays])
}

/// impact_speed.csv, impact_force.csv and impacts.npz: the law of an impact; with long realisations what they saw of it.
pub(super) fn impacts(results: &Results) -> Result<Vec<File>> {
    let mut files = Vec::new();
    if let Some(it) = &results.impacts {
        let curve = |name: &str, (head, unit), per, at: &[f64], density: &[Estimate]| {
            Csv::of(results)
                .plain(head, unit, at.iter().copied())
                .curve("density", "error", per, density)
                .file(name)
        };
        let speed = ("speed at the return", "u W");
        let (speeds, density) = (&it.speeds, &it.speed_density);
        files.push(curve("impact_speed.csv", speed, "1/(u W)", speeds, density));
        let force = ("peak force of the undamped contact", "F");
        let (forces, density) = (&it.forces, &it.force_density);
        files.push(curve("impact_force.csv", force, "1/F", forces, density));
        let axes = [("t", &it.times[..]), ("speed", &it.speeds[..])];
        let shape = [it.times.len(), it.speeds.len()];
        files.push(joint("impacts.npz", axes, shape, &it.density)?);
    }
    let seen = results.sampled_crossings().map(|(seen, _)| seen);
    if let Some(seen) = seen.filter(|it| it.mean_flight.value.is_finite()) {
        let (it, speed) = (&seen.impacts, ("speed", ["u W", "1/(u W)"]));
        let bins = &seen.impact_speed;
        files.push(histogram(results, "impacts_seen.csv", speed, bins));
        let axes = [("t_edges", &it.times[..]), ("speed_edges", &it.speeds[..])];
        let shape = [it.times.len() - 1, it.speeds.len() - 1];
        files.push(joint("impacts_seen.npz", axes, shape, &it.density)?);
    }
    Ok(files)
}

/// density[t, speed] and its error over their axes.
fn joint(
    name: &str,
    axes: [(&str, &[f64]); 2],
    shape: [usize; 2],
    all: &[Estimate],
) -> Result<File> {
    let axes = axes.map(|(name, at)| vector(name, at.iter().copied()));
    let both = with_errors(["density", "error"], all, 1.0);
    let both = both.map(|(name, _, numbers)| (name, shape.to_vec(), numbers));
    archive(name, axes.into_iter().chain(both))
}
