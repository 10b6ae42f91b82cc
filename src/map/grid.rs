//! A map: a scene and the axes that are laid over it; each point of their grid is a scene.

use super::axis::Axis;
use super::numbers::{self, Keep};
use super::part::place;
use crate::error::{Error, Result as Checked};
use crate::plan::Plan;
use crate::results::Results;
use crate::scene::Scene;
use crate::scene::text::{Draft, SceneError, SceneText};
use rayon::prelude::*;
use serde_json::{Map as Object, Value, json};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What is wrong with a map.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// A scene of the map, with the line that is wrong.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Anything else.
    #[error(transparent)]
    Other(#[from] Error),
}

/// Result with [`MapError`].
pub(super) type Result<T> = std::result::Result<T, MapError>;

/// A scene at every point of a grid. Points are numbered from 0, the last axis running fastest; everything about a
/// point is a function of its number alone, wherever and in whatever order it is computed.
#[derive(Debug, Clone)]
pub struct Map {
    title: String,
    /// The text of the scene, and what was set on top of it.
    given: (String, Vec<String>),
    draft: Draft,
    axes: Vec<Axis>,
    keep: Keep,
    len: usize,
}

/// Points above which only the values of each axis are checked at once; the points of a part are when it is run.
const CHECKED: usize = 100_000;

/// What map.json says of the scene, for people and for `collect`: its hash tells whether it is another one.
pub(super) const SHOWN: [&str; 3] = ["scene", "toml", "set"];

/// Points of a map at most.
const MOST: usize = 1_000_000_000_000;

impl Map {
    /// The map of a scene in TOML, `name` standing for it in messages, with overrides `KEY=VALUE` of the scene, and
    /// `axes` over it, the first running slowest. `keep` names curves of results.json that lines hold too, as
    /// `spectrum` or `first_loss.survival`.
    ///
    /// Every point is checked, computing nothing: of a map of more than 1e5 points each value of each axis, and the
    /// other points by the part that holds them.
    ///
    /// # Errors
    /// [`MapError`] that names the key, the value and what is accepted.
    pub fn of(
        name: &str,
        scene: &str,
        set: &[String],
        axes: Vec<Axis>,
        keep: Vec<String>,
    ) -> Result<Self> {
        let it = Self::unchecked(name, scene, set, axes, keep)?;
        it.check()?;
        Ok(it)
    }

    /// The map that map.json tells of; None of one that this version did not write, or whose scene cannot be read here.
    pub(super) fn told(map: &Value, axes: Vec<Axis>) -> Option<Self> {
        let set = map["set"].as_array()?.iter();
        let set: Option<Vec<String>> = set.map(|it| Some(it.as_str()?.to_owned())).collect();
        Self::unchecked("map.json", map["toml"].as_str()?, &set?, axes, Vec::new()).ok()
    }

    fn unchecked(
        name: &str,
        scene: &str,
        set: &[String],
        axes: Vec<Axis>,
        keep: Vec<String>,
    ) -> Result<Self> {
        if axes.is_empty() {
            let accepted = "at least one --over KEY=RANGE, as oscillator.h=log:1e-4:1e-2:40";
            return Err(Error::invalid("--over", "nothing", accepted).into());
        }
        for (k, axis) in axes.iter().enumerate() {
            if axes[..k].iter().any(|it| it.key() == axis.key()) {
                return Err(Error::invalid("--over", axis.key(), "each key once").into());
            }
            if axis.key() == "outputs.time_unit" {
                let accepted = "another key: the points of a map share one unit of time";
                return Err(Error::invalid("--over", axis.key(), accepted).into());
            }
        }
        let len = axes.iter().try_fold(1usize, |product, axis| {
            product.checked_mul(axis.values().len())
        });
        let Some(len) = len.filter(|it| *it <= MOST) else {
            let points: f64 = axes.iter().map(|it| it.values().len() as f64).product();
            let accepted = format!("at most {:.0e} points", MOST as f64);
            return Err(Error::invalid("--over", format!("{points:.1e} points"), accepted).into());
        };
        let mut it = Self {
            title: String::new(),
            given: (scene.to_owned(), set.to_vec()),
            draft: Draft::parse(name, scene, set)?,
            axes,
            keep: Keep::of(keep)?,
            len,
        };
        let first = it.scene(0)?;
        it.title = first.title;
        it.keep = it.keep.of_these(&first.outputs)?;
        Ok(it)
    }

    /// Every point, or every value of every axis.
    fn check(&self) -> Result<()> {
        if self.len > CHECKED {
            return self.check_axes();
        }
        let all = (0..self.len).into_par_iter();
        all.try_for_each(|index| self.text(index).map(drop))
    }

    /// Each value of each axis, the other keys at their first value.
    fn check_axes(&self) -> Result<()> {
        let mut stride = self.len;
        for axis in &self.axes {
            let count = axis.values().len();
            stride /= count;
            (0..count)
                .into_par_iter()
                .try_for_each(|k| self.text(k * stride).map(drop))?;
        }
        Ok(())
    }

    /// How many points it has; at least one.
    #[allow(clippy::len_without_is_empty)] // It is never empty.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The title of its scene.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Its axes, the first running slowest.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// The place of a point on each axis.
    pub fn place(&self, index: usize) -> Vec<usize> {
        place(&self.axes, index)
    }

