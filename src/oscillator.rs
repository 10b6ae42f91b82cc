//! The oscillator: contact law, damping and noise, and its Gibbs law exp(-H/T).

pub(crate) mod displacement_law;

pub use displacement_law::DisplacementLaw;

use crate::contact::ContactLaw;
use crate::damping::{Averaged, Damping};
use crate::error::{Error, Result, finite, positive};
use crate::format::num;
use crate::initial::Initial;
use std::sync::{Arc, OnceLock};

/// q'' + 2 zeta q' + G(q) = f(t), white noise f of two-sided spectral density h, E f(t)f(0) =
/// 2 pi h delta(t). (9)-(11), (16). All quantities are dimensionless, (6)-(8).
///
/// ```
/// use vibroimpact::{contact::ContactLaw, oscillator::Oscillator};
/// let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3)?;
/// assert!((oscillator.temperature() - 0.628).abs() < 1e-3); // T = pi h/(2 zeta)
/// # Ok::<(), vibroimpact::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Oscillator {
    contact: ContactLaw,
    zeta: f64,
    h: f64,
    damping: Damping,
    /// The law averaged over orbits, where it is not exp(-H/T)/Z.
    averaged: Option<Arc<Averaged>>,
    /// T of the law that everything is weighed with.
    temperature: f64,
    /// Normalised when first asked for, then kept.
    law: OnceLock<DisplacementLaw>,
}

impl PartialEq for Oscillator {
    fn eq(&self, other: &Self) -> bool {
        (&self.contact, self.zeta, self.h, &self.damping)
            == (&other.contact, other.zeta, other.h, &other.damping)
    }
}

impl Oscillator {
    /// The lowest and the highest T: the force N = (1 + 2q/3)^{3/2} holds a deviation of 1e-12 to four digits, and a flight to
    /// -1e12 the static compression that it began with.
    const TEMPERATURES: [f64; 2] = [1e-24, 1e12];

    /// Those of a linear contact, which has no length of its own: a double holds T^4.
    const OF_LINEAR: [f64; 2] = [f64::MIN_POSITIVE, 1e75];

    /// An oscillator with damping ratio `zeta` > 0 and noise level `h` > 0.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a damping ratio or level that is not finite and positive, or a T beyond what doubles resolve.
    pub fn new(contact: ContactLaw, zeta: f64, h: f64) -> Result<Self> {
        let temperatures = match contact {
            ContactLaw::Linear => Self::OF_LINEAR,
            _ => Self::TEMPERATURES,
        };
        Self::within(contact, (zeta, h), temperatures)
    }

    /// One that a density is taken against, as hot as that asks for.
    pub(crate) fn reference(contact: ContactLaw, zeta: f64, h: f64) -> Result<Self> {
        Self::within(contact, (zeta, h), [f64::MIN_POSITIVE, 1e307])
    }

    fn within(
        contact: ContactLaw,
        (zeta, h): (f64, f64),
        [coldest, hottest]: [f64; 2],
    ) -> Result<Self> {
        positive("oscillator.zeta", zeta)?;
        positive("oscillator.h", h)?;
        let it = Self {
            contact,
            zeta,
            h,
            damping: Damping::Viscous,
            averaged: None,
            temperature: std::f64::consts::PI * h / (2.0 * zeta),
            law: OnceLock::new(),
        };
        let t = it.temperature();
        if !(t <= hottest && t >= coldest) {
            let value = format!("{h:e} with oscillator.zeta = {zeta:e}");
            let accepted = if t > 1.0 {
                format!("T = pi h/(2 zeta) of at most {hottest:e}")
            } else {
                format!("T = pi h/(2 zeta) of at least {coldest:e}")
            };
            let accepted =
                accepted + ", so that a double tells the motion from the static compression";
            return Err(Error::invalid("oscillator.h", value, accepted));
        }
        Ok(it)
    }

