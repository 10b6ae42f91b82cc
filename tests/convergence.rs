//! Every scheme in space shows its order, against closed forms wherever there is one.

use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::density::Density;
use vibroimpact::fokker_planck::domain::Domain;
use vibroimpact::fokker_planck::flux::Drift;
use vibroimpact::fokker_planck::generator::Generator;
use vibroimpact::fokker_planck::march::RungeKutta4;
use vibroimpact::fokker_planck::mesh::{Axis, Mesh};
use vibroimpact::fokker_planck::observables::Observables;
use vibroimpact::fokker_planck::{Settings, decay_rates};
use vibroimpact::gaussian::Gaussian;
use vibroimpact::initial::Initial;
use vibroimpact::moments::{Moments, RawMoments};
use vibroimpact::oscillator::Oscillator;

const CENTRAL: [Drift; 4] = [Drift::Order2, Drift::Order4, Drift::Order6, Drift::Order8];

fn oscillator(contact: ContactLaw, zeta: f64, temperature: f64) -> Oscillator {
    Oscillator::new(
        contact,
        zeta,
        2.0 * zeta * temperature / std::f64::consts::PI,
    )
    .unwrap()
}

/// A run on one mesh: the generator, the density and the observables.
struct Case {
    generator: Generator,
    density: Density,
    observables: Observables,
}

impl Case {
    fn new(it: &Oscillator, start: &Initial, domain: &Domain, drift: Drift, n: [usize; 2]) -> Self {
        let margin = drift.margin();
        let q = Axis::displacement(it.contact(), it.temperature(), domain.q, n[0], margin).unwrap();
        let v = if it.contact().is_confining() {
            Axis::velocity(domain.v[1], n[1], margin).unwrap()
        } else {
            Axis::uniform(domain.v[0], domain.v[1], n[1]).unwrap()
        };
        let mesh = Mesh { q, v };
        let generator = Generator::new(it, &mesh, drift).unwrap();
        let density = Density::start(&generator, start).unwrap();
        let observables = Observables::new(it, &mesh, drift, generator.weights()).unwrap();
        Self {
            generator,
            density,
            observables,
        }
    }

    /// Runs explicitly for `duration`; the step is the longest stable one, so the error of order 4 in
    /// time is far below the one in space (checked against halved steps when this was written).
    fn run(&mut self, duration: f64) {
        RungeKutta4::new(&self.generator).advance(&mut self.density, duration, f64::INFINITY);
    }

    fn raw(&self) -> RawMoments {
        let inverse = self.generator.inverse_weights();
        let g: Vec<f64> = self
            .density
            .cells()
            .iter()
            .zip(inverse)
            .map(|(p, w)| p * w)
            .collect();
        self.observables.raw(&g)
    }

    fn moments(&self) -> Moments {
        self.raw().moments(self.observables.contact())
    }

    /// L1 distance of the density to an exact one.
    fn l1(&self, exact: &Gaussian) -> f64 {
        let Mesh { q, v } = self.generator.mesh();
        let mut sum = 0.0;
        for i in 0..q.len() {
            for j in 0..v.len() {
                let area = q.slopes()[i] * v.slopes()[j];
                let p = exact.density(q.centres()[i], v.centres()[j]) * area;
                sum += (self.density.cells()[i * v.len() + j] - p).abs();
            }
        }
        sum
    }
}

fn order(coarse: f64, fine: f64, ratio: f64) -> f64 {
    (coarse / fine).ln() / ratio.ln()
}

/// Worst error of mean and covariance.
fn moment_error(m: &Moments, exact: &Gaussian) -> f64 {
    let c = exact.covariance;
    [
        m.mean_q.value - exact.mean[0],
        m.mean_v.value - exact.mean[1],
        m.var_q.value - c[0][0],
        m.cov_qv.value - c[0][1],
        m.var_v.value - c[1][1],
    ]
    .iter()
    .fold(0.0, |worst, e| worst.max(e.abs()))
}

#[test]
fn central_drift_reaches_orders_2_4_6_8_on_the_linear_oscillator_and_in_free_flight() {
    for contact in [ContactLaw::Linear, ContactLaw::Free] {
        for zeta in [0.005, 0.05, 0.5] {
            let it = oscillator(contact.clone(), zeta, 0.25);
            let start = Initial::gaussian([0.4, -0.2], [0.45, 0.4]).unwrap();
            let until = 1.0;
            let domain = if contact == ContactLaw::Linear {
                Domain::closed(&it, &start, 1e-10).unwrap()
            } else {
                Domain::swept(&it, &start, until, 1e-10).unwrap()
            };
            let exact = Gaussian::of(&it, &start)
                .unwrap()
                .after(&it, until)
                .unwrap();
            let meshes = if contact == ContactLaw::Linear {
                [80, 104]
            } else {
                [112, 144]
            };
            for drift in CENTRAL {
                let errors = meshes.map(|n| {
                    let mut case = Case::new(&it, &start, &domain, drift, [n, n]);
                    case.run(until);
                    (case.l1(&exact), moment_error(&case.moments(), &exact))
                });
                let margin = 2 * drift.margin();
                let ratio = (meshes[1] - margin) as f64 / (meshes[0] - margin) as f64;
                let orders = [
                    order(errors[0].0, errors[1].0, ratio),
                    order(errors[0].1, errors[1].1, ratio),
                ];
                let claimed = drift.order() as f64;
                assert!((orders[0] - claimed).abs() < 0.3, "L1 {orders:?}");
                // What the box leaves out, 1e-10 and its moments, ends the fall of the moments.
                if errors[1].1 > 5e-9 {
                    assert!((orders[1] - claimed).abs() < 0.3, "moments {orders:?}");
                }
                let level = [2e-2, 1e-3, 1e-4, 1e-5][drift.half_width() - 1];
                assert!(
                    errors[1].0 < level && errors[1].1 < 0.1 * level,
                    "{errors:?}"
                );
                println!(
                    "{} zeta = {zeta} {drift:?}: L1 {:.1e} order {:.2}, moments {:.1e} order {:.2}",
                    contact.name(),
                    errors[1].0,
                    orders[0],
                    errors[1].1,
                    orders[1]
                );
            }
        }
    }
}

