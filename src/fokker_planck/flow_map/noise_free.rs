//! Single motions without noise by the steps of a flow map: what its splitting does to viscous friction, without a mesh.

use super::settings::Settings;
use super::splitting::lead;
use crate::fokker_planck::trajectory::Motion;
use crate::oscillator::Oscillator;

impl Settings {
    /// Carries states (q, v) over an interval between outputs as a flow map carries a density, in `finer` times as many steps.
    pub(in crate::fokker_planck) fn carry(
        &self,
        oscillator: &Oscillator,
        states: &mut Vec<[f64; 2]>,
        (interval, finer): (f64, f64),
    ) {
        let steps = finer * self.steps(interval);
        let tau = interval / steps;
        let (nodes, weights) = self.splitting.quadrature(steps as usize);
        let ahead = lead(&nodes, &weights, steps, oscillator.zeta() * tau);
        let motion = Motion::new(oscillator.contact());
        let mut ends = states.clone();
        let mut before = 0.0;
        for (node, weight) in nodes.iter().zip(weights).chain([(&steps, 0.0)]) {
            motion.after(states, &[(node - before) * tau * (1.0 + ahead)], &mut ends);
            std::mem::swap(states, &mut ends);
            before = *node;
            let kept = (-2.0 * oscillator.zeta() * weight * tau).exp();
            for state in states.iter_mut() {
                state[1] *= kept;
            }
        }
    }
}
