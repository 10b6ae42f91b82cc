//! Streamed statistics: power sums about a fixed centre, added in a fixed order, and the moments with
//! their standard errors.

use super::few::{OF_VARIANCE, at_least, student, tails};
use super::influence::{Powers, Shape};
use super::law::Law;
use crate::contact::ContactLaw;
use crate::estimate::{Estimate, Origin, name_at};
use crate::moments::{Moment, Moments};

/// A centre and a unit near the mean and the deviation, so that power sums neither cancel nor
/// overflow.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Frame {
    centre: f64,
    /// One over the unit.
    inverse: f64,
}

impl Frame {
    /// The frame of a first sample.
    fn of(sample: &[f64]) -> Self {
        let n = sample.len() as f64;
        let centre = sample.iter().sum::<f64>() / n;
        let widest = sample.iter().map(|x| (x - centre).abs());
        let widest = widest.fold(0.0, f64::max);
        let unit = (sample
            .iter()
            .map(|x| ((x - centre) / widest).powi(2))
            .sum::<f64>()
            / n)
            .sqrt()
            * widest;
        let inverse = if unit.is_finite() && unit > f64::MIN_POSITIVE {
            1.0 / unit
        } else {
            1.0
        };
        Self { centre, inverse }
    }

    #[inline(always)]
    fn apply(self, x: f64) -> f64 {
        (x - self.centre) * self.inverse
    }
}

/// The frames of q, v, N and H at one time.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Frames([Frame; 4]);

impl Frames {
    /// The frames of the states (q, v) of the first paths.
    pub(super) fn of<L: Law>(law: L, q: &[f64], v: &[f64]) -> Self {
        let force: Vec<f64> = q.iter().map(|&q| law.force(q)).collect();
        let energy = |(&q, &v): (&f64, &f64)| 0.5 * v * v + law.potential(q);
        let energy: Vec<f64> = q.iter().zip(v).map(energy).collect();
        Self([
            Frame::of(q),
            Frame::of(v),
            Frame::of(&force),
            Frame::of(&energy),
        ])
    }
}

/// Sums of powers of (q, v, N, H) in their frames over the paths at one time.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    count: f64,
    terms: [f64; TERMS],
}

/// Terms of a path.
const TERMS: usize = 23;

/// Where they begin: four powers of q and of v; q v, q^2 v, q v^2, q^2 v^2; eight powers of N, two of H; whether it is lost.
const Q: usize = 0;
const V: usize = 4;
const QV: usize = 8;
const FORCE: usize = 12;
const ENERGY: usize = 20;
const LOST: usize = 22;

/// Sums taken side by side, so that they vectorise.
const WIDTH: usize = 8;

impl Sums {
    /// The sums over the states (q, v) of some paths.
    #[inline(always)]
    pub(super) fn of<L: Law>(law: L, frames: &Frames, q: &[f64], v: &[f64]) -> Self {
        let mut sums = [[0.0; WIDTH]; TERMS];
        let ((blocks_q, rest_q), (blocks_v, rest_v)) = (q.as_chunks(), v.as_chunks());
        for (q, v) in blocks_q.iter().zip(blocks_v) {
            add(&mut sums, &terms(law, frames, q, v), WIDTH);
        }
        let count = rest_q.len();
        let (mut last_q, mut last_v) = ([0.0; WIDTH], [0.0; WIDTH]);
        last_q[..count].copy_from_slice(rest_q);
        last_v[..count].copy_from_slice(rest_v);
        add(&mut sums, &terms(law, frames, &last_q, &last_v), count);
        Self {
            count: q.len() as f64,
            terms: sums.map(|lanes| lanes.iter().sum()),
        }
    }

    /// Paths that are in the sums.
    pub(super) fn paths(&self) -> u64 {
        self.count as u64
    }

    /// Adds the sums of more paths in the same frames.
    pub(super) fn add(&mut self, more: &Self) {
        self.count += more.count;
        for (a, b) in self.terms.iter_mut().zip(more.terms) {
            *a += b;
        }
    }

    /// The means of terms from a place on.
    fn means<const K: usize>(&self, from: usize) -> [f64; K] {
        std::array::from_fn(|k| self.terms[from + k] / self.count)
    }

    /// Powers 0 to 8 of N about a mean over a unit, summed.
    fn powers(&self, mean: f64, unit: f64) -> Powers {
        let raw = |k: usize| {
            if k == 0 {
                self.count
            } else {
                self.terms[FORCE + k - 1]
            }
        };
        std::array::from_fn(|k| shifted(raw, k, mean) / unit.powi(k as i32))
    }

