//! An ordered JSON value: keys stay in the order they were put in, and a number that does not exist is
//! null, never NaN.

use crate::estimate::Estimate;
use std::fmt::{self, Write};

/// A JSON value.
#[derive(Debug, Clone, PartialEq)]
pub enum Json {
    /// A number or text that does not exist.
    Null,
    /// true or false.
    Bool(bool),
    /// A double; prints null unless finite.
    Number(f64),
    /// A whole number.
    Whole(u64),
    /// Text.
    Text(String),
    /// A list.
    List(Vec<Json>),
    /// Keys and values in their order.
    Object(Vec<(String, Json)>),
}

impl Json {
    /// An object from pairs.
    pub fn object<K: Into<String>>(pairs: impl IntoIterator<Item = (K, Json)>) -> Self {
        Self::Object(pairs.into_iter().map(|(k, v)| (k.into(), v)).collect())
    }

    /// A list of numbers.
    pub fn numbers(numbers: impl IntoIterator<Item = f64>) -> Self {
        Self::List(numbers.into_iter().map(Self::Number).collect())
    }

    /// The value under `key`, if this is an object that has it.
    pub fn get(&self, key: &str) -> Option<&Self> {
        match self {
            Self::Object(pairs) => pairs.iter().find(|(k, _)| k == key).map(|(_, v)| v),
            _ => None,
        }
    }

    /// Put `value` under `key` at the end of an object; anything else is left alone.
    pub fn push(&mut self, key: impl Into<String>, value: impl Into<Self>) {
        if let Self::Object(pairs) = self {
            pairs.push((key.into(), value.into()));
        }
    }

    fn is_flat(&self) -> bool {
        match self {
            Self::List(items) => items
                .iter()
                .all(|item| !matches!(item, Self::List(_) | Self::Object(_))),
            Self::Object(pairs) => {
                pairs.len() <= 4
                    && pairs
                        .iter()
                        .all(|(_, v)| !matches!(v, Self::List(_) | Self::Object(_)))
            }
            _ => true,
        }
    }

    fn write(&self, f: &mut impl Write, indent: usize) -> fmt::Result {
        let (open, close, empty) = match self {
            Self::List(items) => ('[', ']', items.is_empty()),
            Self::Object(pairs) => ('{', '}', pairs.is_empty()),
            scalar => return scalar.write_scalar(f),
        };
        f.write_char(open)?;
        let flat = self.is_flat();
        let separate = |f: &mut _, first: bool| -> fmt::Result {
            let f: &mut dyn Write = f;
            match (first, flat) {
                (true, true) => Ok(()),
                (false, true) => f.write_str(", "),
                _ => {
                    f.write_str(if first { "\n" } else { ",\n" })?;
                    (0..=indent).try_for_each(|_| f.write_str("  "))
                }
            }
        };
        match self {
            Self::List(items) => {
                for (k, item) in items.iter().enumerate() {
                    separate(f, k == 0)?;
                    item.write(f, indent + 1)?;
                }
            }
            Self::Object(pairs) => {
                for (k, (key, value)) in pairs.iter().enumerate() {
                    separate(f, k == 0)?;
                    write_text(f, key)?;
                    f.write_str(": ")?;
                    value.write(f, indent + 1)?;
                }
            }
            _ => {}
        }
        if !flat && !empty {
            f.write_char('\n')?;
            (0..indent).try_for_each(|_| f.write_str("  "))?;
        }
        f.write_char(close)
    }

    fn write_scalar(&self, f: &mut impl Write) -> fmt::Result {
        match self {
            Self::Bool(b) => write!(f, "{b}"),
            Self::Number(x) if x.is_finite() => write!(f, "{x:?}"),
            Self::Whole(n) => write!(f, "{n}"),
            Self::Text(text) => write_text(f, text),
            _ => f.write_str("null"),
        }
    }
}

fn write_text(f: &mut impl Write, text: &str) -> fmt::Result {
    f.write_char('"')?;
    for c in text.chars() {
        match c {
            '"' | '\\' => write!(f, "\\{c}")?,
            c if u32::from(c) < 0x20 || c == '\u{7f}' => write!(f, "\\u{:04x}", u32::from(c))?,
            c => f.write_char(c)?,
        }
    }
    f.write_char('"')
}

/// Indented text; flat lists and small flat objects stay on one line.
impl fmt::Display for Json {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write(f, 0)
    }
}

impl From<f64> for Json {
    fn from(x: f64) -> Self {
        Self::Number(x)
    }
}

impl From<u64> for Json {
    fn from(n: u64) -> Self {
        Self::Whole(n)
    }
}

impl From<usize> for Json {
    fn from(n: usize) -> Self {
        Self::Whole(n as u64)
    }
}

impl From<bool> for Json {
    fn from(b: bool) -> Self {
        Self::Bool(b)
    }
}

impl From<&str> for Json {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Json {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

/// `{"value": x, "error": e}`; null for a number that does not exist.
impl From<Estimate> for Json {
    fn from(it: Estimate) -> Self {
        if it.value.is_finite() {
            Self::object([
                ("value", Self::Number(it.value)),
                ("error", Self::Number(it.error)),
            ])
        } else {
            Self::Null
        }
    }
}

impl<T: Into<Self>> From<Option<T>> for Json {
    fn from(it: Option<T>) -> Self {
        it.map_or(Self::Null, Into::into)
    }
}

impl<T: Into<Self>> From<Vec<T>> for Json {
    fn from(items: Vec<T>) -> Self {
        Self::List(items.into_iter().map(Into::into).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Origin;

    #[test]
    fn what_is_printed_is_json_and_keeps_order_digits_and_escapes() {
        let nan = Estimate::new(f64::NAN, 0.0, Origin::Space);
        let json = Json::object([
            ("zeta", Json::from(0.1)),
            ("a \"b\"\n", Json::from("line\u{1}\\ µ")),
            ("list", Json::numbers([1e300, -2.5e-310, f64::INFINITY])),
            ("none", Json::from(nan)),
            ("some", Json::from(Estimate::new(0.3, 1e-9, Origin::Space))),
            ("empty", Json::List(vec![])),
            ("nested", Json::from(vec![vec![1u64, 2], vec![]])),
        ]);
        let back: serde_json::Value = serde_json::from_str(&json.to_string()).unwrap();
        assert_eq!(back["a \"b\"\n"], "line\u{1}\\ µ");
        assert_eq!(back["list"][0], 1e300);
        assert_eq!(back["list"][1], -2.5e-310);
        assert!(back["list"][2].is_null() && back["none"].is_null());
        assert_eq!(back["some"]["error"], 1e-9);
        assert_eq!(back["nested"][0][1], 2);
        assert!(json.to_string().find("zeta") < json.to_string().find("list"));
        assert_eq!(json.get("zeta"), Some(&Json::Number(0.1)));
    }
}
