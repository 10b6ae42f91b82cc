//! Work on threads of its own, while this thread waits without the GIL and looks for signals.

use pyo3::exceptions::{PyOSError, PyRuntimeError};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Mutex;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};
use vibroimpact::plan::StopFlag;

/// Between two looks at signals.
const TICK: Duration = Duration::from_millis(50);

/// For work to end after it was told to; what cannot be stopped half way is left to end by itself, unheard.
const GRACE: Duration = Duration::from_millis(700);

/// Stack of a thread: that of a main thread, which the program computes on.
const STACK: usize = 8 << 20;

/// The pool of the last work that has ended: most work is followed by more of the same.
static IDLE: Mutex<Option<Pool>> = Mutex::new(None);

struct Pool {
    /// A child process does not inherit its parent's threads.
    process: u32,
    threads: usize,
    pool: ThreadPool,
}

impl Pool {
    /// The idle one if it fits, else a new one. The environment has no say in its size.
    fn take(threads: Option<usize>) -> PyResult<Self> {
        let all = || std::thread::available_parallelism().map_or(1, usize::from);
        let (process, threads) = (std::process::id(), threads.unwrap_or_else(all));
        // A lock that another thread held when the process was forked is never released.
        let idle = IDLE.try_lock().ok().and_then(|mut it| it.take());
        match idle {
            Some(it) if it.process != process => std::mem::forget(it),
            Some(it) if it.threads == threads => return Ok(it),
            _ => (),
        }
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .stack_size(STACK)
            .build()
            .map_err(|error| PyOSError::new_err(format!("{threads} threads: {error}")))?;
        Ok(Self {
            process,
            threads,
            pool,
        })
    }

    fn put_back(self) {
        if let Ok(mut idle) = IDLE.try_lock() {
            *idle = Some(self);
        }
    }
}

/// What `job` returns, computed on `threads` threads (None: as many as there are cores). `tick` is called now and then
/// on this thread. Where it fails, or a signal's handler does, `stop` is raised and that error returned.
pub(crate) fn compute<T: Send + 'static>(
    py: Python<'_>,
    threads: Option<usize>,
    stop: &StopFlag,
    mut tick: impl FnMut(Python<'_>) -> PyResult<()>,
    job: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    let pool = Pool::take(threads)?;
    let (answer, mut waiting) = mpsc::channel();
    // Nobody listens any more after an interrupt.
    pool.pool.spawn(move || {
        let _ = answer.send(catch_unwind(AssertUnwindSafe(job)));
    });
    let mut interrupt: Option<(PyErr, Instant)> = None;
    loop {
        let told;
        (waiting, told) = py.detach(move || {
            let told = waiting.recv_timeout(TICK);
            (waiting, told)
        });
        match told {
            Ok(it) => {
                pool.put_back();
                return match (it, interrupt) {
                    (_, Some((error, _))) => Err(error),
                    (Ok(it), None) => tick(py).map(|()| it),
                    (Err(panic), None) => resume_unwind(panic),
                };
            }
            Err(RecvTimeoutError::Timeout) => match interrupt {
                Some((error, since)) if since.elapsed() > GRACE => return Err(error),
                Some(_) => (),
                None => {
                    if let Err(error) = py.check_signals().and_then(|()| tick(py)) {
                        stop.raise();
                        interrupt = Some((error, Instant::now()));
                    }
                }
            },
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err("the work ended without an answer"));
            }
        }
    }
}
