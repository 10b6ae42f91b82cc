//! The stationary law in closed form, (21)-(30): densities, moments, loss of contact.

use crate::contact::ContactLaw;
use crate::error::Result;
use crate::estimate::{Estimate, Origin};
use crate::moments::Moments;
use crate::oscillator::{DisplacementLaw, Oscillator};
use std::f64::consts::{LN_10, TAU};

/// The stationary law p_s(q, v) = exp(-H/T)/Z of an oscillator. (21).
///
/// ```
/// use vibroimpact::{contact::ContactLaw, oscillator::Oscillator, stationary::Stationary};
/// let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3)?;
/// let loss = Stationary::of(&oscillator)?.contact_loss_probability().unwrap();
/// assert!((loss.value - 0.0724557).abs() < 1e-7);
/// # Ok::<(), vibroimpact::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Stationary {
    oscillator: Oscillator,
    law: DisplacementLaw,
}

impl Stationary {
    /// All moments of [`Moments`].
    pub fn moments(&self) -> Moments {
        Moments {
            mean_q: self.mean_q(),
            var_q: self.var_q(),
            mean_v: self.moment_v(1),
            var_v: self.moment_v(2),
            // q and v are independent.
            cov_qv: Estimate::default(),
            mean_force: self.mean_force(),
            std_force: self.std_force(),
            skewness_force: self.skewness_force(),
            kurtosis_force: self.kurtosis_force(),
            mean_energy: self.mean_energy(),
            contact_loss_probability: self.contact_loss_probability(),
        }
    }

    /// The stationary law of `oscillator`.
    ///
    /// # Errors
    /// [`crate::Error::NoStationaryLaw`] for a contact that does not confine.
    pub fn of(oscillator: &Oscillator) -> Result<Self> {
        Ok(Self {
            oscillator: oscillator.clone(),
            law: oscillator.displacement_law()?,
        })
    }

    /// The oscillator.
    pub fn oscillator(&self) -> &Oscillator {
        &self.oscillator
    }

    /// The law of q.
    pub fn displacement_law(&self) -> &DisplacementLaw {
        &self.law
    }

    fn contact(&self) -> &ContactLaw {
        self.oscillator.contact()
    }

    fn temperature(&self) -> f64 {
        self.oscillator.temperature()
    }

    /// p_s(q, v), (21).
    pub fn density(&self, q: f64, v: f64) -> f64 {
        self.density_q(q) * self.density_v(v)
    }

    /// p_q(q), (22), (23).
    pub fn density_q(&self, q: f64) -> f64 {
        self.law.density(q)
    }

    /// p_v(v), Gaussian of variance T, (24).
    pub fn density_v(&self, v: f64) -> f64 {
        let t = self.temperature();
        (-0.5 * v * v / t).exp() / (TAU * t).sqrt()
    }

    /// The continuous part of p_N, p_q(q)/G'(q) at N = G(q), (27), (28). It is zero below the force of
    /// flight, infinite just above it for Hertz (29), and without the Dirac mass at N = -1, which is
    /// [`Stationary::contact_loss_probability`].
    pub fn density_force(&self, force: f64) -> f64 {
        match self.contact().displacement_at(force) {
            Some(q) => self.density_q(q) / self.contact().stiffness(q),
            None => 0.0,
        }
    }

    /// P(N <= force), the Dirac mass included.
    pub fn distribution_force(&self, force: f64) -> f64 {
        match (
            self.contact().displacement_at(force),
            self.contact().loss_point(),
        ) {
            (Some(q), _) => self.law.ln_tail_below(q).value.exp(),
            (None, Some(loss)) if force >= self.contact().force(loss) => {
                self.law.ln_tail_below(loss).value.exp()
            }
            _ => 0.0,
        }
    }

    /// E\[q^n\], (25).
    pub fn moment_q(&self, n: u32) -> Estimate {
        self.law.expect(|q| q.powi(n as i32))
    }

    /// E\[v^n\] = T^{n/2} (n-1)!! for even n, 0 for odd n.
    pub fn moment_v(&self, n: u32) -> Estimate {
        if n % 2 == 1 {
            return Estimate::closed_form(0.0);
        }
        let double_factorial: f64 = (1..n).step_by(2).map(f64::from).product();
        Estimate::closed_form(self.temperature().powi((n / 2) as i32) * double_factorial)
    }

