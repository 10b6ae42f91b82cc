//! What does this mean for my rig: 60 N on a contact of 3.5 um at 410 Hz, 0.8 % of damping, 0.02 N^2/Hz? Newtons, hertz and
//! seconds in, newtons, hertz and seconds out.
//!
//!     cargo run --release --example rig

use vibroimpact::clock::TimeUnit;
use vibroimpact::contact::ContactLaw;
use vibroimpact::moments::Moment;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::plan::Plan;
use vibroimpact::rig::Rig;
use vibroimpact::scene::{Outputs, ReachRequest, Scene};

fn main() -> vibroimpact::Result<()> {
    let rig = Rig::new(60.0, 410.0, 3.5e-6)?;
    let h = rig.level_from_force_psd(0.02);
    println!("moving mass {:.3} kg, h = {h:.4e}", rig.mass());

    let mut scene = Scene::new(Oscillator::new(ContactLaw::Hertz, 0.008, h)?);
    scene.rig = Some(rig);
    scene.outputs = Outputs {
        stationary: true,
        // Losses of contact in ten seconds.
        crossings: Some(10.0),
        // When, after the shaker is switched on, the energy has come to 90 %.
        reach: Some(ReachRequest {
            quantity: Moment::MeanEnergy,
            fraction: 0.9,
        }),
        time_unit: Some(TimeUnit::Second),
        ..Outputs::nothing()
    };
    let results = Plan::of(&scene)?.run_quietly()?;
    for (name, number) in results.physical(&rig) {
        println!("{name:<28} {number}");
    }
    let t = results.reach.and_then(|it| it.t).unwrap_or_default();
    // Energy relaxes within some 1/(2 zeta Omega) = 24 ms.
    assert!(t.value > 0.02 && t.value < 0.2 && t.error < 1e-3 * t.value);
    Ok(())
}
