//! Are error estimates true where the scene takes the wheel? Every case of the calibration once more, with cells, steps or
//! schemes given.

use super::calibration::{self, Calibration, Run};
use super::judged::Judged;
use super::references::Case;
use std::fmt::Write;
use vibroimpact::fokker_planck::{Drift, TimeScheme, TransientMethod};
use vibroimpact::scene::MethodChoice;

/// The tolerance of the runs, and of the free ones that cells and steps are taken from.
pub const TOLERANCE: f64 = 1e-3;

/// Seconds after which a run is stopped: schemes that nobody would choose for a scene are not waited for.
const MAX_SECONDS: f64 = 2.0;

/// What a scene gives: its name, and how, from cells and steps that the program chose.
type Given = (&'static str, fn(&mut MethodChoice, ([usize; 2], f64)));

const ALL: [Given; 10] = [
    ("cells", |it, (cells, _)| it.cells = Some(cells)),
    ("step", |it, (_, step)| it.step = Some(step)),
    ("cells and step", |it, (cells, step)| {
        (it.cells, it.step) = (Some(cells), Some(step));
    }),
    ("cells, drift = 2", |it, (cells, _)| {
        (it.cells, it.drift) = (Some(cells), Some(Drift::Order2));
    }),
    ("cells, drift = 4", |it, (cells, _)| {
        (it.cells, it.drift) = (Some(cells), Some(Drift::Order4));
    }),
    ("transient = \"finite_volume\"", |it, _| {
        it.transient = Some(TransientMethod::FiniteVolume);
    }),
    ("drift = 4, time = \"explicit\"", |it, _| {
        (it.drift, it.time) = (Some(Drift::Order4), Some(TimeScheme::Explicit));
    }),
    ("drift = 8, time = \"imex\"", |it, _| {
        (it.drift, it.time) = (Some(Drift::Order8), Some(TimeScheme::Imex));
    }),
    ("drift = 8, time = \"implicit\"", |it, _| {
        (it.drift, it.time) = (Some(Drift::Order8), Some(TimeScheme::Implicit));
    }),
    ("drift = 8, time = \"backward_euler\"", |it, _| {
        (it.drift, it.time) = (Some(Drift::Order8), Some(TimeScheme::BackwardEuler));
    }),
];

/// The runs of every case by each method to give something that is wanted, after the free ones of `calibration`;
/// `watch` is told each run.
pub fn by_hand(
    cases: &[Case],
    calibration: &Calibration,
    wants: &dyn Fn(&str) -> bool,
    watch: &dyn Fn(&Run),
) -> Vec<(&'static str, Calibration)> {
    let free = |number: usize| {
        let mut runs = calibration.runs.iter();
        let run = runs.find(|it| it.scene == number && it.tolerance == TOLERANCE);
        run.and_then(|it| it.chosen)
    };
    let of = |(name, give): Given| {
        let runs = cases.iter().filter_map(|case| {
            let mut case = case.clone();
            give(&mut case.scene.method, free(case.number)?);
            case.scene.accuracy.max_seconds = MAX_SECONDS;
            let run = Run::of(&case, TOLERANCE);
            watch(&run);
            Some(run)
        });
        (name, Calibration::from_runs(TOLERANCE, runs.collect()))
    };
    ALL.into_iter().filter(|it| wants(it.0)).map(of).collect()
}

/// The names of what is given by hand.
pub fn names() -> impl Iterator<Item = &'static str> + Clone {
    ALL.iter().map(|it| it.0)
}

/// How many runs [`by_hand`] makes.
pub fn count(cases: &[Case]) -> usize {
    ALL.len() * cases.len()
}

/// Numbers beyond their estimate that are named, of each of them.
const NAMED: usize = 3;

/// The table, and below it the numbers farthest beyond their estimate.
pub fn table(all: &[(&str, Calibration)]) -> String {
    let mut text = format!(
        "\nGiven by hand, tolerance {TOLERANCE:e}\n{:<38}  answers  numbers  beyond their estimate  at most  median\n",
        ""
    );
    for (name, it) in all {
        let judged = it.runs.iter().flat_map(|run| &run.numbers);
        let judged = judged.filter(|it| it.counts(TOLERANCE));
        let over = |it: &Judged| (it.error() - it.doubt()) / it.estimate;
        let most = judged.map(over).fold(0.0, f64::max);
        for it in it.verdicts() {
            let (numbers, beyond) = (it.numbers, it.too_small);
            let share = 100.0 * beyond as f64 / numbers.max(1) as f64;
            let _ = writeln!(
                text,
                "{name:<38}  {:>7}  {numbers:>7}  {beyond:>11} = {share:>5.2} %  {most:>7.1}  {:>6.1}",
                it.answered, it.median
            );
        }
    }
    for (name, it) in all {
        for (run, number) in it.wrong().into_iter().take(NAMED) {
            let _ = writeln!(text, "{name}:{}", calibration::line(run, number));
        }
    }
    text
}
