//! At which input level does contact loss begin, and how fast is the motion forgotten there? A sweep over h.
//!
//!     cargo run --release --example sweep

use vibroimpact::contact::ContactLaw;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::plan::Plan;
use vibroimpact::scene::{Outputs, Scene};

fn main() -> vibroimpact::Result<()> {
    println!(
        "{:>8} {:>12} {:>10} {:>22}",
        "h", "P(loss)", "std N", "slowest eigenvalue"
    );
    let mut before = 0.0;
    for k in 0..=6 {
        let h = 1e-4 * 10f64.powf(f64::from(k) / 3.0);
        let mut scene = Scene::new(Oscillator::new(ContactLaw::Hertz, 0.02, h)?);
        scene.outputs = Outputs {
            stationary: true,
            decay_rates: 1,
            ..Outputs::nothing()
        };
        // A plan can be looked at before anything is computed.
        let plan = Plan::of(&scene)?;
        let results = plan.run_quietly()?;
        let of = |name| results.stationary.as_ref().and_then(|it| it.get(name));
        let lost = of("contact_loss_probability").map_or(0.0, |it| it.value);
        let deviation = of("std_force").map_or(0.0, |it| it.value);
        let slowest = results.decay_rates.as_ref().and_then(|it| it.rates.first());
        let slowest = slowest.map_or("-".into(), |it| format!("{it} (error {:.0e})", it.error));
        println!("{h:>8.1e} {lost:>12.4e} {deviation:>10.5} {slowest:>22}");
        // More noise never means less loss of contact.
        assert!(lost > before);
        before = lost;
    }
    Ok(())
}
