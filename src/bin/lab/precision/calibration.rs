//! Are the error estimates true? Scenes of every kind at several tolerances, every number held against what it
//! is known to be.

use super::clock::Clock;
use super::judged::{DOUBT, Judged};
use super::references::{Case, Reference};
use super::verdict::{GOALS, Verdict};
use std::fmt::{self, Write};
use vibroimpact::error::Error;
use vibroimpact::plan::{Plan, Stage};
use vibroimpact::report::File;
use vibroimpact::results::Results;
use vibroimpact::scales::Scales;

/// Tolerances of the table.
pub const TOLERANCES: [f64; 4] = [1e-2, 1e-3, 1e-4, 1e-5];

/// Seconds after which a run is stopped; it then counts as one that says it did not reach the tolerance.
pub const MAX_SECONDS: f64 = 20.0;

/// Factor within which a plan should foresee the time of a run.
pub const FORESEEN: f64 = 3.0;

/// Most that a run may take over one of a tighter tolerance.
const DEARER: f64 = 1.3;

/// Seconds in which processor time is counted.
const TICK: f64 = 0.01;

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// The tolerance is met, as far as the run knows: exit status 0.
    Met,
    /// There are numbers, and it is said that they are short of the tolerance: exit status 3.
    Short,
    /// A limit was reached: exit status 3 without numbers.
    Stopped,
    Refused(String),
}

#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    pub scene: usize,
    pub tolerance: f64,
    pub end: End,
    pub seconds: f64,
    /// Seconds by the clock on the wall, and those of its plan.
    pub elapsed: f64,
    pub planned: f64,
    /// Cells and step of the finest run.
    pub chosen: Option<([usize; 2], f64)>,
    /// Every number that has a reference.
    pub numbers: Vec<Judged>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    tolerances: Vec<f64>,
    /// By scene, then tolerance.
    pub runs: Vec<Run>,
}

impl Calibration {
    /// Runs every case at every tolerance, one after the other, however each ends; `watch` is told each run.
    pub fn of(cases: &[Case], tolerances: &[f64], watch: &dyn Fn(&Run)) -> Self {
        let mut runs = Vec::new();
        for case in cases {
            for &tolerance in tolerances {
                let run = Run::of(case, tolerance);
                watch(&run);
                runs.push(run);
            }
        }
        Self {
            tolerances: tolerances.to_vec(),
            runs,
        }
    }

    /// The judge of some runs at one tolerance.
    pub fn from_runs(tolerance: f64, runs: Vec<Run>) -> Self {
        Self {
            tolerances: vec![tolerance],
            runs,
        }
    }

    /// The judgements, one a tolerance.
    pub fn verdicts(&self) -> Vec<Verdict> {
        let of = |tolerance: &f64| self.verdict(*tolerance);
        self.tolerances.iter().map(of).collect()
    }

    /// The goals that are missed at any tolerance, in words.
    pub fn missed(&self) -> Vec<String> {
        self.verdicts().iter().flat_map(Verdict::missed).collect()
    }

    fn verdict(&self, tolerance: f64) -> Verdict {
        let runs = || self.runs.iter().filter(|run| run.tolerance == tolerance);
        let count = |end: fn(&End) -> bool| runs().filter(|run| end(&run.end)).count();
        let all = || runs().flat_map(|run| run.numbers.iter().map(move |it| (run, it)));
        let judged = || all().filter(|(_, it)| it.counts(tolerance));
        let ratios = judged().filter_map(|(_, it)| it.ratio()).collect();
        Verdict {
            tolerance,
            answered: count(|end| matches!(end, End::Met | End::Short)),
            short: count(|end| *end == End::Short),
            stopped: count(|end| *end == End::Stopped),
            refused: count(|end| matches!(end, End::Refused(_))),
            numbers: judged().count(),
            left_out: all().count() - judged().count(),
            too_small: judged().filter(|(_, it)| it.too_small()).count(),
            too_small_bare: judged().filter(|(_, it)| it.too_small_bare()).count(),
            unsaid: all()
                .filter(|(run, it)| run.end == End::Met && it.beyond(tolerance))
                .count(),
            median: median(ratios),
            foreseen: runs().filter(|run| run.is_foreseen()).count(),
            seconds: runs().map(|run| run.seconds).sum(),
        }
    }

