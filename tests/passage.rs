//! First passage of any level, above, below or either side, beside paths and beside Rice's rate.

use vibroimpact::contact::{ContactLaw, Parameter, Parameters};
use vibroimpact::damping::Damping;
use vibroimpact::excitation::{Drive, Envelope, Excitation};
use vibroimpact::fokker_planck::{FirstLoss, Settings, first_loss, first_passage};
use vibroimpact::initial::Initial;
use vibroimpact::monte_carlo::{self, Sampling};
use vibroimpact::oscillator::{Oscillator, Side};
use vibroimpact::plan::Plan;
use vibroimpact::scene::text::SceneText;

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
        let (solved, z) = beside_paths(&it, &Initial::Rest, (level, side, 60.0), (3e-3, 60_000));
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
fn starts_high_above_wells_that_are_not_at_zero_lose_what_their_paths_lose() {
    let given = Parameters::new().with("coefficients", Parameter::Numbers(vec![-1.0, 0.0, 1.0]));
    let wells = ContactLaw::given("polynomial", &given).unwrap();
    let it = Oscillator::new(wells, 0.05, 1e-3).unwrap();
    let start = Initial::Gaussian {
        mean: [2.0, 0.0],
        deviation: [0.01, 0.01],
    };
    let asked = (-1.5, Side::Below, 3.0);
    // A mean time is not known on this mesh, nor asked about.
    let settings = Settings {
        cells: Some([144, 160]),
        ..settings(1e-2)
    };
    let solved = first_passage(&it, &start, asked, &settings, &|_| ()).unwrap();
    let sampling = Sampling {
        paths: 40_000,
        seed: 3,
        ..Sampling::default()
    };
    let level = (asked.0, asked.1);
    let sampled =
        monte_carlo::first_passage(&it, &start, level, &solved.times, &sampling, &|_| ()).unwrap();
    assert!(
        (solved.survival[0].value - 1.0).abs() < 1e-5,
        "{}",
        solved.survival[0]
    );
    for (t, (a, b)) in solved
        .times
        .iter()
        .zip(solved.survival.iter().zip(&sampled.survival))
    {
        println!("S({t}) = {a}, of paths {b}");
        // The paths see no difference of less than one in 40,000.
        let z = (a.value - b.value).abs() / a.error.hypot(b.error).max(2.5e-5);
        assert!(z < 4.0, "S({t}) = {a}, of paths {b}");
    }
}

/// The mode by which wells exchange what they hold is nearly as slow as the passage out of one of them.
#[test]
fn passages_out_of_two_wells_that_exchange_slowly_have_their_mean_time() {
    let given = Parameters::new().with("coefficients", Parameter::Numbers(vec![-1.0, 0.0, 1.0]));
    let wells = ContactLaw::given("polynomial", &given).unwrap();
    let it = |h: f64| Oscillator::new(wells.clone(), 0.05, h).unwrap();
    // So rare that both are 1 over one number.
    let asked = (-1.5, Side::Below, 3.0);
    let rare = first_passage(
        &it(1e-3),
        &Initial::Stationary,
        asked,
        &settings(1e-2),
        &|_| (),
    );
    let rare = rare.unwrap();
    assert!(rare.shortfall.is_none(), "{:?}", rare.shortfall);
    let (mean, rate) = (rare.mean_time, rare.rate);
    println!("mean time {mean}, rate {rate}");
    assert!(mean.error < 1e-2 * mean.value && rate.error < 1e-2 * rate.value);
    assert!((mean.value * rate.value - 1.0).abs() < 1e-2);
    // From the right well, against paths.
    let start = Initial::gaussian([1.0, 0.0], [0.1, 0.1]).unwrap();
    let (it, asked) = (it(3e-3), (-1.5, Side::Below, 1200.0));
    let solved = first_passage(&it, &start, asked, &settings(1e-2), &|_| ()).unwrap();
    assert!(solved.shortfall.is_none(), "{:?}", solved.shortfall);
    let sampling = Sampling {
        paths: 4000,
        seed: 7,
        ..Sampling::default()
    };
    let level = (asked.0, asked.1);
    let sampled =
        monte_carlo::first_passage(&it, &start, level, &solved.times, &sampling, &|_| ()).unwrap();
    let curves = solved.survival.iter().zip(&sampled.survival);
    for (t, (a, b)) in solved.times.iter().zip(curves) {
        let z = (a.value - b.value).abs() / a.error.hypot(b.error).max(2.5e-4);
        assert!(z < 4.0, "S({t}) = {a}, of paths {b}");
    }
    // What the curve leaves falls at the rate.
    let last = solved.survival[solved.survival.len() - 1].value;
    let (mean, rate) = (solved.mean_time, solved.rate);
    println!("S(1200) = {last}, mean time {mean}, rate {rate}");
    assert!(mean.error < 1e-2 * mean.value && rate.error < 1e-2 * rate.value);
    assert!(last > 0.05 && last < 0.8);
}

