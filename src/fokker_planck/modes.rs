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

use super::budget::Cost;
use super::hermite::{DEGREE, Factored, Hierarchy, Resolution};
use super::settings::Settings;
use crate::error::{Error, Result};
use crate::estimate::Shortfall;
use crate::oscillator::{Oscillator, Quantity};
use crate::sparse::eigen;
use ndarray::Array2;
use num_complex::Complex;
use rayon::prelude::*;
use std::fmt;
use std::time::Instant;

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
    /// Where the continuous spectrum begins; None for a contact that is never lost.
    pub continuous_from: Option<f64>,
    /// Functions of q and of v at the finest resolution.
    pub functions: [usize; 2],
    /// What is missing.
    pub shortfall: Option<Shortfall>,
}

/// Krylov vectors of a shift in the first search: the nearest dozens of eigenvalues converge. Finer
/// resolutions, whose shifts are chosen, begin with half as many.
const KRYLOV: usize = 50;

/// Rounding of the operator, relative to its largest entries: orthonormal functions under a p_q that falls by many
/// powers of ten (measured at T = 26, where equal eigenvalues of three resolutions differ by it).
const ROUNDING: f64 = 2e-13;

/// Residual of a Ritz value, relative to it, beyond which it is not converged. An eigenvalue that is close to others
/// may have converged and be known badly all the same.
const CONVERGED: f64 = 1e-3;

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

/// The `count` slowest decay rates of an oscillator with a stationary law, each to `settings.tolerance` of its
/// modulus; `settings.cells` fixes the finest resolution, as functions of q and of v.
///
/// # Errors
/// [`Error::NoStationaryLaw`] for a contact without one; [`Error::Limit`] for a first resolution that does
/// not fit `settings.max_memory`; [`Error::Linear`] if a shift hits an eigenvalue.
pub fn decay_rates(
    oscillator: &Oscillator,
    count: usize,
    settings: &Settings,
) -> Result<DecayRates> {
    let began = Instant::now();
    let search = Search::new(oscillator, count, settings.tolerance)?;
    let mut resolution = first(settings);
    search.check_memory(resolution, settings)?;
    let (coarse, shifts) = search.sweep(&search.operator(resolution)?)?;
    let mut levels = vec![coarse];
    let mut best: Option<Answer> = None;
    let mut stalls = 0;
    loop {
        let next = finer(resolution);
        let clock = Instant::now();
        levels.push(search.refine(&search.operator(next)?, &shifts)?);
        let longer = finer(next).operations() / next.operations();
        let (seconds, done) = (longer * clock.elapsed().as_secs_f64(), levels.len());
        resolution = next;
        if done < 3 {
            continue;
        }
        // Finer resolutions lose digits of close eigenvalues to rounding.
        let answer = search.judge(&levels[done - 3..], resolution);
        let answer = match best.take() {
            Some(best) if best.shortage() <= answer.shortage() => {
                stalls += 1;
                best
            }
            _ => answer,
        };
        let left = (settings.max_seconds - began.elapsed().as_secs_f64()).max(0.0);
        let stop = if settings.cells.is_some() {
            Some(("its cells are those of the scene".to_owned(), false))
        } else if answer.shortage() <= settings.tolerance {
            Some((String::new(), true))
        } else if done == RESOLUTIONS || stalls == STALLS {
            Some((format!("{done} resolutions did not settle it"), true))
        } else if seconds > left {
            let text = format!(
                "a finer resolution would take about {seconds:.1e} s, and {left:.1e} s are left of \
                 accuracy.max_seconds"
            );
            Some((text, true))
        } else {
            let fits = search.check_memory(finer(resolution), settings).err();
            fits.map(|error| (error.to_string(), true))
        };
        if let Some((reason, free)) = stop {
            return Ok(search.report(answer, reason, free));
        }
        best = Some(answer);
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
    Resolution {
        elements: (it.elements as f64 * FINER).round() as usize,
        pairs: (it.pairs as f64 * FINER).round() as usize,
        level: it.level + HIGHER,
    }
}

/// An eigenvalue at one resolution, with its algebraic error.
#[derive(Debug, Clone, Copy)]
struct Mode {
    value: C,
    error: f64,
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
}

/// A point near which eigenvalues are sought, and those that are to converge.
struct Place {
    shift: C,
    targets: Vec<C>,
}

struct Search<'a> {
    oscillator: &'a Oscillator,
    count: usize,
    /// Where the continuous spectrum begins; minus infinity without one.
    edge: f64,
    /// Circular frequency of small motions.
    natural: f64,
    tolerance: f64,
}

