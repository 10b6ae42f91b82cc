//! One step: how (q, v) advances under noise, friction and contact force.

use super::events::{PATIENCE, Watch};
use super::hamiltonian::Flow;
use super::law::Law;
use super::noise::{LANES, Lanes, Streams};
use super::signal::Signal;
use crate::excitation::Excitation;
use crate::oscillator::Oscillator;
use std::fmt;
use std::sync::Arc;

/// How one step is made. The weak order is that of E\[f(q, v)\] at a fixed time for smooth f.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Scheme {
    /// With white noise [`Scheme::Splitting42`], under strong friction (zeta above twice the highest
    /// frequency) [`Scheme::ExponentialHeun`]; with a sum of cosines [`Scheme::CentralDifference`].
    #[default]
    Auto,
    /// Central differences in time for q'' and q', as in the paper, section 5.2; with white noise this is
    /// the scheme of Bruenger, Brooks and Karplus, Chem. Phys. Lett. 105:495 (1984).
    ///
    /// Weak order 2 in q. The velocity at a whole step knows half of that step's noise: in v there is a
    /// term of order zeta step. Bias for G = q: Var q is T/(1 - step^2/4), Var v is T/(1 + zeta step); the
    /// phase leads by step^2/24 a unit of time.
    CentralDifference,
    /// Kick B, drift A, exact Ornstein-Uhlenbeck step O, drift A, kick B.
    ///
    /// Weak order 2. Bias for G = q: Var q exact, Var v is T (1 - step^2/4); the phase leads by step^2/24
    /// a unit of time. Leimkuhler & Matthews, AMRX 2013(1), 34-56.
    Baoab,
    /// H(c1) O(1/2) H(c2) O(1/2) H(c1) with c1 = 1/2 - sqrt 3/6 and c2 = sqrt 3/3: the undamped motion H,
    /// crossings of the loss point located, between exact Ornstein-Uhlenbeck steps O.
    ///
    /// Weak error O(zeta step^4 + zeta^2 step^2). Both parts preserve the stationary law, so it has no
    /// bias at any step. McLachlan, BIT 35:258 (1995); Laskar and Robutel, Celest. Mech. Dyn. Astron.
    /// 80:39 (2001).
    Splitting42,
    /// H(c1) O(5/18) H(c2) O(8/18) H(c2) O(5/18) H(c1) with c1 = 1/2 - sqrt 15/10 and c2 = sqrt 15/10.
    ///
    /// Weak error O(zeta step^6 + zeta^2 step^2), otherwise as [`Scheme::Splitting42`].
    Splitting62,
    /// Euler and Maruyama: v and q from the old state. The warning example.
    ///
    /// Weak order 1. Its damping is 2 zeta - step: a weakly damped oscillator gains energy without
    /// bound once step > 2 zeta, and before that its stationary variances are 1/(1 - step/(2 zeta))
    /// times too large.
    EulerMaruyama,
    /// Friction and noise of q and v together exactly, the force held straight between its values at
    /// both ends (predicted, then corrected): for strong friction, where its step is bound by the slow
    /// drift, not by 1/zeta.
    ///
    /// Weak order 2. Bias for G = q: Var v is too small by at most 1/(4 zeta^2) of itself, Var q by some
    /// (step/(2 zeta))^2. Crossings of the loss point are not located. After Cox and Matthews, J. Comput.
    /// Phys. 176:430 (2002), scheme ETD2RK.
    ExponentialHeun,
}

impl Scheme {
    /// The name used in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::CentralDifference => "central_difference",
            Self::Baoab => "baoab",
            Self::Splitting42 => "splitting_4_2",
            Self::Splitting62 => "splitting_6_2",
            Self::EulerMaruyama => "euler_maruyama",
            Self::ExponentialHeun => "exponential_heun",
        }
    }

    /// Whether losses and returns of contact are located within a step.
    pub fn locates_crossings(self) -> bool {
        self != Self::ExponentialHeun
    }
}

