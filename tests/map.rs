//! Maps: ranges, parts that give the same bytes however they are cut, kills that lose nothing, exit statuses.

use serde_json::Value;
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// An empty folder of this test's own.
fn room(name: &str) -> PathBuf {
    let it = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("map")
        .join(name);
    let _ = fs::remove_dir_all(&it);
    fs::create_dir_all(&it).unwrap();
    it
}

fn program(room: &Path, arguments: &[&str]) -> Output {
    let mut it = Command::new(env!("CARGO_BIN_EXE_vibroimpact"));
    it.args(arguments).current_dir(room).output().unwrap()
}

/// Runs a command line that must end with a status; what it printed on both streams.
fn run(room: &Path, line: &str, status: i32) -> String {
    let output = program(room, &line.split_whitespace().collect::<Vec<_>>());
    let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{line}\n{said}");
    // The messages are wrapped: words are what matters.
    let said = said.replace("-\n  \u{2502} ", "-").replace('\u{2502}', " ");
    said.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn lines(file: &Path) -> Vec<Value> {
    let text = fs::read_to_string(file).unwrap();
    assert!(text.is_empty() || text.ends_with('\n'));
    let line = |it: &str| serde_json::from_str(it).unwrap();
    text.lines().map(line).collect()
}

/// What `collect` wrote, by name.
fn collected(folder: &Path) -> Vec<(String, Vec<u8>)> {
    ["map.csv", "map.npz", "map.svg", "report.html"]
        .map(|name| (name.to_owned(), fs::read(folder.join(name)).unwrap()))
        .to_vec()
}

const STATIONARY: &str = "title = \"law\"\n[oscillator]\nzeta = 0.005\nh = 1e-3\n";

/// Seven points, the transient of each some tens of milliseconds.
const TRANSIENT: &str = "title = \"way\"\n[oscillator]\nzeta = 0.01\nh = 2e-3\n[initial]\n\
    deviation = [0.3, 0.3]\n[outputs]\nmoments_at = [2, 4]\n[accuracy]\ntolerance = 1e-2\n";

#[test]
fn parts_and_threads_do_not_change_a_byte_of_what_is_collected() {
    let room = room("parts");
    for (name, scene, over) in [
        (
            "law",
            STATIONARY,
            "--over oscillator.h=log:1e-4:1e-2:9 --over oscillator.zeta=[0.01,0.005,0.1]",
        ),
        (
            "way",
            TRANSIENT,
            "--over oscillator.h=lin:1e-3:2e-3:4 --over oscillator.zeta=[0.01,0.02]",
        ),
    ] {
        fs::write(room.join(format!("{name}.toml")), scene).unwrap();
        let mut all = Vec::new();
        for (parts, threads) in [(1, 1), (1, 2), (3, 1), (3, 2), (7, 2)] {
            let out = format!("{name}-{parts}-{threads}");
            for part in 1..=parts {
                let line = format!(
                    "map {name}.toml {over} --part {part}/{parts} --threads {threads} --out {out}"
                );
                run(&room, &line, 0);
            }
            run(&room, &format!("collect {out}"), 0);
            all.push((out.clone(), collected(&room.join(&out))));
        }
        for (out, files) in &all[1..] {
            for (a, b) in all[0].1.iter().zip(files) {
                assert!(a == b, "{} of {out} is not that of {}", a.0, all[0].0);
            }
        }
        println!(
            "{name}: {} files the same in {} divisions",
            all[0].1.len(),
            all.len()
        );
    }
}

#[test]
fn killed_at_random_moments_a_map_loses_nothing_and_computes_nothing_twice() {
    let room = room("killed");
    fs::write(room.join("scene.toml"), TRANSIENT).unwrap();
    let over = "--over oscillator.h=log:1e-3:4e-3:60 --threads 2";
    let whole = format!("map scene.toml {over} --out");
    let file = room.join("out").join("part-1-of-1.jsonl");
    run(&room, &format!("{whole} calm"), 0);
    // Moments of a small generator, the same every time; a machine is never the same, so that they are random.
    let (mut state, mut kills, mut seen) = (7u64, 0, HashMap::new());
    while kills < 5 {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let mut child = Command::new(env!("CARGO_BIN_EXE_vibroimpact"))
            .args(format!("{whole} out").split_whitespace())
            .current_dir(&room)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        // After one to eight more points, and up to 30 ms later, in the middle of others.
        let more = 1 + (state >> 33) % 8;
        let lines = || fs::read_to_string(&file).map_or(0, |it| it.matches('\n').count());
        let enough = lines() + more as usize;
        while lines() < enough && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_millis((state >> 40) % 30));
        // SIGKILL.
        child.kill().unwrap();
        let ended = child.wait().unwrap();
        kills += 1;
        let text = fs::read_to_string(&file).unwrap_or_default();
        // Every line that was ever there whole stays, byte by byte.
        for line in text.split_inclusive('\n').filter(|it| it.ends_with('\n')) {
            let value: Value = serde_json::from_str(line).unwrap();
            let index = value["index"].as_u64().unwrap();
            let before = seen.insert(index, line.to_owned());
            assert!(
                before.is_none_or(|it| it == line),
                "{index} was computed twice"
            );
        }
        if ended.success() {
            break;
        }
    }
    let before = seen.len();
    assert!(before > 0, "{kills} kills before the first point");
    // What a kill in the middle of a write leaves.
    let mut cut_off = fs::read(&file).unwrap();
    cut_off.extend(b"{\"index\":59,\"na");
    fs::write(&file, cut_off).unwrap();
    let said = run(&room, &format!("{whole} out"), 0);
    println!("{kills} kills, {before} points there before the last start: {said}");
    let there = format!("60 points: {before} there before, {} computed", 60 - before);
    assert!(said.contains(&there) && said.contains("cut-off"), "{said}");
    let mut indices: Vec<u64> = lines(&file)
        .iter()
        .map(|it| it["index"].as_u64().unwrap())
        .collect();
    indices.sort_unstable();
    assert_eq!(indices, (0..60).collect::<Vec<u64>>());
    let text = fs::read_to_string(&file).unwrap();
    assert!(seen.values().all(|line| text.contains(line.as_str())));
    // Nothing is left to do, and what was done is what an undisturbed run does.
    let said = run(&room, &format!("{whole} out"), 0);
    assert!(said.contains("60 there before, 0 computed"), "{said}");
    run(&room, "collect out", 0);
    run(&room, "collect calm", 0);
    assert!(collected(&room.join("out")) == collected(&room.join("calm")));
}

