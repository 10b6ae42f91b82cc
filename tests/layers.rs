//! The house rules that a compiler does not keep: who may import whom, and which module alone uses which crate.

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
        let text = text.replace("#[cfg(test)]\npub(crate) mod ", "#[cfg(test)]\nmod ");
        let code = text.split("#[cfg(test)]\nmod ").next().unwrap().to_owned();
        (name, code)
    };
    files.into_iter().map(named).collect()
}

/// The top-level module a file belongs to; of the laboratory, its folder.
fn module(file: &str) -> &str {
    let first = file.split('/').next().unwrap();
    first.strip_suffix(".rs").unwrap_or(first)
}

/// The layer of a module; lib.rs only lists modules, the two programs stand on top.
fn layer(module: &str) -> usize {
    match module {
        "budget" | "conventions" | "estimate" | "quadrature" | "sparse" | "error" | "format"
        | "matrix" | "roots" => 0,
        "clock" | "contact" | "damping" | "oscillator" | "rig" | "initial" | "moments"
        | "gaussian" | "scales" | "excitation" | "noise_free" | "inrush" | "first_step" => 1,
        "stationary" | "fokker_planck" | "monte_carlo" | "spectrum" => 2,
        "scene" | "plan" | "results" => 3,
        "report" => 4,
        "map" => 5,
        "cli" => 6,
        "main" | "bin" => 7,
        other => panic!("{other} has no layer: give it one here and in the architecture"),
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
fn a_file_imports_only_from_lower_layers_or_its_own_folder() {
    let mut checked = 0;
    for (file, text) in sources() {
        let own = module(&file);
        if own == "lib" {
            continue;
        }
        // The laboratory's crate is its own, and no file of the library reaches into it.
        let text = match own {
            "bin" => text.replace("crate::", "self::"),
            _ => text,
        };
        let reaches = |line: &str| line.contains("#[path") && line.contains("bin/");
        assert!(own == "bin" || !text.lines().any(reaches), "src/{file}");
        for name in imports(&text) {
            let higher = layer(&name) > layer(own);
            // Layer 3 reads downwards too: plan knows results and scene, results knows scene.
            let order = ["scene", "results", "plan"];
            let place = |name: &str| order.iter().position(|it| *it == name);
            let sideways = match (place(&name), place(own)) {
                (Some(theirs), Some(ours)) => theirs > ours,
                _ => layer(own) == 2 && layer(&name) == 2 && name != own,
            };
            assert!(!higher && !sideways, "src/{file} imports {name}");
            checked += 1;
        }
    }
    println!("{checked} imports checked");
    assert!(checked > 50);
}

#[test]
fn a_crate_that_would_spread_is_used_by_one_module() {
    for (users, names) in [
        ("sparse.rs", &["faer"][..]),
        ("monte_carlo/signal.rs or spectrum.rs", &["rustfft"]),
        (
            "report/plot/canvas.rs or report/plot/legend.rs or report/plot/panel.rs or bin/lab/plot/charts.rs or bin/lab/plot/marks.rs",
            &["plotters"],
        ),
        ("report/npz.rs", &["ndarray_npy"]),
        ("scene/text/section.rs", &["strsim"]),
        (
            "scene/text/document.rs or bin/lab/stability/extreme.rs or bin/lab/stability/against.rs or bin/lab/precision/references.rs",
            &["toml"],
        ),
        ("cli.rs or cli/arguments.rs or bin/lab/main.rs", &["clap"]),
        ("cli/progress.rs or bin/lab/main.rs", &["indicatif"]),
    ] {
        for (file, text) in sources()
            .iter()
            .filter(|(file, _)| !users.split(" or ").any(|it| file == it))
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
fn the_library_prints_in_its_command_line_alone_and_never_exits() {
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
    for (file, text) in sources() {
        for line in code_lines(&text) {
            let prints = module(&file) == "cli";
            for word in words.iter().filter(|it| !prints || it.ends_with("exit")) {
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

#[test]
fn every_file_of_tests_is_run() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |name: &str| fs::read_to_string(root.join(name)).unwrap();
    let (all, manifest) = (read("tests/all.rs"), read("Cargo.toml"));
    let mut run = 0;
    for entry in fs::read_dir(root.join("tests")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|it| it != "rs") {
            continue;
        }
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let alone = manifest.contains(&format!("[[test]]\nname = \"{name}\""));
        let listed = all.contains(&format!("\nmod {name};"));
        assert!(
            alone != listed,
            "tests/{name}.rs: a module of tests/all.rs or a test of Cargo.toml"
        );
        run += 1;
    }
    assert!(run > 20);
}

/// The modules of the tree by their path, each with its file and its code.
struct Tree {
    files: Vec<(Vec<String>, String, String)>,
}

/// Where a path of a `use` leads.
fn segments(path: &str) -> Vec<String> {
    path.split("::").map(|it| it.trim().to_owned()).collect()
}

impl Tree {
    fn read() -> Self {
        let module = |file: &str| -> Vec<String> {
            let path = file.strip_suffix(".rs").unwrap();
            let path = path.strip_suffix("/mod").unwrap_or(path);
            let path = path.strip_suffix("/main").unwrap_or(path);
            path.split('/').map(str::to_owned).collect()
        };
        let files = sources().into_iter();
        let files = files.filter(|(file, _)| file != "lib.rs" && file != "main.rs");
        Self {
            files: files
                .map(|(file, text)| {
                    let code = code_lines(&text).collect::<Vec<_>>().join("\n");
                    (module(&file), file, code)
                })
                .collect(),
        }
    }

    fn find(&self, module: &[String]) -> Option<usize> {
        self.files.iter().position(|(path, ..)| path == module)
    }

    /// Whether a file only declares and re-exports its children.
    fn is_list(&self, file: usize) -> bool {
        let lines = self.files[file].2.lines();
        let code: Vec<&str> = lines.filter(|it| !it.starts_with('#')).collect();
        let code = code.join("\n");
        let statements = code.split(';').map(str::trim);
        let mut statements = statements.filter(|it| !it.is_empty());
        statements.all(|it| {
            let words = it
                .trim_start_matches("pub(crate) ")
                .trim_start_matches("pub(super) ");
            let words = words.trim_start_matches("pub ");
            words.starts_with("mod ") || words.starts_with("use ")
        })
    }

    /// The file that defines what a path from the root names, if it is one of the tree's.
    fn resolve(&self, path: &[String]) -> Option<usize> {
        let module = (1..=path.len())
            .rev()
            .find_map(|n| Some((self.find(&path[..n])?, n)));
        let (file, n) = module?;
        let Some(name) = path.get(n) else {
            return Some(file);
        };
        let named = uses(&self.files[file].2);
        let Some(exported) = named.into_iter().find(|it| it.last() == Some(name)) else {
            return Some(file);
        };
        self.absolute(&path[..n], &exported)
            .and_then(|it| self.resolve(&it))
            .or(Some(file))
    }

    /// A path as it stands in a module, from the root.
    fn absolute(&self, module: &[String], path: &[String]) -> Option<Vec<String>> {
        let mut from = module.to_vec();
        let mut rest = path;
        match rest.first()?.as_str() {
            "crate" if module.starts_with(&segments("bin::lab")) => {
                from.truncate(2);
                rest = &rest[1..];
            }
            "crate" | "vibroimpact" => {
                from.clear();
                rest = &rest[1..];
            }
            "self" => rest = &rest[1..],
            "super" => {
                while rest.first().is_some_and(|it| it == "super") {
                    from.pop();
                    rest = &rest[1..];
                }
            }
            child => {
                let mut whole = from.clone();
                whole.push(child.to_owned());
                self.find(&whole)?;
            }
        }
        from.extend_from_slice(rest);
        Some(from)
    }

    /// The files that a file takes anything from.
    fn imports(&self, file: usize) -> Vec<usize> {
        let (module, _, code) = &self.files[file];
        let mut paths = uses(code);
        paths.extend(written_out(code));
        let found = paths
            .iter()
            .filter_map(|it| self.resolve(&self.absolute(module, it)?));
        let mut found: Vec<usize> = found
            .filter(|it| *it != file && !self.is_list(*it))
            .collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// A circle of files, each of which imports the next.
    fn circle(&self) -> Option<Vec<&str>> {
        let graph: Vec<Vec<usize>> = (0..self.files.len()).map(|it| self.imports(it)).collect();
        // The shortest path from every file back to itself.
        let back = |start: usize| {
            let mut paths = vec![vec![start]];
            let mut seen = vec![false; graph.len()];
            while !paths.is_empty() {
                let mut next = Vec::new();
                for path in &paths {
                    for to in &graph[path[path.len() - 1]] {
                        if *to == start {
                            return Some(path.clone());
                        }
                        if !std::mem::replace(&mut seen[*to], true) {
                            next.push([&path[..], &[*to]].concat());
                        }
                    }
                }
                paths = next;
            }
            None
        };
        let circle = (0..graph.len()).filter_map(back).min_by_key(Vec::len)?;
        Some(
            circle
                .into_iter()
                .map(|it| self.files[it].1.as_str())
                .collect(),
        )
    }
}

/// The paths of the `use` statements of a file.
fn uses(code: &str) -> Vec<Vec<String>> {
    fn spread(before: &str, tree: &str, found: &mut Vec<String>) {
        let Some((head, list)) = tree.split_once('{') else {
            let name = tree.split(" as ").next().unwrap().trim();
            let path = format!("{before}{name}");
            found.push(path.trim_end_matches("::self").to_owned());
            return;
        };
        let list = list.trim().strip_suffix('}').unwrap();
        let (mut depth, mut start) = (0, 0);
        for (at, c) in list.char_indices().chain([(list.len(), ',')]) {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    if !list[start..at].trim().is_empty() {
                        spread(
                            &format!("{before}{}", head.trim()),
                            list[start..at].trim(),
                            found,
                        );
                    }
                    start = at + 1;
                }
                _ => (),
            }
        }
    }
    let mut all = Vec::new();
    for (at, _) in code.match_indices("use ") {
        let before = code[..at].rsplit('\n').next().unwrap();
        if before.is_empty() || before.starts_with("pub") {
            let tree = code[at + 4..].split(';').next().unwrap();
            let mut found = Vec::new();
            spread("", tree.trim(), &mut found);
            all.extend(found.iter().map(|it| segments(it)));
        }
    }
    all
}

/// The paths written out in the code, from the root, from the parent or from a child.
fn written_out(code: &str) -> Vec<Vec<String>> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    let words = code.split(|c| !is_word(c)).filter(|it| it.contains("::"));
    words.map(|it| segments(it.trim_matches(':'))).collect()
}

#[test]
fn no_file_imports_itself_through_others() {
    let tree = Tree::read();
    let edges: usize = (0..tree.files.len()).map(|it| tree.imports(it).len()).sum();
    println!("{} files, {edges} imports between them", tree.files.len());
    assert!(edges > 300);
    if let Some(circle) = tree.circle() {
        panic!(
            "a circle of imports: {} -> {}",
            circle.join(" -> "),
            circle[0]
        );
    }
}
