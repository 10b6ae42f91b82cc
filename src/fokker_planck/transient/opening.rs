//! The first part of a run whose start no mesh of the plane can hold: a packet in its own frame, until
//! it is wide enough to be handed over.

use super::propagator::Propagator;
use super::recipe::{FirstGrid, Recipe};
use crate::error::{Error, Result};
use crate::fokker_planck::budget::timing;
use crate::fokker_planck::density::{Density, Snapshot};
use crate::fokker_planck::domain::Domain;
use crate::fokker_planck::layout;
use crate::fokker_planck::mesh::{Axis, Mesh};
use crate::fokker_planck::moving_frame::packet::{Fineness, Packet, STRONG};
use crate::initial::Initial;
use crate::moments::Moments;
use crate::oscillator::Oscillator;
use ndarray::{Array1, Array2};

/// A packet on its way to a mesh.
pub(super) struct Opening<'a> {
    oscillator: &'a Oscillator,
    recipe: &'a Recipe,
    finer: f64,
    packet: Packet,
    /// The cells there would be without regard to the initial condition; None for a law that leaves every domain,
    /// which stays in the frame for good.
    goal: Option<Mesh>,
    /// Widths of cells below which no mesh is refined for the packet's sake alone.
    finest: [f64; 2],
}

/// What a narrow start has cost.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Loss {
    /// Of the packet's size, relative to it.
    pub(super) spread: f64,
    /// Probability, of the tails.
    pub(super) tail: f64,
}

impl Loss {
    /// With the probability that the hand-over changed.
    pub(super) fn and(self, handed: f64) -> Self {
        Self {
            tail: self.tail + handed,
            ..self
        }
    }
}

/// What a packet says at an output time.
pub(super) struct Look {
    pub(super) moments: Moments,
    pub(super) lowest: f64,
    pub(super) negative: f64,
    pub(super) entropy: f64,
    pub(super) distance: f64,
}

/// Time after rest at which the linearised Gaussian is taken: its force is wrong by G'' q^2/2, q^2 of the
/// order of h t^3, so its velocity by h t^4 = 2e-7 h.
const EARLY: f64 = 0.02;
/// What rounding leaves of a packet's moments, the motion being known to 1e-12: 3e-10 of themselves for
/// the linear law, whose covariance is known.
const ROUNDING: f64 = 1e-9;
/// What cells may do to a packet alike in both runs, over the tolerance that chose them.
const CELLS: f64 = 2e-6;
/// Part of the error of the steps that stays in the bar beside the difference of two runs: that shows five to ten
/// times the error, the steps of one being 1.5 times as long, but may pass through zero.
const HIDDEN: f64 = 0.25;
/// How much finer than the stationary law asks for the mesh that takes over may be. At a tolerance of
/// 1e-3 a packet takes 5 ms per unit of time, a mesh of the stationary law 0.4 ms, twice as fine 1.5 ms:
/// to wait a few units for a coarser mesh pays in a run of fifty.
pub(super) const REFINED: f64 = 1.25;
/// The part of the tolerance that the changes of the packet's mass may add up to: it then no longer fits
/// its frame, and a finer mesh takes over. A kurtosis weighs them ten times ([`TAIL`](super::bars::TAIL)).
const TORN: f64 = 0.03;
/// As much of that as makes it worth while to hand over to a mesh finer by [`WORTH`] than the stationary
/// law asks for: a displaced packet bends along its orbit, and its cells hold it less and less.
const BENT: f64 = 0.5;
const WORTH: f64 = 2.5;

/// Cells per deviation of what is handed over. A Gaussian of 2 cells per deviation loses 1e-4 of its
/// variance in twenty passes of a spline of degree 7 (measured), in proportion to the eighth power.
fn cells_per_deviation(tolerance: f64) -> f64 {
    2.5 * (1e-3 / tolerance).powf(0.125).clamp(0.75, 2.0)
}

