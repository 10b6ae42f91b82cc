//! Ensembles and long realisations against closed forms and against each other, through the library's public interface.

#![allow(clippy::print_stdout, missing_docs)]

use vibroimpact::Error;
use vibroimpact::contact::{ContactLaw, Restoring};
use vibroimpact::estimate::Estimate;
use vibroimpact::initial::Initial;
use vibroimpact::moments::{Moment, Moments};
use vibroimpact::monte_carlo::{
    EnsembleResult, Noise, RecordResult, Samples, Sampling, Scheme, first_loss, records, run,
    series,
};
use vibroimpact::oscillator::{Oscillator, Quantity};
use vibroimpact::plan::Plan;
use vibroimpact::scene::text::SceneText;
use vibroimpact::stationary::Stationary;

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
    assert_eq!([m.mean_force.value, m.mean_force.error], [-1.0, 0.0]);
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
    // As paths take it, to the last bit.
    fn force(&self, q: f64) -> f64 {
        let x = (1.0 + q * (2.0 / 3.0)).max(0.0);
        x * x.sqrt() - 1.0
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
    let it = Oscillator::new(ContactLaw::Linear, 0.1, 0.02).unwrap();
    // M, and the excess kurtosis 3 B/(4 pi zeta M) of its warning.
    for (count, expected) in [(20, Some("1.91")), (100, Some("0.38")), (2000, None)] {
        let cosines = Sampling {
            noise: Noise::Cosines { count, band: 16.0 },
            ..settings(if count > 1000 { 160 } else { 8_000 })
        };
        let got = run(&it, &Initial::Rest, &[40.0], &cosines, &quiet).unwrap();
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

fn bits_of_records(result: &RecordResult) -> Vec<u64> {
    let moments = [result.moments, result.controlled];
    let numbers = moments
        .iter()
        .flat_map(Moments::named)
        .filter_map(|(_, x)| x);
    let densities = result
        .force
        .density
        .iter()
        .chain(&result.displacement.density);
    let crossings = result.crossings.as_ref().unwrap();
    let flights = crossings
        .flight_time
        .density
        .iter()
        .chain([&crossings.loss_rate]);
    numbers
        .chain(densities.copied())
        .chain(flights.copied())
        .flat_map(|x| [x.value.to_bits(), x.error.to_bits()])
        .collect()
}

#[test]
fn records_have_the_same_bits_on_any_number_of_threads() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    let settings = Sampling {
        duration: 5e4,
        ..Sampling::default()
    };
    let go = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| bits_of_records(&records(&it, &settings, &quiet).unwrap()))
    };
    let one = go(1);
    assert_eq!(one, go(2));
    assert_eq!(one, go(5));
}

#[test]
fn every_law_and_any_damping_keeps_its_temperature_and_short_records_say_so() {
    for (zeta, h, duration) in [
        (1e-6, 1e-6, 1e4),
        (0.005, 0.3, 1e5),
        (0.5, 0.1, 1e5),
        (20.0, 0.1, 3e3),
    ] {
        for contact in [ContactLaw::Hertz, ContactLaw::Bilinear, ContactLaw::Linear] {
            let it = Oscillator::new(contact, zeta, h).unwrap();
            let settings = Sampling {
                duration,
                ..Sampling::default()
            };
            let got = records(&it, &settings, &quiet).unwrap();
            let var_v = got.moments.var_v;
            let z = (var_v.value - it.temperature()) / var_v.error;
            println!(
                "{} zeta {zeta}: Var v {z:.2} standard errors off, {} batches of {:.3e}, worth {:.0?} {:?}",
                it.contact().name(),
                got.batches,
                got.batch_length,
                got.effective_samples,
                got.warnings
            );
            assert!(z.abs() < 4.0 && got.duration >= duration * 0.999);
            let lossy = it.contact().loss_point().is_some();
            let located = got.scheme.locates_crossings();
            assert_eq!(got.crossings.is_some(), lossy && located);
            // Records not much longer than a correlation time, or losses not counted.
            let rough = got.effective_samples.iter().any(|it| *it < 100.0);
            assert_eq!(
                got.warnings.len(),
                usize::from(rough) + usize::from(lossy && !located)
            );
        }
    }
}

