//! The first passage under a drive or an envelope: the adjoint of the backward equation, forward in time.
//!
//! What changes from step to step is the kick alone, v' = a v + s + noise of this step's variance; the motion and where it
//! is absorbed stay. One step of the survival is u <- P_n u. From the last time backwards each time asked for would want a
//! run of its own; the weights of the initial condition, w <- P_n^T w, pass all times in one run, with the same numbers.

use super::absorbed::REACH;
use super::cut::{between, critical, parts, stencils};
use super::mesh::{AbsorbingMesh, Stencil};
use super::region::Region;
use super::start::Start;
use crate::error::{Deadline, Result};
use crate::fokker_planck::forcing::Forcing;
use crate::fokker_planck::ornstein_uhlenbeck::Kick;
use crate::gaussian::normal;
use rayon::prelude::*;
use std::borrow::Cow;

/// Deviation of a kick over the finest cell along v below which its average is that of three points about its mean: a
/// quadrature rule from cell to cell would not see it.
pub(super) const NEEDLE: f64 = 0.3;

/// Points of that.
pub(super) const RULE: usize = 3;

/// Parts in which rows are gathered beside each other.
pub(super) const PARTS: usize = 8;

/// A quadrature rule along v at one displacement, and where the motion takes its points.
struct Row {
    points: Vec<(f64, f64)>,
    ends: Vec<Stencil>,
}

/// What a row gives on: points after the motion with their weights, and what is lost in either half of it.
struct Given<'a> {
    ends: Cow<'a, [Stencil]>,
    weights: Vec<f64>,
    lost: [f64; 2],
}

/// The weights of an initial condition as they move.
pub(super) struct Driven<'a> {
    region: &'a Region<'a>,
    forcing: &'a Forcing,
    mesh: &'a AbsorbingMesh,
    step: f64,
    /// Critical velocities over a step and over half of it, row by row.
    whole: Vec<[f64; 2]>,
    half: Vec<[f64; 2]>,
    /// The rules in use, and the deviation that they are fine enough for.
    rows: Vec<Row>,
    fit: f64,
    weights: Vec<f64>,
    /// Kicks so far.
    kicks: u64,
    /// Rate of friction about each node.
    rates: Vec<f64>,
}

