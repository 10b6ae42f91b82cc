//! The rows as a table for the terminal, as CSV and as Markdown.

use super::extreme::Extreme;
use super::verdict::Row;
use std::fmt::Write;
use vibroimpact::report::File;

/// Error, error over its estimate, lowest density, mass, steps and seconds as they are shown; a dash for none.
fn cells(row: &Row) -> [String; 6] {
    let short = |it: Option<f64>| it.map_or("-".into(), |it| format!("{it:.1e}"));
    [
        short(row.error),
        short(row.worst.as_ref().map(|it| it.0)),
        short(row.lowest_density),
        short(row.mass_error),
        row.steps.map_or("-".into(), |it| it.to_string()),
        format!("{:.1}", row.seconds),
    ]
}

/// The number whose error is the largest over its estimate.
fn worst(row: &Row) -> &str {
    row.worst.as_ref().map_or("", |it| &it.1)
}

/// The table: a line a scene, its message below it where there is one.
pub fn text(rows: &[Row]) -> String {
    let mut all = format!(
        "{:<24} {:<8} {:>8} {:>8} {:>9} {:>8} {:>9} {:>6}  {}\n",
        "scene", "verdict", "error", "/ est.", "lowest p", "mass", "steps", "s", "worst number"
    );
    for row in rows {
        let [error, ratio, lowest, mass, steps, seconds] = cells(row);
        let _ = writeln!(
            all,
            "{:<24} {:<8} {error:>8} {ratio:>8} {lowest:>9} {mass:>8} {steps:>9} {seconds:>6}  {}",
            row.name,
            row.verdict,
            worst(row)
        );
        if !row.message.is_empty() {
            let _ = writeln!(all, "    {}", row.message.replace('\n', " "));
        }
    }
    let dishonest = rows.iter().filter(|row| !row.verdict.honest());
    let dishonest: Vec<&str> = dishonest.map(|row| row.name.as_str()).collect();
    let _ = writeln!(
        all,
        "{} scenes, {} failed (a number outside its error estimate, no answer where one is expected, a crash, a hang){}{}",
        rows.len(),
        dishonest.len(),
        if dishonest.is_empty() { "" } else { ": " },
        dishonest.join(", ")
    );
    all
}

/// stability.csv, stability.md and the scenes themselves.
pub fn files(scenes: &[Extreme], rows: &[Row]) -> Vec<File> {
    let mut files = vec![
        File::text("stability.csv", csv(rows)),
        File::text("stability.md", markdown(rows)),
    ];
    files.extend(
        scenes
            .iter()
            .map(|it| File::text(format!("{}.toml", it.name), it.toml.clone())),
    );
    files
}

fn csv(rows: &[Row]) -> String {
    let mut all = String::from(
        "scene,extreme in,against,verdict,largest error over its normalisation,largest error over its estimate,\
         of,lowest density,mass error,steps,wall time (s),message\n",
    );
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\"").replace('\n', " "));
    for row in rows {
        let number = |it: Option<f64>| it.map_or(String::new(), |it| format!("{it:e}"));
        let fields = [
            row.name.clone(),
            quoted(&row.what),
            quoted(&row.against),
            row.verdict.name().to_string(),
            number(row.error),
            number(row.worst.as_ref().map(|it| it.0)),
            quoted(worst(row)),
            number(row.lowest_density),
            number(row.mass_error),
            row.steps.map_or(String::new(), |it| it.to_string()),
            format!("{:.2}", row.seconds),
            quoted(&row.message),
        ];
        all += &fields.join(",");
        all.push('\n');
    }
    all
}

fn markdown(rows: &[Row]) -> String {
    let mut all = String::from(
        "| scene | extreme in | against | verdict | error | over its estimate | lowest p | mass | steps | s | what it said |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let [error, mut ratio, lowest, mass, steps, seconds] = cells(row);
        if row.worst.is_some() {
            ratio = format!("{ratio} ({})", worst(row));
        }
        let message = row.message.replace('|', "/").replace('\n', " ");
        let _ = writeln!(
            all,
            "| {} | {} | {} | {} | {error} | {ratio} | {lowest} | {mass} | {steps} | {seconds} | {message} |",
            row.name, row.what, row.against, row.verdict,
        );
    }
    all
}
