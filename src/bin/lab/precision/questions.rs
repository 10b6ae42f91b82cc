//! Scenes of every question but the transient, each held against itself at a tenth of its tolerance.

use super::clock::Clock;
use super::references;
use serde_json::Value;
use std::collections::BTreeMap;
use vibroimpact::error::Result;
use vibroimpact::plan::Plan;
use vibroimpact::scene::Scene;

const SCENES: &str = include_str!("../../../../validation/precision/questions.toml");

/// A scene with the numbers of a run ten times as tight.
#[derive(Debug, Clone)]
pub struct Question {
    scene: Scene,
    known: Numbers,
}

/// Values and error estimates by their place in results.json; numbers of a curve know its length, for another curve has others.
type Numbers = BTreeMap<String, [f64; 2]>;

/// A run of such a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Processor seconds.
    pub seconds: f64,
    /// Unknowns times steps or solves; None where the results do not say them.
    pub work: Option<f64>,
    /// Whether it met its tolerance.
    pub met: bool,
    /// Of each number error, error estimate, and what the reference may be off by.
    pub numbers: Vec<[f64; 3]>,
}

impl Answer {
    /// Whether an error is above its estimate, whatever the reference may be off by.
    pub fn is_beyond([error, estimate, doubt]: &[f64; 3]) -> bool {
        *error > estimate + doubt
    }

    /// Error estimate over error, where the reference can tell the error.
    pub fn ratio([error, estimate, doubt]: &[f64; 3]) -> Option<f64> {
        (error > doubt).then_some(estimate / error)
    }

    /// Median of these, if there is one.
    pub fn median(&self) -> Option<f64> {
        let mut ratios: Vec<f64> = self.numbers.iter().filter_map(Self::ratio).collect();
        ratios.sort_by(f64::total_cmp);
        ratios.get(ratios.len() / 2).copied()
    }
}

impl Question {
    /// All of every question, their references computed.
    ///
    /// # Errors
    /// What a scene or a run of it says.
    pub fn all() -> Result<Vec<Self>> {
        Self::listed("validation/precision/questions.toml", SCENES, 1)
    }

    /// One of `each` of the scenes of a file.
    pub fn listed(file: &'static str, text: &str, each: usize) -> Result<Vec<Self>> {
        let question = |scene: Scene| {
            let mut tight = scene.clone();
            tight.accuracy.tolerance *= 0.1;
            let known = numbers(&Plan::of(&tight)?.run_quietly()?.tree());
            Ok(Self { scene, known })
        };
        let scenes = references::listed(file, text)?;
        scenes.into_iter().step_by(each).map(question).collect()
    }

    /// Runs it.
    pub fn answer(&self) -> Answer {
        let clock = Clock::new();
        let results = Plan::of(&self.scene).and_then(|it| it.run_quietly());
        let seconds = clock.seconds();
        let met = results.as_ref().is_ok_and(|it| !it.falls_short());
        let resolutions = results.as_ref().map_or([None; 2], |it| {
            [
                it.decay_rates.as_ref().map(|it| it.functions),
                it.solved.as_ref().map(|it| it.functions),
            ]
        });
        let tree = results.map_or(Value::Null, |it| it.tree());
        let found = numbers(&tree);
        let judged = found.iter().filter_map(|(place, [value, error])| {
            let [known, doubt] = self.known.get(place)?;
            Some([(value - known).abs(), *error, *doubt])
        });
        Answer {
            seconds,
            work: work(&tree, &resolutions),
            met,
            numbers: judged.collect(),
        }
    }
}

/// What the methods of a tree took, and searches of these resolutions, all together.
fn work(tree: &Value, searches: &[Option<[usize; 2]>]) -> Option<f64> {
    let sections = tree.as_object()?.values();
    let method = |section: &Value| {
        let it = section.get("method")?;
        let unknowns = it.get("cells").or(it.get("functions"))?.as_array()?;
        let unknowns: f64 = unknowns.iter().filter_map(Value::as_f64).product();
        let times = it.get("steps").or(it.get("solves"));
        Some(unknowns * times.and_then(Value::as_f64).unwrap_or(1.0))
    };
    let searches = searches.iter().flatten().map(|[q, v]| (q * v) as f64);
    let all = sections.filter_map(method).chain(searches);
    all.reduce(|a, b| a + b)
}

/// Every number of a tree that has an error.
fn numbers(tree: &Value) -> Numbers {
    let mut all = Numbers::new();
    walk(tree, "", &mut all);
    all
}

fn walk(tree: &Value, place: &str, all: &mut Numbers) {
    let mut put = |place: String, value: &Value, error: &Value| {
        let pair = value.as_f64().zip(error.as_f64());
        all.extend(pair.map(|(value, error)| (place, [value, error])));
    };
    match tree {
        Value::Array(list) => {
            for (k, it) in list.iter().enumerate() {
                walk(it, &format!("{place}/{k}"), all);
            }
        }
        Value::Object(map) => match (map.get("value").or(map.get("re")), map.get("error")) {
            (Some(Value::Array(values)), Some(Value::Array(errors))) => {
                for (k, (value, error)) in values.iter().zip(errors).enumerate() {
                    put(format!("{place}/{k} of {}", values.len()), value, error);
                }
            }
            (Some(value), Some(error)) => put(place.to_owned(), value, error),
            _ => {
                for (key, it) in map {
                    walk(it, &format!("{place}/{key}"), all);
                }
            }
        },
        _ => (),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn work_is_unknowns_times_steps_or_solves() {
        let tree = json!({
            "scene": {"method": {"cells": null}},
            "spectrum": {"method": {"functions": [3, 4], "solves": 5}},
            "steady": {"method": {"cells": [10, 2]}},
        });
        assert_eq!(work(&tree, &[None]), Some(80.0));
        assert_eq!(work(&tree, &[None, Some([2, 3])]), Some(86.0));
        assert_eq!(work(&json!({"decay_rates": []}), &[]), None);
    }

    #[test]
    fn numbers_curves_and_eigenvalues_are_found() {
        let tree = json!({
            "a": {"value": 1.0, "error": 0.1},
            "none": null,
            "curve": {"value": [2.0, null], "error": [0.2, 0.3]},
            "rates": [{"re": -1.0, "im": 3.0, "error": 0.4}],
            "plain": 7.0,
        });
        let found: Vec<_> = numbers(&tree).into_iter().collect();
        let expected = [
            ("/a", [1.0, 0.1]),
            ("/curve/0 of 2", [2.0, 0.2]),
            ("/rates/0", [-1.0, 0.4]),
        ];
        assert_eq!(found, expected.map(|(place, it)| (place.to_owned(), it)));
    }
}
