//! First losses of contact and flights: the backward equation and closed forms against paths, against each
//! other, and against asymptotics.

#![allow(clippy::print_stdout, missing_docs)]

use std::f64::consts::PI;
use vibroimpact::contact::ContactLaw;
use vibroimpact::damping::Damping;
use vibroimpact::estimate::Estimate;
use vibroimpact::fokker_planck::{FirstLoss, Flight, Settings, first_loss, flight_law};
use vibroimpact::initial::Initial;
use vibroimpact::monte_carlo::{self, Sampling, Scheme};
use vibroimpact::oscillator::Oscillator;
use vibroimpact::quadrature;
use vibroimpact::stationary::Stationary;

fn hertz(zeta: f64, h: f64) -> Oscillator {
    Oscillator::new(ContactLaw::Hertz, zeta, h).unwrap()
}

fn survive(it: &Oscillator, initial: &Initial, until: f64, step: f64) -> FirstLoss {
    let settings = Settings {
        step: Some(step),
        ..Settings::default()
    };
    first_loss(it, initial, until, &settings, &|_| {}).unwrap()
}

#[test]
fn survival_agrees_with_paths_from_rest_from_the_stationary_law_and_from_a_gaussian() {
    let gaussian = Initial::gaussian([0.3, -0.2], [0.5, 0.4]).unwrap();
    for (h, initial) in [
        (1.2e-3, Initial::Rest),
        (1.2e-3, Initial::Stationary),
        (3.2e-3, Initial::Rest),
        (3.2e-3, Initial::Stationary),
        (3.2e-3, gaussian),
    ] {
        let it = hertz(0.005, h);
        let exact = survive(&it, &initial, 60.0, 0.5);
        let settings = Sampling {
            paths: 150_000,
            ..Sampling::default()
        };
        let paths =
            monte_carlo::first_loss(&it, &initial, &exact.times, &settings, &|_| {}).unwrap();
        let (mut worst, mut largest): (f64, f64) = (0.0, 0.0);
        for (k, t) in exact.times.iter().enumerate().step_by(10) {
            let (a, b) = (exact.survival[k], paths.survival[k]);
            largest = largest.max(a.error);
            // All or none of the paths have no standard error.
            if b.error > 0.0 && *t > 0.0 {
                worst = worst.max((a.value - b.value).abs() / a.error.hypot(b.error));
            }
        }
        let (a, b) = (
            exact.survival.last().unwrap(),
            paths.survival.last().unwrap(),
        );
        println!(
            "h = {h}, {}: S(60) {a}, paths {b}; worst {worst:.2}, largest error {largest:.1e}",
            initial.name()
        );
        assert!(worst < 3.0 && largest < 5e-4);
    }
}

#[test]
fn the_mean_time_is_the_integral_of_the_survival() {
    let it = hertz(0.05, 3e-2);
    for initial in [Initial::Rest, Initial::Stationary] {
        let got = survive(&it, &initial, 200.0, 0.25);
        let gap = got.times[1];
        let last = got.times.len() - 1;
        let mut integral = 0.5 * (got.survival[0].value + got.survival[last].value);
        integral += got.survival[1..last].iter().map(|s| s.value).sum::<f64>();
        // Trapezes with their first correction, and the exponential tail.
        let ends = got.density[0].value - got.density[last].value;
        let integral =
            gap * integral - gap * gap / 12.0 * ends + got.survival[last].value / got.rate.value;
        println!(
            "{}: Pontryagin {}, integral {integral:.6}",
            initial.name(),
            got.mean_time
        );
        assert!((got.mean_time.value / integral - 1.0).abs() < 2e-4);
        assert!(got.mean_time.error < 1e-2 * got.mean_time.value);
    }
}

#[test]
fn survival_converges_with_at_least_second_order_in_the_step() {
    let it = hertz(0.005, 3.2e-3);
    // One mesh, so that what is left is the step.
    let at = |step: f64| {
        let settings = Settings {
            step: Some(step),
            cells: Some([118, 168]),
            ..Settings::default()
        };
        first_loss(&it, &Initial::Stationary, 20.0, &settings, &|_| {}).unwrap()
    };
    let (a, b, c) = (at(1.0), at(0.5), at(0.25));
    let rate = |x: &FirstLoss| x.rate.value;
    let (coarse, fine) = ((rate(&a) - rate(&b)).abs(), (rate(&b) - rate(&c)).abs());
    let order = (coarse / fine).log2();
    println!(
        "rate {:.6e} {:.6e} {:.6e}: order {order:.2}",
        rate(&a),
        rate(&b),
        rate(&c)
    );
    assert!(fine < 1e-3 * rate(&c));
    assert!(order > 1.7);
    // The error estimate holds what a halved step changes.
    assert!((rate(&b) - rate(&c)).abs() <= b.rate.error + c.rate.error);
    for (x, y) in b.survival.last().iter().zip(c.survival.last()) {
        assert!((x.value - y.value).abs() <= x.error + y.error);
    }
}

