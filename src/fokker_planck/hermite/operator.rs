//! The generator in Hermite functions of v and spectral elements of q, and its resolvent: for answers in
//! the frequency domain.
//!
//! With g(q, v) = sum_n a_n(q) h_n(v), h_n the Hermite polynomials orthonormal under the Gaussian of
//! variance T, the backward operator v d/dq - G d/dv + 2 zeta (T d2/dv2 - v d/dv) of (17) is
//!
//! ```text
//! (L a)_n = sqrt(T) [sqrt(n) C a_{n-1} - sqrt(n+1) D a_{n+1}] - 2 zeta n a_n,   C = d/dq,  D = -d/dq + G/T
//! ```
//!
//! C and D are adjoint under the stationary law p_q of q (Risken, The Fokker-Planck Equation, chapter 10:
//! Brinkman's hierarchy). Even n live on continuous piecewise polynomials of degree [`DEGREE`], odd n on
//! discontinuous ones of one degree less, both orthonormal under p_q; C and D are rectangular, each used
//! with its own transpose. Transport is then antisymmetric and friction with noise diagonal, whatever the
//! elements: the constant is a null vector on both sides and every other mode decays. An element ends at
//! the loss of contact, so the kink of G costs nothing; convergence is faster than any power of the
//! number of functions, and nearly so of elements.

use crate::error::{Error, Result};
use crate::oscillator::{Oscillator, Quantity};
use crate::quadrature::gauss;
use ndarray::{Array1, Array2, Axis, Slice};

/// Degree of the continuous polynomials. Higher degrees with fewer elements lose where p_q falls by
/// many powers of ten within an element.
pub(in crate::fokker_planck) const DEGREE: usize = 8;

/// Gauss points an element: products of two basis functions with G and p_q, to rounding for a p_q that
/// changes by ten powers of e.
const POINTS: usize = 2 * DEGREE + 6;

/// How finely the operator is resolved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::fokker_planck) struct Resolution {
    /// Elements of q.
    pub(in crate::fokker_planck) elements: usize,
    /// Pairs of Hermite functions, an even one and an odd one.
    pub(in crate::fokker_planck) pairs: usize,
    /// The box reaches to this energy above the lowest, in T.
    pub(in crate::fokker_planck) level: f64,
}

impl Resolution {
    /// Of so many times the elements and functions, in a box `higher` by so many T.
    pub(in crate::fokker_planck) fn finer(self, times: f64, higher: f64) -> Self {
        let more = |n: usize| (n as f64 * times).round() as usize;
        Self {
            elements: more(self.elements),
            pairs: more(self.pairs),
            level: self.level + higher,
        }
    }

    /// Functions of q.
    pub(in crate::fokker_planck) fn across(self) -> usize {
        self.elements * DEGREE + 1
    }

    /// Bytes that one solve holds.
    pub(in crate::fokker_planck) fn memory(self) -> u64 {
        (16 * (self.pairs + 6) * self.across() * self.across()) as u64
    }

    /// Floating-point operations of one solve: a complex factorisation, a solve with as many right-hand
    /// sides and two real products for each pair of functions.
    pub(in crate::fokker_planck) fn operations(self) -> f64 {
        self.pairs as f64 * (8.0 * 4.0 / 3.0 + 4.0) * (self.across() as f64).powi(3)
    }
}

/// The operator. A state is the coefficients of the even n, row by row, and then those of the odd n.
pub(in crate::fokker_planck) struct Hierarchy {
    pub(super) zeta: f64,
    pub(super) temperature: f64,
    pub(super) pairs: usize,
    /// d/dq from the continuous to the discontinuous functions.
    c: Array2<f64>,
    /// -d/dq + G/T, likewise.
    d: Array2<f64>,
    pub(super) cc: Array2<f64>,
    pub(super) dd: Array2<f64>,
    /// C^T D.
    pub(super) cd: Array2<f64>,
    quantity: Array1<f64>,
}

