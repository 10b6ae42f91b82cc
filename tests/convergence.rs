//! Every scheme in space shows its order, against closed forms wherever there is one.

use crate::runge_kutta::RungeKutta4;
use rayon::prelude::*;
use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::{
    Axis, Density, Domain, Drift, Generator, Mesh, Observables, Settings, TimeIntegration,
    TimeScheme, transient,
};
use vibroimpact::gaussian::Gaussian;
use vibroimpact::initial::Initial;
use vibroimpact::moments::{Moments, RawMoments};
use vibroimpact::oscillator::Oscillator;

const CENTRAL: [Drift; 4] = [Drift::Order2, Drift::Order4, Drift::Order6, Drift::Order8];

/// Tolerance of the Chebyshev series in time, over a run.
const SERIES: f64 = 1e-10;

fn oscillator(contact: ContactLaw, zeta: f64, temperature: f64) -> Oscillator {
    Oscillator::new(
        contact,
        zeta,
        2.0 * zeta * temperature / std::f64::consts::PI,
    )
    .unwrap()
}

/// A run on one mesh: the generator, its exponential, the density and the observables.
struct Case {
    generator: Generator,
    series: TimeIntegration,
    density: Density,
    observables: Observables,
}

impl Case {
    fn new(it: &Oscillator, start: &Initial, domain: &Domain, drift: Drift, n: [usize; 2]) -> Self {
        let margin = drift.margin();
        let q = Axis::displacement(it.contact(), it.temperature(), domain.q, n[0], margin).unwrap();
        let v = if it.contact().is_confining() {
            Axis::velocity(domain.v[1], n[1], margin).unwrap()
        } else {
            Axis::uniform(domain.v[0], domain.v[1], n[1]).unwrap()
        };
        let mesh = Mesh { q, v };
        let generator = Generator::new(it, &mesh, drift).unwrap();
        let density = Density::start(&generator, start).unwrap();
        let observables = Observables::new(it, &mesh, drift, generator.weights()).unwrap();
        Self {
            series: transient::time_integration(
                it,
                &generator,
                TimeScheme::Explicit,
                SERIES,
                None,
                60.0,
            ),
            generator,
            density,
            observables,
        }
    }

    /// Runs explicitly for `duration`: the error in time is far below the one in space.
    fn run(&mut self, duration: f64) {
        self.series
            .advance(&mut self.density, duration, &mut |_, _| Ok(true))
            .unwrap();
    }

    fn raw(&self) -> RawMoments {
        let inverse = self.generator.inverse_weights();
        let g: Vec<f64> = self
            .density
            .cells()
            .iter()
            .zip(inverse)
            .map(|(p, w)| p * w)
            .collect();
        self.observables.raw(&g)
    }

    fn moments(&self) -> Moments {
        self.raw().moments(self.observables.contact())
    }

    /// L1 distance of the density to an exact one.
    fn l1(&self, exact: &Gaussian) -> f64 {
        let Mesh { q, v } = self.generator.mesh();
        let mut sum = 0.0;
        for i in 0..q.len() {
            for j in 0..v.len() {
                let area = q.slopes()[i] * v.slopes()[j];
                let p = exact.density(q.centres()[i], v.centres()[j]) * area;
                sum += (self.density.cells()[i * v.len() + j] - p).abs();
            }
        }
        sum
    }
}

fn order(coarse: f64, fine: f64, ratio: f64) -> f64 {
    (coarse / fine).ln() / ratio.ln()
}

/// Worst error of mean and covariance.
fn moment_error(m: &Moments, exact: &Gaussian) -> f64 {
    let c = exact.covariance;
    [
        m.mean_q.value - exact.mean[0],
        m.mean_v.value - exact.mean[1],
        m.var_q.value - c[0][0],
        m.cov_qv.value - c[0][1],
        m.var_v.value - c[1][1],
    ]
    .iter()
    .fold(0.0, |worst, e| worst.max(e.abs()))
}

