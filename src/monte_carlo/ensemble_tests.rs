use super::super::Noise;
use super::super::statistics::proportion;
use super::*;
use crate::contact::{ContactLaw, Restoring};
use crate::estimate::Estimate;

fn hertz(zeta: f64, temperature: f64) -> Oscillator {
    Oscillator::new(
        ContactLaw::Hertz,
        zeta,
        temperature * 2.0 * zeta / std::f64::consts::PI,
    )
    .unwrap()
}

const PAPER: f64 = 0.628_318_530_717_958_6;

fn settings(paths: u64) -> Sampling {
    Sampling {
        paths,
        ..Sampling::default()
    }
}

fn quiet(_: f64) {}

/// Bits of every number, so that NaN compares too.
fn bits(result: &EnsembleResult) -> Vec<u64> {
    let numbers = result.moments.iter().flat_map(Moments::named);
    numbers
        .filter_map(|(_, x)| x)
        .flat_map(|x| [x.value.to_bits(), x.error.to_bits()])
        .collect()
}

#[test]
fn the_results_have_the_same_bits_on_any_number_of_threads() {
    let it = hertz(0.005, PAPER);
    let go = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            bits(
                &run(
                    &it,
                    &Initial::Rest,
                    &[0.0, 1.0, 7.3],
                    &settings(5_003),
                    &quiet,
                )
                .unwrap(),
            )
        })
    };
    let one = go(1);
    assert_eq!(one, go(2));
    assert_eq!(one, go(5));
}

#[test]
fn path_k_is_the_same_path_in_a_small_and_in_a_large_ensemble() {
    let it = hertz(0.005, PAPER);
    let initial = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    let states = |paths: u64| {
        struct States<'a>(&'a Plan);
        impl WithLaw for States<'_> {
            type Output = Vec<(f64, f64)>;
            fn with<L: Law>(self, law: L) -> Self::Output {
                let mut states = Vec::new();
                let run = Ensemble {
                    plan: self.0,
                    progress: &Progress::new(1, &quiet),
                };
                run.block(law, 0, |_, q, v| {
                    states.extend(q.iter().copied().zip(v.iter().copied()));
                });
                states
            }
        }
        let plan = Plan::new(&it, &initial, &[3.0], &settings(paths)).unwrap();
        law::dispatch(it.contact(), States(&plan))
    };
    assert_eq!(states(10), states(1000)[..10]);
}

#[test]
fn a_gaussian_stays_the_gaussian_of_the_moment_equations_under_a_linear_contact() {
    // m' = A m, C' = A C + C A^T + diag(0, 2 pi h), A = [[0, 1], [-1, -2 zeta]].
    for zeta in [0.02, 0.5, 3.0, 50.0] {
        let it = Oscillator::new(ContactLaw::Linear, zeta, 0.01).unwrap();
        let initial = Initial::gaussian([1.0, -0.5], [0.3, 0.6]).unwrap();
        let times = [0.7, 3.0, 11.0];
        let got = run(&it, &initial, &times, &settings(100_000), &quiet).unwrap();
        let mut x = [1.0, -0.5, 0.09, 0.0, 0.36];
        let rate = |[m, n, a, b, c]: [f64; 5]| {
            let friction = 2.0 * zeta;
            [
                n,
                -m - friction * n,
                2.0 * b,
                c - a - friction * b,
                -2.0 * b - 2.0 * friction * c + 2.0 * it.noise(),
            ]
        };
        let (mut now, dt) = (0.0, if zeta > 10.0 { 1e-4 } else { 1e-3 });
        let mut worst: f64 = 0.0;
        for (time, m) in times.iter().zip(&got.moments) {
            while now < time - 0.5 * dt {
                let add =
                    |x: [f64; 5], k: [f64; 5], s: f64| std::array::from_fn(|i| x[i] + s * k[i]);
                let k1 = rate(x);
                let k2 = rate(add(x, k1, 0.5 * dt));
                let k3 = rate(add(x, k2, 0.5 * dt));
                let k4 = rate(add(x, k3, dt));
                x = std::array::from_fn(|i| {
                    x[i] + dt / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
                });
                now += dt;
            }
            let got = [m.mean_q, m.mean_v, m.var_q, m.cov_qv, m.var_v];
            for k in 0..5 {
                worst = worst.max(((got[k].value - x[k]) / got[k].error).abs());
            }
        }
        println!(
            "zeta = {zeta}: worst {worst:.2} standard errors of 15, step {}",
            got.step
        );
        assert!(worst < 4.0);
    }
}

