//! What a run answers: every number with its error, under the names of results.json.

mod agreement;
pub(crate) mod in_unit;
mod law;
mod numbers;
mod spectrum;
mod tree;

pub use agreement::Agreement;
use agreement::common;
pub(crate) use agreement::distance;
pub use law::Law;
pub use numbers::Numbers;
pub(crate) use numbers::{dimension, entries};
pub use spectrum::{SampledSpectrum, SpectrumNumbers};

use crate::contact::ContactLaw;
use crate::estimate::{Estimate, Shortfall, Warning};
use crate::fokker_planck::{
    DecayRates, FirstLoss, FlightLaw, ImpactLaw, Periodic, Reached, Response, SolvedLaw, Steady,
    Transient,
};
use crate::moments::Moments;
use crate::monte_carlo::{
    Crossings, EnsembleResult, FirstLossResult, Histogram, RecordResult, Scheme,
};
use crate::rig::Rig;
use crate::scene::{Noise, Scene};

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
    /// Stationary statistics of long realisations.
    pub records: Option<RecordResult>,
    /// How well the sampled numbers agree with the others.
    pub agreement: Option<Agreement>,
    /// What the tolerance asked for and was not reached, with the name of its stage.
    pub shortfalls: Vec<(&'static str, Shortfall)>,
    /// How the run went.
    pub run: RunRecord,
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

impl RunRecord {
    /// Takes in a warning; what two stages say in the same words is said once.
    pub(crate) fn warn(&mut self, warning: Warning) {
        match self.warnings.iter_mut().find(|it| it.text == warning.text) {
            Some(same) => same.unknown.extend(warning.unknown),
            None => self.warnings.push(warning),
        }
    }
}

impl Results {
    /// Where the stationary numbers come from.
    pub(crate) fn origin(&self) -> &'static str {
        if self.solved.is_some() {
            "solved"
        } else {
            "closed form"
        }
    }

    /// What a steady state on the mesh is held against.
    pub(crate) fn known_law(&self) -> &'static str {
        if self.scene.oscillator.damping().has_closed_form() {
            "closed form"
        } else {
            "law solved for"
        }
    }

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
    pub(crate) fn warn<W: Clone + Into<Warning>>(&mut self, warnings: &[W]) {
        let warnings = warnings.iter().cloned().map(W::into);
        self.run.warnings.extend(warnings);
    }

    /// Notes what a stage lacks.
    pub(crate) fn fall_short(&mut self, stage: &'static str, it: Option<&Shortfall>) {
        let warning = it.map(|it| format!("{stage}: {it}").into());
        self.run.warnings.extend(warning);
        self.shortfalls.extend(it.map(|it| (stage, it.clone())));
    }

    /// Whether a deterministic number that the program was free to refine did not reach the tolerance:
    /// exit status 3.
    pub fn falls_short(&self) -> bool {
        self.shortfalls.iter().any(|(_, it)| it.free)
    }

    /// Whether the records obey the exact identities that control variates rest on, white noise and a
    /// scheme whose stationary law is exact, and are long enough for them.
    pub(crate) fn controlled(&self) -> bool {
        let white = |it: &crate::scene::MonteCarlo| it.noise == Noise::White;
        let exact = |it: &RecordResult| {
            matches!(it.scheme, Scheme::Splitting42 | Scheme::Splitting62) && it.are_long()
        };
        self.scene.oscillator.is_viscous()
            && self.scene.monte_carlo.as_ref().is_some_and(white)
            && self.records.as_ref().is_some_and(exact)
    }

    /// The stationary numbers of the long realisations.
    pub(crate) fn sampled_stationary(&self) -> Option<Numbers> {
        let it = self.records.as_ref()?;
        let moments = if self.controlled() {
            &it.controlled
        } else {
            &it.moments
        };
        let asked = self.scene.outputs.moments.as_deref();
        Some(Numbers::recorded(it, moments).asked(asked))
    }

    /// The moments of the paths at a time of the output.
    pub(crate) fn paths_at(&self, t: f64) -> Option<&Moments> {
        let it = self.monte_carlo.as_ref()?;
        let k = it.times.iter().position(|it| *it == t)?;
        it.moments.get(k)
    }

    /// The crossings of the long realisations, if they are asked for and the scheme sees them.
    pub(crate) fn sampled_crossings(&self) -> Option<(&Crossings, Numbers)> {
        let time = self.scene.clock().time(self.scene.crossings_window()?);
        let it = self.records.as_ref()?.crossings.as_ref()?;
        Some((it, Numbers::seen(it, time)))
    }

    /// The time of flight in the long realisations, once a flight has been seen from loss to return.
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
            let noise = self.scene.monte_carlo.as_ref().map(|it| it.noise);
            let band = match noise {
                Some(Noise::Cosines { band, .. }) => band,
                _ => f64::INFINITY,
            };
            pairs.extend(it.pairs(band).map(|(a, b)| ("spectrum", None, a, b)));
        }
        Agreement::over(pairs)
    }

    /// The main numbers in newtons, micrometres, hertz and seconds, (2)-(14); those of the stationary law are of steady noise
    /// alone.
    pub fn physical(&self, rig: &Rig) -> Vec<(&'static str, Estimate)> {
        let rig = &rig.with_contact(self.contact());
        let exact = Estimate::closed_form;
        let oscillator = &self.scene.oscillator;
        let level = rig.force_psd_from_level(oscillator.h());
        let memory = rig.seconds(oscillator.correlation_time());
        let mut all = vec![
            ("force_psd_n2_per_hz", exact(level)),
            ("mass_kg", exact(rig.mass())),
            ("period_ms", exact(1e3 / rig.frequency())),
            ("memory_s", exact(memory)),
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
        let mean = |it: &Option<FirstLoss>| it.as_ref().map(|it| it.mean_time);
        let firsts = [
            ("mean_time_to_loss_s", mean(&self.first_loss)),
            ("mean_time_to_passage_s", mean(&self.first_passage)),
        ];
        let firsts = firsts
            .into_iter()
            .filter_map(|(name, it)| Some((name, it?)));
        let firsts = firsts.filter(|(_, it)| it.value.is_finite());
        all.extend(firsts.map(|(name, t)| (name, t.scaled(seconds))));
        all
    }

    /// The same numbers from long realisations, those of the rig itself left out.
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

    /// [`Results::physical`] beside the same numbers from long realisations.
    pub(crate) fn on_the_rig(&self, rig: &Rig) -> Vec<(&'static str, [Option<Estimate>; 2])> {
        let solved = self.physical(rig).into_iter();
        let mut all: Vec<_> = solved.map(|(name, it)| (name, [Some(it), None])).collect();
        for (name, seen) in self.physical_sampled(rig) {
            match all.iter_mut().find(|it| it.0 == name) {
                Some((_, both)) => both[1] = Some(seen),
                None => all.push((name, [None, Some(seen)])),
            }
        }
        all
    }

    /// What can be measured on the rig; `of` gives dimensionless numbers by name.
    fn measured(
        &self,
        rig: &Rig,
        of: &dyn Fn(&str) -> Option<Estimate>,
        lost_share: Option<Estimate>,
    ) -> Vec<(&'static str, Estimate)> {
        let micrometre = rig.micrometres();
        let velocity = rig.millimetres_per_second();
        let millisecond = self.scene.clock().seconds(rig) * 1e3;
        let root = |name: &str, unit: f64| {
            of(name).map(|x| x.mapped(x.value.sqrt(), 0.5 / x.value.sqrt()).scaled(unit))
        };
        let unit = |name: &str, unit: f64| of(name).map(|x| x.scaled(unit));
        let lost = lost_share.zip(self.scene.window_seconds(rig));
        let lost = lost.map(|(share, window)| share.scaled(window));
        let speed = unit("mean_impact_speed", velocity);
        let all = [
            ("std_force_n", unit("std_force", rig.newtons(1.0))),
            ("mean_displacement_um", unit("mean_q", micrometre)),
            ("std_displacement_um", root("var_q", micrometre)),
            ("std_velocity_mm_per_s", root("var_v", velocity)),
            ("contact_loss_probability", of("contact_loss_probability")),
            ("losses_per_second", unit("loss_rate", 1e3 / millisecond)),
            ("losses_in_window", of("losses_in_window")),
            ("mean_flight_ms", unit("mean_flight", millisecond)),
            ("time_out_of_contact_s", lost),
            ("mean_impact_speed_mm_per_s", speed),
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
        "reach_s" => ("time to the fraction asked for", "s", false),
        "mean_time_to_loss_s" => ("mean time to first loss", "s", false),
        "mean_time_to_passage_s" => ("mean time to passage", "s", false),
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

/// Middles of the bins of a histogram.
#[doc(hidden)]
pub fn centres(it: &Histogram) -> impl Iterator<Item = f64> + '_ {
    it.edges.windows(2).map(|ends| 0.5 * (ends[0] + ends[1]))
}
