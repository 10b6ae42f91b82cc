//! A group of paths, and the steps of a scheme that is one kernel.

use crate::excitation::Excitation;
use crate::monte_carlo::events::{PATIENCE, Watch};
use crate::monte_carlo::law::Law;
use crate::monte_carlo::noise::{LANES, Lanes, Streams};
use crate::monte_carlo::signal::Signal;
use crate::roots::bisect;
use std::sync::Arc;

/// The paths that advance together.
#[derive(Debug, Clone)]
pub(in crate::monte_carlo) struct Group {
    pub(in crate::monte_carlo) q: Lanes,
    pub(in crate::monte_carlo) v: Lanes,
    /// The excitation at this moment, where the scheme takes it at whole steps.
    pub(in crate::monte_carlo) excitation: Lanes,
    pub(in crate::monte_carlo) streams: Streams,
    /// The sum of cosines in place of white noise.
    pub(in crate::monte_carlo) signal: Option<Signal>,
    /// What there is beside stationary noise; the splittings know it.
    pub(in crate::monte_carlo) push: Option<Arc<Excitation>>,
}

/// A scheme of one excitation a step. `kick` is what a step ends with and the next begins with, so that
/// the force is evaluated once a step.
pub(super) trait Kernel: Copy {
    /// The step.
    fn duration(self) -> f64;
    /// Half a step's kick at displacement q under the excitation of that moment.
    fn kick<L: Law>(self, law: L, q: f64, excitation: f64) -> f64;
    /// (q, v, kick) after one step.
    fn step<L: Law>(self, law: L, state: (f64, f64, f64), excitation: f64) -> (f64, f64, f64);
    /// Factor of a sum of cosines against a standard normal; None where it has no place.
    fn cosines(self) -> Option<f64> {
        None
    }
}

// No closures within: they would not be compiled for the vectors of the caller.
#[inline(always)]
pub(super) fn kernel_steps<L: Law, K: Kernel, W: Watch>(
    law: L,
    kernel: K,
    group: &mut Group,
    steps: u64,
    now: f64,
    watch: &mut W,
) {
    let duration = kernel.duration();
    // Where a sum of cosines has its place in the scheme.
    let factor = kernel.cosines().filter(|_| group.signal.is_some());
    let mut signal = group.signal.take();
    if let (Some(factor), Some(signal)) = (factor, &mut signal) {
        signal.begin(now, duration);
        signal.value(factor, &mut group.excitation);
    }
    let mut state = Running {
        q: group.q,
        v: group.v,
        kick: [0.0; LANES],
        excitation: group.excitation,
    };
    for lane in 0..LANES {
        state.kick[lane] = kernel.kick(law, state.q[lane], state.excitation[lane]);
    }
    let mut streams = group.streams.clone();
    let mut spare = [0.0; LANES];
    for k in 0..steps {
        if k % PATIENCE == PATIENCE - 1 && watch.late() {
            break;
        }
        match (factor, &mut signal) {
            (Some(factor), Some(signal)) => signal.next(factor, &mut state.excitation),
            // Normals come in pairs.
            _ if k % 2 == 0 => streams.normals(&mut state.excitation, &mut spare),
            _ => state.excitation = spare,
        }
        one(law, kernel, &mut state, now + k as f64 * duration, watch);
    }
    group.signal = signal;
    group.streams = streams;
    (group.q, group.v, group.excitation) = (state.q, state.v, state.excitation);
}

/// q, v, the kick and the excitation of the paths that advance together.
struct Running {
    q: Lanes,
    v: Lanes,
    kick: Lanes,
    excitation: Lanes,
}

/// One step of every lane, with crossings of the loss point from the cubic through both ends.
#[inline(always)]
fn one<L: Law, K: Kernel, W: Watch>(
    law: L,
    kernel: K,
    state: &mut Running,
    now: f64,
    watch: &mut W,
) {
    let (mut q0, mut v0) = ([0.0; LANES], [0.0; LANES]);
    if W::LISTENS || W::FOLLOWS {
        (q0, v0) = (state.q, state.v);
    }
    for lane in 0..LANES {
        let old = (state.q[lane], state.v[lane], state.kick[lane]);
        (state.q[lane], state.v[lane], state.kick[lane]) =
            kernel.step(law, old, state.excitation[lane]);
    }
    if W::LISTENS {
        let count = if L::WALLED { 2 } else { 1 };
        for lane in 0..LANES {
            let mut walls = [law.loss(), law.back()];
            // In the order of their passage.
            if L::WALLED && state.q[lane] > q0[lane] {
                walls.reverse();
            }
            for wall in walls.into_iter().take(count) {
                let below = state.q[lane] < wall;
                if below != (q0[lane] < wall) {
                    let ends = [
                        q0[lane] - wall,
                        v0[lane],
                        state.q[lane] - wall,
                        state.v[lane],
                    ];
                    let (after, speed) = cubic_crossing(ends, kernel.duration());
                    // Below the first wall it flies, below the second it does not.
                    let lost = below == (wall == law.loss());
                    watch.cross(lane, lost, now + after, speed);
                }
            }
        }
    }
    if W::FOLLOWS {
        for lane in 0..LANES {
            let ends = [[q0[lane], v0[lane]], [state.q[lane], state.v[lane]]];
            watch.moved(lane, now, kernel.duration(), ends);
        }
    }
}

/// Value and slope in a part s of a step of the cubic with values and slopes (x0, v0) and (x1, v1) at its ends.
pub(in crate::monte_carlo) fn cubic([x0, v0, x1, v1]: [f64; 4], step: f64, s: f64) -> (f64, f64) {
    let (c, d) = (v0 * step, v1 * step);
    let (a2, a3) = (3.0 * (x1 - x0) - 2.0 * c - d, 2.0 * (x0 - x1) + c + d);
    (
        x0 + s * (c + s * (a2 + s * a3)),
        (c + s * (2.0 * a2 + 3.0 * s * a3)) / step,
    )
}

/// When that cubic passes 0, and its speed there.
fn cubic_crossing(ends: [f64; 4], step: f64) -> (f64, f64) {
    let (at, [x0, ..]) = (|s: f64| cubic(ends, step, s), ends);
    let passed = bisect(0.0, 1.0, |s| (at(s).0 < 0.0) != (x0 < 0.0));
    (passed * step, at(passed).1.abs())
}
