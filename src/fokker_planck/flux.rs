//! What crosses a face in the stationary state, and the weights that g = p/p_s is taken against.
//!
//! The stationary mass flux is a curl, p_s (v, -G) = (d psi/dv, -d psi/dq) with psi = -T p_s. Face fluxes
//! taken from psi sum to zero round every cell for any psi, so a flux that carries g with them keeps
//! g = 1 exactly: the discrete stationary law is (21) on any mesh.

use super::difference::central;
use super::mesh::Mesh;
use crate::error::{Error, Result};
use crate::gaussian::{gaussian_mass, maxwell};
use crate::matrix::grid;
use crate::oscillator::{DisplacementLaw, Oscillator};

/// How g is carried across a face.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drift {
    /// From the upwind cell. First order, positive; on a weakly damped oscillator its own diffusion
    /// dwarfs the physical one. The baseline, never the answer.
    Upwind,
    /// Skew-symmetric central differences, order 2.
    Order2,
    /// Skew-symmetric central differences, order 4.
    Order4,
    /// Skew-symmetric central differences, order 6.
    Order6,
    /// Skew-symmetric central differences, order 8.
    Order8,
}

impl Drift {
    /// For tables: "upwind", "order 2" to "order 8".
    pub(crate) fn name(self) -> String {
        match self {
            Self::Upwind => "upwind".to_string(),
            central => format!("order {}", central.order()),
        }
    }

    /// Every choice, lowest order first.
    pub const ALL: [Self; 5] = [
        Self::Upwind,
        Self::Order2,
        Self::Order4,
        Self::Order6,
        Self::Order8,
    ];

    /// Order of accuracy in space.
    pub fn order(self) -> usize {
        match self {
            Self::Upwind => 1,
            central => 2 * central.half_width(),
        }
    }

    /// Neighbours used on either side.
    pub fn half_width(self) -> usize {
        match self {
            Self::Upwind | Self::Order2 => 1,
            Self::Order4 => 2,
            Self::Order6 => 3,
            Self::Order8 => 4,
        }
    }

    /// Cells that a mesh must have beyond the streamlines it carries.
    pub fn margin(self) -> usize {
        self.half_width() + 1
    }
}

/// The measure that g is the density against.
#[derive(Debug, Clone)]
pub enum Measure {
    /// p_s itself, exp(-H/T)/Z: for every contact that confines.
    Gibbs(DisplacementLaw),
    /// Area dq dv, which the undamped motion keeps (Liouville): for contacts without a stationary law.
    Liouville,
}

impl Measure {
    /// The measure that fits an oscillator.
    ///
    /// # Errors
    /// None for the built-in laws; those of [`Oscillator::displacement_law`] for a custom one.
    pub fn of(oscillator: &Oscillator) -> Result<Self> {
        if oscillator.contact().is_confining() {
            Ok(Self::Gibbs(oscillator.displacement_law()?))
        } else {
            Ok(Self::Liouville)
        }
    }

    /// Its factor in q at a point.
    pub(crate) fn density_q(&self, q: f64) -> f64 {
        match self {
            Self::Gibbs(law) => law.density(q),
            Self::Liouville => 1.0,
        }
    }

    /// Its factor in v at a point.
    pub(crate) fn density_v(&self, v: f64, temperature: f64) -> f64 {
        match self {
            Self::Gibbs(_) => maxwell(v, temperature),
            Self::Liouville => 1.0,
        }
    }
}

/// The measure of the cells: w_ij = q_i v_j. Upwind takes the exact cell masses, the central schemes
/// the density at the centre times dq/dxi dv/deta, whose sums are of the scheme's order or better.
#[derive(Debug, Clone)]
pub struct Weights {
    /// Factor of each q cell.
    pub q: Vec<f64>,
    /// Factor of each v cell.
    pub v: Vec<f64>,
    /// The same for the Maxwell density, against which friction and diffusion act; equal to `v` for the
    /// Gibbs measure.
    pub maxwell: Vec<f64>,
    /// Density p_cut at which the stream function of a central scheme is cut; 0 where it is not.
    cut: f64,
    area: [Vec<f64>; 2],
}

