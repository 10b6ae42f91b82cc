//! Damping laws: the rate c of q'' + c q' + G(q) = f, constant, or where the contact is.
//!
//! With a rate that depends on the state there is no closed form: balance holds on the average over a motion, not at
//! every point of the plane. Exact all the same are E\[c v^2\] = pi h and E\[G\] = 0. Where friction is weak the energy
//! changes slowly along an orbit, and averaged over orbits of energy H (Stratonovich, Topics in the Theory of Random
//! Noise II, 1967) the stationary law is
//!
//! ```text
//! p = C exp(-Psi(H)),   Psi'(H) = <c v^2>/(pi h <v^2>),   < > the integral over the time of one period
//! ```
//!
//! exact for a rate that depends on H alone (Caughey, J. Appl. Mech. 31, 1964). `Averaged` is this law. The solvers
//! take from it the Gibbs law that densities are weighed with, and where to end the domain; never an answer.

use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use std::fmt;
use std::sync::Arc;

/// A function of one variable, given in code.
type Function = Arc<dyn Fn(f64) -> f64 + Send + Sync>;

/// How friction depends on the state: c = 2 zeta times a factor.
#[derive(Clone, Default)]
#[non_exhaustive]
pub enum Damping {
    /// c = 2 zeta, always: the paper's.
    #[default]
    Viscous,
    /// c = 2 zeta in contact, none in flight.
    Contact,
    /// c = 2 zeta |1 + G|: in proportion to the contact force, which must not pull: G >= -1 but behind a second wall (Hunt
    /// and Crossley, J. Appl. Mech. 42, 440, 1975).
    HuntCrossley,
    /// c = 2 zeta f(q), from [`Damping::of_displacement`].
    Displacement(Function),
    /// c = 2 zeta f(H), from [`Damping::of_energy`].
    Energy(Function),
}

impl Damping {
    /// c = 2 zeta `factor`(q), smooth but for the loss of contact, checked on a sample of points.
    ///
    /// ```
    /// use vibroimpact::{contact::ContactLaw, damping::Damping, oscillator::Oscillator};
    /// let more_in_contact = Damping::of_displacement(|q| if q > -1.5 { 1.0 } else { 0.2 })?;
    /// let it = Oscillator::new(ContactLaw::Hertz, 0.05, 2e-2)?.with_damping(more_in_contact)?;
    /// assert_eq!(it.friction(0.0), 0.1);
    /// # Ok::<(), vibroimpact::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Invalid`] for a factor that is negative or not finite.
    pub fn of_displacement(factor: impl Fn(f64) -> f64 + Send + Sync + 'static) -> Result<Self> {
        for k in -400..=400 {
            let q = (f64::from(k) * 0.02).sinh();
            let c = factor(q);
            if !(c.is_finite() && c >= 0.0) {
                let value = format!("{c} at q = {q}");
                let accepted = "a finite factor, not negative";
                return Err(Error::invalid("oscillator.damping", value, accepted));
            }
        }
        Ok(Self::Displacement(Arc::new(factor)))
    }

    /// c = 2 zeta `factor`(H), H = v^2/2 + U(q); it may be negative where others hold the motion back. Finite volumes
    /// alone take it: its law is known in closed form, p = C exp(-(2 zeta/(pi h)) times the integral of the factor over
    /// H), so that it is a test of theirs.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a factor that is not finite, or not positive at high energies.
    pub fn of_energy(factor: impl Fn(f64) -> f64 + Send + Sync + 'static) -> Result<Self> {
        let energies = || (0..=120).map(|k| 10f64.powf(f64::from(k) * 0.1 - 6.0));
        let wrong = energies().find(|energy| !factor(*energy).is_finite());
        if let Some(energy) = wrong.or_else(|| (factor(1e6) <= 0.0).then_some(1e6)) {
            let value = format!("{} at H = {energy}", factor(energy));
            let accepted = "a finite factor, positive at high energies";
            return Err(Error::invalid("oscillator.damping", value, accepted));
        }
        Ok(Self::Energy(Arc::new(factor)))
    }

