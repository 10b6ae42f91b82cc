//! A force that is a cubic polynomial of q piece by piece: Taylor series in time of order 20, from piece to piece by
//! roots of the series. Steps from the last coefficients (Jorba and Zou, Experimental Mathematics 14:99, 2005).

use crate::contact::{Piece, place};
use crate::roots::{bisect, rising};

/// Order of the series.
const ORDER: usize = 20;
/// The last term of a step, relative to the size of the motion.
const LAST: f64 = 1e-17;

/// q - centre and v as polynomials of time.
struct Series {
    x: [f64; ORDER + 1],
    v: [f64; ORDER + 1],
}

impl Series {
    /// x' = v, v' = -G(x), coefficient by coefficient.
    fn of(piece: &Piece, [q, v0]: [f64; 2]) -> Self {
        let [c0, c1, c2, c3] = piece.coefficients;
        let mut it = Self {
            x: [0.0; ORDER + 1],
            v: [0.0; ORDER + 1],
        };
        let Self { x, v } = &mut it;
        let mut square = [0.0; ORDER + 1];
        (x[0], v[0]) = (q - piece.centre, v0);
        let curved = c2 != 0.0 || c3 != 0.0;
        for k in 0..ORDER {
            let mut force = c1 * x[k];
            if k == 0 {
                force += c0;
            }
            if curved {
                square[k] = (0..=k).map(|j| x[j] * x[k - j]).sum();
                let cube: f64 = (0..=k).map(|j| square[j] * x[k - j]).sum();
                force += c2 * square[k] + c3 * cube;
            }
            let inverse = 1.0 / (k + 1) as f64;
            x[k + 1] = v[k] * inverse;
            v[k + 1] = -force * inverse;
        }
        it
    }

    /// The longest step that keeps the last terms small.
    fn reach(&self, size: f64) -> f64 {
        let last = |k: usize| {
            let term = self.x[k].abs().max(self.v[k].abs()) / size;
            (LAST / term).powf(1.0 / k as f64)
        };
        // Nothing moves, or in a parabola: a step of a good part of a period then.
        last(ORDER).min(last(ORDER - 1)).min(2.0)
    }

    fn at(&self, t: f64) -> [f64; 2] {
        let (mut x, mut v) = (0.0f64, 0.0f64);
        for k in (0..=ORDER).rev() {
            x = x.mul_add(t, self.x[k]);
            v = v.mul_add(t, self.v[k]);
        }
        [x, v]
    }
}

/// Where a point is after a time.
pub(super) fn advance(pieces: &[Piece], mut point: [f64; 2], mut left: f64) -> [f64; 2] {
    let mut at = place(pieces, point[0]);
    // A piece is a good part of the way; only values that are no numbers get to the limit.
    for _ in 0..10_000_000 {
        if left.is_nan() || left <= 0.0 {
            break;
        }
        let [q, v] = point;
        // On an end it is in the piece that it moves into.
        let down = v < 0.0 || (v == 0.0 && pieces[at].force(q) > 0.0);
        if q == pieces[at].from && down {
            at = at.saturating_sub(1);
        }
        let piece = &pieces[at];
        let low = piece.from - piece.centre;
        let high = pieces
            .get(at + 1)
            .map_or(f64::INFINITY, |next| next.from - piece.centre);
        let series = Series::of(piece, point);
        let size = q.abs().max(v.abs()).max(1e-3);
        let reach = series.reach(size).min(left);
        match series.exit([low, high], reach) {
            None => {
                let [x, v] = series.at(reach);
                point = [piece.centre + x, v];
                left -= reach;
            }
            Some((time, up)) => {
                let [_, v] = series.at(time);
                left -= time;
                // Exactly on the end, where the next piece begins; a grazing passage takes no time.
                if up {
                    at += 1;
                    point = [pieces[at].from, v.max(1e-150)];
                } else {
                    point = [piece.from, v.min(-1e-150)];
                    at -= 1;
                }
            }
        }
    }
    point
}

impl Series {
    /// When the motion first leaves [low, high] within a step, and whether upwards.
    fn exit(&self, [low, high]: [f64; 2], step: f64) -> Option<(f64, bool)> {
        if low == f64::NEG_INFINITY && high == f64::INFINITY {
            return None;
        }
        let [x, v] = self.at(step);
        let outside = |x: f64| x < low || x > high;
        let mut end = (step, x);
        if !outside(x) {
            // It may turn beyond an end and come back.
            let turn = self.turn(v, step)?;
            let [x, _] = self.at(turn);
            if !outside(x) {
                return None;
            }
            end = (turn, x);
        } else if let Some(turn) = self.turn(v, step) {
            // Out at one end, and before that at the other.
            let [x, _] = self.at(turn);
            if outside(x) {
                end = (turn, x);
            }
        }
        let up = end.1 > high;
        let (sign, border) = if up { (1.0, high) } else { (-1.0, low) };
        let beyond = |t: f64| {
            let [x, v] = self.at(t);
            (sign * (x - border), sign * v)
        };
        Some((rising(beyond, [0.0, end.0], end.0, 1e-16 * step), up))
    }

    /// When the velocity passes 0 within a step at whose end it is `last`.
    fn turn(&self, last: f64, step: f64) -> Option<f64> {
        if self.v[0] * last >= 0.0 {
            return None;
        }
        Some(bisect(0.0, step, |t| self.at(t)[1] * last > 0.0))
    }
}
