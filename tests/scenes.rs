//! The program end to end: every command, every exit status, bad scenes with their messages, folders.

use ndarray::{Array0, Array1, Array2};
use ndarray_npy::NpzReader;
use proptest::prelude::*;
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use vibroimpact::plan::{Part, Plan, Watch};
use vibroimpact::report::folder::{Existing, Folder};
use vibroimpact::results::Results;
use vibroimpact::scene::text::{BUILT_IN, SceneText};
use vibroimpact::{Error, report};

/// An empty folder of this test's own.
fn room(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

fn program(room: &Path) -> Command {
    command(room, env!("CARGO_BIN_EXE_vibroimpact"))
}

fn command(room: &Path, program: &str) -> Command {
    let mut it = Command::new(program);
    it.current_dir(room)
        .env("LC_ALL", "C.UTF-8")
        .env("NO_COLOR", "1");
    it
}

fn call(room: &Path, arguments: &[&str]) -> Output {
    program(room).args(arguments).output().unwrap()
}

fn out(it: &Output) -> String {
    String::from_utf8(it.stdout.clone()).unwrap()
}

fn err(it: &Output) -> String {
    String::from_utf8(it.stderr.clone()).unwrap()
}

/// Checks the exit status, that nobody panicked, and returns both outputs.
fn expect(status: i32, room: &Path, arguments: &[&str]) -> (String, String) {
    check(status, &call(room, arguments), arguments)
}

/// The same of the laboratory.
fn expect_lab(status: i32, room: &Path, arguments: &[&str]) -> (String, String) {
    let mut it = command(room, env!("CARGO_BIN_EXE_lab"));
    check(status, &it.args(arguments).output().unwrap(), arguments)
}

fn check(status: i32, it: &Output, arguments: &[&str]) -> (String, String) {
    let (out, err) = (out(it), err(it));
    assert_eq!(
        it.status.code(),
        Some(status),
        "{arguments:?}\n{out}\n{err}"
    );
    assert!(
        !err.contains("panicked") && !err.contains("RUST_BACKTRACE"),
        "{err}"
    );
    (out, err)
}

fn results(folder: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join("results.json")).unwrap()).unwrap()
}

/// The results of a run that goes on, if there are any yet.
fn results_if(folder: &Path) -> Option<Value> {
    serde_json::from_str(&fs::read_to_string(folder.join("results.json")).ok()?).ok()
}

/// Every kind of output on a mesh and with paths that take no time.
const SMALL: &str = r#"
title = "small"
[oscillator]
zeta = 0.05
h = 0.02
[rig]
static_load = 110
frequency = 232
static_compression = 7e-6
[initial]
kind = "gaussian"
mean = [0.0, 0.0]
deviation = [0.8, 0.8]
[outputs]
stationary = true
moments_at = [0.5, 1, 2]
density_at = [1, 2]
steady = true
decay_rates = 1
[monte_carlo]
paths = 200
[method]
drift = "upwind"
cells = [64, 48]
"#;

fn small_room(name: &str) -> PathBuf {
    let room = room(name);
    fs::write(room.join("small.toml"), SMALL).unwrap();
    room
}

/// Runs a scene without a complaint; its table fits 80 columns and has the words.
fn table_with(room: &Path, scene: &str, words: &[&str]) {
    let (table, err) = expect(0, room, &["run", scene]);
    assert!(err.is_empty(), "{err}");
    let widest = table.lines().map(|line| line.chars().count()).max();
    assert!(widest <= Some(80), "{table}");
    for word in words {
        assert!(table.contains(word), "{word}: {table}");
    }
}

fn hold(folder: &Path, files: &[&str]) {
    for file in files {
        assert!(folder.join(file).is_file(), "{file}");
    }
}

#[test]
fn a_run_leaves_a_table_of_80_columns_and_whole_files() {
    let room = small_room("sections");
    table_with(
        &room,
        "small.toml",
        &[
            "STATIONARY MOTION",
            "closed form",
            "Monte Carlo",
            "agreement",
            "time:",
            "ON THE RIG",
        ],
    );
    let folder = room.join("results/small");
    hold(
        &folder,
        &[
            "results.json",
            "report.html",
            "scene.toml",
            "stationary.csv",
            "stationary_q.csv",
            "stationary_v.csv",
            "stationary_force.csv",
            "moments.csv",
            "monte_carlo.csv",
            "density_1.npz",
            "density_2.npz",
            "density_1.svg",
            "snapshots.svg",
            "steady.npz",
            "steady.svg",
            "moments.svg",
            "force.svg",
            "approach.svg",
            "decay_rates.csv",
        ],
    );
    for entry in fs::read_dir(&folder).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().into_string().unwrap();
        assert!(!name.starts_with('.'), "{name} is left over");
        if Path::new(&name).extension().is_some_and(|it| it == "svg") {
            assert!(entry.metadata().unwrap().len() < 300_000, "{name}");
        }
    }
    // What is in the folder runs again to the same scene.
    let scene = fs::read_to_string(folder.join("scene.toml")).unwrap();
    let again = SceneText::parse("scene.toml", &scene, &[]).unwrap();
    assert_eq!(
        again.scene(),
        SceneText::parse("small.toml", SMALL, &[]).unwrap().scene()
    );
    let html = fs::read_to_string(folder.join("report.html")).unwrap();
    let outside = html.replace("http://www.w3.org/2000/svg", "");
    assert!(!outside.contains("http") && html.matches("<svg").count() >= 4);
}

/// What results.json says of a density at every output time.
const OF_THE_DENSITY: [&str; 4] = [
    "mass",
    "lowest_density",
    "negative_mass",
    "relative_entropy",
];

#[test]
fn results_json_has_every_section_and_name_of_its_contract() {
    let room = small_room("json");
    expect(0, &room, &["run", "small.toml", "-q"]);
    let folder = room.join("results/small");
    let all = results(&folder);
    let number = |it: &Value| it["value"].is_f64() && it["error"].is_f64();
    for name in [
        "mean_q",
        "var_q",
        "mean_v",
        "var_v",
        "mean_force",
        "std_force",
        "skewness_force",
        "kurtosis_force",
        "contact_loss_probability",
        "log10_contact_loss_probability",
        "loss_rate",
        "mean_flight",
    ] {
        assert!(
            number(&all["stationary"][name]),
            "{name}: {}",
            all["stationary"]
        );
    }
    let moments = [
        "mean_q",
        "var_q",
        "mean_v",
        "var_v",
        "cov_qv",
        "mean_force",
        "std_force",
        "skewness_force",
        "kurtosis_force",
        "mean_energy",
        "contact_loss_probability",
    ];
    let transient = &all["transient"];
    let ensemble = &all["monte_carlo"]["transient"];
    for section in [transient, ensemble] {
        assert_eq!(section["t"], serde_json::json!([0.5, 1.0, 2.0]));
        for name in moments {
            for part in ["value", "error"] {
                assert_eq!(section[name][part].as_array().unwrap().len(), 3, "{name}");
            }
        }
        assert!(section["method"]["name"].is_string() && section["method"]["steps"].is_u64());
    }
    for name in OF_THE_DENSITY {
        assert_eq!(
            transient[name]["value"].as_array().unwrap().len(),
            3,
            "{name}"
        );
    }
    let table = fs::read_to_string(folder.join("moments.csv")).unwrap();
    assert!(table.contains(",negative_mass [1],error of negative_mass [1],"));
    // Paths have none of these, and say so at every time.
    for name in OF_THE_DENSITY {
        let none = serde_json::json!([null, null, null]);
        assert_eq!(ensemble[name]["value"], none, "{name}");
    }
    assert_eq!(transient["method"]["cells"].as_array().unwrap().len(), 2);
    assert!(number(&all["steady"]["l1_error"]) && all["steady"]["method"]["name"].is_string());
    // On so coarse a mesh no mode is found twice.
    assert!(all["decay_rates"].is_array());
    for name in ["worst", "t", "expected_worst"] {
        assert!(all["agreement"][name].is_f64(), "{name}");
    }
    assert!(moments.contains(&all["agreement"]["worst_of"].as_str().unwrap()));
    assert!(all["oscillator"]["temperature"].is_f64() && all["oscillator"]["noise"].is_f64());
    assert!(number(&all["rig"]["std_force_n"]), "{}", all["rig"]);
    let run = &all["run"];
    assert!(run["wall_seconds"].is_f64() && run["threads"].is_u64() && run["warnings"].is_array());
    assert_eq!(run["version"], env!("CARGO_PKG_VERSION"));
    let stages: Vec<&str> = run["stages"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it["name"].as_str().unwrap())
        .collect();
    assert_eq!(
        stages,
        [
            "stationary",
            "transient",
            "steady",
            "decay_rates",
            "monte_carlo"
        ]
    );
    assert_eq!(all["scene"]["monte_carlo"]["seed"], 1);
    assert!(!run["warnings"].to_string().contains("unfinished"));
}

