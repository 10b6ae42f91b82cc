//! The flow map: time per point and pass, on one core and on all; and two cases that hand-written programs
//! are held against, set-up included.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rayon::{ThreadPool, ThreadPoolBuilder};
use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::flow_map::{FlowMap, Settings, Splitting};
use vibroimpact::fokker_planck::{Axis, Density, Domain, Mesh};
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::Oscillator;

fn oscillator() -> Oscillator {
    Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).expect("the paper's level")
}

fn start() -> Initial {
    Initial::gaussian([0.0, 0.0], [0.3, 0.3]).expect("a deviation above 0")
}

fn mesh(oscillator: &Oscillator, start: &Initial, neglected: f64, [nq, nv]: [usize; 2]) -> Mesh {
    let domain = Domain::closed(oscillator, start, neglected).expect("a domain");
    let t = oscillator.temperature();
    Mesh {
        q: Axis::displacement(oscillator.contact(), t, domain.q, nq, 1).expect("enough cells"),
        v: Axis::velocity(domain.v[1], nv, 1).expect("enough cells"),
    }
}

fn pools() -> [(&'static str, ThreadPool); 2] {
    let pool = |n| {
        ThreadPoolBuilder::new()
            .num_threads(n)
            .build()
            .expect("threads")
    };
    [("one core", pool(1)), ("all cores", pool(0))]
}

/// Elements are mesh points times passes.
fn passes(c: &mut Criterion) {
    let oscillator = oscillator();
    let mut group = c.benchmark_group("flow map, points x passes");
    group.sample_size(20);
    for cells in [[80, 60], [128, 96], [256, 192], [512, 384]] {
        let mesh = mesh(&oscillator, &start(), 1e-6, cells);
        for (name, pool) in pools() {
            let settings = Settings::default();
            let mut flow = FlowMap::new(&oscillator, &mesh, settings).expect("a propagator");
            let mut density = flow.start(&start()).expect("a start the mesh holds");
            // The first interval builds the maps.
            flow.advance(&mut density, 20.0).expect("an interval");
            let before = flow.progress().passes;
            flow.advance(&mut density, 20.0).expect("an interval");
            let passes = flow.progress().passes - before;
            group.throughput(Throughput::Elements((mesh.len() * passes) as u64));
            group.bench_function(BenchmarkId::new(name, mesh.len()), |b| {
                b.iter(|| pool.install(|| flow.advance(&mut density, 20.0)));
            });
        }
    }
    group.finish();
}

/// From nothing to the density at a time.
fn solve(
    oscillator: &Oscillator,
    start: &Initial,
    mesh: &Mesh,
    settings: Settings,
    until: f64,
) -> vibroimpact::Result<Density> {
    let mut flow = FlowMap::new(oscillator, mesh, settings)?;
    let mut density = flow.start(start)?;
    flow.advance(&mut density, until)?;
    Ok(density)
}

/// From nothing to the density at t = 50, on one core, by its L1 error (tests/flow_map.rs: case_).
fn case_h(c: &mut Criterion) {
    let oscillator = oscillator();
    let pool = &pools()[0].1;
    let mut group = c.benchmark_group("case H, t = 50, set-up included");
    for (error, cells, neglected, splitting, step) in [
        ("1.2e-4", [52, 38], 1e-4, Splitting::FourTwo, 1.5),
        ("4.2e-5", [56, 42], 1e-4, Splitting::EvenFive, 1.1),
        ("4.1e-6", [100, 76], 1e-6, Splitting::EvenFive, 0.6),
    ] {
        group.bench_function(error, |b| {
            b.iter(|| {
                pool.install(|| {
                    let mesh = mesh(&oscillator, &start(), neglected, cells);
                    let settings = Settings {
                        splitting,
                        step,
                        ..Settings::default()
                    };
                    solve(&oscillator, &start(), &mesh, settings, 50.0)
                })
            });
        });
    }
    group.finish();
}

/// From nothing to the density after two periods of the linear oscillator, on one core.
fn case_l(c: &mut Criterion) {
    let h = 2.0 * 0.05 * 0.25 / std::f64::consts::PI;
    let oscillator = Oscillator::new(ContactLaw::Linear, 0.05, h).expect("a level above 0");
    let start = Initial::gaussian([1.0, 0.0], [0.2, 0.2]).expect("a deviation above 0");
    let pool = &pools()[0].1;
    let mut group = c.benchmark_group("case L, t = 4 pi, set-up included");
    for (error, cells, neglected, splitting, step) in [
        ("4.5e-5", [42, 42], 1e-6, Splitting::FourTwo, 1.0),
        ("1.3e-5", [54, 54], 1e-6, Splitting::FourTwo, 0.7),
    ] {
        group.bench_function(error, |b| {
            b.iter(|| {
                pool.install(|| {
                    let mesh = mesh(&oscillator, &start, neglected, cells);
                    let settings = Settings {
                        splitting,
                        step,
                        ..Settings::default()
                    };
                    solve(
                        &oscillator,
                        &start,
                        &mesh,
                        settings,
                        4.0 * std::f64::consts::PI,
                    )
                })
            });
        });
    }
    group.finish();
}

criterion_group!(benches, passes, case_h, case_l);
criterion_main!(benches);
