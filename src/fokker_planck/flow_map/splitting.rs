//! Splittings of motion and noise: quadratures of the noise along the orbit.

/// How an interval between outputs alternates the undamped motion H with friction and noise O. Seen
/// from the moving point, noise adds up along the orbit, and the splitting is a quadrature of that
/// integral: the parts of O are its weights, those of H the gaps between its nodes. All parts are
/// forward in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Splitting {
    /// H(c1) O(1/2) H(c2) O(1/2) H(c1), c1 = 1/2 - sqrt3/6, c2 = sqrt3/3: Gauss. Error O(zeta tau^4 +
    /// zeta^2 tau^4).
    FourTwo,
    /// H(c1) O(5/18) H(c2) O(8/18) H(c2) O(5/18) H(c1), c1 = 1/2 - sqrt15/10, c2 = sqrt15/10: Gauss.
    /// Error O(zeta tau^6 + zeta^2 tau^4). For reference.
    SixTwo,
    /// H(1) O(1) H(1) O(1) ..., one pass a step: the trapezoidal rule, which on orbits that return
    /// converges faster than any order, with two corrected nodes at either end of the interval (Alpert,
    /// SIAM J. Sci. Comput. 20, 1551, 1999). Error O(zeta tau^5 + zeta^2 tau^3) once, from the ends; on an
    /// interval too short for both ends as `FourTwo`.
    EvenFive,
}

/// Nodes and weights that replace the first [`REPLACED`] of the trapezoidal rule at one end of an interval, in
/// steps.
const END: [(f64, f64); 2] = [
    (0.224_578_497_981_261_4, 0.554_078_164_360_637_2),
    (1.013_719_374_359_164_1, 0.945_921_835_639_362_8),
];

const REPLACED: usize = 2;

impl Splitting {
    #[cfg(test)]
    pub(super) const ALL: [Self; 3] = [Self::FourTwo, Self::SixTwo, Self::EvenFive];

    /// Nodes and weights, in units of tau, on an interval of `steps` steps.
    pub(super) fn quadrature(self, steps: usize) -> (Vec<f64>, Vec<f64>) {
        let (nodes, weights): (&[f64], &[f64]) = match self {
            Self::FourTwo => (
                &[0.211_324_865_405_187_1, 0.788_675_134_594_812_9],
                &[0.5, 0.5],
            ),
            Self::SixTwo => (
                &[0.112_701_665_379_258_3, 0.5, 0.887_298_334_620_741_7],
                &[5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0],
            ),
            Self::EvenFive => return even(steps),
        };
        let all = || (0..steps).flat_map(|k| nodes.iter().map(move |x| k as f64 + x));
        (all().collect(), weights.repeat(steps))
    }
}

/// The trapezoidal rule with corrected ends; (4,2) on an interval too short for both.
fn even(steps: usize) -> (Vec<f64>, Vec<f64>) {
    if steps < 2 * REPLACED {
        return Splitting::FourTwo.quadrature(steps);
    }
    let (mut nodes, mut weights): (Vec<f64>, Vec<f64>) = END.into_iter().unzip();
    for k in REPLACED..=steps - REPLACED {
        nodes.push(k as f64);
        weights.push(1.0);
    }
    for (x, w) in END.into_iter().rev() {
        nodes.push(steps as f64 - x);
        weights.push(w);
    }
    (nodes, weights)
}

/// The part by which the motion must be longer than its time on an interval of `steps` steps, x = zeta tau: to
/// second order in the friction a splitting runs the motion at a wrong rate and does nothing else wrong, since
/// [O, [O, H]] = 4 zeta^2 H. Friction stretches the two halves of H, v d/dq and G d/dv, by inverse factors of
/// the time u that has passed in O, e^{-2 zeta u} and e^{2 zeta u}; the mean of their second order is to be that
/// of u = s. 0 where that is more than a tenth: a second order then says nothing, and the error estimates of such steps
/// show it.
pub(super) fn lead(nodes: &[f64], weights: &[f64], steps: f64, x: f64) -> f64 {
    let (mut u, mut before, mut sum) = (-0.5 * steps, 0.0, 0.0);
    for (node, weight) in nodes.iter().zip(weights) {
        sum += (node - before) * u * u;
        before = *node;
        u += weight;
    }
    sum += (steps - before) * u * u;
    let lead = 2.0 * x * x * (steps * steps / 12.0 - sum / steps);
    if lead.abs() <= 0.1 { lead } else { 0.0 }
}
