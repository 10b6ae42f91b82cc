//! Orders and errors of a local grid.

use super::*;
use crate::contact::ContactLaw;
use crate::gaussian::Gaussian;
use crate::moments::Moments;

fn run(oscillator: &Oscillator, initial: &Initial, t: f64, step: f64) -> LocalGrid {
    let fineness = Fineness {
        cell: 0.25,
        reach: 7.5,
        border: 1e-12,
        step,
        beside: 1.0,
        more: 0,
    };
    let mut grid = LocalGrid::new((oscillator, None), initial, 0.02, fineness).unwrap();
    grid.leave_point(t);
    let left = t - grid.time();
    let steps = grid.divide(left);
    for _ in 0..steps {
        grid.advance(left / steps as f64);
    }
    grid
}

#[test]
fn the_steps_of_a_local_grid_are_of_order_six_and_under_strong_damping_of_order_four() {
    for (zeta, t, steps, order) in [
        (0.005, 10.0, [0.8, 0.4], 5.0),
        (0.2, 5.0, [0.4, 0.2], 3.5),
        (1.0, 2.0, [0.2, 0.1], 3.8),
        (5.0, 1.0, [0.1, 0.05], 3.8),
    ] {
        let it = Oscillator::new(ContactLaw::Linear, zeta, 2e-3).unwrap();
        let exact = Gaussian::of(&it, &Initial::Rest).unwrap();
        let [[qq, _], [_, vv]] = exact.after(&it, t).unwrap().covariance;
        let errors = steps.map(|step| {
            let grid = run(&it, &Initial::Rest, t, step);
            let got = grid.moments();
            let wrong = |x: f64, y: f64| (x / y - 1.0).abs();
            wrong(got.var_q.value, qq).max(wrong(got.var_v.value, vv))
        });
        let seen = (errors[0] / errors[1]).log2();
        println!(
            "zeta = {zeta}: {:.1e}, {:.1e}, order {seen:.1}",
            errors[0], errors[1]
        );
        assert!(seen > order);
    }
}

#[test]
fn a_local_grid_through_the_loss_of_contact_keeps_the_energy_law() {
    // d/dt E[H] = pi h - 2 zeta E[v^2], by Simpson's rule over steps that fall on it.
    let it = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
    let start = Initial::gaussian([-3.0, 0.0], [1e-3; 2]).unwrap();
    let at = |k: u32| run(&it, &start, 0.25 * f64::from(k) + 1e-9, 0.25).moments();
    let all: Vec<Moments> = (0..=16).map(at).collect();
    let power =
        |m: &Moments| it.noise() - 2.0 * it.zeta() * (m.var_v.value + m.mean_v.value.powi(2));
    let integral: f64 = all
        .windows(3)
        .step_by(2)
        .map(|w| (power(&w[0]) + 4.0 * power(&w[1]) + power(&w[2])) * 0.25 / 3.0)
        .sum();
    let change = all[16].mean_energy.value - all[0].mean_energy.value;
    println!("energy changes by {change:.7}, power adds up to {integral:.7}");
    // Simpson's rule is good to 1e-6 of the power here.
    assert!((change - integral).abs() < 1e-4 * change.abs());
}
