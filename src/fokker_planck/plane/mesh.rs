//! Mapped tensor meshes: cell i of an axis spans xi in [i, i+1] of a smooth map x(xi).

use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use crate::roots::rising;

/// A smooth monotone map from the mesh coordinate s to x; slope 1 where the mesh is finest.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Grading {
    /// x = s.
    Uniform,
    /// x = s - beta w ln(1 + e^{(knee - s)/w}): slope 1 right of the knee, 1 + beta left of it.
    Left { beta: f64, knee: f64, width: f64 },
}

impl Grading {
    fn at(self, s: f64) -> (f64, f64) {
        match self {
            Self::Uniform => (s, 1.0),
            Self::Left { beta, knee, width } => {
                let z = (knee - s) / width;
                // ln(1 + e^z) and its slope, without overflow.
                let e = (-z.abs()).exp();
                let softplus = z.max(0.0) + e.ln_1p();
                let above = if z > 0.0 { 1.0 } else { e };
                let logistic = above / (1.0 + e);
                (s - beta * width * softplus, 1.0 + beta * logistic)
            }
        }
    }

    /// s with x(s) = x.
    #[inline]
    fn inverse(self, x: f64) -> f64 {
        let Self::Left { beta, knee, width } = self else {
            return x;
        };
        // x(s) is s at most, and ln(1 + e^z) at most ln 2 more than z, or than 0.
        let (low, high) = (x, x.max(knee) + beta * width * std::f64::consts::LN_2);
        let s = if x > knee {
            x
        } else {
            knee + (x - knee) / (1.0 + beta)
        };
        let beyond = |s: f64| {
            let (value, slope) = self.at(s);
            (value - x, slope)
        };
        // What is left of a step is the square of it.
        rising(beyond, [low, high], s, 1e-9 * width)
    }
}

/// Cells finer around a few places: u = s + sum_k b_k w f((s - s_k)/w), f(z) = z/sqrt(1 + z^2), where s is the coordinate
/// of the [`Grading`] and cells are equal in u: 1 + b_k times as fine at s_k where no other is near, and a smooth map. Known from s to u.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Focus {
    /// Each place with its b; on an axis in s.
    places: Vec<[f64; 2]>,
    width: f64,
}

impl Focus {
    /// Cells that are 1 + b times as fine at each of some places x, within about `width` of it.
    pub(crate) fn new(places: Vec<[f64; 2]>, width: f64) -> Self {
        Self { places, width }
    }

    /// The same in s, for the places within two limits.
    fn on(&self, grading: Grading, [low, high]: [f64; 2]) -> Self {
        let inside = self.places.iter().filter(|[x, _]| *x > low && *x < high);
        Self {
            places: inside.map(|[x, b]| [grading.inverse(*x), *b]).collect(),
            width: self.width,
        }
    }

    /// What it adds to a length between two limits, over the width of a cell elsewhere.
    pub(crate) fn more(&self, [low, high]: [f64; 2]) -> f64 {
        let inside = self.places.iter().filter(|[x, _]| *x > low && *x < high);
        inside.map(|[_, b]| 2.0 * b * self.width).sum()
    }

    /// u and du/ds.
    #[inline]
    fn of(&self, s: f64) -> [f64; 2] {
        let mut sum = [s, 1.0];
        for [at, b] in &self.places {
            let z = (s - at) / self.width;
            let root = (1.0 + z * z).sqrt();
            sum[0] += b * self.width * z / root;
            sum[1] += b / (root * root * root);
        }
        sum
    }

    /// s with u(s) = u.
    fn inverse(&self, u: f64) -> f64 {
        let most: f64 = self.places.iter().map(|[_, b]| b * self.width).sum();
        if most == 0.0 {
            return u;
        }
        let beyond = |s: f64| {
            let [value, slope] = self.of(s);
            (value - u, slope)
        };
        // What is left of a step is the square of it.
        rising(beyond, [u - most, u + most], u, 1e-9 * self.width)
    }
}

/// One axis of a mesh: x(xi) with cell i between xi = i and xi = i + 1, its centre at i + 1/2.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    grading: Grading,
    focus: Focus,
    start: f64,
    width: f64,
    edges: Vec<f64>,
    centres: Vec<f64>,
    slopes: Vec<f64>,
}

