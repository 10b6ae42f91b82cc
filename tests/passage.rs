//! First passage of any level, above, below or either side, beside paths and beside Rice's rate.

use vibroimpact::contact::ContactLaw;
use vibroimpact::damping::Damping;
use vibroimpact::fokker_planck::{FirstLoss, Settings, first_loss, first_passage};
use vibroimpact::initial::Initial;
use vibroimpact::monte_carlo::{self, Sampling};
use vibroimpact::oscillator::{Oscillator, Side};

fn settings(tolerance: f64) -> Settings {
    Settings {
        tolerance,
        ..Settings::default()
    }
}

/// The first passage, and the largest |S - S of paths| over the joint error.
fn beside_paths(
    it: &Oscillator,
    initial: &Initial,
    (level, side, until): (f64, Side, f64),
    (tolerance, paths): (f64, u64),
) -> (FirstLoss, f64) {
    let solved = first_passage(
        it,
        initial,
        (level, side, until),
        &settings(tolerance),
        &|_| (),
    )
    .unwrap();
    assert!(solved.shortfall.is_none(), "{:?}", solved.shortfall);
    let sampling = Sampling {
        paths,
        seed: 3,
        ..Sampling::default()
    };
    let sampled = monte_carlo::first_passage(
        it,
        initial,
        (level, side),
        &solved.times,
        &sampling,
        &|_| (),
    )
    .unwrap();
    let pairs = solved.survival.iter().zip(&sampled.survival).skip(1);
    let z = pairs
        .map(|(a, b)| (a.value - b.value).abs() / a.error.hypot(b.error))
        .filter(|z| z.is_finite())
        .fold(0.0, f64::max);
    (solved, z)
}

#[test]
fn a_linear_oscillator_from_rest_passes_two_and_three_deviations_as_its_paths_do() {
    // T = 0.25: a deviation of q is 0.5.
    let it = Oscillator::new(ContactLaw::Linear, 0.05, 0.025 / std::f64::consts::PI).unwrap();
    assert!((it.temperature() - 0.25).abs() < 1e-12);
    for (level, side) in [
        (1.0, Side::Above),
        (-1.0, Side::Below),
        (1.0, Side::Either),
        (1.5, Side::Either),
    ] {
        let (solved, z) = beside_paths(&it, &Initial::Rest, (level, side, 60.0), (1e-3, 60_000));
        let last = solved.survival[solved.survival.len() - 1];
        println!(
            "{side:?} {level}: S(60) = {last}, mean time {}, rate {}; worst z of {} times {z:.1}",
            solved.mean_time,
            solved.rate,
            solved.times.len()
        );
        assert!(z < 4.0, "{side:?} {level}: {z}");
    }
}

#[test]
fn up_is_down_in_a_mirror_and_the_loss_of_contact_is_a_level() {
    let it = Oscillator::new(ContactLaw::Linear, 0.05, 0.01).unwrap();
    let start = |q: f64| Initial::gaussian([q, -0.3 * q], [0.2, 0.3]).unwrap();
    let settings = settings(1e-2);
    let up = first_passage(
        &it,
        &start(0.4),
        (0.9, Side::Above, 20.0),
        &settings,
        &|_| (),
    )
    .unwrap();
    let down = first_passage(
        &it,
        &start(-0.4),
        (-0.9, Side::Below, 20.0),
        &settings,
        &|_| (),
    )
    .unwrap();
    for (a, b) in up.survival.iter().zip(&down.survival) {
        assert!((a.value - b.value).abs() < 1e-10, "{a} {b}");
    }
    let hertz = Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    let lost = first_loss(&hertz, &start(0.4), 20.0, &settings, &|_| ()).unwrap();
    let below = first_passage(
        &hertz,
        &start(0.4),
        (-1.5, Side::Below, 20.0),
        &settings,
        &|_| (),
    )
    .unwrap();
    assert_eq!(lost.survival, below.survival);
    assert_eq!(lost.rate, below.rate);
}

