//! validation/README.md: one section a folder, and how to read its numbers back.

use super::equations::HEADING;
use super::folder::{Outcome, place};
use super::item::{Paper, Row, Verdict};
use super::numbers::Name;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use vibroimpact::estimate::{Estimate, Origin};

pub const NAME: &str = "README.md";

const HEAD: &str = "# The paper, reproduced

J. Perret-Liaudet and E. Rigaud, *Experiments and numerical results on non-linear vibrations of an
impacting Hertzian contact. Part 2: random excitation*, number by number. Written by `cargo run --release --bin lab --
validate`; `cargo test --release --bin lab -- --include-ignored validation::` computes the numbers again and compares them
within their errors.

Each line is a number: `label: path` names the scene of the folder, with the keys it changes, and the
place of the number in its results.json; `computed` names a number that no scene gives
(src/bin/lab/validate/evidence.rs). Ours is given as value ± error: a bound for what is computed without
sampling, 1e-7 of the value if it is smaller; one standard error (se) for what is sampled; the standard
deviation between draws (sd) for `draws`. The paper's number is given with half a unit of its last digit, or as a
bound. Our error, in the verdicts, is the bound, or two standard errors.

| verdict | meaning |
|---|---|
| within the printed digits | the difference is at most half a unit of the paper's last digit, and so is our error |
| within the printed bound | ours is below the paper's bound by more than our error |
| within our own error | neither can be told: the difference is at most half a unit and our error together (in brackets, where the paper's inputs have the larger part in it), or our error holds the paper's bound |
| within sampling error | the difference is at most half a unit and two standard errors, of our sample or of one as long as the paper's |
| explained | another number, given in brackets by its name or label, agrees with what the paper prints within half a unit, its own error and two standard errors of a record like the paper's; the line says why it stands there |
| possibly explained | the same, but a rival cause does as well |
| fitted | the same, but a parameter of that number was fitted to the paper's: it says what the number asks for, and explains nothing |
| **unexplained** | none of these; the number in brackets, if any, is the nearest that was tried |
| agrees, **disagrees** | two independent numbers of ours, the other in brackets: the difference is at most twice the root of the sum of the squares of two bounds, or four standard errors |
| would explain it, does not explain it | a candidate for the cause of a difference, tried: the paper's number lies within half a unit, our error, and two standard errors of a record like the paper's, or does not |
| ours alone | the paper gives no number |
";

/// Whether a page is one of ours, or none at all.
pub fn is_ours(page: &str) -> bool {
    page.is_empty() || page.lines().next() == HEAD.lines().next()
}

/// How many rows have each verdict.
pub fn counts(rows: &[Row]) -> BTreeMap<Verdict, usize> {
    let mut counts = BTreeMap::new();
    for row in rows {
        *counts.entry(row.verdict).or_default() += 1;
    }
    counts
}

/// The page of all outcomes; sections of `earlier` whose folder was not run again stay as they are,
/// if their folder is still `there`.
pub fn page(
    outcomes: &[Outcome],
    equations: Option<&str>,
    earlier: &str,
    there: &dyn Fn(&str) -> bool,
) -> String {
    let sections = sections(earlier).into_iter();
    let mut sections: Vec<(String, String)> = sections.filter(|(name, _)| there(name)).collect();
    for outcome in outcomes {
        let section = section(outcome);
        match sections.iter_mut().find(|(name, _)| *name == outcome.name) {
            Some(old) => old.1 = section,
            None => sections.push((outcome.name.clone(), section)),
        }
    }
    let order = |name: &str| place(Path::new(name));
    sections.sort_by_key(|(name, _)| order(name));
    let body: String = sections.iter().map(|(_, text)| text.as_str()).collect();
    let mut page = HEAD.to_owned();
    page += &summary(&body);
    page += &body;
    if let Some(equations) = equations {
        page += equations;
    }
    page
}

/// A count of the verdicts in the tables of the page, and what is not explained.
fn summary(body: &str) -> String {
    let rows = rows(body);
    let mut text = format!("\n{} numbers:", rows.len());
    let mut verdicts: Vec<(&str, usize)> = Vec::new();
    for row in &rows {
        match verdicts.iter_mut().find(|(it, _)| *it == row.verdict) {
            Some((_, count)) => *count += 1,
            None => verdicts.push((&row.verdict, 1)),
        }
    }
    let list = verdicts.iter().map(|(it, count)| format!("{count} {it}"));
    let _ = writeln!(text, " {}.", list.collect::<Vec<_>>().join(", "));
    let open = rows.iter().filter(|row| {
        [Verdict::Unexplained, Verdict::Disagrees]
            .iter()
            .any(|it| row.verdict == it.to_string())
    });
    let open: Vec<String> = open
        .map(|row| format!("- {}, `{}`", row.folder, row.name))
        .collect();
    if !open.is_empty() {
        let _ = writeln!(text, "\nNot explained:\n\n{}", open.join("\n"));
    }
    text
}

/// The sections of a page by the names of their folders.
pub fn sections(page: &str) -> Vec<(String, String)> {
    let mut found: Vec<(String, String)> = Vec::new();
    for line in page.lines() {
        if let Some(name) = line.strip_prefix("## ") {
            found.push((name.to_owned(), String::new()));
        }
        if let Some((_, text)) = found.last_mut() {
            text.push_str(line);
            text.push('\n');
        }
    }
    // A blank line before each heading belongs to the section that it opens.
    for (_, text) in &mut found {
        *text = format!("\n{}\n", text.trim_end());
    }
    found.retain(|(name, _)| name != HEADING);
    found
}

fn section(outcome: &Outcome) -> String {
    let mut text = format!("\n## {}\n", outcome.name);
    if !outcome.about.trim().is_empty() {
        let _ = write!(text, "\n{}\n", outcome.about.trim());
    }
    for file in &outcome.pictures {
        let (folder, name) = (&outcome.name, &file.name);
        let is_picture = Path::new(name).extension().is_some_and(|it| it == "svg");
        let _ = if is_picture {
            write!(text, "\n![{folder}]({folder}/{name})\n")
        } else {
            write!(text, "\nArrays: [{name}]({folder}/{name})\n")
        };
    }
    text += "\n| item | where | ours | paper | deviation | verdict |\n|---|---|---|---|---|---|\n";
    for row in &outcome.rows {
        text += &line(row);
    }
    text
}

fn line(row: &Row) -> String {
    let item = &row.item;
    let paper = match item.paper {
        Some(Paper::Number(_, half)) => format!("{} ± {half:e}", item.printed),
        Some(Paper::Below(_)) => item.printed.clone(),
        None => String::new(),
    };
    let deviation = match (item.paper, &row.other) {
        (Some(Paper::Number(paper, _)), _) => deviation(row.ours.value - paper, paper),
        (None, Some((_, other))) => deviation(row.ours.value - other.value, other.value),
        _ => String::new(),
    };
    let bold = matches!(row.verdict, Verdict::Unexplained | Verdict::Disagrees);
    let mut verdict = if bold {
        format!("**{}**", row.verdict)
    } else {
        row.verdict.to_string()
    };
    if let Some(error) = row.sampled.filter(|_| row.verdict == Verdict::Sampling) {
        let _ = write!(
            verdict,
            " (a record like the paper's has a se of {error:.1e})"
        );
    }
    if let Some(share) = item.inputs().filter(|_| row.verdict == Verdict::OurError) {
        let _ = write!(verdict, " ({:.1e})", share * row.ours.value.abs());
    }
    if let Some((name, other)) = &row.other {
        let number = named(name, *other);
        let _ = match item.paper {
            None => write!(verdict, " ({number})"),
            Some(_) if name.path == item.name.path => {
                write!(verdict, " (`{}`: {number})", name.label)
            }
            Some(_) => write!(verdict, " (`{name}`: {number})"),
        };
    }
    let differs = matches!(
        row.verdict,
        Verdict::OurError
            | Verdict::Explained
            | Verdict::Possible
            | Verdict::Fitted
            | Verdict::Unexplained
    );
    let always = matches!(
        row.verdict,
        Verdict::WouldExplain | Verdict::DoesNotExplain | Verdict::Alone
    );
    if (differs || always) && !item.because.is_empty() {
        let _ = write!(verdict, ": {}", item.because);
    }
    let (name, place, ours) = (&item.name, &item.place, named(&item.name, row.ours));
    format!("| `{name}` | {place} | {ours} | {paper} | {deviation} | {verdict} |\n")
}

/// Difference, relative to the paper's number where that makes sense.
fn deviation(difference: f64, reference: f64) -> String {
    let share = (difference / reference).abs();
    if reference == 0.0 || share > 2.0 || (share - 1.0).abs() < 1e-6 {
        format!("{difference:+.1e}")
    } else {
        format!("{:+.1} %", 100.0 * difference / reference)
    }
}

/// value ± error.
pub fn short(it: Estimate) -> String {
    // Below this an error is rounding, which differs between machines.
    let error = it.error.max(1e-7 * it.value.abs()).max(1e-12);
    if it.value.abs() < error && it.origin != Origin::Sampling {
        return format!("0 ± {error:.0e}");
    }
    let se = match it.origin {
        Origin::Sampling => " se",
        _ => "",
    };
    format!("{}{se}", Estimate::new(it.value, error, it.origin))
}

/// The same for the number of that name: between draws there is no standard error but a deviation.
fn named(name: &Name, it: Estimate) -> String {
    let text = short(it);
    if name.path.starts_with("draws.") {
        text.replace(" se", " sd")
    } else {
        text
    }
}

/// A row of a table as it stands on the page.
#[derive(Debug, Clone, PartialEq)]
pub struct Printed {
    pub folder: String,
    pub name: String,
    pub ours: Estimate,
    /// The first words of its verdict.
    pub verdict: String,
}

/// The rows of all tables of a page.
pub fn rows(page: &str) -> Vec<Printed> {
    let mut found = Vec::new();
    for (folder, text) in sections(page) {
        for line in text.lines() {
            let fields: Vec<&str> = line.trim_matches('|').split(" | ").map(str::trim).collect();
            let [name, _, ours, _, _, verdict] = fields[..] else {
                continue;
            };
            let Some(name) = name.strip_prefix('`').and_then(|it| it.strip_suffix('`')) else {
                continue;
            };
            if let Some(ours) = read(ours) {
                let end = verdict.find([':', '(']).unwrap_or(verdict.len());
                found.push(Printed {
                    folder: folder.clone(),
                    name: name.to_owned(),
                    ours,
                    verdict: verdict[..end].trim().trim_matches('*').to_owned(),
                });
            }
        }
    }
    found
}

/// The same, read back.
pub fn read(text: &str) -> Option<Estimate> {
    let (text, origin) = match text.strip_suffix(" se").or(text.strip_suffix(" sd")) {
        Some(text) => (text, Origin::Sampling),
        None => (text, Origin::Space),
    };
    let (value, error) = text.split_once(" ± ")?;
    let (value, error) = (value.parse().ok()?, error.parse().ok()?);
    Some(Estimate::new(value, error, origin))
}