impl Axis {
    /// `n` equal cells on [low, high].
    ///
    /// # Errors
    /// [`Error::Invalid`] for no cells or an empty interval.
    pub fn uniform(low: f64, high: f64, n: usize) -> Result<Self> {
        if n == 0 {
            let accepted = "at least one cell in each direction";
            return Err(Error::invalid("method.cells", n, accepted));
        }
        if !(low < high && low.is_finite() && high.is_finite()) {
            let value = format!("[{low}, {high}]");
            let (name, accepted) = ("the interval of an axis", "low < high, finite");
            return Err(Error::invalid(name, value, accepted));
        }
        let width = (high - low) / n as f64;
        let even = (Grading::Uniform, Focus::default());
        Ok(Self::new(even, low, width, n))
    }

    fn new((grading, focus): (Grading, Focus), start: f64, width: f64, n: usize) -> Self {
        let mut it = Self {
            grading,
            focus,
            start,
            width,
            edges: Vec::new(),
            centres: Vec::new(),
            slopes: Vec::new(),
        };
        it.edges = (0..=n).map(|i| it.at(i as f64).0).collect();
        (it.centres, it.slopes) = (0..n).map(|i| it.at(i as f64 + 0.5)).unzip();
        it
    }

    /// The displacement axis of a contact law at temperature T: covers [low, high] with `margin` more
    /// cells at either end, fine in the contact and coarser in flight where the flight is long
    /// (T above the width of the contact), with a cell edge exactly on the loss point, and on a second kink of the force
    /// where no cell need be wider than their distance.
    ///
    /// # Errors
    /// [`Error::Mesh`] for fewer cells than the margins need.
    pub fn displacement(
        contact: &ContactLaw,
        temperature: f64,
        [low, high]: [f64; 2],
        n: usize,
        margin: usize,
    ) -> Result<Self> {
        let none = Focus::default();
        let temperatures = [temperature; 2];
        Self::focused(contact, temperatures, [low, high], (n, margin), &none)
    }

    /// The same with cells finer around some places, and a temperature in contact and one in flight: that of a law whose flights
    /// reach to so many times it.
    pub(crate) fn focused(
        contact: &ContactLaw,
        temperatures: [f64; 2],
        [low, high]: [f64; 2],
        (n, margin): (usize, usize),
        focus: &Focus,
    ) -> Result<Self> {
        check_count(n, margin, "q")?;
        let grading = grading(contact, temperatures, low);
        let focus = focus.on(grading, [low, high]);
        let place = |x: f64| focus.of(grading.inverse(x))[0];
        let made = |start: f64, width: f64| Self::new((grading, focus.clone()), start, width, n);
        let (s_low, s_high) = (place(low), place(high));
        let inner = (n - 2 * margin) as f64;
        let mut width = (s_high - s_low) / inner;
        let mut start = s_low - margin as f64 * width;
        let mut kinks = contact.kinks();
        kinks.retain(|x| *x > low && *x < high);
        if let [first, last] = kinks[..] {
            // Whole cells between the two.
            let [a, b] = [first, last].map(place);
            // Of a contact that is its own mirror image the mesh is too: as many cells on either side.
            let mirrored = ((a - s_low) - (s_high - b)).abs() < 1e-6 * (s_high - s_low);
            let whole = |width: f64| {
                let count = ((b - a) / width).floor().max(1.0);
                let odd = mirrored && (n as f64 - count) % 2.0 != 0.0;
                let count = match count {
                    1.0 if odd => 2.0,
                    _ if odd => count - 1.0,
                    _ => count,
                };
                (b - a) / count
            };
            // As many cells more as the two edges take from the margins.
            let wider = whole((s_high - s_low) / (inner - 2.0).max(1.0));
            if wider * inner >= s_high - s_low + wider {
                let cells = [a - s_low, b - a, s_high - b]
                    .map(|length| (length / wider - 1e-9).ceil().max(0.0));
                let spare = (inner - cells.iter().sum::<f64>()).max(0.0);
                let before = margin as f64 + cells[0] + (0.5 * spare).floor();
                let mut axis = made(a - before * wider, wider);
                let between = ((b - a) / wider).round() as usize;
                axis.edges[before as usize] = first;
                axis.edges[before as usize + between] = last;
                return Ok(axis);
            }
        }
        if let Some(loss) = kinks.last().copied() {
            // Widen the cells as little as puts an edge on the loss point and keeps the margins.
            let s_loss = place(loss);
            let best = (margin + 1..n - margin)
                .map(|k| {
                    let left = (s_loss - s_low) / (k - margin) as f64;
                    let right = (s_high - s_loss) / (n - margin - k) as f64;
                    (left.max(right), k)
                })
                .min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((wider, k)) = best {
                width = wider;
                start = s_loss - k as f64 * width;
                let mut axis = made(start, width);
                axis.edges[k] = loss;
                return Ok(axis);
            }
        }
        Ok(made(start, width))
    }