#[test]
fn a_first_round_that_is_near_by_chance_does_not_end_the_refinement() {
    // Its mesh seems to err by 2e-4, and by 3e-2 with half the step.
    let it = Oscillator::new(ContactLaw::Bilinear, 0.02098, 1.121e-4)
        .unwrap()
        .with_damping(Damping::Contact)
        .unwrap();
    let found = |tolerance| {
        let asked = (0.331, Side::Above, 21.6);
        let how = settings(tolerance);
        first_passage(&it, &Initial::Stationary, asked, &how, &|_| ()).unwrap()
    };
    let [rough, fine] = [1e-2, 3e-3].map(found);
    assert!(rough.shortfall.is_none(), "{:?}", rough.shortfall);
    let [a, b] = [rough.mean_time, fine.mean_time];
    println!("{a} {b}");
    assert!(a.error < 1e-2 * a.value && (a.value - b.value).abs() < a.error + b.error);
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
fn steps_that_do_not_see_noise_turn_a_motion_back_say_what_they_miss() {
    // Noise turns these back within 0.37 and 0.07; the first steps are of half a unit.
    for (zeta, h, level, side) in [
        (0.2317, 0.05896, -1.5, Side::Below),
        (0.07752, 0.003197, 0.509, Side::Above),
    ] {
        let it = Oscillator::new(ContactLaw::Hertz, zeta, h).unwrap();
        let [coarse, fine] = [1e-2, 1e-3].map(|tolerance| {
            let passage = (level, side, 60.0);
            first_passage(&it, &Initial::Rest, passage, &settings(tolerance), &|_| ()).unwrap()
        });
        for (coarse, fine) in [(coarse.mean_time, fine.mean_time), (coarse.rate, fine.rate)] {
            println!("{coarse} and {fine}");
            let off = (coarse.value - fine.value).abs();
            assert!(off < 0.7 * (coarse.error + fine.error), "{coarse} {fine}");
        }
    }
}

/// At the turning point itself, with deviations far below what noise does within a step.
#[test]
fn concentrated_starts_at_the_level_survive_as_their_paths_do_or_say_how_little_is_known() {
    let it = Oscillator::new(ContactLaw::Linear, 0.05, 0.02).unwrap();
    let start = |deviation: f64| Initial::Gaussian {
        mean: [1.0, 0.0],
        deviation: [deviation; 2],
    };
    let (level, side, until) = (1.0, Side::Above, 10.0);
    for (deviation, tolerance) in [(0.03, 0.03), (0.01, 0.03)] {
        let asked = (level, side, until);
        let (solved, z) = beside_paths(&it, &start(deviation), asked, (tolerance, 40_000));
        let first = solved.survival[1];
        println!("{deviation} at {tolerance}: {first:?}, z = {z:.2}");
        assert!(z < 3.0, "{deviation} at {tolerance}: {z}");
    }
    // A program of its own, steps of 1e-4, has 0.330 of 40 000 paths at t = 1.25, of a deviation of 1e-3.
    let given = Settings {
        step: Some(0.25),
        ..settings(0.1)
    };
    let coarse = first_passage(&it, &start(1e-3), (level, side, until), &given, &|_| ()).unwrap();
    assert!(coarse.shortfall.is_some());
    for survival in &coarse.survival[1..] {
        let decays = (-coarse.rate.value * 10.0).exp();
        assert!(survival.error > 0.15 * decays, "{survival:?}");
    }
}

/// The force is next to nothing there: the mesh near the level is as fine as noise wants it.
#[test]
fn a_level_next_to_rest_is_passed_as_by_paths() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    let asked = (0.01, Side::Above, 20.0);
    let (solved, z) = beside_paths(&it, &Initial::Rest, asked, (0.1, 20_000));
    println!("z = {z:.2}, mean time {}", solved.mean_time);
    assert!(z < 2.0, "{z}");
    // A program of its own, steps of 5e-4.
    for (time, exact) in [(0.5, 0.5055), (2.5, 0.2666), (5.0, 0.0591)] {
        let after = solved.times.partition_point(|t| *t < time);
        let held = [after - 1, after].map(|k| solved.survival[k]);
        let within = held[0].value + held[0].error > exact && held[1].value - held[1].error < exact;
        assert!(within, "{time}: {held:?}");
    }
}