    /// The name used in scenes and tables.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Viscous => "viscous",
            Self::Contact => "contact",
            Self::HuntCrossley => "hunt_crossley",
            Self::Displacement(_) => "a function of q",
            Self::Energy(_) => "a function of H",
        }
    }

    /// The words of its name before others of an oscillator; none for viscous damping.
    pub(crate) fn words(&self) -> String {
        match self {
            Self::Viscous => String::new(),
            it => format!("{} damping, ", it.name()),
        }
    }

    /// Whether c is the same everywhere: the stationary law is then exp(-H/T)/Z.
    pub fn is_viscous(&self) -> bool {
        matches!(self, Self::Viscous)
    }

    /// Whether the stationary law is a function of the energy, known in closed form.
    pub(crate) fn has_closed_form(&self) -> bool {
        matches!(self, Self::Viscous | Self::Energy(_))
    }

    /// Refuses a rate that would be negative under this contact.
    pub(crate) fn suits(&self, contact: &ContactLaw) -> Result<()> {
        const ROUNDING: f64 = 1e-9;
        let samples = (0..=400).map(|k| (f64::from(k) * 0.02).sinh());
        let samples = samples.flat_map(|q| [-q, q]);
        // Two walls without a gap meet where either lets go.
        let meets = |q: &f64| (contact.force(*q) + 1.0).abs() <= ROUNDING;
        let met = || contact.kinks().into_iter().find(meets);
        let wall = contact.back_wall().or_else(met);
        let wall = wall.unwrap_or(f64::NEG_INFINITY);
        let pulls = |q: &f64| *q >= wall && contact.force(*q) < -1.0 - ROUNDING;
        match samples.chain(contact.kinks()).find(pulls) {
            Some(q) if matches!(self, Self::HuntCrossley) => {
                let name = contact.name();
                let value = format!("\"hunt_crossley\" with oscillator.contact = \"{name}\"");
                let accepted = format!(
                    "a contact that never pulls, G >= -1: 2 zeta (1 + G) is {:.3} zeta at q = {q:.3}; or \"viscous\"",
                    2.0 * (1.0 + contact.force(q))
                );
                Err(Error::invalid("oscillator.damping", value, accepted))
            }
            _ => Ok(()),
        }
    }

    /// Refuses, for `who`, a rate that depends on more than the displacement.
    pub(crate) fn depends_on_displacement(&self, who: &str) -> Result<()> {
        if matches!(self, Self::Energy(_)) {
            let accepted = format!("a rate that depends on q alone, for {who}");
            return Err(Error::invalid("oscillator.damping", self.name(), accepted));
        }
        Ok(())
    }

    /// c/(2 zeta) at (q, v).
    #[inline]
    pub fn factor(&self, contact: &ContactLaw, q: f64, v: f64) -> f64 {
        match self {
            Self::Viscous => 1.0,
            Self::Contact => f64::from(u8::from(!contact.is_lost(q))),
            Self::HuntCrossley => (1.0 + contact.force(q)).abs(),
            Self::Displacement(factor) => factor(q),
            Self::Energy(factor) => factor(0.5 * v * v + contact.potential(q)),
        }
    }
}

impl fmt::Debug for Damping {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Those of a name are equal, a function from code to itself only.
impl PartialEq for Damping {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Displacement(a), Self::Displacement(b)) | (Self::Energy(a), Self::Energy(b)) => {
                Arc::ptr_eq(a, b)
            }
            _ => std::mem::discriminant(self) == std::mem::discriminant(other),
        }
    }
}

/// (1 - e^{-x})/x, the mean of e^{-s} over s from 0 to x: what friction leaves of a constant force; 1 in free flight.
#[inline(always)]
pub(crate) fn mean_decay(x: f64) -> f64 {
    if x.abs() > 1e-300 {
        -(-x).exp_m1() / x
    } else {
        1.0
    }
}

/// The stationary law averaged over orbits, C exp(-Psi(H)), on a table of energies.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Averaged {
    /// Energies above the lowest, ascending from 0, and Psi at each.
    energies: Vec<f64>,
    psi: Vec<f64>,
    /// ln of the integral of exp(-Psi) over the plane.
    ln_normaliser: f64,
    /// The integral of exp(-Psi) over the plane beyond each energy, over the whole.
    beyond: Vec<f64>,
    /// E\[v^2\].
    kinetic_temperature: f64,
}

/// Psi at the energy to which the reference law reaches: e^-16 = 1e-7.
const REACH: f64 = 16.0;
/// Psi at which the table ends: e^-60 = 1e-26.
const END: f64 = 60.0;
/// Ratio of energies from one row of the table to the next, and the first row, in T.
const RATIO: f64 = 1.06;
const FIRST: f64 = 1e-3;
/// Energies at most: 1e13 T.
const ROWS: usize = 640;
/// Points of an orbit.
const POINTS: usize = 400;

