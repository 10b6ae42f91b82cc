//! The mesh in contact, or between two levels, and interpolation on it.

use super::region::Region;
use crate::error::{Error, Result};
use crate::fokker_planck::difference::lagrange;

/// Points of the Lagrange interpolation in each direction: order 6.
pub(super) const POINTS: usize = 6;

/// How fine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fineness {
    /// Nodes in q and in v.
    pub(crate) nodes: [usize; 2],
    /// Step.
    pub(crate) step: f64,
    /// Energy above the loss of contact, in T, at the edge of the mesh.
    pub(crate) level: f64,
}

/// Nodes in contact: q = q_loss + b (sqrt(1 + y^2) - 1), v = c sinh(eta), y and eta uniform; between two levels
/// q = middle - b cos(y). Beyond one level the kink of the force next to it is a node.
#[derive(Debug, Clone)]
pub(crate) struct AbsorbingMesh {
    loss: f64,
    pub(super) bend: f64,
    /// The middle between two levels.
    pub(super) middle: Option<f64>,
    grade: f64,
    /// Spacing of y and of eta.
    pub(super) spacing: [f64; 2],
    pub(super) nodes: [usize; 2],
    /// Highest speed.
    pub(crate) speed: f64,
}

/// b, and how far y goes up to a turning point.
pub(super) fn extent(region: &Region<'_>, right: f64) -> [f64; 2] {
    let low = region.barrier.low;
    if let Some(high) = region.barrier.high {
        return [0.5 * (high - low), std::f64::consts::PI];
    }
    // A fall from rest covers x = a s^2/2: near the wall b y is the speed at which it is hit, and as fast as noise makes it where
    // the force is weak or holds motions away.
    let pull = region.force(low).abs();
    let bend = pull.max(region.oscillator.temperature().sqrt());
    let far = (right - low) / bend + 1.0;
    [bend, (far * far - 1.0).sqrt()]
}

/// The speed beyond which cells along v grow with it: twice as fine at the turning points as at the speed at which contact is
/// lost.
pub(super) fn grade(rise: f64, temperature: f64) -> f64 {
    (2.0 * rise / 3.0).max(temperature).sqrt()
}

impl AbsorbingMesh {
    pub(super) fn new(region: &Region<'_>, fineness: &Fineness) -> Result<Self> {
        let (oscillator, loss) = (region.oscillator, region.barrier.low);
        let rise = region.rise();
        let top = rise + fineness.level * oscillator.temperature();
        let Some(right) = region.turning_point(top) else {
            return Err(Error::NoStationaryLaw {
                what: "the first passage".into(),
                contact: oscillator.contact().name().into(),
                why: "nothing brings the motion back".into(),
            });
        };
        let speed = (2.0 * top).sqrt();
        let [bend, reach] = extent(region, right);
        let middle = region.barrier.high.map(|high| 0.5 * (high + loss));
        let grade = grade(rise, oscillator.temperature());
        let end = (speed / grade).asinh();
        let [nq, nv] = fineness.nodes;
        let mut it = Self {
            loss,
            bend,
            middle,
            grade,
            spacing: [reach / (nq - 1) as f64, 2.0 * end / (nv - 1) as f64],
            nodes: fineness.nodes,
            speed,
        };
        let inside = region.kinks().filter(|x| *x > loss && *x < right);
        if let (None, Some(next)) = (middle, inside.reduce(f64::min)) {
            let y = it.scaled(next);
            it.spacing[0] = y / (y / it.spacing[0]).floor().max(1.0);
        }
        Ok(it)
    }

    /// y at q.
    fn scaled(&self, q: f64) -> f64 {
        if let Some(middle) = self.middle {
            return ((middle - q) / self.bend).clamp(-1.0, 1.0).acos();
        }
        let x = ((q - self.loss) / self.bend).max(0.0);
        (x * (x + 2.0)).sqrt()
    }

    pub(crate) fn q(&self, i: usize) -> f64 {
        self.place(i as f64 * self.spacing[0]).0
    }

    /// q at y, and its slope.
    pub(super) fn place(&self, y: f64) -> (f64, f64) {
        if let Some(middle) = self.middle {
            return (middle - self.bend * y.cos(), self.bend * y.sin());
        }
        let root = (1.0 + y * y).sqrt();
        (
            self.loss + self.bend * y * y / (root + 1.0),
            self.bend * y / root,
        )
    }

    pub(crate) fn v(&self, j: usize) -> f64 {
        let middle = 0.5 * (self.nodes[1] - 1) as f64;
        self.grade * ((j as f64 - middle) * self.spacing[1]).sinh()
    }

    /// The narrowest cell along v.
    pub(super) fn finest(&self) -> f64 {
        self.grade * self.spacing[1]
    }

    /// The stencil of a point: its first node in each direction, and weights; clamped to the mesh.
    pub(super) fn stencil(&self, [q, v]: [f64; 2]) -> Stencil {
        let y = self.scaled(q) / self.spacing[0];
        let middle = 0.5 * (self.nodes[1] - 1) as f64;
        let eta = (v / self.grade).asinh() / self.spacing[1] + middle;
        let mut it = Stencil::default();
        for (d, place) in [y, eta].into_iter().enumerate() {
            let n = self.nodes[d];
            let place = place.clamp(0.0, (n - 1) as f64);
            let first = (place.floor() as usize)
                .saturating_sub(POINTS / 2 - 1)
                .min(n - POINTS);
            it.first[d] = first as u32;
            lagrange(first as f64, place, &mut it.weights[d]);
        }
        it
    }
}

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stencil {
    first: [u32; 2],
    weights: [[f64; POINTS]; 2],
}

impl Stencil {
    #[inline(always)]
    pub(super) fn value(&self, field: &[f64], nv: usize) -> f64 {
        let start = self.first[0] as usize * nv + self.first[1] as usize;
        let mut parts = [0.0; POINTS];
        for (a, wa) in self.weights[0].iter().enumerate() {
            let row = &field[start + a * nv..start + a * nv + POINTS];
            for (part, x) in parts.iter_mut().zip(row) {
                *part += wa * x;
            }
        }
        for (part, wb) in parts.iter_mut().zip(&self.weights[1]) {
            *part *= wb;
        }
        ((parts[0] + parts[4]) + parts[2]) + ((parts[1] + parts[5]) + parts[3])
    }

    pub(super) fn add(&self, weight: f64, field: &mut [f64], nv: usize) {
        let start = self.first[0] as usize * nv + self.first[1] as usize;
        for (a, wa) in self.weights[0].iter().enumerate() {
            for (b, wb) in self.weights[1].iter().enumerate() {
                field[start + a * nv + b] += weight * wa * wb;
            }
        }
    }
}
