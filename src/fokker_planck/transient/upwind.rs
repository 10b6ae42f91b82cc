//! First-order upwind drift, the baseline: one refinement, and an error estimate that says how wrong it is.

use super::error_estimate::Errors;
use super::propagator;
use super::recipe::Rung;
use super::report::Transient;
use super::run::{Run, Task};
use crate::error::Result;
use crate::fokker_planck::adaptive::{self, Next, Question, Stop};
use crate::fokker_planck::mesh::Mesh;
use crate::moments::Moments;

/// How far ahead the relaxation of upwind drift with backward Euler is: c of the energy, of diffusion
/// along q, |v| dq/2 beside T/(2 zeta) where friction rules, and of steps dt, which damp an oscillation by
/// dt/2 beside zeta.
fn ahead(task: &Task, mesh: &Mesh) -> f64 {
    let (zeta, sigma) = (task.oscillator.zeta(), task.oscillator.temperature().sqrt());
    let width = mesh.q.at(mesh.q.locate(0.0)).1;
    let step = propagator::euler_step(mesh, task.recipe.step);
    propagator::upwind_excess(task.oscillator, mesh)
        + 0.8 * zeta * width / sigma
        + 0.5 * step.min(longest_interval(task.times)) / zeta
}

/// Upwind drift: a run on half the cells and one on all of them, and an error estimate that holds how far ahead its
/// relaxation is.
struct Upwind<'a> {
    task: Task<'a>,
    fine_rung: Rung,
    /// Half the cells take half the step of the scene, or both runs would err alike.
    halved: Rung,
    excess: f64,
    /// Output times with eight before each: from t/(1 + c) to t, to look for the largest change.
    times: Vec<f64>,
    coarse: Option<Run>,
    fine: Option<(Run, Errors)>,
}

/// The answer of upwind drift.
pub(super) fn refined(task: Task, progress: &(dyn Fn(f64) + Sync)) -> Result<Transient> {
    let asked = (&task.recipe.name()[..], task.recipe.is_free());
    adaptive::pursue(Upwind::new(task)?, asked, task.limits, progress)
}

impl<'a> Upwind<'a> {
    fn new(task: Task<'a>) -> Result<Self> {
        let recipe = task.recipe;
        let fine_rung = task.rung(recipe.expected)?;
        let excess = ahead(&task, &fine_rung.mesh(task.oscillator)?);
        let mut times: Vec<f64> = task.times.to_vec();
        times.extend(task.times.iter().flat_map(|t| {
            (0..8).map(move |k| {
                let slowest = t / (1.0 + excess);
                slowest + (t - slowest) * f64::from(k) / 8.0
            })
        }));
        times.sort_by(f64::total_cmp);
        times.dedup();
        let longest = longest_interval(task.times);
        let halved = Rung {
            step: recipe.step.map(|step| 0.5 * step.min(longest)),
            layout: fine_rung.layout.refined(0.5),
            ..fine_rung.clone()
        };
        Ok(Self {
            task,
            fine_rung,
            halved,
            excess,
            times,
            coarse: None,
            fine: None,
        })
    }

    /// The error estimates of the fine run, whose extra outputs they take away.
    fn errors(&self, fine: &mut Run, coarse: &Run) -> Errors {
        let excess = self.excess;
        let all: Vec<(f64, Moments)> = fine.outputs.iter().map(|o| (o.t, o.moments)).collect();
        fine.outputs.retain(|o| self.task.times.contains(&o.t));
        // First order: the fine run errs as much as it differs from one on half the cells; twice, to be safe.
        let mut errors = Errors::between(&self.task, fine, coarse, 2.0);
        // Where numbers diffuse more than physics the phase of the motion is lost too: from crest to trough.
        let phase = if excess > 1.0 { 2.0 } else { 1.0 };
        let outputs = self.task.times.iter().zip(&mut errors.space);
        for ((t, space), now) in outputs.zip(&fine.outputs) {
            let window = all
                .iter()
                .filter(|(s, _)| *s >= t / (1.0 + excess) * (1.0 - 1e-12) && s <= t);
            let mut change = [0.0_f64; 11];
            for (_, earlier) in window {
                let pairs = earlier.named().into_iter().zip(now.moments.named());
                for (change, ((_, earlier), (_, now))) in change.iter_mut().zip(pairs) {
                    if let (Some(earlier), Some(now)) = (earlier, now) {
                        *change = change.max((earlier.value - now.value).abs());
                    }
                }
            }
            for (error, change) in space.iter_mut().zip(change) {
                *error = phase * (*error + change);
            }
        }
        errors
    }
}

impl Question for Upwind<'_> {
    type Answer = Transient;

    fn ratio(&self) -> Option<f64> {
        let (run, errors) = self.fine.as_ref()?;
        Some(errors.worst(run).0 / self.task.recipe.tolerance)
    }

    fn next(&mut self) -> Result<Next> {
        if self.fine.is_some() {
            let why = "upwind drift is of first order, and no affordable mesh would do";
            return Ok(Next::stop(why));
        }
        let fine = self.task.work(&self.fine_rung, &self.times)?;
        if self.coarse.is_some() {
            return Ok(Next::run(fine));
        }
        let now = self.task.work(&self.halved, &self.times)?;
        Ok(Next::Run {
            now,
            then: Some(fine),
        })
    }

    fn run(&mut self, progress: &(dyn Fn(f64) + Sync)) -> Result<()> {
        let Some(coarse) = &self.coarse else {
            let coarse = self.task.run(&self.halved, self.task.times, progress)?;
            self.coarse = Some(coarse);
            return Ok(());
        };
        let mut fine = self.task.run(&self.fine_rung, &self.times, progress)?;
        let errors = self.errors(&mut fine, coarse);
        self.fine = Some((fine, errors));
        Ok(())
    }

    fn answer(self, stop: Stop) -> Option<Transient> {
        let (coarse, (fine, errors)) = self.coarse.zip(self.fine)?;
        let excess = self.excess;
        let warning = format!(
            "upwind drift relaxes the energy 1 + c = {:.2} times too fast on this mesh (c = {excess:.3}: \
             numerical over physical diffusion); its error estimates say so. Use drift = 8 for an answer",
            1.0 + excess
        );
        let report = self
            .task
            .report(fine, &coarse, &errors, stop, vec![warning]);
        Some(report)
    }
}

/// The longest time without an output, from 0 on.
fn longest_interval(times: &[f64]) -> f64 {
    let before = std::iter::once(&0.0).chain(times);
    let intervals = times.iter().zip(before).map(|(b, a)| b - a);
    let longest = intervals.fold(0.0, f64::max);
    if longest > 0.0 { longest } else { 1.0 }
}
