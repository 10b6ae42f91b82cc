//! The resolvent (s - L)^{-1} of a [`Hierarchy`]: one block factorisation, any number of right-hand sides.
//!
//! Odd n are eliminated, which leaves a block tridiagonal system in the even n, and that from the highest
//! n downwards. For Re s > 0 its blocks have a positive real part, so the order of elimination is stable.

use super::operator::{Hierarchy, rows_of};
use crate::error::Result;
use crate::sparse::DenseLu;
use ndarray::{Array2, Zip};
use num_complex::Complex;

type C = Complex<f64>;

/// Residual, relative to the right-hand side, that refinement is content with.
const REFINED: f64 = 1e-11;

/// s - L, factored.
pub(in crate::fokker_planck) struct Factored<'a> {
    full: &'a Hierarchy,
    shift: C,
    /// Schur complement of each even n, the lowest first.
    blocks: Vec<DenseLu>,
}

impl<'a> Factored<'a> {
    /// Factors `shift` - L on the states without a constant part; the constant, which L neither reads nor
    /// writes, is left alone, so that the shift may be 0. `late` is asked before each block.
    ///
    /// # Errors
    /// [`crate::Error::Linear`] if a block is singular: a shift at an eigenvalue; those of `late`.
    pub(in crate::fokker_planck) fn new(
        full: &'a Hierarchy,
        shift: C,
        late: &dyn Fn() -> Result<()>,
    ) -> Result<Self> {
        let across = full.across();
        let t = full.temperature;
        let mut it = Self {
            full,
            shift,
            blocks: Vec::with_capacity(full.pairs),
        };
        let back: Vec<C> = full.cd.iter().map(|x| C::new(*x, 0.0)).collect();
        for i in (0..full.pairs).rev() {
            late()?;
            let n = (2 * i) as f64;
            let above = t * (n + 1.0) / it.friction(n + 1.0);
            let below = if i > 0 {
                t * n / it.friction(n - 1.0)
            } else {
                C::default()
            };
            let mut block = Array2::from_shape_fn((across, across), |place| {
                above * full.cc[place] + below * full.dd[place]
            });
            block.diag_mut().mapv_inplace(|x| x + it.friction(n));
            if let Some(next) = it.blocks.last() {
                // Columns of (C^T D)^T stand in the memory of C^T D row by row.
                let mut carried = back.clone();
                next.solve(&mut carried)?;
                let part = |of: fn(&C) -> f64| {
                    let values = carried.iter().map(of).collect();
                    full.cd.dot(&rows_of(values, across).t())
                };
                let (re, im) = (part(|x| x.re), part(|x| x.im));
                let factor = it.coupling(n) * it.coupling(n);
                Zip::from(&mut block)
                    .and(&re)
                    .and(&im)
                    .for_each(|b, re, im| *b -= factor * C::new(*re, *im));
            }
            if i == 0 {
                block[[0, 0]] = C::new(1.0, 0.0);
            }
            it.blocks.push(DenseLu::factor(&block)?);
        }
        it.blocks.reverse();
        Ok(it)
    }

    /// s + 2 zeta n.
    fn friction(&self, n: f64) -> C {
        self.shift + 2.0 * self.full.zeta * n
    }

    /// From even n to n + 2 through the odd n + 1.
    fn coupling(&self, n: f64) -> C {
        self.full.temperature * ((n + 1.0) * (n + 2.0)).sqrt() / self.friction(n + 1.0)
    }

