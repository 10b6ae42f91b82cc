//! Long realisations: stationary statistics by time averages.

use super::batch::{Batch, BatchMeans, Units, are_long, worth};
use super::events::{
    Burst, CrossingSums, Crossings, Deaf, FEW_BURSTS, Logbook, PATIENCE, ReturnBins, Watch,
};
use super::histogram::{BatchCounts, Bins, Histogram};
use super::law::{self, Law, WithLaw};
use super::noise::LANES;
use super::paths::Paths;
use super::progress::{Progress, Timed};
use super::scheme::{Coefficients, Group};
use super::statistics::unknown;
use super::walk::{Walk, not_run_in, run_in};
use super::{Noise, Sampling, Scheme};
use crate::budget::{Cost, Limits};
use crate::error::{Error, Result, positive};
use crate::estimate::Warning;
use crate::initial::Initial;
use crate::matrix::vectorise;
use crate::moments::Moments;
use crate::oscillator::Oscillator;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Fewest and most groups of records side by side: 64 to 1024 records, so that there are always enough
/// batches for an error. Every record starts in the stationary law, so short ones do no harm.
const GROUPS: [f64; 2] = [4.0, 64.0];

/// Bins of every histogram.
const BINS: usize = 100;

/// Stationary statistics of long realisations; every error is one standard error from batch means, what losses
/// of contact show by the number of their independent bursts.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordResult {
    /// The moments.
    pub moments: Moments,
    /// The moments with the exact identities E\[N\] = 0, E\[q N\] = T, E\[v^2\] = T and E\[q v\] = 0 as control
    /// variates: the same sample, smaller errors. What the identities fix is left as in `moments`, and everything is where the records
    /// are worth less than a thousand independent samples.
    pub controlled: Moments,
    /// Independent samples that would give the mean of q, of N and of H the same errors.
    pub effective_samples: [f64; 3],
    /// Number of batches.
    pub batches: u64,
    /// Length of a batch: 20 correlation times of the oscillator unless the records are shorter.
    pub batch_length: f64,
    /// Number of records.
    pub records: u64,
    /// Time observed, all records together; what was asked for, rounded up to whole batches.
    pub duration: f64,
    /// Density of q.
    pub displacement: Histogram,
    /// Density of v.
    pub velocity: Histogram,
    /// Density of N in contact, the Dirac mass of flight beside it.
    pub force: Histogram,
    /// Losses and returns of contact; None for a law that cannot lose contact and for a scheme that does
    /// not locate them.
    pub crossings: Option<Crossings>,
    /// The step.
    pub step: f64,
    /// The scheme used, never [`Scheme::Auto`].
    pub scheme: Scheme,
    /// Steps of all records.
    pub path_steps: u64,
    /// What a reader of the numbers should know.
    pub warnings: Vec<Warning>,
}

/// Independent samples below which errors are rough: that of the kurtosis of N was rms 2.2 standard errors at 64, 1.2 at 160.
const ROUGH: f64 = 100.0;

/// Most batches of a record: the mean of each is kept.
const BATCHES: f64 = 64.0;

/// Stationary statistics from records that start in the exact stationary law. With a sum of cosines,
/// whose stationary law is not known, the first batch of each record is thrown away; with a damping that is not viscous
/// they start in the reference law, and as many batches are.
///
/// `progress` is called, from any thread, with the fraction of the work done, 0 to 1.
///
/// # Errors
/// [`Error::NoStationaryLaw`] for a contact that does not confine; [`Error::Invalid`] for a duration or
/// step that is not positive or that together make more steps than can be counted, or a noise
/// that does not suit the scheme; [`Error::Limit`] where `max_seconds` are over.
pub fn records(
    oscillator: &Oscillator,
    settings: &Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<RecordResult> {
    Records::of(oscillator, settings)?.run(oscillator, settings.limits(), progress)
}

/// How long realisations will be drawn, and how they are cut.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Records {
    pub(crate) walk: Walk,
    /// Groups of [`LANES`] records, batches per record, samples per batch, steps per sample.
    groups: u64,
    batches: u64,
    samples: u64,
    steps: u64,
    /// Batches thrown away.
    burn_in: u64,
    /// Whether the batches of a record make one: those of a sum of cosines have its frequencies and amplitudes in common.
    joined: bool,
    batch_length: f64,
    /// What they will take.
    pub(crate) cost: Cost,
}

