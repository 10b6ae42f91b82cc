//! One number of the paper and what ours has to say to it.

use super::numbers::{COMPUTED, Name};
use std::fmt;
use vibroimpact::error::{Error, Result};
use vibroimpact::estimate::{Estimate, Origin};

/// A line of `paper.csv`: `name,value,tolerance,where,reason,because`.
///
/// `value` and `tolerance` (half a unit of the last printed digit) are empty for a number that the paper
/// does not give. A bound is written `<0.005`, without a tolerance. `reason` lists, separated by semicolons,
/// what a difference may come from:
///
/// | reason | what it does |
/// |---|---|
/// | `sampled L` | the paper's number may be off by two standard errors of a record of the dimensionless length L |
/// | `input X` | our number may be off by X of its value, by the digits of the paper's inputs |
/// | `by NAME`, `by NAME * F` | explained if F times that number agrees with the paper, within the sample too if `sampled` stands before it |
/// | `possibly NAME` | the same, for a cause that has a rival which does as well |
/// | `fitted NAME` | the same, for a number with a parameter that was fitted to the paper's number |
/// | `agrees NAME` | (no paper value) the two numbers of ours agree within their errors |
/// | `test` | the line asks whether this number would explain the paper's |
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    pub name: Name,
    /// What the paper prints.
    pub paper: Option<Paper>,
    /// The paper's number as it is written in the file.
    pub printed: String,
    /// Where it stands in the paper, or what it is.
    pub place: String,
    /// What a difference may come from.
    pub reasons: Vec<Reason>,
    /// The same in words.
    pub because: String,
}

/// What the paper prints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Paper {
    /// A number and half a unit of its last digit.
    Number(f64, f64),
    /// "Less than".
    Below(f64),
}

/// What a difference may come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// The paper's number comes from a record of this dimensionless length.
    Sampled(f64),
    /// Our number rests on inputs whose printed digits leave this share of it open.
    Input(f64),
    /// The paper's number is this one, times a factor; the verdict if so.
    Candidate(Name, f64, Verdict),
    /// Not a number of the paper: two of ours that should be the same.
    Agrees(Name),
    /// A candidate explanation.
    Test,
}

/// What is to be said of a number. "Our error" is a bound, or two standard errors for what is sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// The difference is at most half a unit of the paper's last digit, and so is our own error.
    Digits,
    /// Our number is below the paper's bound by more than our own error.
    Bound,
    /// The difference is within our own error, which is larger than the paper's half unit; or our error holds
    /// the paper's bound.
    OurError,
    /// The difference is within two standard errors of the sample.
    Sampling,
    /// Another number shows where it comes from.
    Explained,
    /// Another number would show where it comes from, but so would a rival.
    Possible,
    /// A number with a parameter fitted to the paper's number gives it.
    Fitted,
    Unexplained,
    Agrees,
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
            Self::Bound => "within the printed bound",
            Self::OurError => "within our own error",
            Self::Sampling => "within sampling error",
            Self::Explained => "explained",
            Self::Possible => "possibly explained",
            Self::Fitted => "fitted",
            Self::Unexplained => "unexplained",
            Self::Agrees => "agrees",
            Self::Disagrees => "disagrees",
            Self::WouldExplain => "would explain it",
            Self::DoesNotExplain => "does not explain it",
            Self::Alone => "ours alone",
        })
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    pub item: Item,
    pub ours: Estimate,
    /// What it was compared with, if not with the paper: the other number of ours, or the candidate that gives
    /// the paper's number; if none does, the nearest one.
    pub other: Option<(Name, Estimate)>,
    /// One standard error of the paper's own sample, where one is known.
    pub sampled: Option<f64>,
    pub verdict: Verdict,
}

/// Standard errors within which two numbers agree: 95 % of all pairs.
pub const WITHIN: f64 = 2.0;
/// The same where many pairs of ours are looked at: 1 in 16 000 pairs differs by more. An error that is a bound
/// counts for two standard errors.
pub const FAR: f64 = 4.0;
/// Halves of the last digit are decimal, their differences are not.
const DECIMAL: f64 = 1.0 + 1e-9;

/// How far from the exact value `it` may be at 95 %: its bound, or two standard errors.
fn reach(it: Estimate) -> f64 {
    match it.origin {
        Origin::Sampling => WITHIN * it.error,
        _ => it.error,
    }
}

