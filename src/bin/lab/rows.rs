//! Tables of data as text: comments, a header, then a row a line; what does not read is named with its line.

use std::str::FromStr;
use vibroimpact::error::{Error, Result};

/// A line of a table.
pub struct Row<'a> {
    place: String,
    text: &'a str,
    /// What stands between the separators.
    pub fields: Vec<&'a str>,
}

/// The rows below the header of a table; `name` stands for it in messages.
pub fn rows<'a>(name: &str, text: &'a str, separator: char) -> impl Iterator<Item = Row<'a>> {
    let lines = (1..).zip(text.lines());
    let lines = lines.filter(|(_, line)| !line.starts_with('#')).skip(1);
    lines.map(move |(number, text)| Row {
        place: format!("{name} line {number}"),
        text,
        fields: text.split(separator).map(str::trim).collect(),
    })
}

impl Row<'_> {
    pub fn wrong(&self, accepted: impl Into<String>) -> Error {
        Error::invalid(&self.place, format!("{:?}", self.text), accepted)
    }

    pub fn get<T: FromStr>(&self, field: usize) -> Result<T> {
        let text = self.fields.get(field);
        text.and_then(|it| it.parse().ok())
            .ok_or_else(|| self.wrong(format!("a number in field {}", field + 1)))
    }
}
