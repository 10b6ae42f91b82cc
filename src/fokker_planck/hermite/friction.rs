//! The stationary law where friction depends on the displacement: the null vector of the transpose of the operator
//! (`local`), which is the law over the weights.

use super::basis::{DEGREE, Element, LOCAL, POINTS};
use super::nested::Shape;
use super::operator::Hierarchy;
use super::resolution::Resolution;
use super::weights::Weights;
use crate::error::{Deadline, Error, Result};
use crate::gaussian::maxwell;
use crate::moments::RawMoments;
use crate::oscillator::{DisplacementLaw, Oscillator, Quantity};
use crate::quadrature::{gauss, legendre};
use num_complex::Complex;

/// Degrees of the Legendre polynomials of an element.
const DEGREES: usize = DEGREE + 1;

/// The stationary law of a friction that depends on the displacement, over the weights: sum_n b_n(q) h_n(v).
#[derive(Debug, Clone)]
pub(in crate::fokker_planck) struct Kept {
    /// The weight of q.
    law: DisplacementLaw,
    weights: Weights,
    /// Ends of the elements, ascending.
    ends: Vec<f64>,
    /// Legendre coefficients of each b_n of each element.
    parts: Vec<Vec<[f64; DEGREES]>>,
    /// Integrals of b_n over the law of q.
    means: Vec<f64>,
    /// Integrals of h_n over that of v.
    constant: Vec<f64>,
    /// Expectations, not divided by their mass.
    pub(in crate::fokker_planck) raw: RawMoments,
    /// E\[c v^2\], which is pi h.
    pub(in crate::fokker_planck) dissipated: f64,
    /// What rounding leaves open, relative to the size of the law.
    pub(in crate::fokker_planck) rounding: f64,
}

/// Bytes and floating-point operations of a factorisation at a resolution.
pub(in crate::fokker_planck) fn work(it: Resolution) -> (u64, f64) {
    let shape = Shape {
        elements: it.elements,
        pairs: it.pairs,
    };
    (shape.memory(), shape.operations())
}

/// A law that so many Hermite functions do not hold. Where an impact takes most of the energy, noise alone throws the next flight: a
/// height x falls as exp(-c sqrt(x)), and functions that see so far do not see what happens in contact.
pub(in crate::fokker_planck) fn heavy(oscillator: &Oscillator, found: &str) -> Error {
    let damping = oscillator.damping().name();
    Error::Unresolved {
        what: format!(
            "the stationary law under \"{damping}\" damping falls too slowly with the height of a flight for Hermite \
             functions, {found}"
        ),
    }
}

/// What a failed solve says of an operator under such damping: its digits go where functions are too few for the law.
pub(in crate::fokker_planck) fn lost_digits(oscillator: &Oscillator, error: Error) -> Error {
    match error {
        Error::Linear { what, .. } if !oscillator.is_viscous() => heavy(oscillator, &what),
        error => error,
    }
}

/// A null vector that still changes by more is none; what it changes by is in the error of the law.
const LOST: f64 = 1e-3;

/// The stationary law over the weights, as coefficients of the functions with hats as they are, and what rounding leaves of it
/// open: inverse iteration on the transpose of the operator, from no structure.
///
/// # Errors
/// [`Error::Unresolved`] if the iteration does not settle; those of `late`.
pub(super) fn null(
    oscillator: &Oscillator,
    full: &Hierarchy,
    late: &Deadline,
) -> Result<(Vec<f64>, f64)> {
    let forward = match &full.local {
        Some(local) => local.transposed(),
        None => full.whole(oscillator).transposed(),
    };
    let lu = forward.factored(Complex::new(1e-10 * forward.norm()?, 0.0), late)?;
    let mut x = vec![Complex::<f64>::default(); full.len()];
    let even = x[..full.even()].iter_mut().step_by(full.pairs);
    even.for_each(|x| x.re = 1.0);
    let mut change = f64::INFINITY;
    for _ in 0..30 {
        late()?;
        let before = x;
        x = forward.weighed(&before);
        lu.solve(&mut x)
            .map_err(|error| lost_digits(oscillator, error))?;
        let size = x.iter().map(|x| x.re * x.re).sum::<f64>().sqrt();
        let along: f64 = x.iter().zip(&before).map(|(a, b)| a.re * b.re).sum();
        let over = 1.0 / size.copysign(along);
        for x in &mut x {
            *x = Complex::new(x.re * over, 0.0);
        }
        let parts = x.iter().zip(&before).map(|(a, b)| (a.re - b.re).powi(2));
        let now = parts.sum::<f64>().sqrt();
        // Settled when rounding no longer lets the change fall.
        let settled = now < 1e-12 || (now < LOST && now > 0.5 * change);
        change = now;
        if settled {
            break;
        }
    }
    if change > LOST || change.is_nan() {
        let what = format!("inverse iteration still changes by {change:.1e} after 30 solves");
        return Err(heavy(oscillator, &what));
    }
    Ok((x.into_iter().map(|x| x.re).collect(), change))
}

