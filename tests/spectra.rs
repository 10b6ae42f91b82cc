//! Spectra: against closed forms, against the flow map, against sampling.

use num_complex::Complex;
use rustfft::algorithm::Radix4;
use rustfft::{Fft, FftDirection};
use std::f64::consts::{PI, TAU};
use vibroimpact::contact::{ContactLaw, Parameter, Parameters, Restoring};
use vibroimpact::estimate::Estimate;
use vibroimpact::fokker_planck::flow_map::{self, FlowMap};
use vibroimpact::fokker_planck::{Axis, Domain, Mesh, Settings, Spectrum, spectrum};
use vibroimpact::initial::Initial;
use vibroimpact::monte_carlo::{Samples, Sampling, series};
use vibroimpact::oscillator::{Oscillator, Quantity};
use vibroimpact::plan::Plan;
use vibroimpact::scene::text::SceneText;
use vibroimpact::scene::{MonteCarlo, Outputs, Scene, SpectrumRequest};
use vibroimpact::spectrum::{Welch, linear};

const ZETA: f64 = 0.005;

/// The spectrum of a correlation function sampled at equal steps from 0 until it has died out: the
/// trapezoidal rule, by fast Fourier transform. Frequencies are 2 pi k/(step length), k up to half the
/// length, the length that of the transform: twice the number of samples or more, a power of two.
///
/// The sum is the spectrum with everything beyond pi/step folded back, S(omega) + sum over m >= 1 of
/// S(2 pi m/step - omega) + S(2 pi m/step + omega): the step must be short enough that there is nothing
/// there.
fn of_correlation(correlation: &[f64], step: f64) -> (Vec<f64>, Vec<f64>) {
    let length = (2 * correlation.len()).next_power_of_two();
    let mut terms = vec![Complex::default(); length];
    for (k, r) in correlation.iter().enumerate() {
        terms[k].re = if k == 0 { 0.5 * r } else { *r };
    }
    Radix4::new(length, FftDirection::Forward).process(&mut terms);
    let omega = |k: usize| 2.0 * PI * k as f64 / (step * length as f64);
    let half = 0..=length / 2;
    let density = half.clone().map(|k| 2.0 / PI * step * terms[k].re);
    (half.map(omega).collect(), density.collect())
}

fn hertz(h: f64) -> Oscillator {
    Oscillator::new(ContactLaw::Hertz, ZETA, h).unwrap()
}

fn grid(until: f64, count: usize) -> Vec<f64> {
    (0..=count)
        .map(|k| until * k as f64 / count as f64)
        .collect()
}

fn to(tolerance: f64) -> Settings {
    Settings {
        tolerance,
        ..Settings::default()
    }
}

fn solve(it: &Oscillator, quantity: Quantity, omegas: &[f64], settings: &Settings) -> Spectrum {
    spectrum(it, quantity, omegas, settings, &|_| ()).unwrap()
}

/// By trapezoids.
fn integral(omegas: &[f64], density: &[Estimate]) -> f64 {
    let both = omegas.windows(2).zip(density.windows(2));
    both.map(|(w, g)| 0.5 * (w[1] - w[0]) * (g[0].value + g[1].value))
        .sum()
}

