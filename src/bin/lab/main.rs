//! The laboratory, a program of its own beside the user's: the paper number by number, error against run time, the stiff
//! and extreme scenes. It takes everything from the library and the library nothing from it.

// A program exports nothing: `pub` says that another of its files uses it.
#![allow(unreachable_pub)]

mod plot;
mod precision;
mod rows;
mod stability;
mod validate;

use clap::{Args, Parser, Subcommand};
use precision::by_hand;
use precision::calibration::{self, Calibration};
use precision::entry::{Effort, survey};
use precision::method::Method;
use precision::passages::Passages;
use precision::policy::{self, Policy};
use precision::rates::Rates;
use precision::{case, cost, references, table};
use stability::extreme;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use validate::folder::{self, Folder};
use validate::spectra::Spectra;
use validate::{equations, readme};
use vibroimpact::cli::{self, Outcome, Output, Stop, print, progress};
use vibroimpact::report::{self, File};
use vibroimpact::{Error, Result, plan};

/// The laboratory of vibroimpact: the paper reproduced, error against run time, stiff and extreme scenes
#[derive(Parser)]
#[command(name = "lab", version)]
struct Lab {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// The paper's tables and figures against ours: validation/README.md and its pictures
    #[command(mut_arg("out", |it| it.help("Write README.md and the pictures there [default: where the folders are]")))]
    Validate {
        /// Folders with a paper.csv [default: all in validation/ of the current directory]
        #[arg(value_name = "FOLDER")]
        folders: Vec<PathBuf>,
        #[command(flatten)]
        output: Output,
        /// Print nothing but errors
        #[arg(long, short)]
        quiet: bool,
    },
    /// Error against run time: every method on closed forms and against each other
    #[command(mut_arg("out", |it| it.help(TABLES)))]
    Precision {
        #[command(flatten)]
        survey: Survey,
        /// Hold the error estimates of random scenes against what their numbers are known to be
        #[arg(long)]
        calibrate: bool,
    },
    /// The numbers that were chosen: what each does to runs of every question, a fifth lower and higher
    #[command(mut_arg("out", |it| it.help(TABLES)))]
    Policy(Survey),
    /// The stiff and extreme scenes, each against what is known of it
    #[command(mut_arg("out", |it| it.help(TABLES)))]
    Stability(Survey),
}

const TABLES: &str = "Folder for the tables and pictures [default: results/<command>]";

#[derive(Args)]
struct Survey {
    #[command(flatten)]
    output: Output,
    /// Only what has one of these texts in its name, commas between them
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
}

impl Survey {
    /// Whether a name is wanted.
    fn wants(&self, name: &str) -> bool {
        self.only
            .as_ref()
            .is_none_or(|it| it.split(',').any(|part| name.contains(part)))
    }

    /// Of those there are, at least one is to be wanted.
    fn among<'a>(&self, names: impl Iterator<Item = &'a str> + Clone) -> Outcome {
        if names.clone().any(|it| self.wants(it)) {
            return Ok(0);
        }
        let asked = self.only.as_deref().unwrap_or_default();
        let names: Vec<&str> = names.collect();
        let accepted = format!("accepted: a part of {}", names.join(", "));
        let message = format!("--only = {asked} is not accepted");
        Err(Stop::new(2, message, &accepted))
    }
}

fn main() -> ExitCode {
    ExitCode::from(cli::with(std::env::args_os(), |it: Lab| match it.command {
        Command::Validate {
            folders,
            output,
            quiet,
        } => validate(&folders, &output, quiet),
        Command::Precision {
            survey,
            calibrate: true,
        } => calibrate(&survey),
        Command::Precision { survey, .. } => precision(&survey),
        Command::Policy(survey) => policy(&survey),
        Command::Stability(survey) => stability(&survey),
    }))
}

