//! The slowest modes: eigenvalues of the generator nearest to the imaginary axis.

use super::budget::{self, Cost, Factors, timing};
use super::flux::Drift;
use super::generator::Generator;
use super::layout::Layout;
use super::settings::Settings;
use crate::error::Result;
use crate::estimate::Shortfall;
use crate::oscillator::Oscillator;
use crate::sparse::{self, Lu, eigen};
use ndarray::Array2;
use num_complex::Complex;
use rayon::prelude::*;
use sprs::CsMat;
use std::time::Instant;

type C = Complex<f64>;

/// An eigenvalue of the generator: a mode decays as e^{re t} and turns at the circular frequency im.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecayRate {
    /// Real part, negative.
    pub re: f64,
    /// Imaginary part; complex modes come in conjugate pairs, both listed.
    pub im: f64,
    /// Error of |re + i im|: |residual| / |left . right| plus, where two meshes were compared, their
    /// difference.
    pub error: f64,
}

/// Krylov vectors per shift: the nearest dozen eigenvalues converge to rounding.
const KRYLOV: usize = 60;

/// Modes with a larger part of their norm in the rim are of the box, not of the oscillator.
const RIM: f64 = 0.01;

/// Neglected probability of the first mesh of [`decay_rates`], and by how much each finer one divides it:
/// slow modes weigh the tail, so their box is wider than that of a moment, and a mode of the box moves
/// with it.
const OUTSIDE: f64 = 1e-8;
const WIDER: f64 = 100.0;

/// A box beyond this leaves nothing but rounding in its rim.
const WIDEST: f64 = 1e-12;

/// Cells of each mesh of [`decay_rates`] over those of the one before.
const FINER: f64 = 1.25;

/// Meshes after the first two: each costs about twice the one before, and four are 2.4 times as fine.
const REFINEMENTS: usize = 4;

/// Decay rates with what the tolerance asked for and was not reached.
#[derive(Debug, Clone, PartialEq)]
pub struct DecayRates {
    /// The slowest first.
    pub rates: Vec<DecayRate>,
    /// Cells in q and v of the finest mesh.
    pub cells: [usize; 2],
    /// What is missing.
    pub shortfall: Option<Shortfall>,
}

/// What [`decay_rates`] will take.
///
/// # Errors
/// Those of the mesh.
pub fn decay_rates_cost(oscillator: &Oscillator, settings: &Settings) -> Result<(Cost, String)> {
    let drift = settings.drift.unwrap_or(Drift::Order8);
    let layout = Layout::stationary(oscillator, drift, settings)?;
    let cells = layout.count_within(oscillator, 1.0, Factors::None, settings.max_memory)?;
    let n = cells[0] as f64 * cells[1] as f64;
    let wide = if drift == Drift::Upwind {
        1.0
    } else {
        timing::WIDE
    };
    // Of the second mesh.
    let finer = cells.map(|n| (n as f64 * FINER) as usize);
    let cost = Cost {
        cells,
        steps: 6,
        memory: budget::memory(finer, drift, Factors::Shifts),
        seconds: 3.0 * n * 6.0 * wide * timing::LU,
    };
    let words = format!(
        "finite volumes, {}; shift and invert on two meshes or more",
        drift.name()
    );
    Ok((cost, words))
}

/// The modes of one mesh.
struct Level {
    modes: Vec<DecayRate>,
    cells: [usize; 2],
    seconds: f64,
}

