//! Harmonics of a curve over the phase.

use crate::estimate::{Estimate, Origin};
use serde::Serialize;
use std::f64::consts::TAU;

/// amplitude cos(k W t + phase).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Harmonic {
    /// Half of the distance from peak to peak.
    pub amplitude: Estimate,
    /// In radians, from -pi to pi; NaN without an amplitude that is known.
    pub phase: Estimate,
}

impl Harmonic {
    /// Harmonics 1 to `count` of a curve at equally spaced phases from 0 on, as many as every second of them shows. None of a
    /// curve that is not known.
    ///
    /// The error is the largest k-th coefficient of any curve within the errors of the points ([`at_most`]), and what the curve has of
    /// harmonics that its points take for this one ([`between`]).
    pub(super) fn of(curve: &[Estimate], count: usize) -> Vec<Self> {
        let count = count.min(curve.len().saturating_sub(1) / 4);
        (1..=count).map(|k| Self::number(curve, k)).collect()
    }

    fn number(curve: &[Estimate], k: usize) -> Self {
        let [cosine, sine] = coefficient(curve.iter(), k);
        let [c, s] = coefficient(curve.iter().step_by(2), k);
        let aliased = between(curve, (cosine - c).hypot(sine - s));
        let error = at_most(curve, k) + aliased;
        let largest = curve.iter().max_by(|a, b| a.error.total_cmp(&b.error));
        let origin = largest.map_or(Origin::default(), |it| it.origin);
        let amplitude = cosine.hypot(sine);
        let phase = if amplitude > error {
            Estimate::new((-sine).atan2(cosine), (error / amplitude).asin(), origin)
        } else {
            Estimate::new(f64::NAN, f64::NAN, origin)
        };
        Self {
            amplitude: Estimate::new(amplitude, error, origin),
            phase,
        }
    }
}

/// Parts of cos and -sin in a harmonic of equally spaced points.
fn coefficient<'a>(curve: impl ExactSizeIterator<Item = &'a Estimate>, k: usize) -> [f64; 2] {
    let n = curve.len();
    let (mut cosine, mut sine) = (0.0, 0.0);
    for (j, point) in curve.enumerate() {
        let angle = TAU * (k * j % n) as f64 / n as f64;
        cosine += point.value * angle.cos() * 2.0 / n as f64;
        sine += point.value * angle.sin() * 2.0 / n as f64;
    }
    [cosine, sine]
}

/// The largest coefficient of what is nowhere above the errors of a curve: 4/pi of a constant one, twice the mean at most. Its phase is
/// looked for at as many places as there are points.
fn at_most(curve: &[Estimate], k: usize) -> f64 {
    let n = curve.len();
    let towards = |m: usize| -> f64 {
        let part = |(j, point): (usize, &Estimate)| {
            // Halves of an angle between two points.
            let halves = (2 * (k * j % n) + m) as f64;
            point.error * (0.5 * TAU * halves / n as f64).cos().abs()
        };
        curve.iter().enumerate().map(part).sum()
    };
    (0..n).map(towards).fold(0.0, f64::max) * 2.0 / n as f64
}

/// Part of what every second point says otherwise that all of them may be off by: harmonics fall.
const BETWEEN: f64 = 0.25;

/// What a curve may do between its points, if so much is what every second of them says otherwise. Those of an odd number are not
/// equally spaced, and say nothing: there are as many then as leave nothing between.
fn between(curve: &[Estimate], apart: f64) -> f64 {
    if curve.len().is_multiple_of(2) {
        BETWEEN * apart
    } else {
        0.0
    }
}

/// The mean of a curve over the phase.
pub(super) fn mean(curve: &[Estimate]) -> Estimate {
    let n = curve.len() as f64;
    let origin = curve.iter().max_by(|a, b| a.error.total_cmp(&b.error));
    let origin = origin.map_or(Origin::default(), |it| it.origin);
    let value = curve.iter().map(|it| it.value).sum::<f64>() / n;
    let error = curve.iter().map(|it| it.error).sum::<f64>() / n;
    let second = curve.iter().step_by(2);
    let apart = value - second.clone().map(|it| it.value).sum::<f64>() / second.len() as f64;
    Estimate::new(value, error + between(curve, apart.abs()), origin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_4;

    #[test]
    fn the_harmonics_of_a_known_curve_come_back() {
        let at = |k: u32| {
            let t = TAU * f64::from(k) / 16.0;
            let value = 0.3 + 2.0 * (t + 0.7).cos() + 0.05 * (3.0 * t - 1.0).cos();
            Estimate::new(value, 1e-3, Origin::Space)
        };
        let curve: Vec<Estimate> = (0..16).map(at).collect();
        let found = Harmonic::of(&curve, 4);
        assert!((found[0].amplitude.value - 2.0).abs() < 1e-14);
        assert!((found[0].phase.value - 0.7).abs() < 1e-14);
        assert!((found[2].amplitude.value - 0.05).abs() < 1e-14);
        assert!((found[2].phase.value + 1.0).abs() < 1e-13);
        assert!(found[1].amplitude.value < 1e-14 && found[1].phase.value.is_nan());
        assert!((found[0].amplitude.error / 1e-3 * FRAC_PI_4 - 1.0).abs() < 0.01);
        assert!((mean(&curve).value - 0.3).abs() < 1e-14);
        // No more than every second point can tell apart.
        assert_eq!(Harmonic::of(&curve[..8], 4).len(), 1);
    }

    #[test]
    fn what_points_take_for_a_lower_harmonic_is_in_its_error() {
        // The 63rd looks like the first at 64 points, and so does the 31st at every second of them.
        let at = |k: u32| {
            let t = TAU * f64::from(k) / 64.0;
            let value = t.cos() + 0.01 * (31.0 * t).cos() + 0.0025 * (63.0 * t).cos();
            Estimate::new(value, 0.0, Origin::Space)
        };
        let curve: Vec<Estimate> = (0..64).map(at).collect();
        let first = Harmonic::of(&curve, 4)[0].amplitude;
        let off = (first.value - 1.0).abs();
        assert!((off - 0.0025).abs() < 1e-12, "{off}");
        assert!(off <= first.error * (1.0 + 1e-9) && first.error < 1.01 * off);
    }
}
