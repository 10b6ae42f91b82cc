//! What every scheme keeps exactly: mass, the stationary law, the sign of the entropy's change.

use crate::mesh_modes::slowest;
use crate::runge_kutta::RungeKutta4;
use sprs::{CsMat, TriMat};
use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::{
    Axis, Density, Domain, Drift, Generator, MassFlux, Measure, Mesh, Settings, TransientMethod,
    null_vector, steady, transient,
};
use vibroimpact::gaussian::maxwell;
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::sparse::Lu;
use vibroimpact::stationary::Stationary;

fn oscillator(contact: ContactLaw, zeta: f64, temperature: f64) -> Oscillator {
    Oscillator::new(
        contact,
        zeta,
        2.0 * zeta * temperature / std::f64::consts::PI,
    )
    .unwrap()
}

fn mesh(it: &Oscillator, drift: Drift, n: [usize; 2], outside: f64) -> Mesh {
    let domain = Domain::closed(it, &Initial::Stationary, outside).unwrap();
    let margin = drift.margin();
    Mesh {
        q: Axis::displacement(it.contact(), it.temperature(), domain.q, n[0], margin).unwrap(),
        v: Axis::velocity(domain.v[1], n[1], margin).unwrap(),
    }
}

fn paper() -> Oscillator {
    Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap()
}

/// L1 distance to the weights, both with mass 1.
fn l1(density: &Density, generator: &Generator) -> f64 {
    let exact = Density::start(generator, &Initial::Stationary).unwrap();
    let mass = exact.mass();
    density
        .cells()
        .iter()
        .zip(exact.cells())
        .map(|(p, w)| (p - w / mass).abs())
        .sum()
}

#[test]
fn the_discrete_steady_state_is_the_stationary_law_on_any_mesh() {
    for contact in [ContactLaw::Hertz, ContactLaw::Bilinear] {
        for t in [3e-4, 0.63, 94.0] {
            for cells in [[50, 30], [110, 66], [200, 120]] {
                let it = oscillator(contact.clone(), 0.005, t);
                let settings = Settings {
                    cells: Some(cells),
                    ..Settings::default()
                };
                let answer = steady(&it, &settings).unwrap();
                let (null, integrated) = (answer.l1_error.value, answer.approach.last().unwrap().1);
                println!(
                    "{} T = {t} {cells:?}: null vector {null:.1e}, time integration {integrated:.1e}",
                    contact.name()
                );
                assert!(
                    null < 1e-10 && integrated < 1e-10,
                    "{null:e} {integrated:e}"
                );
                let falling = answer
                    .approach
                    .windows(2)
                    .all(|w| w[1].1 <= w[0].1 * (1.0 + 1e-9) + 1e-13);
                assert!(falling, "the distance to the stationary law never grows");
            }
        }
    }
}

#[test]
fn the_steady_state_notices_one_transport_flux_perturbed_by_a_thousandth() {
    let it = paper();
    for cells in [[50, 30], [160, 96]] {
        let mesh = mesh(&it, Drift::Upwind, cells, 1e-9);
        let measure = Measure::of(&it).unwrap();
        let mut flux = MassFlux::new(&measure, &it, &mesh, Drift::Upwind);
        let intact = Generator::with_flux(&it, &mesh, Drift::Upwind, flux.clone()).unwrap();
        let intact = l1(&null_vector(&intact).unwrap().0, &intact);
        if let MassFlux::Faces { q, .. } = &mut flux {
            let largest = (0..q.len()).max_by(|a, b| q[*a].total_cmp(&q[*b])).unwrap();
            q[largest] *= 1.0 + 1e-3;
        }
        let broken = Generator::with_flux(&it, &mesh, Drift::Upwind, flux).unwrap();
        let broken = l1(&null_vector(&broken).unwrap().0, &broken);
        println!("{cells:?}: intact {intact:.1e}, one flux off by 1e-3 {broken:.1e}");
        assert!(intact < 1e-10 && broken > 1e-8);
    }
}