/// Energy a period takes at the level of the loss over T, and the factor of Mel'nikov and Meshkov
/// (J. Chem. Phys. 85, 1986, 1018) by which re-losses lower the rate.
fn melnikov(it: &Oscillator) -> (f64, f64) {
    let contact = it.contact();
    let (low, high) = contact.turning_points(0.9).unwrap();
    let speed = |q: f64| (2.0 * (0.9 - contact.potential(q)).max(0.0)).sqrt();
    let action = 2.0 * quadrature::integrate(speed, &[low, 0.0, high], 1e-8).value;
    let delta = 2.0 * it.zeta() * action / it.temperature();
    let f = |l: f64| {
        let x = l * l + 0.25;
        (-(-delta * x).exp_m1()).ln() / x
    };
    let breaks = [-60.0, -10.0, -3.0, -1.0, 0.0, 1.0, 3.0, 10.0, 60.0];
    (
        delta,
        (quadrature::integrate(f, &breaks, 1e-8).value / (2.0 * PI)).exp(),
    )
}

#[test]
fn the_rate_of_rare_losses_is_rice_s_times_the_share_that_is_not_a_repetition() {
    // 5.75e-14 losses per unit time by Rice's formula; corrections of T/U = 3.5 % of the
    // exponent are beyond the asymptotics. The last, 60 T deep, is lost from speeds of eleven deviations: all of them are seen if
    // the first steps are fine enough.
    for (zeta, h) in [(0.02, 4e-4), (0.005, 1e-4), (0.005, 4.8e-5)] {
        let it = hertz(zeta, h);
        let settings = Settings {
            tolerance: 1e-2,
            ..Settings::default()
        };
        let got = first_loss(&it, &Initial::Stationary, 10.0, &settings, &|_| {}).unwrap();
        assert!(got.shortfall.is_none());
        let rice = Stationary::of(&it).unwrap().loss_rate().unwrap().value;
        let (delta, factor) = melnikov(&it);
        println!(
            "zeta {zeta}, h {h}: rate {}, Rice {rice:.4e}, ratio {} against {factor:.4} (delta {delta:.2})",
            got.rate, got.rate_over_rice
        );
        assert!((got.rate.value / rice - got.rate_over_rice.value).abs() < 1e-6);
        assert!((got.rate_over_rice.value / factor - 1.0).abs() < 0.04);
        assert!(got.rate.error < 1e-2 * got.rate.value);
        assert!((got.mean_time.value * got.rate.value - 1.0).abs() < 1e-6);
        assert!(got.method.step > 0.4);
    }
}

#[test]
fn friction_in_contact_alone_is_viscous_up_to_the_loss_of_contact() {
    let settings = Settings {
        tolerance: 1e-2,
        ..Settings::default()
    };
    let lost = |damping: Damping| {
        let it = hertz(0.02, 4e-4).with_damping(damping).unwrap();
        first_loss(&it, &Initial::Rest, 10.0, &settings, &|_| {}).unwrap()
    };
    let [viscous, contact] = [Damping::Viscous, Damping::Contact].map(lost);
    assert!(contact.shortfall.is_none());
    for (a, b) in viscous.survival.iter().zip(&contact.survival) {
        assert_eq!(a.value, b.value);
    }
    assert_eq!(viscous.rate.value, contact.rate.value);
    assert_eq!(viscous.mean_time.value, contact.mean_time.value);
    // The stationary law is another, and so is Rice's rate.
    assert!(contact.rate_over_rice.value.is_nan());
}

#[test]
fn a_law_with_long_tails_that_friction_in_contact_keeps_up_begins_with_all_of_them() {
    // Of 71 T one in twenty begins in contact faster than eight viscous deviations. Undamped motions of the law averaged over
    // orbits, whole, survive in 0.1983 of cases until 2.1429, those slower than that in 0.2090.
    let it = hertz(0.005, 0.05).with_damping(Damping::Contact).unwrap();
    let settings = Settings {
        tolerance: 5e-2,
        cells: Some([90, 140]),
        step: Some(0.18),
        ..Settings::default()
    };
    let it = first_loss(&it, &Initial::Stationary, 2.1429, &settings, &|_| {}).unwrap();
    let last = it.survival[it.survival.len() - 1];
    println!("{last}");
    assert!((last.value - 0.1983).abs() < 0.003, "{last}");
}

