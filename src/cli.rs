//! The program `vibroimpact`: reads the command line and the scene, plans, runs, reports. The only file of the library
//! that prints. The laboratory (src/bin/lab) is a program of its own made of the same parts.

mod arguments;
mod progress;
mod source;
mod stop;

pub use arguments::Output;
pub use progress::progress;
pub use stop::{Outcome, Stop};

use crate::error::{Error, Result};
use crate::map::{self, Axis, Map};
use crate::plan::Plan;
use crate::report::{self, terminal};
use crate::scene::text::{BUILT_IN, built_in};
use arguments::{Cli, Command, MapOptions, RunOptions};
use clap::error::ErrorKind;
use clap::{CommandFactory, Parser};
use progress::{MapWatch, Observer, bar};
use source::{keeps, named, no_such_scene, read, resembles_a_scene};
use std::ffi::OsString;
use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::sync::Mutex;

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

/// Whether a command line without a command has a scene: `vibroimpact my.toml --quiet`, `vibroimpact default`.
fn names_a_scene(arguments: &[OsString]) -> bool {
    let given = || arguments.iter().skip(1);
    let command = |it: &OsString| {
        let name = it.to_str().unwrap_or_default();
        name == "help"
            || Cli::command()
                .get_subcommands()
                .any(|it| it.get_name() == name)
    };
    let file = |it: &OsString| {
        let known = it.to_str().is_some_and(resembles_a_scene);
        known || Path::new(it).extension().is_some_and(|it| it == "toml")
    };
    // Behind --set or --out such a name may stand too; then another argument is the scene, or none.
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
            if message.kind() == ErrorKind::InvalidSubcommand {
                let command = C::command();
                let names = command.get_subcommands().map(clap::Command::get_name);
                let names = names.collect::<Vec<_>>();
                let _ = writeln!(io::stderr(), "accepted: {}, or a scene", names.join(", "));
            }
            return message.exit_code() as u8;
        }
    };
    let colour = colour(&io::stderr());
    // Fails only if a hook is there already, and then that one prints.
    let _ = miette::set_hook(Box::new(move |_| {
        let handler = miette::MietteHandlerOpts::new();
        Box::new(handler.color(colour).width(80).build())
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
            compute_on(threads(None))?;
            let text = read(scene.scene.as_deref(), &set)?;
            let plan = Plan::of(text.scene())
                .map_err(|error| Stop::explained(&error, text.explain(&error)))?;
            print(&terminal::plan(&plan)).map(|()| 0)
        }
        Some(Command::Map { scene, options }) => map(scene.scene.as_deref(), &options),
        Some(Command::Collect { dir, draw, quiet }) => collect(&dir, &draw, quiet),
        Some(Command::Scenes { name: None }) => {
            let lines = |(name, text): &(&str, &str)| {
                let comment = text.lines().map_while(|line| line.strip_prefix("# "));
                let about = terminal::wrap(&comment.collect::<Vec<_>>().join(" "), 67);
                format!("{name:<12} {}\n", about.join(&format!("\n{:13}", "")))
            };
            print(&BUILT_IN.iter().map(lines).collect::<String>()).map(|()| 0)
        }
        Some(Command::Completions { shell }) => {
            let mut text = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "vibroimpact", &mut text);
            print(&String::from_utf8_lossy(&text)).map(|()| 0)
        }
        Some(Command::Manual) => {
            let mut text = Vec::new();
            let mut all = Cli::command();
            all.build();
            let commands = all.get_subcommands().filter(|it| it.get_name() != "help");
            for page in std::iter::once(&all).chain(commands) {
                let made = clap_mangen::Man::new(page.clone()).render(&mut text);
                made.map_err(|error| Stop::new(1, error.to_string(), ""))?;
            }
            print(&String::from_utf8_lossy(&text)).map(|()| 0)
        }
        Some(Command::Scenes { name: Some(name) }) => match built_in(&name) {
            Some(text) => print(text).map(|()| 0),
            None => Err(no_such_scene(&name)),
        },
    }
}

