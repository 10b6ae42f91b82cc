//! What the Python package `vibroimpact` takes from the library: scenes, plans, runs and the program. How it looks to
//! Python stands in the package's own files, which wrap this module.

mod error;
mod map;
mod plan;
mod pool;
mod results;
mod run;
mod scene;
mod tree;

use pyo3::prelude::*;
use std::ffi::OsString;

/// The program on a command line, its own name first; the exit status.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| vibroimpact::cli::main(arguments))
}

/// The native half of the package.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<plan::Plan>()?;
    module.add_class::<results::Results>()?;
    module.add_function(wrap_pyfunction!(scene::built_in, module)?)?;
    module.add_function(wrap_pyfunction!(plan::plan, module)?)?;
    module.add_function(wrap_pyfunction!(run::run, module)?)?;
    module.add_class::<map::Map>()?;
    module.add_function(wrap_pyfunction!(map::map, module)?)?;
    module.add_function(wrap_pyfunction!(results::save, module)?)?;
    module.add_function(wrap_pyfunction!(main, module)?)
}
