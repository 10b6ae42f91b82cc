//! Difference and interpolation coefficients on a uniform coordinate with unit spacing.

/// Central first derivative of order 2k: f'_i = sum_l c_l (f_{i+l} - f_{i-l}), l = 1..k.
pub(crate) fn central(half_width: usize) -> &'static [f64] {
    match half_width {
        1 => &[1.0 / 2.0],
        2 => &[2.0 / 3.0, -1.0 / 12.0],
        3 => &[3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0],
        _ => &[4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0],
    }
}

/// Staggered first derivative of order 2k, from centres to the face between them:
/// f'_{i+1/2} = sum_l s_l (f_{i+l} - f_{i+1-l}), l = 1..k.
pub(crate) fn staggered(half_width: usize) -> &'static [f64] {
    match half_width {
        1 => &[1.0],
        2 => &[9.0 / 8.0, -1.0 / 24.0],
        3 => &[75.0 / 64.0, -25.0 / 384.0, 3.0 / 640.0],
        _ => &[
            1225.0 / 1024.0,
            -245.0 / 3072.0,
            49.0 / 5120.0,
            -5.0 / 7168.0,
        ],
    }
}

/// Weights that interpolate a function known at `first`, `first + 1`, ... (as many as `weights`) at x,
/// with the polynomial through all of them. They sum to 1.
pub fn lagrange(first: f64, x: f64, weights: &mut [f64]) {
    let n = weights.len();
    for (i, weight) in weights.iter_mut().enumerate() {
        *weight = (0..n).filter(|k| *k != i).fold(1.0, |product, k| {
            product * (x - first - k as f64) / (i as f64 - k as f64)
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_exact_to_their_order() {
        for k in 1..=4 {
            for degree in 0..=2 * k as i32 {
                let slope = |x: f64| {
                    if degree == 0 {
                        0.0
                    } else {
                        f64::from(degree) * x.powi(degree - 1)
                    }
                };
                let f = |x: f64| x.powi(degree);
                let c: f64 = central(k)
                    .iter()
                    .zip(1..)
                    .map(|(c, l)| c * (f(0.3 + f64::from(l)) - f(0.3 - f64::from(l))))
                    .sum();
                assert!((c - slope(0.3)).abs() < 1e-10, "central {k} {degree}");
                let s: f64 = staggered(k)
                    .iter()
                    .zip(1..)
                    .map(|(s, l)| {
                        let reach = f64::from(l) - 0.5;
                        s * (f(0.3 + reach) - f(0.3 - reach))
                    })
                    .sum();
                assert!((s - slope(0.3)).abs() < 1e-10, "staggered {k} {degree}");
            }
        }
    }

    #[test]
    fn interpolation_is_exact_to_its_degree() {
        let mut weights = [0.0; 8];
        lagrange(-3.0, 0.4, &mut weights);
        let sum: f64 = weights.iter().sum();
        assert!((sum - 1.0).abs() < 1e-14);
        for degree in 0..8 {
            let got: f64 = weights
                .iter()
                .zip(-3..)
                .map(|(w, k)| w * f64::from(k).powi(degree))
                .sum();
            assert!((got - 0.4f64.powi(degree)).abs() < 1e-11, "{degree}");
        }
    }
}
