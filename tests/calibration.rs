//! Error bars are true: the program's own calibration on some of its scenes.

use vibroimpact::precision::calibration::{Calibration, End, TOLERANCES};
use vibroimpact::precision::truths::{Case, cases};

/// Every contact law, zeta from 4e-4 to 5, T from 1.7e-4 to 7; from rest, from Gaussians narrow, wide and
/// far away, from the stationary law; to 20/zeta.
const SCENES: [usize; 8] = [1, 2, 3, 5, 7, 8, 13, 29];

#[test]
fn the_error_of_a_number_is_below_its_bar_and_its_bar_below_the_tolerance_or_the_run_says_so() {
    let cases: Vec<Case> = cases().unwrap();
    let cases: Vec<Case> = cases
        .into_iter()
        .filter(|case| SCENES.contains(&case.number))
        .collect();
    assert_eq!(cases.len(), SCENES.len());
    let calibration = Calibration::of(&cases, &TOLERANCES[..3], &mut |_| Ok(())).unwrap();
    println!("{calibration}");
    for run in calibration.runs() {
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
