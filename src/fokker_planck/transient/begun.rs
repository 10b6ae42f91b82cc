//! What a stationary initial condition that is solved for does to the numbers of a transient.

use super::error_estimate::{Table, difference, scales};
use super::ladder::is_unfit;
use super::recipe::RUNGS;
use super::run::Task;
use crate::error::Result;
use crate::fokker_planck::layout::STEEPER_TRIES;
use crate::fokker_planck::solved::Settled;
use crate::initial::Initial;

/// What such a law may have done to each number at each time, over its normalisation: a run on the fourth rung that begins in
/// it against one that begins in the next coarser law, times what their difference leaves. Its L1 error for all of them where
/// no mesh near that one holds it; None without such a law.
///
/// # Errors
/// Those of the runs but for meshes that do not hold the scene.
pub(super) fn begun(task: &Task) -> Result<Option<Table>> {
    let begins = *task.initial == Initial::Stationary && task.recipe.period.is_none();
    let Some(law) = task.law.filter(|_| begins) else {
        return Ok(None);
    };
    let (times, recipe) = (task.times, task.recipe);
    // A coarser one adds errors of its own to what the two laws differ by.
    let first = if recipe.layout.is_given() {
        recipe.expected
    } else {
        RUNGS as f64
    };
    let coarser = Settled {
        law: law.coarser.clone(),
        ..law.clone()
    };
    for k in 0..STEEPER_TRIES {
        let one = |law| {
            let rung = task.rung(first + k as f64)?;
            let law = Some(law);
            Task { law, ..*task }.run(&rung, times, &|_| ())
        };
        let both = rayon::join(|| one(law), || one(&coarser));
        match both {
            (Ok(run), Ok(other)) => {
                let scales = scales(task, &run);
                let mut table = difference(task, [&run, &other], &scales);
                for (x, scale) in table.iter_mut().flatten().zip(scales.iter().flatten()) {
                    *x = if *x == 0.0 {
                        0.0
                    } else {
                        law.left * *x / scale
                    };
                }
                return Ok(Some(table));
            }
            (Err(error), _) | (_, Err(error)) if !is_unfit(&error) => return Err(error),
            _ => {}
        }
    }
    Ok(Some(vec![[law.error; 11]; times.len()]))
}