impl Kept {
    /// The law at a resolution, by inverse iteration from no structure.
    ///
    /// # Errors
    /// [`Error::Unresolved`] if the iteration does not settle; those of the basis and of `late`.
    pub(in crate::fokker_planck) fn new(
        oscillator: &Oscillator,
        resolution: Resolution,
        late: &Deadline,
    ) -> Result<Self> {
        let full = Hierarchy::new(oscillator, Quantity::Displacement, resolution)?;
        let (x, rounding) = null(oscillator, &full, late)?;
        let law = Self::read(oscillator, &full, &x)?;
        Ok(Self { rounding, ..law })
    }

    fn read(oscillator: &Oscillator, full: &Hierarchy, x: &[f64]) -> Result<Self> {
        let (k, basis, contact) = (full.pairs, &full.basis, oscillator.contact());
        let (even, odd) = x.split_at(full.even());
        let powers = powers(full.weights, k);
        let mut it = Self {
            law: full.law.clone(),
            weights: full.weights,
            ends: vec![],
            parts: vec![],
            means: vec![0.0; 2 * k],
            constant: powers[0].clone(),
            raw: RawMoments::default(),
            dissipated: 0.0,
            rounding: 0.0,
        };
        let legendre = gauss::<POINTS>();
        for (e, element) in basis.elements.iter().enumerate() {
            let at = &element.at;
            it.ends.push(at.ends[0]);
            let places = basis.places(e);
            let mut part = Vec::with_capacity(2 * k);
            // The integrals of 1, v and v^2 at the points, times it too.
            let mut sums = [[0.0; POINTS]; 3];
            for n in 0..2 * k {
                // b_n at the points, times the root of the weight.
                let mut values = [0.0; POINTS];
                let mut more = |by: f64, row: &[f64; POINTS]| {
                    for (value, x) in values.iter_mut().zip(row) {
                        *value += by * x;
                    }
                };
                if n % 2 == 0 {
                    for (b, place) in places.into_iter().enumerate().take(LOCAL) {
                        more(even[place * k + n / 2], &at.even[b]);
                    }
                } else {
                    for a in 0..DEGREE {
                        more(odd[(e * DEGREE + a) * k + n / 2], &at.odd[a]);
                    }
                }
                it.means[n] += values.iter().zip(&at.root).map(|(b, r)| b * r).sum::<f64>();
                for (sum, powers) in sums.iter_mut().zip(&powers) {
                    let both = sum.iter_mut().zip(&values);
                    both.for_each(|(sum, b)| *sum += powers[n] * b);
                }
                part.push(coefficients(&legendre, &values, element));
            }
            it.parts.push(part);
            for j in 0..POINTS {
                let (q, root) = (at.places[j], at.root[j]);
                let there = sums.map(|b| b[j] * root);
                it.raw.add(contact, q, there);
                it.dissipated += oscillator.friction(q) * there[2];
            }
        }
        if let Some(last) = basis.elements.last() {
            it.ends.push(last.at.ends[1]);
        }
        let mass = it.raw.mass;
        if !(mass.is_finite() && mass.abs() > 1e-12) {
            return Err(heavy(oscillator, "the null vector holds no probability"));
        }
        it.dissipated /= mass;
        it.means.iter_mut().for_each(|x| *x /= mass);
        for part in it.parts.iter_mut().flatten().flatten() {
            *part /= mass;
        }
        Ok(it)
    }

    /// Where the elements begin and end.
    pub(in crate::fokker_planck) fn domain(&self) -> [f64; 2] {
        [self.ends[0], self.ends[self.ends.len() - 1]]
    }

    /// Places with their weights in q, the points of the elements, and in v, equal steps.
    pub(in crate::fokker_planck) fn quadrature(&self) -> [Vec<(f64, f64)>; 2] {
        const STEPS: i32 = 240;
        let fastest = self.fastest();
        let step = 2.0 * fastest / f64::from(STEPS);
        let speeds = (0..=STEPS).map(|k| (f64::from(k) * step - fastest, step));
        let elements = self.ends.windows(2).flat_map(|ends| {
            let half = 0.5 * (ends[1] - ends[0]);
            gauss::<POINTS>().map(|(x, w)| (ends[0] + half * (1.0 + x), w * half))
        });
        [elements.collect(), speeds.collect()]
    }

    /// The velocity that the truncated domain holds.
    fn fastest(&self) -> f64 {
        1.2 * (2.0 * self.weights.energy).sqrt()
    }

