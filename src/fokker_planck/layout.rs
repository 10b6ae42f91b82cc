//! From a tolerance to a truncated domain and its cells.

use super::budget;
use super::domain::Domain;
use super::flux::Drift;
use super::mesh::{Axis, Focus, Mesh};
use super::policy::{KINK_FINER, KINK_WIDTH};
use super::settings::Settings;
use crate::contact::ContactLaw;
use crate::error::{Error, Result};
use crate::initial::Initial;
use crate::oscillator::Oscillator;

/// Part of the tolerance that the truncation of the domain is chosen for: a tenth of it costs a twelfth more cells
/// in either direction, and its error estimate, the worst that what is outside could do, is far above its error.
const DOMAIN_SHARE: f64 = 0.008;

/// Order that the kink of the Hertz force leaves to equal cells: 3/2 + 2. A bilinear one leaves 3.
const KINK_ORDER: f64 = 3.5;

/// Meshes tried, each finer, for cells of the program's own choice that an advection scheme cannot carry.
pub(super) const STEEPER_TRIES: usize = 8;

/// How wide cells are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Cells {
    /// So many along q and v: the scene's.
    Given([usize; 2]),
    /// At most so wide in q and v where the mesh is finest.
    Widths([f64; 2]),
}

/// What asks for fewer cells, whatever the question.
pub(super) const FEWER: &str = "more noise, or an initial condition nearer to the stationary law";

/// A truncated domain and how it is cut into cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Layout {
    pub(crate) domain: Domain,
    pub(crate) cells: Cells,
    /// Its stencil sets the margin of the mesh.
    pub(crate) drift: Drift,
    /// Whether cells are finer around the kinks of the force: for what takes steps that know no width of cells.
    pub(crate) focused: bool,
}

impl Layout {
    /// Whether the scene gave the cells.
    pub(super) fn is_given(&self) -> bool {
        matches!(self.cells, Cells::Given(_))
    }

    /// What is made on mesh 0, or on the first of a few finer ones whose cells are not too coarse for it; on the scene's own
    /// cells alone.
    pub(super) fn carried<T>(&self, on: impl Fn(usize) -> Result<T>) -> Result<T> {
        let mut found = on(0);
        for k in 1..STEEPER_TRIES {
            if self.is_given() || !matches!(found, Err(Error::Mesh { .. })) {
                break;
            }
            found = on(k);
        }
        found
    }

    /// The same with cells `finer` times as fine.
    pub(super) fn refined(self, finer: f64) -> Self {
        let cells = match self.cells {
            Cells::Widths(widths) => Cells::Widths(widths.map(|width| width / finer)),
            Cells::Given(cells) => Cells::Given(cells.map(|n| times(self.drift, n, finer))),
        };
        Self { cells, ..self }
    }

    /// The same with cells no wider than these, unless the scene gave them.
    pub(super) fn narrowed(self, widths: [f64; 2]) -> Self {
        let cells = match self.cells {
            Cells::Widths([q, v]) => Cells::Widths([q.min(widths[0]), v.min(widths[1])]),
            given @ Cells::Given(_) => given,
        };
        Self { cells, ..self }
    }

    /// Cells in q and v of a mesh `finer` times as fine as laid out.
    ///
    /// # Errors
    /// [`Error::Mesh`] for cells beyond what can be meant; those of the axes.
    pub(super) fn count(&self, oscillator: &Oscillator, finer: f64) -> Result<[usize; 2]> {
        let (contact, domain) = (oscillator.contact(), self.domain);
        let margin = self.drift.margin();
        let width = match self.cells {
            Cells::Given(cells) => return Ok(cells.map(|n| times(self.drift, n, finer))),
            Cells::Widths([q, v]) => [gapped(contact, q), v],
        };
        // Graded axes need fewer cells than their length over the finest one.
        let count = |length: f64, width: f64| (length / width).ceil() + 2.0 * margin as f64;
        let temperature = oscillator.temperature();
        let trial = Axis::displacement(contact, temperature, domain.q, 64 + 2 * margin, margin)?;
        let finest = trial.slopes().iter().copied().fold(f64::INFINITY, f64::min);
        let more = self.focus(oscillator).more(domain.q);
        let q = count(64.0 * finest + more, width[0]) * finer;
        let v = count(domain.v[1] - domain.v[0], width[1]) * finer;
        for (n, axis) in [(q, "q"), (v, "v")] {
            if n > 20_000.0 {
                let what = format!("{n:.1e} cells along {axis} would be needed");
                return Err(Error::mesh(what, FEWER));
            }
        }
        // Even along v: an edge at v = 0 keeps the mesh symmetric.
        Ok([q as usize, 2 * (v / 2.0).ceil() as usize])
    }

    /// Finer cells where contact begins and ends. A path that crosses x = 0 at a speed v, x the way into contact and its force
    /// x^a, is turned by x^(a+1)/v: p is no smoother there, and noise along v does not help. Interpolation on cells of a width h
    /// loses h^(a+2) of what there is of p there, which falls as e^(-L) at a level of U of L T.
    fn focus(&self, oscillator: &Oscillator) -> Focus {
        let contact = oscillator.contact();
        let (true, Some(ends), Some(lowest)) =
            (self.focused, contact.flight(), contact.lowest_potential())
        else {
            return Focus::default();
        };
        let width = KINK_WIDTH.get() * thermal_width(oscillator);
        // Two of them, less than that apart, are not finer together than one.
        let apart = (ends[1] - ends[0]) / width;
        let both = 1.0 + (1.0 + apart * apart).powf(-1.5);
        let places = ends.into_iter().filter(|q| q.is_finite()).map(|q| {
            let level = (contact.potential(q) - lowest) / oscillator.temperature();
            let finer = KINK_FINER.get() * (-level / KINK_ORDER).exp();
            [q, (finer - 1.0) / both]
        });
        Focus::new(places.filter(|[_, b]| *b > 0.0).collect(), width)
    }

