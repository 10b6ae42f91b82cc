//! Numbers as files: JSON, CSV with units in the header, NumPy arrays.

use super::File;
use crate::error::{Error, Result};
use crate::estimate::Estimate;
use crate::fokker_planck::Snapshot;
use crate::format::{bare, num};
use crate::moments::{Moment, Moments};
use crate::monte_carlo::{EnsembleResult, Histogram};
use crate::oscillator::Quantity;
use crate::results::{Results, entries};
use crate::spectrum::{displacement_per_hertz, per_hertz};
use ndarray::{Array1, Array2, ArrayD, IxDyn, arr0};
use ndarray_npy::{NpzWriter, WriteNpzError};
use std::fmt::Write;
use std::io::Cursor;
use std::path::PathBuf;

/// The unit of a number of stationary motion or of a moment; "1" for any other.
pub(crate) fn unit(name: &str) -> &'static str {
    entries()
        .find(|it| it.name == name)
        .map_or("1", |it| it.unit)
}

/// A number as it reads back exactly; empty where it does not exist.
pub(super) fn field(x: f64) -> String {
    if x.is_finite() { num(x) } else { String::new() }
}

fn line(numbers: &[f64]) -> String {
    let fields: Vec<String> = numbers.iter().copied().map(field).collect();
    fields.join(",") + "\n"
}

/// Value and error, or two empty fields.
pub(super) fn fields(it: Option<Estimate>) -> String {
    let it = it.filter(|it| it.value.is_finite());
    it.map_or(",".into(), |it| {
        format!("{},{}", field(it.value), field(it.error))
    })
}

/// Files of the closed form: its numbers, and p_q, p_v, p_N as curves.
pub(super) fn stationary(results: &Results) -> Result<Vec<File>> {
    let Some(numbers) = &results.stationary else {
        return Ok(Vec::new());
    };
    let Some(law) = results.law() else {
        return Ok(Vec::new());
    };
    let mut table = String::from("name,value,error,unit\n");
    for (name, number) in numbers.iter() {
        let _ = writeln!(table, "{name},{},{}", fields(number), unit(name));
    }
    let t = results.scene.oscillator.temperature();
    let (low, high) = results
        .contact()
        .turning_points(18.0 * t)
        .unwrap_or((0.0, 0.0));
    let mut by_q = String::from("q [u],p_q [1/u]\n");
    let mut by_force = String::from("N [F],p_N without its Dirac mass [1/F],P(N <= this) [1]\n");
    for q in grid(low, high) {
        by_q += &line(&[q, law.density_q(q)]);
    }
    let bottom = results.contact().force(low);
    let forces: Vec<f64> = grid(bottom, results.contact().force(high)).collect();
    for (force, below) in forces.iter().zip(law.distribution_force(&forces)) {
        by_force += &line(&[*force, law.density_force(*force), below]);
    }
    let mut by_v = String::from("v [u W],p_v [1/(u W)]\n");
    for v in grid(-6.0 * t.sqrt(), 6.0 * t.sqrt()) {
        by_v += &line(&[v, law.density_v(v)]);
    }
    Ok(vec![
        File::text("stationary.csv", table),
        File::text("stationary_q.csv", by_q),
        File::text("stationary_v.csv", by_v),
        File::text("stationary_force.csv", by_force),
    ])
}

fn grid(low: f64, high: f64) -> impl Iterator<Item = f64> {
    (0..=400).map(move |k| low + (high - low) * f64::from(k) / 400.0)
}

fn moments_csv(
    times: &[f64],
    moments: &[Moments],
    more: &[(&str, Vec<Option<Estimate>>)],
) -> String {
    let mut table = String::from("t [1/W]");
    let asked = |it: &Moment| !moments.iter().any(|at| at.leaves_out(*it));
    let asked: Vec<Moment> = Moment::ALL.into_iter().filter(asked).collect();
    let names = asked.iter().map(|it| it.name());
    for name in names.chain(more.iter().map(|(name, _)| *name)) {
        let unit = unit(name);
        let _ = write!(table, ",{name} [{unit}],{name} error [{unit}]");
    }
    table.push('\n');
    for (k, (t, moments)) in times.iter().zip(moments).enumerate() {
        table += &field(*t);
        for it in &asked {
            let _ = write!(table, ",{}", fields(moments.get(*it)));
        }
        for (_, curve) in more {
            let _ = write!(table, ",{}", fields(curve.get(k).copied().flatten()));
        }
        table.push('\n');
    }
    table
}

