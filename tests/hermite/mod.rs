//! The Fokker-Planck equation (17) once more, by a method that shares nothing with the program's own:
//! Hermite functions in v, spectral elements in q, a Chebyshev series in time. Used to make the reference
//! solutions that error estimates are judged by.
//!
//! With theta >= T and w = exp(-(v^2/2 + U)/theta)/Z the density is p = w sum_n c_n(q) psi_n(v), psi_n the
//! normalised Hermite polynomials of v/sqrt(theta), and (17) is
//!
//! ```text
//! c_n' = -sqrt(theta n) d/dq c_{n-1} - sqrt(theta (n+1)) (d/dq - G/theta) c_{n+1}
//!        - c n c_n + (D/theta - c) sqrt(n (n-1)) c_{n-2} + F sqrt(n/theta) c_{n-1}
//! ```
//!
//! with any friction c(q), noise D = pi h times its envelope, and a drive F. Where the last two change with time, by
//! commutator-free Magnus steps of order 4 (Blanes and Moan, Appl. Numer. Math. 56, 2006, 1519), none across a bend of the
//! envelope.
//!
//! In q: Galerkin in L2(exp(-U/theta)) on elements with an edge on every kink of the force, so that it costs no order. A start narrower than the nodes can hold enters by its expectations of the
//! basis, and payoffs by their values at the nodes: that is the backward equation with smooth payoffs, for
//! which a start in one point is as good as any other. A wide start enters by its values at the nodes, and
//! payoffs by their integrals.

use std::f64::consts::{PI, SQRT_2, TAU};
use vibroimpact::contact::ContactLaw;
use vibroimpact::excitation::Excitation;
use vibroimpact::initial::Initial;
use vibroimpact::moments::RawMoments;
use vibroimpact::oscillator::Oscillator;
use vibroimpact::quadrature;

/// How fine.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Resolution {
    /// Elements in q.
    pub(crate) elements: usize,
    /// Their polynomial degree.
    pub(crate) degree: usize,
    /// Hermite functions in v.
    pub(crate) modes: usize,
    /// Energy at the edge in units of theta: 28 leaves out a probability of 1e-12.
    pub(crate) level: f64,
    /// Longest step under an excitation that changes with time.
    pub(crate) step: f64,
}

/// The equation on its basis, and the state y = sqrt(M) c, row-major over nodes and modes.
pub(crate) struct Hermite {
    theta: f64,
    modes: usize,
    degree: usize,
    /// Elements as matrices b_ij = m_i D_ij/sqrt(M_i M_j), each (degree + 1)^2.
    stiffness: Vec<f64>,
    q: Vec<f64>,
    mass: Vec<f64>,
    /// Length of q that a node stands for.
    lengths: Vec<f64>,
    /// Integrals of the basis functions times q, q^2, N to N^4, U and 1 out of contact.
    payoffs: [Vec<f64>; 8],
    /// c at the nodes, pi h, and what drives.
    friction: Vec<f64>,
    noise: f64,
    excitation: Excitation,
    /// Noise and force of now.
    now: [f64; 2],
    time: f64,
    step: f64,
    edges: Vec<f64>,
    nodes: Vec<f64>,
    state: Vec<f64>,
    /// Half axes of the ellipse that holds the spectrum, real and imaginary.
    axes: [f64; 2],
    work: [Vec<f64>; 2],
}