#[test]
fn free_flight_is_a_gaussian_on_a_parabola() {
    // Friction-free limit: E[q] = t + t^2/2 from q = 0, v = 1; Var v = 2 pi h t to first order in zeta.
    let it = Oscillator::new(ContactLaw::Free, 1e-6, 1e-3).unwrap();
    let initial = Initial::gaussian([0.0, 1.0], [1e-3, 1e-3]).unwrap();
    let got = run(&it, &initial, &[4.0], &settings(20_000), &quiet).unwrap();
    let m = &got.moments[0];
    let z = [
        (m.mean_q.value - 12.0) / m.mean_q.error,
        (m.mean_v.value - 5.0) / m.mean_v.error,
        (m.var_v.value - (1e-6 + 8.0 * it.noise())) / m.var_v.error,
    ];
    println!(
        "standard errors {z:.2?}, skewness of a constant force {}",
        m.skewness_force.value
    );
    assert!(z.iter().all(|z| z.abs() < 4.0));
    assert!(m.contact_loss_probability.is_none() && m.std_force.value == 0.0);
    assert!(run(&it, &Initial::Stationary, &[1.0], &settings(10), &quiet).is_err());
}

#[test]
fn a_tiny_deviation_about_a_large_mean_keeps_its_digits() {
    let it = Oscillator::new(ContactLaw::Linear, 1e-3, 1e-30).unwrap();
    let initial = Initial::gaussian([1.0, 0.0], [1e-9, 1e-9]).unwrap();
    let got = run(&it, &initial, &[0.0], &settings(20_000), &quiet).unwrap();
    let m = &got.moments[0];
    println!("Var q = {}, kurtosis of N {}", m.var_q, m.kurtosis_force);
    assert!((m.var_q.value - 1e-18).abs() < 4.0 * m.var_q.error && m.var_q.error < 2e-20);
    assert!((m.kurtosis_force.value - 3.0).abs() < 4.0 * m.kurtosis_force.error);
}

#[test]
fn stiff_and_extreme_oscillators_stay_finite() {
    for (zeta, h, end) in [
        (1e-6, 1e-6, 3.0),
        (1e3, 2e-3, 0.02),
        (5.0, 0.3, 1.0),
        (0.005, 0.3, 30.0),
    ] {
        for contact in [ContactLaw::Hertz, ContactLaw::Bilinear, ContactLaw::Linear] {
            let it = Oscillator::new(contact, zeta, h).unwrap();
            let got = run(&it, &Initial::Stationary, &[end], &settings(2_000), &quiet).unwrap();
            let z = (got.moments[0].var_v.value - it.temperature()) / got.moments[0].var_v.error;
            println!(
                "{} zeta {zeta} h {h}: Var v {z:.2} standard errors off, step {}",
                it.contact().name(),
                got.step
            );
            assert!(z.abs() < 4.0 && got.warnings.is_empty());
        }
    }
}

#[derive(Debug)]
struct HertzByHand;

impl Restoring for HertzByHand {
    fn name(&self) -> &'static str {
        "hertz by hand"
    }
    fn force(&self, q: f64) -> f64 {
        ContactLaw::Hertz.force(q)
    }
    fn loss_point(&self) -> Option<f64> {
        Some(-1.5)
    }
}

