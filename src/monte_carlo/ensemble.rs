//! Ensembles: moments of independent paths at given times.

use super::events::Deaf;
use super::few::{CARRIERS, FEW};
use super::law::{self, Law, WithLaw};
use super::noise::LANES;
use super::paths::Paths;
use super::progress::{Progress, Timed};
use super::scheme::{Coefficients, Group};
use super::statistics::{Frames, Sums, unknown};
use super::walk::{self, BLOCK, TASKS, Walk};
use super::{Noise, Sampling, Scheme};
use crate::budget::{Cost, Limits, timing};
use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use crate::estimate::{Lack, Shortfall, Warning};
use crate::format::brief;
use crate::initial::Initial;
use crate::matrix::vectorise;
use crate::moments::{Moment, Moments};
use crate::oscillator::Oscillator;
use rayon::prelude::*;

/// The error of a scheme of order 2 over the difference that half the step makes.
const HALVED: f64 = 4.0 / 3.0;

/// Moments of an ensemble at the times asked for, and how they were made.
#[derive(Debug, Clone, PartialEq)]
pub struct EnsembleResult {
    /// The output times.
    pub times: Vec<f64>,
    /// Moments at each time; every error is one standard error.
    pub moments: Vec<Moments>,
    /// Number of paths: those that were done, where the time ended before the others.
    pub paths: u64,
    /// Steps of one path.
    pub steps: u64,
    /// Longest step.
    pub step: f64,
    /// The scheme used, never [`Scheme::Auto`].
    pub scheme: Scheme,
    /// Paths times steps.
    pub path_steps: u64,
    /// What a reader of the numbers should know.
    pub warnings: Vec<Warning>,
    /// That not all paths were done in `max_seconds`. The errors are those of the paths done; how many these are depends on the
    /// machine.
    pub shortfall: Option<Shortfall>,
}

/// Moments at `times` (ascending, may begin with 0) of an ensemble that starts from `initial`. A step whose
/// bias may exceed a standard error is warned of.
///
/// `progress` is called, from any thread, with the fraction of the work done, 0 to 1.
///
/// # Errors
/// [`Error::Invalid`] for fewer than 2 paths, a step that is not positive, a noise that does not suit
/// the scheme, times that are negative, not finite or not ascending; [`Error::NoStationaryLaw`] for a
/// stationary start that does not exist; [`Error::Limit`] for more steps than can be counted, and where
/// `max_seconds` are over before 51 paths are done.
pub fn run(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<EnsembleResult> {
    let mut recipe = Ensemble::of(oscillator, initial, times, settings)?;
    recipe.companion = None;
    recipe.run((oscillator, initial), settings.limits(), progress)
}

/// How an ensemble will be drawn: its paths, the times of its moments, and a companion where the step asks for one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Ensemble {
    /// How its paths are advanced; the step is the longest that they make.
    pub(crate) walk: Walk,
    pub(crate) paths: u64,
    pub(crate) times: Vec<f64>,
    /// The moments asked for; None for all of them.
    asked: Option<Vec<Moment>>,
    /// Time before 0 in which paths come from the reference law to the stationary one.
    run_in: f64,
    /// The times at which paths stop: those, and where the envelope bends.
    stops: Vec<f64>,
    /// What the step may cost, relative to a variance.
    bias: f64,
    /// How as many paths are advanced that show the bias of the step: by the program's own choice of scheme and step, the
    /// step at most half as long where the scheme is the same. None where that bias, in a variance or through the
    /// phase of the motion, is below one standard error.
    pub(crate) companion: Option<Walk>,
    /// Whether scheme or step are the user's.
    given: bool,
    /// What both will take.
    pub(crate) cost: Cost,
}