impl Hierarchy {
    /// The operator of `oscillator`, with a quantity to be watched.
    pub(in crate::fokker_planck) fn new(
        oscillator: &Oscillator,
        quantity: Quantity,
        resolution: Resolution,
    ) -> Result<Self> {
        let law = oscillator.displacement_law()?;
        let contact = oscillator.contact();
        let temperature = oscillator.temperature();
        let ends = ends(oscillator, resolution);
        let rule = gauss::<POINTS>();
        let even = Legendre::at(&rule.map(|(x, _)| x));
        let count = ends.len() - 1;
        let points = count * POINTS;
        // Values times sqrt(p_q dq) at the Gauss points, so that a product is a sum.
        let across = count * DEGREE + 1;
        let mut f = Array2::<f64>::zeros((across, points));
        let mut slope = Array2::<f64>::zeros((across, points));
        let mut odd = Array2::<f64>::zeros((count * DEGREE, points));
        let mut place = Vec::with_capacity(points);
        let mut root = Vec::with_capacity(points);
        for (e, end) in ends.windows(2).enumerate() {
            let half = 0.5 * (end[1] - end[0]);
            for (k, (x, w)) in rule.into_iter().enumerate() {
                let q = end[0] + half * (1.0 + x);
                let r = (w * half * law.density(q)).sqrt();
                let at = e * POINTS + k;
                place.push(q);
                root.push(r);
                f[[0, at]] = r;
                // Hats at the nodes 1, 2, ...; the constant stands for the one at node 0.
                f[[e + 1, at]] = r * 0.5 * (1.0 + x);
                slope[[e + 1, at]] = r * 0.5 / half;
                if e > 0 {
                    f[[e, at]] = r * 0.5 * (1.0 - x);
                    slope[[e, at]] = -r * 0.5 / half;
                }
                for n in 2..=DEGREE {
                    let row = count + 1 + e * (DEGREE - 1) + n - 2;
                    f[[row, at]] = r * (even.value[n][k] - even.value[n - 2][k]);
                    slope[[row, at]] = r * (even.slope[n][k] - even.slope[n - 2][k]) / half;
                }
                for n in 0..DEGREE {
                    odd[[e * DEGREE + n, at]] = r * even.value[n][k];
                }
            }
        }
        let total = root.iter().map(|r| r * r).sum::<f64>().sqrt();
        for array in [&mut f, &mut slope, &mut odd] {
            array.mapv_inplace(|x| x / total);
        }
        orthonormalise(&mut f, Some(&mut slope))?;
        for e in 0..count {
            let rows = Slice::from(e * DEGREE..(e + 1) * DEGREE);
            let columns = Slice::from(e * POINTS..(e + 1) * POINTS);
            let mut block = odd.slice_axis_mut(Axis(0), rows);
            let mut block = block.slice_axis_mut(Axis(1), columns);
            let mut own = block.to_owned();
            orthonormalise(&mut own, None)?;
            block.assign(&own);
        }
        let c = odd.dot(&slope.t());
        let mut pushed = f.clone();
        for (mut column, q) in pushed.columns_mut().into_iter().zip(&place) {
            column *= contact.force(*q) / temperature;
        }
        let d = odd.dot(&(pushed - &slope).t());
        let watched = place.iter().zip(&root);
        let watched: Array1<f64> = watched
            .map(|(q, r)| r / total * quantity.of(contact, *q))
            .collect();
        let mut quantity = f.dot(&watched);
        // The first function is the constant: without it, the deviation from the mean.
        quantity[0] = 0.0;
        Ok(Self {
            zeta: oscillator.zeta(),
            temperature,
            pairs: resolution.pairs,
            cc: c.t().dot(&c),
            dd: d.t().dot(&d),
            cd: c.t().dot(&d),
            c,
            d,
            quantity,
        })
    }

    /// Functions of q at even n.
    pub(in crate::fokker_planck) fn across(&self) -> usize {
        self.c.ncols()
    }

    /// Size of the largest entries of L.
    pub(in crate::fokker_planck) fn size(&self) -> f64 {
        let largest = |square: &Array2<f64>| square.diag().iter().copied().fold(0.0, f64::max);
        let slope = largest(&self.cc).max(largest(&self.dd)).sqrt();
        let n = 2.0 * self.pairs as f64;
        (self.temperature * n).sqrt() * slope + 2.0 * self.zeta * n
    }

    /// Functions of q at odd n.
    pub(in crate::fokker_planck) fn inside(&self) -> usize {
        self.c.nrows()
    }

    /// Length of a state.
    pub(in crate::fokker_planck) fn len(&self) -> usize {
        self.pairs * (self.c.ncols() + self.c.nrows())
    }

    /// Length of the part with even n, which v -> -v leaves alone; it turns the sign of the rest.
    pub(in crate::fokker_planck) fn even(&self) -> usize {
        self.pairs * self.c.ncols()
    }

    /// The deviation of the quantity from its mean, as a state.
    pub(in crate::fokker_planck) fn start(&self) -> Vec<f64> {
        let mut state = vec![0.0; self.len()];
        state[..self.across()].copy_from_slice(self.quantity.as_slice().unwrap_or(&[]));
        state
    }

    /// L x.
    pub(in crate::fokker_planck) fn apply(&self, x: &[f64]) -> Vec<f64> {
        let (even, odd) = x.split_at(self.even());
        let even = rows_of(even.to_vec(), self.across());
        let odd = rows_of(odd.to_vec(), self.inside());
        let mut out = self.odd_to_even(&odd);
        let mut below = self.even_to_odd(&even);
        for (n, mut row) in out.rows_mut().into_iter().enumerate() {
            let friction = -4.0 * self.zeta * n as f64;
            row.scaled_add(friction, &even.row(n));
        }
        for (n, mut row) in below.rows_mut().into_iter().enumerate() {
            let friction = -2.0 * self.zeta * (2 * n + 1) as f64;
            row.scaled_add(friction, &odd.row(n));
        }
        out.into_iter().chain(below).collect()
    }