#[test]
fn flights_have_the_mean_and_the_norm_of_the_stationary_law_and_the_density_of_the_records() {
    let it = hertz(0.005, 2e-3);
    let law = flight_law(&it).unwrap();
    let gap = law.times[1] - law.times[0];
    let (mut norm, mut mean) = (0.0, 0.0);
    for (t, p) in law.times.iter().zip(&law.density) {
        norm += gap * p.value;
        mean += gap * t * p.value;
    }
    let exact = Stationary::of(&it).unwrap().mean_flight().unwrap().value;
    println!("norm {norm:.7}, mean {mean:.6} against {exact:.6}");
    // A share of 2e-5 is longer than the curve.
    assert!((norm - 1.0).abs() < 1e-4 && (mean / exact - 1.0).abs() < 3e-4);

    let settings = Sampling {
        duration: 4e5,
        ..Sampling::default()
    };
    let records = monte_carlo::records(&it, &settings, &|_| {}).unwrap();
    let seen = records.crossings.unwrap().flight_time;
    let flight = Flight::of(&it).unwrap();
    let (mut square, mut count) = (0.0, 0.0);
    for (ends, p) in seen.edges.windows(2).zip(&seen.density) {
        // Bins in the bulk, where the counts are nearly Gaussian; the mean over a bin by Simpson's rule.
        let middle = 0.5 * (ends[0] + ends[1]);
        if p.error > 0.0 && p.value > 30.0 * p.error / 5.0 {
            let at = |t: f64| flight.density(t).value;
            let exact = (at(ends[0].max(1e-9)) + 4.0 * at(middle) + at(ends[1])) / 6.0;
            square += ((p.value - exact) / p.error).powi(2);
            count += 1.0;
        }
    }
    println!("{count} bins, chi^2 per bin {:.2}", square / count);
    assert!(count > 20.0 && square / count < 1.0 + 5.0 * (2.0f64 / count).sqrt());
}

#[test]
fn the_two_laws_of_flight_meet_and_short_flights_are_mckean_s() {
    let it = hertz(0.005, 2e-3);
    let flight = Flight::of(&it).unwrap();
    // Where re-losses have died out and friction has not yet come in.
    let t = 90.0 * it.noise();
    let (a, b) = (flight.first_returns(t), flight.returns(t));
    println!("at t = {t:.3}: first returns {a}, all returns {b}");
    assert!((a.value / b.value - 1.0).abs() < 1e-5);
    assert!((a.value - b.value).abs() < a.error + 1e-7 * b.value);
    // Without force and friction a flight of t -> 0 from the flux w dw/T: by self-similarity the density
    // tends to 4 zeta I, with I the integral of w over McKean's law of unit noise at t = 1, from an
    // independent quadrature.
    let short: Estimate = flight.density(1e-7 * it.noise());
    println!("density of the shortest flights {short}");
    assert!((short.value / (4.0 * 0.096354167 * it.zeta()) - 1.0).abs() < 1e-3);
}

#[test]
fn a_long_time_is_continued_in_closed_form() {
    let it = hertz(0.02, 1.28e-2);
    let initial = Initial::Rest;
    let short = survive(&it, &initial, 375.0, 0.5);
    let long = survive(&it, &initial, 7.5e5, 0.5);
    let over = |it: &FirstLoss| {
        it.shortfall
            .as_ref()
            .map_or(0.0, vibroimpact::estimate::Shortfall::ratio)
    };
    println!("over the tolerance: {} and {}", over(&short), over(&long));
    assert!(over(&short).max(over(&long)) < 3.0);
    assert!(long.method.steps < 20_000, "{}", long.method.steps);
    // The whole time integration against the one that ends when the hazard is constant.
    let (last, rate) = (short.survival.last().unwrap(), short.rate.value);
    let near = survive(&it, &initial, 300.0, 0.5);
    let expected = near.survival.last().unwrap().value * (-rate * 75.0).exp();
    println!(
        "{}: S(375) {last}, from S(300) {expected:.6e}",
        initial.name()
    );
    assert!((last.value - expected).abs() <= last.error);
    assert!((last.value / expected - 1.0).abs() < 1e-2);
}

