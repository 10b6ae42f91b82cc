//! Starts that no mesh can hold: at rest, and dropped from a point. Each test prints what it measured.

use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::{Settings, TimeScheme, Transient, TransientMethod, transient};
use vibroimpact::gaussian::Gaussian;
use vibroimpact::initial::Initial;
use vibroimpact::moments::Moments;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::scales::Scales;

fn paper() -> Oscillator {
    Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap()
}

fn dropped(q: f64) -> Initial {
    Initial::gaussian([q, 0.0], [1e-3; 2]).unwrap()
}

fn to(it: &Oscillator, start: &Initial, times: &[f64], tolerance: f64) -> Transient {
    let settings = Settings {
        tolerance,
        ..Settings::default()
    };
    transient(it, start, times, &[], &settings, &|_| ()).unwrap()
}

/// The largest difference of two sets of moments over the sum of their errors, where both have one.
fn worst(a: &Moments, b: &Moments) -> (f64, &'static str) {
    let mut worst = (0.0, "");
    for ((name, x), (_, y)) in a.named().into_iter().zip(b.named()) {
        let (Some(x), Some(y)) = (x, y) else { continue };
        let ratio = (x.value - y.value).abs() / (x.error + y.error);
        if ratio > worst.0 {
            worst = (ratio, name);
        }
    }
    worst
}

#[test]
fn from_rest_the_reference_values_hold_to_2e_6() {
    let times = [0.0, 1.0, 50.0];
    let it = to(&paper(), &Initial::Rest, &times, 1e-4);
    let [zero, one, fifty] = [0, 1, 2].map(|k| it.moments[k]);
    assert_eq!((zero.var_q.value, zero.mean_energy.value), (0.0, 0.0));
    assert!(zero.skewness_force.value.is_nan(), "a point has no shape");
    let square = |m: &Moments| m.var_v.value + m.mean_v.value.powi(2);
    // An independent solver on a sinh-graded mesh, handed over from the linearised Gaussian.
    let known = [
        ("E[H], t = 1", one.mean_energy.value, 0.006_230),
        ("E[v^2], t = 1", square(&one), 0.009_059),
        ("E[q], t = 50", fifty.mean_q.value, -0.047_141),
        ("Var q, t = 50", fifty.var_q.value, 0.260_112),
        ("E[v^2], t = 50", square(&fifty), 0.243_296),
        ("E[H], t = 50", fifty.mean_energy.value, 0.247_723),
        ("std N, t = 50", fifty.std_force.value, 0.486_573),
    ];
    for (name, value, reference) in known {
        let difference = value - reference;
        println!("{name}: {value:.7}, differs by {difference:.1e}");
        assert!(difference.abs() < 2e-6, "{name}");
    }
    // d/dt E[H] = pi h - 2 zeta E[v^2], with E[v^2] = 2 pi h t at first.
    let early = to(&paper(), &Initial::Rest, &[1e-3], 1e-4).moments[0];
    let exact = paper().noise() * 1e-3 * (1.0 - 2.0 * 0.005 * 1e-3);
    let wrong = (early.mean_energy.value / exact - 1.0).abs();
    assert!(wrong < 1e-8, "E[H] at t = 1e-3 is wrong by {wrong:e}");
}

#[test]
fn a_looser_tolerance_stays_inside_its_bars() {
    let it = paper();
    for (name, start) in [
        ("rest", Initial::Rest),
        ("q = -3", dropped(-3.0)),
        ("q = 1", dropped(1.0)),
    ] {
        let times = [0.5, 2.0, 5.0, 10.0, 20.0, 50.0];
        let [loose, tight] = [1e-3, 1e-4].map(|tolerance| to(&it, &start, &times, tolerance));
        let scales = Scales::of(&it);
        for ((t, a), b) in times.iter().zip(&loose.moments).zip(&tight.moments) {
            let (ratio, number) = worst(a, b);
            let largest = a
                .named()
                .iter()
                .zip(scales.each(a))
                .filter_map(|((_, x), s)| x.map(|x| x.error / s))
                .filter(|e| e.is_finite())
                .fold(0.0, f64::max);
            println!(
                "{name}, t = {t}: {ratio:.2} of the bars ({number}), bars up to {largest:.0e}"
            );
            assert!(ratio < 1.0, "{name}, t = {t}: {number}");
        }
    }
}