#[test]
fn the_linear_contact_has_the_spectrum_of_the_linear_oscillator_peak_included() {
    // The peak lies at sqrt(1 - 2 zeta^2), between points of any grid.
    let mut omegas = grid(4.0, 400);
    omegas.extend((1..200).map(|k| 0.98 + 2e-4 * f64::from(k)));
    omegas.sort_by(f64::total_cmp);
    omegas.dedup();
    for (zeta, h) in [(ZETA, 2e-3), (0.3, 1e-4), (2.0, 0.1)] {
        let it = Oscillator::new(ContactLaw::Linear, zeta, h).unwrap();
        for quantity in [Quantity::Force, Quantity::Displacement] {
            let got = solve(&it, quantity, &omegas, &to(1e-5));
            let error = |(w, g): (&f64, &vibroimpact::estimate::Estimate)| {
                let exact = linear(&it, *w);
                assert!(
                    (g.value - exact).abs() <= g.error.max(1e-9 * exact),
                    "{w}: {g}"
                );
                (g.value / exact - 1.0).abs()
            };
            let worst = omegas
                .iter()
                .zip(&got.density)
                .map(error)
                .fold(0.0, f64::max);
            println!("zeta = {zeta}, {quantity:?}: {worst:.1e} of the value at worst");
            assert!(worst < 1e-4);
            if zeta == ZETA {
                let peak = got.peaks()[0];
                let exact = (1.0 - 2.0 * zeta * zeta).sqrt();
                assert!((peak.omega.value - exact).abs() < 1e-7, "{}", peak.omega);
                // Half-power width 2 zeta, to zeta^2.
                let width = peak.width.unwrap();
                assert!((width.value / (2.0 * zeta) - 1.0).abs() < 1e-4, "{width}");
                assert_eq!(got.peaks().len(), 1);
            }
        }
    }
}

#[test]
fn displacement_and_force_have_the_reference_values_and_error_estimates_that_hold() {
    let it = hertz(2e-3);
    // Two-sided without 1/2 pi, from an independent spectral solver: 4.998 and 4.583.
    let got = solve(&it, Quantity::Displacement, &[0.8, 1.0], &to(1e-3));
    for (g, reference) in got.density.iter().zip([4.583, 4.998]) {
        println!("S_qq = {:.6}, reference {reference}", PI * g.value);
        assert!((PI * g.value - reference).abs() < 1e-3);
    }
    // At zero frequency the spectrum of the force is the excitation's, whatever the level.
    for h in [8e-5, 2e-3] {
        let zero = solve(&hertz(h), Quantity::Force, &[0.0, 1e-3], &to(1e-3));
        let g = zero.density[0];
        println!("h = {h}: G_NN(0) = {g}, 2h = {}", 2.0 * h);
        assert!((g.value / (2.0 * h) - 1.0).abs() < 1e-6);
    }
    let omegas = grid(4.0, 80);
    let coarse = solve(&it, Quantity::Force, &omegas, &to(3e-2));
    let fine = solve(&it, Quantity::Force, &omegas, &to(1e-3));
    assert!(coarse.functions[0] < fine.functions[0] && fine.shortfall.is_none());
    let mut worst = 0.0f64;
    for ((w, a), b) in omegas.iter().zip(&coarse.density).zip(&fine.density) {
        let share = (a.value - b.value).abs() / (a.error + b.error);
        worst = worst.max(share);
        assert!(share <= 1.0, "{w}: {a} against {b}");
    }
    println!("largest error over its estimate: {worst:.2}");
}

#[test]
fn the_spectrum_of_the_force_integrates_to_its_variance_at_every_level_of_the_paper() {
    // Fine where low levels have peaks of width 2 zeta; beyond 5 lies less than 1e-4 of the variance.
    let mut omegas = grid(5.0, 500);
    omegas.extend((1..1600).map(|k| 0.5 + 5e-4 * f64::from(k)));
    omegas.sort_by(f64::total_cmp);
    omegas.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    let levels = [3e-6, 8e-5, 5e-4, 1.2e-3, 2e-3, 3.2e-3];
    let deviations = [0.030698, 0.158308, 0.392361, 0.595294, 0.747927, 0.911292];
    let mut before = (2.0, 0.0);
    for (h, deviation) in levels.into_iter().zip(deviations) {
        let began = std::time::Instant::now();
        let got = solve(&hertz(h), Quantity::Force, &omegas, &to(1e-1));
        let share = integral(&omegas, &got.density) / (deviation * deviation) - 1.0;
        let peak = got.peaks()[0];
        let width = peak.width.unwrap();
        println!(
            "h = {h}: integral off by {share:.1e}; peak at {:.4}, width {:.4}, harmonic {:.2e}; {:.1} s",
            peak.omega.value,
            width.value,
            got.harmonic_ratio().unwrap().value,
            began.elapsed().as_secs_f64()
        );
        assert!(share.abs() < 1e-3);
        // Peaks move to lower frequency and broaden with the level (section 5.3.2).
        assert!(peak.omega.value < before.0 && width.value > before.1);
        before = (peak.omega.value, width.value);
    }
}

