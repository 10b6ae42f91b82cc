//! The answer of a transient: two runs joined, every number with its error.

use super::error_estimate::{Errors, outside};
use super::output::Output;
use super::run::{Run, Task};
use crate::estimate::{Estimate, Origin, Shortfall, name_at};
use crate::fokker_planck::adaptive::Stop;
use crate::fokker_planck::convergence::{UNKNOWN, left};
use crate::fokker_planck::density::Snapshot;
use crate::fokker_planck::fixed_point::Ritz;
use crate::fokker_planck::policy::{SAFETY, SETTLED};
use crate::fokker_planck::settings::Method;
use crate::moments::{Moment, Moments};
use std::f64::consts::TAU;

/// The answer of a transient solve, one entry per output time.
#[derive(Debug, Clone, PartialEq)]
pub struct Transient {
    /// The output times, ascending.
    pub times: Vec<f64>,
    /// Moments with their errors.
    pub moments: Vec<Moments>,
    /// Total probability; the error is the domain-truncation error, and at least what is missing to 1.
    pub mass: Vec<Estimate>,
    /// Lowest value of the density: negative where the scheme undershoots.
    pub lowest_density: Vec<Estimate>,
    /// Integral of the negative part of the density, >= 0: 0 for a scheme that keeps the sign. The error is
    /// the difference of the two runs.
    pub negative_mass: Vec<Estimate>,
    /// Relative entropy to the stationary law; None where there is none.
    pub relative_entropy: Vec<Option<Estimate>>,
    /// L1 distance to the stationary law; None where there is none.
    pub distance: Vec<Option<Estimate>>,
    /// Densities at the times that asked for one.
    pub densities: Vec<Snapshot>,
    /// What it was computed with.
    pub method: Method,
    /// Of a law that lasts under a drive: the largest eigenvalues of the map over one period but 1.
    pub multipliers: Vec<Multiplier>,
    /// Of the same: the L1 distance to itself a period later.
    pub residual: f64,
    /// Of the same: the two laws that it is made of, where noise passes from one orbit to the other ten times more slowly
    /// than anything else fades.
    pub metastable: Option<[Metastable; 2]>,
    /// What the tolerance asked for and was not reached.
    pub shortfall: Option<Shortfall>,
    /// What the reader should know.
    pub warnings: Vec<String>,
}

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
pub struct Metastable {
    /// Its part of the law that lasts.
    pub probability: Estimate,
    /// Moments at the times of that law.
    pub moments: Vec<Moments>,
}

