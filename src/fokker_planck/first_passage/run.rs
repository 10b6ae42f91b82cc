//! The backward equation on one mesh with one step: curves, mean time and rate.

use super::absorbed::{Absorbed, kicks, least};
use super::bound::SEEN;
use super::driven::Driven;
use super::layout::{Asked, Layout};
use super::mesh::{AbsorbingMesh, Fineness};
use super::pontryagin::{LongRun, long_run};
use super::region::Region;
use super::start::{DEVIATIONS, Line, Start, Starts};
use crate::error::Result;
use crate::fokker_planck::budget::Limits;
use crate::fokker_planck::forcing::Forcing;
use crate::fokker_planck::solved::Settled;
use crate::gaussian::{lower, normal};
use crate::initial::Initial;
use crate::matrix::dot;
use crate::oscillator::Oscillator;
use rayon::prelude::*;

/// The numbers of one mesh and step.
#[derive(Debug, Clone, Default)]
pub(super) struct Run {
    pub(super) survival: Vec<f64>,
    pub(super) lost: Vec<f64>,
    /// What a survival continued in closed form may be off.
    pub(super) drift: Vec<f64>,
    pub(super) density: Vec<f64>,
    /// What the order of differentiation changes in the density, or its continuation.
    pub(super) wobble: Vec<f64>,
    pub(super) mean_time: f64,
    pub(super) rate: f64,
    pub(super) over_rice: f64,
    /// Relative errors of mean time and rate beyond mesh and step.
    pub(super) residuals: [f64; 2],
    pub(super) steps: u64,
    /// Weight of the start, lost at once or not: the probability of what it is given.
    pub(super) total: f64,
}

impl Run {
    /// The same at the times of `finer`, where it has every second of them: between them it differs by what it differed by
    /// before.
    pub(super) fn at_times_of(&self, finer: &Self) -> Self {
        let mut it = self.clone();
        let count = finer.survival.len();
        if self.survival.len() == count {
            return it;
        }
        for (all, (own, finer)) in [
            (&mut it.survival, (&self.survival, &finer.survival)),
            (&mut it.lost, (&self.lost, &finer.lost)),
            (&mut it.density, (&self.density, &finer.density)),
        ] {
            let at = |k: usize| finer[k] + own[k / 2] - finer[k - k % 2];
            *all = (0..count).map(at).collect();
        }
        it
    }
}

/// Losses up to each step.
struct Integration {
    gone: Vec<f64>,
    /// The same by detailed balance.
    left: Vec<f64>,
    /// Of what enters, in stationary motion.
    entered: Vec<f64>,
    /// The constant hazard a step of what survives after the last step, and its relative error; None where
    /// the integration went on to the end.
    hazard: Option<(f64, f64)>,
}

/// Survivals at the nodes, while much of the start is left.
struct Survivals {
    /// Those after the last of these steps.
    last: Vec<f64>,
    /// The sum of those before it.
    before: Vec<f64>,
}

impl Survivals {
    /// One step more, of these losses.
    fn add(&mut self, losses: &[f64]) {
        let fields = self.before.par_iter_mut().zip(&mut self.last).zip(losses);
        fields
            .with_min_len(NODES)
            .for_each(|((before, last), lost)| {
                *before += *last;
                *last -= lost;
            });
    }
}

