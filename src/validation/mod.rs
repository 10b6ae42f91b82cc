//! The paper, reproduced: folders of scenes with the paper's numbers, compared one by one.
//!
//! A folder holds `paper.csv`, the scenes its items name, and, if it likes, `about.md`. Each line of
//! `paper.csv` is an item: a number of a scene's results, what the paper prints for it and to which
//! digit, where, and what explains a difference. An explanation is itself a number that has to match:
//! see [`item`].

pub mod cosines;
pub mod damping;
pub mod equations;
pub mod evidence;
pub mod folder;
pub mod item;
pub mod numbers;
pub mod pictures;
pub mod readme;
pub mod spectra;

pub use folder::{Folder, Outcome};
pub use item::{Row, Verdict};
pub use spectra::Spectra;

use crate::error::{Error, Result};
use std::fs;
use std::path::{Path, PathBuf};

/// The name of the list of items in a folder.
pub const ITEMS: &str = "paper.csv";

/// All folders with a list of items right below `root`, tables before figures, numbers ascending.
///
/// # Errors
/// [`Error::Invalid`] where there is no such folder.
pub fn folders(root: &Path) -> Result<Vec<PathBuf>> {
    let mut found: Vec<PathBuf> = fs::read_dir(root)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.join(ITEMS).is_file())
        .collect();
    if found.is_empty() {
        let accepted = format!(
            "a folder of folders with a {ITEMS} each, as validation/ of the source; go there, or name \
             folders on the command line"
        );
        return Err(Error::invalid("validate", root.display(), accepted));
    }
    found.sort_by_key(|path| place(path));
    Ok(found)
}

/// Where a folder stands: by kind, then by number, then by name.
fn place(path: &Path) -> (usize, u32, String) {
    let name = folder::name_of(path);
    let kinds = ["table-", "damping", "section-", "figure-"];
    let kind = kinds.iter().position(|kind| name.starts_with(kind));
    let digits: String = name.chars().filter(char::is_ascii_digit).collect();
    (
        kind.unwrap_or(kinds.len()),
        digits.parse().unwrap_or(0),
        name,
    )
}
