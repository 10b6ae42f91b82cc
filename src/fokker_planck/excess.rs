//! By how much one density exceeds another in its cells: the L1 distance is made of it.
//!
//! On meshes the difference is a plane in a cell where it changes sign ([`modulus_in_cell`]). About a concentrated density, which falls
//! by several times from one cell to the next where it meets the law, [`Pair`] sees what bends.

use std::ops::Range;

/// Two densities on one grid, by the probability in their cells; the last axis is contiguous with this many of them.
pub(super) struct Pair<'a> {
    p: &'a [f64],
    law: &'a [f64],
    change: Vec<f64>,
    stride: usize,
}

/// Parts of a cell along either axis where the difference of the densities changes sign: at least, at most, and in each power of e by
/// which one of them falls.
const PARTS: [f64; 3] = [2.0, 8.0, 2.5];

impl<'a> Pair<'a> {
    /// Cells that [`Self::excess`] asks of about its own, either way.
    pub(super) const AROUND: usize = 2;

    pub(super) fn new(p: &'a [f64], law: &'a [f64], stride: usize) -> Self {
        let change = p.iter().zip(law).map(|(p, law)| p - law).collect();
        Self {
            p,
            law,
            change,
            stride,
        }
    }

    /// Integral over some cells of one row of the positive part of p - p_s, to order 3. Where the difference changes sign, both are
    /// exponentials of quadratics.
    pub(super) fn excess(&self, cells: Range<usize>) -> f64 {
        let own = |k: usize| {
            if self.keeps_its_sign(k) {
                self.change[k].max(0.0)
            } else {
                self.across_zero(k)
            }
        };
        cells.map(own).sum()
    }

    /// Whether the difference does so in a cell, as far as those beside it tell.
    fn keeps_its_sign(&self, k: usize) -> bool {
        let beside = [k - self.stride, k + self.stride, k - 1, k + 1];
        let own = self.change[k];
        beside.iter().all(|it| own * self.change[*it] > 0.0)
    }

    /// The same over a cell in which the difference changes sign, and what the sum over those beside it leaves.
    fn across_zero(&self, k: usize) -> f64 {
        let n = self.stride;
        let beside = [[k - n, k + n], [k - 1, k + 1]];
        let own = match [self.p, self.law].map(|it| Quadratic::of_logarithm(it, n, k)) {
            [Some(p), Some(law)] => excess_of(&p, &law),
            _ => {
                let around = beside.map(|it| it.map(|k| self.change[k]));
                let (mean, slopes) = plane(self.change[k], around);
                positive(mean, slopes)
            }
        };
        let left = [(0, n, 1), (1, 1, n)].map(|(axis, across, along)| {
            let [below, above] = beside[axis];
            self.left_by(below, k, [across, along]) + self.left_by(above, k, [across, along])
        });
        own + left[0] + left[1]
    }

    /// What the sum over positive cells that ends with `last`, beside `k`, leaves of their integral, to order 6: in a cell it is
    /// (1 + D/24 - 17 D^2/5760) along either axis with the second difference D, whose sum over cells is that of its differences
    /// across their border. The product of both axes counts half on either.
    fn left_by(&self, last: usize, k: usize, [across, along]: [usize; 2]) -> f64 {
        let change = |k: usize| self.change[k];
        if change(last) <= 0.0 || !self.keeps_its_sign(last) {
            return 0.0;
        }
        let second = |k: usize, step: usize| change(k - step) - 2.0 * change(k) + change(k + step);
        let beyond = |step: usize| second(k, step) - second(last, step);
        (change(k) - change(last)) / 24.0 - 17.0 / 5760.0 * beyond(across) + beyond(along) / 1152.0
    }
}

