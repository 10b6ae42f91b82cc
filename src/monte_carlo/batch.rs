//! Batch means: moments of long realisations, with errors that know how slowly these forget.

use super::few::{OF_KURTOSIS, OF_SKEWNESS, tails};
use super::law::Law;
use super::noise::{LANES, Lanes};
use super::statistics::{add, product, unseen};
use crate::contact::ContactLaw;
use crate::estimate::{Estimate, Origin, skewed_variance};
use crate::matrix::dot;
use crate::moments::{Moment, Moments, PerMoment};
use crate::oscillator::DisplacementLaw;

/// Numbers summed per sample: q, q^2, v, v^2, q v, N, N^2, N^3, N^4, H, H^2, \[q < q_loss\], q N; q, v, N
/// and H each in its [`Units`].
const TERMS: usize = 13;

/// The place of \[q < q_loss\].
const LOST: usize = 11;

type Vector = [f64; TERMS];

/// Independent samples below which control variates are not fitted. A batch that no high energy has visited shows less scatter about
/// the regression than there is: over 300 seeds (Hertz, zeta = 0.05, h = 0.02) the error of Var q was rms 1.5 standard errors at
/// 160 samples, 1.3 at 520, 1.1 at 1570; without controls 1.0 at 160.
const FITTED: f64 = 1000.0;

/// The fewest of the independent samples of q, of N and of H.
pub(super) fn worth(effective_samples: [f64; 3]) -> f64 {
    effective_samples.into_iter().fold(f64::INFINITY, f64::min)
}

/// Whether records are long enough for control variates.
pub(super) fn are_long(effective_samples: [f64; 3]) -> bool {
    worth(effective_samples) >= FITTED
}

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
        let q = law.spread(|q| q);
        let force = law.spread(|q| contact.force(q));
        let [potential, spread] = law.spread(|q| contact.potential(q));
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
        let [mut x, mut y, mut force, mut energy, mut lost] = [[0.0; LANES]; 5];
        for lane in 0..LANES {
            let (q, v) = (q[lane], v[lane]);
            x[lane] = (q - units.q[0]) * inverse[0];
            y[lane] = v * inverse[1];
            force[lane] = law.force(q) * inverse[2];
            energy[lane] = (0.5 * v * v + law.potential(q) - units.energy[0]) * inverse[3];
            lost[lane] = if law.is_lost(q) { 1.0 } else { 0.0 };
        }
        let square = product(&force, &force);
        let terms: [Lanes; TERMS] = [
            x,
            product(&x, &x),
            y,
            product(&y, &y),
            product(&x, &y),
            force,
            square,
            product(&square, &force),
            product(&square, &square),
            energy,
            product(&energy, &energy),
            lost,
            product(&x, &force),
        ];
        add(&mut self.sums, &terms, LANES);
    }

    /// The batch mean of one lane.
    fn mean(&self, lane: usize) -> Vector {
        self.sums.map(|lanes| lanes[lane] / self.samples)
    }
}

/// The mean of every batch, in the order of the records.
#[derive(Debug, Clone)]
pub(super) struct BatchMeans(Vec<Vector>);

impl BatchMeans {
    pub(super) fn new() -> Self {
        Self(Vec::new())
    }

    pub(super) fn count(&self) -> f64 {
        self.0.len() as f64
    }

    /// Adds a batch of every lane.
    pub(super) fn push(&mut self, batch: &Batch) {
        self.0.extend((0..LANES).map(|lane| batch.mean(lane)));
    }

    pub(super) fn add(&mut self, more: &Self) {
        self.0.extend(&more.0);
    }

    fn mean(&self) -> Vector {
        std::array::from_fn(|k| self.0.iter().map(|row| row[k]).sum::<f64>() / self.count())
    }

    /// The moments with one standard error each, by the jackknife over the batches; that of the loss probability knows
    /// that no burst of losses is smaller than `burst`, a mean square share of a batch, None for a law that cannot
    /// lose contact.
    pub(super) fn moments(&self, units: &Units, burst: Option<f64>) -> Moments {
        self.estimate(units, burst, &[])
    }

