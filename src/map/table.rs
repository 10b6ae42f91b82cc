//! The numbers of a map as columns over its points.

use super::axis::Axis;
use super::lines::Ending;
use super::numbers::is_curve;
use super::units::Units;
use crate::error::Result;
use crate::report::{File, field, npz};
use serde_json::Value;
use std::collections::HashMap;
use std::fmt::Write;

/// One number of every point; of a list, the number at one place of it.
#[derive(Debug, Clone)]
pub(super) struct Column {
    /// Its name in results.json, sections before it, without its place.
    pub(super) name: String,
    /// Its place in a list.
    pub(super) place: Option<usize>,
    /// NaN where a point has none.
    pub(super) values: Vec<f64>,
    /// NaN where it is a plain number.
    pub(super) errors: Vec<f64>,
    /// The first point that has it, and where there.
    rank: (usize, usize),
}

impl Column {
    fn has_errors(&self) -> bool {
        self.errors.iter().any(|it| !it.is_nan())
    }
}

/// All numbers of a map.
#[derive(Debug)]
pub(super) struct Table {
    points: usize,
    pub(super) units: Units,
    columns: Vec<Column>,
    at: HashMap<String, usize>,
    /// How each point ended; None for a missing one.
    pub(super) endings: Vec<Option<Ending>>,
    names: HashMap<usize, String>,
    messages: HashMap<usize, String>,
}

impl Table {
    pub(super) fn new(points: usize, units: Units) -> Self {
        Self {
            points,
            units,
            columns: Vec::new(),
            at: HashMap::new(),
            endings: vec![None; points],
            names: HashMap::new(),
            messages: HashMap::new(),
        }
    }

    /// Takes in a line.
    pub(super) fn put(&mut self, index: usize, line: &Value, ending: Ending) {
        self.endings[index] = Some(ending);
        let name = line["name"].as_str().unwrap_or_default();
        self.names.insert(index, name.to_owned());
        if let Some(message) = line["error"]["message"].as_str() {
            self.messages.insert(index, message.to_owned());
        }
        let mut order = 0;
        walk(line, &mut |name, place, value, error| {
            order += 1;
            self.number((index, order), (name, place), (value, error));
        });
    }

    fn number(
        &mut self,
        rank: (usize, usize),
        (name, place): (&str, Option<usize>),
        (value, error): (f64, f64),
    ) {
        let key = shown(name, place);
        let points = self.points;
        let at = *self.at.entry(key).or_insert_with(|| {
            self.columns.push(Column {
                name: name.to_owned(),
                place,
                values: vec![f64::NAN; points],
                errors: vec![f64::NAN; points],
                rank,
            });
            self.columns.len() - 1
        });
        let column = &mut self.columns[at];
        column.rank = column.rank.min(rank);
        column.values[rank.0] = value;
        column.errors[rank.0] = error;
    }

    /// Puts the columns into an order that does not depend on that of the lines; lists stay together. Numbers that
    /// repeat an axis go.
    pub(super) fn in_order(&mut self, axes: &[Axis]) {
        let mut first: HashMap<String, (usize, usize)> = HashMap::new();
        for it in &self.columns {
            let rank = first.entry(it.name.clone()).or_insert(it.rank);
            *rank = (*rank).min(it.rank);
        }
        self.columns
            .retain(|it| axes.iter().all(|axis| axis.key() != it.name));
        self.columns
            .sort_by_key(|it| (first.get(&it.name).copied(), it.place));
        self.at.clear();
    }

    /// The columns of each number: one, or one a place of its list.
    pub(super) fn groups(&self) -> impl Iterator<Item = &[Column]> {
        self.columns.chunk_by(|a, b| a.name == b.name)
    }

    /// The columns of the number of that name.
    pub(super) fn group(&self, name: &str) -> Option<&[Column]> {
        self.groups().find(|it| it[0].name == name)
    }

