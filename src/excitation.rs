//! What shakes the oscillator beside stationary noise: a harmonic drive, and an envelope on the noise.

use crate::error::{Error, Result, finite};
use std::f64::consts::TAU;

/// The force a cos(W t + phase), in static loads; t and 1/W in dimensionless time.
///
/// ```
/// use vibroimpact::excitation::Drive;
/// let drive = Drive::new(0.02, 0.95, 0.0)?;
/// assert_eq!(drive.force(0.0), 0.02);
/// assert!((drive.period() - 6.614).abs() < 1e-3);
/// # Ok::<(), vibroimpact::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Drive {
    amplitude: f64,
    frequency: f64,
    phase: f64,
}

impl Drive {
    /// Circular frequencies accepted: the contact resonates at 1.
    pub const FREQUENCIES: [f64; 2] = [1e-3, 20.0];

    /// A drive of `amplitude` >= 0 (static loads), circular `frequency` and `phase` (radians).
    ///
    /// # Errors
    /// [`Error::Invalid`] for an amplitude that is negative, a frequency outside [`Drive::FREQUENCIES`], or a number
    /// that is not finite.
    pub fn new(amplitude: f64, frequency: f64, phase: f64) -> Result<Self> {
        if !(amplitude.is_finite() && amplitude >= 0.0) {
            let key = "excitation.drive.amplitude";
            return Err(Error::invalid(key, amplitude, "a finite number >= 0"));
        }
        let [low, high] = Self::FREQUENCIES;
        if !(low..=high).contains(&frequency) {
            let accepted =
                format!("a circular frequency from {low} to {high}; the contact resonates at 1");
            let key = "excitation.drive.frequency";
            return Err(Error::invalid(key, frequency, accepted));
        }
        finite("excitation.drive.phase", phase)?;
        Ok(Self {
            amplitude,
            frequency,
            phase,
        })
    }

    /// a, in static loads.
    pub fn amplitude(&self) -> f64 {
        self.amplitude
    }

    /// W, a circular frequency.
    pub fn frequency(&self) -> f64 {
        self.frequency
    }

    /// The phase at t = 0, in radians.
    pub fn phase(&self) -> f64 {
        self.phase
    }

    /// 2 pi/W.
    pub fn period(&self) -> f64 {
        TAU / self.frequency
    }

    /// The force at time t.
    pub fn force(&self, t: f64) -> f64 {
        self.amplitude * (self.frequency * t + self.phase).cos()
    }

    /// The rate at which the force changes at time t.
    pub(crate) fn rate(&self, t: f64) -> f64 {
        -self.amplitude * self.frequency * (self.frequency * t + self.phase).sin()
    }

    /// The same drive with its origin of time where its phase is 0.
    pub(crate) fn undelayed(&self) -> Self {
        Self {
            phase: 0.0,
            ..*self
        }
    }

    /// The time, within a period, at which that drive has the phase of this one at t = 0.
    pub(crate) fn delay(&self) -> f64 {
        self.phase.rem_euclid(TAU) / self.frequency
    }

    /// The same drive at another frequency.
    ///
    /// # Errors
    /// Those of [`Drive::new`].
    pub fn at(&self, frequency: f64) -> Result<Self> {
        Self::new(self.amplitude, frequency, self.phase)
    }
}

/// A factor on the noise level h, piecewise linear in time: constant before its first time and after its last.
///
/// ```
/// use vibroimpact::excitation::Envelope;
/// let rise = Envelope::new(vec![0.0, 50.0], vec![0.0, 1.0])?;
/// assert_eq!([rise.factor(25.0), rise.factor(70.0)], [0.5, 1.0]);
/// # Ok::<(), vibroimpact::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Envelope {
    times: Vec<f64>,
    factors: Vec<f64>,
}

impl Envelope {
    /// Most times accepted: each ends a step.
    const MOST: usize = 1000;

    /// Factors >= 0 at ascending times >= 0, not all of them 0.
    ///
    /// # Errors
    /// [`Error::Invalid`] for anything else.
    pub fn new(times: Vec<f64>, factors: Vec<f64>) -> Result<Self> {
        let key = |name: &str| format!("excitation.envelope.{name}");
        if times.is_empty() || times.len() > Self::MOST {
            let value = format!("a list of {} times", times.len());
            let accepted = format!("1 to {} times", Self::MOST);
            return Err(Error::invalid(key("times"), value, accepted));
        }
        if factors.len() != times.len() {
            let value = format!("a list of {} factors", factors.len());
            let accepted = format!("as many as excitation.envelope.times: {}", times.len());
            return Err(Error::invalid(key("factors"), value, accepted));
        }
        for (k, t) in times.iter().enumerate() {
            let item = || key(&format!("times[{k}]"));
            if !(t.is_finite() && *t >= 0.0) {
                return Err(Error::invalid(item(), t, "a finite time >= 0"));
            }
            if k > 0 && *t <= times[k - 1] {
                let accepted = format!("ascending times; the one before is {}", times[k - 1]);
                return Err(Error::invalid(item(), t, accepted));
            }
        }
        for (k, factor) in factors.iter().enumerate() {
            if !(factor.is_finite() && *factor >= 0.0) {
                let item = key(&format!("factors[{k}]"));
                return Err(Error::invalid(item, factor, "a finite factor >= 0"));
            }
        }
        if factors.iter().all(|factor| *factor == 0.0) {
            let accepted = "at least one factor > 0: without any noise there is no density";
            return Err(Error::invalid(key("factors"), "0 at all times", accepted));
        }
        Ok(Self { times, factors })
    }

