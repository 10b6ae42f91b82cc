//! Friction with noise over a time: the exact Ornstein-Uhlenbeck step as a matrix along v.
//!
//! p'(v') = integral of N(v'; a v, s^2) p(v) dv with a = e^{-2 zeta tau}, s^2 = T (1 - a^2). For the ratio
//! g = p/e^{-beta v^2/2} it is again a Gaussian average, (O g)(v') = C N(m, d^2) applied to g, with
//!
//! ```text
//! 1/d^2 = a^2/s^2 + beta,   m = d^2 a v'/s^2,   C = (d/s) exp(-(1/s^2 - beta - a^2 d^2/s^4) v'^2/2)
//! ```
//!
//! so beta = 1/T gives m = a v', d = s, C = 1 (Mehler), and beta = 0 the density itself. The average is
//! taken of the spline through g, exactly: panel by panel between knots.

use super::interpolation::{MARGIN, POINTS, Spline};
use super::mesh::Axis;
use crate::damping::mean_decay;
use crate::gaussian::{lower, normal};
use crate::matrix::vectorise;

/// Reach of the Gaussian in deviations: erfc(8.5/sqrt 2) = 2e-17.
const REACH: f64 = 8.5;
/// Widest panel of the 10-point rule, in deviations; its error there is below 1e-14.
const PANEL: f64 = 1.4;
/// Positive nodes and weights of the 10-point Gauss rule on [-1, 1].
const GAUSS: [(f64, f64); 5] = [
    (0.148_874_338_981_631_22, 0.295_524_224_714_752_87),
    (0.433_395_394_129_247_2, 0.269_266_719_309_996_35),
    (0.679_409_568_299_024_4, 0.219_086_362_515_982_04),
    (0.865_063_366_688_984_5, 0.149_451_349_150_580_6),
    (0.973_906_528_517_171_7, 0.066_671_344_308_688_14),
];

/// Friction at a rate c with noise over `tau` is exactly v to v e^{-x}, friction at the rate `base` with the same noise, v to
/// v e^{-y}, whatever the noise: x and y.
pub(crate) fn around(rate: f64, base: f64, tau: f64) -> [f64; 2] {
    let after = 0.5 * (mean_decay(2.0 * base * tau) / mean_decay(2.0 * rate * tau)).ln();
    [(rate - base) * tau - after, after]
}

/// The average of a spline along `axis` over each node's Gaussian: from n + 2 margin coefficients to n
/// values, row-major. `friction` is 2 zeta tau. With `stationary` g continues beyond the nodes as a constant and
/// the rows are scaled to sum to 1; without, it is 0 there.
pub(crate) fn average(axis: &Axis, friction: f64, temperature: f64, stationary: bool) -> Vec<f64> {
    let kick = Kick {
        decay: (-friction).exp(),
        variance: -temperature * (-2.0 * friction).exp_m1(),
        shift: 0.0,
        beta: if stationary { 1.0 / temperature } else { 0.0 },
    };
    kick.matrix(axis, stationary, stationary)
}

/// Friction, noise and a force over a time, on a density taken against e^{-beta v^2/2}: v' = decay v + shift + a normal of
/// this variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Kick {
    /// e^{-c tau}.
    pub(crate) decay: f64,
    /// Of the noise, >= 0.
    pub(crate) variance: f64,
    /// By the force.
    pub(crate) shift: f64,
    /// Of the weight; 0 for the density itself.
    pub(crate) beta: f64,
}

impl Kick {
    /// Friction at a rate c, in free flight 0, noise with the diffusion coefficient `noise` and a constant force, over `tau`.
    pub(crate) fn new(rate: f64, tau: f64, (noise, force): (f64, f64), beta: f64) -> Self {
        let x = rate * tau;
        Self {
            decay: (-x).exp(),
            variance: 2.0 * noise * tau * mean_decay(2.0 * x),
            shift: force * tau * mean_decay(x),
            beta,
        }
    }

    /// The deviation of the noise.
    pub(crate) fn deviation(&self) -> f64 {
        self.variance.sqrt()
    }

