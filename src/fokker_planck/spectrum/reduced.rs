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
//!
//! Where friction depends on the displacement the transpose is another operator, and what is watched, times the law
//! solved for, another state l. The space then holds the states (i omega_k - L^T)^{-1} l too, so that
//! l.V c has those digits by itself, and the bound is |r| |r'| |(i omega - L)^{-1}| with the residual r' of the
//! transposed equation.

use crate::error::Result;
use crate::fokker_planck::hermite::{Adjoint, Factored, Hierarchy};
use crate::matrix::exponential;
use crate::sparse::{DenseLu, eigen, eigenvalues};
use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis, Slice, concatenate};
use num_complex::Complex;
use rayon::prelude::*;

/// States at a frequency, and by how much the largest was stretched.
type States = (Vec<Vec<f64>>, f64);

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

/// A shift in place of 0 where friction depends on the displacement: there the constant, which no spectrum sees, would make
/// the matrix singular.
const ASIDE: f64 = 1e-8;

/// Where a resolvent was seen to stretch states by so much, it may stretch others by this many times more.
const STRETCHED: f64 = 2.0;

/// The projected generator.
#[derive(Debug, Clone)]
pub(super) struct Reduced {
    right: Side,
    end: End,
    /// b.b, or l.b: the variance.
    pub(super) variance: f64,
    /// Slowest rate of decay of the model, or the inverse of the largest resolvent seen.
    slowest: f64,
    /// Frequencies solved for.
    pub(super) solved: Vec<f64>,
}

/// L or its transpose on a basis that begins with the state it is asked for.
#[derive(Debug, Clone)]
struct Side {
    /// Upper Hessenberg.
    matrix: Array2<f64>,
    /// Size of the state.
    size: f64,
    /// R^T R of the residuals R = L V - V H.
    gram: Array2<f64>,
}

/// What a solution is multiplied with.
#[derive(Debug, Clone)]
enum End {
    /// b, and what v -> -v makes of the solution, (J V)^T R.
    Mirrored { dual: Array2<f64> },
    /// l on the basis, the transposed equation on a basis of its own, and the modes that decay, each with its part of the
    /// variance.
    Own {
        state: Array1<f64>,
        left: Side,
        modes: Vec<[C; 2]>,
    },
}

/// L and the states a spectrum is made of, Re l.(i omega - L)^{-1} b; l is b but for a friction that depends on the
/// displacement.
pub(super) struct Form {
    pub(super) full: Hierarchy,
    pub(super) adjoint: Option<Adjoint>,
}

/// Re b.(i omega - L)^{-1} b with a bound on its error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Answer {
    pub(super) value: f64,
    pub(super) error: f64,
}

/// Builds a [`Reduced`] until it is good.
struct Builder<'a> {
    form: &'a Form,
    /// Orthonormal rows.
    basis: Array2<f64>,
    /// What of L times each row the rows do not span.
    residuals: Array2<f64>,
    /// The same of its transpose, where that is an operator of its own.
    shadows: Array2<f64>,
    /// Products of the rows with L times the rows.
    matrix: Array2<f64>,
    solved: Vec<f64>,
    /// The most that a resolvent has stretched a state.
    stretched: f64,
}

