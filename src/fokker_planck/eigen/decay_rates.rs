//! The slowest modes: eigenvalues of the Fokker-Planck operator nearest to the imaginary axis.
//!
//! Shift-invert Arnoldi on the operator in Hermite functions of v and spectral elements of q (`hermite`), at
//! three resolutions or more, each finer in elements, functions and domain. An eigenvalue is believed if the
//! last three have it and its changes shrink; the error estimate is twice the last change, or half of the one
//! before where that is larger (the last may pass through zero), the algebraic error
//! |residual| / |left . right|, and rounding. The left eigenvector is the right one with v reversed.
//!
//! **Continuous spectrum.** Out of contact the force is a constant -f, and flights can be arbitrarily high.
//! Functions g = e^{kappa q} phi(v) solve the equation there, with kappa = -f/(2T) + ik where they stay bounded in the
//! norm of p_s; their eigenvalues are
//!
//! ```text
//! lambda = -f^2/(8 zeta T) - T k^2/(2 zeta) - 2 zeta n,   n = 0, 1, ...
//! ```
//!
//! a half-line without gaps. No eigenvalue beyond its edge is slowest: where none lies above it, distances to
//! the stationary law fall as t^{-3/2} e^{-f^2 t/(8 zeta T)} (f = 1 for the built-in laws).
//!
//! **No rate at all.** Where friction acts in contact alone, speed v falls by about zeta times the depth of an impact over v a
//! unit of time, v^{-1/5} for Hertz. From energies beyond E, of probability e^{-c E^{2/5}}, the part e^{-c' E^{-1/5} t} is still
//! there after t, and were there a gap lambda it would be e^{-lambda t} at most: lambda <= c' E^{-1/5} for every E. The
//! spectrum then reaches 0, and eigenvalues of truncated domains fall as these grow. They are the answer only where the
//! domain ends short of flight.

use super::arnoldi::{Arnoldi, Mode};
use crate::error::Result;
use crate::estimate::Shortfall;
use crate::fokker_planck::adaptive::{self, Next, Question, Stop};
use crate::fokker_planck::budget::{Cost, Limits, Work, timing};
use crate::fokker_planck::hermite::{DEGREE, Hierarchy, REACH, Resolution, work as friction_work};
use crate::fokker_planck::settings::Settings;
use crate::oscillator::{Oscillator, Quantity};
use num_complex::Complex;
use rayon::prelude::*;
use std::fmt;

type C = Complex<f64>;

/// An eigenvalue of the generator: a mode decays as e^{re t} and turns at the circular frequency im.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct DecayRate {
    /// Real part, negative.
    pub re: f64,
    /// Imaginary part, not negative: complex modes come in conjugate pairs, each listed once.
    pub im: f64,
    /// Error of |re + i im|.
    pub error: f64,
}

impl fmt::Display for DecayRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.4e}", self.re)?;
        if self.im == 0.0 {
            return Ok(());
        }
        write!(f, " ± {:.4}i", self.im)
    }
}

/// Decay rates with what the tolerance asked for and was not reached.
#[derive(Debug, Clone, PartialEq)]
pub struct DecayRates {
    /// The slowest first; the slowest real one is added where it is not among those asked for. Fewer than
    /// asked for where the rest lies in the continuous spectrum.
    pub rates: Vec<DecayRate>,
    /// Where the continuous spectrum begins ([`Oscillator::continuous_from`]); None for a contact that is never lost. At 0
    /// there is no eigenvalue: flights without friction forget ever more slowly, the higher they are.
    pub continuous_from: Option<f64>,
    /// Functions of q and of v at the finest resolution.
    pub functions: [usize; 2],
    /// What is missing.
    pub shortfall: Option<Shortfall>,
}

/// Krylov vectors of a shift in the first search: the nearest dozens of eigenvalues converge. Finer
/// resolutions, whose shifts are chosen, begin with half as many.
const KRYLOV: usize = 50;

/// Growth of elements and functions from one resolution to the next, and of the energy, in T, at which the
/// domain ends.
const FINER: f64 = 1.4;
const HIGHER: f64 = 4.0;

/// Resolutions at most; the last has 32 times the unknowns of the first.
const RESOLUTIONS: usize = 6;

