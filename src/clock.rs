//! The unit of the times that a scene gives and its results state.

use crate::estimate::Estimate;
use crate::format::{num, rounded};
use crate::rig::Rig;
use std::f64::consts::TAU;

/// Units of time that a scene can choose, `outputs.time_unit`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TimeUnit {
    /// 1/Omega, (7).
    #[default]
    Dimensionless,
    /// 2 pi/Omega, a period of small vibrations.
    Period,
    /// Seconds on a rig.
    Second,
}

/// Names of [`TimeUnit`] in scenes.
#[cfg(feature = "toml")]
pub(crate) const TIME_UNITS: &[(&str, TimeUnit)] = &[
    ("dimensionless", TimeUnit::Dimensionless),
    ("period", TimeUnit::Period),
    ("s", TimeUnit::Second),
];

impl TimeUnit {
    /// The name used in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dimensionless => "dimensionless",
            Self::Period => "period",
            Self::Second => "s",
        }
    }

    /// A unit of the manual, "1/W" for a time or "W" for its inverse, in this unit of time; any other as it is.
    pub(crate) fn of(self, unit: &'static str) -> &'static str {
        match (self, unit) {
            (Self::Period, "1/W") => "2 pi/W",
            (Self::Period, "W") => "W/(2 pi)",
            (Self::Second, "1/W") => "s",
            (Self::Second, "W") => "1/s",
            _ => unit,
        }
    }

    /// The unit of that name in scenes.
    #[cfg(feature = "cli")]
    pub(crate) fn named(name: &str) -> Option<Self> {
        let it = TIME_UNITS.iter().find(|(it, _)| *it == name);
        it.map(|(_, unit)| *unit)
    }
}

/// Changes dimensionless times into a unit and back. Whatever has the dimension of a time or of its inverse follows:
/// steps, durations, rates, densities of a time. Velocities v = dq/dtau and circular frequencies omega stay in units
/// of Omega.
///
/// ```
/// use vibroimpact::clock::{Clock, TimeUnit};
/// use vibroimpact::rig::Rig;
/// let clock = Clock::new(TimeUnit::Second, Some(&Rig::default())).unwrap();
/// assert!((clock.dimensionless(1.0) - 1457.699).abs() < 1e-3); // 2 pi 232 Hz
/// assert_eq!(clock.time(clock.dimensionless(0.1)), 0.1);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    unit: TimeUnit,
    /// Dimensionless time of one unit.
    length: f64,
}

impl Default for Clock {
    fn default() -> Self {
        Self {
            unit: TimeUnit::Dimensionless,
            length: 1.0,
        }
    }
}

impl Clock {
    /// The clock of a unit; None for seconds without a rig.
    pub fn new(unit: TimeUnit, rig: Option<&Rig>) -> Option<Self> {
        let length = match unit {
            TimeUnit::Dimensionless => 1.0,
            TimeUnit::Period => TAU,
            TimeUnit::Second => rig?.time(1.0),
        };
        Some(Self { unit, length })
    }

    /// The unit.
    pub fn unit(&self) -> TimeUnit {
        self.unit
    }

    /// Whether times are dimensionless already.
    pub fn is_dimensionless(&self) -> bool {
        self.unit == TimeUnit::Dimensionless
    }

    /// The dimensionless time of a time in the unit.
    pub fn dimensionless(&self, time: f64) -> f64 {
        if self.is_dimensionless() {
            time
        } else {
            time * self.length
        }
    }

    /// A dimensionless time in the unit, in no more digits than it takes: a time that was typed comes back as it was.
    pub fn time(&self, tau: f64) -> f64 {
        if self.is_dimensionless() || !tau.is_finite() {
            return tau;
        }
        let time = tau / self.length;
        let same = |time: &f64| self.dimensionless(*time) == tau;
        let short = (13..17).map(|digits| rounded(time, digits)).find(same);
        short.unwrap_or(time)
    }

    /// A dimensionless time with its error in the unit.
    #[must_use]
    pub fn span(&self, tau: Estimate) -> Estimate {
        if self.is_dimensionless() {
            tau
        } else {
            tau.scaled(1.0 / self.length)
        }
    }

    /// A number per dimensionless time, per unit.
    #[must_use]
    pub fn rate(&self, rate: Estimate) -> Estimate {
        if self.is_dimensionless() {
            rate
        } else {
            rate.scaled(self.length)
        }
    }

    /// Seconds of one unit on a rig.
    pub fn seconds(&self, rig: &Rig) -> f64 {
        match self.unit {
            TimeUnit::Second => 1.0,
            TimeUnit::Dimensionless | TimeUnit::Period => rig.seconds(self.length),
        }
    }

