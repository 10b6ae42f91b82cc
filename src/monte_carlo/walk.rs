//! How the paths of a sample are advanced: scheme, step, noise and seed, decided once where a scene leaves them open.

use super::noise::LANES;
use super::scheme::{Coefficients, Scheme};
use super::settings::{MOST_COSINES, Noise, Sampling};
use crate::budget::timing;
use crate::contact::ContactLaw;
use crate::error::{Error, Result, ascending, positive};
use crate::estimate::Warning;
use crate::excitation::Excitation;
use crate::format::{brief, num, rounded};
use crate::initial::Initial;
use crate::inrush::Inrush;
use crate::noise_free;
use crate::oscillator::Oscillator;
use std::f64::consts::E;
use std::ops::Range;

/// Relaxation times after which a start in the reference law of a damping that is not viscous is forgotten: e^-15.
const FORGOTTEN: f64 = 15.0;

/// How every path of a sample is advanced.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Walk {
    /// The scheme, never [`Scheme::Auto`].
    pub(crate) scheme: Scheme,
    /// The longest step.
    pub(crate) step: f64,
    /// With a path's number it fixes the path.
    pub(crate) seed: u64,
    pub(crate) noise: Noise,
    pub(crate) excitation: Excitation,
    /// Why this scheme and this step.
    pub(crate) reason: String,
    /// Whether both are the program's own choice.
    free: bool,
    pace: Pace,
}

impl Walk {
    /// From `initial`, as far as the settings leave it open.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a step that is not positive, or a scheme that does not suit the noise.
    pub(super) fn of(oscillator: &Oscillator, initial: &Initial, it: &Sampling) -> Result<Self> {
        initial.check()?;
        if it.excitation.is_plain() {
            let pace = Pace::of(oscillator, initial, [0.0; 2]);
            let (scheme, why) = resolve(it.scheme, it.noise, oscillator, pace.frequency)?;
            return Self::by((scheme, why), oscillator, it, pace);
        }
        // A splitting at any friction: the others know no force in time.
        let scheme = match (it.scheme, it.noise) {
            (Scheme::Auto | Scheme::Splitting42, Noise::White) => Scheme::Splitting42,
            (Scheme::Splitting62, Noise::White) => Scheme::Splitting62,
            (Scheme::Auto, _) => {
                let accepted = "\"white\", with [excitation]";
                let key = "monte_carlo.noise";
                return Err(Error::invalid(key, "band-limited", accepted));
            }
            (scheme, _) => {
                let accepted =
                    "\"auto\", \"splitting_4_2\" or \"splitting_6_2\", with [excitation]";
                let scheme = format!("\"{scheme}\"");
                return Err(Error::invalid("monte_carlo.scheme", scheme, accepted));
            }
        };
        let time = FOLLOWED.min(8.0 / oscillator.reference_friction());
        let swing = noise_free::swing(oscillator, &it.excitation, time);
        let drive = it.excitation.drive.map_or(0.0, |it| it.frequency());
        let pace = Pace::of(oscillator, initial, [it.excitation.push(), swing]);
        let scheme = (scheme, "it takes the drive with the noise");
        let walk = Self::by(scheme, oscillator, it, pace)?;
        // Its nodes must see the drive turn.
        let longest = walk.step.min(1.0 / drive.max(1.0));
        let step = it.step.unwrap_or(longest);
        Ok(Self { step, ..walk })
    }

    fn by(
        (scheme, why): (Scheme, &str),
        oscillator: &Oscillator,
        it: &Sampling,
        pace: Pace,
    ) -> Result<Self> {
        oscillator.damping().depends_on_displacement("sampling")?;
        let longest = automatic_step(scheme, oscillator, pace);
        let (step, how) = match it.step {
            Some(step) => (
                positive("monte_carlo.step", step)?,
                "the step by hand".into(),
            ),
            None => (longest, format!("steps up to {} trusted", short(longest))),
        };
        Ok(Self {
            scheme,
            step,
            seed: it.seed,
            noise: it.noise,
            excitation: it.excitation.clone(),
            reason: format!("{why}, {how}"),
            free: it.step.is_none() && it.scheme == Scheme::Auto,
            pace,
        })
    }

