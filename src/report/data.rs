//! Numbers as files: JSON, CSV with units in the header, NumPy arrays.

use super::File;
use super::csv::{Csv, Rows, micrometre};
use crate::error::{Error, Result};
use crate::estimate::Estimate;
use crate::fokker_planck::{DecayRates, Snapshot, Steady, Transient};
use crate::format::bare;
use crate::moments::{Moment, Moments};
use crate::monte_carlo::{EnsembleResult, Histogram};
use crate::oscillator::Quantity;
use crate::results::{Numbers, Results, SpectrumNumbers, dimension};
use crate::rig::Rig;
use crate::spectrum::{displacement_per_hertz, per_hertz};
use ndarray::{Array1, ArrayD, IxDyn, arr0};
use ndarray_npy::{NpzWriter, WriteNpzError};
use std::io::Cursor;

/// Files of the closed form: its numbers, and p_q, p_v, p_N as curves.
pub(super) fn stationary(results: &Results) -> Option<Vec<File>> {
    let (numbers, law) = (results.stationary.as_ref()?, results.law()?);
    let table = rows(results, "value,error", numbers);
    let t = results.scene.oscillator.temperature();
    let contact = results.contact();
    let (low, high) = contact.turning_points(18.0 * t).unwrap_or((0.0, 0.0));
    let (bottom, top) = (contact.force(low), contact.force(high));
    let q = || grid(low, high);
    let force = || grid(bottom, top);
    let v = || grid(-6.0 * t.sqrt(), 6.0 * t.sqrt());
    let p_q = q().map(|q| law.density_q(q));
    let by_q = Csv::of(results)
        .plain("q", "u", q())
        .plain("p_q", "1/u", p_q);
    let p_force = force().map(|n| law.density_force(n));
    let below = law.distribution_force(&force().collect::<Vec<_>>());
    let by_force = Csv::of(results)
        .plain("N", "F", force())
        .plain("p_N without its Dirac mass", "1/F", p_force)
        .plain("P(N <= this)", "1", below);
    let p_v = v().map(|v| law.density_v(v));
    let by_v = Csv::of(results)
        .plain("v", "u W", v())
        .plain("p_v", "1/(u W)", p_v);
    Some(vec![
        table.file("stationary.csv"),
        by_q.file("stationary_q.csv"),
        by_v.file("stationary_v.csv"),
        by_force.file("stationary_force.csv"),
    ])
}

fn rows(results: &Results, heads: &str, numbers: &Numbers) -> Rows {
    let mut table = Rows::of(results, &[heads]);
    for (name, number) in numbers.iter() {
        table.put(name, dimension(name), &[number]);
    }
    table
}

fn grid(low: f64, high: f64) -> impl Iterator<Item = f64> {
    (0..=400).map(move |k| low + (high - low) * f64::from(k) / 400.0)
}

/// Moments against time; `kind` is that of their errors.
fn moments_csv(results: &Results, times: &[f64], moments: &[Moments], kind: &str) -> Csv {
    let table = Csv::of(results).plain("t", "1/W", times.iter().copied());
    with_moments(table, moments, kind)
}

/// A table with the moments that are there beside its columns.
pub(super) fn with_moments(mut table: Csv, moments: &[Moments], kind: &str) -> Csv {
    let asked = |it: &Moment| !moments.iter().any(|at| at.leaves_out(*it));
    for it in Moment::ALL.into_iter().filter(asked) {
        let values = moments.iter().map(|at| at.get(it));
        table.add(it.name(), kind, dimension(it.name()), values);
    }
    table
}

