//! Contact laws: the restoring force G(q), its potential U(q) and its stiffness G'(q).

mod kind;
mod laws;
mod parameters;
mod piece;
mod restoring;
mod smooth;
mod three_halves;

pub use kind::Kind;
pub use laws::LAWS;
pub use parameters::{Parameter, Parameters};
pub use piece::Piece;
pub(crate) use piece::place;
pub use restoring::Restoring;

use crate::error::{Error, Result};
use crate::roots::bisect;
use serde_json::{Value, json};
use smooth::{Break, broken};
use std::sync::Arc;

/// How far out kinks of a law from code are looked for.
const LOOKED_AT: f64 = 50.0;

/// Numbers of a list that is shown with the name of a law.
const FEW: usize = 6;

/// The restoring force of the contact, in units of the static load, against the dimensionless
/// displacement q of (6). Equilibrium at q = 0 with unit stiffness for every built-in law that confines.
///
/// ```
/// use vibroimpact::contact::ContactLaw;
/// assert_eq!(ContactLaw::Hertz.force(0.0), 0.0);
/// assert_eq!(ContactLaw::Hertz.loss_point(), Some(-1.5)); // beyond it, flight: G = -1
/// ```
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum ContactLaw {
    /// G = [(1 + 2q/3)_+]^{3/2} - 1, contact lost below q = -3/2. (9), (26).
    Hertz,
    /// G = (1 + q)_+ - 1, contact lost below q = -1. (34).
    Bilinear,
    /// G = q: never loses contact.
    Linear,
    /// G = -1: never in contact, no stationary law. Falls under the preload; for tests.
    Free,
    /// A law with parameters, or from code.
    Custom(Arc<dyn Restoring>),
}

/// The laws that a scene names by a word.
const WORDS: [ContactLaw; 4] = [
    ContactLaw::Hertz,
    ContactLaw::Bilinear,
    ContactLaw::Linear,
    ContactLaw::Free,
];

/// Whether all are finite, each above the one before.
fn ascend(all: &[f64]) -> bool {
    all.iter().all(|it| it.is_finite()) && all.windows(2).all(|it| it[0] < it[1])
}

