//! The truncated domain: as wide as the tolerance needs, and bounded by one energy level.

use crate::contact::ContactLaw;
use crate::damping::Damping;
use crate::error::{Error, Result};
use crate::gaussian::{Gaussian, lower, normal};
use crate::initial::Initial;
use crate::inrush::Inrush;
use crate::oscillator::Oscillator;
use crate::quadrature;
use std::f64::consts::{FRAC_2_SQRT_PI, PI};

/// How far a domain of several wells reaches above the highest barrier between them, in T.
const OVER_BARRIER: f64 = 8.0;

/// The part of the (q, v) plane that a solve looks at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Domain {
    /// Range of q.
    pub q: [f64; 2],
    /// Range of v.
    pub v: [f64; 2],
    /// Probability left outside by the stationary law or by the start, whichever is larger.
    pub neglected: f64,
}

impl Domain {
    /// The energy at its edge, above the lowest potential.
    pub(crate) fn highest(&self) -> f64 {
        0.5 * self.v[1].powi(2)
    }

    /// Its lengths along q and v over those of another.
    pub(crate) fn over(&self, other: &Self) -> [f64; 2] {
        let length = |[low, high]: [f64; 2]| high - low;
        [
            length(self.q) / length(other.q),
            length(self.v) / length(other.v),
        ]
    }

    /// What the neglected probability weighs in each of [`Moments::named`], over the normalisation: the mean of
    /// |q - E q|/sd q, of its square, and so on, over the stationary law outside the domain, plus 1 for the
    /// probability itself, which is somewhere inside instead. Skewness and kurtosis are functions of raw moments of the
    /// force, and each of these counts with its derivative.
    ///
    /// [`Moments::named`]: crate::moments::Moments::named
    pub(crate) fn tail_weights(&self, oscillator: &Oscillator) -> [f64; 11] {
        let t = oscillator.temperature();
        // In a second moment: the square of the energy at the edge of the domain over T.
        let energy = self.highest() / t;
        let usual = [(energy * energy).max(100.0); 11];
        let Ok(law) = oscillator.displacement_law() else {
            return usual;
        };
        let contact = oscillator.contact();
        let level = self.highest() + contact.lowest_potential().unwrap_or(0.0);
        // E[|v|^k; v^2/2 > level - U] of a Gaussian of variance T, over T^{k/2}.
        let fast = |q: f64| {
            let x = ((level - contact.potential(q)).max(0.0) / t).sqrt();
            let (gauss, tail) = ((-x * x).exp(), libm::erfc(x));
            let first = gauss * std::f64::consts::FRAC_2_PI.sqrt();
            [tail, first, tail + x * gauss * FRAC_2_SQRT_PI]
        };
        let mean = |f: &dyn Fn(f64) -> f64| law.expect_to(1e-2, f).value;
        let probability = mean(&|q| fast(q)[0]);
        if probability < 1e-290 {
            return usual;
        }
        let [centre, spread] = law.spread(|q| q);
        let force = |k: i32| law.expect(|q| contact.force(q).powi(k)).value;
        let deviation = force(2).sqrt();
        let skewness = force(3) / deviation.powi(3);
        let kurtosis = force(4) / deviation.powi(4);
        let q = |q: f64| ((q - centre) / spread).abs();
        let n = |q: f64| (contact.force(q) / deviation).abs();
        let [q1, q2, v1, v2, qv, n1, n2, n3, n4] = [
            mean(&|x| fast(x)[0] * q(x)),
            mean(&|x| fast(x)[0] * q(x).powi(2)),
            mean(&|x| fast(x)[1]),
            mean(&|x| fast(x)[2]),
            mean(&|x| fast(x)[1] * q(x)),
            mean(&|x| fast(x)[0] * n(x)),
            mean(&|x| fast(x)[0] * n(x).powi(2)),
            mean(&|x| fast(x)[0] * n(x).powi(3)),
            mean(&|x| fast(x)[0] * n(x).powi(4)),
        ];
        let energy = mean(&|x| {
            let [tail, _, square] = fast(x);
            0.5 * square + tail * (contact.potential(x) / t).abs()
        });
        let third = n3 + 1.5 * skewness.abs() * n2 + 3.0 * n1;
        let fourth = n4 + 2.0 * kurtosis * n2 + 4.0 * skewness.abs() * n1;
        [q1, q2, v1, v2, qv, n1, 0.5 * n2, third, fourth, energy, 0.0]
            .map(|weight| 1.0 + weight / probability)
    }