#[test]
fn the_rate_tends_to_rice_s_as_the_level_rises() {
    let it = Oscillator::new(ContactLaw::Linear, 0.3, 0.02).unwrap();
    let deviation = it.temperature().sqrt();
    let mut apart = Vec::new();
    for level in [2.0, 3.0, 5.0] {
        let passage = (level * deviation, Side::Above, 10.0);
        let solved =
            first_passage(&it, &Initial::Stationary, passage, &settings(3e-3), &|_| ()).unwrap();
        println!(
            "{level} deviations: rate over Rice's {}",
            solved.rate_over_rice
        );
        apart.push((solved.rate_over_rice.value - 1.0).abs());
    }
    // Passages thin out, and one forgets the one before.
    assert!(apart.windows(2).all(|r| r[1] < r[0]));
    assert!(apart[0] > 0.01 && apart[2] < 5e-3);
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

/// Between two wells, at the top and beyond it, and short of the equilibrium of one well: the force takes the motion through.
#[test]
fn levels_that_the_force_pushes_through_are_passed_as_by_paths() {
    let given = Parameters::new().with("coefficients", Parameter::Numbers(vec![-1.0, 0.0, 1.0]));
    let wells = ContactLaw::given("polynomial", &given).unwrap();
    let wells = Oscillator::new(wells, 0.1, 0.02).unwrap();
    let hertz = Oscillator::new(ContactLaw::Hertz, 0.1, 0.02).unwrap();
    let right = Initial::gaussian([1.0, 0.0], [0.1, 0.1]).unwrap();
    for (it, initial, passage) in [
        (&wells, &right, (0.0, Side::Below, 30.0)),
        (&wells, &right, (-0.5, Side::Below, 30.0)),
        (&wells, &Initial::Stationary, (0.4, Side::Above, 30.0)),
        (&wells, &Initial::Rest, (0.5, Side::Either, 5.0)),
        (&hertz, &right, (0.6, Side::Below, 5.0)),
    ] {
        let (level, side, _) = passage;
        let (solved, z) = beside_paths(it, initial, passage, (1e-2, 20_000));
        let (mean, rate) = (solved.mean_time, solved.rate);
        println!("{side:?} {level}: mean time {mean}, rate {rate}, z = {z:.1}");
        assert!(z < 4.0, "{side:?} {level}: {z}");
        // Against a tenth of the tolerance.
        let finer = first_passage(it, initial, passage, &settings(1e-3), &|_| ()).unwrap();
        for (a, b) in [(mean, finer.mean_time), (rate, finer.rate)] {
            assert!((a.value - b.value).abs() < a.error + b.error, "{a} for {b}");
        }
    }
}

#[test]
fn under_friction_of_impacts_short_steps_hold_on_the_first_mesh_and_cells_on_which_survival_grows_are_refused()
 {
    let it = Oscillator::new(ContactLaw::Hertz, 0.5, 0.2).unwrap();
    let it = it.with_damping(Damping::HuntCrossley).unwrap();
    let start = Initial::gaussian([1.0, 0.0], [0.3, 0.3]).unwrap();
    let passage = (-1.5, Side::Below, 20.0);
    let short = Settings {
        step: Some(0.0481),
        ..settings(1e-3)
    };
    let solved = first_passage(&it, &start, passage, &short, &|_| ()).unwrap();
    println!("{:?}: mean time {}", solved.method.cells, solved.mean_time);
    assert_eq!(solved.method.cells, [56, 80]);
    // Of 1e5 paths.
    let (a, b) = (solved.survival.last().unwrap(), 0.2877);
    assert!((a.value - b).abs() < 4.0 * a.error.hypot(1.4e-3), "{a}");
    for (cells, step) in [([24, 32], 0.005), ([16, 16], 0.0481)] {
        let given = Settings {
            cells: Some(cells),
            step: Some(step),
            ..short.clone()
        };
        let error = first_passage(&it, &start, passage, &given, &|_| ()).unwrap_err();
        assert!(error.to_string().contains("grows"), "{cells:?}: {error}");
    }
}

#[test]
fn a_level_that_is_none_is_refused_by_name_and_a_start_beyond_one_is_lost_at_once() {
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
    // Nothing is relative to a time of 0, and it has an error.
    assert!(
        it.mean_time.value < 1e-9 && it.mean_time.error < 1e-9,
        "{}",
        it.mean_time
    );
    // The rate is that of whatever survives.
    assert!(it.rate.error < 1e-2 * it.rate.value, "{}", it.rate);
    assert!(it.shortfall.is_none(), "{:?}", it.shortfall);
}

/// Noise alone hardly pushes a motion so deep against Hunt and Crossley's friction, and a flight needs 61 T to come there, four times
/// the energy of the level.
#[test]
fn a_level_that_friction_guards_is_passed_from_flights_far_above_its_energy() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.287, 0.021).unwrap();
    let it = it.with_damping(Damping::HuntCrossley).unwrap();
    let level = (1.71, Side::Above, 50.0);
    let solved = first_passage(&it, &Initial::Rest, level, &settings(3e-2), &|_| ()).unwrap();
    println!("rate {}, {:?}", solved.rate, solved.method.cells);
    // Tolerances of 1e-2 to 1e-3 give 6.702e-9 +- 2e-11, from 569 x 345 nodes on.
    let away = (solved.rate.value - 6.702e-9).abs();
    assert!(away < solved.rate.error && solved.rate.error < 0.05 * solved.rate.value);
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
    assert!(away < solved.rate.error && solved.rate.error < 0.05 * solved.rate.value);
}

