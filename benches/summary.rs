//! What the hot loops cost beside bounds measured in the same run, on one core, as the table of docs/benchmarks.md:
//! `cargo bench --bench summary`. Times are the least of several rounds.

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use std::hint::black_box;
use std::io::Write;
use std::time::Instant;
use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::flow_map::{self, FlowMap};
use vibroimpact::fokker_planck::{
    Additive, Axis, Density, Drift, Generator, Integrator, Mesh, Radau, Settings, Solver,
    first_loss, spectrum, steady,
};
use vibroimpact::initial::Initial;
use vibroimpact::monte_carlo::{self, Sampling, Scheme};
use vibroimpact::oscillator::{Oscillator, Quantity};
use vibroimpact::stationary::Stationary;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

fn main() {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let rows = one.expect("a thread").install(|| {
        let mut rows = Vec::new();
        rows.extend(generator());
        rows.push(imex());
        rows.extend(solve());
        rows.push(pass());
        rows.extend(paths());
        rows.extend(stages());
        rows
    });
    let mut out = std::io::stdout().lock();
    let head = "| hot loop | time | rate | bound in the same run | time over bound |\n|---|---|---|---|---|";
    let _ = writeln!(out, "{head}");
    for row in rows {
        let _ = writeln!(out, "{row}");
    }
}

/// Least seconds of a call in nine rounds.
fn seconds(mut call: impl FnMut()) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..9 {
        let clock = Instant::now();
        call();
        best = best.min(clock.elapsed().as_secs_f64());
    }
    best
}

/// Reads an array once: sixteen sums, so that no addition waits for another.
fn read(array: &[f64]) -> f64 {
    let mut sums = [0.0; 16];
    for chunk in array.chunks_exact(16) {
        for (sum, x) in sums.iter_mut().zip(chunk) {
            *sum += x;
        }
    }
    sums.iter().sum()
}

/// A line of the table: seconds of so many units of work, and of what bounds them.
fn row(name: &str, unit: &str, count: f64, seconds: f64, bound: Option<(&str, f64)>) -> String {
    let nanoseconds = 1e9 * seconds / count;
    let rate = 1e-6 * count / seconds;
    let (words, ratio) = match bound {
        Some((words, least)) => (
            format!("{words}, {:.2} ns", 1e9 * least / count),
            format!("{:.1}", seconds / least),
        ),
        None => ("-".into(), "-".into()),
    };
    format!("| {name} | {nanoseconds:.2} ns | {rate:.3} million {unit}/s | {words} | {ratio} |")
}

fn oscillator(zeta: f64) -> Oscillator {
    // T = 0.63, as at the paper's level 2e-3.
    let h = 2.0 * zeta * 0.63 / std::f64::consts::PI;
    Oscillator::new(ContactLaw::Hertz, zeta, h).expect("a level above 0")
}

fn start() -> Initial {
    Initial::gaussian([1.0, 0.0], [0.4, 0.4]).expect("deviations above 0")
}

/// The contact in a truncated domain up to 11 T.
fn mesh(it: &Oscillator, cells: [usize; 2]) -> Mesh {
    let (contact, t) = (it.contact(), it.temperature());
    let margin = Drift::Order8.margin();
    let (left, right) = contact.turning_points(11.0 * t).expect("a confining law");
    Mesh {
        q: Axis::displacement(contact, t, [left, right], cells[0], margin).expect("enough cells"),
        v: Axis::velocity((22.0 * t).sqrt(), cells[1], margin).expect("enough cells"),
    }
}

