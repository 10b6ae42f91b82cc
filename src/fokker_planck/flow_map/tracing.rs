//! Where the cells come from: departure points of the undamped motion, and the stencils about them.

use super::FlowMap;
use super::interval::Leg;
use super::pass::{Map, STENCIL};
use crate::error::{Deadline, Result};
use crate::fokker_planck::interpolation::{POINTS, Spline};
use crate::fokker_planck::mesh::Axis;
use crate::fokker_planck::ornstein_uhlenbeck::around;
use crate::fokker_planck::trajectory::Motion;
use crate::matrix::vectorise;
use rayon::prelude::*;

/// Places and weights of some rows of a map.
type Part<'a> = (&'a mut [u32], &'a mut [f64]);

impl FlowMap {
    /// The flow maps of several legs.
    pub(super) fn maps(&self, legs: &[Leg], late: &Deadline) -> Result<Vec<Map>> {
        /// Rows of cells traced together.
        const ROWS: usize = 8;
        let [nq, _] = self.mesh.cells();
        let total = self.rows.offsets[nq];
        let stencil = STENCIL;
        let mut sorted: Vec<usize> = (0..legs.len()).collect();
        sorted.sort_by(|a, b| {
            let by_friction = legs[*a].friction[1].total_cmp(&legs[*b].friction[1]);
            by_friction.then(legs[*a].time.total_cmp(&legs[*b].time))
        });
        let mut maps: Vec<Map> = legs
            .iter()
            .map(|_| Map {
                places: vec![0; total],
                weights: vec![0.0; total * stencil],
            })
            .collect();
        // The part of every map that belongs to a group of rows.
        let mut groups: Vec<(usize, Vec<Part>)> =
            (0..nq).step_by(ROWS).map(|row| (row, Vec::new())).collect();
        for map in &mut maps {
            let (mut places, mut weights) = (&mut map.places[..], &mut map.weights[..]);
            for (row, parts) in &mut groups {
                let end = (*row + ROWS).min(nq);
                let count = self.rows.offsets[end] - self.rows.offsets[*row];
                let (p, rest) = places.split_at_mut(count);
                places = rest;
                let (w, rest) = weights.split_at_mut(count * stencil);
                weights = rest;
                parts.push((p, w));
            }
        }
        let motion = Motion::new(self.oscillator.contact());
        let trace = |(row, parts): &mut (usize, Vec<Part>)| {
            let end = (*row + ROWS).min(nq);
            let centres = (self.mesh.q.centres(), self.mesh.v.centres());
            let cells: Vec<[f64; 2]> = (*row..end)
                .flat_map(|i| {
                    self.rows.active[i]
                        .clone()
                        .map(move |j| [centres.0[i], centres.1[j]])
                })
                .collect();
            // Legs that end alike are traced together.
            for alike in sorted.chunk_by(|a, b| legs[*a].friction[1] == legs[*b].friction[1]) {
                late()?;
                let (mut starts, mut into) = (cells.clone(), vec![1.0; cells.len()]);
                self.faster(legs[alike[0]].friction[1], 0, &mut starts, &mut into);
                let times: Vec<f64> = alike.iter().map(|k| legs[*k].time).collect();
                let mut ends = vec![[0.0; 2]; starts.len() * times.len()];
                motion.before(&starts, &times, &mut ends);
                for (ends, k) in ends.chunks_exact_mut(starts.len()).zip(alike) {
                    let mut factors = into.clone();
                    self.faster(legs[*k].friction[0], 1, ends, &mut factors);
                    let (places, weights) = &mut parts[*k];
                    vectorise!(self.stencils((ends, &factors), places, weights));
                }
            }
            Ok(())
        };
        if self.shared() {
            groups.par_iter_mut().try_for_each(trace)?;
        } else {
            groups.iter_mut().try_for_each(trace)?;
        }
        Ok(maps)
    }

