//! Error estimates of first passages: random scenes of all laws, dampings, levels and initial conditions, each held against
//! itself at a tenth of its tolerance.

use super::questions::{Answer, Question};
use super::rates::{FARTHEST, MOST_OUTSIDE};
use std::fmt;
use vibroimpact::error::Result;

const FILE: &str = "validation/precision/passages.toml";
const SCENES: &str = include_str!("../../../../validation/precision/passages.toml");

#[derive(Debug, Clone, PartialEq)]
pub struct Passages {
    answers: Vec<Answer>,
}

impl Passages {
    /// Runs one scene of `each`.
    pub fn calibrate(each: usize) -> Result<Self> {
        let questions = Question::listed(FILE, SCENES, each)?;
        Ok(Self {
            answers: questions.iter().map(Question::answer).collect(),
        })
    }

    fn numbers(&self) -> impl Iterator<Item = &[f64; 3]> {
        self.answers.iter().flat_map(|it| &it.numbers)
    }

    /// Numbers that err more than their estimates, whatever the references may be off by.
    fn outside(&self) -> usize {
        self.numbers().filter(|it| Answer::is_beyond(it)).count()
    }

    /// The largest error over its estimate, less what the reference may be off by.
    fn worst(&self) -> f64 {
        let sure = |[error, estimate, doubt]: &[f64; 3]| (error - doubt) / estimate;
        self.numbers().map(sure).fold(0.0, f64::max)
    }

    /// What of the goals is missed, in words.
    pub fn missed(&self) -> Vec<String> {
        let mut missed = Vec::new();
        let share = self.outside() as f64 / self.numbers().count() as f64;
        if share > MOST_OUTSIDE {
            missed.push(format!("{:.1} % of first passages outside", 100.0 * share));
        }
        if self.worst() > FARTHEST {
            missed.push(format!("a first passage by {:.1} times", self.worst()));
        }
        missed
    }
}

impl fmt::Display for Passages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let met = self.answers.iter().filter(|it| it.met).count();
        writeln!(
            f,
            "first passages: {met} of {} scenes meet their tolerance; {} of {} numbers err more than their estimates; the largest \
             error is {:.2} of its estimate",
            self.answers.len(),
            self.outside(),
            self.numbers().count(),
            self.worst()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::Passages;

    #[test]
    fn first_passages_err_no_more_than_they_say() {
        let it = Passages::calibrate(8).unwrap();
        print!("{it}");
        assert!(it.missed().is_empty(), "{:?}", it.missed());
        assert!(it.numbers().count() > 12);
    }

    #[test]
    #[ignore = "minutes: all of them, for a change of their error estimates"]
    fn all_first_passages() {
        print!("{}", Passages::calibrate(1).unwrap());
    }
}
