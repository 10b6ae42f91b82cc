//! The backward equation with the first loss of contact absorbed,
//!
//! u_t = v u_q - (2 zeta v + G) u_v + pi h u_vv in q > q_loss,  u = 0 at q = q_loss for v < 0,
//!
//! by undamped motion over tau, watched for the loss of contact, and the exact Ornstein-Uhlenbeck step in
//! between (Strang splitting). A point is lost within a motion if and only if its velocity is below the
//! critical one of its displacement, found to rounding; the noise is integrated from there upward, so no
//! stencil crosses the jump. What remains is smooth in sqrt(q - q_loss), and the mesh is uniform in it near
//! the loss point. Any other level is absorbed alike, in coordinates of its own (`region`); between two levels there is
//! a critical velocity upwards too.

use super::cut::{between, critical, parts, stencils};
use super::mesh::{AbsorbingMesh, Stencil};
use super::region::Region;
use crate::error::{Deadline, Result};
use crate::fokker_planck::ornstein_uhlenbeck::Kick;
use crate::gaussian::normal;
use crate::matrix::{dot, vectorise};
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Ends of the noise kernel, in deviations: beyond lies a probability of 1e-12.
pub(super) const REACH: f64 = 7.2;

/// Beyond so many deviations nothing is left of a probability to rounding.
const CERTAIN: f64 = 9.0;

/// Weights that are multiplied at a time.
const VECTOR: usize = 8;

/// The noise along a row: out_j = sum_m K_jm in_m over quadrature points.
#[derive(Debug)]
struct Kernel {
    /// Per node of v the first quadrature point it reaches, and where its weights start; these go on with zeros to whole
    /// vectors.
    spans: Vec<(u32, u32)>,
    weights: Vec<f64>,
}

impl Kernel {
    /// From quadrature points and their weights to the nodes of a row, given the mean and deviation of the velocity after each
    /// one's kick, and what is held of it.
    fn new(points: &[(f64, f64)], row: impl Iterator<Item = [f64; 3]>) -> Self {
        let mut it = Self {
            spans: Vec::new(),
            weights: Vec::new(),
        };
        for [centre, spread, held] in row {
            let first = points.partition_point(|(v, _)| *v < centre - REACH * spread);
            let end = points.partition_point(|(v, _)| *v <= centre + REACH * spread);
            let from = it.weights.len();
            it.spans.push((first as u32, from as u32));
            let each = points[first..end].iter();
            it.weights
                .extend(each.map(|(v, weight)| weight * normal((v - centre) / spread) / spread));
            // What is not lost is carried on to rounding: losses may be rarer than 1e-14 a step.
            let carried: f64 = it.weights[from..].iter().sum();
            if carried > 1e-10 {
                let part = held / carried;
                it.weights[from..].iter_mut().for_each(|k| *k *= part);
            }
            let whole = (end - first).next_multiple_of(VECTOR);
            it.weights.resize(from + whole, 0.0);
        }
        it.spans.push((0, it.weights.len() as u32));
        it
    }
}

/// One row q = q_i of the noise after a watched motion: u(q_i, v_j) <- sum_m K_jm u(Phi(q_i, v_m)).
#[derive(Debug)]
struct Row {
    stencils: Vec<Stencil>,
    kernel: Arc<Kernel>,
}

impl Row {
    /// This row after a step, from the field before it; `moved` is room for what the noise averages.
    #[inline(always)]
    fn carry(&self, before: &[f64], moved: &mut Vec<f64>, out: &mut [f64]) {
        let nv = out.len();
        moved.resize(self.stencils.len() + VECTOR, 0.0);
        moved[self.stencils.len()..].fill(0.0);
        for (moved, stencil) in moved.iter_mut().zip(&self.stencils) {
            *moved = stencil.value(before, nv);
        }
        let Kernel { spans, weights } = &*self.kernel;
        for (out, ends) in out.iter_mut().zip(spans.windows(2)) {
            let ((first, start), end) = (ends[0], ends[1].1);
            let weights = &weights[start as usize..end as usize];
            *out = dot(weights, &moved[first as usize..]);
        }
    }
}

/// The survival of contact over one step, on a mesh.
#[derive(Debug)]
pub(crate) struct Absorbed {
    /// Nodes of a row.
    nv: usize,
    rows: Vec<Row>,
    /// Probability of a loss within the first half step after a kick.
    first: Vec<f64>,
    /// ... between half a step and a step.
    second: Vec<f64>,
}