#[test]
fn the_rate_tends_to_rice_s_as_the_level_rises() {
    let it = Oscillator::new(ContactLaw::Linear, 0.3, 0.02).unwrap();
    let deviation = it.temperature().sqrt();
    let mut apart = Vec::new();
    for level in [2.0, 3.0, 4.0, 5.0] {
        let passage = (level * deviation, Side::Above, 50.0);
        let solved =
            first_passage(&it, &Initial::Stationary, passage, &settings(2e-3), &|_| ()).unwrap();
        println!(
            "{level} deviations: rate over Rice's {}",
            solved.rate_over_rice
        );
        apart.push((solved.rate_over_rice.value - 1.0).abs());
    }
    // Passages thin out, and one forgets the one before.
    assert!(apart.windows(2).all(|r| r[1] < r[0]));
    assert!(apart[0] > 0.01 && apart[3] < 5e-3);
}

#[test]
fn hertz_and_its_other_dampings_pass_levels_as_their_paths_do() {
    let start = Initial::gaussian([0.2, 0.0], [0.4, 0.4]).unwrap();
    let hertz = || Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    for damping in [Damping::Viscous, Damping::Contact, Damping::HuntCrossley] {
        let it = hertz().with_damping(damping.clone()).unwrap();
        for (level, side) in [(1.6, Side::Above), (-2.5, Side::Below)] {
            let (solved, z) = beside_paths(&it, &start, (level, side, 30.0), (3e-2, 40_000));
            println!(
                "{damping:?} {side:?} {level}: mean time {}, rate {}, z = {z:.1}",
                solved.mean_time, solved.rate
            );
            assert!(z < 4.0, "{damping:?} {side:?} {level}: {z}");
        }
    }
}

#[test]
fn a_level_on_the_wrong_side_is_refused_by_name_and_a_start_beyond_it_is_lost_at_once() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    for (level, side) in [
        (-1.0, Side::Above),
        (1.0, Side::Below),
        (-1.0, Side::Either),
        (f64::NAN, Side::Above),
    ] {
        let error = first_passage(
            &it,
            &Initial::Rest,
            (level, side, 10.0),
            &settings(1e-3),
            &|_| (),
        )
        .unwrap_err()
        .to_string();
        assert!(error.contains("outputs.first_passage.level"), "{error}");
    }
    let it = Oscillator::new(ContactLaw::Linear, 0.05, 0.01).unwrap();
    let beyond = Initial::gaussian([3.0, 0.0], [0.1, 0.1]).unwrap();
    let it = first_passage(
        &it,
        &beyond,
        (1.0, Side::Above, 10.0),
        &settings(1e-2),
        &|_| (),
    )
    .unwrap();
    assert!(it.survival.iter().all(|s| s.value < 1e-9));
}

#[test]
fn rare_passages_are_exponential_with_the_mean_time_of_their_rate() {
    // One in a thousand by t = 100: far too many to be left to the slowest mode alone, and few enough to hide from GMRES.
    let it = Oscillator::new(ContactLaw::Hertz, 0.02, 8e-3).unwrap();
    let start = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    let settings = Settings {
        cells: Some([63, 90]),
        step: Some(0.5),
        ..settings(1e-3)
    };
    let solved = first_passage(&it, &start, (3.0, Side::Above, 100.0), &settings, &|_| ()).unwrap();
    println!("mean time {}, rate {}", solved.mean_time, solved.rate);
    let product = solved.mean_time.value * solved.rate.value;
    assert!((product - 1.0).abs() < 1e-3, "{product}");
    // 380 x 544 nodes and steps of 0.0625 give 1.1751e-5 +- 7e-9.
    let away = (solved.rate.value - 1.1751e-5).abs();
    assert!(away < solved.rate.error && solved.rate.error < 0.03 * solved.rate.value);
}
