//! A table of the page.

use crate::estimate::{Estimate, Origin};
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

    /// A row of words and numbers.
    pub(super) fn numbers<const N: usize>(&mut self, words: String, all: [Option<Estimate>; N]) {
        let numbers = all.into_iter().map(shown);
        self.rows.push([words].into_iter().chain(numbers).collect());
    }

    /// With its title; nothing without rows. Columns without a single entry are left out.
    pub(super) fn html(&self, title: &str) -> String {
        if self.rows.is_empty() {
            return String::new();
        }
        let entry = |row: &Vec<String>, k: usize| !matches!(row[k].as_str(), "" | "-");
        let filled = |k: &usize| self.rows.iter().any(|row| entry(row, *k));
        let kept: Vec<usize> = (0..self.heads.len()).filter(filled).collect();
        let row = |tag: &str, cells: &[String]| {
            let cell = |k: &usize| format!("<{tag}>{}</{tag}>", escaped(&cells[*k]));
            format!("<tr>{}</tr>\n", kept.iter().map(cell).collect::<String>())
        };
        let body: String = self.rows.iter().map(|it| row("td", it)).collect();
        let head = row("th", &self.heads);
        let title = escaped(title);
        format!("<h2>{title}</h2>\n<table>\n{head}{body}</table>\n")
    }
}

pub(super) fn shown(it: Option<Estimate>) -> String {
    it.map_or(String::new(), |it| cell(Some(it)))
}

/// Real part and imaginary part of an eigenvalue, or of a conjugate pair, with the error of either.
pub(super) fn complex(re: f64, im: f64, error: f64) -> [String; 2] {
    let part = |x: f64| shown(Some(Estimate::new(x, error, Origin::Space)));
    let pair = (im != 0.0).then(|| format!("\u{b1}({})", part(im)));
    [part(re), pair.unwrap_or_default()]
}
