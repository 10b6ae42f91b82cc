//! The stationary law where it has no closed form: the null vector of the Fokker-Planck operator in Hermite functions of v
//! and spectral elements of q (`hermite::friction`), at three resolutions or more; on meshes (`solved::on_mesh`) where so
//! many functions as there may be do not bring it to its tolerance. `solved::settled` finds the same law as a part of other
//! questions, at a tolerance of their own and with no answer but the law.

use crate::error::Result;
use crate::estimate::{Estimate, Origin, Shortfall};
use crate::fokker_planck::adaptive::{self, Next, Question, Stop, judged};
use crate::fokker_planck::budget::{Cost, Limits, timing};
use crate::fokker_planck::convergence::{UNKNOWN, at_least, left, left_of};
use crate::fokker_planck::hermite::{Kept, Resolution, work};
use crate::fokker_planck::settings::Settings;
use crate::fokker_planck::solved::{Law, OnMesh};
use crate::moments::{Moment, Moments};
use crate::oscillator::Oscillator;
use crate::scales::Scales;
use std::f64::consts::{FRAC_PI_2, LN_10};

/// The stationary law p(q, v) of a damping that is not viscous.
#[derive(Debug, Clone)]
pub struct SolvedLaw {
    /// All moments with their errors.
    pub moments: Moments,
    /// Losses of contact a unit of time: the flux of probability through the loss point. None for a law that cannot lose
    /// contact.
    pub loss_rate: Option<Estimate>,
    /// Mean time out of contact, P(loss)/rate.
    pub mean_flight: Option<Estimate>,
    /// Mean speed at the return to contact.
    pub mean_impact_speed: Option<Estimate>,
    /// E\[c v^2\], which is pi h exactly: what friction takes, noise gives.
    pub dissipated: Estimate,
    /// Functions of q and of v at the finest resolution, or its cells.
    pub functions: [usize; 2],
    /// What the tolerance asked for and was not reached.
    pub shortfall: Option<Shortfall>,
    law: Law,
}

impl SolvedLaw {
    /// p(q, v); 0 beyond the truncated domain.
    pub fn density(&self, q: f64, v: f64) -> f64 {
        self.law.along(q, &[v])[0]
    }

    /// p(q, v) at one displacement and many velocities.
    pub fn along(&self, q: f64, velocities: &[f64]) -> Vec<f64> {
        self.law.along(q, velocities)
    }

    /// Where p begins and ends in q.
    pub fn domain(&self) -> [f64; 2] {
        self.law.domain()
    }

    /// Mean number of losses of contact in a dimensionless time.
    pub fn losses_in(&self, time: f64) -> Option<Estimate> {
        self.loss_rate.map(|rate| rate.scaled(time))
    }

    /// p_q(q).
    pub fn density_q(&self, q: f64) -> f64 {
        self.law.density_q(q)
    }

    /// p_v(v).
    pub fn density_v(&self, v: f64) -> f64 {
        self.law.density_v(v)
    }

    /// log10 P(q < q_loss); None where that is not known to be more than its error.
    pub fn log10_contact_loss_probability(&self) -> Option<Estimate> {
        let it = self.moments.contact_loss_probability?;
        let known = it.value > it.error;
        known.then(|| it.mapped(it.value.log10(), 1.0 / (LN_10 * it.value)))
    }
}

/// How a stationary law will be solved for: resolutions, and the foreseen cost.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StationaryState {
    first: Resolution,
    given: bool,
    tolerance: f64,
    /// The moments that the tolerance asks for; None for all of them.
    asked: Option<Vec<Moment>>,
    /// What it will take: cells are functions of q and of v, steps the factorisations.
    pub(crate) cost: Cost,
}

/// Resolutions at most, in functions and of meshes; the last has 64 and 16 times the unknowns of the first.
const RESOLUTIONS: usize = 7;
const MESHES: usize = 5;

/// Rounding of the null vector, relative to the scale of a number.
const ROUNDING: f64 = 1e-11;

