//! Interpolation by cardinal B-splines of degree 3, 5 and 7 on a uniform mesh coordinate (order 4, 6, 8).
//!
//! f(x) = sum_k c_k B(x - k), the c_k from the values by recursive filters (Unser, Aldroubi and Eden,
//! IEEE Trans. Signal Process. 41, 821 and 834, 1993). The support is that of the polynomial through as
//! many points, the error constant |B_n|/n! instead of (n-1)!!^2/(2^n n!): 1/1200 of it at order 8.
//! Values continue beyond the first and the last node by reflection there, so a constant stays one.

use std::ops::Range;

/// Degree of interpolation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Order {
    /// Cubic splines, order 4.
    Fourth,
    /// Quintic splines, order 6.
    Sixth,
    /// Splines of degree 7, order 8.
    Eighth,
}

impl Order {
    /// Every choice, lowest first.
    pub const ALL: [Self; 3] = [Self::Fourth, Self::Sixth, Self::Eighth];

    /// Order of accuracy, and number of points of the stencil.
    pub fn points(self) -> usize {
        match self {
            Self::Fourth => 4,
            Self::Sixth => 6,
            Self::Eighth => 8,
        }
    }

    /// Coefficients beyond either end of the nodes.
    pub(crate) fn margin(self) -> usize {
        self.points() / 2 - 1
    }

    /// Roots inside the unit circle of the sampled B-spline.
    fn poles(self) -> &'static [f64] {
        match self {
            Self::Fourth => &[-0.267_949_192_431_122_7],
            Self::Sixth => &[-0.430_575_347_099_973_8, -0.043_096_288_203_264_65],
            Self::Eighth => &[
                -0.535_280_430_796_438_2,
                -0.122_554_615_192_326_7,
                -0.009_148_694_809_608_277,
            ],
        }
    }

    /// Gain of the filter, the product of (1 - z)(1 - 1/z).
    pub(crate) fn gain(self) -> f64 {
        self.poles()
            .iter()
            .map(|z| (1.0 - z) * (1.0 - 1.0 / z))
            .product()
    }
}

/// The weights of a stencil as polynomials of the place between two nodes.
#[derive(Debug, Clone)]
pub(crate) struct Spline {
    order: Order,
    /// `table[p][r]`: coefficient of f^p in the weight of point r.
    table: [[f64; 8]; 8],
}

impl Spline {
    pub(crate) fn new(order: Order) -> Self {
        let degree = order.points() - 1;
        // N[r] as a polynomial of f, raised degree by degree (de Boor).
        let mut basis = [[0.0; 8]; 8];
        basis[0][0] = 1.0;
        for p in 1..=degree {
            let mut saved = [0.0; 8];
            for r in 0..p {
                let over: [f64; 8] = std::array::from_fn(|k| basis[r][k] / p as f64);
                // (r + 1 - f) over and (f + p - r - 1) over.
                let times = |constant: f64, slope: f64| -> [f64; 8] {
                    std::array::from_fn(|k| {
                        constant * over[k] + if k > 0 { slope * over[k - 1] } else { 0.0 }
                    })
                };
                let right = times((r + 1) as f64, -1.0);
                basis[r] = std::array::from_fn(|k| saved[k] + right[k]);
                saved = times((p - r - 1) as f64, 1.0);
            }
            basis[p] = saved;
        }
        let table = std::array::from_fn(|p| std::array::from_fn(|r| basis[r][p]));
        Self { order, table }
    }

    /// Weights of the points floor(x) - margin, ... for x = floor(x) + f; 0 beyond the order.
    #[inline(always)]
    pub(crate) fn weights(&self, f: f64) -> [f64; 8] {
        let mut sum = self.table[self.order.points() - 1];
        for row in self.table[..self.order.points() - 1].iter().rev() {
            for r in 0..8 {
                sum[r] = sum[r].mul_add(f, row[r]);
            }
        }
        sum
    }

    /// First coefficient (counted from the first padded one) and place in between, for x clamped to the
    /// nodes 0..n.
    #[inline(always)]
    pub(crate) fn place(x: f64, n: usize) -> (usize, f64) {
        let x = x.clamp(0.0, (n - 1) as f64);
        let floor = x.floor().min((n - 2) as f64);
        (floor as usize, x - floor)
    }
}

