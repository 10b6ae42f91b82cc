//! From each equation of the paper to the item that implements it and the test that checks it.

use crate::rows::{Row, rows};
use std::fmt::Write;
use std::fs;
use std::path::Path;
use vibroimpact::error::Result;

/// The heading of the table on the page.
pub const HEADING: &str = "Equations";
/// The list, beside the folders: `equation;what;item;test`.
pub const NAME: &str = "equations.csv";

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Equation {
    /// Number or numbers in the paper.
    pub number: String,
    pub what: String,
    /// The item that implements it, or why none does.
    pub item: String,
    /// The tests that check it, as `file: name`, separated by commas.
    pub test: String,
}

/// The list beside the folders of `root`; None where there is none.
pub fn read(root: &Path) -> Result<Option<Vec<Equation>>> {
    let Ok(text) = fs::read_to_string(root.join(NAME)) else {
        return Ok(None);
    };
    let equation = |row: Row<'_>| {
        let [number, what, item, test] = row.fields[..] else {
            return Err(row.wrong("equation;what;item;test"));
        };
        Ok(Equation {
            number: number.to_owned(),
            what: what.to_owned(),
            item: item.to_owned(),
            test: test.to_owned(),
        })
    };
    let list: Result<_> = rows(NAME, &text, ';').map(equation).collect();
    list.map(Some)
}

pub fn table(equations: &[Equation]) -> String {
    let mut text =
        format!("\n## {HEADING}\n\n| equation | what | item | tests |\n|---|---|---|---|\n");
    for it in equations {
        let code = |text: &str| match text {
            "" => String::new(),
            text => text
                .split(", ")
                .map(|part| format!("`{part}`"))
                .collect::<Vec<_>>()
                .join(", "),
        };
        let (item, test) = (code(&it.item), code(&it.test));
        let _ = writeln!(text, "| {} | {} | {item} | {test} |", it.number, it.what);
    }
    text
}
