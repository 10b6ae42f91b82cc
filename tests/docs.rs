//! README.md and docs/ are true where a machine can tell: links, scenes, commands, length, and the field's own words.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use vibroimpact::map::{Axis, Map};
use vibroimpact::plan::Plan;
use vibroimpact::scene::text::SceneText;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every page for readers, by its path from the root.
fn pages() -> Vec<(PathBuf, String)> {
    let mut names: Vec<PathBuf> = [
        "README.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        "python/README.md",
    ]
    .map(PathBuf::from)
    .to_vec();
    for entry in fs::read_dir(root().join("docs")).unwrap() {
        let name = Path::new("docs").join(entry.unwrap().file_name());
        // Pictures and scenes lie beside.
        if name.extension().is_some_and(|it| it == "md") {
            names.push(name);
        }
    }
    names.sort();
    let read = |name: PathBuf| {
        let text = fs::read_to_string(root().join(&name)).unwrap();
        (name, text)
    };
    names.into_iter().map(read).collect()
}

/// The fenced blocks of a page in a language, and what is left of the page without any fenced block.
fn blocks(page: &str, language: &str) -> (Vec<String>, String) {
    let (mut found, mut prose) = (Vec::new(), String::new());
    for (k, part) in page.split("```").enumerate() {
        match part.split_once('\n') {
            Some((first, block)) if k % 2 == 1 => {
                if first == language {
                    found.push(block.to_owned());
                }
            }
            _ => prose += part,
        }
    }
    (found, prose)
}

/// What stands in backticks in prose, and the prose without it.
fn spans(prose: &str) -> (Vec<String>, String) {
    let (mut code, mut words) = (Vec::new(), String::new());
    for (k, part) in prose.split('`').enumerate() {
        if k % 2 == 1 {
            code.push(part.to_owned());
        } else {
            words += part;
        }
    }
    (code, words)
}

#[test]
fn the_readme_is_a_screen_and_a_half() {
    let lines = fs::read_to_string(root().join("README.md")).unwrap();
    let lines = lines.lines().count();
    println!("README.md: {lines} lines");
    assert!(lines <= 180, "{lines}");
}

#[test]
fn every_link_to_a_file_leads_there() {
    let mut checked = 0;
    for (name, page) in pages() {
        let (_, prose) = blocks(&page, "");
        for part in prose.split("](").skip(1) {
            let target = part.split(')').next().unwrap();
            if target.contains("://") {
                continue;
            }
            let file = target.split('#').next().unwrap();
            let folder = root().join(&name);
            let folder = folder.parent().unwrap();
            let there = folder.join(file).exists();
            assert!(there, "{}: {target}", name.display());
            checked += 1;
        }
    }
    println!("{checked} links");
    assert!(checked > 10);
}

#[test]
fn every_scene_printed_has_a_plan() {
    let mut planned = 0;
    for (name, page) in pages() {
        for scene in blocks(&page, "toml").0 {
            let name = name.display().to_string();
            let text =
                SceneText::parse(&name, &scene, &[]).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert!(!Plan::of(text.scene()).unwrap().stages().is_empty());
            planned += 1;
        }
    }
    assert!(planned > 1);
}

/// Words of a command up to a redirection or a comment, out of their quotes.
fn words(line: &str) -> Vec<&str> {
    let line = line.split([';', '#', '>']).next().unwrap();
    let words = line.split_whitespace();
    words.map(|it| it.trim_matches('\'')).collect()
}

#[test]
fn every_command_printed_is_accepted() {
    let room = Path::new(env!("CARGO_TARGET_TMPDIR")).join("docs");
    let _ = fs::remove_dir_all(&room);
    fs::create_dir_all(&room).unwrap();
    let program = |arguments: &[&str]| {
        let mut it = Command::new(env!("CARGO_BIN_EXE_vibroimpact"));
        it.args(arguments).current_dir(&room).output().unwrap()
    };
    let mut tried = 0;
    for (name, page) in pages() {
        let (shell, prose) = blocks(&page, "sh");
        let lines = shell.iter().flat_map(|it| it.lines().map(str::to_owned));
        for line in lines.chain(spans(&prose).0) {
            let Some(command) = line.strip_prefix("vibroimpact ") else {
                continue;
            };
            let mut arguments = words(command);
            // `SCENE.toml` and `DIR` make the form of a command, not a command.
            if arguments.concat().contains(char::is_uppercase) {
                continue;
            }
            // A map of the gallery takes minutes: its scene and its axes are read.
            if arguments[0] == "map" && arguments[1].starts_with("docs/") {
                let scene = fs::read_to_string(root().join(arguments[1])).unwrap();
                let over = arguments.windows(2).filter(|it| it[0] == "--over");
                let axes = over.map(|it| Axis::parse(it[1]).unwrap()).collect();
                let map = Map::of(arguments[1], &scene, &[], axes, Vec::new()).unwrap();
                assert!(map.len() > 50, "{line}");
                continue;
            }
            if arguments[0] == "collect" && !room.join(arguments[1]).exists() {
                continue;
            }
            // A plan reads the same scene and overrides, and computes nothing.
            if arguments[0] == "run" {
                arguments[0] = "plan";
                if let Some(at) = arguments.iter().position(|it| *it == "--out") {
                    arguments.drain(at..at + 2);
                }
            }
            let output = program(&arguments);
            let said = String::from_utf8_lossy(&output.stderr);
            let name = name.display();
            assert!(output.status.success(), "{name}: {line}\n{said}");
            if let Some((_, file)) = command.split_once("> ") {
                let file = words(file)[0];
                fs::write(room.join(file), &output.stdout).unwrap();
            }
            tried += 1;
        }
    }
    println!("{tried} commands");
    assert!(tried > 5);
}