    /// Where the factors are given.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// The same at other times, in the same order.
    pub(crate) fn retimed(&self, time: impl Fn(f64) -> f64) -> Self {
        Self {
            times: self.times.iter().map(|t| time(*t)).collect(),
            factors: self.factors.clone(),
        }
    }

    /// The factors there.
    pub fn factors(&self) -> &[f64] {
        &self.factors
    }

    /// The factor on h at time t.
    pub fn factor(&self, t: f64) -> f64 {
        let after = self.times.partition_point(|it| *it <= t);
        if after == 0 || after == self.times.len() {
            return self.factors[after.saturating_sub(1)];
        }
        let [(low, from), (high, to)] = self.ends(after);
        from + (t - low) / (high - low) * (to - from)
    }

    /// Times and factors where a piece begins and ends, at this place of the times.
    fn ends(&self, after: usize) -> [(f64, f64); 2] {
        [after - 1, after].map(|k| (self.times[k], self.factors[k]))
    }

    /// The rate at which the factor changes at time t; between its times, since it bends there.
    pub(crate) fn rate(&self, t: f64) -> f64 {
        let after = self.times.partition_point(|it| *it <= t);
        if after == 0 || after == self.times.len() {
            return 0.0;
        }
        let [(low, from), (high, to)] = self.ends(after);
        (to - from) / (high - low)
    }
}

/// Drive and envelope; neither is the stationary noise alone.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize)]
pub struct Excitation {
    /// + a cos(W t + phase) on the right-hand side.
    pub drive: Option<Drive>,
    /// h times this.
    pub envelope: Option<Envelope>,
}

impl Excitation {
    /// Whether it is the stationary noise alone: no drive or one of amplitude 0, no envelope or one that is 1 throughout.
    pub fn is_plain(&self) -> bool {
        let still = |drive: &Drive| drive.amplitude == 0.0;
        let even = |envelope: &Envelope| envelope.factors.iter().all(|factor| *factor == 1.0);
        self.drive.as_ref().is_none_or(still) && self.envelope.as_ref().is_none_or(even)
    }

    /// The force of the drive at time t.
    pub(crate) fn force(&self, t: f64) -> f64 {
        self.drive.map_or(0.0, |it| it.force(t))
    }

    /// The amplitude of the drive.
    pub(crate) fn push(&self) -> f64 {
        self.drive.map_or(0.0, |it| it.amplitude)
    }

    /// The rate at which it changes.
    pub(crate) fn rate(&self, t: f64) -> f64 {
        self.drive.map_or(0.0, |it| it.rate(t))
    }

    /// The factor on h at time t.
    pub(crate) fn factor(&self, t: f64) -> f64 {
        self.envelope.as_ref().map_or(1.0, |it| it.factor(t))
    }

    /// The rate at which that changes.
    pub(crate) fn factor_rate(&self, t: f64) -> f64 {
        self.envelope.as_ref().map_or(0.0, |it| it.rate(t))
    }

