//! From a tolerance to a spectrum: finer and finer operators.

use super::curve::{FLOOR, Spectrum};
use super::reduced::{Answer, Form, POWERS, Reduced};
use crate::contact::ContactLaw;
use crate::error::{Error, Result, finite};
use crate::estimate::{Estimate, Origin};
use crate::fokker_planck::adaptive::{self, Next, Question, Stop};
use crate::fokker_planck::budget::{Cost, Limits, timing};
use crate::fokker_planck::convergence::{UNKNOWN, left, left_nearby};
use crate::fokker_planck::hermite::{
    Adjoint, Hierarchy, Resolution, lost_digits, work as friction_work,
};
use crate::fokker_planck::policy::{SHARE, SPECTRUM_NEARBY};
use crate::fokker_planck::settings::Settings;
use crate::oscillator::{Oscillator, Quantity};
use std::f64::consts::FRAC_2_PI;

/// Frequencies solved for at most on one mesh.
const SOLVES: usize = 160;

/// Unknowns in q beyond which blocks no longer fit a reasonable time.
const WIDEST: usize = 1200;

/// The spectrum of `quantity` in the stationary motion at the ascending circular frequencies `omegas`.
///
/// The operator is refined until the change is within `settings.tolerance` of the normalisation, the
/// larger of the value and 1e-6 of the peak; `settings.cells` fixes the finest one, as functions of q and
/// of v. `progress` is called with the fraction done.
///
/// # Errors
/// [`Error::NoStationaryLaw`] for a contact that does not confine; [`Error::Invalid`] for no
/// frequencies, or frequencies that are negative, not finite or not ascending; [`Error::Limit`] beyond
/// `settings.max_seconds`.
pub fn spectrum(
    oscillator: &Oscillator,
    quantity: Quantity,
    omegas: &[f64],
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Spectrum> {
    settings.check()?;
    let until = omegas.last().copied().unwrap_or_default();
    let recipe = Resolvent::of(oscillator, until, settings);
    recipe.solve(oscillator, quantity, omegas, &settings.limits(), progress)
}

/// How a spectrum will be computed: the first resolution, and the foreseen cost.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Resolvent {
    first: Resolution,
    /// Whether the scene gave the cells.
    given: bool,
    tolerance: f64,
    /// Frequencies that a model is expected to be made of.
    solves: f64,
    /// Whether friction depends on the displacement.
    local: bool,
    /// What it will take: cells are functions of q and of v, steps frequencies to solve for.
    pub(crate) cost: Cost,
}

/// The lowest temperature of the runs that foresee the others.
const COLD: f64 = 0.01;

impl Resolvent {
    /// The method.
    pub(crate) const METHOD: &str = "resolvent in Hermite functions and spectral elements; a reduced model joins \
                                     the frequencies";