    /// The region H - U_min < level, with the level just high enough that the stationary law and the
    /// start both leave at most `neglected` outside. Streamlines of the undamped motion close inside.
    ///
    /// # Errors
    /// [`Error::NoStationaryLaw`] for a contact that does not confine.
    pub fn closed(oscillator: &Oscillator, initial: &Initial, neglected: f64) -> Result<Self> {
        let t = oscillator.temperature();
        #[cfg(test)]
        tests::CLOSED.with_borrow_mut(|all| all.push((*initial, neglected)));
        let law = oscillator.displacement_law()?;
        let contact = oscillator.contact();
        let lowest = contact.lowest_potential().unwrap_or(0.0);
        let outside = |level: f64| {
            // P(v^2/2 > level - U) of a Gaussian velocity of variance T.
            let stationary = law.expect_to(1e-3, |q| {
                let left = level - (contact.potential(q) - lowest);
                libm::erfc((left.max(0.0) / t).sqrt())
            });
            stationary
                .value
                .max(oscillator.averaged_beyond(level))
                .max(start_outside(oscillator, initial, level))
        };
        let highest = level_of(initial, neglected, t, outside)?;
        // What passes a barrier between two wells is rare, and is what joins them.
        let over = contact.barrier().map_or(0.0, |it| it + OVER_BARRIER * t);
        let high = highest.max(over);
        let (left, right) = contact.turning_points(high).unwrap_or((0.0, 0.0));
        let reach = (2.0 * high).sqrt();
        Ok(Self {
            q: [left, right],
            v: [-reach, reach],
            neglected: outside(high),
        })
    }

    /// This domain of a stationary law and an initial condition, lowered to what a Gaussian one reaches until `until`. The
    /// amplitude r = sqrt(2 (H - U_min)) obeys
    ///
    /// ```text
    /// dr = [pi h (1 - v^2/r^2) - c v^2]/r dt + (v/r) sqrt(2 pi h) dW
    /// ```
    ///
    /// and grows, where friction does not drive, by no more than the length of a Gaussian of variance 2 pi h t in two
    /// directions.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) for an initial condition that no level holds.
    pub(crate) fn reached(
        self,
        oscillator: &Oscillator,
        initial: &Initial,
        until: f64,
        neglected: f64,
    ) -> Result<Self> {
        let Initial::Gaussian { mean: [q, v], .. } = *initial else {
            return Ok(self);
        };
        let contact = oscillator.contact();
        let drives = matches!(oscillator.damping(), Damping::Energy(_));
        let noise = (-2.0 * neglected.ln() * 2.0 * oscillator.noise() * until).sqrt();
        if drives || contact.barrier().is_some() || noise >= self.v[1] {
            return Ok(self);
        }
        let t = oscillator.temperature();
        let start = |level: f64| start_outside(oscillator, initial, level);
        let level = level_of(initial, neglected, t, start)?;
        let lowest = contact.lowest_potential().unwrap_or(0.0);
        // The start and the noise lead away from the mean independently.
        let mean = (2.0 * (oscillator.energy(q, v) - lowest)).sqrt();
        let reach = mean + noise.hypot(((2.0 * level).sqrt() - mean).max(0.0));
        Ok(self.enlarged(oscillator, (reach / self.v[1]).min(1.0)))
    }

    /// This domain without what friction in contact keeps motions from: as deep as they come in with noise over half a natural
    /// period added to the highest speed, or as the initial condition does without friction. A drive has this amplitude, and a
    /// `swing` of its own.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) for an initial condition that no level holds.
    pub(crate) fn held_back(
        self,
        oscillator: &Oscillator,
        initial: &Initial,
        neglected: f64,
        [push, swing]: [f64; 2],
    ) -> Result<Self> {
        if oscillator.holds_back(self.q) == [false; 2] {
            return Ok(self);
        }
        let start = |level: f64| start_outside(oscillator, initial, level);
        let level = match initial {
            Initial::Gaussian { .. } => {
                level_of(initial, neglected, oscillator.temperature(), start)?
            }
            Initial::Rest | Initial::Stationary => 0.0,
        };
        let inrush = Inrush {
            certain: (2.0 * level).sqrt() + swing,
            highest: self.v[1] + (2.0 * PI * oscillator.noise()).sqrt(),
            push,
            rarity: 2.0 - neglected.ln(),
        };
        let held = inrush.reach(oscillator, self.q);
        let begun = oscillator.contact().turning_points(level);
        let (left, right) = begun.unwrap_or((0.0, 0.0));
        let q = [
            held[0].min(left).max(self.q[0]),
            held[1].max(right).min(self.q[1]),
        ];
        Ok(Self { q, ..self })
    }