impl Integration {
    /// Survival, losses and their density, each time `every` steps of length `step` on. `rate` is the hazard a step in the end, and
    /// what it may be off `doubt`; `entering` is what enters in stationary motion, for the stationary start alone.
    fn curves(
        &self,
        (inside, total, entering): (f64, f64, Option<f64>),
        (rate, step): (f64, f64),
        doubt: f64,
        every: usize,
        count: usize,
    ) -> Run {
        let last = self.gone.len() - 1;
        let mut run = Run::default();
        for k in 0..count {
            let n = k * every;
            // Beyond the last step the survival falls at the rate of its end.
            let (at, beyond) = if n + ENDS <= last || self.hazard.is_none() {
                (n, 0.0)
            } else {
                (last - ENDS, (n + ENDS - last) as f64)
            };
            // Where next to nothing is lost, the sum of what leaves keeps its digits.
            let gone = match self.left.get(at) {
                Some(left) if entering.is_some() && *left < 1e-6 * total => *left,
                _ => self.gone[at],
            };
            let held = (inside - gone / total).clamp(0.0, 1.0);
            let survival = held * (-rate * beyond).exp();
            run.survival.push(survival);
            let later = held * -(-rate * beyond).exp_m1();
            run.lost.push((1.0 - inside) + gone / total + later);
            run.drift.push(survival * doubt * beyond);
            let (density, wobble) = if beyond > 0.0 {
                // The slowest mode has the rate at the end to more digits than the losses of a step.
                let density = rate / step * survival;
                (density, density * doubt * (1.0 / rate + beyond))
            } else if let Some(entering) = entering {
                ((entering - self.entered[at]) / total, 0.0)
            } else {
                let slope = |half| derivative(&self.gone, at, half) / (step * total);
                let density: f64 = slope(3);
                (density, (slope(2) - density).abs())
            };
            run.density.push(density);
            run.wobble.push(wobble);
        }
        run
    }

    /// What the hazard a step may be off, if losses go on at `rate` a step.
    fn doubt(&self, rate: f64, rare: bool) -> f64 {
        match self.hazard {
            // Losses so rare drown, but for detailed balance, in the rounding of a mesh.
            Some((_, doubt)) if rare => doubt * rate,
            Some((hazard, doubt)) => doubt * hazard + (hazard - rate).abs(),
            None => 0.0,
        }
    }
}

/// Steps after the last one asked for.
const ENDS: usize = 3;

/// Nodes that one thread adds up at a time.
const NODES: usize = 16_384;

/// The part of a start that must be left for the survivals at the nodes to be added up: differences from 1, they lose digits as they
/// fall. Cautious.
const MUCH: f64 = 0.1;

/// What is asked of whom.
pub(super) struct Problem<'a> {
    /// As it moves up to the levels.
    pub(super) oscillator: &'a Oscillator,
    pub(super) initial: &'a Initial,
    pub(super) asked: Asked,
    /// What there is beside stationary noise.
    pub(super) forcing: Option<&'a Forcing>,
    pub(super) limits: Limits,
    /// The stationary law of a stationary start, where it has no closed form.
    pub(super) law: Option<Settled>,
}

