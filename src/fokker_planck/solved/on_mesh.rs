//! The stationary law on a mesh: the null vector of finite volumes of order 6.
//!
//! Where an impact takes most of the energy, noise alone throws the next flight: the law falls with the speed v of a return as
//! exp(-v/(2 pi h)), with the height x of a flight as exp(-c sqrt(x)), and no Gibbs law that is as narrow as contact holds it.
//! Finite volumes ask of their weights only that they change little from cell to cell. Those here fall by [`EDGE`] powers of e
//! to the edge of the domain, so that they are nearly flat in contact. Cells are as fine there as contact asks, still finer
//! where it is lost, and as much wider in flight and at high speeds as makes their number the same for any height.

use crate::error::Result;
use crate::fokker_planck::budget::{Cost, Factors, factoring, memory};
use crate::fokker_planck::difference::lagrange;
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::generator::Generator;
use crate::fokker_planck::layout::deviations;
use crate::fokker_planck::mesh::{Axis, Focus, Mesh};
use crate::fokker_planck::null_vector::null_vector;
use crate::fokker_planck::observables::Observables;
use crate::fokker_planck::policy::LADDER_RATIO;
use crate::inrush::Inrush;
use crate::matrix::dot;
use crate::moments::RawMoments;
use crate::oscillator::Oscillator;

/// Order 6, as the steady state.
const DRIFT: Drift = Drift::Order6;

/// Powers of e by which the weights fall from the lowest energy to the edge of the domain.
const EDGE: f64 = 10.0;

/// Probability of the averaged law beyond the edge of the first domain, and by how much less of each finer one; it is an upper
/// bound where impacts take much.
const BEYOND: f64 = 1e-3;
const FARTHER: f64 = 0.5;

/// Cells per deviation in contact, on the first mesh.
const PER_DEVIATION: f64 = 3.0;

/// Flights take as many cells as so many times the reach of contact, and high speeds as so many deviations on either side.
const FLIGHT: f64 = 6.0;
const FASTEST: f64 = 8.0;

/// Deviations within which cells of v are as fine as contact asks.
const SLOW: f64 = 4.0;

/// Cells where contact is lost, over those elsewhere in contact, and within which part of its reach: a jump of friction
/// leaves a low order there.
const FINER: f64 = 25.0;
const NEAR: f64 = 0.05;

/// Points of the interpolation between cells: across the loss of contact more see what bends there.
const POINTS: usize = 4;

/// The law at the centres of cells.
#[derive(Debug, Clone)]
pub(in crate::fokker_planck) struct OnMesh {
    mesh: Mesh,
    /// p, v fastest, and its integral over q at each v.
    density: Vec<f64>,
    of_v: Vec<f64>,
    /// Expectations, not divided by their mass.
    pub(super) raw: RawMoments,
    /// E\[c v^2\], which is pi h.
    pub(super) dissipated: f64,
    /// The residual of the null vector, and what it holds where no motion comes.
    pub(super) rounding: f64,
}

/// The law at one displacement: p at the centres along v.
pub(in crate::fokker_planck) struct Row<'a> {
    law: &'a OnMesh,
    pub(super) q: f64,
    values: Vec<f64>,
}

/// The oscillator with flat weights, and the mesh of a refinement.
fn laid_out(oscillator: &Oscillator, refinement: usize) -> Result<(Oscillator, Mesh)> {
    let (contact, margin) = (oscillator.contact(), DRIFT.margin());
    let rise = oscillator.averaged_within(beyond(refinement));
    let held = oscillator.of_temperature(rise / EDGE);
    // What contact asks: the deviations of the law that friction would hold everywhere.
    let cold = oscillator.of_temperature(oscillator.viscous_temperature());
    let [width, deviation] = deviations(&cold);
    let (left, right) = contact.turning_points(rise).unwrap_or((0.0, 0.0));
    let touching = cold.temperature();
    let flying = rise / FLIGHT;
    let warm = contact.turning_points(touching).unwrap_or((left, right));
    let kinks = contact.kinks();
    let near = kinks.last().map_or(width, |loss| NEAR * (warm.1 - loss));
    let focus = Focus::new(kinks.iter().map(|q| [*q, FINER - 1.0]).collect(), near);
    let per_deviation = PER_DEVIATION * LADDER_RATIO.get().powi(refinement as i32);
    let domain = [left, right];
    // Cells by the finest of a trial, but for those at the kinks.
    let none = Focus::default();
    let graded =
        |n, focus: &Focus| Axis::focused(contact, [touching, flying], domain, (n, margin), focus);
    let trial = graded(64 + 2 * margin, &none)?;
    let finest = trial.slopes().iter().copied().fold(f64::INFINITY, f64::min);
    let count = |length: f64, width: f64| (length * per_deviation / width).ceil() as usize;
    let n = count(64.0 * finest + focus.more(domain), width) + 2 * margin;
    let q = graded(n, &focus)?;
    let reach = (2.0 * rise).sqrt();
    let wider = (reach / (FASTEST * deviation)).max(1.0);
    let slow = Focus::new(vec![[0.0, wider - 1.0]], SLOW * deviation);
    let edge = reach + 0.5 * slow.more([-reach, reach]);
    let half = count(edge / wider, deviation) + margin;
    let v = Axis::focused_velocity(reach, (2 * half, margin), slow)?;
    Ok((held, Mesh { q, v }))
}