impl Reduced {
    /// The model of `form` whose error is at most `tolerance`, relative to the larger of the value and
    /// `floor` of its peak, at every one of the ascending `omegas`; or as near as `most` solves get. It begins with the
    /// frequencies `first`.
    pub(super) fn new(
        form: &Form,
        omegas: &[f64],
        tolerance: f64,
        floor: f64,
        (first, most): (&[f64], usize),
        go_on: &(dyn Fn(usize) -> Result<()> + Sync),
    ) -> Result<Self> {
        let mut builder = Builder::new(form);
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
                return model.with_modes();
            }
            wanted = worst(omegas, &excess, tolerance, &builder.solved);
            if wanted.is_empty() {
                return model.with_modes();
            }
        }
    }

    pub(super) fn dimension(&self) -> usize {
        self.right.matrix.nrows()
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
        let c = self.right.solutions(omegas);
        let residuals = self.right.residuals(&c);
        match &self.end {
            End::Mirrored { dual } => {
                let dual = c.dot(&dual.t());
                let size = self.right.size;
                let answer = |k: usize| {
                    let (re, im) = (c.row(2 * k), c.row(2 * k + 1));
                    let correction = re.dot(&dual.row(2 * k)) - im.dot(&dual.row(2 * k + 1));
                    Answer {
                        value: size * c[[2 * k, 0]] + correction,
                        error: residuals[k].max(0.0) / self.slowest
                            + 1e-13 * size * c[[2 * k, 0]].hypot(c[[2 * k + 1, 0]]),
                    }
                };
                (0..omegas.len()).map(answer).collect()
            }
            End::Own { state, left, .. } => {
                let others = left.residuals(&left.solutions(omegas));
                let answer = |k: usize| {
                    let (re, im) = (c.row(2 * k), c.row(2 * k + 1));
                    let product = residuals[k].max(0.0) * others[k].max(0.0);
                    let size = (re.dot(&re) + im.dot(&im)).sqrt();
                    Answer {
                        value: state.dot(&re),
                        error: product.sqrt() / self.slowest + 1e-14 * left.size * size,
                    }
                };
                (0..omegas.len()).map(answer).collect()
            }
        }
    }

    /// The correlation function l.e^{L t} b at the times 0, step, 2 step, ...
    pub(super) fn correlation(&self, step: f64, count: usize) -> Vec<f64> {
        if let End::Own { modes, .. } = &self.end {
            let value = |k: usize| -> f64 {
                let t = step * k as f64;
                modes
                    .iter()
                    .map(|[rate, part]| (part * (rate * t).exp()).re)
                    .sum()
            };
            return (0..count).map(value).collect();
        }
        let over = exponential(&self.right.matrix, step);
        let mut x = Array1::<f64>::zeros(self.dimension());
        x[0] = self.variance;
        let mut values = Vec::with_capacity(count);
        for _ in 0..count {
            values.push(x[0]);
            x = over.dot(&x);
        }
        values
    }

    /// The same with its modes. Where v -> -v does not turn L into its transpose a projection may have modes that grow; what
    /// they hold of a spectrum is within its error, and in time they are left out.
    fn with_modes(mut self) -> Result<Self> {
        let Side { matrix, size, .. } = &self.right;
        if let End::Own { state, modes, .. } = &mut self.end {
            let (rates, vectors) = eigen(&matrix.mapv(C::from))?;
            let mut parts = vec![C::default(); rates.len()];
            parts[0] = C::from(*size);
            DenseLu::factor(&vectors)?.solve(&mut parts)?;
            let all = rates.into_iter().zip(vectors.columns()).zip(parts);
            *modes = all
                .filter(|((rate, _), _)| rate.re < 0.0)
                .map(|((rate, vector), part)| {
                    let seen: C = vector.iter().zip(&*state).map(|(x, l)| x * l).sum();
                    [rate, seen * part]
                })
                .collect();
        }
        Ok(self)
    }
}

impl Side {
    /// The solutions at some frequencies: real parts, and below each the imaginary one.
    fn solutions(&self, omegas: &[f64]) -> Array2<f64> {
        let mut c = Array2::<f64>::zeros((2 * omegas.len(), self.matrix.nrows()));
        for (k, omega) in omegas.iter().enumerate() {
            for (i, x) in self.solve(C::new(0.0, *omega)).into_iter().enumerate() {
                (c[[2 * k, i]], c[[2 * k + 1, i]]) = (x.re, x.im);
            }
        }
        c
    }

    /// The squares of their residuals.
    fn residuals(&self, c: &Array2<f64>) -> Vec<f64> {
        let gram = c.dot(&self.gram.t());
        let residual = |k: usize| {
            let (re, im) = (c.row(2 * k), c.row(2 * k + 1));
            re.dot(&gram.row(2 * k)) + im.dot(&gram.row(2 * k + 1))
        };
        (0..c.nrows() / 2).map(residual).collect()
    }

