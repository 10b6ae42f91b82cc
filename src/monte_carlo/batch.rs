//! Batch means: moments of long records, with errors that know how slowly the records forget.

use super::events::unseen;
use super::law::Law;
use super::noise::{LANES, Lanes};
use crate::contact::ContactLaw;
use crate::estimate::{Estimate, Origin};
use crate::moments::{Moment, Moments};
use crate::oscillator::DisplacementLaw;

/// Numbers summed per sample: q, q^2, v, v^2, q v, N, N^2, N^3, N^4, H, H^2, \[q < q_loss\], q N; q, v, N
/// and H each in its [`Units`].
const TERMS: usize = 13;

/// The place of \[q < q_loss\].
const LOST: usize = 11;

type Vector = [f64; TERMS];

/// Exact stationary means and deviations of q, v, N and H: power sums in these units neither cancel
/// nor overflow.
#[derive(Debug, Clone, Copy)]
pub(super) struct Units {
    q: [f64; 2],
    v: [f64; 2],
    force: [f64; 2],
    energy: [f64; 2],
    /// T in the units of q N.
    virial: f64,
}

impl Units {
    pub(super) fn new(contact: &ContactLaw, law: &DisplacementLaw, temperature: f64) -> Self {
        let unit = |f: &dyn Fn(f64) -> f64| {
            let mean = law.expect(f).value;
            [mean, law.expect(|q| (f(q) - mean).powi(2)).value.sqrt()]
        };
        let q = unit(&|q| q);
        let force = unit(&|q| contact.force(q));
        let [potential, spread] = unit(&|q| contact.potential(q));
        Self {
            q,
            v: [0.0, temperature.sqrt()],
            // E N = 0 exactly.
            force: [0.0, force[1]],
            energy: [
                0.5 * temperature + potential,
                spread.hypot(temperature * 0.5f64.sqrt()),
            ],
            virial: temperature / (q[1] * force[1]),
        }
    }
}

/// Sums over the samples of one batch of each lane.
#[derive(Debug, Clone)]
pub(super) struct Batch {
    sums: [Lanes; TERMS],
    samples: f64,
}

impl Batch {
    pub(super) fn new() -> Self {
        Self {
            sums: [[0.0; LANES]; TERMS],
            samples: 0.0,
        }
    }

    /// Adds one sample of every lane.
    #[inline(always)]
    pub(super) fn sample<L: Law>(&mut self, law: L, units: &Units, q: &Lanes, v: &Lanes) {
        self.samples += 1.0;
        let inverse = [units.q, units.v, units.force, units.energy].map(|[_, unit]| 1.0 / unit);
        for lane in 0..LANES {
            let (x, y) = (q[lane], v[lane]);
            let force = law.force(x) * inverse[2];
            let energy = (0.5 * y * y + law.potential(x) - units.energy[0]) * inverse[3];
            let lost = if law.is_lost(x) { 1.0 } else { 0.0 };
            let (x, y) = ((x - units.q[0]) * inverse[0], y * inverse[1]);
            let square = force * force;
            let terms: Vector = [
                x,
                x * x,
                y,
                y * y,
                x * y,
                force,
                square,
                square * force,
                square * square,
                energy,
                energy * energy,
                lost,
                x * force,
            ];
            for k in 0..TERMS {
                self.sums[k][lane] += terms[k];
            }
        }
    }

    /// The batch mean of one lane.
    fn mean(&self, lane: usize) -> Vector {
        self.sums.map(|lanes| lanes[lane] / self.samples)
    }
}

/// First and second moments of the batch means.
#[derive(Debug, Clone)]
pub(super) struct BatchMeans {
    count: f64,
    samples: f64,
    sum: Vector,
    product: [Vector; TERMS],
    /// Batches with a sample out of contact.
    lost: f64,
}

impl BatchMeans {
    pub(super) fn new() -> Self {
        Self {
            count: 0.0,
            samples: 0.0,
            sum: [0.0; TERMS],
            product: [[0.0; TERMS]; TERMS],
            lost: 0.0,
        }
    }

    pub(super) fn count(&self) -> f64 {
        self.count
    }

    /// Adds a batch of every lane.
    pub(super) fn push(&mut self, batch: &Batch) {
        for lane in 0..LANES {
            let x = batch.mean(lane);
            self.count += 1.0;
            self.samples += batch.samples;
            self.lost += f64::from(u8::from(x[LOST] > 0.0));
            for j in 0..TERMS {
                self.sum[j] += x[j];
                for k in 0..TERMS {
                    self.product[j][k] += x[j] * x[k];
                }
            }
        }
    }

