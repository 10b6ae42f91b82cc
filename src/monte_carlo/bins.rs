//! Equal bins, and the density over them.

use crate::estimate::Estimate;

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

/// Equal bins.
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

    /// The slot of a value.
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

    fn edges(self) -> Vec<f64> {
        (0..=self.count)
            .map(|k| self.low + self.width * k as f64)
            .collect()
    }

    /// A histogram of the probability in each slot.
    pub(super) fn histogram(
        self,
        has_dirac: bool,
        probability: impl Fn(usize) -> Estimate,
    ) -> Histogram {
        Histogram {
            edges: self.edges(),
            density: (0..self.count)
                .map(|k| probability(k).scaled(1.0 / self.width))
                .collect(),
            outside: probability(self.count),
            dirac: has_dirac.then(|| probability(self.dirac())),
        }
    }
}
