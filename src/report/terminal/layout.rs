//! Lines of 80 columns: rows of numbers, headings, paragraphs.

use crate::estimate::{Estimate, Origin};
use crate::format::cell;
use crate::moments::Entry;
use crate::results::distance;
use std::fmt::Write;

pub(super) const WIDTH: usize = 80;

/// Times printed of each; all are in the files.
pub(super) const TIMES: usize = 6;

/// A blank at which no line is broken.
pub(super) const TOGETHER: char = '\u{a0}';

/// Text broken at blanks into lines of at most `width` columns.
pub(crate) fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split([' ', '\n']).filter(|word| !word.is_empty()) {
        let last = lines.len() - 1;
        let room = lines[last].chars().count() + 1 + word.chars().count() <= width;
        if lines[last].is_empty() {
            lines[last].push_str(word);
        } else if room {
            lines[last].push(' ');
            lines[last].push_str(word);
        } else {
            lines.push(word.to_owned());
        }
    }
    let apart = lines.iter().map(|line| line.replace(TOGETHER, " "));
    apart.collect()
}

pub(super) struct Table {
    pub(super) text: String,
    pub(super) colour: bool,
}

impl Table {
    pub(super) fn line(&mut self, line: impl AsRef<str>) {
        self.text.push_str(line.as_ref().trim_end());
        self.text.push('\n');
    }

    pub(super) fn heading(&mut self, line: impl AsRef<str>) {
        self.line("");
        self.bold(line.as_ref());
    }

    pub(super) fn bold(&mut self, line: &str) {
        if self.colour {
            self.line(format!("\u{1b}[1m{line}\u{1b}[0m"));
        } else {
            self.line(line);
        }
    }

    /// A heading with words over columns of numbers; below it where it leaves them no room.
    pub(super) fn columns(&mut self, title: &str, heads: &[&str]) {
        self.headed(title, &over_numbers(heads.iter().copied()));
    }

    /// The same over numbers that are compared, if there are two of them.
    pub(super) fn compared_columns(&mut self, title: &str, heads: &[&str]) {
        let mut over = over_numbers(heads.iter().copied());
        if heads.len() == 2 {
            let _ = write!(over, "{:>7}", "z");
        }
        self.headed(title, &over);
    }

    fn headed(&mut self, title: &str, heads: &str) {
        let room = heads.len() - heads.trim_start().len();
        let over = title.chars().count().saturating_sub(26);
        if heads.is_empty() {
            self.heading(title);
        } else if over < room {
            self.heading(format!("{title:<26}{}", &heads[over..]));
        } else {
            self.heading(title);
            self.line(format!("{:<26}{heads}", ""));
        }
    }

    pub(super) fn paragraph(&mut self, first: &str, text: &str) {
        let indent = first.chars().count();
        for (k, line) in wrap(text, WIDTH - indent).into_iter().enumerate() {
            let lead = if k == 0 { first } else { "" };
            self.line(format!("{lead:<indent$}{line}"));
        }
    }
}

/// Words over columns of numbers.
pub(super) fn over_numbers<'a>(heads: impl Iterator<Item = &'a str>) -> String {
    let padded: Vec<String> = heads.map(|it| format!("{it:>18}")).collect();
    padded.concat()
}

/// A real eigenvalue, or a conjugate pair, with the error of each part.
pub(super) fn eigenvalue(re: f64, im: f64, error: f64) -> String {
    let part = |x: f64| cell(Some(Estimate::new(x, error, Origin::Space)));
    if im == 0.0 {
        part(re)
    } else {
        format!("{}, a pair: \u{b1}({})i", part(re), part(im))
    }
}

/// A row: 26 columns of words, then its numbers.
pub(super) fn row(words: &str, numbers: &[Option<Estimate>], compared: bool) -> String {
    format!("{words:<26} {}", cells(numbers, compared))
}

/// Numbers in 17 columns each, and in 7 how far the first two are apart where both are known.
pub(super) fn cells(numbers: &[Option<Estimate>], compared: bool) -> String {
    let padded = numbers.iter().map(|it| format!("{:>17}", cell(*it)));
    let mut line = padded.collect::<Vec<_>>().join(" ");
    if let [Some(a), Some(b)] = numbers
        && let Some(z) = distance(*a, *b).filter(|_| compared)
    {
        let _ = write!(line, "{z:>7.1}");
    }
    line
}

/// Symbol and words of a number.
pub(super) fn words(it: &Entry) -> String {
    format!("{:<8} {}", it.symbol, it.words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_text_is_broken_at_blanks() {
        let lines = wrap(&"word ".repeat(40), 30);
        assert!(lines.iter().all(|line| line.chars().count() <= 30) && lines.len() == 7);
    }
}
