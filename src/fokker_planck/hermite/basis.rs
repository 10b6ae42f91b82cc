//! Spectral elements of q under a weight p_q, under viscous damping the stationary law: functions of one element, and how elements
//! join.
//!
//! The even n live on continuous piecewise polynomials of degree [`DEGREE`]: hats, one a node, and functions that
//! vanish at the ends of their element; the odd n on discontinuous ones of one degree less. All but the hats are
//! orthonormal. A hat is made orthogonal to the inner functions of its two elements: under p_q it is then as narrow
//! as a polynomial can be, and overlaps with its neighbours only. The root of that tridiagonal matrix takes the
//! coefficients of hats to those of an orthonormal basis and back.

use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use crate::matrix::dot;
use crate::oscillator::{DisplacementLaw, Oscillator, Quantity};
use crate::quadrature::gauss;
use num_complex::Complex;
use std::ops::{AddAssign, Mul, MulAssign};

/// Degree of the continuous polynomials. Higher degrees with fewer elements lose where p_q falls by
/// many powers of ten within an element.
pub(in crate::fokker_planck) const DEGREE: usize = 8;

/// Functions of an element that vanish at its ends.
pub(super) const INNER: usize = DEGREE - 1;

/// Continuous functions of an element: its two hats first.
pub(super) const LOCAL: usize = DEGREE + 1;

/// Gauss points an element: products of two basis functions with G and p_q, to rounding for a p_q that
/// changes by ten powers of e, nearly so by twenty.
pub(super) const POINTS: usize = 2 * DEGREE + 6;

/// Values or slopes at the points, times the root of the weight: a product is a sum.
pub(super) type Row = [f64; POINTS];

/// A real matrix of the continuous functions of an element.
pub(super) type Square = [[f64; LOCAL]; LOCAL];

/// A number or a complex one.
pub(in crate::fokker_planck) trait Number:
    Copy + Default + AddAssign + Mul<f64, Output = Self> + MulAssign<f64>
{
}
impl Number for f64 {}
impl Number for Complex<f64> {}

/// The operators in one element, from its continuous to its discontinuous functions.
#[derive(Debug, Clone)]
pub(super) struct Element {
    /// d/dq, where functions are tilted d/dq + g G/s.
    pub(super) c: [[f64; LOCAL]; DEGREE],
    /// -d/dq + G/T, s in place of T.
    pub(super) d: [[f64; LOCAL]; DEGREE],
    /// C^T C, D^T D and C^T D.
    pub(super) cc: Square,
    pub(super) dd: Square,
    pub(super) cd: Square,
    /// Products of the hats.
    pub(super) mass: [[f64; 2]; 2],
    /// Products of the continuous functions with 1 and with the quantity that is watched.
    seen: [[f64; LOCAL]; 2],
    /// Its points, the root of the weight there, and the functions times it: the continuous and the discontinuous ones.
    pub(super) at: Points,
}

/// An element at its Gauss points.
#[derive(Debug, Clone)]
pub(super) struct Points {
    pub(super) ends: [f64; 2],
    pub(super) places: Row,
    pub(super) root: Row,
    pub(super) even: [Row; LOCAL],
    pub(super) odd: [Row; DEGREE],
}

impl Points {
    /// The products of the continuous functions with a function of q between them, and of the discontinuous ones.
    pub(super) fn products(&self, f: impl Fn(f64) -> f64) -> (Square, [[f64; DEGREE]; DEGREE]) {
        let f: Row = self.places.map(f);
        let sum = |a: &Row, b: &Row| a.iter().zip(b).zip(&f).map(|((a, b), f)| a * b * f).sum();
        let (even, odd) = (&self.even, &self.odd);
        (
            std::array::from_fn(|a| std::array::from_fn(|b| sum(&even[a], &even[b]))),
            std::array::from_fn(|a| std::array::from_fn(|b| sum(&odd[a], &odd[b]))),
        )
    }
}

