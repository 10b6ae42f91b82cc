//! Affine coordinates that move with a narrow density: x = mean + L xi, L lower triangular.

use std::f64::consts::SQRT_2;

/// x = (q, v) = mean + L xi. L is lower triangular, so a line of constant xi_1 is a line of constant q:
/// friction and noise act along xi_2 alone, and a function of q is one of xi_1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Frame {
    /// (q, v) at xi = 0.
    pub(crate) mean: [f64; 2],
    /// L_qq, L_vq, L_vv; the covariance is L L^T where xi is standard normal.
    pub(crate) lower: [f64; 3],
}

impl Frame {
    pub(crate) fn of(mean: [f64; 2], covariance: [[f64; 2]; 2]) -> Self {
        let [[qq, qv], [_, vv]] = covariance;
        let first = qq.max(0.0).sqrt();
        let cross = if first > 0.0 { qv / first } else { 0.0 };
        Self {
            mean,
            lower: [first, cross, (vv - cross * cross).max(0.0).sqrt()],
        }
    }

    /// (q, v) of xi.
    #[inline(always)]
    pub(crate) fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [qq, vq, vv] = self.lower;
        [self.mean[0] + qq * x, self.mean[1] + vq * x + vv * y]
    }

    /// xi of (q, v).
    #[inline(always)]
    pub(crate) fn locate(&self, [q, v]: [f64; 2]) -> [f64; 2] {
        let [qq, vq, vv] = self.lower;
        let x = (q - self.mean[0]) / qq;
        [x, (v - self.mean[1] - vq * x) / vv]
    }

    /// dq dv over d xi_1 d xi_2.
    pub(crate) fn area(&self) -> f64 {
        self.lower[0] * self.lower[2]
    }

    /// Standard deviations of q and v where xi is standard normal.
    pub(crate) fn deviation(&self) -> [f64; 2] {
        [self.lower[0], self.lower[1].hypot(self.lower[2])]
    }

    /// Deviation of q at given v, and of v at given q: what the cells of a tensor mesh must resolve,
    /// since exp(-k C k/2) reaches furthest along k_q to 1/(the former).
    pub(crate) fn conditional(&self) -> [f64; 2] {
        [self.area() / self.deviation()[1], self.lower[2]]
    }

    /// The smaller semi-axis of the ellipse of one deviation: the smaller singular value of L.
    pub(crate) fn narrowest(&self) -> f64 {
        let [a, b, c] = self.lower;
        let (sum, difference) = ((a + c).hypot(b), (a - c).hypot(b));
        // Product over the larger one: no digits are lost.
        self.area() / (0.5 * (sum + difference))
    }

    /// The frame of the image of a law with this `mean` and `lower` factor in xi under `map`, exact for
    /// polynomials of degree 2 of a Gaussian: nine points of the Gauss-Hermite rule, and the triangular
    /// factor from their differences, never squared (Arasaratnam and Haykin, IEEE Trans. Autom. Control
    /// 54, 1254, 2009).
    pub(crate) fn image(
        &self,
        law: &Frame,
        map: impl FnOnce(&[[f64; 2]; 9]) -> [[f64; 2]; 9],
    ) -> Self {
        const WEIGHTS: [f64; 3] = [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0];
        let node = |k: usize| (k as f64 - 1.0) * 1.5f64.sqrt() * SQRT_2;
        let weight = |k: usize| WEIGHTS[k / 3] * WEIGHTS[k % 3];
        let points = std::array::from_fn(|k| self.at(law.at([node(k / 3), node(k % 3)])));
        let images = map(&points);
        // About the image of the centre: small numbers keep their digits.
        let centre = images[4];
        let offset: [f64; 2] = std::array::from_fn(|d| {
            (0..9)
                .map(|k| weight(k) * (images[k][d] - centre[d]))
                .sum::<f64>()
        });
        let part = |d: usize, k: usize| weight(k).sqrt() * (images[k][d] - centre[d] - offset[d]);
        let first = (0..9).map(|k| part(0, k).powi(2)).sum::<f64>().sqrt();
        let cross = (0..9).map(|k| part(0, k) * part(1, k)).sum::<f64>() / first;
        let square = |k| (part(1, k) - cross / first * part(0, k)).powi(2);
        let last = (0..9).map(square).sum::<f64>().sqrt();
        Self {
            mean: [centre[0] + offset[0], centre[1] + offset[1]],
            lower: [first, cross, last],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_image_has_the_transformed_covariance() {
        let frame = Frame::of([1.0, -2.0], [[0.04, 0.01], [0.01, 0.09]]);
        let (a, b, c, d) = (1.0, 0.5, -0.7, 0.8);
        let standard = Frame::of([0.0; 2], [[1.0, 0.0], [0.0, 1.0]]);
        let image = frame.image(&standard, |points| {
            points.map(|[q, v]| [a * q + b * v, c * q + d * v])
        });
        let qq = a * a * 0.04 + 2.0 * a * b * 0.01 + b * b * 0.09;
        let qv = a * c * 0.04 + (a * d + b * c) * 0.01 + b * d * 0.09;
        let vv = c * c * 0.04 + 2.0 * c * d * 0.01 + d * d * 0.09;
        let exact = Frame::of([a - 2.0 * b, c - 2.0 * d], [[qq, qv], [qv, vv]]);
        for (x, y) in image.lower.iter().zip(exact.lower) {
            assert!((x - y).abs() < 1e-14, "{image:?} {exact:?}");
        }
        let trace = 0.13f64;
        let smaller = 0.5 * (trace - (trace * trace - 4.0 * (0.04 * 0.09 - 0.0001)).sqrt());
        assert!((frame.narrowest() - smaller.sqrt()).abs() < 1e-14);
        let [q, v] = frame.locate(frame.at([0.3, -1.7]));
        assert!((q - 0.3).abs() < 1e-13 && (v + 1.7).abs() < 1e-13);
    }
}
