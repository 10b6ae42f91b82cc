//! The numbers every transient method answers with: one set per output time.

use crate::contact::ContactLaw;
use crate::estimate::Estimate;

/// Moments of displacement, velocity and force at one time. The same names stand in results.json.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Moments {
    /// E\[q\].
    pub mean_q: Estimate,
    /// Var q.
    pub var_q: Estimate,
    /// E\[v\].
    pub mean_v: Estimate,
    /// Var v.
    pub var_v: Estimate,
    /// Cov(q, v).
    pub cov_qv: Estimate,
    /// E\[N\], N = G(q), the Dirac mass at the loss of contact included.
    pub mean_force: Estimate,
    /// Standard deviation of N.
    pub std_force: Estimate,
    /// Skewness of N.
    pub skewness_force: Estimate,
    /// Kurtosis of N; 3 for a Gaussian.
    pub kurtosis_force: Estimate,
    /// E\[H\], H = v^2/2 + U(q).
    pub mean_energy: Estimate,
    /// P(q < q_loss); None for a law that cannot lose contact.
    pub contact_loss_probability: Option<Estimate>,
}

impl Moments {
    /// Every moment with its name in results.json, in the order of the fields.
    pub fn named(&self) -> [(&'static str, Option<Estimate>); 11] {
        [
            ("mean_q", Some(self.mean_q)),
            ("var_q", Some(self.var_q)),
            ("mean_v", Some(self.mean_v)),
            ("var_v", Some(self.var_v)),
            ("cov_qv", Some(self.cov_qv)),
            ("mean_force", Some(self.mean_force)),
            ("std_force", Some(self.std_force)),
            ("skewness_force", Some(self.skewness_force)),
            ("kurtosis_force", Some(self.kurtosis_force)),
            ("mean_energy", Some(self.mean_energy)),
            ("contact_loss_probability", self.contact_loss_probability),
        ]
    }
}

impl Moments {
    /// The moment of that name in results.json; None for another name, or one that does not exist.
    pub fn get(&self, name: &str) -> Option<Estimate> {
        self.named().into_iter().find(|(it, _)| *it == name)?.1
    }

    /// Every moment that exists, to be changed in place, in the order of [`Moments::named`].
    pub fn each_mut(&mut self) -> [Option<&mut Estimate>; 11] {
        [
            Some(&mut self.mean_q),
            Some(&mut self.var_q),
            Some(&mut self.mean_v),
            Some(&mut self.var_v),
            Some(&mut self.cov_qv),
            Some(&mut self.mean_force),
            Some(&mut self.std_force),
            Some(&mut self.skewness_force),
            Some(&mut self.kurtosis_force),
            Some(&mut self.mean_energy),
            self.contact_loss_probability.as_mut(),
        ]
    }

    /// In flight but for a probability that is `neglected` everywhere, the force has no shape.
    pub(crate) fn drop_shape_of_flight(&mut self, neglected: f64) {
        let lost = self.contact_loss_probability.map_or(0.0, |p| p.value);
        if lost > 1.0 - neglected {
            self.skewness_force.value = f64::NAN;
            self.kurtosis_force.value = f64::NAN;
        }
    }
}

/// The raw expectations from which [`Moments`] are made: each is linear in the density, so mesh sums,
/// sample means and their errors share this one list.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RawMoments {
    /// E\[1\], the mass; the others are not divided by it.
    pub mass: f64,
    /// E\[q\].
    pub q: f64,
    /// E\[q^2\].
    pub qq: f64,
    /// E\[v\].
    pub v: f64,
    /// E\[v^2\].
    pub vv: f64,
    /// E\[q v\].
    pub qv: f64,
    /// E\[N^n\], n = 1 to 4.
    pub force: [f64; 4],
    /// E\[U(q)\].
    pub potential: f64,
    /// P(q < q_loss).
    pub lost: f64,
}

impl RawMoments {
    /// The moments, without errors, of a law with these raw expectations. Divides by the mass, so
    /// that a leak shows in the mass alone.
    pub fn moments(&self, contact: &ContactLaw) -> Moments {
        let e = |x: f64| x / self.mass;
        let (q, v) = (e(self.q), e(self.v));
        let [n1, n2, n3, n4] = self.force.map(e);
        let var = (n2 - n1 * n1).max(0.0);
        let third = n3 - 3.0 * n1 * n2 + 2.0 * n1.powi(3);
        let fourth = n4 - 4.0 * n1 * n3 + 6.0 * n1 * n1 * n2 - 3.0 * n1.powi(4);
        let bare = |value: f64| Estimate {
            value,
            ..Estimate::default()
        };
        Moments {
            mean_q: bare(q),
            var_q: bare(e(self.qq) - q * q),
            mean_v: bare(v),
            var_v: bare(e(self.vv) - v * v),
            cov_qv: bare(e(self.qv) - q * v),
            mean_force: bare(n1),
            std_force: bare(var.sqrt()),
            skewness_force: bare(third / var.powf(1.5)),
            kurtosis_force: bare(fourth / (var * var)),
            mean_energy: bare(0.5 * e(self.vv) + e(self.potential)),
            contact_loss_probability: contact.loss_point().map(|_| bare(e(self.lost))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn raw_expectations_of_a_two_point_law_give_its_moments() {
        // q = 2 with probability 1/4, q = -1 with 3/4, v = q, N = q (linear law).
        let raw = RawMoments {
            mass: 2.0,
            q: -0.5,
            qq: 3.5,
            v: -0.5,
            vv: 3.5,
            qv: 3.5,
            force: [-0.5, 3.5, 2.5, 9.5],
            potential: 1.75,
            lost: 0.0,
        };
        let m = raw.moments(&ContactLaw::Linear);
        let close = |x: Estimate, y: f64| assert!((x.value - y).abs() < 1e-14, "{} {y}", x.value);
        close(m.mean_q, -0.25);
        close(m.var_q, 1.6875);
        close(m.cov_qv, 1.6875);
        close(m.std_force, 1.6875f64.sqrt());
        // Bernoulli(1/4): skewness (1-2p)/sqrt(pq), kurtosis 3 + (1-6pq)/pq.
        close(m.skewness_force, 0.5 / 0.1875f64.sqrt());
        close(m.kurtosis_force, 3.0 + (1.0 - 6.0 * 0.1875) / 0.1875);
        close(m.mean_energy, 1.75);
        assert!(m.contact_loss_probability.is_none());
    }
}
