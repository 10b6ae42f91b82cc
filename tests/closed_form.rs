//! Contact laws and the stationary law in closed form, against references, identities and asymptotics.

#![allow(clippy::print_stdout, missing_docs)]

use std::f64::consts::{LN_10, TAU};
use vibroimpact::contact::{ContactLaw, Restoring};
use vibroimpact::oscillator::Oscillator;
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
fn the_hertz_potential_keeps_its_digits_near_equilibrium() {
    // U = q^2/2 + q^3/18 - q^4/216 + ..., from the binomial series of (9).
    for q in [1e-12, -1e-9, 1e-6, -1e-4] {
        let series = 0.5 * q * q * (1.0 + q / 9.0 - q * q / 108.0);
        assert!(
            (ContactLaw::Hertz.potential(q) / series - 1.0).abs() < 1e-12,
            "{q}"
        );
    }
    let (low, high) = (0.15 - 1e-14, 0.15 + 1e-14);
    let law = ContactLaw::Hertz;
    assert!((law.potential(low) - law.potential(high)).abs() < 1e-14);
    assert!((law.potential(-1.5) - 0.9).abs() < 1e-15);
}

#[test]
fn the_mean_force_over_an_interval_is_exact_across_the_loss_of_contact() {
    let law = ContactLaw::Bilinear;
    // Force -1 on [-2, -1], then from -1 to 0 on [-1, 0].
    assert!((law.mean_force(-2.0, 0.0) + 0.75).abs() < 1e-15);
    assert_eq!(law.mean_force(0.3, 0.3), 0.3);
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
            // E[G] = 0, E[qG] = T, E[v^2] = T, each relative to its natural scale.
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
