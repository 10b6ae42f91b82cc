//! One run for the law that lasts under a drive: the fixed point of the map over one period, then the period itself.

use super::output::Output;
use super::propagator::{self, Propagator};
use super::recipe::Rung;
use super::run::{OverAPeriod, Run, Side, Task, believable};
use crate::error::Result;
use crate::fokker_planck::density::Density;
use crate::fokker_planck::fixed_point::{self, Fixed, Goal};
use crate::fokker_planck::integrators::Late;
use crate::fokker_planck::mesh::Mesh;
use crate::fokker_planck::observables::Observables;
use crate::fokker_planck::policy::SHARE;
use crate::moments::Moment;
use std::sync::Arc;

/// Most vectors of the Krylov space, and the part of the memory that they may take.
const VECTORS: usize = 240;
const MEMORY: f64 = 0.5;

impl Task<'_> {
    /// One run of a recipe, of the law that lasts where there is a period; `times` are then those of its phases.
    pub(super) fn once(&self, rung: &Rung, times: &[f64], progress: &dyn Fn(f64)) -> Result<Run> {
        match rung.period {
            None => self.run(rung, times, progress),
            Some(period) => self.lasting(rung, period, times, progress),
        }
    }

    /// One for a lasting law of this period. It begins with something of every slow mode.
    fn lasting(
        &self,
        rung: &Rung,
        period: f64,
        times: &[f64],
        progress: &dyn Fn(f64),
    ) -> Result<Run> {
        let (oscillator, limits) = (self.oscillator, self.limits);
        let mesh = self.mesh(rung, None)?;
        let late: Late = Arc::new(limits.late("the periodic law"));
        let vectors = (MEMORY * limits.memory as f64) as u64;
        let beside = limits.memory - vectors;
        let mut propagator = propagator::build(rung, oscillator, &mesh, period, (beside, late))?;
        let reference = rung.reference(oscillator);
        let observables = Observables::new(reference, &mesh, rung.drift(), propagator.weights())?;
        // About the motions without noise: from elsewhere GMRES has many more modes to find, and of two orbits the way from
        // one to the other is the slowest.
        let orbits = rung.forcing.as_ref();
        let orbits = orbits.map_or(&[[0.0; 2]][..], |it| it.orbits());
        let rest = oscillator.contact().equilibrium().unwrap_or(0.0);
        let begin = |about: &[f64; 2]| -> Result<Density> {
            let mut one = propagator.stationary(oscillator, [about[0] - rest, about[1]])?;
            // Of two, each with little of the other's: half the deviation.
            let narrower = if orbits.len() > 1 { 1.5 } else { 0.0 };
            let deviation = oscillator.temperature().sqrt();
            tilt(&mut one, &mesh, *about, (deviation, narrower));
            Ok(one)
        };
        let starts: Result<Vec<Density>> = orbits.iter().map(begin).collect();
        let starts = starts?;
        let mut density = propagator.sampled(&|points| vec![0.0; points.len()]);
        for one in &starts {
            for (p, one) in density.cells_mut().iter_mut().zip(one.cells()) {
                *p += one / orbits.len() as f64;
            }
        }
        let each = 8 * mesh.len() as u64;
        let room = vectors / each.max(1);
        let goal = Goal {
            error: SHARE.get() * rung.tolerance,
            eigenvalue: self.recipe.tolerance,
            vectors: VECTORS.min(room as usize).max(8),
        };
        let fixed = periods(&mut propagator, &mut density, period, goal)?;
        progress(0.9);
        let law = density;
        // In L1, of the law itself.
        let left = fixed.residual / (1.0 - fixed.slowest).max(1e-9);
        let steps = propagator.steps();
        // What is between the phases asked for cuts no steps to these.
        let asked = |(k, _): &(usize, f64)| k.is_multiple_of(self.recipe.each);
        let (asked, between): (Vec<_>, Vec<_>) = folded(times, period).into_iter().partition(asked);
        let mut outputs = self.through(&mut propagator, &observables, &law, times, &asked)?;
        let mut others = self.through(&mut propagator, &observables, &law, times, &between)?;
        for (_, output) in &mut others {
            output.moments.keep_of(&Moment::OVER_A_PERIOD);
        }
        outputs.append(&mut others);
        let mut outputs = in_order(outputs);
        // Those that made the law, whatever its phase: of one period.
        let of_period = rung.flow_map().steps(period) as u64;
        for output in &mut outputs {
            output.lost = left + propagator.lacking();
            output.steps = of_period;
        }
        let metastable = match (&starts[..], &fixed.modes.slow, fixed.settled()) {
            ([one, other], Some(slow), Some(left)) => {
                let law = (&law, &fixed, &slow[..], left);
                let starts = [one, other];
                let goal = (period, goal);
                // An answer is not lost to what is told beside it.
                let beside = (&mut propagator, &observables);
                self.metastable(beside, law, starts, goal, times)
                    .unwrap_or(None)
            }
            _ => None,
        };
        let (step, domain) = (propagator.step(), rung.layout.domain);
        believable(&outputs, step, &domain, oscillator.temperature(), &mesh)?;
        Ok(Run {
            outputs,
            steps,
            step,
            domain,
            unknowns: propagator.unknowns(),
            settled: None,
            lacking: propagator.lacking(),
            over_a_period: Some(OverAPeriod {
                multipliers: fixed.modes.eigenvalues,
                residual: fixed.residual,
                metastable,
            }),
            mesh,
        })
    }

    /// What the law of time 0 becomes at some of the times, which are these within the first period.
    fn through(
        &self,
        propagator: &mut Propagator,
        observables: &Observables,
        law: &Density,
        times: &[f64],
        some: &[(usize, f64)],
    ) -> Result<Vec<(usize, Output)>> {
        propagator.set_time(0.0);
        let (mut density, mut now) = (law.clone(), 0.0);
        let against = [propagator.reference()];
        let output = |&(k, t): &(usize, f64)| {
            if t > now {
                propagator.advance(&mut density, t - now, &mut |_, _| Ok(true))?;
                now = t;
            }
            let of = (&density, &against[..]);
            Ok((k, self.observe(times[k], propagator, observables, of)))
        };
        some.iter().map(output).collect()
    }

    /// The two laws that `law` is made of: what a motion comes to about either orbit once all else has faded, when so much of
    /// the slow mode is `left`. `half` is what half of either start has of that mode; the start of the less probable law, by
    /// itself, has nearly all that there is of it.
    fn metastable(
        &self,
        (propagator, observables): (&mut Propagator, &Observables),
        (law, fixed, half, left): (&Density, &Fixed, &[f64], f64),
        starts: [&Density; 2],
        (period, goal): (f64, Goal),
        times: &[f64],
    ) -> Result<Option<[Side; 2]>> {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let rare = usize::from(dot(half, starts[1].cells()) > dot(half, starts[0].cells()));
        let mut own = starts[rare].clone();
        let again = periods(propagator, &mut own, period, goal)?;
        let (Some(slow), [a, ..], [b, ..]) = (
            &again.modes.slow,
            &fixed.modes.eigenvalues[..],
            &again.modes.eigenvalues[..],
        ) else {
            return Ok(None);
        };
        let pairs = half.iter().zip(slow);
        let other: Vec<f64> = pairs.map(|(half, slow)| 2.0 * half - slow).collect();
        // The law has nothing of the mode: its parts are as what the other has of it. Both solutions must mean one mode.
        let ratio = -dot(&other, slow) / dot(slow, slow);
        let apart: Vec<f64> = other.iter().zip(slow).map(|(o, s)| o + ratio * s).collect();
        let alike = dot(&apart, &apart) < SAME * SAME * dot(slow, slow);
        let same =
            (a.value - b.value).norm() <= a.error + b.error + goal.eigenvalue * (1.0 - a.value.re);
        if !(alike && same && ratio > 0.0 && a.value.re > 0.0) {
            return Ok(None);
        }
        let fading = a.value.re.ln() / period;
        let mut side = |probability: f64, law: &Density, slow: &[f64]| -> Result<Side> {
            let mut density = law.clone();
            for (p, slow) in density.cells_mut().iter_mut().zip(slow) {
                *p += left * slow;
            }
            let (mut both, mut now) = ([law.clone(), density], 0.0);
            let moments = folded(times, period).into_iter().map(|(k, t)| {
                for density in both.iter_mut().filter(|_| t > now) {
                    propagator.set_time(now);
                    propagator.advance(density, t - now, &mut |_, _| Ok(true))?;
                }
                now = t;
                // Without what passes meanwhile it is one law, and periodic.
                let [law, own] = &both;
                let mut density = law.clone();
                let cells = density.cells_mut().iter_mut().zip(own.cells());
                for (p, own) in cells {
                    *p += (own - *p) * (-fading * t).exp();
                }
                let of = (&density, &[propagator.reference()][..]);
                let output = self.observe(times[k], propagator, observables, of);
                Ok((k, output.moments))
            });
            Ok(Side {
                probability,
                moments: in_order(moments.collect::<Result<_>>()?),
            })
        };
        let part = ratio / (1.0 + ratio);
        let mut sides = [side(part, &own, slow)?, side(1.0 - part, law, &other)?];
        sides.rotate_left(rare);
        Ok(Some(sides))
    }
}

