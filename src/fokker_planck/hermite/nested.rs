//! s M - L where friction depends on the displacement, factored: one factorisation, any number of right-hand sides.
//!
//! What belongs to one element couples a pair of Hermite functions with its neighbours only: a band, factored by rows with
//! partial pivoting. What is left are the hats, and of each element the odd n that are constant on it, which no friction
//! would hold there: node after node a block, block tridiagonal. COLAMD, which does not know the elements, fills in nine
//! times as much.

use super::basis::{DEGREE, INNER};
use crate::budget::timing;
use crate::error::{Deadline, Error, Result};
use crate::matrix::vectorise;
use crate::sparse::{DenseLu, norm, subtract_product};
use ndarray::Array2;
use num_complex::Complex;
use rayon::prelude::*;
use sprs::CsMat;

type C = Complex<f64>;

/// Unknowns of an element that belong to a pair: the inner functions of the even n, those of the odd one but the constant.
const OWN: usize = INNER + DEGREE - 1;

/// How far an equation of an element reaches from the diagonal, to either side.
const BAND: usize = 2 * OWN - 1;

/// Entries kept of a row: pivoting fills in as much again on the right.
const WIDTH: usize = 3 * BAND + 1;

/// What an unknown takes as a row of a sparse matrix, in complex numbers: some forty entries with their places.
const SPARSE: usize = 65;

/// Largest backward error accepted of a solution, relative to |A| |x| + |b|.
const ACCEPTED: f64 = 1e-9;

/// A backward error that refinement is content with.
const REFINED: f64 = 1e-15;

/// A row or a column of the matrix.
#[derive(Debug, Clone, Copy)]
enum Place {
    /// An element, and the unknown in it.
    Inside(usize, usize),
    /// A node, and the unknown at it: the hat of each pair, then the constant of the element on its right.
    Node(usize, usize),
}

/// Which unknown is what: hats, inner functions of the even n, and the odd ones, as in `local`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    pub(super) elements: usize,
    pub(super) pairs: usize,
}

impl Shape {
    fn place(self, index: usize) -> Place {
        let (function, i) = (index / self.pairs, index % self.pairs);
        let hats = self.elements + 1;
        let even = hats + self.elements * INNER;
        if function < hats {
            Place::Node(function, i)
        } else if function < even {
            let inner = function - hats;
            Place::Inside(inner / INNER, i * OWN + inner % INNER)
        } else {
            let odd = function - even;
            match (odd / DEGREE, odd % DEGREE) {
                (e, 0) => Place::Node(e, self.pairs + i),
                (e, a) => Place::Inside(e, i * OWN + INNER + a - 1),
            }
        }
    }

    /// Unknowns at a node.
    fn at_node(self, node: usize) -> usize {
        if node < self.elements {
            2 * self.pairs
        } else {
            self.pairs
        }
    }

    /// Operations of a factorisation, in those of a dense product.
    pub(super) fn operations(self) -> f64 {
        let (k, e) = (self.pairs as f64, self.elements as f64);
        let band = BAND as f64;
        let rows = OWN as f64 * k;
        // The band, its columns for the nodes, and their blocks.
        let flops =
            16.0 * rows * band * band + 8.0 * rows * 3.0 * band * 3.0 * k + 130.0 * k * k * k;
        timing::NESTED * e * flops
    }

    /// Bytes of a factorisation: the matrix and the two it is the sum of, its bands with what was taken off them, the columns of
    /// an element for its nodes, and the blocks of the nodes.
    pub(super) fn memory(self) -> u64 {
        let rows = OWN * self.pairs;
        let element = rows * (WIDTH + BAND + 3 * SPARSE) + 25 * self.pairs * self.pairs;
        (16 * (self.elements * element + rows * 3 * self.pairs)) as u64
    }
}

/// A sparse matrix of `Shape`, factored.
pub(super) struct Nested {
    shape: Shape,
    matrix: CsMat<C>,
    /// Largest column sum.
    norm: f64,
    places: Vec<Place>,
    elements: Vec<Inside>,
    /// Of each node its own block, and those that couple it with the next: its row, the other's row.
    nodes: Vec<DenseLu>,
    after: Vec<[Array2<C>; 2]>,
}

