//! Standard deviation, skewness and kurtosis of a sample, and what each path does to them.
//!
//! To first order in 1/sqrt(n) an estimate errs by the mean of its influence function, a polynomial in x = (N - E N)/std, and by the
//! root of its mean square over n. Where few paths carry that square, a sample without them errs as much and does not know it: no
//! factor on the error helps, for samples that have seen them have a large one.

use super::few::{OF_KURTOSIS, OF_SKEWNESS, OF_VARIANCE, TELLING, at_least, tails};
use crate::estimate::{Estimate, Origin};

/// Powers 0 to 8 of x, summed over some paths.
pub(super) type Powers = [f64; 9];

/// A polynomial in x of degree 4.
type Influence = [f64; 5];

/// Standard deviation, skewness and kurtosis of a sample, the first in units of itself.
pub(super) struct Shape {
    pub(super) std: Estimate,
    pub(super) skewness: Estimate,
    pub(super) kurtosis: Estimate,
    /// How many paths carry the error of the kurtosis.
    pub(super) carriers: f64,
}

impl Shape {
    /// From groups of paths, x being about the mean of all over the deviation of all.
    pub(super) fn of(groups: &[Powers]) -> Self {
        let all = |k: usize| groups.iter().map(|it| it[k]).sum::<f64>();
        let n = all(0);
        let [s, k] = [3, 4].map(|power| all(power) / n);
        let (a, b) = (1.5 * s, 2.0 * k);
        let error = |part: f64, influence: Influence, usual: f64| {
            let square = squared(influence);
            let of = |it: &Powers| it.iter().zip(square).map(|(x, c)| c * x).sum::<f64>();
            let squares: Vec<f64> = groups.iter().map(|it| of(it).max(0.0)).collect();
            let mean = squares.iter().sum::<f64>() / n;
            let error = tails(part, k, n) * (at_least(mean, usual, n) / n).sqrt();
            (error, carriers(&squares))
        };
        let sampled = |value, error| Estimate::new(value, error, Origin::Sampling);
        // Those of a Gaussian, if its own are not to be seen: 1/2, 6 and 24.
        let (of_std, _) = error(OF_VARIANCE, [-0.5, 0.0, 0.5, 0.0, 0.0], 0.5);
        let (of_skewness, _) = error(OF_SKEWNESS, [a - s, -3.0, -a, 1.0, 0.0], 6.0);
        let (of_kurtosis, carriers) = error(OF_KURTOSIS, [b - k, -4.0 * s, -b, 0.0, 1.0], 24.0);
        Self {
            std: sampled((n / (n - 1.0)).sqrt(), of_std),
            skewness: sampled(s, of_skewness),
            kurtosis: sampled(k, of_kurtosis),
            carriers,
        }
    }
}

/// The coefficients of the square of a polynomial.
fn squared(it: Influence) -> Powers {
    let mut square = Powers::default();
    for (j, a) in it.iter().enumerate() {
        for (k, b) in it.iter().enumerate() {
            square[j + k] += a * b;
        }
    }
    square
}

/// How many paths carry a sum of squares, by how it is spread over groups of about as many: (sum x)^2/sum x^2 over paths, of which
/// groups see what is left when each has its share; infinite where groups are too few to tell.
fn carriers(groups: &[f64]) -> f64 {
    let (sum, square) = groups
        .iter()
        .fold((0.0, 0.0), |(sum, square), x| (sum + x, square + x * x));
    let apart = square / (sum * sum) - 1.0 / groups.len() as f64;
    if groups.len() >= TELLING && apart > 0.0 {
        1.0 / apart
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_path_that_has_all_of_a_sum_carries_it() {
        let mut groups = vec![1e-9; 64];
        groups[5] = 1.0;
        assert!((carriers(&groups) - 64.0 / 63.0).abs() < 1e-6);
        assert_eq!(carriers(&[2.0; 4]), f64::INFINITY);
        assert_eq!(carriers(&[0.0; 4]), f64::INFINITY);
    }

    #[test]
    fn the_errors_of_a_gaussian_are_those_of_the_textbook() {
        // Moments of a Gaussian in four equal groups: 1, 3, 15, 105.
        let n = 1e8;
        let group = [1.0, 0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0].map(|m| 0.25 * n * m);
        let it = Shape::of(&[group; 4]);
        for (found, exact) in [
            (it.std.error, 0.5),
            (it.skewness.error, 6.0),
            (it.kurtosis.error, 24.0),
        ] {
            let exact = (exact / n).sqrt();
            assert!((found / exact - 1.0).abs() < 1e-3, "{found:e} {exact:e}");
        }
        assert_eq!((it.skewness.value, it.kurtosis.value), (0.0, 3.0));
    }
}
