//! How far a piece of work has come, told from any thread, and whether its time is over.

use super::events::Watch;
use crate::budget::Limits;
use crate::error::Result;
use crate::format::{brief, rounded};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Reports a fraction from any thread, a thousand times in all, and watches the clock.
pub(super) struct Progress<'a> {
    total: u64,
    done: AtomicU64,
    limits: Limits,
    stopped: AtomicBool,
    report: &'a (dyn Fn(f64) + Sync),
}

impl<'a> Progress<'a> {
    pub(super) fn new(total: u64, limits: Limits, report: &'a (dyn Fn(f64) + Sync)) -> Self {
        Self {
            total: total.max(1),
            done: AtomicU64::new(0),
            limits,
            stopped: AtomicBool::new(false),
            report,
        }
    }

    /// Whether the limit of time is behind; whoever asks stops.
    pub(super) fn late(&self) -> bool {
        let late = self.limits.left() < 0.0;
        if late {
            self.stopped.store(true, Ordering::Relaxed);
        }
        late
    }

    pub(super) fn add(&self, work: u64) {
        let before = self.done.fetch_add(work, Ordering::Relaxed);
        let fraction = |done: u64| (done as f64 / self.total as f64).min(1.0);
        let (before, now) = (fraction(before), fraction(before.saturating_add(work)));
        if (before * 1000.0).floor() < (now * 1000.0).floor() {
            (self.report)(now);
        }
    }

    /// The end of the work.
    ///
    /// # Errors
    /// [`crate::Error::Limit`] if anybody stopped early.
    pub(super) fn finish(&self) -> Result<()> {
        if self.stopped.load(Ordering::Relaxed) {
            let done = self.done.load(Ordering::Relaxed);
            let share = 100.0 * done as f64 / self.total as f64;
            let what = format!("{} % of the paths were done", brief(rounded(share, 2)));
            return Err(self.limits.out_of_time(what));
        }
        (self.report)(1.0);
        Ok(())
    }
}

/// Hears what `watch` hears, until the time of the work is over.
pub(super) struct Timed<'a, W> {
    pub(super) watch: &'a mut W,
    pub(super) progress: &'a Progress<'a>,
}

impl<W: Watch> Watch for Timed<'_, W> {
    const LISTENS: bool = W::LISTENS;

    #[inline(always)]
    fn cross(&mut self, lane: usize, lost: bool, time: f64, speed: f64) {
        self.watch.cross(lane, lost, time, speed);
    }

    const FOLLOWS: bool = W::FOLLOWS;

    #[inline(always)]
    fn moved(&mut self, lane: usize, time: f64, step: f64, ends: [[f64; 2]; 2]) {
        self.watch.moved(lane, time, step, ends);
    }

    fn late(&self) -> bool {
        self.progress.late()
    }
}
