use super::kernel::Kernel;
use super::*;
use crate::contact::ContactLaw;
use crate::gaussian::Gaussian;
use crate::initial::Initial;
use crate::monte_carlo::events::Deaf;
use crate::monte_carlo::hamiltonian::Flow;
use crate::monte_carlo::law::{Hertz, Law, Linear};
use crate::monte_carlo::noise::{LANES, Lanes, Streams};
use rayon::prelude::*;

/// Noise of the finest level, in `units` equal pieces a finest step, so that every coarser Ornstein-
/// Uhlenbeck step is made of whole pieces: common random numbers at all levels.
struct Pieces {
    normals: Vec<Lanes>,
    /// Decay over one piece.
    decay: f64,
}

impl Pieces {
    fn new(stream: u64, count: usize, decay: f64) -> Self {
        let mut streams = Streams::new(77, stream * LANES as u64);
        let mut normals = vec![[0.0; LANES]; count + count % 2];
        for pair in normals.chunks_exact_mut(2) {
            let (mut a, mut b) = ([0.0; LANES], [0.0; LANES]);
            streams.normals(&mut a, &mut b);
            (pair[0], pair[1]) = (a, b);
        }
        Self { normals, decay }
    }

    /// The standard normals of the step made of pieces `first` to `first + count - 1`.
    fn step(&self, first: usize, count: usize) -> Lanes {
        let (mut sum, mut variance) = ([0.0; LANES], 0.0);
        for piece in &self.normals[first..first + count] {
            for lane in 0..LANES {
                sum[lane] = self.decay * sum[lane] + piece[lane];
            }
            variance = self.decay * self.decay * variance + 1.0;
        }
        sum.map(|x| x / variance.sqrt())
    }
}

/// `count` steps from (q, v) with the excitation of the start.
fn kernel<K: Kernel>(
    kernel: K,
    (mut q, mut v, first): (Lanes, Lanes, Lanes),
    noise: impl Fn(usize) -> Lanes,
    count: usize,
) -> (Lanes, Lanes) {
    let mut kick: Lanes = std::array::from_fn(|lane| kernel.kick(Hertz, q[lane], first[lane]));
    for k in 0..count {
        let normal = noise(k);
        for lane in 0..LANES {
            let old = (q[lane], v[lane], kick[lane]);
            (q[lane], v[lane], kick[lane]) = kernel.step(Hertz, old, normal[lane]);
        }
    }
    (q, v)
}

