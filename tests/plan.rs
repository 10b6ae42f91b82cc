//! The plans of the built-in scenes, as data: what is computed, how, on how many cells and in how many steps.

use vibroimpact::contact::ContactLaw;
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::{Oscillator, Quantity};
use vibroimpact::plan::{Part, Plan, Stage};
use vibroimpact::report::terminal;
use vibroimpact::scene::text::{BUILT_IN, SceneText};
use vibroimpact::scene::{MonteCarlo, Outputs, Scene, SpectrumRequest, Times};

fn scene() -> Scene {
    Scene::new(Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap())
}

/// A built-in scene with some of its keys changed.
fn built_in(name: &str, set: &[String]) -> Scene {
    let (_, text) = BUILT_IN.iter().find(|it| it.0 == name).unwrap();
    SceneText::parse(name, text, set).unwrap().scene().clone()
}

/// Its plan.
fn planned(name: &str, set: &[String]) -> Plan {
    Plan::of(&built_in(name, set)).unwrap()
}

fn stage(plan: &Plan, part: Part) -> &Stage {
    plan.stages().iter().find(|it| it.part == part).unwrap()
}

#[test]
fn a_stationary_scene_builds_no_mesh_and_draws_no_path() {
    let plan = Plan::of(&scene()).unwrap();
    assert_eq!(plan.stages().len(), 1);
    assert!(plan.has(Part::Stationary) && plan.stages()[0].cost.cells.is_none());
    let results = plan.run_quietly().unwrap();
    assert!(results.transient.is_none() && results.monte_carlo.is_none());
    assert!(results.run.wall_seconds < 1.0);
}

#[test]
fn every_stage_is_there_only_for_an_output_that_asks() {
    let mut scene = scene();
    scene.initial = Initial::gaussian([0.0; 2], [0.3; 2]).unwrap();
    scene.outputs = Outputs {
        moments_at: Times::List(vec![1.0]),
        ..Outputs::nothing()
    };
    let plan = Plan::of(&scene).unwrap();
    assert_eq!(plan.stages().len(), 1);
    assert_eq!(plan.stages()[0].needed_by, ["outputs.moments_at"]);
    scene.outputs.density_at = Times::List(vec![2.0]);
    scene.monte_carlo = Some(MonteCarlo::default());
    let plan = Plan::of(&scene).unwrap();
    assert_eq!(
        plan.stages()[0].needed_by,
        ["outputs.moments_at", "outputs.density_at"]
    );
    assert!(plan.has(Part::MonteCarlo) && !plan.has(Part::Stationary));
}

#[test]
fn every_built_in_transient_has_its_recipe() {
    const MAP: &str = "flow map, order 8";
    // What its reason says of a local grid.
    const ON_A_MESH: &str = "";
    const AT_FIRST: &str = "so a small mesh moves with it at first";
    const FOR_GOOD: &str = "a small mesh moves with the density for good";
    let recipes = [
        ("default", MAP, AT_FIRST, [141, 88], 981),
        ("paper-level 3e-6 0.01", MAP, ON_A_MESH, [97, 98], 80),
        ("paper-level 8e-5 0.05", MAP, ON_A_MESH, [101, 100], 80),
        ("paper-level 5e-4 0.15", MAP, ON_A_MESH, [98, 88], 80),
        ("paper-level 1.2e-3 0.25", MAP, ON_A_MESH, [116, 82], 80),
        ("paper-level 2e-3 0.3", MAP, ON_A_MESH, [145, 88], 80),
        ("paper-level 3.2e-3 0.4", MAP, ON_A_MESH, [163, 84], 80),
        ("bilinear", MAP, ON_A_MESH, [151, 88], 80),
        ("displaced", MAP, ON_A_MESH, [118, 70], 160),
        ("dropped", MAP, AT_FIRST, [142, 88], 66),
        ("overdamped", MAP, ON_A_MESH, [133, 84], 120),
        ("free-fall", MAP, FOR_GOOD, [28, 28], 3),
    ];
    let mut others = Vec::new();
    for (name, method, grid, cells, steps) in recipes {
        let words: Vec<&str> = name.split(' ').collect();
        let set = match words[1..] {
            [h, s] => vec![
                format!("oscillator.h={h}"),
                format!("initial.deviation=[{s}, {s}]"),
            ],
            _ => vec![],
        };
        let plan = planned(words[0], &set);
        let found = stage(&plan, Part::Transient);
        println!("{name}: {found:?}");
        let (head, reason) = found.method.split_once("; ").unwrap();
        let moves = reason.contains("small mesh");
        let as_expected = head == method
            && reason.ends_with(grid)
            && moves != grid.is_empty()
            && (found.cost.cells, found.cost.steps) == (Some(cells), steps);
        if !as_expected {
            others.push(name);
        }
    }
    assert!(others.is_empty(), "{others:?}");
}

