//! From a tolerance to cells and steps: runs are refined where their errors are too large, each fine run
//! the coarse one of the next, until every bar is within the tolerance or a limit says stop.

use super::bars::{self, Bars};
use super::choice::{self, Settings, TimeScheme, Way};
use super::domain::Domain;
use super::transient::{Run, Task, Transient};
use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use crate::scales::Scales;
use std::cell::Cell;

/// Part of the tolerance that the box is chosen for: a tenth of it costs a twelfth more cells in either direction,
/// and its bar, the worst that what is outside could do, is far above its error.
const BOX_SHARE: f64 = 0.008;

/// Part of the tolerance that the box may take, once run, before it is enlarged and run again.
const BOX_LIMIT: f64 = 0.1;

/// Parts of what the box leaves that mesh and steps aim at once they are refined: the bars of a new run
/// come out up to twice as large as foreseen.
const SPACE_SHARE: f64 = 0.6;
const TIME_SHARE: f64 = 0.3;

/// Cells of the coarse run over those of the fine one: the closer they are the less is a difference of
/// order 8 above the error.
pub(super) const COARSE: f64 = 0.82;

/// Refinements of the mesh considered, over the finest so far: below the first two meshes are too much
/// alike to measure anything, beyond the last too little is learnt for the price.
const FINER: [f64; 6] = [1.2, 1.3, 1.45, 1.6, 1.8, 2.0];

/// A box that leaves out so many times its share is not enlarged.
const HOPELESS: f64 = 1e8;

/// A run foreseen to take so many times what is left is not begun: what is foreseen is within three of what it
/// takes, but for a few.
const UNTHINKABLE: f64 = 10.0;

/// The best order in space hoped for before a limit is believed.
const HOPED: f64 = 8.0;

/// The highest order believed once a higher one was seen: that of the kink of the force, which meshes fine
/// enough come to. What part of a difference is the kink's falls with it, the rest faster.
const TRUSTED: f64 = 3.0;

/// Order that meshes fine enough come to even where the first ones do not.
const LIKELY: f64 = 3.5;

/// The probability the box may leave out: as much as keeps its part of every bar within its share.
pub(super) fn neglected(
    oscillator: &Oscillator,
    initial: &Initial,
    settings: &Settings,
) -> Result<f64> {
    let mut outside = choice::neglected(settings.tolerance);
    // Cells of the scene may not carry a box as wide as every bar would like.
    let given = settings.neglected.is_some() || settings.cells.is_some();
    if !oscillator.contact().is_confining() || given {
        return Ok(settings.neglected.unwrap_or(outside));
    }
    let share = BOX_SHARE * settings.tolerance;
    // A kurtosis far above its scale moves with itself, and no start's is far below that of the law.
    let law = oscillator.displacement_law()?;
    let force = |k: i32| law.expect(|q| oscillator.contact().force(q).powi(k)).value;
    let shape = (force(4) / force(2).powi(2)).max(1.0);
    for _ in 0..6 {
        let domain = Domain::closed(oscillator, initial, outside)?;
        let weights = domain.tail_weights(oscillator);
        let part = domain.neglected * weights.into_iter().fold(0.0, f64::max) * shape;
        if part <= share {
            break;
        }
        // The weights grow a little as the box does.
        outside *= 0.8 * share / part;
    }
    Ok(outside)
}

/// Order in space expected before any was seen: the kink of the force is carried about by a flow map and
/// stays on a face of finite volumes.
fn expected(way: Way) -> f64 {
    match way {
        Way::FlowMap => 3.0,
        Way::Volumes(_) => 5.0,
    }
}

