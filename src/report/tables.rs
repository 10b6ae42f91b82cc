//! The results in words and in tables of HTML, for the page.

mod driven;
mod passage;
mod table;

use super::html::escaped;
use crate::clock::TimeUnit;
use crate::estimate::{Estimate, Origin};
use crate::format::{brief, cell, seconds, spread};
use crate::initial::Initial;
use crate::moments::{Entry, Moment};
use crate::results::{Results, distance, entries, physical_words};
use std::fmt::Write;
use table::{Table, complex, shown};

/// Times of a transient shown on the page; all are in the files.
const TIMES: usize = 12;

/// What came out, in a few sentences.
pub(super) fn summary(results: &Results) -> String {
    let oscillator = &results.scene.oscillator;
    let contact = oscillator.contact().described();
    let damping = oscillator.damping().words();
    let mut text = format!(
        "A {contact} with {damping}damping ratio \u{3b6} = {} under white noise of level h = {}, T = \
         \u{3c0}h/(2\u{3b6}) = {}.",
        brief(oscillator.zeta()),
        brief(oscillator.h()),
        brief(oscillator.viscous_temperature())
    );
    let rig = results.scene.rig();
    let law = results.stationary.as_ref();
    let of = |name: &str| law.and_then(|it| it.get(name)).map(|it| it.value);
    let undriven = if results.scene.excitation.is_plain() {
        ""
    } else {
        " of a steady noise alone, without the excitation's drive and envelope,"
    };
    if let Some(deviation) = of("std_force") {
        let newtons = rig.map_or(String::new(), |rig| {
            format!("{} N, ", brief(rounded(rig.newtons(deviation))))
        });
        let _ = write!(
            text,
            " In the stationary motion{undriven} the contact force deviates by {newtons}{deviation:.3} static loads from its mean"
        );
        match of("contact_loss_probability") {
            Some(lost) if lost > 0.0 => {
                let _ = write!(text, ", and contact is lost {} of the time.", share(lost));
            }
            _ => text.push_str(", and contact is never lost."),
        }
    }
    let last = results.transient.as_ref();
    if let Some((t, moments)) = last.and_then(|it| it.times.last().zip(it.moments.last())) {
        let from = match results.scene.initial {
            Initial::Rest => "from rest",
            Initial::Stationary => "from the stationary law",
            Initial::Gaussian { .. } => "from a Gaussian initial condition",
        };
        let _ = write!(text, " At t = {}{}, {from}", brief(*t), unit(results));
        match moments.get(Moment::ContactLossProbability) {
            Some(lost) => {
                let share = share(lost.value);
                let _ = write!(text, ", contact is lost with probability {share}.");
            }
            None => match moments.get(Moment::MeanEnergy) {
                Some(it) => {
                    let _ = write!(text, ", the mean energy is {}.", brief(rounded(it.value)));
                }
                None => text.push_str(", the moments are those below."),
            },
        }
    }
    if let (Some(it), Some(asked)) = (&results.reach, results.scene.outputs.reach)
        && let Some(t) = it.t
    {
        let (symbol, part) = (asked.quantity.entry().symbol, brief(asked.fraction));
        let t = cell(Some(t)) + unit(results);
        let _ = write!(
            text,
            " {symbol} reaches {part} of its stationary value at t = {t}."
        );
    }
    let first = results.first_loss.as_ref();
    if let Some(it) = first.filter(|it| it.mean_time.value.is_finite()) {
        let time = cell(Some(it.mean_time)) + unit(results);
        let _ = write!(
            text,
            " The first passage to contact loss takes {time} in the mean."
        );
    }
    if let Some(it) = &results.agreement {
        let _ = write!(
            text,
            " Over {} pairs of numbers, Monte Carlo and the other methods differ by at most {:.1} joint errors; chance \
             alone would give about {:.1}.",
            it.compared, it.worst, it.expected_worst
        );
    }
    format!("<p class=\"summary\">{}</p>\n", escaped(&text))
}