/// Cells, reach and step of a packet for a tolerance. Measured for the Hertz law from rest and from
/// displaced points, zeta = 0.005: cells of 0.4 deviations and steps of 0.6 give moments to 1e-6. Where the
/// damping is strong steps err by [`STRONG`] zeta^3 tau^4, and get a five-thousandth of the tolerance: they are
/// few, and two runs share the error.
fn fineness(oscillator: &Oscillator, tolerance: f64, (finer, longer): (f64, f64)) -> Fineness {
    let zeta = oscillator.zeta();
    let relative = tolerance / 1e-3;
    let weak = 0.8 * relative.powf(1.0 / 6.0);
    let strong = (2e-4 * tolerance / (STRONG * zeta.powi(3))).powf(0.25);
    // Two deviations and a half for tails that are not Gaussian and for the fourth moments, which weigh
    // them; the coarse run goes without a fifth of it.
    let beyond = if finer < 1.0 { 2.0 } else { 2.5 };
    Fineness {
        cell: 0.4 * relative.powf(0.125).clamp(0.4, 1.25) / finer.max(0.5),
        reach: beyond + (-2.0 * layout::neglected(tolerance).ln()).sqrt(),
        border: BORDER * tolerance,
        step: longer * weak.min(strong).min(1.0),
        beside: if longer > 1.0 { 1.0 } else { 1.5 },
    }
}

/// P on the border of a packet's square over the tolerance, above which there is more beyond the border
/// than a kurtosis can bear: tails that were cut weighed two hundred times in it (a point dropped at q = 1,
/// t = 12).
const BORDER: f64 = 1e-6;

/// What an opening will take.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bill {
    /// Seconds on one core.
    pub(super) seconds: f64,
    /// Steps.
    pub(super) steps: f64,
    /// When a mesh takes over.
    pub(super) until: f64,
    /// Cells along either side, where no mesh takes over.
    pub(super) alone: Option<usize>,
}

/// What the opening of a run will take on one core, if it has one. The packet is as wide as a mesh needs once the
/// noise has added that variance.
pub(super) fn cost(
    recipe: &Recipe,
    oscillator: &Oscillator,
    initial: &Initial,
    until: f64,
) -> Option<Bill> {
    if !recipe.opens_on_moving_grid() {
        return None;
    }
    let fineness = fineness(oscillator, recipe.tolerance, (1.0, 1.0));
    let widths = layout::thermal_widths(oscillator, recipe.tolerance);
    let wide = cells_per_deviation(recipe.tolerance) * widths[0].max(widths[1]) / REFINED;
    let left = 1.0 - (wide * wide / oscillator.temperature()).min(1.0);
    let mut wide = -left.ln() / (2.0 * oscillator.zeta());
    if let (FirstGrid::Falling(most), Initial::Gaussian { mean, deviation }) =
        (recipe.first_grid, *initial)
    {
        // Under strong friction velocities fall at once, and displacements at the rate 1/(2 zeta).
        let at_rest = [deviation[0], oscillator.temperature().sqrt()];
        let beyond = recipe.amplitude(oscillator, [mean[0], 0.0], at_rest) / most;
        wide = wide.max(2.0 * oscillator.zeta() * beyond.max(1.1).ln());
    }
    let side = 2.0 * (fineness.reach / fineness.cell).ceil();
    let alone = recipe.first_grid == FirstGrid::MovingForGood || wide >= until;
    let time = if alone { until } else { wide };
    let steps = time / fineness.step;
    Some(Bill {
        seconds: timing::FRAME_NODE * side * side * steps,
        steps,
        until: time,
        alone: alone.then_some(side as usize),
    })
}

impl<'a> Opening<'a> {
    /// The opening of a run, if it has one.
    pub(super) fn of(
        recipe: &'a Recipe,
        oscillator: &'a Oscillator,
        initial: &Initial,
        (finer, longer): (f64, f64),
    ) -> Result<Option<Self>> {
        if !recipe.opens_on_moving_grid() {
            return Ok(None);
        }
        let early = EARLY * longer / (1.0 + oscillator.zeta());
        let packet = Packet::new(
            oscillator,
            initial,
            early,
            fineness(oscillator, recipe.tolerance, (finer, longer)),
        )?;
        let goal = (recipe.first_grid != FirstGrid::MovingForGood)
            .then(|| recipe.mesh(oscillator, finer))
            .transpose()?;
        let finest = if goal.is_none() || recipe.layout.is_given() {
            [0.0; 2]
        } else {
            layout::thermal_widths(oscillator, recipe.tolerance).map(|width| width / REFINED)
        };
        Ok(Some(Self {
            oscillator,
            recipe,
            finer,
            packet,
            goal,
            finest,
        }))
    }

    /// The packet.
    pub(super) fn packet(&self) -> &Packet {
        &self.packet
    }

