//! From a tolerance to cells and steps: a ladder of runs, each finer than the one before in cells, steps and domain at
//! once, until three of them show that every number is within the tolerance or a limit says stop. The rungs are the same
//! for every tolerance: a looser one ends earlier.

use super::error_estimate::Errors;
use super::recipe::{RUNGS, Recipe, Rung};
use super::report::Transient;
use super::run::{Run, Task};
use crate::error::{Error, Result};
use crate::fokker_planck::adaptive::{self, Next, Question, Stop};
use crate::fokker_planck::budget::Cost;
use crate::fokker_planck::layout::STEEPER_TRIES;
use crate::fokker_planck::policy::{LADDER_RATIO, SLOWEST};
use rayon::prelude::*;

/// The order of the best kernel: the fewest rungs that are foreseen before a limit of time ends the ladder.
const BEST_ORDER: u32 = 8;

/// How often rungs below the cells of the scene are brought nearer to them, by half.
const HALVINGS: usize = 4;

/// Solves the task to its tolerance, or as far as its limits allow. Where its mesh does not hold the
/// scene, what the recipe has otherwise takes over.
///
/// # Errors
/// Those of the first runs; later ones end the ladder. Cells that the program chose itself are
/// no error of the scene: if no mesh of its choice holds it, that is [`Error::Unresolved`].
pub(super) fn climbed(task: &Task, progress: &(dyn Fn(f64) + Sync)) -> Result<Transient> {
    let recipe = task.recipe;
    let (name, free) = (recipe.name(), recipe.is_free());
    let first = adaptive::pursue(Ladder::new(*task), (&name, free), task.limits, progress);
    match (first, recipe.otherwise.as_deref()) {
        (Err(error), Some(other)) if is_unfit(&error) => {
            let reason = format!("{name}, could not: {error}; {}", other.reason);
            let other = Recipe {
                reason,
                ..other.clone()
            };
            let recipe = &other;
            match climbed(&Task { recipe, ..*task }, progress) {
                // What would have let the first do is more use.
                Err(Error::Limit { .. } | Error::Unresolved { .. })
                    if matches!(error, Error::Limit { .. }) =>
                {
                    Err(error)
                }
                it => it,
            }
        }
        (it, _) => it.map_err(|error| unfit(error, recipe)),
    }
}

/// Whether it is the mesh that does not hold the scene.
pub(super) fn is_unfit(error: &Error) -> bool {
    match error {
        Error::Mesh { .. } | Error::Linear { .. } => true,
        Error::Invalid { key, .. } => key == "method.cells",
        Error::Limit { key, .. } => *key == "accuracy.max_memory",
        _ => false,
    }
}

/// What a mesh of the scene is too coarse for.
fn too_coarse(run: &Run) -> Error {
    let [nq, nv] = run.mesh.cells();
    let what = format!(
        "on {nq} x {nv} cells a part of the density moves against too little friction: deep in contact cells along v are \
         wider than the spread of v that noise holds there"
    );
    let help = "more method.cells along v, or cells of the program's choice";
    Error::mesh(what, help)
}

/// Cells of the program's own choice are no mistake of the scene's.
fn unfit(error: Error, recipe: &Recipe) -> Error {
    match error {
        error @ Error::Limit { .. } => error,
        error if recipe.layout.is_given() || !is_unfit(&error) => error,
        Error::Mesh { what, .. } => Error::Unresolved { what },
        error => Error::Unresolved {
            what: error.to_string(),
        },
    }
}

/// The runs so far.
struct Ladder<'a> {
    task: Task<'a>,
    /// Rungs by their number.
    laid_out: Vec<(f64, Rung)>,
    /// The rung to be run next, and whether with half the step of the scene.
    next: (f64, bool),
    /// That and those to be run beside it.
    beside: Vec<(f64, bool)>,
    /// Rungs from one run to the next.
    stride: f64,
    /// The last three runs, the finest last.
    runs: Vec<Run>,
    /// The first rung that shows an error, with half the step of the scene: on coarser ones a moving local grid, whose
    /// steps are its own, may carry the density for longer.
    halved: Option<Run>,
    /// The same rung with its whole.
    whole: Option<Run>,
    /// Rungs whose cells did not hold the scene.
    skipped: usize,
    errors: Option<Errors>,
    /// The finest run, the one before and their errors, from rungs below one that did not hold the scene.
    below: Option<(Run, Run, Errors)>,
    /// The largest error estimates so far, over the tolerance.
    ratios: Vec<f64>,
}

