//! The Gibbs law of the displacement.

use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use crate::estimate::{Estimate, Origin};
use crate::quadrature;

/// The law p_q(q) = exp(-(U(q) - U_min)/T)/Z of (22), normalised by adaptive quadrature.
#[derive(Debug, Clone)]
pub struct DisplacementLaw {
    contact: ContactLaw,
    temperature: f64,
    lowest: f64,
    /// Ends of the panels: kinks, equilibria, and levels of U up to 80 T (e^-80 = 2e-35).
    breaks: Vec<f64>,
    normaliser: Estimate,
}

/// Places between two ends, neither of these among them.
fn within(places: impl IntoIterator<Item = f64>, low: f64, high: f64) -> impl Iterator<Item = f64> {
    let places = places.into_iter();
    places.filter(move |q| *q > low && *q < high)
}

impl DisplacementLaw {
    /// Target of every quadrature, relative to the integral of the absolute value.
    const RELATIVE: f64 = 1e-14;

    pub(super) fn new(contact: ContactLaw, temperature: f64) -> Result<Self> {
        let (Some(q0), Some(lowest)) = (contact.equilibrium(), contact.lowest_potential()) else {
            return Err(Error::NoStationaryLaw {
                what: "the stationary density".into(),
                contact: contact.name().into(),
                why: "exp(-U/T) cannot be normalised".into(),
            });
        };
        let mut breaks = contact.equilibria();
        let several = breaks.len() > 1;
        for level in [0.1, 1.0, 4.0, 10.0, 20.0, 40.0, 80.0] {
            let turning = contact.turning_points(level * temperature);
            let (left, right) = turning.unwrap_or((q0, q0));
            breaks.extend([left, right]);
            if several {
                breaks.extend(contact.wells(level * temperature).concat());
            }
        }
        breaks.sort_by(f64::total_cmp);
        // Far wells may hold the equilibria of no probability.
        if let Some((left, right)) = contact.turning_points(80.0 * temperature) {
            breaks.retain(|q| *q >= left && *q <= right);
            breaks.extend(within(contact.kinks(), left, right));
            breaks.sort_by(f64::total_cmp);
        }
        breaks.dedup();
        let mut law = Self {
            contact,
            temperature,
            lowest,
            breaks,
            normaliser: Estimate::default(),
        };
        let weight = |q: f64| (-law.level(q)).exp();
        #[cfg(test)]
        tests::NORMALISED.with(|count| count.set(count.get() + 1));
        law.normaliser = quadrature::integrate(weight, &law.breaks, Self::RELATIVE);
        if !(law.normaliser.value.is_finite() && law.normaliser.value > 0.0) {
            let accepted = "a T within reach of a double";
            return Err(Error::invalid("temperature", temperature, accepted));
        }
        Ok(law)
    }

    /// (U(q) - U_min)/T.
    pub(crate) fn level(&self, q: f64) -> f64 {
        (self.contact.potential(q) - self.lowest) / self.temperature
    }

    /// ln p_q(q); finite wherever U is, also where the density underflows.
    pub fn ln_density(&self, q: f64) -> f64 {
        -self.level(q) - self.normaliser.value.ln()
    }

    /// p_q(q).
    pub fn density(&self, q: f64) -> f64 {
        self.ln_density(q).exp()
    }

    /// Relative error of the normaliser, and so of every density.
    pub(crate) fn relative_error(&self) -> f64 {
        self.normaliser.error / self.normaliser.value
    }

    /// E\[f(q)\], error included. `f` must be smooth away from the kink of the contact law.
    pub fn expect(&self, f: impl Fn(f64) -> f64) -> Estimate {
        self.expect_to(Self::RELATIVE, f)
    }

    /// Mean and deviation of f(q).
    pub(crate) fn spread(&self, f: impl Fn(f64) -> f64) -> [f64; 2] {
        let mean = self.expect(&f).value;
        let variance = self.expect(|q| (f(q) - mean).powi(2)).value;
        [mean, variance.sqrt()]
    }