/// v^2 and \[q < -3/2\] at t = 6, from Gaussian starts about (1, 0), with steps of `coarse`, `coarse`/2, ...
fn levels(
    scheme: Scheme,
    it: &Oscillator,
    coarse: f64,
    levels: u32,
    group: u64,
) -> Vec<[Lanes; 2]> {
    let end = 6.0;
    let finest = 1usize << (levels - 1);
    let steps = (end / coarse).round() as usize;
    // Pieces in a step of the finest level, and in each Ornstein-Uhlenbeck step.
    let (units, parts): (usize, &[usize]) = match scheme {
        Scheme::Splitting42 => (2, &[1, 1]),
        Scheme::Splitting62 => (18, &[5, 8, 5]),
        _ => (1, &[1]),
    };
    let piece = coarse / (finest * units) as f64;
    // Central differences and Euler take sums of Wiener increments.
    let wiener = matches!(scheme, Scheme::CentralDifference | Scheme::EulerMaruyama);
    let decay = if wiener {
        1.0
    } else {
        (-2.0 * it.zeta() * piece).exp()
    };
    let pieces = Pieces::new(2 * group, steps * finest * units, decay);
    let mut start = Streams::new(78, group * LANES as u64);
    let (mut q0, mut v0) = ([0.0; LANES], [0.0; LANES]);
    start.normals(&mut q0, &mut v0);
    let (mut first, mut unused) = ([0.0; LANES], [0.0; LANES]);
    start.normals(&mut first, &mut unused);
    q0 = q0.map(|z| 1.0 + 0.4 * z);
    v0 = v0.map(|z| 0.4 * z);
    (0..levels)
        .map(|level| {
            let join = finest >> level;
            let step = coarse / f64::from(1u32 << level);
            let (mut q, mut v) = (q0, v0);
            let count = steps << level;
            let splitting = |motions: &[Flow], friction: &[(f64, f64)]| {
                let (mut q, mut v, mut force) = (q0, v0, q0.map(|q| Hertz.force(q)));
                let mut first = 0;
                for _ in 0..count {
                    for (k, motion) in motions.iter().enumerate() {
                        motion.advance(Hertz, (&mut q, &mut v, &mut force), 0.0, &mut Deaf);
                        if let Some((part, (decay, spread))) = parts.get(k).zip(friction.get(k)) {
                            let normal = pieces.step(first, part * join);
                            for lane in 0..LANES {
                                v[lane] = decay * v[lane] + spread * normal[lane];
                            }
                            first += part * join;
                        }
                    }
                }
                (q, v)
            };
            let noise = |k: usize| pieces.step(k * join, join);
            (q, v) = match Coefficients::new(scheme, it, step, 1.3) {
                Coefficients::ExponentialHeun(_) => (q, v),
                Coefficients::Baoab(it) => kernel(it, (q, v, first), noise, count),
                Coefficients::EulerMaruyama(it) => kernel(it, (q, v, first), noise, count),
                Coefficients::CentralDifference(it) => kernel(it, (q, v, first), noise, count),
                Coefficients::Splitting(it) => {
                    let motions = [it.first, it.inner, it.inner];
                    let stages = it.stages;
                    let motions = [&motions[..stages], &[it.first]].concat();
                    let friction = it.friction.map(|it| it.viscous);
                    splitting(&motions, &friction[..stages])
                }
            };
            [v.map(|v| v * v), q.map(|q| f64::from(u8::from(q < -1.5)))]
        })
        .collect()
}

/// Differences of E\[v^2\] and P(loss) between neighbouring steps, with standard errors.
fn differences(
    scheme: Scheme,
    zeta: f64,
    coarse: f64,
    count: u32,
    groups: u64,
) -> [Vec<(f64, f64)>; 2] {
    let temperature = 0.628_318_530_717_958_6;
    let h = temperature * 2.0 * zeta / std::f64::consts::PI;
    let it = Oscillator::new(ContactLaw::Hertz, zeta, h).unwrap();
    let per_group: Vec<Vec<[[f64; 2]; 2]>> = (0..groups)
        .into_par_iter()
        .map(|group| {
            let values = levels(scheme, &it, coarse, count, group);
            let pairs = values.windows(2);
            pairs
                .map(|pair| {
                    [0, 1].map(|what| {
                        let d: Vec<f64> = (0..LANES)
                            .map(|lane| pair[0][what][lane] - pair[1][what][lane])
                            .collect();
                        [d.iter().sum(), d.iter().map(|d| d * d).sum()]
                    })
                })
                .collect()
        })
        .collect();
    let n = groups as f64 * LANES as f64;
    [0, 1].map(|what| {
        (0..count as usize - 1)
            .map(|level| {
                let sum: f64 = per_group.iter().map(|g| g[level][what][0]).sum();
                let square: f64 = per_group.iter().map(|g| g[level][what][1]).sum();
                let mean = sum / n;
                (mean, ((square / n - mean * mean) / n).sqrt())
            })
            .collect()
    })
}

