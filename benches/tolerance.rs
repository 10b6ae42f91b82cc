//! What certainty costs: the program's time for a tolerance over that of the cheapest single run whose true errors pass.
//! `cargo bench --bench tolerance [-- SCENE...]`; milliseconds are the least of several runs.
//!
//! The cheapest run is found by search over cells, steps and domains, its errors being those against a reference on a mesh
//! far finer: nobody can know it beforehand. Set-up is the plan; "last" is the finest run of the program, made alone.

use std::io::Write;
use std::time::Instant;
use vibroimpact::contact::ContactLaw::{self, Bilinear, Hertz};
use vibroimpact::fokker_planck::{Settings, Transient, transient, transient_cost, uncertified};
use vibroimpact::initial::Initial;
use vibroimpact::moments::{Moment, Moments};
use vibroimpact::oscillator::Oscillator;
use vibroimpact::scales::Scales;

const TOLERANCES: [f64; 5] = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6];

/// The seconds a run of the program may take.
const SECONDS: f64 = 60.0;

/// Means and deviations of a Gaussian initial condition.
type Start = Option<([f64; 2], [f64; 2])>;

/// Name, contact, zeta, h, initial condition (none: at rest), output times.
type Case = (&'static str, ContactLaw, f64, f64, Start, &'static [f64]);

const SCENES: [Case; 10] = [
    (
        "A",
        Hertz,
        0.005,
        2e-3,
        Some(([1.0, 0.0], [0.4, 0.4])),
        &[5.0, 10.0, 20.0],
    ),
    (
        "H",
        Hertz,
        0.005,
        2e-3,
        Some(([0.0, 0.0], [0.3, 0.3])),
        &[50.0],
    ),
    (
        "low",
        Hertz,
        0.005,
        8e-5,
        Some(([0.1, 0.0], [0.08, 0.08])),
        &[5.0, 20.0, 60.0],
    ),
    (
        "mid",
        Hertz,
        0.05,
        2e-2,
        Some(([0.5, 0.5], [0.5, 0.5])),
        &[3.0, 10.0],
    ),
    ("rest", Hertz, 0.005, 2e-3, None, &[5.0, 20.0, 50.0]),
    (
        "displaced",
        Hertz,
        0.005,
        2e-3,
        Some(([2.0, 0.0], [0.4, 0.4])),
        &[5.0, 10.0, 20.0],
    ),
    (
        "overdamped",
        Hertz,
        3.0,
        1.2,
        Some(([1.0, 0.0], [0.4, 0.4])),
        &[0.5, 1.0, 4.0],
    ),
    (
        "bilinear",
        Bilinear,
        0.005,
        2e-3,
        Some(([1.0, 0.0], [0.4, 0.4])),
        &[5.0, 10.0, 20.0],
    ),
    (
        "h = 0.3",
        Hertz,
        0.005,
        0.3,
        Some(([0.0, 9.71], [2.0, 2.9])),
        &[60.0],
    ),
    (
        "zeta = 0.5",
        Hertz,
        0.5,
        0.2,
        Some(([0.5, 0.5], [0.5, 0.5])),
        &[1.0, 3.0],
    ),
];

struct Scene {
    oscillator: Oscillator,
    initial: Initial,
    times: &'static [f64],
    reference: Vec<Moments>,
}

/// The least milliseconds of the runs that fit in some seconds, or of one.
fn time<T>(run: impl Fn() -> T, seconds: f64) -> (T, f64) {
    let mut least = f64::INFINITY;
    let began = Instant::now();
    loop {
        let clock = Instant::now();
        let it = run();
        least = least.min(1e3 * clock.elapsed().as_secs_f64());
        if began.elapsed().as_secs_f64() > seconds {
            return (it, least);
        }
    }
}

impl Scene {
    fn once(&self, settings: &Settings) -> Option<Vec<Moments>> {
        uncertified(&self.oscillator, &self.initial, self.times, settings).ok()
    }

    fn program(&self, settings: &Settings) -> Option<Transient> {
        transient(
            &self.oscillator,
            &self.initial,
            self.times,
            &[],
            settings,
            &|_| (),
        )
        .ok()
    }

    /// The largest true error over the normalisation.
    fn error(&self, moments: &[Moments]) -> f64 {
        let scales = Scales::of(&self.oscillator);
        let mut worst = 0.0_f64;
        for (it, known) in moments.iter().zip(&self.reference) {
            for (moment, scale) in Moment::ALL.into_iter().zip(scales.each(known)) {
                if let (Some(it), Some(known)) = (it.get(moment), known.get(moment)) {
                    let error = (it.value - known.value).abs() / scale;
                    worst = if error.is_nan() {
                        f64::INFINITY
                    } else {
                        worst.max(error)
                    };
                }
            }
        }
        worst
    }

    /// Runs of fixed cells, step and domain, the cheapest first.
    fn candidates(&self, cells: [usize; 2]) -> Vec<(f64, Settings)> {
        let mut all = Vec::new();
        for k in 0..22 {
            let cells = cells.map(|n| 2 * ((0.12 * n as f64 * 1.15_f64.powi(k)) as usize / 2));
            for step in [1.5, 1.1, 0.8, 0.6, 0.42, 0.3, 0.2, 0.14, 0.1] {
                for neglected in [1e-4, 1e-5, 1e-6, 1e-8] {
                    let steps: f64 = self
                        .times
                        .iter()
                        .fold((0.0, 0.0), |(sum, last), t| {
                            (sum + ((t - last) / step).ceil(), *t)
                        })
                        .0;
                    let work = cells[0] as f64 * cells[1] as f64 * (steps + 20.0);
                    let settings = Settings {
                        cells: Some(cells),
                        step: Some(step),
                        neglected: Some(neglected),
                        ..Settings::default()
                    };
                    all.push((work, settings));
                }
            }
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all
    }
}

/// One run with its true error.
struct Single<'a> {
    work: f64,
    error: f64,
    settings: &'a Settings,
    /// Milliseconds on one thread, once they are known.
    ms: Option<f64>,
}

