//! How many functions there are of q and of v, and how far they reach.

use super::basis::{DEGREE, INNER};
use crate::fokker_planck::budget::timing;
use crate::fokker_planck::policy::HIGHER;

/// How finely the operator is resolved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::fokker_planck) struct Resolution {
    /// Elements of q.
    pub(in crate::fokker_planck) elements: usize,
    /// Pairs of Hermite functions, an even one and an odd one.
    pub(in crate::fokker_planck) pairs: usize,
    /// Powers of e by which the stationary law falls within the truncated domain, if so many functions hold as much.
    pub(in crate::fokker_planck) level: f64,
}

impl Resolution {
    /// Growth of elements and functions from one resolution to the next.
    const FINER: f64 = 1.4;

    /// The coarsest, whose `rounds`-th refinement has the scene's cells, if it gives them; else so many elements and pairs.
    pub(in crate::fokker_planck) fn first(
        cells: Option<[usize; 2]>,
        rounds: i32,
        otherwise: [usize; 2],
        level: f64,
    ) -> Self {
        let coarse = |n: usize, of: usize| {
            let n = n as f64 / of as f64 / Self::FINER.powi(rounds);
            (n.round() as usize).max(2)
        };
        let [elements, pairs] = cells.map_or(otherwise, |[q, v]| [coarse(q, DEGREE), coarse(v, 2)]);
        Self {
            elements,
            pairs,
            level,
        }
    }

    /// The refinement of that number.
    pub(in crate::fokker_planck) fn refined(self, rounds: usize) -> Self {
        (0..rounds).fold(self, |it, _| it.finer(1.0))
    }

    /// The one that is finer by so many refinements.
    pub(in crate::fokker_planck) fn finer(self, rounds: f64) -> Self {
        let more = |n: usize| (n as f64 * Self::FINER.powf(rounds)).round() as usize;
        Self {
            elements: more(self.elements),
            pairs: more(self.pairs),
            level: self.level + HIGHER.get() * rounds,
        }
    }

    /// Functions of q.
    pub(in crate::fokker_planck) fn across(self) -> usize {
        self.elements * DEGREE + 1
    }

    /// Functions of q and of v.
    pub(in crate::fokker_planck) fn functions(self) -> [usize; 2] {
        [self.across(), 2 * self.pairs]
    }

    /// Bytes that one solve holds.
    pub(in crate::fokker_planck) fn memory(self) -> u64 {
        let [pairs, inner] = [self.pairs, INNER].map(|it| it as f64);
        (16.0 * pairs * (2.0 * pairs + inner * inner) * (self.elements + 2) as f64) as u64
    }

    /// Operations of one factorisation: the inner functions of each element are eliminated under two hats for each pair, in
    /// small blocks, then the hats of one node after the other.
    pub(in crate::fokker_planck) fn operations(self) -> f64 {
        let k = self.pairs as f64;
        timing::NESTED * self.elements as f64 * (4400.0 * k * k + 19.0 * k * k * k)
    }

    /// Length of a state.
    pub(in crate::fokker_planck) fn len(self) -> usize {
        self.pairs * (2 * self.elements * DEGREE + 1)
    }
}