    /// The same with another damping law. Damping in contact is viscous damping where contact is never lost.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a damping that acts in contact where there is none, or would be negative;
    /// [`Error::NoStationaryLaw`] for one that does not hold the motion.
    pub fn with_damping(self, damping: Damping) -> Result<Self> {
        let mut it = Self {
            averaged: None,
            temperature: self.viscous_temperature(),
            law: OnceLock::new(),
            ..self
        };
        let damping = match damping {
            Damping::Contact if it.contact.is_confining() && it.contact.loss_point().is_none() => {
                Damping::Viscous
            }
            other => other,
        };
        if !damping.is_viscous() {
            if !it.contact.is_confining() {
                let (damping, contact) = (damping.name(), it.contact.name());
                let value = format!("\"{damping}\" with oscillator.contact = \"{contact}\"");
                let accepted = "\"viscous\" for a contact that does not hold the motion";
                return Err(Error::invalid("oscillator.damping", value, accepted));
            }
            damping.suits(&it.contact)?;
            let averaged = Averaged::of(&it.contact, &damping, [it.zeta, it.temperature])?;
            it.temperature = averaged.reference_temperature();
            it.averaged = Some(Arc::new(averaged));
        }
        it.damping = damping;
        Ok(it)
    }

    /// The energy above the lowest where the law averaged over orbits has fallen by so many powers of e.
    pub(crate) fn energy_at(&self, fall: f64) -> f64 {
        self.averaged
            .as_ref()
            .map_or(fall * self.temperature, |it| fall * it.temperature_at(fall))
    }

    /// The same weighed with the Gibbs law of another temperature.
    pub(crate) fn of_temperature(&self, temperature: f64) -> Self {
        Self {
            temperature,
            law: OnceLock::new(),
            ..self.clone()
        }
    }

    /// The contact law.
    pub fn contact(&self) -> &ContactLaw {
        &self.contact
    }

    /// The damping law.
    pub fn damping(&self) -> &Damping {
        &self.damping
    }

    /// Whether c = 2 zeta everywhere, so that the stationary law is exp(-H/T)/Z.
    pub fn is_viscous(&self) -> bool {
        self.damping.is_viscous()
    }

    /// Refuses friction under which the stationary law is not exp(-H/T)/Z.
    pub(crate) fn with_closed_form(&self) -> Result<&Self> {
        if self.is_viscous() {
            return Ok(self);
        }
        let accepted =
            "\"viscous\" for a closed form: under other damping the stationary law is solved for";
        let damping = self.damping.name();
        Err(Error::invalid("oscillator.damping", damping, accepted))
    }

    /// c at displacement q; for a rate that depends on the energy at v = 0.
    pub fn friction(&self, q: f64) -> f64 {
        self.friction_at(q, 0.0)
    }

    /// c at (q, v).
    pub(crate) fn friction_at(&self, q: f64, v: f64) -> f64 {
        2.0 * self.zeta * self.damping.factor(&self.contact, q, v)
    }

    /// Whether friction, more than force, may bound how deep motions come in at either end of an interval: where that is beyond
    /// a wall, and friction is not the same in flight.
    pub(crate) fn holds_back(&self, [low, high]: [f64; 2]) -> [bool; 2] {
        match self.contact.flight() {
            Some([back, loss]) if !self.damping.has_closed_form() => [low < back, high > loss],
            _ => [false; 2],
        }
    }

    /// The largest c that a motion meets whose energy is so much above the lowest.
    pub(crate) fn highest_friction(&self, rise: f64) -> f64 {
        if self.is_viscous() {
            return 2.0 * self.zeta;
        }
        let turning = self.contact.turning_points(rise);
        let (left, right) = turning.unwrap_or((0.0, 0.0));
        self.highest_friction_between([left, right])
    }

    /// The largest c on a sample of points between two displacements.
    pub(crate) fn highest_friction_between(&self, [from, to]: [f64; 2]) -> f64 {
        let at = |k: i32| from + (to - from) * f64::from(k) / 64.0;
        (0..=64).map(|k| self.friction(at(k))).fold(0.0, f64::max)
    }

    /// The rate at which noise alone would keep the reference temperature, pi h/T: 2 zeta under viscous damping.
    pub(crate) fn reference_friction(&self) -> f64 {
        if self.is_viscous() {
            2.0 * self.zeta
        } else {
            self.noise() / self.temperature
        }
    }

    /// P(H - U_min > energy) of the law averaged over orbits; 0 under viscous damping, where exp(-H/T)/Z is exact.
    pub(crate) fn averaged_beyond(&self, energy: f64) -> f64 {
        self.averaged.as_ref().map_or(0.0, |it| it.beyond(energy))
    }

