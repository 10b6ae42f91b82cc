//! A part of a map is run: which of its points are missing, in what order, on how many threads each.

use super::grid::{Map, MapError, Result, SHOWN, name};
use super::lines::{Ending, Head, Lines};
use super::part::Part;
use crate::error::Error;
use crate::format::{many, seconds};
use crate::plan::Plan;
use crate::report::folder::no_file;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde_json::Value;
use std::collections::HashMap;
use std::fmt;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Points of a part at most: what is kept of each takes some 100 bytes.
const MOST: usize = 10_000_000;

/// Plans are kept in parts of at most so many points: one takes some 10 kB.
const KEPT: usize = 10_000;

/// The file that says what the map is.
pub(super) const MAP: &str = "map.json";

/// Told about a map as it goes; every method may be left as it is.
pub trait Watch: Sync {
    /// A point has ended, or none yet.
    fn progress(&self, _progress: &Progress) {}

    /// Asked before every point: whether to begin no more.
    fn stops(&self) -> bool {
        false
    }
}

/// How far a part has come.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Progress {
    /// Points to compute in this run.
    pub points: usize,
    /// Of these, computed.
    pub computed: usize,
    /// Share of their foreseen time that lies behind.
    pub share: f64,
    /// Seconds since the first point began.
    pub seconds: f64,
}

impl Progress {
    /// Points per second so far; 0 before the first.
    pub fn rate(&self) -> f64 {
        if self.computed == 0 {
            return 0.0;
        }
        self.computed as f64 / self.seconds.max(1e-9)
    }

    /// Seconds left at the rate so far; None before the first point has ended.
    pub fn left(&self) -> Option<f64> {
        (self.computed > 0 && self.share > 0.0)
            .then(|| self.seconds * (1.0 - self.share) / self.share)
    }
}

/// How a part ended.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Points of the part.
    pub points: usize,
    /// Of these, there before.
    pub before: usize,
    /// Computed in this run.
    pub computed: usize,
    /// Of the points without an answer, with a stage that has none, or short of the tolerance, those that are computed again.
    pub again: usize,
    /// Lines that hold a message in place of results.
    pub failed: usize,
    /// Lines of points with a stage that has no answer.
    pub lacking: usize,
    /// Lines with a number that the program was free to refine and that did not reach the tolerance.
    pub short: usize,
    /// Lines found cut off or of no point of the part, and computed again.
    pub dropped: usize,
    /// Seconds that the points took.
    pub seconds: f64,
}

impl Tally {
    fn count(&mut self, ending: Ending) {
        match ending {
            Ending::Well => {}
            Ending::Short => self.short += 1,
            Ending::Lacking => self.lacking += 1,
            Ending::Failed => self.failed += 1,
        }
    }

    /// Points without a line: where the run was told to stop.
    pub fn missing(&self) -> usize {
        self.points - self.before - self.computed
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", many(self.points as u64, "point"))?;
        if self.before > 0 {
            write!(f, "{} there before, ", self.before)?;
        }
        let rate = self.computed as f64 / self.seconds.max(1e-9);
        let took = seconds(self.seconds);
        let computed = self.computed;
        writeln!(f, "{computed} computed in {took}, {rate:.3} points/s")?;
        for (count, noun, what) in [
            (self.dropped, "cut-off or foreign line", "dropped"),
            (
                self.again,
                "point",
                "without an answer or short of the tolerance, to be computed again",
            ),
            (
                self.short,
                "point",
                "short of the tolerance: the lines say by how much; --retry tries again",
            ),
            (
                self.lacking,
                "point",
                "with a stage without an answer: the lines say why; --retry tries again",
            ),
            (self.failed, "point", "failed: the lines hold the message"),
            (self.missing(), "point", "not begun"),
        ] {
            if count > 0 {
                writeln!(f, "{} {what}", many(count as u64, noun))?;
            }
        }
        Ok(())
    }
}

/// A point still to be computed.
#[derive(Debug, Clone)]
struct Job {
    index: usize,
    /// Foreseen.
    seconds: f64,
    bytes: u64,
    /// The memory that its scene allows.
    allowed: u64,
    /// Kept, as it takes a third of the time of a short transient; None where it is made when it is its turn.
    plan: Option<Box<Plan>>,
}

