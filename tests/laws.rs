//! Contact laws with parameters: powers, second walls, polynomials, tables.

use std::f64::consts::PI;
use vibroimpact::contact::{ContactLaw, Parameter, Parameters, Restoring};
use vibroimpact::fokker_planck::{Flight, Settings, decay_rates, steady};
use vibroimpact::monte_carlo::{Sampling, records};
use vibroimpact::oscillator::Oscillator;
use vibroimpact::plan::Plan;
use vibroimpact::results::Results;
use vibroimpact::scene::text::SceneText;
use vibroimpact::stationary::Stationary;

fn numbers(all: &[f64]) -> Parameter {
    Parameter::Numbers(all.to_vec())
}

fn power(exponent: f64) -> ContactLaw {
    let given = Parameters::new().with("exponent", Parameter::Number(exponent));
    ContactLaw::given("power", &given).unwrap()
}

fn walled(exponent: f64, gap: f64, back: f64) -> ContactLaw {
    let given = Parameters::new()
        .with("exponent", Parameter::Number(exponent))
        .with("gap", Parameter::Number(gap))
        .with("back", Parameter::Number(back));
    ContactLaw::given("power", &given).unwrap()
}

fn polynomial(coefficients: &[f64]) -> ContactLaw {
    let given = Parameters::new().with("coefficients", numbers(coefficients));
    ContactLaw::given("polynomial", &given).unwrap()
}

fn table(low: f64, high: f64, cells: i32, force: impl Fn(f64) -> f64) -> ContactLaw {
    let at = |k: i32| low + (high - low) * f64::from(k) / f64::from(cells);
    let q: Vec<f64> = (0..=cells).map(at).collect();
    let force: Vec<f64> = q.iter().map(|q| force(*q)).collect();
    let given = Parameters::new()
        .with("q", numbers(&q))
        .with("force", numbers(&force));
    ContactLaw::given("table", &given).unwrap()
}

/// Ten laws of every kind.
fn ten() -> Vec<(&'static str, ContactLaw)> {
    let hertz = |q: f64| (1.0 + q * (2.0 / 3.0)).max(0.0).powf(1.5) - 1.0;
    vec![
        ("power 10/9", power(10.0 / 9.0)),
        ("power 2", power(2.0)),
        ("power 3.7", power(3.7)),
        ("power 3/2, second wall", walled(1.5, 2.0, 1.0)),
        ("power 1, soft second wall", walled(1.0, 0.7, 0.3)),
        ("power 1.2, no gap", walled(1.2, 0.0, 2.0)),
        ("Duffing", polynomial(&[1.0, 0.0, 0.3])),
        ("two wells", polynomial(&[-1.0, 0.0, 1.0])),
        ("two unlike wells", polynomial(&[-1.0, 0.2, 0.8])),
        ("table of Hertz", table(-3.0, 4.0, 70, hertz)),
    ]
}

fn oscillator(contact: &ContactLaw, zeta: f64, temperature: f64) -> Oscillator {
    Oscillator::new(contact.clone(), zeta, 2.0 * zeta * temperature / PI).unwrap()
}

/// The integral of `f` between neighbouring `ends`, by the double exponential rule (Takahasi and Mori, 1974): no part
/// of the library's.
fn integral(ends: &[f64], f: &dyn Fn(f64) -> f64) -> f64 {
    let mut sum = 0.0;
    for w in ends.windows(2) {
        let (a, b) = (w[0], w[1]);
        let h = 1.0 / 64.0;
        let points = (-300..=300).map(|k| f64::from(k) * h);
        sum += points
            .map(|t: f64| {
                let u = 0.5 * PI * t.sinh();
                // Distances from either end, without cancellation.
                let share = 1.0 / (1.0 + (2.0 * u).exp());
                let q = if u < 0.0 {
                    a + (b - a) * (1.0 - share)
                } else {
                    b - (b - a) * share
                };
                let slope = 0.5 * PI * t.cosh() * 2.0 * share * (1.0 - share);
                h * (b - a) * slope * f(q)
            })
            .sum::<f64>();
    }
    sum
}

