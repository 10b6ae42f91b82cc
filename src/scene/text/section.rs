//! One table of a scene: its keys as values of the kind wanted.

use super::document::{Document, Node, Read, Value};
use super::error::SceneError;
use crate::contact::Parameter;
use crate::fokker_planck::Drift;
use crate::moments::Moment;
use crate::scene::Times;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// One table of the scene, or its absence.
pub(super) struct Section<'a> {
    pub(super) document: &'a Document,
    pub(super) path: String,
    pub(super) table: Option<&'a BTreeMap<String, Node>>,
}

impl<'a> Section<'a> {
    pub(super) fn full(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    pub(super) fn get(&self, key: &str) -> Option<&'a Node> {
        self.table?.get(key)
    }

    pub(super) fn value(&self, key: &str) -> Option<&'a Value> {
        Some(&self.get(key)?.value)
    }

    pub(super) fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    pub(super) fn section(&self, key: &str) -> Read<Self> {
        let table = match self.value(key) {
            None => None,
            Some(Value::Table(table)) => Some(table),
            Some(_) => {
                let accepted = if self.path.is_empty() {
                    format!("a table, as [{key}]")
                } else {
                    "a table, as { key = value }".into()
                };
                return Err(self.type_error(key, &accepted));
            }
        };
        Ok(Self {
            document: self.document,
            path: self.full(key),
            table,
        })
    }

    /// A table that may be absent, with no keys but these.
    pub(super) fn optional(&self, key: &str, keys: &[&str]) -> Read<Option<Self>> {
        let section = self.section(key)?;
        section.known(keys)?;
        Ok(section.table.is_some().then_some(section))
    }

    /// Refuse keys that are not in the list.
    pub(super) fn known(&self, keys: &[&str]) -> Read<()> {
        for (key, node) in self.table.into_iter().flatten() {
            if keys.contains(&key.as_str()) {
                continue;
            }
            let shown: String = key.chars().take(60).collect();
            let shown = shown.escape_debug();
            let message = format!("{} is not a key of a scene", self.full(&shown.to_string()));
            let near = nearest(key, keys).map(|near| format!("did you mean {near}?"));
            let label = near.unwrap_or("unknown key".into());
            let place = if self.path.is_empty() {
                "at the top".into()
            } else {
                format!("in [{}]", self.path)
            };
            let help = format!("accepted {place}: {}", keys.join(", "));
            return Err(self
                .document
                .wrong(&message, &label, Some(&help), Some(&node.key))
                .about(self.full(key), Some(node.value.shown())));
        }
        Ok(())
    }

    pub(super) fn refuse(&self, key: &str, message: &str, help: &str) -> SceneError {
        let node = self.get(key);
        let (document, at) = (self.document, node.map(|it| &it.at));
        let wrong = document.wrong(message, "here", Some(help), at);
        wrong.about(self.full(key), node.map(|it| it.value.shown()))
    }

    pub(super) fn type_error_at(&self, node: &Node, key: &str, accepted: &str) -> SceneError {
        let key = self.full(key);
        let message = match &node.value {
            Value::List(items) => format!("{key} is a list of {}", items.len()),
            Value::Table(_) => format!("{key} is {}", node.value.kind()),
            value => format!("{key} = {} is not accepted", value.shown()),
        };
        let help = format!("accepted: {accepted}");
        self.document
            .wrong(&message, "here", Some(&help), Some(&node.at))
            .about(key, Some(node.value.shown()))
    }

    pub(super) fn type_error(&self, key: &str, accepted: &str) -> SceneError {
        match self.get(key) {
            Some(node) => self.type_error_at(node, key, accepted),
            None => self.refuse(key, &format!("{} is missing", self.full(key)), accepted),
        }
    }

    pub(super) fn required<T>(&self, value: Option<T>, key: &str, what: &str) -> Read<T> {
        value.ok_or_else(|| {
            let message = format!("{} is missing", self.full(key));
            let help = format!("accepted: {what}");
            let at = self.document.find(&self.path).map(|node| &node.key);
            self.document
                .wrong(&message, "in this table", Some(&help), at)
                .about(self.full(key), None)
        })
    }

    pub(super) fn text(&self, key: &str) -> Read<Option<&'a str>> {
        match self.value(key) {
            None => Ok(None),
            Some(Value::Text(text)) => Ok(Some(text)),
            Some(_) => Err(self.type_error(key, "text in quotes")),
        }
    }

    pub(super) fn flag(&self, key: &str) -> Read<Option<bool>> {
        match self.value(key) {
            None => Ok(None),
            Some(Value::Flag(flag)) => Ok(Some(*flag)),
            Some(_) => Err(self.type_error(key, "true or false")),
        }
    }

    pub(super) fn number_of(&self, node: &Node, key: &str) -> Read<f64> {
        match node.value {
            Value::Whole(n) => Ok(n as f64),
            Value::Number(x) => Ok(x),
            _ => Err(self.type_error_at(node, key, "a number")),
        }
    }

    pub(super) fn number(&self, key: &str) -> Read<Option<f64>> {
        let number = self.get(key).map(|node| self.number_of(node, key));
        number.transpose()
    }

    pub(super) fn whole_of(&self, node: &Node, key: &str, range: RangeInclusive<u64>) -> Read<u64> {
        let whole = match node.value {
            Value::Whole(n) => u64::try_from(n).ok(),
            // 1e5 is a float in TOML and a whole number to everybody else.
            Value::Number(x) if x.fract() == 0.0 && (0.0..9e15).contains(&x) => Some(x as u64),
            _ => None,
        };
        whole.filter(|n| range.contains(n)).ok_or_else(|| {
            let (first, last) = (range.start(), *range.end());
            let accepted = match last {
                u64::MAX => format!("a whole number >= {first}"),
                1_000_000.. => format!("a whole number from {first} to {:e}", last as f64),
                _ => format!("a whole number from {first} to {last}"),
            };
            self.type_error_at(node, key, &accepted)
        })
    }

    pub(super) fn whole(&self, key: &str, range: RangeInclusive<u64>) -> Read<Option<u64>> {
        let whole = self.get(key).map(|node| self.whole_of(node, key, range));
        whole.transpose()
    }

    pub(super) fn pair(&self, key: &str) -> Read<Option<[f64; 2]>> {
        match self.value(key) {
            None => Ok(None),
            Some(Value::List(items)) if items.len() == 2 => {
                let number = |k: usize| self.number_of(&items[k], &format!("{key}[{k}]"));
                Ok(Some([number(0)?, number(1)?]))
            }
            Some(_) => Err(self.type_error(key, "two numbers, of q and of v, as [0.0, 0.3]")),
        }
    }

    fn list(&self, items: &[Node], key: &str) -> Read<Vec<f64>> {
        let number = |(k, item)| self.number_of(item, &format!("{key}[{k}]"));
        items.iter().enumerate().map(number).collect()
    }

    pub(super) fn numbers(&self, key: &str) -> Read<Option<Vec<f64>>> {
        match self.value(key) {
            None => Ok(None),
            Some(Value::List(items)) => self.list(items, key).map(Some),
            Some(_) => Err(self.type_error(key, "a list of numbers, as [0, 50, 100]")),
        }
    }

    pub(super) fn times(&self, key: &str) -> Read<Times> {
        match self.value(key) {
            None => Ok(Times::none()),
            Some(Value::List(items)) => self.list(items, key).map(Times::List),
            Some(Value::Table(_)) => {
                let inner = self.section(key)?;
                inner.known(&["every", "until"])?;
                let time = "a time > 0, as { every = 0.5, until = 50 }";
                Ok(Times::Every {
                    every: inner.required(inner.number("every")?, "every", time)?,
                    until: inner.required(inner.number("until")?, "until", time)?,
                })
            }
            Some(_) => {
                let accepted = "a list of times, as [5, 10, 20], or { every = 0.5, until = 50 }";
                Err(self.type_error(key, accepted))
            }
        }
    }

    /// A list of the names of moments.
    pub(super) fn moments(&self, key: &str) -> Read<Option<Vec<Moment>>> {
        let Some(node) = self.get(key) else {
            return Ok(None);
        };
        let names = Moment::ALL.map(Moment::name);
        let Value::List(items) = &node.value else {
            let accepted = format!("a list of names among {}", names.join(", "));
            return Err(self.type_error(key, &accepted));
        };
        let moment = |(k, item): (usize, &Node)| {
            let text = if let Value::Text(text) = &item.value {
                text
            } else {
                ""
            };
            Moment::named(text).ok_or_else(|| {
                let accepted = names.join(", ") + &guess(&item.value, &names);
                self.type_error_at(item, &format!("{key}[{k}]"), &accepted)
            })
        };
        let all: Read<Vec<Moment>> = items.iter().enumerate().map(moment).collect();
        all.map(Some)
    }

    /// A number, a list of numbers or text.
    pub(super) fn parameter(&self, key: &str, node: &Node) -> Read<Parameter> {
        match &node.value {
            Value::Text(text) => Ok(Parameter::Text(text.clone())),
            Value::List(items) => self.list(items, key).map(Parameter::Numbers),
            _ => self.number_of(node, key).map(Parameter::Number),
        }
    }

    /// One of `names`.
    pub(super) fn choice<T: Clone>(&self, key: &str, names: &[(&str, T)]) -> Read<Option<T>> {
        self.choice_or(key, names, "")
    }

    /// One of `names`; a message also says what `other` is accepted.
    pub(super) fn choice_or<T: Clone>(
        &self,
        key: &str,
        names: &[(&str, T)],
        other: &str,
    ) -> Read<Option<T>> {
        let Some(node) = self.get(key) else {
            return Ok(None);
        };
        if let Value::Text(text) = &node.value
            && let Some((_, value)) = names.iter().find(|(name, _)| name == text)
        {
            return Ok(Some(value.clone()));
        }
        let names: Vec<&str> = names.iter().map(|(name, _)| *name).collect();
        let mut accepted: Vec<String> = names.iter().map(|name| format!("\"{name}\"")).collect();
        if !other.is_empty() {
            accepted.push(other.to_owned());
        }
        let accepted = accepted.join(", ") + &guess(&node.value, &names);
        Err(self.type_error(key, &accepted))
    }

    /// One of `names` or "auto".
    pub(super) fn auto<T: Clone>(&self, key: &str, names: &[(&str, T)]) -> Read<Option<T>> {
        let mut all = vec![("auto", None)];
        let named = names.iter();
        all.extend(named.map(|(name, value)| (*name, Some(value.clone()))));
        Ok(self.choice(key, &all)?.flatten())
    }

    pub(super) fn drift(&self) -> Read<Option<Drift>> {
        let central = |n: i128| Drift::ALL[1..].iter().find(|it| it.order() as i128 == n);
        match self.value("drift") {
            None => return Ok(None),
            Some(Value::Text(text)) if text == "auto" => return Ok(None),
            Some(Value::Text(text)) if text == "upwind" => Some(Drift::Upwind),
            Some(Value::Whole(n)) => central(*n).copied(),
            Some(_) => None,
        }
        .map(Some)
        .ok_or_else(|| self.type_error("drift", "\"auto\", \"upwind\", 2, 4, 6 or 8"))
    }

    /// A size: a number of bytes, or text such as "8 GB".
    pub(super) fn bytes(&self, key: &str) -> Read<Option<u64>> {
        let accepted = "a size as \"8 GB\", \"512 MiB\", or a number of bytes";
        match self.value(key) {
            None => Ok(None),
            Some(Value::Text(text)) => match parse_bytes(text) {
                Some(bytes) => Ok(Some(bytes)),
                None => Err(self.type_error(key, accepted)),
            },
            Some(Value::Whole(_) | Value::Number(_)) => {
                let bytes = self.whole(key, 1..=u64::MAX);
                bytes.map_err(|_| self.type_error(key, accepted))
            }
            Some(_) => Err(self.type_error(key, accepted)),
        }
    }
}