impl ContactLaw {
    /// A law from code, checked on a sample of points out to |q| = 1490: finite and continuous, constant in flight and lower beyond a
    /// second wall, a force that never falls, or changes its sign where [`Restoring::roots`] says so, and out to |q| = 50 without plain
    /// kinks that [`Restoring::kinks`] does not list.
    ///
    /// # Errors
    /// [`Error::Invalid`] where the force is not finite, jumps, falls with q, or is not constant in flight; for a plain kink that is
    /// not listed; for walls and kinks that are not finite or not ascending; for the name of a law that a scene knows.
    pub fn custom(law: impl Restoring + 'static) -> Result<Self> {
        let law = Arc::new(law);
        let name = format!("contact law \"{}\"", law.name());
        let refused = |value: String, accepted: &str| Err(Error::invalid(&name, value, accepted));
        if Self::words().contains(&law.name()) || LAWS.iter().any(|it| it.name == law.name()) {
            return refused(law.name().into(), "a name that no law of a scene has");
        }
        let ends: Vec<f64> = law
            .back_wall()
            .into_iter()
            .chain(law.loss_point())
            .collect();
        let walls = law.back_wall().is_none() || law.loss_point().is_some();
        if !(walls && ascend(&ends)) {
            let accepted = "a finite loss point, and a back wall below it";
            return refused(
                format!(
                    "back_wall = {:?}, loss_point = {:?}",
                    law.back_wall(),
                    law.loss_point()
                ),
                accepted,
            );
        }
        if !ascend(&law.kinks()) {
            return refused(
                format!("kinks = {:?}", law.kinks()),
                "finite kinks, ascending",
            );
        }
        let it = Self::Custom(law.clone());
        let flight = it.flight();
        let samples: Vec<f64> = (-400..=400).map(|k| (f64::from(k) * 0.02).sinh()).collect();
        let several = law.roots(0.0).len() > 1;
        for pair in samples.windows(2) {
            let (low, high) = (law.force(pair[0]), law.force(pair[1]));
            let value = || format!("G({}) = {low:?}, G({}) = {high:?}", pair[0], pair[1]);
            let falls = low > high + 1e-12 * high.abs() && !several;
            if !low.is_finite() || !high.is_finite() || falls {
                return refused(value(), "a finite force that never falls with q");
            }
            let lost = |q: f64| flight.is_some_and(|[a, b]| q > a && q < b);
            if lost(pair[0]) && lost(pair[1]) && low != high {
                return refused(value(), "a constant force in flight, below the loss point");
            }
            let listed = |q: &f64| *q >= pair[0] && *q <= pair[1];
            let known = law.kinks().iter().any(listed) || ends.iter().any(listed);
            let near = pair.iter().all(|q| q.abs() <= LOOKED_AT);
            let found = (near && !known).then(|| broken(|q| law.force(q), [pair[0], pair[1]]));
            match found.flatten() {
                Some(Break::Jump(q)) => {
                    return refused(format!("a jump near q = {q:?}"), "a continuous force");
                }
                Some(Break::Kink(q)) => {
                    let accepted = "a force whose derivative jumps where Restoring::kinks says so";
                    return refused(format!("a kink near q = {q:?}"), accepted);
                }
                None => {}
            }
        }
        if let Some(wall) = law.back_wall() {
            let (far, flown) = (
                law.force(wall - samples[samples.len() - 1]),
                law.force(wall),
            );
            if far >= flown {
                let value =
                    format!("back_wall = {wall:?}, G = {flown:?} there and {far:?} far beyond");
                return refused(value, "a back wall beyond which the force falls, or none");
            }
        }
        Ok(it)
    }

    /// The law that a scene names by a word: "hertz", "bilinear", "linear", "free".
    pub fn named(word: &str) -> Option<Self> {
        WORDS.into_iter().find(|it| it.name() == word)
    }

    /// The words of [`ContactLaw::named`].
    pub fn words() -> [&'static str; 4] {
        ["hertz", "bilinear", "linear", "free"]
    }

    /// A law of one of [`LAWS`]. One that is a law with a word, as the power 3/2, becomes it.
    ///
    /// ```
    /// use vibroimpact::contact::{ContactLaw, Parameter, Parameters};
    /// let given = Parameters::new().with("exponent", Parameter::Number(1.5));
    /// assert_eq!(ContactLaw::given("power", &given)?, ContactLaw::Hertz);
    /// # Ok::<(), vibroimpact::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Invalid`] for a name that is none, and for keys and values that the law does not accept.
    pub fn given(law: &str, parameters: &Parameters) -> Result<Self> {
        let Some(kind) = LAWS.iter().find(|it| it.name == law) else {
            let names: Vec<String> = LAWS.iter().map(|it| format!("{:?}", it.name)).collect();
            let key = parameters::full("law");
            return Err(Error::invalid(key, format!("{law:?}"), names.join(", ")));
        };
        let made = (kind.make)(parameters)?;
        let one = |key: &str, value: Parameter| Parameters::new().with(key, value);
        let power = |n: f64| one("exponent", Parameter::Number(n));
        let straight = one("coefficients", Parameter::Numbers(vec![1.0]));
        let simple = [
            ("power", power(1.5), Self::Hertz),
            ("power", power(1.0), Self::Bilinear),
            ("polynomial", straight, Self::Linear),
        ];
        let given = made.parameters();
        let same = simple
            .into_iter()
            .find(|(name, it, _)| *name == law && *it == given);
        Ok(same.map_or(Self::Custom(made), |(.., it)| it))
    }

