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

use super::cut::{between, critical, parts};
use super::mesh::{Contact, Stencil};
use super::region::Region;
use crate::error::{Deadline, Result};
use crate::fokker_planck::ornstein_uhlenbeck::Kick;
use crate::gaussian::normal;
use crate::matrix::{dot, vectorise};
use rayon::prelude::*;

/// Ends of the noise kernel, in deviations: beyond lies a probability of 1e-12.
pub(super) const REACH: f64 = 7.2;

/// One row q = q_i of the noise after a watched motion: u(q_i, v_j) <- sum_m K_jm u(Phi(q_i, v_m)).
#[derive(Debug, Clone)]
struct Row {
    stencils: Vec<Stencil>,
    /// Per node of v the first quadrature point its kernel reaches, and where its weights start.
    spans: Vec<(u32, u32)>,
    kernel: Vec<f64>,
}

impl Row {
    /// This row after a step, from the field before it; `moved` is room for what the noise averages.
    #[inline(always)]
    fn carry(&self, before: &[f64], moved: &mut Vec<f64>, out: &mut [f64]) {
        let nv = out.len();
        moved.resize(self.stencils.len(), 0.0);
        for (moved, stencil) in moved.iter_mut().zip(&self.stencils) {
            *moved = stencil.value(before, nv);
        }
        for (out, ends) in out.iter_mut().zip(self.spans.windows(2)) {
            let ((first, start), end) = (ends[0], ends[1].1);
            let kernel = &self.kernel[start as usize..end as usize];
            *out = dot(kernel, &moved[first as usize..]);
        }
    }
}

/// The survival of contact over one step, on a mesh.
#[derive(Debug, Clone)]
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
        mesh: &Contact,
        (step, noise): (f64, &[[f64; 2]]),
        late: &Deadline,
    ) -> Result<Self> {
        let [whole, half] = [step, 0.5 * step].map(|time| critical(region, mesh, time));
        let [nq, nv] = mesh.nodes;
        let rows: Result<Vec<Row>> = (0..nq)
            .into_par_iter()
            .map(|i| {
                late()?;
                let kicks = &noise[i * nv..(i + 1) * nv];
                let spread = least(kicks);
                let widest = kicks.iter().map(|it| it[1]).fold(0.0, f64::max);
                let edge = mesh.speed + REACH * widest;
                let points = between(whole[i], [-edge, edge], spread);
                let starts: Vec<[f64; 2]> = points.iter().map(|(v, _)| [mesh.q(i), *v]).collect();
                let ends = region.ends(&starts, step);
                let mut row = Row {
                    stencils: ends.iter().map(|end| mesh.stencil(*end)).collect(),
                    spans: Vec::with_capacity(nv),
                    kernel: Vec::new(),
                };
                for (j, &[rest, spread]) in kicks.iter().enumerate() {
                    let centre = rest * mesh.v(j);
                    let first = points.partition_point(|(v, _)| *v < centre - REACH * spread);
                    let end = points.partition_point(|(v, _)| *v <= centre + REACH * spread);
                    row.spans.push((first as u32, row.kernel.len() as u32));
                    let from = row.kernel.len();
                    row.kernel.extend(
                        points[first..end]
                            .iter()
                            .map(|(v, weight)| weight * normal((v - centre) / spread) / spread),
                    );
                    // What is not lost is carried on to rounding: losses may be rarer than 1e-14 a step.
                    let carried: f64 = row.kernel[from..].iter().sum();
                    if carried > 1e-10 {
                        let (_, held) = parts([half[i], whole[i]], centre, spread);
                        let part = held / carried;
                        row.kernel[from..].iter_mut().for_each(|k| *k *= part);
                    }
                }
                row.spans.push((0, row.kernel.len() as u32));
                Ok(row)
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
pub(super) fn kicks(region: &Region<'_>, mesh: &Contact, step: f64) -> Vec<[f64; 2]> {
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
