//! The scheme and the step of a path, where a scene leaves them open.

use super::paths;
use super::scheme::{self, Scheme};
use super::settings::{EnsembleSettings, MOST_COSINES, Noise};
use crate::error::{Error, Result, positive};
use crate::initial::Initial;
use crate::oscillator::Oscillator;

/// The scheme and the longest step that [`run`](super::run()) would use.
///
/// # Errors
/// [`Error::Invalid`] for a step that is not positive, or a scheme that does not suit the noise.
pub fn scheme_and_step(
    oscillator: &Oscillator,
    initial: &Initial,
    settings: &EnsembleSettings,
) -> Result<(Scheme, f64)> {
    let frequency = paths::highest_frequency(oscillator, initial);
    let EnsembleSettings {
        scheme,
        noise,
        step,
        ..
    } = *settings;
    choose((scheme, step), noise, oscillator, frequency)
}

/// The scheme meant and its longest step, that of the settings or its own; `frequency` is the highest of
/// the scene.
pub(super) fn choose(
    (scheme, step): (Scheme, Option<f64>),
    noise: Noise,
    oscillator: &Oscillator,
    frequency: f64,
) -> Result<(Scheme, f64)> {
    let scheme = resolve(scheme, noise, oscillator.zeta(), frequency)?;
    let step = match step {
        Some(step) => positive("monte_carlo.step", step)?,
        None => scheme::automatic_step(scheme, oscillator, frequency),
    };
    Ok((scheme, step))
}

/// The scheme meant, if it suits the noise; `frequency` is the highest of the scene.
pub(super) fn resolve(scheme: Scheme, noise: Noise, zeta: f64, frequency: f64) -> Result<Scheme> {
    let (count, band) = match noise {
        Noise::White => {
            return Ok(match scheme {
                Scheme::Auto if zeta > 2.0 * frequency.max(1.0) => Scheme::ExponentialHeun,
                Scheme::Auto => Scheme::Splitting42,
                scheme => scheme,
            });
        }
        Noise::Cosines { count, band } => (count, band),
        Noise::Band { band } => (1, band),
    };
    positive("monte_carlo.noise.band", band)?;
    if !(1..=MOST_COSINES).contains(&count) {
        let accepted = format!("1 to {MOST_COSINES}");
        return Err(Error::invalid("monte_carlo.noise.cosines", count, accepted));
    }
    if !matches!(scheme, Scheme::Auto | Scheme::CentralDifference) {
        let accepted = "\"central_difference\" or \"auto\" with band-limited noise";
        return Err(Error::invalid(
            "monte_carlo.scheme",
            format!("\"{scheme}\""),
            accepted,
        ));
    }
    Ok(Scheme::CentralDifference)
}
