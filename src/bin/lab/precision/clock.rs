//! The time that this process had a processor: what a run costs, whoever else uses the machine.

use std::fs;
use std::time::Instant;

/// Measures from its making.
pub(super) struct Clock {
    processor: Option<f64>,
    wall: Instant,
}

impl Clock {
    pub(super) fn new() -> Self {
        Self {
            processor: processor_seconds(),
            wall: Instant::now(),
        }
    }

    /// Processor seconds of all threads since; wall seconds where the system does not tell.
    pub(super) fn seconds(&self) -> f64 {
        match (self.processor, processor_seconds()) {
            (Some(then), Some(now)) => now - then,
            _ => self.elapsed(),
        }
    }

    /// Seconds by the clock on the wall since.
    pub(super) fn elapsed(&self) -> f64 {
        self.wall.elapsed().as_secs_f64()
    }
}

/// Processor seconds of all threads that still live: the first number of schedstat is in nanoseconds.
fn processor_seconds() -> Option<f64> {
    let mut sum = 0.0;
    for task in fs::read_dir("/proc/self/task").ok()? {
        let text = fs::read_to_string(task.ok()?.path().join("schedstat")).ok()?;
        let first: f64 = text.split_whitespace().next()?.parse().ok()?;
        sum += 1e-9 * first;
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_takes_time_and_no_more_than_the_threads_had() {
        let clock = Clock::new();
        let mut x = 1.0_f64;
        while clock.wall.elapsed().as_secs_f64() < 0.05 {
            x = (x + 1.0).sqrt();
        }
        assert!(x > 1.0 && clock.seconds() > 0.0);
    }
}