#[test]
fn records_of_band_limited_noise_are_nearly_those_of_white_noise() {
    // T = 0.63 at ten times the paper's damping, so that 400 cosines up to 8 fill the resonance.
    let it = Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    let white = Sampling {
        duration: 2e5,
        ..Sampling::default()
    };
    let cosines = Sampling {
        noise: Noise::Cosines {
            count: 400,
            band: 8.0,
        },
        duration: 2e4,
        ..Sampling::default()
    };
    let band = Sampling {
        noise: Noise::Band { band: 8.0 },
        ..white.clone()
    };
    let [white, cosines, band] = [white, cosines, band].map(|s| {
        let start = std::time::Instant::now();
        let got = records(&it, &s, &quiet).unwrap();
        let ns = start.elapsed().as_secs_f64() * 1e9 / got.path_steps as f64;
        println!("{:?}: {ns:.0} ns per path and step", s.noise);
        got
    });
    let numbers = [&white, &cosines, &band].map(|got| got.moments.named());
    for k in 0..numbers[0].len() {
        let [(name, a), (_, b), (_, c)] = numbers.map(|numbers| numbers[k]);
        let (Some(a), Some(b), Some(c)) = (a, b, c) else {
            continue;
        };
        println!("{name}: white {a}, cosines {b}, transform {c}");
    }
    let a = white.moments.std_force;
    for b in [cosines.moments.std_force, band.moments.std_force] {
        assert!((a.value - b.value).abs() < 4.0 * a.error.hypot(b.error) + 0.02 * a.value);
    }
    assert!(cosines.scheme == Scheme::CentralDifference && band.scheme == cosines.scheme);
    let wide = Sampling {
        noise: Noise::Band { band: 1e3 },
        ..Sampling::default()
    };
    let message = records(&it, &wide, &quiet).unwrap_err().to_string();
    assert!(message.contains("monte_carlo.noise.band"), "{message}");
}

#[test]
fn a_record_that_cannot_be_is_refused_by_name() {
    let it = Oscillator::new(ContactLaw::Free, 0.05, 0.02).unwrap();
    let error = records(&it, &Sampling::default(), &quiet).unwrap_err();
    assert!(matches!(error, Error::NoStationaryLaw { .. }), "{error}");
    let it = Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    for duration in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let settings = Sampling {
            duration,
            ..Sampling::default()
        };
        let message = records(&it, &settings, &quiet).unwrap_err().to_string();
        assert!(message.contains("monte_carlo.duration"), "{message}");
    }
}

#[test]
fn records_longer_than_can_be_counted_are_refused_by_name() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    for (duration, step, key) in [
        (1e300, None, "monte_carlo.duration"),
        (f64::MAX, Some(1.0), "monte_carlo.step"),
        (1.0, Some(1e-300), "monte_carlo.step"),
    ] {
        let settings = Sampling {
            duration,
            step,
            ..Sampling::default()
        };
        let message = records(&it, &settings, &quiet).unwrap_err().to_string();
        assert!(message.contains(key), "{message}");
    }
}