    /// This domain of the stationary law, so many times as far along v and as high in amplitude.
    #[must_use]
    pub(crate) fn enlarged(self, oscillator: &Oscillator, times: f64) -> Self {
        let reach = times * self.v[1];
        match oscillator.contact().turning_points(0.5 * reach * reach) {
            Some((left, right)) => Self {
                q: [left, right],
                v: [-reach, reach],
                ..self
            },
            None => self,
        }
    }

    /// The amplitude of a density of this mean and these deviations along either axis, out to where it falls as far
    /// as the stationary law at the edge of this domain, over that of the edge. 1 for the law itself if it is Gaussian.
    pub(crate) fn amplitude(
        &self,
        oscillator: &Oscillator,
        mean: [f64; 2],
        deviation: [f64; 2],
    ) -> f64 {
        let contact = oscillator.contact();
        let lowest = contact.lowest_potential().unwrap_or(0.0);
        let width = self.v[1] / oscillator.temperature().sqrt();
        let ends = |k: usize| [-1.0, 1.0].map(|sign| mean[k] + sign * width * deviation[k]);
        let rise = ends(0).map(|q| 2.0 * (contact.potential(q) - lowest));
        let speed = ends(1).map(|v| v * v);
        let highest = rise.into_iter().chain(speed).fold(0.0, f64::max);
        highest.sqrt() / self.v[1]
    }

    /// This domain of the stationary law, raised to hold a concentrated initial condition until `until`. The amplitude
    /// sqrt(2H) of a start r decays as e^{-zeta t} while noise adds a Gaussian of variance
    /// T (1 - e^{-2 zeta t}) in two directions (exact for G = q, on the average over a period): where the
    /// stationary law needs the level L, the start needs (r e^{-zeta t} + sqrt(2 L (1 - e^{-2 zeta
    /// t})))^2/2, at most r^2/2 + L.
    #[must_use]
    pub(crate) fn raised(self, oscillator: &Oscillator, initial: &Initial, until: f64) -> Self {
        let Initial::Gaussian {
            mean: [q, v],
            deviation,
        } = *initial
        else {
            return self;
        };
        let contact = oscillator.contact();
        let lowest = contact.lowest_potential().unwrap_or(0.0);
        let level = self.highest();
        let width = (2.0 * level / oscillator.temperature()).sqrt();
        // The highest corner of what the start reaches.
        let energy = [-1.0, 1.0]
            .into_iter()
            .flat_map(|a| [-1.0, 1.0].map(|b| [a, b]))
            .map(|[a, b]| {
                oscillator.energy(q + a * width * deviation[0], v + b * width * deviation[1])
            })
            .fold(f64::NEG_INFINITY, f64::max)
            - lowest;
        let radius = (2.0 * energy).sqrt();
        let steepest = (2.0 * level).sqrt().atan2(radius).cos();
        let decay = (-oscillator.zeta() * until).exp().max(steepest);
        let reach = radius * decay + (2.0 * level * (1.0 - decay * decay)).sqrt();
        self.enlarged(oscillator, (reach / self.v[1]).max(1.0))
    }

    /// For a contact without a stationary law: the domain that the Gaussian initial condition sweeps until `until`,
    /// with `neglected` outside at any time.
    ///
    /// # Errors
    /// [`Error::NoStationaryLaw`] if the start is the stationary law.
    pub fn swept(
        oscillator: &Oscillator,
        initial: &Initial,
        until: f64,
        neglected: f64,
    ) -> Result<Self> {
        if *oscillator.contact() != ContactLaw::Free {
            oscillator.displacement_law()?;
        }
        let start = Gaussian::of(oscillator, initial)?;
        // Two-sided tail in each of two directions.
        let mut width = 1.0;
        while 4.0 * lower(-width) > neglected && width < 38.0 {
            width += 0.05;
        }
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for k in 0..=200 {
            let now = start.after(oscillator, until * f64::from(k) / 200.0)?;
            for d in 0..2 {
                let reach = width * now.covariance[d][d].sqrt();
                low[d] = low[d].min(now.mean[d] - reach);
                high[d] = high[d].max(now.mean[d] + reach);
            }
        }
        Ok(Self {
            q: [low[0], high[0]],
            v: [low[1], high[1]],
            neglected,
        })
    }
}

