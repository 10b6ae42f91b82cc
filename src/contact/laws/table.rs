//! A force given by points: a measured curve.

use crate::contact::kind::Kind;
use crate::contact::parameters::{Parameter, Parameters, full};
use crate::contact::piece::{self, Piece};
use crate::contact::restoring::Restoring;
use crate::error::{Error, Result};
use crate::format::{many, num};
use std::sync::Arc;

pub(super) const KIND: Kind = Kind {
    name: "table",
    keys: &["file", "q", "force"],
    make,
};

/// Names of columns that are accepted.
const COLUMNS: &str = "the columns q and G in this order, both dimensionless (displacement and force as in (9)), or no names";

/// Points beyond which a table is refused: every point is a kink of the third derivative.
const MOST: usize = 10_000;

/// G through points: a cubic spline, twice differentiable between the first and the last, and a straight line beyond
/// them. Where the first points have all one force, that is flight: G is constant up to the last of them, and contact is
/// lost there.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    file: Option<String>,
    points: Vec<[f64; 2]>,
    pieces: Vec<Piece>,
    /// U at the centre of each piece.
    potentials: Vec<f64>,
    loss: Option<f64>,
}

fn make(given: &Parameters) -> Result<Arc<dyn Restoring>> {
    let file = given.text("file")?;
    let points = match (given.numbers("q")?, given.numbers("force")?, file) {
        (Some(q), Some(force), _) => {
            if q.len() != force.len() {
                return Err(given.refuse("force", format!("as many numbers as q has, {}", q.len())));
            }
            q.iter().zip(force).map(|(q, force)| [*q, *force]).collect()
        }
        (None, None, Some(file)) => read(given, file)?,
        (Some(_), None, _) => return Err(given.refuse("force", "a list of numbers, with q")),
        (None, Some(_), _) => return Err(given.refuse("q", "a list of numbers, with force")),
        (None, None, None) => {
            let accepted = "a CSV file with the columns q and G, as \"force.csv\"";
            return Err(given.refuse("file", accepted));
        }
    };
    let about = Origin {
        file,
        points: &points,
    };
    let table = Table::through(&about)?;
    Ok(Arc::new(table))
}

/// Points, and where they come from.
struct Origin<'a> {
    file: Option<&'a str>,
    points: &'a [[f64; 2]],
}

impl Origin<'_> {
    /// An error about the whole.
    fn refuse(&self, value: &str, accepted: impl Into<String>) -> Error {
        match self.file {
            Some(file) => Error::invalid(full("file"), format!("{file:?} with {value}"), accepted),
            None => Error::invalid(full("q"), format!("a table with {value}"), accepted),
        }
    }
}

