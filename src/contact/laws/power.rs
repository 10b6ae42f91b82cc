//! A contact of any exponent, with or without a second wall behind a gap.

use crate::contact::kind::Kind;
use crate::contact::parameters::{Parameter, Parameters};
use crate::contact::restoring::Restoring;
use crate::contact::three_halves::less_one;
use crate::error::Result;
use std::sync::Arc;

pub(super) const KIND: Kind = Kind {
    name: "power",
    keys: &["exponent", "gap", "back"],
    make,
};

/// G = (1 + q/n)_+^n - 1: contact lost at q = -n, stiffness 1 at q = 0. With a second wall a gap g beyond the loss,
/// G falls by back ((-n - g - q)/n)_+^n: backlash under a mean load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Power {
    exponent: f64,
    wall: Option<Wall>,
}

/// The second wall.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Wall {
    gap: f64,
    /// Its stiffness over that of the first.
    back: f64,
}

fn make(given: &Parameters) -> Result<Arc<dyn Restoring>> {
    let exponent = given
        .number("exponent")?
        .filter(|n| (1.0..=100.0).contains(n));
    let Some(exponent) = exponent else {
        let accepted = "a number from 1 to 100; 1.5 is Hertz's, 1 a linear spring";
        return Err(given.refuse("exponent", accepted));
    };
    let (gap, back) = (given.number("gap")?, given.number("back")?);
    let wall = match (gap, back) {
        (None, None) => None,
        (None, Some(_)) => return Err(given.refuse("gap", "a width >= 0 of the gap, with back")),
        (Some(gap), _) if gap < 0.0 => return Err(given.refuse("gap", "a width >= 0 of the gap")),
        (Some(_), Some(back)) if back <= 0.0 => {
            let accepted = "a number > 0: the second wall's stiffness over the first's";
            return Err(given.refuse("back", accepted));
        }
        (Some(gap), back) => Some(Wall {
            gap,
            back: back.unwrap_or(1.0),
        }),
    };
    Ok(Arc::new(Power { exponent, wall }))
}

/// x_+^n, by roots and products for the exponents of point and line contacts and springs.
#[inline(always)]
fn raised(x: f64, n: f64) -> f64 {
    let x = x.max(0.0);
    if n == 1.5 {
        x * x.sqrt()
    } else if n == 1.0 {
        x
    } else if n == 2.0 {
        x * x
    } else {
        x.powf(n)
    }
}

/// (1 + x)_+^n - 1, without cancellation near x = 0.
#[inline(always)]
fn raised_less_one(x: f64, n: f64) -> f64 {
    let x = x.max(-1.0);
    if n == 1.5 {
        less_one(x)
    } else if n == 1.0 {
        x
    } else if n == 2.0 {
        x * (2.0 + x)
    } else if x.abs() > 0.25 {
        // Half the time, and no digits are lost.
        (1.0 + x).powf(n) - 1.0
    } else {
        (n * x.ln_1p()).exp_m1()
    }
}

impl Power {
    /// Depth in the second wall over n, and its stiffness.
    #[inline(always)]
    fn behind(&self, q: f64) -> Option<(f64, f64)> {
        let Wall { gap, back } = self.wall?;
        let depth = -self.exponent - gap - q;
        (depth > 0.0).then_some((depth / self.exponent, back))
    }
}

impl Restoring for Power {
    fn name(&self) -> &'static str {
        KIND.name
    }

    fn force(&self, q: f64) -> f64 {
        let n = self.exponent;
        let front = raised_less_one(q / n, n);
        match self.behind(q) {
            Some((depth, back)) => front - back * raised(depth, n),
            None => front,
        }
    }

    fn potential(&self, q: f64) -> f64 {
        let n = self.exponent;
        let front = front(q, n);
        match self.behind(q) {
            Some((depth, back)) => front + back * n / (n + 1.0) * raised(depth, n + 1.0),
            None => front,
        }
    }

    fn stiffness(&self, q: f64) -> f64 {
        let n = self.exponent;
        // At a kink, the value on the side of contact.
        let front = if q < -n {
            0.0
        } else {
            raised(1.0 + q / n, n - 1.0)
        };
        match self.wall {
            Some(Wall { gap, back }) if q <= -n - gap => {
                front + back * raised((-n - gap - q) / n, n - 1.0)
            }
            _ => front,
        }
    }

    /// None where the second wall leaves no gap.
    fn loss_point(&self) -> Option<f64> {
        let open = self.wall.is_none_or(|wall| wall.gap > 0.0);
        open.then_some(-self.exponent)
    }

    fn back_wall(&self) -> Option<f64> {
        let wall = self.wall.filter(|wall| wall.gap > 0.0);
        wall.map(|wall| -self.exponent - wall.gap)
    }

    fn kinks(&self) -> Vec<f64> {
        let wall = self.back_wall().into_iter();
        wall.chain([-self.exponent]).collect()
    }

    /// The inverse of G, which never falls.
    fn roots(&self, force: f64) -> Vec<f64> {
        let n = self.exponent;
        if force > -1.0 {
            return vec![n * (force.ln_1p() / n).exp_m1()];
        }
        let behind = self.wall.filter(|it| force < -1.0 || it.gap == 0.0);
        let place = |Wall { gap, back }: Wall| -n - gap - n * ((-1.0 - force) / back).powf(1.0 / n);
        behind.map(place).into_iter().collect()
    }

    fn parameters(&self) -> Parameters {
        let given = Parameters::new().with("exponent", Parameter::Number(self.exponent));
        match self.wall {
            Some(Wall { gap, back }) => given
                .with("gap", Parameter::Number(gap))
                .with("back", Parameter::Number(back)),
            None => given,
        }
    }
}

