//! Steps, meshes and times of the backward equation.

use super::driven::{NEEDLE, PARTS, RULE};
use super::mesh::{Fineness, POINTS, Stencil, extent, grade};
use super::pontryagin::FULL;
use super::region::{Barrier, Region};
use super::start::DEVIATIONS;
use crate::contact::ContactLaw;
use crate::first_step;
use crate::fokker_planck::budget::{self, Cost, timing};
use crate::fokker_planck::forcing::Forcing;
use crate::fokker_planck::policy::LADDER_RATIO;
use crate::gaussian::lower;
use crate::initial::Initial;
use crate::inrush::Inrush;
use crate::oscillator::Oscillator;
use std::f64::consts::TAU;

/// What runs with other steps differ by, over the error of the mesh that they share, if it is that of the mesh alone.
const OF_A_MESH: f64 = 3.0;

/// How far the mesh goes above a barrier between two wells, in T.
const OVER_A_BARRIER: f64 = 8.0;

/// -ln p of a cause of passages that is looked for.
const RAREST: u32 = 100;

/// Most output times after t = 0: each is a stop for the steps.
const MOST_OUTPUTS: f64 = 200.0;

/// What is asked, and what the scene fixes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Asked {
    /// The question in messages.
    pub(super) name: &'static str,
    /// The loss point, or any other level.
    pub(super) barrier: Barrier,
    /// T of what the stationary law is weighed with, where that is not exp(-H/T)/Z.
    pub(super) reference: Option<f64>,
    pub(super) until: f64,
    pub(super) tolerance: f64,
    pub(super) step: Option<f64>,
    pub(super) cells: Option<[usize; 2]>,
}

impl Asked {
    /// Whether mesh and steps are the program's choice.
    pub(super) fn is_free(&self) -> bool {
        self.step.is_none() && self.cells.is_none()
    }
}

/// Part of the time in which noise turns a motion back that a step takes at most, to see it.
const WITHIN_A_TURN: f64 = 0.25;

/// Steps, meshes and times of a task.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    pub(super) times: Vec<f64>,
    /// Steps between times of the fine run, two or a multiple of four.
    pub(super) every: usize,
    pub(super) step: f64,
    /// Longest step that sees noise turn a motion back at the level.
    resolving: f64,
    pub(super) nodes: [usize; 2],
    pub(super) level: f64,
    /// The highest speed on the mesh.
    speed: f64,
    /// Time over which the motion forgets.
    pub(super) correlation_time: f64,
    /// Part of the losses that begins beyond the edge of the mesh.
    pub(super) outside: f64,
    /// Part of the initial condition that is beyond it.
    pub(super) unseen: f64,
    /// Whether each step has its own kick.
    pub(super) driven: bool,
    /// The deviation of the weakest of them over that of the strongest.
    faded: f64,
    /// The finest cell along v, times their number.
    finest: f64,
}

/// The step that noise which turns motions back at the levels makes of an automatic one, and the longest that sees it: a quarter of
/// the time 2 pi h/f^2 in which it turns a motion back that the force f takes through the level. Four steps within that time err
/// as extrapolation has it; steps of about as long err with both signs, and no order shows. Steps that are longer from the first, as
/// where friction is weak, miss little, and stay.
fn turning(
    region: &Region<'_>,
    oscillator: &Oscillator,
    barrier: &Barrier,
    automatic: f64,
) -> [f64; 2] {
    let levels = [Some(barrier.low), barrier.high].into_iter().flatten();
    let turned = levels.map(|x| TAU * oscillator.h() / region.force(x).powi(2));
    let longer = turned.clone().filter(|it| *it > automatic);
    let wanted = longer
        .map(|it| WITHIN_A_TURN * it)
        .fold(automatic, f64::min);
    [wanted, WITHIN_A_TURN * turned.fold(f64::INFINITY, f64::min)]
}