    /// As a scene writes it: a word, or a table with `law`.
    pub(crate) fn tree(&self) -> Value {
        match self {
            Self::Custom(law) if !law.parameters().is_empty() => law.parameters().tree(law.name()),
            _ => json!(self.name()),
        }
    }

    /// The name used in scenes and tables.
    pub fn name(&self) -> &str {
        match self {
            Self::Hertz => "hertz",
            Self::Bilinear => "bilinear",
            Self::Linear => "linear",
            Self::Free => "free",
            Self::Custom(law) => law.name(),
        }
    }

    /// The name with its parameters, those that are no long lists, for people.
    pub(crate) fn described(&self) -> String {
        let tree = self.tree();
        let given = tree.as_object().into_iter().flatten();
        // The points of a table are in the scene.
        let short = |value: &Value| value.as_array().is_none_or(|it| it.len() <= FEW);
        let given = given.filter(|(key, value)| *key != "law" && short(value));
        let given: Vec<String> = given
            .map(|(key, value)| format!("{key} = {value}"))
            .collect();
        if given.is_empty() {
            return format!("{} contact", self.name());
        }
        format!("{} contact ({})", self.name(), given.join(", "))
    }

    /// G(q).
    #[inline(always)]
    pub fn force(&self, q: f64) -> f64 {
        match self {
            Self::Hertz => three_halves::less_one(compression(q)),
            Self::Bilinear => q.max(-1.0),
            Self::Linear => q,
            Self::Free => -1.0,
            Self::Custom(law) => law.force(q),
        }
    }

    /// U(q), the integral of G from 0 to q, to rounding relative to U (no cancellation near q = 0).
    #[inline(always)]
    pub fn potential(&self, q: f64) -> f64 {
        match self {
            Self::Hertz => hertz_potential(q),
            Self::Bilinear if q >= -1.0 => 0.5 * q * q,
            Self::Bilinear => -q - 0.5,
            Self::Linear => 0.5 * q * q,
            Self::Free => -q,
            Self::Custom(law) => law.potential(q),
        }
    }

    /// G'(q); at a kink of the force, the value on the side of contact.
    #[inline(always)]
    pub fn stiffness(&self, q: f64) -> f64 {
        match self {
            Self::Hertz => (1.0 + q * (2.0 / 3.0)).max(0.0).sqrt(),
            Self::Bilinear if q >= -1.0 => 1.0,
            Self::Linear => 1.0,
            Self::Bilinear | Self::Free => 0.0,
            Self::Custom(law) => law.stiffness(q),
        }
    }

    /// The q below which contact is lost (15): -3/2 for Hertz, -1 for bilinear. Below it the force is
    /// constant. None where the law cannot lose contact (or never has it).
    #[inline(always)]
    pub fn loss_point(&self) -> Option<f64> {
        match self {
            Self::Hertz => Some(-1.5),
            Self::Bilinear => Some(-1.0),
            Self::Linear | Self::Free => None,
            Self::Custom(law) => law.loss_point(),
        }
    }

    /// The loss point, which `what` needs.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a law that cannot lose contact.
    pub(crate) fn loss_for(&self, what: &str) -> Result<f64> {
        self.loss_point().ok_or_else(|| {
            let accepted = format!("a law that can lose contact, for {what}");
            Error::invalid("oscillator.contact", self.name(), accepted)
        })
    }

    /// The q at which flight ends on a second wall, below the loss point; None without one.
    pub fn back_wall(&self) -> Option<f64> {
        match self {
            Self::Custom(law) => law.back_wall(),
            _ => None,
        }
    }

    /// The static compression in units of q: what lies between the q at which the contact force N + 1 = 1 + G is gone and the
    /// equilibrium under the static load, q = 0. 3/2 under the Hertz law, n under a power n, 1 for the linear and the
    /// bilinear laws, and where no q < 0 is free of force.
    pub fn static_compression(&self) -> f64 {
        let free = match self {
            Self::Custom(law) => law.roots(-1.0),
            _ => Vec::new(),
        };
        let free = self.loss_point().into_iter().chain(free);
        let last = free.filter(|q| *q < 0.0).reduce(f64::max);
        last.map_or(1.0, |q| -q)
    }

