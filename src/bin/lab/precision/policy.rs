//! What do the numbers that were chosen do? Each a fifth higher and a fifth lower, over the scenes of the calibration and those
//! of every other question: what the runs then take, and how true their error estimates are.

use super::calibration::{Calibration, End, Run};
use super::questions::{Answer, Question};
use super::references::Case;
use std::fmt::Write;
use vibroimpact::Result;
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
    /// Of each scene and tolerance unknowns times steps or solves of the finest run; None without an answer, or where it does
    /// not say.
    work: Vec<Option<f64>>,
    seconds: f64,
    answers: usize,
    numbers: usize,
    beyond: usize,
    /// The largest error over its estimate among these.
    worst: f64,
    /// Medians of estimate over error, of each tolerance or question, their geometric mean.
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
        let medians: Vec<f64> = verdicts.iter().map(|it| it.median).collect();
        Self {
            work: work.collect(),
            seconds: verdicts.iter().map(|it| it.seconds).sum(),
            answers,
            numbers: verdicts.iter().map(|it| it.numbers).sum(),
            beyond: wrong.len(),
            worst: wrong
                .first()
                .map_or(0.0, |(_, it)| it.error() / it.estimate),
            median: geometric_mean(&medians),
        }
    }

    /// That of every other question.
    fn of_questions(questions: &[Question]) -> Self {
        let answers: Vec<Answer> = questions.iter().map(Question::answer).collect();
        let judged = || answers.iter().flat_map(|it| &it.numbers);
        let beyond = judged().filter(|it| Answer::is_beyond(it));
        let ratios = judged().filter_map(Answer::ratio);
        let medians: Vec<f64> = answers.iter().filter_map(Answer::median).collect();
        Self {
            work: answers.iter().map(|it| it.work).collect(),
            seconds: answers.iter().map(|it| it.seconds).sum(),
            answers: answers.iter().filter(|it| it.met).count(),
            numbers: judged().count(),
            beyond: beyond.count(),
            worst: 1.0 / ratios.fold(f64::INFINITY, f64::min),
            median: geometric_mean(&medians),
        }
    }

    /// Geometric mean of the work over that of `base`, of the runs that answer in both.
    fn work_over(&self, base: &Self) -> f64 {
        let pairs = self.work.iter().zip(&base.work);
        let ratios: Vec<f64> = pairs
            .filter_map(|(a, b)| Some(a.as_ref()? / b.as_ref()?))
            .collect();
        geometric_mean(&ratios)
    }

    /// Whether neither work nor what is known of the estimates differs from `base` by more than [`NOTHING`].
    fn is_like(&self, base: &Self) -> bool {
        let near = |ratio: f64| (ratio - 1.0).abs() <= NOTHING;
        near(self.work_over(base))
            && near(self.median / base.median)
            && (self.answers, self.beyond) == (base.answers, base.beyond)
    }
}

fn geometric_mean(all: &[f64]) -> f64 {
    let logarithms = all.iter().map(|it| it.ln());
    (logarithms.sum::<f64>() / all.len().max(1) as f64).exp()
}

/// Transients, and every other question.
type Both = [Outcome; 2];

/// A row of the table, moved down and up.
struct Row {
    chosen: &'static Chosen,
    moved: [Both; 2],
}

/// The survey.
pub struct Policy {
    base: Both,
    rows: Vec<Row>,
}

/// The names of the numbers that were chosen.
pub fn names() -> impl Iterator<Item = &'static str> + Clone {
    ALL.iter().map(|it| it.name)
}

/// How many times the survey runs its cases.
pub fn count(wants: &dyn Fn(&str) -> bool) -> usize {
    1 + FACTORS.len() * ALL.iter().filter(|it| wants(it.name)).count()
}

impl Policy {
    /// Moves each of the wanted numbers, one after the other; `watch` is told what has been run.
    ///
    /// # Errors
    /// What the reference of a question says.
    pub fn of(cases: &[Case], wants: &dyn Fn(&str) -> bool, watch: &dyn Fn(&str)) -> Result<Self> {
        let brief = |case: &&Case| {
            let runs = TOLERANCES.map(|tolerance| Run::of(case, tolerance).seconds);
            runs.iter().sum::<f64>() < LONG
        };
        let cases: Vec<Case> = cases.iter().filter(brief).cloned().collect();
        let questions = Question::all()?;
        let both = || [Outcome::of(&cases), Outcome::of_questions(&questions)];
        let base = both();
        watch("as they stand");
        let rows = ALL.iter().filter(|it| wants(it.name)).map(|chosen| {
            let moved = FACTORS.map(|factor| {
                chosen.multiply(factor);
                let outcomes = both();
                chosen.multiply(1.0);
                watch(chosen.name);
                outcomes
            });
            Row { chosen, moved }
        });
        let rows = rows.collect();
        Ok(Self { base, rows })
    }

