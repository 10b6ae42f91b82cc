//! A minimum, a zero and a point of change of a function of one number.

use crate::error::Result;

/// A function whose value may not exist.
pub type Function<'a> = &'a dyn Fn(f64) -> Result<f64>;

/// The place of the least value of a function that has one minimum in [low, high], to `width`, by golden
/// sections: no nearer than the root of the rounding.
///
/// # Errors
/// Those of `f`.
pub fn golden(f: Function<'_>, mut low: f64, mut high: f64, width: f64) -> Result<f64> {
    let share = 0.5 * (5f64.sqrt() - 1.0);
    let mut inner = [high - share * (high - low), low + share * (high - low)];
    let mut at = [f(inner[0])?, f(inner[1])?];
    while high - low > width {
        if at[0] < at[1] {
            high = inner[1];
            inner = [high - share * (high - low), inner[0]];
            at = [f(inner[0])?, at[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + share * (high - low)];
            at = [at[1], f(inner[1])?];
        }
    }
    Ok(0.5 * (low + high))
}

/// The point between `before` and `after`, in either order, where `beyond` turns true, to the last bit that
/// helps.
pub(crate) fn bisect(mut before: f64, mut after: f64, beyond: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..200 {
        let middle = 0.5 * (before + after);
        if middle == before || middle == after {
            break;
        }
        if beyond(middle) {
            after = middle;
        } else {
            before = middle;
        }
    }
    0.5 * (before + after)
}

/// The zero of a rising function between `low` and `high`, from its value and its slope: Newton's steps from `start` until one
/// is no longer than `width`, halves of the bracket where they do not shrink.
#[inline]
pub(crate) fn rising(
    f: impl Fn(f64) -> (f64, f64),
    [mut low, mut high]: [f64; 2],
    start: f64,
    width: f64,
) -> f64 {
    let (mut x, mut before) = (start, high - low);
    for _ in 0..100 {
        let (value, slope) = f(x);
        if value < 0.0 {
            low = x;
        } else {
            high = x;
        }
        let next = x - value / slope;
        if (next - x).abs() <= width {
            return next;
        }
        // Far from the zero, on either side of a steep part, steps lead from one side to the other.
        let shrinks = next > low && next < high && (next - x).abs() <= 0.5 * before;
        let next = if shrinks { next } else { 0.5 * (low + high) };
        before = (next - x).abs();
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::rising;

    #[test]
    fn a_zero_on_a_steep_part_between_two_flat_ones_is_found_from_far() {
        for (steep, zero) in [(3.0, 0.0), (30.0, 0.01), (3e4, -0.3), (3e4, 7.0)] {
            let of = |x: f64| {
                let root = x.hypot(1.0);
                (x + steep * x / root, 1.0 + steep / root.powi(3))
            };
            let level = of(zero).0;
            let beyond = |x: f64| (of(x).0 - level, of(x).1);
            let bracket = [level - steep - 1.0, level + steep + 1.0];
            let found = rising(beyond, bracket, level, 1e-9);
            assert!(
                (found - zero).abs() < 1e-11 * (1.0 + steep),
                "{found} for {zero}"
            );
        }
    }
}