/// Files of the transient: moments, and the densities asked for.
pub(super) fn transient(results: &Results, it: &Transient) -> Result<Vec<File>> {
    let mut files = Vec::new();
    if !it.times.is_empty() {
        let mut table = moments_csv(results, &it.times, &it.moments, "error")
            .curve("mass", "error", "1", &it.mass)
            .curve("lowest_density", "error", "1/(u^2 W)", &it.lowest_density)
            .curve("negative_mass", "error", "1", &it.negative_mass);
        let entropy = it.relative_entropy.iter().copied();
        table.add("relative_entropy", "error", "1", entropy);
        table.add("l1_distance", "error", "1", it.distance.iter().copied());
        files.push(table.file("moments.csv"));
    }
    for snapshot in &it.densities {
        let name = format!("density_{}.npz", bare(snapshot.t));
        files.push(density(name, snapshot, results.scene.rig().as_ref())?);
    }
    Ok(files)
}

pub(super) fn steady(results: &Results, it: &Steady) -> Result<Vec<File>> {
    let rig = results.scene.rig();
    let rig = rig.as_ref();
    let mut files = vec![density("steady.npz".into(), &it.density, rig)?];
    if !it.approach.is_empty() {
        let (times, distances): (Vec<f64>, Vec<f64>) = it.approach.iter().copied().unzip();
        let head = "L1 distance to the closed form";
        let table = Csv::of(results).plain("t", "1/W", times);
        let table = table.plain(head, "1", distances);
        files.push(table.file("approach.csv"));
    }
    Ok(files)
}

pub(super) fn decay_rates(results: &Results, it: &DecayRates) -> Vec<File> {
    let errors = it.rates.iter().map(|it| it.error);
    let table = Csv::of(results)
        .plain("re", "W", it.rates.iter().map(|it| it.re))
        .plain("im", "W", it.rates.iter().map(|it| it.im))
        .plain("error of re + i im", "W", errors);
    vec![table.file("decay_rates.csv")]
}

pub(super) fn monte_carlo(results: &Results, it: &EnsembleResult) -> Vec<File> {
    let table = moments_csv(results, &it.times, &it.moments, "standard error");
    vec![table.file("monte_carlo.csv")]
}

/// Files of the long records: their stationary numbers, and p_q, p_v, p_N as histograms.
pub(super) fn records(results: &Results) -> Option<Vec<File>> {
    let (it, numbers) = (results.records.as_ref()?, results.sampled_stationary()?);
    let table = rows(results, "value,standard error", &numbers);
    let histogram = |file, name, units, of| histogram(results, file, (name, units), of);
    let mut files = vec![
        table.file("records.csv"),
        histogram("records_q.csv", "q", ["u", "1/u"], &it.displacement),
        histogram("records_v.csv", "v", ["u W", "1/(u W)"], &it.velocity),
        histogram("records_force.csv", "N", ["F", "1/F"], &it.force),
    ];
    if let Some(flights) = results.sampled_flights() {
        files.push(histogram("flights.csv", "flight", ["1/W", "W"], flights));
    }
    Some(files)
}

