//! The test rig: between dimensionless quantities and newtons, metres, hertz and seconds, (2)-(14).

use crate::error::{Result, positive};
use std::f64::consts::{PI, TAU};

/// A loaded contact as the paper measures it: static load, linearised contact frequency and static
/// compression. `Rig::default()` is the paper's, section 2 and (4), (5).
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
}

impl Default for Rig {
    fn default() -> Self {
        Self {
            static_load: 110.0,
            frequency: 232.0,
            static_compression: 7e-6,
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
        })
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

    /// Hertzian constant k in N/m^{3/2}, from (2).
    pub fn contact_constant(&self) -> f64 {
        self.static_load / self.static_compression.powf(1.5)
    }

    /// Moving mass m in kilograms, from (3): m = (3k/2) sqrt(z_s)/Omega^2.
    pub fn mass(&self) -> f64 {
        1.5 * self.contact_constant() * self.static_compression.sqrt()
            / self.circular_frequency().powi(2)
    }

    /// Dimensionless displacement of a compression z in metres, (6).
    pub fn displacement(&self, z: f64) -> f64 {
        1.5 * (z - self.static_compression) / self.static_compression
    }

    /// Compression z in metres of a dimensionless displacement, (6); negative when contact is lost.
    pub fn compression(&self, q: f64) -> f64 {
        self.static_compression * (1.0 + q / 1.5)
    }

    /// Velocity dz/dt in metres per second of a dimensionless velocity, (6), (7).
    pub fn velocity(&self, v: f64) -> f64 {
        self.static_compression / 1.5 * self.circular_frequency() * v
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
