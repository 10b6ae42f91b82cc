//! First losses and flights as files.

use super::File;
use super::data::{arrays, field, fields, histogram, tables};
use crate::error::Result;
use crate::estimate::Estimate;
use crate::results::Results;
use ndarray::Array2;
use std::fmt::Write;

/// first_loss.csv and first_loss.npz: survival, its complement and density of the first loss, beside the paths.
pub(super) fn first_loss(results: &Results) -> Result<Vec<File>> {
    let Some(it) = &results.first_loss else {
        return Ok(Vec::new());
    };
    let paths = results.first_loss_paths.as_ref();
    let mut table = String::from(
        "t [1/W],survival [1],error [1],lost [1],error [1],density [W],error [W],survival of paths [1],standard error [1],\
         mean density since the time before [W],standard error [W]\n",
    );
    for (k, t) in it.times.iter().enumerate() {
        let _ = writeln!(
            table,
            "{},{},{},{},{},{}",
            field(*t),
            fields(it.survival.get(k).copied()),
            fields(it.lost.get(k).copied()),
            fields(it.density.get(k).copied()),
            fields(paths.and_then(|it| it.survival.get(k).copied())),
            fields(paths.and_then(|it| it.density.get(k).copied()))
        );
    }
    let arrays = arrays(
        "first_loss.npz",
        &it.times,
        &[
            ("survival", &it.survival),
            ("lost", &it.lost),
            ("density", &it.density),
        ],
        &[("mean_time", it.mean_time), ("rate", it.rate)],
    )?;
    Ok(vec![File::text("first_loss.csv", table), arrays])
}

/// flight_law.csv and flight_law.npz: the density of the time of flight.
pub(super) fn flights(results: &Results) -> Result<Vec<File>> {
    let Some(it) = &results.flights else {
        return Ok(Vec::new());
    };
    let mut table = String::from("flight time [1/W],density [W],error [W]\n");
    for (t, density) in it.times.iter().zip(&it.density) {
        let _ = writeln!(table, "{},{}", field(*t), fields(Some(*density)));
    }
    let arrays = arrays(
        "flight_law.npz",
        &it.times,
        &[("density", &it.density)],
        &[],
    )?;
    Ok(vec![File::text("flight_law.csv", table), arrays])
}

/// impact_speed.csv, impact_force.csv and impacts.npz: the law of an impact; with long records what they saw of it.
pub(super) fn impacts(results: &Results) -> Result<Vec<File>> {
    let mut files = Vec::new();
    if let Some(it) = &results.impacts {
        let curve = |name: &str, head: &str, at: &[f64], density: &[Estimate]| {
            let mut table = format!("{head}\n");
            for (x, density) in at.iter().zip(density) {
                let _ = writeln!(table, "{},{}", field(*x), fields(Some(*density)));
            }
            File::text(name, table)
        };
        let speed = "speed at the return [u W],density [1/(u W)],error [1/(u W)]";
        files.push(curve(
            "impact_speed.csv",
            speed,
            &it.speeds,
            &it.speed_density,
        ));
        let force = "peak force of the undamped contact [F],density [1/F],error [1/F]";
        files.push(curve(
            "impact_force.csv",
            force,
            &it.forces,
            &it.force_density,
        ));
        let axes = [("t", it.times.clone()), ("speed", it.speeds.clone())];
        files.push(joint(
            "impacts.npz",
            &axes,
            [it.times.len(), it.speeds.len()],
            &it.density,
        )?);
    }
    if let Some((seen, _)) = results
        .sampled_crossings()
        .filter(|(it, _)| it.mean_flight.value.is_finite())
    {
        let it = &seen.impacts;
        files.push(histogram(
            "impacts_seen.csv",
            "speed",
            ["u W", "1/(u W)"],
            &seen.impact_speed,
        ));
        let axes = [
            ("t_edges", it.times.clone()),
            ("speed_edges", it.speeds.clone()),
        ];
        let shape = [it.times.len() - 1, it.speeds.len() - 1];
        files.push(joint("impacts_seen.npz", &axes, shape, &it.density)?);
    }
    Ok(files)
}

/// density[t, speed] and its error over their axes.
fn joint(
    name: &str,
    axes: &[(&str, Vec<f64>)],
    [rows, columns]: [usize; 2],
    all: &[Estimate],
) -> Result<File> {
    let table = |of: &dyn Fn(&Estimate) -> f64| {
        Array2::from_shape_fn((rows, columns), |(i, j)| {
            all.get(i * columns + j).map_or(f64::NAN, of)
        })
    };
    let both = [
        ("density".into(), table(&|it| it.value)),
        ("error".into(), table(&|it| it.error)),
    ];
    tables(name, axes, &both)
}