impl Item {
    /// An item from its line; `at` names the line in messages.
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
        let paper = match (value.strip_prefix('<'), value, tolerance) {
            (None, "", "") => None,
            (Some(bound), _, "") => Some(Paper::Below(number(bound)?)),
            (Some(_), ..) => {
                let what = "no tolerance after a bound such as <0.005";
                return Err(wrong(tolerance, what));
            }
            _ => Some(Paper::Number(number(value)?, number(tolerance)?)),
        };
        let mut reasons = Vec::new();
        for text in reason
            .split(';')
            .map(str::trim)
            .filter(|text| !text.is_empty())
        {
            let parsed = Reason::parse(text);
            let accepted = "sampled LENGTH, input SHARE, by NAME, by NAME * FACTOR, possibly NAME, fitted NAME, \
                            agrees NAME, or test";
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
            Reason::Candidate(name, ..) | Reason::Agrees(name) => Some(name),
            _ => None,
        });
        std::iter::once(&self.name).chain(others)
    }

    /// The item with its answer: `number` gives any number by name, `per_length` the standard error of
    /// `name` in a record of that length.
    pub fn answer(&self, number: Numbers<'_>, per_length: Lengths<'_>) -> Result<Row> {
        let ours = number(&self.name)?;
        let mut row = Row {
            item: self.clone(),
            ours,
            other: None,
            sampled: None,
            verdict: Verdict::Alone,
        };
        match self.paper {
            None => self.compare(&mut row, number)?,
            Some(Paper::Below(bound)) => {
                row.verdict = if ours.value + reach(ours) < bound {
                    Verdict::Bound
                } else if ours.value - reach(ours) < bound {
                    Verdict::OurError
                } else {
                    Verdict::Unexplained
                };
            }
            Some(Paper::Number(paper, half)) => {
                for reason in &self.reasons {
                    if let Reason::Sampled(length) = reason {
                        row.sampled = Some(per_length(&self.name, *length)?);
                    }
                }
                row.verdict = self.of_number(&row, paper, half);
                if row.verdict == Verdict::Unexplained {
                    self.explain(&mut row, paper, half, number, per_length)?;
                }
            }
        }
        if self.reasons.contains(&Reason::Test) {
            row.verdict = if row.verdict == Verdict::Unexplained {
                Verdict::DoesNotExplain
            } else {
                Verdict::WouldExplain
            };
        }
        Ok(row)
    }

    /// Two numbers of ours against each other.
    fn compare(&self, row: &mut Row, number: Numbers<'_>) -> Result<()> {
        for reason in &self.reasons {
            if let Reason::Agrees(name) = reason {
                let other = number(name)?;
                let apart = (row.ours.value - other.value).abs();
                let near = apart <= FAR / WITHIN * reach(row.ours).hypot(reach(other));
                row.other = Some((name.clone(), other));
                row.verdict = if near {
                    Verdict::Agrees
                } else {
                    Verdict::Disagrees
                };
            }
        }
        Ok(())
    }

    /// The share of our number that the digits of the paper's inputs leave open.
    pub fn inputs(&self) -> Option<f64> {
        self.reasons.iter().find_map(|reason| match reason {
            Reason::Input(share) => Some(*share),
            _ => None,
        })
    }

    /// What our number alone says to the paper's.
    fn of_number(&self, row: &Row, paper: f64, half: f64) -> Verdict {
        let ours = row.ours;
        let apart = (ours.value - paper).abs();
        let error = reach(ours) + self.inputs().unwrap_or(0.0) * ours.value.abs();
        let sample = WITHIN * row.sampled.unwrap_or(0.0);
        if apart <= half * DECIMAL && error <= half {
            Verdict::Digits
        } else if apart <= half * DECIMAL + error {
            match ours.origin {
                Origin::Sampling => Verdict::Sampling,
                _ => Verdict::OurError,
            }
        } else if apart <= half + sample.hypot(error) {
            Verdict::Sampling
        } else {
            Verdict::Unexplained
        }
    }

    /// The first candidate that gives the paper's number, or the nearest.
    fn explain(
        &self,
        row: &mut Row,
        paper: f64,
        half: f64,
        number: Numbers<'_>,
        per_length: Lengths<'_>,
    ) -> Result<()> {
        let mut length_of_paper = None;
        let mut nearest = f64::INFINITY;
        for reason in &self.reasons {
            if let Reason::Sampled(length) = reason {
                length_of_paper = Some(*length);
            }
            let Reason::Candidate(name, factor, verdict) = reason else {
                continue;
            };
            let other = number(name)?.scaled(*factor);
            let sampled = match length_of_paper {
                Some(length) if name.label != COMPUTED => per_length(name, length)?,
                _ => 0.0,
            };
            let apart = (other.value - paper).abs();
            let within = half * DECIMAL + (WITHIN * sampled).hypot(reach(other));
            if apart <= within {
                row.other = Some((name.clone(), other));
                row.verdict = *verdict;
                return Ok(());
            }
            if apart < nearest {
                nearest = apart;
                row.other = Some((name.clone(), other));
            }
        }
        Ok(())
    }
}

