//! report.html: table, pictures, settings and warnings in one file that needs nothing else.

use super::file::{File, RESULTS};
use super::tables;
use crate::results::Results;
use std::fmt::Write;

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:1000px;margin:2em auto;\
padding:0 1em;color:#191919;background:#fff}\
pre{font:13px/1.45 ui-monospace,'DejaVu Sans Mono',monospace;overflow-x:auto;background:#f7f7f5;\
padding:1em;border-radius:6px}\
table{border-collapse:collapse;font-variant-numeric:tabular-nums;margin:0 0 1.5em}\
td,th{padding:.15em 1.2em .15em 0;text-align:left;vertical-align:top}\
th{border-bottom:1px solid #999;font-weight:600}tr:hover td{background:#f7f7f5}\
.summary{font-size:18px}summary{cursor:pointer;color:#555}\
svg{max-width:100%;height:auto}figure{margin:1.5em 0}\
figcaption{color:#555;font-size:14px}.warning{border-left:4px solid #d55e00;padding-left:1em}";

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

/// A page that needs nothing else, with its title above its body.
pub(crate) fn html(title: &str, body: &str) -> String {
    let title = escaped(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{title} - vibroimpact</title>\n<style>{STYLE}</style>\n</head>\n<body>\n\
         <h1>{title}</h1>\n{body}</body>\n</html>\n"
    )
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
        let _ = writeln!(
            page,
            "<figure>{svg}<figcaption>{words} ({name})</figcaption></figure>"
        );
    }
    page
}

/// Text that HTML takes as text.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