#[test]
fn central_drift_reaches_orders_2_4_6_8_on_the_linear_oscillator_and_in_free_flight() {
    let cases = [
        (ContactLaw::Linear, 0.005),
        (ContactLaw::Linear, 0.5),
        (ContactLaw::Free, 0.05),
    ];
    cases.par_iter().for_each(|(contact, zeta)| {
        let zeta = *zeta;
        let it = oscillator(contact.clone(), zeta, 0.25);
        let falls = *contact == ContactLaw::Free;
        let wide = if falls { 1.6 } else { 1.0 };
        let start = Initial::gaussian([0.4, -0.2], [0.45 * wide, 0.4 * wide]).unwrap();
        let until = 1.0;
        let exact = Gaussian::of(&it, &start).unwrap();
        let exact = exact.after(&it, until).unwrap();
        for drift in CENTRAL {
            // The truncated domain of a fall is longer; at order 8 finer meshes end at its edge.
            let (meshes, neglected) = match (falls, drift) {
                (false, _) => ([80, 104], 1e-10),
                (true, Drift::Order2 | Drift::Order4) => ([140, 180], 1e-10),
                (true, Drift::Order8) => ([172, 216], 1e-12),
                (true, _) => ([160, 204], 1e-12),
            };
            let domain = if falls {
                Domain::swept(&it, &start, until, neglected).unwrap()
            } else {
                Domain::closed(&it, &start, neglected).unwrap()
            };
            let errors = meshes.map(|n| {
                let mut case = Case::new(&it, &start, &domain, drift, [n, n]);
                case.run(until);
                (case.l1(&exact), moment_error(&case.moments(), &exact))
            });
            let margin = 2 * drift.margin();
            let ratio = (meshes[1] - margin) as f64 / (meshes[0] - margin) as f64;
            let orders = [
                order(errors[0].0, errors[1].0, ratio),
                order(errors[0].1, errors[1].1, ratio),
            ];
            println!(
                "{} zeta = {zeta} {drift:?}: L1 {:.1e} order {:.2}, moments {:.1e} order {:.2}",
                contact.name(),
                errors[1].0,
                orders[0],
                errors[1].1,
                orders[1]
            );
            let claimed = drift.order() as f64;
            assert!((orders[0] - claimed).abs() < 0.3, "L1 {orders:?}");
            // The domain-truncation error, 1e-10 and its moments, ends the fall of the moments.
            if errors[1].1 > 5e-9 {
                assert!((orders[1] - claimed).abs() < 0.3, "moments {orders:?}");
            }
            let level = [2e-2, 1e-3, 1e-4, 1e-5][drift.half_width() - 1];
            assert!(
                errors[1].0 < level && errors[1].1 < 0.1 * level,
                "{errors:?}"
            );
        }
    });
}

