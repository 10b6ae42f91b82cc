//! The undamped, noise-free motion q'' = -G(q), with every loss and return of contact located.

use super::events::{PATIENCE, Watch};
use super::law::Law;
use super::noise::{LANES, Lanes};
use crate::roots::rising;

/// Longest substep times the highest frequency of the scene. Measured: the energy then errs by less
/// than 3e-5 of itself, without drift, and the phase by 2e-6 a unit of time.
const RESOLUTION: f64 = 0.3;

/// The motion over a fixed time, in equal substeps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flow {
    substep: f64,
    count: u32,
}

impl Flow {
    /// The motion over `time`, for contacts no stiffer than `frequency`^2.
    pub(super) fn new(time: f64, frequency: f64) -> Self {
        let count = (time * frequency / RESOLUTION).ceil().clamp(1.0, 1e9);
        Self {
            substep: time / count,
            count: count as u32,
        }
    }

    /// The time it spans.
    pub(super) fn time(self) -> f64 {
        self.substep * f64::from(self.count)
    }

    /// Advances q, v and the force G(q); `now` is the time at the beginning, told to `watch`.
    ///
    /// Order 4, symplectic, time-symmetric: Chin, Phys. Lett. A 226:344 (1997), scheme A, one
    /// evaluation of force and stiffness and one of the force a substep. It is exact in flight, where
    /// the force is constant. A substep that crosses the loss point is made anew from pieces that end
    /// on it: without that the order falls to 2 for a bilinear and 5/2 for a Hertzian contact. With it
    /// a bilinear contact keeps order 4; the t^{3/2} rise of the Hertzian force leaves a term of order
    /// 5/2, of either sign and 12 times smaller.
    #[inline(always)]
    pub(super) fn advance<L: Law, W: Watch>(
        self,
        law: L,
        (q, v, force): (&mut Lanes, &mut Lanes, &mut Lanes),
        now: f64,
        watch: &mut W,
    ) {
        let chin = Chin::new(self.substep);
        let loss = law.loss();
        // A dip below the loss point within one substep: the acceleration there is -G(loss) or less.
        let graze = 0.6 / law.force(loss.max(-1e300)).abs();
        let back = law.back();
        for k in 0..self.count {
            // A step by hand can be as long as one likes.
            if u64::from(k) % PATIENCE == PATIENCE - 1 && watch.late() {
                break;
            }
            let (q0, v0) = (*q, *v);
            let mut crossed = [0u64; LANES];
            for lane in 0..LANES {
                let (q1, v1, f1) = chin.step(law, q0[lane], v0[lane], force[lane]);
                let was_out = q0[lane] < loss;
                let is_out = q1 < loss;
                let turned = u64::from(v0[lane] < 0.0) & u64::from(v1 > 0.0);
                let above = q0[lane] - loss;
                let near = u64::from(above < graze * v0[lane] * v0[lane]) & u64::from(above >= 0.0);
                // Without branches: a dip, or a crossing.
                crossed[lane] = (turned & near) | u64::from(was_out != is_out);
                if L::WALLED {
                    // The same at the second wall.
                    let above = q0[lane] - back;
                    let near =
                        u64::from(above < graze * v0[lane] * v0[lane]) & u64::from(above >= 0.0);
                    crossed[lane] |= (turned & near) | u64::from((q0[lane] < back) != (q1 < back));
                }
                (q[lane], v[lane], force[lane]) = (q1, v1, f1);
            }
            if crossed.iter().fold(0, |any, flag| any | flag) != 0 {
                let now = now + f64::from(k) * self.substep;
                for lane in 0..LANES {
                    if crossed[lane] != 0 {
                        let state = State {
                            q: q0[lane],
                            v: v0[lane],
                        };
                        let end = locate(law, state, self.substep, |out, after, speed| {
                            watch.cross(lane, out, now + after, speed);
                        });
                        (q[lane], v[lane], force[lane]) = (end.q, end.v, law.force(end.q));
                    }
                }
            }
            if W::FOLLOWS {
                let now = now + f64::from(k) * self.substep;
                for lane in 0..LANES {
                    let ends = [[q0[lane], v0[lane]], [q[lane], v[lane]]];
                    watch.moved(lane, now, self.substep, ends);
                }
            }
        }
    }
}

