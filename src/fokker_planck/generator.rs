//! The generator L of dP/dt = L P on a mesh: transport of g = P/w along the stationary mass flux, and
//! friction with diffusion, pi h d/dv(p_s dg/dv). Matrix-free, and assembled by columns.
//!
//! Upwind: a flux M through a face carries g of the cell it comes from; with Scharfetter-Gummel
//! diffusion L is an M-matrix with zero column sums. Central, with D the antisymmetric difference
//! matrix of the order:
//!
//! ```text
//! w dg/dt = -1/2 [D_q(a g) + a D_q g + D_v(b g) + b D_v g] - S^T (pi h p_s) S g
//! ```
//!
//! The bracket is antisymmetric in g and the last term symmetric and dissipative, so mass, g = 1 and
//! the decay of sum w g^2 hold exactly at every order (summation by parts; Morinishi et al., J. Comput.
//! Phys. 143, 90, 1998).
//!
//! Inactive boundary cells, the few beyond the last streamline that a wide stencil still touches, see no transport
//! of their own and would carry slow modes of the truncated domain. There g is relaxed to its neighbours: symmetric
//! and dissipative too, and without weight in any answer (they hold less than the neglected probability).

mod apply;
mod assembly;
mod friction;

use super::difference::central;
use super::flux::{Drift, MassFlux, Measure, Weights, underflow};
use super::mesh::Mesh;
use super::radius::{Kind, largest};
use crate::error::{Error, Result};
use crate::fokker_planck::policy::{BOUNDARY_RATE, STEEPEST};
use crate::gaussian::maxwell;
use crate::oscillator::Oscillator;
use crate::quadrature;
use std::ops::Range;

/// Diagonal and subdiagonals of friction and diffusion in a column, at the highest order.
pub(crate) const BANDS: usize = 8;

/// The generator on a mesh.
#[derive(Debug, Clone)]
pub struct Generator {
    mesh: Mesh,
    drift: Drift,
    flux: MassFlux,
    weights: Weights,
    /// The cells of each q-column that a streamline reaches; the others hold no unknowns.
    active: Vec<Range<usize>>,
    /// 1/w of active cells, 0 of the others.
    inverse: Vec<f64>,
    /// pi h times the Maxwell density over dv/deta on the nv + 1 v-faces.
    conductance: Vec<f64>,
    /// w/(w of the Maxwell measure) per v cell: friction and diffusion act on P over the latter.
    tilt: Vec<f64>,
    /// Boundary cells, in order, with a neighbour and their exchange coefficient: each pair twice.
    relaxed: Vec<(usize, usize, f64)>,
    /// What L has on the diagonal beside the exchange of cells: at open edges the rate of g that balances the missing neighbours,
    /// under a friction that depends on the state the rate at which it gathers g in each cell.
    open: Vec<(usize, f64)>,
    /// Whether all cells have such a rate, of friction.
    gathers: bool,
    /// Cells at an open edge with the rate at which g leaves through it.
    leaving: Vec<(usize, f64)>,
}

impl Generator {
    /// The generator of `oscillator` on `mesh`.
    ///
    /// # Errors
    /// [`Error::Mesh`] if the mesh cannot hold the stationary law, or no streamline fits it.
    pub fn new(oscillator: &Oscillator, mesh: &Mesh, drift: Drift) -> Result<Self> {
        let measure = Measure::of(oscillator)?;
        let flux = MassFlux::new(&measure, oscillator, mesh, drift);
        Self::with_flux(oscillator, mesh, drift, flux)
    }