/// Paths or records, scheme and step as the plan says them, steps of each.
type Sample = (Part, &'static str, u64);

#[test]
fn every_built_in_sample_has_its_recipe() {
    const PATHS: Part = Part::MonteCarlo;
    let recipes: [(&str, &[Sample]); 11] = [
        (
            "default",
            &[(PATHS, "100000 paths, splitting_4_2, step 0.5 ", 1000)],
        ),
        (
            "bilinear",
            &[(PATHS, "20000 paths, splitting_4_2, step 1.0 ", 40)],
        ),
        (
            "displaced",
            &[(PATHS, "50000 paths, splitting_4_2, step 0.25 ", 160)],
        ),
        (
            "dropped",
            &[(PATHS, "100000 paths, splitting_4_2, step 0.7143 ", 82)],
        ),
        (
            "overdamped",
            &[(PATHS, "20000 paths, exponential_heun, step 0.03333 ", 120)],
        ),
        (
            "free-fall",
            &[(PATHS, "20000 paths, splitting_4_2, step 0.25 ", 8)],
        ),
        (
            "extreme",
            &[(PATHS, "20000 paths, splitting_4_2, step 0.5 ", 40)],
        ),
        (
            "first-loss",
            &[
                (
                    Part::FirstLossPaths,
                    "100000 paths, splitting_4_2, step 0.8197 ",
                    244,
                ),
                (
                    Part::Records,
                    "240 records, splitting_4_2, step 0.8217 ",
                    5072,
                ),
            ],
        ),
        (
            "records",
            &[(
                Part::Records,
                "144 records, splitting_4_2, step 0.7942 ",
                5496,
            )],
        ),
        (
            "spectrum",
            &[
                (
                    Part::Series,
                    "Welch: 272 records of 5 segments of 2048 samples, splitting_4_2, step 0.3927 ",
                    6144,
                ),
                (
                    Part::Records,
                    "144 records, splitting_4_2, step 0.7942 ",
                    5496,
                ),
            ],
        ),
        (
            "table-3",
            &[(
                Part::Records,
                "144 records, splitting_4_2, step 0.8031 ",
                5434,
            )],
        ),
    ];
    for (name, expected) in recipes {
        let plan = planned(name, &[]);
        for (part, words, steps) in expected {
            let found = stage(&plan, *part);
            println!("{name}: {found:?}");
            assert!(found.method.starts_with(words), "{name}: {}", found.method);
            assert_eq!(found.cost.steps, *steps, "{name}");
            // No companion, for the bias of a step.
            assert!(!found.method.contains("as many by"), "{name}");
        }
        let sampled = [
            Part::MonteCarlo,
            Part::Series,
            Part::FirstLossPaths,
            Part::FirstPassagePaths,
            Part::Records,
        ];
        let sampled = sampled.into_iter().filter(|part| plan.has(*part));
        assert_eq!(sampled.count(), expected.len(), "{name}");
    }
}

#[test]
fn every_question_of_the_default_scene_has_its_recipe() {
    let mut scene = built_in("default", &[]);
    scene.outputs.steady = true;
    scene.outputs.spectrum = Some(SpectrumRequest {
        until: 4.0,
        quantity: Quantity::Force,
    });
    scene.outputs.first_loss = Some(200.0);
    let plan = Plan::of(&scene).unwrap();
    let found: Vec<_> = plan
        .stages()
        .iter()
        .filter_map(|it| Some((it.part.name(), it.cost.cells?, it.cost.steps)))
        .collect();
    println!("{found:?}");
    let expected = [
        ("first_loss", [67, 96], 640),
        ("transient", [141, 88], 981),
        ("steady", [115, 68], 60),
        ("decay_rates", [49, 40], 15),
        ("spectrum", [113, 108], 14),
    ];
    assert_eq!(found, expected);
    let rates = &stage(&plan, Part::DecayRates).method;
    assert!(rates.contains("9 shifts up to 2.00i"), "{rates}");
    assert!(rates.contains("a real rate must be among them"), "{rates}");
}

#[test]
fn a_stage_without_an_answer_is_a_shortfall_and_the_others_are_run() {
    let mut scene = scene();
    scene.outputs.first_loss = Some(20.0);
    scene.accuracy.max_memory = 1_000_000;
    let plan = Plan::of(&scene).unwrap();
    let printed = terminal::plan(&plan);
    assert!(
        printed.contains("not run: accuracy.max_memory = 1.0 MB"),
        "{printed}"
    );
    let results = plan.run_quietly().unwrap();
    assert!(results.stationary.is_some() && results.first_loss.is_none() && results.falls_short());
    let (stage, shortfall) = &results.shortfalls[0];
    let said = shortfall.to_string();
    assert!(
        *stage == "first_loss" && said.starts_with("no answer: accuracy.max_memory"),
        "{said}"
    );
    // Alone it is an error.
    scene.outputs.stationary = false;
    assert!(
        Plan::of(&scene)
            .unwrap_err()
            .to_string()
            .contains("first_loss stage")
    );
}

#[test]
fn a_stage_that_is_refused_before_its_mesh_is_known_leaves_the_others() {
    let mut scene = scene();
    scene.outputs.steady = true;
    scene.outputs.first_loss = Some(20.0);
    scene.accuracy.max_memory = 100_000;
    scene.monte_carlo = Some(MonteCarlo::default());
    let plan = Plan::of(&scene).unwrap();
    println!("{}", terminal::plan(&plan));
    for part in [Part::Steady, Part::FirstLoss] {
        let refused = stage(&plan, part);
        assert!(refused.refusal.is_some() && refused.seconds() == 0.0);
    }
    let results = plan.run_quietly().unwrap();
    assert!(results.stationary.is_some() && results.steady.is_none());
    let named: Vec<&str> = results.shortfalls.iter().map(|it| it.0).collect();
    assert!(
        named.contains(&"steady") && named.contains(&"first_loss"),
        "{named:?}"
    );
}

#[test]
fn an_initial_condition_that_no_mesh_holds_leaves_what_does_not_begin_there() {
    let mut scene = scene();
    scene.outputs.moments_at = Times::List(vec![1.0]);
    scene.initial = Initial::Gaussian {
        mean: [1000.0, 0.0],
        deviation: [1.0, 1.0],
    };
    let plan = Plan::of(&scene).unwrap();
    assert!(terminal::plan(&plan).contains("initial.mean nearer"));
    let results = plan.run_quietly().unwrap();
    assert!(results.stationary.is_some() && results.transient.is_none());
    let [(stage, shortfall)] = &results.shortfalls[..] else {
        panic!("{:?}", results.shortfalls);
    };
    assert!(*stage == "transient" && shortfall.free, "{shortfall}");
    assert!(
        shortfall.to_string().contains("cells along q"),
        "{shortfall}"
    );
    // Alone, or on cells of its own, the scene is refused.
    scene.method.cells = Some([100, 100]);
    let on_cells = Plan::of(&scene).unwrap_err();
    scene.method.cells = None;
    scene.outputs.stationary = false;
    for message in [on_cells, Plan::of(&scene).unwrap_err()] {
        assert!(message.is_refusal() && message.to_string().contains("initial.deviation"));
    }
}

#[test]
fn a_mesh_beyond_the_memory_is_refused_before_anything_is_built() {
    let mut scene = scene();
    scene.outputs.steady = true;
    scene.method.cells = Some([1_000_000_000, 1_000_000_000]);
    let message = Plan::of(&scene).unwrap_err().to_string();
    assert!(
        message.contains("method.cells") && message.contains("max_memory"),
        "{message}"
    );
    scene.method.cells = None;
    scene.accuracy.max_memory = 1000;
    let message = Plan::of(&scene).unwrap_err().to_string();
    assert!(
        message.contains("accuracy.max_memory = 1.0 kB"),
        "{message}"
    );
}

#[test]
fn the_plan_of_every_built_in_scene_fits_80_columns_and_says_what_it_leaves_out() {
    for (name, _) in BUILT_IN {
        let text = terminal::plan(&planned(name, &[]));
        assert!(
            text.lines().all(|line| line.chars().count() <= 80),
            "{text}"
        );
        assert!(text.contains("not asked for, not computed:"), "{text}");
        let flat = text.split_whitespace().collect::<Vec<_>>().join(" ");
        let most = flat.ends_with(
            "not computed: crossings, first loss, paths of the first loss, first passage, paths of the first \
             passage, time to a fraction, periodic law, response curve, spectrum, Welch's spectrum, long realisations",
        );
        assert_eq!(most, *name == "default", "{text}");
    }
}
