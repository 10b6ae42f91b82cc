//! A folder of the validation: its items, its scenes, and what came of them.

use super::evidence::{self, Evidence};
use super::item::{Item, Row};
use super::numbers::{self, COMPUTED, Name};
use super::spectra::Spectra;
use super::{ITEMS, pictures};
use crate::error::{Error, Result};
use crate::estimate::Estimate;
use crate::moments::Moment;
use crate::plan::Plan;
use crate::report::File;
use crate::results::Results;
use crate::scene::text::SceneText;
use std::fs;
use std::path::{Path, PathBuf};

/// A folder as it is read.
#[derive(Debug, Clone)]
pub struct Folder {
    path: PathBuf,
    /// Its name, as `table-4`.
    pub name: String,
    /// What is to be said before its numbers.
    pub about: String,
    /// Its items, in their order.
    pub items: Vec<Item>,
}

/// A folder with its answers.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Its name.
    pub name: String,
    /// What is to be said before its numbers.
    pub about: String,
    /// Its items with their answers.
    pub rows: Vec<Row>,
    /// Its pictures, and the arrays behind them.
    pub pictures: Vec<File>,
}

/// A scene that was run, under its label.
#[derive(Debug, Clone)]
pub struct Run {
    /// The label of its items.
    pub label: String,
    /// What came of it.
    pub results: Results,
    json: serde_json::Value,
}

/// The last part of a path.
pub fn name_of(path: &Path) -> String {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    full.file_name()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

impl Folder {
    /// The folder at `path`.
    ///
    /// # Errors
    /// [`Error::Invalid`] where there is no list of items, or a line in it is not an item.
    pub fn read(path: &Path) -> Result<Self> {
        let list = path.join(ITEMS);
        let shown = list.display().to_string();
        let text = fs::read_to_string(&list).map_err(|error| {
            let accepted = format!("a folder with a {ITEMS}: {shown}: {error}");
            Error::invalid("validate", path.display(), accepted)
        })?;
        let (mut items, mut places) = (Vec::new(), Vec::new());
        for (k, line) in text.lines().enumerate().skip(1) {
            if !line.trim().is_empty() && !line.starts_with('#') {
                places.push(format!("{shown} line {}", k + 1));
                items.push(Item::parse(line, &places[places.len() - 1])?);
            }
        }
        let folder = Self {
            name: name_of(path),
            about: fs::read_to_string(path.join("about.md")).unwrap_or_default(),
            items,
            path: path.to_owned(),
        };
        folder.check(&places)?;
        Ok(folder)
    }

    /// Every name of every item can be read, before anything is computed: a key that a scene or a kind of number
    /// does not have is an error that names the line.
    fn check(&self, places: &[String]) -> Result<()> {
        let mut scenes: Vec<&str> = Vec::new();
        for (item, at) in self.items.iter().zip(places) {
            for name in item.names() {
                if name.label == COMPUTED {
                    evidence::check(&name.path, at)?;
                } else if !scenes.contains(&name.label.as_str()) {
                    scenes.push(&name.label);
                    let wrong = |error: Error| Error::invalid(at, &name.label, error.to_string());
                    self.scene(&name.label).map_err(wrong)?;
                }
            }
        }
        Ok(())
    }

    /// Whether it takes a second or less: closed forms and long records, no transient, spectrum or draw.
    pub fn is_quick(&self) -> bool {
        let slow = [
            "transient",
            "decay_rates",
            "spectrum",
            "draws",
            "records",
            "restarts",
            "rest-records",
        ];
        let quick = |name: &Name| {
            !name
                .path
                .split(['.', ' '])
                .any(|key| slow.iter().any(|it| key.split('[').next() == Some(it)))
        };
        self.items.iter().flat_map(Item::names).all(quick)
    }

    /// The labels of the scenes its items need, in their order.
    pub fn labels(&self) -> Vec<String> {
        let mut labels: Vec<String> = Vec::new();
        for name in self.items.iter().flat_map(Item::names) {
            if name.label != COMPUTED && !labels.contains(&name.label) {
                labels.push(name.label.clone());
            }
        }
        labels
    }

    fn scene(&self, label: &str) -> Result<SceneText> {
        let (file, overrides) = numbers::scene(label);
        let path = self.path.join(format!("{file}.toml"));
        let text = fs::read_to_string(&path).map_err(|error| {
            let accepted = format!("the name of a scene in the folder: {error}");
            Error::invalid(path.display().to_string(), label, accepted)
        })?;
        SceneText::parse(&path.display().to_string(), &text, &overrides)
            .map_err(|error| Error::invalid(path.display().to_string(), label, error.to_string()))
    }

    /// Run every scene and answer every item. `progress` is told each label before it is run;
    /// `spectra` keeps spectra from folder to folder.
    ///
    /// # Errors
    /// Those of the scenes; [`Error::Invalid`] for a number that does not exist.
    pub fn run(&self, spectra: &Spectra, progress: &dyn Fn(&str)) -> Result<Outcome> {
        let mut runs = Vec::new();
        for label in self.labels() {
            progress(&label);
            let text = self.scene(&label)?;
            let results = Plan::of(text.scene())?.run_quietly()?;
            runs.push(Run {
                json: results.tree(),
                label,
                results,
            });
        }
        progress("comparing");
        let evidence = Evidence::new(&self.path, &runs, spectra);
        let per_length = |name: &Name, length: f64| -> Result<f64> {
            let found = runs.iter().find(|run| run.label == name.label);
            found
                .and_then(|run| run.error_in_record(&name.path, length))
                .ok_or_else(|| {
                    let accepted =
                        "a stationary number of a scene with [monte_carlo], for \"sampled\"";
                    Error::invalid(format!("{}/{ITEMS}", self.name), name, accepted)
                })
        };
        let mut rows: Vec<Row> = Vec::new();
        for item in &self.items {
            let number = |name: &Name| -> Result<Estimate> {
                if name.label == COMPUTED {
                    return evidence.number(&name.path, &rows);
                }
                let found = runs.iter().find(|run| run.label == name.label);
                found
                    .and_then(|run| numbers::at(&run.json, &name.path))
                    .ok_or_else(|| {
                        let accepted = "the path of a number in results.json";
                        Error::invalid(format!("{}/{ITEMS}", self.name), name, accepted)
                    })
            };
            let row = item.answer(&number, &per_length)?;
            rows.push(row);
        }
        Ok(Outcome {
            name: self.name.clone(),
            about: self.about.clone(),
            rows,
            pictures: pictures::of(&self.name, &runs, spectra)?,
        })
    }
}

impl Run {
    /// One standard error of a stationary number in a plain record of that dimensionless length, from
    /// the long records of this scene.
    fn error_in_record(&self, path: &str, length: f64) -> Option<f64> {
        let records = self.results.records.as_ref()?;
        let last = path.rsplit('.').next()?;
        let error = match Moment::named(last).and_then(|it| records.moments.get(it)) {
            Some(number) => number.error,
            None => {
                let (section, rest) = path.split_once('.')?;
                let sampled = match section {
                    "rig" => format!("rig.monte_carlo.{rest}"),
                    other => format!("monte_carlo.{other}.{rest}"),
                };
                numbers::at(&self.json, &sampled)?.error
            }
        };
        Some(error * (records.duration / length).sqrt())
    }
}