impl fmt::Display for Scheme {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The paths that advance together.
#[derive(Debug, Clone)]
pub(super) struct Group {
    pub(super) q: Lanes,
    pub(super) v: Lanes,
    /// The excitation at this moment, where the scheme takes it at whole steps.
    pub(super) excitation: Lanes,
    pub(super) streams: Streams,
    /// The sum of cosines in place of white noise.
    pub(super) signal: Option<Signal>,
    /// What there is beside stationary noise; the splittings know it.
    pub(super) push: Option<Arc<Excitation>>,
}

/// What a scheme computes once for every step of the same length.
#[derive(Debug, Clone, Copy)]
pub(super) enum Coefficients {
    CentralDifference(CentralDifference),
    Baoab(Baoab),
    Splitting42(Splitting<2>),
    Splitting62(Splitting<3>),
    EulerMaruyama(EulerMaruyama),
    ExponentialHeun(ExponentialHeun),
}

impl Coefficients {
    /// The coefficients of `scheme` for `step`; `frequency` is the highest of the scene.
    pub(super) fn new(scheme: Scheme, oscillator: &Oscillator, step: f64, frequency: f64) -> Self {
        match scheme {
            Scheme::CentralDifference => {
                Self::CentralDifference(CentralDifference::new(oscillator, step))
            }
            Scheme::Baoab => Self::Baoab(Baoab::new(oscillator, step)),
            Scheme::Auto | Scheme::Splitting42 => {
                let c = 3f64.sqrt() / 6.0;
                let (motions, weights) = ([0.5 - c, 2.0 * c, 2.0 * (0.5 - c)], [0.5, 0.5]);
                Self::Splitting42(Splitting::new(
                    oscillator, step, frequency, motions, weights,
                ))
            }
            Scheme::Splitting62 => {
                let c = 15f64.sqrt() / 10.0;
                let motions = [0.5 - c, c, 2.0 * (0.5 - c)];
                let weights = [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0];
                Self::Splitting62(Splitting::new(
                    oscillator, step, frequency, motions, weights,
                ))
            }
            Scheme::EulerMaruyama => Self::EulerMaruyama(EulerMaruyama::new(oscillator, step)),
            Scheme::ExponentialHeun => {
                Self::ExponentialHeun(ExponentialHeun::new(oscillator, step))
            }
        }
    }

