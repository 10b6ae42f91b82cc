//! The Hertz law: Taylor series of order 20 in contact, eight points abreast, and flight between.

use super::flight::{landing, thrown};

/// Points computed abreast.
const LANES: usize = 8;
/// Order of the Taylor series.
const ORDER: usize = 20;
/// Step over the radius of convergence: 0.23^20 = 2e-13.
const RATIO: f64 = 0.23;

type Lane = [f64; LANES];

/// A point in contact on its way to times[next..].
#[derive(Debug, Clone, Copy)]
struct Pressed {
    point: usize,
    y: f64,
    v: f64,
    elapsed: f64,
    next: usize,
}

/// Rounds: all arcs of contact, then all flights that follow them, until none is left.
#[inline(always)]
pub(super) fn hertz(starts: &[[f64; 2]], times: &[f64], ends: &mut [[f64; 2]]) {
    let n = starts.len();
    let mut arcs: Vec<Pressed> = Vec::with_capacity(n);
    let mut landed: Vec<Pressed> = Vec::new();
    for (point, [q, v]) in starts.iter().enumerate() {
        if *q < -1.5 {
            fly(point, [*q, *v], 0.0, 0, times, ends, n, &mut arcs);
        } else {
            let y = (1.0 + q * (2.0 / 3.0)).max(0.0).sqrt();
            arcs.push(Pressed {
                point,
                y,
                v: *v,
                elapsed: 0.0,
                next: 0,
            });
        }
    }
    while !arcs.is_empty() {
        for batch in arcs.chunks(LANES) {
            press(batch, times, ends, n, &mut landed);
        }
        std::mem::swap(&mut arcs, &mut landed);
        landed.clear();
    }
}

/// A flight from `state` at time `elapsed`: its answers, and the arc of contact that follows.
#[allow(clippy::too_many_arguments)]
#[inline(always)]
fn fly(
    point: usize,
    state: [f64; 2],
    elapsed: f64,
    mut next: usize,
    times: &[f64],
    ends: &mut [[f64; 2]],
    n: usize,
    arcs: &mut Vec<Pressed>,
) {
    let (time, speed) = landing(state, 1.0, -1.5);
    while next < times.len() && times[next] <= elapsed + time {
        ends[next * n + point] = thrown(state, 1.0, times[next] - elapsed);
        next += 1;
    }
    if next < times.len() {
        arcs.push(Pressed {
            point,
            y: 0.0,
            v: speed,
            elapsed: elapsed + time,
            next,
        });
    }
}

