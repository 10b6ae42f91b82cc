//! Flight: parabolas under a constant acceleration.

/// Under a constant acceleration.
#[inline(always)]
pub(super) fn thrown([q, v]: [f64; 2], acceleration: f64, t: f64) -> [f64; 2] {
    [q + t * (v + 0.5 * acceleration * t), v + acceleration * t]
}

/// Time and speed at which a flight from (q, v), q below `loss`, comes back to it.
#[inline(always)]
pub(super) fn landing([q, v]: [f64; 2], acceleration: f64, loss: f64) -> (f64, f64) {
    let depth = (loss - q).max(0.0);
    let speed = (v * v + 2.0 * acceleration * depth).sqrt();
    let time = if v > 0.0 {
        2.0 * depth / (v + speed)
    } else {
        (speed - v) / acceleration
    };
    (time, speed)
}

/// Time at which a flight from (q, v) meets a wall at `back`, below q, and its speed there; None if it turns first.
pub(super) fn behind([q, v]: [f64; 2], acceleration: f64, back: f64) -> Option<(f64, f64)> {
    let height = (q - back).max(0.0);
    let square = v * v - 2.0 * acceleration * height;
    if v >= 0.0 || square <= 0.0 {
        return None;
    }
    let speed = square.sqrt();
    Some((2.0 * height / (speed - v), speed))
}