/// Every kind of sample, as hungry for time and memory as it can be made.
fn hungry(settings: &Sampling) -> [(&'static str, Result<(), Error>); 4] {
    let weak = Oscillator::new(ContactLaw::Hertz, 1e-6, 1e-6).unwrap();
    let it = Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    let asked = Samples {
        quantity: Quantity::Force,
        spacing: 0.5,
        samples: 100_000,
        records: 1_000,
    };
    let first = Sampling {
        noise: Noise::White,
        ..settings.clone()
    };
    let rest = Initial::Rest;
    [
        (
            "ensemble",
            run(&it, &rest, &[1e6], settings, &quiet).map(|_| ()),
        ),
        (
            "first loss",
            first_loss(&it, &rest, &[1e6], &first, &quiet).map(|_| ()),
        ),
        ("records", records(&weak, settings, &quiet).map(|_| ())),
        (
            "series",
            series(&it, asked, settings, &|_| (), &quiet).map(|_| ()),
        ),
    ]
}

#[test]
fn every_kind_of_sample_ends_soon_after_its_time_whatever_a_step_costs() {
    let many = Noise::Cosines {
        count: 10_000,
        band: 8.0,
    };
    // Few long paths, so that nothing but a look at the clock within a path can end them.
    for (scheme, step, noise) in [
        (Scheme::Auto, Some(1e-4), Noise::White),
        (Scheme::Splitting62, Some(5e5), Noise::White),
        (Scheme::ExponentialHeun, Some(1e-4), Noise::White),
        (Scheme::CentralDifference, Some(1e-3), many),
    ] {
        let settings = Sampling {
            paths: 16,
            duration: 1e9,
            scheme,
            step,
            noise,
            max_seconds: 0.15,
            ..Sampling::default()
        };
        let start = std::time::Instant::now();
        let all = hungry(&settings);
        let seconds = start.elapsed().as_secs_f64();
        println!("{scheme}, {step:?}: four samples in {seconds:.2} s");
        let mut late = 0;
        for (name, it) in all {
            match it {
                Ok(()) => println!("    {name} was whole"),
                Err(it) => {
                    let said = it.to_string();
                    println!("    {name}: {said}");
                    late += u32::from(said.contains("accuracy.max_seconds = 0.15"));
                }
            }
        }
        assert!(
            late >= 2 && seconds < 12.0 * (1.3 * 0.15 + 1.0),
            "{late} {seconds}"
        );
    }
}

#[test]
fn no_sample_begins_that_would_not_fit_its_memory() {
    let settings = Sampling {
        max_memory: 1000,
        ..Sampling::default()
    };
    for (name, it) in hungry(&settings) {
        let said = it.unwrap_err().to_string();
        assert!(said.contains("accuracy.max_memory"), "{name}: {said}");
    }
    // Sums at a hundred thousand times are worth gigabytes.
    let it = Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    let times: Vec<f64> = (0..100_000).map(f64::from).collect();
    let settings = Sampling {
        max_memory: 1_000_000_000,
        ..Sampling::default()
    };
    let said = run(&it, &Initial::Rest, &times, &settings, &quiet).unwrap_err();
    assert!(said.to_string().contains("accuracy.max_memory"), "{said}");
}

#[test]
fn a_step_by_hand_is_warned_of_by_every_kind_of_sample_and_names_what_it_spoils() {
    let text = "[oscillator]\ncontact = \"hertz\"\nzeta = 0.02\nh = 8e-3\n[initial]\nkind = \"rest\"\n\
                [outputs]\nstationary = false\nspectrum = { until = 2.5 }\nfirst_loss = { until = 5 }\n\
                crossings = { window = 10 }\n\
                [monte_carlo]\npaths = 20_000\nduration = 2e4\nscheme = \"baoab\"\n\
                [accuracy]\ntolerance = 1e-1\n";
    let unknown = |step: &[&str]| {
        let set: Vec<String> = step.iter().map(|it| (*it).to_string()).collect();
        let text = SceneText::parse("by hand", text, &set).unwrap();
        let results = Plan::of(text.scene()).unwrap().run_quietly().unwrap();
        let warnings = results.run.warnings.iter().map(|it| it.unknown.clone());
        warnings.flatten().collect::<Vec<String>>()
    };
    assert_eq!(unknown(&[]), Vec::<String>::new());
    let names = unknown(&["monte_carlo.step=0.7"]);
    for name in [
        "records.var_q",
        "records.contact_loss_probability",
        "records.loss_rate",
        "records.mean_flight",
        "records.mean_impact_speed",
        "first_loss_paths.survival at t = 5",
        "first_loss_paths.density at t = 5",
        "first_loss_paths.mean_time",
        "welch.spectrum",
    ] {
        assert!(names.iter().any(|it| it == name), "{name}: {names:?}");
    }
}

#[test]
fn a_splitting_whose_nodes_no_longer_see_the_motion_turn_is_warned_of_with_few_paths_too() {
    let said = |step: f64| {
        let text = format!(
            "[oscillator]\nzeta = 0.02\nh = 5e-3\n[outputs]\nmoments_at = [6]\n[monte_carlo]\npaths = 4000\nstep = {step}\n"
        );
        let text = SceneText::parse("by hand", &text, &[]).unwrap();
        let results = Plan::of(text.scene()).unwrap().run_quietly().unwrap();
        let said = results
            .run
            .warnings
            .iter()
            .filter(|it| it.text.contains("monte_carlo.step"));
        said.count()
    };
    // Variances are off by 0.17 with the first, by less than 1e-3 with the second.
    assert_eq!([3.0, 1.0].map(said), [1, 0]);
}

#[test]
fn standard_errors_of_short_realisations_hold_over_seeds() {
    for (zeta, h, duration) in [(0.05, 0.02, 3e3), (0.05, 0.02, 1e4), (0.005, 2e-3, 6e4)] {
        let it = Oscillator::new(ContactLaw::Hertz, zeta, h).unwrap();
        let exact = Stationary::of(&it).unwrap().moments();
        let mut squares = [0.0; Moment::ALL.len()];
        let seeds = 100;
        for seed in 0..seeds {
            let text = format!(
                "[oscillator]\nzeta = {zeta:e}\nh = {h:e}\n[monte_carlo]\nduration = {duration:e}\nseed = {seed}"
            );
            let scene = SceneText::parse("a.toml", &text, &[]).unwrap();
            let tree = Plan::of(scene.scene())
                .unwrap()
                .run_quietly()
                .unwrap()
                .tree();
            let found = &tree["monte_carlo"]["stationary"];
            for (square, (name, exact)) in squares.iter_mut().zip(exact.named()) {
                // E[v] and Cov(q, v) are not all there.
                let Some(value) = found[name]["value"].as_f64() else {
                    continue;
                };
                let error = found[name]["error"].as_f64().unwrap();
                *square += ((value - exact.unwrap().value) / error).powi(2);
            }
        }
        for (name, square) in Moment::ALL.map(Moment::name).into_iter().zip(squares) {
            let rms = (square / f64::from(seeds)).sqrt();
            println!("zeta {zeta}, duration {duration:e}: {name} rms {rms:.2} standard errors");
            // Of a normal law 1.00 with a deviation of 0.07.
            assert!(rms < 1.25, "{name}: {rms}");
        }
    }
}

#[test]
fn standard_errors_of_few_paths_hold_over_seeds() {
    let it = hertz(0.05, PAPER);
    let exact = Stationary::of(&it).unwrap().moments();
    for (paths, most) in [(100, 2.0), (1000, 1.25)] {
        let mut squares = [0.0; Moment::ALL.len()];
        let seeds = 100;
        for seed in 0..seeds {
            let asked = Sampling {
                seed,
                ..settings(paths)
            };
            let got = run(&it, &Initial::Stationary, &[0.0], &asked, &quiet).unwrap();
            for (square, ((_, a), (_, b))) in squares
                .iter_mut()
                .zip(got.moments[0].named().into_iter().zip(exact.named()))
            {
                let (a, b) = (a.unwrap(), b.unwrap());
                *square += ((a.value - b.value) / a.error).powi(2);
            }
        }
        for (it, square) in Moment::ALL.into_iter().zip(squares) {
            let rms = (square / seeds as f64).sqrt();
            println!("{paths} paths: {} rms {rms:.2} standard errors", it.name());
            // The kurtosis of so few has skewed errors.
            let few = it == Moment::KurtosisForce;
            assert!(rms < if few { most } else { 1.25 }, "{}: {rms}", it.name());
        }
    }
}

/// One path in 1e5 has a fifth of the kurtosis of the force at t = 10: fewer do not know what they miss, and say that few carry it.
#[test]
fn a_kurtosis_that_few_paths_carry_is_said_to_be_rough() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
    let initial = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    let few = |it: &EnsembleResult| it.warnings.iter().any(|it| it.text.contains("carry"));
    for paths in [5_000, 20_000, 100_000] {
        let (mut said, mut square) = (0, 0.0);
        let seeds = 24;
        for seed in 0..seeds {
            let asked = Sampling {
                seed,
                ..settings(paths)
            };
            let got = run(&it, &initial, &[10.0], &asked, &quiet).unwrap();
            let kurtosis = got.moments[0].kurtosis_force;
            // By Fokker-Planck at 1e-5 (`vibroimpact run displaced --set accuracy.tolerance=1e-5`).
            square += ((kurtosis.value - 6.0667) / kurtosis.error).powi(2);
            said += u32::from(few(&got));
        }
        let rms = (square / f64::from(u32::try_from(seeds).unwrap())).sqrt();
        println!("{paths} paths: rms {rms:.1} standard errors; said by {said} of {seeds}");
        // Where most of the sum is in fewer paths than groups tell apart.
        assert!(paths < 20_000 || 3 * said > u32::try_from(seeds).unwrap());
        assert!(paths < 100_000 || rms < 2.0);
    }
    // Who does not ask for it is not told.
    let mean = Sampling {
        moments: Some(vec![Moment::MeanQ]),
        ..settings(100_000)
    };
    let mean = run(&it, &initial, &[10.0], &mean, &quiet).unwrap();
    assert!(!few(&mean) && mean.moments[0].get(Moment::KurtosisForce).is_none());
    // What many paths carry is left alone.
    let stationary = run(&it, &Initial::Stationary, &[0.0], &settings(20_000), &quiet).unwrap();
    assert!(!few(&stationary));
}