    /// The interval of q out of contact, down to minus infinity without a second wall. None for a law that cannot lose
    /// contact.
    pub fn flight(&self) -> Option<[f64; 2]> {
        let low = self.back_wall().unwrap_or(f64::NEG_INFINITY);
        self.loss_point().map(|loss| [low, loss])
    }

    /// Whether contact is lost at q.
    pub fn is_lost(&self, q: f64) -> bool {
        self.flight()
            .is_some_and(|[low, high]| q >= low && q < high)
    }

    /// Where G or its slope jumps, ascending, the ends of flight among them.
    pub fn kinks(&self) -> Vec<f64> {
        let ends = self.back_wall().into_iter().chain(self.loss_point());
        let Self::Custom(law) = self else {
            return ends.collect();
        };
        let mut all = law.kinks();
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-12 * a.abs().max(1.0);
        for end in ends {
            if !all.iter().any(|it| near(*it, end)) {
                all.push(end);
            }
        }
        all.sort_by(f64::total_cmp);
        all
    }

    /// G as polynomials piece by piece; empty where it is of another kind, or has a closed form of its own.
    pub(crate) fn pieces(&self) -> &[Piece] {
        match self {
            Self::Custom(law) => law.pieces(),
            _ => &[],
        }
    }

    /// The displacements at which the contact carries the force N = G(q), ascending: the inverse of (26),
    /// q = (3/2)[(1 + N)^{2/3} - 1] for Hertz. Empty for a force that is never reached, or is that of flight.
    pub(crate) fn displacements_at(&self, force: f64) -> Vec<f64> {
        let flight = self.loss_point().map(|loss| self.force(loss));
        if flight == Some(force) {
            return Vec::new();
        }
        match self {
            Self::Hertz | Self::Bilinear if force < -1.0 => Vec::new(),
            Self::Hertz => vec![1.5 * ((1.0 + force).powf(2.0 / 3.0) - 1.0)],
            Self::Bilinear | Self::Linear => vec![force],
            Self::Free => Vec::new(),
            Self::Custom(law) => law.roots(force),
        }
    }

    /// The density of N = G(q) without its Dirac mass, (27), (28), from that of q; at the force of flight its limit from
    /// contact, infinite where contact begins without stiffness.
    pub(crate) fn density_force(&self, force: f64, density_q: impl Fn(f64) -> f64) -> f64 {
        let flight = self.loss_point().filter(|loss| self.force(*loss) == force);
        let places = match flight {
            Some(loss) => self.back_wall().into_iter().chain([loss]).collect(),
            None => self.displacements_at(force),
        };
        let all = places.into_iter();
        all.fold(0.0, |sum, q| sum + density_q(q) / self.stiffness(q).abs())
    }

    /// P(N <= force), the Dirac mass included, from the probability below a displacement.
    pub(crate) fn distribution_force(&self, force: f64, below: impl Fn(f64) -> f64) -> f64 {
        let all = self.displacements_at(force);
        if all.is_empty() {
            let loss = self.loss_point();
            let flown = loss.filter(|loss| force >= self.force(*loss));
            return flown.map_or(0.0, below);
        }
        // G is lower left of the last, and again left of the last but two.
        let signs = [1.0, -1.0].into_iter().cycle();
        let signed = all.into_iter().rev().zip(signs);
        signed.map(|(q, sign)| sign * below(q)).sum()
    }

    /// Whether exp(-U/T) can be normalised: the force is negative far left and positive far right.
    pub fn is_confining(&self) -> bool {
        match self {
            Self::Hertz | Self::Bilinear | Self::Linear => true,
            Self::Free => false,
            Self::Custom(law) => law.force(-1e6) < 0.0 && law.force(1e6) > 0.0,
        }
    }