    /// The moments with the exact identities E\[N\] = 0, E\[q N\] = T, E\[v^2\] = T, E\[q v\] = 0 as control
    /// variates: what the sample is known to have too much of is regressed out. E\[N\], Var v and
    /// Cov(q, v), which the identities fix, are left as they are in the `plain` moments; all are below [`FITTED`].
    pub(super) fn controlled_moments(
        &self,
        units: &Units,
        burst: Option<f64>,
        plain: &Moments,
    ) -> Moments {
        if !are_long(self.effective_samples()) {
            return *plain;
        }
        // q N is about the mean of q, and E[N] = 0, so E[(q - Eq) N] = T.
        let controls = [(5, 0.0), (12, units.virial), (3, 1.0), (4, 0.0)];
        Moments {
            var_v: plain.var_v,
            cov_qv: plain.cov_qv,
            mean_force: plain.mean_force,
            ..self.estimate(units, burst, &controls)
        }
    }

    fn estimate(&self, units: &Units, burst: Option<f64>, controls: &[(usize, f64)]) -> Moments {
        let (n, mean) = (self.count(), self.mean());
        let regression = Regression::of(&self.0, &mean, controls);
        // The terms at the exact means of the controls: a moment of them is curved, and a regression of its own would err
        // by that.
        let about = std::array::from_fn(|k| {
            let term: Vec<f64> = self.0.iter().map(|row| row[k]).collect();
            mean[k] + regression.shift(&term)
        });
        let values = statistics(&about);
        let pseudo = self.pseudo_values(&mean, &about, &values);
        let [q, v, force, energy] = [units.q, units.v, units.force, units.energy];
        let kurtosis = values[Moment::KurtosisForce as usize];
        let worth = worth(self.effective_samples());
        // Of the others the skewness of the batches tells.
        let tails = |moment: Moment| match moment {
            Moment::SkewnessForce => tails(OF_SKEWNESS, kurtosis, worth),
            Moment::KurtosisForce => tails(OF_KURTOSIS, kurtosis, worth),
            _ => 1.0,
        };
        let give = |moment: Moment, centre: f64, unit: f64| {
            let m = moment as usize;
            let along: Vec<f64> = pseudo.iter().map(|row| row[m]).collect();
            let error = tails(moment) * regression.error(&along);
            Estimate::new(centre + unit * values[m], unit * error, Origin::Sampling)
        };
        Moments {
            mean_q: give(Moment::MeanQ, q[0], q[1]),
            var_q: give(Moment::VarQ, 0.0, q[1].powi(2)),
            mean_v: give(Moment::MeanV, 0.0, v[1]),
            var_v: give(Moment::VarV, 0.0, v[1].powi(2)),
            cov_qv: give(Moment::CovQv, 0.0, q[1] * v[1]),
            mean_force: give(Moment::MeanForce, 0.0, force[1]),
            std_force: give(Moment::StdForce, 0.0, force[1]),
            skewness_force: give(Moment::SkewnessForce, 0.0, 1.0),
            kurtosis_force: give(Moment::KurtosisForce, 0.0, 1.0),
            mean_energy: give(Moment::MeanEnergy, energy[0], energy[1]),
            contact_loss_probability: burst.map(|burst| {
                let loss = give(Moment::ContactLossProbability, 0.0, 1.0);
                // What few bursts do not show.
                let square = self.0.iter().map(|row| (row[LOST] - mean[LOST]).powi(2));
                let seen = self.0.iter().filter(|row| row[LOST] > 0.0).count();
                let more = unseen(square.sum(), seen as f64, n, burst);
                let error = loss.error.hypot(more.sqrt() / n);
                Estimate { error, ..loss }
            }),
            left_out: 0,
        }
    }

    /// What each batch does to every statistic, the means being `about`: the pseudo-values of the jackknife.
    fn pseudo_values(
        &self,
        mean: &Vector,
        about: &Vector,
        values: &PerMoment<f64>,
    ) -> Vec<PerMoment<f64>> {
        let n = self.count();
        let of = |row: &Vector| {
            let without = std::array::from_fn(|k| about[k] - (row[k] - mean[k]) / (n - 1.0));
            let without = statistics(&without);
            std::array::from_fn(|m| n * values[m] - (n - 1.0) * without[m])
        };
        self.0.iter().map(of).collect()
    }

