//! Losses and returns of contact: how often, for how long, how fast.

use super::histogram::{BatchCounts, Bins, Histogram};
use super::noise::LANES;
use crate::estimate::{Estimate, Origin};
use crate::rig::Rig;

/// Losses of contact in stationary motion, each located between steps. Errors from batch means.
#[derive(Debug, Clone, PartialEq)]
pub struct Crossings {
    /// Time observed, all records together.
    pub time: f64,
    /// Losses of contact seen.
    pub losses: u64,
    /// Losses per unit time.
    pub loss_rate: Estimate,
    /// Share of the time out of contact: P(q < q_loss).
    pub lost_share: Estimate,
    /// Mean time from a loss to the return.
    pub mean_flight: Estimate,
    /// Mean speed |v| at the return.
    pub mean_impact_speed: Estimate,
    /// Density of the time from a loss to the return.
    pub flight_time: Histogram,
    /// Density of the speed at the return.
    pub impact_speed: Histogram,
}

impl Crossings {
    /// Mean number of losses in a dimensionless time.
    pub fn losses_in(&self, time: f64) -> Estimate {
        self.loss_rate.scaled(time)
    }

    /// Mean number of losses in a time in seconds, and the mean flight in seconds: Table 3.
    pub fn in_seconds(&self, rig: &Rig, seconds: f64) -> (Estimate, Estimate) {
        (
            self.losses_in(rig.time(seconds)),
            self.mean_flight.scaled(rig.seconds(1.0)),
        )
    }
}

/// Hears of every crossing of the loss point.
pub(super) trait Watch {
    /// Whether there is anything to tell.
    const LISTENS: bool = true;

    /// Lane, whether contact was lost (or regained), when, and |v| there.
    fn cross(&mut self, lane: usize, lost: bool, time: f64, speed: f64);
}

/// Nobody listens.
#[derive(Debug, Clone, Copy)]
pub(super) struct Deaf;

impl Watch for Deaf {
    const LISTENS: bool = false;

    #[inline(always)]
    fn cross(&mut self, _: usize, _: bool, _: f64, _: f64) {}
}

/// Bins of flight times and of impact speeds.
#[derive(Debug, Clone, Copy)]
pub(super) struct FlightBins {
    time: Bins,
    speed: Bins,
}

impl FlightBins {
    /// For an oscillator of deviation of v `deviation`, falling with acceleration `fall`: the speed of a
    /// loss has the Rayleigh law of that deviation, and a flight lasts 2 speed/fall without noise.
    pub(super) fn new(deviation: f64, fall: f64, count: usize) -> Self {
        let highest = 5.0 * deviation;
        Self {
            time: Bins::new(0.0, 2.0 * highest / fall, count),
            speed: Bins::new(0.0, highest, count),
        }
    }
}

/// What one lane has seen in the present batch.
#[derive(Debug, Clone, Default)]
struct Lane {
    /// Out of contact now, and since when if that was seen.
    out: bool,
    since: Option<f64>,
    losses: f64,
    flights: f64,
    flight_time: f64,
    speed: f64,
    /// Time out of contact.
    lost_time: f64,
}

/// Watches the records of one group, batch by batch.
#[derive(Debug, Clone)]
pub(super) struct Logbook {
    bins: FlightBins,
    batch_start: f64,
    lanes: [Lane; LANES],
    sums: CrossingSums,
    flight_hits: Vec<Vec<u32>>,
    speed_hits: Vec<Vec<u32>>,
}

impl Logbook {
    /// A logbook that begins at time 0 with the lanes that are `out` of contact.
    pub(super) fn new(bins: FlightBins, out: impl Fn(usize) -> bool) -> Self {
        Self {
            bins,
            batch_start: 0.0,
            lanes: std::array::from_fn(|lane| Lane {
                out: out(lane),
                ..Lane::default()
            }),
            sums: CrossingSums::new(bins),
            flight_hits: vec![vec![0; bins.time.slots()]; LANES],
            speed_hits: vec![vec![0; bins.speed.slots()]; LANES],
        }
    }

