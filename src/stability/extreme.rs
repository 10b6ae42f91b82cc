//! The scenes: each at an edge of what can be asked, as the TOML a user would write.

// Tables of scenes, a line or two each.
#![allow(clippy::too_many_lines)]

use super::yardstick::Against;
use std::f64::consts::PI;

/// A scene at an edge.
#[derive(Debug, Clone, PartialEq)]
pub struct Extreme {
    /// Its name.
    pub name: &'static str,
    /// What is extreme about it.
    pub what: &'static str,
    /// The scene.
    pub toml: String,
    /// What its numbers are held against.
    pub against: Against,
    /// Words of a warning that excuses numbers outside their bars; None if nothing does.
    pub says: Option<&'static str>,
    /// Its limit of time.
    pub max_seconds: f64,
}

/// Seconds a scene may take unless it says otherwise.
const SECONDS: f64 = 20.0;

impl Extreme {
    /// The same, excused by a warning with these words.
    fn says(mut self, words: &'static str) -> Self {
        self.says = Some(words);
        self
    }

    /// The same with another limit of time.
    fn within(mut self, seconds: f64) -> Self {
        self.max_seconds = seconds;
        self
    }
}

/// An oscillator as TOML, by its temperature T = pi h/(2 zeta).
fn oscillator(contact: &str, zeta: f64, temperature: f64) -> String {
    let h = 2.0 * zeta * temperature / PI;
    format!("[oscillator]\ncontact = \"{contact}\"\nzeta = {zeta:e}\nh = {h:e}\n")
}

fn gaussian(mean: [f64; 2], deviation: [f64; 2]) -> String {
    let [q, v] = mean;
    let [sq, sv] = deviation;
    format!("[initial]\nkind = \"gaussian\"\nmean = [{q:e}, {v:e}]\ndeviation = [{sq:e}, {sv:e}]\n")
}

fn moments(times: &str) -> String {
    format!("[outputs]\nstationary = false\nmoments_at = {times}\n")
}

/// Start and times of a transient.
fn from(mean: [f64; 2], deviation: [f64; 2], times: &str) -> String {
    gaussian(mean, deviation) + &moments(times)
}

fn stationary(times: &str) -> String {
    "[initial]\nkind = \"stationary\"\n".to_string() + &moments(times)
}

fn rest(times: &str) -> String {
    "[initial]\nkind = \"rest\"\n".to_string() + &moments(times)
}

/// Paths enough for standard errors of half a percent, few enough for seconds.
const PATHS: &str = "[monte_carlo]\npaths = 40_000\n";

/// The temperature of the paper's h = 2e-3.
const T: f64 = 0.6283185307179586;

/// Every scene, by what is extreme about it.
pub fn scenes() -> Vec<Extreme> {
    let mut all = damping();
    all.extend(temperature());
    all.extend(starts());
    all.extend(contacts());
    all.extend(steps());
    all.extend(meshes());
    all.extend(times());
    all.extend(rare());
    all.extend(paths());
    all.extend(operators());
    all
}

fn scene(
    name: &'static str,
    what: &'static str,
    oscillator: String,
    rest: &str,
    against: Against,
) -> Extreme {
    Extreme {
        name,
        what,
        toml: oscillator + rest,
        against,
        says: None,
        max_seconds: SECONDS,
    }
}

/// The start of scene A.
const A: ([f64; 2], [f64; 2]) = ([1.0, 0.0], [0.4, 0.4]);