/// Any number by its name.
pub type Numbers<'a> = &'a dyn Fn(&Name) -> Result<Estimate>;
/// The standard error of a number in a record of a length.
pub type Lengths<'a> = &'a dyn Fn(&Name, f64) -> Result<f64>;

impl Reason {
    fn parse(text: &str) -> Option<Self> {
        if text == "test" {
            return Some(Self::Test);
        }
        let (word, rest) = text.split_once(' ')?;
        let above_zero = |text: &str| {
            let number: f64 = text.trim().parse().ok()?;
            (number.is_finite() && number > 0.0).then_some(number)
        };
        let candidate = |verdict: Verdict| match rest.rsplit_once('*') {
            None => Some(Self::Candidate(Name::parse(rest)?, 1.0, verdict)),
            Some((name, factor)) => {
                let factor = factor.trim().parse().ok()?;
                Some(Self::Candidate(Name::parse(name)?, factor, verdict))
            }
        };
        match word {
            "sampled" => Some(Self::Sampled(above_zero(rest)?)),
            "input" => Some(Self::Input(above_zero(rest)?)),
            "agrees" => Some(Self::Agrees(Name::parse(rest)?)),
            "by" => candidate(Verdict::Explained),
            "possibly" => candidate(Verdict::Possible),
            "fitted" => candidate(Verdict::Fitted),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(line: &str) -> Row {
        let number = |name: &Name| {
            Ok(match name.path.as_str() {
                "exact" => Estimate::closed_form(0.7479),
                "sampled" => Estimate::new(0.7479, 0.01, Origin::Sampling),
                "rough" => Estimate::new(0.7479, 0.006, Origin::Space),
                "displacement" => Estimate::closed_form(-0.0102),
                other => return Err(Error::invalid("test", other, "a name of the test")),
            })
        };
        let item = Item::parse(line, "line 1").unwrap();
        item.answer(&number, &|_, length| Ok(1.0 / length.sqrt()))
            .unwrap()
    }

    fn verdict(line: &str) -> Verdict {
        row(line).verdict
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
        let (name, nearest) = row(line).other.unwrap();
        assert_eq!(name.path, "displacement");
        assert!((nearest.value + 0.102).abs() < 1e-12, "{nearest}");
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
    fn our_number_is_within_the_printed_digits_only_if_its_own_error_is() {
        assert_eq!(verdict("a: rough,0.75,0.007"), Verdict::Digits);
        assert_eq!(verdict("a: rough,0.75,0.005"), Verdict::OurError);
        assert_eq!(verdict("a: rough,0.74,0.005"), Verdict::OurError);
        assert_eq!(verdict("a: rough,0.73,0.005"), Verdict::Unexplained);
        assert_eq!(verdict("a: sampled,0.75,0.03"), Verdict::Digits);
        assert_eq!(verdict("a: sampled,0.75,0.005"), Verdict::Sampling);
        // What the paper's inputs leave open is ours.
        assert_eq!(
            verdict("a: exact,0.76,0.005,,input 0.02"),
            Verdict::OurError
        );
        assert_eq!(
            verdict("a: exact,0.75,0.005,,input 0.02"),
            Verdict::OurError
        );
        assert_eq!(
            verdict("a: exact,0.78,0.005,,input 0.02"),
            Verdict::Unexplained
        );
    }

    #[test]
    fn a_bound_is_met_missed_or_within_our_own_error() {
        assert_eq!(verdict("a: rough,<0.76,"), Verdict::Bound);
        assert_eq!(verdict("a: rough,<0.75,"), Verdict::OurError);
        assert_eq!(verdict("a: rough,<0.745,"), Verdict::OurError);
        assert_eq!(verdict("a: rough,<0.74,"), Verdict::Unexplained);
        assert!(Item::parse("a: rough,<0.74,0.005", "line 1").is_err());
    }

    #[test]
    fn what_was_fitted_to_a_number_does_not_explain_it() {
        let line = |word: &str| format!("a: exact,-0.010,0.0005,Table 2,{word} a: displacement");
        assert_eq!(verdict(&line("fitted")), Verdict::Fitted);
        assert_eq!(verdict(&line("possibly")), Verdict::Possible);
        // The first that gives the number counts.
        let both =
            "a: exact,-0.010,0.0005,,by a: sampled;fitted a: displacement;by a: displacement";
        assert_eq!(verdict(both), Verdict::Fitted);
    }

    #[test]
    fn a_line_that_is_no_item_is_refused_with_its_place() {
        for line in [
            "no colon,1,0.5",
            "a: b,1",
            "a: b,one,0.5",
            "a: b,1,0.5,Table 1,perhaps",
            "a: b,1,0.5,Table 1,input -1",
        ] {
            let message = Item::parse(line, "x/paper.csv line 7")
                .unwrap_err()
                .to_string();
            assert!(message.contains("x/paper.csv line 7"), "{message}");
        }
    }
}
