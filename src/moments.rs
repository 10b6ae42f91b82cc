//! The numbers every transient method answers with: one set per output time.

use crate::contact::ContactLaw;
use crate::estimate::Estimate;

/// Moments of displacement, velocity and force at one time, each described in the table of [`Moment`].
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
    /// The moments that nobody asked for, a bit each in the order of [`Moment::ALL`]: as if they did not exist.
    pub left_out: u16,
}

/// How a number is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Entry {
    /// Its name in results.json.
    pub name: &'static str,
    /// Its symbol.
    pub symbol: &'static str,
    /// What it is, in two or three words beside the symbol.
    pub words: &'static str,
    /// What one of it is on the rig: every quantity is dimensionless, (6)-(8). u = z_s/q_s, 2 z_s/3 under the Hertz law, W = Omega,
    /// F = static load.
    pub unit: &'static str,
}

impl Entry {
    pub(crate) const fn new(
        name: &'static str,
        symbol: &'static str,
        words: &'static str,
        unit: &'static str,
    ) -> Self {
        Self {
            name,
            symbol,
            words,
            unit,
        }
    }
}

/// The moments, in the order in which they stand in every table and array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // The table says what they are.
pub enum Moment {
    MeanQ,
    VarQ,
    MeanV,
    VarV,
    CovQv,
    MeanForce,
    StdForce,
    SkewnessForce,
    KurtosisForce,
    MeanEnergy,
    ContactLossProbability,
}

/// One number a moment, in the order of [`Moment::ALL`].
pub(crate) type PerMoment<T> = [T; Moment::ALL.len()];

const TABLE: PerMoment<Entry> = [
    Entry::new("mean_q", "E[q]", "displacement", "u"),
    Entry::new("var_q", "Var q", "its variance", "u^2"),
    Entry::new("mean_v", "E[v]", "velocity", "u W"),
    Entry::new("var_v", "Var v", "its variance", "(u W)^2"),
    Entry::new("cov_qv", "Cov qv", "their covariance", "u^2 W"),
    Entry::new("mean_force", "E[N]", "force", "F"),
    Entry::new("std_force", "std N", "its deviation", "F"),
    Entry::new("skewness_force", "skew N", "its skewness", "1"),
    Entry::new("kurtosis_force", "kurt N", "3 if Gaussian", "1"),
    Entry::new("mean_energy", "E[H]", "energy", "(u W)^2 m"),
    Entry::new("contact_loss_probability", "P(loss)", "out of contact", "1"),
];

impl Moment {
    /// All of them, in their order.
    pub const ALL: [Self; 11] = [
        Self::MeanQ,
        Self::VarQ,
        Self::MeanV,
        Self::VarV,
        Self::CovQv,
        Self::MeanForce,
        Self::StdForce,
        Self::SkewnessForce,
        Self::KurtosisForce,
        Self::MeanEnergy,
        Self::ContactLossProbability,
    ];

    /// Those of which a period of a drive has harmonics or a mean.
    pub(crate) const OVER_A_PERIOD: [Self; 4] = [
        Self::MeanQ,
        Self::MeanV,
        Self::MeanForce,
        Self::ContactLossProbability,
    ];

    /// Those whose course in time is shown: all where only some were asked for.
    pub(crate) fn course(moments: &[Moments]) -> &'static [Self] {
        if moments.last().is_some_and(|it| it.left_out != 0) {
            return &Self::ALL;
        }
        &[
            Self::MeanQ,
            Self::StdForce,
            Self::MeanEnergy,
            Self::ContactLossProbability,
        ]
    }

    /// Their names in results.json, in the same order.
    #[cfg(feature = "cli")]
    pub(crate) const NAMES: [&str; Self::ALL.len()] = {
        let mut names = [""; Self::ALL.len()];
        let mut i = 0;
        while i < names.len() {
            names[i] = TABLE[i].name;
            i += 1;
        }
        names
    };

    /// How it is written.
    pub(crate) fn entry(self) -> &'static Entry {
        &TABLE[self as usize]
    }

    /// Its name in results.json.
    pub fn name(self) -> &'static str {
        self.entry().name
    }

    /// The moment of that name in results.json.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|it| it.name() == name)
    }

    /// Whether it is a standardised moment, skewness or kurtosis, that says nothing of sizes: without a deviation there
    /// is none.
    pub(crate) fn is_standardised(self) -> bool {
        matches!(self, Self::SkewnessForce | Self::KurtosisForce)
    }
}

impl Moments {
    /// Every moment with its name in results.json, in the order of [`Moment::ALL`].
    pub fn named(&self) -> PerMoment<(&'static str, Option<Estimate>)> {
        Moment::ALL.map(|it| (it.name(), self.get(it)))
    }

    /// A moment; None for one that does not exist.
    pub fn get(&self, moment: Moment) -> Option<Estimate> {
        let mut it = *self;
        it.each_mut()[moment as usize].as_deref().copied()
    }

    /// Every moment that exists, to be changed in place, in the order of [`Moment::ALL`].
    pub fn each_mut(&mut self) -> PerMoment<Option<&mut Estimate>> {
        let left_out = self.left_out;
        let all = [
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
        ];
        let mut bit = 1;
        all.map(|number| {
            let asked = left_out & bit == 0;
            bit <<= 1;
            number.filter(|_| asked)
        })
    }

    /// Leaves out all moments but these, if these are all that is asked for.
    pub(crate) fn keep(&mut self, asked: Option<&[Moment]>) {
        if let Some(asked) = asked {
            let kept = asked.iter().fold(0, |bits, it| bits | 1 << *it as u16);
            self.left_out = !kept;
        }
    }

    /// Leaves out what is none of these either.
    pub(crate) fn keep_of(&mut self, some: &[Moment]) {
        let before = self.left_out;
        self.keep(Some(some));
        self.left_out |= before;
    }

    /// The moments that somebody asked for.
    pub(crate) fn kept(all: &[Self]) -> impl Iterator<Item = Moment> {
        let left_out = |it: &Moment| all.iter().any(|at| at.leaves_out(*it));
        Moment::ALL.into_iter().filter(move |it| !left_out(it))
    }

    /// Whether nobody asked for a moment.
    fn leaves_out(&self, moment: Moment) -> bool {
        self.left_out & 1 << moment as u16 != 0
    }

    /// In flight but for a probability that is `neglected` everywhere, the force has no skewness and no kurtosis.
    pub(crate) fn drop_standardised_in_flight(&mut self, neglected: f64) {
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
    /// Adds what is at a displacement: its mass, and the integrals of v and v^2 over it.
    pub(crate) fn add(&mut self, contact: &ContactLaw, q: f64, [mass, speed, square]: [f64; 3]) {
        let force = contact.force(q);
        self.mass += mass;
        self.q += q * mass;
        self.qq += q * q * mass;
        self.v += speed;
        self.vv += square;
        self.qv += q * speed;
        for (power, sum) in (1..).zip(&mut self.force) {
            *sum += force.powi(power) * mass;
        }
        self.potential += contact.potential(q) * mass;
        self.lost += f64::from(u8::from(contact.is_lost(q))) * mass;
    }

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
            left_out: 0,
        }
    }
}
