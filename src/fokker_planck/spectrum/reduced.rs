//! A small model of the resolvent of the generator, good at all frequencies at once: rational Krylov.
//!
//! The states (i omega_k - L)^{-1} b at a few frequencies, orthonormalised, span a space on which L is
//! projected (Galerkin, so the model is as dissipative as L). With c the model's solution and r its
//! residual, the spectrum follows from
//!
//! ```text
//! b.x = b.V c + (J V c).r + (J e).r,   x = (i omega - L)^{-1} b,  e = x - V c
//! ```
//!
//! v -> -v, J, turns L into its transpose, so J V c solves the adjoint equation too: the second term
//! doubles the digits, and the third bounds what is left by |r|^2 |(i omega - L)^{-1}|.

use crate::error::Result;
use crate::fokker_planck::hermite::{Factored, Hierarchy};
use crate::matrix::exponential;
use crate::sparse::eigenvalues;
use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis, Slice, concatenate};
use num_complex::Complex;
use rayon::prelude::*;

type C = Complex<f64>;

/// Solves a round, and the part of those before it that they may be: enough to keep a few processors busy, few enough
/// to place them well.
const ROUND: usize = 4;
const GROWTH: f64 = 0.3;

/// Frequencies answered together.
const TOGETHER: usize = 16;

/// Frequencies a model begins with.
const FIRST: usize = 8;

/// States of a frequency: (i omega - L)^{-1} b, (i omega - L)^{-2} b, ... A solve takes a small part of the factorisation.
pub(super) const POWERS: usize = 3;

/// A part of a new state beyond this, relative to it, is rounding.
const NEW: f64 = 1e-9;

/// The projected generator.
#[derive(Debug, Clone)]
pub(super) struct Reduced {
    /// L on the basis, upper Hessenberg; its first vector is b/|b|.
    matrix: Array2<f64>,
    /// |b|^2: the variance.
    pub(super) variance: f64,
    /// R^T R of the residuals R = L V - V H.
    gram: Array2<f64>,
    /// (J V)^T R.
    dual: Array2<f64>,
    /// Slowest rate of decay of the model.
    slowest: f64,
    /// Frequencies solved for.
    pub(super) solved: Vec<f64>,
}

/// Re b.(i omega - L)^{-1} b with a bound on its error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Answer {
    pub(super) value: f64,
    pub(super) error: f64,
}

/// Builds a [`Reduced`] until it is good.
struct Builder<'a> {
    full: &'a Hierarchy,
    /// Orthonormal rows.
    basis: Array2<f64>,
    /// What of L times each row the rows do not span.
    residuals: Array2<f64>,
    /// Products of the rows with L times the rows.
    matrix: Array2<f64>,
    solved: Vec<f64>,
}

impl Reduced {
    /// The model of `full` whose error is at most `tolerance`, relative to the larger of the value and
    /// `floor` of its peak, at every one of the ascending `omegas`; or as near as `most` solves get. It begins with the
    /// frequencies `first`.
    pub(super) fn new(
        full: &Hierarchy,
        omegas: &[f64],
        tolerance: f64,
        floor: f64,
        (first, most): (&[f64], usize),
        go_on: &(dyn Fn(usize) -> Result<()> + Sync),
    ) -> Result<Self> {
        let mut builder = Builder::new(full);
        let mut wanted = first.to_vec();
        if wanted.is_empty() {
            // A few frequencies spread over what is asked; the model shows where more are needed.
            let first = FIRST.min(omegas.len());
            let spread = |k: usize| omegas[k * (omegas.len() - 1) / (first - 1).max(1)];
            wanted = (0..first).map(spread).collect();
            wanted.dedup();
        }
        loop {
            builder.solve(&wanted, go_on)?;
            let model = builder.model()?;
            let answers = model.all(omegas);
            let peak = answers.iter().map(|it| it.value).fold(0.0, f64::max);
            let scale = |it: &Answer| it.value.abs().max(floor * peak);
            let excess: Vec<f64> = answers.iter().map(|it| it.error / scale(it)).collect();
            if builder.solved.len() >= most {
                return Ok(model);
            }
            wanted = worst(omegas, &excess, tolerance, &builder.solved);
            if wanted.is_empty() {
                return Ok(model);
            }
        }
    }

    pub(super) fn dimension(&self) -> usize {
        self.matrix.nrows()
    }

    pub(super) fn at(&self, omega: f64) -> Answer {
        self.part(&[omega])[0]
    }

    /// The answers at many frequencies, on all threads.
    pub(super) fn all(&self, omegas: &[f64]) -> Vec<Answer> {
        let parts = omegas.par_chunks(TOGETHER);
        parts.flat_map_iter(|part| self.part(part)).collect()
    }