/// The `count` slowest decay rates of an oscillator with a stationary law, from meshes in growing boxes:
/// only modes found in the last two are given, with their difference in the error. Where the cells are
/// left open they are refined until every error is within the tolerance times |rate|.
///
/// The first mesh is searched near zero and near i and 2i; the finer ones only where a wanted mode was.
///
/// # Errors
/// [`crate::Error::NoStationaryLaw`] for a contact without one; those of [`slowest`] on the first two
/// meshes.
#[expect(clippy::too_many_lines, reason = "one loop over one state")]
pub fn decay_rates(
    oscillator: &Oscillator,
    count: usize,
    settings: &Settings,
) -> Result<DecayRates> {
    let began = Instant::now();
    oscillator.displacement_law()?;
    let drift = settings.drift.unwrap_or(Drift::Order8);
    let free = settings.cells.is_none();
    // Zero itself is an eigenvalue; the others lie at zeta and beyond, near multiples of i.
    let slow = 1e-2 * oscillator.zeta().min(1.0 / oscillator.zeta());
    let all = [C::new(slow, 0.0), C::new(0.0, 1.0), C::new(0.0, 2.0)];
    let usual = cells(oscillator, drift, settings.tolerance)?;
    let solve = |k: i32, shifts: &[C]| -> Result<Level> {
        let began = Instant::now();
        let boxed = Settings {
            cells: settings.cells.or(Some(usual)),
            neglected: Some((OUTSIDE * WIDER.powi(-k)).max(WIDEST)),
            ..settings.clone()
        };
        // The scene's own cells are those of the finer of two meshes.
        let finer = FINER.powi(if free { k } else { k - 1 });
        let layout = Layout::stationary(oscillator, drift, &boxed)?;
        let mesh = layout.mesh_within(oscillator, finer, Factors::Shifts, settings.max_memory)?;
        let generator = Generator::new(oscillator, &mesh, drift)?;
        let found: Vec<Result<Vec<DecayRate>>> = shifts
            .par_iter()
            .map(|shift| slowest(&generator, &[*shift], usize::MAX))
            .collect();
        let mut modes = Vec::new();
        for found in found {
            merge(&mut modes, found?);
        }
        modes.sort_by(|a, b| b.re.total_cmp(&a.re).then(b.im.total_cmp(&a.im)));
        Ok(Level {
            modes,
            cells: mesh.cells(),
            seconds: began.elapsed().as_secs_f64(),
        })
    };
    let mut coarse = solve(0, &all)?;
    // Half as many again: some may turn out to be of the box.
    let wanted = coarse.modes.iter().take(count + count / 2 + 2);
    let nearest = |mode: &DecayRate| {
        let distance = |shift: &C| (shift - C::new(mode.re, mode.im.abs())).norm();
        (0..all.len()).min_by(|a, b| distance(&all[*a]).total_cmp(&distance(&all[*b])))
    };
    let places: Vec<usize> = wanted.filter_map(nearest).collect();
    // Nothing found yet: everywhere again.
    let shifts: Vec<C> = (0..all.len())
        .filter(|k| places.is_empty() || places.contains(k))
        .map(|k| all[k])
        .collect();
    let mut fine = solve(1, &shifts)?;
    let tolerance = settings.tolerance;
    let mut why = ("cells are those of the scene".to_string(), false);
    for k in 2.. {
        let (rates, worst) = believed(&fine.modes, &coarse.modes, count);
        if (worst <= tolerance && rates.len() == count) || !free {
            break;
        }
        // A factorisation of a mesh n by n takes n^3 to n^4.
        let next = fine.seconds * FINER.powi(4);
        let left = settings.max_seconds - began.elapsed().as_secs_f64();
        let [q, v] = fine.cells.map(|n| (n as f64 * FINER) as usize);
        if k as usize >= 2 + REFINEMENTS {
            why = ("that many finer meshes did not help".into(), true);
            break;
        }
        if next > left {
            let text = format!(
                "a finer mesh would take about {next:.1e} s, and {:.1e} s are left of \
                 accuracy.max_seconds",
                left.max(0.0)
            );
            why = (text, true);
            break;
        }
        if budget::memory([q, v], drift, Factors::Shifts) > settings.max_memory {
            let text = format!("{q} x {v} cells do not fit accuracy.max_memory");
            why = (text, true);
            break;
        }
        match solve(k, &shifts) {
            Ok(finer) => coarse = std::mem::replace(&mut fine, finer),
            Err(error) => {
                why = (format!("a finer mesh failed: {error}"), true);
                break;
            }
        }
    }
    let (rates, worst) = believed(&fine.modes, &coarse.modes, count);
    let missing = rates.len() < count;
    let shortfall = (missing || worst > tolerance).then(|| Shortfall {
        number: if missing {
            format!(
                "decay rate {} of {count}, not seen alike on two meshes,",
                rates.len() + 1
            )
        } else {
            "a decay rate".into()
        },
        ratio: if missing {
            f64::INFINITY
        } else {
            worst / tolerance
        },
        tolerance,
        free: why.1,
        reason: why.0,
    });
    Ok(DecayRates {
        rates,
        cells: fine.cells,
        shortfall,
    })
}

