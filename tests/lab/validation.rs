//! validation/README.md says what the program computes: each number of the page is computed again and
//! compared within its errors, so that a page that has grown stale fails.
//!
//! Folders of closed forms and short records run with every `cargo test`; all of them with
//! `cargo test --release --bin lab -- --ignored every_number_of_the_page`.

use crate::validate::folder::{Folder, Outcome, folders};
use crate::validate::item::Item;
use crate::validate::numbers::{COMPUTED, Name};
use crate::validate::spectra::Spectra;
use crate::validate::{equations, readme};
use std::fs;
use std::path::{Path, PathBuf};
use vibroimpact::estimate::Origin;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("validation")
}

fn page() -> String {
    fs::read_to_string(root().join(readme::NAME)).unwrap()
}

fn read() -> Vec<Folder> {
    let list = folders(&root()).unwrap();
    list.iter()
        .map(|path| Folder::read(path).unwrap())
        .collect()
}

/// What differs between the rows printed on a page and rows computed now, beyond both their errors: one
/// line each. Rows of folders in `folders` alone are looked at.
fn differences(page: &str, outcomes: &[Outcome]) -> Vec<String> {
    /// Errors apart at which two computations of the same number differ: chance alone would do that
    /// once in 16 000 numbers.
    const APART: f64 = 4.0;
    let printed = readme::rows(page);
    let mut found = Vec::new();
    for outcome in outcomes {
        let old: Vec<&readme::Printed> = printed
            .iter()
            .filter(|it| it.folder == outcome.name)
            .collect();
        if old.len() != outcome.rows.len() {
            found.push(format!(
                "{}: {} numbers on the page, {} now",
                outcome.name,
                old.len(),
                outcome.rows.len()
            ));
        }
        for row in &outcome.rows {
            let name = row.item.name.to_string();
            let Some(old) = old.iter().find(|it| it.name == name) else {
                found.push(format!("{}: {name} is not on the page", outcome.name));
                continue;
            };
            let new = readme::read(&readme::short(row.ours)).unwrap_or(row.ours);
            let apart = (new.value - old.ours.value).abs();
            if apart > APART * new.error.hypot(old.ours.error) {
                found.push(format!(
                    "{}: {name} is {} on the page, {} now",
                    outcome.name,
                    readme::short(old.ours),
                    readme::short(row.ours)
                ));
            }
            let verdict = row.verdict.to_string();
            // Chance may move a sampled number from one side of a limit to the other.
            let chance = row.ours.origin == Origin::Sampling || row.item.name.label == COMPUTED;
            if verdict != old.verdict && !chance {
                found.push(format!(
                    "{}: {name} was \"{}\", is \"{verdict}\"",
                    outcome.name, old.verdict
                ));
            }
        }
    }
    found
}

/// The page against folders computed now.
fn compare(folders: &[Folder]) {
    let spectra = Spectra::default();
    let run = |it: &Folder| it.run(&spectra, &|_| ()).unwrap();
    let outcomes: Vec<Outcome> = folders.iter().map(run).collect();
    let numbers: usize = outcomes.iter().map(|it| it.rows.len()).sum();
    println!("{numbers} numbers of {} folders", outcomes.len());
    let differences = differences(&page(), &outcomes);
    assert!(
        differences.is_empty(),
        "validation/README.md is stale; write it again with `cargo run --release --bin lab -- validate`:\n{}",
        differences.join("\n")
    );
    for outcome in &outcomes {
        for picture in &outcome.pictures {
            let there = root().join(&outcome.name).join(&picture.name);
            assert!(there.is_file(), "{} is missing", there.display());
        }
    }
}

/// Whether it takes a second or less: closed forms and long realisations, no transient, spectrum or draw.
fn is_quick(folder: &Folder) -> bool {
    let slow = [
        "transient",
        "decay_rates",
        "spectrum",
        "draws",
        "records",
        "restarts",
        "rest-records",
    ];
    let quick = |name: &Name| {
        !name
            .path
            .split(['.', ' '])
            .any(|key| slow.iter().any(|it| key.split('[').next() == Some(it)))
    };
    folder.items.iter().flat_map(Item::names).all(quick)
}

#[test]
fn the_quick_numbers_of_the_page_are_those_computed_now() {
    let quick: Vec<Folder> = read().into_iter().filter(is_quick).collect();
    assert!(quick.len() >= 4);
    compare(&quick);
}

#[test]
#[ignore = "minutes: all folders"]
fn every_number_of_the_page_is_the_one_computed_now() {
    compare(&read());
}

#[test]
fn the_page_holds_every_folder_and_every_item() {
    let printed = readme::rows(&page());
    for folder in read() {
        for item in &folder.items {
            let name = item.name.to_string();
            let there = printed
                .iter()
                .any(|row| row.folder == folder.name && row.name == name);
            assert!(
                there,
                "{}: {name} is not in validation/README.md",
                folder.name
            );
        }
    }
}

#[test]
fn a_changed_number_makes_the_page_stale() {
    let table_4 = Folder::read(&root().join("table-4")).unwrap();
    let mut outcome = table_4.run(&Spectra::default(), &|_| ()).unwrap();
    assert!(differences(&page(), &[outcome.clone()]).is_empty());
    outcome.rows[1].ours.value *= 1.0 + 1e-5;
    let found = differences(&page(), &[outcome.clone()]);
    assert_eq!(found.len(), 1, "{found:?}");
    outcome.rows.pop();
    assert_eq!(differences(&page(), &[outcome]).len(), 2);
}

