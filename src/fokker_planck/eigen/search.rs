//! The search for the slowest eigenvalues over resolutions.

use super::arnoldi::Arnoldi;
use super::decay_rates::{DecayRate, DecayRates, Eigenvalues, FAR_BELOW, MOST_VECTORS, SHIFTS};
use crate::error::Result;
use crate::fokker_planck::adaptive::{self, Next, Question, Stop};
use crate::fokker_planck::budget::Limits;
use crate::fokker_planck::convergence::left_of;
use crate::fokker_planck::hermite::{Hierarchy, Resolution, lost_digits};
use crate::fokker_planck::krylov::Ritz;
use crate::fokker_planck::policy::{RATES_APART, RATES_BESIDE, RATES_KNOWN, SHARE};
use crate::fokker_planck::settings::Settings;
use crate::oscillator::{Oscillator, Quantity};
use num_complex::Complex;
use rayon::prelude::*;

type C = Complex<f64>;

/// Harmonics searched at most.
const HARMONICS: usize = 12;

/// Resolutions that may bring nothing before the search ends.
const STALLS: usize = 2;

/// Resolutions at most; the last has a hundred times the unknowns of the first.
const RESOLUTIONS: usize = 8;

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
    settings.check()?;
    DecayRates::check(count)?;
    Eigenvalues::of(oscillator, count, settings)?.solve(oscillator, &settings.limits(), &|_| {})
}

impl Eigenvalues {
    /// As [`decay_rates`], by this recipe.
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
        adaptive::pursue(search, (NAME, !self.given), limits, progress)
    }
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
    /// Whether one is not known that the resolutions there are will not settle: as an answer it brings nothing.
    adrift: bool,
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
    levels: Vec<Vec<Ritz>>,
    best: Option<Answer>,
    /// Resolutions that brought nothing.
    stalls: usize,
}

/// The question in messages.
const NAME: &str = "the search for eigenvalues";