#[test]
fn each_scheme_has_its_weak_order_in_the_velocity_and_in_the_loss_of_contact() {
    // Scheme, zeta, coarsest step, groups, the order of E[v^2] that is accepted, and the most that halving
    // the step once may change it: 1.5 times what was seen.
    for (scheme, zeta, coarse, groups, least, most, level) in [
        (Scheme::EulerMaruyama, 0.005, 0.1, 12_000, 0.8, 1.5, 0.5),
        (
            Scheme::CentralDifference,
            0.005,
            0.4,
            120_000,
            1.7,
            2.3,
            7e-2,
        ),
        (Scheme::Baoab, 0.005, 0.4, 120_000, 1.7, 2.3, 7e-2),
        // The velocity of central differences has a term of order zeta step.
        (Scheme::CentralDifference, 0.1, 0.4, 20_000, 0.8, 1.7, 4e-2),
        (Scheme::Baoab, 0.1, 0.4, 20_000, 1.7, 2.3, 4e-2),
    ] {
        let [square, loss] = differences(scheme, zeta, coarse, 3, groups);
        let order = |d: &[(f64, f64)]| (d[0].0 / d[1].0).abs().log2();
        for (name, d) in [("E[v^2]", &square), ("P(loss)", &loss)] {
            println!(
                "{scheme}, zeta {zeta}: {name} differs by {:.1e} ± {:.0e} from step {coarse} to its half, \
                 then by {:.1e} ± {:.0e}: order {:.2}",
                d[0].0,
                d[0].1,
                d[1].0,
                d[1].1,
                order(d)
            );
        }
        // An order is one where both differences stand out of the noise.
        let seen = |d: &[(f64, f64)]| d.iter().all(|(mean, error)| mean.abs() > 5.0 * error);
        if seen(&loss) {
            let order = order(&loss);
            let noise =
                (loss[0].1 / loss[0].0).hypot(loss[1].1 / loss[1].0) / std::f64::consts::LN_2;
            let (least, most) = (least - 0.3 - 4.0 * noise, most + 0.3 + 4.0 * noise);
            // The first order of Euler's scheme is small in P(loss): 1.8 is seen at these steps.
            let faster = scheme == Scheme::EulerMaruyama;
            assert!(
                order > least && (order < most || faster),
                "{scheme} loss: {order}"
            );
        }
        let plain = zeta == 0.005;
        assert!(
            !plain || seen(&loss),
            "{scheme}: the order of P(loss) is not seen"
        );
        let order = order(&square);
        assert!(order > least && order < most, "{scheme}: {order}");
        assert!(square[0].0.abs() < level, "{scheme}: {}", square[0].0);
    }
}

#[test]
fn the_splittings_do_not_miss_the_loss_of_contact_even_in_steps_of_a_quarter_period() {
    // So accurate that their order drowns in the noise: a level, and that longer steps show more.
    for (scheme, groups, [low, high]) in [
        (Scheme::Splitting42, 30_000, [2e-2, 4.5e-2]),
        (Scheme::Splitting62, 6_000, [0.0, 1.2e-2]),
    ] {
        let [square, loss] = differences(scheme, 0.1, 3.0, 3, groups);
        println!(
            "{scheme}: E[v^2] differs by {:.1e} ± {:.0e} from step 3 to 1.5, then by {:.1e} ± {:.0e}; P(loss) by {:.1e} \
             and {:.1e}",
            square[0].0, square[0].1, square[1].0, square[1].1, loss[0].0, loss[1].0
        );
        let coarse = square[0].0.abs();
        assert!(coarse > low && coarse < high, "{scheme}: {coarse}");
        let fine = square[1].0.abs();
        assert!(fine < 4e-4 + 3.0 * square[1].1, "{scheme}: {fine}");
        for (difference, error) in loss {
            assert!(
                difference.abs() < 4e-4 + 3.0 * error,
                "{scheme} loss: {difference}"
            );
        }
    }
}

/// Paths that all begin in one state.
fn begun([q, v]: [f64; 2]) -> Group {
    Group {
        q: [q; LANES],
        v: [v; LANES],
        excitation: [0.0; LANES],
        signal: None,
        push: None,
        streams: Streams::new(1, 0),
    }
}