impl<'a> Ladder<'a> {
    fn new(task: Task<'a>) -> Self {
        Self {
            task,
            laid_out: Vec::new(),
            next: (task.recipe.first_rung(), false),
            beside: Vec::new(),
            stride: 1.0,
            runs: Vec::new(),
            halved: None,
            whole: None,
            skipped: 0,
            errors: None,
            below: None,
            ratios: Vec::new(),
        }
    }

    /// Rung `r`, laid out once.
    fn rung(&mut self, (r, halved): (f64, bool)) -> Result<Rung> {
        let known = self.laid_out.iter().find(|(known, _)| *known == r);
        let rung = match known {
            Some((_, rung)) => rung.clone(),
            None => {
                let rung = self.task.rung(r)?;
                self.laid_out.push((r, rung.clone()));
                rung
            }
        };
        Ok(if halved { rung.halved() } else { rung })
    }

    /// What a rung is foreseen to take.
    fn work(&mut self, which: (f64, bool)) -> Result<Cost> {
        let rung = self.rung(which)?;
        self.task.work(&rung, self.task.times)
    }

    /// What the next rung takes with those that are run beside it: at first as many as an answer needs, if they fit.
    fn together(&mut self) -> Result<Cost> {
        let (r, halved) = self.next;
        let mut all = self.work((r, halved))?;
        self.beside = vec![(r, halved)];
        let more = match self.task.recipe.step {
            None => (RUNGS - 1).saturating_sub(self.runs.len()),
            Some(_) => 0,
        };
        let (mut longest, mut sum) = (all.seconds, all.seconds);
        for k in 1..=more {
            let which = (r + k as f64 * self.stride, false);
            let Ok(it) = self.work(which) else { break };
            if all.memory + it.memory > self.task.limits.memory {
                break;
            }
            all.memory += it.memory;
            longest = longest.max(it.seconds);
            sum += it.seconds;
            self.beside.push(which);
        }
        all.seconds = longest.max(sum / rayon::current_num_threads() as f64);
        Ok(all)
    }

    /// Takes what came of the next rung.
    fn take(&mut self, rung: &Rung, run: Result<Run>) -> Result<()> {
        let recipe = self.task.recipe;
        let (r, halved) = self.next;
        let run = match run {
            Err(error) if self.skips(&error) => return Ok(()),
            it => it?,
        };
        if halved {
            self.halved = Some(run);
            self.next = (r, false);
            return Ok(());
        }
        if self.halved.is_some() && self.whole.is_none() {
            self.whole = Some(run.clone());
        }
        self.runs.push(run);
        if self.runs.len() > RUNGS {
            self.runs.remove(0);
        }
        let with_half = recipe.step.is_some() && self.runs.len() == RUNGS - 1;
        self.next = (r + self.stride, with_half);
        if let [coarsest, coarse, fine] = &self.runs[..] {
            let mut errors = Errors::of(&self.task, (rung, self.stride), [coarsest, coarse, fine]);
            if let (Some(halved), Some(whole)) = (&self.halved, &self.whole) {
                errors = errors.with_steps((&self.task, rung), [whole, halved]);
            }
            if !fine.is_none() {
                self.ratios.push(errors.worst(fine).0 / recipe.tolerance);
            } else if recipe.layout.is_given() {
                return Err(too_coarse(fine));
            }
            self.errors = Some(errors);
        }
        Ok(())
    }

