//! What a propagator keeps, and what a step does.

use super::*;
use crate::contact::ContactLaw;
use crate::fokker_planck::domain::Domain;
use crate::fokker_planck::mesh::Axis;

fn mesh(oscillator: &Oscillator, initial: &Initial, cells: [usize; 2]) -> Mesh {
    let domain = Domain::closed(oscillator, initial, 1e-7).unwrap();
    let t = oscillator.temperature();
    Mesh {
        q: Axis::displacement(oscillator.contact(), t, domain.q, cells[0], 1).unwrap(),
        v: Axis::velocity(domain.v[1], cells[1], 1).unwrap(),
    }
}

fn start() -> Initial {
    Initial::gaussian([0.5, 0.0], [0.5, 0.5]).unwrap()
}

#[test]
fn the_stationary_law_stays_on_any_mesh_with_any_splitting() {
    for (h, contact) in [
        (2e-3, ContactLaw::Hertz),
        (0.3, ContactLaw::Hertz),
        (2e-3, ContactLaw::Bilinear),
        (1e-6, ContactLaw::Linear),
    ] {
        let oscillator = Oscillator::new(contact, 0.005, h).unwrap();
        let mesh = mesh(&oscillator, &Initial::Stationary, [33, 26]);
        for splitting in Splitting::ALL {
            let settings = Settings {
                splitting,
                ..Settings::default()
            };
            let mut flow = FlowMap::new(&oscillator, &mesh, settings).unwrap();
            let mut density = flow.start(&Initial::Stationary).unwrap();
            flow.advance(&mut density, 200.0).unwrap();
            let g = flow.ratio(&density);
            let worst = g.iter().map(|g| (g - 1.0).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-12, "{splitting:?}: {worst:e}");
        }
    }
}

#[test]
fn mass_is_kept_to_rounding_and_its_raw_defect_is_the_interpolation_error() {
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
    for (cells, bound) in [([60, 44], 1e-4), ([90, 66], 3e-5), ([120, 88], 1e-5)] {
        let mesh = mesh(&oscillator, &start(), cells);
        let mut flow = FlowMap::new(&oscillator, &mesh, Settings::default()).unwrap();
        let mut density = flow.start(&start()).unwrap();
        let before = density.mass();
        flow.advance(&mut density, 50.0).unwrap();
        let change = (density.mass() - before).abs();
        let defect = flow.progress().defect;
        println!("{cells:?}: mass to {change:.1e}, raw defect {defect:.1e}");
        assert!(change < 1e-13 && defect < bound);
    }
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
    let mesh = mesh(&oscillator, &start(), [101, 83]);
    assert!(mesh.len() >= SHARED);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let mut flow = FlowMap::new(&oscillator, &mesh, Settings::default()).unwrap();
            let mut density = flow.start(&start()).unwrap();
            flow.advance(&mut density, 7.0).unwrap();
            density
        })
    };
    let one = run(1);
    for threads in [2, 3, 7] {
        assert_eq!(one.cells(), run(threads).cells(), "{threads} threads");
    }
}

#[test]
fn output_times_are_hit_and_change_the_answer_by_the_splitting_error_only() {
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
    let mesh = mesh(&oscillator, &start(), [120, 88]);
    let run = |parts: &[f64]| {
        let mut flow = FlowMap::new(&oscillator, &mesh, Settings::default()).unwrap();
        let mut density = flow.start(&start()).unwrap();
        for part in parts {
            flow.advance(&mut density, *part).unwrap();
        }
        density
    };
    let whole = run(&[20.0]);
    let uneven: Vec<f64> = (1..=16).map(|k| 20.0 * f64::from(k) / 136.0).collect();
    for parts in [
        &[8.3, 11.7][..],
        &[0.01, 0.3, 9.0, 0.0, 10.69],
        &[2.5; 8],
        &uneven,
    ] {
        let distance: f64 = run(parts)
            .cells()
            .iter()
            .zip(whole.cells())
            .map(|(a, b)| (a - b).abs())
            .sum();
        println!("{parts:?}: L1 {distance:.1e}");
        assert!(distance < 3e-4);
    }
}

