//! What do the numbers that were chosen do? Each a fifth higher and a fifth lower, over the scenes of the calibration: what the
//! runs then take, and how true their error estimates are.

use super::calibration::{Calibration, End, Run};
use super::references::Case;
use std::fmt::Write;
use vibroimpact::fokker_planck::policy::{ALL, Chosen};
use vibroimpact::report::File;

/// Tolerances of the survey: the first two of the calibration, which most scenes are run at.
pub const TOLERANCES: [f64; 2] = [1e-2, 1e-3];

/// Processor seconds, as things stand, from which on a scene is left out.
const LONG: f64 = 0.5;

/// By how much each is moved.
const FACTORS: [f64; 2] = [0.8, 1.2];

/// A change of work or of the median below which a number does nothing.
const NOTHING: f64 = 0.03;

/// What the runs of a survey came to.
#[derive(Debug, Clone, PartialEq)]
struct Outcome {
    /// Cells times steps of the finest run of each scene and tolerance; None without an answer.
    work: Vec<Option<f64>>,
    seconds: f64,
    answers: usize,
    numbers: usize,
    beyond: usize,
    /// The largest error over its estimate among these.
    worst: f64,
    /// Medians of estimate over error, their geometric mean.
    median: f64,
}

impl Outcome {
    fn of(cases: &[Case]) -> Self {
        let it = Calibration::of(cases, &TOLERANCES, &|_| ());
        let verdicts = it.verdicts();
        let work = it.runs.iter().map(|run| {
            let until = run.numbers.last()?.reference.t;
            let ([nq, nv], step) = run.chosen?;
            Some((nq * nv) as f64 * (until / step).ceil())
        });
        let answers = it.runs.iter().filter(|run| run.end == End::Met).count();
        let wrong = it.wrong();
        let logarithms = verdicts.iter().map(|it| it.median.ln());
        Self {
            work: work.collect(),
            seconds: verdicts.iter().map(|it| it.seconds).sum(),
            answers,
            numbers: verdicts.iter().map(|it| it.numbers).sum(),
            beyond: wrong.len(),
            worst: wrong
                .first()
                .map_or(0.0, |(_, it)| it.error() / it.estimate),
            median: (logarithms.sum::<f64>() / verdicts.len() as f64).exp(),
        }
    }

    /// Geometric mean of the work over that of `base`, of the runs that answer in both.
    fn work_over(&self, base: &Self) -> f64 {
        let pairs = self.work.iter().zip(&base.work);
        let ratios: Vec<f64> = pairs
            .filter_map(|(a, b)| Some((a.as_ref()? / b.as_ref()?).ln()))
            .collect();
        (ratios.iter().sum::<f64>() / ratios.len().max(1) as f64).exp()
    }

    /// Whether neither work nor what is known of the estimates differs from `base` by more than [`NOTHING`].
    fn is_like(&self, base: &Self) -> bool {
        let near = |ratio: f64| (ratio - 1.0).abs() <= NOTHING;
        near(self.work_over(base))
            && near(self.median / base.median)
            && (self.answers, self.beyond) == (base.answers, base.beyond)
    }
}

/// A row of the table, moved down and up.
struct Row {
    chosen: &'static Chosen,
    moved: [Outcome; 2],
}

/// The survey.
pub struct Policy {
    base: Outcome,
    rows: Vec<Row>,
}

/// How many times the survey runs its cases.
pub fn count(wants: &dyn Fn(&str) -> bool) -> usize {
    1 + FACTORS.len() * ALL.iter().filter(|it| wants(it.name)).count()
}

impl Policy {
    /// Moves each of the wanted numbers, one after the other; `watch` is told what has been run.
    pub fn of(cases: &[Case], wants: &dyn Fn(&str) -> bool, watch: &dyn Fn(&str)) -> Self {
        let brief = |case: &&Case| {
            let runs = TOLERANCES.map(|tolerance| Run::of(case, tolerance).seconds);
            runs.iter().sum::<f64>() < LONG
        };
        let cases: Vec<Case> = cases.iter().filter(brief).cloned().collect();
        let base = Outcome::of(&cases);
        watch("as they stand");
        let rows = ALL.iter().filter(|it| wants(it.name)).map(|chosen| {
            let moved = FACTORS.map(|factor| {
                chosen.multiply(factor);
                let outcome = Outcome::of(&cases);
                chosen.multiply(1.0);
                watch(chosen.name);
                outcome
            });
            Row { chosen, moved }
        });
        let rows = rows.collect();
        Self { base, rows }
    }