impl Hermite {
    /// The start of a run that goes to `until`.
    pub(crate) fn new(
        oscillator: &Oscillator,
        excitation: &Excitation,
        initial: &Initial,
        until: f64,
        resolution: Resolution,
    ) -> Self {
        let Resolution {
            elements,
            degree,
            modes,
            level,
            step,
        } = resolution;
        let contact = oscillator.contact().clone();
        let theta = temperature(oscillator, excitation, initial, until, modes);
        let edges = edges(&contact, theta, elements, level);
        let elements = edges.len() - 1;
        let (nodes, weights) = lobatto(degree);
        let derivative = derivative(&nodes);
        let count = elements * degree + 1;
        let (mut q, mut mass) = (vec![0.0; count], vec![0.0; count]);
        let (mut lengths, mut lost) = (vec![0.0; count], vec![0.0; count]);
        let mut friction = vec![0.0; count];
        let mut local = Vec::new();
        for (e, ends) in edges.windows(2).enumerate() {
            let half = 0.5 * (ends[1] - ends[0]);
            let middle = 0.5 * (ends[0] + ends[1]);
            for k in 0..=degree {
                let at = 0.5 * (ends[0] + ends[1]) + half * nodes[k];
                let m = weights[k] * (-contact.potential(at) / theta).exp();
                q[e * degree + k] = at;
                mass[e * degree + k] += half * m;
                lengths[e * degree + k] += half * weights[k];
                if contact.is_lost(middle) {
                    lost[e * degree + k] += half * m;
                }
                // Just within the element: friction may jump at its end.
                let within = at + 1e-12 * (middle - at);
                friction[e * degree + k] += half * m * oscillator.friction(within);
                local.push(m);
            }
        }
        for (c, mass) in friction.iter_mut().zip(&mass) {
            *c /= mass;
        }
        let total: f64 = mass.iter().sum();
        let mut stiffness = Vec::new();
        for e in 0..elements {
            for i in 0..=degree {
                for j in 0..=degree {
                    let scale = (mass[e * degree + i] * mass[e * degree + j]).sqrt();
                    let m = local[e * (degree + 1) + i];
                    stiffness.push(m * derivative[i * (degree + 1) + j] / scale);
                }
            }
        }
        mass.iter_mut().chain(&mut lost).for_each(|x| *x /= total);
        // A Gaussian needs wave numbers up to 6/s; elements hold about two thirds of pi over the spacing.
        let spacing = (edges[elements] - edges[0]).min(2.0 * (2.0 * level * theta).sqrt())
            / (elements * degree) as f64;
        let wide = match *initial {
            Initial::Gaussian { deviation, .. } => deviation[0] > 2.0 * spacing,
            Initial::Rest => false,
            Initial::Stationary => true,
        };
        let payoffs = if wide {
            payoffs(&contact, theta, &edges, &nodes, total)
        } else {
            nodal_payoffs(&contact, &q, &mass, &lost)
        };
        let noise = oscillator.noise();
        let mut it = Self {
            theta,
            modes,
            degree,
            stiffness,
            q,
            mass,
            lengths,
            payoffs,
            friction,
            noise,
            excitation: excitation.clone(),
            now: [noise, 0.0],
            time: 0.0,
            step,
            edges,
            nodes,
            state: vec![0.0; count * modes],
            axes: [0.0; 2],
            work: [vec![0.0; count * modes], vec![0.0; count * modes]],
        };
        let n = modes as f64;
        // The largest root of the Hermite polynomial of degree N is below 2 sqrt(N).
        let imaginary = 2.0 * (theta * n).sqrt() * it.norm();
        let highest = highest_factor(excitation, until) * noise / theta;
        let lowest = if excitation.envelope.is_some() {
            0.0
        } else {
            highest
        };
        let hot = |c: f64| c + (highest - c).abs().max((lowest - c).abs());
        let real = it.friction.iter().map(|c| hot(*c)).fold(0.0, f64::max);
        let driven = amplitude(excitation) * (n / theta).sqrt();
        it.axes = [0.5 * n * real + driven, imaginary + driven];
        it.start(initial, wide);
        it
    }

    /// Largest singular value of the derivative, by power iteration.
    fn norm(&self) -> f64 {
        let count = self.q.len();
        let mut x: Vec<f64> = (0..count).map(|k| (k as f64 * 1.7).sin()).collect();
        let mut norm = 0.0;
        for _ in 0..200 {
            let mut y = vec![0.0; count];
            self.each(|i, j, b| y[i] += b * x[j]);
            let mut z = vec![0.0; count];
            self.each(|i, j, b| z[j] += b * y[i]);
            norm = z.iter().map(|z| z * z).sum::<f64>().sqrt();
            x = z.iter().map(|z| z / norm).collect();
        }
        // The iteration comes from below; a twentieth more covers what is left.
        1.05 * norm.sqrt()
    }