/// Force and potential written out by hand.
fn by_hand(name: &str, q: f64) -> Option<(f64, f64)> {
    let power = |n: f64, gap: f64, back: f64| {
        let front = (1.0 + q / n).max(0.0);
        let behind = ((-n - gap - q) / n).max(0.0);
        let work = n / (n + 1.0);
        (
            front.powf(n) - 1.0 - back * behind.powf(n),
            work * (front.powf(n + 1.0) - 1.0) - q + back * work * behind.powf(n + 1.0),
        )
    };
    let cubic = |a: f64, b: f64, c: f64| {
        (
            a * q + b * q * q + c * q.powi(3),
            a * q * q / 2.0 + b * q.powi(3) / 3.0 + c * q.powi(4) / 4.0,
        )
    };
    Some(match name {
        "power 10/9" => power(10.0 / 9.0, 0.0, 0.0),
        "power 2" => power(2.0, 0.0, 0.0),
        "power 3.7" => power(3.7, 0.0, 0.0),
        "power 3/2, second wall" => power(1.5, 2.0, 1.0),
        "power 1, soft second wall" => power(1.0, 0.7, 0.3),
        "power 1.2, no gap" => power(1.2, 0.0, 2.0),
        "Duffing" => cubic(1.0, 0.0, 0.3),
        "two wells" => cubic(-1.0, 0.0, 1.0),
        "two unlike wells" => cubic(-1.0, 0.2, 0.8),
        _ => return None,
    })
}

/// Where the force passes n.
fn passes(force: &dyn Fn(f64) -> f64, n: f64, [low, high]: [f64; 2]) -> Vec<f64> {
    let at = |k: i32| low + (high - low) * f64::from(k) / 5000.0;
    let mut all = Vec::new();
    for k in 0..5000 {
        let (mut a, mut b) = (at(k), at(k + 1));
        if (force(a) < n) == (force(b) < n) {
            continue;
        }
        for _ in 0..60 {
            let middle = 0.5 * (a + b);
            if (force(middle) < n) == (force(a) < n) {
                a = middle;
            } else {
                b = middle;
            }
        }
        all.push(a);
    }
    all
}

#[test]
fn the_closed_form_of_ten_laws_is_that_of_an_independent_quadrature() {
    let mut worst: f64 = 0.0;
    for (name, contact) in ten() {
        for t in [0.02, 0.63, 8.0] {
            let law = Stationary::of(&oscillator(&contact, 0.05, t)).unwrap();
            let (low, high) = contact.turning_points(60.0 * t).unwrap();
            let mut ends: Vec<f64> = (1..40)
                .map(|k| low + (high - low) * f64::from(k) / 40.0)
                .collect();
            ends.extend([low, high]);
            ends.extend(contact.kinks());
            if by_hand(name, 0.0).is_none() {
                // Knots of the table.
                ends.extend((-30..=40).map(|k| f64::from(k) * 0.1));
            }
            ends.retain(|q| *q >= low && *q <= high);
            ends.sort_by(f64::total_cmp);
            let force = |q: f64| by_hand(name, q).map_or_else(|| contact.force(q), |it| it.0);
            let potential =
                |q: f64| by_hand(name, q).map_or_else(|| contact.potential(q), |it| it.1);
            let lowest = contact.potential(contact.equilibrium().unwrap());
            let weight = |q: f64| (-(potential(q) - lowest) / t).exp();
            let z = integral(&ends, &weight);
            let mean = |f: &dyn Fn(f64) -> f64| integral(&ends, &|q| f(q) * weight(q)) / z;
            let q1 = mean(&|q| q);
            let n2 = mean(&|q| force(q).powi(2));
            let lost = contact.flight().map(|[a, b]| {
                let inside = |q: &f64| *q >= a.max(low) && *q <= b;
                let ends: Vec<f64> = ends.iter().copied().filter(inside).collect();
                integral(&ends, &weight) / z
            });
            let exact = [
                ("mean_q", q1, q1.abs().max(1.0)),
                ("var_q", mean(&|q| (q - q1).powi(2)), 0.0),
                ("mean_force", 0.0, n2.sqrt()),
                ("std_force", n2.sqrt(), 0.0),
                (
                    "skewness_force",
                    mean(&|q| force(q).powi(3)) / n2.powf(1.5),
                    1.0,
                ),
                (
                    "kurtosis_force",
                    mean(&|q| force(q).powi(4)) / n2.powi(2),
                    0.0,
                ),
                ("mean_energy", 0.5 * t + mean(&potential), t),
                ("contact_loss_probability", lost.unwrap_or(f64::NAN), 0.0),
            ];
            let got = law.moments();
            for (key, exact, scale) in exact {
                let number = got.named().into_iter().find(|it| it.0 == key).unwrap().1;
                assert_eq!(number.is_none(), exact.is_nan(), "{name}: {key}");
                let Some(number) = number else { continue };
                // A loss beyond the levels integrated here.
                if key == "contact_loss_probability" && exact < 1e-15 {
                    continue;
                }
                let scale = if scale == 0.0 { exact.abs() } else { scale };
                let error = (number.value - exact).abs() / scale;
                worst = worst.max(error);
                assert!(
                    error < 1e-12,
                    "{name}, T = {t}: {key} = {number}, {exact} expected: {error:.1e}"
                );
                assert!(
                    (number.value - exact).abs() <= number.error + 2e-14 * scale,
                    "{name}, T = {t}: {key}"
                );
            }
            // E[q G] = T, and the law of the force from its two sides.
            let virial = mean(&|q| q * force(q));
            assert!((virial / t - 1.0).abs() < 1e-12, "{name}: {virial}");
            for q in [0.3, 1.1] {
                let n = contact.force(q);
                let mut ends = ends.clone();
                ends.extend(passes(&force, n, [low, high]));
                ends.sort_by(f64::total_cmp);
                let below: f64 = ends
                    .windows(2)
                    .filter(|w| force(0.5 * (w[0] + w[1])) <= n)
                    .map(|w| integral(w, &weight) / z)
                    .sum();
                let got = law.distribution_force(n);
                assert!(
                    (got - below).abs() < 1e-11,
                    "{name}, N = {n}: {got} {below}"
                );
            }
        }
    }
    println!("ten laws, three temperatures: closed forms within {worst:.1e}");
}