impl Absorbed {
    /// The maps of a step, with its [`kicks`]; `late` is asked before each row.
    ///
    /// # Errors
    /// [`Error::NoStationaryLaw`] for a contact that does not confine; those of `late`.
    pub(crate) fn new(
        region: &Region<'_>,
        mesh: &AbsorbingMesh,
        (step, noise): (f64, &[[f64; 2]]),
        late: &Deadline,
    ) -> Result<Self> {
        let [whole, half] = [step, 0.5 * step].map(|time| critical(region, mesh, time));
        let [nq, nv] = mesh.nodes;
        // Rows whose motions are far from the level, under the same noise, average alike.
        let alike = OnceLock::new();
        let rows: Result<Vec<Row>> = (0..nq)
            .into_par_iter()
            .map(|i| {
                late()?;
                let kicks = &noise[i * nv..(i + 1) * nv];
                let spread = least(kicks);
                let widest = kicks.iter().map(|it| it[1]).fold(0.0, f64::max);
                let edge = mesh.speed + REACH * widest;
                let points = between(whole[i], [-edge, edge], spread);
                let stencils = stencils(&points, (region, mesh), i, step);
                let kernel = || {
                    let row = kicks.iter().enumerate().map(|(j, &[rest, spread])| {
                        let centre = rest * mesh.v(j);
                        let (_, held) = parts([half[i], whole[i]], centre, spread);
                        [centre, spread, held]
                    });
                    Arc::new(Kernel::new(&points, row))
                };
                let certain = mesh.speed + CERTAIN * widest;
                let far = whole[i][0] < -certain && whole[i][1] > certain;
                let kernel = if far && kicks == &noise[(nq - 1) * nv..] {
                    alike.get_or_init(kernel).clone()
                } else {
                    kernel()
                };
                Ok(Row { stencils, kernel })
            })
            .collect();
        let mut first = vec![0.0; nq * nv];
        let mut second = vec![0.0; nq * nv];
        for i in 0..nq {
            for j in 0..nv {
                let [rest, spread] = noise[i * nv + j];
                let (lost, _) = parts([half[i], whole[i]], rest * mesh.v(j), spread);
                [first[i * nv + j], second[i * nv + j]] = lost;
            }
        }
        Ok(Self {
            nv,
            rows: rows?,
            first,
            second,
        })
    }

    pub(crate) fn len(&self) -> usize {
        self.first.len()
    }

    /// u <- P u, `scratch` of the same length.
    pub(crate) fn advance(&self, field: &mut Vec<f64>, scratch: &mut Vec<f64>) {
        let nv = self.nv;
        let before: &[f64] = field;
        scratch.par_chunks_mut(nv).zip(&self.rows).for_each_init(
            Vec::new,
            |moved: &mut Vec<f64>, (out, row)| {
                vectorise!(row.carry(before, moved, out));
            },
        );
        std::mem::swap(field, scratch);
    }

    /// Probability of a loss within the first half step after a kick: 1 - u after the first step.
    pub(crate) fn lost_first(&self) -> &[f64] {
        &self.first
    }

    /// What survives the first step.
    pub(crate) fn survival_first(&self) -> Vec<f64> {
        self.first.iter().map(|lost| 1.0 - lost).collect()
    }

    /// What the second step loses: u after the first less u after the second.
    pub(crate) fn lost_second(&self) -> Vec<f64> {
        let (mut field, mut scratch) = (self.first.clone(), vec![0.0; self.len()]);
        self.advance(&mut field, &mut scratch);
        for (a, b) in field.iter_mut().zip(&self.second) {
            *a += b;
        }
        field
    }
}

/// The least deviation of the velocity of some kicks.
pub(super) fn least(kicks: &[[f64; 2]]) -> f64 {
    kicks.iter().map(|it| it[1]).fold(f64::INFINITY, f64::min)
}

/// Decay and deviation of the Ornstein-Uhlenbeck step at each node.
pub(super) fn kicks(region: &Region<'_>, mesh: &AbsorbingMesh, step: f64) -> Vec<[f64; 2]> {
    let [nq, nv] = mesh.nodes;
    let of = |i: usize, j: usize| {
        let rate = region.friction_about(mesh.q(i), mesh.v(j), step);
        let kick = Kick::new(rate, step, (region.oscillator.noise(), 0.0), 0.0);
        [kick.decay, kick.deviation()]
    };
    (0..nq)
        .flat_map(|i| (0..nv).map(move |j| of(i, j)))
        .collect()
}
