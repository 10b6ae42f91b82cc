//! The file of a part: one line a point, each written whole, so that a run that was killed goes on where it ended.

use super::grid::Ending;
use super::part::Part;
use crate::error::{Error, Result};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::fs::{self, File, OpenOptions};
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// What a line says of its point, without its numbers.
#[derive(Debug, Deserialize)]
pub(super) struct Head {
    pub(super) index: usize,
    pub(super) name: String,
    error: Option<IgnoredAny>,
    #[serde(default)]
    shortfalls: Vec<Short>,
}

#[derive(Debug, Deserialize)]
struct Short {
    #[serde(default)]
    number: Option<String>,
    free: bool,
}

impl Head {
    /// Whether the point, or a stage of it, has no answer: another try may find one.
    pub(super) fn lacks(&self) -> bool {
        let none = |it: &Short| it.number.as_deref() == Some("");
        self.error.is_some() || self.shortfalls.iter().any(none)
    }

    pub(super) fn ending(&self) -> Ending {
        if self.error.is_some() {
            Ending::Failed
        } else if self.shortfalls.iter().any(|it| it.free) {
            Ending::Short
        } else {
            Ending::Well
        }
    }
}

/// The lines of one part, held by one run at a time.
#[derive(Debug)]
pub(super) struct Lines {
    path: PathBuf,
    file: Mutex<File>,
    lock: File,
    lock_path: PathBuf,
    /// Lines that were dropped: cut off, or not wanted.
    pub(super) dropped: usize,
}

impl Lines {
    /// Opens the file of a part in a folder. `wanted` is asked of every whole line; the others are dropped from the
    /// file, a cut-off last one among them.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a part that another run is computing; [`Error::Io`] where the system refuses.
    pub(super) fn open(
        folder: &Path,
        part: Part,
        mut wanted: impl FnMut(&Head) -> bool,
    ) -> Result<Self> {
        let path = folder.join(part.file());
        let lock_path = folder.join(format!(".{}.lock", part.file()));
        let lock = File::create(&lock_path).map_err(Error::io(&lock_path))?;
        if let Err(fs::TryLockError::WouldBlock) = lock.try_lock() {
            let accepted = "a part that no other run is computing";
            return Err(Error::invalid("--part", part.file(), accepted));
        }
        let mut dropped = 0;
        if path.exists() {
            let beside = folder.join(format!(".{}.part", part.file()));
            let mut kept = BufWriter::new(File::create(&beside).map_err(Error::io(&beside))?);
            each(&path, |_, line| {
                let head = serde_json::from_slice::<Head>(line);
                if line.ends_with(b"\n") && head.is_ok_and(|it| wanted(&it)) {
                    kept.write_all(line).map_err(Error::io(&beside))
                } else {
                    dropped += 1;
                    Ok(())
                }
            })?;
            kept.flush().map_err(Error::io(&beside))?;
            let kept = kept.into_inner();
            let kept = kept.map_err(|error| Error::io(&beside)(error.into_error()))?;
            if dropped > 0 {
                kept.sync_data().map_err(Error::io(&beside))?;
                fs::rename(&beside, &path).map_err(Error::io(&path))?;
            } else {
                fs::remove_file(&beside).map_err(Error::io(&beside))?;
            }
        }
        let file = OpenOptions::new().create(true).append(true).open(&path);
        Ok(Self {
            file: Mutex::new(file.map_err(Error::io(&path))?),
            path,
            lock,
            lock_path,
            dropped,
        })
    }

    /// Appends a line by one write: it is there whole, or cut off as the last one.
    ///
    /// # Errors
    /// [`Error::Io`] where the system refuses.
    pub(super) fn write(&self, mut line: String) -> Result<()> {
        line.push('\n');
        // Whoever panicked had not begun to write.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(line.as_bytes())
            .map_err(Error::io(&self.path))
    }

    /// What was written is on the disk.
    ///
    /// # Errors
    /// [`Error::Io`] where the system refuses.
    pub(super) fn sync(&self) -> Result<()> {
        match self.file.lock() {
            Ok(file) => file.sync_data().map_err(Error::io(&self.path)),
            Err(_) => Ok(()),
        }
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        // Best effort: a lock file left behind is taken over by the next run.
        let _ = self.lock.unlock();
        let _ = fs::remove_file(&self.lock_path);
    }
}

/// Shows every line of a file with the place where it begins, a cut-off last one too.
///
/// # Errors
/// [`Error::Io`], and whatever `visit` answers.
pub(super) fn each(path: &Path, mut visit: impl FnMut(u64, &[u8]) -> Result<()>) -> Result<()> {
    let mut file = BufReader::with_capacity(1 << 16, File::open(path).map_err(Error::io(path))?);
    let (mut at, mut line) = (0, Vec::new());
    loop {
        line.clear();
        let read = file.read_until(b'\n', &mut line).map_err(Error::io(path))?;
        if read == 0 {
            return Ok(());
        }
        visit(at, &line)?;
        at += read as u64;
    }
}
