//! From a tolerance to cells and steps: runs are refined where their errors are too large, each fine run
//! the coarse one of the next, until every bar is within the tolerance or a limit says stop.

use super::cost;
use super::error_estimate::{self, Errors};
use super::recipe::{Recipe, Scheme};
use super::report::Transient;
use super::run::{Run, Task};
use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use crate::fokker_planck::adaptive::{self, Next, Question, Stop};
use crate::fokker_planck::budget::Work;
use crate::fokker_planck::layout::{COARSE, DOMAIN_SHARE};
use crate::fokker_planck::settings::TimeScheme;
use crate::scales::Scales;

/// Part of the tolerance that the truncated domain may take, once run, before it is enlarged and run again.
const DOMAIN_LIMIT: f64 = 0.1;

/// Parts of what the box leaves that mesh and steps aim at once they are refined: the bars of a new run
/// come out up to twice as large as foreseen.
const SPACE_SHARE: f64 = 0.6;
const TIME_SHARE: f64 = 0.3;

/// Refinements of the mesh considered, over the finest so far: below the first two meshes are too much
/// alike to measure anything, beyond the last too little is learnt for the price.
const FINER: [f64; 6] = [1.2, 1.3, 1.45, 1.6, 1.8, 2.0];

/// A box that leaves out so many times its share is not enlarged.
const HOPELESS: f64 = 1e8;

/// The best order in space hoped for before a limit is believed.
const HOPED: f64 = 8.0;

/// The highest order believed once a higher one was seen: that of the kink of the force, which meshes fine
/// enough come to. What part of a difference is the kink's falls with it, the rest faster.
const TRUSTED: f64 = 3.0;

/// Order that meshes fine enough come to even where the first ones do not.
const LIKELY: f64 = 3.5;

/// Order in space expected before any was seen: the kink of the force is carried about by a flow map and
/// stays on a face of finite volumes.
fn expected(scheme: Scheme) -> f64 {
    match scheme {
        Scheme::FlowMap => 3.0,
        Scheme::Volumes(_) => 5.0,
    }
}

/// Steps of a coarse run over those of the fine one, and the order in time that is relied on: steps of
/// the flow map err by zeta^2 tau^3 and less, unless they follow their cells (half an order is relied on there);
/// other steps choose themselves by their error.
fn steps(recipe: &Recipe) -> (f64, f64) {
    match recipe.scheme {
        Scheme::Volumes(_) if recipe.knows_its_steps() => (1.0, 2.0),
        Scheme::Volumes(TimeScheme::BackwardEuler) => (2.0, 0.9),
        Scheme::FlowMap if recipe.limited_by_mesh => (1.5, 0.5),
        Scheme::Volumes(_) | Scheme::FlowMap => (1.5, 2.0),
    }
}

/// A run with its cells and steps, over the first guess.
struct Level {
    finer: f64,
    longer: f64,
    run: Run,
}

/// Solves the task to its tolerance, or as far as its limits allow. Where the method is free, finite
/// volumes take over from a flow map that cannot reach the tolerance or would need longer for it.
///
/// # Errors
/// Those of the first two runs; later ones end the refinement. Cells that the program chose itself are
/// no error of the scene: if no mesh of its choice holds it, that is [`Error::Unresolved`].
pub(super) fn refined(task: &Task, progress: &(dyn Fn(f64) + Sync)) -> Result<Transient> {
    let volumes = task.recipe.otherwise.as_deref();
    let first = Refinement::new(*task, volumes);
    let (best, why) = match (adaptive::pursue(first, task.limits, progress), volumes) {
        (Ok((best, None)), _) => return Ok(best),
        (Ok((best, Some(why))), _) => (Ok(best), why),
        (Err(error), Some(_)) if is_unfit(&error) => {
            let why = format!("the flow map could not: {error}");
            (Err(error), why)
        }
        (Err(error), _) => return Err(unfit(error, task.recipe)),
    };
    let Some(recipe) = volumes else {
        return best;
    };
    let volumes = Task { recipe, ..*task };
    let mut second = Refinement::new(volumes, None);
    second.recipe.reason = format!("{why}; {}", recipe.reason);
    match (adaptive::pursue(second, task.limits, progress), best) {
        (Ok((second, _)), Ok(best)) => {
            let ratio = |it: &Transient| it.shortfall.as_ref().map_or(0.0, |it| it.ratio);
            let better = ratio(&second) <= ratio(&best) || ratio(&best).is_nan();
            Ok(if better { second } else { best })
        }
        (Ok((second, _)), Err(_)) => Ok(second),
        // What there is stands, and says what it lacks.
        (Err(_), Ok(best)) => Ok(best),
        (Err(error), Err(_)) => Err(unfit(error, recipe)),
    }
}

