//! Tables of what a drive does: the law that lasts under it, and the response over its frequency.

use super::table::{Table, complex, shown};
use crate::estimate::{Estimate, Origin};
use crate::format::{brief, spread};
use crate::results::Results;

/// Frequencies of a response shown on the page; all are in the files.
const FREQUENCIES: usize = 25;

/// Harmonics, loss of contact and Floquet multipliers of the law that lasts under a drive.
pub(super) fn periodic(results: &Results) -> Option<String> {
    let it = results.periodic.as_ref()?;
    let mut table = Table::of(["", "amplitude", "phase, rad"]);
    for (moment, all) in it.harmonics() {
        let symbol = moment.entry().symbol;
        for (k, harmonic) in (1..).zip(all).take(2) {
            let phase = Some(harmonic.phase).filter(|it| it.value.is_finite());
            let words = format!("{symbol}, harmonic {k}");
            table.numbers(words, [Some(harmonic.amplitude), phase]);
        }
    }
    let mut others = Table::of(["", "value"]);
    if let Some(lost) = it.contact_loss_probability {
        others.numbers("P(loss) over a period".into(), [Some(lost)]);
    }
    let mut laws = Table::of(["", "probability", "E[q]", "|E[q]|, harmonic 1", "P(loss)"]);
    for law in it.metastable.iter().flatten() {
        laws.numbers("about one of two orbits".into(), law.main_numbers());
    }
    let mut multipliers = Table::of(["", "real part", "imaginary part", "modulus"]);
    for (k, it) in (1..).zip(&it.multipliers) {
        let [re, im] = complex(it.re, it.im, it.error);
        let modulus = Estimate::new(it.modulus(), it.error, Origin::Space);
        multipliers.put([k.to_string(), re, im, shown(Some(modulus))]);
    }
    let harmonics = table.html("The law that lasts under the drive: harmonics of the period");
    let others = others.html("The law that lasts under the drive");
    let laws = laws.html("Metastable laws that it is made of");
    Some(harmonics + &others + &laws + &multipliers.html("Floquet multipliers"))
}

/// The response curve at some of its frequencies.
pub(super) fn response(results: &Results) -> Option<String> {
    let it = results.response.as_ref()?;
    let mut table = Table::of([
        "\u{3c9} of the drive",
        "|E[q]|, harmonic 1",
        "|E[q]|, harmonic 2",
        "|E[N]|, harmonic 1",
        "P(loss)",
        "modulus of the slowest multiplier",
    ]);
    for k in spread(it.frequency.len(), FREQUENCIES) {
        let lost = it.contact_loss_probability.as_ref().map(|it| it[k]);
        let [q, twice, force] =
            [&it.mean_q_1, &it.mean_q_2, &it.mean_force_1].map(|it| Some(it[k]));
        let numbers = [q, twice, force, lost, Some(it.multiplier[k])];
        table.numbers(brief(it.frequency[k]), numbers);
    }
    Some(table.html("Response to the drive"))
}
