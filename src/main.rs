//! The program: reads the command line and the scene, plans, runs, reports. The only file that prints
//! and exits.

use clap::{Args, Parser, Subcommand};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{self, IsTerminal, Read, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use vibroimpact::plan::{self, Part, Plan, Watch};
use vibroimpact::precision::calibration::{self, Calibration};
use vibroimpact::precision::rates::Rates;
use vibroimpact::precision::truths;
use vibroimpact::report::folder::{Existing, Folder};
use vibroimpact::report::{self, terminal};
use vibroimpact::results::Results;
use vibroimpact::scene::text::{BUILT_IN, SceneText, built_in, nearest};
use vibroimpact::{Error, Result, validation};

/// Random vibration of a preloaded Hertzian contact that now and then loses contact.
///
/// Without a command: runs the default scene.
#[derive(Parser)]
#[command(version, args_conflicts_with_subcommands = true)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    options: RunOptions,
}

#[derive(Subcommand)]
enum Command {
    /// Run a scene: table on the terminal, numbers and pictures in a folder
    Run {
        #[command(flatten)]
        scene: SceneChoice,
        #[command(flatten)]
        options: RunOptions,
    },
    /// Print what a run would compute, its size and its time; computes nothing
    Plan {
        #[command(flatten)]
        scene: SceneChoice,
        /// Override a key of the scene, as oscillator.h=0.01
        #[arg(long = "set", value_name = "KEY=VALUE")]
        set: Vec<String>,
    },
    /// List the built-in scenes, or print one as TOML to start from
    Scenes {
        /// A built-in scene
        name: Option<String>,
    },
    /// The paper's tables and figures against ours: validation/README.md and its pictures
    Validate(ValidateOptions),
    /// Error against run time: every method on closed forms and against each other
    Precision {
        #[command(flatten)]
        survey: Survey,
        /// Hold the error bars of random scenes against what their numbers are known to be
        #[arg(long)]
        calibrate: bool,
    },
    /// The stiff and extreme scenes, each against what is known of it
    Stability(Survey),
}

#[derive(Args)]
struct SceneChoice {
    /// A scene file in TOML, or the name of a built-in scene [default: the built-in "default"]
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,
}

#[derive(Args, Default)]
struct RunOptions {
    /// Folder for the results [default: results/<scene title>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Override a key of the scene, as oscillator.h=0.01
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Number of threads [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
    /// Write into a folder that exists, replacing earlier results
    #[arg(long)]
    force: bool,
}

#[derive(Args)]
struct ValidateOptions {
    /// Folders with a paper.csv [default: all in validation/ of the current directory]
    #[arg(value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// Write README.md and the pictures there [default: where the folders are]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write into a folder that exists, replacing earlier results
    #[arg(long)]
    force: bool,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

#[derive(Args)]
struct Survey {
    /// Folder for the tables and pictures [default: results/<command>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write into a folder that exists, replacing earlier results
    #[arg(long)]
    force: bool,
    /// Only what has this text in its name
    #[arg(long, value_name = "TEXT", hide = true)]
    only: Option<String>,
}

impl Survey {
    /// Whether a name is wanted.
    fn wants(&self, name: &str) -> bool {
        self.only
            .as_ref()
            .is_none_or(|it| it.split(',').any(|part| name.contains(part)))
    }

    fn folder(&self, command: &str) -> Result<Folder> {
        let options = RunOptions {
            out: self.out.clone(),
            force: self.force,
            ..RunOptions::default()
        };
        open_folder(command.to_string(), &options)
    }
}

/// Why the program ends early: what to print, and the exit status.
struct Stop {
    report: miette::Report,
    status: u8,
}

impl Stop {
    fn new(status: u8, message: impl Into<String>, help: &str) -> Self {
        let it = miette::MietteDiagnostic::new(message);
        let it = if help.is_empty() {
            it
        } else {
            it.with_help(help)
        };
        Self {
            report: it.into(),
            status,
        }
    }