/// The slowest modes that two meshes share, each with their difference in its error, and the largest
/// error over |rate|.
fn believed(fine: &[DecayRate], coarse: &[DecayRate], count: usize) -> (Vec<DecayRate>, f64) {
    let distance = |a: &DecayRate, b: &DecayRate| (a.re - b.re).hypot(a.im - b.im);
    let size = |mode: &DecayRate| mode.re.hypot(mode.im);
    let mut both: Vec<DecayRate> = fine
        .iter()
        .filter_map(|mode| {
            let nearest = coarse
                .iter()
                .map(|other| distance(mode, other))
                .fold(f64::INFINITY, f64::min);
            // Believed only if the other mesh knows it, to half a percent: modes of the box move.
            let believed = nearest < 5e-3 * size(mode);
            believed.then_some(DecayRate {
                error: mode.error + nearest,
                ..*mode
            })
        })
        .collect();
    both.sort_by(|a, b| b.re.total_cmp(&a.re).then(b.im.total_cmp(&a.im)));
    both.truncate(count);
    let worst = both.iter().map(|mode| mode.error / size(mode));
    let worst = worst.fold(0.0, f64::max);
    (both, worst)
}

/// Cells of the first mesh for the modes: at 1e-3 about four per thermal deviation, in the box of a
/// moment at 1e-3 stretched to that of the modes.
fn cells(oscillator: &Oscillator, drift: Drift, tolerance: f64) -> Result<[usize; 2]> {
    let settings = Settings {
        tolerance: tolerance.clamp(1e-6, 1e-2),
        neglected: Some(OUTSIDE),
        ..Settings::default()
    };
    let [q, v] = Layout::stationary(oscillator, drift, &settings)?.count(oscillator, 0.8)?;
    Ok([q, v + v % 2])
}

/// Adds modes that are not in the list yet.
fn merge(list: &mut Vec<DecayRate>, more: Vec<DecayRate>) {
    for mode in more {
        let same = |other: &DecayRate| {
            let size = mode.re.hypot(mode.im);
            (mode.re - other.re).hypot(mode.im - other.im) < 1e-6 * size + mode.error + other.error
        };
        if !list.iter().any(same) {
            list.push(mode);
        }
    }
}

/// The eigenvalues near the given shifts (points of the upper half plane), rim modes and the zero left
/// out, the slowest first, conjugates included, at most `count`.
///
/// Shift-invert Arnoldi with one complex LU per shift on the symmetrised generator, whose left
/// eigenvectors are the right ones with v reversed.
///
/// # Errors
/// [`crate::Error::Linear`] if a shift hits an eigenvalue or the projected problem fails.
pub fn slowest(generator: &Generator, shifts: &[C], count: usize) -> Result<Vec<DecayRate>> {
    let matrix = generator.symmetrised();
    let mirror = mirror(generator);
    let rim = generator.rim();
    let mut found: Vec<DecayRate> = Vec::new();
    for shift in shifts {
        for (value, vector) in near(&matrix, *shift)? {
            let norm: f64 = vector.iter().map(C::norm_sqr).sum();
            let outside: f64 = vector
                .iter()
                .zip(&rim)
                .filter(|(_, r)| **r)
                .map(|(x, _)| x.norm_sqr())
                .sum();
            if outside > RIM * norm || value.norm() < 1e-9 || value.re > 1e-9 {
                continue;
            }
            let overlap: C = vector
                .iter()
                .zip(&mirror)
                .map(|(x, k)| x * vector[*k])
                .sum();
            let residual = residual(&matrix, value, &vector);
            let error = residual * norm / overlap.norm();
            let near = |other: &DecayRate| {
                (C::new(other.re, other.im.abs()) - C::new(value.re, value.im.abs())).norm()
            };
            // The same mode from two shifts, or an unconverged Ritz value.
            if error < 1e-3 * value.norm()
                && !found
                    .iter()
                    .any(|f| near(f) < 1e-6 * value.norm() + f.error)
            {
                found.push(DecayRate {
                    re: value.re,
                    im: value.im.abs(),
                    error,
                });
            }
        }
    }
    found.sort_by(|a, b| b.re.total_cmp(&a.re));
    let conjugates = found.into_iter().flat_map(|mode| {
        let DecayRate { re, im, error } = mode;
        // A real eigenvalue of a real matrix has no imaginary part beyond its error.
        if im <= error.max(1e-9) {
            vec![DecayRate { re, im: 0.0, error }]
        } else {
            vec![mode, DecayRate { re, im: -im, error }]
        }
    });
    Ok(conjugates.take(count).collect())
}

