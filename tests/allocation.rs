//! The loops over the steps allocate nothing, once they are warm. A test binary of its own, since it counts
//! in the global allocator.

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::flow_map::{FlowMap, Settings as FlowMapSettings};
use vibroimpact::fokker_planck::transient::time_integration;
use vibroimpact::fokker_planck::{Axis, Density, Domain, Drift, Generator, Mesh, TimeScheme};
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::Oscillator;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Allocations, reallocations included, of a call.
fn allocations(call: impl FnOnce()) -> usize {
    let region = Region::new(ALLOCATOR);
    call();
    let change = region.change();
    change.allocations + change.reallocations
}

// One test: another one beside it would be counted too. One thread: a pool allocates what it queues.
#[test]
fn no_step_allocates() {
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
    let start = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    let domain = Domain::closed(&oscillator, &start, 1e-6).unwrap();
    let t = oscillator.temperature();
    let mesh = |margin| Mesh {
        q: Axis::displacement(oscillator.contact(), t, domain.q, 100, margin).unwrap(),
        v: Axis::velocity(domain.v[1], 80, margin).unwrap(),
    };
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    one.unwrap().install(|| {
        assert!(
            allocations(|| drop(std::hint::black_box(vec![1.0; 10]))) > 0,
            "the count sees nothing"
        );
        let mut flow = FlowMap::new(&oscillator, &mesh(1), FlowMapSettings::default()).unwrap();
        let mut density = flow.start(&start).unwrap();
        flow.advance(&mut density, 20.0).unwrap();
        let before = flow.progress().passes;
        let count = allocations(|| flow.advance(&mut density, 20.0).unwrap());
        let passes = flow.progress().passes - before;
        println!("flow map: {count} allocations in {passes} passes");
        assert!(count == 0 && passes > 20);

        let generator = Generator::new(&oscillator, &mesh(5), Drift::Order8).unwrap();
        for time in [TimeScheme::Explicit, TimeScheme::Imex] {
            // A given step, well below what the tolerance asks, so that every step is the same.
            let step = Some(0.02);
            let mut integration = time_integration(&oscillator, &generator, time, 1e-2, step, 20.0);
            let mut density = Density::start(&generator, &start).unwrap();
            let all = &mut |_: f64, _: &Density| Ok(true);
            integration.advance(&mut density, 2.0, all).unwrap();
            let before = integration.steps();
            let count = allocations(|| {
                integration.advance(&mut density, 2.0, all).unwrap();
            });
            let steps = integration.steps() - before;
            println!("{}: {count} allocations in {steps} steps", time.name());
            assert!(count == 0 && steps > 50);
        }
    });
}
