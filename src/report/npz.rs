//! NumPy archives: arrays by their names, in C order, as numpy.load reads them.

use super::File;
use crate::error::{Error, Result};
use crate::estimate::Estimate;
use crate::fokker_planck::Snapshot;
use crate::results::Results;
use crate::rig::Rig;
use ndarray::{ArrayD, IxDyn};
use ndarray_npy::{NpzWriter, WriteNpzError};
use std::io::Cursor;

/// An array: its name, its shape, its numbers in C order.
pub type Array = (String, Vec<usize>, Vec<f64>);

/// One of one dimension.
pub(crate) fn vector(name: impl Into<String>, numbers: impl IntoIterator<Item = f64>) -> Array {
    let numbers = Vec::from_iter(numbers);
    (name.into(), vec![numbers.len()], numbers)
}

/// One of none.
fn scalar(name: impl Into<String>, number: f64) -> Array {
    (name.into(), Vec::new(), vec![number])
}

/// Values and errors by their names, times `scale`.
pub(super) fn with_errors<N: Into<String>>(
    [values, errors]: [N; 2],
    all: &[Estimate],
    scale: f64,
) -> [Array; 2] {
    [
        vector(values, all.iter().map(|it| it.value * scale)),
        vector(errors, all.iter().map(|it| it.error * scale)),
    ]
}

/// The file of some arrays.
///
/// # Errors
/// [`Error::Io`] for an array whose shape is not that of its numbers.
pub fn archive(name: &str, arrays: impl IntoIterator<Item = Array>) -> Result<File> {
    let bytes = || {
        let mut npz = NpzWriter::new_compressed(Cursor::new(Vec::new()));
        for (name, shape, numbers) in arrays {
            let array = ArrayD::from_shape_vec(IxDyn(&shape), numbers);
            let array = array.map_err(|error| {
                WriteNpzError::Npy(std::io::Error::other(error.to_string()).into())
            })?;
            npz.add_array(name, &array)?;
        }
        Ok(npz.finish()?.into_inner())
    };
    bytes()
        .map(|bytes| File {
            name: name.into(),
            bytes,
        })
        .map_err(|error: WriteNpzError| Error::unmade(name, error))
}

/// p\[q, v\] with its time and axes.
pub(super) fn density(name: &str, it: &Snapshot, rig: Option<&Rig>) -> Result<File> {
    let p = (
        "p".into(),
        it.p.shape().to_vec(),
        it.p.iter().copied().collect(),
    );
    let own = [p, scalar("t", it.t)];
    archive(name, own.into_iter().chain(axes(it, rig)))
}

/// Densities of several times on one mesh, as p[t, q, v].
pub(super) fn stacked(name: &str, all: &[Snapshot], rig: Option<&Rig>) -> Result<File> {
    let Some(first) = all.first() else {
        return archive(name, []);
    };
    let shape = [&[all.len()], first.p.shape()].concat();
    let p = all.iter().flat_map(|it| it.p.iter().copied()).collect();
    let times = vector("t", all.iter().map(|it| it.t));
    let own = [("p".into(), shape, p), times];
    archive(name, own.into_iter().chain(axes(first, rig)))
}

/// The axes of a density; on a rig in micrometres and millimetres per second too.
fn axes(it: &Snapshot, rig: Option<&Rig>) -> Vec<Array> {
    let mut axes = vec![vector("q", it.q.clone()), vector("v", it.v.clone())];
    if let Some(rig) = rig {
        axes.push(vector("q_um", &it.q * rig.micrometres()));
        axes.push(vector("v_mm_per_s", &it.v * rig.millimetres_per_second()));
    }
    axes
}

/// t, and each curve and number with its error; on a rig times and densities of a time with seconds too.
pub(super) fn arrays(
    name: &str,
    results: &Results,
    times: &[f64],
    curves: &[(&str, &[Estimate])],
    numbers: &[(&str, Estimate)],
) -> Result<File> {
    let scene = &results.scene;
    let seconds = scene.rig().map(|rig| scene.clock().seconds(&rig));
    let mut all = vec![vector("t", times.iter().copied())];
    if let Some(seconds) = seconds {
        all.push(vector("t_s", times.iter().map(|t| t * seconds)));
    }
    for &(name, curve) in curves {
        let with_error = |name: &str| [name.to_owned(), format!("{name}_error")];
        all.extend(with_errors(with_error(name), curve, 1.0));
        if let Some(seconds) = seconds.filter(|_| name == "density") {
            all.extend(with_errors(
                with_error("density_per_s"),
                curve,
                1.0 / seconds,
            ));
        }
    }
    for (name, number) in numbers {
        all.push(scalar(*name, number.value));
        all.push(scalar(format!("{name}_error"), number.error));
    }
    archive(name, all)
}
