//! One element of s - L with its inner functions eliminated: what is left couples the hats at its ends.
//!
//! The inner functions couple a Hermite function with its neighbours only, so they are eliminated from the highest n
//! downwards, in blocks of [`INNER`]. The matrix is symmetric (v -> -v turns L into its transpose), so that of each
//! column only the rows above the diagonal are computed.

use super::basis::{Element, INNER};
use crate::error::{Error, Result};
use crate::matrix::vectorise;
use ndarray::Array2;
use num_complex::Complex;
use std::borrow::Cow;

type C = Complex<f64>;

/// An inner block.
pub(super) type Small = [[C; INNER]; INNER];

/// What the odd n, once eliminated, leave in the rows of the even n = 2i, i = 0, 1, ...
pub(super) struct Rates {
    /// s + 2 zeta n.
    pub(super) friction: Vec<C>,
    /// Factors of C^T C and D^T D.
    above: Vec<C>,
    below: Vec<C>,
    /// From n + 2, of C^T D.
    coupling: Vec<C>,
}

impl Rates {
    pub(super) fn new(zeta: f64, temperature: f64, shift: C, pairs: usize) -> Self {
        let friction = |n: f64| shift + 2.0 * zeta * n;
        let all = |of: &dyn Fn(f64) -> C| (0..pairs).map(|i| of((2 * i) as f64)).collect();
        Self {
            friction: all(&friction),
            above: all(&|n| temperature * (n + 1.0) / friction(n + 1.0)),
            below: all(&|n| {
                // Nothing is below n = 0.
                if n > 0.0 {
                    temperature * n / friction(n - 1.0)
                } else {
                    C::default()
                }
            }),
            coupling: all(&|n| temperature * ((n + 1.0) * (n + 2.0)).sqrt() / friction(n + 1.0)),
        }
    }

    fn len(&self) -> usize {
        self.friction.len()
    }

    /// The block of an element on the diagonal, at a place.
    fn diagonal(&self, element: &Element, i: usize, a: usize, b: usize) -> C {
        let mass = match (a < 2, b < 2) {
            (true, true) => element.mass[a][b],
            (false, false) if a == b => 1.0,
            _ => 0.0,
        };
        mass * self.friction[i]
            + element.cc[a][b] * self.above[i]
            + element.dd[a][b] * self.below[i]
    }
}

/// Columns worked on together: for both hats so many Hermite functions.
const SIDE: usize = 8;
const LANES: usize = 2 * SIDE;

/// A block row of some columns, real and imaginary parts.
#[derive(Clone, Copy)]
struct Rows {
    re: [[f64; LANES]; INNER],
    im: [[f64; LANES]; INNER],
}

impl Rows {
    const ZERO: Self = Self {
        re: [[0.0; LANES]; INNER],
        im: [[0.0; LANES]; INNER],
    };

    /// Adds the product of a block with others.
    #[inline(always)]
    fn add(&mut self, block: &Small, other: &Self) {
        for (a, row) in block.iter().enumerate() {
            for (b, x) in row.iter().enumerate() {
                axpy(
                    *x,
                    (&other.re[b], &other.im[b]),
                    (&mut self.re[a], &mut self.im[a]),
                );
            }
        }
    }
}

#[inline(always)]
fn axpy(
    by: C,
    (re, im): (&[f64; LANES], &[f64; LANES]),
    (to_re, to_im): (&mut [f64; LANES], &mut [f64; LANES]),
) {
    for l in 0..LANES {
        to_re[l] = by.re.mul_add(re[l], (-by.im).mul_add(im[l], to_re[l]));
        to_im[l] = by.re.mul_add(im[l], by.im.mul_add(re[l], to_im[l]));
    }
}

/// The inner functions of an element, eliminated.
pub(super) struct Condensed<'a> {
    pub(super) element: &'a Element,
    pub(super) rates: &'a Rates,
    /// Inverse of the block of each even n.
    pub(super) inverse: Cow<'a, [Small]>,
}

/// What an element adds to the matrix of the hats: the hat on its left with itself, with the one on its right, and
/// that with itself.
pub(super) struct Ends {
    pub(super) left: Array2<C>,
    pub(super) across: Array2<C>,
    pub(super) right: Array2<C>,
}

impl<'a> Condensed<'a> {
    /// Eliminates the inner functions.
    pub(super) fn new(element: &'a Element, rates: &'a Rates) -> Result<Self> {
        let mut inverse: Vec<Small> = Vec::with_capacity(rates.len());
        let cd = |a: usize, b: usize| element.cd[a + 2][b + 2];
        for i in (0..rates.len()).rev() {
            let mut block: Small = std::array::from_fn(|a| {
                std::array::from_fn(|b| rates.diagonal(element, i, a + 2, b + 2))
            });
            if let Some(above) = inverse.last() {
                // C^T D times the inverse above, times (C^T D)^T.
                let factor = rates.coupling[i] * rates.coupling[i];
                for (a, block) in block.iter_mut().enumerate() {
                    let mut row = [C::default(); INNER];
                    for (c, above) in above.iter().enumerate() {
                        for (x, above) in row.iter_mut().zip(above) {
                            *x += above * cd(a, c);
                        }
                    }
                    for (b, block) in block.iter_mut().enumerate() {
                        let sum: C = (0..INNER).map(|c| row[c] * cd(b, c)).sum();
                        *block -= factor * sum;
                    }
                }
            }
            inverse.push(invert(block)?);
        }
        inverse.reverse();
        Ok(Self {
            element,
            rates,
            inverse: inverse.into(),
        })
    }