#[test]
fn three_meshes_show_the_order_in_space_at_the_singular_point() {
    // The survival is singular at (q_loss, 0); the mesh is graded there, and after each kick the noise has
    // smoothed the field.
    let it = hertz(0.005, 3.2e-3);
    let at = |n: usize| {
        let settings = Settings {
            step: Some(0.5),
            cells: Some([7 * n / 10, n]),
            ..Settings::default()
        };
        let got = first_loss(&it, &Initial::Rest, 60.0, &settings, &|_| {}).unwrap();
        got.survival.last().unwrap().value
    };
    // Against a mesh whose own error is far below.
    let exact = at(160);
    let errors: Vec<f64> = [40, 60, 90]
        .map(at)
        .iter()
        .map(|s| (s - exact).abs())
        .collect();
    let order = |a: f64, b: f64| (a / b).ln() / 1.5f64.ln();
    let orders = [order(errors[0], errors[1]), order(errors[1], errors[2])];
    println!("errors {errors:?}, orders {orders:.2?}");
    assert!(orders[0].min(orders[1]) > 2.5, "{orders:?}");
}

#[test]
fn paths_stop_at_the_limit_of_time_and_a_tolerance_out_of_reach_is_a_shortfall() {
    let it = hertz(0.005, 3.2e-3);
    let settings = Sampling {
        paths: 1 << 40,
        max_seconds: 0.2,
        ..Sampling::default()
    };
    let error =
        monte_carlo::first_loss(&it, &Initial::Rest, &[10.0], &settings, &|_| {}).unwrap_err();
    assert!(error.to_string().contains("max_seconds"), "{error}");

    let settings = Settings {
        tolerance: 1e-7,
        max_memory: 60_000_000,
        cells: Some([40, 60]),
        step: Some(0.5),
        ..Settings::default()
    };
    let got = first_loss(&it, &Initial::Rest, 20.0, &settings, &|_| {}).unwrap();
    // The scene said how fine: not the program's fault.
    assert!(!got.shortfall.unwrap().free);
    let free = Settings {
        cells: None,
        step: None,
        // The first mesh takes a little less, the next one more than this.
        max_memory: 4_500_000,
        tolerance: 3e-4,
        ..settings
    };
    let strong = hertz(1.0, 0.05);
    let got = first_loss(&strong, &Initial::Rest, 50.0, &free, &|_| {}).unwrap();
    let shortfall = got.shortfall.unwrap();
    println!("{shortfall}");
    assert!(shortfall.free && shortfall.reason.contains("max_memory"));
}

/// What losses show.
const SHOWN: [&str; 5] = [
    "loss_rate",
    "lost_share",
    "P(loss)",
    "mean_flight",
    "mean_impact_speed",
];

/// Mean number of bursts seen in records of this duration, and the rms error of what losses show over its standard
/// error, over 200 seeds.
fn over_seeds(it: &Oscillator, duration: f64) -> (f64, [f64; 5]) {
    let law = Stationary::of(it).unwrap();
    let exact = [
        law.loss_rate(),
        law.contact_loss_probability(),
        law.contact_loss_probability(),
        law.mean_flight(),
        law.mean_impact_speed(),
    ];
    let (mut squares, mut counts) = ([0.0; 5], [0.0; 5]);
    let (mut bursts, mut losses, mut said) = (0.0, 0.0, 0.0);
    let seeds = 200;
    for seed in 0..seeds {
        let settings = Sampling {
            duration,
            seed: 100 + seed,
            ..Sampling::default()
        };
        let got = monte_carlo::records(it, &settings, &|_| {}).unwrap();
        let seen = got.crossings.unwrap();
        bursts += seen.bursts / seeds as f64;
        losses += seen.losses as f64 / seeds as f64;
        let warned = got
            .warnings
            .iter()
            .any(|it| it.text.contains("independent bursts"));
        assert_eq!(warned, seen.losses > 0 && seen.bursts < 20.0);
        said += f64::from(u8::from(warned)) / seeds as f64;
        let numbers = [
            seen.loss_rate,
            seen.lost_share,
            got.moments.contact_loss_probability.unwrap(),
            seen.mean_flight,
            seen.mean_impact_speed,
        ];
        for (k, (number, exact)) in numbers.into_iter().zip(exact).enumerate() {
            let z = (number.value - exact.unwrap().value) / number.error;
            // No flight has no mean.
            if z.is_finite() {
                squares[k] += z * z;
                counts[k] += 1.0;
            }
        }
    }
    let rms: [f64; 5] = std::array::from_fn(|k| f64::sqrt(squares[k] / counts[k]));
    println!(
        "{} zeta {} T {:.3}, duration {duration:.1e}: {losses:.0} losses in {bursts:.1} bursts, said in {said:.2} of \
         the runs",
        it.contact().name(),
        it.zeta(),
        it.temperature()
    );
    for (name, rms) in SHOWN.iter().zip(rms) {
        println!("    {name}: rms z {rms:.2}");
    }
    (bursts, rms)
}