/// Whether it is the mesh that does not hold the scene.
fn is_unfit(error: &Error) -> bool {
    match error {
        Error::Mesh { .. } | Error::Linear { .. } => true,
        Error::Invalid { key, .. } => key == "method.cells",
        Error::Limit { key, .. } => *key == "accuracy.max_memory",
        _ => false,
    }
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

/// What the next run is for.
#[derive(Clone, Copy)]
enum For {
    /// The first of two, in a domain large enough.
    Coarse,
    /// The first fine one.
    Fine,
    /// The coarse mesh with the steps of the fine one.
    Between,
    /// Finer than the last.
    Finer,
}

/// The last two runs, and the error estimates of the finer one.
struct Pair {
    fine: Level,
    coarse: Level,
    errors: Errors,
}

/// One method on its way to the tolerance.
struct Refinement<'a> {
    task: Task<'a>,
    /// That of the task, in a domain large enough.
    recipe: Recipe,
    /// Finite volumes, if the method is free.
    volumes: Option<&'a Recipe>,
    scales: Scales,
    /// Steps of the first coarse run over those of the fine one; order in time.
    longer: f64,
    order: f64,
    /// Whether cells and steps are left to the program.
    free: [bool; 2],
    search: Search,
    /// Cells of the first fine run over those laid out.
    first: f64,
    /// Larger domains, and finer cells that hold the scene, tried so far.
    domains: usize,
    meshes: usize,
    /// What the next run is for, and its cells and steps over the first guess.
    wanted: (For, (f64, f64)),
    /// The first run.
    coarse: Option<Level>,
    pair: Option<Pair>,
    /// Whether the search has seen the difference of the last two meshes.
    seen: bool,
    rounds: usize,
    /// Why finite volumes should be asked instead.
    switch: Option<String>,
}

impl<'a> Refinement<'a> {
    fn new(task: Task<'a>, volumes: Option<&'a Recipe>) -> Self {
        let (longer, order) = steps(task.recipe);
        Self {
            recipe: task.recipe.clone(),
            scales: Scales::of(task.oscillator),
            longer,
            order,
            free: task.recipe.free(),
            search: Search::new(task.recipe.scheme, task.oscillator.contact()),
            first: task.recipe.finer[0],
            domains: 0,
            meshes: 0,
            wanted: (For::Coarse, (1.0, 1.0)),
            coarse: None,
            pair: None,
            seen: false,
            rounds: 0,
            switch: None,
            volumes,
            task,
        }
    }

