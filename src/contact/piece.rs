//! A force that is a cubic polynomial of q over an interval: what polynomial and tabulated laws are made of.

use crate::roots::bisect;

/// G(q) = c0 + c1 x + c2 x^2 + c3 x^3 with x = q - centre, from `from` to where the next piece begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Where it begins; minus infinity for the first.
    pub from: f64,
    /// What x is counted from.
    pub centre: f64,
    /// c0 to c3.
    pub coefficients: [f64; 4],
}

impl Piece {
    /// G at q.
    #[inline(always)]
    pub fn force(&self, q: f64) -> f64 {
        let [c0, c1, c2, c3] = self.coefficients;
        let x = q - self.centre;
        c0 + x * (c1 + x * (c2 + x * c3))
    }

    /// G' at q.
    #[inline(always)]
    pub(crate) fn stiffness(&self, q: f64) -> f64 {
        let [_, c1, c2, c3] = self.coefficients;
        let x = q - self.centre;
        c1 + x * (2.0 * c2 + x * 3.0 * c3)
    }

    /// The integral of G from the centre to q.
    #[inline(always)]
    pub(crate) fn work(&self, q: f64) -> f64 {
        let [c0, c1, c2, c3] = self.coefficients;
        let x = q - self.centre;
        x * (c0 + x * (c1 / 2.0 + x * (c2 / 3.0 + x * (c3 / 4.0))))
    }

    /// Every q between `self.from` and `to` at which G passes `force`.
    fn roots(&self, to: f64, force: f64) -> Vec<f64> {
        let [c0, c1, c2, c3] = self.coefficients;
        let c0 = c0 - force;
        let Some(top) = [c3, c2, c1].into_iter().find(|c| *c != 0.0) else {
            return Vec::new();
        };
        // Cauchy's bound of the roots, for pieces without an end.
        let far = 2.0
            + 2.0
                * [c0, c1, c2]
                    .map(|c| (c / top).abs())
                    .iter()
                    .fold(0.0, |a, b| b.max(a));
        let (low, high) = (self.from.max(self.centre - far), to.min(self.centre + far));
        // Between the extrema of the cubic it is monotone.
        let mut ends = vec![low];
        let turns = quadratic(3.0 * c3, 2.0 * c2, c1);
        ends.extend(
            turns
                .into_iter()
                .map(|x| self.centre + x)
                .filter(|q| *q > low && *q < high),
        );
        ends.push(high);
        let below = |q: f64| self.force(q) < force;
        ends.windows(2)
            .filter(|w| w[0] < w[1] && below(w[0]) != below(w[1]))
            .map(|w| bisect(w[0], w[1], |q| below(q) == below(w[1])))
            .collect()
    }
}

/// The real roots of a x^2 + b x + c, ascending, without cancellation.
fn quadratic(a: f64, b: f64, c: f64) -> Vec<f64> {
    if a == 0.0 {
        return if b == 0.0 { Vec::new() } else { vec![-c / b] };
    }
    let square = b * b - 4.0 * a * c;
    if square <= 0.0 {
        return Vec::new();
    }
    let s = -0.5 * (b + b.signum() * square.sqrt());
    let mut both = if s == 0.0 {
        vec![0.0]
    } else {
        vec![s / a, c / s]
    };
    both.sort_by(f64::total_cmp);
    both
}

/// Every q at which the force of all pieces passes `force`, ascending.
pub(crate) fn roots(pieces: &[Piece], force: f64) -> Vec<f64> {
    let ends = pieces
        .iter()
        .skip(1)
        .map(|it| it.from)
        .chain([f64::INFINITY]);
    let mut all: Vec<f64> = pieces
        .iter()
        .zip(ends)
        .flat_map(|(it, to)| it.roots(to, force))
        .collect();
    // A root on an end is found on either side of it.
    all.dedup_by(|b, a| (*b - *a).abs() <= 1e-14 * a.abs().max(1e-3));
    all
}

/// The piece that holds q.
#[inline(always)]
pub(crate) fn place(pieces: &[Piece], q: f64) -> usize {
    pieces.partition_point(|it| it.from <= q).saturating_sub(1)
}