#[test]
fn losses_in_few_bursts_have_standard_errors_that_hold_over_seeds() {
    // T = 0.157: 0.0005 losses a unit of time, in bursts of three or four.
    let it = hertz(0.005, 5e-4);
    for (duration, [low, high]) in [(2e4, [0.3, 1.0]), (1e5, [0.55, 1.2]), (4e5, [0.8, 1.25])] {
        let (_, rms) = over_seeds(&it, duration);
        for (name, rms) in SHOWN.iter().zip(rms) {
            assert!(rms > low && rms < high, "{name}: {rms}");
        }
    }
}

#[test]
fn the_standard_errors_of_few_bursts_hold_for_other_oscillators_than_the_one_they_were_made_for() {
    // Bursts of one or two losses, bursts of dozens, and a contact with a kink.
    let bilinear = Oscillator::new(ContactLaw::Bilinear, 0.005, 2.9e-4).unwrap();
    for (it, durations) in [
        (hertz(0.04, 4e-3), [2e4, 2e5]),
        (hertz(0.001, 1.3e-4), [1e5, 4e5]),
        (bilinear, [4e4, 2e5]),
    ] {
        for duration in durations {
            let (bursts, rms) = over_seeds(&it, duration);
            for (name, rms) in SHOWN.iter().zip(rms) {
                let low = if bursts < 5.0 { 0.2 } else { 0.6 };
                assert!(
                    rms > low && rms < 1.4,
                    "{name}: {rms} at {bursts:.1} bursts"
                );
            }
        }
    }
}

#[test]
fn contact_survives_at_first_as_rice_s_rate_says() {
    // Given contact, the first losses come at the rate nu/P(contact); they thin out as the paths
    // without losses are the calm ones.
    let it = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
    let settings = Sampling {
        paths: 200_000,
        ..Sampling::default()
    };
    let times = [0.25, 0.5, 5.0, 50.0, 200.0];
    let got =
        monte_carlo::first_loss(&it, &Initial::Stationary, &times, &settings, &|_| {}).unwrap();
    let rate = 0.036_466_36 / (1.0 - 0.072_455_6);
    for (time, survival) in times.iter().zip(&got.survival) {
        println!("survival to {time}: {survival}");
    }
    println!(
        "density {} {}, rate of losses {rate:.6}; mean time {}",
        got.density[0], got.density[1], got.mean_time
    );
    let z = (got.density[0].value - rate) / got.density[0].error;
    assert!(z.abs() < 4.0, "{z}");
    assert!(got.survival.windows(2).all(|s| s[1].value <= s[0].value));
    // The mean time is the integral of the survival: bracketed by its step functions.
    let (mut low, mut high, mut before, mut start) = (0.0, 0.0, 1.0, 0.0);
    for (time, s) in times.iter().zip(&got.survival) {
        low += s.value * (time - start);
        high += before * (time - start);
        (before, start) = (s.value, *time);
    }
    assert!(got.mean_time.value > low && got.mean_time.value < high);
}

#[test]
fn the_same_survivors_with_any_scheme_that_locates_the_loss() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.05, 2e-2).unwrap();
    let survival = |scheme, step, paths| {
        let settings = Sampling {
            paths,
            scheme,
            step,
            ..Sampling::default()
        };
        let got = monte_carlo::first_loss(&it, &Initial::Rest, &[10.0, 20.0], &settings, &|_| {})
            .unwrap();
        [got.survival[0], got.survival[1]]
    };
    let split = survival(Scheme::Splitting42, None, 100_000);
    let fine = survival(Scheme::Baoab, Some(0.01), 30_000);
    for (a, b) in split.iter().zip(&fine) {
        let z = (a.value - b.value) / a.error.hypot(b.error);
        println!("splitting {a}, BAOAB {b}, {z:.2} standard errors");
        assert!(z.abs() < 4.0);
    }
}

#[test]
fn a_law_without_loss_and_a_blind_scheme_are_refused() {
    let linear = Oscillator::new(ContactLaw::Linear, 0.05, 2e-2).unwrap();
    let hertz = Oscillator::new(ContactLaw::Hertz, 0.05, 2e-2).unwrap();
    let blind = Sampling {
        scheme: Scheme::ExponentialHeun,
        ..Sampling::default()
    };
    for (it, settings, key) in [
        (&linear, Sampling::default(), "oscillator.contact"),
        (&hertz, blind, "monte_carlo.scheme"),
    ] {
        let error =
            monte_carlo::first_loss(it, &Initial::Rest, &[1.0], &settings, &|_| {}).unwrap_err();
        assert!(error.to_string().contains(key), "{error}");
    }
}