/// Integral over the cell |x|, |y| < 1/2 of the positive part of the difference of two exponentials of quadratics, by planes over parts
/// of it.
fn excess_of(p: &Quadratic, law: &Quadratic) -> f64 {
    let slopes = p.slopes.iter().chain(&law.slopes);
    let steepest = slopes.fold(0.0, |most: f64, slope| most.max(slope.abs()));
    let [least, most, in_a_power] = PARTS;
    let parts = (in_a_power * steepest).ceil().clamp(least, most) as usize;
    let side = 1.0 / parts as f64;
    let mut sum = 0.0;
    for i in 0..parts * parts {
        let middle = [i / parts, i % parts].map(|i| (i as f64 + 0.5) * side - 0.5);
        let [p, law] = [p, law].map(|it| it.exponential(middle, side));
        sum += positive(p.0 - law.0, [0, 1].map(|k| side * (p.1[k] - law.1[k])));
    }
    sum * side * side
}

/// c + g.x + x.A x/2 about the middle of a cell, lengths in cells.
struct Quadratic {
    value: f64,
    slopes: [f64; 2],
    /// A_xx, A_xy and A_yy.
    bends: [f64; 3],
    /// The largest of the values it goes through: what is left of rounding far out bends as it likes.
    most: f64,
}

impl Quadratic {
    /// Through the logarithm of a density; `None` where it is not positive all about the cell.
    fn of_logarithm(cells: &[f64], stride: usize, k: usize) -> Option<Self> {
        let block = [k - stride, k, k + stride].map(|k| [cells[k - 1], cells[k], cells[k + 1]]);
        if !block.as_flattened().iter().all(|p| *p > 0.0) {
            return None;
        }
        let rows = block.map(|row| row.map(f64::ln));
        let [below, own, above] = rows;
        Some(Self {
            most: rows.as_flattened().iter().copied().fold(own[1], f64::max),
            value: own[1],
            slopes: [0.5 * (above[1] - below[1]), 0.5 * (own[2] - own[0])],
            bends: [
                above[1] - 2.0 * own[1] + below[1],
                0.25 * (above[2] - above[0] - below[2] + below[0]),
                own[2] - 2.0 * own[1] + own[0],
            ],
        })
    }

    /// Mean of its exponential over a square about a point of the cell, and its slopes there.
    fn exponential(&self, [x, y]: [f64; 2], side: f64) -> (f64, [f64; 2]) {
        let [xx, xy, yy] = self.bends;
        let change = [xx * x + xy * y, xy * x + yy * y];
        let along = x * (self.slopes[0] + 0.5 * change[0]) + y * (self.slopes[1] + 0.5 * change[1]);
        let value = (self.value + along).min(self.most).exp();
        let [a, b] = [0, 1].map(|k| self.slopes[k] + change[k]);
        let second = a * a + xx + b * b + yy;
        let mean = value * (1.0 + side * side * second / 24.0);
        (mean, [value * a, value * b])
    }
}

/// Mean and slopes in a cell of a function from its values in the middle of it and of its neighbours along either axis.
fn plane(own: f64, [[a, b], [c, d]]: [[f64; 2]; 2]) -> (f64, [f64; 2]) {
    let second = a + b + c + d - 4.0 * own;
    (own + second / 24.0, [0.5 * (b - a), 0.5 * (d - c)])
}

/// Mean of |f| over a cell from the same: of order 3 where f changes sign inside of cells.
#[inline]
pub(super) fn modulus_in_cell(own: f64, around: [[f64; 2]; 2]) -> f64 {
    let (mean, slopes) = plane(own, around);
    modulus(mean, slopes)
}

/// Mean over the cell |x|, |y| < 1/2 of the positive part of a plane.
fn positive(mean: f64, slopes: [f64; 2]) -> f64 {
    0.5 * (mean + modulus(mean, slopes))
}

/// Mean of |mean + a x + b y| over the cell |x|, |y| < 1/2.
#[inline]
fn modulus(mean: f64, slopes: [f64; 2]) -> f64 {
    let slopes = slopes.map(f64::abs);
    if mean.abs() >= 0.5 * (slopes[0] + slopes[1]) {
        mean.abs()
    } else {
        mean_across_zero(mean, slopes)
    }
}