    /// The same by a scheme that locates losses of contact, under white noise.
    pub(super) fn locating(
        oscillator: &Oscillator,
        initial: &Initial,
        it: &Sampling,
    ) -> Result<Self> {
        initial.check()?;
        if it.noise != Noise::White {
            let accepted = "\"white\", for first passages";
            let key = "monte_carlo.noise";
            return Err(Error::invalid(key, "band-limited", accepted));
        }
        let walk = if it.excitation.is_plain() {
            let pace = Pace::of(oscillator, initial, [0.0; 2]);
            let scheme = match it.scheme {
                Scheme::Auto => (Scheme::Splitting42, "it locates losses at any friction"),
                scheme => (scheme, "as asked"),
            };
            Self::by(scheme, oscillator, it, pace)?
        } else {
            Self::of(oscillator, initial, it)?
        };
        if !walk.scheme.locates_crossings() {
            let accepted = "a scheme that locates the loss of contact, as \"splitting_4_2\"";
            let given = format!("\"{}\"", walk.scheme);
            return Err(Error::invalid("monte_carlo.scheme", given, accepted));
        }
        Ok(walk)
    }

    /// The coefficients of a step of this length.
    pub(super) fn coefficients(&self, oscillator: &Oscillator, step: f64) -> Coefficients {
        Coefficients::new(self.scheme, oscillator, step, self.pace.frequency)
    }

    /// Scheme, step and reason.
    pub(super) fn words(&self) -> String {
        let (scheme, reason) = (self.scheme, &self.reason);
        format!("{scheme}, step {} ({reason})", short(self.step))
    }

    /// Seconds of so many steps of a path, on all threads.
    pub(super) fn seconds(&self, oscillator: &Oscillator, path_steps: f64) -> f64 {
        let cosines = match self.noise {
            Noise::Cosines { count, .. } => f64::from(count),
            _ => 0.0,
        };
        let plain = match self.scheme {
            Scheme::Splitting42 | Scheme::Auto => timing::SPLITTING_4_2,
            Scheme::Splitting62 => timing::SPLITTING_6_2,
            Scheme::ExponentialHeun => timing::HEUN,
            Scheme::CentralDifference | Scheme::Baoab | Scheme::EulerMaruyama => timing::KICK,
        };
        // A law that the loop does not know when it is compiled, and friction that depends on the displacement.
        let mut over = 1.0;
        if matches!(oscillator.contact(), ContactLaw::Custom(_)) {
            over += timing::TRACED_STEP;
        }
        if !oscillator.is_viscous() {
            over += timing::LOCAL_STEP;
        }
        let threads = rayon::current_num_threads() as f64;
        (over * plain + timing::COSINE * cosines) * path_steps / threads
    }

    /// Bytes of the paths that advance together: states and streams, and what a signal keeps.
    pub(super) fn bytes(&self) -> u64 {
        let lanes = 8 * LANES as u64;
        lanes
            * match self.noise {
                Noise::White => 8,
                Noise::Cosines { count, .. } => 8 + 6 * u64::from(count),
                Noise::Band { .. } => 4 * 4096,
            }
    }