    /// What the packet has cost so far; a point has cost nothing.
    pub(super) fn loss(&self) -> Loss {
        if self.packet.is_point() {
            return Loss::default();
        }
        Loss {
            spread: ROUNDING + CELLS * self.recipe.tolerance + HIDDEN * self.packet.step_error(),
            tail: self.packet.defect(),
        }
    }

    /// Comes to time t, or to where a mesh takes over, and says whether it came to t. `watch` is told the
    /// time.
    pub(super) fn advance(
        &mut self,
        t: f64,
        watch: &mut dyn FnMut(f64) -> Result<()>,
    ) -> Result<bool> {
        let left = t - self.packet.time();
        if left <= 0.0 {
            return Ok(true);
        }
        self.packet.open(left);
        let left = t - self.packet.time();
        if left <= 0.0 {
            return Ok(true);
        }
        let steps = self.packet.divide(left);
        for _ in 0..steps {
            if self.is_wide() {
                return Ok(false);
            }
            self.packet.advance(left / steps as f64);
            watch(self.packet.time())?;
        }
        self.packet.arrive(t);
        Ok(true)
    }

    /// Whether a mesh can take over, or has to.
    fn is_wide(&self) -> bool {
        let Some(mesh) = &self.goal else {
            return false;
        };
        let enough = cells_per_deviation(self.recipe.tolerance);
        let widths = if self.recipe.layout.is_given() {
            // The scene's own cells, the widest near the packet.
            self.widest(mesh)
        } else {
            self.finest
        };
        let wide = |finer: f64| {
            let pairs = self.narrowest().into_iter().zip(widths);
            pairs
                .into_iter()
                .all(|(deviation, width)| deviation >= enough * width * finer)
        };
        if let FirstGrid::Falling(most) = self.recipe.first_grid {
            return self.is_torn() || (wide(1.0) && self.amplitude() <= most);
        }
        wide(1.0) || self.is_torn() || (self.is_bent() && wide(REFINED / WORTH))
    }

    /// The amplitude of the packet over that of the edge of the domain that the stationary law needs.
    fn amplitude(&self) -> f64 {
        let frame = self.packet.frame();
        let recipe = self.recipe;
        recipe.amplitude(self.oscillator, frame.mean, frame.deviation())
    }

    /// Whether the packet begins not to fit its frame.
    fn is_bent(&self) -> bool {
        self.packet.defect() > BENT * TORN * self.recipe.tolerance
    }

    /// Whether the packet no longer fits its frame.
    fn is_torn(&self) -> bool {
        self.packet.defect() > TORN * self.recipe.tolerance
    }

    /// How narrow the density is in q and in v, at this phase of the motion or a later one: where the
    /// motion turns it before friction stops it, what is narrow in one is soon narrow in the other.
    fn narrowest(&self) -> [f64; 2] {
        let frame = self.packet.frame();
        if self.oscillator.zeta() < 1.0 {
            [frame.narrowest(); 2]
        } else {
            frame.conditional()
        }
    }

    /// The widest cells of a mesh within three deviations.
    fn widest(&self, mesh: &Mesh) -> [f64; 2] {
        let frame = self.packet.frame();
        let near = |axis: &Axis, mean: f64, deviation: f64| {
            [-3.0, 0.0, 3.0]
                .map(|k| axis.at(axis.locate(mean + k * deviation)).1)
                .into_iter()
                .fold(0.0, f64::max)
        };
        let [q, v] = frame.deviation();
        [
            near(&mesh.q, frame.mean[0], q),
            near(&mesh.v, frame.mean[1], v),
        ]
    }

    /// The mesh that takes over.
    ///
    /// # Errors
    /// [`Error::Mesh`] if the cells of the scene are too wide for a packet that does not keep its shape.
    pub(super) fn mesh(&self) -> Result<Mesh> {
        let Some(mesh) = &self.goal else {
            return self.own_mesh();
        };
        let narrowest = self.narrowest();
        if self.recipe.layout.is_given() {
            let widest = self.widest(mesh);
            for ((deviation, width), name) in narrowest.iter().zip(widest).zip(["q", "v"]) {
                if *deviation < Density::NARROWEST * width {
                    return Err(Error::Mesh {
                        what: format!(
                            "at t = {:.2} the density is {:.2} cells wide in {name} and no longer \
                             fits a moving frame; {} cells are needed",
                            self.packet.time(),
                            deviation / width,
                            Density::NARROWEST
                        ),
                        help: "more method.cells, none at all, or a wider initial.deviation".into(),
                    });
                }
            }
            return Ok(mesh.clone());
        }
        let tolerance = self.recipe.tolerance;
        let start = if self.is_torn() {
            layout::start_widths(narrowest, tolerance)
        } else {
            narrowest.map(|deviation| deviation / cells_per_deviation(tolerance))
        };
        let mut layout = self.recipe.layout.narrowed(start);
        if let FirstGrid::Falling(most) = self.recipe.first_grid {
            // Torn before it was in.
            let more = (self.amplitude() / most).max(1.0);
            layout.domain = layout.domain.enlarged(self.oscillator, more);
        }
        layout.mesh(self.oscillator, self.finer)
    }