    /// A mesh `finer` times as fine as laid out.
    pub(super) fn mesh(&self, oscillator: &Oscillator, finer: f64) -> Result<Mesh> {
        let cells = self.count(oscillator, finer)?;
        let (contact, domain) = (oscillator.contact(), self.domain);
        let margin = self.drift.margin();
        let temperature = oscillator.temperature();
        let (n, focus) = ((cells[0], margin), self.focus(oscillator));
        let q = Axis::focused(contact, [temperature; 2], domain.q, n, &focus)?;
        let v = if contact.is_confining() {
            Axis::velocity(domain.v[1], cells[1], margin)?
        } else {
            Axis::uniform(domain.v[0], domain.v[1], cells[1])?
        };
        Ok(Mesh { q, v })
    }

    /// As [`Layout::count`], if the arrays fit the memory allowed.
    pub(super) fn count_within(
        &self,
        oscillator: &Oscillator,
        finer: f64,
        max_memory: u64,
    ) -> Result<[usize; 2]> {
        let cells = self.count(oscillator, finer)?;
        let needed = budget::memory(cells, self.drift, budget::Factors::None);
        budget::check_memory(needed, cells, self.is_given(), max_memory)?;
        Ok(cells)
    }
}

/// So many cells, `finer` times as many within the margins of a stencil.
pub(super) fn times(drift: Drift, n: usize, finer: f64) -> usize {
    let margin = 2 * drift.margin();
    margin.min(n) + (n.saturating_sub(margin) as f64 * finer).round() as usize
}

impl Cells {
    /// The scene's, or these widths.
    pub(super) fn of(settings: &Settings, widths: [f64; 2]) -> Self {
        settings.cells.map_or(Self::Widths(widths), Self::Given)
    }
}

/// Cells of this width along q, or of a part of it so that two lie in the gap before a second wall: a mesh with an edge on
/// one wall alone converges in leaps. A quarter at the least.
fn gapped(contact: &ContactLaw, width: f64) -> f64 {
    let gap = contact.back_wall().zip(contact.loss_point());
    let narrow = gap.map_or(width, |(back, loss)| 0.5 * (loss - back));
    width.min(narrow.max(0.25 * width))
}

/// The probability left out for a tolerance: a thousandth of it, since fourth moments weigh the tail
/// by (H/T)^2, some hundreds there.
pub(super) fn neglected(tolerance: f64) -> f64 {
    1e-3 * tolerance
}

/// The domain closed by one energy level that leaves out as much as keeps its part of every error estimate within its
/// share.
pub(super) fn truncated(
    oscillator: &Oscillator,
    initial: &Initial,
    settings: &Settings,
) -> Result<Domain> {
    let mut outside = settings
        .neglected
        .unwrap_or_else(|| neglected(settings.tolerance));
    // Cells of the scene may not carry a domain as wide as every error estimate would like.
    if settings.neglected.is_some() || settings.cells.is_some() {
        return Domain::closed(oscillator, initial, outside);
    }
    let share = DOMAIN_SHARE * settings.tolerance;
    // A kurtosis far above its scale moves with itself, and no start's is far below that of the law.
    let law = oscillator.displacement_law()?;
    let force = |k: i32| law.expect(|q| oscillator.contact().force(q).powi(k)).value;
    let kurtosis = (force(4) / force(2).powi(2)).max(1.0);
    let mut rounds = 0;
    loop {
        let domain = Domain::closed(oscillator, initial, outside)?;
        let weights = domain.tail_weights(oscillator);
        let part = domain.neglected * weights.into_iter().fold(0.0, f64::max) * kurtosis;
        if part <= share || rounds == 6 {
            return Ok(domain);
        }
        // The weights grow a little as the domain does.
        outside *= 0.8 * share / part;
        rounds += 1;
    }
}

/// Cells per thermal deviation that reach the tolerance with a scheme of order 8 on the paper's case:
/// 5 for 1e-3, 8.6 for 1e-5 (measured). A lower order gets no more: its error is reported instead.
pub(super) fn cells_per_deviation(tolerance: f64) -> f64 {
    5.0 * (1e-3 / tolerance).powf(0.118).clamp(0.6, 4.0)
}

/// Width in q over which the stationary law and the force change: half the width of the thermal
/// oscillation, or of its part in contact where the flight is long.
fn thermal_width(oscillator: &Oscillator) -> f64 {
    let contact = oscillator.contact();
    let level = 0.5 * oscillator.temperature();
    let Some((left, right)) = contact.turning_points(level) else {
        return f64::INFINITY;
    };
    if contact.barrier().is_some() {
        let wells = contact.wells(level).into_iter();
        let widths = wells.map(|[left, right]| right - left);
        return 0.5 * widths.fold(f64::INFINITY, f64::min);
    }
    let loss = contact.loss_point();
    let in_contact = loss.map_or(f64::INFINITY, |loss| right - loss);
    (0.5 * (right - left)).min(0.5 * in_contact.max(right))
}

/// Widths of the stationary law in q and v.
pub(super) fn deviations(oscillator: &Oscillator) -> [f64; 2] {
    [thermal_width(oscillator), oscillator.temperature().sqrt()]
}

/// Cells of q and v that the stationary law asks for.
pub(super) fn thermal_widths(oscillator: &Oscillator, tolerance: f64) -> [f64; 2] {
    deviations(oscillator).map(|w| w / cells_per_deviation(tolerance))
}