impl Records {
    pub(crate) fn of(oscillator: &Oscillator, settings: &Sampling) -> Result<Self> {
        let duration = positive("monte_carlo.duration", settings.duration)?;
        let walk = Walk::of(oscillator, &Initial::Stationary, settings)?;
        let step = walk.step;
        if let Noise::Band { band } = walk.noise
            && band * step > PI
        {
            let accepted = format!("at most pi/step = {:.4}", PI / step);
            return Err(Error::invalid("monte_carlo.noise.band", band, accepted));
        }
        // Samples closer than this tell nothing new.
        let correlation_time = oscillator.correlation_time();
        let steps = (0.01 * correlation_time.clamp(50.0, 1e9) / step)
            .round()
            .max(1.0);
        let spacing = steps * step;
        let longest = (20.0 * correlation_time / spacing).ceil();
        let lanes = LANES as f64;
        let groups = (duration / (lanes * 2.0 * longest * spacing)).floor();
        let groups = groups.clamp(GROUPS[0], GROUPS[1]);
        let samples = (duration / (groups * lanes * spacing)).ceil().max(1.0);
        let batches = match oscillator.contact().barrier() {
            None => (samples / longest).floor().clamp(1.0, BATCHES),
            // What a motion remembers longest is its well.
            Some(_) => 1.0,
        };
        let samples = (samples / batches).ceil();
        let all = groups * batches * samples * steps;
        // Not a number where the step or the duration leaves the range of doubles.
        if all.is_nan() || all > 1e15 {
            let (key, value) = match settings.step {
                Some(step) => ("monte_carlo.step", step),
                None => ("monte_carlo.duration", duration),
            };
            let accepted = format!(
                "at most 1e15 steps of every lane; a duration of {duration:?} in steps of {step:?} takes more"
            );
            return Err(Error::invalid(key, format!("{value:?}"), accepted));
        }
        let threads = rayon::current_num_threads() as u64;
        let run_in = run_in(oscillator, &Initial::Stationary) / (samples * spacing);
        let joined = matches!(walk.noise, Noise::Cosines { .. });
        let burn_in = (run_in.ceil() as u64).max(u64::from(walk.noise != Noise::White));
        let mut it = Self {
            groups: groups as u64,
            batches: batches as u64,
            samples: samples as u64,
            steps: steps as u64,
            burn_in,
            joined,
            batch_length: samples * spacing * if joined { batches } else { 1.0 },
            // Sums of each of four histograms of every group, and counts by lane of those that run.
            cost: Cost {
                memory: (BINS as u64 + 2) * 4 * (groups as u64 * 24 + threads * 4 * LANES as u64)
                    + threads * walk.bytes(),
                ..Cost::default()
            },
            walk,
        };
        it.cost.steps = (it.batches + it.burn_in) * it.samples * it.steps;
        it.cost.seconds = it.walk.seconds(oscillator, it.path_steps() as f64);
        Ok(it)
    }

    /// Number, scheme, step and reason.
    pub(crate) fn words(&self) -> String {
        format!("{} records, {}", self.records(), self.walk.words())
    }

    pub(crate) fn records(&self) -> u64 {
        self.groups * LANES as u64
    }

    fn path_steps(&self) -> u64 {
        self.records() * self.cost.steps
    }

