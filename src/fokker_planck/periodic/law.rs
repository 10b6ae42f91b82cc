//! The periodic law at one frequency.

use super::harmonics::{Harmonic, mean};
use crate::error::Result;
use crate::estimate::{Estimate, Shortfall};
use crate::fokker_planck::budget::{Cost, Limits};
use crate::fokker_planck::density::Snapshot;
use crate::fokker_planck::settings::{Method, Settings};
use crate::fokker_planck::transient::{Metastable, Multiplier, Recipe, Transient};
use crate::initial::Initial;
use crate::moments::{Moment, Moments};
use crate::oscillator::Oscillator;
use std::f64::consts::TAU;

/// Harmonics of E\[q\], E\[v\] and E\[N\] that are told.
const HARMONICS: usize = 4;

/// Phases at the least at which a law is seen for its harmonics and for its mean: fewer would take one harmonic for another.
const SEEN: usize = 64;

/// The law that lasts under a drive a cos(W t + phase), at equally spaced phases of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Periodic {
    /// W t of each point, in radians from 0 on.
    pub phase: Vec<f64>,
    /// Moments with their errors.
    pub moments: Vec<Moments>,
    /// Harmonics of E\[q\], the first first.
    pub mean_q: Vec<Harmonic>,
    /// Harmonics of E\[v\].
    pub mean_v: Vec<Harmonic>,
    /// Harmonics of E\[N\].
    pub mean_force: Vec<Harmonic>,
    /// The probability to be out of contact, averaged over the phase; None for a law that cannot lose contact.
    pub contact_loss_probability: Option<Estimate>,
    /// The largest eigenvalues of the map over one period but 1: what is left of a deviation a period later. None where flights
    /// without friction forget ever more slowly.
    pub multipliers: Vec<Multiplier>,
    /// The L1 distance of the law to itself a period later.
    pub residual: f64,
    /// The two laws that it is made of, where two orbits last without noise and the passage from one to the other is ten times
    /// slower than anything else: what a motion shows meanwhile.
    pub metastable: Option<[MetastableLaw; 2]>,
    /// p(q, v) at up to [`Periodic::MAPS`] of these phases, the first at phase 0; t is the time since then.
    pub densities: Vec<Snapshot>,
    /// What it was computed with; `steps` are those of all periods of the finest two runs.
    pub method: Method,
    /// What the tolerance asked for and was not reached.
    pub shortfall: Option<Shortfall>,
    /// What the reader should know.
    pub warnings: Vec<String>,
}

/// What a motion shows that began near one of two orbits, until noise takes it to the other: at a time when all but that passage
/// has fallen by e^2, and without that rest.
#[derive(Debug, Clone, PartialEq)]
pub struct MetastableLaw {
    /// Its part of the law that lasts.
    pub probability: Estimate,
    /// E\[q\] averaged over the phase, which tells two wells apart; None where nobody asked for it.
    pub displacement: Option<Estimate>,
    /// Harmonics of E\[q\] in it, the first first.
    pub mean_q: Vec<Harmonic>,
    /// Harmonics of E\[N\].
    pub mean_force: Vec<Harmonic>,
    /// The probability to be out of contact, averaged over the phase; None for a law that cannot lose contact.
    pub contact_loss_probability: Option<Estimate>,
}

impl MetastableLaw {
    fn of(it: &Metastable) -> Self {
        let harmonics = |moment| Harmonic::of(&curve(&it.moments, moment), HARMONICS);
        Self {
            probability: it.probability,
            displacement: averaged(&it.moments, Moment::MeanQ),
            mean_q: harmonics(Moment::MeanQ),
            mean_force: harmonics(Moment::MeanForce),
            contact_loss_probability: averaged(&it.moments, Moment::ContactLossProbability),
        }
    }

    /// Its probability, E\[q\], the first harmonic of that, P(loss).
    pub(crate) fn main_numbers(&self) -> [Option<Estimate>; 4] {
        let first = self.mean_q.first().map(|it| it.amplitude);
        let lost = self.contact_loss_probability;
        [Some(self.probability), self.displacement, first, lost]
    }
}