    /// The recipe for frequencies up to `until`.
    pub(crate) fn of(oscillator: &Oscillator, until: f64, settings: &Settings) -> Self {
        // Beyond 18 T lies 2e-8 of the probability of energies; a function there changes no spectrum by
        // more than that times the square of its size, about 1e3. Each finer operator shows what that was. A law with a heavier tail
        // asks for more: at 18, contact damping with zeta = 0.005, T = 0.1 takes two operators more.
        let first = Resolution::first(
            settings.cells,
            1,
            [6, 24],
            if oscillator.is_viscous() { 18.0 } else { 22.0 },
        );
        // Motions of other energies go at other frequencies and are sheared until the noise smears them: the less damped, the finer,
        // up to where most motions lose contact. Fitted to some hundred runs, T from 0.01 to 60, zeta from 0.003 to 0.6, `until`
        // from 1.5 to 12, tolerances from 1e-2 to 1e-5.
        // Those of a linear contact go at one: it is as a cold one, whatever its temperature.
        let hot = match oscillator.contact() {
            ContactLaw::Linear => COLD,
            _ => oscillator.temperature(),
        };
        let hot = hot.log10();
        let damped = (0.5 * oscillator.reference_friction() / 0.005).log10();
        let digits = -settings.tolerance.max(1e-12).log10() - 3.0;
        let octaves = (until.max(0.1) / 3.0).log2();
        let rounds = 2.5 + 0.8 * hot.min(0.0) - 1.2 * damped + 0.7 * digits + 0.2 * octaves;
        let rounds = settings.cells.map_or(rounds.clamp(1.0, 9.0), |_| 1.0);
        let solves = 2.6 + 0.2 * hot - 0.85 * damped + 0.27 * octaves;
        let solves = solves.exp().clamp(4.0, SOLVES as f64);
        let local = !oscillator.is_viscous();
        // Refinement ends where memory does.
        let foreseen = |rounds: f64| work(first.finer(rounds), solves, local);
        let mut fewer = (1..=rounds.ceil() as usize)
            .rev()
            .map(|k| rounds.min(k as f64));
        let fits = |rounds: &f64| foreseen(*rounds).memory <= settings.max_memory;
        let rounds = fewer.find(fits).unwrap_or(1.0);
        let last = foreseen(rounds);
        Self {
            first,
            given: settings.cells.is_some(),
            tolerance: settings.tolerance,
            solves,
            local,
            cost: Cost {
                cells: Some(first.finer(rounds).functions()),
                steps: solves as u64,
                memory: last.memory,
                // The coarser operators take a third as much again.
                seconds: 1.35 * last.seconds + (rounds + 1.0) * timing::MODEL,
            },
        }
    }

    /// As [`spectrum`], by this recipe.
    pub(crate) fn solve(
        &self,
        oscillator: &Oscillator,
        quantity: Quantity,
        omegas: &[f64],
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Spectrum> {
        oscillator.displacement_law()?;
        check(omegas)?;
        let task = Task {
            recipe: self,
            oscillator,
            quantity,
            omegas,
            control: control(omegas),
            limits: limits.clone(),
            next: self.first,
            solved: Vec::new(),
            last: None,
            changes: None,
            best: None,
        };
        adaptive::pursue(task, ("the spectrum", !self.given), limits, progress)
    }
}

/// What the model of one resolution takes.
fn work(it: Resolution, solves: f64, local: bool) -> Cost {
    let threads = rayon::current_num_threads() as f64;
    // The transpose is an operator of its own where friction depends on the displacement.
    let (sides, memory, operations) = if local {
        let (memory, operations) = friction_work(it);
        (2.0, memory, operations)
    } else {
        (1.0, it.memory(), it.operations())
    };
    let vectors = sides * 2.0 * POWERS as f64 * solves;
    // Basis, residuals, new states with what is made of them, and copies while they grow.
    let states = 6.0 * 8.0 * vectors * it.len() as f64;
    // Few rows at a time.
    let products = timing::NESTED * 12.0 * vectors * vectors * it.len() as f64;
    Cost {
        seconds: (sides * solves * operations + products) * timing::OPERATION / threads,
        memory: memory * threads as u64 + states as u64,
        ..Cost::default()
    }
}

/// A spectrum that is refined to the tolerance.
struct Task<'a> {
    recipe: &'a Resolvent,
    oscillator: &'a Oscillator,
    quantity: Quantity,
    omegas: &'a [f64],
    control: Vec<f64>,
    limits: Limits,
    next: Resolution,
    /// Frequencies that the last resolution was solved for.
    solved: Vec<f64>,
    /// The answers of the last resolution at the frequencies watched, and the largest relative change near each of them from the
    /// one before.
    last: Option<Vec<Answer>>,
    changes: Option<Vec<f64>>,
    best: Option<Spectrum>,
}