#[test]
fn a_point_out_of_range_is_refused_before_anything_runs() {
    let room = room("refused");
    fs::write(room.join("scene.toml"), STATIONARY).unwrap();
    let far = "lin:1e-3:-1e-3:400 --over oscillator.zeta=lin:0.1:0.2:400";
    for (over, words) in [
        (
            "--over oscillator.h=lin:1e-3:-1e-3:5",
            "oscillator.h = 0 is not accepted a finite number > 0",
        ),
        (
            "--over oscillator.h=[1e-3,-2e-3]",
            "oscillator.h = -0.002 is not accepted",
        ),
        (&format!("--over oscillator.h={far}"), "oscillator.h = -"),
        (
            "--over oscillator.hh=[1,2]",
            "oscillator.hh is not a key of a scene",
        ),
        (
            "--over oscillator.contact=[\"hertz\",\"steel\"]",
            "oscillator.contact = \"steel\" bilinear",
        ),
        (
            "--over oscillator.h=log:0:1:3",
            "--over oscillator.h = log:0:1:3 is not accepted above 0",
        ),
        (
            "--over oscillator.h=lin:0:1:1",
            "lin:0:1:1 is not accepted from 2 to",
        ),
        (
            "--over oscillator.h=1e-3",
            "--over oscillator.h = 1e-3 is not accepted KEY=log:a:b:n",
        ),
        (
            "--over oscillator.h",
            "--over = oscillator.h is not accepted",
        ),
        (
            "--over oscillator.h=[1e-3] --over oscillator.h=[1e-4]",
            "each key once",
        ),
        (
            "--over outputs.time_unit=[\"period\",\"dimensionless\"]",
            "share one unit of time",
        ),
        (
            "--over oscillator.h=[1e-3] --part 4/3",
            "--part = 4/3 is not accepted 1 <= K <= N",
        ),
        (
            "--over oscillator.h=[1e-3] --part x",
            "--part = x is not accepted",
        ),
        (
            "--over oscillator.h=[1e-3] --keep spectre",
            "--keep = spectre spectrum.fokker_planck",
        ),
        (
            "--over oscillator.h=[1e-3] --keep spectrum",
            "--keep = spectrum is not accepted asks for under [outputs]",
        ),
        (
            "--over oscillator.h=lin:1:2:100000 --over oscillator.zeta=lin:1:2:100000 --over a.b=lin:1:2:1000",
            "at most 1e12 points",
        ),
        ("", "--over"),
    ] {
        let said = run(&room, &format!("map scene.toml {over} --out out"), 2);
        // The words stand in it in this order.
        let mut rest = said.as_str();
        for word in words.split(' ') {
            let at = rest.find(word);
            assert!(at.is_some(), "{over}: {word} is not in: {said}");
            rest = &rest[at.unwrap() + word.len()..];
        }
        assert!(!room.join("out").exists(), "{over}");
    }
}

