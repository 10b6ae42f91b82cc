//! What a user of the first hour relies on: times in the unit of the scene everywhere, the time to a level, numbers of a rig
//! beside the dimensionless ones.

use serde_json::Value;
use vibroimpact::moments::Moment;
use vibroimpact::plan::Plan;
use vibroimpact::report;
use vibroimpact::results::Results;
use vibroimpact::rig::Rig;
use vibroimpact::scene::text::SceneText;

fn run(text: &str) -> Results {
    let text = SceneText::parse("scene", text, &[]).unwrap();
    Plan::of(text.scene()).unwrap().run_quietly().unwrap()
}

/// Var q, Cov qv, Var v of the linear oscillator from rest at time t, by classical Runge-Kutta steps.
fn linear(zeta: f64, h: f64, t: f64) -> [f64; 3] {
    spread([0.0; 2], zeta, h, t)
}

/// The same from these variances of q and v.
fn spread([q, v]: [f64; 2], zeta: f64, h: f64, t: f64) -> [f64; 3] {
    let rate = |[q, c, v]: [f64; 3]| {
        let noise = 2.0 * std::f64::consts::PI * h;
        [
            2.0 * c,
            v - q - 2.0 * zeta * c,
            -2.0 * c - 4.0 * zeta * v + noise,
        ]
    };
    let steps = (t / 1e-3).ceil().max(1.0);
    let dt = t / steps;
    let add = |x: [f64; 3], k: [f64; 3], f: f64| std::array::from_fn(|i| x[i] + f * k[i]);
    let mut x = [q, 0.0, v];
    for _ in 0..steps as u64 {
        let a = rate(x);
        let b = rate(add(x, a, 0.5 * dt));
        let c = rate(add(x, b, 0.5 * dt));
        let d = rate(add(x, c, dt));
        x = std::array::from_fn(|i| x[i] + dt / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
    }
    x
}

/// The first time at which `f` is above 0, by small steps and bisection.
fn first(f: impl Fn(f64) -> f64) -> f64 {
    let mut high = 0.05;
    while f(high) < 0.0 {
        high += 0.05;
    }
    let mut low = high - 0.05;
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if f(middle) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

#[test]
fn rungs_that_do_not_hold_the_scene_are_passed_over_after_an_answer_too() {
    // E[H] and std N at t = 10, by the times [10] alone, by finite volumes and by 160 x 160 cells.
    for key in ["", "[method]\nstep = 0.05\n"] {
        let it = run(&format!(
            "[oscillator]\ncontact = {{ law = \"polynomial\", coefficients = [1, 0, 0.5] }}\nzeta = 0.05\nh = 0.0569\n\
             [outputs]\nmoments_at = [1, 10]\n{key}"
        ));
        let it = it.transient.unwrap();
        assert!(it.shortfall.is_none(), "{:?}", it.shortfall);
        for (number, known) in [
            (it.moments[1].mean_energy, 1.077_926),
            (it.moments[1].std_force, 1.550_952),
        ] {
            assert!((number.value - known).abs() < 1e-6 + number.error && number.error < 2e-5);
        }
    }
}

#[test]
fn the_kurtosis_of_a_force_without_stiffness_at_rest_begins_where_a_gaussian_puts_it() {
    // N = q^3: 10395/225 = 46.2 at first, above three times the stationary value, which is not reached at once.
    let scene = |outputs: &str| {
        format!(
            "[oscillator]\ncontact = {{ law = \"polynomial\", coefficients = [0, 0, 1] }}\nzeta = 0.05\nh = 0.02\n\
             [outputs]\nstationary = true\n{outputs}\n[accuracy]\ntolerance = 0.1\n"
        )
    };
    let it = run(&scene(
        "reach = { quantity = \"kurtosis_force\", fraction = 3 }",
    ));
    let t = it.reach.as_ref().unwrap().t.unwrap();
    let level = 3.0 * it.stationary.unwrap().get("kurtosis_force").unwrap().value;
    let it = run(&scene(&format!("moments_at = [0.01, {}]", t.value))).transient;
    let [first, there] = it.unwrap().moments[..] else {
        panic!()
    };
    assert!((first.kurtosis_force.value - 46.2).abs() < 0.5);
    let apart = (there.kurtosis_force.value / level - 1.0).abs();
    println!("t = {t}: {} against {level}", there.kurtosis_force);
    assert!(t.value > 1.0 && apart < 3e-2);
}

#[test]
fn trapezoids_over_a_spectrum_hold_the_variance_however_narrow_its_peak_is() {
    for zeta in [5e-4, 0.05] {
        let it = run(&format!(
            "[oscillator]\ncontact = \"linear\"\nzeta = {zeta}\nh = {}\n[outputs]\nspectrum = {{ until = 4 }}\n",
            0.1 * zeta
        ));
        let it = it.spectrum.unwrap().solved;
        let both = it.omega.windows(2).zip(it.density.windows(2));
        let area: f64 = both
            .map(|(w, g)| 0.5 * (w[1] - w[0]) * (g[0].value + g[1].value))
            .sum();
        let variance = std::f64::consts::FRAC_PI_2 * 0.1;
        println!(
            "zeta = {zeta}: {} frequencies hold {:.5}",
            it.omega.len(),
            area / variance
        );
        assert!((area / variance - 1.0).abs() < 2e-3);
        assert!(it.omega.len() < 1200);
        for (omega, number) in it.omega.iter().zip(&it.density) {
            let stiff = 1.0 - omega * omega;
            let exact = 0.2 * zeta / (stiff * stiff + (2.0 * zeta * omega).powi(2));
            assert!(
                (number.value - exact).abs() <= number.error,
                "{omega}: {number}"
            );
        }
    }
}

#[test]
fn a_linear_oscillator_reaches_a_part_of_its_energy_when_the_covariance_says() {
    // The last three cross between the first two times of a course.
    for (zeta, h, moment, fraction) in [
        (0.05, 0.02, Moment::MeanEnergy, 0.9),
        (0.05, 0.02, Moment::VarQ, 0.5),
        (0.05, 0.02, Moment::VarV, 0.3),
        (0.05, 0.02, Moment::StdForce, 0.8),
        (0.3, 0.06, Moment::VarQ, 1e-3),
        (2.0, 0.4, Moment::MeanEnergy, 0.4),
        (6.0, 2.7, Moment::VarV, 0.9),
    ] {
        let t = std::f64::consts::PI * h / (2.0 * zeta);
        let name = moment.name();
        let it = run(&format!(
            "[oscillator]\ncontact = \"linear\"\nzeta = {zeta}\nh = {h}\n[outputs]\nreach = {{ quantity = \
             \"{name}\", fraction = {fraction} }}"
        ));
        let exact = first(|time| {
            let [q, _, v] = linear(zeta, h, time);
            let part = match moment {
                Moment::MeanEnergy => 0.5 * (q + v) / t,
                Moment::VarQ => q / t,
                Moment::VarV => v / t,
                _ => (q / t).sqrt(),
            };
            part - fraction
        });
        let reached = it.reach.as_ref().unwrap();
        let found = reached.t.unwrap();
        let error = (found.value - exact).abs();
        println!(
            "{name} to {fraction}: {found}, exact {exact:.6}, error {error:.1e}; {:?}",
            reached.shortfall
        );
        assert!(error <= found.error, "{name}: {error:e}");
        assert!(
            found.error <= 1e-3 * exact && it.shortfalls.is_empty(),
            "{name}"
        );
        let tree = it.tree();
        assert_eq!(tree["reach"]["quantity"], name);
        assert_eq!(tree["reach"]["fraction"], fraction);
        assert_eq!(tree["reach"]["t"]["value"], found.value);
    }
}

/// What passes for less than the time between two of a course: var q of a linear oscillator through 1.136 T for a tenth of a
/// period, and var v in its first dip.
#[test]
fn an_extremum_between_two_times_reaches_a_level_too() {
    for (zeta, h, deviation, (moment, fraction), tolerance) in [
        (0.00571, 2.454e-4, [0.364, 0.292], (0, 1.136), 1e-2),
        (0.00571, 2.454e-4, [0.364, 0.292], (0, 1.136), 1e-4),
        (0.01, 2e-3, [0.2, 0.9], (2, 0.157), 1e-3),
    ] {
        let name = ["var_q", "", "var_v"][moment];
        let it = run(&format!(
            "[oscillator]\ncontact = \"linear\"\nzeta = {zeta}\nh = {h}\n[initial]\ndeviation = {deviation:?}\n\
             [outputs]\nreach = {{ quantity = \"{name}\", fraction = {fraction} }}\n[accuracy]\ntolerance = {tolerance}"
        ));
        let level = fraction * std::f64::consts::PI * h / (2.0 * zeta);
        let squares = deviation.map(|it| it * it);
        let exact = first(|t| level - spread(squares, zeta, h, t)[moment]);
        let found = it.reach.as_ref().unwrap().t.unwrap();
        println!("{name} to {fraction}: {found}, exact {exact:.6}");
        assert!(
            (found.value - exact).abs() <= found.error,
            "{found}, {exact}"
        );
        assert!(found.error <= tolerance * exact && it.shortfalls.is_empty());
    }
}

#[test]
fn a_level_is_reached_within_the_first_quarter_of_a_fast_period() {
    let it = run(
        "[oscillator]\ncontact = { law = \"polynomial\", coefficients = [100] }\nzeta = 0.05\nh = 0.03\n\
         [initial]\ndeviation = [0.1, 0.3]\n[outputs]\nreach = { quantity = \"var_q\", fraction = 0.5 }",
    );
    // The same with time in units of 1/10: zeta/10, h/1000, v over 10.
    let exact = 0.1 * {
        let (zeta, h): (f64, f64) = (5e-3, 3e-5);
        let t = std::f64::consts::PI * h / (2.0 * zeta);
        first(|time| 0.5 * t - spread([0.01, 9e-4], zeta, h, time)[0])
    };
    let found = it.reach.as_ref().unwrap().t.unwrap();
    println!("{found}, exact {exact:.7}");
    assert!((found.value - exact).abs() <= found.error && found.error < 1e-3 * exact);
}

/// Its periods are twenty times shorter than the unit of time, and so are the steps of whatever moves with it.
#[test]
fn a_fast_oscillator_spreads_from_rest_as_its_covariance_says() {
    let (zeta, h, fast) = (0.02, 0.08, 20.0);
    let it = run(&format!(
        "[oscillator]\ncontact = {{ law = \"polynomial\", coefficients = [400] }}\nzeta = {zeta}\nh = {h}\n\
         [outputs]\nmoments_at = [0.07, 3.33]\n[accuracy]\ntolerance = 1e-2"
    ));
    let it = it.transient.unwrap();
    for (t, moments) in it.times.iter().zip(&it.moments) {
        let [q, _, v] = linear(zeta / fast, h / f64::powi(fast, 3), t * fast);
        for (name, exact) in [
            (Moment::VarQ, q),
            (Moment::VarV, v * fast * fast),
            (Moment::StdForce, fast * fast * q.sqrt()),
        ] {
            let found = moments.get(name).unwrap();
            println!("{name:?} at {t}: {found}, exact {exact:.5e}");
            assert!((found.value - exact).abs() <= found.error, "{name:?}");
        }
    }
}

#[test]
fn a_level_that_is_passed_only_from_above_is_reached_from_above_or_never() {
    let scene = |zeta: f64, fraction: f64| {
        format!(
            "[oscillator]\ncontact = \"linear\"\nzeta = {zeta}\nh = {}\n[initial]\ndeviation = [0.8, 0.8]\n\
             [outputs]\nreach = {{ quantity = \"mean_energy\", fraction = {fraction} }}\n\
             [accuracy]\ntolerance = 1e-2",
            0.2 * zeta
        )
    };
    // From 2.04 times the stationary value the energy falls as exp(-2 zeta t): an equal spread of q and v leaves out
    // oscillations to first order.
    let t = std::f64::consts::PI * 0.02 / 0.2;
    let it = run(&scene(0.1, 1.5));
    let found = it.reach.unwrap().t.unwrap();
    let roughly = ((0.64 / t - 1.0) / 0.5).ln() / 0.2;
    println!("{found}, roughly {roughly:.2}");
    assert!((found.value - roughly).abs() < 0.6, "{found}");
    let it = run(&scene(0.4, 0.5));
    assert_eq!(it.reach.as_ref().unwrap().t, None);
    assert!(it.tree()["reach"]["t"].is_null());
    let warnings: Vec<&str> = it.run.warnings.iter().map(|it| it.text.as_str()).collect();
    assert!(
        warnings
            .iter()
            .any(|it| it.starts_with("reach: mean_energy")),
        "{warnings:?}"
    );
}

/// Three times the stationary energy is never reached, which a course shows that has come to rest.
#[test]
fn a_level_far_beyond_the_stationary_value_is_reached_at_no_time() {
    let it = run(
        "[oscillator]\nzeta = 0.05\nh = 0.02\n[outputs]\nreach = { quantity = \"mean_energy\", fraction = 3 }",
    );
    assert!(it.shortfalls.is_empty(), "{:?}", it.shortfalls);
    assert_eq!(it.reach.unwrap().t, None);
}

/// Flights so high that the continuous spectrum is slower than friction by far: Var q still rises at ten times 2 zeta.
#[test]
fn a_level_that_only_long_flights_come_to_is_waited_for() {
    let head = "[oscillator]\nzeta = 1\nh = 10\n[accuracy]\ntolerance = 1e-2\n[outputs]\n";
    let it = run(&format!(
        "{head}stationary = true\nreach = {{ quantity = \"var_q\", fraction = 0.9 }}\n"
    ));
    assert!(it.shortfalls.is_empty(), "{:?}", it.run.warnings);
    let (t, stationary) = (it.reach.unwrap().t.unwrap(), it.stationary.unwrap());
    let level = 0.9 * stationary.get("var_q").unwrap().value;
    let times = [t.value - 2.0 * t.error, t.value + 2.0 * t.error];
    let it = run(&format!("{head}moments_at = {times:?}\n"))
        .transient
        .unwrap();
    let [before, after] = [0, 1].map(|k| it.moments[k].var_q);
    println!("{t}: {before} and {after} about {level}");
    assert!(t.value > 20.0);
    assert!(before.value - before.error < level && level < after.value + after.error);
}

#[test]
fn numbers_at_time_zero_alone_and_moments_that_do_not_exist_there_are_no_reason_to_refuse() {
    let head = "[oscillator]\nzeta = 0.05\nh = 0.02\n[outputs]\n";
    let it = run(&format!("{head}moments_at = [0]\n"));
    let moments = it.transient.unwrap().moments[0];
    assert_eq!((moments.mean_q.value, moments.var_v.value), (0.0, 0.0));
    // From rest the force has no skewness at t = 0, and has a tenth of it later.
    let reached = |fraction: f64| {
        let it = run(&format!(
            "{head}reach = {{ quantity = \"skewness_force\", fraction = {fraction} }}\n[accuracy]\ntolerance = 1e-2\n"
        ));
        it.reach.as_ref().unwrap().t.unwrap().value
    };
    let (early, late) = (reached(0.05), reached(0.5));
    assert!(
        early > 0.0 && early < 0.6 && late > 0.5 && late < 50.0,
        "{early} {late}"
    );
}

/// A scene with every output that has a time. In the unit times have four digits; without one they are the same, times
/// `length`.
fn scene(unit: Option<&str>, length: f64) -> String {
    let scale = if unit.is_some() { 1.0 } else { length };
    let of = |t: f64| format!("{:?}", typed(t, length) * scale);
    let window = if unit.is_some() {
        of(0.01 * Rig::default().time(1.0))
    } else {
        format!(
            "{:?}",
            Rig::default().seconds(typed(0.01 * Rig::default().time(1.0), length) * length)
        )
    };
    let unit = unit.map_or(String::new(), |it| format!("time_unit = \"{it}\"\n"));
    format!(
        "[oscillator]\nzeta = 0.05\nh = 0.02\n[rig]\nstatic_load = 110\nfrequency = 232\nstatic_compression = 7e-6\n\
         [initial]\ndeviation = [0.8, 0.8]\n[outputs]\nstationary = true\nmoments_at = [{}, {}]\ndensity_at = [{}]\n\
         decay_rates = 1\nfirst_loss = {{ until = {} }}\n\
         first_passage = {{ level = 1.2, side = \"above\", until = {} }}\ncrossings = {{ window = {window} }}\n\
         reach = {{ quantity = \"std_force\", fraction = 1.02 }}\n{unit}[monte_carlo]\npaths = 300\nduration = {}\n\
         [accuracy]\ntolerance = 5e-2\n",
        of(2.0),
        of(4.0),
        of(4.0),
        of(8.0),
        of(6.0),
        of(400.0),
    )
}

/// A dimensionless time in units of this length, to four digits.
fn typed(t: f64, length: f64) -> f64 {
    format!("{:.3e}", t / length).parse().unwrap()
}

fn number(tree: &Value, path: &str) -> f64 {
    tree.pointer(path)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("{path}"))
}

#[test]
fn a_scene_in_seconds_or_periods_has_the_same_answers_in_seconds_or_periods() {
    let second = Rig::default().time(1.0);
    for (unit, length, words) in [
        ("dimensionless", 1.0, "1/Omega"),
        ("period", std::f64::consts::TAU, "periods"),
        ("s", second, "s"),
    ] {
        let base_tree = run(&scene(None, length)).tree();
        let it = run(&scene(Some(unit), length));
        let tree = it.tree();
        assert_eq!(tree["scene"]["outputs"]["time_unit"], unit);
        let mut compared = 0;
        for (path, power) in [
            ("/stationary/loss_rate/value", -1),
            ("/stationary/mean_flight/value", 1),
            ("/crossings/mean_impact_speed/value", 0),
            ("/stationary/var_v/value", 0),
            ("/transient/t/1", 1),
            ("/transient/mean_q/value/1", 0),
            ("/transient/method/step", 1),
            ("/first_loss/t/7", 1),
            ("/first_loss/survival/value/7", 0),
            ("/first_loss/density/value/7", -1),
            ("/first_loss/density/error/7", -1),
            ("/first_passage/t/7", 1),
            ("/first_passage/survival/value/7", 0),
            ("/monte_carlo/first_passage/t/7", 1),
            ("/monte_carlo/first_passage/survival/value/7", 0),
            ("/first_loss/mean_time/value", 1),
            ("/first_loss/rate/value", -1),
            ("/first_loss/rate_over_rice/value", 0),
            ("/crossings/losses_in_window/value", 0),
            ("/crossings/flight_time/9", 1),
            ("/crossings/flight_density/value/9", -1),
            ("/decay_rates/0/re", -1),
            ("/continuous_from", -1),
            ("/reach/t/value", 1),
            ("/monte_carlo/transient/t/1", 1),
            ("/monte_carlo/transient/var_q/value/1", 0),
            ("/monte_carlo/transient/method/step", 1),
            ("/monte_carlo/first_loss/t/7", 1),
            ("/monte_carlo/crossings/loss_rate/value", -1),
            ("/monte_carlo/crossings/losses_in_window/value", 0),
            ("/monte_carlo/stationary/method/duration", 1),
            ("/agreement/worst", 0),
            // What is in SI units says so in its name.
            ("/rig/mean_flight_ms/value", 0),
            ("/rig/losses_per_second/value", 0),
            ("/rig/window_s/value", 0),
            ("/rig/time_out_of_contact_s/value", 0),
            ("/rig/reach_s/value", 0),
        ] {
            let (a, b) = (number(&base_tree, path), number(&tree, path));
            let expected = a * length.powi(-power);
            // Times go through their unit and back: 13 digits, and what a grid of steps makes of the last of them.
            let near = (b - expected).abs() <= 1e-7 * expected.abs().max(1e-12);
            assert!(near, "{unit}: {path}: {b:e} for {expected:e}");
            compared += 1;
        }
        println!("{unit}: {compared} numbers");
        // Times that were typed are written as they were typed.
        let typed = typed(4.0, length);
        assert_eq!(number(&tree, "/transient/t/1"), typed);
        let files = report::all(&it).unwrap();
        let file = |name: &str| {
            let found = files.iter().find(|it| it.name == name);
            String::from_utf8(found.unwrap_or_else(|| panic!("{name}")).bytes.clone()).unwrap()
        };
        let density = files.iter().filter(|it| it.name.starts_with("density_"));
        for it in density {
            let t = it
                .name
                .trim_start_matches("density_")
                .rsplit_once('.')
                .unwrap()
                .0;
            assert_eq!(t.parse::<f64>().unwrap(), typed, "{}", it.name);
        }
        let head = format!("t [{words}],mean_q [2 z_s/3],error of mean_q [2 z_s/3],");
        assert!(
            file("moments.csv").starts_with(&head),
            "{}",
            file("moments.csv")
        );
        assert!(file("moments.csv").contains("mean_force [N]"));
        assert!(file("first_loss.csv").contains(",density ["));
        let again = SceneText::parse("again", &file("scene.toml"), &[]).unwrap();
        assert_eq!(again.scene(), &it.scene);
    }
}

#[test]
fn densities_alone_bring_the_moments_of_their_times() {
    let it = run(
        "[oscillator]\nzeta = 0.05\nh = 0.02\n[initial]\ndeviation = [0.8, 0.8]\n[outputs]\ndensity_at = [1, 3]",
    );
    let tree = it.tree();
    assert_eq!(tree["transient"]["t"], serde_json::json!([1.0, 3.0]));
    assert!((number(&tree, "/transient/mass/value/1") - 1.0).abs() < 1e-3);
    let table = report::terminal::table(&it, false);
    assert!(table.contains("t = 3"), "{table}");
}

#[test]
fn what_is_hardly_meant_is_doubted() {
    let rig = "[rig]\nstatic_load = 60\nfrequency = 410\n";
    for (text, word) in [
        (
            format!("[oscillator]\nzeta = 0.8\nh = 2e-3\n{rig}static_compression = 3.5e-6"),
            "0.8 % would be 0.008",
        ),
        (
            format!("[oscillator]\nzeta = 0.008\nh = 2e-3\n{rig}static_compression = 3.5"),
            "in metres",
        ),
        (
            "[oscillator]\nzeta = 0.008\nh = 2e-3\n[rig]\nstatic_load = 60e6\nfrequency = 0.41\nstatic_compression = 3.5e-6".into(),
            "moving mass",
        ),
        (
            "[oscillator]\nzeta = 0.008\nh = 2e-3\n[initial]\ndeviation = [1, 1]".into(),
            "initial condition",
        ),
        (
            format!(
                "[oscillator]\ncontact = {{ law = \"polynomial\", coefficients = [55] }}\nzeta = 0.01\nh = 2e-3\n\
                 {rig}static_compression = 3.5e-6"
            ),
            "its slope for 1",
        ),
        (
            format!(
                "[oscillator]\nzeta = 0.1\nh = 0.05\n{rig}static_compression = 3.5e-6\n[outputs]\n\
                 first_loss = {{ until = 10 }}\n[accuracy]\ntolerance = 0.1"
            ),
            "makes them seconds",
        ),
        (
            "[oscillator]\ncontact = \"linear\"\nzeta = 0.5\nh = 0.1\n[outputs]\n\
             reach = { quantity = \"var_q\", fraction = 90 }"
                .into(),
            "90 % of it would be 0.9",
        ),
    ] {
        let it = run(&text);
        let warnings: Vec<&str> = it.run.warnings.iter().map(|it| it.text.as_str()).collect();
        assert!(warnings.iter().any(|it| it.contains(word)), "{word}: {warnings:?}");
    }
    let good =
        format!("[oscillator]\nzeta = 0.008\nforce_psd = 0.02\n{rig}static_compression = 3.5e-6");
    let it = run(&good);
    assert!(it.run.warnings.is_empty(), "{:?}", it.run.warnings);
    // The level stays as it was given.
    assert!(
        it.scene.to_toml().contains("force_psd = 0.02"),
        "{}",
        it.scene.to_toml()
    );
    assert!(it.tree()["rig"]["contact_loss_probability"]["value"].is_number());
}

#[test]
fn a_level_of_a_law_that_a_drive_takes_away_is_refused() {
    let text = "[oscillator]\nzeta = 0.005\nh = 2e-3\n[excitation]\ndrive = { amplitude = 0.02, frequency = 0.95, phase = 0.0 }\n\
                [outputs]\nreach = { quantity = \"mean_energy\", fraction = 0.5 }";
    let wrong = SceneText::parse("scene", text, &[]).unwrap_err();
    assert_eq!(wrong.key(), Some("outputs.reach"), "{wrong}");
}

#[test]
fn a_level_that_is_not_known_within_the_limits_is_no_answer_and_no_fault_of_the_scene() {
    let it = run(
        "[oscillator]\ncontact = \"hertz\"\ndamping = \"hunt_crossley\"\nzeta = 0.9\nh = 0.3\n[outputs]\n\
         stationary = true\nreach = { quantity = \"var_q\", fraction = 0.5 }\n[accuracy]\ntolerance = 1e-2\n\
         max_memory = \"60 MB\"\n",
    );
    let (_, reach) = it
        .shortfalls
        .iter()
        .find(|(part, _)| *part == "reach")
        .unwrap();
    println!("{reach}");
    assert!(reach.reason.contains("the stationary level"));
    assert!(it.stationary.is_some() && it.reach.is_none());
}

/// The level of a law that is solved for is half of what is not known of the time, and no course makes it known better.
#[test]
fn a_level_that_is_solved_for_is_known_as_exactly_as_its_time_asks() {
    let it = run(
        "[oscillator]\ndamping = \"contact\"\nzeta = 0.0655\nh = 0.0172\n[outputs]\n\
         reach = { quantity = \"contact_loss_probability\", fraction = 0.5 }\n[accuracy]\ntolerance = 1e-3\n",
    );
    let reach = it.reach.as_ref().unwrap();
    let t = reach.t.unwrap();
    println!("{t}, on {:?} cells", reach.method.cells);
    assert_eq!(reach.shortfall, None);
    assert!(t.error < 1e-3 * t.value && (t.value - 13.449).abs() < 0.02);
}

#[test]
fn a_mesh_of_the_program_s_own_that_cannot_hold_a_scene_is_no_answer_and_the_rest_is_told() {
    let it = run(
        "[oscillator]\ncontact = { law = \"polynomial\", coefficients = [-0.268, 0.61, 0.279] }\nzeta = 0.202\n\
         h = 0.00063\n[outputs]\nstationary = true\ndecay_rates = 8\n[accuracy]\ntolerance = 1e-3\n",
    );
    assert!(it.stationary.is_some());
    if it.decay_rates.is_none() {
        let (part, why) = &it.shortfalls[0];
        println!("{why}");
        assert_eq!(*part, "decay_rates");
        assert!(!why.reason.contains("method.cells"));
    }
}
