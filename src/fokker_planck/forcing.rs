//! What an excitation means for a solver: the law that a density is taken against, how far the drive swings, and what
//! friction, noise and drive do together over a time.
//!
//! The force a cos(W t + phase) is of the order of friction and noise near a resonance, and acts with them, in the perturbed
//! part of the splitting: v' = e^{-2 zeta tau} v + shift + noise, time frozen at the node, which is the quadrature of the
//! drive along the orbit. A time that went on within that part would not be.
//!
//! To second order friction stretches the two halves of the motion, and a splitting that gives them back their rate, by a
//! part `lead` more of the motion, gives too much to what friction does not stretch: about the velocity f/(2 zeta) that the
//! force f would lead to, q' = v + e with e = lead f/(2 zeta). The nodes therefore act with the force
//! (1 - lead) f - 2 e', f' in e' once for q and once for the time that is frozen, and v has a kick of -e where an interval
//! begins and one of e where it ends. Without that the error is of the order of zeta f tau^2; with it a drive leaves the
//! order of the splitting as it is (tests/driven.rs). Where friction depends on the displacement there is no such part, and
//! the error stays of that order.
//!
//! An envelope f(t) is frozen at the nodes too, and [O, [O, d/dt]] = 4 zeta D' d2/dv2 for the diffusion D = pi h f: beside
//! the wrong rate of the motion, D is wrong by lead D'/zeta, which is taken off. Without that a variance errs by zeta f'
//! tau^2 alike on every mesh.
//!
//! p over the stationary law of the undriven oscillator grows as e^{(shift of v) v/T}, beyond any bound where the drive is
//! strong. The law that p is taken against is that of a temperature T + A^2/2, A the amplitude of the motion without noise:
//! p over it stays of order 1 wherever p does, and for A = 0 it is the stationary law. Where a drive throws motions it is as hot as
//! their highest energy over [`SPANNED`] asks ([`Forcing::spanning`]).
//!
//! So is p over the stationary law beyond bounds where it begins far above it: at e^89 rounding leaves nothing of it. With an
//! excitation or without it is then taken against a law as hot as [`SPANNED`] asks.

use super::ornstein_uhlenbeck::Kick;
use super::policy::SPANNED;
use super::tail::Tail;
use crate::contact::ContactLaw;
use crate::error::Result;
use crate::excitation::Excitation;
use crate::initial::Initial;
use crate::noise_free::{self, Lasting};
use crate::oscillator::Oscillator;
use std::f64::consts::PI;

/// An excitation beside stationary noise.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Forcing {
    excitation: Excitation,
    zeta: f64,
    /// T of the oscillator at factor 1, and its pi h.
    temperature: f64,
    diffusion: f64,
    noise: Oscillator,
    reference: Oscillator,
    swing: f64,
    /// Half the rate at which the energy follows the noise, and the strongest noise there is.
    relaxing: (f64, f64),
    narrowing: f64,
    orbits: Vec<[f64; 2]>,
    /// An orbit far out that no motion from near rest comes to, where flights are without friction: whether noise ever throws a
    /// motion there is not known beforehand.
    far: Option<Lasting>,
    /// By how much more than under stationary noise a splitting errs under the envelope.
    uneven: f64,
    /// How far out the law under it holds probability, where that was measured.
    tail: Option<Tail>,
}

/// Probability beyond an orbit, in a law without it, with which no motion ever comes to it.
const NEVER: f64 = 1e-12;

/// Correlation times after which a motion without noise has found its orbit.
const LATE: f64 = 8.0;

/// Step times frequency of the drive against the motion, at most: half a turn.
const SEEN: f64 = 3.0;

/// Periods over which its amplitude is then taken.
const BEATS: f64 = 3.0;

/// Longest time that such a motion is followed, if that is more than a period.
const FOLLOWED: f64 = 4000.0;

impl Forcing {
    /// That of an excitation until time `until`; None where there is nothing beside stationary noise.
    pub(crate) fn of(
        oscillator: &Oscillator,
        initial: &Initial,
        excitation: &Excitation,
        until: f64,
    ) -> Result<Option<Self>> {
        if excitation.is_plain() {
            return Ok(None);
        }
        let end = until.min(late(oscillator));
        let period = excitation.drive.map_or(0.0, |it| it.period());
        let swing = noise_free::swing(oscillator, excitation, end.max(period.min(until)));
        Self::by(oscillator, initial, excitation, (until, swing)).map(Some)
    }

