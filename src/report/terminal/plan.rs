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
            "{}: {} contact, {}zeta = {}, h = {}, T = {:.6}",
            scene.title,
            oscillator.contact().name(),
            oscillator.damping().words(),
            brief(oscillator.zeta()),
            brief(oscillator.h()),
            oscillator.viscous_temperature()
        ),
    );
    table.line("");
    table.line(format!(
        "{:<20}{:>11}{:>8}{:>8}{:>8}  needed by",
        "stage", "cells", "steps", "memory", "time"
    ));
    for stage in plan.stages() {
        let cost = &stage.cost;
        let cells = cost
            .cells
            .map_or("no mesh".into(), |[q, v]| format!("{q} x {v}"));
        table.line(format!(
            "{:<20}{:>11}{:>8}{:>8}{:>8}  {}",
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
        table.paragraph(&format!("{:<21}", stage.part.name()), &stage.cost.method);
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
    refused(&mut table, plan);
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

/// Stages that do not fit the memory.
fn refused(table: &mut Table, plan: &Plan) {
    let most = plan.scene().accuracy.max_memory;
    for stage in plan.stages() {
        if stage.cost.memory_bytes > most {
            let text = format!("{} does not fit: it will not be run", stage.part.name());
            table.paragraph("", &text);
        }
    }
}
