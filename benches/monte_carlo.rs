//! Nanoseconds per path and step on one core, scheme by scheme. Elements are paths times steps; beside a bound
//! in benches/summary.rs. Beside it benches/numba_loop.py, run by hand: 35 ns for
//! BAOAB in numba 0.68 where this takes about 3.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::time::Duration;
use vibroimpact::contact::ContactLaw;
use vibroimpact::initial::Initial;
use vibroimpact::monte_carlo::{Sampling, Scheme, run};
use vibroimpact::oscillator::Oscillator;

/// Enough that the first block, which is run twice, does not count.
const PATHS: u64 = 8192;

fn schemes(c: &mut Criterion) {
    let one_core = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let one_core = one_core.expect("a thread");
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).expect("the paper's scene");
    let mut group = c.benchmark_group("path_step");
    group
        .measurement_time(Duration::from_secs(3))
        .sample_size(20);
    for (scheme, step, end) in [
        (Scheme::EulerMaruyama, 0.05, 10.0),
        (Scheme::CentralDifference, 0.05, 10.0),
        (Scheme::Baoab, 0.05, 10.0),
        (Scheme::Splitting42, 0.75, 37.5),
        (Scheme::Splitting62, 1.5, 37.5),
    ] {
        let settings = Sampling {
            paths: PATHS,
            scheme,
            step: Some(step),
            ..Sampling::default()
        };
        let go = || {
            let initial = Initial::gaussian([0.0, 0.0], [0.9, 0.8]).expect("a start");
            let run = || run(&oscillator, &initial, &[end], &settings, &|_| ());
            one_core.install(run).expect("an ensemble")
        };
        group.throughput(Throughput::Elements(go().path_steps));
        group.bench_function(scheme.name(), |b| b.iter(go));
    }
    group.finish();
}

criterion_group!(benches, schemes);
criterion_main!(benches);