    /// Below an axis of time.
    #[cfg(feature = "plots")]
    pub(crate) fn axis(&self) -> &'static str {
        match self.unit {
            TimeUnit::Dimensionless => "t",
            TimeUnit::Period => "time, periods",
            TimeUnit::Second => "time, s",
        }
    }

    /// What follows the number of a time.
    pub(crate) fn suffix(&self) -> &'static str {
        match self.unit {
            TimeUnit::Dimensionless => "",
            TimeUnit::Period => " periods",
            TimeUnit::Second => " s",
        }
    }

    /// Message with its times in the unit: `t = X`, `t = X of Y`, steps and durations.
    pub(crate) fn retold(&self, text: &str) -> String {
        const MARKS: [&str; 5] = ["t = ", "step ", "steps of ", "steps up to ", "a time of "];
        if self.is_dimensionless() {
            return text.to_owned();
        }
        let next = |rest: &str| {
            let found = MARKS.map(|mark| rest.find(mark).map(|at| (at, at + mark.len())));
            found.into_iter().flatten().min()
        };
        let mut told = String::new();
        let mut rest = text;
        while let Some((at, end)) = next(rest) {
            let (before, after) = rest.split_at(end);
            let word = before[..at].chars().next_back();
            told += before;
            rest = after;
            // "dt = 0.1" is no time of an output.
            if word.is_some_and(char::is_alphanumeric) {
                continue;
            }
            rest = self.number(rest, &mut told);
            if let Some(last) = rest.strip_prefix(" of ") {
                told += " of ";
                rest = self.number(last, &mut told);
            }
        }
        told + rest
    }

    /// Writes the number that `text` begins with in the unit, and returns what follows it.
    fn number<'a>(&self, text: &'a str, told: &mut String) -> &'a str {
        let part = |c: char| c.is_ascii_digit() || matches!(c, '.' | 'e' | '-' | '+');
        let word = &text[..text.find(|c| !part(c)).unwrap_or(text.len())];
        // A full stop ends the sentence, not the number.
        let word = word.trim_end_matches(['.', 'e', '-', '+']);
        match word.parse::<f64>() {
            Ok(tau) => {
                let time = self.time(tau);
                // What was rounded for reading stays so; what was written in full stays as it was typed.
                let mantissa = word.split('e').next().unwrap_or(word);
                let digits = mantissa.trim_start_matches(['-', '0', '.']);
                let digits = digits.chars().filter(char::is_ascii_digit).count();
                let time = if num(tau).len() < 9 && num(time).len() > 12 {
                    rounded(time, digits + 2)
                } else {
                    time
                };
                *told += &crate::estimate::time_shown(time);
                &text[word.len()..]
            }
            Err(_) => text,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Origin;

    #[test]
    fn a_time_that_was_typed_comes_back_as_it_was() {
        let rig = Rig::default();
        for unit in [TimeUnit::Dimensionless, TimeUnit::Period, TimeUnit::Second] {
            let clock = Clock::new(unit, Some(&rig)).unwrap();
            for k in 1..2000 {
                let typed = rounded(f64::from(k) * 0.0037, 13);
                let back = clock.time(clock.dimensionless(typed));
                assert_eq!(back, typed, "{unit:?}");
                // And again from there.
                assert_eq!(clock.time(clock.dimensionless(back)), typed);
            }
        }
        assert!(Clock::new(TimeUnit::Second, None).is_none());
    }

    #[test]
    fn a_rate_times_a_time_is_the_same_in_every_unit() {
        let rig = Rig::default();
        let (rate, tau) = (Estimate::new(0.0365, 1e-9, Origin::Space), 31.4);
        for unit in [TimeUnit::Dimensionless, TimeUnit::Period, TimeUnit::Second] {
            let clock = Clock::new(unit, Some(&rig)).unwrap();
            let it = clock.rate(rate);
            let product = it.value * clock.time(tau);
            assert!((product / (0.0365 * 31.4) - 1.0).abs() < 1e-12, "{unit:?}");
            assert!((it.error / it.value / (1e-9 / 0.0365) - 1.0).abs() < 1e-12);
            let second = clock.seconds(&rig) * clock.time(tau);
            assert!((second / rig.seconds(tau) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn messages_speak_of_times_in_the_unit() {
        let clock = Clock::new(TimeUnit::Period, None).unwrap();
        let tau = clock.dimensionless(2.5);
        let text = format!(
            "monte_carlo.var_q at t = {tau}: steps of dt = 0.1, came to t = 6.283 of {tau}; step 3.14, steps of 6.28."
        );
        assert_eq!(
            clock.retold(&text),
            "monte_carlo.var_q at t = 2.5: steps of dt = 0.1, came to t = 0.999971 of 2.5; step 0.49975, steps of 0.99949."
        );
        assert_eq!(clock.retold("nothing at t = all"), "nothing at t = all");
        assert_eq!(Clock::default().retold(&text), text);
    }
}
