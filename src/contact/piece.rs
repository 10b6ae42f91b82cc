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

    /// Where the piece, which reaches up to `to`, begins, turns and ends; where it has no end, beyond every q with G(q) =
    /// `force`.
    fn marks(&self, to: f64, force: f64) -> Vec<f64> {
        let [c0, c1, c2, c3] = self.coefficients;
        let top = [c3, c2, c1].into_iter().find(|c| *c != 0.0);
        // Cauchy's bound of the roots.
        let largest = |top: f64| [c0 - force, c1, c2].map(|c| (c / top).abs());
        let far = top.map_or(1.0, |top| {
            2.0 + 2.0 * largest(top).into_iter().fold(0.0, f64::max)
        });
        let low = self.from.max(self.centre - far);
        let high = to.min(self.centre + far);
        let mut marks = vec![low];
        let turns = quadratic(3.0 * c3, 2.0 * c2, c1).into_iter();
        let turns = turns.map(|x| self.centre + x);
        marks.extend(turns.filter(|q| *q > low && *q < high));
        if to == f64::INFINITY {
            marks.push(high);
        }
        marks
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
pub(super) fn roots(pieces: &[Piece], force: f64) -> Vec<f64> {
    let ends = pieces.iter().skip(1).map(|it| it.from);
    let ends = ends.chain([f64::INFINITY]);
    // Between its marks the force is monotone. On an end of two pieces the value of the second counts for both, so that
    // a root there is found once.
    let marks: Vec<(f64, &Piece)> = pieces
        .iter()
        .zip(ends)
        .flat_map(|(it, to)| it.marks(to, force).into_iter().map(move |q| (q, it)))
        .collect();
    let below = |(q, piece): &(f64, &Piece)| piece.force(*q) < force;
    marks
        .windows(2)
        .filter(|w| below(&w[0]) != below(&w[1]))
        .map(|w| {
            let (piece, before) = (w[0].1, below(&w[0]));
            bisect(w[0].0, w[1].0, |q| (piece.force(q) < force) != before)
        })
        .collect()
}

/// The piece that holds q.
#[inline(always)]
pub(crate) fn place(pieces: &[Piece], q: f64) -> usize {
    pieces.partition_point(|it| it.from <= q).saturating_sub(1)
}
