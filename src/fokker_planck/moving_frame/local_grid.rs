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
//!
//! In time (6,2), H(c1) O(5/18) H(c2) O(8/18) H(c2) O(5/18) H(c1). Its error zeta^2 tau^2 comes from
//! [O, [O, H]], which is 4 zeta^2 H: friction stretches the two halves of H, v d/dq and G d/dv, by inverse
//! factors, and the terms of friction with noise cancel. So the step only runs the motion at a slightly
//! wrong rate, and durations of H times
//!
//! ```text
//! (sinh x / x) / (2 c1 cosh x + 2 c2 cosh(4x/9)),   x = zeta tau
//! ```
//!
//! take it away.

use super::frame::Frame;
use super::interpolant::Interpolant;
use super::linear::Linear;
use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use crate::fokker_planck::forcing::Forcing;
use crate::fokker_planck::interpolation::{MARGIN, reflected};
use crate::fokker_planck::mesh::Axis;
use crate::fokker_planck::ornstein_uhlenbeck::{Kick, around, average};
use crate::fokker_planck::trajectory::Motion;
use crate::initial::Initial;
use crate::moments::{Moments, RawMoments};
use crate::noise_free;
use crate::oscillator::Oscillator;
use crate::quadrature::KronrodNodes;
use std::f64::consts::TAU;
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
}

/// A concentrated density on its own grid in its own frame.
#[derive(Debug, Clone)]
pub(crate) struct LocalGrid {
    contact: ContactLaw,
    zeta: f64,
    /// pi h.
    noise: f64,
    /// What there is beside stationary noise.
    forcing: Option<Arc<Forcing>>,
    /// Where friction depends on the displacement.
    local: Option<Oscillator>,
    fineness: Fineness,
    axis: Axis,
    frame: Frame,
    /// P at the centres, xi_1 by xi_2, n x n.
    values: Vec<f64>,
    /// How a point spreads, and for how long that may be believed; for the first step.
    linear: Option<(Linear, f64)>,
    time: f64,
    steps: u64,
    defect: f64,
    spline: Interpolant,
    /// Working space: n x n values, the points of the mesh and where they come from.
    other: Vec<f64>,
    points: Vec<[f64; 2]>,
    origins: Vec<[f64; 2]>,
}
/// Nodes of the three-point Gauss rule are at c1, 1/2, 1 - c1; c2 = 1/2 - c1.
const C1: f64 = 0.112_701_665_379_258_3;
const C2: f64 = 0.5 - C1;
/// Deviations beyond which a square is widened no more: twice what a Gaussian needs at 1e-5, four times the
/// cells.
const FARTHEST: f64 = 18.0;
const WEIGHTS: [f64; 3] = [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0];

/// Gauss-Hermite frame of a standard normal.
const STANDARD: Frame = Frame {
    mean: [0.0; 2],
    lower: [1.0, 0.0, 1.0],
};

impl LocalGrid {
    /// The local grid of a Gaussian initial condition, or of a point at rest. The point's first step, of `early` at
    /// most, is that of the oscillator linearised there: what it leaves out is of the order of h early^4.
    ///
    /// # Errors
    /// [`Error::NotAvailable`] for a stationary start.
    pub(crate) fn new(
        oscillator: &Oscillator,
        initial: &Initial,
        early: f64,
        fineness: Fineness,
    ) -> Result<Self> {
        let (frame, linear) = match *initial {
            Initial::Gaussian {
                mean,
                deviation: [q, v],
            } => (
                Frame {
                    mean,
                    lower: [q, 0.0, v],
                },
                None,
            ),
            Initial::Rest => (
                Frame {
                    mean: [0.0; 2],
                    lower: [0.0; 3],
                },
                Some((Linear::of(oscillator), early)),
            ),
            Initial::Stationary => {
                return Err(Error::not_available(
                    "a moving local grid from the stationary law",
                    "a \"gaussian\" initial condition or \"rest\"",
                ));
            }
        };
        let half = (fineness.reach / fineness.cell).ceil();
        let n = 2 * half as usize;
        let axis = Axis::uniform(-half * fineness.cell, half * fineness.cell, n)?;
        let normal = |x: f64| (-0.5 * x * x).exp() / TAU.sqrt();
        let centres = axis.centres();
        let values: Vec<f64> = centres
            .iter()
            .flat_map(|x| centres.iter().map(move |y| normal(*x) * normal(*y)))
            .collect();
        let mut it = Self {
            contact: oscillator.contact().clone(),
            zeta: oscillator.zeta(),
            noise: oscillator.noise(),
            forcing: None,
            local: (!oscillator.is_viscous()).then(|| oscillator.clone()),
            fineness,
            spline: Interpolant::new(&axis),
            axis,
            frame,
            other: values.clone(),
            values,
            linear,
            time: 0.0,
            steps: 0,
            defect: 0.0,
            points: vec![[0.0; 2]; n * n],
            origins: vec![[0.0; 2]; n * n],
        };
        it.interpolate();
        Ok(it)
    }

