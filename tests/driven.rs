//! A harmonic drive and an envelope on the noise, held against what is exact.

use vibroimpact::contact::ContactLaw;
use vibroimpact::excitation::{Drive, Envelope, Excitation};
use vibroimpact::fokker_planck::{Settings, periodic, transient};
use vibroimpact::gaussian::Gaussian;
use vibroimpact::initial::Initial;
use vibroimpact::moments::{Moment, Moments};
use vibroimpact::noise_free;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::scales::Scales;

fn driven(amplitude: f64, frequency: f64, phase: f64) -> Excitation {
    Excitation {
        drive: Some(Drive::new(amplitude, frequency, phase).unwrap()),
        envelope: None,
    }
}

fn settings(excitation: &Excitation, tolerance: f64) -> Settings {
    Settings {
        excitation: excitation.clone(),
        tolerance,
        ..Settings::default()
    }
}

/// Largest error over the natural scale, and over its estimate, of the five moments of a Gaussian.
fn off(oscillator: &Oscillator, got: &Moments, exact: &Gaussian) -> (f64, f64) {
    let scales = Scales::of(oscillator).each(got);
    let [[qq, qv], [_, vv]] = exact.covariance;
    let pairs = [
        (Moment::MeanQ, exact.mean[0]),
        (Moment::MeanV, exact.mean[1]),
        (Moment::VarQ, qq),
        (Moment::VarV, vv),
        (Moment::CovQv, qv),
    ];
    let mut worst: (f64, f64) = (0.0, 0.0);
    for (moment, exact) in pairs {
        let it = got.get(moment).unwrap();
        let error = (it.value - exact).abs();
        worst.0 = worst.0.max(error / scales[moment as usize]);
        worst.1 = worst.1.max(error / it.error);
    }
    worst
}

#[test]
fn a_linear_oscillator_under_a_drive_is_gaussian_about_its_response() {
    for (zeta, a, w, initial) in [
        (
            0.005,
            0.02,
            0.95,
            Initial::gaussian([0.5, 0.0], [0.4, 0.4]).unwrap(),
        ),
        (0.05, 2.0, 0.7, Initial::Stationary),
        (0.005, 0.02, 0.95, Initial::Rest),
        (
            0.5,
            3.0,
            2.5,
            Initial::gaussian([0.0, 0.0], [0.2, 0.2]).unwrap(),
        ),
        (
            0.01,
            10.0,
            1.3,
            Initial::gaussian([0.0, 0.0], [0.01, 0.01]).unwrap(),
        ),
    ] {
        let it = Oscillator::new(ContactLaw::Linear, zeta, 0.4 * zeta).unwrap();
        let excitation = driven(a, w, 0.4);
        let times = [0.3, 2.0, 7.0, 20.0];
        for tolerance in [1e-2, 1e-3, 1e-4] {
            let clock = std::time::Instant::now();
            let got = transient(
                &it,
                &initial,
                &times,
                &[],
                &settings(&excitation, tolerance),
                &|_| (),
            )
            .unwrap();
            let start = Gaussian::of(&it, &initial).unwrap();
            let (mut scaled, mut said): (f64, f64) = (0.0, 0.0);
            for (t, moments) in times.iter().zip(&got.moments) {
                let mut exact = start.after(&it, *t).unwrap();
                exact.mean = noise_free::motion(&it, &excitation, start.mean, [0.0, *t]);
                let (a, b) = off(&it, moments, &exact);
                scaled = scaled.max(a);
                said = said.max(b);
            }
            println!(
                "zeta {zeta} a {a} W {w} {}: {tolerance:e}: error {scaled:.1e}, {said:.2} of the estimate, {:?} cells, {} steps, {:.0} ms, {:?}",
                initial.name(),
                got.method.cells,
                got.method.steps,
                1e3 * clock.elapsed().as_secs_f64(),
                got.shortfall.as_ref().map(|s| s.ratio)
            );
        }
    }
}

#[test]
fn the_periodic_law_of_a_linear_oscillator_is_gaussian_about_its_response() {
    for (zeta, a, w) in [
        (0.005, 0.02, 0.95),
        (0.05, 0.1, 0.9),
        (0.05, 2.0, 0.7),
        (0.5, 3.0, 2.5),
        (0.05, 0.0, 0.9),
    ] {
        let it = Oscillator::new(ContactLaw::Linear, zeta, 0.4 * zeta).unwrap();
        let excitation = driven(a, w, 0.4);
        let amplitude = a / (1.0 - w * w).hypot(2.0 * zeta * w);
        let lag = (2.0 * zeta * w).atan2(1.0 - w * w);
        let t = it.temperature();
        for tolerance in [1e-2, 1e-3, 1e-4] {
            let clock = std::time::Instant::now();
            let got = periodic(&it, 32, &settings(&excitation, tolerance), &|_| ()).unwrap();
            let time = clock.elapsed().as_secs_f64();
            let (mut scaled, mut said): (f64, f64) = (0.0, 0.0);
            for (phase, moments) in got.phase.iter().zip(&got.moments) {
                let angle = phase + 0.4 - lag;
                let exact = Gaussian {
                    mean: [amplitude * angle.cos(), -w * amplitude * angle.sin()],
                    covariance: [[t, 0.0], [0.0, t]],
                };
                let (a, b) = off(&it, moments, &exact);
                scaled = scaled.max(a);
                said = said.max(b);
            }
            let decay = (-zeta * std::f64::consts::TAU / w).exp();
            println!(
                "zeta {zeta} a {a} W {w}: {tolerance:e}: error {scaled:.1e}, {said:.2} of the estimate, {:?} cells, {} steps, {:.0} ms, {:?}; multiplier {:?} {decay:.8}; residual {:.1e}",
                got.method.cells,
                got.method.steps,
                1e3 * time,
                got.shortfall.as_ref().map(|s| s.ratio),
                got.multipliers.first(),
                got.residual
            );
        }
    }
}
