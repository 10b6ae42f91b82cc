//! The pictures beside the numbers, with the axes of the paper's figures.

use super::cosines::Procedure;
use super::run::Run;
use super::spectra::Spectra;
use crate::plot::{Chart, Curve, Ink, Stroke, charts};
use vibroimpact::contact::ContactLaw;
use vibroimpact::error::Result;
use vibroimpact::estimate::Estimate;
use vibroimpact::fokker_planck::Response;
use vibroimpact::moments::Moment;
use vibroimpact::noise_free;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::report::{File, npz};
use vibroimpact::results::centres;
use vibroimpact::rig::Rig;
use vibroimpact::stationary::Stationary;

/// The pictures of a folder by its name; none for a name that stands for no figure.
pub fn of(folder: &str, runs: &[Run], known: &Spectra) -> Result<Vec<File>> {
    let charts_of = |each: &dyn Fn(&Run) -> Result<Option<Chart>>| -> Result<Vec<Chart>> {
        let all = runs.iter().map(each);
        all.filter_map(Result::transpose).collect()
    };
    let panels = match folder {
        "figure-3" | "figure-6" | "figure-8" | "figure-9" => charts_of(&density)?,
        "figure-4" | "figure-7" => charts_of(&trace)?,
        "figure-2" | "figure-5" => charts_of(&|run| spectrum(run, known, true))?,
        "figure-10" | "figure-11" | "figure-12" => charts_of(&|run| spectrum(run, known, false))?,
        "figure-13" => charts_of(&|run| both_laws(run, known))?,
        "approach" => charts_of(&|run| Ok(approach(run)))?,
        "damping-laws" => dampings(runs),
        "resonance" => resonance(runs),
        _ => Vec::new(),
    };
    if panels.is_empty() {
        return Ok(Vec::new());
    }
    let columns = match folder {
        "figure-4" | "figure-7" => 1,
        _ => 3,
    };
    let mut files = vec![charts(&format!("{folder}.svg"), columns, &panels)?];
    match folder {
        "figure-10" | "figure-11" | "figure-12" => files.push(arrays(folder, runs, known, false)?),
        "figure-13" => files.push(arrays(folder, runs, known, true)?),
        _ => {}
    }
    Ok(files)
}

/// The spectra of a figure: level by frequency, one-sided, their integral over omega the variance of N.
fn arrays(folder: &str, runs: &[Run], known: &Spectra, both: bool) -> Result<File> {
    let levels = runs.iter().map(|run| &run.results.scene.oscillator);
    let levels: Vec<&Oscillator> = levels.collect();
    let axis = |name: &str, at: Vec<f64>| (name.to_owned(), vec![at.len()], at);
    let mut arrays = vec![axis("h", levels.iter().map(|it| it.h()).collect())];
    if let Some(first) = levels.first() {
        arrays.push(axis("omega", known.of(first)?.omega.clone()));
        let sampled = known.sampled(first)?;
        arrays.push(axis("omega_monte_carlo", sampled.omega.clone()));
    }
    let laws = [
        ("hertz", ContactLaw::Hertz),
        ("bilinear", ContactLaw::Bilinear),
    ];
    for (name, law) in laws.into_iter().take(if both { 2 } else { 1 }) {
        let mut rows: [Vec<Vec<f64>>; 4] = Default::default();
        for level in &levels {
            let it = Oscillator::new(law.clone(), level.zeta(), level.h())?;
            let (solved, sampled) = (known.of(&it)?, known.sampled(&it)?);
            let pairs = [&solved.density, &sampled.density];
            for (pair, all) in rows.chunks_exact_mut(2).zip(pairs) {
                pair[0].push(all.iter().map(|p| p.value).collect());
                pair[1].push(all.iter().map(|p| p.error).collect());
            }
        }
        let words = ["fokker_planck", "error", "monte_carlo", "standard_error"];
        for (word, rows) in words.into_iter().zip(rows) {
            // Every level has the frequencies of the first: they follow from zeta alone.
            let shape = vec![rows.len(), rows.first().map_or(0, Vec::len)];
            arrays.push((format!("{name}_{word}"), shape, rows.concat()));
        }
    }
    npz::archive(&format!("{folder}.npz"), arrays)
}

