//! Under a drive: the periodic law and the response.

use super::layout::{Table, eigenvalue, row};
use crate::fokker_planck::Multiplier;
use crate::format::{brief, rounded};
use crate::results::Results;

/// The law that lasts under a drive: its harmonics, multipliers and loss of contact.
pub(super) fn periodic(table: &mut Table, results: &Results) {
    let (Some(it), Some(drive)) = (&results.periodic, results.scene.excitation.drive) else {
        return;
    };
    let heads = ["amplitude", "phase [rad]"];
    let any = it.harmonics().iter().any(|(_, all)| !all.is_empty());
    table.columns("THE LAW THAT LASTS", if any { &heads } else { &[] });
    for (moment, all) in it.harmonics() {
        let symbol = moment.entry().symbol;
        for (k, harmonic) in (1..).zip(all).take(2) {
            let name = format!("{symbol:<8} harmonic {k}");
            let phase = Some(harmonic.phase).filter(|it| it.value.is_finite());
            table.line(row(&name, &[Some(harmonic.amplitude), phase], false));
        }
    }
    if let Some(lost) = it.contact_loss_probability {
        table.line(row("P(loss)  over a period", &[Some(lost)], false));
    }
    for (k, multiplier) in it.multipliers.iter().enumerate() {
        let name = if k == 0 { "Floquet multipliers" } else { "" };
        let value = eigenvalue(multiplier.re, multiplier.im, multiplier.error);
        table.line(format!("{name:<26} {value}"));
    }
    if let Some(laws) = &it.metastable {
        table.columns(
            "METASTABLE LAWS",
            &["probability", "E[q]", "|E[q]| 1", "P(loss)"],
        );
        for law in laws {
            table.line(row("about one of two orbits", &law.main_numbers(), false));
        }
    }
    let left = it.multipliers.first().map(Multiplier::modulus);
    let left = left.filter(|it| *it > 0.0 && *it < 1.0);
    let tenth = left.map(|it| drive.period() * 0.1f64.ln() / it.ln());
    let relaxation = tenth.map_or(String::new(), |time| {
        let clock = results.scene.clock();
        let time = brief(rounded(clock.time(time), 3));
        format!(
            "; a deviation falls to a tenth in a time of {time}{}",
            clock.suffix()
        )
    });
    let text = format!(
        "{} phases of the drive {} cos({} t + {}); from one period to the next the law changes by {:.0e} in L1{relaxation}",
        it.phase.len(),
        brief(drive.amplitude()),
        brief(drive.frequency()),
        brief(drive.phase()),
        it.residual
    );
    table.paragraph("", &text);
}

/// The response curve where it is highest, and at its ends.
pub(super) fn response(table: &mut Table, results: &Results) {
    let Some(it) = &results.response else {
        return;
    };
    let heads = ["|E[q]| 1", "|E[N]| 1", "P(loss)", "multiplier"];
    table.columns("RESPONSE, frequency", &heads);
    let count = it.frequency.len();
    let highest = (0..count).max_by(|a, b| {
        let value = |k: usize| it.mean_q_1[k].value;
        value(*a).total_cmp(&value(*b))
    });
    let mut shown = vec![0, count.saturating_sub(1)];
    shown.extend(highest);
    shown.sort_unstable();
    shown.dedup();
    for k in shown {
        let top = if Some(k) == highest { "  highest" } else { "" };
        let lost = it.contact_loss_probability.as_ref().map(|it| it[k]);
        let [q, force, slowest] = [&it.mean_q_1, &it.mean_force_1, &it.multiplier].map(|it| it[k]);
        let numbers = [Some(q), Some(force), lost, Some(slowest)];
        let name = format!("{}{top}", brief(it.frequency[k]));
        table.line(row(&name, &numbers, false));
    }
    let differ = "; two laws are metastable at some: sweeps up and down differ";
    let sweeps = it.sweeps.as_ref().map_or("", |_| differ);
    let text = format!("{count} frequencies{sweeps}; the whole curve is in response.csv");
    table.paragraph("", &text);
}