    /// The task in the domain of the last run.
    fn task(&self) -> Task<'_> {
        Task {
            recipe: &self.recipe,
            ..self.task
        }
    }

    /// What steps may still do after a cut by `ratio`, over the difference it made.
    fn in_time(&self, ratio: f64) -> f64 {
        if ratio == 1.0 {
            return 0.0;
        }
        1.0 / (ratio.powf(self.order) - 1.0)
    }

    /// What a mesh may still do, over the difference that one `ratio` times as coarse made: `believed`, or
    /// where the steps follow the cells what these do.
    fn in_space(&self, believed: f64, ratio: f64) -> f64 {
        if self.recipe.limited_by_mesh {
            believed.max(self.in_time(ratio))
        } else {
            believed
        }
    }

    /// What a run of a recipe is foreseen to take, on one core.
    fn work(&self, recipe: &Recipe, size: (f64, f64)) -> Result<Work> {
        let Task {
            oscillator,
            initial,
            times,
            limits,
            ..
        } = self.task;
        cost::run(recipe, oscillator, initial, times, size, limits.memory).map(Work::from)
    }

    /// The error estimates of the first two runs.
    fn first_errors(&self, fine: &Level, coarse: &Level) -> Errors {
        let space = self.in_space(self.search.beyond(1.0 / COARSE), 1.0 / COARSE);
        let factor = space.max(self.in_time(self.longer));
        let mut errors = Errors::between(&self.task(), &fine.run, &coarse.run, factor);
        errors.joint = self.longer != 1.0;
        errors
    }

    /// The error estimates of `next`, finer than `fine`, whose own were `before`.
    fn refined_errors(&mut self, next: &Level, fine: &Level, before: Errors) -> Errors {
        let mut errors = Errors::between(&self.task(), &next.run, &fine.run, 1.0);
        let (ratio, cut) = (next.finer / fine.finer, fine.longer / next.longer);
        self.seen = cut == 1.0;
        if cut == 1.0 {
            let believed = self.search.seen(errors.worst_space(), next, fine);
            errors.scale_space(self.in_space(believed, ratio));
            (errors.time, errors.joint) = (before.time, false);
            return errors;
        }
        let space = if ratio > 1.0 {
            self.in_space(self.search.beyond(ratio), ratio)
        } else {
            0.0
        };
        errors.scale_space(space.max(self.in_time(cut)));
        if ratio == 1.0 {
            errors.time = std::mem::replace(&mut errors.space, before.space);
            errors.joint = false;
        }
        errors
    }

    /// A pair whose meshes and steps differ, told apart by the coarse mesh with the steps of the fine one.
    fn told(&self, mut pair: Pair, between: &Level) -> Pair {
        let Pair {
            fine,
            coarse,
            errors,
        } = &mut pair;
        let ratio = fine.finer / coarse.finer;
        let cut = self.in_time(coarse.longer / fine.longer);
        let space = self.in_space(self.search.beyond(ratio), ratio);
        let scales = &self.scales;
        errors.time = error_estimate::differences(&between.run, &coarse.run, cut, scales);
        errors.space = error_estimate::differences(&fine.run, &between.run, space, scales);
        errors.joint = false;
        pair
    }

    /// Whether finer cells may hold what those chosen do not.
    fn retries(&mut self, error: &Error) -> bool {
        let volumes = self.recipe.scheme != Scheme::FlowMap;
        let again = self.free[0] && volumes && is_unfit(error) && self.meshes < 3;
        if again {
            self.meshes += 1;
            self.first *= 1.25;
        }
        again
    }

    /// A first coarse run: once more on finer cells, where those chosen do not hold the scene, or in a domain so large
    /// that it takes no more than its share, whatever the shape of the force.
    fn judge_coarse(&mut self, run: Result<Level>) -> Result<()> {
        let coarse = match run {
            Err(error) if self.retries(&error) => return Ok(()),
            it => it?,
        };
        let outside = Errors::between(&self.task(), &coarse.run, &coarse.run, 0.0).worst_outside();
        let share = DOMAIN_SHARE * self.recipe.tolerance;
        // The shape of a force that has all but vanished is beyond any domain, and cells of the scene may
        // not carry a larger one.
        let enough = outside <= DOMAIN_LIMIT * self.recipe.tolerance;
        if self.recipe.layout.is_given()
            || enough
            || outside > HOPELESS * share
            || self.domains == 3
        {
            self.coarse = Some(coarse);
            return Ok(());
        }
        self.domains += 1;
        // The weights grow a little as the domain does; below rounding nothing is gained.
        let neglected = (self.recipe.neglected * 0.7 * share / outside).max(1e-18);
        let Task {
            oscillator,
            initial,
            times,
            ..
        } = self.task;
        let until = times.last().copied().unwrap_or(0.0);
        self.recipe = self.recipe.widened(oscillator, initial, until, neglected)?;
        Ok(())
    }

    /// The next run after two, or why there is none.
    fn finer(&mut self, pair: &Pair) -> Result<Next> {
        let Pair {
            fine,
            coarse,
            errors,
        } = pair;
        let tolerance = self.recipe.tolerance;
        let stop = |text: &str, free| Ok(Next::Stop(Stop::new(text, free)));
        if self.free == [false; 2] {
            return stop("cells and step are those of the scene", false);
        }
        if errors.joint {
            // Which of the two is it? The coarse mesh with the short steps tells. Each pass of a flow
            // map adds an error of the mesh, so that the part of the steps holds some of it.
            return self.then(For::Between, (coarse.finer, fine.longer), None);
        }
        let goal = (tolerance - errors.worst_fixed()).max(0.25 * tolerance);
        let ratio = fine.finer / coarse.finer;
        let (space, time) = (errors.worst_space(), errors.worst_time());
        let (mut finer, mut shorter) = (1.0, 1.0);
        if self.free[0] && space > SPACE_SHARE * goal {
            if ratio > 1.0 && !self.seen {
                let difference = space / self.search.beyond(ratio);
                self.search.seen(difference, fine, coarse);
            }
            finer = self.search.finer(space, SPACE_SHARE * goal, ratio);
        }
        if self.free[1] && time > TIME_SHARE * goal {
            // Not much shorter than the cells allow: short passes of a flow map damp nothing.
            let wanted = (time / (TIME_SHARE * goal)).powf(1.0 / self.order);
            shorter = wanted.clamp(1.25, if finer > 1.0 { finer.max(1.25) } else { 2.0 });
        }
        if finer == 1.0 && shorter == 1.0 {
            // Nothing is fixed: the box, or a bar that is no number, of which refinement knows nothing.
            return match self.free {
                [true, true] => stop("neither cells nor steps are what it lacks", true),
                [true, false] => stop("method.step is that of the scene", false),
                [false, _] => stop("method.cells is that of the scene", false),
            };
        }
        if self.rounds >= 3 && self.search.stalled() {
            return stop("finer meshes change it no more: that is rounding", true);
        }
        let size = |finer: f64| (fine.finer * finer, fine.longer / shorter);
        let likely = self.search.needed(space / goal, LIKELY).max(finer);
        if let Some(volumes) = self.volumes
            && let Ok(it) = self.work(volumes, (1.0, 1.0))
            && it.memory <= self.task.limits.memory
        {
            // Both as foreseen: what is chosen must not depend on what else the machine does.
            let here = self.work(&self.recipe, size(likely))?.seconds;
            // A coarse run, a fine one and another, 1.8 times as fine.
            let there = 8.0 * it.seconds;
            if here > there && there < self.task.limits.left() {
                let text = format!(
                    "the flow map on {likely:.1} times finer cells would take about {here:.1} s, finite \
                     volumes {there:.1} s"
                );
                self.switch = Some(text.clone());
                return stop(&text, true);
            }
        }
        let hoped = self.search.needed(space / goal, HOPED).max(finer.min(1.2));
        self.then(For::Finer, size(finer), Some(size(hoped)))
    }

    /// A run, and the size of another that must follow.
    fn then(&mut self, why: For, size: (f64, f64), then: Option<(f64, f64)>) -> Result<Next> {
        self.wanted = (why, size);
        let work = |size| self.work(&self.recipe, size);
        Ok(Next::Run {
            now: work(size)?,
            then: then.map(work).transpose()?,
        })
    }
}

