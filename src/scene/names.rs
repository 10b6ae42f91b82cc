//! Names of choices in scenes.

use crate::fokker_planck::{Drift, TimeScheme, TransientMethod};
use crate::monte_carlo::Scheme;
use serde_json::{Value, json};

/// Names of [`Scheme`] in scenes.
pub(super) const SCHEMES: &[(&str, Scheme)] = &[
    ("auto", Scheme::Auto),
    ("central_difference", Scheme::CentralDifference),
    ("baoab", Scheme::Baoab),
    ("splitting_4_2", Scheme::Splitting42),
    ("splitting_6_2", Scheme::Splitting62),
    ("euler_maruyama", Scheme::EulerMaruyama),
    ("exponential_heun", Scheme::ExponentialHeun),
];

/// Names of [`TransientMethod`] in scenes.
pub(super) const TRANSIENT: &[(&str, TransientMethod)] = &[
    ("finite_volume", TransientMethod::FiniteVolume),
    ("flow_map", TransientMethod::FlowMap),
];

/// Names of [`TimeScheme`] in scenes.
pub(super) const TIME: &[(&str, TimeScheme)] = &[
    ("backward_euler", TimeScheme::BackwardEuler),
    ("implicit", TimeScheme::Implicit),
    ("imex", TimeScheme::Imex),
    ("explicit", TimeScheme::Explicit),
];

/// Names of [`Drift`] in scenes: a word, or the order as a number.
pub(super) const DRIFT: &[(&str, Drift)] = &[
    ("upwind", Drift::Upwind),
    ("2", Drift::Order2),
    ("4", Drift::Order4),
    ("6", Drift::Order6),
    ("8", Drift::Order8),
];

pub(super) fn name_of<T: PartialEq>(names: &[(&'static str, T)], value: Option<T>) -> Value {
    let name = value.and_then(|value| names.iter().find(|(_, it)| *it == value));
    let name = name.map_or("auto", |(name, _)| *name);
    name.parse::<u64>()
        .map_or(json!(name), |order| json!(order))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_know_every_scheme_by_the_name_it_gives_itself() {
        for (name, it) in SCHEMES {
            assert_eq!(*name, it.name());
        }
        for (name, it) in TIME {
            assert_eq!(*name, it.name());
        }
        for it in Drift::ALL {
            let name = match it {
                Drift::Upwind => "upwind".to_string(),
                _ => it.order().to_string(),
            };
            assert!(DRIFT.contains(&(name.as_str(), it)), "{it:?}");
        }
    }
}
