//! Time against tolerance: scene A (Hertz, h = 2e-3, zeta = 0.005, start N((1, 0), 0.4^2), t = 5, 10, 20)
//! from 1e-2 to 1e-6. `cargo bench --bench tolerance`; seconds are the least of three runs.

use std::io::Write;
use std::time::Instant;
use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::{Settings, transient};
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::scales::Scales;

fn main() {
    let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).expect("the paper's level");
    let start = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).expect("deviations above 0");
    let scales = Scales::of(&oscillator);
    let mut out = std::io::stdout().lock();
    let mut line = |text: String| {
        let _ = writeln!(out, "{text}");
        let _ = out.flush();
    };
    line("tolerance  largest bar    seconds        cells  steps  method".into());
    for tolerance in [1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
        let settings = Settings {
            tolerance,
            max_seconds: 120.0,
            ..Settings::default()
        };
        let mut least = f64::INFINITY;
        let mut answer = None;
        // Long runs need no second look.
        for _ in 0..3 {
            let began = Instant::now();
            let times = [5.0, 10.0, 20.0];
            let it = transient(&oscillator, &start, &times, &[], &settings, &|_| ());
            answer = Some(it.expect("a scene that can be solved"));
            least = least.min(began.elapsed().as_secs_f64());
            if least > 3.0 {
                break;
            }
        }
        let Some(it) = answer else { continue };
        let bars = it.moments.iter().flat_map(|moments| {
            let scale = scales.each(moments);
            let pairs = moments.named().into_iter().zip(scale);
            pairs.filter_map(|((_, number), scale)| Some(number?.error / scale))
        });
        let largest = bars.fold(0.0, f64::max);
        let [q, v] = it.method.cells;
        line(format!(
            "{tolerance:>9.0e}{largest:>13.1e}{least:>11.2}{:>13}{:>7}  {}{}",
            format!("{q} x {v}"),
            it.method.steps,
            it.method.name,
            if it.shortfall.is_some() {
                ", not reached"
            } else {
                ""
            },
        ));
    }
}
