//! Any contact law: Stoermer's rule extrapolated to order 12 (Hairer, Norsett and Wanner, Solving ODEs I, II.14), steps
//! from its own error estimate, kinks by quadrature (`kink`) or, where they are grazed, by Newton's method, flights between
//! them as parabolas.

use super::flight::{behind, landing, thrown};
use super::kink::{self, TOLERANCE};
use crate::contact::ContactLaw;
use crate::roots::rising;

/// Columns of the extrapolation table: order 12.
const COLUMNS: usize = 6;

/// One step of the extrapolated Stoermer rule, of as many rows as bring its error below a bound: the new point, an estimate of
/// its error, and how many rows were left.
fn stoermer(
    contact: &ContactLaw,
    [q0, v0]: [f64; 2],
    step: f64,
    bound: f64,
) -> ([f64; 2], f64, usize) {
    let force = -contact.force(q0);
    let mut last = [[0.0; 2]; COLUMNS];
    let (mut error, mut left) = (f64::INFINITY, COLUMNS - 1);
    for row in 0..COLUMNS {
        let parts = 2 * (row + 1);
        let h = step / parts as f64;
        let mut change = h * (v0 + 0.5 * h * force);
        // Summed apart from q0, so that nothing is lost to its rounding.
        let mut moved = change;
        for _ in 1..parts {
            change -= h * h * contact.force(q0 + moved);
            moved += change;
        }
        let speed = change / h - 0.5 * h * contact.force(q0 + moved);
        let mut current = [[0.0; 2]; COLUMNS];
        current[0] = [moved, speed - v0];
        for j in 1..=row {
            let ratio = parts as f64 / (2 * (row - j + 1)) as f64;
            for d in 0..2 {
                let difference = current[j - 1][d] - last[j - 1][d];
                current[j][d] = current[j - 1][d] + difference / (ratio * ratio - 1.0);
            }
        }
        if row > 0 {
            let [a, b] = [current[row], current[row - 1]];
            error = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
        }
        (last, left) = (current, COLUMNS - 1 - row);
        if error <= bound {
            break;
        }
    }
    let [dq, dv] = last[COLUMNS - 1 - left];
    ([q0 + dq, v0 + dv], error, left)
}

/// Shortest step: below it the force is taken as it comes.
const SHORTEST: f64 = 1e-7;
/// Slowest passage of a kink: a grazing one takes no time.
const GRAZING: f64 = 1e-150;

/// Where a point is after a time.
pub(super) fn advance(contact: &ContactLaw, mut point: [f64; 2], mut left: f64) -> [f64; 2] {
    let kinks = contact.kinks();
    let flight = contact.flight().and_then(|[low, high]| {
        let acceleration = -contact.force(high);
        (acceleration > 0.0 || (acceleration == 0.0 && low.is_finite())).then_some((
            low,
            high,
            acceleration,
        ))
    });
    let mut step: f64 = 0.3;
    while left > 0.0 {
        let [q, v] = point;
        // The kinks around the point, or before it where it stands on one.
        let down = v < 0.0 || (v == 0.0 && contact.force(q) > 0.0);
        let above = kinks.partition_point(|kink| *kink < q || (*kink == q && !down));
        let low = above.checked_sub(1).map_or(f64::NEG_INFINITY, |k| kinks[k]);
        let high = kinks.get(above).copied().unwrap_or(f64::INFINITY);
        if let Some((back, loss, acceleration)) = flight
            && high <= loss
            && low >= back
        {
            let struck =
                behind(point, acceleration, back).map(|(time, speed)| (time, [back, -speed]));
            let (time, end) = struck.unwrap_or_else(|| {
                let (time, speed) = landing(point, acceleration, loss);
                (time, [loss, speed.max(GRAZING)])
            });
            // At rest without a force it stays.
            if time.is_nan() || time >= left {
                return if acceleration == 0.0 {
                    [q + v * left, v]
                } else {
                    thrown(point, acceleration, left)
                };
            }
            left -= time;
            point = end;
            continue;
        }
        let ends = if down { [high, low] } else { [low, high] };
        if let Some((time, end)) = kink::passed(contact, point, ends, [left, 2.0 * step]) {
            left -= time;
            point = end;
            continue;
        }
        let trial = step.min(left);
        let bound = TOLERANCE * q.abs().max(v.abs()).max(1.0);
        let (end, error, rows) = stoermer(contact, point, trial, bound);
        let ratio = error / bound;
        if ratio > 1.0 && trial > SHORTEST {
            step = trial * (0.8 * ratio.powf(-1.0 / 11.0)).max(0.1);
            continue;
        }
        // With rows to spare a longer step costs no more of them than there are.
        let growth = if rows > 0 {
            2.0
        } else {
            (0.8 * ratio.max(1e-12).powf(-1.0 / 11.0)).clamp(0.5, 3.0)
        };
        if end[0] < low || end[0] > high {
            let (kink, sign) = if end[0] < low {
                (low, -1.0)
            } else {
                (high, 1.0)
            };
            let (time, speed, error) = grazed(contact, point, (trial, bound), (kink, sign));
            if error > bound && time > SHORTEST {
                // Nearer to the kink first: the force may have a weak singularity there.
                step = 0.5 * time;
                continue;
            }
            left -= time;
            point = [kink, sign * (sign * speed).max(GRAZING)];
            continue;
        }
        left -= trial;
        point = end;
        step = (trial * growth).max(SHORTEST);
    }
    point
}

/// Time and velocity of the passage of a kink, upwards or downwards by `sign`, within one step, by Newton's method in a
/// bracket, and the estimated error of the step up to it.
fn grazed(
    contact: &ContactLaw,
    point: [f64; 2],
    (step, bound): (f64, f64),
    (kink, sign): (f64, f64),
) -> (f64, f64, f64) {
    let beyond = |t: f64| {
        let ([q, v], ..) = stoermer(contact, point, t, bound);
        (sign * (q - kink), sign * v)
    };
    let t = rising(beyond, [0.0, step], 0.5 * step, 1e-16 * step);
    let (end, error, _) = stoermer(contact, point, t, bound);
    (t, end[1], error)
}
