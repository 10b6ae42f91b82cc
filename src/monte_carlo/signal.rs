//! Band-limited excitations: the paper's sum of cosines, and the same spectrum by fast Fourier transform.

use super::noise::{LANES, Lanes, Purpose, Streams, address, next};
use num_complex::Complex;
use rustfft::{Fft, FftPlanner};
use std::f64::consts::{PI, TAU};
use std::fmt;
use std::sync::Arc;

/// A band-limited excitation of the paths that advance together, sampled at equal steps.
#[derive(Debug, Clone)]
pub(super) enum Signal {
    Cosines(Box<Cosines>),
    Band(Box<Band>),
}

impl Signal {
    /// Goes to time `now`, to be advanced by `step`.
    pub(super) fn begin(&mut self, now: f64, step: f64) {
        if let Self::Cosines(it) = self {
            it.begin(now, step);
        }
    }

    /// `factor` f at the present moment.
    #[inline(always)]
    pub(super) fn value(&self, factor: f64, value: &mut Lanes) {
        match self {
            Self::Cosines(it) => it.value(factor, value),
            Self::Band(it) => it.value(factor, value),
        }
    }

    /// Advances by one step and gives `factor` f there.
    #[inline(always)]
    pub(super) fn next(&mut self, factor: f64, value: &mut Lanes) {
        match self {
            Self::Cosines(it) => it.next(),
            Self::Band(it) => it.next(),
        }
        self.value(factor, value);
    }
}

/// The excitation of the paper, (31)-(33), one realisation a lane: f(t) = A sum_k cos(w_k t + phi_k),
/// A = 2 sqrt(h w_max/M), with frequencies uniform in ]0, w_max] and phases uniform in \[0, 2 pi\[
/// (Shinozuka and Jan, J. Sound Vib. 25:111, 1972). Its two-sided density is h up to w_max. As printed,
/// (32) is not a variance and (33) lacks the logarithm of Box and Muller; this is the evident intent.
#[derive(Debug, Clone)]
pub(super) struct Cosines {
    frequency: Vec<Lanes>,
    phase: Vec<Lanes>,
    /// cos and sin of w_k t + phi_k.
    now: Vec<[Lanes; 2]>,
    /// cos and sin of w_k step.
    turn: Vec<[Lanes; 2]>,
    amplitude: f64,
    start: f64,
    step: f64,
    taken: u32,
}

impl Cosines {
    /// Steps between two evaluations of the cosines from the time itself: rounding stays below 1e-12.
    const REFRESH: u32 = 4096;

    /// The excitation of paths `first` to `first + LANES - 1`: `count` cosines up to `band`, of two-sided
    /// density `level`.
    pub(super) fn new(seed: u64, first: u64, count: u32, band: f64, level: f64) -> Self {
        let count = count as usize;
        let (mut frequency, mut phase) = (vec![[0.0; LANES]; count], vec![[0.0; LANES]; count]);
        for lane in 0..LANES {
            let mut s = address(seed, first.wrapping_add(lane as u64), Purpose::Signal);
            for k in 0..count {
                let unit = |word: u64| (word >> 12) as f64 * 0.5f64.powi(52);
                frequency[k][lane] = band * (1.0 - unit(next(&mut s)));
                phase[k][lane] = TAU * unit(next(&mut s));
            }
        }
        Self {
            now: vec![[[0.0; LANES]; 2]; count],
            turn: vec![[[0.0; LANES]; 2]; count],
            amplitude: 2.0 * (level * band / count as f64).sqrt(),
            frequency,
            phase,
            start: 0.0,
            step: 0.0,
            taken: 0,
        }
    }

    fn begin(&mut self, now: f64, step: f64) {
        let here = self.start + f64::from(self.taken) * self.step;
        if step == self.step && (now - here).abs() < 1e-6 * step {
            return;
        }
        (self.start, self.step, self.taken) = (now, step, 0);
        for (w, turn) in self.frequency.iter().zip(&mut self.turn) {
            for lane in 0..LANES {
                let (sin, cos) = (w[lane] * step).sin_cos();
                (turn[0][lane], turn[1][lane]) = (cos, sin);
            }
        }
        self.refresh();
    }