#[test]
fn a_point_that_fails_is_a_line_and_not_the_end_of_the_map() {
    let room = room("failing");
    // No mesh of so few cells holds an initial condition so narrow; the wide one is well.
    let scene = "[oscillator]\nzeta = 0.01\nh = 2e-3\n[outputs]\nstationary = true\nmoments_at = [1]\n\
        [initial]\ndeviation = [0.3, 0.3]\n[accuracy]\nmax_memory = 8_000_000\n";
    fs::write(room.join("scene.toml"), scene).unwrap();
    let line = "map scene.toml --over accuracy.max_memory=[1000,8000000000] --out out";
    let said = run(&room, line, 3);
    assert!(said.contains("1 point failed"), "{said}");
    let all = lines(&room.join("out/part-1-of-1.jsonl"));
    assert_eq!(all.len(), 2);
    let failed = all.iter().find(|it| it["index"] == 0).unwrap();
    println!("{}", failed["error"]);
    assert_eq!(failed["error"]["key"], "accuracy.max_memory");
    assert!(
        failed["error"]["message"]
            .as_str()
            .unwrap()
            .contains("would need")
    );
    assert!(failed.get("results").is_none());
    let well = all.iter().find(|it| it["index"] == 1).unwrap();
    assert!(well["results"]["transient"]["mean_q"]["value"][0].is_f64());
    // Done is done; --retry tries the failed one alone.
    let again = run(&room, line, 3);
    assert!(again.contains("2 there before, 0 computed"), "{again}");
    let retried = run(&room, &format!("{line} --retry"), 3);
    assert!(retried.contains("1 there before, 1 computed"), "{retried}");
    let said = run(&room, "collect out", 3);
    assert!(
        said.contains("1 point failed") && said.contains("max_memory"),
        "{said}"
    );
    let table = fs::read_to_string(room.join("out/map.csv")).unwrap();
    assert!(table.lines().nth(1).unwrap().contains("would need"));
    assert!(table.lines().nth(2).unwrap().ends_with(",done"));
}