impl Weights {
    /// The weights of a scheme on a mesh.
    ///
    /// # Errors
    /// [`Error::Mesh`] if a weight under- or overflows: a domain far wider than the law.
    pub(crate) fn new(
        measure: &Measure,
        mesh: &Mesh,
        temperature: f64,
        drift: Drift,
    ) -> Result<Self> {
        let pairs =
            |edges: &[f64]| -> Vec<[f64; 2]> { edges.windows(2).map(|w| [w[0], w[1]]).collect() };
        let centred = |axis: &super::mesh::Axis, f: &dyn Fn(f64) -> f64| -> Vec<f64> {
            let places = axis.centres().iter().zip(axis.slopes());
            places.map(|(x, slope)| f(*x) * slope).collect()
        };
        let gauss = |x: f64| maxwell(x, temperature);
        let (q, maxwell) = if drift == Drift::Upwind {
            let q = match measure {
                Measure::Gibbs(law) => pairs(mesh.q.edges())
                    .iter()
                    .map(|[a, b]| law.probability(*a, *b))
                    .collect(),
                Measure::Liouville => pairs(mesh.q.edges()).iter().map(|[a, b]| b - a).collect(),
            };
            let deviation = temperature.sqrt();
            let mass = |[a, b]: &[f64; 2]| gaussian_mass(0.0, deviation, *a, *b);
            (q, pairs(mesh.v.edges()).iter().map(mass).collect())
        } else {
            (
                centred(&mesh.q, &|q| measure.density_q(q)),
                centred(&mesh.v, &gauss),
            )
        };
        let v = match measure {
            Measure::Gibbs(_) => maxwell.clone(),
            Measure::Liouville => centred(&mesh.v, &|_| 1.0),
        };
        let area = [mesh.q.slopes().to_vec(), mesh.v.slopes().to_vec()];
        let mut it = Self {
            q,
            v,
            maxwell,
            cut: 0.0,
            area,
        };
        if drift != Drift::Upwind && matches!(measure, Measure::Gibbs(_)) {
            let [q, v] = &it.area;
            let density = |i: usize, j: usize| it.q[i] * it.v[j] / (q[i] * v[j]);
            it.cut = largest_at_edge(mesh.cells(), drift.half_width(), density);
        }
        let smallest = |x: &[f64]| x.iter().copied().fold(f64::INFINITY, f64::min);
        let lowest = smallest(&it.q)
            .min(smallest(&it.v))
            .min(smallest(&it.maxwell));
        if !(lowest.is_finite() && lowest > LOWEST) {
            return Err(underflow());
        }
        Ok(it)
    }

    /// w of cell (i, j). In the boundary cells of a central scheme, where p_s < p_cut, it is held at p_cut/e at the
    /// least: the steep tail beyond the last streamline carries no answer, and would only stiffen the transport.
    pub fn at(&self, i: usize, j: usize) -> f64 {
        let floor = self.cut * (-1f64).exp() * self.area[0][i] * self.area[1][j];
        (self.q[i] * self.v[j]).max(floor)
    }

    /// Calls `f` with every cell of an array and its w, where the stream function is not cut.
    pub(crate) fn each(&self, cells: &mut [f64], f: impl Fn(&mut f64, f64)) {
        for (row, q) in cells.chunks_exact_mut(self.v.len()).zip(&self.q) {
            row.iter_mut().zip(&self.v).for_each(|(x, v)| f(x, q * v));
        }
    }

    /// The same weights for a scheme without a cut stream function: p_s everywhere, no inactive boundary cells.
    #[must_use]
    pub(crate) fn without_boundary(self) -> Self {
        Self { cut: 0.0, ..self }
    }

    /// Whether cell (i, j) is an inactive boundary cell, p_s <= p_cut: no streamline passes it.
    pub(crate) fn is_boundary(&self, i: usize, j: usize) -> bool {
        self.q[i] * self.v[j] <= self.cut * self.area[0][i] * self.area[1][j]
    }
}

/// The smallest stationary density that finite volumes weigh with.
const LOWEST: f64 = 1e-290;

/// Refuses a domain with less.
pub(super) fn underflow() -> Error {
    let what = format!(
        "finite volumes weigh with the stationary law, and it falls below {LOWEST:e} inside the domain"
    );
    let help = "method.transient = \"flow_map\", an initial condition nearer to the stationary law, or [monte_carlo] alone";
    Error::mesh(what, help)
}