    /// That of the law which lasts under a drive.
    pub(crate) fn lasting(
        oscillator: &Oscillator,
        excitation: &Excitation,
    ) -> Result<Option<Self>> {
        if excitation.is_plain() {
            return Ok(None);
        }
        let period = excitation.drive.map_or(0.0, |it| it.period());
        let end = (late(oscillator) / period).ceil() * period;
        let beats = (BEATS * period).min(FOLLOWED.max(period));
        let times = [end, end + beats];
        let (near, far) = noise_free::lasting(oscillator, excitation, times);
        // A law that friction holds everywhere may begin anywhere, and is believed to have both.
        let known = far.filter(|_| oscillator.is_viscous());
        let swing = known.map_or(near.amplitude, |it| it.amplitude);
        let it = Self::by(oscillator, &Initial::Stationary, excitation, (0.0, swing))?;
        let orbits = [Some(near), known].into_iter().flatten();
        Ok(Some(Self {
            orbits: orbits.map(|it| it.state).collect(),
            far: far.filter(|_| known.is_none()),
            ..it
        }))
    }

    /// No excitation: what p is taken against is the stationary law, until it is made to span more.
    pub(crate) fn none(oscillator: &Oscillator, initial: &Initial) -> Result<Self> {
        Self::by(oscillator, initial, &Excitation::default(), (0.0, 0.0))
    }

    fn by(
        oscillator: &Oscillator,
        initial: &Initial,
        excitation: &Excitation,
        (until, swing): (f64, f64),
    ) -> Result<Self> {
        let mut factor = excitation.highest_factor(until);
        if *initial == Initial::Stationary {
            factor = factor.max(1.0);
        }
        let zeta = oscillator.zeta();
        let under = |h: f64| Oscillator::reference(oscillator.contact().clone(), zeta, h);
        // Without any noise until then the initial condition alone is there.
        let factor = if factor > 0.0 { factor } else { 1.0 };
        let noise = if factor == 1.0 {
            oscillator.clone()
        } else {
            under(factor * oscillator.h())?.with_damping(oscillator.damping().clone())?
        };
        let reference = if swing > 0.0 && oscillator.contact().is_confining() {
            under(2.0 * zeta * (noise.temperature() + 0.5 * swing * swing) / PI)?
        } else {
            noise.clone()
        };
        let friction = oscillator.reference_friction().max(2.0 * zeta);
        let coldest = excitation.coldest(0.5 * friction, factor, [0.0, until]);
        Ok(Self {
            excitation: excitation.clone(),
            zeta,
            temperature: oscillator.temperature(),
            diffusion: oscillator.noise(),
            noise,
            reference,
            swing,
            relaxing: (0.5 * friction, factor),
            narrowing: (coldest / factor).sqrt(),
            orbits: Vec::new(),
            far: None,
            uneven: match excitation.envelope {
                None => 0.0,
                Some(_) => factor * (1 + excitation.bends(0.0, until).count()) as f64,
            },
            tail: None,
        })
    }

    /// Whether anything acts beside stationary noise.
    pub(crate) fn acts(&self) -> bool {
        !self.excitation.is_plain()
    }

    /// Whether a drive may throw motions higher than noise and the motion without noise tell: flights without friction take it up
    /// at any phase, and the law falls far more slowly with the energy.
    pub(crate) fn throws(&self) -> bool {
        self.swing > 0.0 && !self.noise.is_viscous() && self.noise.contact().is_confining()
    }

    /// Whether the law may hold more far out than these tell: where a drive throws motions, and in a law that lasts under one where a
    /// contact that softens comes near an orbit which it does not quite have.
    pub(crate) fn strays(&self) -> bool {
        let contact = self.noise.contact();
        let bends = *contact != ContactLaw::Linear && contact.is_confining();
        self.throws() || (bends && self.swing > 0.0 && self.recurs())
    }

    /// Drive and envelope.
    pub(crate) fn excitation(&self) -> &Excitation {
        &self.excitation
    }

    /// The undriven oscillator under the strongest noise there is.
    pub(crate) fn noise(&self) -> &Oscillator {
        &self.noise
    }

    /// The oscillator whose stationary law densities are taken against.
    pub(crate) fn reference(&self) -> &Oscillator {
        &self.reference
    }

    /// The amplitude sqrt(2 (H - lowest U)) that the drive adds.
    pub(crate) fn swing(&self) -> f64 {
        self.swing
    }

