//! What holds in the stationary law: moments, records, losses of contact, the rig.

use super::layout::{Table, over_numbers, row, words};
use crate::clock::TimeUnit;
use crate::estimate::Estimate;
use crate::format::{brief, cell, rounded};
use crate::moments::{Moment, Moments};
use crate::results::{Results, entries, physical_words};
use std::fmt::Write;

/// Closed form and long realisations side by side: name in results.json and both numbers.
type Sides = (&'static str, Option<Estimate>, Option<Estimate>);

/// The last moments with their time.
fn last<'a>(times: &'a [f64], moments: &'a [Moments]) -> Option<(f64, &'a Moments)> {
    Some((*times.last()?, moments.last()?))
}

/// Closed form, steady state on the mesh, Fokker-Planck or Monte Carlo at the last time: whatever there
/// is, up to three columns.
pub(super) fn stationary(table: &mut Table, results: &Results) {
    let transient = results.transient.as_ref();
    let transient = transient.and_then(|it| last(&it.times, &it.moments));
    let sampled = results.monte_carlo.as_ref();
    let sampled = sampled.and_then(|it| last(&it.times, &it.moments));
    let steady = results.steady.as_ref().map(|it| it.moments);
    let mut columns: Vec<(&str, String, Option<&Moments>)> = Vec::new();
    let closed = results.stationary.as_ref();
    if closed.is_some() {
        let (name, from) = if results.solved.is_some() {
            ("solved", "no closed form")
        } else {
            ("closed form", "(21)-(30)")
        };
        columns.push((name, from.into(), None));
    }
    if let Some(moments) = &steady {
        columns.push(("steady state", "on the mesh".into(), Some(moments)));
    }
    let lasting = columns.len();
    if let Some((t, moments)) = transient.filter(|_| lasting < 2) {
        columns.push(("Fokker-Planck", format!("t = {}", brief(t)), Some(moments)));
    }
    if let Some((t, moments)) = sampled {
        columns.push(("Monte Carlo", format!("t = {}", brief(t)), Some(moments)));
    }
    // Beside long realisations the closed form has a table of its own.
    let alone = closed.is_some() && columns.len() == 1 && results.records.is_some();
    if columns.is_empty() || alone {
        return;
    }
    let plain = results.scene.excitation.is_plain();
    let title = match (lasting > 0, columns.len()) {
        (true, 1) if !plain => "STATIONARY MOTION UNDER STEADY NOISE ALONE",
        (true, _) if !plain => "SIDE BY SIDE; the stationary law is that of steady noise alone",
        (true, 1) => "STATIONARY MOTION",
        (true, all) if all > lasting => "STATIONARY MOTION, and the last time beside it",
        (true, _) => "STATIONARY MOTION, side by side",
        _ => "AT THE LAST TIME",
    };
    let names: Vec<&str> = columns.iter().map(|(name, ..)| *name).collect();
    table.columns(title, &names);
    let from = over_numbers(columns.iter().map(|(_, from, _)| from.as_str()));
    table.line(format!("{:<26}{from}", ""));
    for (k, entry) in entries().enumerate() {
        let moment = Moment::ALL.get(k);
        let number = |(_, _, moments): &(_, _, Option<&Moments>)| match moments {
            None => closed.and_then(|it| it.get(entry.name)),
            Some(moments) => moments.get(*moment?),
        };
        let numbers: Vec<Option<Estimate>> = columns.iter().map(number).collect();
        if numbers.iter().any(Option::is_some) {
            table.line(row(&words(entry), &numbers, false));
        }
    }
}

/// A table of what is known exactly and what was sampled; either may be missing altogether.
fn sides(table: &mut Table, results: &Results, title: &str, rows: &[Sides]) {
    let exact = rows.iter().any(|(_, it, _)| it.is_some());
    let sampled = rows.iter().any(|(.., it)| it.is_some());
    let there = [(results.origin(), exact), ("long realisations", sampled)];
    let there = there.into_iter().filter(|(_, there)| *there);
    let heads: Vec<&str> = there.map(|(words, _)| words).collect();
    table.compared_columns(title, &heads);
    for (name, a, b) in rows {
        let entry = entries().find(|it| it.name == *name);
        let known = entry.filter(|_| a.is_some() || b.is_some());
        let numbers: Vec<_> = [(*a, exact), (*b, sampled)]
            .into_iter()
            .filter_map(|(it, there)| there.then_some(it))
            .collect();
        if let Some(entry) = known {
            table.line(row(&words(entry), &numbers, true));
        }
    }
}

pub(super) fn records(table: &mut Table, results: &Results) {
    let (Some(it), Some(sampled)) = (&results.records, results.sampled_stationary()) else {
        return;
    };
    let closed = results.stationary.as_ref();
    let row = |(name, number)| (name, closed.and_then(|it| it.get(name)), number);
    let rows: Vec<Sides> = sampled.iter().map(row).collect();
    sides(table, results, "STATIONARY MOTION", &rows);
    let [q, force, energy] = it.effective_samples.map(|it| format!("{it:.0}"));
    let text = format!(
        "{}, {} realisations, {} of time in all, steps of {}, {} batches of {}; worth {q} independent \
         samples of q, {force} of N, {energy} of H; errors are one standard error{}",
        it.scheme,
        it.records,
        brief(it.duration),
        brief(it.step),
        it.batches,
        brief(it.batch_length),
        if results.controlled() {
            ", lowered by the exact E[N] = 0, E[qN] = T, E[v^2] = T, E[qv] = 0"
        } else {
            ""
        }
    );
    table.line("");
    table.paragraph("realisations:  ", &text);
}

pub(super) fn crossings(table: &mut Table, results: &Results) {
    let (Some(numbers), Some(window)) = (&results.crossings, results.scene.outputs.crossings)
    else {
        return;
    };
    let sampled = results.sampled_crossings().map(|(_, numbers)| numbers);
    let row = |(name, number)| (name, number, sampled.as_ref().and_then(|it| it.get(name)));
    let rows: Vec<Sides> = numbers.iter().map(row).collect();
    sides(table, results, "LOSSES OF CONTACT", &rows);
    let scene = &results.scene;
    let unit = match (scene.outputs.time_unit, scene.rig) {
        (None, Some(_)) | (Some(TimeUnit::Second), _) => " s",
        (Some(TimeUnit::Period), _) => " periods",
        _ => "",
    };
    table.line(format!("the window is {}{unit}", brief(window)));
}

pub(super) fn physical(table: &mut Table, results: &Results) {
    let Some(rig) = &results.scene.rig() else {
        return;
    };
    let (load, frequency) = (rig.static_load(), rig.frequency());
    let micrometres = rig.static_compression() * 1e6;
    table.heading(format!(
        "ON THE RIG of {load} N, {frequency} Hz, {micrometres:.3} um"
    ));
    if !results.scene.excitation.is_plain() {
        table.line("the stationary law is that of steady noise alone");
    }
    let rows = results.on_the_rig(rig);
    let sampled = rows.iter().any(|(_, [_, seen])| seen.is_some());
    if sampled {
        let origin = results.origin();
        table.line(format!("{origin:>44}{:>18}", "long realisations"));
    }
    for (name, [number, seen]) in rows {
        let (name, unit, typed) = physical_words(name);
        let mut line = match number {
            Some(it) if typed => format!("{name:<26} {:>17}", brief(rounded(it.value, 6))),
            _ => row(name, &[number], false),
        };
        if sampled {
            let seen = seen.map_or(String::new(), |it| cell(Some(it)));
            let _ = write!(line, " {seen:>17}");
        }
        table.line(format!("{line} {unit}"));
    }
}