    /// A scene that is wrong.
    fn scene(error: vibroimpact::scene::text::SceneError) -> Self {
        Self {
            report: miette::Report::new(error),
            status: 2,
        }
    }
}

impl From<Error> for Stop {
    fn from(error: Error) -> Self {
        let status = status(&error);
        match error {
            Error::Invalid {
                key,
                value,
                accepted,
            } => {
                let message = format!("{key} = {value} is not accepted");
                Self::new(status, message, &format!("accepted: {accepted}"))
            }
            other => Self::new(status, other.to_string(), ""),
        }
    }
}

/// 2 for what the user can mend in scene or command line, 3 for a limit, 1 for the rest.
fn status(error: &Error) -> u8 {
    match error {
        Error::Invalid { .. }
        | Error::NotAvailable { .. }
        | Error::NoStationaryLaw { .. }
        | Error::Mesh { .. } => 2,
        Error::Limit { .. } | Error::Unresolved { .. } => 3,
        _ => 1,
    }
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let colour = colour(&io::stderr());
    // Fails only if a hook is there already, and then that one prints.
    let _ = miette::set_hook(Box::new(move |_| {
        Box::new(
            miette::MietteHandlerOpts::new()
                .color(colour)
                .width(80)
                .build(),
        )
    }));
    match command(cli) {
        Ok(status) => ExitCode::from(status),
        Err(stop) => {
            let _ = writeln!(io::stderr(), "{:?}", stop.report);
            ExitCode::from(stop.status)
        }
    }
}

/// Runs a command; the exit status if it comes to its end: 0, or 3 for a tolerance not reached.
fn command(cli: Cli) -> std::result::Result<u8, Stop> {
    match cli.command {
        None => run(None, &cli.options),
        Some(Command::Run { scene, options }) => run(scene.scene.as_deref(), &options),
        Some(Command::Plan { scene, set }) => {
            let text = read(scene.scene.as_deref(), &set)?;
            let plan = Plan::of(text.scene()).map_err(|error| Stop::scene(text.explain(&error)))?;
            print(&terminal::plan(&plan)).map(|()| 0)
        }
        Some(Command::Scenes { name: None }) => {
            let lines: Vec<String> = BUILT_IN
                .iter()
                .map(|(name, text)| {
                    let comment = text.lines().map_while(|line| line.strip_prefix("# "));
                    let about = terminal::wrap(&comment.collect::<Vec<_>>().join(" "), 67);
                    format!("{name:<12} {}\n", about.join(&format!("\n{:13}", "")))
                })
                .collect();
            print(&lines.concat()).map(|()| 0)
        }
        Some(Command::Scenes { name: Some(name) }) => match built_in(&name) {
            Some(text) => print(text).map(|()| 0),
            None => Err(no_such_scene(&name)),
        },
        Some(Command::Validate(options)) => validate(&options).map(|()| 0),
        Some(Command::Precision {
            survey,
            calibrate: true,
        }) => calibrate(&survey).map(|()| 0),
        Some(Command::Precision { survey, .. }) => precision(&survey).map(|()| 0),
        Some(Command::Stability(it)) => stability(&it).map(|()| 0),
    }
}

/// Error estimates against stored reference solutions; status 1 where a goal is missed.
fn calibrate(survey: &Survey) -> std::result::Result<(), Stop> {
    let folder = match survey.out {
        Some(_) => Some(survey.folder("calibration")?),
        None => None,
    };
    let cases = truths::cases()?;
    let bar = survey_bar(cases.len() * calibration::TOLERANCES.len());
    let calibration = Calibration::of(&cases, &calibration::TOLERANCES, &mut |_| {
        bar.inc(1);
        Ok(())
    });
    bar.finish_and_clear();
    let calibration = calibration?;
    if let Some(folder) = &folder {
        folder.write(&[calibration.csv()])?;
    }
    print(&calibration.to_string())?;
    let rates = Rates::calibrate()?;
    print(&rates.to_string())?;
    let missed = [calibration.missed(), rates.missed()].concat();
    if missed.is_empty() {
        return Ok(());
    }
    let message = format!("goals of the calibration are missed: {}", missed.join("; "));
    Err(Stop::new(1, message, "see the table"))
}

fn no_such_scene(name: &str) -> Stop {
    let names: Vec<&str> = BUILT_IN.iter().map(|(name, _)| *name).collect();
    let guess = nearest(name, &names).map_or(String::new(), |it| format!("did you mean {it}? "));
    let message = format!("there is no built-in scene {name:?}");
    Stop::new(
        2,
        message,
        &format!("{guess}accepted: {}", names.join(", ")),
    )
}

/// The scene of the command line with its overrides.
fn read(scene: Option<&Path>, set: &[String]) -> std::result::Result<SceneText, Stop> {
    let Some(path) = scene else {
        let (name, text) = BUILT_IN[0];
        return SceneText::parse(name, text, set).map_err(Stop::scene);
    };
    let name = path.display().to_string();
    if !path.exists()
        && let Some(text) = built_in(&name)
    {
        return SceneText::parse(&name, text, set).map_err(Stop::scene);
    }
    let text = read_text(path)?;
    SceneText::parse(&name, &text, set).map_err(Stop::scene)
}

/// A scene file as text.
fn read_text(path: &Path) -> std::result::Result<String, Stop> {
    /// Far above any scene, far below what hurts.
    const MOST: u64 = 10_000_000;
    let name = path.display();
    let accepted = "accepted: a scene file in TOML, or a built-in scene (vibroimpact scenes)";
    if path.is_dir() {
        return Err(Stop::new(2, format!("{name} is a folder"), accepted));
    }
    let mut bytes = Vec::new();
    let read = std::fs::File::open(path).and_then(|it| it.take(MOST + 1).read_to_end(&mut bytes));
    if let Err(error) = read {
        let names: Vec<&str> = BUILT_IN.iter().map(|(name, _)| *name).collect();
        let guess = path.to_str().and_then(|it| nearest(it, &names));
        let guess = guess.map_or(String::new(), |it| format!("; did you mean {it}?"));
        return Err(Stop::new(
            2,
            format!("{name} cannot be read: {error}"),
            &format!("{accepted}{guess}"),
        ));
    }
    if bytes.len() as u64 > MOST {
        let message = format!("{name} is too large for a scene");
        return Err(Stop::new(2, message, "accepted: at most 10 MB of TOML"));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let message = format!("{name} is not UTF-8: byte {at} does not belong");
        Stop::new(2, message, "accepted: TOML, which is UTF-8 text")
    })
}

fn run(scene: Option<&Path>, options: &RunOptions) -> std::result::Result<u8, Stop> {
    if let Some(threads) = options.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        if let Err(error) = pool.build_global() {
            return Err(Stop::new(1, format!("{threads} threads: {error}"), ""));
        }
    }
    let text = read(scene, &options.set)?;
    let explain = |error: Error| {
        let status = status(&error);
        Stop {
            report: miette::Report::new(text.explain(&error)),
            status,
        }
    };
    let plan = Plan::of(text.scene()).map_err(explain)?;
    let folder = open_folder(text.scene().folder(), options)?;
    folder.write(&report::at_the_start(&Results::empty(text.scene())))?;
    let desk = Desk {
        folder: &folder,
        ended: AtomicBool::new(false),
        bar: Mutex::new(ProgressBar::hidden()),
        quiet: options.quiet,
    };
    let results = plan.run(&desk);
    desk.clear();
    let results = match results {
        Ok(results) => results,
        Err(error @ Error::Io { .. }) => return Err(error.into()),
        Err(error) => {
            let stop = explain(error);
            // A scene that is refused before its first result leaves nothing behind.
            if stop.status == 2 && !desk.ended.into_inner() {
                folder.discard();
            }
            return Err(stop);
        }
    };
    folder.write(&report::at_the_end(&results)?)?;
    let status = if results.falls_short() { 3 } else { 0 };
    if options.quiet {
        // Only errors are printed, and this is one.
        if let Some((stage, it)) = results.shortfalls.iter().find(|(_, it)| it.free) {
            let _ = writeln!(io::stderr(), "{stage}: {it}");
        }
        return Ok(status);
    }
    let table = terminal::table(&results, colour(&io::stdout()));
    print(&format!("{table}files: {}\n", folder.path().display()))?;
    Ok(status)
}

