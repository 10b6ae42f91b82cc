//! Where the scene of a command line comes from.

use super::stop::Stop;
use crate::report;
use crate::scene::text::{BUILT_IN, SceneText, built_in, nearest};
use std::io::Read;
use std::path::Path;

fn names() -> Vec<&'static str> {
    BUILT_IN.iter().map(|(name, _)| *name).collect()
}

/// Whether a built-in scene has this name, but for a slip of the pen.
pub(super) fn resembles_a_scene(name: &str) -> bool {
    !name.starts_with('-') && nearest(name, &names()).is_some()
}

/// There is no built-in scene of this name.
pub(super) fn no_such_scene(name: &str) -> Stop {
    let names = names();
    let guess = nearest(name, &names).map_or(String::new(), |it| format!("did you mean {it}? "));
    let message = format!("there is no built-in scene {name:?}");
    let help = format!("{guess}accepted: {}", names.join(", "));
    Stop::new(2, message, &help)
}

/// The scene of the command line with its overrides.
pub(super) fn read(scene: Option<&Path>, set: &[String]) -> std::result::Result<SceneText, Stop> {
    let (name, text) = named(scene)?;
    SceneText::parse(&name, &text, set).map_err(Stop::scene)
}

/// Name and text of the scene of the command line.
pub(super) fn named(scene: Option<&Path>) -> std::result::Result<(String, String), Stop> {
    let Some(path) = scene else {
        let (name, text) = BUILT_IN[0];
        return Ok((name.to_owned(), text.to_owned()));
    };
    let name = path.display().to_string();
    // A folder of results may have its name.
    if !path.is_file()
        && let Some(text) = built_in(&name)
    {
        return Ok((name, text.to_owned()));
    }
    let text = read_text(path)?;
    Ok((name, text))
}

fn read_text(path: &Path) -> std::result::Result<String, Stop> {
    /// Far above any scene, far below what hurts.
    const MOST: u64 = 10_000_000;
    let name = path.display();
    let accepted = "accepted: a scene file in TOML, or a built-in scene (vibroimpact scenes)";
    if path.is_dir() {
        return Err(Stop::new(2, format!("{name} is a folder"), accepted));
    }
    let mut bytes = Vec::new();
    let read = std::fs::File::open(path).and_then(|it| it.take(MOST + 1).read_to_end(&mut bytes));
    if let Err(error) = read {
        let guess = path.to_str().and_then(|it| nearest(it, &names()));
        let guess = guess.map_or(String::new(), |it| format!("; did you mean {it}?"));
        let message = format!("{name} cannot be read: {error}");
        return Err(Stop::new(2, message, &format!("{accepted}{guess}")));
    }
    if bytes.len() as u64 > MOST {
        let message = format!("{name} is too large for a scene");
        return Err(Stop::new(2, message, "accepted: at most 10 MB of TOML"));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let message = format!("{name} is not UTF-8: byte {at} does not belong");
        Stop::new(2, message, "accepted: TOML, which is UTF-8 text")
    })
}

/// Refuses results in a folder whose scene is the one that was read, if it would not be written again as it is.
pub(super) fn keeps(
    scene: Option<&Path>,
    text: &SceneText,
    folder: &Path,
) -> std::result::Result<(), Stop> {
    let place = folder.join(report::SCENE).canonicalize().ok();
    let read = scene.filter(|it| place.is_some() && it.canonicalize().ok() == place);
    let read = read.and_then(|it| std::fs::read_to_string(it).ok());
    if read.is_none_or(|it| it == text.scene().to_toml()) {
        return Ok(());
    }
    let message = format!("--out = {} is not accepted", folder.display());
    let help = "accepted: another folder: its scene.toml is the scene that is read, and would be replaced by \
                another text";
    Err(Stop::new(2, message, help))
}