    /// The moments of the paths of all `parts` with one standard error each, by the delta method: first order in 1/sqrt(paths).
    /// How many paths carry the error of the kurtosis.
    pub(super) fn moments(
        parts: &[&Self],
        contact: &ContactLaw,
        frames: &Frames,
    ) -> (Moments, f64) {
        let mut all = Self::default();
        for more in parts {
            all.add(more);
        }
        let n = all.count;
        let [fq, fv, fn_, fh] = frames.0;
        let [q, v] = [Q, V].map(|from| central::<4>(all.means(from)));
        let force = central::<2>(all.means(FORCE));
        let energy = central::<2>(all.means(ENERGY));
        let std = force.order[1].sqrt();
        let groups = parts.iter().filter(|it| it.count > 0.0);
        let groups: Vec<Powers> = groups.map(|it| it.powers(force.mean, std)).collect();
        let shape = Shape::of(&groups);
        let mut moments = Moments {
            mean_q: mean(&q, n, fq),
            var_q: variance(&q, n, fq),
            mean_v: mean(&v, n, fv),
            var_v: variance(&v, n, fv),
            cov_qv: all.covariance(fq, fv),
            mean_force: mean(&force, n, fn_),
            std_force: if std > 0.0 {
                shape.std.scaled(std / fn_.inverse)
            } else {
                sampled(0.0, 0.0)
            },
            skewness_force: shape.skewness,
            kurtosis_force: shape.kurtosis,
            mean_energy: mean(&energy, n, fh),
            contact_loss_probability: None,
            left_out: 0,
        };
        for number in moments.each_mut().into_iter().flatten() {
            number.error *= student(n);
        }
        moments.contact_loss_probability =
            contact.loss_point().map(|_| proportion(all.terms[LOST], n));
        (moments, shape.carriers)
    }

    fn covariance(&self, fq: Frame, fv: Frame) -> Estimate {
        let n = self.count;
        let [q1, q2] = self.means(Q);
        let [v1, v2] = self.means(V);
        let [qv, qqv, qvv, qqvv] = self.means(QV);
        let covariance = qv - q1 * v1;
        // E[(q - Eq)^2 (v - Ev)^2].
        let square = qqvv - 2.0 * v1 * qqv + v1 * v1 * q2 - 2.0 * q1 * qvv
            + 4.0 * q1 * v1 * qv
            + q1 * q1 * v2
            - 3.0 * q1 * q1 * v1 * v1;
        // That of a Gaussian, if its own is not to be seen.
        let gaussian = (q2 - q1 * q1) * (v2 - v1 * v1) + covariance * covariance;
        let error = (at_least(square - covariance * covariance, gaussian, n) / n).sqrt();
        let unit = 1.0 / (fq.inverse * fv.inverse);
        sampled(covariance * n / (n - 1.0), error).scaled(unit)
    }
}

/// One number for each of the paths that are added side by side.
type Block = [f64; WIDTH];

/// Lane by lane; a loop over few arrays, which the compiler makes vectors of.
#[inline(always)]
pub(super) fn product<const N: usize>(a: &[f64; N], b: &[f64; N]) -> [f64; N] {
    let mut it = [0.0; N];
    for lane in 0..N {
        it[lane] = a[lane] * b[lane];
    }
    it
}

/// Adds to each sum its term, in the first `lanes`.
#[inline(always)]
pub(super) fn add<const N: usize, const K: usize>(
    sums: &mut [[f64; N]; K],
    terms: &[[f64; N]; K],
    lanes: usize,
) {
    for (sum, term) in sums.iter_mut().zip(terms) {
        for lane in 0..lanes {
            sum[lane] += term[lane];
        }
    }
}

/// What some paths add to the sums.
#[inline(always)]
fn terms<L: Law>(law: L, frames: &Frames, q: &Block, v: &Block) -> [Block; TERMS] {
    let [fq, fv, fn_, fh] = frames.0;
    let [mut x, mut y, mut force, mut energy, mut lost] = [[0.0; WIDTH]; 5];
    for lane in 0..WIDTH {
        let (q, v) = (q[lane], v[lane]);
        (x[lane], y[lane]) = (fq.apply(q), fv.apply(v));
        force[lane] = fn_.apply(law.force(q));
        energy[lane] = fh.apply(0.5 * v * v + law.potential(q));
        lost[lane] = if law.is_lost(q) { 1.0 } else { 0.0 };
    }
    let (xx, yy, f2) = (product(&x, &x), product(&y, &y), product(&force, &force));
    let f4 = product(&f2, &f2);
    [
        x,
        xx,
        product(&xx, &x),
        product(&xx, &xx),
        y,
        yy,
        product(&yy, &y),
        product(&yy, &yy),
        product(&x, &y),
        product(&xx, &y),
        product(&x, &yy),
        product(&xx, &yy),
        force,
        f2,
        product(&f2, &force),
        f4,
        product(&f4, &force),
        product(&f4, &f2),
        product(&product(&f4, &f2), &force),
        product(&f4, &f4),
        energy,
        product(&energy, &energy),
        lost,
    ]
}

/// Mean and central moments of a number.
struct Central<const K: usize> {
    mean: f64,
    /// Central moments of order 1 to K: `order[k - 1]`.
    order: [f64; K],
}

/// Central moments from means of powers, by the binomial theorem; the frame keeps |mean| below a few
/// tenths, so nothing cancels.
fn central<const K: usize>(means: [f64; K]) -> Central<K> {
    let raw = |k: usize| if k == 0 { 1.0 } else { means[k - 1] };
    let mean = raw(1);
    let order = std::array::from_fn(|index| shifted(raw, index + 1, mean));
    Central { mean, order }
}

