//! The scene file and its overrides as one tree, every value with its place.

use super::error::{SceneError, Wrong};
use crate::error::Error;
use crate::format::num;
use std::collections::BTreeMap;
use std::ops::Range;
use toml::de::{DeTable, DeValue};

/// Bytes of one of the sources.
#[derive(Debug, Clone)]
pub(super) struct Place {
    pub(super) source: usize,
    pub(super) span: Range<usize>,
}

#[derive(Debug, Clone)]
pub(super) struct Node {
    pub(super) value: Value,
    /// Where the key stands, and where its value.
    pub(super) key: Place,
    pub(super) at: Place,
}

#[derive(Debug, Clone)]
pub(super) enum Value {
    Table(BTreeMap<String, Node>),
    List(Vec<Node>),
    Text(String),
    Whole(i128),
    Number(f64),
    Flag(bool),
    Date(String),
}

impl Value {
    pub(super) fn kind(&self) -> &'static str {
        match self {
            Self::Table(_) => "a table",
            Self::List(_) => "a list",
            Self::Text(_) => "text",
            Self::Whole(_) => "a whole number",
            Self::Number(_) => "a number",
            Self::Flag(_) => "true or false",
            Self::Date(_) => "a date",
        }
    }

    /// As JSON; dates as text.
    #[cfg(feature = "cli")]
    pub(super) fn plain(&self) -> serde_json::Value {
        use serde_json::json;
        match self {
            Self::Table(table) => {
                let pairs = table
                    .iter()
                    .map(|(key, it)| (key.clone(), it.value.plain()));
                serde_json::Value::Object(pairs.collect())
            }
            Self::List(items) => items.iter().map(|it| it.value.plain()).collect(),
            Self::Text(text) | Self::Date(text) => json!(text),
            Self::Whole(n) => i64::try_from(*n).map_or_else(|_| json!(*n as f64), |n| json!(n)),
            Self::Number(x) => json!(x),
            Self::Flag(flag) => json!(flag),
        }
    }

    /// As in a message; long values are cut.
    pub(super) fn shown(&self) -> String {
        let text = match self {
            Self::Table(_) | Self::List(_) => return self.kind().into(),
            Self::Text(text) => format!("{text:?}"),
            Self::Whole(n) => n.to_string(),
            Self::Number(x) => num(*x),
            Self::Flag(flag) => flag.to_string(),
            Self::Date(date) => date.clone(),
        };
        if text.chars().count() <= 60 {
            return text;
        }
        let short: String = text.chars().take(57).collect();
        format!("{short}...")
    }
}

impl Node {
    fn of(key: Range<usize>, it: &toml::Spanned<DeValue<'_>>, source: usize) -> Self {
        let at = it.span();
        let value = match it.get_ref() {
            DeValue::String(text) => Value::Text(text.to_string()),
            // Beyond 128 bits a whole number is still a number.
            DeValue::Integer(n) => i128::from_str_radix(n.as_str(), n.radix()).map_or_else(
                |_| Value::Number(n.as_str().parse().unwrap_or(f64::NAN)),
                Value::Whole,
            ),
            DeValue::Float(x) => Value::Number(x.as_str().parse().unwrap_or(f64::NAN)),
            DeValue::Boolean(flag) => Value::Flag(*flag),
            DeValue::Datetime(date) => Value::Date(date.to_string()),
            DeValue::Array(items) => {
                let item = |item: &toml::Spanned<_>| Self::of(item.span(), item, source);
                Value::List(items.iter().map(item).collect())
            }
            DeValue::Table(table) => Value::Table(entries(table, source)),
        };
        let place = |span| Place { source, span };
        Self {
            value,
            key: place(key),
            at: place(at),
        }
    }
}

fn entries(table: &DeTable<'_>, source: usize) -> BTreeMap<String, Node> {
    table
        .iter()
        .map(|(key, value)| {
            (
                key.get_ref().to_string(),
                Node::of(key.span(), value, source),
            )
        })
        .collect()
}

