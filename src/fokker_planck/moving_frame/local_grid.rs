//! A density narrower than any mesh of the plane can hold, on a small mesh that moves with it.
//!
//! x = mean + L xi with mean and L L^T those of the density itself ([`Frame`]), P(xi) on a square of
//! equal cells. Under the undamped motion Phi the density keeps its value along orbits, so a step of H is
//!
//! ```text
//! P'(xi') = P(xi) |L'|/|L|,   x' = mean' + L' xi',   x = Phi_{-tau}(x') = mean + L xi
//! ```
//!
//! exact but for the spline through P: nothing is linearised, the loss of contact included; the frame
//! only has to keep P in its square. Friction with noise acts along v at fixed q, that is along xi_2 at
//! fixed xi_1; with L_vv' = sqrt(a^2 L_vv^2 + s^2) it is the Ornstein-Uhlenbeck step of a standard normal.

mod observables;
mod step;

use super::frame::Frame;
use super::interpolant::Interpolant;
use super::linear::spread;
use crate::error::{Error, Result};
use crate::fokker_planck::forcing::Forcing;
use crate::fokker_planck::mesh::Axis;
use crate::gaussian::normal;
use crate::initial::Initial;
use crate::matrix::grid;
use crate::noise_free;
use crate::oscillator::Oscillator;
use std::sync::Arc;

/// How fine a local grid is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fineness {
    /// Width of a cell, in deviations of the density.
    pub(crate) cell: f64,
    /// Half the side of the square, in deviations.
    pub(crate) reach: f64,
    /// Largest P on the border of the square before it is widened.
    pub(crate) border: f64,
    /// Longest step in time.
    pub(crate) step: f64,
    /// The steps of a coarser run beside this one over its own: an interval is divided into so many times
    /// as many, lest both take the same and their difference be blind to it. 1 where there is none.
    pub(crate) beside: f64,
    /// Steps more in every interval, for the same reason.
    pub(crate) more: u64,
}

/// A concentrated density on its own grid in its own frame.
#[derive(Debug, Clone)]
pub(crate) struct LocalGrid {
    oscillator: Oscillator,
    /// What there is beside stationary noise.
    forcing: Option<Arc<Forcing>>,
    fineness: Fineness,
    axis: Axis,
    frame: Frame,
    /// P at the centres, xi_1 by xi_2, n x n.
    values: Vec<f64>,
    /// The point that it was at most `early` ago, mean and time, if it was one.
    point: Option<([f64; 2], f64)>,
    /// For how long a point spreads as the linear oscillator about it does.
    early: f64,
    time: f64,
    steps: u64,
    defect: f64,
    spline: Interpolant,
    /// Working space: n x n values, the points of the mesh and where they come from.
    other: Vec<f64>,
    points: Vec<[f64; 2]>,
    origins: Vec<[f64; 2]>,
}

impl LocalGrid {
    /// The local grid of a Gaussian initial condition, or of a point at rest, under a drive or an envelope if there is one: a
    /// point stays one, and moves as one, until the noise begins. The point's first step, of `early` at
    /// most, is that of the oscillator linearised there: what it leaves out is of the order of h early^4.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a stationary initial condition.
    pub(crate) fn new(
        (oscillator, forcing): (&Oscillator, Option<Arc<Forcing>>),
        initial: &Initial,
        early: f64,
        fineness: Fineness,
    ) -> Result<Self> {
        let Some([mean, [q, v]]) = initial.mean_and_deviation() else {
            let accepted = "on a moving local grid, a \"gaussian\" initial condition or \"rest\"";
            return Err(Error::invalid("initial.kind", "\"stationary\"", accepted));
        };
        let half = (fineness.reach / fineness.cell).ceil();
        let n = 2 * half as usize;
        let axis = Axis::uniform(-half * fineness.cell, half * fineness.cell, n)?;
        let centres = axis.centres();
        let values = grid(centres, centres).map(|[x, y]| normal(x) * normal(y));
        let values: Vec<f64> = values.collect();
        let mut it = Self {
            oscillator: oscillator.clone(),
            forcing,
            fineness,
            spline: Interpolant::new(&axis),
            axis,
            frame: Frame {
                mean,
                lower: [q, 0.0, v],
            },
            other: values.clone(),
            values,
            point: (*initial == Initial::Rest).then_some((mean, 0.0)),
            early,
            time: 0.0,
            steps: 0,
            defect: 0.0,
            points: vec![[0.0; 2]; n * n],
            origins: vec![[0.0; 2]; n * n],
        };
        it.interpolate();
        Ok(it)
    }

