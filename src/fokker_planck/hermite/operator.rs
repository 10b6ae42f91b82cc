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
//! discontinuous ones of one degree less (`basis`), both orthonormal under p_q; C and D are rectangular, each used
//! with its own transpose. Transport is then antisymmetric and friction with noise diagonal, whatever the
//! elements: the constant is a null vector on both sides and every other mode decays. An element ends at
//! the loss of contact, so the kink of G costs nothing; convergence is faster than any power of the
//! number of functions, and nearly so of elements. Where friction depends on the displacement the weights are others (`weights`).

use super::basis::{Basis, DEGREE, LOCAL, Number};
use super::local::Local;
use super::resolution::Resolution;
use super::weights::Weights;
use crate::error::Result;
use crate::matrix::dot;
use crate::oscillator::{DisplacementLaw, Oscillator, Quantity};
use num_complex::Complex;

/// The operator. A state is the coefficients of the even n, function of q by function, n running fastest, and
/// then those of the odd n.
pub(in crate::fokker_planck) struct Hierarchy {
    pub(super) zeta: f64,
    pub(super) weights: Weights,
    /// The weight of q.
    pub(super) law: DisplacementLaw,
    /// The constant, function of v by function, of length 1.
    pub(super) speeds: Vec<f64>,
    pub(super) pairs: usize,
    pub(super) basis: Basis,
    /// The whole operator, where friction depends on the displacement.
    pub(super) local: Option<Local>,
}

impl Hierarchy {
    /// The operator of `oscillator`, with a quantity to be watched.
    pub(in crate::fokker_planck) fn new(
        oscillator: &Oscillator,
        quantity: Quantity,
        resolution: Resolution,
    ) -> Result<Self> {
        let weights = Weights::of(oscillator, resolution);
        let law = weights.of_displacement(oscillator)?;
        let ends = ends(oscillator, weights.energy, resolution.elements);
        let mut speeds = weights.constant(resolution.pairs);
        let size = dot(&speeds, &speeds).sqrt();
        for x in &mut speeds {
            *x /= size;
        }
        let mut it = Self {
            zeta: oscillator.zeta(),
            weights,
            speeds,
            pairs: resolution.pairs,
            basis: Basis::new(oscillator, (&law, weights.pulls()), &ends, quantity)?,
            law,
            local: None,
        };
        if !oscillator.is_viscous() {
            it.local = Some(it.whole(oscillator));
        }
        Ok(it)
    }

    /// The whole operator of any friction.
    pub(super) fn whole(&self, oscillator: &Oscillator) -> Local {
        Local::new(&self.basis, self.pairs, (oscillator, self.weights))
    }

    /// How far a left vector is from v -> -v of the right one.
    pub(in crate::fokker_planck) fn skew(&self) -> f64 {
        self.weights.skew()
    }

    /// Whether friction depends on the displacement: v -> -v then does not turn L into its transpose, and L writes into
    /// the constant, though it does not read it.
    pub(in crate::fokker_planck) fn is_local(&self) -> bool {
        self.local.is_some()
    }

    /// The same for the forward operator, on p over the weights; None where v -> -v makes it of this one.
    pub(super) fn transposed(&self) -> Option<Self> {
        let local = self.local.as_ref()?.transposed();
        Some(Self {
            basis: self.basis.clone(),
            local: Some(local),
            law: self.law.clone(),
            speeds: self.speeds.clone(),
            ..*self
        })
    }

    /// What rounding makes of L times a state of length 1: orthonormal functions under a p_q that falls by many powers of ten
    /// (measured at T = 26, where equal eigenvalues of three resolutions differ by 2e-13 of the largest entries of L).
    pub(in crate::fokker_planck) fn rounding(&self) -> f64 {
        let mut slope = 0.0f64;
        for element in &self.basis.elements {
            for a in 0..LOCAL {
                slope = slope.max(element.cc[a][a]).max(element.dd[a][a]);
            }
        }
        let slope = slope.sqrt();
        let n = 2.0 * self.pairs as f64;
        2e-13 * ((self.weights.in_v() * n).sqrt() * slope + 2.0 * self.zeta * n)
    }

    /// Length of a state.
    pub(in crate::fokker_planck) fn len(&self) -> usize {
        self.even() + self.pairs * DEGREE * self.basis.elements.len()
    }

    /// Length of the part with even n, which v -> -v leaves alone; it turns the sign of the rest.
    pub(in crate::fokker_planck) fn even(&self) -> usize {
        self.pairs * self.basis.one.len()
    }

    /// What viscous friction takes of a state, 2 zeta sum n |x_n|^2, and how much of it moves, the sum over n above 0.
    pub(in crate::fokker_planck) fn taken(&self, x: &[Complex<f64>]) -> [f64; 2] {
        let mut sums = [0.0; 2];
        for (k, x) in x.iter().enumerate() {
            let n = if k < self.even() {
                2 * (k % self.pairs)
            } else {
                2 * ((k - self.even()) % self.pairs) + 1
            };
            if n > 0 {
                sums[0] += 2.0 * self.zeta * n as f64 * x.norm_sqr();
                sums[1] += x.norm_sqr();
            }
        }
        sums
    }

