//! Answers in the scene's unit of time: what has the dimension of a time or of its inverse.

use super::{Numbers, SpectrumNumbers};
use crate::clock::Clock;
use crate::estimate::{Estimate, Lack, Shortfall, Warning};
use crate::fokker_planck::{
    DecayRates, FirstLoss, FlightLaw, ImpactLaw, Method, Periodic, Reached, Steady, Transient,
};
use crate::monte_carlo::{EnsembleResult, FirstLossResult, RecordResult};

/// An answer in dimensionless time that can be put in another unit.
pub(crate) trait InUnit {
    /// Changes every time and every rate.
    fn put_in(&mut self, clock: &Clock);

    /// The same, with every time and every rate changed.
    fn in_unit(mut self, clock: &Clock) -> Self
    where
        Self: Sized,
    {
        self.put_in(clock);
        self
    }
}

fn times<'a>(all: impl IntoIterator<Item = &'a mut f64>, clock: &Clock) {
    for t in all {
        *t = clock.time(*t);
    }
}

fn rates<'a>(all: impl IntoIterator<Item = &'a mut Estimate>, clock: &Clock) {
    for it in all {
        *it = clock.rate(*it);
    }
}

fn spans<'a>(all: impl IntoIterator<Item = &'a mut Estimate>, clock: &Clock) {
    for it in all {
        *it = clock.span(*it);
    }
}

impl InUnit for Numbers {
    fn put_in(&mut self, clock: &Clock) {
        for (name, number) in &mut self.named {
            match super::dimension(name) {
                "1/W" => spans(number.iter_mut(), clock),
                "W" => rates(number.iter_mut(), clock),
                _ => {}
            }
        }
    }
}

impl InUnit for FlightLaw {
    fn put_in(&mut self, clock: &Clock) {
        times(&mut self.times, clock);
        rates(&mut self.density, clock);
    }
}

impl InUnit for ImpactLaw {
    fn put_in(&mut self, clock: &Clock) {
        times(&mut self.times, clock);
        rates(&mut self.density, clock);
    }
}

impl InUnit for FirstLoss {
    fn put_in(&mut self, clock: &Clock) {
        times(&mut self.times, clock);
        rates(&mut self.density, clock);
        spans([&mut self.mean_time], clock);
        rates([&mut self.rate], clock);
        self.method.put_in(clock);
    }
}

impl InUnit for Method {
    fn put_in(&mut self, clock: &Clock) {
        times([&mut self.step], clock);
        self.reason = clock.retold(&self.reason);
    }
}

impl InUnit for Transient {
    fn put_in(&mut self, clock: &Clock) {
        times(&mut self.times, clock);
        times(self.densities.iter_mut().map(|it| &mut it.t), clock);
        self.method.put_in(clock);
    }
}

impl InUnit for Reached {
    fn put_in(&mut self, clock: &Clock) {
        spans(self.t.iter_mut(), clock);
        self.method.put_in(clock);
    }
}

impl InUnit for Periodic {
    fn put_in(&mut self, clock: &Clock) {
        times(self.densities.iter_mut().map(|it| &mut it.t), clock);
        self.method.put_in(clock);
    }
}

impl InUnit for Steady {
    fn put_in(&mut self, clock: &Clock) {
        times(self.approach.iter_mut().map(|(t, _)| t), clock);
    }
}

impl InUnit for DecayRates {
    fn put_in(&mut self, clock: &Clock) {
        let rate = |x: &mut f64| {
            *x = clock.rate(Estimate::closed_form(*x)).value;
        };
        for it in &mut self.rates {
            rate(&mut it.re);
            rate(&mut it.im);
            rate(&mut it.error);
        }
        self.continuous_from.iter_mut().for_each(rate);
    }
}

impl InUnit for SpectrumNumbers {
    fn put_in(&mut self, clock: &Clock) {
        times(self.sampled.iter_mut().map(|it| &mut it.spacing), clock);
    }
}

impl InUnit for EnsembleResult {
    fn put_in(&mut self, clock: &Clock) {
        times(&mut self.times, clock);
        times([&mut self.step], clock);
    }
}

impl InUnit for FirstLossResult {
    fn put_in(&mut self, clock: &Clock) {
        times(&mut self.times, clock);
        rates(&mut self.density, clock);
        spans([&mut self.mean_time], clock);
        times([&mut self.step], clock);
    }
}

impl InUnit for RecordResult {
    fn put_in(&mut self, clock: &Clock) {
        let step = &mut self.step;
        times([&mut self.batch_length, &mut self.duration, step], clock);
        if let Some(it) = &mut self.crossings {
            times([&mut it.time], clock);
            rates([&mut it.loss_rate], clock);
            spans([&mut it.mean_flight], clock);
            times(&mut it.flight_time.edges, clock);
            rates(&mut it.flight_time.density, clock);
            times(&mut it.impacts.times, clock);
            rates(&mut it.impacts.density, clock);
        }
    }
}

impl InUnit for Warning {
    fn put_in(&mut self, clock: &Clock) {
        self.text = clock.retold(&self.text);
        for name in &mut self.unknown {
            *name = clock.retold(name);
        }
    }
}

impl InUnit for Shortfall {
    fn put_in(&mut self, clock: &Clock) {
        if let Lack::Accuracy { number, .. } = &mut self.lack {
            *number = clock.retold(number);
        }
        self.reason = clock.retold(&self.reason);
    }
}