    /// Whether finer cells may hold what those of a rung do not: begins again with the next, or nearer to the cells
    /// of the scene.
    fn skips(&mut self, error: &Error) -> bool {
        let recipe = self.task.recipe;
        let given = recipe.layout.is_given();
        let most = if given { HALVINGS } else { STEEPER_TRIES };
        let fits = !is_unfit(error) || matches!(error, Error::Limit { .. });
        let again = !fits && self.skipped < most;
        if again {
            if let Some(errors) = self.errors.take() {
                let mut finest = self.runs.drain(..).rev();
                self.below = finest
                    .next()
                    .zip(finest.next())
                    .map(|(fine, coarse)| (fine, coarse, errors));
            }
            self.skipped += 1;
            let first = if given {
                self.stride *= 0.5;
                recipe.expected - (RUNGS - 1) as f64 * self.stride
            } else {
                self.next.0 + self.stride
            };
            self.next = (first, false);
            self.runs.clear();
            (self.halved, self.whole) = (None, None);
        }
        again
    }

    /// Whether the last error estimates are hardly below those before: one more of them than a single rung that is off spoils,
    /// and twice as many where not even the size of a number is known.
    fn stalled(&self, known: bool) -> bool {
        let looks = if known { RUNGS + 1 } else { 2 * (RUNGS + 1) };
        let least = |ratios: &[f64]| ratios.iter().copied().fold(f64::INFINITY, f64::min);
        let (before, last) = self
            .ratios
            .split_at(self.ratios.len().saturating_sub(looks));
        let falls = least(last) < SLOWEST.get() * least(before);
        !before.is_empty() && !falls
    }
}

impl Question for Ladder<'_> {
    type Answer = Transient;

    fn ratio(&self) -> Option<f64> {
        self.ratios.last().copied()
    }

    fn next(&mut self) -> Result<Next> {
        let recipe = self.task.recipe;
        let Some(ratio) = self.ratio() else {
            return match self.together() {
                Err(error) if self.skips(&error) => self.next(),
                now => Ok(Next::run(now?)),
            };
        };
        if recipe.layout.is_given() {
            return Ok(Next::stop("cells are those of the scene"));
        }
        if let Some(errors) = &self.errors
            && errors.steps() > recipe.tolerance
        {
            return Ok(Next::stop("method.step is that of the scene"));
        }
        let begun = self.task.begun.iter().copied().flatten().flatten();
        if begun.copied().any(|it| it > recipe.tolerance) {
            return Ok(Next::stop("the law that it begins in is known no better"));
        }
        // An error beyond the number's own scale, or one that is not known, foresees nothing.
        let is_known = ratio * recipe.tolerance < 1.0;
        if self.stalled(is_known) {
            return Ok(Next::stop("finer meshes change it no more"));
        }
        let known = if is_known { ratio } else { 1.0 };
        let fall = f64::from(BEST_ORDER) * LADDER_RATIO.get().ln();
        let more = (known.ln() / fall).max(0.0).floor();
        let now = self.together()?;
        let then = Some(self.work((self.next.0 + more, false))?);
        Ok(Next::Run { now, then })
    }

    fn run(&mut self, progress: &(dyn Fn(f64) + Sync)) -> Result<()> {
        let task = self.task;
        let beside = std::mem::take(&mut self.beside);
        let rungs: Result<Vec<Rung>> = beside.iter().map(|which| self.rung(*which)).collect();
        let rungs = rungs?;
        let last = rungs.len() - 1;
        let one = |(k, rung): (usize, &Rung)| {
            // The last takes the longest.
            let told = |x: f64| {
                if k == last {
                    progress(x);
                }
            };
            task.once(rung, task.times, &told)
        };
        let all = rungs.par_iter().enumerate().with_max_len(1);
        // It is begun first.
        let mut runs: Vec<Result<Run>> = all.rev().map(one).collect();
        runs.reverse();
        for ((which, rung), run) in beside.iter().zip(&rungs).zip(runs) {
            // What a rung before it turned away from is not asked for.
            if *which == self.next {
                self.take(rung, run)?;
            }
        }
        Ok(())
    }

    fn answer(mut self, stop: Stop) -> Option<Transient> {
        let (fine, coarse, errors) = match self.errors {
            Some(errors) => (self.runs.pop()?, self.runs.pop()?, errors),
            None => self.below?,
        };
        let report = self.task.report(fine, &coarse, &errors, stop, Vec::new());
        Some(report)
    }
}
