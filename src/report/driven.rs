//! Files of what a drive does: the law that lasts under it, and that law over the frequency.

use super::File;
use super::csv::Csv;
use super::data::with_moments;
use super::npz::{density, stacked};
use crate::error::Result;
use crate::estimate::Estimate;
use crate::fokker_planck::{Periodic, Response};
use crate::results::{Results, dimension};

/// Moments over the phase, harmonics, multipliers, the density at phase 0, and at several phases.
pub(super) fn periodic(results: &Results, it: &Periodic) -> Result<Vec<File>> {
    let phase = Csv::of(results).plain("W t of the drive", "rad", it.phase.iter().copied());
    let moments = with_moments(phase, &it.moments, "error");
    let most = it.harmonics().map(|(_, all)| all.len());
    let most = most.into_iter().max().unwrap_or(0);
    let numbers = (1..=most).map(|k| k as f64);
    let mut harmonics = Csv::of(results).plain("number", "1", numbers);
    for (moment, all) in it.harmonics() {
        let name = moment.name();
        let (head, unit) = (format!("amplitude of {name}"), dimension(name));
        let amplitudes = all.iter().map(|it| Some(it.amplitude));
        harmonics.add(&head, "error", unit, amplitudes);
        let head = format!("phase of {name} against cos(W t)");
        harmonics.add(&head, "error", "rad", all.iter().map(|it| Some(it.phase)));
    }
    let multipliers = Csv::of(results)
        .plain("re", "1", it.multipliers.iter().map(|it| it.re))
        .plain("im", "1", it.multipliers.iter().map(|it| it.im))
        .plain("error", "1", it.multipliers.iter().map(|it| it.error));
    let mut files = vec![
        moments.file("periodic.csv"),
        multipliers.file("multipliers.csv"),
    ];
    if most > 0 {
        files.push(harmonics.file("harmonics.csv"));
    }
    let rig = results.scene.rig();
    let rig = rig.as_ref();
    if let Some(snapshot) = it.densities.first() {
        files.push(density("periodic.npz", snapshot, rig)?);
    }
    if it.densities.len() > 1 {
        files.push(stacked("stroboscopic.npz", &it.densities, rig)?);
    }
    Ok(files)
}

/// Files of the response curve.
pub(super) fn response(results: &Results, it: &Response) -> Vec<File> {
    let frequencies = it.frequency.iter().copied();
    let mut table = Csv::of(results)
        .plain("frequency of the drive", "W", frequencies)
        .circular();
    let mut add = |name: &str, unit, curve: &[Estimate]| {
        table.add(name, "error", unit, curve.iter().copied().map(Some));
    };
    add("first harmonic of E[q]", "u", &it.mean_q_1);
    add("second harmonic of E[q]", "u", &it.mean_q_2);
    add("first harmonic of E[N]", "F", &it.mean_force_1);
    if let Some(lost) = &it.contact_loss_probability {
        add("P(loss) averaged over the phase", "1", lost);
    }
    add("modulus of the slowest multiplier", "1", &it.multiplier);
    for (direction, sweep) in ["up", "down"].into_iter().zip(it.sweeps.iter().flatten()) {
        let mut add =
            |name: &str, unit, curve| add(&format!("{name}, sweep {direction}"), unit, curve);
        add("first harmonic of E[q]", "u", &sweep.mean_q_1);
        add("first harmonic of E[N]", "F", &sweep.mean_force_1);
        if let Some(lost) = &sweep.contact_loss_probability {
            add("P(loss) averaged over the phase", "1", lost);
        }
    }
    if let Some(rig) = results.scene.rig() {
        let hertz = it.frequency.iter().map(|w| rig.hertz(*w)).collect();
        table = table.bare("frequency", "Hz", hertz);
    }
    vec![table.file("response.csv")]
}
