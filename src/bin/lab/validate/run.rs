//! A scene of a folder that was run.

use super::numbers;
use vibroimpact::estimate::Estimate;
use vibroimpact::moments::Moment;
use vibroimpact::results::Results;

/// A scene that was run, under its label.
#[derive(Debug, Clone)]
pub struct Run {
    /// The label of its items.
    pub label: String,
    pub results: Results,
    json: serde_json::Value,
}

impl Run {
    /// What came of the scene of that label.
    pub fn new(label: String, results: Results) -> Self {
        let json = results.tree();
        Self {
            label,
            results,
            json,
        }
    }

    /// A number of its results.json, by its path.
    pub fn number(&self, path: &str) -> Option<Estimate> {
        numbers::at(&self.json, path)
    }

    /// One standard error of a stationary number in a plain record of that dimensionless length, from
    /// the long realisations of this scene.
    pub fn error_in_record(&self, path: &str, length: f64) -> Option<f64> {
        let records = self.results.records.as_ref()?;
        let last = path.rsplit('.').next()?;
        let error = match Moment::named(last).and_then(|it| records.moments.get(it)) {
            Some(number) => number.error,
            None => {
                let (section, rest) = path.split_once('.')?;
                let sampled = match section {
                    "rig" => format!("rig.monte_carlo.{rest}"),
                    other => format!("monte_carlo.{other}.{rest}"),
                };
                self.number(&sampled)?.error
            }
        };
        Some(error * (records.duration / length).sqrt())
    }
}