    pub(crate) fn time(&self) -> f64 {
        self.time
    }

    pub(crate) fn steps(&self) -> u64 {
        self.steps
    }

    pub(crate) fn step(&self) -> f64 {
        self.fineness.step
    }

    /// Half the side of the square, in deviations.
    pub(crate) fn reach(&self) -> f64 {
        self.fineness.reach
    }

    /// Cells along either side.
    pub(crate) fn cells(&self) -> usize {
        self.axis.len()
    }

    /// The sum of the changes of the mass by interpolation, each made good at once: what left the square
    /// and what the cells did not resolve.
    pub(crate) fn defect(&self) -> f64 {
        self.defect
    }

    pub(crate) fn frame(&self) -> &Frame {
        &self.frame
    }

    pub(crate) fn is_point(&self) -> bool {
        self.frame.area() == 0.0
    }

    /// The number of equal steps of an interval.
    pub(crate) fn divide(&self, duration: f64) -> u64 {
        let Fineness {
            step, beside, more, ..
        } = self.fineness;
        let coarser = (duration / (beside * step) - 1e-9).ceil().max(1.0);
        (beside * coarser).ceil() as u64 + more
    }

    /// The first moments of a point's time: it becomes a Gaussian, `left` from now at most. One that is looked at so early spreads
    /// from the point once more afterwards: steps of a grid from 1e-9 to 1 would not resolve it.
    pub(crate) fn leave_point(&mut self, left: f64) {
        let Some((mut mean, mut begin)) = self.point.take() else {
            return;
        };
        let (oscillator, end) = (&self.oscillator, self.time + left);
        let excitation = self.forcing.as_ref().map(|it| it.excitation());
        if let Some(it) = excitation {
            let noise = it.noise_from().clamp(begin, end);
            mean = noise_free::motion(oscillator, it, mean, [begin, noise]);
            begin = noise;
            if begin >= end {
                (self.frame.mean, self.time) = (mean, begin);
                self.point = Some((mean, begin));
                return;
            }
        }
        let first = self.early.min(end - begin);
        // No noise before, and all of it linear in time up to its next bend.
        let bend = excitation.and_then(|it| it.bends(begin, begin + first).next());
        let until = bend.unwrap_or(begin + first);
        self.frame = spread(oscillator, excitation, mean, [begin, until - begin]);
        self.time = until;
        self.steps += 1;
        if bend.is_none() && first < self.early {
            self.point = Some((mean, begin));
        }
    }

    /// Sets the time to `t`, where the steps led but for rounding.
    pub(crate) fn arrive(&mut self, t: f64) {
        self.time = t;
    }

    /// The largest |P| on the border of the square.
    fn border(&self) -> f64 {
        let n = self.axis.len();
        let largest = |values: &mut dyn Iterator<Item = &f64>| {
            values.fold(0.0_f64, |largest, p| largest.max(p.abs()))
        };
        let first_and_last = self.values[..n].iter().chain(&self.values[n * (n - 1)..]);
        let rows = self.values.chunks_exact(n);
        let sides = rows.flat_map(|row| [&row[0], &row[n - 1]]);
        largest(&mut first_and_last.chain(sides))
    }

    /// More cells around the square, an eighth of those there are: a displaced density bends along its orbit,
    /// and its tails curl out of a square that follows mean and deviations.
    fn widen(&mut self) {
        let (n, cell) = (self.axis.len(), self.fineness.cell);
        let more = n.div_ceil(16);
        let wide = n + 2 * more;
        let reach = 0.5 * wide as f64 * cell;
        // Equal cells of a width that has been accepted before.
        let Ok(axis) = Axis::uniform(-reach, reach, wide) else {
            return;
        };
        let mut values = vec![0.0; wide * wide];
        for (row, into) in self
            .values
            .chunks_exact(n)
            .zip(values.chunks_exact_mut(wide).skip(more))
        {
            into[more..more + n].copy_from_slice(row);
        }
        self.spline = Interpolant::new(&axis);
        self.axis = axis;
        self.fineness.reach = reach;
        self.other = values.clone();
        self.values = values;
        self.points = vec![[0.0; 2]; wide * wide];
        self.origins = vec![[0.0; 2]; wide * wide];
        self.interpolate();
    }

    /// The spline through the values.
    fn interpolate(&mut self) {
        self.spline.pass(&self.values, &mut self.other);
    }
}

#[cfg(test)]
#[path = "local_grid_tests.rs"]
mod tests;
