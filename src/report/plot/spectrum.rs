//! Spectra.

use super::canvas::{BLUE, GREY, Picture, Points, VERMILION, picture};
use super::legend::{Mark, legends};
use super::panel::{Panel, range};
use crate::estimate::Estimate;
use crate::format::brief;
use crate::oscillator::Quantity;
use crate::results::{Results, SampledSpectrum};
use crate::spectrum::{displacement_per_hertz, per_hertz};

/// spectrum.svg: the one-sided spectrum, logarithmic, against omega or hertz; from the resolvent, by
/// Welch's method with its 95 % band, and of the linear oscillator.
pub(crate) fn spectrum(results: &Results) -> Picture {
    let it = results.spectrum.as_ref()?;
    let last = *it.solved.omega.get(1..)?.last()?;
    let force = it.solved.quantity == Quantity::Force;
    let (scale, hertz, x_label, y_label) = match &results.scene.rig() {
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
    // Where the error is as large as the value: to the lower end of the panel.
    let band = |times: f64, values: &[Estimate]| -> Vec<(f64, f64, f64)> {
        let ends = |g: &Estimate| [-times, times].map(|z| log((g.value + z * g.error).max(0.0)));
        let ends = values.iter().map(ends);
        x.iter().zip(ends).map(|(x, [a, b])| (*x, a, b)).collect()
    };
    let errors = band(1.0, &it.solved.density);
    let solved = curve(&mut it.solved.density.iter().map(|it| it.value));
    let linear = curve(&mut it.linear.iter().copied());
    let heights = solved.iter().chain(&linear).map(|(_, y)| *y);
    let (end, y) = (last * hertz, range(heights, 0.06)?);
    let panel = Panel::new([92.0, 44.0, 640.0, 360.0], (0.0, end), y).logarithmic(true);
    Some(picture("spectrum.svg", (760, 462), |area| {
        let title = format!(
            "One-sided spectrum, {} contact, h = {}",
            results.contact().name(),
            brief(results.scene.oscillator.h())
        );
        panel.title(area, &title)?;
        panel.axes(area, x_label, y_label)?;
        panel.curve(area, &linear, GREY, 1.0)?;
        if let Some(sampled) = &it.sampled {
            panel.band(area, &band(1.96, &sampled.density), VERMILION)?;
            let welch = curve(&mut sampled.density.iter().map(|it| it.value));
            panel.curve(area, &welch, VERMILION, 0.75)?;
        }
        panel.band(area, &errors, BLUE)?;
        panel.curve(area, &solved, BLUE, 1.5)?;
        panel.frame(area)?;
        let words = |it: &SampledSpectrum| format!("Monte Carlo, {} averages, 95 %", it.averages);
        let words = it.sampled.as_ref().map(words);
        let mut entries = vec![(BLUE, Mark::Line, "Fokker-Planck, band: its error")];
        entries.extend(words.iter().map(|it| (VERMILION, Mark::Line, &it[..])));
        entries.push((GREY, Mark::Line, "linear oscillator"));
        legends(area, (panel.right() - 282.0, 62.0), entries)
    }))
}