fn damping() -> Vec<Extreme> {
    let a = |times: &str| from(A.0, A.1, times);
    let what = "damping";
    let linear = |zeta| oscillator("linear", zeta, T);
    let hertz = |zeta| oscillator("hertz", zeta, T);
    vec![
        scene(
            "zeta-1e-6",
            what,
            hertz(1e-6),
            &(a("[5, 20]") + PATHS),
            Against::Paths,
        ),
        scene(
            "zeta-1e-6-winding",
            what,
            hertz(1e-6),
            &(a("[200]") + PATHS),
            Against::Paths,
        ),
        scene(
            "zeta-1e-6-linear",
            what,
            linear(1e-6),
            &a("[1, 50]"),
            Against::Gaussian,
        ),
        scene(
            "zeta-1e-6-stationary",
            what,
            hertz(1e-6),
            &stationary("[100]"),
            Against::Stationary,
        ),
        scene(
            "zeta-1e-4-long",
            what,
            hertz(1e-4),
            &(a("[300]") + PATHS),
            Against::Paths,
        ),
        scene(
            "zeta-0.2",
            what,
            hertz(0.2),
            &a("[1, 5]"),
            Against::Other(&["method.transient=finite_volume"]),
        ),
        scene(
            "zeta-0.21-flow-map",
            what,
            hertz(0.21),
            &(a("[1, 5]") + "[method]\ntransient = \"flow_map\"\n"),
            Against::Other(&["method.transient=finite_volume"]),
        ),
        scene(
            "zeta-1-linear",
            "critical damping",
            linear(1.0),
            &a("[0.1, 1, 10]"),
            Against::Gaussian,
        ),
        scene(
            "zeta-10-linear",
            what,
            linear(10.0),
            &a("[0.1, 1, 50]"),
            Against::Gaussian,
        ),
        scene(
            "zeta-1e3-linear",
            what,
            linear(1e3),
            &a("[1e-3, 1]"),
            Against::Gaussian,
        ),
        scene(
            "zeta-1e3-linear-slow",
            what,
            linear(1e3),
            &a("[2000]"),
            Against::Gaussian,
        )
        .within(60.0),
        scene(
            "zeta-1e3-hertz",
            what,
            hertz(1e3),
            &(a("[1, 500]") + PATHS),
            Against::Paths,
        )
        .within(40.0),
        scene(
            "zeta-1e3-flow-map",
            what,
            linear(1e3),
            &(a("[1]") + "[method]\ntransient = \"flow_map\"\n"),
            Against::Gaussian,
        ),
        scene(
            "zeta-100-explicit",
            what,
            linear(100.0),
            &(a("[1]") + "[method]\ntime = \"explicit\"\n"),
            Against::Gaussian,
        ),
        scene(
            "zeta-100-imex",
            what,
            linear(100.0),
            &(a("[1]") + "[method]\ntime = \"imex\"\n"),
            Against::Gaussian,
        ),
    ]
}

fn temperature() -> Vec<Extreme> {
    let what = "temperature";
    let hertz = |t| oscillator("hertz", 0.005, t);
    let scaled = |t: f64, times: &str| from([t.sqrt(), 0.0], [0.6 * t.sqrt(); 2], times);
    vec![
        scene(
            "T-1e-8",
            what,
            hertz(1e-8),
            &scaled(1e-8, "[5, 20]"),
            Against::Other(&["method.transient=finite_volume", "accuracy.tolerance=1e-4"]),
        ),
        scene(
            "T-1e-8-linear",
            what,
            oscillator("linear", 0.005, 1e-8),
            &scaled(1e-8, "[5, 20]"),
            Against::Gaussian,
        ),
        scene(
            "T-1e-8-stationary",
            what,
            hertz(1e-8),
            &stationary("[20]"),
            Against::Stationary,
        ),
        scene(
            "T-1e-8-cold-start",
            "a start 1e4 deviations wide",
            hertz(1e-8),
            &from([0.0; 2], [1.0; 2], "[5]"),
            Against::Start,
        ),
        scene(
            "T-3e-4",
            "the paper's lowest level",
            hertz(3.1416e-4),
            &(scaled(3.1416e-4, "[5, 50]") + PATHS),
            Against::Paths,
        ),
        scene(
            "T-94",
            "the paper's highest level",
            hertz(94.248),
            &(scaled(94.248, "[5, 20]") + PATHS),
            Against::Paths,
        ),
        scene(
            "T-1e4",
            what,
            hertz(1e4),
            &(scaled(1e4, "[20, 200]") + PATHS),
            Against::Paths,
        ),
        scene(
            "T-1e4-stationary",
            what,
            hertz(1e4),
            &stationary("[20, 1000]"),
            Against::Stationary,
        ),
        scene(
            "T-1e4-narrow",
            "a start of 1e-3 deviations",
            hertz(1e4),
            &(from([0.0; 2], [0.1; 2], "[5]") + PATHS),
            Against::Paths,
        ),
        scene(
            "T-1e4-overdamped",
            what,
            oscillator("hertz", 5.0, 1e4),
            &(scaled(1e4, "[20]") + PATHS),
            Against::Paths,
        )
        .within(40.0),
    ]
}