/// What passes may be foreseen to take up to so many times the work of the first that does: the clock decides.
const MARGIN: f64 = 2.0;

/// The lines of a scene, one a tolerance; `ratios` is told what one thread takes over the cheapest run.
fn survey(
    name: &str,
    scene: &Scene,
    candidates: &[(f64, Settings)],
    ratios: &mut Vec<f64>,
    line: &mut dyn FnMut(String),
) {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let one = one.expect("one thread");
    let mut untried = candidates.iter();
    let mut tried: Vec<Single> = Vec::new();
    for tolerance in TOLERANCES {
        let passes = |it: &Single| it.error <= tolerance;
        let enough = |tried: &[Single]| {
            let first = tried.iter().find(|it| passes(it));
            first.map_or(f64::INFINITY, |it| MARGIN * it.work)
        };
        while tried.last().is_none_or(|it| it.work < enough(&tried)) {
            let Some((work, settings)) = untried.next() else {
                break;
            };
            if let Some(moments) = scene.once(settings) {
                tried.push(Single {
                    work: *work,
                    error: scene.error(&moments),
                    settings,
                    ms: None,
                });
            }
        }
        let timed = tried.iter_mut().filter(|it| passes(it)).map(|it| {
            let run = || one.install(|| scene.once(it.settings));
            let ms = *it.ms.get_or_insert_with(|| time(run, 0.02).1);
            (it.error, ms, it.settings)
        });
        let best = timed.min_by(|a, b| a.1.total_cmp(&b.1));
        let settings = Settings {
            tolerance,
            max_seconds: SECONDS,
            ..Settings::default()
        };
        let (_, planned) = time(
            || transient_cost(&scene.oscillator, &scene.initial, scene.times, &settings),
            0.3,
        );
        let (answer, ms) = time(|| scene.program(&settings), 0.3);
        let (_, alone) = time(|| one.install(|| scene.program(&settings)), 0.3);
        let Some(it) = answer else {
            line(format!(
                "{name:<12}{tolerance:<10.0e} | the program has no answer"
            ));
            continue;
        };
        let last = Settings {
            cells: Some(it.method.cells),
            step: Some(it.method.step),
            ..settings.clone()
        };
        let (_, last) = time(|| scene.once(&last), 0.3);
        let error = scene.error(&it.moments);
        let [q, v] = it.method.cells;
        let said = it.shortfall.as_ref().map_or("met".into(), |it| {
            format!("{:.1} times too large", it.ratio)
        });
        let (found, ratio) = match best {
            None => ("none found".into(), "     -".into()),
            Some((error, least, settings)) => {
                let [q, v] = settings.cells.unwrap_or_default();
                let step = settings.step.unwrap_or_default();
                if tolerance > 5e-6 {
                    ratios.push(alone / least);
                }
                (
                    format!(
                        "{:<16}{least:>10.2}{error:>9.0e}",
                        format!("{q} x {v}, {step}")
                    ),
                    format!("{:6.1}", alone / least),
                )
            }
        };
        line(format!(
            "{name:<12}{tolerance:<10.0e} | {found:<35} | {:<11}{ms:>8.1}{alone:>8.1}{planned:>8.1}{last:>7.1}{error:>9.0e} | {ratio}| {said}",
            format!("{q} x {v}")
        ));
    }
}

fn main() {
    let asked: Vec<String> = std::env::args()
        .skip(1)
        .filter(|it| !it.starts_with('-'))
        .collect();
    let mut out = std::io::stdout().lock();
    let mut line = |text: String| {
        let _ = writeln!(out, "{text}");
        let _ = out.flush();
    };
    line("                       | cheapest run that passes            | program: all threads, one thread, its parts           |       |     ".into());
    line("scene       tolerance  | cells, step            ms    error  | cells           ms     one  set-up   last    error  | ratio | said".into());
    let mut ratios = Vec::new();
    for (name, contact, zeta, h, start, times) in SCENES {
        if !asked.is_empty() && !asked.iter().any(|it| it == name) {
            continue;
        }
        let mut scene = Scene {
            oscillator: Oscillator::new(contact, zeta, h).expect("a level above 0"),
            initial: start.map_or(Initial::Rest, |(mean, deviation)| {
                Initial::gaussian(mean, deviation).expect("deviations above 0")
            }),
            times,
            reference: Vec::new(),
        };
        let finest = Settings {
            tolerance: 2e-8,
            max_seconds: 3.0 * SECONDS,
            ..Settings::default()
        };
        scene.reference = scene.once(&finest).expect("a reference");
        let cells = transient_cost(&scene.oscillator, &scene.initial, times, &finest)
            .expect("its cells")
            .0
            .cells;
        let candidates = scene.candidates(cells);
        survey(name, &scene, &candidates, &mut ratios, &mut line);
    }
    ratios.sort_by(f64::total_cmp);
    if let [.., most] = ratios[..] {
        let median = ratios[ratios.len() / 2];
        line(format!(
            "one thread over the cheapest run, 1e-2 to 1e-5: median {median:.1}, largest {most:.1}, of {}",
            ratios.len()
        ));
    }
}
