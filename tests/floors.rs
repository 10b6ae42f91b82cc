//! The house rules that a compiler does not keep: who may import whom, and which crate has which door.

use std::fs;
use std::path::{Path, PathBuf};

/// Every source file with its path below src, without test modules (in the file or in *_tests.rs).
fn sources() -> Vec<(String, String)> {
    fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                collect(&path, files);
            } else if path.extension().is_some_and(|it| it == "rs")
                && !path.to_string_lossy().ends_with("_tests.rs")
            {
                files.push(path);
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    collect(&root, &mut files);
    files.sort();
    let named = |path: PathBuf| {
        let name = path
            .strip_prefix(&root)
            .unwrap()
            .to_string_lossy()
            .replace('\\', "/");
        let text = fs::read_to_string(&path).unwrap();
        // A test module ends its file.
        let code = text.split("#[cfg(test)]\nmod ").next().unwrap().to_owned();
        (name, code)
    };
    files.into_iter().map(named).collect()
}

/// The top-level module a file belongs to.
fn module(file: &str) -> &str {
    let first = file.split('/').next().unwrap();
    first.strip_suffix(".rs").unwrap_or(first)
}

/// The floor of a module; lib.rs only lists modules, main.rs stands on top.
fn floor(module: &str) -> usize {
    match module {
        "conventions" | "estimate" | "quadrature" | "sparse" | "error" | "json" => 0,
        "contact" | "oscillator" | "rig" | "initial" | "moments" | "gaussian" | "scales" => 1,
        "stationary" | "fokker_planck" | "monte_carlo" | "spectrum" => 2,
        "scene" | "plan" | "results" => 3,
        "report" => 4,
        "validation" | "precision" | "stability" => 5,
        "main" => 6,
        other => panic!("{other} has no floor: give it one here and in the architecture"),
    }
}

/// Lines of code without comments, doc examples included among the comments.
fn code_lines(text: &str) -> impl Iterator<Item = &str> {
    text.lines()
        .map(str::trim)
        .filter(|line| !line.starts_with("//"))
}

/// Names of top-level modules a file takes anything from.
fn imports(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for line in code_lines(text) {
        for start in ["crate::", "vibroimpact::"] {
            for (at, _) in line.match_indices(start) {
                let rest = &line[at + start.len()..];
                let name: String = rest
                    .chars()
                    .take_while(|c| c.is_ascii_lowercase() || *c == '_')
                    .collect();
                if let Some(list) = rest.strip_prefix('{') {
                    let names = list.trim_end_matches(['}', ';', ' ']).split(',');
                    let first = |it: &str| it.trim().split("::").next().unwrap().to_owned();
                    let modules = names.map(first).filter(|it| !it.is_empty());
                    found.extend(modules.filter(|it| it.chars().all(|c| !c.is_uppercase())));
                } else if !name.is_empty() {
                    found.push(name);
                }
            }
        }
    }
    found
}

#[test]
fn a_file_imports_only_from_lower_floors_or_its_own_folder() {
    let mut checked = 0;
    for (file, text) in sources() {
        let own = module(&file);
        if own == "lib" {
            continue;
        }
        for name in imports(&text) {
            let higher = floor(&name) > floor(own);
            // Floor 3 reads downwards too: plan knows results and scene, results knows scene.
            let order = ["scene", "results", "plan"];
            let place = |name: &str| order.iter().position(|it| *it == name);
            let sideways = match (place(&name), place(own)) {
                (Some(theirs), Some(ours)) => theirs > ours,
                _ => floor(own) == 2 && floor(&name) == 2 && name != own,
            };
            assert!(!higher && !sideways, "src/{file} imports {name}");
            checked += 1;
        }
    }
    println!("{checked} imports checked");
    assert!(checked > 50);
}

#[test]
fn a_crate_that_would_spread_has_one_door() {
    for (door, names) in [
        ("sparse.rs", &["faer"][..]),
        ("monte_carlo/signal.rs or spectrum.rs", &["rustfft"]),
        ("report/plot/canvas.rs", &["plotters"]),
        ("report/data.rs", &["ndarray_npy"]),
        ("scene/text.rs", &["strsim"]),
        (
            "scene/text.rs or stability/extreme.rs or stability/yardstick.rs",
            &["toml"],
        ),
        ("main.rs", &["clap", "indicatif"]),
    ] {
        for (file, text) in sources()
            .iter()
            .filter(|(file, _)| !door.split(" or ").any(|door| file == door))
        {
            for line in code_lines(text) {
                for name in names {
                    let used = line.contains(&format!("{name}::"))
                        && !line.contains(&format!("_{name}::"));
                    assert!(!used, "src/{file} uses {name}: {line}");
                }
            }
        }
    }
}

#[test]
fn the_library_neither_prints_nor_exits() {
    let words = [
        "println!",
        "eprintln!",
        "print!",
        "eprint!",
        "dbg!",
        "process::exit",
        "stdout()",
        "stderr()",
    ];
    for (file, text) in sources().iter().filter(|(file, _)| file != "main.rs") {
        for line in code_lines(text) {
            for word in words {
                // writeln! and print! are told apart by the letter before.
                let found = line.match_indices(word).any(|(at, _)| {
                    !line[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_')
                });
                assert!(!found, "src/{file}: {line}");
            }
        }
    }
}

#[test]
fn no_source_file_unwraps_outside_its_tests() {
    for (file, text) in sources() {
        for line in code_lines(&text) {
            for word in [".unwrap()", ".expect(\"", "panic!("] {
                assert!(!line.contains(word), "src/{file}: {line}");
            }
        }
    }
}