    /// The same taken against a law as hot as energies up to `highest` above the lowest potential ask for. Where flights have no
    /// friction it is no hotter: flights that are as rare as they are high make no law wider where probability is.
    pub(crate) fn spanning(&self, highest: f64) -> Result<Self> {
        let coldest = if self.noise.is_viscous() {
            self.reference.temperature()
        } else {
            self.noise.temperature()
        };
        let temperature = (highest / SPANNED.get()).max(coldest);
        let contact = self.noise.contact().clone();
        let level = 2.0 * self.zeta * temperature / PI;
        let reference = Oscillator::reference(contact, self.zeta, level)?;
        Ok(Self {
            reference,
            ..self.clone()
        })
    }

    /// The same where the law falls like this far out. An orbit there is one of the law unless it is beyond all reach.
    pub(crate) fn falling(&self, tail: Tail) -> Self {
        let mut it = self.clone();
        if let Some(far) = it.far.take_if(|far| far.amplitude < tail.reach(NEVER)) {
            it.swing = far.amplitude;
            it.orbits.push(far.state);
        }
        it.tail = Some(tail);
        it
    }

    /// How far out the law under it holds probability, where that was measured.
    pub(crate) fn tail(&self) -> Option<&Tail> {
        self.tail.as_ref()
    }

    /// The states at phase 0 of the orbits that last without noise, one or two; of [`Forcing::lasting`].
    pub(crate) fn orbits(&self) -> &[[f64; 2]] {
        &self.orbits
    }

    /// Whether it is that of a law which lasts, and every period comes again.
    pub(crate) fn recurs(&self) -> bool {
        !self.orbits.is_empty()
    }

    /// By how much more than under stationary noise a splitting errs under the envelope: its level, and the ends of the
    /// intervals that it cuts. 0 without one.
    pub(crate) fn uneven(&self) -> f64 {
        self.uneven
    }

    /// The temperature that the law falls back to between two times at most.
    pub(crate) fn coldest(&self, between: [f64; 2]) -> f64 {
        let (rate, highest) = self.relaxing;
        let part = match self.excitation.envelope {
            Some(_) => self.excitation.coldest(rate, highest, between) / highest,
            None => 1.0,
        };
        part * self.noise.temperature()
    }

    /// The narrowest deviations of the law over those under the strongest noise.
    pub(crate) fn narrowing(&self) -> f64 {
        self.narrowing
    }

    /// The error of even steps of the flow map from the drive, over the natural deviation: zeta a tau^3 and a tau^6 from the
    /// ends of an interval. Measured for the linear law, zeta = 0.005 to 0.5, W = 0.3 to 2.5 (tests/driven.rs).
    pub(crate) fn splitting_error(&self, step: f64) -> f64 {
        let [ends, second] = self.error_constants();
        ends * step.powi(6) + second * step.powi(3)
    }

    fn error_constants(&self) -> [f64; 2] {
        let drive = self.excitation.drive;
        let amplitude = drive.map_or(0.0, |it| it.amplitude()) / self.temperature.sqrt();
        let frequency = 1.0 + drive.map_or(0.0, |it| it.frequency());
        let third = 2e-4 * amplitude * frequency.powi(5);
        [third, 0.06 * self.zeta * amplitude]
    }

    /// The longest step for such an error of about `tolerance`: the nodes must also see the drive turn against the motion.
    pub(crate) fn longest_step(&self, tolerance: f64) -> f64 {
        let [ends, second] = self.error_constants();
        let frequency = self.excitation.drive.map_or(0.0, |it| it.frequency());
        let seen = SEEN / (1.0 + frequency.max(1.0));
        let each = [
            seen,
            (tolerance / ends).powf(1.0 / 6.0),
            (tolerance / second).cbrt(),
        ];
        each.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Friction at a rate c, noise and drive over a time `tau`, time frozen at `t`, in a splitting with this `lead`, 0 where
    /// the rate is not the same everywhere; the density along v taken against e^{-beta v^2/2}.
    pub(crate) fn kick(&self, rate: f64, [t, tau]: [f64; 2], lead: f64, beta: f64) -> Kick {
        let it = &self.excitation;
        let force = (1.0 - lead) * it.force(t) - lead * it.rate(t) / self.zeta;
        // An envelope that falls to 0 within less than such a step brings no noise.
        let factor = (it.factor(t) - lead * it.factor_rate(t) / self.zeta).max(0.0);
        Kick::new(rate, tau, (factor * self.diffusion, force), beta)
    }

    /// How much more than v the rate of q is at time t in a splitting with this `lead`.
    pub(crate) fn ahead(&self, t: f64, lead: f64) -> f64 {
        lead * self.excitation.force(t) / (2.0 * self.zeta)
    }
}

/// How long a motion without noise is followed until it has found its orbit.
fn late(oscillator: &Oscillator) -> f64 {
    (2.0 * LATE / oscillator.reference_friction()).min(FOLLOWED)
}