/// A thousand million paths are not done in time on any machine; those that are have the errors of as many.
#[test]
fn paths_that_were_done_in_time_are_an_answer() {
    let it = hertz(0.05, PAPER);
    let asked = Sampling {
        max_seconds: 0.3,
        ..settings(1_000_000_000)
    };
    let got = run(&it, &Initial::Stationary, &[5.0, 20.0], &asked, &quiet).unwrap();
    println!("{} paths", got.paths);
    assert!(got.paths > 50 && got.paths < asked.paths);
    assert!(got.shortfall.is_some_and(|it| it.free));
    for at in &got.moments {
        let (mean, error) = (at.mean_v.value, at.mean_v.error);
        let expected = (PAPER / got.paths as f64).sqrt();
        assert!(
            (error / expected - 1.0).abs() < 0.3,
            "{error} for {expected}"
        );
        assert!(mean.abs() < 5.0 * error);
    }
}

/// The paths that show the bias of a step have their share of the time, and are cut as the others are.
#[test]
fn paths_that_were_done_in_time_are_an_answer_beside_a_companion_too() {
    let text = "[oscillator]\nzeta = 0.05\nh = 0.02\n[outputs]\nstationary = false\nmoments_at = [5, 20]\n\
                [monte_carlo]\npaths = 1_000_000_000\n[accuracy]\nmax_seconds = 2\n";
    let scene = SceneText::parse("cut", text, &[]).unwrap();
    let plan = Plan::of(scene.scene()).unwrap();
    let stages = plan.stages().iter();
    assert!(stages.clone().any(|it| it.method.contains("for its bias")));
    let results = plan.run_quietly().unwrap();
    let got = results.monte_carlo.as_ref().unwrap();
    assert!(got.paths > 50 && got.paths < 1_000_000_000);
    assert!(got.shortfall.is_some());
    let method = &results.tree()["monte_carlo"]["transient"]["method"];
    assert_eq!(method["paths"], got.paths);
}

