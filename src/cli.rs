//! The program `vibroimpact`: reads the command line and the scene, plans, runs, reports. The only file of the library
//! that prints. The laboratory (src/bin/lab) is a program of its own made of the same parts.

mod progress;

pub use progress::progress;

use crate::error::{Error, Result};
use crate::map::{self, Axis, Map, MapError};
use crate::plan::Plan;
use crate::report::folder::{Existing, Folder};
use crate::report::{self, terminal};
use crate::scene::text::{BUILT_IN, SceneError, SceneText, built_in, nearest};
use clap::{Args, CommandFactory, Parser, Subcommand};
use progress::{MapWatch, Observer, bar};
use signal_hook::consts::SIGINT;
use std::ffi::OsString;
use std::io::{self, IsTerminal, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Random vibration of a preloaded Hertzian contact that now and then loses contact: stationary law in closed form,
/// transients, spectra and first passage from the Fokker-Planck equation, Monte Carlo; every number with its error.
///
/// Without a command it runs the default scene; `vibroimpact my.toml` is `vibroimpact run my.toml`.
#[derive(Parser)]
#[command(
    name = "vibroimpact",
    version,
    args_conflicts_with_subcommands = true,
    after_help = "First steps: vibroimpact scenes displaced > my.toml; vibroimpact plan my.toml; vibroimpact run my.toml --open"
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    options: RunOptions,
}

#[derive(Subcommand)]
enum Command {
    /// Run a scene: a table here; numbers with their errors, pictures and a page in a folder
    Run {
        #[command(flatten)]
        scene: SceneChoice,
        #[command(flatten)]
        options: RunOptions,
    },
    /// Print methods, cells, time steps, memory and expected time of a run; computes nothing
    Plan {
        #[command(flatten)]
        scene: SceneChoice,
        /// Override a key of the scene, as oscillator.h=0.01
        #[arg(long = "set", value_name = "KEY=VALUE")]
        set: Vec<String>,
    },
    /// Run a scene at every point of a grid, or a part of it; one started again does what is missing
    Map {
        #[command(flatten)]
        scene: SceneChoice,
        #[command(flatten)]
        options: MapOptions,
    },
    /// Join the parts of a map: table, arrays, pictures, a page; lists what is missing
    Collect {
        /// The folder of the map
        dir: PathBuf,
        /// A number to draw, as stationary.contact_loss_probability=0.01 with a line at a level
        #[arg(long, value_name = "NUMBER[=LEVEL]")]
        draw: Vec<String>,
        /// Print nothing but errors
        #[arg(long, short)]
        quiet: bool,
    },
    /// List the built-in scenes, or print one as TOML to start from
    Scenes {
        /// A built-in scene
        name: Option<String>,
    },
    /// Print completions for a shell, as `vibroimpact completions bash > ~/.local/share/bash-completion/completions/vibroimpact`
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Print the manual page, as `vibroimpact manual > ~/.local/share/man/man1/vibroimpact.1`
    Manual,
}

#[derive(Args)]
struct SceneChoice {
    /// A scene file in TOML, or the name of a built-in scene [default: the built-in "default"]
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,
}

#[derive(Args, Default)]
struct RunOptions {
    #[command(flatten)]
    output: Output,
    /// Override a key of the scene, as oscillator.h=0.01
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Number of threads [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
    /// Open the page of results when it is written
    #[arg(long)]
    open: bool,
}

#[derive(Args)]
struct MapOptions {
    /// An axis: a key and its values, KEY=log:a:b:n, lin:a:b:n or a list [x, y]; the first runs slowest
    #[arg(long, value_name = "KEY=RANGE", required = true)]
    over: Vec<String>,
    /// Only part K of N, for engines that run parts side by side
    #[arg(long, value_name = "K/N")]
    part: Option<String>,
    /// Folder of the map, one for all its parts
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Override a key of the scene, as oscillator.contact=bilinear
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Keep a curve of results.json in the lines, as spectrum or first_loss.survival
    #[arg(long, value_name = "CURVE")]
    keep: Vec<String>,
    /// Compute points that failed again
    #[arg(long)]
    retry: bool,
    /// Number of threads [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

/// Where results are written.
#[derive(Args, Default)]
pub struct Output {
    /// `--out`
    #[arg(
        long,
        value_name = "DIR",
        help = "Folder for the results [default: results/<scene title>]"
    )]
    pub out: Option<PathBuf>,
    /// Write into a folder that exists, replacing earlier results
    #[arg(long)]
    pub force: bool,
}