    /// Cosines and sines from the time itself.
    fn refresh(&mut self) {
        self.start += f64::from(self.taken) * self.step;
        self.taken = 0;
        let phases = self.frequency.iter().zip(&self.phase);
        for ((w, phi), now) in phases.zip(&mut self.now) {
            for lane in 0..LANES {
                let (sin, cos) = (w[lane] * self.start + phi[lane]).sin_cos();
                (now[0][lane], now[1][lane]) = (cos, sin);
            }
        }
    }

    #[inline(always)]
    fn value(&self, factor: f64, value: &mut Lanes) {
        let mut sum = [0.0; LANES];
        for now in &self.now {
            for lane in 0..LANES {
                sum[lane] += now[0][lane];
            }
        }
        for lane in 0..LANES {
            value[lane] = factor * self.amplitude * sum[lane];
        }
    }

    #[inline(always)]
    fn next(&mut self) {
        self.taken += 1;
        if self.taken == Self::REFRESH {
            self.refresh();
            return;
        }
        for (now, turn) in self.now.iter_mut().zip(&self.turn) {
            for lane in 0..LANES {
                let (c, s) = (now[0][lane], now[1][lane]);
                now[0][lane] = c * turn[0][lane] - s * turn[1][lane];
                now[1][lane] = s * turn[0][lane] + c * turn[1][lane];
            }
        }
    }
}

/// Gaussian noise of two-sided density h up to a band limit, without end: segments of 4096 samples by
/// fast Fourier transform, each overlapping half of the one before under a window sin(pi n/N).
///
/// It is exactly stationary: the two windows at any time make the correlation that of the band times
/// cos(pi t/length of a segment), 1 within the correlation time of the noise.
#[derive(Clone)]
pub(super) struct Band {
    streams: Streams,
    /// Real and imaginary part: two independent segments, samples by lanes.
    segments: [Vec<Lanes>; 2],
    /// The half of the segment before that still sounds.
    tail: Vec<Lanes>,
    /// Output of the present half segment.
    output: Vec<Lanes>,
    place: usize,
    /// Which of `segments` comes next; 2 when both are used up.
    fresh: usize,
    transform: Arc<dyn Fft<f64>>,
    /// One lane on its way through the transform.
    column: Vec<Complex<f64>>,
    scratch: Vec<Complex<f64>>,
    /// Highest Fourier coefficient within the band, and the deviation of each.
    highest: usize,
    deviation: f64,
}

impl fmt::Debug for Band {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut it = f.debug_struct("Band");
        it.field("highest", &self.highest)
            .field("deviation", &self.deviation)
            .finish_non_exhaustive()
    }
}

impl Band {
    const SAMPLES: usize = 4096;

    /// The excitation of paths `first` to `first + LANES - 1` at equal steps.
    pub(super) fn new(seed: u64, first: u64, band: f64, level: f64, step: f64) -> Self {
        let n = Self::SAMPLES;
        let resolution = TAU / (n as f64 * step);
        let highest = ((band / resolution).floor() as usize).min(n / 2 - 1);
        // 2 highest + 1 coefficients carry the variance 2 h band.
        let deviation = (2.0 * level * band / (2 * highest + 1) as f64).sqrt();
        let transform = FftPlanner::new().plan_fft_inverse(n);
        let mut it = Self {
            streams: Streams::for_purpose(seed, first, Purpose::Signal),
            segments: [vec![[0.0; LANES]; n], vec![[0.0; LANES]; n]],
            tail: vec![[0.0; LANES]; n / 2],
            output: vec![[0.0; LANES]; n / 2],
            place: 0,
            fresh: 2,
            column: Vec::with_capacity(n),
            scratch: vec![Complex::default(); transform.get_inplace_scratch_len()],
            transform,
            highest,
            deviation,
        };
        // The first half segment fills the tail, the second sounds with it.
        it.half();
        it.half();
        it
    }

    #[inline(always)]
    fn value(&self, factor: f64, value: &mut Lanes) {
        for lane in 0..LANES {
            value[lane] = factor * self.output[self.place][lane];
        }
    }

    #[inline(always)]
    fn next(&mut self) {
        self.place += 1;
        if self.place == self.output.len() {
            self.half();
        }
    }