/// Error estimates against stored reference solutions; status 1 where a goal is missed.
fn calibrate(survey: &Survey) -> Outcome {
    survey.among(by_hand::names())?;
    let folder = match survey.output.out {
        Some(_) => Some(survey.output.folder("calibration")?),
        None => None,
    };
    let cases = references::cases()?;
    // Only some of what is given by hand: it takes cells and steps from free runs at one tolerance.
    let tolerances = match survey.only {
        Some(_) => &[by_hand::TOLERANCE][..],
        None => &calibration::TOLERANCES,
    };
    let bar = progress(cases.len() * tolerances.len(), false);
    let calibration = Calibration::of(&cases, tolerances, &|_| bar.inc(1));
    bar.finish_and_clear();
    if let Some(folder) = &folder {
        folder.write(&[calibration.csv()])?;
    }
    print(&calibration.to_string())?;
    let bar = progress(by_hand::count(&cases), false);
    let hands = by_hand::by_hand(&cases, &calibration, &|it| survey.wants(it), &|_| {
        bar.inc(1)
    });
    bar.finish_and_clear();
    print(&by_hand::table(&hands))?;
    let rates = Rates::calibrate(1)?;
    print(&rates.to_string())?;
    let passages = Passages::calibrate(1)?;
    print(&passages.to_string())?;
    let missed = [calibration.missed(), rates.missed(), passages.missed()].concat();
    if missed.is_empty() {
        return Ok(0);
    }
    let message = format!("goals of the calibration are missed: {}", missed.join("; "));
    Err(Stop::new(1, message, "see the table"))
}