/// What the letters mean, and what an error covers.
pub(super) fn symbols(results: &Results) -> String {
    let times = match results.scene.clock().unit() {
        TimeUnit::Dimensionless => {
            "times t are in units of 1/\u{3a9}, \u{3a9} = 2\u{3c0}f\u{2080}: a period of small vibrations is 2\u{3c0}"
        }
        TimeUnit::Period => {
            "times t are in periods 1/f\u{2080} of small vibrations, rates per period"
        }
        TimeUnit::Second => "times t are in seconds, rates per second",
    };
    let preload = brief(rounded(results.contact().static_compression()));
    format!(
        "<details><summary>Symbols, units, and what \u{b1} means</summary>\n<p>q = {preload} (z \u{2212} z_s)/z_s is the \
         displacement, z the compression and z_s the static one; v = dq/dt with t in units of 1/\u{3a9}; N = F/F_s \
         \u{2212} 1 is the dynamic contact force, F_s the static load; H = v\u{b2}/2 + U(q) is the energy; P(loss) is the \
         probability of no contact; {times}. h is the two-sided density of the excitation per unit of \u{3c9}: 2h \
         is the one-sided one. T = \u{3c0}h/(2\u{3b6}) is the stationary variance of v under viscous damping.</p>\n<p>Without sampling, \
         \u{b1} is an estimate that the actual error is meant to stay below: mesh, time steps, truncated domain, \
         rounding. With sampling it is one standard error. It covers the numerics, not the model and not the \
         values of the scene.</p></details>\n"
    )
}

fn unit(results: &Results) -> &'static str {
    results.scene.clock().suffix()
}

fn rounded(x: f64) -> f64 {
    crate::format::rounded(x, 4)
}

/// A probability for people.
fn share(p: f64) -> String {
    if p >= 1e-3 {
        format!("{} %", brief(crate::format::rounded(100.0 * p, 3)))
    } else {
        format!("{p:.2e}")
    }
}

fn words(it: &Entry) -> [String; 2] {
    [it.words.to_owned(), it.symbol.to_owned()]
}

/// Every table, SI units first.
pub(super) fn tables(results: &Results) -> String {
    let all = [
        physical(results),
        Some(stationary(results)),
        crossings(results),
        passage::first_loss(results),
        passage::first_passage(results),
        spectrum(results),
        eigenvalues(results),
        driven::periodic(results),
        driven::response(results),
        course(results),
        Some(stages(results)),
    ];
    all.into_iter().flatten().collect()
}

fn physical(results: &Results) -> Option<String> {
    let rig = &results.scene.rig()?;
    let mut table = Table::of(["", "value", "long realisations", "unit"]);
    for (name, [number, seen]) in results.on_the_rig(rig) {
        let (words, unit, typed) = physical_words(name);
        let value = match number {
            Some(it) if typed => brief(crate::format::rounded(it.value, 6)),
            it => shown(it),
        };
        table.put([words.to_owned(), value, shown(seen), unit.to_owned()]);
    }
    let (load, frequency) = (brief(rig.static_load()), brief(rig.frequency()));
    let micrometres = brief(crate::format::rounded(rig.static_compression() * 1e6, 6));
    let noise = if results.scene.excitation.is_plain() {
        ""
    } else {
        "; the stationary law is that of steady noise alone"
    };
    let title = format!("On the rig: {load} N, {frequency} Hz, {micrometres} \u{b5}m{noise}");
    Some(table.html(&title))
}

fn stationary(results: &Results) -> String {
    let closed = results.stationary.as_ref();
    let steady = results.steady.as_ref().map(|it| it.moments);
    let sampled = results.sampled_stationary();
    let mut table = Table::of([
        "",
        "symbol",
        results.origin(),
        "stationary solution on the mesh",
        "long realisations",
        "z",
    ]);
    for (k, entry) in entries().enumerate() {
        let a = closed.and_then(|it| it.get(entry.name));
        let meshed = Moment::ALL.get(k).and_then(|it| steady?.get(*it));
        let b = sampled.as_ref().and_then(|it| it.get(entry.name));
        if a.is_none() && meshed.is_none() && b.is_none() {
            continue;
        }
        let z = a.zip(b).and_then(|(a, b)| distance(a, b));
        let z = z.map_or(String::new(), |z| format!("{z:.1}"));
        let [words, symbol] = words(entry);
        table.put([words, symbol, shown(a), shown(meshed), shown(b), z]);
    }
    table.html("Stationary motion")
}