    fn each(&self, mut f: impl FnMut(usize, usize, f64)) {
        let (p, d) = (self.degree, self.degree + 1);
        for (e, element) in self.stiffness.chunks(d * d).enumerate() {
            for i in 0..d {
                for j in 0..d {
                    f(e * p + i, e * p + j, element[i * d + j]);
                }
            }
        }
    }

    /// The start as its expectations of every basis function, or where it is wide by its values at the nodes.
    fn start(&mut self, initial: &Initial, wide: bool) {
        let ([mq, mv], [sq, sv]) = match *initial {
            Initial::Gaussian { mean, deviation } => (mean, deviation),
            Initial::Rest => ([0.0; 2], [0.0; 2]),
            Initial::Stationary => {
                for (i, m) in self.mass.iter().enumerate() {
                    self.state[i * self.modes] = m.sqrt();
                }
                return;
            }
        };
        // E He_{n+1} = mu E He_n + (s^2 - 1) n E He_{n-1} of a Gaussian, normalised.
        let (mu, excess) = (mv / self.theta.sqrt(), sv * sv / self.theta - 1.0);
        let mut modes = vec![1.0; self.modes];
        for n in 1..self.modes {
            let before = if n > 1 { modes[n - 2] } else { 0.0 };
            let k = (n - 1) as f64;
            modes[n] = (mu * modes[n - 1] + excess * k.sqrt() * before) / (k + 1.0).sqrt();
        }
        let mut load = vec![0.0; self.q.len()];
        if wide {
            // c_0 = p/rho times the mass; rho from the mass of the nodes.
            for (i, load) in load.iter_mut().enumerate() {
                let y = (self.q[i] - mq) / sq;
                let density = (-0.5 * y * y).exp() / (sq * TAU.sqrt());
                *load = self.lengths[i] * density;
            }
        }
        let elements = if wide { 0 } else { self.edges.len() - 1 };
        for e in 0..elements {
            let (a, b) = (self.edges[e], self.edges[e + 1]);
            let x = |q: f64| (2.0 * q - a - b) / (b - a);
            let at = e * self.degree;
            if sq == 0.0 {
                if mq >= a && mq < b {
                    for k in 0..=self.degree {
                        load[at + k] = lagrange(&self.nodes, k, x(mq));
                    }
                }
                continue;
            }
            // Panels of at most a deviation, out to nine of them.
            let (low, high) = (a.max(mq - 9.0 * sq), b.min(mq + 9.0 * sq));
            if high <= low {
                continue;
            }
            let panels = ((high - low) / sq).ceil() as usize;
            for k in 0..=self.degree {
                let f = |q: f64| {
                    let y = (q - mq) / sq;
                    lagrange(&self.nodes, k, x(q)) * (-0.5 * y * y).exp() / (sq * TAU.sqrt())
                };
                let width = (high - low) / panels as f64;
                let breaks: Vec<f64> = (0..=panels).map(|n| low + n as f64 * width).collect();
                load[at + k] += quadrature::integrate(f, &breaks, 1e-13).value;
            }
        }
        for (i, load) in load.iter().enumerate() {
            for (n, mode) in modes.iter().enumerate() {
                self.state[i * self.modes + n] = load * mode / self.mass[i].sqrt();
            }
        }
    }