    /// What the step costs in accuracy: the share by which variances are off, from the bias of a linear
    /// oscillator of the highest frequency of the scene (see [`Scheme`]).
    pub(super) fn bias(&self, oscillator: &Oscillator) -> f64 {
        let (zeta, step) = (oscillator.zeta(), self.step);
        let turn = step * self.pace.frequency.max(1.0);
        match self.scheme {
            Scheme::CentralDifference => match self.noise.band() {
                // Friction sees the white noise of a step before the motion does.
                None => 0.25 * turn * turn + zeta * step,
                // What is smooth errs by how far its fastest part turns within a step. Friction lets no more than 2 zeta through, but for
                // the variance of v, whose integrand falls as 1/w^2 up to the band and errs there by (w step)^2/6.
                Some(band) => {
                    let seen = turn.max(step * band.min(2.0 * zeta));
                    (0.25 * seen * seen).max(0.22 * zeta * band * step * step)
                }
            },
            Scheme::Baoab => 0.25 * turn * turn,
            Scheme::EulerMaruyama => 0.5 * step / zeta + 0.5 * turn * turn,
            // 1e-4 at the automatic step, of order 2 beyond; and where nodes no longer see the motion turn, far more: 0.17 and 0.013 at
            // a step of 3 (Hertz, zeta = 0.02, h = 5e-3).
            Scheme::Auto | Scheme::Splitting42 | Scheme::Splitting62 | Scheme::ExponentialHeun => {
                let longer = step / automatic_step(self.scheme, oscillator, self.pace);
                let unseen = match self.scheme {
                    Scheme::Splitting62 => (0.5 * turn).powi(8),
                    Scheme::ExponentialHeun => 0.0,
                    _ => turn.powi(6),
                };
                1e-4 * longer.powi(2).max(unseen)
            }
        }
    }

    /// By how much the step makes the motion turn too fast: the phase leads by this a unit of time.
    pub(super) fn lead(&self) -> f64 {
        match self.scheme {
            Scheme::CentralDifference | Scheme::Baoab => {
                let frequency = self.pace.frequency.max(1.0);
                (self.step * frequency).powi(2) / 24.0 * frequency
            }
            _ => 0.0,
        }
    }

    /// What the step costs on the way: its bias, and what the lead of the phase does to the mean of a motion that
    /// begins away from the stationary law, at worst up to `until`, in stationary deviations; friction forgets
    /// the phase with the amplitude.
    pub(super) fn bias_on_the_way(
        &self,
        oscillator: &Oscillator,
        initial: &Initial,
        until: f64,
    ) -> f64 {
        let swing = match initial {
            Initial::Gaussian { mean, .. } => {
                1.0 + mean[0].hypot(mean[1]) / oscillator.temperature().sqrt()
            }
            _ => 0.0,
        };
        let time = until.min(phase_lasts(oscillator));
        self.bias(oscillator) + swing * self.lead() * time
    }

    /// A warning that the numbers `unknown` are not known if a `bias` exceeds one standard error of the variance of
    /// `samples` independent samples.
    pub(super) fn warning(
        &self,
        bias: f64,
        samples: f64,
        unknown: impl FnOnce() -> Vec<String>,
    ) -> Option<Warning> {
        let error = deviation(samples);
        let share = match bias {
            bias if bias < 1.0 => format!("by about {bias:.1e} of itself"),
            _ => "without bound".into(),
        };
        let help = if self.free {
            "a shorter monte_carlo.step errs less"
        } else {
            "shorten monte_carlo.step or leave scheme and step out to have them chosen"
        };
        (bias > error).then(|| Warning {
            text: format!(
                "with the step {} the scheme {} is off {share} in a variance, its standard error is {error:.1e}, \
                 and no standard error of a sampled number holds that: {help}",
                brief(self.step),
                self.scheme
            ),
            unknown: unknown(),
        })
    }
}

/// The time over which an error of the phase does most to a motion that friction damps: the largest value of t e^(-zeta t).
pub(super) fn phase_lasts(oscillator: &Oscillator) -> f64 {
    1.0 / (E * oscillator.zeta())
}

/// The standard error of the variance of independent samples, relative to it.
pub(super) fn deviation(samples: f64) -> f64 {
    (2.0 / samples).sqrt()
}

/// Paths per block: the unit in which sums are added.
pub(super) const BLOCK: u64 = 256;

/// Most tasks an ensemble is cut into; bounds the memory and never depends on the threads.
pub(super) const TASKS: u64 = 128;

/// The paths of each task, in whole blocks.
pub(super) fn tasks(paths: u64) -> Vec<Range<u64>> {
    let each = paths.div_ceil(BLOCK).div_ceil(TASKS) * BLOCK;
    let task = |first: u64| first * each..((first + 1) * each).min(paths);
    (0..paths.div_ceil(each)).map(task).collect()
}

/// Paths of an ensemble at most.
const MOST_PATHS: u64 = 1_000_000_000_000_000;

