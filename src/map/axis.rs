//! An axis of a map: a key of the scene and the values that it takes.

use crate::error::{Error, Result};
use crate::format::{num, rounded};
use crate::scene::resolved::toml_value;
use crate::scene::text::items;
use serde_json::{Value, json};

/// How the values of an axis follow one another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spacing {
    /// Equal ratios.
    Logarithmic,
    /// Equal differences.
    Linear,
    /// As listed.
    List,
}

impl Spacing {
    /// As map.json writes it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Logarithmic => "log",
            Self::Linear => "lin",
            Self::List => "list",
        }
    }

    /// From what map.json says.
    pub(super) fn named(name: &str) -> Option<Self> {
        [Self::Logarithmic, Self::Linear, Self::List]
            .into_iter()
            .find(|it| it.name() == name)
    }
}

/// A key of the scene and the values that it takes, in their order.
///
/// ```
/// use vibroimpact::map::Axis;
/// let axis = Axis::parse("oscillator.h=log:1e-4:1e-2:3")?;
/// assert_eq!(axis.numbers().unwrap(), [1e-4, 1e-3, 1e-2]);
/// assert!(Axis::parse("oscillator.h=log:0:1e-2:3").is_err());
/// # Ok::<(), vibroimpact::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    key: String,
    spacing: Spacing,
    values: Vec<Value>,
}

/// More values on one axis are a slip of the pen.
const MOST: usize = 10_000_000;

/// Digits of a computed value: so many are the same from every library of elementary functions.
const DIGITS: usize = 12;

const ACCEPTED: &str =
    "KEY=log:a:b:n, KEY=lin:a:b:n or KEY=[x, y, ...], as oscillator.h=log:1e-4:1e-2:40";

impl Axis {
    /// An axis from `KEY=RANGE`: `log:a:b:n`, `lin:a:b:n`, or a list `[x, y, ...]` in TOML.
    ///
    /// # Errors
    /// [`Error::Invalid`] that names the key, the range as given and what is accepted.
    pub fn parse(over: &str) -> Result<Self> {
        let Some((key, range)) = over.split_once('=') else {
            return Err(Error::invalid("--over", over, ACCEPTED));
        };
        let (key, range) = (key.trim(), range.trim());
        if key.is_empty() {
            return Err(Error::invalid("--over", over, ACCEPTED));
        }
        if range.starts_with('[') {
            let accepted = "a list of values in TOML, as [1e-4, 1e-3] or [\"hertz\", \"bilinear\"]";
            let values = items(range).ok_or_else(|| refused(key, range, accepted))?;
            return Self::list(key, values);
        }
        let words: Vec<&str> = range.split(':').map(str::trim).collect();
        let (spacing, [a, b, n]) = match words[..] {
            ["log", a, b, n] => (Spacing::Logarithmic, [a, b, n]),
            ["lin", a, b, n] => (Spacing::Linear, [a, b, n]),
            _ => return Err(refused(key, range, ACCEPTED)),
        };
        let end = |text: &str| text.parse::<f64>().ok().filter(|it| it.is_finite());
        let (Some(low), Some(high)) = (end(a), end(b)) else {
            let accepted = "ends that are numbers, as log:1e-4:1e-2:40";
            return Err(refused(key, range, accepted));
        };
        if spacing == Spacing::Logarithmic && !(low > 0.0 && high > 0.0) {
            let accepted = "log:a:b:n with ends a and b above 0; lin:a:b:n else";
            return Err(refused(key, range, accepted));
        }
        if low == high {
            let accepted = "two different ends, or a list of one value, as [0.1]";
            return Err(refused(key, range, accepted));
        }
        let count = n.parse::<usize>().ok().filter(|n| (2..=MOST).contains(n));
        let Some(count) = count else {
            let accepted = format!("a count n of values from 2 to {:.0e}", MOST as f64);
            return Err(refused(key, range, accepted));
        };
        let at = |k: usize| -> f64 {
            let part = k as f64 / (count - 1) as f64;
            match spacing {
                _ if k == 0 => low,
                _ if k + 1 == count => high,
                Spacing::Logarithmic => {
                    rounded((low.ln() * (1.0 - part) + high.ln() * part).exp(), DIGITS)
                }
                _ => {
                    let x = rounded(low * (1.0 - part) + high * part, DIGITS);
                    // What is left of a zero between two ends is rounding.
                    let zero = x.abs() < 1e-12 * low.abs().max(high.abs());
                    if zero { 0.0 } else { x }
                }
            }
        };
        let numbers: Vec<f64> = (0..count).map(at).collect();
        // lin:1:4:4 counts paths or eigenvalues: whole numbers stay whole.
        let whole = |it: &f64| it.fract() == 0.0 && it.abs() < 9e15;
        let typed_whole = [a, b].iter().all(|it| it.parse::<i64>().is_ok());
        let values = if typed_whole && numbers.iter().all(whole) {
            numbers.iter().map(|it| json!(*it as i64)).collect()
        } else {
            numbers.iter().map(|it| json!(it)).collect()
        };
        Ok(Self::list(key, values)?.spaced(spacing))
    }