/// The stationary law of `oscillator`, `settings.moments` of it to `settings.tolerance`; `settings.cells` fixes the finest
/// resolution, as functions of q and of v. For viscous damping it is exp(-H/T)/Z, found by other means.
///
/// # Errors
/// [`crate::Error::NoStationaryLaw`] for a contact without one; [`crate::Error::Limit`] where `settings.max_seconds` or
/// `settings.max_memory` do not suffice for a first answer; [`crate::Error::Linear`] if a null vector does not settle.
pub fn stationary_law(oscillator: &Oscillator, settings: &Settings) -> Result<SolvedLaw> {
    settings.check()?;
    StationaryState::of(oscillator, settings)?.solve(oscillator, &settings.limits(), &|_| {})
}

impl StationaryState {
    /// The recipe.
    ///
    /// # Errors
    /// [`Error::NoStationaryLaw`] for a contact without one; [`Error::Invalid`] for a rate that depends on more than q.
    pub(crate) fn of(oscillator: &Oscillator, settings: &Settings) -> Result<Self> {
        oscillator.displacement_law()?;
        let damping = oscillator.damping();
        damping.depends_on_displacement("the stationary law")?;
        let mut it = Self {
            first: Resolution::first(settings.cells, 2, [4, 16], 18.0),
            given: settings.cells.is_some(),
            tolerance: settings.tolerance,
            asked: settings.moments.clone(),
            cost: Cost {
                steps: 3,
                ..Cost::default()
            },
        };
        it.cost.cells = Some(it.resolution(2).functions());
        it.cost.memory = it.work(2).memory;
        it.cost.seconds = (0..3).map(|level| it.work(level).seconds).sum();
        Ok(it)
    }

    /// Method and reason.
    pub(crate) const WORDS: &str = "null vector in Hermite functions and spectral elements, three resolutions, or on a mesh: \
                                    no closed form under this damping";

    /// The same to this part of its tolerance.
    pub(crate) fn finer(&self, part: f64) -> Self {
        Self {
            tolerance: part * self.tolerance,
            ..self.clone()
        }
    }

    fn resolution(&self, level: usize) -> Resolution {
        self.first.refined(level)
    }

    fn work(&self, level: usize) -> Cost {
        let (memory, operations) = work(self.resolution(level));
        Cost {
            seconds: operations * timing::OPERATION,
            memory,
            ..Cost::default()
        }
    }

    /// As [`stationary_law`], by this recipe.
    pub(crate) fn solve(
        &self,
        oscillator: &Oscillator,
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<SolvedLaw> {
        let task = |on_mesh| Task {
            recipe: self,
            oscillator,
            limits: limits.clone(),
            on_mesh,
            levels: Vec::new(),
            ratios: Vec::new(),
            best: None,
        };
        let asked = (NAME, !self.given);
        let functions = adaptive::pursue(task(false), asked, limits, progress);
        let over = |law: &SolvedLaw| law.shortfall.as_ref().map_or(0.0, Shortfall::ratio);
        if self.given || functions.as_ref().is_ok_and(|law| over(law) == 0.0) {
            return functions;
        }
        match (
            functions,
            adaptive::pursue(task(true), asked, limits, progress),
        ) {
            (Ok(a), Ok(b)) => Ok(if over(&a) < over(&b) { a } else { b }),
            (Ok(law), Err(_)) | (Err(_), Ok(law)) => Ok(law),
            (Err(error), Err(_)) => Err(error),
        }
    }
}

/// The numbers of one resolution: moments, then rate, flight, speed and what friction takes.
struct Level {
    moments: Moments,
    beside: [Option<f64>; 4],
}

impl Level {
    fn of(oscillator: &Oscillator, law: &Law) -> Self {
        let moments = law.raw().moments(oscillator.contact());
        let ends = oscillator.contact().flight();
        // Out of contact, and back, at either wall.
        let crossings = ends.map(|[back, loss]| {
            let [out, home] = law.crossings(loss);
            if back.is_finite() {
                let [struck, left] = law.crossings(back);
                return [add(out, left), add(home, struck)];
            }
            [out, home]
        });
        // What goes out comes back: the mean of both.
        let rate = crossings.map(|[out, home]| 0.5 * (out[0] + home[0]));
        let rate = rate.filter(|rate| *rate > 0.0);
        let lost = moments.contact_loss_probability.map(|it| it.value);
        let flight = lost.zip(rate).map(|(lost, rate)| lost / rate);
        let returns = crossings.map(|it| it[1]).filter(|it| it[0] > 0.0);
        Self {
            moments,
            beside: [
                rate,
                flight,
                returns.map(|[rate, square]| square / rate),
                Some(law.dissipated()),
            ],
        }
    }

