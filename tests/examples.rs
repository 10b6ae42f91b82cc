//! Every example runs, and what it asserts holds.

use rayon::prelude::*;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Where cargo puts the examples that it builds with the tests.
fn built() -> PathBuf {
    let program = Path::new(env!("CARGO_BIN_EXE_vibroimpact"));
    program.parent().unwrap().join("examples")
}

#[test]
fn every_example_runs_and_is_short() {
    let room = Path::new(env!("CARGO_TARGET_TMPDIR")).join("examples");
    let _ = fs::remove_dir_all(&room);
    fs::create_dir_all(&room).unwrap();
    let mut names = Vec::new();
    for entry in fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("examples")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let text = fs::read_to_string(&path).unwrap();
        let lines = text.lines().count();
        assert!(lines <= 60, "{name}: {lines} lines");
        assert!(text.starts_with("//! "), "{name} asks no question");
        assert!(text.contains(&format!("--example {name}\n")), "{name}");
        names.push(name);
    }
    names.sort();
    assert!(names.len() >= 8, "{names:?}");
    names.into_par_iter().for_each(|name| {
        let program = built()
            .join(&name)
            .with_extension(std::env::consts::EXE_EXTENSION);
        assert!(
            program.exists(),
            "{name}: cargo test, or cargo build --examples, builds it"
        );
        let output = Command::new(&program).current_dir(&room).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        let wrong = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{name}\n{said}{wrong}");
        assert!(
            said.lines().count() >= 4 && wrong.is_empty(),
            "{name}\n{said}{wrong}"
        );
        println!("{name}\n{said}");
    });
    assert!(room.join("snapshots.svg").is_file());
}
