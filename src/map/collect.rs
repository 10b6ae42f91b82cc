//! The parts of a map are joined: table, arrays, picture, page, and what is missing.

use super::axis::{Axis, Spacing, plain};
use super::collected::Collected;
use super::grid::{Map, name};
use super::lines::{Ending, Head, Known, each, heads, keep};
use super::page;
use super::part::{Part, place};
use super::run::MAP;
use super::table::{Column, Table, is_time, shown, walk};
use super::units::Units;
use crate::error::{Error, Result};
use crate::format::{brief, num};
use crate::report::folder;
use crate::report::plot::{self, Field, Picture, Ruler};
use crate::results::entries;
use serde_json::Value;
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// A number to be drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawn {
    /// Its name in results.json, sections before it.
    name: String,
    /// Its place in a list.
    place: Option<usize>,
    /// A level to be marked.
    level: Option<f64>,
}

impl Drawn {
    /// From `NUMBER`, `NUMBER[PLACE]` or `NUMBER=LEVEL`.
    ///
    /// # Errors
    /// [`Error::Invalid`] for anything else.
    pub fn parse(text: &str) -> Result<Self> {
        let accepted = "NUMBER or NUMBER=LEVEL, as decay_rates.re[0] or stationary.mean_q=0.1";
        let refused = || Error::invalid("--draw", text, accepted);
        let (name, level) = match text.split_once('=') {
            Some((name, level)) => {
                let level = level.trim().parse::<f64>().ok().filter(|it| it.is_finite());
                (name.trim(), Some(level.ok_or_else(refused)?))
            }
            None => (text.trim(), None),
        };
        let (name, place) = match name.strip_suffix(']').map(|it| it.split_once('[')) {
            Some(Some((name, place))) => (name, Some(place.parse().map_err(|_| refused())?)),
            Some(None) => return Err(refused()),
            None => (name, None),
        };
        if name.is_empty() {
            return Err(refused());
        }
        Ok(Self {
            name: name.to_owned(),
            place,
            level,
        })
    }

    fn plain(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            place: None,
            level: None,
        }
    }
}

/// Drawn where nothing else is asked for: the first four that a map has.
const MAIN: [&str; 12] = [
    "stationary.contact_loss_probability",
    "transient.contact_loss_probability",
    "decay_rates.re",
    "spectrum.peaks.half_power_width",
    "first_loss.rate",
    "first_loss.mean_time",
    "stationary.loss_rate",
    "crossings.loss_rate",
    "stationary.std_force",
    "transient.std_force",
    "stationary.mean_q",
    "transient.mean_q",
];

/// Joins the parts found in the folder of a map: map.csv, map.npz, map.svg, report.html, and missing.csv where points
/// are missing. The same bytes whatever the parts and the order of their lines. A cut-off last line is no line.
///
/// # Errors
/// [`Error::Invalid`] for a folder without a map, and for a number to draw that it does not have;
/// [`Error::Disagree`] where two lines of one point differ; [`Error::Io`].
pub fn collect(dir: &Path, draw: &[Drawn]) -> Result<Collected> {
    let mut it = read(dir)?;
    it.table.in_order(&it.axes);
    let drawn = chosen(&it.table, draw)?;
    let axes = it.axes.clone();
    let mut files = vec![
        it.table.csv(&axes, |index| place(&axes, index)),
        it.table.npz(&axes)?,
    ];
    let picture = picture(&it.axes, &it.table, &drawn).transpose()?;
    it.drawn = picture.is_some();
    files.push(page::page(&it, picture.as_ref()));
    files.extend(picture);
    let missing = dir.join("missing.csv");
    if it.missing.is_empty() {
        // Of an earlier time, when some were.
        let _ = fs::remove_file(missing);
    } else {
        files.push(page::missing(&it));
    }
    folder::write(dir, &files)?;
    Ok(it)
}

