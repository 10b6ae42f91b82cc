//! First losses and flights as files.

use super::File;
use super::data::{arrays, field, fields};
use crate::error::Result;
use crate::fokker_planck::FirstLoss;
use crate::monte_carlo::FirstLossResult;
use crate::results::Results;
use std::fmt::Write;

/// first_loss.csv and first_loss.npz: survival, its complement and density of the first loss, beside the paths.
pub(super) fn first_loss(results: &Results) -> Result<Vec<File>> {
    let paths = results.first_loss_paths.as_ref();
    survival("first_loss", results.first_loss.as_ref(), paths)
}

/// first_passage.csv and first_passage.npz: the same of a level.
pub(super) fn first_passage(results: &Results) -> Result<Vec<File>> {
    let paths = results.first_passage_paths.as_ref();
    survival("first_passage", results.first_passage.as_ref(), paths)
}

fn survival(
    name: &str,
    it: Option<&FirstLoss>,
    paths: Option<&FirstLossResult>,
) -> Result<Vec<File>> {
    let Some(it) = it else {
        return Ok(Vec::new());
    };
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
        &format!("{name}.npz"),
        &it.times,
        &[
            ("survival", &it.survival),
            ("lost", &it.lost),
            ("density", &it.density),
        ],
        &[("mean_time", it.mean_time), ("rate", it.rate)],
    )?;
    Ok(vec![File::text(format!("{name}.csv"), table), arrays])
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
