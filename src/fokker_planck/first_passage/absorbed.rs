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

use super::cut::{between, critical, cuts, from_cut};
use super::mesh::{Contact, Fineness, Stencil};
use super::region::Region;
use crate::error::Result;
use crate::fokker_planck::ornstein_uhlenbeck::Kick;
use crate::matrix::dot;
use crate::quadrature::gauss;
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

/// A row after a step, from the field before it; `moved` is room for what the noise averages.
struct Carry<'a> {
    row: &'a Row,
    before: &'a [f64],
    moved: &'a mut Vec<f64>,
    out: &'a mut [f64],
}

impl pulp::WithSimd for Carry<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let nv = self.out.len();
        self.moved.resize(self.row.stencils.len(), 0.0);
        for (moved, stencil) in self.moved.iter_mut().zip(&self.row.stencils) {
            *moved = stencil.value(self.before, nv);
        }
        for (out, ends) in self.out.iter_mut().zip(self.row.spans.windows(2)) {
            let ((first, start), end) = (ends[0], ends[1].1);
            let kernel = &self.row.kernel[start as usize..end as usize];
            *out = dot(kernel, &self.moved[first as usize..]);
        }
    }
}

/// The survival of contact over one step, on a mesh.
#[derive(Debug, Clone)]
pub(crate) struct Absorbed {
    mesh: Contact,
    rows: Vec<Row>,
    /// Deviation of the velocity that a step adds.
    spread: f64,
    step: f64,
    /// Probability of a loss within the first half step after a kick.
    first: Vec<f64>,
    /// ... between half a step and a step.
    second: Vec<f64>,
    loss: f64,
    high: f64,
}

/// The velocities at one displacement, in an integral over q.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    q: f64,
    weight: f64,
    /// Velocity below which contact is lost within half a step, and above which an upper level is passed.
    cut: f64,
    top: f64,
}

/// Points (q, v) of a line with their weights, and what of it is lost at once.
type Part = (Vec<([f64; 2], f64)>, f64);

/// Weights on the nodes: what a start sees of the survival after a whole number of steps.
#[derive(Debug, Clone)]
pub(crate) struct Start {
    pub(crate) weights: Vec<f64>,
    /// Lost at once or within half a step.
    pub(crate) lost: f64,
    /// The weight of everything.
    pub(crate) total: f64,
}

