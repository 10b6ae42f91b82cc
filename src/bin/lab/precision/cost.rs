//! Cost against work: wall time per unit of simulated time on n x n cells, set-up apart.

use super::case::Case;
use super::entry::Effort;
use std::time::Instant;
use vibroimpact::error::{Error, Result};
use vibroimpact::fokker_planck::budget::{self, Factors};
use vibroimpact::fokker_planck::flow_map::{self, FlowMap};
use vibroimpact::fokker_planck::{
    Density, Drift, Generator, Mesh, Settings, TimeScheme, transient,
};
use vibroimpact::initial::Initial;

/// What is timed; finite volumes, or the flow map.
pub const TIMED: [(&str, Option<(Drift, TimeScheme)>); 5] = [
    // One sparse LU, a solve a step of three cells.
    (
        "upwind, LU",
        Some((Drift::Upwind, TimeScheme::BackwardEuler)),
    ),
    (
        "order 8, implicit",
        Some((Drift::Order8, TimeScheme::Implicit)),
    ),
    ("order 8, imex", Some((Drift::Order8, TimeScheme::Imex))),
    (
        "order 8, explicit",
        Some((Drift::Order8, TimeScheme::Explicit)),
    ),
    ("flow map 8", None),
];

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cost {
    /// Its name in [`TIMED`].
    pub of: &'static str,
    pub threads: usize,
    /// Cells in either direction.
    pub n: usize,
    /// Seconds from nothing to the end of the first step.
    pub setup: f64,
    /// Seconds per unit of simulated time after that.
    pub per_unit: f64,
    /// Estimated bytes of all arrays.
    pub memory: u64,
}

/// Exponent of the cost in n over the last meshes of a series.
pub(super) fn exponent(series: &[(f64, f64)]) -> Option<f64> {
    // The last three: the asymptotic ones.
    let last = &series[series.len().saturating_sub(3)..];
    if last.len() < 2 {
        return None;
    }
    let n = last.len() as f64;
    let logs = || last.iter().map(|(x, y)| (x.ln(), y.ln()));
    let mx = logs().map(|l| l.0).sum::<f64>() / n;
    let my = logs().map(|l| l.1).sum::<f64>() / n;
    let xy: f64 = logs().map(|(x, y)| (x - mx) * (y - my)).sum();
    let xx: f64 = logs().map(|(x, _)| (x - mx).powi(2)).sum();
    Some(xy / xx)
}

/// A mesh is not begun if the one before took longer, in seconds.
const LONG: f64 = 3.0;

/// A start that 50 cells hold.
fn wide(case: &Case) -> Result<Case> {
    let deviation = 0.9 * case.oscillator.temperature().sqrt();
    Ok(Case {
        initial: Initial::gaussian([0.0; 2], [deviation; 2])?,
        ..case.clone()
    })
}

/// Costs on a case from a wide start, on one thread and on all; meshes that cannot be held or take too long
/// are left out.
pub fn costs(case: &Case, effort: Effort, watch: &dyn Fn(&Cost)) -> Result<Vec<Cost>> {
    let case = &wide(case)?;
    let sizes: &[usize] = match effort {
        Effort::Quick => &[50, 70],
        Effort::Full => &[50, 100, 200, 400, 800],
    };
    let mut all = Vec::new();
    let mut counts = vec![1, rayon::current_num_threads()];
    counts.dedup();
    for threads in counts {
        let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).build() else {
            continue;
        };
        for (of, scheme) in TIMED {
            for n in sizes {
                let clock = Instant::now();
                // A mesh that cannot hold the start is too coarse, one beyond the memory too fine.
                let Ok((setup, per_unit, memory)) = pool.install(|| cost(case, scheme, *n)) else {
                    continue;
                };
                let cost = Cost {
                    of,
                    threads,
                    n: *n,
                    setup,
                    per_unit,
                    memory,
                };
                watch(&cost);
                all.push(cost);
                if clock.elapsed().as_secs_f64() > LONG {
                    break;
                }
            }
        }
    }
    Ok(all)
}

fn seconds(work: impl FnOnce() -> Result<()>) -> Result<f64> {
    let clock = Instant::now();
    work()?;
    Ok(clock.elapsed().as_secs_f64())
}

/// Set-up, seconds per unit of time, bytes.
fn cost(case: &Case, scheme: Option<(Drift, TimeScheme)>, n: usize) -> Result<(f64, f64, u64)> {
    let Some((drift, time)) = scheme else {
        return flow_map(case, n);
    };
    let oscillator = &case.oscillator;
    let memory = budget::memory([n, n], drift, Factors::of(time));
    // Half of what a small machine has.
    if memory > 4_000_000_000 {
        return Err(Error::invalid("method.cells", n, "a matrix below 4 GB"));
    }
    let clock = Instant::now();
    let mesh = square(case, drift, n)?;
    let generator = Generator::new(oscillator, &mesh, drift)?;
    let mut integration =
        transient::time_integration(oscillator, &generator, time, 1e-5, None, 20.0);
    let mut density = Density::start(&generator, &case.initial)?;
    // Some steps each, and not many where they are short: explicit steps shrink as 1/n.
    let unit = match time {
        TimeScheme::BackwardEuler => 50.0 / n as f64,
        TimeScheme::Implicit => 1.0,
        _ => (1e4 / (n * n) as f64).clamp(0.05, 1.0),
    };
    let all = &mut |_: f64, _: &Density| Ok(true);
    integration.advance(&mut density, unit, all)?;
    let first = clock.elapsed().as_secs_f64();
    let again = seconds(|| integration.advance(&mut density, unit, all).map(|_| ()))?;
    Ok(((first - again).max(0.0), again / unit, memory))
}

fn flow_map(case: &Case, n: usize) -> Result<(f64, f64, u64)> {
    let oscillator = &case.oscillator;
    let clock = Instant::now();
    let mesh = square(case, Drift::Order8, n)?;
    let settings = flow_map::Settings::to(1e-5, oscillator)?;
    let mut map = FlowMap::new(oscillator, &mesh, settings)?;
    let mut density = map.start(&case.initial)?;
    let unit = 10.0;
    map.advance(&mut density, unit)?;
    let first = clock.elapsed().as_secs_f64();
    let again = seconds(|| map.advance(&mut density, unit))?;
    let memory = budget::flow_map_memory(mesh.cells());
    Ok(((first - again).max(0.0), again / unit, memory))
}

/// n x n cells in the truncated domain of the tolerance 1e-3.
fn square(case: &Case, drift: Drift, n: usize) -> Result<Mesh> {
    let settings = Settings {
        cells: Some([n, n]),
        ..Settings::default()
    };
    case.mesh(drift, &settings, 1.0)
}
