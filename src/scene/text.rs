//! Scenes from TOML, with messages that show the line.

mod document;
mod error;
mod read;
mod section;

#[cfg(feature = "cli")]
pub(crate) use document::items;
pub use error::SceneError;
#[cfg(feature = "cli")]
pub(crate) use section::nearest;

use super::Scene;
use crate::error::Error;
use document::Document;

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
#[cfg(feature = "cli")]
pub(crate) fn built_in(name: &str) -> Option<&'static str> {
    let scene = BUILT_IN.iter().find(|(it, _)| *it == name);
    scene.map(|(_, text)| *text)
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
    pub(crate) fn parse(name: &str, text: &str, overrides: &[String]) -> Result<Self, SceneError> {
        let mut document = Document::parse(name, text)?;
        for text in overrides {
            document.set("--set", text)?;
        }
        Ok(Self(document))
    }

    /// The scene with more overrides, which `option` of the command line gave.
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
