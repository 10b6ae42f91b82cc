//! From a tolerance to cells and steps: runs are refined where their errors are too large, each fine run
//! the coarse one of the next, until every bar is within the tolerance or a limit says stop.

use super::bars::{self, Bars, beyond};
use super::choice::{self, Settings, TimeScheme, Way};
use super::domain::Domain;
use super::transient::{Run, Task, Transient};
use crate::error::{Error, Result};
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use crate::scales::Scales;

/// Part of the tolerance that the box may take: it costs a few cells to make it small.
const BOX_SHARE: f64 = 0.2;

/// Parts of what the box leaves that mesh and steps aim at once they are refined: the bars of a new run
/// come out up to twice as large as foreseen.
const SPACE_SHARE: f64 = 0.4;
const TIME_SHARE: f64 = 0.3;

/// Cells of the coarse run over those of the fine one.
const COARSE: f64 = 0.75;

/// Refinements of the mesh considered, over the finest so far: below the first two meshes are too much
/// alike to measure anything, beyond the last too little is learnt for the price.
const FINER: [f64; 6] = [1.2, 1.3, 1.45, 1.6, 1.8, 2.0];

/// Order in space expected before any was seen, and the best hoped for before a limit is believed.
const EXPECTED: f64 = 3.0;
const HOPED: f64 = 8.0;

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
    for _ in 0..6 {
        let domain = Domain::closed(oscillator, initial, outside)?;
        let weights = domain.tail_weights(oscillator);
        let part = domain.neglected * weights.into_iter().fold(0.0, f64::max);
        if part <= share {
            break;
        }
        // The weights grow a little as the box does.
        outside *= 0.8 * share / part;
    }
    Ok(outside)
}

/// Steps of a coarse run over those of the fine one, and the order in time that is relied on: steps of
/// the flow map err by zeta^2 tau^2 and less, other steps choose themselves by their error.
fn steps(way: Way) -> (f64, f64) {
    match way {
        Way::Volumes(TimeScheme::BackwardEuler) => (2.0, 0.9),
        Way::Volumes(_) | Way::FlowMap => (1.5, 2.0),
    }
}

/// A run with its cells and steps, over the first guess.
struct Level {
    finer: f64,
    longer: f64,
    run: Run,
}