    /// The scene of a point with its text, so that what is wrong with it can be shown.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a number that no point has; what is wrong with the scene.
    pub(super) fn text(&self, index: usize) -> Result<SceneText> {
        if index >= self.len {
            let accepted = format!("the number of a point, from 0 to {}", self.len - 1);
            return Err(Error::invalid("index", index, accepted).into());
        }
        let places = self.place(index);
        let axes = self.axes.iter().zip(places);
        let over: Vec<String> = axes.map(|(axis, k)| axis.set(k)).collect();
        let scene = self.draft.with("--over", &over);
        Ok(scene.map_err(|error| match error.key() {
            // Which of the points it is; a value out of range says so by itself.
            Some(key) if self.axes.iter().any(|axis| axis.key() == key) => error,
            _ => error.with_note(&format!(" at {}", over.join(", "))),
        })?)
    }

    /// The scene of a point.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a number that no point has; what is wrong with the scene.
    pub fn scene(&self, index: usize) -> Result<Scene> {
        Ok(self.text(index)?.scene().clone())
    }

    /// The keys of a point with their values.
    fn over(&self, index: usize) -> Object<String, Value> {
        let pair = |(axis, k): (&Axis, usize)| (axis.key().to_owned(), axis.values()[k].clone());
        self.axes.iter().zip(self.place(index)).map(pair).collect()
    }

    /// The line of a point, a function of its number alone: one object of JSON without a line break, with `index`,
    /// `name` (the hash of its resolved scene), `over`, and `results` with the numbers of results.json, or `error`
    /// where it was refused or failed. Computes the point on the threads of the caller's rayon pool.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a number that no point has; what is wrong with the scene.
    pub fn line(&self, index: usize) -> Result<String> {
        let text = self.text(index)?;
        Ok(self.line_of(index, text.scene(), None))
    }

    /// The line of a point; with its plan, if it is made already.
    pub(super) fn line_of(&self, index: usize, scene: &Scene, plan: Option<&Plan>) -> String {
        let mut line = Object::new();
        line.insert("index".into(), json!(index));
        line.insert("name".into(), json!(name(scene)));
        line.insert("over".into(), self.over(index).into());
        let run = || match plan {
            Some(plan) => plan.run_quietly(),
            None => Plan::of(scene)?.run_quietly(),
        };
        // A panic is a bug of ours, and of one point: the others are computed.
        let ended = catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|panic| {
            let what = panic.downcast_ref::<String>().map(String::as_str);
            let what = what.or_else(|| panic.downcast_ref::<&str>().copied());
            let what = format!("a bug of this program: {}", what.unwrap_or("it panicked"));
            let stage = "map";
            Err(Error::linear(stage, what))
        });
        match ended {
            Ok(results) => {
                line.insert("results".into(), numbers::of(&results.tree(), &self.keep));
                put_notes(&mut line, &results);
            }
            Err(error) => {
                line.insert("error".into(), told(&error));
            }
        }
        Value::Object(line).to_string()
    }

    /// What the map is, as map.json says it: two parts belong together where all but [`SHOWN`] is the same.
    pub(super) fn identity(&self) -> Checked<Value> {
        let axis = |it: &Axis| json!({ "key": it.key(), "spacing": it.spacing().name(), "values": it.values() });
        let first = self.text(0).map_err(|error| match error {
            MapError::Other(error) => error,
            MapError::Scene(error) => Error::invalid("scene", error, "a scene"),
        })?;
        Ok(json!({
            "version": env!("CARGO_PKG_VERSION"),
            "points": self.len,
            "over": self.axes.iter().map(axis).collect::<Vec<_>>(),
            "keep": self.keep.names(),
            "name": name(first.scene()),
            "scene": first.scene().resolved(),
            "toml": self.given.0,
            "set": self.given.1,
        }))
    }
}

/// What a reader of the line should know beside its numbers.
fn put_notes(line: &mut Object<String, Value>, results: &Results) {
    let short = |(stage, it): &(&str, crate::estimate::Shortfall)| json!({ "stage": stage, "number": it.number(), "ratio": it.ratio(), "free": it.free });
    if !results.shortfalls.is_empty() {
        let all = results.shortfalls.iter().map(short).collect();
        line.insert("shortfalls".into(), all);
    }
    if !results.run.warnings.is_empty() {
        let all = results.run.warnings.iter().map(|it| json!(it.text));
        line.insert("warnings".into(), all.collect());
    }
}

fn told(error: &Error) -> Value {
    let mut told = json!({ "message": error.to_string() });
    let mut put = |key: &str, it: &str| told[key] = json!(it);
    match error {
        Error::Invalid {
            key,
            value,
            accepted,
        } => {
            put("key", key);
            put("value", value);
            put("accepted", accepted);
        }
        Error::Limit { key, limit, .. } => {
            put("key", key);
            put("value", limit);
        }
        _ => {}
    }
    told
}

/// The name of a point: a hash of its resolved scene but for its title and its limits of time and memory, which change no
/// number: a point that met a limit can be computed again with a wider one. FNV-1a of 64 bits: the same on every machine,
/// and two of 1e6 points share one with a probability of 3e-8.
pub(super) fn name(scene: &Scene) -> String {
    let mut resolved = scene.resolved();
    if let Some(pairs) = resolved.as_object_mut() {
        pairs.shift_remove("title");
    }
    if let Some(pairs) = resolved["accuracy"].as_object_mut() {
        pairs.retain(|key, _| !key.starts_with("max_"));
    }
    let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    let hash = resolved
        .to_string()
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325, step);
    format!("{hash:016x}")
}
