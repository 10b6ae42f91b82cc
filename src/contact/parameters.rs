//! What a scene says of a contact law: `contact = { law = "...", key = value, ... }`.

use crate::error::{Error, Result};
use crate::format::num;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A value of a scene.
#[derive(Debug, Clone, PartialEq)]
pub enum Parameter {
    /// A number.
    Number(f64),
    /// A list of numbers.
    Numbers(Vec<f64>),
    /// Text.
    Text(String),
}

impl Parameter {
    fn shown(&self) -> String {
        match self {
            Self::Number(x) => num(*x),
            Self::Numbers(all) => format!("a list of {} numbers", all.len()),
            Self::Text(text) => format!("{text:?}"),
        }
    }
}

/// The keys and values of a contact law in a scene.
#[derive(Debug, Clone, Default)]
pub struct Parameters {
    all: BTreeMap<String, Parameter>,
    /// What a relative path starts from.
    folder: PathBuf,
}

impl PartialEq for Parameters {
    fn eq(&self, other: &Self) -> bool {
        self.all == other.all
    }
}

impl Parameters {
    /// No key yet; relative paths start from the working directory.
    pub fn new() -> Self {
        Self::default()
    }

    /// The same with `key`.
    #[must_use]
    pub fn with(mut self, key: &str, value: Parameter) -> Self {
        self.all.insert(key.to_owned(), value);
        self
    }

    /// The same, relative paths starting from `folder`: that of the scene's file.
    #[must_use]
    pub fn from_folder(mut self, folder: &Path) -> Self {
        folder.clone_into(&mut self.folder);
        self
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// A path of the scene.
    pub(crate) fn path(&self, text: &str) -> PathBuf {
        self.folder.join(text)
    }

    /// An error about `key`.
    pub(crate) fn refuse(&self, key: &str, accepted: impl Into<String>) -> Error {
        let value = self.all.get(key).map_or("missing".into(), Parameter::shown);
        Error::invalid(full(key), value, accepted)
    }

    /// A finite number; None where the key is absent.
    pub(crate) fn number(&self, key: &str) -> Result<Option<f64>> {
        match self.all.get(key) {
            None => Ok(None),
            Some(Parameter::Number(x)) if x.is_finite() => Ok(Some(*x)),
            Some(_) => Err(self.refuse(key, "a finite number")),
        }
    }

    /// A list of finite numbers; None where the key is absent.
    pub(crate) fn numbers(&self, key: &str) -> Result<Option<&[f64]>> {
        match self.all.get(key) {
            None => Ok(None),
            Some(Parameter::Numbers(all)) => match all.iter().position(|x| !x.is_finite()) {
                None => Ok(Some(all)),
                Some(k) => {
                    let key = format!("{}[{k}]", full(key));
                    Err(Error::invalid(key, num(all[k]), "a finite number"))
                }
            },
            Some(_) => Err(self.refuse(key, "a list of numbers")),
        }
    }

    /// Text; None where the key is absent.
    pub(crate) fn text(&self, key: &str) -> Result<Option<&str>> {
        match self.all.get(key) {
            None => Ok(None),
            Some(Parameter::Text(text)) => Ok(Some(text)),
            Some(_) => Err(self.refuse(key, "text in quotes")),
        }
    }

    /// As a table of a scene, for the law of this name.
    pub(crate) fn tree(&self, law: &str) -> Value {
        let mut tree = Map::new();
        tree.insert("law".into(), json!(law));
        for (key, value) in &self.all {
            let value = match value {
                Parameter::Number(x) => json!(x),
                Parameter::Numbers(all) => json!(all),
                Parameter::Text(text) => json!(text),
            };
            tree.insert(key.clone(), value);
        }
        tree.into()
    }
}

/// The key of a scene.
pub(crate) fn full(key: &str) -> String {
    format!("oscillator.contact.{key}")
}
