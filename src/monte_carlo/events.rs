//! Losses and returns of contact: how often, for how long, how fast.

use super::histogram::{BatchCounts, Bins, Histogram};
use super::noise::LANES;
use super::statistics::unseen;
use crate::estimate::{Estimate, Origin, skewed_variance};
use crate::oscillator::Oscillator;
use std::f64::consts::PI;

/// Losses of contact in stationary motion, each located between steps. Errors from the scatter of batches
/// longer than the correlation time, and from the number of those that saw a loss.
#[derive(Debug, Clone, PartialEq)]
pub struct Crossings {
    /// Time observed, all records together.
    pub time: f64,
    /// Losses of contact seen.
    pub losses: u64,
    /// Independent bursts of equal size that would scatter as these losses do: (sum of x)^2/(sum of x^2)
    /// over the losses x of each batch; 0 without a loss.
    pub bursts: f64,
    /// Losses per unit time.
    pub loss_rate: Estimate,
    /// Share of the time out of contact: P(q < q_loss).
    pub lost_share: Estimate,
    /// Mean time from a loss to the return: time out of contact over losses.
    pub mean_flight: Estimate,
    /// Mean speed |v| at the return.
    pub mean_impact_speed: Estimate,
    /// Density of the time from a loss to the return, of flights seen whole: it lacks those that are not short beside a record.
    pub flight_time: Histogram,
    /// Density of the speed at the return.
    pub impact_speed: Histogram,
    /// Both together.
    pub impacts: Impacts,
}

/// The joint density of time of flight and speed at the return, averaged over cells.
#[derive(Debug, Clone, PartialEq)]
pub struct Impacts {
    /// Ends of the cells along the time of flight.
    pub times: Vec<f64>,
    /// Ends of the cells along the speed.
    pub speeds: Vec<f64>,
    /// Mean density over each cell, speed running fastest, one standard error on every cell.
    pub density: Vec<Estimate>,
}

impl Crossings {
    /// The names of its numbers.
    pub(crate) const NAMES: [&str; 4] = [
        "loss_rate",
        "losses_in_window",
        "mean_flight",
        "mean_impact_speed",
    ];

    /// Mean number of losses in a dimensionless time.
    pub fn losses_in(&self, time: f64) -> Estimate {
        self.loss_rate.scaled(time)
    }
}

/// Independent bursts below which the errors of what losses of contact show are said to be rough: with 20
/// a standard error is itself known to some 20 %.
pub(super) const FEW_BURSTS: f64 = 20.0;

/// Losses of contact come in bursts: the energy stays near that of the loss, E, for about as long as friction
/// needs to take T from it. Of the losses a share A is not a repetition (Mel'nikov and Meshkov, J. Chem. Phys.
/// 85, 1018, 1986), ln A = (1/2 pi) times the integral of ln(1 - exp(-delta (x^2 + 1/4)))/(x^2 + 1/4), with
/// delta = 4 pi zeta E/T the loss of energy in a period of the linear oscillator, in T. The number of losses in
/// a burst is taken as geometric with the mean 1/A. Few bursts do not show how large they can be; this is the
/// least that is believed of one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Burst {
    /// Mean square of the losses in a burst.
    losses: f64,
    /// Mean square of the time out of contact in a burst.
    time: f64,
}

/// The flights of a burst are alike, and long in a large burst: the mean square of their sum is about this
/// many times that of as many independent ones.
const ALIKE: f64 = 2.0;

impl Burst {
    /// The burst of an oscillator in batches of `length`; None for a law that cannot lose contact.
    pub(super) fn of(oscillator: &Oscillator, length: f64) -> Option<Self> {
        let contact = oscillator.contact();
        let loss = contact.loss_point()?;
        let temperature = oscillator.temperature();
        let rise = contact.potential(loss) - contact.lowest_potential().unwrap_or(0.0);
        let delta = 4.0 * PI * oscillator.zeta() * rise.max(0.0) / temperature;
        // x = tan(angle)/2 and the midpoint rule.
        let points = 100;
        let sum: f64 = (0..points)
            .map(|k| 0.5 * PI * (f64::from(k) + 0.5) / f64::from(points))
            .map(|angle| (-(-0.25 * delta / angle.cos().powi(2)).exp_m1()).ln())
            .sum();
        // One loss a period, and no burst longer than its batch.
        let size = (-sum / f64::from(points)).exp();
        let size = size.min(1.0 + length / (2.0 * PI));
        let losses = size * (2.0 * size - 1.0);
        // A body lost at the mean speed sqrt(pi T/2) falls back in 2 v/|G|.
        let flight = (2.0 * PI * temperature).sqrt() / contact.force(loss).abs();
        Some(Self {
            losses,
            time: ALIKE * losses * flight.min(length).powi(2),
        })
    }

    /// Mean square of the share of a batch of `length` that a burst is out of contact.
    pub(super) fn share(self, length: f64) -> f64 {
        self.time / (length * length)
    }
}

/// Hears of every crossing of the loss point.
pub(super) trait Watch {
    /// Whether there is anything to tell.
    const LISTENS: bool = true;