impl Output {
    /// The folder of `--out`, or results/`title`.
    ///
    /// # Errors
    /// Those of [`Folder::open`].
    pub fn folder(&self, title: &str) -> Result<Folder> {
        let existing = match &self.out {
            _ if self.force => Existing::Force,
            Some(_) => Existing::Refuse,
            None => Existing::ReplaceOurs,
        };
        let default = || Path::new("results").join(title);
        Folder::open(&self.out.clone().unwrap_or_else(default), existing)
    }
}

/// Why the program ends early: what to print, and the exit status.
pub struct Stop {
    report: miette::Report,
    status: u8,
}

impl Stop {
    /// A message, its help if there is any, and the exit status.
    pub fn new(status: u8, message: impl Into<String>, help: &str) -> Self {
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
    fn scene(error: SceneError) -> Self {
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

impl From<MapError> for Stop {
    fn from(error: MapError) -> Self {
        match error {
            MapError::Scene(error) => Self::scene(error),
            MapError::Other(error) => error.into(),
        }
    }
}

/// 2 for what the user can mend in scene or command line, 3 for a limit, 1 for the rest.
fn status(error: &Error) -> u8 {
    match error {
        error if error.is_refusal() => 2,
        Error::Limit { .. } | Error::Unresolved { .. } => 3,
        _ => 1,
    }
}

/// How a command ends: its exit status, 0, or 3 for a tolerance not reached; or why it ends early.
pub type Outcome = std::result::Result<u8, Stop>;

/// The program `vibroimpact` on a command line, its own name first; returns the exit status, which a process or an
/// interpreter can end with.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let mut arguments: Vec<OsString> = arguments.into_iter().collect();
    let laboratory = ["validate", "precision", "stability"];
    let moved = |it: &&str| laboratory.contains(it);
    if let Some(name) = arguments.get(1).and_then(|it| it.to_str()).filter(moved) {
        let line = format!(
            "{name} is a command of the laboratory: cargo run --release --bin lab -- {name}"
        );
        let _ = writeln!(io::stderr(), "{line}");
        return 2;
    }
    if names_a_scene(&arguments) {
        arguments.insert(1, "run".into());
    }
    with(arguments, command)
}

/// Whether a command line without a command has a scene file: `vibroimpact my.toml --quiet`.
fn names_a_scene(arguments: &[OsString]) -> bool {
    let given = || arguments.iter().skip(1);
    let command = |it: &OsString| {
        let name = it.to_str().unwrap_or_default();
        name == "help"
            || Cli::command()
                .get_subcommands()
                .any(|it| it.get_name() == name)
    };
    let file = |it: &OsString| Path::new(it).extension().is_some_and(|it| it == "toml");
    // Behind --set or --out a name of that ending may stand too; then another argument is the scene, or none.
    let value = |k: usize| {
        let before = arguments.get(k.wrapping_sub(1)).and_then(|it| it.to_str());
        before.is_some_and(|it| matches!(it, "--set" | "--out" | "--threads"))
    };
    let scene = |(k, it): (usize, &OsString)| file(it) && !value(k);
    !given().any(command) && arguments.iter().enumerate().skip(1).any(scene)
}

/// Reads a command line, obeys it, and prints why it ended early, if it did; the exit status.
pub fn with<C: Parser>(
    arguments: impl IntoIterator<Item = OsString>,
    obey: impl FnOnce(C) -> Outcome,
) -> u8 {
    let cli = match C::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(message) => {
            // A reader that has left is no error.
            let _ = message.print();
            return message.exit_code() as u8;
        }
    };
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
    obey(cli).unwrap_or_else(|stop| {
        let _ = writeln!(io::stderr(), "{:?}", stop.report);
        stop.status
    })
}

fn command(cli: Cli) -> Outcome {
    match cli.command {
        None => run(None, &cli.options),
        Some(Command::Run { scene, options }) => run(scene.scene.as_deref(), &options),
        Some(Command::Plan { scene, set }) => {
            let text = read(scene.scene.as_deref(), &set)?;
            let plan = Plan::of(text.scene()).map_err(|error| Stop::scene(text.explain(&error)))?;
            print(&terminal::plan(&plan)).map(|()| 0)
        }
        Some(Command::Map { scene, options }) => map(scene.scene.as_deref(), &options),
        Some(Command::Collect { dir, draw, quiet }) => collect(&dir, &draw, quiet),
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
        Some(Command::Completions { shell }) => {
            let mut text = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "vibroimpact", &mut text);
            print(&String::from_utf8_lossy(&text)).map(|()| 0)
        }
        Some(Command::Manual) => {
            let mut text = Vec::new();
            let page = clap_mangen::Man::new(Cli::command());
            let made = page.render(&mut text);
            made.map_err(|error| Stop::new(1, error.to_string(), ""))?;
            print(&String::from_utf8_lossy(&text)).map(|()| 0)
        }
        Some(Command::Scenes { name: Some(name) }) => match built_in(&name) {
            Some(text) => print(text).map(|()| 0),
            None => Err(no_such_scene(&name)),
        },
    }
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
    let (name, text) = named(scene)?;
    SceneText::parse(&name, &text, set).map_err(Stop::scene)
}

