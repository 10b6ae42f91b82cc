//! Initial conditions as weights on the nodes of a mesh: what each sees of the survival there.

use super::absorbed::REACH;
use super::cut::{between, cuts, from_cut};
use super::mesh::{AbsorbingMesh, Stencil};
use super::region::Region;
use crate::error::{Deadline, Result};
use crate::gaussian::{lower, normal};
use crate::quadrature::gauss;
use rayon::prelude::*;

/// Motions followed between two looks at the clock.
const BATCH: usize = 512;

/// How far a Gaussian of the velocity is integrated.
pub(super) const DEVIATIONS: f64 = 8.0;

/// The velocities at one displacement, in an integral over q.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    q: f64,
    weight: f64,
    /// Velocity below which contact is lost within half a step, and above which an upper level is passed.
    cut: f64,
    top: f64,
}

/// Initial conditions on a mesh.
pub(super) struct Starts<'a> {
    pub(super) region: &'a Region<'a>,
    pub(super) mesh: &'a AbsorbingMesh,
    pub(super) step: f64,
    /// Deviation of the velocity that a step adds, where it is least.
    pub(super) spread: f64,
    /// Asked before each batch of motions.
    pub(super) late: &'a Deadline<'a>,
}

/// Points (q, v) of a line with their weights, and what of it is lost at once.
type Part = (Vec<([f64; 2], f64)>, f64);

/// Weights on the nodes: what a start sees of the survival after a whole number of steps.
#[derive(Debug, Clone)]
pub(super) struct Start {
    pub(super) weights: Vec<f64>,
    /// Lost at once or within half a step.
    pub(super) lost: f64,
    /// The weight of everything.
    pub(super) total: f64,
}

impl Start {
    /// One point more, of this weight, that is seen from its stencil half a step on.
    fn see(&mut self, stencil: &Stencil, weight: f64, nv: usize) {
        self.total += weight;
        stencil.add(weight, &mut self.weights, nv);
    }
}