    /// The answers at some frequencies: their bilinear forms are matrix products.
    fn part(&self, omegas: &[f64]) -> Vec<Answer> {
        let m = self.dimension();
        // Real parts, and below them the imaginary ones.
        let mut c = Array2::<f64>::zeros((2 * omegas.len(), m));
        for (k, omega) in omegas.iter().enumerate() {
            for (i, x) in self.solve(C::new(0.0, *omega)).into_iter().enumerate() {
                (c[[2 * k, i]], c[[2 * k + 1, i]]) = (x.re, x.im);
            }
        }
        let [gram, dual] = [&self.gram, &self.dual].map(|matrix| c.dot(&matrix.t()));
        let size = self.variance.sqrt();
        let answer = |k: usize| {
            let (re, im) = (c.row(2 * k), c.row(2 * k + 1));
            let correction = re.dot(&dual.row(2 * k)) - im.dot(&dual.row(2 * k + 1));
            let residual = re.dot(&gram.row(2 * k)) + im.dot(&gram.row(2 * k + 1));
            Answer {
                value: size * c[[2 * k, 0]] + correction,
                error: residual.max(0.0) / self.slowest
                    + 1e-13 * size * c[[2 * k, 0]].hypot(c[[2 * k + 1, 0]]),
            }
        };
        (0..omegas.len()).map(answer).collect()
    }

    /// (shift - H)^{-1} |b| e_1, H upper Hessenberg: elimination with row exchanges.
    fn solve(&self, shift: C) -> Vec<C> {
        let m = self.dimension();
        let row = |k: usize| {
            let mut row: Vec<C> = self.matrix.row(k).iter().map(|x| C::new(-x, 0.0)).collect();
            row[k] += shift;
            row
        };
        let mut x = vec![C::default(); m];
        x[0] = C::new(self.variance.sqrt(), 0.0);
        // Rows of the triangle that elimination leaves, and the one that is next.
        let mut above: Vec<Vec<C>> = Vec::with_capacity(m);
        let mut here = row(0);
        for k in 1..m {
            let mut below = row(k);
            if below[k - 1].norm_sqr() > here[k - 1].norm_sqr() {
                std::mem::swap(&mut here, &mut below);
                x.swap(k - 1, k);
            }
            let factor = below[k - 1] / here[k - 1];
            for (b, a) in below[k..].iter_mut().zip(&here[k..]) {
                *b -= factor * a;
            }
            let carried = factor * x[k - 1];
            x[k] -= carried;
            above.push(std::mem::replace(&mut here, below));
        }
        above.push(here);
        for k in (0..m).rev() {
            let (x, solved) = x.split_at_mut(k + 1);
            let known: C = above[k][k + 1..]
                .iter()
                .zip(solved)
                .map(|(a, x)| a * *x)
                .sum();
            x[k] = (x[k] - known) / above[k][k];
        }
        x
    }

    /// The correlation function b.e^{L t} b at the times 0, step, 2 step, ...
    pub(super) fn correlation(&self, step: f64, count: usize) -> Vec<f64> {
        let over = exponential(&self.matrix, step);
        let mut x = Array1::<f64>::zeros(self.dimension());
        x[0] = self.variance;
        let mut values = Vec::with_capacity(count);
        for _ in 0..count {
            values.push(x[0]);
            x = over.dot(&x);
        }
        values
    }
}

impl<'a> Builder<'a> {
    /// Starts with b, L b and L L b, which hold the correlation function at short times.
    fn new(full: &'a Hierarchy) -> Self {
        let mut it = Self {
            full,
            basis: Array2::zeros((0, full.len())),
            residuals: Array2::zeros((0, full.len())),
            matrix: Array2::zeros((0, 0)),
            solved: Vec::new(),
        };
        let start = full.start();
        let once = full.apply(&start);
        let twice = full.apply(&once);
        it.add(vec![start, once, twice]);
        it
    }

    fn solve(
        &mut self,
        omegas: &[f64],
        go_on: &(dyn Fn(usize) -> Result<()> + Sync),
    ) -> Result<()> {
        let late = || go_on(self.solved.len());
        let start: Vec<C> = self.full.start().into_iter().map(C::from).collect();
        let states: Vec<Result<Vec<Vec<f64>>>> = omegas
            .par_iter()
            .map(|w| {
                let inverse = Factored::new(self.full, C::new(0.0, *w), &late)?;
                let mut states = Vec::new();
                let mut state = start.clone();
                for _ in 0..POWERS {
                    state = inverse.solve(&state)?;
                    let size = state.iter().map(C::norm_sqr).sum::<f64>().sqrt();
                    for x in &mut state {
                        *x /= size;
                    }
                    states.push(state.iter().map(|x| x.re).collect());
                    states.push(state.iter().map(|x| x.im).collect());
                }
                Ok(states)
            })
            .collect();
        let mut new = Vec::new();
        for states in states {
            new.extend(states?);
        }
        self.add(new);
        self.solved.extend(omegas);
        Ok(())
    }

