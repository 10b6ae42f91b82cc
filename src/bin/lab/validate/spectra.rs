//! What the paper reads off its spectra of the force: peaks, their heights, the half-power width.
//!
//! "RMS magnitude spectra" are the square root of the one-sided spectrum, so that a second peak of 8 % of
//! the main one is 0.64 % of its power.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use vibroimpact::error::Result;
use vibroimpact::estimate::{Estimate, Origin};
use vibroimpact::fokker_planck::{self, Settings, Spectrum};
use vibroimpact::monte_carlo::{self, Samples, Sampling};
use vibroimpact::oscillator::{Oscillator, Quantity};
use vibroimpact::spectrum::Welch;

/// Spectra of the force that have been computed, by oscillator: numbers and pictures of several folders
/// ask for the same ones.
#[derive(Default)]
pub struct Spectra {
    done: RefCell<BTreeMap<String, Rc<Spectrum>>>,
    sampled: RefCell<BTreeMap<String, Rc<Sampled>>>,
}

/// A spectrum by Welch's method from sampled paths.
pub struct Sampled {
    pub omega: Vec<f64>,
    /// One-sided density with its standard error.
    pub density: Vec<Estimate>,
    /// What the window and the sampling make of the solved spectrum.
    pub expectation: Vec<f64>,
}

/// Relative error asked of every value: below the width of a line in the pictures.
const TOLERANCE: f64 = 1e-2;
/// Seconds for one spectrum.
const SECONDS: f64 = 30.0;

fn spectrum(oscillator: &Oscillator) -> Result<Spectrum> {
    let settings = Settings {
        tolerance: TOLERANCE,
        max_seconds: SECONDS,
        ..Settings::default()
    };
    let (omegas, quiet) = (frequencies(oscillator.zeta()), |_| ());
    fokker_planck::spectrum(oscillator, Quantity::Force, &omegas, &settings, &quiet)
}

/// The highest circular frequency of the pictures: a little more than the paper's 1 kHz over 232 Hz.
const HIGHEST: f64 = 4.4;

/// Frequencies 0.01 apart, and closer about 1, where a weakly driven oscillator has its peak of width
/// 2 zeta.
fn frequencies(zeta: f64) -> Vec<f64> {
    let mut all: Vec<f64> = (0..=440).map(|k| 0.01 * f64::from(k)).collect();
    // A tenth of the half-power width over four widths to either side.
    all.extend((-80..=40).map(|k| 1.0 + 0.2 * zeta * f64::from(k)));
    // The second peak is twice as wide at small levels, and shifts down by tenths at large ones.
    all.extend((-100..=20).map(|k| 2.0 + 0.4 * zeta * f64::from(k)));
    all.retain(|w| *w >= 0.0);
    all.sort_by(f64::total_cmp);
    all.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    all
}

impl Spectra {
    /// The spectrum of the force up to 4.4.
    pub fn of(&self, oscillator: &Oscillator) -> Result<Rc<Spectrum>> {
        let address = format!("{oscillator:?}");
        if let Some(it) = self.done.borrow().get(&address) {
            return Ok(Rc::clone(it));
        }
        let it = Rc::new(spectrum(oscillator)?);
        self.done.borrow_mut().insert(address, Rc::clone(&it));
        Ok(it)
    }

    /// The same by Welch's method as in the paper: 2048 samples a segment, 400 averages; sampled so closely
    /// that what aliases into the range lies beyond three times its end.
    pub fn sampled(&self, oscillator: &Oscillator) -> Result<Rc<Sampled>> {
        const SEGMENTS: usize = 5;
        let address = format!("{oscillator:?}");
        if let Some(it) = self.sampled.borrow().get(&address) {
            return Ok(Rc::clone(it));
        }
        let spacing = 0.5 * std::f64::consts::PI / HIGHEST;
        let welch = Welch::new(2048, 1024, spacing)?;
        let asked = Samples {
            quantity: Quantity::Force,
            spacing,
            samples: welch.record_length(SEGMENTS),
            records: 400 / SEGMENTS as u64,
        };
        let settings = Sampling {
            max_seconds: SECONDS,
            ..Sampling::default()
        };
        let visit = |record: &[f64]| welch.record(record);
        let records = monte_carlo::series(oscillator, asked, &settings, &visit, &|_| ())?;
        let inside = welch.omega().into_iter().zip(welch.average(&records));
        let (omega, density): (Vec<f64>, Vec<Estimate>) =
            inside.take_while(|(w, _)| *w <= HIGHEST).unzip();
        let correlation = self
            .of(oscillator)?
            .correlation(spacing, welch.record_length(1));
        let mut expectation = welch.expectation(&correlation);
        expectation.truncate(omega.len());
        let it = Rc::new(Sampled {
            omega,
            density,
            expectation,
        });
        self.sampled.borrow_mut().insert(address, Rc::clone(&it));
        Ok(it)
    }

