//! A run ends within 1.3 times accuracy.max_seconds and a second, whatever it is doing, with numbers or a reason.

use std::process::Command;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use vibroimpact::Error;
use vibroimpact::plan::{Plan, StopFlag, Watch};
use vibroimpact::scene::text::SceneText;

const HERTZ: &str = "[oscillator]\ncontact = \"hertz\"\n";

/// Name, oscillator and initial condition, then what is asked: every question, where it takes long.
const SCENES: [(&str, &str, &str); 17] = [
    (
        "flow map, a tolerance out of reach",
        "zeta = 0.005\nh = 2e-3\n[initial]\nmean = [1.0, 0.0]\ndeviation = [0.4, 0.4]\n",
        "[outputs]\nmoments_at = { every = 0.5, until = 50 }\n[accuracy]\ntolerance = 1e-9\n",
    ),
    (
        "flow map from rest, a long one",
        "zeta = 1e-4\nh = 2e-3\n[initial]\nkind = \"rest\"\n",
        "[outputs]\nmoments_at = [1e4]\n[accuracy]\ntolerance = 1e-6\n",
    ),
    (
        "flow map on many cells",
        "zeta = 0.005\nh = 2e-3\n[initial]\nmean = [1.0, 0.0]\ndeviation = [0.4, 0.4]\n",
        "[outputs]\nmoments_at = [100]\n[method]\ncells = [1000, 800]\n[accuracy]\n",
    ),
    (
        "finite volumes, implicit",
        "zeta = 20\nh = 0.5\n[initial]\nmean = [0.5, 0.0]\ndeviation = [0.1, 0.1]\n",
        "[outputs]\nmoments_at = [100]\n[method]\ntime = \"implicit\"\n[accuracy]\ntolerance = 1e-7\n",
    ),
    (
        "finite volumes, explicit on many cells",
        "zeta = 0.5\nh = 0.1\n[initial]\nmean = [0.5, 0.0]\ndeviation = [0.4, 0.4]\n",
        "[outputs]\nmoments_at = [100]\n[method]\ntransient = \"finite_volume\"\ntime = \"explicit\"\ncells = [900, 700]\n[accuracy]\n",
    ),
    (
        "a start far beyond a law of strong friction",
        "zeta = 9.448\nh = 0.1049\n[initial]\nmean = [0.3733, -0.3301]\ndeviation = [0.1844, 0.3309]\n",
        "[outputs]\nmoments_at = [0.0186, 0.0339, 49.5]\n[accuracy]\ntolerance = 1e-6\n",
    ),
    (
        "the same at a low level",
        "zeta = 7.442\nh = 6.759e-4\n[initial]\nmean = [0.02683, 0.03462]\ndeviation = [0.02365, 0.03229]\n",
        "[outputs]\nmoments_at = [0.0102, 0.805, 1.49]\n[accuracy]\ntolerance = 1e-6\n",
    ),
    (
        "upwind drift",
        "zeta = 0.005\nh = 2e-3\n[initial]\nmean = [1.0, 0.0]\ndeviation = [0.4, 0.4]\n",
        "[outputs]\nmoments_at = [100]\n[method]\ndrift = \"upwind\"\ncells = [900, 700]\n[accuracy]\n",
    ),
    (
        "steady state, upwind",
        "zeta = 0.005\nh = 2e-3\n",
        "[outputs]\nsteady = true\n[method]\ncells = [450, 340]\n[accuracy]\n",
    ),
    (
        "steady state, order 8",
        "zeta = 0.005\nh = 2e-3\n",
        "[outputs]\nsteady = true\n[method]\ndrift = 8\ncells = [150, 112]\n[accuracy]\n",
    ),
    (
        "decay rates, a tolerance out of reach",
        "zeta = 0.005\nh = 2e-3\n",
        "[outputs]\ndecay_rates = 12\n[accuracy]\ntolerance = 1e-10\n",
    ),
    (
        "decay rates at a fine resolution",
        "zeta = 0.005\nh = 2e-3\n",
        "[outputs]\ndecay_rates = 4\n[method]\ncells = [400, 400]\n[accuracy]\n",
    ),
    (
        "spectrum, a tolerance out of reach",
        "zeta = 0.005\nh = 2e-3\n",
        "[outputs]\nspectrum = { until = 4.0 }\n[accuracy]\ntolerance = 1e-9\n",
    ),
    (
        "spectrum at a fine resolution",
        "zeta = 0.005\nh = 2e-3\n",
        "[outputs]\nspectrum = { until = 4.0 }\n[method]\ncells = [400, 250]\n[accuracy]\n",
    ),
    (
        "first passage, a tolerance out of reach",
        "zeta = 0.005\nh = 3.2e-3\n[initial]\nkind = \"rest\"\n",
        "[outputs]\nfirst_loss = { until = 200 }\n[accuracy]\ntolerance = 1e-9\n",
    ),
    (
        "long realisations of ten thousand cosines",
        "zeta = 0.005\nh = 2e-3\n",
        "[monte_carlo]\nduration = 1e8\nnoise = { cosines = 10000, band = 8.0 }\n[accuracy]\n",
    ),
    (
        "first passage where contact is not lost at all",
        "zeta = 4.16e-4\nh = 7.22e-8\n[initial]\nmean = [0.0427, -0.0494]\ndeviation = [0.0088, 2.8e-4]\n",
        "[outputs]\nfirst_loss = { until = 2.37 }\n[accuracy]\n",
    ),
];