impl Ensemble {
    pub(crate) fn of(
        oscillator: &Oscillator,
        initial: &Initial,
        times: &[f64],
        settings: &Sampling,
    ) -> Result<Self> {
        walk::check_ensemble(settings.paths, times, "outputs.moments_at")?;
        if matches!(settings.noise, Noise::Band { .. }) {
            let accepted = "for long realisations; for an ensemble \"white\" or { cosines, band }";
            return Err(Error::invalid("monte_carlo.noise", "{ band }", accepted));
        }
        let until = times.last().copied().unwrap_or(0.0);
        let mut walk = Walk::of(oscillator, initial, settings)?;
        let mut stops = times.to_vec();
        stops.extend(settings.excitation.bends(0.0, until));
        stops.sort_by(f64::total_cmp);
        stops.dedup();
        let (steps, longest) = longest(&stops, walk.step)?;
        if longest > 0.0 {
            walk.step = longest;
        }
        let bias = walk.bias_on_the_way(oscillator, initial, until);
        let mut companion = None;
        if bias > walk::deviation(settings.paths as f64) {
            let own = Sampling {
                scheme: Scheme::Auto,
                step: None,
                ..settings.clone()
            };
            let mut own = Walk::of(oscillator, initial, &own)?;
            if own.scheme == walk.scheme {
                own.step = own.step.min(0.5 * walk.step);
            }
            companion = Some(own);
        }
        let paths = settings.paths as f64;
        let run_in = walk::run_in(oscillator, initial);
        let (before, _) = walk::equal_steps(run_in, walk.step)?;
        let steps = steps + before;
        let beside = companion.as_ref().map_or(0.0, |it| {
            it.seconds(oscillator, paths * (run_in + until) / it.step)
        });
        let threads = rayon::current_num_threads() as u64;
        let looks = timing::SAMPLE * paths * stops.len() as f64 / threads as f64;
        let sums = TASKS * (stops.len() * size_of::<Sums>()) as u64;
        let cost = Cost {
            steps,
            memory: sums + threads * BLOCK / LANES as u64 * walk.bytes(),
            seconds: walk.seconds(oscillator, paths * steps as f64) + looks + beside,
            ..Cost::default()
        };
        Ok(Self {
            walk,
            paths: settings.paths,
            times: times.to_vec(),
            asked: settings.moments.clone(),
            run_in,
            stops,
            bias,
            companion,
            given: settings.step.is_some() || settings.scheme != Scheme::Auto,
            cost,
        })
    }

    /// Size, scheme, step and reason.
    pub(crate) fn words(&self) -> String {
        let beside = self.companion.as_ref().map_or(String::new(), |it| {
            format!("; as many by {}, for its bias", it.words())
        });
        format!("{} paths, {}{beside}", self.paths, self.walk.words())
    }