fn starts() -> Vec<Extreme> {
    let what = "start";
    let hertz = || oscillator("hertz", 0.005, T);
    let paths = |mean, deviation, times| from(mean, deviation, times) + PATHS;
    vec![
        scene(
            "narrow-1e-3",
            what,
            hertz(),
            &paths([0.0; 2], [1e-3; 2], "[1, 20]"),
            Against::Paths,
        ),
        scene(
            "narrow-1e-6",
            what,
            hertz(),
            &paths([0.0; 2], [1e-6; 2], "[1, 20]"),
            Against::Paths,
        ),
        scene(
            "narrow-displaced",
            what,
            hertz(),
            &paths([1.0, 0.0], [1e-3; 2], "[1, 20]"),
            Against::Paths,
        ),
        scene(
            "narrow-displaced-linear",
            what,
            oscillator("linear", 0.005, T),
            &from([1.0, 0.0], [1e-3; 2], "[0.01, 1, 20]"),
            Against::Gaussian,
        ),
        scene(
            "rest",
            what,
            hertz(),
            &(rest("[0.01, 1, 50]") + PATHS),
            Against::Paths,
        ),
        scene(
            "rest-linear",
            what,
            oscillator("linear", 0.005, T),
            &rest("[0.01, 1, 50]"),
            Against::Gaussian,
        ),
        scene(
            "rest-overdamped",
            what,
            oscillator("linear", 20.0, T),
            &rest("[0.01, 1, 50]"),
            Against::Gaussian,
        ),
        scene(
            "rest-underdamped",
            what,
            oscillator("linear", 1e-5, T),
            &rest("[0.01, 1, 50]"),
            Against::Gaussian,
        ),
        scene(
            "rest-hot",
            what,
            oscillator("hertz", 0.005, 94.248),
            &(rest("[1, 20]") + PATHS),
            Against::Paths,
        ),
        scene(
            "dropped-50-falling",
            "dropped from q = -50",
            hertz(),
            &from([-50.0, 0.0], [0.3; 2], "[1, 5]"),
            Against::Flight,
        ),
        scene(
            "dropped-50",
            "dropped from q = -50",
            hertz(),
            &paths([-50.0, 0.0], [0.3; 2], "[12, 30]"),
            Against::Paths,
        )
        .within(40.0),
        scene(
            "dropped-50-point",
            "dropped from q = -50",
            hertz(),
            &paths([-50.0, 0.0], [1e-3; 2], "[12]"),
            Against::Paths,
        )
        .within(40.0),
        scene(
            "dropped-50-cold",
            "dropped from q = -50, T = 1e-3",
            oscillator("hertz", 0.005, 1e-3),
            &from([-50.0, 0.0], [0.3; 2], "[5]"),
            Against::Flight,
        ),
        scene(
            "thrown-10-sigma",
            "v = 10 sqrt(T)",
            hertz(),
            &paths([0.0, 10.0 * T.sqrt()], [0.3; 2], "[5, 20]"),
            Against::Paths,
        )
        .within(40.0),
        scene(
            "thrown-10-sigma-linear",
            "v = 10 sqrt(T)",
            oscillator("linear", 0.005, T),
            &from([0.0, 10.0 * T.sqrt()], [0.3; 2], "[5, 20]"),
            Against::Gaussian,
        ),
        scene(
            "thrown-100-sigma",
            "v = 100 sqrt(T)",
            hertz(),
            &paths([0.0, 100.0 * T.sqrt()], [0.3; 2], "[5]"),
            Against::Paths,
        ),
        scene(
            "thrown-overdamped",
            "v = 10 sqrt(T), zeta = 10",
            oscillator("linear", 10.0, T),
            &from([0.0, 10.0 * T.sqrt()], [0.3; 2], "[0.1, 5]"),
            Against::Gaussian,
        ),
        scene(
            "needle",
            "deviations 1e-3 and 1",
            hertz(),
            &paths([0.0; 2], [1e-3, 1.0], "[1, 20]"),
            Against::Paths,
        ),
        scene(
            "wide",
            "a start 10 times the stationary law",
            hertz(),
            &paths([0.0; 2], [8.0, 8.0], "[5, 20]"),
            Against::Paths,
        ),
    ]
}

