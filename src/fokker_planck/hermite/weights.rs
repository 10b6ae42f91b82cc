//! What functions of q and v are weighed with, and how far they reach.
//!
//! Under viscous damping the weight is the stationary law, exp(-H/T)/Z. Under a friction that depends on the displacement the law p
//! may fall more slowly than any Gibbs law: noise alone throws a flight, and a height x falls as exp(-c sqrt(x)). Polynomials under
//! exp(-H/T) look the farther the higher their degree, and p over the weight grows there without bound. But a function of H
//! passes through transport, v d/dq - G d/dv, so that with s and a tilt g from 0 to 1
//!
//! ```text
//! p = exp(-H/s) p',   f = exp(-g H/s) f',   p' and f' of h_n(v ((1 + g)/s)^{1/2}) and of functions of q
//! ```
//!
//! costs friction and noise an entry more, from n to n + 2. Functions of v are orthonormal under the Gaussian of variance s/(1 + g);
//! those of q are polynomials, orthonormal under exp(-(1 - g) U/s), times exp(g U/s), so that a constant is one of them. g = 0 is
//! the Gibbs law of temperature s, under which a constant is one function; at g = 1 both sides fall alike, whatever falls is held,
//! and a constant no longer (Hermite functions weighed asymmetrically and symmetrically; Schumer and Holloway, J. Comput. Phys.
//! 144, 626, 1998). N functions of v leave g^{N/2} of a constant beyond the last, and hold a law that falls within what they see
//! by N (1 - g)/(1 + g) powers of e or more: with g = (N - F)/(N + F) both are what p leaves, e^-F, beyond the truncated domain.

use super::resolution::Resolution;
use crate::error::Result;
use crate::oscillator::{DisplacementLaw, Oscillator};

/// Weights of functions of q and v.
#[derive(Debug, Clone, Copy)]
pub(in crate::fokker_planck) struct Weights {
    /// s.
    temperature: f64,
    /// g.
    tilt: f64,
    /// The truncated domain reaches to this energy above the lowest.
    pub(super) energy: f64,
}

/// How finely N functions tell the velocities of a motion of temperature T that reaches to the energy E: they hold the law down to
/// as many powers of e, N sqrt(2 T/E) times this. Of spectra to 1e-3 under damping in contact, zeta = 0.05 and 0.5, T = 0.5 and 2,
/// with 1.1 three take 2.5 times as long or miss, and the fourth meets what 1.8 misses; with 3 the two hotter ones miss by more.
const TOLD: f64 = 1.8;

/// The functions of v see so many times the energy of the domain: with 1.0 that at zeta = 0.05, T = 2 takes 7.7 s for 2.9 s.
const SEEN: f64 = 1.4;

impl Weights {
    /// The weights of a resolution.
    pub(in crate::fokker_planck) fn of(oscillator: &Oscillator, it: Resolution) -> Self {
        let temperature = oscillator.viscous_temperature();
        // Well over a barrier between two wells, which the slowest motion passes.
        let barrier = oscillator.contact().barrier();
        let barrier = barrier.map_or(0.0, |it| it + 10.0 * oscillator.temperature());
        if oscillator.is_viscous() {
            return Self {
                temperature,
                tilt: 0.0,
                energy: (it.level * temperature).max(barrier),
            };
        }
        // Friction may be more than 2 zeta where most of the motion is, or less wherever it goes.
        let highest = oscillator.highest_friction(oscillator.energy_at(it.level));
        let temperature = temperature
            .min(oscillator.energy_at(1.0))
            .max(oscillator.noise() / highest.max(f64::MIN_POSITIVE));
        let n = 2.0 * it.pairs as f64;
        let told = |fall: f64| TOLD * n * (2.0 * temperature / oscillator.energy_at(fall)).sqrt();
        let mut fall = it.level;
        while fall > 2.0 && fall > told(fall) {
            fall -= 0.25;
        }
        let energy = oscillator.energy_at(fall).max(barrier);
        let tilt = ((n - fall) / (n + fall)).max(0.0);
        Self {
            temperature: temperature.max((1.0 + tilt) * SEEN * energy / (2.0 * n)),
            tilt,
            energy,
        }
    }

    /// The temperature at which functions of v are orthonormal.
    pub(super) fn in_v(self) -> f64 {
        self.temperature / (1.0 + self.tilt)
    }

