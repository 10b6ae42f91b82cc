//! What the first step does not see of a first passage.

use crate::gaussian::lower;
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use std::f64::consts::TAU;

/// How probable it is, at most, that noise decides within the first step whether a motion leaves a range of q: a step that
/// gathers noise tells nothing of it. After a time s the mean motion is at a distance d from the nearer end, and q has the variance
/// S^2 = deviation_q^2 + (s deviation_v)^2 + N^2, of which N^2 = 2 pi h s^3/3 is that of the noise: the largest
/// 2 Phi(-|d|/S) (N/S)^4 of all s, unless the motion leaves farther than that. In a wide law noise takes as much out as in
/// but for (N/S)^2, of which runs with other steps tell the first part; the stationary one is wide beside any of it.
pub(crate) fn undecided(
    initial: &Initial,
    oscillator: &Oscillator,
    range: [f64; 2],
    step: f64,
) -> f64 {
    /// Times within a step, each a root of 2 after the one before.
    const TIMES: i32 = 40;
    let Some([mean, deviation]) = initial.mean_and_deviation() else {
        return 0.0;
    };
    let force = oscillator.contact().force(mean[0]);
    let decided = |s: f64| {
        let q = mean[0] + s * (mean[1] - 0.5 * s * force);
        let own = deviation[0].powi(2) + (s * deviation[1]).powi(2);
        let noise = TAU * oscillator.h() * s.powi(3) / 3.0;
        let inside = (q - range[0]).min(range[1] - q);
        let variance = own + noise;
        (inside / variance.sqrt(), noise / variance)
    };
    let times = (1 - TIMES..=0).map(|k| step * 2f64.powf(0.5 * f64::from(k)));
    let times: Vec<(f64, f64)> = times.map(decided).collect();
    let out = times.iter().map(|it| -it.0).fold(0.0, f64::max);
    let each = times.iter();
    let each = each.map(|(far, noise)| 2.0 * lower(-far.abs().max(out)) * noise * noise);
    each.fold(0.0, f64::max)
}

/// A step, halved up to so many times while more than is `allowed` of it is `undecided`.
pub(crate) fn halved(
    step: f64,
    undecided: impl Fn(f64) -> f64,
    (allowed, times): (f64, u32),
) -> f64 {
    let halve = |step, _| {
        if undecided(step) > allowed {
            0.5 * step
        } else {
            step
        }
    };
    (0..times).fold(step, halve)
}

#[cfg(test)]
mod tests {
    use super::undecided;
    use crate::contact::ContactLaw;
    use crate::initial::Initial;
    use crate::oscillator::Oscillator;

    #[test]
    fn only_what_is_narrow_and_near_is_left_to_the_noise_of_a_step() {
        let it = Oscillator::new(ContactLaw::Linear, 0.05, 0.02).unwrap();
        let up_to = |level: f64| [f64::NEG_INFINITY, level];
        let about = |q: f64, v: f64, deviation: f64| Initial::Gaussian {
            mean: [q, v],
            deviation: [deviation; 2],
        };
        let of =
            |initial: Initial, level: f64, step: f64| undecided(&initial, &it, up_to(level), step);
        // At the turning point: all but what the force pulls away before noise is there.
        assert!(of(about(1.0, 0.0, 1e-3), 1.0, 0.5) > 0.3);
        // With steps it falls as their sixth power.
        let [long, short] = [0.01, 0.005].map(|step| of(about(1.0, 0.0, 0.01), 1.0, step));
        assert!((long / short / 64.0 - 1.0).abs() < 0.05, "{long} {short}");
        // Far from the level, wide, or on the way through it.
        for (initial, level) in [
            (Initial::Rest, 1.0),
            (about(1.0, 0.0, 0.5), 1.0),
            (about(0.95, 2.0, 1e-3), 1.0),
            (about(3.0, 0.0, 1e-3), 1.0),
            (Initial::Stationary, 0.0),
        ] {
            let left = of(initial, level, 0.25);
            assert!(left < 1e-4, "{initial:?}: {left}");
        }
    }
}