#[test]
fn results_json_has_the_names_of_losses_spectra_and_records() {
    let room = room("names");
    fs::write(
        room.join("names.toml"),
        "title = \"names\"\n[oscillator]\nzeta = 0.1\nh = 0.03\n[initial]\nkind = \"rest\"\n\
         [outputs]\nstationary = true\nspectrum = { until = 3 }\nfirst_loss = { until = 10 }\n\
         crossings = { window = 10 }\n[accuracy]\ntolerance = 0.1\n\
         [monte_carlo]\npaths = 500\nduration = 5000\n",
    )
    .unwrap();
    expect(0, &room, &["run", "names.toml", "-q"]);
    let all = results(&room.join("results/names"));
    let number = |it: &Value| it["value"].is_f64() && it["error"].is_f64();
    let plain = |it: &Value| it.as_array().is_some_and(|it| it.iter().all(Value::is_f64));
    let curve = |it: &Value, n: usize| {
        ["value", "error"].map(|part| it[part].as_array().map_or(0, Vec::len)) == [n, n]
    };
    let length = |it: &Value| it.as_array().map_or(0, Vec::len);

    let spectrum = &all["spectrum"];
    let n = length(&spectrum["omega"]);
    assert!(n > 10 && spectrum["quantity"] == "force" && plain(&spectrum["omega"]));
    assert!(curve(&spectrum["fokker_planck"], n) && curve(&spectrum["monte_carlo"], n));
    assert!(plain(&spectrum["linear"]) && length(&spectrum["linear"]) == n);

    for first in [&all["first_loss"], &all["monte_carlo"]["first_loss"]] {
        let n = length(&first["t"]);
        assert!(n > 2 && plain(&first["t"]));
        assert!(
            curve(&first["survival"], n) && curve(&first["density"], n),
            "{first}"
        );
    }
    assert!(number(&all["first_loss"]["mean_time"]) && number(&all["first_loss"]["rate"]));
    // Some paths are still in contact: their mean time and rate do not exist.
    for name in ["mean_time", "rate"] {
        let it = &all["monte_carlo"]["first_loss"];
        assert!(
            it.get(name).is_some() && (it[name].is_null() || number(&it[name])),
            "{it}"
        );
    }

    for crossings in [&all["crossings"], &all["monte_carlo"]["crossings"]] {
        for name in ["loss_rate", "losses_in_window", "mean_flight"] {
            assert!(number(&crossings[name]), "{name}: {crossings}");
        }
        let n = length(&crossings["flight_time"]);
        assert!(
            n > 2 && plain(&crossings["flight_time"]) && curve(&crossings["flight_density"], n)
        );
    }
    for (name, _) in all["stationary"].as_object().unwrap() {
        assert!(number(&all["monte_carlo"]["stationary"][name]), "{name}");
    }
    assert!(all["agreement"]["worst"].is_f64() && all["agreement"]["worst_of"].is_string());
}

#[test]
fn what_is_not_asked_for_is_absent() {
    let room = room("absent");
    fs::write(
        room.join("a.toml"),
        "[oscillator]\nzeta = 0.005\nh = 2e-3\n",
    )
    .unwrap();
    expect(0, &room, &["run", "a.toml", "--quiet"]);
    let all = results(&room.join("results/a"));
    for name in [
        "transient",
        "steady",
        "decay_rates",
        "monte_carlo",
        "agreement",
        "rig",
        "spectrum",
    ] {
        assert!(all.get(name).is_none(), "{name}");
    }
    let loss = all["stationary"]["contact_loss_probability"]["value"]
        .as_f64()
        .unwrap();
    assert!((loss - 0.072_455_645_955).abs() < 1e-11, "{loss}");
    assert!(!room.join("results/a/moments.csv").exists());
}

#[test]
fn a_number_that_does_not_exist_is_null() {
    let room = room("null");
    fs::write(
        room.join("a.toml"),
        "[oscillator]\ncontact = \"linear\"\nzeta = 0.005\nh = 2e-3\n",
    )
    .unwrap();
    expect(0, &room, &["run", "a.toml", "-q"]);
    let text = fs::read_to_string(room.join("results/a/results.json")).unwrap();
    assert!(!text.contains("NaN") && !text.contains("inf"));
    let all = results(&room.join("results/a"));
    assert!(all["stationary"]["contact_loss_probability"].is_null());
    assert!(all["stationary"].get("loss_rate").is_some());
}

#[test]
fn the_plan_is_printed_and_nothing_is_computed() {
    let room = small_room("plan");
    let (text, _) = expect(0, &room, &["plan", "small.toml"]);
    for word in [
        "stationary",
        "transient",
        "64 x 48",
        "needed by",
        "moments_at",
        "allowed",
    ] {
        assert!(text.contains(word), "{word}: {text}");
    }
    let (text, _) = expect(0, &room, &["plan", "stationary"]);
    assert!(
        text.contains("no mesh") && text.contains("not asked for, not computed"),
        "{text}"
    );
    let (text, _) = expect(0, &room, &["plan"]);
    assert!(text.contains("default"), "{text}");
    assert!(!room.join("results").exists());
}

#[test]
fn the_built_in_scenes_are_listed_and_printed_verbatim() {
    let room = room("built-in");
    let (list, _) = expect(0, &room, &["scenes"]);
    for (name, text) in BUILT_IN {
        assert!(list.contains(name), "{name}");
        let (printed, _) = expect(0, &room, &["scenes", name]);
        assert_eq!(printed, *text, "{name}");
    }
    let (_, err) = expect(2, &room, &["scenes", "defalt"]);
    assert!(err.contains("did you mean default?"), "{err}");
    let (_, err) = expect(2, &room, &["stationnary", "--quiet"]);
    assert!(err.contains("did you mean stationary?"), "{err}");
    let (_, err) = expect(2, &room, &["pln"]);
    assert!(err.contains("similar subcommand"), "{err}");
    // A folder of results does not hide the scene.
    fs::create_dir(room.join("displaced")).unwrap();
    let (plan, _) = expect(0, &room, &["plan", "displaced"]);
    assert!(plan.starts_with("displaced:"), "{plan}");
}

#[test]
fn the_scene_of_the_manual_has_every_key_and_a_plan() {
    let manual = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/scenes.md");
    let manual = fs::read_to_string(manual).unwrap();
    let scene = manual.split("```toml\n").nth(1).unwrap();
    let scene = scene.split("```").next().unwrap();
    let text = SceneText::parse("docs/scenes.md", scene, &[]).unwrap();
    let plan = Plan::of(text.scene()).unwrap();
    for part in [
        Part::Transient,
        Part::FirstLoss,
        Part::Records,
        Part::Spectrum,
    ] {
        assert!(plan.has(part), "{part:?}");
    }
    for (_, keys) in SECTIONS {
        for key in *keys {
            let named = format!("| `{key}` |");
            assert!(manual.contains(&named), "docs/scenes.md has no row {key}");
        }
    }
}

#[test]
fn every_built_in_scene_runs_when_its_size_is_cut() {
    let room = room("all");
    for (name, text) in BUILT_IN {
        let mut arguments = vec!["run", name, "-q"];
        if text.contains("decay_rates") {
            arguments.extend(["--set", "outputs.decay_rates=0"]);
        }
        if text.contains("moments_at") {
            arguments.extend(["--set", "outputs.moments_at=[0.1,0.2]"]);
        }
        if text.contains("density_at") {
            arguments.extend(["--set", "outputs.density_at=[0.1]"]);
        }
        if text.contains("first_loss") {
            let set = ["outputs.first_loss.until=20", "method.step=1.0"];
            arguments.extend(set.iter().flat_map(|set| ["--set", set]));
        }
        if text.contains("spectrum") {
            arguments.extend(["--set", "outputs.spectrum={until=1.2}"]);
        }
        if text.contains("response") {
            arguments.extend(["--set", "outputs.response.points=3"]);
            arguments.extend(["--set", "accuracy.tolerance=0.05"]);
        }
        if text.contains("[monte_carlo]") {
            arguments.extend(["--set", "monte_carlo.paths=20"]);
        }
        expect(0, &room, &arguments);
        assert!(
            room.join("results")
                .join(name)
                .join("report.html")
                .is_file(),
            "{name}"
        );
    }
}

#[test]
fn commands_and_arguments_that_do_not_exist_are_refused_with_status_2() {
    let room = room("commands");
    for (arguments, word) in [
        (&["rnu"][..], "rnu"),
        (&["run", "--threads", "0"], "0"),
        (&["run", "--threads", "x"], "x"),
        (&["run", "--speed"], "--speed"),
        (&["run", "no-such.toml"], "cannot be read"),
        (&["run", "a.toml", "b.toml"], "b.toml"),
        (&["run", "."], "is a folder"),
        (&["run", "--set", "oscillator.h=-1"], "oscillator.h = -1"),
        (&["run", "--set", "oscillator.hh=1"], "did you mean h?"),
        (&["run", "--set", "h"], "KEY=VALUE"),
    ] {
        let (_, err) = expect(2, &room, arguments);
        assert!(err.contains(word), "{arguments:?}: {err}");
    }
    // What it computes on is said by arguments alone.
    let planned = |threads: &str| {
        let mut it = command(&room, env!("CARGO_BIN_EXE_vibroimpact"));
        let it = it.arg("plan").env("RAYON_NUM_THREADS", threads);
        check(0, &it.output().unwrap(), &["plan"]).0
    };
    assert_eq!(planned("1"), planned("7"));
    fs::write(room.join("latin.toml"), b"title = \"\xe9\"").unwrap();
    let (_, err) = expect(2, &room, &["run", "latin.toml"]);
    assert!(err.contains("not UTF-8: byte 9"), "{err}");
    for (arguments, word) in [
        (&["validate"][..], "a folder of folders with a paper.csv"),
        (
            &["validate", "table-4", "--out", "x"],
            "a folder with a paper.csv",
        ),
        (&["precision", "--speed"], "--speed"),
        (&["stability", "a.toml"], "a.toml"),
        (&["run"], "run"),
    ] {
        let (_, err) = expect_lab(2, &room, arguments);
        assert!(err.contains(word), "{arguments:?}: {err}");
    }
    assert!(!room.join("results").exists());
}

#[test]
fn the_commands_of_the_laboratory_are_named_where_they_were_in_one_line() {
    let room = room("moved");
    for name in ["validate", "precision", "stability"] {
        let (out, err) = expect(2, &room, &[name, "--out", "here"]);
        assert!(
            out.is_empty() && err.lines().count() == 1 && err.contains(&format!("lab -- {name}")),
            "{err}"
        );
    }
}

