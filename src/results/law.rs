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
            Self::Solved { contact, law } => {
                let all = contact.displacements_at(force).into_iter();
                all.map(|q| law.density_q(q) / contact.stiffness(q).abs())
                    .sum()
            }
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
        let roots: Vec<Vec<f64>> = forces
            .iter()
            .map(|it| contact.displacements_at(*it))
            .collect();
        // P(q < place) in pieces from place to place.
        let mut places: Vec<f64> = roots.iter().flatten().copied().chain(loss).collect();
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
        let of = |(roots, force): (&Vec<f64>, &f64)| {
            if roots.is_empty() {
                let flown = loss.filter(|loss| *force >= contact.force(*loss));
                return flown.map_or(0.0, below);
            }
            // G is lower left of the last, and again left of the last but two.
            let signs = [1.0, -1.0].into_iter().cycle();
            let signed = roots.iter().rev().zip(signs);
            signed.map(|(q, sign)| sign * below(*q)).sum()
        };
        roots.iter().zip(forces).map(of).collect()
    }

    /// P(q < q_loss).
    pub fn contact_loss_probability(&self) -> Option<Estimate> {
        match self {
            Self::ClosedForm(law) => law.contact_loss_probability(),
            Self::Solved { law, .. } => law.moments.contact_loss_probability,
        }
    }
}