/// The equations of an element.
struct Inside {
    band: Band,
    /// What the nodes at its ends put into them, and what they put into those: unknown, place beside the other at both
    /// nodes, value.
    of_nodes: Vec<(usize, usize, C)>,
    on_nodes: Vec<(usize, usize, C)>,
}

impl Nested {
    /// Factors a matrix by columns; `late` is asked before each element and each node.
    pub(super) fn factor(matrix: CsMat<C>, shape: Shape, late: &Deadline) -> Result<Self> {
        let (k, count) = (shape.pairs, shape.elements);
        let norm = norm(&matrix)?;
        let places: Vec<Place> = (0..matrix.cols()).map(|n| shape.place(n)).collect();
        let mut elements: Vec<Inside> = (0..count)
            .map(|_| Inside {
                band: Band::zero(OWN * k),
                of_nodes: Vec::new(),
                on_nodes: Vec::new(),
            })
            .collect();
        let zero = |a: usize, b: usize| Array2::<C>::default((shape.at_node(a), shape.at_node(b)));
        let mut own: Vec<Array2<C>> = (0..=count).map(|e| zero(e, e)).collect();
        let mut after: Vec<[Array2<C>; 2]> = (0..count)
            .map(|e| [zero(e, e + 1), zero(e + 1, e)])
            .collect();
        for (column, entries) in matrix.outer_iterator().enumerate() {
            for (row, value) in entries.iter() {
                match (places[row], places[column]) {
                    (Place::Inside(e, r), Place::Inside(_, c)) => {
                        *elements[e].band.at(r, c) = *value;
                    }
                    (Place::Inside(e, r), Place::Node(node, i)) => {
                        elements[e]
                            .of_nodes
                            .push((r, 2 * k * (node - e) + i, *value));
                    }
                    (Place::Node(node, i), Place::Inside(e, c)) => {
                        elements[e]
                            .on_nodes
                            .push((c, 2 * k * (node - e) + i, *value));
                    }
                    (Place::Node(a, i), Place::Node(b, j)) if a == b => own[a][[i, j]] = *value,
                    (Place::Node(a, i), Place::Node(b, j)) => {
                        after[a.min(b)][usize::from(a > b)][[i, j]] = *value;
                    }
                }
            }
        }
        let ends: Result<Vec<Array2<C>>> = elements
            .par_iter_mut()
            .map(|element| {
                late()?;
                element.band.factor()?;
                Ok(element.ends(k))
            })
            .collect();
        for (e, ends) in ends?.into_iter().enumerate() {
            // The constant on the right of the next node belongs to the next element.
            for ((a, b), value) in ends.indexed_iter() {
                match (a.checked_sub(2 * k), b.checked_sub(2 * k)) {
                    (None, None) => own[e][[a, b]] -= value,
                    (None, Some(b)) => after[e][0][[a, b]] -= value,
                    (Some(a), None) => after[e][1][[a, b]] -= value,
                    (Some(a), Some(b)) => own[e + 1][[a, b]] -= value,
                }
            }
        }
        let mut nodes: Vec<DenseLu> = Vec::with_capacity(count + 1);
        for e in 0..=count {
            late()?;
            let lu = DenseLu::factor(&own[e])?;
            if let Some([right, left]) = after.get(e) {
                // Columns of a matrix stand in the memory of its transpose row by row.
                let mut columns: Vec<C> = right.t().iter().copied().collect();
                lu.solve(&mut columns)?;
                let shape = (right.ncols(), right.nrows());
                let solved = Array2::from_shape_vec(shape, columns).unwrap_or_default();
                let carried = left.dot(&solved.t());
                own[e + 1] -= &carried;
            }
            nodes.push(lu);
        }
        Ok(Self {
            shape,
            matrix,
            norm,
            places,
            elements,
            nodes,
            after,
        })
    }

