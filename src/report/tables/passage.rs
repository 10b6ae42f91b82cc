//! Tables of first losses of contact and of first passages.

use super::table::Table;
use crate::estimate::Estimate;
use crate::fokker_planck::FirstLoss;
use crate::format::brief;
use crate::monte_carlo::FirstLossResult;
use crate::results::Results;

pub(super) fn first_loss(results: &Results) -> Option<String> {
    let (solved, paths) = (&results.first_loss, &results.first_loss_paths);
    let words = ["a loss", "contact loss"];
    let table = survival(results, words, (solved.as_ref(), paths.as_ref()))?;
    Some(table.html("First passage to contact loss"))
}

pub(super) fn first_passage(results: &Results) -> Option<String> {
    let asked = results.scene.outputs.first_passage?;
    let [quantity, way] = asked.side.words();
    let (solved, paths) = (&results.first_passage, &results.first_passage_paths);
    let words = ["a passage", "the passage"];
    let table = survival(results, words, (solved.as_ref(), paths.as_ref()))?;
    let level = brief(asked.level);
    Some(table.html(&format!("First passage of {quantity} {way} {level}")))
}

/// `[event, target]`: what is survived, and what the mean time leads to.
fn survival(
    results: &Results,
    [event, target]: [&str; 2],
    (solved, paths): (Option<&FirstLoss>, Option<&FirstLossResult>),
) -> Option<Table> {
    let times = solved.map(|it| &it.times);
    let times = times.or(paths.map(|it| &it.times))?;
    let by = match solved {
        Some(it) if it.is_bound() => "bound",
        _ => "backward equation",
    };
    let mut table = Table::of(["", by, "Monte Carlo"]);
    let unit = results.scene.clock().suffix();
    let last = times.len() - 1;
    for k in [last / 8, last / 4, last / 2, last] {
        let t = format!("{}{unit}", brief(times[k]));
        let survival = paths.and_then(|it| it.survival.get(k).copied());
        let event_free = event.replacen("a ", "no ", 1);
        let words = format!("probability of {event_free} until {t}");
        table.numbers(words, [solved.map(|it| it.survival[k]), survival]);
        let words = format!("probability of {event} until {t}");
        let lost = solved.map(|it| it.lost[k]);
        table.numbers(words, [lost, survival.map(Estimate::complement)]);
    }
    let lasting = solved.map(|it| {
        [
            (format!("mean time to {target}"), it.mean_time),
            ("asymptotic hazard rate".into(), it.rate),
            ("the same over Rice's rate".into(), it.rate_over_rice),
        ]
    });
    for (words, number) in lasting.into_iter().flatten() {
        if !number.value.is_nan() {
            table.numbers(words, [Some(number), None]);
        }
    }
    Some(table)
}