impl Task<'_> {
    /// Whether finer operators may have the law that this one has not: one of the first three, if none has told a spectrum.
    fn is_coarse(&self) -> bool {
        let recipe = self.recipe;
        self.best.is_none() && !recipe.given && self.next.pairs <= recipe.first.refined(2).pairs
    }

    /// The model of the next resolution, and the mean where damping leaves no closed form of it.
    fn model(&self, progress: &(dyn Fn(f64) + Sync)) -> Result<(Reduced, Option<f64>)> {
        let (recipe, limits, quantity) = (self.recipe, &self.limits, self.quantity);
        let full = Hierarchy::new(self.oscillator, quantity, self.next)?;
        let late = limits.late("the stationary law of the spectrum");
        let form = Form {
            adjoint: Adjoint::of(self.oscillator, &full, quantity, &late)?,
            full,
        };
        let go_on = |solved: usize| {
            progress((solved as f64 / recipe.solves).min(1.0));
            limits.in_time(|| format!("{solved} frequencies of the spectrum were solved"))
        };
        // A resolution that is compared with a coarser one need not be known much better than that one was, and the coarsest
        // had better not be: it has modes that are there for want of functions.
        let known = match &self.best {
            _ if recipe.given => 0.0,
            Some(best) => best.worst().0,
            None => SHARE.get(),
        };
        let model = Reduced::new(
            &form,
            &self.control,
            SHARE.get() * recipe.tolerance.max(known),
            FLOOR,
            (&self.solved, SOLVES),
            &go_on,
        );
        let model = model.map_err(|error| lost_digits(self.oscillator, error))?;
        Ok((model, form.adjoint.map(|it| it.mean)))
    }
}

impl Question for Task<'_> {
    type Answer = Spectrum;

    fn ratio(&self) -> Option<f64> {
        let best = self.best.as_ref()?;
        Some(best.worst().0 / self.recipe.tolerance)
    }

    fn next(&mut self) -> Result<Next> {
        if self.best.is_some() && self.recipe.given {
            return Ok(Next::stop("its cells are those of the scene"));
        }
        if self.best.is_some() && self.next.across() > WIDEST {
            let text = format!("the next resolution has more than {WIDEST} functions of q");
            return Ok(Next::stop(text));
        }
        let Resolvent { solves, local, .. } = *self.recipe;
        let then = self.last.is_none();
        let then = then.then(|| work(self.next.refined(1), solves, local));
        let now = work(self.next, solves, local);
        Ok(Next::Run { now, then })
    }

    fn run(&mut self, progress: &(dyn Fn(f64) + Sync)) -> Result<()> {
        let (model, mean) = match self.model(progress) {
            // Functions so few may have more than one law.
            Err(Error::Unresolved { .. }) if self.is_coarse() => {
                (self.last, self.changes) = (None, None);
                self.next = self.next.refined(1);
                return Ok(());
            }
            found => found?,
        };
        let Self {
            omegas,
            control,
            next,
            quantity,
            ..
        } = self;
        // A finer operator needs fewer: it has no modes that are there for want of functions.
        let mut solved = model.solved.clone();
        solved.sort_by(f64::total_cmp);
        self.solved = solved.into_iter().step_by(2).collect();
        let fine = model.all(control);
        if let Some(coarse) = &self.last {
            let relative = |(a, b): (&Answer, &Answer)| {
                (a.value - b.value).abs() / b.value.abs().max(f64::MIN_POSITIVE)
            };
            let each: Vec<f64> = coarse.iter().zip(&fine).map(relative).collect();
            let last = nearby(control, &each);
            let errors: Vec<f64> = match &self.changes {
                None => last.iter().map(|it| left(UNKNOWN) * it).collect(),
                Some(before) => {
                    let both = before.iter().zip(&last);
                    both.map(|(a, b)| left_nearby([*a, *b])).collect()
                }
            };
            self.changes = Some(last);
            let answers = model.all(omegas);
            let spectrum = Spectrum {
                quantity: *quantity,
                omega: omegas.to_vec(),
                density: estimates(omegas, &answers, control, &errors),
                variance: model.variance,
                mean,
                functions: next.functions(),
                solves: model.solved.len(),
                dimension: model.dimension(),
                shortfall: None,
                model,
            };
            // One of which no value is known is none.
            if spectrum.density.iter().any(|it| it.error < it.value.abs()) {
                self.best = Some(spectrum);
            }
        }
        self.last = Some(fine);
        self.next = next.refined(1);
        Ok(())
    }

    fn answer(self, stop: Stop) -> Option<Spectrum> {
        let best = self.best?;
        let (error, omega) = best.worst();
        let number = format!("the spectrum at omega = {omega:.3}");
        let tolerance = self.recipe.tolerance;
        Some(Spectrum {
            shortfall: stop.shortfall(number, error / tolerance, tolerance),
            ..best
        })
    }
}