    /// An axis of listed values.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an empty list, a value twice, or one that a scene cannot hold.
    pub fn list(key: &str, values: Vec<Value>) -> Result<Self> {
        if values.is_empty() {
            return Err(refused(key, "[]", "at least one value"));
        }
        let mut seen = std::collections::HashSet::new();
        for value in &values {
            // 1 and 1.0 are the same point.
            let shown = value.as_f64().map_or_else(|| value.to_string(), num);
            if value.is_null() {
                return Err(refused(key, "nan or inf", "values that a scene can hold"));
            }
            if !seen.insert(shown.clone()) {
                return Err(refused(key, &shown, "each value once"));
            }
        }
        Ok(Self {
            key: key.to_owned(),
            spacing: Spacing::List,
            values,
        })
    }

    /// The same values, which follow one another as `spacing` says.
    pub(super) fn spaced(self, spacing: Spacing) -> Self {
        Self { spacing, ..self }
    }

    /// The key of the scene.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// How its values follow one another.
    pub fn spacing(&self) -> Spacing {
        self.spacing
    }

    /// Its values, in their order.
    pub fn values(&self) -> &[Value] {
        &self.values
    }

    /// Its values as numbers; None where one of them is not.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        self.values.iter().map(Value::as_f64).collect()
    }

    /// Value `k` as text, a number as it reads back.
    pub(super) fn shown(&self, k: usize) -> String {
        let value = &self.values[k];
        // A whole number stays one: a count, a seed.
        let real = value.as_f64().filter(|_| value.is_f64());
        real.map_or_else(|| plain(value), num)
    }

    /// Value `k` as an override of the scene, `KEY=VALUE`.
    pub(super) fn set(&self, k: usize) -> String {
        format!("{}={}", self.key, toml_value(&self.values[k]))
    }
}

/// A value of an axis as text.
pub(super) fn plain(value: &Value) -> String {
    value
        .as_str()
        .map_or_else(|| value.to_string(), str::to_owned)
}

fn refused(key: &str, value: &str, accepted: impl Into<String>) -> Error {
    Error::invalid(format!("--over {key}"), value, accepted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_has_its_ends_exactly_and_its_values_in_between() {
        let log = Axis::parse("oscillator.h = log:1e-6:0.1:6").unwrap();
        assert_eq!(log.key(), "oscillator.h");
        let numbers = log.numbers().unwrap();
        assert_eq!(numbers, [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1]);
        let down = Axis::parse("a.b=lin:0.3:-0.1:5").unwrap().numbers();
        assert_eq!(down.unwrap(), [0.3, 0.2, 0.1, 0.0, -0.1]);
        let whole = Axis::parse("outputs.decay_rates=lin:1:4:4").unwrap();
        assert_eq!(whole.set(2), "outputs.decay_rates=3");
        let words = Axis::parse("oscillator.contact=[\"hertz\", \"bilinear\"]").unwrap();
        assert_eq!(words.set(1), "oscillator.contact=\"bilinear\"");
        assert!(words.numbers().is_none());
        let pairs = Axis::parse("initial.mean=[[0.0, 1.0], [1, 0]]").unwrap();
        assert_eq!(pairs.set(0), "initial.mean=[0.0, 1.0]");
    }

    #[test]
    fn a_bad_range_is_refused_with_its_key_and_what_is_accepted() {
        for (over, accepted) in [
            ("oscillator.h", "KEY=log"),
            ("=lin:0:1:3", "KEY=log"),
            ("oscillator.h=", "KEY=log"),
            ("oscillator.h=1e-3", "KEY=log"),
            ("oscillator.h=log:1e-4:1e-2", "KEY=log"),
            ("oscillator.h=cos:1e-4:1e-2:3", "KEY=log"),
            ("oscillator.h=log:0:1e-2:3", "above 0"),
            ("oscillator.h=log:-1:-2:3", "above 0"),
            ("oscillator.h=lin:x:1:3", "ends that are numbers"),
            ("oscillator.h=lin:0:inf:3", "ends that are numbers"),
            ("oscillator.h=lin:0:1:1", "from 2 to"),
            ("oscillator.h=lin:0:1:2.5", "from 2 to"),
            ("oscillator.h=lin:0:1:1e3", "from 2 to"),
            ("oscillator.h=lin:1:1:3", "two different ends"),
            ("oscillator.h=[]", "at least one value"),
            ("oscillator.h=[1, 1.0]", "each value once"),
            ("oscillator.h=[1, ", "a list of values in TOML"),
            ("oscillator.h=[1]\nx = 2", "a list of values in TOML"),
        ] {
            let error = Axis::parse(over).unwrap_err().to_string();
            assert!(error.contains(accepted), "{over}: {error}");
            assert!(error.starts_with("--over"), "{over}: {error}");
        }
    }
}
