//! Times asked for: a list, or every so often.

use crate::clock::Clock;
use crate::error::{Error, Result, positive};
use crate::format::{num, rounded};
use serde_json::{Value, json};

/// Output times.
#[derive(Debug, Clone, PartialEq)]
pub enum Times {
    /// These times, ascending.
    List(Vec<f64>),
    /// `every`, 2 `every`, ... up to `until`.
    Every {
        /// The distance between times, and the first.
        every: f64,
        /// No time is later.
        until: f64,
    },
}

impl Times {
    /// More times than this are refused: a results file is meant to be read.
    pub(crate) const MOST: usize = 20_000;
    /// The latest time accepted.
    pub(crate) const LATEST: f64 = 1e9;

    pub(crate) fn none() -> Self {
        Self::List(Vec::new())
    }

    pub(crate) fn is_empty(&self) -> bool {
        matches!(self, Self::List(times) if times.is_empty())
    }

    /// The times.
    pub fn list(&self) -> Vec<f64> {
        match self {
            Self::List(times) => times.clone(),
            Self::Every { every, until } => {
                let count = (until / every * (1.0 + 1e-12)).floor().max(0.0);
                (1..=count.min(Self::MOST as f64) as u32)
                    .map(|k| rounded(f64::from(k) * every, 13))
                    .collect()
            }
        }
    }

    /// The last time; 0 without one.
    pub(crate) fn last(&self) -> f64 {
        self.list().last().copied().unwrap_or(0.0)
    }

    pub(super) fn check(&self, key: &str) -> Result<()> {
        let most = || format!("at most {} times", Self::MOST);
        match self {
            Self::Every { every, until } => {
                let part = |name: &str| format!("{key}.{name}");
                positive(&part("every"), *every)?;
                positive(&part("until"), *until)?;
                if *until > Self::LATEST {
                    let accepted = format!("a time up to {:e}", Self::LATEST);
                    return Err(Error::invalid(part("until"), num(*until), accepted));
                }
                if *until < *every {
                    let accepted = format!("a time of at least {key}.every = {}", num(*every));
                    return Err(Error::invalid(part("until"), num(*until), accepted));
                }
                if until / every > Self::MOST as f64 {
                    return Err(Error::invalid(part("every"), num(*every), most()));
                }
            }
            Self::List(times) => {
                if times.len() > Self::MOST {
                    let count = format!("a list of {} times", times.len());
                    return Err(Error::invalid(key, count, most()));
                }
                for (k, t) in times.iter().enumerate() {
                    let item = || format!("{key}[{k}]");
                    if !(*t >= 0.0 && *t <= Self::LATEST) {
                        let accepted = format!("a time from 0 to {:e}", Self::LATEST);
                        return Err(Error::invalid(item(), num(*t), accepted));
                    }
                    if k > 0 && *t <= times[k - 1] {
                        let before = num(times[k - 1]);
                        let accepted =
                            format!("ascending times without repeats; the one before is {before}");
                        return Err(Error::invalid(item(), num(*t), accepted));
                    }
                }
            }
        }
        Ok(())
    }

    /// The same in dimensionless time.
    pub(super) fn dimensionless(&self, clock: &Clock) -> Self {
        let times = self.list();
        Self::List(times.iter().map(|t| clock.dimensionless(*t)).collect())
    }

    pub(super) fn tree(&self) -> Value {
        match self {
            Self::List(times) => json!(times),
            Self::Every { every, until } => json!({ "every": every, "until": until }),
        }
    }
}
