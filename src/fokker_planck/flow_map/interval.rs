//! An interval between outputs: flow maps and matrices in turn.

/// An interval: H and O in turn, then a last H. Places in the lists of maps and matrices.
#[derive(Debug, Clone, Default)]
pub(super) struct Schedule {
    pub(super) duration: f64,
    /// When it began, where that matters.
    pub(super) start: f64,
    pub(super) steps: usize,
    pub(super) parts: Vec<(usize, usize)>,
    pub(super) last: usize,
}

/// Friction with noise over a time; under a forcing at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Noise {
    pub(super) duration: f64,
    pub(super) at: f64,
    /// What the splitting leads by, and a nudge of v.
    pub(super) lead: f64,
    pub(super) nudge: f64,
}

impl Noise {
    pub(super) fn is(&self, other: &Self, near: impl Fn(f64, f64) -> bool) -> bool {
        let rest = |it: &Self| (it.at, it.lead, it.nudge);
        near(self.duration, other.duration) && rest(self) == rest(other)
    }
}

/// The motion between two kicks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leg {
    pub(super) time: f64,
    /// How long the kick before it and the one after it last, 0 where friction is nowhere other than in the matrices.
    pub(super) friction: [f64; 2],
}

impl Leg {
    pub(super) fn is(&self, other: &Self, near: impl Fn(f64, f64) -> bool) -> bool {
        let friction = self.friction.into_iter().zip(other.friction);
        near(self.time, other.time) && friction.into_iter().all(|(a, b)| near(a, b))
    }
}
