//! The files of a run: what each holds, which stages bring it, and who makes it. Folder and page
//! take their lists from here.

use super::file::{File, RESULTS};
#[cfg(feature = "plots")]
use super::plot;
use super::{data, driven, losses, page};
use crate::error::Result;
use crate::plan::Part;
use crate::results::Results;
use crate::scene::Scene;

/// The page that holds it all.
const PAGE: &str = "report.html";

/// The scene with every default filled in.
pub(crate) const SCENE: &str = "scene.toml";

/// The files of [`at_the_start`].
pub(super) const AT_THE_START: [&str; 2] = [RESULTS, SCENE];

/// The sheet that shows several densities; without it the last density stands for all.
const SHEET: &str = "snapshots.svg";

/// Files that are made together: `name: what it holds`, one a line, `<t>` standing for a time (units stand in
/// the headers of tables); the stages that bring or complete them; those that there are.
type Group = (
    &'static str,
    &'static [Part],
    fn(&Results) -> Result<Vec<File>>,
);

/// What is there after every run.
const ALWAYS: &str =
    "results.json: every number as `{\"value\", \"error\"}`, the resolved scene, times, warnings
     report.html: table, pictures, settings and warnings in one page that needs no network
     scene.toml: the scene with every default filled in: the same run again";

/// Everything but what is written at the start and the end, without pictures.
const NUMBERS: &[Group] = &[
    (
        "stationary.csv: the stationary law in closed form: its numbers
         stationary_q.csv: its density of displacement
         stationary_v.csv: its density of velocity
         stationary_force.csv: its density and distribution of force",
        &[Part::Stationary],
        |it| Ok(data::stationary(it).unwrap_or_default()),
    ),
    (
        "moments.csv: moments against time by the Fokker-Planck equation
         density_<t>.npz: p[q, v] as a density, with q, v, t: `numpy.load`",
        &[Part::Transient],
        |it| each(it.transient.as_ref(), |answer| data::transient(it, answer)),
    ),
    (
        "periodic.csv: moments of the periodic law over the phase of the drive
         harmonics.csv: harmonics of its mean displacement, velocity and force
         multipliers.csv: its Floquet multipliers
         periodic.npz: its density at phase 0, with q, v, t: `numpy.load`
         stroboscopic.npz: p[t, q, v] at up to 8 phases of the drive",
        &[Part::Periodic],
        |it| each(it.periodic.as_ref(), |answer| driven::periodic(it, answer)),
    ),
    (
        "response.csv: harmonics and loss probability over the frequency of the drive",
        &[Part::Response],
        |it| each(it.response.as_ref(), |answer| Ok(driven::response(it, answer))),
    ),
    (
        "steady.npz: the steady state on the mesh, as a density; t is infinite
         approach.csv: distance in L1 to the closed form on the way to it",
        &[Part::Steady],
        |it| each(it.steady.as_ref(), |answer| data::steady(it, answer)),
    ),
    (
        "decay_rates.csv: the slowest eigenvalues",
        &[Part::DecayRates],
        |it| each(it.decay_rates.as_ref(), |answer| Ok(data::decay_rates(it, answer))),
    ),
    (
        "spectrum.csv: one-sided spectra and RMS magnitude: solved, by Welch with its expectation, linear
         spectrum.npz: the same as arrays",
        &[Part::Spectrum, Part::Series],
        |it| each(it.spectrum.as_ref(), |answer| data::spectrum(it, answer)),
    ),
    (
        "first_loss.csv: survival, its complement and density of the first loss of contact
         first_loss.npz: the same as arrays",
        &[Part::FirstLoss, Part::FirstLossPaths],
        |it| {
            let paths = it.first_loss_paths.as_ref();
            each(it.first_loss.as_ref(), |answer| losses::survival(it, "first_loss", (answer, paths)))
        },
    ),
    (
        "first_passage.csv: survival, its complement and density of the first passage of a level
         first_passage.npz: the same as arrays",
        &[Part::FirstPassage, Part::FirstPassagePaths],
        |it| {
            let paths = it.first_passage_paths.as_ref();
            each(it.first_passage.as_ref(), |answer| losses::survival(it, "first_passage", (answer, paths)))
        },
    ),
    (
        "flight_law.csv: density of the time of flight
         flight_law.npz: the same as arrays",
        &[Part::Crossings],
        |it| each(it.flights.as_ref(), |answer| losses::flights(it, answer)),
    ),
    (
        "impact_speed.csv: density of the speed at the return
         impact_force.csv: density of the peak force of the undamped contact after it
         impacts.npz: joint density of time of flight and speed at the return
         impacts_seen.csv: histogram of the speed at the return in long realisations
         impacts_seen.npz: joint histogram of time of flight and speed in long realisations",
        &[Part::Crossings, Part::Records],
        losses::impacts,
    ),
    (
        "crossings.csv: losses of contact: rate, flights, in the window",
        &[Part::Crossings, Part::Records],
        |it| each(it.crossings.as_ref(), |answer| Ok(data::crossings(it, answer))),
    ),
    (
        "monte_carlo.csv: moments against time by paths",
        &[Part::MonteCarlo],
        |it| each(it.monte_carlo.as_ref(), |answer| Ok(data::monte_carlo(it, answer))),
    ),
    (
        "records.csv: long realisations: stationary numbers
         records_q.csv: their histogram of displacement
         records_v.csv: their histogram of velocity
         records_force.csv: their histogram of force
         flights.csv: their histogram of times of flight",
        &[Part::Records],
        |it| Ok(data::records(it).unwrap_or_default()),
    ),
];

