//! How numbers are written, in messages, tables and files.

use crate::estimate::Estimate;
use std::fmt;

/// A number as it reads back exactly and as a person would type it: no 300 digits for 1e300.
pub(crate) fn num(x: f64) -> String {
    format!("{x:?}")
}

/// The same without the ".0" of a whole number: 5, 0.5, 1e-7.
pub(crate) fn bare(x: f64) -> String {
    let text = num(x);
    text.strip_suffix(".0").unwrap_or(&text).to_owned()
}

/// As it was typed, or to a few digits if that is long.
pub(crate) fn brief(x: f64) -> String {
    let exact = num(x);
    if exact.len() <= 8 {
        bare(x)
    } else if (1e-3..1e4).contains(&x.abs()) {
        // Four digits after the leading zeros: 0.00163 is not 0.0016.
        let zeros = (-x.abs().log10().floor()).max(1.0) as usize;
        format!("{x:.digits$}", digits = zeros + 3)
    } else {
        format!("{x:.2e}")
    }
}

/// The number nearest to `x` with so many significant digits: to 13 of them, 3 times 0.1 is 0.3.
pub(crate) fn rounded(x: f64, digits: usize) -> f64 {
    let digits = digits.saturating_sub(1);
    format!("{x:.digits$e}").parse().unwrap_or(x)
}

/// At most so many of `count` indices, spread evenly, the last among them.
pub(crate) fn spread(count: usize, most: usize) -> Vec<usize> {
    let most = most.min(count);
    (1..=most).map(|k| (k * count).div_ceil(most) - 1).collect()
}

/// A count with its noun.
pub(crate) fn many(count: u64, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// A size in the unit a person would use.
pub fn bytes(bytes: u64) -> String {
    let mut size = bytes as f64;
    for unit in ["B", "kB", "MB", "GB", "TB", "PB"] {
        if size < 999.5 {
            let digits = usize::from(size < 9.95 && unit != "B");
            return format!("{size:.digits$} {unit}");
        }
        size /= 1e3;
    }
    format!("{size:.0} EB")
}

/// A time in the unit a person would use.
pub fn seconds(seconds: f64) -> String {
    if seconds < 1e-3 {
        format!("{:.0} us", seconds * 1e6)
    } else if seconds < 1.0 {
        format!("{:.0} ms", seconds * 1e3)
    } else if seconds < 100.0 {
        format!("{seconds:.1} s")
    } else if seconds < 1e4 {
        format!("{:.0} min", seconds / 60.0)
    } else if seconds < 1e9 {
        format!("{:.0} h", seconds / 3600.0)
    } else {
        format!("{:.0e} a", seconds / 3.156e7)
    }
}

/// `value ± error` in 17 columns: the value to the digit after the first of its error.
pub(crate) fn cell(it: Option<Estimate>) -> String {
    let Some(Estimate { value, error, .. }) = it.filter(|it| it.value.is_finite()) else {
        return "-".into();
    };
    let (size, plain) = (value.abs().max(error), value.abs().max(error) >= 1e-4);
    if value == 0.0 {
        return if error == 0.0 {
            "0 exactly".into()
        } else {
            format!("0 ± {error:.0e}")
        };
    }
    if !plain || size >= 1e5 {
        let text = |digits: usize| format!("{value:.digits$e} ± {error:.0e}");
        let warranted = value.abs().log10().floor() - error.log10().floor() + 1.0;
        // Exponents of three digits leave room for fewer digits before them.
        return (0..=warranted.clamp(0.0, 6.0) as usize)
            .rev()
            .map(text)
            .find(|it| it.chars().count() <= 17)
            .unwrap_or(text(0));
    }
    let digits = if error > 0.0 {
        (1.0 - error.log10().floor()).clamp(0.0, 6.0) as usize
    } else {
        6
    };
    // Never more than nine characters before the sign of the error.
    let digits = digits.min(6usize.saturating_sub(size.log10().floor().max(0.0) as usize));
    let error = match error {
        0.0 => "0".into(),
        // 848 ± 30: one digit and its zeros, no power of ten.
        1.0..1e4 => {
            let power = 10f64.powf(error.log10().floor());
            format!("{}", (error / power).round() * power)
        }
        _ => format!("{error:.0e}"),
    };
    let room = 14usize.saturating_sub(error.len());
    let fits = |digits: &usize| format!("{value:.digits$}").len() <= room;
    let digits = (0..=digits).rev().find(fits).unwrap_or(0);
    let number = format!("{value:.digits$}");
    // Nothing is left of a value far below its error: no sign either.
    let nothing = number.bytes().all(|c| matches!(c, b'-' | b'0' | b'.'));
    let number = if nothing {
        number.trim_start_matches('-')
    } else {
        &number
    };
    format!("{number} ± {error}")
}

/// Prints the error with two significant digits and the value to the digit where the error starts.
impl fmt::Display for Estimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { value, error, .. } = *self;
        if !value.is_finite() {
            return write!(f, "{value}");
        }
        let small = value != 0.0 && value.abs() < 1e-4;
        if small || value.abs() >= 1e7 {
            return write!(f, "{value:.6e} ± {error:.1e}");
        }
        let digits = if error > 0.0 {
            (-error.log10().floor()) as i32 + 1
        } else {
            9
        };
        let digits = digits.clamp(0, 9) as usize;
        write!(f, "{value:.digits$} ± {error:.1e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Origin;

    #[test]
    fn a_cell_shows_the_value_to_the_digit_of_its_error_and_fits() {
        let cell = |value: f64, error: f64| cell(Some(Estimate::new(value, error, Origin::Space)));
        assert_eq!(cell(-0.164_547_9, 1e-14), "-0.164548 ± 1e-14");
        assert_eq!(cell(-0.1641, 2.8e-3), "-0.1641 ± 3e-3");
        assert_eq!(cell(1.7725e-17, 4e-29), "1.773e-17 ± 4e-29");
        assert_eq!(cell(f64::NAN, 0.0), "-");
        assert_eq!(cell(0.0, 0.0), "0 exactly");
        assert_eq!(cell(-1288.9, 1e-10), "-1288.900 ± 1e-10");
        assert_eq!(cell(847.59, 26.6), "848 ± 30");
        assert_eq!(cell(42.38, 1.33), "42.4 ± 1");
        for value in [0.0, 1.0, -3.25, 99_999.9, -1e300, 1e-300, -94.247_779] {
            for error in [0.0, 1e-300, 1e-14, 3e-3, 20.0, 1e9] {
                let text = cell(value, error);
                assert!(text.chars().count() <= 17, "{text}");
            }
        }
    }

    #[test]
    fn the_times_shown_are_spread_and_end_with_the_last() {
        assert_eq!(spread(0, 6), Vec::<usize>::new());
        assert_eq!(spread(3, 6), [0, 1, 2]);
        assert_eq!(spread(600, 6), [99, 199, 299, 399, 499, 599]);
    }

    #[test]
    fn sizes_and_times_read_like_a_person_s() {
        assert_eq!(bytes(8_000_000_000), "8.0 GB");
        assert_eq!(bytes(65_536), "66 kB");
        assert_eq!(seconds(0.0042), "4 ms");
        assert_eq!(seconds(600.0), "10 min");
    }
}