fn stability(survey: &Survey) -> std::result::Result<(), Stop> {
    let mut scenes = vibroimpact::stability::scenes()?;
    scenes.retain(|it| survey.wants(&it.name));
    let folder = survey.folder("stability")?;
    let bar = survey_bar(scenes.len());
    let rows = vibroimpact::stability::run(scenes.clone(), &|row| {
        bar.set_message(row.name.clone());
        bar.inc(1);
    });
    bar.finish_and_clear();
    folder.write(&vibroimpact::stability::files(&scenes, &rows))?;
    let table = vibroimpact::stability::text(&rows);
    print(&format!("{table}files: {}\n", folder.path().display()))?;
    let dishonest = rows.iter().filter(|row| !row.verdict.honest()).count();
    if dishonest == 0 {
        return Ok(());
    }
    let message = format!("{dishonest} scenes failed");
    Err(Stop::new(1, message, "see the table"))
}

fn precision(survey: &Survey) -> std::result::Result<(), Stop> {
    use vibroimpact::precision::{self, Effort, Method};
    let mut cases = precision::cases()?;
    cases.retain(|it| survey.wants(it.name));
    let folder = survey.folder("precision")?;
    let jobs: usize = cases.iter().map(|case| Method::all(case).len()).sum();
    let bar = survey_bar(jobs);
    let mut surveys = Vec::new();
    for case in &cases {
        let methods = Method::all(case);
        surveys.push(precision::survey(case, &methods, Effort::Full, &|entry| {
            bar.set_message(format!("{}: {}", case.name, entry.method));
            bar.tick();
        })?);
        bar.inc(methods.len() as u64);
        // What is done is there, whatever comes.
        folder.write(&precision::files(&surveys, &[])?)?;
    }
    let mut costs = Vec::new();
    if survey.only.is_none() || survey.wants("cost") {
        let all = precision::cases()?;
        costs = precision::costs(&all[0], Effort::Full, &|cost| {
            bar.set_message(format!("cost of {}, {} cells", cost.of, cost.n));
            bar.tick();
        })?;
    }
    bar.finish_and_clear();
    folder.write(&precision::files(&surveys, &costs)?)?;
    let table = precision::text(&surveys, &costs);
    print(&format!("{table}\nfiles: {}\n", folder.path().display()))
}

