//! Methods and how fine they are run.

use super::case::Case;
use std::fmt;
use vibroimpact::fokker_planck::flow_map::Splitting;
use vibroimpact::fokker_planck::{Drift, TimeScheme};
use vibroimpact::monte_carlo::Scheme;

/// A scheme in space with one in time, or one of paths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    Volumes { drift: Drift, time: TimeScheme },
    FlowMap { splitting: Splitting },
    Paths(Scheme),
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self {
            Self::Volumes {
                drift: Drift::Upwind,
                time,
            } => format!("upwind, {}", time.name()),
            Self::Volumes { drift, time } => format!("order {}, {}", drift.order(), time.name()),
            Self::FlowMap { splitting } => {
                let splitting = match splitting {
                    Splitting::FourTwo => "(4,2)",
                    Splitting::SixTwo => "(6,2)",
                    Splitting::EvenFive => "even, 5",
                };
                format!("flow map 8, {splitting}")
            }
            Self::Paths(scheme) => format!("paths, {scheme}"),
        };
        f.pad(&name)
    }
}

/// How fine a method is run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Cells over those of the automatic mesh, in either direction.
    pub finer: f64,
    /// L1 error aimed at by the steps; the domain-truncation error is a twentieth of it.
    pub tolerance: f64,
    pub paths: u64,
}

impl Method {
    /// The methods that make sense for a case, coarse and simple ones first.
    pub fn all(case: &Case) -> Vec<Self> {
        let stiff = case.is_stiff();
        let volumes = |drift, time| Self::Volumes { drift, time };
        let mut all = vec![volumes(Drift::Upwind, TimeScheme::BackwardEuler)];
        for drift in [Drift::Order2, Drift::Order4, Drift::Order6, Drift::Order8] {
            all.push(volumes(drift, TimeScheme::Explicit));
            if stiff || drift == Drift::Order8 {
                all.push(volumes(drift, TimeScheme::Imex));
                all.push(volumes(drift, TimeScheme::Implicit));
            }
        }
        for splitting in [Splitting::EvenFive, Splitting::FourTwo] {
            all.push(Self::FlowMap { splitting });
        }
        let schemes = [
            Scheme::CentralDifference,
            Scheme::Baoab,
            Scheme::Splitting42,
            Scheme::Splitting62,
        ];
        all.extend(schemes.map(Self::Paths));
        if stiff {
            all.push(Self::Paths(Scheme::ExponentialHeun));
        }
        all
    }

    /// Whether both are the same in space, so that neither may judge the other.
    pub(super) fn is_same_family(self, other: Self) -> bool {
        match (self, other) {
            (Self::Volumes { drift: a, .. }, Self::Volumes { drift: b, .. }) => a == b,
            (Self::FlowMap { .. }, Self::FlowMap { .. }) => true,
            _ => false,
        }
    }

    /// Its kind.
    pub fn family(self) -> &'static str {
        match self {
            Self::Volumes {
                drift: Drift::Upwind,
                ..
            } => "upwind",
            Self::Volumes { time, .. } => match time {
                TimeScheme::Explicit => "finite volumes, explicit",
                TimeScheme::Imex => "finite volumes, IMEX",
                _ => "finite volumes, implicit",
            },
            Self::FlowMap { .. } => "flow map",
            Self::Paths(_) => "Monte Carlo paths",
        }
    }

    pub fn samples(self) -> bool {
        matches!(self, Self::Paths(_))
    }

    /// Its levels, coarse to fine.
    pub fn levels(self) -> Vec<Level> {
        let by_decades = |at_1e3: f64, order: f64, decades: &[f64]| -> Vec<Level> {
            decades
                .iter()
                .map(|decade| Level {
                    // A decade of error costs a factor 10^(1/order) in cells.
                    finer: at_1e3 * 10f64.powf((decade - 3.0) / order),
                    tolerance: 10f64.powf(-decade),
                    paths: 0,
                })
                .collect()
        };
        match self {
            // First order never gets far: cells doubled.
            Self::Volumes {
                drift: Drift::Upwind,
                ..
            } => [1.0, 2.0, 4.0, 8.0]
                .map(|finer| Level {
                    finer,
                    tolerance: 1e-3,
                    paths: 0,
                })
                .to_vec(),
            // Cells for an error of 1e-3: 5 a deviation at order 8 (measured), more the lower the order.
            Self::Volumes { drift, .. } => match drift {
                Drift::Order2 => by_decades(5.0, 2.0, &[1.0, 1.5, 2.0, 2.5, 3.0]),
                Drift::Order4 => by_decades(2.0, 4.0, &[1.5, 2.0, 3.0, 4.0, 5.0]),
                Drift::Order6 => by_decades(1.3, 6.0, &[1.5, 2.0, 3.0, 4.0, 5.0, 6.0]),
                _ => by_decades(1.0, 8.0, &[1.5, 2.0, 3.0, 4.0, 5.0, 6.0]),
            },
            Self::FlowMap { .. } => by_decades(0.9, 8.0, &[1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0]),
            Self::Paths(_) => [1_000, 10_000, 100_000, 1_000_000]
                .map(|paths| Level {
                    finer: 0.0,
                    tolerance: 0.0,
                    paths,
                })
                .to_vec(),
        }
    }
}