    /// (shift - H)^{-1} |b| e_1, H upper Hessenberg: elimination with row exchanges.
    fn solve(&self, shift: C) -> Vec<C> {
        let m = self.matrix.nrows();
        let row = |k: usize| {
            let mut row: Vec<C> = self.matrix.row(k).iter().map(|x| C::new(-x, 0.0)).collect();
            row[k] += shift;
            row
        };
        let mut x = vec![C::default(); m];
        x[0] = C::new(self.size, 0.0);
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
}

impl<'a> Builder<'a> {
    /// Starts with b, L b and L L b, which hold the correlation function at short times.
    fn new(form: &'a Form) -> Self {
        let none = || Array2::zeros((0, form.full.len()));
        let mut it = Self {
            form,
            basis: none(),
            residuals: none(),
            shadows: none(),
            matrix: Array2::zeros((0, 0)),
            solved: Vec::new(),
            stretched: 0.0,
        };
        let mut first = Vec::new();
        for (full, start) in form.sides() {
            let once = full.apply(&start);
            let twice = full.apply(&once);
            first.extend([start, once, twice]);
        }
        it.add(first);
        it
    }

    fn solve(
        &mut self,
        omegas: &[f64],
        go_on: &(dyn Fn(usize) -> Result<()> + Sync),
    ) -> Result<()> {
        let late = || go_on(self.solved.len());
        let sides = self.form.sides();
        let states: Vec<Result<States>> = omegas
            .par_iter()
            .map(|w| {
                let (mut states, mut stretched) = (Vec::new(), 0.0f64);
                let aside = if *w == 0.0 && sides.len() > 1 {
                    ASIDE
                } else {
                    0.0
                };
                for (full, start) in &sides {
                    let inverse = Factored::new(full, C::new(aside, *w), &late)?;
                    let mut state: Vec<C> = start.iter().copied().map(C::from).collect();
                    for power in 0..POWERS {
                        state = inverse.solve(&state)?;
                        let size = state.iter().map(C::norm_sqr).sum::<f64>().sqrt();
                        if power > 0 {
                            stretched = stretched.max(size);
                        }
                        for x in &mut state {
                            *x /= size;
                        }
                        states.push(state.iter().map(|x| x.re).collect());
                        states.push(state.iter().map(|x| x.im).collect());
                    }
                }
                Ok((states, stretched))
            })
            .collect();
        let mut new = Vec::new();
        for states in states {
            let (states, stretched) = states?;
            new.extend(states);
            self.stretched = self.stretched.max(stretched);
        }
        self.add(new);
        self.solved.extend(omegas);
        Ok(())
    }

    /// Adds what is new of some vectors: Gram and Schmidt, twice, first against all rows that are there.
    fn add(&mut self, vectors: Vec<Vec<f64>>) {
        let len = self.form.full.len();
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
        let images: Vec<Vec<f64>> = kept.par_iter().map(|x| self.form.full.apply(x)).collect();
        let transposed = self.form.adjoint.as_ref().map(|it| &it.operator);
        let shadows: Option<Vec<Vec<f64>>> =
            transposed.map(|it| kept.par_iter().map(|x| it.apply(x)).collect());
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
        if let Some(shadows) = shadows {
            let held = self.shadows.dot(&kept.t());
            self.shadows -= &held.dot(&kept);
            let shadows = rows(&shadows, len);
            let held = shadows.dot(&self.basis.t());
            let left = shadows - held.dot(&self.basis);
            self.shadows = join(Axis(0), &self.shadows, &left.view());
        }
    }

