//! The reference solutions of the calibration (validation/precision): how its scenes were drawn, and the methods
//! their numbers come from, none of them one of the program's own. To make them again:
//!
//! ```text
//! cargo test --release --test all references::write_references -- --ignored --nocapture
//! ```
//!
//! with SCENES="3 17" for some scenes only; the others keep what is stored.

use crate::hermite::{Hermite, Resolution};
use crate::moving::Moving;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;
use vibroimpact::contact::ContactLaw;
use vibroimpact::damping::Damping;
use vibroimpact::excitation::Excitation;
use vibroimpact::gaussian::Gaussian;
use vibroimpact::initial::Initial;
use vibroimpact::moments::{Moments, RawMoments};
use vibroimpact::oscillator::Oscillator;
use vibroimpact::scales::Scales;
use vibroimpact::scene::text::SceneText;
use vibroimpact::stationary::Stationary;

struct Case {
    oscillator: Oscillator,
    excitation: Excitation,
    initial: Initial,
    times: Vec<f64>,
}

/// A number of scene, time and name, with what it may be off by and where it comes from.
struct Reference {
    t: f64,
    name: &'static str,
    value: f64,
    uncertainty: f64,
    method: String,
}

/// Hermite functions in the moving frame; its check has two thirds of them.
const MOVING: usize = 36;

/// Drawn at random from a fixed seed.
struct Draw(u64);

impl Draw {
    /// Uniform in [0, 1): splitmix64.
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e3779b97f4a7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58476d1ce4e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d049bb133111eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn decades(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }
}

/// To three digits: what stands in the file is what was computed.
fn round(x: f64) -> f64 {
    format!("{x:.2e}").parse().unwrap()
}

/// Van der Corput's sequence: evenly spread however many are drawn.
fn spread(mut k: usize, base: usize) -> f64 {
    let (mut it, mut digit) = (0.0, 1.0);
    while k > 0 {
        digit /= base as f64;
        it += digit * (k % base) as f64;
        k /= base;
    }
    it
}

/// q with U(q) = T s^2/2, on the side of s.
fn place(contact: &ContactLaw, t: f64, s: f64) -> f64 {
    match contact.turning_points(0.5 * t * s * s) {
        Some((left, right)) => {
            if s < 0.0 {
                left
            } else {
                right
            }
        }
        None => t.sqrt() * s,
    }
}

/// Those drawn here, then those of contacts.toml: laws with parameters, other damping, drives, envelopes.
fn cases() -> Vec<Case> {
    let given = contacts().into_iter().map(|toml| {
        let text = SceneText::parse("contacts.toml", &toml, &[]).unwrap();
        let scene = text.scene();
        Case {
            oscillator: scene.oscillator.clone(),
            excitation: scene.excitation.clone(),
            initial: scene.initial,
            times: scene.outputs.moments_at.list(),
        }
    });
    drawn().into_iter().chain(given).collect()
}

/// The scenes of contacts.toml, as TOML.
fn contacts() -> Vec<String> {
    let text = fs::read_to_string(folder().join("contacts.toml")).unwrap();
    let mut file: toml::Table = text.parse().unwrap();
    let Some(toml::Value::Array(scenes)) = file.remove("scene") else {
        panic!("contacts.toml has no [[scene]]");
    };
    let tables = scenes.iter().map(|it| it.as_table().unwrap());
    tables.map(toml::Table::to_string).collect()
}

