//! Promises of the integrators: accuracy for a tolerance, stiffness, conservation.

use std::time::Instant;
use vibroimpact::contact::ContactLaw;
use vibroimpact::fokker_planck::choice;
use vibroimpact::fokker_planck::density::Density;
use vibroimpact::fokker_planck::generator::Generator;
use vibroimpact::fokker_planck::march::{Chebyshev, Integrator, March};
use vibroimpact::fokker_planck::mesh::{Axis, Mesh};
use vibroimpact::fokker_planck::{Drift, Settings, TimeScheme};
use vibroimpact::initial::Initial;
use vibroimpact::oscillator::Oscillator;

/// A start on a mesh, and how long to follow it.
struct Case {
    name: String,
    oscillator: Oscillator,
    generator: Generator,
    start: Density,
    until: f64,
}

impl Case {
    /// The contact at zeta and T, in a box up to `level` T.
    fn hertz(
        zeta: f64,
        temperature: f64,
        level: f64,
        cells: [usize; 2],
        initial: (f64, f64),
        until: f64,
    ) -> Self {
        let h = 2.0 * zeta * temperature / std::f64::consts::PI;
        let oscillator = Oscillator::new(ContactLaw::Hertz, zeta, h).unwrap();
        let margin = Drift::Order8.margin();
        let energy = level * temperature;
        let (left, right) = oscillator.contact().turning_points(energy).unwrap();
        let mesh = Mesh {
            q: Axis::displacement(oscillator.contact(), temperature, [left, right], cells[0], margin)
                .unwrap(),
            v: Axis::velocity((2.0 * energy).sqrt(), cells[1], margin).unwrap(),
        };
        let start = Initial::gaussian([initial.0, 0.0], [initial.1, initial.1]).unwrap();
        Self::new(format!("zeta = {zeta}"), oscillator, &mesh, &start, until)
    }

    fn new(
        name: String,
        oscillator: Oscillator,
        mesh: &Mesh,
        initial: &Initial,
        until: f64,
    ) -> Self {
        let generator = Generator::new(&oscillator, mesh, Drift::Order8).unwrap();
        let start = Density::start(&generator, initial).unwrap();
        Self {
            name,
            oscillator,
            generator,
            start,
            until,
        }
    }

    /// The state at the end, to rounding: Chebyshev series with all terms.
    fn exact(&self) -> Density {
        let mut density = self.start.clone();
        let mut scheme = Chebyshev::new(&self.generator);
        let steps = (self.until / scheme.longest_step()).ceil();
        for _ in 0..steps as usize {
            let dt = self.until / steps;
            scheme.march(density.cells_mut(), dt, 1e-15).unwrap();
        }
        density
    }

    /// A run by `time` within a tolerance: the density, the march and the seconds taken.
    fn run(&self, time: TimeScheme, tolerance: f64) -> (Density, March, f64) {
        let settings = Settings {
            tolerance,
            ..Settings::default()
        };
        let clock = Instant::now();
        let mut density = self.start.clone();
        let mut march = choice::march(&self.oscillator, &self.generator, time, &settings, self.until);
        march
            .advance(&mut density, self.until, &mut |_, _| Ok(true))
            .unwrap();
        (density, march, clock.elapsed().as_secs_f64())
    }
}

fn distance(a: &Density, b: &Density) -> f64 {
    let pairs = a.cells().iter().zip(b.cells());
    pairs.map(|(a, b)| (a - b).abs()).sum()
}

fn cases() -> Vec<Case> {
    let free = Oscillator::new(ContactLaw::Free, 0.05, 0.02).unwrap();
    let mesh = Mesh {
        q: Axis::uniform(-4.0, 9.0, 90).unwrap(),
        v: Axis::uniform(-4.0, 6.0, 70).unwrap(),
    };
    let flight = Initial::gaussian([0.0, 0.0], [0.4, 0.4]).unwrap();
    vec![
        Case::hertz(0.005, 0.63, 11.0, [90, 60], (1.0, 0.4), 20.0),
        Case::hertz(0.5, 0.63, 11.0, [80, 50], (1.0, 0.4), 5.0),
        Case::hertz(5.0, 0.63, 11.0, [80, 50], (1.0, 0.4), 5.0),
        Case::hertz(50.0, 0.63, 11.0, [80, 50], (1.0, 0.4), 5.0),
        Case::new("free flight".into(), free, &mesh, &flight, 3.0),
    ]
}

#[test]
fn a_tolerance_is_kept_and_not_wasted() {
    for case in cases() {
        let clock = Instant::now();
        let exact = case.exact();
        println!("{}: {:?} unknowns, radii {:.0?}; exact in {:.2} s", case.name, case.generator.unknowns(), case.generator.radii(), clock.elapsed().as_secs_f64());
        for time in [TimeScheme::Explicit, TimeScheme::Imex, TimeScheme::Implicit] {
            for tolerance in [1e-3, 1e-5, 1e-7] {
                let (density, march, seconds) = case.run(time, tolerance);
                let error = distance(&density, &exact).max(0.0);
                println!(
                    "{} {} {tolerance:.0e}: error {error:.1e} = tolerance/{:.1}, {} steps, {} refused, longest {:.1e}, {seconds:.2} s",
                    case.name, time.name(), tolerance / error, march.steps(), march.refused(), march.longest()
                );
            }
        }
    }
}