impl Map {
    /// Computes the points of a part that have no line yet and appends their lines to the part's file in a folder,
    /// each as soon as it has ended: killed at any moment, it loses the points in flight. `retry` computes those again that
    /// failed, lack an answer or missed the tolerance. Points run in parallel, one on each of `threads` threads, the
    /// longest first by their plans; a point that is large by its plan gets all threads.
    ///
    /// # Errors
    /// Before anything runs: [`MapError`] for a point of the part that is out of range, a folder of something else,
    /// a part that another run is computing. Later: [`Error::Io`].
    pub fn run(
        &self,
        part: Part,
        folder: &Path,
        threads: usize,
        retry: bool,
        watch: &dyn Watch,
    ) -> Result<Tally> {
        let threads = threads.max(1);
        let pool = pool(threads)?;
        let points: Vec<usize> = part.points(self.len()).take(MOST + 1).collect();
        if points.len() > MOST {
            let accepted = format!("at most {:.0e} points in a part: more parts", MOST as f64);
            let shown = format!("{} points", self.len());
            return Err(Error::invalid("--part", shown, accepted).into());
        }
        let named = |index: &usize| Ok((*index, name(self.text(*index)?.scene())));
        let names: HashMap<usize, String> =
            pool.install(|| points.par_iter().map(named).collect::<Result<_>>())?;
        self.claim(folder, part)?;

        let mut tally = Tally {
            points: points.len(),
            ..Tally::default()
        };
        let mut missing = names;
        let ours = |head: &Head| missing.get(&head.index) == Some(&head.name);
        let (lines, there) = Lines::open(folder, part, ours)?;
        for (index, known) in there {
            if retry && known.lacks() {
                tally.again += 1;
            } else {
                missing.remove(&index);
                tally.before += 1;
                tally.count(known.ending);
            }
        }
        tally.dropped = lines.dropped;
        let keep = missing.len() <= KEPT;
        let jobs = |index: &usize| self.job(*index, keep);
        let jobs: Result<Vec<Job>> = pool.install(|| {
            let missing = points.par_iter().filter(|it| missing.contains_key(it));
            missing.map(jobs).collect()
        });
        let (large, small) = in_order(jobs?, threads);
        let run = Run {
            map: self,
            lines: &lines,
            watch,
            start: Instant::now(),
            foreseen: large.iter().chain(&small).map(|it| it.seconds).sum(),
            state: Mutex::new(State {
                tally,
                behind: 0.0,
                stopped: None,
            }),
            points: large.len() + small.len(),
        };
        run.tell(0, 0.0);
        for job in &large {
            if !run.goes_on() {
                break;
            }
            pool.install(|| run.point(job));
        }
        drop(pool);
        run.each_on_one_thread(&small, threads)?;
        let ended = run.ended()?;
        lines.close(ended.again > 0)?;
        Ok(ended)
    }

    /// The folder is this map's from now on, if it is nobody's.
    fn claim(&self, folder: &Path, part: Part) -> Result<()> {
        let ours = self.identity()?;
        no_file(folder)?;
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
        let path = folder.join(MAP);
        let shown = folder.display();
        if let Ok(text) = fs::read_to_string(&path) {
            let theirs: Value = serde_json::from_str(&text).unwrap_or_default();
            let all = ours.as_object().into_iter().flatten();
            let all = all.filter(|(key, _)| !SHOWN.contains(&key.as_str()));
            let differ = all.filter(|(key, value)| theirs.get(key) != Some(*value));
            let differ: Vec<&str> = differ
                .map(|(key, _)| if key == "name" { "scene" } else { key.as_str() })
                .collect();
            if differ.is_empty() {
                return Ok(());
            }
            let accepted = format!(
                "a new folder, or one of the same map; the one in {MAP} has another {}",
                differ.join(" and another ")
            );
            return Err(Error::invalid("--out", shown, accepted).into());
        }
        let others = fs::read_dir(folder).map_err(Error::io(folder))?.flatten();
        // Parts that begin at the same time have hidden files here.
        let mut others = others.filter(|it| !it.file_name().to_string_lossy().starts_with('.'));
        let hers = |it: fs::DirEntry| it.file_name() != MAP;
        if others.any(hers) && !path.exists() {
            let accepted = "a new folder, an empty one, or one of the same map";
            return Err(Error::invalid("--out", shown, accepted).into());
        }
        let beside = folder.join(format!(".{MAP}.{}", part.file()));
        let text = serde_json::to_string_pretty(&ours).unwrap_or_default() + "\n";
        fs::write(&beside, text).map_err(Error::io(&beside))?;
        fs::rename(&beside, &path).map_err(Error::io(&path))?;
        Ok(())
    }

    /// What the plan of a point foresees; a point without a plan is refused when it is its turn.
    fn job(&self, index: usize, keep: bool) -> Result<Job> {
        let text = self.text(index)?;
        let plan = Plan::of(text.scene());
        let stages = plan.iter().flat_map(Plan::stages);
        let (seconds, bytes) = stages.fold((0.0, 0), |(seconds, bytes), it| {
            (seconds + it.seconds(), it.memory_bytes().max(bytes))
        });
        Ok(Job {
            index,
            seconds,
            bytes,
            allowed: text.scene().accuracy.max_memory,
            plan: plan.ok().filter(|_| keep).map(Box::new),
        })
    }
}

/// A pool of threads of its own: what a point computes in parallel stays on them.
fn pool(threads: usize) -> Result<ThreadPool> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|error| {
        let accepted = format!("as many threads as the system gives: {error}");
        MapError::Other(Error::invalid("--threads", threads, accepted))
    })
}

