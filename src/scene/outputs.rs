//! What a scene asks for.

use super::times::Times;
use crate::clock::TimeUnit;
use crate::format::{num, rounded};
use crate::moments::Moment;
use crate::oscillator::{Quantity, Side};

/// What is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Outputs {
    /// The closed form (21)-(30).
    pub stationary: bool,
    /// Transient moments at these times.
    pub moments_at: Times,
    /// Only these of the moments, in the results and for the tolerance; None for all of them.
    pub moments: Option<Vec<Moment>>,
    /// p(q, v) at these times.
    pub density_at: Times,
    /// L p = 0 on the mesh.
    pub steady: bool,
    /// How many of the slowest eigenvalues of L.
    pub decay_rates: usize,
    /// One-sided spectrum.
    pub spectrum: Option<SpectrumRequest>,
    /// Survival until the first loss of contact, up to this time.
    pub first_loss: Option<f64>,
    /// Survival until the first passage of a level of q.
    pub first_passage: Option<PassageRequest>,
    /// Losses of contact in a window of this length: in the unit of time, and without one in seconds with a rig, else in
    /// dimensionless time.
    pub crossings: Option<f64>,
    /// The first time at which a moment of the transient is a fraction of its stationary value.
    pub reach: Option<ReachRequest>,
    /// The unit of every time of the scene and of its results; None is dimensionless time.
    pub time_unit: Option<TimeUnit>,
    /// The periodic law under the drive, at so many phases.
    pub periodic: Option<usize>,
    /// The periodic law over the frequency of the drive.
    pub response: Option<ResponseRequest>,
}

impl Default for Outputs {
    /// The stationary law alone.
    fn default() -> Self {
        Self {
            stationary: true,
            ..Self::nothing()
        }
    }
}

/// The names of some moments.
pub(super) fn names(moments: &[Moment]) -> Vec<&'static str> {
    moments.iter().map(|it| it.name()).collect()
}

impl Outputs {
    /// Nothing at all, to start from.
    pub fn nothing() -> Self {
        Self {
            stationary: false,
            moments_at: Times::none(),
            moments: None,
            density_at: Times::none(),
            steady: false,
            decay_rates: 0,
            spectrum: None,
            first_loss: None,
            first_passage: None,
            crossings: None,
            reach: None,
            time_unit: None,
            periodic: None,
            response: None,
        }
    }

    /// The outputs that need a law that does not change, as keys with what stands under them.
    pub(super) fn stationary_questions(&self) -> impl Iterator<Item = (&'static str, String)> {
        let reach = self.reach.map(|it| it.quantity.name());
        let rates = Some(self.decay_rates).filter(|count| *count > 0);
        let window = |it: f64| format!("{{ window = {} }}", num(it));
        let until = |it: SpectrumRequest| format!("{{ until = {} }}", num(it.until));
        let all = [
            ("outputs.steady", self.steady.then(|| "true".to_owned())),
            ("outputs.decay_rates", rates.map(|it| it.to_string())),
            ("outputs.spectrum", self.spectrum.map(until)),
            ("outputs.crossings", self.crossings.map(window)),
            (
                "outputs.reach",
                reach.map(|it| format!("{{ quantity = {it:?} }}")),
            ),
        ];
        let asked = |(key, value)| Some((key, value?));
        all.into_iter().filter_map(asked)
    }
}

/// A one-sided spectrum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectrumRequest {
    /// Up to this circular frequency.
    pub until: f64,
    /// Of the force or of the displacement.
    pub quantity: Quantity,
}

/// The first time at which a moment reaches a part of its stationary value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReachRequest {
    /// The moment.
    pub quantity: Moment,
    /// The part.
    pub fraction: f64,
}

/// A response curve: the periodic law at equally spaced frequencies of the drive.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ResponseRequest {
    /// The lowest circular frequency.
    pub from: f64,
    /// The highest.
    pub to: f64,
    /// How many, both ends included.
    pub points: usize,
}

impl ResponseRequest {
    /// Most points accepted.
    pub(super) const MOST: usize = 500;

    /// The frequencies.
    pub fn frequencies(&self) -> Vec<f64> {
        let step = (self.to - self.from) / (self.points.max(2) - 1) as f64;
        let at = |k: usize| rounded(self.from + step * k as f64, 13);
        (0..self.points).map(at).collect()
    }
}

/// A first passage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassageRequest {
    /// The level of q.
    pub level: f64,
    /// Below it, above it, or either of it and its negative.
    pub side: Side,
    /// Up to this time.
    pub until: f64,
}
