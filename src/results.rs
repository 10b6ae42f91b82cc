//! What a run answers: every number with its error, under the names of results.json.

pub(crate) mod in_unit;
mod law;
mod spectrum;
mod tree;

pub use law::Law;
pub use spectrum::{SampledSpectrum, SpectrumNumbers};

use crate::contact::ContactLaw;
use crate::estimate::{Estimate, Shortfall, Warning};
use crate::fokker_planck::{
    DecayRates, FirstLoss, FlightLaw, ImpactLaw, Periodic, Reached, Response, SolvedLaw, Steady,
    Transient,
};
use crate::moments::{Entry, Moment, Moments};
use crate::monte_carlo::{
    Crossings, EnsembleResult, FirstLossResult, Histogram, RecordResult, Scheme,
};
use crate::quadrature;
use crate::rig::Rig;
use crate::scene::{Noise, Scene};
use crate::stationary::Stationary;
use serde::Serialize;
use std::f64::consts::{LN_10, SQRT_2};

/// The answers of a run. What was not asked for is None.
///
/// ```
/// use vibroimpact::{contact::ContactLaw, oscillator::Oscillator, plan::Plan, scene::Scene};
/// let scene = Scene::new(Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3)?);
/// let results = Plan::of(&scene)?.run_quietly()?;
/// let rate = results.stationary.unwrap().get("loss_rate").unwrap();
/// assert!(rate.value > 0.0 && rate.error < 1e-9 && results.transient.is_none());
/// # Ok::<(), vibroimpact::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Results {
    /// The scene that was run.
    pub scene: Scene,
    /// The closed form (21)-(30), or what was solved for under a damping that has none.
    pub stationary: Option<Numbers>,
    /// The law that was solved for.
    pub solved: Option<SolvedLaw>,
    /// Losses of contact by Rice's formula.
    pub crossings: Option<Numbers>,
    /// The law of the time of flight.
    pub flights: Option<FlightLaw>,
    /// The law of an impact.
    pub impacts: Option<ImpactLaw>,
    /// The first loss of contact, by the backward equation.
    pub first_loss: Option<FirstLoss>,
    /// The first passage of a level, by the backward equation.
    pub first_passage: Option<FirstLoss>,
    /// The transient of the Fokker-Planck equation.
    pub transient: Option<Transient>,
    /// When a moment of it reaches a level.
    pub reach: Option<Reached>,
    /// The law that lasts under a drive.
    pub periodic: Option<Periodic>,
    /// The same over the frequency of the drive.
    pub response: Option<Response>,
    /// Its steady state on the mesh.
    pub steady: Option<Steady>,
    /// The slowest eigenvalues of L.
    pub decay_rates: Option<DecayRates>,
    /// The spectrum, from the resolvent and by sampling.
    pub spectrum: Option<SpectrumNumbers>,
    /// The transient by sampling.
    pub monte_carlo: Option<EnsembleResult>,
    /// The first loss of contact by sampling.
    pub first_loss_paths: Option<FirstLossResult>,
    /// The first passage of a level by sampling.
    pub first_passage_paths: Option<FirstLossResult>,
    /// Stationary statistics of long records.
    pub records: Option<RecordResult>,
    /// How well the sampled numbers agree with the others.
    pub agreement: Option<Agreement>,
    /// What the tolerance asked for and was not reached, with the name of its stage.
    pub shortfalls: Vec<(&'static str, Shortfall)>,
    /// How the run went.
    pub run: RunRecord,
}

/// What stands in results.json beside the moments.
const BESIDE: [Entry; 5] = [
    Entry::new(
        "log10_contact_loss_probability",
        "log10 P",
        "its logarithm",
        "1",
    ),
    Entry::new("loss_rate", "nu", "crossing rate", "W"),
    Entry::new("mean_flight", "P/nu", "mean flight", "1/W"),
    Entry::new("losses_in_window", "nu t", "in the window", "1"),
    Entry::new("mean_impact_speed", "E|v|", "speed at return", "u W"),
];