/// Integrates dg/dt = generator + source from the exact g and returns the error in L1 weighted by p_s. The
/// mesh has `inner` cells between its margins and is graded along q as that of a Hertzian contact is.
fn manufactured(it: &Oscillator, drift: Drift, inner: [usize; 2], neglected: f64) -> f64 {
    let domain = Domain::closed(it, &Initial::Stationary, neglected).unwrap();
    let margin = drift.margin();
    let n = inner.map(|n| n + 2 * margin);
    let mesh = Mesh {
        q: Axis::displacement(&ContactLaw::Hertz, it.temperature(), domain.q, n[0], margin)
            .unwrap(),
        v: Axis::velocity(domain.v[1], n[1], margin).unwrap(),
    };
    let generator = &Generator::new(it, &mesh, drift).unwrap();
    let Mesh { q, v } = generator.mesh();
    assert!(!q.is_uniform());
    let (zeta, noise, t) = (it.zeta(), it.noise(), it.temperature());
    let (k, l) = (2.0 / t, 1.5 / t.sqrt());
    let exact = |q: f64, v: f64, t: f64| 1.0 + 0.5 * (k * q + t).sin() * (l * v + 0.3).cos();
    // g_t + v g_q - G g_v - pi h g_vv + 2 zeta v g_v of the exact g.
    let source = |q: f64, v: f64, t: f64| {
        let (s, c) = (k * q + t).sin_cos();
        let (sv, cv) = (l * v + 0.3).sin_cos();
        let g_v = -0.5 * s * l * sv;
        0.5 * c * cv * (1.0 + v * k)
            + (2.0 * zeta * v - it.contact().force(q)) * g_v
            + noise * 0.5 * s * l * l * cv
    };
    let cells: Vec<(f64, f64)> = q
        .centres()
        .iter()
        .flat_map(|q| v.centres().iter().map(move |v| (*q, *v)))
        .collect();
    let inverse = generator.inverse_weights();
    let rate = |g: &[f64], t: f64| -> Vec<f64> {
        let mut out = vec![0.0; g.len()];
        generator.apply(g, &mut out);
        out.iter()
            .zip(inverse)
            .zip(&cells)
            .map(|((r, w), (q, v))| {
                if *w > 0.0 {
                    r * w + source(*q, *v, t)
                } else {
                    0.0
                }
            })
            .collect()
    };
    let at = |g: &[f64], k: &[f64], dt: f64| -> Vec<f64> {
        g.iter().zip(k).map(|(g, k)| g + dt * k).collect()
    };
    let mut g: Vec<f64> = cells.iter().map(|(q, v)| exact(*q, *v, 0.0)).collect();
    let until = 1.0;
    // A part of the longest stable step: the error in time is then far below that of the mesh.
    let steps = (2.5 * until / RungeKutta4::new(generator).longest_step()).ceil();
    let dt = until / steps;
    for n in 0..steps as usize {
        let t = n as f64 * dt;
        let k1 = rate(&g, t);
        let k2 = rate(&at(&g, &k1, dt / 2.0), t + dt / 2.0);
        let k3 = rate(&at(&g, &k2, dt / 2.0), t + dt / 2.0);
        let k4 = rate(&at(&g, &k3, dt), t + dt);
        for (i, g) in g.iter_mut().enumerate() {
            *g += dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
    }
    let boundary = generator.boundary_cells();
    let number = generator.numbering();
    let mut error = 0.0;
    for (cell, (q, v)) in cells.iter().enumerate() {
        if number[cell] != usize::MAX && !boundary[number[cell]] {
            error += (g[cell] - exact(*q, *v, until)).abs() / inverse[cell];
        }
    }
    error
}

#[test]
fn a_manufactured_solution_on_a_mapped_mesh_shows_the_orders_until_the_kink() {
    // T = 20: the flight is long, the mesh is graded, and the loss of contact lies in the middle of the
    // law. There the force goes as x^{3/2}, so no central difference keeps an order above 5/2 + 1/2.
    let it = oscillator(ContactLaw::Hertz, 0.05, 20.0);
    for (drift, expected, level) in [
        (Drift::Order2, 2.0, 4e-3),
        (Drift::Order4, 3.3, 4e-4),
        (Drift::Order6, 3.0, 2.5e-4),
        (Drift::Order8, 2.8, 2.5e-4),
    ] {
        let errors = [[80, 64], [120, 96]].map(|n| manufactured(&it, drift, n, 1e-6));
        let observed = order(errors[0], errors[1], 1.5);
        println!("{drift:?}: error {:.1e}, order {observed:.2}", errors[1]);
        assert!(
            (observed - expected).abs() < 0.4 && errors[1] < level,
            "{drift:?} {errors:?}"
        );
    }
}

#[test]
fn without_a_kink_the_manufactured_solution_on_a_mapped_mesh_shows_orders_2_4_6_8() {
    // The same mesh, graded as for the loss of contact, and the linear law.
    let it = oscillator(ContactLaw::Linear, 0.05, 20.0);
    for (drift, level) in CENTRAL.into_iter().zip([5e-3, 1.5e-4, 8e-6, 6e-7]) {
        let errors = [[64, 52], [96, 78]].map(|n| manufactured(&it, drift, n, 1e-9));
        let observed = order(errors[0], errors[1], 1.5);
        println!("{drift:?}: error {:.1e}, order {observed:.2}", errors[1]);
        let claimed = drift.order() as f64;
        assert!(
            (observed - claimed).abs() < 0.6 && errors[1] < level,
            "{drift:?} {errors:?}"
        );
    }
}

#[test]
fn hertz_that_stays_in_contact_converges_to_itself_at_orders_2_4_6_8() {
    // T = 0.04: the truncated domain ends at q > -3/2, and there is no kink in it.
    let it = oscillator(ContactLaw::Hertz, 0.05, 0.04);
    let start = Initial::gaussian([0.1, 0.05], [0.16, 0.15]).unwrap();
    let domain = Domain::closed(&it, &start, 1e-8).unwrap();
    assert!(domain.q[0] > -1.5, "{:?}", domain.q);
    for (drift, level) in CENTRAL.into_iter().zip([3e-2, 8e-4, 2.5e-5, 8e-7]) {
        let inner = [44, 60, 82];
        let numbers = inner.map(|n| {
            let n = n + 2 * drift.margin();
            let mut case = Case::new(&it, &start, &domain, drift, [n, n]);
            case.run(3.0);
            let m = case.moments();
            let t = it.temperature();
            [
                m.mean_q.value / t.sqrt(),
                m.mean_v.value / t.sqrt(),
                m.var_q.value / t,
                m.cov_qv.value / t,
                m.var_v.value / t,
            ]
        });
        let change = |a: usize, b: usize| -> f64 {
            let pairs = numbers[a].iter().zip(numbers[b]);
            pairs.map(|(a, b)| (a - b).abs()).sum()
        };
        let observed = order(change(0, 1), change(1, 2), 1.365);
        println!(
            "{drift:?}: mean and covariance change by {:.1e}, order {observed:.2}",
            change(1, 2)
        );
        let claimed = drift.order() as f64;
        assert!(
            (observed - claimed).abs() < 0.4 && change(1, 2) < level,
            "{drift:?} {numbers:?}"
        );
    }
}

#[test]
fn hertz_with_loss_of_contact_converges_to_itself() {
    let it = oscillator(ContactLaw::Hertz, 0.005, 0.628_318_530_717_958_6);
    let start = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    let domain = Domain::closed(&it, &start, 1e-7).unwrap();
    // Smooth numbers show the order, until the kink at order 8, which the test without one shows.
    for (drift, expected, level) in [
        (Drift::Order2, 2.1, 1e-3),
        (Drift::Order4, 4.3, 2.5e-5),
        (Drift::Order6, 5.7, 7e-7),
        (Drift::Order8, f64::NAN, 6e-8),
    ] {
        let energies = [[96, 60], [136, 85], [192, 120]].map(|n| {
            let mut case = Case::new(&it, &start, &domain, drift, n);
            case.run(5.0);
            [
                case.moments().mean_energy.value,
                case.moments().mean_force.value,
            ]
        });
        let change = |a: usize, b: usize| (energies[a][0] - energies[b][0]).abs();
        let observed = order(change(0, 1), change(1, 2), 1.41);
        println!(
            "{drift:?}: E[H] changes by {:.1e}, order {observed:.2}",
            change(1, 2)
        );
        assert!(
            (expected.is_nan() || (observed - expected).abs() < 0.5) && change(1, 2) < level,
            "{drift:?} {energies:?}"
        );
    }
}

/// Scene A: Hertz, h = 2e-3, zeta = 0.005, start at (1, 0) with deviation 0.4.
/// t, E[q], E[N], std N, skew N, E[H], E[v^2] of an independent prototype. Its E[N] and std N at t = 10 are
/// midpoint sums across the loss of contact and off by 2e-5: dE[v]/dt + 2 zeta E[v] = -E[N] says so below.
#[allow(clippy::approx_constant)] // -0.3926 is a skewness, not pi/8
const SCENE_A: [[f64; 7]; 3] = [
    [
        5.0, -0.223621, -0.125884, 0.479410, -0.02399, 0.733349, 1.093982,
    ],
    [
        10.0, -1.08770, -0.752841, 0.28726, 1.4824, 0.726840, 0.279520,
    ],
    [
        20.0, 0.493075, 0.634542, 0.67746, -0.3926, 0.722197, 0.636632,
    ],
];

#[test]
fn scene_a_is_reached_on_a_small_mesh() {
    let it = oscillator(ContactLaw::Hertz, 0.005, 0.628_318_530_717_958_6);
    let start = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    let scales = [0.9, 0.747927, 0.747927, 1.0, 0.628319, 0.628319];
    for (cells, outside, tolerance) in [([160, 100], 1e-7, 1e-4_f64), ([240, 150], 1e-8, 2e-5)] {
        let domain = Domain::closed(&it, &start, outside).unwrap();
        let mut case = Case::new(&it, &start, &domain, Drift::Order8, cells);
        let mut now = 0.0;
        for reference in SCENE_A {
            case.run(reference[0] - now);
            now = reference[0];
            let (m, raw) = (case.moments(), case.raw());
            let ours = [
                m.mean_q.value,
                m.mean_force.value,
                m.std_force.value,
                m.skewness_force.value,
                m.mean_energy.value,
                raw.vv / raw.mass,
            ];
            for (k, our) in ours.iter().enumerate() {
                let error = (our - reference[k + 1]).abs() / scales[k];
                // The printed digits of the reference, and its sums across the kink.
                let digits = match now {
                    10.0 => [1e-5, 3.2e-5, 4e-5, 2.2e-4, 1e-5, 1e-5][k],
                    20.0 => [1e-5, 1e-5, 1e-5, 5e-5, 1e-5, 1e-5][k],
                    _ => 2e-5,
                };
                let limit = tolerance.max(digits);
                assert!(
                    error < limit,
                    "{cells:?} t = {now} number {k}: {our} {error:.1e}"
                );
            }
            if now == 20.0 {
                let loss = m.contact_loss_probability.unwrap().value;
                println!(
                    "{cells:?}: P(loss) = {loss:.6}, lowest p {:.1e}",
                    case.density.lowest()
                );
                assert!((loss - 0.03026).abs() < 1e-5);
            }
        }
    }
}

#[test]
fn the_mean_force_is_what_slows_the_mean_velocity() {
    // dE[v]/dt = -2 zeta E[v] - E[N], at t = 10 of scene A where a third of the law is near the kink.
    let it = oscillator(ContactLaw::Hertz, 0.005, 0.628_318_530_717_958_6);
    let start = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    let domain = Domain::closed(&it, &start, 1e-7).unwrap();
    let mut case = Case::new(&it, &start, &domain, Drift::Order8, [160, 100]);
    let step = 0.02;
    case.run(10.0 - 2.0 * step);
    let mut velocities = vec![case.moments().mean_v.value];
    let mut force = 0.0;
    for k in 1..=4 {
        case.run(step);
        velocities.push(case.moments().mean_v.value);
        if k == 2 {
            force = case.moments().mean_force.value;
        }
    }
    let [a, b, c, d, e] = velocities[..] else {
        panic!()
    };
    let slope = (a - 8.0 * b + 8.0 * d - e) / (12.0 * step);
    let implied = -slope - 2.0 * it.zeta() * c;
    println!("E[N](10) = {force:.7}, from dE[v]/dt {implied:.7}");
    assert!((force - implied).abs() < 1e-6 && (force + 0.752863).abs() < 1e-6);
}

#[test]
fn the_energy_law_holds_at_order_6_and_8_and_upwind_breaks_it() {
    // dE[H]/dt = pi h - 2 zeta E[v^2], integrated from t = 1 to 21 by Simpson's rule.
    let it = oscillator(ContactLaw::Hertz, 0.005, 0.628_318_530_717_958_6);
    let start = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    let domain = Domain::closed(&it, &start, 1e-9).unwrap();
    let energy = |r: &RawMoments| 0.5 * r.vv + r.potential;
    let rate = |r: &RawMoments| it.noise() - 2.0 * it.zeta() * r.vv;
    for drift in [Drift::Upwind, Drift::Order6, Drift::Order8] {
        // What upwind breaks, it breaks on any mesh.
        let cells = match drift {
            Drift::Upwind => [140, 90],
            _ => [210, 136],
        };
        let mut case = Case::new(&it, &start, &domain, drift, cells);
        let step = 0.0625;
        case.run(1.0);
        let begin = case.raw();
        let mut now = begin;
        let mut implied = 0.0;
        for _ in 0..160 {
            case.run(step);
            let middle = case.raw();
            case.run(step);
            let end = case.raw();
            implied += step / 3.0 * (rate(&now) + 4.0 * rate(&middle) + rate(&end));
            now = end;
        }
        let violation = (energy(&now) - energy(&begin) - implied).abs() / (20.0 * it.noise());
        println!("{drift:?}: energy law violated by {violation:.1e} pi h");
        match drift {
            Drift::Order6 | Drift::Order8 => assert!(violation < 1e-6, "{violation:e}"),
            Drift::Upwind => assert!(violation > 0.01, "{violation:e}"),
            _ => {}
        }
    }
}

#[test]
fn levels_from_1e_minus_6_to_0_3_are_steady_and_obey_the_energy_law() {
    for (h, cells) in [(0.3, [170, 76]), (1e-6, [60, 60])] {
        let it = Oscillator::new(ContactLaw::Hertz, 0.005, h).unwrap();
        let t = it.temperature();
        let steady = Settings {
            drift: Some(Drift::Order4),
            cells: Some([90, 60]),
            ..Settings::default()
        };
        let steady = vibroimpact::fokker_planck::steady(&it, &steady).unwrap();
        println!("h = {h}: steady L1 {}", steady.l1_error);
        assert!(steady.l1_error.value < 1e-9);
        let start = Initial::gaussian([0.0, 0.0], [0.6 * t.sqrt(), 0.6 * t.sqrt()]).unwrap();
        let energies = [1.0, 0.8].map(|finer: f64| {
            let n = cells.map(|n| (f64::from(n) * finer) as usize / 2 * 2);
            let domain = Domain::closed(&it, &start, 1e-7).unwrap();
            let mut case = Case::new(&it, &start, &domain, Drift::Order8, n);
            // The energy law integrated over the whole run, by Simpson's rule on short intervals.
            let (intervals, mut heat) = (240, 0.0);
            let begin = case.raw();
            let mut squares = vec![begin.vv];
            for _ in 0..intervals {
                case.run(60.0 / f64::from(intervals));
                squares.push(case.raw().vv);
            }
            for w in squares.windows(3).step_by(2) {
                heat += 60.0 / f64::from(intervals) / 3.0 * (w[0] + 4.0 * w[1] + w[2]);
            }
            let end = case.raw();
            let gain = 0.5 * end.vv + end.potential - 0.5 * begin.vv - begin.potential;
            let law = gain - (60.0 * it.noise() - 2.0 * it.zeta() * heat);
            println!("h = {h} on {n:?}: energy law off by {:.1e} T", law / t);
            assert!(law.abs() < 1e-4 * t, "{law:e}");
            let m = case.moments();
            [
                m.mean_energy.value / t,
                m.var_v.value / t,
                m.std_force.value,
            ]
        });
        for (a, b) in energies[0].iter().zip(energies[1]) {
            assert!((a - b).abs() < 1e-4 * a.abs().max(1.0), "{energies:?}");
        }
    }
}

#[test]
fn upwind_says_how_wrong_it_is_and_why() {
    // The default scene: its upwind answer is off by factors, inside its error estimates, with a warning that
    // names c.
    let it = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
    let start = Initial::gaussian([0.0, 0.0], [0.3, 0.3]).unwrap();
    let times = [5.0, 20.0, 50.0, 100.0, 200.0];
    let answer =
        |settings: &Settings| transient(&it, &start, &times, &[], settings, &|_| ()).unwrap();
    let right = answer(&Settings::default());
    let upwind = answer(&Settings {
        drift: Some(Drift::Upwind),
        ..Settings::default()
    });
    println!("{}", upwind.warnings[0]);
    assert!(
        upwind.warnings[0].contains("1 + c"),
        "{:?}",
        upwind.warnings
    );
    for ((t, ours), exact) in times.iter().zip(&upwind.moments).zip(&right.moments) {
        for ((name, a), (_, b)) in ours.named().into_iter().zip(exact.named()) {
            let (Some(a), Some(b)) = (a, b) else { continue };
            let error = (a.value - b.value).abs();
            assert!(
                error <= a.error + b.error,
                "t = {t} {name}: {a} instead of {b}"
            );
        }
        let (a, b) = (ours.mean_energy, exact.mean_energy);
        println!("t = {t}: E[H] = {a} instead of {b}");
    }
}
