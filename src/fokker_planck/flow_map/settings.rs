//! How a flow map propagates: its splitting and its step.

use super::pass::STENCIL;
use super::splitting::Splitting;
use crate::error::{Result, positive};
use crate::fokker_planck::policy::LONGEST_STEP;
use crate::oscillator::Oscillator;

/// Flow maps of one interval, at most: where friction is not the same everywhere.
const INTERVAL: usize = 7;

/// Flow maps that are held at once at most: intervals of many lengths.
const HELD: usize = 31;

/// How to propagate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Splitting in time.
    pub splitting: Splitting,
    /// Longest step tau; each interval between outputs is divided into equal steps not above it.
    pub step: f64,
    /// Bytes to hold: of flow maps as many as fit, those of one interval at the least.
    pub memory: u64,
}

impl Default for Settings {
    /// Order 8, even steps of 1.
    fn default() -> Self {
        Self {
            splitting: Splitting::EvenFive,
            step: 1.0,
            memory: u64::MAX,
        }
    }
}

impl Settings {
    /// Order 8 and even steps for an L1 error of about `tolerance` from the splitting, at any time, for
    /// a start about as wide as half the stationary law; a narrower start needs a shorter step.
    /// Measured for the linear and the Hertz law, zeta = 1e-4 to 2: below min(0.036 zeta, 6e-4) tau^5 +
    /// 0.06 zeta^2 tau^3, where small vibrations have the frequency 1; with another, time and zeta are in units of it.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid) for a tolerance that is not positive.
    pub fn to(tolerance: f64, oscillator: &Oscillator) -> Result<Self> {
        positive("accuracy.tolerance", tolerance)?;
        let (ends, second) = error_constants(oscillator);
        let step = (tolerance / ends)
            .powf(0.2)
            .min((tolerance / second).cbrt());
        Ok(Self {
            step: step.min(longest_step(oscillator)),
            ..Self::default()
        })
    }

    /// The L1 error of the splitting with these steps, as [`Settings::to`] takes it; up to
    /// [`longest_step`].
    pub(crate) fn splitting_error(&self, oscillator: &Oscillator) -> f64 {
        let (ends, second) = error_constants(oscillator);
        ends * self.step.powi(5) + second * self.step.powi(3)
    }

    /// Equal steps that an interval is cut into, none longer than allowed but by rounding.
    pub(in crate::fokker_planck) fn steps(&self, interval: f64) -> f64 {
        (interval / self.step - 1e-9).ceil().max(1.0)
    }

    /// Steps, passes over the mesh and flow maps of a run through `times`, whose intervals are cut into
    /// chunks of at most `chunk` steps.
    pub(in crate::fokker_planck) fn size(&self, times: &[f64], chunk: f64) -> [f64; 3] {
        let (mut steps, mut passes, mut now) = (0.0, 0.0, 0.0);
        let mut motions: Vec<f64> = Vec::new();
        let mut known: Vec<(f64, f64)> = Vec::new();
        for t in times {
            let duration = t - now;
            now = *t;
            if duration <= 0.0 {
                continue;
            }
            let chunks = (duration / (chunk * self.step)).ceil().max(1.0);
            let interval = duration / chunks;
            let count = self.steps(interval);
            let same = |x: f64, y: f64| (x - y).abs() <= 1e-9 * interval;
            steps += chunks * count;
            if let Some((_, each)) = known.iter().find(|(it, _)| same(*it, interval)) {
                passes += chunks * each;
                continue;
            }
            let (mut nodes, _) = self.splitting.quadrature(count as usize);
            nodes.push(count);
            let tau = interval / count;
            let mut before = 0.0;
            for node in &nodes {
                let motion = (node - before) * tau;
                before = *node;
                if !motions.iter().any(|it| same(*it, motion)) {
                    motions.push(motion);
                }
            }
            known.push((interval, nodes.len() as f64));
            passes += chunks * nodes.len() as f64;
        }
        [steps, passes, motions.len() as f64]
    }

    /// Flow maps on so many cells that are held at once, at most.
    pub(in crate::fokker_planck) fn held(&self, cells: f64) -> usize {
        let [each, rest] = Self::bytes();
        let fit = (self.memory as f64 / cells - rest) / each;
        (fit as usize).clamp(INTERVAL, HELD)
    }

    /// Bytes of a map and of everything else, per cell.
    pub(in crate::fokker_planck) fn bytes() -> [f64; 2] {
        // Values, panels, coefficients, the density and what observables and outputs copy.
        [8.0 * STENCIL as f64 + 4.0, 10.0 * 8.0]
    }
}

/// The constants of tau^5 and tau^3 in the L1 error of even steps.
fn error_constants(oscillator: &Oscillator) -> (f64, f64) {
    let fastest = oscillator.contact().fastest();
    let zeta = oscillator.zeta() / fastest;
    let ends = (0.036 * zeta).min(6e-4) * fastest.powi(5);
    (ends, 0.06 * zeta * zeta * fastest.powi(3))
}

/// The longest step that is of use, where small vibrations are fastest.
pub(in crate::fokker_planck) fn longest_step(oscillator: &Oscillator) -> f64 {
    LONGEST_STEP.get() / oscillator.contact().fastest()
}
