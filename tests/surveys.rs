//! The two surveys end to end on a reduced set: what a verdict means, and that errors fall as they should.

use std::process::Command;
use vibroimpact::precision::{self, Effort, Method};
use vibroimpact::stability::{self, Against, Extreme, Row, Verdict};

fn rows(names: &[&str]) -> Vec<Row> {
    let chosen: Vec<Extreme> = stability::scenes()
        .into_iter()
        .filter(|it| names.contains(&it.name))
        .collect();
    assert_eq!(chosen.len(), names.len());
    stability::run(chosen, &|row| println!("{} {}", row.name, row.verdict))
}

#[test]
fn extreme_scenes_are_many_and_have_names_of_their_own() {
    let all = stability::scenes();
    assert!(all.len() >= 30, "{}", all.len());
    for (k, scene) in all.iter().enumerate() {
        assert!(
            all[..k].iter().all(|it| it.name != scene.name),
            "{}",
            scene.name
        );
    }
}

#[test]
fn cheap_extreme_scenes_are_answered_within_their_bars_or_refused_with_advice() {
    let names = [
        "zeta-1e-6-linear",
        "T-1e-8-linear",
        "time-zero",
        "time-1e-12",
        "time-1e-300",
        "loss-1e-300",
        "loss-1e-30000",
        "step-100-flow-map",
        "step-1-euler-damped",
        "steady-hot",
        "thrown-10-sigma-linear",
        "aspect-1e-4",
        "paths-two",
        "paths-baoab-period",
    ];
    for row in rows(&names) {
        assert!(row.verdict.honest(), "{row:?}");
        if matches!(row.verdict, Verdict::Refused | Verdict::Warned) {
            assert!(row.message.len() > 20, "{row:?}");
        }
        if row.verdict == Verdict::Within {
            assert!(row.worst.unwrap().0 <= 1.0);
        }
    }
}

#[test]
fn a_number_outside_its_bar_is_seen() {
    // The same transient against a contact it does not have.
    let mut wrong: Extreme = stability::scenes()
        .into_iter()
        .find(|it| it.name == "step-100-flow-map")
        .unwrap();
    wrong.against = Against::Other(&["oscillator.contact=hertz", "method.step=1"]);
    let row = &stability::run(vec![wrong], &|_| ())[0];
    println!("{row:?}");
    assert_eq!(row.verdict, Verdict::Outside);
    assert!(!row.verdict.honest() && row.worst.as_ref().unwrap().0 > 1.0);
}

#[test]
fn errors_fall_with_the_mesh_and_with_the_paths() {
    let linear = precision::cases()
        .unwrap()
        .into_iter()
        .find(|it| it.name == "linear")
        .unwrap();
    let methods = Method::all(&linear);
    let survey = precision::survey(&linear, &methods, Effort::Quick, &|_| ()).unwrap();
    for (method, why) in &survey.failures {
        println!("{method}: {why}");
    }
    let mut checked = 0;
    for method in methods {
        let errors: Vec<f64> = survey
            .entries
            .iter()
            .filter(|it| it.method == method)
            .map(precision::Entry::main_error)
            .collect();
        let shown: Vec<String> = errors.iter().map(|e| format!("{e:.1e}")).collect();
        println!("{method}: {}", shown.join(" "));
        if errors.len() < 2 {
            let failed = survey.failures.iter().any(|it| it.0 == method);
            // A busy machine may leave time for one level.
            assert!(
                failed || !errors.is_empty(),
                "{method} is neither there nor explained"
            );
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
    let files = precision::files(&[survey], &[]).unwrap();
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

#[test]
fn the_commands_write_their_tables_and_replace_them() {
    let folder = std::env::temp_dir().join(format!("vibroimpact-surveys-{}", std::process::id()));
    let out = folder.join("stability");
    let run = |force: bool| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_vibroimpact"));
        command
            .args([
                "stability",
                "--only",
                "time-zero,loss-1e-300-records",
                "--out",
            ])
            .arg(&out);
        if force {
            command.arg("--force");
        }
        command.output().unwrap()
    };
    let first = run(false);
    assert!(
        first.status.success(),
        "{}",
        String::from_utf8_lossy(&first.stderr)
    );
    let table = String::from_utf8(first.stdout).unwrap();
    assert!(
        table.contains("time-zero") && table.contains("within"),
        "{table}"
    );
    assert_eq!(
        run(false).status.code(),
        Some(2),
        "an existing folder is refused"
    );
    assert!(run(true).status.success());
    let csv = std::fs::read_to_string(out.join("stability.csv")).unwrap();
    assert_eq!(csv.lines().count(), 4, "{csv}");
    assert!(out.join("time-zero.toml").is_file());
    std::fs::remove_dir_all(folder).unwrap();
}
