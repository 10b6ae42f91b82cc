//! The table on the terminal: 80 columns, readable by a stranger.

use crate::clock::TimeUnit;
use crate::estimate::Estimate;
use crate::fokker_planck::{DecayRate, FirstLoss, Multiplier};
use crate::format::{brief, bytes, cell, many, rounded, seconds};
use crate::initial::Initial;
use crate::moments::{Entry, Moment, Moments};
use crate::monte_carlo::FirstLossResult;
use crate::oscillator::{Oscillator, Side};
use crate::plan::{Part, Plan, Stage};
use crate::results::{Results, distance, entries, physical_words};
use std::fmt::Write;

const WIDTH: usize = 80;

/// The moments whose course in time is printed.
const COURSE: [Moment; 4] = [
    Moment::MeanQ,
    Moment::StdForce,
    Moment::MeanEnergy,
    Moment::ContactLossProbability,
];

/// Times printed of each; all are in the files.
const TIMES: usize = 6;

/// A blank at which no line is broken.
const TOGETHER: char = '\u{a0}';

/// Text broken at blanks into lines of at most `width` columns.
pub(crate) fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split([' ', '\n']).filter(|word| !word.is_empty()) {
        let last = lines.len() - 1;
        let room = lines[last].chars().count() + 1 + word.chars().count() <= width;
        if lines[last].is_empty() {
            lines[last].push_str(word);
        } else if room {
            lines[last].push(' ');
            lines[last].push_str(word);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
        .into_iter()
        .map(|line| line.replace(TOGETHER, " "))
        .collect()
}

/// At most `TIMES` of `count` indices, spread evenly, the last among them.
fn spread(count: usize) -> Vec<usize> {
    let most = TIMES.min(count);
    (1..=most).map(|k| (k * count).div_ceil(most) - 1).collect()
}

struct Table {
    text: String,
    colour: bool,
}

impl Table {
    fn line(&mut self, line: impl AsRef<str>) {
        self.text.push_str(line.as_ref().trim_end());
        self.text.push('\n');
    }

    fn heading(&mut self, line: impl AsRef<str>) {
        self.line("");
        let line = line.as_ref();
        if self.colour {
            self.line(format!("\u{1b}[1m{line}\u{1b}[0m"));
        } else {
            self.line(line);
        }
    }

    fn paragraph(&mut self, first: &str, text: &str) {
        let indent = first.chars().count();
        for (k, line) in wrap(text, WIDTH - indent).into_iter().enumerate() {
            let lead = if k == 0 {
                first.to_owned()
            } else {
                " ".repeat(indent)
            };
            self.line(lead + &line);
        }
    }
}

/// A row: 26 columns of words, then its numbers.
fn row(words: &str, numbers: &[Option<Estimate>], compared: bool) -> String {
    format!("{words:<26} {}", cells(numbers, compared))
}

/// Numbers in 17 columns each, and in 7 how far the first two are apart where both are known.
fn cells(numbers: &[Option<Estimate>], compared: bool) -> String {
    let padded: Vec<String> = numbers
        .iter()
        .map(|it| format!("{:>17}", cell(*it)))
        .collect();
    let mut line = padded.join(" ");
    if let [Some(a), Some(b)] = numbers
        && let Some(z) = distance(*a, *b).filter(|_| compared)
    {
        let _ = write!(line, "{z:>7.1}");
    }
    line
}

/// Symbol and words of a number.
fn words(it: &Entry) -> String {
    format!("{:<8} {}", it.symbol, it.words)
}

/// The results as a table of at most 80 columns; `colour` adds bold headings.
pub fn table(results: &Results, colour: bool) -> String {
    let mut table = Table {
        text: String::new(),
        colour,
    };
    head(&mut table, results);
    stationary(&mut table, results);
    records(&mut table, results);
    crossings(&mut table, results);
    first_loss(&mut table, results);
    first_passage(&mut table, results);
    deterministic(&mut table, results);
    reach(&mut table, results);
    spectrum(&mut table, results);
    course(&mut table, results);
    periodic(&mut table, results);
    response(&mut table, results);
    agreement(&mut table, results);
    physical(&mut table, results);
    foot(&mut table, results);
    table.text
}

fn head(table: &mut Table, results: &Results) {
    let oscillator = &results.scene.oscillator;
    let title: String = results.scene.title.chars().take(50).collect();
    let name = format!("vibroimpact {}: {title}", env!("CARGO_PKG_VERSION"));
    if table.colour {
        table.line(format!("\u{1b}[1m{name}\u{1b}[0m"));
    } else {
        table.line(name);
    }
    let text = format!(
        "{} contact, {}damping ratio zeta\u{a0}=\u{a0}{}, input level h\u{a0}=\u{a0}{}, \
         T\u{a0}=\u{a0}{:.6}",
        oscillator.contact().name(),
        damping(oscillator),
        brief(oscillator.zeta()),
        brief(oscillator.h()),
        oscillator.viscous_temperature()
    );
    table.paragraph("", &text);
    let text = match results.scene.clock().unit() {
        TimeUnit::Dimensionless => "All numbers dimensionless",
        TimeUnit::Period => "Times in periods 2 pi/Omega, rates per period, all else dimensionless",
        TimeUnit::Second => "Times in seconds, rates per second, all else dimensionless",
    };
    table.paragraph(
        "",
        &format!("{text}; each number is printed with its error (\"value ± error\")."),
    );
}

/// The damping law, if it is not viscous.
fn damping(oscillator: &Oscillator) -> String {
    let name = oscillator.damping().name();
    if oscillator.is_viscous() {
        String::new()
    } else {
        format!("{name} damping, ")
    }
}

/// The last moments with their time.
fn last<'a>(times: &'a [f64], moments: &'a [Moments]) -> Option<(f64, &'a Moments)> {
    Some((*times.last()?, moments.last()?))
}