    /// The average as [`average`] gives it, but that g = 1 does not stay. With u = v' - shift and D = a^2 + beta s^2
    ///
    /// ```text
    /// m = a u/D,   d^2 = s^2/D,   C = D^{-1/2} exp(beta (v'^2 - u^2/D)/2)
    /// ```
    ///
    /// also without noise, where the average is the value at m. With `clamped` g continues beyond the nodes as a
    /// constant, else it is 0 there.
    pub(crate) fn average(&self, axis: &Axis, clamped: bool) -> Vec<f64> {
        self.matrix(axis, clamped, false)
    }

    /// The matrix, its rows scaled to sum to 1 if g = 1 is `kept`.
    fn matrix(&self, axis: &Axis, clamped: bool, kept: bool) -> Vec<f64> {
        let n = axis.len();
        let width = n + 2 * MARGIN;
        let spline = Spline::new();
        let mut matrix = vec![0.0; n * width];
        let spread_by = self.decay * self.decay + self.beta * self.variance;
        let deviation = (self.variance / spread_by).sqrt();
        let centres = axis.centres();
        let narrowest = axis.slopes().iter().copied().fold(f64::INFINITY, f64::min);
        // On a symmetric axis and without a force the rows of negative v are those of positive v, reversed.
        let opposite = |j: usize| (centres[j] + centres[n - 1 - j]).abs();
        let symmetric =
            self.shift == 0.0 && (0..n / 2).all(|j| opposite(j) <= 1e-13 * centres[n - 1]);
        let built = if symmetric { n.div_ceil(2) } else { n };
        let rows = matrix.chunks_exact_mut(width).zip(centres);
        for (row, v) in rows.take(built) {
            let u = v - self.shift;
            let mean = self.decay * u / spread_by;
            let scale = if kept {
                1.0
            } else {
                (0.5 * self.beta * (v * v - u * u / spread_by)).exp() / spread_by.sqrt()
            };
            if deviation > NO_WIDTH * narrowest {
                vectorise!(gauss(axis, &spline, [mean, deviation], clamped, row));
            } else if clamped || (mean >= axis.edges()[0] && mean <= axis.edges()[n]) {
                let xi = (axis.locate(mean) - 0.5).clamp(0.0, (n - 1) as f64);
                spread(row, &spline, n, xi, 1.0);
            }
            // What the rule for a Gaussian leaves out of 1.
            let sum: f64 = if clamped { row.iter().sum() } else { 1.0 };
            for x in row {
                *x *= scale / sum;
            }
        }
        for j in built..n {
            let (below, row) = matrix.split_at_mut(j * width);
            let mirror = &below[(n - 1 - j) * width..(n - j) * width];
            for (x, y) in row[..width].iter_mut().zip(mirror.iter().rev()) {
                *x = *y;
            }
        }
        matrix
    }
}

/// Deviation of a Gaussian over a cell, below which its average is the value at its mean.
const NO_WIDTH: f64 = 1e-6;

/// Adds so much of the spline at xi to a row. A function: a closure of several callers stays outside the dispatch.
#[inline(always)]
fn spread(row: &mut [f64], spline: &Spline, n: usize, xi: f64, weight: f64) {
    let (first, place) = Spline::place(xi, n);
    let weights = spline.weights(place);
    for (x, w) in row[first..].iter_mut().zip(&weights[..POINTS]) {
        *x = weight.mul_add(*w, *x);
    }
}