#[test]
fn the_resolvent_agrees_with_the_correlation_function_of_the_flow_map() {
    let it = hertz(2e-3);
    let (step, count) = (0.25, 4500);
    let domain = Domain::closed(&it, &Initial::Stationary, 1e-11).unwrap();
    let law = it.contact();
    let mesh = Mesh {
        q: Axis::displacement(law, it.temperature(), domain.q, 100, 1).unwrap(),
        v: Axis::velocity(domain.v[1], 82, 1).unwrap(),
    };
    let settings = flow_map::Settings {
        step,
        ..flow_map::Settings::default()
    };
    let mut flow = FlowMap::new(&it, &mesh, settings).unwrap();
    // The signed density (N - E N) p_s; E N = 0.
    let mut signed = flow.start(&Initial::Stationary).unwrap();
    let force: Vec<f64> = mesh.q.centres().iter().map(|q| law.force(*q)).collect();
    let nv = mesh.v.len();
    for (row, n) in signed.cells_mut().chunks_exact_mut(nv).zip(&force) {
        for p in row {
            *p *= n;
        }
    }
    let mut correlation = Vec::with_capacity(count);
    for _ in 0..count {
        let rows = signed.cells().chunks_exact(nv).zip(&force);
        correlation.push(
            rows.map(|(row, n)| n * row.iter().sum::<f64>())
                .sum::<f64>(),
        );
        flow.advance(&mut signed, step).unwrap();
    }
    let (omega, by_time) = of_correlation(&correlation, step);
    let kept = omega.partition_point(|w| *w <= 4.0);
    let thinned: Vec<usize> = (0..kept).step_by(16).collect();
    let omegas: Vec<f64> = thinned.iter().map(|k| omega[*k]).collect();
    let got = solve(&it, Quantity::Force, &omegas, &to(1e-2));
    let peak = got.density.iter().map(|g| g.value).fold(0.0, f64::max);
    let (mut worst, mut relative) = (0.0f64, 0.0f64);
    for (k, g) in thinned.iter().zip(&got.density) {
        let off = (by_time[*k] - g.value).abs();
        worst = worst.max(off / peak);
        relative = relative.max(off / g.value.max(1e-3 * peak));
    }
    println!(
        "flow map against resolvent: {worst:.1e} of the peak, {relative:.1e} of values above 1e-3 of it"
    );
    assert!(worst < 5e-4 && relative < 1e-2);
    // The reduced model knows the correlation function too.
    let model = got.correlation(step, 400);
    let off = model.iter().zip(&correlation).map(|(a, b)| (a - b).abs());
    let off = off.fold(0.0, f64::max) / correlation[0];
    println!("correlation functions: {off:.1e} of the variance");
    assert!(off < 1e-3);
}

