//! Steps in time of dP/dt = L P: one interface, [`Integrator`], and one [`TimeIntegration`] that drives any of
//! them with steps chosen by the error they make.
//!
//! | scheme | order | step bound by | cost of a step |
//! |---|---|---|---|
//! | [`BackwardEuler`] | 1 | accuracy alone; positive with upwind drift | one sparse solve |
//! | [`Radau`] | 5 | accuracy alone | a real and a complex sparse solve |
//! | [`Additive`] | 4 | transport across a cell | six transports, five banded solves |
//! | [`Chebyshev`] | any | transport and diffusion across a cell | one generator per 0.8/rate of time |
//!
//! Output times are hit by steps that land: equal ones up to the time, so none is a sliver. Where an output
//! is a step or two away, or transport bounds the step, the error is far below what was asked for.
//!
//! Mass and the stationary law are kept to rounding by every one of them: a step is a function of L that
//! is 1 where L is 0.

mod additive;
mod backward_euler;
mod banded;
mod chebyshev;
mod control;
mod gmres;
mod integrator;
mod radau;
mod resolvent;
mod system;

pub use self::{
    additive::Additive, backward_euler::BackwardEuler, chebyshev::Chebyshev,
    control::TimeIntegration, integrator::Integrator, radau::Radau, system::Solver,
};
pub(crate) use control::Step;
pub(crate) use system::{Late, never};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::ContactLaw;
    use crate::damping::Damping;
    use crate::fokker_planck::density::Density;
    use crate::fokker_planck::flux::Drift;
    use crate::fokker_planck::generator::Generator;
    use crate::fokker_planck::mesh::{Axis, Mesh};
    use crate::matrix;
    use crate::oscillator::Oscillator;
    use ndarray::{Array1, Array2};

    fn generator(zeta: f64, temperature: f64, cells: [usize; 2], drift: Drift) -> Generator {
        let h = 2.0 * zeta * temperature / std::f64::consts::PI;
        let it = Oscillator::new(ContactLaw::Hertz, zeta, h).unwrap();
        on_mesh(&it, temperature, cells, drift)
    }

    fn on_mesh(it: &Oscillator, temperature: f64, cells: [usize; 2], drift: Drift) -> Generator {
        let margin = drift.margin();
        let level = 8.0 * temperature;
        let (left, right) = it.contact().turning_points(level).unwrap();
        let q = Axis::displacement(it.contact(), temperature, [left, right], cells[0], margin);
        let v = Axis::velocity((2.0 * level).sqrt(), cells[1], margin);
        let mesh = Mesh {
            q: q.unwrap(),
            v: v.unwrap(),
        };
        Generator::new(it, &mesh, drift).unwrap()
    }

    fn gaussian(generator: &Generator) -> Density {
        Density::from_fn(generator, |q, v| {
            (-0.5 * ((q - 0.2).powi(2) + v * v) / 0.05).exp() / (std::f64::consts::TAU * 0.05)
        })
    }

    /// e^{t L} P by a dense matrix.
    fn exponential(generator: &Generator, density: &Density, t: f64) -> Vec<f64> {
        let dense = generator.matrix().to_dense();
        let system = system::System::new(generator, Solver::Direct, never());
        let mut start = Array1::zeros(dense.nrows());
        system.gather(density.cells(), start.as_slice_mut().unwrap());
        let end = matrix::exponential(&dense, t).dot(&start);
        let mut cells = vec![0.0; density.cells().len()];
        system.scatter(end.as_slice().unwrap(), &mut cells);
        cells
    }

    fn schemes(generator: &Generator) -> Vec<(&'static str, Box<dyn Integrator>)> {
        vec![
            ("backward Euler", Box::new(BackwardEuler::new(generator))),
            ("Radau, LU", Box::new(Radau::new(generator, Solver::Direct))),
            (
                "Radau, GMRES",
                Box::new(Radau::new(generator, Solver::Krylov)),
            ),
            ("additive", Box::new(Additive::new(generator))),
        ]
    }

    fn distance(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum()
    }

    #[test]
    fn every_scheme_has_its_order_against_the_matrix_exponential() {
        let friction = Oscillator::new(ContactLaw::Hertz, 0.1, 0.2 * 0.1 / std::f64::consts::PI);
        let friction = friction
            .unwrap()
            .with_damping(Damping::HuntCrossley)
            .unwrap();
        for (zeta, drift, generator) in [
            (
                0.05,
                Drift::Order8,
                generator(0.05, 0.1, [34, 30], Drift::Order8),
            ),
            (
                0.5,
                Drift::Order4,
                generator(0.5, 0.1, [34, 30], Drift::Order4),
            ),
            (
                0.1,
                Drift::Order8,
                on_mesh(&friction, 0.1, [34, 30], Drift::Order8),
            ),
        ] {
            let start = gaussian(&generator);
            let t = 0.4;
            let exact = exponential(&generator, &start, t);
            for (name, mut scheme) in schemes(&generator) {
                let order = scheme.order();
                // Twice the steps until the error is 1e-4 or less: then the rate over the last doubling.
                let mut errors: Vec<f64> = Vec::new();
                let mut steps = (t / scheme.longest_step()).ceil().max(8.0);
                for _ in 0..5 {
                    let mut cells = start.cells().to_vec();
                    for _ in 0..steps as usize {
                        scheme.advance(&mut cells, t / steps, 1e-14).unwrap();
                    }
                    errors.push(distance(&cells, &exact));
                    steps *= 2.0;
                    if errors.last().is_some_and(|e| *e < 1e-9) {
                        break;
                    }
                }
                let n = errors.len();
                let rate = (errors[n - 2] / errors[n - 1]).log2();
                let shown: Vec<String> = errors.iter().map(|e| format!("{e:.1e}")).collect();
                let shown = shown.join(" ");
                println!("zeta = {zeta} {drift:?} {name}: {shown}, rate {rate:.2} of {order}");
                assert!(rate > f64::from(order) - 0.3, "{name}");
                let level = if order == 1 { 1e-3 } else { 2e-6 };
                assert!(errors[n - 1] < level, "{name}");
            }
        }
    }

    #[test]
    fn mass_and_the_stationary_law_are_kept_to_rounding_by_every_scheme() {
        for (zeta, drift) in [(0.05, Drift::Order8), (5.0, Drift::Order4)] {
            let generator = generator(zeta, 0.1, [34, 30], drift);
            let stationary = Density::from_fn(&generator, |_, _| 0.0);
            let mut law = stationary.cells().to_vec();
            generator.weigh(&vec![1.0; law.len()], &mut law);
            let gaussian = gaussian(&generator);
            let mass = gaussian.mass();
            let mut all = schemes(&generator);
            all.push(("Chebyshev", Box::new(Chebyshev::new(&generator))));
            for (name, mut scheme) in all {
                let (mut worst, mut drifted): (f64, f64) = (0.0, 0.0);
                for part in [0.1, 1.0] {
                    let dt = part * scheme.longest_step().min(0.5);
                    let (mut kept, mut moved) = (law.clone(), gaussian.cells().to_vec());
                    for _ in 0..50 {
                        scheme.advance(&mut kept, dt, 1e-6).unwrap();
                        scheme.advance(&mut moved, dt, 1e-6).unwrap();
                        worst = worst.max(distance(&kept, &law));
                        drifted = drifted.max((moved.iter().sum::<f64>() - mass).abs());
                    }
                }
                println!("zeta = {zeta} {name}: stationary law {worst:.1e}, mass {drifted:.1e}");
                assert!(worst < 1e-12 && drifted < 1e-12, "{name}");
            }
        }
    }

    #[test]
    fn backward_euler_with_upwind_drift_is_positive_for_every_step() {
        let generator = generator(0.05, 0.1, [40, 36], Drift::Upwind);
        let mut scheme = BackwardEuler::new(&generator);
        let n = generator.mesh().len();
        for dt in [1e-4, 1e-2, 1.0, 1e2, 1e4, 1e6] {
            // All probability in one cell: the roughest start.
            let mut cells = vec![0.0; n];
            cells[20 * 36 + 9] = 1.0;
            let mut lowest = f64::INFINITY;
            for _ in 0..5 {
                scheme.advance(&mut cells, dt, 0.0).unwrap();
                lowest = cells.iter().copied().fold(lowest, f64::min);
            }
            let mass = cells.iter().sum::<f64>() - 1.0;
            println!("dt = {dt:.0e}: lowest {lowest:.1e}, mass {mass:.1e}");
            assert!(lowest >= 0.0);
            assert!(mass.abs() < 1e-15 * (dt * generator.rates().0).max(1e3));
        }
    }

    #[test]
    fn the_radius_bounds_the_spectrum_far_more_tightly_than_row_sums() {
        let generator = generator(0.05, 0.1, [34, 30], Drift::Order8);
        let (transport, diffusion) = generator.radii();
        let rows = generator.rates();
        // The antisymmetric part by its square, the largest eigenvalue of which is the radius squared.
        let dense = generator.symmetrised().to_dense();
        let n = dense.nrows();
        let skew = (&dense - &dense.t()) / 2.0;
        let symmetric = (&dense + &dense.t()) / 2.0;
        let largest = |a: &Array2<f64>| {
            let mut x = Array1::from_shape_fn(n, |k| ((k * 7919) % 1009) as f64 - 504.0);
            let mut size = 0.0;
            for _ in 0..600 {
                let y = a.dot(&a.dot(&x));
                size = (y.dot(&y) / x.dot(&x)).sqrt().sqrt();
                x = &y / y.dot(&y).sqrt();
            }
            size
        };
        let exact = [largest(&skew), largest(&symmetric)];
        println!("Lanczos {transport:.2} {diffusion:.2}, exact {exact:.2?}, row sums {rows:.1?}");
        for (bound, exact) in [(transport, exact[0]), (diffusion, exact[1])] {
            assert!(bound > exact && bound < 1.03 * exact);
        }
        assert!(rows.0 > 2.0 * transport);
    }
}