/// The times of a periodic law within the first period, in their order there, each with its place.
fn folded(times: &[f64], period: f64) -> Vec<(usize, f64)> {
    let mut all: Vec<(usize, f64)> = times.iter().map(|t| t % period).enumerate().collect();
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    all
}

/// Each at its place.
fn in_order<T>(mut all: Vec<(usize, T)>) -> Vec<T> {
    all.sort_by_key(|it| it.0);
    all.into_iter().map(|it| it.1).collect()
}

/// Two solutions mean one mode if what they say of it differs by less than this part.
const SAME: f64 = 0.05;

/// Makes a density that has something of every slow mode: the fixed point does not depend on it, and what is not in it has
/// no eigenvalue.
fn tilt(density: &mut Density, mesh: &Mesh, about: [f64; 2], (deviation, narrower): (f64, f64)) {
    let (q, v) = (mesh.q.centres(), mesh.v.centres());
    let mut cells = density.cells_mut().iter_mut();
    for q in q {
        for v in v {
            if let Some(p) = cells.next() {
                let (x, y) = ((q - about[0]) / deviation, (v - about[1]) / deviation);
                let square = x * x + y * y;
                *p *= (-narrower * square).exp()
                    * (1.0 + 0.3 * x.tanh() + 0.2 * y.tanh() + 0.1 * (square / 4.0 - 1.0).tanh());
            }
        }
    }
    density.normalise();
}

/// Comes to the fixed point of the map over one period from time 0 on.
fn periods(
    propagator: &mut Propagator,
    density: &mut Density,
    period: f64,
    goal: Goal,
) -> Result<Fixed> {
    let weights = propagator.weights().clone();
    let weights = [&weights.q[..], &weights.v];
    let mut x = density.cells().to_vec();
    let mut held = density.clone();
    let fixed = fixed_point::solve(&mut x, weights, goal, &mut |cells| {
        held.cells_mut().copy_from_slice(cells);
        propagator.set_time(0.0);
        propagator.advance(&mut held, period, &mut |_, _| Ok(true))?;
        cells.copy_from_slice(held.cells());
        Ok(())
    })?;
    density.cells_mut().copy_from_slice(&x);
    Ok(fixed)
}
