//! Nanoseconds per path and step on one core, scheme by scheme, and the floor: the same integrator
//! without noise. Elements are paths times steps. Beside it benches/numba_loop.py, run by hand: 35 ns for
//! BAOAB in numba 0.68 where this takes about 3.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use std::time::Duration;
use vibroimpact::contact::ContactLaw;
use vibroimpact::initial::Initial;
use vibroimpact::monte_carlo::{EnsembleSettings, Scheme, run};
use vibroimpact::oscillator::Oscillator;

/// Enough that the first block, which is run twice, does not count.
const PATHS: u64 = 8192;

/// Kick and drift of 16 paths under the Hertz force, no noise.
struct Floor {
    steps: u64,
}

#[allow(clippy::inline_always, clippy::needless_range_loop)]
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

fn schemes(c: &mut Criterion) {
    let one_core = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let one_core = one_core.expect("a thread");
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).expect("the paper's scene");
    let mut group = c.benchmark_group("path_step");
    group
        .measurement_time(Duration::from_secs(3))
        .sample_size(20);
    let steps = PATHS * 100 / 16;
    group.throughput(Throughput::Elements(16 * steps));
    let floor = || {
        pulp::Arch::new().dispatch(Floor {
            steps: black_box(steps),
        })
    };
    group.bench_function("floor_without_noise", |b| b.iter(floor));
    for (scheme, step, end) in [
        (Scheme::EulerMaruyama, 0.05, 10.0),
        (Scheme::CentralDifference, 0.05, 10.0),
        (Scheme::Baoab, 0.05, 10.0),
        (Scheme::Splitting42, 0.75, 37.5),
        (Scheme::Splitting62, 1.5, 37.5),
    ] {
        let settings = EnsembleSettings {
            paths: PATHS,
            scheme,
            step: Some(step),
            ..EnsembleSettings::default()
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
