//! What time costs: the generator per cell, factorisations and solves, and a unit of time per scheme; beside
//! bounds in benches/summary.rs.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use std::hint::black_box;
use std::time::Duration;
use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::transient::{time_integration, time_scheme};
use vibroimpact::fokker_planck::{
    Axis, Density, Drift, Generator, Integrator, Mesh, Radau, Solver, TimeScheme,
};
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::Oscillator;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// The contact at T = 0.63 in a truncated domain up to 11 T.
fn generator(zeta: f64, cells: [usize; 2], drift: Drift) -> (Oscillator, Generator) {
    let temperature = 0.63;
    let h = 2.0 * zeta * temperature / std::f64::consts::PI;
    let it = Oscillator::new(ContactLaw::Hertz, zeta, h).unwrap();
    let margin = drift.margin();
    let (left, right) = it.contact().turning_points(11.0 * temperature).unwrap();
    let q = Axis::displacement(it.contact(), temperature, [left, right], cells[0], margin);
    let v = Axis::velocity((22.0 * temperature).sqrt(), cells[1], margin);
    let mesh = Mesh {
        q: q.unwrap(),
        v: v.unwrap(),
    };
    let generator = Generator::new(&it, &mesh, drift).unwrap();
    (it, generator)
}

fn start(generator: &Generator) -> Density {
    let initial = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    Density::start(generator, &initial).unwrap()
}

/// Seconds of one call, the best of several rounds.
fn seconds(mut call: impl FnMut()) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..7 {
        let clock = std::time::Instant::now();
        for _ in 0..50 {
            call();
        }
        best = best.min(clock.elapsed().as_secs_f64() / 50.0);
    }
    best
}

/// The generator without a matrix.
fn apply(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("generator");
    for drift in Drift::ALL {
        let (_, generator) = generator(0.005, [300, 300], drift);
        let n = generator.mesh().len();
        let g: Vec<f64> = (0..n).map(|k| (k % 17) as f64).collect();
        let mut rate = vec![0.0; n];
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::new("apply", format!("{drift:?}")), |bencher| {
            bencher.iter(|| generator.apply(black_box(&g), &mut rate));
        });
    }
    group.finish();
}

/// The assembled generator: building it, and its product with a vector, against the mesh-free one.
fn assembled(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("assembled");
    for drift in Drift::ALL {
        let (_, generator) = generator(0.005, [100, 100], drift);
        let n = generator.mesh().len() as f64;
        let matrix = generator.matrix();
        let x = vec![1.0; matrix.cols()];
        let mut y = vec![0.0; matrix.rows()];
        let product = |y: &mut [f64]| {
            for (column, entries) in matrix.outer_iterator().enumerate() {
                for (row, a) in entries.iter() {
                    y[row] += a * black_box(&x)[column];
                }
            }
        };
        let (sparse, build) = (
            seconds(|| product(&mut y)),
            seconds(|| drop(generator.matrix())),
        );
        println!(
            "{drift:?}: sparse product {:.2} ns per cell, assembly {:.0} ns per cell",
            sparse / n * 1e9,
            build / n * 1e9
        );
        group.bench_function(
            BenchmarkId::new("assemble", format!("{drift:?}")),
            |bencher| {
                bencher.iter(|| generator.matrix());
            },
        );
    }
    group.finish();
}

/// The factorisation, a step of Radau IIA and the memory they hold against the mesh, by LU and by
/// preconditioned GMRES.
fn solve(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("solve");
    for n in [60, 90, 130] {
        let (_, generator) = generator(5.0, [n, 3 * n / 4], Drift::Order8);
        let cells = start(&generator).cells().to_vec();
        for solver in [Solver::Direct, Solver::Krylov] {
            let name = format!("{solver:?} {} unknowns", generator.unknowns());
            if n < 100 || solver == Solver::Krylov {
                let region = Region::new(ALLOCATOR);
                let mut held = Radau::new(&generator, solver);
                held.advance(&mut cells.clone(), 0.5, 1e-6).unwrap();
                let change = region.change();
                let bytes = (change.bytes_allocated - change.bytes_deallocated) as f64;
                println!(
                    "{name}: {:.1} MB, {:.1} kB per unknown",
                    bytes * 1e-6,
                    bytes * 1e-3 / generator.unknowns() as f64
                );
                drop(held);
                group.bench_function(BenchmarkId::new("factor", &name), |bencher| {
                    bencher.iter(|| {
                        let mut scheme = Radau::new(&generator, solver);
                        scheme.advance(&mut cells.clone(), 0.5, 1e-6).unwrap();
                    });
                });
                let mut scheme = Radau::new(&generator, solver);
                group.bench_function(BenchmarkId::new("step", &name), |bencher| {
                    bencher.iter(|| scheme.advance(&mut cells.clone(), 0.5, 1e-6).unwrap());
                });
            }
        }
    }
    group.finish();
}

/// A unit of time at a tolerance of 1e-5, per scheme and damping.
fn unit(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("unit of time at 1e-5");
    for zeta in [0.005, 0.5, 5.0, 50.0] {
        let (oscillator, generator) = generator(zeta, [90, 60], Drift::Order8);
        let density = start(&generator);
        println!(
            "zeta = {zeta}: {}",
            time_scheme(&oscillator, &generator, 1e-5, 1.0).1
        );
        for time in [TimeScheme::Explicit, TimeScheme::Imex, TimeScheme::Implicit] {
            let name = format!("zeta = {zeta}, {}", time.name());
            group.bench_function(&name, |bencher| {
                bencher.iter(|| {
                    let mut integration =
                        time_integration(&oscillator, &generator, time, 1e-5, None, 1.0);
                    let all = &mut |_: f64, _: &Density| Ok(true);
                    integration.advance(&mut density.clone(), 1.0, all).unwrap();
                });
            });
        }
    }
    group.finish();
}

fn short() -> Criterion {
    Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1))
}

criterion_group! {
    name = benches;
    config = short();
    targets = solve, apply, assembled, unit
}
criterion_main!(benches);