/// Closed form, steady state on the mesh, Fokker-Planck or Monte Carlo at the last time: whatever there
/// is, up to three columns.
fn stationary(table: &mut Table, results: &Results) {
    let transient = results
        .transient
        .as_ref()
        .and_then(|it| last(&it.times, &it.moments));
    let sampled = results
        .monte_carlo
        .as_ref()
        .and_then(|it| last(&it.times, &it.moments));
    let steady = results.steady.as_ref().map(|it| it.moments);
    let mut columns: Vec<(String, &str, Option<&Moments>)> = Vec::new();
    let closed = results.stationary.as_ref();
    if closed.is_some() {
        let (name, from) = if results.solved.is_some() {
            ("solved", "no closed form")
        } else {
            ("closed form", "(21)-(30)")
        };
        columns.push((name.into(), from, None));
    }
    if let Some(moments) = &steady {
        columns.push(("steady state".into(), "on the mesh", Some(moments)));
    }
    if let Some((t, moments)) = transient.filter(|_| columns.len() < 2) {
        columns.push(("Fokker-Planck".into(), "", Some(moments)));
        let last = columns.len() - 1;
        columns[last].0 = format!("mesh, t = {}", brief(t));
    }
    if let Some((t, moments)) = sampled {
        columns.push((
            format!("paths, t = {}", brief(t)),
            "Monte Carlo",
            Some(moments),
        ));
    }
    // Beside long records the closed form has a table of its own.
    let alone = closed.is_some() && columns.len() == 1 && results.records.is_some();
    if columns.is_empty() || alone {
        return;
    }
    let title = match (closed.is_some() || steady.is_some(), columns.len()) {
        (true, 1) => "STATIONARY MOTION",
        (true, _) => "STATIONARY MOTION, side by side",
        _ => "AT THE LAST TIME",
    };
    let mut heads = [format!("{title:<26}"), " ".repeat(26)];
    for (first, second, _) in &columns {
        let _ = write!(heads[0], "{first:>18}");
        let _ = write!(heads[1], "{second:>18}");
    }
    // A title longer than its column would push the others aside.
    if title.chars().count() > 25 {
        table.heading(title);
        table.line(format!("{:<26}{}", "", &heads[0][title.len()..]));
    } else {
        table.heading(&heads[0]);
    }
    table.line(&heads[1]);
    for (k, entry) in entries().enumerate() {
        let moment = Moment::ALL.get(k);
        let numbers: Vec<Option<Estimate>> = columns
            .iter()
            .map(|(_, _, moments)| match moments {
                None => closed.and_then(|it| it.get(entry.name)),
                Some(moments) => moments.get(*moment?),
            })
            .collect();
        if numbers.iter().any(Option::is_some) {
            table.line(row(&words(entry), &numbers, false));
        }
    }
}