/// Name and text of the scene of the command line.
fn named(scene: Option<&Path>) -> std::result::Result<(String, String), Stop> {
    let Some(path) = scene else {
        let (name, text) = BUILT_IN[0];
        return Ok((name.to_owned(), text.to_owned()));
    };
    let name = path.display().to_string();
    if !path.exists()
        && let Some(text) = built_in(&name)
    {
        return Ok((name, text.to_owned()));
    }
    let text = read_text(path)?;
    Ok((name, text))
}

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

fn run(scene: Option<&Path>, options: &RunOptions) -> Outcome {
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
    let folder = options.output.folder(&text.scene().folder())?;
    let path = folder.path().to_owned();
    let observer = Observer::new(options.quiet);
    let results = report::run_into(&plan, folder, &observer);
    observer.clear();
    let results = match results {
        Ok(results) => results,
        Err(error @ Error::Io { .. }) => return Err(error.into()),
        Err(error @ Error::Stopped { .. }) => {
            let kept = path.join("report.html");
            let kept = if kept.is_file() {
                format!("what had ended is kept: {}", kept.display())
            } else {
                "no stage had ended: there is nothing to keep".to_owned()
            };
            let _ = writeln!(io::stderr(), "{error}; {kept}");
            // The shell learns that it was the signal, and ends its loop too.
            let _ = signal_hook::low_level::emulate_default_handler(SIGINT);
            return Ok(1);
        }
        Err(error) => return Err(explain(error)),
    };
    let status = if results.falls_short() { 3 } else { 0 };
    if options.quiet {
        // Only errors are printed, and this is one.
        if let Some((stage, it)) = results.shortfalls.iter().find(|(_, it)| it.free) {
            let _ = writeln!(io::stderr(), "{stage}: {it}");
        }
        return Ok(status);
    }
    let table = terminal::table(&results, colour(&io::stdout()));
    print(&format!("{table}files: {}\n", path.display()))?;
    if options.open {
        let page = path.join("report.html");
        if let Err(error) = open::that_detached(&page) {
            let page = page.display();
            let _ = writeln!(io::stderr(), "{page} could not be opened: {error}");
        }
    }
    Ok(status)
}

fn map(scene: Option<&Path>, options: &MapOptions) -> Outcome {
    let (name, text) = named(scene)?;
    let axes = options.over.iter().map(|it| Axis::parse(it));
    let axes = axes.collect::<Result<Vec<_>>>()?;
    let part = options.part.as_deref().map(map::Part::parse);
    let part = part.transpose()?.unwrap_or(map::Part::WHOLE);
    let it = Map::of(&name, &text, &options.set, axes, options.keep.clone())?;
    let cores = || std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let threads = options.threads.map_or_else(cores, usize::from);
    let template = "{bar:30} {pos}/{len} points  {msg}";
    let watch = MapWatch {
        bar: bar(0, options.quiet, template),
        quiet: options.quiet,
        told: Mutex::new(std::time::Instant::now()),
    };
    let tally = it.run(part, &options.out, threads, options.retry, &watch);
    watch.bar.finish_and_clear();
    let tally = tally?;
    if !options.quiet {
        print(&format!(
            "{tally}lines: {}\n",
            options.out.join(part.file()).display()
        ))?;
    }
    Ok(if tally.failed + tally.short > 0 { 3 } else { 0 })
}

fn collect(dir: &Path, draw: &[String], quiet: bool) -> Outcome {
    let draw = draw.iter().map(|it| map::Drawn::parse(it));
    let it = map::collect(dir, &draw.collect::<Result<Vec<_>>>()?)?;
    if !quiet {
        print(&format!("{it}files: {}\n", dir.display()))?;
    } else if it.missing() + it.failed + it.short > 0 {
        let _ = write!(io::stderr(), "{it}");
    }
    Ok(if it.missing() + it.failed + it.short > 0 {
        3
    } else {
        0
    })
}

/// Whether to use colour on a stream: a terminal, and nobody objects (no-color.org).
fn colour(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|it| it.is_empty())
}

/// Prints to standard output; a reader that has left is no error.
///
/// # Errors
/// [`Stop`] for anything else.
pub fn print(text: &str) -> std::result::Result<(), Stop> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Stop::new(1, format!("standard output: {error}"), ""))
        }
        _ => Ok(()),
    }
}