/// What noise may decide on within the first step of the first run, and halvings of it at most: later rounds halve it further.
const DECIDED: (f64, u32) = (0.1, 4);

impl Layout {
    /// The layout of the first run under stationary noise, or under a forcing: that of its strongest noise, farther by as
    /// much as the drive swings, in steps that see it turn.
    pub(super) fn of(
        oscillator: &Oscillator,
        initial: &Initial,
        asked: &Asked,
        forcing: Option<&Forcing>,
    ) -> Self {
        let temperature = oscillator.temperature();
        let oscillator = forcing.map_or(oscillator, Forcing::noise);
        let swing = forcing.map_or(0.0, Forcing::swing);
        let drive = forcing.and_then(|it| it.excitation().drive);
        let Asked {
            barrier,
            until,
            tolerance,
            ..
        } = *asked;
        let region = Region::new(oscillator, barrier);
        let t = oscillator.temperature();
        let rise = region.rise();
        // One hundredth of the tolerance above the edge, a start with its Gaussian, and the way from well to well.
        let least = (100.0 / tolerance).ln().clamp(8.0, 30.0) + 2.0;
        let hotter = match initial {
            Initial::Stationary => asked.reference.map_or(1.0, |it| it / temperature),
            _ => 1.0,
        };
        let mut level = least * hotter;
        let cause = rarity(&region);
        if cause > 0.0 {
            level = level.max((oscillator.energy_at(cause + least) - rise) / t);
        }
        if let Some(top) = oscillator.contact().barrier() {
            level = level.max((top - rise) / t + OVER_A_BARRIER);
        }
        for [q, v] in corners(&region.seen(initial)) {
            let q = q.max(barrier.low);
            let q = barrier.high.map_or(q, |high| q.min(high));
            level = level.max((0.5 * v * v + region.height(q) - rise) / t);
        }
        // Flights that friction asks for are no rarer beyond the edge than that.
        let beyond = if cause > 0.0 { least } else { level / hotter };
        let outside = (-beyond).exp() * (1.0 + beyond);
        let speed = (2.0 * (rise + level * t)).sqrt() + swing;
        let level = if forcing.is_none() {
            level
        } else {
            (0.5 * speed * speed - rise) / temperature
        };
        // A motion must not come back to the loss point within a step: a quarter of the fastest bounce.
        let bounce = match barrier.high {
            None => bounce(&region, speed),
            // From level to level at the highest speed.
            Some(high) => (high - barrier.low) / speed,
        };
        // Noise gathered at the middle of a step errs by 2 pi h step^3/24 in the variance of q where the
        // law varies on the scale T of U: half the tolerance of T^2.
        let zeta = if oscillator.is_viscous() {
            oscillator.zeta()
        } else {
            let fast = (2.0 * (rise + t)).sqrt() + swing;
            0.5 * strongest(&region, 0.5 * fast * fast)
        };
        let noisy = (6.0 * tolerance * t / zeta).cbrt();
        let damped = (12.0 * tolerance / zeta).sqrt();
        let automatic = 0.5f64.min(noisy).min(damped).min(0.25 * bounce);
        let automatic = automatic.min(drive.map_or(0.5, |it| 0.5 / it.frequency()));
        let [automatic, resolving] = turning(&region, oscillator, &barrier, automatic);
        let undecided = |step| region.undecided(initial, step);
        let automatic = first_step::halved(automatic, undecided, DECIDED);
        let longest = asked.step.unwrap_or(automatic);
        // The coarsest step is four times the fine one and ends on every time, or on every second one.
        let pairs = until / (2.0 * longest);
        let (each, every) = if pairs <= MOST_OUTPUTS {
            (1.0, 2)
        } else {
            let each = (0.5 * pairs / MOST_OUTPUTS).ceil();
            (2.0 * each, 4 * each as usize)
        };
        // A short time has fewer: each of its steps costs as much as a long one, on more nodes.
        let least = (4.0 * until / longest).clamp(2.0, 8.0);
        let outputs = (pairs / each).max(least).ceil();
        let gap = until / outputs;
        let step = gap / every as f64;
        let correlation_time = oscillator.correlation_time();
        let right = region.turning_point(rise + level * temperature);
        let right = barrier.high.or(right).unwrap_or(barrier.low);
        let unseen = match region.seen(initial) {
            Initial::Gaussian { mean, deviation } => {
                let edge = (right - mean[0]) / deviation[0];
                2.0 * lower(-DEVIATIONS) + barrier.high.map_or(lower(-edge), |_| 0.0)
            }
            Initial::Rest | Initial::Stationary => 0.0,
        };
        let nodes = match asked.cells {
            Some(cells) => cells.map(|n| n.max(16)),
            None => {
                // The interpolation of order 6 errs once a step.
                let part = (2.0 * step * tolerance / 1e-3).powf(1.0 / 6.0);
                nodes((&region, right), speed, step, part)
            }
        };
        Self {
            times: (0..=outputs as usize).map(|k| k as f64 * gap).collect(),
            every,
            step,
            resolving,
            nodes,
            level,
            speed,
            correlation_time,
            outside,
            unseen,
            driven: forcing.is_some(),
            faded: forcing.map_or(1.0, |it| it.excitation().faded(until)),
            finest: along_v(speed, grade(rise, t)),
        }
    }