/// p_N over N: closed form, long realisations as circles, the Dirac mass as a bar with its probability in the title.
fn density(run: &Run) -> Result<Option<Chart>> {
    let oscillator = &run.results.scene.oscillator;
    let law = Stationary::of(oscillator)?;
    let std = law.std_force().value;
    // Below flight there is nothing.
    let low = (-5.0 * std).max(-1.25);
    let high = 5.0 * std;
    let points = 600;
    let even = (0..=points).map(|k| low + (high - low) * f64::from(k) / f64::from(points));
    // Towards the infinite value at flight (29) the bar of the Dirac mass hides the line.
    let hidden = -1.0..-1.0 + 0.006 * (high - low);
    let abscissae = even.filter(|n| !hidden.contains(n));
    let exact = abscissae.map(|n| (n, law.density_force(n))).collect();
    let words = "closed form (28)";
    let mut curves = vec![Curve::new(words, Ink::Black, Stroke::Line, exact)];
    if let Some(records) = &run.results.records {
        let dots = centres(&records.force).zip(&records.force.density);
        let dots = dots.map(|(n, p)| (n, p.value)).collect();
        let words = "Monte Carlo";
        curves.push(Curve::new(words, Ink::Vermilion, Stroke::Circles, dots));
    }
    let top = 1.25 * law.density_force(0.0);
    let mut title = run.label.clone();
    if let Some(lost) = law.contact_loss_probability().filter(|it| it.value > 1e-6) {
        title = format!("{title}, P(N = \u{2212}1) = {:.4}", lost.value);
        let bar = vec![(-1.0, 0.0), (-1.0, 0.9 * top)];
        let words = "Dirac mass of that probability";
        curves.push(Curve::new(words, Ink::Blue, Stroke::Thick, bar));
    }
    Ok(Some(Chart {
        title,
        x_label: "elastic restoring force, N".into(),
        y_label: "p(N)".into(),
        x: (low, high),
        y: (0.0, top),
        log: false,
        curves,
    }))
}

/// N over time in seconds, by the paper's procedure.
fn trace(run: &Run) -> Result<Option<Chart>> {
    /// 48 periods of 4.3 ms: two tenths of a second.
    const PERIODS: u32 = 48;
    let oscillator = &run.results.scene.oscillator;
    let rig = Rig::new(110.0, 232.0, 7e-6)?;
    let procedure = Procedure {
        steps: 50,
        ..Procedure::default()
    };
    let points = procedure.trace(oscillator, 1, PERIODS).into_iter();
    let points: Vec<_> = points.map(|(t, n)| (rig.seconds(t), n)).collect();
    let end = points.last().map_or(1.0, |it| it.0);
    let most = points.iter().map(|it| it.1).fold(1.1f64, f64::max);
    let least = points.iter().map(|it| it.1).fold(0.0f64, f64::min);
    let small = most.max(-least) < 1.2 && points.iter().all(|it| it.1.abs() < 0.9);
    let reach = points.iter().map(|it| it.1.abs()).fold(0.0f64, f64::max);
    Ok(Some(Chart {
        title: run.label.clone(),
        x_label: "time, s".into(),
        y_label: "N".into(),
        x: (0.0, end),
        y: if small {
            (-1.15 * reach, 1.15 * reach)
        } else {
            (-1.25, 1.1 * most)
        },
        log: false,
        curves: vec![Curve::new("", Ink::Blue, Stroke::Line, points)],
    }))
}