/// One number over the phase.
fn curve(moments: &[Moments], moment: Moment) -> Vec<Estimate> {
    moments.iter().filter_map(|at| at.get(moment)).collect()
}

/// One number averaged over the phase.
fn averaged(moments: &[Moments], moment: Moment) -> Option<Estimate> {
    let curve = curve(moments, moment);
    (!curve.is_empty()).then(|| mean(&curve))
}

/// How a periodic law will be computed.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PeriodicLaw {
    recipe: Recipe,
    /// Equally spaced over a period from phase 0 on; those that the recipe counts are asked for.
    times: Vec<f64>,
    /// Those at which the density is kept.
    maps: Vec<f64>,
}

impl PeriodicLaw {
    /// The recipe for the periodic law at so many phases under the drive of the settings, with so many densities at most.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] without a drive, and for settings that no periodic law can be computed with.
    pub(crate) fn of(
        oscillator: &Oscillator,
        (phases, maps): (usize, usize),
        settings: &Settings,
    ) -> Result<Self> {
        let told = |asked: &Vec<Moment>| Moment::OVER_A_PERIOD.iter().any(|it| asked.contains(it));
        let each = if settings.moments.as_ref().is_none_or(told) && phases < 2 * SEEN {
            // An even number, for every second to be held against all.
            SEEN.div_ceil(phases.max(1))
                .next_multiple_of(1 + phases % 2)
        } else {
            1
        };
        let (recipe, times) = Recipe::lasting(oscillator, (phases, each), settings)?;
        let maps = maps.min(phases);
        let map = |k: usize| times[k * phases / maps * each];
        Ok(Self {
            recipe,
            maps: (0..maps).map(map).collect(),
            times,
        })
    }

    /// Whether two orbits last without noise.
    fn has_rivals(&self) -> bool {
        let forcing = self.recipe.forcing.as_ref();
        forcing.is_some_and(|it| it.orbits().len() > 1)
    }

    /// The slowest multiplier, if it is known; between two orbits also that it is less than 1.
    pub(super) fn slowest(&self, law: &Periodic) -> Option<Multiplier> {
        let slowest = law.multipliers.first().copied();
        slowest.filter(|it| !self.has_rivals() || it.error < 1.0 - it.modulus())
    }

    /// Between two orbits, the periods in which the slowest mode falls by e: infinitely many if that is not known, and None where a
    /// motion forgets its orbit within one.
    pub(super) fn forming(&self, law: &Periodic) -> Option<f64> {
        let slowest = self.slowest(law);
        let periods = slowest.map_or(f64::INFINITY, |it| -1.0 / it.modulus().ln());
        (self.has_rivals() && periods > 1.0).then_some(periods)
    }

    pub(crate) fn cost(&self) -> Cost {
        self.recipe.cost
    }

    /// Method and reason.
    pub(crate) fn words(&self) -> String {
        let words = self.recipe.words();
        format!("{words}, its fixed point over a period by GMRES")
    }

    /// The law.
    pub(crate) fn solve(
        &self,
        oscillator: &Oscillator,
        limits: &Limits,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Periodic> {
        let question = (oscillator, &Initial::Stationary);
        let times = (&self.times[..], &self.maps[..]);
        let it = self.recipe.solve(question, times, limits, progress)?;
        let mut law = Periodic::of(it, self.recipe.each);
        let forming = self.forming(&law);
        let flies = |it: &Estimate| it.value > it.error;
        if oscillator.continuous_from() == Some(0.0)
            && law.contact_loss_probability.as_ref().is_some_and(flies)
        {
            law.multipliers.clear();
            let none = "no Floquet multipliers: without friction in flight the spectrum is continuous up to 1";
            law.warnings.push(none.into());
        }
        if let Some(periods) = forming {
            let periods = if periods.is_finite() {
                format!("some {periods:.0} periods to form")
            } else {
                "more periods to form than a run can tell".into()
            };
            law.warnings.push(format!(
                "two orbits last without noise: the law holds both, each with its probability, and takes {periods}; \
                 over shorter times a motion shows the one that it began near"
            ));
        }
        Ok(law)
    }
}

impl Periodic {
    /// Most stroboscopic maps of the density.
    pub const MAPS: usize = 8;