/// The points of a CSV file: two columns, q and G, with or without a line of names and lines of comment (#).
fn read(given: &Parameters, file: &str) -> Result<Vec<[f64; 2]>> {
    let text = std::fs::read_to_string(given.path(file)).map_err(|source| {
        let path = given.path(file);
        let path = path.display();
        let accepted = format!("a CSV file that can be read, beside the scene; {path}: {source}");
        given.refuse("file", accepted)
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    let mut points: Vec<[f64; 2]> = Vec::new();
    let mut named = false;
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let wrong = |found: &str, accepted: &str| {
            let shown: String = found.chars().take(60).collect();
            let value = format!("{file:?}, line {number}: {shown}");
            Error::invalid(full("file"), value, accepted)
        };
        let fields = line.split([',', ';', '\t']);
        let fields: Vec<&str> = fields.map(|it| it.trim().trim_matches('"')).collect();
        let numbers: Vec<Option<f64>> = fields.iter().map(|it| it.parse().ok()).collect();
        match numbers[..] {
            [Some(q), Some(force)] => {
                if !(q.is_finite() && force.is_finite()) {
                    return Err(wrong(line, "finite numbers"));
                }
                if let Some([before, _]) = points.last()
                    && q <= *before
                {
                    return Err(wrong(&format!("q = {}", num(q)), &ascending(*before)));
                }
                points.push([q, force]);
            }
            // Names of the columns: any others may mean other units.
            _ if points.is_empty() && !named && numbers.iter().all(Option::is_none) => {
                let is = |it: &str, name: &str| it.eq_ignore_ascii_case(name);
                named = matches!(fields[..], [q, force] if is(q, "q") && (is(force, "g") || is(force, "force")));
                if !named {
                    return Err(wrong(line, COLUMNS));
                }
            }
            _ => {
                return Err(wrong(
                    line,
                    "two numbers with decimal points, q and G, separated by a comma, a semicolon or a tab",
                ));
            }
        }
    }
    Ok(points)
}

fn ascending(before: f64) -> String {
    let before = num(before);
    format!("ascending q without repeats; the one before is {before}")
}

impl Table {
    fn through(origin: &Origin<'_>) -> Result<Self> {
        let points = origin.points;
        if !(2..=MOST).contains(&points.len()) {
            let value = many(points.len() as u64, "point");
            return Err(origin.refuse(&value, format!("2 to {MOST} points, ascending in q")));
        }
        for (k, pair) in points.windows(2).enumerate() {
            if pair[1][0] <= pair[0][0] {
                let key = full(&format!("q[{}]", k + 1));
                let (value, accepted) = (num(pair[1][0]), ascending(pair[0][0]));
                return Err(Error::invalid(key, value, accepted));
            }
        }
        let flat = points.iter().take_while(|it| it[1] == points[0][1]).count();
        let (knots, loss) = if flat > 1 && flat < points.len() {
            (&points[flat - 1..], Some(points[flat - 1][0]))
        } else {
            (points, None)
        };
        let slopes = slopes(knots);
        let (first, last) = (knots[0], knots[knots.len() - 1]);
        let ends = [
            if loss.is_some() { 0.0 } else { slopes[0] },
            slopes[slopes.len() - 1],
        ];
        let line = |from: f64, [q, force]: [f64; 2], slope: f64| Piece {
            from,
            centre: q,
            coefficients: [force, slope, 0.0, 0.0],
        };
        let mut pieces = vec![line(f64::NEG_INFINITY, first, ends[0])];
        for (pair, slope) in knots.windows(2).zip(slopes.windows(2)) {
            pieces.push(hermite([pair[0], pair[1]], [slope[0], slope[1]]));
        }
        pieces.push(line(last[0], last, ends[1]));
        confines(origin, (points[0], ends[0]), (last, ends[1]))?;
        // From the first point on, and then counted from q = 0.
        let mut potentials = vec![0.0];
        let mut sum = 0.0;
        for pair in pieces[1..].windows(2) {
            potentials.push(sum);
            sum += pair[0].work(pair[1].from);
        }
        potentials.push(sum);
        let mut it = Self {
            file: origin.file.map(str::to_owned),
            points: points.to_vec(),
            pieces,
            potentials,
            loss,
        };
        let zero = it.potential(0.0);
        it.potentials.iter_mut().for_each(|it| *it -= zero);
        Ok(it)
    }
}

/// Refuses a force that does not push back far from the points.
fn confines(
    origin: &Origin<'_>,
    ([q0, g0], left): ([f64; 2], f64),
    ([q1, g1], right): ([f64; 2], f64),
) -> Result<()> {
    let far = |slope: f64, force: f64| if slope == 0.0 { force } else { slope };
    // To the left a rising force becomes negative.
    if !(left > 0.0 || (left == 0.0 && g0 < 0.0)) {
        let (g, slope, q) = (num(g0), num(left), num(q0));
        let value = format!("G = {g} and slope {slope} at its first point (q = {q})");
        let accepted = "a force that confines: below the first point it must fall to the left, or be constant and < 0";
        return Err(origin.refuse(&value, accepted));
    }
    if far(right, g1) <= 0.0 {
        let (g, slope, q) = (num(g1), num(right), num(q1));
        let value = format!("G = {g} and slope {slope} at its last point (q = {q})");
        let accepted =
            "a force that confines: beyond the last point it must rise, or be constant and > 0";
        return Err(origin.refuse(&value, accepted));
    }
    Ok(())
}

/// Slopes of the spline at its knots: continuous second derivatives inside, those of the parabola through three
/// points at the ends, without a change of sign (Fritsch and Carlson, SIAM J. Numer. Anal. 17:238, 1980).
fn slopes(knots: &[[f64; 2]]) -> Vec<f64> {
    let n = knots.len();
    let widths: Vec<f64> = knots.windows(2).map(|w| w[1][0] - w[0][0]).collect();
    let secant = |w: &[[f64; 2]]| (w[1][1] - w[0][1]) / (w[1][0] - w[0][0]);
    let secants: Vec<f64> = knots.windows(2).map(secant).collect();
    if n == 2 {
        return vec![secants[0]; 2];
    }
    let end = |[h0, h1]: [f64; 2], [d0, d1]: [f64; 2]| {
        let slope = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1);
        if slope * d0 <= 0.0 { 0.0 } else { slope }
    };
    let first = end([widths[0], widths[1]], [secants[0], secants[1]]);
    let last = end(
        [widths[n - 2], widths[n - 3]],
        [secants[n - 2], secants[n - 3]],
    );
    // Thomas's algorithm; the matrix is dominated by its diagonal.
    let (mut beside, mut right) = (vec![0.0; n], vec![first; n]);
    for k in 1..n - 1 {
        let (h0, h1) = (widths[k - 1], widths[k]);
        let pivot = 2.0 * (h0 + h1) - h1 * beside[k - 1];
        let sum = 3.0 * (h1 * secants[k - 1] + h0 * secants[k]);
        beside[k] = h0 / pivot;
        right[k] = (sum - h1 * right[k - 1]) / pivot;
    }
    right[n - 1] = last;
    for k in (1..n - 1).rev() {
        right[k] -= beside[k] * right[k + 1];
    }
    right
}