#[test]
fn the_steady_state_on_the_mesh_is_the_stationary_law_of_every_law() {
    for (name, contact) in ten() {
        let it = oscillator(&contact, 0.05, 0.63);
        let settings = Settings {
            cells: Some([90, 60]),
            ..Settings::default()
        };
        let answer = steady(&it, &settings).unwrap();
        println!("{name}: {:.1e}", answer.l1_error.value);
        assert!(answer.l1_error.value < 1e-10, "{name}");
    }
}

/// Two springs at q = 1 and q = -1, and nothing in between.
#[derive(Debug)]
struct DeadZone(f64);

impl Restoring for DeadZone {
    fn name(&self) -> &'static str {
        "dead zone"
    }
    fn force(&self, q: f64) -> f64 {
        let depth = (q.abs() - 1.0).max(0.0);
        q.signum() * depth.powf(self.0)
    }
    fn potential(&self, q: f64) -> f64 {
        (q.abs() - 1.0).max(0.0).powf(self.0 + 1.0) / (self.0 + 1.0)
    }
    fn loss_point(&self) -> Option<f64> {
        Some(1.0)
    }
    fn back_wall(&self) -> Option<f64> {
        Some(-1.0)
    }
}

#[test]
fn odd_moments_of_a_symmetric_gap_vanish_to_rounding() {
    for exponent in [1.0, 1.5] {
        let contact = ContactLaw::custom(DeadZone(exponent)).unwrap();
        let it = oscillator(&contact, 0.05, 0.5);
        let law = Stationary::of(&it).unwrap().moments();
        for (name, number) in law.named() {
            if matches!(name, "mean_q" | "mean_force" | "skewness_force") {
                let number = number.unwrap();
                println!("n = {exponent}: {name} = {number}");
                assert!(number.value.abs() < 1e-13, "{name}");
            }
        }
        // In transit, from a symmetric start: the mesh is its own mirror image.
        let text = "[oscillator]\nzeta = 0.05\nh = 2e-2\n[initial]\nmean = [0.0, 0.0]\ndeviation = [0.7, 0.6]\n\
                    [outputs]\nmoments_at = [1, 4]";
        let mut scene = SceneText::parse("a.toml", text, &[])
            .unwrap()
            .scene()
            .clone();
        scene.oscillator = it;
        let results = Plan::of(&scene).unwrap().run_quietly().unwrap();
        for (t, name, number) in moments(&results) {
            if matches!(
                name.as_str(),
                "mean_q" | "mean_force" | "skewness_force" | "mean_v"
            ) {
                println!("n = {exponent}, t = {t}: {name} = {number:.1e}");
                // The mesh is symmetric; what is left, 1e-6 at most, is of another origin.
                assert!(number.abs() < 5e-6, "{name} at {t}: {number}");
            }
        }
    }
}

