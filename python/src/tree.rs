//! Plain values of Python as the text of a scene: from there on a dict is read, checked and shown as a file is.

use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::{self, Display, Write};

/// A plain value: what TOML can say.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum Tree {
    Flag(bool),
    Whole(i64),
    Large(u64),
    Number(f64),
    Text(String),
    List(Vec<Tree>),
    Table(BTreeMap<String, Tree>),
}

/// As a value in a line of TOML.
impl Display for Tree {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let between = |k: usize| if k > 0 { ", " } else { "" };
        match self {
            Self::Flag(it) => write!(f, "{it}"),
            Self::Whole(it) => write!(f, "{it}"),
            Self::Large(it) => write!(f, "{it}"),
            Self::Number(it) if it.is_nan() => f.write_str("nan"),
            // Debug writes a float so that it reads back exactly, with a point or an exponent.
            Self::Number(it) => write!(f, "{it:?}"),
            Self::Text(it) => f.write_str(&quoted(it)),
            Self::List(items) => {
                f.write_str("[")?;
                for (k, it) in items.iter().enumerate() {
                    write!(f, "{}{it}", between(k))?;
                }
                f.write_str("]")
            }
            Self::Table(pairs) => {
                f.write_str("{ ")?;
                for (k, (key, it)) in pairs.iter().enumerate() {
                    write!(f, "{}{} = {it}", between(k), name(key))?;
                }
                f.write_str(" }")
            }
        }
    }
}

/// The text of a scene: what has no section first, then every section.
pub(crate) fn document(pairs: &BTreeMap<String, Tree>) -> String {
    let (mut top, mut sections) = (String::new(), String::new());
    for (key, it) in pairs {
        let key = name(key);
        // Writing to a string does not fail.
        let _ = match it {
            Tree::Table(inner) => {
                let _ = writeln!(sections, "[{key}]");
                inner
                    .iter()
                    .try_for_each(|(key, it)| writeln!(sections, "{} = {it}", name(key)))
            }
            other => writeln!(top, "{key} = {other}"),
        };
    }
    top + &sections
}

fn name(key: &str) -> String {
    let bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if !key.is_empty() && key.chars().all(bare) {
        key.to_owned()
    } else {
        quoted(key)
    }
}

/// A string of JSON is one of TOML, but for DEL.
fn quoted(text: &str) -> String {
    let text = serde_json::Value::from(text).to_string();
    text.replace('\u{7f}', "\\u007F")
}