    fn model(&self) -> Result<Reduced> {
        let mut matrix = self.matrix.clone();
        let mut gram = self.residuals.dot(&self.residuals.t());
        let start = self.form.full.start();
        let Some(adjoint) = &self.form.adjoint else {
            let product = |part: Slice| {
                let cut = |of: &Array2<f64>| of.slice_axis(Axis(1), part).to_owned();
                cut(&self.basis).dot(&cut(&self.residuals).t())
            };
            let even = self.form.full.even();
            let mut dual = product(Slice::from(..even)) - product(Slice::from(even..));
            let values = eigenvalues(&matrix)?;
            let slowest = values.iter().map(|it| -it.re).fold(f64::INFINITY, f64::min);
            hessenberg(&mut matrix, &mut [&mut gram, &mut dual], &mut []);
            let variance = ArrayView1::from(&start).dot(&ArrayView1::from(&start));
            return Ok(Reduced {
                right: Side {
                    matrix,
                    size: variance.sqrt(),
                    gram,
                },
                end: End::Mirrored { dual },
                variance,
                slowest: slowest.max(f64::MIN_POSITIVE),
                solved: self.solved.clone(),
            });
        };
        let weighed = ArrayView1::from(&adjoint.start);
        let mut state = self.basis.dot(&weighed);
        // The transposed equation on the basis that begins with its own state.
        let (mut turned, size) = (matrix.t().to_owned(), state.dot(&state).sqrt());
        let mut shadow = self.shadows.dot(&self.shadows.t());
        let mut u = &state / size;
        u[0] += 1f64.copysign(u[0]);
        let whole = Slice::from(..);
        for a in [&mut turned, &mut shadow] {
            reflect(a, &u, whole);
        }
        hessenberg(&mut turned, &mut [&mut shadow], &mut []);
        hessenberg(&mut matrix, &mut [&mut gram], &mut [&mut state]);
        Ok(Reduced {
            right: Side {
                matrix,
                size: norm(&start),
                gram,
            },
            end: End::Own {
                state,
                left: Side {
                    matrix: turned,
                    size,
                    gram: shadow,
                },
                modes: Vec::new(),
            },
            variance: weighed.dot(&ArrayView1::from(&start)),
            slowest: 1.0 / (STRETCHED * self.stretched).max(f64::MIN_POSITIVE),
            solved: self.solved.clone(),
        })
    }
}

impl Form {
    /// The operators, each with the state it is asked for.
    fn sides(&self) -> Vec<(&Hierarchy, Vec<f64>)> {
        let beside = self.adjoint.iter();
        let beside = beside.map(|it| (&it.operator, it.start.clone()));
        std::iter::once((&self.full, self.full.start()))
            .chain(beside)
            .collect()
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
/// basis for the other matrices and vectors.
fn hessenberg(
    matrix: &mut Array2<f64>,
    others: &mut [&mut Array2<f64>],
    vectors: &mut [&mut Array1<f64>],
) {
    let m = matrix.nrows();
    for k in 0..m.saturating_sub(2) {
        let below = Slice::from(k + 1..);
        let mut u = matrix.column(k).slice_axis(Axis(0), below).to_owned();
        let size = u.dot(&u).sqrt();
        u[0] += size.copysign(u[0]);
        if u.dot(&u) == 0.0 {
            continue;
        }
        reflect(matrix, &u, below);
        for other in others.iter_mut() {
            reflect(other, &u, below);
        }
        for vector in vectors.iter_mut() {
            let mut part = vector.slice_axis_mut(Axis(0), below);
            let along = u.dot(&part) * (2.0 / u.dot(&u));
            part.scaled_add(-along, &u);
        }
        matrix
            .slice_axis_mut(Axis(0), Slice::from(k + 2..))
            .column_mut(k)
            .fill(0.0);
    }
}

/// Reflects rows and columns of a matrix.
fn reflect(a: &mut Array2<f64>, u: &Array1<f64>, part: Slice) {
    let norm = u.dot(u);
    let mut rows = a.slice_axis_mut(Axis(0), part);
    let along = u.dot(&rows) * (2.0 / norm);
    for (mut row, u) in rows.rows_mut().into_iter().zip(u) {
        row.scaled_add(-u, &along);
    }
    let mut columns = a.slice_axis_mut(Axis(1), part);
    let along = columns.dot(u) * (2.0 / norm);
    for (mut row, a) in columns.rows_mut().into_iter().zip(&along) {
        row.scaled_add(-a, u);
    }
}