/// Adds the average over N(mean, deviation^2) to a row.
#[inline(always)]
fn gauss(
    axis: &Axis,
    spline: &Spline,
    [mean, deviation]: [f64; 2],
    clamped: bool,
    row: &mut [f64],
) {
    let n = axis.len();
    let centres = axis.centres();
    let (low, high) = (mean - REACH * deviation, mean + REACH * deviation);
    let mut add = |xi: f64, weight: f64| spread(row, spline, n, xi, weight);
    if clamped {
        let tail = |x: f64| lower(-x / deviation);
        if low < centres[0] {
            add(0.0, tail(mean - centres[0]));
        }
        if high > centres[n - 1] {
            add((n - 1) as f64, tail(centres[n - 1] - mean));
        }
    }
    let uniform = axis.is_uniform().then(|| 1.0 / axis.slopes()[0]);
    let norm = normal(0.0) / deviation;
    // Knots lie on the nodes: the degree is odd.
    let start = centres.partition_point(|v| *v <= low).max(1) - 1;
    for k in start..n - 1 {
        let (a, b) = (centres[k].max(low), centres[k + 1].min(high));
        if a >= b {
            if centres[k] > high {
                break;
            }
            continue;
        }
        let parts = ((b - a) / (PANEL * deviation)).ceil().max(1.0);
        let half = 0.5 * (b - a) / parts;
        for part in 0..parts as usize {
            let middle = a + half * (2 * part + 1) as f64;
            let both = GAUSS.iter().flat_map(|(x, w)| [(-x, *w), (*x, *w)]);
            for (x, weight) in both {
                let v = middle + half * x;
                let z = (v - mean) / deviation;
                let xi = match uniform {
                    Some(inverse) => k as f64 + (v - centres[k]) * inverse,
                    None => axis.locate(v) - 0.5,
                };
                let xi = xi.clamp(k as f64, (k + 1) as f64);
                add(xi, weight * half * norm * (-0.5 * z * z).exp());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error of the averaged f against `exact`, on the inner half of the axis.
    fn error(
        (temperature, friction): (f64, f64),
        stationary: bool,
        n: usize,
        f: impl Fn(f64) -> f64,
        exact: impl Fn(f64) -> f64,
    ) -> f64 {
        let axis = Axis::uniform(-6.0, 6.0, n).unwrap();
        let width = n + 2 * MARGIN;
        let matrix = average(&axis, friction, temperature, stationary);
        let values: Vec<f64> = axis.centres().iter().map(|v| f(*v)).collect();
        let filter = super::super::interpolation::coefficients(n, None, &|| Ok(())).unwrap();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let coefficients: Vec<f64> = filter
            .chunks_exact(n)
            .map(|row| dot(row, &values))
            .collect();
        let averaged = matrix
            .chunks_exact(width)
            .map(|row| dot(row, &coefficients));
        averaged
            .zip(axis.centres())
            .filter(|(_, v)| v.abs() < 3.0)
            .map(|(got, v)| (got - exact(*v)).abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn hermite_polynomials_decay_at_their_own_rates() {
        // He_n(v/sqrt T) is multiplied by e^{-n 2 zeta tau} (Mehler); cut to the domain by the spline alone.
        for friction in [1e-3f64, 0.02, 0.5] {
            let t = 0.25f64;
            let third = |v: f64| {
                let z = v / t.sqrt();
                z * z * z - 3.0 * z
            };
            let decay = (-3.0 * friction).exp();
            let error = error((t, friction), true, 96, third, |v| decay * third(v));
            println!("friction {friction}: third mode to {error:.1e}");
            assert!(error < 1e-7);
        }
    }

    #[test]
    fn a_gaussian_density_spreads_as_ornstein_and_uhlenbeck_say() {
        for friction in [1e-3f64, 0.02, 0.5] {
            let (t, mean, variance) = (0.5f64, 0.7f64, 0.09f64);
            let gauss = |v: f64, m: f64, s: f64| {
                (-0.5 * (v - m) * (v - m) / s).exp() / (std::f64::consts::TAU * s).sqrt()
            };
            let a = (-friction).exp();
            let later = variance * a * a + t * (1.0 - a * a);
            let start = |v: f64| gauss(v, mean, variance);
            let exact = |v: f64| gauss(v, mean * a, later);
            let errors = [96, 192].map(|n| error((t, friction), false, n, start, exact));
            let order = (errors[0] / errors[1]).log2();
            println!(
                "friction {friction}: {:.1e} and {:.1e}, order {order:.1}",
                errors[0], errors[1]
            );
            assert!(errors[0] < 1e-4 && order > 7.5);
        }
    }
}
