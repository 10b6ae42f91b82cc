//! A probability density on a mesh, kept as probability per cell.

use super::excess::modulus_in_cell;
use super::flux::{Drift, Weights};
use super::generator::Generator;
use super::mesh::{Axis, Mesh};
use crate::error::{Error, Result};
use crate::gaussian::{gaussian_mass, normal};
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use ndarray::{Array1, Array2};
use std::ops::Range;

/// Probability per cell, row-major (q, v). For the central schemes the density at the cell centre
/// times dq/dxi dv/deta; for upwind the exact cell mass.
#[derive(Debug, Clone, PartialEq)]
pub struct Density {
    mesh: Mesh,
    cells: Vec<f64>,
}

/// A density at one time, as arrays.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// The time.
    pub t: f64,
    /// Cell centres in q.
    pub q: Array1<f64>,
    /// Cell centres in v.
    pub v: Array1<f64>,
    /// p\[q, v\] as a density.
    pub p: Array2<f64>,
}

impl Snapshot {
    /// Widths of cells along q and v, from their centres: exact for equal cells and of second order for graded ones.
    pub fn cell_widths(&self) -> [Vec<f64>; 2] {
        [&self.q, &self.v].map(|centres| {
            let last = centres.len().saturating_sub(1);
            let width = |k: usize| {
                let (below, above) = (k.saturating_sub(1), (k + 1).min(last));
                (centres[above] - centres[below]) / (above - below).max(1) as f64
            };
            (0..centres.len()).map(width).collect()
        })
    }
}

impl Density {
    /// Narrowest Gaussian a central scheme can hold, in cells: sampled at 1.5 cells per deviation the
    /// sum of a Gaussian is exact to exp(-2 pi^2 1.5^2) = 5e-20, and its derivative of order 8 to 1e-2.
    pub(crate) const NARROWEST: f64 = 0.75;

    /// The start, on the unknowns of `generator`: what lies outside of them is left out.
    ///
    /// # Errors
    /// [`Error::Mesh`] if a Gaussian is narrower than 1.5 cells of a central scheme;
    /// [`Error::Invalid`] for a start at rest, which no mesh can hold.
    pub fn start(generator: &Generator, initial: &Initial) -> Result<Self> {
        let upwind = generator.drift() == Drift::Upwind;
        let cells = (generator.mesh(), generator.columns());
        Self::begun(cells, generator.weights(), initial, upwind)
    }

    /// The start at every centre of a mesh, for the central weights, where there is no generator.
    pub(crate) fn everywhere(mesh: &Mesh, weights: &Weights, initial: &Initial) -> Result<Self> {
        let all = vec![0..mesh.v.len(); mesh.q.len()];
        Self::begun((mesh, &all), weights, initial, false)
    }

    fn begun(
        (mesh, columns): (&Mesh, &[Range<usize>]),
        weights: &Weights,
        initial: &Initial,
        exact: bool,
    ) -> Result<Self> {
        match *initial {
            Initial::Rest => Err(Error::invalid(
                "initial.kind",
                "\"rest\"",
                "on a mesh, a \"gaussian\" initial condition with a small deviation",
            )),
            Initial::Stationary => Ok(Self::weighed(mesh, columns, weights)),
            Initial::Gaussian { mean, deviation } => {
                let q = gaussian(&mesh.q, mean[0], deviation[0], exact, "q")?;
                let v = gaussian(&mesh.v, mean[1], deviation[1], exact, "v")?;
                Ok(Self::on(mesh, columns, |i, j| q[i] * v[j]))
            }
        }
    }

    /// The weights as a density: the law that g is taken against.
    pub(super) fn weighed(mesh: &Mesh, columns: &[Range<usize>], weights: &Weights) -> Self {
        Self::on(mesh, columns, |i, j| weights.at(i, j))
    }

    /// p(q, v) at the centres of the cells that hold unknowns, asked for all at once.
    pub(super) fn sampled(
        mesh: &Mesh,
        columns: &[Range<usize>],
        p: &dyn Fn(&[[f64; 2]]) -> Vec<f64>,
    ) -> Self {
        let Mesh { q, v } = mesh;
        let places = || {
            let column = |(i, range): (usize, &Range<usize>)| range.clone().map(move |j| (i, j));
            columns.iter().enumerate().flat_map(column)
        };
        let points: Vec<[f64; 2]> = places()
            .map(|(i, j)| [q.centres()[i], v.centres()[j]])
            .collect();
        let mut cells = vec![0.0; mesh.len()];
        for ((i, j), p) in places().zip(p(&points)) {
            cells[i * v.len() + j] = p * q.slopes()[i] * v.slopes()[j];
        }
        Self {
            mesh: mesh.clone(),
            cells,
        }
    }