    /// E\[N^n\], the Dirac mass included, (30).
    pub fn moment_force(&self, n: u32) -> Estimate {
        self.law.expect(|q| self.contact().force(q).powi(n as i32))
    }

    /// E\[q\].
    pub fn mean_q(&self) -> Estimate {
        self.moment_q(1)
    }

    /// Var q.
    pub fn var_q(&self) -> Estimate {
        let mean = self.mean_q().value;
        self.law.expect(|q| (q - mean).powi(2))
    }

    /// E\[N\]: 0 exactly in theory, and here to the error of the quadrature.
    pub fn mean_force(&self) -> Estimate {
        self.moment_force(1)
    }

    fn central_force(&self, n: i32) -> Estimate {
        let mean = self.mean_force().value;
        self.law
            .expect(|q| (self.contact().force(q) - mean).powi(n))
    }

    /// Standard deviation of N.
    pub fn std_force(&self) -> Estimate {
        let variance = self.central_force(2);
        let std = variance.value.sqrt();
        variance.mapped(std, 0.5 / std)
    }

    /// E[(N - E N)^n]/std^n with its error to first order.
    fn standardised_force(&self, n: i32) -> Estimate {
        let (moment, std) = (self.central_force(n), self.std_force());
        let value = moment.value / std.value.powi(n);
        let relative = f64::from(n) * std.error / std.value;
        let error = moment.error / std.value.powi(n) + relative * value.abs().max(1.0);
        Estimate::new(value, error, Origin::Quadrature)
    }

    /// Skewness of N.
    pub fn skewness_force(&self) -> Estimate {
        self.standardised_force(3)
    }

    /// Kurtosis of N; 3 for a Gaussian.
    pub fn kurtosis_force(&self) -> Estimate {
        self.standardised_force(4)
    }

    /// Mean energy E\[H\] = T/2 + E\[U\], U counted from q = 0.
    pub fn mean_energy(&self) -> Estimate {
        let potential = self.law.expect(|q| self.contact().potential(q));
        let value = 0.5 * self.temperature() + potential.value;
        Estimate::new(value, potential.error, Origin::Quadrature)
    }

    /// P(q < q_loss), the Dirac mass of (28); 0 where it underflows, with the smallest normal number as
    /// its error. None for a law that cannot lose contact.
    pub fn contact_loss_probability(&self) -> Option<Estimate> {
        let ln = self.law.ln_tail_below(self.contact().loss_point()?);
        Some(underflowing(ln.mapped(ln.value.exp(), ln.value.exp())))
    }

    /// log10 P(q < q_loss), finite also where the probability itself underflows.
    pub fn log10_contact_loss_probability(&self) -> Option<Estimate> {
        let ln = self.law.ln_tail_below(self.contact().loss_point()?);
        Some(ln.scaled(1.0 / LN_10))
    }

    /// Mean number of losses of contact per unit time, nu = p_q(q_loss) sqrt(T/2 pi): Rice's formula for
    /// the down-crossings of q_loss.
    pub fn loss_rate(&self) -> Option<Estimate> {
        let loss = self.contact().loss_point()?;
        let value = self.law.density(loss) * (self.temperature() / TAU).sqrt();
        // The exponent of the density is known to a rounding of its size.
        let rounding = 4.0 * f64::EPSILON * (1.0 + self.law.ln_density(loss).abs());
        let error = value * (self.law.relative_error() + rounding);
        Some(underflowing(Estimate::new(
            value,
            error,
            Origin::Quadrature,
        )))
    }

    /// Mean time out of contact per loss, P(loss)/nu = sqrt(2 pi T)/|G(q_loss)|: the density at the loss
    /// point cancels, so it is exact also where P and nu underflow.
    pub fn mean_flight(&self) -> Option<Estimate> {
        let force = self.contact().force(self.contact().loss_point()?);
        Some(Estimate::closed_form(
            (TAU * self.temperature()).sqrt() / -force,
        ))
    }