/// What one of a number is on the rig by its name in results.json; "1" for one that has no entry.
pub(crate) fn dimension(name: &str) -> &'static str {
    let entry = entries().find(|it| it.name == name);
    entry.map_or("1", |it| it.unit)
}

/// How every number of stationary motion is written, the moments first.
pub(crate) fn entries() -> impl Iterator<Item = &'static Entry> {
    Moment::ALL.into_iter().map(Moment::entry).chain(&BESIDE)
}

/// Numbers of the stationary motion by their names in results.json, in its order.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers {
    named: Vec<(&'static str, Option<Estimate>)>,
    /// Share of the time out of contact.
    pub lost_share: Option<Estimate>,
}

impl Numbers {
    /// All numbers of a stationary law.
    pub(crate) fn stationary(law: &Stationary) -> Self {
        let logarithm = law.log10_contact_loss_probability();
        Self::law(
            &law.moments(),
            logarithm,
            law.loss_rate(),
            law.mean_flight(),
        )
    }

    /// All numbers of a law that was solved for.
    pub(crate) fn solved(law: &SolvedLaw) -> Self {
        Self::law(
            &law.moments,
            law.log10_contact_loss_probability(),
            law.loss_rate,
            law.mean_flight,
        )
    }

    /// The same numbers from long records: `moments` are those of `it`, with or without control variates.
    fn recorded(it: &RecordResult, moments: &Moments) -> Self {
        let log10 = |p: Estimate| p.mapped(p.value.log10(), 1.0 / (LN_10 * p.value));
        let logarithm = moments.contact_loss_probability.map(log10);
        let crossings = it.crossings.as_ref();
        let flight = crossings.map(|it| it.mean_flight);
        Self::law(
            moments,
            logarithm.and_then(happened),
            crossings.map(|it| it.loss_rate),
            flight.and_then(happened),
        )
    }

    fn law(
        moments: &Moments,
        logarithm: Option<Estimate>,
        rate: Option<Estimate>,
        flight: Option<Estimate>,
    ) -> Self {
        let mut named = moments.named().to_vec();
        // q and v are independent.
        named.retain(|(name, _)| *name != Moment::CovQv.name());
        let more = BESIDE.iter().map(|it| it.name);
        named.extend(more.zip([logarithm, rate, flight]));
        Self {
            named,
            lost_share: moments.contact_loss_probability,
        }
    }

    /// Losses of contact by Rice's formula from the closed form, in a window of this dimensionless time.
    pub(crate) fn crossings(law: &Stationary, time: f64) -> Self {
        Self {
            named: vec![
                ("loss_rate", law.loss_rate()),
                ("losses_in_window", law.losses_in(time)),
                ("mean_flight", law.mean_flight()),
                ("mean_impact_speed", law.mean_impact_speed()),
            ],
            lost_share: law.contact_loss_probability(),
        }
    }

    /// Losses of contact by the flux through the loss point of a law that was solved for.
    pub(crate) fn flux(law: &SolvedLaw, time: f64) -> Self {
        Self {
            named: vec![
                ("loss_rate", law.loss_rate),
                ("losses_in_window", law.losses_in(time)),
                ("mean_flight", law.mean_flight),
                ("mean_impact_speed", law.mean_impact_speed),
            ],
            lost_share: law.moments.contact_loss_probability,
        }
    }

    /// Losses of contact as seen in long records.
    pub(crate) fn seen(it: &Crossings, time: f64) -> Self {
        Self {
            named: vec![
                ("loss_rate", Some(it.loss_rate)),
                ("losses_in_window", Some(it.losses_in(time))),
                ("mean_flight", happened(it.mean_flight)),
                ("mean_impact_speed", happened(it.mean_impact_speed)),
            ],
            lost_share: Some(it.lost_share),
        }
    }

    /// Name and number, in the order of results.json; None for a number that does not exist.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, Option<Estimate>)> + '_ {
        self.named.iter().copied()
    }

    /// The number of that name.
    pub fn get(&self, name: &str) -> Option<Estimate> {
        self.named.iter().find(|(it, _)| *it == name)?.1
    }
}

/// What never happened has no logarithm and no length.
fn happened(it: Estimate) -> Option<Estimate> {
    Some(it).filter(|it| it.value.is_finite())
}