    /// The same under a drive or an envelope. A point stays one, and moves as one, until the noise begins.
    pub(crate) fn forced(mut self, oscillator: &Oscillator, forcing: Option<Arc<Forcing>>) -> Self {
        if let Some((linear, _)) = &mut self.linear {
            linear.forced = forcing.clone().map(|it| (oscillator.clone(), it));
        }
        self.forcing = forcing;
        self
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
        let Fineness { step, beside, .. } = self.fineness;
        let coarser = (duration / (beside * step) - 1e-9).ceil().max(1.0);
        (beside * coarser).ceil() as u64
    }

    /// The first moments of a point's time: it becomes a Gaussian, `left` from now at most.
    pub(crate) fn leave_point(&mut self, left: f64) {
        let Some((mut linear, early)) = self.linear.take() else {
            return;
        };
        if let Some((oscillator, forcing)) = linear.forced.clone() {
            let end = self.time + left;
            let begin = forcing.excitation().noise_from().clamp(self.time, end);
            let times = [self.time, begin];
            self.frame.mean =
                noise_free::motion(&oscillator, forcing.excitation(), self.frame.mean, times);
            self.time = begin;
            if begin >= end {
                self.linear = Some((linear, early));
                return;
            }
            let first = early.min(end - begin);
            // No noise before, and all of it linear in time up to its next bend.
            let first = forcing
                .excitation()
                .bends(begin, begin + first)
                .next()
                .map_or(first, |t| t - begin);
            linear.moved(&oscillator, self.frame.mean[0]);
            self.frame = linear.forced_after(self.frame.mean, begin, first);
            self.time = begin + first;
        } else {
            self.time = early.min(left);
            self.frame = linear.after(self.time);
        }
        self.steps += 1;
    }

    /// Sets the time to `t`, where the steps led but for rounding.
    pub(crate) fn arrive(&mut self, t: f64) {
        self.time = t;
    }

    pub(crate) fn advance(&mut self, tau: f64) {
        // A rate that changes from place to place does not run the motion at one wrong rate.
        let x = self.local.as_ref().map_or(self.zeta * tau, |_| 0.0);
        let stretched = if x > 1e-4 {
            x.sinh() / x
        } else {
            1.0 + x * x / 6.0
        };
        let rate = tau * stretched / (2.0 * C1 * x.cosh() + 2.0 * C2 * (4.0 / 9.0 * x).cosh());
        let (start, lead) = (self.time, rate / tau - 1.0);
        let ahead = |t: f64| self.forcing.as_ref().map_or(0.0, |it| it.ahead(t, lead));
        let [first, last] = [start, start + tau].map(ahead);
        if self.forcing.is_some() {
            self.frame.mean[1] -= first;
        }
        for ((gap, weight), node) in [C1, C2, C2]
            .into_iter()
            .zip(WEIGHTS)
            .zip([C1, 0.5, 1.0 - C1])
        {
            self.carry(gap * rate);
            self.spread(start + node * tau, weight * tau, lead);
        }
        self.carry(C1 * rate);
        if self.forcing.is_some() {
            self.frame.mean[1] += last;
        }
        self.time += tau;
        self.steps += 1;
    }

