//! Long records: stationary statistics by time averages.

use super::batch::{Batch, BatchMeans, Units};
use super::events::{Burst, CrossingSums, Crossings, Deaf, FEW_BURSTS, FlightBins, Logbook, Watch};
use super::histogram::{BatchCounts, Bins, Histogram};
use super::law::{self, Law, WithLaw};
use super::noise::LANES;
use super::paths::{Paths, highest_frequency};
use super::scheme::{self, Coefficients, Group};
use super::statistics::unknown;
use super::{Noise, Progress, Scheme, check_bins, choose};
use crate::error::{Error, Result, positive};
use crate::estimate::Warning;
use crate::initial::Initial;
use crate::moments::Moments;
use crate::oscillator::Oscillator;
use rayon::prelude::*;

/// Fewest and most groups of records side by side: 64 to 1024 records, so that there are always enough
/// batches for an error. Every record starts in the stationary law, so short ones do no harm.
const GROUPS: [f64; 2] = [4.0, 64.0];

/// Length, seed and scheme of long records.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordSettings {
    /// Time observed, dimensionless, all records together.
    pub duration: f64,
    /// Seed; with a record's number it fixes the record.
    pub seed: u64,
    /// How one step is made.
    pub scheme: Scheme,
    /// Longest step; None chooses one.
    pub step: Option<f64>,
    /// The excitation.
    pub noise: Noise,
    /// Bins of every histogram.
    pub bins: usize,
    /// Seconds after which the records give up with [`Error::Limit`].
    pub max_seconds: f64,
}

impl Default for RecordSettings {
    fn default() -> Self {
        Self {
            duration: 1e6,
            seed: 1,
            scheme: Scheme::Auto,
            step: None,
            noise: Noise::White,
            bins: 100,
            max_seconds: f64::INFINITY,
        }
    }
}

/// Stationary statistics of long records; every error is one standard error from batch means, what losses
/// of contact show by the number of their independent bursts.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordResult {
    /// The moments.
    pub moments: Moments,
    /// The moments with the exact identities E\[N\] = 0, E\[q N\] = T, E\[v^2\] = T and E\[q v\] = 0 as control
    /// variates: the same sample, smaller errors. What the identities fix is left as in `moments`.
    pub controlled: Moments,
    /// Independent samples that would give the mean of q, of N and of H the same errors.
    pub effective_samples: [f64; 3],
    /// Number of batches.
    pub batches: u64,
    /// Length of a batch: 20 memories of the oscillator unless the records are shorter.
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

/// Stationary statistics from records that start in the exact stationary law. With a sum of cosines,
/// whose stationary law is not known, the first batch of each record is thrown away.
///
/// `progress` is called, from any thread, with the fraction of the work done, 0 to 1.
///
/// # Errors
/// [`Error::NoStationaryLaw`] for a contact that does not confine; [`Error::Invalid`] for a duration or
/// step that is not positive or that together make more steps than can be counted, no bins, or a noise
/// that does not suit the scheme; [`Error::Limit`] where `max_seconds` are over.
pub fn records(
    oscillator: &Oscillator,
    settings: &RecordSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<RecordResult> {
    let plan = Plan::new(oscillator, settings)?;
    let size = &plan.size;
    let work = size.groups * (size.batches + size.burn_in);
    let progress = &Progress::new(work, progress).within(settings.max_seconds);
    let run = Records {
        plan: &plan,
        progress,
    };
    let sums = law::dispatch(oscillator.contact(), run);
    progress.in_time()?;
    let contact = oscillator.contact();
    let batches = sums.means.count() as u64;
    let mut warnings: Vec<Warning> = Vec::new();
    let effective_samples = sums.means.effective_samples();
    let worth = effective_samples.into_iter().fold(f64::INFINITY, f64::min);
    if worth < 50.0 {
        let text = format!(
            "the records are worth only {worth:.0} independent samples, so that their errors are rough: \
             the oscillator forgets in a time of {:.1e}; lengthen monte_carlo.duration",
            oscillator.memory()
        );
        warnings.push(text.into());
    }
    let cosines = settings.noise.warning(oscillator.zeta());
    warnings.extend(cosines.map(Warning::from));
    let step = (size.scheme, size.step);
    let biased = scheme::bias_warning(step, oscillator, size.frequency, effective_samples[2]);
    warnings.extend(biased.map(|text| Warning {
        text,
        unknown: unknown("records", &[None]),
    }));
    let share = plan.burst.map(|burst| burst.share(size.batch_length));
    let moments = sums.means.moments(&plan.units, share);
    if !moments.mean_energy.value.is_finite() {
        warnings.push(Warning {
            text: format!(
                "the records are not finite, and none of their numbers is known: the step {} is too long for the \
                 scheme {}; leave monte_carlo.step out to have one chosen",
                size.step, size.scheme
            ),
            unknown: unknown("records", &[None]),
        });
    }
    let lossy = contact.loss_point().is_some();
    if lossy && !size.scheme.locates_crossings() {
        let text = format!(
            "losses of contact are not counted: the scheme {} does not locate them; ask for \
             monte_carlo.scheme = \"splitting_4_2\", whose steps are short under strong friction",
            size.scheme
        );
        warnings.push(text.into());
    }
    let crossings = sums.crossings.as_ref().zip(plan.flights.zip(plan.burst));
    let crossings = crossings.map(|(sums, (bins, burst))| sums.crossings(bins, burst));
    if let Some(it) = &crossings
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
    Ok(RecordResult {
        moments,
        controlled: sums.means.controlled_moments(&plan.units, share),
        effective_samples,
        batches,
        batch_length: size.batch_length,
        records: size.records(),
        duration: batches as f64 * size.batch_length,
        displacement: sums.counts[0].histogram(plan.bins[0], false),
        velocity: sums.counts[1].histogram(plan.bins[1], false),
        force: sums.counts[2].histogram(plan.bins[2], lossy),
        crossings,
        step: size.step,
        scheme: size.scheme,
        path_steps: size.path_steps(),
        warnings,
    })
}

/// How much work records are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordSize {
    /// The scheme, never [`Scheme::Auto`].
    pub scheme: Scheme,
    /// The step.
    pub step: f64,
    /// Number of records.
    pub records: u64,
    /// Steps of each.
    pub steps: u64,
    /// Steps of all.
    pub path_steps: u64,
    /// Bytes, roughly.
    pub memory: u64,
}