    /// Pairs of runs of a scene that both met their tolerances, and of them those whose looser one took more than
    /// [`DEARER`] times the processor time of the tighter one.
    pub fn dearer(&self) -> [usize; 2] {
        let met = || self.runs.iter().filter(|it| it.end == End::Met);
        let pairs = met().flat_map(|loose| {
            let tighter =
                met().filter(|it| it.scene == loose.scene && it.tolerance < loose.tolerance);
            tighter.map(|tight| loose.seconds - TICK > DEARER * tight.seconds)
        });
        pairs.fold([0, 0], |[all, dearer], it| {
            [all + 1, dearer + usize::from(it)]
        })
    }

    /// Numbers whose error estimate is too small, worst first: by how much, as error over estimate.
    pub fn wrong(&self) -> Vec<(&Run, &Judged)> {
        let numbers = self
            .runs
            .iter()
            .flat_map(|run| run.numbers.iter().map(move |it| (run, it)));
        let mut it: Vec<_> = numbers
            .filter(|(run, it)| it.counts(run.tolerance) && it.too_small())
            .collect();
        let by = |it: &Judged| it.error() / it.estimate.max(f64::MIN_POSITIVE);
        it.sort_by(|a, b| by(b.1).total_cmp(&by(a.1)));
        it
    }

    /// Every number with its reference, as a file.
    pub fn csv(&self) -> File {
        let mut text = String::from(
            "# Dimensionless. scale: the normalisation of the tolerance. seconds: processor time of the run;\n\
             # elapsed and planned are by the clock on the wall.\n\
             scene,tolerance,end,seconds,elapsed,planned,t,name,value,error,reference,uncertainty,scale\n",
        );
        for run in &self.runs {
            let Run {
                scene,
                tolerance,
                end,
                seconds,
                elapsed,
                planned,
                ..
            } = run;
            let head = format!(
                "{scene},{tolerance:e},{},{seconds:.4},{elapsed:.4},{planned:.4}",
                end.name()
            );
            if run.numbers.is_empty() {
                let _ = writeln!(text, "{head},,,,,,,");
            }
            for it in &run.numbers {
                let Reference {
                    t,
                    value,
                    uncertainty,
                    ..
                } = it.reference;
                let _ = writeln!(
                    text,
                    "{head},{t},{},{:e},{:e},{value:e},{uncertainty:e},{:e}",
                    it.name(),
                    it.value,
                    it.estimate,
                    it.scale
                );
            }
        }
        File::text("calibration.csv", text)
    }
}

impl End {
    pub fn name(&self) -> &'static str {
        match self {
            Self::Met => "met",
            Self::Short => "short",
            Self::Stopped => "stopped",
            Self::Refused(_) => "refused",
        }
    }
}

impl Run {
    /// Runs a case at a tolerance.
    pub fn of(case: &Case, tolerance: f64) -> Self {
        let mut scene = case.scene.clone();
        scene.accuracy.tolerance = tolerance;
        scene.accuracy.max_seconds = MAX_SECONDS.min(scene.accuracy.max_seconds);
        let clock = Clock::new();
        let plan = Plan::of(&scene);
        let foreseen = |plan: &Plan| plan.stages().iter().map(Stage::seconds).sum();
        let planned = plan.as_ref().map_or(0.0, foreseen);
        let results = plan.and_then(|plan| plan.run_quietly());
        let (seconds, elapsed) = (clock.seconds(), clock.elapsed());
        let mut chosen = None;
        let (end, numbers) = match results {
            Ok(results) => {
                let method = results.transient.as_ref().map(|it| &it.method);
                chosen = method.map(|it| (it.cells, it.step));
                let end = if results.falls_short() {
                    End::Short
                } else {
                    End::Met
                };
                (end, judge(case, &results))
            }
            Err(Error::Limit { .. }) => (End::Stopped, Vec::new()),
            Err(other) => (End::Refused(other.to_string()), Vec::new()),
        };
        Self {
            scene: case.number,
            tolerance,
            end,
            seconds,
            elapsed,
            planned,
            chosen,
            numbers,
        }
    }