/// Distance of the shifts along the imaginary axis, in frequencies of small motions, and harmonics searched
/// at most.
const APART: f64 = 0.25;
const HARMONICS: usize = 12;

/// A shift beside a mode that no other is near, over the mode.
const BESIDE: f64 = 0.97;

/// A continuous spectrum this many times faster than the slowest mode leaves room for a real one.
const FAR_BELOW: f64 = 4.0;

/// Resolutions that may bring nothing before the search ends.
const STALLS: usize = 2;

/// Share of the tolerance left to the algebraic error.
const SHARE: f64 = 0.02;

/// An error estimate beyond this, relative to the eigenvalue, makes it unknown.
const KNOWN: f64 = 0.05;

/// Shifts along the imaginary axis that a search begins with: up to the second harmonic.
const SHIFTS: usize = 9;

/// Vectors of a shift over those it begins with, at most.
const MOST_VECTORS: usize = 3;

/// How eigenvalues will be computed: resolutions, shifts, what must be found, and the foreseen cost.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Eigenvalues {
    /// How many are asked for.
    count: usize,
    /// The coarsest resolution.
    first: Resolution,
    /// Whether the scene gave the finest.
    given: bool,
    /// Krylov vectors of a shift in the first search.
    vectors: usize,
    /// Circular frequency of small motions: the shifts lie a quarter of it apart on the imaginary axis.
    natural: f64,
    /// Where the continuous spectrum begins; minus infinity without one.
    edge: f64,
    /// Whether friction depends on the displacement.
    local: bool,
    tolerance: f64,
    /// What it will take: cells are functions of q and of v, steps the factorisations.
    pub(crate) cost: Cost,
}

/// The `count` slowest decay rates of an oscillator with a stationary law, each to `settings.tolerance` of its
/// modulus; `settings.cells` fixes the finest resolution, as functions of q and of v.
///
/// # Errors
/// [`Error::NoStationaryLaw`] for a contact without one; [`Error::Limit`] where `settings.max_seconds` or
/// `settings.max_memory` do not suffice for a first answer; [`Error::Linear`] if a shift hits an eigenvalue.
///
/// [`Error::NoStationaryLaw`]: crate::Error::NoStationaryLaw
/// [`Error::Limit`]: crate::Error::Limit
/// [`Error::Linear`]: crate::Error::Linear
pub fn decay_rates(
    oscillator: &Oscillator,
    count: usize,
    settings: &Settings,
) -> Result<DecayRates> {
    let limits = Limits::from_now(settings.max_seconds, settings.max_memory);
    Eigenvalues::of(oscillator, count, settings)?.solve(oscillator, &limits, &|_| {})
}

impl Eigenvalues {
    /// The recipe for the `count` slowest.
    ///
    /// # Errors
    /// [`Error::NoStationaryLaw`](crate::Error::NoStationaryLaw) for a contact without one.
    pub(crate) fn of(oscillator: &Oscillator, count: usize, settings: &Settings) -> Result<Self> {
        oscillator.displacement_law()?;
        oscillator
            .damping()
            .depends_on_displacement("decay rates")?;
        let contact = oscillator.contact();
        let stiffness = contact.equilibrium().map(|q| contact.stiffness(q));
        let mut it = Self {
            count,
            first: first(settings),
            given: settings.cells.is_some(),
            vectors: KRYLOV.max(count + KRYLOV / 2),
            natural: stiffness.filter(|k| *k > 0.0).map_or(1.0, f64::sqrt),
            edge: oscillator.continuous_from().unwrap_or(f64::NEG_INFINITY),
            local: !oscillator.is_viscous(),
            tolerance: settings.tolerance,
            cost: Cost {
                cells: [0; 2],
                steps: SHIFTS as u64 + 6,
                memory: 0,
                seconds: 0.0,
            },
        };
        if it.edge == 0.0 {
            if it.sees_flight(oscillator) {
                it.cost.steps = 0;
                return Ok(it);
            }
            it.edge = f64::NEG_INFINITY;
        }
        let levels = [0, 1, 2].map(|level| it.work(level));
        let finest = it.resolution(2);
        it.cost.cells = [finest.across(), 2 * finest.pairs];
        it.cost.memory = levels[2].memory;
        it.cost.seconds = levels.iter().map(|it| it.seconds).sum();
        Ok(it)
    }