    /// That at which polynomials of q are.
    pub(super) fn in_q(self) -> f64 {
        self.temperature / (1.0 - self.tilt)
    }

    /// The law of the displacement at that.
    pub(super) fn of_displacement(self, oscillator: &Oscillator) -> Result<DisplacementLaw> {
        if oscillator.is_viscous() {
            return oscillator.displacement_law();
        }
        oscillator.of_temperature(self.in_q()).displacement_law()
    }

    /// The temperature of the factor of p.
    pub(super) fn of_law(self) -> f64 {
        self.temperature
    }

    /// The temperatures by which G is divided in d/dq + G/T and in -d/dq + G/T.
    pub(super) fn pulls(self) -> [f64; 2] {
        [self.temperature / self.tilt, self.temperature]
    }

    /// |l| |r|/|l.r| of the left and the right vector of a mode that rises as H^3 where friction is weak: l, a power of exp(-H), is
    /// then v -> -v of r times exp(-g H/s).
    pub(super) fn skew(self) -> f64 {
        (1.0 - self.tilt * self.tilt).powf(-3.5)
    }

    /// Factors of the friction c and of the noise pi h, over the temperature of the functions, in what they make of h_n: of h_{n-2},
    /// n and once of h_n itself, of h_{n+2}.
    pub(super) fn friction(self) -> [[f64; 2]; 4] {
        let b = -self.tilt / (1.0 + self.tilt);
        [
            [-(1.0 + b), (1.0 + b) * (1.0 + b)],
            [-(1.0 + 2.0 * b), 2.0 * b * (1.0 + b)],
            [-b, b * (1.0 + b)],
            [-b, b * b],
        ]
    }

    /// The integrals of the even functions over the factor of p, as far as any is not 0: the constant in f'.
    pub(super) fn constant(self, pairs: usize) -> Vec<f64> {
        let count = if self.tilt == 0.0 { 1 } else { pairs };
        let mut all = vec![1.0];
        for m in 1..count {
            let n = 2.0 * m as f64;
            all.push(all[m - 1] * self.tilt * ((n - 1.0) / n).sqrt());
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::super::operator::Hierarchy;
    use super::*;
    use crate::contact::ContactLaw;
    use crate::damping::Damping;
    use crate::oscillator::Quantity;

    fn resolution(pairs: usize) -> Resolution {
        Resolution {
            elements: 8,
            pairs,
            level: 20.0,
        }
    }

    #[test]
    fn tilts_are_what_slow_tails_ask_for() {
        let viscous = Oscillator::new(ContactLaw::Hertz, 0.05, 0.064).unwrap();
        let it = Weights::of(&viscous, resolution(40));
        assert_eq!(
            [it.in_v(), it.in_q(), it.tilt],
            [viscous.temperature(), viscous.temperature(), 0.0]
        );
        let heavy = viscous.with_damping(Damping::Contact).unwrap();
        let mut before = 0.0;
        for pairs in [24, 48, 96, 192] {
            let it = Weights::of(&heavy, resolution(pairs));
            let n = 2.0 * pairs as f64;
            // The more functions, the less weight they need to hold what falls slowly.
            assert!(it.tilt > before && it.tilt < 1.0);
            let left = -0.5 * n * it.tilt.ln();
            println!("{n}: {it:?}, e^-{left:.1} of a constant beyond the last function");
            assert!(left > 10.0 && left < 25.0);
            assert!(2.0 * n * it.in_v() >= SEEN * it.energy * (1.0 - 1e-12));
            before = it.tilt;
        }
    }

    #[test]
    fn a_tilted_constant_is_a_null_vector_as_far_as_functions_reach() {
        let it = Oscillator::new(ContactLaw::Hertz, 0.05, 0.064).unwrap();
        let it = it.with_damping(Damping::Contact).unwrap();
        let mut before = f64::INFINITY;
        for pairs in [12, 24, 48] {
            let full = Hierarchy::new(&it, Quantity::Displacement, resolution(pairs)).unwrap();
            let image = full.apply(&full.at_any_speed(&full.basis.one));
            let size = image.iter().map(|x| x * x).sum::<f64>().sqrt();
            println!("{pairs}: {size:.1e}, tilt {}", full.weights.tilt);
            assert!(full.weights.tilt > 0.0 && size < 0.2 * before, "{size}");
            before = size;
        }
        assert!(before < 1e-4);
    }
}