fn contacts() -> Vec<Extreme> {
    let bilinear = |t| oscillator("bilinear", 0.005, t);
    let a = |times: &str| from(A.0, A.1, times);
    vec![
        scene(
            "bilinear",
            "kink",
            bilinear(T),
            &(a("[5, 20]") + PATHS),
            Against::Paths,
        ),
        scene(
            "bilinear-volumes",
            "kink",
            bilinear(T),
            &(a("[5, 20]") + "[method]\ntransient = \"finite_volume\"\n"),
            Against::Other(&["method.transient=flow_map", "accuracy.tolerance=1e-4"]),
        )
        .within(40.0),
        scene(
            "bilinear-cold",
            "kink never touched",
            bilinear(3e-4),
            &from([0.01, 0.0], [0.01; 2], "[5, 20]"),
            Against::Other(&["oscillator.contact=linear"]),
        ),
        scene(
            "bilinear-hot",
            "kink, T = 1e3",
            bilinear(1e3),
            &(from([0.0; 2], [20.0; 2], "[10, 40]") + PATHS),
            Against::Paths,
        ),
        scene(
            "bilinear-overdamped",
            "kink, zeta = 5",
            oscillator("bilinear", 5.0, T),
            &(a("[1, 20]") + PATHS),
            Against::Paths,
        ),
        scene(
            "free-flight",
            "no stationary law",
            oscillator("free", 0.005, T),
            &from([0.0; 2], [0.5; 2], "[1, 20]"),
            Against::Gaussian,
        ),
        scene(
            "free-flight-1e3",
            "no stationary law, t = 1e3",
            oscillator("free", 0.005, T),
            &from([0.0; 2], [0.5; 2], "[1000]"),
            Against::Gaussian,
        ),
        scene(
            "free-flight-overdamped",
            "no stationary law, zeta = 100",
            oscillator("free", 100.0, T),
            &from([0.0; 2], [0.5; 2], "[0.1, 20]"),
            Against::Gaussian,
        ),
        scene(
            "free-flight-stationary",
            "no stationary law",
            oscillator("free", 0.005, T),
            &stationary("[1]"),
            Against::Refusal,
        ),
        scene(
            "energy-law",
            "an identity over 40 time units",
            oscillator("hertz", 0.05, T),
            &a("{ every = 0.25, until = 40 }"),
            Against::EnergyLaw,
        ),
    ]
}