    /// The same as [`Factored::solve`], refined: under weak friction odd n divide by little, and a solution loses
    /// digits in proportion to 1/zeta^2.
    ///
    /// # Errors
    /// Those of [`Factored::solve`].
    pub(in crate::fokker_planck) fn refined(&self, b: &[C]) -> Result<Vec<C>> {
        let size = |x: &[C]| x.iter().map(C::norm_sqr).sum::<f64>().sqrt();
        let mut x = self.solve(b)?;
        let mut before = f64::INFINITY;
        for _ in 0..4 {
            let part = |of: fn(&C) -> f64| self.full.apply(&x.iter().map(of).collect::<Vec<_>>());
            let image = part(|x| x.re).into_iter().zip(part(|x| x.im));
            let parts = image.zip(&x).zip(b);
            let mut left: Vec<C> = parts
                .map(|(((re, im), x), b)| b - self.shift * x + C::new(re, im))
                .collect();
            left[0] = C::default();
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
        let full = self.full;
        let (k, across, inside) = (full.pairs, full.across(), full.inside());
        let (even, odd) = b.split_at(full.even());
        // The odd n in terms of the even ones: o_n = (b_n + transport of e)/(s + 2 zeta n).
        let scaled: Vec<C> = odd
            .iter()
            .enumerate()
            .map(|(at, x)| x / self.friction((2 * (at / inside) + 1) as f64))
            .collect();
        let mut x: Vec<C> = both(&scaled, inside, |part| full.odd_to_even(part))
            .zip(even)
            .map(|(carried, b)| carried + b)
            .collect();
        x[0] = C::default();
        for i in (0..k).rev() {
            if i + 1 < k {
                let above = both(&x[(i + 1) * across..(i + 2) * across], across, |part| {
                    part.dot(&full.cd.t())
                });
                let above: Vec<C> = above.collect();
                let factor = self.coupling((2 * i) as f64);
                for (x, above) in x[i * across..].iter_mut().zip(above) {
                    *x += factor * above;
                }
            }
            if i == 0 {
                x[0] = C::default();
            }
            self.blocks[i].solve(&mut x[i * across..(i + 1) * across])?;
        }
        for i in 1..k {
            let below = both(&x[(i - 1) * across..i * across], across, |part| {
                part.dot(&full.cd)
            });
            let mut below: Vec<C> = below.collect();
            self.blocks[i].solve(&mut below)?;
            let factor = self.coupling((2 * i - 2) as f64);
            for (x, below) in x[i * across..].iter_mut().zip(below) {
                *x += factor * below;
            }
        }
        let carried: Vec<C> = both(&x, across, |part| full.even_to_odd(part)).collect();
        x.extend(
            carried
                .iter()
                .zip(odd)
                .enumerate()
                .map(|(at, (a, b))| (a + b) / self.friction((2 * (at / inside) + 1) as f64)),
        );
        Ok(x)
    }
}

/// A real linear map applied to the real and to the imaginary part of complex rows.
fn both(
    x: &[C],
    width: usize,
    map: impl Fn(&Array2<f64>) -> Array2<f64>,
) -> impl Iterator<Item = C> {
    let part = |of: fn(&C) -> f64| map(&rows_of(x.iter().map(of).collect(), width));
    let (re, im) = (part(|x| x.re), part(|x| x.im));
    re.into_iter().zip(im).map(|(re, im)| C::new(re, im))
}

#[cfg(test)]
mod tests {
    use super::super::operator::Resolution;
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
        let mut one = vec![0.0; it.len()];
        one[0] = 1.0;
        assert!(it.apply(&one).iter().all(|x| x.abs() < 1e-11));
        let shift = C::new(0.003, 0.9);
        let start: Vec<C> = it.start().iter().map(|x| C::new(*x, 0.0)).collect();
        let mut full: Vec<C> = (0..it.len())
            .map(|k| C::new((k as f64).sin(), (2.0 * k as f64).cos()))
            .collect();
        full[0] = C::default();
        for b in [start, full] {
            let inverse = Factored::new(&it, shift, &|| Ok(())).unwrap();
            let x = inverse.solve(&b).unwrap();
            let [re, im] = [
                it.apply(&x.iter().map(|x| x.re).collect::<Vec<_>>()),
                it.apply(&x.iter().map(|x| x.im).collect::<Vec<_>>()),
            ];
            let size = x.iter().map(|x| x.norm()).fold(0.0, f64::max);
            for (k, b) in b.iter().enumerate() {
                let left = shift * x[k] - C::new(re[k], im[k]) - b;
                assert!(left.norm() < 1e-11 * size.max(1.0), "{k}: {left}");
            }
        }
    }
}
