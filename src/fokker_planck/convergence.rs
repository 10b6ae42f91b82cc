//! What a change leaves of an error, the same for everything that is computed at finer and finer resolutions of an operator.

use super::policy::{CARRIED, LEFT, SLOWEST};

/// Fall of the changes where only one is known.
pub(super) const UNKNOWN: f64 = 0.5;

/// The error after a change, over that change, if changes go on falling by `fall` from one resolution to the next: what a
/// geometric series adds up to, with a margin, and a quarter of the change at least.
pub(super) fn left(fall: f64) -> f64 {
    let fall = fall.min(SLOWEST.get());
    LEFT.get() * (fall / (1.0 - fall)).max(CARRIED.get())
}

/// The error of a number after two changes, either of which may pass through zero.
pub(super) fn left_of([earlier, last]: [f64; 2]) -> f64 {
    let fall = if last < earlier { last / earlier } else { 1.0 };
    at_least(left(fall) * last, LEFT.get() * CARRIED.get() * earlier)
}

/// The same of a number of a curve, each change the largest near it: that passes through zero no more, but may be small by chance.
pub(super) fn left_nearby([earlier, last]: [f64; 2]) -> f64 {
    left((last / earlier).min(1.0)) * at_least(last, CARRIED.get() * earlier)
}

/// A change, or what it is taken for at least; NaN, which is none, stays.
pub(super) fn at_least(change: f64, least: f64) -> f64 {
    if change < least { least } else { change }
}

#[cfg(test)]
mod tests {
    use super::{left, left_nearby, left_of};

    #[test]
    fn the_rest_of_a_geometric_series_is_within_the_estimate() {
        for fall in [0.01, 0.1, 0.3, 0.5, 0.7] {
            let changes = [1.0, fall];
            let rest = fall * fall / (1.0 - fall);
            assert!(left(fall) * fall >= 1.9 * rest, "{fall}");
            let error = left_of(changes);
            assert!(
                error >= 1.9 * rest && error < 6.0 * fall.max(0.1),
                "{fall}: {error}"
            );
        }
    }

    #[test]
    fn a_small_change_of_a_curve_is_a_quarter_of_the_one_before() {
        assert!(left_nearby([1.0, 0.0]) >= 0.1);
        assert!(left_nearby([1.0, 0.1]) >= 0.1 && left_nearby([1.0, 0.1]) < 0.2);
        assert!(left_nearby([1.0, 0.8]) > 4.0 * 0.8);
        assert_eq!(left_nearby([0.0, 0.0]), 0.0);
    }

    #[test]
    fn a_change_that_passes_through_zero_is_not_believed() {
        assert!(left_of([1e-3, 0.0]) > 4e-4);
        assert!(left_of([0.0, 1e-3]) > 1e-3);
        assert_eq!(left_of([0.0, 0.0]), 0.0);
        assert!(left_of([1.0, f64::NAN]).is_nan());
    }
}
