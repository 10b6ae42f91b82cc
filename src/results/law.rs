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
    ClosedForm(Box<Stationary>),
    /// Any other: the null vector of the Fokker-Planck operator.
    Solved {
        /// The contact law.
        contact: ContactLaw,
        /// What was solved for.
        law: Box<SolvedLaw>,
    },
}

impl Law {
    /// That of an oscillator, with what was solved for it.
    pub(super) fn of(oscillator: &Oscillator, solved: Option<&SolvedLaw>) -> Option<Self> {
        if oscillator.is_viscous() {
            return Stationary::of(oscillator)
                .ok()
                .map(|it| Self::ClosedForm(Box::new(it)));
        }
        solved.map(|law| Self::Solved {
            contact: oscillator.contact().clone(),
            law: Box::new(law.clone()),
        })
    }

    /// In two words.
    #[cfg(feature = "plots")]
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
            Self::Solved { contact, law } => contact.density_force(force, |q| law.density_q(q)),
        }
    }

    /// P(N <= force) at ascending forces, the Dirac mass included.
    pub(crate) fn distribution_force(&self, forces: &[f64]) -> Vec<f64> {
        let (contact, law) = match self {
            Self::ClosedForm(law) => {
                let below = forces.iter().map(|it| law.distribution_force(*it));
                return below.collect();
            }
            Self::Solved { contact, law } => (contact, law),
        };
        // P(q < place) in pieces from place to place.
        let roots = forces.iter().flat_map(|it| contact.displacements_at(*it));
        let mut places: Vec<f64> = roots.chain(contact.loss_point()).collect();
        places.sort_by(f64::total_cmp);
        let (mut from, mut sum) = (law.domain()[0], 0.0);
        let mut below = Vec::with_capacity(places.len());
        for place in &places {
            if *place > from {
                sum += quadrature::integrate(|q| law.density_q(q), &[from, *place], 1e-6).value;
                from = *place;
            }
            below.push(sum);
        }
        let below = |q: f64| match places.partition_point(|place| *place <= q) {
            0 => 0.0,
            k => below[k - 1],
        };
        let of = |force: &f64| contact.distribution_force(*force, below);
        forces.iter().map(of).collect()
    }

    /// P(q < q_loss).
    pub fn contact_loss_probability(&self) -> Option<Estimate> {
        match self {
            Self::ClosedForm(law) => law.contact_loss_probability(),
            Self::Solved { law, .. } => law.moments.contact_loss_probability,
        }
    }
}