fn steps() -> Vec<Extreme> {
    let with = |method: &str| from(A.0, A.1, "[5, 20]") + "[method]\n" + method;
    let linear = || oscillator("linear", 0.005, T);
    let damped = || oscillator("linear", 2.0, T);
    let what = "step";
    vec![
        scene(
            "step-100-flow-map",
            what,
            linear(),
            &with("transient = \"flow_map\"\nstep = 100\n"),
            Against::Gaussian,
        ),
        scene(
            "step-3-flow-map",
            what,
            linear(),
            &with("transient = \"flow_map\"\nstep = 3\n"),
            Against::Gaussian,
        ),
        scene(
            "step-1e-6-flow-map",
            what,
            linear(),
            &with("transient = \"flow_map\"\nstep = 1e-6\n"),
            Against::Gaussian,
        )
        .within(5.0),
        scene(
            "step-1e-12-flow-map",
            what,
            linear(),
            &with("transient = \"flow_map\"\nstep = 1e-12\n"),
            Against::Gaussian,
        )
        .within(5.0),
        scene(
            "step-10-explicit",
            what,
            damped(),
            &with("time = \"explicit\"\nstep = 10\n"),
            Against::Gaussian,
        ),
        scene(
            "step-1e-6-explicit",
            what,
            damped(),
            &with("time = \"explicit\"\nstep = 1e-6\n"),
            Against::Gaussian,
        )
        .within(5.0),
        scene(
            "step-10-imex",
            what,
            damped(),
            &with("time = \"imex\"\nstep = 10\n"),
            Against::Gaussian,
        ),
        scene(
            "step-10-implicit",
            what,
            damped(),
            &with("time = \"implicit\"\nstep = 10\n"),
            Against::Gaussian,
        ),
        scene(
            "step-100-implicit",
            what,
            linear(),
            &with("time = \"implicit\"\nstep = 100\n"),
            Against::Gaussian,
        )
        .within(40.0),
        scene(
            "step-100-euler",
            what,
            linear(),
            &with("time = \"backward_euler\"\nstep = 100\n"),
            Against::Gaussian,
        ),
        scene(
            "step-100-euler-damped",
            what,
            damped(),
            &with("time = \"backward_euler\"\nstep = 100\n"),
            Against::Gaussian,
        ),
        scene(
            "step-1-euler-damped",
            what,
            damped(),
            &with("time = \"backward_euler\"\nstep = 1\n"),
            Against::Gaussian,
        ),
        scene(
            "step-1e-6-euler",
            what,
            damped(),
            &with("time = \"backward_euler\"\nstep = 1e-6\n"),
            Against::Gaussian,
        )
        .within(5.0),
        scene(
            "tolerance-1e-9",
            "tolerance",
            linear(),
            &(from(A.0, A.1, "[5, 20]") + "[accuracy]\ntolerance = 1e-9\n"),
            Against::Gaussian,
        )
        .within(40.0),
        scene(
            "tolerance-0.5",
            "tolerance",
            linear(),
            &(from(A.0, A.1, "[5, 20]") + "[accuracy]\ntolerance = 0.5\n"),
            Against::Gaussian,
        ),
        scene(
            "tolerance-1e-14",
            "tolerance",
            linear(),
            &(from(A.0, A.1, "[5, 20]") + "[accuracy]\ntolerance = 1e-14\n"),
            Against::Gaussian,
        ),
    ]
}