    /// The ensemble. With a companion the error of every number is one standard error and the difference that the
    /// companion makes.
    pub(crate) fn run(
        &self,
        question: (&Oscillator, &Initial),
        limits: Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<EnsembleResult> {
        limits.holds("the ensemble", self.cost.memory)?;
        let Some(companion) = &self.companion else {
            let mut it = self.sample(question, &self.walk, limits, progress)?;
            let moved = self.times.iter().filter(|t| **t > 0.0);
            let moved: Vec<Option<f64>> = moved.map(|t| Some(*t)).collect();
            let names = || unknown("monte_carlo", &moved);
            let warning = self.walk.warning(self.bias, self.paths as f64, names);
            it.warnings.extend(warning);
            // They add up over a unit of time at least, and as long as friction leaves a phase.
            let longest = 1.0 + walk::phase_lasts(question.0);
            for (moments, t) in it.moments.iter_mut().zip(&self.times) {
                steps_err(moments, question.0.contact(), self.bias * t.min(longest));
            }
            return Ok(it);
        };
        // Of the time each has its share: a bias is no better known than by the paths of both. Those of the second that were not done
        // are in its errors, and with them in these.
        let each = [&self.walk, companion].map(|it| it.seconds(question.0, 1.0 / it.step));
        let share = each[0] / (each[0] + each[1]);
        let first = |part: f64| progress(share * part);
        let mut it = self.sample(question, &self.walk, limits.part(share), &first)?;
        let second = |part: f64| progress(share + (1.0 - share) * part);
        let beside = self.sample(question, companion, limits, &second)?;
        for (moments, beside) in it.moments.iter_mut().zip(&beside.moments) {
            for (number, (_, beside)) in moments.each_mut().into_iter().zip(beside.named()) {
                if let (Some(number), Some(beside)) = (number, beside) {
                    let difference = (number.value - beside.value).abs();
                    number.error = number.error.max(beside.error) + HALVED * difference;
                }
            }
        }
        let advice = if self.given {
            "; shorten monte_carlo.step or leave scheme and step out to have them chosen"
        } else {
            ""
        };
        let warning = format!(
            "the step {} is long for the scheme {}: to the standard error of every sampled number is added what \
             {} with steps of {} makes different{advice}",
            brief(it.step),
            it.scheme,
            beside.scheme,
            brief(beside.step)
        );
        it.warnings.push(warning.into());
        Ok(it)
    }

    /// The paths advanced by `walk`, the bias of its step left to the caller.
    fn sample(
        &self,
        (oscillator, initial): (&Oscillator, &Initial),
        walk: &Walk,
        limits: Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<EnsembleResult> {
        let mut intervals = Vec::with_capacity(self.stops.len());
        let mut start = 0.0;
        for &time in &self.stops {
            let (steps, length) = walk::equal_steps(time - start, walk.step)?;
            intervals.push(Interval {
                start,
                steps,
                coefficients: walk.coefficients(oscillator, length),
            });
            start = time;
        }
        let (steps, step) = longest(&self.stops, walk.step)?;
        let (before, length) = walk::equal_steps(self.run_in, walk.step)?;
        let run_in = (before > 0).then(|| Interval {
            start: -self.run_in,
            steps: before,
            coefficients: walk.coefficients(oscillator, length),
        });
        let path_steps = (steps + before).saturating_mul(self.paths);
        let progress = &Progress::new(path_steps, limits, progress);
        let run = Run {
            count: self.paths,
            paths: &Paths::new(oscillator, initial, walk)?,
            before: run_in.as_ref(),
            intervals: &intervals,
            progress,
        };
        let (frames, parts) = law::dispatch(oscillator, run);
        let done = parts
            .iter()
            .map(|it| it.last().map_or(0, Sums::paths))
            .sum();
        let shortfall = match progress.finish() {
            Err(error @ Error::Limit { .. }) if done >= FEW => Some(Shortfall {
                lack: Lack::Paths {
                    done,
                    asked: self.paths,
                },
                free: true,
                reason: error.to_string(),
            }),
            ended => ended.map(|()| None)?,
        };
        let asked = (0..frames.len()).filter(|k| self.times.contains(&self.stops[*k]));
        let at = |k: usize| {
            let parts: Vec<&Sums> = parts.iter().map(|it| &it[k]).collect();
            let (mut moments, carriers) = Sums::moments(&parts, oscillator.contact(), &frames[k]);
            moments.keep(self.asked.as_deref());
            (moments, carriers)
        };
        let (moments, carriers): (Vec<Moments>, Vec<f64>) = asked.map(at).unzip();
        let mut warnings = self.warnings((oscillator, initial), walk, &moments);
        warnings.extend(self.few_carriers(&carriers).map(Warning::from));
        Ok(EnsembleResult {
            times: self.times.clone(),
            warnings,
            moments,
            paths: done,
            steps,
            step,
            scheme: walk.scheme,
            path_steps: (steps + before).saturating_mul(done),
            shortfall,
        })
    }

    /// That so few paths carry the error of the kurtosis that it does not tell what others would, where that is asked for.
    fn few_carriers(&self, carriers: &[f64]) -> Option<String> {
        let asks = |all: &Vec<Moment>| all.iter().any(|it| it.is_standardised());
        if !self.asked.as_ref().is_none_or(asks) {
            return None;
        }
        let few: Vec<f64> = self
            .times
            .iter()
            .zip(carriers)
            .filter(|(_, it)| **it < CARRIERS)
            .map(|(t, _)| *t)
            .collect();
        let first = few.first()?;
        Some(format!(
            "few paths carry the errors of skewness and kurtosis of the force at {} of {} times, first at t = {first}: these errors \
             are rough, and may be too small; more monte_carlo.paths would help",
            few.len(),
            self.times.len()
        ))
    }

    /// What limits the ensemble, the bias of its step left out.
    fn warnings(
        &self,
        (oscillator, initial): (&Oscillator, &Initial),
        walk: &Walk,
        moments: &[Moments],
    ) -> Vec<Warning> {
        let mut warnings: Vec<Warning> = Vec::new();
        if self.paths < FEW {
            let text = format!(
                "standard errors from {} paths are themselves known to {:.0} % at best; more monte_carlo.paths \
                 would help",
                self.paths,
                100.0 / (2.0 * (self.paths - 1) as f64).sqrt()
            );
            warnings.push(text.into());
        }
        warnings.extend(walk.noise.warnings(oscillator.zeta()));
        let finite = |m: &Moments| m.mean_energy.value.is_finite();
        if let Some(k) = moments.iter().position(|m| !finite(m)) {
            let from: Vec<Option<f64>> = self.times[k..].iter().map(|t| Some(*t)).collect();
            warnings.push(Warning {
                text: format!(
                    "the ensemble is not finite from t = {} on, and none of its numbers is known from there: the step \
                     {} is too long for the scheme {}; leave monte_carlo.step out to have one chosen",
                    self.times[k], walk.step, walk.scheme
                ),
                unknown: unknown("monte_carlo", &from),
            });
        }
        warnings.extend(walk::not_run_in(oscillator, initial, || {
            let times: Vec<Option<f64>> = self.times.iter().map(|t| Some(*t)).collect();
            unknown("monte_carlo", &times)
        }));
        warnings
    }
}

/// Gives means that no noise has spread the error of their steps: a share of the motion, and of its energy that times the force.
/// In flight the force is what it is.
fn steps_err(moments: &mut Moments, contact: &ContactLaw, share: f64) {
    let [q, v, force] = [moments.mean_q, moments.mean_v, moments.mean_force].map(|it| it.value);
    let motion = q.hypot(v);
    let pushed = match contact {
        ContactLaw::Free => 0.0,
        _ => motion + force.abs(),
    };
    let means = [
        (&mut moments.mean_q, motion),
        (&mut moments.mean_v, motion),
        (&mut moments.mean_force, pushed),
        (&mut moments.mean_energy, motion * (motion + force.abs())),
    ];
    for (mean, size) in means {
        if mean.error == 0.0 {
            mean.error = share * size;
        }
    }
}

/// The steps of a path that stops at every time, none longer than `step`, and the longest of them; 0 without any.
fn longest(times: &[f64], step: f64) -> Result<(u64, f64)> {
    let (mut now, mut steps, mut longest) = (0.0, 0, 0.0);
    for time in times {
        let (count, length) = walk::equal_steps(time - now, step)?;
        if count > 0 {
            longest = f64::max(longest, length);
        }
        steps += count;
        now = *time;
    }
    Ok((steps, longest))
}

/// The steps from one output time to the next.
#[derive(Debug, Clone, Copy)]
struct Interval {
    start: f64,
    steps: u64,
    coefficients: Coefficients,
}

/// The ensemble, to be run once the contact law is known.
struct Run<'a> {
    count: u64,
    paths: &'a Paths,
    /// What comes before the first of them, and is shown to nobody.
    before: Option<&'a Interval>,
    intervals: &'a [Interval],
    progress: &'a Progress<'a>,
}

impl WithLaw for Run<'_> {
    /// The frames at each output time, and of each group of paths the sums.
    type Output = (Vec<Frames>, Vec<Vec<Sums>>);

