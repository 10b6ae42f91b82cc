//! Error estimates are true: the laboratory's own calibration, of moments on some of its scenes, of decay rates on all.

use crate::precision::calibration::{Calibration, End, TOLERANCES};
use crate::precision::rates::{Rates, scenes};
use crate::precision::references::{Case, cases};
use crate::stability::yardstick::exact_rates;
use std::fmt::Write;
use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::{Settings, decay_rates, policy};
use vibroimpact::oscillator::Oscillator;

/// Every contact law, zeta from 4e-4 to 8, T from 1.7e-4 to 19; from rest, from Gaussians narrow, wide and
/// far away, from the stationary law; to 20/zeta.
const SCENES: [usize; 9] = [1, 2, 3, 5, 7, 13, 14, 17, 29];

#[test]
fn the_error_of_a_number_is_below_its_estimate_and_that_below_the_tolerance_or_the_run_says_so() {
    let cases: Vec<Case> = cases().unwrap();
    let cases: Vec<Case> = cases
        .into_iter()
        .filter(|case| SCENES.contains(&case.number))
        .collect();
    assert_eq!(cases.len(), SCENES.len());
    let calibration = Calibration::of(&cases, &TOLERANCES[..3], &|_| ());
    println!("{calibration}");
    for run in &calibration.runs {
        if let End::Refused(why) = &run.end {
            panic!("{}: {why}", run.scene);
        }
    }
    for it in calibration.verdicts() {
        let tolerance = it.tolerance;
        assert!(it.numbers > 100, "{tolerance}: {} numbers", it.numbers);
    }
    let missed = calibration.missed();
    assert!(missed.is_empty(), "{missed:?}");
}

/// SCENES="49 50" names the scenes, TOLERANCES="1e-2 1e-3" the tolerances; all of either without. POLICY="SAFETY=0.8" multiplies
/// numbers that were chosen.
#[test]
#[ignore = "a look at single scenes: minutes"]
fn chosen_scenes() {
    fn list<T: std::str::FromStr>(name: &str) -> Option<Vec<T>> {
        let text = std::env::var(name).ok()?;
        Some(
            text.split_whitespace()
                .filter_map(|it| it.parse().ok())
                .collect(),
        )
    }
    for moved in list::<String>("POLICY").unwrap_or_default() {
        let (name, factor) = moved.split_once('=').unwrap();
        let chosen = policy::ALL.iter().find(|it| it.name == name).unwrap();
        chosen.multiply(factor.parse().unwrap());
    }
    let mut cases = cases().unwrap();
    if let Some(numbers) = list("SCENES") {
        cases.retain(|case| numbers.contains(&case.number));
    }
    let tolerances = list("TOLERANCES").unwrap_or(TOLERANCES.to_vec());
    let calibration = Calibration::of(&cases, &tolerances, &|run| {
        println!(
            "scene {}, {:.0e}: {}, {:.2} processor seconds, {:.2} planned, {:?}, {} numbers",
            run.scene,
            run.tolerance,
            run.end.name(),
            run.seconds,
            run.planned,
            run.chosen,
            run.numbers.len()
        );
    });
    println!("{calibration}");
}

#[test]
fn every_estimate_holds_over_six_of_the_thirty_oscillators() {
    // All of them: lab precision --calibrate.
    let all = Rates::calibrate(5).unwrap();
    for it in &all.judged {
        println!(
            "{} {:e}: {:?}, error {:.1e}",
            it.scene, it.tolerance, it.rate, it.error
        );
    }
    println!("{all}");
    assert!(
        all.judged.len() > 42 && all.missed().is_empty(),
        "{:?}",
        all.missed()
    );
}

#[test]
#[ignore = "writes the references: minutes"]
fn write_references() {
    let mut text = String::from("scene,re,im,error\n");
    for (scene, it) in scenes().unwrap().iter().enumerate() {
        for (re, im, error) in reference(it) {
            writeln!(text, "{scene},{re:.14e},{im:.14e},{error:.1e}").unwrap();
        }
    }
    std::fs::write("validation/precision/decay_rates.csv", text).unwrap();
}

fn reference(oscillator: &Oscillator) -> Vec<(f64, f64, f64)> {
    if *oscillator.contact() == ContactLaw::Linear {
        let exact = exact_rates(oscillator.zeta()).into_iter().take(12);
        return exact.map(|[re, im]| (re, im, 0.0)).collect();
    }
    let settings = Settings {
        cells: Some([144, 150]),
        tolerance: 1e-7,
        ..Settings::default()
    };
    let it = decay_rates(oscillator, 6, &settings).unwrap();
    it.rates.iter().map(|r| (r.re, r.im, r.error)).collect()
}