fn meshes() -> Vec<Extreme> {
    let with = |method: &str| from(A.0, A.1, "[5, 20]") + "[method]\n" + method;
    let still = |method: &str| stationary("[5, 20]") + "[method]\n" + method;
    // Wide enough for 44 cells.
    let wide = |method: &str| from([0.5, 0.0], [0.7; 2], "[5, 20]") + "[method]\n" + method;
    let linear = || oscillator("linear", 0.05, T);
    let damped = || oscillator("linear", 2.0, T);
    let what = "mesh";
    let tall = "mesh, aspect ratio 1e4";
    vec![
        scene(
            "cells-1",
            what,
            linear(),
            &with("cells = [1, 1]\n"),
            Against::Refusal,
        ),
        scene(
            "cells-4",
            what,
            linear(),
            &with("cells = [4, 4]\n"),
            Against::Gaussian,
        ),
        scene(
            "cells-4-volumes",
            what,
            linear(),
            &with("transient = \"finite_volume\"\ncells = [4, 4]\n"),
            Against::Gaussian,
        ),
        scene(
            "cells-16-still",
            what,
            linear(),
            &still("transient = \"flow_map\"\ncells = [16, 16]\n"),
            Against::Stationary,
        ),
        scene(
            "cells-16-volumes",
            what,
            linear(),
            &still("transient = \"finite_volume\"\ncells = [16, 16]\n"),
            Against::Stationary,
        ),
        scene(
            "cells-12-upwind",
            what,
            damped(),
            &with("drift = \"upwind\"\ncells = [12, 12]\n"),
            Against::Gaussian,
        ),
        scene(
            "cells-40",
            what,
            linear(),
            &wide("transient = \"flow_map\"\ncells = [40, 40]\n"),
            Against::Gaussian,
        ),
        scene(
            "cells-64-hertz",
            what,
            oscillator("hertz", 0.005, T),
            &(wide("cells = [64, 44]\n") + PATHS),
            Against::Paths,
        ),
        scene(
            "aspect-1e4",
            tall,
            linear(),
            &still("transient = \"flow_map\"\ncells = [120000, 20]\n"),
            Against::Stationary,
        ),
        scene(
            "aspect-1e4-hertz",
            tall,
            oscillator("hertz", 0.005, T),
            &still("transient = \"flow_map\"\ncells = [120000, 20]\n"),
            Against::Stationary,
        ),
        scene(
            "aspect-1e-4",
            "mesh, aspect ratio 1e-4",
            linear(),
            &still("transient = \"flow_map\"\ncells = [20, 100000]\n"),
            Against::Refusal,
        ),
        scene(
            "aspect-1e4-upwind",
            tall,
            damped(),
            &with("drift = \"upwind\"\ncells = [100000, 14]\n"),
            Against::Gaussian,
        )
        .within(40.0),
        scene(
            "aspect-200",
            "mesh, aspect ratio 200",
            linear(),
            &wide("transient = \"flow_map\"\ncells = [9000, 44]\n"),
            Against::Gaussian,
        )
        .within(40.0),
        scene(
            "aspect-0.02-volumes",
            "mesh, aspect ratio 1/50",
            damped(),
            &wide("transient = \"finite_volume\"\ncells = [60, 3000]\n"),
            Against::Gaussian,
        )
        .within(40.0),
        scene(
            "upwind-coarse",
            "mesh, upwind",
            oscillator("hertz", 0.005, T),
            &(with("drift = \"upwind\"\ncells = [40, 30]\n") + PATHS),
            Against::Paths,
        ),
        scene(
            "cells-1e9",
            what,
            linear(),
            &with("cells = [1000000000, 1000000000]\n"),
            Against::Refusal,
        ),
    ]
}

fn times() -> Vec<Extreme> {
    let hertz = || oscillator("hertz", 0.005, T);
    let a = |times: &str| from(A.0, A.1, times);
    let what = "time";
    vec![
        scene("time-zero", what, hertz(), &a("[0]"), Against::Start),
        scene(
            "time-zero-volumes",
            what,
            hertz(),
            &(a("[0]") + "[method]\ntransient = \"finite_volume\"\n"),
            Against::Start,
        ),
        scene("time-1e-12", what, hertz(), &a("[1e-12]"), Against::Start),
        scene(
            "time-1e-12-volumes",
            what,
            hertz(),
            &(a("[1e-12]") + "[method]\ntransient = \"finite_volume\"\n"),
            Against::Start,
        ),
        scene("time-1e-300", what, hertz(), &a("[1e-300]"), Against::Start),
        scene(
            "time-mixed",
            "times 1e-12 and 1e6",
            hertz(),
            &a("[1e-12, 1e6]"),
            Against::Other(&["accuracy.tolerance=1e-4"]),
        ),
        scene("time-1e6", what, hertz(), &a("[1e6]"), Against::Stationary),
        scene(
            "time-1e6-volumes",
            what,
            hertz(),
            &(a("[1e6]") + "[method]\ntransient = \"finite_volume\"\n"),
            Against::Stationary,
        )
        .within(60.0),
        scene(
            "time-1e6-undamped",
            "time 1e6, zeta = 1e-6",
            oscillator("linear", 1e-6, T),
            &a("[1e6]"),
            Against::Gaussian,
        )
        .within(60.0),
        scene(
            "time-1e6-overdamped",
            "time 1e6, zeta = 1e3",
            oscillator("linear", 1e3, T),
            &a("[1e6]"),
            Against::Gaussian,
        ),
        scene("time-1e9", what, hertz(), &a("[1e9]"), Against::Stationary),
        scene(
            "time-1e9-stationary",
            what,
            hertz(),
            &stationary("[1e9]"),
            Against::Stationary,
        ),
    ]
}

