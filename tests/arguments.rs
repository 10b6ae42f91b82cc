//! What functions refuse that are called from Rust, without a scene that was checked before.

use vibroimpact::contact::{ContactLaw, Restoring};
use vibroimpact::damping::Damping;
use vibroimpact::excitation::{Drive, Excitation};
use vibroimpact::fokker_planck::{self, Settings};
use vibroimpact::gaussian::Gaussian;
use vibroimpact::initial::Initial;
use vibroimpact::monte_carlo::{self, Sampling};
use vibroimpact::oscillator::{Oscillator, Quantity, Side};
use vibroimpact::stationary::Stationary;
use vibroimpact::{Error, Result};

fn hertz() -> Oscillator {
    Oscillator::new(ContactLaw::Hertz, 0.05, 0.01).unwrap()
}

/// The key of a refusal.
fn key<T>(refused: Result<T>) -> String {
    match refused.err() {
        Some(Error::Invalid { key, .. }) => key,
        other => panic!("{other:?}"),
    }
}

fn settings(change: impl FnOnce(&mut Settings)) -> Settings {
    let mut it = Settings::default();
    change(&mut it);
    it
}

fn transient(initial: &Initial, times: &[f64], densities: &[f64], settings: &Settings) -> String {
    let asked = (times, densities);
    key(fokker_planck::transient(
        &hertz(),
        initial,
        asked.0,
        asked.1,
        settings,
        &|_| {},
    ))
}

#[test]
fn settings_that_no_scene_could_have_are_refused_by_every_solver() {
    let rest = Initial::Rest;
    let all: [(&str, Settings); 10] = [
        ("accuracy.tolerance", settings(|it| it.tolerance = f64::NAN)),
        ("accuracy.tolerance", settings(|it| it.tolerance = -1.0)),
        ("accuracy.tolerance", settings(|it| it.tolerance = 5.0)),
        ("neglected", settings(|it| it.neglected = Some(f64::NAN))),
        ("outputs.moments", settings(|it| it.moments = Some(vec![]))),
        (
            "method.cells[0]",
            settings(|it| it.cells = Some([usize::MAX; 2])),
        ),
        ("method.cells[1]", settings(|it| it.cells = Some([40, 0]))),
        ("method.step", settings(|it| it.step = Some(-0.1))),
        ("accuracy.max_seconds", settings(|it| it.max_seconds = 0.0)),
        (
            "accuracy.max_seconds",
            settings(|it| it.max_seconds = f64::INFINITY),
        ),
    ];
    for (named, settings) in all {
        let it = hertz();
        assert_eq!(transient(&rest, &[1.0], &[], &settings), named);
        assert_eq!(key(fokker_planck::steady(&it, &settings)), named);
        assert_eq!(key(fokker_planck::stationary_law(&it, &settings)), named);
        assert_eq!(key(fokker_planck::decay_rates(&it, 2, &settings)), named);
        let lost = fokker_planck::first_loss(&it, &rest, 1.0, &settings, &|_| {});
        assert_eq!(key(lost), named);
        let spectrum = fokker_planck::spectrum(&it, Quantity::Force, &[1.0], &settings, &|_| {});
        assert_eq!(key(spectrum), named);
        let drive = Drive::new(0.01, 0.9, 0.0).unwrap();
        let excitation = Excitation {
            drive: Some(drive),
            envelope: None,
        };
        let settings = Settings {
            excitation,
            ..settings
        };
        assert_eq!(
            key(fokker_planck::periodic(&it, 8, &settings, &|_| {})),
            named
        );
        assert_eq!(
            key(fokker_planck::response(&it, &[0.9], &settings, &|_| {})),
            named
        );
    }
    let plain = Settings::default();
    assert_eq!(
        key(fokker_planck::decay_rates(&hertz(), 101, &plain)),
        "outputs.decay_rates"
    );
    assert_eq!(
        key(fokker_planck::response(&hertz(), &[], &plain, &|_| {})),
        "outputs.response"
    );
}

#[test]
fn times_and_initial_conditions_are_looked_at_before_anything_is_computed() {
    let (rest, plain) = (Initial::Rest, Settings::default());
    for times in [&[][..], &[-1.0], &[2.0, 1.0], &[f64::NAN], &[f64::INFINITY]] {
        assert_eq!(transient(&rest, times, &[], &plain), "outputs.moments_at");
    }
    for densities in [&[0.5][..], &[f64::NAN]] {
        assert_eq!(
            transient(&rest, &[1.0], densities, &plain),
            "outputs.density_at"
        );
    }
    for (named, mean, deviation) in [
        ("initial.mean[0]", [f64::NAN, 0.0], [0.3, 0.3]),
        ("initial.mean[1]", [0.0, f64::INFINITY], [0.3, 0.3]),
        ("initial.deviation[1]", [0.0, 0.0], [0.3, -0.3]),
    ] {
        let initial = Initial::Gaussian { mean, deviation };
        assert_eq!(transient(&initial, &[1.0], &[], &plain), named);
        assert_eq!(key(Initial::gaussian(mean, deviation)), named);
        let lost = fokker_planck::first_loss(&hertz(), &initial, 1.0, &plain, &|_| {});
        assert_eq!(key(lost), named);
        let sampled = monte_carlo::run(&hertz(), &initial, &[1.0], &Sampling::default(), &|_| {});
        assert_eq!(key(sampled), named);
    }
}