    /// Every q with G(q) = 0, ascending: minima of U and the maxima between them. Empty for a law that does not confine.
    pub fn equilibria(&self) -> Vec<f64> {
        match self {
            Self::Hertz | Self::Bilinear | Self::Linear => vec![0.0],
            Self::Custom(law) if self.is_confining() => law.roots(0.0),
            Self::Free | Self::Custom(_) => Vec::new(),
        }
    }

    /// The minima of U, ascending.
    pub(crate) fn minima(&self) -> impl Iterator<Item = f64> + use<> {
        self.equilibria().into_iter().step_by(2)
    }

    /// The q where U is smallest, the first of several; 0 for the laws with a word. None without one.
    pub fn equilibrium(&self) -> Option<f64> {
        self.minima()
            .min_by(|a, b| self.potential(*a).total_cmp(&self.potential(*b)))
    }

    /// The largest frequency of small motions about an equilibrium, 1 at least.
    pub(crate) fn fastest(&self) -> f64 {
        let rest = self.equilibria().into_iter();
        let stiffest = rest.map(|q| self.stiffness(q)).fold(1.0, f64::max);
        stiffest.sqrt()
    }

    /// Smallest value of U: 0 for the built-in confining laws. None without one.
    pub(crate) fn lowest_potential(&self) -> Option<f64> {
        self.equilibrium().map(|q| self.potential(q))
    }

    /// The highest U between two wells over the lowest of all; None for a law of one well.
    pub fn barrier(&self) -> Option<f64> {
        let lowest = self.lowest_potential()?;
        let tops = self.equilibria().into_iter().skip(1).step_by(2);
        tops.map(|q| self.potential(q) - lowest)
            .max_by(f64::total_cmp)
    }

    /// For each maximum of U between two wells, how far it rises above the higher of the minima beside it.
    pub(crate) fn rises(&self) -> Vec<f64> {
        let levels: Vec<f64> = self
            .equilibria()
            .iter()
            .map(|q| self.potential(*q))
            .collect();
        let tops = levels.windows(3).step_by(2);
        tops.map(|it| it[1] - it[0].max(it[2])).collect()
    }

    /// The two turning points (left, right) of the undamped motion with energy `rise` above the lowest,
    /// U = U_min + rise: of all wells that hold it, the outermost. None for a law that does not confine.
    pub fn turning_points(&self, rise: f64) -> Option<(f64, f64)> {
        let q0 = self.equilibrium()?;
        let level = self.potential(q0) + rise;
        let held = |q: &f64| self.potential(*q) < level;
        let minima: Vec<f64> = self.minima().filter(held).collect();
        let first = minima.first().copied().unwrap_or(q0);
        let last = minima.last().copied().unwrap_or(q0);
        Some((
            self.turn(first, level, -1.0, rise),
            self.turn(last, level, 1.0, rise),
        ))
    }

    /// Where the motion of energy `level` turns, from `q0` in the direction of `sign`.
    fn turn(&self, q0: f64, level: f64, sign: f64, rise: f64) -> f64 {
        let outside = |q: f64| self.potential(q) >= level;
        // A first guess from unit stiffness keeps tiny and huge levels within a few doublings.
        let reach = (2.0 * rise).sqrt().max(f64::MIN_POSITIVE);
        bisect(q0, expand(q0, sign * reach, outside), outside)
    }

    /// Where a motion that enters the contact at the loss point with this speed turns. None for a law that cannot lose
    /// contact.
    pub(crate) fn rebound(&self, speed: f64) -> Option<f64> {
        let loss = self.loss_point()?;
        let last = self.equilibria().last().copied()?;
        let level = self.potential(loss) + 0.5 * speed * speed;
        let rise = level - self.potential(last);
        Some(self.turn(last, level, 1.0, rise.max(f64::MIN_POSITIVE)))
    }

