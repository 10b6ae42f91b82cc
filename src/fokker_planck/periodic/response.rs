//! The periodic law over the frequency of the drive.

use super::harmonics::Harmonic;
use super::law::{MetastableLaw, Periodic, PeriodicLaw};
use crate::error::{Error, Result, ascending};
use crate::estimate::{Estimate, Lack, Origin, Shortfall};
use crate::excitation::Excitation;
use crate::fokker_planck::budget::{Cost, Limits};
use crate::fokker_planck::settings::Settings;
use crate::moments::Moment;
use crate::oscillator::Oscillator;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Phases that have a say in the mesh and the steps of a point.
const PHASES: usize = 16;

/// A response curve with noise: one entry per frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// Circular frequencies of the drive.
    pub frequency: Vec<f64>,
    /// Amplitude of the first harmonic of E\[q\].
    pub mean_q_1: Vec<Estimate>,
    /// Of the second.
    pub mean_q_2: Vec<Estimate>,
    /// Amplitude of the first harmonic of E\[N\], in static loads.
    pub mean_force_1: Vec<Estimate>,
    /// Probability to be out of contact, averaged over the phase; None for a law that cannot lose contact.
    pub contact_loss_probability: Option<Vec<Estimate>>,
    /// Modulus of the slowest Floquet multiplier: what is left of a deviation a period later. Near 1 the noise takes as long
    /// from one of two orbits to the other, and a sweep that does not wait so long shows hysteresis.
    pub multiplier: Vec<Estimate>,
    /// What a slow sweep shows that goes up, and one that goes down, where at some frequency two laws are metastable
    /// ([`Periodic::metastable`]): slower than a motion settles, faster than noise takes it from one to the other.
    pub sweeps: Option<[Sweep; 2]>,
    /// What the tolerance asked for and was not reached, at the worst frequency.
    pub shortfall: Option<Shortfall>,
    /// What the reader should know.
    pub warnings: Vec<String>,
}

/// A response curve on which every point keeps to the law nearest to the one before.
#[derive(Debug, Clone, PartialEq)]
pub struct Sweep {
    /// Amplitude of the first harmonic of E\[q\], at the frequencies in ascending order.
    pub mean_q_1: Vec<Estimate>,
    /// Of E\[N\].
    pub mean_force_1: Vec<Estimate>,
    /// Probability to be out of contact, averaged over the phase; None for a law that cannot lose contact.
    pub contact_loss_probability: Option<Vec<Estimate>>,
}

impl Sweep {
    /// In the order of the sweep. It begins with the more probable law.
    fn through<'a>(laws: impl Iterator<Item = &'a Periodic>) -> Self {
        // E[q] and its first harmonic as a point: the branches differ in phase too, or about what they swing.
        let point = |about: Option<Estimate>, it: &Harmonic| {
            let phase = it.phase.value;
            let (sine, cosine) = if phase.is_nan() {
                (0.0, 0.0)
            } else {
                phase.sin_cos()
            };
            let amplitude = it.amplitude.value;
            [
                about.map_or(0.0, |it| it.value),
                amplitude * cosine,
                amplitude * sine,
            ]
        };
        let mut last: Option<[f64; 3]> = None;
        let points = laws.map(|law| {
            let sides = law.metastable.as_ref().map_or(&[][..], |it| it);
            let far = |it: &MetastableLaw| match last {
                Some(last) => {
                    let here = point(it.displacement, &it.mean_q[0]);
                    let apart = here.iter().zip(last).map(|(x, last)| x - last);
                    apart.fold(0.0, f64::hypot)
                }
                None => -it.probability.value,
            };
            let near = sides.iter().min_by(|a, b| far(a).total_cmp(&far(b)));
            let (about, q, force, lost) = match near {
                None => {
                    let lost = law.contact_loss_probability;
                    (law.displacement(), &law.mean_q, &law.mean_force, lost)
                }
                Some(it) => {
                    let lost = it.contact_loss_probability;
                    (it.displacement, &it.mean_q, &it.mean_force, lost)
                }
            };
            last = Some(point(about, &q[0]));
            ((q[0].amplitude, force[0].amplitude), lost)
        });
        let (amplitudes, lost): (Vec<_>, Vec<Option<Estimate>>) = points.unzip();
        let (mean_q_1, mean_force_1) = amplitudes.into_iter().unzip();
        Self {
            mean_q_1,
            mean_force_1,
            contact_loss_probability: lost.into_iter().collect(),
        }
    }

    /// The same with its frequencies in the other order.
    fn reversed(mut self) -> Self {
        self.mean_q_1.reverse();
        self.mean_force_1.reverse();
        if let Some(lost) = &mut self.contact_loss_probability {
            lost.reverse();
        }
        self
    }

    /// Up and down, where two laws are metastable at any of the frequencies, which ascend.
    fn both(laws: &[Periodic]) -> Option<[Self; 2]> {
        let apart = laws.iter().any(|it| it.metastable.is_some());
        apart.then(|| {
            let down = Self::through(laws.iter().rev()).reversed();
            [Self::through(laws.iter()), down]
        })
    }
}

