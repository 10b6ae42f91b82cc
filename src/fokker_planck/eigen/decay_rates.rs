//! The slowest modes: eigenvalues of the Fokker-Planck operator nearest to the imaginary axis.
//!
//! Shift-invert Arnoldi on the operator in Hermite functions of v and spectral elements of q (`hermite`), at
//! three resolutions or more, each finer in elements, functions and domain. An eigenvalue is believed if the
//! last three have it and its error is small beside it: what its changes leave if they go on falling as they did
//! (`convergence`), the algebraic error |residual| / |left . right|, and rounding. The left eigenvector is the right one with v
//! reversed, under a friction that depends on the displacement nearly so, times exp(-g H/s) of `hermite::weights`.
//!
//! **Continuous spectrum.** Out of contact the force is a constant -f, and flights can be arbitrarily high.
//! Functions g = e^{kappa q} phi(v) solve the equation there, with kappa = -f/(2T) + ik where they stay bounded in the
//! norm of p_s; their eigenvalues are
//!
//! ```text
//! lambda = -f^2/(8 zeta T) - T k^2/(2 zeta) - 2 zeta n,   n = 0, 1, ...
//! ```
//!
//! a half-line without gaps. No eigenvalue beyond its edge is slowest: where none lies above it, distances to
//! the stationary law fall as t^{-3/2} e^{-f^2 t/(8 zeta T)} (f = 1 for the built-in laws).
//!
//! **No rate at all.** Where friction acts in contact alone, speed v falls by about zeta times the depth of an impact over v a
//! unit of time, v^{-1/5} for Hertz. From energies beyond E, of probability e^{-c E^{2/5}}, the part e^{-c' E^{-1/5} t} is still
//! there after t, and were there a gap lambda it would be e^{-lambda t} at most: lambda <= c' E^{-1/5} for every E. The
//! spectrum then reaches 0, and eigenvalues of truncated domains fall as these grow. They are the answer only where the
//! domain ends short of flight.

use crate::error::{Error, Result};
use crate::estimate::Shortfall;
use crate::fokker_planck::budget::{Cost, timing};
use crate::fokker_planck::hermite::{Resolution, work as friction_work};
use crate::fokker_planck::settings::Settings;
use crate::oscillator::Oscillator;
use std::fmt;

/// An eigenvalue of the generator: a mode decays as e^{re t} and turns at the circular frequency im.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct DecayRate {
    /// Real part, negative.
    pub re: f64,
    /// Imaginary part, not negative: complex modes come in conjugate pairs, each listed once.
    pub im: f64,
    /// Error of |re + i im|.
    pub error: f64,
}

impl fmt::Display for DecayRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.4e}", self.re)?;
        if self.im == 0.0 {
            return Ok(());
        }
        write!(f, " ± {:.4}i", self.im)
    }
}

/// Decay rates with what the tolerance asked for and was not reached.
#[derive(Debug, Clone, PartialEq)]
pub struct DecayRates {
    /// The slowest first; the slowest real one is added where it is not among those asked for. Fewer than
    /// asked for where the rest lies in the continuous spectrum.
    pub rates: Vec<DecayRate>,
    /// Where the continuous spectrum begins ([`Oscillator::continuous_from`]); None for a contact that is never lost. At 0
    /// there is no eigenvalue: flights without friction forget ever more slowly, the higher they are.
    pub continuous_from: Option<f64>,
    /// Functions of q and of v at the finest resolution.
    pub functions: [usize; 2],
    /// What is missing.
    pub shortfall: Option<Shortfall>,
}

impl DecayRates {
    /// Refuses more rates than may be asked for.
    pub(crate) fn check(count: usize) -> Result<()> {
        const MOST: usize = 100;
        if count <= MOST {
            return Ok(());
        }
        let accepted = format!("a whole number from 0 to {MOST}");
        Err(Error::invalid("outputs.decay_rates", count, accepted))
    }
}

/// Krylov vectors of a shift in the first search: the nearest dozens of eigenvalues converge. Finer
/// resolutions, whose shifts are chosen, begin with half as many.
const KRYLOV: usize = 50;

/// A continuous spectrum this many times faster than the slowest mode leaves room for a real one.
pub(super) const FAR_BELOW: f64 = 4.0;

/// Shifts along the imaginary axis that a search begins with: up to the second harmonic.
pub(super) const SHIFTS: usize = 9;

/// The most eigenvalues that domains and costs were measured for: more do not move them further.
const MEASURED: usize = 12;

/// Vectors of a shift over those it begins with, at most.
pub(super) const MOST_VECTORS: usize = 3;

/// How eigenvalues will be computed: resolutions, shifts, what must be found, and the foreseen cost.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Eigenvalues {
    /// How many are asked for.
    pub(super) count: usize,
    /// The coarsest resolution.
    pub(super) first: Resolution,
    /// Whether the scene gave the finest.
    pub(super) given: bool,
    /// Krylov vectors of a shift in the first search.
    pub(super) vectors: usize,
    /// Circular frequency of small motions: the shifts lie a quarter of it apart on the imaginary axis.
    pub(super) natural: f64,
    /// Where the continuous spectrum begins; minus infinity without one.
    pub(super) edge: f64,
    /// Whether friction depends on the displacement.
    pub(super) local: bool,
    /// Resolutions that hops between several wells take beyond one well: of four pairs of wells, T = 0.01 to 0.6, whatever the
    /// barrier over T.
    hops: usize,
    pub(super) tolerance: f64,
    /// What it will take: cells are functions of q and of v, steps the factorisations.
    pub(crate) cost: Cost,
}

