//! How long until contact is lost for the first time after the noise is switched on? The backward equation with
//! absorption, beside paths.
//!
//!     cargo run --release --example first_passage

use vibroimpact::contact::ContactLaw;
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::plan::Plan;
use vibroimpact::scene::{MonteCarlo, Outputs, Scene};

fn main() -> vibroimpact::Result<()> {
    let mut scene = Scene::new(Oscillator::new(ContactLaw::Hertz, 0.02, 6e-3)?);
    scene.initial = Initial::gaussian([0.0, 0.0], [0.2, 0.2])?;
    scene.outputs = Outputs {
        first_loss: Some(60.0),
        ..Outputs::nothing()
    };
    scene.monte_carlo = Some(MonteCarlo {
        paths: 20_000,
        ..MonteCarlo::default()
    });
    let results = Plan::of(&scene)?.run_quietly()?;
    let Some(first) = &results.first_loss else {
        return Ok(());
    };

    println!("mean time to the first loss  {}", first.mean_time);
    println!("asymptotic hazard rate       {}", first.rate);
    println!(
        "\n{:>8} {:>26} {:>26}",
        "t", "P(lost by t)", "of 20000 paths"
    );
    for k in (0..first.times.len())
        .step_by(first.times.len() / 6)
        .skip(1)
    {
        let seen = results.first_loss_paths.as_ref();
        let seen = seen
            .map(|it| 1.0 - it.survival[k].value)
            .unwrap_or_default();
        println!(
            "{:>8.2} {:>26} {seen:>26.4}",
            first.times[k],
            first.lost[k].to_string()
        );
    }
    assert!(results.agreement.is_none_or(|it| it.worst < 6.0));
    Ok(())
}