    /// The matrix of the hats.
    pub(super) fn ends(&self) -> Ends {
        let k = self.rates.len();
        let steps = Steps::of(self);
        let mut parts: [[Array2<C>; 2]; 2] =
            std::array::from_fn(|_| std::array::from_fn(|_| Array2::default((k, k))));
        vectorise!(columns(self, &steps, &mut parts));
        let [[mut left, mut across], [other, mut right]] = parts;
        for i in 0..k {
            for j in 0..i {
                left[[i, j]] = left[[j, i]];
                right[[i, j]] = right[[j, i]];
                across[[i, j]] = other[[j, i]];
            }
        }
        Ends {
            left,
            across,
            right,
        }
    }

    /// The inner functions for a right-hand side, the hats held at 0.
    pub(super) fn solve(&self, x: &mut [[C; INNER]]) {
        let k = self.rates.len();
        let cd = &self.element.cd;
        for i in (0..k).rev() {
            let mut here = x[i];
            if i + 1 < k {
                for (a, here) in here.iter_mut().enumerate() {
                    let sum: C = (0..INNER).map(|b| x[i + 1][b] * cd[a + 2][b + 2]).sum();
                    *here += self.rates.coupling[i] * sum;
                }
            }
            x[i] = times(&self.inverse[i], &here);
        }
        for i in 1..k {
            let carried = std::array::from_fn(|a| {
                let sum: C = (0..INNER).map(|b| x[i - 1][b] * cd[b + 2][a + 2]).sum();
                self.rates.coupling[i - 1] * sum
            });
            let carried = times(&self.inverse[i], &carried);
            x[i].iter_mut()
                .zip(carried)
                .for_each(|(x, more)| *x += more);
        }
    }

    /// What the inner functions put into the rows of a hat, 0 on the left, 1 on the right: one number each even n.
    pub(super) fn on_hat(&self, hat: usize, inner: &[[C; INNER]]) -> Vec<C> {
        let (k, cd) = (self.rates.len(), &self.element.cd);
        let mut out = vec![C::default(); k];
        for (i, out) in out.iter_mut().enumerate() {
            for b in 0..INNER {
                *out += self.rates.diagonal(self.element, i, hat, b + 2) * inner[i][b];
                if i + 1 < k {
                    *out -= self.rates.coupling[i] * cd[hat][b + 2] * inner[i + 1][b];
                }
                if i > 0 {
                    *out -= self.rates.coupling[i - 1] * cd[b + 2][hat] * inner[i - 1][b];
                }
            }
        }
        out
    }

    /// What the hats put into the rows of the inner functions.
    pub(super) fn on_inner(&self, hats: [&[C]; 2]) -> Vec<[C; INNER]> {
        let (k, cd) = (self.rates.len(), &self.element.cd);
        let mut out = vec![[C::default(); INNER]; k];
        for (h, hat) in hats.into_iter().enumerate() {
            for (i, out) in out.iter_mut().enumerate() {
                for (b, out) in out.iter_mut().enumerate() {
                    *out += self.rates.diagonal(self.element, i, b + 2, h) * hat[i];
                    if i + 1 < k {
                        *out -= self.rates.coupling[i] * cd[b + 2][h] * hat[i + 1];
                    }
                    if i > 0 {
                        *out -= self.rates.coupling[i - 1] * cd[h][b + 2] * hat[i - 1];
                    }
                }
            }
        }
        out
    }
}

/// The steps from one even n to the next in the solution for many columns, and what the hats read of it.
struct Steps {
    /// From n + 2 down to n.
    down: Vec<Small>,
    /// From n - 2 up to n.
    up: Vec<Small>,
    /// Rows of the hats on the inner functions at n - 2, n and n + 2.
    hats: Vec<[[[C; INNER]; 3]; 2]>,
}

