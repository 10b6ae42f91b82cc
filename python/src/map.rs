//! Maps: a scene at every point of a grid.

use crate::error;
use crate::pool;
use crate::run;
use crate::scene::Scene;
use pyo3::prelude::*;
use pythonize::{depythonize, pythonize};
use serde_json::Value;
use std::path::PathBuf;
use vibroimpact::map::{self as library, Axis, MapError, Part, Progress};
use vibroimpact::plan::StopFlag;

/// A scene and the axes that are laid over it.
#[pyclass(frozen, module = "vibroimpact._native")]
pub(crate) struct Map {
    map: library::Map,
}

/// Stops between points, and tells how many are done.
struct Observer(run::Observer);

impl library::Watch for Observer {
    fn progress(&self, progress: &Progress) {
        let points = progress.points.max(1) as f64;
        self.0.tell("map", progress.computed as f64 / points);
    }

    fn stops(&self) -> bool {
        self.0.stop.raised()
    }
}

fn raised(py: Python<'_>, wrong: &MapError) -> PyErr {
    match wrong {
        MapError::Scene(wrong) => error::scene(py, wrong),
        MapError::Other(wrong) => error::of(py, wrong),
    }
}

#[pymethods]
impl Map {
    fn __len__(&self) -> usize {
        self.map.len()
    }

    /// Key and values of every axis, the first running slowest.
    fn axes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let axes = self.map.axes().iter();
        let axes: Vec<(&str, &[Value])> = axes.map(|it| (it.key(), it.values())).collect();
        Ok(pythonize(py, &axes)?)
    }

    /// The line of a point, as JSON.
    fn line(&self, py: Python<'_>, index: usize, threads: Option<usize>) -> PyResult<String> {
        let map = self.map.clone();
        let job = move || map.line(index);
        let line = pool::compute(py, threads, &StopFlag::default(), |_| Ok(()), job)?;
        line.map_err(|wrong| raised(py, &wrong))
    }

    /// All lines into a folder, one point on each thread at a time.
    fn run(
        &self,
        py: Python<'_>,
        folder: PathBuf,
        threads: usize,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let observer = run::Observer::default();
        let (map, watch) = (self.map.clone(), Observer(observer.clone()));
        let job = move || {
            let all = Part::new(1, 1)?;
            map.run(all, &folder, threads, false, &watch).map(drop)
        };
        // The work makes threads of its own, and this one waits for them.
        let tell = |_: Python<'_>| observer.hand_on(progress);
        let ended = pool::compute(py, Some(1), &observer.stop, tell, job)?;
        ended.map_err(|wrong| raised(py, &wrong))
    }
}

/// The map of a scene with axes over it: each a key and its values, or a range as text.
#[pyfunction]
pub(crate) fn map(
    py: Python<'_>,
    scene: &Scene,
    over: Vec<(String, Bound<'_, PyAny>)>,
    keep: Vec<String>,
) -> PyResult<Map> {
    let axis = |(key, values): (String, Bound<'_, PyAny>)| {
        let axis = match values.extract::<String>() {
            Ok(range) => Axis::parse(&format!("{key}={range}")),
            Err(_) => Axis::list(&key, depythonize::<Vec<Value>>(&values)?),
        };
        axis.map_err(|wrong| error::of(py, &wrong))
    };
    let axes: Vec<Axis> = over.into_iter().map(axis).collect::<PyResult<_>>()?;
    let (name, text, set) = scene.source();
    let job = move || library::Map::of(&name, &text, &set, axes, keep);
    let made = pool::compute(py, None, &StopFlag::default(), |_| Ok(()), job)?;
    match made {
        Ok(map) => Ok(Map { map }),
        Err(wrong) => Err(raised(py, &wrong)),
    }
}
