//! What certainty costs: the program's time for a tolerance over that of the cheapest single run whose true errors pass.
//! `cargo bench --bench tolerance [-- SCENE...]`; milliseconds are the least of several runs.
//!
//! The cheapest run is found by search over cells, steps and domains, its errors being those against a reference on a mesh
//! far finer: nobody can know it beforehand. Set-up is the plan; "last" is the finest run of the program, made alone.

use std::io::Write;
use std::time::Instant;
use vibroimpact::contact::ContactLaw::{self, Bilinear, Hertz};
use vibroimpact::estimate::Shortfall;
use vibroimpact::excitation::{Drive, Excitation};
use vibroimpact::fokker_planck::{
    Settings, periodic, response, transient, transient_cost, uncertified, uncertified_periodic,
};
use vibroimpact::initial::Initial;
use vibroimpact::moments::{Moment, Moments};
use vibroimpact::oscillator::Oscillator;
use vibroimpact::scales::Scales;

const TOLERANCES: [f64; 5] = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6];

/// The seconds a run of the program may take.
const SECONDS: f64 = 60.0;

/// Seconds of the search for the cheapest run, at a tolerance.
const SEARCH: f64 = 20.0;

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

/// Name, contact, zeta, h, amplitude and frequencies of a drive: the periodic law at one, a response curve over several.
type Driven = (&'static str, ContactLaw, f64, f64, f64, &'static [f64]);

const DRIVEN: [Driven; 3] = [
    ("periodic", Hertz, 0.005, 2e-3, 0.02, &[0.95]),
    ("loud drive", Hertz, 0.05, 2e-2, 0.5, &[0.8]),
    (
        "response",
        Hertz,
        0.005,
        2e-3,
        0.02,
        &[0.8, 0.9, 0.95, 1.0, 1.1],
    ),
];

