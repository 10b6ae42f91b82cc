//! The spline of a local grid in its frame.

use super::frame::Frame;
use crate::fokker_planck::interpolation::{
    Filter, MARGIN, PANEL, POINTS, Spline, filter, reflected,
};
use crate::fokker_planck::mesh::Axis;
use crate::matrix::vectorise;

/// A spline through values at the centres of n x n equal cells, mirrored at the border.
#[derive(Debug, Clone)]
pub(super) struct Interpolant {
    n: usize,
    /// The first centre, and one over the width of a cell.
    start: f64,
    inverse: f64,
    filter: Filter,
    spline: Spline,
    /// (n + 2 margin)^2.
    coefficients: Vec<f64>,
}

impl Interpolant {
    /// On a square with this axis of equal cells, before it has values.
    pub(super) fn new(axis: &Axis) -> Self {
        let n = axis.len();
        let padded = n + 2 * MARGIN;
        Self {
            n,
            start: axis.centres()[0],
            inverse: 1.0 / axis.slopes()[0],
            filter: Filter::new(n),
            spline: Spline::new(),
            coefficients: vec![0.0; padded * padded],
        }
    }

    /// Passes through these values; `scratch` is as long as they are.
    pub(super) fn pass(&mut self, values: &[f64], scratch: &mut [f64]) {
        let n = self.n;
        self.along(true, values, scratch);
        let half = scratch.to_vec();
        self.along(false, &half, scratch);
        let rows = self.coefficients.chunks_exact_mut(n + 2 * MARGIN);
        for (i, row) in rows.enumerate() {
            let from = reflected(i, n) * n;
            for (k, x) in row.iter_mut().enumerate() {
                *x = scratch[from + reflected(k, n)];
            }
        }
    }

    /// Coefficients along rows, or along columns, of values along the other.
    pub(super) fn along(&self, rows: bool, values: &[f64], coefficients: &mut [f64]) {
        filter(&self.filter, values, self.n, rows, coefficients);
    }

    /// The spline through values along one axis, at a place in cells from the first centre.
    pub(super) fn curve(&self, values: &[f64]) -> impl Fn(f64) -> f64 {
        let n = self.n;
        let mut panel = vec![0.0; n * PANEL];
        for (row, p) in panel.chunks_exact_mut(PANEL).zip(values) {
            row[0] = *p;
        }
        self.filter.apply(&mut panel);
        move |x| {
            let (first, place) = Spline::place(x, n);
            let weights = self.spline.weights(place);
            (0..POINTS)
                .map(|r| weights[r] * panel[reflected(first + r, n) * PANEL])
                .sum()
        }
    }

    /// Its values times `scale` at points (q, v) of a frame; 0 outside the square.
    pub(super) fn sample(
        &self,
        frame: &Frame,
        scale: f64,
        points: &[[f64; 2]],
        values: &mut [f64],
    ) {
        vectorise!(self.values_at(frame, scale, points, values));
    }

    #[inline(always)]
    fn values_at(&self, frame: &Frame, scale: f64, points: &[[f64; 2]], values: &mut [f64]) {
        let n = self.n;
        let width = n + 2 * MARGIN;
        // Beyond the last centre by half a cell the square ends.
        let inside = |x: f64| x > -0.5 && x < n as f64 - 0.5;
        for (value, point) in values.iter_mut().zip(points) {
            let [x, y] = frame
                .locate(*point)
                .map(|xi| (xi - self.start) * self.inverse);
            if !(inside(x) && inside(y)) {
                *value = 0.0;
                continue;
            }
            let (i, fx) = Spline::place(x, n);
            let (j, fy) = Spline::place(y, n);
            let (wx, wy) = (self.spline.weights(fx), self.spline.weights(fy));
            let mut sums = [0.0f64; 8];
            for (r, w) in wx.iter().enumerate() {
                let row = &self.coefficients[(i + r) * width + j..][..8];
                for l in 0..8 {
                    sums[l] = w.mul_add(row[l], sums[l]);
                }
            }
            let sum: f64 = sums.iter().zip(&wy).map(|(s, w)| s * w).sum();
            *value = sum * scale;
        }
    }
}
