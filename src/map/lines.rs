//! The file of a part: one line a point, each written whole, so that a run that was killed goes on where it ended. A point that
//! is computed again has two until then: the one that lacks fewer answers, or misses the tolerance by less, counts.

use super::part::Part;
use crate::error::{Error, Result};
use crate::report::lock::Lock;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::{HashMap, HashSet};
use std::fs::{self, File, OpenOptions};
use std::hash::{DefaultHasher, Hasher};
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// How a point ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ending {
    /// Every number met the tolerance, or was not free to.
    Well,
    /// A number that the program was free to refine did not reach the tolerance.
    Short,
    /// A stage has no answer.
    Lacking,
    /// No results.
    Failed,
}

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
    #[serde(default)]
    ratio: Option<f64>,
    free: bool,
}

impl Head {
    /// Of a whole line; None of one that is cut off or none of ours.
    fn of(line: &[u8]) -> Option<Self> {
        let whole = Some(line).filter(|it| it.ends_with(b"\n"));
        whole.and_then(|it| serde_json::from_slice(it).ok())
    }

    /// What another try may find: the stages without an answer, more than any where the point has none, and how many times too
    /// large an error is that was free to be smaller.
    fn lacking(&self) -> [f64; 2] {
        if self.error.is_some() {
            return [f64::INFINITY; 2];
        }
        let (none, short): (Vec<&Short>, Vec<&Short>) = self
            .shortfalls
            .iter()
            .partition(|it| it.number.as_deref() == Some(""));
        let free = short.into_iter().filter(|it| it.free);
        let ratios = free.map(|it| it.ratio.unwrap_or(f64::INFINITY));
        [none.len() as f64, ratios.fold(0.0, f64::max)]
    }

    pub(super) fn ending(&self) -> Ending {
        if self.error.is_some() {
            Ending::Failed
        } else {
            match self.lacking() {
                [0.0, 0.0] => Ending::Well,
                [0.0, _] => Ending::Short,
                _ => Ending::Lacking,
            }
        }
    }
}

/// A line that a point is known by.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    /// Of several files the one that it stands in, and where in it.
    pub(super) file: usize,
    pub(super) at: u64,
    pub(super) ending: Ending,
    lacking: [f64; 2],
    /// Of the whole line.
    hash: u64,
}

impl Known {
    pub(super) fn of(head: &Head, line: &[u8], file: usize, at: u64) -> Self {
        let mut hasher = DefaultHasher::new();
        hasher.write(line);
        Self {
            file,
            at,
            ending: head.ending(),
            lacking: head.lacking(),
            hash: hasher.finish(),
        }
    }

    /// Whether both have all answers within the tolerance, and other ones.
    pub(super) fn disagrees(&self, other: &Self) -> bool {
        !self.lacks() && !other.lacks() && self.hash != other.hash
    }

    /// Whether another try may find more.
    pub(super) fn lacks(&self) -> bool {
        self.lacking != [0.0; 2]
    }
}

/// Shows every whole line of a file with its head, and tells how many others it has.
pub(super) fn heads(
    (file, path): (usize, &Path),
    mut visit: impl FnMut(Head, Known) -> Result<()>,
) -> Result<usize> {
    let mut others = 0;
    each(path, |at, line| {
        let Some(head) = Head::of(line) else {
            others += 1;
            return Ok(());
        };
        let known = Known::of(&head, line, file, at);
        visit(head, known)
    })?;
    Ok(others)
}

/// Keeps of the lines of a point the one that counts.
pub(super) fn keep(all: &mut HashMap<usize, Known>, index: usize, here: Known) {
    let counts = |there: &Known| (here.lacking, here.hash) < (there.lacking, there.hash);
    if all.get(&index).is_none_or(counts) {
        all.insert(index, here);
    }
}