    /// The next layout, for what the mesh and the step err, over the tolerance: the mesh is made finer, and
    /// the steps where they err by more than a mesh so coarse may make of them; with them the mesh too, which errs by more
    /// the more often it is interpolated on.
    pub(super) fn finer(&self, [mesh, step]: [f64; 2]) -> Self {
        let mut it = self.clone();
        let mut wanted = 2.0 * mesh;
        let halve = step > OF_A_MESH * mesh;
        if halve {
            it.every *= 2;
            it.step *= 0.5;
            // Twice as many interpolations, of what a kick smooths over half the root of the distance.
            wanted *= 2.0 * 2f64.sqrt().powi(POINTS as i32);
        }
        if !halve || wanted > 1.0 {
            let times = wanted
                .powf(1.0 / POINTS as f64)
                .clamp(LADDER_RATIO.get(), 2.0);
            it.nodes = it.nodes.map(|n| (n as f64 * times).ceil() as usize);
        }
        it
    }

    /// Whether its steps see noise turn a motion back at the level: what shorter ones change then follows from longer ones.
    pub(super) fn resolves(&self) -> bool {
        self.step <= self.resolving
    }

    /// The mesh and the step of a run: the fine one, on a coarser mesh, of twice and four times the step.
    pub(super) fn runs(&self) -> [Fineness; 4] {
        let Self {
            nodes, step, level, ..
        } = *self;
        let coarse = nodes.map(|n| ((n as f64 / LADDER_RATIO.get()) as usize).max(12));
        let of = |nodes, step| Fineness { nodes, step, level };
        let steps = [step, 2.0 * step, 4.0 * step].map(|step| of(nodes, step));
        [steps[0], of(coarse, step), steps[1], steps[2]]
    }

    /// Steps of another length between two of the times that they end on, and how many times these are.
    pub(super) fn of_steps(&self, step: f64) -> (usize, usize) {
        let every = self.every as f64 * self.step / step;
        if every < 0.75 {
            return (1, self.times.len().div_ceil(2));
        }
        (every.round() as usize, self.times.len())
    }

    /// Krylov vectors a tenth of the correlation time apart, and a quarter of a period at the least: closer ones span
    /// too little of an oscillation to tell it from the slowest mode.
    pub(super) fn stride(&self, step: f64) -> usize {
        let apart = (0.1 * self.correlation_time).max(1.5);
        (apart / step).ceil().clamp(1.0, 1e6) as usize
    }

