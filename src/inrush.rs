//! How deep motions come into contact against friction and force.
//!
//! Without noise a motion that meets the wall at a speed loses it as v dv/dx = -c v - G + F, F a force that drives it. Noise
//! of intensity pi h holds the temperature pi h/c against friction c, so that where a motion would have stopped the density
//! falls further as exp(-int (G - F) c/(pi h) dx). A depth is as rare as its likeliest cause: some of the rarity in the speed at
//! the wall, where -ln p grows as its square, and the rest in what noise adds.

use crate::oscillator::Oscillator;

/// Steps into contact.
const STEPS: usize = 500;
/// Parts in which rarity is shared between the speed at the wall and noise.
const SHARES: i32 = 4;

/// What brings motions into contact.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Inrush {
    /// The speed at the wall that motions have anyhow.
    pub(crate) certain: f64,
    /// The highest speed there.
    pub(crate) highest: f64,
    /// The largest force that drives motions.
    pub(crate) push: f64,
    /// -ln p of the highest speed, and of what noise adds where none is needed.
    pub(crate) rarity: f64,
}

impl Inrush {
    /// Displacements of an interval that motions come to, be it from a wall inwards or not beyond the last equilibrium.
    pub(crate) fn reach(&self, oscillator: &Oscillator, mut q: [f64; 2]) -> [f64; 2] {
        let held = oscillator.holds_back(q);
        let walls = oscillator.contact().flight().unwrap_or(q);
        for k in (0..2).filter(|k| held[*k]) {
            let depths = (0..=SHARES).map(|share| {
                let share = f64::from(share) / f64::from(SHARES);
                self.depth(oscillator, [walls[k], q[k]], share)
            });
            q[k] = walls[k] + (q[k] - walls[k]).signum() * depths.fold(0.0, f64::max);
        }
        q
    }

    /// How far from a wall towards an edge, with this share of the rarity in the speed at the wall.
    fn depth(&self, oscillator: &Oscillator, [wall, edge]: [f64; 2], share: f64) -> f64 {
        let contact = oscillator.contact();
        let (length, inwards) = ((edge - wall).abs(), (edge - wall).signum());
        let step = length / STEPS as f64;
        let depth = |q: &f64| (q - wall) * inwards;
        let last = contact.equilibria().iter().map(depth).fold(0.0, f64::max);
        let certain = self.certain.min(self.highest).powi(2);
        let mut v = (certain + share * (self.highest.powi(2) - certain)).sqrt();
        let mut left = (1.0 - share) * self.rarity;
        for i in 0..STEPS {
            let x = (i as f64 + 0.5) * step;
            let q = wall + inwards * x;
            let c = oscillator.friction(q);
            let against = inwards * contact.force(q) - self.push;
            // v at the end of the step, which neither stiff friction nor rest upsets: v^2 + 2 c v dx = v_0^2 - 2 (G - F) dx.
            let slowed = c * step;
            v = (slowed * slowed + (v * v - 2.0 * against * step)).max(0.0);
            v = (v.sqrt() - slowed).max(0.0);
            if v > 0.0 || x < last {
                continue;
            }
            left -= against * c / oscillator.noise() * step;
            if left <= 0.0 {
                return x + 0.5 * step;
            }
        }
        length
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::ContactLaw;
    use crate::damping::Damping;
    use std::f64::consts::PI;

    /// Where friction stops everything, the density is the Gibbs law of its own temperature; where it does next to nothing, motions
    /// come as deep as their energy lets them.
    #[test]
    fn strong_friction_leaves_the_gibbs_law_and_weak_friction_the_turning_point() {
        let h = 0.01;
        // U = rarity T; the wall's energy of 0.9 and that of the speed.
        for (zeta, highest, rarity, level) in [
            (3.0, 0.1, 16.0, 16.0 * PI * h / 6.0),
            (1e-6, 2.0, 0.0, 0.9 + 2.0),
        ] {
            let viscous = Oscillator::new(ContactLaw::Hertz, zeta, h).unwrap();
            let oscillator = viscous.with_damping(Damping::Contact).unwrap();
            let inrush = Inrush {
                certain: highest,
                highest,
                push: 0.0,
                rarity,
            };
            let [low, high] = inrush.reach(&oscillator, [-4.0, 3.0]);
            let (_, expected) = ContactLaw::Hertz.turning_points(level).unwrap();
            println!("zeta = {zeta}: {high} for {expected}");
            assert!(low == -4.0 && (high - expected).abs() < 0.03);
        }
    }
}