#[test]
fn the_schedule_spends_exactly_its_interval_on_motion_and_on_noise() {
    for splitting in Splitting::ALL {
        for steps in 1..12 {
            let (nodes, weights) = splitting.quadrature(steps);
            let total: f64 = weights.iter().sum();
            assert!(
                (total - steps as f64).abs() < 1e-12,
                "{splitting:?} {steps}"
            );
            assert!(weights.iter().all(|w| *w > 0.0));
            assert!(nodes.windows(2).all(|w| w[0] < w[1]));
            assert!(nodes[0] > 0.0 && nodes[nodes.len() - 1] < steps as f64);
        }
    }
}

#[test]
fn beyond_the_edge_g_goes_on_as_a_constant_and_a_density_as_nothing() {
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
    // A domain much too small: half of the stationary law lies outside.
    let mesh = Mesh {
        q: Axis::uniform(-1.2, 0.9, 30).unwrap(),
        v: Axis::uniform(-0.8, 0.8, 24).unwrap(),
    };
    let mut flow = FlowMap::new(&oscillator, &mesh, Settings::default()).unwrap();
    let mut density = flow
        .start(&Initial::gaussian([0.2, 0.0], [0.2, 0.2]).unwrap())
        .unwrap();
    flow.advance(&mut density, 50.0).unwrap();
    let g = flow.ratio(&density);
    let (low, high) = g
        .iter()
        .fold((f64::MAX, f64::MIN), |(a, b), g| (a.min(*g), b.max(*g)));
    println!("too small a domain: g within [{low:.3}, {high:.3}]");
    assert!(low > -0.1 && high < 20.0);

    let free = Oscillator::new(ContactLaw::Free, 0.005, 2e-3).unwrap();
    let mesh = Mesh {
        q: Axis::uniform(-2.0, 2.0, 40).unwrap(),
        v: Axis::uniform(-2.0, 2.0, 40).unwrap(),
    };
    let mut flow = FlowMap::new(&free, &mesh, Settings::default()).unwrap();
    let mut density = flow
        .start(&Initial::gaussian([0.0, 0.0], [0.3, 0.3]).unwrap())
        .unwrap();
    flow.advance(&mut density, 10.0).unwrap();
    println!("thrown out of the domain: mass {:.1e} left", density.mass());
    assert!(density.mass().abs() < 1e-6);
    assert!((flow.progress().defect - 1.0).abs() < 1e-6);
}

#[test]
fn maps_that_do_not_fit_the_memory_are_made_anew_and_do_the_same() {
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
    let mesh = mesh(&oscillator, &start(), [60, 44]);
    let run = |memory| {
        let settings = Settings {
            memory,
            ..Settings::default()
        };
        let mut flow = FlowMap::new(&oscillator, &mesh, settings).unwrap();
        let mut density = flow.start(&start()).unwrap();
        for k in 0..12 {
            flow.advance(&mut density, 5.0 + 0.07 * f64::from(k))
                .unwrap();
        }
        (flow.maps.len(), density)
    };
    let ((all, free), (few, tight)) = (run(u64::MAX), run(0));
    println!("flow maps: {all} held, {few} in no memory");
    assert!(few <= 7 && all > 14 && free.cells() == tight.cells());
}

#[test]
fn a_step_or_duration_that_makes_no_sense_is_refused_by_name() {
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
    let mesh = mesh(&oscillator, &start(), [60, 44]);
    for step in [0.0, -1.0, f64::NAN] {
        let settings = Settings {
            step,
            ..Settings::default()
        };
        let message = FlowMap::new(&oscillator, &mesh, settings)
            .unwrap_err()
            .to_string();
        assert!(message.contains("method.step"), "{message}");
    }
    let mut flow = FlowMap::new(&oscillator, &mesh, Settings::default()).unwrap();
    let mut density = flow.start(&start()).unwrap();
    assert!(flow.advance(&mut density, -1.0).is_err());
    assert!(flow.advance(&mut density, f64::NAN).is_err());
    assert!(Settings::to(0.0, &oscillator).is_err());
}
