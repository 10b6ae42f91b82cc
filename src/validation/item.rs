//! One number of the paper and what ours has to say to it.

use super::numbers::{COMPUTED, Name};
use crate::error::{Error, Result};
use crate::estimate::{Estimate, Origin};
use std::fmt;

/// A line of `paper.csv`: `name,value,tolerance,where,reason,because`.
///
/// `value` and `tolerance` (half a unit of the last printed digit) are empty for a number that the paper
/// does not give. `reason` lists, separated by semicolons, what a difference may come from:
///
/// | reason | the difference is accepted if |
/// |---|---|
/// | `sampled L` | it is within two standard errors of a record of the dimensionless length L |
/// | `by NAME`, `by NAME * F` | F times that number agrees with the paper, within the sample too if `sampled` stands before it |
/// | `agrees NAME` | (no paper value) the two numbers of ours agree within their errors |
/// | `test` | never: the line asks whether this number would explain the paper's |
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// The number of ours.
    pub name: Name,
    /// The paper's number and half a unit of its last digit.
    pub paper: Option<(f64, f64)>,
    /// The paper's number as it is written in the file.
    pub printed: String,
    /// Where it stands in the paper, or what it is.
    pub place: String,
    /// What a difference may come from.
    pub reasons: Vec<Reason>,
    /// The same in words.
    pub because: String,
}

/// What a difference may come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// The paper's number comes from a record of this dimensionless length.
    Sampled(f64),
    /// The paper's number is this one, times a factor.
    By(Name, f64),
    /// Not a number of the paper: two of ours that should be the same.
    Agrees(Name),
    /// A candidate explanation.
    Test,
}

/// What is to be said of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The difference is below half a unit of the paper's last digit, and our own error.
    Digits,
    /// It is within two standard errors of the sample.
    Sampling,
    /// Another number shows where it comes from.
    Explained,
    /// It is not explained.
    Unexplained,
    /// Two numbers of ours agree.
    Agrees,
    /// Two numbers of ours disagree.
    Disagrees,
    /// A candidate explanation that would explain the paper's number.
    WouldExplain,
    /// A candidate explanation that would not.
    DoesNotExplain,
    /// Nothing to compare with.
    Alone,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Digits => "within the printed digits",
            Self::Sampling => "within sampling error",
            Self::Explained => "explained",
            Self::Unexplained => "unexplained",
            Self::Agrees => "agrees",
            Self::Disagrees => "disagrees",
            Self::WouldExplain => "would explain it",
            Self::DoesNotExplain => "does not explain it",
            Self::Alone => "ours alone",
        })
    }
}

/// An item with its answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The item.
    pub item: Item,
    /// Our number.
    pub ours: Estimate,
    /// What it was compared with, if not with the paper.
    pub other: Option<Estimate>,
    /// One standard error of the paper's own sample, where one is known.
    pub sampled: Option<f64>,
    /// What is to be said.
    pub verdict: Verdict,
}

/// Standard errors within which two numbers agree: 95 % of all pairs.
const WITHIN: f64 = 2.0;
/// The same where many pairs of ours are looked at: 1 in 16 000 pairs differs by more.
const FAR: f64 = 4.0;

/// How far from the truth `it` may be at 95 %: its bound, or two standard errors.
fn reach(it: Estimate) -> f64 {
    match it.origin {
        Origin::Sampling => WITHIN * it.error,
        _ => it.error,
    }
}

impl Item {
    /// An item from its line; `at` names the line in messages.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a line that is not one.
    pub fn parse(line: &str, at: &str) -> Result<Self> {
        let wrong = |what: &str, accepted: &str| Error::invalid(at, what, accepted);
        let mut fields = line.splitn(6, ',').map(str::trim);
        let mut next = || fields.next().unwrap_or("");
        let [name, value, tolerance, place, reason, because] = std::array::from_fn(|_| next());
        let name = Name::parse(name)
            .ok_or_else(|| wrong(name, "LABEL: path.of.a.number as the first field"))?;
        let number = |text: &str| -> Result<f64> {
            let parsed = text.parse().ok().filter(|x: &f64| x.is_finite());
            parsed.ok_or_else(|| wrong(text, "a finite number, or nothing"))
        };
        let paper = match (value, tolerance) {
            ("", "") => None,
            _ => Some((number(value)?, number(tolerance)?)),
        };
        let mut reasons = Vec::new();
        for text in reason
            .split(';')
            .map(str::trim)
            .filter(|text| !text.is_empty())
        {
            let parsed = Reason::parse(text);
            let accepted = "sampled LENGTH, by NAME, by NAME * FACTOR, agrees NAME, or test";
            reasons.push(parsed.ok_or_else(|| wrong(text, accepted))?);
        }
        Ok(Self {
            name,
            paper,
            printed: value.to_owned(),
            place: place.to_owned(),
            reasons,
            because: because.to_owned(),
        })
    }

    /// Every number the item needs.
    pub fn names(&self) -> impl Iterator<Item = &Name> {
        let others = self.reasons.iter().filter_map(|reason| match reason {
            Reason::By(name, _) | Reason::Agrees(name) => Some(name),
            _ => None,
        });
        std::iter::once(&self.name).chain(others)
    }