    /// Overwrites a right-hand side with the solution, refined.
    ///
    /// # Errors
    /// [`Error::Linear`] if its backward error is above 1e-9.
    pub(super) fn solve(&self, x: &mut [C]) -> Result<()> {
        let size = |x: &[C]| x.iter().map(C::l1_norm).sum::<f64>();
        let given = x.to_vec();
        self.once(x)?;
        let mut before = f64::INFINITY;
        loop {
            let mut left = given.clone();
            subtract_product(&self.matrix, x, &mut left);
            let error = size(&left) / (self.norm * size(x) + size(&given)).max(f64::MIN_POSITIVE);
            if error <= REFINED || error > 0.3 * before {
                // What refinement no longer mends.
                let error = error.min(before);
                if error <= ACCEPTED {
                    return Ok(());
                }
                let what = format!("singular matrix or lost digits: backward error {error:.1e}");
                return Err(Error::linear("nested elimination", what));
            }
            before = error;
            self.once(&mut left)?;
            x.iter_mut().zip(left).for_each(|(x, more)| *x += more);
        }
    }

    /// The solution, as the factors give it.
    fn once(&self, x: &mut [C]) -> Result<()> {
        let (k, count) = (self.shape.pairs, self.shape.elements);
        // Of each node twice as many as pairs; at the last half of them.
        let (mut inside, mut nodes) = (
            vec![C::default(); count * OWN * k],
            vec![C::default(); (2 * count + 1) * k],
        );
        for (place, x) in self.places.iter().zip(&*x) {
            match *place {
                Place::Inside(e, r) => inside[e * OWN * k + r] = *x,
                Place::Node(node, i) => nodes[2 * node * k + i] = *x,
            }
        }
        for (e, element) in self.elements.iter().enumerate() {
            let own = &mut inside[e * OWN * k..(e + 1) * OWN * k];
            element.band.solve(own, 1);
            for (r, place, value) in &element.on_nodes {
                nodes[2 * e * k + place] -= value * own[*r];
            }
        }
        for (e, node) in self.nodes.iter().enumerate() {
            let (here, next) = nodes[2 * e * k..].split_at_mut(self.shape.at_node(e));
            if let Some([_, left]) = self.after.get(e) {
                let mut solved = here.to_vec();
                node.solve(&mut solved)?;
                subtract(left, &solved, next);
            }
        }
        for (e, node) in self.nodes.iter().enumerate().rev() {
            let (here, next) = nodes[2 * e * k..].split_at_mut(self.shape.at_node(e));
            if let Some([right, _]) = self.after.get(e) {
                subtract(right, &next[..right.ncols()], here);
            }
            node.solve(here)?;
        }
        for (e, element) in self.elements.iter().enumerate() {
            let mut given = vec![C::default(); OWN * k];
            for (r, place, value) in &element.of_nodes {
                given[*r] += value * nodes[2 * e * k + place];
            }
            element.band.solve(&mut given, 1);
            let own = &mut inside[e * OWN * k..(e + 1) * OWN * k];
            own.iter_mut().zip(given).for_each(|(x, more)| *x -= more);
        }
        for (place, x) in self.places.iter().zip(x) {
            *x = match *place {
                Place::Inside(e, r) => inside[e * OWN * k + r],
                Place::Node(node, i) => nodes[2 * node * k + i],
            };
        }
        Ok(())
    }
}

impl Inside {
    /// What elimination takes off the equations of the nodes: hats and constants on the left, hats on the right.
    fn ends(&self, k: usize) -> Array2<C> {
        let columns = 3 * k;
        let mut solved = vec![C::default(); self.band.rows * columns];
        for (r, place, value) in &self.of_nodes {
            solved[r * columns + place] = *value;
        }
        self.band.solve(&mut solved, columns);
        let mut ends = vec![C::default(); columns * columns];
        for (r, place, value) in &self.on_nodes {
            let row = &mut ends[place * columns..][..columns];
            add(row, &solved[r * columns..][..columns], *value);
        }
        Array2::from_shape_vec((columns, columns), ends).unwrap_or_default()
    }
}

/// A matrix with entries near its diagonal alone, row by row, and its factors.
struct Band {
    rows: usize,
    entries: Vec<C>,
    /// Of each row what it is taken off the rows below with.
    lower: Vec<C>,
    /// The row that each was exchanged with.
    pivots: Vec<usize>,
}