    /// The records.
    pub(crate) fn run(
        &self,
        oscillator: &Oscillator,
        limits: Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<RecordResult> {
        limits.holds("the records", self.cost.memory)?;
        let work = self.groups * (self.batches + self.burn_in);
        let progress = &Progress::new(work, limits, progress);
        let run = Run::new(self, oscillator, progress)?;
        let sums = law::dispatch(oscillator, &run);
        progress.finish()?;
        let effective_samples = sums.means.effective_samples();
        let share = run.burst.map(|burst| burst.share(self.batch_length));
        let moments = sums.means.moments(&run.units, share);
        let crossings = sums.crossings.as_ref().zip(run.flights.zip(run.burst));
        let crossings = crossings.map(|(sums, (bins, burst))| sums.crossings(bins, burst));
        let warnings = self.warnings(oscillator, effective_samples, &moments, crossings.as_ref());
        let batches = sums.means.count() as u64;
        let lossy = oscillator.contact().loss_point().is_some();
        Ok(RecordResult {
            controlled: sums.means.controlled_moments(&run.units, share, &moments),
            moments,
            effective_samples,
            batches,
            batch_length: self.batch_length,
            records: self.records(),
            duration: batches as f64 * self.batch_length,
            displacement: sums.counts[0].histogram(run.bins[0], false),
            velocity: sums.counts[1].histogram(run.bins[1], false),
            force: sums.counts[2].histogram(run.bins[2], lossy),
            crossings,
            step: self.walk.step,
            scheme: self.walk.scheme,
            path_steps: self.path_steps(),
            warnings,
        })
    }

    /// What limits the numbers.
    fn warnings(
        &self,
        oscillator: &Oscillator,
        effective_samples: [f64; 3],
        moments: &Moments,
        crossings: Option<&Crossings>,
    ) -> Vec<Warning> {
        let walk = &self.walk;
        let mut warnings: Vec<Warning> = Vec::new();
        // Moments, and what losses show.
        let every = || {
            let losses = Crossings::NAMES.map(|name| format!("records.{name}"));
            let losses = crossings.iter().flat_map(|_| losses.clone());
            let moments = unknown("records", &[None]).into_iter();
            moments.chain(losses).collect()
        };
        let worth = worth(effective_samples);
        if worth < ROUGH {
            let text = format!(
                "the records are worth only {worth:.0} independent samples, so that their errors are rough: \
                 the oscillator forgets in a time of {:.1e}; lengthen monte_carlo.duration",
                oscillator.relaxation_time()
            );
            warnings.push(text.into());
        }
        warnings.extend(not_run_in(oscillator, &Initial::Stationary, every));
        warnings.extend(walk.noise.warnings(oscillator.zeta()));
        warnings.extend(walk.warning(walk.bias(oscillator), effective_samples[2], every));
        if !moments.mean_energy.value.is_finite() {
            warnings.push(Warning {
                text: format!(
                    "the records are not finite, and none of their numbers is known: the step {} is too long for the \
                     scheme {}; leave monte_carlo.step out to have one chosen",
                    walk.step, walk.scheme
                ),
                unknown: every(),
            });
        }
        if oscillator.contact().loss_point().is_some() && !walk.scheme.locates_crossings() {
            let text = format!(
                "losses of contact are not counted: the scheme {} does not locate them; ask for \
                 monte_carlo.scheme = \"splitting_4_2\", whose steps are short under strong friction",
                walk.scheme
            );
            warnings.push(text.into());
        }
        if let Some(it) = crossings
            && it.losses > 0
            && it.bursts < FEW_BURSTS
        {
            let text = format!(
                "the {} losses of contact came in about {:.1} independent bursts, so that the errors of \
                 contact_loss_probability, loss_rate, mean_flight and mean_impact_speed are rough; lengthen \
                 monte_carlo.duration",
                it.losses, it.bursts
            );
            warnings.push(text.into());
        }
        warnings
    }
}

impl RecordResult {
    /// Whether they are long enough for control variates.
    pub(crate) fn are_long(&self) -> bool {
        are_long(self.effective_samples)
    }
}

/// The records, to be run once the contact law is known.
struct Run<'a> {
    recipe: &'a Records,
    paths: Paths,
    coefficients: Coefficients,
    units: Units,
    /// For q, v and N.
    bins: [Bins; 3],
    flights: Option<ReturnBins>,
    /// None for a law that cannot lose contact.
    burst: Option<Burst>,
    progress: &'a Progress<'a>,
}

impl<'a> Run<'a> {
    fn new(
        recipe: &'a Records,
        oscillator: &Oscillator,
        progress: &'a Progress<'a>,
    ) -> Result<Self> {
        let law = oscillator.displacement_law()?;
        let walk = &recipe.walk;
        let temperature = oscillator.temperature();
        let deviation = temperature.sqrt();
        let contact = oscillator.contact();
        // Beyond 16 T above the lowest energy lies a share of about 1e-7.
        let (left, right) = contact
            .turning_points(16.0 * temperature)
            .unwrap_or((-1.0, 1.0));
        let force = [left, right].map(|q| contact.force(q));
        let fall = contact.loss_point().map(|loss| -contact.force(loss));
        Ok(Self {
            recipe,
            paths: Paths::new(oscillator, &Initial::Stationary, walk)?,
            coefficients: walk.coefficients(oscillator, walk.step),
            units: Units::new(contact, &law, temperature),
            bins: [
                Bins::new(left, right, BINS),
                Bins::new(-5.7 * deviation, 5.7 * deviation, BINS),
                Bins::new(force[0], force[1], BINS),
            ],
            flights: fall
                .filter(|_| walk.scheme.locates_crossings())
                .map(|fall| ReturnBins::new(deviation, fall, BINS)),
            burst: Burst::of(oscillator, recipe.batch_length),
            progress,
        })
    }
}