/// The largest of some values on m x n places, within `margin` of their edge; at least 0.
fn largest_at_edge([m, n]: [usize; 2], margin: usize, value: impl Fn(usize, usize) -> f64) -> f64 {
    let near = |k: usize, n: usize| k < margin || k + margin >= n;
    let all = (0..m).flat_map(|i| (0..n).map(move |j| (i, j)));
    let edge = all.filter(|(i, j)| near(*i, m) || near(*j, n));
    edge.map(|(i, j)| value(i, j)).fold(0.0, f64::max)
}

/// The mass flux of the stationary state.
#[derive(Debug, Clone, PartialEq)]
pub enum MassFlux {
    /// Integrated over faces, in probability per time. For upwind.
    Faces {
        /// Through the q-faces, (nq + 1) x nv; positive to higher q.
        q: Vec<f64>,
        /// Through the v-faces, nq x (nv + 1); positive to higher v.
        v: Vec<f64>,
    },
    /// At cell centres, per unit of xi and eta: a = D_eta psi along q, b = -D_xi psi along v, with the
    /// scheme's own differences. For the central schemes.
    Centres {
        /// a, nq x nv.
        q: Vec<f64>,
        /// b, nq x nv.
        v: Vec<f64>,
    },
}

impl MassFlux {
    /// The mass flux of `measure` on a mesh. For the Gibbs measure the stream function is cut,
    /// psi = -T max(p_s - p_cut, 0) with p_cut the largest p_s within half a stencil of the edge of the
    /// domain, so that streamlines close inside. For the Liouville measure psi = H uncut, and the edges
    /// are open.
    pub fn new(measure: &Measure, oscillator: &Oscillator, mesh: &Mesh, drift: Drift) -> Self {
        let t = oscillator.temperature();
        let psi = |q: &[f64], v: &[f64], margin: usize| -> Vec<f64> {
            let (m, n) = (q.len(), v.len());
            if matches!(measure, Measure::Liouville) {
                let points = grid(q, v);
                return points.map(|[q, v]| oscillator.energy(q, v)).collect();
            }
            let along_q: Vec<f64> = q.iter().map(|q| measure.density_q(*q)).collect();
            let along_v: Vec<f64> = v.iter().map(|v| measure.density_v(*v, t)).collect();
            let cut = largest_at_edge([m, n], margin, |i, j| along_q[i] * along_v[j]);
            let value = |[a, b]: [f64; 2]| -t * (a * b - cut).max(0.0);
            grid(&along_q, &along_v).map(value).collect()
        };
        let [nq, nv] = mesh.cells();
        if drift == Drift::Upwind {
            let psi = psi(mesh.q.edges(), mesh.v.edges(), 1);
            let at = |i: usize, j: usize| psi[i * (nv + 1) + j];
            let (mut q, mut v) = (
                Vec::with_capacity((nq + 1) * nv),
                Vec::with_capacity(nq * (nv + 1)),
            );
            for i in 0..=nq {
                q.extend((0..nv).map(|j| at(i, j + 1) - at(i, j)));
            }
            for i in 0..nq {
                v.extend((0..=nv).map(|j| at(i, j) - at(i + 1, j)));
            }
            return Self::Faces { q, v };
        }
        // Beyond the edge psi is H on axes that go on, for Liouville, and 0 for Gibbs.
        let half = drift.half_width();
        let pad_axis = |axis: &super::mesh::Axis| -> Vec<f64> {
            let n = axis.len() as i64;
            let reach = half as i64;
            (-reach..n + reach)
                .map(|k| axis.at(k as f64 + 0.5).0)
                .collect()
        };
        let psi = psi(&pad_axis(&mesh.q), &pad_axis(&mesh.v), 2 * half);
        let stride = nv + 2 * half;
        let at = |i: usize, j: usize| psi[i * stride + j];
        let c = central(half);
        let (mut q, mut v) = (Vec::with_capacity(nq * nv), Vec::with_capacity(nq * nv));
        for i in half..nq + half {
            for j in half..nv + half {
                let along_v = c
                    .iter()
                    .zip(1..)
                    .map(|(c, l)| c * (at(i, j + l) - at(i, j - l)));
                q.push(along_v.sum());
                let along_q = c
                    .iter()
                    .zip(1..)
                    .map(|(c, l)| c * (at(i - l, j) - at(i + l, j)));
                v.push(along_q.sum());
            }
        }
        Self::Centres { q, v }
    }
}