#[test]
fn linear_and_free_oscillators_from_rest_keep_their_closed_form_inside_the_bar() {
    for (law, zeta, times) in [
        (ContactLaw::Linear, 0.005, [0.01, 1.0, 30.0]),
        (ContactLaw::Linear, 0.2, [0.01, 1.0, 8.0]),
        (ContactLaw::Linear, 5.0, [0.01, 0.5, 4.0]),
        (ContactLaw::Free, 0.005, [0.01, 1.0, 20.0]),
        (ContactLaw::Free, 1.0, [0.01, 1.0, 5.0]),
    ] {
        let it = Oscillator::new(law, zeta, 2e-3).unwrap();
        let answer = to(&it, &Initial::Rest, &times, 1e-4);
        let start = Gaussian::of(&it, &Initial::Rest).unwrap();
        let name = it.contact().name().to_string();
        for (t, m) in times.iter().zip(&answer.moments) {
            let exact = start.after(&it, *t).unwrap();
            let [[qq, qv], [_, vv]] = exact.covariance;
            for (number, x, y) in [
                ("E[q]", m.mean_q, exact.mean[0]),
                ("E[v]", m.mean_v, exact.mean[1]),
                ("Var q", m.var_q, qq),
                ("Cov qv", m.cov_qv, qv),
                ("Var v", m.var_v, vv),
            ] {
                let wrong = (x.value - y).abs();
                println!("{name}, zeta = {zeta}, t = {t}: {number} = {x}, wrong by {wrong:.1e}");
                assert!(wrong <= x.error, "{number}");
            }
        }
    }
}

#[test]
fn finite_volumes_take_over_from_the_same_packet() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.2, 0.08).unwrap();
    for start in [Initial::Rest, dropped(-3.0)] {
        let answer = |method, time| {
            let settings = Settings {
                method,
                time,
                ..Settings::default()
            };
            transient(&it, &start, &[0.5, 2.0, 10.0], &[], &settings, &|_| ()).unwrap()
        };
        let map = answer(None, None);
        let volumes = answer(
            Some(TransientMethod::FiniteVolume),
            Some(TimeScheme::Implicit),
        );
        assert!(map.method.name.contains("flow map"));
        for (a, b) in map.moments.iter().zip(&volumes.moments) {
            let (ratio, number) = worst(a, b);
            println!("{start:?}: {ratio:.2} of the bars, in {number}");
            assert!(ratio < 1.0, "{number}: {a:?} {b:?}");
        }
    }
}

#[test]
fn densities_of_a_packet_are_arrays_about_it_and_none_of_a_point() {
    let settings = Settings::default();
    let it = paper();
    let run = |at: f64| {
        transient(
            &it,
            &Initial::Rest,
            &[at, 2.0],
            &[at, 2.0],
            &settings,
            &|_| (),
        )
    };
    let answer = run(0.3).unwrap();
    for (snapshot, moments) in answer.densities.iter().zip(&answer.moments) {
        let width = |x: &ndarray::Array1<f64>| x[1] - x[0];
        let mass = snapshot.p.sum() * width(&snapshot.q) * width(&snapshot.v);
        let mean: f64 = snapshot
            .p
            .outer_iter()
            .zip(&snapshot.q)
            .map(|(row, q)| row.sum() * q * q)
            .sum::<f64>()
            * width(&snapshot.q)
            * width(&snapshot.v);
        let var = moments.var_q.value + moments.mean_q.value.powi(2);
        println!("t = {}: mass {mass:.6}, E[q^2] {mean:.6e}", snapshot.t);
        assert!((mass - 1.0).abs() < 1e-3 && (mean / var - 1.0).abs() < 1e-3);
    }
    let message = run(0.0).unwrap_err().to_string();
    assert!(message.contains("outputs.density_at"), "{message}");
}