/// Everything summed over the batches of some groups.
struct RecordSums {
    means: BatchMeans,
    counts: [BatchCounts; 3],
    crossings: Option<CrossingSums>,
}

impl RecordSums {
    fn new(run: &Run) -> Self {
        Self {
            means: BatchMeans::new(),
            counts: run.bins.map(BatchCounts::new),
            crossings: run.flights.map(CrossingSums::new),
        }
    }

    fn add(&mut self, more: &Self) {
        self.means.add(&more.means);
        for (mine, theirs) in self.counts.iter_mut().zip(&more.counts) {
            mine.add(theirs);
        }
        if let (Some(mine), Some(theirs)) = (&mut self.crossings, &more.crossings) {
            mine.add(theirs);
        }
    }
}

impl WithLaw for &Run<'_> {
    type Output = RecordSums;

    fn with<L: Law>(self, law: L) -> RecordSums {
        let groups = (0..self.recipe.groups).into_par_iter();
        let parts: Vec<RecordSums> = groups.map(|group| self.group(law, group)).collect();
        let mut total = RecordSums::new(self);
        for part in &parts {
            total.add(part);
        }
        total
    }
}

impl Run<'_> {
    fn group<L: Law>(&self, law: L, number: u64) -> RecordSums {
        let recipe = self.recipe;
        let mut sums = RecordSums::new(self);
        // Many groups of many cosines take long to lay out alone.
        if self.progress.late() {
            return sums;
        }
        let mut group = self.paths.group(number * LANES as u64);
        let mut hits = self.bins.map(|bins| vec![vec![0u32; bins.slots()]; LANES]);
        let out = |lane: usize| law.is_lost(group.q[lane]);
        let mut logbook = self.flights.map(|bins| Logbook::new(bins, out));
        let mut batch = Batch::new();
        let count = recipe.burn_in + recipe.batches;
        for number in 0..count {
            let keep = number >= recipe.burn_in;
            let start = number * recipe.samples;
            let state = (start, &mut group, &mut batch, &mut hits);
            match &mut logbook {
                Some(watch) => self.batch(law, state, watch),
                None => self.batch(law, state, &mut Deaf),
            }
            if self.progress.late() {
                break;
            }
            self.progress.add(1);
            if keep && recipe.joined && number + 1 < count {
                continue;
            }
            let now = (start + recipe.samples) as f64 * recipe.steps as f64 * recipe.walk.step;
            if let Some(logbook) = &mut logbook {
                logbook.end_batch(now, keep);
            }
            if keep {
                sums.means.push(&batch);
            }
            for (counts, hits) in sums.counts.iter_mut().zip(&mut hits) {
                for hits in hits {
                    if keep {
                        counts.push(hits);
                    }
                    hits.fill(0);
                }
            }
            batch = Batch::new();
        }
        sums.crossings = logbook.map(Logbook::into_sums);
        sums
    }

    /// One batch of one group, with someone who hears of the crossings.
    fn batch<L: Law, W: Watch>(
        &self,
        law: L,
        (start, group, batch, hits): (u64, &mut Group, &mut Batch, &mut [Vec<Vec<u32>>; 3]),
        watch: &mut W,
    ) {
        let steps = self.recipe.steps;
        let spacing = steps as f64 * self.recipe.walk.step;
        let watch = &mut Timed {
            watch,
            progress: self.progress,
        };
        let patience = (PATIENCE / steps).max(1);
        vectorise!({
            for k in 0..self.recipe.samples {
                if k % patience == patience - 1 && watch.late() {
                    break;
                }
                let now = (start + k) as f64 * spacing;
                self.coefficients.advance(law, group, steps, now, watch);
                batch.sample(law, &self.units, &group.q, &group.v);
                for lane in 0..LANES {
                    let (q, v) = (group.q[lane], group.v[lane]);
                    let force = if law.is_lost(q) {
                        self.bins[2].dirac()
                    } else {
                        self.bins[2].slot(law.force(q))
                    };
                    let slots = [self.bins[0].slot(q), self.bins[1].slot(v), force];
                    for (hits, slot) in hits.iter_mut().zip(slots) {
                        hits[lane][slot] += 1;
                    }
                }
            }
        });
    }
}
