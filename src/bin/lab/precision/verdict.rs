//! What a calibration says of the error estimates at one tolerance, and the goals.

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goals {
    /// Largest share of numbers whose error is above its estimate.
    pub too_small: f64,
    /// Most numbers with an error estimate above the tolerance in runs that say it is met.
    pub unsaid: usize,
    /// Largest median of error estimate over error.
    pub median: f64,
}

/// The goals: `lab precision --calibrate` ends with status 1 where one is missed.
pub const GOALS: Goals = Goals {
    too_small: 0.01,
    unsaid: 0,
    median: 40.0,
};

/// The three judgements of a tolerance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    pub tolerance: f64,
    /// Scenes with numbers, and of them those that say they are short of the tolerance.
    pub answered: usize,
    pub short: usize,
    pub stopped: usize,
    pub refused: usize,
    pub numbers: usize,
    /// Numbers whose reference is not good enough for this tolerance.
    pub left_out: usize,
    /// Numbers whose true error is above its estimate.
    pub too_small: usize,
    /// The same, the reference solutions taken for exact.
    pub too_small_bare: usize,
    /// Numbers whose error estimate is above the tolerance while the run says that it is met.
    pub unsaid: usize,
    /// Median of error estimate over true error; 0 without any.
    pub median: f64,
    /// Answered scenes whose time is within a factor of [`FORESEEN`](super::calibration::FORESEEN) of their plan's.
    pub foreseen: usize,
    pub seconds: f64,
}

impl Verdict {
    /// Share of numbers whose true error is above its estimate.
    pub fn share(&self) -> f64 {
        self.too_small as f64 / self.numbers.max(1) as f64
    }

    pub fn missed(&self) -> Vec<String> {
        let at = format!("at {:.0e}", self.tolerance);
        let mut missed = Vec::new();
        if self.share() > GOALS.too_small {
            let share = 100.0 * self.share();
            missed.push(format!("error above its estimate in {share:.2} % {at}"));
        }
        if self.unsaid > GOALS.unsaid {
            let unsaid = self.unsaid;
            missed.push(format!(
                "{unsaid} estimates above the tolerance unsaid {at}"
            ));
        }
        if self.median > GOALS.median {
            let median = self.median;
            missed.push(format!("median of estimate over error {median:.1} {at}"));
        }
        missed
    }
}