    /// The largest |P| on the border of the square.
    fn border(&self) -> f64 {
        let n = self.axis.len();
        let largest = |values: &mut dyn Iterator<Item = &f64>| {
            values.fold(0.0_f64, |largest, p| largest.max(p.abs()))
        };
        let first_and_last = self.values[..n].iter().chain(&self.values[n * (n - 1)..]);
        let sides = self
            .values
            .chunks_exact(n)
            .flat_map(|row| [&row[0], &row[n - 1]]);
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

    /// H over `duration`.
    fn carry(&mut self, duration: f64) {
        if self.fineness.reach < FARTHEST && self.border() > self.fineness.border {
            self.widen();
        }
        let motion = Motion::new(&self.contact);
        let law = self.law();
        let target = self.frame.image(&law, |points| {
            let mut images = [[0.0; 2]; 9];
            motion.after(points, &[duration], &mut images);
            images
        });
        let centres = self.axis.centres();
        let nodes = centres
            .iter()
            .flat_map(|x| centres.iter().map(move |y| [*x, *y]));
        for (point, xi) in self.points.iter_mut().zip(nodes) {
            *point = target.at(xi);
        }
        motion.before(&self.points, &[duration], &mut self.origins);
        let ratio = target.area() / self.frame.area();
        self.spline
            .sample(&self.frame, ratio, &self.origins, &mut self.values);
        self.frame = target;
        // What interpolation did to the mass.
        let cell = self.fineness.cell;
        let mass = self.values.iter().sum::<f64>() * cell * cell;
        self.defect += (mass - 1.0).abs();
        for p in &mut self.values {
            *p /= mass;
        }
        self.interpolate();
    }

    /// O over `duration`, time frozen at `t`, in steps with this `lead`. Where friction depends on the displacement, that at
    /// the mean between what it is more elsewhere.
    fn spread(&mut self, t: f64, duration: f64, lead: f64) {
        let local = self.local.take();
        let mean = self.frame.mean[0];
        let rate = local
            .as_ref()
            .map_or(2.0 * self.zeta, |it| it.friction(mean));
        let kick = match &self.forcing {
            Some(it) => it.kick(rate, [t, duration], lead, 0.0),
            None => Kick::new(rate, duration, (self.noise, 0.0), 0.0),
        };
        if let Some(oscillator) = &local {
            let more = |q: f64| around(oscillator.friction(q), rate, duration);
            self.slow(|q| more(q)[0]);
            self.spread_by(kick);
            self.slow(|q| more(q)[1]);
        } else {
            self.spread_by(kick);
        }
        self.local = local;
    }

    /// Velocities over e^x, x a function of the displacement.
    fn slow(&mut self, x: impl Fn(f64) -> f64) {
        let n = self.axis.len();
        let centres = self.axis.centres();
        let factors: Vec<f64> = centres
            .iter()
            .map(|xi| x(self.frame.at([*xi, 0.0])[0]))
            .collect();
        if factors.iter().all(|x| x.abs() < 1e-13) {
            return;
        }
        for ((i, x), xi) in factors.iter().enumerate().zip(centres) {
            let row = i * n..(i + 1) * n;
            for (point, eta) in self.origins[row.clone()].iter_mut().zip(centres) {
                let [q, v] = self.frame.at([*xi, *eta]);
                *point = [q, v * x.exp()];
            }
            let (points, values) = (&self.origins[row.clone()], &mut self.values[row]);
            self.spline.sample(&self.frame, x.exp(), points, values);
        }
        self.interpolate();
    }

    /// O at one rate.
    fn spread_by(&mut self, kick: Kick) {
        let n = self.axis.len();
        let (a, variance) = (kick.decay, kick.variance);
        let [qq, vq, vv] = self.frame.lower;
        let widened = (a * a * vv * vv + variance).sqrt();
        self.frame.mean[1] = a * self.frame.mean[1] + kick.shift;
        self.frame.lower = [qq, a * vq, widened];
        if variance == 0.0 {
            // The frame contracts, and P in it stays.
            return;
        }
        // rho = a L_vv/L_vv' = e^{-rate}.
        let rate = 0.5 * (variance / (a * a * vv * vv)).ln_1p();
        let matrix = average(&self.axis, rate, 1.0, false);
        let width = n + 2 * MARGIN;
        // Coefficients along xi_2 of values along xi_1.
        self.spline.along(true, &self.values, &mut self.other);
        let mut padded = vec![0.0; width];
        for (row, out) in self
            .other
            .chunks_exact(n)
            .zip(self.values.chunks_exact_mut(n))
        {
            for (k, x) in padded.iter_mut().enumerate() {
                *x = row[reflected(k, n)];
            }
            for (y, weights) in out.iter_mut().zip(matrix.chunks_exact(width)) {
                *y = weights.iter().zip(&padded).map(|(w, x)| w * x).sum();
            }
        }
        self.interpolate();
    }

    /// Mean and triangular factor of P in xi.
    fn law(&self) -> Frame {
        let centres = self.axis.centres();
        let mut sums = [0.0; 6];
        for (row, x) in self.values.chunks_exact(centres.len()).zip(centres) {
            for (p, y) in row.iter().zip(centres) {
                for (sum, f) in sums.iter_mut().zip([1.0, *x, *y, x * x, x * y, y * y]) {
                    *sum += p * f;
                }
            }
        }
        let [m, x, y, xx, xy, yy] = sums;
        let (x, y) = (x / m, y / m);
        let law = Frame::of(
            [x, y],
            [
                [xx / m - x * x, xy / m - x * y],
                [xy / m - x * y, yy / m - y * y],
            ],
        );
        // A density that the grid does not resolve has no frame; the mass defect says so.
        if law.lower.iter().all(|l| l.is_finite()) && law.area() > 0.1 {
            law
        } else {
            STANDARD
        }
    }

    /// The spline through the values.
    fn interpolate(&mut self) {
        self.spline.pass(&self.values, &mut self.other);
    }

    /// p at points (q, v); 0 outside the square.
    pub(crate) fn density(&self, points: &[[f64; 2]]) -> Vec<f64> {
        let mut values = vec![0.0; points.len()];
        let scale = 1.0 / self.frame.area();
        self.spline.sample(&self.frame, scale, points, &mut values);
        values
    }

    /// p at the centres of its mesh with their (q, v) and the area of a cell.
    pub(crate) fn sum(&self, f: impl Fn([f64; 2], f64) -> f64) -> f64 {
        let centres = self.axis.centres();
        let area = self.frame.area();
        let nodes = centres
            .iter()
            .flat_map(|x| centres.iter().map(move |y| [*x, *y]));
        let cell = self.fineness.cell * self.fineness.cell * area;
        nodes
            .zip(&self.values)
            .map(|(xi, p)| f(self.frame.at(xi), p / area))
            .sum::<f64>()
            * cell
    }

    /// Moments, taken about the mean so that those of a narrow density keep their digits. Functions of q are
    /// integrated against the spline of the marginal of xi_1, the loss of contact between two panels.
    pub(crate) fn moments(&self) -> Moments {
        let n = self.axis.len();
        let (cell, [qq, vq, vv]) = (self.fineness.cell, self.frame.lower);
        let centres = self.axis.centres();
        let mut raw = RawMoments::default();
        let mut marginal = vec![0.0; n];
        for ((row, x), total) in self.values.chunks_exact(n).zip(centres).zip(&mut marginal) {
            for (p, y) in row.iter().zip(centres) {
                let (dq, dv) = (qq * x, vq * x + vv * y);
                let p = p * cell * cell;
                *total += p / cell;
                raw.q += p * dq;
                raw.qq += p * dq * dq;
                raw.v += p * dv;
                raw.vv += p * dv * dv;
                raw.qv += p * dq * dv;
            }
        }
        let [q0, v0] = self.frame.mean;
        let (n0, u0) = (self.contact.force(q0), self.contact.potential(q0));
        self.along(&marginal, |q, p, lost| {
            raw.mass += p;
            let force = self.contact.force(q) - n0;
            let mut power = p;
            for sum in &mut raw.force {
                power *= force;
                *sum += power;
            }
            raw.potential += p * (self.contact.potential(q) - u0);
            raw.lost += if lost { p } else { 0.0 };
        });
        let mut moments = raw.moments(&self.contact);
        // H = v^2/2 + U, from the centred ones.
        moments.mean_energy.value += u0 + v0 * moments.mean_v.value + 0.5 * v0 * v0;
        moments.mean_q.value += q0;
        moments.mean_v.value += v0;
        moments.mean_force.value += n0;
        moments
    }

    /// Calls `f` with (q, weight, whether contact is lost) over a rule for the spline of a marginal.
    fn along(&self, marginal: &[f64], mut f: impl FnMut(f64, f64, bool)) {
        let centres = self.axis.centres();
        let curve = self.spline.curve(marginal);
        let density = |x: f64| curve(self.axis.locate(x) - 0.5);
        let place = |q: f64| (q - self.frame.mean[0]) / self.frame.lower[0];
        let kinks: Vec<f64> = self.contact.kinks().into_iter().map(place).collect();
        let flight = self.contact.flight().map(|ends| ends.map(place));
        let mut panel = |a: f64, b: f64, towards: Option<f64>| {
            let middle = 0.5 * (a + b);
            let lost = flight.is_some_and(|[low, high]| middle >= low && middle < high);
            for (z, w) in KronrodNodes::default() {
                // x - l = (other - l) u^2 takes the half-integer power of the force to an integer one.
                let (x, w) = match towards {
                    Some(l) => {
                        let (u, far) = (0.5 + 0.5 * z, if l == a { b } else { a });
                        (l + (far - l) * u * u, w * u * (far - l).abs())
                    }
                    None => (0.5 * (a + b) + 0.5 * (b - a) * z, w * 0.5 * (b - a)),
                };
                f(
                    self.frame.mean[0] + self.frame.lower[0] * x,
                    w * density(x),
                    lost,
                );
            }
        };
        for pair in centres.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let mut ends = vec![a];
            ends.extend(kinks.iter().copied().filter(|l| *l > a && *l < b));
            ends.push(b);
            for ends in ends.windows(2) {
                // A kink at either end: this panel begins or ends at the power.
                let towards = kinks.iter().copied().find(|l| ends.contains(l));
                panel(ends[0], ends[1], towards);
            }
        }
    }

    /// Smallest value of p at the centres.
    pub(crate) fn lowest(&self) -> f64 {
        self.values.iter().copied().fold(f64::INFINITY, f64::min) / self.frame.area()
    }
}

#[cfg(test)]
#[path = "local_grid_tests.rs"]
mod tests;
