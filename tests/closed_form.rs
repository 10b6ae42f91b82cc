//! Contact laws, the stationary law, moments, units and the linear oscillator's Gaussian in closed form, against
//! references, identities and asymptotics.

#![allow(clippy::print_stdout, missing_docs)]

use std::f64::consts::{LN_10, TAU};
use vibroimpact::contact::{ContactLaw, Restoring};
use vibroimpact::estimate::Estimate;
use vibroimpact::gaussian::Gaussian;
use vibroimpact::initial::Initial;
use vibroimpact::moments::{Moment, Moments, RawMoments};
use vibroimpact::oscillator::Oscillator;
use vibroimpact::rig::Rig;
use vibroimpact::scales::Scales;
use vibroimpact::stationary::Stationary;
use vibroimpact::{Error, quadrature};

const LAWS: [ContactLaw; 4] = [
    ContactLaw::Hertz,
    ContactLaw::Bilinear,
    ContactLaw::Linear,
    ContactLaw::Free,
];

#[test]
fn the_force_is_the_slope_of_the_potential() {
    for law in LAWS {
        for k in -60..60 {
            let q = 0.0731 * f64::from(k);
            let slope = (law.potential(q + 1e-5) - law.potential(q - 1e-5)) / 2e-5;
            assert!((slope - law.force(q)).abs() < 1e-7, "{} at {q}", law.name());
            let stiffness = (law.force(q + 1e-6) - law.force(q - 1e-6)) / 2e-6;
            assert!(
                (stiffness - law.stiffness(q)).abs() < 1e-5,
                "{} at {q}",
                law.name()
            );
        }
    }
}

#[test]
fn the_hertz_force_and_potential_keep_their_digits_near_equilibrium() {
    // U = q^2/2 + q^3/18 - q^4/216 + ..., from the binomial series of (9).
    for q in [1e-12, -1e-9, 1e-6, -1e-4] {
        let series = 0.5 * q * q * (1.0 + q / 9.0 - q * q / 108.0);
        assert!(
            (ContactLaw::Hertz.potential(q) / series - 1.0).abs() < 1e-12,
            "{q}"
        );
        // G = q + q^2/6 - q^3/54 + ...
        let series = q * (1.0 + q / 6.0 - q * q / 54.0);
        let force = ContactLaw::Hertz.force(q);
        assert!((force / series - 1.0).abs() < 1e-12, "{q}: {force}");
    }
    let (low, high) = (0.15 - 1e-14, 0.15 + 1e-14);
    let law = ContactLaw::Hertz;
    assert!((law.potential(low) - law.potential(high)).abs() < 1e-14);
    assert!((law.potential(-1.5) - 0.9).abs() < 1e-15);
}

#[test]
fn turning_points_lie_on_the_energy_level() {
    for law in [ContactLaw::Hertz, ContactLaw::Bilinear, ContactLaw::Linear] {
        for rise in [1e-12, 1e-3, 0.9, 30.0, 1e8] {
            let (left, right) = law.turning_points(rise).unwrap();
            assert!(
                (law.potential(left) / rise - 1.0).abs() < 1e-9,
                "{} {rise}",
                law.name()
            );
            assert!(
                (law.potential(right) / rise - 1.0).abs() < 1e-9,
                "{} {rise}",
                law.name()
            );
            assert!(left < 0.0 && right > 0.0);
        }
    }
    assert!(ContactLaw::Free.turning_points(1.0).is_none());
}

#[derive(Debug)]
struct Wrong;
impl Restoring for Wrong {
    fn name(&self) -> &'static str {
        "wrong"
    }
    fn force(&self, q: f64) -> f64 {
        q - q * q * q
    }
    fn loss_point(&self) -> Option<f64> {
        None
    }
}

