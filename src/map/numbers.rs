//! The numbers of a line: those of results.json, without curves unless they are asked for.

use crate::error::{Error, Result};
use crate::moments::Moment;
use crate::scene::Outputs;
use serde_json::{Map as Object, Value};

/// Curves that lines hold too.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Keep(Vec<String>);

/// Sections of results.json that are no numbers of the point.
const NOT_NUMBERS: [&str; 3] = ["scene", "run", "method"];

/// Where a section has its curves, and what each runs over: a grid that the program chose. The moments of a transient
/// stand at times that the scene names, eigenvalues and peaks are few: these are numbers.
const CURVES: [(&str, &str, &[&str]); 12] = [
    (
        "spectrum",
        "omega",
        &[
            "fokker_planck",
            "linear",
            "monte_carlo",
            "monte_carlo_expectation",
        ],
    ),
    ("periodic", "phase", &Moment::NAMES),
    (
        "response",
        "frequency",
        &[
            "mean_q_1",
            "mean_q_2",
            "mean_force_1",
            "contact_loss_probability",
            "multiplier",
        ],
    ),
    ("first_loss", "t", PASSAGE),
    ("monte_carlo.first_loss", "t", PASSAGE),
    ("first_passage", "t", PASSAGE),
    ("monte_carlo.first_passage", "t", PASSAGE),
    ("crossings", "flight_time", &["flight_density"]),
    ("monte_carlo.crossings", "flight_time", &["flight_density"]),
    ("crossings.impact", "speed", &["speed_density"]),
    ("crossings.impact", "peak_force", &["peak_force_density"]),
    ("monte_carlo.crossings.impact", "speed", &["speed_density"]),
];
const PASSAGE: &[&str] = &["survival", "lost", "density"];

impl Keep {
    /// Curves by their names: a section for all of its curves, or one of them.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a name that is none of a curve.
    pub(super) fn of(names: Vec<String>) -> Result<Self> {
        let known = |name: &str| {
            CURVES.iter().any(|(section, _, curves)| {
                let inner = name.strip_prefix(section);
                let curve = inner.and_then(|it| it.strip_prefix('.'));
                inner == Some("") || curve.is_some_and(|it| curves.contains(&it))
            })
        };
        if let Some(wrong) = names.iter().find(|it| !known(it)) {
            let all = CURVES.iter().flat_map(|(section, _, curves)| {
                let whole = std::iter::once((*section).to_owned());
                whole.chain(curves.iter().map(move |it| format!("{section}.{it}")))
            });
            let mut accepted: Vec<String> = Vec::new();
            for name in all {
                if !accepted.contains(&name) {
                    accepted.push(name);
                }
            }
            let accepted = accepted.join(", ");
            return Err(Error::invalid("--keep", wrong, accepted));
        }
        Ok(Self(names))
    }

    /// The same, if a scene with these outputs has them all.
    ///
    /// # Errors
    /// [`Error::Invalid`] for curves that are not asked for.
    pub(super) fn of_these(self, outputs: &Outputs) -> Result<Self> {
        let has = |name: &str| {
            let section = name.strip_prefix("monte_carlo.").unwrap_or(name);
            match section.split('.').next() {
                Some("spectrum") => outputs.spectrum.is_some(),
                Some("periodic") => outputs.periodic.is_some(),
                Some("response") => outputs.response.is_some(),
                Some("first_loss") => outputs.first_loss.is_some(),
                Some("first_passage") => outputs.first_passage.is_some(),
                _ => outputs.crossings.is_some(),
            }
        };
        match self.0.iter().find(|it| !has(it)) {
            Some(name) => {
                let accepted = "curves of what the scene asks for under [outputs]";
                Err(Error::invalid("--keep", name, accepted))
            }
            None => Ok(self),
        }
    }

    pub(super) fn names(&self) -> &[String] {
        &self.0
    }

    /// Whether a key of a section is left out of lines.
    fn drops(&self, section: &str, key: &str) -> bool {
        let kept = |key: &str| {
            let full = format!("{section}.{key}");
            self.0.iter().any(|it| it == section || *it == full)
        };
        let mut here = CURVES.iter().filter(|it| it.0 == section);
        here.any(|(_, over, curves)| {
            let curve = curves.contains(&key) && !kept(key);
            curve || (key == *over && !curves.iter().any(|it| kept(it)))
        })
    }
}

/// Whether a name with its sections is that of a curve, or of what one runs over.
pub(super) fn is_curve(name: &str) -> bool {
    CURVES.iter().any(|(section, over, curves)| {
        let last = name
            .strip_prefix(section)
            .and_then(|it| it.strip_prefix('.'));
        last.is_some_and(|it| it == *over || curves.contains(&it))
    })
}

/// The numbers of results.json.
pub(super) fn of(tree: &Value, keep: &Keep) -> Value {
    section(tree, "", keep)
}

fn section(tree: &Value, path: &str, keep: &Keep) -> Value {
    let Some(pairs) = tree.as_object() else {
        return tree.clone();
    };
    let mut kept = Object::new();
    for (key, value) in pairs {
        if NOT_NUMBERS.contains(&key.as_str()) || keep.drops(path, key) {
            continue;
        }
        let full = if path.is_empty() {
            key.clone()
        } else {
            format!("{path}.{key}")
        };
        let inner = section(value, &full, keep);
        if inner.as_object().is_none_or(|it| !it.is_empty()) {
            kept.insert(key.clone(), inner);
        }
    }
    kept.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_curve_is_kept_with_what_it_runs_over_if_it_is_asked_for() {
        let tree = json!({
            "scene": { "title": "a" },
            "spectrum": { "omega": [1], "linear": [2.0], "fokker_planck": { "value": [3.0], "error": [0.1] },
                "peaks": [{ "omega": { "value": 1.0, "error": 0.1 } }], "method": { "name": "x" } },
            "monte_carlo": { "first_loss": { "t": [1], "survival": 1, "mean_time": 2 } },
            "crossings": { "loss_rate": 1, "impact": { "speed": [1], "speed_density": [2],
                "peak_force": [3], "peak_force_density": [4] } },
            "transient": { "t": [5], "mean_q": { "value": [0.0], "error": [0.0] } },
        });
        let kept = |names: &[&str]| {
            let keep = Keep::of(names.iter().map(|it| (*it).to_owned()).collect()).unwrap();
            of(&tree, &keep)
        };
        let none = kept(&[]);
        assert_eq!(
            none["spectrum"],
            json!({ "peaks": tree["spectrum"]["peaks"] })
        );
        assert_eq!(none["monte_carlo"]["first_loss"], json!({ "mean_time": 2 }));
        assert_eq!(none["transient"], tree["transient"]);
        assert_eq!(none["crossings"], json!({ "loss_rate": 1 }));
        assert!(none.get("scene").is_none());
        let one = kept(&["spectrum.linear"]);
        assert_eq!(one["spectrum"]["omega"], json!([1]));
        assert!(one["spectrum"].get("fokker_planck").is_none());
        let speed = kept(&["crossings.impact.speed_density"]);
        let impact = json!({ "speed": [1], "speed_density": [2] });
        assert_eq!(speed["crossings"]["impact"], impact);
        let all = kept(&["spectrum", "monte_carlo.first_loss"]);
        assert!(all["spectrum"]["fokker_planck"].is_object());
        assert_eq!(all["monte_carlo"]["first_loss"]["t"], json!([1]));
        for wrong in ["spectre", "spectrum.peaks", "transient", ""] {
            let error = Keep::of(vec![wrong.into()]).unwrap_err().to_string();
            assert!(error.contains("first_loss.survival"), "{error}");
        }
    }
}
