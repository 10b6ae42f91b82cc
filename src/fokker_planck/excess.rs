//! By how much one density exceeds another in a cell: the L1 distance is made of it.

/// Two densities on one grid, by the probability in their cells; the last axis is contiguous with this many of them.
pub(super) struct Pair<'a> {
    pub(super) p: &'a [f64],
    pub(super) law: &'a [f64],
    pub(super) stride: usize,
}

/// Parts of a cell along either axis where the difference of the densities changes sign in it.
const PARTS: usize = 6;

impl Pair<'_> {
    /// Cells that [`Self::excess`] asks of about its own, either way.
    pub(super) const AROUND: usize = 2;

    /// Integral over cell k of the positive part of p - p_s, to order 3. Where the difference changes sign, both are exponentials of
    /// quadratics: far out in the tails, where a narrow density meets a wide one, they fall by several times from one cell to the
    /// next. The cells beside them have means of order 6, for the sum to end there without leaving more.
    pub(super) fn excess(&self, k: usize) -> f64 {
        let n = self.stride;
        let change = |k: usize| self.p[k] - self.law[k];
        let own = change(k);
        let beside = [k - n, k + n, k - 1, k + 1].map(change);
        let second = beside.iter().sum::<f64>() - 4.0 * own;
        let beyond = [k - 2 * n, k + 2 * n, k - 2, k + 2].map(change);
        let fourth = beyond.iter().sum::<f64>() - 4.0 * own - 4.0 * second;
        let corners = [k - n - 1, k - n + 1, k + n - 1, k + n + 1].map(change);
        let crossed = corners.iter().sum::<f64>() - 4.0 * own - 2.0 * second;
        let mean = own + second / 24.0 - 17.0 / 5760.0 * fourth + crossed / 576.0;
        if beside.iter().all(|other| own * other > 0.0) {
            return mean.max(0.0);
        }
        let quadratics = [self.p, self.law].map(|it| Quadratic::of_logarithm(it, self.stride, k));
        match quadratics {
            [Some(p), Some(law)] => excess_of(&p, &law),
            _ => {
                let slopes = [0, 2].map(|k| 0.5 * (beside[k + 1] - beside[k]));
                0.5 * (mean + mean_modulus(mean, slopes))
            }
        }
    }
}

/// The same over a cell |x|, |y| < 1/2 of exponentials of quadratics, by planes over its parts.
fn excess_of(p: &Quadratic, law: &Quadratic) -> f64 {
    let part = 1.0 / PARTS as f64;
    let middles = || (0..PARTS).map(|i| (i as f64 + 0.5) * part - 0.5);
    let points = middles().flat_map(|x| middles().map(move |y| [x, y]));
    let over = points.map(|x| {
        let ((p, dp), (law, dlaw)) = (p.exponential(x), law.exponential(x));
        let mean = p - law;
        let slopes = [0, 1].map(|k| part * (dp[k] - dlaw[k]));
        0.5 * (mean + mean_modulus(mean, slopes))
    });
    over.sum::<f64>() * part * part
}

/// c + g.x + x.A x/2 about the middle of a cell, lengths in cells.
struct Quadratic {
    value: f64,
    slopes: [f64; 2],
    /// A_xx, A_xy and A_yy.
    bends: [f64; 3],
}

impl Quadratic {
    /// Through the logarithm of a density; `None` where it is not positive all about the cell.
    fn of_logarithm(cells: &[f64], stride: usize, k: usize) -> Option<Self> {
        let row = |first: usize| [0, 1, 2].map(|j| cells[first + j]);
        let rows = [k - stride - 1, k - 1, k + stride - 1].map(row);
        if !rows.as_flattened().iter().all(|p| *p > 0.0) {
            return None;
        }
        let [below, own, above] = rows.map(|row| row.map(f64::ln));
        Some(Self {
            value: own[1],
            slopes: [0.5 * (above[1] - below[1]), 0.5 * (own[2] - own[0])],
            bends: [
                above[1] - 2.0 * own[1] + below[1],
                0.25 * (above[2] - above[0] - below[2] + below[0]),
                own[2] - 2.0 * own[1] + own[0],
            ],
        })
    }

    /// Its exponential and the slopes of that at a point of the cell.
    fn exponential(&self, [x, y]: [f64; 2]) -> (f64, [f64; 2]) {
        let [xx, xy, yy] = self.bends;
        let change = [xx * x + xy * y, xy * x + yy * y];
        let all = [0, 1].map(|k| self.slopes[k] + change[k]);
        let [x, y] = [0, 1].map(|k| [x, y][k] * (self.slopes[k] + 0.5 * change[k]));
        let value = (self.value + x + y).exp();
        (value, all.map(|slope| value * slope))
    }
}

/// Mean of |mean + a x + b y| over the cell |x|, |y| < 1/2.
fn mean_modulus(mean: f64, slopes: [f64; 2]) -> f64 {
    let [a, b] = slopes.map(f64::abs);
    if mean.abs() >= 0.5 * (a + b) {
        return mean.abs();
    }
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
    use super::{Pair, mean_modulus};
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
        let pair = Pair {
            p: &p,
            law: &law,
            stride: cells,
        };
        let inner = || Pair::AROUND..cells - Pair::AROUND;
        let all = inner().flat_map(|i| inner().map(move |j| i * cells + j));
        let all = all.map(|k| pair.excess(k));
        (2.0 * all.sum::<f64>() - exact).abs()
    }

    #[test]
    fn next_to_nothing_on_either_side_of_zero_has_a_modulus() {
        let tiny = mean_modulus(1e-200, [2e-200, 0.0]);
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
            errors[1] < 2e-4 && 512.0 * errors[3] < errors[0],
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