/// The displacements that a motion comes to against friction up to the highest speed of a domain of a refinement, and two
/// deviations more.
fn reached(
    oscillator: &Oscillator,
    [left, right, _, highest]: [f64; 4],
    refinement: usize,
) -> [f64; 2] {
    let cold = oscillator.of_temperature(oscillator.viscous_temperature());
    let [width, _] = deviations(&cold);
    let inrush = Inrush {
        certain: 0.0,
        highest,
        push: 0.0,
        rarity: -beyond(refinement).ln(),
    };
    let [low, high] = inrush.reach(oscillator, [left, right]);
    [low - 2.0 * width, high + 2.0 * width]
}

/// Probability of the law averaged over orbits beyond the domain of a refinement.
fn beyond(refinement: usize) -> f64 {
    BEYOND * FARTHER.powi(refinement as i32)
}

impl OnMesh {
    /// What the solve of a refinement takes.
    pub(in crate::fokker_planck) fn work(
        oscillator: &Oscillator,
        refinement: usize,
    ) -> Result<Cost> {
        let (_, mesh) = laid_out(oscillator, refinement)?;
        Ok(Cost {
            seconds: factoring(mesh.cells(), DRIFT, Factors::Real),
            memory: memory(mesh.cells(), DRIFT, Factors::Real),
            ..Cost::default()
        })
    }

    /// The law on the mesh of a refinement.
    pub(in crate::fokker_planck) fn new(
        oscillator: &Oscillator,
        refinement: usize,
    ) -> Result<Self> {
        let (held, mesh) = laid_out(oscillator, refinement)?;
        let generator = Generator::new(&held, &mesh, DRIFT)?;
        let (null, rounding) = null_vector(&generator)?;
        let observables = Observables::new(&held, &mesh, DRIFT, generator.weights())?;
        let (nv, mut g) = (mesh.v.len(), null.ratio(&generator));
        // What friction lets no motion come to holds rounding and dispersion, which a fourth power of the force would weigh.
        let [left, right] = reached(oscillator, mesh.domain(), refinement);
        let mut beyond = 0.0;
        let rows = g.chunks_exact_mut(nv).zip(null.cells().chunks_exact(nv));
        for ((g, cells), q) in rows.zip(mesh.q.centres()) {
            if *q < left || *q > right {
                g.fill(0.0);
                beyond += cells.iter().map(|p| p.abs()).sum::<f64>();
            }
        }
        let raw = observables.raw(&g);
        let mut it = Self {
            density: null.snapshot(f64::INFINITY).p.into_iter().collect(),
            of_v: vec![0.0; nv],
            raw,
            dissipated: 0.0,
            rounding: rounding + beyond,
            mesh,
        };
        let Mesh { q, v } = &it.mesh;
        let squares: Vec<f64> = v.centres().iter().map(|v| v * v).collect();
        for (i, row) in it.density.chunks_exact(nv).enumerate() {
            let (c, width) = (oscillator.friction(q.centres()[i]), q.slopes()[i]);
            for (j, p) in row.iter().enumerate() {
                it.of_v[j] += p * width;
                it.dissipated += c * squares[j] * p * width * v.slopes()[j];
            }
        }
        Ok(it)
    }

    /// Cells in q and v.
    pub(in crate::fokker_planck) fn cells(&self) -> [usize; 2] {
        self.mesh.cells()
    }

    pub(super) fn domain(&self) -> [f64; 2] {
        let [left, right, ..] = self.mesh.domain();
        [left, right]
    }

    /// Ends of intervals of v from 0 on, for sums over it.
    pub(super) fn panels(&self) -> Vec<f64> {
        let edges = self.mesh.v.edges();
        let rising = edges[self.mesh.v.len() / 2..].iter();
        rising.map(|v| v.max(0.0)).collect()
    }

    /// Places with their weights in q and in v.
    pub(super) fn quadrature(&self) -> [Vec<(f64, f64)>; 2] {
        let Mesh { q, v } = &self.mesh;
        [q, v].map(|axis| {
            let both = axis.centres().iter().zip(axis.slopes());
            both.map(|(x, w)| (*x, *w)).collect()
        })
    }

    pub(super) fn density_v(&self, v: f64) -> f64 {
        between(&self.mesh.v, v).map_or(0.0, |(first, weights)| dot(&self.of_v[first..], &weights))
    }

    pub(super) fn row(&self, q: f64) -> Row<'_> {
        let nv = self.mesh.v.len();
        let mut values = vec![0.0; nv];
        if let Some((first, weights)) = between(&self.mesh.q, q) {
            let rows = self.density.chunks_exact(nv).skip(first);
            for (row, w) in rows.zip(weights) {
                values.iter_mut().zip(row).for_each(|(x, p)| *x += w * p);
            }
        }
        Row {
            law: self,
            q,
            values,
        }
    }
}

impl Row<'_> {
    pub(super) fn density(&self, v: f64) -> f64 {
        between(&self.law.mesh.v, v)
            .map_or(0.0, |(first, weights)| dot(&self.values[first..], &weights))
    }

    /// The integral over v.
    pub(super) fn mass(&self) -> f64 {
        dot(&self.values, self.law.mesh.v.slopes())
    }
}

/// First cell and weights of the interpolation at x; None beyond the axis.
fn between(axis: &Axis, x: f64) -> Option<(usize, [f64; POINTS])> {
    let (xi, n) = (axis.locate(x), axis.len());
    if !(xi >= 0.0 && xi <= n as f64) {
        return None;
    }
    let middle = (xi - 0.5 * POINTS as f64).round().max(0.0) as usize;
    let first = middle.min(n - POINTS);
    let mut weights = [0.0; POINTS];
    lagrange(first as f64 + 0.5, xi, &mut weights);
    Some((first, weights))
}