    /// Takes points back over what a kick of this time does beside its matrix, before that (0) or after it (1), v to v e^x;
    /// g there is to be multiplied by these factors.
    ///
    /// Friction brings points together and raises g by e^x for it, noise lowers it as it spreads a peak one cell wide. Where friction
    /// raises more, which happens deep in contact on coarse cells, such peaks grow from step to step: there it is as strong as
    /// the two are even. That bound rises as cells become finer.
    fn faster(&self, time: f64, side: usize, points: &mut [[f64; 2]], factors: &mut [f64]) {
        /// A factor that counts for nothing, as an exponent.
        const NOTHING: f64 = -80.0;
        if time == 0.0 {
            return;
        }
        let even = self.even(time);
        for ([q, v], factor) in points.iter_mut().zip(factors) {
            let base = self.rates.at(*q);
            let x = around(self.bounded(*q, even), base, time)[side];
            let exponent = x - 0.5 * self.beta * *v * *v * (2.0 * x).exp_m1();
            if exponent > NOTHING {
                *factor *= exponent.exp();
                *v *= x.exp();
            } else {
                *factor = 0.0;
            }
        }
    }

    /// The rate of friction that raises a peak one cell wide over a kick of this time as much as noise lowers it.
    fn even(&self, time: f64) -> f64 {
        let cell = self.mesh.v.slopes()[0];
        let spread = 2.0 * self.oscillator.noise() * time / (cell * cell);
        0.5 * spread.ln_1p() / time
    }

    /// The rate of friction that cells take where they are even with noise at this one.
    fn bounded(&self, q: f64, even: f64) -> f64 {
        self.oscillator.friction(q).min(even.max(self.rates.at(q)))
    }

    /// What friction lacks of itself on cells too coarse for it, on the average over a density.
    pub(super) fn lacking(&self, density: &[f64]) -> f64 {
        let times = self.maps.iter().flat_map(|(leg, _)| leg.friction);
        let time = times.fold(0.0, f64::max);
        if time == 0.0 {
            return 0.0;
        }
        let even = self.even(time);
        let rows = density.chunks_exact(self.mesh.v.len());
        let lacking = rows.zip(self.mesh.q.centres()).map(|(row, q)| {
            let part = 1.0 - self.bounded(*q, even) / self.oscillator.friction(*q);
            if part > 0.0 {
                part * row.iter().map(|p| p.abs()).sum::<f64>()
            } else {
                0.0
            }
        });
        lacking.sum()
    }

    /// Stencils of departure points.
    #[inline(always)]
    fn stencils(
        &self,
        (ends, factors): (&[[f64; 2]], &[f64]),
        places: &mut [u32],
        weights: &mut [f64],
    ) {
        let [nq, nv] = self.mesh.cells();
        let stride = self.buffers.stride;
        let (q_axis, v_axis) = (Coordinate::of(&self.mesh.q), Coordinate::of(&self.mesh.v));
        let cells = ends.iter().zip(factors).zip(places);
        for (((end, factor), place), weights) in cells.zip(weights.chunks_exact_mut(STENCIL)) {
            let (xi, eta) = (q_axis.locate(end[0]), v_axis.locate(end[1]));
            let (iq, fq) = Spline::place(xi, nq);
            let (iv, fv) = Spline::place(eta, nv);
            *place = (iq * stride + iv) as u32;
            let inside = |x: f64, n: usize| x >= -0.5 && x <= n as f64 - 0.5;
            if self.stationary || (inside(xi, nq) && inside(eta, nv)) {
                weights[..POINTS].copy_from_slice(&self.spline.weights(fq));
                let along = self.spline.weights(fv).map(|w| w * factor);
                weights[POINTS..].copy_from_slice(&along);
            }
        }
    }
}

/// Mesh coordinate of a place, counted from the first centre.
#[derive(Clone, Copy)]
enum Coordinate<'a> {
    Uniform { first: f64, inverse: f64 },
    Mapped(&'a Axis),
}

impl<'a> Coordinate<'a> {
    fn of(axis: &'a Axis) -> Self {
        if axis.is_uniform() {
            Self::Uniform {
                first: axis.centres()[0],
                inverse: 1.0 / axis.slopes()[0],
            }
        } else {
            Self::Mapped(axis)
        }
    }

    #[inline(always)]
    fn locate(self, x: f64) -> f64 {
        match self {
            Self::Uniform { first, inverse } => (x - first) * inverse,
            Self::Mapped(axis) => axis.locate(x) - 0.5,
        }
    }
}