/// The RMS magnitude spectrum of N: over the circular frequency, or over the frequency on the rig.
fn spectrum(run: &Run, known: &Spectra, on_the_rig: bool) -> Result<Option<Chart>> {
    let oscillator = &run.results.scene.oscillator;
    let magnitude = |part: Part| magnitude(oscillator, known, on_the_rig, part);
    let curve = magnitude(Part::Value)?;
    let mut curves = vec![Curve::new("Fokker-Planck", Ink::Blue, Stroke::Line, curve)];
    if !on_the_rig {
        // Where the resolution did not fit the time: as far as the error goes.
        let mut edges = magnitude(Part::Highest)?;
        edges.extend(magnitude(Part::Lowest)?.into_iter().rev());
        curves.push(Curve::new("its error", Ink::Black, Stroke::Band, edges));
        let expected = expected(oscillator, known)?;
        let words = "what Welch's method expects";
        curves.push(Curve::new(words, Ink::Grey, Stroke::Dashes, expected));
        let dots = welch(oscillator, known)?;
        let words = "Monte Carlo, Welch";
        curves.push(Curve::new(words, Ink::Vermilion, Stroke::Circles, dots));
    }
    Ok(Some(spectra(run, on_the_rig, curves)))
}

/// log10 of sqrt(G) by Welch's method, every sixth frequency: circles that can be told apart. Its resolution
/// is 1.5 times 0.009, wider than a peak of width 2 zeta.
fn welch(oscillator: &Oscillator, known: &Spectra) -> Result<Vec<(f64, f64)>> {
    let it = known.sampled(oscillator)?;
    let points = it.omega.iter().zip(&it.density).skip(1).step_by(6);
    Ok(points.map(|(w, p)| (*w, 0.5 * p.value.log10())).collect())
}

/// log10 of sqrt(G) as window and sampling show it.
fn expected(oscillator: &Oscillator, known: &Spectra) -> Result<Vec<(f64, f64)>> {
    let it = known.sampled(oscillator)?;
    let points = it.omega.iter().zip(&it.expectation).skip(1);
    let points = points.filter(|(_, p)| **p > 0.0);
    Ok(points.map(|(w, p)| (*w, 0.5 * p.log10())).collect())
}

/// Hertz as a thin line and the bilinear law (34) as a thick one, as in Figure 13.
fn both_laws(run: &Run, known: &Spectra) -> Result<Option<Chart>> {
    let hertz = &run.results.scene.oscillator;
    let linear = Oscillator::new(ContactLaw::Bilinear, hertz.zeta(), hertz.h())?;
    let thick = magnitude(&linear, known, false, Part::Value)?;
    let thin = magnitude(hertz, known, false, Part::Value)?;
    let curves = vec![
        Curve::new("linear in contact (34)", Ink::Grey, Stroke::Thick, thick),
        Curve::new("Hertz", Ink::Blue, Stroke::Line, thin),
        Curve::new(
            "Monte Carlo, Welch, Hertz",
            Ink::Vermilion,
            Stroke::Circles,
            welch(hertz, known)?,
        ),
        Curve::new(
            "Monte Carlo, Welch, linear",
            Ink::Black,
            Stroke::Circles,
            welch(&linear, known)?,
        ),
    ];
    Ok(Some(spectra(run, false, curves)))
}

/// A density, or an end of its error bar.
#[derive(Clone, Copy)]
enum Part {
    Value,
    Highest,
    Lowest,
}

/// log10 of sqrt(G): of N over the circular frequency, or in newtons per root hertz over hertz.
fn magnitude(
    oscillator: &Oscillator,
    known: &Spectra,
    on_the_rig: bool,
    part: Part,
) -> Result<Vec<(f64, f64)>> {
    let it = known.of(oscillator)?;
    let rig = Rig::new(110.0, 232.0, 7e-6)?;
    let (x, y) = if on_the_rig {
        // The integral over frequency stays the variance.
        (rig.hertz(1.0), rig.newtons(1.0) / rig.hertz(1.0).sqrt())
    } else {
        (1.0, 1.0)
    };
    let points = it.omega.iter().zip(&it.density);
    let log = |p: f64| (y * p.max(0.0).sqrt()).log10();
    let density = |p: &Estimate| match part {
        Part::Value => p.value,
        Part::Highest => p.value + p.error,
        // A tenth of the value, where the error is as large: off the picture, not at minus infinity.
        Part::Lowest => (p.value - p.error).max(0.1 * p.value),
    };
    Ok(points.map(|(w, p)| (x * w, log(density(p)))).collect())
}