fn check(omegas: &[f64]) -> Result<()> {
    if omegas.is_empty() {
        return Err(Error::invalid(
            "omegas",
            "an empty list",
            "at least one frequency",
        ));
    }
    for (k, omega) in omegas.iter().enumerate() {
        let name = format!("omegas[{k}]");
        finite(&name, *omega)?;
        if *omega < 0.0 || (k > 0 && *omega <= omegas[k - 1]) {
            let accepted = "ascending frequencies, none negative";
            return Err(Error::invalid(name, omega, accepted));
        }
    }
    Ok(())
}

/// Spacing of the frequencies at which errors are watched.
const SPACING: f64 = 0.025;

/// The frequencies at which errors are watched: an even grid over the range and a little beyond, so that
/// a few frequencies are not believed because a change happens to be small there, and a share of those
/// asked for.
fn control(omegas: &[f64]) -> Vec<f64> {
    let (low, high) = (omegas[0], omegas[omegas.len() - 1]);
    let (low, high) = ((low - 4.0 * SPACING).max(0.0), high + 4.0 * SPACING);
    let step = SPACING.max((high - low) / 400.0);
    let count = ((high - low) / step).ceil() as usize;
    let mut all: Vec<f64> = (0..=count)
        .map(|k| low + (high - low) * k as f64 / count as f64)
        .collect();
    all.extend(omegas.iter().step_by(omegas.len().div_ceil(400)));
    all.sort_by(f64::total_cmp);
    all.dedup_by(|a, b| *a - *b < 1e-9);
    all
}

/// The largest of the changes near each of the frequencies watched: a difference of two curves crosses zero where they are no
/// better than elsewhere.
fn nearby(control: &[f64], changes: &[f64]) -> Vec<f64> {
    let reach = SPECTRUM_NEARBY.get();
    let largest = |omega: &f64| {
        let first = control.partition_point(|w| *w < omega - reach);
        let end = control.partition_point(|w| *w <= omega + reach);
        changes[first..end].iter().fold(0.0f64, |a, b| a.max(*b))
    };
    control.iter().map(largest).collect()
}

/// The answers, each with the larger relative error of the two frequencies watched beside it.
fn estimates(omegas: &[f64], answers: &[Answer], control: &[f64], errors: &[f64]) -> Vec<Estimate> {
    let estimate = |(omega, it): (&f64, &Answer)| {
        let value = FRAC_2_PI * it.value;
        let above = control.partition_point(|w| w < omega).min(errors.len() - 1);
        let relative = errors[above].max(errors[above.saturating_sub(1)]);
        let error = FRAC_2_PI * it.error + value.abs() * relative;
        Estimate::new(value, error, Origin::Space)
    };
    omegas.iter().zip(answers).map(estimate).collect()
}

#[cfg(test)]
mod tests {
    use super::{left_nearby, nearby};

    #[test]
    fn a_change_is_judged_by_how_it_falls_where_it_is() {
        // It falls tenfold at the first frequencies, and hardly at the last.
        let control: Vec<f64> = (0..5).map(f64::from).collect();
        let [before, last] = [[1.0; 5], [0.1, 0.1, 0.0, 0.8, 0.8]].map(|it| nearby(&control, &it));
        let both = before.iter().zip(&last);
        let left: Vec<f64> = both.map(|(a, b)| left_nearby([*a, *b])).collect();
        assert_eq!(left[0], left[1]);
        assert!(left[0] >= 0.1 && left[0] < 0.2, "{left:?}");
        // A change of none may be one that passes through zero.
        assert!(left[2] >= 0.1, "{left:?}");
        assert!(left[3] > 4.0 * 0.8, "{left:?}");
    }
}