/// The stationary E\[v^2\] of finite volumes on p itself, upwind along q and Scharfetter-Gummel along v: the fluxes know
/// nothing of the stationary law.
fn upwind_of_p(it: &Oscillator, [low, high, reach]: [f64; 3], [nq, nv]: [usize; 2]) -> f64 {
    let (dq, dv) = ((high - low) / nq as f64, 2.0 * reach / nv as f64);
    let (q, v) = (
        |i: usize| low + (i as f64 + 0.5) * dq,
        |j: usize| -reach + (j as f64 + 0.5) * dv,
    );
    let diffusion = it.zeta() * 2.0 * it.temperature();
    let bernoulli = |x: f64| if x.abs() < 1e-8 { 1.0 } else { x / x.exp_m1() };
    let mut matrix = TriMat::new((nq * nv, nq * nv));
    let mut carry = |from: usize, to: usize, rate: f64| {
        matrix.add_triplet(to, from, rate);
        matrix.add_triplet(from, from, -rate);
    };
    for i in 0..nq {
        for j in 0..nv {
            let here = i * nv + j;
            if i + 1 < nq {
                let (a, b) = if v(j) > 0.0 {
                    (here, here + nv)
                } else {
                    (here + nv, here)
                };
                carry(a, b, v(j).abs() / dq);
            }
            if j + 1 < nv {
                let force = 2.0 * it.zeta() * (v(j) + 0.5 * dv) + it.contact().force(q(i));
                let peclet = force * dv / diffusion;
                carry(here, here + 1, diffusion / (dv * dv) * bernoulli(peclet));
                carry(here + 1, here, diffusion / (dv * dv) * bernoulli(-peclet));
            }
        }
    }
    let norm = nq as f64 / (high - low) * reach;
    for k in 0..nq * nv {
        matrix.add_triplet(k, k, -1e-10 * norm);
    }
    let mut lu = Lu::factor(matrix.to_csc()).unwrap();
    let mut p = vec![1.0 / (nq * nv) as f64; nq * nv];
    for _ in 0..4 {
        lu.solve(&mut p).unwrap();
        let sum: f64 = p.iter().sum();
        for p in &mut p {
            *p /= sum;
        }
    }
    p.iter()
        .enumerate()
        .map(|(k, p)| p * v(k % nv).powi(2))
        .sum()
}

#[test]
fn upwind_fluxes_of_p_heat_the_oscillator_sevenfold_those_of_p_over_its_law_do_not() {
    let it = paper();
    let t = it.temperature();
    for (cells, least) in [([140, 100], 4.0), ([280, 200], 3.0)] {
        let heated = upwind_of_p(&it, [-8.0, 8.0, 8.0], cells);
        let mesh = Mesh {
            q: Axis::uniform(-8.0, 8.0, cells[0]).unwrap(),
            v: Axis::uniform(-8.0, 8.0, cells[1]).unwrap(),
        };
        let generator = Generator::new(&it, &mesh, Drift::Upwind).unwrap();
        let (density, _) = null_vector(&generator).unwrap();
        let balanced = l1(&density, &generator);
        println!("{cells:?}: E[v^2] = {heated:.2} for {t:.3}; balanced, L1 error {balanced:.0e}");
        assert!(heated > least && balanced < 1e-10);
    }
}

fn largest_rate(matrix: &CsMat<f64>) -> f64 {
    (0..matrix.cols())
        .filter_map(|k| matrix.get(k, k))
        .fold(0.0, |worst, a| worst.max(a.abs()))
}

#[test]
fn columns_sum_to_zero_and_the_upwind_generator_is_an_m_matrix() {
    for contact in [ContactLaw::Hertz, ContactLaw::Bilinear, ContactLaw::Linear] {
        for drift in Drift::ALL {
            let it = oscillator(contact.clone(), 0.02, 0.63);
            let generator = Generator::new(&it, &mesh(&it, drift, [60, 44], 1e-7), drift).unwrap();
            let matrix = generator.matrix();
            let rate = largest_rate(&matrix);
            for (column, entries) in matrix.outer_iterator().enumerate() {
                let sum: f64 = entries.iter().map(|(_, a)| a).sum();
                let size: f64 = entries.iter().map(|(_, a)| a.abs()).sum();
                assert!(
                    sum.abs() <= 1e-14 * size.max(rate),
                    "{drift:?} column {column}: {sum:e}"
                );
                if drift == Drift::Upwind {
                    let signs = entries
                        .iter()
                        .all(|(row, a)| (row == column) == (*a < 0.0) || *a == 0.0);
                    assert!(signs, "off-diagonal entries >= 0, diagonal < 0");
                }
            }
        }
    }
}