    /// Whether it answered in about the time that its plan foresaw.
    pub fn is_foreseen(&self) -> bool {
        matches!(self.end, End::Met | End::Short)
            && self.elapsed <= FORESEEN * self.planned
            && self.planned <= FORESEEN * self.elapsed
    }
}

fn judge(case: &Case, results: &Results) -> Vec<Judged> {
    let Some(transient) = &results.transient else {
        return Vec::new();
    };
    let scales = Scales::of(&case.scene.oscillator);
    let mut judged = Vec::new();
    for reference in &case.references {
        let Some(k) = transient.times.iter().position(|t| *t == reference.t) else {
            continue;
        };
        let moments = &transient.moments[k];
        if let Some(number) = moments.named()[reference.index].1 {
            judged.push(Judged {
                reference: *reference,
                value: number.value,
                estimate: number.error,
                scale: scales.each(moments)[reference.index],
            });
        }
    }
    judged
}

fn median(mut of: Vec<f64>) -> f64 {
    of.sort_by(f64::total_cmp);
    of.get(of.len() / 2).copied().unwrap_or(0.0)
}

/// A number of a run beside what is known of it.
pub fn line(run: &Run, it: &Judged) -> String {
    format!(
        "  scene {}, tolerance {:.0e}, {} at t = {}: {:.7e} ± {:.1e}, true {:.7e} ± {:.0e}, error/estimate {:.1}",
        run.scene,
        run.tolerance,
        it.name(),
        it.reference.t,
        it.value,
        it.estimate,
        it.reference.value,
        it.reference.uncertainty,
        it.error() / it.estimate
    )
}

/// The table, and below it the error estimates that are too small.
impl fmt::Display for Calibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "tolerance  scenes  short  stopped  refused  numbers  left out  error > estimate     bare  \
             estimate > tolerance  median estimate/error  processor s  foreseen"
        )?;
        for it in self.verdicts() {
            writeln!(
                f,
                "{:<9.0e}  {:>6}  {:>5}  {:>7}  {:>7}  {:>7}  {:>8}  {:>7} = {:>5.2} %  {:>6}  {:>13} unsaid  {:>21.1}  \
                 {:>11.1}  {:>8}",
                it.tolerance,
                it.answered,
                it.short,
                it.stopped,
                it.refused,
                it.numbers,
                it.left_out,
                it.too_small,
                100.0 * it.share(),
                it.too_small_bare,
                it.unsaid,
                it.median,
                it.seconds,
                it.foreseen
            )?;
        }
        writeln!(
            f,
            "error > estimate: by more than {DOUBT} times what the reference solution may be off by; bare: by anything\n\
             goals: error > estimate in at most {} %, at most {} estimates above the tolerance unsaid (exit status 3 \
             says it), median at most {}; foreseen: within a factor {FORESEEN} of the time planned",
            100.0 * GOALS.too_small,
            GOALS.unsaid,
            GOALS.median
        )?;
        let [pairs, dearer] = self.dearer();
        writeln!(
            f,
            "{dearer} of {pairs} runs took more than {DEARER} times the processor time of one to a tighter tolerance"
        )?;
        let missed = self.missed();
        let verdict = if missed.is_empty() {
            "all goals are met".to_owned()
        } else {
            format!("missed: {}", missed.join("; "))
        };
        writeln!(f, "{verdict}")?;
        let wrong = self.wrong();
        for (run, it) in wrong.iter().take(WORST) {
            writeln!(f, "{}", line(run, it))?;
        }
        if wrong.len() > WORST {
            writeln!(f, "  and {} more", wrong.len() - WORST)?;
        }
        for run in &self.runs {
            if let End::Refused(why) = &run.end {
                let tolerance = run.tolerance;
                writeln!(f, "  scene {}, tolerance {tolerance:.0e}: {why}", run.scene)?;
            }
        }
        Ok(())
    }
}

