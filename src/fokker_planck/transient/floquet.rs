//! What the map over one period says beside the law that it leaves: Floquet multipliers, and the laws of two orbits.

use super::run::{OverAPeriod, Run};
use crate::estimate::{Estimate, Origin};
use crate::fokker_planck::convergence::{UNKNOWN, left};
use crate::fokker_planck::krylov::Ritz;
use crate::fokker_planck::policy::SAFETY;
use crate::moments::{Moment, Moments};

/// An eigenvalue of the map over one period: what is left of a deviation from the periodic law a period later.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Multiplier {
    /// Real part.
    pub re: f64,
    /// Imaginary part, not negative: of a conjugate pair one is listed.
    pub im: f64,
    /// Error of |re + i im|.
    pub error: f64,
}

impl Multiplier {
    /// |re + i im|, below 1 but for its error.
    pub fn modulus(&self) -> f64 {
        self.re.hypot(self.im)
    }
}

/// What noise makes of one of two orbits under a drive, for as long as it leaves a motion there. The tolerance does not bind
/// it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Metastable {
    /// Its part of the law that lasts.
    pub(crate) probability: Estimate,
    /// Moments at the times of that law.
    pub(crate) moments: Vec<Moments>,
}

/// What the map over one period says beside its fixed point.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Floquet {
    /// Its largest eigenvalues but 1.
    pub(crate) multipliers: Vec<Multiplier>,
    /// The L1 distance of the law to itself a period later.
    pub(crate) residual: f64,
    /// The two laws that it is made of, where noise passes from one orbit to the other ten times more slowly than anything
    /// else fades.
    pub(crate) metastable: Option<[Metastable; 2]>,
    /// How many times waves of the mesh grow in a period, if they do.
    pub(super) growing: Option<f64>,
}

impl Floquet {
    /// That of the finer of two runs, with errors; `law` are the moments at the output times, and the runs err `alike` in a part of
    /// a multiplier.
    pub(super) fn joined(runs: [&Run; 2], law: &[Moments], alike: f64) -> Option<Self> {
        let [Some(fine), Some(coarse)] = runs.map(|it| it.over_a_period.as_ref()) else {
            return None;
        };
        let (multipliers, growing) = multipliers([fine, coarse], alike);
        Some(Self {
            multipliers,
            residual: fine.residual,
            metastable: metastable([fine, coarse], law),
            growing,
        })
    }
}

/// The metastable laws of the finer of two runs. Their errors are those of the law that they make up, what the mode of the
/// passage lacks, and the change from the coarser run, twice, as with the multipliers.
fn metastable([fine, coarse]: [&OverAPeriod; 2], law: &[Moments]) -> Option<[Metastable; 2]> {
    let [slowest, next, ..] = &fine.multipliers[..] else {
        return None;
    };
    let [slow, fast] = [slowest, next].map(|it| it.value.norm());
    let mixed = slowest.error / (slow - fast);
    let (sides, before) = (fine.metastable.as_ref()?, coarse.metastable.as_ref()?);
    let joined = |k: usize| {
        let (side, before, other) = (&sides[k], &before[k], &sides[1 - k]);
        let error = |value: f64, before: f64, apart: f64, own: f64| {
            let error = own + left(UNKNOWN) * (value - before).abs() + mixed * apart.abs();
            Estimate::new(value, error, Origin::Space)
        };
        let rows = side.moments.iter().zip(&before.moments);
        let rows = rows.zip(other.moments.iter().zip(law));
        let moments = rows.map(|((here, before), (other, law))| {
            let mut here = *here;
            for (number, it) in here.each_mut().into_iter().zip(Moment::ALL) {
                if let (Some(number), [Some(before), Some(other), Some(law)]) =
                    (number, [before, other, law].map(|all| all.get(it)))
                {
                    let apart = number.value - other.value;
                    *number = error(number.value, before.value, apart, law.error);
                }
            }
            here
        });
        let share = side.probability;
        Metastable {
            probability: error(share, before.probability, share * (1.0 - share), 0.0),
            moments: moments.collect(),
        }
    };
    Some([joined(0), joined(1)])
}

/// The multipliers of the finer of two runs, from the slowest on as far as they are known, and how many times waves of the mesh
/// grow in a period. Their errors are those of the Krylov space, the distance to the nearest one of the coarser run, as that of a
/// number, and what both err alike, where a period has about as many steps in both.
fn multipliers([fine, coarse]: [&OverAPeriod; 2], alike: f64) -> (Vec<Multiplier>, Option<f64>) {
    let multiplier = |it: &Ritz| {
        let distances = coarse.multipliers.iter();
        let distances = distances.map(|other| (other.value - it.value).norm());
        let nearest = distances.fold(f64::INFINITY, f64::min);
        Multiplier {
            re: it.value.re,
            im: it.value.im,
            error: it.error + SAFETY.get() * nearest + alike * it.value.norm(),
        }
    };
    // One that is not known to a tenth, or not from zero, is not known.
    let known = |it: &Multiplier| it.error < it.modulus().min(0.1);
    let all = fine.multipliers.iter().map(multiplier);
    // What is above 1 by more than its error is no motion's, as smooth as it may be.
    let beyond_one = |it: &Multiplier| it.modulus() - it.error >= 1.0;
    let (waves, own): (Vec<_>, Vec<_>) = all.partition(beyond_one);
    let growing = waves.iter().find(|it| known(it)).map(Multiplier::modulus);
    (own.into_iter().take_while(known).collect(), growing)
}
