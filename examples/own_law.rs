//! What does a line contact do, G = (1 + 0.9 q)_+^(10/9) - 1? A contact law of your own: force and loss point are enough.
//!
//!     cargo run --release --example own_law

use vibroimpact::contact::{ContactLaw, Restoring};
use vibroimpact::fokker_planck::{Settings, transient};
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::stationary::Stationary;

#[derive(Debug)]
struct Line;

impl Restoring for Line {
    fn name(&self) -> &'static str {
        "line"
    }

    // In units of the static load, with stiffness 1 at q = 0.
    fn force(&self, q: f64) -> f64 {
        (1.0 + 0.9 * q).max(0.0).powf(10.0 / 9.0) - 1.0
    }

    fn loss_point(&self) -> Option<f64> {
        Some(-1.0 / 0.9)
    }
}

fn main() -> vibroimpact::Result<()> {
    let oscillator = Oscillator::new(ContactLaw::custom(Line)?, 0.01, 4e-3)?;
    let law = Stationary::of(&oscillator)?.moments();

    // From a Gaussian about the equilibrium to t = 40.
    let initial = Initial::gaussian([0.0, 0.0], [0.4, 0.4])?;
    let (times, settings) = ([10.0, 40.0], Settings::default());
    let course = transient(&oscillator, &initial, &times, &[], &settings, &|_| ())?;
    println!("{:<8} {:>26} {:>26}", "", "std N", "P(loss)");
    for (t, it) in course.times.iter().zip(&course.moments) {
        let lost = it.contact_loss_probability.unwrap_or_default();
        println!(
            "t = {t:<4} {:>26} {:>26}",
            it.std_force.to_string(),
            lost.to_string()
        );
    }
    let lost = law.contact_loss_probability.unwrap_or_default();
    println!(
        "{:<8} {:>26} {:>26}",
        "for ever",
        law.std_force.to_string(),
        lost.to_string()
    );
    // E[q G(q)] = T holds for every law: E[N] = 0 is its companion.
    assert!(law.mean_force.value.abs() < 1e-9);
    Ok(())
}