#[test]
fn a_law_from_code_walks_the_same_paths_as_the_law_built_in() {
    let custom = ContactLaw::custom(HertzByHand).unwrap();
    let h = 2e-3;
    let [built_in, by_hand] = [ContactLaw::Hertz, custom].map(|contact| {
        let it = Oscillator::new(contact, 0.005, h).unwrap();
        let chosen = Sampling {
            scheme: Scheme::Baoab,
            ..settings(100)
        };
        run(&it, &Initial::Rest, &[0.0, 20.0], &chosen, &quiet).unwrap()
    });
    for (a, b) in built_in.moments.iter().zip(&by_hand.moments) {
        assert_eq!((a.mean_q, a.std_force), (b.mean_q, b.std_force));
        assert!((a.mean_energy.value - b.mean_energy.value).abs() < 1e-12);
    }
}

#[test]
fn no_loss_seen_is_not_no_error_and_few_paths_are_refused() {
    let it = hertz(0.005, 1e-3);
    let got = run(&it, &Initial::Stationary, &[0.0], &settings(1000), &quiet).unwrap();
    let loss = got.moments[0].contact_loss_probability.unwrap();
    println!("P(loss) = {loss}");
    assert!(loss.value == 0.0 && (loss.error * 1000.0 - 2.0).abs() < 0.01);
    for (bad, key) in [
        (settings(1), "monte_carlo.paths"),
        (
            Sampling {
                step: Some(0.0),
                ..settings(10)
            },
            "monte_carlo.step",
        ),
        (
            Sampling {
                step: Some(1e-300),
                ..settings(10)
            },
            "monte_carlo.step",
        ),
    ] {
        let message = run(&it, &Initial::Rest, &[1.0], &bad, &quiet)
            .unwrap_err()
            .to_string();
        assert!(message.contains(key), "{message}");
    }
    for times in [
        [2.0, 1.0],
        [-1.0, 1.0],
        [0.0, f64::NAN],
        [1.0, f64::INFINITY],
    ] {
        let error = run(&it, &Initial::Rest, &times, &settings(10), &quiet).unwrap_err();
        assert!(error.to_string().contains("outputs.moments_at"), "{error}");
    }
}

#[test]
fn few_hits_lie_three_standard_errors_off_no_more_often_than_a_gaussian_does() {
    // Summed over the Poisson law of the hits of n paths: nothing is sampled.
    let n = 1e5;
    for expected in [0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0, 300.0] {
        let (mut square, mut far, mut plain) = (0.0, 0.0, 0.0);
        let mut probability = f64::exp(-expected);
        for hits in 0..2000 {
            let hits = f64::from(hits);
            let z = (hits - expected) / (n * proportion(hits, n).error);
            square += probability * z * z;
            if z.abs() > 3.0 {
                far += probability;
            }
            if (hits - expected).abs() > 3.0 * hits.max(1.0).sqrt() {
                plain += probability;
            }
            probability *= expected / (hits + 1.0);
        }
        println!(
            "{expected} hits expected: rms {:.2} standard errors, beyond three {far:.1e}, of sqrt(k) {plain:.1e}",
            square.sqrt()
        );
        // 2.7e-3 of a Gaussian.
        assert!(far < 2.7e-3 && square < 1.0);
        // Never wide without need: at most half as much again where there is a standard error to speak of.
        assert!(expected < 5.0 || square > 0.44);
    }
    // Hits and misses are alike.
    let (few, many) = (proportion(3.0, 500.0).error, proportion(497.0, 500.0).error);
    assert!((few / many - 1.0).abs() < 1e-12);
}