fn rare() -> Vec<Extreme> {
    let law = "[outputs]\nstationary = true\n";
    // e^{-0.9/T} = 1e-300.
    let rare = 0.9 / (300.0 * std::f64::consts::LN_10);
    let what = "probability 1e-300";
    vec![
        scene(
            "loss-1e-300",
            what,
            oscillator("hertz", 0.005, rare),
            law,
            Against::FlightTail,
        ),
        scene(
            "loss-1e-30000",
            "probability 1e-30000",
            oscillator("hertz", 0.005, rare / 100.0),
            law,
            Against::FlightTail,
        ),
        scene(
            "loss-1e-300-transient",
            what,
            oscillator("hertz", 0.005, rare),
            &stationary("[10]"),
            Against::Stationary,
        ),
        scene(
            "loss-1e-300-records",
            what,
            oscillator("hertz", 0.005, rare),
            "[outputs]\nstationary = true\ncrossings = { window = 20 }\n[monte_carlo]\nduration = 1e5\n",
            Against::Stationary,
        ),
        scene(
            "loss-1e-300-driven",
            "a start out of contact at T = 1.3e-3",
            oscillator("hertz", 0.005, rare),
            &(from([-1.5, 0.0], [0.05; 2], "[0.5, 5]") + PATHS),
            Against::Paths,
        ),
    ]
}

fn paths() -> Vec<Extreme> {
    let only = |scheme: &str, step: &str| {
        format!("[monte_carlo]\npaths = 20_000\nscheme = \"{scheme}\"\n{step}\n")
    };
    let a = |times: &str| from(A.0, A.1, times);
    let linear = |zeta| oscillator("linear", zeta, T);
    let hertz = || oscillator("hertz", 0.005, T);
    let period = "step = 6.283185307179586";
    let what = "Monte Carlo with steps of a period";
    vec![
        scene(
            "paths-central-period",
            what,
            linear(0.005),
            &(a("[20]") + &only("central_difference", period)),
            Against::Gaussian,
        )
        .says("step"),
        scene(
            "paths-baoab-period",
            what,
            linear(0.005),
            &(a("[20]") + &only("baoab", period)),
            Against::Gaussian,
        )
        .says("step"),
        scene(
            "paths-4-2-period",
            what,
            hertz(),
            &(stationary("[60]") + &only("splitting_4_2", period)),
            Against::Stationary,
        )
        .says("step"),
        scene(
            "paths-6-2-period",
            what,
            hertz(),
            &(stationary("[60]") + &only("splitting_6_2", period)),
            Against::Stationary,
        )
        .says("step"),
        scene(
            "paths-6-2-period-moving",
            what,
            linear(0.005),
            &(a("[20, 60]") + &only("splitting_6_2", period)),
            Against::Gaussian,
        )
        .says("step"),
        scene(
            "paths-euler-period",
            what,
            hertz(),
            &(stationary("[60]") + &only("euler_maruyama", period)),
            Against::Stationary,
        )
        .says("step"),
        scene(
            "paths-euler-0.05",
            "Euler-Maruyama at zeta = 0.005",
            hertz(),
            &(stationary("[200]") + &only("euler_maruyama", "step = 0.05")),
            Against::Stationary,
        )
        .says("step"),
        scene(
            "paths-baoab-1",
            "BAOAB, long step",
            hertz(),
            &(stationary("[60]") + &only("baoab", "step = 1")),
            Against::Stationary,
        )
        .says("step"),
        scene(
            "paths-central-1",
            "central differences, long step",
            hertz(),
            &(stationary("[60]") + &only("central_difference", "step = 1")),
            Against::Stationary,
        )
        .says("step"),
        scene(
            "paths-auto-stiff",
            "Monte Carlo, zeta = 1e3",
            linear(1e3),
            &(a("[1, 20]") + &only("auto", "")),
            Against::Gaussian,
        ),
        scene(
            "paths-4-2-stiff",
            "Monte Carlo, zeta = 1e3, step 1",
            linear(1e3),
            &(a("[20]") + &only("splitting_4_2", "step = 1")),
            Against::Gaussian,
        )
        .says("step"),
        scene(
            "paths-baoab-stiff",
            "Monte Carlo, zeta = 1e3, step 1",
            linear(1e3),
            &(a("[20]") + &only("baoab", "step = 1")),
            Against::Gaussian,
        )
        .says("step"),
        scene(
            "paths-undamped",
            "Monte Carlo, zeta = 1e-6",
            linear(1e-6),
            &(a("[100]") + &only("auto", "")),
            Against::Gaussian,
        ),
        scene(
            "paths-hot",
            "Monte Carlo, T = 1e4",
            oscillator("hertz", 0.005, 1e4),
            &(stationary("[100]") + &only("auto", "")),
            Against::Stationary,
        ),
        scene(
            "paths-cold",
            "Monte Carlo, T = 1e-8",
            oscillator("hertz", 0.005, 1e-8),
            &(stationary("[100]") + &only("auto", "")),
            Against::Stationary,
        ),
        scene(
            "paths-step-1e-12",
            "Monte Carlo, step 1e-12",
            linear(0.005),
            &(a("[20]") + &only("auto", "step = 1e-12")),
            Against::Gaussian,
        )
        .within(5.0),
        scene(
            "paths-two",
            "two paths",
            linear(0.005),
            &(a("[20]") + "[monte_carlo]\npaths = 2\n"),
            Against::Gaussian,
        )
        .says("paths"),
        scene(
            "paths-three-cosines",
            "noise of three cosines",
            hertz(),
            &(stationary("[200]")
                + "[monte_carlo]\npaths = 5_000\nnoise = { cosines = 3, band = 0.5 }\n"),
            Against::Stationary,
        )
        .says("band"),
        scene(
            "records-short",
            "records shorter than the memory",
            oscillator("hertz", 1e-4, T),
            "[outputs]\nstationary = true\n[monte_carlo]\nduration = 100\n",
            Against::Stationary,
        ),
    ]
}

