//! From what came of a scene to a verdict.

use super::Outcome;
use super::extreme::Extreme;
use super::yardstick::{Against, Check};
use crate::error::Error;
use crate::results::Results;
use std::fmt;

/// What can be said of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Every number is within its error bar, and the bars within the tolerance.
    Within,
    /// Every number is within its error bar; the bars exceed the tolerance, and a warning says so.
    Wide,
    /// Numbers lie outside their bars, and a warning says why.
    Warned,
    /// The scene is refused, and the message names what would be accepted.
    Refused,
    /// A limit was reached, and the message says how far it came.
    Stopped,
    /// A number lies outside its error bar, and nothing says so.
    Outside,
    /// A bar exceeds the tolerance, or a number does not exist, and nothing says so.
    Silent,
    /// It panicked.
    Panicked,
    /// It did not keep to max_seconds.
    Late,
}

impl Verdict {
    /// Whether the user was told the truth.
    pub fn honest(self) -> bool {
        matches!(
            self,
            Self::Within | Self::Wide | Self::Warned | Self::Refused | Self::Stopped
        )
    }

    /// One word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Within => "within",
            Self::Wide => "wide",
            Self::Warned => "warned",
            Self::Refused => "refused",
            Self::Stopped => "stopped",
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
    /// The scene.
    pub name: &'static str,
    /// What is extreme about it.
    pub what: &'static str,
    /// What it was held against.
    pub against: String,
    /// The verdict.
    pub verdict: Verdict,
    /// Largest error measured, in natural scales; None without numbers.
    pub error: Option<f64>,
    /// Largest ratio of a measured error to its bar, and the number and time it is of.
    pub worst: Option<(f64, String)>,
    /// Lowest density of the transient.
    pub lowest_density: Option<f64>,
    /// Largest |mass - 1| of the transient.
    pub mass_error: Option<f64>,
    /// Steps of all runs.
    pub steps: Option<u64>,
    /// Wall time, the yardstick's own run included.
    pub seconds: f64,
    /// What the program said.
    pub message: String,
}

/// Standard errors within which a sampled number counts as within its bar: one in two million lies
/// outside, and the seeds are fixed.
pub(super) const SIGMAS: f64 = 5.0;

/// A run may overstep its limit by what it does between two looks at the clock.
const GRACE: f64 = 1.5;

/// A row without numbers.
pub(super) fn lost(extreme: &Extreme, verdict: Verdict, message: String, seconds: f64) -> Row {
    Row {
        name: extreme.name,
        what: extreme.what,
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

pub(super) fn row(extreme: &Extreme, outcome: Outcome, seconds: f64) -> Row {
    let (results, checks) = match outcome {
        Outcome::Done(results, checks) => (results, checks),
        Outcome::Unread(message) => return lost(extreme, Verdict::Refused, message, seconds),
        Outcome::Failed(error) => {
            let late = seconds > GRACE * extreme.max_seconds + 2.0;
            let verdict = match error {
                _ if late => Verdict::Late,
                Error::Limit { .. } => Verdict::Stopped,
                _ => Verdict::Refused,
            };
            return lost(extreme, verdict, error.to_string(), seconds);
        }
    };
    let mut row = lost(extreme, Verdict::Within, String::new(), seconds);
    let warnings = &results.run.warnings;
    row.message = warnings.join("; ");
    measure(&mut row, &results, &checks);
    let ratio = row.worst.as_ref().map_or(0.0, |(ratio, _)| *ratio);
    let excused = |words: &str| warnings.iter().any(|it| it.contains(words));
    let mass_wrong = row.mass_error.is_some_and(|it| it > mass_bar(&results));
    let unknown = |it: &Check| !it.value.is_finite() || it.bar.is_nan();
    let missing = checks.is_empty() || checks.iter().any(unknown);
    let wide = checks
        .iter()
        .any(|it| !it.sampled && it.bar > it.tolerance * it.scale * (1.0 + 1e-9));
    row.verdict = if ratio > 1.0 || mass_wrong || missing {
        let said = extreme.says.is_some_and(excused);
        match (said, missing) {
            (true, _) => Verdict::Warned,
            (false, true) => Verdict::Silent,
            (false, false) => Verdict::Outside,
        }
    } else if run_seconds(&results) > GRACE * extreme.max_seconds + 2.0 {
        Verdict::Late
    } else if wide && !excused("tolerance") && !excused("error bars say so") {
        Verdict::Silent
    } else if wide {
        Verdict::Wide
    } else {
        Verdict::Within
    };
    if matches!(extreme.against, Against::Refusal) {
        row.verdict = Verdict::Outside;
        row.message = "it was to be refused".into();
    }
    row
}

fn run_seconds(results: &Results) -> f64 {
    results.run.wall_seconds
}

/// What the mass may be off by: what the box leaves out, and rounding over the steps.
fn mass_bar(results: &Results) -> f64 {
    let Some(it) = &results.transient else {
        return f64::INFINITY;
    };
    let outside = it.mass.iter().map(|m| m.error).fold(0.0, f64::max);
    outside + 1e-10
}

fn measure(row: &mut Row, results: &Results, checks: &[Check]) {
    for check in checks {
        let error = (check.value - check.reference).abs();
        let allowed = if check.sampled { SIGMAS } else { 1.0 };
        let bar = allowed * check.bar + check.reference_error;
        let ratio = if error == 0.0 { 0.0 } else { error / bar };
        let scaled = error / check.scale;
        if scaled.is_finite() && scaled >= row.error.unwrap_or(0.0) {
            row.error = Some(scaled);
        }
        if ratio >= row.worst.as_ref().map_or(0.0, |(worst, _)| *worst) {
            row.worst = Some((ratio, check.name.clone()));
        }
    }
    if let Some(it) = &results.transient {
        row.lowest_density = it.lowest_density.iter().map(|p| p.value).reduce(f64::min);
        row.mass_error = it
            .mass
            .iter()
            .map(|m| (m.value - 1.0).abs())
            .reduce(f64::max);
        row.steps = Some(it.method.steps);
    }
    if let Some(it) = &results.monte_carlo {
        row.steps = Some(row.steps.unwrap_or(0) + it.steps);
    }
}
