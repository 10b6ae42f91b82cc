//! Seconds and bytes: what a piece of work takes, and whether a scene allows it.

use super::flux::Drift;
use super::settings::TimeScheme;
pub use crate::budget::Cost;
pub(crate) use crate::budget::{Limits, timing};
use crate::error::{Error, Result};
use crate::format::bytes;

/// Seconds of one core on all threads.
pub(super) fn on_threads([nq, nv]: [usize; 2], seconds: f64) -> f64 {
    if nq * nv < timing::SHARED {
        seconds
    } else {
        on_all_threads(seconds)
    }
}

/// The same where even small meshes are shared.
pub(super) fn on_all_threads(seconds: f64) -> f64 {
    seconds / (rayon::current_num_threads() as f64).powf(timing::GAIN)
}

/// What a run factors of the generator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Factors {
    /// Nothing.
    None,
    /// Its part along v, column by column: friction and diffusion.
    Columns,
    /// A real matrix: steady state, backward Euler.
    Real,
    /// A real and a complex one: Radau IIA.
    Both,
}

impl Factors {
    /// Those of a scheme in time.
    pub fn of(time: TimeScheme) -> Self {
        match time {
            TimeScheme::BackwardEuler => Self::Real,
            TimeScheme::Implicit => Self::Both,
            TimeScheme::Imex => Self::Columns,
            TimeScheme::Explicit => Self::None,
        }
    }
}

/// What an LU takes over that of a five-point stencil.
pub(super) fn widening(drift: Drift) -> f64 {
    let wide = drift != Drift::Upwind;
    if wide { timing::WIDE } else { 1.0 }
}

/// Seconds of a factorisation, which nothing can stop half way.
pub(super) fn factoring([nq, nv]: [usize; 2], drift: Drift, factors: Factors) -> f64 {
    let n = nq as f64 * nv as f64;
    let wide = widening(drift);
    match factors {
        Factors::None | Factors::Columns => 0.0,
        Factors::Real => n * timing::LU * wide,
        // A complex one; of the five-point operator where the mesh is large.
        Factors::Both if n > DIRECT as f64 => n * timing::LU * timing::WIDE,
        Factors::Both => n * timing::LU * wide * wide,
    }
}

/// Unknowns above which GMRES with the LU of the five-point operator beats the LU of the wide stencil.
/// Order 8, T = 0.63, seconds of a factorisation and of a step (`solve` of benches/summary.rs; a run of a hundred steps
/// factors about ten times):
///
/// | unknowns | LU | GMRES |
/// |---|---|---|
/// | 2091 | 0.08, 0.0015 to 0.003 | 0.01, 0.003 to 0.010 (7 to 23 iterations) |
/// | 4617 | 0.28, 0.007 to 0.011 | 0.03, 0.005 to 0.024 (7 to 24) |
/// | 9471 | 0.75, 0.017 | 0.08, 0.012 to 0.057 (7 to 30) |
pub(super) const DIRECT: usize = 2000;

/// Bytes of the arrays of a run: two dozen per cell without a matrix; the stages of an additive step and the banded factors
/// for four lengths of it some 40 more (measured at 1e5 and 1.6e6 cells); the sparse LU of a five-point
/// stencil holds about 120 entries per unknown, of a wide one about 600 (measured at 1e5 unknowns), each with
/// its place. Radau's steps on large meshes hold that of the five-point stencil and the vectors of GMRES.
pub fn memory(cells: [usize; 2], drift: Drift, factors: Factors) -> u64 {
    const FIVE: u64 = 120;
    const WIDE: u64 = 600;
    const VECTORS: u64 = 42 * 24;
    const COLUMNS: u64 = 40 * 8;
    let (real, complex) = (8 + 8, 16 + 8);
    let count = (cells[0] as u64).saturating_mul(cells[1] as u64);
    let entries = if drift == Drift::Upwind { FIVE } else { WIDE };
    let per_cell = match factors {
        Factors::None => 0,
        Factors::Columns => COLUMNS,
        Factors::Real => entries * real,
        Factors::Both if count > DIRECT as u64 => FIVE * (real + complex) + VECTORS,
        Factors::Both => entries * (real + complex),
    };
    count.saturating_mul(24 * 8 + per_cell)
}

/// Bytes of the flow map: a dozen arrays and some five maps of 132 bytes per cell; along v, two dense
/// matrices while one is built and some five that are kept.
pub fn flow_map_memory([nq, nv]: [usize; 2]) -> u64 {
    let (nq, nv) = (nq as u64, nv as u64);
    let per_cell = 12 * 8 + 5 * 132;
    nv.saturating_mul(nq.saturating_mul(per_cell).saturating_add(7 * 8 * nv))
}

/// Refuses cells that need more bytes than allowed: by their key where the scene gave them, else by the
/// limit.
pub(super) fn check_memory(
    needed: u64,
    cells: [usize; 2],
    given: bool,
    max_memory: u64,
) -> Result<()> {
    if needed <= max_memory {
        return Ok(());
    }
    let (limit, needed) = (bytes(max_memory), bytes(needed));
    if given {
        let accepted =
            format!("cells that fit accuracy.max_memory = {limit}; these need about {needed}");
        let cells = format!("{cells:?}");
        return Err(Error::invalid("method.cells", cells, accepted));
    }
    let what = format!("a mesh of {cells:?} cells would need about {needed}");
    Err(Error::limit("accuracy.max_memory", limit, what))
}