    /// The velocity axis: symmetric, covers [-reach, reach] with `margin` more cells at either end.
    ///
    /// # Errors
    /// [`Error::Mesh`] for fewer cells than the margins need.
    pub fn velocity(reach: f64, n: usize, margin: usize) -> Result<Self> {
        Self::focused_velocity(reach, (n, margin), Focus::default())
    }

    /// The same with cells finer around some places that are symmetric about 0.
    pub(crate) fn focused_velocity(
        reach: f64,
        (n, margin): (usize, usize),
        focus: Focus,
    ) -> Result<Self> {
        check_count(n, margin, "v")?;
        let [half, _] = focus.of(reach);
        let half = half * n as f64 / (n - 2 * margin) as f64;
        let width = 2.0 * half / n as f64;
        Ok(Self::new((Grading::Uniform, focus), -half, width, n))
    }

    /// Number of cells.
    #[expect(clippy::len_without_is_empty)] // what was built has cells
    pub fn len(&self) -> usize {
        self.centres.len()
    }

    /// The n + 1 cell edges.
    pub(crate) fn edges(&self) -> &[f64] {
        &self.edges
    }

    /// The n cell centres, x(i + 1/2).
    pub fn centres(&self) -> &[f64] {
        &self.centres
    }

    /// dx/dxi at the n centres: the local cell width.
    pub fn slopes(&self) -> &[f64] {
        &self.slopes
    }

    /// (x, dx/dxi) at any xi.
    pub(crate) fn at(&self, xi: f64) -> (f64, f64) {
        let s = self.focus.inverse(self.start + self.width * xi);
        let (x, slope) = self.grading.at(s);
        (x, slope * self.width / self.focus.of(s)[1])
    }

    /// The width of a cell at x, were there none that are finer around a place.
    pub(crate) fn usual_width(&self, x: f64) -> f64 {
        self.grading.at(self.grading.inverse(x)).1 * self.width
    }

    /// xi of any x.
    #[inline]
    pub fn locate(&self, x: f64) -> f64 {
        (self.focus.of(self.grading.inverse(x))[0] - self.start) / self.width
    }

    /// Whether all cells are equal.
    pub fn is_uniform(&self) -> bool {
        self.grading == Grading::Uniform && self.focus.places.is_empty()
    }
}

fn check_count(n: usize, margin: usize, axis: &str) -> Result<()> {
    let least = 2 * margin + 2;
    if n < least {
        let what = format!("{n} cells along {axis}, and the stencil needs {least}");
        return Err(Error::mesh(what, "more cells, or a lower order"));
    }
    Ok(())
}

/// Flight falls off over its temperature, contact over the reach of a thermal oscillation at its own: cells in the ratio of
/// the two where flight is the longer, equal cells otherwise.
fn grading(contact: &ContactLaw, [touching, flying]: [f64; 2], low: f64) -> Grading {
    let (Some(loss), None, Some((_, right))) = (
        contact.loss_point(),
        contact.back_wall(),
        contact.turning_points(touching),
    ) else {
        return Grading::Uniform;
    };
    let reach = right - loss;
    let ratio = flying / (-contact.force(loss) * reach);
    // Below a third more, grading buys nothing.
    if ratio < 1.3 || low > loss {
        return Grading::Uniform;
    }
    Grading::Left {
        beta: ratio - 1.0,
        knee: loss - reach,
        width: 0.5 * reach,
    }
}

