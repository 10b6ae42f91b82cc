//! The output folder: files appear in it whole or not at all.

use super::file::{File, RESULTS};
use super::lock::Lock;
use super::manifest;
use crate::error::{Error, Result};
use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A folder that one run writes into.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    /// Held until the run ends, so that a second run does not write into the same folder.
    _lock: Lock,
    /// Outermost folder that had to be made.
    made: Option<PathBuf>,
}

/// What to do with a folder that exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// Refuse it.
    Refuse,
    /// Take it if its results.json is one of ours, or if it is empty.
    ReplaceOurs,
    /// Take it whatever it holds: where that is no earlier run of ours, nothing is removed, and only a file of the name of a
    /// new one is replaced.
    Force,
}

/// Tables that surveys leave; the first two tell a folder as ours.
const SURVEYS: [&str; 6] = [
    "precision.csv",
    "stability.csv",
    "precision.md",
    "stability.md",
    "cost.csv",
    "calibration.csv",
];

const LOCK: &str = ".vibroimpact.lock";

/// Whether a file of that name is one of ours, to be removed before a new run.
fn is_ours(name: &OsStr) -> bool {
    let Some(name) = name.to_str() else {
        return false;
    };
    let ending = Path::new(name).extension();
    let survey = name.starts_with("precision_") && ending == Some(OsStr::new("svg"));
    let half = name.starts_with('.') && ending == Some(OsStr::new("part"));
    manifest::holds(name) || SURVEYS.contains(&name) || survey || half
}

/// Whether the folder holds a results.json that this program wrote, or the table of a survey.
fn holds_our_results(path: &Path) -> bool {
    if SURVEYS[..2].iter().any(|it| path.join(it).is_file()) {
        return true;
    }
    let text = fs::read_to_string(path.join(RESULTS)).unwrap_or_default();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
    json["scene"].is_object() && json["run"]["version"].is_string()
}

/// Refuses a file where a folder is meant.
pub(crate) fn no_file(path: &Path) -> Result<()> {
    if path.exists() && !path.is_dir() {
        let accepted = "the name of a folder; this is a file";
        return Err(Error::invalid("--out", path.display(), accepted));
    }
    Ok(())
}

impl Folder {
    /// Make the folder, or take it over as `existing` allows: earlier results of ours in it are removed,
    /// anything else is left alone.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a folder that is not to be taken; [`Error::Io`] where it cannot be made or
    /// written.
    pub fn open(path: &Path, existing: Existing) -> Result<Self> {
        let shown = path.display();
        no_file(path)?;
        if path.exists() {
            // A run that was stopped leaves its lock.
            let other = |it: fs::DirEntry| it.file_name() != LOCK;
            let empty = || fs::read_dir(path).is_ok_and(|it| !it.flatten().any(other));
            let (taken, accepted) = match existing {
                Existing::Force => (true, ""),
                Existing::Refuse => (
                    false,
                    "a folder that does not exist yet, or --force to replace what is in it",
                ),
                Existing::ReplaceOurs => (
                    empty() || holds_our_results(path),
                    "a folder with a results.json of ours; this one has other things in it: give \
                     --out, or --force to write here all the same",
                ),
            };
            if !taken {
                return Err(Error::invalid("--out", shown, accepted));
            }
        }
        let io = Error::io(path);
        let ours = holds_our_results(path);
        let missing = path
            .ancestors()
            .take_while(|it| !it.as_os_str().is_empty() && !it.exists());
        let made = missing.last().map(Path::to_owned);
        fs::create_dir_all(path).map_err(&io)?;
        let lock = Lock::take(path.join(LOCK), || {
            let accepted = "a folder that no other run is writing into";
            Error::invalid("--out", shown, accepted)
        })?;
        for entry in fs::read_dir(path).map_err(&io)?.flatten() {
            if ours && is_ours(&entry.file_name()) && entry.file_type().is_ok_and(|it| it.is_file())
            {
                fs::remove_file(entry.path()).map_err(&io)?;
            }
        }
        Ok(Self {
            path: path.to_owned(),
            _lock: lock,
            made,
        })
    }

    /// Take back everything: for a run that was refused before its first result. What others have put beside
    /// it stays.
    pub fn discard(self) {
        for name in manifest::AT_THE_START {
            let _ = fs::remove_file(self.path.join(name));
        }
        let (path, made) = (self.path.clone(), self.made.clone());
        // The lock goes with it.
        drop(self);
        let Some(made) = made else { return };
        for folder in path.ancestors() {
            // Only an empty one can be removed.
            if fs::remove_dir(folder).is_err() || folder == made {
                return;
            }
        }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Write files: each beside its place first, then renamed into it.
    ///
    /// # Errors
    /// [`Error::Io`] where the system refuses.
    pub fn write(&self, files: &[File]) -> Result<()> {
        write(&self.path, files)
    }
}

/// Write files into a folder that exists, whatever it holds: each beside its place first, then renamed
/// into it.
///
/// # Errors
/// [`Error::Io`] where the system refuses.
pub fn write(folder: &Path, files: &[File]) -> Result<()> {
    for file in files {
        let target = folder.join(&file.name);
        let beside = folder.join(format!(".{}.part", file.name));
        let written = (|| {
            let mut it = fs::File::create(&beside)?;
            it.write_all(&file.bytes)?;
            it.sync_data()?;
            drop(it);
            fs::rename(&beside, &target)
        })();
        written.map_err(|source| {
            let _ = fs::remove_file(&beside);
            Error::io(&target)(source)
        })?;
    }
    Ok(())
}
