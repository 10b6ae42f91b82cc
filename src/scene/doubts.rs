//! What is accepted in a scene and yet hardly meant.

use super::{MonteCarlo, Scene};
use crate::format::{brief, rounded};
use crate::initial::Initial;
use crate::rig::Rig;
use std::f64::consts::TAU;

/// Times that end before so many are doubted where seconds could be meant.
const FEW_PERIODS: f64 = 8.0 * TAU;

impl Scene {
    /// What is accepted and yet hardly meant: units of a rig, a damping in per cent, an initial condition of nothing.
    pub(crate) fn doubts(&self) -> Vec<String> {
        let mut doubts = Vec::new();
        let outputs = &self.outputs;
        doubts.extend(self.rig().iter().flat_map(|rig| self.of_rig(rig)));
        if self.initial != Initial::Rest && !self.begins_somewhere() {
            let doubt = "initial: nothing that is asked for depends on the initial condition";
            doubts.push(doubt.to_owned());
        }
        if let Some(reach) = outputs.reach.filter(|it| it.fraction >= 10.0) {
            let (times, share) = (brief(reach.fraction), brief(reach.fraction / 100.0));
            doubts.push(format!(
                "outputs.reach.fraction = {times} is {times} times the stationary value; {times} % of it would be {share}"
            ));
        }
        let unused = self.unused().into_iter();
        doubts.extend(unused.map(|key| format!("{key}: nothing that is asked for uses it")));
        doubts
    }

    /// What is hardly meant of a rig.
    fn of_rig(&self, rig: &Rig) -> Vec<String> {
        let mut doubts = Vec::new();
        let (z, mass) = (rig.static_compression(), rig.mass());
        if z > 1e-3 {
            let (z, mm) = (brief(z), brief(rounded(z * 1e3, 4)));
            doubts.push(format!(
                "rig.static_compression = {z} is in metres, {mm} mm; 3.5 um would be 3.5e-6"
            ));
        }
        if !(1e-6..=1e5).contains(&mass) {
            let mass = brief(rounded(mass, 3));
            let factor = brief(rounded(self.oscillator.contact().static_compression(), 4));
            doubts.push(format!(
                "the moving mass that follows from [rig], {factor} F_s/(z_s Omega^2), is {mass} kg"
            ));
        }
        let zeta = self.oscillator.zeta();
        if zeta > 0.2 {
            let (zeta, share) = (brief(zeta), brief(rounded(100.0 * zeta, 4)));
            doubts.push(format!(
                "oscillator.zeta = {zeta} is {share} %; 0.8 % would be 0.008"
            ));
        }
        // Its frequency is that of small vibrations, its load what holds them.
        let contact = self.oscillator.contact();
        let (force, stiffness) = (contact.force(0.0), contact.stiffness(0.0));
        if force.abs() > 0.01 || (stiffness - 1.0).abs() > 0.1 {
            let [force, stiffness] = [force, stiffness].map(|it| brief(rounded(it, 3)));
            doubts.push(format!(
                "[rig] takes G for 0 and its slope for 1 at q = 0, in units of the static load: those of \"{}\" are {force} \
                 and {stiffness}",
                contact.name()
            ));
        }
        let it = &self.outputs;
        let passage = it.first_passage.map_or(0.0, |it| it.until);
        let passage = passage.max(it.first_loss.unwrap_or(0.0));
        let last = it.moments_at.last().max(it.density_at.last()).max(passage);
        if it.time_unit.is_none() && last > 0.0 && last < FEW_PERIODS {
            doubts.push(format!(
                "times are in units of 1/Omega: the last, {}, is {} ms; outputs.time_unit = \"s\" makes them seconds",
                brief(last),
                brief(rounded(rig.seconds(last) * 1e3, 3))
            ));
        }
        doubts
    }

    /// Keys of [method] and [monte_carlo] that are given and change nothing.
    fn unused(&self) -> Vec<&'static str> {
        let (it, method) = (&self.outputs, &self.method);
        let course = !it.moments_at.is_empty() || !it.density_at.is_empty() || it.reach.is_some();
        let driven = it.periodic.is_some() || it.response.is_some();
        let passage = it.first_loss.is_some() || it.first_passage.is_some();
        let law = it.steady || it.decay_rates > 0 || it.spectrum.is_some();
        let solved = it.stationary && !self.oscillator.damping().has_closed_form();
        // Its default is in every scene that is written.
        let paths = self.monte_carlo.as_ref().map(|it| it.paths);
        let paths = paths.is_some_and(|paths| paths != MonteCarlo::default().paths);
        let keys = [
            (
                "monte_carlo.paths",
                paths,
                passage || !it.moments_at.is_empty(),
            ),
            ("method.transient", method.transient.is_some(), course),
            ("method.drift", method.drift.is_some(), course || it.steady),
            ("method.time", method.time.is_some(), course),
            (
                "method.cells",
                method.cells.is_some(),
                course || driven || passage || law || solved,
            ),
            (
                "method.step",
                method.step.is_some(),
                course || driven || passage,
            ),
        ];
        let unused = keys.into_iter().filter(|(_, given, used)| *given && !used);
        unused.map(|(key, ..)| key).collect()
    }

    /// Whether anything asked for depends on the initial condition.
    fn begins_somewhere(&self) -> bool {
        let it = &self.outputs;
        !it.moments_at.is_empty()
            || !it.density_at.is_empty()
            || it.first_loss.is_some()
            || it.first_passage.is_some()
            || it.reach.is_some()
    }
}
