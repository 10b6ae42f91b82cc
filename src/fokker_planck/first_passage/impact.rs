//! The law of an impact in stationary motion: what wears a contact. A flight of the time t ends with the speed c; the
//! contact that follows, were it undamped, presses up to the force N.
//!
//! The speed has the law of Rayleigh whatever the friction, as returns are losses seen backwards in time. The force is the
//! G(q) at which U(q) = U(q_loss) + c^2/2, so that p(N) = G/(T G') exp(-(U - U(q_loss))/T).

use super::flight::{Flight, centres, fastest};
use crate::error::Result;
use crate::estimate::{Estimate, Origin};
use crate::oscillator::Oscillator;
use rayon::prelude::*;

/// The joint law of time of flight and speed at the return, and that of the peak force after it.
#[derive(Debug, Clone, PartialEq)]
pub struct ImpactLaw {
    /// Times of flight.
    pub times: Vec<f64>,
    /// Speeds at the return.
    pub speeds: Vec<f64>,
    /// Joint density of the two, speed running fastest.
    pub density: Vec<Estimate>,
    /// Density of each speed.
    pub speed_density: Vec<Estimate>,
    /// Peak forces of an undamped contact, of equally spaced speeds.
    pub forces: Vec<f64>,
    /// Density of each force.
    pub force_density: Vec<Estimate>,
}

/// Points along times, speeds and forces.
const POINTS: [usize; 3] = [64, 40, 120];

/// The impacts of the stationary motion, up to speeds of 4.7 deviations of the velocity (a share of 2e-5 is faster).
///
/// # Errors
/// [`crate::Error::Invalid`] for a contact law that cannot lose contact, or has a second wall, or for damping that is not
/// viscous.
pub fn impact_law(oscillator: &Oscillator) -> Result<ImpactLaw> {
    let flight = Flight::of(oscillator.with_closed_form()?)?;
    let fastest = fastest(oscillator);
    let times = centres(2.0 * fastest / flight.pull(), POINTS[0]);
    let speeds = centres(fastest, POINTS[1]);
    let places: Vec<[f64; 2]> = times
        .iter()
        .flat_map(|t| speeds.iter().map(|c| [*t, *c]))
        .collect();
    let density = places
        .par_iter()
        .map(|[t, c]| flight.joint(*t, *c))
        .collect();
    let exact = |value: f64| Estimate::new(value, 8.0 * f64::EPSILON * value, Origin::ClosedForm);
    let contact = oscillator.contact();
    let peaks = centres(fastest, POINTS[2]).into_iter().filter_map(|c| {
        let q = contact.rebound(c)?;
        let force = contact.force(q);
        Some((force, flight.rayleigh(c) / c * force / contact.stiffness(q)))
    });
    let (forces, force_density) = peaks.map(|(force, p)| (force, exact(p))).unzip();
    Ok(ImpactLaw {
        density,
        speed_density: speeds.iter().map(|c| exact(flight.rayleigh(*c))).collect(),
        times,
        speeds,
        forces,
        force_density,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::ContactLaw;
    use crate::quadrature::integrate;

    #[test]
    fn the_marginals_of_the_joint_law_are_those_of_rayleigh_and_of_the_flight() {
        for (zeta, h) in [(0.005, 2e-3), (0.05, 2e-2), (0.02, 0.3)] {
            let it = Oscillator::new(ContactLaw::Hertz, zeta, h).unwrap();
            let flight = Flight::of(&it).unwrap();
            let deviation = it.temperature().sqrt();
            let breaks: Vec<f64> = (0..=12).map(|k| f64::from(k) * 0.5 * deviation).collect();
            for k in [0.3, 1.0, 2.5, 4.0] {
                let t = k * deviation;
                let whole = flight.density(t);
                let sum = integrate(|c| flight.joint(t, c).value, &breaks, 1e-9).value;
                let doubt = integrate(|c| flight.joint(t, c).error, &breaks, 1e-3).value;
                println!("zeta {zeta}, t {t:.2}: {sum:.8} for {whole}, {doubt:.1e}");
                assert!((sum - whole.value).abs() <= whole.error + doubt + 1e-8 * whole.value);
            }
            for k in [0.2, 1.0, 2.0] {
                let c = k * deviation;
                let ends: Vec<f64> = (0..=40)
                    .map(|k| f64::from(k) * 0.5 * deviation + 1e-9)
                    .collect();
                let sum = integrate(|t| flight.joint(t, c).value, &ends, 1e-7).value;
                let doubt = integrate(|t| flight.joint(t, c).error, &ends, 1e-2).value;
                let exact = flight.rayleigh(c);
                println!("zeta {zeta}, c {c:.2}: {sum:.6}, Rayleigh {exact:.6}, doubt {doubt:.1e}");
                assert!(
                    (sum - exact).abs() <= doubt + 1e-5 * exact,
                    "{sum} {exact} {doubt}"
                );
            }
        }
    }

    #[test]
    fn the_peak_force_is_that_of_the_energy_and_its_density_has_mass_one() {
        for contact in [ContactLaw::Hertz, ContactLaw::Bilinear] {
            let it = Oscillator::new(contact.clone(), 0.005, 2e-3).unwrap();
            let law = impact_law(&it).unwrap();
            let pairs = law.forces.windows(2).zip(law.force_density.windows(2));
            let mass: f64 = pairs
                .map(|(n, p)| 0.5 * (n[1] - n[0]) * (p[0].value + p[1].value))
                .sum();
            println!("{}: {mass}", contact.name());
            assert!((mass - 1.0).abs() < 2e-3);
            // The slowest impact presses by no more than a drop from the loss point does.
            let drop = contact.rebound(0.0).unwrap();
            let loss = contact.loss_point().unwrap();
            assert!((contact.potential(drop) - contact.potential(loss)).abs() < 1e-12);
        }
        // Bilinear: N = sqrt(1 + c^2).
        let q = ContactLaw::Bilinear.rebound(2.0).unwrap();
        assert!((ContactLaw::Bilinear.force(q) - 5f64.sqrt()).abs() < 1e-12);
    }
}