/// Refuses an ensemble without a standard error, and times out of order, by `key`.
pub(super) fn check_ensemble(paths: u64, times: &[f64], key: &'static str) -> Result<()> {
    if !(2..=MOST_PATHS).contains(&paths) {
        let accepted = format!(
            "from 2, so that there is a standard error, to {:e}",
            MOST_PATHS as f64
        );
        return Err(Error::invalid("monte_carlo.paths", paths, accepted));
    }
    ascending(key, "times", times)
}

/// The number of equal steps, none longer than `step`, that span `time`, and their length.
pub(super) fn equal_steps(time: f64, step: f64) -> Result<(u64, f64)> {
    // A whole number of steps stays one where the quotient is rounded up.
    let count = (time / step * (1.0 - 1e-12)).ceil();
    if count > 1e15 {
        let what = format!("{count:e} steps over a time of {time}");
        return Err(Error::limit("monte_carlo.step", step.to_string(), what));
    }
    let length = if count > 0.0 { time / count } else { step };
    Ok((count as u64, length))
}

/// Time that paths are given to forget the reference law, where they begin in a stationary law that has no closed form; between
/// wells where that is not too long.
pub(super) fn run_in(oscillator: &Oscillator, initial: &Initial) -> f64 {
    if *initial == Initial::Stationary && !oscillator.is_viscous() {
        let (within, between) = (oscillator.correlation_time(), oscillator.relaxation_time());
        let longest = FORGOTTEN * within;
        FORGOTTEN * if between <= longest { between } else { within }
    } else {
        0.0
    }
}

/// What such paths have not forgotten: how much of the reference law is in each of several wells, where passages between them
/// take longer.
pub(super) fn not_run_in(
    oscillator: &Oscillator,
    initial: &Initial,
    unknown: impl FnOnce() -> Vec<String>,
) -> Option<Warning> {
    let (time, forgetting) = (run_in(oscillator, initial), oscillator.relaxation_time());
    (time > 0.0 && forgetting > 0.2 * time).then(|| Warning {
        text: format!(
            "paths that begin in the law are run in for a time of {time:.1e}, and passages between the wells take one of some \
             {forgetting:.0e}: how many are in which well is still as under viscous damping, and no standard error holds that"
        ),
        unknown: unknown(),
    })
}

/// The scheme meant, if it suits the noise, and why; `frequency` is the highest of the scene.
fn resolve(
    scheme: Scheme,
    noise: Noise,
    oscillator: &Oscillator,
    frequency: f64,
) -> Result<(Scheme, &'static str)> {
    let zeta = oscillator.zeta();
    if !oscillator.is_viscous() && scheme == Scheme::ExponentialHeun {
        let accepted = "a scheme whose friction may change from place to place, as \"splitting_4_2\", with \
                        oscillator.damping other than \"viscous\"";
        let scheme = "\"exponential_heun\"";
        return Err(Error::invalid("monte_carlo.scheme", scheme, accepted));
    }
    let (count, band) = match noise {
        Noise::White => {
            return Ok(match scheme {
                Scheme::Auto if oscillator.is_viscous() && zeta > 2.0 * frequency.max(1.0) => (
                    Scheme::ExponentialHeun,
                    "friction is strong and binds no step of this scheme",
                ),
                Scheme::Auto => (
                    Scheme::Splitting42,
                    "it keeps the stationary law and locates losses",
                ),
                scheme => (scheme, "as asked"),
            });
        }
        Noise::Cosines { count, band } => (count, band),
        Noise::Band { band } => (1, band),
    };
    positive("monte_carlo.noise.band", band)?;
    if !(1..=MOST_COSINES).contains(&count) {
        let accepted = format!("1 to {MOST_COSINES}");
        return Err(Error::invalid("monte_carlo.noise.cosines", count, accepted));
    }
    if !matches!(scheme, Scheme::Auto | Scheme::CentralDifference) {
        let accepted = "\"central_difference\" or \"auto\" with band-limited noise";
        let given = format!("\"{scheme}\"");
        return Err(Error::invalid("monte_carlo.scheme", given, accepted));
    }
    Ok((
        Scheme::CentralDifference,
        "the scheme of band-limited noise",
    ))
}