#[test]
fn ten_thousand_explicit_steps_keep_g_equal_to_one_and_the_mass() {
    for t in [0.63, 10.0] {
        let it = oscillator(ContactLaw::Hertz, 0.005, t);
        let cells = if t < 1.0 { [34, 24] } else { [54, 26] };
        for drift in Drift::ALL {
            let mesh = mesh(&it, drift, cells, 1e-4);
            assert_eq!(mesh.q.is_uniform(), t < 1.0);
            let generator = Generator::new(&it, &mesh, drift).unwrap();
            let mut density = Density::start(&generator, &Initial::Stationary).unwrap();
            let mass = density.mass();
            let mut scheme = RungeKutta4::new(&generator);
            // `advance` takes a third of the longest stable step.
            let duration = 1e4 * scheme.longest_step() / 3.0;
            let steps = scheme.advance(&mut density, duration, f64::INFINITY);
            let exact = Density::start(&generator, &Initial::Stationary).unwrap();
            let pairs = || density.cells().iter().zip(exact.cells());
            let l1: f64 = pairs().map(|(p, w)| (p - w).abs()).sum();
            let inverse = generator.inverse_weights();
            let maximum = pairs()
                .zip(inverse)
                .map(|((p, w), i)| (p - w).abs() * i)
                .fold(0.0, f64::max);
            let drifted = (density.mass() - mass).abs();
            println!(
                "T = {t} {drift:?}: {steps} steps, g - 1: L1 {l1:.1e}, max {maximum:.1e}, mass {drifted:.1e}"
            );
            assert!(steps >= 10_000 && l1 < 1e-13 && maximum < 1e-11 && drifted < 1e-12);
            // From another start the mass is kept as well.
            let law = it.displacement_law().unwrap();
            let uneven = |q: f64, v: f64| {
                law.density(q)
                    * maxwell(v, t)
                    * (1.0 + 0.5 * (2.0 * q / t).sin() * (v / t.sqrt()).cos())
            };
            let mut density = Density::from_fn(&generator, uneven);
            let mass = density.mass();
            scheme.advance(&mut density, 0.2 * duration, f64::INFINITY);
            let drifted = (density.mass() - mass).abs();
            assert!(drifted < 1e-12, "{drift:?}: {drifted:e}");
        }
    }
}

#[test]
fn quadratic_entropy_never_grows() {
    let it = paper();
    let start = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    for drift in Drift::ALL {
        let generator = Generator::new(&it, &mesh(&it, drift, [100, 70], 1e-7), drift).unwrap();
        let mut density = Density::start(&generator, &start).unwrap();
        let mut scheme = RungeKutta4::new(&generator);
        let entropy = |density: &Density| -> f64 {
            let ratio = density.ratio(&generator);
            density.cells().iter().zip(ratio).map(|(p, g)| p * g).sum()
        };
        let mut before = entropy(&density);
        let first = before;
        for _ in 0..40 {
            scheme.advance(&mut density, 0.25, f64::INFINITY);
            let now = entropy(&density);
            assert!(
                now <= before * (1.0 + 1e-13),
                "{drift:?}: {before} -> {now}"
            );
            before = now;
        }
        println!("{drift:?}: sum w g^2 from {first:.3} to {before:.3} at t = 10");
    }
}

#[test]
fn the_null_space_of_every_generator_has_dimension_one() {
    // The mode next to zero is the physical slowest one, at -0.0088: no second null vector.
    let it = paper();
    for drift in Drift::ALL {
        let generator = Generator::new(&it, &mesh(&it, drift, [70, 50], 1e-7), drift).unwrap();
        let (null, residual) = null_vector(&generator).unwrap();
        let distance = l1(&null, &generator);
        let shift = num_complex::Complex::new(1e-5, 0.0);
        let modes = slowest(&generator, &[shift], 200).unwrap();
        let next = modes[0].re;
        println!(
            "{drift:?}: null vector off by {distance:.1e}, residual {residual:.1e}, next mode {next:.5}"
        );
        assert!(distance < 1e-9 && next < -0.008);
    }
}