/// The lines that the points of a file are known by, of those that are `ours`; the others go from it. How many of them are none of
/// ours.
fn tidied(path: &Path, ours: impl Fn(&Head) -> bool) -> Result<(HashMap<usize, Known>, usize)> {
    let (mut all, mut lines, mut foreign) = (HashMap::new(), 0, 0);
    let others = heads((0, path), |head, here| {
        if ours(&head) {
            lines += 1;
            keep(&mut all, head.index, here);
        } else {
            foreign += 1;
        }
        Ok(())
    })?;
    foreign += others;
    if foreign > 0 || lines > all.len() {
        leave(path, &all.values().map(|it| it.at).collect())?;
    }
    Ok((all, foreign))
}

/// The lines of one part, held by one run at a time.
#[derive(Debug)]
pub(super) struct Lines {
    path: PathBuf,
    file: Mutex<File>,
    _lock: Lock,
    /// Lines that were dropped: cut off, or not wanted.
    pub(super) dropped: usize,
}

impl Lines {
    /// Opens the file of a part in a folder, and the lines that its points are known by. Those that are not `ours` go, a cut-off last
    /// one among them.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a part that another run is computing; [`Error::Io`] where the system refuses.
    pub(super) fn open(
        folder: &Path,
        part: Part,
        ours: impl Fn(&Head) -> bool,
    ) -> Result<(Self, HashMap<usize, Known>)> {
        let path = folder.join(part.file());
        let lock_path = folder.join(format!(".{}.lock", part.file()));
        let lock = Lock::take(lock_path, || {
            let accepted = format!("a folder in which no other run is computing part {part}");
            Error::invalid("--out", folder.display(), accepted)
        })?;
        let (there, dropped) = if path.exists() {
            tidied(&path, ours)?
        } else {
            Default::default()
        };
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let it = Self {
            file: Mutex::new(file.map_err(Error::io(&path))?),
            path,
            _lock: lock,
            dropped,
        };
        Ok((it, there))
    }

    /// Appends a line by one write: it is there whole, or cut off as the last one.
    pub(super) fn write(&self, mut line: String) -> Result<Ending> {
        line.push('\n');
        let ending = Head::of(line.as_bytes()).map_or(Ending::Failed, |it| it.ending());
        // Whoever panicked had not begun to write.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(line.as_bytes())
            .map_err(Error::io(&self.path))?;
        Ok(ending)
    }

    /// What was written is on the disk; of points that were computed again one line stays.
    pub(super) fn close(self, again: bool) -> Result<()> {
        if let Ok(file) = self.file.lock() {
            file.sync_data().map_err(Error::io(&self.path))?;
        }
        if again {
            tidied(&self.path, |_| true)?;
        }
        Ok(())
    }
}

/// Leaves in a file the lines that begin at some places; all of it or nothing.
fn leave(path: &Path, places: &HashSet<u64>) -> Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let beside = path.with_file_name(format!(".{name}.part"));
    let mut kept = BufWriter::new(File::create(&beside).map_err(Error::io(&beside))?);
    each(path, |at, line| {
        if places.contains(&at) {
            kept.write_all(line).map_err(Error::io(&beside))?;
        }
        Ok(())
    })?;
    let kept = kept.into_inner();
    let kept = kept.map_err(|error| Error::io(&beside)(error.into_error()))?;
    kept.sync_data().map_err(Error::io(&beside))?;
    fs::rename(&beside, path).map_err(Error::io(path))
}

