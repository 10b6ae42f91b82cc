//! The motion without noise, q'' + c q' + G(q) = a cos(W t + phase): paths, and periodic orbits by shooting.

use crate::error::{Error, Result};
use crate::excitation::{Drive, Excitation};
use crate::oscillator::Oscillator;
use crate::roots::bisect;

/// Longest step of the Runge-Kutta rule, over the shortest time of the motion: its error is then below 1e-9 a unit of
/// time, but for the kink of the force at the loss of contact.
const STEP: f64 = 0.02;

/// The state (q, v) at time `end` of the motion that has `state` at time `start`, by the Runge-Kutta rule of order 4 with
/// steps of at most 0.02, and shorter ones where the drive is fast or friction strong. `watch` is shown every state on the way.
pub(crate) fn path(
    oscillator: &Oscillator,
    excitation: &Excitation,
    mut state: [f64; 2],
    [start, end]: [f64; 2],
    longest: f64,
    watch: &mut dyn FnMut([f64; 2]),
) -> [f64; 2] {
    let contact = oscillator.contact();
    let frequency = excitation.drive.map_or(1.0, |it| it.frequency().max(1.0));
    let slow = frequency.max(2.0 * oscillator.zeta());
    let steps = ((end - start) * slow / longest).ceil().max(1.0);
    let whole = (end - start) / steps;
    // Where friction is strong on the way of a whole step, parts of it.
    let parts = |[q, v]: [f64; 2]| {
        if oscillator.is_viscous() {
            return 1.0;
        }
        let there = [q, q + whole * v].map(|q| oscillator.friction(q));
        let strong = there[0].max(there[1]) / slow;
        strong.clamp(1.0, MOST_PARTS).ceil()
    };
    let on = |x: [f64; 2], k: [f64; 2], h: f64| [x[0] + h * k[0], x[1] + h * k[1]];
    // From t on by h, with the friction that is between two displacements.
    let step = |state: [f64; 2], t: f64, h: f64, side: [f64; 2]| {
        let slope = |[q, v]: [f64; 2], f: f64| {
            let friction = oscillator.friction(q.max(side[0]).min(side[1]));
            [v, f - friction * v - contact.force(q)]
        };
        let force = [0.0, 0.5, 1.0].map(|part| excitation.force(t + part * h));
        let k1 = slope(state, force[0]);
        let k2 = slope(on(state, k1, 0.5 * h), force[1]);
        let k3 = slope(on(state, k2, 0.5 * h), force[1]);
        let k4 = slope(on(state, k3, h), force[2]);
        let mean = |d: usize| (k1[d] + 2.0 * (k2[d] + k3[d]) + k4[d]) / 6.0;
        on(state, [mean(0), mean(1)], h)
    };
    // Where friction may jump.
    let jumps = if oscillator.is_viscous() {
        Vec::new()
    } else {
        contact.kinks()
    };
    let mut done = 0.0;
    while done < steps {
        let ahead = (1.0 / parts(state)).min(steps - done);
        let (mut t, mut left) = (start + done * whole, ahead * whole);
        for _ in 0..CROSSINGS {
            let above = jumps.partition_point(|jump| *jump <= state[0]);
            let low = above.checked_sub(1).map_or(f64::NEG_INFINITY, |k| jumps[k]);
            let high = jumps.get(above).copied().unwrap_or(f64::INFINITY);
            let side = [low.next_up(), high.next_down()];
            let next = step(state, t, left, side);
            let beyond = |q: f64| q < low || q >= high;
            if !beyond(next[0]) {
                state = next;
                left = 0.0;
                break;
            }
            // To the jump, and on from just beyond it: across it the rule would err by some 1e-3.
            let part = bisect(0.0, left, |h| beyond(step(state, t, h, side)[0]));
            let q = if next[0] < low { low.next_down() } else { high };
            state = [q, step(state, t, part, side)[1]];
            (t, left) = (t + part, left - part);
        }
        if left > 0.0 {
            state = step(state, t, left, [f64::NEG_INFINITY, f64::INFINITY]);
        }
        watch(state);
        done += ahead;
    }
    state
}

/// Parts of a step at most.
const MOST_PARTS: f64 = 1e6;

/// Jumps of the friction that a step may cross: more only where a motion trembles about one.
const CROSSINGS: usize = 4;