/// How a response curve will be computed: the periodic law at every frequency, each for itself.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ResponseCurve {
    frequencies: Vec<f64>,
    settings: Settings,
    /// The recipe at the first of them.
    first: PeriodicLaw,
    pub(crate) cost: Cost,
}

/// Points whose recipes a plan makes, at the most: each follows the motion without noise for long.
const FORESEEN: usize = 16;

/// The recipe of a point.
fn point(oscillator: &Oscillator, frequency: f64, settings: &Settings) -> Result<PeriodicLaw> {
    let drive = settings.excitation.drive.map(|it| it.at(frequency));
    let settings = Settings {
        excitation: Excitation {
            drive: drive.transpose()?,
            envelope: settings.excitation.envelope.clone(),
        },
        moments: Some(vec![
            Moment::MeanQ,
            Moment::MeanForce,
            Moment::ContactLossProbability,
        ]),
        ..settings.clone()
    };
    PeriodicLaw::of(oscillator, (PHASES, 0), &settings)
}

impl ResponseCurve {
    /// The recipe at these frequencies of the drive of the settings; its cost is told by some of them.
    pub(crate) fn of(
        oscillator: &Oscillator,
        frequencies: &[f64],
        settings: &Settings,
    ) -> Result<Self> {
        let count = frequencies.len();
        let each = count.div_ceil(FORESEEN).max(1);
        let seen: Vec<f64> = frequencies.iter().step_by(each).copied().collect();
        let points = seen.par_iter().map(|w| point(oscillator, *w, settings));
        let points: Result<Vec<_>> = points.collect();
        let mut points = points?;
        let threads = rayon::current_num_threads() as u64;
        let all = count as f64 / points.len().max(1) as f64;
        let costs = points.iter().map(PeriodicLaw::cost);
        let larger = |(a, b): ([usize; 2], [usize; 2])| [a[0].max(b[0]), a[1].max(b[1])];
        let none = Cost {
            cells: Some([0; 2]),
            ..Cost::default()
        };
        let cost = costs.fold(none, |sum, it| Cost {
            cells: sum.cells.zip(it.cells).map(larger),
            steps: sum.steps + (all * it.steps as f64) as u64,
            memory: sum.memory.max(it.memory.saturating_mul(threads)),
            seconds: sum.seconds + all * it.seconds / threads as f64,
        });
        Ok(Self {
            frequencies: frequencies.to_vec(),
            settings: settings.clone(),
            first: points.swap_remove(0),
            cost,
        })
    }

    /// Method and reason.
    pub(crate) fn words(&self) -> String {
        let count = self.frequencies.len();
        format!("{count} frequencies; {}", self.first.words())
    }

