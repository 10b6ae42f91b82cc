//! Contact laws: the restoring force G(q), its potential U(q) and its stiffness G'(q).

use crate::error::{Error, Result};
use crate::quadrature;
use crate::roots::bisect;
use std::fmt;
use std::sync::Arc;

/// A contact law given in code, for [`ContactLaw::Custom`].
///
/// The force must be continuous and never fall with q, so that exp(-U/T) has one hump. Below its
/// [loss point](Restoring::loss_point) it must be constant: flight under the preload.
///
/// ```
/// use vibroimpact::contact::{ContactLaw, Restoring};
///
/// /// Line contact of two cylinders: force ~ compression^(10/9), unit stiffness at q = 0.
/// #[derive(Debug)]
/// struct Line;
/// impl Restoring for Line {
///     fn name(&self) -> &str {
///         "line"
///     }
///     fn force(&self, q: f64) -> f64 {
///         (1.0 + 0.9 * q).max(0.0).powf(10.0 / 9.0) - 1.0
///     }
///     fn loss_point(&self) -> Option<f64> {
///         Some(-1.0 / 0.9)
///     }
/// }
/// let law = ContactLaw::custom(Line)?;
/// assert!((law.stiffness(0.0) - 1.0).abs() < 1e-6);
/// # Ok::<(), vibroimpact::Error>(())
/// ```
pub trait Restoring: fmt::Debug + Send + Sync {
    /// A short name for tables and files.
    fn name(&self) -> &str;

    /// G(q), dimensionless.
    fn force(&self, q: f64) -> f64;

    /// U(q), the integral of G from 0 to q. The default integrates [`Restoring::force`]
    /// numerically, split at the loss point; a closed form is faster.
    fn potential(&self, q: f64) -> f64 {
        let (a, b) = (q.min(0.0), q.max(0.0));
        let mut breaks = vec![a, b];
        if let Some(loss) = self.loss_point().filter(|loss| *loss > a && *loss < b) {
            breaks.insert(1, loss);
        }
        quadrature::integrate(|s| self.force(s), &breaks, 1e-15).value * q.signum()
    }

    /// G'(q). The default is a central difference (error about 1e-10).
    fn stiffness(&self, q: f64) -> f64 {
        let step = 6e-6 * q.abs().max(1.0);
        (self.force(q + step) - self.force(q - step)) / (2.0 * step)
    }

    /// The q below which contact is lost and the force constant, if there is one.
    fn loss_point(&self) -> Option<f64>;
}

/// The restoring force of the contact, in units of the static load, against the dimensionless
/// displacement q of (6). Equilibrium at q = 0 with unit stiffness for every built-in law that confines.
///
/// ```
/// use vibroimpact::contact::ContactLaw;
/// assert_eq!(ContactLaw::Hertz.force(0.0), 0.0);
/// assert_eq!(ContactLaw::Hertz.loss_point(), Some(-1.5)); // beyond it, flight: G = -1
/// ```
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum ContactLaw {
    /// G = [(1 + 2q/3)_+]^{3/2} - 1, contact lost below q = -3/2. (9), (26).
    Hertz,
    /// G = (1 + q)_+ - 1, contact lost below q = -1. (34).
    Bilinear,
    /// G = q: never loses contact.
    Linear,
    /// G = -1: never in contact, no stationary law. Falls under the preload; for tests.
    Free,
    /// A law from code.
    Custom(Arc<dyn Restoring>),
}

impl ContactLaw {
    /// A law from code, checked on a sample of points: finite, and a force that never falls.
    ///
    /// # Errors
    /// [`Error::Invalid`] where the force is not finite or falls with q, or is not constant below
    /// the loss point.
    pub fn custom(law: impl Restoring + 'static) -> Result<Self> {
        let loss = law.loss_point();
        let name = format!("contact law \"{}\"", law.name());
        let samples: Vec<f64> = (-400..=400).map(|k| (f64::from(k) * 0.02).sinh()).collect();
        for pair in samples.windows(2) {
            let (low, high) = (law.force(pair[0]), law.force(pair[1]));
            if !low.is_finite() || !high.is_finite() || low > high + 1e-12 * high.abs() {
                let value = format!("G({}) = {low}, G({}) = {high}", pair[0], pair[1]);
                return Err(Error::invalid(
                    name,
                    value,
                    "a finite force that never falls with q",
                ));
            }
            if loss.is_some_and(|loss| pair[1] < loss) && low != high {
                let value = format!("G({}) = {low}, G({}) = {high}", pair[0], pair[1]);
                return Err(Error::invalid(
                    name,
                    value,
                    "a constant force below the loss point",
                ));
            }
        }
        Ok(Self::Custom(Arc::new(law)))
    }

    /// The name used in scenes and tables.
    pub fn name(&self) -> &str {
        match self {
            Self::Hertz => "hertz",
            Self::Bilinear => "bilinear",
            Self::Linear => "linear",
            Self::Free => "free",
            Self::Custom(law) => law.name(),
        }
    }

    /// G(q).
    #[inline]
    pub fn force(&self, q: f64) -> f64 {
        match self {
            Self::Hertz => {
                let x = (1.0 + q * (2.0 / 3.0)).max(0.0);
                x * x.sqrt() - 1.0
            }
            Self::Bilinear => q.max(-1.0),
            Self::Linear => q,
            Self::Free => -1.0,
            Self::Custom(law) => law.force(q),
        }
    }