    /// Lane, whether contact was lost (or regained), when, and |v| there.
    fn cross(&mut self, lane: usize, lost: bool, time: f64, speed: f64);

    /// Whether it follows every lane from substep to substep.
    const FOLLOWS: bool = false;

    /// Lane, when a substep began and how long it was, and (q, v) at both ends.
    #[inline(always)]
    fn moved(&mut self, _lane: usize, _time: f64, _step: f64, _ends: [[f64; 2]; 2]) {}

    /// Whether the time of the work is over; asked every [`PATIENCE`] steps.
    fn late(&self) -> bool {
        false
    }
}

/// Steps of the paths that advance together between two looks at the clock: under 0.1 s with the most cosines.
pub(super) const PATIENCE: u64 = 256;

/// Nobody listens.
#[derive(Debug, Clone, Copy)]
pub(super) struct Deaf;

impl Watch for Deaf {
    const LISTENS: bool = false;

    #[inline(always)]
    fn cross(&mut self, _: usize, _: bool, _: f64, _: f64) {}
}

/// Bins of what is counted at a return: the time of flight, the speed, and cells of both.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReturnBins {
    flight: Bins,
    speed: Bins,
    cells: [Bins; 2],
}

/// Cells of the joint histogram along time and speed.
const CELLS: [usize; 2] = [24, 16];

impl ReturnBins {
    /// For an oscillator of deviation of v `deviation`, falling with acceleration `fall`: the speed of a loss has the
    /// Rayleigh law of that deviation, and a flight lasts 2 speed/fall without noise.
    pub(super) fn new(deviation: f64, fall: f64, count: usize) -> Self {
        let longest = 8.0 * deviation / fall;
        Self {
            flight: Bins::new(0.0, 10.0 * deviation / fall, count),
            speed: Bins::new(0.0, 5.0 * deviation, count),
            cells: [
                Bins::new(0.0, longest, CELLS[0]),
                Bins::new(0.0, 4.0 * deviation, CELLS[1]),
            ],
        }
    }

    /// As many bins of width 1 as there are cells.
    fn joint() -> Bins {
        let all = CELLS[0] * CELLS[1];
        Bins::new(0.0, all as f64, all)
    }

    /// The slot of a return in each histogram.
    fn slots(&self, time: f64, speed: f64) -> [usize; 3] {
        let [i, j] = [self.cells[0].slot(time), self.cells[1].slot(speed)];
        let joint = if i < CELLS[0] && j < CELLS[1] {
            i * CELLS[1] + j
        } else {
            CELLS[0] * CELLS[1]
        };
        [self.flight.slot(time), self.speed.slot(speed), joint]
    }

    /// All three.
    fn all(&self) -> [Bins; 3] {
        [self.flight, self.speed, Self::joint()]
    }
}

/// What one lane has seen in the present batch.
#[derive(Debug, Clone, Default)]
struct Lane {
    /// Out of contact now, and since when if that was seen.
    out: bool,
    since: Option<f64>,
    seen: [f64; SEEN],
}

/// Watches the records of one group, batch by batch.
#[derive(Debug, Clone)]
pub(super) struct Logbook {
    bins: ReturnBins,
    batch_start: f64,
    lanes: [Lane; LANES],
    sums: CrossingSums,
    /// Per lane and histogram.
    hits: Vec<[Vec<u32>; 3]>,
}

impl Logbook {
    /// A logbook that begins at time 0 with the lanes that are `out` of contact.
    pub(super) fn new(bins: ReturnBins, out: impl Fn(usize) -> bool) -> Self {
        Self {
            bins,
            batch_start: 0.0,
            lanes: std::array::from_fn(|lane| Lane {
                out: out(lane),
                ..Lane::default()
            }),
            sums: CrossingSums::new(bins),
            hits: vec![bins.all().map(|bins| vec![0; bins.slots()]); LANES],
        }
    }

    /// Closes the batches of all lanes at time `now`; without `keep` they are forgotten.
    pub(super) fn end_batch(&mut self, now: f64, keep: bool) {
        let length = now - self.batch_start;
        for (k, lane) in self.lanes.iter_mut().enumerate() {
            if lane.out {
                lane.seen[LOST_TIME] += now - lane.since.unwrap_or(0.0).max(self.batch_start);
            }
            if keep {
                self.sums.push(lane.seen, length);
                for (counts, hits) in self.sums.counts.iter_mut().zip(&self.hits[k]) {
                    counts.push(hits);
                }
            }
            lane.seen = [0.0; SEEN];
            self.hits[k].iter_mut().for_each(|hits| hits.fill(0));
        }
        self.batch_start = now;
    }

    pub(super) fn into_sums(self) -> CrossingSums {
        self.sums
    }
}

