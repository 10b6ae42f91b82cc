//! A file that one run holds at a time.

use crate::error::{Error, Result};
use std::fs;
use std::path::PathBuf;

/// Holds its file until it is dropped.
#[derive(Debug)]
pub(crate) struct Lock {
    file: fs::File,
    path: PathBuf,
}

impl Lock {
    /// Takes a file, made for that; `refused` where another run holds it.
    pub(crate) fn take(path: PathBuf, refused: impl FnOnce() -> Error) -> Result<Self> {
        let file = fs::File::create(&path).map_err(Error::io(&path))?;
        if let Err(fs::TryLockError::WouldBlock) = file.try_lock() {
            return Err(refused());
        }
        Ok(Self { file, path })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Best effort: a lock file left behind is taken over by the next run.
        let _ = self.file.unlock();
        let _ = fs::remove_file(&self.path);
    }
}