/// Closed form and long records side by side: name in results.json and both numbers.
type Sides = (&'static str, Option<Estimate>, Option<Estimate>);

/// Where stationary numbers come from.
fn origin(results: &Results) -> &'static str {
    if results.solved.is_some() {
        "solved"
    } else {
        "closed form"
    }
}

/// A table of what is known exactly and what was sampled; either may be missing altogether.
fn sides(table: &mut Table, results: &Results, title: &str, rows: &[Sides]) {
    let exact = rows.iter().any(|(_, it, _)| it.is_some());
    let sampled = rows.iter().any(|(.., it)| it.is_some());
    let mut head = format!("{title:<26}");
    let heads = [(origin(results), exact), ("long records", sampled)];
    for (words, _) in heads.iter().filter(|(_, there)| *there) {
        let _ = write!(head, "{words:>18}");
    }
    if exact && sampled {
        let _ = write!(head, "{:>7}", "z");
    }
    table.heading(head);
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

fn records(table: &mut Table, results: &Results) {
    let (Some(it), Some(sampled)) = (&results.records, results.sampled_stationary()) else {
        return;
    };
    let closed = results.stationary.as_ref();
    let row = |(name, number)| (name, closed.and_then(|it| it.get(name)), number);
    let rows: Vec<Sides> = sampled.iter().map(row).collect();
    sides(table, results, "STATIONARY MOTION", &rows);
    let [q, force, energy] = it.effective_samples.map(|it| format!("{it:.0}"));
    let text = format!(
        "{}, {} records, {:.3e} of time in all, steps of {}, {} batches of {}; worth {q} independent \
         samples of q, {force} of N, {energy} of H; errors are one standard error{}",
        it.scheme,
        it.records,
        it.duration,
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
    table.paragraph("long records:  ", &text);
}

fn crossings(table: &mut Table, results: &Results) {
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

/// The spectrum in a few numbers; its curves are in the files.
fn spectrum(table: &mut Table, results: &Results) {
    let Some(it) = &results.spectrum else {
        return;
    };
    let solved = &it.solved;
    let title = format!("SPECTRUM OF THE {}", solved.quantity.name().to_uppercase());
    let heads = ["omega", "G(omega)", "half-power width"];
    let head = heads.map(|it| format!("{it:>18}")).concat();
    table.heading(format!("{title:<26}{head}"));
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
        "one-sided, integral over omega = variance; {} frequencies, largest error {error:.0e} of the \
         value at omega = {}",
        solved.omega.len(),
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

fn first_loss(table: &mut Table, results: &Results) {
    let sampled = results.first_loss_paths.as_ref();
    if let Some(it) = &results.first_loss {
        let words = ["FIRST LOSS OF CONTACT", "time to the loss", "given contact"];
        survival(table, results, words, (it, sampled));
    }
}

fn first_passage(table: &mut Table, results: &Results) {
    let (Some(it), Some(asked)) = (&results.first_passage, results.scene.outputs.first_passage)
    else {
        return;
    };
    let words = match asked.side {
        Side::Below => "q BELOW",
        Side::Above => "q ABOVE",
        Side::Either => "|q| ABOVE",
    };
    let title = format!("FIRST {words} {}", brief(asked.level));
    let words = [&title, "time to the passage", "short of the level"];
    survival(
        table,
        results,
        words,
        (it, results.first_passage_paths.as_ref()),
    );
}

/// `[title, mean, given]`: the heading, what is meant by the mean time, and of what a stationary start is taken.
fn survival(
    table: &mut Table,
    results: &Results,
    [title, mean, given]: [&str; 3],
    (it, sampled): (&FirstLoss, Option<&FirstLossResult>),
) {
    let mut head = format!("{title:<26}{:>18}", "backward eq.");
    if sampled.is_some() {
        let _ = write!(head, "{:>18}{:>7}", "paths", "z");
    }
    table.heading(head);
    let mut put = |symbol: &str, words: &str, a: Estimate, b: Option<Estimate>| {
        let words = format!("{symbol:<8} {words}");
        let both = [Some(a), b];
        table.line(row(&words, &both[..=usize::from(sampled.is_some())], true));
    };
    let last = it.times.len() - 1;
    for k in [last / 8, last / 4, last / 2, last] {
        let seen = sampled.and_then(|it| it.survival.get(k).copied());
        let words = format!("survives {}", brief(it.times[k]));
        put("S", &words, it.survival[k], seen);
    }
    for k in [last / 2, last] {
        let seen = sampled.and_then(|it| it.survival.get(k).copied());
        let words = format!("lost by {}", brief(it.times[k]));
        put("1 - S", &words, it.lost[k], seen.map(Estimate::complement));
    }
    let lost = sampled.filter(|it| it.survival.last().is_some_and(|s| s.value == 0.0));
    let lasts = it.rate.value.is_finite();
    if lasts {
        put("mean", mean, it.mean_time, lost.map(|it| it.mean_time));
        put("rate", "S ~ exp(-rate t)", it.rate, None);
    }
    if it.rate_over_rice.value.is_finite() {
        put("", "over Rice's rate", it.rate_over_rice, None);
    }
    let text = format!(
        "{} x {} nodes, step {}; {}; from {}",
        it.method.cells[0],
        it.method.cells[1],
        brief(rounded(it.method.step, 3)),
        if lasts {
            "in the end the survival falls as exp(-rate t)"
        } else {
            "under [excitation] there is no rate in the end"
        },
        match results.scene.initial {
            Initial::Rest => "rest".to_owned(),
            Initial::Stationary => format!("the stationary law {given}"),
            Initial::Gaussian { .. } => "a Gaussian initial condition".to_owned(),
        }
    );
    table.paragraph("", &text);
}

fn deterministic(table: &mut Table, results: &Results) {
    let transient = results.transient.as_ref();
    let end = transient.and_then(|it| it.times.last().copied().zip(it.distance.last().copied()?));
    if let Some((t, distance)) = end
        && distance.value > 0.02
    {
        let text = format!(
            "at t = {} the motion is not stationary yet: total-variation distance to the stationary law {:.2}",
            brief(t),
            0.5 * distance.value
        );
        table.line("");
        table.paragraph("note: ", &text);
    }
    if let Some(it) = &results.steady {
        let [nq, nv] = it.method.cells;
        let text = format!(
            "{nq} x {nv} cells, {}: L1 distance to the closed form {:.1e}, residual {:.1e}",
            it.method.name, it.l1_error.value, it.residual
        );
        table.line("");
        table.paragraph("steady state: ", &text);
    }
    if let Some(it) = &results.decay_rates {
        let rate = |rate: &DecayRate| {
            let re = cell(Some(Estimate {
                value: rate.re,
                error: rate.error,
                ..Estimate::default()
            }));
            match rate.im {
                0.0 => re,
                im => format!("{re} (a pair, ±{im:.4}i)"),
            }
        };
        let mut words: Vec<String> = it.rates.iter().map(rate).collect();
        if let Some(edge) = it.continuous_from {
            let edge = if edge.abs() < 100.0 {
                format!("{edge:.4}")
            } else {
                brief(rounded(edge, 5))
            };
            words.push(format!("continuous from {edge} on"));
        }
        table.line("");
        table.paragraph("decay rates:  ", &words.join(";  "));
    }
}

fn reach(table: &mut Table, results: &Results) {
    let (Some(it), Some(asked)) = (&results.reach, results.scene.outputs.reach) else {
        return;
    };
    let entry = asked.quantity.entry();
    let words = format!("reaches {} of its", brief(asked.fraction));
    table.line("");
    table.line(row(&format!("{:<8} {words}", entry.symbol), &[], false));
    let number =
        it.t.map_or("never".into(), |t| format!("t = {}", cell(Some(t))));
    table.line(format!("{:<8} stationary value at {number}", ""));
}

fn course(table: &mut Table, results: &Results) {
    let (deterministic, sampled) = (results.transient.as_ref(), results.monte_carlo.as_ref());
    let empty: (&[f64], &[Moments]) = (&[], &[]);
    let (times, moments) = deterministic.map_or(empty, |it| (&it.times, &it.moments));
    let paths = sampled.map_or(empty, |it| (&it.times, &it.moments));
    if times.is_empty() {
        return;
    }
    let heads = if sampled.is_some() {
        ["Monte Carlo", "z"]
    } else {
        ["", ""]
    };
    table.heading(format!(
        "{:<36}{:>17} {:>17}{:>7}",
        "ON THE WAY", "Fokker-Planck", heads[0], heads[1]
    ));
    let few = moments.last().is_some_and(|it| it.left_out != 0);
    let course = if few { &Moment::ALL[..] } else { &COURSE };
    for &moment in course {
        if moments.last().and_then(|it| it.get(moment)).is_none() {
            continue;
        }
        for (n, k) in spread(times.len()).into_iter().enumerate() {
            let t = times[k];
            let here = moments.get(k).and_then(|it| it.get(moment));
            let there = paths.0.iter().position(|it| *it == t);
            let there = there.and_then(|k| paths.1.get(k)?.get(moment));
            let entry = moment.entry();
            let (symbol, words) = if n == 0 {
                (entry.symbol, entry.words)
            } else {
                ("", "")
            };
            let time = format!("t = {}", brief(t));
            let both = [here, there];
            let numbers = cells(&both[..=usize::from(sampled.is_some())], true);
            table.line(format!("{symbol:<8} {words:<15}{time:>12}{numbers}"));
        }
    }
    if let Some(it) = deterministic {
        let [nq, nv] = it.method.cells;
        let text = format!(
            "{}, {nq} x {nv} cells, {} of at most {}",
            it.method.name,
            many(it.method.steps, "step"),
            brief(it.method.step)
        );
        table.line("");
        table.paragraph("Fokker-Planck: ", &text);
    }
    if let (Some(it), Some(scene)) = (sampled, &results.scene.monte_carlo) {
        let text = format!(
            "{}, {} paths, {} of {}; errors are one standard error",
            it.scheme,
            scene.paths,
            many(it.steps, "step"),
            brief(it.step)
        );
        table.paragraph("Monte Carlo:   ", &text);
    }
}

/// The law that lasts under a drive: its harmonics, multipliers and loss of contact.
fn periodic(table: &mut Table, results: &Results) {
    let (Some(it), Some(drive)) = (&results.periodic, results.scene.excitation.drive) else {
        return;
    };
    let heads = ["amplitude", "phase [rad]"];
    let head = heads.map(|it| format!("{it:>18}")).concat();
    table.heading(format!("{:<26}{head}", "THE LAW THAT LASTS"));
    for (symbol, all) in [
        ("E[q]", &it.mean_q),
        ("E[v]", &it.mean_v),
        ("E[N]", &it.mean_force),
    ] {
        for (k, harmonic) in (1..).zip(all).take(2) {
            let name = format!("{symbol:<8} harmonic {k}");
            let phase = Some(harmonic.phase).filter(|it| it.value.is_finite());
            table.line(row(&name, &[Some(harmonic.amplitude), phase], false));
        }
    }
    if let Some(lost) = it.contact_loss_probability {
        table.line(row("P(loss)  over a period", &[Some(lost)], false));
    }
    for (k, multiplier) in it.multipliers.iter().enumerate() {
        let name = if k == 0 { "Floquet multipliers" } else { "" };
        let sign = format!("{:.6}", multiplier.re);
        let imaginary = match multiplier.im {
            0.0 => String::new(),
            im => format!(" \u{b1} {im:.6}i"),
        };
        table.line(format!(
            "{name:<26} {sign}{imaginary}, error {:.0e}",
            multiplier.error
        ));
    }
    let left = it.multipliers.first().map(Multiplier::modulus);
    let memory = left
        .filter(|it| *it > 0.0 && *it < 1.0)
        .map_or(String::new(), |it| {
            format!(
                "; a deviation falls to a tenth in {:.3e} of time",
                drive.period() * 0.1f64.ln() / it.ln()
            )
        });
    let text = format!(
        "{} phases of the drive {} cos({} t + {}); from one period to the next the law changes by {:.0e} in L1{memory}",
        it.phase.len(),
        brief(drive.amplitude()),
        brief(drive.frequency()),
        brief(drive.phase()),
        it.residual
    );
    table.paragraph("", &text);
}

/// The response curve where it is highest, and at its ends.
fn response(table: &mut Table, results: &Results) {
    let Some(it) = &results.response else {
        return;
    };
    let heads = ["|E[q]| 1", "|E[N]| 1", "P(loss)"];
    let head = heads.map(|it| format!("{it:>18}")).concat();
    table.heading(format!("{:<26}{head}", "RESPONSE, frequency"));
    let count = it.frequency.len();
    let highest = (0..count).max_by(|a, b| {
        let value = |k: usize| it.mean_q_1[k].value;
        value(*a).total_cmp(&value(*b))
    });
    let mut shown = vec![0, count.saturating_sub(1)];
    shown.extend(highest);
    shown.sort_unstable();
    shown.dedup();
    for k in shown {
        let top = if Some(k) == highest { "  highest" } else { "" };
        let lost = it.contact_loss_probability.as_ref().map(|it| it[k]);
        let numbers = [Some(it.mean_q_1[k]), Some(it.mean_force_1[k]), lost];
        let name = format!("{}{top}", brief(it.frequency[k]));
        table.line(row(&name, &numbers, false));
    }
    table.line(format!(
        "{count} frequencies; the whole curve is in response.csv"
    ));
}

fn agreement(table: &mut Table, results: &Results) {
    let Some(it) = &results.agreement else {
        return;
    };
    let when =
        it.t.map_or("stationary".into(), |t| format!("at t = {}", brief(t)));
    let text = format!(
        "z = |difference| / error is at most {:.1} ({}, {when}) over {} pairs of numbers; chance alone \
         would give about {:.1}",
        it.worst, it.worst_of, it.compared, it.expected_worst
    );
    table.paragraph("agreement:     ", &text);
}

fn physical(table: &mut Table, results: &Results) {
    let Some(rig) = &results.scene.rig else {
        return;
    };
    table.heading(format!(
        "ON THE RIG of {} N, {} Hz, {:.3} um",
        rig.static_load(),
        rig.frequency(),
        rig.static_compression() * 1e6
    ));
    let sampled = results.physical_sampled(rig);
    if !sampled.is_empty() {
        table.line(format!(
            "{:<26}{:>18}{:>18}",
            "",
            origin(results),
            "long records"
        ));
    }
    let mut numbers: Vec<_> = results
        .physical(rig)
        .into_iter()
        .map(|(name, it)| (name, Some(it)))
        .collect();
    for (name, _) in &sampled {
        if !numbers.iter().any(|(it, _)| it == name) {
            numbers.push((*name, None));
        }
    }
    for (name, number) in numbers {
        let seen = sampled.iter().find(|(it, _)| *it == name).map(|it| it.1);
        let (name, unit, typed) = physical_words(name);
        let mut line = match number {
            Some(it) if typed => format!("{name:<26} {:>17}", brief(rounded(it.value, 6))),
            _ => row(name, &[number], false),
        };
        if !sampled.is_empty() {
            let seen = seen.map_or(String::new(), |it| cell(Some(it)));
            let _ = write!(line, " {seen:>17}");
        }
        table.line(format!("{line} {unit}"));
    }
}

fn foot(table: &mut Table, results: &Results) {
    let run = &results.run;
    let stages: Vec<String> = run
        .stages
        .iter()
        .map(|(name, time)| format!("{name} {}", seconds(*time)))
        .collect();
    let memory = run
        .peak_memory_bytes
        .map_or(String::new(), |it| format!(", {}", bytes(it)));
    let threads = if run.threads == 1 {
        "thread"
    } else {
        "threads"
    };
    let text = format!(
        "{} in all ({}; {} {threads}{memory})",
        seconds(run.wall_seconds),
        stages.join(", "),
        run.threads
    );
    table.line("");
    table.paragraph("time: ", &text);
    if results.falls_short() {
        let free = results.shortfalls.iter().filter(|(_, it)| it.free);
        let stages: Vec<&str> = free.map(|it| it.0).collect();
        let text = format!(
            "{} (exit status 3); the numbers stand with their errors",
            stages.join(", ")
        );
        table.paragraph("TOLERANCE NOT REACHED: ", &text);
    }
    for warning in &run.warnings {
        table.paragraph("warning: ", &warning.text);
    }
}

/// A plan as a table of at most 80 columns.
pub fn plan(plan: &Plan) -> String {
    let mut table = Table {
        text: String::new(),
        colour: false,
    };
    let scene = plan.scene();
    let oscillator = &scene.oscillator;
    table.paragraph(
        "",
        &format!(
            "{}: {} contact, {}zeta = {}, h = {}, T = {:.6}",
            scene.title,
            oscillator.contact().name(),
            damping(oscillator),
            brief(oscillator.zeta()),
            brief(oscillator.h()),
            oscillator.viscous_temperature()
        ),
    );
    table.line("");
    table.line(format!(
        "{:<17}{:>11}{:>8}{:>8}{:>8}  needed by",
        "stage", "cells", "steps", "memory", "time"
    ));
    for stage in plan.stages() {
        let cost = &stage.cost;
        let cells = cost
            .cells
            .map_or("no mesh".into(), |[q, v]| format!("{q} x {v}"));
        table.line(format!(
            "{:<17}{:>11}{:>8}{:>8}{:>8}  {}",
            stage.part.name(),
            cells,
            cost.steps,
            bytes(cost.memory_bytes),
            seconds(cost.seconds),
            stage.needed_by.join(", ").replace("outputs.", "")
        ));
    }
    table.line("");
    for stage in plan.stages() {
        table.paragraph(&format!("{:<18}", stage.part.name()), &stage.cost.method);
    }
    table.line("");
    let memory = plan
        .stages()
        .iter()
        .map(|it| it.cost.memory_bytes)
        .max()
        .unwrap_or(0);
    let time: f64 = plan.stages().iter().map(|it| it.cost.seconds).sum();
    let text = format!(
        "in all: about {} and {} on {} threads; allowed: {} and {}",
        seconds(time),
        bytes(memory),
        rayon::current_num_threads(),
        seconds(scene.accuracy.max_seconds),
        bytes(scene.accuracy.max_memory)
    );
    table.paragraph("", &text);
    let refines = |it: &Stage| {
        matches!(
            it.part,
            Part::Transient | Part::FirstLoss | Part::FirstPassage
        )
    };
    if scene.method.cells.is_none() && plan.stages().iter().any(refines) {
        let text = "refinement may multiply this time";
        table.paragraph("", text);
    }
    let left_out: Vec<&str> = [
        (Part::Stationary, "closed form"),
        (Part::Crossings, "crossings"),
        (Part::FirstLoss, "first loss"),
        (Part::FirstLossPaths, "paths of the first loss"),
        (Part::FirstPassage, "first passage"),
        (Part::FirstPassagePaths, "paths of the first passage"),
        (Part::Transient, "transient"),
        (Part::Reach, "time to a level"),
        (Part::Steady, "steady state"),
        (Part::DecayRates, "decay rates"),
        (Part::Spectrum, "spectrum"),
        (Part::MonteCarlo, "paths"),
        (Part::Series, "Welch's spectrum"),
        (Part::Records, "long records"),
    ]
    .into_iter()
    .filter(|(part, _)| !plan.has(*part))
    .map(|(_, what)| what)
    .collect();
    if !left_out.is_empty() {
        table.paragraph("not asked for, not computed: ", &left_out.join(", "));
    }
    if time > scene.accuracy.max_seconds {
        let text = "expected to stop at accuracy.max_seconds with exit status 3";
        table.paragraph("warning: ", text);
    }
    table.text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::text::{BUILT_IN, SceneText};

    #[test]
    fn the_plan_of_every_built_in_scene_fits_80_columns_and_says_what_it_leaves_out() {
        for (name, text) in BUILT_IN {
            let text = SceneText::parse(name, text, &[]).unwrap();
            let text = plan(&Plan::of(text.scene()).unwrap());
            assert!(
                text.lines().all(|line| line.chars().count() <= 80),
                "{text}"
            );
            assert!(text.contains("not asked for, not computed:"), "{text}");
            let flat = text.split_whitespace().collect::<Vec<_>>().join(" ");
            let most = flat.ends_with(
                "not computed: crossings, first loss, paths of the first loss, first passage, paths of the first \
                 passage, time to a level, spectrum, Welch's spectrum, long records",
            );
            assert_eq!(most, *name == "default", "{text}");
        }
    }

    #[test]
    fn the_times_shown_are_spread_and_end_with_the_last() {
        assert_eq!(spread(0), Vec::<usize>::new());
        assert_eq!(spread(3), [0, 1, 2]);
        assert_eq!(spread(600), [99, 199, 299, 399, 499, 599]);
    }

    #[test]
    fn long_text_is_broken_at_blanks() {
        let lines = wrap(&"word ".repeat(40), 30);
        assert!(lines.iter().all(|line| line.chars().count() <= 30) && lines.len() == 7);
    }
}