/// Integrates dg/dt = generator + source from the exact g and returns the error in L1 weighted by p_s.
fn manufactured(it: &Oscillator, drift: Drift, n: [usize; 2]) -> f64 {
    let domain = Domain::closed(it, &Initial::Stationary, 1e-6).unwrap();
    let case = Case::new(it, &Initial::Stationary, &domain, drift, n);
    let generator = &case.generator;
    let Mesh { q, v } = generator.mesh();
    assert!(!q.is_uniform());
    let (zeta, noise, t) = (it.zeta(), it.noise(), it.temperature());
    let (k, l) = (2.0 / t, 1.5 / t.sqrt());
    let exact = |q: f64, v: f64, t: f64| 1.0 + 0.5 * (k * q + t).sin() * (l * v + 0.3).cos();
    // g_t + v g_q - G g_v - pi h g_vv + 2 zeta v g_v of the exact g.
    let source = |q: f64, v: f64, t: f64| {
        let (s, c) = (k * q + t).sin_cos();
        let (sv, cv) = (l * v + 0.3).sin_cos();
        let g_v = -0.5 * s * l * sv;
        0.5 * c * cv * (1.0 + v * k)
            + (2.0 * zeta * v - it.contact().force(q)) * g_v
            + noise * 0.5 * s * l * l * cv
    };
    let cells: Vec<(f64, f64)> = q
        .centres()
        .iter()
        .flat_map(|q| v.centres().iter().map(move |v| (*q, *v)))
        .collect();
    let inverse = generator.inverse_weights();
    let rate = |g: &[f64], t: f64| -> Vec<f64> {
        let mut out = vec![0.0; g.len()];
        generator.apply(g, &mut out);
        out.iter()
            .zip(inverse)
            .zip(&cells)
            .map(|((r, w), (q, v))| {
                if *w > 0.0 {
                    r * w + source(*q, *v, t)
                } else {
                    0.0
                }
            })
            .collect()
    };
    let at = |g: &[f64], k: &[f64], dt: f64| -> Vec<f64> {
        g.iter().zip(k).map(|(g, k)| g + dt * k).collect()
    };
    let mut g: Vec<f64> = cells.iter().map(|(q, v)| exact(*q, *v, 0.0)).collect();
    let until = 1.0;
    let steps = (until / RungeKutta4::new(generator).longest_step()).ceil();
    let dt = until / steps;
    for n in 0..steps as usize {
        let t = n as f64 * dt;
        let k1 = rate(&g, t);
        let k2 = rate(&at(&g, &k1, dt / 2.0), t + dt / 2.0);
        let k3 = rate(&at(&g, &k2, dt / 2.0), t + dt / 2.0);
        let k4 = rate(&at(&g, &k3, dt), t + dt);
        for (i, g) in g.iter_mut().enumerate() {
            *g += dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
    }
    let rim = generator.rim();
    let number = generator.numbering();
    let mut error = 0.0;
    for (cell, (q, v)) in cells.iter().enumerate() {
        if number[cell] != usize::MAX && !rim[number[cell]] {
            error += (g[cell] - exact(*q, *v, until)).abs() / inverse[cell];
        }
    }
    error
}

#[test]
fn a_manufactured_solution_on_a_mapped_mesh_shows_the_orders_until_the_kink() {
    let it = oscillator(ContactLaw::Hertz, 0.05, 20.0);
    for drift in CENTRAL {
        let errors = [[96, 80], [120, 100], [150, 125]].map(|n| manufactured(&it, drift, n));
        println!(
            "{drift:?}: {:?} orders {:.2} {:.2}",
            errors.map(|e| format!("{e:.1e}")),
            order(errors[0], errors[1], 1.25),
            order(errors[1], errors[2], 1.25)
        );
    }
}

#[test]
fn hertz_with_loss_of_contact_converges_to_itself() {
    let it = oscillator(ContactLaw::Hertz, 0.005, 0.628_318_530_717_958_6);
    let start = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    let domain = Domain::closed(&it, &start, 1e-7).unwrap();
    for drift in CENTRAL {
        let m = [[96, 60], [136, 85], [192, 120], [272, 170]].map(|n| {
            let mut case = Case::new(&it, &start, &domain, drift, n);
            case.run(5.0);
            case.moments()
        });
        println!("{drift:?}");
        for i in 0..10 {
            let x = m.map(|m| m.named()[i].1.unwrap().value);
            let d = [x[0] - x[1], x[1] - x[2], x[2] - x[3]].map(f64::abs);
            println!(
                "   {:16} {:?} {:.2} {:.2}",
                m[0].named()[i].0,
                d.map(|e| format!("{e:.1e}")),
                (d[0] / d[1]).log2() * 2.0,
                (d[1] / d[2]).log2() * 2.0
            );
        }
    }
}