impl Question for Search<'_> {
    type Answer = DecayRates;

    fn ratio(&self) -> Option<f64> {
        let best = self.best.as_ref()?;
        Some(best.shortage() / self.recipe.tolerance)
    }

    fn next(&mut self) -> Result<Next> {
        let (done, given) = (self.levels.len(), self.recipe.given);
        let most = if self.stalls == STALLS {
            done
        } else {
            RESOLUTIONS
        };
        let work = |level: usize| self.recipe.work(level);
        Ok(Next::of_three(done, most, given, work))
    }

    fn run(&mut self, _progress: &(dyn Fn(f64) + Sync)) -> Result<()> {
        let done = self.levels.len();
        let resolution = self.recipe.resolution(done);
        let full = Hierarchy::new(self.oscillator, Quantity::Displacement, resolution)?;
        let modes = self.modes(&full);
        let modes = modes.map_err(|error| lost_digits(self.oscillator, error))?;
        self.levels.push(modes);
        if let [.., coarse, middle, fine] = &self.levels[..] {
            // Finer resolutions lose digits of close eigenvalues to rounding.
            let answer = self.judge([coarse, middle, fine], resolution);
            match &self.best {
                Some(best) if best.shortage() <= answer.shortage() => self.stalls += 1,
                _ => (self.stalls, self.best) = (usize::from(answer.adrift), Some(answer)),
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
    fn slowest<'b>(&self, modes: &'b [Ritz], count: usize) -> &'b [Ritz] {
        let above = modes.partition_point(|it| it.value.re > self.recipe.edge);
        &modes[..above.min(count)]
    }

    /// The modes of a resolution; the coarsest says where finer ones look.
    fn modes(&mut self, full: &Hierarchy) -> Result<Vec<Ritz>> {
        let mut modes = Vec::new();
        if self.levels.is_empty() {
            self.places = self.sweep(full, &mut modes)?;
        } else {
            self.near(full, &self.places, self.recipe.vectors / 2, &mut modes)?;
        }
        Ok(modes)
    }

    /// Modes of a coarse operator, and where finer ones are to look. Shifts lie along the imaginary axis, up to
    /// the first harmonic that has none of the modes asked for, and then where the slowest modes lie far from it.
    fn sweep(&self, full: &Hierarchy, modes: &mut Vec<Ritz>) -> Result<Vec<Place>> {
        let Eigenvalues {
            natural,
            count,
            vectors,
            ..
        } = *self.recipe;
        let at = |k: usize| C::new(0.0, RATES_APART.get() * natural * k as f64);
        let steps = (1.0 / RATES_APART.get()) as usize;
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
    fn places(&self, modes: &[Ritz], shifts: &[C]) -> Vec<Place> {
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
                let beside = RATES_BESIDE.get() * mode.value;
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
        modes: &mut Vec<Ritz>,
    ) -> Result<()> {
        let late = self.limits.late("the eigenvalues");
        let error = |modes: &[Ritz], target: &C| {
            let distance = |it: &&Ritz| (it.value - target).norm();
            let nearest = modes
                .iter()
                .min_by(|a, b| distance(a).total_cmp(&distance(b)));
            nearest.map_or(f64::INFINITY, |it| it.error / target.norm())
        };
        // The first that fails ends all.
        let found: Result<Vec<Vec<Ritz>>> = places
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
                    let enough =
                        worst <= SHARE.get() * self.recipe.tolerance || worst > 0.5 * before;
                    if enough || !grown || arnoldi.size() >= MOST_VECTORS * self.recipe.vectors {
                        return Ok(modes);
                    }
                    before = worst;
                }
            })
            .collect();
        for found in found? {
            merge(modes, &found);
        }
        Ok(())
    }

    /// Whether an eigenvalue that goes on moving as it did will not be known at the last resolution there is: so go waves of
    /// flights that friction hardly reaches, further with every resolution.
    fn is_adrift(&self, path: [C; 3]) -> bool {
        let [before, last] = changes(path);
        let fall = (last / before).min(1.0);
        let more = RESOLUTIONS.saturating_sub(self.levels.len()) as i32;
        left_of([before, last]) * fall.powi(more) > RATES_KNOWN.get() * path[2].norm()
    }

    /// What the last three resolutions, the finest last, say of the modes asked for.
    fn judge(&self, levels: [&Vec<Ritz>; 3], resolution: Resolution) -> Answer {
        let Eigenvalues {
            count, edge, local, ..
        } = *self.recipe;
        let [coarse, middle, fine] = &levels.map(|it| conjugates(it));
        let near = |these: &[C], those: &[C]| partners(these, those, |i, _| 0.2 * these[i].norm());
        let (to_middle, to_coarse) = (near(fine, middle), near(middle, coarse));
        let mut answer = Answer {
            rates: Vec::new(),
            unknown: Vec::new(),
            missing: 0,
            real_missing: false,
            adrift: false,
            functions: resolution.functions(),
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
            let path = before
                .zip(first)
                .map(|(before, first)| [coarse[first], middle[before], mode.value]);
            match path.and_then(|path| believed(path, mode.error)) {
                Some(rate) => {
                    real |= rate.im == 0.0;
                    answer.rates.push(rate);
                }
                None => {
                    answer.adrift |= local && path.is_some_and(|path| self.is_adrift(path));
                    answer.unknown.push(mode.value);
                }
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

/// How far an eigenvalue moves from one of three resolutions to the next.
fn changes(path: [C; 3]) -> [f64; 2] {
    [path[1] - path[0], path[2] - path[1]].map(C::norm)
}

/// An eigenvalue at three resolutions, the finest last, with its estimate; None where it is not known.
fn believed(path: [C; 3], algebraic: f64) -> Option<DecayRate> {
    let error = left_of(changes(path)) + algebraic;
    (error <= RATES_KNOWN.get() * path[2].norm()).then_some(DecayRate {
        re: path[2].re,
        im: path[2].im,
        error,
    })
}

/// The modes and the conjugates of the complex ones.
fn conjugates(modes: &[Ritz]) -> Vec<C> {
    let pair = |it: &Ritz| match it.value {
        value if value.im > 0.0 => vec![value, value.conj()],
        value => vec![value],
    };
    modes.iter().flat_map(pair).collect()
}

/// For each of `these` its partner among `those` that lies within what the function of both numbers says, each given once,
/// the closest first.
fn partners(these: &[C], those: &[C], within: impl Fn(usize, usize) -> f64) -> Vec<Option<usize>> {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (i, a) in these.iter().enumerate() {
        let near = those.iter().enumerate();
        let near = near.map(|(j, b)| ((a - b).norm(), i, j));
        pairs.extend(near.filter(|(distance, i, j)| *distance < within(*i, *j)));
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
fn merge(list: &mut Vec<Ritz>, more: &[Ritz]) {
    let values = |modes: &[Ritz]| -> Vec<C> { modes.iter().map(|it| it.value).collect() };
    let within =
        |i: usize, j: usize| 1e-7 * more[i].value.norm() + 2.0 * (more[i].error + list[j].error);
    let same = partners(&values(more), &values(list), within);
    for (mode, same) in more.iter().zip(same) {
        match same {
            Some(k) if mode.error < list[k].error => list[k] = *mode,
            Some(_) => {}
            None => list.push(*mode),
        }
    }
    list.sort_by(|a, b| b.value.re.total_cmp(&a.value.re));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_that_is_badly_known_takes_no_place_of_one_that_is_known() {
        let mode = |re: f64, error: f64| Ritz {
            value: C::new(re, 0.0),
            error,
        };
        let mut list = vec![mode(-1.0, 1e-9), mode(-3.0, 1e-9)];
        // Both could be -1 by their errors.
        merge(&mut list, &[mode(-2.9, 2.0), mode(-1.000_000_1, 1e-6)]);
        let values: Vec<f64> = list.iter().map(|it| it.value.re).collect();
        assert_eq!(values, [-1.0, -3.0]);
    }
}
