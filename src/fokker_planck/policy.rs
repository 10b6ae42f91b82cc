//! Numbers that were chosen and not derived, in one table: each trades time for accuracy, or one kind of error estimate for
//! another. `cargo run --release --bin lab -- policy` moves each by a fifth, up and down, over the scenes of the calibration
//! and those of every other question, and prints what that changes: validation/precision/policy.md.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// A number that was chosen.
#[derive(Debug)]
pub struct Chosen {
    /// Its name here.
    pub name: &'static str,
    /// What it is, and what more or less of it costs.
    pub trades: &'static str,
    value: f64,
    /// The bits of what it is multiplied by.
    factor: AtomicU64,
}

impl Chosen {
    const fn new(name: &'static str, value: f64, trades: &'static str) -> Self {
        Self {
            name,
            trades,
            value,
            factor: AtomicU64::new(1.0_f64.to_bits()),
        }
    }

    /// Its value.
    pub fn get(&self) -> f64 {
        self.value * f64::from_bits(self.factor.load(Relaxed))
    }

    /// Multiplies what is in the table by a factor from now on, in the whole program: for a survey alone.
    pub fn multiply(&self, factor: f64) {
        self.factor.store(factor.to_bits(), Relaxed);
    }
}

/// A static for each row, documented by what it trades, and [`ALL`]: name, value and words stand once.
macro_rules! table {
    ($($name:ident = $value:literal: $trades:literal;)*) => {
        $(#[doc = $trades] pub static $name: Chosen = Chosen::new(stringify!($name), $value, $trades);)*

        /// The table.
        pub static ALL: &[&Chosen] = &[$(&$name),*];
    };
}

table! {
    // The ladder.
    LADDER_RATIO = 1.35: "Cells and steps of a rung over those of the one before: the higher, the fewer rungs, and the farther \
        the last one overshoots. What converges with order 3, as a kink of the force lets it, then errs 2.5 times less.";
    FIRST_CELLS = 1.33: "Cells per deviation of the stationary law on the first rung: more pay for what loose tolerances do \
        not need.";
    COARSEST = 7.5e-2: "Error that a kernel which knows its own aims at on the first rung.";
    SPLITTING = 0.013: "L1 error of the splitting over what a rung aims at. Steps become shorter as slowly as that allows: each \
        pass over the mesh adds its interpolation error.";
    OUTSIDE = 1e-4: "Probability that the first domain leaves out: ten times as much of a variance is lost with it.";
    OUTSIDE_FALL = 5.0: "How many times less that is on each rung: a fall too slow for the cells keeps kurtoses back, a fast one \
        pays for empty cells.";
    SPANNED = 16.0: "Energies, over the temperature of the law that a flow map takes p against, that p spans at most. With 24, at \
        zeta = 0.05, h = 3e-3 from (0.5, 0) with deviations of 0.3, rounding asks for 165 x 140 cells in place of 47 x 44.";
    INITIAL_CELLS = 0.6: "Cells per deviation of an initial condition over those of the stationary law: noise smooths it.";
    REFINED = 2.0: "How many times finer than for the stationary law a mesh may be for the sake of its initial condition: beyond, \
        a moving local grid carries it until it is wide enough.";
    FALLING = 1.25: "Amplitude of a density over that of the stationary law up to which finite volumes hold it under strong \
        friction, and of their domain over that: with less room the tails cut off were 7e-5 of a variance. At 2 a mesh takes over \
        earlier, and has three times the cells. With it zeta = 5, T = 0.5 from (6, 0) took 91 s.";
    KINK_FINER = 3.6: "Cells of a flow map where contact begins over those elsewhere, under much noise: the kink of the force leaves \
        order 3 to equal cells. Twice as many bring a bilinear contact to 1e-4 in a third of the time, cost a Hertzian one a tenth, \
        and change nothing over the calibration.";
    KINK_WIDTH = 0.6: "Distance within which they are finer, in deviations of the stationary law.";
    LONGEST_STEP = 1.5: "Longest step of the flow map: a quarter of a period, beyond which the trapezoidal rule no longer sees \
        the second harmonic of the motion.";
    SETTLED = 1e-2: "Distance to the stationary law, over what a rung aims at, at which a run ends: less runs on for nothing, \
        more adds to the errors of late times.";

    SHARE = 0.03: "Part of the tolerance that is left to each error beside those of mesh and domain: of steps, of Krylov vectors and \
        reduced models.";

    // Error estimates.
    SAFETY = 2.5: "Error estimate of a run over its difference to the rung before, and of the steps of a scene over the difference to \
        half of them, with many cells; as much again over the cells per deviation with few.";
    CARRIED = 0.25: "Part that a difference is taken for at least, since one may pass through zero: of the difference before, of those \
        of moments that the motion turns into it, of other phases of a periodic law, of spectra; and of the largest change of a law's moments.";
    FLOOR = 2e-4: "What all rungs share of an error at least, over what the last one aims at: rounding, and what passes through \
        zero more than once. The median of estimate over error at 1e-2 is 30 with it, 35 with 5e-4, 49 with 2e-3.";
    UNSEEN = 0.36: "The part of the error of steps that runs with about as many do not show.";
    AS_MANY = 1.15: "Steps of a run over those of the rung before below which they are about as many.";

    // Concentrated initial conditions.
    EARLY = 0.02: "Time after rest at which the linearised Gaussian is taken: its force is wrong by G'' q^2/2, q^2 of the order \
        of h t^3, so its velocity by h t^4 = 2e-7 h.";
    LOCAL_CELL = 0.4: "Cells of a local grid in its deviations at a tolerance of 1e-3.";
    LOCAL_STEP = 0.57: "Steps of a local grid at a tolerance of 1e-3.";
    LOCAL_STEP_FRICTION = 0.25: "The same under friction that is not constant, which splits to a lower order.";
    LOCAL_STEP_DAMPING = 6e-3: "Fourth power of a step under strong damping times zeta^3, over the tolerance: a variance errs by 1.1e-2 zeta^3 tau^4 (from \
        rest, linear law, zeta = 0.2 to 5).";
    LOCAL_REACH = 2.5: "Deviations of a local grid's square beyond a Gaussian's: for tails that are not Gaussian and for the \
        fourth moments, which weigh them.";
    LOCAL_BORDER = 1e-6: "P on the border of that square over the tolerance, above which it is widened: tails that were cut \
        weighed two hundred times in a kurtosis (a point dropped at q = 1, t = 12).";
    LOCAL_DEFECT = 6e-3: "Mass that a local grid may lose, over the tolerance, before a mesh takes over. At five times as much the density \
        has been drawn thinner, and the mesh that holds it is finer: 2.6 s for 0.7 s from 9.71 of speed with deviations of 2.0 and 2.9 \
        to t = 60 at h = 0.3, zeta = 0.005, 1e-4. At half as much a moment that few steps of the grid precede may err 3 times its estimate.";
    GIVEN_CELLS = 1.9: "Cells of the scene per deviation of what is handed over to them, at least.";

    // Finite volumes.
    SERIES_SHARE = 1e-3: "Part of the tolerance that explicit steps may err by, where SHARE is that of the others: a Chebyshev \
        series gains a digit for a stage or two.";
    BOUNDARY_RATE = 4.0: "Rate of the exchange between neighbours among the boundary cells: a few times the oscillator's own \
        frequency, so that a boundary up to eight cells wide relaxes faster than any slow mode, and far below the stiffest rate.";
    STEEPEST = 3.5: "Largest change of ln p_s from cell to cell: a wide stencil keeps its stability beyond, but neither its order \
        nor a useful step (a hundredth of the transport's at 6, measured).";
    FORGOTTEN_SHARE = 0.3: "Part of what the steps may err by that is granted to errors which the evolution erases as fast as they \
        are made: how fast is told by one more step, of the error itself.";
    STEP_AIM = 0.8: "Part of the allowed error that a step aims at, and that a scheme which chooses its accuracy may use up: more \
        has steps refused, less has more of them.";
    STEP_GAIN = 1.35: "From this factor on a longer step is worth new factorisations.";

    // Resolutions of an operator: laws without a closed form, eigenvalues, spectra.
    HIGHER = 2.0: "By how many more powers of e a law falls within the domain from one resolution to the next: tails against functions.";
    LEFT = 2.0: "Error estimate over what changes leave if they go on falling as they did.";
    SLOWEST = 0.8: "The slowest fall that is believed: of changes that hardly shrink four times the last is left; error estimates of \
        a ladder that fall by less over three rungs end it.";
    SETTLED_LAW_SHARE = 0.1: "Part of the tolerance that is left to that law.";

    // Eigenvalues.
    RATES_APART = 0.25: "Distance of the shifts along the imaginary axis, in frequencies of small motions: fewer find fewer modes.";
    RATES_BESIDE = 0.97: "A shift beside a mode that no other is near, over the mode: the nearer, the fewer vectors, and the worse its \
        factors.";
    RATES_KNOWN = 0.05: "Error estimate over the eigenvalue beyond which it is none.";

    // Spectra.
    SPECTRUM_NEARBY = 0.5: "Distance, in frequencies of small motions, within which an answer is as uncertain as where it changes: changes \
        of a smooth spectrum cross zero no more often.";
}

#[cfg(test)]
mod tests {
    use super::{ALL, Chosen};
    use std::collections::HashSet;

    #[test]
    fn every_number_has_a_name_of_its_own_a_value_and_says_what_it_trades() {
        let names: HashSet<&str> = ALL.iter().map(|it| it.name).collect();
        assert_eq!(names.len(), ALL.len());
        for it in ALL {
            assert!(it.get() > 0.0 && it.get().is_finite(), "{}", it.name);
            assert!(it.trades.ends_with('.'), "{}: {}", it.name, it.trades);
        }
    }

    #[test]
    fn a_survey_moves_a_number_and_brings_it_back() {
        let chosen = Chosen::new("SAMPLE", 0.1, "Nothing.");
        chosen.multiply(1.2);
        assert_eq!(chosen.get(), 0.1 * 1.2);
        chosen.multiply(1.0);
        assert_eq!(chosen.get(), 0.1);
    }
}