    /// The energy above the lowest beyond which the law averaged over orbits holds no more than a probability; 0 under viscous damping.
    pub(crate) fn averaged_within(&self, probability: f64) -> f64 {
        let averaged = self.averaged.as_ref();
        averaged.map_or(0.0, |it| it.within(probability))
    }

    /// Damping ratio.
    pub fn zeta(&self) -> f64 {
        self.zeta
    }

    /// Two-sided spectral density of the excitation, (10).
    pub fn h(&self) -> f64 {
        self.h
    }

    /// T of the Gibbs law exp(-H/T)/Z. Under viscous damping that is the stationary law, T = pi h/(2 zeta) is the
    /// variance of the velocity and the law's only parameter. Under any other it is the reference that solvers weigh
    /// with, hotter where the true law has longer tails ([`crate::damping`]).
    pub fn temperature(&self) -> f64 {
        self.temperature
    }

    /// E\[v^2\] of the stationary law, of that averaged over orbits where it has no closed form: what scales are taken from.
    pub(crate) fn kinetic_temperature(&self) -> f64 {
        let averaged = self.averaged.as_ref();
        averaged.map_or(self.temperature, |it| it.kinetic_temperature())
    }

    /// T = pi h/(2 zeta), whatever the damping law.
    pub fn viscous_temperature(&self) -> f64 {
        self.noise() / (2.0 * self.zeta)
    }

    /// The correlation time of the motion: 1/(2 zeta) under weak friction, 2 zeta under strong.
    pub(crate) fn correlation_time(&self) -> f64 {
        (1.0 / self.reference_friction()).max(2.0 * self.zeta)
    }

    /// The time in which it forgets where it began, roughly: the correlation time, and where there are several wells that times
    /// exp(rise over T), the lowest barrier of the shallowest well, about that of a passage (Kramers).
    pub(crate) fn relaxation_time(&self) -> f64 {
        let rises = self.contact.rises().into_iter();
        let rise = rises.reduce(f64::max).unwrap_or(0.0);
        self.correlation_time() * (rise / self.temperature()).exp()
    }

    /// The time in which the slowest of the continuous spectrum fades; 0 where there is none, or no slowest.
    pub(crate) fn flight_relaxation(&self) -> f64 {
        let edge = self.continuous_from().filter(|edge| *edge < 0.0);
        edge.map_or(0.0, |edge| -1.0 / edge)
    }

    /// pi h: the diffusion coefficient of the velocity in (17).
    pub fn noise(&self) -> f64 {
        std::f64::consts::PI * self.h
    }

    /// Where the continuous spectrum of the Fokker-Planck operator begins: -f^2/(8 zeta T), f the constant
    /// force out of contact (1 for the built-in laws). None for a contact that is never lost, or whose flight ends on a
    /// second wall. Where no eigenvalue lies above it, distances to the stationary law fall as
    /// t^{-3/2} e^{-f^2 t/(8 zeta T)}.
    ///
    /// 0 where friction acts in contact alone, and a contact stiffens: an impact at speed v takes v times its depth of the
    /// energy and the flight after it lasts as v, so that the speed falls as depth over v, ever more slowly for higher
    /// flights, and no rate is common to all of them. None under any other damping: there it is not known.
    pub fn continuous_from(&self) -> Option<f64> {
        let price = self.price_of_flight()?;
        match self.damping {
            Damping::Viscous => Some(-price),
            Damping::Contact => self.contact.stiffens().then_some(0.0),
            _ => None,
        }
    }

    /// What noise pays, per time, to keep a motion in flight against the constant force f there: f^2/(4 pi h). None for a contact that
    /// is never lost, or whose flight ends on a second wall.
    pub(crate) fn price_of_flight(&self) -> Option<f64> {
        let [low, loss] = self.contact.flight()?;
        let force = self.contact.force(loss - 1.0);
        let noise = 8.0 * self.zeta * self.viscous_temperature();
        (!low.is_finite()).then_some(force * force / noise)
    }

    /// H = v^2/2 + U(q).
    pub fn energy(&self, q: f64, v: f64) -> f64 {
        0.5 * v * v + self.contact.potential(q)
    }