fn spectra(run: &Run, on_the_rig: bool, curves: Vec<Curve>) -> Chart {
    let top = curves.iter().flat_map(|it| &it.points).map(|it| it.1);
    let top = top.fold(f64::NEG_INFINITY, f64::max);
    let (x_label, y_label, end) = if on_the_rig {
        ("frequency, Hz", "RMS magnitude, N/\u{221a}Hz", 1000.0)
    } else {
        (
            "dimensionless circular frequency, \u{3d6}",
            "RMS magnitude of N",
            4.4,
        )
    };
    Chart {
        title: run.label.clone(),
        x_label: x_label.into(),
        y_label: y_label.into(),
        x: (0.0, end),
        y: (top - 4.0, top + 0.3),
        log: true,
        curves,
    }
}

/// Deviation of N, its skewness and the probability of a loss under each damping law, over those of the viscous one.
fn dampings(runs: &[Run]) -> Vec<Chart> {
    let number = |run: &Run, moment: Moment| {
        let law = run.results.stationary.as_ref()?;
        // What hardly ever happens has no ratio that a picture could show.
        law.get(moment.name())
            .filter(|it| it.value > 1e-6 && it.value > 10.0 * it.error)
    };
    let inks = [
        ("viscous", Ink::Black, Stroke::Line),
        ("contact", Ink::Vermilion, Stroke::Circles),
        ("hunt_crossley", Ink::Blue, Stroke::Circles),
    ];
    let chart = |(moment, words, y): (Moment, &str, (f64, f64))| {
        let curve = |(name, ink, stroke): (&str, Ink, Stroke)| {
            let of = runs
                .iter()
                .filter(|run| run.results.scene.oscillator.damping().name() == name);
            let point = |run: &Run| {
                let h = run.results.scene.oscillator.h();
                let base = runs.iter().find(|it| {
                    let it = &it.results.scene.oscillator;
                    it.h() == h && it.is_viscous()
                })?;
                Some((
                    h.log10(),
                    number(run, moment)?.value / number(base, moment)?.value,
                ))
            };
            Curve::new(name, ink, stroke, of.filter_map(point).collect())
        };
        Chart {
            title: format!("{words} over that of viscous damping"),
            x_label: "log10 h".into(),
            y_label: "ratio".into(),
            x: (-5.7, -2.3),
            y,
            log: false,
            curves: inks.into_iter().map(curve).collect(),
        }
    };
    [
        (Moment::StdForce, "deviation of N", (0.9, 1.2)),
        (Moment::SkewnessForce, "skewness of N", (0.8, 1.6)),
        (Moment::ContactLossProbability, "P(q < -3/2)", (0.5, 2.5)),
    ]
    .into_iter()
    .map(chart)
    .collect()
}