/// What is asked.
enum Asked {
    Transient(Initial, &'static [f64]),
    /// All moments at so many phases, with the multipliers.
    Periodic(usize, Drive),
    /// Harmonics of E[q] and E[N] and the probability of a loss at these frequencies.
    Response(Vec<Drive>),
}

struct Scene {
    oscillator: Oscillator,
    asked: Asked,
    reference: Vec<Scaled>,
}

/// A number with its normalisation.
type Scaled = (f64, f64);

/// What the program says.
struct Answer {
    numbers: Vec<f64>,
    /// None for a curve, every point of which has its own.
    method: Option<([usize; 2], f64)>,
    shortfall: Option<Shortfall>,
}

/// All numbers there are.
fn all(scales: &Scales, moments: &[Moments]) -> Vec<Scaled> {
    let values = |it: &Moments| {
        let scales = scales.each(it);
        Moment::ALL.map(|moment| Some((it.get(moment)?.value, scales[moment as usize])))
    };
    moments.iter().flat_map(values).flatten().collect()
}

/// Phases of a point of a response curve.
const PHASES: usize = 16;

/// The numbers of a point of a response curve: harmonics 1 and 2 of E[q], 1 of E[N], the mean of P(loss).
fn harmonics(scales: &Scales, moments: &[Moments]) -> [Scaled; 4] {
    let n = moments.len() as f64;
    let scales = scales.each(&moments[0]);
    let [q, force] = [Moment::MeanQ, Moment::MeanForce].map(|it| scales[it as usize]);
    let value = |it: &Moments, moment| it.get(moment).map_or(0.0, |it| it.value);
    let amplitude = |moment: Moment, number: f64| {
        let (mut cosine, mut sine) = (0.0, 0.0);
        for (k, it) in moments.iter().enumerate() {
            let angle = std::f64::consts::TAU * number * k as f64 / n;
            cosine += value(it, moment) * angle.cos() * 2.0 / n;
            sine += value(it, moment) * angle.sin() * 2.0 / n;
        }
        f64::hypot(cosine, sine)
    };
    let lost = moments
        .iter()
        .map(|it| value(it, Moment::ContactLossProbability));
    [
        (amplitude(Moment::MeanQ, 1.0), q),
        (amplitude(Moment::MeanQ, 2.0), q),
        (amplitude(Moment::MeanForce, 1.0), force),
        (lost.sum::<f64>() / n, 1.0),
    ]
}

fn under(drive: Drive, settings: &Settings) -> Settings {
    Settings {
        excitation: Excitation {
            drive: Some(drive),
            envelope: None,
        },
        ..settings.clone()
    }
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
    /// The numbers of one run.
    fn once(&self, settings: &Settings) -> Option<Vec<Scaled>> {
        let (it, scales) = (&self.oscillator, Scales::of(&self.oscillator));
        match &self.asked {
            Asked::Transient(initial, times) => {
                let moments = uncertified(it, initial, times, settings).ok()?;
                Some(all(&scales, &moments))
            }
            Asked::Periodic(phases, drive) => {
                let settings = under(*drive, settings);
                let moments = uncertified_periodic(it, *phases, &settings).ok()?;
                Some(all(&scales, &moments))
            }
            Asked::Response(drives) => {
                let point = |drive: &Drive| {
                    let settings = under(*drive, settings);
                    uncertified_periodic(it, PHASES, &settings).ok()
                };
                let points: Option<Vec<_>> = drives.iter().map(point).collect();
                Some(
                    points?
                        .iter()
                        .flat_map(|it| harmonics(&scales, it))
                        .collect(),
                )
            }
        }
    }

    fn program(&self, settings: &Settings) -> Option<Answer> {
        let (it, quiet) = (&self.oscillator, &|_| ());
        let scales = Scales::of(it);
        let plain = |moments: &[Moments]| all(&scales, moments).iter().map(|it| it.0).collect();
        Some(match &self.asked {
            Asked::Transient(initial, times) => {
                let it = transient(it, initial, times, &[], settings, quiet).ok()?;
                Answer {
                    numbers: plain(&it.moments),
                    method: Some((it.method.cells, it.method.step)),
                    shortfall: it.shortfall,
                }
            }
            Asked::Periodic(phases, drive) => {
                let it = periodic(it, *phases, &under(*drive, settings), quiet).ok()?;
                Answer {
                    numbers: plain(&it.moments),
                    method: Some((it.method.cells, it.method.step)),
                    shortfall: it.shortfall,
                }
            }
            Asked::Response(drives) => {
                let frequencies: Vec<f64> = drives.iter().map(Drive::frequency).collect();
                let it = response(it, &frequencies, &under(drives[0], settings), quiet).ok()?;
                let lost = it.contact_loss_probability.as_ref()?;
                let point =
                    |k: usize| [it.mean_q_1[k], it.mean_q_2[k], it.mean_force_1[k], lost[k]];
                let points = (0..frequencies.len()).flat_map(point);
                Answer {
                    numbers: points.map(|it| it.value).collect(),
                    method: None,
                    shortfall: it.shortfall,
                }
            }
        })
    }

    /// What [`Scene::candidates`] are made from: the cells of a tolerance that is tight, and the milliseconds of a plan.
    fn planned(&self, settings: &Settings) -> ([usize; 2], f64) {
        match &self.asked {
            Asked::Transient(initial, times) => {
                let (cost, ms) = time(
                    || transient_cost(&self.oscillator, initial, times, settings),
                    0.3,
                );
                (cost.expect("a recipe").0.cells.expect("its cells"), ms)
            }
            // Of the law at rest, which has the domain but for the drive's swing.
            Asked::Periodic(..) | Asked::Response(_) => {
                let initial = Initial::Stationary;
                let (cost, ms) = time(
                    || transient_cost(&self.oscillator, &initial, &[1.0], settings),
                    0.3,
                );
                (cost.expect("a recipe").0.cells.expect("its cells"), ms)
            }
        }
    }

    /// Times at which steps end.
    fn stops(&self) -> Vec<f64> {
        match &self.asked {
            Asked::Transient(_, times) => times.to_vec(),
            Asked::Periodic(_, drive) => vec![drive.period()],
            Asked::Response(drives) => vec![drives[0].period()],
        }
    }

    /// The largest true error over the normalisation.
    fn error(&self, numbers: impl IntoIterator<Item = f64>) -> f64 {
        let mut worst = 0.0_f64;
        for (it, (known, scale)) in numbers.into_iter().zip(&self.reference) {
            let error = (it - known).abs() / scale;
            worst = if error.is_nan() {
                f64::INFINITY
            } else {
                worst.max(error)
            };
        }
        worst
    }

    /// Passes over cells that a run takes.
    fn work(&self, cells: [usize; 2], step: f64) -> f64 {
        let steps = |(sum, last): (f64, f64), t: &f64| (sum + ((t - last) / step).ceil(), *t);
        let (steps, _) = self.stops().iter().fold((0.0, 0.0), steps);
        cells[0] as f64 * cells[1] as f64 * (steps + 20.0)
    }

    /// Runs of fixed cells, step and domain, the cheapest first.
    fn candidates(&self, cells: [usize; 2]) -> Vec<(f64, Settings)> {
        let mut all = Vec::new();
        // Friction shortens the steps.
        let longest = 1.5 / self.oscillator.zeta().max(1.0);
        for k in 0..22 {
            let cells = cells.map(|n| 2 * ((0.12 * n as f64 * 1.15_f64.powi(k)) as usize / 2));
            for shorter in [1.0, 1.4, 1.9, 2.5, 3.6, 5.0, 7.5, 11.0, 15.0, 22.0, 30.0] {
                let step = longest / shorter;
                for neglected in [1e-4, 1e-5, 1e-6, 1e-8] {
                    let settings = Settings {
                        cells: Some(cells),
                        step: Some(step),
                        neglected: Some(neglected),
                        ..Settings::default()
                    };
                    all.push((self.work(cells, step), settings));
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
    (candidates, tolerances): (&[(f64, Settings)], &[f64]),
    ratios: &mut Vec<f64>,
    line: &mut dyn FnMut(String),
) {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let one = one.expect("one thread");
    let mut untried = candidates.iter();
    let mut tried: Vec<Single> = Vec::new();
    for &tolerance in tolerances {
        let settings = Settings {
            tolerance,
            max_seconds: SECONDS,
            ..Settings::default()
        };
        let planned = scene.planned(&settings).1;
        let (answer, ms) = time(|| scene.program(&settings), 0.3);
        let (_, alone) = time(|| one.install(|| scene.program(&settings)), 0.3);
        let Some(it) = answer else {
            line(format!(
                "{name:<12}{tolerance:<10.0e} | the program has no answer"
            ));
            continue;
        };
        let passes = |it: &Single| it.error <= tolerance;
        // The last run of the program passes: what takes many times its work is not looked for.
        let own = it
            .method
            .map_or(f64::INFINITY, |(cells, step)| 4.0 * scene.work(cells, step));
        let enough = |tried: &[Single]| {
            let first = tried.iter().find(|it| passes(it));
            first.map_or(own, |it| MARGIN * it.work)
        };
        let clock = Instant::now();
        let in_time = || clock.elapsed().as_secs_f64() < SEARCH;
        while tried.last().is_none_or(|it| it.work < enough(&tried)) && in_time() {
            let Some((work, settings)) = untried.next() else {
                break;
            };
            if let Some(numbers) = scene.once(settings) {
                tried.push(Single {
                    work: *work,
                    error: scene.error(numbers.iter().map(|it| it.0)),
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
        let (cells, last) = match it.method {
            None => ("each its own".into(), "-".into()),
            Some(([q, v], step)) => {
                let last = Settings {
                    cells: Some([q, v]),
                    step: Some(step),
                    ..settings.clone()
                };
                let (_, last) = time(|| scene.once(&last), 0.3);
                (format!("{q} x {v}"), format!("{last:.1}"))
            }
        };
        let error = scene.error(it.numbers);
        let said = it.shortfall.as_ref().map_or("met".into(), |it| {
            format!("{:.1} times too large", it.ratio())
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
                        format!("{q} x {v}, {step:.2}")
                    ),
                    format!("{:6.1}", alone / least),
                )
            }
        };
        line(format!(
            "{name:<12}{tolerance:<10.0e} | {found:<35} | {cells:<12}{ms:>8.1}{alone:>8.1}{planned:>8.1}{last:>7}{error:>9.0e} | {ratio}| {said}"
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
    line("                       | cheapest run that passes            | program: all threads, one thread, its parts            |       |     ".into());
    line("scene       tolerance  | cells, step            ms    error  | cells            ms     one  set-up   last    error  | ratio | said".into());
    let mut ratios = Vec::new();
    let oscillator = |contact, zeta, h| Oscillator::new(contact, zeta, h).expect("a level above 0");
    let transients = SCENES
        .into_iter()
        .map(|(name, contact, zeta, h, start, times)| {
            let initial = start.map_or(Initial::Rest, |(mean, deviation)| {
                Initial::gaussian(mean, deviation).expect("deviations above 0")
            });
            let asked = Asked::Transient(initial, times);
            (name, oscillator(contact, zeta, h), asked)
        });
    let driven = DRIVEN
        .into_iter()
        .map(|(name, contact, zeta, h, a, frequencies)| {
            let drive = |w: &f64| Drive::new(a, *w, 0.0).expect("a frequency above 0");
            let asked = match frequencies {
                [w] => Asked::Periodic(32, drive(w)),
                all => Asked::Response(all.iter().map(drive).collect()),
            };
            (name, oscillator(contact, zeta, h), asked)
        });
    for (name, oscillator, asked_for) in transients.chain(driven) {
        if !asked.is_empty() && !asked.iter().any(|it| it == name) {
            continue;
        }
        let mut scene = Scene {
            oscillator,
            asked: asked_for,
            reference: Vec::new(),
        };
        let finest = Settings {
            tolerance: 2e-8,
            max_seconds: 3.0 * SECONDS,
            ..Settings::default()
        };
        // A law that lasts takes sixty periods a run.
        let fine = Settings {
            tolerance: match scene.asked {
                Asked::Transient(..) => 2e-8,
                _ => 1e-6,
            },
            ..finest.clone()
        };
        scene.reference = scene.once(&fine).expect("a reference");
        let candidates = scene.candidates(scene.planned(&finest).0);
        // A fixed point is found as well as its row asks: each has its own runs.
        let rows: Vec<&[f64]> = match scene.asked {
            Asked::Transient(..) => vec![&TOLERANCES],
            _ => TOLERANCES[..3].chunks(1).collect(),
        };
        for tolerances in rows {
            let mut candidates = candidates.clone();
            if let (Asked::Periodic(..) | Asked::Response(_), [tolerance]) =
                (&scene.asked, tolerances)
            {
                for (_, settings) in &mut candidates {
                    settings.tolerance = *tolerance;
                }
            }
            survey(
                name,
                &scene,
                (&candidates, tolerances),
                &mut ratios,
                &mut line,
            );
        }
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
