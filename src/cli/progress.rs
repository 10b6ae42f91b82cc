//! How far a run is: a bar on a terminal, else a line now and then.

use crate::error::Result;
use crate::format::seconds;
use crate::map;
use crate::plan::{Part, StopFlag, Watch};
use crate::results::Results;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use signal_hook::consts::{SIGINT, SIGTERM};
use std::io::{self, Write};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Progress over a number of jobs; hidden where nothing but errors is printed, and by itself where standard error is
/// not a terminal.
pub fn progress(jobs: usize, quiet: bool) -> ProgressBar {
    let template = "{bar:30} {pos}/{len}  {eta} left  {msg}";
    bar(jobs as u64, quiet, template)
}

pub(super) fn bar(length: u64, quiet: bool, template: &str) -> ProgressBar {
    let target = if quiet {
        ProgressDrawTarget::hidden()
    } else {
        ProgressDrawTarget::stderr()
    };
    let style = ProgressStyle::with_template(template);
    ProgressBar::with_draw_target(Some(length), target)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Watches a run: a progress bar on a terminal, else a line now and then. The first Ctrl-C, or a batch system's
/// request to end, ends the run where it next looks at the clock, the second at once.
pub(super) struct Observer {
    pub(super) bar: Mutex<ProgressBar>,
    pub(super) quiet: bool,
    pub(super) stop: StopFlag,
    /// The signal that ended it.
    signal: Arc<AtomicUsize>,
    /// When the stage began, and when it was last told of.
    pub(super) told: Mutex<(Instant, Instant)>,
}

impl Observer {
    /// Seconds between lines in the log of a batch job, of a map too: a run that is shorter prints none.
    const PAUSE: u64 = 60;

    pub(super) fn new(quiet: bool) -> Self {
        let (stop, now) = (StopFlag::default(), Instant::now());
        let which = Arc::new(AtomicUsize::new(SIGINT as usize));
        // Where signals cannot be caught the program ends as any other.
        for signal in [SIGINT, SIGTERM] {
            let again = signal_hook::flag::register_conditional_default(signal, stop.shared());
            let first = signal_hook::flag::register(signal, stop.shared());
            let own = signal_hook::flag::register_usize(signal, which.clone(), signal as usize);
            let _ = again.and(first).and(own);
        }
        Self {
            bar: Mutex::new(ProgressBar::hidden()),
            quiet,
            stop,
            signal: which,
            told: Mutex::new((now, now)),
        }
    }

    /// The signal that ended it.
    pub(super) fn signal(&self) -> i32 {
        self.signal.load(Ordering::Relaxed) as i32
    }

    pub(super) fn clear(&self) {
        if let Ok(bar) = self.bar.lock() {
            bar.finish_and_clear();
        }
    }

    /// A line on standard error where there is no bar.
    fn tell(&self, part: Part, fraction: f64) {
        let Ok(mut told) = self.told.lock() else {
            return;
        };
        let (began, last) = *told;
        if last.elapsed().as_secs() < Self::PAUSE || fraction >= 1.0 {
            return;
        }
        told.1 = Instant::now();
        let spent = began.elapsed().as_secs_f64();
        let left = if fraction > 0.01 {
            format!(", about {} left", seconds(spent * (1.0 / fraction - 1.0)))
        } else {
            String::new()
        };
        let done = 100.0 * fraction;
        let _ = writeln!(io::stderr(), "{}: {done:.0} %{left}", part.name());
    }
}

impl Watch for Observer {
    fn begins(&self, part: Part) {
        let template = "{msg:<12} {bar:40} {percent:>3} %  {eta} left";
        let bar = bar(1000, self.quiet, template).with_message(part.name());
        bar.tick();
        if let Ok(mut old) = self.bar.lock() {
            old.finish_and_clear();
            *old = bar;
        }
        if let Ok(mut told) = self.told.lock() {
            told.0 = Instant::now();
        }
    }

    fn progress(&self, part: Part, fraction: f64) {
        let Ok(bar) = self.bar.lock() else {
            return;
        };
        let fraction = fraction.clamp(0.0, 1.0);
        let done = (fraction * 1000.0) as u64;
        bar.set_position(done.max(bar.position()));
        if !self.quiet && bar.is_hidden() {
            self.tell(part, fraction);
        }
    }

    fn ends(&self, _: Part, _: &Results) -> Result<()> {
        self.clear();
        Ok(())
    }

    fn stop(&self) -> StopFlag {
        self.stop.clone()
    }
}

/// Shows how a map goes on: a bar on a terminal, else a line now and then.
pub(super) struct MapWatch {
    pub(super) bar: ProgressBar,
    pub(super) quiet: bool,
    pub(super) told: Mutex<Instant>,
}

impl map::Watch for MapWatch {
    fn progress(&self, it: &map::Progress) {
        let left = it.left().map_or("-".into(), seconds);
        let words = format!("{left} left  {:.3} points/s", it.rate());
        self.bar.set_length(it.points as u64);
        self.bar.set_position(it.computed as u64);
        self.bar.set_message(words.clone());
        if let Ok(mut told) = self.told.lock()
            && !self.quiet
            && self.bar.is_hidden()
            && told.elapsed().as_secs() >= Observer::PAUSE
        {
            *told = Instant::now();
            let (computed, points) = (it.computed, it.points);
            let _ = writeln!(io::stderr(), "{computed}/{points} points  {words}");
        }
    }
}
