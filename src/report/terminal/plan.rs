//! A plan on the terminal.

use super::layout::Table;
use crate::format::{brief, bytes, seconds};
use crate::plan::{Part, Plan, Stage};

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
            "{}: {}, {}zeta = {}, h = {}, T = {}",
            scene.title,
            oscillator.contact().described(),
            oscillator.damping().words(),
            brief(oscillator.zeta()),
            brief(oscillator.h()),
            brief(oscillator.viscous_temperature())
        ),
    );
    table.line("");
    costs(&mut table, plan);
    table.line("");
    let stages = || plan.stages().iter();
    let memory = stages().map(Stage::memory_bytes).max().unwrap_or(0);
    let time: f64 = stages().map(Stage::seconds).sum();
    let text = format!(
        "in all: about {} and {} on {} threads; allowed: {} and {}",
        seconds(time),
        bytes(memory),
        plan.threads(),
        seconds(scene.accuracy.max_seconds),
        bytes(scene.accuracy.max_memory)
    );
    table.paragraph("", &text);
    let refines = |it: &Stage| {
        matches!(
            it.part,
            Part::Transient | Part::FirstLoss | Part::FirstPassage
        ) && it.cost.cells.is_some()
    };
    if scene.method.cells.is_none() && stages().any(refines) {
        table.paragraph("", "refinement may multiply time and memory");
    }
    let mut left_out: Vec<Part> = Part::ALL.into_iter().filter(|it| !plan.has(*it)).collect();
    left_out.sort_unstable();
    if !left_out.is_empty() {
        let words: Vec<&str> = left_out.into_iter().map(Part::words).collect();
        table.paragraph("not asked for, not computed: ", &words.join(", "));
    }
    for doubt in scene.doubts() {
        table.paragraph("warning: ", &doubt);
    }
    if time > scene.accuracy.max_seconds {
        let text = "expected to stop at accuracy.max_seconds with exit status 3";
        table.paragraph("warning: ", text);
    }
    table.text
}

/// The stages with their costs, and how each will be computed.
fn costs(table: &mut Table, plan: &Plan) {
    table.line(format!(
        "{:<19} {:>11} {:>7} {:>7} {:>7}  needed by",
        "stage", "cells", "steps", "memory", "time"
    ));
    for stage in plan.stages() {
        let cost = &stage.cost;
        let cells = cost.cells.map(|[q, v]| format!("{q} x {v}"));
        let [cells, steps, memory, time] = match stage.refusal {
            Some(_) => [""; 4].map(|_| "-".into()),
            None => {
                let (memory, time) = (bytes(cost.memory), seconds(cost.seconds));
                [
                    cells.unwrap_or("no mesh".into()),
                    cost.steps.to_string(),
                    memory,
                    time,
                ]
            }
        };
        let (name, keys) = (stage.part.name(), stage.needed_by.join(", "));
        let keys = keys.replace("outputs.", "");
        table.line(format!(
            "{name:<19} {cells:>11} {steps:>7} {memory:>7} {time:>7}  {keys}"
        ));
    }
    table.line("");
    for stage in plan.stages() {
        let name = format!("{:<21}", stage.part.name());
        match &stage.refusal {
            Some(it) => table.paragraph(&name, &format!("not run: {}", it.unanswered())),
            None => table.paragraph(&name, &stage.method),
        }
    }
}