/// zeta from 1e-4 to 20 and T from 1e-4 to 100 evenly in their logarithms; laws and kinds of start in
/// turn; the rest at random. Then the starts in a point of the paper's case.
fn drawn() -> Vec<Case> {
    use ContactLaw::{Bilinear, Free, Hertz, Linear};
    const LAWS: [ContactLaw; 8] = [Hertz, Bilinear, Hertz, Linear, Hertz, Bilinear, Hertz, Free];
    const KINDS: [&str; 11] = [
        "wide",
        "rest",
        "wide",
        "narrow",
        "displaced",
        "wide",
        "narrow",
        "stationary",
        "displaced",
        "rest",
        "wide",
    ];
    let mut draw = Draw(2026);
    let mut cases: Vec<Case> = (1..=44)
        .map(|k| {
            let decades = |low: f64, high: f64, x: f64| low * (high / low).powf(x);
            // Bases 3 and 5: laws and kinds come in turns of 8 and 11.
            let zeta = round(decades(1e-4, 20.0, spread(k, 3)));
            let t = decades(1e-4, 100.0, spread(k, 5));
            let h = round(t * 2.0 * zeta / std::f64::consts::PI);
            let contact = LAWS[k % 8].clone();
            let confining = contact.is_confining();
            let oscillator = Oscillator::new(contact.clone(), zeta, h).unwrap();
            let gaussian = |draw: &mut Draw, s: [f64; 2], width: [f64; 2]| {
                let s = draw.between(s[0], s[1]) * if draw.unit() < 0.5 { -1.0 } else { 1.0 };
                let local = 0.5 * (place(&contact, t, s + 0.5) - place(&contact, t, s - 0.5));
                let width = [0; 2].map(|_| draw.decades(width[0], width[1]));
                let mean = [place(&contact, t, s), draw.between(-0.5, 0.5) * t.sqrt()];
                let deviation = [2.0 * width[0] * local, width[1] * t.sqrt()];
                Initial::gaussian(mean.map(round), deviation.map(round)).unwrap()
            };
            let initial = match KINDS[k % 11] {
                "rest" => Initial::Rest,
                "stationary" if confining => Initial::Stationary,
                "narrow" => gaussian(&mut draw, [0.0, 1.0], [0.03, 0.15]),
                "displaced" => gaussian(&mut draw, [2.0, 3.5], [0.2, 0.5]),
                _ => gaussian(&mut draw, [0.0, 1.0], [0.3, 0.9]),
            };
            let weak = zeta < 0.05;
            let mut times = vec![if weak {
                draw.between(0.5, 2.0)
            } else {
                draw.between(0.3, 3.0)
            }];
            let closed = matches!(contact, Linear) || initial == Initial::Stationary;
            times.push(match () {
                () if closed => draw.decades(3.0, (20.0 / zeta).clamp(6.0, 300.0)),
                () if !confining => draw.between(3.0, 10.0),
                () if weak => draw.between(3.0, 7.0),
                () => draw.decades(3.5, 10.0 + 2.0 * zeta),
            });
            // The stationary law is the reference: slow modes have left less than e^-20.
            if confining && (0.003..1.0).contains(&zeta) && k % 2 == 0 {
                times.push(20.0 / zeta);
            }
            let mut times: Vec<f64> = times.into_iter().map(round).collect();
            times.sort_by(f64::total_cmp);
            times.dedup();
            Case {
                oscillator,
                excitation: Excitation::default(),
                initial,
                times,
            }
        })
        .collect();
    let paper = Oscillator::new(Hertz, 0.005, 2e-3).unwrap();
    let point = |q: f64| Initial::gaussian([q, 0.0], [1e-3; 2]).unwrap();
    for (initial, times) in [
        (Initial::Rest, vec![1.0, 20.0]),
        (point(-3.0), vec![1.0, 5.0]),
        (point(1.0), vec![1.0, 5.0]),
        // Scene A.
        (
            Initial::gaussian([1.0, 0.0], [0.4; 2]).unwrap(),
            vec![5.0, 10.0],
        ),
    ] {
        cases.push(Case {
            oscillator: paper.clone(),
            excitation: Excitation::default(),
            initial,
            times,
        });
    }
    cases
}

impl Case {
    fn csv(&self, number: usize) -> String {
        let it = &self.oscillator;
        let numbers = match self.initial {
            Initial::Gaussian { mean, deviation } => {
                format!("{},{},{},{}", mean[0], mean[1], deviation[0], deviation[1])
            }
            _ => ",,,".into(),
        };
        let times: Vec<String> = self.times.iter().map(f64::to_string).collect();
        format!(
            "{number},{},{},{:e},{},{numbers},{}\n",
            it.contact().name(),
            it.zeta(),
            it.h(),
            self.initial.name(),
            times.join(" ")
        )
    }

    /// How fine, and how much coarser its check.
    fn resolutions(&self) -> [Resolution; 2] {
        let modes = match self.oscillator.zeta() {
            // No friction in flight.
            _ if *self.oscillator.damping() == Damping::Contact => 200,
            zeta if zeta < 0.05 => 200,
            zeta if zeta < 0.5 => 120,
            zeta if zeta < 2.0 => 80,
            _ => 50,
        };
        let elements = if self.is_narrow() { 30 } else { 22 };
        [
            Resolution {
                elements,
                degree: 8,
                modes,
                level: 28.0,
                step: 0.04,
            },
            Resolution {
                elements: elements * 3 / 4,
                degree: 8,
                modes: modes * 7 / 10,
                level: 25.0,
                step: 0.08,
            },
        ]
    }

    /// The differences of two answers over the normalisations, of the numbers both have.
    fn differences(&self, x: &Moments, y: &Moments) -> Vec<f64> {
        let scales = Scales::of(&self.oscillator).each(x);
        let pairs = x.named().into_iter().zip(y.named()).zip(scales);
        pairs
            .filter_map(|(((_, x), (_, y)), scale)| Some((x?.value - y?.value).abs() / scale))
            .collect()
    }

