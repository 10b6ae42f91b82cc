//! From what came of a scene to a verdict.

use super::against::Against;
use super::extreme::Extreme;
use super::yardstick::{Check, SIGMAS};
use std::fmt;
use vibroimpact::error::Error;
use vibroimpact::estimate::Warning;
use vibroimpact::results::Results;

/// What can be said of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Every number is within its error estimate, and the estimates within the tolerance.
    Within,
    /// Every number is within its error estimate; estimates exceed the tolerance, and a warning says by how much.
    Wide,
    /// Numbers lie outside their error estimates or do not exist, and a warning names each of them as not known.
    Warned,
    /// The scene is refused, as its entry allows, and the message names what would be accepted.
    Refused,
    /// A limit was reached, as its entry allows, and the message says how far it came.
    Stopped,
    /// A refusal or a limit where an answer is expected.
    Unsolved,
    /// A number lies outside its error estimate, and no warning names it as not known.
    Outside,
    /// An error estimate exceeds the tolerance, or a number does not exist, or a warning is missing.
    Silent,
    Panicked,
    /// It did not keep to max_seconds.
    Late,
}

impl Verdict {
    /// Whether the user has an answer, or the scene is one that has none, and was told so.
    pub fn honest(self) -> bool {
        matches!(
            self,
            Self::Within | Self::Wide | Self::Warned | Self::Refused | Self::Stopped
        )
    }