#[test]
fn a_rate_below_rounding_is_that_of_detailed_balance_in_one_of_two_wells_and_in_both() {
    // Over the barrier at 0 from -1, and through -2.8 from either well: 1e-25 a unit of time and less.
    let given = Parameters::new().with("coefficients", Parameter::Numbers(vec![-1.0, 0.0, 1.0]));
    let wells = ContactLaw::given("polynomial", &given).unwrap();
    for (zeta, h, level) in [(0.05, 1.2e-4, 0.3), (0.1, 0.013, -2.8)] {
        let it = Oscillator::new(wells.clone(), zeta, h).unwrap();
        let passage = (level, Side::Below, 10.0);
        let got = first_passage(&it, &Initial::Stationary, passage, &settings(1e-2), &|_| ());
        let got = got.unwrap();
        println!("{} {} {}", got.rate, got.mean_time, got.rate_over_rice);
        assert!(got.shortfall.is_none());
        assert!(got.rate.value > 0.0 && got.rate.value < 1e-24);
        let product = got.rate.value * got.mean_time.value;
        assert!((product - 1.0).abs() < 1e-6, "{product}");
        let lost = got.lost[got.lost.len() - 1].value;
        assert!(
            (lost / (10.0 * got.rate.value) - 1.0).abs() < 0.05,
            "{lost}"
        );
        assert!((got.rate_over_rice.value - 1.0).abs() < 0.02);
    }
}

fn driven(amplitude: f64, frequency: f64) -> Excitation {
    Excitation {
        drive: Some(Drive::new(amplitude, frequency, 0.4).unwrap()),
        envelope: None,
    }
}