fn operators() -> Vec<Extreme> {
    let linear = |zeta| oscillator("linear", zeta, T);
    let hertz = |zeta, t| oscillator("hertz", zeta, t);
    let rates = "[outputs]\nstationary = false\ndecay_rates = 4\n";
    let steady = "[outputs]\nstationary = false\nsteady = true\n";
    vec![
        scene(
            "rates-linear",
            "decay rates",
            linear(0.05),
            rates,
            Against::LinearRates,
        )
        .within(60.0),
        scene(
            "rates-linear-1e-6",
            "decay rates, zeta = 1e-6",
            linear(1e-6),
            rates,
            Against::LinearRates,
        )
        .within(60.0),
        scene(
            "rates-linear-1",
            "decay rates, critical damping",
            linear(1.0),
            rates,
            Against::LinearRates,
        )
        .says("not seen alike")
        .within(60.0),
        scene(
            "rates-linear-100",
            "decay rates, zeta = 100",
            linear(100.0),
            rates,
            Against::LinearRates,
        )
        .within(60.0),
        scene(
            "steady-1e-6",
            "steady state, zeta = 1e-6",
            hertz(1e-6, T),
            steady,
            Against::Steady,
        ),
        scene(
            "steady-1e3",
            "steady state, zeta = 1e3",
            hertz(1e3, T),
            steady,
            Against::Steady,
        ),
        scene(
            "steady-cold",
            "steady state, T = 1e-8",
            hertz(0.005, 1e-8),
            steady,
            Against::Steady,
        ),
        scene(
            "steady-hot",
            "steady state, T = 1e4",
            hertz(0.005, 1e4),
            steady,
            Against::Steady,
        ),
        scene(
            "steady-order-8",
            "steady state, order 8",
            hertz(0.005, T),
            &(steady.to_string() + "[method]\ndrift = 8\n"),
            Against::Steady,
        )
        .within(60.0),
        scene(
            "steady-4-cells",
            "steady state, four cells",
            hertz(0.005, T),
            &(steady.to_string() + "[method]\ncells = [4, 4]\n"),
            Against::Steady,
        ),
    ]
}