/// Pictures, in the order of the page.
#[cfg(feature = "plots")]
const PICTURES: &[Group] = &[
    (
        "force.svg: Density of the force, linear and logarithmic",
        &[
            Part::Stationary,
            Part::Transient,
            Part::Steady,
            Part::Records,
        ],
        |it| plot::force(it).into_iter().collect(),
    ),
    (
        "survival.svg: Survival until the first loss of contact, and the density of its time",
        &[Part::FirstLoss, Part::FirstLossPaths],
        |it| plot::survival(it).into_iter().collect(),
    ),
    (
        "passage.svg: Survival until the first passage of a level, and the density of its time",
        &[Part::FirstPassage, Part::FirstPassagePaths],
        |it| plot::passage(it).into_iter().collect(),
    ),
    (
        "flights.svg: Density of the time of flight",
        &[Part::Crossings, Part::Records],
        |it| plot::flights(it).into_iter().collect(),
    ),
    (
        "impacts.svg: Impacts: time of flight and speed at the return, speed, peak force",
        &[Part::Crossings, Part::Records],
        |it| plot::impacts(it).into_iter().collect(),
    ),
    (
        "spectrum.svg: One-sided spectrum: Fokker-Planck, Monte Carlo and the linear oscillator",
        &[Part::Spectrum, Part::Series],
        |it| plot::spectrum(it).into_iter().collect(),
    ),
    (
        "moments.svg: Moments against time",
        &[Part::Transient, Part::MonteCarlo],
        |it| plot::moments(it).into_iter().collect(),
    ),
    (
        "periodic.svg: Moments of the periodic law over the phase of the drive",
        &[Part::Periodic],
        |it| plot::periodic(it).into_iter().collect(),
    ),
    (
        "stroboscopic.svg: Density of the periodic law at phases of the drive",
        &[Part::Periodic],
        |it| plot::stroboscopic(it).into_iter().collect(),
    ),
    (
        "response.svg: Response curve: harmonics and loss probability over the frequency of the drive",
        &[Part::Response],
        |it| plot::response(it).into_iter().collect(),
    ),
    (
        "approach.svg: Approach to the stationary law",
        &[Part::Transient, Part::Steady, Part::DecayRates],
        |it| plot::approach(it).into_iter().collect(),
    ),
    (
        "steady.svg: Steady state on the mesh, with its marginals",
        &[Part::Steady],
        |it| plot::steady(it).into_iter().collect(),
    ),
    (
        "snapshots.svg: Density of displacement and velocity",
        &[Part::Transient],
        |it| plot::snapshots(it).into_iter().collect(),
    ),
    (
        "density_<t>.svg: Density of displacement and velocity",
        &[Part::Transient],
        plot::densities,
    ),
];
#[cfg(not(feature = "plots"))]
const PICTURES: &[Group] = &[];

/// The files of an answer, if it is there.
fn each<T>(answer: Option<&T>, files: impl Fn(&T) -> Result<Vec<File>>) -> Result<Vec<File>> {
    answer.map_or(Ok(Vec::new()), files)
}