/// The metastable laws of the finer of two runs. Their errors are those of the law that they make up, what the mode of the
/// passage lacks, and the change from the coarser run, twice, as with the multipliers.
fn metastable(fine: &Run, coarse: &Run, law: &[Moments]) -> Option<[Metastable; 2]> {
    let (fine, coarse) = (fine.floquet.as_ref()?, coarse.floquet.as_ref()?);
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
fn multipliers([fine, coarse]: [&Run; 2], alike: f64) -> (Vec<Multiplier>, Option<f64>) {
    let (Some(fine), Some(coarse)) = (&fine.floquet, &coarse.floquet) else {
        return (Vec::new(), None);
    };
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

impl Task<'_> {
    /// Joins two runs: the fine one's numbers with their errors.
    pub(super) fn report(
        &self,
        fine: Run,
        coarse: &Run,
        errors: &Errors,
        stop: Stop,
        mut warnings: Vec<String>,
    ) -> Transient {
        // Under what acts in time no law is stationary, and densities are taken against another.
        let stationary = !self.recipe.acts();
        let known = self.knows_law() && stationary;
        let sought = stationary && self.recipe.period.is_none();
        if sought && self.oscillator.contact().is_confining() && !self.knows_law() {
            let damping = self.oscillator.damping().name();
            warnings.push(format!(
                "the stationary law under \"{damping}\" damping was not found: there are no distances to it"
            ));
        }
        let outside = outside(self, &fine, coarse);
        let mut moments: Vec<Moments> = fine.outputs.iter().map(|it| it.moments).collect();
        for (k, moments) in moments.iter_mut().enumerate() {
            errors.write(k, moments);
        }
        let metastable = metastable(&fine, coarse, &moments);
        let (multipliers, growing) = multipliers([&fine, coarse], errors.alike());
        if let Some(it) = growing {
            warnings.push(format!(
                "waves of the mesh grow {it:.2} times in a period: the law is a fixed point all the same, and these multipliers are left out"
            ));
        }
        let (worst, k, i) = errors.worst(&fine);
        let tolerance = self.recipe.tolerance;
        let (name, t) = (moments[k].named()[i].0, fine.outputs[k].t);
        let number = match self.recipe.period {
            Some(period) => format!("{name} at phase {:.4}", TAU * t / period),
            None => name_at(name, t),
        };
        let shortfall = stop.shortfall(number, worst / tolerance, tolerance);
        warnings.extend(shortfall.iter().map(Shortfall::to_string));
        if let Some(t) = fine.settled.filter(|t| *t < self.until()) {
            warnings.push(format!(
                "at t = {t:.1} the density was within {:.0e} of the stationary law in L1: time integration \
                 stopped there, and later times repeat it",
                SETTLED.get() * self.recipe.tolerance
            ));
        }
        let framed = fine.outputs.last().is_some_and(|it| it.framed);
        if framed && self.recipe.layout.is_given() {
            let [nq, nv] = fine.mesh.cells();
            warnings.push(format!(
                "the cells of the scene are too wide for the density at all these times: {nq} x {nv} cells that move with it \
                 carried it instead"
            ));
        }
        let pairs = || fine.outputs.iter().zip(&coarse.outputs);
        let [relative_entropy, distance] =
            self.beside_the_law(&fine, coarse, (&moments, errors.scales()), outside);
        let of_law = |it: Vec<Estimate>| it.into_iter().map(|it| known.then_some(it)).collect();
        let negative = fine.outputs.iter().map(|o| o.negative).fold(0.0, f64::max);
        if negative > self.recipe.tolerance {
            warnings.push(format!(
                "the density is negative somewhere: up to {negative:.1e} in all"
            ));
        }
        // The density is nowhere negative: all that is below zero is error.
        let below = |a: f64, b: f64, negative: f64| {
            Estimate::new(a, negative.max((a - b).abs()), Origin::Space)
        };
        // All there is has probability 1.
        let mass = |o: &Output| {
            let error = outside.max((1.0 - o.mass).abs());
            Estimate::new(o.mass, error, Origin::Domain)
        };
        Transient {
            times: fine.outputs.iter().map(|o| o.t).collect(),
            moments,
            mass: fine.outputs.iter().map(mass).collect(),
            lowest_density: pairs()
                .map(|(a, b)| below(a.lowest, b.lowest, -a.lowest))
                .collect(),
            negative_mass: pairs()
                .map(|(a, b)| below(a.negative, b.negative, a.negative))
                .collect(),
            relative_entropy: of_law(relative_entropy),
            distance: of_law(distance),
            method: Method {
                name: self.recipe.name(),
                reason: self.recipe.reason.clone(),
                cells: fine.mesh.cells(),
                unknowns: fine.unknowns,
                domain: fine.mesh.domain(),
                step: fine.step,
                steps: fine.steps + coarse.steps,
                neglected: outside,
            },
            multipliers,
            residual: fine.floquet.as_ref().map_or(0.0, |it| it.residual),
            metastable,
            shortfall,
            densities: fine
                .outputs
                .into_iter()
                .filter_map(|o| o.snapshot)
                .collect(),
            warnings,
        }
    }

    /// Relative entropy and L1 distance to the stationary law at each time: what two runs differ by, with the margin of a number
    /// of which no more is known, and the largest error of a moment over its normalisation.
    fn beside_the_law(
        &self,
        fine: &Run,
        coarse: &Run,
        (moments, scales): (&[Moments], &[[f64; 11]]),
        outside: f64,
    ) -> [Vec<Estimate>; 2] {
        let of = |law: usize, f: fn(&Output) -> f64| {
            let pairs = fine.outputs.iter().zip(&coarse.outputs);
            let one = |((a, b), (moments, scale)): ((&Output, &Output), (&Moments, &[f64; 11]))| {
                // E[H]/T is a part of the entropy.
                let energy = match (law, moments.get(Moment::MeanEnergy)) {
                    (0, Some(energy)) => energy.error / self.oscillator.temperature(),
                    _ => 0.0,
                };
                let numbers = moments.named().into_iter().zip(scale);
                let off = numbers.map(|((_, it), scale)| it.map_or(0.0, |it| it.error / scale));
                let off = off.fold(energy, f64::max);
                let error = left(UNKNOWN) * (f(a) - f(b)).abs() + off + outside + a.doubt[law];
                Estimate::new(f(a), error, Origin::Space)
            };
            pairs.zip(moments.iter().zip(scales)).map(one).collect()
        };
        [of(0, |it| it.entropy), of(1, |it| it.distance)]
    }
}
