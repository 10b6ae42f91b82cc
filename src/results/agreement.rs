//! How far two independent answers are from each other.

use crate::estimate::{Estimate, name_at};
use crate::moments::Moments;
use crate::quadrature;
use serde::Serialize;
use std::f64::consts::SQRT_2;

/// The distance between two independent answers, in units of their errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Agreement {
    /// Largest |a - b| / sqrt(error_a^2 + error_b^2) over all names and times both have.
    pub worst: f64,
    /// Its name.
    pub worst_of: &'static str,
    /// Its time; None for a stationary number.
    pub t: Option<f64>,
    /// Expected largest of that many |standard normals|, were they independent.
    pub expected_worst: f64,
    /// How many were compared.
    pub compared: usize,
}

impl Agreement {
    /// Agreement of pairs of numbers, each with its name and time.
    pub(super) fn over(pairs: impl IntoIterator<Item = Pair>) -> Option<Self> {
        let mut worst: Option<(f64, &'static str, Option<f64>)> = None;
        let mut compared = 0;
        for (name, t, a, b) in pairs {
            if let Some(z) = distance(a, b) {
                compared += 1;
                if worst.is_none_or(|(worst, ..)| z > worst) {
                    worst = Some((z, name, t));
                }
            }
        }
        worst.map(|(worst, worst_of, t)| Self {
            worst,
            worst_of,
            t,
            expected_worst: expected_largest(compared),
            compared,
        })
    }
}

/// Runs in which chance gives what is said to be none, and paths from which on their errors are as those of a normal law.
const ONE_IN: f64 = 1e5;
const MANY: u64 = 1000;

impl Agreement {
    /// What to say where it is worse than chance gives in one of 100 000 runs: two answers that do not agree, or errors that are too
    /// small.
    pub(crate) fn doubt(&self, paths: u64) -> Option<String> {
        let chance = self.compared as f64 * libm::erfc(self.worst / SQRT_2);
        let number = match self.t {
            Some(t) => name_at(self.worst_of, t),
            None => self.worst_of.to_owned(),
        };
        (paths >= MANY && chance < 1.0 / ONE_IN).then(|| {
            format!(
                "the two answers differ by {:.1} standard errors in {number}, where chance alone would give about {:.1}: one of \
                 them, or its error, is wrong",
                self.worst, self.expected_worst
            )
        })
    }
}

/// Name, time if it has one, and two answers.
pub(super) type Pair = (&'static str, Option<f64>, Estimate, Estimate);

/// Pairs of the times and names both have.
pub(super) fn common(
    (times_a, a): (&[f64], &[Moments]),
    (times_b, b): (&[f64], &[Moments]),
) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for (t, a) in times_a.iter().zip(a) {
        let same = times_b.iter().position(|it| it == t);
        let Some(b) = same.and_then(|k| b.get(k)) else {
            continue;
        };
        for ((name, a), (_, b)) in a.named().into_iter().zip(b.named()) {
            pairs.extend(a.zip(b).map(|(a, b)| (name, Some(*t), a, b)));
        }
    }
    pairs
}

/// |a - b| / sqrt(error_a^2 + error_b^2); None without an error or a number.
pub(crate) fn distance(a: Estimate, b: Estimate) -> Option<f64> {
    let z = (a.value - b.value).abs() / a.error.hypot(b.error);
    z.is_finite().then_some(z)
}

/// Expected largest of `n` independent |standard normals|: the integral of 1 - erf(x/sqrt 2)^n.
pub(crate) fn expected_largest(n: usize) -> f64 {
    let beyond = |x: f64| 1.0 - libm::erf(x / SQRT_2).powf(n as f64);
    if n == 0 {
        return 0.0;
    }
    quadrature::integrate(beyond, &[0.0, 1.0, 2.0, 4.0, 6.0, 9.0], 1e-9).value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_expected_largest_of_many_normals_is_the_known_one() {
        // E|Z| = sqrt(2/pi), E max(|Z1|, |Z2|) = 2/sqrt(pi); 1000: Gumbel within a few percent.
        assert!((expected_largest(1) - 0.797_884_560_8).abs() < 1e-8);
        assert!((expected_largest(2) - 2.0 / std::f64::consts::PI.sqrt()).abs() < 1e-8);
        let many = expected_largest(1000);
        assert!((3.3..3.6).contains(&many), "{many}");
        assert_eq!(expected_largest(0), 0.0);
    }

    #[test]
    fn agreement_adds_the_errors_in_quadrature_and_takes_the_worst_over_common_times() {
        let at = |mean: f64, error: f64| Moments {
            mean_q: Estimate::new(mean, error, crate::estimate::Origin::Space),
            ..Moments::default()
        };
        let a = [at(0.0, 3.0), at(1.0, 3.0), at(9.0, 3.0)];
        let b = [at(0.0, 4.0), at(11.0, 4.0)];
        let it = Agreement::over(common((&[1.0, 2.0, 3.0], &a), (&[1.0, 2.0], &b))).unwrap();
        assert_eq!(
            (it.worst, it.worst_of, it.t, it.compared),
            (2.0, "mean_q", Some(2.0), 2)
        );
        assert!(common((&[1.0], &a[..1]), (&[5.0], &b[..1])).is_empty());
    }
}