    /// Ends of intervals of v from 0 on, for sums over it.
    pub(in crate::fokker_planck) fn panels(&self) -> Vec<f64> {
        let panel = self.fastest() / 27.0;
        (0..=27).map(|k| f64::from(k) * panel).collect()
    }

    /// b_n(q) for all n; empty beyond the domain. At a common end the mean of both elements.
    fn ratios(&self, q: f64) -> Vec<f64> {
        let last = self.ends.len() - 1;
        if !(q >= self.ends[0] && q <= self.ends[last]) {
            return Vec::new();
        }
        let right = self.ends.partition_point(|end| *end <= q).clamp(1, last) - 1;
        let left = if self.ends[right] == q && right > 0 {
            right - 1
        } else {
            right
        };
        let mut sums = vec![0.0; self.means.len()];
        for e in [left, right] {
            let (low, high) = (self.ends[e], self.ends[e + 1]);
            let polynomials =
                legendre::<DEGREES>(((2.0 * q - low - high) / (high - low)).clamp(-1.0, 1.0));
            for (sum, part) in sums.iter_mut().zip(&self.parts[e]) {
                let value: f64 = part.iter().zip(&polynomials).map(|(a, p)| a * p).sum();
                *sum += 0.5 * value;
            }
        }
        sums
    }

    /// sum_n b_n h_n(v).
    fn sum(&self, ratios: &[f64], v: f64) -> f64 {
        let x = v / self.weights.in_v().sqrt();
        let (mut before, mut here, mut sum) = (0.0, 1.0, 0.0);
        for (n, b) in ratios.iter().enumerate() {
            sum += b * here;
            let n = n as f64;
            let next = (x * here - n.sqrt() * before) / (n + 1.0).sqrt();
            (before, here) = (here, next);
        }
        sum
    }

    /// The law at one displacement.
    pub(in crate::fokker_planck) fn column(&self, q: f64) -> Column<'_> {
        Column {
            law: self,
            q,
            ratios: self.ratios(q),
            weight: self.law.density(q),
        }
    }

    /// p_q(q).
    pub(in crate::fokker_planck) fn density_q(&self, q: f64) -> f64 {
        let parts = self.ratios(q).into_iter().zip(&self.constant);
        self.law.density(q) * parts.map(|(b, h)| b * h).sum::<f64>()
    }

    /// p_v(v).
    pub(in crate::fokker_planck) fn density_v(&self, v: f64) -> f64 {
        maxwell(v, self.weights.of_law()) * self.sum(&self.means, v)
    }
}

/// A stationary law at one displacement.
pub(in crate::fokker_planck) struct Column<'a> {
    law: &'a Kept,
    q: f64,
    ratios: Vec<f64>,
    weight: f64,
}

impl Column<'_> {
    /// The displacement.
    pub(in crate::fokker_planck) fn q(&self) -> f64 {
        self.q
    }

    /// p(q, v).
    pub(in crate::fokker_planck) fn density(&self, v: f64) -> f64 {
        let law = self.law;
        self.weight * maxwell(v, law.weights.of_law()) * law.sum(&self.ratios, v)
    }
}

/// The integrals of 1, v and v^2 times each h_n over the factor of p, of mass 1.
fn powers(weights: Weights, pairs: usize) -> [Vec<f64>; 3] {
    let count = 2 * pairs;
    let mut all = vec![0.0; count + 2];
    for (x, it) in all.iter_mut().step_by(2).zip(weights.constant(pairs + 1)) {
        *x = it;
    }
    // v h_n = t^{1/2} (sqrt(n+1) h_{n+1} + sqrt(n) h_{n-1}).
    let times_v = |of: &[f64]| -> Vec<f64> {
        let t = weights.in_v();
        let below = |n: usize| {
            n.checked_sub(1)
                .map_or(0.0, |m| (t * n as f64).sqrt() * of[m])
        };
        let above = |n: usize| (t * (n + 1) as f64).sqrt() * of[n + 1];
        (0..of.len() - 1).map(|n| below(n) + above(n)).collect()
    };
    let first = times_v(&all);
    let second = times_v(&first);
    [all, first, second]
}

/// Legendre coefficients of a polynomial from its values at the points, times the root of the weight.
fn coefficients(
    rule: &[(f64, f64); POINTS],
    values: &[f64; POINTS],
    element: &Element,
) -> [f64; DEGREES] {
    let mut sums = [0.0; DEGREES];
    for (j, (x, w)) in rule.iter().enumerate() {
        let value = values[j] / element.at.root[j];
        for (n, (sum, p)) in sums.iter_mut().zip(legendre::<DEGREES>(*x)).enumerate() {
            *sum += (n as f64 + 0.5) * w * p * value;
        }
    }
    sums
}