impl Question for Refinement<'_> {
    /// With the reason to ask finite volumes instead, if there is one.
    type Answer = (Transient, Option<String>);

    fn name(&self) -> String {
        self.recipe.name()
    }

    fn ratio(&self) -> Option<f64> {
        let Pair { fine, errors, .. } = self.pair.as_ref()?;
        Some(errors.worst(&fine.run).0 / self.recipe.tolerance)
    }

    fn next(&mut self) -> Result<Next> {
        let first = (self.first, 1.0);
        match (self.pair.take(), &self.coarse) {
            (Some(pair), _) => {
                let next = self.finer(&pair);
                self.pair = Some(pair);
                next
            }
            (None, Some(_)) => self.then(For::Fine, first, None),
            (None, None) => {
                let coarse = (COARSE * self.first, self.longer);
                match self.then(For::Coarse, coarse, Some(first)) {
                    Err(error) if self.retries(&error) => self.next(),
                    next => next,
                }
            }
        }
    }

    fn run(&mut self, progress: &(dyn Fn(f64) + Sync)) -> Result<()> {
        let (why, (finer, longer)) = self.wanted;
        let run = self.task().run((finer, longer), self.task.times, progress);
        let run = run.map(|run| Level { finer, longer, run });
        if let For::Coarse = why {
            return self.judge_coarse(run);
        }
        let run = run?;
        self.pair = match (why, self.coarse.take(), self.pair.take()) {
            (For::Fine, Some(coarse), _) => Some(Pair {
                errors: self.first_errors(&run, &coarse),
                fine: run,
                coarse,
            }),
            (For::Between, _, Some(pair)) => Some(self.told(pair, &run)),
            (For::Finer, _, Some(Pair { fine, errors, .. })) => {
                self.rounds += 1;
                Some(Pair {
                    errors: self.refined_errors(&run, &fine, errors),
                    fine: run,
                    coarse: fine,
                })
            }
            (_, _, pair) => pair,
        };
        Ok(())
    }

    fn answer(self, stop: Stop) -> Option<Self::Answer> {
        let Pair {
            fine,
            coarse,
            errors,
        } = self.pair?;
        let reason = match self.rounds {
            0 => self.recipe.reason.clone(),
            rounds => format!("{}; refined {rounds} times", self.recipe.reason),
        };
        let task = Task {
            recipe: &self.recipe,
            ..self.task
        };
        let answer = task.report(fine.run, &coarse.run, &errors, reason, stop, Vec::new());
        Some((answer, self.switch))
    }
}