/// All lines of all parts.
fn read(dir: &Path) -> Result<Collected> {
    let path = dir.join(MAP);
    let refused = || {
        let accepted = format!("a folder of `vibroimpact map`, with its {MAP}");
        Error::invalid("DIR", dir.display(), accepted)
    };
    let text = fs::read_to_string(&path).map_err(|_| refused())?;
    let map: Value = serde_json::from_str(&text).map_err(|_| refused())?;
    let axes = axes(&map).ok_or_else(refused)?;
    let points: usize = axes.iter().map(|it| it.values().len()).product();
    if map["points"].as_u64() != Some(points as u64) {
        return Err(refused());
    }
    let mut parts: Vec<Part> = fs::read_dir(dir)
        .map_err(Error::io(dir))?
        .flatten()
        .filter_map(|it| Part::of_file(it.file_name().to_str()?))
        .collect();
    parts.sort_unstable();
    let files: Vec<PathBuf> = parts.iter().map(|it| dir.join(it.file())).collect();
    let mut table = Table::new(points, Units::of(&map["scene"], &axes));
    let told = Map::told(&map, axes.clone());
    let (known, dropped) = known(&files, points, &axes, told.as_ref())?;
    for (file, path) in files.iter().enumerate() {
        each(path, |at, line| {
            let line: Value = serde_json::from_slice(line).unwrap_or_default();
            let index = line["index"].as_u64().map(|it| it as usize);
            let it = index.and_then(|index| Some((index, known.get(&index)?)));
            if let Some((index, it)) = it
                && (it.file, it.at) == (file, at)
            {
                table.put(index, &line, it.ending);
            }
            Ok(())
        })?;
    }
    let ended = |ending| known.values().filter(|it| it.ending == ending).count();
    // The division into most parts is the one that an engine ran.
    let of = parts.iter().map(|it| it.of()).max().unwrap_or(1);
    let absent = table.endings.iter().filter(|it| it.is_none()).count();
    let mut missing: Vec<(usize, Option<Part>)> = if absent == 0 {
        Vec::new()
    } else {
        Part::holders(of, points)
            .filter(|(index, _)| table.endings[*index].is_none())
            .map(|(index, part)| (index, Some(part)))
            .collect()
    };
    missing.sort_unstable_by_key(|it| it.0);
    let title = map["scene"]["title"].as_str();
    Ok(Collected {
        title: title.unwrap_or_default().to_owned(),
        points,
        failed: ended(Ending::Failed),
        lacking: ended(Ending::Lacking),
        short: ended(Ending::Short),
        parts,
        missing,
        axes,
        table,
        scene: map["scene"].clone(),
        drawn: false,
        dropped,
    })
}

/// The axes that map.json names.
fn axes(map: &Value) -> Option<Vec<Axis>> {
    let axis = |it: &Value| {
        let spacing = Spacing::named(it["spacing"].as_str()?)?;
        let values = it["values"].as_array()?.clone();
        let axis = Axis::list(it["key"].as_str()?, values).ok()?;
        Some(axis.spaced(spacing))
    };
    let all: Option<Vec<Axis>> = map["over"].as_array()?.iter().map(axis).collect();
    all.filter(|it| !it.is_empty())
}

/// The line that counts of each point, and how many are none: a cut-off one is a point in flight when its run was killed. The
/// first of each file is to be of the scene that is `told`.
fn known(
    files: &[PathBuf],
    points: usize,
    axes: &[Axis],
    told: Option<&Map>,
) -> Result<(HashMap<usize, Known>, usize)> {
    let (mut all, mut dropped): (HashMap<usize, Known>, usize) = Default::default();
    for (file, path) in files.iter().enumerate() {
        let mut told = told;
        dropped += heads((file, path), |head, here| {
            if head.index >= points {
                return Ok(());
            }
            let scene = told.take().and_then(|map| map.scene(head.index).ok());
            if scene.is_some_and(|it| name(&it) != head.name) {
                let accepted =
                    format!("parts of the map in {MAP} alone; this one is of another scene");
                return Err(Error::invalid("DIR", path.display(), accepted));
            }
            if let Some(there) = all.get(&head.index).filter(|it| here.disagrees(it)) {
                return Err(differ(axes, &head, files, (*there, here)));
            }
            keep(&mut all, head.index, here);
            Ok(())
        })?;
    }
    Ok((all, dropped))
}

