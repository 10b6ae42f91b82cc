//! The undamped motion q'' + G(q) = 0: where a point is after given times, to rounding.
//!
//! - Flight, and the linear and bilinear laws: closed forms.
//! - Hertz in contact: with y = sqrt(1 + 2q/3) and dt = y d sigma the motion is polynomial,
//!   y' = v/3, v' = y - y^4, t' = y, and analytic through the loss of contact y = 0. Taylor series of
//!   order 20, eight points abreast; the loss and the wanted times are roots of the series.
//! - A force of cubic polynomials, piece by piece: Taylor series in time (`pieces`).
//! - Any other law: Stoermer's rule extrapolated to order 12 (`stoermer`), next to a kink a quadrature (`kink`).

mod flight;
mod hertz;
mod kink;
mod pieces;
mod stoermer;

use crate::contact::ContactLaw;
use crate::matrix::vectorise;
use flight::{landing, thrown};
use hertz::hertz;

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
            ContactLaw::Hertz => vectorise!(hertz(starts, times, ends)),
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

    /// The largest distance of one set of points to another.
    fn apart(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
        let both = a.iter().zip(b);
        let all = both.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
        all.fold(0.0, f64::max)
    }

    /// A contact of another power: force ~ compression^(10/9), or of a cubic spring without a loss.
    #[derive(Debug)]
    struct Power(f64);
    impl Restoring for Power {
        fn name(&self) -> &'static str {
            "own power"
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
        let difference = apart(&ends[0], &ends[1]);
        println!("Taylor against Stoermer: {difference:.1e}");
        assert!(difference < 1e-11);
    }

    /// A force that varies fast while its potential hardly does, and two kinks with contact between them, without a potential of
    /// its own.
    #[derive(Debug)]
    struct Rough(f64);
    impl Restoring for Rough {
        fn name(&self) -> &'static str {
            "rough"
        }
        fn force(&self, q: f64) -> f64 {
            let x = q.max(-1.0);
            x + 0.9 / self.0 * (self.0 * (1.0 + x)).sin() + 0.3 * (x - 0.5).max(0.0).powf(1.1)
        }
        fn loss_point(&self) -> Option<f64> {
            Some(-1.0)
        }
        fn kinks(&self) -> Vec<f64> {
            vec![-1.0, 0.5]
        }
    }

    #[test]
    fn a_force_that_varies_fast_is_followed_as_by_short_steps() {
        for rate in [1.0, 10.0, 40.0] {
            let contact = ContactLaw::custom(Rough(rate)).unwrap();
            let starts = [
                [1.2, -1.5],
                [-0.9, 3.0],
                [-1.0, 2.0],
                [0.5, 0.4],
                [0.5, -1e-9],
            ];
            let mut once = [[0.0; 2]; 5];
            Motion::new(&contact).after(&starts, &[1.7], &mut once);
            // No quadrature is longer than a step, and none is as short as these.
            let mut often = starts;
            for _ in 0..400 {
                let from = often;
                Motion::new(&contact).after(&from, &[1.7 / 400.0], &mut often);
            }
            let worst = apart(&once, &often);
            println!("rate {rate}: {worst:.1e}");
            assert!(worst < 1e-10);
        }
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
        let gear = Parameters::new().with("exponent", Parameter::Number(10.0 / 9.0));
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
            ("power", gear),
            ("polynomial", wells),
            ("table", table),
        ] {
            let contact = ContactLaw::given(law, &given).unwrap();
            let (starts, times) = (points(4.0), [0.4, 1.2, 7.0]);
            let error = drift(&contact, &starts, &times);
            let (mut there, mut back) = (starts.clone(), starts.clone());
            Motion::new(&contact).after(&starts, &times[1..2], &mut there);
            Motion::new(&contact).before(&there, &times[1..2], &mut back);
            let returned = apart(&starts, &back);
            println!("{law} {given:?}: energy to {error:.1e}, returned to {returned:.1e}");
            assert!(error < 1e-12 && returned < 1e-11);
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
            let error = apart(&starts, &back);
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
