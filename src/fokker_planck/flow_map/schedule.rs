//! The schedule of an interval between outputs, and the flow maps and matrices that it still lacks.

use super::interval::{Leg, Noise, Schedule};
use super::pass::{self, Blocks, Matrix};
use super::{FlowMap, splitting};
use crate::error::{Deadline, Result};
use crate::fokker_planck::ornstein_uhlenbeck::{self, Kick};
use rayon::prelude::*;

/// Where in a list the same stands; at its end, if nowhere yet.
fn place<T>(list: &mut Vec<T>, it: T, same: impl Fn(&T) -> bool) -> usize {
    list.iter().position(same).unwrap_or_else(|| {
        list.push(it);
        list.len() - 1
    })
}

impl FlowMap {
    /// The schedule of an interval, and the maps and matrices that it still lacks.
    pub(super) fn prepare(&mut self, duration: f64, late: &Deadline) -> Result<()> {
        if self.open.is_empty() {
            let [nq, nv] = self.mesh.cells();
            let open = Matrix::new((nv, self.buffers.stride), None, late)?;
            self.open = vec![(0..nq, open)];
        }
        let forced = self.forcing.as_ref().is_some_and(|it| it.acts());
        let same_time = !forced || self.schedule.start == self.now;
        if self.schedule.duration == duration && same_time {
            return Ok(());
        }
        let steps = self.settings.steps(duration);
        let tau = duration / steps;
        let (nodes, weights) = self.settings.splitting.quadrature(steps as usize);
        // Intervals between output times differ by the rounding of the times: the same maps serve.
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * duration;
        let held = self.settings.held(self.mesh.len() as f64);
        let recurs = self.forcing.as_ref().is_some_and(|it| it.recurs());
        if forced && !(recurs && self.matrices.len() <= self.most_matrices(held)) {
            // No other node does what one did, but that of the next period.
            self.matrices.clear();
        }
        // Kept: what this interval may use again.
        let (mut legs, mut noises): (Vec<Leg>, Vec<Noise>) = (
            self.maps.iter().map(|m| m.0).collect(),
            self.matrices.iter().map(|m| m.0).collect(),
        );
        // A rate that changes from place to place has no single lead.
        let lead = if self.oscillator.is_viscous() {
            let x = self.oscillator.zeta() * tau;
            splitting::lead(&nodes, &weights, steps, x)
        } else {
            0.0
        };
        // What it is more than the matrices know acts before and after.
        let beyond = if self.rates.vary { tau } else { 0.0 };
        let pace = tau * (1.0 + lead);
        let nudges = self.nudges(&nodes, (steps, tau), lead);
        let (mut before, mut left) = (0.0, 0.0);
        let mut parts = Vec::with_capacity(nodes.len());
        for (k, (node, weight)) in nodes.iter().zip(&weights).enumerate() {
            let leg = Leg {
                time: (node - before) * pace,
                friction: [left, beyond * weight],
            };
            let noise = Noise {
                duration: weight * tau,
                at: if forced { self.now + node * tau } else { 0.0 },
                lead: if forced { lead } else { 0.0 },
                nudge: nudges.get(k).copied().unwrap_or(0.0),
            };
            let motion = place(&mut legs, leg, |it| it.is(&leg, near));
            parts.push((motion, place(&mut noises, noise, |it| it.is(&noise, near))));
            (before, left) = (*node, beyond * weight);
        }
        let last = Leg {
            time: (steps - before) * pace,
            friction: [left, 0.0],
        };
        let last = place(&mut legs, last, |it| it.is(&last, near));
        if legs.len() > held && !self.maps.is_empty() {
            self.maps.clear();
            self.matrices.clear();
            return self.prepare(duration, late);
        }
        self.schedule = Schedule {
            duration,
            start: self.now,
            steps: steps as usize,
            parts,
            last,
        };
        let new = &noises[self.matrices.len()..];
        let one = |noise: &Noise| Ok((*noise, self.average(noise, late)?));
        let matrices: Result<Vec<_>> = if self.shared() {
            new.par_iter().map(one).collect()
        } else {
            new.iter().map(one).collect()
        };
        self.matrices.extend(matrices?);
        let new = &legs[self.maps.len()..];
        if !new.is_empty() {
            let maps = self.maps(new, late)?;
            self.maps.extend(new.iter().copied().zip(maps));
        }
        Ok(())
    }

    /// Matrices under a forcing that take about as much memory as so many maps.
    fn most_matrices(&self, held: usize) -> usize {
        let (map, row) = (pass::STENCIL * self.mesh.q.len(), self.buffers.stride);
        held * map / (row * self.rates.blocks(&self.mesh).len())
    }

    /// What to nudge v by at each node of an interval of `steps` steps from now on, for the kicks that a drive asks for where
    /// it begins and ends ([`Forcing`]): each is shared out between the two nodes next to it so that neither what it does to v
    /// nor what v then does to q is changed. Empty without a drive.
    fn nudges(&self, nodes: &[f64], (steps, tau): (f64, f64), lead: f64) -> Vec<f64> {
        let Some(forcing) = &self.forcing else {
            return Vec::new();
        };
        let n = nodes.len();
        let mut nudges = vec![0.0; n];
        let (begin, end) = (self.now, self.now + steps * tau);
        let [first, last] = [begin, end].map(|t| forcing.ahead(t, lead));
        if n < 2 {
            return nudges;
        }
        let shares = |near: f64, far: f64| [far / (far - near), near / (near - far)];
        let at_begin = shares(nodes[0], nodes[1]);
        let at_end = shares(steps - nodes[n - 1], steps - nodes[n - 2]);
        nudges[0] -= first * at_begin[0];
        nudges[1] -= first * at_begin[1];
        nudges[n - 1] += last * at_end[0];
        nudges[n - 2] += last * at_end[1];
        nudges
    }

    /// Friction with noise over a time.
    fn average(&self, what: &Noise, late: &Deadline) -> Result<Blocks> {
        let (axis, it) = (&self.mesh.v, &self.oscillator);
        let average = |rate: f64| {
            let kick = match &self.forcing {
                None if rate == it.reference_friction() => {
                    let (friction, temperature) = (rate * what.duration, it.temperature());
                    let stationary = self.stationary;
                    return ornstein_uhlenbeck::average(axis, friction, temperature, stationary);
                }
                None => Kick::new(rate, what.duration, (it.noise(), 0.0), self.beta),
                Some(it) => it.kick(rate, [what.at, what.duration], what.lead, self.beta),
            };
            let shift = kick.shift + what.nudge;
            Kick { shift, ..kick }.average(axis, self.stationary)
        };
        let (n, stride) = (axis.len(), self.buffers.stride);
        let blocks = self.rates.blocks(&self.mesh).into_iter();
        let matrix = |rate| Matrix::new((n, stride), Some(&average(rate)), late);
        blocks
            .map(|(rows, rate)| Ok((rows, matrix(rate)?)))
            .collect()
    }
}
