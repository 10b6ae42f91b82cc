//! The approach to the stationary law: moments over time, steady state, eigenvalues, spectrum.

use super::layout::{TIMES, Table, cells, eigenvalue, row};
use crate::estimate::Estimate;
use crate::format::{brief, cell, many, rounded, spread};
use crate::moments::Moment;
use crate::results::Results;

/// The spectrum in a few numbers; its curves are in the files.
pub(super) fn spectrum(table: &mut Table, results: &Results) {
    let Some(it) = &results.spectrum else {
        return;
    };
    let solved = &it.solved;
    let title = format!("SPECTRUM OF THE {}", solved.quantity.name().to_uppercase());
    table.columns(&title, &["omega", "S(omega)", "half-power width"]);
    for (k, peak) in it.peaks.iter().take(4).enumerate() {
        let name = if k == 0 { "highest peak" } else { "next peak" };
        let numbers = [Some(peak.omega), Some(peak.density), peak.width];
        table.line(row(name, &numbers, false));
    }
    if let (Some(first), Some(w)) = (solved.density.first(), solved.omega.first()) {
        let (name, w) = ("lowest frequency", brief(*w));
        table.line(format!("{name:<26} {w:>17} {:>17}", cell(Some(*first))));
    }
    if it.harmonic_ratio.is_some() {
        let name = "second harmonic over main";
        table.line(format!("{name:<26} {:>35}", cell(it.harmonic_ratio)));
    }
    let (error, omega) = solved.worst();
    let text = format!(
        "one-sided, integral over omega = variance: trapezoids over {} frequencies hold {:.4} of it; largest \
         error {error:.0e} of the value at omega = {}",
        solved.omega.len(),
        solved.held(),
        brief(omega)
    );
    table.paragraph("", &text);
    if let Some(sampled) = &it.sampled {
        let all = sampled.expectation.iter().zip(&solved.density);
        let bias = |(expected, exact): (&f64, &Estimate)| expected / exact.value;
        let lowest = all.clone().map(bias).fold(f64::INFINITY, f64::min);
        let highest = all.map(bias).fold(0.0, f64::max);
        let text = format!(
            "Monte Carlo: Welch, Hann window, {} averages; its expectation is {lowest:.2} to \
             {highest:.2} of the exact spectrum (peaks flattened, valleys filled), and agreement is \
             with the expectation",
            sampled.averages
        );
        table.paragraph("", &text);
    }
}

pub(super) fn deterministic(table: &mut Table, results: &Results) {
    let transient = results.transient.as_ref();
    let end = transient.and_then(|it| it.times.last().copied().zip(it.distance.last().copied()?));
    if let Some((t, distance)) = end
        && distance.value > 0.02
    {
        let text = format!(
            "at t = {} the motion is not stationary yet: L1 distance to the stationary law {:.2} of at most 2",
            brief(t),
            distance.value
        );
        table.line("");
        table.paragraph("note: ", &text);
    }
    if let Some(it) = &results.steady {
        let [nq, nv] = it.method.cells;
        let (name, law) = (&it.method.name, results.known_law());
        let (apart, residual) = (it.l1_error.value, it.residual);
        let text = format!(
            "{nq} x {nv} cells, {name}: L1 distance to the {law} {apart:.1e}, residual {residual:.1e}"
        );
        table.line("");
        table.paragraph("steady state: ", &text);
    }
    if let Some(it) = &results.decay_rates {
        let rates = it.rates.iter();
        let mut words: Vec<String> = rates.map(|it| eigenvalue(it.re, it.im, it.error)).collect();
        if it.continuous_from == Some(0.0) {
            let none = "none: without friction in flight the spectrum is continuous from 0 on";
            words.push(none.into());
        } else if let Some(edge) = it.continuous_from {
            let edge = brief(rounded(edge, 5));
            let none = if it.rates.is_empty() {
                "none by itself; "
            } else {
                ""
            };
            words.push(format!("{none}continuous from {edge} on"));
        }
        if words.is_empty() {
            words.push("none known".into());
        }
        table.line("");
        table.paragraph("decay rates:  ", &words.join(";  "));
    }
}

pub(super) fn reach(table: &mut Table, results: &Results) {
    let (Some(it), Some(asked)) = (&results.reach, results.scene.outputs.reach) else {
        return;
    };
    let entry = asked.quantity.entry();
    let words = format!("reaches {} of its", brief(asked.fraction));
    table.line("");
    table.line(row(&format!("{:<8} {words}", entry.symbol), &[], false));
    let number = match (it.t, &it.shortfall) {
        (Some(t), _) => format!("at t = {}", cell(Some(t))),
        (None, Some(_)) => "at a time that is not known".into(),
        (None, None) => "at no time".into(),
    };
    table.line(format!("{:<8} stationary value {number}", ""));
}

pub(super) fn course(table: &mut Table, results: &Results) {
    let sampled = results.monte_carlo.as_ref();
    let Some(it) = results.transient.as_ref().filter(|it| !it.times.is_empty()) else {
        return;
    };
    let [paths, z] = sampled.map_or([""; 2], |_| ["Monte Carlo", "z"]);
    let (title, solved) = ("TRANSIENT", "Fokker-Planck");
    table.heading(format!("{title:<36}{solved:>17} {paths:>17}{z:>7}"));
    for &moment in Moment::course(&it.moments) {
        if it.moments.last().and_then(|it| it.get(moment)).is_none() {
            continue;
        }
        for (n, k) in spread(it.times.len(), TIMES).into_iter().enumerate() {
            let t = it.times[k];
            let here = it.moments.get(k).and_then(|it| it.get(moment));
            let there = results.paths_at(t).and_then(|it| it.get(moment));
            let entry = moment.entry();
            let first = (n == 0).then_some((entry.symbol, entry.words));
            let (symbol, words) = first.unwrap_or_default();
            let time = format!("t = {}", brief(rounded(t, 6)));
            let both = [here, there];
            let numbers = cells(&both[..=usize::from(sampled.is_some())], true);
            table.line(format!("{symbol:<8} {words:<14} {time:>11} {numbers}"));
        }
    }
    let [nq, nv] = it.method.cells;
    let (name, steps) = (&it.method.name, many(it.method.steps, "step"));
    let longest = brief(it.method.step);
    let text = format!("{name}, {nq} x {nv} cells, {steps} of at most {longest}");
    table.line("");
    table.paragraph("Fokker-Planck: ", &text);
    if let Some(it) = sampled {
        let (scheme, paths) = (it.scheme, it.paths);
        let steps = format!("{} of {}", many(it.steps, "step"), brief(it.step));
        let text = format!("{scheme}, {paths} paths, {steps}; errors are one standard error");
        table.paragraph("Monte Carlo:   ", &text);
    }
}
