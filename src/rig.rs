//! The test rig: between dimensionless quantities and newtons, metres, hertz and seconds, (2)-(14).

use crate::contact::ContactLaw;
use crate::error::{Result, positive};
use std::f64::consts::{PI, TAU};

/// z_s in units of q under the Hertz law, (6).
const HERTZ: f64 = 1.5;

/// A loaded contact as the paper measures it: static load, linearised contact frequency and static
/// compression. `Rig::default()` is the paper's, section 2 and (4), (5). Lengths, and with them velocities and the mass, are
/// of the Hertz law, but for [`Rig::with_contact`].
///
/// ```
/// use vibroimpact::rig::Rig;
/// let rig = Rig::default();
/// let h = rig.level_from_force_psd(0.17); // 0.17 N^2/Hz, one-sided
/// assert!((h - 1.63e-3).abs() < 1e-5);
/// assert!((rig.force_psd_from_level(h) - 0.17).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Rig {
    static_load: f64,
    frequency: f64,
    static_compression: f64,
    /// The same in units of q.
    #[serde(skip)]
    preload: f64,
}

impl Default for Rig {
    fn default() -> Self {
        Self {
            static_load: 110.0,
            frequency: 232.0,
            static_compression: 7e-6,
            preload: HERTZ,
        }
    }
}

impl Rig {
    /// A rig with static load F_s in newtons, linearised contact frequency f_0 in hertz and static
    /// compression z_s in metres.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for a value that is not finite and positive.
    pub fn new(static_load: f64, frequency: f64, static_compression: f64) -> Result<Self> {
        positive("rig.static_load", static_load)?;
        positive("rig.frequency", frequency)?;
        positive("rig.static_compression", static_compression)?;
        Ok(Self {
            static_load,
            frequency,
            static_compression,
            preload: HERTZ,
        })
    }

    /// The same rig with another contact than Hertz's: z_s is [`ContactLaw::static_compression`] in units of q.
    #[must_use]
    pub fn with_contact(self, contact: &ContactLaw) -> Self {
        Self {
            preload: contact.static_compression(),
            ..self
        }
    }

    /// F_s in newtons.
    pub fn static_load(&self) -> f64 {
        self.static_load
    }

    /// f_0 = Omega/(2 pi) in hertz, (5).
    pub fn frequency(&self) -> f64 {
        self.frequency
    }

    /// z_s in metres, (2), (4).
    pub fn static_compression(&self) -> f64 {
        self.static_compression
    }

    /// Omega in radians per second, (3).
    pub fn circular_frequency(&self) -> f64 {
        TAU * self.frequency
    }

    /// Metres of one unit of q, (6): 2 z_s/3 under the Hertz law.
    fn length(&self) -> f64 {
        self.static_compression / self.preload
    }

    /// Hertzian constant k in N/m^{3/2}, from (2).
    pub fn contact_constant(&self) -> f64 {
        self.static_load / self.static_compression.powf(1.5)
    }

    /// Moving mass m in kilograms, from (3): the stiffness F_s over one unit of q, by Omega^2; under the Hertz law
    /// m = (3k/2) sqrt(z_s)/Omega^2.
    pub fn mass(&self) -> f64 {
        self.static_load / self.length() / self.circular_frequency().powi(2)
    }

    /// Dimensionless displacement of a compression z in metres, (6).
    pub fn displacement(&self, z: f64) -> f64 {
        (z - self.static_compression) / self.length()
    }

    /// Compression z in metres of a dimensionless displacement, (6); negative when contact is lost.
    pub fn compression(&self, q: f64) -> f64 {
        self.static_compression + q * self.length()
    }

    /// Velocity dz/dt in metres per second of a dimensionless velocity, (6), (7).
    pub fn velocity(&self, v: f64) -> f64 {
        self.length() * self.circular_frequency() * v
    }