    fn steps(&self) -> f64 {
        (self.every * (self.times.len() - 1)) as f64
    }

    /// Quadrature points of a row: 3.2 a deviation of the noise.
    fn points(&self, oscillator: &Oscillator) -> f64 {
        let t = oscillator.temperature();
        let spread = (t * -(-4.0 * oscillator.zeta() * self.step).exp_m1()).sqrt();
        let each = 3.2 * 2.0 * self.speed;
        if self.faded == 1.0 {
            return each / spread;
        }
        // Rules serve noise that fades to half of what they are laid out for, down to where each node has points of its own.
        let needle = NEEDLE * self.finest / self.nodes[1] as f64;
        let own = if self.faded * spread < needle {
            RULE as f64 * self.nodes[1] as f64
        } else {
            0.0
        };
        own.max(each / spread.min(0.5 * needle.max(self.faded * spread)))
    }

    /// A stencil a point; a kernel of 48 points a node, where rows share none; Krylov vectors. Under a forcing no kernel is
    /// kept, and the points carry what they pass on.
    fn memory_bytes(&self, oscillator: &Oscillator) -> f64 {
        let [nq, nv] = self.nodes.map(|n| n as f64);
        let stencil = size_of::<Stencil>() as f64;
        let (point, kernel, vectors) = if self.driven {
            (stencil + 24.0, 0.0, 10 + PARTS)
        } else {
            (stencil, 48.0 * 8.0, 18 + FULL)
        };
        nq * (self.points(oscillator) * point + nv * (kernel + 8.0 * vectors as f64))
    }

    /// What the fine run takes, and those that measure its error.
    pub(super) fn cost(&self, oscillator: &Oscillator) -> Cost {
        let [nq, nv] = self.nodes.map(|n| n as f64);
        let (points, steps) = (self.points(oscillator), self.all_steps());
        let contact = oscillator.contact();
        let map = match contact {
            ContactLaw::Custom(_) => {
                // A table has a kink at each of its points.
                let passed = 0.5 * oscillator.temperature().sqrt() * self.step;
                let pieces = contact.pieces().iter();
                let kinks = pieces.filter(|it| it.from.abs() < passed).count();
                (1 + kinks) as f64 * timing::TRACED_ABSORBED_MAP
            }
            _ => timing::ABSORBED_MAP,
        };
        let seconds =
            points * (map + timing::ABSORBED_POINT * steps) + nv * self.node_seconds() * steps;
        Cost {
            cells: Some(self.nodes),
            steps: steps as u64,
            memory: self.memory_bytes(oscillator) as u64,
            // The runs that measure the error take longer than the fine one.
            seconds: budget::on_all_threads(2.3 * nq * seconds),
        }
    }

    /// Seconds of a node in a step: its kernel is there, or made.
    fn node_seconds(&self) -> f64 {
        if self.driven {
            timing::DRIVEN_NODE
        } else {
            timing::ABSORBED_NODE
        }
    }

    /// Steps of a fine run, with those of the long run.
    fn all_steps(&self) -> f64 {
        if self.driven {
            return self.steps();
        }
        self.steps().min(10.0 * self.correlation_time / self.step)
            + VECTORS * self.stride(self.step) as f64
    }
}

/// Krylov vectors of a long run: 5 where losses are rare, 11 elsewhere, some 35 between two wells.
const VECTORS: f64 = 12.0;

/// The ends of an initial condition, five deviations of a Gaussian away.
fn corners(initial: &Initial) -> Vec<[f64; 2]> {
    match initial {
        Initial::Gaussian { mean, deviation } => {
            let far = |k: usize, sign: f64| mean[k] + sign * 5.0 * deviation[k];
            let signs = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
            signs.map(|(a, b)| [far(0, a), far(1, b)]).to_vec()
        }
        Initial::Rest => vec![[0.0; 2]],
        Initial::Stationary => Vec::new(),
    }
}