/// What the numbers that were chosen do, each moved by itself.
fn policy(survey: &Survey) -> Outcome {
    survey.among(policy::names())?;
    let cases = references::cases()?;
    let folder = survey.output.folder("policy")?;
    let wants = |name: &str| survey.wants(name);
    let bar = progress(policy::count(&wants), false);
    let policy = Policy::of(&cases, &wants, &|name| {
        bar.set_message(name.to_owned());
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    let page = policy.page();
    print(&String::from_utf8_lossy(&page.bytes))?;
    folder.write(&[page])?;
    print(&format!("files: {}\n", folder.path().display()))?;
    Ok(0)
}

fn precision(options: &Survey) -> Outcome {
    let mut cases = case::cases()?;
    let names = cases.iter().map(|it| it.name);
    options.among(names.chain(["cost"]))?;
    cases.retain(|it| options.wants(it.name));
    let folder = options.output.folder("precision")?;
    let jobs: usize = cases.iter().map(|case| Method::all(case).len()).sum();
    let bar = progress(jobs, false);
    let mut surveys = Vec::new();
    for case in &cases {
        let methods = Method::all(case);
        surveys.push(survey(case, &methods, Effort::Full, &|entry| {
            bar.set_message(format!("{}: {}", case.name, entry.method));
            bar.tick();
        })?);
        bar.inc(methods.len() as u64);
        // What is done is there, whatever comes.
        folder.write(&table::files(&surveys, &[])?)?;
    }
    let mut costs = Vec::new();
    if options.only.is_none() || options.wants("cost") {
        let all = case::cases()?;
        costs = cost::costs(&all[0], Effort::Full, &|cost| {
            bar.set_message(format!("cost of {}, {} cells", cost.of, cost.n));
            bar.tick();
        })?;
    }
    bar.finish_and_clear();
    folder.write(&table::files(&surveys, &costs)?)?;
    let text = table::text(&surveys, &costs);
    print(&format!("{text}\nfiles: {}\n", folder.path().display()))?;
    Ok(0)
}

fn stability(survey: &Survey) -> Outcome {
    let mut scenes = extreme::scenes()?;
    survey.among(scenes.iter().map(|it| it.name.as_str()))?;
    scenes.retain(|it| survey.wants(&it.name));
    let folder = survey.output.folder("stability")?;
    let bar = progress(scenes.len(), false);
    let rows = stability::run(scenes.clone(), &|row| {
        bar.set_message(row.name.clone());
        bar.inc(1);
    });
    bar.finish_and_clear();
    folder.write(&stability::table::files(&scenes, &rows))?;
    let table = stability::table::text(&rows);
    print(&format!("{table}files: {}\n", folder.path().display()))?;
    match rows.iter().filter(|row| !row.verdict.honest()).count() {
        0 => Ok(0),
        dishonest => {
            let message = format!("{dishonest} scenes failed");
            Err(Stop::new(1, message, "see the table"))
        }
    }
}

/// Runs folders of the paper and writes their page and pictures.
fn validate(named: &[PathBuf], output: &Output, quiet: bool) -> Outcome {
    let list = if named.is_empty() {
        folder::folders(Path::new("validation"))?
    } else {
        named.to_vec()
    };
    let folders = list.iter().map(|path| Folder::read(path));
    let folders: Vec<_> = folders.collect::<Result<_>>()?;
    let root = common_root(&list)?;
    let target = output.out.clone().unwrap_or_else(|| root.clone());
    let path = target.join(readme::NAME);
    let earlier = std::fs::read_to_string(&path).unwrap_or_default();
    if !output.force && !readme::is_ours(&earlier) {
        let accepted = "a page that this command wrote; or --out, or --force to replace it";
        return Err(Error::invalid("FOLDER", path.display(), accepted).into());
    }
    // In their own folders nothing is cleared: the scenes are there.
    let _held = match output.out {
        Some(_) => Some(output.folder("validate")?),
        None => None,
    };
    let spectra = Spectra::default();
    let bar = progress(folders.len(), quiet);
    let mut outcomes = Vec::new();
    for folder in &folders {
        let start = Instant::now();
        let outcome = folder.run(&spectra, &|label| {
            bar.set_message(format!("{}  {label}", folder.name))
        })?;
        bar.inc(1);
        let place = target.join(&outcome.name);
        std::fs::create_dir_all(&place).map_err(|source| Error::Io {
            path: place.clone(),
            source,
        })?;
        report::folder::write(&place, &outcome.pictures)?;
        if !quiet {
            let counts = readme::counts(&outcome.rows);
            let counts: Vec<String> = counts.iter().map(|(it, n)| format!("{n} {it}")).collect();
            let seconds = plan::seconds(start.elapsed().as_secs_f64());
            let line = format!("{:<12} {} ({seconds})\n", outcome.name, counts.join(", "));
            bar.suspend(|| print(&line))?;
        }
        outcomes.push(outcome);
    }
    bar.finish_and_clear();
    let equations = equations::read(&root)?;
    let equations = equations.map(|list| equations::table(&list));
    let there = |name: &str| target.join(name).is_dir();
    let text = readme::page(&outcomes, equations.as_deref(), &earlier, &there);
    report::folder::write(&target, &[File::text(readme::NAME, text)])?;
    if !quiet {
        print(&format!("files: {}\n", path.display()))?;
    }
    Ok(0)
}

/// The folder that holds them all, each under a name of its own: their page goes there.
fn common_root(list: &[PathBuf]) -> Result<PathBuf> {
    let parent = |path: &PathBuf| {
        let path = path.canonicalize().unwrap_or_else(|_| path.clone());
        path.parent().unwrap_or(Path::new(".")).to_owned()
    };
    let name = |path: &PathBuf| path.canonicalize().ok()?.file_name().map(ToOwned::to_owned);
    for (k, path) in list.iter().enumerate().skip(1) {
        let shown = path.display();
        if parent(path) != parent(&list[0]) {
            let accepted = "folders that lie side by side: they share a page";
            return Err(Error::invalid("FOLDER", shown, accepted));
        }
        if list[..k].iter().any(|it| name(it) == name(path)) {
            return Err(Error::invalid("FOLDER", shown, "each folder once"));
        }
    }
    Ok(parent(&list[0]))
}

#[path = "../../../tests/lab/mod.rs"]
#[cfg(test)]
mod tests;