impl Problem<'_> {
    /// Where the motion survives.
    pub(super) fn region(&self) -> Region<'_> {
        Region::new(self.oscillator, self.asked.barrier)
    }

    /// exp(-H/T)/Z as weights, and the lines of them.
    fn gibbs(&self, starts: &Starts) -> Result<(Vec<Line>, Start)> {
        let deviation = self.oscillator.temperature().sqrt();
        let law = self.oscillator.displacement_law()?;
        let density = |x: f64| starts.region.density(&law, x);
        let lines = starts.displacements(0.5 * deviation, density)?;
        let it = starts.lines(&lines, 0.0, deviation)?;
        Ok((lines, it))
    }

    /// The start as weights, and what its survival is divided by; `gibbs` where it is there.
    fn start(&self, starts: &Starts, gibbs: Option<&Start>) -> Result<(Start, f64)> {
        let region = starts.region;
        Ok(match region.seen(self.initial) {
            Initial::Rest => (starts.point([0.0, 0.0])?, 1.0),
            Initial::Stationary => {
                let it = match (&self.law, gibbs) {
                    (None, Some(it)) => it.clone(),
                    (None, None) => self.gibbs(starts)?.1,
                    (Some(it), _) => {
                        let own = self.oscillator.temperature();
                        // A law that friction in contact alone keeps up has longer tails than one up to the loss.
                        let hottest = self.asked.reference.map_or(own, |it| it.max(own));
                        let [scale, edge] = [0.5 * own.sqrt(), DEVIATIONS * hottest.sqrt()];
                        let lines = starts.displacements(scale, |_| 1.0)?;
                        let law = |x: f64, v: &[f64]| region.along(&it.law, x, v);
                        starts.weighed(&lines, (scale, edge), &law)?
                    }
                };
                let total = it.total;
                (it, total)
            }
            Initial::Gaussian { mean, deviation } => {
                let density = |q: f64| normal((q - mean[0]) / deviation[0]) / deviation[0];
                let lines = starts.displacements(deviation[0], density)?;
                let it = starts.lines(&lines, mean[1], deviation[1])?;
                // The mesh ends five deviations away: what is beyond is with the rest of what has not passed.
                let barrier = region.barrier;
                let below = |x: f64| lower((x - mean[0]) / deviation[0]);
                let above = barrier.high.map_or(0.0, |high| below(2.0 * mean[0] - high));
                let inside = 1.0 - below(barrier.low) - above;
                let total = if inside > 0.5 { it.total / inside } else { 1.0 };
                (it, total)
            }
        })
    }

    /// The numbers of one mesh and step, at the times of the layout.
    pub(super) fn once(
        &self,
        layout: &Layout,
        fineness: &Fineness,
        progress: &dyn Fn(f64),
    ) -> Result<Run> {
        let it = self.oscillator;
        let late = self.limits.late(self.asked.name);
        let region = &self.region();
        let (mesh, step) = (&AbsorbingMesh::new(region, fineness)?, fineness.step);
        let noise = kicks(region, mesh, step);
        let starts = Starts {
            region,
            mesh,
            step,
            spread: least(&noise),
            late: &late,
        };
        if let Some(forcing) = self.forcing {
            let (start, total) = self.start(&starts, None)?;
            let driven = Driven::new(region, mesh, step, (forcing, &start));
            return self.driven(layout, driven, (&start, total), progress);
        }
        let absorbed = Absorbed::new(region, mesh, (step, &noise), &late)?;
        let (lines, stationary) = self.gibbs(&starts)?;
        let (start, total) = self.start(&starts, Some(&stationary))?;
        let law = it.displacement_law()?;
        // What leaves two levels, or a law that is not exp(-H/T)/Z, is known by time integration alone.
        let low = self.asked.barrier.low;
        let leaving = if region.balances() && region.density(&law, low) > SEEN {
            let entering = starts.entering(region.density(&law, low))?;
            Some([starts.outflow(&lines, absorbed.lost_first())?, entering])
        } else {
            None
        };
        let balance = leaving.as_ref().map(|[out, into]| [out, into]);
        let known = *self.initial == Initial::Stationary && self.law.is_none();
        let balance = balance.filter(|_| known);
        let (every, times) = layout.of_steps(step);
        let (integration, survivals) = self.integrate(
            &absorbed,
            &start,
            balance,
            every * (times - 1),
            (0.5 * layout.correlation_time / step).ceil() as usize,
            &|part| progress(0.4 * part),
        )?;
        let of = (&absorbed, &survivals);
        let long = self.long_run_of(layout, fineness, of, &stationary, leaving.as_ref())?;
        progress(1.0);
        let held = dot(&stationary.weights, &long.mode);
        let rate = long.exponent / step;
        let unlike = long.sum.as_ref().map_or(0.0, |_| long.residuals[1]);
        let crossed = region.density(&law, low)
            + region
                .barrier
                .high
                .map_or(0.0, |high| region.density(&law, high));
        let rice = if self.asked.reference.is_none() {
            crossed * it.temperature().sqrt() * normal(0.0)
        } else {
            f64::NAN
        };
        let inside = start.total / total;
        let last = integration.gone.len() - 1;
        // Where the mode is rounding, what is lost of those that survive still has digits.
        let lasting = match integration.hazard {
            Some((hazard, _)) if rate <= 0.0 => hazard,
            _ => rate * step,
        };
        let doubt = integration.doubt(lasting, long.sum.is_none()) + unlike * lasting;
        let ends = (inside, total, balance.map(|[_, entering]| entering.total));
        let mut run = integration.curves(ends, (lasting, step), doubt, every, times);
        let mean_time = match &long.sum {
            Some(sum) => {
                let sum = dot(&start.weights, sum);
                // Trapezes with the first correction of Euler and Maclaurin.
                step * (0.5 * inside + sum / total) - step * step / 12.0 * run.density[0]
            }
            None => {
                let seen = dot(&start.weights, &long.mode) / total;
                seen * stationary.total / (held * rate)
            }
        };
        let forgets = if long.sum.is_none() {
            rate * layout.correlation_time
        } else {
            0.0
        };
        run.mean_time = mean_time;
        // Below rounding, where no detailed balance tells it, it is not known.
        run.rate = if rate > 0.0 { rate } else { f64::NAN };
        run.total = total;
        run.over_rice = run.rate * stationary.total / rice;
        run.residuals = [long.residuals[0] + forgets, unlike];
        run.steps = last as u64 + long.steps;
        Ok(run)
    }

    /// What comes after the integration; by detailed balance from what leaves the stationary law, where that is known.
    fn long_run_of(
        &self,
        layout: &Layout,
        fineness: &Fineness,
        (absorbed, survivals): (&Absorbed, &Survivals),
        stationary: &Start,
        leaving: Option<&[Start; 2]>,
    ) -> Result<LongRun> {
        let Fineness { nodes, step, .. } = *fineness;
        let enough = 1e-3 * self.asked.tolerance.min(1e-3);
        // Losses a step of a mode, by detailed balance; small numbers keep their digits.
        let per_step = |mode: &[f64]| {
            let [outflow, _] = leaving?;
            Some(dot(&outflow.weights, mode) / dot(&stationary.weights, mode))
        };
        // Next to nothing is lost while a motion forgets its energy: that has digits below rounding, but sees the mesh near
        // the level, as the factor of a mode hardly does.
        let rare = |mode: &[f64]| {
            let forgotten = |it: &f64| it * layout.correlation_time / step;
            per_step(mode).filter(|it| forgotten(it) < 0.3 * self.asked.tolerance)
        };
        long_run(
            absorbed,
            (&survivals.last, &survivals.before),
            (&stationary.weights, nodes[1]),
            self.region().equilibria().count().div_ceil(2).max(1),
            (layout.stride(step), enough),
            &rare,
            &self.limits.late(self.asked.name),
        )
    }

    /// Survival and density under a forcing; without a rate, since nothing lasts, and without a mean time, which would
    /// want all times.
    fn driven(
        &self,
        layout: &Layout,
        mut driven: Driven<'_>,
        (start, total): (&Start, f64),
        progress: &dyn Fn(f64),
    ) -> Result<Run> {
        let late = self.limits.late(self.asked.name);
        let (every, times) = layout.of_steps(driven.step());
        let count = every * (times - 1);
        let (mut gone, mut whole) = (vec![0.0], start.lost);
        while gone.len() <= count + ENDS {
            let [first, second] = driven.advance(&late)?;
            // The first half of a motion ends at the time of this step, its second half in the next.
            gone.push(whole + first);
            whole += first + second;
            progress(gone.len() as f64 / (count + ENDS) as f64);
        }
        let steps = gone.len() as u64;
        let integration = Integration {
            gone,
            left: Vec::new(),
            entered: Vec::new(),
            hazard: None,
        };
        let ends = (start.total / total, total, None);
        let run = integration.curves(ends, (0.0, driven.step()), 0.0, every, times);
        Ok(Run {
            mean_time: f64::NAN,
            rate: f64::NAN,
            over_rice: f64::NAN,
            total,
            steps,
            ..run
        })
    }

    /// Losses step by step, until they are constant in what survives. The stationary law loses in each step
    /// what leaves it of those that have survived (`balance`: outflow and what enters), by detailed
    /// balance: no small part of a small number.
    fn integrate(
        &self,
        absorbed: &Absorbed,
        start: &Start,
        balance: Option<[&Start; 2]>,
        count: usize,
        window: usize,
        progress: &dyn Fn(f64),
    ) -> Result<(Integration, Survivals)> {
        let first = |it: &Start| it.lost + dot(&it.weights, absorbed.lost_first());
        // Summed from the losses in each step, so that small parts keep their digits.
        let mut leaving = balance.map_or(0.0, |[outflow, _]| outflow.total - first(outflow));
        let mut integration = Integration {
            gone: vec![0.0, first(start)],
            left: vec![0.0, balance.map_or(0.0, |[it, _]| it.total)],
            entered: vec![0.0, balance.map_or(0.0, |[_, it]| first(it))],
            hazard: None,
        };
        let mut survivals = Survivals {
            last: absorbed.survival_first(),
            before: vec![0.0; absorbed.len()],
        };
        let late = self.limits.late(self.asked.name);
        let mut losses = absorbed.lost_second();
        let mut scratch = vec![0.0; losses.len()];
        let mut hazards = [f64::INFINITY; 3];
        let mut much = true;
        // As many steps more as the differences at the end want.
        while integration.gone.len() <= count + ENDS {
            let n = integration.gone.len();
            integration
                .gone
                .push(integration.gone[n - 1] + dot(&start.weights, &losses));
            if let Some([outflow, entering]) = balance {
                integration.left.push(integration.left[n - 1] + leaving);
                leaving -= dot(&outflow.weights, &losses);
                let entered = integration.entered[n - 1] + dot(&entering.weights, &losses);
                integration.entered.push(entered);
            }
            much &= start.total - integration.gone[n] > MUCH * start.total;
            if much {
                survivals.add(&losses);
            }
            absorbed.advance(&mut losses, &mut scratch);
            late()?;
            if n.is_multiple_of(16) {
                progress(n as f64 / count as f64);
            }
            if n.is_multiple_of(window) {
                let before = integration.gone[n - window];
                let part = (integration.gone[n] - before) / (start.total - before);
                hazards = [hazards[1], hazards[2], -(-part).ln_1p() / window as f64];
                let [a, b, c] = hazards;
                let (change, earlier) = ((c - b).abs(), (b - a).abs());
                // What is left of a change that shrinks geometrically, at the pace of energy or slower.
                let pace = (change / earlier).max((-0.5f64).exp());
                let doubt = change / (1.0 - pace) / c;
                if c > 0.0 && pace < 0.9 && doubt < 1e-2 * self.asked.tolerance {
                    integration.hazard = Some((c, doubt));
                    break;
                }
            }
        }
        progress(1.0);
        Ok((integration, survivals))
    }
}

/// Slope at point k of values a unit apart, by the polynomial through 2 half + 1 of them, central where
/// they are there: order 2 half.
fn derivative(values: &[f64], k: usize, half: usize) -> f64 {
    let points = (2 * half + 1).min(values.len());
    let first = k.saturating_sub(half).min(values.len() - points);
    let z = (k - first) as f64;
    let mut slope = 0.0;
    for a in 0..points {
        // Derivative of the Lagrange polynomial of node a at node z.
        let mut weight = 0.0;
        for b in 0..points {
            if b == a {
                continue;
            }
            let mut product = 1.0 / (a as f64 - b as f64);
            for c in 0..points {
                if c != a && c != b {
                    product *= (z - c as f64) / (a as f64 - c as f64);
                }
            }
            weight += product;
        }
        slope += weight * values[first + a];
    }
    slope
}