#[test]
fn an_unknown_key_of_a_line_is_refused_with_file_line_and_key_before_anything_runs() {
    let room = std::env::temp_dir().join(format!("vibroimpact-lab-{}", std::process::id()));
    let folder = room.join("unknown-key");
    fs::create_dir_all(&folder).unwrap();
    fs::write(
        folder.join("scene.toml"),
        "[oscillator]\nzeta = 0.005\nh = 2e-3\n",
    )
    .unwrap();
    for (name, key) in [
        ("computed: spectrum.peak h=8e-5 bilinear=1", "bilinear"),
        (
            "h=8e-5 oscillator.zetta=1: stationary.std_force",
            "oscillator.zetta",
        ),
    ] {
        let list = format!("name,value,tolerance,where,reason,because\n\n{name},,,peak,,\n");
        fs::write(folder.join("paper.csv"), list).unwrap();
        let message = Folder::read(&folder).unwrap_err().to_string();
        println!("{message}");
        for part in ["unknown-key/paper.csv line 3", key] {
            assert!(message.contains(part), "{message}");
        }
    }
    fs::remove_dir_all(room).unwrap();
}

#[test]
fn what_is_not_explained_has_words() {
    for row in readme::rows(&page()) {
        if row.verdict != "unexplained" {
            continue;
        }
        let folder = Folder::read(&root().join(&row.folder)).unwrap();
        let item = folder
            .items
            .iter()
            .find(|it| it.name.to_string() == row.name);
        assert!(
            !item.unwrap().because.is_empty(),
            "{}: {}",
            row.folder,
            row.name
        );
    }
}

/// `table-3` as `Table 3`, `section-4.1` as `section 4.1`.
fn in_words(folder: &str) -> String {
    folder.replace("table-", "Table ").replace('-', " ")
}

#[test]
fn the_readme_says_how_many_numbers_are_unexplained_and_where() {
    let rows = readme::rows(&page());
    let mut places: Vec<(String, usize)> = Vec::new();
    for row in rows.iter().filter(|row| row.verdict == "unexplained") {
        match places.iter_mut().find(|(folder, _)| *folder == row.folder) {
            Some((_, count)) => *count += 1,
            None => places.push((row.folder.clone(), 1)),
        }
    }
    let total: usize = places.iter().map(|(_, count)| count).sum();
    let list: Vec<String> = places
        .iter()
        .map(|(folder, count)| format!("{count} of {}", in_words(folder)))
        .collect();
    let sentence = format!(
        "Of {} numbers, {total} stay unexplained: {}.",
        rows.len(),
        list.join(", ")
    );
    println!("{sentence}");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md");
    let text = fs::read_to_string(path).unwrap();
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(
        text.contains(&sentence),
        "README.md does not say: {sentence}"
    );
}

#[test]
fn a_bracket_stands_where_the_legend_says_one_does() {
    let page = page();
    let rows = page.lines().filter(|line| line.starts_with("| `"));
    let mut seen = 0;
    for line in rows {
        let verdict = line.trim_end_matches(" |").rsplit(" | ").next().unwrap();
        let words = verdict.split([':', '(']).next().unwrap();
        let bracket = verdict[words.len()..].starts_with('(');
        match words.trim().trim_matches('*') {
            "explained" | "possibly explained" | "fitted" | "agrees" => assert!(bracket, "{line}"),
            "within the printed digits" | "within the printed bound" | "ours alone" => {
                assert!(!bracket, "{line}");
            }
            _ => {}
        }
        // What the words promise is there.
        if verdict.contains("number in brackets") {
            assert!(bracket, "{line}");
            seen += 1;
        }
    }
    assert!(seen > 0);
}

#[test]
fn no_two_of_our_own_methods_for_a_number_disagree() {
    let page = page();
    let rows = readme::rows(&page);
    let apart: Vec<_> = rows
        .iter()
        .filter(|row| row.verdict == "disagrees")
        .collect();
    assert!(apart.is_empty(), "{apart:?}");
}

#[test]
fn every_equation_has_an_item_and_a_test_that_exist() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR"));
    let list = equations::read(&root()).unwrap().unwrap();
    for number in 1..=34 {
        let there = list.iter().any(|it| {
            let ends: Vec<u32> = it.number.split('-').map(|n| n.parse().unwrap()).collect();
            (ends[0]..=ends[ends.len() - 1]).contains(&number)
        });
        assert!(there, "equation ({number}) is missing");
    }
    let mut tests = 0;
    for it in &list {
        assert!(!it.item.is_empty(), "({}) names no item", it.number);
        for test in it.test.split(", ") {
            let (file, name) = test.split_once(": ").unwrap_or_else(|| panic!("{test}"));
            let text = fs::read_to_string(src.join(file)).unwrap_or_else(|_| panic!("{file}"));
            assert!(
                text.contains(&format!("fn {name}(")),
                "{file} has no {name}"
            );
            tests += 1;
        }
        for item in it.item.split(", ") {
            let (file, name) = item.split_once(": ").unwrap_or_else(|| panic!("{item}"));
            let text = fs::read_to_string(src.join(file)).unwrap_or_else(|_| panic!("{file}"));
            let last = name.rsplit("::").next().unwrap();
            let found = ["fn ", "struct ", "enum ", "trait ", "    "]
                .iter()
                .any(|word| text.contains(&format!("{word}{last}")));
            assert!(found, "{file} has no {last}");
        }
    }
    println!("{} equations, {tests} tests", list.len());
}