    pub(super) fn add(&mut self, more: &Self) {
        self.count += more.count;
        self.samples += more.samples;
        self.lost += more.lost;
        for j in 0..TERMS {
            self.sum[j] += more.sum[j];
            for k in 0..TERMS {
                self.product[j][k] += more.product[j][k];
            }
        }
    }

    fn mean(&self) -> Vector {
        self.sum.map(|x| x / self.count)
    }

    /// Covariance of the mean over all batches.
    fn covariance(&self) -> [Vector; TERMS] {
        let (n, mean) = (self.count, self.mean());
        std::array::from_fn(|j| {
            std::array::from_fn(|k| (self.product[j][k] / n - mean[j] * mean[k]) / (n - 1.0))
        })
    }

    /// The moments with one standard error each, by the delta method on the batch means; that of the loss
    /// probability knows that no burst of losses is smaller than `burst`, a mean square share of a batch,
    /// None for a law that cannot lose contact.
    pub(super) fn moments(&self, units: &Units, burst: Option<f64>) -> Moments {
        self.estimate(units, burst, |_| Vec::new())
    }

    /// The moments with the exact identities E\[N\] = 0, E\[q N\] = T, E\[v^2\] = T, E\[q v\] = 0 as control
    /// variates: what the sample is known to have too much of is regressed out. E\[N\], Var v and
    /// Cov(q, v), which the identities fix, are left as they are.
    pub(super) fn controlled_moments(&self, units: &Units, burst: Option<f64>) -> Moments {
        // q N is about the mean of q, and E[N] = 0, so E[(q - Eq) N] = T.
        let controls = vec![(5, 0.0), (12, units.virial), (3, 1.0), (4, 0.0)];
        self.estimate(units, burst, |moment| match moment {
            Moment::MeanForce | Moment::VarV | Moment::CovQv => Vec::new(),
            _ => controls.clone(),
        })
    }

    fn estimate(
        &self,
        units: &Units,
        burst: Option<f64>,
        controls: impl Fn(Moment) -> Vec<(usize, f64)>,
    ) -> Moments {
        let (x, covariance) = (self.mean(), self.covariance());
        let [q, _, v, _, _, n1, n2, n3, n4, ..] = x;
        // value, and its slope against each term.
        let linear = |k: usize| (x[k], slope(&[(k, 1.0)]));
        let var_q = (x[1] - q * q, slope(&[(1, 1.0), (0, -2.0 * q)]));
        let var_v = (x[3] - v * v, slope(&[(3, 1.0), (2, -2.0 * v)]));
        let cov = (x[4] - q * v, slope(&[(4, 1.0), (0, -v), (2, -q)]));
        let m2 = (n2 - n1 * n1).max(0.0);
        let s = m2.sqrt();
        let m3 = n3 - 3.0 * n1 * n2 + 2.0 * n1.powi(3);
        let m4 = n4 - 4.0 * n1 * n3 + 6.0 * n1 * n1 * n2 - 3.0 * n1.powi(4);
        let of_m2 = slope(&[(6, 1.0), (5, -2.0 * n1)]);
        let of_m3 = slope(&[(7, 1.0), (6, -3.0 * n1), (5, 6.0 * n1 * n1 - 3.0 * n2)]);
        let of_m4 = slope(&[
            (8, 1.0),
            (7, -4.0 * n1),
            (6, 6.0 * n1 * n1),
            (5, 12.0 * n1 * n2 - 4.0 * n3 - 12.0 * n1.powi(3)),
        ]);
        let combine = |a: f64, x: &Vector, b: f64, y: &Vector| -> Vector {
            std::array::from_fn(|k| a * x[k] + b * y[k])
        };
        let std = (s, combine(0.5 / s, &of_m2, 0.0, &of_m2));
        let skewness = (
            m3 / s.powi(3),
            combine(1.0 / s.powi(3), &of_m3, -1.5 * m3 / s.powi(5), &of_m2),
        );
        let kurtosis = (
            m4 / s.powi(4),
            combine(1.0 / s.powi(4), &of_m4, -2.0 * m4 / s.powi(6), &of_m2),
        );
        let give = |moment: Moment, (value, slope): (f64, Vector), centre: f64, unit: f64| {
            let (value, error) = self.regress(value, &slope, &x, &covariance, &controls(moment));
            Estimate::new(centre + unit * value, unit * error, Origin::Sampling)
        };
        Moments {
            mean_q: give(Moment::MeanQ, linear(0), units.q[0], units.q[1]),
            var_q: give(Moment::VarQ, var_q, 0.0, units.q[1].powi(2)),
            mean_v: give(Moment::MeanV, linear(2), 0.0, units.v[1]),
            var_v: give(Moment::VarV, var_v, 0.0, units.v[1].powi(2)),
            cov_qv: give(Moment::CovQv, cov, 0.0, units.q[1] * units.v[1]),
            mean_force: give(Moment::MeanForce, linear(5), 0.0, units.force[1]),
            std_force: give(Moment::StdForce, std, 0.0, units.force[1]),
            skewness_force: give(Moment::SkewnessForce, skewness, 0.0, 1.0),
            kurtosis_force: give(Moment::KurtosisForce, kurtosis, 0.0, 1.0),
            mean_energy: give(
                Moment::MeanEnergy,
                linear(9),
                units.energy[0],
                units.energy[1],
            ),
            contact_loss_probability: burst.map(|burst| {
                let loss = give(Moment::ContactLossProbability, linear(LOST), 0.0, 1.0);
                // What few bursts do not show.
                let n = self.count;
                let square = self.product[LOST][LOST] - n * x[LOST] * x[LOST];
                let error = loss
                    .error
                    .hypot(unseen(square, self.lost, n, burst).sqrt() / n);
                Estimate { error, ..loss }
            }),
            left_out: 0,
        }
    }