    /// A start given in code as a density p(q, v), sampled at the cell centres.
    pub fn from_fn(generator: &Generator, p: impl Fn(f64, f64) -> f64) -> Self {
        let Mesh { q, v } = generator.mesh();
        Self::on(generator.mesh(), generator.columns(), |i, j| {
            p(q.centres()[i], v.centres()[j]) * q.slopes()[i] * v.slopes()[j]
        })
    }

    /// All probability in the cell that holds the equilibrium: the narrowest start of a mesh, for schemes
    /// that stay positive.
    pub fn at_equilibrium(generator: &Generator, oscillator: &Oscillator) -> Self {
        let mesh = generator.mesh();
        let q0 = oscillator.contact().equilibrium().unwrap_or(0.0);
        let place = |axis: &Axis, x: f64| (axis.locate(x).max(0.0) as usize).min(axis.len() - 1);
        let (i, j) = (place(&mesh.q, q0), place(&mesh.v, 0.0));
        Self::on(mesh, generator.columns(), |a, b| {
            f64::from(u8::from((a, b) == (i, j)))
        })
    }

    fn on(mesh: &Mesh, columns: &[Range<usize>], cell: impl Fn(usize, usize) -> f64) -> Self {
        let mut cells = vec![0.0; mesh.len()];
        for (i, column) in columns.iter().enumerate() {
            for j in column.clone() {
                cells[i * mesh.v.len() + j] = cell(i, j);
            }
        }
        Self {
            mesh: mesh.clone(),
            cells,
        }
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Probability per cell.
    pub fn cells(&self) -> &[f64] {
        &self.cells
    }

    /// Probability per cell, to be changed by an integrator.
    pub fn cells_mut(&mut self) -> &mut [f64] {
        &mut self.cells
    }

    /// g = P/w on the cells that hold unknowns, 0 elsewhere; row-major.
    pub fn ratio(&self, generator: &Generator) -> Vec<f64> {
        let inverse = generator.inverse_weights();
        self.cells.iter().zip(inverse).map(|(p, w)| p * w).collect()
    }

    /// Total probability.
    pub fn mass(&self) -> f64 {
        self.cells.iter().sum()
    }

    /// Scales it to probability 1 and says what it had.
    pub(super) fn normalise(&mut self) -> f64 {
        let mass = self.mass();
        for p in &mut self.cells {
            *p /= mass;
        }
        mass
    }

    /// Sum of the negative cells, as a positive number.
    pub fn negative_mass(&self) -> f64 {
        self.cells.iter().map(|p| (-p).max(0.0)).sum()
    }

    /// p at the cell centres.
    pub(crate) fn snapshot(&self, t: f64) -> Snapshot {
        let Mesh { q, v } = &self.mesh;
        let p = Array2::from_shape_fn((q.len(), v.len()), |(i, j)| {
            self.cells[i * v.len() + j] / (q.slopes()[i] * v.slopes()[j])
        });
        let array = |axis: &Axis| Array1::from_vec(axis.centres().to_vec());
        Snapshot {
            t,
            q: array(q),
            v: array(v),
            p,
        }
    }

    /// Smallest value of p on the mesh: negative where the scheme undershoots.
    pub fn lowest(&self) -> f64 {
        let Mesh { q, v } = &self.mesh;
        let area = |k: usize| q.slopes()[k / v.len()] * v.slopes()[k % v.len()];
        let densities = self.cells.iter().enumerate().map(|(k, p)| p / area(k));
        densities.fold(f64::INFINITY, f64::min)
    }

    /// L1 distance to another density on this mesh: what that holds less inside the domain, it holds outside. Of order 3 where the
    /// difference changes sign inside of cells; as accurate as its sum where it does not.
    pub(crate) fn distance_to(&self, law: &Self, columns: &[Range<usize>]) -> f64 {
        let nv = self.mesh.v.len();
        let outside = || std::iter::repeat_n(0.0, nv);
        let both = self.cells.iter().zip(&law.cells).map(|(p, law)| p - law);
        let change: Vec<f64> = outside().chain(both).chain(outside()).collect();
        let (mut inside, mut more) = (0.0, 0.0);
        for (i, column) in columns.iter().enumerate() {
            let first = (i + 1) * nv + column.start;
            let at = |first: usize| &change[first..first + column.len()];
            let along_q = at(first - nv).iter().zip(at(first + nv));
            let along_v = at(first - 1).iter().zip(at(first + 1));
            for ((own, (a, b)), (c, d)) in at(first).iter().zip(along_q).zip(along_v) {
                inside += modulus_in_cell(*own, [[*a, *b], [*c, *d]]);
                more += own;
            }
        }
        inside + f64::max(more, 0.0)
    }

    /// Relative entropy to another density on this mesh, over the cells where both are positive: falls to 0 at the stationary
    /// law.
    pub(crate) fn entropy_to(&self, law: &Self, columns: &[Range<usize>]) -> f64 {
        self.sum_active(law, columns, |p, law| {
            if p > 0.0 && law > 0.0 {
                p * (p / law).ln()
            } else {
                0.0
            }
        })
    }

    /// By how much the relative entropies to two laws can differ: the mean of |ln| of the one over the other.
    pub(crate) fn entropy_between(&self, one: &Self, other: &Self) -> f64 {
        let laws = one.cells.iter().zip(&other.cells);
        let all = self.cells.iter().zip(laws);
        all.map(|(p, (one, other))| entropy_apart(*p, [*one, *other]))
            .sum()
    }

    /// Sums over this density and another.
    fn sum_active(
        &self,
        law: &Self,
        columns: &[Range<usize>],
        mut f: impl FnMut(f64, f64) -> f64,
    ) -> f64 {
        let nv = self.mesh.v.len();
        let column = |(i, range): (usize, &Range<usize>)| -> f64 {
            let cells = i * nv + range.start..i * nv + range.end;
            let both = self.cells[cells.clone()].iter().zip(&law.cells[cells]);
            both.map(|(p, law)| f(*p, *law)).sum()
        };
        columns.iter().enumerate().map(column).sum()
    }
}

/// The integrand of [`Density::entropy_between`]: where one of them is not positive it may be as small as
/// numbers are.
pub(super) fn entropy_apart(p: f64, [one, other]: [f64; 2]) -> f64 {
    if p <= 0.0 {
        0.0
    } else if one > 0.0 && other > 0.0 {
        p * (one / other).ln().abs()
    } else {
        p * -f64::MIN_POSITIVE.ln()
    }
}

/// One factor of a Gaussian start per cell of an axis: exact masses for upwind, point values times
/// widths for the central schemes.
fn gaussian(axis: &Axis, mean: f64, deviation: f64, exact: bool, name: &str) -> Result<Vec<f64>> {
    if exact {
        let mass = |w: &[f64]| gaussian_mass(mean, deviation, w[0], w[1]);
        return Ok(axis.edges().windows(2).map(mass).collect());
    }
    let points = || axis.centres().iter().zip(axis.slopes());
    let near = points().filter(|(x, _)| (**x - mean).abs() < 3.0 * deviation + axis.at(0.0).1);
    let widest = near.map(|(_, slope)| *slope).fold(0.0, f64::max);
    if deviation < Density::NARROWEST * widest {
        let (cells, least) = (deviation / widest, Density::NARROWEST);
        let what = format!(
            "initial.deviation = {deviation} in {name} is {cells:.2} cells, and {least} are needed"
        );
        let needed = (axis.len() as f64 * least * widest / deviation).ceil();
        let help = format!("about {needed:.0} cells along {name}, or a wider initial condition");
        return Err(Error::mesh(what, help));
    }
    let density = |x: f64| normal((x - mean) / deviation) / deviation;
    Ok(points().map(|(x, slope)| density(*x) * slope).collect())
}

#[cfg(test)]
mod tests {
    use super::Density;
    use crate::fokker_planck::mesh::{Axis, Mesh};
    use crate::gaussian::{lower, normal};

