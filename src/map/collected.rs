//! What the parts of a map came to: its numbers, and which points are missing or failed.

use super::axis::Axis;
use super::lines::Ending;
use super::part::{Part, place};
use super::table::Table;
use crate::format::many;
use serde_json::Value;
use std::fmt;

/// What the parts of a map came to.
#[derive(Debug)]
pub struct Collected {
    /// The title of the scene.
    pub title: String,
    /// Points of the map.
    pub points: usize,
    /// Points with a message in place of results.
    pub failed: usize,
    /// Points with a stage that has no answer.
    pub lacking: usize,
    /// Points with a number that did not reach the tolerance though the program was free to refine it.
    pub short: usize,
    /// Parts that were found.
    pub parts: Vec<Part>,
    pub(super) missing: Vec<(usize, Option<Part>)>,
    pub(super) axes: Vec<Axis>,
    pub(super) table: Table,
    pub(super) scene: Value,
    /// Whether there is a picture.
    pub(super) drawn: bool,
    /// Lines that are cut off or broken.
    pub(super) dropped: usize,
}

impl Collected {
    /// Points without a line.
    pub fn missing(&self) -> usize {
        self.missing.len()
    }

    /// A point as people name it: its number and its values.
    pub(super) fn called(&self, index: usize) -> String {
        let places = place(&self.axes, index);
        let values = self.axes.iter().zip(places);
        let values = values.map(|(axis, k)| format!("{} = {}", axis.key(), axis.shown(k)));
        let values: Vec<String> = values.collect();
        format!("point {index}: {}", values.join(", "))
    }

    /// Points that ended so, in their order.
    pub(super) fn ended(&self, ending: Option<Ending>) -> impl Iterator<Item = usize> + '_ {
        let all = self.table.endings.iter().enumerate();
        all.filter_map(move |(index, it)| (*it == ending).then_some(index))
    }
}

impl fmt::Display for Collected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        /// Missing points that are listed; missing.csv has all.
        const LISTED: usize = 20;
        let axes = self.axes.iter().map(|it| it.values().len().to_string());
        let axes = axes.collect::<Vec<_>>().join(" x ");
        let there = self.points - self.missing();
        let points = many(self.points as u64, "point");
        let parts = many(self.parts.len() as u64, "part");
        writeln!(f, "{points} ({axes}): {there} there, in {parts}")?;
        if self.dropped > 0 {
            let dropped = many(self.dropped as u64, "cut-off or broken line");
            writeln!(f, "{dropped} passed over")?;
        }
        if !self.drawn {
            let axes = self.axes.iter().filter(|it| it.values().len() > 1).count();
            let why = match axes {
                1..=3 => "no point has a number to draw yet",
                _ => "a picture has one to three axes of several points",
            };
            writeln!(f, "no map.svg: {why}")?;
        }
        if self.short > 0 {
            let short = many(self.short as u64, "point");
            writeln!(f, "{short} missed the tolerance: status in map.csv")?;
        }
        if self.lacking > 0 {
            let lacking = many(self.lacking as u64, "point");
            writeln!(
                f,
                "{lacking} with a stage that has no answer: status in map.csv; `vibroimpact map --retry` tries again"
            )?;
        }
        if self.failed > 0 {
            let failed = many(self.failed as u64, "point");
            writeln!(f, "{failed} failed: message in map.csv")?;
            for index in self.ended(Some(Ending::Failed)).take(3) {
                writeln!(f, "  {}", self.called(index))?;
            }
        }
        if self.missing.is_empty() {
            return Ok(());
        }
        let mut parts: Vec<Part> = self.missing.iter().filter_map(|it| it.1).collect();
        parts.sort_unstable();
        parts.dedup();
        writeln!(f, "{} missing:", many(self.missing() as u64, "point"))?;
        for (index, _) in self.missing.iter().take(LISTED) {
            writeln!(f, "  {}", self.called(*index))?;
        }
        if self.missing() > LISTED {
            writeln!(f, "  and {} more, in missing.csv", self.missing() - LISTED)?;
        }
        if !parts.is_empty() {
            let shown: Vec<String> = parts.iter().take(LISTED).map(Part::to_string).collect();
            let more = if parts.len() > LISTED { ", ..." } else { "" };
            writeln!(f, "run again with --part {}{more}", shown.join(", "))?;
        }
        Ok(())
    }
}