    /// The item with its answer: `number` gives any number by name, `per_length` the standard error of
    /// `name` in a record of that length.
    ///
    /// # Errors
    /// Those of `number` and `per_length`.
    pub fn answer(
        &self,
        number: &dyn Fn(&Name) -> Result<Estimate>,
        per_length: &dyn Fn(&Name, f64) -> Result<f64>,
    ) -> Result<Row> {
        let ours = number(&self.name)?;
        let mut row = Row {
            item: self.clone(),
            ours,
            other: None,
            sampled: None,
            verdict: Verdict::Alone,
        };
        let Some((paper, tolerance)) = self.paper else {
            for reason in &self.reasons {
                if let Reason::Agrees(name) = reason {
                    let other = number(name)?;
                    let apart = (ours.value - other.value).abs();
                    let near = apart <= 0.5 * FAR * reach(ours).hypot(reach(other));
                    row.other = Some(other);
                    row.verdict = if near {
                        Verdict::Agrees
                    } else {
                        Verdict::Disagrees
                    };
                }
            }
            return Ok(row);
        };
        let apart = (ours.value - paper).abs();
        let exact = if ours.origin == Origin::Sampling {
            0.0
        } else {
            ours.error
        };
        // Halves of the last digit are decimal, their differences are not.
        let digits = tolerance * (1.0 + 1e-9) + exact;
        row.verdict = if apart <= digits {
            Verdict::Digits
        } else if apart <= tolerance + reach(ours) {
            Verdict::Sampling
        } else {
            Verdict::Unexplained
        };
        if self.reasons.contains(&Reason::Test) {
            row.verdict = if row.verdict == Verdict::Unexplained {
                Verdict::DoesNotExplain
            } else {
                Verdict::WouldExplain
            };
            return Ok(row);
        }
        let mut length_of_paper = None;
        for reason in &self.reasons {
            if let Reason::Sampled(length) = reason {
                length_of_paper = Some(*length);
                let error = per_length(&self.name, *length)?;
                row.sampled = Some(error);
                if row.verdict == Verdict::Unexplained
                    && apart <= tolerance + (WITHIN * error).hypot(reach(ours))
                {
                    row.verdict = Verdict::Sampling;
                }
            }
            if let Reason::By(name, factor) = reason {
                let other = number(name)?.scaled(*factor);
                let sampled = match length_of_paper {
                    Some(length) if name.label != COMPUTED => per_length(name, length)?,
                    _ => 0.0,
                };
                let within = tolerance * (1.0 + 1e-9) + (WITHIN * sampled).hypot(reach(other));
                if row.verdict == Verdict::Unexplained && (other.value - paper).abs() <= within {
                    row.other = Some(other);
                    row.verdict = Verdict::Explained;
                }
            }
        }
        Ok(row)
    }
}

impl Reason {
    fn parse(text: &str) -> Option<Self> {
        if text == "test" {
            return Some(Self::Test);
        }
        let (word, rest) = text.split_once(' ')?;
        match word {
            "sampled" => {
                let length: f64 = rest.trim().parse().ok()?;
                (length.is_finite() && length > 0.0).then_some(Self::Sampled(length))
            }
            "agrees" => Some(Self::Agrees(Name::parse(rest)?)),
            "by" => match rest.rsplit_once('*') {
                None => Some(Self::By(Name::parse(rest)?, 1.0)),
                Some((name, factor)) => {
                    Some(Self::By(Name::parse(name)?, factor.trim().parse().ok()?))
                }
            },
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(line: &str) -> Verdict {
        let number = |name: &Name| {
            Ok(match name.path.as_str() {
                "exact" => Estimate::closed_form(0.7479),
                "sampled" => Estimate::new(0.7479, 0.01, Origin::Sampling),
                "displacement" => Estimate::closed_form(-0.0102),
                other => return Err(Error::invalid("test", other, "a name of the test")),
            })
        };
        let item = Item::parse(line, "line 1").unwrap();
        item.answer(&number, &|_, length| Ok(1.0 / length.sqrt()))
            .unwrap()
            .verdict
    }

    #[test]
    fn a_verdict_is_what_the_numbers_say() {
        assert_eq!(verdict("a: exact,0.75,0.005"), Verdict::Digits);
        assert_eq!(verdict("a: exact,0.72,0.005"), Verdict::Unexplained);
        assert_eq!(verdict("a: sampled,0.735,0.0005"), Verdict::Sampling);
        assert_eq!(
            verdict("a: exact,0.72,0.005,Table 5,sampled 4900"),
            Verdict::Sampling
        );
        assert_eq!(
            verdict("a: exact,0.72,0.005,Table 5,sampled 49000"),
            Verdict::Unexplained
        );
        let line = "a: exact,-0.010,0.0005,Table 4,by a: displacement,the moments of q";
        assert_eq!(verdict(line), Verdict::Explained);
        let line = "a: exact,-0.10,0.005,Table 4,by a: displacement * 10";
        assert_eq!(verdict(line), Verdict::Explained);
        let line = "a: exact,-0.2,0.005,Table 4,by a: displacement * 10";
        assert_eq!(verdict(line), Verdict::Unexplained);
        assert_eq!(
            verdict("a: exact,0.72,0.005,,test"),
            Verdict::DoesNotExplain
        );
        assert_eq!(verdict("a: exact,,,,agrees a: sampled"), Verdict::Agrees);
        assert_eq!(
            verdict("a: exact,,,,agrees a: displacement"),
            Verdict::Disagrees
        );
    }

    #[test]
    fn a_line_that_is_no_item_is_refused_with_its_place() {
        for line in [
            "no colon,1,0.5",
            "a: b,1",
            "a: b,one,0.5",
            "a: b,1,0.5,Table 1,perhaps",
        ] {
            let message = Item::parse(line, "x/paper.csv line 7")
                .unwrap_err()
                .to_string();
            assert!(message.contains("x/paper.csv line 7"), "{message}");
        }
    }
}
