//! A part of a map: which of its points, and the file of their lines.

use super::axis::Axis;
use crate::error::{Error, Result};
use std::fmt;

/// Part `number` of `of` parts, from 1: computed without knowing of the others.
///
/// ```
/// use vibroimpact::map::Part;
/// assert_eq!(Part::parse("2/7")?.file(), "part-2-of-7.jsonl");
/// assert!(Part::parse("8/7").is_err());
/// # Ok::<(), vibroimpact::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Part {
    of: usize,
    number: usize,
}

impl Part {
    /// The whole map.
    pub const WHOLE: Self = Self { of: 1, number: 1 };

    /// Parts of a map at most.
    const MOST: usize = 1_000_000_000;

    /// A part of `of`, its number from 1.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a number that is none of them.
    pub fn new(number: usize, of: usize) -> Result<Self> {
        if (1..=of).contains(&number) && of <= Self::MOST {
            return Ok(Self { of, number });
        }
        let accepted = format!("K/N with 1 <= K <= N <= {:.0e}, as 1/7", Self::MOST as f64);
        Err(Error::invalid("--part", format!("{number}/{of}"), accepted))
    }

    /// From `K/N`.
    ///
    /// # Errors
    /// [`Error::Invalid`] for anything else.
    pub fn parse(text: &str) -> Result<Self> {
        let numbers = text.split_once('/');
        let numbers = numbers.and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
        let Some((number, of)) = numbers else {
            let accepted = "K/N with whole numbers 1 <= K <= N, as 1/7";
            return Err(Error::invalid("--part", text, accepted));
        };
        Self::new(number, of)
    }

    /// How many parts there are of its kind.
    pub(super) fn of(self) -> usize {
        self.of
    }

    /// The name of its file.
    pub fn file(self) -> String {
        format!("part-{}-of-{}.jsonl", self.number, self.of)
    }

    /// From the name of its file.
    pub(super) fn of_file(name: &str) -> Option<Self> {
        let numbers = name.strip_prefix("part-")?.strip_suffix(".jsonl")?;
        let (number, of) = numbers.split_once("-of-")?;
        let it = Self::new(number.parse().ok()?, of.parse().ok()?).ok()?;
        // part-01-of-7 is not what a run writes.
        (it.file() == name).then_some(it)
    }

    /// Its points in a map of so many. Parts are equal but for one point, and each is spread over the whole map, so
    /// that none has the costly corner to itself: a run of the points in an order of large steps.
    pub fn points(self, len: usize) -> impl Iterator<Item = usize> {
        let step = spread(len);
        let at = move |k: usize| (k as u128 * step as u128 % len as u128) as usize;
        let end = |number: usize| (len as u128 * number as u128 / self.of as u128) as usize;
        (end(self.number - 1)..end(self.number)).map(at)
    }

    /// The part of `of` that holds each point of a map.
    pub(super) fn holders(of: usize, len: usize) -> impl Iterator<Item = (usize, Self)> {
        let parts = (1..=of).map(move |number| Self { of, number });
        parts.flat_map(move |part| part.points(len).map(move |index| (index, part)))
    }
}

/// K/N.
impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

/// A step that visits every one of `len` points once: prime to it, and near the golden section, whose multiples are
/// the most evenly spread.
fn spread(len: usize) -> usize {
    let near = (len as f64 * 0.618_033_988_749_894_9) as usize;
    let prime = |step: &usize| gcd(*step, len) == 1;
    (near.max(1)..=len).find(prime).unwrap_or(1)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// The place of point `index` on each axis, the last running fastest.
pub(super) fn place(axes: &[Axis], mut index: usize) -> Vec<usize> {
    let mut places = vec![0; axes.len()];
    for (place, axis) in places.iter_mut().zip(axes).rev() {
        let count = axis.values().len();
        *place = index % count;
        index /= count;
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_share_out_every_point_once_and_equally() {
        for len in [1, 2, 3, 7, 40, 1000, 9973, 10_000] {
            for of in [1, 2, 3, 7, 40, 41] {
                let mut seen = vec![0; len];
                let mut sizes = Vec::new();
                for number in 1..=of {
                    let points: Vec<usize> = Part::new(number, of).unwrap().points(len).collect();
                    sizes.push(points.len());
                    for index in points {
                        seen[index] += 1;
                    }
                }
                assert!(seen.iter().all(|it| *it == 1), "{len} in {of}");
                let (low, high) = (sizes.iter().min().unwrap(), sizes.iter().max().unwrap());
                assert!(high - low <= 1, "{len} in {of}: {sizes:?}");
                assert_eq!(Part::holders(of, len).count(), len);
            }
        }
    }

    #[test]
    fn no_part_of_a_square_map_has_a_row_or_a_column_to_itself() {
        // 40 x 25 points in 25 parts, which every k-th point would cut along the columns.
        for number in 1..=25 {
            let points: Vec<usize> = Part::new(number, 25).unwrap().points(1000).collect();
            let distinct = |of: &dyn Fn(usize) -> usize| {
                let mut all: Vec<usize> = points.iter().map(|it| of(*it)).collect();
                all.sort_unstable();
                all.dedup();
                all.len()
            };
            let (rows, columns) = (distinct(&|it| it / 25), distinct(&|it| it % 25));
            assert!(rows >= 20 && columns >= 12, "{number}: {rows} {columns}");
        }
    }

    #[test]
    fn a_part_knows_its_file_and_a_bad_one_is_refused() {
        let part = Part::parse("3/12").unwrap();
        assert_eq!(Part::of_file(&part.file()), Some(part));
        assert_eq!(Part::of_file("part-03-of-12.jsonl"), None);
        assert_eq!(Part::of_file(".part-3-of-12.lock"), None);
        for wrong in ["", "3", "0/3", "4/3", "1/0", "-1/3", "1/3/5", "a/b"] {
            let error = Part::parse(wrong).unwrap_err().to_string();
            assert!(error.starts_with("--part"), "{error}");
        }
    }
}