/// Coefficients of one substep: kicks of 1/6, 2/3 and 1/6, the middle one with the force gradient.
#[derive(Debug, Clone, Copy)]
struct Chin {
    half: f64,
    sixth: f64,
    two_thirds: f64,
    gradient: f64,
}

impl Chin {
    #[inline(always)]
    fn new(step: f64) -> Self {
        Self {
            half: 0.5 * step,
            sixth: step / 6.0,
            two_thirds: step * (2.0 / 3.0),
            gradient: step * step / 24.0,
        }
    }

    #[inline(always)]
    fn step<L: Law>(self, law: L, q: f64, v: f64, force: f64) -> (f64, f64, f64) {
        let v = v - self.sixth * force; // B
        let q = q + self.half * v; // A
        let (middle, stiffness) = law.force_and_stiffness(q);
        let v = v - self.two_thirds * (middle * (1.0 - self.gradient * stiffness)); // B, force gradient
        let q = q + self.half * v; // A
        let force = law.force(q);
        (q, v - self.sixth * force, force) // B
    }
}

/// Displacement and velocity of one path.
#[derive(Debug, Clone, Copy)]
struct State {
    q: f64,
    v: f64,
}

/// The motion over `time` cut at every loss and return of contact, which `tell` hears of: (lost, time
/// since the beginning, |v|).
fn locate<L: Law>(
    law: L,
    mut state: State,
    time: f64,
    mut tell: impl FnMut(bool, f64, f64),
) -> State {
    let loss = law.loss();
    let fall = -law.force(loss);
    let mut left = time;
    // Each pass is one piece in contact or one flight; more than a few never happen.
    for _ in 0..64 {
        let behind =
            L::WALLED && (state.q < law.back() || (state.q == law.back() && state.v < 0.0));
        let out = !behind && (state.q < loss || (state.q == loss && state.v < 0.0));
        if behind {
            let end = in_contact(law, state, left);
            let Some((exit, v)) = rise(law, state, end, left) else {
                return State {
                    q: end.q.min(law.back()),
                    v: end.v,
                };
            };
            let v = v.max(f64::MIN_POSITIVE);
            left = (left - exit).max(0.0);
            state = State { q: law.back(), v };
            tell(true, time - left, v);
        } else if out {
            if let Some((after, speed)) = struck(law, state, fall).filter(|it| it.0 < left) {
                left -= after;
                state = State {
                    q: law.back(),
                    v: -speed,
                };
                tell(false, time - left, speed);
                continue;
            }
            let speed = (state.v * state.v + 2.0 * fall * (loss - state.q)).sqrt();
            // The root of q + v t + fall t^2/2 = loss that does not cancel.
            let back = if state.v < 0.0 {
                (speed - state.v) / fall
            } else {
                2.0 * (loss - state.q) / (speed + state.v)
            };
            // A law whose flight does not fall back gives no root, or one in the past.
            let returns = back >= 0.0 && back < left;
            if !returns {
                let q = state.q + left * (state.v + 0.5 * fall * left);
                let low = if L::WALLED {
                    law.back()
                } else {
                    f64::NEG_INFINITY
                };
                return State {
                    q: q.min(loss).max(low),
                    v: state.v + fall * left,
                };
            }
            left -= back;
            state = State { q: loss, v: speed };
            tell(false, time - left, speed);
        } else {
            let end = in_contact(law, state, left);
            let Some((exit, v)) = exit(law, state, end, left) else {
                return State {
                    q: end.q.max(loss),
                    v: end.v,
                };
            };
            let v = v.min(-f64::MIN_POSITIVE);
            left = (left - exit).max(0.0);
            state = State { q: loss, v };
            tell(true, time - left, -v);
        }
    }
    state
}

/// When a flight strikes the second wall, and how fast; None without one, or if it turns before.
fn struck<L: Law>(law: L, state: State, fall: f64) -> Option<(f64, f64)> {
    if !L::WALLED || state.v >= 0.0 {
        return None;
    }
    let height = (state.q - law.back()).max(0.0);
    let square = state.v * state.v - 2.0 * fall * height;
    if square <= 0.0 {
        return None;
    }
    let speed = square.sqrt();
    Some((2.0 * height / (speed - state.v), speed))
}