    /// y -> (A + shift) y.
    fn apply(&mut self, y: &[f64], shift: f64, out: &mut [f64]) {
        let (m, p, d) = (self.modes, self.degree, self.degree + 1);
        let root = self.theta.sqrt();
        let [noise, force] = [self.now[0] / self.theta, self.now[1] / root];
        let [down, up] = &mut self.work;
        for (i, y) in y.chunks(m).enumerate() {
            let (down, up) = (&mut down[i * m..][..m], &mut up[i * m..][..m]);
            let out = &mut out[i * m..][..m];
            let friction = self.friction[i];
            let heat = noise - friction;
            for n in 0..m {
                let order = n as f64;
                let below = if n > 0 { y[n - 1] } else { 0.0 };
                let above = if n + 1 < m { y[n + 1] } else { 0.0 };
                let two = if n > 1 { y[n - 2] } else { 0.0 };
                down[n] = -root * order.sqrt() * below;
                up[n] = root * (order + 1.0).sqrt() * above;
                out[n] = (shift - friction * order) * y[n]
                    + heat * (order * (order - 1.0).max(0.0)).sqrt() * two
                    + force * order.sqrt() * below;
            }
        }
        for (e, element) in self.stiffness.chunks(d * d).enumerate() {
            for i in 0..d {
                let row = &mut out[(e * p + i) * m..][..m];
                for j in 0..d {
                    let (b, c) = (element[i * d + j], element[j * d + i]);
                    let down = &down[(e * p + j) * m..][..m];
                    let up = &up[(e * p + j) * m..][..m];
                    for ((row, down), up) in row.iter_mut().zip(down).zip(up) {
                        *row += b * down + c * up;
                    }
                }
            }
        }
    }

    /// Carries the state forward by `duration`.
    pub(crate) fn advance(&mut self, duration: f64) {
        let end = self.time + duration;
        if self.excitation.is_plain() {
            self.carry(duration);
            self.time = end;
            return;
        }
        let bends = match &self.excitation.envelope {
            Some(it) => it.times().to_vec(),
            None => Vec::new(),
        };
        let now = self.time;
        let mut ends: Vec<f64> = bends.into_iter().filter(|t| *t > now && *t < end).collect();
        ends.push(end);
        for end in ends {
            let steps = ((end - self.time) / self.step).ceil();
            let step = (end - self.time) / steps;
            for _ in 0..steps as u64 {
                self.magnus(step);
            }
            self.time = end;
        }
    }

    /// exp(step (a A_1 + b A_2)) exp(step (b A_1 + a A_2)), A_i at the Gauss points, a and b = 1/4 -+ sqrt(3)/6.
    fn magnus(&mut self, step: f64) {
        let root = 3f64.sqrt() / 6.0;
        let at = |t: f64| {
            let drive = self.excitation.drive.map_or(0.0, |it| it.force(t));
            let envelope = self.excitation.envelope.as_ref();
            [self.noise * envelope.map_or(1.0, |it| it.factor(t)), drive]
        };
        let [one, two] = [0.5 - root, 0.5 + root].map(|part| at(self.time + part * step));
        let [less, more] = [0.5 - 2.0 * root, 0.5 + 2.0 * root];
        for [a, b] in [[more, less], [less, more]] {
            self.now = std::array::from_fn(|k| a * one[k] + b * two[k]);
            self.carry(0.5 * step);
        }
        self.time += step;
    }

    /// Carries the state forward by `duration` under noise and force of now: exp(tau A) as a Chebyshev series on the
    /// ellipse of the spectrum, whose foci are imaginary where transport is faster than friction and real elsewhere.
    fn carry(&mut self, duration: f64) {
        let [a, b] = self.axes;
        let focal = (b * b - a * a).abs().sqrt().max(0.2 * (a + b));
        let real = a > b;
        // Beyond e^4 the terms cancel; beyond 40 terms a step gains little.
        let longest = (4.0 / a).min(40.0 / (a + b));
        let steps = (duration / longest).ceil();
        let tau = duration / steps;
        let coefficients = bessel(tau * focal, real);
        let sign = if real { -1.0 } else { 1.0 };
        let size = self.state.len();
        let (mut last, mut now, mut next) = (vec![0.0; size], vec![0.0; size], vec![0.0; size]);
        for _ in 0..steps as u64 {
            last.copy_from_slice(&self.state);
            self.apply(&last, a, &mut now);
            for x in &mut now {
                *x /= focal;
            }
            let mut sum: Vec<f64> = last
                .iter()
                .zip(&now)
                .map(|(last, now)| coefficients[0] * last + 2.0 * coefficients[1] * now)
                .collect();
            for &coefficient in &coefficients[2..] {
                self.apply(&now, a, &mut next);
                for k in 0..size {
                    next[k] = 2.0 / focal * next[k] + sign * last[k];
                    sum[k] += 2.0 * coefficient * next[k];
                }
                std::mem::swap(&mut last, &mut now);
                std::mem::swap(&mut now, &mut next);
            }
            let decay = (-a * tau).exp();
            for (state, sum) in self.state.iter_mut().zip(&sum) {
                *state = decay * sum;
            }
        }
    }