impl Averaged {
    /// The averaged law of a contact that confines; `temperature` is pi h/(2 zeta). It falls no faster than what noise alone
    /// brings together on an orbit, where friction is less than 2 zeta: an impact that takes all leaves what a flight adds,
    /// of variance 2 pi h times the integral of v^2 over its time.
    ///
    /// # Errors
    /// [`Error::NoStationaryLaw`] where friction does not hold the motion back.
    pub(crate) fn of(
        contact: &ContactLaw,
        damping: &Damping,
        [zeta, temperature]: [f64; 2],
    ) -> Result<Self> {
        let mut it = Self {
            energies: vec![0.0],
            psi: vec![0.0],
            ln_normaliser: 0.0,
            beyond: Vec::new(),
            kinetic_temperature: temperature,
        };
        // Action and loss of the last row; both begin at 0.
        let mut slope_before = None;
        let mut areas = vec![0.0];
        let mut energy = FIRST * temperature;
        let mut lowest: f64 = 0.0;
        for _ in 0..ROWS {
            let [action, loss, free] = orbit(contact, damping, energy);
            let slope = loss / (action * temperature);
            let slope = slope.min(energy / (4.0 * zeta * temperature * free));
            let last = it.energies.len() - 1;
            let before = slope_before.unwrap_or(slope);
            let psi = it.psi[last] + 0.5 * (slope + before) * (energy - it.energies[last]);
            it.energies.push(energy);
            it.psi.push(psi);
            areas.push(action);
            slope_before = Some(slope);
            lowest = lowest.min(psi);
            if psi - lowest > END {
                break;
            }
            energy *= RATIO;
        }
        let end = it.psi[it.psi.len() - 1] - lowest;
        if !(end > REACH && it.psi.iter().all(|psi| psi.is_finite())) {
            return Err(Error::NoStationaryLaw {
                what: "the stationary density".into(),
                contact: contact.name().into(),
                why: format!(
                    "{} damping does not hold the motion: more oscillator.zeta or less oscillator.h may",
                    damping.name()
                ),
            });
        }
        // The area within an energy is the action; Psi between two rows is a straight line in it.
        let rows = it.psi.windows(2).zip(areas.windows(2));
        let masses: Vec<f64> = rows
            .map(|(psi, area)| {
                let rise = psi[1] - psi[0];
                (lowest - psi[0]).exp() * mean_decay(rise) * (area[1] - area[0])
            })
            .collect();
        let total: f64 = masses.iter().sum();
        it.ln_normaliser = total.ln() - lowest;
        // The integral of v^2 over the plane between two energies is that of the action over them.
        let rows = masses
            .iter()
            .zip(it.energies.windows(2))
            .zip(areas.windows(2));
        let squares: f64 = rows
            .map(|((mass, energy), area)| {
                let action = 0.5 * (area[0] + area[1]);
                mass * action * (energy[1] - energy[0]) / (area[1] - area[0])
            })
            .sum();
        it.kinetic_temperature = squares / total;
        it.beyond = vec![0.0; it.psi.len()];
        for k in (0..masses.len()).rev() {
            it.beyond[k] = it.beyond[k + 1] + masses[k] / total;
        }
        Ok(it)
    }

    /// The temperature of the Gibbs law that falls as far as this one where both hold 1e-7 of themselves: between
    /// there and the rest this one, over it, stays within a few powers of ten.
    pub(crate) fn reference_temperature(&self) -> f64 {
        self.temperature_at(REACH)
    }

    /// The same where both hold e^-`reach` of themselves.
    pub(crate) fn temperature_at(&self, reach: f64) -> f64 {
        let lowest = self.psi.iter().copied().fold(0.0, f64::min);
        let end = self.psi.iter().rposition(|psi| psi - lowest <= reach);
        let end = end.unwrap_or(0).max(1);
        self.energies[end] / (self.psi[end] - lowest).max(f64::MIN_POSITIVE)
    }

    /// E\[v^2\], the temperature of most of it, where that of [`Averaged::reference_temperature`] is of its tails.
    pub(crate) fn kinetic_temperature(&self) -> f64 {
        self.kinetic_temperature
    }

    /// The first energy of the table beyond which no more than a probability lies.
    pub(crate) fn within(&self, probability: f64) -> f64 {
        let k = self.beyond.partition_point(|it| *it > probability);
        self.energies[k.min(self.energies.len() - 1)]
    }

