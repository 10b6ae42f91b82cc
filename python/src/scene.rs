//! Scenes.

use crate::error;
use crate::tree::{self, Tree};
use pyo3::prelude::*;
use pythonize::{depythonize, pythonize};
use std::collections::BTreeMap;
use vibroimpact::scene::text::{BUILT_IN, SceneText};

/// A scene with the text it came from. It never changes.
#[pyclass(frozen, module = "vibroimpact._native")]
pub(crate) struct Scene {
    pub(crate) text: SceneText,
    name: String,
    toml: String,
    overrides: Vec<String>,
}

impl Scene {
    /// Its name, its text and what was replaced in it.
    pub(crate) fn source(&self) -> (String, String, Vec<String>) {
        (self.name.clone(), self.toml.clone(), self.overrides.clone())
    }

    fn read(py: Python<'_>, name: String, toml: String, overrides: Vec<String>) -> PyResult<Self> {
        match SceneText::parse(&name, &toml, &overrides) {
            Ok(text) => Ok(Self {
                text,
                name,
                toml,
                overrides,
            }),
            Err(wrong) => Err(error::scene(py, &wrong)),
        }
    }
}

#[pymethods]
impl Scene {
    /// From TOML; `name` stands for it in messages, and without a title it names the scene.
    #[staticmethod]
    fn parse(py: Python<'_>, name: String, text: String) -> PyResult<Self> {
        Self::read(py, name, text, Vec::new())
    }

    /// From plain values: a dict of dicts.
    #[staticmethod]
    fn of(py: Python<'_>, name: String, sections: &Bound<'_, PyAny>) -> PyResult<Self> {
        let sections: BTreeMap<String, Tree> = depythonize(sections)?;
        Self::read(py, name, tree::document(&sections), Vec::new())
    }

    /// The same with one key changed.
    fn replace(&self, py: Python<'_>, key: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let value: Tree = depythonize(value)?;
        let mut overrides = self.overrides.clone();
        overrides.push(format!("{key} = {value}"));
        Self::read(py, self.name.clone(), self.toml.clone(), overrides)
    }

    /// With every default filled in, as plain values.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize(py, &self.text.scene().resolved())?)
    }

    /// With every default filled in, as a scene file.
    fn to_toml(&self) -> String {
        self.text.scene().to_toml()
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.text.scene() == other.text.scene()
    }
}

/// Name and text of every built-in scene.
#[pyfunction]
pub(crate) fn built_in() -> Vec<(&'static str, &'static str)> {
    BUILT_IN.to_vec()
}