    /// The rate at which friction settles a motion within a well.
    pub(in crate::fokker_planck) fn relaxation(&self) -> f64 {
        (2.0 * self.zeta).min(0.5 / self.zeta)
    }

    /// The deviation of the quantity from its mean, as a state.
    pub(in crate::fokker_planck) fn start(&self) -> Vec<f64> {
        self.at_any_speed(&self.basis.quantity)
    }

    /// A function of q, from its coefficients, as a state.
    pub(super) fn at_any_speed(&self, of: &[f64]) -> Vec<f64> {
        let mut state = vec![0.0; self.len()];
        for (state, of) in state.chunks_exact_mut(self.pairs).zip(of) {
            for (x, by) in state.iter_mut().zip(&self.speeds) {
                *x = of * by;
            }
        }
        state
    }

    /// The part of a state along the constant.
    pub(super) fn constant<T: Number>(&self, x: &[T]) -> T {
        let mut part = T::default();
        for (x, one) in x.chunks_exact(self.pairs).zip(&self.basis.one) {
            for (x, by) in x.iter().zip(&self.speeds) {
                part += *x * (one * by);
            }
        }
        part
    }

    /// Takes the constant part off a state: L does not read it, and writes it only where friction depends on the displacement.
    pub(in crate::fokker_planck) fn drop_constant<T: Number>(&self, x: &mut [T]) {
        let part = self.constant(x);
        for (x, one) in x.chunks_exact_mut(self.pairs).zip(&self.basis.one) {
            for (x, by) in x.iter_mut().zip(&self.speeds) {
                *x += part * -(one * by);
            }
        }
    }

    /// L x; without the constant it writes where friction depends on the displacement.
    pub(in crate::fokker_planck) fn apply<T: Number>(&self, x: &[T]) -> Vec<T> {
        let (k, basis) = (self.pairs, &self.basis);
        if let Some(local) = &self.local {
            let mut hats = x.to_vec();
            basis.hats_of(&mut hats[..self.even()], k);
            let mut out = local.image(&hats);
            basis.project(&mut out[..self.even()], k);
            self.drop_constant(&mut out);
            return out;
        }
        let (even, odd) = x.split_at(self.even());
        let mut hats = even.to_vec();
        basis.hats_of(&mut hats, k);
        let mut out = vec![T::default(); x.len()];
        let (above, below) = out.split_at_mut(self.even());
        self.even_to_odd(&hats, below);
        self.odd_to_even(odd, above);
        basis.project(above, k);
        for (at, (out, x)) in out.iter_mut().zip(x).enumerate() {
            let n = 2 * (at % k) + usize::from(at >= self.even());
            *out += *x * (-2.0 * self.zeta * n as f64);
        }
        out
    }

    /// Adds what transport carries from the odd n into the even ones, as products with hats and inner functions:
    /// sqrt(T) (sqrt(n) D^T o_{n-1} - sqrt(n+1) C^T o_{n+1}).
    pub(super) fn odd_to_even<T: Number>(&self, odd: &[T], out: &mut [T]) {
        let k = self.pairs;
        let [up, down] = self.heats();
        let (mut c, mut d) = (vec![T::default(); k], vec![T::default(); k]);
        for (e, element) in self.basis.elements.iter().enumerate() {
            let rows = &odd[e * DEGREE * k..(e + 1) * DEGREE * k];
            for (b, place) in self.basis.places(e).into_iter().enumerate() {
                c.fill(T::default());
                d.fill(T::default());
                for (a, row) in rows.chunks_exact(k).enumerate() {
                    let (times, other) = (element.c[a][b], element.d[a][b]);
                    for ((c, d), x) in c.iter_mut().zip(&mut d).zip(row) {
                        *c += *x * times;
                        *d += *x * other;
                    }
                }
                let out = &mut out[place * k..(place + 1) * k];
                for (i, out) in out.iter_mut().enumerate() {
                    *out += c[i] * -up[i];
                    if i > 0 {
                        *out += d[i - 1] * down[i - 1];
                    }
                }
            }
        }
    }

    /// Adds the same from the even n, coefficients of hats and inner functions, into the odd ones:
    /// sqrt(T) (sqrt(n) C e_{n-1} - sqrt(n+1) D e_{n+1}).
    pub(super) fn even_to_odd<T: Number>(&self, even: &[T], out: &mut [T]) {
        let k = self.pairs;
        let [up, down] = self.heats();
        let (mut c, mut d) = (vec![T::default(); k], vec![T::default(); k]);
        for (e, element) in self.basis.elements.iter().enumerate() {
            let places = self.basis.places(e);
            let rows = &mut out[e * DEGREE * k..(e + 1) * DEGREE * k];
            for (a, out) in rows.chunks_exact_mut(k).enumerate() {
                c.fill(T::default());
                d.fill(T::default());
                for (b, place) in places.into_iter().enumerate() {
                    let (times, other) = (element.c[a][b], element.d[a][b]);
                    let row = &even[place * k..(place + 1) * k];
                    for ((c, d), x) in c.iter_mut().zip(&mut d).zip(row) {
                        *c += *x * times;
                        *d += *x * other;
                    }
                }
                for (i, out) in out.iter_mut().enumerate() {
                    *out += c[i] * up[i];
                    if i + 1 < k {
                        *out += d[i + 1] * -down[i];
                    }
                }
            }
        }
    }

