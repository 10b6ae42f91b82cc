//! The two surveys end to end on a reduced set: what a verdict means, and that errors fall as they should.

use crate::precision::case::cases;
use crate::precision::entry::{Effort, Entry, survey};
use crate::precision::method::Method;
use crate::precision::table;
use crate::stability::against::Against;
use crate::stability::extreme::{Extreme, scenes};
use crate::stability::run;
use crate::stability::verdict::{Row, Verdict};
use vibroimpact::scene::text::SceneText;

fn rows(names: &[&str]) -> Vec<Row> {
    let mut chosen = scenes().unwrap();
    chosen.retain(|it| names.contains(&it.name.as_str()));
    assert_eq!(chosen.len(), names.len());
    run(chosen, &|row| {
        println!("{} {} {:?}", row.name, row.verdict, row.worst);
    })
}

fn scene(name: &str) -> Extreme {
    let mut all = scenes().unwrap();
    all.retain(|it| it.name == name);
    all.remove(0)
}

#[test]
fn extreme_scenes_are_many_and_have_names_of_their_own() {
    let all = scenes().unwrap();
    assert!(all.len() >= 132, "{}", all.len());
    for (k, scene) in all.iter().enumerate() {
        assert!(
            all[..k].iter().all(|it| it.name != scene.name),
            "{}",
            scene.name
        );
        // A scene that cannot be read tests nothing but its reader.
        let read = SceneText::parse(&scene.name, &scene.toml, &[]);
        let refused = scene.against == Against::Refusal || scene.may_refuse.is_some();
        assert!(read.is_ok() || refused, "{}: {}", scene.name, scene.toml);
    }
}

#[test]
fn cheap_extreme_scenes_are_answered_within_their_error_estimates_or_refused_with_advice() {
    let names = [
        "zeta-1e-6-linear",
        "T-1e-8-linear",
        "time-zero",
        "time-1e-12",
        "time-1e-300",
        "time-1e6",
        "time-1e9-stationary",
        "loss-1e-300",
        "loss-1e-30000",
        "step-100-flow-map",
        "step-1-euler-damped",
        "steady-hot",
        "aspect-1e-4",
        "paths-two",
        "paths-baoab-period",
        "paths-euler-0.05",
        "paths-4-2-stiff",
    ];
    for row in rows(&names) {
        assert!(row.verdict.honest(), "{row:?}");
        // No number is excused: each is within its error estimate, or there is none.
        assert_ne!(row.verdict, Verdict::Warned, "{row:?}");
        match row.worst {
            Some((ratio, _)) => assert!(ratio <= 1.0),
            None => assert!(row.message.len() > 20, "{row:?}"),
        }
    }
}

#[test]
fn a_number_outside_its_error_estimate_is_seen() {
    // The same transient against a contact it does not have.
    let mut wrong = scene("step-100-flow-map");
    let overrides = ["oscillator.contact=hertz", "method.step=1"];
    wrong.against = Against::Other(overrides.map(str::to_owned).to_vec());
    let row = &run(vec![wrong], &|_| ())[0];
    println!("{row:?}");
    assert_eq!(row.verdict, Verdict::Outside);
    assert!(!row.verdict.honest() && row.worst.as_ref().unwrap().0 > 1.0);
}

#[test]
fn a_warning_excuses_no_number_that_it_does_not_name() {
    // Steps of a period make the scheme warn; another contact makes the numbers wrong, steps or not.
    let mut wrong = scene("paths-6-2-period-moving");
    wrong.toml = wrong.toml.replace("splitting_6_2", "baoab");
    wrong.toml = wrong.toml.replace("step = 6.283185307179586", "step = 0.5");
    let overrides = ["oscillator.contact=hertz", "monte_carlo.step=0.1"];
    wrong.against = Against::Other(overrides.map(str::to_owned).to_vec());
    let row = &run(vec![wrong], &|_| ())[0];
    println!("{row:?}");
    assert!(row.message.contains("the step 0.5 is long"));
    assert_eq!(row.verdict, Verdict::Outside);
}

#[test]
fn a_limit_is_no_answer_where_one_is_expected() {
    let mut overlong = scene("step-1e-6-explicit");
    overlong.max_seconds = 1.0;
    let allowed = &run(vec![overlong.clone()], &|_| ())[0];
    overlong.may_stop = None;
    let expected = &run(vec![overlong], &|_| ())[0];
    println!("{} {}", allowed.verdict, expected.verdict);
    assert_eq!(allowed.verdict, Verdict::Stopped);
    assert_eq!(expected.verdict, Verdict::Unsolved);
    assert!(allowed.verdict.honest() && !expected.verdict.honest());
}

#[test]
fn errors_fall_with_the_mesh_and_with_the_paths() {
    let linear = cases()
        .unwrap()
        .into_iter()
        .find(|it| it.name == "linear")
        .unwrap();
    let mut methods = Method::all(&linear);
    // Its factorisations take half of the time; it differs from the others in time alone, which tests/time.rs looks at.
    methods.retain(|it| !it.to_string().ends_with("implicit"));
    let survey = survey(&linear, &methods, Effort::Quick, &|_| ()).unwrap();
    for (method, why) in &survey.failures {
        println!("{method}: {why}");
    }
    let mut checked = 0;
    for method in methods {
        let errors: Vec<f64> = survey
            .entries
            .iter()
            .filter(|it| it.method == method)
            .map(Entry::main_error)
            .collect();
        let shown: Vec<String> = errors.iter().map(|e| format!("{e:.1e}")).collect();
        println!("{method}: {}", shown.join(" "));
        if errors.len() < 2 {
            let failed = survey.failures.iter().any(|it| it.0 == method);
            assert!(failed, "{method} is neither there nor explained");
            continue;
        }
        checked += 1;
        // One seed of paths may be lucky at the first level; both stay within four standard errors.
        if method.samples() {
            assert!(
                errors[0] < 4.0 / 1e3f64.sqrt() && errors[1] < 4.0 / 1e4f64.sqrt(),
                "{method}"
            );
        } else {
            assert!(errors[1] < errors[0] && errors[1] > 1e-12, "{method}");
        }
    }
    assert!(checked >= 10, "{checked} methods");
    let files = table::files(&[survey], &[]).unwrap();
    let names: Vec<&str> = files.iter().map(|it| it.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "precision.csv",
            "cost.csv",
            "precision.md",
            "precision_linear.svg"
        ]
    );
}