#[test]
fn standard_errors_are_the_spread_of_independent_ensembles() {
    let it = hertz(0.05, PAPER);
    let runs: Vec<Moments> = (0..300)
        .map(|seed| {
            let chosen = Sampling {
                seed,
                ..settings(2_000)
            };
            run(&it, &Initial::Stationary, &[0.0], &chosen, &quiet)
                .unwrap()
                .moments[0]
        })
        .collect();
    for k in 0..11 {
        let numbers: Vec<Estimate> = runs.iter().map(|m| m.named()[k].1.unwrap()).collect();
        let n = numbers.len() as f64;
        let mean = numbers.iter().map(|x| x.value).sum::<f64>() / n;
        let spread = (numbers
            .iter()
            .map(|x| (x.value - mean).powi(2))
            .sum::<f64>()
            / (n - 1.0))
            .sqrt();
        let stated = (numbers.iter().map(|x| x.error.powi(2)).sum::<f64>() / n).sqrt();
        println!(
            "{}: stated {stated:.3e}, seen {spread:.3e}",
            runs[0].named()[k].0
        );
        assert!((stated / spread - 1.0).abs() < 0.2);
    }
}

#[test]
fn a_wide_band_of_cosines_drives_the_oscillator_as_white_noise_does() {
    // From rest, G = q, weak friction: only the density near w = 1 counts; the band limit costs O(1/band).
    let it = Oscillator::new(ContactLaw::Linear, 0.05, 0.01).unwrap();
    let cosines = Sampling {
        noise: Noise::Cosines {
            count: 200,
            band: 16.0,
        },
        ..settings(4_000)
    };
    let got = run(&it, &Initial::Rest, &[10.0, 40.0], &cosines, &quiet).unwrap();
    let white = run(
        &it,
        &Initial::Rest,
        &[10.0, 40.0],
        &settings(100_000),
        &quiet,
    )
    .unwrap();
    for (k, (a, b)) in got.moments.iter().zip(&white.moments).enumerate() {
        println!(
            "t = {}: Var q {} against {}, Var v {} against {}, kurtosis {}",
            got.times[k], a.var_q, b.var_q, a.var_v, b.var_v, a.kurtosis_force
        );
        // Missing above the band: 2 h/(pi... ) of Var v, integral of 2h/w^2 from 16 = h/8.
        assert!((a.var_q.value - b.var_q.value).abs() < 4.0 * a.var_q.error.hypot(b.var_q.error));
        assert!(
            (a.var_v.value + 0.01 / 8.0 - b.var_v.value).abs()
                < 4.0 * a.var_v.error.hypot(b.var_v.error) + 0.01 / 16.0
        );
        assert!((a.kurtosis_force.value - 3.0).abs() < 4.0 * a.kurtosis_force.error + 0.05);
    }
    let wrong = Sampling {
        scheme: Scheme::Baoab,
        ..cosines
    };
    let message = run(&it, &Initial::Rest, &[1.0], &wrong, &quiet)
        .unwrap_err()
        .to_string();
    assert!(message.contains("central_difference"), "{message}");
}

#[test]
fn few_cosines_raise_the_kurtosis_as_the_warning_says() {
    let it = Oscillator::new(ContactLaw::Linear, 0.05, 0.01).unwrap();
    // M, and the excess kurtosis 3 B/(4 pi zeta M) of its warning.
    for (count, expected) in [(40, Some("1.91")), (200, Some("0.38")), (4000, None)] {
        let cosines = Sampling {
            noise: Noise::Cosines { count, band: 16.0 },
            ..settings(if count > 1000 { 160 } else { 8_000 })
        };
        let got = run(&it, &Initial::Rest, &[80.0], &cosines, &quiet).unwrap();
        let kurtosis = got.moments[0].kurtosis_force;
        println!("{count} cosines: kurtosis {kurtosis}, {:?}", got.warnings);
        let warning = got.warnings.iter().find(|it| it.text.contains("cosines"));
        match expected {
            None => assert!(warning.is_none()),
            Some(excess) => {
                assert!(warning.is_some_and(|it| it.text.contains(excess)));
                let excess: f64 = excess.parse().unwrap();
                let miss = (kurtosis.value - 3.0 - excess).abs();
                assert!(miss < 0.2 * excess + 4.0 * kurtosis.error);
            }
        }
    }
}