    /// `peak`: circular frequency of the largest local maximum in ]0.3, 1.5]; `second-peak`, `third-peak`: the
    /// same in 1.5 to 2.5 and 2.5 to 3.5 times that; `second-ratio`, `third-ratio`: RMS magnitude there over
    /// that of the main peak; `half-power`: half the relative width of the main peak at half its
    /// power, which is the damping ratio of a linear oscillator; `zero`: the value at zero frequency over
    /// 2h, 1 in theory. None for another name.
    pub fn number(&self, oscillator: &Oscillator, which: &str) -> Result<Option<Estimate>> {
        let it = self.of(oscillator)?;
        let main = highest(&it, 0.3, 1.5);
        let first = main.map_or(1.0, |k| it.omega[k]);
        let bands = [(1.5, 2.5), (2.5, 3.5)];
        let [second, third] = bands.map(|(from, to)| highest(&it, from * first, to * first));
        let place = |peak: Option<usize>| {
            let k = peak?;
            Some(Estimate::new(it.omega[k], reach(&it, k), Origin::Space))
        };
        let ratio = |peak: Option<usize>| {
            let (p, m) = (peak?, main?);
            let (a, b) = (it.density[p], it.density[m]);
            let value = (a.value / b.value).sqrt();
            let between = rise(&it, p) + rise(&it, m);
            let relative = 0.5 * (a.error / a.value + b.error / b.value + between);
            Some(Estimate::new(value, relative * value, Origin::Space))
        };
        Ok(match which {
            "peak" => place(main),
            "second-peak" => place(second),
            "third-peak" => place(third),
            "second-ratio" => ratio(second),
            "third-ratio" => ratio(third),
            "half-power" => main.and_then(|k| half_power(&it, k)),
            "zero" => it.density.first().map(|p| p.scaled(0.5 / oscillator.h())),
            _ => None,
        })
    }
}

/// The local maximum with the largest value between two frequencies; where there is none, the shoulder:
/// the place where ln G is least steep.
fn highest(it: &Spectrum, from: f64, to: f64) -> Option<usize> {
    let value = |k: usize| it.density[k].value;
    let inside = || (1..it.omega.len() - 1).filter(|k| it.omega[*k] > from && it.omega[*k] <= to);
    let slope = |k: usize| {
        let rise = (value(k + 1) / value(k - 1)).ln();
        (rise / (it.omega[k + 1] - it.omega[k - 1])).abs()
    };
    let maximum = inside()
        .filter(|k| value(*k) >= value(k - 1) && value(*k) >= value(k + 1))
        .max_by(|a, b| value(*a).total_cmp(&value(*b)));
    maximum.or_else(|| inside().min_by(|a, b| slope(*a).total_cmp(&slope(*b))))
}

/// How far a maximum may lie from where it was found: a spacing, and as far as values to either side equal
/// it within their errors.
fn reach(it: &Spectrum, k: usize) -> f64 {
    let here = it.density[k].value - it.density[k].error;
    let equal = |l: &usize| it.density[*l].value + it.density[*l].error >= here;
    let last = it.omega.len() - 1;
    let below = (1..k).rev().take_while(equal).last().unwrap_or(k);
    let above = (k + 1..last).take_while(equal).last().unwrap_or(k);
    let spacing = 0.5 * (it.omega[k + 1] - it.omega[k - 1]);
    let (below, above) = (it.omega[below], it.omega[above]);
    spacing + (it.omega[k] - below).max(above - it.omega[k])
}

/// How far the parabola through ln G at a frequency and its neighbours rises above it, at a maximum: what
/// lies between the frequencies.
fn rise(it: &Spectrum, k: usize) -> f64 {
    let ln = |k: usize| it.density[k].value.ln();
    let (below, here, above) = (ln(k - 1), ln(k), ln(k + 1));
    let bend = 2.0 * here - below - above;
    if here < below.max(above) || bend <= 0.0 {
        return 0.0;
    }
    (above - below).powi(2) / (8.0 * bend)
}

/// Half the width at half the power over the frequency of the peak.
fn half_power(it: &Spectrum, peak: usize) -> Option<Estimate> {
    let half = 0.5 * it.density[peak].value;
    let crossing = |a: usize, b: usize| {
        let (p, q) = (it.density[a].value, it.density[b].value);
        it.omega[a] + (it.omega[b] - it.omega[a]) * (p - half) / (p - q)
    };
    let below = (1..=peak).rev().find(|k| it.density[k - 1].value < half)?;
    let above = (peak..it.omega.len() - 1).find(|k| it.density[k + 1].value < half)?;
    let width = crossing(above, above + 1) - crossing(below, below - 1);
    // Lines between frequencies cut the curve short by a quarter of a spacing at most.
    let spacing = it.omega[above + 1] - it.omega[above];
    let centre = it.omega[peak];
    let (value, error) = (0.5 * width / centre, 0.25 * spacing / centre);
    Some(Estimate::new(value, error, Origin::Space))
}
