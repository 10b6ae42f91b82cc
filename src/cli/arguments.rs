//! The command line: commands and options.

use crate::error::Result;
use crate::report::folder::{Existing, Folder};
use clap::{Args, Parser, Subcommand};
use std::path::{Path, PathBuf};

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
pub(super) struct Cli {
    #[command(subcommand)]
    pub(super) command: Option<Command>,
    #[command(flatten)]
    pub(super) options: RunOptions,
}

#[derive(Subcommand)]
pub(super) enum Command {
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
pub(super) struct SceneChoice {
    /// A scene file in TOML, or the name of a built-in scene [default: the built-in "default"]
    #[arg(value_name = "SCENE.toml")]
    pub(super) scene: Option<PathBuf>,
}

#[derive(Args, Default)]
pub(super) struct RunOptions {
    #[command(flatten)]
    pub(super) output: Output,
    /// Override a key of the scene, as oscillator.h=0.01
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,
    /// Number of threads [default: all cores]
    #[arg(long, value_name = "N", value_parser = threads, allow_negative_numbers = true)]
    pub(super) threads: Option<u16>,
    /// Print nothing but errors
    #[arg(long, short)]
    pub(super) quiet: bool,
    /// Open the page of results when it is written
    #[arg(long)]
    pub(super) open: bool,
}

#[derive(Args)]
pub(super) struct MapOptions {
    /// An axis: a key and its values, KEY=log:a:b:n, lin:a:b:n or a list [x, y]; the first runs slowest
    #[arg(long, value_name = "KEY=RANGE", required = true)]
    pub(super) over: Vec<String>,
    /// Only part K of N, for engines that run parts side by side
    #[arg(long, value_name = "K/N")]
    pub(super) part: Option<String>,
    /// Folder of the map, one for all its parts
    #[arg(long, value_name = "DIR")]
    pub(super) out: PathBuf,
    /// Override a key of the scene, as oscillator.contact=bilinear
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,
    /// Keep a curve of results.json in the lines, as spectrum or first_loss.survival
    #[arg(long, value_name = "CURVE")]
    pub(super) keep: Vec<String>,
    /// Compute again the points that failed, lack an answer or missed the tolerance
    #[arg(long)]
    pub(super) retry: bool,
    /// Number of threads [default: all cores]
    #[arg(long, value_name = "N", value_parser = threads, allow_negative_numbers = true)]
    pub(super) threads: Option<u16>,
    /// Print nothing but errors
    #[arg(long, short)]
    pub(super) quiet: bool,
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
        Folder::open(&self.path(title), existing)
    }

    pub(super) fn path(&self, title: &str) -> PathBuf {
        let default = || Path::new("results").join(title);
        self.out.clone().unwrap_or_else(default)
    }
}

/// The number of threads of a command line.
fn threads(text: &str) -> std::result::Result<u16, String> {
    let number = text.parse().ok().filter(|it| (1..=1024).contains(it));
    number.ok_or_else(|| "accepted: a whole number from 1 to 1024".into())
}