    /// Micrometres of one dimensionless displacement.
    pub(crate) fn micrometres(&self) -> f64 {
        (self.compression(1.0) - self.compression(0.0)) * 1e6
    }

    /// Millimetres per second of one dimensionless velocity.
    pub(crate) fn millimetres_per_second(&self) -> f64 {
        self.velocity(1.0) * 1e3
    }

    /// Dimensionless time of seconds, (7).
    pub fn time(&self, seconds: f64) -> f64 {
        self.circular_frequency() * seconds
    }

    /// Seconds of a dimensionless time, (7).
    pub fn seconds(&self, time: f64) -> f64 {
        time / self.circular_frequency()
    }

    /// Hertz of a dimensionless circular frequency, (8).
    pub fn hertz(&self, omega: f64) -> f64 {
        omega * self.frequency
    }

    /// Dimensionless circular frequency of a frequency in hertz, (8).
    pub fn omega(&self, hertz: f64) -> f64 {
        hertz / self.frequency
    }

    /// Newtons of a dimensionless dynamic force N; the static load is not included.
    pub fn newtons(&self, force: f64) -> f64 {
        self.static_load * force
    }

    /// S_0 = F_s^2 h/Omega in N^2 s, two-sided per circular frequency, (12).
    pub fn two_sided_psd(&self, h: f64) -> f64 {
        self.static_load.powi(2) * h / self.circular_frequency()
    }

    /// G_0 = 4 pi S_0 = 2 F_s^2 h/f_0 in N^2/Hz, one-sided, (13), (14).
    pub fn force_psd_from_level(&self, h: f64) -> f64 {
        4.0 * PI * self.two_sided_psd(h)
    }

    /// h = f_0 G_0/(2 F_s^2) from the one-sided density G_0 in N^2/Hz, (14).
    pub fn level_from_force_psd(&self, g0: f64) -> f64 {
        self.frequency * g0 / (2.0 * self.static_load.powi(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::{Parameter, Parameters};

    /// The stiffness F_s/length of small vibrations, and where contact is lost, of laws whose force in newtons is known.
    #[test]
    fn lengths_are_those_of_the_contact() {
        let rig = Rig::new(100.0, 200.0, 6e-6).unwrap();
        let power = |n: f64| {
            let given = Parameters::new().with("exponent", Parameter::Number(n));
            ContactLaw::given("power", &given).unwrap()
        };
        // F = F_s (z/z_s)^n has the stiffness n F_s/z_s at z_s.
        for (contact, n) in [
            (ContactLaw::Hertz, 1.5),
            (ContactLaw::Bilinear, 1.0),
            (ContactLaw::Linear, 1.0),
            (power(10.0 / 9.0), 10.0 / 9.0),
            (power(2.0), 2.0),
        ] {
            let rig = rig.with_contact(&contact);
            let stiffness = n * 100.0 / 6e-6;
            let mass = stiffness / rig.circular_frequency().powi(2);
            assert!((rig.mass() / mass - 1.0).abs() < 1e-14, "{contact:?}");
            if let Some(lost) = contact.loss_point() {
                assert!(rig.compression(lost).abs() < 1e-20, "{contact:?}");
            }
            let there = rig.displacement(rig.compression(0.7));
            assert!((there - 0.7).abs() < 1e-14, "{contact:?}");
        }
        // Without a gap, and without a loss of contact: where G = -1.
        let walls = Parameters::new()
            .with("exponent", Parameter::Number(1.5))
            .with("gap", Parameter::Number(0.0));
        let cubic = Parameters::new().with("coefficients", Parameter::Numbers(vec![0.5, 0.0, 0.5]));
        for (law, given, expected) in [("power", walls, 1.5), ("polynomial", cubic, 1.0)] {
            let contact = ContactLaw::given(law, &given).unwrap();
            assert!(
                (contact.static_compression() - expected).abs() < 1e-12,
                "{contact:?}"
            );
        }
    }
}