/// The level, within 0.2 %, above which a probability that falls with it is `neglected`.
fn level_of(
    initial: &Initial,
    neglected: f64,
    temperature: f64,
    outside: impl Fn(f64) -> f64,
) -> Result<f64> {
    // ln P(H > level) falls nearly in proportion to the level: its secant, in a bracket.
    let excess = |level: f64| (outside(level) / neglected).max(1e-300).ln();
    let (mut low, mut above) = (0.0, -neglected.ln());
    let mut high = (above + 2.0) * temperature;
    let mut below = excess(high);
    while below > 0.0 {
        (low, above) = (high, below);
        high *= 1.5;
        if !high.is_finite() {
            let accepted = "one nearer to equilibrium: no energy level holds it";
            let value = match initial {
                Initial::Gaussian { mean, deviation } => {
                    format!("mean {mean:?}, deviation {deviation:?}")
                }
                other => other.name().to_owned(),
            };
            return Err(Error::invalid("initial", value, accepted));
        }
        below = excess(high);
    }
    for round in 0..60 {
        if high - low <= 0.002 * high {
            break;
        }
        let secant = low + (high - low) * above / (above - below);
        // Just beyond the secant's root, so that both ends close in; halves where it crawls.
        let beyond = secant + 0.0009 * high * if round % 2 == 0 { 1.0 } else { -1.0 };
        let middle = if round % 8 == 7 {
            0.5 * (low + high)
        } else {
            beyond.clamp(low + 0.05 * (high - low), high - 0.05 * (high - low))
        };
        let here = excess(middle);
        if here > 0.0 {
            (low, above) = (middle, here);
        } else {
            (high, below) = (middle, here);
        }
    }
    Ok(high)
}

/// Probability that the energy of the initial condition lies so far above the lowest potential.
pub(crate) fn start_outside(oscillator: &Oscillator, initial: &Initial, level: f64) -> f64 {
    let energy = level + oscillator.contact().lowest_potential().unwrap_or(0.0);
    let Initial::Gaussian { mean, deviation } = *initial else {
        return 0.0;
    };
    let outside = |q: f64| {
        let left = 2.0 * (energy - oscillator.contact().potential(q));
        if left <= 0.0 {
            return 1.0;
        }
        let beyond = |mean: f64| lower((mean - left.sqrt()) / deviation[1]);
        beyond(mean[1]) + beyond(-mean[1])
    };
    let breaks: Vec<f64> = (-9..=9).map(f64::from).collect();
    let f = |x: f64| outside(mean[0] + deviation[0] * x) * normal(x);
    quadrature::integrate(f, &breaks, 1e-6).value
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::cell::RefCell;

    thread_local! {
        /// Initial condition and neglected probability of every domain closed on this thread.
        pub(crate) static CLOSED: RefCell<Vec<(Initial, f64)>> = const { RefCell::new(Vec::new()) };
    }

    /// A Gaussian under a linear contact stays one, and energies do not see a rotation to its axes.
    #[test]
    fn what_is_reached_holds_a_gaussian_until_then_and_is_less_than_what_the_law_needs() {
        let oscillator = Oscillator::new(ContactLaw::Linear, 0.05, 2e-3).unwrap();
        let neglected = 1e-7;
        for (mean, deviation, until) in [
            ([0.1, 0.05], [0.05, 0.04], 0.5),
            ([0.0, 0.0], [0.1, 0.1], 2.0),
            ([-0.3, 0.2], [0.02, 0.1], 1.0),
        ] {
            let initial = Initial::Gaussian { mean, deviation };
            let closed = Domain::closed(&oscillator, &initial, neglected).unwrap();
            let reached = closed.reached(&oscillator, &initial, until, neglected);
            let reached = reached.unwrap();
            assert!(reached.v[1] < 0.95 * closed.v[1], "{reached:?} {closed:?}");
            let level = reached.highest();
            let start = Gaussian::of(&oscillator, &initial).unwrap();
            let mut most = 0.0f64;
            for k in 0..=40 {
                let now = start
                    .after(&oscillator, until * f64::from(k) / 40.0)
                    .unwrap();
                let [[a, b], [_, d]] = now.covariance;
                let (sin, cos) = (0.5 * (2.0 * b).atan2(a - d)).sin_cos();
                let variance = |x: f64, y: f64| x * x * a + 2.0 * x * y * b + y * y * d;
                let along = Initial::Gaussian {
                    mean: [
                        cos * now.mean[0] + sin * now.mean[1],
                        cos * now.mean[1] - sin * now.mean[0],
                    ],
                    deviation: [variance(cos, sin).sqrt(), variance(-sin, cos).sqrt()],
                };
                most = most.max(start_outside(&oscillator, &along, level));
            }
            println!(
                "{most:.1e} outside of {:.3} in {:.3}",
                reached.v[1], closed.v[1]
            );
            assert!(most <= neglected && most > 0.0);
        }
    }
}
