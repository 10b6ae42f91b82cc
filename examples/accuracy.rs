//! What does accuracy cost? The same transient at three tolerances: what was asked for, what the error estimate says, what
//! the error is against the finest of them, and the time.
//!
//!     cargo run --release --example accuracy

use std::time::Instant;
use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::{Settings, transient};
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::Oscillator;

fn main() -> vibroimpact::Result<()> {
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.02, 8e-3)?;
    let initial = Initial::gaussian([0.5, 0.0], [0.4, 0.4])?;
    let solve = |tolerance: f64| {
        let settings = Settings {
            tolerance,
            ..Settings::default()
        };
        let start = Instant::now();
        let it = transient(&oscillator, &initial, &[20.0], &[], &settings, &|_| ())?;
        Ok::<_, vibroimpact::Error>((it, start.elapsed().as_secs_f64()))
    };
    let (reference, _) = solve(1e-6)?;
    let exact = reference.moments[0].mean_energy;
    println!(
        "{:>10} {:>12} {:>14} {:>12} {:>9}",
        "tolerance", "cells", "estimate", "error", "time"
    );
    for tolerance in [1e-2, 1e-3, 1e-4] {
        let (it, seconds) = solve(tolerance)?;
        let energy = it.moments[0].mean_energy;
        let error = (energy.value - exact.value).abs();
        let [q, v] = it.method.cells;
        let cells = format!("{q} x {v}");
        println!(
            "{tolerance:>10.0e} {cells:>12} {:>14.1e} {error:>12.1e} {:>7.0} ms",
            energy.error,
            1e3 * seconds
        );
        // The estimate is meant to hold, and to be what was asked for: T is the normalisation of an energy.
        assert!(error <= energy.error + exact.error);
        assert!(energy.error <= tolerance * oscillator.temperature());
    }
    Ok(())
}
