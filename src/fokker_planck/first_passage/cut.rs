//! The velocities at which a motion is just lost within a time, and integrals that begin there.

use super::mesh::{AbsorbingMesh, Stencil};
use super::region::Region;
use crate::gaussian::lower;
use crate::quadrature::gauss;
use std::sync::LazyLock;

/// Eight points for the velocities reached in a step.
static GAUSS8: LazyLock<[(f64, f64); 8]> = LazyLock::new(gauss);

/// Points and weights for an integral from a cut to an edge of a function smooth on the scale `scale`, but
/// for a square root at the cut.
pub(super) fn from_cut(cut: f64, [start, edge]: [f64; 2], scale: f64) -> Vec<(f64, f64)> {
    // Eight points over 2.5 deviations integrate a Gaussian to 1e-9.
    let (width, rule) = (2.5 * scale, *GAUSS8);
    let mut points = Vec::new();
    let mut low = cut.clamp(start, edge);
    if cut > start {
        let root = width.min(edge - low).sqrt();
        for (x, w) in rule {
            let r = 0.5 * root * (x + 1.0);
            points.push((low + r * r, w * 0.5 * root * 2.0 * r));
        }
        low += root * root;
    }
    let panels = ((edge - low) / width - 1e-9).ceil().max(0.0) as usize;
    let width = (edge - low) / panels.max(1) as f64;
    for k in 0..panels {
        let centre = low + (k as f64 + 0.5) * width;
        points.extend(rule.map(|(x, w)| (centre + 0.5 * width * x, 0.5 * width * w)));
    }
    points
}

/// Points and weights for an integral between two cuts, the upper one of which may be infinite.
pub(super) fn between(
    [low, high]: [f64; 2],
    [start, edge]: [f64; 2],
    scale: f64,
) -> Vec<(f64, f64)> {
    if high >= edge {
        return from_cut(low, [start, edge], scale);
    }
    if low >= high {
        return Vec::new();
    }
    // Both ends may be roots.
    let middle = 0.5 * (low.max(start) + high);
    let mut points = from_cut(low, [start.min(middle), middle], scale);
    let mut upper = from_cut(-high, [-edge, -middle], scale);
    upper.reverse();
    points.extend(upper.into_iter().map(|(v, w)| (-v, w)));
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points
}

/// Where the motions over a step from points at the i-th displacement of a mesh end.
pub(super) fn stencils(
    points: &[(f64, f64)],
    (region, mesh): (&Region<'_>, &AbsorbingMesh),
    i: usize,
    step: f64,
) -> Vec<Stencil> {
    let starts: Vec<[f64; 2]> = points.iter().map(|(v, _)| [mesh.q(i), *v]).collect();
    let ends = region.ends(&starts, step).into_iter();
    ends.map(|end| mesh.stencil(end)).collect()
}

/// The velocities at each displacement of the mesh below and above which a motion is lost within a time.
pub(super) fn critical(region: &Region<'_>, mesh: &AbsorbingMesh, time: f64) -> Vec<[f64; 2]> {
    let nodes: Vec<f64> = (0..mesh.nodes[0]).map(|i| mesh.q(i)).collect();
    cuts(region, time, 2.0 * mesh.speed, &nodes)
}

/// The velocities below and above which an undamped motion from each displacement is lost within a time.
pub(super) fn cuts(region: &Region<'_>, time: f64, fastest: f64, q: &[f64]) -> Vec<[f64; 2]> {
    let low = Cut::new(region, time, fastest).of(q);
    let Some(high) = region.barrier.high else {
        return low.into_iter().map(|low| [low, f64::INFINITY]).collect();
    };
    let mirrored = region.mirrored(high);
    let back: Vec<f64> = q.iter().map(|q| -q).collect();
    let top = Cut::new(&mirrored, time, fastest).of(&back);
    low.into_iter()
        .zip(top)
        .map(|(low, top)| [low, -top])
        .collect()
}

/// What a kick to velocities about `centre` loses in the first half of the motion after it and in the second, and what it leaves:
/// by the critical velocities over half the motion and over all of it.
pub(super) fn parts(
    [[half, half_top], [whole, whole_top]]: [[f64; 2]; 2],
    centre: f64,
    spread: f64,
) -> ([f64; 2], f64) {
    // Without noise it is one side or the other.
    let tail = |x: f64, at: bool| {
        if spread > 0.0 {
            lower(x / spread)
        } else {
            f64::from(u8::from(x > 0.0 || (at && x == 0.0)))
        }
    };
    let below = |cut: f64| tail(cut - centre, false);
    let above = |cut: f64| tail(centre - cut, true);
    // A difference of tails, on the side where they are small.
    let between = |low: f64, high: f64| {
        if low == high {
            0.0
        } else if low + high > 2.0 * centre {
            above(low) - above(high)
        } else {
            below(high) - below(low)
        }
    };
    let mut lost = [below(half), between(half, whole)];
    if whole_top < f64::INFINITY {
        lost[0] += above(half_top);
        lost[1] += between(whole_top, half_top);
    }
    (lost, above(whole) - above(whole_top))
}

/// What a motion is off where it ends, relative to the larger of 1 and q.
const ROUNDING: f64 = 1e-14;

/// The velocity below which an undamped motion is lost within a time.
struct Cut<'a> {
    region: &'a Region<'a>,
    loss: f64,
    time: f64,
    /// Speed beyond which nothing is asked.
    fastest: f64,
}