    /// The raw expectations of the state.
    pub(crate) fn raw(&self) -> RawMoments {
        let (m, sigma) = (self.modes, self.theta.sqrt());
        let mode = |n: usize| -> Vec<f64> {
            let nodes = self.state.iter().skip(n).step_by(m).zip(&self.mass);
            nodes.map(|(y, mass)| y / mass.sqrt()).collect()
        };
        let sum = |payoff: &[f64], c: &[f64]| payoff.iter().zip(c).map(|(f, c)| f * c).sum();
        let (zero, one, two) = (mode(0), mode(1), mode(2));
        let [q, qq, n1, n2, n3, n4, potential, lost] =
            std::array::from_fn(|k| sum(&self.payoffs[k], &zero));
        let mass: f64 = sum(&self.mass, &zero);
        let second: f64 = sum(&self.mass, &two);
        let mean: f64 = sum(&self.mass, &one);
        RawMoments {
            mass,
            q,
            qq,
            v: sigma * mean,
            vv: self.theta * (mass + SQRT_2 * second),
            qv: sigma * sum(&self.payoffs[0], &one),
            force: [n1, n2, n3, n4],
            potential,
            lost,
        }
    }
}

/// The temperature of the basis: T, less where noise has not come that far until `until`, more where
/// the start is wider or higher. The density must stay in L2(1/w), and below T rounding must not: heating
/// lets what is in L2(1/w) out of it by a factor of up to exp(zeta (T/theta - 1) N t), held to e^9.
fn temperature(
    oscillator: &Oscillator,
    excitation: &Excitation,
    initial: &Initial,
    until: f64,
    modes: usize,
) -> f64 {
    let t = oscillator.temperature() * highest_factor(excitation, until).max(1.0);
    let zeta = oscillator.zeta();
    let noise = t * -(-2.0 * zeta * until).exp_m1();
    let contact = oscillator.contact();
    let slow = t / (1.0 + 9.0 / (zeta * modes as f64 * until));
    let lowest = contact.equilibrium().map_or(0.0, |q| contact.potential(q));
    // At resonance a drive brings a/(2 zeta) in the end, half of a more each unit of time before.
    let pushed = amplitude(excitation) * (0.5 * until).min(0.5 / zeta);
    match *initial {
        Initial::Gaussian {
            mean,
            deviation: [sq, sv],
        } => {
            let energy = |reach: f64| {
                let v = mean[1].abs() + pushed + reach * sv;
                let q = |q: f64| contact.potential(q) - lowest;
                0.5 * v * v + q(mean[0] + reach * sq).max(q(mean[0] - reach * sq))
            };
            let tail = (2.0 * energy(6.5)).sqrt() + 6.5 * noise.sqrt();
            let own = 1.2 * sv.max(sq).powi(2) + 1.3 * noise;
            own.max(slow)
                .max(0.5 * tail * tail / 26.0)
                .min(t)
                .max(1.2 * sv * sv)
                .max(energy(0.0) / 8.0)
                .max(energy(6.5) / 26.0)
        }
        Initial::Rest => (1.3 * noise)
            .max(slow)
            .min(t)
            .max((0.5 * pushed * pushed - lowest) / 8.0),
        Initial::Stationary => t.max(pushed * pushed / 16.0),
    }
}

/// The largest factor of the envelope up to a time.
fn highest_factor(excitation: &Excitation, until: f64) -> f64 {
    let Some(it) = &excitation.envelope else {
        return 1.0;
    };
    let within = it.times().iter().filter(|t| **t < until);
    let factors = within.map(|t| it.factor(*t));
    factors
        .chain([it.factor(0.0), it.factor(until)])
        .fold(0.0, f64::max)
}