impl Watch for Logbook {
    fn cross(&mut self, lane: usize, lost: bool, time: f64, speed: f64) {
        let it = &mut self.lanes[lane];
        if lost {
            it.seen[LOSSES] += 1.0;
            it.since = Some(time);
        } else {
            it.seen[LOST_TIME] += time - it.since.unwrap_or(0.0).max(self.batch_start);
            if it.out {
                it.seen[RETURNS] += 1.0;
                it.seen[SPEED] += speed;
            }
            // A record that begins in flight does not know how long that flight was.
            if let Some(since) = it.since.filter(|_| it.out) {
                let flight = time - since;
                let slots = self.bins.slots(flight, speed);
                for (hits, slot) in self.hits[lane].iter_mut().zip(slots) {
                    hits[slot] += 1;
                }
            }
        }
        it.out = lost;
    }
}

/// Per batch: losses, time out of contact, returns, their speeds.
const SEEN: usize = 4;

/// The place of each.
const LOSSES: usize = 0;
const LOST_TIME: usize = 1;
const RETURNS: usize = 2;
const SPEED: usize = 3;

/// Sums over batches.
#[derive(Debug, Clone)]
pub(super) struct CrossingSums {
    time: f64,
    /// What each batch saw.
    batches: Vec<[f64; SEEN]>,
    counts: [BatchCounts; 3],
}

impl CrossingSums {
    pub(super) fn new(bins: ReturnBins) -> Self {
        Self {
            time: 0.0,
            batches: Vec::new(),
            counts: bins.all().map(BatchCounts::new),
        }
    }

    fn push(&mut self, seen: [f64; SEEN], length: f64) {
        self.time += length;
        self.batches.push(seen);
    }

    pub(super) fn add(&mut self, more: &Self) {
        self.time += more.time;
        self.batches.extend(&more.batches);
        for (mine, theirs) in self.counts.iter_mut().zip(&more.counts) {
            mine.add(theirs);
        }
    }

    fn sum(&self, j: usize) -> f64 {
        self.batches.iter().map(|seen| seen[j]).sum()
    }

    /// Batches in which j is not 0.
    fn seen(&self, j: usize) -> f64 {
        self.batches.iter().filter(|seen| seen[j] != 0.0).count() as f64
    }

    /// Sum j over the number of losses or returns, its error by the jackknife over the batches. The flights of a burst that was not
    /// seen scatter as the speeds of a Rayleigh law, by sqrt(4/pi - 1) of their mean. The mean flight is the time out of contact over
    /// the losses: a mean over the flights seen whole would lack the long ones, which a record begins or ends in.
    fn per(&self, events: usize, j: usize, burst: Burst) -> Estimate {
        let all = self.sum(events);
        let ratio = self.sum(j) / all;
        // A batch that holds all of them shows nothing of its own scatter.
        let rest = |seen: &[f64; SEEN]| (1.0 - seen[events] / all).max(0.1);
        let away = |seen: &[f64; SEEN]| (seen[j] - ratio * seen[events]) / rest(seen);
        let square: f64 = self.batches.iter().map(|seen| away(seen).powi(2)).sum();
        let burst = ALIKE * burst.losses * ratio * ratio * (4.0 / PI - 1.0);
        let unseen = unseen(square, self.seen(events), self.batches.len() as f64, burst);
        let scatter = skewed_variance(self.batches.iter().map(away));
        let error = (scatter + unseen).sqrt() / all;
        Estimate::new(ratio, error, Origin::Sampling)
    }

    /// Sum j per unit time, no burst being smaller than `burst`, a mean square.
    fn rate(&self, j: usize, burst: f64) -> Estimate {
        let (n, sum) = (self.batches.len() as f64, self.sum(j));
        let away = || self.batches.iter().map(|seen| seen[j] - sum / n);
        let square: f64 = away().map(|it| it * it).sum();
        let variance =
            skewed_variance(away()) * n / (n - 1.0) + unseen(square, self.seen(j), n, burst);
        let error = variance.sqrt() / self.time;
        Estimate::new(sum / self.time, error, Origin::Sampling)
    }

    pub(super) fn crossings(&self, bins: ReturnBins, burst: Burst) -> Crossings {
        let seen = self.sum(LOSSES);
        let squares: f64 = self.batches.iter().map(|it| it[LOSSES].powi(2)).sum();
        Crossings {
            time: self.time,
            losses: seen as u64,
            bursts: seen * seen / squares.max(1.0),
            loss_rate: self.rate(LOSSES, burst.losses),
            lost_share: self.rate(LOST_TIME, burst.time),
            mean_flight: self.per(LOSSES, LOST_TIME, burst),
            mean_impact_speed: self.per(RETURNS, SPEED, burst),
            flight_time: self.counts[0].histogram(bins.flight, false),
            impact_speed: self.counts[1].histogram(bins.speed, false),
            impacts: self.impacts(bins),
        }
    }

    fn impacts(&self, bins: ReturnBins) -> Impacts {
        // The bins of width 1 hold probabilities.
        let cells = self.counts[2].histogram(ReturnBins::joint(), false);
        let [times, speeds] = bins.cells.map(Bins::edges);
        let area = (times[1] - times[0]) * (speeds[1] - speeds[0]);
        let density = cells.density.iter().map(|it| it.scaled(1.0 / area));
        Impacts {
            density: density.collect(),
            times,
            speeds,
        }
    }
}
