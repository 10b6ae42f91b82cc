//! Random numbers with an address: path k of a seed draws from its own stream, whatever runs beside
//! it, and 16 streams are drawn at once.

use std::f64::consts::{LN_2, PI};

/// Paths that advance together; one cache line of doubles holds half of them.
pub(super) const LANES: usize = 16;

/// One number for each of the paths that advance together.
pub(super) type Lanes = [f64; LANES];

/// What a stream is for: the start of a path and its noise do not share numbers.
#[derive(Debug, Clone, Copy)]
pub(super) enum Purpose {
    Start,
    Noise,
    Signal,
}

/// splitmix64 (Steele, Lea and Flood, OOPSLA 2014): one output for a counter.
fn splitmix(counter: u64) -> u64 {
    let mut z = counter;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The 256 bits with which the stream of (seed, path, purpose) begins.
pub(super) fn address(seed: u64, path: u64, purpose: Purpose) -> [u64; 4] {
    const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
    let key =
        splitmix(seed.wrapping_add(GOLDEN)) ^ splitmix((purpose as u64 + 2).wrapping_mul(GOLDEN));
    let base = splitmix(key ^ splitmix(path.wrapping_mul(GOLDEN).wrapping_add(GOLDEN)));
    std::array::from_fn(|k| splitmix(base.wrapping_add(GOLDEN.wrapping_mul(k as u64 + 1))))
}

/// The 32 bytes of [`address`], to seed a generator of `rand_xoshiro`.
pub(super) fn seed_bytes(seed: u64, path: u64, purpose: Purpose) -> [u8; 32] {
    let mut bytes = [0; 32];
    for (chunk, word) in bytes.chunks_exact_mut(8).zip(address(seed, path, purpose)) {
        chunk.copy_from_slice(&word.to_le_bytes());
    }
    bytes
}

/// xoshiro256++ (Blackman and Vigna, ACM Trans. Math. Softw. 47:36, 2021), one generator a lane.
#[derive(Debug, Clone)]
pub(super) struct Streams {
    state: [[u64; LANES]; 4],
}

impl Streams {
    /// The noise of paths `first` to `first + LANES - 1`.
    pub(super) fn new(seed: u64, first: u64) -> Self {
        Self::for_purpose(seed, first, Purpose::Noise)
    }

    /// The streams of paths `first` to `first + LANES - 1` for a purpose.
    pub(super) fn for_purpose(seed: u64, first: u64, purpose: Purpose) -> Self {
        let mut state = [[0; LANES]; 4];
        for lane in 0..LANES {
            let words = address(seed, first.wrapping_add(lane as u64), purpose);
            for k in 0..4 {
                state[k][lane] = words[k];
            }
        }
        Self { state }
    }

    /// Two independent standard normals for each lane: [`normal_pair`] in three short loops, which the
    /// processor overlaps better than one long one.
    #[inline(always)]
    pub(super) fn normals(&mut self, first: &mut Lanes, second: &mut Lanes) {
        let [s0, s1, s2, s3] = &mut self.state;
        let (mut a, mut b) = ([0; LANES], [0; LANES]);
        for lane in 0..LANES {
            let mut s = [s0[lane], s1[lane], s2[lane], s3[lane]];
            (a[lane], b[lane]) = (next(&mut s), next(&mut s));
            [s0[lane], s1[lane], s2[lane], s3[lane]] = s;
        }
        let mut radius = [0.0; LANES];
        for lane in 0..LANES {
            radius[lane] = normal_radius(a[lane]);
        }
        for lane in 0..LANES {
            (first[lane], second[lane]) = normal_angle(radius[lane], b[lane]);
        }
    }
}

/// One output of xoshiro256++.
#[inline(always)]
pub(super) fn next(s: &mut [u64; 4]) -> u64 {
    let result = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
    let t = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = s[3].rotate_left(45);
    result
}

/// 1 <= x < 2 from the upper 52 bits of a word.
#[inline(always)]
fn one_to_two(word: u64) -> f64 {
    f64::from_bits((word >> 12) | 0x3ff0_0000_0000_0000)
}

/// Two standard normals from two words: Box and Muller, Ann. Math. Stat. 29:610 (1958), exact to
/// rounding.
#[cfg(test)]
fn normal_pair(a: u64, b: u64) -> (f64, f64) {
    normal_angle(normal_radius(a), b)
}

/// sqrt(-2 ln u), u in ]0, 1] from 52 bits of `a`: at most 8.49.
#[inline(always)]
fn normal_radius(a: u64) -> f64 {
    (-2.0 * ln_of_unit(2.0 - one_to_two(a))).sqrt()
}

/// `radius` times cosine and sine of an angle: within +-pi/4 from 52 bits of `b`, its octant from three
/// of the bits left over.
#[inline(always)]
fn normal_angle(radius: f64, b: u64) -> (f64, f64) {
    let (sin, cos) = sin_cos((one_to_two(b) - 1.5) * (0.5 * PI));
    let (x, y) = (radius * cos, radius * sin);
    let swap = 0u64.wrapping_sub(b & 1);
    let exchanged = (x.to_bits() ^ y.to_bits()) & swap;
    let (sign_x, sign_y) = ((b & 2) << 62, (b & 4) << 61);
    (
        f64::from_bits(x.to_bits() ^ exchanged ^ sign_x),
        f64::from_bits(y.to_bits() ^ exchanged ^ sign_y),
    )
}

/// ln u for a normal double u in ]0, 1], to 1 ulp or so, without branches: the polynomial of fdlibm's
/// e_log.c (Sun Microsystems, 1993) on sqrt(1/2) <= m < sqrt 2.
#[inline(always)]
fn ln_of_unit(u: f64) -> f64 {
    const HALF_ROOT: u64 = 0x3fe6_a09e_667f_3bcd;
    const TO_ONE: u64 = 0x3ff0_0000_0000_0000 - HALF_ROOT;
    const MANTISSA: u64 = (1 << 52) - 1;
    /// 2^52: an integer in the low bits of this double counts in ones.
    const COUNTER: u64 = 0x4330_0000_0000_0000;
    let bits = u.to_bits().wrapping_add(TO_ONE);
    let exponent = f64::from_bits((bits >> 52) | COUNTER) - (4_503_599_627_370_496.0 + 1023.0);
    let m = f64::from_bits((bits & MANTISSA).wrapping_add(HALF_ROOT));
    let f = m - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    let w = z * z;
    let even = w
        * (0.399_999_999_994_094_2 + w * (0.222_221_984_321_497_84 + w * 0.153_138_376_992_093_73));
    let odd = z
        * (0.666_666_666_666_673_5
            + w * (0.285_714_287_436_623_9
                + w * (0.181_835_721_616_180_5 + w * 0.147_981_986_051_165_86)));
    let half_square = 0.5 * f * f;
    exponent * LN_2 - (half_square - s * (half_square + (even + odd)) - f)
}

/// (sin x, cos x) for |x| <= pi/4, to rounding: fdlibm's k_sin.c and k_cos.c.
#[inline(always)]
fn sin_cos(x: f64) -> (f64, f64) {
    let z = x * x;
    let sin = x + x
        * z
        * (-0.166_666_666_666_666_32
            + z * (8.333_333_333_322_49e-3
                + z * (-1.984_126_982_985_795e-4
                    + z * (2.755_731_370_707_006_8e-6
                        + z * (-2.505_076_025_340_686_4e-8 + z * 1.589_690_995_211_55e-10)))));
    let cos = 1.0 - 0.5 * z
        + z * z
            * (4.166_666_666_666_66e-2
                + z * (-1.388_888_888_887_411e-3
                    + z * (2.480_158_728_947_673e-5
                        + z * (-2.755_731_435_139_066_3e-7
                            + z * (2.087_572_321_298_175e-9 + z * -1.135_964_755_778_819_5e-11)))));
    (sin, cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    #[test]
    fn every_lane_is_the_xoshiro_generator_of_its_own_address() {
        let mut streams = Streams::new(5, 32);
        let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
        for _ in 0..3 {
            streams.normals(&mut x, &mut y);
        }
        for lane in 0..LANES {
            let bytes = seed_bytes(5, 32 + lane as u64, Purpose::Noise);
            let mut reference = Xoshiro256PlusPlus::from_seed(bytes);
            let mut pair = (0.0, 0.0);
            for _ in 0..3 {
                pair = normal_pair(reference.next_u64(), reference.next_u64());
            }
            assert_eq!((x[lane], y[lane]), pair, "lane {lane}");
        }
        assert_ne!(
            address(5, 32, Purpose::Noise),
            address(5, 32, Purpose::Start)
        );
        assert_ne!(
            address(5, 32, Purpose::Noise),
            address(6, 32, Purpose::Noise)
        );
    }

    #[test]
    fn the_vectorised_logarithm_sine_and_cosine_are_exact_to_rounding() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let (mut log, mut trig): (f64, f64) = (0.0, 0.0);
        for k in 0..400_000 {
            let word = rng.next_u64() >> (12 + k % 52);
            let u = (word.max(1)) as f64 / 4_503_599_627_370_496.0;
            if u < 1.0 {
                log = log.max((ln_of_unit(u) / u.ln() - 1.0).abs());
            }
            let x = (rng.next_u64() as f64 / u64::MAX as f64 - 0.5) * 0.5 * PI;
            let (sin, cos) = sin_cos(x);
            trig = trig.max((sin - x.sin()).abs()).max((cos - x.cos()).abs());
        }
        println!("relative error of ln {log:.1e}, absolute error of sin and cos {trig:.1e}");
        assert!(log < 1e-15 && trig < 1e-15);
        assert_eq!(ln_of_unit(1.0), 0.0);
        let (extreme, _) = normal_pair(u64::MAX, 0);
        assert!(extreme.is_finite() && extreme.abs() < 8.5);
        assert_eq!(normal_pair(0, 0), (0.0, 0.0));
    }

    #[test]
    fn the_normals_have_the_moments_and_the_tails_of_a_gaussian() {
        let n: u32 = 1_000_000;
        let (mut sums, mut tail, mut cross) = ([0.0; 9], 0.0, 0.0);
        let mut streams: Vec<Streams> = (0..10).map(|k| Streams::new(9, 16 * k)).collect();
        let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
        for k in 0..n as usize / (2 * LANES) {
            streams[k % 10].normals(&mut x, &mut y);
            for lane in 0..LANES {
                cross += x[lane] * y[lane];
                for z in [x[lane], y[lane]] {
                    for (p, sum) in sums.iter_mut().enumerate() {
                        *sum += z.powi(p as i32);
                    }
                    tail += f64::from(u8::from(z > 3.0));
                }
            }
        }
        let count = sums[0];
        // E z^p and the variance of z^p for a Gaussian: (2p-1)!! - ((p-1)!!)^2.
        let exact = [1.0, 0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0];
        let spread = [
            0.0,
            1.0,
            2.0,
            15.0,
            96.0,
            945.0,
            10_170.0,
            135_135.0,
            2_016_000.0,
        ];
        for p in 1..9 {
            let z = (sums[p] / count - exact[p]) / (spread[p] / count).sqrt();
            println!("E z^{p} = {:.4}, {z:.2} standard errors", sums[p] / count);
            assert!(z.abs() < 4.0);
        }
        // P(z > 3) = 1.349898e-3.
        let z = (tail / count - 1.349_898e-3) / (1.35e-3 / count).sqrt();
        let zc = cross / (0.5 * count).sqrt();
        println!("tail {z:.2}, cross {zc:.2} standard errors");
        assert!(z.abs() < 4.0 && zc.abs() < 4.0);
    }
}
