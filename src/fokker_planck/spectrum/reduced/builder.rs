//! Builds a model of the resolvent: states at more and more frequencies, where the model errs most.

use super::hessenberg::{hessenberg, reflect, reflect_columns};
use super::{Answer, Apart, C, End, Form, POWERS, Reduced, Side};
use crate::error::Result;
use crate::fokker_planck::hermite::{Factored, Hierarchy};
use crate::matrix::{norm, overlaps, project};
use crate::sparse::{eigenvalues, root};
use ndarray::{Array2, ArrayView1, ArrayView2, Axis, Slice, concatenate};
use rayon::prelude::*;

/// States at a frequency, and by how much the largest was stretched.
type States = (Vec<Vec<f64>>, f64);

/// Solves a round, and the part of those before it that they may be: enough to keep a few processors busy, few enough
/// to place them well.
const ROUND: usize = 4;
const GROWTH: f64 = 0.3;

/// Rows that are made orthonormal one by one, before the next as many are taken together: the states of two frequencies.
const TOGETHER: usize = 4 * POWERS;

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
    /// The model of `form` whose error is at most `tolerance`, relative to the larger of the value and `floor` of its peak within
    /// a well, at every one of the ascending `omegas`; or as near as `most` solves get. It begins with the frequencies `first`.
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
        let mut before = f64::INFINITY;
        loop {
            builder.solve(&wanted, go_on)?;
            let model = builder.model()?;
            let answers = model.all(omegas);
            // A peak higher than that is of hops between wells: what goes on within them would be lost beside it.
            let within = model.variance / form.full.relaxation();
            let peak = answers.iter().map(|it| it.value).fold(0.0, f64::max);
            let peak = peak.min(within);
            let scale = |it: &Answer| it.value.abs().max(floor * peak);
            let excess: Vec<f64> = answers.iter().map(|it| it.error / scale(it)).collect();
            if builder.solved.len() >= most {
                return model.with_modes();
            }
            let largest = excess.iter().copied().fold(0.0, f64::max);
            wanted = worst(omegas, &excess, tolerance, &builder.solved);
            // Where a slow rate stretches a state that was solved for, rounding is left, and others hold what it lost.
            if wanted.is_empty() && largest > tolerance && largest < 0.5 * before {
                wanted = worst(omegas, &excess, 0.0, &builder.solved);
            }
            if wanted.is_empty() {
                return model.with_modes();
            }
            before = largest;
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
        it.add(&first);
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
                        state = if aside > 0.0 {
                            inverse.refined(&state)?
                        } else {
                            inverse.solve(&state)?
                        };
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
        self.add(&new);
        self.solved.extend(omegas);
        Ok(())
    }

    /// Adds what is new of some vectors.
    fn add(&mut self, vectors: &[Vec<f64>]) {
        let kept = self.orthonormal(vectors);
        let mut images = self.images(&self.form.full, &kept);
        // What the new rows hold of the old residuals, and all rows of the new images.
        let held = project(&mut self.residuals, &kept);
        let matrix = join(Axis(0), &self.matrix, &held.t());
        let shadows = self.form.adjoint.as_ref().map(|it| {
            project(&mut self.shadows, &kept);
            self.images(&it.operator, &kept)
        });
        append(&mut self.basis, &kept);
        let held = project(&mut images, &self.basis);
        self.matrix = join(Axis(1), &matrix, &held.t());
        append(&mut self.residuals, &images);
        if let Some(mut shadows) = shadows {
            project(&mut shadows, &self.basis);
            append(&mut self.shadows, &shadows);
        }
    }

    /// Orthonormal rows that span what is new of some vectors, beyond rounding: Gram and Schmidt, twice, first against all rows that
    /// are there. What is left of a vector has lost digits, and is made orthogonal to all others once more when it has a length of 1
    /// again.
    fn orthonormal(&self, vectors: &[Vec<f64>]) -> Array2<f64> {
        let mut new = rows(vectors, self.form.full.len());
        for mut x in new.rows_mut() {
            let size = x.dot(&x).sqrt();
            x /= size.max(f64::MIN_POSITIVE);
        }
        for _ in 0..2 {
            project(&mut new, &self.basis);
        }
        let mut all = Array2::zeros((0, new.ncols()));
        for block in new.axis_chunks_iter(Axis(0), TOGETHER) {
            let mut block = block.to_owned();
            for _ in 0..2 {
                project(&mut block, &all);
            }
            let mut kept = independent(block, NEW);
            project(&mut kept, &self.basis);
            project(&mut kept, &all);
            append(&mut all, &independent(kept, 0.5));
        }
        all
    }

    /// What an operator makes of rows.
    fn images(&self, operator: &Hierarchy, of: &Array2<f64>) -> Array2<f64> {
        let of: Vec<_> = of.rows().into_iter().collect();
        let images: Vec<Vec<f64>> = of.par_iter().map(|x| operator.apply(&x.to_vec())).collect();
        rows(&images, self.form.full.len())
    }

    /// The model as far as it has been built.
    fn model(&self) -> Result<Reduced> {
        let mut matrix = self.matrix.clone();
        let mut errors = root(&self.residuals);
        let start = self.form.full.start();
        let Some(adjoint) = &self.form.adjoint else {
            let product = |part: Slice| {
                let [basis, residuals] =
                    [&self.basis, &self.residuals].map(|it| it.slice_axis(Axis(1), part));
                overlaps(&basis, &residuals)
            };
            let even = self.form.full.even();
            let mut dual = product(Slice::from(..even)) - product(Slice::from(even..));
            let apart = Apart::of(&eigenvalues(&matrix)?);
            hessenberg(&mut matrix, &mut [&mut dual], &mut [&mut errors]);
            let variance = ArrayView1::from(&start).dot(&ArrayView1::from(&start));
            return Ok(Reduced {
                right: Side {
                    matrix,
                    size: variance.sqrt(),
                    root: errors,
                    rounding: self.form.full.rounding(),
                },
                end: End::Mirrored { dual },
                variance,
                apart,
                solved: self.solved.clone(),
            });
        };
        let weighed = ArrayView1::from(&adjoint.start);
        let state = self.basis.dot(&weighed);
        // The transposed equation on the basis that begins with its own state.
        let (mut turned, size) = (matrix.t().to_owned(), state.dot(&state).sqrt());
        let mut others = root(&self.shadows);
        let mut u = (&state / size).to_vec();
        u[0] += 1f64.copysign(u[0]);
        reflect(&mut turned, &u);
        reflect_columns(&mut others, &u);
        hessenberg(&mut turned, &mut [], &mut [&mut others]);
        let mut state = state.insert_axis(Axis(0));
        hessenberg(&mut matrix, &mut [], &mut [&mut errors, &mut state]);
        Ok(Reduced {
            right: Side {
                matrix,
                size: norm(&start),
                root: errors,
                rounding: self.form.full.rounding(),
            },
            end: End::Own {
                state: state.remove_axis(Axis(0)),
                left: Side {
                    matrix: turned,
                    size,
                    root: others,
                    rounding: adjoint.operator.rounding(),
                },
                modes: Vec::new(),
            },
            variance: weighed.dot(&ArrayView1::from(&start)),
            apart: Apart {
                real: f64::INFINITY,
                turning: 1.0 / (STRETCHED * self.stretched).max(f64::MIN_POSITIVE),
            },
            solved: self.solved.clone(),
        })
    }
}