#[test]
fn what_is_missing_is_listed_and_what_differs_is_shown() {
    let room = room("missing");
    fs::write(room.join("scene.toml"), STATIONARY).unwrap();
    let map = "map scene.toml --over oscillator.h=log:1e-4:1e-2:12 --out out";
    run(&room, &format!("{map} --part 1/3"), 0);
    run(&room, &format!("{map} --part 3/3"), 0);
    let said = run(&room, "collect out", 3);
    assert!(
        said.contains("4 points missing") && said.contains("--part 2/3"),
        "{said}"
    );
    let missing = fs::read_to_string(room.join("out/missing.csv")).unwrap();
    assert_eq!(missing.lines().count(), 5, "{missing}");
    assert_eq!(
        fs::read_to_string(room.join("out/map.csv"))
            .unwrap()
            .lines()
            .count(),
        9
    );
    // Quiet says so too: it is an error.
    assert!(run(&room, "collect out --quiet", 3).contains("missing"));
    // The whole map overlaps its parts, and they agree.
    run(&room, map, 0);
    run(&room, "collect out --quiet", 0);
    assert!(!room.join("out/missing.csv").exists());
    // One digit of one number is changed.
    let file = room.join("out/part-1-of-3.jsonl");
    let text = fs::read_to_string(&file).unwrap();
    let (head, tail) = text.split_once("\"var_q\":{\"value\":").unwrap();
    let digit = if tail.starts_with("0.1") {
        "0.2"
    } else {
        "0.1"
    };
    fs::write(
        &file,
        format!("{head}\"var_q\":{{\"value\":{digit}{}", &tail[3..]),
    )
    .unwrap();
    let said = run(&room, "collect out", 1);
    println!("{said}");
    for word in [
        "part-1-of-3.jsonl",
        "part-1-of-1.jsonl",
        "stationary.var_q is",
        "oscillator.h =",
    ] {
        assert!(said.contains(word), "{word}: {said}");
    }
    let said = run(&room, "collect .", 2);
    assert!(said.contains("map.json"), "{said}");
    // A part of the same points of another scene.
    let other = "map scene.toml --over oscillator.h=log:1e-4:1e-2:12 --out other";
    run(
        &room,
        &format!("{other} --set oscillator.contact=bilinear --part 2/3"),
        0,
    );
    fs::copy(
        room.join("other/part-2-of-3.jsonl"),
        file.with_file_name("part-2-of-3.jsonl"),
    )
    .unwrap();
    fs::remove_file(room.join("out/part-1-of-1.jsonl")).unwrap();
    let said = run(&room, "collect out", 2);
    assert!(
        said.contains("part-2-of-3.jsonl") && said.contains("another scene"),
        "{said}"
    );
}

#[test]
fn a_folder_belongs_to_one_map() {
    let room = room("folder");
    fs::write(room.join("scene.toml"), STATIONARY).unwrap();
    run(
        &room,
        "map scene.toml --over oscillator.h=[1e-3,2e-3] --out out",
        0,
    );
    for (line, words) in [
        (
            "map scene.toml --over oscillator.h=[1e-3,3e-3] --out out",
            "another over",
        ),
        (
            "map scene.toml --over oscillator.h=[1e-3,2e-3] --set oscillator.zeta=0.1 --out out",
            "another scene",
        ),
        (
            "map scene.toml --over oscillator.h=[1e-3,2e-3] --out .",
            "a new folder",
        ),
        (
            "map scene.toml --over oscillator.h=[1e-3] --out scene.toml",
            "scene.toml",
        ),
    ] {
        let said = run(&room, line, 2);
        assert!(said.contains(words), "{line}: {said}");
    }
    // Limits and a title make no other scene.
    let wider = "--set accuracy.max_seconds=7 --set title=longer";
    let said = run(
        &room,
        &format!("map scene.toml --over oscillator.h=[1e-3,2e-3] {wider} --out out"),
        0,
    );
    assert!(said.contains("2 there before, 0 computed"), "{said}");
    fs::write(room.join("other.toml"), STATIONARY.replace("law", "other")).unwrap();
    run(
        &room,
        "map other.toml --over oscillator.h=[1e-3,2e-3] --out other",
        0,
    );
    let name = |folder: &str| -> Vec<Value> {
        let mut all = lines(&room.join(folder).join("part-1-of-1.jsonl"));
        all.sort_by_key(|it| it["index"].as_u64());
        all.iter().map(|it| it["name"].clone()).collect()
    };
    assert_eq!(name("out"), name("other"));
    assert_ne!(name("out")[0], name("out")[1]);
}

