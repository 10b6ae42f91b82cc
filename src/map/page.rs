//! report.html of a map, and the list of its missing points.

use super::axis::plain;
use super::collected::Collected;
use super::lines::Ending;
use super::table::{Column, quoted, shown};
use crate::report::{self, File};
use std::fmt::Write;

/// Rows of a list on the page.
const LISTED: usize = 50;

/// The page of a map: its axes, its picture, what its numbers span, what is missing or failed.
pub(super) fn page(it: &Collected, picture: Option<&File>) -> File {
    let mut body = String::new();
    let notes = [
        (it.missing(), "missing", None),
        (it.failed, "failed", Some(Ending::Failed)),
        (
            it.lacking,
            "have a stage without an answer",
            Some(Ending::Lacking),
        ),
        (it.short, "missed the tolerance", Some(Ending::Short)),
    ];
    for (count, what, ending) in notes.iter().filter(|it| it.0 > 0) {
        let points = it.ended(*ending).take(LISTED).map(|k| it.called(k));
        let points: Vec<String> = points.collect();
        let more = if *count > LISTED { "\n..." } else { "" };
        let _ = writeln!(
            body,
            "<details class=\"warning\"><summary>{count} of {} points {what}</summary><pre>{}{more}</pre></details>",
            it.points,
            report::escaped(&points.join("\n"))
        );
    }
    let mut axes = String::new();
    for axis in &it.axes {
        let values = axis.values();
        let (first, last) = (plain(&values[0]), plain(&values[values.len() - 1]));
        let (key, count, spacing) = (axis.key(), values.len(), axis.spacing().name());
        let _ = writeln!(
            axes,
            "{key:<28} {count:>6} values, {spacing}, {first} ... {last}"
        );
    }
    let pre = |text: &str| format!("<pre>{}</pre>", report::escaped(text));
    let _ = writeln!(body, "<h2>Axes</h2>\n{}", pre(&axes));
    if let Some(picture) = picture {
        let svg = String::from_utf8_lossy(&picture.bytes);
        let name = &picture.name;
        let caption = format!("<figcaption>{name}</figcaption>");
        let _ = writeln!(body, "<figure>{svg}{caption}</figure>");
    }
    let _ = writeln!(
        body,
        "<h2>Numbers</h2>\n<p>Lowest and highest value over the map, and the largest error. All of them: map.csv; as \
         arrays over the axes: map.npz.</p>\n{}",
        pre(&spans(it))
    );
    let scene = serde_json::to_string_pretty(&it.scene).unwrap_or_default();
    let title = "The scene of the first point, every default filled in";
    let _ = writeln!(body, "<h2>{title}</h2>\n{}", pre(&scene));
    File::text("report.html", report::html(&it.title, &body))
}

/// What each number spans.
fn spans(it: &Collected) -> String {
    let columns = it.table.groups().filter(|it| it.len() <= 20).flatten();
    let mut text = format!(
        "{:<50} {:>12} {:>12} {:>10}\n",
        "", "lowest", "highest", "error"
    );
    let row = |column: &Column| -> Option<String> {
        let there = || column.values.iter().copied().filter(|x| x.is_finite());
        let (low, high) = (there().reduce(f64::min)?, there().reduce(f64::max)?);
        let errors = column.errors.iter().copied().filter(|x| x.is_finite());
        let error = errors.reduce(f64::max);
        let error = error.map_or(String::new(), |it| format!("{it:.0e}"));
        let name = shown(&column.name, column.place) + &it.table.units.bracketed(&column.name);
        Some(format!(
            "{name:<50} {low:>12.5e} {high:>12.5e} {error:>10}\n"
        ))
    };
    columns.filter_map(row).for_each(|row| text += &row);
    text
}

/// missing.csv: a row a point without a line.
pub(super) fn missing(it: &Collected) -> File {
    let mut text = String::from("index");
    for axis in &it.axes {
        let _ = write!(text, ",{}", quoted(axis.key()));
    }
    text.push('\n');
    for index in it.ended(None) {
        let _ = write!(text, "{index}");
        for (axis, k) in it.axes.iter().zip(super::part::place(&it.axes, index)) {
            let _ = write!(text, ",{}", quoted(&axis.shown(k)));
        }
        text.push('\n');
    }
    File::text("missing.csv", text)
}