/// (n/(n+1)) [(1 + x)^{n+1} - 1] - q with x = q/n, without cancellation near q = 0.
fn front(q: f64, n: f64) -> f64 {
    let x = q / n;
    let weight = n / (n + 1.0);
    if x <= -1.0 {
        return -q - weight;
    }
    if x.abs() * (n + 1.0) > 0.3 {
        return weight * (raised(1.0 + x, n + 1.0) - 1.0) - q;
    }
    // weight sum_{k>=2} binomial(n + 1, k) x^k.
    let (mut term, mut sum) = (0.5 * (n + 1.0) * n * x * x, 0.0);
    for k in 2..30 {
        sum += term;
        let k = f64::from(k);
        term *= x * (n + 1.0 - k) / (k + 1.0);
        if term.abs() <= 1e-18 * sum {
            break;
        }
    }
    weight * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn power(exponent: f64, wall: Option<(f64, f64)>) -> Power {
        let wall = wall.map(|(gap, back)| Wall { gap, back });
        Power { exponent, wall }
    }

    #[test]
    fn force_potential_and_stiffness_are_each_other_s_derivatives() {
        for n in [1.0, 10.0 / 9.0, 1.5, 2.0, 2.5, 3.0, 7.0] {
            for wall in [None, Some((2.0, 1.0)), Some((0.0, 0.3))] {
                let law = power(n, wall);
                let mut worst: [f64; 2] = [0.0; 2];
                for k in -300..=200 {
                    let q = 0.02 * n * f64::from(k) + 1e-3;
                    let s = 1e-5;
                    let slope = |f: &dyn Fn(f64) -> f64| (f(q + s) - f(q - s)) / (2.0 * s);
                    let size = law.force(q).abs().max(1.0);
                    worst[0] =
                        worst[0].max((slope(&|q| law.potential(q)) - law.force(q)).abs() / size);
                    if n >= 1.5 {
                        let size = law.stiffness(q).abs().max(1.0);
                        worst[1] = worst[1]
                            .max((slope(&|q| law.force(q)) - law.stiffness(q)).abs() / size);
                    }
                }
                println!("n = {n}, {wall:?}: {:.1e} {:.1e}", worst[0], worst[1]);
                assert!(worst[0] < 1e-8 && worst[1] < 1e-6);
            }
        }
    }

    #[test]
    fn the_inverse_of_the_force_is_its_inverse() {
        for wall in [None, Some((2.0, 0.5))] {
            let law = power(1.2, wall);
            assert_eq!(law.roots(0.0), [0.0]);
            for q in [-5.0, -3.5, -1.1, -0.3, 1e-7, 4.0] {
                match law.roots(law.force(q))[..] {
                    [root] => assert!((root - q).abs() < 1e-13 * q.abs() + 1e-15, "{root} {q}"),
                    _ => assert!(q < -1.2 && wall.is_none(), "{q}"),
                }
            }
        }
    }

    #[test]
    fn the_potential_near_the_equilibrium_does_not_cancel() {
        for n in [1.0, 10.0 / 9.0, 2.0, 5.0] {
            for q in [1e-6f64, -1e-4, 1e-3] {
                // q^2/2 + (n - 1)/(6 n) q^3 + (n - 1)(n - 2)/(24 n^2) q^4 + ...
                let third = (n - 1.0) / (6.0 * n) * q;
                let fourth = (n - 1.0) * (n - 2.0) / (24.0 * n * n) * q * q;
                let fifth = (n - 1.0) * (n - 2.0) * (n - 3.0) / (120.0 * n.powi(3)) * q.powi(3);
                let exact = q * q * (0.5 + third + fourth + fifth);
                let error = (power(n, None).potential(q) / exact - 1.0).abs();
                assert!(error < 1e-12, "n = {n}, q = {q}: {error:e}");
            }
        }
        // Where the series and the closed form meet.
        for n in [1.2, 4.0] {
            let edge = 0.3 * n / (n + 1.0);
            let [a, b] =
                [edge * (1.0 - 1e-12), edge * (1.0 + 1e-12)].map(|q| power(n, None).potential(q));
            assert!((a / b - 1.0).abs() < 1e-10, "{a} {b}");
        }
    }
}