/// Time, name and value of every transient moment.
fn moments(results: &Results) -> Vec<(f64, String, f64)> {
    let tree = results.tree();
    let transient = tree["transient"].as_object().unwrap();
    let times = transient["t"].as_array().unwrap();
    let mut all = Vec::new();
    for (name, it) in transient {
        for (t, value) in times
            .iter()
            .zip(it["value"].as_array().into_iter().flatten())
        {
            if let Some(value) = value.as_f64() {
                all.push((t.as_f64().unwrap(), name.clone(), value));
            }
        }
    }
    all
}

/// Runs a scene; its agreement with Monte Carlo, and whether every number reached the tolerance.
fn agreement(contact: &str, more: &str) -> (f64, Results) {
    let text = format!("[oscillator]\ncontact = {contact}\n{more}");
    let scene =
        SceneText::parse("a.toml", &text, &[]).unwrap_or_else(|it| panic!("{contact}: {it}"));
    let results = Plan::of(scene.scene()).unwrap().run_quietly().unwrap();
    let it = results.agreement.unwrap();
    println!(
        "{contact}: worst z {:.2} of {} at {:?}, {} compared",
        it.worst, it.worst_of, it.t, it.compared
    );
    for warning in &results.run.warnings {
        println!("    {warning:?}");
    }
    (it.worst, results)
}

/// Transient moments, long realisations and losses, by both.
const BOTH: &str = "zeta = 0.05\nh = 2e-2\n[initial]\nmean = [0.5, 0.5]\ndeviation = [0.4, 0.4]\n[outputs]\n\
                    stationary = true\nmoments_at = [1, 3, 10]\n[monte_carlo]\npaths = 100_000\nduration = 4e4";

#[test]
fn transients_of_a_power_agree_with_monte_carlo() {
    for exponent in ["1.1111", "2.5"] {
        let law = format!("{{ law = \"power\", exponent = {exponent} }}");
        let (z, _) = agreement(
            &law,
            &format!(
                "{}\n",
                BOTH.replace(
                    "stationary = true",
                    "stationary = true\ncrossings = { window = 20 }"
                )
            ),
        );
        assert!(z <= 4.0);
    }
}

#[test]
fn transients_between_two_walls_agree_with_monte_carlo() {
    for rest in [
        "exponent = 1.5, gap = 1.0, back = 1.0",
        "exponent = 1.0, gap = 0.4, back = 0.5",
    ] {
        let law = format!("{{ law = \"power\", {rest} }}");
        let more = BOTH.replace(
            "stationary = true",
            "stationary = true\ncrossings = { window = 20 }",
        );
        let (z, results) = agreement(&law, &more);
        assert!(z <= 4.0);
        // No closed form of the flights: Monte Carlo's alone.
        assert!(results.flights.is_none());
        let seen = results.tree()["crossings"]["flight_time"].clone();
        println!("    flights {:.60}", seen.to_string());
    }
}

#[test]
fn transients_of_polynomials_agree_with_monte_carlo() {
    for law in ["[1.0, 0.0, 0.3]", "[-1.0, 0.0, 1.0]", "[-0.6, 0.2, 0.8]"] {
        let (z, _) = agreement(
            &format!("{{ law = \"polynomial\", coefficients = {law} }}"),
            BOTH,
        );
        assert!(z <= 4.0);
    }
}

#[test]
fn transients_of_a_table_agree_with_monte_carlo() {
    let at = |k: i32| f64::from(k) * 0.25;
    let list = |f: &dyn Fn(f64) -> f64| {
        let all: Vec<String> = (-14..=16).map(|k| format!("{:?}", f(at(k)))).collect();
        format!("[{}]", all.join(", "))
    };
    let q = list(&|q| q);
    let wavy = list(&|q| q + 0.4 * (2.0 * q).sin());
    let flown = list(&|q| (1.0 + q / 1.5).max(0.0).powf(1.5) - 1.0);
    for force in [wavy, flown] {
        let (z, _) = agreement(
            &format!("{{ law = \"table\", q = {q}, force = {force} }}"),
            BOTH,
        );
        assert!(z <= 4.0);
    }
}