/// dP/dt without a matrix, beside reading three arrays and writing one.
fn generator() -> Vec<String> {
    let it = oscillator(0.005);
    let mesh = mesh(&it, [300, 300]);
    let n = mesh.len();
    let g: Vec<f64> = (0..n).map(|k| (k % 17) as f64).collect();
    let (a, b, mut rate) = (g.clone(), g.clone(), vec![0.0; n]);
    let memory = seconds(|| {
        let sources = g.iter().zip(&a).zip(&b);
        for (rate, ((g, a), b)) in rate.iter_mut().zip(black_box(sources)) {
            *rate = g + a + b;
        }
    });
    Drift::ALL
        .into_iter()
        .map(|drift| {
            let generator = Generator::new(&it, &mesh, drift).expect("a generator");
            let all = seconds(|| generator.apply(black_box(&g), &mut rate));
            let bound = Some(("four arrays once", memory));
            let name = match drift {
                Drift::Upwind => "generator, upwind".to_string(),
                _ => format!("generator, order {}", drift.order()),
            };
            row(&name, "cells", n as f64, all, bound)
        })
        .collect()
}

/// A step of the additive scheme: six transports and five banded solves.
fn imex() -> String {
    let it = oscillator(0.5);
    let generator =
        Generator::new(&it, &mesh(&it, [300, 300]), Drift::Order8).expect("a generator");
    let n = generator.mesh().len();
    let mut cells = density(&generator).cells().to_vec();
    let mut scheme = Additive::new(&generator);
    let dt = 0.5 * scheme.longest_step();
    let mut step = || scheme.advance(&mut cells, dt, 0.0).expect("a step");
    step();
    let all = seconds(step);
    let g = vec![1.0; n];
    let mut rate = vec![0.0; n];
    let transports = seconds(|| {
        for _ in 0..6 {
            generator.apply(black_box(&g), &mut rate);
        }
    });
    let bound = Some(("six generators", transports));
    row("IMEX step, order 8", "cells", n as f64, all, bound)
}

fn density(generator: &Generator) -> Density {
    Density::start(generator, &start()).expect("a start the mesh holds")
}

/// A step of Radau IIA by LU and by preconditioned GMRES, beside reading what the factors hold, on meshes that grow.
fn solve() -> Vec<String> {
    let it = oscillator(5.0);
    let mut rows = Vec::new();
    for n in [60, 90, 130] {
        let mesh = mesh(&it, [n, 3 * n / 4]);
        let generator = Generator::new(&it, &mesh, Drift::Order8).expect("a generator");
        for (solver, how) in [(Solver::Direct, "LU"), (Solver::Krylov, "GMRES")] {
            let mut cells = density(&generator).cells().to_vec();
            let region = Region::new(ALLOCATOR);
            let clock = Instant::now();
            let mut scheme = Radau::new(&generator, solver);
            scheme.advance(&mut cells, 0.5, 1e-6).expect("a step");
            let first = clock.elapsed().as_secs_f64();
            let change = region.change();
            let bytes = change.bytes_allocated - change.bytes_deallocated;
            let all = seconds(|| scheme.advance(&mut cells, 0.5, 1e-6).expect("a step"));
            let held = vec![1.0f64; bytes / 8];
            let once = seconds(|| {
                black_box(read(black_box(&held)));
            });
            let bound = Some(("reading its factors once", once));
            let n = generator.unknowns() as f64;
            let held = bytes as f64 * 1e-3 / n;
            let name = format!(
                "implicit step, {how}, {n} unknowns ({held:.1} kB each, factors in {:.2} s)",
                first - all
            );
            rows.push(row(&name, "unknowns", n, all, bound));
        }
    }
    rows
}

/// A pass of the flow map with its average along v, beside reading the places and weights it goes by.
fn pass() -> String {
    let it = oscillator(0.005);
    let mesh = mesh(&it, [256, 192]);
    let settings = flow_map::Settings::default();
    let mut map = FlowMap::new(&it, &mesh, settings).expect("a propagator");
    let mut density = map.start(&start()).expect("a start the mesh holds");
    let mut go = || {
        let before = map.progress().passes;
        map.advance(&mut density, 20.0).expect("an interval");
        map.progress().passes - before
    };
    let passes = go() as f64;
    let all = seconds(|| {
        go();
    });
    // Sixteen weights and a place of half a number a point.
    let held = vec![1.0f64; 33 * mesh.len() / 2];
    let once = seconds(|| {
        for _ in 0..passes as usize {
            black_box(read(black_box(&held)));
        }
    });
    let bound = Some(("reading its map once", once));
    let n = mesh.len() as f64 * passes;
    row("flow map pass, order 8", "points", n, all, bound)
}