/// The longest step with which `scheme` is trusted.
///
/// For the splittings the mean of a linear oscillator then errs by less than 2e-4 of its amplitude and
/// its variances by less than 1e-4 of theirs, at any time and any zeta (from their exact moments). The
/// others are left with the phase error of step^2/24 a unit of time that their docs name.
///
/// A rate that depends on the displacement counts with the largest that the motion meets, and the step is half as long:
/// where it jumps each crossing errs by the step, of either sign.
fn automatic_step(scheme: Scheme, oscillator: &Oscillator, pace: Pace) -> f64 {
    let zeta = pace.friction.max(oscillator.zeta());
    let frequency = pace.frequency.max(1.0);
    let friction = (zeta * frequency).max(3.0 * zeta * zeta);
    let splitting = (1.0 / frequency).min((5.5e-3 / friction).sqrt());
    match scheme {
        Scheme::CentralDifference | Scheme::Baoab => 0.05 / frequency.max(zeta),
        // A step at which its damping is off by a hundredth.
        Scheme::EulerMaruyama => (0.02 * oscillator.zeta()).min(0.01 / frequency.max(zeta)),
        _ if !oscillator.is_viscous() => 0.5 * splitting,
        Scheme::Auto | Scheme::Splitting42 => splitting,
        Scheme::Splitting62 => (2.0 / frequency).min((1.2e-2 / friction).sqrt()),
        // Variances then err by less than 3e-4 of themselves.
        Scheme::ExponentialHeun if zeta < 40.0 * frequency => 0.05 / frequency,
        Scheme::ExponentialHeun => 0.04 * zeta / (frequency * frequency),
    }
}

/// A number to four digits, as a scene would have it.
fn short(x: f64) -> String {
    num(rounded(x, 4))
}

/// Longest time that a motion without noise is followed for the amplitude of a driven one.
const FOLLOWED: f64 = 1000.0;

/// Energy over T that few paths exceed.
const TYPICAL: f64 = 5.0;

/// What few paths exceed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Pace {
    /// The highest frequency a path meets.
    frequency: f64,
    /// Half the largest rate of friction.
    friction: f64,
}

impl Pace {
    /// Up to an energy of [`TYPICAL`] T, to whose amplitude a drive of this amplitude adds its `swing`.
    fn of(oscillator: &Oscillator, initial: &Initial, [push, swing]: [f64; 2]) -> Self {
        let mut rise = TYPICAL * oscillator.temperature();
        if swing > 0.0 {
            rise = 0.5 * ((2.0 * rise).sqrt() + swing).powi(2);
        }
        Self {
            frequency: highest_frequency(oscillator, initial, rise),
            friction: 0.5 * highest_friction(oscillator, initial, rise, [push, swing]),
        }
    }
}

/// The largest rate of friction on paths up to an energy, as deep as it lets them come in, and on those that begin higher.
fn highest_friction(
    oscillator: &Oscillator,
    initial: &Initial,
    rise: f64,
    [push, swing]: [f64; 2],
) -> f64 {
    if oscillator.is_viscous() {
        return oscillator.friction(0.0);
    }
    let contact = oscillator.contact();
    let (begun, level) = match initial {
        Initial::Gaussian { mean, deviation } => {
            let ends = |k: usize| [-2.0, 2.0].map(|times| mean[k] + times * deviation[k]);
            let energies = ends(0).map(|q| ends(1).map(|v| oscillator.energy(q, v)));
            let highest = energies.as_flattened().iter().copied().fold(0.0, f64::max);
            let lowest = contact.lowest_potential().unwrap_or(0.0);
            (ends(0), highest - lowest)
        }
        Initial::Rest | Initial::Stationary => ([0.0; 2], 0.0),
    };
    let certain = (2.0 * level).sqrt() + swing;
    let highest = certain.max((2.0 * rise).sqrt());
    let turning = contact.turning_points(0.5 * highest * highest);
    let inrush = Inrush {
        certain,
        highest,
        push,
        rarity: TYPICAL,
    };
    let (left, right) = turning.unwrap_or((0.0, 0.0));
    let held = inrush.reach(oscillator, [left, right]);
    let [held, begun] = [held, begun].map(|ends| oscillator.highest_friction_between(ends));
    held.max(begun)
}