    /// How many independent samples would give the mean of q, of N and of H the same errors.
    pub(super) fn effective_samples(&self) -> [f64; 3] {
        let (n, x) = (self.count(), self.mean());
        [(0, 1), (5, 6), (9, 10)].map(|(first, second)| {
            let square: f64 = self
                .0
                .iter()
                .map(|row| (row[first] - x[first]).powi(2))
                .sum();
            (x[second] - x[first] * x[first]) / (square / (n * (n - 1.0)))
        })
    }
}

/// Every moment of samples with these mean terms, in their units.
fn statistics(x: &Vector) -> PerMoment<f64> {
    let [q, qq, v, vv, qv, n1, n2, n3, n4, energy, ..] = *x;
    let m2 = (n2 - n1 * n1).max(0.0);
    let m3 = n3 - 3.0 * n1 * n2 + 2.0 * n1.powi(3);
    let m4 = n4 - 4.0 * n1 * n3 + 6.0 * n1 * n1 * n2 - 3.0 * n1.powi(4);
    [
        q,
        qq - q * q,
        v,
        vv - v * v,
        qv - q * v,
        n1,
        m2.sqrt(),
        m3 / m2.powf(1.5),
        m4 / (m2 * m2),
        energy,
        x[LOST],
    ]
}

/// A regression on controls whose means are known: its value there is a sum of the rows with the weights of the least
/// squares.
struct Regression {
    /// Controls of each row from their mean.
    rows: Vec<Vec<f64>>,
    /// Sums of their products.
    matrix: Vec<Vec<f64>>,
    /// The weight of each row in the value, and its leverage.
    weights: Vec<[f64; 2]>,
}

impl Regression {
    /// On `controls` (term, exact mean).
    fn of(batches: &[Vector], mean: &Vector, controls: &[(usize, f64)]) -> Self {
        let row = |it: &Vector| controls.iter().map(|(k, _)| it[*k] - mean[*k]).collect();
        let rows: Vec<Vec<f64>> = batches.iter().map(row).collect();
        let sum = |j: usize, k: usize| rows.iter().map(|row| row[j] * row[k]).sum();
        let all = 0..controls.len();
        let row = |j| all.clone().map(|k| sum(j, k)).collect();
        let matrix: Vec<Vec<f64>> = all.clone().map(row).collect();
        let away = controls.iter().map(|(k, exact)| exact - mean[*k]).collect();
        let away = solve(matrix.clone(), away);
        let share = 1.0 / rows.len() as f64;
        let weight = |row: &Vec<f64>| {
            let leverage = dot(row, &solve(matrix.clone(), row.clone()));
            [share + dot(row, &away), share + leverage]
        };
        Self {
            weights: rows.iter().map(weight).collect(),
            rows,
            matrix,
        }
    }

    /// How far the value at the exact means lies from the mean of `along`.
    fn shift(&self, along: &[f64]) -> f64 {
        let mean = along.iter().sum::<f64>() / along.len() as f64;
        let rows = along.iter().zip(&self.weights);
        rows.map(|(y, [weight, _])| weight * (y - mean)).sum()
    }

    /// The standard error of the value at the exact means: that of MacKinnon and White (J. Econometrics 29, 1985, HC3),
    /// which holds for residuals whose spread follows the controls, as that of a batch at a high energy does.
    fn error(&self, along: &[f64]) -> f64 {
        let mean = along.iter().sum::<f64>() / along.len() as f64;
        let right = (0..self.matrix.len())
            .map(|k| {
                self.rows
                    .iter()
                    .zip(along)
                    .map(|(row, y)| row[k] * (y - mean))
                    .sum()
            })
            .collect();
        let slope = solve(self.matrix.clone(), right);
        let rows = self.rows.iter().zip(along).zip(&self.weights);
        let parts = rows.map(|((row, y), [weight, leverage])| {
            // A row that carries the fit alone shows nothing of its own scatter.
            weight * (y - mean - dot(row, &slope)) / (1.0 - leverage).max(0.1)
        });
        skewed_variance(parts).sqrt()
    }
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
