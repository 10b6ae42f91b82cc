//! Tables of what a drive does: the law that lasts under it, and the response over its frequency.

use super::table::{Table, shown};
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
    for law in it.metastable.iter().flatten() {
        let words = "probability of the motion about one of two orbits";
        others.numbers(words.into(), [Some(law.probability)]);
    }
    for (k, it) in (1..).zip(&it.multipliers) {
        let part = |value: f64| shown(Some(Estimate::new(value, it.error, Origin::Space)));
        let imaginary = match it.im {
            0.0 => String::new(),
            im => format!(" and {} i", part(im)),
        };
        let value = format!("{}{imaginary}", part(it.re));
        others.put([format!("Floquet multiplier {k}"), value]);
    }
    let harmonics = table.html("The law that lasts under the drive: harmonics of the period");
    Some(harmonics + &others.html("The law that lasts under the drive"))
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