/// When a motion that begins behind the second wall and would be at `end` after `time` leaves it, and its velocity
/// there; None if it does not. The force pushes it out, so that it leaves once.
fn rise<L: Law>(law: L, start: State, end: State, time: f64) -> Option<(f64, f64)> {
    let back = law.back();
    if end.q <= back {
        return None;
    }
    let beyond = |t: f64| {
        let state = in_contact(law, start, t);
        (state.q - back, state.v)
    };
    let t = rising(beyond, [0.0, time], time, 1e-8 * time);
    Some((t, in_contact(law, start, t).v))
}

/// One substep of any length from a state in contact.
fn in_contact<L: Law>(law: L, state: State, time: f64) -> State {
    let (q, v, _) = Chin::new(time).step(law, state.q, state.v, law.force(state.q));
    State { q, v }
}

/// When a motion that begins in contact and would be at `end` after `time` first reaches the loss
/// point, and its velocity there; None if it does not.
fn exit<L: Law>(law: L, start: State, end: State, time: f64) -> Option<(f64, f64)> {
    let loss = law.loss();
    let (mut high, mut last) = (time, end);
    if end.q >= loss {
        (high, last) = lowest(law, start, end, time)?;
        if last.q >= loss {
            return None;
        }
    }
    // Backwards along the parabola of flight from the point below, then Newton, bisected where it
    // leaves the interval in which q falls through the loss point.
    let fall = -law.force(loss);
    let speed = (last.v * last.v + 2.0 * fall * (loss - last.q)).sqrt();
    let (mut low, mut t) = (0.0, (high - (last.v + speed) / fall).max(0.5 * high));
    for _ in 0..60 {
        let state = in_contact(law, start, t);
        if state.q < loss {
            high = t;
        } else {
            low = t;
        }
        let newton = t - (state.q - loss) / state.v;
        let next = if newton >= low && newton <= high {
            newton
        } else {
            0.5 * (low + high)
        };
        let change = next - t;
        // Newton converges quadratically: the change after this one would be a rounding.
        if change.abs() <= 1e-8 * time {
            return Some((next, state.v + fall * change));
        }
        t = next;
    }
    Some((t, -speed))
}

/// Time and state of the lowest point of a motion that begins downwards and is at `end`, upwards, after
/// `time`; a point below the loss point will do. None if it does not turn.
fn lowest<L: Law>(law: L, start: State, end: State, time: f64) -> Option<(f64, State)> {
    if !(start.v < 0.0 && end.v > 0.0) {
        return None;
    }
    // Secant steps: v is nearly straight.
    let (mut a, mut b) = ((0.0, start.v), (time, end.v));
    let (mut t, mut state) = (time, end);
    for _ in 0..6 {
        t = a.0 - a.1 * (b.0 - a.0) / (b.1 - a.1);
        state = in_contact(law, start, t);
        if state.q < law.loss() || state.v.abs() < 1e-9 * (b.1 - a.1) {
            break;
        }
        if state.v < 0.0 {
            a = (t, state.v);
        } else {
            b = (t, state.v);
        }
    }
    Some((t, state))
}

#[cfg(test)]
mod tests {
    use super::super::law::{Bilinear, Hertz};
    use super::*;

    #[derive(Default)]
    struct Heard(Vec<(bool, f64, f64)>);

    impl Watch for Heard {
        fn cross(&mut self, lane: usize, lost: bool, time: f64, speed: f64) {
            if lane == 0 {
                self.0.push((lost, time, speed));
            }
        }
    }

    fn run<L: Law>(
        law: L,
        q: f64,
        v: f64,
        flow: Flow,
        times: u32,
        heard: &mut Heard,
    ) -> (f64, f64) {
        let (mut qs, mut vs, mut fs) = ([q; LANES], [v; LANES], [law.force(q); LANES]);
        for k in 0..times {
            flow.advance(
                law,
                (&mut qs, &mut vs, &mut fs),
                f64::from(k) * flow.time(),
                heard,
            );
        }
        assert!(qs.iter().all(|q| *q == qs[0]) && vs.iter().all(|v| *v == vs[0]));
        (qs[0], vs[0])
    }

