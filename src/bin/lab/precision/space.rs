//! Orders in space alone: what is left when the truncated domain and the steps err no more.

use super::case::Case;
use super::reference::Reference;
use super::solve::volumes_on;
use vibroimpact::error::Result;
use vibroimpact::fokker_planck::{Drift, Settings, TimeScheme};

/// Probability outside the domain: at 1e-10 it still leaves 1.5e-7 of L1 error.
const OUTSIDE: f64 = 1e-11;

/// Tolerance of the steps.
const STEPS: f64 = 1e-10;

/// The error of one scheme in space on two meshes.
#[derive(Debug, Clone, PartialEq)]
pub struct SpaceOrder {
    pub drift: Drift,
    /// Cells along q, margins included.
    pub cells: [usize; 2],
    pub l1: [f64; 2],
    /// Its order in the width of the cells.
    pub order: f64,
}

/// The orders of the central schemes on a case whose density is known in closed form and whose mesh is
/// uniform; none for others.
pub fn space_orders(case: &Case, reference: &Reference) -> Result<Vec<SpaceOrder>> {
    if !(case.is_closed_form() && case.oscillator.contact().is_confining()) {
        return Ok(Vec::new());
    }
    let run = |drift: Drift, inner: usize| -> Result<(usize, f64, f64)> {
        let cells = inner + 2 * drift.margin();
        let settings = Settings {
            neglected: Some(OUTSIDE),
            drift: Some(drift),
            cells: Some([cells; 2]),
            tolerance: STEPS,
            ..Settings::default()
        };
        let mesh = case.mesh(drift, &settings, 1.0)?;
        let width = mesh.q.slopes()[mesh.q.len() / 2];
        let answer = volumes_on(case, drift, TimeScheme::Explicit, &mesh, STEPS)?;
        Ok((cells, width, reference.l1(&answer).unwrap_or(f64::NAN)))
    };
    [
        (Drift::Order2, [112, 168]),
        (Drift::Order4, [80, 120]),
        (Drift::Order6, [64, 96]),
        (Drift::Order8, [60, 84]),
    ]
    .into_iter()
    .map(|(drift, inner)| {
        let (coarse, fine) = (run(drift, inner[0])?, run(drift, inner[1])?);
        Ok(SpaceOrder {
            drift,
            cells: [coarse.0, fine.0],
            l1: [coarse.2, fine.2],
            order: (coarse.2 / fine.2).ln() / (coarse.1 / fine.1).ln(),
        })
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::super::case::cases;
    use super::*;

    #[test]
    fn in_space_alone_the_schemes_have_orders_2_4_6_8_on_the_linear_case() {
        for mut case in cases().unwrap() {
            if case.name == "linear" {
                case.until *= 0.5;
                let orders = space_orders(&case, &Reference::of(&case).unwrap()).unwrap();
                assert_eq!(orders.len(), 4);
                for (it, most) in orders.iter().zip([3e-2, 6e-4, 4e-5, 4e-6]) {
                    println!("{it:?}");
                    assert!((it.order - it.drift.order() as f64).abs() < 0.5, "{it:?}");
                    assert!(it.l1[1] < most, "{it:?}");
                }
            }
        }
    }
}