/// Nodes so that the mesh of v follows the noise of a step: half its deviation (times `part`) at the turning
/// points, where contact is lost, which errs by a few 1e-4 at a step of 0.5. In sqrt(q - q_loss) survival is
/// smoother: 0.7 as many, and near the level they are no farther apart in speeds of a fall than 2.5 times those of v.
fn nodes((region, right): (&Region<'_>, f64), speed: f64, step: f64, part: f64) -> [usize; 2] {
    const SMOOTHER: f64 = 2.5;
    let (oscillator, rise) = (region.oscillator, region.rise());
    let t = oscillator.temperature();
    let spread = (t * -(-4.0 * oscillator.zeta() * step).exp_m1()).sqrt();
    let length = along_v(speed, grade(rise, t));
    let v = length / (0.5 * part * spread);
    // More do not fit a run of seconds; the error then says so.
    let v = v.clamp(80.0, 600.0);
    let [bend, reach] = extent(region, right);
    let q = (bend * reach / (SMOOTHER * (length / v))).max(0.7 * v);
    [q as usize, v as usize]
}

/// The finest cell along v, times their number.
fn along_v(speed: f64, grade: f64) -> f64 {
    2.0 * (speed / grade).asinh() * grade
}

/// Time from the loss point back to it at this speed.
fn bounce(region: &Region<'_>, speed: f64) -> f64 {
    let loss = region.barrier.low;
    // A motion that takes longer than the last of these is slow.
    let times: Vec<f64> = (-60..=20).map(|k| (0.1 * f64::from(k)).exp()).collect();
    let mut ends = vec![[0.0; 2]; times.len()];
    region.after(&[[loss, speed]], &times, &mut ends);
    let back = ends.iter().position(|end| end[0] <= loss);
    back.map_or(f64::INFINITY, |k| times[k.saturating_sub(1)])
}

/// -ln p of the likeliest cause of a passage that friction holds back, be it the speed of a flight or noise against it: the least
/// rarity whose motions come so deep. 0 where friction holds nothing back, or where none up to [`RAREST`] does.
fn rarity(region: &Region<'_>) -> f64 {
    let (it, Barrier { low, high, .. }) = (region.oscillator, region.barrier);
    let contact = it.contact();
    let (Some(walls), Some(lowest)) = (contact.flight(), contact.lowest_potential()) else {
        return 0.0;
    };
    let levels = region.range(low, high.unwrap_or(f64::INFINITY));
    let ends = levels.map(|q| if q.is_finite() { q } else { walls[1] });
    let held = it.holds_back(ends);
    if held == [false; 2] {
        return 0.0;
    }
    let at_wall = contact.potential(walls[1]) - lowest;
    let passes = |rarity: &f64| {
        let inrush = Inrush {
            certain: 0.0,
            highest: (2.0 * (it.energy_at(*rarity) - at_wall)).max(0.0).sqrt(),
            push: 0.0,
            rarity: *rarity,
        };
        let reached = inrush.reach(it, ends);
        (0..2).any(|k| held[k] && (reached[k] - ends[k]).abs() < 1e-9 * (ends[k] - walls[k]).abs())
    };
    let mut rarities = (1..=RAREST).map(f64::from);
    rarities.find(passes).unwrap_or(0.0)
}

/// The largest rate of friction where an energy above the lowest reaches, and friction lets it.
fn strongest(region: &Region<'_>, rise: f64) -> f64 {
    let low = region.barrier.low;
    let high = region.barrier.high.or(region.turning_point(rise));
    let mut ends = [low, high.unwrap_or(low)].map(|x| region.q(x));
    ends.sort_by(f64::total_cmp);
    let it = region.oscillator;
    let inrush = Inrush {
        certain: 0.0,
        highest: (2.0 * rise).sqrt(),
        push: 0.0,
        rarity: rise / it.temperature(),
    };
    it.highest_friction_between(inrush.reach(it, ends))
}
