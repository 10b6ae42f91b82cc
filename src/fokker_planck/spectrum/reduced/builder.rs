//! Builds a model of the resolvent: states at more and more frequencies, where the model errs most.

use super::hessenberg::{hessenberg, reflect};
use super::{Answer, C, End, Form, POWERS, Reduced, Side};
use crate::error::Result;
use crate::fokker_planck::hermite::Factored;
use crate::matrix::norm;
use crate::sparse::eigenvalues;
use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis, Slice, concatenate};
use rayon::prelude::*;

/// States at a frequency, and by how much the largest was stretched.
type States = (Vec<Vec<f64>>, f64);

/// Solves a round, and the part of those before it that they may be: enough to keep a few processors busy, few enough
/// to place them well.
const ROUND: usize = 4;
const GROWTH: f64 = 0.3;

/// A part of a new state beyond this, relative to it, is rounding.
const NEW: f64 = 1e-9;

/// A shift in place of 0 where friction depends on the displacement: there the constant, which no spectrum sees, would make
/// the matrix singular.
const ASIDE: f64 = 1e-8;

/// Where a resolvent was seen to stretch states by so much, it may stretch others by this many times more.
const STRETCHED: f64 = 2.0;

/// Frequencies a model begins with.
const FIRST: usize = 8;

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
    pub(in super::super) fn new(
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

    /// Solves at some frequencies and takes what is new of the states.
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

    /// The model as far as it has been built.
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