/// Jobs that get all threads, one after another, and those that get one each, the longest first. A job is large where
/// the others would end before it and leave threads idle, or where `threads` of its memory are not allowed.
fn in_order(mut jobs: Vec<Job>, threads: usize) -> (Vec<Job>, Vec<Job>) {
    let longest = |a: &Job, b: &Job| b.seconds.total_cmp(&a.seconds).then(a.index.cmp(&b.index));
    jobs.sort_unstable_by(longest);
    if threads == 1 {
        return (Vec::new(), jobs);
    }
    let heavy = |it: &Job| it.bytes.saturating_mul(threads as u64) > it.allowed;
    let (mut large, mut small): (Vec<Job>, Vec<Job>) = jobs.into_iter().partition(heavy);
    let mut left: f64 = small.iter().map(|it| it.seconds).sum();
    let others = (threads - 1) as f64;
    let long = small.iter().take_while(|it| {
        left -= it.seconds;
        it.seconds * others > left.max(0.0)
    });
    let rest = small.split_off(long.count());
    large.append(&mut small);
    (large, rest)
}

/// A part on its way.
struct Run<'a> {
    map: &'a Map,
    lines: &'a Lines,
    watch: &'a dyn Watch,
    start: Instant,
    /// Seconds by the plans of all points.
    foreseen: f64,
    points: usize,
    state: Mutex<State>,
}

struct State {
    tally: Tally,
    /// Of the seconds foreseen.
    behind: f64,
    /// Why no more points are begun.
    stopped: Option<MapError>,
}

impl Run<'_> {
    /// Computes the points, one on each thread at a time.
    fn each_on_one_thread(&self, jobs: &[Job], threads: usize) -> Result<()> {
        let pools: Vec<ThreadPool> = (0..threads.min(jobs.len()))
            .map(|_| pool(1))
            .collect::<Result<_>>()?;
        let next = AtomicUsize::new(0);
        let work = || {
            while self.goes_on()
                && let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed))
            {
                self.point(job);
            }
        };
        std::thread::scope(|scope| {
            for pool in &pools {
                scope.spawn(|| pool.install(work));
            }
        });
        Ok(())
    }

    fn point(&self, job: &Job) {
        let ended = match job.plan.as_deref() {
            Some(plan) => Ok(self.map.line_of(job.index, plan.scene(), Some(plan))),
            None => {
                let text = self.map.text(job.index);
                text.map(|text| self.map.line_of(job.index, text.scene(), None))
            }
        };
        let written = ended.and_then(|line| Ok(self.lines.write(line)?));
        let (computed, behind) = {
            let mut state = self.state();
            match written {
                Ok(ending) => {
                    state.tally.computed += 1;
                    state.tally.count(ending);
                }
                Err(error) => state.stopped = Some(error),
            }
            state.behind += job.seconds;
            (state.tally.computed, state.behind)
        };
        self.tell(computed, behind);
    }

    fn tell(&self, computed: usize, behind: f64) {
        self.watch.progress(&Progress {
            points: self.points,
            computed,
            share: behind / self.foreseen.max(f64::MIN_POSITIVE),
            seconds: self.start.elapsed().as_secs_f64(),
        });
    }

    fn goes_on(&self) -> bool {
        !self.watch.stops() && self.state().stopped.is_none()
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn ended(&self) -> Result<Tally> {
        let mut state = self.state();
        state.tally.seconds = self.start.elapsed().as_secs_f64();
        match state.stopped.take() {
            Some(error) => Err(error),
            None => Ok(state.tally),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jobs(seconds: &[f64]) -> Vec<Job> {
        let job = |(index, seconds): (usize, &f64)| Job {
            index,
            seconds: *seconds,
            bytes: 1,
            allowed: 100,
            plan: None,
        };
        seconds.iter().enumerate().map(job).collect()
    }

    #[test]
    fn the_longest_point_comes_first_and_one_that_the_others_cannot_fill_gets_all_threads() {
        let order = |seconds: &[f64], threads: usize| {
            let (large, small) = in_order(jobs(seconds), threads);
            let indices = |it: Vec<Job>| it.iter().map(|it| it.index).collect::<Vec<_>>();
            (indices(large), indices(small))
        };
        assert_eq!(order(&[1.0, 3.0, 2.0, 1.0], 2), (vec![], vec![1, 2, 0, 3]));
        assert_eq!(order(&[1.0, 9.0, 1.0, 1.0], 2), (vec![1], vec![0, 2, 3]));
        assert_eq!(order(&[1.0, 9.0], 1), (vec![], vec![1, 0]));
        assert_eq!(order(&[5.0], 2), (vec![0], vec![]));
        assert_eq!(order(&[1.0, 1.0], 2), (vec![], vec![0, 1]));
        assert_eq!(order(&[], 2), (vec![], vec![]));
        // Two of it would take more memory than the scene allows.
        let mut heavy = jobs(&[1.0, 1.0, 1.0, 1.0]);
        heavy[2].bytes = 51;
        assert_eq!(in_order(heavy, 2).0[0].index, 2);
    }
}