    /// Adds what is new of some vectors: Gram and Schmidt, twice, first against all rows that are there.
    fn add(&mut self, vectors: Vec<Vec<f64>>) {
        let len = self.full.len();
        let sizes: Vec<f64> = vectors.iter().map(|x| norm(x)).collect();
        let mut new = rows(&vectors, len);
        drop(vectors);
        for _ in 0..2 {
            new -= &new.dot(&self.basis.t()).dot(&self.basis);
        }
        let mut kept: Vec<Array1<f64>> = Vec::new();
        for (mut x, size) in new.rows().into_iter().map(|x| x.to_owned()).zip(sizes) {
            for _ in 0..2 {
                for b in &kept {
                    let overlap = b.dot(&x);
                    x.scaled_add(-overlap, b);
                }
            }
            let left = x.dot(&x).sqrt();
            if left > NEW * size {
                kept.push(x / left);
            }
        }
        let kept: Vec<Vec<f64>> = kept.into_iter().map(|x| x.to_vec()).collect();
        let images: Vec<Vec<f64>> = kept.par_iter().map(|x| self.full.apply(x)).collect();
        let (kept, images) = (rows(&kept, len), rows(&images, len));
        // What the new rows hold of the old residuals, and all rows of the new images.
        let held = self.residuals.dot(&kept.t());
        self.residuals -= &held.dot(&kept);
        let matrix = join(Axis(0), &self.matrix, &held.t());
        self.basis = join(Axis(0), &self.basis, &kept.view());
        let held = images.dot(&self.basis.t());
        self.matrix = join(Axis(1), &matrix, &held.t());
        let left = images - held.dot(&self.basis);
        self.residuals = join(Axis(0), &self.residuals, &left.view());
    }

    fn model(&self) -> Result<Reduced> {
        let mut matrix = self.matrix.clone();
        let mut gram = self.residuals.dot(&self.residuals.t());
        let product = |part: Slice| {
            let cut = |of: &Array2<f64>| of.slice_axis(Axis(1), part).to_owned();
            cut(&self.basis).dot(&cut(&self.residuals).t())
        };
        let even = self.full.even();
        let mut dual = product(Slice::from(..even)) - product(Slice::from(even..));
        let values = eigenvalues(&matrix)?;
        let slowest = values.iter().map(|it| -it.re).fold(f64::INFINITY, f64::min);
        hessenberg(&mut matrix, &mut [&mut gram, &mut dual]);
        let start = self.full.start();
        Ok(Reduced {
            matrix,
            variance: ArrayView1::from(&start).dot(&ArrayView1::from(&start)),
            gram,
            dual,
            slowest: slowest.max(f64::MIN_POSITIVE),
            solved: self.solved.clone(),
        })
    }
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Vectors of a length as rows.
fn rows(vectors: &[Vec<f64>], length: usize) -> Array2<f64> {
    let all = vectors.concat();
    Array2::from_shape_vec((vectors.len(), length), all).unwrap_or_default()
}

/// One matrix beside another.
fn join(axis: Axis, one: &Array2<f64>, other: &ArrayView2<f64>) -> Array2<f64> {
    concatenate(axis, &[one.view(), other.view()]).unwrap_or_default()
}

/// A round of frequencies where the error is too large: the worst of as many stretches.
fn worst(omegas: &[f64], excess: &[f64], tolerance: f64, solved: &[f64]) -> Vec<f64> {
    let mut peaks: Vec<usize> = (0..omegas.len())
        .filter(|k| {
            let left = *k == 0 || excess[k - 1] <= excess[*k];
            let right = *k + 1 == omegas.len() || excess[k + 1] < excess[*k];
            excess[*k] > tolerance && left && right && !solved.contains(&omegas[*k])
        })
        .collect();
    peaks.sort_by(|a, b| excess[*b].total_cmp(&excess[*a]));
    peaks.truncate(ROUND.max((GROWTH * solved.len() as f64) as usize));
    peaks.iter().map(|k| omegas[*k]).collect()
}

/// Householder reduction to upper Hessenberg form that leaves the first vector alone; the same change of
/// basis for the other matrices.
fn hessenberg(matrix: &mut Array2<f64>, others: &mut [&mut Array2<f64>]) {
    let m = matrix.nrows();
    for k in 0..m.saturating_sub(2) {
        let below = Slice::from(k + 1..);
        let mut u = matrix.column(k).slice_axis(Axis(0), below).to_owned();
        let size = u.dot(&u).sqrt();
        u[0] += size.copysign(u[0]);
        let norm = u.dot(&u);
        if norm == 0.0 {
            continue;
        }
        let reflect = |a: &mut Array2<f64>| {
            let mut rows = a.slice_axis_mut(Axis(0), below);
            let along = u.dot(&rows) * (2.0 / norm);
            for (mut row, u) in rows.rows_mut().into_iter().zip(&u) {
                row.scaled_add(-u, &along);
            }
            let mut columns = a.slice_axis_mut(Axis(1), below);
            let along = columns.dot(&u) * (2.0 / norm);
            for (mut row, a) in columns.rows_mut().into_iter().zip(&along) {
                row.scaled_add(-a, &u);
            }
        };
        reflect(matrix);
        for other in others.iter_mut() {
            reflect(other);
        }
        matrix
            .slice_axis_mut(Axis(0), Slice::from(k + 2..))
            .column_mut(k)
            .fill(0.0);
    }
}
