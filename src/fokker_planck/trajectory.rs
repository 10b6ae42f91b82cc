//! The undamped motion q'' + G(q) = 0: where a point is after given times, to rounding.
//!
//! - Flight, and the linear and bilinear laws: closed forms.
//! - Hertz in contact: with y = sqrt(1 + 2q/3) and dt = y d sigma the motion is polynomial,
//!   y' = v/3, v' = y - y^4, t' = y, and analytic through the loss of contact y = 0. Taylor series of
//!   order 20, eight points abreast; the loss and the wanted times are roots of the series.
//! - A force of cubic polynomials, piece by piece: Taylor series in time (`pieces`).
//! - Any other law: Stoermer's rule extrapolated to order 12 (`stoermer`).

mod flight;
mod pieces;
mod stoermer;

use crate::contact::ContactLaw;
use flight::{landing, thrown};

/// The undamped motion of a contact law.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion<'a> {
    contact: &'a ContactLaw,
}

impl<'a> Motion<'a> {
    pub(crate) fn new(contact: &'a ContactLaw) -> Self {
        Self { contact }
    }

    /// Where each start (q, v) is after each of the `times` (ascending, not negative): start k after
    /// time d at `ends[d * starts.len() + k]`. The energy is kept to 1e-12, relative to the larger of 1
    /// and itself; a law from code keeps it to 1e-12 where its force is smooth away from the loss.
    ///
    /// # Panics
    /// If `ends` is shorter than the answer.
    pub(crate) fn after(self, starts: &[[f64; 2]], times: &[f64], ends: &mut [[f64; 2]]) {
        assert!(ends.len() >= starts.len() * times.len());
        debug_assert!(times.windows(2).all(|w| w[0] <= w[1]));
        if times.is_empty() {
            return;
        }
        match self.contact {
            ContactLaw::Hertz => pulp::Arch::new().dispatch(Hertz {
                starts,
                times,
                ends,
            }),
            contact => {
                for (k, start) in starts.iter().enumerate() {
                    let (mut point, mut elapsed) = (*start, 0.0);
                    for (d, time) in times.iter().enumerate() {
                        point = match contact {
                            ContactLaw::Linear => rotated(point, time - elapsed),
                            ContactLaw::Bilinear => bilinear(point, time - elapsed),
                            ContactLaw::Free => thrown(point, 1.0, time - elapsed),
                            other if other.pieces().is_empty() => {
                                stoermer::advance(other, point, time - elapsed)
                            }
                            other => pieces::advance(other.pieces(), point, time - elapsed),
                        };
                        elapsed = *time;
                        ends[d * starts.len() + k] = point;
                    }
                }
            }
        }
    }

    /// Where each start was: the same motion with the velocity reversed before and after.
    ///
    /// # Panics
    /// As [`Motion::after`].
    pub(crate) fn before(self, starts: &[[f64; 2]], times: &[f64], ends: &mut [[f64; 2]]) {
        let reversed: Vec<[f64; 2]> = starts.iter().map(|[q, v]| [*q, -v]).collect();
        self.after(&reversed, times, ends);
        for end in &mut ends[..starts.len() * times.len()] {
            end[1] = -end[1];
        }
    }
}

/// Under G = q.
fn rotated([q, v]: [f64; 2], t: f64) -> [f64; 2] {
    let (s, c) = t.sin_cos();
    [q * c + v * s, v * c - q * s]
}

/// Under the bilinear law: arcs of a circle in contact, parabolas below q = -1.
fn bilinear(mut point: [f64; 2], mut left: f64) -> [f64; 2] {
    // Two events a period of at least pi.
    for _ in 0..1_000_000 {
        let [q, v] = point;
        if q < -1.0 || (q == -1.0 && v < 0.0) {
            let (time, speed) = landing(point, 1.0, -1.0);
            if time >= left {
                return thrown(point, 1.0, left);
            }
            left -= time;
            point = [-1.0, speed];
        } else {
            let amplitude = q.hypot(v);
            // q = A cos(theta), v = -A sin(theta), theta = t + theta_0 up to the loss at cos = -1/A.
            let last = (-1.0 / amplitude.max(1.0)).acos();
            let time = last - (-v).atan2(q).max(-last);
            if amplitude <= 1.0 || time >= left {
                return rotated(point, left);
            }
            left -= time;
            point = [-1.0, -(amplitude * amplitude - 1.0).sqrt()];
            // A grazing pass: its flight takes no time.
            if point[1] > -1e-150 {
                point = [-1.0, 1e-150];
            }
        }
    }
    point
}

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

