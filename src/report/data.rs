//! The files of each question: tables with units in their headers, and arrays.

use super::File;
use super::csv::{Csv, Rows};
use super::npz::{archive, density, vector, with_errors};
use crate::error::Result;
use crate::estimate::Estimate;
use crate::fokker_planck::{DecayRates, Steady, Transient};
use crate::format::bare;
use crate::moments::Moments;
use crate::monte_carlo::{EnsembleResult, Histogram};
use crate::oscillator::Quantity;
use crate::results::{Numbers, Results, SpectrumNumbers, dimension};
use crate::spectrum::{displacement_per_hertz, per_hertz};
use rayon::prelude::*;

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
    for it in Moments::kept(moments) {
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
    let rig = results.scene.rig();
    let densities = it.densities.par_iter().map(|snapshot| {
        let name = format!("density_{}.npz", bare(snapshot.t));
        density(&name, snapshot, rig.as_ref())
    });
    files.extend(densities.collect::<Result<Vec<File>>>()?);
    Ok(files)
}

pub(super) fn steady(results: &Results, it: &Steady) -> Result<Vec<File>> {
    let rig = results.scene.rig();
    let rig = rig.as_ref();
    let mut files = vec![density("steady.npz", &it.density, rig)?];
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

/// Files of the long realisations: their stationary numbers, and p_q, p_v, p_N as histograms.
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
        let (head, magnitude) = ("RMS magnitude sqrt(S x 1.5 bins)", it.magnitude.clone());
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
    let mut arrays = vec![vector("omega", it.solved.omega.clone())];
    arrays.extend(with_errors(
        ["fokker_planck", "error"],
        &it.solved.density,
        1.0,
    ));
    arrays.push(vector("linear", it.linear.clone()));
    if let Some(it) = &it.sampled {
        arrays.extend(with_errors(
            ["monte_carlo", "standard_error"],
            &it.density,
            1.0,
        ));
        arrays.push(vector("monte_carlo_expectation", it.expectation.clone()));
        arrays.push(vector("magnitude", it.magnitude.clone()));
    }
    if let Some((_, scale, rig)) = &per_hertz {
        // The names say the unit: N^2/Hz, or um^2/Hz of the displacement.
        let names = if force {
            ["fokker_planck_n2_per_hz", "error_n2_per_hz"]
        } else {
            ["fokker_planck_um2_per_hz", "error_um2_per_hz"]
        };
        let hertz = it.solved.omega.iter().map(|w| rig.hertz(*w));
        arrays.push(vector("frequency_hz", hertz));
        arrays.extend(with_errors(names, &it.solved.density, *scale));
    }
    let arrays = archive("spectrum.npz", arrays)?;
    Ok(vec![table.file("spectrum.csv"), arrays])
}
