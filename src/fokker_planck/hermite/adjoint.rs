//! The transposed equation of a friction that depends on the displacement, and the state it is asked for.

use super::friction::null;
use super::local::times;
use super::operator::Hierarchy;
use crate::error::{Deadline, Result};
use crate::oscillator::{Oscillator, Quantity};

/// The other half of a bilinear form: where friction depends on the displacement v -> -v does not turn L into its
/// transpose, and what is watched is weighed with the law that was solved for.
pub(in crate::fokker_planck) struct Adjoint {
    /// The forward operator.
    pub(in crate::fokker_planck) operator: Hierarchy,
    /// The deviation of the quantity from its mean times the law over the weights.
    pub(in crate::fokker_planck) start: Vec<f64>,
    /// The mean of the quantity.
    pub(in crate::fokker_planck) mean: f64,
}

impl Adjoint {
    /// That of an operator; None under viscous damping.
    pub(in crate::fokker_planck) fn of(
        oscillator: &Oscillator,
        full: &Hierarchy,
        quantity: Quantity,
        late: &Deadline,
    ) -> Result<Option<Self>> {
        let Some(operator) = full.transposed() else {
            return Ok(None);
        };
        let (law, _) = null(oscillator, full, late)?;
        let (basis, k) = (&full.basis, full.pairs);
        let product = |f: &dyn Fn(f64) -> f64| {
            let mut state = times(basis, k, f, &law);
            basis.project(&mut state[..full.even()], k);
            state
        };
        let (all, mut start) = (
            product(&|_| 1.0),
            product(&|q| quantity.of(oscillator.contact(), q)),
        );
        let mass = full.constant(&all);
        let mean = full.constant(&start) / mass;
        for (x, law) in start.iter_mut().zip(all) {
            *x = (*x - mean * law) / mass;
        }
        Ok(Some(Self {
            operator,
            start,
            mean,
        }))
    }
}