/// The Hertz law. A type, since a closure would not be compiled for the CPU.
struct Hertz<'a> {
    starts: &'a [[f64; 2]],
    times: &'a [f64],
    ends: &'a mut [[f64; 2]],
}

impl pulp::WithSimd for Hertz<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        hertz(self.starts, self.times, self.ends);
    }
}

/// Rounds: all arcs of contact, then all flights that follow them, until none is left.
#[inline(always)]
fn hertz(starts: &[[f64; 2]], times: &[f64], ends: &mut [[f64; 2]]) {
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
    // A step is a good part of a bounce; only values that are no numbers get to the limit.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::{Parameter, Parameters, Restoring};

    /// Points in contact, at the loss, in flight, slow and fast.
    fn points(reach: f64) -> Vec<[f64; 2]> {
        let mut points = Vec::new();
        for i in -30..=30 {
            for j in -30..=30 {
                let (x, y) = (f64::from(i) / 30.0, f64::from(j) / 30.0);
                points.push([reach * x * x.abs() - 0.3 * reach, reach * y * y.abs()]);
            }
        }
        points.extend([
            [-1.5, 0.0],
            [-1.5, 1.0],
            [-1.5, -1.0],
            [-1.0, 0.0],
            [0.0, 0.0],
        ]);
        points
    }

    /// Largest error of the energy, relative to the larger of 1 and itself.
    fn drift(contact: &ContactLaw, starts: &[[f64; 2]], times: &[f64]) -> f64 {
        let energy = |[q, v]: [f64; 2]| 0.5 * v * v + contact.potential(q);
        let mut ends = vec![[f64::NAN; 2]; starts.len() * times.len()];
        Motion::new(contact).after(starts, times, &mut ends);
        ends.iter()
            .enumerate()
            .map(|(k, end)| {
                let before = energy(starts[k % starts.len()]);
                let error = (energy(*end) - before).abs() / before.abs().max(1.0);
                assert!(error.is_finite(), "{:?} {end:?}", starts[k % starts.len()]);
                error
            })
            .fold(0.0, f64::max)
    }

    /// A contact of another power: force ~ compression^(10/9), or of a cubic spring without a loss.
    #[derive(Debug)]
    struct Power(f64);
    impl Restoring for Power {
        fn name(&self) -> &'static str {
            "power"
        }
        fn force(&self, q: f64) -> f64 {
            (1.0 + q / self.0).max(0.0).powf(self.0) - 1.0
        }
        fn potential(&self, q: f64) -> f64 {
            let n = self.0;
            let x = (1.0 + q / n).max(0.0);
            n / (n + 1.0) * (x.powf(n + 1.0) - 1.0) - q
        }
        fn loss_point(&self) -> Option<f64> {
            Some(-self.0)
        }
    }

    #[test]
    fn the_undamped_motion_keeps_its_energy() {
        let times = [0.0, 0.1, 0.42, 0.85, 1.15, 3.0, 20.0];
        for contact in [
            ContactLaw::Hertz,
            ContactLaw::Bilinear,
            ContactLaw::Linear,
            ContactLaw::Free,
        ] {
            for reach in [1e-3, 0.1, 4.0, 60.0] {
                let error = drift(&contact, &points(reach), &times);
                println!("{} within {reach}: energy to {error:.1e}", contact.name());
                assert!(error < 1e-12);
            }
        }
    }

    #[test]
    fn a_law_from_code_keeps_its_energy_and_agrees_with_the_built_in_one() {
        for n in [1.5, 10.0 / 9.0, 2.0, 2.5] {
            let custom = ContactLaw::custom(Power(n)).unwrap();
            let error = drift(&custom, &points(4.0), &[0.4, 1.2]);
            println!("power {n:.3}: energy to {error:.1e}");
            assert!(error < 1e-12);
        }
        let custom = ContactLaw::custom(Power(1.5)).unwrap();
        let (starts, times) = (points(4.0), [0.4, 1.2, 6.0]);
        let mut ends = [
            vec![[0.0; 2]; 3 * starts.len()],
            vec![[0.0; 2]; 3 * starts.len()],
        ];
        Motion::new(&custom).after(&starts, &times, &mut ends[0]);
        Motion::new(&ContactLaw::Hertz).after(&starts, &times, &mut ends[1]);
        let difference = ends[0]
            .iter()
            .zip(&ends[1])
            .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
            .fold(0.0, f64::max);
        println!("Taylor against Stoermer: {difference:.1e}");
        assert!(difference < 1e-10);
    }

    #[test]
    fn several_kinks_and_wells_keep_the_energy_and_the_motion_returns() {
        let two = Parameters::new()
            .with("exponent", Parameter::Number(1.5))
            .with("gap", Parameter::Number(1.2))
            .with("back", Parameter::Number(0.7));
        let soft = Parameters::new()
            .with("exponent", Parameter::Number(1.0))
            .with("gap", Parameter::Number(0.0))
            .with("back", Parameter::Number(3.0));
        let wells =
            Parameters::new().with("coefficients", Parameter::Numbers(vec![-1.0, 0.2, 0.8]));
        let q: Vec<f64> = (-20..=20).map(|k| 0.3 * f64::from(k)).collect();
        let force = q.iter().map(|q| q + 0.5 * (2.0 * q).sin()).collect();
        let table = Parameters::new()
            .with("q", Parameter::Numbers(q))
            .with("force", Parameter::Numbers(force));
        for (law, given) in [
            ("power", two),
            ("power", soft),
            ("polynomial", wells),
            ("table", table),
        ] {
            let contact = ContactLaw::given(law, &given).unwrap();
            let (starts, times) = (points(4.0), [0.4, 1.2, 7.0]);
            let error = drift(&contact, &starts, &times);
            let (mut there, mut back) = (starts.clone(), starts.clone());
            Motion::new(&contact).after(&starts, &times[1..2], &mut there);
            Motion::new(&contact).before(&there, &times[1..2], &mut back);
            let apart = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).hypot(a[1] - b[1]);
            let returned = starts.iter().zip(&back).map(apart).fold(0.0, f64::max);
            println!("{law} {given:?}: energy to {error:.1e}, returned to {returned:.1e}");
            assert!(error < 1e-12 && returned < 1e-9);
        }
    }

    #[test]
    fn the_series_of_a_polynomial_and_the_extrapolated_rule_agree() {
        let cubic =
            Parameters::new().with("coefficients", Parameter::Numbers(vec![1.0, -0.3, 0.4]));
        let cubic = ContactLaw::given("polynomial", &cubic).unwrap();
        let worst = points(3.0)
            .into_iter()
            .map(|start| {
                let a = pieces::advance(cubic.pieces(), start, 2.0);
                let b = stoermer::advance(&cubic, start, 2.0);
                (a[0] - b[0]).hypot(a[1] - b[1])
            })
            .fold(0.0, f64::max);
        println!("Taylor against Stoermer: {worst:.1e}");
        assert!(worst < 1e-11);
    }

    #[test]
    fn no_time_is_no_work() {
        for contact in [ContactLaw::Hertz, ContactLaw::Bilinear] {
            Motion::new(&contact).after(&points(1.0), &[], &mut []);
        }
    }

    #[test]
    fn motion_back_and_forth_returns_to_its_start() {
        for contact in [ContactLaw::Hertz, ContactLaw::Bilinear] {
            let (starts, times) = (points(4.0), [2.7]);
            let (mut there, mut back) = (starts.clone(), starts.clone());
            Motion::new(&contact).after(&starts, &times, &mut there);
            Motion::new(&contact).before(&there, &times, &mut back);
            let error = starts
                .iter()
                .zip(&back)
                .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
                .fold(0.0, f64::max);
            println!("{}: returned to {error:.1e}", contact.name());
            assert!(error < 1e-10);
        }
    }

    #[test]
    fn a_bounce_takes_the_time_of_its_quadrature() {
        // Full period of the Hertz orbit with energy E > 9/10: flight 2 v_loss, contact by quadrature in
        // the angle q = centre + half sin(a), which removes the two end points.
        let contact = ContactLaw::Hertz;
        let energy = 2.0;
        let (_, right) = contact.turning_points(energy).unwrap();
        let speed = (2.0f64 * (energy - 0.9)).sqrt();
        // q = right - (right + 3/2) s^2, from the turning point to the loss.
        let width = right + 1.5;
        let slowness = |s: f64| {
            let q = right - width * s * s;
            let v2 = 2.0 * (energy - contact.potential(q));
            if s < 1e-5 {
                // v^2 = 2 G(right) width s^2.
                return 2.0 * width / (2.0 * contact.force(right) * width).sqrt();
            }
            2.0 * width * s / v2.sqrt()
        };
        let half = crate::quadrature::integrate(slowness, &[1e-4, 1.0], 1e-13).value
            + 1e-4 * slowness(0.0);
        let mut ends = [[0.0; 2]; 1];
        let start = [right, 0.0];
        Motion::new(&contact).after(&[start], &[2.0 * half + 2.0 * speed], &mut ends);
        println!("after one period {:?} from {start:?}", ends[0]);
        assert!((ends[0][0] - right).abs() < 1e-9 && ends[0][1].abs() < 1e-6);
    }
}
