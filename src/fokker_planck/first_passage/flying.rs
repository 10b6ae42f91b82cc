//! What flights that go on for ever leave of the rate of a passage upwards.
//!
//! Noise holds a motion in flight by an acceleration u against the constant force f, at the price exp(-int u^2 dt/(4 pi h)). Where
//! friction goes on in flight, u = f at every time is the cheapest in the long run, and the survival falls no faster than
//! exp(-f^2 t/(4 pi h)): the [edge](crate::oscillator::Oscillator::continuous_from) of the continuous spectrum. Without friction in
//! flight u = (3/2) f (1 - s/t) ends a flight from rest at its time t, for three quarters of that. On a mesh, which ends somewhere,
//! the continuous spectrum looks like a mode above its edge, and a mode below it is cut.

use super::region::Region;
use crate::damping::Damping;
use crate::estimate::Estimate;
use crate::initial::Initial;

/// Flights that go on for ever.
pub(super) struct Flying {
    /// The rate that no survival falls faster than.
    edge: f64,
    /// How far down the mesh follows flights, in T.
    depth: f64,
    /// How much less of the law there is where flight begins than at the level.
    rarity: f64,
    /// Whether the motion begins in a law of ever higher flights without friction: they outlast any exponential.
    outlasting: bool,
}

impl Flying {
    /// Those of a region whose mesh goes `level` T above its level; None where a flight ends, or none is on the mesh, or friction is
    /// not known to go on or to end with contact.
    pub(super) fn of(region: &Region<'_>, initial: &Initial, level: f64) -> Option<Self> {
        let oscillator = region.oscillator;
        let [_, loss] = oscillator.contact().flight()?;
        let price = oscillator.price_of_flight()?;
        if !region.is_open_below() {
            return None;
        }
        let edge = match oscillator.damping() {
            Damping::Viscous => price,
            Damping::Contact | Damping::HuntCrossley => 0.75 * price,
            Damping::Displacement(_) | Damping::Energy(_) => return None,
        };
        // Where the level is passed in contact, flight begins above it.
        let before = (region.height(-loss) - region.rise()).max(0.0) / oscillator.temperature();
        let depth = level - before;
        let outlasting =
            *initial == Initial::Stationary && oscillator.continuous_from() == Some(0.0);
        (depth > 0.0).then_some(Self {
            edge,
            depth,
            rarity: (-before).exp(),
            outlasting,
        })
    }

    /// The rate of the mesh as flights leave it, and why it is not known better where they are what it errs by. In the motion of
    /// long flights under friction (Smoluchowski's) a mode of the rate r falls with the depth d as exp(-d (1 - sqrt(1 - r/edge))/2),
    /// and what the end of the mesh sends back of it as exp(-d (1 + sqrt(1 - r/edge))/2). Near the edge most of the mode is in
    /// flight; far below it, as much of it as of the law.
    pub(super) fn bound(&self, rate: Estimate) -> (Estimate, Option<&'static str>) {
        let of = |value, error| Estimate::new(value, error, rate.origin);
        let Estimate { value, error, .. } = rate;
        if value >= self.edge && self.outlasting {
            let why = "ever higher flights of the stationary law outlast any exponential";
            return (of(f64::NAN, f64::NAN), Some(why));
        }
        if value >= self.edge {
            let why = "no mode lasts longer than free flight, and the survival falls as its continuous spectrum does";
            return (of(self.edge, error.max(value - self.edge)), Some(why));
        }
        let apart = self.edge - value;
        let sent_back = (-self.depth * (apart / self.edge).sqrt()).exp();
        let cut = self.rarity * value.min(4.0 * apart) * sent_back;
        let why = "its mode reaches beyond the mesh, far into flight; a tighter accuracy.tolerance makes the mesh deeper";
        (of(value, error + cut), (cut > error).then_some(why))
    }
}
