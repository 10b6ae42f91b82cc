//! Survival until the first loss of contact, and times of flight.

use super::canvas::{BLUE, INK, Picture, Points, VERMILION, picture};
use super::legend::{Mark, legend, legends};
use super::panel::{Panel, range, with_band};
use crate::fokker_planck::FirstLoss;
use crate::format::bare;
use crate::monte_carlo::FirstLossResult;
use crate::results::{Results, centres};

/// survival.svg: survival until the first loss of contact, and its density on a logarithmic scale, from
/// the backward equation and from paths.
pub(crate) fn survival(results: &Results) -> Picture {
    let title = "First loss of contact: survival, and density of its time";
    let (solved, paths) = (&results.first_loss, &results.first_loss_paths);
    curves(results, ("survival.svg", title), (solved, paths))
}

/// passage.svg: the same of a level.
pub(crate) fn passage(results: &Results) -> Picture {
    let asked = results.scene.outputs.first_passage?;
    let words = asked.side.words().join(" ");
    let level = bare(asked.level).replace('-', "\u{2212}");
    let title = format!("First passage of {words} {level}: survival, and density of its time");
    let (solved, paths) = (&results.first_passage, &results.first_passage_paths);
    curves(results, ("passage.svg", &title), (solved, paths))
}

/// Where no more than this is lost in all, the curve is that of what is lost: beside 1 it would not show.
const RARE: f64 = 0.02;

fn curves(
    results: &Results,
    (file, title): (&str, &str),
    (solved, paths): (&Option<FirstLoss>, &Option<FirstLossResult>),
) -> Picture {
    let it = solved.as_ref()?;
    let time = results.scene.clock().axis();
    let until = it.times[it.times.len() - 1];
    let rare = it.lost.last().is_some_and(|it| it.value < RARE);
    let (label, shown) = if rare {
        ("1 \u{2212} survival", &it.lost)
    } else {
        ("survival", &it.survival)
    };
    let (linear, survival_band) = with_band(&it.times, shown.iter().copied());
    let (density, density_band) = with_band(&it.times, it.density.iter().copied());
    let log = |p: f64| p.max(1e-300).log10();
    let logarithmic: Points = density.into_iter().map(|(t, p)| (t, log(p))).collect();
    let density_band = density_band
        .into_iter()
        .map(|(t, a, b)| (t, log(a), log(b)));
    let density_band: Vec<(f64, f64, f64)> = density_band.collect();
    // Whatever is on the way to the peak, six decades at the most.
    let heights = || logarithmic.iter().map(|it| it.1);
    let top = heights().fold(f64::NEG_INFINITY, f64::max);
    let bottom = heights().fold(f64::INFINITY, f64::min);
    let y = range(linear.iter().map(|(_, s)| *s), 0.08).filter(|_| top > -299.0)?;
    let left = Panel::new([92.0, 44.0, 390.0, 320.0], (0.0, until), y);
    let right = Panel {
        left: 592.0,
        width: 376.0,
        y: (bottom.max(top - 6.0) - 0.4, top + 0.4),
        log: true,
        ..left.clone()
    };
    Some(picture(file, (990, 420), |area| {
        left.title(area, title)?;
        left.axes(area, time, label)?;
        right.axes(area, time, "density")?;
        left.band(area, &survival_band, BLUE)?;
        left.curve(area, &linear, BLUE, 1.5)?;
        right.band(area, &density_band, BLUE)?;
        right.curve(area, &logarithmic, BLUE, 1.5)?;
        if let Some(paths) = paths {
            // Dots apart enough to be told from each other.
            let each = paths.times.len().div_ceil(40);
            for (k, t) in paths.times.iter().enumerate().skip(each).step_by(each) {
                let survival = paths.survival[k].value;
                let y = if rare { 1.0 - survival } else { survival };
                left.dot(area, (*t, y), VERMILION, 2.0)?;
                // A mean since the time before stands in the middle.
                let middle = 0.5 * (t + paths.times[k - 1]);
                let y = log(paths.density[k].value);
                right.dot(area, (middle, y), VERMILION, 2.0)?;
            }
        }
        left.frame(area)?;
        right.frame(area)?;
        let sampled = paths.iter().map(|_| (VERMILION, Mark::Dot, "paths"));
        let entries = [(BLUE, Mark::Line, "backward equation, band: its error")].into_iter();
        let x = if rare {
            left.left + 14.0
        } else {
            left.right() - 272.0
        };
        legends(area, (x, 62.0), entries.chain(sampled))
    }))
}

/// flights.svg: the density of the time from a loss of contact to the return, from long realisations, and what
/// it would be without noise and friction in flight, and the law of the first return where it is solved.
pub(crate) fn flights(results: &Results) -> Picture {
    let seen = results.sampled_crossings().zip(results.sampled_flights());
    let law = results.flights.as_ref();
    if seen.is_none() && law.is_none() {
        return None;
    }
    let contact = results.contact();
    let fall = -contact.force(contact.loss_point()?);
    // The speed of a loss has the Rayleigh law of scale sqrt(T), and a free flight lasts 2 v/fall.
    let clock = results.scene.clock();
    let scale = clock.time(2.0 * results.scene.oscillator.temperature().sqrt() / fall);
    let free = |t: f64| t / (scale * scale) * (-0.5 * (t / scale).powi(2)).exp();
    let end = 4.5 * scale;
    // Between two walls a flight has no such law.
    let walled = contact.back_wall().is_some();
    let ballistic: Points = (0..=if walled { 0 } else { 300 })
        .map(|k| end * f64::from(k) / 300.0)
        .map(|t| (t, free(t)))
        .collect();
    let sampled = seen.iter().flat_map(|(_, it)| centres(it).zip(&it.density));
    let tops = sampled.filter(|(t, _)| *t <= end);
    let tops = tops.map(|(_, p)| p.value + 1.96 * p.error);
    let noisy: Points = law.map_or(Vec::new(), |it| {
        let density = it.density.iter().map(|p| p.value);
        it.times.iter().copied().zip(density).collect()
    });
    let shown = noisy.iter().filter(|(t, _)| *t <= end).map(|it| it.1);
    let most = tops.chain(shown).chain([free(scale)]).fold(0.0, f64::max);
    if !(most.is_finite() && end.is_finite()) {
        return None;
    }
    let panel = Panel::new([92.0, 44.0, 470.0, 320.0], (0.0, end), (0.0, 1.12 * most));
    Some(picture("flights.svg", (590, 420), |area| {
        let title = match &seen {
            Some(((seen, _), _)) => {
                format!("Time of flight: density, {} losses of contact", seen.losses)
            }
            None => "Time of flight: density".into(),
        };
        panel.title(area, &title)?;
        let label = format!("from loss to return, {}", clock.axis());
        panel.axes(area, &label, "density")?;
        if let Some((_, it)) = &seen {
            panel.histogram(area, it)?;
        }
        panel.curve(area, &noisy, BLUE, 1.5)?;
        panel.dashes(area, &ballistic, INK, 1.25)?;
        panel.frame(area)?;
        let x = panel.right() - 232.0;
        if !walled {
            let exact = (BLUE, Mark::Line, "first return, closed form");
            let free = (INK, Mark::Dashes, "no noise, no friction in flight");
            legends(area, (x, 62.0), [exact, free])?;
        }
        if seen.is_some() {
            let words = "long realisations, band: 95 %";
            legend(area, (x, 100.0), VERMILION, Mark::Dot, words)?;
        }
        Ok(())
    }))
}