    #[test]
    fn a_bouncing_orbit_is_periodic_and_its_flights_last_as_long_as_the_parabola() {
        // Bilinear: half a turn of the circle of radius r about 0 up to q = -1, then the parabola.
        let r: f64 = 1.6;
        let speed = (r * r - 1.0).sqrt();
        let contact = 2.0 * (std::f64::consts::PI - (1.0 / r).acos());
        let period = contact + 2.0 * speed;
        let flow = Flow {
            substep: period / 40.0,
            count: 40,
        };
        let mut heard = Heard::default();
        let (q, v) = run(Bilinear, r, 0.0, flow, 10, &mut heard);
        println!(
            "after 10 periods q {:.1e}, v {v:.1e}; {} crossings",
            q - r,
            heard.0.len()
        );
        assert!((q - r).abs() < 1e-4 && v.abs() < 1e-3 && heard.0.len() == 20);
        for pair in heard.0.chunks(2) {
            assert!(pair[0].0 && !pair[1].0);
            assert!(
                (pair[1].1 - pair[0].1 - 2.0 * speed).abs() < 1e-4,
                "{pair:?}"
            );
            assert!((pair[1].2 - speed).abs() < 1e-4 && (pair[0].2 - pair[1].2).abs() < 1e-12);
        }
    }

    /// Relative error of the energy after one passage through flight, mean over phases of the grid.
    fn energy_error<L: Law>(law: L, count: u32, located: bool) -> f64 {
        let phases = 40;
        let error = |phase: u32| {
            let start = 1.2 + 0.01 * f64::from(phase);
            let energy = |q: f64, v: f64| 0.5 * v * v + law.potential(q);
            let substep = 6.0 / f64::from(count);
            let (q, v) = if located {
                run(
                    law,
                    start,
                    0.0,
                    Flow { substep, count },
                    1,
                    &mut Heard::default(),
                )
            } else {
                let chin = Chin::new(substep);
                let step = |(q, v, f)| chin.step(law, q, v, f);
                let begin = (start, 0.0, law.force(start));
                let (q, v, _) = (0..count).fold(begin, |state, _| step(state));
                (q, v)
            };
            (energy(q, v) / energy(start, 0.0) - 1.0).abs()
        };
        (0..phases).map(error).sum::<f64>() / f64::from(phases)
    }

    #[test]
    fn the_motion_loses_its_order_at_the_loss_of_contact_unless_the_crossing_is_located() {
        let measure = |name: &str, error: &dyn Fn(u32) -> f64| {
            let errors = [24, 48, 96, 192].map(error);
            let orders: Vec<f64> = errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect();
            let shown = errors.map(|e| format!("{e:.1e}")).join(" ");
            println!("{name}: energy errors {shown}, orders {orders:.2?}");
            (errors, orders)
        };
        let (_, bilinear) = measure("bilinear", &|n| energy_error(Bilinear, n, false));
        let (_, repaired) = measure("bilinear, located", &|n| energy_error(Bilinear, n, true));
        let (blind, hertz) = measure("hertz", &|n| energy_error(Hertz, n, false));
        let (located, _) = measure("hertz, located", &|n| energy_error(Hertz, n, true));
        assert!(bilinear.iter().all(|order| *order < 2.5));
        assert!(repaired.iter().all(|order| *order > 3.5));
        assert!(hertz.iter().all(|order| *order < 3.0));
        // The Hertz force rises as t^{3/2} after the return, which leaves a term of order 5/2, 12 times
        // smaller than without location.
        assert!(located[0] < 2e-5 && located[3] < 0.12 * blind[3]);
    }

    #[test]
    fn a_short_dip_below_the_loss_point_is_not_missed() {
        // Enters at speed 0.02: out for 0.04, within one substep of 0.25.
        let (mut heard, mut missed) = (0, 0);
        for k in 0..25 {
            let before = 0.005 + 0.0095 * f64::from(k);
            // Backwards from the loss point by a fine flow in contact.
            let mut state = State { q: -1.5, v: 0.02 };
            for _ in 0..200 {
                state = in_contact(Hertz, state, before / 200.0);
            }
            let flow = Flow {
                substep: 0.25,
                count: 4,
            };
            let mut events = Heard::default();
            run(Hertz, state.q, -state.v, flow, 1, &mut events);
            match events.0.as_slice() {
                [(true, out, _), (false, back, _)] => {
                    assert!(
                        (out - before).abs() < 2e-3 && (back - out - 0.04).abs() < 4e-3,
                        "{events:?}",
                        events = events.0
                    );
                    heard += 1;
                }
                other => {
                    println!("missed at {before}: {other:?}");
                    missed += 1;
                }
            }
        }
        println!("{heard} heard, {missed} missed");
        assert_eq!(missed, 0);
    }
}