    /// The times of a list of moments, if they are the same at every point.
    pub(super) fn times(&self, name: &str) -> Option<Vec<f64>> {
        let (section, _) = name.rsplit_once('.')?;
        if !section.ends_with("transient") {
            return None;
        }
        let times = self.group(&format!("{section}.t"))?;
        let constant = |it: &Column| {
            let mut there = it.values.iter().copied().filter(|t| !t.is_nan());
            let first = there.next()?;
            there.all(|t| t == first).then_some(first)
        };
        times.iter().map(constant).collect()
    }

    /// map.csv: a row a point.
    pub(super) fn csv(&self, axes: &[Axis], places: impl Fn(usize) -> Vec<usize>) -> File {
        let mut text = String::from("index,name");
        for axis in axes {
            let _ = write!(text, ",{}", quoted(axis.key()));
        }
        let columns = self.columns.iter();
        let columns: Vec<&Column> = columns.filter(|it| !is_curve(&it.name)).collect();
        let with_errors: Vec<bool> = columns.iter().map(|it| it.has_errors()).collect();
        for (column, errors) in columns.iter().zip(&with_errors) {
            let (name, unit) = (self.title(column), self.units.bracketed(&column.name));
            let _ = write!(text, ",{name}{unit}");
            if *errors {
                let _ = write!(text, ",{name} error{unit}");
            }
        }
        text += ",status\n";
        for (index, ending) in self.endings.iter().enumerate() {
            let Some(ending) = ending else { continue };
            let name = self.names.get(&index).map_or("", String::as_str);
            let _ = write!(text, "{index},{name}");
            for (axis, k) in axes.iter().zip(places(index)) {
                let _ = write!(text, ",{}", quoted(&axis.shown(k)));
            }
            for (column, errors) in columns.iter().zip(&with_errors) {
                text.push(',');
                text += &field(column.values[index]);
                if *errors {
                    text.push(',');
                    text += &field(column.errors[index]);
                }
            }
            let status = match ending {
                Ending::Well => "done",
                Ending::Short => "tolerance missed",
                Ending::Lacking => "a stage has no answer",
                Ending::Failed => self.messages.get(&index).map_or("failed", String::as_str),
            };
            let _ = writeln!(text, ",{}", quoted(status));
        }
        File::text("map.csv", text)
    }

    /// The heading of a column: its time, or its place in a list.
    fn title(&self, column: &Column) -> String {
        let time = column
            .place
            .and_then(|k| self.times(&column.name)?.get(k).copied());
        match time {
            Some(t) if !is_time(&column.name) => format!("{} at t = {t}", column.name),
            _ => shown(&column.name, column.place),
        }
    }

    /// map.npz: one array a number over the axes, and one with its errors; lists along one more axis.
    pub(super) fn npz(&self, axes: &[Axis]) -> Result<File> {
        let shape: Vec<usize> = axes.iter().map(|it| it.values().len()).collect();
        let interleaved = |group: &[Column], of: fn(&Column) -> &Vec<f64>| -> Vec<f64> {
            let points = 0..self.points;
            points
                .flat_map(|k| group.iter().map(move |it| of(it)[k]))
                .collect()
        };
        let own = axes.iter().zip(&shape).map(|(axis, length)| {
            // Words have no numbers: their places stand for them, in the order of map.json.
            let places = (0..*length).map(|k| k as f64);
            let numbers = axis.numbers().unwrap_or_else(|| places.collect());
            npz::vector(axis.key(), numbers)
        });
        let numbers = self.groups().flat_map(|group| {
            let shape = match group[0].place {
                Some(_) => [&shape[..], &[group.len()]].concat(),
                None => shape.clone(),
            };
            let name = &group[0].name;
            let errors = group.iter().any(Column::has_errors);
            let errors = errors.then(|| {
                let errors = interleaved(group, |it| &it.errors);
                (format!("{name}_error"), shape.clone(), errors)
            });
            let values = interleaved(group, |it| &it.values);
            std::iter::once((name.clone(), shape, values)).chain(errors)
        });
        npz::archive("map.npz", own.chain(numbers))
    }
}