    /// One word; those of failures in capitals.
    pub fn name(self) -> &'static str {
        match self {
            Self::Within => "within",
            Self::Wide => "wide",
            Self::Warned => "warned",
            Self::Refused => "refused",
            Self::Stopped => "stopped",
            Self::Unsolved => "UNSOLVED",
            Self::Outside => "OUTSIDE",
            Self::Silent => "SILENT",
            Self::Panicked => "PANICKED",
            Self::Late => "LATE",
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// One line of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    pub name: String,
    pub what: String,
    pub against: String,
    pub verdict: Verdict,
    /// Largest error measured, over the normalisation; None without numbers.
    pub error: Option<f64>,
    /// Largest ratio of a measured error to its estimate, of the numbers that no warning names as not known; and the
    /// number and time it is of.
    pub worst: Option<(f64, String)>,
    pub lowest_density: Option<f64>,
    /// Largest |mass - 1| of the transient.
    pub mass_error: Option<f64>,
    pub steps: Option<u64>,
    /// Wall time, the yardstick's own run included.
    pub seconds: f64,
    pub message: String,
}

pub(super) enum Outcome {
    Done(Box<Results>, Vec<Check>),
    /// The scene itself, a stage or its yardstick ended in an error.
    Failed(Error),
    /// The text of the scene was refused.
    Unread(String),
}

/// A run may overstep its limit by what it does between two looks at the clock.
const GRACE: f64 = 1.5;

/// A row without numbers.
pub(super) fn lost(extreme: &Extreme, verdict: Verdict, message: String, seconds: f64) -> Row {
    Row {
        name: extreme.name.clone(),
        what: extreme.what.clone(),
        against: extreme.against.to_string(),
        verdict,
        error: None,
        worst: None,
        lowest_density: None,
        mass_error: None,
        steps: None,
        seconds,
        message,
    }
}

/// What is said of a limit, where the entry of the scene gives a reason for it and where it does not.
fn stopped(extreme: &Extreme) -> Verdict {
    match extreme.may_stop {
        Some(_) => Verdict::Stopped,
        None => Verdict::Unsolved,
    }
}

/// What is said of a limit or a refusal, where the entry of the scene gives a reason for it and where it does not.
fn no_answer(extreme: &Extreme, error: Option<&Error>) -> Verdict {
    match error {
        Some(Error::Limit { .. } | Error::Unresolved { .. }) => stopped(extreme),
        _ if extreme.may_refuse.is_some() || extreme.against == Against::Refusal => {
            Verdict::Refused
        }
        _ => Verdict::Unsolved,
    }
}

pub(super) fn row(extreme: &Extreme, outcome: Outcome, seconds: f64) -> Row {
    let (results, checks) = match outcome {
        Outcome::Done(results, checks) => (results, checks),
        Outcome::Unread(message) => {
            return lost(extreme, no_answer(extreme, None), message, seconds);
        }
        Outcome::Failed(error) => {
            let late = seconds > GRACE * extreme.max_seconds + 2.0;
            let verdict = if late {
                Verdict::Late
            } else {
                no_answer(extreme, Some(&error))
            };
            return lost(extreme, verdict, error.to_string(), seconds);
        }
    };
    let mut row = lost(extreme, Verdict::Within, String::new(), seconds);
    let warnings = results.run.warnings.iter();
    let warnings: Vec<String> = warnings.map(Warning::to_string).collect();
    row.message = warnings.join("; ");
    let (unknown, known): (Vec<&Check>, Vec<&Check>) = checks
        .iter()
        .partition(|it| declared_unknown(&results, &it.name));
    measure(&mut row, &results, &known);
    let missing = |it: &Check| !it.value.is_finite() || !it.estimate.is_finite();
    let outside = known.iter().any(|it| it.ratio() > 1.0);
    let mass_wrong = row
        .mass_error
        .is_some_and(|it| it > mass_tolerance(&results));
    let unsaid = |it: &str| !warnings.iter().any(|warning| warning.contains(it));
    row.verdict = if checks.is_empty() && results.falls_short() {
        // The stage that is held against something has no answer, and says so.
        stopped(extreme)
    } else if checks.is_empty() || known.iter().any(|it| missing(it)) {
        Verdict::Silent
    } else if outside || mass_wrong || extreme.against == Against::Refusal {
        Verdict::Outside
    } else if results.run.wall_seconds > GRACE * extreme.max_seconds + 2.0 {
        Verdict::Late
    } else if known
        .iter()
        .any(|it| it.excess() > said(&results, it.stage))
        || extreme.must_warn.as_deref().is_some_and(unsaid)
    {
        Verdict::Silent
    } else if unknown.iter().any(|it| missing(it) || it.ratio() > 1.0) {
        Verdict::Warned
    } else if known.iter().any(|it| it.excess() > 1.0) {
        Verdict::Wide
    } else {
        Verdict::Within
    };
    if extreme.against == Against::Refusal {
        row.message = "it was to be refused".into();
    }
    row
}

/// Whether a warning names this number as one whose error is not known.
fn declared_unknown(results: &Results, name: &str) -> bool {
    let warned = results.run.warnings.iter().flat_map(|it| &it.unknown);
    let short = results.shortfalls.iter();
    let short = short.filter(|(_, it)| !it.ratio().is_finite());
    warned
        .map(String::as_str)
        .chain(short.map(|(_, it)| it.number()))
        .any(|it| it == name)
}

/// Part by which an error estimate over the tolerance may exceed what is said of the worst of its stage: the
/// normalisations of two answers differ a little.
const ROUNDED: f64 = 1.1;

/// The largest error estimate over the tolerance that a stage admits.
fn said(results: &Results, stage: &str) -> f64 {
    let of_stage = results.shortfalls.iter().filter(|(it, _)| *it == stage);
    let admitted = of_stage
        .map(|(_, it)| it.ratio())
        .filter(|it| it.is_finite());
    ROUNDED * admitted.fold(1.0 / ROUNDED, f64::max)
}

/// What the mass may be off by: the domain-truncation error, and rounding over the steps.
fn mass_tolerance(results: &Results) -> f64 {
    let Some(it) = &results.transient else {
        return f64::INFINITY;
    };
    let outside = it.mass.iter().map(|m| m.error).fold(0.0, f64::max);
    outside + 1e-10
}

impl Check {
    /// The measured error over its estimate: five standard errors for a sampled number.
    fn ratio(&self) -> f64 {
        let error = (self.value - self.reference).abs();
        let allowed = if self.sampled { SIGMAS } else { 1.0 };
        let ratio = error / (allowed * self.estimate + self.reference_error);
        if error == 0.0 { 0.0 } else { ratio }
    }

    /// The error estimate over the tolerance; 0 for a sampled number, which the tolerance does not bind.
    fn excess(&self) -> f64 {
        if self.sampled {
            return 0.0;
        }
        self.estimate / (self.tolerance * self.scale * (1.0 + 1e-9))
    }
}

fn measure(row: &mut Row, results: &Results, checks: &[&Check]) {
    for check in checks {
        let ratio = check.ratio();
        let scaled = (check.value - check.reference).abs() / check.scale;
        if scaled.is_finite() && scaled >= row.error.unwrap_or(0.0) {
            row.error = Some(scaled);
        }
        if ratio >= row.worst.as_ref().map_or(0.0, |(worst, _)| *worst) {
            row.worst = Some((ratio, check.name.clone()));
        }
    }
    if let Some(it) = &results.transient {
        row.lowest_density = it.lowest_density.iter().map(|p| p.value).reduce(f64::min);
        let off = it.mass.iter().map(|m| (m.value - 1.0).abs());
        row.mass_error = off.reduce(f64::max);
        row.steps = Some(it.method.steps);
    }
    if let Some(it) = &results.monte_carlo {
        row.steps = Some(row.steps.unwrap_or(0) + it.steps);
    }
}
