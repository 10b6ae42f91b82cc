//! The answer of a transient: two runs joined, every number with its error.

use super::error_estimate::{Errors, outside};
use super::floquet::Floquet;
use super::output::Output;
use super::run::{Run, Task};
use crate::estimate::{Estimate, Origin, Shortfall, name_at};
use crate::fokker_planck::adaptive::Stop;
use crate::fokker_planck::convergence::{UNKNOWN, left};
use crate::fokker_planck::density::Snapshot;
use crate::fokker_planck::policy::SETTLED;
use crate::fokker_planck::settings::Method;
use crate::moments::Moments;
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
    /// Of a law that lasts under a drive: what the map over a period says beside it.
    pub(crate) floquet: Option<Floquet>,
    /// The largest error of a moment over its normalisation.
    pub(crate) worst: f64,
    /// What the tolerance asked for and was not reached.
    pub shortfall: Option<Shortfall>,
    /// What the reader should know.
    pub warnings: Vec<String>,
}

impl Transient {
    /// Leaves the numbers of these times only, the densities as they are.
    pub(crate) fn keep_times(&mut self, times: &[f64]) {
        fn keep<T>(items: &mut Vec<T>, kept: &[bool]) {
            let mut kept = kept.iter();
            items.retain(|_| kept.next().copied().unwrap_or(true));
        }
        let kept: Vec<bool> = self.times.iter().map(|t| times.contains(t)).collect();
        keep(&mut self.times, &kept);
        keep(&mut self.moments, &kept);
        keep(&mut self.mass, &kept);
        keep(&mut self.lowest_density, &kept);
        keep(&mut self.negative_mass, &kept);
        keep(&mut self.relative_entropy, &kept);
        keep(&mut self.distance, &kept);
    }
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
        let floquet = Floquet::joined([&fine, coarse], &moments, errors.alike());
        if let Some(it) = floquet.as_ref().and_then(|it| it.growing) {
            warnings.push(format!(
                "waves of the mesh grow {it:.2} times in a period: the law is a fixed point all the same, and these multipliers are left out"
            ));
        }
        let (worst, k, i) = errors.worst(&fine);
        let tolerance = self.recipe.tolerance;
        let (name, t) = (moments[k].named()[i].0, fine.outputs[k].t);
        let number = match self.recipe.period {
            Some(period) => {
                let phase = TAU * (t - fine.outputs[0].t) / period;
                format!("{name} at phase {phase:.4}")
            }
            None => name_at(name, t),
        };
        let shortfall = stop.shortfall(number, worst / tolerance, tolerance);
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
            beside_the_law([&fine, coarse], (&moments, errors.scales()), outside);
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
            floquet,
            worst,
            shortfall,
            densities: fine
                .outputs
                .into_iter()
                .filter_map(|o| o.snapshot)
                .collect(),
            warnings,
        }
    }
}

/// Relative entropy and L1 distance to the stationary law at each time: what two runs differ by, with the margin of a number
/// of which no more is known, and the largest error of a moment over its normalisation.
fn beside_the_law(
    [fine, coarse]: [&Run; 2],
    (moments, scales): (&[Moments], &[[f64; 11]]),
    outside: f64,
) -> [Vec<Estimate>; 2] {
    let of = |law: usize, f: fn(&Output) -> f64| {
        let pairs = fine.outputs.iter().zip(&coarse.outputs);
        let one = |((a, b), (moments, scale)): ((&Output, &Output), (&Moments, &[f64; 11]))| {
            // E[H]/T, a part of the entropy, among them.
            let numbers = moments.named().into_iter().zip(scale);
            let off = numbers.map(|((_, it), scale)| it.map_or(0.0, |it| it.error / scale));
            let off = off.fold(0.0, f64::max);
            let error = left(UNKNOWN) * (f(a) - f(b)).abs() + off + outside + a.doubt[law];
            Estimate::new(f(a), error, Origin::Space)
        };
        pairs.zip(moments.iter().zip(scales)).map(one).collect()
    };
    [of(0, |it| it.entropy), of(1, |it| it.distance)]
}
