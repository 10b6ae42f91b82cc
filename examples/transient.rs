//! How does the motion grow when the noise is switched on at rest? Moments and densities of the Fokker-Planck equation,
//! with a picture.
//!
//!     cargo run --release --example transient

use std::path::Path;
use vibroimpact::contact::ContactLaw;
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::plan::Plan;
use vibroimpact::report;
use vibroimpact::scene::{Outputs, Scene, Times};

fn main() -> vibroimpact::Result<()> {
    let mut scene = Scene::new(Oscillator::new(ContactLaw::Hertz, 0.02, 8e-3)?);
    scene.initial = Initial::Rest;
    let times = Times::Every {
        every: 2.0,
        until: 60.0,
    };
    scene.outputs = Outputs {
        stationary: true,
        moments_at: times,
        density_at: Times::List(vec![10.0, 60.0]),
        ..Outputs::nothing()
    };
    let results = Plan::of(&scene)?.run_quietly()?;

    let stationary = results
        .stationary
        .as_ref()
        .and_then(|it| it.get("mean_energy"));
    let course = results.transient.as_ref().map_or(&[][..], |it| &it.times);
    for (k, t) in course.iter().enumerate().step_by(5) {
        let energy = results
            .transient
            .as_ref()
            .map(|it| it.moments[k].mean_energy);
        println!("t = {t:>4}: E[H] = {}", energy.unwrap_or_default());
    }
    println!("stationary: {}", stationary.unwrap_or_default());

    // Every file that the program would write, as bytes: here the picture of the two densities.
    let files = report::all(&results)?;
    let picture = files.iter().filter(|it| it.name == "snapshots.svg");
    report::folder::write(Path::new("."), &picture.cloned().collect::<Vec<_>>())?;
    println!("snapshots.svg: p(q, v) at t = 10 and 60");
    Ok(())
}
