//! The contact laws as the hot loop wants them: those drawn most known at compile time.

use crate::contact::ContactLaw;
use crate::damping::Damping;
use crate::oscillator::Oscillator;

/// Force and potential of one contact law, inlined.
pub(super) trait Law: Copy + Send + Sync {
    /// G(q).
    fn force(self, q: f64) -> f64;
    /// G(q) and G'(q).
    fn force_and_stiffness(self, q: f64) -> (f64, f64);
    /// U(q), the integral of G from 0.
    fn potential(self, q: f64) -> f64;
    /// Below it contact is lost; minus infinity for a law that cannot lose contact.
    fn loss(self) -> f64;
    /// Whether flight may end on a second wall: asked at every crossing.
    const WALLED: bool = false;
    /// Below it there is contact again, with the second wall.
    #[inline(always)]
    fn back(self) -> f64 {
        f64::NEG_INFINITY
    }
    /// Whether contact is lost at q.
    #[inline(always)]
    fn is_lost(self, q: f64) -> bool {
        if Self::WALLED {
            q < self.loss() && q >= self.back()
        } else {
            q < self.loss()
        }
    }
    /// Whether friction is the same everywhere.
    const VISCOUS: bool = true;
    /// c/(2 zeta) at a displacement.
    #[inline(always)]
    fn friction(self, _q: f64) -> f64 {
        1.0
    }
}

/// A contact law with a damping law that is not viscous.
#[derive(Debug, Clone, Copy)]
pub(super) struct Damped<'a, L> {
    law: L,
    contact: &'a ContactLaw,
    damping: &'a Damping,
}

impl<L: Law> Law for Damped<'_, L> {
    const VISCOUS: bool = false;

    #[inline(always)]
    fn force(self, q: f64) -> f64 {
        self.law.force(q)
    }

    #[inline(always)]
    fn force_and_stiffness(self, q: f64) -> (f64, f64) {
        self.law.force_and_stiffness(q)
    }

    #[inline(always)]
    fn loss(self) -> f64 {
        self.law.loss()
    }

    const WALLED: bool = L::WALLED;

    #[inline(always)]
    fn back(self) -> f64 {
        self.law.back()
    }

    #[inline(always)]
    fn potential(self, q: f64) -> f64 {
        self.law.potential(q)
    }

    #[inline(always)]
    fn friction(self, q: f64) -> f64 {
        match self.damping {
            Damping::Contact => f64::from(u8::from(!self.law.is_lost(q))),
            Damping::HuntCrossley => (1.0 + self.law.force(q)).abs(),
            other => other.factor(self.contact, q, 0.0),
        }
    }
}

/// A law with a word, known at compile time.
pub(super) trait Word: Copy + Send + Sync {
    const LAW: &'static ContactLaw;
    /// G(q), to rounding of 1.
    #[inline(always)]
    fn force_at(q: f64) -> f64 {
        Self::LAW.force(q)
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Hertz;

#[derive(Debug, Clone, Copy)]
pub(super) struct Bilinear;

#[derive(Debug, Clone, Copy)]
pub(super) struct Linear;

#[derive(Debug, Clone, Copy)]
pub(super) struct Free;

impl Word for Hertz {
    const LAW: &'static ContactLaw = &ContactLaw::Hertz;

    /// Without the division that saves digits of a force near 0.
    #[inline(always)]
    fn force_at(q: f64) -> f64 {
        let x = (1.0 + q * (2.0 / 3.0)).max(0.0);
        x * x.sqrt() - 1.0
    }
}

impl Word for Bilinear {
    const LAW: &'static ContactLaw = &ContactLaw::Bilinear;
}

impl Word for Linear {
    const LAW: &'static ContactLaw = &ContactLaw::Linear;
}

impl Word for Free {
    const LAW: &'static ContactLaw = &ContactLaw::Free;
}

impl<W: Word> Law for W {
    #[inline(always)]
    fn force(self, q: f64) -> f64 {
        W::force_at(q)
    }

    #[inline(always)]
    fn force_and_stiffness(self, q: f64) -> (f64, f64) {
        (W::force_at(q), W::LAW.stiffness(q))
    }

    #[inline(always)]
    fn loss(self) -> f64 {
        W::LAW.loss_point().unwrap_or(f64::NEG_INFINITY)
    }

    #[inline(always)]
    fn potential(self, q: f64) -> f64 {
        W::LAW.potential(q)
    }
}

/// Any law, its code chosen at every call.
#[derive(Debug, Clone, Copy)]
pub(super) struct Given<'a> {
    law: &'a ContactLaw,
    loss: f64,
    /// Minus infinity without a second wall.
    back: f64,
}

impl<'a> Given<'a> {
    fn of(law: &'a ContactLaw) -> Self {
        Self {
            law,
            loss: law.loss_point().unwrap_or(f64::NEG_INFINITY),
            back: law.back_wall().unwrap_or(f64::NEG_INFINITY),
        }
    }
}

impl Law for Given<'_> {
    const WALLED: bool = true;

    #[inline(always)]
    fn force(self, q: f64) -> f64 {
        self.law.force(q)
    }

    #[inline(always)]
    fn force_and_stiffness(self, q: f64) -> (f64, f64) {
        (self.law.force(q), self.law.stiffness(q))
    }

    #[inline(always)]
    fn loss(self) -> f64 {
        self.loss
    }

    #[inline(always)]
    fn back(self) -> f64 {
        self.back
    }

    #[inline(always)]
    fn potential(self, q: f64) -> f64 {
        self.law.potential(q)
    }
}

/// Something to do once the law is known at compile time.
pub(super) trait WithLaw {
    /// What comes out.
    type Output;
    /// Does it.
    fn with<L: Law>(self, law: L) -> Self::Output;
}

/// Chooses the code of contact and damping, once and outside every loop. Each has a copy of all schemes under all that
/// watches them, so only what is drawn most often has one of its own.
pub(super) fn dispatch<W: WithLaw>(oscillator: &Oscillator, what: W) -> W::Output {
    let (contact, damping) = (oscillator.contact(), oscillator.damping());
    match (contact, oscillator.is_viscous()) {
        (ContactLaw::Hertz, true) => what.with(Hertz),
        (ContactLaw::Bilinear, true) => what.with(Bilinear),
        (ContactLaw::Linear, true) => what.with(Linear),
        (ContactLaw::Free, true) => what.with(Free),
        (ContactLaw::Custom(_), true) => what.with(Given::of(contact)),
        (ContactLaw::Hertz, false) => what.with(Damped {
            law: Hertz,
            contact,
            damping,
        }),
        (_, false) => what.with(Damped {
            law: Given::of(contact),
            contact,
            damping,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_force_of_paths_is_that_of_the_contact_law_to_rounding_of_one() {
        for k in -500..=500 {
            let q = (f64::from(k) * 0.03).sinh();
            let exact = ContactLaw::Hertz.force(q);
            let error = (Hertz.force(q) - exact).abs() / exact.abs().max(1.0);
            assert!(error < 1e-15, "{error:e} at {q}");
        }
    }
}
