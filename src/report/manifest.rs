//! The files of a run: which stage brings which.

use super::file::File;
use super::{data, losses, page, plot};
use crate::error::Result;
use crate::plan::Part;
use crate::results::Results;

/// What stands in the folder before the first stage: the scene, to be run again, and a results.json
/// that says nothing has ended yet.
pub fn at_the_start(results: &Results) -> Vec<File> {
    let mut results = results.clone();
    results
        .run
        .warnings
        .push("unfinished: no stage had ended yet".to_string().into());
    let scene = File::text("scene.toml", results.scene.to_toml());
    vec![File::text(data::RESULTS, results.json()), scene]
}

/// The files that a stage brings or completes, results.json among them.
///
/// # Errors
/// [`crate::Error::Io`] for an array or a picture that cannot be made.
pub fn after(part: Part, results: &Results) -> Result<Vec<File>> {
    let mut files = Vec::new();
    match part {
        Part::Stationary => {
            files.extend(data::stationary(results)?);
            files.extend(plot::force(results)?);
        }
        Part::Crossings => {
            files.extend(data::crossings(results));
            files.extend(losses::flights(results)?);
            files.extend(plot::flights(results)?);
        }
        Part::FirstLoss | Part::FirstLossPaths => {
            files.extend(losses::first_loss(results)?);
            files.extend(plot::survival(results)?);
        }
        Part::Transient => {
            files.extend(data::transient(results)?);
            files.extend(plot::densities(results)?);
            files.extend(plot::moments(results)?);
            files.extend(plot::approach(results)?);
            files.extend(plot::force(results)?);
        }
        Part::Steady => {
            files.extend(data::steady(results)?);
            files.extend(plot::steady(results)?);
            files.extend(plot::approach(results)?);
            files.extend(plot::force(results)?);
        }
        Part::DecayRates => {
            files.extend(data::decay_rates(results));
            files.extend(plot::approach(results)?);
        }
        Part::Spectrum | Part::Series => {
            files.extend(data::spectrum(results)?);
            files.extend(plot::spectrum(results)?);
        }
        Part::MonteCarlo => {
            files.extend(data::monte_carlo(results));
            files.extend(plot::moments(results)?);
        }
        Part::Records => {
            files.extend(data::records(results));
            files.extend(data::crossings(results));
            files.extend(plot::force(results)?);
            files.extend(plot::flights(results)?);
        }
    }
    files.push(File::text(data::RESULTS, results.json()));
    Ok(files)
}

/// What is written when every stage has ended: results.json and the page that holds it all.
///
/// # Errors
/// [`crate::Error::Io`] for a picture that cannot be made.
pub fn at_the_end(results: &Results) -> Result<Vec<File>> {
    Ok(vec![
        File::text(page::NAME, page::page(results)?),
        File::text(data::RESULTS, results.json()),
    ])
}
