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

use super::hermite::{Factored, Hierarchy};
use crate::error::Result;
use crate::matrix::exponential;
use crate::sparse::eigen;
use ndarray::{Array1, Array2, ArrayView1, Axis, Slice};
use num_complex::Complex;
use rayon::prelude::*;

type C = Complex<f64>;

/// Solves a round: enough to keep a few processors busy, few enough to place them well.
const ROUND: usize = 4;

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
    /// Orthonormal rows, with their images under L.
    basis: Vec<Array1<f64>>,
    images: Vec<Array1<f64>>,
    solved: Vec<f64>,
}

impl Reduced {
    /// The model of `full` whose error is at most `tolerance`, relative to the larger of the value and
    /// `floor` of its peak, at every one of the ascending `omegas`; or as near as `most` solves get.
    pub(super) fn new(
        full: &Hierarchy,
        omegas: &[f64],
        tolerance: f64,
        floor: f64,
        most: usize,
        go_on: &(dyn Fn(usize) -> Result<()> + Sync),
    ) -> Result<Self> {
        let mut builder = Builder::new(full);
        // A dozen frequencies spread over what is asked; the model shows where more are needed.
        let first = 12.min(omegas.len());
        let spread = |k: usize| omegas[k * (omegas.len() - 1) / (first - 1).max(1)];
        let mut wanted: Vec<f64> = (0..first).map(spread).collect();
        wanted.dedup();
        loop {
            builder.solve(&wanted, go_on)?;
            let model = builder.model()?;
            let answers: Vec<Answer> = omegas.par_iter().map(|w| model.at(*w)).collect();
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
        let c = self.solve(C::new(0.0, omega));
        let size = self.variance.sqrt();
        let bilinear = |matrix: &Array2<f64>, left: &dyn Fn(C) -> C| -> C {
            let rows = matrix.rows().into_iter().zip(&c);
            rows.map(|(row, a)| left(*a) * row.iter().zip(&c).map(|(m, b)| b * m).sum::<C>())
                .sum()
        };
        let correction = bilinear(&self.dual, &|a| a);
        let residual = bilinear(&self.gram, &|a| a.conj()).re.max(0.0);
        Answer {
            value: (size * c[0] + correction).re,
            error: residual / self.slowest + 1e-13 * (size * c[0]).norm(),
        }
    }

    /// (shift - H)^{-1} |b| e_1, H upper Hessenberg: elimination with row exchanges.
    fn solve(&self, shift: C) -> Vec<C> {
        let m = self.dimension();
        let mut a = self.matrix.mapv(|x| C::new(-x, 0.0));
        a.diag_mut().mapv_inplace(|x| x + shift);
        let mut x = vec![C::default(); m];
        x[0] = C::new(self.variance.sqrt(), 0.0);
        for k in 0..m.saturating_sub(1) {
            if a[[k + 1, k]].norm_sqr() > a[[k, k]].norm_sqr() {
                for j in k..m {
                    a.swap([k, j], [k + 1, j]);
                }
                x.swap(k, k + 1);
            }
            let factor = a[[k + 1, k]] / a[[k, k]];
            for j in k..m {
                let upper = a[[k, j]];
                a[[k + 1, j]] -= factor * upper;
            }
            let carried = factor * x[k];
            x[k + 1] -= carried;
        }
        for k in (0..m).rev() {
            let known: C = (k + 1..m).map(|j| a[[k, j]] * x[j]).sum();
            x[k] = (x[k] - known) / a[[k, k]];
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
            basis: Vec::new(),
            images: Vec::new(),
            solved: Vec::new(),
        };
        it.add(Array1::from_vec(full.start()));
        for k in 0..2 {
            if let Some(image) = it.images.get(k) {
                it.add(image.clone());
            }
        }
        it
    }

    fn solve(
        &mut self,
        omegas: &[f64],
        go_on: &(dyn Fn(usize) -> Result<()> + Sync),
    ) -> Result<()> {
        let late = || go_on(self.solved.len());
        let start: Vec<C> = self.full.start().into_iter().map(C::from).collect();
        let states: Vec<Result<Vec<C>>> = omegas
            .par_iter()
            .map(|w| Factored::new(self.full, C::new(0.0, *w), &late)?.solve(&start))
            .collect();
        for (omega, state) in omegas.iter().zip(states) {
            let state = state?;
            self.add(state.iter().map(|x| x.re).collect());
            self.add(state.iter().map(|x| x.im).collect());
            self.solved.push(*omega);
        }
        Ok(())
    }

    /// Adds what is new of a vector.
    fn add(&mut self, mut x: Array1<f64>) {
        let size = x.dot(&x).sqrt();
        for _ in 0..2 {
            for b in &self.basis {
                let overlap = b.dot(&x);
                x.scaled_add(-overlap, b);
            }
        }
        let left = x.dot(&x).sqrt();
        if left > NEW * size {
            x /= left;
            self.images.push(Array1::from_vec(
                self.full.apply(x.as_slice().unwrap_or(&[])),
            ));
            self.basis.push(x);
        }
    }

    fn model(&self) -> Result<Reduced> {
        let rows = |vectors: &[Array1<f64>]| {
            let mut all = Array2::zeros((vectors.len(), self.full.len()));
            for (mut row, vector) in all.rows_mut().into_iter().zip(vectors) {
                row.assign(vector);
            }
            all
        };
        let (basis, images) = (rows(&self.basis), rows(&self.images));
        let mut matrix = basis.dot(&images.t());
        let residuals = images - matrix.t().dot(&basis);
        let mut mirrored = basis;
        let odd = Slice::from(self.full.even()..);
        mirrored.slice_axis_mut(Axis(1), odd).mapv_inplace(|x| -x);
        let mut gram = residuals.dot(&residuals.t());
        let mut dual = mirrored.dot(&residuals.t());
        let (values, _) = eigen(&matrix.mapv(|x| C::new(x, 0.0)))?;
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

/// At most [`ROUND`] frequencies where the error is too large: the worst of as many stretches.
fn worst(omegas: &[f64], excess: &[f64], tolerance: f64, solved: &[f64]) -> Vec<f64> {
    let mut peaks: Vec<usize> = (0..omegas.len())
        .filter(|k| {
            let left = *k == 0 || excess[k - 1] <= excess[*k];
            let right = *k + 1 == omegas.len() || excess[k + 1] < excess[*k];
            excess[*k] > tolerance && left && right && !solved.contains(&omegas[*k])
        })
        .collect();
    peaks.sort_by(|a, b| excess[*b].total_cmp(&excess[*a]));
    peaks.truncate(ROUND);
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