    /// Whether the domain of the third resolution reaches flight.
    fn sees_flight(&self, oscillator: &Oscillator) -> bool {
        let (contact, reach) = (oscillator.contact(), self.resolution(2).level);
        let rise = contact.loss_point().zip(contact.lowest_potential());
        let rise = rise.map(|(loss, lowest)| contact.potential(loss) - lowest);
        rise.is_some_and(|rise| rise < reach * oscillator.weighed(REACH).temperature())
    }

    /// Method and reason.
    pub(crate) fn words(&self) -> String {
        if self.edge == 0.0 {
            return "nothing to solve for: without friction in flight the spectrum is continuous from 0 on".into();
        }
        let condition = match self.edge / FAR_BELOW {
            f64::NEG_INFINITY => String::new(),
            slow => format!(" where the slowest of all is above {slow:.3}"),
        };
        format!(
            "shift-invert Arnoldi in Hermite functions and spectral elements, three resolutions; {SHIFTS} shifts up \
             to {:.2}i, and one beside each mode far from them; a real rate must be among them{condition}",
            2.0 * self.natural
        )
    }

    /// A resolution, 0 for the coarsest.
    fn resolution(&self, level: usize) -> Resolution {
        (0..level).fold(self.first, |it, _| finer(it))
    }

    /// What a resolution takes: the first looks near every shift, later ones near two or three, with half as many
    /// vectors.
    fn work(&self, level: usize) -> Work {
        let it = self.resolution(level);
        let (places, vectors) = if level == 0 {
            (SHIFTS, self.vectors)
        } else {
            (3, self.vectors / 2)
        };
        let threads = rayon::current_num_threads() as f64;
        // A solve reads a state some forty times, orthogonalisation once a vector: 16 operations each, at a third of
        // the speed.
        let reads = (vectors * (vectors + 40) * it.len()) as f64;
        let factor = if self.local {
            friction_work(it).1
        } else {
            it.operations()
        };
        let operations = factor + 48.0 * reads;
        // Factors and vectors of the shifts that are worked on at the same time.
        let held = 16 * (MOST_VECTORS * self.vectors * it.len()) as u64;
        Work {
            seconds: places as f64 * operations * timing::OPERATION / threads,
            memory: (it.memory() + held) * threads as u64,
        }
    }

    /// As [`decay_rates`], by this recipe.
    ///
    /// # Errors
    /// Those of [`decay_rates`].
    pub(crate) fn solve(
        &self,
        oscillator: &Oscillator,
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<DecayRates> {
        if self.edge == 0.0 {
            return Ok(DecayRates {
                rates: Vec::new(),
                continuous_from: Some(0.0),
                functions: [0; 2],
                shortfall: None,
            });
        }
        let search = Search {
            oscillator,
            recipe: self,
            limits: limits.clone(),
            places: Vec::new(),
            levels: Vec::new(),
            best: None,
            stalls: 0,
        };
        adaptive::pursue(search, limits, progress)
    }
}

/// The coarsest resolution.
fn first(settings: &Settings) -> Resolution {
    let coarse = |n: usize, of: usize| {
        let n = n as f64 / of as f64 / FINER.powi(2);
        (n.round() as usize).max(2)
    };
    let [elements, pairs] = match settings.cells {
        Some([q, v]) => [coarse(q, DEGREE), coarse(v, 2)],
        None => [6, 24],
    };
    Resolution {
        elements,
        pairs,
        // What lies beyond e^-27 in probability moves a slow mode by the square of its size there, about 1e4.
        level: 27.0,
    }
}

fn finer(it: Resolution) -> Resolution {
    it.finer(FINER, HIGHER)
}

/// What three resolutions say.
struct Answer {
    /// Believed eigenvalues above the edge, the slowest first.
    rates: Vec<DecayRate>,
    /// Those of the finest resolution among them that are not believed.
    unknown: Vec<C>,
    /// How many of those asked for no resolution has found.
    missing: usize,
    /// Whether a real one must be there, and none is known.
    real_missing: bool,
    /// Functions of q and of v at the finest resolution.
    functions: [usize; 2],
}

impl Answer {
    /// The largest error over the modulus, and one for each eigenvalue that is not known.
    fn shortage(&self) -> f64 {
        let relative = |it: &DecayRate| it.error / it.re.hypot(it.im);
        let worst = self.rates.iter().map(relative).fold(0.0, f64::max);
        worst + (self.unknown.len() + self.missing + usize::from(self.real_missing)) as f64
    }

