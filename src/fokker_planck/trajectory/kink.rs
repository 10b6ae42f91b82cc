//! Motion up to a kink of the force and away from it: time as a quadrature over q of dq / v, v from the work of the force.
//! Steps in time would have to halve towards a kink at which the force is not smooth from either side, as (q - kink)^1.1.

use crate::contact::ContactLaw;
use crate::matrix::dot;
use crate::quadrature::{gauss, legendre};
use std::sync::LazyLock;

/// What a step may lose of a state, relative to it; where that is told by an estimate of order 10, the result has order 12.
pub(super) const TOLERANCE: f64 = 3e-15;

/// Nodes of the quadrature, and the power by which q leaves the kink, q = kink + width s^4: (q - kink)^n in the force becomes
/// s^(4 n + 3) in its work.
const NODES: usize = 20;
const POWER: i32 = 4;

/// The last coefficients of Legendre that a work may have, over v^2, and a slowness, over its integral. Integrals up to a node are
/// a hundred times better known than the first, and err with changing signs; Gauss's of a whole, where it is analytic, is as their
/// square.
const LAST: [f64; 2] = [1e-12, 3e-8];

/// Gauss's rule for 0 < s < 1.
struct Rule {
    nodes: [f64; NODES],
    weights: [f64; NODES],
    /// From the values at all nodes, the integral up to each.
    up_to: [[f64; NODES]; NODES],
    /// From them, the last two coefficients of Legendre.
    last: [[f64; NODES]; 2],
}

static RULE: LazyLock<Rule> = LazyLock::new(|| {
    let rule = gauss::<NODES>();
    let legendre = rule.map(|(x, _)| legendre::<{ NODES + 1 }>(x));
    // The coefficient m of what is 1 at node j and 0 at the others, and the integral of P_m up to node k.
    let coefficient = |m: usize, j: usize| (m as f64 + 0.5) * rule[j].1 * legendre[j][m];
    let integral = |m: usize, k: usize| match m {
        0 => rule[k].0 + 1.0,
        _ => (legendre[k][m + 1] - legendre[k][m - 1]) / (2 * m + 1) as f64,
    };
    let up_to = |k: usize, j: usize| -> f64 {
        let all = (0..NODES).map(|m| coefficient(m, j) * integral(m, k));
        0.5 * all.sum::<f64>()
    };
    Rule {
        nodes: rule.map(|(x, _)| 0.5 + 0.5 * x),
        weights: rule.map(|(_, weight)| 0.5 * weight),
        up_to: std::array::from_fn(|k| std::array::from_fn(|j| up_to(k, j))),
        last: [NODES - 1, NODES - 2].map(|m| std::array::from_fn(|j| coefficient(m, j))),
    }
});

/// Parts of the way that the speed at the kink makes in the time, one after the other.
const PARTS: [f64; 5] = [1.0, 0.8, 0.4, 0.2, 0.1];

/// Motion to the kink ahead, or away from the one behind, if the point (q, v) stands on it: the time, and the new point.
/// None where neither is within the time `left`, nor within `most` at the speed v, or where the quadrature is not known to rounding.
pub(super) fn passed(
    contact: &ContactLaw,
    [q, v]: [f64; 2],
    [behind, ahead]: [f64; 2],
    [left, most]: [f64; 2],
) -> Option<(f64, [f64; 2])> {
    let reach = v * left.min(most);
    let moved = |to: f64, kink: f64| {
        let (time, speed) = by_work(contact, [q, v], to, kink)?;
        (time > 0.0 && time <= left).then_some((time, [to, speed.copysign(v)]))
    };
    if q == behind {
        let room = 0.5 * (ahead - q).abs();
        let place = |part: &f64| q + (part * reach).clamp(-room, room);
        return PARTS.iter().find_map(|part| moved(place(part), q));
    }
    if (ahead - q).abs() <= reach.abs() {
        moved(ahead, ahead)
    } else {
        None
    }
}

/// Time in which a point (q, v) moves to `to`, and its speed there, where q or `to` is the `kink`.
fn by_work(contact: &ContactLaw, [q, v]: [f64; 2], to: f64, kink: f64) -> Option<(f64, f64)> {
    let rule = &*RULE;
    let width = q + to - 2.0 * kink;
    let slope = rule
        .nodes
        .map(|s| f64::from(POWER) * width * s.powi(POWER - 1));
    let force = rule
        .nodes
        .map(|s| contact.force(kink + width * s.powi(POWER)));
    let work: [f64; NODES] = std::array::from_fn(|k| slope[k] * force[k]);
    let gained = 2.0 * dot(&rule.weights, &work);
    // v^2 at the kink, and where the motion ends.
    let [there, end] = if kink == to {
        [v * v + gained; 2]
    } else {
        [v * v, v * v - gained]
    };
    // Out of near rest a slowness has a peak that the nodes do not see.
    let alike = |square: &f64| *square > 0.5 * v * v && *square < 2.0 * v * v;
    if !alike(&end) {
        return None;
    }
    let up_to = rule.up_to.each_ref();
    let square = up_to.map(|row| there - 2.0 * dot(row, &work));
    if !square.iter().all(alike) {
        return None;
    }
    let slowness: [f64; NODES] = std::array::from_fn(|k| slope[k].abs() / square[k].sqrt());
    let time = dot(&rule.weights, &slowness);
    let last = |of: &[f64; NODES]| {
        let [a, b] = rule.last.each_ref().map(|row| dot(row, of).abs());
        a.max(b)
    };
    let known = last(&work) <= LAST[0] * v * v && last(&slowness) <= LAST[1] * time;
    known.then(|| (time, end.sqrt()))
}