/// Response curves of all levels over the orbits without noise, and the probability of a loss.
fn resonance(runs: &[Run]) -> Vec<Chart> {
    // Quiet ones and the linear law have a few points each.
    let curves = runs.iter().filter_map(|run| {
        let curve = run.results.response.as_ref()?;
        (curve.frequency.len() > 3).then_some((run, curve))
    });
    let levels: Vec<(&Run, &Response)> = curves.collect();
    let Some((first, curve)) = levels.first() else {
        return Vec::new();
    };
    let scene = &first.results.scene;
    let orbits = scene.excitation.drive.map_or(Vec::new(), |drive| {
        noise_free::orbits(&scene.oscillator, &drive, &curve.frequency)
    });
    let of = |stable: bool| -> Vec<(f64, f64)> {
        let these = orbits
            .iter()
            .filter(|(_, it)| (it.multiplier < 1.0) == stable);
        these.map(|(w, it)| (*w, it.amplitude)).collect()
    };
    let lines = |number: fn(&Response, usize) -> Option<f64>| -> Vec<Curve> {
        let line = |(k, (run, it)): (usize, &(&Run, &Response))| {
            let points = it.frequency.iter().enumerate();
            let points = points.filter_map(|(k, w)| Some((*w, number(it, k)?)));
            let ink = [Ink::Blue, Ink::Vermilion, Ink::Green][k % 3];
            let stroke = [Stroke::Line, Stroke::Dashes][k / 3 % 2];
            Curve::new(&run.label, ink, stroke, points.collect())
        };
        levels.iter().enumerate().map(line).collect()
    };
    let mut amplitudes = vec![
        Curve::new("no noise, stable", Ink::Black, Stroke::Circles, of(true)),
        Curve::new("unstable", Ink::Grey, Stroke::Circles, of(false)),
    ];
    amplitudes.extend(lines(|it, k| Some(it.mean_q_1[k].value)));
    let losses = lines(|it, k| Some(it.contact_loss_probability.as_ref()?[k].value));
    let lives = lines(|it, k| Some((-1.0 / it.multiplier[k].value.ln()).log10()));
    let ends = curve.frequency.first().zip(curve.frequency.last());
    let chart = |title: &str, y_label: &str, log: bool, curves: Vec<Curve>| {
        let points = curves.iter().flat_map(|it| &it.points);
        let highest = points.map(|it| it.1).fold(0.0, f64::max);
        Chart {
            title: title.into(),
            x_label: "frequency of the drive, W".into(),
            y_label: y_label.into(),
            x: ends.map_or((0.0, 1.0), |(a, b)| (*a, *b)),
            y: (0.0, 1.08 * highest),
            log,
            curves,
        }
    };
    vec![
        chart("first harmonic of E[q]", "amplitude", false, amplitudes),
        chart("contact lost", "P(q < -3/2), mean", false, losses),
        chart("slowest deviation", "life in periods", true, lives),
    ]
}

/// Relative entropy, L1 distance and loss probability against time.
fn approach(run: &Run) -> Option<Chart> {
    let it = run.results.transient.as_ref()?;
    let log = |numbers: Vec<Option<f64>>| -> Vec<(f64, f64)> {
        let pairs = it.times.iter().zip(numbers);
        let pairs = pairs.filter_map(|(t, y)| Some((*t, y.filter(|y| *y > 0.0)?.log10())));
        pairs.collect()
    };
    let entropy = log(it
        .relative_entropy
        .iter()
        .map(|y| y.map(|y| y.value))
        .collect());
    let distance = log(it.distance.iter().map(|y| y.map(|y| y.value)).collect());
    let lost = it.moments.iter();
    let lost = lost.map(|m| m.contact_loss_probability.map(|p| p.value));
    let lost = log(lost.collect());
    let end = it.times.last().copied().unwrap_or(1.0);
    let mut curves = vec![
        Curve::new("relative entropy", Ink::Vermilion, Stroke::Line, entropy),
        Curve::new("L\u{b9} distance", Ink::Blue, Stroke::Line, distance),
        Curve::new("P(contact lost)", Ink::Green, Stroke::Line, lost),
    ];
    let stationary = run.results.stationary.as_ref();
    let level = stationary.and_then(|it| it.get("contact_loss_probability"));
    if let Some(level) = level.filter(|it| it.value > 0.0) {
        let y = level.value.log10();
        let words = "P, stationary";
        let line = vec![(0.0, y), (end, y)];
        curves.push(Curve::new(words, Ink::Black, Stroke::Dashes, line));
    }
    Some(Chart {
        title: run.label.clone(),
        x_label: "t".into(),
        y_label: "distance to (21), probability".into(),
        x: (0.0, end),
        y: (-7.0, 1.5),
        log: true,
        curves,
    })
}