#[test]
fn the_laboratory_writes_its_tables_and_replaces_them_if_forced() {
    let room = room("surveys");
    let only = "time-zero,loss-1e-300-records";
    let arguments = ["stability", "--only", only, "--out", "here", "--force"];
    let (table, _) = expect_lab(0, &room, &arguments[..5]);
    assert!(
        table.contains("time-zero") && table.contains("within"),
        "{table}"
    );
    // A folder that exists is refused.
    expect_lab(2, &room, &arguments[..5]);
    expect_lab(0, &room, &arguments);
    let csv = fs::read_to_string(room.join("here/stability.csv")).unwrap();
    assert_eq!(csv.lines().count(), 4, "{csv}");
    assert!(room.join("here/time-zero.toml").is_file());
}

#[test]
fn help_and_version_are_there() {
    let room = room("help");
    let (text, _) = expect(0, &room, &["--help"]);
    assert!(text.contains("scenes") && text.contains("plan"), "{text}");
    let (text, _) = expect(0, &room, &["--version"]);
    assert!(text.contains(env!("CARGO_PKG_VERSION")), "{text}");
}

#[test]
fn an_output_folder_that_exists_is_refused_unless_forced_and_foreign_files_stay() {
    let room = small_room("out");
    expect(0, &room, &["run", "small.toml", "--out", "here", "-q"]);
    let (_, err) = expect(2, &room, &["run", "small.toml", "--out", "here"]);
    assert!(
        err.contains("--out = here") && err.contains("--force"),
        "{err}"
    );
    fs::write(room.join("here/notes.txt"), "mine").unwrap();
    fs::write(room.join("here/density_9.npz"), "old").unwrap();
    expect(
        0,
        &room,
        &["run", "small.toml", "--out", "here", "--force", "--quiet"],
    );
    assert_eq!(
        fs::read_to_string(room.join("here/notes.txt")).unwrap(),
        "mine"
    );
    assert!(
        !room.join("here/density_9.npz").exists(),
        "an earlier run's density is left"
    );
    fs::write(room.join("file"), "x").unwrap();
    let (_, err) = expect(2, &room, &["run", "small.toml", "--out", "file", "--force"]);
    assert!(err.contains("this is a file"), "{err}");
}

#[test]
fn a_folder_of_others_loses_nothing_and_no_scene_is_replaced_by_its_own_run() {
    let room = small_room("theirs");
    let theirs = ["response.csv", "flights.svg", "density_mine.npz"];
    fs::create_dir(room.join("theirs")).unwrap();
    for name in theirs {
        fs::write(room.join("theirs").join(name), "mine").unwrap();
    }
    expect(
        0,
        &room,
        &["run", "small.toml", "--out", "theirs", "--force", "-q"],
    );
    for name in theirs {
        let text = fs::read_to_string(room.join("theirs").join(name)).unwrap();
        assert_eq!(text, "mine", "{name}");
    }
    // A scene that a run would replace by another text is refused; as it was written it is run again.
    let scene = "results/small/scene.toml";
    expect(0, &room, &["run", "small.toml", "-q"]);
    expect(0, &room, &["run", scene, "-q"]);
    let (_, err) = expect(
        2,
        &room,
        &["run", scene, "-q", "--set", "oscillator.h=1e-3"],
    );
    assert!(err.contains("another folder"), "{err}");
    let text = format!("# mine\n{}", fs::read_to_string(room.join(scene)).unwrap());
    fs::write(room.join(scene), &text).unwrap();
    expect(2, &room, &["run", scene, "-q"]);
    assert_eq!(fs::read_to_string(room.join(scene)).unwrap(), text);
}

#[test]
fn keys_that_change_nothing_are_said() {
    let room = small_room("unused");
    fs::write(
        room.join("alone.toml"),
        "[oscillator]\nzeta = 0.05\nh = 0.02\n[method]\ncells = [100, 80]\ndrift = 4\n\
         [monte_carlo]\nduration = 1000\npaths = 500\n",
    )
    .unwrap();
    let (out, _) = expect(0, &room, &["run", "alone.toml"]);
    for key in ["method.cells", "method.drift", "monte_carlo.paths"] {
        let said = format!("{key}: nothing that is asked for uses it");
        assert!(out.contains(&said), "{said}: {out}");
    }
}

#[test]
fn the_default_folder_is_replaced_if_it_is_ours_and_refused_if_it_is_not() {
    let room = small_room("replace");
    for _ in 0..2 {
        expect(
            0,
            &room,
            &["run", "small.toml", "-q", "--set", "title=../a b/c"],
        );
    }
    assert!(room.join("results/a-b-c/results.json").is_file());
    fs::create_dir_all(room.join("results/small")).unwrap();
    fs::write(room.join("results/small/results.json"), "{}").unwrap();
    let (_, err) = expect(2, &room, &["run", "small.toml"]);
    assert!(err.contains("a results.json of ours"), "{err}");
    assert_eq!(
        fs::read_to_string(room.join("results/small/results.json")).unwrap(),
        "{}"
    );
    expect(0, &room, &["run", "small.toml", "-q", "--force"]);
}

#[test]
fn a_folder_that_cannot_be_written_ends_with_status_1_before_anything_is_computed() {
    let room = small_room("unwritable");
    fs::write(room.join("file"), "x").unwrap();
    let start = Instant::now();
    let huge = "monte_carlo.paths=100000000000";
    let (table, err) = expect(
        1,
        &room,
        &["run", "small.toml", "--out", "file/sub", "--set", huge],
    );
    assert!(table.is_empty() && err.contains("file/sub"), "{err}");
    // The paths would take hours.
    assert!(start.elapsed() < Duration::from_secs(60));
}

#[test]
fn a_limit_of_time_ends_with_status_3_and_names_its_key() {
    let room = small_room("limit");
    let (_, err) = expect(
        3,
        &room,
        &["run", "small.toml", "--set", "accuracy.max_seconds=1e-9"],
    );
    assert!(err.contains("accuracy.max_seconds"), "{err}");
    let all = results(&room.join("results/small"));
    let warnings = all["run"]["warnings"].as_array().unwrap();
    for words in ["unfinished", "accuracy.max_seconds"] {
        let says = |it: &serde_json::Value| it.as_str().unwrap().contains(words);
        assert!(warnings.iter().any(says), "{words}: {warnings:?}");
    }
}

#[test]
fn a_tolerance_missed_on_cells_and_step_of_the_scene_is_a_warning_and_status_0() {
    let room = room("fixed");
    fs::write(
        room.join("a.toml"),
        "[oscillator]\nzeta = 0.05\nh = 2e-3\n[initial]\nkind = \"gaussian\"\nmean = [0, 0]\n\
         deviation = [0.3, 0.3]\n[outputs]\nmoments_at = [1]\n[accuracy]\ntolerance = 1e-9\n\
         [method]\ncells = [40, 30]\nstep = 0.5\n",
    )
    .unwrap();
    let (table, _) = expect(0, &room, &["run", "a.toml"]);
    assert!(
        table.contains("the tolerance 1e-9 is not met") && !table.contains("exit status"),
        "{table}"
    );
    let warnings = results(&room.join("results/a"))["run"]["warnings"].to_string();
    assert!(
        warnings.contains("the tolerance 1e-9 is not met"),
        "{warnings}"
    );
}

#[test]
fn quiet_prints_nothing() {
    let room = small_room("quiet");
    let (out, err) = expect(0, &room, &["run", "small.toml", "--quiet"]);
    assert!(out.is_empty() && err.is_empty(), "{out}{err}");
}

#[test]
fn a_reader_that_leaves_early_is_no_error() {
    let room = small_room("pipe");
    for arguments in [
        &["scenes", "default"][..],
        &["run", "small.toml", "--force"],
    ] {
        let mut child = program(&room)
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let it = child.wait_with_output().unwrap();
        assert_eq!((it.status.code(), err(&it)), (Some(0), String::new()));
    }
}

/// A watch that fails when a part has ended, after its files are there.
struct Fails<'a>(&'a Folder, Part);

impl Watch for Fails<'_> {
    fn ends(&self, part: Part, results: &Results) -> Result<(), Error> {
        self.0.write(&report::after(part, results)?)?;
        if part == self.1 {
            return Err(Error::invalid("test", "failure", "nothing"));
        }
        Ok(())
    }
}

#[test]
fn files_of_finished_stages_stay_whole_when_a_later_stage_fails() {
    let room = room("later");
    let text = SceneText::parse("small.toml", SMALL, &[]).unwrap();
    let folder = Folder::open(&room.join("out"), Existing::Refuse).unwrap();
    let plan = Plan::of(text.scene()).unwrap();
    plan.run(&Fails(&folder, Part::Transient)).unwrap_err();
    let all = results(&room.join("out"));
    assert!(all["transient"].is_object() && all.get("steady").is_none());
    let warning = all["run"]["warnings"].to_string();
    assert!(
        warning.contains("unfinished: steady, decay_rates, monte_carlo"),
        "{warning}"
    );
    assert!(room.join("out/moments.csv").is_file() && room.join("out/density_2.npz").is_file());
}

