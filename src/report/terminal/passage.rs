//! First losses of contact and first passages.

use super::layout::{Table, row};
use crate::estimate::Estimate;
use crate::fokker_planck::FirstLoss;
use crate::format::{brief, rounded};
use crate::initial::Initial;
use crate::monte_carlo::FirstLossResult;
use crate::results::Results;

pub(super) fn first_loss(table: &mut Table, results: &Results) {
    let words = [
        "FIRST LOSS OF CONTACT",
        "time to the loss",
        "given contact",
        "lost",
    ];
    let (solved, sampled) = (&results.first_loss, &results.first_loss_paths);
    survival(table, results, words, (solved.as_ref(), sampled.as_ref()));
}

pub(super) fn first_passage(table: &mut Table, results: &Results) {
    let Some(asked) = results.scene.outputs.first_passage else {
        return;
    };
    let [quantity, way] = asked.side.words();
    let (way, level) = (way.to_uppercase(), brief(asked.level));
    let title = format!("FIRST {quantity} {way} {level}");
    let words = [
        &title,
        "time to the passage",
        "short of the level",
        "passed",
    ];
    let (solved, sampled) = (&results.first_passage, &results.first_passage_paths);
    survival(table, results, words, (solved.as_ref(), sampled.as_ref()));
}

/// `[title, mean, given, gone]`: the heading, what is meant by the mean time, of what a stationary start is taken, and what those
/// are that do not survive.
fn survival(
    table: &mut Table,
    results: &Results,
    [title, mean, given, gone]: [&str; 4],
    (solved, sampled): (Option<&FirstLoss>, Option<&FirstLossResult>),
) {
    let times = solved.map(|it| &it.times);
    let Some(times) = times.or(sampled.map(|it| &it.times)) else {
        return;
    };
    let by = match solved {
        Some(it) if it.is_bound() => "bound",
        _ => "backward eq.",
    };
    let heads = [by, "paths"];
    table.compared_columns(title, &heads[..=usize::from(sampled.is_some())]);
    let mut put = |symbol: &str, words: &str, a: Option<Estimate>, b: Option<Estimate>| {
        let words = format!("{symbol:<8} {words}");
        let both = [a, b];
        table.line(row(&words, &both[..=usize::from(sampled.is_some())], true));
    };
    let last = times.len() - 1;
    let mut shown = vec![last / 8, last / 4, last / 2, last];
    shown.dedup();
    for k in shown.into_iter().filter(|k| *k > 0) {
        let seen = sampled.and_then(|it| it.survival.get(k).copied());
        let words = format!("survives {}", brief(times[k]));
        put("S", &words, solved.map(|it| it.survival[k]), seen);
    }
    for k in [last / 2, last] {
        let seen = sampled.and_then(|it| it.survival.get(k).copied());
        let words = format!("{gone} by {}", brief(times[k]));
        let lost = solved.map(|it| it.lost[k]);
        put("1 - S", &words, lost, seen.map(Estimate::complement));
    }
    let lost = sampled.and_then(FirstLossResult::mean_time_of_all);
    let Some(it) = solved else {
        if lost.is_some() {
            put("mean", mean, None, lost);
        }
        return;
    };
    let lasts = it.rate.value.is_finite();
    if it.mean_time.value.is_finite() {
        put("mean", mean, Some(it.mean_time), lost);
    }
    if lasts {
        put("rate", "S ~ exp(-rate t)", Some(it.rate), None);
    }
    if it.rate_over_rice.value.is_finite() {
        put("", "over Rice's rate", Some(it.rate_over_rice), None);
    }
    let [nq, nv] = it.method.cells;
    let solved = if it.is_bound() {
        format!("{}: {}", it.method.name, it.method.reason)
    } else {
        format!(
            "{nq} x {nv} nodes, step {}; {}",
            brief(rounded(it.method.step, 3)),
            if lasts {
                "in the end the survival falls as exp(-rate t)"
            } else if results.scene.excitation.is_plain() {
                "losses too rare for the rounding of a step: no mean time, no rate"
            } else {
                "under [excitation] there is no rate in the end"
            }
        )
    };
    let from = match results.scene.initial {
        Initial::Rest => "rest".to_owned(),
        Initial::Stationary => format!("the stationary law {given}"),
        Initial::Gaussian { .. } => "a Gaussian initial condition".to_owned(),
    };
    table.paragraph("", &format!("{solved}; from {from}"));
}