    fn report(self, recipe: &Eigenvalues, stop: Stop) -> DecayRates {
        let number = if let Some(value) = self.unknown.first() {
            let near = DecayRate {
                re: value.re,
                im: value.im,
                error: 0.0,
            };
            match self.unknown.len() {
                1 => format!("the eigenvalue near {near}"),
                n => format!("the eigenvalue near {near}, and of {} more,", n - 1),
            }
        } else if self.real_missing {
            "the slowest real eigenvalue".to_owned()
        } else if self.missing > 0 {
            format!("eigenvalue {} of {}", self.rates.len() + 1, recipe.count)
        } else {
            "a decay rate".to_owned()
        };
        let shortage = self.shortage();
        let known = shortage < 1.0;
        let ratio = if known {
            shortage / recipe.tolerance
        } else {
            f64::INFINITY
        };
        DecayRates {
            continuous_from: Some(recipe.edge).filter(|edge| edge.is_finite()),
            functions: self.functions,
            shortfall: stop.shortfall(number, ratio, recipe.tolerance),
            rates: self.rates,
        }
    }
}

/// A point near which eigenvalues are sought, and those that are to converge.
struct Place {
    shift: C,
    targets: Vec<C>,
}

impl Place {
    fn at(shift: C) -> Self {
        let targets = Vec::new();
        Self { shift, targets }
    }
}

struct Search<'a> {
    oscillator: &'a Oscillator,
    recipe: &'a Eigenvalues,
    limits: Limits,
    /// Where finer resolutions are to look.
    places: Vec<Place>,
    /// The modes of each resolution.
    levels: Vec<Vec<Mode>>,
    best: Option<Answer>,
    /// Resolutions that brought nothing.
    stalls: usize,
}

/// The question in messages.
const NAME: &str = "the search for eigenvalues";

impl Question for Search<'_> {
    type Answer = DecayRates;

    fn name(&self) -> String {
        NAME.into()
    }

    fn ratio(&self) -> Option<f64> {
        let best = self.best.as_ref()?;
        Some(best.shortage() / self.recipe.tolerance)
    }

    fn next(&mut self) -> Result<Next> {
        let done = self.levels.len();
        let stop = |text: String, free| Ok(Next::Stop(Stop::new(text, free)));
        if done >= 3 && self.recipe.given {
            return stop("its cells are those of the scene".into(), false);
        }
        if done == RESOLUTIONS || self.stalls == STALLS {
            return stop(format!("{done} resolutions did not settle it"), true);
        }
        Ok(Next::Run {
            now: self.recipe.work(done),
            then: (done < 2).then(|| self.recipe.work(2)),
        })
    }

    fn run(&mut self, _progress: &(dyn Fn(f64) + Sync)) -> Result<()> {
        let done = self.levels.len();
        let resolution = self.recipe.resolution(done);
        let weighed = self.oscillator.weighed(REACH);
        let full = Hierarchy::new(&weighed, Quantity::Displacement, resolution)?;
        let mut modes = Vec::new();
        if done == 0 {
            self.places = self.sweep(&full, &mut modes)?;
        } else {
            self.near(&full, &self.places, self.recipe.vectors / 2, &mut modes)?;
        }
        self.levels.push(modes);
        if let [.., coarse, middle, fine] = &self.levels[..] {
            // Finer resolutions lose digits of close eigenvalues to rounding.
            let answer = self.judge([coarse, middle, fine], resolution);
            match &self.best {
                Some(best) if best.shortage() <= answer.shortage() => self.stalls += 1,
                _ => self.best = Some(answer),
            }
        }
        Ok(())
    }

    fn answer(self, stop: Stop) -> Option<DecayRates> {
        Some(self.best?.report(self.recipe, stop))
    }
}