#[test]
fn a_killed_run_leaves_whole_files_and_two_runs_do_not_share_a_folder() {
    let room = small_room("killed");
    let mut child = program(&room)
        .args(["run", "small.toml", "--set", "monte_carlo.paths=2000000000"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let folder = room.join("results/small");
    let start = Instant::now();
    while !folder.join("decay_rates.csv").exists() {
        assert!(
            start.elapsed() < Duration::from_secs(300),
            "the stages before do not end"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    let (_, err) = expect(2, &room, &["run", "small.toml", "--force"]);
    assert!(err.contains("no other run is writing into"), "{err}");
    child.kill().unwrap();
    child.wait().unwrap();
    let all = results(&folder);
    assert!(all["transient"].is_object() && all.get("monte_carlo").is_none());
    assert!(all["run"]["warnings"].to_string().contains("unfinished"));
    expect(0, &room, &["run", "small.toml", "-q"]);
    assert!(results(&folder)["monte_carlo"].is_object());
}

/// Records and crossings that take no time.
const RECORDS: &str = r#"
title = "long"
[oscillator]
zeta = 0.05
h = 0.02
[rig]
static_load = 110
frequency = 232
static_compression = 7e-6
[outputs]
stationary = true
crossings = { window = 20 }
[monte_carlo]
duration = 5e4
[accuracy]
tolerance = 1e-2
"#;

#[test]
fn long_records_stand_beside_the_closed_form_with_their_errors() {
    let room = room("records");
    fs::write(room.join("long.toml"), RECORDS).unwrap();
    table_with(
        &room,
        "long.toml",
        &[
            "closed form long realisations",
            "LOSSES OF CONTACT",
            "agreement",
            "mean flight",
            "the window is 20 s",
        ],
    );
    let folder = room.join("results/long");
    hold(
        &folder,
        &[
            "records.csv",
            "records_q.csv",
            "records_v.csv",
            "records_force.csv",
            "crossings.csv",
            "flights.csv",
            "flights.svg",
            "force.svg",
        ],
    );
    let csv = fs::read_to_string(folder.join("records_force.csv")).unwrap();
    assert!(
        csv.starts_with(
            "N from [F_s],N to [F_s],density [1/F_s],standard error of density [1/F_s]"
        )
    );
    assert_eq!(csv.lines().count(), 101);
    assert!(
        fs::read_to_string(folder.join("force.svg"))
            .unwrap()
            .contains("long realisations")
    );
    let all = results(&folder);
    assert!(all.get("transient").is_none() && all["monte_carlo"].get("transient").is_none());
    // Every stationary number agrees with the closed form, and no error is idle.
    let sampled = &all["monte_carlo"]["stationary"];
    let mut compared = 0;
    for (name, exact) in all["stationary"].as_object().unwrap() {
        let (a, b) = (&exact["value"], &sampled[name]["value"]);
        let error = sampled[name]["error"].as_f64().unwrap();
        let z = (a.as_f64().unwrap() - b.as_f64().unwrap()).abs() / error;
        println!("{name}: {b} ± {error:.1e}, z = {z:.2}");
        assert!(z < 4.0 && error < 0.5, "{name}");
        compared += 1;
    }
    assert_eq!(compared, 13);
    let method = &sampled["method"];
    assert!(method["effective_samples"]["mean_energy"].as_f64().unwrap() > 100.0);
    assert!(method["batches"].is_u64() && method["batch_length"].is_f64());
    assert_eq!(method["control_variates"], true);
    assert!(all["agreement"]["t"].is_null() && all["agreement"]["compared"] == 14);
    assert!(all["agreement"]["worst"].as_f64().unwrap() < 4.0);
    // The scene in the folder runs again to the same numbers.
    expect(
        0,
        &room,
        &["run", "results/long/scene.toml", "--out", "again", "-q"],
    );
    assert_eq!(
        results(&room.join("again"))["monte_carlo"],
        all["monte_carlo"]
    );
}

#[test]
fn losses_of_contact_follow_rice_and_are_counted_in_a_window_of_seconds() {
    let room = room("crossings");
    fs::write(room.join("long.toml"), RECORDS).unwrap();
    expect(0, &room, &["run", "long.toml", "-q"]);
    let all = results(&room.join("results/long"));
    let value = |it: &Value| it["value"].as_f64().unwrap();
    let (exact, seen) = (&all["crossings"], &all["monte_carlo"]["crossings"]);
    // T = 0.628...: nu = 0.03646636, P/nu = sqrt(2 pi T), 20 s are 20 * 2 pi 232.
    assert!((value(&exact["loss_rate"]) - 0.036_466_36).abs() < 1e-8);
    let window = 20.0 * std::f64::consts::TAU * 232.0;
    let losses = value(&exact["losses_in_window"]);
    assert!(
        (losses / (0.036_466_36 * window) - 1.0).abs() < 1e-6,
        "{losses}"
    );
    assert!((value(&exact["mean_flight"]) - 1.986_918).abs() < 1e-6);
    let list = |it: &Value| -> Vec<f64> {
        let all = it.as_array().unwrap().iter();
        all.map(|x| x.as_f64().unwrap()).collect()
    };
    let t = list(&exact["flight_time"]);
    let p = list(&exact["flight_density"]["value"]);
    let mass: f64 = p.iter().map(|p| p * (t[1] - t[0])).sum();
    assert!((mass - 1.0).abs() < 1e-3, "{mass}");
    assert!(room.join("results/long/flight_law.npz").is_file());
    for name in [
        "loss_rate",
        "losses_in_window",
        "mean_flight",
        "mean_impact_speed",
    ] {
        let (a, b) = (value(&exact[name]), value(&seen[name]));
        let error = seen[name]["error"].as_f64().unwrap();
        println!("{name}: {a} by Rice, {b} ± {error:.1e} in records");
        assert!((a - b).abs() < 4.0 * error && error < 0.05 * a, "{name}");
    }
    // The density of the time of flight integrates to one and has the mean flight for a mean.
    let numbers = |it: &Value| -> Vec<f64> {
        it.as_array()
            .unwrap()
            .iter()
            .map(|x| x.as_f64().unwrap())
            .collect()
    };
    let (t, p) = (
        numbers(&seen["flight_time"]),
        numbers(&seen["flight_density"]["value"]),
    );
    assert_eq!(numbers(&seen["flight_density"]["error"]).len(), t.len());
    let width = t[1] - t[0];
    let mass: f64 = p.iter().sum::<f64>() * width;
    let mean: f64 = t.iter().zip(&p).map(|(t, p)| t * p * width).sum();
    println!("flights: mass {mass}, mean {mean}");
    assert!((mass - 1.0).abs() < 1e-3);
    assert!((mean / value(&seen["mean_flight"]) - 1.0).abs() < 0.02);
    let rig = &all["rig"];
    let flight = value(&exact["mean_flight"]) * 1e3 / (std::f64::consts::TAU * 232.0);
    assert!((value(&rig["mean_flight_ms"]) / flight - 1.0).abs() < 1e-12);
    assert_eq!(rig["losses_in_window"], exact["losses_in_window"]);
    let out = value(&rig["time_out_of_contact_s"]);
    assert!(
        (out / (20.0 * value(&all["stationary"]["contact_loss_probability"])) - 1.0).abs() < 1e-12
    );
    assert!(rig["monte_carlo"]["mean_flight_ms"]["error"].is_f64());
    // Without a rig the window is a dimensionless time, and without records there is Rice alone.
    let text = "[oscillator]\nzeta = 0.05\nh = 0.02\n[outputs]\ncrossings = { window = 20 }";
    fs::write(room.join("bare.toml"), text).unwrap();
    expect(0, &room, &["run", "bare.toml", "-q"]);
    let bare = results(&room.join("results/bare"));
    let losses = value(&bare["crossings"]["losses_in_window"]);
    assert!((losses / (20.0 * 0.036_466_36) - 1.0).abs() < 1e-6);
    for name in ["stationary", "monte_carlo", "agreement", "rig"] {
        assert!(bare.get(name).is_none(), "{name}");
    }
}

#[test]
fn only_what_asks_for_records_gets_them() {
    let room = room("asked");
    let base = "[oscillator]\nzeta = 0.05\nh = 0.02\n[initial]\ndeviation = [0.8, 0.8]\n";
    for (name, rest, parts) in [
        ("alone", "[monte_carlo]\n", &["stationary", "records"][..]),
        (
            "off",
            "[outputs]\nstationary = false\n[monte_carlo]\n",
            &["records"],
        ),
        (
            "paths",
            "[outputs]\nmoments_at = [1]\n[monte_carlo]\n",
            &["transient", "monte_carlo"],
        ),
        (
            "both",
            "[outputs]\nmoments_at = [1]\n[monte_carlo]\nduration = 1e4\n",
            &["transient", "monte_carlo", "records"],
        ),
        (
            "crossings",
            "[outputs]\nmoments_at = [1]\ncrossings = { window = 3 }\n[monte_carlo]\n",
            &["crossings", "transient", "monte_carlo", "records"],
        ),
        (
            "rice",
            "[outputs]\ncrossings = { window = 3 }\n",
            &["crossings"],
        ),
    ] {
        let text = SceneText::parse(name, &format!("{base}{rest}"), &[]).unwrap();
        let plan = Plan::of(text.scene()).unwrap();
        let names: Vec<&str> = plan.stages().iter().map(|it| it.part.name()).collect();
        assert_eq!(names, parts, "{name}");
        let records = plan.stages().iter().find(|it| it.part == Part::Records);
        if let Some(it) = records {
            assert!(it.cost.steps > 0 && it.cost.memory > 0 && it.cost.seconds > 0.0);
            assert!(!it.needed_by.is_empty(), "{name}");
        }
        let again = SceneText::parse(name, &text.scene().to_toml(), &[]).unwrap();
        let again = Plan::of(again.scene()).unwrap();
        assert_eq!(again.stages(), plan.stages(), "{name}");
    }
    let (text, _) = expect(0, &room, &["plan", "table-3"]);
    for word in [
        "records",
        "crossings",
        "monte_carlo, crossings",
        "splitting_4_2",
    ] {
        assert!(text.contains(word), "{word}: {text}");
    }
}

#[test]
fn records_that_saw_no_loss_say_so_and_leave_no_number_that_does_not_exist() {
    let room = room("rare");
    fs::write(room.join("long.toml"), RECORDS).unwrap();
    let rare = ["run", "long.toml", "--set", "oscillator.h=1e-4"];
    let (table, _) = expect(0, &room, &rare);
    let words = table.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(words.contains("saw no loss of contact"), "{table}");
    let all = results(&room.join("results/long"));
    let seen = &all["monte_carlo"]["crossings"];
    assert_eq!(seen["loss_rate"]["value"], 0.0);
    assert!(seen["loss_rate"]["error"].as_f64().unwrap() > 0.0);
    assert!(seen["mean_flight"].is_null() && seen["flight_density"].is_null());
    assert!(all["monte_carlo"]["stationary"]["log10_contact_loss_probability"].is_null());
    assert!(!room.join("results/long/flights.csv").exists());
    assert!(all["agreement"]["worst"].as_f64().unwrap() < 4.0);
}

#[test]
fn killed_records_leave_the_whole_files_of_the_stages_before() {
    let room = room("killed-records");
    fs::write(room.join("long.toml"), RECORDS).unwrap();
    let mut child = program(&room)
        .args(["run", "long.toml", "--set", "monte_carlo.duration=1e10"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let folder = room.join("results/long");
    let start = Instant::now();
    while !results_if(&folder).is_some_and(|all| all["crossings"].is_object()) {
        assert!(start.elapsed() < Duration::from_secs(300), "no crossings");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let all = results(&folder);
    assert!(all["stationary"].is_object() && all.get("monte_carlo").is_none());
    let warnings = all["run"]["warnings"].to_string();
    assert!(
        warnings.contains("unfinished: records had not ended yet"),
        "{warnings}"
    );
    assert!(folder.join("crossings.csv").is_file() && !folder.join("records.csv").exists());
}

#[test]
fn records_and_paths_stop_at_the_limit_of_time_and_leave_whole_files() {
    let room = small_room("late");
    fs::write(room.join("long.toml"), RECORDS).unwrap();
    // Of paths those that were done are the answer.
    for (scene, size, expected) in [
        (
            "long",
            "monte_carlo.duration=1e10",
            [
                "NO ANSWER: records (exit status 3)",
                "no answer: accuracy.max_seconds = 1.0",
            ],
        ),
        (
            "small",
            "monte_carlo.paths=1000000000",
            [
                "CUT SHORT: monte_carlo (exit status 3); the numbers stand",
                "of 1000000000 paths, and how many are done in time",
            ],
        ),
    ] {
        let start = Instant::now();
        let file = format!("{scene}.toml");
        let limit = "accuracy.max_seconds=1";
        let (out, _) = expect(3, &room, &["run", &file, "--set", size, "--set", limit]);
        let words: Vec<&str> = out.split_whitespace().collect();
        let said = words.join(" ");
        assert!(expected.iter().all(|it| said.contains(it)), "{out}");
        assert!(
            start.elapsed() < Duration::from_secs(30),
            "{:?}",
            start.elapsed()
        );
        let folder = room.join("results").join(scene);
        let all = results(&folder);
        assert!(all["stationary"].is_object());
        assert_eq!(all.get("monte_carlo").is_some(), scene == "small");
        for entry in fs::read_dir(&folder).unwrap() {
            let name = entry.unwrap().file_name();
            assert!(!name.to_string_lossy().ends_with(".part"), "{name:?}");
        }
    }
}

#[test]
fn numpy_reads_every_array() {
    let room = small_room("numpy");
    expect(0, &room, &["run", "small.toml", "-q"]);
    for name in ["density_1.npz", "density_2.npz", "steady.npz"] {
        let file = fs::File::open(room.join("results/small").join(name)).unwrap();
        let mut arrays = NpzReader::new(file).unwrap();
        let p: Array2<f64> = arrays.by_name("p").unwrap();
        let [q, v]: [Array1<f64>; 2] = ["q", "v"].map(|name| arrays.by_name(name).unwrap());
        let t: Array0<f64> = arrays.by_name("t").unwrap();
        assert_eq!(p.dim(), (q.len(), v.len()));
        assert!(t.into_scalar() > 0.0);
        // Cells end half way between their centres.
        let widths = |x: &Array1<f64>| {
            let last = x.len() - 1;
            let at = |k: usize| 0.5 * (x[(k + 1).min(last)] - x[k.saturating_sub(1)]);
            Array1::from_shape_fn(x.len(), at)
        };
        let mass = widths(&q).dot(&p.dot(&widths(&v)));
        println!("{name}: mass {mass:.7}");
        assert!((mass - 1.0).abs() < 2e-3, "{name}: {mass}");
    }
    let script = "import numpy as n, glob\n\
        files = sorted(glob.glob('results/small/*.npz'))\n\
        assert len(files) == 3, files\n\
        for f in files:\n\
        \x20   z = n.load(f)\n\
        \x20   p, q, v = z['p'], z['q'], z['v']\n\
        \x20   assert p.dtype == n.float64 and p.flags['C_CONTIGUOUS'], f\n\
        \x20   assert p.shape == (len(q), len(v)) and z['t'].shape == (), f\n\
        \x20   mass = n.trapezoid(n.trapezoid(p, v, axis=1), q)\n\
        \x20   assert abs(mass - 1) < 2e-3, mass\n\
        print('read', len(files))";
    let python = Command::new("python3")
        .current_dir(&room)
        .args(["-c", script])
        .output();
    match python {
        Ok(it) if it.status.success() => println!("numpy: {}", out(&it)),
        Ok(it) if err(&it).contains("No module named") => println!("skipped: no numpy here"),
        Ok(it) => panic!("{}", err(&it)),
        Err(_) => println!("skipped: no python3 here"),
    }
}

#[test]
fn decay_rates_are_listed_slowest_first_without_the_stationary_one() {
    let room = room("rates");
    let scene = "[oscillator]\nzeta = 0.05\nh = 0.02\n[outputs]\ndecay_rates = 3\n";
    fs::write(room.join("rates.toml"), scene).unwrap();
    expect(0, &room, &["run", "rates.toml", "-q"]);
    let all = results(&room.join("results/rates"));
    let rates = all["decay_rates"].as_array().unwrap();
    assert_eq!(rates.len(), 3);
    let re = |k: usize| rates[k]["re"].as_f64().unwrap();
    assert!(re(0) < -1e-3 && re(0) >= re(1) && re(1) >= re(2));
    // -1/(8 zeta T), T = pi h/(2 zeta).
    let edge = all["continuous_from"].as_f64().unwrap();
    assert!((edge + 1.0 / (4.0 * std::f64::consts::PI * 0.02)).abs() < 1e-12);
    for rate in rates {
        assert!(rate["im"].as_f64().unwrap() >= 0.0);
        let error = rate["error"].as_f64().unwrap();
        assert!(error > 0.0 && error < 1e-2, "{rate}");
    }
}

#[test]
fn where_flights_decay_slowest_no_rate_is_printed_but_the_edge_is() {
    let room = room("continuum");
    let scene = "[oscillator]\nzeta = 0.9\nh = 0.36\n[initial]\nkind = \"rest\"\n[outputs]\n\
                 decay_rates = 3\nmoments_at = { every = 2, until = 20 }\n";
    fs::write(room.join("continuum.toml"), scene).unwrap();
    let (shown, _) = expect(0, &room, &["run", "continuum.toml"]);
    let all = results(&room.join("results/continuum"));
    assert_eq!(all["decay_rates"].as_array().unwrap().len(), 0);
    assert!((all["continuous_from"].as_f64().unwrap() + 0.2210).abs() < 1e-4);
    assert!(shown.contains("continuous from -0.22105 on"), "{shown}");
    let picture = fs::read_to_string(room.join("results/continuum/approach.svg")).unwrap();
    assert!(picture.contains("exp(\u{2212}0.2210"));
}

#[test]
fn the_report_of_a_first_loss_shows_its_survival() {
    let room = room("survival");
    let scene = "[oscillator]\nzeta = 0.2\nh = 0.1\n[outputs]\nfirst_loss = { until = 3 }\n\
                 [accuracy]\ntolerance = 1e-2\n";
    fs::write(room.join("survival.toml"), scene).unwrap();
    expect(0, &room, &["run", "survival.toml", "-q"]);
    let page = fs::read_to_string(room.join("results/survival/report.html")).unwrap();
    assert!(page.contains("Survival until the first loss of contact"));
    assert!(room.join("results/survival/survival.svg").is_file());
}

#[test]
fn validate_writes_over_no_page_but_its_own_and_takes_folders_that_lie_together() {
    let room = room("pages");
    let folder = |path: &str| {
        let folder = room.join(path);
        fs::create_dir_all(&folder).unwrap();
        fs::write(
            folder.join("scene.toml"),
            "[oscillator]\nzeta = 0.005\nh = 2e-3\n",
        )
        .unwrap();
        fs::write(
            folder.join("paper.csv"),
            "name,value,tolerance,where,reason,because\n\
             h=2e-3: stationary.std_force,0.748,5e-4,Table 4,,\n",
        )
        .unwrap();
    };
    folder("a/table");
    folder("b/table");
    folder("b/other");
    fs::write(room.join("a/README.md"), "# Mine\n").unwrap();
    let (_, message) = expect_lab(2, &room, &["validate", "a/table"]);
    assert!(
        message.contains("README.md") && message.contains("--force"),
        "{message}"
    );
    let mine = fs::read_to_string(room.join("a/README.md")).unwrap();
    assert_eq!(mine, "# Mine\n");
    let (_, message) = expect_lab(2, &room, &["validate", "b/table", "a/table"]);
    assert!(message.contains("side by side"), "{message}");
    let (_, message) = expect_lab(2, &room, &["validate", "b/table", "b/table"]);
    assert!(message.contains("each folder once"), "{message}");
    expect_lab(0, &room, &["validate", "b/table", "b/other", "-q"]);
    let page = fs::read_to_string(room.join("b/README.md")).unwrap();
    assert!(page.contains("## table") && page.contains("## other"));
    // Its own page is written again, with what the other folders left in it.
    expect_lab(0, &room, &["validate", "b/table", "-q"]);
    let again = fs::read_to_string(room.join("b/README.md")).unwrap();
    assert!(again.contains("## table") && again.contains("## other"));
}

#[test]
fn a_run_that_is_refused_takes_nothing_with_it_that_others_made() {
    let room = room("neighbours");
    let (one, two) = (room.join("results/one"), room.join("results/two"));
    // The folder of results is made by the run that is refused, and used by the other meanwhile.
    let refused = Folder::open(&one, Existing::Refuse).unwrap();
    let other = Folder::open(&two, Existing::Refuse).unwrap();
    let file = report::File {
        name: "results.json".into(),
        bytes: b"{}".to_vec(),
    };
    refused.write(std::slice::from_ref(&file)).unwrap();
    other.write(&[file]).unwrap();
    refused.discard();
    assert!(!one.exists() && two.join("results.json").is_file());
    other.discard();
    assert!(!two.exists() && room.exists());
}

/// Scenes that are wrong, by name. What the program says about each stands in bad_scenes.txt.
const BAD: &[(&str, &str)] = &[
    (
        "density of a point",
        "[oscillator]\nzeta = 0.005\nh = 2e-3\n[outputs]\ndensity_at = [0, 1]",
    ),
    ("empty", ""),
    ("not TOML", "[oscillator\nzeta = 0.005"),
    ("a decimal comma", "[oscillator]\nzeta = 0,8\nh = 0.02"),
    (
        "a ratio in per cent",
        "[oscillator]\nzeta = 0.8 %\nh = 0.02",
    ),
    (
        "a number with its unit",
        "[oscillator]\nzeta = 0.01\nh = 0.02\n[rig]\nstatic_load = 60 N",
    ),
    ("value missing", "[oscillator]\nzeta = \nh = 2e-3"),
    (
        "key twice",
        "[oscillator]\nzeta = 0.005\nzeta = 0.006\nh = 2e-3",
    ),
    ("section misspelt", "[oscilator]\nzeta = 0.005\nh = 2e-3"),
    ("key misspelt", "[oscillator]\nzetta = 0.005\nh = 2e-3"),
    ("zeta missing", "[oscillator]\nh = 2e-3"),
    ("h missing", "[oscillator]\nzeta = 0.005"),
    ("zeta zero", "[oscillator]\nzeta = 0\nh = 2e-3"),
    ("zeta negative", "[oscillator]\nzeta = -0.005\nh = 2e-3"),
    ("h not a number", "[oscillator]\nzeta = 0.005\nh = nan"),
    ("h infinite", "[oscillator]\nzeta = 0.005\nh = inf"),
    ("h as text", "[oscillator]\nzeta = 0.005\nh = \"2e-3\""),
    (
        "contact misspelt",
        "[oscillator]\ncontact = \"herz\"\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "contact not text",
        "[oscillator]\ncontact = 1\nzeta = 0.005\nh = 2e-3",
    ),
    ("oscillator not a table", "oscillator = 3"),
    (
        "law missing",
        "[oscillator]\ncontact = { exponent = 2 }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "law misspelt",
        "[oscillator]\ncontact = { law = \"powr\" }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "law with an unknown key",
        "[oscillator]\ncontact = { law = \"power\", exponnt = 2 }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "exponent missing",
        "[oscillator]\ncontact = { law = \"power\" }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "exponent below 1",
        "[oscillator]\ncontact = { law = \"power\", exponent = 0.5 }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "exponent not a number",
        "[oscillator]\ncontact = { law = \"power\", exponent = nan }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "exponent as text",
        "[oscillator]\ncontact = { law = \"power\", exponent = \"2\" }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "gap negative",
        "[oscillator]\ncontact = { law = \"power\", exponent = 1.5, gap = -1 }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "back without gap",
        "[oscillator]\ncontact = { law = \"power\", exponent = 1.5, back = 1 }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "back zero",
        "[oscillator]\ncontact = { law = \"power\", exponent = 1.5, gap = 1, back = 0 }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "coefficients missing",
        "[oscillator]\ncontact = { law = \"polynomial\" }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "coefficients too many",
        "[oscillator]\ncontact = { law = \"polynomial\", coefficients = [1, 0, 0, 1] }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "coefficients do not confine",
        "[oscillator]\ncontact = { law = \"polynomial\", coefficients = [1, 0.5] }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "coefficient not finite",
        "[oscillator]\ncontact = { law = \"polynomial\", coefficients = [1, inf, 1] }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "coefficient as text",
        "[oscillator]\ncontact = { law = \"polynomial\", coefficients = [1, \"a\"] }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "table without file",
        "[oscillator]\ncontact = { law = \"table\" }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "table file absent",
        "[oscillator]\ncontact = { law = \"table\", file = \"absent.csv\" }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "table unsorted",
        "[oscillator]\ncontact = { law = \"table\", q = [0, 1, 1], force = [-1, 0, 1] }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "table uneven",
        "[oscillator]\ncontact = { law = \"table\", q = [0, 1], force = [-1, 0, 1] }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "table does not confine",
        "[oscillator]\ncontact = { law = \"table\", q = [-1, 0, 1], force = [1, 0, 1] }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "table not a number",
        "[oscillator]\ncontact = { law = \"table\", q = [-1, nan, 1], force = [-1, 0, 1] }\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "h and force_psd",
        "[oscillator]\nzeta = 0.005\nh = 2e-3\nforce_psd = 0.17",
    ),
    (
        "force_psd without rig",
        "[oscillator]\nzeta = 0.005\nforce_psd = 0.17",
    ),
    (
        "force_psd negative",
        "[oscillator]\nzeta = 0.005\nforce_psd = -1\n[rig]\nstatic_load = 110\nfrequency = 232\nstatic_compression = 7e-6",
    ),
    (
        "rig incomplete",
        "[oscillator]\nzeta = 0.005\nh = 2e-3\n[rig]\nstatic_load = 110",
    ),
    (
        "rig load zero",
        "[oscillator]\nzeta = 0.005\nh = 2e-3\n[rig]\nstatic_load = 0\nfrequency = 232\nstatic_compression = 7e-6",
    ),
    (
        "title of two lines",
        "title = \"a\\nb\"\n[oscillator]\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "title a number",
        "title = 3\n[oscillator]\nzeta = 0.005\nh = 2e-3",
    ),
    ("deviation missing", "@[initial]\nkind = \"gaussian\""),
    ("deviation negative", "@[initial]\ndeviation = [0.3, -0.3]"),
    (
        "mean of three",
        "@[initial]\nmean = [0, 0, 0]\ndeviation = [1, 1]",
    ),
    (
        "mean not numbers",
        "@[initial]\nmean = [\"a\", 0]\ndeviation = [1, 1]",
    ),
    ("mean at rest", "@[initial]\nkind = \"rest\"\nmean = [0, 0]"),
    ("times descending", "@[outputs]\nmoments_at = [1, 3, 2]"),
    ("times twice", "@[outputs]\nmoments_at = [1, 1]"),
    ("time negative", "@[outputs]\ndensity_at = [-1]"),
    ("time infinite", "@[outputs]\nmoments_at = [1, inf]"),
    ("times as number", "@[outputs]\nmoments_at = 5"),
    (
        "times too many",
        "@[outputs]\nmoments_at = { every = 1e-6, until = 50 }",
    ),
    (
        "times never",
        "@[outputs]\nmoments_at = { every = 5, until = 1 }",
    ),
    ("until missing", "@[outputs]\nmoments_at = { every = 5 }"),
    (
        "every misspelt",
        "@[outputs]\nmoments_at = { evry = 5, until = 10 }",
    ),
    ("nothing asked", "@[outputs]\nstationary = false"),
    ("steady as number", "@[outputs]\nsteady = 1"),
    ("too many rates", "@[outputs]\ndecay_rates = 1000"),
    ("half a rate", "@[outputs]\ndecay_rates = 1.5"),
    (
        "free without outputs",
        "[oscillator]\ncontact = \"free\"\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "free and steady",
        "[oscillator]\ncontact = \"free\"\nzeta = 0.005\nh = 2e-3\n[outputs]\nsteady = true",
    ),
    (
        "free from stationary",
        "[oscillator]\ncontact = \"free\"\nzeta = 0.005\nh = 2e-3\n[initial]\nkind = \"stationary\"\n[outputs]\nmoments_at = [1]",
    ),
    (
        "no paths",
        "@[outputs]\nmoments_at = [1]\n[monte_carlo]\npaths = 0",
    ),
    (
        "negative paths",
        "@[outputs]\nmoments_at = [1]\n[monte_carlo]\npaths = -5",
    ),
    (
        "scheme misspelt",
        "@[outputs]\nmoments_at = [1]\n[monte_carlo]\nscheme = \"boaab\"",
    ),
    (
        "step zero",
        "@[outputs]\nmoments_at = [1]\n[monte_carlo]\nstep = 0",
    ),
    ("tolerance one", "@[accuracy]\ntolerance = 1"),
    ("tolerance negative", "@[accuracy]\ntolerance = -1e-3"),
    ("no time", "@[accuracy]\nmax_seconds = 0"),
    ("memory in words", "@[accuracy]\nmax_memory = \"much\""),
    (
        "no cells",
        "@[outputs]\nsteady = true\n[method]\ncells = [0, 100]",
    ),
    (
        "cells negative",
        "@[outputs]\nsteady = true\n[method]\ncells = [160, -100]",
    ),
    (
        "three cells",
        "@[outputs]\nsteady = true\n[method]\ncells = [160, 100, 3]",
    ),
    (
        "cells beyond memory",
        "@[outputs]\nsteady = true\n[method]\ncells = [1_000_000_000, 100]",
    ),
    ("drift of order 3", "@[method]\ndrift = 3"),
    (
        "unknown method",
        "@[method]\ntransient = \"finite_element\"",
    ),
    (
        "steps without end",
        "@[outputs]\nmoments_at = [1e6]\n[method]\nstep = 1e-300",
    ),
    (
        "spectrum without end",
        "@[outputs]\nspectrum = { until = 1e9 }",
    ),
    (
        "first loss without end",
        "@[outputs]\nfirst_loss = { until = 1e10 }",
    ),
    (
        "first loss at once",
        "@[outputs]\nfirst_loss = { until = 0 }",
    ),
    (
        "first loss of a linear oscillator",
        "[oscillator]\ncontact = \"linear\"\nzeta = 0.005\nh = 2e-3\n[outputs]\nfirst_loss = { until = 20 }",
    ),
    (
        "first loss under cosines",
        "@[outputs]\nfirst_loss = { until = 20 }\n[monte_carlo]\nnoise = { cosines = 400, band = 8.0 }",
    ),
    (
        "damping misspelt",
        "[oscillator]\ndamping = \"hunt\"\nzeta = 0.005\nh = 2e-3",
    ),
    (
        "damping in contact that never is",
        "[oscillator]\ncontact = \"free\"\ndamping = \"contact\"\nzeta = 0.005\nh = 2e-3\n[outputs]\nmoments_at = [1]",
    ),
    (
        "damping in proportion to a force that pulls",
        "[oscillator]\ncontact = { law = \"polynomial\", coefficients = [1.0, 0.0, 1.0] }\ndamping = \"hunt_crossley\"\n\
         zeta = 0.005\nh = 2e-3",
    ),
    (
        "passage without side",
        "@[outputs]\nfirst_passage = { level = 3, until = 20 }",
    ),
    (
        "passage of no level",
        "@[outputs]\nfirst_passage = { side = \"above\", until = 20 }",
    ),
    (
        "passage on the wrong side",
        "[oscillator]\nzeta = 0.005\nh = 2e-3\n[initial]\nkind = \"rest\"\n\n[outputs]\nfirst_passage = { level = -1, side = \"above\", until = 20 }",
    ),
    (
        "passage without end",
        "@[outputs]\nfirst_passage = { level = 1, side = \"either\", until = 1e12 }",
    ),
    ("crossings by number", "@[outputs]\ncrossings = 20"),
    ("crossings without window", "@[outputs]\ncrossings = {}"),
    ("no window", "@[outputs]\ncrossings = { window = 0 }"),
    (
        "window without end",
        "@[outputs]\ncrossings = { window = 1e10 }",
    ),
    (
        "crossings of a linear oscillator",
        "[oscillator]\ncontact = \"linear\"\nzeta = 0.005\nh = 2e-3\n[outputs]\ncrossings = { window = 20 }",
    ),
    (
        "crossings in free fall",
        "[oscillator]\ncontact = \"free\"\nzeta = 0.005\nh = 2e-3\n[outputs]\ncrossings = { window = 20 }",
    ),
    (
        "first loss by a scheme that locates none",
        "@[outputs]\nfirst_loss = { until = 5 }\n[monte_carlo]\nscheme = \"exponential_heun\"",
    ),
    (
        "first loss without end",
        "@[outputs]\nfirst_loss = { until = 1e12 }\n[monte_carlo]\npaths = 100",
    ),
    (
        "friction too weak for a course",
        "[oscillator]\nzeta = 1e-11\nh = 1e-14\n[outputs]\nreach = { quantity = \"mean_energy\", fraction = 0.9 }",
    ),
    (
        "too many cosines",
        "@[monte_carlo]\nnoise = { cosines = 20000, band = 4 }",
    ),
    ("no duration", "@[monte_carlo]\nduration = 0"),
    ("duration without end", "@[monte_carlo]\nduration = 1e15"),
    (
        "steps of records without end",
        "@[monte_carlo]\nstep = 1e-300",
    ),
    (
        "cosines with another scheme",
        "@[monte_carlo]\nscheme = \"baoab\"\nnoise = { cosines = 400, band = 8.0 }",
    ),
    (
        "records in free fall",
        "[oscillator]\ncontact = \"free\"\nzeta = 0.005\nh = 2e-3\n[outputs]\ndensity_at = [1]\n[monte_carlo]\npaths = 10",
    ),
    (
        "unit of time misspelt",
        "@[outputs]\nmoments_at = [1]\ntime_unit = \"periods\"",
    ),
    (
        "seconds without a rig",
        "@[outputs]\nmoments_at = [1]\ntime_unit = \"s\"",
    ),
    (
        "a time beyond the last in its unit",
        "@[outputs]\nmoments_at = [9e8]\ntime_unit = \"period\"",
    ),
    (
        "reach without quantity",
        "@[outputs]\nreach = { fraction = 0.9 }",
    ),
    (
        "reach of an unknown moment",
        "@[outputs]\nreach = { quantity = \"mean_enrgy\", fraction = 0.9 }",
    ),
    (
        "reach of what tends to zero",
        "@[outputs]\nreach = { quantity = \"mean_force\", fraction = 0.9 }",
    ),
    (
        "reach of a skewness that is zero",
        "[oscillator]\ncontact = \"linear\"\nzeta = 0.005\nh = 2e-3\n[outputs]\nreach = { quantity = \"mean_q\", fraction = 0.5 }",
    ),
    (
        "reach of all",
        "@[outputs]\nreach = { quantity = \"mean_energy\", fraction = 1 }",
    ),
    (
        "reach of less than nothing",
        "@[outputs]\nreach = { quantity = \"mean_energy\", fraction = -0.5 }",
    ),
    (
        "reach from the stationary law",
        "[oscillator]\nzeta = 0.005\nh = 2e-3\n[initial]\nkind = \"stationary\"\n[outputs]\nreach = { quantity = \"mean_energy\", fraction = 0.5 }",
    ),
    (
        "duration in free fall",
        "[oscillator]\ncontact = \"free\"\nzeta = 0.005\nh = 2e-3\n[outputs]\nmoments_at = [1]\n[monte_carlo]\nduration = 10",
    ),
    (
        "drive of frequency 0",
        "@[excitation]\ndrive = { amplitude = 0.02, frequency = 0 }",
    ),
    (
        "drive of negative amplitude",
        "@[excitation]\ndrive = { amplitude = -0.02, frequency = 1 }",
    ),
    (
        "drive without frequency",
        "@[excitation]\ndrive = { amplitude = 0.02 }",
    ),
    (
        "drive misspelt",
        "@[excitation]\ndrive = { amplitude = 0.02, frequenzy = 1 }",
    ),
    (
        "drive beyond every mesh",
        "@mean = [0.0, 0.0]\n[excitation]\ndrive = { amplitude = 1e6, frequency = 1 }\n[outputs]\nmoments_at = [1]",
    ),
    (
        "initial condition beyond every mesh, under a drive",
        "@mean = [1e30, 0.0]\n[excitation]\ndrive = { amplitude = 0.02, frequency = 1 }\n[outputs]\nmoments_at = [1]",
    ),
    (
        "envelope out of order",
        "@[excitation]\nenvelope = { times = [0, 5, 4], factors = [0, 1, 1] }",
    ),
    (
        "envelope with a factor too few",
        "@[excitation]\nenvelope = { times = [0, 5], factors = [1] }",
    ),
    (
        "envelope below 0",
        "@[excitation]\nenvelope = { times = [0, 5], factors = [1, -1] }",
    ),
    (
        "no noise at all",
        "@[excitation]\nenvelope = { times = [0, 5], factors = [0, 0] }",
    ),
    (
        "steady state under a drive",
        "@[excitation]\ndrive = { amplitude = 0.02, frequency = 1 }\n[outputs]\nsteady = true",
    ),
    (
        "crossings under an envelope",
        "@[excitation]\nenvelope = { times = [0, 5], factors = [0, 1] }\n[outputs]\ncrossings = { window = 5 }",
    ),
    (
        "periodic law without a drive",
        "@[outputs]\nperiodic = { phases = 32 }",
    ),
    (
        "periodic law under an envelope",
        "@[excitation]\ndrive = { amplitude = 0.02, frequency = 1 }\nenvelope = { times = [0, 5], factors = [0, 1] }\n[outputs]\nperiodic = { phases = 32 }",
    ),
    (
        "few phases",
        "@[excitation]\ndrive = { amplitude = 0.02, frequency = 1 }\n[outputs]\nperiodic = { phases = 2 }",
    ),
    (
        "response downwards",
        "@[excitation]\ndrive = { amplitude = 0.02, frequency = 1 }\n[outputs]\nresponse = { from = 1.2, to = 0.6, points = 61 }",
    ),
    (
        "response of one point",
        "@[excitation]\ndrive = { amplitude = 0.02, frequency = 1 }\n[outputs]\nresponse = { from = 0.6, to = 1.2, points = 1 }",
    ),
    (
        "finite volumes under a drive",
        "@[excitation]\ndrive = { amplitude = 0.02, frequency = 1 }\n[outputs]\nmoments_at = [1]\n[method]\ntransient = \"finite_volume\"",
    ),
    (
        "a moment asked for twice",
        "@[outputs]\nmoments_at = [1]\nmoments = [\"mean_q\", \"var_q\", \"mean_q\"]",
    ),
    (
        "a path of one step beyond all",
        "@[monte_carlo]\nstep = 1e300",
    ),
    (
        "an energy beyond a double",
        "@[initial]\nkind = \"gaussian\"\nmean = [1e200, 0]\ndeviation = [1, 1]",
    ),
    (
        "long realisations under a drive",
        "@[excitation]\ndrive = { amplitude = 0.02, frequency = 1 }\n[outputs]\nmoments_at = [1]\n[monte_carlo]\nduration = 100",
    ),
    (
        "cosines under a drive",
        "@[excitation]\ndrive = { amplitude = 0.02, frequency = 1 }\n[outputs]\nmoments_at = [1]\n[monte_carlo]\nnoise = { cosines = 400, band = 8.0 }",
    ),
    (
        "a scheme that knows no drive",
        "@[excitation]\ndrive = { amplitude = 0.02, frequency = 1 }\n[outputs]\nmoments_at = [1]\n[monte_carlo]\nscheme = \"baoab\"",
    ),
    (
        "loss probability alone of a law without losses",
        "[oscillator]\ncontact = \"linear\"\nzeta = 0.005\nh = 2e-3\n[outputs]\nmoments_at = [1]\nmoments = [\"contact_loss_probability\"]",
    ),
];

/// Put before the scenes above that start with '@'.
const GOOD: &str = "[oscillator]\nzeta = 0.005\nh = 2e-3\n[initial]\nkind = \"gaussian\"\ndeviation = [0.3, 0.3]\n";

#[test]
fn every_bad_scene_is_refused_with_the_message_on_record() {
    let room = room("bad");
    let mut messages = String::new();
    for (name, text) in BAD {
        let text = match text.strip_prefix('@') {
            Some(rest) if rest.starts_with("[initial]") => {
                format!("[oscillator]\nzeta = 0.005\nh = 2e-3\n{rest}\n[outputs]\nmoments_at = [1]")
            }
            Some(rest) => format!("{GOOD}{rest}"),
            None => (*text).to_owned(),
        };
        fs::write(room.join("scene.toml"), &text).unwrap();
        let (out, err) = expect(2, &room, &["run", "scene.toml"]);
        assert!(out.is_empty(), "{name}: {out}");
        let lines: Vec<&str> = err.lines().map(str::trim_end).collect();
        let _ = writeln!(
            messages,
            "## {name}\n{}\n",
            lines.join("\n").trim_matches('\n')
        );
    }
    assert!(
        !room.join("results").exists(),
        "a bad scene left something behind"
    );
    let messages = messages.replace(env!("CARGO_PKG_VERSION"), "VERSION");
    let record = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad_scenes.txt");
    if std::env::var_os("UPDATE_MESSAGES").is_some() {
        fs::write(&record, &messages).unwrap();
    }
    let recorded = fs::read_to_string(&record).unwrap().replace('\r', "");
    for (ours, theirs) in messages.split("## ").zip(recorded.split("## ")) {
        assert_eq!(
            ours, theirs,
            "UPDATE_MESSAGES=1 cargo test records the new message"
        );
    }
    assert_eq!(messages.len(), recorded.len());
    println!("{} bad scenes", BAD.len());
}

/// Parse and plan: an answer or a message, never a panic.
fn taken(text: &str, set: &[String]) -> bool {
    match SceneText::parse("random.toml", text, set) {
        Ok(text) => match Plan::of(text.scene()) {
            Ok(plan) => !report::terminal::plan(&plan).is_empty(),
            Err(error) => text.explain(&error).to_string().is_empty(),
        },
        Err(error) => {
            let report = format!("{:?}", miette::Report::new(error));
            assert!(!report.is_empty());
            false
        }
    }
}

/// A value of any type, sensible or not.
fn value() -> impl Strategy<Value = String> {
    let fixed = prop::sample::select(vec![
        "0",
        "1",
        "-1",
        "5",
        "1e5",
        "2e-3",
        "0.005",
        "nan",
        "inf",
        "-inf",
        "1e300",
        "-1e-300",
        "1e999",
        "99999999999999999999999999",
        "true",
        "false",
        "\"auto\"",
        "\"hertz\"",
        "\"free\"",
        "\"linear\"",
        "\"gaussian\"",
        "\"rest\"",
        "\"stationary\"",
        "\"8 GB\"",
        "\"\"",
        "[]",
        "[1, 2]",
        "[2, 1]",
        "[0.3, 0.3]",
        "[160, 100]",
        "[1, \"a\"]",
        "[[1]]",
        "{}",
        "{ every = 1, until = 5 }",
        "{ every = 1e-9, until = 1e9 }",
        "{ until = 4 }",
        "{ window = 20 }",
        "{ cosines = 3, band = 1 }",
        "2024-01-01",
        "0x10",
        "1_000",
        "'\\u0000'",
        "\"\u{202e}\"",
    ]);
    prop_oneof![
        8 => fixed.prop_map(str::to_owned),
        1 => any::<f64>().prop_map(|x| format!("{x:?}")),
        1 => any::<i64>().prop_map(|n| n.to_string()),
    ]
}

const SECTIONS: &[(&str, &[&str])] = &[
    (
        "oscillator",
        &["contact", "damping", "zeta", "h", "force_psd"],
    ),
    ("rig", &["static_load", "frequency", "static_compression"]),
    ("excitation", &["drive", "envelope"]),
    ("initial", &["kind", "mean", "deviation"]),
    (
        "outputs",
        &[
            "stationary",
            "moments_at",
            "density_at",
            "steady",
            "decay_rates",
            "spectrum",
            "first_loss",
            "first_passage",
            "crossings",
            "periodic",
            "response",
        ],
    ),
    (
        "monte_carlo",
        &["paths", "seed", "scheme", "noise", "step", "duration"],
    ),
    ("accuracy", &["tolerance", "max_seconds", "max_memory"]),
    ("method", &["transient", "drift", "time", "cells", "step"]),
];

/// `section.key = value` of a key that exists.
fn entry() -> impl Strategy<Value = String> {
    (0..SECTIONS.len(), 0..100usize, value()).prop_map(|(section, key, value)| {
        let (section, keys) = SECTIONS[section];
        format!("{section}.{}={value}", keys[key % keys.len()])
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_values_for_any_keys_give_a_plan_or_a_message(
        entries in prop::collection::vec(entry(), 0..6),
        title in any::<String>(),
    ) {
        let mut set = entries;
        set.push(format!("title={title}"));
        taken(GOOD, &set);
        taken(&set.join("\n"), &[]);
    }

    #[test]
    fn mutated_and_truncated_scenes_give_a_plan_or_a_message(
        which in 0..BUILT_IN.len(),
        cut in 0.0..1.0f64,
        at in 0.0..1.0f64,
        with in any::<char>(),
        whole in any::<bool>(),
    ) {
        let text: Vec<char> = BUILT_IN[which].1.chars().collect();
        let mut text = if whole { text } else { text[..(cut * text.len() as f64) as usize].to_vec() };
        if !text.is_empty() {
            let at = (at * text.len() as f64) as usize;
            text[at] = with;
        }
        taken(&text.into_iter().collect::<String>(), &[]);
    }

    #[test]
    fn any_text_at_all_gives_a_message(text in any::<String>(), set in any::<String>()) {
        taken(&text, &[]);
        taken(GOOD, &[set]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 120, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_is_planned_runs_to_files_or_a_message(
        contact in prop::sample::select(vec!["hertz", "bilinear", "linear", "free"]),
        zeta in -3.0..1.0f64,
        temperature in -6.0..4.0f64,
        mean in -3.0..3.0f64,
        deviation in -4.0..1.0f64,
        cells in (8..24usize, 8..24usize),
        times in prop::collection::btree_set(1..40u8, 0..3),
        asked in any::<[bool; 5]>(),
    ) {
        let confines = contact != "free";
        let (zeta, t) = (10f64.powf(zeta), 10f64.powf(temperature));
        let times: Vec<f64> = times.into_iter().map(|it| 0.1 * f64::from(it)).collect();
        let loses = confines && contact != "linear";
        let crossings = if asked[3] && loses { "crossings = { window = 10 }" } else { "" };
        let paths = match (times.is_empty(), asked[4] && confines) {
            (_, true) => "[monte_carlo]\npaths = 20\nstep = 0.1\nduration = 200",
            (true, _) => "",
            (false, _) => "[monte_carlo]\npaths = 20\nstep = 0.1",
        };
        let text = format!(
            "[oscillator]\ncontact = \"{contact}\"\nzeta = {zeta:e}\nh = {:e}\n\
             [initial]\nmean = [{mean}, 0]\ndeviation = [{:e}, 1]\n\
             [outputs]\nstationary = {}\nsteady = {}\nmoments_at = {times:?}\ndensity_at = {times:?}\n\
             decay_rates = {}\n{crossings}\n[accuracy]\nmax_seconds = 0.3\n[method]\ncells = [{}, {}]\n{paths}",
            2.0 * zeta * t / std::f64::consts::PI, 10f64.powf(deviation),
            asked[0] && confines, asked[1] && confines, u8::from(asked[2] && confines), cells.0, cells.1,
        );
        let Ok(text) = SceneText::parse("random.toml", &text, &[]) else { return Ok(()) };
        let Ok(plan) = Plan::of(text.scene()) else { return Ok(()) };
        let Ok(results) = plan.run_quietly() else { return Ok(()) };
        for stage in plan.stages() {
            for file in report::after(stage.part, &results).unwrap() {
                prop_assert!(!file.bytes.is_empty());
            }
        }
        let _: Value = serde_json::from_str(&results.json()).unwrap();
        let table = report::terminal::table(&results, false);
        prop_assert!(table.lines().all(|line| line.chars().count() <= 80), "{}", table);
        report::at_the_end(&results).unwrap();
    }
}

#[test]
#[ignore = "for the gate: reads the file named by RESULTS_JSON"]
fn the_results_json_named_by_the_environment_parses() {
    let path = std::env::var("RESULTS_JSON").unwrap();
    let all: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    let loss = &all["stationary"]["contact_loss_probability"];
    println!("P(contact lost) = {} ± {}", loss["value"], loss["error"]);
    assert!((loss["value"].as_f64().unwrap() - 0.072_455_645_955).abs() < 1e-10);
    assert!(!all["run"]["warnings"].to_string().contains("unfinished"));
}
