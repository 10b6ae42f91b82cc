//! The scenes of the calibration and the truths their error bars are judged by, as stored in
//! validation/precision and built into the program. tests/truths.rs makes them.

use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use crate::initial::Initial;
use crate::moments::Moment;
use crate::oscillator::Oscillator;
use crate::scene::{Outputs, Scene, Times};
use std::str::FromStr;

const SCENES: &str = include_str!("../../validation/precision/scenes.csv");
const TRUTHS: &str = include_str!("../../validation/precision/truths.csv");

/// A scene that asks for transient moments alone, and what they are.
#[derive(Debug, Clone)]
pub struct Case {
    /// Its number in scenes.csv.
    pub number: usize,
    /// The scene, with the program's default accuracy.
    pub scene: Scene,
    /// What is known, ordered by time, then as [`Moment::ALL`].
    pub truths: Vec<Truth>,
}

/// One number that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Its time.
    pub t: f64,
    /// Its place in [`Moment::ALL`].
    pub index: usize,
    /// The number.
    pub value: f64,
    /// What it may itself be off by.
    pub uncertainty: f64,
}

/// Every stored scene with its truths, by number.
///
/// # Errors
/// [`Error::Invalid`] for a line that does not read.
pub fn cases() -> Result<Vec<Case>> {
    read(SCENES, TRUTHS)
}

/// The scenes and truths of two files in the form of those stored.
///
/// # Errors
/// [`Error::Invalid`] for a line that does not read.
pub fn read(scenes: &str, truths: &str) -> Result<Vec<Case>> {
    let mut cases: Vec<Case> = rows("scenes.csv", scenes)
        .map(|row| row.case())
        .collect::<Result<_>>()?;
    for row in rows("truths.csv", truths) {
        let number: usize = row.get(0)?;
        let truth = row.truth()?;
        let case = cases.iter_mut().find(|case| case.number == number);
        let case = case.ok_or_else(|| row.wrong("a scene of scenes.csv"))?;
        case.truths.push(truth);
    }
    Ok(cases)
}

/// A line of a file.
struct Row<'a> {
    place: String,
    text: &'a str,
    fields: Vec<&'a str>,
}

/// The lines below the comments and the header.
fn rows<'a>(file: &'a str, text: &'a str) -> impl Iterator<Item = Row<'a>> {
    let lines = (1..).zip(text.lines());
    let lines = lines.filter(|(_, line)| !line.starts_with('#') && !line.starts_with("scene,"));
    lines.map(move |(number, text)| Row {
        place: format!("validation/precision/{file}, line {number}"),
        text,
        fields: text.split(',').collect(),
    })
}

impl Row<'_> {
    fn wrong(&self, accepted: &str) -> Error {
        Error::invalid(self.place.as_str(), format!("{:?}", self.text), accepted)
    }

    fn get<T: FromStr>(&self, field: usize) -> Result<T> {
        let text = self.fields.get(field);
        text.and_then(|it| it.parse().ok())
            .ok_or_else(|| self.wrong(&format!("a number in field {}", field + 1)))
    }

    fn text(&self, field: usize) -> &str {
        self.fields.get(field).copied().unwrap_or("")
    }

    fn case(&self) -> Result<Case> {
        let contact = match self.text(1) {
            "hertz" => ContactLaw::Hertz,
            "bilinear" => ContactLaw::Bilinear,
            "linear" => ContactLaw::Linear,
            "free" => ContactLaw::Free,
            _ => return Err(self.wrong("hertz, bilinear, linear or free in field 2")),
        };
        let initial = match self.text(4) {
            "gaussian" => {
                Initial::gaussian([self.get(5)?, self.get(6)?], [self.get(7)?, self.get(8)?])?
            }
            "rest" => Initial::Rest,
            "stationary" => Initial::Stationary,
            _ => return Err(self.wrong("gaussian, rest or stationary in field 5")),
        };
        let times = self.text(9).split(' ').map(str::parse);
        let times: Vec<f64> = times
            .collect::<std::result::Result<_, _>>()
            .map_err(|_| self.wrong("times in field 10"))?;
        let mut scene = Scene::new(Oscillator::new(contact, self.get(2)?, self.get(3)?)?);
        scene.title = format!("calibration {}", self.text(0));
        scene.initial = initial;
        scene.outputs = Outputs {
            moments_at: Times::List(times),
            ..Outputs::nothing()
        };
        Ok(Case {
            number: self.get(0)?,
            scene,
            truths: Vec::new(),
        })
    }

    fn truth(&self) -> Result<Truth> {
        let names = Moment::ALL.map(Moment::name);
        let index = names.iter().position(|name| *name == self.text(2));
        Ok(Truth {
            t: self.get(1)?,
            index: index.ok_or_else(|| self.wrong("the name of a moment in field 3"))?,
            value: self.get(3)?,
            uncertainty: self.get(4)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stored_scene_reads_and_every_one_of_its_times_has_truths() {
        let cases = cases().unwrap();
        assert!(cases.len() >= 40);
        for case in &cases {
            case.scene.check().unwrap();
            for t in case.scene.outputs.moments_at.list() {
                let here = case.truths.iter().filter(|it| it.t == t).count();
                assert!(here >= 6, "scene {}, t = {t}: {here} truths", case.number);
            }
        }
    }

    #[test]
    fn a_line_that_does_not_read_is_named() {
        let scenes = "scene,...\n1,hertz,0.1,0.01,rest,,,,,1 2\n";
        let message = |truths: &str| read(scenes, truths).unwrap_err().to_string();
        assert!(message("1,1,mean_x,0,0,m").contains("line 1"));
        assert!(message("#\n2,1,mean_q,0,0,m").contains("a scene of scenes.csv"));
        assert!(message("1,1,mean_q,zero,0,m").contains("field 4"));
        assert!(read("1,steel,0.1,0.01,rest,,,,,1\n", "").is_err());
        let good = read(scenes, "1,2,var_q,0.5,1e-9,m\n").unwrap();
        assert_eq!(good[0].truths[0].index, 1);
    }
}
