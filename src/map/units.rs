//! The units of the numbers of a map, as headings have them.

use super::axis::Axis;
use crate::clock::TimeUnit;
use crate::report::spelled;
use crate::results::dimension;
use serde_json::Value;

/// What the numbers of all points are in.
#[derive(Debug)]
pub(super) struct Units {
    /// The unit of the times of the scene.
    time: TimeUnit,
    /// Whether all points have the Hertz law.
    hertz: bool,
    /// The unit of `crossings.window`: seconds with a rig where the scene says nothing.
    window: &'static str,
    /// The unit of a spectrum.
    density: &'static str,
}

impl Units {
    /// Those of a scene as map.json holds it, with these axes.
    pub(super) fn of(scene: &Value, axes: &[Axis]) -> Self {
        let outputs = &scene["outputs"];
        let time = outputs["time_unit"].as_str().and_then(TimeUnit::named);
        let time = time.unwrap_or_default();
        let varied = |key: &str| axes.iter().any(|it| it.key().starts_with(key));
        let in_seconds = time == TimeUnit::Dimensionless && !scene["rig"].is_null();
        let displacement = outputs["spectrum"]["quantity"] == "displacement";
        Self {
            time,
            hertz: !varied("oscillator.contact") && scene["oscillator"]["contact"] == "hertz",
            window: if in_seconds { "s" } else { "1/W" },
            density: if displacement { "u^2/W" } else { "F^2/W" },
        }
    }

    /// The unit of a number, as headings have it.
    pub(super) fn bracketed(&self, name: &str) -> String {
        let unit = match name.rsplit_once('.') {
            Some((section, "window")) if section.ends_with("crossings") => Some(self.window),
            Some((_, "density")) if name.starts_with("spectrum.") => Some(self.density),
            _ => unit(name),
        };
        let circular = name.contains("spectrum.");
        let of = |unit| if circular { unit } else { self.time.of(unit) };
        unit.map_or_else(String::new, |unit| {
            format!(" [{}]", spelled(of(unit), self.hertz))
        })
    }
}

/// What one of a number is, in the units of the manual; None where its name says it, or where it depends.
fn unit(name: &str) -> Option<&'static str> {
    let (section, last) = name.rsplit_once('.').unwrap_or(("", name));
    match (section, last) {
        ("periodic.multipliers" | "response.multiplier", _) | ("spectrum", "harmonic_ratio") => {
            Some("1")
        }
        (_, "re" | "im" | "omega" | "half_power_width" | "rate" | "continuous_from") => Some("W"),
        (_, "mean_time" | "mean_time_up_to_last" | "t" | "time_seen") => Some("1/W"),
        (_, "level" | "loss_point") => Some("u"),
        (_, "temperature") => Some("(u W)^2"),
        (_, "lowest_density") => Some("1/(u^2 W)"),
        (_, "phase") => Some("rad"),
        (moment, "amplitude") => unit(moment).or(Some("1")),
        _ if name.starts_with("rig.") || name.starts_with("agreement.") => None,
        _ => Some(dimension(last)).filter(|it| *it != "1" || last.contains("probability")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_window_is_in_seconds_where_only_a_rig_says_so() {
        let window =
            |scene: Value| Units::of(&scene, &[]).bracketed("monte_carlo.crossings.window");
        let rig = json!({ "static_load": 110.0 });
        assert_eq!(window(json!({ "rig": rig, "outputs": {} })), " [s]");
        assert_eq!(window(json!({ "outputs": {} })), " [1/Omega]");
        let periods = json!({ "rig": rig, "outputs": { "time_unit": "period" } });
        assert_eq!(window(periods), " [periods]");
    }

    #[test]
    fn a_peak_is_as_high_as_its_spectrum_says() {
        let peak = |quantity: &str| {
            let scene = json!({ "outputs": { "spectrum": { "quantity": quantity } } });
            Units::of(&scene, &[]).bracketed("spectrum.peaks.density")
        };
        assert_eq!(peak("force"), " [F_s^2/Omega]");
        assert_eq!(peak("displacement"), " [(z_s/q_s)^2/Omega]");
        assert_eq!(unit("spectrum.peaks.half_power_width"), Some("W"));
        assert_eq!(unit("transient.mean_q"), Some("u"));
    }
}