#[test]
fn forward_in_time_the_adjoint_says_what_the_backward_equation_says() {
    // A drive of next to no amplitude takes the other road, and changes nothing.
    let it = Oscillator::new(ContactLaw::Hertz, 0.02, 6e-3).unwrap();
    let near = Initial::gaussian([0.2, 0.0], [0.3, 0.2]).unwrap();
    for initial in [Initial::Rest, Initial::Stationary, near] {
        let asked = settings(3e-3);
        let plain = first_loss(&it, &initial, 40.0, &asked, &|_| ()).unwrap();
        let asked = Settings {
            excitation: driven(1e-13, 0.9),
            ..asked
        };
        let other = first_loss(&it, &initial, 40.0, &asked, &|_| ()).unwrap();
        let pairs = plain.survival.iter().zip(&other.survival);
        let off = pairs
            .map(|(a, b)| (a.value - b.value).abs())
            .fold(0.0, f64::max);
        let error = plain.survival.iter().map(|it| it.error).fold(0.0, f64::max);
        println!(
            "{}: off by {off:.1e}, errors up to {error:.1e}",
            initial.name()
        );
        assert!(off < error && off < 1e-3);
        assert!(other.rate.value.is_nan() && other.mean_time.value.is_nan());
    }
}

#[test]
fn an_envelope_that_is_2_throughout_is_twice_the_noise() {
    let level = |h: f64| Oscillator::new(ContactLaw::Hertz, 0.05, h).unwrap();
    let even = Excitation {
        drive: None,
        envelope: Some(Envelope::new(vec![0.0], vec![2.0]).unwrap()),
    };
    let plain = first_loss(&level(0.02), &Initial::Rest, 30.0, &settings(2e-3), &|_| ()).unwrap();
    let asked = Settings {
        excitation: even,
        ..settings(2e-3)
    };
    let other = first_loss(&level(0.01), &Initial::Rest, 30.0, &asked, &|_| ()).unwrap();
    let pairs = plain.survival.iter().zip(&other.survival);
    let worst = pairs.map(|(a, b)| (a.value - b.value).abs() / (a.error + b.error));
    let worst = worst.fold(0.0, f64::max);
    println!(
        "{worst:.2} of both errors; S(30) = {}",
        other.survival[other.survival.len() - 1]
    );
    assert!(worst < 1.0);
}

#[test]
fn under_a_drive_and_an_envelope_contact_is_lost_as_the_paths_lose_it() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.05, 0.02).unwrap();
    let rise = |times: &[f64], factors: &[f64]| {
        Some(Envelope::new(times.to_vec(), factors.to_vec()).unwrap())
    };
    let near = Initial::gaussian([0.3, 0.0], [0.3, 0.3]).unwrap();
    let friction = |damping| it.clone().with_damping(damping).unwrap();
    let in_contact = friction(Damping::Contact);
    let hunt_crossley = friction(Damping::HuntCrossley);
    for (it, excitation, initial, passage) in [
        (&in_contact, driven(0.3, 0.8), Initial::Rest, None),
        // Friction jumps within what the level leaves.
        (
            &in_contact,
            driven(0.2, 0.9),
            Initial::Rest,
            Some((1.3, Side::Above)),
        ),
        (&it, driven(0.1, 0.9), Initial::Stationary, None),
        (
            &hunt_crossley,
            Excitation {
                envelope: rise(&[0.0, 3.0, 15.0], &[0.5, 2.0, 0.2]),
                ..driven(0.2, 1.1)
            },
            near,
            None,
        ),
        (
            &it,
            Excitation {
                drive: None,
                envelope: rise(&[2.0, 12.0], &[0.0, 1.0]),
            },
            Initial::Rest,
            Some((1.0, Side::Above)),
        ),
        (
            &it,
            driven(0.2, 0.9),
            Initial::Rest,
            Some((1.3, Side::Either)),
        ),
    ] {
        let asked = Settings {
            excitation: excitation.clone(),
            ..settings(4e-3)
        };
        let sampling = Sampling {
            paths: 40_000,
            seed: 5,
            excitation,
            ..Sampling::default()
        };
        let until = 25.0;
        let quiet: &(dyn Fn(f64) + Sync) = &|_| ();
        let (solved, sampled) = match passage {
            None => {
                let solved = first_loss(it, &initial, until, &asked, quiet).unwrap();
                let times = &solved.times.clone();
                let sampled = monte_carlo::first_loss(it, &initial, times, &sampling, quiet);
                (solved, sampled.unwrap())
            }
            Some((level, side)) => {
                let asked_for = (level, side, until);
                let solved = first_passage(it, &initial, asked_for, &asked, quiet).unwrap();
                let level = (level, side);
                let times = &solved.times.clone();
                let sampled =
                    monte_carlo::first_passage(it, &initial, level, times, &sampling, quiet);
                (solved, sampled.unwrap())
            }
        };
        let pairs = solved.survival.iter().zip(&sampled.survival).skip(1);
        let z = pairs
            .map(|(a, b)| (a.value - b.value).abs() / a.error.hypot(b.error))
            .filter(|z| z.is_finite())
            .fold(0.0, f64::max);
        let last = solved.times.len() - 1;
        println!(
            "{}, {passage:?}: S({until}) = {}, paths {}; worst z {z:.1}; {:?} nodes, step {}, {:?}",
            initial.name(),
            solved.survival[last],
            sampled.survival[last],
            solved.method.cells,
            solved.method.step,
            solved.shortfall
        );
        assert!(z < 4.0 && solved.shortfall.is_none());
        // The density is the slope of the survival.
        let gap = solved.times[1];
        let integral: f64 = solved
            .density
            .windows(2)
            .map(|w| 0.5 * gap * (w[0].value + w[1].value))
            .sum();
        let lost = solved.lost[last].value - solved.lost[0].value;
        assert!(
            (integral - lost).abs() < 1e-2 * lost.max(0.1),
            "{integral} {lost}"
        );
    }
}

