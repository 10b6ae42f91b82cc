//! Monte Carlo against everything that is known exactly or from elsewhere. Each test prints what it
//! measured, in standard errors where there are any.

use std::f64::consts::{PI, TAU};
use std::time::Instant;
use vibroimpact::contact::ContactLaw;
use vibroimpact::estimate::Estimate;
use vibroimpact::initial::Initial;
use vibroimpact::moments::Moments;
use vibroimpact::monte_carlo::{Sampling, Scheme, records, run};
use vibroimpact::oscillator::Oscillator;
use vibroimpact::rig::Rig;
use vibroimpact::stationary::Stationary;

fn quiet(_: f64) {}

/// The paper's T at h = 2e-3, zeta = 0.005.
const PAPER: f64 = 0.628_318_530_717_958_6;

fn hertz(zeta: f64, temperature: f64) -> Oscillator {
    Oscillator::new(ContactLaw::Hertz, zeta, temperature * 2.0 * zeta / PI).unwrap()
}

/// The paper's damping.
fn level(h: f64) -> Oscillator {
    Oscillator::new(ContactLaw::Hertz, 0.005, h).unwrap()
}

fn settings(paths: u64) -> Sampling {
    Sampling {
        paths,
        ..Sampling::default()
    }
}

/// Standard errors between every sampled moment and the closed form.
fn against_closed_form(moments: &Moments, exact: &Stationary) -> Vec<(&'static str, f64)> {
    let closed = exact.moments();
    let pairs = moments.named().into_iter().zip(closed.named());
    pairs
        .filter_map(|((name, got), (_, exact))| {
            let (got, exact) = (got?, exact?);
            Some((name, (got.value - exact.value) / got.error))
        })
        .collect()
}