/// The scene file and its overrides as one tree, every value with its place.
#[derive(Debug, Clone)]
pub(super) struct Document {
    /// Name and text: the file, then each override.
    pub(super) sources: Vec<(String, String)>,
    pub(super) root: BTreeMap<String, Node>,
}

pub(super) type Read<T> = Result<T, SceneError>;

impl Document {
    pub(super) fn parse(name: &str, text: &str) -> Read<Self> {
        let mut it = Self {
            sources: vec![(name.to_owned(), text.to_owned())],
            root: BTreeMap::new(),
        };
        it.root = it.table(0)?;
        Ok(it)
    }

    fn table(&self, source: usize) -> Read<BTreeMap<String, Node>> {
        match DeTable::parse(&self.sources[source].1) {
            Ok(table) => Ok(entries(table.get_ref(), source)),
            Err(error) => {
                let text = &self.sources[source].1;
                // An error at the end of the text is shown on its last character.
                let span = error.span().unwrap_or(0..0);
                let start = span.start.min(text.len().saturating_sub(1));
                let at = Place {
                    source,
                    span: start..span.end.clamp(start, text.len()),
                };
                let first = error.message().lines().next().unwrap_or("not TOML");
                Err(self.wrong("the scene is not TOML", first, hint(text, start), Some(&at)))
            }
        }
    }

    /// Put an override `KEY=VALUE` of an option of the command line on top.
    pub(super) fn set(&mut self, option: &str, text: &str) -> Read<()> {
        let source = self.sources.len();
        self.sources.push((option.into(), text.to_owned()));
        let all = Place {
            source,
            span: 0..text.len(),
        };
        let Some((key, word)) = text
            .split_once('=')
            .filter(|(key, _)| !key.trim().is_empty())
        else {
            let message = format!("--set {text:?} is not KEY=VALUE");
            let help = "as --set oscillator.h=0.01 or --set oscillator.contact=bilinear";
            return Err(self.wrong(&message, "KEY=VALUE", Some(help), Some(&all)));
        };
        let table = match self.table(source) {
            Ok(table) => table,
            Err(error) => {
                // A bare word: the value is text.
                let quoted = format!("{key} = {}", serde_json::json!(word.trim()));
                match DeTable::parse(&quoted) {
                    Ok(table) => {
                        let mut table = entries(table.get_ref(), source);
                        let from = key.len() + 1;
                        replace_places(&mut table, &all, from..text.len());
                        table
                    }
                    Err(_) => return Err(error),
                }
            }
        };
        // The two ways to give the level exclude each other; the override is meant.
        for (this, other) in [("h", "force_psd"), ("force_psd", "h")] {
            if let Some(Value::Table(new)) = table.get("oscillator").map(|node| &node.value)
                && new.contains_key(this)
                && let Some(Value::Table(old)) =
                    self.root.get_mut("oscillator").map(|node| &mut node.value)
            {
                old.remove(other);
            }
        }
        // Another kind of start leaves the Gaussian's mean and deviation behind.
        if let Some(Value::Table(new)) = table.get("initial").map(|node| &node.value)
            && new.contains_key("kind")
            && let Some(Value::Table(old)) =
                self.root.get_mut("initial").map(|node| &mut node.value)
            && !matches!(&new["kind"].value, Value::Text(kind) if kind == "gaussian")
        {
            old.retain(|key, _| key == "kind");
        }
        merge(&mut self.root, table, key.split('.').count());
        Ok(())
    }

    pub(super) fn wrong(
        &self,
        message: &str,
        label: &str,
        help: Option<&str>,
        at: Option<&Place>,
    ) -> SceneError {
        let source = at.map_or(0, |at| at.source);
        let (name, text) = &self.sources[source];
        SceneError(Box::new(Wrong {
            message: message.to_owned(),
            label: label.to_owned(),
            help: help.map(str::to_owned),
            source: miette::NamedSource::new(name, text.clone()).with_language("toml"),
            span: at.map(|at| at.span.clone()),
            key: None,
            value: None,
        }))
    }