impl<'a> Driven<'a> {
    /// From a start on the same mesh.
    pub(super) fn new(
        region: &'a Region<'a>,
        mesh: &'a AbsorbingMesh,
        step: f64,
        (forcing, start): (&'a Forcing, &Start),
    ) -> Self {
        let [whole, half] = [step, 0.5 * step].map(|time| critical(region, mesh, time));
        let [nq, nv] = mesh.nodes;
        let rate = |i, j| region.friction_about(mesh.q(i), mesh.v(j), step);
        let rates = (0..nq).flat_map(|i| (0..nv).map(move |j| (i, j)));
        let rates = rates.map(|(i, j)| rate(i, j)).collect();
        Self {
            region,
            forcing,
            step,
            whole,
            half,
            rows: Vec::new(),
            fit: 0.0,
            weights: start.weights.clone(),
            kicks: 0,
            rates,
            mesh,
        }
    }

    /// The step.
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// One step: what is lost in the half motion that ends it, and in the one that begins the next.
    ///
    /// # Errors
    /// Those of `late`, which is asked before each row that is traced.
    pub(super) fn advance(&mut self, late: &Deadline) -> Result<[f64; 2]> {
        // Noise and drive gather at the middle of the step.
        let middle = (self.kicks as f64 + 0.5) * self.step;
        self.kicks += 1;
        let kick = |rate: f64| {
            let kick = self.forcing.kick(rate, [middle, self.step], 0.0, 0.0);
            let shift = self.region.seen_force(kick.shift);
            Kick { shift, ..kick }
        };
        let mut last = (self.rates[0], kick(self.rates[0]));
        let of = self.rates.iter().map(|rate| {
            if *rate != last.0 {
                last = (*rate, kick(*rate));
            }
            last.1
        });
        let kicks: Vec<Kick> = of.collect();
        let spread = kicks.iter().map(Kick::deviation);
        let [narrowest, widest] = spread.fold([f64::INFINITY, 0.0], |[low, high], it| {
            [f64::min(low, it), f64::max(high, it)]
        });
        let needle = narrowest < NEEDLE * self.mesh.finest();
        if needle {
            self.rows.clear();
        } else {
            self.lay_out([narrowest, widest], late)?;
        }
        let [nq, nv] = self.mesh.nodes;
        let this = &*self;
        let given: Result<Vec<Given<'_>>> = (0..nq)
            .into_par_iter()
            .map(|i| {
                let row = i * nv..(i + 1) * nv;
                let (weights, kicks) = (&this.weights[row.clone()], &kicks[row]);
                if weights.iter().all(|w| *w == 0.0) {
                    return Ok(Given {
                        ends: Cow::Borrowed(&[]),
                        weights: Vec::new(),
                        lost: [0.0; 2],
                    });
                }
                late()?;
                Ok(if needle {
                    this.by_points(i, weights, kicks)
                } else {
                    this.by_rule(i, weights, kicks)
                })
            })
            .collect();
        let given = given?;
        let mut lost = [0.0; 2];
        for row in &given {
            for (sum, part) in lost.iter_mut().zip(row.lost) {
                *sum += part;
            }
        }
        // Part by part, in the order of the rows: the same bits on any number of threads.
        let parts: Vec<Vec<f64>> = given
            .par_chunks(nq.div_ceil(PARTS))
            .map(|rows| {
                let mut next = vec![0.0; nq * nv];
                for row in rows {
                    for (end, weight) in row.ends.iter().zip(&row.weights) {
                        end.add(*weight, &mut next, nv);
                    }
                }
                next
            })
            .collect();
        drop(given);
        self.weights.fill(0.0);
        for next in parts {
            for (sum, part) in self.weights.iter_mut().zip(next) {
                *sum += part;
            }
        }
        Ok(lost)
    }

    /// Rules fine enough for a kick. Those at hand serve up to twice their deviation.
    fn lay_out(&mut self, [narrowest, widest]: [f64; 2], late: &Deadline) -> Result<()> {
        if !self.rows.is_empty() && narrowest >= self.fit && narrowest <= 2.0 * self.fit {
            return Ok(());
        }
        // Noise that fades fits these for some time.
        self.fit = if self.fit > 0.0 && narrowest < self.fit {
            0.5 * narrowest
        } else {
            narrowest
        };
        let (fit, step, swing) = (self.fit, self.step, self.forcing.excitation());
        let push = swing.drive.map_or(0.0, |it| it.amplitude()) * step;
        let edge = self.mesh.speed + 2.0 * REACH * fit.max(widest) + push;
        let (region, mesh, whole) = (self.region, self.mesh, &self.whole);
        let rows: Result<Vec<Row>> = (0..mesh.nodes[0])
            .into_par_iter()
            .map(|i| {
                late()?;
                let points = between(whole[i], [-edge, edge], fit);
                let ends = stencils(&points, (region, mesh), i, step);
                Ok(Row { points, ends })
            })
            .collect();
        self.rows = rows?;
        Ok(())
    }

    /// Passes on the mean and deviation of each node's kick, its weight and the share that is not lost; gives what is lost.
    fn each_node(
        &self,
        i: usize,
        weights: &[f64],
        kicks: &[Kick],
        mut pass: impl FnMut([f64; 2], f64, f64),
    ) -> [f64; 2] {
        let mut lost = [0.0; 2];
        for (j, (weight, kick)) in weights.iter().zip(kicks).enumerate() {
            if *weight == 0.0 {
                continue;
            }
            let spread = kick.deviation();
            let centre = kick.decay * self.mesh.v(j) + kick.shift;
            let (gone, held) = parts([self.half[i], self.whole[i]], centre, spread);
            for (sum, part) in lost.iter_mut().zip(gone) {
                *sum += weight * part;
            }
            pass([centre, spread], *weight, held);
        }
        lost
    }

    /// A row by its quadrature rule.
    fn by_rule(&self, i: usize, weights: &[f64], kicks: &[Kick]) -> Given<'_> {
        let row = &self.rows[i];
        let mut carried = vec![0.0; row.points.len()];
        let mut kernel = Vec::new();
        let lost = self.each_node(i, weights, kicks, |[centre, spread], weight, held| {
            let first = row
                .points
                .partition_point(|(v, _)| *v < centre - REACH * spread);
            let each = 1.0 / spread;
            kernel.clear();
            kernel.extend(
                row.points[first..]
                    .iter()
                    .take_while(|(v, _)| *v <= centre + REACH * spread)
                    .map(|(v, w)| w * each * normal((v - centre) * each)),
            );
            let sum: f64 = kernel.iter().sum();
            // What is not lost is carried on to rounding.
            let part = weight * if sum > 1e-10 { held / sum } else { 1.0 };
            for (x, k) in carried[first..].iter_mut().zip(&kernel) {
                *x += part * k;
            }
        });
        Given {
            ends: Cow::Borrowed(&row.ends),
            weights: carried,
            lost,
        }
    }

    /// A row node by node: three points of the Gauss-Hermite rule about each mean, or that mean alone.
    fn by_points(&self, i: usize, weights: &[f64], kicks: &[Kick]) -> Given<'_> {
        let rule: [(f64, f64); RULE] = [
            (-3f64.sqrt(), 1.0 / 6.0),
            (0.0, 2.0 / 3.0),
            (3f64.sqrt(), 1.0 / 6.0),
        ];
        let [low, high] = self.whole[i];
        let (mut starts, mut shares) = (Vec::new(), Vec::new());
        let lost = self.each_node(i, weights, kicks, |[centre, spread], weight, held| {
            let rule = if spread > 0.0 {
                &rule[..]
            } else {
                &[(0.0, 1.0)]
            };
            let alive = rule
                .iter()
                .map(|(x, w)| (centre + spread * x, w))
                .filter(|(v, _)| *v > low && *v < high);
            let alive: Vec<(f64, &f64)> = alive.collect();
            let sum: f64 = alive.iter().map(|it| it.1).sum();
            for (v, w) in alive {
                starts.push([self.mesh.q(i), v]);
                shares.push(weight * held * w / sum);
            }
        });
        let ends = self.region.ends(&starts, self.step).into_iter();
        let ends = ends.map(|end| self.mesh.stencil(end));
        Given {
            ends: ends.collect(),
            weights: shares,
            lost,
        }
    }
}