#[test]
fn solved_and_sampled_first_passages_refuse_the_same_levels() {
    let (rest, it) = (Initial::Rest, hertz());
    for (level, side) in [
        (f64::NAN, Side::Above),
        (f64::INFINITY, Side::Above),
        (1e200, Side::Above),
        (0.0, Side::Either),
        (-1.0, Side::Either),
        (0.5, Side::Below),
        (-0.5, Side::Above),
    ] {
        let named = "outputs.first_passage.level";
        let asked = (level, side, 1.0);
        let solved = fokker_planck::first_passage(&it, &rest, asked, &Settings::default(), &|_| {});
        assert_eq!(key(solved), named, "{level} {side:?}");
        let few = Sampling {
            paths: 64,
            ..Sampling::default()
        };
        let sampled = monte_carlo::first_passage(&it, &rest, (level, side), &[1.0], &few, &|_| {});
        assert_eq!(key(sampled), named, "{level} {side:?}");
    }
    let many = Sampling {
        paths: u64::MAX,
        ..Sampling::default()
    };
    let sampled = monte_carlo::run(&it, &rest, &[1.0], &many, &|_| {});
    assert_eq!(key(sampled), "monte_carlo.paths");
}

/// Under friction that grows with q a linear contact has no Gaussian law.
#[test]
fn a_gaussian_is_none_under_other_damping_or_at_no_time() {
    let linear = Oscillator::new(ContactLaw::Linear, 0.1, 0.05).unwrap();
    let start = Gaussian::of(&linear, &Initial::Rest).unwrap();
    for t in [f64::INFINITY, f64::NAN, -5.0] {
        assert_eq!(key(start.after(&linear, t)), "t");
    }
    let damping = Damping::of_displacement(|q| 1.0 + 3.0 * q * q).unwrap();
    let it = linear.with_damping(damping).unwrap();
    assert_eq!(
        key(Gaussian::of(&it, &Initial::Stationary)),
        "oscillator.damping"
    );
    assert_eq!(key(start.after(&it, 30.0)), "oscillator.damping");
}

/// A bilinear law with what is asked for.
#[derive(Debug)]
struct Given {
    name: &'static str,
    ends: [Option<f64>; 2],
    kinks: Option<Vec<f64>>,
}

impl Restoring for Given {
    fn name(&self) -> &str {
        self.name
    }
    fn force(&self, q: f64) -> f64 {
        q.max(-1.0)
    }
    fn back_wall(&self) -> Option<f64> {
        self.ends[0]
    }
    fn loss_point(&self) -> Option<f64> {
        self.ends[1]
    }
    fn kinks(&self) -> Vec<f64> {
        let ends = || self.ends.into_iter().flatten().collect();
        self.kinks.clone().unwrap_or_else(ends)
    }
}

#[test]
fn walls_and_kinks_of_a_law_from_code_are_looked_at() {
    let given = |name, ends: [f64; 2], kinks: Option<Vec<f64>>| {
        ContactLaw::custom(Given {
            name,
            ends: ends.map(|it| Some(it).filter(|it| *it != f64::NEG_INFINITY)),
            kinks,
        })
    };
    let none = f64::NEG_INFINITY;
    for (ends, kinks) in [
        ([none, f64::NAN], None),
        ([none, f64::INFINITY], None),
        ([0.5, -1.0], None),
        ([-3.0, none], None),
        // Nothing stands there.
        ([-3.0, -1.0], None),
        ([none, -1.0], Some(vec![f64::NAN])),
        ([none, -1.0], Some(vec![1.0, 0.0])),
    ] {
        assert_eq!(
            key(given("mine", ends, kinks)),
            "contact law \"mine\"",
            "{ends:?}"
        );
    }
    for name in ["hertz", "power"] {
        let named = format!("contact law {name:?}");
        assert_eq!(key(given(name, [none, -1.0], None)), named);
    }
    // The loss point is a kink, whether it is named or not: P(loss) on the mesh is that of (21).
    let contact = given("mine", [none, -1.0], Some(vec![])).unwrap();
    assert_eq!(contact.kinks(), [-1.0]);
    let it = Oscillator::new(contact, 0.1, 0.05).unwrap();
    let steady = fokker_planck::steady(&it, &settings(|it| it.tolerance = 1e-2)).unwrap();
    let [meshed, exact] = [steady.moments, Stationary::of(&it).unwrap().moments()]
        .map(|it| it.contact_loss_probability.unwrap());
    println!("P(loss): {meshed} on the mesh, {exact}");
    assert!((meshed.value - exact.value).abs() <= meshed.error);
}