/// What a splitting makes of the mean (1, 0.5) and of Var v = 0.25 of G = q after t = 12, less the closed
/// form, over zeta T: its weak error, free of noise. The mean is that of the scheme as it runs, without
/// noise; the variance is carried through the same motions and Ornstein-Uhlenbeck steps.
fn weak_error(zeta: f64, step: f64, scheme: Scheme) -> [f64; 2] {
    // So fine an undamped motion that the splitting alone errs.
    const FINE: f64 = 400.0;
    let splitting = |it: &Oscillator| match Coefficients::new(scheme, it, step, FINE) {
        Coefficients::Splitting(it) => it,
        _ => panic!("{scheme} is not a splitting"),
    };
    let end = 12.0;
    let steps = (end / step).round() as u64;
    let quiet = Oscillator::new(ContactLaw::Linear, zeta, 1e-200).unwrap();
    let start = Initial::gaussian([1.0, 0.5], [0.5; 2]).unwrap();
    let after = |it: &Oscillator| Gaussian::of(it, &start).unwrap().after(it, end).unwrap();
    let mut group = begun([1.0, 0.5]);
    splitting(&quiet).advance(Linear, &mut group, steps, 0.0, &mut Deaf);
    let exact = after(&quiet).mean;
    let mean = (group.q[3] - exact[0]).hypot(group.v[3] - exact[1]);
    let it = Oscillator::new(ContactLaw::Linear, zeta, 0.2 * zeta).unwrap();
    let scheme = splitting(&it);
    // Columns of the root of the covariance in lanes 0 and 1, moved as (q, v); noise is added to C_vv.
    let moved = |flow: Flow, [a, b, c]: [f64; 3]| {
        let (mut q, mut v) = ([0.0; LANES], [0.0; LANES]);
        (q[0], v[1]) = (1.0, 1.0);
        let mut force = q;
        flow.advance(Linear, (&mut q, &mut v, &mut force), 0.0, &mut Deaf);
        [
            q[0] * q[0] * a + 2.0 * q[0] * q[1] * b + q[1] * q[1] * c,
            q[0] * v[0] * a + (q[0] * v[1] + q[1] * v[0]) * b + q[1] * v[1] * c,
            v[0] * v[0] * a + 2.0 * v[0] * v[1] * b + v[1] * v[1] * c,
        ]
    };
    let mut covariance = [0.25, 0.0, 0.25];
    for _ in 0..steps {
        for (stage, friction) in scheme.friction[..scheme.stages].iter().enumerate() {
            let (decay, spread) = friction.viscous;
            let flow = if stage == 0 {
                scheme.first
            } else {
                scheme.inner
            };
            let [a, b, c] = moved(flow, covariance);
            covariance = [a, decay * b, decay * decay * c + spread * spread];
        }
        covariance = moved(scheme.first, covariance);
    }
    let variance = covariance[2] - after(&it).covariance[1][1];
    [mean / zeta, variance.abs() / (zeta * it.temperature())]
}

#[test]
fn the_splittings_have_orders_4_and_6_in_zeta_and_2_in_its_square() {
    // Scheme, zeta, the order, and the most over zeta T at the shorter step.
    for (scheme, zeta, step, order, levels) in [
        (Scheme::Splitting42, 1e-5, 1.0, 4.0, [4e-4, 1.3e-4]),
        (Scheme::Splitting62, 1e-5, 2.0, 6.0, [6e-5, 3e-5]),
        (Scheme::Splitting42, 0.3, 0.5, 2.0, [1e-3, 9e-7]),
        (Scheme::Splitting62, 0.3, 0.5, 2.0, [6e-4, 4e-7]),
    ] {
        let errors = [step, step / 2.0].map(|step| weak_error(zeta, step, scheme));
        for (k, name) in ["mean", "Var v"].into_iter().enumerate() {
            let [coarse, fine] = errors.map(|error| error[k]);
            let measured = (coarse / fine).log2();
            println!(
                "{scheme}, zeta {zeta}: {name} errs by {coarse:.2e} zeta T, {fine:.2e}: order {measured:.2} of {order}"
            );
            // Steps short enough for the power 6 alone leave too little to see.
            assert!(
                (measured - order).abs() < if order > 5.0 { 1.1 } else { 0.4 },
                "{scheme} {name}: {measured}"
            );
            assert!(fine < levels[k], "{scheme} {name}: {fine}");
        }
    }
}