impl<'a> Cut<'a> {
    fn new(region: &'a Region<'a>, time: f64, fastest: f64) -> Self {
        Self {
            region,
            loss: region.barrier.low,
            time,
            fastest,
        }
    }

    /// At each of these displacements. A motion that meets the loss point at the end of the time with
    /// velocity -w began at the mirror image of where one from the loss point with velocity w ends; nearer
    /// to it the critical motion grazes on the way.
    fn of(&self, q: &[f64]) -> Vec<f64> {
        let region = self.region;
        let after = |speeds: &[f64]| {
            let starts: Vec<[f64; 2]> = speeds.iter().map(|w| [self.loss, *w]).collect();
            region.ends(&starts, self.time)
        };
        let grazed = after(&[0.0])[0][0];
        let far = q.iter().fold(grazed, |a, b| a.max(*b));
        // Straight motion at the least: the contact resists, but for the preload that hastens by a time.
        let top = (2.0 * (far - self.loss) / self.time + 2.0 * self.time).min(self.fastest);
        let (mut low, mut high) = (vec![0.0; q.len()], vec![top; q.len()]);
        let from = |speed: f64| after(&[speed])[0][0];
        let [mut below, mut above] = [0.0, top].map(|speed| {
            let end = from(speed);
            q.iter().map(|q| end - q).collect::<Vec<f64>>()
        });
        // Whether the lower end was moved last.
        let mut raised = vec![false; q.len()];
        // The Illinois variant of the false position (Dowell and Jarratt, BIT 11, 1971, 168), to rounding;
        // halving where it does not shrink the bracket.
        for round in 0..60 {
            let open: Vec<usize> = (0..q.len())
                .filter(|k| high[*k] - low[*k] > 1e-15 * top && q[*k] > grazed && above[*k] > 0.0)
                .collect();
            if open.is_empty() {
                break;
            }
            let middle: Vec<f64> = open
                .iter()
                .map(|&k| {
                    let part = below[k] / (below[k] - above[k]);
                    let halve = round % 4 == 3 || !(part > 0.0 && part < 1.0);
                    low[k] + (high[k] - low[k]) * if halve { 0.5 } else { part }
                })
                .collect();
            for ((k, middle), end) in open.into_iter().zip(&middle).zip(after(&middle)) {
                let gap = end[0] - q[k];
                if gap.abs() <= ROUNDING * q[k].abs().max(1.0) {
                    (low[k], high[k]) = (*middle, *middle);
                } else if gap < 0.0 {
                    (low[k], below[k]) = (*middle, gap);
                    above[k] *= if raised[k] { 0.5 } else { 1.0 };
                } else {
                    (high[k], above[k]) = (*middle, gap);
                    below[k] *= if raised[k] { 1.0 } else { 0.5 };
                }
                raised[k] = gap < 0.0;
            }
        }
        let ends = after(&high);
        let top_potential = region.potential(self.loss);
        q.iter()
            .zip(ends)
            .map(|(q, end)| {
                if *q <= grazed {
                    -(2.0 * (top_potential - region.potential(*q)).max(0.0)).sqrt()
                } else if end[0] < q - 1e-6 {
                    f64::NEG_INFINITY
                } else {
                    -end[1]
                }
            })
            .collect()
    }
}