/// The cubic between two points with these slopes.
fn hermite([[q0, g0], [q1, g1]]: [[f64; 2]; 2], [s0, s1]: [f64; 2]) -> Piece {
    let width = q1 - q0;
    let secant = (g1 - g0) / width;
    Piece {
        from: q0,
        centre: q0,
        coefficients: [
            g0,
            s0,
            (3.0 * secant - 2.0 * s0 - s1) / width,
            (s0 + s1 - 2.0 * secant) / (width * width),
        ],
    }
}

impl Restoring for Table {
    fn name(&self) -> &'static str {
        KIND.name
    }

    fn force(&self, q: f64) -> f64 {
        self.pieces[piece::place(&self.pieces, q)].force(q)
    }

    fn potential(&self, q: f64) -> f64 {
        let k = piece::place(&self.pieces, q);
        self.potentials[k] + self.pieces[k].work(q)
    }

    fn stiffness(&self, q: f64) -> f64 {
        self.pieces[piece::place(&self.pieces, q)].stiffness(q)
    }

    fn loss_point(&self) -> Option<f64> {
        self.loss
    }

    fn roots(&self, force: f64) -> Vec<f64> {
        piece::roots(&self.pieces, force)
    }

    fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// The points themselves, so that a resolved scene stands alone; the file is where they come from.
    fn parameters(&self) -> Parameters {
        let column = |k: usize| Parameter::Numbers(self.points.iter().map(|it| it[k]).collect());
        let all = Parameters::new()
            .with("q", column(0))
            .with("force", column(1));
        match &self.file {
            Some(file) => all.with("file", Parameter::Text(file.clone())),
            None => all,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(points: &[[f64; 2]]) -> Result<Table> {
        Table::through(&Origin { file: None, points })
    }

    fn sampled(low: f64, high: f64, n: usize, force: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
        (0..=n)
            .map(|k| low + (high - low) * k as f64 / n as f64)
            .map(|q| [q, force(q)])
            .collect()
    }

    #[test]
    fn the_spline_passes_its_points_with_two_continuous_derivatives_and_is_a_line_beyond() {
        let points = sampled(-3.0, 3.0, 24, |q| q + 0.3 * (2.0 * q).sin());
        let it = table(&points).unwrap();
        for [q, force] in &points {
            assert!((it.force(*q) - force).abs() < 1e-14);
        }
        let second = |q: f64| (it.stiffness(q + 1e-7) - it.stiffness(q - 1e-7)) / 2e-7;
        for [q, _] in &points[1..24] {
            let s = 1e-5;
            assert!((it.stiffness(q - 1e-12) - it.stiffness(q + 1e-12)).abs() < 1e-9);
            assert!((second(q - s) - second(q + s)).abs() < 1e-3, "{q}");
        }
        for q in [-7.0, 8.0] {
            assert!(second(q).abs() < 1e-6);
        }
    }

    #[test]
    fn the_potential_is_the_integral_of_the_force_and_vanishes_at_zero() {
        let it = table(&sampled(-2.0, 2.5, 9, |q| q.powi(3) - q)).unwrap();
        assert_eq!(it.potential(0.0), 0.0);
        for q in [-5.0f64, -1.3, -0.2, 0.7, 2.2, 4.0] {
            let breaks: Vec<f64> = it
                .points
                .iter()
                .map(|p| p[0])
                .filter(|p| *p > q.min(0.0) && *p < q.max(0.0))
                .collect();
            let breaks = [&[q.min(0.0)], &breaks[..], &[q.max(0.0)]].concat();
            let exact =
                crate::quadrature::integrate(|q| it.force(q), &breaks, 1e-15).value * q.signum();
            assert!(
                (it.potential(q) - exact).abs() < 1e-13 * exact.abs().max(1.0),
                "{q}"
            );
        }
        assert_eq!(it.roots(0.0).len(), 3);
    }

    #[test]
    fn four_times_as_many_points_of_a_smooth_force_err_a_hundred_times_less() {
        let force = |q: f64| q + 0.1 * q.powi(3) + 0.2 * (1.5 * q).cos();
        let worst = |n: usize| {
            let it = table(&sampled(-2.0, 2.0, n, force)).unwrap();
            (-1500..1500)
                .map(|k| 1e-3 * f64::from(k))
                .map(|q| (it.force(q) - force(q)).abs())
                .fold(0.0, f64::max)
        };
        let [coarse, fine] = [10, 40].map(worst);
        println!("10 and 40 cells: {coarse:.1e}, {fine:.1e}");
        assert!(coarse < 5e-3 && fine < 0.01 * coarse);
    }

    #[test]
    fn points_of_one_force_at_the_beginning_are_flight() {
        let hertz = |q: f64| (1.0 + q * (2.0 / 3.0)).max(0.0).powf(1.5) - 1.0;
        let it = table(&sampled(-3.0, 3.0, 60, hertz)).unwrap();
        assert_eq!(it.loss_point(), Some(-1.5));
        assert_eq!([it.force(-10.0), it.force(-1.7)], [-1.0, -1.0]);
        assert!((it.force(0.05) - hertz(0.05)).abs() < 1e-4);
        assert!((it.potential(-4.0) - (4.0 - 0.6)).abs() < 2e-3);
    }

    #[test]
    fn a_table_that_does_not_confine_is_refused() {
        for (points, word) in [
            (vec![[-1.0, 1.0], [0.0, 0.0], [1.0, 1.0]], "first point"),
            (vec![[-1.0, -1.0], [0.0, 0.0], [1.0, -1.0]], "last point"),
            (vec![[-1.0, 0.0], [0.0, 0.0], [1.0, 1.0]], "first point"),
            (vec![[0.0, 0.0]], "points"),
            (vec![[0.0, -1.0], [0.0, 1.0]], "ascending"),
        ] {
            let message = table(&points).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        }
    }
}
