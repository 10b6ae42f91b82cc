//! What a plan refuses: sizes beyond the limits of the scene, said in the keys and units of the scene.

use super::Plan;
use super::stage::Part;
use crate::budget::Cost;
use crate::error::{Error, Result};
use crate::format::{brief, bytes, num};

/// Keys of a scene under which times stand.
const TIMES: [&str; 9] = [
    "outputs.moments_at",
    "outputs.density_at",
    "outputs.first_loss",
    "outputs.first_passage",
    "outputs.crossings",
    "excitation.envelope",
    "monte_carlo.step",
    "monte_carlo.duration",
    "method.step",
];

/// Steps beyond which a scene is taken for a slip of the pen.
const MOST_STEPS: u64 = 10_000_000_000;

impl Plan {
    pub(super) fn check_cost(&self, part: Part, cost: &Cost) -> Result<()> {
        if cost.steps > MOST_STEPS {
            let sampling = self.scene.monte_carlo.as_ref();
            let (key, step) = if part.is_sampled() {
                ("monte_carlo.step", sampling.and_then(|it| it.step))
            } else {
                ("method.step", self.scene.method.step)
            };
            let outputs = &self.scene.outputs;
            let otherwise = match (part, sampling.and_then(|it| it.duration)) {
                (Part::Records | Part::Series, Some(duration)) => {
                    ("monte_carlo.duration", duration)
                }
                (Part::Series | Part::Spectrum, _) => {
                    let until = outputs.spectrum.map_or(0.0, |it| it.until);
                    ("outputs.spectrum.until", until)
                }
                (Part::FirstLoss | Part::FirstLossPaths, _) => {
                    let until = outputs.first_loss.unwrap_or_default();
                    ("outputs.first_loss.until", until)
                }
                (Part::FirstPassage | Part::FirstPassagePaths, _) => {
                    let until = outputs.first_passage.map_or(0.0, |it| it.until);
                    ("outputs.first_passage.until", until)
                }
                (Part::Reach, _) => ("oscillator.zeta", self.scene.oscillator.zeta()),
                _ if outputs.density_at.last() > outputs.moments_at.last() => {
                    ("outputs.density_at", outputs.density_at.last())
                }
                _ => ("outputs.moments_at", outputs.moments_at.last()),
            };
            let (key, value) = step.map_or(otherwise, |step| (key, step));
            let steps = cost.steps as f64;
            let accepted = format!("at most {MOST_STEPS:.0e} steps, and this takes {steps:.1e}");
            return Err(Error::invalid(key, num(value), accepted));
        }
        let limit = self.scene.accuracy.max_memory;
        if cost.memory > limit {
            let (need, limit) = (bytes(cost.memory), bytes(limit));
            let what = format!("the {} stage would need {need}", part.name());
            return Err(match self.scene.method.cells {
                Some([q, v]) if cost.cells.is_some() => {
                    let need = format!("{what}; accuracy.max_memory = {limit}");
                    Error::invalid("method.cells", format!("[{q}, {v}]"), need)
                }
                _ => Error::limit("accuracy.max_memory", limit, what),
            });
        }
        if let (Part::Transient, Some([q, v])) = (part, cost.cells) {
            let count = self.scene.outputs.density_at.list().len();
            let size = 8.0 * q as f64 * v as f64 * count as f64;
            if size > limit as f64 {
                let (limit, size) = (bytes(limit), bytes(size as u64));
                let accepted =
                    format!("densities that fit accuracy.max_memory = {limit}; these take {size}");
                let times = format!("{count} times");
                return Err(Error::invalid("outputs.density_at", times, accepted));
            }
        }
        Ok(())
    }

    /// A stage that takes finer cells than the scene's for its error is refused by the scene's own; times as the scene
    /// has them.
    pub(super) fn as_typed(&self, error: Error) -> Error {
        let clock = &self.clock;
        match (error, self.scene.method.cells) {
            (Error::Invalid { key, accepted, .. }, Some([q, v])) if key == "method.cells" => {
                Error::invalid(key, format!("[{q}, {v}]"), accepted)
            }
            (error, _) if clock.is_dimensionless() => error,
            (
                Error::Invalid {
                    key,
                    value,
                    accepted,
                },
                _,
            ) if TIMES.iter().any(|it| key.starts_with(it)) => {
                let tau = value.parse();
                let value = tau.map_or(value, |tau| num(clock.time(tau)));
                let accepted = format!(
                    "{accepted} (in dimensionless time, of which outputs.time_unit = \"{}\" is {})",
                    clock.unit().name(),
                    brief(clock.dimensionless(1.0))
                );
                Error::invalid(key, value, accepted)
            }
            (Error::Limit { key, limit, what }, _) => Error::limit(key, limit, clock.retold(&what)),
            (error, _) => error,
        }
    }
}
