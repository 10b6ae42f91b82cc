use super::*;
use crate::contact::ContactLaw;

fn quiet(_: f64) {}

fn bits(result: &RecordResult) -> Vec<u64> {
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
        pool.install(|| bits(&records(&it, &settings, &quiet).unwrap()))
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
            // Friction so weak that the records are no longer than a memory, or losses not counted.
            let rough = zeta < 1e-3 && got.effective_samples[2] < 50.0;
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
fn records_are_as_many_as_their_size_says_and_stop_when_their_time_is_over() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    for (duration, noise) in [
        (10.0, Noise::White),
        (3e4, Noise::White),
        (1e3, Noise::Band { band: 8.0 }),
    ] {
        let settings = Sampling {
            duration,
            noise,
            ..Sampling::default()
        };
        let size = record_size(&it, &settings).unwrap();
        let got = records(&it, &settings, &quiet).unwrap();
        assert_eq!(
            (size.records, size.path_steps, size.step, size.scheme),
            (got.records, got.path_steps, got.step, got.scheme)
        );
        assert_eq!(size.steps * size.records, size.path_steps);
        let late = Sampling {
            max_seconds: 0.0,
            ..settings
        };
        let message = records(&it, &late, &quiet).unwrap_err().to_string();
        assert!(message.contains("accuracy.max_seconds = 0"), "{message}");
    }
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
        let message = record_size(&it, &settings).unwrap_err().to_string();
        assert!(message.contains(key), "{message}");
    }
}
