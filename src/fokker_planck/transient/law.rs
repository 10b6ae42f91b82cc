//! The stationary law that a transient's distances are taken to, where it has to be solved for.

use super::run::Task;
use crate::error::{Deadline, Error, Result};
use crate::fokker_planck::policy::SETTLED_LAW_SHARE;
use crate::fokker_planck::solved::{Approach, FARTHEST, Settled};
use crate::initial::Initial;

/// The law as near as the answer asks, with s its share of the tolerance: to an L1 error of s times the tolerance where the run
/// begins in it or comes that close to it, else of s^2 times the nearest distance. Where only distances are taken to it, no
/// mesh and no resolution in functions beyond the first two takes longer than the run at the expected rung. None where nothing asks for
/// it, or where it is not found and only distances would be taken to it.
///
/// # Errors
/// Those of the law and of the limits; a run that begins in a law cannot do without.
pub(super) fn law(task: &Task, late: &Deadline) -> Result<Option<Settled>> {
    let (oscillator, recipe) = (task.oscillator, task.recipe);
    let begins = *task.initial == Initial::Stationary;
    if oscillator.damping().has_closed_form() && begins {
        oscillator.with_closed_form()?;
    }
    if !recipe.asks_for_law(oscillator, task.initial) {
        return Ok(None);
    }
    if begins {
        return Settled::within(oscillator, recipe.tolerance, late, task.limits.memory).map(Some);
    }
    // Of one thread: how many there are has no say in what is found.
    let rung = task.rung(recipe.expected);
    let run = rung.and_then(|rung| task.work(&rung, task.times));
    let most = (task.limits.memory, run.map_or(0.0, |it| it.seconds));
    let mut approach = Approach::new(oscillator, late, most);
    let mut within = |tolerance| match approach.within(tolerance) {
        Err(Error::Unresolved { .. } | Error::Linear { .. }) => Ok(None),
        law => law.map(Some),
    };
    let share = SETTLED_LAW_SHARE.get();
    let asked = |distance: f64| recipe.tolerance.max(share * distance);
    let Some(rough) = within(asked(FARTHEST))? else {
        return Ok(None);
    };
    // Nearer than asked for, or no resolution came even that near.
    if rough.error <= share * recipe.tolerance || rough.error > share * asked(FARTHEST) {
        return Ok(Some(rough));
    }
    // Distances only fall: the last one of the coarsest run tells how near this one comes, if that has an answer.
    let looking = Task {
        law: Some(&rough),
        density_times: &[],
        ..*task
    };
    let looked = looking.rung(recipe.first_rung()).and_then(|rung| {
        let run = looking.once(&rung, &[task.until()], &|_| ())?;
        let last = run.outputs.last().filter(|_| !run.is_none());
        Ok(last.map_or(0.0, |it| it.distance - it.lost) - rung.tolerance)
    });
    let goal = asked(looked.map_or(0.0, |it| it - rough.error));
    if rough.error <= share * goal {
        return Ok(Some(rough));
    }
    within(goal)
}