    /// The node under a dotted key, items as `key[2]`; where the key itself is absent, its table.
    pub(super) fn find(&self, key: &str) -> Option<&Node> {
        std::iter::successors(Some(key), |key| Some(key.rsplit_once(['.', '['])?.0))
            .find_map(|key| self.at(key))
    }

    /// The node of exactly this dotted key; None where it is absent.
    pub(super) fn at(&self, key: &str) -> Option<&Node> {
        let mut parts = key.split(['.', '[']).map(|it| it.trim_end_matches(']'));
        let first = self.root.get(parts.next()?)?;
        parts.try_fold(first, |node, part| match &node.value {
            Value::Table(inner) => inner.get(part),
            Value::List(items) => items.get(part.parse::<usize>().ok()?),
            _ => None,
        })
    }

    pub(super) fn explain(&self, error: &Error) -> SceneError {
        match error {
            Error::Invalid {
                key,
                value,
                accepted,
            } => {
                let message = format!("{key} = {value} is not accepted");
                let at = self.find(key).map(Node::place);
                let help = format!("accepted: {accepted}");
                self.wrong(&message, "here", Some(&help), at)
                    .about(key, Some(value.clone()))
            }
            Error::Limit { key, limit, .. } => self
                .wrong(
                    &error.to_string(),
                    "this limit",
                    None,
                    self.at(key).map(Node::place),
                )
                .about(*key, Some(limit.clone())),
            other => self.wrong(&other.to_string(), "", None, None),
        }
    }
}

impl Node {
    /// What a message points at: of a table its key.
    fn place(&self) -> &Place {
        match self.value {
            Value::Table(_) => &self.key,
            _ => &self.at,
        }
    }
}

/// Give every node of a bare-word override the places of the text as typed.
fn replace_places(table: &mut BTreeMap<String, Node>, all: &Place, value: Range<usize>) {
    for node in table.values_mut() {
        node.key = all.clone();
        node.at = Place {
            source: all.source,
            span: value.clone(),
        };
        if let Value::Table(inner) = &mut node.value {
            replace_places(inner, all, value.clone());
        }
    }
}

/// Puts `new` into `old`; what stands at `depth` keys down replaces what was there, tables included.
fn merge(old: &mut BTreeMap<String, Node>, new: BTreeMap<String, Node>, depth: usize) {
    for (key, node) in new {
        match (old.get_mut(&key).map(|it| &mut it.value), node.value) {
            (Some(Value::Table(old)), Value::Table(new)) if depth > 1 => {
                merge(old, new, depth - 1);
            }
            (_, value) => {
                old.insert(key, Node { value, ..node });
            }
        }
    }
}

/// The items of a list written in TOML; None for anything else.
#[cfg(feature = "cli")]
pub(crate) fn items(text: &str) -> Option<Vec<serde_json::Value>> {
    let text = format!("it = {text}");
    let table = entries(DeTable::parse(&text).ok()?.get_ref(), 0);
    match (table.len(), table.get("it").map(|it| &it.value)) {
        (1, Some(Value::List(items))) => Some(items.iter().map(|it| it.value.plain()).collect()),
        _ => None,
    }
}

/// What may be meant on the line of a place that is not TOML: a decimal comma, a unit.
fn hint(text: &str, at: usize) -> Option<&'static str> {
    let from = text.get(..at)?.rfind('\n').map_or(0, |k| k + 1);
    let line = text[from..].lines().next()?;
    let value = line.split_once('=')?.1.trim_start();
    let end = value.find(|c: char| !c.is_ascii_digit() && !"+-.".contains(c))?;
    let (number, rest) = value.split_at(end);
    number.parse::<f64>().ok()?;
    let mut next = rest.trim_start().chars();
    match next.next()? {
        ',' if next.next()?.is_ascii_digit() => Some("a decimal point, as 0.8"),
        '%' => Some("a ratio: 0.8 % is 0.008"),
        c if c.is_alphabetic() => Some("a number alone, in the unit of its key"),
        _ => None,
    }
}
