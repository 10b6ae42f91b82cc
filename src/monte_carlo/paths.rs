//! Paths at their starts, each drawn from its own stream.

use super::displacement::DisplacementSampler;
use super::noise::{self, LANES, Purpose, Streams};
use super::scheme::Group;
use super::signal::{Band, Cosines, Signal};
use super::walk::Walk;
use super::{Noise, Scheme};
use crate::error::Result;
use crate::excitation::Excitation;
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::sync::Arc;

/// Where path k of a seed starts and what drives it.
pub(super) struct Paths {
    seed: u64,
    initial: Initial,
    sampler: Option<DisplacementSampler>,
    noise: Noise,
    /// What there is beside stationary noise.
    excitation: Option<Arc<Excitation>>,
    level: f64,
    step: f64,
    /// The scheme takes the excitation at t = 0 too.
    whole_steps: bool,
    /// Starts below or above these are drawn again.
    range: [f64; 2],
}

impl Paths {
    pub(super) fn new(oscillator: &Oscillator, initial: &Initial, walk: &Walk) -> Result<Self> {
        let sampler = match initial {
            Initial::Stationary => Some(DisplacementSampler::of(&oscillator.displacement_law()?)),
            _ => None,
        };
        Ok(Self {
            seed: walk.seed,
            initial: *initial,
            sampler,
            noise: walk.noise,
            excitation: (!walk.excitation.is_plain()).then(|| Arc::new(walk.excitation.clone())),
            level: oscillator.h(),
            step: walk.step,
            whole_steps: walk.scheme == Scheme::CentralDifference,
            range: [f64::NEG_INFINITY, f64::INFINITY],
        })
    }

    /// The same paths, a stationary start taken given that q lies within `range`.
    pub(super) fn given_within(mut self, range: [f64; 2]) -> Self {
        self.range = range;
        self
    }

    /// Paths `first` to `first + LANES - 1`.
    pub(super) fn group(&self, first: u64) -> Group {
        let mut it = Group {
            q: [0.0; LANES],
            v: [0.0; LANES],
            excitation: [0.0; LANES],
            streams: Streams::new(self.seed, first),
            signal: None,
            push: self.excitation.clone(),
        };
        for lane in 0..LANES {
            (it.q[lane], it.v[lane]) = self.start(first.wrapping_add(lane as u64));
        }
        match self.noise {
            Noise::White if self.whole_steps => {
                it.streams.normals(&mut it.excitation, &mut [0.0; LANES]);
            }
            Noise::White => {}
            Noise::Cosines { count, band } => {
                let cosines = Cosines::new(self.seed, first, count, band, self.level);
                it.signal = Some(Signal::Cosines(Box::new(cosines)));
            }
            Noise::Band { band } => {
                let band = Band::new(self.seed, first, band, self.level, self.step);
                it.signal = Some(Signal::Band(Box::new(band)));
            }
        }
        it
    }

    fn start(&self, path: u64) -> (f64, f64) {
        let bytes = noise::seed_bytes(self.seed, path, Purpose::Start);
        let mut rng = Xoshiro256PlusPlus::from_seed(bytes);
        match (self.initial, &self.sampler) {
            (Initial::Gaussian { mean, deviation }, _) => {
                let [q, v] = [0, 1].map(|k| {
                    let normal: f64 = StandardNormal.sample(&mut rng);
                    mean[k] + deviation[k] * normal
                });
                (q, v)
            }
            (_, Some(sampler)) => loop {
                let (q, v) = sampler.sample_state(&mut rng);
                if q >= self.range[0] && q <= self.range[1] {
                    break (q, v);
                }
            },
            _ => (0.0, 0.0),
        }
    }
}