/// The size of the records that [`records`] would make.
///
/// # Errors
/// As [`records`], but for a missing stationary law.
pub fn record_size(oscillator: &Oscillator, settings: &RecordSettings) -> Result<RecordSize> {
    let size = Size::new(oscillator, settings)?;
    let records = size.records();
    // Counts of each of five histograms by lane, and their sums.
    let bins = settings.bins as u64 + 2;
    Ok(RecordSize {
        scheme: size.scheme,
        step: size.step,
        records,
        steps: size.path_steps() / records,
        path_steps: size.path_steps(),
        memory: size.groups * 5 * bins * (4 * LANES as u64 + 24),
    })
}

/// How the records are cut.
struct Size {
    scheme: Scheme,
    step: f64,
    frequency: f64,
    /// Groups of [`LANES`] records, batches per record, samples per batch, steps per sample.
    groups: u64,
    batches: u64,
    samples: u64,
    steps: u64,
    /// Batches thrown away.
    burn_in: u64,
    batch_length: f64,
}

impl Size {
    fn new(oscillator: &Oscillator, settings: &RecordSettings) -> Result<Self> {
        let duration = positive("monte_carlo.duration", settings.duration)?;
        check_bins(settings.bins, 1)?;
        let frequency = highest_frequency(oscillator, &Initial::Stationary);
        let (scheme, step) = choose(
            (settings.scheme, settings.step),
            settings.noise,
            oscillator,
            frequency,
        )?;
        if let Noise::Band { band } = settings.noise
            && band * step > std::f64::consts::PI
        {
            let accepted = format!("at most pi/step = {:.4}", std::f64::consts::PI / step);
            return Err(Error::invalid("monte_carlo.noise.band", band, accepted));
        }
        // Samples closer than this tell nothing new.
        let memory = oscillator.memory();
        let steps = (0.01 * memory.clamp(50.0, 1e9) / step).round().max(1.0);
        let spacing = steps * step;
        let longest = (20.0 * memory / spacing).ceil();
        let lanes = LANES as f64;
        let groups = (duration / (lanes * 2.0 * longest * spacing)).floor();
        let groups = groups.clamp(GROUPS[0], GROUPS[1]);
        let samples = (duration / (groups * lanes * spacing)).ceil().max(1.0);
        let batches = (samples / longest).floor().max(1.0);
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
        Ok(Self {
            scheme,
            step,
            frequency,
            groups: groups as u64,
            batches: batches as u64,
            samples: samples as u64,
            steps: steps as u64,
            burn_in: u64::from(settings.noise != Noise::White),
            batch_length: samples * spacing,
        })
    }

    fn records(&self) -> u64 {
        self.groups * LANES as u64
    }

    fn path_steps(&self) -> u64 {
        self.records() * (self.batches + self.burn_in) * self.samples * self.steps
    }
}

/// Everything fixed before the first step.
struct Plan {
    size: Size,
    paths: Paths,
    coefficients: Coefficients,
    units: Units,
    /// For q, v and N.
    bins: [Bins; 3],
    flights: Option<FlightBins>,
    /// None for a law that cannot lose contact.
    burst: Option<Burst>,
}

