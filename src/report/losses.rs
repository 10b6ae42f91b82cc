//! First losses and flights as files.

use super::File;
use super::csv::Csv;
use super::data::arrays;
use crate::error::Result;
use crate::estimate::Estimate;
use crate::results::Results;

/// first_loss.csv and first_loss.npz: survival, its complement and density of the first loss, beside the paths.
pub(super) fn first_loss(results: &Results) -> Result<Vec<File>> {
    let Some(it) = &results.first_loss else {
        return Ok(Vec::new());
    };
    let paths = results.first_loss_paths.as_ref();
    let some = |all: &[Estimate]| all.iter().copied().map(Some).collect::<Vec<_>>();
    let mut table = Csv::of(results)
        .plain("t", "1/W", it.times.iter().copied())
        .numbers("survival", "error", "1", some(&it.survival))
        .numbers("lost", "error", "1", some(&it.lost))
        .numbers("density", "error", "W", some(&it.density));
    if let Some(paths) = paths {
        let mean = "mean density of paths since the time before";
        table = table
            .numbers(
                "survival of paths",
                "standard error",
                "1",
                some(&paths.survival),
            )
            .numbers(mean, "standard error", "W", some(&paths.density));
    }
    let arrays = arrays(
        "first_loss.npz",
        results,
        &it.times,
        &[
            ("survival", &it.survival),
            ("lost", &it.lost),
            ("density", &it.density),
        ],
        &[("mean_time", it.mean_time), ("rate", it.rate)],
    )?;
    Ok(vec![table.file("first_loss.csv"), arrays])
}

/// flight_law.csv and flight_law.npz: the density of the time of flight.
pub(super) fn flights(results: &Results) -> Result<Vec<File>> {
    let Some(it) = &results.flights else {
        return Ok(Vec::new());
    };
    let table = Csv::of(results)
        .plain("flight time", "1/W", it.times.iter().copied())
        .numbers(
            "density",
            "error",
            "W",
            it.density.iter().copied().map(Some),
        );
    let arrays = arrays(
        "flight_law.npz",
        results,
        &it.times,
        &[("density", &it.density)],
        &[],
    )?;
    Ok(vec![table.file("flight_law.csv"), arrays])
}
