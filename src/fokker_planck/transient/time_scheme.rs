//! The scheme in time of finite volumes.

use crate::fokker_planck::budget::timing;
use crate::fokker_planck::flux::Drift;
use crate::fokker_planck::generator::Generator;
use crate::fokker_planck::settings::TimeScheme;
use crate::oscillator::Oscillator;

/// The scheme in time that costs least on this mesh, with the reason. Costs are counted in stages of the
/// explicit scheme; the measurements are those of tests/time.rs.
pub fn time_scheme(
    oscillator: &Oscillator,
    generator: &Generator,
    tolerance: f64,
    until: f64,
) -> (TimeScheme, String) {
    if generator.drift() == Drift::Upwind {
        let reason = "backward Euler keeps upwind drift positive";
        return (TimeScheme::BackwardEuler, reason.into());
    }
    let (transport, diffusion) = generator.radii();
    // 1.2 stages per unit of F dt + s dt at the longest step, up to twice that in a tall domain.
    let tall = 1.0 + (0.1 * diffusion / transport).min(1.0);
    let explicit = 1.2 * (transport + 0.5 * diffusion * tall) * until;
    // Bound by transport, and while the initial condition is smoothed by accuracy: 15 steps per unit of time at
    // 1e-5, order 4.
    let accuracy = 15.0 * (1e-5 / tolerance).powf(0.25);
    let bound = transport / 3.8;
    let imex =
        timing::IMEX_STAGES * (until * bound + until.min(5.0) * (accuracy - bound).max(0.0) + 50.0);
    // About 60 steps and ten factorisations until the
    // step is that of the slow motion: 0.1 of its time 1 or 2 zeta at 1e-5, order 5.
    let finer = (1e-5 / tolerance).powf(0.2);
    let slow = 0.1 * (2.0 * oscillator.zeta()).max(1.0) / finer;
    let implicit =
        timing::RADAU_STAGES * (60.0 * finer + until / slow) + 10.0 * timing::RADAU_LU_STAGES;
    let costs = [
        (TimeScheme::Explicit, explicit),
        (TimeScheme::Imex, imex),
        (TimeScheme::Implicit, implicit),
    ];
    let cheaper = |best: (_, f64), other: &(_, f64)| if other.1 < best.1 { *other } else { best };
    let (best, _) = costs.iter().fold(costs[0], cheaper);
    let reason = format!(
        "{}: steps of {:.1e} for transport, steps of {:.1e} for friction and diffusion and steps of {slow:.1e} for accuracy \
         cost about {explicit:.1e} stages explicit, {imex:.1e} imex, {implicit:.1e} implicit",
        best.name(),
        transport.recip(),
        diffusion.recip()
    );
    (best, reason)
}