#[test]
fn flights_as_long_as_a_record_are_in_its_mean() {
    // T = 6.3: one flight in twenty lasts longer than 12, a record 160.
    let it = Oscillator::new(ContactLaw::Hertz, 0.5, 2.0).unwrap();
    let exact = Stationary::of(&it).unwrap().mean_flight().unwrap().value;
    let mut square = 0.0;
    let seeds = 30;
    for seed in 0..seeds {
        let asked = Sampling {
            seed,
            duration: 1e4,
            ..Sampling::default()
        };
        let got = records(&it, &asked, &quiet).unwrap().crossings.unwrap();
        let z = (got.mean_flight.value - exact) / got.mean_flight.error;
        // What is lost is out of contact as long as the mean of its flights says.
        let product = got.loss_rate.value * got.mean_flight.value;
        assert!((product / got.lost_share.value - 1.0).abs() < 1e-12);
        square += z * z;
    }
    let rms = (square / seeds as f64).sqrt();
    println!("rms {rms:.2} standard errors");
    assert!(rms < 1.4, "{rms}");
}

#[test]
fn records_of_a_sum_of_cosines_are_as_sure_as_their_number() {
    let it = Oscillator::new(ContactLaw::Linear, 0.2, 0.01).unwrap();
    let seeds = 20;
    let found: Vec<Estimate> = (0..seeds)
        .map(|seed| {
            let asked = Sampling {
                seed,
                duration: 1e5,
                noise: Noise::Cosines {
                    count: 200,
                    band: 8.0,
                },
                ..Sampling::default()
            };
            records(&it, &asked, &quiet).unwrap().moments.var_q
        })
        .collect();
    let n = f64::from(u32::try_from(seeds).unwrap());
    let mean = found.iter().map(|it| it.value).sum::<f64>() / n;
    let scatter = found
        .iter()
        .map(|it| (it.value - mean).powi(2))
        .sum::<f64>()
        / (n - 1.0);
    let error = found.iter().map(|it| it.error).sum::<f64>() / n;
    println!("deviation {:.2e}, error {error:.2e}", scatter.sqrt());
    // The deviation of 20 is known to a sixth.
    assert!(error > 0.7 * scatter.sqrt() && error < 1.6 * scatter.sqrt());
}