#[derive(Debug)]
struct HertzByHand;
impl Restoring for HertzByHand {
    fn name(&self) -> &'static str {
        "hertz by hand"
    }
    fn force(&self, q: f64) -> f64 {
        ContactLaw::Hertz.force(q)
    }
    fn loss_point(&self) -> Option<f64> {
        Some(-1.5)
    }
}

#[test]
fn a_custom_law_integrates_its_own_potential_and_a_falling_force_is_refused() {
    let law = ContactLaw::custom(HertzByHand).unwrap();
    for q in [-4.0, -1.5, -0.3, 0.0, 0.7, 12.0] {
        let (own, exact) = (law.potential(q), ContactLaw::Hertz.potential(q));
        assert!(
            (own - exact).abs() <= 1e-12 * exact.abs(),
            "{q}: {own} {exact}"
        );
    }
    assert!(law.equilibrium().unwrap().abs() < 1e-12);
    let message = ContactLaw::custom(Wrong).unwrap_err().to_string();
    assert!(message.contains("never falls"), "{message}");
}

fn law(contact: ContactLaw, zeta: f64, h: f64) -> Stationary {
    Stationary::of(&Oscillator::new(contact, zeta, h).unwrap()).unwrap()
}

/// `value` printed as `reference` is: the same digits.
fn same_digits(value: f64, reference: &str) {
    let (digits, exponent) = match reference.split_once('e') {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().unwrap()),
        None => (reference, 0),
    };
    let decimals = digits.split_once('.').map_or(0, |(_, d)| d.len());
    let printed = format!("{:.decimals$}", value / 10f64.powi(exponent));
    assert_eq!(printed, digits, "{value} against {reference}");
}

#[test]
fn the_closed_form_reproduces_the_reference_table_digit_by_digit() {
    // h, T, std N, skew N, P(loss) at zeta = 0.005, from an independent 30-digit quadrature
    // (0.072455645955 at h = 2e-3).
    for (h, t, std, skewness, loss) in [
        (3e-6, "9.4248e-4", "0.030698", "0.020474", "0"),
        (8e-5, "0.025133", "0.158308", "0.106754", "1.7725e-17"),
        (5e-4, "0.157080", "0.392361", "0.285310", "5.1030e-4"),
        (1.2e-3, "0.376991", "0.595294", "0.505015", "0.022060"),
        (2e-3, "0.628319", "0.747927", "0.711501", "0.0724556"),
        (3.2e-3, "1.005310", "0.911292", "0.950790", "0.15134"),
    ] {
        let it = law(ContactLaw::Hertz, 0.005, h);
        same_digits(it.oscillator().temperature(), t);
        same_digits(it.std_force().value, std);
        same_digits(it.skewness_force().value, skewness);
        same_digits(it.contact_loss_probability().unwrap().value, loss);
    }
    let it = law(ContactLaw::Hertz, 0.005, 2e-3);
    same_digits(it.mean_q().value, "-0.1645479");
    same_digits(it.var_q().value, "0.8099608");
    same_digits(it.loss_rate().unwrap().value, "0.03646636");
}

#[test]
fn the_exact_identities_hold_at_every_level_for_every_law() {
    let mut worst: f64 = 0.0;
    for contact in [ContactLaw::Hertz, ContactLaw::Bilinear, ContactLaw::Linear] {
        for t in [1e-8, 3e-4, 0.01, 0.63, 10.0, 94.0, 1e4, 1e6] {
            let it = law(contact.clone(), 0.005, t * 0.01 / std::f64::consts::PI);
            let name = format!("{} at T = {t}", contact.name());
            let std = it.std_force();
            let qg = it.displacement_law().expect(|q| q * contact.force(q));
            // E[G] = 0, E[qG] = T, E[v^2] = T, each relative to its normalisation.
            let errors = [
                it.mean_force().value / std.value,
                qg.value / t - 1.0,
                it.moment_v(2).value / t - 1.0,
            ];
            for error in errors {
                worst = worst.max(error.abs());
                assert!(error.abs() < 1e-10, "{name}: {errors:?}");
            }
            for number in [qg, it.mean_q(), it.var_q(), it.mean_force(), std] {
                assert!(
                    number.error < 1e-10 * number.value.abs().max(1.0).max(t),
                    "{name}: {number}"
                );
            }
            assert!(
                it.mean_force().value.abs() <= it.mean_force().error,
                "{name}"
            );
            assert!((qg.value - t).abs() <= qg.error + 1e-15 * t, "{name}: {qg}");
        }
    }
    println!("largest violation of the identities: {worst:.1e}");
}

