//! A scene with every default filled in: as JSON, and as a scene file.

use super::names::{DRIFT, SCHEMES, TIME, TRANSIENT, name_of};
use super::outputs::names;
use super::{MonteCarlo, Noise, Scene};
use crate::clock::TimeUnit;
use crate::excitation::Excitation;
use crate::initial::Initial;
use serde_json::{Value, json};
use std::fmt::Write;

impl Scene {
    /// The scene with every default filled in, section by section: in results.json, and as TOML by
    /// [`Scene::to_toml`].
    pub fn resolved(&self) -> Value {
        let mut initial = json!({ "kind": self.initial.name() });
        if let Initial::Gaussian { mean, deviation } = self.initial {
            initial["mean"] = json!(mean);
            initial["deviation"] = json!(deviation);
        }
        let monte_carlo = self.monte_carlo.as_ref().map(|it| {
            let records = self.wants_records();
            let records = records.then(|| self.clock().time(MonteCarlo::DURATION));
            let noise = match it.noise {
                Noise::White => json!("white"),
                Noise::Cosines { cosines, band } => json!({ "cosines": cosines, "band": band }),
            };
            given(json!({
                "paths": it.paths,
                "seed": it.seed,
                "scheme": name_of(SCHEMES, Some(it.scheme)),
                "noise": noise,
                "step": it.step,
                "duration": it.duration.or(records),
            }))
        });
        let rig = self.rig.map(|rig| {
            json!({
                "static_load": rig.static_load(),
                "frequency": rig.frequency(),
                "static_compression": rig.static_compression(),
            })
        });
        let level = self.rig.zip(self.force_psd);
        let level =
            level.filter(|(rig, psd)| rig.level_from_force_psd(*psd) == self.oscillator.h());
        let level = level.map_or(("h", self.oscillator.h()), |(_, psd)| ("force_psd", psd));
        let excitation = (self.excitation != Excitation::default()).then(|| {
            let drive = self.excitation.drive.map(|it| {
                json!({
                    "amplitude": it.amplitude(),
                    "frequency": it.frequency(),
                    "phase": it.phase(),
                })
            });
            let envelope = self.excitation.envelope.as_ref();
            let envelope =
                envelope.map(|it| json!({ "times": it.times(), "factors": it.factors() }));
            given(json!({ "drive": drive, "envelope": envelope }))
        });
        let outputs = &self.outputs;
        let response = outputs
            .response
            .map(|it| json!({ "from": it.from, "to": it.to, "points": it.points }));
        let spectrum = outputs.spectrum;
        let spectrum =
            spectrum.map(|it| json!({ "until": it.until, "quantity": it.quantity.name() }));
        given(json!({
            "title": self.title,
            "oscillator": {
                "contact": self.oscillator.contact().tree(),
                "damping": self.oscillator.damping().name(),
                "zeta": self.oscillator.zeta(),
                level.0: level.1,
            },
            "rig": rig,
            "excitation": excitation,
            "initial": initial,
            "outputs": given(json!({
                "stationary": outputs.stationary,
                "moments_at": outputs.moments_at.tree(),
                "moments": outputs.moments.as_ref().map(|all| names(all)),
                "density_at": outputs.density_at.tree(),
                "steady": outputs.steady,
                "decay_rates": outputs.decay_rates,
                "spectrum": spectrum,
                "first_loss": outputs.first_loss.map(|until| json!({ "until": until })),
                "first_passage": outputs.first_passage.map(|it| {
                    json!({ "level": it.level, "side": it.side.name(), "until": it.until })
                }),
                "crossings": outputs.crossings.map(|window| json!({ "window": window })),
                "reach": outputs.reach.map(|it| json!({ "quantity": it.quantity.name(), "fraction": it.fraction })),
                "time_unit": outputs.time_unit.map(TimeUnit::name),
                "periodic": outputs.periodic.map(|phases| json!({ "phases": phases })),
                "response": response,
            })),
            "monte_carlo": monte_carlo,
            "accuracy": {
                "tolerance": self.accuracy.tolerance,
                "max_seconds": self.accuracy.max_seconds,
                "max_memory": self.accuracy.max_memory,
            },
            "method": given(json!({
                "transient": name_of(TRANSIENT, self.method.transient),
                "drift": name_of(DRIFT, self.method.drift),
                "time": name_of(TIME, self.method.time),
                "cells": self.method.cells,
                "step": self.method.step,
            })),
        }))
    }

    /// The resolved scene as a scene file: the same run again.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        for (key, value) in self.resolved().as_object().into_iter().flatten() {
            if let Value::Object(pairs) = value {
                let _ = writeln!(text, "\n[{key}]");
                for (key, value) in pairs {
                    let _ = writeln!(text, "{key} = {}", toml_value(value));
                }
            } else {
                let _ = writeln!(text, "{key} = {}", toml_value(value));
            }
        }
        text
    }
}

/// A value as TOML writes it.
pub(crate) fn toml_value(value: &Value) -> String {
    match value {
        Value::Object(pairs) => {
            let pairs = pairs.iter();
            let pairs: Vec<String> = pairs
                .map(|(key, value)| format!("{key} = {}", toml_value(value)))
                .collect();
            format!("{{ {} }}", pairs.join(", "))
        }
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(toml_value).collect();
            format!("[{}]", items.join(", "))
        }
        // Text and numbers read the same in both.
        other => other.to_string(),
    }
}

/// Without the keys that have no value.
fn given(mut it: Value) -> Value {
    if let Some(pairs) = it.as_object_mut() {
        pairs.retain(|_, value| !value.is_null());
    }
    it
}