impl Element {
    fn new(
        [low, high]: [f64; 2],
        (contact, pulls): (&ContactLaw, [f64; 2]),
        weight: impl Fn(f64) -> f64,
        quantity: Quantity,
    ) -> Result<Self> {
        let half = 0.5 * (high - low);
        let rule = gauss::<POINTS>();
        let legendre = Legendre::at(&rule.map(|(x, _)| x));
        let places = rule.map(|(x, _)| low + half * (1.0 + x));
        let mut root = [0.0; POINTS];
        for ((root, q), (_, w)) in root.iter_mut().zip(places).zip(rule) {
            *root = (w * half * weight(q)).sqrt();
        }
        let times = |f: &dyn Fn(usize) -> f64| -> Row { std::array::from_fn(|k| root[k] * f(k)) };
        let mut inner: Vec<[Row; 2]> = (2..=DEGREE)
            .map(|n| {
                let bubble = |of: &[Vec<f64>], k: usize| of[n][k] - of[n - 2][k];
                [
                    times(&|k| bubble(&legendre.value, k)),
                    times(&|k| bubble(&legendre.slope, k) / half),
                ]
            })
            .collect();
        orthonormalise(&mut inner)?;
        let mut odd: Vec<[Row; 2]> = (0..DEGREE)
            .map(|n| [times(&|k| legendre.value[n][k]), [0.0; POINTS]])
            .collect();
        orthonormalise(&mut odd)?;
        let hat = |sign: f64| {
            let mut it = [
                times(&|k| 0.5 * (1.0 + sign * rule[k].0)),
                times(&|_| 0.5 * sign / half),
            ];
            for _ in 0..2 {
                take_off(&mut it, &inner);
            }
            it
        };
        let all: Vec<[Row; 2]> = [hat(-1.0), hat(1.0)].into_iter().chain(inner).collect();
        let mut it = Self {
            c: [[0.0; LOCAL]; DEGREE],
            d: [[0.0; LOCAL]; DEGREE],
            cc: [[0.0; LOCAL]; LOCAL],
            dd: [[0.0; LOCAL]; LOCAL],
            cd: [[0.0; LOCAL]; LOCAL],
            mass: std::array::from_fn(|a| std::array::from_fn(|b| dot(&all[a][0], &all[b][0]))),
            seen: [[0.0; LOCAL]; 2],
            at: Points {
                ends: [low, high],
                places,
                root,
                even: std::array::from_fn(|b| all[b][0]),
                odd: std::array::from_fn(|a| odd[a][0]),
            },
        };
        for (b, [value, slope]) in all.iter().enumerate() {
            let [back, forth] = pulls.map(|t| -> Row {
                std::array::from_fn(|k| contact.force(places[k]) / t * value[k])
            });
            let slid: Row = std::array::from_fn(|k| slope[k] + back[k]);
            let pushed: Row = std::array::from_fn(|k| forth[k] - slope[k]);
            for (a, [other, _]) in odd.iter().enumerate() {
                it.c[a][b] = dot(other, &slid);
                it.d[a][b] = dot(other, &pushed);
            }
            it.seen[0][b] = dot(value, &root);
            it.seen[1][b] = dot(value, &times(&|k| quantity.of(contact, places[k])));
        }
        Ok(it)
    }

    /// Divides its hats by these, and makes the products.
    fn scale(&mut self, by: [f64; 2]) {
        for (b, by) in by.into_iter().enumerate() {
            for row in self.c.iter_mut().chain(&mut self.d) {
                row[b] /= by;
            }
            for seen in &mut self.seen {
                seen[b] /= by;
            }
            for value in &mut self.at.even[b] {
                *value /= by;
            }
            for a in 0..2 {
                self.mass[a][b] /= by;
                self.mass[b][a] /= by;
            }
        }
        let product = |x: &[[f64; LOCAL]; DEGREE], y: &[[f64; LOCAL]; DEGREE]| -> Square {
            let sum = |a: usize, b: usize| x.iter().zip(y).map(|(x, y)| x[a] * y[b]).sum();
            std::array::from_fn(|a| std::array::from_fn(|b| sum(a, b)))
        };
        self.cc = product(&self.c, &self.c);
        self.dd = product(&self.d, &self.d);
        self.cd = product(&self.c, &self.d);
    }
}

