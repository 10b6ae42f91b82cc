//! report.html: table, pictures, settings and warnings in one file that needs nothing else.

use super::file::{File, RESULTS};
use super::html::{escaped, html};
use super::tables;
use crate::results::Results;
use std::fmt::Write;

/// The page with these pictures, each with its words.
pub(super) fn page(results: &Results, pictures: &[(File, &str)]) -> String {
    let mut page = content(results, pictures);
    let scene = escaped(&results.scene.to_toml());
    let _ = writeln!(
        page,
        "<h2>The scene, every default filled in</h2>\n<pre>{scene}</pre>\n\
         <p>Save it as scene.toml and run it again with <code>vibroimpact run scene.toml</code>. \
         Every number, with its error, stands in {RESULTS}.</p>"
    );
    html(&results.scene.title, &page)
}

/// Warnings, table and pictures.
pub(super) fn content(results: &Results, pictures: &[(File, &str)]) -> String {
    let mut page = String::new();
    for warning in &results.run.warnings {
        let _ = writeln!(page, "<p class=\"warning\">{}</p>", escaped(&warning.text));
    }
    page += &tables::summary(results);
    page += &tables::symbols(results);
    page += &tables::tables(results);
    for (file, words) in pictures {
        let svg = String::from_utf8_lossy(&file.bytes);
        let name = escaped(&file.name);
        let caption = format!("<figcaption>{words} ({name})</figcaption>");
        let _ = writeln!(page, "<figure>{svg}{caption}</figure>");
    }
    page
}