/// The distance between two independent answers, in units of their errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Agreement {
    /// Largest |a - b| / sqrt(error_a^2 + error_b^2) over all names and times both have.
    pub worst: f64,
    /// Its name.
    pub worst_of: &'static str,
    /// Its time; None for a stationary number.
    pub t: Option<f64>,
    /// Expected largest of that many |standard normals|, were they independent.
    pub expected_worst: f64,
    /// How many were compared.
    pub compared: usize,
}

impl Agreement {
    /// Agreement of pairs of numbers, each with its name and time.
    fn over(pairs: impl IntoIterator<Item = Pair>) -> Option<Self> {
        let mut worst: Option<(f64, &'static str, Option<f64>)> = None;
        let mut compared = 0;
        for (name, t, a, b) in pairs {
            if let Some(z) = distance(a, b) {
                compared += 1;
                if worst.is_none_or(|(worst, ..)| z > worst) {
                    worst = Some((z, name, t));
                }
            }
        }
        worst.map(|(worst, worst_of, t)| Self {
            worst,
            worst_of,
            t,
            expected_worst: expected_largest(compared),
            compared,
        })
    }
}

/// Name, time if it has one, and two answers.
type Pair = (&'static str, Option<f64>, Estimate, Estimate);

/// Pairs of the times and names both have.
fn common((times_a, a): (&[f64], &[Moments]), (times_b, b): (&[f64], &[Moments])) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for (t, a) in times_a.iter().zip(a) {
        let same = times_b.iter().position(|it| it == t);
        let Some(b) = same.and_then(|k| b.get(k)) else {
            continue;
        };
        for ((name, a), (_, b)) in a.named().into_iter().zip(b.named()) {
            pairs.extend(a.zip(b).map(|(a, b)| (name, Some(*t), a, b)));
        }
    }
    pairs
}

/// |a - b| / sqrt(error_a^2 + error_b^2); None without an error or a number.
pub(crate) fn distance(a: Estimate, b: Estimate) -> Option<f64> {
    let z = (a.value - b.value).abs() / a.error.hypot(b.error);
    z.is_finite().then_some(z)
}

/// Expected largest of `n` independent |standard normals|: the integral of 1 - erf(x/sqrt 2)^n.
pub(crate) fn expected_largest(n: usize) -> f64 {
    let beyond = |x: f64| 1.0 - libm::erf(x / SQRT_2).powf(n as f64);
    if n == 0 {
        return 0.0;
    }
    quadrature::integrate(beyond, &[0.0, 1.0, 2.0, 4.0, 6.0, 9.0], 1e-9).value
}

/// How a run went.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunRecord {
    /// From the first stage to the last.
    pub wall_seconds: f64,
    /// Each finished stage with its time.
    pub stages: Vec<(&'static str, f64)>,
    /// Largest memory the process held; None where the system does not tell.
    pub peak_memory_bytes: Option<u64>,
    /// Threads.
    pub threads: usize,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

impl Results {
    /// Nothing computed yet.
    pub(crate) fn empty(scene: &Scene) -> Self {
        Self {
            scene: scene.clone(),
            stationary: None,
            solved: None,
            crossings: None,
            flights: None,
            impacts: None,
            first_loss: None,
            first_passage: None,
            transient: None,
            reach: None,
            periodic: None,
            response: None,
            steady: None,
            decay_rates: None,
            spectrum: None,
            monte_carlo: None,
            first_loss_paths: None,
            first_passage_paths: None,
            records: None,
            agreement: None,
            shortfalls: Vec::new(),
            run: RunRecord {
                threads: rayon::current_num_threads(),
                ..RunRecord::default()
            },
        }
    }

    /// Notes what the reader should know.
    pub(crate) fn warn(&mut self, warnings: &[String]) {
        let warnings = warnings.iter().cloned();
        self.run.warnings.extend(warnings.map(Warning::from));
    }

    /// Notes what a stage did not reach of the tolerance, and with `warn` among the warnings too.
    pub(crate) fn fall_short(&mut self, stage: &'static str, it: Option<&Shortfall>, warn: bool) {
        if warn {
            let warning = it.map(|it| Warning::from(format!("{stage}: {it}")));
            self.run.warnings.extend(warning);
        }
        self.shortfalls.extend(it.map(|it| (stage, it.clone())));
    }

    /// Whether a deterministic number that the program was free to refine did not reach the tolerance:
    /// exit status 3.
    pub fn falls_short(&self) -> bool {
        self.shortfalls.iter().any(|(_, it)| it.free)
    }

    /// Whether the records obey the exact identities that control variates rest on: white noise, and a
    /// scheme whose stationary law is exact.
    pub(crate) fn controlled(&self) -> bool {
        let white = |it: &crate::scene::MonteCarlo| it.noise == Noise::White;
        let exact =
            |it: &RecordResult| matches!(it.scheme, Scheme::Splitting42 | Scheme::Splitting62);
        self.scene.oscillator.is_viscous()
            && self.scene.monte_carlo.as_ref().is_some_and(white)
            && self.records.as_ref().is_some_and(exact)
    }

    /// The stationary numbers of the long records.
    pub(crate) fn sampled_stationary(&self) -> Option<Numbers> {
        let it = self.records.as_ref()?;
        let moments = if self.controlled() {
            &it.controlled
        } else {
            &it.moments
        };
        Some(Numbers::recorded(it, moments))
    }

    /// The crossings of the long records, if they are asked for and the scheme sees them.
    pub(crate) fn sampled_crossings(&self) -> Option<(&Crossings, Numbers)> {
        let time = self.scene.clock().time(self.scene.crossings_window()?);
        let it = self.records.as_ref()?.crossings.as_ref()?;
        Some((it, Numbers::seen(it, time)))
    }

    /// The time of flight in the long records, once a flight has been seen from loss to return.
    pub(crate) fn sampled_flights(&self) -> Option<&Histogram> {
        let (seen, _) = self.sampled_crossings()?;
        let flown = seen.mean_flight.value.is_finite();
        flown.then_some(&seen.flight_time)
    }

    /// Everything sampled against everything computed otherwise.
    pub fn agree(&self) -> Option<Agreement> {
        let mut pairs = Vec::new();
        if let (Some(a), Some(b)) = (&self.transient, &self.monte_carlo) {
            pairs = common((&a.times, &a.moments), (&b.times, &b.moments));
        }
        for (a, b) in [
            (&self.first_loss, &self.first_loss_paths),
            (&self.first_passage, &self.first_passage_paths),
        ] {
            let (Some(a), Some(b)) = (a, b) else {
                continue;
            };
            let both = a.survival.iter().zip(&b.survival).zip(&b.times);
            // Nobody has been lost at the start.
            let both = both.filter(|(_, t)| **t > 0.0);
            pairs.extend(both.map(|((a, b), t)| ("survival", Some(*t), *a, *b)));
        }
        let mut seen = Vec::new();
        let mut put = |name, a: Option<Estimate>, b: Option<Estimate>| {
            // The losses in a window are their rate under another name.
            if name != "losses_in_window" && !seen.contains(&name) {
                pairs.extend(a.zip(b).map(|(a, b)| (name, None, a, b)));
                seen.push(name);
            }
        };
        if let (Some(a), Some(b)) = (&self.stationary, self.sampled_stationary()) {
            a.iter().for_each(|(name, a)| put(name, a, b.get(name)));
        }
        if let (Some(a), Some((_, b))) = (&self.crossings, self.sampled_crossings()) {
            a.iter().for_each(|(name, a)| put(name, a, b.get(name)));
        }
        if let Some(it) = &self.spectrum {
            pairs.extend(it.pairs().map(|(a, b)| ("spectrum", None, a, b)));
        }
        Agreement::over(pairs)
    }

    /// The main numbers in newtons, micrometres, hertz and seconds, (2)-(14).
    pub fn physical(&self, rig: &Rig) -> Vec<(&'static str, Estimate)> {
        let exact = Estimate::closed_form;
        let mut all = vec![
            (
                "force_psd_n2_per_hz",
                exact(rig.force_psd_from_level(self.scene.oscillator.h())),
            ),
            ("mass_kg", exact(rig.mass())),
            ("period_ms", exact(1e3 / rig.frequency())),
            (
                "memory_s",
                exact(rig.seconds(0.5 / self.scene.oscillator.zeta())),
            ),
        ];
        let window = self.scene.window_seconds(rig);
        let window = window.filter(|_| self.crossings.is_some());
        all.extend(window.map(|window| ("window_s", exact(window))));
        let of = |name: &str| {
            let law = self.stationary.as_ref().and_then(|it| it.get(name));
            law.or_else(|| self.crossings.as_ref()?.get(name))
        };
        let lost = self.crossings.as_ref().and_then(|it| it.lost_share);
        all.extend(self.measured(rig, &of, lost));
        let main = self.spectrum.as_ref().and_then(|it| it.peaks.first());
        if let Some(peak) = main {
            all.push(("peak_frequency_hz", peak.omega.scaled(rig.hertz(1.0))));
            let width = peak.width.map(|it| it.scaled(rig.hertz(1.0)));
            all.extend(width.map(|it| ("half_power_width_hz", it)));
        }
        let seconds = self.scene.clock().seconds(rig);
        let reached = self.reach.as_ref().and_then(|it| it.t);
        all.extend(reached.map(|t| ("reach_s", t.scaled(seconds))));
        let first = self.first_loss.as_ref().map(|it| it.mean_time);
        let first = first.filter(|it| it.value.is_finite());
        all.extend(first.map(|t| ("mean_time_to_loss_s", t.scaled(seconds))));
        all
    }

    /// The same numbers from long records, those of the rig itself left out.
    pub(crate) fn physical_sampled(&self, rig: &Rig) -> Vec<(&'static str, Estimate)> {
        let law = self.sampled_stationary();
        let crossings = self.sampled_crossings().map(|(_, numbers)| numbers);
        let of = |name: &str| {
            let number = law.as_ref().and_then(|it| it.get(name));
            number.or_else(|| crossings.as_ref()?.get(name))
        };
        let lost = crossings.as_ref().and_then(|it| it.lost_share);
        self.measured(rig, &of, lost)
    }

    /// What can be measured on the rig; `of` gives dimensionless numbers by name.
    fn measured(
        &self,
        rig: &Rig,
        of: &dyn Fn(&str) -> Option<Estimate>,
        lost_share: Option<Estimate>,
    ) -> Vec<(&'static str, Estimate)> {
        let micrometre = (rig.compression(1.0) - rig.compression(0.0)) * 1e6;
        let velocity = rig.velocity(1.0) * 1e3;
        let millisecond = self.scene.clock().seconds(rig) * 1e3;
        let root = |x: Estimate| x.mapped(x.value.sqrt(), 0.5 / x.value.sqrt());
        let unit = |name: &str, unit: f64| of(name).map(|x| x.scaled(unit));
        let lost = lost_share.zip(self.scene.window_seconds(rig));
        let all = [
            ("std_force_n", unit("std_force", rig.newtons(1.0))),
            ("mean_displacement_um", unit("mean_q", micrometre)),
            (
                "std_displacement_um",
                of("var_q").map(|x| root(x).scaled(micrometre)),
            ),
            (
                "std_velocity_mm_per_s",
                of("var_v").map(|x| root(x).scaled(velocity)),
            ),
            ("contact_loss_probability", of("contact_loss_probability")),
            ("losses_per_second", unit("loss_rate", 1e3 / millisecond)),
            ("losses_in_window", of("losses_in_window")),
            ("mean_flight_ms", unit("mean_flight", millisecond)),
            (
                "time_out_of_contact_s",
                lost.map(|(share, window)| share.scaled(window)),
            ),
            (
                "mean_impact_speed_mm_per_s",
                unit("mean_impact_speed", velocity),
            ),
        ];
        let there = |(name, number): (_, Option<Estimate>)| Some((name, number?));
        all.into_iter().filter_map(there).collect()
    }

    /// The stationary law as curves; None where there is none, or none was solved for.
    pub fn law(&self) -> Option<Law> {
        Law::of(&self.scene.oscillator, self.solved.as_ref())
    }

    pub(crate) fn contact(&self) -> &ContactLaw {
        self.scene.oscillator.contact()
    }
}

/// A number of [`Results::physical`] by its name: in words, its unit, and whether the scene typed it or nearly so, so that
/// its error says nothing.
pub(crate) fn physical_words(name: &str) -> (&str, &'static str, bool) {
    match name {
        "force_psd_n2_per_hz" => ("excitation, one-sided", "N^2/Hz", true),
        "mass_kg" => ("moving mass", "kg", true),
        "period_ms" => ("period", "ms", true),
        "memory_s" => ("correlation time", "s", true),
        "std_force_n" => ("deviation of the force", "N", false),
        "mean_displacement_um" => ("mean displacement", "um", false),
        "std_displacement_um" => ("its deviation", "um", false),
        "std_velocity_mm_per_s" => ("deviation of velocity", "mm/s", false),
        "contact_loss_probability" => ("out of contact", "of time", false),
        "losses_per_second" => ("losses of contact", "1/s", false),
        "window_s" => ("window", "s", true),
        "losses_in_window" => ("losses in the window", "", false),
        "time_out_of_contact_s" => ("out of contact in it", "s", false),
        "mean_impact_speed_mm_per_s" => ("mean speed at return", "mm/s", false),
        "mean_flight_ms" => ("mean flight", "ms", false),
        "peak_frequency_hz" => ("peak of the spectrum", "Hz", false),
        "half_power_width_hz" => ("its half-power width", "Hz", false),
        "reach_s" => ("time to the level", "s", false),
        "mean_time_to_loss_s" => ("mean time to first loss", "s", false),
        other => (other, "", false),
    }
}

/// Largest memory this process held so far, in bytes; None where the system does not tell.
pub(crate) fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kilobytes * 1024)
}