/// A tensor mesh of (q, v). Arrays on it are row-major: cell (i, j) at i * nv + j, v contiguous.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// Displacement.
    pub q: Axis,
    /// Velocity.
    pub v: Axis,
}

impl Mesh {
    /// Cells in q and in v.
    pub fn cells(&self) -> [usize; 2] {
        [self.q.len(), self.v.len()]
    }

    /// Number of cells.
    #[expect(clippy::len_without_is_empty)] // what was built has cells
    pub fn len(&self) -> usize {
        self.q.len() * self.v.len()
    }

    /// q_lo, q_hi, v_lo, v_hi.
    pub fn domain(&self) -> [f64; 4] {
        let (q, v) = (self.q.edges(), self.v.edges());
        [q[0], q[q.len() - 1], v[0], v[v.len() - 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_edge_lies_on_the_loss_point_and_the_domain_is_covered() {
        for (t, low, high) in [(0.63, -12.0, 4.5), (94.0, -1690.0, 36.0), (0.01, -0.4, 0.5)] {
            let axis = Axis::displacement(&ContactLaw::Hertz, t, [low, high], 160, 5).unwrap();
            let edges = axis.edges();
            assert!(edges.windows(2).all(|w| w[0] < w[1]));
            assert!(edges[5] <= low + 1e-9 && edges[155] >= high - 1e-9);
            if low < -1.5 {
                assert!(edges.contains(&-1.5), "T = {t}");
            }
            println!(
                "T = {t}: cell widths {:.3} to {:.3}",
                axis.slopes()[159],
                axis.slopes()[0]
            );
        }
    }

    #[test]
    fn the_map_is_smooth_and_its_inverse_is_its_inverse() {
        let axis = Axis::displacement(&ContactLaw::Hertz, 94.0, [-1700.0, 37.0], 200, 5).unwrap();
        assert!(!axis.is_uniform());
        for k in -20..=2100 {
            let xi = 0.1 * f64::from(k);
            let (x, slope) = axis.at(xi);
            assert!((axis.locate(x) - xi).abs() < 1e-9, "{xi}");
            let difference = (axis.at(xi + 1e-4).0 - axis.at(xi - 1e-4).0) / 2e-4;
            assert!((difference / slope - 1.0).abs() < 1e-6, "{xi}");
        }
    }

    #[test]
    fn cells_are_as_much_finer_at_a_kink_as_asked_on_a_smooth_map() {
        let law = &ContactLaw::Hertz;
        let equal = Axis::displacement(law, 94.0, [-1700.0, 37.0], 200, 5).unwrap();
        let width = |axis: &Axis, x: f64| axis.at(axis.locate(x)).1;
        // At twenty times Newton's method alone goes to and fro about the kink.
        for (more, n) in [(3.0, 240), (20.0, 400)] {
            let focus = Focus::new(vec![[-1.5, more], [-9e9, 5.0]], 4.0);
            let axis = Axis::focused(law, [94.0; 2], [-1700.0, 37.0], (n, 5), &focus).unwrap();
            assert!(axis.edges().contains(&-1.5) && !axis.is_uniform());
            assert!(axis.edges().windows(2).all(|w| w[0] < w[1]));
            let finer = width(&equal, -1.5) / width(&axis, -1.5);
            let elsewhere = width(&equal, -1000.0) / width(&axis, -1000.0);
            let asked = 1.0 + more;
            assert!(
                (finer / elsewhere / asked - 1.0).abs() < 0.03,
                "{finer} {elsewhere}"
            );
            for k in -20..=10 * n as i32 + 20 {
                let xi = 0.1 * f64::from(k);
                let (x, slope) = axis.at(xi);
                assert!((axis.locate(x) - xi).abs() < 1e-8, "{xi}");
                let difference = (axis.at(xi + 1e-4).0 - axis.at(xi - 1e-4).0) / 2e-4;
                assert!((difference / slope - 1.0).abs() < 1e-6, "{xi}");
            }
        }
    }

    #[test]
    fn a_mesh_smaller_than_its_stencil_is_refused() {
        assert!(Axis::velocity(3.0, 7, 5).is_err());
        assert!(Axis::uniform(0.0, 1.0, 0).is_err());
        assert!(Axis::uniform(1.0, 0.0, 3).is_err());
    }
}
