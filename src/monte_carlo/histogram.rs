//! Histograms of long realisations: equal bins, and the density over them with confidence bands.

use super::statistics::unseen;
use crate::estimate::{Estimate, Origin};

/// A density averaged over the bins between `edges`, one standard error on every bin.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    /// Ends of the bins, ascending; one more than there are bins.
    pub edges: Vec<f64>,
    /// Mean density over each bin.
    pub density: Vec<Estimate>,
    /// Probability outside the bins, the Dirac mass not counted.
    pub outside: Estimate,
    /// Probability of the Dirac mass at the force of flight; None where the law has none.
    pub dirac: Option<Estimate>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Bins {
    low: f64,
    width: f64,
    count: usize,
}

impl Bins {
    pub(super) fn new(low: f64, high: f64, count: usize) -> Self {
        let width = (high - low) / count as f64;
        Self { low, width, count }
    }

    /// Doubles that hold one histogram: every bin, then the outside, then the Dirac mass.
    pub(super) fn slots(self) -> usize {
        self.count + 2
    }

    #[inline(always)]
    pub(super) fn slot(self, x: f64) -> usize {
        let place = (x - self.low) / self.width;
        if place >= 0.0 && place < self.count as f64 {
            place as usize
        } else {
            self.count
        }
    }

    /// The slot of the Dirac mass.
    pub(super) fn dirac(self) -> usize {
        self.count + 1
    }

    pub(super) fn edges(self) -> Vec<f64> {
        (0..=self.count)
            .map(|k| self.low + self.width * k as f64)
            .collect()
    }
}

/// Hits in each slot, batch by batch: the errors hold for samples that follow one another closely, too.
#[derive(Debug, Clone)]
pub(super) struct BatchCounts {
    batches: f64,
    /// Sums over batches of all samples and of their square.
    total: f64,
    total_square: f64,
    /// Sums over batches of the hits of a slot, of their square, of their product with all samples, and how many have any.
    hits: Vec<[f64; 4]>,
}

impl BatchCounts {
    pub(super) fn new(bins: Bins) -> Self {
        Self {
            batches: 0.0,
            total: 0.0,
            total_square: 0.0,
            hits: vec![[0.0; 4]; bins.slots()],
        }
    }

    /// The hits of one batch.
    pub(super) fn push(&mut self, hits: &[u32]) {
        let total: f64 = hits.iter().map(|hits| f64::from(*hits)).sum();
        self.batches += 1.0;
        self.total += total;
        self.total_square += total * total;
        for (sums, hits) in self.hits.iter_mut().zip(hits) {
            let hits = f64::from(*hits);
            let any = f64::from(hits > 0.0);
            for (sum, more) in sums.iter_mut().zip([hits, hits * hits, hits * total, any]) {
                *sum += more;
            }
        }
    }

    pub(super) fn add(&mut self, more: &Self) {
        self.batches += more.batches;
        self.total += more.total;
        self.total_square += more.total_square;
        let mine = self.hits.iter_mut().flatten();
        for (a, b) in mine.zip(more.hits.iter().flatten()) {
            *a += b;
        }
    }

    /// The histogram: hits over samples, the error from the scatter of the batches about that ratio and from the number of those
    /// that saw a hit: hits come in runs.
    pub(super) fn histogram(&self, bins: Bins, has_dirac: bool) -> Histogram {
        let probability = |slot: usize| {
            if self.total == 0.0 {
                return Estimate::new(0.0, 0.0, Origin::Sampling);
            }
            let [hits, square, product, seen] = self.hits[slot];
            let share = hits / self.total;
            let scatter = square - 2.0 * share * product + share * share * self.total_square;
            let scatter = scatter.max(0.0);
            let variance = scatter * self.batches / (self.batches - 1.0)
                + unseen(scatter, seen, self.batches, 1.0);
            Estimate::new(share, variance.sqrt() / self.total, Origin::Sampling)
        };
        Histogram {
            edges: bins.edges(),
            density: (0..bins.count)
                .map(|k| probability(k).scaled(1.0 / bins.width))
                .collect(),
            outside: probability(bins.count),
            dirac: has_dirac.then(|| probability(bins.dirac())),
        }
    }
}