    /// The largest of them; infinite where one is no number.
    fn distance(&self, x: &Moments, y: &Moments) -> f64 {
        let all = self.differences(x, y).into_iter();
        all.map(|it| if it.is_finite() { it } else { f64::INFINITY })
            .fold(0.0, f64::max)
    }

    /// The median of them.
    fn middle(&self, x: &Moments, y: &Moments) -> f64 {
        let mut all = self.differences(x, y);
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    }

    fn is_narrow(&self) -> bool {
        match self.initial {
            Initial::Gaussian { deviation, .. } => {
                deviation[1] < 0.2 * self.oscillator.temperature().sqrt()
            }
            _ => true,
        }
    }

    /// What is known in closed form at a time, and by which.
    fn closed(&self, t: f64) -> Option<(Moments, &'static str)> {
        let it = &self.oscillator;
        if !(it.is_viscous() && self.excitation.is_plain()) {
            return None;
        }
        let gaussian = matches!(it.contact(), ContactLaw::Linear | ContactLaw::Free);
        if gaussian && (self.initial != Initial::Stationary) {
            let law = Gaussian::of(it, &self.initial).unwrap();
            let law = law.after(it, t).unwrap();
            return Some((moments_of(&law, it.contact()), "gaussian"));
        }
        // Where friction and noise act on a flight, its fall has a continuous spectrum from
        // 1/(8 zeta T) on, that of overdamped motion under a constant force.
        let down = 8.0 * it.zeta() * it.temperature();
        let settled = it.zeta() < 1.0 && t >= 19.9 * down.max(1.0 / it.zeta());
        (settled || self.initial == Initial::Stationary)
            .then(|| (Stationary::of(it).unwrap().moments(), "stationary"))
    }

    fn references(&self) -> Vec<Reference> {
        let open: Vec<f64> = self
            .times
            .iter()
            .copied()
            .filter(|t| self.closed(*t).is_none())
            .collect();
        let run = |resolution: Resolution| -> Vec<Moments> {
            let Some(until) = open.last() else {
                return Vec::new();
            };
            let mut it = Hermite::new(
                &self.oscillator,
                &self.excitation,
                &self.initial,
                *until,
                resolution,
            );
            let mut now = 0.0;
            open.iter()
                .map(|t| {
                    it.advance(t - now);
                    now = *t;
                    it.raw().moments(self.oscillator.contact())
                })
                .collect()
        };
        let [fine, coarse] = self.resolutions();
        let (numbers, checks) = (run(fine), run(coarse));
        // A concentrated initial condition is resolved in its own frame as long as it stays near a Gaussian there.
        let framed = |n: usize| -> Vec<Moments> {
            let mut it = Moving::new(&self.oscillator, &self.excitation, &self.initial, n);
            let held = self.is_narrow() && self.oscillator.is_viscous();
            let times = open.iter().filter(|_| held);
            times
                .map(|t| {
                    it.advance(*t);
                    it.moments()
                })
                .collect()
        };
        let (framed, framed_checks) = (framed(MOVING), framed(MOVING * 2 / 3));
        let mut references = Vec::new();
        let mut add = |t: f64, moments: &Moments, check: Option<&Moments>, method: &str| {
            let scales = Scales::of(&self.oscillator).each(moments);
            let checks = check.unwrap_or(moments).named();
            // A basis that resolves a concentrated initial condition badly errs everywhere: a difference far below the
            // others passes through zero.
            let badly = self.is_narrow() && method.starts_with("hermite");
            let middle = if badly {
                self.middle(moments, check.unwrap_or(moments))
            } else {
                0.0
            };
            for (k, (name, number)) in moments.named().into_iter().enumerate() {
                let (Some(number), Some(check)) = (number, checks[k].1) else {
                    continue;
                };
                // Closed forms and roundings of a run are good to far better than this.
                let floor = middle.max(1e-10) * scales[k];
                let uncertainty = (number.value - check.value).abs().max(floor);
                if number.value.is_finite() && uncertainty <= KNOWN * scales[k] {
                    references.push(Reference {
                        t,
                        name,
                        value: number.value,
                        uncertainty,
                        method: method.into(),
                    });
                }
            }
        };
        for t in &self.times {
            if let Some((moments, method)) = self.closed(*t) {
                add(*t, &moments, None, method);
            } else {
                let k = open.iter().position(|it| it == t).unwrap();
                let Resolution {
                    elements,
                    degree,
                    modes,
                    ..
                } = fine;
                let method = format!("hermite {elements}x{degree} {modes}");
                match framed.get(k) {
                    Some(it)
                        if self.distance(it, &framed_checks[k])
                            < self.distance(&numbers[k], &checks[k]) =>
                    {
                        add(*t, it, Some(&framed_checks[k]), &format!("moving {MOVING}"));
                    }
                    _ => add(*t, &numbers[k], Some(&checks[k]), &method),
                }
            }
        }
        references
    }
}