#[test]
fn a_rate_below_rounding_that_no_detailed_balance_tells_is_not_said_to_be_known() {
    let it = Oscillator::new(ContactLaw::Linear, 0.2, 0.02).unwrap();
    let level = 9.5 * it.temperature().sqrt();
    let how = Settings {
        max_seconds: 10.0,
        ..settings(1e-2)
    };
    let asked = (level, Side::Either, 20.0);
    let it = first_passage(&it, &Initial::Rest, asked, &how, &|_| ()).unwrap();
    println!("rate {}, {:?}", it.rate, it.shortfall);
    // About 1e-20.
    assert!(it.rate.value.is_nan() && it.mean_time.value.is_nan());
    let said = it.shortfall.unwrap();
    assert!(
        !said.free && said.to_string().contains("rounding"),
        "{said}"
    );
    // What does not hang on it is known.
    let last = it.survival[it.survival.len() - 1];
    assert!(last.error < 1e-2 && (last.value - 1.0).abs() <= last.error);
}

#[test]
fn what_the_stationary_law_next_to_never_passes_is_bounded_by_it_without_a_mesh() {
    // At the loss of contact exp(-H/T) underflows by far.
    let low = |h: f64| Oscillator::new(ContactLaw::Hertz, 0.0195, h).unwrap();
    let near = Initial::Gaussian {
        mean: [0.01, 0.0],
        deviation: [0.02, 0.01],
    };
    for initial in [Initial::Rest, Initial::Stationary, near] {
        let it = first_loss(&low(4.3e-6), &initial, 200.0, &settings(1e-3), &|_| ()).unwrap();
        assert!(it.shortfall.is_none() && it.method.steps == 0, "{it:?}");
        assert!(it.rate.value == 0.0 && it.rate.error > 0.0 && it.rate.error < 1e-280);
        for (survival, lost) in it.survival.iter().zip(&it.lost) {
            assert!(survival.value == 1.0 && survival.error < 1e-15);
            assert!(lost.value == 0.0 && lost.error < 1e-15);
        }
    }
    // A blow above the energy at the loss point is followed.
    let blow = Initial::Gaussian {
        mean: [0.0, -1.5],
        deviation: [0.05, 0.05],
    };
    let it = first_loss(&low(4.3e-6), &blow, 2.0, &settings(1e-2), &|_| ()).unwrap();
    assert!(it.survival.last().unwrap().value < 0.1 && it.method.steps > 0);
}