/// The largest force of the drive.
fn amplitude(excitation: &Excitation) -> f64 {
    excitation.drive.map_or(0.0, |it| it.amplitude())
}

/// Integrals over the elements of the basis functions times each payoff and the weight, with q = a + (b - a) x^2 (3 - 2 x),
/// which takes half-integer powers at the ends away.
fn payoffs(
    contact: &ContactLaw,
    theta: f64,
    edges: &[f64],
    nodes: &[f64],
    total: f64,
) -> [Vec<f64>; 8] {
    let degree = nodes.len() - 1;
    let mut it: [Vec<f64>; 8] = std::array::from_fn(|_| vec![0.0; (edges.len() - 1) * degree + 1]);
    for (e, ends) in edges.windows(2).enumerate() {
        let (a, b) = (ends[0], ends[1]);
        let lost = f64::from(u8::from(contact.is_lost(0.5 * (a + b))));
        for k in 0..=degree {
            let of = |payoff: &dyn Fn(f64) -> f64| {
                let f = |x: f64| {
                    let q = a + (b - a) * x * x * (3.0 - 2.0 * x);
                    let weight = (-contact.potential(q) / theta).exp() / total;
                    let basis = lagrange(nodes, k, (2.0 * q - a - b) / (b - a));
                    6.0 * x * (1.0 - x) * (b - a) * basis * weight * payoff(q)
                };
                quadrature::integrate(f, &[0.0, 0.25, 0.5, 0.75, 1.0], 1e-13).value
            };
            let force = |q: f64| contact.force(q);
            let values = [
                of(&|q| q),
                of(&|q| q * q),
                of(&|q| force(q)),
                of(&|q| force(q).powi(2)),
                of(&|q| force(q).powi(3)),
                of(&|q| force(q).powi(4)),
                of(&|q| contact.potential(q)),
                of(&|_| lost),
            ];
            for (it, value) in it.iter_mut().zip(values) {
                it[e * degree + k] += value;
            }
        }
    }
    it
}

/// The same by the values of the payoffs at the nodes; `lost` is the mass of the elements below the loss
/// of contact.
fn nodal_payoffs(contact: &ContactLaw, q: &[f64], mass: &[f64], lost: &[f64]) -> [Vec<f64>; 8] {
    let all = |payoff: &dyn Fn(f64) -> f64| -> Vec<f64> {
        q.iter().zip(mass).map(|(q, m)| m * payoff(*q)).collect()
    };
    let force = |q: f64| contact.force(q);
    [
        all(&|q| q),
        all(&|q| q * q),
        all(&|q| force(q)),
        all(&|q| force(q).powi(2)),
        all(&|q| force(q).powi(3)),
        all(&|q| force(q).powi(4)),
        all(&|q| contact.potential(q)),
        lost.to_vec(),
    ]
}

/// Edges of elements: on every kink, and between them equal in s = sqrt(2 (U - U_min)/theta), the coordinate in which
/// exp(-U/theta) is a Gaussian, but no longer than three times the mean where the force is weak.
fn edges(contact: &ContactLaw, theta: f64, elements: usize, level: f64) -> Vec<f64> {
    const POINTS: usize = 2000;
    let reach = (2.0 * level).sqrt();
    let (left, right) = contact.turning_points(level * theta).unwrap();
    let lowest = contact.potential(contact.equilibrium().unwrap());
    let slope = |q: f64| {
        let rise = (contact.potential(q) - lowest).max(1e-12 * theta);
        let slope = contact.force(q).abs() / (2.0 * theta * rise).sqrt();
        slope.max(2.0 * reach / (3.0 * (right - left)))
    };
    let mut ends = vec![left];
    ends.extend(
        contact
            .kinks()
            .into_iter()
            .filter(|q| *q > left && *q < right),
    );
    ends.push(right);
    let mut it = vec![left];
    for ends in ends.windows(2) {
        let step = (ends[1] - ends[0]) / POINTS as f64;
        let mut sums = vec![0.0];
        for k in 0..POINTS {
            sums.push(sums[k] + step * slope(ends[0] + (k as f64 + 0.5) * step));
        }
        let all = sums[POINTS];
        let count = (elements as f64 * all / (2.0 * reach)).ceil() as usize;
        for part in 1..count {
            let target = all * part as f64 / count as f64;
            let k = sums.partition_point(|sum| *sum < target).max(1);
            let within = (target - sums[k - 1]) / (sums[k] - sums[k - 1]);
            it.push(ends[0] + step * (k as f64 - 1.0 + within));
        }
        it.push(ends[1]);
    }
    it
}