    /// As [`Generator::new`] with a mass flux of one's own: for tests of what depends on it.
    ///
    /// # Errors
    /// As [`Generator::new`].
    pub fn with_flux(
        oscillator: &Oscillator,
        mesh: &Mesh,
        drift: Drift,
        flux: MassFlux,
    ) -> Result<Self> {
        let t = oscillator.temperature();
        let measure = Measure::of(oscillator)?;
        let weights = Weights::new(&measure, mesh, t, drift)?;
        let [nq, nv] = mesh.cells();
        let active = active(&flux, drift, nq, nv);
        let unknowns: usize = active.iter().map(Range::len).sum();
        if unknowns < 2 {
            let what = format!("no streamline fits {nq} x {nv} cells");
            return Err(Error::mesh(what, "more cells"));
        }
        let mut inverse = vec![0.0; nq * nv];
        for (i, range) in active.iter().enumerate() {
            for j in range.clone() {
                inverse[i * nv + j] = 1.0 / weights.at(i, j);
            }
        }
        if !inverse.iter().all(|x| x.is_finite()) {
            return Err(underflow());
        }
        if drift != Drift::Upwind {
            check_tail(mesh, &weights, &active, drift)?;
        }
        let conductance = conductance(oscillator, mesh, drift);
        let tilt = weights.v.iter().zip(&weights.maxwell);
        let tilt = tilt.map(|(v, m)| v / m).collect();
        let mut it = Self {
            mesh: mesh.clone(),
            drift,
            flux,
            weights,
            active,
            inverse,
            conductance,
            tilt,
            relaxed: Vec::new(),
            open: Vec::new(),
            gathers: false,
            leaving: Vec::new(),
        };
        match measure {
            Measure::Liouville => it.open_edges(),
            Measure::Gibbs(_) if drift != Drift::Upwind => it.relax_boundary(),
            Measure::Gibbs(_) => {}
        }
        if !oscillator.is_viscous() {
            it.add_friction(oscillator);
        }
        Ok(it)
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    pub(crate) fn drift(&self) -> Drift {
        self.drift
    }

    /// The weights of the cells.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// The cells of q-column i that hold unknowns.
    pub fn active(&self, i: usize) -> Range<usize> {
        self.active[i].clone()
    }

    /// [`Generator::active`] of every q-column.
    pub fn columns(&self) -> &[Range<usize>] {
        &self.active
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.active.iter().map(Range::len).sum()
    }

    /// 1/w of every cell, row-major; 0 where there is no unknown.
    pub fn inverse_weights(&self) -> &[f64] {
        &self.inverse
    }

    /// w over the weight of the Maxwell measure per v cell: friction and diffusion act on g times it.
    pub(crate) fn tilt(&self) -> &[f64] {
        &self.tilt
    }

    /// Whether no probability leaves.
    pub(crate) fn is_closed(&self) -> bool {
        (self.open.is_empty() || self.gathers) && self.leaving.is_empty()
    }

    /// `g = cells/w` where there are unknowns, 0 elsewhere.
    pub(crate) fn ratio(&self, cells: &[f64], g: &mut [f64]) {
        for ((g, p), inverse) in g.iter_mut().zip(cells).zip(&self.inverse) {
            *g = p * inverse;
        }
    }

    /// `cells = w g` where there are unknowns; the others are left alone.
    pub fn weigh(&self, g: &[f64], cells: &mut [f64]) {
        let nv = self.mesh.v.len();
        for (i, column) in self.active.iter().enumerate() {
            for j in column.clone() {
                cells[i * nv + j] = g[i * nv + j] * self.weights.at(i, j);
            }
        }
    }

    /// At an open edge the pairs with missing neighbours leave a row sum. Outflow (positive) takes its
    /// probability along; inflow carries none: only the negative part is given back.
    fn open_edges(&mut self) {
        let MassFlux::Centres { q: a, v: b } = &self.flux else {
            return;
        };
        let [nq, nv] = self.mesh.cells();
        let c = central(self.drift.half_width());
        for i in 0..nq {
            for j in 0..nv {
                let here = i * nv + j;
                let mut sum = 0.0;
                for (l, c) in (1..).zip(c) {
                    let mut add = |inside: bool, sign: f64, flux: &[f64], there: usize| {
                        if inside {
                            sum -= sign * 0.5 * c * (flux[here] + flux[there]);
                        }
                    };
                    add(i + l < nq, 1.0, a, here + l * nv);
                    add(i >= l, -1.0, a, here.wrapping_sub(l * nv));
                    add(j + l < nv, 1.0, b, here + l);
                    add(j >= l, -1.0, b, here.wrapping_sub(l));
                }
                if sum < 0.0 {
                    self.open.push((here, sum));
                } else if sum > 0.0 {
                    self.leaving.push((here, sum));
                }
            }
        }
    }

    /// Whether each unknown belongs to an inactive boundary cell, beyond the last streamline.
    pub fn boundary_cells(&self) -> Vec<bool> {
        let column = |i: usize| self.active(i).map(move |j| self.weights.is_boundary(i, j));
        (0..self.mesh.q.len()).flat_map(column).collect()
    }

    /// Couples each boundary cell to its neighbours at the rate [`BOUNDARY_RATE`].
    fn relax_boundary(&mut self) {
        let [nq, nv] = self.mesh.cells();
        let (boundary, number) = (self.boundary_cells(), self.numbering());
        for i in 0..nq {
            for j in self.active(i) {
                let here = i * nv + j;
                let right = (i + 1 < nq).then_some(here + nv);
                let above = (j + 1 < nv).then_some(here + 1);
                for there in [right, above].into_iter().flatten() {
                    let other = number[there];
                    if other != usize::MAX && (boundary[number[here]] || boundary[other]) {
                        let smaller = 1.0 / self.inverse[here].max(self.inverse[there]);
                        let rate = BOUNDARY_RATE.get() * smaller;
                        let pair = [(here, there, rate), (there, here, rate)];
                        self.relaxed.extend(pair);
                    }
                }
            }
        }
        self.relaxed.sort_by_key(|(cell, ..)| *cell);
    }

    /// The spectral radius of the antisymmetric part of the generator, which is transport, and of its
    /// symmetric part, which is all that dissipates, by Lanczos' method with a margin of 2 %, 1/time.
    /// The numerical range in the inner product of the weights lies in the rectangle \[-second, 0\] +
    /// i \[-first, first\]. For upwind drift, whose transport dissipates, from the row sums.
    pub fn radii(&self) -> (f64, f64) {
        let MassFlux::Centres { .. } = self.flux else {
            let (transport, diffusion) = self.rates();
            return (transport, transport + diffusion);
        };
        let root: Vec<f64> = self.inverse.iter().map(|x| x.sqrt()).collect();
        let mut g = vec![0.0; root.len()];
        let mut radius = |kind: Kind, part: &dyn Fn(&[f64], &mut [f64])| {
            largest(root.len(), kind, |x, y| {
                for ((g, x), root) in g.iter_mut().zip(x).zip(&root) {
                    *g = x * root;
                }
                part(&g, y);
                for (y, root) in y.iter_mut().zip(&root) {
                    *y *= root;
                }
            })
        };
        let transport = radius(Kind::Antisymmetric, &|g, rate| {
            self.apply_transport(g, rate);
            for &(n, m, k) in &self.relaxed {
                rate[n] -= k * (g[m] - g[n]);
            }
            for &(cell, rate_of_g) in &self.leaving {
                rate[cell] += rate_of_g * g[cell];
            }
            if self.gathers {
                for &(cell, rate_of_g) in &self.open {
                    rate[cell] -= 0.5 * rate_of_g * g[cell];
                }
            }
        });
        let diffusion = radius(Kind::Symmetric, &|g, rate| {
            self.apply_diffusion(g, rate);
            self.relax(&(0..self.mesh.q.len()), g, rate);
        });
        let leaving = self.leaving.iter();
        let leaving = leaving.map(|(cell, rate)| rate * self.inverse[*cell]);
        let gathering = self.open.iter().filter(|_| self.gathers);
        let gathering = gathering.map(|(cell, rate)| 0.5 * rate.abs() * self.inverse[*cell]);
        let diagonal = leaving.chain(gathering).fold(0.0, f64::max);
        (transport, diffusion + diagonal)
    }

    /// A bound on the spectral radius of the transport and of the friction and diffusion, each the
    /// largest row sum of the symmetrised matrix |w^-1/2 K w^-1/2|: (transport, diffusion), 1/time.
    pub(crate) fn rates(&self) -> (f64, f64) {
        let mut sums = [vec![0.0; self.mesh.len()], vec![0.0; self.mesh.len()]];
        self.entries(|part, n, m, value| {
            let scale = (self.inverse[n] * self.inverse[m]).sqrt();
            sums[part as usize][n] += value.abs() * scale;
        });
        let largest = |sums: &[f64]| sums.iter().copied().fold(0.0, f64::max);
        (largest(&sums[0]), largest(&sums[1]))
    }
}

/// Refuses a mesh on which p_s falls by more than a factor e^{3.5} from one cell to the next anywhere
/// within the streamlines. A wide stencil reaches over several such cells: it keeps its stability, but
/// neither its order nor a useful step (a hundredth of the transport's at e^6 a cell, measured).
fn check_tail(mesh: &Mesh, weights: &Weights, active: &[Range<usize>], drift: Drift) -> Result<()> {
    let most = STEEPEST.get();
    let [nq, nv] = mesh.cells();
    let density = |i: usize, j: usize| {
        (weights.q[i] * weights.v[j] / (mesh.q.slopes()[i] * mesh.v.slopes()[j])).ln()
    };
    let mut steepest = [0.0f64; 2];
    for (i, column) in active.iter().enumerate() {
        for j in column.clone().filter(|j| !weights.is_boundary(i, *j)) {
            if i + 1 < nq && !weights.is_boundary(i + 1, j) {
                steepest[0] = steepest[0].max((density(i + 1, j) - density(i, j)).abs());
            }
            if j + 1 < nv && !weights.is_boundary(i, j + 1) {
                steepest[1] = steepest[1].max((density(i, j + 1) - density(i, j)).abs());
            }
        }
    }
    if steepest.iter().all(|s| *s <= most) {
        return Ok(());
    }
    let needed = |n: usize, s: f64| (n as f64 * (1.1 * s / most).max(1.0)).ceil();
    let ([q, v], order) = (steepest, drift.order());
    let what = format!(
        "on [{nq}, {nv}] cells ln p_s falls by up to {q:.1} per cell along q and {v:.1} along v, and drift of \
         order {order} carries {most}"
    );
    let (nq, nv) = (needed(nq, q), needed(nv, v));
    let help = format!("about method.cells = [{nq}, {nv}], or a higher tolerance");
    Err(Error::mesh(what, help))
}

/// The contiguous range of cells per column that exchange anything with a neighbour.
fn active(flux: &MassFlux, drift: Drift, nq: usize, nv: usize) -> Vec<Range<usize>> {
    let mut touched = vec![false; nq * nv];
    match flux {
        MassFlux::Faces { q, v } => {
            for i in 0..nq {
                for j in 0..nv {
                    touched[i * nv + j] = q[i * nv + j] != 0.0
                        || q[(i + 1) * nv + j] != 0.0
                        || v[i * (nv + 1) + j] != 0.0
                        || v[i * (nv + 1) + j + 1] != 0.0;
                }
            }
        }
        MassFlux::Centres { q: a, v: b } => {
            for i in 0..nq {
                for j in 0..nv {
                    let here = i * nv + j;
                    for l in 1..=drift.half_width() {
                        if i + l < nq && a[here] + a[here + l * nv] != 0.0 {
                            touched[here] = true;
                            touched[here + l * nv] = true;
                        }
                        if j + l < nv && b[here] + b[here + l] != 0.0 {
                            touched[here] = true;
                            touched[here + l] = true;
                        }
                    }
                }
            }
        }
    }
    let column = |row: &[bool]| {
        let first = row.iter().position(|t| *t);
        let last = row.iter().rposition(|t| *t);
        first
            .zip(last)
            .map_or(0..0, |(first, last)| first..last + 1)
    };
    touched.chunks(nv).map(column).collect()
}

/// pi h p_v over the width, on the v-faces. Upwind: the Scharfetter-Gummel weight 1/integral of 1/p_v
/// between the centres (Chang and Cooper 1970); central: p_v/(dv/deta) at the face.
fn conductance(oscillator: &Oscillator, mesh: &Mesh, drift: Drift) -> Vec<f64> {
    let (t, noise) = (oscillator.temperature(), oscillator.noise());
    let n = mesh.v.len();
    let face = |j: usize| {
        let (v, slope) = mesh.v.at(j as f64);
        if j == 0 || j == n {
            return 0.0;
        }
        if drift != Drift::Upwind {
            return noise * maxwell(v, t) / slope;
        }
        let (low, high) = (mesh.v.centres()[j - 1], mesh.v.centres()[j]);
        let inverse = |x: f64| (0.5 * (x * x - v * v) / t).exp();
        noise * maxwell(v, t) / quadrature::integrate(inverse, &[low, v, high], 1e-12).value
    };
    (0..=n).map(face).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::ContactLaw;
    use crate::fokker_planck::mesh::Axis;

    #[test]
    fn the_matrix_free_generator_is_its_matrix_at_every_order() {
        for contact in [ContactLaw::Hertz, ContactLaw::Linear, ContactLaw::Free] {
            let it = Oscillator::new(contact, 0.05, 0.02).unwrap();
            let mesh = Mesh {
                q: Axis::uniform(-4.0, 3.5, 61).unwrap(),
                v: Axis::uniform(-3.0, 3.0, 75).unwrap(),
            };
            for drift in Drift::ALL {
                let generator = Generator::new(&it, &mesh, drift).unwrap();
                let g: Vec<f64> = (0..mesh.len())
                    .map(|k| ((k * 7919) % 1009) as f64)
                    .collect();
                let (mut whole, mut parts) = (vec![0.0; g.len()], vec![0.0; g.len()]);
                let mut other = parts.clone();
                generator.apply(&g, &mut whole);
                generator.apply_transport(&g, &mut parts);
                generator.apply_diffusion(&g, &mut other);
                let number = generator.numbering();
                let mut product = vec![0.0; generator.unknowns()];
                let matrix = generator.matrix();
                for (cell, column) in number.iter().enumerate().filter(|(_, n)| **n != usize::MAX) {
                    let p = g[cell] / generator.inverse_weights()[cell];
                    for (row, value) in matrix.outer_view(*column).unwrap().iter() {
                        product[row] += value * p;
                    }
                }
                let (mut worst, mut size): (f64, f64) = (0.0, 0.0);
                for (cell, n) in number.iter().enumerate() {
                    let exact = if *n == usize::MAX { 0.0 } else { product[*n] };
                    worst = worst.max((whole[cell] - exact).abs());
                    worst = worst.max((parts[cell] + other[cell] - exact).abs());
                    size = size.max(exact.abs());
                }
                println!(
                    "{} {drift:?}: {worst:.1e} of {size:.1e}",
                    it.contact().name()
                );
                assert!(worst < 1e-12 * size);
            }
        }
    }
}