/// The state (q, v) at the second of two times of the motion without noise that has `state` at the first, to about 1e-9 a
/// unit of time and 1e-6 a loss of a Hertzian contact.
pub fn motion(
    oscillator: &Oscillator,
    excitation: &Excitation,
    state: [f64; 2],
    times: [f64; 2],
) -> [f64; 2] {
    if times[0] >= times[1] {
        return state;
    }
    path(oscillator, excitation, state, times, STEP, &mut |_| ())
}

/// How far beyond the amplitude that it begins with a motion without noise comes under a drive until `until`, as an
/// amplitude sqrt(2 (H - lowest U)): from rest, from the four ends of an oscillation of the noise, since a law that softens may
/// answer those with a larger one, and from the other wells. 0 without a drive.
pub(crate) fn swing(oscillator: &Oscillator, excitation: &Excitation, until: f64) -> f64 {
    let beyond = starts(oscillator, excitation).map(|start| {
        let highest = highest(oscillator, excitation, start, [0.0, until]).0;
        highest - amplitude(oscillator, start)
    });
    beyond.fold(0.0, f64::max)
}

/// A motion without noise that has forgotten where it began.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lasting {
    /// The largest amplitude sqrt(2 (H - lowest U)).
    pub(crate) amplitude: f64,
    /// (q, v) at phase 0.
    pub(crate) state: [f64; 2],
}

/// What lasts without noise between two times, the earlier so late that motions have forgotten where they began and a
/// multiple of the period: the orbit that motions from near rest, or from the bottom of another well, come to, and that to which
/// these or motions from far outside do if it is another one. A law that softens may have one that no motion from near rest comes to.
pub(crate) fn lasting(
    oscillator: &Oscillator,
    excitation: &Excitation,
    times: [f64; 2],
) -> (Lasting, Option<Lasting>) {
    let settle = |start| {
        let (_, state) = highest(oscillator, excitation, start, [0.0, times[0]]);
        (highest(oscillator, excitation, state, times).0, state)
    };
    let there = |it: &(f64, [f64; 2])| it.1.iter().all(|x| x.is_finite());
    let near: Vec<(f64, [f64; 2])> = starts(oscillator, excitation).map(settle).collect();
    let far = outside(oscillator, excitation).map(settle);
    let all: Vec<(f64, [f64; 2])> = near.iter().copied().chain(far).filter(there).collect();
    let smallest = all.iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let largest = all.iter().max_by(|a, b| a.0.total_cmp(&b.0));
    let differ = |a: [f64; 2], b: [f64; 2]| {
        let apart = f64::hypot(a[0] - b[0], a[1] - b[1]);
        apart > 1e-3 * b[0].hypot(b[1])
    };
    let pair = smallest.zip(largest).filter(|(a, b)| differ(a.1, b.1));
    if let Some(((small, large), drive)) = pair.zip(excitation.drive) {
        // What has not settled yet comes to the same orbit.
        let orbit = |it: &(f64, [f64; 2])| orbit(oscillator, &drive, it.1);
        if let (Ok(a), Ok(b)) = (orbit(small), orbit(large)) {
            let stable = a.multiplier < 1.0 && b.multiplier < 1.0;
            if stable && differ(a.start, b.start) {
                let lasting = |amplitude, state| Lasting { amplitude, state };
                return (lasting(small.0, a.start), Some(lasting(large.0, b.start)));
            }
        }
    }
    let amplitude = near.iter().map(|it| it.0).fold(0.0, f64::max);
    let state = near.first().map_or([0.0; 2], |it| it.1);
    (Lasting { amplitude, state }, None)
}

/// Friction of the deepest contact beyond which no motion begins: so deep it creeps back, which takes long to follow.
const STIFFEST: f64 = 1e3;

