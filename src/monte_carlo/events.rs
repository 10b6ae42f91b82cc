//! Losses and returns of contact.

/// Hears of every crossing of the loss point.
pub(super) trait Watch {
    /// Whether there is anything to tell.
    const LISTENS: bool = true;
    /// Lane, whether contact was lost (or regained), when, and |v| there.
    fn cross(&mut self, lane: usize, lost: bool, time: f64, speed: f64);
}

/// Nobody listens.
#[derive(Debug, Clone, Copy)]
pub(super) struct Deaf;

impl Watch for Deaf {
    const LISTENS: bool = false;

    #[inline(always)]
    fn cross(&mut self, _: usize, _: bool, _: f64, _: f64) {}
}
