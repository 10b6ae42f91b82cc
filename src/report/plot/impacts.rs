//! The law of an impact: time of flight and speed at the return together, the speed, the peak force.

use super::canvas::{BLUE, INK, LEVELS, Picture, Points, VERMILION, picture};
use super::contours;
use super::legend::{Mark, legend};
use super::panel::{Panel, highest};
use crate::results::Results;

/// impacts.svg.
pub(crate) fn impacts(results: &Results) -> Picture {
    let law = results.impacts.as_ref()?;
    let peak = law.density.iter().map(|it| it.value).fold(0.0, f64::max);
    let last = |all: &[f64]| all.last().copied().unwrap_or(0.0);
    // The longest and the fastest are too rare to be seen.
    let (end, fastest) = (0.9 * last(&law.times), 0.9 * last(&law.speeds));
    let force = law.forces.iter().zip(&law.force_density);
    let force: Points = force.map(|(n, p)| (*n, p.value)).collect();
    let speed = law.speeds.iter().zip(&law.speed_density);
    let speed: Points = speed.map(|(c, p)| (*c, p.value)).collect();
    let most = |all: &Points| highest(all.iter().map(|it| it.1));
    let (top, high) = (most(&speed), most(&force));
    let seen = force.iter().filter(|it| it.1 > 1e-3 * high);
    let heaviest = highest(seen.map(|it| it.0));
    if !(peak > 0.0 && end.is_finite() && top > 0.0 && high > 0.0 && heaviest > 0.0) {
        return None;
    }
    let seen = results.sampled_crossings().map(|(seen, _)| seen);
    let seen = seen.filter(|it| it.mean_flight.value.is_finite());
    let joint = Panel::new([92.0, 44.0, 280.0, 320.0], (0.0, end), (0.0, fastest));
    let beside = |left: f64, x, top: f64| {
        let place = [left, 44.0, 240.0, 320.0];
        Panel::new(place, x, (0.0, 1.35 * top))
    };
    let speeds = beside(450.0, (0.0, fastest), top);
    let lightest = force.first().map_or(0.0, |it| it.0);
    let forces = beside(780.0, (lightest.min(heaviest), heaviest), high);
    Some(picture("impacts.svg", (1050, 420), |area| {
        joint.title(area, "Impacts: joint density over its peak")?;
        let flight = match results.scene.clock().suffix() {
            "" => "time of flight".to_owned(),
            unit => format!("time of flight,{unit}"),
        };
        joint.axes(area, &flight, "speed at the return")?;
        let columns = law.speeds.len();
        let p = |i: usize, j: usize| law.density[i * columns + j].value / peak;
        contours::fill(area, &joint, &LEVELS, (&law.times, &law.speeds), p, 0.0)?;
        joint.frame(area)?;
        speeds.axes(area, "speed at the return", "density")?;
        if let Some(seen) = seen {
            speeds.histogram(area, &seen.impact_speed)?;
        }
        speeds.curve(area, &speed, INK, 1.5)?;
        speeds.frame(area)?;
        let x = speeds.right() - 168.0;
        legend(area, (x, 62.0), INK, Mark::Line, "Rayleigh")?;
        if seen.is_some() {
            legend(
                area,
                (x, 81.0),
                VERMILION,
                Mark::Dot,
                "long realisations, 95 %",
            )?;
        }
        forces.axes(area, "peak force, no damping", "density")?;
        forces.curve(area, &force, BLUE, 1.5)?;
        forces.frame(area)
    }))
}
