//! Numbers in the limit of short steps, and what they err: from runs with one, twice and four times the step, and on a
//! coarser mesh.

use super::run::Run;
use crate::estimate::Estimate;
use crate::fokker_planck::policy::{CARRIED, LEFT, SLOWEST};

/// Of the difference from the coarse mesh, of 1.35 times fewer nodes, what the fine run errs: what order 3 would leave. Seen: 5.
const OF_MESH: f64 = 0.7;

/// A number in the limit of short steps, and what it errs, from runs with one, twice and four times the step. A passage missed
/// between two kicks of the noise, near v = 0, shifts the level by sqrt(h) tau^(3/2): the error is a tau^(3/2) + b tau^2, the
/// latter that of the splitting, and the two have opposite signs where friction is not weak. Both are removed (Richardson).
/// The error is a margin on what the second part changes in the extrapolation of the first, more by what would follow it, and a
/// quarter of the whole change at least. Steps too long to be `resolved`, that do not see noise turn a motion back, miss what
/// they miss whatever their length: all that the step changed and the extrapolation would is left.
fn extrapolated([one, two, four]: [f64; 3], resolved: bool) -> [f64; 2] {
    let ratio = 2f64.powf(1.5);
    let (near, far) = (one - two, two - four);
    // What a and b change from twice the step to it.
    let missed = (4.0 * near - far) / (4.0 - ratio);
    let split = (far - ratio * near) / (4.0 - ratio);
    let change = missed / (ratio - 1.0) + split / 3.0;
    if !change.is_finite() {
        return [one, 0.0 * change];
    }
    let second = (split * (1.0 / (ratio - 1.0) - 1.0 / 3.0)).abs();
    // What further terms leave, if they go on falling as the second does to the first; no more than both.
    let falls = (split / missed).abs().min(SLOWEST.get());
    let both = (missed / (ratio - 1.0)).abs() + (split / 3.0).abs();
    let left = (LEFT.get() * second / (1.0 - falls)).min(both);
    let error = if resolved {
        left.max(CARRIED.get() * change.abs())
    } else {
        near.abs() + both
    };
    [one + change, error]
}

/// The runs of one round.
pub(super) struct Runs<'a> {
    pub(super) fine: &'a Run,
    coarse: &'a Run,
    /// With twice and four times the step.
    two: &'a Run,
    four: Run,
    resolved: bool,
}

impl<'a> Runs<'a> {
    pub(super) fn new([fine, coarse, two, four]: [&'a Run; 4], resolved: bool) -> Self {
        Self {
            fine,
            coarse,
            two,
            four: four.at_times_of(two),
            resolved,
        }
    }

    fn extrapolated(&self, of: impl Fn(&Run) -> f64) -> [f64; 2] {
        extrapolated([self.fine, self.two, &self.four].map(of), self.resolved)
    }

    /// A number that goes as the exponential of the step, as a rate does or its inverse, and what mesh and steps err.
    pub(super) fn exponential(&self, of: impl Fn(&Run) -> f64) -> (f64, [f64; 2]) {
        let [mesh, linear] = self.errors(&of);
        let [value, error] = self.extrapolated(|run| of(run).ln());
        if value.is_finite() && error.is_finite() {
            return (value.exp(), [mesh, error * value.exp()]);
        }
        (self.value(&of), [mesh, linear])
    }

    /// A number in the limit of short steps.
    pub(super) fn value(&self, of: impl Fn(&Run) -> f64) -> f64 {
        self.extrapolated(of)[0]
    }

    /// What the mesh and the steps err.
    pub(super) fn errors(&self, of: impl Fn(&Run) -> f64) -> [f64; 2] {
        let mesh = OF_MESH * (of(self.fine) - of(self.coarse)).abs();
        [mesh, self.extrapolated(of)[1]]
    }

    /// Both together.
    pub(super) fn error(&self, of: impl Fn(&Run) -> f64) -> f64 {
        self.errors(of).iter().sum()
    }

    /// That of the number as the fine run has it: a density is of no order in the step where it begins.
    pub(super) fn error_of_fine(&self, of: impl Fn(&Run) -> f64) -> f64 {
        self.error(&of) + (self.value(&of) - of(self.fine)).abs()
    }
}

/// The largest of errors at the times within `ago` before the time k: a difference passes through zero.
pub(super) fn largest_since(
    times: &[f64],
    (k, ago): (usize, f64),
    error: impl Fn(usize) -> f64,
) -> f64 {
    let recent = (0..=k).rev();
    let recent = recent.take_while(|l| times[k] - times[*l] <= ago);
    let each = recent.map(error);
    each.fold(0.0, |a, b| if a.is_nan() || b < a { a } else { b })
}

/// Errors of probabilities in the order in which these fall: none is above what any before it may be, or below what one after it
/// is at least.
pub(super) fn never_rises(curve: Vec<&mut Estimate>) {
    let mut least = vec![0.0f64; curve.len() + 1];
    for (k, it) in curve.iter().enumerate().rev() {
        least[k] = least[k + 1].max(it.value - it.error);
    }
    let mut most = 1.0f64;
    for (it, least) in curve.into_iter().zip(least) {
        most = most.min(it.value + it.error);
        let bounds = (most - it.value).abs().max((it.value - least).abs());
        it.error = it.error.min(bounds);
    }
}

#[cfg(test)]
mod tests {
    use super::{extrapolated, never_rises};
    use crate::estimate::{Estimate, Origin};