fn crossings(results: &Results) -> Option<String> {
    let numbers = results.crossings.as_ref()?;
    let sampled = results.sampled_crossings().map(|(_, numbers)| numbers);
    let rice = if results.solved.is_some() {
        "flux, solved"
    } else {
        "Rice, closed form"
    };
    let mut table = Table::of(["", "symbol", rice, "long realisations"]);
    for (name, number) in numbers.iter() {
        let Some(entry) = entries().find(|it| it.name == name) else {
            continue;
        };
        let seen = sampled.as_ref().and_then(|it| it.get(name));
        let [words, symbol] = words(entry);
        table.put([words, symbol, shown(number), shown(seen)]);
    }
    Some(table.html("Losses of contact"))
}

fn spectrum(results: &Results) -> Option<String> {
    let it = results.spectrum.as_ref()?;
    let rig = results.scene.rig();
    let hertz = |x| {
        rig.zip(x)
            .map(|(rig, x): (_, Estimate)| x.scaled(rig.hertz(1.0)))
    };
    let mut table = Table::of([
        "",
        "frequency, Hz",
        "half-power width, Hz",
        "\u{3c9}",
        "half-power width",
        "one-sided density",
    ]);
    for (k, peak) in it.peaks.iter().take(4).enumerate() {
        let (omega, width) = (Some(peak.omega), peak.width);
        let numbers = [hertz(omega), hertz(width), omega, width, Some(peak.density)];
        table.numbers(format!("peak {}", k + 1), numbers);
    }
    Some(table.html(&format!("Spectrum of the {}", it.solved.quantity.name())))
}

fn eigenvalues(results: &Results) -> Option<String> {
    let it = results.decay_rates.as_ref()?;
    let mut table = Table::of(["", "real part", "imaginary part", "relaxation time"]);
    for (k, rate) in it.rates.iter().enumerate() {
        let [re, im] = complex(rate.re, rate.im, rate.error);
        let time = Estimate::new(-1.0 / rate.re, rate.error / rate.re.powi(2), Origin::Space);
        table.put([(k + 1).to_string(), re, im, shown(Some(time))]);
    }
    if let Some(edge) = it.continuous_from {
        let none = String::new;
        table.put([
            "continuous from".into(),
            brief(crate::format::rounded(edge, 5)),
            none(),
            none(),
        ]);
    }
    Some(table.html("Slowest eigenvalues of the Fokker-Planck operator"))
}

fn course(results: &Results) -> Option<String> {
    let it = results.transient.as_ref()?;
    let course = Moment::course(&it.moments);
    let mut table = Table::of(["t", "", "Fokker-Planck", "Monte Carlo", "z"]);
    for k in spread(it.times.len(), TIMES) {
        let t = it.times[k];
        let there = results.paths_at(t);
        for (n, moment) in course.iter().enumerate() {
            let Some(a) = it.moments.get(k).and_then(|it| it.get(*moment)) else {
                continue;
            };
            let b = there.and_then(|it| it.get(*moment));
            let z = b.and_then(|b| distance(a, b));
            let time = if n == 0 {
                brief(t) + unit(results)
            } else {
                String::new()
            };
            let z = z.map_or(String::new(), |z| format!("{z:.1}"));
            let symbol = moment.entry().symbol.to_owned();
            table.put([time, symbol, shown(Some(a)), shown(b), z]);
        }
    }
    Some(table.html("On the path to the stationary motion"))
}

fn stages(results: &Results) -> String {
    let mut table = Table::of(["stage", "time"]);
    for (name, time) in &results.run.stages {
        table.put([(*name).to_owned(), seconds(*time)]);
    }
    table.html("Times of the run")
}