    /// Closes the batches of all lanes at time `now`; without `keep` they are forgotten.
    pub(super) fn end_batch(&mut self, now: f64, keep: bool) {
        let length = now - self.batch_start;
        for (k, lane) in self.lanes.iter_mut().enumerate() {
            if lane.out {
                lane.lost_time += now - lane.since.unwrap_or(0.0).max(self.batch_start);
            }
            if keep {
                let seen = [
                    lane.losses,
                    lane.lost_time,
                    lane.flights,
                    lane.flight_time,
                    lane.speed,
                ];
                self.sums.push(seen, length);
                self.sums.flight_bins.push(&self.flight_hits[k]);
                self.sums.speed_bins.push(&self.speed_hits[k]);
            }
            *lane = Lane {
                out: lane.out,
                since: lane.since,
                ..Lane::default()
            };
            self.flight_hits[k].fill(0);
            self.speed_hits[k].fill(0);
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
            it.losses += 1.0;
            it.since = Some(time);
        } else {
            it.lost_time += time - it.since.unwrap_or(0.0).max(self.batch_start);
            // A record that begins in flight does not know how long that flight was.
            if let Some(since) = it.since.filter(|_| it.out) {
                let flight = time - since;
                it.flights += 1.0;
                it.flight_time += flight;
                it.speed += speed;
                self.flight_hits[lane][self.bins.time.slot(flight)] += 1;
                self.speed_hits[lane][self.bins.speed.slot(speed)] += 1;
            }
        }
        it.out = lost;
    }
}

/// Per batch: losses, time out of contact, flights ended, their time, their impact speeds.
const SEEN: usize = 5;

/// Sums over batches.
#[derive(Debug, Clone)]
pub(super) struct CrossingSums {
    batches: f64,
    time: f64,
    sum: [f64; SEEN],
    product: [[f64; SEEN]; SEEN],
    flight_bins: BatchCounts,
    speed_bins: BatchCounts,
}

impl CrossingSums {
    pub(super) fn new(bins: FlightBins) -> Self {
        Self {
            batches: 0.0,
            time: 0.0,
            sum: [0.0; SEEN],
            product: [[0.0; SEEN]; SEEN],
            flight_bins: BatchCounts::new(bins.time),
            speed_bins: BatchCounts::new(bins.speed),
        }
    }

    fn push(&mut self, seen: [f64; SEEN], length: f64) {
        self.batches += 1.0;
        self.time += length;
        for j in 0..SEEN {
            self.sum[j] += seen[j];
            for k in 0..SEEN {
                self.product[j][k] += seen[j] * seen[k];
            }
        }
    }

    pub(super) fn add(&mut self, more: &Self) {
        self.batches += more.batches;
        self.time += more.time;
        for j in 0..SEEN {
            self.sum[j] += more.sum[j];
            for k in 0..SEEN {
                self.product[j][k] += more.product[j][k];
            }
        }
        self.flight_bins.add(&more.flight_bins);
        self.speed_bins.add(&more.speed_bins);
    }

    /// Sum j over sum k, its error from the scatter of the batches about the ratio. Without a single
    /// event the error is that of one.
    fn ratio(&self, j: usize, k: usize) -> Estimate {
        let (n, a, b) = (self.batches, self.sum[j], self.sum[k]);
        let r = a / b;
        let square = self.product[j][j] - 2.0 * r * self.product[j][k] + r * r * self.product[k][k];
        let error = (square.max(0.0) * n / (n - 1.0)).sqrt() / b;
        Estimate::new(r, error, Origin::Sampling)
    }

    /// Sum j per unit time.
    fn rate(&self, j: usize, one: f64) -> Estimate {
        let (n, mean) = (self.batches, self.sum[j] / self.batches);
        let spread = (self.product[j][j] / n - mean * mean).max(0.0) * n / (n - 1.0);
        let error = (spread * n).sqrt().max(one) / self.time;
        Estimate::new(self.sum[j] / self.time, error, Origin::Sampling)
    }

    pub(super) fn crossings(&self, bins: FlightBins) -> Crossings {
        let [losses, lost_time, flights, flight_time, speed] = [0, 1, 2, 3, 4];
        let mean_flight = self.ratio(flight_time, flights);
        let one_flight = if self.sum[flights] > 0.0 {
            mean_flight.value
        } else {
            1.0
        };
        Crossings {
            time: self.time,
            losses: self.sum[losses] as u64,
            loss_rate: self.rate(losses, 1.0),
            lost_share: self.rate(lost_time, one_flight),
            mean_flight,
            mean_impact_speed: self.ratio(speed, flights),
            flight_time: self.flight_bins.histogram(bins.time, false),
            impact_speed: self.speed_bins.histogram(bins.speed, false),
        }
    }
}