    /// U(q), the integral of G from 0 to q, to rounding relative to U (no cancellation near q = 0).
    pub fn potential(&self, q: f64) -> f64 {
        match self {
            Self::Hertz => hertz_potential(q),
            Self::Bilinear => {
                if q >= -1.0 {
                    0.5 * q * q
                } else {
                    -q - 0.5
                }
            }
            Self::Linear => 0.5 * q * q,
            Self::Free => -q,
            Self::Custom(law) => law.potential(q),
        }
    }

    /// G'(q); at a kink of the force, the value on the side of contact.
    pub fn stiffness(&self, q: f64) -> f64 {
        match self {
            Self::Hertz => (1.0 + q * (2.0 / 3.0)).max(0.0).sqrt(),
            Self::Bilinear => f64::from(u8::from(q >= -1.0)),
            Self::Linear => 1.0,
            Self::Free => 0.0,
            Self::Custom(law) => law.stiffness(q),
        }
    }

    /// The q below which contact is lost (15): -3/2 for Hertz, -1 for bilinear. Below it the force is
    /// constant. None where the law cannot lose contact (or never has it).
    pub fn loss_point(&self) -> Option<f64> {
        match self {
            Self::Hertz => Some(-1.5),
            Self::Bilinear => Some(-1.0),
            Self::Linear | Self::Free => None,
            Self::Custom(law) => law.loss_point(),
        }
    }

    /// The displacement at which the contact carries the force N = G(q) > G(loss point): the inverse
    /// of (26), q = (3/2)[(1 + N)^{2/3} - 1] for Hertz. None below the force of flight, and for a law
    /// without contact.
    pub(crate) fn displacement_at(&self, force: f64) -> Option<f64> {
        if self
            .loss_point()
            .is_some_and(|loss| force <= self.force(loss))
        {
            return None;
        }
        match self {
            Self::Hertz => Some(1.5 * ((1.0 + force).powf(2.0 / 3.0) - 1.0)),
            Self::Bilinear | Self::Linear => Some(force),
            Self::Free => None,
            Self::Custom(law) => {
                let q0 = self.equilibrium()?;
                let beyond = |q: f64| law.force(q) >= force;
                let high = expand(q0, 1.0, beyond);
                let low = self
                    .loss_point()
                    .unwrap_or_else(|| expand(q0, -1.0, |q| !beyond(q)));
                Some(bisect(low, high, beyond))
            }
        }
    }

    /// Whether exp(-U/T) can be normalised: the force is negative far left and positive far right.
    pub fn is_confining(&self) -> bool {
        match self {
            Self::Hertz | Self::Bilinear | Self::Linear => true,
            Self::Free => false,
            Self::Custom(law) => law.force(-1e6) < 0.0 && law.force(1e6) > 0.0,
        }
    }

    /// The q with G(q) = 0, where U is smallest; 0 for the built-in laws. None without one.
    pub fn equilibrium(&self) -> Option<f64> {
        match self {
            Self::Hertz | Self::Bilinear | Self::Linear => Some(0.0),
            Self::Free => None,
            Self::Custom(_) => {
                if !self.is_confining() {
                    return None;
                }
                let right = expand(0.0, 1.0, |q| self.force(q) >= 0.0);
                let left = expand(0.0, -1.0, |q| self.force(q) <= 0.0);
                Some(bisect(left, right, |q| self.force(q) >= 0.0))
            }
        }
    }

    /// Smallest value of U: 0 for the built-in confining laws. None without one.
    pub(crate) fn lowest_potential(&self) -> Option<f64> {
        self.equilibrium().map(|q| self.potential(q))
    }

    /// The two turning points (left, right) of the undamped motion with energy `rise` above the
    /// equilibrium, U = U_min + rise. None for a law that does not confine.
    pub fn turning_points(&self, rise: f64) -> Option<(f64, f64)> {
        let q0 = self.equilibrium()?;
        let level = self.potential(q0) + rise;
        let outside = |q: f64| self.potential(q) >= level;
        // A first guess from unit stiffness keeps tiny and huge levels within a few doublings.
        let reach = (2.0 * rise).sqrt().max(f64::MIN_POSITIVE);
        let left = expand(q0, -reach, outside);
        let right = expand(q0, reach, outside);
        Some((bisect(q0, left, outside), bisect(q0, right, outside)))
    }
}

/// Built-in laws are equal by kind, a custom law to itself only.
impl PartialEq for ContactLaw {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Custom(a), Self::Custom(b)) => Arc::ptr_eq(a, b),
            _ => std::mem::discriminant(self) == std::mem::discriminant(other),
        }
    }
}

/// U(q) = (3/5)[(1+x)^{5/2} - 1] - q with x = 2q/3, without cancellation near q = 0.
fn hertz_potential(q: f64) -> f64 {
    let x = q * (2.0 / 3.0);
    if x <= -1.0 {
        return -q - 0.6;
    }
    if x.abs() > 0.1 {
        let y = 1.0 + x;
        return 0.6 * (y * y * y.sqrt() - 1.0) - q;
    }
    // (3/5) sum_{k>=2} binomial(5/2, k) x^k; the terms fall faster than 0.1^k, 17 reach rounding.
    let (mut term, mut sum) = (1.875 * x * x, 0.0);
    for k in 2..19 {
        sum += term;
        let k = f64::from(k);
        term *= x * (2.5 - k) / (k + 1.0);
    }
    0.6 * sum
}

/// First point q0 + step, q0 + 2 step, q0 + 4 step... where `done` holds.
fn expand(q0: f64, step: f64, done: impl Fn(f64) -> bool) -> f64 {
    let mut reach = step;
    // 2100 doublings span every finite double.
    for _ in 0..2100 {
        if done(q0 + reach) {
            break;
        }
        reach *= 2.0;
    }
    q0 + reach
}
