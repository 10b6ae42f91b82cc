//! What a contact law gives: force, potential, stiffness, where it is not smooth, where contact is lost.

use super::parameters::Parameters;
use super::piece::Piece;
use crate::quadrature;
use crate::roots::bisect;
use std::fmt;

/// A contact law: one of the scene's, or one given in code by [`ContactLaw::custom`].
///
/// The force must be continuous. Below its [loss point](Restoring::loss_point), down to its
/// [back wall](Restoring::back_wall) if it has one, it must be constant: flight under the preload. A law given in code
/// must not fall with q; one that does, as two wells need, overrides [`Restoring::roots`].
///
/// [`ContactLaw::custom`]: super::ContactLaw::custom
///
/// ```
/// use vibroimpact::contact::{ContactLaw, Restoring};
///
/// /// Line contact of two cylinders: force ~ compression^(10/9), unit stiffness at q = 0.
/// #[derive(Debug)]
/// struct Line;
/// impl Restoring for Line {
///     fn name(&self) -> &str {
///         "line"
///     }
///     fn force(&self, q: f64) -> f64 {
///         (1.0 + 0.9 * q).max(0.0).powf(10.0 / 9.0) - 1.0
///     }
///     fn loss_point(&self) -> Option<f64> {
///         Some(-1.0 / 0.9)
///     }
/// }
/// let law = ContactLaw::custom(Line)?;
/// assert!((law.stiffness(0.0) - 1.0).abs() < 1e-6);
/// # Ok::<(), vibroimpact::Error>(())
/// ```
pub trait Restoring: fmt::Debug + Send + Sync {
    /// A short name for tables and files.
    fn name(&self) -> &str;

    /// G(q), dimensionless.
    fn force(&self, q: f64) -> f64;

    /// U(q), the integral of G from 0 to q. The default integrates [`Restoring::force`]
    /// numerically, split at the kinks; a closed form is faster.
    fn potential(&self, q: f64) -> f64 {
        let (a, b) = (q.min(0.0), q.max(0.0));
        let mut breaks = vec![a];
        breaks.extend(self.kinks().into_iter().filter(|it| *it > a && *it < b));
        breaks.push(b);
        quadrature::integrate(|s| self.force(s), &breaks, 1e-15).value * q.signum()
    }

    /// G'(q). The default is a central difference (error about 1e-10).
    fn stiffness(&self, q: f64) -> f64 {
        let step = 6e-6 * q.abs().max(1.0);
        (self.force(q + step) - self.force(q - step)) / (2.0 * step)
    }

    /// The q below which contact is lost and the force constant, if there is one.
    fn loss_point(&self) -> Option<f64>;

    /// The q, below the loss point, at which flight ends on a second wall, if there is one.
    fn back_wall(&self) -> Option<f64> {
        None
    }

    /// Where the derivative of G jumps, ascending: all of them, for quadrature, exact motion and meshes go from kink to kink. By
    /// default the ends of flight, which are among them whether they are listed or not.
    fn kinks(&self) -> Vec<f64> {
        let wall = self.back_wall().into_iter();
        wall.chain(self.loss_point()).collect()
    }

    /// Every q at which G passes `force`, ascending; empty without one. The default serves a force that never falls.
    fn roots(&self, force: f64) -> Vec<f64> {
        let beyond = |q: f64| self.force(q) >= force;
        let right = (0..500).map(|k| 2f64.powi(k)).find(|q| beyond(*q));
        let left = (0..500).map(|k| -(2f64.powi(k))).find(|q| !beyond(*q));
        let ends = left.zip(right).into_iter();
        ends.map(|(a, b)| bisect(a, b, beyond)).collect()
    }

    /// G as polynomials of degree 3, piece by piece from minus infinity; empty for a law of another kind. The exact
    /// motion then is a Taylor series.
    fn pieces(&self) -> &[Piece] {
        &[]
    }

    /// What a scene says of the law besides its name; empty for a law given in code. Two laws of the same name and
    /// parameters are equal.
    fn parameters(&self) -> Parameters {
        Parameters::default()
    }
}