/// Widths of cells from their centres, exact for equal cells and of second order for graded ones.
#[cfg(feature = "plots")]
pub(crate) fn widths(centres: &[f64]) -> Vec<f64> {
    let n = centres.len();
    (0..n)
        .map(|k| match (k, n) {
            (_, 0 | 1) => 1.0,
            (0, _) => centres[1] - centres[0],
            (k, n) if k + 1 == n => centres[k] - centres[k - 1],
            (k, _) => 0.5 * (centres[k + 1] - centres[k - 1]),
        })
        .collect()
}

/// Middles of the bins of a histogram.
pub fn centres(it: &Histogram) -> impl Iterator<Item = f64> + '_ {
    it.edges.windows(2).map(|ends| 0.5 * (ends[0] + ends[1]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_expected_largest_of_many_normals_is_the_known_one() {
        // E|Z| = sqrt(2/pi), E max(|Z1|, |Z2|) = 2/sqrt(pi); 1000: Gumbel within a few percent.
        assert!((expected_largest(1) - 0.797_884_560_8).abs() < 1e-8);
        assert!((expected_largest(2) - 2.0 / std::f64::consts::PI.sqrt()).abs() < 1e-8);
        let many = expected_largest(1000);
        assert!((3.3..3.6).contains(&many), "{many}");
        assert_eq!(expected_largest(0), 0.0);
    }

    #[test]
    fn agreement_adds_the_errors_in_quadrature_and_takes_the_worst_over_common_times() {
        let at = |mean: f64, error: f64| Moments {
            mean_q: Estimate::new(mean, error, crate::estimate::Origin::Space),
            ..Moments::default()
        };
        let a = [at(0.0, 3.0), at(1.0, 3.0), at(9.0, 3.0)];
        let b = [at(0.0, 4.0), at(11.0, 4.0)];
        let it = Agreement::over(common((&[1.0, 2.0, 3.0], &a), (&[1.0, 2.0], &b))).unwrap();
        assert_eq!(
            (it.worst, it.worst_of, it.t, it.compared),
            (2.0, "mean_q", Some(2.0), 2)
        );
        assert!(common((&[1.0], &a[..1]), (&[5.0], &b[..1])).is_empty());
    }
}