/// Where motions begin from outside: what the drive brings in a period is at most what friction takes at an rms velocity of
/// a/(2^(3/2) zeta), the amplitude a/(2 zeta) of a sine. Where flights have no friction a flight takes up 2 a/W and more, of which an
/// impact takes some 5 zeta/2 of the speed: 2/W times as much.
fn outside(oscillator: &Oscillator, excitation: &Excitation) -> impl Iterator<Item = [f64; 2]> {
    let drive = excitation.drive.filter(|it| it.amplitude() > 0.0);
    let drive = drive.zip(oscillator.contact().equilibrium());
    drive.into_iter().flat_map(move |(drive, rest)| {
        let fastest = drive.amplitude() / oscillator.reference_friction();
        let flying = (!oscillator.is_viscous()).then_some(2.0 / drive.frequency());
        let flying = flying.filter(|times| *times > 1.0);
        let parts = [1.25, 1.0, 0.75, 0.5].into_iter();
        let speeds = [Some(1.0), flying].into_iter().flatten();
        let speeds = speeds.flat_map(move |times| parts.clone().map(move |part| times * part));
        let speeds = speeds.map(move |times: f64| times * fastest);
        let creeps = |v: &f64| oscillator.highest_friction(0.5 * v * v) > STIFFEST;
        speeds.filter(move |v| !creeps(v)).flat_map(move |v| {
            let turning = oscillator.contact().turning_points(0.5 * v * v);
            let (left, right) = turning.unwrap_or((rest, rest));
            [[rest, v], [rest, -v], [left, 0.0], [right, 0.0]]
        })
    })
}

/// Where motions begin that show what a drive does; none without one.
fn starts(oscillator: &Oscillator, excitation: &Excitation) -> impl Iterator<Item = [f64; 2]> {
    let drive = excitation.drive.filter(|it| it.amplitude() > 0.0);
    let rest = drive.and_then(|_| oscillator.contact().equilibrium());
    let thermal = (2.0 * oscillator.temperature()).sqrt();
    let contact = oscillator.contact();
    let turning = contact.turning_points(oscillator.temperature());
    rest.into_iter().flat_map(move |rest| {
        let (left, right) = turning.unwrap_or((rest, rest));
        let slow = [[rest, 0.0], [left, 0.0], [right, 0.0]].into_iter();
        let thrown = [[rest, thermal], [rest, -thermal]];
        let others = contact.minima().filter(move |q| *q != rest);
        let others = others.map(|q| [q, 0.0]);
        slow.chain(thrown).chain(others)
    })
}

/// sqrt(2 (H - lowest U)).
fn amplitude(oscillator: &Oscillator, [q, v]: [f64; 2]) -> f64 {
    let lowest = oscillator.contact().lowest_potential().unwrap_or(0.0);
    (2.0 * (oscillator.energy(q, v) - lowest)).max(0.0).sqrt()
}

/// The largest amplitude on the way from one time to another, and the state there.
fn highest(
    oscillator: &Oscillator,
    excitation: &Excitation,
    start: [f64; 2],
    times: [f64; 2],
) -> (f64, [f64; 2]) {
    let mut highest = amplitude(oscillator, start);
    let mut watch = |state| highest = highest.max(amplitude(oscillator, state));
    let end = path(oscillator, excitation, start, times, COARSE, &mut watch);
    (highest, end)
}

/// The step of a path that sizes a domain.
const COARSE: f64 = 0.1;

/// A periodic orbit under a drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// (q, v) at phase 0.
    pub start: [f64; 2],
    /// The larger modulus of its two multipliers: below 1 it is stable.
    pub multiplier: f64,
    /// The amplitude of the first harmonic of q.
    pub amplitude: f64,
}

/// The periodic orbit of period 2 pi/W nearest to `guess`, the state at phase 0, by Newton's method on the map over one
/// period, to 1e-9; stable or not.
///
/// # Errors
/// [`Error::Linear`] where Newton's method ends nowhere.
pub fn orbit(oscillator: &Oscillator, drive: &Drive, guess: [f64; 2]) -> Result<Orbit> {
    const NEAR: f64 = 1e-6;
    let excitation = Excitation {
        drive: Some(*drive),
        envelope: None,
    };
    let map = |state: [f64; 2]| motion(oscillator, &excitation, state, [0.0, drive.period()]);
    let mut state = guess;
    for _ in 0..40 {
        let image = map(state);
        let residual = [image[0] - state[0], image[1] - state[1]];
        let column = |d: usize| {
            let (mut up, mut down) = (state, state);
            up[d] += NEAR;
            down[d] -= NEAR;
            let (up, down) = (map(up), map(down));
            [0, 1].map(|k| (up[k] - down[k]) / (2.0 * NEAR))
        };
        let ([a, c], [b, d]) = (column(0), column(1));
        let determinant = (1.0 - a) * (1.0 - d) - b * c;
        let move_q = ((1.0 - d) * residual[0] + b * residual[1]) / determinant;
        let move_v = (c * residual[0] + (1.0 - a) * residual[1]) / determinant;
        let size = move_q.hypot(move_v);
        if !size.is_finite() {
            break;
        }
        // No farther than the motion itself is wide.
        let part = (1.0 + state[0].hypot(state[1])).min(size) / size.max(f64::MIN_POSITIVE);
        state = [state[0] + part * move_q, state[1] + part * move_v];
        if size < 1e-9 {
            let (trace, area) = (a + d, a * d - b * c);
            let inside = 0.25 * trace * trace - area;
            let multiplier = if inside > 0.0 {
                0.5 * trace.abs() + inside.sqrt()
            } else {
                area.abs().sqrt()
            };
            return Ok(Orbit {
                start: state,
                multiplier,
                amplitude: first_harmonic(oscillator, &excitation, drive, state),
            });
        }
    }
    let what = format!("Newton's method ended nowhere from {guess:?}");
    Err(Error::linear("shooting for a periodic orbit", what))
}

