//! The resolvent (s - L)^{-1} of a [`Hierarchy`]: one factorisation, any number of right-hand sides.
//!
//! Odd n are eliminated first, then the inner functions of each element (`condensed`), which leaves a block
//! tridiagonal system in the hats, node after node, all even n of a node a block. For Re s > 0 its blocks have a
//! positive real part, so the order of elimination is stable.

use super::basis::INNER;
use super::condensed::{Condensed, Ends, Rates, Small};
use super::nested::Nested;
use super::operator::Hierarchy;
use crate::error::{Deadline, Result};
use crate::sparse::DenseLu;
use ndarray::Array2;
use num_complex::Complex;

type C = Complex<f64>;

/// Residual, relative to the right-hand side, that refinement is content with.
const REFINED: f64 = 1e-11;

/// s - L, factored.
pub(in crate::fokker_planck) struct Factored<'a> {
    full: &'a Hierarchy,
    shift: C,
    rates: Rates,
    /// Inverses of the inner blocks, element by element.
    inner: Vec<Vec<Small>>,
    /// Of each node its own block, and the one that couples it with the next.
    nodes: Vec<DenseLu>,
    next: Vec<Array2<C>>,
    /// All of it, where friction depends on the displacement.
    whole: Option<Nested>,
}

impl<'a> Factored<'a> {
    /// Factors `shift` - L on the states without a constant part; the constant, which L neither reads nor
    /// writes, is left alone, so that the shift may be 0. `late` is asked before each element.
    ///
    /// # Errors
    /// [`crate::Error::Linear`] if a block is singular: a shift at an eigenvalue; those of `late`.
    pub(in crate::fokker_planck) fn new(
        full: &'a Hierarchy,
        shift: C,
        late: &Deadline,
    ) -> Result<Self> {
        let k = full.pairs;
        let rates = Rates::new(full.zeta, full.weights.in_v(), shift, k);
        if let Some(local) = &full.local {
            return Ok(Self {
                full,
                shift,
                rates,
                inner: Vec::new(),
                nodes: Vec::new(),
                next: Vec::new(),
                whole: Some(local.factored(shift, late)?),
            });
        }
        let count = full.basis.elements.len();
        let (mut inner, mut nodes) = (Vec::new(), Vec::new());
        let mut next: Vec<Array2<C>> = Vec::new();
        let mut here = Array2::<C>::default((k, k));
        // At 0 the constant is fixed at one node; a right-hand side without it then gives a solution that is 0 there.
        let heaviest = |a: &usize, b: &usize| full.basis.one[*a].total_cmp(&full.basis.one[*b]);
        let pinned = (0..=count)
            .max_by(heaviest)
            .filter(|_| shift == C::default());
        for e in 0..=count {
            late()?;
            let mut after = Array2::<C>::default((k, k));
            if let Some(element) = full.basis.elements.get(e) {
                let condensed = Condensed::new(element, &rates)?;
                let Ends {
                    left,
                    across,
                    right,
                } = condensed.ends();
                inner.push(condensed.inverse.into_owned());
                here += &left;
                after = right;
                next.push(across);
            }
            if pinned == Some(e) {
                here[[0, 0]] += 1.0;
            }
            let lu = DenseLu::factor(&here)?;
            if let Some(across) = next.get(e) {
                // Columns of a matrix stand in the memory of its transpose row by row.
                let mut columns: Vec<C> = across.t().iter().copied().collect();
                lu.solve(&mut columns)?;
                let solved = Array2::from_shape_vec((k, k), columns).unwrap_or_default();
                // The matrix is symmetric.
                after -= &solved.dot(across);
            }
            nodes.push(lu);
            here = after;
        }
        Ok(Self {
            full,
            shift,
            rates,
            inner,
            nodes,
            next,
            whole: None,
        })
    }

    /// The same as [`Factored::solve`], refined: under weak friction odd n divide by little, and a solution loses
    /// digits in proportion to 1/zeta^2.
    pub(in crate::fokker_planck) fn refined(&self, b: &[C]) -> Result<Vec<C>> {
        let size = |x: &[C]| x.iter().map(C::norm_sqr).sum::<f64>().sqrt();
        let mut x = self.solve(b)?;
        let mut before = f64::INFINITY;
        for _ in 0..4 {
            let image = self.full.apply(&x);
            let parts = image.into_iter().zip(&x).zip(b);
            let mut left: Vec<C> = parts.map(|((y, x), b)| b - self.shift * x + y).collect();
            self.full.drop_constant(&mut left);
            let rest = size(&left);
            if rest <= REFINED * size(b) || rest > 0.5 * before {
                break;
            }
            before = rest;
            let more = self.solve(&left)?;
            x.iter_mut().zip(more).for_each(|(x, more)| *x += more);
        }
        Ok(x)
    }