/// What is timed is alone on the machine, as far as these tests go.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

#[test]
fn a_run_of_any_question_ends_within_its_seconds() {
    let _alone = alone();
    let folder = std::env::temp_dir().join(format!("vibroimpact-limits-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mut late = Vec::new();
    // Each at half a second, some at two too.
    for (limit, every) in [(0.5, 1), (2.0, 5)] {
        for (name, oscillator, asked) in SCENES.into_iter().step_by(every) {
            let text = format!("{HERTZ}{oscillator}{asked}max_seconds = {limit:.1}\n");
            let scene = folder.join("scene.toml");
            std::fs::write(&scene, text).unwrap();
            let once = || {
                let mut command = Command::new(env!("CARGO_BIN_EXE_vibroimpact"));
                command.arg("run").arg(&scene).args(["--force", "--out"]);
                let clock = Instant::now();
                let it = command.arg(folder.join("out")).output().unwrap();
                (it, clock.elapsed().as_secs_f64())
            };
            let (mut it, mut seconds) = once();
            // A busy machine may be late once.
            if seconds > 1.3 * limit + 1.0 {
                (it, seconds) = once();
            }
            let error = String::from_utf8_lossy(&it.stderr);
            println!(
                "{limit} s: {seconds:5.2} s, status {:?}: {name}; {}",
                it.status.code().unwrap(),
                error.trim().replace('\n', " ")
            );
            // Numbers within the tolerance, numbers that say by how much not, or the limit by its key.
            assert!(matches!(it.status.code(), Some(0 | 3)), "{name}: {error}");
            assert!(!error.contains("method.cells ="), "{name}: {error}");
            if seconds > 1.3 * limit + 1.0 {
                late.push(format!("{name}: {seconds:.2} s of {limit}"));
            }
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(late.is_empty(), "{late:#?}");
}

#[test]
fn a_scene_that_does_not_fit_leaves_marked_results_in_place_of_older_ones() {
    let folder = std::env::temp_dir().join(format!("vibroimpact-fits-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let run = |name: &str, asked: &str| {
        let scene = folder.join(name);
        std::fs::write(&scene, format!("{HERTZ}zeta = 0.005\nh = 2e-3\n{asked}")).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_vibroimpact"));
        command
            .arg("run")
            .arg(&scene)
            .args(["--quiet", "--force", "--out"]);
        let it = command.arg(folder.join("out")).output().unwrap();
        let results = std::fs::read_to_string(folder.join("out/results.json"));
        (it.status.code(), results.unwrap())
    };
    let (status, first) = run("first.toml", "[outputs]\nstationary = true\n");
    assert!(status == Some(0) && first.contains("\"first\"") && first.contains("kurtosis_force"));
    let asked = "[outputs]\nspectrum = { until = 8.0 }\n[accuracy]\nmax_memory = \"3 MB\"\n";
    let (status, second) = run("second.toml", asked);
    assert_eq!(status, Some(3));
    assert!(
        second.contains("\"second\"") && !second.contains("kurtosis_force"),
        "{second}"
    );
    assert!(
        second.contains("accuracy.max_memory = 3.0 MB does not suffice"),
        "{second}"
    );
    // A scene that is refused leaves what there is as it is.
    let (status, third) = run("third.toml", "[outputs]\nspectrum = { until = -8.0 }\n");
    assert!(status == Some(2) && third == second);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn where_both_methods_of_a_transient_end_at_a_limit_that_of_the_better_one_is_named() {
    // No flow map that holds so sharp an initial condition fits, and finite volumes would take twenty seconds.
    let scene = format!(
        "{HERTZ}zeta = 0.005\nh = 2e-3\n[initial]\nmean = [-3.0, 0.0]\ndeviation = [1e-3, 1e-3]\n[outputs]\n\
         moments_at = [0.5, 1, 2, 3, 4, 5, 10, 12, 13, 17, 18, 19, 20, 50]\n[accuracy]\nmax_memory = \"60 MB\"\nmax_seconds = 5\n"
    );
    let scene = SceneText::parse("a.toml", &scene, &[]).unwrap();
    let error = Plan::of(scene.scene())
        .and_then(|plan| plan.run_quietly())
        .map(|it| it.run.warnings);
    let said = format!("{error:?}");
    assert!(said.contains("accuracy.max_memory"), "{said}");
}

#[test]
fn a_start_far_beyond_a_law_of_strong_friction_ends_with_its_numbers() {
    let _alone = alone();
    let folder = std::env::temp_dir().join(format!("vibroimpact-falling-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    for (name, oscillator, asked) in &SCENES[5..7] {
        let scene = folder.join("scene.toml");
        let asked = asked.replace("1e-6", "1e-2");
        std::fs::write(&scene, format!("{HERTZ}{oscillator}{asked}")).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_vibroimpact"));
        command.arg("run").arg(&scene).args(["--force", "--out"]);
        let clock = Instant::now();
        let it = command.arg(folder.join("out")).output().unwrap();
        let error = String::from_utf8_lossy(&it.stderr);
        let table = String::from_utf8_lossy(&it.stdout);
        println!(
            "{name}: {:.2} s\n{table}\n{error}",
            clock.elapsed().as_secs_f64()
        );
        assert_eq!(it.status.code(), Some(0), "{name}: {error}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A run that holds the flag which ends it.
struct Stoppable(StopFlag);

impl Watch for Stoppable {
    fn stop(&self) -> StopFlag {
        self.0.clone()
    }
}

#[test]
fn a_raised_flag_ends_a_run_of_minutes_at_once() {
    let _alone = alone();
    let paths = (
        "paths",
        "zeta = 0.005\nh = 2e-3\n",
        "[outputs]\nmoments_at = [1]\n[monte_carlo]\npaths = 10_000_000_000\n[accuracy]\n",
    );
    let long = SCENES.iter().filter(|it| it.0.starts_with("flow map"));
    for (name, oscillator, asked) in long.chain([&paths]) {
        let text = format!("{HERTZ}{oscillator}{asked}max_seconds = 600.0\n");
        let scene = SceneText::parse(name, &text, &[]).unwrap();
        let plan = Plan::of(scene.scene()).unwrap();
        let watch = Stoppable(StopFlag::default());
        let ended = std::thread::scope(|scope| {
            let run = scope.spawn(|| plan.run(&watch));
            std::thread::sleep(Duration::from_millis(300));
            // Where the first answer is refused by what it would take, there is nothing to stop.
            let running = !run.is_finished();
            watch.0.raise();
            let clock = Instant::now();
            let ended = run.join().unwrap();
            running.then(|| (ended.unwrap_err(), clock.elapsed().as_secs_f64()))
        });
        let Some((error, seconds)) = ended else {
            continue;
        };
        println!("{name}: {seconds:.3} s; {error}");
        assert!(matches!(error, Error::Stopped { .. }), "{name}: {error}");
        // A second on a machine of its own; every run would take many times this.
        assert!(seconds < 20.0, "{name}: {seconds} s");
    }
    // What is raised beforehand computes nothing.
    let scene = SceneText::parse("a", &format!("{HERTZ}zeta = 0.005\nh = 2e-3\n"), &[]).unwrap();
    let watch = Stoppable(StopFlag::default());
    watch.0.raise();
    let error = Plan::of(scene.scene()).unwrap().run(&watch).unwrap_err();
    assert!(matches!(error, Error::Stopped { .. }), "{error}");
}