/// Periodic orbits over the frequency of a drive, each with its frequency: from the motions that settle at every frequency
/// up and down, and those between them.
pub fn orbits(oscillator: &Oscillator, drive: &Drive, frequencies: &[f64]) -> Vec<(f64, Orbit)> {
    let mut found: Vec<(f64, Orbit)> = Vec::new();
    let mut up = [0.0; 2];
    let mut down = [0.0; 2];
    let mut sweep = |w: &f64, guess: &mut [f64; 2]| {
        let Ok(drive) = drive.at(*w) else {
            return;
        };
        if let Ok(it) = orbit(oscillator, &drive, *guess) {
            *guess = it.start;
            put(&mut found, *w, it);
        }
    };
    for w in frequencies {
        sweep(w, &mut up);
    }
    for w in frequencies.iter().rev() {
        sweep(w, &mut down);
    }
    // Between two of one frequency lies an unstable one.
    for w in frequencies {
        let here = found.iter().filter(|it| it.0 == *w);
        let here: Vec<Orbit> = here.map(|it| it.1).collect();
        let (Ok(drive), [a, b]) = (drive.at(*w), &here[..]) else {
            continue;
        };
        // The unstable one lags as little behind the drive as the larger lags short of half a turn: its mirror image in q.
        let [small, large] = if a.amplitude < b.amplitude {
            [a, b]
        } else {
            [b, a]
        };
        let parts = [0.5, 0.65, 0.8, 0.95, 0.35, 0.2].into_iter();
        for (sign, part) in parts.flat_map(|part| [(1.0, part), (-1.0, part)]) {
            let far = [sign * large.start[0], large.start[1]];
            let guess = [0, 1].map(|k| small.start[k] + part * (far[k] - small.start[k]));
            if let Ok(it) = orbit(oscillator, &drive, guess) {
                put(&mut found, *w, it);
            }
        }
    }
    // From where it was found it goes on to the neighbouring frequencies.
    let both_ways = frequencies.iter().chain(frequencies.iter().rev());
    let onward: Vec<f64> = both_ways.copied().collect();
    for pair in onward.windows(2) {
        let unstable = |it: &&(f64, Orbit)| it.0 == pair[0] && it.1.multiplier > 1.0;
        let known = found.iter().find(unstable).map(|it| it.1.start);
        if let (Some(guess), Ok(drive)) = (known, drive.at(pair[1]))
            && let Ok(it) = orbit(oscillator, &drive, guess)
        {
            put(&mut found, pair[1], it);
        }
    }
    found
}

/// Adds an orbit that is not there yet.
fn put(found: &mut Vec<(f64, Orbit)>, w: f64, orbit: Orbit) {
    let same = |(at, it): &(f64, Orbit)| {
        *at == w && (it.amplitude - orbit.amplitude).abs() < 1e-6 * (1.0 + orbit.amplitude)
    };
    if !found.iter().any(same) {
        found.push((w, orbit));
    }
}