/// Says where two lines of one point differ.
fn differ(axes: &[Axis], head: &Head, files: &[PathBuf], (a, b): (Known, Known)) -> Error {
    let line = |it: Known| -> Option<Value> {
        let mut file = BufReader::new(File::open(&files[it.file]).ok()?);
        file.seek(SeekFrom::Start(it.at)).ok()?;
        let mut text = String::new();
        file.read_line(&mut text).ok()?;
        serde_json::from_str(&text).ok()
    };
    let numbers = |it: &Value| {
        let mut all = Vec::new();
        walk(it, &mut |name, place, value, error| {
            all.push((shown(name, place), value, error));
        });
        all
    };
    let (first, second) = (line(a).unwrap_or_default(), line(b).unwrap_or_default());
    let (ours, theirs) = (numbers(&first), numbers(&second));
    let other = ours.iter().zip(&theirs).find(|(a, b)| {
        // NaN is no difference.
        a.0 != b.0 || a.1.to_bits() != b.1.to_bits() || a.2.to_bits() != b.2.to_bits()
    });
    let what = match other {
        Some((a, b)) if a.0 == b.0 => {
            let [one, other] = [a, b].map(|it| match it.2 {
                error if error.is_nan() => num(it.1),
                error => format!("{} ± {}", num(it.1), num(error)),
            });
            format!("{} is {one} in one and {other} in the other", a.0)
        }
        _ => ["name", "error", "warnings", "shortfalls"]
            .into_iter()
            .find(|key| first[*key] != second[*key])
            .map_or("the numbers they have are others".into(), |key| {
                let (one, other) = (&first[key], &second[key]);
                format!("{key} is {one} in one and {other} in the other")
            }),
    };
    let values = place(axes, head.index);
    let values = axes.iter().zip(values);
    let values: Vec<String> = values
        .map(|(axis, k)| format!("{} = {}", axis.key(), axis.values()[k]))
        .collect();
    let name = |it: Known| {
        let name = files[it.file].file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    };
    Error::Disagree {
        point: format!("{} ({})", head.index, values.join(", ")),
        files: [name(a), name(b)],
        what,
    }
}

/// What is drawn: as asked, or the main numbers.
fn chosen(table: &Table, draw: &[Drawn]) -> Result<Vec<Drawn>> {
    for it in draw {
        let there = table.group(&it.name);
        let place = it.place.unwrap_or(0);
        if there.is_none_or(|group| place >= group.len()) {
            let names: Vec<&str> = table.groups().map(|it| it[0].name.as_str()).collect();
            let asked = shown(&it.name, it.place);
            let accepted = match there {
                Some(group) => format!("a place below {}", group.len()),
                None => names.join(", "),
            };
            return Err(Error::invalid("--draw", asked, accepted));
        }
    }
    if !draw.is_empty() {
        return Ok(draw.to_vec());
    }
    let main = MAIN.iter().filter(|it| table.group(it).is_some());
    let mut main: Vec<Drawn> = main.map(|it| Drawn::plain(it)).collect();
    if main.is_empty() {
        let names = table.groups().map(|it| it[0].name.as_str());
        let own = names.filter(|it| !it.starts_with("oscillator.") && !is_time(it));
        main = own.map(Drawn::plain).collect();
    }
    main.truncate(4);
    Ok(main)
}

