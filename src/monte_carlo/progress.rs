//! How far a piece of work has come, told from any thread.

use crate::error::{Error, Result};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

/// Reports a fraction from any thread, a few hundred times in all, and watches the clock.
pub(super) struct Progress<'a> {
    total: u64,
    done: AtomicU64,
    start: Instant,
    max_seconds: f64,
    late: AtomicBool,
    report: &'a (dyn Fn(f64) + Sync),
}

impl<'a> Progress<'a> {
    pub(super) fn new(total: u64, report: &'a (dyn Fn(f64) + Sync)) -> Self {
        Self {
            total: total.max(1),
            done: AtomicU64::new(0),
            start: Instant::now(),
            max_seconds: f64::INFINITY,
            late: AtomicBool::new(false),
            report,
        }
    }

    /// The same with a limit of time.
    pub(super) fn within(mut self, max_seconds: f64) -> Self {
        self.max_seconds = max_seconds;
        self
    }

    /// Whether the limit of time is behind; whoever asks stops.
    pub(super) fn late(&self) -> bool {
        let late = self.start.elapsed().as_secs_f64() > self.max_seconds;
        if late {
            self.late.store(true, Ordering::Relaxed);
        }
        late
    }

    /// An error if anybody stopped early.
    pub(super) fn in_time(&self) -> Result<()> {
        if !self.late.load(Ordering::Relaxed) {
            return Ok(());
        }
        let done = self.done.load(Ordering::Relaxed) as f64 / self.total as f64;
        Err(Error::Limit {
            key: "accuracy.max_seconds",
            limit: self.max_seconds.to_string(),
            what: format!("{:.0} % of the paths were done", 100.0 * done),
        })
    }

    pub(super) fn add(&self, work: u64) {
        let before = self.done.fetch_add(work, Ordering::Relaxed);
        let fraction = |done: u64| (done as f64 / self.total as f64).min(1.0);
        let (before, now) = (fraction(before), fraction(before.saturating_add(work)));
        if (before * 200.0).floor() < (now * 200.0).floor() {
            (self.report)(now);
        }
    }

    pub(super) fn finish(&self) {
        (self.report)(1.0);
    }
}