    /// x of (s - L) x = b; the constant part of b is dropped.
    ///
    /// # Errors
    /// [`crate::Error::Linear`] for a solution that is not finite.
    pub(in crate::fokker_planck) fn solve(&self, b: &[C]) -> Result<Vec<C>> {
        let (full, basis) = (self.full, &self.full.basis);
        let k = full.pairs;
        let mut x = b.to_vec();
        full.drop_constant(&mut x);
        if let Some(whole) = &self.whole {
            basis.test(&mut x[..full.even()], k);
            whole.solve(&mut x)?;
            basis.of_hats(&mut x[..full.even()], k);
            full.drop_constant(&mut x);
            return Ok(x);
        }
        let (even, odd) = x.split_at_mut(full.even());
        // The odd n in terms of the even ones: o_n = (b_n + transport of e)/(s + 2 zeta n).
        let friction = self.rates.friction.iter();
        let half: Vec<C> = friction.map(|it| (it + 2.0 * full.zeta).inv()).collect();
        let over = |odd: &mut [C]| {
            for row in odd.chunks_exact_mut(k) {
                row.iter_mut().zip(&half).for_each(|(x, over)| *x *= over);
            }
        };
        let given = odd.to_vec();
        over(odd);
        basis.test(even, k);
        full.odd_to_even(odd, even);
        let condensed = || {
            let all = basis.elements.iter().zip(&self.inner);
            all.map(|(element, inverse)| Condensed {
                element,
                rates: &self.rates,
                inverse: inverse.into(),
            })
        };
        let (hats, rest) = even.split_at_mut((basis.elements.len() + 1) * k);
        let mut inner = Vec::with_capacity(basis.elements.len());
        for (e, it) in condensed().enumerate() {
            let rest = &rest[e * INNER * k..(e + 1) * INNER * k];
            let mut own: Vec<[C; INNER]> = (0..k)
                .map(|i| std::array::from_fn(|b| rest[b * k + i]))
                .collect();
            it.solve(&mut own);
            for h in 0..2 {
                let at = &mut hats[(e + h) * k..(e + h + 1) * k];
                at.iter_mut()
                    .zip(it.on_hat(h, &own))
                    .for_each(|(x, y)| *x -= y);
            }
            inner.push(own);
        }
        self.solve_hats(hats)?;
        for (e, (it, own)) in condensed().zip(&mut inner).enumerate() {
            let mut more = it.on_inner([0, 1].map(|h| &hats[(e + h) * k..(e + h + 1) * k]));
            it.solve(&mut more);
            let rest = &mut rest[e * INNER * k..(e + 1) * INNER * k];
            for (i, (own, more)) in own.iter().zip(more).enumerate() {
                for b in 0..INNER {
                    rest[b * k + i] = own[b] - more[b];
                }
            }
        }
        odd.copy_from_slice(&given);
        full.even_to_odd(even, odd);
        over(odd);
        basis.of_hats(even, k);
        full.drop_constant(&mut x);
        Ok(x)
    }

    /// Node after node and back.
    fn solve_hats(&self, x: &mut [C]) -> Result<()> {
        let k = self.full.pairs;
        for (e, node) in self.nodes.iter().enumerate() {
            let (here, after) = x[e * k..].split_at_mut(k);
            let mut solved = here.to_vec();
            node.solve(&mut solved)?;
            if let Some(across) = self.next.get(e) {
                for (row, x) in across.rows().into_iter().zip(&solved) {
                    after.iter_mut().zip(row).for_each(|(y, a)| *y -= a * x);
                }
            }
        }
        for (e, node) in self.nodes.iter().enumerate().rev() {
            let (here, after) = x[e * k..].split_at_mut(k);
            if let Some(across) = self.next.get(e) {
                for (row, x) in across.rows().into_iter().zip(here.iter_mut()) {
                    *x -= row.iter().zip(&*after).map(|(a, y)| a * y).sum::<C>();
                }
            }
            node.solve(here)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::resolution::Resolution;
    use super::*;
    use crate::contact::ContactLaw;
    use crate::oscillator::{Oscillator, Quantity};

    #[test]
    fn the_resolvent_inverts_the_operator_and_constants_stay() {
        let it = Oscillator::new(ContactLaw::Hertz, 0.02, 5e-3).unwrap();
        let resolution = Resolution {
            elements: 4,
            pairs: 10,
            level: 20.0,
        };
        let it = Hierarchy::new(&it, Quantity::Force, resolution).unwrap();
        let one = it.at_any_speed(&it.basis.one);
        assert!(it.apply(&one).iter().all(|x| x.abs() < 1e-11));
        let start: Vec<C> = it.start().iter().map(|x| C::new(*x, 0.0)).collect();
        let mut full: Vec<C> = (0..it.len())
            .map(|k| C::new((k as f64).sin(), (2.0 * k as f64).cos()))
            .collect();
        it.drop_constant(&mut full);
        let shifts = [C::new(0.003, 0.9), C::default(), C::new(0.0, 1e-5)];
        let all = shifts
            .into_iter()
            .flat_map(|shift| [(shift, &start), (shift, &full)]);
        for (shift, b) in all {
            let inverse = Factored::new(&it, shift, &|| Ok(())).unwrap();
            let x = inverse.solve(b).unwrap();
            let image = it.apply(&x);
            let size = x.iter().map(|x| x.norm()).fold(0.0, f64::max);
            for (k, b) in b.iter().enumerate() {
                let left = shift * x[k] - image[k] - b;
                assert!(left.norm() < 1e-11 * size.max(1.0), "{shift}, {k}: {left}");
            }
        }
    }
}