    /// As [`DisplacementLaw::expect`], to an error `relative` to E\[|f|\]: for an `f` that is not smooth.
    pub(crate) fn expect_to(&self, relative: f64, f: impl Fn(f64) -> f64) -> Estimate {
        let weighted = |q: f64| f(q) * (-self.level(q)).exp();
        let integral = quadrature::integrate(weighted, &self.breaks, relative);
        let z = self.normaliser.value;
        let value = integral.value / z;
        let error = integral.error / z + value.abs() * self.relative_error();
        Estimate::new(value, error, Origin::Quadrature)
    }

    /// P(a < q < b), accurate relative to itself also where it is tiny; split at the kinks.
    pub fn probability(&self, a: f64, b: f64) -> f64 {
        let mut breaks = vec![a];
        breaks.extend(within(self.contact.kinks(), a, b));
        breaks.push(b);
        let mass = quadrature::integrate(|q| (-self.level(q)).exp(), &breaks, Self::RELATIVE);
        mass.value / self.normaliser.value
    }

    /// ln P(q < a): the tail below `a`, also where it underflows. In flight without end the force is constant,
    /// so the tail below the loss point is T p_q/|G|; elsewhere it is integrated.
    pub(crate) fn ln_tail_below(&self, a: f64) -> Estimate {
        let endless = |[low, high]: [f64; 2]| low == f64::NEG_INFINITY && a <= high;
        if self.contact.flight().is_some_and(endless) {
            let value = self.ln_density(a) + (self.temperature / -self.contact.force(a)).ln();
            let rounding = 4.0 * f64::EPSILON * (value.abs() + self.level(a));
            return Estimate::new(value, rounding + self.relative_error(), Origin::Quadrature);
        }
        self.ln_between(f64::NEG_INFINITY, a)
    }

    /// ln P(a < q < b), also where it underflows: integrated over the largest density there.
    pub(crate) fn ln_between(&self, a: f64, b: f64) -> Estimate {
        // U is monotone between its extrema: the density is largest at one of them or at an end.
        let inside = self.contact.equilibria().into_iter();
        let inside = inside.filter(|q| *q > a && *q < b);
        let ends = [a, b].into_iter().filter(|q| q.is_finite());
        let highest = inside.chain(ends).map(|q| self.level(q));
        let base = highest.fold(f64::INFINITY, f64::min);
        // What is 80 T higher has e^-80 of it.
        let reach = (base + 80.0) * self.temperature;
        let (left, right) = self.contact.turning_points(reach).unwrap_or((a, b));
        let (low, high) = (left.max(a).min(b), right.min(b).max(left.max(a).min(b)));
        let mut breaks = vec![low, high];
        breaks.extend(within(self.breaks.iter().copied(), low, high));
        breaks.sort_by(f64::total_cmp);
        let scaled = |q: f64| (base - self.level(q)).exp();
        let scaled = quadrature::integrate(scaled, &breaks, Self::RELATIVE);
        let value = scaled.value.ln() - base - self.normaliser.value.ln();
        let error = scaled.error / scaled.value + self.relative_error();
        Estimate::new(value, error + 4.0 * f64::EPSILON * base, Origin::Quadrature)
    }

    /// The contact law.
    pub(crate) fn contact(&self) -> &ContactLaw {
        &self.contact
    }

    /// T.
    pub(crate) fn temperature(&self) -> f64 {
        self.temperature
    }

    /// Ends of panels between which the density is monotone and smooth; outside of all of them it has e^-80.
    pub(crate) fn panels(&self) -> &[f64] {
        &self.breaks
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use crate::contact::ContactLaw;
    use crate::oscillator::Oscillator;
    use std::cell::Cell;

    thread_local! {
        /// Stationary laws normalised on this thread.
        pub(crate) static NORMALISED: Cell<usize> = const { Cell::new(0) };
    }

    #[test]
    fn the_tail_is_the_integral_of_the_density() {
        let law = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
        let law = law.displacement_law().unwrap();
        let below = law.ln_tail_below(0.4).value.exp();
        let sum = law.ln_tail_below(-1.5).value.exp() + law.probability(-1.5, 0.4);
        assert!((below - sum).abs() < 1e-13, "{below} {sum}");
        assert!((law.expect(|_| 1.0).value - 1.0).abs() < 1e-15);
    }
}