/// The same of a plane that passes through zero in the cell; slopes not negative.
fn mean_across_zero(mean: f64, [a, b]: [f64; 2]) -> f64 {
    // |s|^3/6 is the modulus integrated twice. Over the steeper slope: cubes of next to nothing would be 0, and a slope of next to
    // nothing beside the other would leave rounding alone.
    let steep = a.max(b);
    let (mean, flat) = (mean / steep, (a.min(b) / steep).max(1e-3));
    let twice = |s: f64| s.abs() * s * s / 6.0;
    let along = |s: f64| twice(s + 0.5 * flat) - twice(s - 0.5 * flat);
    steep * (along(mean + 0.5) - along(mean - 0.5)) / flat
}

#[cfg(test)]
mod tests {
    use super::{Pair, modulus_in_cell};
    use crate::gaussian::{lower, normal};

    /// Error of the L1 distance of two Gaussians with such means and deviations on so many cells either way.
    fn error(cells: usize, laws: [([f64; 2], f64); 2], exact: f64) -> f64 {
        let h = 18.0 / cells as f64;
        let centre = |i: usize, mean: f64| -9.0 + (i as f64 + 0.5) * h - mean;
        let [p, law] = laws.map(|([q, v], s)| -> Vec<f64> {
            let part = |i: usize, mean: f64| h * normal(centre(i, mean) / s) / s;
            let all = (0..cells * cells).map(|k| part(k / cells, q) * part(k % cells, v));
            all.collect()
        });
        let pair = Pair::new(&p, &law, cells);
        let inner = || Pair::AROUND..cells - Pair::AROUND;
        let all =
            inner().map(|i| pair.excess(i * cells + Pair::AROUND..(i + 1) * cells - Pair::AROUND));
        (2.0 * all.sum::<f64>() - exact).abs()
    }

    #[test]
    fn next_to_nothing_on_either_side_of_zero_has_a_modulus() {
        let tiny = modulus_in_cell(1e-200, [[-1e-200, 3e-200], [1e-200, 1e-200]]);
        assert!((1e-200..2e-200).contains(&tiny), "{tiny}");
    }

    #[test]
    fn it_is_of_order_3_where_the_difference_changes_sign_inside_of_cells() {
        // Means 0.7 apart in an oblique direction: 2 erf(0.7/sqrt 8).
        let laws = [([0.3, -0.2], 1.0), ([0.86, 0.22], 1.0)];
        let exact = 2.0 * (2.0 * lower(0.35) - 1.0);
        let errors = [24, 48, 96, 192].map(|cells| error(cells, laws, exact));
        println!("{errors:?}");
        assert!(
            errors[1] < 2e-4 && 64.0 * errors[3] < errors[1] && 512.0 * errors[3] < errors[0],
            "{errors:?}"
        );
    }

    #[test]
    fn it_is_known_where_a_narrow_density_meets_a_wide_one_in_its_tails() {
        // About one mean with deviations s and 1: they meet on a circle, (1 - s^2) r^2 = 4 s^2 ln(1/s), 3.1 s from it.
        let (s, mean) = (0.1_f64, [0.013, -0.048]);
        let square = -4.0 * s * s * s.ln() / (1.0 - s * s);
        let exact = 2.0 * ((-0.5 * square).exp() - (-0.5 * square / (s * s)).exp());
        // Cells of 0.47, 0.35 and 0.23 s: p falls by e^1.5 in the widest.
        let errors = [384, 512, 768].map(|cells| error(cells, [(mean, s), (mean, 1.0)], exact));
        println!("{errors:?}");
        assert!(
            errors[0] < 1e-4 && errors[1] < 3e-5 && errors[2] < 1e-5,
            "{errors:?}"
        );
    }
}