/// How far out paths begin, and how far above the lowest potential.
fn begun(oscillator: &Oscillator, initial: &Initial) -> (f64, f64) {
    let Initial::Gaussian { mean, deviation } = initial else {
        return (0.0, 0.0);
    };
    let contact = oscillator.contact();
    let [q, v] = [0, 1].map(|k| mean[k].abs() + 2.0 * deviation[k]);
    let lowest = contact.lowest_potential().unwrap_or(0.0);
    let level = contact.potential(q).max(contact.potential(-q)) - lowest;
    (q, 0.5 * v * v + level.max(0.0))
}

/// The highest frequency of paths up to an energy, and of those that begin higher: the root of the stiffness at the outer
/// turning point.
fn highest_frequency(oscillator: &Oscillator, initial: &Initial, rise: f64) -> f64 {
    let contact = oscillator.contact();
    let (mut outer, above) = begun(oscillator, initial);
    let rise = rise.max(above);
    let Some((left, right)) = contact.turning_points(rise) else {
        return contact.stiffness(0.0).max(0.0).sqrt();
    };
    outer = outer.max(right);
    let mut places = vec![0.0, 0.5 * outer, outer];
    // A law with parameters may be stiff anywhere, a second wall on the other side.
    if matches!(contact, ContactLaw::Custom(_)) {
        let low = left.min(-outer);
        places.extend((0..=64).map(|k| low + (outer - low) * f64::from(k) / 64.0));
        let ends = contact.pieces().iter().map(|it| it.from);
        places.extend(ends.filter(|q| *q > low && *q < outer));
    }
    let stiffness = places.into_iter().map(|q| contact.stiffness(q));
    stiffness.fold(0.0, f64::max).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::{Parameter, Parameters};
    use crate::damping::Damping;

    /// Two wells 1/4 deep at a temperature of 0.02: e^12.5 relaxation times between them, which no run-in is.
    #[test]
    fn paths_between_two_wells_say_that_they_keep_the_shares_of_the_reference() {
        let given =
            Parameters::new().with("coefficients", Parameter::Numbers(vec![-1.0, 0.0, 1.0]));
        let wells = ContactLaw::given("polynomial", &given).unwrap();
        let h = |temperature: f64| 2.0 * 0.05 * temperature / std::f64::consts::PI;
        let hunt_crossley = |contact: ContactLaw, temperature: f64| {
            let it = Oscillator::new(contact, 0.05, h(temperature)).unwrap();
            it.with_damping(Damping::HuntCrossley)
        };
        let cold = Oscillator::new(wells.clone(), 0.05, h(0.02)).unwrap();
        let expected = 10.0 * 12.5f64.exp();
        assert!((cold.relaxation_time() / expected - 1.0).abs() < 1e-9);
        let stationary = &Initial::Stationary;
        let warns = |it: &Oscillator| not_run_in(it, stationary, Vec::new).is_some();
        // From the exact law nothing is run in.
        assert!(!warns(&cold) && run_in(&cold, stationary) == 0.0);
        let one = hunt_crossley(ContactLaw::Hertz, 0.02).unwrap();
        assert!(!warns(&one) && run_in(&one, stationary) == 150.0);
        // With flight to the left, as that damping asks for.
        let places = vec![-6.0, -5.0, -4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0];
        let force = vec![-1.0, -1.0, -1.0, -0.3, 0.35, 0.0, -0.35, 0.3, 1.5];
        let table = Parameters::new()
            .with("q", Parameter::Numbers(places))
            .with("force", Parameter::Numbers(force));
        let two = hunt_crossley(ContactLaw::given("table", &table).unwrap(), 0.02).unwrap();
        let within = FORGOTTEN * two.correlation_time();
        let found = (run_in(&two, stationary), two.relaxation_time());
        assert!(warns(&two) && found.0 == within, "{found:?} {within}");
    }
}