/// All elements, and the root R of the products of the hats, R^T R.
#[derive(Debug, Clone)]
pub(super) struct Basis {
    pub(super) elements: Vec<Element>,
    /// The diagonal of R, and what stands beside it.
    diagonal: Vec<f64>,
    beside: Vec<f64>,
    /// 1 and the quantity, in the orthonormal basis.
    pub(super) one: Vec<f64>,
    pub(super) quantity: Vec<f64>,
}

impl Basis {
    /// Elements between these ends.
    pub(super) fn new(
        oscillator: &Oscillator,
        (law, pulls): (&DisplacementLaw, [f64; 2]),
        ends: &[f64],
        quantity: Quantity,
    ) -> Result<Self> {
        let physics = (oscillator.contact(), pulls);
        let weight = |q: f64| law.density(q);
        let element = |ends: &[f64]| Element::new([ends[0], ends[1]], physics, weight, quantity);
        let elements: Result<Vec<Element>> = ends.windows(2).map(element).collect();
        let mut elements = elements?;
        let count = elements.len();
        let own = |elements: &[Element], k: usize| {
            let left = k.checked_sub(1).map_or(0.0, |e| elements[e].mass[1][1]);
            let right = elements.get(k).map_or(0.0, |it| it.mass[0][0]);
            left + right
        };
        let sizes: Vec<f64> = (0..=count).map(|k| own(&elements, k).sqrt()).collect();
        for (element, sizes) in elements.iter_mut().zip(sizes.windows(2)) {
            element.scale([sizes[0], sizes[1]]);
        }
        let mut it = Self {
            diagonal: vec![1.0; count + 1],
            beside: vec![0.0; count],
            one: vec![0.0; count * DEGREE + 1],
            quantity: vec![0.0; count * DEGREE + 1],
            elements,
        };
        for k in 0..=count {
            let before = k.checked_sub(1).map_or(0.0, |e| it.beside[e]);
            it.diagonal[k] = (own(&it.elements, k) - before * before).max(0.0).sqrt();
            if k < count {
                it.beside[k] = it.elements[k].mass[0][1] / it.diagonal[k];
            }
        }
        let [mut one, mut watched] = [it.one.clone(), it.quantity.clone()];
        for (e, element) in it.elements.iter().enumerate() {
            for (b, place) in it.places(e).into_iter().enumerate() {
                one[place] += element.seen[0][b];
                watched[place] += element.seen[1][b];
            }
        }
        for state in [&mut one, &mut watched] {
            it.project(state, 1);
        }
        // The truncated domain holds all of the weight.
        let size = one.iter().map(|x| x * x).sum::<f64>().sqrt();
        for x in &mut one {
            *x /= size;
        }
        let mean: f64 = one.iter().zip(&watched).map(|(a, b)| a * b).sum();
        let both = watched.iter_mut().zip(&one);
        both.for_each(|(x, one)| *x = (*x - mean * one) / size);
        (it.one, it.quantity) = (one, watched);
        Ok(it)
    }

    /// Where the continuous functions of an element stand: hats first, then the inner functions.
    pub(super) fn places(&self, element: usize) -> [usize; LOCAL] {
        let inner = self.elements.len() + 1 + element * INNER;
        std::array::from_fn(|b| if b < 2 { element + b } else { inner + b - 2 })
    }

    /// From coefficients in the orthonormal basis to those of hats, R^{-1}; so many a function.
    pub(super) fn hats_of<T: Number>(&self, x: &mut [T], each: usize) {
        let count = self.elements.len();
        for k in (0..=count).rev() {
            let (here, above) = x[k * each..].split_at_mut(each);
            if k < count {
                add(here, &above[..each], -self.beside[k]);
            }
            scale(here, 1.0 / self.diagonal[k]);
        }
    }