#[test]
fn welch_agrees_with_its_own_expectation_within_a_family_wise_99_percent_band() {
    let it = hertz(2e-3);
    for (nyquist, quantity) in [(8.0, Quantity::Force), (4.3, Quantity::Displacement)] {
        let welch = Welch::new(2048, 1024, PI / nyquist).unwrap();
        let asked = Samples {
            quantity,
            spacing: PI / nyquist,
            samples: welch.record_length(5),
            records: 80,
        };
        let settings = Sampling {
            seed: 3,
            max_seconds: 100.0,
            ..Sampling::default()
        };
        let law = it.displacement_law().unwrap();
        let mean = law.expect(|q| quantity.of(it.contact(), q)).value;
        let visit = |record: &[f64]| {
            let deviation: Vec<f64> = record.iter().map(|x| x - mean).collect();
            welch.record(&deviation)
        };
        let records = series(&it, asked, &settings, &visit, &|_| ()).unwrap();
        assert_eq!(records.len() * records[0].segments, 400);
        let estimate = welch.average(&records);
        let omegas = welch.omega();
        let exact = solve(&it, quantity, &omegas, &to(1e-1));
        let expected = welch.expectation(&exact.correlation(PI / nyquist, 2048));
        // Bonferroni: 1 % shared by all bins, z of 1 - 0.005/1025.
        let band = 4.42;
        let (mut worst, mut sum) = (0.0f64, 0.0);
        for (k, (g, e)) in estimate.iter().zip(&expected).enumerate() {
            let z = (g.value - e) / (g.error / g.value * e);
            worst = worst.max(z.abs());
            sum += z * z;
            assert!(z.abs() < band, "{}: {g} against {e}, z = {z:.1}", omegas[k]);
        }
        let bias = |w: f64| {
            let k = (w / welch.spacing()).round() as usize;
            expected[k] / exact.density[k].value
        };
        println!(
            "{quantity:?}: worst z {worst:.2}, mean square {:.2}; expectation over exact at 0.97: {:.3}, \
             at 4: {:.3}",
            sum / estimate.len() as f64,
            bias(0.97),
            bias(4.0)
        );
        // Neither ignored nor hidden: errors are neither too large nor too small.
        assert!((0.5..2.0).contains(&(sum / estimate.len() as f64)));
        if quantity == Quantity::Displacement {
            assert!(bias(4.0) > 1.2, "what lies beyond 4.3 folds back");
        }
    }
}

/// On the flanks of a peak under weak damping a few records that high energies visited make the whole mean.
#[test]
fn the_errors_of_welch_hold_over_seeds() {
    let (it, quantity, nyquist) = (hertz(2e-3), Quantity::Force, 8.0);
    let welch = Welch::new(1024, 512, PI / nyquist).unwrap();
    let asked = Samples {
        quantity,
        spacing: PI / nyquist,
        samples: welch.record_length(5),
        records: 80,
    };
    let estimates: Vec<Vec<Estimate>> = (0..100)
        .map(|seed| {
            let settings = Sampling {
                seed,
                max_seconds: 100.0,
                ..Sampling::default()
            };
            // E N = 0 exactly.
            let records = series(&it, asked, &settings, &|it| welch.record(it), &|_| ()).unwrap();
            welch.average(&records)
        })
        .collect();
    let seeds = estimates.len() as f64;
    let rms = welch.omega().into_iter().enumerate().map(|(k, omega)| {
        let mean = estimates.iter().map(|it| it[k].value).sum::<f64>() / seeds;
        let z = |it: &Vec<Estimate>| ((it[k].value - mean) / it[k].error).powi(2);
        let square = estimates.iter().map(z).sum::<f64>() / (seeds - 1.0);
        (square.sqrt(), omega)
    });
    let mut rms: Vec<(f64, f64)> = rms.collect();
    rms.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (median, worst) = (rms[rms.len() / 2].0, rms[rms.len() - 1]);
    let above = rms.iter().filter(|it| it.0 > 1.3).count();
    println!(
        "rms of error over standard error: median {median:.2}, above 1.3 in {above} of {} bins, at most {:.2} at {:.2}",
        rms.len(),
        worst.0,
        worst.1
    );
    assert!((0.8..1.1).contains(&median));
    // docs/limits.md has both numbers.
    assert!(15 * above < rms.len() && worst.0 < 2.3);
}

