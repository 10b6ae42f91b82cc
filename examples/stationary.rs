//! How often is contact lost in stationary motion, and how hard does the force swing? The closed form, (21)-(30).
//!
//!     cargo run --release --example stationary

use vibroimpact::contact::ContactLaw;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::stationary::Stationary;

fn main() -> vibroimpact::Result<()> {
    // Damping ratio 0.5 %, two-sided input level h = 2e-3.
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3)?;
    let law = Stationary::of(&oscillator)?;

    println!("T = pi h/(2 zeta)        {:.6}", oscillator.temperature());
    for (name, number) in law.moments().named() {
        if let Some(number) = number {
            println!("{name:<24} {number}");
        }
    }
    // Down-crossings of the loss point per 1/Omega, by Rice's formula, and the mean time out of contact.
    if let (Some(rate), Some(flight)) = (law.loss_rate(), law.mean_flight()) {
        println!("{:<24} {rate}", "loss rate");
        println!("{:<24} {flight}", "mean flight");
        let lost = law.contact_loss_probability().map_or(0.0, |it| it.value);
        assert!((rate.value * flight.value - lost).abs() < 1e-12);
    }
    // A density at a point: here of the contact force at rest, N = 0.
    println!("{:<24} {:.6}", "p_N(0)", law.density_force(0.0));
    Ok(())
}