fn groups() -> impl Iterator<Item = &'static Group> {
    NUMBERS.iter().chain(PICTURES)
}

/// Name and content of every file that a run may write.
fn files() -> impl Iterator<Item = (&'static str, &'static str)> {
    let groups = groups().map(|(files, ..)| *files);
    [ALWAYS].into_iter().chain(groups).flat_map(listed)
}

fn listed(files: &'static str) -> impl Iterator<Item = (&'static str, &'static str)> {
    files.lines().filter_map(|it| it.trim().split_once(": "))
}

/// Whether a run may write a file of that name.
pub(super) fn holds(name: &str) -> bool {
    files().any(|(it, _)| match it.split_once("<t>") {
        Some((start, end)) => name.starts_with(start) && name.ends_with(end),
        None => it == name,
    })
}

/// Whether one of the stages that bring a group has ended.
fn has_part(results: &Results, parts: &[Part]) -> bool {
    let ended = |part: &Part| {
        results
            .run
            .stages
            .iter()
            .any(|(name, _)| *name == part.name())
    };
    parts.iter().any(ended)
}

fn numbers(results: &Results) -> File {
    File::text(RESULTS, results.json())
}

/// What stands in the folder before the first stage: the scene, to be run again, and a results.json
/// that says nothing has ended yet.
pub(super) fn at_the_start(scene: &Scene) -> Vec<File> {
    let mut results = Results::empty(scene);
    let warning = "unfinished: no stage had ended yet".to_string();
    results.run.warnings.push(warning.into());
    vec![
        numbers(&results),
        File::text(SCENE, results.scene.to_toml()),
    ]
}

/// The files that a stage brings or completes, results.json among them.
///
/// # Errors
/// [`crate::Error::Io`] for an array or a picture that cannot be made.
pub fn after(part: Part, results: &Results) -> Result<Vec<File>> {
    let mut files = Vec::new();
    for (_, _, make) in groups().filter(|it| it.1.contains(&part)) {
        files.extend(make(results)?);
    }
    files.push(numbers(results));
    Ok(files)
}

/// What is written when every stage has ended: results.json and the page that holds it all.
///
/// # Errors
/// [`crate::Error::Io`] for a picture that cannot be made.
pub fn at_the_end(results: &Results) -> Result<Vec<File>> {
    let page = page::page(results, &pictures(results)?);
    Ok(vec![File::text(PAGE, page), numbers(results)])
}

/// Every file of a run that has ended, as [`super::run_into`] leaves them.
///
/// # Errors
/// [`crate::Error::Io`] for an array or a picture that cannot be made.
pub fn all(results: &Results) -> Result<Vec<File>> {
    let mut files = vec![File::text(SCENE, results.scene.to_toml())];
    for (_, _, make) in groups().filter(|it| has_part(results, it.1)) {
        files.extend(make(results)?);
    }
    files.extend(at_the_end(results)?);
    Ok(files)
}

/// The table and the pictures as a piece of HTML without head and body, for a page of others.
///
/// # Errors
/// [`crate::Error::Io`] for a picture that cannot be made.
pub fn fragment(results: &Results) -> Result<String> {
    Ok(page::content(results, &pictures(results)?))
}

/// The pictures of the page, each with its words.
fn pictures(results: &Results) -> Result<Vec<(File, &'static str)>> {
    let mut all: Vec<(File, &str)> = Vec::new();
    for (group, _, make) in PICTURES.iter().filter(|it| has_part(results, it.1)) {
        let Some((name, words)) = listed(group).next() else {
            continue;
        };
        // One sheet says it all; single snapshots are in their own files.
        let sheet = |(file, _): &(File, _)| file.name == SHEET;
        if name.contains("<t>") && all.iter().any(sheet) {
            continue;
        }
        all.extend(make(results)?.pop().map(|file| (file, words)));
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_of_results_names_every_file() {
        let page = include_str!("../../docs/results.md");
        for (name, what) in files() {
            assert!(
                page.contains(&format!("`{name}`")),
                "docs/results.md lacks {name}: {what}"
            );
        }
        assert!(holds("density_0.5.npz") && holds("moments.svg") && !holds("mine.svg"));
    }
}