#[test]
fn a_line_holds_the_numbers_of_a_run_and_curves_that_are_asked_for() {
    let room = room("numbers");
    let scene = "[oscillator]\nzeta = 0.05\nh = 1e-2\n[outputs]\nstationary = true\ndecay_rates = 2\n\
        spectrum = { until = 2.0 }\nfirst_loss = { until = 20 }\n[accuracy]\ntolerance = 1e-2\n";
    fs::write(room.join("scene.toml"), scene).unwrap();
    let map = "map scene.toml --over oscillator.h=[1e-2]";
    run(&room, &format!("{map} --out a"), 0);
    run(
        &room,
        &format!("{map} --keep spectrum.linear --keep first_loss --out b"),
        0,
    );
    run(&room, "run scene.toml --out c", 0);
    let results = fs::read_to_string(room.join("c/results.json")).unwrap();
    let results: Value = serde_json::from_str(&results).unwrap();
    let a = &lines(&room.join("a/part-1-of-1.jsonl"))[0]["results"];
    let b = &lines(&room.join("b/part-1-of-1.jsonl"))[0]["results"];
    for path in [
        "/stationary",
        "/decay_rates",
        "/spectrum/peaks",
        "/first_loss/rate",
        "/oscillator",
    ] {
        assert_eq!(a.pointer(path), results.pointer(path), "{path}");
        assert!(a.pointer(path).is_some());
    }
    for path in [
        "/spectrum/omega",
        "/spectrum/linear",
        "/first_loss/survival",
        "/run",
        "/scene",
    ] {
        assert!(a.pointer(path).is_none(), "{path}");
    }
    // No list that the program chose the length of: eigenvalues and peaks are few.
    assert!(longest(a) < 20, "{a}");
    for path in [
        "/spectrum/omega",
        "/spectrum/linear",
        "/first_loss/survival",
        "/first_loss/t",
    ] {
        assert_eq!(b.pointer(path), results.pointer(path), "{path}");
    }
    assert!(b.pointer("/spectrum/fokker_planck").is_none());
    run(&room, "collect b", 0);
    let header = fs::read_to_string(room.join("b/map.csv")).unwrap();
    let header = header.lines().next().unwrap();
    assert!(
        header.contains("spectrum.peaks.half_power_width[0] [Omega]"),
        "{header}"
    );
    assert!(!header.contains("survival"));
}

/// The longest list in a tree.
fn longest(it: &Value) -> usize {
    match it {
        Value::Array(all) => all.iter().map(longest).fold(all.len(), usize::max),
        Value::Object(all) => all.values().map(longest).max().unwrap_or(0),
        _ => 0,
    }
}

#[test]
fn what_is_drawn_may_be_chosen() {
    let room = room("drawn");
    fs::write(room.join("scene.toml"), TRANSIENT).unwrap();
    let map = "map scene.toml --over oscillator.h=[1e-3,2e-3] --over oscillator.contact=[\"hertz\",\"linear\"] \
        --out out";
    run(&room, map, 0);
    let picture = |draw: &str, status: i32| {
        let said = run(&room, &format!("collect out {draw}"), status);
        let svg = fs::read_to_string(room.join("out/map.svg")).unwrap();
        (said, svg)
    };
    // Two axes and two times: small multiples over time.
    let (_, svg) = picture("--draw transient.var_q=0.1", 0);
    for word in ["Var q [(z_s/q_s)^2]", "t = 2", "t = 4", "hertz", "0.1"] {
        assert!(svg.contains(word), "{word}");
    }
    let (_, svg) = picture(
        "--draw transient.var_q[1] --draw transient.mean_energy[0]",
        0,
    );
    assert!(svg.contains("Var q at t = 4 [(z_s/q_s)^2]") && svg.contains("E[H] at t = 2"));
    // A law that cannot lose contact has no probability: its points stay empty.
    let (_, svg) = picture("--draw transient.contact_loss_probability", 0);
    assert!(svg.contains(">\nnone\n<"), "no key to holes");
    for wrong in [
        "--draw var_q",
        "--draw transient.var_q[2]",
        "--draw transient.var_q=x",
        "--draw =1",
    ] {
        assert!(picture(wrong, 2).0.contains("--draw"), "{wrong}");
    }
}

#[test]
fn a_thousand_closed_forms_take_no_time_to_speak_of() {
    let room = room("speed");
    fs::write(room.join("scene.toml"), STATIONARY).unwrap();
    let start = Instant::now();
    run(
        &room,
        "map scene.toml --over oscillator.h=log:1e-4:1e-2:40 --over oscillator.zeta=log:1e-3:0.1:25 --out out",
        0,
    );
    let took = start.elapsed();
    println!("1000 closed forms in {took:?}");
    // 0.2 s on a machine with nothing else to do.
    assert!(took < Duration::from_secs(20));
}