    /// What is to be said of frequencies at which two orbits last without noise, and noise does not mix them within a period.
    fn rivals(&self, recipes: &[PeriodicLaw], laws: &[Periodic]) -> Option<String> {
        let points = self.frequencies.iter().zip(recipes.iter().zip(laws));
        let both = points.filter(|(_, (recipe, law))| recipe.forming(law).is_some());
        let at: Vec<f64> = both.map(|it| *it.0).collect();
        let at = match at[..] {
            [] => return None,
            [one] => format!("at the frequency {one}"),
            [first, .., last] => {
                let count = at.len();
                format!("at {count} of the frequencies, {first} to {last}")
            }
        };
        Some(format!(
            "two orbits last without noise {at}: the law holds both; a multiplier, where there is one, says how long it takes to \
             form"
        ))
    }

    /// The curve. The points do not know of each other: the same bits for any number of threads.
    pub(crate) fn solve(
        &self,
        oscillator: &Oscillator,
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Response> {
        let done = AtomicUsize::new(0);
        let count = self.frequencies.len();
        let late = limits.late("the response curve");
        let laws: Result<Vec<(PeriodicLaw, Periodic)>> = self
            .frequencies
            .par_iter()
            .map(|w| {
                late()?;
                let recipe = point(oscillator, *w, &self.settings)?;
                let law = recipe.solve(oscillator, limits, &|_| ())?;
                let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                progress(done as f64 / count as f64);
                Ok((recipe, law))
            })
            .collect();
        let (recipes, laws): (Vec<PeriodicLaw>, Vec<Periodic>) = laws?.into_iter().unzip();
        let harmonic = |of: fn(&Periodic) -> &[Harmonic], k: usize| -> Vec<Estimate> {
            laws.iter().map(|law| of(law)[k - 1].amplitude).collect()
        };
        let lost: Option<Vec<Estimate>> =
            laws.iter().map(|it| it.contact_loss_probability).collect();
        let unknown = Estimate::new(f64::NAN, f64::NAN, Origin::Space);
        let slowest = |(law, recipe): (&Periodic, &PeriodicLaw)| {
            recipe.slowest(law).map_or(unknown, |it| {
                Estimate::new(it.modulus(), it.error, Origin::Space)
            })
        };
        let short = laws.iter().zip(&self.frequencies);
        let short = short.filter_map(|(law, w)| Some((w, law.shortfall.clone()?)));
        let shortfall = short
            .max_by(|(_, a), (_, b)| a.ratio().total_cmp(&b.ratio()))
            .map(|(w, mut it)| {
                if let Lack::Accuracy { number, .. } = &mut it.lack {
                    *number = format!("{number} of the law at the frequency {w}");
                }
                it
            });
        Ok(Response {
            frequency: self.frequencies.clone(),
            mean_q_1: harmonic(|it| &it.mean_q, 1),
            mean_q_2: harmonic(|it| &it.mean_q, 2),
            mean_force_1: harmonic(|it| &it.mean_force, 1),
            contact_loss_probability: lost,
            multiplier: laws.iter().zip(&recipes).map(slowest).collect(),
            sweeps: Sweep::both(&laws),
            warnings: self.rivals(&recipes, &laws).into_iter().collect(),
            shortfall,
        })
    }
}

/// The response curve at `frequencies`, ascending, the drive of `settings.excitation` giving amplitude and phase: every
/// point the periodic law of its own frequency, the only one there is; where two laws are metastable, both sweeps beside
/// it. `progress` is told the part done, 0 to 1.
///
/// # Errors
/// Those of [`super::periodic()`].
pub fn response(
    oscillator: &Oscillator,
    frequencies: &[f64],
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Response> {
    settings.check()?;
    ascending("outputs.response", "frequencies", frequencies)?;
    if frequencies.is_empty() {
        let accepted = "at least one frequency";
        return Err(Error::invalid("outputs.response", "[]", accepted));
    }
    let recipe = ResponseCurve::of(oscillator, frequencies, settings)?;
    recipe.solve(oscillator, &settings.limits(), progress)
}
