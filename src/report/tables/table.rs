//! A table of the page.

use crate::estimate::Estimate;
use crate::format::cell;
use crate::report::html::escaped;

/// A table: heads, and rows of as many cells.
pub(super) struct Table {
    heads: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    pub(super) fn of<const N: usize>(heads: [&str; N]) -> Self {
        Self {
            heads: heads.map(str::to_owned).to_vec(),
            rows: Vec::new(),
        }
    }

    pub(super) fn put<const N: usize>(&mut self, cells: [String; N]) {
        self.rows.push(cells.into());
    }

    /// With its title; nothing without rows. Columns without a single entry are left out.
    pub(super) fn html(&self, title: &str) -> String {
        if self.rows.is_empty() {
            return String::new();
        }
        let filled = |k: usize| {
            self.rows
                .iter()
                .any(|row| !matches!(row[k].as_str(), "" | "-"))
        };
        let kept: Vec<usize> = (0..self.heads.len()).filter(|k| filled(*k)).collect();
        let row = |tag: &str, cells: &[String]| {
            let cells = kept
                .iter()
                .map(|k| format!("<{tag}>{}</{tag}>", escaped(&cells[*k])));
            format!("<tr>{}</tr>\n", cells.collect::<String>())
        };
        let body: String = self.rows.iter().map(|it| row("td", it)).collect();
        let head = row("th", &self.heads);
        format!(
            "<h2>{}</h2>\n<table>\n{head}{body}</table>\n",
            escaped(title)
        )
    }
}

pub(super) fn shown(it: Option<Estimate>) -> String {
    it.map_or(String::new(), |it| cell(Some(it)))
}