/// Progress over a number of jobs; hidden by itself where standard error is not a terminal.
fn survey_bar(jobs: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len}  {eta} left  {msg}");
    ProgressBar::with_draw_target(Some(jobs as u64), ProgressDrawTarget::stderr())
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Runs folders of the paper and writes their page and pictures.
fn validate(options: &ValidateOptions) -> std::result::Result<(), Stop> {
    let named = !options.folders.is_empty();
    let list = if named {
        options.folders.clone()
    } else {
        validation::folders(Path::new("validation"))?
    };
    let folders: Vec<_> = list
        .iter()
        .map(|path| validation::Folder::read(path))
        .collect::<Result<_>>()?;
    let root = common_root(&list)?;
    let target = options.out.clone().unwrap_or_else(|| root.clone());
    let path = target.join(validation::readme::NAME);
    let earlier = std::fs::read_to_string(&path).unwrap_or_default();
    if !options.force && !validation::readme::is_ours(&earlier) {
        let accepted = "a page that this command wrote; or --out, or --force to replace it";
        return Err(Error::invalid("FOLDER", path.display(), accepted).into());
    }
    // In their own folders nothing is cleared: the scenes are there.
    let existing = if options.force {
        Existing::Force
    } else {
        Existing::Refuse
    };
    let _held = match &options.out {
        Some(path) => Some(Folder::open(path, existing)?),
        None => None,
    };
    let spectra = validation::Spectra::default();
    let bar = survey_bar(folders.len());
    if options.quiet {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    let mut outcomes = Vec::new();
    for folder in &folders {
        let start = std::time::Instant::now();
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
        if !options.quiet {
            let counts = validation::readme::counts(&outcome.rows);
            let counts: Vec<String> = counts.iter().map(|(it, n)| format!("{n} {it}")).collect();
            let seconds = plan::seconds(start.elapsed().as_secs_f64());
            let line = format!("{:<12} {} ({seconds})\n", outcome.name, counts.join(", "));
            bar.suspend(|| print(&line))?;
        }
        outcomes.push(outcome);
    }
    bar.finish_and_clear();
    let equations = validation::equations::read(&root)?;
    let equations = equations.map(|list| validation::equations::table(&list));
    let there = |name: &str| target.join(name).is_dir();
    let text = validation::readme::page(&outcomes, equations.as_deref(), &earlier, &there);
    let file = report::File {
        name: validation::readme::NAME.into(),
        bytes: text.into_bytes(),
    };
    report::folder::write(&target, &[file])?;
    if options.quiet {
        return Ok(());
    }
    print(&format!("files: {}\n", path.display()))
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

fn open_folder(title: String, options: &RunOptions) -> Result<Folder> {
    let (path, existing) = match &options.out {
        Some(path) => (path.clone(), Existing::Refuse),
        None => (Path::new("results").join(title), Existing::ReplaceOurs),
    };
    Folder::open(
        &path,
        if options.force {
            Existing::Force
        } else {
            existing
        },
    )
}

/// Watches a run: a progress bar, and each stage's files as soon as it has ended.
struct Desk<'a> {
    folder: &'a Folder,
    /// Whether any stage has ended.
    ended: AtomicBool,
    bar: Mutex<ProgressBar>,
    quiet: bool,
}

impl Desk<'_> {
    fn clear(&self) {
        if let Ok(bar) = self.bar.lock() {
            bar.finish_and_clear();
        }
    }
}