impl Search<'_> {
    /// The slowest modes of a list that is sorted by rate: those above the edge, as many as asked for.
    fn slowest<'b>(&self, modes: &'b [Mode], count: usize) -> &'b [Mode] {
        let above = modes.partition_point(|it| it.value.re > self.recipe.edge);
        &modes[..above.min(count)]
    }

    /// Modes of a coarse operator, and where finer ones are to look. Shifts lie along the imaginary axis, up to
    /// the first harmonic that has none of the modes asked for, and then where the slowest modes lie far from it.
    fn sweep(&self, full: &Hierarchy, modes: &mut Vec<Mode>) -> Result<Vec<Place>> {
        let Eigenvalues {
            natural,
            count,
            vectors,
            ..
        } = *self.recipe;
        let at = |k: usize| C::new(0.0, APART * natural * k as f64);
        let steps = (1.0 / APART) as usize;
        let mut shifts: Vec<C> = (0..SHIFTS).map(at).collect();
        let mut more = shifts.clone();
        let mut harmonic = 2;
        while !more.is_empty() && shifts.len() <= 2 * steps * HARMONICS {
            let places: Vec<Place> = more.iter().map(|shift| Place::at(*shift)).collect();
            self.near(full, &places, vectors, modes)?;
            let border = natural * (harmonic as f64 - 0.5);
            let wanted = self.slowest(modes, count);
            more = if harmonic < HARMONICS && wanted.iter().any(|it| it.value.im > border) {
                harmonic += 1;
                (1..=steps)
                    .map(|k| at((harmonic - 1) * steps + k))
                    .collect()
            } else {
                harmonic = HARMONICS;
                let all = self.places(modes, &shifts);
                let all = all.into_iter().map(|it| it.shift);
                all.filter(|it| !shifts.contains(it)).collect()
            };
            shifts.extend(&more);
        }
        Ok(self.places(modes, &shifts))
    }

    /// For each mode asked for the nearest shift, or a new one beside it if none is near.
    fn places(&self, modes: &[Mode], shifts: &[C]) -> Vec<Place> {
        // Real modes always have a place.
        let mut places = vec![Place::at(C::default())];
        let mut shifts = shifts.to_vec();
        // Half as many again: some may turn out not to be eigenvalues of the oscillator.
        for mode in self.slowest(modes, self.recipe.count * 3 / 2 + 2) {
            let distance = |shift: &C| (shift - mode.value).norm();
            let all = shifts.iter().copied();
            let nearest = all.min_by(|a, b| distance(a).total_cmp(&distance(b)));
            let near = nearest.filter(|it| distance(it) <= 0.5 * self.recipe.natural);
            let shift = near.unwrap_or_else(|| {
                let beside = BESIDE * mode.value;
                shifts.push(beside);
                beside
            });
            match places.iter_mut().find(|it| it.shift == shift) {
                Some(place) => place.targets.push(mode.value),
                None => places.push(Place {
                    shift,
                    targets: vec![mode.value],
                }),
            }
        }
        places
    }

    /// Adds the modes near the places, with as many Krylov vectors as their targets need, so many at a time.
    fn near(
        &self,
        full: &Hierarchy,
        places: &[Place],
        vectors: usize,
        modes: &mut Vec<Mode>,
    ) -> Result<()> {
        let late = || {
            self.limits
                .in_time(|| "the eigenvalues had not ended".into())
        };
        let error = |modes: &[Mode], target: &C| {
            let distance = |it: &&Mode| (it.value - target).norm();
            let nearest = modes
                .iter()
                .min_by(|a, b| distance(a).total_cmp(&distance(b)));
            nearest.map_or(f64::INFINITY, |it| it.error / target.norm())
        };
        let found: Vec<Result<Vec<Mode>>> = places
            .par_iter()
            .map(|place| {
                let mut arnoldi = Arnoldi::new(full, place.shift, &late)?;
                let mut before = f64::INFINITY;
                loop {
                    let grown = arnoldi.extend(vectors, &late)?;
                    let modes = arnoldi.modes()?;
                    let errors = place.targets.iter().map(|it| error(&modes, it));
                    let worst = errors.fold(0.0, f64::max);
                    // Close eigenvalues stay badly known, however many vectors there are.
                    let enough = worst <= SHARE * self.recipe.tolerance || worst > 0.5 * before;
                    if enough || !grown || arnoldi.size() >= MOST_VECTORS * self.recipe.vectors {
                        return Ok(modes);
                    }
                    before = worst;
                }
            })
            .collect();
        for found in found {
            merge(modes, found?);
        }
        Ok(())
    }

    /// What the last three resolutions, the finest last, say of the modes asked for.
    fn judge(&self, levels: [&Vec<Mode>; 3], resolution: Resolution) -> Answer {
        let Eigenvalues {
            count,
            edge,
            tolerance,
            ..
        } = *self.recipe;
        let [coarse, middle, fine] = &levels.map(|it| conjugates(it));
        let (to_middle, to_coarse) = (partners(fine, middle), partners(middle, coarse));
        let mut answer = Answer {
            rates: Vec::new(),
            unknown: Vec::new(),
            missing: 0,
            real_missing: false,
            functions: [resolution.across(), 2 * resolution.pairs],
        };
        let mut real = false;
        for mode in self.slowest(levels[2], usize::MAX) {
            let wanted = answer.rates.len() < count || (!real && mode.value.im == 0.0);
            if !wanted {
                continue;
            }
            let place = fine.iter().position(|it| *it == mode.value);
            let before = place.and_then(|k| to_middle[k]);
            let first = before.and_then(|k| to_coarse[k]);
            let rate = before.zip(first).and_then(|(before, first)| {
                let path = [coarse[first], middle[before], mode.value];
                believed(path, mode.error, tolerance)
            });
            match rate {
                Some(rate) => {
                    real |= rate.im == 0.0;
                    answer.rates.push(rate);
                }
                None => answer.unknown.push(mode.value),
            }
        }
        // Above the edge of a continuous spectrum there may be no more; a real one there is if the edge lies far
        // below others.
        if edge == f64::NEG_INFINITY {
            let found = answer.rates.len() + answer.unknown.len();
            answer.missing = count.saturating_sub(found);
        }
        let slowest = answer.rates.first().map_or(f64::NEG_INFINITY, |it| it.re);
        answer.real_missing = !real && edge < FAR_BELOW * slowest;
        answer
    }
}