#[test]
fn a_loss_probability_far_below_the_smallest_double_has_its_logarithm() {
    let it = law(ContactLaw::Hertz, 0.005, 1e-6);
    let log = it.log10_contact_loss_probability().unwrap();
    // ln P = -0.9/T + ln(T p_q(loss) e^{0.9/T}): T = pi 1e-4, Z = sqrt(2 pi T) (1 + O(T)).
    let t = it.oscillator().temperature();
    let asymptotic = (-0.9 / t + 0.5 * (t / TAU).ln()) / LN_10;
    println!("log10 P(loss) = {log}, asymptotic {asymptotic:.4}");
    assert!((log.value - asymptotic).abs() < 1e-3 && log.value < -1200.0);
    assert_eq!(it.contact_loss_probability().unwrap().value, 0.0);
    assert!((it.mean_flight().unwrap().value - (TAU * t).sqrt()).abs() < 1e-15);
}

#[test]
fn the_loss_rate_is_the_one_of_the_linear_oscillator_where_there_is_no_loss() {
    // Bilinear at small T: p_q is Gaussian up to the loss point, nu = exp(-1/(2T))/(2 pi).
    let it = law(
        ContactLaw::Bilinear,
        0.005,
        0.02 * 0.01 / std::f64::consts::PI,
    );
    let nu = it.loss_rate().unwrap().value;
    assert!(
        (nu * TAU / (-0.5f64 / 0.02).exp() - 1.0).abs() < 1e-9,
        "{nu}"
    );
    let per_time = it.losses_in(10.0).unwrap().value;
    assert!((per_time / nu - 10.0).abs() < 1e-12);
}

#[test]
fn the_density_of_the_force_integrates_to_one_with_its_dirac_mass() {
    for contact in [ContactLaw::Hertz, ContactLaw::Bilinear] {
        let it = law(contact, 0.005, 2e-3);
        let dirac = it.contact_loss_probability().unwrap().value;
        // N = -1 + s^3 removes the (1+N)^{-1/3} singularity of (29).
        let f = |s: f64| it.density_force(s.powi(3) - 1.0) * 3.0 * s * s;
        let rest = quadrature::integrate(f, &[0.0, 0.5, 1.0, 2.0, 3.0], 1e-12).value;
        assert!((dirac + rest - 1.0).abs() < 1e-10, "{dirac} {rest}");
        assert!((it.distribution_force(-1.0) - dirac).abs() < 1e-15);
        assert!((it.distribution_force(30.0) - 1.0).abs() < 1e-12);
        assert_eq!(it.density_force(-1.0001), 0.0);
    }
    let it = law(ContactLaw::Hertz, 0.005, 2e-3);
    assert!(
        it.density_force(-1.0 + 1e-12) > 100.0 * it.density_force(-0.999),
        "(29)"
    );
}

#[test]
fn velocity_moments_are_gaussian_and_the_linear_law_is_gaussian_throughout() {
    let it = law(ContactLaw::Linear, 0.05, 0.01);
    let t = it.oscillator().temperature();
    for (n, factor) in [(0, 1.0), (1, 0.0), (2, 1.0), (4, 3.0), (6, 15.0)] {
        let (q, v) = (it.moment_q(n), it.moment_v(n));
        let exact = factor * t.powi(n as i32 / 2);
        assert!(
            (q.value - exact).abs() < 1e-12 && (v.value - exact).abs() < 1e-12,
            "{n}"
        );
    }
    assert!(it.skewness_force().value.abs() < 1e-12);
    assert!((it.kurtosis_force().value - 3.0).abs() < 1e-12);
    assert!(it.contact_loss_probability().is_none() && it.loss_rate().is_none());
    assert!((it.mean_energy().value - t).abs() < 1e-14);
}