/// |A x - lambda x|/|x|.
fn residual(matrix: &CsMat<f64>, value: C, vector: &[C]) -> f64 {
    let mut image: Vec<C> = vector.iter().map(|x| -value * x).collect();
    for (column, entries) in matrix.outer_iterator().enumerate() {
        for (row, a) in entries.iter() {
            image[row] += vector[column] * *a;
        }
    }
    let size = |x: &[C]| x.iter().map(C::norm_sqr).sum::<f64>().sqrt();
    size(&image) / size(vector)
}

/// Eigenpairs of the matrix nearest to a shift, by Arnoldi on (A - shift)^{-1}.
fn near(matrix: &CsMat<f64>, shift: C) -> Result<Vec<(C, Vec<C>)>> {
    let mut shifted = matrix.map(|a| C::new(*a, 0.0));
    sparse::shift(&mut shifted, -shift);
    let mut lu = Lu::factor(shifted)?;
    let n = matrix.cols();
    let steps = KRYLOV.min(n - 1);
    let mut basis: Vec<Vec<C>> = Vec::with_capacity(steps + 1);
    let mut hessenberg = Array2::<C>::zeros((steps + 1, steps));
    // A fixed, structureless start: the golden-ratio sequence overlaps with every mode.
    let start = (0..n).map(|k| C::new((k as f64 * 0.618_033_988_749_894_9).fract() - 0.5, 0.0));
    let mut first: Vec<C> = start.collect();
    normalise(&mut first);
    basis.push(first);
    let mut size = steps;
    for k in 0..steps {
        let mut next = basis[k].clone();
        lu.solve(&mut next)?;
        // Gram-Schmidt twice is enough (Parlett).
        for _ in 0..2 {
            for (j, vector) in basis.iter().enumerate() {
                let overlap: C = vector.iter().zip(&next).map(|(b, x)| b.conj() * x).sum();
                hessenberg[[j, k]] += overlap;
                next.iter_mut()
                    .zip(vector)
                    .for_each(|(x, b)| *x -= overlap * b);
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
    let pairs = values.iter().enumerate().map(|(k, theta)| {
        let mut vector = vec![C::default(); n];
        for (b, s) in basis.iter().zip(vectors.column(k)) {
            vector.iter_mut().zip(b).for_each(|(x, b)| *x += b * s);
        }
        (shift + theta.inv(), vector)
    });
    Ok(pairs.collect())
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

/// The unknown at (q, -v) of each unknown.
fn mirror(generator: &Generator) -> Vec<usize> {
    let number = generator.numbering();
    let [nq, nv] = generator.mesh().cells();
    let mut mirror = vec![0; generator.unknowns()];
    for i in 0..nq {
        for j in generator.active(i) {
            let other = number[i * nv + nv - 1 - j];
            // Active columns are symmetric in v for a symmetric axis; fall back on the cell itself.
            let here = number[i * nv + j];
            mirror[here] = if other == usize::MAX { here } else { other };
        }
    }
    mirror
}
