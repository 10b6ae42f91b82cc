//! Spectra.

use super::canvas::{BLUE, GREY, Points, TITLE, VERMILION, picture, write};
use super::legend::{Mark, legend};
use super::panel::{Panel, range};
use crate::error::Result;
use crate::format::brief;
use crate::oscillator::Quantity;
use crate::report::File;
use crate::results::Results;
use crate::spectrum::displacement_per_hertz;
use crate::spectrum::per_hertz;

/// spectrum.svg: the one-sided spectrum, logarithmic, against omega or hertz; from the resolvent, by
/// Welch's method with its 95 % band, and of the linear oscillator.
pub(crate) fn spectrum(results: &Results) -> Result<Vec<File>> {
    let Some(it) = results
        .spectrum
        .as_ref()
        .filter(|it| it.solved.omega.len() > 1)
    else {
        return Ok(Vec::new());
    };
    let force = it.solved.quantity == Quantity::Force;
    let (scale, hertz, x_label, y_label) = match &results.scene.rig {
        None if force => (1.0, 1.0, "\u{3c9}", "spectrum of the force"),
        None => (1.0, 1.0, "\u{3c9}", "spectrum of the displacement"),
        Some(rig) if force => (
            per_hertz(rig),
            rig.hertz(1.0),
            "frequency, Hz",
            "force, N\u{b2}/Hz",
        ),
        Some(rig) => (
            displacement_per_hertz(rig),
            rig.hertz(1.0),
            "frequency, Hz",
            "displacement, \u{b5}m\u{b2}/Hz",
        ),
    };
    let log = |g: f64| (g * scale).log10();
    let x: Vec<f64> = it.solved.omega.iter().map(|w| w * hertz).collect();
    let curve = |values: &mut dyn Iterator<Item = f64>| -> Points {
        x.iter().copied().zip(values.map(log)).collect()
    };
    let solved = curve(&mut it.solved.density.iter().map(|it| it.value));
    let linear = curve(&mut it.linear.iter().copied());
    let heights = solved.iter().chain(&linear).map(|(_, y)| *y);
    let Some((low, high)) = range(heights, 0.06) else {
        return Ok(Vec::new());
    };
    let panel = Panel::new(
        [92.0, 44.0, 640.0, 360.0],
        (0.0, x[x.len() - 1]),
        (low, high),
    )
    .logarithmic(true);
    picture("spectrum.svg", (760, 462), |area| {
        let title = format!(
            "One-sided spectrum, {} contact, h = {}",
            results.contact().name(),
            brief(results.scene.oscillator.h())
        );
        write(area, &title, (panel.left, 22.0), TITLE)?;
        panel.axes(area, x_label, y_label)?;
        panel.curve(area, &linear, GREY, 1.0)?;
        let x_legend = panel.right() - 282.0;
        let mut y_legend = 62.0;
        let mut entry = |colour, mark, words: &str| {
            let drawn = legend(area, (x_legend, y_legend), colour, mark, words);
            y_legend += 19.0;
            drawn
        };
        if let Some(sampled) = &it.sampled {
            let bands = x.iter().zip(&sampled.density);
            let bands: Vec<(f64, f64, f64)> = bands
                .map(|(x, g)| {
                    let reach = 1.96 * g.error;
                    (*x, log(g.value - reach), log(g.value + reach))
                })
                .collect();
            panel.band(area, &bands, VERMILION)?;
            let welch = curve(&mut sampled.density.iter().map(|it| it.value));
            panel.curve(area, &welch, VERMILION, 0.75)?;
        }
        panel.curve(area, &solved, BLUE, 1.5)?;
        panel.frame(area)?;
        entry(BLUE, Mark::Line, "Fokker-Planck")?;
        if let Some(sampled) = &it.sampled {
            let words = format!("Monte Carlo, {} averages, 95 %", sampled.averages);
            entry(VERMILION, Mark::Line, &words)?;
        }
        entry(GREY, Mark::Line, "linear oscillator")
    })
    .map(|it| vec![it])
}