#[test]
fn every_script_printed_is_the_one_that_is_tested() {
    let page = fs::read_to_string(root().join("docs/scale.md")).unwrap();
    let folder = root().join("tests/engines");
    for (language, name) in [
        ("bash", "map.sbatch"),
        ("python", "submitit_map.py"),
        ("python", "hyperqueue_map.py"),
    ] {
        let script = fs::read_to_string(folder.join(name)).unwrap();
        assert!(blocks(&page, language).0.contains(&script), "{name}");
    }
    let run = fs::read_to_string(folder.join("run.sh")).unwrap();
    for name in ["map.sbatch", "submitit_map.py", "hyperqueue_map.py"] {
        assert!(run.contains(name), "{name} is not run");
    }
}

#[test]
fn every_test_and_bench_named_is_there() {
    let mut named = 0;
    for (name, page) in pages() {
        let words: Vec<&str> = page.split_whitespace().collect();
        for pair in words.windows(2) {
            let target = pair[1].split('`').next().unwrap();
            let file = match pair[0] {
                "--test" => format!("tests/{target}.rs"),
                "--bench" => format!("benches/{target}.rs"),
                "--bin" if target == "vibroimpact" => "src/main.rs".into(),
                "--bin" => format!("src/bin/{target}/main.rs"),
                _ => continue,
            };
            assert!(root().join(&file).exists(), "{}: {file}", name.display());
            named += 1;
        }
    }
    println!("{named} targets");
    assert!(named > 5);
}

/// Words that only this project would use, where the field has its own: `docs/conventions.md` has those.
const PRIVATE: &[&str] = &[
    "bar",
    "bars",
    "truth",
    "truths",
    "way",
    "ways",
    "box",
    "boxes",
    "start",
    "starts",
    "packet",
    "packets",
    "torn",
    "bent",
    "opening",
    "first loss",
    "losses per time",
    "decay rate",
    "decay rates",
    "march",
    "marches",
    "strained",
    "rim",
    "shape",
    "shapes",
    "natural scale",
    "natural scales",
    "record",
    "records",
    "desk",
    "kin",
    "door",
    "doors",
    "floor",
    "floors",
];

#[test]
fn pages_speak_the_language_of_the_field() {
    for (name, page) in pages() {
        // Of the changes only those not yet released: history keeps its words.
        let latest = page.split("\n## ").take(2).collect::<Vec<_>>().join("\n");
        let page = if name.ends_with("CHANGELOG.md") {
            latest
        } else {
            page
        };
        let (_, prose) = spans(&blocks(&page, "").1);
        let plain = plain(&prose.to_lowercase()).replace(" box muller", "");
        for word in PRIVATE {
            let found = plain.contains(&format!(" {word} "));
            assert!(!found, "{}: {word}", name.display());
        }
    }
}

/// Those of them, and more, that mean nothing else in code either.
const PRIVATE_IN_CODE: &[&str] = &[
    "packet",
    "packets",
    "torn",
    "bent",
    "march",
    "marches",
    "marched",
    "truth",
    "truths",
    "strained",
    "rim",
    "kin",
    "desk",
    "door",
    "doors",
    "natural scale",
    "natural scales",
    "narrow start",
    "narrow starts",
    "losses per time",
    "hopeless",
    "unthinkable",
];

/// The words of a text one blank apart, blanks around, identifiers split at `_` and at capitals; in lower case.
fn plain(text: &str) -> String {
    let (mut plain, mut before) = (String::from(" "), ' ');
    for c in text.chars() {
        let ends = !c.is_alphabetic() || before.is_lowercase() && c.is_uppercase();
        if ends && !plain.ends_with(' ') {
            plain.push(' ');
        }
        if c.is_alphabetic() {
            plain.extend(c.to_lowercase());
        }
        before = c;
    }
    plain + " "
}

/// Every source of Rust and Python below a folder, by its path from the root.
fn code(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(root().join(folder)).unwrap() {
        let entry = entry.unwrap();
        let name = folder.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            code(&name, found);
        } else if name.extension().is_some_and(|it| it == "rs" || it == "py") {
            found.push(name);
        }
    }
}

#[test]
fn code_speaks_the_language_of_the_field() {
    let mut files = Vec::new();
    for folder in ["src", "tests", "benches", "examples", "python"] {
        code(Path::new(folder), &mut files);
    }
    // This file lists the words.
    files.retain(|name| !name.ends_with(Path::new("tests/docs.rs")));
    assert!(files.len() > 250, "{}", files.len());
    for name in files {
        let text = fs::read_to_string(root().join(&name)).unwrap();
        let plain = plain(&format!("{} {text}", name.display()));
        for word in PRIVATE_IN_CODE {
            let found = plain.contains(&format!(" {word} "));
            assert!(!found, "{}: {word}", name.display());
        }
    }
}
