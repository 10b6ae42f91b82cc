//! The normalisation of every number: what a relative tolerance is relative to.

use crate::moments::{Moment, Moments, PerMoment};
use crate::oscillator::Oscillator;

/// Normalisations: the stationary deviation for q and N, sqrt(T) for v, variances for variances, T for
/// the energy, 1 for probabilities, the larger of 1 and their value for skewness and kurtosis. Where the stationary law has no closed
/// form, those of exp(-H/T)/Z with the T = E\[v^2\] of the law averaged over orbits; without a stationary law, those of the deviations
/// at that time, or the value itself where that is larger.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scales {
    known: Option<PerMoment<f64>>,
}

impl Scales {
    /// The scales of an oscillator.
    pub fn of(oscillator: &Oscillator) -> Self {
        let t = oscillator.kinetic_temperature();
        let law = if oscillator.is_viscous() {
            oscillator.displacement_law()
        } else {
            oscillator.of_temperature(t).displacement_law()
        };
        let known = law.ok().map(|law| {
            let [_, q] = law.spread(|q| q);
            let square = law.expect(|q| oscillator.contact().force(q).powi(2));
            let force = square.value.sqrt();
            deviations([q, t.sqrt(), force])
        });
        Self { known }
    }

    /// Those of the moments of a stationary law.
    pub(crate) fn of_law(moments: &Moments) -> Self {
        let [q, v, force] = [Moment::VarQ, Moment::VarV, Moment::StdForce].map(|it| {
            let number = moments.get(it);
            number.map_or(1.0, |number| number.value.abs())
        });
        let known = Some(deviations([q.sqrt(), v.sqrt(), force]));
        Self { known }
    }

    /// The scale of each moment.
    pub fn each(&self, moments: &Moments) -> PerMoment<f64> {
        let mut scales = self.known.unwrap_or_else(|| {
            // Also where nobody asked for these.
            let [q, v] = [moments.var_q, moments.var_v].map(|it| it.value.sqrt());
            let of_deviations = deviations([q, v, moments.std_force.value]);
            let value = |it| moments.get(it).map(|number| number.value.abs());
            Moment::ALL.map(|it| match (it, value(it)) {
                (Moment::ContactLossProbability, _) | (_, None) => 1.0,
                (_, Some(own)) => own.max(of_deviations[it as usize]),
            })
        });
        for it in Moment::ALL.into_iter().filter(|it| it.is_standardised()) {
            let size = moments.get(it).map_or(1.0, |number| number.value.abs());
            scales[it as usize] = size.max(1.0);
        }
        scales
    }
}

/// The scales that follow from the deviations of q, v and the force.
fn deviations([q, v, force]: [f64; 3]) -> PerMoment<f64> {
    Moment::ALL.map(|it| match it {
        Moment::MeanQ => q,
        Moment::VarQ => q * q,
        Moment::MeanV => v,
        Moment::VarV | Moment::MeanEnergy => v * v,
        Moment::CovQv => q * v,
        Moment::MeanForce | Moment::StdForce => force,
        Moment::SkewnessForce | Moment::KurtosisForce | Moment::ContactLossProbability => 1.0,
    })
}