/// Files of the transient: moments, and the densities asked for.
pub(super) fn transient(results: &Results) -> Result<Vec<File>> {
    let Some(it) = &results.transient else {
        return Ok(Vec::new());
    };
    let mut files = Vec::new();
    if !it.times.is_empty() {
        let some = |curve: &[Estimate]| curve.iter().copied().map(Some).collect();
        let more = [
            ("mass", some(&it.mass)),
            ("lowest_density", some(&it.lowest_density)),
            ("negative_mass", some(&it.negative_mass)),
            ("relative_entropy", it.relative_entropy.clone()),
            ("l1_distance", it.distance.clone()),
        ];
        files.push(File::text(
            "moments.csv",
            moments_csv(&it.times, &it.moments, &more),
        ));
    }
    for snapshot in &it.densities {
        let name = format!("density_{}.npz", bare(snapshot.t));
        files.push(density(name, snapshot)?);
    }
    Ok(files)
}

pub(super) fn steady(results: &Results) -> Result<Vec<File>> {
    let Some(it) = &results.steady else {
        return Ok(Vec::new());
    };
    let mut files = vec![density("steady.npz".into(), &it.density)?];
    if !it.approach.is_empty() {
        let mut table = String::from("t [1/W],L1 distance to the closed form [1]\n");
        for (t, distance) in &it.approach {
            table += &line(&[*t, *distance]);
        }
        files.push(File::text("approach.csv", table));
    }
    Ok(files)
}

pub(super) fn decay_rates(results: &Results) -> Vec<File> {
    let Some(it) = &results.decay_rates else {
        return Vec::new();
    };
    let mut table = String::from("re [W],im [W],error [W]\n");
    for rate in &it.rates {
        table += &line(&[rate.re, rate.im, rate.error]);
    }
    vec![File::text("decay_rates.csv", table)]
}

pub(super) fn monte_carlo(results: &Results) -> Vec<File> {
    let table = |it: &EnsembleResult| {
        let table = moments_csv(&it.times, &it.moments, &[]);
        File::text("monte_carlo.csv", table)
    };
    results.monte_carlo.iter().map(table).collect()
}

/// Files of the long records: their stationary numbers, and p_q, p_v, p_N as histograms.
pub(super) fn records(results: &Results) -> Vec<File> {
    let (Some(it), Some(numbers)) = (&results.records, results.sampled_stationary()) else {
        return Vec::new();
    };
    let mut table = String::from("name,value,standard error,unit\n");
    for (name, number) in numbers.iter() {
        let _ = writeln!(table, "{name},{},{}", fields(number), unit(name));
    }
    let mut files = vec![
        File::text("records.csv", table),
        histogram("records_q.csv", "q", ["u", "1/u"], &it.displacement),
        histogram("records_v.csv", "v", ["u W", "1/(u W)"], &it.velocity),
        histogram("records_force.csv", "N", ["F", "1/F"], &it.force),
    ];
    if let Some(flights) = results.sampled_flights() {
        files.push(histogram("flights.csv", "flight", ["1/W", "W"], flights));
    }
    files
}

/// A histogram, one bin a line; the Dirac mass is not in it.
fn histogram(file: &str, name: &str, [unit, per]: [&str; 2], it: &Histogram) -> File {
    let mut table =
        format!("{name} from [{unit}],{name} to [{unit}],density [{per}],standard error [{per}]\n");
    for (ends, density) in it.edges.windows(2).zip(&it.density) {
        let (from, to) = (field(ends[0]), field(ends[1]));
        let _ = writeln!(table, "{from},{to},{}", fields(Some(*density)));
    }
    File::text(file, table)
}

/// Losses of contact, by Rice's formula and as the records saw them.
pub(super) fn crossings(results: &Results) -> Vec<File> {
    let Some(numbers) = &results.crossings else {
        return Vec::new();
    };
    let sampled = results.sampled_crossings().map(|(_, numbers)| numbers);
    let mut table = String::from("name,value,error,Monte Carlo,standard error,unit\n");
    for (name, number) in numbers.iter() {
        let seen = sampled.as_ref().and_then(|it| it.get(name));
        let (number, seen) = (fields(number), fields(seen));
        let _ = writeln!(table, "{name},{number},{seen},{}", unit(name));
    }
    vec![File::text("crossings.csv", table)]
}