    fn with<L: Law>(self, law: L) -> Self::Output {
        // The first block gives the frames in which every block sums; it is run twice.
        let mut frames = Vec::new();
        self.block(law, 0, |_, q, v| frames.push(Frames::of(law, q, v)));
        if frames.len() < self.intervals.len() {
            return (frames, Vec::new());
        }
        let parts = walk::tasks(self.count)
            .into_par_iter()
            .map(|paths| {
                let mut sums = vec![Sums::default(); self.intervals.len()];
                for first in paths.step_by(BLOCK as usize) {
                    if self.progress.late() {
                        break;
                    }
                    let mut shown = Vec::with_capacity(sums.len());
                    self.block(law, first, |k, q, v| {
                        shown.push(vectorise!(Sums::of(law, &frames[k], q, v)));
                    });
                    // Paths that the time cut short have none of their times counted.
                    if shown.len() == sums.len() {
                        sums.iter_mut()
                            .zip(&shown)
                            .for_each(|(sum, it)| sum.add(it));
                    }
                }
                sums
            })
            .collect();
        (frames, parts)
    }
}

impl Run<'_> {
    /// Runs the block that begins with path `first` and shows its states (q, v) at every output time.
    fn block<L: Law>(&self, law: L, first: u64, mut show: impl FnMut(usize, &[f64], &[f64])) {
        let paths = BLOCK.min(self.count - first);
        let mut groups: Vec<Group> = (first..first + paths)
            .step_by(LANES)
            .map(|first| self.paths.group(first))
            .collect();
        let (mut q, mut v) = (Vec::new(), Vec::new());
        let advance = |interval: &Interval, groups: &mut [Group]| {
            let Interval {
                start,
                steps,
                coefficients,
            } = interval;
            let mut watch = Timed {
                watch: &mut Deaf,
                progress: self.progress,
            };
            vectorise!({
                for group in groups.iter_mut() {
                    coefficients.advance(law, group, *steps, *start, &mut watch);
                }
            });
            self.progress.late()
        };
        if let Some(run_in) = self.before {
            if advance(run_in, &mut groups) {
                return;
            }
            self.progress.add(run_in.steps * paths);
        }
        for (k, interval) in self.intervals.iter().enumerate() {
            if advance(interval, &mut groups) {
                return;
            }
            q.clear();
            v.clear();
            for group in &groups {
                q.extend_from_slice(&group.q);
                v.extend_from_slice(&group.v);
            }
            show(k, &q[..paths as usize], &v[..paths as usize]);
            self.progress.add(interval.steps * paths);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::ContactLaw;

    #[test]
    fn path_k_is_the_same_path_in_a_small_and_in_a_large_ensemble() {
        struct States<'a>(Run<'a>);
        impl WithLaw for States<'_> {
            type Output = Vec<(f64, f64)>;
            fn with<L: Law>(self, law: L) -> Self::Output {
                let mut states = Vec::new();
                self.0.block(law, 0, |_, q, v| {
                    states.extend(q.iter().copied().zip(v.iter().copied()));
                });
                states
            }
        }
        let it = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
        let initial = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
        let walk = Walk::of(&it, &initial, &Sampling::default()).unwrap();
        let interval = Interval {
            start: 0.0,
            steps: 6,
            coefficients: walk.coefficients(&it, 0.5),
        };
        let states = |count: u64| {
            let run = Run {
                count,
                paths: &Paths::new(&it, &initial, &walk).unwrap(),
                before: None,
                intervals: &[interval],
                progress: &Progress::new(1, Sampling::default().limits(), &|_| ()),
            };
            States(run).with(law::Hertz)
        };
        assert_eq!(states(10), states(1000)[..10]);
    }
}