    /// Mean speed at the return to contact, sqrt(pi T/2): the velocity at a crossing has the Rayleigh law,
    /// and returns are losses seen backwards in time. None for a law that cannot lose contact.
    pub fn mean_impact_speed(&self) -> Option<Estimate> {
        self.contact().loss_point()?;
        let value = (0.25 * TAU * self.temperature()).sqrt();
        Some(Estimate::closed_form(value))
    }

    /// Mean number of losses of contact in a dimensionless time.
    pub fn losses_in(&self, time: f64) -> Option<Estimate> {
        self.loss_rate().map(|rate| rate.scaled(time))
    }
}

/// A positive number too small for a double is below the smallest normal one, not exactly 0.
fn underflowing(it: Estimate) -> Estimate {
    Estimate {
        error: it.error.max(f64::MIN_POSITIVE),
        ..it
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;

    fn law(contact: ContactLaw, zeta: f64, h: f64) -> Stationary {
        Stationary::of(&Oscillator::new(contact, zeta, h).unwrap()).unwrap()
    }

    /// `value` printed as `reference` is: the same digits.
    fn same_digits(value: f64, reference: &str) {
        let (digits, exponent) = match reference.split_once('e') {
            Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().unwrap()),
            None => (reference, 0),
        };
        let decimals = digits.split_once('.').map_or(0, |(_, d)| d.len());
        let printed = format!("{:.decimals$}", value / 10f64.powi(exponent));
        assert_eq!(printed, digits, "{value} against {reference}");
    }

    #[test]
    fn the_closed_form_reproduces_the_reference_table_digit_by_digit() {
        // h, T, std N, skew N, P(loss) at zeta = 0.005, from an independent 30-digit quadrature
        // (0.072455645955 at h = 2e-3).
        for (h, t, std, skewness, loss) in [
            (3e-6, "9.4248e-4", "0.030698", "0.020474", "0"),
            (8e-5, "0.025133", "0.158308", "0.106754", "1.7725e-17"),
            (5e-4, "0.157080", "0.392361", "0.285310", "5.1030e-4"),
            (1.2e-3, "0.376991", "0.595294", "0.505015", "0.022060"),
            (2e-3, "0.628319", "0.747927", "0.711501", "0.0724556"),
            (3.2e-3, "1.005310", "0.911292", "0.950790", "0.15134"),
        ] {
            let it = law(ContactLaw::Hertz, 0.005, h);
            same_digits(it.temperature(), t);
            same_digits(it.std_force().value, std);
            same_digits(it.skewness_force().value, skewness);
            same_digits(it.contact_loss_probability().unwrap().value, loss);
        }
        let it = law(ContactLaw::Hertz, 0.005, 2e-3);
        same_digits(it.mean_q().value, "-0.1645479");
        same_digits(it.var_q().value, "0.8099608");
        same_digits(it.loss_rate().unwrap().value, "0.03646636");
    }

    #[test]
    fn the_exact_identities_hold_at_every_level_for_every_law() {
        let mut worst: f64 = 0.0;
        for contact in [ContactLaw::Hertz, ContactLaw::Bilinear, ContactLaw::Linear] {
            for t in [1e-8, 3e-4, 0.01, 0.63, 10.0, 94.0, 1e4, 1e6] {
                let it = law(contact.clone(), 0.005, t * 0.01 / std::f64::consts::PI);
                let name = format!("{} at T = {t}", contact.name());
                let std = it.std_force();
                let qg = it.displacement_law().expect(|q| q * contact.force(q));
                // E[G] = 0, E[qG] = T, E[v^2] = T, each relative to its natural scale.
                let errors = [
                    it.mean_force().value / std.value,
                    qg.value / t - 1.0,
                    it.moment_v(2).value / t - 1.0,
                ];
                for error in errors {
                    worst = worst.max(error.abs());
                    assert!(error.abs() < 1e-10, "{name}: {errors:?}");
                }
                for number in [qg, it.mean_q(), it.var_q(), it.mean_force(), std] {
                    assert!(
                        number.error < 1e-10 * number.value.abs().max(1.0).max(t),
                        "{name}: {number}"
                    );
                }
                assert!(
                    it.mean_force().value.abs() <= it.mean_force().error,
                    "{name}"
                );
                assert!((qg.value - t).abs() <= qg.error + 1e-15 * t, "{name}: {qg}");
            }
        }
        println!("largest violation of the identities: {worst:.1e}");
    }

    #[test]
    fn a_loss_probability_far_below_the_smallest_double_has_its_logarithm() {
        let it = law(ContactLaw::Hertz, 0.005, 1e-6);
        let log = it.log10_contact_loss_probability().unwrap();
        // ln P = -0.9/T + ln(T p_q(loss) e^{0.9/T}): T = pi 1e-4, Z = sqrt(2 pi T) (1 + O(T)).
        let t = it.temperature();
        let asymptotic = (-0.9 / t + 0.5 * (t / TAU).ln()) / LN_10;
        println!("log10 P(loss) = {log}, asymptotic {asymptotic:.4}");
        assert!((log.value - asymptotic).abs() < 1e-3 && log.value < -1200.0);
        assert_eq!(it.contact_loss_probability().unwrap().value, 0.0);
        assert!((it.mean_flight().unwrap().value - (TAU * t).sqrt()).abs() < 1e-15);
    }

    #[test]
    fn the_loss_rate_is_the_one_of_the_linear_oscillator_where_there_is_no_loss() {
        // Bilinear at small T: p_q is Gaussian up to the loss point, nu = exp(-1/(2T))/(2 pi).
        let it = law(
            ContactLaw::Bilinear,
            0.005,
            0.02 * 0.01 / std::f64::consts::PI,
        );
        let nu = it.loss_rate().unwrap().value;
        assert!(
            (nu * TAU / (-0.5f64 / 0.02).exp() - 1.0).abs() < 1e-9,
            "{nu}"
        );
        let per_time = it.losses_in(10.0).unwrap().value;
        assert!((per_time / nu - 10.0).abs() < 1e-12);
    }

    #[test]
    fn the_density_of_the_force_integrates_to_one_with_its_dirac_mass() {
        for contact in [ContactLaw::Hertz, ContactLaw::Bilinear] {
            let it = law(contact, 0.005, 2e-3);
            let dirac = it.contact_loss_probability().unwrap().value;
            // N = -1 + s^3 removes the (1+N)^{-1/3} singularity of (29).
            let f = |s: f64| it.density_force(s.powi(3) - 1.0) * 3.0 * s * s;
            let rest = crate::quadrature::integrate(f, &[0.0, 0.5, 1.0, 2.0, 3.0], 1e-12).value;
            assert!((dirac + rest - 1.0).abs() < 1e-10, "{dirac} {rest}");
            assert!((it.distribution_force(-1.0) - dirac).abs() < 1e-15);
            assert!((it.distribution_force(30.0) - 1.0).abs() < 1e-12);
            assert_eq!(it.density_force(-1.0001), 0.0);
        }
        let it = law(ContactLaw::Hertz, 0.005, 2e-3);
        assert!(
            it.density_force(-1.0 + 1e-12) > 100.0 * it.density_force(-0.999),
            "(29)"
        );
    }

    #[test]
    fn velocity_moments_are_gaussian_and_the_linear_law_is_gaussian_throughout() {
        let it = law(ContactLaw::Linear, 0.05, 0.01);
        let t = it.temperature();
        for (n, factor) in [(0, 1.0), (1, 0.0), (2, 1.0), (4, 3.0), (6, 15.0)] {
            let (q, v) = (it.moment_q(n), it.moment_v(n));
            let exact = factor * t.powi(n as i32 / 2);
            assert!(
                (q.value - exact).abs() < 1e-12 && (v.value - exact).abs() < 1e-12,
                "{n}"
            );
        }
        assert!(it.skewness_force().value.abs() < 1e-12);
        assert!((it.kurtosis_force().value - 3.0).abs() < 1e-12);
        assert!(it.contact_loss_probability().is_none() && it.loss_rate().is_none());
        assert!((it.mean_energy().value - t).abs() < 1e-14);
    }

    #[test]
    fn a_law_without_a_stationary_law_says_so() {
        let oscillator = Oscillator::new(ContactLaw::Free, 0.005, 2e-3).unwrap();
        let error = Stationary::of(&oscillator).unwrap_err();
        assert!(matches!(error, Error::NoStationaryLaw { .. }), "{error}");
        assert!(error.to_string().contains("free"));
    }
}