impl<'a> Search<'a> {
    fn new(oscillator: &'a Oscillator, count: usize, tolerance: f64) -> Result<Self> {
        oscillator.displacement_law()?;
        let contact = oscillator.contact();
        let stiffness = contact.equilibrium().map(|q| contact.stiffness(q));
        let natural = stiffness.filter(|k| *k > 0.0).map_or(1.0, f64::sqrt);
        let edge = oscillator.continuous_from().unwrap_or(f64::NEG_INFINITY);
        Ok(Self {
            oscillator,
            count,
            edge,
            natural,
            tolerance,
        })
    }

    fn operator(&self, resolution: Resolution) -> Result<Hierarchy> {
        Hierarchy::new(self.oscillator, Quantity::Displacement, resolution)
    }

    /// Krylov vectors and factors of the shifts that are worked on at the same time.
    fn memory(&self, resolution: Resolution) -> u64 {
        let vectors = 16 * (self.krylov() * 2 * resolution.pairs * resolution.across()) as u64;
        (resolution.memory() + vectors) * rayon::current_num_threads() as u64
    }

    fn check_memory(&self, resolution: Resolution, settings: &Settings) -> Result<()> {
        let memory = self.memory(resolution);
        if memory <= settings.max_memory {
            return Ok(());
        }
        Err(Error::Limit {
            key: "accuracy.max_memory",
            limit: settings.max_memory.to_string(),
            what: format!("decay rates at the next resolution need {memory} bytes"),
        })
    }

    /// Krylov vectors of a shift.
    fn krylov(&self) -> usize {
        KRYLOV.max(self.count + KRYLOV / 2)
    }