#[test]
fn the_exponential_scheme_has_the_exact_noise_of_friction_alone() {
    // Over any step, the noise of (q, v) without force is that of many short steps.
    for zeta in [1e-4, 0.3, 30.0] {
        let it = Oscillator::new(ContactLaw::Free, zeta, 0.01).unwrap();
        for step in [1e-3, 0.04 / zeta, 3.0] {
            let one = ExponentialHeun::new(&it, step);
            let n = 1 << 12;
            let part = ExponentialHeun::new(&it, step / f64::from(n));
            let variance = |it: &ExponentialHeun| {
                [
                    it.along * it.along + it.across * it.across,
                    it.along * it.spread,
                    it.spread * it.spread,
                ]
            };
            let [qq, qv, vv] = variance(&part);
            let mut sum = [0.0; 3];
            for _ in 0..n {
                let [a, b, c] = sum;
                let (f, d) = (part.f1, part.decay);
                sum = [
                    a + 2.0 * f * b + f * f * c + qq,
                    d * (b + f * c) + qv,
                    d * d * c + vv,
                ];
            }
            let got = variance(&one);
            let worst = (0..3)
                .map(|k| (got[k] / sum[k] - 1.0).abs())
                .fold(0.0, f64::max);
            println!("zeta {zeta}, step {step}: {worst:.1e}");
            assert!(worst < 1e-9);
        }
    }
}

#[test]
fn the_exponential_scheme_has_order_two_in_the_motion_under_strong_friction() {
    // Without noise worth mentioning the paths are the mean, known in closed form for G = q.
    let it = Oscillator::new(ContactLaw::Linear, 5.0, 1e-200).unwrap();
    let start = Initial::gaussian([1.0, 2.0], [1e-3; 2]).unwrap();
    let exact = Gaussian::of(&it, &start).unwrap().after(&it, 4.0).unwrap();
    let errors: Vec<f64> = [16u32, 32, 64]
        .into_iter()
        .map(|steps| {
            let mut group = begun([1.0, 2.0]);
            let scheme = ExponentialHeun::new(&it, 4.0 / f64::from(steps));
            scheme.advance(Linear, &mut group, u64::from(steps), &Deaf);
            (group.q[3] - exact.mean[0]).hypot(group.v[3] - exact.mean[1])
        })
        .collect();
    let rates: Vec<f64> = errors.windows(2).map(|w| (w[0] / w[1]).log2()).collect();
    println!("{errors:?}, rates {rates:.2?}");
    assert!(errors[2] < 1e-3 && rates.iter().all(|rate| (1.7..2.6).contains(rate)));
}

#[test]
fn the_schemes_of_order_1_and_2_converge_to_the_mean_of_the_linear_oscillator() {
    // A scheme that converges to something else passes every test against itself. Noise apart, G = q, t = 6.
    let it = Oscillator::new(ContactLaw::Linear, 0.005, 1e-200).unwrap();
    let start = Initial::gaussian([1.0, 0.5], [0.5; 2]).unwrap();
    let exact = Gaussian::of(&it, &start).unwrap().after(&it, 6.0).unwrap();
    for (scheme, step, order, level) in [
        (Scheme::EulerMaruyama, 0.02, 1.0, 0.07),
        (Scheme::CentralDifference, 0.2, 2.0, 6e-3),
        (Scheme::Baoab, 0.2, 2.0, 6e-3),
    ] {
        let errors = [step, step / 2.0].map(|step: f64| {
            let mut group = begun([1.0, 0.5]);
            let steps = (6.0 / step).round() as u64;
            Coefficients::new(scheme, &it, step, 1.0)
                .advance(Linear, &mut group, steps, 0.0, &mut Deaf);
            (group.q[3] - exact.mean[0]).hypot(group.v[3] - exact.mean[1])
        });
        let measured = (errors[0] / errors[1]).log2();
        println!("{scheme}: the mean errs by {errors:?}, order {measured:.2}");
        assert!(
            (measured - order).abs() < 0.3 && errors[1] < level,
            "{scheme}: {errors:?}"
        );
    }
}
