//! Numbers by their names: a label that says which scene, and a path into its results.json.

use serde_json::Value;
use std::fmt;
use vibroimpact::estimate::{Estimate, Origin};

/// `LABEL: PATH`. The label names a scene of the folder: words with `=` override its keys (`h` and
/// `zeta` for `oscillator.h` and `oscillator.zeta`), a word without names its file, `scene` if there is
/// none. The label `computed` stands for numbers that no scene gives.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Name {
    pub label: String,
    /// Which number: keys separated by points, `[k]` for the k-th entry of a list or curve.
    pub path: String,
}

/// The label of numbers that no scene gives.
pub const COMPUTED: &str = "computed";

impl Name {
    pub fn parse(text: &str) -> Option<Self> {
        let (label, path) = text.split_once(": ")?;
        let (label, path) = (label.trim(), path.trim());
        let both = !label.is_empty() && !path.is_empty();
        both.then(|| Self {
            label: label.to_owned(),
            path: path.to_owned(),
        })
    }
}

/// The file of the scene a label names, without its ending, and its overrides.
pub fn scene(label: &str) -> (&str, Vec<String>) {
    let words = || label.split_whitespace();
    let file = words().find(|word| !word.contains('=')).unwrap_or("scene");
    let overrides = words().filter(|word| word.contains('=')).map(|word| {
        let short = word.starts_with("h=") || word.starts_with("zeta=");
        if short {
            format!("oscillator.{word}")
        } else {
            word.to_owned()
        }
    });
    (file, overrides.collect())
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.label, self.path)
    }
}

/// The number at a path of results.json, with its error; a plain number has none, unless an `error`
/// stands beside it.
pub fn at(results: &Value, path: &str) -> Option<Estimate> {
    let sampled = path.split('.').any(|key| key == "monte_carlo");
    let origin = if sampled {
        Origin::Sampling
    } else {
        Origin::Space
    };
    let mut node = results;
    let mut beside = None;
    let mut entry = None;
    for key in path.split('.') {
        let (key, index) = match key.split_once('[') {
            Some((key, index)) => (key, Some(index.strip_suffix(']')?.parse::<usize>().ok()?)),
            None => (key, None),
        };
        beside = node.get("error");
        node = node.get(key)?;
        if let (Some(k), Value::Array(items)) = (index, node) {
            node = items.get(k)?;
        } else {
            entry = index;
        }
    }
    let number = |node: &Value| match (node, entry) {
        (Value::Array(items), Some(k)) => items.get(k).and_then(Value::as_f64),
        (node, _) => node.as_f64(),
    };
    match (node.get("value"), node.get("error")) {
        (Some(value), Some(error)) => Some(Estimate::new(number(value)?, number(error)?, origin)),
        _ => {
            let error = beside.and_then(Value::as_f64).unwrap_or(0.0);
            Some(Estimate::new(node.as_f64()?, error, origin))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_finds_numbers_in_objects_lists_and_curves() {
        let pair = Estimate::new(2.0, 0.5, Origin::Space);
        let all = serde_json::json!({
            "stationary": { "mean": pair },
            "transient": { "mean": { "value": [1.0, 3.0], "error": [0.1, 0.3] } },
            "decay_rates": [{ "re": -1.0, "error": 0.25 }],
            "plain": 7.0,
        });
        let found = |path: &str| at(&all, path).map(|it| (it.value, it.error));
        assert_eq!(found("stationary.mean"), Some((2.0, 0.5)));
        assert_eq!(found("transient.mean[1]"), Some((3.0, 0.3)));
        assert_eq!(found("decay_rates[0].re"), Some((-1.0, 0.25)));
        assert_eq!(found("plain"), Some((7.0, 0.0)));
        for path in [
            "",
            "stationary",
            "transient.mean",
            "transient.mean[2]",
            "decay_rates[1].re",
        ] {
            assert_eq!(found(path), None, "{path}");
        }
    }

    #[test]
    fn a_label_names_a_file_and_overrides() {
        let (file, overrides) = scene("h=2e-3 fine method.step=0.1 zeta=0.003");
        assert_eq!(file, "fine");
        assert_eq!(
            overrides,
            [
                "oscillator.h=2e-3",
                "method.step=0.1",
                "oscillator.zeta=0.003"
            ]
        );
        assert_eq!(scene("h=1").0, "scene");
    }
}