    /// The slowest modes of a list that is sorted by rate: those above the edge, as many as asked for.
    fn slowest<'b>(&self, modes: &'b [Mode], count: usize) -> &'b [Mode] {
        let above = modes.partition_point(|it| it.value.re > self.edge);
        &modes[..above.min(count)]
    }

    /// Modes of a coarse operator, and where finer ones are to look. Shifts lie along the imaginary axis, up to
    /// the first harmonic that has none of the modes asked for, and then where the slowest modes lie far from it.
    fn sweep(&self, full: &Hierarchy) -> Result<(Vec<Mode>, Vec<Place>)> {
        let at = |k: usize| C::new(0.0, APART * self.natural * k as f64);
        let steps = (1.0 / APART) as usize;
        let mut shifts: Vec<C> = (0..=2 * steps).map(at).collect();
        let mut modes = Vec::new();
        self.search(full, &shifts, &mut modes)?;
        let mut harmonic = 2;
        let has = |modes: &[Mode], harmonic: usize| {
            let border = self.natural * (harmonic as f64 - 0.5);
            let wanted = self.slowest(modes, self.count);
            wanted.iter().any(|it| it.value.im > border)
        };
        while harmonic < HARMONICS && has(&modes, harmonic) {
            let more: Vec<C> = (1..=steps).map(|k| at(harmonic * steps + k)).collect();
            self.search(full, &more, &mut modes)?;
            shifts.extend(more);
            harmonic += 1;
        }
        loop {
            let places = self.places(&modes, &shifts);
            let all = places.iter().map(|it| it.shift);
            let more: Vec<C> = all.filter(|it| !shifts.contains(it)).collect();
            if more.is_empty() || shifts.len() > 2 * steps * HARMONICS {
                return Ok((modes, places));
            }
            self.search(full, &more, &mut modes)?;
            shifts.extend(more);
        }
    }

    /// For each mode asked for the nearest shift, or a new one beside it if none is near.
    fn places(&self, modes: &[Mode], shifts: &[C]) -> Vec<Place> {
        // Real modes always have a place.
        let mut places = vec![Place {
            shift: C::default(),
            targets: Vec::new(),
        }];
        let mut shifts = shifts.to_vec();
        // Half as many again: some may turn out not to be eigenvalues of the oscillator.
        for mode in self.slowest(modes, self.count + self.count / 2 + 2) {
            let distance = |shift: &C| (shift - mode.value).norm();
            let all = shifts.iter().copied();
            let nearest = all.min_by(|a, b| distance(a).total_cmp(&distance(b)));
            let near = nearest.filter(|it| distance(it) <= 0.5 * self.natural);
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

    /// Adds the modes near the shifts.
    fn search(&self, full: &Hierarchy, shifts: &[C], modes: &mut Vec<Mode>) -> Result<()> {
        let found: Vec<Result<Vec<Mode>>> = shifts
            .par_iter()
            .map(|shift| {
                let mut arnoldi = Arnoldi::new(full, *shift)?;
                arnoldi.extend(self.krylov())?;
                arnoldi.modes()
            })
            .collect();
        for found in found {
            merge(modes, found?);
        }
        Ok(())
    }

    /// The modes near the places, with as many Krylov vectors as their targets need.
    fn refine(&self, full: &Hierarchy, places: &[Place]) -> Result<Vec<Mode>> {
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
                let mut arnoldi = Arnoldi::new(full, place.shift)?;
                let mut before = f64::INFINITY;
                loop {
                    let grown = arnoldi.extend(self.krylov() / 2)?;
                    let modes = arnoldi.modes()?;
                    let errors = place.targets.iter().map(|it| error(&modes, it));
                    let worst = errors.fold(0.0, f64::max);
                    // Close eigenvalues stay badly known, however many vectors there are.
                    let enough = worst <= SHARE * self.tolerance || worst > 0.5 * before;
                    if enough || !grown || arnoldi.size() >= 3 * self.krylov() {
                        return Ok(modes);
                    }
                    before = worst;
                }
            })
            .collect();
        let mut modes = Vec::new();
        for found in found {
            merge(&mut modes, found?);
        }
        Ok(modes)
    }

    /// What the last three resolutions, the finest last, say of the modes asked for.
    fn judge(&self, levels: &[Vec<Mode>], resolution: Resolution) -> Answer {
        let whole: Vec<Vec<C>> = levels.iter().map(|it| conjugates(it)).collect();
        let [coarse, middle, fine] = [&whole[0], &whole[1], &whole[2]];
        let (to_middle, to_coarse) = (partners(fine, middle), partners(middle, coarse));
        let mut answer = Answer {
            rates: Vec::new(),
            unknown: Vec::new(),
            missing: 0,
            real_missing: false,
            functions: [resolution.across(), 2 * resolution.pairs],
        };
        let mut real = false;
        for mode in self.slowest(&levels[2], usize::MAX) {
            let wanted = answer.rates.len() < self.count || (!real && mode.value.im == 0.0);
            if !wanted {
                continue;
            }
            let place = fine.iter().position(|it| *it == mode.value);
            let before = place.and_then(|k| to_middle[k]);
            let first = before.and_then(|k| to_coarse[k]);
            let rate = before.zip(first).and_then(|(before, first)| {
                let path = [coarse[first], middle[before], mode.value];
                believed(path, mode.error, self.tolerance)
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
        if self.edge == f64::NEG_INFINITY {
            let found = answer.rates.len() + answer.unknown.len();
            answer.missing = self.count.saturating_sub(found);
        }
        let slowest = answer.rates.first().map_or(f64::NEG_INFINITY, |it| it.re);
        answer.real_missing = !real && self.edge < FAR_BELOW * slowest;
        answer
    }

    fn report(&self, answer: Answer, reason: String, free: bool) -> DecayRates {
        let shortage = answer.shortage();
        let number = if let Some(value) = answer.unknown.first() {
            let near = DecayRate {
                re: value.re,
                im: value.im,
                error: 0.0,
            };
            match answer.unknown.len() {
                1 => format!("the eigenvalue near {near}"),
                n => format!("the eigenvalue near {near}, and of {} more,", n - 1),
            }
        } else if answer.real_missing {
            "the slowest real eigenvalue".to_owned()
        } else if answer.missing > 0 {
            format!("eigenvalue {} of {}", answer.rates.len() + 1, self.count)
        } else {
            "a decay rate".to_owned()
        };
        let known = shortage < 1.0;
        let shortfall = (shortage > self.tolerance).then(|| Shortfall {
            number,
            ratio: if known {
                shortage / self.tolerance
            } else {
                f64::INFINITY
            },
            tolerance: self.tolerance,
            free,
            reason,
        });
        DecayRates {
            rates: answer.rates,
            continuous_from: self.oscillator.continuous_from(),
            functions: answer.functions,
            shortfall,
        }
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

/// Arnoldi's process for (shift - L)^{-1}.
struct Arnoldi<'a> {
    inverse: Factored<'a>,
    full: &'a Hierarchy,
    shift: C,
    basis: Vec<Vec<C>>,
    /// Columns of the Hessenberg matrix, one for each solve.
    columns: Vec<Vec<C>>,
}

impl<'a> Arnoldi<'a> {
    fn new(full: &'a Hierarchy, shift: C) -> Result<Self> {
        // A fixed, structureless start: the golden-ratio sequence overlaps with every mode. The constant, the
        // eigenvector of 0, is left out.
        let golden = |k: usize| (k as f64 * 0.618_033_988_749_894_9).fract() - 0.5;
        let mut first: Vec<C> = (0..full.len()).map(|k| C::new(golden(k), 0.0)).collect();
        first[0] = C::default();
        normalise(&mut first);
        Ok(Self {
            inverse: Factored::new(full, shift)?,
            full,
            shift,
            basis: vec![first],
            columns: Vec::new(),
        })
    }

    fn size(&self) -> usize {
        self.columns.len()
    }

    /// Adds at most `steps` vectors; whether the space can still grow.
    fn extend(&mut self, steps: usize) -> Result<bool> {
        for _ in 0..steps {
            if self.basis.len() == self.size() || self.size() + 2 > self.full.len() {
                return Ok(false);
            }
            let mut next = self.inverse.refined(&self.basis[self.size()])?;
            let mut column = vec![C::default(); self.basis.len() + 1];
            // Gram-Schmidt twice is enough (Parlett).
            for _ in 0..2 {
                for (overlap, vector) in column.iter_mut().zip(&self.basis) {
                    let part: C = vector.iter().zip(&next).map(|(b, x)| b.conj() * x).sum();
                    *overlap += part;
                    let both = next.iter_mut().zip(vector);
                    both.for_each(|(x, b)| *x -= part * b);
                }
            }
            let norm = normalise(&mut next);
            column[self.basis.len()] = C::new(norm, 0.0);
            self.columns.push(column);
            if norm > 1e-13 {
                self.basis.push(next);
            }
        }
        Ok(true)
    }

    /// The converged eigenvalues, those of the upper half plane.
    fn modes(&self) -> Result<Vec<Mode>> {
        let size = self.size();
        let entry = |(i, j): (usize, usize)| self.columns[j].get(i).copied().unwrap_or_default();
        let (values, vectors) = eigen(&Array2::from_shape_fn((size, size), entry))?;
        let last = entry((size, size - 1)).norm();
        let mut modes = Vec::new();
        for (theta, part) in values.iter().zip(vectors.columns()) {
            let value = self.shift - theta.inv();
            // The residual over theta: no vector is built for what has not converged.
            let rough = part[size - 1].norm() * last / theta.norm();
            if !value.is_finite() || rough > CONVERGED {
                continue;
            }
            let mut vector = vec![C::default(); self.full.len()];
            for (b, s) in self.basis.iter().zip(part) {
                vector.iter_mut().zip(b).for_each(|(x, b)| *x += b * s);
            }
            let error = algebraic(self.full, value, &vector);
            let nothing = error.max(1e-9 * value.norm());
            if error > value.norm() || value.im < -nothing {
                continue;
            }
            // A real eigenvalue of a real matrix has no imaginary part beyond its error.
            let im = if value.im <= nothing { 0.0 } else { value.im };
            let value = C::new(value.re, im);
            modes.push(Mode { value, error });
        }
        Ok(modes)
    }
}

/// |L x - lambda x| |x| / |J x . x|, J the reversal of v, and rounding.
fn algebraic(full: &Hierarchy, value: C, x: &[C]) -> f64 {
    let part = |of: fn(&C) -> f64| full.apply(&x.iter().map(of).collect::<Vec<_>>());
    let (re, im) = (part(|x| x.re), part(|x| x.im));
    let image = re.iter().zip(&im).map(|(re, im)| C::new(*re, *im));
    let residual: f64 = image.zip(x).map(|(y, x)| (y - value * x).norm_sqr()).sum();
    let norm: f64 = x.iter().map(C::norm_sqr).sum();
    let (even, odd) = x.split_at(full.even());
    let square = |x: &[C]| x.iter().map(|x| x * x).sum::<C>();
    (residual * norm).sqrt() / (square(even) - square(odd)).norm() + ROUNDING * full.size()
}

fn normalise(x: &mut [C]) -> f64 {
    let norm = x.iter().map(C::norm_sqr).sum::<f64>().sqrt();
    if norm > 0.0 {
        for x in x.iter_mut() {
            *x /= norm;
        }
    }
    norm
}

/// What the decay rates take: cells are functions of q and of v, steps the factorisations.
pub fn decay_rates_cost(settings: &Settings) -> (Cost, String) {
    let coarse = first(settings);
    let middle = finer(coarse);
    let fine = finer(middle);
    // Nine shifts at the coarse resolution, two or three at the finer ones; fifty solves take as long as the
    // factorisation.
    let operations = 9.0 * coarse.operations() + 3.0 * (middle.operations() + fine.operations());
    let threads = rayon::current_num_threads() as f64;
    let vectors = 16 * (KRYLOV * 2 * fine.pairs * fine.across()) as u64;
    let cost = Cost {
        cells: [fine.across(), 2 * fine.pairs],
        steps: 15,
        memory: (fine.memory() + vectors) * threads as u64,
        // 1e10 operations a second and processor (measured).
        seconds: 2.0 * operations / 1e10 / threads,
    };
    let method =
        "shift-invert Arnoldi in Hermite functions and spectral elements, three resolutions";
    (cost, method.into())
}