    /// Names of those that do nothing here, up or down.
    pub fn idle(&self) -> Vec<&'static str> {
        let like = |it: &Both| it.iter().zip(&self.base).all(|(it, base)| it.is_like(base));
        let idle = self.rows.iter().filter(|row| row.moved.iter().all(like));
        idle.map(|row| row.chosen.name).collect()
    }

    /// The table as a page.
    pub fn page(&self) -> File {
        let mut text = String::from(
            "# The numbers that were chosen\n\n\
             What each does, a fifth lower and a fifth higher: `cargo run --release --bin lab -- policy`. Transients are those scenes\n\
             of the calibration that take less than half a processor second, at tolerances of 1e-2 and 1e-3; other questions are those of\n\
             [questions.toml](questions.toml), each held against itself at a tenth of its tolerance. Work is unknowns times steps or solves of\n\
             the finest run, the geometric mean over the runs; beyond are numbers whose error is above its estimate; median is that of\n\
             estimate over error at a tolerance or of a question, the geometric mean over these.\n\n",
        );
        for (what, it) in ["Transients", "Other questions"].iter().zip(&self.base) {
            let _ = writeln!(
                text,
                "{what}, as they stand: {} of {} runs meet their tolerance, {} of {} numbers beyond, {:.1} times at most, median {:.1}, \
                 {:.0} processor seconds.\n",
                it.answers,
                it.work.len(),
                it.beyond,
                it.numbers,
                it.worst,
                it.median,
                it.seconds
            );
        }
        text.push_str(
            "| name | value | transients: work | beyond | at most | median | others: work | beyond | at most | median | what it trades |\n\
             |---|---|---|---|---|---|---|---|---|---|---|\n",
        );
        for Row { chosen, moved } in &self.rows {
            let _ = write!(text, "| `{}` | {} |", chosen.name, chosen.get());
            for (k, base) in self.base.iter().enumerate() {
                let mut put = |of: &dyn Fn(&Outcome) -> String| {
                    let _ = write!(text, " {}, {} |", of(&moved[0][k]), of(&moved[1][k]));
                };
                put(&|it| format!("{:.2}", it.work_over(base)));
                put(&|it| it.beyond.to_string());
                put(&|it| format!("{:.1}", it.worst));
                put(&|it| format!("{:.1}", it.median));
            }
            let _ = writeln!(text, " {} |", chosen.trades);
        }
        let idle = self.idle();
        let names = idle.iter().map(|it| format!("`{it}`")).collect::<Vec<_>>();
        let _ = writeln!(
            text,
            "\n{} of {} change here neither work nor median by more than 3 %, nor how many runs meet their tolerance and how many numbers \
             are beyond: {}.",
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
        let same = || outcome(100.0, 1, 10.0);
        let base = [same(), same()];
        let transients = |a, b| [[a, same()], [b, same()]];
        let others = |a, b| [[same(), a], [same(), b]];
        let moved = [
            transients(outcome(102.0, 1, 10.1), outcome(99.0, 1, 10.0)),
            others(outcome(98.0, 1, 10.0), outcome(101.0, 1, 10.2)),
            transients(same(), outcome(110.0, 1, 10.0)),
            transients(outcome(100.0, 2, 10.0), same()),
            others(outcome(100.0, 1, 9.0), same()),
            others(same(), outcome(120.0, 1, 10.0)),
        ];
        let rows = ALL.iter().zip(moved);
        let rows = rows.map(|(chosen, moved)| Row { chosen, moved }).collect();
        let policy = Policy { base, rows };
        assert_eq!(policy.idle(), [ALL[0].name, ALL[1].name]);
        let page = String::from_utf8(policy.page().bytes).unwrap();
        for row in &policy.rows {
            assert!(page.contains(row.chosen.trades), "{page}");
        }
        assert!(page.contains("1.00, 1.10"), "{page}");
        assert!(page.contains("2 of 6 change"), "{page}");
    }
}
