//! Adaptive Gauss-Kronrod quadrature with an error estimate.

use crate::estimate::{Estimate, Origin};
use std::f64::consts::PI;

/// Nodes of the 15-point Kronrod rule on [0, 1], mirrored to [-1, 1] (QUADPACK, Piessens et al. 1983).
const NODES: [f64; 8] = [
    0.991_455_371_120_812_6,
    0.949_107_912_342_758_5,
    0.864_864_423_359_769_1,
    0.741_531_185_599_394_5,
    0.586_087_235_467_691_1,
    0.405_845_151_377_397_2,
    0.207_784_955_007_898_47,
    0.0,
];
/// Weights of the 15-point Kronrod rule.
const KRONROD: [f64; 8] = [
    0.022_935_322_010_529_224,
    0.063_092_092_629_978_55,
    0.104_790_010_322_250_18,
    0.140_653_259_715_525_92,
    0.169_004_726_639_267_9,
    0.190_350_578_064_785_4,
    0.204_432_940_075_298_9,
    0.209_482_141_084_727_82,
];
/// Weights of the embedded 7-point Gauss rule (nodes 1, 3, 5, 7 of the list above).
const GAUSS: [f64; 4] = [
    0.129_484_966_168_869_7,
    0.279_705_391_489_276_64,
    0.381_830_050_505_118_9,
    0.417_959_183_673_469_4,
];

/// The 15-point rule on one interval: (integral, |Kronrod - Gauss|, integral of |f|).
fn rule(f: &impl Fn(f64) -> f64, a: f64, b: f64) -> (f64, f64, f64) {
    let (centre, half) = (0.5 * (a + b), 0.5 * (b - a));
    let middle = f(centre);
    let (mut kronrod, mut gauss) = (KRONROD[7] * middle, GAUSS[3] * middle);
    let mut absolute = KRONROD[7] * middle.abs();
    for k in 0..7 {
        let (low, high) = (f(centre - half * NODES[k]), f(centre + half * NODES[k]));
        kronrod += KRONROD[k] * (low + high);
        absolute += KRONROD[k] * (low.abs() + high.abs());
        if k % 2 == 1 {
            gauss += GAUSS[k / 2] * (low + high);
        }
    }
    (
        kronrod * half,
        ((kronrod - gauss) * half).abs(),
        absolute * half.abs(),
    )
}

/// Nodes and weights of Gauss and Legendre on [-1, 1], degree 2 N - 1, by Newton's method.
pub(crate) fn gauss<const N: usize>() -> [(f64, f64); N] {
    let n = N as f64;
    std::array::from_fn(|k| {
        let mut x = -((k as f64 + 0.75) / (n + 0.5) * PI).cos();
        let mut slope = 1.0;
        for _ in 0..60 {
            let (mut below, mut here) = (1.0, x);
            for m in 2..=N {
                let m = m as f64;
                (below, here) = (here, ((2.0 * m - 1.0) * x * here - (m - 1.0) * below) / m);
            }
            slope = n * (x * here - below) / (x * x - 1.0);
            let change = here / slope;
            x -= change;
            if change.abs() < 1e-15 {
                break;
            }
        }
        (x, 2.0 / ((1.0 - x * x) * slope * slope))
    })
}

/// Legendre polynomials at x, by degree, N of them.
pub(crate) fn legendre<const N: usize>(x: f64) -> [f64; N] {
    let mut all = [1.0; N];
    all[1] = x;
    for n in 2..N {
        let m = n as f64;
        all[n] = ((2.0 * m - 1.0) * x * all[n - 1] - (m - 1.0) * all[n - 2]) / m;
    }
    all
}

/// The 15 ascending nodes of the Kronrod rule on [-1, 1] and their weights, for rules built by hand.
pub(crate) fn kronrod() -> [(f64, f64); 15] {
    std::array::from_fn(|k| match k {
        0..=7 => (-NODES[k], KRONROD[k]),
        _ => (NODES[14 - k], KRONROD[14 - k]),
    })
}

