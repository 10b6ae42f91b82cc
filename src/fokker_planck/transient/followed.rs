//! The domain of a drive that throws motions far, where no formula says how far: a coarse run tells.

use super::asked::Asked;
use super::cost;
use super::ladder::is_unfit;
use super::recipe::{Recipe, domain};
use super::run::{Run, Task};
use crate::error::Result;
use crate::fokker_planck::budget::Limits;
use crate::fokker_planck::layout::{Layout, STEEPER_TRIES};
use crate::fokker_planck::tail::Tail;
use std::sync::Arc;

/// Runs whose tails are followed, the part of the time that each may take, and what a domain must gain for another of them. Where a
/// run takes longer there is no time for the three finer ones of an answer.
const LOOKS: usize = 4;
const PART: f64 = 0.1;
const FARTHER: f64 = 1.05;

/// Outputs that are looked at, the last first.
const OUTPUTS: usize = 16;

impl Asked<'_> {
    /// A recipe on domains that reach as far as the law does where it strays ([`Forcing::strays`]); the same where noise and the motion
    /// without noise tell how far.
    ///
    /// [`Forcing::strays`]: crate::fokker_planck::forcing::Forcing::strays
    pub(super) fn followed(&self, mut recipe: Recipe) -> Result<Recipe> {
        for _ in 0..LOOKS {
            let before = recipe.layout.domain.v[1];
            let strays = recipe.forcing.as_ref().is_some_and(|it| it.strays());
            // What will be refused for its time needs no coarse run.
            if !strays || !self.is_in_time(&recipe)? {
                break;
            }
            let Some(tail) = self.tail(&recipe) else {
                break;
            };
            let farther = self.reaching(recipe.clone(), tail)?;
            let gains = farther.layout.domain.v[1] >= FARTHER * before;
            // Under friction that is the same everywhere noise and the motion without noise else tell the law.
            if gains || !self.oscillator.is_viscous() {
                recipe = farther;
            }
            if !gains {
                break;
            }
        }
        Ok(recipe)
    }

    /// Whether a run on these domains is foreseen within the limit.
    fn is_in_time(&self, recipe: &Recipe) -> Result<bool> {
        let most = self.settings.max_memory;
        let cost = cost::foreseen(recipe, self.oscillator, self.initial, self.times, most)?;
        Ok(cost.seconds <= self.settings.max_seconds)
    }

    /// How far out probability lies at any of the times, by the coarsest mesh of a domain that carries it; None where none does.
    fn tail(&self, recipe: &Recipe) -> Option<Tail> {
        let each = self.times.len().div_ceil(OUTPUTS).max(1);
        let kept: Vec<f64> = self.times.iter().rev().step_by(each).copied().collect();
        let settings = self.settings;
        let limits = Limits::from_now(PART * settings.max_seconds, settings.max_memory);
        let task = Task {
            oscillator: self.oscillator,
            initial: self.initial,
            times: self.times,
            density_times: &kept,
            recipe,
            limits: &limits,
            law: None,
            begun: None,
        };
        let first = recipe.first_rung();
        let run = |k: usize| -> Result<Run> {
            let mut rung = task.rung(first + k as f64)?;
            rung.layout.domain = recipe.layout.domain;
            task.once(&rung, self.times, &|_| ())
        };
        let unfit = |run: &Result<Run>| run.as_ref().is_err_and(is_unfit);
        let run = (0..STEEPER_TRIES).map(run).find(|it| !unfit(it))?.ok()?;
        let snapshots = run.outputs.iter().filter_map(|it| it.snapshot.as_ref());
        let own = snapshots.filter(|it| it.v.len() == run.mesh.v.len());
        let tails = own.filter_map(|it| Tail::of(it, self.oscillator, run.domain.v[1]));
        let reach = |it: &Tail| it.reach(recipe.left_out(recipe.expected));
        tails.max_by(|a, b| reach(a).total_cmp(&reach(b)))
    }

    /// A recipe for a law that falls like this far out.
    fn reaching(&self, recipe: Recipe, tail: Tail) -> Result<Recipe> {
        let falling = recipe.forcing.as_ref().map(|it| it.falling(tail));
        let grid = (recipe.first_grid, recipe.layout.focused);
        let who = (self.oscillator, falling.as_ref());
        let neglected = recipe.left_out(recipe.expected);
        let domain = domain(who, self.initial, self.until(), grid, neglected)?;
        let spanning = falling.map(|it| it.spanning(domain.highest()));
        Ok(Recipe {
            forcing: spanning.transpose()?.map(Arc::new),
            layout: Layout {
                domain,
                ..recipe.layout
            },
            ..recipe
        })
    }
}