/// What refining the mesh has shown so far.
struct Search {
    /// Order in space believed before any was seen.
    believed: f64,
    /// Order in space expected before any was seen.
    expected: f64,
    /// Differences and the resolutions they lie between: coarse, fine.
    seen: Vec<(f64, f64, f64)>,
}

impl Search {
    fn new(scheme: Scheme, contact: &ContactLaw) -> Self {
        Self {
            believed: error_estimate::believed(scheme, contact),
            expected: expected(scheme),
            seen: Vec::new(),
        }
    }

    /// Takes a difference down, and says what the finer mesh may still do over it.
    fn seen(&mut self, difference: f64, fine: &Level, coarse: &Level) -> f64 {
        self.seen.push((difference, coarse.finer, fine.finer));
        self.beyond(fine.finer / coarse.finer)
    }

    /// The order in space from the last two differences, C (coarse^-p - fine^-p) each.
    fn order(&self) -> Option<f64> {
        let [.., (before, a, b), (now, c, d)] = self.seen[..] else {
            return None;
        };
        let ratio = |p: f64| (a.powf(-p) - b.powf(-p)) / (c.powf(-p) - d.powf(-p));
        let (mut low, mut high) = (0.5, HOPED);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if ratio(middle) < before / now {
                low = middle;
            } else {
                high = middle;
            }
        }
        Some(low)
    }

    /// Whether the last refinements left the differences as they were.
    fn stalled(&self) -> bool {
        let [.., (first, ..), _, (last, ..)] = self.seen[..] else {
            return false;
        };
        last > 0.5 * first
    }

    /// The smallest refinement whose bar is expected within the goal; the largest if none is.
    fn finer(&self, bar: f64, goal: f64, last: f64) -> f64 {
        let order = self.order().unwrap_or(self.expected);
        // Without a difference of meshes the bar itself is taken for the error.
        let error = if last > 1.0 {
            bar / self.beyond(last) / (last.powf(order) - 1.0)
        } else {
            bar
        };
        let foreseen =
            |finer: f64| self.beyond_with(finer, order) * error * (1.0 - finer.powf(-order));
        let enough = FINER.into_iter().find(|finer| foreseen(*finer) <= goal);
        enough.unwrap_or(FINER[FINER.len() - 1])
    }

    /// How much finer the mesh must be where its part is `short` times what it may be: by the order seen,
    /// else by `order`.
    fn needed(&self, short: f64, order: f64) -> f64 {
        let order = self.order().unwrap_or(order).max(LIKELY);
        short.max(1.0).powf(1.0 / order)
    }

    /// The error of the finer of two runs over their difference, by the order that three meshes have shown,
    /// if there were three.
    fn beyond(&self, ratio: f64) -> f64 {
        self.beyond_with(ratio, self.order().unwrap_or(0.0))
    }

    /// The same where an order was seen: up to [`TRUSTED`], since orders are not seen to better than one.
    fn beyond_with(&self, ratio: f64, seen: f64) -> f64 {
        error_estimate::beyond(ratio, (seen - 1.0).min(TRUSTED).max(self.believed))
    }
}
