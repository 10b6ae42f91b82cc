//! A stationary law that was solved for, whatever carries it.

use super::on_mesh::{OnMesh, Row};
use crate::fokker_planck::hermite::{self, Kept};
use crate::moments::RawMoments;
use crate::quadrature::gauss;

/// The stationary law of a friction that depends on the displacement.
#[derive(Debug, Clone)]
pub(in crate::fokker_planck) enum Law {
    /// In Hermite functions of v and spectral elements of q.
    Functions(Kept),
    /// On a mesh.
    OnMesh(OnMesh),
}

/// The same of either.
macro_rules! either {
    ($law:expr, $it:ident => $what:expr) => {
        match $law {
            Self::Functions($it) => $what,
            Self::OnMesh($it) => $what,
        }
    };
}

impl Law {
    /// Expectations, not divided by their mass.
    pub(in crate::fokker_planck) fn raw(&self) -> &RawMoments {
        either!(self, it => &it.raw)
    }

    /// E\[c v^2\], which is pi h.
    pub(in crate::fokker_planck) fn dissipated(&self) -> f64 {
        either!(self, it => it.dissipated)
    }

    /// What rounding leaves open, relative to the size of the law.
    pub(in crate::fokker_planck) fn rounding(&self) -> f64 {
        either!(self, it => it.rounding)
    }

    /// Where it begins and ends in q.
    pub(in crate::fokker_planck) fn domain(&self) -> [f64; 2] {
        either!(self, it => it.domain())
    }

    /// p_q(q).
    pub(in crate::fokker_planck) fn density_q(&self, q: f64) -> f64 {
        match self {
            Self::Functions(it) => it.density_q(q),
            Self::OnMesh(it) => it.row(q).mass(),
        }
    }

    /// p_v(v).
    pub(in crate::fokker_planck) fn density_v(&self, v: f64) -> f64 {
        either!(self, it => it.density_v(v))
    }

    /// The law at one displacement.
    pub(in crate::fokker_planck) fn column(&self, q: f64) -> Column<'_> {
        match self {
            Self::Functions(it) => Column::Functions(it.column(q)),
            Self::OnMesh(it) => Column::OnMesh(it.row(q)),
        }
    }

    /// p(q, v) at one displacement and many velocities.
    pub(in crate::fokker_planck) fn along(&self, q: f64, velocities: &[f64]) -> Vec<f64> {
        let column = self.column(q);
        velocities.iter().map(|v| column.density(*v)).collect()
    }

    /// p at many points; those of one displacement stand together.
    pub(in crate::fokker_planck) fn densities(&self, points: &[[f64; 2]]) -> Vec<f64> {
        let columns = points.chunk_by(|a, b| a[0] == b[0]);
        let column = |points: &[[f64; 2]]| {
            let velocities: Vec<f64> = points.iter().map(|it| it[1]).collect();
            self.along(points[0][0], &velocities)
        };
        columns.flat_map(column).collect()
    }

    /// Crossings of a level a unit of time and the integral of v^2 p over them, down and up.
    pub(in crate::fokker_planck) fn crossings(&self, q: f64) -> [[f64; 2]; 2] {
        let column = self.column(q);
        let panels = either!(self, it => it.panels());
        let mut sums = [[0.0; 2]; 2];
        for ends in panels.windows(2) {
            let half = 0.5 * (ends[1] - ends[0]);
            for (x, w) in gauss::<10>() {
                let v = ends[0] + half * (1.0 + x);
                for (sum, v_signed) in sums.iter_mut().zip([-v, v]) {
                    let flux = w * half * v * column.density(v_signed);
                    sum[0] += flux;
                    sum[1] += v * flux;
                }
            }
        }
        sums
    }

    /// The L1 distance to another law, by the quadrature of this one.
    pub(in crate::fokker_planck) fn distance(&self, other: &Self) -> f64 {
        let [places, speeds] = either!(self, it => it.quadrature());
        let velocities: Vec<f64> = speeds.iter().map(|it| it.0).collect();
        let at = |(q, w): &(f64, f64)| {
            let (one, two) = (self.along(*q, &velocities), other.along(*q, &velocities));
            let apart = one.iter().zip(two).zip(&speeds);
            w * apart.map(|((a, b), (_, w))| w * (a - b).abs()).sum::<f64>()
        };
        places.iter().map(at).sum()
    }
}

/// A stationary law at one displacement.
pub(in crate::fokker_planck) enum Column<'a> {
    Functions(hermite::Column<'a>),
    OnMesh(Row<'a>),
}

impl Column<'_> {
    /// The displacement.
    pub(in crate::fokker_planck) fn q(&self) -> f64 {
        match self {
            Self::Functions(it) => it.q(),
            Self::OnMesh(it) => it.q,
        }
    }

    /// p(q, v).
    pub(in crate::fokker_planck) fn density(&self, v: f64) -> f64 {
        either!(self, it => it.density(v))
    }
}
