//! A number that never travels alone: value, error and where the error comes from.

use crate::error::Error;
use serde::ser::{Serialize, SerializeStruct, Serializer};
use std::fmt;

/// What limits the accuracy of an [`Estimate`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Origin {
    /// Closed form evaluated in floating point.
    #[default]
    ClosedForm,
    /// Adaptive quadrature of a closed form.
    Quadrature,
    /// The mesh: truncation error in space.
    Space,
    /// The step: truncation error in time.
    Time,
    /// Domain-truncation error: probability outside the truncated domain.
    Domain,
    /// Floating point: what many steps add up to.
    Rounding,
    /// Statistical: one standard error.
    Sampling,
}

/// `value ± error`. For deterministic origins the error is a bound that the true error is meant to
/// stay below; for [`Origin::Sampling`] it is one standard error.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Its error, in the unit of the value, never negative.
    pub error: f64,
    /// What the error comes from.
    pub origin: Origin,
}

impl Estimate {
    /// `value ± error` with its origin.
    pub fn new(value: f64, error: f64, origin: Origin) -> Self {
        Self {
            value,
            error,
            origin,
        }
    }

    /// A closed form: its error is a few roundings of the value.
    pub fn closed_form(value: f64) -> Self {
        Self::new(value, 4.0 * f64::EPSILON * value.abs(), Origin::ClosedForm)
    }

    /// Value and error multiplied by an exact factor.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            value: self.value * factor,
            error: self.error * factor.abs(),
            origin: self.origin,
        }
    }

    /// 1 - value of a probability, with the same error.
    #[must_use]
    pub fn complement(self) -> Self {
        Self {
            value: 1.0 - self.value,
            ..self
        }
    }

    /// `f(value)` where `slope` bounds `|f'|` within the error.
    #[must_use]
    pub fn mapped(self, value: f64, slope: f64) -> Self {
        let rounding = 4.0 * f64::EPSILON * value.abs();
        Self {
            value,
            error: self.error * slope.abs() + rounding,
            origin: self.origin,
        }
    }
}

/// `{"value": x, "error": e}`; null for a number that does not exist.
impl Serialize for Estimate {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if !self.value.is_finite() {
            return serializer.serialize_none();
        }
        let mut pair = serializer.serialize_struct("Estimate", 2)?;
        pair.serialize_field("value", &self.value)?;
        pair.serialize_field("error", &self.error)?;
        pair.end()
    }
}

/// What an answer lacks of what was asked for.
#[derive(Debug, Clone, PartialEq)]
pub enum Lack {
    /// All of it.
    Answer,
    /// Accuracy.
    Accuracy {
        /// The number whose error is farthest above the tolerance, with its time if it has one.
        number: String,
        /// That error over the tolerance, relative to its normalisation; NaN or infinite where it is not known.
        ratio: f64,
        /// The tolerance.
        tolerance: f64,
    },
    /// Paths: its numbers are those of the paths done in time.
    Paths {
        /// Paths done.
        done: u64,
        /// Paths asked for.
        asked: u64,
    },
}

/// A question that was not answered in full.
#[derive(Debug, Clone, PartialEq)]
pub struct Shortfall {
    /// What is lacking.
    pub lack: Lack,
    /// Whether the program was free to do better: it was not told the cells and steps that make the error.
    pub free: bool,
    /// Why it went no further.
    pub reason: String,
}

impl Shortfall {
    /// That of a question without an answer.
    pub(crate) fn unanswered(error: &Error) -> Self {
        Self {
            lack: Lack::Answer,
            free: true,
            reason: error.to_string(),
        }
    }

    /// The number that is lacking most; empty where there is no answer.
    pub fn number(&self) -> &str {
        match &self.lack {
            Lack::Answer => "",
            Lack::Accuracy { number, .. } => number,
            Lack::Paths { .. } => "monte_carlo.paths",
        }
    }

    /// How many times too large its error is, or how many times more paths were asked for than done; infinite where there
    /// is no answer.
    pub fn ratio(&self) -> f64 {
        match &self.lack {
            Lack::Answer => f64::INFINITY,
            Lack::Accuracy { ratio, .. } => *ratio,
            Lack::Paths { done, asked } => *asked as f64 / *done as f64,
        }
    }
}

impl fmt::Display for Shortfall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reason = &self.reason;
        match &self.lack {
            Lack::Answer => write!(f, "no answer: {reason}"),
            Lack::Accuracy {
                number,
                ratio,
                tolerance,
            } => {
                write!(f, "the tolerance {tolerance:e} is not met: ")?;
                let times = (10.0 * ratio).ceil() / 10.0;
                match times {
                    1e6.. if times.is_finite() => {
                        write!(f, "the error of {number} is {times:.0e} times too large; ")?;
                    }
                    _ if times.is_finite() => {
                        write!(f, "the error of {number} is {times:.1} times too large; ")?;
                    }
                    _ => write!(f, "{number} is not known; ")?,
                }
                f.write_str(reason)
            }
            Lack::Paths { done, asked } => write!(
                f,
                "the numbers are those of {done} of {asked} paths, and how many are done in time depends on the machine; \
                 {reason}"
            ),
        }
    }
}

/// What a reader of the numbers should know.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Warning {
    /// In words; the string that stands in results.json.
    pub text: String,
    /// The numbers whose error is not known, by their stage, name and time: `monte_carlo.var_q at t = 20`, the
    /// transient's without a stage. Every other number is as well known as its error says.
    pub unknown: Vec<String>,
}

impl From<String> for Warning {
    fn from(text: String) -> Self {
        Self {
            text,
            unknown: Vec::new(),
        }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// A number's name with its time, as warnings and tables write it.
#[doc(hidden)]
pub fn name_at(name: &str, t: f64) -> String {
    format!("{name} at t = {}", time_shown(t))
}

/// A time as warnings and tables write it.
pub(crate) fn time_shown(t: f64) -> String {
    if t != 0.0 && t.abs() < 1e-4 {
        format!("{t:e}")
    } else {
        format!("{t}")
    }
}

/// The variance of a sum of independent parts whose means are taken off, with what their skewness hides: the sum over its
/// estimated deviation has the mean square 1 + 2 g^2, g being the skewness of the sum (Gayen, Biometrika 36, 1949), for
/// where rare large parts are lacking the scatter is too small as well.
pub(crate) fn skewed_variance(parts: impl Iterator<Item = f64>) -> f64 {
    let (square, cube) = parts.fold((0.0, 0.0), |(square, cube), x| {
        (square + x * x, cube + x * x * x)
    });
    if square > 0.0 {
        square + 2.0 * (cube / square).powi(2)
    } else {
        square
    }
}
