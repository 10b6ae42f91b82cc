//! The choice of steps: as long as the error asked for allows, and landing on every output time.

use super::Integrator;
use crate::error::{Error, Result};
use crate::fokker_planck::density::Density;
use crate::fokker_planck::policy::{FORGOTTEN_SHARE, STEP_AIM, STEP_GAIN};

/// What decides about the length of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Step {
    /// Every step as long as given, or shorter so as to land.
    Fixed(f64),
    /// Such that the errors of the steps, in the L1 norm of p, leave less than `total` at any time.
    Error {
        /// L1 norm of p.
        total: f64,
        /// Time over which errors add up: the exact evolution never grows the L1 norm of a difference,
        /// and forgets it over this time if not sooner.
        horizon: f64,
        /// The first step tried.
        first: f64,
        /// Longest step wanted, for the sake of those who watch.
        longest: f64,
    },
}

/// Steps between two looks at the error once it is as it should be: it changes slowly, and a look costs
/// about three steps.
const UNCHECKED: u32 = 8;

/// Steps to the next output time beyond which it is too far to land on: cutting what is left into so many equal steps
/// would change each by a rounding, and with it its factorisation.
const FAR: f64 = 1e6;

/// A scheme with the choice of its steps.
pub struct TimeIntegration {
    scheme: Box<dyn Integrator>,
    choice: Step,
    /// The step in use, before it is shortened to land.
    wanted: f64,
    /// The last step taken.
    last: f64,
    /// Longest step whose systems may be solved.
    solvable: f64,
    /// Steps since the error was looked at.
    unchecked: u32,
    /// What that look found: the error of a step, and what another step leaves of it.
    seen: (f64, f64),
    /// What the steps so far have left of their errors, in the L1 norm.
    left: f64,
    before: Vec<f64>,
    error: Vec<f64>,
    steps: u64,
    refused: u64,
    longest: f64,
}

impl TimeIntegration {
    /// `scheme` with steps by `choice`, none longer than its stability allows.
    pub(crate) fn new(scheme: Box<dyn Integrator>, choice: Step) -> Self {
        let wanted = match choice {
            Step::Fixed(step) => step,
            Step::Error { longest, .. } if scheme.chooses_accuracy() => longest,
            Step::Error { first, .. } => first,
        };
        Self {
            wanted: wanted.min(scheme.longest_step()),
            scheme,
            choice,
            last: 0.0,
            solvable: f64::INFINITY,
            unchecked: 0,
            seen: (0.0, 1.0),
            left: 0.0,
            before: Vec::new(),
            error: Vec::new(),
            steps: 0,
            refused: 0,
            longest: 0.0,
        }
    }

    /// Steps taken and kept.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Steps taken back because of their error.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// The error that the steps so far have left, in the L1 norm of p, as their embedded estimates and what an
    /// iterative solver may leave add up: within a factor of two (tests/time.rs). 0 where steps are given or the
    /// scheme chooses its accuracy.
    pub fn error(&self) -> f64 {
        self.left
    }

    /// Longest step kept.
    pub fn longest(&self) -> f64 {
        self.longest
    }

    /// Longest step that is stable.
    pub fn longest_stable(&self) -> f64 {
        self.scheme.longest_step()
    }

    /// Advances `density` by `duration`, exactly, unless `watch` says to stop: it sees the time done and
    /// the density after every step, kept or taken back. Returns the time done.
    ///
    /// # Errors
    /// Those of the scheme and of `watch`.
    pub fn advance(
        &mut self,
        density: &mut Density,
        duration: f64,
        watch: &mut dyn FnMut(f64, &Density) -> Result<bool>,
    ) -> Result<f64> {
        let mut done = 0.0;
        while done < duration {
            let left = duration - done;
            let steps = (left / self.wanted * (1.0 - 1e-9)).ceil().max(1.0);
            let mut dt = if steps > FAR {
                self.wanted
            } else {
                left / steps
            };
            // The same step to rounding is the same step: its factorisation is there.
            if (dt / self.last - 1.0).abs() < 1e-11 {
                dt = self.last;
            }
            // A step taken back took its time too: a limit may have come.
            if self.step(density, dt)? {
                done = if steps > 1.0 { done + dt } else { duration };
            }
            if !watch(done, density)? {
                break;
            }
        }
        Ok(done)
    }

    /// One step; false if it was taken back, for its error or because its system was too hard to solve: steps then
    /// stay shorter than that.
    fn step(&mut self, density: &mut Density, dt: f64) -> Result<bool> {
        self.before.clear();
        match self.attempt(density, dt) {
            Err(Error::Linear { .. })
                if matches!(self.choice, Step::Error { .. }) && dt > 1e-3 * self.longest =>
            {
                if !self.before.is_empty() {
                    density.cells_mut().copy_from_slice(&self.before);
                }
                self.solvable = 0.5 * dt;
                self.wanted = self.solvable;
                self.refused += 1;
                self.last = 0.0;
                Ok(false)
            }
            it => it,
        }
    }

    fn attempt(&mut self, density: &mut Density, dt: f64) -> Result<bool> {
        let Step::Error {
            total,
            horizon,
            longest,
            ..
        } = self.choice
        else {
            self.scheme.advance(density.cells_mut(), dt, 0.0)?;
            self.keep(dt);
            return Ok(true);
        };
        let steady = total * dt / horizon;
        let check =
            !self.scheme.chooses_accuracy() && (dt != self.last || self.unchecked >= UNCHECKED);
        if check {
            self.before.extend_from_slice(density.cells());
        }
        self.scheme
            .advance(density.cells_mut(), dt, STEP_AIM.get() * steady)?;
        if check {
            let size = |x: &[f64]| x.iter().map(|x| x.abs()).sum::<f64>();
            self.error.resize(self.before.len(), 0.0);
            self.scheme
                .error(&self.before, density.cells(), dt, &mut self.error)?;
            let error = size(&self.error);
            self.scheme.advance(&mut self.error, dt, 1e-2 * error)?;
            let kept = (size(&self.error) / error.max(1e-300)).clamp(1e-3, 1.0);
            let allowed = steady + total * FORGOTTEN_SHARE.get() * (-kept.ln()).min(1.0);
            // The error of one step over the step goes with its order.
            let order = f64::from(self.scheme.order());
            let factor = (STEP_AIM.get() * allowed / error.max(1e-300)).powf(1.0 / order);
            let ceiling = longest.min(self.scheme.longest_step()).min(self.solvable);
            let smallest = 1e-12 * self.longest.max(dt);
            if (error > allowed || error.is_nan()) && dt > smallest {
                density.cells_mut().copy_from_slice(&self.before);
                self.wanted = dt * factor.clamp(0.1, 0.9);
                self.refused += 1;
                self.last = 0.0;
                return Ok(false);
            }
            self.unchecked = 0;
            self.seen = (error, kept);
            let next = (dt * factor).min(ceiling);
            if next > STEP_GAIN.get() * self.wanted || next < 0.99 * self.wanted.min(dt) {
                self.wanted = next;
            }
        }
        self.unchecked += 1;
        let (error, kept) = self.seen;
        self.left =
            kept * self.left + error + self.scheme.algebraic_part() * STEP_AIM.get() * steady;
        self.keep(dt);
        Ok(true)
    }

    fn keep(&mut self, dt: f64) {
        self.last = dt;
        self.steps += 1;
        self.longest = self.longest.max(dt);
    }
}