#[test]
fn a_law_without_a_stationary_law_says_so() {
    let oscillator = Oscillator::new(ContactLaw::Free, 0.005, 2e-3).unwrap();
    let error = Stationary::of(&oscillator).unwrap_err();
    assert!(matches!(error, Error::NoStationaryLaw { .. }), "{error}");
    assert!(error.to_string().contains("free"));
}

#[test]
fn the_linear_oscillator_from_rest_has_the_textbook_variance() {
    let it = Oscillator::new(ContactLaw::Linear, 0.05, 0.01).unwrap();
    let start = Gaussian::of(&it, &Initial::Rest).unwrap();
    let (z, t, temperature): (f64, f64, f64) = (0.05, 7.3, it.temperature());
    let now = start.after(&it, t).unwrap();
    // Caughey and Stumpf 1961: var v and cov of the oscillator switched on at rest.
    let w = (1.0 - z * z).sqrt();
    let (s, c) = ((w * t).sin(), (w * t).cos());
    let decay = (-2.0 * z * t).exp();
    let var_q =
        temperature * (1.0 - decay * (1.0 + 2.0 * z * z / (w * w) * s * s + 2.0 * z / w * s * c));
    assert!(
        (now.covariance[0][0] - var_q).abs() < 1e-14,
        "{now:?} {var_q}"
    );
    let half = 0.5
        * (start.after(&it, t + 1e-4).unwrap().covariance[0][0]
            - start.after(&it, t - 1e-4).unwrap().covariance[0][0])
        / 2e-4;
    assert!((now.covariance[0][1] - half).abs() < 1e-8);
    let late = start.after(&it, 4e3).unwrap();
    assert!((late.covariance[1][1] - temperature).abs() < 1e-12);
}

#[test]
fn free_flight_falls_and_spreads() {
    let it = Oscillator::new(ContactLaw::Free, 0.05, 0.01).unwrap();
    let start = Initial::Gaussian {
        mean: [1.0, 0.5],
        deviation: [0.1, 0.2],
    };
    let t = 3.0;
    let now = Gaussian::of(&it, &start).unwrap().after(&it, t).unwrap();
    let f = 0.1;
    let (e, terminal) = ((-f * t).exp(), 1.0 / f);
    assert!((now.mean[1] - (terminal + (0.5 - terminal) * e)).abs() < 1e-13);
    let var_v = 0.04 * e * e + it.temperature() * (1.0 - e * e);
    assert!((now.covariance[1][1] - var_v).abs() < 1e-13);
    let mean_q = 1.0 + terminal * t + (0.5 - terminal) * (1.0 - e) / f;
    assert!((now.mean[0] - mean_q).abs() < 1e-12);
    assert!(Gaussian::of(&it, &Initial::Stationary).is_err());
    let hertz = Oscillator::new(ContactLaw::Hertz, 0.05, 0.01).unwrap();
    assert!(now.after(&hertz, 1.0).is_err());
}

#[test]
fn a_moment_is_found_under_its_own_name() {
    let close = |value: f64| Estimate::closed_form(value);
    let moments = Moments {
        mean_q: close(1.0),
        std_force: close(2.0),
        ..Moments::default()
    };
    assert_eq!(moments.get(Moment::MeanQ), Some(close(1.0)));
    assert_eq!(moments.get(Moment::StdForce), Some(close(2.0)));
    assert_eq!(moments.get(Moment::ContactLossProbability), None);
    for (k, it) in Moment::ALL.into_iter().enumerate() {
        let name: String = it.name().chars().filter(|c| *c != '_').collect();
        assert_eq!((k, name), (it as usize, format!("{it:?}").to_lowercase()));
    }
}

