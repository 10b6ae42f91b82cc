//! Where is the peak of the force spectrum, and what does Welch's method make of it? The spectrum from the resolvent of
//! the Fokker-Planck operator has no sampling noise; the estimate from simulated time series has noise and bias.
//!
//!     cargo run --release --example spectrum

use vibroimpact::contact::ContactLaw;
use vibroimpact::oscillator::{Oscillator, Quantity};
use vibroimpact::plan::Plan;
use vibroimpact::scene::{MonteCarlo, Outputs, Scene, SpectrumRequest};

fn main() -> vibroimpact::Result<()> {
    let mut scene = Scene::new(Oscillator::new(ContactLaw::Hertz, 0.02, 2e-3)?);
    scene.outputs = Outputs {
        spectrum: Some(SpectrumRequest {
            until: 4.0,
            quantity: Quantity::Force,
        }),
        ..Outputs::nothing()
    };
    scene.monte_carlo = Some(MonteCarlo::default());
    let results = Plan::of(&scene)?.run_quietly()?;
    let Some(spectrum) = results.spectrum else {
        return Ok(());
    };

    for peak in &spectrum.peaks {
        println!("peak at omega = {}, G = {}", peak.omega, peak.density);
    }
    if let Some(welch) = &spectrum.sampled {
        println!(
            "\n{:>7} {:>12} {:>12} {:>12}",
            "omega", "G", "Welch", "its mean"
        );
        let omega = spectrum.solved.omega.iter().enumerate();
        for (k, omega) in omega.step_by(120) {
            let (exact, seen) = (spectrum.solved.density[k], welch.density[k]);
            let expected = welch.expectation[k];
            println!(
                "{omega:>7.3} {:>12.4e} {:>12.4e} {expected:>12.4e}",
                exact.value, seen.value
            );
        }
    }
    // Both tell the same once the bias of Welch's method is in the expectation.
    assert!(results.agreement.is_none_or(|it| it.worst < 6.0));
    Ok(())
}
