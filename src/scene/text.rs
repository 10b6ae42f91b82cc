//! Scenes from TOML, with messages that show the line.

use super::{
    Accuracy, DAMPINGS, DRIFT, MethodChoice, MonteCarlo, Noise, Outputs, PassageRequest, Quantity,
    ReachRequest, ResponseRequest, SCHEMES, Scene, Side, SpectrumRequest, TIME, TRANSIENT, Times,
};
use crate::clock::TIME_UNITS;
use crate::contact::{ContactLaw, LAWS, Parameter, Parameters};
use crate::error::{Error, positive};
use crate::excitation::{Drive, Envelope, Excitation};
use crate::fokker_planck::Drift;
use crate::format::num;
use crate::initial::Initial;
use crate::moments::Moment;
use crate::monte_carlo::MOST_COSINES;
use crate::oscillator::Oscillator;
use crate::rig::Rig;
use std::collections::BTreeMap;
use std::fmt::{self, Write};
use std::ops::Range;
use std::path::Path;
use toml::de::{DeTable, DeValue};

/// The built-in scenes: name, and text as `vibroimpact scenes NAME` prints it. The first is the one
/// `vibroimpact` alone runs.
pub const BUILT_IN: &[(&str, &str)] = &[
    ("default", include_str!("../scenes/default.toml")),
    ("paper-level", include_str!("../scenes/paper-level.toml")),
    ("bilinear", include_str!("../scenes/bilinear.toml")),
    ("displaced", include_str!("../scenes/displaced.toml")),
    ("dropped", include_str!("../scenes/dropped.toml")),
    ("free-fall", include_str!("../scenes/free-fall.toml")),
    ("overdamped", include_str!("../scenes/overdamped.toml")),
    ("rare-loss", include_str!("../scenes/rare-loss.toml")),
    ("first-loss", include_str!("../scenes/first-loss.toml")),
    ("extreme", include_str!("../scenes/extreme.toml")),
    ("stationary", include_str!("../scenes/stationary.toml")),
    ("spectrum", include_str!("../scenes/spectrum.toml")),
    ("records", include_str!("../scenes/records.toml")),
    ("table-3", include_str!("../scenes/table-3.toml")),
    ("driven", include_str!("../scenes/driven.toml")),
];

/// The text of a built-in scene.
pub(crate) fn built_in(name: &str) -> Option<&'static str> {
    BUILT_IN
        .iter()
        .find(|(it, _)| *it == name)
        .map(|(_, text)| *text)
}

/// A scene together with the text it came from, so that whatever is found wrong with it later can still
/// be shown in its line.
///
/// ```
/// use vibroimpact::scene::text::SceneText;
/// let it = SceneText::parse("a.toml", "[oscillator]\nzeta = 0.005\nh = 2e-3", &[]).unwrap();
/// assert_eq!(it.scene().oscillator.h(), 2e-3);
/// let wrong = SceneText::parse("a.toml", "[oscillator]\nzeta = 0.005\nhh = 2e-3", &[]);
/// assert!(wrong.unwrap_err().to_string().contains("oscillator.hh"));
/// ```
#[derive(Debug, Clone)]
pub struct SceneText {
    scene: Scene,
    document: Document,
}

impl SceneText {
    /// A scene from TOML `text`, which `name` stands for in messages, and overrides `KEY=VALUE` on top
    /// of it: dotted keys, TOML values, and bare words as text.
    ///
    /// # Errors
    /// [`SceneError`] for text that is not TOML, an unknown key, a value of the wrong type or out of its
    /// range, or a key that this version cannot compute.
    pub fn parse(name: &str, text: &str, overrides: &[String]) -> Result<Self, SceneError> {
        Draft::parse(name, text, overrides)?.with("--set", &[])
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Show `error` in the line of the scene that caused it, where it names one.
    pub fn explain(&self, error: &Error) -> SceneError {
        self.document.explain(error)
    }
}

/// A scene's text before its values are read: a scene of every point of a map, and the text is parsed once.
#[derive(Debug, Clone)]
pub(crate) struct Draft(Document);

impl Draft {
    /// TOML `text` with overrides `KEY=VALUE` on top of it.
    ///
    /// # Errors
    /// [`SceneError`] for text that is not TOML.
    pub(crate) fn parse(name: &str, text: &str, overrides: &[String]) -> Result<Self, SceneError> {
        let mut document = Document::parse(name, text)?;
        for text in overrides {
            document.set("--set", text)?;
        }
        Ok(Self(document))
    }