#[test]
fn the_slowest_rate_of_two_wells_tends_to_kramers_as_the_temperature_falls() {
    // U = q^4/4 - q^2/2: wells of frequency sqrt 2 at +-1, a barrier of 1/4 and frequency 1 at 0. Kramers (1940) at
    // moderate friction; the eigenvalue is twice the rate of escape.
    let contact = polynomial(&[-1.0, 0.0, 1.0]);
    assert!((contact.barrier().unwrap() - 0.25).abs() < 1e-15);
    let friction: f64 = 1.0;
    let mut last = f64::INFINITY;
    for t in [0.06, 0.04, 0.025, 0.0175] {
        let it = oscillator(&contact, 0.5 * friction, t);
        let rates = decay_rates(&it, 2, &Settings::default()).unwrap();
        let slow = &rates.rates[0];
        let climb = (0.25 * friction * friction + 1.0).sqrt() - 0.5 * friction;
        let escape = climb * 2f64.sqrt() / (2.0 * PI) * (-0.25 / t).exp();
        let ratio = -slow.re / (2.0 * escape);
        println!(
            "T = {t}: {:.6e} ± {:.0e}, over Kramers' {ratio:.4}",
            slow.re, slow.error
        );
        assert!(slow.im == 0.0 && slow.error < 2e-3 * -slow.re, "{rates:?}");
        assert!((ratio - 1.0).abs() < last, "{ratio} after {last}");
        last = (ratio - 1.0).abs();
    }
    assert!(last < 0.1, "{last}");
}

#[test]
fn a_scene_with_a_law_is_its_own_resolved_form() {
    for law in [
        "{ law = \"power\", exponent = 1.1111 }",
        "{ law = \"power\", exponent = 2, gap = 0.5 }",
        "{ law = \"polynomial\", coefficients = [-1.0, 0.0, 1.0] }",
        "{ law = \"table\", q = [-1, 0, 1], force = [-1, 0, 2] }",
    ] {
        let text = format!("title = \"a\"\n[oscillator]\ncontact = {law}\nzeta = 0.05\nh = 2e-2");
        let one = SceneText::parse("a.toml", &text, &[])
            .unwrap()
            .scene()
            .clone();
        let toml = one.to_toml();
        let two = SceneText::parse("b.toml", &toml, &[])
            .unwrap()
            .scene()
            .clone();
        assert_eq!(one, two, "{toml}");
    }
    let hertz =
        "[oscillator]\ncontact = { law = \"power\", exponent = 1.5 }\nzeta = 0.05\nh = 2e-2";
    let hertz = SceneText::parse("a.toml", hertz, &[])
        .unwrap()
        .scene()
        .clone();
    assert_eq!(*hertz.oscillator.contact(), ContactLaw::Hertz);
}

#[test]
fn the_file_of_a_table_stands_beside_its_scene_and_the_resolved_scene_stands_alone() {
    let room = std::env::temp_dir().join(format!("vibroimpact-laws-{}", std::process::id()));
    std::fs::create_dir_all(&room).unwrap();
    std::fs::write(
        room.join("force.csv"),
        "# measured\nq, G\n-3, -1\n-1.5,-1\n0,0\n1,1.2\n2.5,4\n",
    )
    .unwrap();
    let text =
        "[oscillator]\ncontact = { law = \"table\", file = \"force.csv\" }\nzeta = 0.05\nh = 2e-2";
    let name = room.join("scene.toml").display().to_string();
    let scene = SceneText::parse(&name, text, &[]).unwrap().scene().clone();
    let contact = scene.oscillator.contact();
    assert_eq!(contact.loss_point(), Some(-1.5));
    assert_eq!(
        [contact.force(-9.0), contact.force(0.0), contact.force(1.0)],
        [-1.0, 0.0, 1.2]
    );
    std::fs::remove_dir_all(&room).unwrap();
    let alone = SceneText::parse("elsewhere.toml", &scene.to_toml(), &[]).unwrap();
    assert_eq!(*alone.scene(), scene);
    for (text, word) in [
        ("q,G\n0,0\n1,nan\n", "line 3"),
        ("G,q\n-1,-2\n0,0\n", "line 1: G,q"),
        (
            "displacement_um,force_N\n-1,-1\n1,2\n",
            "line 1: displacement_um",
        ),
        ("0,0\n1,1\n1,2\n", "line 3: q = 1.0"),
        ("0,0\n1,one\n", "line 2"),
        ("0,0\n1,1,1\n", "line 2"),
        ("0,0\n", "1 point "),
        ("0,0\n1,-1\n", "first point"),
    ] {
        std::fs::create_dir_all(&room).unwrap();
        std::fs::write(room.join("force.csv"), text).unwrap();
        let scene = "[oscillator]\ncontact = { law = \"table\", file = \"force.csv\" }\nzeta = 0.05\nh = 2e-2";
        let error = SceneText::parse(&name, scene, &[]).unwrap_err();
        assert_eq!(error.key(), Some("oscillator.contact.file"));
        assert!(error.to_string().contains(word), "{error}");
    }
    std::fs::remove_dir_all(&room).unwrap();
}