    /// Value and standard error of a statistic with the given slope, less its regression on the
    /// controls (term, exact mean).
    fn regress(
        &self,
        value: f64,
        slope: &Vector,
        x: &Vector,
        covariance: &[Vector; TERMS],
        controls: &[(usize, f64)],
    ) -> (f64, f64) {
        let along: Vector = std::array::from_fn(|j| dot(&covariance[j], slope));
        let variance = dot(slope, &along);
        let matrix: Vec<Vec<f64>> = controls
            .iter()
            .map(|(j, _)| controls.iter().map(|(k, _)| covariance[*j][*k]).collect())
            .collect();
        let right: Vec<f64> = controls.iter().map(|(j, _)| along[*j]).collect();
        let weights = solve(matrix, right.clone());
        let (mut value, mut rest) = (value, variance);
        for ((weight, right), (k, exact)) in weights.iter().zip(&right).zip(controls) {
            value -= weight * (x[*k] - exact);
            rest -= weight * right;
        }
        if controls.is_empty() {
            return (value, variance.max(0.0).sqrt());
        }
        // Each fitted weight costs one degree of freedom. The regression is linear: what is left of a
        // curved statistic is of the order of its variance (everything is in natural units here).
        let freedom = (self.count - 1.0) / (self.count - 1.0 - controls.len() as f64).max(1.0);
        let curved = slope.iter().filter(|slope| **slope != 0.0).count() > 1;
        let curvature = if curved { variance } else { 0.0 };
        (value, (rest.max(0.0) * freedom).sqrt().hypot(curvature))
    }

    /// How many independent samples would give the mean of q, of N and of H the same errors.
    pub(super) fn effective_samples(&self) -> [f64; 3] {
        let (x, covariance) = (self.mean(), self.covariance());
        [(0, 1), (5, 6), (9, 10)]
            .map(|(first, second)| (x[second] - x[first] * x[first]) / covariance[first][first])
    }
}

/// A slope that is zero but for some terms.
fn slope(terms: &[(usize, f64)]) -> Vector {
    let mut slope = [0.0; TERMS];
    for (k, value) in terms {
        slope[*k] += value;
    }
    slope
}

fn dot(a: &Vector, b: &Vector) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Solves a small symmetric positive system by elimination without pivoting; a control without
/// variance gets no weight.
fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    let scale: Vec<f64> = (0..n).map(|k| a[k][k]).collect();
    for k in 0..n {
        if a[k][k] <= 1e-10 * scale[k] || a[k][k] <= 0.0 {
            a[k] = vec![0.0; n];
            a[k][k] = 1.0;
            b[k] = 0.0;
        }
        let (pivot, value) = (a[k].clone(), b[k]);
        for j in k + 1..n {
            let factor = a[j][k] / pivot[k];
            for (entry, p) in a[j].iter_mut().zip(&pivot).skip(k) {
                *entry -= factor * p;
            }
            b[j] -= factor * value;
        }
    }
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - known) / a[k][k];
    }
    b
}
