//! The results as one tree of plain values: results.json is its text.

use super::{Numbers, Results, SpectrumNumbers, centres};
use crate::estimate::Estimate;
use crate::fokker_planck::{FirstLoss, MetastableLaw, Periodic, Response, Sweep, Transient};
use crate::moments::Moments;
use crate::monte_carlo::{Crossings, FirstLossResult};
use crate::rig::Rig;
use serde_json::{Map, Value, json};

/// Named numbers, in their order.
type Named<'a> = &'a mut dyn Iterator<Item = (&'static str, Option<Estimate>)>;

fn numbers(all: Named<'_>) -> Map<String, Value> {
    all.map(|(name, number)| (name.to_owned(), json!(number)))
        .collect()
}

/// `{"value": [...], "error": [...]}`.
fn curve(points: impl Iterator<Item = Option<Estimate>>) -> Value {
    // Where there is no value there is no error either.
    let pair = |it: Option<Estimate>| {
        let it = it.filter(|it| it.value.is_finite());
        it.map_or((f64::NAN, f64::NAN), |it| (it.value, it.error))
    };
    let (value, error): (Vec<f64>, Vec<f64>) = points.map(pair).unzip();
    json!({ "value": value, "error": error })
}

fn full_curve(points: &[Estimate]) -> Value {
    curve(points.iter().copied().map(Some))
}

impl Results {
    /// Everything, under the keys of results.json; what was not asked for is absent.
    pub fn tree(&self) -> Value {
        let oscillator = &self.scene.oscillator;
        let mut all = Map::new();
        let mut put = |key: &str, it: Option<Value>| all.extend(it.map(|it| (key.to_owned(), it)));
        put("scene", Some(self.scene.resolved()));
        let mut physics = json!({
                "temperature": oscillator.viscous_temperature(),
                "noise": oscillator.noise(),
                "contact": oscillator.contact().name(),
                "damping": oscillator.damping().name(),
                "zeta": oscillator.zeta(),
                "h": oscillator.h(),
                "loss_point": oscillator.contact().loss_point(),
        });
        if let Some(wall) = oscillator.contact().back_wall() {
            physics["back_wall"] = json!(wall);
        }
        put("oscillator", Some(physics));
        let law = self.stationary.as_ref();
        put("stationary", law.map(|it| numbers(&mut it.iter()).into()));
        let losses = self.crossings.as_ref();
        put("crossings", losses.map(|it| self.crossing_tree(it, None)));
        put("first_loss", self.first_loss.as_ref().map(first_loss));
        let asked = self.scene.outputs.first_passage;
        let passage = self.first_passage.as_ref().zip(asked).map(|(it, asked)| {
            let mut tree = first_loss(it);
            tree["level"] = json!(asked.level);
            tree["side"] = json!(asked.side.name());
            tree
        });
        put("first_passage", passage);
        put("transient", self.transient.as_ref().map(transient));
        let reach = self.reach.as_ref().zip(self.scene.outputs.reach);
        let reach = reach.map(|(it, asked)| {
            json!({ "quantity": asked.quantity.name(), "fraction": asked.fraction, "t": it.t, "method": it.method })
        });
        put("reach", reach);
        put("periodic", self.periodic.as_ref().map(periodic));
        put("response", self.response.as_ref().map(response));
        let steady = |it: &crate::fokker_planck::Steady| {
            let named = Moments::kept(std::slice::from_ref(&it.moments));
            let named = named.map(|moment| (moment.name(), it.moments.get(moment)));
            let mut tree: Value = numbers(&mut { named }).into();
            tree["l1_error"] = json!(it.l1_error);
            tree["residual"] = json!(it.residual);
            tree["method"] = json!(it.method);
            tree
        };
        put("steady", self.steady.as_ref().map(steady));
        let rates = self.decay_rates.as_ref();
        put("decay_rates", rates.map(|it| json!(it.rates)));
        put("continuous_from", rates.map(|it| json!(it.continuous_from)));
        put("spectrum", self.spectrum.as_ref().map(spectrum));
        let sampled = Some(self.sampled_tree()).filter(|it| !it.is_empty());
        put("monte_carlo", sampled.map(Value::from));
        put("agreement", self.agreement.map(|it| json!(it)));
        put("rig", self.scene.rig().map(|rig| self.rig_tree(&rig)));
        let stages = self.run.stages.iter();
        let stages = stages.map(|(name, time)| json!({ "name": name, "wall_seconds": time }));
        let warnings = self.run.warnings.iter().map(|it| &it.text);
        put(
            "run",
            Some(json!({
                "wall_seconds": self.run.wall_seconds,
                "stages": stages.collect::<Vec<_>>(),
                "peak_memory_bytes": self.run.peak_memory_bytes,
                "threads": self.run.threads,
                "version": env!("CARGO_PKG_VERSION"),
                "warnings": warnings.collect::<Vec<_>>(),
            })),
        );
        all.into()
    }

    /// results.json: [`Results::tree`] as text, every list and every flat object on a line of its own.
    pub fn json(&self) -> String {
        let mut text = lines(&self.tree(), "");
        text.push('\n');
        text
    }

    fn sampled_tree(&self) -> Map<String, Value> {
        let settings = self.scene.monte_carlo.as_ref();
        let (paths, seed) = (settings.map(|it| it.paths), settings.map(|it| it.seed));
        let mut all = Map::new();
        if let Some(it) = &self.monte_carlo {
            let mut transient = Value::from(over("t", &it.times, &it.moments));
            // Names of the density on the mesh that paths have no number for.
            for name in [
                "mass",
                "lowest_density",
                "negative_mass",
                "relative_entropy",
            ] {
                transient[name] = curve(it.times.iter().map(|_| None));
            }
            transient["method"] = json!({
                "name": it.scheme.name(),
                "paths": it.paths,
                "seed": seed,
                "step": it.step,
                "steps": it.steps,
                "path_steps": it.path_steps,
            });
            all.insert("transient".into(), transient);
        }
        if let (Some(it), Some(law)) = (&self.records, self.sampled_stationary()) {
            let mut stationary = Value::from(numbers(&mut law.iter()));
            let [q, force, energy] = it.effective_samples;
            stationary["method"] = json!({
                "name": it.scheme.name(),
                "records": it.records,
                "seed": seed,
                "duration": it.duration,
                "step": it.step,
                "steps": it.path_steps / it.records.max(1),
                "path_steps": it.path_steps,
                "batches": it.batches,
                "batch_length": it.batch_length,
                "effective_samples": { "mean_q": q, "mean_force": force, "mean_energy": energy },
                "control_variates": self.controlled(),
            });
            all.insert("stationary".into(), stationary);
        }
        if let Some(it) = &self.first_loss_paths {
            all.insert("first_loss".into(), sampled_first_loss(it, paths));
        }
        if let Some(it) = &self.first_passage_paths {
            all.insert("first_passage".into(), sampled_first_loss(it, paths));
        }
        if let Some((seen, numbers)) = self.sampled_crossings() {
            all.insert("crossings".into(), self.crossing_tree(&numbers, Some(seen)));
        }
        all
    }

    fn crossing_tree(&self, it: &Numbers, seen: Option<&Crossings>) -> Value {
        let mut all = Map::new();
        all.insert("window".into(), json!(self.scene.outputs.crossings));
        all.append(&mut numbers(&mut it.iter()));
        let flights = match (seen, self.sampled_flights(), &self.flights) {
            (Some(_), Some(it), _) => Some((centres(it).collect(), &it.density)),
            (None, _, Some(it)) => Some((it.times.clone(), &it.density)),
            _ => None,
        };
        let flights = flights.filter(|(times, _): &(Vec<f64>, _)| !times.is_empty());
        let density = flights.as_ref().map(|(_, density)| full_curve(density));
        all.insert("flight_time".into(), json!(flights.map(|it| it.0)));
        all.insert("flight_density".into(), json!(density));
        let impact = match (seen, &self.impacts) {
            (Some(it), _) if it.mean_flight.value.is_finite() => {
                let at = centres(&it.impact_speed).collect::<Vec<f64>>();
                Some(json!({ "speed": at, "speed_density": full_curve(&it.impact_speed.density) }))
            }
            (None, Some(it)) => Some(json!({
                "speed": it.speeds,
                "speed_density": full_curve(&it.speed_density),
                "peak_force": it.forces,
                "peak_force_density": full_curve(&it.force_density),
            })),
            _ => None,
        };
        all.insert("impact".into(), json!(impact));
        if let Some(it) = seen {
            all.insert("losses_seen".into(), json!(it.losses));
            all.insert("bursts_seen".into(), json!(it.bursts));
            all.insert("time_seen".into(), json!(it.time));
        }
        all.into()
    }

    fn rig_tree(&self, rig: &Rig) -> Value {
        let object = |all: Vec<(&'static str, Estimate)>| {
            numbers(&mut all.into_iter().map(|(name, number)| (name, Some(number))))
        };
        let mut all = object(self.physical(rig));
        if self.records.is_some() {
            let sampled = object(self.physical_sampled(rig));
            all.insert("monte_carlo".into(), sampled.into());
        }
        all.into()
    }
}

/// Moments as curves over an axis.
fn over(name: &str, axis: &[f64], all: &[Moments]) -> Map<String, Value> {
    let mut tree = Map::new();
    tree.insert(name.into(), json!(axis));
    for it in Moments::kept(all) {
        tree.insert(it.name().into(), curve(all.iter().map(|at| at.get(it))));
    }
    tree
}

fn transient(it: &Transient) -> Value {
    let mut all = over("t", &it.times, &it.moments);
    let entropy = curve(it.relative_entropy.iter().copied());
    for (name, points) in [
        ("mass", full_curve(&it.mass)),
        ("lowest_density", full_curve(&it.lowest_density)),
        ("negative_mass", full_curve(&it.negative_mass)),
        ("relative_entropy", entropy),
        ("l1_distance", curve(it.distance.iter().copied())),
        ("method", json!(it.method)),
    ] {
        all.insert(name.into(), points);
    }
    all.into()
}

fn periodic(it: &Periodic) -> Value {
    let mut all = over("phase", &it.phase, &it.moments);
    let harmonics =
        json!({ "mean_q": it.mean_q, "mean_v": it.mean_v, "mean_force": it.mean_force });
    let laws = it.metastable.as_ref();
    let laws = laws.map(|it| it.each_ref().map(metastable));
    for (name, value) in [
        ("harmonics", harmonics),
        (
            "contact_loss_probability_mean",
            json!(it.contact_loss_probability),
        ),
        ("multipliers", json!(it.multipliers)),
        ("metastable", json!(laws)),
        ("residual", json!(it.residual)),
        ("method", json!(it.method)),
    ] {
        all.insert(name.into(), value);
    }
    all.into()
}

fn metastable(it: &MetastableLaw) -> Value {
    json!({
        "probability": it.probability,
        "mean_q": it.displacement,
        "harmonics": {"mean_q": it.mean_q, "mean_force": it.mean_force},
        "contact_loss_probability": it.contact_loss_probability,
    })
}

fn sweep(it: &Sweep) -> Value {
    json!({
        "mean_q_1": full_curve(&it.mean_q_1),
        "mean_force_1": full_curve(&it.mean_force_1),
        "contact_loss_probability": it.contact_loss_probability.as_deref().map(full_curve),
    })
}

fn response(it: &Response) -> Value {
    let mut all = json!({
        "frequency": it.frequency,
        "mean_q_1": full_curve(&it.mean_q_1),
        "mean_q_2": full_curve(&it.mean_q_2),
        "mean_force_1": full_curve(&it.mean_force_1),
        "multiplier": full_curve(&it.multiplier),
    });
    let lost = it.contact_loss_probability.as_deref().map(full_curve);
    all["contact_loss_probability"] = json!(lost);
    for (k, name) in ["sweep_up", "sweep_down"].into_iter().enumerate() {
        all[name] = json!(it.sweeps.as_ref().map(|it| sweep(&it[k])));
    }
    all
}

fn first_loss(it: &FirstLoss) -> Value {
    json!({
        "t": it.times,
        "survival": full_curve(&it.survival),
        "lost": full_curve(&it.lost),
        "density": full_curve(&it.density),
        "mean_time": it.mean_time,
        "rate": it.rate,
        "rate_over_rice": it.rate_over_rice,
        "method": it.method,
    })
}

fn sampled_first_loss(it: &FirstLossResult, paths: Option<u64>) -> Value {
    json!({
        "t": it.times,
        "survival": full_curve(&it.survival),
        "density": full_curve(&it.density),
        "mean_time": it.mean_time_of_all(),
        "rate": null,
        "mean_time_up_to_last": it.mean_time,
        "method": {
            "name": it.scheme.name(),
            "paths": paths,
            "step": it.step,
            "path_steps": it.path_steps,
        },
    })
}

fn spectrum(it: &SpectrumNumbers) -> Value {
    let SpectrumNumbers {
        solved, sampled, ..
    } = it;
    let peaks = it.peaks.iter().map(|peak| {
        json!({
            "omega": peak.omega,
            "density": peak.density,
            "half_power_width": peak.width,
        })
    });
    let mut all = json!({
        "quantity": solved.quantity.name(),
        "omega": solved.omega,
        "fokker_planck": full_curve(&solved.density),
    });
    let mut method = json!({
        "name": "resolvent in Hermite functions and spectral elements",
        "functions": solved.functions,
        "solves": solved.solves,
        "dimension": solved.dimension,
    });
    if let Some(it) = sampled {
        all["monte_carlo"] = full_curve(&it.density);
        all["monte_carlo_expectation"] = json!(it.expectation);
        method["averages"] = json!(it.averages);
        method["spacing"] = json!(it.spacing);
        method["window"] = json!("hann");
    }
    all["linear"] = json!(it.linear);
    all["peaks"] = json!(peaks.collect::<Vec<_>>());
    all["harmonic_ratio"] = json!(it.harmonic_ratio);
    all["method"] = method;
    all
}

/// Text of a value: an object with nothing but plain values in it on one line, as every list.
fn lines(it: &Value, margin: &str) -> String {
    let plain = |it: &Value| !it.is_object() && !it.is_array();
    match it {
        Value::Object(pairs) if !pairs.values().all(plain) => {
            let inner = format!("{margin}  ");
            let line = |(key, it): (&String, &Value)| {
                format!("{inner}{}: {}", json!(key), lines(it, &inner))
            };
            let all: Vec<String> = pairs.iter().map(line).collect();
            format!("{{\n{}\n{margin}}}", all.join(",\n"))
        }
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Origin;

    #[test]
    fn what_is_written_reads_back_to_the_last_bit_and_what_does_not_exist_is_null() {
        let nan = Estimate::new(f64::NAN, 0.0, Origin::Space);
        let tree = json!({
            "zeta": 0.1,
            "a \"b\"\n": "line\u{1}\\ µ",
            "list": [1e300, -2.5e-310, f64::INFINITY, 0.1 + 0.2],
            "none": nan,
            "some": Estimate::new(0.3, 1e-9, Origin::Space),
            "empty": {},
            "nested": { "deep": { "x": [1, 2] } },
        });
        let text = lines(&tree, "");
        let back: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(back, tree, "{text}");
        assert_eq!(back["list"][1].as_f64(), Some(-2.5e-310));
        assert!(back["list"][2].is_null() && back["none"].is_null());
        assert_eq!(back["some"], json!({ "value": 0.3, "error": 1e-9 }));
        let keys: Vec<&String> = back.as_object().unwrap().keys().collect();
        assert_eq!(keys[..2], ["zeta", "a \"b\"\n"]);
    }
}
