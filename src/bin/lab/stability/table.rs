//! The rows as a table for the terminal, as CSV and as Markdown.

use super::extreme::Extreme;
use super::verdict::Row;
use std::fmt::Write;
use vibroimpact::report::File;

/// A number in two digits, or a dash.
fn short(it: Option<f64>) -> String {
    it.map_or("-".into(), |it| format!("{it:.1e}"))
}

fn steps(it: Option<u64>) -> String {
    it.map_or("-".into(), |it| it.to_string())
}

/// One line of the terminal's table.
fn line(row: &Row) -> String {
    let (ratio, of) = row
        .worst
        .as_ref()
        .map_or(("-".into(), ""), |(ratio, of)| (format!("{ratio:.1e}"), of));
    format!(
        "{:<24} {:<8} {:>8} {:>8} {:>9} {:>8} {:>9} {:>6.1}  {of}",
        row.name,
        row.verdict,
        short(row.error),
        ratio,
        short(row.lowest_density),
        short(row.mass_error),
        steps(row.steps),
        row.seconds,
    )
}

/// The table: a line a scene, its message below it where there is one.
pub fn text(rows: &[Row]) -> String {
    let mut all = format!(
        "{:<24} {:<8} {:>8} {:>8} {:>9} {:>8} {:>9} {:>6}  {}\n",
        "scene", "verdict", "error", "/ est.", "lowest p", "mass", "steps", "s", "worst number"
    );
    for row in rows {
        all += &line(row);
        all.push('\n');
        if !row.message.is_empty() {
            let _ = writeln!(all, "    {}", row.message.replace('\n', " "));
        }
    }
    let dishonest: Vec<&str> = rows
        .iter()
        .filter(|row| !row.verdict.honest())
        .map(|row| row.name.as_str())
        .collect();
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
        "scene,extreme in,against,verdict,largest error (natural scales),largest error over its estimate,\
         of,lowest density,mass error,steps,wall time (s),message\n",
    );
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\"").replace('\n', " "));
    for row in rows {
        let number = |it: Option<f64>| it.map_or(String::new(), |it| format!("{it:e}"));
        let (ratio, of) = row
            .worst
            .as_ref()
            .map_or((String::new(), ""), |(ratio, of)| {
                (format!("{ratio:e}"), of)
            });
        let fields = [
            row.name.clone(),
            quoted(&row.what),
            quoted(&row.against),
            row.verdict.name().to_string(),
            number(row.error),
            ratio,
            quoted(of),
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
        let ratio = row
            .worst
            .as_ref()
            .map_or("-".into(), |(ratio, of)| format!("{ratio:.1e} ({of})"));
        let message = row.message.replace('|', "/").replace('\n', " ");
        let _ = writeln!(
            all,
            "| {} | {} | {} | {} | {} | {ratio} | {} | {} | {} | {:.1} | {message} |",
            row.name,
            row.what,
            row.against,
            row.verdict,
            short(row.error),
            short(row.lowest_density),
            short(row.mass_error),
            steps(row.steps),
            row.seconds,
        );
    }
    all
}