impl Plan {
    fn new(oscillator: &Oscillator, settings: &RecordSettings) -> Result<Self> {
        let law = oscillator.displacement_law()?;
        let size = Size::new(oscillator, settings)?;
        let Size {
            scheme,
            step,
            frequency,
            ..
        } = size;
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
            paths: Paths::new(
                oscillator,
                &Initial::Stationary,
                settings.seed,
                settings.noise,
                scheme,
                step,
            )?,
            coefficients: Coefficients::new(scheme, oscillator, step, frequency),
            units: Units::new(contact, &law, temperature),
            bins: [
                Bins::new(left, right, settings.bins),
                Bins::new(-5.7 * deviation, 5.7 * deviation, settings.bins),
                Bins::new(force[0], force[1], settings.bins),
            ],
            flights: fall
                .filter(|_| scheme.locates_crossings())
                .map(|fall| FlightBins::new(deviation, fall, settings.bins)),
            burst: Burst::of(oscillator, size.batch_length),
            size,
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
    fn new(plan: &Plan) -> Self {
        Self {
            means: BatchMeans::new(),
            counts: plan.bins.map(BatchCounts::new),
            crossings: plan.flights.map(CrossingSums::new),
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

/// The records, to be run once the contact law is known.
struct Records<'a> {
    plan: &'a Plan,
    progress: &'a Progress<'a>,
}

impl WithLaw for Records<'_> {
    type Output = RecordSums;

    fn with<L: Law>(self, law: L) -> RecordSums {
        let parts: Vec<RecordSums> = (0..self.plan.size.groups)
            .into_par_iter()
            .map(|group| match self.plan.flights {
                Some(bins) => self.group(law, group, Some(bins)),
                None => self.group(law, group, None),
            })
            .collect();
        let mut total = RecordSums::new(self.plan);
        for part in &parts {
            total.add(part);
        }
        self.progress.finish();
        total
    }
}

impl Records<'_> {
    fn group<L: Law>(&self, law: L, number: u64, flights: Option<FlightBins>) -> RecordSums {
        let plan = self.plan;
        let mut sums = RecordSums::new(plan);
        let mut group = plan.paths.group(number * LANES as u64);
        let mut hits = plan.bins.map(|bins| vec![vec![0u32; bins.slots()]; LANES]);
        let mut logbook = flights.map(|bins| Logbook::new(bins, |lane| group.q[lane] < law.loss()));
        let arch = pulp::Arch::new();
        for number in 0..plan.size.burn_in + plan.size.batches {
            if self.progress.late() {
                break;
            }
            let keep = number >= plan.size.burn_in;
            let mut batch = Batch::new();
            let start = number * plan.size.samples;
            let record = RunBatch {
                law,
                plan,
                start,
                group: &mut group,
                batch: &mut batch,
                hits: &mut hits,
            };
            match &mut logbook {
                Some(logbook) => arch.dispatch(Watched {
                    record,
                    watch: logbook,
                }),
                None => arch.dispatch(Watched {
                    record,
                    watch: &mut Deaf,
                }),
            }
            let now = (start + plan.size.samples) as f64 * plan.size.steps as f64 * plan.size.step;
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
            self.progress.add(1);
        }
        sums.crossings = logbook.map(Logbook::into_sums);
        sums
    }
}

/// One batch of one group.
struct RunBatch<'a, L> {
    law: L,
    plan: &'a Plan,
    /// Samples before it.
    start: u64,
    group: &'a mut Group,
    batch: &'a mut Batch,
    hits: &'a mut [Vec<Vec<u32>>; 3],
}

/// [`RunBatch`] with someone who hears of the crossings.
struct Watched<'a, 'b, L, W> {
    record: RunBatch<'a, L>,
    watch: &'b mut W,
}

impl<L: Law, W: Watch> pulp::WithSimd for Watched<'_, '_, L, W> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let RunBatch {
            law,
            plan,
            start,
            group,
            batch,
            hits,
        } = self.record;
        let spacing = plan.size.steps as f64 * plan.size.step;
        for k in 0..plan.size.samples {
            let now = (start + k) as f64 * spacing;
            plan.coefficients
                .advance(law, group, plan.size.steps, now, self.watch);
            batch.sample(law, &plan.units, &group.q, &group.v);
            for lane in 0..LANES {
                let (q, v) = (group.q[lane], group.v[lane]);
                let force = if q < law.loss() {
                    plan.bins[2].dirac()
                } else {
                    plan.bins[2].slot(law.force(q))
                };
                let slots = [plan.bins[0].slot(q), plan.bins[1].slot(v), force];
                for (hits, slot) in hits.iter_mut().zip(slots) {
                    hits[lane][slot] += 1;
                }
            }
        }
    }
}

#[cfg(test)]
#[path = "records_tests.rs"]
mod tests;