    /// Advances `group` by `steps` steps; `now` is the time at the beginning, told to `watch`.
    #[inline(always)]
    pub(super) fn advance<L: Law, W: Watch>(
        &self,
        law: L,
        group: &mut Group,
        steps: u64,
        now: f64,
        watch: &mut W,
    ) {
        match self {
            Self::CentralDifference(kernel) => {
                kernel_steps(law, *kernel, group, steps, now, watch);
            }
            Self::Baoab(kernel) => kernel_steps(law, *kernel, group, steps, now, watch),
            Self::Splitting42(splitting) => splitting.advance(law, group, steps, now, watch),
            Self::Splitting62(splitting) => splitting.advance(law, group, steps, now, watch),
            Self::EulerMaruyama(kernel) => kernel_steps(law, *kernel, group, steps, now, watch),
            Self::ExponentialHeun(heun) => heun.advance(law, group, steps, watch),
        }
    }
}

/// A scheme of one excitation a step. `kick` is what a step ends with and the next begins with, so that
/// the force is evaluated once a step.
trait Kernel: Copy {
    /// The step.
    fn duration(self) -> f64;
    /// Half a step's kick at displacement q under the excitation of that moment.
    fn kick<L: Law>(self, law: L, q: f64, excitation: f64) -> f64;
    /// (q, v, kick) after one step.
    fn step<L: Law>(self, law: L, state: (f64, f64, f64), excitation: f64) -> (f64, f64, f64);
    /// Factor of a sum of cosines against a standard normal; None where it has no place.
    fn cosines(self) -> Option<f64> {
        None
    }
}

// No closures from here on: they would not be compiled for the vectors of the caller.
#[inline(always)]
fn kernel_steps<L: Law, K: Kernel, W: Watch>(
    law: L,
    kernel: K,
    group: &mut Group,
    steps: u64,
    now: f64,
    watch: &mut W,
) {
    let duration = kernel.duration();
    let mut signal = group.signal.take();
    if let (Some(factor), Some(signal)) = (kernel.cosines(), &mut signal) {
        signal.begin(now, duration);
        signal.value(factor, &mut group.excitation);
    }
    let mut state = Running {
        q: group.q,
        v: group.v,
        kick: [0.0; LANES],
        excitation: group.excitation,
    };
    for lane in 0..LANES {
        state.kick[lane] = kernel.kick(law, state.q[lane], state.excitation[lane]);
    }
    if let (Some(factor), Some(signal)) = (kernel.cosines(), &mut signal) {
        for k in 0..steps {
            if k % PATIENCE == PATIENCE - 1 && watch.late() {
                break;
            }
            let mut excitation = [0.0; LANES];
            signal.next(factor, &mut excitation);
            one(
                law,
                kernel,
                &mut state,
                &excitation,
                now + k as f64 * duration,
                watch,
            );
        }
    } else {
        let mut streams = group.streams.clone();
        let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
        for k in 0..steps / 2 {
            if k % PATIENCE == PATIENCE - 1 && watch.late() {
                break;
            }
            streams.normals(&mut first, &mut second);
            let now = now + (2 * k) as f64 * duration;
            one(law, kernel, &mut state, &first, now, watch);
            one(law, kernel, &mut state, &second, now + duration, watch);
        }
        if steps > 0 {
            state.excitation = second;
        }
        if steps % 2 == 1 {
            streams.normals(&mut first, &mut second);
            state.excitation = first;
            one(
                law,
                kernel,
                &mut state,
                &first,
                now + (steps - 1) as f64 * duration,
                watch,
            );
        }
        group.streams = streams;
    }
    group.signal = signal;
    (group.q, group.v, group.excitation) = (state.q, state.v, state.excitation);
}

/// q, v, the kick and the last excitation of the paths that advance together.
struct Running {
    q: Lanes,
    v: Lanes,
    kick: Lanes,
    excitation: Lanes,
}

/// One step of every lane, with crossings of the loss point from the cubic through both ends.
#[inline(always)]
fn one<L: Law, K: Kernel, W: Watch>(
    law: L,
    kernel: K,
    state: &mut Running,
    excitation: &Lanes,
    now: f64,
    watch: &mut W,
) {
    let (mut q0, mut v0) = ([0.0; LANES], [0.0; LANES]);
    if W::LISTENS || W::FOLLOWS {
        (q0, v0) = (state.q, state.v);
    }
    for lane in 0..LANES {
        let old = (state.q[lane], state.v[lane], state.kick[lane]);
        (state.q[lane], state.v[lane], state.kick[lane]) = kernel.step(law, old, excitation[lane]);
    }
    if W::LISTENS {
        let count = if L::WALLED { 2 } else { 1 };
        for lane in 0..LANES {
            let mut walls = [law.loss(), law.back()];
            // In the order of their passage.
            if L::WALLED && state.q[lane] > q0[lane] {
                walls.reverse();
            }
            for wall in walls.into_iter().take(count) {
                let below = state.q[lane] < wall;
                if below != (q0[lane] < wall) {
                    let ends = [
                        q0[lane] - wall,
                        v0[lane],
                        state.q[lane] - wall,
                        state.v[lane],
                    ];
                    let (after, speed) = cubic_crossing(ends, kernel.duration());
                    // Below the first wall it flies, below the second it does not.
                    let lost = below == (wall == law.loss());
                    watch.cross(lane, lost, now + after, speed);
                }
            }
        }
    }
    if W::FOLLOWS {
        for lane in 0..LANES {
            let ends = [[q0[lane], v0[lane]], [state.q[lane], state.v[lane]]];
            watch.moved(lane, now, kernel.duration(), ends);
        }
    }
}

/// When the cubic with values and slopes (x0, v0) and (x1, v1) at the ends of a step passes 0, and its
/// speed there.
fn cubic_crossing([x0, v0, x1, v1]: [f64; 4], step: f64) -> (f64, f64) {
    let at = |s: f64| {
        let (c, d) = (v0 * step, v1 * step);
        let (a2, a3) = (3.0 * (x1 - x0) - 2.0 * c - d, 2.0 * (x0 - x1) + c + d);
        (
            x0 + s * (c + s * (a2 + s * a3)),
            (c + s * (2.0 * a2 + 3.0 * s * a3)) / step,
        )
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if (at(middle).0 < 0.0) == (x0 < 0.0) {
            low = middle;
        } else {
            high = middle;
        }
    }
    (high * step, at(high).1.abs())
}

/// [`Scheme::CentralDifference`]: (q+ - 2q + q-)/step^2 + 2 zeta (q+ - q-)/(2 step) + G(q) = f, written
/// with v = (q+ - q-)/(2 step). White noise is f = sqrt(2 pi h/step) times a normal.
#[derive(Debug, Clone, Copy)]
pub(super) struct CentralDifference {
    step: f64,
    half: f64,
    friction: f64,
    spread: f64,
}

impl CentralDifference {
    fn new(oscillator: &Oscillator, step: f64) -> Self {
        Self {
            step,
            half: 0.5 * step,
            friction: oscillator.zeta() * step,
            spread: 0.5 * (2.0 * oscillator.noise() * step).sqrt(),
        }
    }
}

impl Kernel for CentralDifference {
    #[inline(always)]
    fn duration(self) -> f64 {
        self.step
    }