    /// E\[q\], averaged over the phase.
    pub(super) fn displacement(&self) -> Option<Estimate> {
        averaged(&self.moments, Moment::MeanQ)
    }

    /// The harmonics of each moment that has them.
    pub(crate) fn harmonics(&self) -> [(Moment, &[Harmonic]); 3] {
        [
            (Moment::MeanQ, &self.mean_q),
            (Moment::MeanV, &self.mean_v),
            (Moment::MeanForce, &self.mean_force),
        ]
    }

    /// Every `each`-th phase of a law, from the first on.
    fn of(mut it: Transient, each: usize) -> Self {
        let (n, first) = (it.times.len() / each, it.times[0]);
        for map in &mut it.densities {
            map.t -= first;
        }
        let floquet = it.floquet.unwrap_or_default();
        let harmonics = |moment| Harmonic::of(&curve(&it.moments, moment), HARMONICS);
        Self {
            phase: (0..n).map(|k| TAU * k as f64 / n as f64).collect(),
            mean_q: harmonics(Moment::MeanQ),
            mean_v: harmonics(Moment::MeanV),
            mean_force: harmonics(Moment::MeanForce),
            contact_loss_probability: averaged(&it.moments, Moment::ContactLossProbability),
            metastable: floquet
                .metastable
                .map(|it| it.each_ref().map(MetastableLaw::of)),
            moments: it.moments.into_iter().step_by(each).collect(),
            multipliers: floquet.multipliers,
            residual: floquet.residual,
            densities: it.densities,
            method: it.method,
            shortfall: it.shortfall,
            warnings: it.warnings,
        }
    }
}

/// The law that lasts under the drive of `settings.excitation` at `phases` equally spaced phases: the fixed point of the
/// map over one period, by GMRES, on a ladder of meshes as for [`crate::fokker_planck::transient()`]. `progress` is told the
/// part done, 0 to 1.
///
/// ```
/// use vibroimpact::contact::ContactLaw;
/// use vibroimpact::excitation::{Drive, Excitation};
/// use vibroimpact::fokker_planck::{Settings, periodic};
/// use vibroimpact::oscillator::Oscillator;
///
/// let oscillator = Oscillator::new(ContactLaw::Linear, 0.05, 2e-3)?;
/// let drive = Some(Drive::new(0.02, 0.95, 0.0)?);
/// let settings = Settings {
///     excitation: Excitation { drive, envelope: None },
///     ..Settings::default()
/// };
/// let law = periodic(&oscillator, 8, &settings, &|_done| ())?;
/// let response = 0.02 / (1.0 - 0.95f64 * 0.95).hypot(2.0 * 0.05 * 0.95);
/// let first = law.mean_q[0].amplitude;
/// assert!((first.value - response).abs() < first.error);
/// // What is left of a deviation after a period: e^{-0.05 2 pi/0.95}.
/// assert!((law.multipliers[0].modulus() - 0.7184).abs() < 1e-3);
/// # Ok::<(), vibroimpact::Error>(())
/// ```
///
/// # Errors
/// [`crate::Error::Invalid`] without a drive and for settings that exclude each other, [`crate::Error::Limit`] when
/// `max_seconds` is reached before there is any answer, [`crate::Error::Linear`] where GMRES finds no fixed point.
pub fn periodic(
    oscillator: &Oscillator,
    phases: usize,
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Periodic> {
    settings.check()?;
    let recipe = PeriodicLaw::of(oscillator, (phases, Periodic::MAPS), settings)?;
    recipe.solve(oscillator, &settings.limits(), progress)
}
