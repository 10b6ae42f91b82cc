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

use super::choice::{Cost, Settings};
use super::hermite::{DEGREE, Factored, Hierarchy, Resolution};
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
#[derive(Debug, Clone, Copy, PartialEq)]
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
/// resolutions, whose shifts are chosen, need half as many.
const KRYLOV: usize = 50;

/// Rounding of the operator, relative to its largest entries: orthonormal functions under a p_q that falls by many
/// powers of ten (measured at T = 26, where equal eigenvalues of three resolutions differ by it).
const ROUNDING: f64 = 2e-13;

/// Algebraic error, relative to the eigenvalue, beyond which a Ritz value is not converged.
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
    let search = Search::new(oscillator, count)?;
    let mut resolution = first(settings);
    search.check_memory(resolution, settings)?;
    let (coarse, shifts) = search.sweep(&search.operator(resolution)?)?;
    let mut levels = vec![coarse];
    let mut seconds = began.elapsed().as_secs_f64();
    loop {
        let next = finer(resolution);
        let done = levels.len();
        if done >= 3 {
            let answer = search.judge(&levels[done - 3..], settings.tolerance);
            let left = settings.max_seconds - began.elapsed().as_secs_f64();
            seconds *= next.operations() / resolution.operations();
            let stop = if settings.cells.is_some() {
                Some(("its cells are those of the scene".to_owned(), false))
            } else if answer.complete(settings.tolerance) {
                Some((String::new(), true))
            } else if done == RESOLUTIONS {
                Some((format!("{RESOLUTIONS} resolutions did not settle it"), true))
            } else if seconds > left {
                let left = left.max(0.0);
                let text = format!(
                    "a finer resolution would take about {seconds:.1e} s, and {left:.1e} s are left of \
                     accuracy.max_seconds"
                );
                Some((text, true))
            } else {
                let fits = search.check_memory(next, settings).err();
                fits.map(|error| (error.to_string(), true))
            };
            if let Some((reason, free)) = stop {
                return Ok(search.report(answer, resolution, settings.tolerance, reason, free));
            }
        }
        let clock = Instant::now();
        let krylov = search.krylov(KRYLOV / 2);
        levels.push(Search::at(&search.operator(next)?, &shifts, krylov)?);
        seconds = clock.elapsed().as_secs_f64();
        resolution = next;
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
}

impl Answer {
    fn complete(&self, tolerance: f64) -> bool {
        self.unknown.is_empty() && self.worst() <= tolerance
    }

    /// The largest error over the modulus.
    fn worst(&self) -> f64 {
        let relative = |it: &DecayRate| it.error / it.re.hypot(it.im);
        self.rates.iter().map(relative).fold(0.0, f64::max)
    }
}

struct Search<'a> {
    oscillator: &'a Oscillator,
    count: usize,
    /// Where the continuous spectrum begins; minus infinity without one.
    edge: f64,
    /// Circular frequency of small motions.
    natural: f64,
}