    /// Its inverse, R.
    pub(super) fn of_hats<T: Number>(&self, x: &mut [T], each: usize) {
        let count = self.elements.len();
        for k in 0..=count {
            let (here, above) = x[k * each..].split_at_mut(each);
            scale(here, self.diagonal[k]);
            if k < count {
                add(here, &above[..each], self.beside[k]);
            }
        }
    }

    /// From products with hats to those with the orthonormal basis, R^{-T}.
    pub(super) fn project<T: Number>(&self, x: &mut [T], each: usize) {
        for k in 0..=self.elements.len() {
            if k > 0 {
                let (below, here) = x[(k - 1) * each..].split_at_mut(each);
                add(&mut here[..each], below, -self.beside[k - 1]);
            }
            let here = &mut x[k * each..(k + 1) * each];
            scale(here, 1.0 / self.diagonal[k]);
        }
    }

    /// Its inverse, R^T.
    pub(super) fn test<T: Number>(&self, x: &mut [T], each: usize) {
        for k in (0..=self.elements.len()).rev() {
            let here = &mut x[k * each..(k + 1) * each];
            scale(here, self.diagonal[k]);
            if k > 0 {
                let (below, here) = x[(k - 1) * each..].split_at_mut(each);
                add(&mut here[..each], below, self.beside[k - 1]);
            }
        }
    }
}

fn scale<T: Number>(x: &mut [T], by: f64) {
    for x in x {
        *x *= by;
    }
}

fn add<T: Number>(to: &mut [T], what: &[T], times: f64) {
    for (to, what) in to.iter_mut().zip(what) {
        *to += *what * times;
    }
}

/// Takes its parts along orthonormal functions off a function.
fn take_off(it: &mut [Row; 2], functions: &[[Row; 2]]) {
    for other in functions {
        let overlap = dot(&it[0], &other[0]);
        for (it, other) in it.iter_mut().zip(other) {
            for (x, y) in it.iter_mut().zip(other) {
                *x -= overlap * y;
            }
        }
    }
}

/// Makes functions orthonormal by Gram and Schmidt, twice; their slopes follow.
fn orthonormalise(functions: &mut [[Row; 2]]) -> Result<()> {
    for i in 0..functions.len() {
        let (before, rest) = functions.split_at_mut(i);
        let here = &mut rest[0];
        for _ in 0..2 {
            let size = dot(&here[0], &here[0]).sqrt();
            take_off(here, before);
            let left = dot(&here[0], &here[0]).sqrt();
            if !(left.is_finite() && left > 1e-12 * size) {
                let what = "an element is so wide that the stationary law underflows within it";
                return Err(Error::linear("functions of q", what));
            }
            for x in here.iter_mut().flatten() {
                *x /= left;
            }
        }
    }
    Ok(())
}

/// Legendre polynomials and their slopes at some points, by degree.
struct Legendre {
    value: Vec<Vec<f64>>,
    slope: Vec<Vec<f64>>,
}

impl Legendre {
    fn at(points: &[f64]) -> Self {
        let mut it = Self {
            value: vec![vec![1.0; points.len()], points.to_vec()],
            slope: vec![vec![0.0; points.len()], vec![1.0; points.len()]],
        };
        for n in 2..=DEGREE {
            let m = n as f64;
            let (mut value, mut slope) = (Vec::new(), Vec::new());
            for (k, x) in points.iter().enumerate() {
                let (one, two) = (it.value[n - 1][k], it.value[n - 2][k]);
                value.push(((2.0 * m - 1.0) * x * one - (m - 1.0) * two) / m);
                slope.push(it.slope[n - 2][k] + (2.0 * m - 1.0) * it.value[n - 1][k]);
            }
            it.value.push(value);
            it.slope.push(slope);
        }
        it
    }
}
