//! A scene with every default filled in: as JSON, and as a scene file.

use super::outputs::names;
use super::{MonteCarlo, Noise, Scene};
use crate::clock::TimeUnit;
use crate::excitation::Excitation;
use crate::fokker_planck::{Drift, TimeScheme, TransientMethod};
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
                "scheme": it.scheme.name(),
                "noise": noise,
                "step": it.step,
                "duration": it.duration.or(records),
            }))
        });
        let level = self.rig.zip(self.force_psd);
        let level =
            level.filter(|(rig, psd)| rig.level_from_force_psd(*psd) == self.oscillator.h());
        let level = level.map_or(("h", self.oscillator.h()), |(_, psd)| ("force_psd", psd));
        let shaken = self.excitation != Excitation::default();
        let excitation = shaken.then(|| given(json!(self.excitation)));
        let method = &self.method;
        let transient = TransientMethod::NAMED.into_iter();
        let transient = transient.filter(|(_, it)| Some(*it) == method.transient);
        let transient = transient.map(|it| it.0).next();
        let drift = method.drift.map(|it| match it {
            Drift::Upwind => json!("upwind"),
            central => json!(central.order()),
        });
        let outputs = &self.outputs;
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
            "rig": self.rig,
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
                "response": outputs.response,
            })),
            "monte_carlo": monte_carlo,
            "accuracy": self.accuracy,
            "method": given(json!({
                "transient": transient.unwrap_or("auto"),
                "drift": drift.unwrap_or(json!("auto")),
                "time": method.time.map_or("auto", TimeScheme::name),
                "cells": method.cells,
                "step": method.step,
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
            let pair = |(key, value): (&String, &Value)| format!("{key} = {}", toml_value(value));
            let pairs: Vec<String> = pairs.iter().map(pair).collect();
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