impl Eigenvalues {
    /// The recipe for the `count` slowest.
    pub(crate) fn of(oscillator: &Oscillator, count: usize, settings: &Settings) -> Result<Self> {
        oscillator.displacement_law()?;
        let damping = oscillator.damping();
        damping.depends_on_displacement("decay rates")?;
        let contact = oscillator.contact();
        let stiffness = contact.equilibrium().map(|q| contact.stiffness(q));
        let local = !oscillator.is_viscous();
        // The least whose third knows three or four rates of thirty oscillators to 1e-2: what lies beyond e^-21 in probability
        // moves a slow mode by the square of its size there, about 1e4. The n-th mode in energy grows there as H^n: of 60
        // oscillators with 6 to 12 rates 12 missed 1e-3 within a domain that does not know their number, 2 within this one.
        let (least, level) = if local {
            ([6, 24], 27.0)
        } else {
            ([3, 10], 12.0 + 3.0 * count.clamp(2, MEASURED) as f64)
        };
        let mut it = Self {
            count,
            first: Resolution::first(settings.cells, 2, least, level),
            given: settings.cells.is_some(),
            vectors: KRYLOV.max(count + KRYLOV / 2),
            natural: stiffness.filter(|k| *k > 0.0).map_or(1.0, f64::sqrt),
            edge: oscillator.continuous_from().unwrap_or(f64::NEG_INFINITY),
            local,
            hops: if contact.equilibria().len() > 1 { 2 } else { 0 },
            tolerance: settings.tolerance,
            cost: Cost {
                cells: Some([0; 2]),
                steps: SHIFTS as u64 + 6,
                ..Cost::default()
            },
        };
        if it.edge == 0.0 {
            if it.sees_flight(oscillator) {
                it.cost.steps = 0;
                return Ok(it);
            }
            it.edge = f64::NEG_INFINITY;
        }
        let last = it.foreseen() - 1;
        it.cost.cells = Some(it.resolution(last).functions());
        it.cost.memory = it.work(last).memory;
        it.cost.seconds = (0..=last).map(|level| it.work(level).seconds).sum();
        Ok(it)
    }

    /// How many resolutions it will take, in the median of those 60 oscillators of one well.
    fn foreseen(&self) -> usize {
        let more = self.count.min(MEASURED).saturating_sub(3) / 4;
        3 + if self.given { 0 } else { more + self.hops }
    }

    /// Whether the domain of the third resolution reaches flight.
    fn sees_flight(&self, oscillator: &Oscillator) -> bool {
        let contact = oscillator.contact();
        let reach = oscillator.energy_at(self.resolution(2).level);
        let rise = contact.loss_point().zip(contact.lowest_potential());
        let rise = rise.map(|(loss, lowest)| contact.potential(loss) - lowest);
        rise.is_some_and(|rise| rise < reach)
    }

    /// Method and reason.
    pub(crate) fn words(&self) -> String {
        if self.edge == 0.0 {
            return "nothing to solve for: without friction in flight the spectrum is continuous from 0 on".into();
        }
        let condition = match self.edge / FAR_BELOW {
            f64::NEG_INFINITY => String::new(),
            slow => format!(" where the slowest of all is above {slow:.3}"),
        };
        format!(
            "shift-invert Arnoldi in Hermite functions and spectral elements, {} resolutions; {SHIFTS} shifts up \
             to {:.2}i, and one beside each mode far from them; a real rate must be among them{condition}",
            self.foreseen(),
            2.0 * self.natural
        )
    }

    /// A resolution, 0 for the coarsest.
    pub(super) fn resolution(&self, level: usize) -> Resolution {
        self.first.refined(level)
    }

    /// What a resolution takes: the first looks near every shift, later ones near two or three, with half as many
    /// vectors.
    pub(super) fn work(&self, level: usize) -> Cost {
        let it = self.resolution(level);
        let (places, vectors) = if level == 0 {
            (SHIFTS, self.vectors)
        } else {
            (3, self.vectors / 2)
        };
        let threads = rayon::current_num_threads() as f64;
        // A solve reads a state some forty times, orthogonalisation once a vector: 16 operations each, at a fifth of
        // the speed.
        let reads = (vectors * (vectors + 40) * it.len()) as f64;
        let (memory, factor) = if self.local {
            friction_work(it)
        } else {
            (it.memory(), it.operations())
        };
        let operations = factor + 80.0 * reads;
        // Factors and vectors of the shifts that are worked on at the same time.
        let held = 16 * (MOST_VECTORS * self.vectors * it.len()) as u64;
        Cost {
            seconds: places as f64 * operations * timing::OPERATION / threads,
            memory: (memory + held) * threads as u64,
            ..Cost::default()
        }
    }
}
