use super::*;
use crate::contact::ContactLaw;
use crate::rig::Rig;
use crate::stationary::Stationary;
use std::f64::consts::{PI, TAU};
use std::time::Instant;

fn quiet(_: f64) {}

fn hertz(h: f64) -> Oscillator {
    Oscillator::new(ContactLaw::Hertz, 0.005, h).unwrap()
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
        let it = hertz(h);
        let exact = Stationary::of(&it).unwrap();
        let settings = RecordSettings {
            duration: 1e5 * TAU,
            ..RecordSettings::default()
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
        let it = hertz(h);
        let exact = Stationary::of(&it).unwrap();
        let settings = RecordSettings {
            duration: 2e6,
            ..RecordSettings::default()
        };
        let got = records(&it, &settings, &quiet).unwrap().crossings.unwrap();
        let rig = Rig::default();
        let (losses, seconds) = got.in_seconds(&rig, 20.0);
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
    let it = hertz(2e-3);
    let exact = Stationary::of(&it).unwrap();
    for (scheme, step) in [
        (Scheme::Splitting42, 1.0),
        (Scheme::Splitting42, 2.0),
        (Scheme::Splitting62, 2.0),
        (Scheme::Splitting62, 4.0),
    ] {
        // 16 records of 1e5 each.
        let settings = RecordSettings {
            duration: 1.6e6,
            scheme,
            step: Some(step),
            ..RecordSettings::default()
        };
        let got = records(&it, &settings, &quiet).unwrap();
        let m = got.moments;
        let crossings = got.crossings.unwrap();
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
                crossings.lost_share,
                exact.contact_loss_probability().unwrap().value,
            ),
            (crossings.loss_rate, exact.loss_rate().unwrap().value),
        ];
        let z = pairs.map(|(x, exact)| (x.value - exact) / x.error);
        println!(
            "{scheme} step {step}: Var v {}, standard errors {z:.2?}",
            m.var_v
        );
        assert!(z.iter().all(|z| z.abs() < 4.0));
    }
}