impl Absorbed {
    /// The maps of a step; `late` is asked before each row.
    ///
    /// # Errors
    /// [`Error::NoStationaryLaw`] for a contact that does not confine; those of `late`.
    pub(crate) fn new(
        region: &Region<'_>,
        fineness: &Fineness,
        late: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<Self> {
        let mesh = Contact::new(region, fineness)?;
        let step = fineness.step;
        // Decay and deviation of the Ornstein-Uhlenbeck step, row by row where friction depends on the displacement.
        let noise: Vec<[f64; 2]> = (0..fineness.nodes[0])
            .map(|i| kick(region, mesh.q(i), step))
            .collect();
        let spread = noise.iter().map(|it| it[1]).fold(f64::INFINITY, f64::min);
        let [whole, half] = [step, 0.5 * step].map(|time| critical(region, &mesh, time));
        let [nq, nv] = mesh.nodes;
        let rows: Result<Vec<Row>> = (0..nq)
            .into_par_iter()
            .map(|i| {
                late()?;
                let [rest, spread] = noise[i];
                let [low, high] = whole[i];
                let edge = mesh.speed + REACH * spread;
                let points = between([low, high], [-edge, edge], spread);
                let starts: Vec<[f64; 2]> = points.iter().map(|(v, _)| [mesh.q(i), *v]).collect();
                let ends = region.ends(&starts, step);
                let mut row = Row {
                    stencils: ends.iter().map(|end| mesh.stencil(*end)).collect(),
                    spans: Vec::with_capacity(nv),
                    kernel: Vec::new(),
                };
                for j in 0..nv {
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
                        let above = lower((centre - high) / spread);
                        let part = (lower((centre - low) / spread) - above) / carried;
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
                let [rest, spread] = noise[i];
                // A difference of tails, taken on the side where they are small.
                let gap = |half: f64, whole: f64, v: f64| {
                    let (a, b) = (half - rest * v, whole - rest * v);
                    if a + b > 0.0 {
                        lower(-a / spread) - lower(-b / spread)
                    } else {
                        lower(b / spread) - lower(a / spread)
                    }
                };
                let v = mesh.v(j);
                first[i * nv + j] = lower((half[i][0] - rest * v) / spread);
                second[i * nv + j] = gap(half[i][0], whole[i][0], v);
                if half[i][1] < f64::INFINITY || whole[i][1] < f64::INFINITY {
                    first[i * nv + j] += lower((rest * v - half[i][1]) / spread);
                    second[i * nv + j] += gap(-half[i][1], -whole[i][1], -v);
                }
            }
        }
        Ok(Self {
            mesh,
            rows: rows?,
            spread,
            step,
            first,
            second,
            loss: region.barrier.low,
            high: region.barrier.high.unwrap_or(f64::INFINITY),
        })
    }

    pub(crate) fn len(&self) -> usize {
        self.first.len()
    }

    /// u <- P u, `scratch` of the same length.
    pub(crate) fn advance(&self, field: &mut Vec<f64>, scratch: &mut Vec<f64>) {
        let nv = self.mesh.nodes[1];
        let before: &[f64] = field;
        scratch.par_chunks_mut(nv).zip(&self.rows).for_each_init(
            Vec::new,
            |moved: &mut Vec<f64>, (out, row)| {
                pulp::Arch::new().dispatch(Carry {
                    row,
                    before,
                    moved,
                    out,
                });
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

    /// A start at a point.
    pub(crate) fn point(&self, region: &Region<'_>, z: [f64; 2]) -> Start {
        let outside = z[0] < self.loss || z[0] > self.high;
        // Beyond the level from the first, it has no weight; lost within half a step, it has.
        let lost = !outside && {
            let [cut, top] = self.cuts(region, &[z[0]])[0];
            z[1] < cut || z[1] > top
        };
        let alive: &[([f64; 2], f64)] = if outside || lost { &[] } else { &[(z, 1.0)] };
        self.seen(region, alive, f64::from(u8::from(lost)))
    }

    /// A start with independent q and v: lines of q, and a Gaussian in v.
    pub(crate) fn lines(
        &self,
        region: &Region<'_>,
        lines: &[Line],
        mean: f64,
        deviation: f64,
    ) -> Start {
        let mut points = Vec::new();
        let mut lost = 0.0;
        let ends = [mean - 8.0 * deviation, mean + 8.0 * deviation];
        // Survival has the scale of the noise, the start that of its deviation.
        let scale = (2.0 * self.spread).min(0.5 * deviation);
        for &Line {
            q,
            weight,
            cut,
            top,
        } in lines
        {
            for (v, w) in between([cut, top], ends, scale) {
                points.push((
                    [q, v],
                    weight * w * normal((v - mean) / deviation) / deviation,
                ));
            }
            lost += weight * (lower((cut - mean) / deviation) + lower((mean - top) / deviation));
        }
        self.seen(region, &points, lost)
    }

    /// A start with any density, `law` at one q and many v, of the scale `deviation` in v; lines that weigh nothing more.
    pub(crate) fn weighed(
        &self,
        region: &Region<'_>,
        lines: &[Line],
        deviation: f64,
        law: &(dyn Fn(f64, &[f64]) -> Vec<f64> + Sync),
    ) -> Start {
        let edge = 8.0 * deviation;
        let scale = (2.0 * self.spread).min(0.5 * deviation);
        let parts: Vec<Part> = lines
            .par_iter()
            .map(
                |&Line {
                     q,
                     weight,
                     cut,
                     top,
                 }| {
                    let alive = between([cut, top], [-edge, edge], scale);
                    let speeds: Vec<f64> = alive.iter().map(|it| it.0).collect();
                    let alive = alive.into_iter().zip(law(q, &speeds));
                    let alive = alive.map(|((v, w), p)| ([q, v], weight * w * p)).collect();
                    // Those that are lost at once, below the cut and above the upper one.
                    let (low, high) = (cut.clamp(-edge, edge), top.clamp(-edge, edge));
                    let mut gone = from_cut(-edge, [-edge, low], scale);
                    gone.extend(from_cut(high, [high, edge], scale));
                    let speeds: Vec<f64> = gone.iter().map(|it| it.0).collect();
                    let gone = gone.iter().zip(law(q, &speeds));
                    let lost: f64 = gone.map(|((_, w), p)| weight * w * p).sum();
                    (alive, lost)
                },
            )
            .collect();
        let lost = parts.iter().map(|it| it.1).sum();
        let points: Vec<([f64; 2], f64)> = parts.into_iter().flat_map(|it| it.0).collect();
        self.seen(region, &points, lost)
    }

    /// Lines for integrals over q in contact of `density`, which has the scale `scale`, up to
    /// the edge of the mesh.
    pub(crate) fn displacements(
        &self,
        region: &Region<'_>,
        scale: f64,
        density: impl Fn(f64) -> f64,
    ) -> Vec<Line> {
        let [nq, _] = self.mesh.nodes;
        let (mut lines, rule) = (Vec::new(), gauss::<4>());
        for i in 0..nq - 1 {
            let nodes = [i, i + 1].map(|i| self.mesh.q(i));
            // A panel a cell, but none longer than the density's own scale.
            let parts = ((nodes[1] - nodes[0]) / scale).ceil().max(1.0);
            for part in 0..parts as usize {
                let width = self.mesh.spacing[0] / parts;
                let low = i as f64 * self.mesh.spacing[0] + part as f64 * width;
                for (x, w) in rule {
                    let y = low + 0.5 * width * (1.0 + x);
                    let (q, slope) = self.mesh.place(y);
                    let weight = match self.mesh.middle {
                        Some(_) => 0.5 * width * w * slope * density(q),
                        None => {
                            let root = (1.0 + y * y).sqrt();
                            0.5 * width * w * self.mesh.bend * y / root * density(q)
                        }
                    };
                    // What would underflow in any sum.
                    if weight > 1e-300 {
                        lines.push((q, weight));
                    }
                }
            }
        }
        let q: Vec<f64> = lines.iter().map(|line| line.0).collect();
        let cuts: Vec<[f64; 2]> = q
            .par_chunks(64)
            .flat_map_iter(|q| self.cuts(region, q))
            .collect();
        lines
            .into_iter()
            .zip(cuts)
            .map(|((q, weight), [cut, top])| Line {
                q,
                weight,
                cut,
                top,
            })
            .collect()
    }

    /// What one step loses of the stationary law that carries a field u, R L_1 u: by detailed balance the
    /// probability of a loss in the step from the mirrored state. Small numbers keep their digits.
    pub(crate) fn outflow(&self, region: &Region<'_>, lines: &[Line]) -> Start {
        let deviation = region.oscillator.temperature().sqrt();
        let ends = [-8.0 * deviation, 8.0 * deviation];
        let scale = self.spread.min(0.5 * deviation);
        let mut near = Vec::new();
        let mut points = Vec::new();
        for &Line { q, weight, cut, .. } in lines {
            let law = |v: f64| weight * normal(v / deviation) / deviation;
            // Both ends of [cut, -cut] are roots.
            if cut > ends[0] {
                for (v, w) in from_cut(cut, [ends[0], 0.0], scale) {
                    near.push(([q, v], w * law(v)));
                    near.push(([q, -v], w * law(v)));
                }
                for (v, w) in from_cut(-cut, ends, scale) {
                    points.push(([q, v], w * law(v)));
                }
            } else {
                near.extend(
                    from_cut(cut, ends, scale)
                        .into_iter()
                        .map(|(v, w)| ([q, v], w * law(v))),
                );
            }
        }
        let mirrored: Vec<[f64; 2]> = near.iter().map(|(z, _)| [z[0], -z[1]]).collect();
        let images = region.ends(&mirrored, 0.5 * self.step);
        let nv = self.mesh.nodes[1];
        points.extend(near.iter().zip(images).map(|((z, weight), image)| {
            (*z, weight * self.mesh.stencil(image).value(&self.first, nv))
        }));
        self.seen(region, &points, 0.0)
    }

    /// What enters contact in stationary motion, a unit of time: the flux v p_s(q_loss, v) of v > 0. By
    /// integration by parts in the stationary law p_s, what of it is still in contact after t is the
    /// density at t of the first loss from p_s.
    pub(crate) fn entering(&self, region: &Region<'_>, density: f64) -> Start {
        let deviation = region.oscillator.temperature().sqrt();
        let scale = self.spread.min(0.5 * deviation);
        let cut = self.cuts(region, &[self.loss])[0][0].max(0.0);
        // From (q_loss, 0) the survival rises as a root of v.
        let start = -f64::MIN_POSITIVE;
        let points: Vec<([f64; 2], f64)> = from_cut(cut, [start, 8.0 * deviation], scale)
            .into_iter()
            .map(|(v, w)| {
                let flux = density * v * normal(v / deviation) / deviation;
                ([self.loss, v], w * flux)
            })
            .collect();
        self.seen(region, &points, 0.0)
    }

    /// The critical velocities over half a step.
    fn cuts(&self, region: &Region<'_>, q: &[f64]) -> Vec<[f64; 2]> {
        cuts(region, 0.5 * self.step, 2.0 * self.mesh.speed, q)
    }

    /// What points that outlive half a step see of the field, and the weight of those that do not.
    fn seen(&self, region: &Region<'_>, alive: &[([f64; 2], f64)], lost: f64) -> Start {
        let starts: Vec<[f64; 2]> = alive.iter().map(|(z, _)| *z).collect();
        let ends = region.ends(&starts, 0.5 * self.step);
        let mut it = Start {
            weights: vec![0.0; self.len()],
            lost,
            total: lost,
        };
        for ((_, weight), end) in alive.iter().zip(ends) {
            it.total += weight;
            let stencil = self.mesh.stencil(end);
            stencil.add(*weight, &mut it.weights, self.mesh.nodes[1]);
        }
        it
    }
}

/// Decay and deviation of the Ornstein-Uhlenbeck step at a displacement.
fn kick(region: &Region<'_>, x: f64, step: f64) -> [f64; 2] {
    let noise = region.oscillator.noise();
    let kick = Kick::new(region.friction(x), step, (noise, 0.0), 0.0);
    [kick.decay, kick.deviation()]
}

/// Standard normal density.
pub(super) fn normal(x: f64) -> f64 {
    (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt()
}

/// Standard normal distribution function, relative accuracy kept in the lower tail.
pub(super) fn lower(x: f64) -> f64 {
    0.5 * libm::erfc(-x / std::f64::consts::SQRT_2)
}
