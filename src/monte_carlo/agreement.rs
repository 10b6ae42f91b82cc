//! Two answers to the same question, judged together.

use crate::estimate::{Estimate, Origin};
use crate::moments::Moments;

/// The largest disagreement between two sets of numbers, in standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Largest z = |a - b|/sqrt(error_a^2 + error_b^2).
    pub worst: f64,
    /// Name of the number that has it.
    pub worst_of: &'static str,
    /// Its time.
    pub t: f64,
    /// The worst z that as many independent right numbers are expected to show.
    pub expected_worst: f64,
    /// Numbers compared.
    pub count: usize,
}

/// Compares two sets of moments at the same times, number by number. A number that either side does not
/// have, or that has no error on either side (both exact), is left out. None if nothing is left.
pub fn agreement(times: &[f64], a: &[Moments], b: &[Moments]) -> Option<Agreement> {
    let mut worst: Option<(f64, &'static str, f64)> = None;
    let mut count = 0;
    for ((t, a), b) in times.iter().zip(a).zip(b) {
        for ((name, a), (_, b)) in a.named().into_iter().zip(b.named()) {
            let Some(z) = a.zip(b).and_then(|(a, b)| distance(a, b)) else {
                continue;
            };
            count += 1;
            if worst.is_none_or(|(largest, ..)| z > largest) {
                worst = Some((z, name, *t));
            }
        }
    }
    worst.map(|(worst, worst_of, t)| Agreement {
        worst,
        worst_of,
        t,
        expected_worst: expected_worst(count),
        count,
    })
}

/// |a - b| in standard deviations of the difference; None where it is not a number.
fn distance(a: Estimate, b: Estimate) -> Option<f64> {
    let sampled = a.origin == Origin::Sampling || b.origin == Origin::Sampling;
    let z = (a.value - b.value).abs() / a.error.hypot(b.error);
    (sampled && z.is_finite()).then_some(z)
}

/// Median of the largest |z| of `count` independent standard normals: what the worst of so many right
/// numbers looks like. Solves erfc(x/sqrt 2) = 1 - 2^{-1/count}.
pub fn expected_worst(count: usize) -> f64 {
    let share = -(-std::f64::consts::LN_2 / count.max(1) as f64).exp_m1();
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..100 {
        let middle: f64 = 0.5 * (low + high);
        if libm::erfc(middle / std::f64::consts::SQRT_2) > share {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_of_many_normals_is_about_as_expected() {
        // P(|z| < 0.6745) = 1/2; for 300 numbers the median of the largest is 3.05.
        assert!((expected_worst(1) - 0.674_489_750_196_081_7).abs() < 1e-12);
        println!(
            "expected worst of 11, 300, 10^4: {:.2} {:.2} {:.2}",
            expected_worst(11),
            expected_worst(300),
            expected_worst(10_000)
        );
        assert!((expected_worst(300) - 3.05).abs() < 0.02);
    }

    #[test]
    fn the_worst_number_is_named_and_what_does_not_exist_is_left_out() {
        let number = |value: f64| Estimate::new(value, 0.3, Origin::Sampling);
        let exact = |value: f64| Estimate::new(value, 0.4, Origin::Space);
        let a = Moments {
            mean_q: number(1.0),
            var_v: number(2.0),
            skewness_force: number(f64::NAN),
            ..Moments::default()
        };
        let b = Moments {
            mean_q: exact(1.5),
            var_v: exact(0.0),
            ..Moments::default()
        };
        let got = agreement(&[3.0], &[a], &[b]).unwrap();
        assert!((got.worst - 4.0).abs() < 1e-12 && got.worst_of == "var_v" && got.t == 3.0);
        assert_eq!(got.count, 2);
        assert!(agreement(&[], &[], &[]).is_none());
    }
}
