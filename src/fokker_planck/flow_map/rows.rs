//! Rows of the mesh: their friction, and the cells that hold unknowns.

use crate::contact::ContactLaw;
use crate::error::Result;
use crate::fokker_planck::mesh::Mesh;
use crate::oscillator::Oscillator;
use std::ops::Range;

/// Rows of equal friction, with their rate; none where it is the same everywhere.
pub(super) fn frictions(oscillator: &Oscillator, mesh: &Mesh) -> Result<Vec<(Range<usize>, f64)>> {
    if oscillator.is_viscous() {
        return Ok(Vec::new());
    }
    oscillator
        .damping()
        .depends_on_displacement("the flow map")?;
    let mut all: Vec<(Range<usize>, f64)> = Vec::new();
    for (i, q) in mesh.q.centres().iter().enumerate() {
        let rate = oscillator.friction(*q);
        match all.last_mut() {
            Some((rows, last)) if *last == rate => rows.end = i + 1,
            _ => all.push((i..i + 1, rate)),
        }
    }
    Ok(all)
}

/// Per q row the cells on orbits that stay within the outermost centres; at least the two slowest.
pub(super) fn active(contact: &ContactLaw, mesh: &Mesh, stationary: bool) -> Vec<Range<usize>> {
    let (q, v) = (mesh.q.centres(), mesh.v.centres());
    let [nq, nv] = mesh.cells();
    if !stationary {
        return vec![0..nv; nq];
    }
    let fastest = v[0].abs().min(v[nv - 1].abs());
    let level = contact
        .potential(q[0])
        .min(contact.potential(q[nq - 1]))
        .min(0.5 * fastest * fastest);
    q.iter()
        .map(|q| {
            let reach = (2.0 * (level - contact.potential(*q))).max(0.0).sqrt();
            let first = v.partition_point(|v| *v < -reach);
            let last = v.partition_point(|v| *v <= reach);
            let middle = v.partition_point(|v| *v < 0.0).clamp(1, nv - 1);
            first.min(middle - 1)..last.max(middle + 1)
        })
        .collect()
}
