//! How each question of a scene will be answered, and what that costs: the joins to the numerics. Sizes here, calls in
//! [`run`](super::run).

use super::Plan;
use super::recipes::Recipe;
use super::stage::Part;
use crate::budget::{Cost, timing};
use crate::error::{Error, Result};
use crate::estimate::Estimate;
use crate::fokker_planck::{
    self, Eigenvalues, FirstPassage, Periodic, PeriodicLaw, Reach, Resolvent, ResponseCurve,
    Settings, StationaryState, SteadyState,
};
use crate::moments::{Moment, Moments};
use crate::monte_carlo::{self, Ensemble, FirstLosses, Records, Samples, Sampling, Series};
use crate::oscillator::Target;
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
    /// How a part will be computed, in words too, and at what cost.
    pub(super) fn foresee(&self, part: Part) -> Result<(String, Cost, Recipe)> {
        let Scene {
            oscillator,
            initial,
            outputs,
            ..
        } = &self.scene;
        let (settings, sampling) = (&self.settings, self.sampling());
        Ok(match part {
            Part::Stationary | Part::Crossings if !oscillator.is_viscous() => {
                let it = StationaryState::of(oscillator, settings)?;
                let mut cost = it.cost;
                // What one stage has solved for serves the other.
                if self.has(Part::Stationary) {
                    (cost.seconds, cost.steps) = (0.0, 0);
                }
                (StationaryState::WORDS.into(), cost, Recipe::Stationary(it))
            }
            Part::Stationary | Part::Crossings => {
                let flies = part == Part::Crossings && self.knows_flights();
                let cost = Cost {
                    memory: 1 << 16,
                    seconds: if flies {
                        timing::FLIGHTS
                    } else {
                        timing::CLOSED_FORM
                    },
                    ..Cost::default()
                };
                let method = "closed form by adaptive quadrature".into();
                (method, cost, Recipe::ClosedForm)
            }
            Part::FirstLoss | Part::FirstPassage => {
                let it = FirstPassage::of(oscillator, initial, self.target(part)?, settings)?;
                (it.words(), it.cost, Recipe::FirstPassage(it))
            }
            Part::Transient => {
                let it = fokker_planck::Recipe::of(oscillator, initial, &self.times(), settings)?;
                (it.words(), it.cost, Recipe::Transient(it))
            }
            Part::Reach => self.foresee_reach()?,
            Part::Periodic => {
                let phases = outputs.periodic.unwrap_or(0);
                let it = PeriodicLaw::of(oscillator, (phases, Periodic::MAPS), settings)?;
                (it.words(), it.cost(), Recipe::Periodic(it))
            }
            Part::Response => {
                let frequencies = outputs.response.map_or(Vec::new(), |it| it.frequencies());
                let it = ResponseCurve::of(oscillator, &frequencies, settings)?;
                (it.words(), it.cost, Recipe::Response(it))
            }
            Part::Steady => {
                let it = SteadyState::of(oscillator, settings)?;
                (it.words(), it.cost, Recipe::Steady(it))
            }
            Part::DecayRates => {
                let it = Eigenvalues::of(oscillator, outputs.decay_rates, settings)?;
                (it.words(), it.cost, Recipe::DecayRates(it))
            }
            Part::Spectrum => {
                let asked = self.spectrum()?;
                let it = Resolvent::of(oscillator, asked.until, settings);
                (
                    Resolvent::METHOD.into(),
                    it.cost,
                    Recipe::Spectrum(it, asked),
                )
            }
            Part::Series => {
                let it = Series::of(oscillator, self.samples()?, &sampling)?;
                let records = it.asked.records;
                let method = format!(
                    "Welch: {records} records of {WELCH_SEGMENTS} segments of {WELCH_SAMPLES} samples, {}",
                    it.words()
                );
                let mut cost = it.cost;
                // The periodograms.
                cost.memory += 8 * records * WELCH_SAMPLES as u64 / 2;
                (method, cost, Recipe::Series(it, self.spectrum()?))
            }
            Part::MonteCarlo => {
                let times = outputs.moments_at.list();
                let it = Ensemble::of(oscillator, initial, &times, &sampling)?;
                (it.words(), it.cost, Recipe::Ensemble(it))
            }
            Part::FirstLossPaths | Part::FirstPassagePaths => {
                let it = FirstLosses::of(oscillator, initial, self.target(part)?, &sampling)?;
                (it.words(), it.cost, Recipe::FirstLosses(it))
            }
            Part::Records => {
                let it = Records::of(oscillator, &sampling)?;
                (it.words(), it.cost, Recipe::Records(it))
            }
        })
    }

    /// The first time at a level, and the stationary value that it is a fraction of.
    fn foresee_reach(&self) -> Result<(String, Cost, Recipe)> {
        let asked = self.scene.outputs.reach;
        let ReachRequest { quantity, fraction } =
            asked.ok_or_else(|| Error::invalid("outputs.reach", "nothing", "a moment"))?;
        let Scene {
            oscillator,
            initial,
            ..
        } = &self.scene;
        let it = Reach::of((oscillator, initial), quantity, fraction, &self.settings)?;
        let (method, mut cost) = (it.words(), it.cost);
        let mut level = None;
        if oscillator.is_viscous() {
            reached(quantity, &Stationary::of(oscillator)?.moments())?;
        } else {
            // The law is solved for anew, as exactly as a level must be known.
            let settings = Settings {
                tolerance: LEVEL * self.settings.tolerance,
                cells: None,
                moments: Some(vec![quantity]),
                ..self.settings.clone()
            };
            let law = StationaryState::of(oscillator, &settings)?;
            cost.seconds += law.cost.seconds;
            level = Some(law);
        }
        Ok((method, cost, Recipe::Reach(it, quantity, level)))
    }

    /// Whether the law of the flights is computed: between two walls it is sampled alone.
    pub(super) fn knows_flights(&self) -> bool {
        self.scene.oscillator.contact().back_wall().is_none()
    }

    /// Target and time of the first passage that a part is of.
    fn target(&self, part: Part) -> Result<(Target, f64)> {
        let outputs = &self.scene.outputs;
        if matches!(part, Part::FirstLoss | Part::FirstLossPaths) {
            return Ok((Target::Loss, outputs.first_loss.unwrap_or(0.0)));
        }
        let it = (outputs.first_passage)
            .ok_or_else(|| Error::invalid("outputs.first_passage", "nothing", "a level"))?;
        Ok((Target::Level(it.level, it.side), it.until))
    }

    /// The spectrum that the scene asks for.
    fn spectrum(&self) -> Result<SpectrumRequest> {
        let asked = self.scene.outputs.spectrum;
        asked.ok_or_else(|| Error::invalid("outputs.spectrum", "nothing", "a spectrum"))
    }

    /// The records that Welch's method needs.
    fn samples(&self) -> Result<Samples> {
        let request = self.spectrum()?;
        let welch = welch(request.until)?;
        let (spacing, samples) = (welch.step(), welch.record_length(WELCH_SEGMENTS));
        let asked = self.scene.monte_carlo.as_ref().and_then(|it| it.duration);
        let wanted = self.scene.wants_records();
        let duration = asked.or(wanted.then_some(MonteCarlo::DURATION));
        // As long as the long realisations, if there are any.
        let records = duration.map_or((WELCH_AVERAGES / WELCH_SEGMENTS) as f64, |duration| {
            (duration / (samples as f64 * spacing)).ceil().max(32.0)
        });
        Ok(Samples {
            quantity: request.quantity,
            spacing,
            samples,
            records: records as u64,
        })
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
            moments: self.scene.outputs.moments.clone(),
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

/// Welch's method as in the paper, section 5.3.2, for a spectrum up to a circular frequency. Nyquist's is twice as high: what
/// aliases into the range lies beyond three times that frequency.
pub(super) fn welch(until: f64) -> Result<Welch> {
    Welch::new(WELCH_SAMPLES, WELCH_SAMPLES / 2, 0.5 * PI / until)
}

/// The stationary value that a fraction of is reached, in a law that is known.
pub(super) fn reached(quantity: Moment, law: &Moments) -> Result<Estimate> {
    let stationary = law.get(quantity).filter(|it| it.value.abs() > it.error);
    let name = quantity.name();
    stationary.ok_or_else(|| {
        let accepted = format!("a moment whose stationary value is not 0; that of {name} is");
        Error::invalid("outputs.reach.quantity", format!("{name:?}"), accepted)
    })
}
