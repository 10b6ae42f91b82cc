//! A run that leaves its files in a folder as it goes.

use super::folder::Folder;
use super::manifest;
use crate::error::{Error, Result};
use crate::plan::{Part, Plan, StopFlag, Watch};
use crate::results::Results;
use crate::scene::Scene;
use std::sync::atomic::{AtomicBool, Ordering};

/// Run every stage of a plan, each stage's files in `folder` as soon as it has ended: what `vibroimpact run --out` does.
/// A scene that is refused before its first stage has ended leaves nothing behind.
///
/// # Errors
/// Those of [`Plan::run`] and of [`Folder::write`]; files of finished stages stay, with a page of them.
pub fn run_into(plan: &Plan, folder: Folder, watch: &dyn Watch) -> Result<Results> {
    folder.write(&manifest::at_the_start(plan.scene()))?;
    let writer = Writer {
        folder: &folder,
        watch,
        stop: watch.stop(),
        ended: AtomicBool::new(false),
    };
    let mut results = Results::empty(plan.scene());
    let ran = plan.run_on(&mut results, &writer);
    let ended = writer.ended.into_inner();
    match ran {
        Ok(()) => {
            folder.write(&manifest::at_the_end(&results)?)?;
            Ok(results)
        }
        Err(error) => {
            if error.is_refusal() && !ended {
                folder.discard();
            } else if !matches!(error, Error::Io { .. }) {
                // A page of what had ended, and why there is no more.
                results.run.warnings.extend(plan.left_after(&results));
                results.run.warnings.push(error.to_string().into());
                folder.write(&manifest::at_the_end(&results)?)?;
            }
            Err(error)
        }
    }
}

/// What is left in `folder` of a scene none of whose stages fits its limits: results without numbers, marked, in place of what a
/// run before it may have left there.
///
/// # Errors
/// Those of [`Folder::write`].
pub fn unanswered_into(scene: &Scene, folder: &Folder, error: &Error) -> Result<()> {
    folder.write(&manifest::at_the_start(scene))?;
    let mut results = Results::empty(scene);
    results.run.warnings.push(error.to_string().into());
    folder.write(&manifest::at_the_end(&results)?)
}

struct Writer<'a> {
    folder: &'a Folder,
    watch: &'a dyn Watch,
    stop: StopFlag,
    /// Whether any stage has ended.
    ended: AtomicBool,
}

impl Watch for Writer<'_> {
    fn begins(&self, part: Part) {
        self.watch.begins(part);
    }

    fn progress(&self, part: Part, fraction: f64) {
        self.watch.progress(part, fraction);
    }

    fn ends(&self, part: Part, results: &Results) -> Result<()> {
        self.watch.ends(part, results)?;
        self.ended.store(true, Ordering::Relaxed);
        self.folder.write(&manifest::after(part, results)?)
    }

    fn stop(&self) -> StopFlag {
        self.stop.clone()
    }
}
