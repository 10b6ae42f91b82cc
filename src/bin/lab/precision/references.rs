//! The scenes of the calibration and the reference solutions their error estimates are judged by, as stored in
//! validation/precision and built into the program. tests/references.rs makes them.

use crate::rows::{Row, rows};
use toml::{Table, Value};
use vibroimpact::error::{Error, Result};
use vibroimpact::moments::Moment;
use vibroimpact::scene::Scene;
use vibroimpact::scene::text::{SceneError, SceneText};

const SCENES: &str = include_str!("../../../../validation/precision/scenes.csv");
const CONTACTS: &str = include_str!("../../../../validation/precision/contacts.toml");
const REFERENCES: &str = include_str!("../../../../validation/precision/references.csv");

/// A scene that asks for transient moments alone, and what they are.
#[derive(Debug, Clone)]
pub struct Case {
    /// Its number in scenes.csv, and on through contacts.toml.
    pub number: usize,
    /// The scene, with the program's default accuracy.
    pub scene: Scene,
    /// What is known, ordered by time, then as [`Moment::ALL`].
    pub references: Vec<Reference>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    pub t: f64,
    /// Its place in [`Moment::ALL`].
    pub index: usize,
    pub value: f64,
    /// What it may itself be off by.
    pub uncertainty: f64,
}

/// Every stored scene with its reference solutions, by number.
pub fn cases() -> Result<Vec<Case>> {
    read(SCENES, CONTACTS, REFERENCES)
}

/// The scenes of a file that lists them under [[scene]].
pub(super) fn listed(name: &'static str, text: &str) -> Result<Vec<Scene>> {
    let unread = |it: toml::de::Error| Error::invalid(name, it.message(), "TOML");
    let mut file: Table = text.parse().map_err(unread)?;
    let scenes = match file.remove("scene") {
        Some(Value::Array(scenes)) => scenes,
        _ => Vec::new(),
    };
    let scene = |(k, it): (usize, &Value)| {
        let scene = it.as_table().map(Table::to_string).unwrap_or_default();
        match SceneText::parse(name, &scene, &[]) {
            Ok(text) => Ok(text.scene().clone()),
            Err(it) => Err(placed(name, k + 1, &it)),
        }
    };
    scenes.iter().enumerate().map(scene).collect()
}

/// What is wrong with a scene, with its file and number before the key.
fn placed(name: &str, number: usize, wrong: &SceneError) -> Error {
    let key = wrong.key().unwrap_or_default();
    let accepted = wrong.accepted().unwrap_or("a scene");
    let value = wrong.value().unwrap_or("what stands there");
    Error::invalid(format!("{name}, scene {number}: {key}"), value, accepted)
}

/// The scenes and references of tables in the form of those stored.
fn read(scenes: &str, contacts: &str, references: &str) -> Result<Vec<Case>> {
    let scenes = rows("validation/precision/scenes.csv", scenes, ',');
    let mut cases: Vec<Case> = scenes.map(|row| case(&row)).collect::<Result<_>>()?;
    for scene in listed("validation/precision/contacts.toml", contacts)? {
        cases.push(Case {
            number: cases.len() + 1,
            scene,
            references: Vec::new(),
        });
    }
    for row in rows("validation/precision/references.csv", references, ',') {
        let number: usize = row.get(0)?;
        let reference = reference(&row)?;
        let case = cases.iter_mut().find(|case| case.number == number);
        let case = case.ok_or_else(|| row.wrong("a scene of scenes.csv"))?;
        case.references.push(reference);
    }
    Ok(cases)
}

fn case(row: &Row<'_>) -> Result<Case> {
    let [_, contact, zeta, h, start, q, v, wide_q, wide_v, times] = row.fields[..] else {
        return Err(row.wrong("ten fields"));
    };
    let number = row.get(0)?;
    let gaussian = match start {
        "gaussian" => format!("mean = [{q}, {v}]\ndeviation = [{wide_q}, {wide_v}]\n"),
        _ => String::new(),
    };
    let times = times.replace(' ', ", ");
    let toml = format!(
        "title = \"calibration {number}\"\n[oscillator]\ncontact = \"{contact}\"\nzeta = {zeta}\nh = {h}\n\
         [initial]\nkind = \"{start}\"\n{gaussian}[outputs]\nmoments_at = [{times}]\n"
    );
    let text = SceneText::parse("scenes.csv", &toml, &[]);
    Ok(Case {
        number,
        scene: text
            .map_err(|it| row.wrong(it.to_string()))?
            .scene()
            .clone(),
        references: Vec::new(),
    })
}

fn reference(row: &Row<'_>) -> Result<Reference> {
    let names = Moment::ALL.map(Moment::name);
    let index = names
        .iter()
        .position(|name| row.fields.get(2) == Some(name));
    Ok(Reference {
        t: row.get(1)?,
        index: index.ok_or_else(|| row.wrong("the name of a moment in field 3"))?,
        value: row.get(3)?,
        uncertainty: row.get(4)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stored_scene_reads_and_every_one_of_its_times_has_references() {
        let cases = cases().unwrap();
        assert!(cases.len() > 48);
        for case in &cases {
            case.scene.check().unwrap();
            for t in case.scene.outputs.moments_at.list() {
                let here = case.references.iter().filter(|it| it.t == t).count();
                assert!(
                    here >= 6,
                    "scene {}, t = {t}: {here} references",
                    case.number
                );
            }
        }
    }

    #[test]
    fn a_line_that_does_not_read_is_named() {
        let scenes = "scene,...\n1,hertz,0.1,0.01,rest,,,,,1 2\n";
        let message = |references: &str| {
            let references = format!("scene,...\n{references}");
            read(scenes, "", &references).unwrap_err().to_string()
        };
        assert!(message("1,1,mean_x,0,0,m").contains("references.csv line 2"));
        assert!(message("#\n2,1,mean_q,0,0,m").contains("a scene of scenes.csv"));
        assert!(message("1,1,mean_q,zero,0,m").contains("field 4"));
        assert!(read(&scenes.replace("hertz", "steel"), "", "").is_err());
        let steel = "[[scene]]\noscillator = { contact = \"steel\", zeta = 1, h = 1 }";
        let wrong = read(scenes, steel, "").unwrap_err().to_string();
        assert!(
            wrong.contains("contacts.toml, scene 1: oscillator.contact = "),
            "{wrong}"
        );
        let good = read(scenes, "", "scene,...\n1,2,var_q,0.5,1e-9,m\n").unwrap();
        assert_eq!(good[0].references[0].index, 1);
    }
}