#[test]
fn welch_is_biased_at_a_sharp_peak_and_near_nyquist_as_known() {
    let it = Oscillator::new(ContactLaw::Linear, ZETA, 2e-3).unwrap();
    let damped = (1.0 - ZETA * ZETA).sqrt();
    let correlation = |t: f64| {
        let (sin, cos) = (damped * t).sin_cos();
        it.temperature() * (-ZETA * t).exp() * (cos + ZETA / damped * sin)
    };
    // Derived beforehand: numerics of the two Nyquist frequencies, Hann, 2048 samples.
    for (nyquist, at_peak) in [(4.3, 0.85), (8.6, 0.66)] {
        let step = PI / nyquist;
        let welch = Welch::new(2048, 1024, step).unwrap();
        let lags: Vec<f64> = (0..2048)
            .map(|k| correlation(step * f64::from(k)))
            .collect();
        let expected = welch.expectation(&lags);
        let ratio = |w: f64| {
            let k = (w / welch.spacing()).round() as usize;
            expected[k] / linear(&it, welch.omega()[k])
        };
        println!(
            "Nyquist {nyquist}: {:.3} at the peak, {:.3} at 4",
            ratio(1.0),
            ratio(4.0)
        );
        assert!((ratio(1.0) - at_peak).abs() < 0.02);
        if nyquist == 4.3 {
            assert!((ratio(4.0) - 1.56).abs() < 0.02);
        }
        // Parseval in the mean.
        let inner: f64 = expected[1..1024].iter().sum();
        let integral = welch.spacing() * (inner + 0.5 * (expected[0] + expected[1024]));
        assert!((integral / it.temperature() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn a_scene_gets_both_spectra_with_their_agreement() {
    let mut scene = Scene::new(hertz(2e-3));
    scene.outputs = Outputs {
        spectrum: Some(SpectrumRequest {
            until: 2.5,
            quantity: Quantity::Force,
        }),
        ..Outputs::nothing()
    };
    scene.monte_carlo = Some(MonteCarlo {
        duration: Some(1e5),
        ..MonteCarlo::default()
    });
    scene.method.cells = Some([89, 100]);
    let results = Plan::of(&scene).unwrap().run_quietly().unwrap();
    let it = results.spectrum.as_ref().unwrap();
    assert_eq!(it.solved.functions, [89, 100]);
    assert_eq!(it.linear.len(), it.solved.omega.len());
    assert!((it.solved.omega.last().unwrap() - 2.5).abs() < 1e-9);
    let ratio = it.harmonic_ratio.unwrap();
    assert!((ratio.value - 0.01913).abs() < 1e-3, "{ratio}");
    let agreement = results.agreement.unwrap();
    println!(
        "worst {:.1} of {} numbers",
        agreement.worst, agreement.compared
    );
    assert!(agreement.compared > 500 && agreement.worst < 5.0);
    let json = results.json();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let curve = &json["spectrum"];
    for name in ["fokker_planck", "monte_carlo"] {
        assert_eq!(
            curve[name]["value"].as_array().unwrap().len(),
            curve["omega"].as_array().unwrap().len()
        );
    }
    assert!(
        curve["peaks"][0]["half_power_width"]["value"]
            .as_f64()
            .unwrap()
            > 0.03
    );
}

#[test]
fn the_spectrum_of_an_exponential_correlation_is_a_lorentzian() {
    let step = 0.002;
    let r: Vec<f64> = (0..20_000).map(|k| (-step * f64::from(k)).exp()).collect();
    let (omega, density) = of_correlation(&r, step);
    for (w, g) in omega.iter().zip(&density).take_while(|(w, _)| **w < 4.0) {
        let exact = 2.0 / PI / (1.0 + w * w);
        assert!((g / exact - 1.0).abs() < 1e-4, "{w}: {g} {exact}");
    }
}

/// Numbers without structure, by the golden ratio.
fn record(n: usize) -> Vec<f64> {
    (0..n)
        .map(|k| ((k * k) as f64 * 0.618_033_988_749_894_9).fract() - 0.5)
        .collect()
}

#[test]
fn the_squares_of_a_record_are_the_integral_of_its_spectrum() {
    let welch = Welch::new(64, 32, 0.3).unwrap();
    let record = record(64 + 3 * 32);
    let it = welch.record(&record);
    assert_eq!(it.segments, 4);
    let inner: f64 = it.density[1..32].iter().sum();
    // Both halves of the circle; the ends belong to one.
    let integral = welch.spacing() * (inner + 0.5 * (it.density[0] + it.density[32]));
    let window = |n: usize| (PI * n as f64 / 64.0).sin().powi(2);
    let weighted: f64 = (0..4)
        .flat_map(|s| (0..64).map(move |n| (s, n)))
        .map(|(s, n)| (window(n) * record[s * 32 + n]).powi(2))
        .sum();
    let power: f64 = (0..64).map(|n| window(n).powi(2)).sum();
    let expected = weighted / (4.0 * power);
    assert!(
        (integral / expected - 1.0).abs() < 1e-13,
        "{integral} {expected}"
    );
}

#[test]
fn a_sine_of_amplitude_a_has_the_rms_magnitude_a_over_root_two() {
    let welch = Welch::new(256, 256, 0.1).unwrap();
    let wave: Vec<f64> = (0..256)
        .map(|n| 3.0 * (TAU * 20.0 * f64::from(n) / 256.0).cos())
        .collect();
    let got = welch.magnitude(welch.record(&wave).density[20]);
    assert!((got - 3.0 / 2f64.sqrt()).abs() < 1e-12, "{got}");
    assert!((welch.noise_bandwidth() - 1.5).abs() < 1e-12);
}

#[test]
fn the_expectation_of_white_samples_is_flat_and_that_of_a_cosine_is_its_own_periodogram() {
    let welch = Welch::new(32, 16, 0.5).unwrap();
    for g in welch.expectation(&[2.0]) {
        assert!((g - 2.0 * 0.5 / PI).abs() < 1e-13);
    }
    // x = a cos(w t) + b sin(w t) with independent unit a, b has R = cos(w t).
    let (w, n) = (1.3, 32);
    let wave = |phase: f64| {
        (0..n)
            .map(|k| (w * 0.5 * f64::from(k) - phase).cos())
            .collect::<Vec<_>>()
    };
    let (cosine, sine) = (welch.record(&wave(0.0)), welch.record(&wave(PI / 2.0)));
    let correlation: Vec<f64> = (0..n).map(|k| (w * 0.5 * f64::from(k)).cos()).collect();
    for (k, g) in welch.expectation(&correlation).iter().enumerate() {
        let sum = cosine.density[k] + sine.density[k];
        assert!((g - sum).abs() < 1e-13 * 32.0, "{k}: {g} {sum}");
    }
}

/// The right one of the wells of G = -q + 0.53 q^3 alone: beyond the inflection, which a motion of this noise comes to once in
/// 1e5, the force does not turn.
#[derive(Debug)]
struct RightWell;

impl Restoring for RightWell {
    fn name(&self) -> &'static str {
        "right well"
    }

    fn force(&self, q: f64) -> f64 {
        let q = q.max(1.0 / 1.59f64.sqrt());
        0.53 * q.powi(3) - q
    }

    fn loss_point(&self) -> Option<f64> {
        None
    }
}

/// Two wells between which hops are rare: the peak at 0 is 1e-12 wide, and next to all that is asked lies below 1e-6 of it.
#[test]
fn the_flank_of_a_peak_far_narrower_than_any_frequency_asked_for_has_the_errors_of_the_peak() {
    let text = "[oscillator]\ncontact = { law = \"polynomial\", coefficients = [-1.0, 0.0, 0.53] }\nzeta = 0.188\n\
                h = 0.00219\n[outputs]\nspectrum = { until = 6.0, quantity = \"displacement\" }\ndecay_rates = 1\n\
                [accuracy]\ntolerance = 1e-2\n";
    let text = SceneText::parse("wells", text, &[]).unwrap();
    let results = Plan::of(text.scene()).unwrap().run_quietly().unwrap();
    assert!(results.shortfalls.is_empty());
    let it = &results.spectrum.as_ref().unwrap().solved;
    let peak = it.density[0].value;
    let width = -results.decay_rates.as_ref().unwrap().rates[0].re;
    // A Lorentzian, whose half-width is the rate of hops.
    let flank = it.omega.iter().zip(&it.density);
    let flank: Vec<_> = flank
        .filter(|(w, _)| **w > 0.0 && **w < 1e3 * width)
        .collect();
    println!(
        "{} places within a thousand widths of {width:e}",
        flank.len()
    );
    assert!(flank.len() > 50);
    for (w, g) in flank {
        let lorentzian = peak / (1.0 + (w / width).powi(2));
        assert!((g.value / lorentzian - 1.0).abs() < 1e-2, "{w:e}: {g}");
        assert!(g.error < 1e-2 * g.value.max(1e-6 * peak), "{w:e}: {g}");
    }
    // What a well does by itself is known too, though nothing beside that peak.
    let alone = ContactLaw::custom(RightWell).unwrap();
    let alone = Oscillator::new(alone, 0.188, 0.00219).unwrap();
    let inside = it.omega.iter().zip(&it.density);
    let (omegas, both): (Vec<f64>, Vec<&Estimate>) = inside.filter(|(w, _)| **w > 0.7).unzip();
    let alone = solve(&alone, Quantity::Displacement, &omegas, &to(1e-3));
    for ((w, two), one) in omegas.iter().zip(both).zip(&alone.density) {
        assert!(two.error < 1e-2 * two.value, "{w}: {two}");
        let apart = (two.value / one.value - 1.0).abs();
        assert!(
            apart < 1e-3 + (two.error + one.error) / one.value,
            "{w}: {two} {one}"
        );
    }
    println!("{} places from 0.7 on as in one well", omegas.len());
}

/// The colder of them: hops come once in 1e12, and what a well does is 1e-13 of the peak at 0. It was lost beside that, and the
/// resolutions did not agree on what none of them held.
#[test]
fn what_a_well_does_integrates_to_its_own_variance_beside_hops_that_hardly_ever_come() {
    let wells = Parameters::new().with("coefficients", Parameter::Numbers(vec![-1.0, 0.0, 1.0]));
    let wells = ContactLaw::given("polynomial", &wells).unwrap();
    let wells = Oscillator::new(wells, 0.05, 3e-4).unwrap();
    let got = solve(&wells, Quantity::Displacement, &grid(6.0, 1200), &to(1e-3));
    println!(
        "{:?} functions, {} frequencies solved for",
        got.functions, got.solves
    );
    assert!(got.shortfall.is_none());
    let first = got.omega.partition_point(|w| *w < 0.02);
    let (omegas, density) = (&got.omega[first..], &got.density[first..]);
    for (w, g) in omegas.iter().zip(density) {
        assert!(g.error < 1e-3 * g.value, "{w}: {g}");
    }
    // Down to 0 it is as at the first of these; beyond 6 it is that of the noise on a free mass.
    let beyond = 4.0 / PI * wells.zeta() * wells.temperature() / (3.0 * 6f64.powi(3));
    let integral = omegas[0] * density[0].value + integral(omegas, density) + beyond;
    let weight = |q: f64| (-(0.25 * q.powi(4) - 0.5 * q * q + 0.25) / wells.temperature()).exp();
    let mean = |f: &dyn Fn(f64) -> f64| -> f64 {
        let all = (0..4000).map(|k| 2.0 * (f64::from(k) + 0.5) / 4000.0);
        all.map(|q| f(q) * weight(q)).sum()
    };
    let [one, first, second] = [0, 1, 2].map(|n| mean(&|q| q.powi(n)));
    let variance = second / one - (first / one).powi(2);
    println!("integral {integral:.7}, variance within a well {variance:.7}");
    assert!((integral / variance - 1.0).abs() < 2e-4);
}