/// Error estimates too small that are printed.
const WORST: usize = 20;

#[cfg(test)]
mod tests {
    use super::*;

    fn number(value: f64, estimate: f64, uncertainty: f64) -> Judged {
        let reference = Reference {
            t: 1.0,
            index: 0,
            value: 0.0,
            uncertainty,
        };
        Judged {
            reference,
            value,
            estimate,
            scale: 2.0,
        }
    }

    fn run(end: End, numbers: Vec<Judged>) -> Run {
        Run {
            scene: 1,
            tolerance: 1e-3,
            end,
            seconds: 0.5,
            elapsed: 0.5,
            chosen: None,
            planned: 0.2,
            numbers,
        }
    }

    #[test]
    fn estimates_are_judged_by_references_that_are_ten_times_as_good() {
        let it = Calibration {
            tolerances: vec![1e-3],
            runs: vec![
                run(
                    End::Met,
                    vec![
                        number(1e-4, 1e-3, 1e-6),
                        number(2e-4, 1e-4, 1e-6),
                        // Wrong by less than the reference may be.
                        number(1.5e-4, 1e-4, 3e-5),
                        // Not judged, whatever its error.
                        number(1.0, 1e-4, 1e-3),
                        // Above the tolerance, and nothing said.
                        number(1e-3, 3e-3, 1e-6),
                    ],
                ),
                run(End::Short, vec![number(1e-3, 3e-3, 1e-6)]),
                run(End::Stopped, vec![]),
            ],
        };
        let verdict = it.verdicts()[0];
        assert_eq!((verdict.numbers, verdict.left_out), (5, 1));
        assert_eq!((verdict.too_small, verdict.unsaid), (1, 1));
        assert_eq!(
            (verdict.answered, verdict.short, verdict.stopped),
            (2, 1, 1)
        );
        assert_eq!((verdict.median, verdict.foreseen), (3.0, 2));
        assert_eq!(it.dearer(), [0, 0], "no scene met two tolerances");
        // Without the allowance for the reference solution, one more.
        assert_eq!(verdict.too_small_bare, 2);
        assert_eq!(it.wrong().len(), 1);
        let missed = it.missed();
        println!("{missed:?}");
        assert_eq!(
            missed.len(),
            2,
            "the share and what is unsaid, not the median"
        );
        let met = Calibration {
            tolerances: vec![1e-3],
            runs: vec![run(End::Met, vec![number(1e-4, 1e-3, 1e-6)])],
        };
        assert!(met.missed().is_empty() && met.to_string().contains("all goals are met"));
        let wide = Calibration {
            tolerances: vec![1e-3],
            runs: vec![run(End::Met, vec![number(1e-5, 1e-3, 1e-8)])],
        };
        assert!(wide.missed()[0].contains("median") && wide.to_string().contains("missed: "));
        let mut two = vec![run(End::Met, vec![]), run(End::Met, vec![])];
        (two[0].tolerance, two[0].seconds) = (1e-2, 0.67);
        let mut loose = Calibration {
            tolerances: vec![1e-2, 1e-3],
            runs: two,
        };
        assert_eq!(loose.dearer(), [1, 1]);
        loose.runs[0].seconds = 0.64;
        assert_eq!(loose.dearer(), [1, 0]);
        let nothing = number(f64::NAN, 1.0, 1e-9);
        assert!(nothing.too_small() && number(0.0, f64::NAN, 1e-9).beyond(1e-3));
    }
}