/// A histogram, one bin a line; the Dirac mass is not in it.
pub(super) fn histogram(
    results: &Results,
    file: &str,
    (name, [unit, per]): (&str, [&'static str; 2]),
    it: &Histogram,
) -> File {
    let bins = it.density.len();
    let ends = |from: usize| it.edges.iter().skip(from).take(bins).copied();
    Csv::of(results)
        .plain(&format!("{name} from"), unit, ends(0))
        .plain(&format!("{name} to"), unit, ends(1))
        .curve("density", "standard error", per, &it.density)
        .file(file)
}

/// Losses of contact, by Rice's formula and as the records saw them.
pub(super) fn crossings(results: &Results, numbers: &Numbers) -> Vec<File> {
    let sampled = results.sampled_crossings().map(|(_, numbers)| numbers);
    let mut table = Rows::of(results, &["value,error", "Monte Carlo,standard error"]);
    for (name, number) in numbers.iter() {
        let seen = sampled.as_ref().and_then(|it| it.get(name));
        table.put(name, dimension(name), &[number, seen]);
    }
    vec![table.file("crossings.csv")]
}

/// Files of the spectrum: as a table and as arrays.
pub(super) fn spectrum(results: &Results, it: &SpectrumNumbers) -> Result<Vec<File>> {
    let force = it.solved.quantity == Quantity::Force;
    let [unit, of_magnitude] = if force {
        ["F^2/W", "F"]
    } else {
        ["u^2/W", "u"]
    };
    // A density in one unit: solved, linear, sampled.
    let densities = |table: Csv, over: &str, unit: &'static str, scale: f64| {
        let scaled = |all: &[Estimate]| all.iter().map(|it| it.scaled(scale)).collect::<Vec<_>>();
        let plain = |all: &[f64]| all.iter().map(|g| g * scale).collect::<Vec<_>>();
        let head = format!("G one-sided with integral over {over} = variance");
        let table = table
            .curve(&head, "error", unit, &scaled(&it.solved.density))
            .bare("G of the linear oscillator", unit, plain(&it.linear));
        match &it.sampled {
            None => table,
            Some(it) => table
                .curve("G by Welch", "standard error", unit, &scaled(&it.density))
                .bare("expectation of G by Welch", unit, plain(&it.expectation)),
        }
    };
    let omega = it.solved.omega.clone();
    let table = Csv::of(results).bare("omega", "W", omega).circular();
    let mut table = densities(table, "omega", unit, 1.0);
    if let Some(it) = &it.sampled {
        let (head, magnitude) = ("RMS magnitude sqrt(G x 1.5 bins)", it.magnitude.clone());
        table = table.plain(head, of_magnitude, magnitude);
    }
    let per_hertz = results.scene.rig().map(|rig| {
        if force {
            ("N^2/Hz", per_hertz(&rig), rig)
        } else {
            ("um^2/Hz", displacement_per_hertz(&rig), rig)
        }
    });
    if let Some((unit, scale, rig)) = &per_hertz {
        let frequency = it.solved.omega.iter().map(|w| rig.hertz(*w)).collect();
        let table_in_hertz = table.bare("frequency", "Hz", frequency);
        table = densities(table_in_hertz, "frequency", unit, *scale);
    }
    let values = |all: &[Estimate]| Array1::from_iter(all.iter().map(|it| it.value));
    let errors = |all: &[Estimate]| Array1::from_iter(all.iter().map(|it| it.error));
    let mut arrays = vec![
        ("omega", Array1::from_vec(it.solved.omega.clone())),
        ("fokker_planck", values(&it.solved.density)),
        ("error", errors(&it.solved.density)),
        ("linear", Array1::from_vec(it.linear.clone())),
    ];
    if let Some(it) = &it.sampled {
        arrays.push(("monte_carlo", values(&it.density)));
        arrays.push(("standard_error", errors(&it.density)));
        let expectation = Array1::from_vec(it.expectation.clone());
        arrays.push(("monte_carlo_expectation", expectation));
        arrays.push(("magnitude", Array1::from_vec(it.magnitude.clone())));
    }
    if let Some((_, scale, rig)) = &per_hertz {
        // The names say the unit: N^2/Hz, or um^2/Hz of the displacement.
        let names = if force {
            ["fokker_planck_n2_per_hz", "error_n2_per_hz"]
        } else {
            ["fokker_planck_um2_per_hz", "error_um2_per_hz"]
        };
        let hertz = it.solved.omega.iter().map(|w| rig.hertz(*w));
        arrays.push(("frequency_hz", hertz.collect()));
        arrays.push((names[0], values(&it.solved.density) * *scale));
        arrays.push((names[1], errors(&it.solved.density) * *scale));
    }
    let arrays = packed("spectrum.npz".into(), |npz| {
        let mut arrays = arrays.iter();
        arrays.try_for_each(|(name, array)| npz.add_array(*name, array))
    })?;
    Ok(vec![table.file("spectrum.csv"), arrays])
}

/// p\[q, v\] with q, v and t, as numpy.load reads it.
pub(super) fn density(name: String, snapshot: &Snapshot, rig: Option<&Rig>) -> Result<File> {
    packed(name, |npz| {
        // C order whatever the layout in memory.
        npz.add_array("p", &snapshot.p.as_standard_layout())?;
        npz.add_array("t", &arr0(snapshot.t))?;
        axes(npz, snapshot, rig)
    })
}

/// The axes of a density; on a rig in micrometres and millimetres per second too.
fn axes(
    npz: &mut Archive,
    snapshot: &Snapshot,
    rig: Option<&Rig>,
) -> std::result::Result<(), WriteNpzError> {
    npz.add_array("q", &snapshot.q)?;
    npz.add_array("v", &snapshot.v)?;
    if let Some(rig) = rig {
        npz.add_array("q_um", &(&snapshot.q * micrometre(rig)))?;
        npz.add_array("v_mm_per_s", &(&snapshot.v * (1e3 * rig.velocity(1.0))))?;
    }
    Ok(())
}

/// Densities of several times on one mesh, as p[t, q, v].
pub(super) fn stacked(name: String, all: &[Snapshot], rig: Option<&Rig>) -> Result<File> {
    let views: Vec<_> = all.iter().map(|it| it.p.view()).collect();
    let p =
        ndarray::stack(ndarray::Axis(0), &views).map_err(|error| Error::unmade(&name, error))?;
    let times: Array1<f64> = all.iter().map(|it| it.t).collect();
    packed(name, |npz| {
        npz.add_array("p", &p)?;
        npz.add_array("t", &times)?;
        all.first().map_or(Ok(()), |it| axes(npz, it, rig))
    })
}

type Archive = NpzWriter<Cursor<Vec<u8>>>;

/// An archive of the arrays that `put` adds.
fn packed(
    name: String,
    put: impl FnOnce(&mut Archive) -> std::result::Result<(), WriteNpzError>,
) -> Result<File> {
    let mut npz = NpzWriter::new_compressed(Cursor::new(Vec::new()));
    let bytes = put(&mut npz).and_then(|()| Ok(npz.finish()?.into_inner()));
    match bytes {
        Ok(bytes) => Ok(File { name, bytes }),
        Err(error) => Err(Error::unmade(&name, error)),
    }
}

/// Arrays by their names, each with its shape and its numbers in C order, as numpy.load reads them.
///
/// # Errors
/// [`Error::Io`] for an array whose shape is not that of its numbers.
pub fn archive<Shape: AsRef<[usize]>>(
    name: &str,
    arrays: impl IntoIterator<Item = (String, Shape, Vec<f64>)>,
) -> Result<File> {
    packed(name.into(), |npz| {
        for (name, shape, numbers) in arrays {
            let array = ArrayD::from_shape_vec(IxDyn(shape.as_ref()), numbers);
            let array = array.map_err(|error| {
                WriteNpzError::Npy(std::io::Error::other(error.to_string()).into())
            })?;
            npz.add_array(name, &array)?;
        }
        Ok(())
    })
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
    packed(name.into(), |npz| {
        let times = Array1::from(times.to_vec());
        npz.add_array("t", &times)?;
        if let Some(seconds) = seconds {
            npz.add_array("t_s", &(&times * seconds))?;
        }
        for (name, curve) in curves {
            let of = |f: fn(&Estimate) -> f64| curve.iter().map(f).collect::<Array1<f64>>();
            npz.add_array(*name, &of(|x| x.value))?;
            npz.add_array(format!("{name}_error"), &of(|x| x.error))?;
            if let Some(seconds) = seconds.filter(|_| *name == "density") {
                npz.add_array("density_per_s", &(of(|x| x.value) / seconds))?;
                npz.add_array("density_per_s_error", &(of(|x| x.error) / seconds))?;
            }
        }
        for (name, number) in numbers {
            npz.add_array(*name, &arr0(number.value))?;
            npz.add_array(format!("{name}_error"), &arr0(number.error))?;
        }
        Ok(())
    })
}
