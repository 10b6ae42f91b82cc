//! Runs of every method at every level, timed again and again.

use super::case::Case;
use super::clock::Clock;
use super::method::{Level, Method};
use super::reference::{Errors, Reference};
use super::solve::{Answer, solve};
use std::time::Instant;
use vibroimpact::error::Result;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// Two coarse levels, once, against coarse references: for tests.
    Quick,
    Full,
}

/// One method at one level on one case.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    pub method: Method,
    pub level: Level,
    /// Cells in q and v; 0 for paths.
    pub cells: [usize; 2],
    /// Cells that hold unknowns.
    pub unknowns: usize,
    pub steps: u64,
    /// Estimated bytes of all arrays.
    pub memory: u64,
    /// Its errors; of paths the root mean square over seeds.
    pub errors: Errors,
    /// Wall times of the repeated runs, ascending, set-up included.
    pub seconds: Vec<f64>,
    /// Least processor time of the runs, of all threads: what it costs on a machine that others use too.
    pub processor: f64,
}

impl Entry {
    pub fn median(&self) -> f64 {
        let n = self.seconds.len();
        0.5 * (self.seconds[(n - 1) / 2] + self.seconds[n / 2])
    }

    /// Fastest and slowest of the wall times.
    pub fn spread(&self) -> [f64; 2] {
        [self.seconds[0], self.seconds[self.seconds.len() - 1]]
    }

    /// Error in the L1 norm; of E\[H\] over T for paths, which have no density.
    pub fn main_error(&self) -> f64 {
        self.errors.l1.unwrap_or(self.errors.energy)
    }
}

/// All entries of a case.
#[derive(Debug, Clone)]
pub struct Survey {
    pub case: Case,
    /// The runs that worked.
    pub entries: Vec<Entry>,
    /// Those that were refused or failed: method and why.
    pub failures: Vec<(Method, String)>,
    /// What the errors themselves are known to.
    pub uncertainty: Errors,
    /// Seconds for everything.
    pub seconds: f64,
}

/// A level is not begun if the one before took longer, in processor seconds: the next may take eight times
/// that.
const LONG: f64 = 0.8;

/// Seconds of repetitions of one entry.
const REPEATED: f64 = 0.4;

/// Fewest and most runs of one entry; two of one that takes long.
const RUNS: (u32, u32) = (3, 7);

/// Runs the methods on a case; `watch` is told every entry. An entry that fails stops nothing.
pub fn survey(
    case: &Case,
    methods: &[Method],
    effort: Effort,
    watch: &dyn Fn(&Entry),
) -> Result<Survey> {
    let clock = Instant::now();
    let reference = match effort {
        Effort::Full => Reference::of(case)?,
        Effort::Quick => {
            let fine = Level {
                finer: 1.5,
                tolerance: 1e-5,
                paths: 0,
            };
            Reference::at(case, &fine)?
        }
    };
    let (mut entries, mut failures) = (Vec::new(), Vec::new());
    for method in methods {
        let mut levels = method.levels();
        if effort == Effort::Quick {
            // Beyond the coarsest, which may not hold the start.
            let skipped = levels.len().saturating_sub(4).min(2);
            levels.drain(..skipped);
            levels.truncate(2);
        }
        for level in levels {
            match entry(case, *method, &level, effort, &reference) {
                Ok(entry) => {
                    watch(&entry);
                    let slow = effort == Effort::Full && entry.processor > LONG;
                    entries.push(entry);
                    if slow {
                        break;
                    }
                }
                Err(error) => failures.push((*method, error.to_string())),
            }
        }
    }
    Ok(Survey {
        case: case.clone(),
        entries,
        failures,
        uncertainty: reference.uncertainty(),
        seconds: clock.elapsed().as_secs_f64(),
    })
}

fn entry(
    case: &Case,
    method: Method,
    level: &Level,
    effort: Effort,
    reference: &Reference,
) -> Result<Entry> {
    let mut processor = f64::INFINITY;
    let mut timed = |seed: u64| -> Result<(Answer, f64)> {
        let (clock, used) = (Instant::now(), Clock::new());
        let answer = solve(case, method, level, seed)?;
        let seconds = clock.elapsed().as_secs_f64();
        processor = processor.min(used.seconds());
        Ok((answer, seconds))
    };
    let (answer, first) = timed(1)?;
    let runs = match effort {
        Effort::Quick => 1,
        Effort::Full if first > LONG => 2,
        Effort::Full => ((REPEATED / first) as u32).clamp(RUNS.0, RUNS.1),
    };
    let mut errors = vec![reference.errors(method, &answer)];
    let mut seconds = vec![first];
    for seed in 2..=u64::from(runs) {
        let (again, time) = timed(seed)?;
        seconds.push(time);
        if method.samples() {
            errors.push(reference.errors(method, &again));
        }
    }
    seconds.sort_by(f64::total_cmp);
    Ok(Entry {
        method,
        level: *level,
        cells: answer.cells(),
        unknowns: answer.unknowns,
        steps: answer.steps,
        memory: answer.memory,
        errors: root_mean_square(&errors),
        seconds,
        processor,
    })
}

fn root_mean_square(all: &[Errors]) -> Errors {
    let n = all.len() as f64;
    let rms =
        |f: &dyn Fn(&Errors) -> f64| (all.iter().map(|e| f(e).powi(2)).sum::<f64>() / n).sqrt();
    let Some(first) = all.first().filter(|_| all.len() > 1) else {
        return all.first().copied().unwrap_or_default();
    };
    Errors {
        l1: first.l1,
        square_speed: rms(&|e| e.square_speed),
        energy: rms(&|e| e.energy),
        loss: first.loss.map(|_| rms(&|e| e.loss.unwrap_or(0.0))),
        diffusion: all.iter().map(|e| e.diffusion).sum::<f64>() / n,
    }
}