    /// The scene with more overrides, which `option` of the command line gave.
    ///
    /// # Errors
    /// Those of [`SceneText::parse`].
    pub(crate) fn with(&self, option: &str, overrides: &[String]) -> Result<SceneText, SceneError> {
        let mut document = self.0.clone();
        for text in overrides {
            document.set(option, text)?;
        }
        let scene = document.scene()?;
        let it = SceneText { scene, document };
        it.scene.check().map_err(|error| it.explain(&error))?;
        Ok(it)
    }
}

/// The items of a list written in TOML; None for anything else.
pub(crate) fn items(text: &str) -> Option<Vec<serde_json::Value>> {
    let text = format!("it = {text}");
    let table = entries(DeTable::parse(&text).ok()?.get_ref(), 0);
    match (table.len(), table.get("it").map(|it| &it.value)) {
        (1, Some(Value::List(items))) => Some(items.iter().map(|it| it.value.plain()).collect()),
        _ => None,
    }
}

/// What is wrong with a scene, and where: a [`miette::Diagnostic`] with the line and what is accepted.
#[derive(Debug)]
pub struct SceneError(Box<Wrong>);

#[derive(Debug)]
struct Wrong {
    message: String,
    label: String,
    help: Option<String>,
    source: miette::NamedSource<String>,
    span: Option<Range<usize>>,
    /// The key and the value that the message is about.
    key: Option<String>,
    value: Option<String>,
}

impl SceneError {
    /// The same, about a key and what stands under it.
    fn about(mut self, key: impl Into<String>, value: Option<String>) -> Self {
        self.0.key = Some(key.into());
        self.0.value = value;
        self
    }

    /// The key of the scene that is wrong; None where no single one is.
    pub fn key(&self) -> Option<&str> {
        self.0.key.as_deref()
    }

    /// Its value; None where it is missing.
    pub fn value(&self) -> Option<&str> {
        self.0.value.as_deref()
    }

    /// What would have been accepted.
    pub fn accepted(&self) -> Option<&str> {
        let help = self.0.help.as_deref()?;
        let after = help
            .strip_prefix("accepted")
            .and_then(|it| it.split_once(": "));
        Some(after.map_or(help, |(_, accepted)| accepted))
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.message)
    }
}

impl std::error::Error for SceneError {}

impl miette::Diagnostic for SceneError {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        let help = self.0.help.as_ref()?;
        Some(Box::new(help))
    }

    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        self.0
            .span
            .as_ref()
            .map(|_| &self.0.source as &dyn miette::SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = miette::LabeledSpan> + '_>> {
        let span = self.0.span.clone()?;
        let label = miette::LabeledSpan::new_with_span(Some(self.0.label.clone()), span);
        Some(Box::new(std::iter::once(label)))
    }
}

/// Bytes of one of the sources.
#[derive(Debug, Clone)]
struct Place {
    source: usize,
    span: Range<usize>,
}

#[derive(Debug, Clone)]
struct Node {
    value: Value,
    /// Where the key stands, and where its value.
    key: Place,
    at: Place,
}

#[derive(Debug, Clone)]
enum Value {
    Table(BTreeMap<String, Node>),
    List(Vec<Node>),
    Text(String),
    Whole(i128),
    Number(f64),
    Flag(bool),
    Date(String),
}

