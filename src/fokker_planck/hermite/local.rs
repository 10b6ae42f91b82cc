//! The operator where friction depends on the displacement, as a sparse matrix.
//!
//! Friction and noise, pi h d2/dv2 - c v d/dv, take h_n to h_{n-2}, h_n and h_{n+2} (`weights`): products with c(q) between the
//! functions of one element, and n couples with n + 2 and n - 2. The constant is a null vector but for what the last functions cut
//! off it (`weights`); that of the transpose is the stationary law over the weights. Hats are left as they are, not made orthonormal.

use super::basis::{Basis, DEGREE, Number};
use super::nested::{Nested, Shape};
use super::weights::Weights;
use crate::error::{Deadline, Result};
use crate::oscillator::Oscillator;
use crate::sparse;
use num_complex::Complex;
use sprs::{CsMat, TriMat};

/// The operator and the products of the functions as sparse matrices, by columns; hats first, as they are.
pub(super) struct Local {
    operator: CsMat<f64>,
    mass: CsMat<f64>,
    shape: Shape,
}

impl Local {
    /// Of so many pairs of Hermite functions on a basis of q.
    pub(super) fn new(basis: &Basis, pairs: usize, physics: (&Oscillator, Weights)) -> Self {
        let k = pairs;
        let size = k * (basis.one.len() + DEGREE * basis.elements.len());
        let mut mass = TriMat::with_capacity((size, size), 2 * size);
        let hats = basis.elements.len() + 1;
        for (e, element) in basis.elements.iter().enumerate() {
            for (a, b) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                for i in 0..k {
                    mass.add_triplet((e + a) * k + i, (e + b) * k + i, element.mass[a][b]);
                }
            }
        }
        for n in hats * k..size {
            mass.add_triplet(n, n, 1.0);
        }
        Self {
            operator: operator(basis, (k, size), physics),
            mass: mass.to_csc(),
            shape: Shape {
                elements: basis.elements.len(),
                pairs,
            },
        }
    }

    /// The forward operator: that on p over the weights.
    pub(super) fn transposed(&self) -> Self {
        Self {
            operator: self.operator.transpose_view().to_csc(),
            mass: self.mass.clone(),
            shape: self.shape,
        }
    }

    /// Largest column sum of the operator.
    pub(super) fn norm(&self) -> Result<f64> {
        sparse::norm(&self.operator)
    }

    /// What the operator makes of coefficients: products with the functions.
    pub(super) fn image<T: Number>(&self, x: &[T]) -> Vec<T> {
        sparse::product(&self.operator, x)
    }

    /// Products of the functions with what has so many of each.
    pub(super) fn weighed<T: Number>(&self, x: &[T]) -> Vec<T> {
        sparse::product(&self.mass, x)
    }

    /// s times the products of the functions, less the operator, factored; `late` is asked before each element.
    pub(super) fn factored(&self, shift: Complex<f64>, late: &Deadline) -> Result<Nested> {
        let matrix = {
            let operator = self.operator.map(|x| Complex::new(-x, 0.0));
            &operator + &self.mass.map(|x| shift * x)
        };
        Nested::factor(matrix, self.shape, late)
    }
}

/// Products of the functions with a function of q times coefficients.
pub(super) fn times(basis: &Basis, k: usize, f: &dyn Fn(f64) -> f64, x: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; x.len()];
    let (even, odd) = x.split_at(k * basis.one.len());
    let (even_out, odd_out) = out.split_at_mut(even.len());
    for (e, element) in basis.elements.iter().enumerate() {
        let places = basis.places(e);
        let (on_even, on_odd) = element.at.products(f);
        for (row, to) in on_even.iter().zip(places) {
            for (value, from) in row.iter().zip(places) {
                let from = &even[from * k..(from + 1) * k];
                let to = &mut even_out[to * k..(to + 1) * k];
                to.iter_mut().zip(from).for_each(|(y, x)| *y += value * x);
            }
        }
        for (row, to) in on_odd.iter().zip(0..) {
            for (value, from) in row.iter().zip(0..) {
                let at = |a: usize| (e * DEGREE + a) * k..(e * DEGREE + a + 1) * k;
                let (from, to) = (&odd[at(from)], &mut odd_out[at(to)]);
                to.iter_mut().zip(from).for_each(|(y, x)| *y += value * x);
            }
        }
    }
    out
}

/// The entries of the operator.
fn operator(
    basis: &Basis,
    (k, size): (usize, usize),
    (oscillator, weights): (&Oscillator, Weights),
) -> CsMat<f64> {
    let temperature = weights.in_v();
    let heated = oscillator.noise() / temperature;
    let [lowers, keeps, once, raises] = weights.friction().map(|[c, noise]| [c, noise * heated]);
    let functions = basis.one.len();
    let mut triplets = TriMat::with_capacity((size, size), 40 * size);
    let even = |place: usize, i: usize| place * k + i;
    let odd = |e: usize, a: usize, i: usize| functions * k + (e * DEGREE + a) * k + i;
    let mut add = |row: usize, column: usize, value: f64| triplets.add_triplet(row, column, value);
    for (e, element) in basis.elements.iter().enumerate() {
        let places = basis.places(e);
        let rate = |q: f64| oscillator.friction(q);
        let (even_rate, odd_rate) = element.at.products(rate);
        let (even_mass, odd_mass) = element.at.products(|_| 1.0);
        for i in 0..k {
            let (n, m) = ((2 * i) as f64, (2 * i + 1) as f64);
            let heat = |n: f64| (temperature * n).sqrt();
            for (b, place) in places.into_iter().enumerate() {
                for a in 0..DEGREE {
                    let (c, d) = (element.c[a][b], element.d[a][b]);
                    // Even n = 2i reads the odd n - 1 and n + 1, odd m = 2i + 1 the even m - 1 and m + 1.
                    if i > 0 {
                        add(even(place, i), odd(e, a, i - 1), heat(n) * d);
                    }
                    add(even(place, i), odd(e, a, i), -heat(n + 1.0) * c);
                    add(odd(e, a, i), even(place, i), heat(m) * c);
                    if i + 1 < k {
                        add(odd(e, a, i), even(place, i + 1), -heat(m + 1.0) * d);
                    }
                }
            }
            let up = |n: f64| ((n + 1.0) * (n + 2.0)).sqrt();
            for (a, row) in places.into_iter().enumerate() {
                for (b, column) in places.into_iter().enumerate() {
                    let (rate, mass) = (even_rate[a][b], even_mass[a][b]);
                    let of = |by: [f64; 2]| by[0] * rate + by[1] * mass;
                    add(even(row, i), even(column, i), n * of(keeps) + of(once));
                    if i + 1 < k {
                        add(even(row, i), even(column, i + 1), up(n) * of(lowers));
                        add(even(row, i + 1), even(column, i), up(n) * of(raises));
                    }
                }
            }
            for a in 0..DEGREE {
                for b in 0..DEGREE {
                    let (rate, mass) = (odd_rate[a][b], odd_mass[a][b]);
                    let of = |by: [f64; 2]| by[0] * rate + by[1] * mass;
                    add(odd(e, a, i), odd(e, b, i), m * of(keeps) + of(once));
                    if i + 1 < k {
                        add(odd(e, a, i), odd(e, b, i + 1), up(m) * of(lowers));
                        add(odd(e, a, i + 1), odd(e, b, i), up(m) * of(raises));
                    }
                }
            }
        }
    }
    triplets.to_csc()
}