/// Up to eight arcs of contact, each to its last time or to its loss of contact, from where it flies.
#[inline(always)]
fn press(
    batch: &[Pressed],
    times: &[f64],
    ends: &mut [[f64; 2]],
    n: usize,
    landed: &mut Vec<Pressed>,
) {
    let at = |l: usize| batch[l.min(batch.len() - 1)];
    let mut y: Lane = std::array::from_fn(|l| at(l).y);
    let mut v: Lane = std::array::from_fn(|l| at(l).v);
    let mut elapsed: Lane = std::array::from_fn(|l| at(l).elapsed);
    let mut next: [usize; LANES] = std::array::from_fn(|l| at(l).next);
    let mut busy: [bool; LANES] = std::array::from_fn(|l| l < batch.len());
    for l in 0..LANES {
        // y = v = 0 is a fixed point of sigma time: leave it as rounding would.
        if y[l] < 1e-13 && v[l].abs() < 1e-13 {
            v[l] = 1e-13;
        }
    }
    let step = steps(&y, &v);
    let (mut cy, mut cv) = ([[0.0; LANES]; ORDER + 1], [[0.0; LANES]; ORDER + 1]);
    // A step is a good part of a bounce.
    for _ in 0..1_000_000 {
        if !busy.contains(&true) {
            break;
        }
        series(&y, &v, &mut cy, &mut cv);
        let mut reach = step;
        let (mut y_end, mut v_end, mut t_end) = evaluate(&cy, &cv, &reach);
        let lost: [bool; LANES] = std::array::from_fn(|l| busy[l] && y_end[l] < 0.0);
        if lost.contains(&true) {
            // From beyond the root Newton's method is monotone.
            for _ in 0..8 {
                let (ys, vs, _) = evaluate(&cy, &cv, &reach);
                for l in 0..LANES {
                    if lost[l] {
                        reach[l] -= 3.0 * ys[l] / vs[l];
                    }
                }
            }
            (y_end, v_end, t_end) = evaluate(&cy, &cv, &reach);
        }
        loop {
            let due: [bool; LANES] = std::array::from_fn(|l| {
                busy[l] && next[l] < times.len() && times[next[l]] <= elapsed[l] + t_end[l]
            });
            if !due.contains(&true) {
                break;
            }
            let target: Lane = std::array::from_fn(|l| {
                if due[l] {
                    times[next[l]] - elapsed[l]
                } else {
                    0.0
                }
            });
            let sigma = arrival(&target, (&y, &y_end), (&reach, &t_end), (&cy, &cv));
            let (ys, vs, ts) = evaluate(&cy, &cv, &sigma);
            for l in 0..LANES {
                if due[l] {
                    // What the root misses of the time is made up along the motion, to third order.
                    let rest = target[l] - ts[l];
                    let (y, v) = (ys[l], vs[l]);
                    let (a, b) = (1.0 - y * y * y, -y * v);
                    let q = 1.5 * (y * y - 1.0) + rest * (v + rest * (a / 2.0 + rest * b / 6.0));
                    ends[next[l] * n + batch[l].point] = [q, v + rest * (a + rest * b / 2.0)];
                    next[l] += 1;
                    busy[l] = next[l] < times.len();
                }
            }
        }
        for l in 0..LANES {
            if busy[l] && !t_end[l].is_finite() {
                for k in next[l]..times.len() {
                    ends[k * n + batch[l].point] = [f64::NAN; 2];
                }
                busy[l] = false;
            }
            if busy[l] {
                y[l] = y_end[l].max(0.0);
                v[l] = v_end[l];
                elapsed[l] += t_end[l];
                if lost[l] {
                    busy[l] = false;
                    let state = [-1.5, v[l].min(0.0)];
                    fly(
                        batch[l].point,
                        state,
                        elapsed[l],
                        next[l],
                        times,
                        ends,
                        n,
                        landed,
                    );
                }
            }
        }
    }
}

/// The sigma at which each lane's series reaches its target time, from y at both ends of the step.
#[inline(always)]
fn arrival(
    target: &Lane,
    (y, y_end): (&Lane, &Lane),
    (reach, t_end): (&Lane, &Lane),
    (cy, cv): (&[Lane; ORDER + 1], &[Lane; ORDER + 1]),
) -> Lane {
    // First guess: y a straight line over the step.
    let mut sigma: Lane = std::array::from_fn(|l| {
        let (low, high) = (y[l].max(0.0), y_end[l].max(0.0));
        let trapezoid = 0.5 * reach[l] * (low + high);
        let wanted = target[l] * trapezoid / t_end[l].max(f64::MIN_POSITIVE);
        let slope = (high - low) / reach[l];
        let root = (low * low + 2.0 * slope * wanted).max(0.0).sqrt();
        2.0 * wanted / (low + root).max(f64::MIN_POSITIVE)
    });
    // t = t_0 + y s + (v/6) s^2 + O(s^3): third order, and regular where y = 0.
    for _ in 0..2 {
        let (ys, vs, ts) = evaluate(cy, cv, &sigma);
        for l in 0..LANES {
            let rest = target[l] - ts[l];
            let yl = ys[l].max(0.0);
            let root = (yl * yl + (2.0 / 3.0) * vs[l] * rest).max(0.0).sqrt();
            let change = 2.0 * rest / (yl + root).max(1e-300);
            let moved = sigma[l] + change;
            sigma[l] = if moved > 0.0 {
                moved.min(reach[l])
            } else {
                0.5 * sigma[l]
            };
        }
    }
    sigma
}

