//! Round numbers on an axis, and numbers as they are printed.

use crate::format::{bare, rounded};

/// About `count` round numbers within a range, as they are written.
pub(super) fn ticks((low, high): (f64, f64), count: usize) -> Vec<(f64, String)> {
    let raw = (high - low) / count.max(1) as f64;
    let power = 10f64.powf(raw.log10().floor());
    let wide_enough = |step: &f64| *step >= raw * 0.75;
    let steps = [1.0, 2.0, 5.0, 10.0].map(|m| m * power);
    // One tick tells no scale: at least two.
    let step = steps
        .into_iter()
        .find(wide_enough)
        .filter(|step| 2.0 * step <= high - low)
        .or_else(|| steps.into_iter().rev().find(|step| !wide_enough(step)))
        .unwrap_or(raw);
    let size = low.abs().max(high.abs());
    let first = (low / step).ceil();
    // Beyond this the numbers would differ in digits that a double does not hold.
    if !(step.is_finite() && step > 0.0 && first.abs() < 1e12) {
        return Vec::new();
    }
    let plain = (1e-3..1e5).contains(&size);
    let scale = if plain {
        1.0
    } else {
        10f64.powf(size.log10().floor())
    };
    let digits = (-(step / scale).log10().floor()).clamp(0.0, 9.0) as usize;
    (0..=2 * count + 2)
        .map(|k| (first + k as f64) * step)
        .take_while(|x| *x <= high + 1e-9 * step)
        .map(|x| {
            // Rounding leaves -0.
            let x = if x.abs() < 1e-9 * step { 0.0 } else { x };
            let number = format!("{:.digits$}", x / scale);
            let text = if plain || x == 0.0 {
                number
            } else {
                format!("{number}e{}", scale.log10().round())
            };
            (x, text.replace('-', "\u{2212}"))
        })
        .collect()
}

/// About `count` round numbers of a scale as they are written; of a logarithmic one its powers of ten, or 1, 2 and 5 of
/// each where these are few.
pub(super) fn marks((low, high): (f64, f64), log: bool, count: usize) -> Vec<(f64, String)> {
    if !log {
        return ticks((low, high), count);
    }
    let margin = 1e-9 * (high - low);
    let within = |x: f64| x >= low - margin && x <= high + margin;
    let powers = low.floor() as i64..=high.ceil() as i64;
    let decades: Vec<i64> = powers.filter(|k| within(*k as f64)).collect();
    if decades.len() > 2 {
        let each = decades.len().div_ceil(count.max(2)) as i64;
        let shown = decades.into_iter().filter(|k| k.rem_euclid(each) == 0);
        return shown
            .map(|k| (k as f64, format!("10{}", superscript(k))))
            .collect();
    }
    let some = digits((low, high), &[1.0, 2.0, 5.0]);
    if some.len() > 2 {
        return some;
    }
    digits((low, high), &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])
}

/// The numbers of a logarithmic scale that begin with one of some digits.
pub(super) fn digits((low, high): (f64, f64), first: &[f64]) -> Vec<(f64, String)> {
    let margin = 1e-9 * (high - low);
    let powers = low.floor() as i64..=high.ceil() as i64;
    let parts = powers.flat_map(|k| first.iter().map(move |m| (k, *m)));
    let all = parts.map(|(k, m)| {
        let x = rounded(m * 10f64.powi(k as i32), 3);
        let text = if (-3..4).contains(&k) {
            bare(x)
        } else if m == 1.0 {
            format!("10{}", superscript(k))
        } else {
            format!("{m}\u{b7}10{}", superscript(k))
        };
        (x.log10(), text)
    });
    all.filter(|(x, _)| *x >= low - margin && *x <= high + margin)
        .collect()
}

pub fn superscript(k: i64) -> String {
    k.to_string()
        .chars()
        .map(|c| match c {
            '-' => '\u{207b}',
            '1' => '\u{b9}',
            '2' => '\u{b2}',
            '3' => '\u{b3}',
            digit => char::from_u32(0x2070 + digit.to_digit(10).unwrap_or(0)).unwrap_or(digit),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::panel::Panel;
    use super::*;

    #[test]
    fn ticks_are_round_numbers_within_the_range() {
        let texts = |range| {
            ticks(range, 5)
                .into_iter()
                .map(|it| it.1)
                .collect::<Vec<_>>()
        };
        assert_eq!(
            texts((0.0, 1.0)),
            ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]
        );
        assert_eq!(
            texts((-2.1, 2.1)),
            ["\u{2212}2", "\u{2212}1", "0", "1", "2"]
        );
        assert!(ticks((-0.048, 0.048), 3).len() > 1);
        assert!(ticks((1e300, 1e301), 5).len() < 13);
        assert!(ticks((1.0, 1.0), 5).is_empty() && ticks((f64::NAN, 1.0), 5).is_empty());
    }

    #[test]
    fn a_curve_is_cut_where_it_leaves_its_panel() {
        let panel = Panel::new([0.0, 0.0, 10.0, 10.0], (0.0, 10.0), (0.0, 10.0));
        let zigzag = [
            (0.0, 5.0),
            (2.0, 5.0),
            (4.0, 25.0),
            (6.0, 5.0),
            (8.0, f64::NAN),
            (9.0, 1.0),
        ];
        let pieces = panel.clipped(&zigzag);
        assert_eq!(pieces.len(), 2, "{pieces:?}");
        assert!(
            pieces
                .iter()
                .flatten()
                .all(|(_, y)| (0.0..=10.0).contains(y))
        );
    }
}