/// Legendre-Gauss-Lobatto nodes and weights of a degree, by Newton from Chebyshev's.
fn lobatto(degree: usize) -> (Vec<f64>, Vec<f64>) {
    let n = degree as f64;
    let legendre = |x: f64| {
        let (mut before, mut now) = (1.0, x);
        for k in 2..=degree {
            let k = k as f64;
            (before, now) = (now, ((2.0 * k - 1.0) * x * now - (k - 1.0) * before) / k);
        }
        (before, now)
    };
    let nodes: Vec<f64> = (0..=degree)
        .map(|k| {
            let mut x = -(PI * k as f64 / n).cos();
            for _ in 0..100 {
                let (before, now) = legendre(x);
                // (1 - x^2) P' = n (P_{n-1} - x P_n), whose derivative is -n (n + 1) P_n.
                x -= (x * now - before) / ((n + 1.0) * now);
            }
            x
        })
        .collect();
    let weight = |x: &f64| 2.0 / (n * (n + 1.0) * legendre(*x).1.powi(2));
    let weights = nodes.iter().map(weight).collect();
    (nodes, weights)
}

/// Lagrange polynomial k of the nodes.
fn lagrange(nodes: &[f64], k: usize, x: f64) -> f64 {
    let others = nodes.iter().enumerate().filter(|(i, _)| *i != k);
    others
        .map(|(_, node)| (x - node) / (nodes[k] - node))
        .product()
}

/// Derivative of Lagrange polynomial j at node i, row-major.
fn derivative(nodes: &[f64]) -> Vec<f64> {
    let n = nodes.len();
    let slope = |j: usize| -> f64 {
        let others = (0..n).filter(|k| *k != j);
        others.map(|k| nodes[j] - nodes[k]).product()
    };
    let slopes: Vec<f64> = (0..n).map(slope).collect();
    let mut it = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..n {
            if i != j {
                it[i * n + j] = slopes[i] / (slopes[j] * (nodes[i] - nodes[j]));
            }
        }
        // Rows sum to zero: the derivative of a constant.
        it[i * n + i] = -it[i * n..][..n].iter().sum::<f64>();
    }
    it
}

/// J_k(x), or I_k(x) where `real`, for k from 0 to where they vanish: Miller's downward recurrence.
fn bessel(x: f64, real: bool) -> Vec<f64> {
    let top = (x + 30.0 + 8.0 * x.cbrt()).ceil() as usize;
    let mut it = vec![0.0; top + 30];
    let end = it.len();
    it[end - 2] = 1e-250;
    let sign = if real { 1.0 } else { -1.0 };
    for k in (1..end - 1).rev() {
        it[k - 1] = 2.0 * k as f64 / x * it[k] + sign * it[k + 1];
        if it[k - 1].abs() > 1e200 {
            for it in &mut it {
                *it *= 1e-200;
            }
        }
    }
    // J_0 + 2 J_2 + 2 J_4 + ... = 1; I_0 + 2 I_1 + 2 I_2 + ... = e^x.
    let step = if real { 1 } else { 2 };
    let sum = it[0] + 2.0 * it.iter().skip(step).step_by(step).sum::<f64>();
    let scale = if real { x.exp() } else { 1.0 } / sum;
    for it in &mut it {
        *it *= scale;
    }
    let last = it.iter().rposition(|it| it.abs() > 1e-18).unwrap_or(1);
    it.truncate(last.max(1) + 1);
    it
}