#[test]
fn spectra_first_losses_and_starts_from_rest_agree_with_monte_carlo_between_two_walls() {
    let more = "zeta = 0.1\nh = 4e-2\n[outputs]\nmoments_at = [2, 10]\nspectrum = { until = 3.0 }\n\
                first_loss = { until = 20 }\ndecay_rates = 2\n[monte_carlo]\npaths = 50_000\n[accuracy]\ntolerance = 1e-2";
    let law = "{ law = \"power\", exponent = 1.5, gap = 1.0, back = 0.5 }";
    let (z, results) = agreement(law, more);
    assert!(z <= 4.5, "{z} over hundreds of numbers");
    assert_eq!(results.decay_rates.unwrap().continuous_from, None);
}

#[test]
fn the_joint_law_of_an_impact_is_that_of_long_records() {
    let it = Oscillator::new(ContactLaw::Hertz, 0.02, 8e-2).unwrap();
    let settings = Sampling {
        duration: 4e5,
        ..Sampling::default()
    };
    let seen = records(&it, &settings, &|_| ()).unwrap().crossings.unwrap();
    let flight = Flight::of(&it).unwrap();
    let impacts = &seen.impacts;
    let mean = |t: &[f64], c: &[f64]| {
        // Midpoints of sixty-four parts of a cell.
        let at = |w: &[f64], k: u32| w[0] + (w[1] - w[0]) * (f64::from(k) + 0.5) / 8.0;
        let parts = (0..8).flat_map(|i| (0..8).map(move |j| (i, j)));
        parts
            .map(|(i, j)| flight.joint(at(t, i), at(c, j)).value)
            .sum::<f64>()
            / 64.0
    };
    let columns = impacts.speeds.len() - 1;
    let (mut squares, mut worst, mut count) = (0.0, 0.0f64, 0.0);
    let peak = impacts
        .density
        .iter()
        .map(|it| it.value)
        .fold(0.0, f64::max);
    for (i, t) in impacts.times.windows(2).enumerate() {
        for (j, c) in impacts.speeds.windows(2).enumerate() {
            let seen = impacts.density[i * columns + j];
            if seen.value > 0.05 * peak {
                let z = (seen.value - mean(t, c)) / seen.error;
                squares += z * z;
                count += 1.0;
                worst = worst.max(z.abs());
            }
        }
    }
    println!(
        "{count} cells: worst z {worst:.2}, root of the mean square {:.2}",
        (squares / count).sqrt()
    );
    assert!(count > 20.0 && worst < 4.5 && squares / count < 2.0);
    let edges = seen.impact_speed.edges.windows(2);
    for (w, it) in edges.zip(&seen.impact_speed.density) {
        let below = |c: f64| 1.0 - (-0.5 * c * c / it_temperature()).exp();
        let exact = (below(w[1]) - below(w[0])) / (w[1] - w[0]);
        assert!(
            (it.value - exact).abs() < 5.0 * it.error,
            "{w:?}: {it}, {exact}"
        );
    }
}

/// pi h/(2 zeta) of the records above.
fn it_temperature() -> f64 {
    2.0 * PI
}