    /// 7 and errors of some orders, with one, two and four steps.
    fn number(terms: &[(f64, f64)]) -> [f64; 3] {
        let error = |step: f64| {
            terms
                .iter()
                .map(|(a, order)| a * step.powf(*order))
                .sum::<f64>()
        };
        [1.0, 2.0, 4.0].map(|step| 7.0 + error(step))
    }

    #[test]
    fn steps_that_err_with_two_signs_are_extrapolated_to_none() {
        for (a, b) in [(1e-3, 0.0), (0.0, 1e-3), (-3e-3, 1e-3), (1e-3, 1e-3)] {
            let [value, error] = extrapolated(number(&[(a, 1.5), (b, 2.0)]), true);
            assert!((value - 7.0).abs() < 1e-14, "{a} {b}: {value}");
            assert!(error > 0.04 * (a + b).abs(), "{a} {b}: {error}");
        }
    }

    #[test]
    fn errors_of_other_orders_are_within_what_is_said_of_them() {
        for order in [1.0, 1.25, 1.75, 2.5, 3.0, 4.0] {
            let [value, error] = extrapolated(number(&[(1e-3, order)]), true);
            let over = (value - 7.0).abs() / error;
            println!("order {order}: {over:.2} of its error");
            assert!(over < 0.7, "order {order}: {over}");
        }
    }

    #[test]
    fn what_falls_is_known_from_both_sides() {
        let curve = [
            (1.0, 0.0),
            (0.5, 0.2),
            (0.6, 0.01),
            (2e-7, 1e-9),
            (1e-7, 1e-3),
        ];
        let mut curve = curve.map(|(value, error)| Estimate::new(value, error, Origin::Space));
        never_rises(curve.iter_mut().collect());
        let errors = curve.map(|it| it.error);
        let expected = [0.0, 0.2, 0.01, 1e-9, 1.01e-7];
        for (got, expected) in errors.into_iter().zip(expected) {
            assert!((got - expected).abs() < 1e-15, "{errors:?}");
        }
        // One that rises by more than it may err keeps its errors.
        let curve = [(0.5, 0.0), (0.6, 0.01), (0.7, 0.01)];
        let mut curve = curve.map(|(value, error)| Estimate::new(value, error, Origin::Space));
        never_rises(curve.iter_mut().collect());
        assert_eq!(curve.map(|it| it.error), [0.0, 0.01, 0.01]);
    }
}