impl Watch for Desk<'_> {
    fn begins(&self, part: Part) {
        // Hidden by itself where standard error is not a terminal.
        let target = if self.quiet {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr()
        };
        let template = "{msg:<12} {bar:40} {percent:>3} %  {eta} left";
        let style =
            ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::with_draw_target(Some(1000), target);
        let bar = bar.with_style(style).with_message(part.name());
        bar.tick();
        if let Ok(mut old) = self.bar.lock() {
            old.finish_and_clear();
            *old = bar;
        }
    }

    fn progress(&self, _: Part, fraction: f64) {
        if let Ok(bar) = self.bar.lock() {
            let done = (fraction.clamp(0.0, 1.0) * 1000.0) as u64;
            bar.set_position(done.max(bar.position()));
        }
    }

    fn ends(&self, part: Part, results: &Results) -> Result<()> {
        self.clear();
        self.ended.store(true, Ordering::Relaxed);
        self.folder.write(&report::after(part, results)?)
    }
}

/// Whether to use colour on a stream: a terminal, and nobody objects (no-color.org).
fn colour(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|it| it.is_empty())
}

/// Print to standard output; a reader that has left is no error.
fn print(text: &str) -> std::result::Result<(), Stop> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Stop::new(1, format!("standard output: {error}"), ""))
        }
        _ => Ok(()),
    }
}