    /// Whether the depth of an impact grows more slowly than its speed, however fast that is: a contact that stiffens as
    /// (q - q_loss)^n with n > 1, not one that ends as a straight line.
    pub(crate) fn stiffens(&self) -> bool {
        const FAST: [f64; 2] = [1e6, 1e9];
        let loss = self.loss_point();
        let depth = |speed: f64| Some((self.rebound(speed)? - loss?) / speed);
        let [slow, fast] = FAST.map(depth);
        slow.zip(fast)
            .is_some_and(|(slow, fast)| fast < (1.0 - 1e-4) * slow)
    }

    /// For each minimum of U its turning points at `rise` above it, no further than the maxima beside it.
    pub(crate) fn wells(&self, rise: f64) -> Vec<[f64; 2]> {
        let all = self.equilibria();
        let at = |k: Option<usize>| k.and_then(|k| all.get(k)).copied();
        (0..all.len())
            .step_by(2)
            .map(|k| {
                let level = self.potential(all[k]) + rise;
                let end = |top: Option<f64>, sign: f64| match top {
                    Some(top) if self.potential(top) < level => top,
                    Some(top) => bisect(all[k], top, |q| self.potential(q) >= level),
                    None => self.turn(all[k], level, sign, rise),
                };
                [end(at(k.checked_sub(1)), -1.0), end(at(Some(k + 1)), 1.0)]
            })
            .collect()
    }
}

/// The laws with a word are equal by kind, others by name and parameters, a law from code to itself only.
impl PartialEq for ContactLaw {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Custom(a), Self::Custom(b)) => {
                let given = a.parameters();
                let same = || a.name() == b.name() && given == b.parameters();
                Arc::ptr_eq(a, b) || (!given.is_empty() && same())
            }
            _ => std::mem::discriminant(self) == std::mem::discriminant(other),
        }
    }
}

/// That of a Hertzian contact beyond the static one, over it; -1 in flight.
#[inline(always)]
fn compression(q: f64) -> f64 {
    (q * (2.0 / 3.0)).max(-1.0)
}

/// U(q) = (3/5)(y^5 - 1) - (3/2)(y^2 - 1), which has the factor (y - 1)^2; in flight -q - 3/5.
#[inline(always)]
fn hertz_potential(q: f64) -> f64 {
    let [y, e] = three_halves::root(compression(q));
    e * e * (0.9 + y * (1.8 + y * (1.2 + y * 0.6))) + (q.max(-1.5) - q)
}

/// First point q0 + step, q0 + 2 step, q0 + 4 step... where `done` holds.
fn expand(q0: f64, step: f64, done: impl Fn(f64) -> bool) -> f64 {
    let mut reach = step;
    // 2100 doublings span every finite double.
    for _ in 0..2100 {
        if done(q0 + reach) {
            break;
        }
        reach *= 2.0;
    }
    q0 + reach
}

#[cfg(test)]
mod tests {
    use super::{ContactLaw, Parameter, Parameters};

    #[test]
    fn a_law_is_described_by_its_short_parameters() {
        let column = |k: f64| Parameter::Numbers((-20..20).map(|i| k * f64::from(i)).collect());
        let points = Parameters::new()
            .with("q", column(0.1))
            .with("force", column(0.2));
        let table = ContactLaw::given("table", &points).unwrap();
        assert_eq!(table.described(), "table contact");
        let gap = Parameters::new()
            .with("exponent", Parameter::Number(1.5))
            .with("gap", Parameter::Number(2.0));
        let gap = ContactLaw::given("power", &gap).unwrap().described();
        assert!(
            gap.contains("exponent = 1.5") && gap.contains("gap = 2"),
            "{gap}"
        );
        assert_eq!(ContactLaw::Hertz.described(), "hertz contact");
    }
}
