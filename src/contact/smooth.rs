//! Where a force is not smooth, found by looking closer and closer.

/// What a force does between two points beside being smooth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Break {
    /// Its derivative jumps here.
    Kink(f64),
    /// It jumps here itself.
    Jump(f64),
}

/// How often the stretch is halved: the slopes of the two halves of a smooth one then differ a thousand times less.
const HALVINGS: u32 = 10;

/// What is left at least of the largest difference of slopes where there is a kink.
const LEFT: f64 = 0.1;

/// A change of slope that shows at least, over the slope.
const OF_SLOPE: f64 = 1e-3;

/// A change of force over half the last stretch that is no noise of a law found by numbers, over that force and 1.
const NOISE: f64 = 1e-8;

/// Between a and b the stretch about which the slope changes most is followed.
pub(super) fn broken(force: impl Fn(f64) -> f64, [a, b]: [f64; 2]) -> Option<Break> {
    let slopes = |from: f64, length: f64| {
        let [x, y, z] = [0.0, 0.5, 1.0].map(|part| force(from + part * length));
        [y - x, z - y].map(|rise| rise / (0.5 * length))
    };
    let change = |[left, right]: [f64; 2]| (right - left).abs();
    let (mut from, mut length) = (a, b - a);
    let first = change(slopes(from, length));
    let mut largest = first;
    for _ in 0..HALVINGS {
        length *= 0.5;
        let parts = [0.0, 0.5, 1.0].map(|part| from + part * length);
        let most = |x: &&f64, y: &&f64| {
            change(slopes(**x, length)).total_cmp(&change(slopes(**y, length)))
        };
        from = parts.iter().max_by(most).copied().unwrap_or(from);
        largest = largest.max(change(slopes(from, length)));
    }
    let [left, right] = slopes(from, length);
    let last = change([left, right]);
    let at = from + 0.5 * length;
    let steep = left.abs().max(right.abs());
    let noise = NOISE * force(at).abs().max(1.0) / (0.5 * length);
    if last <= noise.max(OF_SLOPE * steep).max(LEFT * largest) {
        return None;
    }
    let jumps = last > LEFT * 2f64.powi(HALVINGS as i32) * first;
    Some(if jumps {
        Break::Jump(at)
    } else {
        Break::Kink(at)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kink_and_a_jump_are_found_and_what_is_smooth_is_left_alone() {
        let kink = |q: f64| q + 50.0 * (q - 1.003).max(0.0);
        match broken(kink, [0.99, 1.02]) {
            Some(Break::Kink(q)) => assert!((q - 1.003).abs() < 1e-4, "{q}"),
            other => panic!("{other:?}"),
        }
        let jump = |q: f64| if q > 0.5 { q + 1.0 } else { q };
        match broken(jump, [0.49, 0.512]) {
            Some(Break::Jump(q)) => assert!((q - 0.5).abs() < 1e-4, "{q}"),
            other => panic!("{other:?}"),
        }
        let cubic = |q: f64| q + 0.3 * q.powi(3);
        let rounded = |q: f64| 0.1 * (10.0 * (1.0 + q)).exp().ln_1p() - 1.0;
        let steep = |q: f64| (1.0 + 0.1 * q).max(0.0).powi(10) - 1.0;
        let noisy = |q: f64| q.atan() + 1e-9 * (1e7 * q).sin();
        let all = [
            f64::sinh,
            f64::atan,
            f64::tanh,
            cubic,
            rounded,
            steep,
            noisy,
            |_: f64| -1.0,
        ];
        for smooth in all {
            for a in [-30.0, -19.1, -9.7, -1.2, -0.01, 0.0, 2.0, 40.0] {
                assert_eq!(broken(smooth, [a, a + 0.02 * (1.0 + f64::abs(a))]), None);
            }
        }
    }
}