impl Band {
    fn zero(rows: usize) -> Self {
        Self {
            rows,
            entries: vec![C::default(); rows * WIDTH],
            lower: vec![C::default(); rows * BAND],
            pivots: Vec::new(),
        }
    }

    fn at(&mut self, row: usize, column: usize) -> &mut C {
        &mut self.entries[row * WIDTH + column + BAND - row]
    }

    /// Elimination with row exchanges (LAPACK's gbtrf): later exchanges leave the factors where they were made.
    fn factor(&mut self) -> Result<()> {
        let n = self.rows;
        for k in 0..n {
            let below = (k + BAND).min(n - 1);
            let size = |row: usize| self.entries[row * WIDTH + k + BAND - row].norm_sqr();
            let pivot = (k..=below)
                .max_by(|a, b| size(*a).total_cmp(&size(*b)).then(b.cmp(a)))
                .unwrap_or(k);
            self.pivots.push(pivot);
            let last = (k + 2 * BAND).min(n - 1);
            if pivot != k {
                for column in k..=last {
                    let (a, b) = (
                        k * WIDTH + column + BAND - k,
                        pivot * WIDTH + column + BAND - pivot,
                    );
                    self.entries.swap(a, b);
                }
            }
            let over = self.entries[k * WIDTH + BAND].inv();
            if !over.is_finite() {
                return Err(Error::linear("nested elimination", "a singular element"));
            }
            let (head, tail) = self.entries.split_at_mut((k + 1) * WIDTH);
            let pivots = &head[k * WIDTH + BAND + 1..k * WIDTH + BAND + 1 + last - k];
            for row in k + 1..=below {
                let start = (row - k - 1) * WIDTH + k + BAND - row;
                let factor = tail[start] * over;
                self.lower[k * BAND + row - k - 1] = factor;
                if factor != C::default() {
                    add(&mut tail[start + 1..start + 1 + last - k], pivots, -factor);
                }
            }
        }
        Ok(())
    }

    /// Solves for so many right-hand sides that stand side by side.
    fn solve(&self, x: &mut [C], columns: usize) {
        vectorise!(self.substitute(x, columns));
    }

    #[inline(always)]
    fn substitute(&self, x: &mut [C], columns: usize) {
        let n = self.rows;
        for (k, pivot) in self.pivots.iter().enumerate() {
            if *pivot != k {
                let (head, tail) = x.split_at_mut(pivot * columns);
                head[k * columns..(k + 1) * columns].swap_with_slice(&mut tail[..columns]);
            }
            let (head, tail) = x.split_at_mut((k + 1) * columns);
            let here = &head[k * columns..];
            let factors = &self.lower[k * BAND..(k + 1) * BAND];
            if let [here] = here {
                add(&mut tail[..BAND.min(n - k - 1)], factors, -here);
                continue;
            }
            for (factor, below) in factors.iter().zip(tail.chunks_exact_mut(columns)) {
                if *factor != C::default() {
                    add(below, here, -factor);
                }
            }
        }
        for k in (0..n).rev() {
            let (head, tail) = x.split_at_mut((k + 1) * columns);
            let here = &mut head[k * columns..];
            let row = &self.entries[k * WIDTH + BAND..(k + 1) * WIDTH];
            let over = row[0].inv();
            if let [here] = here {
                let known: C = row[1..].iter().zip(&*tail).map(|(a, x)| a * x).sum();
                *here = (*here - known) * over;
                continue;
            }
            for (factor, other) in row[1..].iter().zip(tail.chunks_exact(columns)) {
                if *factor != C::default() {
                    add(here, other, -factor);
                }
            }
            for x in here {
                *x *= over;
            }
        }
    }
}

/// Adds a multiple of a row.
#[inline(always)]
fn add(to: &mut [C], what: &[C], times: C) {
    for (to, what) in to.iter_mut().zip(what) {
        to.re += times.re * what.re - times.im * what.im;
        to.im += times.re * what.im + times.im * what.re;
    }
}

/// y - A x.
fn subtract(matrix: &Array2<C>, x: &[C], y: &mut [C]) {
    for (row, y) in matrix.rows().into_iter().zip(y) {
        *y -= row.iter().zip(x).map(|(a, x)| a * x).sum::<C>();
    }
}
