//! Runs.

use crate::error;
use crate::plan::Plan;
use crate::pool;
use crate::results::{self, Results};
use crate::scene::Scene;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use vibroimpact::plan::{self as library, Part, StopFlag, Watch};
use vibroimpact::report;
use vibroimpact::report::folder::Folder;

/// What has happened since somebody asked, as name and fraction of a stage; told from any thread.
#[derive(Clone, Default)]
pub(crate) struct Observer {
    news: Arc<Mutex<Vec<(&'static str, f64)>>>,
    pub(crate) stop: StopFlag,
}

impl Observer {
    pub(crate) fn tell(&self, name: &'static str, fraction: f64) {
        let Ok(mut news) = self.news.lock() else {
            return;
        };
        match news.last_mut() {
            // Of one stage the latest is enough, and none runs backwards.
            Some((last, done)) if *last == name => *done = done.max(fraction),
            _ => news.push((name, fraction)),
        }
    }

    fn news(&self) -> Vec<(&'static str, f64)> {
        let news = self.news.lock();
        news.map_or_else(|_| Vec::new(), |mut it| std::mem::take(&mut *it))
    }

    /// Tells a Python function the news.
    pub(crate) fn hand_on(&self, progress: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let Some(progress) = progress else {
            return Ok(());
        };
        let mut news = self.news().into_iter();
        news.try_for_each(|it| progress.call1(it).map(drop))
    }
}

impl Watch for Observer {
    fn begins(&self, part: Part) {
        self.tell(part.name(), 0.0);
    }

    fn progress(&self, part: Part, fraction: f64) {
        self.tell(part.name(), fraction.clamp(0.0, 1.0));
    }

    fn ends(&self, part: Part, _: &vibroimpact::results::Results) -> vibroimpact::Result<()> {
        self.tell(part.name(), 1.0);
        Ok(())
    }

    fn stop(&self) -> StopFlag {
        self.stop.clone()
    }
}

/// Runs a scene, by its plan if there is one already; `progress` is called with name and fraction of a stage, `out` gets the files of each stage as it ends.
#[pyfunction]
#[pyo3(signature = (scene, plan, threads, progress, out, force))]
pub(crate) fn run(
    py: Python<'_>,
    scene: &Scene,
    plan: Option<&Plan>,
    threads: Option<usize>,
    progress: Option<&Bound<'_, PyAny>>,
    out: Option<PathBuf>,
    force: bool,
) -> PyResult<Results> {
    let observer = Observer::default();
    let made = plan.map(|it| it.plan.clone());
    let (own, watch) = (scene.text.scene().clone(), observer.clone());
    let job = move || {
        let plan = made.map_or_else(|| library::Plan::of(&own), Ok)?;
        let Some(path) = out else {
            return plan.run(&watch);
        };
        let folder = Folder::open(&path, results::existing(force))?;
        report::run_into(&plan, folder, &watch)
    };
    let tell = |_: Python<'_>| observer.hand_on(progress);
    match pool::compute(py, threads, &observer.stop, tell, job)? {
        Ok(results) => Ok(Results::new(results)),
        Err(wrong) => Err(error::of_scene(py, &scene.text, &wrong)),
    }
}