    /// The Gibbs law of q at the temperature of the oscillator, p_q = exp(-U/T)/Z, (22): the stationary one under viscous damping, else
    /// what it is taken against.
    ///
    /// # Errors
    /// [`Error::NoStationaryLaw`] for a contact that does not confine.
    pub fn displacement_law(&self) -> Result<DisplacementLaw> {
        if let Some(law) = self.law.get() {
            return Ok(law.clone());
        }
        let law = DisplacementLaw::new(self.contact.clone(), self.temperature())?;
        Ok(self.law.get_or_init(|| law).clone())
    }
}

/// In which direction a level of q is passed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Side {
    /// Downwards.
    #[default]
    Below,
    /// Upwards.
    Above,
    /// Out of the range from minus the level to the level.
    Either,
}

impl Side {
    /// The name used in scenes and results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Below => "below",
            Self::Above => "above",
            Self::Either => "either",
        }
    }

    /// What passes a level, and which way.
    pub(crate) fn words(self) -> [&'static str; 2] {
        match self {
            Self::Below => ["q", "below"],
            Self::Above => ["q", "above"],
            Self::Either => ["|q|", "above"],
        }
    }
}

/// Where a first passage ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Target {
    /// At the loss of contact.
    Loss,
    /// At a level of q.
    Level(f64, Side),
}

impl Target {
    /// The key of a scene that asks for it.
    pub(crate) fn key(self) -> &'static str {
        match self {
            Self::Loss => "outputs.first_loss",
            Self::Level(..) => "outputs.first_passage",
        }
    }

    /// Where motions survive.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a law that cannot lose contact; for a level that is not finite, whose potential is beyond a
    /// double, that is not above 0 where its negative is one too, or that rest has passed.
    pub(crate) fn range(self, oscillator: &Oscillator, initial: &Initial) -> Result<[f64; 2]> {
        let contact = oscillator.contact();
        let (level, side) = match self {
            Self::Loss => return Ok([contact.loss_for("first_loss")?, f64::INFINITY]),
            Self::Level(level, side) => (level, side),
        };
        let key = "outputs.first_passage.level";
        if !(contact.potential(finite(key, level)?) / oscillator.temperature()).is_finite() {
            let accepted = "a level whose potential energy is within reach of a double";
            return Err(Error::invalid(key, num(level), accepted));
        }
        let range = match side {
            Side::Below => [level, f64::INFINITY],
            Side::Above => [f64::NEG_INFINITY, level],
            Side::Either => [-level, level],
        };
        let rest = *initial == Initial::Rest;
        let passed = rest && !(range[0] < 0.0 && 0.0 < range[1]);
        let accepted = match side {
            Side::Either if level <= 0.0 => "a level > 0 with side = \"either\"",
            Side::Below if passed => "a level below 0, where rest begins, with side = \"below\"",
            Side::Above if passed => "a level above 0, where rest begins, with side = \"above\"",
            _ => return Ok(range),
        };
        Err(Error::invalid(key, level, accepted))
    }
}

/// What a spectrum is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Quantity {
    /// N = G(q).
    #[default]
    Force,
    /// q.
    Displacement,
}

impl Quantity {
    /// Its value at a displacement.
    pub fn of(self, contact: &ContactLaw, q: f64) -> f64 {
        match self {
            Self::Force => contact.force(q),
            Self::Displacement => q,
        }
    }

    /// The name used in scenes and results.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Force => "force",
            Self::Displacement => "displacement",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_paper_s_level_has_the_paper_s_temperature() {
        let it = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
        assert!((it.temperature() - 0.628_318_530_717_958_6).abs() < 1e-15);
        assert!((it.energy(-1.5, 1.0) - 1.4).abs() < 1e-15);
    }

    #[test]
    fn a_damping_ratio_or_level_that_is_not_positive_is_refused_by_name() {
        for (zeta, h, key) in [
            (0.0, 1e-3, "oscillator.zeta"),
            (-0.1, 1e-3, "oscillator.zeta"),
            (f64::NAN, 1e-3, "oscillator.zeta"),
            (0.005, -1.0, "oscillator.h"),
            (0.005, f64::NAN, "oscillator.h"),
            (0.005, f64::INFINITY, "oscillator.h"),
            (1e-300, 1e300, "oscillator.h"),
        ] {
            let message = Oscillator::new(ContactLaw::Hertz, zeta, h)
                .unwrap_err()
                .to_string();
            assert!(message.contains(key), "{message}");
        }
    }
}