/// The nearest of `names` to a text that is none of them, as the end of what is accepted.
fn guess(given: &Value, names: &[&str]) -> String {
    let near = match given {
        Value::Text(text) => nearest(text, names),
        _ => None,
    };
    near.map_or(String::new(), |near| format!("; did you mean \"{near}\"?"))
}

/// "8 GB", "512MiB", "1e9": at least one byte, at most 2^63.
fn parse_bytes(text: &str) -> Option<u64> {
    let text = text.trim();
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let digits = digits.trim_end();
    let unit = match text[digits.len()..].trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "kb" => 1e3,
        "mb" => 1e6,
        "gb" => 1e9,
        "tb" => 1e12,
        "kib" => 1024.0,
        "mib" => 1024.0 * 1024.0,
        "gib" => 1024.0 * 1024.0 * 1024.0,
        "tib" => 1024.0 * 1024.0 * 1024.0 * 1024.0,
        _ => return None,
    };
    let bytes = digits.parse::<f64>().ok()? * unit;
    (1.0..=9.2e18).contains(&bytes).then_some(bytes as u64)
}

/// The one of `names` that is most likely meant, if any is likely.
pub(crate) fn nearest<'a>(text: &str, names: &[&'a str]) -> Option<&'a str> {
    let close = |name: &&str| strsim::jaro_winkler(&text.to_lowercase(), name);
    let nearest = names.iter().copied();
    let nearest = nearest.max_by(|a, b| close(a).total_cmp(&close(b)));
    nearest.filter(|name| close(name) > 0.75)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_may_be_written_as_people_write_it() {
        assert_eq!(parse_bytes("8 GB"), Some(8_000_000_000));
        assert_eq!(parse_bytes("512MiB"), Some(512 << 20));
        assert_eq!(parse_bytes(" 1.5 kb "), Some(1500));
        assert_eq!(parse_bytes("1024"), Some(1024));
        for wrong in ["", "GB", "-1 GB", "8 XB", "nan", "inf GB", "1e30 TB", "µ"] {
            assert_eq!(parse_bytes(wrong), None, "{wrong}");
        }
    }
}
