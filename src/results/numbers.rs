//! The numbers of stationary motion, by their names in results.json.

use crate::estimate::Estimate;
use crate::fokker_planck::SolvedLaw;
use crate::moments::{Entry, Moment, Moments};
use crate::monte_carlo::{Crossings, RecordResult};
use crate::stationary::Stationary;
use std::f64::consts::LN_10;

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
    pub(super) named: Vec<(&'static str, Option<Estimate>)>,
    /// Share of the time out of contact.
    pub lost_share: Option<Estimate>,
}

impl Numbers {
    /// All numbers of a stationary law.
    pub(crate) fn stationary(law: &Stationary) -> Self {
        let logarithm = law.log10_contact_loss_probability();
        let (rate, flight) = (law.loss_rate(), law.mean_flight());
        Self::law(&law.moments(), logarithm, rate, flight)
    }

    /// All numbers of a law that was solved for.
    pub(crate) fn solved(law: &SolvedLaw) -> Self {
        let logarithm = law.log10_contact_loss_probability();
        Self::law(&law.moments, logarithm, law.loss_rate, law.mean_flight)
    }

    /// The same numbers from long realisations: `moments` are those of `it`, with or without control variates.
    pub(super) fn recorded(it: &RecordResult, moments: &Moments) -> Self {
        let log10 = |p: Estimate| p.mapped(p.value.log10(), 1.0 / (LN_10 * p.value));
        let logarithm = moments.contact_loss_probability.map(log10);
        let crossings = it.crossings.as_ref();
        let flight = crossings.map(|it| it.mean_flight);
        let (rate, flight) = (crossings.map(|it| it.loss_rate), flight.and_then(happened));
        Self::law(moments, logarithm.and_then(happened), rate, flight)
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

    /// The same without moments that nobody asked for, where only some were.
    pub(crate) fn asked(mut self, moments: Option<&[Moment]>) -> Self {
        if let Some(asked) = moments {
            let left = |name: &str| Moment::named(name).is_some_and(|it| !asked.contains(&it));
            self.named.retain(|(name, _)| !left(name));
        }
        self
    }

    /// Losses of contact by Rice's formula from the closed form, in a window of this dimensionless time.
    pub(crate) fn crossings(law: &Stationary, time: f64) -> Self {
        let window = law.losses_in(time);
        let (flight, speed) = (law.mean_flight(), law.mean_impact_speed());
        let lost = law.contact_loss_probability();
        Self::losses([law.loss_rate(), window, flight, speed], lost)
    }

    /// Losses of contact by the flux through the loss point of a law that was solved for.
    pub(crate) fn flux(law: &SolvedLaw, time: f64) -> Self {
        let window = law.losses_in(time);
        let (flight, speed) = (law.mean_flight, law.mean_impact_speed);
        let lost = law.moments.contact_loss_probability;
        Self::losses([law.loss_rate, window, flight, speed], lost)
    }

    /// Losses of contact as seen in long realisations.
    pub(crate) fn seen(it: &Crossings, time: f64) -> Self {
        let (rate, window) = (Some(it.loss_rate), Some(it.losses_in(time)));
        let (flight, speed) = (happened(it.mean_flight), happened(it.mean_impact_speed));
        Self::losses([rate, window, flight, speed], Some(it.lost_share))
    }

    fn losses(numbers: [Option<Estimate>; 4], lost_share: Option<Estimate>) -> Self {
        let named = Crossings::NAMES.into_iter().zip(numbers).collect();
        Self { named, lost_share }
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