    fn values(&self) -> Vec<Option<f64>> {
        let moments = self.moments.named().map(|(_, number)| Some(number?.value));
        moments.into_iter().chain(self.beside).collect()
    }

    /// The normalisation of each number: rates and times their own value.
    fn scales(&self) -> Vec<f64> {
        let own = self.beside.map(|it| it.unwrap_or(1.0).abs());
        let scales = Scales::of_law(&self.moments).each(&self.moments);
        scales.into_iter().chain(own).collect()
    }
}

/// Time out of contact after a loss at the mean speed of a crossing: up and down again, or across a gap.
fn mean_flight(oscillator: &Oscillator) -> f64 {
    let contact = oscillator.contact();
    let speed = (FRAC_PI_2 * oscillator.temperature()).sqrt();
    contact.flight().map_or(1.0, |[low, loss]| {
        (2.0 * speed / contact.force(loss).abs()).min((loss - low) / speed)
    })
}

fn add(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

struct Task<'a> {
    recipe: &'a StationaryState,
    oscillator: &'a Oscillator,
    limits: Limits,
    /// On meshes, or in functions.
    on_mesh: bool,
    levels: Vec<Level>,
    /// The largest error over the tolerance at each level from the third on.
    ratios: Vec<f64>,
    /// The finest law with its largest error over the tolerance, and whose that is.
    best: Option<(SolvedLaw, f64, &'static str)>,
}

/// The question in messages.
const NAME: &str = "the stationary law";

impl Question for Task<'_> {
    type Answer = SolvedLaw;

    fn ratio(&self) -> Option<f64> {
        self.best.as_ref().map(|it| it.1)
    }

    fn next(&mut self) -> Result<Next> {
        let (done, given) = (self.levels.len(), self.recipe.given);
        let most = if self.on_mesh { MESHES } else { RESOLUTIONS };
        // Twice no nearer: rounding, or a domain that is too small, spoils finer ones too.
        if let [.., before, middle, last] = self.ratios[..]
            && !given
            && middle.min(last) >= before
        {
            let why = format!("finer than {done} resolutions would not settle it");
            return Ok(Next::stop(why));
        }
        if !self.on_mesh {
            let work = |level: usize| self.recipe.work(level);
            return Ok(Next::of_three(done, most, given, work));
        }
        let work = |level: usize| OnMesh::work(self.oscillator, level);
        let (now, third) = (work(done)?, work(done.max(2))?);
        let work = |level: usize| if level == done { now } else { third };
        Ok(Next::of_three(done, most, given, work))
    }

    fn run(&mut self, _progress: &(dyn Fn(f64) + Sync)) -> Result<()> {
        let level = self.levels.len();
        let law = if self.on_mesh {
            self.limits
                .room_for(OnMesh::work(self.oscillator, level)?.seconds, || {
                    format!("a factorisation for {NAME}")
                })?;
            Law::OnMesh(OnMesh::new(self.oscillator, level)?)
        } else {
            let resolution = self.recipe.resolution(level);
            let late = || {
                self.limits
                    .in_time(|| format!("{NAME} was not found at {} functions", resolution.len()))
            };
            Law::Functions(Kept::new(self.oscillator, resolution, &late)?)
        };
        self.levels.push(Level::of(self.oscillator, &law));
        if let [.., coarse, middle, fine] = &self.levels[..] {
            let scales = fine.scales();
            let (a, b, c) = (coarse.values(), middle.values(), fine.values());
            let change = |x: &[Option<f64>], y: &[Option<f64>], k: usize| {
                let both = x[k].zip(y[k]);
                both.map_or(0.0, |(x, y)| (x - y).abs() / scales[k])
            };
            let all = 0..scales.len();
            let [earlier, last] = [(&a, &b), (&b, &c)]
                .map(|(x, y)| all.clone().map(|k| change(x, y, k)).collect::<Vec<f64>>());
            // No moment is known better than the last one of q, v and the energy: P(loss) may change by less than is left of it.
            // Skewness and kurtosis weigh tails that the rest hardly sees; rates and times of what hardly ever happens say
            // nothing of it.
            let pooled = |changes: &[f64]| {
                let moments = Moment::ALL.into_iter().zip(changes);
                let seen = moments.filter(|(it, _)| !it.is_standardised());
                seen.map(|(_, change)| *change).fold(0.0, f64::max)
            };
            let pooled = [pooled(&earlier), pooled(&last)];
            let rounding = ROUNDING.max(left(UNKNOWN) * law.rounding());
            let error = |k: usize| {
                let left = left_of([
                    at_least(earlier[k], pooled[0]),
                    at_least(last[k], pooled[1]),
                ]);
                scales[k] * (left + rounding)
            };
            let mut moments = fine.moments;
            // The rest has its errors, whatever they are.
            let mut goals = scales.clone();
            for (goal, it) in goals.iter_mut().zip(Moment::ALL) {
                let asked = self.recipe.asked.as_ref();
                if asked.is_some_and(|asked| !asked.contains(&it)) {
                    *goal = f64::INFINITY;
                }
            }
            let goal = (&goals[..], self.recipe.tolerance);
            // A stationary mean of q or q^2 does not change: E[v] and E[q v] are 0.
            [moments.mean_v.value, moments.cov_qv.value] = [0.0; 2];
            let zero = |k: usize| matches!(Moment::ALL[k], Moment::MeanV | Moment::CovQv);
            let left = |k: usize, _| if zero(k) { 0.0 } else { error(k) };
            let worst = judged(&mut moments, Origin::Space, goal, left);
            let first = Moment::ALL.len();
            let beside = |k: usize| {
                let value = fine.beside[k]?;
                Some(Estimate::new(value, error(first + k), Origin::Space))
            };
            let lost = moments.contact_loss_probability;
            let known = lost.is_some_and(|it| it.value > it.error);
            let rate = match lost {
                // Losses that are next to none are no more often than P(loss) leaves room for.
                Some(it) if !known => {
                    let value = beside(0).map_or(0.0, |it| it.value);
                    let room = it.error / mean_flight(self.oscillator);
                    Some(Estimate::new(value, room, it.origin))
                }
                _ => beside(0),
            };
            let functions = match &law {
                Law::Functions(_) => self.recipe.resolution(level).functions(),
                Law::OnMesh(it) => it.cells(),
            };
            let law = SolvedLaw {
                moments,
                loss_rate: rate,
                mean_flight: beside(1).filter(|_| known),
                mean_impact_speed: beside(2).filter(|_| known),
                dissipated: beside(3).unwrap_or_default(),
                functions,
                shortfall: None,
                law,
            };
            self.ratios.push(worst.0);
            let better = |best: &(SolvedLaw, f64, &str)| best.1.is_nan() || worst.0 <= best.1;
            if self.best.as_ref().is_none_or(better) {
                self.best = Some((law, worst.0, worst.1));
            }
        }
        Ok(())
    }

    fn answer(self, stop: Stop) -> Option<SolvedLaw> {
        let (law, ratio, name) = self.best?;
        let number = format!("{name} in the stationary law");
        Some(SolvedLaw {
            shortfall: stop.shortfall(number, ratio, self.recipe.tolerance),
            ..law
        })
    }
}
