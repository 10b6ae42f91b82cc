//! Moments against time, and the approach to the stationary law.

use super::canvas::{BLUE, GREEN, INK, Picture, Points, VERMILION, picture};
use super::legend::{Mark, legend};
use super::panel::{Panel, place, range, with_band};
use crate::estimate::Estimate;
use crate::fokker_planck::DecayRates;
use crate::format::brief;
use crate::moments::{Moment, Moments};
use crate::results::Results;

/// So many times are shown one by one.
const FEW: usize = 20;

/// moments.svg: moments against time with error bands, and Monte Carlo points.
pub(crate) fn moments(results: &Results) -> Picture {
    let it = results.transient.as_ref().filter(|it| it.times.len() > 1)?;
    let loses = it
        .moments
        .iter()
        .any(|it| it.contact_loss_probability.is_some());
    let names = [
        (Moment::MeanQ, "E[q]"),
        (Moment::VarV, "Var q\u{307}"),
        (Moment::StdForce, "\u{3c3}(N)"),
        if loses {
            (Moment::ContactLossProbability, "P(contact lost)")
        } else {
            (Moment::VarQ, "Var q")
        },
    ];
    let few = it.moments.iter().any(|it| it.left_out != 0);
    let asked = |moment: &Moment| it.moments.iter().any(|it| it.get(*moment).is_some());
    let names: Vec<(Moment, &str)> = if few {
        let asked = Moment::ALL.into_iter().filter(asked).take(4);
        asked.map(|it| (it, it.entry().symbol)).collect()
    } else {
        names.to_vec()
    };
    let x = range(it.times.iter().copied().chain([0.0]), 0.0)?;
    let height = if names.len() > 2 { 640 } else { 330 };
    Some(picture("moments.svg", (972, height), |area| {
        for (k, (moment, label)) in names.into_iter().enumerate() {
            let series = |times: &[f64], moments: &[Moments]| -> Vec<(f64, Estimate)> {
                let points = times.iter().zip(moments);
                let there = points.filter_map(|(t, it)| Some((*t, it.get(moment)?)));
                there.collect()
            };
            let mesh = series(&it.times, &it.moments);
            let paths = results.monte_carlo.as_ref();
            let paths = paths.map_or(Vec::new(), |it| series(&it.times, &it.moments));
            let law = results.stationary.as_ref();
            let level = law.and_then(|it| it.get(moment.name()));
            let level = level.map(|it| it.value);
            let Some(y) = heights(&[&mesh, &paths], level) else {
                continue;
            };
            let panel = Panel::new(place(k), x, y);
            panel.axes(area, results.scene.clock().axis(), label)?;
            if let Some(level) = level {
                panel.level(area, level, INK)?;
            }
            let (times, values): (Vec<f64>, Vec<Estimate>) = mesh.into_iter().unzip();
            let (curve, band) = with_band(&times, values);
            panel.band(area, &band, BLUE)?;
            panel.curve(area, &curve, BLUE, 1.5)?;
            // Between few times the motion is not known.
            for at in curve.iter().filter(|_| curve.len() <= FEW) {
                panel.dot(area, *at, BLUE, 2.5)?;
            }
            for (t, y) in thinned(&paths) {
                panel.point(area, t, y, VERMILION)?;
            }
            panel.frame(area)?;
        }
        let words = "Fokker-Planck, band: its error";
        legend(area, (92.0, 20.0), BLUE, Mark::Line, words)?;
        if results.monte_carlo.is_some() {
            let words = "Monte Carlo, bar: one standard error";
            legend(area, (330.0, 20.0), VERMILION, Mark::Dot, words)?;
        }
        if results.stationary.is_some() {
            let words = format!("stationary, {}", results.origin());
            legend(area, (640.0, 20.0), INK, Mark::Dashes, &words)?;
        }
        Ok(())
    }))
}

/// The range of values, widened by their errors, but by no more than as much again: a band that is
/// wider than the motion is cut.
fn heights(curves: &[&[(f64, Estimate)]], level: Option<f64>) -> Option<(f64, f64)> {
    let all = || curves.iter().copied().flatten().map(|(_, y)| y);
    let errors = || all().map(|y| y.error).filter(|error| error.is_finite());
    let widest = errors().fold(0.0, f64::max);
    let first = all().map(|y| y.value).next()?;
    if widest > 0.0 && all().map(|y| y.value).chain(level).all(|y| y == first) {
        return range([first - widest, first + widest], 0.08);
    }
    let (low, high) = range(all().map(|y| y.value).chain(level), 0.0)?;
    let room = high - low;
    let ends = all().flat_map(|y| [y.value - y.error, y.value + y.error]);
    let ends = ends.map(|y| y.clamp(low - room, high + room));
    range(ends.chain(level), 0.08)
}

/// At most 120 points, the last among them.
fn thinned(points: &[(f64, Estimate)]) -> impl Iterator<Item = (f64, Estimate)> + '_ {
    let each = points.len().div_ceil(120).max(1);
    points.iter().rev().step_by(each).copied()
}

