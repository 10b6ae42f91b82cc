//! Histograms: densities with confidence bands, and the Dirac mass beside them.

pub(super) use super::bins::Bins;
pub use super::bins::Histogram;
use super::statistics::proportion;
use crate::estimate::{Estimate, Origin};

/// Counts of independent samples.
#[derive(Debug, Clone)]
pub(super) struct Counts {
    hits: Vec<f64>,
    total: f64,
}

impl Counts {
    pub(super) fn new(bins: Bins) -> Self {
        Self {
            hits: vec![0.0; bins.slots()],
            total: 0.0,
        }
    }

    pub(super) fn hit(&mut self, slot: usize) {
        self.hits[slot] += 1.0;
        self.total += 1.0;
    }

    pub(super) fn add(&mut self, more: &Self) {
        for (a, b) in self.hits.iter_mut().zip(&more.hits) {
            *a += b;
        }
        self.total += more.total;
    }

    /// The histogram with binomial errors.
    pub(super) fn histogram(&self, bins: Bins, has_dirac: bool) -> Histogram {
        bins.histogram(has_dirac, |slot| {
            if self.total > 0.0 {
                proportion(self.hits[slot], self.total)
            } else {
                Estimate::new(0.0, 0.0, Origin::Sampling)
            }
        })
    }
}

/// Hits in each slot, batch by batch: the errors hold for samples that follow one another closely, too.
#[derive(Debug, Clone)]
pub(super) struct BatchCounts {
    batches: f64,
    /// Sums over batches of all samples and of their square.
    total: f64,
    total_square: f64,
    /// Sums over batches of the hits of a slot, of their square, and of their product with all samples.
    hits: Vec<[f64; 3]>,
}

impl BatchCounts {
    pub(super) fn new(bins: Bins) -> Self {
        Self {
            batches: 0.0,
            total: 0.0,
            total_square: 0.0,
            hits: vec![[0.0; 3]; bins.slots()],
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
            for (sum, more) in sums.iter_mut().zip([hits, hits * hits, hits * total]) {
                *sum += more;
            }
        }
    }

    pub(super) fn add(&mut self, more: &Self) {
        self.batches += more.batches;
        self.total += more.total;
        self.total_square += more.total_square;
        for (a, b) in self
            .hits
            .iter_mut()
            .flatten()
            .zip(more.hits.iter().flatten())
        {
            *a += b;
        }
    }

    /// The histogram: hits over samples, the error from the scatter of the batches about that ratio, and
    /// never below that of a few hits.
    pub(super) fn histogram(&self, bins: Bins, has_dirac: bool) -> Histogram {
        bins.histogram(has_dirac, |slot| {
            if self.total == 0.0 {
                return Estimate::new(0.0, 0.0, Origin::Sampling);
            }
            let [hits, square, product] = self.hits[slot];
            let share = hits / self.total;
            let scatter = square - 2.0 * share * product + share * share * self.total_square;
            let scatter = (scatter.max(0.0) * self.batches / (self.batches - 1.0)).sqrt();
            let few = (hits + 1.0).min(4.0).sqrt();
            Estimate::new(share, scatter.max(few) / self.total, Origin::Sampling)
        })
    }
}