/// The k-th power about a mean from powers about 0.
fn shifted(raw: impl Fn(usize) -> f64, k: usize, mean: f64) -> f64 {
    let (mut sum, mut binomial) = (0.0, 1.0);
    for j in 0..=k {
        sum += binomial * raw(k - j) * (-mean).powi(j as i32);
        binomial *= (k - j) as f64 / (j + 1) as f64;
    }
    if k.is_multiple_of(2) {
        sum.max(0.0)
    } else {
        sum
    }
}

/// The names of all moments at these times, as a warning that their errors are not known lists them.
pub(super) fn unknown(prefix: &str, times: &[Option<f64>]) -> Vec<String> {
    let names = Moment::ALL.map(Moment::name);
    let at = |t: &Option<f64>| {
        names.map(|name| {
            let name = format!("{prefix}.{name}");
            t.map_or(name.clone(), |t| name_at(&name, t))
        })
    };
    times.iter().flat_map(at).collect()
}

fn sampled(value: f64, error: f64) -> Estimate {
    Estimate::new(value, error, Origin::Sampling)
}

/// The mean; its error is sqrt(variance/n).
fn mean<const K: usize>(c: &Central<K>, n: f64, frame: Frame) -> Estimate {
    let unit = 1.0 / frame.inverse;
    let deviation = (c.order[1] / (n - 1.0)).sqrt();
    sampled(frame.centre + c.mean * unit, deviation * unit)
}

/// The unbiased variance; its error is sqrt((m4 - m2^2)/n).
fn variance<const K: usize>(c: &Central<K>, n: f64, frame: Frame) -> Estimate {
    let (m2, m4) = (c.order[1], c.order[3]);
    let error = (at_least(m4 - m2 * m2, 2.0 * m2 * m2, n) / n).sqrt();
    let kurtosis = m4 / (m2 * m2).max(f64::MIN_POSITIVE);
    let error = error * tails(OF_VARIANCE, kurtosis, n);
    sampled(m2 * n / (n - 1.0), error).scaled(frame.inverse.powi(-2))
}

/// A proportion k of n: `hits` of `n` independent paths. Its error is half the distance to the farther end
/// of Wilson's interval of two standard errors (J. Am. Stat. Assoc. 22, 209, 1927), which is the one on the
/// side of many hits: the binomial error for many hits; (1 + sqrt(k + 1))/n for few; 2/n, not 0, for none.
/// With sqrt(k)/n a sample with too few hits would have a small error too: where 10 hits are expected, 1 in
/// 400 samples has k <= 2 and would lie 5 such errors off.
pub(super) fn proportion(hits: f64, n: f64) -> Estimate {
    const Z: f64 = 2.0;
    let rarer = hits.min(n - hits);
    let spread = Z * (rarer * (1.0 - rarer / n) + 0.25 * Z * Z).sqrt();
    let farther = (rarer + 0.5 * Z * Z + spread) / (n + Z * Z);
    sampled(hits / n, (farther - rarer / n) / Z)
}

/// What is added to the variance of a sum over independent batches of which `seen` have anything to show,
/// `square` being their squared deviations from the mean: four bursts more, none smaller than `burst`, a mean
/// square, where most of the `batches` saw none. A sum over few bursts varies with their number as a Poisson
/// variable does, and where it is too small its scatter is too.
pub(super) fn unseen(square: f64, seen: f64, batches: f64, burst: f64) -> f64 {
    let one = square / seen.max(1.0);
    let rare = 2.0 * seen < batches;
    4.0 * if rare { one.max(burst) } else { one }
}

#[cfg(test)]
mod tests {
    use super::proportion;

    #[test]
    fn few_hits_lie_three_standard_errors_off_no_more_often_than_a_gaussian_does() {
        // Summed over the Poisson law of the hits of n paths: nothing is sampled.
        let n = 1e5;
        for expected in [0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0, 300.0] {
            let (mut square, mut far, mut plain) = (0.0, 0.0, 0.0);
            let mut probability = f64::exp(-expected);
            for hits in 0..2000 {
                let hits = f64::from(hits);
                let z = (hits - expected) / (n * proportion(hits, n).error);
                square += probability * z * z;
                if z.abs() > 3.0 {
                    far += probability;
                }
                if (hits - expected).abs() > 3.0 * hits.max(1.0).sqrt() {
                    plain += probability;
                }
                probability *= expected / (hits + 1.0);
            }
            println!(
                "{expected} hits expected: rms {:.2} standard errors, beyond three {far:.1e}, of sqrt(k) {plain:.1e}",
                square.sqrt()
            );
            // 2.7e-3 of a Gaussian.
            assert!(far < 2.7e-3 && square < 1.0);
            // Never wide without need: at most half as much again where there is a standard error to speak of.
            assert!(expected < 5.0 || square > 0.44);
        }
        // Hits and misses are alike.
        let (few, many) = (proportion(3.0, 500.0).error, proportion(497.0, 500.0).error);
        assert!((few / many - 1.0).abs() < 1e-12);
    }
}
