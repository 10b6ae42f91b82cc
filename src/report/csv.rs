//! Tables as CSV: a column a quantity, its unit in the header, beside it its error, and with a rig the same in SI units.

use super::File;
use crate::clock::{Clock, TimeUnit};
use crate::contact::ContactLaw;
use crate::estimate::Estimate;
use crate::format::num;
use crate::results::Results;
use crate::rig::Rig;
use std::fmt::Write;

/// A number as it reads back exactly; empty where it does not exist.
pub(crate) fn field(x: f64) -> String {
    if x.is_finite() { num(x) } else { String::new() }
}

/// Value and error, or two empty fields.
pub(super) fn fields(it: Option<Estimate>) -> String {
    let it = it.filter(|it| it.value.is_finite());
    it.map_or(",".into(), |it| {
        format!("{},{}", field(it.value), field(it.error))
    })
}

/// A unit of the manual as people write it: z_s the static compression, q_s the same in units of q, F_s the static load,
/// Omega the circular frequency of small vibrations, m the mass. Under the Hertz law q_s is 3/2.
pub(crate) fn spelled(unit: &str, hertz: bool) -> String {
    let [above, below] = if hertz {
        ["2 z_s", "3"]
    } else {
        ["z_s", "q_s"]
    };
    let (length, speed) = (format!("{above}/{below}"), format!("{above} Omega/{below}"));
    let other = match unit {
        "u" => return length,
        "1/u" => return format!("1/({length})"),
        "u^2" => return format!("({length})^2"),
        "u W" => return speed,
        "1/(u W)" => return format!("1/({speed})"),
        "(u W)^2" => return format!("({speed})^2"),
        "u^2 W" => return format!("({length})^2 Omega"),
        "1/(u^2 W)" => return format!("1/[({length})^2 Omega]"),
        "(u W)^2 m" => return format!("m ({speed})^2"),
        "u^2/W" => return format!("({length})^2/Omega"),
        "F" => "F_s",
        "1/F" => "1/F_s",
        "F^2/W" => "F_s^2/Omega",
        "W" => "Omega",
        "1/W" => "1/Omega",
        "W/(2 pi)" => "1/period",
        "2 pi/W" => "periods",
        other => other,
    };
    other.to_owned()
}

/// A unit of the manual on a rig, that of a time as the clock has it: its SI unit, and how many of these it is. None for
/// what has no dimension.
fn si(unit: &str, rig: &Rig, clock: &Clock) -> Option<(&'static str, f64)> {
    let (length, speed) = (rig.micrometres(), rig.millimetres_per_second());
    let (force, second) = (rig.newtons(1.0), clock.seconds(rig));
    Some(match unit {
        "u" => ("um", length),
        "1/u" => ("1/um", 1.0 / length),
        "u^2" => ("um^2", length * length),
        "u W" => ("mm/s", speed),
        "1/(u W)" => ("1/(mm/s)", 1.0 / speed),
        "(u W)^2" => ("(mm/s)^2", speed * speed),
        "u^2 W" => ("um mm/s", length * speed),
        "1/(u^2 W)" => ("1/(um mm/s)", 1.0 / (length * speed)),
        "(u W)^2 m" => ("J", rig.mass() * rig.velocity(1.0).powi(2)),
        "F" => ("N", force),
        "1/F" => ("1/N", 1.0 / force),
        "W" => ("1/s", 1.0 / second),
        "1/W" => ("s", second),
        _ => return None,
    })
}

/// The units that a scene's tables are in.
struct Units {
    clock: Clock,
    hertz: bool,
    rig: Option<Rig>,
}

impl Units {
    fn of(results: &Results) -> Self {
        Self {
            clock: results.scene.clock(),
            hertz: *results.contact() == ContactLaw::Hertz,
            rig: results.scene.rig(),
        }
    }

    /// A unit of the manual as people write it.
    fn spelled(&self, unit: &'static str) -> String {
        spelled(self.clock.unit().of(unit), self.hertz)
    }

    /// The SI unit of one of the manual, and how many of these it is; None for what has no dimension, and without a rig.
    fn si(&self, unit: &str) -> Option<(&'static str, f64)> {
        si(unit, self.rig.as_ref()?, &self.clock)
    }
}

/// Columns of a table.
pub(super) struct Csv {
    units: Units,
    columns: Vec<Column>,
}

struct Column {
    head: String,
    /// In the units of the manual, whatever the unit of times.
    unit: &'static str,
    values: Vec<f64>,
    /// Whether the numbers of a rig are to stand beside it.
    physical: bool,
}

impl Column {
    /// The same in a unit, of which each of its own is so many.
    fn scaled(&self, (unit, scale): (&'static str, f64)) -> Self {
        Self {
            head: self.head.clone(),
            unit,
            values: self.values.iter().map(|x| x * scale).collect(),
            physical: false,
        }
    }
}

impl Csv {
    /// A table of the scene of `results`.
    pub(super) fn of(results: &Results) -> Self {
        Self {
            units: Units::of(results),
            columns: Vec::new(),
        }
    }