/// approach.svg: the distance to the stationary law against time down to its error, with the slowest decay rate's line,
/// and the time integration to the steady state beside it.
pub(crate) fn approach(results: &Results) -> Picture {
    let log = |points: &mut dyn Iterator<Item = (f64, f64)>| -> Points {
        points
            .filter(|(_, y)| *y > 0.0 && y.is_finite())
            .map(|(t, y)| (t, y.log10()))
            .collect()
    };
    let time = results.scene.clock().axis();
    let (mut distance, mut entropy) = (Points::new(), Points::new());
    if let Some(it) = &results.transient {
        // What is below its error is not known.
        let known = |y: &Option<Estimate>| y.filter(|y| y.value > y.error).map(|y| y.value);
        let curve = |numbers: &[Option<Estimate>]| {
            let pairs = it.times.iter().zip(numbers);
            log(&mut pairs.filter_map(|(t, y)| Some((*t, known(y)?))))
        };
        (distance, entropy) = (curve(&it.distance), curve(&it.relative_entropy));
    }
    let integrated = results
        .steady
        .as_ref()
        .map_or(Points::new(), |it| log(&mut it.approach.iter().copied()));
    let panel = |left: f64, curves: [&Points; 2]| {
        let all = || curves.into_iter().flatten();
        let x = range(all().map(|(t, _)| *t).chain([0.0]), 0.0)?;
        let (low, high) = range(all().map(|(_, y)| *y), 0.05)?;
        // Sixteen decades down there is only rounding.
        let y = (low.floor().max(high.ceil() - 17.0), high.ceil());
        let enough = curves.iter().any(|curve| curve.len() > 1) && y.1 > y.0;
        enough.then_some(Panel::new([left, 44.0, 374.0, 320.0], x, y).logarithmic(true))
    };
    let first = panel(92.0, [&distance, &entropy]);
    let left = if first.is_some() { 570.0 } else { 92.0 };
    let second = panel(left, [&integrated, &Points::new()]);
    let last = second.as_ref().or(first.as_ref())?;
    let size = ((last.right() + 28.0) as u32, 420);
    let decay = results.decay_rates.as_ref().and_then(Decay::of);
    Some(picture("approach.svg", size, |area| {
        if let Some(panel) = &first {
            panel.title(area, "Approach to the stationary law")?;
            panel.axes(area, time, "distance to it")?;
            panel.curve(area, &distance, BLUE, 2.0)?;
            panel.curve(area, &entropy, VERMILION, 2.0)?;
            let (x, y) = (panel.right() - 246.0, panel.top + 16.0);
            let mut legends = vec![(BLUE, Mark::Line, "L\u{b9} distance".to_owned())];
            if !entropy.is_empty() {
                legends.push((VERMILION, Mark::Line, "relative entropy".into()));
            }
            if let Some((decay, from)) = decay.zip(distance.get(distance.len() * 2 / 3)) {
                let line = decay.line(*from, panel.x);
                panel.dashes(area, &line, GREEN, 1.5)?;
                legends.push((GREEN, Mark::Dashes, decay.words()));
            }
            panel.frame(area)?;
            for (k, (colour, mark, words)) in legends.into_iter().enumerate() {
                legend(area, (x, y + 18.0 * k as f64), colour, mark, &words)?;
            }
        }
        if let Some(panel) = &second {
            panel.title(area, "Time integration to the steady state")?;
            panel.axes(area, time, "L\u{b9} distance to the closed form")?;
            panel.curve(area, &integrated, BLUE, 2.0)?;
            panel.frame(area)?;
        }
        Ok(())
    }))
}

/// How distances to the stationary law fall in the end: as t^power e^{rate t}.
#[derive(Clone, Copy)]
struct Decay {
    rate: f64,
    power: f64,
}

impl Decay {
    /// The slowest eigenvalue's, or where none lies above the continuous spectrum, that of its edge.
    fn of(it: &DecayRates) -> Option<Self> {
        let edge = it.continuous_from.filter(|rate| *rate < 0.0);
        let edge = edge.map(|rate| Self { rate, power: -1.5 });
        let slowest = it.rates.first().map(|it| Self {
            rate: it.re,
            power: 0.0,
        });
        slowest.or(edge)
    }

    /// log10 of it over times, through a point.
    fn line(self, (t, y): (f64, f64), times: (f64, f64)) -> Points {
        let pieces = 120;
        let at = |k: usize| times.0 + (times.1 - times.0) * k as f64 / pieces as f64;
        let change = |x: f64| self.power * (x / t).ln() + self.rate * (x - t);
        let point = |x: f64| (x, y + change(x) / std::f64::consts::LN_10);
        (1..=pieces).map(|k| point(at(k))).collect()
    }

    fn words(self) -> String {
        let words = if self.power == 0.0 {
            format!("slowest eigenvalue, {}", brief(self.rate))
        } else {
            format!("t^(-3/2) exp({} t)", brief(self.rate))
        };
        words.replace('-', "\u{2212}")
    }
}
