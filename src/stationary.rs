//! The stationary law in closed form, (21)-(30): densities, moments, loss of contact.

use crate::contact::ContactLaw;
use crate::error::Result;
use crate::estimate::{Estimate, Origin};
use crate::gaussian::maxwell;
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
            left_out: 0,
        }
    }

    /// The stationary law of `oscillator`.
    ///
    /// # Errors
    /// [`crate::Error::NoStationaryLaw`] for a contact that does not confine; [`crate::Error::Invalid`] for damping that is not
    /// viscous, under which there is no closed form.
    pub fn of(oscillator: &Oscillator) -> Result<Self> {
        Ok(Self {
            oscillator: oscillator.with_closed_form()?.clone(),
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
        maxwell(v, self.temperature())
    }

    /// The continuous part of p_N, p_q(q)/|G'(q)| over every q with N = G(q), (27), (28). It is zero below the force
    /// of flight without a second wall, infinite just above it for Hertz (29), and without the Dirac mass at the force of
    /// flight, which is [`Stationary::contact_loss_probability`].
    pub fn density_force(&self, force: f64) -> f64 {
        self.contact().density_force(force, |q| self.density_q(q))
    }

    /// P(N <= force), the Dirac mass included.
    pub fn distribution_force(&self, force: f64) -> f64 {
        let below = |q: f64| self.law.ln_tail_below(q).value.exp();
        self.contact().distribution_force(force, below)
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

    /// ln of the probability that contact is lost.
    fn ln_lost(&self) -> Option<Estimate> {
        let [low, loss] = self.contact().flight()?;
        Some(if low.is_finite() {
            self.law.ln_between(low, loss)
        } else {
            self.law.ln_tail_below(loss)
        })
    }

    /// P(q < q_loss), the Dirac mass of (28), or that of the gap before a second wall; 0 where it underflows, with the
    /// smallest normal number as its error. None for a law that cannot lose contact.
    pub fn contact_loss_probability(&self) -> Option<Estimate> {
        let ln = self.ln_lost()?;
        Some(underflowing(ln.mapped(ln.value.exp(), ln.value.exp())))
    }

    /// log10 of the probability that contact is lost, finite also where the probability itself underflows.
    pub fn log10_contact_loss_probability(&self) -> Option<Estimate> {
        Some(self.ln_lost()?.scaled(1.0 / LN_10))
    }

    /// Mean number of losses of contact per unit time, nu = p_q(q_loss) sqrt(T/2 pi): Rice's formula for
    /// the down-crossings of q_loss; with a second wall also the up-crossings of that.
    pub fn loss_rate(&self) -> Option<Estimate> {
        let loss = self.contact().loss_point()?;
        let walls = [Some(loss), self.contact().back_wall()];
        let rates = walls.into_iter().flatten().map(|q| {
            let value = self.law.density(q) * (self.temperature() / TAU).sqrt();
            // The exponent of the density is known to a rounding of its size.
            let rounding = 4.0 * f64::EPSILON * (1.0 + self.law.ln_density(q).abs());
            (value, value * (self.law.relative_error() + rounding))
        });
        let (value, error) = rates.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        let it = Estimate::new(value, error, Origin::Quadrature);
        Some(underflowing(it))
    }

    /// Mean time out of contact per loss, P(lost)/nu. Without a second wall it is sqrt(2 pi T)/|G(q_loss)|: the density
    /// at the loss point cancels, so it is exact also where P and nu underflow.
    pub fn mean_flight(&self) -> Option<Estimate> {
        let contact = self.contact();
        let [low, loss] = contact.flight()?;
        if low == f64::NEG_INFINITY {
            let force = contact.force(loss);
            return Some(Estimate::closed_form(
                (TAU * self.temperature()).sqrt() / -force,
            ));
        }
        // ln of the sum of both densities, over the larger.
        let [a, b] = [low, loss].map(|q| self.law.ln_density(q));
        let (most, least) = (a.max(b), a.min(b));
        let rate = most + (least - most).exp().ln_1p() + 0.5 * (self.temperature() / TAU).ln();
        let ln = self.ln_lost()?;
        let value = (ln.value - rate).exp();
        let rounding = 4.0 * f64::EPSILON * (1.0 + most.abs());
        let error = value * (ln.error + rounding);
        Some(Estimate::new(value, error, Origin::Quadrature))
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