/// Threads asked for, one a core if none are.
fn threads(asked: Option<u16>) -> usize {
    let cores = || std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    asked.map_or_else(cores, usize::from)
}

/// Computes on so many threads, whatever the environment says.
fn compute_on(threads: usize) -> std::result::Result<(), Stop> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    let failed = |error| Stop::new(1, format!("{threads} threads: {error}"), "");
    pool.build_global().map_err(failed)
}

fn run(scene: Option<&Path>, options: &RunOptions) -> Outcome {
    compute_on(threads(options.threads))?;
    let text = read(scene, &options.set)?;
    let explain = |error: Error| Stop::explained(&error, text.explain(&error));
    let plan = match Plan::of(text.scene()) {
        Err(error) if error.is_refusal() => return Err(explain(error)),
        plan => plan,
    };
    let title = text.scene().folder();
    keeps(scene, &text, &options.output.path(&title))?;
    let folder = options.output.folder(&title)?;
    let path = folder.path().to_owned();
    let plan = match plan {
        Ok(plan) => plan,
        Err(error) => {
            report::unanswered_into(text.scene(), &folder, &error)?;
            return Err(explain(error));
        }
    };
    let observer = Observer::new(options.quiet);
    let results = report::run_into(&plan, folder, &observer);
    observer.clear();
    let results = match results {
        Ok(results) => results,
        Err(error @ Error::Io { .. }) => return Err(error.into()),
        Err(error @ Error::Stopped { .. }) => {
            let kept = kept(&path)
                .unwrap_or_else(|| "no stage had ended: there is nothing to keep".into());
            let _ = writeln!(io::stderr(), "{error}; {kept}");
            // The shell learns that it was the signal, and ends its loop too.
            let _ = signal_hook::low_level::emulate_default_handler(observer.signal());
            return Ok(1);
        }
        Err(error) => {
            if let Some(kept) = kept(&path) {
                let _ = writeln!(io::stderr(), "{kept}");
            }
            return Err(explain(error));
        }
    };
    let status = if results.falls_short() { 3 } else { 0 };
    if options.quiet {
        // Only errors are printed, and this is one.
        for (stage, it) in results.shortfalls.iter().filter(|(_, it)| it.free) {
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

/// Where to find what had ended of a run that is over early.
fn kept(folder: &Path) -> Option<String> {
    let page = folder.join("report.html");
    page.is_file()
        .then(|| format!("what had ended is kept: {}", page.display()))
}

fn map(scene: Option<&Path>, options: &MapOptions) -> Outcome {
    let (name, text) = named(scene)?;
    let axes = options.over.iter().map(|it| Axis::parse(it));
    let axes = axes.collect::<Result<Vec<_>>>()?;
    let part = options.part.as_deref().map(map::Part::parse);
    let part = part.transpose()?.unwrap_or(map::Part::WHOLE);
    let it = Map::of(&name, &text, &options.set, axes, options.keep.clone())?;
    let threads = threads(options.threads);
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
        let (file, out) = (options.out.join(part.file()), options.out.display());
        let lines = format!("{tally}lines: {}\n", file.display());
        print(&format!(
            "{lines}table, arrays and picture: vibroimpact collect {out}\n"
        ))?;
    }
    Ok(if tally.failed + tally.lacking + tally.short > 0 {
        3
    } else {
        0
    })
}

fn collect(dir: &Path, draw: &[String], quiet: bool) -> Outcome {
    let draw = draw.iter().map(|it| map::Drawn::parse(it));
    let it = map::collect(dir, &draw.collect::<Result<Vec<_>>>()?)?;
    let lacks = it.missing() + it.failed + it.lacking + it.short > 0;
    if !quiet {
        print(&format!("{it}files: {}\n", dir.display()))?;
    } else if lacks {
        let _ = write!(io::stderr(), "{it}");
    }
    Ok(if lacks { 3 } else { 0 })
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
