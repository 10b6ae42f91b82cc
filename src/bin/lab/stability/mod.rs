//! Stiff and extreme scenes, each run as a user would run it and held against what is known of it: every number is
//! within its error estimate. A warning excuses the numbers it names as not known and no other; a limit or a refusal
//! is an answer only where the scene's entry says why.

pub mod against;
pub mod extreme;
pub mod table;
pub mod verdict;
pub mod yardstick;

use extreme::Extreme;

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use verdict::{Outcome, Row, Verdict};
use vibroimpact::plan::Plan;

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
    let done = Plan::of(&scene)
        .and_then(|plan| plan.run_quietly())
        .and_then(|results| {
            let checks = yardstick::checks(extreme, &scene, &results)?;
            Ok(Outcome::Done(Box::new(results), checks))
        });
    done.unwrap_or_else(Outcome::Failed)
}