/// Whether a name is that of the times of other numbers.
pub(super) fn is_time(name: &str) -> bool {
    name.rsplit('.').next() == Some("t")
}

/// Takes a name, a place in a list, a value and an error.
type Visit<'a> = &'a mut dyn FnMut(&str, Option<usize>, f64, f64);

/// Shows every number of a line with its name, its place in a list, its value and its error, NaN without one.
pub(super) fn walk(line: &Value, visit: Visit<'_>) {
    section(&line["results"], &mut String::new(), None, visit);
}

fn section(it: &Value, path: &mut String, place: Option<usize>, visit: Visit<'_>) {
    let error = |it: &Value| it.as_f64().unwrap_or(f64::NAN);
    match it {
        Value::Number(x) => visit(path, place, x.as_f64().unwrap_or(f64::NAN), f64::NAN),
        Value::Array(items) if place.is_none() => {
            for (k, item) in items.iter().enumerate() {
                section(item, path, Some(k), visit);
            }
        }
        Value::Object(pairs) => match (pairs.get("value"), pairs.get("error")) {
            (Some(Value::Array(values)), Some(Value::Array(errors))) => {
                for (k, (x, e)) in values.iter().zip(errors).enumerate() {
                    if let Some(x) = x.as_f64() {
                        visit(path, Some(k), x, error(e));
                    }
                }
            }
            (Some(x), Some(e)) => visit(path, place, error(x), error(e)),
            // An eigenvalue: both parts have one error.
            (None, Some(Value::Number(e))) => {
                for (key, x) in pairs.iter().filter(|(key, _)| *key != "error") {
                    if let Some(x) = x.as_f64() {
                        let error = error(&Value::Number(e.clone()));
                        visit(&format!("{path}.{key}"), place, x, error);
                    }
                }
            }
            _ => {
                let length = path.len();
                for (key, value) in pairs {
                    if length > 0 {
                        path.push('.');
                    }
                    *path += key;
                    section(value, path, place, visit);
                    path.truncate(length);
                }
            }
        },
        // What a place of a list does not have, its neighbours may.
        Value::Null if place.is_some() => visit(path, place, f64::NAN, f64::NAN),
        _ => {}
    }
}

/// A name with its place in a list.
pub(super) fn shown(name: &str, place: Option<usize>) -> String {
    place.map_or_else(|| name.to_owned(), |k| format!("{name}[{k}]"))
}

/// A field of CSV.
pub(super) fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn numbers_are_found_wherever_they_stand() {
        let results = json!({
            "stationary": { "mean_q": { "value": 1.0, "error": 0.1 }, "none": null },
            "transient": { "t": [5, 10], "mean_q": { "value": [1.0, null], "error": [0.1, null] } },
            "decay_rates": [{ "re": -1.0, "im": 2.0, "error": 0.5 }],
            "spectrum": { "quantity": "force", "peaks": [{ "omega": { "value": 3.0, "error": 0.2 } }] },
            "oscillator": { "h": 0.1 },
        });
        let mut table = Table::new(2, Units::of(&json!({}), &[]));
        let line = json!({ "name": "a", "results": results });
        table.put(1, &line, Ending::Well);
        let axis = Axis::parse("oscillator.h=[0.2, 0.1]").unwrap();
        table.in_order(&[axis]);
        let found: Vec<String> = table.columns.iter().map(|it| table.title(it)).collect();
        assert_eq!(
            found,
            [
                "stationary.mean_q",
                "transient.t[0]",
                "transient.t[1]",
                "transient.mean_q at t = 5",
                "decay_rates.re[0]",
                "decay_rates.im[0]",
                "spectrum.peaks.omega[0]"
            ]
        );
        let rate = table.group("decay_rates.im").unwrap();
        assert_eq!((rate[0].values[1], rate[0].errors[1]), (2.0, 0.5));
        assert!(rate[0].values[0].is_nan());
        assert_eq!(quoted("a \"b\", c"), "\"a \"\"b\"\", c\"");
    }
}