/// Paths of a round.
const PATHS: u64 = 8192;

/// Kick and drift of 16 paths under the Hertz force, no noise.
struct Floor {
    steps: u64,
}

#[allow(clippy::needless_range_loop)]
impl pulp::WithSimd for Floor {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> f64 {
        let (mut q, mut v) = ([0.3; 16], [0.7; 16]);
        for lane in 0..16 {
            q[lane] += 0.01 * lane as f64;
        }
        for _ in 0..self.steps {
            for lane in 0..16 {
                q[lane] += 0.05 * v[lane];
                let x = (1.0 + q[lane] * (2.0 / 3.0)).max(0.0);
                v[lane] -= 0.05 * (x * x.sqrt() - 1.0) + 5e-4 * v[lane];
            }
        }
        q.iter().sum::<f64>() + v.iter().sum::<f64>()
    }
}

/// Steps of Monte Carlo, beside the same number of kicks and drifts without noise.
fn paths() -> Vec<String> {
    let it = oscillator(0.005);
    let schemes = [
        (Scheme::EulerMaruyama, 0.05, 10.0),
        (Scheme::CentralDifference, 0.05, 10.0),
        (Scheme::Baoab, 0.05, 10.0),
        (Scheme::Splitting42, 0.75, 37.5),
        (Scheme::Splitting62, 1.5, 37.5),
    ];
    schemes
        .into_iter()
        .map(|(scheme, step, end)| {
            let settings = Sampling {
                paths: PATHS,
                scheme,
                step: Some(step),
                ..Sampling::default()
            };
            let mut count = 0;
            let all = seconds(|| {
                let ran = monte_carlo::run(&it, &start(), &[end], &settings, &|_| ());
                count = ran.expect("an ensemble").path_steps;
            });
            let steps = count / 16;
            let floor = seconds(|| {
                let floor = Floor {
                    steps: black_box(steps),
                };
                black_box(pulp::Arch::new().dispatch(floor));
            });
            let bound = Some(("kick and drift without noise", floor));
            let name = format!("Monte Carlo step, {}", scheme.name());
            row(&name, "path steps", count as f64, all, bound)
        })
        .collect()
}

/// Whole stages that have no loop to bound: closed form, steady state, spectrum, first loss.
fn stages() -> Vec<String> {
    let it = oscillator(0.005);
    let settings = Settings::default();
    let line = |name: &str, seconds: f64| {
        let (value, unit) = match seconds {
            s if s < 1e-3 => (1e6 * s, "\u{b5}s"),
            s if s < 1.0 => (1e3 * s, "ms"),
            s => (s, "s"),
        };
        format!("| {name} | {value:.0} {unit} | - | - | - |")
    };
    let once = |call: &dyn Fn()| {
        let clock = Instant::now();
        call();
        clock.elapsed().as_secs_f64()
    };
    let omegas: Vec<f64> = (0..=200).map(|k| 0.01 * f64::from(k)).collect();
    vec![
        line(
            "closed form, all numbers",
            seconds(|| {
                black_box(Stationary::of(&it).expect("a confining law").std_force());
            }),
        ),
        line(
            "steady state to 1e-3",
            once(&|| {
                black_box(steady(&it, &settings).expect("a steady state"));
            }),
        ),
        line(
            "spectrum of the force up to 2, to 1e-3",
            once(&|| {
                let it = spectrum(&it, Quantity::Force, &omegas, &settings, &|_| ());
                black_box(it.expect("a spectrum"));
            }),
        ),
        line(
            "first loss from rest up to t = 20, to 1e-3",
            once(&|| {
                let it = first_loss(&it, &Initial::Rest, 20.0, &settings, &|_| ());
                black_box(it.expect("a survival"));
            }),
        ),
    ]
}