/// Files of the spectrum: as a table and as arrays.
pub(super) fn spectrum(results: &Results) -> Result<Vec<File>> {
    let Some(it) = &results.spectrum else {
        return Ok(Vec::new());
    };
    let force = it.solved.quantity == Quantity::Force;
    let unit = if force { "F^2/W" } else { "u^2/W" };
    let per_hertz = results.scene.rig.map(|rig| {
        if force {
            ("N^2/Hz", per_hertz(&rig), rig)
        } else {
            ("um^2/Hz", displacement_per_hertz(&rig), rig)
        }
    });
    let mut table = format!(
        "omega [W],G one-sided with integral over omega = variance [{unit}],error [{unit}],linear \
         oscillator [{unit}]"
    );
    if it.sampled.is_some() {
        let _ = write!(
            table,
            ",Welch [{unit}],standard error [{unit}],expectation of Welch [{unit}],RMS magnitude \
             sqrt(G x 1.5 bins) [{}]",
            if force { "F" } else { "u" }
        );
    }
    if let Some((unit, ..)) = per_hertz {
        let _ = write!(
            table,
            ",frequency [Hz],G one-sided with integral over frequency = variance [{unit}]"
        );
    }
    table.push('\n');
    for (k, (omega, density)) in it.solved.omega.iter().zip(&it.solved.density).enumerate() {
        table += &field(*omega);
        let _ = write!(table, ",{},{}", fields(Some(*density)), field(it.linear[k]));
        if let Some(it) = &it.sampled {
            let (welch, expected) = (fields(Some(it.density[k])), field(it.expectation[k]));
            let _ = write!(table, ",{welch},{expected},{}", field(it.magnitude[k]));
        }
        if let Some((_, scale, rig)) = &per_hertz {
            let (hertz, value) = (rig.hertz(*omega), density.value * scale);
            let _ = write!(table, ",{},{}", field(hertz), field(value));
        }
        table.push('\n');
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
    let arrays = packed("spectrum.npz".into(), |npz| {
        arrays
            .iter()
            .try_for_each(|(name, array)| npz.add_array(*name, array))
    })?;
    Ok(vec![File::text("spectrum.csv", table), arrays])
}

/// p\[q, v\] with q, v and t, as numpy.load reads it.
fn density(name: String, snapshot: &Snapshot) -> Result<File> {
    packed(name, |npz| {
        // C order whatever the layout in memory.
        npz.add_array("p", &snapshot.p.as_standard_layout())?;
        npz.add_array("q", &snapshot.q)?;
        npz.add_array("v", &snapshot.v)?;
        npz.add_array("t", &arr0(snapshot.t))
    })
}

/// Axes and tables by name, as numpy.load reads them.
///
/// # Errors
/// [`Error::Io`] for an archive that cannot be made.
pub fn tables(
    name: &str,
    axes: &[(&str, Vec<f64>)],
    tables: &[(String, Array2<f64>)],
) -> Result<File> {
    packed(name.into(), |npz| {
        for (name, axis) in axes {
            npz.add_array(*name, &Array1::from(axis.clone()))?;
        }
        tables
            .iter()
            .try_for_each(|(name, table)| npz.add_array(name.as_str(), table))
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
        Err(error) => Err(Error::Io {
            path: PathBuf::from(name),
            source: std::io::Error::other(error.to_string()),
        }),
    }
}

/// Arrays by their names, each with its shape and its numbers in C order.
///
/// # Errors
/// [`Error::Io`] for an array whose shape is not that of its numbers.
pub(crate) fn archive<'a>(
    name: &str,
    arrays: impl IntoIterator<Item = (String, &'a [usize], Vec<f64>)>,
) -> Result<File> {
    packed(name.into(), |npz| {
        for (name, shape, numbers) in arrays {
            let array = ArrayD::from_shape_vec(IxDyn(shape), numbers);
            let array = array.map_err(|error| {
                WriteNpzError::Npy(std::io::Error::other(error.to_string()).into())
            })?;
            npz.add_array(name, &array)?;
        }
        Ok(())
    })
}

/// t, and each curve and number with its error.
pub(super) fn arrays(
    name: &str,
    times: &[f64],
    curves: &[(&str, &[Estimate])],
    numbers: &[(&str, Estimate)],
) -> Result<File> {
    packed(name.into(), |npz| {
        npz.add_array("t", &Array1::from(times.to_vec()))?;
        for (name, curve) in curves {
            let of = |f: fn(&Estimate) -> f64| curve.iter().map(f).collect::<Array1<f64>>();
            npz.add_array(*name, &of(|x| x.value))?;
            npz.add_array(format!("{name}_error"), &of(|x| x.error))?;
        }
        for (name, number) in numbers {
            npz.add_array(*name, &arr0(number.value))?;
            npz.add_array(format!("{name}_error"), &arr0(number.error))?;
        }
        Ok(())
    })
}