impl Value {
    fn kind(&self) -> &'static str {
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
    fn plain(&self) -> serde_json::Value {
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
    fn shown(&self) -> String {
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
struct Document {
    /// Name and text: the file, then each override.
    sources: Vec<(String, String)>,
    root: BTreeMap<String, Node>,
}

type Read<T> = Result<T, SceneError>;

impl Document {
    fn parse(name: &str, text: &str) -> Read<Self> {
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
                Err(self.wrong("the scene is not TOML", first, None, Some(&at)))
            }
        }
    }

    /// Put an override `KEY=VALUE` of an option of the command line on top.
    fn set(&mut self, option: &str, text: &str) -> Read<()> {
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

    fn wrong(
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
    fn find(&self, key: &str) -> Option<&Node> {
        let mut found = None;
        let mut table = Some(&self.root);
        for part in key.split('.') {
            let (name, item) = match part.split_once('[') {
                Some((name, item)) => (name, item.trim_end_matches(']').parse().ok()),
                None => (part, None::<usize>),
            };
            let Some(node) = table.and_then(|table| table.get(name)) else {
                break;
            };
            found = Some(node);
            table = match &node.value {
                Value::Table(inner) => Some(inner),
                _ => None,
            };
            if let (Some(k), Value::List(items)) = (item, &node.value) {
                found = items.get(k).or(found);
            }
        }
        found
    }

    /// The node of exactly this dotted key; None where it is absent.
    fn at(&self, key: &str) -> Option<&Node> {
        let mut parts = key.split(['.', '[']).map(|it| it.trim_end_matches(']'));
        let first = self.root.get(parts.next()?)?;
        parts.try_fold(first, |node, part| match &node.value {
            Value::Table(inner) => inner.get(part),
            Value::List(items) => items.get(part.parse::<usize>().ok()?),
            _ => None,
        })
    }

    fn explain(&self, error: &Error) -> SceneError {
        let place = |key: &str| {
            let node = self.find(key)?;
            let whole = matches!(node.value, Value::Table(_));
            Some(if whole { &node.key } else { &node.at })
        };
        match error {
            Error::Invalid {
                key,
                value,
                accepted,
            } => {
                let message = format!("{key} = {value} is not accepted");
                let at = place(key);
                let help = format!("accepted: {accepted}");
                self.wrong(&message, "here", Some(&help), at)
                    .about(key, Some(value.clone()))
            }
            Error::NotAvailable {
                key,
                version,
                instead,
            } => {
                let message = format!("{key} is not available yet in version {version}");
                let value = self.find(key).map(|node| node.value.shown());
                self.wrong(&message, "not available yet", Some(instead), place(key))
                    .about(key, value)
            }
            Error::Limit { key, limit, .. } => self
                .wrong(&error.to_string(), "this limit", None, place(key))
                .about(*key, Some(limit.clone())),
            other => self.wrong(&other.to_string(), "", None, None),
        }
    }

    fn scene(&self) -> Read<Scene> {
        let root = Section {
            document: self,
            path: String::new(),
            table: Some(&self.root),
        };
        root.known(&[
            "title",
            "oscillator",
            "rig",
            "excitation",
            "initial",
            "outputs",
            "monte_carlo",
            "accuracy",
            "method",
        ])?;
        let rig = self.rig(&root)?;
        let mut scene = Scene::new(self.oscillator(&root, rig.as_ref())?);
        // Without a title the file's name stands in.
        let stem = Path::new(&self.sources[0].0).file_stem();
        let stem = stem.map(|it| it.to_string_lossy().replace(char::is_control, ""));
        scene.title = match root.text("title")? {
            Some(title) => title.to_owned(),
            None => stem.unwrap_or_default().chars().take(100).collect(),
        };
        scene.rig = rig;
        scene.force_psd = root.section("oscillator")?.number("force_psd")?;
        scene.excitation = self.excitation(&root)?;
        scene.initial = Self::initial(&root)?;
        if let Some(outputs) = Self::outputs(&root)? {
            scene.outputs = outputs;
        }
        scene.monte_carlo = Self::monte_carlo(&root)?;
        let confines = scene.oscillator.contact().is_confining();
        let (records, clock) = (scene.wants_records() && confines, scene.clock());
        if let Some(it) = scene.monte_carlo.as_mut().filter(|_| records) {
            let duration = clock.time(MonteCarlo::DURATION);
            it.duration.get_or_insert(duration);
        }
        if !root.has("outputs") && scene.outputs.stationary && !confines {
            let at = self.find("oscillator.contact").map(|node| &node.at);
            let message =
                "a scene without [outputs] asks for the stationary law, and this has none";
            let help = "accepted: [outputs] with moments_at or density_at";
            let wrong = self.wrong(message, "never confines the motion", Some(help), at);
            let law = self.find("oscillator.contact").map(|it| it.value.shown());
            return Err(wrong.about("oscillator.contact", law));
        }
        scene.accuracy = Self::accuracy(&root)?;
        scene.method = Self::method(&root)?;
        Ok(scene)
    }

    fn rig(&self, root: &Section<'_>) -> Read<Option<Rig>> {
        let rig = root.section("rig")?;
        rig.known(&["static_load", "frequency", "static_compression"])?;
        if rig.table.is_none() {
            return Ok(None);
        }
        let it = Rig::new(
            rig.required(
                rig.number("static_load")?,
                "static_load",
                "a load > 0 in newtons, as 110",
            )?,
            rig.required(
                rig.number("frequency")?,
                "frequency",
                "a frequency > 0 in hertz, as 232",
            )?,
            rig.required(
                rig.number("static_compression")?,
                "static_compression",
                "a compression > 0 in metres, as 7e-6",
            )?,
        );
        it.map(Some).map_err(|error| self.explain(&error))
    }

    fn oscillator(&self, root: &Section<'_>, rig: Option<&Rig>) -> Read<Oscillator> {
        let section = root.section("oscillator")?;
        section.known(&["contact", "damping", "zeta", "h", "force_psd"])?;
        if section.table.is_none() {
            let help = "accepted: [oscillator] with zeta and h, as zeta = 0.005 and h = 2e-3";
            let wrong = self.wrong("[oscillator] is missing", "", Some(help), None);
            return Err(wrong.about("oscillator", None));
        }
        let contact = self.contact(&section)?;
        let zeta = section.number("zeta")?;
        let zeta = section.required(zeta, "zeta", "a damping ratio > 0, as 0.005")?;
        let (h, psd) = (section.number("h")?, section.number("force_psd")?);
        let h = match (h, psd, rig) {
            (Some(_), Some(_), _) => {
                return Err(section.refuse(
                    "force_psd",
                    "both oscillator.h and oscillator.force_psd are given",
                    "accepted: one of them",
                ));
            }
            (Some(h), None, _) => h,
            (None, Some(psd), Some(rig)) => {
                let psd = positive("oscillator.force_psd", psd);
                rig.level_from_force_psd(psd.map_err(|error| self.explain(&error))?)
            }
            (None, Some(_), None) => {
                return Err(section.refuse(
                    "force_psd",
                    "oscillator.force_psd is in N^2/Hz and needs a [rig]",
                    "accepted: h, or force_psd with [rig] static_load, frequency and \
                     static_compression",
                ));
            }
            (None, None, _) => section.required(None, "h", "an input level > 0, as 2e-3")?,
        };
        let damping = section.choice("damping", DAMPINGS)?.unwrap_or_default();
        Oscillator::new(contact, zeta, h)
            .and_then(|it| it.with_damping(damping))
            .map_err(|error| self.explain(&error))
    }

    fn excitation(&self, root: &Section<'_>) -> Read<Excitation> {
        let section = root.section("excitation")?;
        section.known(&["drive", "envelope"])?;
        let mut it = Excitation::default();
        let drive = section.section("drive")?;
        drive.known(&["amplitude", "frequency", "phase"])?;
        if drive.table.is_some() {
            let number = |key: &str, what: &str| drive.required(drive.number(key)?, key, what);
            let read = Drive::new(
                number("amplitude", "an amplitude >= 0 in static loads, as 0.02")?,
                number("frequency", "a circular frequency, as 0.95")?,
                drive.number("phase")?.unwrap_or(0.0),
            );
            it.drive = Some(read.map_err(|error| self.explain(&error))?);
        }
        let envelope = section.section("envelope")?;
        envelope.known(&["times", "factors"])?;
        if envelope.table.is_some() {
            let list = |key: &str, what: &str| envelope.required(envelope.numbers(key)?, key, what);
            let read = Envelope::new(
                list("times", "ascending times, as [0, 50, 100]")?,
                list("factors", "a factor on h for each time, as [0, 1, 1]")?,
            );
            it.envelope = Some(read.map_err(|error| self.explain(&error))?);
        }
        Ok(it)
    }

    /// A word, or a table with the name of a law and its keys.
    fn contact(&self, oscillator: &Section<'_>) -> Read<ContactLaw> {
        let words = ContactLaw::words().map(|word| (word, ContactLaw::named(word)));
        if !matches!(
            oscillator.get("contact").map(|it| &it.value),
            Some(Value::Table(_))
        ) {
            let named = oscillator.choice_or(
                "contact",
                &words,
                "a table as { law = \"power\", exponent = 1.2 }",
            )?;
            return Ok(named.flatten().unwrap_or(ContactLaw::Hertz));
        }
        let section = oscillator.section("contact")?;
        let laws: Vec<(&str, usize)> = LAWS.iter().map(|it| it.name).zip(0..).collect();
        let law = section.choice("law", &laws)?;
        let names: Vec<String> = LAWS.iter().map(|it| format!("\"{}\"", it.name)).collect();
        let kind = &LAWS[section.required(law, "law", &names.join(", "))?];
        section.known(&[&["law"], kind.keys].concat())?;
        let folder = Path::new(&self.sources[0].0).parent();
        let mut given = Parameters::new().from_folder(folder.unwrap_or(Path::new("")));
        for (key, node) in section
            .table
            .into_iter()
            .flatten()
            .filter(|(key, _)| *key != "law")
        {
            given = given.with(key, section.parameter(key, node)?);
        }
        ContactLaw::given(kind.name, &given).map_err(|error| match &error {
            Error::Invalid { key, accepted, .. } if self.at(key).is_none() => {
                let message = format!("{key} is missing");
                let help = format!("accepted: {accepted}");
                let at = self.find("oscillator.contact").map(|node| &node.key);
                self.wrong(&message, "in this table", Some(&help), at)
                    .about(key, None)
            }
            _ => self.explain(&error),
        })
    }

    fn initial(root: &Section<'_>) -> Read<Initial> {
        let section = root.section("initial")?;
        section.known(&["kind", "mean", "deviation"])?;
        let kinds = &[("gaussian", 0), ("rest", 1), ("stationary", 2)];
        let (mean, deviation) = (section.pair("mean")?, section.pair("deviation")?);
        let kind = section.choice("kind", kinds)?;
        // A mean or deviation without a kind can only mean a Gaussian.
        let implied = i32::from(mean.is_none() && deviation.is_none());
        match kind.unwrap_or(implied) {
            0 => Ok(Initial::Gaussian {
                mean: mean.unwrap_or([0.0; 2]),
                deviation: section.required(
                    deviation,
                    "deviation",
                    "two standard deviations > 0, of q and of v, as [0.3, 0.3]",
                )?,
            }),
            other => {
                for key in ["mean", "deviation"] {
                    if section.has(key) {
                        let message = format!("initial.{key} belongs to kind = \"gaussian\" only");
                        return Err(section.refuse(key, &message, "accepted: leave it out"));
                    }
                }
                Ok(if other == 1 {
                    Initial::Rest
                } else {
                    Initial::Stationary
                })
            }
        }
    }

    fn outputs(root: &Section<'_>) -> Read<Option<Outputs>> {
        let section = root.section("outputs")?;
        section.known(&[
            "stationary",
            "moments_at",
            "moments",
            "density_at",
            "steady",
            "decay_rates",
            "spectrum",
            "first_loss",
            "first_passage",
            "crossings",
            "reach",
            "time_unit",
            "periodic",
            "response",
        ])?;
        if section.table.is_none() {
            return Ok(None);
        }
        let mut it = Outputs {
            stationary: section.flag("stationary")?.unwrap_or(false),
            moments_at: section.times("moments_at")?,
            moments: section.moments("moments")?,
            density_at: section.times("density_at")?,
            steady: section.flag("steady")?.unwrap_or(false),
            decay_rates: section.whole("decay_rates", 100)?.unwrap_or(0) as usize,
            reach: Self::reach(&section)?,
            time_unit: section.choice("time_unit", TIME_UNITS)?,
            ..Outputs::nothing()
        };
        let spectrum = section.section("spectrum")?;
        spectrum.known(&["until", "quantity"])?;
        if spectrum.table.is_some() {
            let until = spectrum.number("until")?;
            let quantities = &[
                ("force", Quantity::Force),
                ("displacement", Quantity::Displacement),
            ];
            it.spectrum = Some(SpectrumRequest {
                until: spectrum.required(until, "until", "a circular frequency > 0")?,
                quantity: spectrum.choice("quantity", quantities)?.unwrap_or_default(),
            });
        }
        let passage = section.section("first_passage")?;
        passage.known(&["level", "side", "until"])?;
        if passage.table.is_some() {
            let (level, until) = (passage.number("level")?, passage.number("until")?);
            let sides = &[
                ("below", Side::Below),
                ("above", Side::Above),
                ("either", Side::Either),
            ];
            let side = passage.choice("side", sides)?;
            it.first_passage = Some(PassageRequest {
                level: passage.required(level, "level", "a displacement, as 3.0")?,
                side: passage.required(side, "side", "\"above\", \"below\" or \"either\"")?,
                until: passage.required(until, "until", "a time > 0")?,
            });
        }
        for (name, key, target) in [
            ("first_loss", "until", &mut it.first_loss),
            ("crossings", "window", &mut it.crossings),
        ] {
            let inner = section.section(name)?;
            inner.known(&[key])?;
            if inner.table.is_some() {
                *target = Some(inner.required(inner.number(key)?, key, "a time > 0")?);
            }
        }
        let periodic = section.section("periodic")?;
        periodic.known(&["phases"])?;
        if periodic.table.is_some() {
            let phases = periodic.whole("phases", u64::MAX)?;
            it.periodic = Some(phases.unwrap_or(PHASES) as usize);
        }
        let response = section.section("response")?;
        response.known(&["from", "to", "points"])?;
        if response.table.is_some() {
            let number = |key: &str| {
                response.required(response.number(key)?, key, "a circular frequency > 0")
            };
            let points = response.whole("points", u64::MAX)?;
            it.response = Some(ResponseRequest {
                from: number("from")?,
                to: number("to")?,
                points: response.required(points, "points", "how many frequencies, as 61")?
                    as usize,
            });
        }
        Ok(Some(it))
    }

    fn reach(outputs: &Section<'_>) -> Read<Option<ReachRequest>> {
        let section = outputs.section("reach")?;
        section.known(&["quantity", "fraction"])?;
        if section.table.is_none() {
            return Ok(None);
        }
        let moments = Moment::ALL.map(|it| (it.name(), it));
        let quantity = section.choice("quantity", &moments)?;
        let fraction = section.number("fraction")?;
        Ok(Some(ReachRequest {
            quantity: section.required(
                quantity,
                "quantity",
                "the name of a moment, as \"mean_energy\"",
            )?,
            fraction: section.required(fraction, "fraction", "a number > 0, as 0.9")?,
        }))
    }

    fn monte_carlo(root: &Section<'_>) -> Read<Option<MonteCarlo>> {
        let section = root.section("monte_carlo")?;
        section.known(&["paths", "seed", "scheme", "noise", "step", "duration"])?;
        if section.table.is_none() {
            return Ok(None);
        }
        let default = MonteCarlo::default();
        let mut noise = Noise::White;
        if matches!(
            section.get("noise").map(|it| &it.value),
            Some(Value::Table(_))
        ) {
            let cosines = section.section("noise")?;
            cosines.known(&["cosines", "band"])?;
            let count = cosines.whole("cosines", u64::from(MOST_COSINES))?;
            noise = Noise::Cosines {
                cosines: cosines.required(count, "cosines", "how many cosines, as 400")?,
                band: cosines.required(cosines.number("band")?, "band", "a frequency > 0")?,
            };
        } else {
            section.choice("noise", &[("white", ())])?;
        }
        Ok(Some(MonteCarlo {
            paths: section.whole("paths", u64::MAX)?.unwrap_or(default.paths),
            seed: section.whole("seed", u64::MAX)?.unwrap_or(default.seed),
            scheme: section.choice("scheme", SCHEMES)?.unwrap_or_default(),
            noise,
            step: section.number("step")?,
            duration: section.number("duration")?,
        }))
    }

    fn accuracy(root: &Section<'_>) -> Read<Accuracy> {
        let section = root.section("accuracy")?;
        section.known(&["tolerance", "max_seconds", "max_memory"])?;
        let default = Accuracy::default();
        Ok(Accuracy {
            tolerance: section.number("tolerance")?.unwrap_or(default.tolerance),
            max_seconds: section
                .number("max_seconds")?
                .unwrap_or(default.max_seconds),
            max_memory: section.bytes("max_memory")?.unwrap_or(default.max_memory),
        })
    }

    fn method(root: &Section<'_>) -> Read<MethodChoice> {
        let section = root.section("method")?;
        section.known(&["transient", "drift", "time", "cells", "step"])?;
        let cells = match section.get("cells").map(|node| &node.value) {
            None => None,
            Some(Value::List(items)) if items.len() == 2 => {
                let cells = |k: usize| -> Read<usize> {
                    let key = format!("cells[{k}]");
                    Ok(section.whole_of(&items[k], &key, usize::MAX as u64)? as usize)
                };
                Some([cells(0)?, cells(1)?])
            }
            Some(_) => {
                return Err(
                    section.type_error("cells", "two whole numbers, in q and in v, as [160, 100]")
                );
            }
        };
        Ok(MethodChoice {
            transient: section.auto("transient", TRANSIENT)?,
            drift: section.drift()?,
            time: section.auto("time", TIME)?,
            cells,
            step: section.number("step")?,
        })
    }
}

/// Phases of a periodic law unless the scene says otherwise.
const PHASES: u64 = 32;

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

/// One table of the scene, or its absence.
struct Section<'a> {
    document: &'a Document,
    path: String,
    table: Option<&'a BTreeMap<String, Node>>,
}

impl<'a> Section<'a> {
    fn full(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    fn get(&self, key: &str) -> Option<&'a Node> {
        self.table?.get(key)
    }

    fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    fn section(&self, key: &str) -> Read<Self> {
        let table = match self.get(key).map(|node| &node.value) {
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

    /// Refuse keys that are not in the list.
    fn known(&self, keys: &[&str]) -> Read<()> {
        for (key, node) in self.table.into_iter().flatten() {
            if keys.contains(&key.as_str()) {
                continue;
            }
            let shown: String = key.chars().take(60).collect();
            let shown = shown.escape_debug();
            let message = format!("{} is not a key of a scene", self.full(&shown.to_string()));
            let label = nearest(key, keys)
                .map_or("unknown key".into(), |near| format!("did you mean {near}?"));
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

    fn refuse(&self, key: &str, message: &str, help: &str) -> SceneError {
        let node = self.get(key);
        let wrong = self
            .document
            .wrong(message, "here", Some(help), node.map(|it| &it.at));
        wrong.about(self.full(key), node.map(|it| it.value.shown()))
    }

    fn type_error_at(&self, node: &Node, key: &str, accepted: &str) -> SceneError {
        let key = self.full(key);
        let message = match &node.value {
            Value::Table(_) | Value::List(_) => format!("{key} is {}", node.value.kind()),
            value => format!("{key} = {} is not accepted", value.shown()),
        };
        let help = format!("accepted: {accepted}");
        self.document
            .wrong(&message, "here", Some(&help), Some(&node.at))
            .about(key, Some(node.value.shown()))
    }

    fn type_error(&self, key: &str, accepted: &str) -> SceneError {
        match self.get(key) {
            Some(node) => self.type_error_at(node, key, accepted),
            None => self.refuse(key, &format!("{} is missing", self.full(key)), accepted),
        }
    }

    fn required<T>(&self, value: Option<T>, key: &str, what: &str) -> Read<T> {
        value.ok_or_else(|| {
            let message = format!("{} is missing", self.full(key));
            let help = format!("accepted: {what}");
            let at = self.document.find(&self.path).map(|node| &node.key);
            self.document
                .wrong(&message, "in this table", Some(&help), at)
                .about(self.full(key), None)
        })
    }

    fn text(&self, key: &str) -> Read<Option<&'a str>> {
        match self.get(key).map(|node| &node.value) {
            None => Ok(None),
            Some(Value::Text(text)) => Ok(Some(text)),
            Some(_) => Err(self.type_error(key, "text in quotes")),
        }
    }

    fn flag(&self, key: &str) -> Read<Option<bool>> {
        match self.get(key).map(|node| &node.value) {
            None => Ok(None),
            Some(Value::Flag(flag)) => Ok(Some(*flag)),
            Some(_) => Err(self.type_error(key, "true or false")),
        }
    }

    fn number_of(&self, node: &Node, key: &str) -> Read<f64> {
        match node.value {
            Value::Whole(n) => Ok(n as f64),
            Value::Number(x) => Ok(x),
            _ => Err(self.type_error_at(node, key, "a number")),
        }
    }

    fn number(&self, key: &str) -> Read<Option<f64>> {
        self.get(key)
            .map(|node| self.number_of(node, key))
            .transpose()
    }

    fn whole_of(&self, node: &Node, key: &str, most: u64) -> Read<u64> {
        let whole = match node.value {
            Value::Whole(n) => u64::try_from(n).ok(),
            // 1e5 is a float in TOML and a whole number to everybody else.
            Value::Number(x) if x.fract() == 0.0 && (0.0..9e15).contains(&x) => Some(x as u64),
            _ => None,
        };
        whole.filter(|n| *n <= most).ok_or_else(|| {
            let accepted = if most >= u64::MAX / 2 {
                "a whole number >= 0".into()
            } else {
                format!("a whole number from 0 to {most}")
            };
            self.type_error_at(node, key, &accepted)
        })
    }

    fn whole(&self, key: &str, most: u64) -> Read<Option<u64>> {
        self.get(key)
            .map(|node| self.whole_of(node, key, most))
            .transpose()
    }

    fn pair(&self, key: &str) -> Read<Option<[f64; 2]>> {
        match self.get(key).map(|node| &node.value) {
            None => Ok(None),
            Some(Value::List(items)) if items.len() == 2 => {
                let number = |k: usize| self.number_of(&items[k], &format!("{key}[{k}]"));
                Ok(Some([number(0)?, number(1)?]))
            }
            Some(_) => Err(self.type_error(key, "two numbers, of q and of v, as [0.0, 0.3]")),
        }
    }

    fn numbers(&self, key: &str) -> Read<Option<Vec<f64>>> {
        match self.get(key).map(|node| &node.value) {
            None => Ok(None),
            Some(Value::List(items)) => {
                let number = |(k, item)| self.number_of(item, &format!("{key}[{k}]"));
                items
                    .iter()
                    .enumerate()
                    .map(number)
                    .collect::<Read<_>>()
                    .map(Some)
            }
            Some(_) => Err(self.type_error(key, "a list of numbers, as [0, 50, 100]")),
        }
    }

    fn times(&self, key: &str) -> Read<Times> {
        match self.get(key).map(|node| &node.value) {
            None => Ok(Times::none()),
            Some(Value::List(items)) => {
                let number = |(k, item)| self.number_of(item, &format!("{key}[{k}]"));
                Ok(Times::List(
                    items.iter().enumerate().map(number).collect::<Read<_>>()?,
                ))
            }
            Some(Value::Table(_)) => {
                let inner = self.section(key)?;
                inner.known(&["every", "until"])?;
                let time = "a time > 0, as { every = 0.5, until = 50 }";
                Ok(Times::Every {
                    every: inner.required(inner.number("every")?, "every", time)?,
                    until: inner.required(inner.number("until")?, "until", time)?,
                })
            }
            Some(_) => Err(self.type_error(
                key,
                "a list of times, as [5, 10, 20], or { every = 0.5, until = 50 }",
            )),
        }
    }

    /// One of `names`.
    /// A list of the names of moments.
    fn moments(&self, key: &str) -> Read<Option<Vec<Moment>>> {
        let Some(node) = self.get(key) else {
            return Ok(None);
        };
        let names = Moment::ALL.map(Moment::name);
        let Value::List(items) = &node.value else {
            let accepted = format!("a list of names among {}", names.join(", "));
            return Err(self.type_error(key, &accepted));
        };
        let moment = |(k, item): (usize, &Node)| {
            let text = match &item.value {
                Value::Text(text) => text.as_str(),
                _ => "",
            };
            Moment::named(text).ok_or_else(|| {
                let mut accepted = names.join(", ");
                if let Some(near) = nearest(text, &names) {
                    let _ = write!(accepted, "; did you mean \"{near}\"?");
                }
                self.type_error_at(item, &format!("{key}[{k}]"), &accepted)
            })
        };
        let all: Read<Vec<Moment>> = items.iter().enumerate().map(moment).collect();
        all.map(Some)
    }

    /// A number, a list of numbers or text.
    fn parameter(&self, key: &str, node: &Node) -> Read<Parameter> {
        match &node.value {
            Value::Text(text) => Ok(Parameter::Text(text.clone())),
            Value::List(items) => {
                let number = |(k, item)| self.number_of(item, &format!("{key}[{k}]"));
                let all: Read<_> = items.iter().enumerate().map(number).collect();
                all.map(Parameter::Numbers)
            }
            _ => self.number_of(node, key).map(Parameter::Number),
        }
    }

    fn choice<T: Clone>(&self, key: &str, names: &[(&str, T)]) -> Read<Option<T>> {
        self.choice_or(key, names, "")
    }

    /// One of `names`; a message also says what `other` is accepted.
    fn choice_or<T: Clone>(&self, key: &str, names: &[(&str, T)], other: &str) -> Read<Option<T>> {
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
        if let Value::Text(text) = &node.value
            && let Some(near) = nearest(text, &names)
        {
            let last = accepted.len() - 1;
            let _ = write!(accepted[last], "; did you mean \"{near}\"?");
        }
        if !other.is_empty() {
            accepted.push(other.to_owned());
        }
        Err(self.type_error(key, &accepted.join(", ")))
    }

    /// One of `names` or "auto".
    fn auto<T: Clone>(&self, key: &str, names: &[(&str, T)]) -> Read<Option<T>> {
        let mut all = vec![("auto", None)];
        all.extend(
            names
                .iter()
                .map(|(name, value)| (*name, Some(value.clone()))),
        );
        Ok(self.choice(key, &all)?.flatten())
    }

    fn drift(&self) -> Read<Option<Drift>> {
        let name = match self.get("drift").map(|node| &node.value) {
            None => return Ok(None),
            Some(Value::Text(text)) if text.parse::<u64>().is_err() => text.clone(),
            Some(Value::Whole(n)) => n.to_string(),
            Some(_) => String::new(),
        };
        match DRIFT.iter().find(|(it, _)| *it == name) {
            Some((_, drift)) => Ok(Some(*drift)),
            None if name == "auto" => Ok(None),
            None => Err(self.type_error("drift", "\"auto\", \"upwind\", 2, 4, 6 or 8")),
        }
    }

    /// A size: a number of bytes, or text such as "8 GB".
    fn bytes(&self, key: &str) -> Read<Option<u64>> {
        let accepted = "a size as \"8 GB\", \"512 MiB\", or a number of bytes";
        match self.get(key).map(|node| &node.value) {
            None => Ok(None),
            Some(Value::Text(text)) => match parse_bytes(text) {
                Some(bytes) => Ok(Some(bytes)),
                None => Err(self.type_error(key, accepted)),
            },
            Some(Value::Whole(_) | Value::Number(_)) => self.whole(key, u64::MAX),
            Some(_) => Err(self.type_error(key, accepted)),
        }
    }
}

/// "8 GB", "512MiB", "1e9": at least one byte, at most 2^63.
fn parse_bytes(text: &str) -> Option<u64> {
    let text = text.trim();
    let digits = text
        .trim_end_matches(|c: char| c.is_ascii_alphabetic())
        .trim_end();
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
    names
        .iter()
        .copied()
        .max_by(|a, b| close(a).total_cmp(&close(b)))
        .filter(|name| close(name) > 0.75)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Scene, SceneError> {
        SceneText::parse("a.toml", text, &[]).map(|it| it.scene)
    }

    #[test]
    fn every_built_in_scene_is_accepted_and_its_resolved_form_is_the_same_scene() {
        for (name, text) in BUILT_IN {
            let scene = parse(text).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert!(!scene.title.is_empty(), "{name}");
            let again = parse(&scene.to_toml()).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(again, scene, "{name}");
        }
    }

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

    #[test]
    fn an_override_wins_over_the_file_and_may_be_a_bare_word() {
        let text = "[oscillator]\nzeta = 0.005\nh = 2e-3";
        let set = |sets: &[&str]| {
            let sets: Vec<String> = sets.iter().map(|it| (*it).to_owned()).collect();
            SceneText::parse("a.toml", text, &sets).map(|it| it.scene)
        };
        let scene = set(&[
            "oscillator.h=0.01",
            "oscillator.contact = bilinear",
            "title=two words",
            "outputs.moments_at={ every = 1, until = 3 }",
            "outputs.moments_at.until=2",
            "initial.deviation=[1, 1]",
        ])
        .unwrap();
        assert_eq!(scene.oscillator.h(), 0.01);
        assert_eq!(scene.oscillator.contact().name(), "bilinear");
        assert_eq!(scene.title, "two words");
        assert_eq!(scene.outputs.moments_at.list(), [1.0, 2.0]);
        // A table given whole replaces the one of the file; another kind of start needs no clearing.
        let moments = ["outputs.moments_at=[1]", "outputs.steady=true"];
        let whole = set(&[moments[0], moments[1], "outputs={ stationary = true }"]).unwrap();
        assert!(!whole.outputs.steady && whole.outputs.moments_at.is_empty());
        let start = set(&["initial.mean=[1, 0]", "initial.kind=rest"]).unwrap();
        assert_eq!(start.initial, crate::initial::Initial::Rest);
        let rig = "rig={ static_load = 110, frequency = 232, static_compression = 7e-6 }";
        let scene = set(&["oscillator.force_psd=0.17", rig]).unwrap();
        assert!((scene.oscillator.h() - 1.63e-3).abs() < 1e-5);
        for (wrong, expected) in [
            ("oscillator.h=-1", "oscillator.h = -1"),
            ("oscillator.h=x", "oscillator.h = \"x\""),
            ("oscillator.hh=1", "oscillator.hh"),
            ("nothing", "KEY=VALUE"),
            ("=3", "KEY=VALUE"),
            ("a b=3", "not TOML"),
        ] {
            let message = set(&[wrong]).unwrap_err().to_string();
            assert!(message.contains(expected), "{wrong}: {message}");
        }
    }

    #[test]
    fn a_message_points_at_its_bytes() {
        let text = "[oscillator]\nzeta = -0.5\nh = 2e-3";
        let error = parse(text).unwrap_err();
        let span = error.0.span.clone().unwrap();
        assert_eq!(&text[span], "-0.5");
        let text = "[oscillator]\nzeta = 0.5\nh = 2e-3\n[outputs]\nmoments_at = [1, 3, 2]";
        let error = parse(text).unwrap_err();
        assert_eq!(&text[error.0.span.clone().unwrap()], "2");
    }
}