/// The picture over the axes that have more than one point; moments at several times have time as an axis more.
fn picture(axes: &[Axis], table: &Table, drawn: &[Drawn]) -> Picture {
    let long = axes.iter().filter(|it| it.values().len() > 1);
    let mut rulers: Vec<Ruler> = long.map(ruler).collect();
    let times = drawn.first().filter(|it| it.place.is_none());
    let times = times.and_then(|it| table.times(&it.name));
    let times = times.filter(|it| it.len() > 1 && rulers.len() < 3);
    let with_times = |it: &Drawn| it.place.is_none() && table.times(&it.name) == times;
    let mut drawn: Vec<&Drawn> = drawn.iter().collect();
    if let Some(times) = &times {
        drawn.retain(|it| with_times(it));
        rulers.push(Ruler {
            label: "t".into(),
            values: times.clone(),
            log: false,
            words: None,
        });
    }
    let field = |it: &Drawn| -> Option<Field> {
        let group = table.group(&it.name)?;
        // Without an axis of times the last one.
        let last = table.times(&it.name).map_or(0, |it| it.len() - 1);
        let columns: Vec<&Column> = match &times {
            Some(_) => group.iter().collect(),
            None => vec![group.get(it.place.unwrap_or(last))?],
        };
        let points = table.endings.len();
        let all = |of: fn(&Column) -> &Vec<f64>| -> Vec<f64> {
            let along = |k: usize| columns.iter().map(move |it| of(it)[k]);
            (0..points).flat_map(along).collect()
        };
        let place = match (&times, columns[0].place) {
            (None, Some(k)) if group.len() > 1 || it.place.is_some() => Some(k),
            _ => None,
        };
        Some(Field {
            label: called(&it.name, place, table.times(&it.name))
                + table.units.bracketed(&it.name).replace(" [1]", "").as_str(),
            values: all(|it| &it.values),
            errors: all(|it| &it.errors),
            level: it.level,
        })
    };
    let fields: Vec<Field> = drawn.into_iter().filter_map(field).collect();
    plot::map(&rulers, &fields)
}

/// A number as a picture calls it: by its symbol where it has one, with its time, the stationary ones by that word.
fn called(name: &str, place: Option<usize>, times: Option<Vec<f64>>) -> String {
    let (section, last) = name.rsplit_once('.').unwrap_or(("", name));
    match entries().find(|it| it.name == last) {
        Some(it) => {
            let at = place.zip(times).and_then(|(k, all)| all.get(k).copied());
            let at = at.map_or_else(String::new, |t| format!(" at t = {}", brief(t)));
            let section = section.replace("transient", "");
            format!("{section} {}{at}", it.symbol).trim().to_owned()
        }
        None if name == "decay_rates.re" => match place {
            Some(k) if k > 0 => format!("Re \u{3bb}{}", k + 1),
            _ => "Re \u{3bb} of the slowest eigenvalue".into(),
        },
        None if name == "spectrum.peaks.half_power_width" => match place {
            Some(k) if k > 0 => format!("half-power width of peak {}", k + 1),
            _ => "half-power width of the highest peak".into(),
        },
        None => shown(name, place),
    }
}

/// The symbol of a key of a scene.
fn symbol(key: &str) -> &str {
    match key {
        "oscillator.h" => "h",
        "oscillator.zeta" => "\u{3b6}",
        "oscillator.force_psd" => "force_psd, N\u{b2}/Hz",
        "rig.frequency" => "rig.frequency, Hz",
        "rig.static_load" => "rig.static_load, N",
        "rig.static_compression" => "rig.static_compression, m",
        other => other,
    }
}

fn ruler(axis: &Axis) -> Ruler {
    let numbers = axis.numbers();
    let words = match &numbers {
        Some(_) => None,
        None => Some(axis.values().iter().map(plain).collect()),
    };
    let count = axis.values().len();
    let values = numbers.unwrap_or_else(|| (0..count).map(|k| k as f64).collect());
    // A list that spans decades is meant to.
    let positive = words.is_none() && values.iter().all(|it| *it > 0.0);
    let most = values.iter().copied().fold(0.0, f64::max);
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let spread = positive && most >= 30.0 * least;
    Ruler {
        label: symbol(axis.key()).to_owned(),
        values,
        log: axis.spacing() == Spacing::Logarithmic || (axis.spacing() == Spacing::List && spread),
        words,
    }
}
