//! The scenes: each at an edge of what can be asked, as data in `scenes/*.toml`.
//!
//! An entry has a `name`, what is `extreme` about it, what its numbers are held `against`, the tables of the scene as a
//! user would write them, and where they are needed: its limit of `seconds`, why it `may_stop` at a limit or
//! `may_refuse` the scene, words that a warning `must_warn` with.

use super::against::Against;
use miette::Diagnostic;
use toml::{Table, Value};
use vibroimpact::error::{Error, Result};
use vibroimpact::scene::Scene;
use vibroimpact::scene::text::SceneText;

/// A scene at an edge.
#[derive(Debug, Clone, PartialEq)]
pub struct Extreme {
    pub name: String,
    pub what: String,
    pub toml: String,
    pub against: Against,
    /// Why a limit of time or memory is an acceptable outcome; None where an answer is expected.
    pub may_stop: Option<String>,
    /// Why a refusal is an acceptable outcome; None where an answer is expected.
    pub may_refuse: Option<String>,
    /// Words that must stand in a warning.
    pub must_warn: Option<String>,
    pub max_seconds: f64,
}

/// Seconds a scene may take unless it says otherwise.
const SECONDS: f64 = 20.0;

const FILES: [&str; 11] = [
    include_str!("scenes/damping.toml"),
    include_str!("scenes/temperature.toml"),
    include_str!("scenes/starts.toml"),
    include_str!("scenes/contacts.toml"),
    include_str!("scenes/steps.toml"),
    include_str!("scenes/meshes.toml"),
    include_str!("scenes/times.toml"),
    include_str!("scenes/rare.toml"),
    include_str!("scenes/paths.toml"),
    include_str!("scenes/operators.toml"),
    include_str!("scenes/driven.toml"),
];

/// Every scene, by what is extreme about it.
pub fn scenes() -> Result<Vec<Extreme>> {
    let mut all = Vec::new();
    for text in FILES {
        let mut file: Table = text
            .parse()
            .map_err(|error| Error::invalid("stability/scenes", error, "TOML"))?;
        let Some(Value::Array(entries)) = file.remove("scene") else {
            return Err(Error::invalid("scene", "absent", "an array of tables"));
        };
        for entry in entries {
            all.push(Extreme::of(entry)?);
        }
    }
    Ok(all)
}

impl Extreme {
    fn of(entry: Value) -> Result<Self> {
        let Value::Table(mut entry) = entry else {
            return Err(Error::invalid("scene", entry, "a table"));
        };
        let mut text = |key: &str| match entry.remove(key) {
            None => Ok(None),
            Some(Value::String(text)) => Ok(Some(text)),
            Some(other) => Err(Error::invalid(key, other, "text")),
        };
        let needed = |key: &str, it: Option<String>| {
            it.ok_or_else(|| Error::invalid(key, "absent", "a text in every entry"))
        };
        let name = needed("name", text("name")?)?;
        let what = needed("extreme", text("extreme")?)?;
        let [may_stop, may_refuse, must_warn] =
            [text("may_stop")?, text("may_refuse")?, text("must_warn")?];
        let against = entry.remove("against");
        let shown = || against.as_ref().map_or("absent".into(), Value::to_string);
        let against = Against::read(against.as_ref())
            .map_err(|accepted| Error::invalid(format!("{name}.against"), shown(), accepted))?;
        let max_seconds = match entry.remove("seconds") {
            None => SECONDS,
            Some(Value::Integer(seconds)) => seconds as f64,
            Some(other) => return Err(Error::invalid("seconds", other, "a whole number")),
        };
        if let Some((key, value)) = entry.iter().find(|(_, value)| !value.is_table()) {
            let accepted = "name, extreme, against, seconds, may_stop, may_refuse, must_warn and tables of a scene";
            return Err(Error::invalid(format!("{name}.{key}"), value, accepted));
        }
        Ok(Self {
            name,
            what,
            toml: entry.to_string(),
            against,
            may_stop,
            may_refuse,
            must_warn,
            max_seconds,
        })
    }

    /// The scene with overrides, or why its text is refused.
    pub fn scene(&self, overrides: &[String]) -> std::result::Result<Scene, String> {
        let limit = format!("accuracy.max_seconds={}", self.max_seconds);
        let all = [&[limit][..], overrides].concat();
        match SceneText::parse(&self.name, &self.toml, &all) {
            Ok(text) => Ok(text.scene().clone()),
            Err(error) => Err(match error.help() {
                Some(help) => format!("{error}; {help}"),
                None => error.to_string(),
            }),
        }
    }
}