    fn put(&mut self, head: String, unit: &'static str, values: Vec<f64>, physical: bool) {
        self.columns.push(Column {
            head,
            unit,
            values,
            physical,
        });
    }

    /// Numbers without errors.
    pub(super) fn plain(
        mut self,
        head: &str,
        unit: &'static str,
        values: impl IntoIterator<Item = f64>,
    ) -> Self {
        let values = values.into_iter().collect();
        self.put(head.to_owned(), unit, values, true);
        self
    }

    /// The same, of which a rig has another column already.
    pub(super) fn bare(mut self, head: &str, unit: &'static str, values: Vec<f64>) -> Self {
        self.put(head.to_owned(), unit, values, false);
        self
    }

    /// The last column is a circular frequency: in units of Omega whatever the unit of times.
    pub(super) fn circular(mut self) -> Self {
        if let Some(last) = self.columns.last_mut() {
            last.unit = "Omega";
        }
        self
    }

    /// As [`Self::add`], of a curve where every number is there.
    pub(super) fn curve(
        mut self,
        head: &str,
        kind: &str,
        unit: &'static str,
        curve: &[Estimate],
    ) -> Self {
        self.add(head, kind, unit, curve.iter().copied().map(Some));
        self
    }

    /// Numbers, and their errors in the next column; `kind` is "error" or "standard error".
    pub(super) fn add(
        &mut self,
        head: &str,
        kind: &str,
        unit: &'static str,
        numbers: impl IntoIterator<Item = Option<Estimate>>,
    ) {
        let numbers = numbers.into_iter().map(|it| match it {
            Some(it) if it.value.is_finite() => (it.value, it.error),
            _ => (f64::NAN, f64::NAN),
        });
        let (values, errors) = numbers.unzip();
        self.put(head.to_owned(), unit, values, true);
        self.put(format!("{kind} of {head}"), unit, errors, true);
    }

    /// The table: as it was put together, then with a rig every column that has a dimension once more in SI units.
    pub(super) fn file(mut self, name: &str) -> File {
        let units = &self.units;
        let seconds = units.clock.unit() == TimeUnit::Second;
        let in_seconds = |unit: &str| seconds && matches!(unit, "W" | "1/W");
        let there = self.columns.iter().filter(|it| it.physical);
        let physical = there
            .filter(|it| !in_seconds(it.unit))
            .filter_map(|it| units.si(it.unit).map(|si| it.scaled(si)));
        let physical: Vec<Column> = physical.collect();
        self.columns.extend(physical);
        let head = |it: &Column| format!("{} [{}]", it.head, units.spelled(it.unit));
        let heads: Vec<String> = self.columns.iter().map(head).collect();
        let mut text = heads.join(",") + "\n";
        let rows = self.columns.iter().map(|it| it.values.len()).max();
        for k in 0..rows.unwrap_or(0) {
            let value = |it: &Column| it.values.get(k).copied().map_or(String::new(), field);
            let values: Vec<String> = self.columns.iter().map(value).collect();
            text += &(values.join(",") + "\n");
        }
        File::text(name, text)
    }
}

/// Rows of a table of single numbers: name, value and error, its unit, and on a rig the same in SI units.
pub(super) struct Rows {
    units: Units,
    text: String,
}

impl Rows {
    /// A table of the scene of `results`, its numbers under these heads, as "value,error".
    pub(super) fn of(results: &Results, heads: &[&str]) -> Self {
        let units = Units::of(results);
        let mut text = format!("name,{},unit", heads.join(","));
        if units.rig.is_some() {
            for head in heads.iter().flat_map(|it| it.split(',')) {
                let _ = write!(text, ",{head} in SI units");
            }
            text += ",SI unit";
        }
        text.push('\n');
        Self { units, text }
    }

    /// A row.
    pub(super) fn put(&mut self, name: &str, unit: &'static str, numbers: &[Option<Estimate>]) {
        let all = |scale: f64| -> String {
            let scaled = |it: &Option<Estimate>| fields(it.map(|it| it.scaled(scale)));
            numbers.iter().map(scaled).collect::<Vec<_>>().join(",")
        };
        let shown = self.units.spelled(unit);
        let _ = write!(self.text, "{name},{},{shown}", all(1.0));
        if self.units.rig.is_some() {
            let (unit, scale) = self.units.si(unit).unwrap_or(("1", 1.0));
            let _ = write!(self.text, ",{},{unit}", all(scale));
        }
        self.text.push('\n');
    }

    /// The table.
    pub(super) fn file(self, name: &str) -> File {
        File::text(name, self.text)
    }
}