    /// The packet's own cells on the axes of q and v, for a run that never leaves it.
    pub(super) fn own_mesh(&self) -> Result<Mesh> {
        let frame = self.packet.frame();
        let reach = self.packet.reach();
        let axis = |mean: f64, deviation: f64| {
            Axis::uniform(
                mean - reach * deviation,
                mean + reach * deviation,
                self.packet.cells(),
            )
        };
        let [q, v] = frame.deviation();
        Ok(Mesh {
            q: axis(frame.mean[0], q)?,
            v: axis(frame.mean[1], v)?,
        })
    }

    /// The truncated domain, where there is one.
    pub(super) fn domain(&self) -> Domain {
        match self.goal {
            Some(_) => self.recipe.layout.domain,
            None => Domain {
                q: [0.0; 2],
                v: [0.0; 2],
                neglected: layout::neglected(self.recipe.tolerance),
            },
        }
    }

    /// The density on the mesh of a propagator, scaled to probability 1, with what that changed.
    pub(super) fn density(&self, propagator: &Propagator) -> (Density, f64) {
        let mut density = propagator.sampled(&|points| self.packet.density(points));
        let mass = density.mass();
        for p in density.cells_mut() {
            *p /= mass;
        }
        (density, (mass - 1.0).abs())
    }

    /// The numbers of an output.
    pub(super) fn look(&self) -> Look {
        let packet = &self.packet;
        let law = self.oscillator.displacement_law().ok();
        let temperature = self.oscillator.temperature();
        let stationary = |[q, v]: [f64; 2]| {
            law.as_ref().map_or(0.0, |law| {
                let scale = (std::f64::consts::TAU * temperature).sqrt();
                law.density(q) * (-0.5 * v * v / temperature).exp() / scale
            })
        };
        let mut moments = packet.moments();
        moments.drop_shape_of_flight(layout::neglected(self.recipe.tolerance));
        if packet.is_point() {
            return Look {
                moments,
                lowest: 0.0,
                negative: 0.0,
                entropy: f64::INFINITY,
                distance: 2.0,
            };
        }
        Look {
            moments,
            lowest: packet.lowest(),
            negative: packet.sum(|_, p| (-p).max(0.0)),
            entropy: packet.sum(|x, p| {
                let reference = stationary(x);
                if p > 0.0 && reference > 0.0 {
                    p * (p / reference).ln()
                } else {
                    0.0
                }
            }),
            // Both integrals are 1: |p - p_s| is twice its positive part, which lies in the packet.
            distance: 2.0 * packet.sum(|x, p| (p - stationary(x)).max(0.0)),
        }
    }

    /// The density on equal cells about the packet.
    ///
    /// # Errors
    /// [`Error::Invalid`] while it is a point.
    pub(super) fn snapshot(&self) -> Result<Snapshot> {
        if self.packet.is_point() {
            let accepted = "times after 0: at rest all probability is in one point";
            return Err(Error::invalid("outputs.density_at", 0, accepted));
        }
        let mesh = self.own_mesh()?;
        let (q, v) = (mesh.q.centres(), mesh.v.centres());
        let points: Vec<[f64; 2]> = q
            .iter()
            .flat_map(|q| v.iter().map(move |v| [*q, *v]))
            .collect();
        let p = self.packet.density(&points);
        Ok(Snapshot {
            t: self.packet.time(),
            q: Array1::from_vec(q.to_vec()),
            v: Array1::from_vec(v.to_vec()),
            p: Array2::from_shape_fn((q.len(), v.len()), |(i, j)| p[i * v.len() + j]),
        })
    }
}