#[test]
fn a_mesh_too_coarse_for_the_tail_of_its_truncated_domain_is_refused_with_the_cells_it_needs() {
    // Seven deviations on 48 x 32 cells: ln p_s changes by 6 a cell at the edge. The skew form would stay
    // stable, with steps of 5e-5.
    let it = paper();
    let coarse = mesh(&it, Drift::Order8, [48, 32], 1e-11);
    let message = Generator::new(&it, &coarse, Drift::Order8)
        .unwrap_err()
        .to_string();
    println!("{message}");
    assert!(
        message.contains("method.cells") && message.contains("ln p_s"),
        "{message}"
    );
    assert!(
        Generator::new(&it, &coarse, Drift::Upwind).is_ok(),
        "upwind is monotone on any mesh"
    );
    let finer = mesh(&it, Drift::Order8, [110, 74], 1e-11);
    if let Err(e) = Generator::new(&it, &finer, Drift::Order8) {
        panic!("{e}")
    }
}

#[test]
fn the_moments_of_the_steady_state_are_those_of_the_closed_form_within_their_error_estimates() {
    for (h, cells) in [(0.3, [300, 120]), (2e-3, [160, 96]), (1e-6, [100, 100])] {
        for drift in [Drift::Upwind, Drift::Order6] {
            let it = Oscillator::new(ContactLaw::Hertz, 0.005, h).unwrap();
            let settings = Settings {
                cells: Some(if drift == Drift::Upwind {
                    cells
                } else {
                    [110, 90]
                }),
                drift: Some(drift),
                tolerance: 1e-5,
                ..Settings::default()
            };
            let moments = steady(&it, &settings).unwrap().moments;
            let law = Stationary::of(&it).unwrap();
            let exact = [
                (moments.mean_q, law.mean_q()),
                (moments.var_q, law.var_q()),
                (moments.var_v, law.moment_v(2)),
                (moments.std_force, law.std_force()),
                (moments.skewness_force, law.skewness_force()),
                (moments.mean_energy, law.mean_energy()),
                (
                    moments.contact_loss_probability.unwrap(),
                    law.contact_loss_probability().unwrap(),
                ),
            ];
            for (ours, exact) in exact {
                let error = (ours.value - exact.value).abs();
                assert!(
                    error <= ours.error,
                    "h = {h} {drift:?}: {ours} instead of {exact}"
                );
                assert!(
                    error <= 1e-4 * exact.value.abs().max(1e-3),
                    "h = {h}: {ours} {exact}"
                );
            }
        }
    }
}

#[test]
fn the_negative_mass_is_the_integral_of_the_negative_part_of_the_density() {
    let it = paper();
    let start = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    let settings = Settings {
        method: Some(TransientMethod::FiniteVolume),
        drift: Some(Drift::Order8),
        cells: Some([100, 66]),
        ..Settings::default()
    };
    let got = transient(&it, &start, &[5.0, 10.0], &[5.0, 10.0], &settings, &|_| ()).unwrap();
    for (k, snapshot) in got.densities.iter().enumerate() {
        let (q, v) = (&snapshot.q, &snapshot.v);
        // Equal cells at this temperature.
        let area = (q[1] - q[0]) * (v[1] - v[0]);
        let negative = area * snapshot.p.iter().map(|p| (-p).max(0.0)).sum::<f64>();
        let (said, lowest) = (got.negative_mass[k], got.lowest_density[k]);
        println!(
            "t = {}: lowest density {lowest}, negative mass {said}, of the array {negative:.3e}",
            snapshot.t
        );
        assert!(negative > 1e-7 && (said.value / negative - 1.0).abs() < 1e-9);
        assert!(lowest.value < 0.0 && said.error > 0.0 && said.error < 1e-2);
    }
}