    /// Two Gaussians of deviation 1 whose means are `apart` in an oblique direction: the L1 distance is 2 erf(apart/sqrt 8).
    fn error(cells: usize, apart: f64) -> f64 {
        let axis = || Axis::uniform(-9.0, 9.0, cells).unwrap();
        let mesh = Mesh {
            q: axis(),
            v: axis(),
        };
        let columns = vec![0..cells; cells];
        let h = 18.0 / cells as f64;
        let at = |shift: [f64; 2]| {
            let centre = |i: usize, shift: f64| -9.0 + (i as f64 + 0.5) * h - shift;
            Density::on(&mesh, &columns, |i, j| {
                h * h * normal(centre(i, shift[0])) * normal(centre(j, shift[1]))
            })
        };
        let distance =
            at([0.3, -0.2]).distance_to(&at([0.3 + 0.8 * apart, 0.6 * apart - 0.2]), &columns);
        let exact = 2.0 * (2.0 * lower(0.5 * apart) - 1.0);
        (distance - exact).abs()
    }

    #[test]
    fn the_l1_distance_is_of_order_3_where_the_difference_changes_sign_inside_of_cells() {
        let errors = [24, 48, 96, 192].map(|cells| error(cells, 0.7));
        println!("{errors:?}");
        assert!(
            errors[1] < 2e-4 && 512.0 * errors[3] < errors[0],
            "{errors:?}"
        );
    }
}
