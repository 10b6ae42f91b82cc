//! How each question of a scene will be answered, and what that costs: the joins to the numerics. Sizes here, calls in
//! [`run`](super::run).

use super::Plan;
use super::stage::{Cost, Part};
use crate::error::{Error, Result};
use crate::estimate::Estimate;
use crate::fokker_planck::{
    self, Eigenvalues, FirstPassage, Periodic, PeriodicLaw, Reach, Recipe, Resolvent,
    ResponseCurve, Settings, StationaryState, SteadyState,
};
use crate::moments::{Moment, Moments};
use crate::monte_carlo::{self, Ensemble, FirstLosses, Records, Samples, Sampling, Series};
use crate::scene::{self, MonteCarlo, ReachRequest, Scene, SpectrumRequest};
use crate::spectrum::Welch;
use crate::stationary::Stationary;
use std::f64::consts::PI;

/// Samples of a segment of Welch's method, averages and segments a record: the first two are the
/// paper's; records of five segments share few samples and are many enough for a standard error.
const WELCH_SAMPLES: usize = 2048;
const WELCH_AVERAGES: usize = 400;
const WELCH_SEGMENTS: usize = 5;

/// Share of the tolerance that is left to the stationary value of what is reached.
const LEVEL: f64 = 0.05;

impl Plan {
    pub(super) fn cost(&mut self, part: Part) -> Result<Cost> {
        let Scene {
            oscillator,
            initial,
            ..
        } = &self.scene;
        let (it, method) = match part {
            Part::Stationary | Part::Crossings if !oscillator.is_viscous() => {
                let recipe = StationaryState::of(oscillator, &self.settings)?;
                let mut cost = Cost::on_mesh(recipe.cost, StationaryState::WORDS.into());
                // What one stage has solved for serves the other.
                if self.recipes.stationary.replace(recipe).is_some() {
                    (cost.seconds, cost.steps) = (0.0, 0);
                }
                return Ok(cost);
            }
            Part::Stationary | Part::Crossings => {
                return Ok(Cost {
                    method: "closed form by adaptive quadrature".into(),
                    cells: None,
                    steps: 0,
                    memory_bytes: 1 << 16,
                    seconds: 1e-3,
                });
            }
            Part::MonteCarlo | Part::FirstLossPaths | Part::FirstPassagePaths | Part::Records => {
                return self.sample_cost(part);
            }
            Part::FirstPassage => {
                let passage = self.passage()?;
                let recipe = FirstPassage::of_level(oscillator, initial, passage, &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.passage = Some(recipe);
                cost
            }
            Part::FirstLoss => {
                let until = self.scene.outputs.first_loss.unwrap_or(0.0);
                let recipe = FirstPassage::of(oscillator, initial, until, &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.first_passage = Some(recipe);
                cost
            }
            Part::Series => return self.series_cost(),
            Part::Spectrum => {
                let until = self.scene.outputs.spectrum.map_or(0.0, |it| it.until);
                let recipe = Resolvent::of(oscillator, until, &self.settings);
                let cost = (recipe.cost, Resolvent::METHOD.to_string());
                self.recipes.spectrum = Some(recipe);
                cost
            }
            Part::Transient => {
                let recipe = Recipe::of(oscillator, initial, &self.times(), &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.transient = Some(recipe);
                cost
            }
            Part::Reach => self.reach_cost()?,
            Part::Periodic => {
                let phases = self.scene.outputs.periodic.unwrap_or(0);
                let recipe = PeriodicLaw::of(oscillator, (phases, Periodic::MAPS), &self.settings)?;
                let cost = (recipe.cost(), recipe.words());
                self.recipes.periodic = Some(recipe);
                cost
            }
            Part::Response => {
                let asked = self.scene.outputs.response;
                let frequencies = asked.map_or(Vec::new(), |it| it.frequencies());
                let recipe = ResponseCurve::of(oscillator, &frequencies, &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.response = Some(recipe);
                cost
            }
            Part::Steady => {
                let recipe = SteadyState::of(oscillator, &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.steady = Some(recipe);
                cost
            }
            Part::DecayRates => {
                let count = self.scene.outputs.decay_rates;
                let recipe = Eigenvalues::of(oscillator, count, &self.settings)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.eigenvalues = Some(recipe);
                cost
            }
        };
        Ok(Cost::on_mesh(it, method))
    }

    /// The cost of the first time at a level, and of the stationary value that it is a fraction of.
    fn reach_cost(&mut self) -> Result<(fokker_planck::Cost, String)> {
        let ReachRequest { quantity, fraction } = self.reach()?;
        let Scene {
            oscillator,
            initial,
            ..
        } = &self.scene;
        let recipe = Reach::of((oscillator, initial), quantity, fraction, &self.settings)?;
        let mut cost = (recipe.cost, recipe.words());
        if oscillator.is_viscous() {
            reached(quantity, &Stationary::of(oscillator)?.moments())?;
        } else {
            // The law is solved for anew, as exactly as a level must be known.
            let settings = Settings {
                tolerance: LEVEL * self.settings.tolerance,
                cells: None,
                ..self.settings.clone()
            };
            let law = StationaryState::of(oscillator, &settings)?;
            cost.0.seconds += law.cost.seconds;
            self.recipes.level = Some(law);
        }
        self.recipes.reach = Some(recipe);
        Ok(cost)
    }

    /// The cost of paths.
    fn sample_cost(&mut self, part: Part) -> Result<Cost> {
        let Scene {
            oscillator,
            initial,
            outputs,
            ..
        } = &self.scene;
        let sampling = self.sampling();
        let (cost, method) = match part {
            Part::MonteCarlo => {
                let times = outputs.moments_at.list();
                let recipe = Ensemble::of(oscillator, initial, &times, &sampling)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.ensemble = Some(recipe);
                cost
            }
            Part::FirstLossPaths => {
                let until = outputs.first_loss.unwrap_or(0.0);
                let recipe = FirstLosses::of(oscillator, initial, until, &sampling)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.first_losses = Some(recipe);
                cost
            }
            Part::FirstPassagePaths => {
                let recipe =
                    FirstLosses::of_level(oscillator, initial, self.passage()?, &sampling)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.passages = Some(recipe);
                cost
            }
            _ => {
                let recipe = Records::of(oscillator, &sampling)?;
                let cost = (recipe.cost, recipe.words());
                self.recipes.records = Some(recipe);
                cost
            }
        };
        Ok(Cost::of_sample(cost, method))
    }

    /// What `outputs.reach` asks for.
    pub(super) fn reach(&self) -> Result<ReachRequest> {
        let asked = self.scene.outputs.reach;
        asked.ok_or_else(|| Error::invalid("outputs.reach", "nothing", "a moment"))
    }

    /// Level, side and time of the first passage asked for.
    pub(super) fn passage(&self) -> Result<(f64, scene::Side, f64)> {
        let asked = self.scene.outputs.first_passage;
        let it =
            asked.ok_or_else(|| Error::invalid("outputs.first_passage", "nothing", "a level"))?;
        Ok((it.level, it.side, it.until))
    }

    /// Welch's method as in the paper, section 5.3.2, and the records it needs.
    pub(super) fn welch(&self) -> Result<(Welch, Samples)> {
        let request = self.scene.outputs.spectrum.unwrap_or(SpectrumRequest {
            until: 4.0,
            quantity: scene::Quantity::Force,
        });
        // Nyquist's frequency is twice the highest asked for: what aliases into the range lies beyond
        // three times that frequency.
        let spacing = 0.5 * PI / request.until;
        let welch = Welch::new(WELCH_SAMPLES, WELCH_SAMPLES / 2, spacing)?;
        let samples = welch.record_length(WELCH_SEGMENTS);
        let asked = self.scene.monte_carlo.as_ref().and_then(|it| it.duration);
        let wanted = self.scene.wants_records();
        let duration = asked.or(wanted.then_some(MonteCarlo::DURATION));
        // As long as the long records, if there are any.
        let records = duration.map_or((WELCH_AVERAGES / WELCH_SEGMENTS) as f64, |duration| {
            (duration / (samples as f64 * spacing)).ceil().max(32.0)
        });
        let asked = Samples {
            quantity: request.quantity,
            spacing,
            samples,
            records: records as u64,
        };
        Ok((welch, asked))
    }

    fn series_cost(&mut self) -> Result<Cost> {
        let (_, asked) = self.welch()?;
        let recipe = Series::of(&self.scene.oscillator, asked, &self.sampling())?;
        let records = recipe.asked.records;
        let method = format!(
            "Welch: {records} records of {WELCH_SEGMENTS} segments of {WELCH_SAMPLES} samples, {}",
            recipe.words()
        );
        let mut cost = Cost::of_sample(recipe.cost, method);
        // The periodograms.
        cost.memory_bytes += 8 * records * WELCH_SAMPLES as u64 / 2;
        self.recipes.series = Some(recipe);
        Ok(cost)
    }

    /// What the scene says of sampling.
    fn sampling(&self) -> Sampling {
        let it = self.scene.monte_carlo.clone().unwrap_or_default();
        Sampling {
            paths: it.paths,
            duration: it.duration.unwrap_or(MonteCarlo::DURATION),
            seed: it.seed,
            scheme: it.scheme,
            step: it.step,
            excitation: self.scene.excitation.clone(),
            noise: match it.noise {
                scene::Noise::White => monte_carlo::Noise::White,
                scene::Noise::Cosines { cosines, band } => monte_carlo::Noise::Cosines {
                    count: cosines.try_into().unwrap_or(u32::MAX),
                    band,
                },
            },
            ..Sampling::default()
        }
    }
}

/// The stationary value that a fraction of is reached.
pub(super) fn reached(quantity: Moment, law: &Moments) -> Result<Estimate> {
    let stationary = law.get(quantity).filter(|it| it.value.abs() > it.error);
    let name = quantity.name();
    stationary.ok_or_else(|| {
        let accepted = format!("a moment whose stationary value is not 0; that of {name} is");
        Error::invalid("outputs.reach.quantity", format!("{name:?}"), accepted)
    })
}
