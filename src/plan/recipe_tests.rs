//! The plans of the built-in scenes, as data.

use super::*;
use crate::contact::ContactLaw;
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use crate::scene::text::{SceneText, built_in};
use crate::scene::{MonteCarlo, Outputs, Times};

fn scene() -> Scene {
    Scene::new(Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap())
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
    use crate::fokker_planck::transient::FirstGrid::{self, Mesh, Moving, MovingForGood};
    const MAP: &str = "flow map, order 8";
    let recipes: [(&str, &str, FirstGrid, [usize; 2], u64); 12] = [
        ("default", MAP, Moving, [200, 122], 981),
        ("paper-level 3e-6 0.01", MAP, Mesh, [102, 102], 80),
        ("paper-level 8e-5 0.05", MAP, Mesh, [106, 106], 80),
        ("paper-level 5e-4 0.15", MAP, Mesh, [102, 90], 80),
        ("paper-level 1.2e-3 0.25", MAP, Mesh, [120, 84], 80),
        ("paper-level 2e-3 0.3", MAP, Mesh, [154, 90], 80),
        ("paper-level 3.2e-3 0.4", MAP, Mesh, [172, 88], 80),
        ("bilinear", MAP, Mesh, [162, 92], 80),
        ("displaced", MAP, Mesh, [118, 70], 160),
        ("dropped", MAP, Moving, [202, 122], 66),
        (
            "overdamped",
            "finite volumes, order 8, imex",
            Mesh,
            [124, 84],
            100,
        ),
        ("free-fall", MAP, MovingForGood, [28, 28], 3),
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
        let text = SceneText::parse(name, built_in(words[0]).unwrap(), &set).unwrap();
        let recipe = Plan::of(text.scene()).unwrap().recipes.transient.unwrap();
        let found = (
            recipe.name(),
            recipe.first_grid,
            recipe.cost.cells,
            recipe.cost.steps,
        );
        println!("{name}: {found:?}; {}", recipe.reason);
        if found != (method.to_string(), grid, cells, steps) {
            others.push(name);
        }
    }
    assert!(others.is_empty(), "{others:?}");
}

#[test]
#[expect(clippy::approx_constant)] // pi/8, printed to four digits
fn every_built_in_sample_has_its_recipe() {
    use crate::monte_carlo::Scheme::{self, ExponentialHeun, Splitting42};
    // Scheme, step, paths or records, steps of each.
    type Found = (Part, Scheme, f64, u64, u64);
    let recipes: [(&str, &[Found]); 11] = [
        (
            "default",
            &[(Part::MonteCarlo, Splitting42, 0.5, 100_000, 1000)],
        ),
        (
            "bilinear",
            &[(Part::MonteCarlo, Splitting42, 1.0, 20_000, 40)],
        ),
        (
            "displaced",
            &[(Part::MonteCarlo, Splitting42, 0.25, 50_000, 160)],
        ),
        (
            "dropped",
            &[(Part::MonteCarlo, Splitting42, 0.7143, 100_000, 82)],
        ),
        (
            "overdamped",
            &[(Part::MonteCarlo, ExponentialHeun, 0.03333, 20_000, 120)],
        ),
        (
            "free-fall",
            &[(Part::MonteCarlo, Splitting42, 0.25, 20_000, 8)],
        ),
        (
            "extreme",
            &[(Part::MonteCarlo, Splitting42, 0.5, 20_000, 40)],
        ),
        (
            "first-loss",
            &[
                (Part::FirstLossPaths, Splitting42, 0.8197, 100_000, 244),
                (Part::Records, Splitting42, 0.8217, 240, 5072),
            ],
        ),
        (
            "records",
            &[(Part::Records, Splitting42, 0.7942, 144, 5496)],
        ),
        (
            "spectrum",
            &[
                (Part::Series, Splitting42, 0.3927, 272, 6144),
                (Part::Records, Splitting42, 0.7942, 144, 5496),
            ],
        ),
        (
            "table-3",
            &[(Part::Records, Splitting42, 0.8031, 144, 5434)],
        ),
    ];
    for (name, expected) in recipes {
        let text = SceneText::parse(name, built_in(name).unwrap(), &[]).unwrap();
        let plan = Plan::of(text.scene()).unwrap();
        let mut found = Vec::new();
        let mut put = |part, (scheme, step): (Scheme, f64), count, steps| {
            let step: f64 = format!("{step:.3e}").parse().unwrap();
            found.push((part, scheme, step, count, steps));
        };
        if let Some(it) = &plan.recipes.ensemble {
            assert!(it.companion.is_none());
            put(
                Part::MonteCarlo,
                (it.walk.scheme, it.walk.step),
                it.paths,
                it.cost.steps,
            );
        }
        if let Some(it) = &plan.recipes.series {
            put(
                Part::Series,
                (it.walk.scheme, it.walk.step),
                it.asked.records,
                it.cost.steps,
            );
        }
        if let Some(it) = &plan.recipes.first_losses {
            put(
                Part::FirstLossPaths,
                (it.walk.scheme, it.walk.step),
                it.paths,
                it.cost.steps,
            );
        }
        if let Some(it) = &plan.recipes.records {
            put(
                Part::Records,
                (it.walk.scheme, it.walk.step),
                it.records(),
                it.cost.steps,
            );
        }
        println!("{name}: {found:?}");
        assert_eq!(found, expected, "{name}");
    }
}

#[test]
fn every_question_of_the_default_scene_has_its_recipe() {
    let text = SceneText::parse("default", built_in("default").unwrap(), &[]).unwrap();
    let mut scene = text.scene().clone();
    scene.outputs.steady = true;
    scene.outputs.spectrum = Some(crate::scene::SpectrumRequest {
        until: 4.0,
        quantity: crate::scene::Quantity::Force,
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
        ("first_loss", [67, 96], 832),
        ("transient", [200, 122], 981),
        ("steady", [115, 68], 60),
        ("decay_rates", [89, 96], 15),
        ("spectrum", [153, 152], 21),
    ];
    assert_eq!(found, expected);
    let rates = plan.recipes.eigenvalues.unwrap();
    println!("{rates:?}");
    assert!(
        rates.words().contains("9 shifts up to 2.00i"),
        "{}",
        rates.words()
    );
    assert!(rates.words().contains("a real rate must be among them"));
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