impl<'a> Search<'a> {
    fn new(oscillator: &'a Oscillator, count: usize) -> Result<Self> {
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
        })
    }

    fn operator(&self, resolution: Resolution) -> Result<Hierarchy> {
        Hierarchy::new(self.oscillator, Quantity::Displacement, resolution)
    }

    /// Krylov vectors and factors of the shifts that are worked on at the same time.
    fn memory(&self, resolution: Resolution) -> u64 {
        let vectors =
            16 * (self.krylov(KRYLOV) * 2 * resolution.pairs * resolution.across()) as u64;
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

    /// Krylov vectors: `least`, more for many rates.
    fn krylov(&self, least: usize) -> usize {
        least.max(self.count + KRYLOV / 2)
    }

    /// The slowest modes of a list that is sorted by rate: those above the edge, as many as asked for.
    fn slowest<'b>(&self, modes: &'b [Mode], count: usize) -> &'b [Mode] {
        let above = modes.partition_point(|it| it.value.re > self.edge);
        &modes[..above.min(count)]
    }

    /// Modes of a coarse operator, found from shifts all along the imaginary axis, and the shifts that the
    /// slowest lie nearest to. The search ends with the first harmonic that has none of those asked for.
    fn sweep(&self, full: &Hierarchy) -> Result<(Vec<Mode>, Vec<C>)> {
        let at = |k: usize| C::new(0.0, APART * self.natural * k as f64);
        let steps = (1.0 / APART) as usize;
        let mut shifts: Vec<C> = (0..=2 * steps).map(at).collect();
        let mut modes = Self::at(full, &shifts, self.krylov(KRYLOV))?;
        let mut harmonic = 2;
        let has = |modes: &[Mode], harmonic: usize| {
            let border = self.natural * (harmonic as f64 - 0.5);
            let wanted = self.slowest(modes, self.count);
            wanted.iter().any(|it| it.value.im > border)
        };
        while harmonic < HARMONICS && has(&modes, harmonic) {
            let more: Vec<C> = (1..=steps).map(|k| at(harmonic * steps + k)).collect();
            merge(&mut modes, Self::at(full, &more, self.krylov(KRYLOV))?);
            shifts.extend(more);
            harmonic += 1;
        }
        // Half as many again: some may turn out not to be eigenvalues of the oscillator.
        let wanted = self.slowest(&modes, self.count + self.count / 2 + 2);
        let nearest = |mode: &Mode| {
            let distance = |shift: &C| (shift - mode.value).norm();
            let all = shifts.iter().copied();
            all.min_by(|a, b| distance(a).total_cmp(&distance(b)))
        };
        let mut places: Vec<C> = wanted.iter().filter_map(nearest).collect();
        // Real modes always have a place.
        places.push(C::default());
        places.sort_by(|a, b| a.im.total_cmp(&b.im));
        places.dedup();
        Ok((modes, places))
    }

    /// Modes near the shifts, the slowest first.
    fn at(full: &Hierarchy, shifts: &[C], krylov: usize) -> Result<Vec<Mode>> {
        let found: Vec<Result<Vec<Mode>>> = shifts
            .par_iter()
            .map(|shift| near(full, *shift, krylov))
            .collect();
        let mut modes = Vec::new();
        for found in found {
            merge(&mut modes, found?);
        }
        Ok(modes)
    }

    /// What the last three resolutions, the finest last, say of the modes asked for.
    fn judge(&self, levels: &[Vec<Mode>], tolerance: f64) -> Answer {
        let whole: Vec<Vec<C>> = levels.iter().map(|it| conjugates(it)).collect();
        let [coarse, middle, fine] = [&whole[0], &whole[1], &whole[2]];
        let (to_middle, to_coarse) = (partners(fine, middle), partners(middle, coarse));
        let mut answer = Answer {
            rates: Vec::new(),
            unknown: Vec::new(),
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
        answer
    }

    fn report(
        &self,
        answer: Answer,
        resolution: Resolution,
        tolerance: f64,
        reason: String,
        free: bool,
    ) -> DecayRates {
        let short = |number: String, ratio: f64| Shortfall {
            number,
            ratio,
            tolerance,
            free,
            reason: reason.clone(),
        };
        let worst = answer.worst();
        let shortfall = if let Some(value) = answer.unknown.first() {
            let near = DecayRate {
                re: value.re,
                im: value.im,
                error: 0.0,
            };
            let more = match answer.unknown.len() - 1 {
                0 => String::new(),
                n => format!(" and {n} more"),
            };
            Some(short(
                format!("the eigenvalue near {near}{more}"),
                f64::INFINITY,
            ))
        } else if answer.rates.len() < self.count && self.edge == f64::NEG_INFINITY {
            let name = format!("eigenvalue {} of {}", answer.rates.len() + 1, self.count);
            Some(short(name, f64::INFINITY))
        } else {
            (worst > tolerance).then(|| short("a decay rate".to_owned(), worst / tolerance))
        };
        DecayRates {
            rates: answer.rates,
            continuous_from: self.oscillator.continuous_from(),
            functions: [resolution.across(), 2 * resolution.pairs],
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

/// Converged eigenvalues nearest to a shift, those of the upper half plane, by Arnoldi on (shift - L)^{-1}.
fn near(full: &Hierarchy, shift: C, krylov: usize) -> Result<Vec<Mode>> {
    let inverse = Factored::new(full, shift)?;
    let n = full.len();
    let steps = krylov.min(n - 2);
    let mut basis: Vec<Vec<C>> = Vec::with_capacity(steps + 1);
    let mut hessenberg = Array2::<C>::zeros((steps + 1, steps));
    // A fixed, structureless start: the golden-ratio sequence overlaps with every mode. The constant, the
    // eigenvector of 0, is left out.
    let start = (0..n).map(|k| C::new((k as f64 * 0.618_033_988_749_894_9).fract() - 0.5, 0.0));
    let mut first: Vec<C> = start.collect();
    first[0] = C::default();
    normalise(&mut first);
    basis.push(first);
    let mut size = steps;
    for k in 0..steps {
        let mut next = inverse.solve(&basis[k])?;
        // Gram-Schmidt twice is enough (Parlett).
        for _ in 0..2 {
            for (j, vector) in basis.iter().enumerate() {
                let overlap: C = vector.iter().zip(&next).map(|(b, x)| b.conj() * x).sum();
                hessenberg[[j, k]] += overlap;
                let parts = next.iter_mut().zip(vector);
                parts.for_each(|(x, b)| *x -= overlap * b);
            }
        }
        let norm = normalise(&mut next);
        hessenberg[[k + 1, k]] = C::new(norm, 0.0);
        if norm < 1e-13 {
            size = k + 1;
            break;
        }
        basis.push(next);
    }
    let square = Array2::from_shape_fn((size, size), |place| hessenberg[place]);
    let (values, vectors) = eigen(&square)?;
    let last = hessenberg[[size, size - 1]].norm();
    let mut modes = Vec::new();
    for (k, theta) in values.iter().enumerate() {
        let value = shift - theta.inv();
        let part = vectors.column(k);
        // The residual of theta, carried over to the eigenvalue: no vector is built for what is far from it.
        let rough = part[size - 1].norm() * last / theta.norm();
        if !value.is_finite() || rough > CONVERGED {
            continue;
        }
        let mut vector = vec![C::default(); n];
        for (b, s) in basis.iter().zip(part) {
            vector.iter_mut().zip(b).for_each(|(x, b)| *x += b * s);
        }
        let error = algebraic(full, value, &vector);
        if error > CONVERGED * value.norm() || value.im < -error.max(1e-9 * value.norm()) {
            continue;
        }
        // A real eigenvalue of a real matrix has no imaginary part beyond its error.
        let real = value.im <= error.max(1e-9 * value.norm());
        let im = if real { 0.0 } else { value.im };
        let value = C::new(value.re, im);
        modes.push(Mode { value, error });
    }
    Ok(modes)
}

/// |L x - lambda x| |x| / |J x . x|, J the reversal of v, with what rounding leaves of L.
fn algebraic(full: &Hierarchy, value: C, x: &[C]) -> f64 {
    let part = |of: fn(&C) -> f64| full.apply(&x.iter().map(of).collect::<Vec<_>>());
    let (re, im) = (part(|x| x.re), part(|x| x.im));
    let image = re.iter().zip(&im).map(|(re, im)| C::new(*re, *im));
    let residual: f64 = image.zip(x).map(|(y, x)| (y - value * x).norm_sqr()).sum();
    let norm: f64 = x.iter().map(C::norm_sqr).sum();
    let rounding = ROUNDING * full.size() * norm.sqrt();
    let (even, odd) = x.split_at(full.even());
    let square = |x: &[C]| x.iter().map(|x| x * x).sum::<C>();
    (residual.sqrt() + rounding) * norm.sqrt() / (square(even) - square(odd)).norm()
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
pub fn cost(settings: &Settings) -> (Cost, String) {
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