/// Turns the rows of `values` (n rows of `width`) into B-spline coefficients along the rows' index, in
/// place, but for the factor [`Order::gain`].
#[inline(always)]
pub(crate) fn filter(order: Order, values: &mut [f64], width: usize) {
    let n = values.len() / width;
    let mut first = [0.0; 16];
    for &z in order.poles() {
        // Columns in groups small enough for the sums of the first row to stay in registers.
        let mut column = 0;
        while column < width {
            let group = (width - column).min(16);
            first[..group].fill(0.0);
            initial(
                z,
                values,
                width,
                column..column + group,
                &mut first[..group],
            );
            values[column..column + group].copy_from_slice(&first[..group]);
            column += group;
        }
        for i in 1..n {
            let (before, here) = values[(i - 1) * width..(i + 1) * width].split_at_mut(width);
            for (here, before) in here.iter_mut().zip(before) {
                *here = z.mul_add(*before, *here);
            }
        }
        let factor = z / (z * z - 1.0);
        let (before, here) = values[(n - 2) * width..n * width].split_at_mut(width);
        for (here, before) in here.iter_mut().zip(before) {
            *here = factor * z.mul_add(*before, *here);
        }
        for i in (0..n - 1).rev() {
            let (here, after) = values[i * width..(i + 2) * width].split_at_mut(width);
            for (here, after) in here.iter_mut().zip(after) {
                *here = z * (*after - *here);
            }
        }
    }
}

/// sum_k z^k s_k over the reflected rows: the start of the causal recursion.
#[inline(always)]
fn initial(z: f64, values: &[f64], width: usize, columns: Range<usize>, sum: &mut [f64]) {
    let n = values.len() / width;
    let period = 2 * n - 2;
    let horizon = ((1e-18f64.ln() / z.abs().ln()).ceil() as usize).min(period);
    let mut power = 1.0f64;
    for k in 0..horizon {
        let row = if k < n { k } else { period - k };
        let row = &values[row * width + columns.start..row * width + columns.end];
        for (sum, s) in sum.iter_mut().zip(row) {
            *sum = power.mul_add(*s, *sum);
        }
        power *= z;
    }
    if horizon == period {
        for sum in sum {
            *sum /= 1.0 - power;
        }
    }
}

/// Row `k` (counted from `margin` before the first) of rows reflected at the first and last of `n`.
pub(crate) fn reflected(k: usize, margin: usize, n: usize) -> usize {
    let distance = k.abs_diff(margin);
    if distance < n {
        distance
    } else {
        2 * (n - 1) - distance
    }
}

/// The matrix from n values to their n + 2 margin coefficients, row-major (n + 2 margin) x n.
pub(crate) fn coefficients(order: Order, n: usize) -> Vec<f64> {
    let mut inner = vec![0.0; n * n];
    for i in 0..n {
        inner[i * n + i] = order.gain();
    }
    filter(order, &mut inner, n);
    let margin = order.margin();
    (0..n + 2 * margin)
        .flat_map(|k| {
            let row = reflected(k, margin, n);
            inner[row * n..(row + 1) * n].to_vec()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The spline through `f` at n nodes of [0, 1], at x.
    fn through(order: Order, n: usize, f: impl Fn(f64) -> f64, x: f64) -> f64 {
        let values: Vec<f64> = (0..n).map(|k| f(k as f64 / (n - 1) as f64)).collect();
        let matrix = coefficients(order, n);
        let spline = Spline::new(order);
        let (first, place) = Spline::place(x * (n - 1) as f64, n);
        let weights = spline.weights(place);
        (0..order.points())
            .map(|r| {
                let row = &matrix[(first + r) * n..(first + r + 1) * n];
                weights[r] * row.iter().zip(&values).map(|(a, b)| a * b).sum::<f64>()
            })
            .sum()
    }

    #[test]
    fn the_spline_goes_through_its_values_and_keeps_a_constant() {
        for order in Order::ALL {
            for n in [8, 11, 40] {
                let f = |x: f64| (7.0 * x).sin() + x;
                for k in 0..n {
                    let x = k as f64 / (n - 1) as f64;
                    let error = (through(order, n, f, x) - f(x)).abs();
                    assert!(error < 1e-13, "{order:?} {n} at node {k}: {error:e}");
                }
                for x in [-0.1, 0.0, 0.013, 0.5, 0.77, 1.0, 1.2] {
                    assert!((through(order, n, |_| 1.0, x) - 1.0).abs() < 1e-14);
                }
            }
        }
    }

    #[test]
    fn splines_have_the_order_of_their_name() {
        for order in Order::ALL {
            // Even about both ends, as the reflection takes it.
            let f = |x: f64| (3.0 * std::f64::consts::PI * x).cos();
            let worst = |n: usize| {
                (0..=1000)
                    .map(|k| {
                        let x = f64::from(k) / 1000.0;
                        (through(order, n, f, x) - f(x)).abs()
                    })
                    .fold(0.0, f64::max)
            };
            let (coarse, fine) = (worst(25), worst(49));
            let rate = (coarse / fine).log2();
            println!("{order:?}: {coarse:.2e}, {fine:.2e}, order {rate:.2}");
            assert!((rate - order.points() as f64).abs() < 0.3);
            // |B_n|/n! (k dx)^n times at most 2 at the middle of a cell.
            let constant = match order {
                Order::Fourth => 1.0 / 720.0,
                Order::Sixth => 1.0 / 30240.0,
                Order::Eighth => 1.0 / 1_209_600.0,
            };
            let reach = 3.0 * std::f64::consts::PI / 48.0;
            assert!(fine < 2.2 * constant * reach.powi(order.points() as i32));
        }
    }
}