    /// The times between a and b at which the envelope bends: no step goes across one.
    pub(crate) fn bends(&self, a: f64, b: f64) -> impl Iterator<Item = f64> + '_ {
        let times = self.envelope.as_ref().map_or(&[][..], Envelope::times);
        let within = move |t: &f64| *t > a * (1.0 + 1e-12) && *t < b * (1.0 - 1e-12);
        times.iter().copied().filter(within)
    }

    /// The factor where the envelope bends up to time t, and at both ends.
    fn factors(&self, t: f64) -> impl Iterator<Item = f64> + '_ {
        let times = self.bends(0.0, t).chain([0.0, t]);
        times.map(|t| self.factor(t))
    }

    /// The largest factor up to time t.
    pub(crate) fn highest_factor(&self, t: f64) -> f64 {
        self.factors(t).fold(0.0, f64::max)
    }

    /// The least deviation of the noise up to time t over the largest.
    pub(crate) fn faded(&self, t: f64) -> f64 {
        let least = self.factors(t).fold(f64::INFINITY, f64::min);
        match self.highest_factor(t) {
            0.0 => 1.0,
            most => (least / most).sqrt(),
        }
    }

    /// When the noise begins: 0 unless the envelope is 0 at first.
    pub(crate) fn noise_from(&self) -> f64 {
        let Some(it) = &self.envelope else {
            return 0.0;
        };
        let first = it.factors.iter().position(|factor| *factor > 0.0);
        match first {
            Some(k) if k > 0 => it.times[k - 1],
            _ => 0.0,
        }
    }

    /// The lowest temperature that the mean energy falls back to between two times, over that of the undriven oscillator
    /// under the factor `from`, which it has at 0: dT/dt = -2 zeta (T - factor), exact where friction is weak and no
    /// more than a guess elsewhere.
    pub(crate) fn coldest(&self, zeta: f64, from: f64, [first, last]: [f64; 2]) -> f64 {
        const PARTS: usize = 32;
        let (mut now, mut level, mut lowest) = (0.0, from, f64::INFINITY);
        let ends = self.bends(0.0, first).chain([first]);
        for end in ends.chain(self.bends(first, last)).chain([last]) {
            if now >= first {
                lowest = lowest.min(level);
            }
            let step = (end - now) / PARTS as f64;
            for k in 0..PARTS {
                let factor = self.factor(now + (k as f64 + 0.5) * step);
                level = factor + (level - factor) * (-2.0 * zeta * step).exp();
                if now >= first {
                    lowest = lowest.min(level);
                }
            }
            now = end;
        }
        lowest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_envelope_is_linear_between_its_times_and_constant_outside() {
        let it = Envelope::new(vec![1.0, 3.0, 4.0], vec![0.5, 1.5, 0.0]).unwrap();
        for (t, factor) in [(0.0, 0.5), (1.0, 0.5), (2.0, 1.0), (3.0, 1.5), (3.5, 0.75)] {
            assert!((it.factor(t) - factor).abs() < 1e-15, "{t}");
        }
        assert_eq!([it.factor(4.0), it.factor(9.0)], [0.0, 0.0]);
        let it = Excitation {
            drive: None,
            envelope: Some(it),
        };
        assert_eq!(it.bends(0.0, 3.5).collect::<Vec<_>>(), [1.0, 3.0]);
        assert_eq!(it.highest_factor(2.0), 1.0);
        assert_eq!(it.highest_factor(9.0), 1.5);
        // Long after its end nothing is left of the noise.
        assert!(it.coldest(0.005, 1.5, [0.0, 1004.0]) < 1e-3);
        // From 1.5 to 0 within the last unit, and long before it.
        let [before, after] = [[2.9, 3.0], [3.0, 4.0]].map(|between| it.coldest(5.0, 1.5, between));
        assert!(
            (1.2..1.5).contains(&before) && after < 0.2,
            "{before}, {after}"
        );
        let late = Envelope::new(vec![5.0, 6.0], vec![0.0, 1.0]).unwrap();
        let late = Excitation {
            drive: None,
            envelope: Some(late),
        };
        assert_eq!(late.noise_from(), 5.0);
    }

    #[test]
    fn what_changes_nothing_is_plain_and_what_makes_no_sense_is_refused_by_name() {
        let none = Drive::new(0.0, 1.0, 0.3).unwrap();
        let even = Envelope::new(vec![0.0, 2.0], vec![1.0, 1.0]).unwrap();
        let it = Excitation {
            drive: Some(none),
            envelope: Some(even),
        };
        assert!(it.is_plain() && Excitation::default().is_plain());
        for (drive, key) in [
            (Drive::new(-0.1, 1.0, 0.0), "drive.amplitude"),
            (Drive::new(f64::NAN, 1.0, 0.0), "drive.amplitude"),
            (Drive::new(0.1, 0.0, 0.0), "drive.frequency"),
            (Drive::new(0.1, -1.0, 0.0), "drive.frequency"),
            (Drive::new(0.1, 1e3, 0.0), "drive.frequency"),
            (Drive::new(0.1, 1.0, f64::INFINITY), "drive.phase"),
        ] {
            let message = drive.unwrap_err().to_string();
            assert!(message.contains(key), "{message}");
        }
        for (times, factors, key) in [
            (vec![], vec![], "envelope.times"),
            (vec![0.0, 1.0], vec![1.0], "envelope.factors"),
            (vec![1.0, 0.5], vec![1.0, 1.0], "envelope.times[1]"),
            (vec![-1.0], vec![1.0], "envelope.times[0]"),
            (vec![0.0, 1.0], vec![1.0, -1.0], "envelope.factors[1]"),
            (vec![0.0, 1.0], vec![0.0, 0.0], "envelope.factors"),
        ] {
            let message = Envelope::new(times, factors).unwrap_err().to_string();
            assert!(message.contains(key), "{message}");
        }
    }
}