impl Starts<'_> {
    /// A start at a point.
    pub(super) fn point(&self, z: [f64; 2]) -> Result<Start> {
        let outside = z[0] < self.region.barrier.low
            || z[0] > self.region.barrier.high.unwrap_or(f64::INFINITY);
        // Beyond the level from the first, it has no weight; lost within half a step, it has.
        let lost = !outside && {
            let [cut, top] = self.cuts(&[z[0]])[0];
            z[1] < cut || z[1] > top
        };
        let alive: &[([f64; 2], f64)] = if outside || lost { &[] } else { &[(z, 1.0)] };
        self.seen(alive, f64::from(u8::from(lost)))
    }

    /// A start with independent q and v: lines of q, and a Gaussian in v.
    pub(super) fn lines(&self, lines: &[Line], mean: f64, deviation: f64) -> Result<Start> {
        let mut points = Vec::new();
        let mut lost = 0.0;
        let ends = [-DEVIATIONS, DEVIATIONS].map(|it| mean + it * deviation);
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
        self.seen(&points, lost)
    }

    /// A start with any density, `law` at one q and many v, of so short a scale in v and up to an edge; lines that weigh nothing
    /// more.
    pub(super) fn weighed(
        &self,
        lines: &[Line],
        (scale, edge): (f64, f64),
        law: &(dyn Fn(f64, &[f64]) -> Vec<f64> + Sync),
    ) -> Result<Start> {
        let scale = (2.0 * self.spread).min(scale);
        let parts: Result<Vec<Part>> = lines
            .par_iter()
            .map(
                |&Line {
                     q,
                     weight,
                     cut,
                     top,
                 }| {
                    (self.late)()?;
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
                    Ok((alive, lost))
                },
            )
            .collect();
        let parts = parts?;
        let lost = parts.iter().map(|it| it.1).sum();
        let points: Vec<([f64; 2], f64)> = parts.into_iter().flat_map(|it| it.0).collect();
        self.seen(&points, lost)
    }

    /// Lines for integrals over q in contact of `density`, which has the scale `scale`, up to
    /// the edge of the mesh.
    pub(super) fn displacements(
        &self,
        scale: f64,
        density: impl Fn(f64) -> f64,
    ) -> Result<Vec<Line>> {
        let [nq, _] = self.mesh.nodes;
        let (mut lines, rule) = (Vec::new(), gauss::<3>());
        for i in 0..nq - 1 {
            let nodes = [i, i + 1].map(|i| self.mesh.q(i));
            // A panel a cell, but none longer than the density's own scale.
            let parts = ((nodes[1] - nodes[0]) / scale).ceil().max(1.0);
            for part in 0..parts as usize {
                if part.is_multiple_of(BATCH) {
                    (self.late)()?;
                }
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
        let cuts = self.batches(&q, 64, |q| self.cuts(q))?;
        let lines = lines.into_iter().zip(cuts);
        let lines = lines.map(|((q, weight), [cut, top])| Line {
            q,
            weight,
            cut,
            top,
        });
        Ok(lines.collect())
    }

    /// What one step loses of the stationary law that carries a field u, R L_1 u: by detailed balance the
    /// probability of a loss in the step from the mirrored state, `first` being that within half a step after a kick. Small numbers
    /// keep their digits.
    pub(super) fn outflow(&self, lines: &[Line], first: &[f64]) -> Result<Start> {
        let deviation = self.region.oscillator.temperature().sqrt();
        let spread = self.spread;
        let scale = spread.min(0.5 * deviation);
        // From the mesh's edge down to where no kick takes the energy over the level: p_s rises as exp(v^2/2T) on the way there, which
        // shifts the kicks that count.
        let speed = self.mesh.speed;
        let kicked = spread * (REACH + 1.5 * spread * speed / deviation.powi(2));
        let energies = [
            0.5 * speed * speed - self.region.rise(),
            -kicked * (speed + 0.5 * kicked),
        ];
        let crossing = self.region.potential(self.region.barrier.low);
        // Each state with its mirror image.
        let mut near = Vec::new();
        let mut points = Vec::new();
        for &Line { q, weight, cut, .. } in lines {
            let law = |v: f64| weight * normal(v / deviation) / deviation;
            let at_level = crossing - self.region.potential(q);
            let [most, least] = energies.map(|it| (2.0 * (at_level + it)).max(0.0).sqrt());
            // Both ends of [cut, -cut] are roots.
            for (v, w) in from_cut(cut, [-most, -least], scale) {
                near.extend([v, -v].map(|v| ([q, v], w * law(v))));
            }
            if cut > -most {
                for (v, w) in from_cut(-cut, [-most, most], scale) {
                    points.push(([q, v], w * law(v)));
                }
            }
        }
        let states: Vec<[f64; 2]> = near.iter().map(|(z, _)| *z).collect();
        let images = self.half_a_step(&states)?;
        let nv = self.mesh.nodes[1];
        let mut it = self.seen(&points, 0.0)?;
        for (pair, images) in near.chunks_exact(2).zip(images.chunks_exact(2)) {
            let [one, other] = [0, 1].map(|k| self.mesh.stencil(images[k]));
            for (own, mirrored, (_, weight)) in [(&one, &other, pair[0]), (&other, &one, pair[1])] {
                it.see(own, weight * mirrored.value(first, nv), nv);
            }
        }
        Ok(it)
    }

    /// What enters contact in stationary motion, a unit of time: the flux v p_s(q_loss, v) of v > 0. By
    /// integration by parts in the stationary law p_s, what of it is still in contact after t is the
    /// density at t of the first loss from p_s.
    pub(super) fn entering(&self, density: f64) -> Result<Start> {
        let deviation = self.region.oscillator.temperature().sqrt();
        let scale = self.spread.min(0.5 * deviation);
        let cut = self.cuts(&[self.region.barrier.low])[0][0].max(0.0);
        // From (q_loss, 0) the survival rises as a root of v.
        let start = -f64::MIN_POSITIVE;
        let points: Vec<([f64; 2], f64)> = from_cut(cut, [start, DEVIATIONS * deviation], scale)
            .into_iter()
            .map(|(v, w)| {
                let flux = density * v * normal(v / deviation) / deviation;
                ([self.region.barrier.low, v], w * flux)
            })
            .collect();
        self.seen(&points, 0.0)
    }

    /// A function of many values, batch by batch on all threads.
    fn batches<X: Sync, Y: Clone + Send>(
        &self,
        values: &[X],
        size: usize,
        of: impl Fn(&[X]) -> Vec<Y> + Sync,
    ) -> Result<Vec<Y>> {
        let batches = values.par_chunks(size).map(|it| {
            (self.late)()?;
            Ok(of(it))
        });
        Ok(batches.collect::<Result<Vec<_>>>()?.concat())
    }

    /// Where each start is after half a step.
    fn half_a_step(&self, starts: &[[f64; 2]]) -> Result<Vec<[f64; 2]>> {
        self.batches(starts, BATCH, |it| self.region.ends(it, 0.5 * self.step))
    }

    /// The critical velocities over half a step.
    fn cuts(&self, q: &[f64]) -> Vec<[f64; 2]> {
        cuts(self.region, 0.5 * self.step, 2.0 * self.mesh.speed, q)
    }

    /// What points that outlive half a step see of the field, and the weight of those that do not.
    fn seen(&self, alive: &[([f64; 2], f64)], lost: f64) -> Result<Start> {
        let starts: Vec<[f64; 2]> = alive.iter().map(|(z, _)| *z).collect();
        let ends = self.half_a_step(&starts)?;
        let [nq, nv] = self.mesh.nodes;
        let mut it = Start {
            weights: vec![0.0; nq * nv],
            lost,
            total: lost,
        };
        for ((_, weight), end) in alive.iter().zip(ends) {
            it.see(&self.mesh.stencil(end), *weight, nv);
        }
        Ok(it)
    }
}