/// Integral of `f` over the intervals between neighbouring `breaks` (ascending), bisected where the
/// Gauss and Kronrod rules differ most, until their difference is below `relative` times the
/// integral of `|f|` or bisection brings nothing more. Put kinks of `f` among the breaks: the rule has degree 23 only
/// between them.
///
/// The error adds the difference of the two rules over all intervals (a bound far above the true
/// error of the Kronrod value where `f` is smooth) and the rounding of the sum.
pub fn integrate(f: impl Fn(f64) -> f64, breaks: &[f64], relative: f64) -> Estimate {
    /// Bisections beyond which the tolerance is not to be had; the error then says so.
    const LIMIT: usize = 4000;
    /// Bisections that brought nothing: f itself is not known any better.
    const VAIN: usize = 10;
    // No sum is better known than its rounding.
    const ROUNDING: f64 = 16.0 * f64::EPSILON;
    let mut parts: Vec<(f64, f64, (f64, f64, f64))> = breaks
        .windows(2)
        .map(|w| (w[0], w[1], rule(&f, w[0], w[1])))
        .collect();
    let mut vain = 0;
    loop {
        let value: f64 = parts.iter().map(|p| p.2.0).sum();
        let error: f64 = parts.iter().map(|p| p.2.1).sum();
        let absolute: f64 = parts.iter().map(|p| p.2.2).sum();
        let worst = (0..parts.len()).max_by(|&i, &j| parts[i].2.1.total_cmp(&parts[j].2.1));
        let known = error <= relative.max(ROUNDING) * absolute;
        let done = known || !error.is_finite() || parts.len() > LIMIT || vain == VAIN;
        match worst {
            Some(k) if !done => {
                let (a, b, whole) = parts[k];
                let middle = 0.5 * (a + b);
                let [left, right] = [rule(&f, a, middle), rule(&f, middle, b)];
                let same = (left.0 + right.0 - whole.0).abs() <= 1e-5 * whole.2;
                vain += usize::from(same && left.1 + right.1 > 0.99 * whole.1);
                parts[k] = (a, middle, left);
                parts.push((middle, b, right));
            }
            _ => {
                return Estimate::new(value, error + ROUNDING * absolute, Origin::Quadrature);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_panel_rule_is_exact_to_degree_23() {
        for n in 0..=23 {
            let exact = (2f64.powi(n + 1) - (-1f64).powi(n + 1)) / f64::from(n + 1);
            let got = rule(&|x: f64| x.powi(n), -1.0, 2.0).0;
            assert!(
                (got - exact).abs() <= 1e-13 * exact.abs().max(1.0),
                "degree {n}: {got} {exact}"
            );
        }
        let exact = (2f64.powi(25) + 1.0) / 25.0;
        assert!((rule(&|x: f64| x.powi(24), -1.0, 2.0).0 - exact).abs() > 1e-15 * exact);
    }

    #[test]
    fn gauss_points_integrate_polynomials_exactly() {
        let rule = gauss::<9>();
        for n in 0..18 {
            let sum: f64 = rule.iter().map(|(x, w)| w * x.powi(n)).sum();
            let even = if n % 2 == 0 { 2.0 } else { 0.0 };
            let exact = even / f64::from(n + 1);
            assert!((sum - exact).abs() < 1e-13, "{n}: {sum} {exact}");
        }
        let degree_18: f64 = rule.iter().map(|(x, w)| w * x.powi(18)).sum();
        assert!((degree_18 - 2.0 / 19.0).abs() > 1e-8);
    }

    #[test]
    fn the_error_estimate_covers_a_square_root_singularity() {
        let got = integrate(f64::sqrt, &[0.0, 1.0], 1e-13);
        let error = (got.value - 2.0 / 3.0).abs();
        println!("{got}, true error {error:.1e}");
        assert!(error <= got.error && got.error < 1e-12);
    }

    #[test]
    fn an_integral_that_does_not_converge_ends_and_says_so() {
        let got = integrate(|x| (1.0 / x).sin() / x, &[1e-9, 1.0], 1e-13);
        assert!(got.error > 1e-6, "{got}");
    }
}