    #[inline(always)]
    fn kick<L: Law>(self, law: L, q: f64, excitation: f64) -> f64 {
        self.spread * excitation - self.half * law.force(q)
    }

    #[inline(always)]
    fn step<L: Law>(
        self,
        law: L,
        (q, v, kick): (f64, f64, f64),
        excitation: f64,
    ) -> (f64, f64, f64) {
        let friction = if L::VISCOUS {
            self.friction
        } else {
            self.friction * law.friction(q)
        };
        let middle = v - friction * v + kick; // (q+ - q)/step
        let q = q + self.step * middle;
        let kick = self.kick(law, q, excitation);
        let friction = if L::VISCOUS {
            self.friction
        } else {
            self.friction * law.friction(q)
        };
        (q, (middle + kick) / (1.0 + friction), kick)
    }

    /// Half a step of f, where a standard normal stands for spread.
    fn cosines(self) -> Option<f64> {
        Some(self.half / self.spread)
    }
}

/// exp(-2 zeta time) and sqrt(T (1 - exp(-4 zeta time))): the exact Ornstein-Uhlenbeck step of v.
fn ornstein_uhlenbeck(oscillator: &Oscillator, time: f64) -> (f64, f64) {
    let exponent = -2.0 * oscillator.zeta() * time;
    let variance = oscillator.temperature() * -(2.0 * exponent).exp_m1();
    (exponent.exp(), variance.sqrt())
}

/// The exact Ornstein-Uhlenbeck step of v where the rate depends on the displacement, which it leaves alone.
#[derive(Debug, Clone, Copy)]
struct Local {
    /// 2 zeta times the time.
    exponent: f64,
    /// Variance that noise alone adds, 2 pi h times the time.
    variance: f64,
}

impl Local {
    fn new(oscillator: &Oscillator, time: f64) -> Self {
        Self {
            exponent: 2.0 * oscillator.zeta() * time,
            variance: 2.0 * oscillator.noise() * time,
        }
    }