#[test]
fn raw_expectations_of_a_two_point_law_give_its_moments() {
    // q = 2 with probability 1/4, q = -1 with 3/4, v = q, N = q (linear law).
    let raw = RawMoments {
        mass: 2.0,
        q: -0.5,
        qq: 3.5,
        v: -0.5,
        vv: 3.5,
        qv: 3.5,
        force: [-0.5, 3.5, 2.5, 9.5],
        potential: 1.75,
        lost: 0.0,
    };
    let m = raw.moments(&ContactLaw::Linear);
    let close = |x: Estimate, y: f64| assert!((x.value - y).abs() < 1e-14, "{} {y}", x.value);
    close(m.mean_q, -0.25);
    close(m.var_q, 1.6875);
    close(m.cov_qv, 1.6875);
    close(m.std_force, 1.6875f64.sqrt());
    // Bernoulli(1/4): skewness (1-2p)/sqrt(pq), kurtosis 3 + (1-6pq)/pq.
    close(m.skewness_force, 0.5 / 0.1875f64.sqrt());
    close(m.kurtosis_force, 3.0 + (1.0 - 6.0 * 0.1875) / 0.1875);
    close(m.mean_energy, 1.75);
    assert!(m.contact_loss_probability.is_none());
}

#[test]
fn the_paper_s_force_densities_give_the_paper_s_levels() {
    // Sections 4.1 and 4.2: G_0 in N^2/Hz and the corresponding h, printed to one or two digits.
    for (g0, h, digits) in [
        (1e-4, 1e-6, 0.05),
        (4.5e-3, 4.5e-5, 0.05),
        (30e-3, 3e-4, 0.05),
        (6e-2, 6e-4, 0.05),
        (0.17, 1.7e-3, 0.05),
        (0.25, 2.5e-3, 0.05),
    ] {
        let ours = Rig::default().level_from_force_psd(g0);
        assert!((ours / h - 1.0).abs() < digits, "{g0}: {ours} {h}");
    }
}

#[test]
fn every_conversion_has_its_inverse() {
    let rig = Rig::new(95.0, 410.0, 3.2e-6).unwrap();
    for x in [-2.3, 0.0, 1e-3, 7.0] {
        assert!((rig.displacement(rig.compression(x)) - x).abs() < 1e-13);
        assert!((rig.time(rig.seconds(x)) - x).abs() < 1e-13);
        assert!((rig.omega(rig.hertz(x)) - x).abs() < 1e-13);
        assert!((rig.level_from_force_psd(rig.force_psd_from_level(x)) - x).abs() < 1e-13);
    }
    assert!(
        rig.compression(-1.5).abs() < 1e-20,
        "loss of contact is zero compression, (15)"
    );
}

#[test]
fn the_moving_mass_carries_its_own_weight() {
    // Section 2: F_s = m g = 110 N; (2), (3) with (4), (5) must give the same mass.
    assert!((Rig::default().mass() * 9.81 / 110.0 - 1.0).abs() < 0.02);
}

#[test]
fn the_scales_of_the_linear_oscillator_are_powers_of_its_temperature() {
    let it = Oscillator::new(ContactLaw::Linear, 0.1, 0.02).unwrap();
    let t = it.temperature();
    let s = t.sqrt();
    let expected = [s, t, s, t, t, s, s, 1.0, 1.0, t, 1.0];
    for (got, expected) in Scales::of(&it)
        .each(&Moments::default())
        .iter()
        .zip(expected)
    {
        assert!((got / expected - 1.0).abs() < 1e-12);
    }
    let free = Oscillator::new(ContactLaw::Free, 0.1, 0.02).unwrap();
    let mut moments = Moments::default();
    moments.mean_q.value = -7.0;
    assert_eq!(Scales::of(&free).each(&moments)[0], 7.0);
}
