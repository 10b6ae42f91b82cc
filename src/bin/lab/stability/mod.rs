//! Stiff and extreme scenes, each run as a user would run it and held against what is known of it: every number is
//! within its error estimate. A warning excuses the numbers it names as not known and no other; a limit or a refusal
//! is an answer only where the scene's entry says why.
//!
//! ```
//! use vibroimpact::stability::{Verdict, run, scenes};
//!
//! let mut extreme = scenes()?;
//! extreme.retain(|it| it.name == "time-zero");
//! let rows = run(extreme, &|_row| ());
//! assert_eq!(rows[0].verdict, Verdict::Within);
//! # Ok::<(), vibroimpact::Error>(())
//! ```

mod extreme;
mod table;
mod verdict;
mod yardstick;

pub use extreme::{Extreme, scenes};
pub use table::{files, text};
pub use verdict::{Row, Verdict};
pub use yardstick::Against;

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use vibroimpact::error::{Error, Result};
use vibroimpact::plan::Plan;
use vibroimpact::results::Results;
use vibroimpact::scene::Scene;
use vibroimpact::scene::text::SceneText;

/// Runs the scenes one after the other; `watch` is told each row. A scene that neither ends nor stops at
/// three times its limit is left behind on its thread.
pub fn run(scenes: Vec<Extreme>, watch: &dyn Fn(&Row)) -> Vec<Row> {
    let one = |extreme: Extreme| {
        let row = run_one(&extreme);
        watch(&row);
        row
    };
    scenes.into_iter().map(one).collect()
}

/// What came of a scene.
enum Outcome {
    Done(Box<Results>, Vec<yardstick::Check>),
    /// The scene itself, a stage or its yardstick ended in an error.
    Failed(Error),
    /// The text of the scene was refused.
    Unread(String),
}

fn run_one(extreme: &Extreme) -> Row {
    let clock = Instant::now();
    let (send, receive) = channel();
    let job = extreme.clone();
    let thread = std::thread::Builder::new().spawn(move || {
        // Nobody listens any more after a time-out.
        let _ = send.send((outcome(&job), job));
    });
    let patience = Duration::from_secs_f64(3.0 * extreme.max_seconds + 10.0);
    let answer = match &thread {
        Ok(_) => receive.recv_timeout(patience),
        Err(_) => Err(RecvTimeoutError::Timeout),
    };
    let seconds = clock.elapsed().as_secs_f64();
    match answer {
        Ok((outcome, extreme)) => verdict::row(&extreme, outcome, seconds),
        Err(RecvTimeoutError::Timeout) => {
            let message = format!("neither ended nor stopped within {seconds:.0} s");
            verdict::lost(extreme, Verdict::Late, message, seconds)
        }
        Err(RecvTimeoutError::Disconnected) => {
            verdict::lost(extreme, Verdict::Panicked, "it panicked".into(), seconds)
        }
    }
}

fn outcome(extreme: &Extreme) -> Outcome {
    let scene = match extreme.scene(&[]) {
        Ok(scene) => scene,
        Err(message) => return Outcome::Unread(message),
    };
    let results = match solve(&scene) {
        Ok(results) => results,
        Err(error) => return Outcome::Failed(error),
    };
    match yardstick::checks(extreme, &scene, &results) {
        Ok(checks) => Outcome::Done(Box::new(results), checks),
        Err(error) => Outcome::Failed(error),
    }
}

fn solve(scene: &Scene) -> Result<Results> {
    Plan::of(scene)?.run_quietly()
}

/// A message with its help.
fn explained(error: &dyn miette::Diagnostic) -> String {
    match error.help() {
        Some(help) => format!("{error}; {help}"),
        None => error.to_string(),
    }
}

impl Extreme {
    /// The scene with overrides, or why its text is refused.
    fn scene(&self, overrides: &[String]) -> std::result::Result<Scene, String> {
        let limit = format!("accuracy.max_seconds={}", self.max_seconds);
        let all: Vec<String> = std::iter::once(limit)
            .chain(overrides.iter().cloned())
            .collect();
        match SceneText::parse(&self.name, &self.toml, &all) {
            Ok(text) => Ok(text.scene().clone()),
            Err(error) => Err(explained(&error)),
        }
    }
}