/// Solves the task to its tolerance, or as far as its limits allow.
///
/// # Errors
/// Those of the first two runs; later ones end the refinement.
#[expect(clippy::too_many_lines, reason = "one loop over one state")]
pub(super) fn refined(
    task: &Task,
    reason: String,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Transient> {
    let settings = task.settings;
    let scales = Scales::of(task.oscillator);
    let (longer, order) = steps(task.way);
    let in_time = |ratio: f64| 1.0 / (ratio.powf(order) - 1.0);
    let done = std::cell::Cell::new(0.0);
    // Each run is expected to take three quarters of what is left.
    let level = |finer: f64, longer: f64, part: f64| -> Result<Level> {
        let before: f64 = done.get();
        let left = 1.0 - before;
        let run = task.run((finer, longer), task.times, &|x| {
            progress(before + part * left * x)
        })?;
        done.set(before + part * left);
        Ok(Level { finer, longer, run })
    };
    let mut coarse = level(COARSE, longer, 0.3)?;
    // The fine run takes 1.5 times as long at least: no use in beginning what cannot end.
    if 2.5 * coarse.run.seconds > settings.max_seconds {
        return Err(Error::Limit {
            key: "accuracy.max_seconds",
            limit: format!("{}", settings.max_seconds),
            what: format!(
                "the run on three quarters of the cells took {:.1} s, and the fine one would take {:.0} s or \
                 more; fewer method.cells would do",
                coarse.run.seconds,
                1.5 * coarse.run.seconds
            ),
        });
    }
    let mut fine = level(1.0, 1.0, 0.9)?;
    let mut bars = task.bars(
        &fine.run,
        &coarse.run,
        beyond(1.0 / COARSE).max(in_time(longer)),
    );
    let (space_free, time_free) = (settings.cells.is_none(), settings.step.is_none());
    let mut search = Search::new();
    let (mut rounds, mut why) = (0, (String::new(), false));
    loop {
        let (worst, ..) = bars.worst(&fine.run);
        if worst <= settings.tolerance {
            break;
        }
        if !space_free && !time_free {
            why = ("cells and step are those of the scene".into(), false);
            break;
        }
        let attempt = |bars: &mut Bars, search: &mut Search| -> Result<Next> {
            // Where the box takes all of it, mesh and steps still aim at something.
            let goal =
                (settings.tolerance - bars.worst_outside()).max(BOX_SHARE * settings.tolerance);
            let ratio = fine.finer / coarse.finer;
            if bars.joint {
                // Which of the two is it? The coarse mesh with the short steps tells. Each pass of a flow
                // map adds an error of the mesh, so that the part of the steps holds some of it.
                let between = level(coarse.finer, fine.longer, 0.3)?;
                let cut = in_time(coarse.longer / fine.longer);
                bars.time = bars::differences(&between.run, &coarse.run, cut, &scales);
                bars.space = bars::differences(&fine.run, &between.run, beyond(ratio), &scales);
                bars.joint = false;
                if bars.worst(&fine.run).0 <= settings.tolerance {
                    return Ok(Next::Done);
                }
            }
            let (space, time) = (bars.worst_space(), bars.worst_time());
            let (mut finer, mut shorter) = (1.0, 1.0);
            if space_free && space > SPACE_SHARE * goal {
                search.seen(space / beyond(ratio), &fine, &coarse);
                finer = search.finer(space, SPACE_SHARE * goal, ratio);
            }
            if time_free && time > TIME_SHARE * goal {
                // Not much shorter than the cells allow: short passes of a flow map damp nothing.
                let wanted = (time / (TIME_SHARE * goal)).powf(1.0 / order);
                shorter = wanted.clamp(1.25, if finer > 1.0 { finer.max(1.25) } else { 2.0 });
            }
            if finer == 1.0 && shorter == 1.0 {
                // Nothing is fixed: the box, or a bar that is no number, of which refinement knows nothing.
                let (text, free) = match (space_free, time_free) {
                    (true, true) => ("neither cells nor steps are what it lacks", true),
                    (true, false) => ("method.step is that of the scene", false),
                    (false, _) => ("method.cells is that of the scene", false),
                };
                return Ok(Next::Stop(text.into(), free));
            }
            if rounds >= 3 && search.stalled() {
                let text = "finer meshes change it no more: that is rounding".to_string();
                return Ok(Next::Stop(text, true));
            }
            // What the next run will take, and what the last one would.
            let left = settings.max_seconds - task.started.elapsed().as_secs_f64();
            let work = |finer: f64, shorter: f64| -> Result<(f64, f64)> {
                task.work(fine.finer * finer, fine.longer / shorter)
            };
            let (now, _) = work(1.0, 1.0)?;
            let speed = fine.run.seconds / now;
            let hoped = search.hoped(space, goal).max(finer.min(1.2));
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
            level(fine.finer * finer, fine.longer / shorter, 0.75)
                .map(|level| Next::Level(Box::new(level)))
        };
        match attempt(&mut bars, &mut search) {
            Ok(Next::Done) => break,
            Ok(Next::Stop(text, free)) => {
                why = (text, free);
                break;
            }
            Ok(Next::Level(next)) => {
                let before = bars;
                bars = task.bars(&next.run, &fine.run, 1.0);
                let (ratio, cut) = (next.finer / fine.finer, fine.longer / next.longer);
                let space = if ratio > 1.0 { beyond(ratio) } else { 0.0 };
                let time = if cut > 1.0 { in_time(cut) } else { 0.0 };
                let all = bars::differences(&next.run, &fine.run, space.max(time), &scales);
                (bars.space, bars.time, bars.joint) = if cut == 1.0 {
                    (all, before.time, false)
                } else if ratio == 1.0 {
                    (before.space, all, false)
                } else {
                    let none = vec![[0.0; 11]; all.len()];
                    (all, none, true)
                };
                coarse = std::mem::replace(&mut fine, *next);
                rounds += 1;
            }
            // The best so far stands.
            Err(error @ (Error::Limit { .. } | Error::Mesh { .. } | Error::Invalid { .. })) => {
                why = (format!("a finer run ended early: {error}"), true);
                break;
            }
            Err(error) => return Err(error),
        }
    }
    let reason = if rounds > 0 {
        format!("{reason}; refined {rounds} times")
    } else {
        reason
    };
    Ok(task.report(fine.run, &coarse.run, &bars, reason, why, Vec::new()))
}

/// What to do next.
enum Next {
    /// The bars are within the tolerance.
    Done,
    /// No further, and whether the program was free to go further.
    Stop(String, bool),
    /// A finer run.
    Level(Box<Level>),
}

/// What refining the mesh has shown so far.
struct Search {
    /// Differences and the resolutions they lie between: coarse, fine.
    seen: Vec<(f64, f64, f64)>,
}

impl Search {
    fn new() -> Self {
        Self { seen: Vec::new() }
    }

    fn seen(&mut self, difference: f64, fine: &Level, coarse: &Level) {
        self.seen.push((difference, coarse.finer, fine.finer));
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
        let order = self.order().unwrap_or(EXPECTED);
        let error = bar / beyond(last) / (last.powf(order) - 1.0);
        let foreseen = |finer: f64| beyond(finer) * error * (1.0 - finer.powf(-order));
        let enough = FINER.into_iter().find(|finer| foreseen(*finer) <= goal);
        enough.unwrap_or(FINER[FINER.len() - 1])
    }

    /// How much finer the mesh must be at least.
    fn hoped(&self, bar: f64, goal: f64) -> f64 {
        let order = self.order().unwrap_or(HOPED).max(LIKELY);
        (bar / goal).max(1.0).powf(1.0 / order)
    }
}
