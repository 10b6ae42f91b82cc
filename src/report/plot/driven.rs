//! What lasts under a drive: the periodic law over the phase, and the response curve.

use super::canvas::{BLUE, GREY, INK, Picture, TITLE, picture, write};
use super::legend::{Mark, legend};
use super::panel::{Panel, place, range, with_band};
use crate::estimate::Estimate;
use crate::fokker_planck::Sweep;
use crate::moments::Moment;
use crate::noise_free;
use crate::results::Results;
use std::f64::consts::TAU;

/// periodic.svg: four moments over the phase, with error bands.
pub(crate) fn periodic(results: &Results) -> Picture {
    let it = results.periodic.as_ref()?;
    let asked = |moment: &Moment| it.moments.iter().all(|at| at.get(*moment).is_some());
    let first = [
        Moment::MeanQ,
        Moment::StdForce,
        Moment::MeanForce,
        Moment::ContactLossProbability,
    ];
    let mut shown: Vec<Moment> = first.into_iter().filter(asked).collect();
    let others = Moment::ALL.into_iter().filter(|it| !first.contains(it));
    shown.extend(others.filter(asked));
    let turns: Vec<f64> = it.phase.iter().map(|phase| phase / TAU).collect();
    Some(picture("periodic.svg", (958, 640), |area| {
        let title = "The law that lasts, over the phase of the drive";
        write(area, title, (92.0, 20.0), TITLE)?;
        for (k, moment) in shown.iter().take(4).enumerate() {
            let curve = it.moments.iter().filter_map(|at| at.get(*moment));
            let curve: Vec<Estimate> = curve.collect();
            let ends = |y: &Estimate| [y.value - y.error, y.value + y.error];
            let Some(y) = range(curve.iter().flat_map(ends), 0.08) else {
                continue;
            };
            let panel = Panel::new(place(k), (0.0, 1.0), y);
            panel.axes(area, "phase, periods of the drive", moment.entry().symbol)?;
            let (mut line, mut band) = with_band(&turns, curve);
            // The circle closes.
            line.extend(line.first().map(|(_, y)| (1.0, *y)));
            band.extend(band.first().map(|(_, a, b)| (1.0, *a, *b)));
            panel.band(area, &band, BLUE)?;
            panel.curve(area, &line, BLUE, 1.5)?;
            panel.frame(area)?;
        }
        Ok(())
    }))
}

/// response.svg: harmonics and loss probability over the frequency with error bands, over the amplitude of the motion
/// without noise, stable and unstable.
pub(crate) fn response(results: &Results) -> Picture {
    let it = results.response.as_ref()?;
    // One frequency is no curve.
    let x = range(it.frequency.iter().copied(), 0.0).filter(|_| it.frequency.len() > 1)?;
    // Of every curve: what both sweeps show.
    let swept = |of: fn(&Sweep) -> Option<&Vec<Estimate>>| -> Vec<&Vec<Estimate>> {
        it.sweeps.iter().flatten().filter_map(of).collect()
    };
    let (q, force) = (
        swept(|it| Some(&it.mean_q_1)),
        swept(|it| Some(&it.mean_force_1)),
    );
    let mut curves = vec![
        ("|E[q]|, first harmonic", &it.mean_q_1, q),
        ("|E[q]|, second harmonic", &it.mean_q_2, Vec::new()),
        ("|E[N]|, first harmonic", &it.mean_force_1, force),
    ];
    let lost = it.contact_loss_probability.as_ref();
    let sweeps = swept(|it| it.contact_loss_probability.as_ref());
    curves.extend(lost.map(|it| ("P(contact lost), mean", it, sweeps)));
    let drive = results.scene.excitation.drive;
    let orbits = drive.map_or(Vec::new(), |drive| {
        noise_free::orbits(&results.scene.oscillator, &drive, &it.frequency)
    });
    Some(picture("response.svg", (958, 640), |area| {
        for (k, (label, curve, sweeps)) in curves.into_iter().enumerate() {
            let ends = curve.iter().chain(sweeps.iter().copied().flatten());
            let ends = ends.map(|y| y.value + y.error).chain([0.0]);
            let free = orbits.iter().filter(|_| k == 0).map(|(_, it)| it.amplitude);
            let Some((_, high)) = range(ends.chain(free), 0.08) else {
                continue;
            };
            let panel = Panel::new(place(k), x, (0.0, high));
            panel.axes(area, "W", label)?;
            for (w, orbit) in orbits.iter().filter(|_| k == 0) {
                let stable = orbit.multiplier < 1.0;
                let colour = if stable { INK } else { GREY };
                panel.dot(area, (*w, orbit.amplitude), colour, 1.5)?;
            }
            for sweep in sweeps {
                let (line, _) = with_band(&it.frequency, sweep.iter().copied());
                panel.dashes(area, &line, BLUE, 1.2)?;
            }
            let (line, band) = with_band(&it.frequency, curve.iter().copied());
            panel.band(area, &band, BLUE)?;
            panel.curve(area, &line, BLUE, 1.5)?;
            panel.frame(area)?;
        }
        let mut entries = vec![
            (92.0, BLUE, Mark::Line, "with noise, band: its error"),
            (330.0, INK, Mark::Dot, "without noise"),
            (500.0, GREY, Mark::Dot, "without noise, unstable"),
        ];
        let swept = it.sweeps.iter();
        entries.extend(swept.map(|_| (700.0, BLUE, Mark::Dashes, "sweeps up, down")));
        for (x, colour, mark, words) in entries {
            legend(area, (x, 20.0), colour, mark, words)?;
        }
        Ok(())
    }))
}