/// Moments of a Gaussian law under G = q or G = -1; a constant force has no skewness and no kurtosis.
fn moments_of(law: &Gaussian, contact: &ContactLaw) -> Moments {
    let ([q, v], [[qq, qv], [_, vv]]) = (law.mean, law.covariance);
    let linear = matches!(contact, ContactLaw::Linear);
    let force = if linear {
        [
            q,
            qq + q * q,
            q.powi(3) + 3.0 * q * qq,
            q.powi(4) + 6.0 * q * q * qq + 3.0 * qq * qq,
        ]
    } else {
        [-1.0, 1.0, -1.0, 1.0]
    };
    let raw = RawMoments {
        mass: 1.0,
        q,
        qq: qq + q * q,
        v,
        vv: vv + v * v,
        qv: qv + q * v,
        force,
        potential: if linear { 0.5 * (qq + q * q) } else { -q },
        lost: 0.0,
    };
    let mut it = raw.moments(contact);
    // Free of the cancellation in the raw moments.
    it.var_q.value = qq;
    it.var_v.value = vv;
    it.cov_qv.value = qv;
    if linear {
        it.std_force.value = qq.sqrt();
        it.skewness_force.value = 0.0;
        it.kurtosis_force.value = 3.0;
    }
    it
}

/// What is known less well than this, over the normalisation, judges no error estimate and is not stored.
const KNOWN: f64 = 1e-3;

const ABOUT: &str = "\
# References of the calibration: cargo run --release --bin lab -- precision --calibrate judges error estimates by them.
# Made by: cargo test --release --test all references::write_references -- --ignored --nocapture
# scene: a line of scenes.csv, or from 49 on an entry of contacts.toml.
# method: \"gaussian\" and \"stationary\" are closed forms; \"hermite ExP N\" is E spectral elements of degree P in q
# times N Hermite functions in v (tests/hermite), \"moving N\" N by N Hermite functions in the frame of a
# concentrated initial condition (tests/moving): whichever of the two is less uncertain.
# uncertainty: the difference to a second run with 3/4 of the elements, 7/10 of the functions and a
# smaller truncated domain, or 2/3 of the functions, never below 1e-10 of the normalisation, nor, of a concentrated
# initial condition in the fixed basis, below the median of its time; above 1e-3 of it a number is left out.
# Dimensionless.
scene,t,name,value,uncertainty,method
";

const ABOUT_SCENES: &str = "\
# Scenes of the calibration, drawn in tests/references.rs; times are dimensionless.
scene,contact,zeta,h,start,mean_q,mean_v,deviation_q,deviation_v,times
";

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("validation/precision")
}

/// The stored lines of every scene.
fn stored() -> BTreeMap<usize, String> {
    let text = fs::read_to_string(folder().join("references.csv")).unwrap_or_default();
    let mut it = BTreeMap::<usize, String>::new();
    for line in text.lines() {
        if let Some(scene) = line.split(',').next().and_then(|it| it.parse().ok()) {
            let lines = it.entry(scene).or_default();
            lines.push_str(line);
            lines.push('\n');
        }
    }
    it
}

#[test]
#[ignore = "minutes: makes the stored references again"]
fn write_references() {
    let cases = cases();
    let scenes: String = (1..).zip(&drawn()).map(|(k, it)| it.csv(k)).collect();
    fs::write(
        folder().join("scenes.csv"),
        ABOUT_SCENES.to_owned() + &scenes,
    )
    .unwrap();
    let wanted: Vec<usize> = match std::env::var("SCENES") {
        Ok(list) => list
            .split_whitespace()
            .map(|it| it.parse().unwrap())
            .collect(),
        Err(_) => (1..=cases.len()).collect(),
    };
    let (next, lines) = (AtomicUsize::new(0), Mutex::new(stored()));
    let work = || {
        while let Some(&number) = wanted.get(next.fetch_add(1, Ordering::Relaxed)) {
            let (clock, case) = (Instant::now(), &cases[number - 1]);
            let references = case.references();
            let mut text = String::new();
            for it in &references {
                let _ = writeln!(
                    text,
                    "{number},{},{},{:.12e},{:.1e},{}",
                    it.t, it.name, it.value, it.uncertainty, it.method
                );
            }
            let scale = |it: &&Reference| it.uncertainty;
            let worst = references.iter().map(|it| scale(&it)).fold(0.0, f64::max);
            print!("{}", case.csv(number));
            println!("    {worst:.1e} {:.1} s", clock.elapsed().as_secs_f64());
            let mut lines = lines.lock().unwrap();
            lines.insert(number, text);
            let all: String = lines.values().map(String::as_str).collect();
            fs::write(folder().join("references.csv"), ABOUT.to_owned() + &all).unwrap();
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(work);
        }
    });
}