    /// sqrt(T (2i + 1)) and sqrt(T (2i + 2)).
    fn heats(&self) -> [Vec<f64>; 2] {
        [1, 2].map(|add| {
            let all = 0..self.pairs;
            all.map(|i| (self.weights.in_v() * (2 * i + add) as f64).sqrt())
                .collect()
        })
    }
}

/// The narrowest gap that has elements of its own, over the length of the domain.
const NARROWEST: f64 = 3e-8;

/// Powers of the number of an element to which its distance from the nearest kink grows, in flight without a second wall and
/// elsewhere. Flights are parabolas in time: with 2 motions that turn at the ends of the elements last equally longer from one to
/// the next. Where the force holds a motion, it turns fastest at the far end.
const EVEN: [f64; 2] = [2.0, 1.0];

/// What a friction that depends on the displacement adds to them, next to the loss bending p within sqrt(T)/c and less, times c
/// as far as it is below 1, the frequency of small motions. The rate of losses under friction in contact (exponent 1.052,
/// zeta = 1.42, h = 0.108) errs by 3e-5 of itself on 121 x 120 functions, without by 6e-3; the spectrum at zeta = 0.5, T = 2 meets
/// 1e-3 in 5 s, without misses it in 10. At zeta = 0.005, T = 0.5 the whole would miss what is met without.
const GRADED: [f64; 2] = [0.5, 1.0];

/// Ends of the elements, some of them on the kinks of the force, next to which they are shorter. With one kink, the loss of
/// contact, numbers on either side are in proportion to the root of the length, never more in flight than in contact.
fn ends(oscillator: &Oscillator, energy: f64, count: usize) -> Vec<f64> {
    let contact = oscillator.contact();
    let (left, right) = contact.turning_points(energy).unwrap_or((-1.0, 1.0));
    let mut kinks = contact.kinks();
    kinks.retain(|q| *q > left && *q < right);
    // An element that narrow drowns in rounding, and no number sees it.
    kinks.dedup_by(|next, kink| *next - *kink < NARROWEST * (right - left));
    if count <= kinks.len() {
        kinks.clear();
    }
    let bounds = [&[left], &kinks[..], &[right]].concat();
    let lengths: Vec<f64> = bounds.windows(2).map(|w| w[1] - w[0]).collect();
    let parts = match lengths[..] {
        [flight, held] => {
            let [flight, held] = [flight.sqrt(), held.sqrt()];
            let below = (count as f64 * flight / (flight + held)).round() as usize;
            let below = below.clamp(1, (count / 2).max(1));
            vec![below, count - below]
        }
        _ => even(&lengths, count),
    };
    let bend = if oscillator.is_viscous() {
        0.0
    } else {
        oscillator
            .highest_friction(oscillator.energy_at(1.0))
            .min(1.0)
    };
    let [rising, holding] = std::array::from_fn(|k| EVEN[k] + bend * GRADED[k]);
    let mut all = vec![left];
    for (k, (piece, parts)) in bounds.windows(2).zip(&parts).enumerate() {
        let kink = [k > 0, k < kinks.len()];
        let open = kinks.len() == 1 && k == 0;
        let power = if open { rising } else { holding };
        let inner = 1..*parts;
        all.extend(inner.map(|i| nearer([piece[0], piece[1]], [i, *parts], kink, power)));
        all.push(piece[1]);
    }
    all
}

/// So many parts of pieces of these lengths, each nearly as long as the others.
fn even(lengths: &[f64], count: usize) -> Vec<usize> {
    let mut parts = vec![1; lengths.len()];
    for _ in parts.len()..count {
        // One more where they are longest.
        let length = |k: usize| lengths[k] / parts[k] as f64;
        let longest = (0..parts.len()).max_by(|a, b| length(*a).total_cmp(&length(*b)));
        if let Some(k) = longest {
            parts[k] += 1;
        }
    }
    parts
}

/// The end of the i-th of n elements between two places, its distance from those of them that are kinks as a power of i.
fn nearer([low, high]: [f64; 2], [i, n]: [usize; 2], kink: [bool; 2], power: f64) -> f64 {
    let length = high - low;
    let x = i as f64 / n as f64;
    match kink {
        [false, false] => low + length * i as f64 / n as f64,
        [true, false] => low + length * x.powf(power),
        [false, true] => high - length * (1.0 - x).powf(power),
        [true, true] if x < 0.5 => low + 0.5 * length * (2.0 * x).powf(power),
        [true, true] => high - 0.5 * length * (2.0 - 2.0 * x).powf(power),
    }
}