/// Steps of a coarse run over those of the fine one, and the order in time that is relied on: steps of
/// the flow map err by zeta^2 tau^3 and less, unless they follow their cells (half an order is relied on there);
/// other steps choose themselves by their error.
fn steps(task: &Task, strained: bool) -> (f64, f64) {
    match task.way {
        Way::Volumes(_) if task.knows_its_steps() => (1.0, 2.0),
        Way::Volumes(TimeScheme::BackwardEuler) => (2.0, 0.9),
        Way::FlowMap if strained => (1.5, 0.5),
        Way::Volumes(_) | Way::FlowMap => (1.5, 2.0),
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
/// no error of the scene: if no mesh of its choice holds it, that is [`Error::Limit`].
pub(super) fn refined(
    task: &Task,
    reason: String,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Transient> {
    let settings = task.settings;
    let free = task.way == Way::FlowMap
        && settings.method.is_none()
        && !choice::stays_in_frame(task.oscillator, task.initial, settings);
    let volumes = if free { task.volumes().ok() } else { None };
    let mut first = Refinement::new(*task, volumes.as_ref(), progress);
    let (best, why) = match (first.pursue(reason), &volumes) {
        (Ok((best, None)), _) => return Ok(best),
        (Ok((best, Some(why))), _) => (Ok(best), why),
        (Err(error), Some(_)) if is_unfit(&error) => {
            let why = format!("the flow map could not: {error}");
            (Err(error), why)
        }
        (Err(error), _) => return Err(unfit(error, settings)),
    };
    let Some((volumes, reason)) = volumes else {
        return best;
    };
    let second = Refinement::new(volumes, None, progress).pursue(format!("{why}; {reason}"));
    match (second, best) {
        (Ok((second, _)), Ok(best)) => {
            let ratio = |it: &Transient| it.shortfall.as_ref().map_or(0.0, |it| it.ratio);
            let better = ratio(&second) <= ratio(&best) || ratio(&best).is_nan();
            Ok(if better { second } else { best })
        }
        (Ok((second, _)), Err(_)) => Ok(second),
        // What there is stands, and says what it lacks.
        (Err(_), Ok(best)) => Ok(best),
        (Err(error), Err(_)) => Err(unfit(error, settings)),
    }
}

/// Whether it is the mesh that does not hold the scene.
fn is_unfit(error: &Error) -> bool {
    match error {
        Error::Mesh { .. } | Error::Linear { .. } => true,
        Error::Invalid { key, .. } => key == "method.cells",
        _ => false,
    }
}

/// Cells of the program's own choice are no mistake of the scene's.
fn unfit(error: Error, settings: &Settings) -> Error {
    if settings.cells.is_some() || !is_unfit(&error) {
        return error;
    }
    Error::Limit {
        key: "accuracy.tolerance",
        limit: format!("{:e}", settings.tolerance),
        what: format!("no mesh tried holds the scene: {error}"),
    }
}

/// What to do next.
enum Next {
    /// The bars are within the tolerance.
    Done,
    /// No further, and whether the program was free to go further.
    Stop(String, bool),
    /// Finite volumes, and why.
    Switch(String),
    /// A finer run.
    Level(Box<Level>),
}

/// One method on its way to the tolerance.
struct Refinement<'a> {
    task: Task<'a>,
    /// The task by finite volumes, if the method is free.
    volumes: Option<&'a (Task<'a>, String)>,
    scales: Scales,
    /// Steps of the first coarse run over those of the fine one; order in time.
    longer: f64,
    order: f64,
    /// Whether the steps of a flow map follow its cells: its shortest useful steps, a quarter of a cell, are then
    /// too long for the tolerance. At zeta = 1e3 the error was 3.3 times the difference that cells 1/0.82 times as
    /// wide made.
    strained: bool,
    /// Whether cells and steps are left to the program.
    free: [bool; 2],
    search: Search,
    rounds: usize,
    /// The part done.
    done: Cell<f64>,
    progress: &'a (dyn Fn(f64) + Sync),
}

impl<'a> Refinement<'a> {
    fn new(
        task: Task<'a>,
        volumes: Option<&'a (Task<'a>, String)>,
        progress: &'a (dyn Fn(f64) + Sync),
    ) -> Self {
        let until = task.times.last().copied().unwrap_or(0.0);
        // A mesh that cannot be made says so in the first run.
        let strained = task.way == Way::FlowMap
            && choice::is_strained(task.oscillator, task.initial, until, task.settings)
                .unwrap_or(false);
        let (longer, order) = steps(&task, strained);
        Self {
            strained,
            scales: Scales::of(task.oscillator),
            longer,
            order,
            free: [task.settings.cells.is_none(), task.settings.step.is_none()],
            search: Search::new(task.way, task.oscillator.contact()),
            rounds: 0,
            done: Cell::new(0.0),
            volumes,
            task,
            progress,
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
        if self.strained {
            believed.max(self.in_time(ratio))
        } else {
            believed
        }
    }

    /// A run that is expected to take this part of what is left.
    fn level(&self, task: &Task, finer: f64, longer: f64, part: f64) -> Result<Level> {
        let before = self.done.get();
        let left = 1.0 - before;
        let run = task.run((finer, longer), task.times, &|x| {
            (self.progress)(before + part * left * x);
        })?;
        self.done.set(before + part * left);
        Ok(Level { finer, longer, run })
    }

    /// The first coarse run: on finer cells, where those chosen do not hold the scene, and in a box so
    /// large that it takes no more than its share, whatever the shape of the force.
    fn coarse(&self, settings: &mut Settings) -> Result<(Level, f64)> {
        let [mut finer, _] = choice::guesses(
            self.task.way,
            self.task.oscillator,
            self.task.initial,
            self.task.times,
            self.task.settings,
        )?;
        let (mut boxes, mut meshes) = (0, 0);
        loop {
            let task = Task {
                settings,
                ..self.task
            };
            let coarse = match self.level(&task, COARSE * finer, self.longer, 0.3) {
                Err(error)
                    if self.free[0]
                        && is_unfit(&error)
                        && self.task.way != Way::FlowMap
                        && meshes < 3 =>
                {
                    meshes += 1;
                    finer *= 1.25;
                    continue;
                }
                it => it?,
            };
            let outside = task.bars(&coarse.run, &coarse.run, 0.0).worst_outside();
            let share = BOX_SHARE * settings.tolerance;
            // The shape of a force that has all but vanished is beyond any box, and cells of the scene may
            // not carry a larger one.
            let given = settings.cells.is_some();
            let enough = outside <= BOX_LIMIT * settings.tolerance;
            if given || enough || outside > HOPELESS * share || boxes == 3 {
                return Ok((coarse, finer));
            }
            boxes += 1;
            let now = settings.neglected.unwrap_or(coarse.run.domain.neglected);
            // The weights grow a little as the box does; below rounding nothing is gained.
            settings.neglected = Some((now * 0.7 * share / outside).max(1e-18));
        }
    }

    /// The answer, and why finite volumes should be asked instead, if they should.
    fn pursue(&mut self, reason: String) -> Result<(Transient, Option<String>)> {
        let mut settings = self.task.settings.clone();
        // One step of a scheme may take longer than the limit: nobody would look at the clock.
        let seconds = match self.task.work(1.0, 1.0) {
            // The first coarse run tries finer cells.
            Err(error) if is_unfit(&error) && self.free[0] && self.task.way != Way::FlowMap => 0.0,
            it => it?.0,
        };
        let left = settings.max_seconds - self.task.started.elapsed().as_secs_f64();
        if seconds > UNTHINKABLE * left {
            return Err(Error::Limit {
                key: "accuracy.max_seconds",
                limit: format!("{}", settings.max_seconds),
                what: format!("{} would take about {seconds:.0e} s", self.task.name()),
            });
        }
        let (mut coarse, first) = self.coarse(&mut settings)?;
        let task = Task {
            settings: &settings,
            ..self.task
        };
        // The fine run takes 1.5 times as long at least: no use in beginning what cannot end.
        if 2.5 * coarse.run.seconds > settings.max_seconds {
            return Err(Error::Limit {
                key: "accuracy.max_seconds",
                limit: format!("{}", settings.max_seconds),
                what: format!(
                    "the run on four fifths of the cells took {:.1} s, and the fine one would take \
                     {:.0} s or more; fewer method.cells would do",
                    coarse.run.seconds,
                    1.5 * coarse.run.seconds
                ),
            });
        }
        let mut fine = self.level(&task, first, 1.0, 0.9)?;
        let space = self.in_space(self.search.beyond(1.0 / COARSE), 1.0 / COARSE);
        let factor = space.max(self.in_time(self.longer));
        let mut bars = task.bars(&fine.run, &coarse.run, factor);
        bars.joint = self.longer != 1.0;
        let (mut why, mut switch) = ((String::new(), false), None);
        loop {
            match self.next(&task, &mut bars, &fine, &coarse) {
                Ok(Next::Done) => break,
                Ok(Next::Stop(text, free)) => {
                    why = (text, free);
                    break;
                }
                Ok(Next::Switch(text)) => {
                    why = (text.clone(), true);
                    switch = Some(text);
                    break;
                }
                Ok(Next::Level(next)) => {
                    bars = self.refined_bars(&task, &next, &fine, bars);
                    coarse = std::mem::replace(&mut fine, *next);
                    self.rounds += 1;
                }
                // The best so far stands.
                Err(error @ (Error::Limit { .. } | Error::Mesh { .. } | Error::Invalid { .. })) => {
                    why = (format!("a finer run ended early: {error}"), true);
                    break;
                }
                Err(error) => return Err(error),
            }
        }
        let reason = match self.rounds {
            0 => reason,
            rounds => format!("{reason}; refined {rounds} times"),
        };
        let answer = task.report(fine.run, &coarse.run, &bars, reason, why, Vec::new());
        Ok((answer, switch))
    }

    /// The bars of `next`, finer than `fine`, whose bars were `before`.
    fn refined_bars(&mut self, task: &Task, next: &Level, fine: &Level, before: Bars) -> Bars {
        let mut bars = task.bars(&next.run, &fine.run, 1.0);
        let (ratio, cut) = (next.finer / fine.finer, fine.longer / next.longer);
        if cut == 1.0 {
            let believed = self.search.seen(bars.worst_space(), next, fine);
            bars.scale_space(self.in_space(believed, ratio));
            (bars.time, bars.joint) = (before.time, false);
            return bars;
        }
        let space = if ratio > 1.0 {
            self.in_space(self.search.beyond(ratio), ratio)
        } else {
            0.0
        };
        bars.scale_space(space.max(self.in_time(cut)));
        if ratio == 1.0 {
            bars.time = std::mem::replace(&mut bars.space, before.space);
            bars.joint = false;
        }
        bars
    }

    /// What to do after two runs.
    fn next(&mut self, task: &Task, bars: &mut Bars, fine: &Level, coarse: &Level) -> Result<Next> {
        let settings = task.settings;
        if bars.worst(&fine.run).0 <= settings.tolerance {
            return Ok(Next::Done);
        }
        if self.free == [false; 2] {
            let text = "cells and step are those of the scene";
            return Ok(Next::Stop(text.into(), false));
        }
        let goal = (settings.tolerance - bars.worst_fixed()).max(0.25 * settings.tolerance);
        let ratio = fine.finer / coarse.finer;
        let unseen = bars.joint || self.rounds == 0;
        if bars.joint {
            // Which of the two is it? The coarse mesh with the short steps tells. Each pass of a flow
            // map adds an error of the mesh, so that the part of the steps holds some of it.
            let between = self.level(task, coarse.finer, fine.longer, 0.3)?;
            let cut = self.in_time(coarse.longer / fine.longer);
            let space = self.in_space(self.search.beyond(ratio), ratio);
            bars.time = bars::differences(&between.run, &coarse.run, cut, &self.scales);
            bars.space = bars::differences(&fine.run, &between.run, space, &self.scales);
            bars.joint = false;
            if bars.worst(&fine.run).0 <= settings.tolerance {
                return Ok(Next::Done);
            }
        }
        let (space, time) = (bars.worst_space(), bars.worst_time());
        let (mut finer, mut shorter) = (1.0, 1.0);
        if self.free[0] && space > SPACE_SHARE * goal {
            if ratio > 1.0 && unseen {
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
            let (text, free) = match self.free {
                [true, true] => ("neither cells nor steps are what it lacks", true),
                [true, false] => ("method.step is that of the scene", false),
                [false, _] => ("method.cells is that of the scene", false),
            };
            return Ok(Next::Stop(text.into(), free));
        }
        if self.rounds >= 3 && self.search.stalled() {
            let text = "finer meshes change it no more: that is rounding".to_string();
            return Ok(Next::Stop(text, true));
        }
        self.afford(task, (finer, shorter), fine, space / goal)
    }

    /// The next run, if there is time and memory for it and for what it should lead to; `short` is the
    /// part of the mesh over what it may be.
    fn afford(
        &self,
        task: &Task,
        (finer, shorter): (f64, f64),
        fine: &Level,
        short: f64,
    ) -> Result<Next> {
        let settings = task.settings;
        let left = settings.max_seconds - task.started.elapsed().as_secs_f64();
        let work = |finer: f64, shorter: f64| -> Result<(f64, f64)> {
            task.work(fine.finer * finer, fine.longer / shorter)
        };
        let (now, _) = work(1.0, 1.0)?;
        let speed = fine.run.seconds / now;
        let likely = self.search.needed(short, LIKELY).max(finer);
        if let Some((volumes, _)) = self.volumes
            && let Ok((seconds, memory)) = volumes.work(1.0, 1.0)
            && memory <= settings.max_memory as f64
        {
            // Both as foreseen: what is chosen must not depend on what else the machine does.
            let here = work(likely, shorter)?.0;
            // A coarse run, a fine one and another, 1.8 times as fine.
            let there = 8.0 * seconds;
            if here > there && there < left {
                let text = format!(
                    "the flow map on {likely:.1} times finer cells would take about {here:.1} s, finite \
                     volumes {there:.1} s"
                );
                return Ok(Next::Switch(text));
            }
        }
        let hoped = self.search.needed(short, HOPED).max(finer.min(1.2));
        for (finer, what) in [(finer, "the next refinement"), (hoped, "reaching it")] {
            let (next, memory) = work(finer, shorter)?;
            if memory > settings.max_memory as f64 {
                let text = format!(
                    "{what} would need about {:.1e} bytes, and accuracy.max_memory = {:.1e}",
                    memory, settings.max_memory as f64
                );
                return Ok(Next::Stop(text, true));
            }
            let seconds = next * speed;
            if seconds > left {
                let text = format!(
                    "{what} would take about {seconds:.1e} s, and {:.1e} s are left of \
                     accuracy.max_seconds",
                    left.max(0.0)
                );
                return Ok(Next::Stop(text, true));
            }
        }
        self.level(task, fine.finer * finer, fine.longer / shorter, 0.75)
            .map(|level| Next::Level(Box::new(level)))
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
    fn new(way: Way, contact: &ContactLaw) -> Self {
        Self {
            believed: bars::believed(way, contact),
            expected: expected(way),
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
        bars::beyond(ratio, (seen - 1.0).min(TRUSTED).max(self.believed))
    }
}