    /// The next half segment.
    fn half(&mut self) {
        if self.fresh == 2 {
            self.synthesise();
            self.fresh = 0;
        }
        let half = Self::SAMPLES / 2;
        let segment = &self.segments[self.fresh];
        for n in 0..half {
            let (falling, rising) = (PI * (n as f64 + 0.5) / Self::SAMPLES as f64).sin_cos();
            // sin is the window of a segment's first half; its second half has the cosine.
            for lane in 0..LANES {
                self.output[n][lane] = falling * segment[n][lane] + rising * self.tail[n][lane];
                self.tail[n][lane] = segment[n + half][lane];
            }
        }
        self.fresh += 1;
        self.place = 0;
    }

    /// Two segments: independent normal coefficients within the band, zero beyond, transformed.
    fn synthesise(&mut self) {
        let n = Self::SAMPLES;
        let [re, im] = &mut self.segments;
        re.fill([0.0; LANES]);
        im.fill([0.0; LANES]);
        for k in 0..=2 * self.highest {
            // 0, 1, ..., highest, -1, ..., -highest.
            let place = if k <= self.highest {
                k
            } else {
                n - (k - self.highest)
            };
            self.streams.normals(&mut re[place], &mut im[place]);
            for lane in 0..LANES {
                re[place][lane] *= self.deviation;
                im[place][lane] *= self.deviation;
            }
        }
        // x_n = sum_k c_k exp(2 pi i k n/N), without normalisation.
        for lane in 0..LANES {
            let parts = re.iter().zip(&*im);
            let series = parts.map(|(re, im)| Complex::new(re[lane], im[lane]));
            self.column.clear();
            self.column.extend(series);
            self.transform
                .process_with_scratch(&mut self.column, &mut self.scratch);
            for ((re, im), x) in re.iter_mut().zip(&mut *im).zip(&self.column) {
                (re[lane], im[lane]) = (x.re, x.im);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The correlation of f at the given lags, its mean over lanes and times.
    fn correlation(signal: &mut Signal, lags: &[usize], samples: usize) -> Vec<f64> {
        let mut f = vec![[0.0; LANES]; samples];
        for value in &mut f {
            signal.next(1.0, value);
        }
        lags.iter()
            .map(|lag| {
                let pairs = f.iter().zip(&f[*lag..]);
                let sum: f64 = pairs
                    .map(|(a, b)| (0..LANES).map(|l| a[l] * b[l]).sum::<f64>())
                    .sum();
                sum / ((samples - lag) * LANES) as f64
            })
            .collect()
    }

    #[test]
    fn both_excitations_have_the_correlation_of_a_flat_band() {
        // R(t) = 2 h sin(w t)/t.
        let (band, level, step) = (8.0, 0.1, 0.05);
        let lags = [0, 3, 8, 16, 40];
        let samples = 200_000;
        let mut by_transform = Signal::Band(Box::new(Band::new(3, 0, band, level, step)));
        let mut by_cosines = Signal::Cosines(Box::new(Cosines::new(3, 0, 400, band, level)));
        by_cosines.begin(0.0, step);
        for (name, signal) in [
            ("transform", &mut by_transform),
            ("cosines", &mut by_cosines),
        ] {
            for (lag, got) in lags.iter().zip(correlation(signal, &lags, samples)) {
                let t = *lag as f64 * step;
                let exact = if *lag == 0 {
                    2.0 * level * band
                } else {
                    2.0 * level * (band * t).sin() / t
                };
                println!("{name}: R({t:.2}) = {got:.4}, exact {exact:.4}");
                assert!((got - exact).abs() < 0.02 * 2.0 * level * band);
            }
        }
    }

    #[test]
    fn rotated_cosines_are_the_cosines_of_the_time() {
        let mut signal = Cosines::new(1, 0, 50, 8.0, 0.1);
        signal.begin(3.0, 0.05);
        let mut value = [0.0; LANES];
        for _ in 0..10_000 {
            signal.next();
        }
        signal.value(1.0, &mut value);
        let t = 3.0 + 10_000.0 * 0.05;
        for lane in 0..LANES {
            let terms = signal.frequency.iter().zip(&signal.phase);
            let sum: f64 = terms.map(|(w, phi)| (w[lane] * t + phi[lane]).cos()).sum();
            assert!((value[lane] - signal.amplitude * sum).abs() < 1e-9);
        }
    }
}