    /// What transport carries from the odd n, one row each, into the even ones:
    /// sqrt(T) (sqrt(n) D^T o_{n-1} - sqrt(n+1) C^T o_{n+1}).
    pub(in crate::fokker_planck) fn odd_to_even(&self, odd: &Array2<f64>) -> Array2<f64> {
        let (c, d) = (odd.dot(&self.c), odd.dot(&self.d));
        let heat = self.temperature.sqrt();
        let mut out = Array2::zeros((self.pairs, self.across()));
        for (i, mut row) in out.rows_mut().into_iter().enumerate() {
            let n = (2 * i) as f64;
            row.scaled_add(-heat * (n + 1.0).sqrt(), &c.row(i));
            if i > 0 {
                row.scaled_add(heat * n.sqrt(), &d.row(i - 1));
            }
        }
        out
    }

    /// The same from the even n into the odd ones: sqrt(T) (sqrt(n) C e_{n-1} - sqrt(n+1) D e_{n+1}).
    pub(in crate::fokker_planck) fn even_to_odd(&self, even: &Array2<f64>) -> Array2<f64> {
        let (c, d) = (even.dot(&self.c.t()), even.dot(&self.d.t()));
        let heat = self.temperature.sqrt();
        let mut out = Array2::zeros((self.pairs, self.inside()));
        for (i, mut row) in out.rows_mut().into_iter().enumerate() {
            let n = (2 * i + 1) as f64;
            row.scaled_add(heat * n.sqrt(), &c.row(i));
            if i + 1 < self.pairs {
                row.scaled_add(-heat * (n + 1.0).sqrt(), &d.row(i + 1));
            }
        }
        out
    }
}

/// Values as rows of a width that divides their number.
pub(super) fn rows_of(values: Vec<f64>, width: usize) -> Array2<f64> {
    Array2::from_shape_vec((values.len() / width, width), values).unwrap_or_default()
}

/// Ends of the elements: equal lengths on either side of the loss of contact, numbers in proportion to
/// the root of the length, since flights are parabolas in time, and never more in flight than in contact,
/// where the motion turns fastest.
fn ends(oscillator: &Oscillator, resolution: Resolution) -> Vec<f64> {
    let contact = oscillator.contact();
    let rise = resolution.level * oscillator.temperature();
    let (left, right) = contact.turning_points(rise).unwrap_or((-1.0, 1.0));
    let count = resolution.elements;
    let loss = contact.loss_point().filter(|q| *q > left && *q < right);
    let Some(loss) = loss.filter(|_| count > 1) else {
        let at = |k: usize| left + (right - left) * k as f64 / count as f64;
        return (0..=count).map(at).collect();
    };
    let (flight, held) = ((loss - left).sqrt(), (right - loss).sqrt());
    let most = (count / 2).max(1);
    let below = (count as f64 * flight / (flight + held)).round() as usize;
    let below = below.clamp(1, most);
    let above = count - below;
    let flights = (0..below).map(|k| left + (loss - left) * k as f64 / below as f64);
    let contacts = (0..=above).map(|k| loss + (right - loss) * k as f64 / above as f64);
    flights.chain(contacts).collect()
}

/// Makes the rows orthonormal by Gram and Schmidt, twice; `along` follows with the same combinations.
fn orthonormalise(rows: &mut Array2<f64>, mut along: Option<&mut Array2<f64>>) -> Result<()> {
    for i in 0..rows.nrows() {
        for _ in 0..2 {
            let (before, mut rest) = rows.view_mut().split_at(Axis(0), i);
            let mut here = rest.row_mut(0);
            let size = here.dot(&here).sqrt();
            let scale = if size > 0.0 { 1.0 / size } else { 1.0 };
            here *= scale;
            let overlaps = before.dot(&here);
            here -= &overlaps.dot(&before);
            let left = here.dot(&here).sqrt();
            if !(left.is_finite() && left > 1e-12) {
                return Err(Error::Mesh {
                    what: "the stationary law underflows within an element".into(),
                    help: "more method.cells in q".into(),
                });
            }
            here /= left;
            if let Some(along) = &mut along {
                let (before, mut rest) = along.view_mut().split_at(Axis(0), i);
                let mut here = rest.row_mut(0);
                here *= scale;
                here -= &overlaps.dot(&before);
                here /= left;
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
                value.push(
                    ((2.0 * m - 1.0) * x * it.value[n - 1][k] - (m - 1.0) * it.value[n - 2][k]) / m,
                );
                slope.push(it.slope[n - 2][k] + (2.0 * m - 1.0) * it.value[n - 1][k]);
            }
            it.value.push(value);
            it.slope.push(slope);
        }
        it
    }
}
