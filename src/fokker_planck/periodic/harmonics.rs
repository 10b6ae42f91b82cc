//! Harmonics of a curve over the phase.

use crate::estimate::{Estimate, Origin};
use serde::Serialize;
use std::f64::consts::{FRAC_2_PI, TAU};

/// amplitude cos(k W t + phase).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Harmonic {
    /// Half of the distance from peak to peak.
    pub amplitude: Estimate,
    /// In radians, from -pi to pi; NaN without an amplitude that is known.
    pub phase: Estimate,
}

impl Harmonic {
    /// Harmonics 1 to `count` of a curve at equally spaced phases from 0 on, at most as many as the curve shows.
    ///
    /// The k-th coefficient of an error that is nowhere above e is at most 4/pi of the mean of e.
    pub(super) fn of(curve: &[Estimate], count: usize) -> Vec<Self> {
        let n = curve.len();
        let count = count.min(n.saturating_sub(1) / 2);
        (1..=count).map(|k| Self::number(curve, k)).collect()
    }

    fn number(curve: &[Estimate], k: usize) -> Self {
        let n = curve.len() as f64;
        let (mut cosine, mut sine, mut error) = (0.0, 0.0, 0.0);
        let mut origin = (0.0, Origin::default());
        for (j, point) in curve.iter().enumerate() {
            let angle = TAU * (k * j % curve.len()) as f64 / n;
            cosine += point.value * angle.cos() * 2.0 / n;
            sine += point.value * angle.sin() * 2.0 / n;
            error += 2.0 * FRAC_2_PI * point.error / n;
            if point.error >= origin.0 {
                origin = (point.error, point.origin);
            }
        }
        let amplitude = cosine.hypot(sine);
        let phase = if amplitude > error {
            Estimate::new((-sine).atan2(cosine), (error / amplitude).asin(), origin.1)
        } else {
            Estimate::new(f64::NAN, f64::NAN, origin.1)
        };
        Self {
            amplitude: Estimate::new(amplitude, error, origin.1),
            phase,
        }
    }
}

/// The mean of a curve over the phase.
pub(super) fn mean(curve: &[Estimate]) -> Estimate {
    let n = curve.len() as f64;
    let origin = curve.iter().max_by(|a, b| a.error.total_cmp(&b.error));
    let origin = origin.map_or(Origin::default(), |it| it.origin);
    let value = curve.iter().map(|it| it.value).sum::<f64>() / n;
    let error = curve.iter().map(|it| it.error).sum::<f64>() / n;
    Estimate::new(value, error, origin)
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert!((found[0].amplitude.error / 1e-3 - 2.0 * FRAC_2_PI).abs() < 1e-12);
        assert!((mean(&curve).value - 0.3).abs() < 1e-14);
        // No more than the points can tell apart.
        assert_eq!(Harmonic::of(&curve[..4], 4).len(), 1);
    }
}