    /// Decay and spread where c/(2 zeta) is `friction`; in free flight noise alone.
    #[inline(always)]
    fn at(self, friction: f64) -> (f64, f64) {
        let x = friction * self.exponent;
        let share = if x > 1e-300 {
            -(-2.0 * x).exp_m1() / (2.0 * x)
        } else {
            1.0
        };
        ((-x).exp(), (self.variance * share).sqrt())
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Baoab {
    step: f64,
    half: f64,
    decay: f64,
    spread: f64,
    local: Local,
}

impl Baoab {
    fn new(oscillator: &Oscillator, step: f64) -> Self {
        let (decay, spread) = ornstein_uhlenbeck(oscillator, step);
        Self {
            step,
            half: 0.5 * step,
            decay,
            spread,
            local: Local::new(oscillator, step),
        }
    }
}

impl Kernel for Baoab {
    #[inline(always)]
    fn duration(self) -> f64 {
        self.step
    }

    #[inline(always)]
    fn kick<L: Law>(self, law: L, q: f64, _: f64) -> f64 {
        -self.half * law.force(q)
    }

    #[inline(always)]
    fn step<L: Law>(self, law: L, (q, v, kick): (f64, f64, f64), normal: f64) -> (f64, f64, f64) {
        let v = v + kick; // B
        let q = q + self.half * v; // A
        let (decay, spread) = if L::VISCOUS {
            (self.decay, self.spread)
        } else {
            self.local.at(law.friction(q))
        };
        let v = decay * v + spread * normal; // O
        let q = q + self.half * v; // A
        let kick = self.kick(law, q, 0.0);
        (q, v + kick, kick) // B
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct EulerMaruyama {
    step: f64,
    friction: f64,
    spread: f64,
}

impl EulerMaruyama {
    fn new(oscillator: &Oscillator, step: f64) -> Self {
        Self {
            step,
            friction: 2.0 * oscillator.zeta() * step,
            spread: (2.0 * oscillator.noise() * step).sqrt(),
        }
    }
}

impl Kernel for EulerMaruyama {
    #[inline(always)]
    fn duration(self) -> f64 {
        self.step
    }

    #[inline(always)]
    fn kick<L: Law>(self, _: L, _: f64, _: f64) -> f64 {
        0.0
    }

    #[inline(always)]
    fn step<L: Law>(self, law: L, (q, v, _): (f64, f64, f64), normal: f64) -> (f64, f64, f64) {
        let friction = if L::VISCOUS {
            self.friction
        } else {
            self.friction * law.friction(q)
        };
        let force = law.force(q) * self.step + friction * v;
        (q + self.step * v, v - force + self.spread * normal, 0.0)
    }
}

/// [`Scheme::ExponentialHeun`]. With c = 2 zeta, d = exp(-c step) and a force g = -G held constant, v goes
/// to d v + f1 g and q to q + f1 v + f2 g, f1 = (1 - d)/c, f2 = (step - f1)/c; a force that rises as
/// t/step adds f2/step and f3 = (step^2/2 - f2)/(c step) times its rise.
#[derive(Debug, Clone, Copy)]
pub(super) struct ExponentialHeun {
    decay: f64,
    f1: f64,
    f2: f64,
    f2_per_step: f64,
    f3: f64,
    /// Noise of v; noise of q along it and across it.
    spread: f64,
    along: f64,
    across: f64,
}

impl ExponentialHeun {
    fn new(oscillator: &Oscillator, step: f64) -> Self {
        let (c, temperature) = (2.0 * oscillator.zeta(), oscillator.temperature());
        let x = c * step;
        // x - (1 - e^-x), then x^2/2 - that, then the variance of q, free of cancellation for small x.
        let rise = if x < 0.1 {
            x * x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x / 720.0))))
        } else {
            x + (-x).exp_m1()
        };
        let second = if x < 0.1 {
            x.powi(3)
                * (1.0 / 6.0
                    - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x * (1.0 / 720.0 - x / 5040.0))))
        } else {
            0.5 * x * x - rise
        };
        let once = -(-x).exp_m1();
        // Given the noise of v, the variance of q is (2 T/c^2)(x - 2 tanh(x/2)).
        let rest = if x < 0.1 {
            x.powi(3) * (1.0 / 12.0 - x * x * (1.0 / 120.0 - x * x * (17.0 / 20160.0)))
        } else {
            x - 2.0 * (0.5 * x).tanh()
        };
        Self {
            decay: (-x).exp(),
            f1: once / c,
            f2: rise / (c * c),
            f2_per_step: rise / (c * x),
            f3: second / (c * c * x),
            spread: (temperature * -(-2.0 * x).exp_m1()).sqrt(),
            along: temperature.sqrt() * once * once / (c * (-(-2.0 * x).exp_m1()).sqrt()),
            across: (2.0 * temperature * rest).sqrt() / c,
        }
    }

    #[inline(always)]
    fn advance<L: Law, W: Watch>(self, law: L, group: &mut Group, steps: u64, watch: &W) {
        let (mut q, mut v) = (group.q, group.v);
        let mut streams = group.streams.clone();
        let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
        for k in 0..steps {
            if k % PATIENCE == PATIENCE - 1 && watch.late() {
                break;
            }
            streams.normals(&mut first, &mut second);
            for lane in 0..LANES {
                let force = -law.force(q[lane]);
                let drawn = self.along * first[lane] + self.across * second[lane];
                let predicted = q[lane] + self.f1 * v[lane] + self.f2 * force + drawn;
                let rise = -law.force(predicted) - force;
                q[lane] = predicted + self.f3 * rise;
                v[lane] = self.decay * v[lane]
                    + self.f1 * force
                    + self.f2_per_step * rise
                    + self.spread * first[lane];
            }
        }
        (group.q, group.v, group.streams) = (q, v, streams);
    }
}

