//! Peaks of a spectrum: where, how high, how wide.

use super::curve::Spectrum;
use crate::estimate::{Estimate, Origin};
use crate::roots;

/// A peak of a spectrum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Its circular frequency.
    pub omega: Estimate,
    /// The density there.
    pub density: Estimate,
    /// Width between the frequencies to either side where the density is half of it; None where it does
    /// not fall that far before it rises again or ends.
    pub width: Option<Estimate>,
}

/// A maximum is a peak if it stands out by this factor over the higher of the valleys to either side.
const STANDS_OUT: f64 = 1.1;

impl Spectrum {
    /// The largest relative error within 0.1 of a frequency.
    fn relative_error(&self, omega: f64) -> f64 {
        let near = self.omega.iter().zip(&self.density);
        let near = near.filter(|(w, _)| (*w - omega).abs() <= 0.1);
        near.map(|(_, it)| it.error / it.value.abs().max(f64::MIN_POSITIVE))
            .fold(0.0, f64::max)
    }

    /// The peaks within the range, the highest first.
    pub fn peaks(&self) -> Vec<Peak> {
        let value = |k: usize| self.density[k].value;
        let n = self.omega.len();
        let mut peaks = Vec::new();
        for k in 1..n.saturating_sub(1) {
            if value(k) <= value(k - 1) || value(k) < value(k + 1) {
                continue;
            }
            // The lowest point before something higher, to either side.
            let valley = |range: &mut dyn Iterator<Item = usize>| {
                range
                    .map(value)
                    .take_while(|v| *v <= value(k))
                    .fold(value(k), f64::min)
            };
            let saddle = valley(&mut (0..k).rev()).max(valley(&mut (k + 1..n)));
            if value(k) > STANDS_OUT * saddle {
                peaks.push(self.peak(k));
            }
        }
        peaks.sort_by(|a, b| b.density.value.total_cmp(&a.density.value));
        peaks
    }

    /// The peak at the maximum `k` of the samples.
    fn peak(&self, k: usize) -> Peak {
        let ln = |omega: f64| self.at(omega).max(f64::MIN_POSITIVE).ln();
        let (low, high) = (self.omega[k - 1], self.omega[k + 1]);
        let found = roots::golden(&|omega| Ok(-ln(omega)), low, high, 1e-8 * high);
        let omega = found.unwrap_or(self.omega[k]);
        let density = self.at(omega);
        let half = |step: &dyn Fn(usize) -> Option<usize>| -> Option<f64> {
            let (mut at, mut inner) = (k, omega);
            loop {
                at = step(at)?;
                let outer = self.omega[at];
                if self.density[at].value > density {
                    return None;
                }
                if self.density[at].value < 0.5 * density {
                    let below = |omega: f64| self.at(omega) <= 0.5 * density;
                    return Some(roots::bisect(inner, outer, below));
                }
                inner = outer;
            }
        };
        let below = half(&|at| at.checked_sub(1));
        let above = half(&|at| Some(at + 1).filter(|at| *at < self.omega.len()));
        let share = self.relative_error(omega);
        let width = below.zip(above).map(|(below, above)| above - below);
        // Errors of the density move a maximum by their slope over its curvature: at most by about the
        // width times their share.
        let moved = width.unwrap_or(omega) * share + 1e-8 * omega;
        let estimate = |value: f64, error: f64| Estimate::new(value, error, Origin::Space);
        Peak {
            omega: estimate(omega, moved),
            density: estimate(density, density * share),
            width: width.map(|width| estimate(width, 2.0 * moved)),
        }
    }

    /// The highest peak beyond one and a half times the frequency of the highest of all, over it: how
    /// strong the second harmonic is, as a ratio of densities.
    pub fn harmonic_ratio(&self) -> Option<Estimate> {
        let peaks = self.peaks();
        let main = peaks.first()?;
        let second = peaks
            .iter()
            .find(|it| it.omega.value > 1.5 * main.omega.value)?;
        let ratio = second.density.value / main.density.value;
        let share = |it: &Peak| it.density.error / it.density.value;
        let error = ratio * (share(main) + share(second));
        Some(Estimate::new(ratio, error, Origin::Space))
    }
}