#[test]
fn paths_are_there_where_the_backward_equation_has_no_answer() {
    // Steps as short as this time ask for more nodes than a second allows.
    let text = "[oscillator]\nzeta = 0.05\nh = 1e-2\n[initial]\nkind = \"rest\"\n\
                [outputs]\nfirst_loss = { until = 0.01 }\n[monte_carlo]\npaths = 1000\n\
                [accuracy]\nmax_seconds = 1\n";
    let scene = SceneText::parse("a.toml", text, &[]).unwrap();
    let results = Plan::of(scene.scene()).unwrap().run_quietly().unwrap();
    assert!(results.first_loss.is_none() && !results.shortfalls.is_empty());
    let paths = results.first_loss_paths.as_ref().unwrap();
    assert_eq!(paths.survival.len(), 17);
    assert!(paths.survival[16].value == 1.0 && paths.survival[16].error > 0.0);
    let table = vibroimpact::report::terminal::table(&results, false);
    assert!(table.contains("survives 0.01"), "{table}");
}

/// Of two paths both have passed in time by chance where most take longer: the mean time of those says how little it knows.
#[test]
fn the_mean_time_of_few_paths_that_all_passed_holds_that_others_may_not() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.1, 0.02).unwrap();
    let level = (0.9, Side::Above);
    let solved = first_passage(
        &it,
        &Initial::Rest,
        (level.0, level.1, 30.0),
        &settings(1e-1),
        &|_| (),
    )
    .unwrap();
    let means = (0..40).filter_map(|seed| {
        let sampling = Sampling {
            paths: 2,
            seed,
            ..Sampling::default()
        };
        let times = &solved.times;
        let it = monte_carlo::first_passage(&it, &Initial::Rest, level, times, &sampling, &|_| ());
        it.unwrap().mean_time_of_all()
    });
    let z: Vec<f64> = means
        .map(|it| (it.value - solved.mean_time.value) / it.error)
        .collect();
    let far = z.iter().filter(|z| z.abs() > 2.0).count();
    println!("{} pairs, {far} beyond 2: {z:.1?}", z.len());
    assert!(z.len() > 5 && 10 * far <= z.len());
}

/// A flight that noise holds up for a time t costs exp(-t/(4 pi h)): no survival falls faster. Where the level is passed in flight the
/// motion to it is that of a constant force alone, without a mode that lasts longer.
#[test]
fn no_survival_falls_faster_than_free_flight_lets_it() {
    for (contact, zeta, h, level) in [
        (ContactLaw::Hertz, 1.0, 0.02, -1.6),
        (ContactLaw::Bilinear, 0.5, 0.02, -1.2),
    ] {
        let it = Oscillator::new(contact, zeta, h).unwrap();
        let passage = (level, Side::Above, 5.0);
        let asked = settings(1e-2);
        let got = first_passage(&it, &Initial::Stationary, passage, &asked, &|_| ()).unwrap();
        let edge = -it.continuous_from().unwrap();
        println!("{:?}, {edge} at most; {:?}", got.rate, got.shortfall);
        assert!((got.rate.value - edge).abs() <= got.rate.error);
        assert!(got.rate.value <= edge && got.rate.error < 0.2 * edge);
        // The program is not free to do better, and says so.
        assert!(
            got.shortfall
                .is_some_and(|it| it.number() == "rate" && !it.free)
        );
        assert!(got.mean_time.error < 1e-2 * got.mean_time.value);
    }
}

/// Near the edge the mode of a passage reaches far into flight, beyond a mesh that ends where little of the law is left.
#[test]
fn a_mode_that_the_end_of_the_mesh_cuts_says_what_it_may_err_by() {
    let it = Oscillator::new(ContactLaw::Hertz, 1.0, 1.0).unwrap();
    let [coarse, fine] = [1e-2, 1e-3].map(|tolerance| {
        let asked = settings(tolerance);
        let passage = (1.0, Side::Above, 30.0);
        first_passage(&it, &Initial::Rest, passage, &asked, &|_| ()).unwrap()
    });
    println!("{:?} and {:?}", coarse.rate, fine.rate);
    let apart = (coarse.rate.value - fine.rate.value).abs();
    assert!(apart <= coarse.rate.error && fine.rate.error < coarse.rate.error);
    assert!(coarse.rate.error < 0.05 * coarse.rate.value);
}