/// Orthonormal rows that span rows, what is left of others of length 1, beyond `least`. They are taken in their order, but for one
/// of which less than half as much is left as of another: it has lost digits, and those after it would lose more to it.
fn independent(mut rows: Array2<f64>, least: f64) -> Array2<f64> {
    let mut kept = Array2::zeros((0, rows.ncols()));
    for _ in 0..rows.nrows() {
        let sizes = rows.rows().into_iter().map(|x| x.dot(&x).sqrt());
        let larger = |a: (usize, f64), b: (usize, f64)| if b.1 > 2.0 * a.1 { b } else { a };
        let (largest, size) = sizes.enumerate().fold((0, 0.0), larger);
        if size <= least {
            break;
        }
        let mut next = rows.row(largest).to_owned();
        next /= size;
        rows.row_mut(largest).fill(0.0);
        // Once more, of length 1.
        let mut next = next.insert_axis(Axis(0));
        project(&mut next, &kept);
        next /= norm(next.as_slice().unwrap_or_default());
        project(&mut rows, &next);
        append(&mut kept, &next);
    }
    kept
}

/// Vectors of a length as rows.
fn rows(vectors: &[Vec<f64>], length: usize) -> Array2<f64> {
    let all = vectors.concat();
    Array2::from_shape_vec((vectors.len(), length), all).unwrap_or_default()
}

/// Rows below others of the same length.
fn append(to: &mut Array2<f64>, rows: &Array2<f64>) {
    // Rows of another length there are none.
    let _ = to.append(Axis(0), rows.view());
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