    /// Names of those that do nothing here, up or down.
    pub fn idle(&self) -> Vec<&'static str> {
        let idle = self
            .rows
            .iter()
            .filter(|row| row.moved.iter().all(|it| it.is_like(&self.base)));
        idle.map(|row| row.chosen.name).collect()
    }

    /// The table as a page.
    pub fn page(&self) -> File {
        let mut text = String::from(
            "# The numbers that were chosen\n\n\
             What each does, a fifth lower and a fifth higher, in those scenes of the calibration that take less than half\n\
             a processor second, at tolerances of 1e-2 and 1e-3:\n\
             `cargo run --release --bin lab -- policy`. Work is cells times steps of the finest run, the geometric mean over the runs;\n\
             beyond are numbers whose error is above its estimate; median is that of estimate over error.\n\n",
        );
        let _ = writeln!(
            text,
            "As they stand: {} of {} runs meet their tolerance, {} of {} numbers beyond, {:.1} times at most, median {:.1}, {:.0} processor \
             seconds.\n\n\
             | name | value | work | beyond | at most | median | what it trades |\n|---|---|---|---|---|---|---|",
            self.base.answers,
            self.base.work.len(),
            self.base.beyond,
            self.base.numbers,
            self.base.worst,
            self.base.median,
            self.base.seconds
        );
        for Row { chosen, moved } in &self.rows {
            let both =
                |of: &dyn Fn(&Outcome) -> String| format!("{}, {}", of(&moved[0]), of(&moved[1]));
            let _ = writeln!(
                text,
                "| `{}` | {} | {} | {} | {} | {} | {} |",
                chosen.name,
                chosen.get(),
                both(&|it| format!("{:.2}", it.work_over(&self.base))),
                both(&|it| it.beyond.to_string()),
                both(&|it| format!("{:.1}", it.worst)),
                both(&|it| format!("{:.1}", it.median)),
                chosen.trades
            );
        }
        let idle = self.idle();
        let names = idle.iter().map(|it| format!("`{it}`")).collect::<Vec<_>>();
        let _ = writeln!(
            text,
            "\n{} of {} change here neither work nor median by more than 3 %, nor how many runs answer and how many numbers are beyond: {}.",
            idle.len(),
            self.rows.len(),
            if names.is_empty() {
                "none".into()
            } else {
                names.join(", ")
            }
        );
        File::text("policy.md", text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(work: f64, beyond: usize, median: f64) -> Outcome {
        Outcome {
            work: vec![Some(work), None, Some(2.0 * work)],
            seconds: 1.0,
            answers: 2,
            numbers: 20,
            beyond,
            worst: 1.0,
            median,
        }
    }

    #[test]
    fn what_changes_neither_work_nor_estimates_is_named_and_nothing_else() {
        let base = outcome(100.0, 1, 10.0);
        let moved = [
            [outcome(102.0, 1, 10.1), outcome(99.0, 1, 10.0)],
            [outcome(100.0, 1, 10.0), outcome(110.0, 1, 10.0)],
            [outcome(100.0, 2, 10.0), outcome(100.0, 1, 10.0)],
            [outcome(100.0, 1, 9.0), outcome(100.0, 1, 10.0)],
        ];
        let rows = ALL.iter().zip(moved);
        let rows = rows.map(|(chosen, moved)| Row { chosen, moved }).collect();
        let policy = Policy { base, rows };
        assert_eq!(policy.idle(), [ALL[0].name]);
        let page = String::from_utf8(policy.page().bytes).unwrap();
        for row in &policy.rows {
            assert!(page.contains(row.chosen.trades), "{page}");
        }
        assert!(page.contains("1.00, 1.10"), "{page}");
        assert!(page.contains("1 of 4 change"), "{page}");
    }
}