/// The step of each lane: a part of the distance of its orbit to the singularity of y'' = (y - y^4)/3,
/// 2.49 y_max^{-3/2} at the least, with y_max from its energy.
#[inline(always)]
fn steps(y: &Lane, v: &Lane) -> Lane {
    std::array::from_fn(|l| {
        let y2 = y[l] * y[l];
        let energy = (0.5 * v[l] * v[l] + 0.6 * y2 * y2 * y[l] - 1.5 * y2 + 0.9).max(0.0);
        // The contact stiffens: q_max <= sqrt(2 E). From above Newton's method is monotone.
        let mut top = (1.0 + (2.0 / 3.0) * (2.0 * energy).sqrt()).sqrt();
        for _ in 0..4 {
            let cubed = top * top * top;
            let excess = 0.6 * cubed * top * top - 1.5 * top * top + 0.9 - energy;
            let slope = 3.0 * top * (cubed - 1.0);
            if slope > 1e-6 {
                top -= excess / slope;
            }
        }
        let top = top.max(1.0);
        RATIO * 2.49 / (top * top.sqrt())
    })
}

/// Taylor coefficients of y and v in sigma.
#[inline(always)]
fn series(y: &Lane, v: &Lane, cy: &mut [Lane; ORDER + 1], cv: &mut [Lane; ORDER + 1]) {
    let mut square = [[0.0; LANES]; ORDER + 1];
    (cy[0], cv[0]) = (*y, *v);
    for k in 0..ORDER {
        square[k] = squared(cy, k);
        let fourth = squared(&square, k);
        let inverse = 1.0 / (k + 1) as f64;
        for l in 0..LANES {
            cy[k + 1][l] = cv[k][l] * (inverse / 3.0);
            cv[k + 1][l] = (cy[k][l] - fourth[l]) * inverse;
        }
    }
}

/// Coefficient k of the square of a series.
#[inline(always)]
fn squared(a: &[Lane; ORDER + 1], k: usize) -> Lane {
    let mut sum: Lane = [0.0; LANES];
    for j in 0..k.div_ceil(2) {
        for l in 0..LANES {
            sum[l] = a[j][l].mul_add(a[k - j][l], sum[l]);
        }
    }
    for l in 0..LANES {
        sum[l] *= 2.0;
        if k.is_multiple_of(2) {
            sum[l] = a[k / 2][l].mul_add(a[k / 2][l], sum[l]);
        }
    }
    sum
}

/// 1/(k + 1).
const INVERSE: [f64; ORDER + 1] = {
    let mut inverse = [0.0; ORDER + 1];
    let mut k = 0;
    while k <= ORDER {
        inverse[k] = 1.0 / (k + 1) as f64;
        k += 1;
    }
    inverse
};

/// y, v and t at sigma.
#[inline(always)]
fn evaluate(cy: &[Lane; ORDER + 1], cv: &[Lane; ORDER + 1], sigma: &Lane) -> (Lane, Lane, Lane) {
    let (mut y, mut v, mut t) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    // Four at a time: a form that compilers turn into vectors.
    for half in [0, 4] {
        let s: [f64; 4] = std::array::from_fn(|l| sigma[half + l]);
        let (mut a, mut b, mut c) = ([0.0f64; 4], [0.0f64; 4], [0.0f64; 4]);
        for k in (0..=ORDER).rev() {
            let (yk, vk) = (&cy[k][half..half + 4], &cv[k][half..half + 4]);
            for l in 0..4 {
                a[l] = a[l].mul_add(s[l], yk[l]);
                b[l] = b[l].mul_add(s[l], vk[l]);
                c[l] = c[l].mul_add(s[l], yk[l] * INVERSE[k]);
            }
        }
        for l in 0..4 {
            (y[half + l], v[half + l], t[half + l]) = (a[l], b[l], c[l] * s[l]);
        }
    }
    (y, v, t)
}
