//! The stationary law of a scene, in closed form or solved for, as curves.

use crate::contact::ContactLaw;
use crate::estimate::Estimate;
use crate::fokker_planck::SolvedLaw;
use crate::oscillator::Oscillator;
use crate::quadrature;
use crate::stationary::Stationary;

/// Where the densities of stationary motion come from.
#[derive(Debug, Clone)]
pub enum Law {
    /// Viscous damping: (21)-(30).
    ClosedForm(Stationary),
    /// Any other: the null vector of the Fokker-Planck operator.
    Solved {
        /// The contact law.
        contact: ContactLaw,
        /// What was solved for.
        law: SolvedLaw,
    },
}

impl Law {
    /// That of an oscillator, with what was solved for it.
    pub(super) fn of(oscillator: &Oscillator, solved: Option<&SolvedLaw>) -> Option<Self> {
        if oscillator.is_viscous() {
            return Stationary::of(oscillator).ok().map(Self::ClosedForm);
        }
        solved.map(|law| Self::Solved {
            contact: oscillator.contact().clone(),
            law: law.clone(),
        })
    }

    /// In two words.
    pub(crate) fn words(&self) -> &'static str {
        match self {
            Self::ClosedForm(_) => "closed form",
            Self::Solved { .. } => "solved",
        }
    }

    /// p_q(q).
    pub fn density_q(&self, q: f64) -> f64 {
        match self {
            Self::ClosedForm(law) => law.density_q(q),
            Self::Solved { law, .. } => law.density_q(q),
        }
    }

    /// p_v(v).
    pub fn density_v(&self, v: f64) -> f64 {
        match self {
            Self::ClosedForm(law) => law.density_v(v),
            Self::Solved { law, .. } => law.density_v(v),
        }
    }

    /// The continuous part of p_N, as [`Stationary::density_force`].
    pub fn density_force(&self, force: f64) -> f64 {
        match self {
            Self::ClosedForm(law) => law.density_force(force),
            Self::Solved { contact, law } => contact
                .displacement_at(force)
                .map_or(0.0, |q| law.density_q(q) / contact.stiffness(q)),
        }
    }

    /// P(N <= force) at ascending forces, the Dirac mass included.
    pub(crate) fn distribution_force(&self, forces: &[f64]) -> Vec<f64> {
        let (contact, law) = match self {
            Self::ClosedForm(law) => {
                return forces
                    .iter()
                    .map(|it| law.distribution_force(*it))
                    .collect();
            }
            Self::Solved { contact, law } => (contact, law),
        };
        let loss = contact.loss_point();
        let lost = law
            .moments
            .contact_loss_probability
            .map_or(0.0, |it| it.value);
        // From the loss of contact, or from where the law begins, in pieces from force to force.
        let (mut from, mut sum) = match loss {
            Some(loss) => (loss, lost),
            None => (law.domain()[0], 0.0),
        };
        let mut below = Vec::with_capacity(forces.len());
        for force in forces {
            match contact.displacement_at(*force) {
                Some(q) if q > from => {
                    sum += quadrature::integrate(|q| law.density_q(q), &[from, q], 1e-6).value;
                    from = q;
                    below.push(sum);
                }
                Some(_) => below.push(sum),
                None => {
                    let flown = loss.is_some_and(|loss| *force >= contact.force(loss));
                    below.push(if flown { lost } else { 0.0 });
                }
            }
        }
        below
    }

    /// P(q < q_loss).
    pub fn contact_loss_probability(&self) -> Option<Estimate> {
        match self {
            Self::ClosedForm(law) => law.contact_loss_probability(),
            Self::Solved { law, .. } => law.moments.contact_loss_probability,
        }
    }
}