fn first_harmonic(
    oscillator: &Oscillator,
    excitation: &Excitation,
    drive: &Drive,
    mut state: [f64; 2],
) -> f64 {
    const SAMPLES: u32 = 64;
    let step = drive.period() / f64::from(SAMPLES);
    let (mut cosine, mut sine) = (0.0, 0.0);
    for k in 0..SAMPLES {
        let t = step * f64::from(k);
        let (s, c) = (drive.frequency() * t).sin_cos();
        cosine += state[0] * c;
        sine += state[0] * s;
        let times = [t, t + step];
        state = path(oscillator, excitation, state, times, STEP, &mut |_| ());
    }
    2.0 / f64::from(SAMPLES) * f64::hypot(cosine, sine)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::ContactLaw;
    use crate::damping::Damping;

    #[test]
    fn the_orbit_of_a_linear_oscillator_is_its_frequency_response() {
        let it = Oscillator::new(ContactLaw::Linear, 0.05, 2e-3).unwrap();
        for w in [0.5, 0.95, 1.3] {
            let drive = Drive::new(0.3, w, 0.7).unwrap();
            let orbit = orbit(&it, &drive, [0.1, 0.0]).unwrap();
            let exact = 0.3 / (1.0 - w * w).hypot(2.0 * 0.05 * w);
            let decay = (-0.05 * drive.period()).exp();
            println!("W = {w}: {:.9}, exact {exact:.9}", orbit.amplitude);
            assert!((orbit.amplitude / exact - 1.0).abs() < 1e-7);
            assert!((orbit.multiplier / decay - 1.0).abs() < 1e-7);
        }
    }

    #[test]
    fn friction_that_jumps_at_the_loss_of_contact_leaves_the_rule_its_accuracy() {
        let drive = Drive::new(1.0, 0.8, 0.3).unwrap();
        let excitation = Excitation {
            drive: Some(drive),
            envelope: None,
        };
        for damping in [Damping::Contact, Damping::HuntCrossley] {
            let it = Oscillator::new(ContactLaw::Hertz, 0.05, 2e-3).unwrap();
            let it = it.with_damping(damping.clone()).unwrap();
            let end = |longest: f64| {
                let (mut losses, mut before) = (0, 0.0);
                let mut watch = |[q, _]: [f64; 2]| {
                    losses += u32::from(before >= -1.5 && q < -1.5);
                    before = q;
                };
                let end = path(&it, &excitation, [0.0; 2], [0.0, 60.0], longest, &mut watch);
                (end, losses)
            };
            let (fine, losses) = end(STEP / 32.0);
            let off = |longest: f64| {
                let [q, v] = end(longest).0;
                (q - fine[0]).abs().max((v - fine[1]).abs())
            };
            let errors = [4.0 * STEP, 2.0 * STEP, STEP].map(off);
            println!("{damping:?}: {losses} losses, {errors:?}");
            // What is left is the force's: its curvature is infinite where the Hertzian contact is lost.
            assert!(losses > 5 && errors[2] < 2e-5 && errors[0] > 20.0 * errors[2]);
        }
    }

    #[test]
    fn a_softening_contact_has_two_stable_orbits_and_an_unstable_one_below_its_resonance() {
        let it = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
        let drive = Drive::new(0.02, 0.95, 0.0).unwrap();
        let excitation = Excitation {
            drive: Some(drive),
            envelope: None,
        };
        let late = |start| motion(&it, &excitation, start, [0.0, 400.0 * drive.period()]);
        let small = orbit(&it, &drive, late([0.0, 0.0])).unwrap();
        let large = orbit(&it, &drive, late([1.5, 0.0])).unwrap();
        println!("{small:?} {large:?}");
        assert!(small.multiplier < 1.0 && large.multiplier < 1.0);
        assert!(large.amplitude > 1.5 * small.amplitude);
        let grid: Vec<f64> = (80..=110).map(|k| f64::from(k) / 100.0).collect();
        let all = orbits(&it, &drive, &grid);
        let between = all.iter().find(|(_, it)| it.multiplier > 1.0);
        println!("{between:?}");
        assert!(between.is_some());
    }

    #[test]
    fn the_swing_is_the_amplitude_of_the_response_and_nothing_without_a_drive() {
        let it = Oscillator::new(ContactLaw::Linear, 0.05, 2e-3).unwrap();
        let drive = Drive::new(0.3, 1.0, 0.0).unwrap();
        let excitation = Excitation {
            drive: Some(drive),
            envelope: None,
        };
        let found = swing(&it, &excitation, 200.0);
        assert!((found - 3.0).abs() < 0.1, "{found}");
        assert_eq!(swing(&it, &Excitation::default(), 200.0), 0.0);
    }
}
