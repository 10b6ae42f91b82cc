//! Eigenvalues of a finite-volume generator by shift-invert Arnoldi with a sparse LU: a second method,
//! on meshes, for the decay rates that the library takes from Hermite functions and spectral elements.

use ndarray::Array2;
use num_complex::Complex;
use sprs::CsMat;
use vibroimpact::error::Result;
use vibroimpact::fokker_planck::{DecayRate, Generator};
use vibroimpact::sparse::{Lu, eigen};

type C = Complex<f64>;

/// Krylov vectors per shift: the nearest dozen eigenvalues converge to rounding.
const KRYLOV: usize = 60;

/// Modes with a larger part of their norm in the inactive boundary cells are of the domain, not of the
/// oscillator.
const BOUNDARY_SHARE: f64 = 0.01;

/// The eigenvalues near the given shifts (points of the upper half plane), modes of the boundary cells and the zero
/// left out, the slowest first, each complex pair once, at most `count`.
///
/// Shift-invert Arnoldi with one complex LU per shift on the symmetrised generator, whose left
/// eigenvectors are the right ones with v reversed.
///
pub(crate) fn slowest(generator: &Generator, shifts: &[C], count: usize) -> Result<Vec<DecayRate>> {
    let matrix = generator.symmetrised();
    let mirror = mirror(generator);
    let boundary = generator.boundary_cells();
    let mut found: Vec<DecayRate> = Vec::new();
    for shift in shifts {
        for (value, vector) in near(&matrix, *shift)? {
            let norm: f64 = vector.iter().map(C::norm_sqr).sum();
            let outside: f64 = vector
                .iter()
                .zip(&boundary)
                .filter(|(_, r)| **r)
                .map(|(x, _)| x.norm_sqr())
                .sum();
            if outside > BOUNDARY_SHARE * norm || value.norm() < 1e-9 || value.re > 1e-9 {
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
    for mode in &mut found {
        // A real eigenvalue of a real matrix has no imaginary part beyond its error.
        if mode.im <= mode.error.max(1e-9) {
            mode.im = 0.0;
        }
    }
    found.truncate(count);
    Ok(found)
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
    for (column, mut entries) in shifted.outer_iterator_mut().enumerate() {
        if let Some(diagonal) = entries.get_mut(column) {
            *diagonal -= shift;
        }
    }
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