/// [`Scheme::Splitting42`] and [`Scheme::Splitting62`] with `STAGES` Ornstein-Uhlenbeck steps. The
/// motions that end one step and begin the next are made at once.
#[derive(Debug, Clone, Copy)]
pub(super) struct Splitting<const STAGES: usize> {
    first: Flow,
    inner: Flow,
    joint: Flow,
    /// Decay and spread of each Ornstein-Uhlenbeck step.
    friction: [(f64, f64); STAGES],
    /// What a force of 1 does to v in each of them.
    impulse: [f64; STAGES],
    /// The same where the rate depends on the displacement.
    local: [Local; STAGES],
}

/// What each Ornstein-Uhlenbeck step of a splitting adds beside stationary noise, time frozen within it.
trait Push {
    /// Whether there is anything.
    const PUSHES: bool;
    /// The force and the factor on the spread of the noise.
    fn at(&self, t: f64) -> (f64, f64);
}

/// Nothing.
struct Still;

impl Push for Still {
    const PUSHES: bool = false;
    #[inline(always)]
    fn at(&self, _: f64) -> (f64, f64) {
        (0.0, 1.0)
    }
}

impl Push for Excitation {
    const PUSHES: bool = true;
    #[inline(always)]
    fn at(&self, t: f64) -> (f64, f64) {
        (self.force(t), self.factor(t).sqrt())
    }
}

impl<const STAGES: usize> Splitting<STAGES> {
    fn new(
        oscillator: &Oscillator,
        step: f64,
        frequency: f64,
        motions: [f64; 3],
        weights: [f64; STAGES],
    ) -> Self {
        let [first, inner, joint] = motions.map(|c| Flow::new(c * step, frequency));
        Self {
            first,
            inner,
            joint,
            friction: weights.map(|w| ornstein_uhlenbeck(oscillator, w * step)),
            impulse: weights.map(|w| {
                let friction = 2.0 * oscillator.zeta();
                -(-friction * w * step).exp_m1() / friction
            }),
            local: weights.map(|w| Local::new(oscillator, w * step)),
        }
    }

    #[inline(always)]
    fn advance<L: Law, W: Watch>(
        self,
        law: L,
        group: &mut Group,
        steps: u64,
        now: f64,
        watch: &mut W,
    ) {
        match group.push.clone() {
            None => self.pushed(law, group, (steps, now), &Still, watch),
            Some(it) => self.pushed(law, group, (steps, now), &*it, watch),
        }
    }

    #[inline(always)]
    fn pushed<L: Law, P: Push, W: Watch>(
        self,
        law: L,
        group: &mut Group,
        (steps, now): (u64, f64),
        push: &P,
        watch: &mut W,
    ) {
        if steps == 0 {
            return;
        }
        let (mut q, mut v, mut force) = (group.q, group.v, [0.0; LANES]);
        for lane in 0..LANES {
            force[lane] = law.force(q[lane]);
        }
        let mut streams = group.streams.clone();
        let (mut normal, mut spare) = ([0.0; LANES], [0.0; LANES]);
        let (mut now, mut have_spare) = (now, false);
        let mut flow = self.first;
        for step in 0..steps {
            if step % PATIENCE == PATIENCE - 1 && watch.late() {
                break;
            }
            for (stage, (decay, spread)) in self.friction.into_iter().enumerate() {
                flow.advance(law, (&mut q, &mut v, &mut force), now, watch); // H
                now += flow.time();
                if have_spare {
                    normal = spare;
                } else {
                    streams.normals(&mut normal, &mut spare);
                }
                have_spare = !have_spare;
                if !L::VISCOUS {
                    for lane in 0..LANES {
                        let (decay, spread) = self.local[stage].at(law.friction(q[lane]));
                        v[lane] = decay * v[lane] + spread * normal[lane];
                    }
                } else if P::PUSHES {
                    let (force, factor) = push.at(now);
                    let (shift, spread) = (force * self.impulse[stage], factor * spread);
                    for lane in 0..LANES {
                        v[lane] = decay * v[lane] + spread * normal[lane] + shift; // O with the drive
                    }
                } else {
                    for lane in 0..LANES {
                        v[lane] = decay * v[lane] + spread * normal[lane]; // O
                    }
                }
                flow = if stage + 1 < STAGES {
                    self.inner
                } else if step + 1 < steps {
                    self.joint
                } else {
                    self.first
                };
            }
        }
        self.first
            .advance(law, (&mut q, &mut v, &mut force), now, watch); // H
        (group.q, group.v, group.streams) = (q, v, streams);
    }
}

#[cfg(test)]
#[path = "scheme_tests.rs"]
mod tests;