    /// P(H - U_min > energy); falls by a straight line of its logarithm between rows.
    pub(crate) fn beyond(&self, energy: f64) -> f64 {
        let k = self.energies.partition_point(|it| *it <= energy);
        if k >= self.energies.len() {
            return 0.0;
        }
        let (a, b) = (self.energies[k - 1], self.energies[k]);
        let share = (energy - a) / (b - a);
        let [low, high] = [self.beyond[k - 1], self.beyond[k]].map(|p| p.max(1e-300).ln());
        (low + share * (high - low)).exp()
    }
}

/// The integrals of v^2, of c/(2 zeta) v^2 and of (1 - c/(2 zeta))_+ v^2 over the time of one period of the orbit of this
/// energy above the lowest: of v times these over dq, there and back. With q = middle + half sin(s) the ends are smooth; split where
/// flight begins and ends.
fn orbit(contact: &ContactLaw, damping: &Damping, energy: f64) -> [f64; 3] {
    let (Some((left, right)), Some(lowest)) =
        (contact.turning_points(energy), contact.lowest_potential())
    else {
        return [f64::NAN; 3];
    };
    let (middle, half) = (0.5 * (left + right), 0.5 * (right - left));
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut ends = vec![-quarter, quarter];
    let walls = contact.flight().into_iter().flatten();
    let within = walls.filter(|q| *q > left && *q < right);
    ends.splice(1..1, within.map(|q| ((q - middle) / half).asin()));
    let mut sums = [0.0; 3];
    for ends in ends.windows(2) {
        let step = (ends[1] - ends[0]) / POINTS as f64;
        for k in 0..POINTS {
            let s = ends[0] + (k as f64 + 0.5) * step;
            let q = middle + half * s.sin();
            let speed = (2.0 * (energy + lowest - contact.potential(q)))
                .max(0.0)
                .sqrt();
            let part = 2.0 * speed * half * s.cos() * step;
            sums[0] += part;
            let factor = damping.factor(contact, q, speed);
            sums[1] += part * factor;
            sums[2] += part * (1.0 - factor).max(0.0);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn viscous_damping_averages_to_the_gibbs_law() {
        for t in [1e-3, 0.6, 90.0] {
            let constant = Damping::of_displacement(|_| 1.0).unwrap();
            let it = Averaged::of(&ContactLaw::Hertz, &constant, [0.05, t]).unwrap();
            for (energy, psi) in it.energies.iter().zip(&it.psi) {
                assert!((psi - energy / t).abs() < 1e-12 * (1.0 + psi));
            }
            assert!((it.reference_temperature() / t - 1.0).abs() < 1e-12);
            assert!((it.kinetic_temperature() / t - 1.0).abs() < 2e-3, "{t}");
        }
        // G = q: P(H > E) = e^{-E/T}.
        let constant = Damping::of_displacement(|_| 1.0).unwrap();
        let it = Averaged::of(&ContactLaw::Linear, &constant, [0.05, 0.5]).unwrap();
        for energy in [0.1, 1.0, 5.0] {
            let exact: f64 = (-energy / 0.5f64).exp();
            let got = it.beyond(energy);
            println!("P(H > {energy}) = {got:.3e}, exactly {exact:.3e}");
            assert!((got / exact - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn damping_in_contact_alone_leaves_long_tails_and_hunt_and_crossley_s_does_not() {
        let ratio = |damping: &Damping, t: f64| {
            let it = Averaged::of(&ContactLaw::Hertz, damping, [0.005, t]).unwrap();
            it.reference_temperature() / t
        };
        for t in [1e-3, 0.6, 1.0, 20.0] {
            let [contact, crossley] =
                [Damping::Contact, Damping::HuntCrossley].map(|it| ratio(&it, t));
            println!("T = {t}: contact {contact:.3}, Hunt-Crossley {crossley:.3} of it");
            assert!(contact >= 1.0 - 1e-9 && (0.9..1.1).contains(&crossley));
            assert!(t < 0.1 || contact > 1.2);
        }
    }

    #[test]
    fn factors_that_make_no_sense_are_refused_by_name() {
        for error in [
            Damping::of_displacement(|q| q).unwrap_err(),
            Damping::of_displacement(|_| f64::NAN).unwrap_err(),
            Damping::of_energy(|h| 1.0 - h).unwrap_err(),
            Damping::of_energy(|_| f64::INFINITY).unwrap_err(),
        ] {
            assert!(error.to_string().contains("oscillator.damping"), "{error}");
        }
    }
}
