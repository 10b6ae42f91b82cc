//! The table on the terminal: 80 columns, readable by a stranger.

mod course;
mod driven;
mod layout;
mod passage;
mod plan;
mod stationary;

#[cfg(feature = "cli")]
pub(crate) use layout::wrap;
pub use plan::plan;

use crate::clock::TimeUnit;
use crate::estimate::Lack;
use crate::format::{brief, bytes, many, seconds};
use crate::results::Results;
use course::{course, deterministic, reach, spectrum};
use driven::{periodic, response};
use layout::Table;
use passage::{first_loss, first_passage};
use stationary::{crossings, physical, records, stationary};

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
    let mut title: String = results.scene.title.chars().take(50).collect();
    if title.len() < results.scene.title.len() {
        title.push('\u{2026}');
    }
    let version = env!("CARGO_PKG_VERSION");
    table.bold(&format!("vibroimpact {version}: {title}"));
    let text = format!(
        "{}, {}damping ratio zeta\u{a0}=\u{a0}{}, input level h\u{a0}=\u{a0}{}, \
         T\u{a0}=\u{a0}{}",
        oscillator.contact().described(),
        oscillator.damping().words(),
        brief(oscillator.zeta()),
        brief(oscillator.h()),
        brief(oscillator.viscous_temperature())
    );
    table.paragraph("", &text);
    let text = match results.scene.clock().unit() {
        TimeUnit::Dimensionless => "All numbers dimensionless",
        TimeUnit::Period => "Times in periods 2 pi/Omega, rates per period, all else dimensionless",
        TimeUnit::Second => "Times in seconds, rates per second, all else dimensionless",
    };
    let text = format!("{text}; each number is printed with its error (\"value ± error\").");
    table.paragraph("", &text);
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

/// What the program was free to do better, by what is lacking.
fn lacking(table: &mut Table, results: &Results) {
    let [short, cut, none] = ["TOLERANCE NOT REACHED: ", "CUT SHORT: ", "NO ANSWER: "];
    let head_of = |it: &Lack| match it {
        Lack::Accuracy { .. } => short,
        Lack::Paths { .. } => cut,
        Lack::Answer => none,
    };
    let stand = "; the numbers stand with their errors";
    for (head, end) in [(short, stand), (cut, stand), (none, "")] {
        let such = results.shortfalls.iter();
        let such = such.filter(|(_, it)| it.free && head_of(&it.lack) == head);
        let stages: Vec<&str> = such.map(|it| it.0).collect();
        if !stages.is_empty() {
            let text = format!("{} (exit status 3){end}", stages.join(", "));
            table.paragraph(head, &text);
        }
    }
}

fn foot(table: &mut Table, results: &Results) {
    let run = &results.run;
    let stages = run.stages.iter();
    let stages = stages.map(|(name, time)| format!("{name} {}", seconds(*time)));
    let stages = stages.collect::<Vec<_>>().join(", ");
    let memory = run.peak_memory_bytes.map(|it| format!(", {}", bytes(it)));
    let memory = memory.unwrap_or_default();
    let all = seconds(run.wall_seconds);
    let threads = many(run.threads as u64, "thread");
    let text = format!("{all} in all ({stages}; {threads}{memory})");
    table.line("");
    table.paragraph("time: ", &text);
    lacking(table, results);
    for warning in &run.warnings {
        table.paragraph("warning: ", &warning.text);
    }
}