/// Shows every line of a file with the place where it begins, a cut-off last one too.
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

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: &str = "{\"index\":3,\"name\":\"a\",\"error\":{\"message\":\"too long\"}}";
    const SOME: &str =
        "{\"index\":3,\"name\":\"a\",\"shortfalls\":[{\"number\":\"\",\"free\":true}]}";
    const SHORT: &str = "{\"index\":3,\"name\":\"a\",\"shortfalls\":[{\"number\":\"var_q\",\"ratio\":460.1,\"free\":true}]}";
    const NEARER: &str = "{\"index\":3,\"name\":\"a\",\"shortfalls\":[{\"number\":\"var_q\",\"ratio\":2.0,\"free\":true}]}";
    const ALL: &str = "{\"index\":3,\"name\":\"a\",\"results\":{}}";

    #[test]
    fn a_line_counts_by_how_much_it_lacks() {
        let known = |line: &str| {
            let line = format!("{line}\n");
            Known::of(&Head::of(line.as_bytes()).unwrap(), line.as_bytes(), 0, 0)
        };
        let all = [NONE, SOME, SHORT, NEARER, ALL].map(known);
        let endings = all.map(|it| it.ending);
        let short = [Ending::Short; 2];
        assert_eq!(endings[..2], [Ending::Failed, Ending::Lacking]);
        assert_eq!((&endings[2..4], endings[4]), (&short[..], Ending::Well));
        assert_eq!(all.map(|it| it.lacks()), [true, true, true, true, false]);
        for pair in all.windows(2) {
            let mut kept = HashMap::from([(3, pair[0])]);
            keep(&mut kept, 3, pair[1]);
            assert_eq!(kept[&3].hash, pair[1].hash);
            keep(&mut kept, 3, pair[0]);
            assert_eq!(kept[&3].hash, pair[1].hash);
        }
    }

    #[test]
    fn a_point_that_is_computed_again_keeps_its_line_until_it_has_a_better_one() {
        let folder = std::env::temp_dir().join("vibroimpact-lines");
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join(Part::WHOLE.file());
        fs::write(
            &path,
            format!("{SOME}\n{{\"index\":4,\"name\":\"of another\"}}\n{ALL}"),
        )
        .unwrap();
        let open = || Lines::open(&folder, Part::WHOLE, |head| head.name == "a").unwrap();
        let text = || fs::read_to_string(&path).unwrap();
        let (lines, there) = open();
        // The last one is cut off.
        assert!(there[&3].lacks() && lines.dropped == 2);
        assert_eq!(text(), format!("{SOME}\n"));
        // Killed before another was there, and after a worse one.
        drop(lines);
        let (lines, _) = open();
        lines.write(NONE.into()).unwrap();
        drop(lines);
        let (lines, there) = open();
        assert!(there[&3].ending == Ending::Lacking && lines.dropped == 0);
        assert_eq!(text(), format!("{SOME}\n"));
        lines.write(ALL.into()).unwrap();
        assert_eq!(text(), format!("{SOME}\n{ALL}\n"));
        lines.close(true).unwrap();
        assert_eq!(text(), format!("{ALL}\n"));
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn of_two_lines_the_one_with_more_answers_counts_in_any_order_and_none_stands_against_another()
    {
        let of =
            |line: &str| Known::of(&serde_json::from_str(line).unwrap(), line.as_bytes(), 0, 0);
        let [none, some, all] = [NONE, SOME, ALL].map(of);
        // Whether the first stands in the end, whichever comes first.
        let counts = |one: Known, other: Known| {
            let stands = |order: [Known; 2]| {
                let mut all = HashMap::new();
                for it in order {
                    keep(&mut all, 3, it);
                }
                all[&3].hash == one.hash
            };
            assert_eq!(stands([one, other]), stands([other, one]));
            stands([one, other])
        };
        for (better, worse) in [(all, some), (some, none), (all, none)] {
            assert!(counts(better, worse) && !counts(worse, better));
            assert!(!better.disagrees(&worse));
        }
        let other = of("{\"index\":3,\"name\":\"a\",\"results\":{\"stationary\":1}}");
        assert!(other.disagrees(&all) && !all.disagrees(&all));
        let failed = of("{\"index\":3,\"name\":\"a\",\"error\":{\"message\":\"too large\"}}");
        assert!(counts(failed, none) != counts(none, failed) && !failed.disagrees(&none));
    }
}
