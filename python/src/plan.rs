//! Plans.

use crate::error;
use crate::pool;
use crate::scene::Scene;
use pyo3::prelude::*;
use pythonize::pythonize;
use serde_json::json;
use vibroimpact::plan::{self as library, StopFlag};
use vibroimpact::report::terminal;

/// What would be computed.
#[pyclass(frozen, module = "vibroimpact._native")]
pub(crate) struct Plan {
    pub(crate) plan: library::Plan,
}

#[pymethods]
impl Plan {
    /// The stages in the order they run, each as plain values.
    fn stages<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let stages = self.plan.stages().iter().map(|it| {
            json!({
                "name": it.part.name(),
                "needed_by": it.needed_by,
                "method": it.method,
                "cells": it.cost.cells,
                "steps": it.cost.steps,
                "memory_bytes": it.memory_bytes(),
                "seconds": it.seconds(),
                "refusal": it.refusal.as_ref().map(|it| it.unanswered().to_string()),
            })
        });
        Ok(pythonize(py, &stages.collect::<Vec<_>>())?)
    }

    /// As `vibroimpact plan` prints it.
    fn __str__(&self) -> String {
        terminal::plan(&self.plan)
    }
}

/// The plan of a scene on so many threads.
#[pyfunction]
pub(crate) fn plan(py: Python<'_>, scene: &Scene, threads: Option<usize>) -> PyResult<Plan> {
    let of = scene.text.scene().clone();
    let job = move || library::Plan::of(&of);
    let plan = pool::compute(py, threads, &StopFlag::default(), |_| Ok(()), job)?;
    match plan {
        Ok(plan) => Ok(Plan { plan }),
        Err(wrong) => Err(error::of_scene(py, &scene.text, &wrong)),
    }
}
