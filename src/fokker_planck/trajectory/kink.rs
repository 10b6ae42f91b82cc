//! Motion up to a kink of the force and away from it: time as a quadrature over q of dq / v, v from the energy. Steps in
//! time would have to halve towards a kink at which the force is not smooth from either side, as (q - kink)^1.1.

use crate::contact::ContactLaw;
use crate::quadrature::gauss;
use std::sync::LazyLock;

/// What a step may lose of a state, relative to it; where that is told by an estimate of order 10, the result has order 12.
pub(super) const TOLERANCE: f64 = 3e-15;

/// q = kink + (other - kink) s^3 at the nodes: (q - kink)^(n + 1) of the potential becomes s^(3 n + 3).
static RULE: LazyLock<[(f64, f64); 20]> = LazyLock::new(gauss);

/// Motion to the kink ahead, or away from the one behind, if the point (q, v) stands on it: the time, and the new point.
/// None where neither is within the time `left`, nor within `most` at the speed v, or where the energy does not tell it.
pub(super) fn passed(
    contact: &ContactLaw,
    [q, v]: [f64; 2],
    [behind, ahead]: [f64; 2],
    [left, most]: [f64; 2],
) -> Option<(f64, [f64; 2])> {
    let reach = v * left.min(most);
    let moved = |to: f64, kink: f64| {
        let (time, speed) = by_energy(contact, [q, v], to, kink)?;
        (time <= left).then_some((time, [to, speed.copysign(v)]))
    };
    let arrived = if (ahead - q).abs() <= reach.abs() {
        moved(ahead, ahead)
    } else {
        None
    };
    let parts = if q == behind { &PARTS[..] } else { &[] };
    let room = 0.5 * (ahead - q).abs();
    let place = |part: &f64| q + (part * reach).clamp(-room, room);
    arrived.or_else(|| parts.iter().find_map(|part| moved(place(part), q)))
}

/// Parts of the way that the speed at the kink makes in the time, one after the other.
const PARTS: [f64; 5] = [1.0, 0.8, 0.4, 0.2, 0.1];

/// How far from the kink no motion may turn, in widths of the way: 20 nodes then leave 2.4^-40 of the singularity there.
const BEYOND: f64 = 1.75;

/// Time in which a point (q, v) moves to `to`, and its speed there, where q or `to` is the `kink`. 1 / v must be smooth: None
/// where v^2 leaves half to twice its first value, where the motion turns within [`BEYOND`] of the way from the kink, or
/// where the energy does not tell v to rounding.
fn by_energy(contact: &ContactLaw, [q, v]: [f64; 2], to: f64, kink: f64) -> Option<(f64, f64)> {
    let potential = contact.potential(q);
    let square = |at: f64| v * v + 2.0 * (potential - contact.potential(at));
    let smooth = |at: f64| Some(square(at)).filter(|s| *s > 0.5 * v * v && *s < 2.0 * v * v);
    let end = smooth(to)?;
    let width = q + to - 2.0 * kink;
    let lost = f64::EPSILON * potential.abs() * width.abs();
    if lost > TOLERANCE * v * v || square(kink + BEYOND * width) <= 0.0 {
        return None;
    }
    let mut sum = 0.0;
    for (x, weight) in &*RULE {
        let s = 0.5 + 0.5 * x;
        sum += weight * s * s / smooth(kink + width * s * s * s)?.sqrt();
    }
    Some((1.5 * width.abs() * sum, end.sqrt()))
}
