//! How far out a law holds probability, measured on a density: what a truncated domain follows where no formula tells.

use super::density::Snapshot;
use crate::oscillator::Oscillator;

/// P(r > x) of the amplitude r = sqrt(2 (H - lowest U)), and beyond what is known of it a fall by e^{-x/scale}.
///
/// Where flights have no friction an impact at speed v takes a part of it, and a law falls with the speed like that, or more
/// slowly.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tail {
    /// -ln P(r > x) at x = step, 2 step, ...
    rarity: Vec<f64>,
    step: f64,
}

/// Amplitudes that are looked at, the highest this part of the edge: closer to it what does not come back from beyond is missing.
/// Over so many of the last the fall goes on beyond them.
const LOOKED_AT: usize = 48;
const INSIDE: f64 = 0.75;
const LAST: usize = LOOKED_AT / 4;

/// Part of a probability that cells of negative density may take from it: beyond, nothing is known.
const NEGATIVE: f64 = 0.1;
/// Edges that a domain made by it has at most.
const BEYOND: f64 = 1.5;

impl Tail {
    /// That of a density on a domain which ends at the amplitude `edge`.
    pub(crate) fn of(snapshot: &Snapshot, oscillator: &Oscillator, edge: f64) -> Option<Self> {
        let contact = oscillator.contact();
        let lowest = contact.lowest_potential().unwrap_or(0.0);
        let Snapshot { q, v, p, .. } = snapshot;
        let [columns, rows] = snapshot.cell_widths();
        let step = INSIDE * edge / LOOKED_AT as f64;
        let mut beyond = [[0.0; 2]; LOOKED_AT];
        for ((i, j), p) in p.indexed_iter() {
            let square = 2.0 * (contact.potential(q[i]) - lowest) + v[j] * v[j];
            let passed = (square.max(0.0).sqrt() / step) as usize;
            if let Some(last) = passed.min(LOOKED_AT).checked_sub(1) {
                let mass = p * columns[i] * rows[j];
                beyond[last][usize::from(mass < 0.0)] += mass.abs();
            }
        }
        let mut above = [0.0; 2];
        for beyond in beyond.iter_mut().rev() {
            above = [above[0] + beyond[0], above[1] + beyond[1]];
            *beyond = above;
        }
        let mut rarity = Vec::with_capacity(LOOKED_AT);
        for [positive, negative] in beyond {
            let least = rarity.last().copied().unwrap_or(0.0);
            // Dispersion.
            if positive == 0.0 || negative > NEGATIVE * positive {
                break;
            }
            rarity.push((-(positive - negative).ln()).max(least));
        }
        (rarity.len() > LAST).then_some(Self { rarity, step })
    }

    /// The fall of ln P, at least one over all that is known, with the amplitude beyond what is known.
    fn slope(&self) -> f64 {
        let n = self.rarity.len();
        let fall = self.rarity[n - 1] - self.rarity[n - 1 - LAST];
        (fall / LAST as f64).max(1.0 / n as f64) / self.step
    }

    /// The amplitude beyond which no more than this probability lies.
    pub(crate) fn reach(&self, probability: f64) -> f64 {
        let rarity = -probability.ln();
        let n = self.rarity.len();
        let within = self.rarity.partition_point(|it| *it < rarity);
        if within < n {
            return self.step * (within + 1) as f64;
        }
        self.step * n as f64 + (rarity - self.rarity[n - 1]) / self.slope()
    }

    /// The same as far as a domain is made by it.
    pub(crate) fn domain(&self, neglected: f64) -> f64 {
        let edge = self.step * LOOKED_AT as f64 / INSIDE;
        self.reach(neglected).min(BEYOND * edge)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::ContactLaw;
    use ndarray::{Array1, Array2};

    /// exp(-r/s)/(2 pi s^2) of a linear contact: P(r > x) = (1 + x/s) e^{-x/s}.
    #[test]
    fn the_reach_of_a_known_tail_is_found() {
        let (n, s) = (240, 0.2);
        let at = |i: usize| 2.0 * ((i as f64 + 0.5) / n as f64 * 2.0 - 1.0);
        let axis = Array1::from_iter((0..n).map(at));
        let density = |(i, j): (usize, usize)| {
            (-at(i).hypot(at(j)) / s).exp() / (2.0 * std::f64::consts::PI * s * s)
        };
        let snapshot = Snapshot {
            t: 0.0,
            q: axis.clone(),
            v: axis,
            p: Array2::from_shape_fn((n, n), density),
        };
        let oscillator = Oscillator::new(ContactLaw::Linear, 0.05, 2e-3).unwrap();
        let tail = Tail::of(&snapshot, &oscillator, 2.0).unwrap();
        let reach = tail.reach(1e-4);
        let there = (1.0 + reach / s) * (-reach / s).exp();
        println!("{tail:?}: {reach}, where P is {there:e}");
        // The factor 1 + r/s bends the tail a little.
        assert!((0.5..1.1).contains(&(there / 1e-4)));
        // What is known ends at 1.5.
        let inside = tail.reach(1e-2);
        let there = (1.0 + inside / s) * (-inside / s).exp();
        println!("{inside}, where P is {there:e}");
        assert!(reach > 1.5 && inside < 1.5 && (0.8..1.05).contains(&(there / 1e-2)));
    }
}