/// An eigenvalue at three resolutions, the finest last, with its estimate; None if it is not known. Changes
/// that halve at least show its order; where they do not, twice the larger must be within the tolerance.
fn believed(path: [C; 3], algebraic: f64, tolerance: f64) -> Option<DecayRate> {
    let [earlier, last] = [(path[1] - path[0]).norm(), (path[2] - path[1]).norm()];
    let size = path[2].norm();
    let (change, limit) = if last <= 0.5 * earlier {
        (last.max(0.25 * earlier), KNOWN)
    } else {
        (last.max(earlier), tolerance.min(KNOWN))
    };
    let error = 2.0 * change + algebraic;
    (error <= limit * size).then_some(DecayRate {
        re: path[2].re,
        im: path[2].im,
        error,
    })
}

/// The modes and the conjugates of the complex ones.
fn conjugates(modes: &[Mode]) -> Vec<C> {
    let pair = |it: &Mode| match it.value {
        value if value.im > 0.0 => vec![value, value.conj()],
        value => vec![value],
    };
    modes.iter().flat_map(pair).collect()
}

/// For each of `these` its partner among `those`, each given once, the closest first.
fn partners(these: &[C], those: &[C]) -> Vec<Option<usize>> {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (i, a) in these.iter().enumerate() {
        let near = those.iter().enumerate();
        let near = near.map(|(j, b)| ((a - b).norm(), i, j));
        pairs.extend(near.filter(|(distance, ..)| *distance < 0.2 * a.norm()));
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut partner = vec![None; these.len()];
    let mut taken = vec![false; those.len()];
    for (_, i, j) in pairs {
        if partner[i].is_none() && !taken[j] {
            (partner[i], taken[j]) = (Some(j), true);
        }
    }
    partner
}

/// Adds the modes of another shift that are not in the list yet, the better known of two alike, and sorts by
/// rate. Each mode of the list stands for one of the others, so that close eigenvalues stay apart.
fn merge(list: &mut Vec<Mode>, more: Vec<Mode>) {
    let mut free = vec![true; list.len()];
    for mode in more {
        let same = |other: &Mode| {
            let apart = (mode.value - other.value).norm();
            apart < 1e-7 * mode.value.norm() + 2.0 * (mode.error + other.error)
        };
        match (0..free.len()).find(|k| free[*k] && same(&list[*k])) {
            Some(k) => {
                free[k] = false;
                if mode.error < list[k].error {
                    list[k] = mode;
                }
            }
            None => list.push(mode),
        }
    }
    list.sort_by(|a, b| b.value.re.total_cmp(&a.value.re));
}