impl Steps {
    fn of(it: &Condensed) -> Self {
        let (k, cd) = (it.rates.len(), &it.element.cd);
        let coupling = &it.rates.coupling;
        let zero = [[C::default(); INNER]; INNER];
        let (mut down, mut up) = (vec![zero; k], vec![zero; k]);
        for i in 0..k {
            for a in 0..INNER {
                let row = &it.inverse[i][a];
                for b in 0..INNER {
                    let sum: C = (0..INNER).map(|c| row[c] * cd[c + 2][b + 2]).sum();
                    down[i][a][b] = coupling[i] * sum;
                    if i > 0 {
                        let sum: C = (0..INNER).map(|c| row[c] * cd[b + 2][c + 2]).sum();
                        up[i][a][b] = coupling[i - 1] * sum;
                    }
                }
            }
        }
        let read = |i: usize, h: usize| -> [[C; INNER]; 3] {
            [
                std::array::from_fn(|b| match i {
                    0 => C::default(),
                    _ => -coupling[i - 1] * cd[b + 2][h],
                }),
                std::array::from_fn(|b| it.rates.diagonal(it.element, i, h, b + 2)),
                std::array::from_fn(|b| -coupling[i] * cd[h][b + 2]),
            ]
        };
        let hats = (0..k).map(|i| [read(i, 0), read(i, 1)]).collect();
        Self { down, up, hats }
    }
}

/// The upper halves of the four parts of the matrix of the hats.
#[inline(always)]
fn columns(it: &Condensed, steps: &Steps, parts: &mut [[Array2<C>; 2]; 2]) {
    let k = it.rates.len();
    let mut work = vec![Rows::ZERO; k];
    for first in (0..k).step_by(SIDE) {
        let count = SIDE.min(k - first);
        let top = (first + count).min(k - 1);
        // Downwards: what the columns put into the inner functions.
        for i in (0..=top).rev() {
            let mut here = Rows::ZERO;
            if i + 1 >= first {
                let given = given(it, i, first, count);
                here.add(&it.inverse[i], &given);
            }
            if i < top {
                let above = work[i + 1];
                here.add(&steps.down[i], &above);
            }
            work[i] = here;
        }
        for i in 1..=top {
            let below = work[i - 1];
            work[i].add(&steps.up[i], &below);
        }
        for i in 0..first + count {
            for (h, parts) in parts.iter_mut().enumerate() {
                let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
                let rows = &steps.hats[i][h];
                for (d, row) in rows.iter().enumerate() {
                    if i + d < 1 || i + d > top + 1 {
                        continue;
                    }
                    let inner = &work[i + d - 1];
                    for (b, x) in row.iter().enumerate() {
                        axpy(-*x, (&inner.re[b], &inner.im[b]), (&mut re, &mut im));
                    }
                }
                for (other, part) in parts.iter_mut().enumerate() {
                    for l in 0..count {
                        let at = other * SIDE + l;
                        part[[i, first + l]] =
                            C::new(re[at], im[at]) + own(it, i, first + l, h, other);
                    }
                }
            }
        }
    }
}

/// The hats' own entry before elimination, of row i and column j.
#[inline(always)]
fn own(it: &Condensed, i: usize, j: usize, h: usize, other: usize) -> C {
    if i == j {
        it.rates.diagonal(it.element, i, h, other)
    } else if i + 1 == j {
        -it.rates.coupling[i] * it.element.cd[h][other]
    } else {
        C::default()
    }
}

/// The columns of the hats in the rows of the inner functions of one even n.
#[inline(always)]
fn given(it: &Condensed, i: usize, first: usize, count: usize) -> Rows {
    let mut out = Rows::ZERO;
    let cd = &it.element.cd;
    for (h, hat) in cd.iter().take(2).enumerate() {
        for l in 0..count {
            let j = first + l;
            for b in 0..INNER {
                let x = if i == j {
                    it.rates.diagonal(it.element, i, b + 2, h)
                } else if i + 1 == j {
                    -it.rates.coupling[i] * cd[b + 2][h]
                } else if j + 1 == i {
                    -it.rates.coupling[j] * hat[b + 2]
                } else {
                    continue;
                };
                out.re[b][h * SIDE + l] = x.re;
                out.im[b][h * SIDE + l] = x.im;
            }
        }
    }
    out
}

fn times(block: &Small, x: &[C; INNER]) -> [C; INNER] {
    std::array::from_fn(|a| block[a].iter().zip(x).map(|(m, x)| m * x).sum())
}

/// The inverse of a block, by elimination with row exchanges.
fn invert(mut a: Small) -> Result<Small> {
    let mut inverse: Small =
        std::array::from_fn(|i| std::array::from_fn(|j| C::new(f64::from(u8::from(i == j)), 0.0)));
    for k in 0..INNER {
        let size = |row: usize| a[row][k].norm_sqr();
        let pivot = (k..INNER)
            .max_by(|i, j| size(*i).total_cmp(&size(*j)))
            .unwrap_or(k);
        a.swap(k, pivot);
        inverse.swap(k, pivot);
        let over = a[k][k].inv();
        if !over.is_finite() {
            return Err(Error::linear("dense LU", "a singular matrix"));
        }
        for j in 0..INNER {
            a[k][j] *= over;
            inverse[k][j] *= over;
        }
        let (row, other) = (a[k], inverse[k]);
        for i in (0..INNER).filter(|i| *i != k) {
            let factor = a[i][k];
            for j in 0..INNER {
                a[i][j] -= factor * row[j];
                inverse[i][j] -= factor * other[j];
            }
        }
    }
    Ok(inverse)
}