fn worst(z: &[(&'static str, f64)]) -> f64 {
    z.iter().map(|(_, z)| z.abs()).fold(0.0, f64::max)
}

#[test]
fn a_million_paths_from_the_stationary_law_stay_in_it() {
    let it = hertz(0.005, PAPER);
    let exact = Stationary::of(&it).unwrap();
    let start = Instant::now();
    let got = run(
        &it,
        &Initial::Stationary,
        &[0.0, 20.0],
        &settings(1_000_000),
        &quiet,
    )
    .unwrap();
    for (t, moments) in got.times.iter().zip(&got.moments) {
        let z = against_closed_form(moments, &exact);
        println!("t = {t}: standard errors {z:.2?}");
        assert!(worst(&z) < 4.0);
        let std_q = moments.var_q.value.sqrt() - exact.var_q().value.sqrt();
        let std_v = moments.var_v.value.sqrt() - it.temperature().sqrt();
        let std_n = moments.std_force.value - exact.std_force().value;
        println!("deviations off by {std_q:.1e} {std_v:.1e} {std_n:.1e}");
        assert!(std_q.abs() < 2e-3 && std_v.abs() < 2e-3 && std_n.abs() < 2e-3);
    }
    println!(
        "{:.2} s, {} steps of {}",
        start.elapsed().as_secs_f64(),
        got.steps,
        got.step
    );
}

#[test]
fn paths_from_rest_reach_the_stationary_law_after_ten_over_zeta() {
    let it = hertz(0.05, PAPER);
    let exact = Stationary::of(&it).unwrap();
    let got = run(&it, &Initial::Rest, &[200.0], &settings(100_000), &quiet).unwrap();
    let z = against_closed_form(&got.moments[0], &exact);
    println!("standard errors {z:.2?}");
    assert!(worst(&z) < 4.0);
}

#[test]
#[allow(clippy::approx_constant)] // a skewness that happens to be near -pi/8
fn scene_a_agrees_with_its_reference_values() {
    let it = hertz(0.005, PAPER);
    let initial = Initial::gaussian([1.0, 0.0], [0.4, 0.4]).unwrap();
    let got = run(
        &it,
        &initial,
        &[5.0, 10.0, 20.0],
        &settings(200_000),
        &quiet,
    )
    .unwrap();
    // t = 5, 10, 20: E[q], E[N], std N, skew N, E[H], E[v^2], from two independent meshes.
    let reference = [
        [
            -0.223_621, -0.125_884, 0.479_410, -0.02399, 0.733_349, 1.093_982,
        ],
        [-1.08770, -0.752_841, 0.28726, 1.4824, 0.726_840, 0.279_520],
        [0.493_075, 0.634_542, 0.67746, -0.3926, 0.722_197, 0.636_632],
    ];
    for ((t, m), reference) in got.times.iter().zip(&got.moments).zip(reference) {
        let square = m.var_v.value + m.mean_v.value.powi(2);
        let square_error = m.var_v.error + 2.0 * (m.mean_v.value * m.mean_v.error).abs();
        let numbers = [
            m.mean_q,
            m.mean_force,
            m.std_force,
            m.skewness_force,
            m.mean_energy,
            Estimate::new(square, square_error, m.var_v.origin),
        ];
        let z: Vec<f64> = numbers
            .iter()
            .zip(reference)
            .map(|(x, r)| (x.value - r) / x.error)
            .collect();
        println!("t = {t}: standard errors {z:.2?}");
        assert!(z.iter().all(|z| z.abs() < 4.0));
    }
    let loss = got.moments[2].contact_loss_probability.unwrap();
    println!("P(loss) = {loss}, reference 0.03026");
    assert!((loss.value - 0.03026).abs() < 4.0 * loss.error);
}

#[test]
fn table_5_agrees_with_the_closed_form_at_all_six_levels() {
    // E[N], std N and skewness of N as the paper prints them.
    let paper = [
        (3e-6, -3.0e-4, 0.03, 0.018),
        (8e-5, -1.0e-3, 0.15, 0.097),
        (5e-4, -2.0e-3, 0.38, 0.260),
        (1.2e-3, -4.1e-3, 0.57, 0.490),
        (2.0e-3, -4.2e-3, 0.72, 0.666),
        (3.2e-3, -4.4e-3, 0.88, 0.917),
    ];
    let start = Instant::now();
    for (h, mean, std, skewness) in paper {
        let it = level(h);
        let exact = Stationary::of(&it).unwrap();
        let settings = Sampling {
            duration: 1e5 * TAU,
            ..Sampling::default()
        };
        let got = records(&it, &settings, &quiet).unwrap();
        let m = got.moments;
        println!(
            "h = {h}: E[N] = {} ({mean}), std {} ({std}), skewness {} ({skewness}); {} batches, effective samples {:.0?}",
            m.mean_force, m.std_force, m.skewness_force, got.batches, got.effective_samples
        );
        let pairs = [
            (m.mean_force, exact.mean_force().value),
            (m.std_force, exact.std_force().value),
            (m.skewness_force, exact.skewness_force().value),
            (m.kurtosis_force, exact.kurtosis_force().value),
            (m.mean_q, exact.mean_q().value),
            (m.var_q, exact.var_q().value),
            (m.var_v, it.temperature()),
            (m.mean_energy, exact.mean_energy().value),
            (
                m.contact_loss_probability.unwrap(),
                exact.contact_loss_probability().unwrap().value,
            ),
        ];
        let z = pairs.map(|(x, exact)| (x.value - exact) / x.error);
        println!("  standard errors {z:.2?}");
        assert!(z.iter().all(|z| z.abs() < 4.0));
        let c = got.controlled;
        let pairs = [
            (c.std_force, m.std_force, exact.std_force().value),
            (
                c.skewness_force,
                m.skewness_force,
                exact.skewness_force().value,
            ),
            (c.mean_q, m.mean_q, exact.mean_q().value),
            (c.var_q, m.var_q, exact.var_q().value),
            (c.mean_energy, m.mean_energy, exact.mean_energy().value),
            (
                c.contact_loss_probability.unwrap(),
                m.contact_loss_probability.unwrap(),
                exact.contact_loss_probability().unwrap().value,
            ),
        ];
        let z = pairs.map(|(x, _, exact)| (x.value - exact) / x.error);
        let gain = pairs.map(|(x, raw, _)| raw.error / x.error);
        println!("  controlled: standard errors {z:.2?}, errors smaller by {gain:.1?}");
        assert!(z.iter().all(|z| z.abs() < 4.5));
    }
    println!("{:.2} s", start.elapsed().as_secs_f64());
}

#[test]
fn losses_and_flights_agree_with_rice_and_with_p_over_nu() {
    for h in [5e-4, 1.2e-3, 2e-3, 3.2e-3] {
        let it = level(h);
        let exact = Stationary::of(&it).unwrap();
        let settings = Sampling {
            duration: 2e6,
            ..Sampling::default()
        };
        let got = records(&it, &settings, &quiet).unwrap().crossings.unwrap();
        let rig = Rig::default();
        let losses = got.losses_in(rig.time(20.0));
        let seconds = got.mean_flight.scaled(rig.seconds(1.0));
        println!(
            "h = {h}: nu = {}, flight {}, losses in 20 s {losses}, mean flight {:.3} ms",
            got.loss_rate,
            got.mean_flight,
            1e3 * seconds.value
        );
        // The speed at the return has the Rayleigh law, as that at the loss: mean sqrt(pi T/2).
        let speed = (0.5 * PI * it.temperature()).sqrt();
        let pairs = [
            (got.loss_rate, exact.loss_rate().unwrap().value),
            (got.mean_flight, exact.mean_flight().unwrap().value),
            (
                got.lost_share,
                exact.contact_loss_probability().unwrap().value,
            ),
            (got.mean_impact_speed, speed),
            (losses, exact.losses_in(rig.time(20.0)).unwrap().value),
        ];
        let z = pairs.map(|(x, exact)| (x.value - exact) / x.error);
        println!("  {} losses, standard errors {z:.2?}", got.losses);
        assert!(z.iter().all(|z| z.abs() < 4.0));
    }
}

#[test]
fn the_largest_steps_keep_the_stationary_law_for_a_hundred_thousand_time_units() {
    let it = level(2e-3);
    let exact = Stationary::of(&it).unwrap();
    for (scheme, step) in [
        (Scheme::Splitting42, 1.0),
        (Scheme::Splitting42, 2.0),
        (Scheme::Splitting62, 2.0),
        (Scheme::Splitting62, 4.0),
    ] {
        let start = Instant::now();
        let chosen = Sampling {
            scheme,
            step: Some(step),
            ..settings(160)
        };
        let end = run(&it, &Initial::Stationary, &[1e5], &chosen, &quiet).unwrap();
        // Skewness and kurtosis of 160 paths have no standard errors to speak of.
        let mut ends = against_closed_form(&end.moments[0], &exact);
        ends.retain(|(name, _)| !matches!(*name, "skewness_force" | "kurtosis_force"));
        // And the average over a time thirty times longer.
        let long = Sampling {
            duration: 3e6,
            scheme,
            step: Some(step),
            ..Sampling::default()
        };
        let got = records(&it, &long, &quiet).unwrap();
        let averages = against_closed_form(&got.moments, &exact);
        let crossings = got.crossings.unwrap();
        let share = exact.contact_loss_probability().unwrap().value;
        let share = (crossings.lost_share.value - share) / crossings.lost_share.error;
        let rate = exact.loss_rate().unwrap().value;
        let rate = (crossings.loss_rate.value - rate) / crossings.loss_rate.error;
        println!(
            "{scheme} step {step}: worst {:.2} standard errors of 160 paths at t = 1e5, {:.2} of the averages \
             over 3e6 (Var v {}, exact {:.6}), share {share:.2} and rate {rate:.2}; {:.1} s",
            worst(&ends),
            worst(&averages),
            got.moments.var_v,
            it.temperature(),
            start.elapsed().as_secs_f64()
        );
        assert!(worst(&ends) < 4.0 && worst(&averages) < 4.0);
        assert!(share.abs() < 4.0 && rate.abs() < 4.0);
    }
}
