//! Results.

use crate::error;
use ndarray::{Array1, Array2};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyBytes;
use pythonize::pythonize;
use std::path::PathBuf;
use vibroimpact::fokker_planck::Snapshot;
use vibroimpact::report::folder::{Existing, Folder};
use vibroimpact::report::{self, File, terminal};

/// What a run answers. It never changes: arrays look into it.
#[pyclass(frozen, module = "vibroimpact._native")]
pub(crate) struct Results {
    results: vibroimpact::results::Results,
}

impl Results {
    pub(crate) fn new(results: vibroimpact::results::Results) -> Self {
        Self { results }
    }

    /// The densities asked for, then the steady one.
    fn snapshots(&self) -> impl Iterator<Item = &Snapshot> {
        let transient = self.results.transient.iter();
        let steady = self.results.steady.iter();
        transient
            .flat_map(|it| &it.densities)
            .chain(steady.map(|it| &it.density))
    }
}

type Axis<'py> = Bound<'py, PyArray1<f64>>;

#[pymethods]
impl Results {
    /// results.json as plain values.
    fn tree<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize(py, &self.results.tree())?)
    }

    /// As the program prints it.
    fn table(&self) -> String {
        terminal::table(&self.results, false)
    }

    /// Table and pictures as a piece of HTML.
    fn html(&self, py: Python<'_>) -> PyResult<String> {
        let html = py.detach(|| report::fragment(&self.results));
        html.map_err(|wrong| error::of(py, &wrong))
    }

    /// Name and bytes of every file that the program writes.
    fn files<'py>(&self, py: Python<'py>) -> PyResult<Vec<(String, Bound<'py, PyBytes>)>> {
        let files = py.detach(|| report::all(&self.results));
        let files = files.map_err(|wrong| error::of(py, &wrong))?;
        let bytes = |it: File| (it.name, PyBytes::new(py, &it.bytes));
        Ok(files.into_iter().map(bytes).collect())
    }

    /// What a deterministic number that the program was free to refine lacks of the tolerance.
    fn shortfalls(&self) -> Vec<String> {
        let all = self.results.shortfalls.iter().filter(|(_, it)| it.free);
        all.map(|(stage, it)| format!("{stage}: {it}")).collect()
    }

    /// The times of the densities, the infinite one last.
    fn times(&self) -> Vec<f64> {
        self.snapshots().map(|it| it.t).collect()
    }

    /// p[q, v], q and v of the density at that place in `times`: no copies.
    #[allow(clippy::type_complexity)] // Three arrays.
    fn density<'py>(
        it: &Bound<'py, Self>,
        place: usize,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Axis<'py>, Axis<'py>)> {
        let own = it.get();
        let Some(found) = own.snapshots().nth(place) else {
            return Err(PyIndexError::new_err(place));
        };
        let axis = |values: &Array1<f64>| {
            // SAFETY: as below.
            let array = unsafe { PyArray1::borrow_from_array(values, it.clone().into_any()) };
            array.readwrite().make_nonwriteable();
            array
        };
        let (q, v) = (axis(&found.q), axis(&found.v));
        let plane: &Array2<f64> = &found.p;
        // SAFETY: the array keeps `it` alive, whose class is frozen and hands out no reference that writes; the
        // array itself is made read-only before anybody sees it.
        let p = unsafe { PyArray2::borrow_from_array(plane, it.clone().into_any()) };
        p.readwrite().make_nonwriteable();
        Ok((p, q, v))
    }
}

/// What to do with a folder that exists.
pub(crate) fn existing(force: bool) -> Existing {
    if force {
        Existing::Force
    } else {
        Existing::Refuse
    }
}

/// Writes files into a folder: each appears whole or not at all.
#[pyfunction]
pub(crate) fn save(
    py: Python<'_>,
    folder: PathBuf,
    files: Vec<(String, PyBackedBytes)>,
    force: bool,
) -> PyResult<()> {
    let files = files.into_iter().map(|(name, bytes)| File {
        name,
        bytes: bytes.to_vec(),
    });
    let files: Vec<File> = files.collect();
    let written = py.detach(|| Folder::open(&folder, existing(force))?.write(&files));
    written.map_err(|wrong| error::of(py, &wrong))
}
